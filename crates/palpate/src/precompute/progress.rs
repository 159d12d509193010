//! How far a run is, on standard error: a bar on a terminal, else a line now and then.

use crate::console;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Between lines, where there is no bar.
const QUIET: Duration = Duration::from_secs(15);

/// Points and paths done, and an estimate of the time left.
pub struct Progress {
    bar: Option<ProgressBar>,
    begun: Instant,
    state: Mutex<State>,
    points: usize,
    before: usize,
}

struct State {
    points: usize,
    paths: usize,
    told: Instant,
}

impl Progress {
    /// Of `points`, `before` are done already.
    pub fn new(points: usize, before: usize) -> Self {
        let now = Instant::now();
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(points as u64).with_position(before as u64);
            let style = ProgressStyle::with_template("{bar:40} {pos}/{len} points, {msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.set_message("the first takes a while");
            bar
        });
        let state = Mutex::new(State { points: 0, paths: 0, told: now });
        Progress { bar, begun: now, state, points, before }
    }

    /// One more point is done, with so many paths.
    pub fn done(&self, paths: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.points += 1;
        state.paths += paths;
        let left = self.points.saturating_sub(self.before + state.points);
        let rest = self.begun.elapsed().mul_f64(left as f64 / state.points as f64);
        let message = format!("{} paths, about {} left", state.paths, duration(rest));
        match &self.bar {
            Some(bar) => {
                bar.inc(1);
                bar.set_message(message);
            }
            None if state.told.elapsed() >= QUIET && left > 0 => {
                state.told = Instant::now();
                console::note(&format!("{}/{} points, {message}", self.before + state.points, self.points));
            }
            None => {}
        }
    }

    /// Something besides.
    pub fn note(&self, message: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| console::note(message)),
            None => console::note(message),
        }
    }

    /// The end, good or bad.
    pub fn end(&self) {
        if let Some(bar) = &self.bar {
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
