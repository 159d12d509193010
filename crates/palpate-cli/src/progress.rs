//! How far long work is, on standard error: a bar on a terminal, else a line now and then.

use crate::console;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Between lines, where there is no bar.
const QUIET: Duration = Duration::from_secs(15);

/// Points and paths done, and an estimate of the time left.
#[derive(Debug, Default)]
pub struct Progress(Mutex<Option<State>>);

#[derive(Debug)]
struct State {
    bar: Option<ProgressBar>,
    begun: Instant,
    told: Instant,
    /// All points, those done before it began, and since.
    of: usize,
    before: usize,
    points: usize,
    paths: usize,
}

impl Progress {
    fn state(&self) -> MutexGuard<'_, Option<State>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl palpate_build::Progress for Progress {
    fn begin(&self, points: usize, before: usize) {
        let now = Instant::now();
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(points as u64).with_position(before as u64);
            let style = ProgressStyle::with_template("{bar:40} {pos}/{len} points, {msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.set_message("the first takes a while");
            bar
        });
        *self.state() = Some(State { bar, begun: now, told: now, of: points, before, points: 0, paths: 0 });
    }

    fn done(&self, paths: usize) {
        let mut state = self.state();
        let Some(state) = state.as_mut() else { return };
        state.points += 1;
        state.paths += paths;
        let left = state.of.saturating_sub(state.before + state.points);
        let rest = state.begun.elapsed().mul_f64(left as f64 / state.points as f64);
        let message = format!("{} paths, about {} left", state.paths, duration(rest));
        match &state.bar {
            Some(bar) => {
                bar.inc(1);
                bar.set_message(message);
            }
            None if state.told.elapsed() >= QUIET && left > 0 => {
                state.told = Instant::now();
                console::note(&format!("{}/{} points, {message}", state.before + state.points, state.of));
            }
            None => {}
        }
    }

    fn note(&self, message: &str) {
        match self.state().as_ref().and_then(|s| s.bar.as_ref()) {
            Some(bar) => bar.suspend(|| console::note(message)),
            None => console::note(message),
        }
    }

    fn end(&self) {
        if let Some(bar) = self.state().take().and_then(|s| s.bar) {
            bar.finish_and_clear();
        }
    }
}

/// In words.
fn duration(time: Duration) -> String {
    match time.as_secs() {
        s @ 0..=99 => format!("{s} s"),
        s @ 100..=7199 => format!("{} min", (s + 30) / 60),
        s => format!("{:.1} h", s as f64 / 3600.0),
    }
}
