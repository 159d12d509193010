//! How late periods begin and what a step takes, without the window and then with it. Needs a display.
//!
//! `cargo run --release -p palpate-viewer --example lateness -- 10`: ten seconds each.

use palpate::runtime::{LiveSession, Outcome, Percentiles, PreparedSession, SessionConfig};
use palpate_viewer::command::watch;
use palpate_viewer::gallery::Example;
use palpate_viewer::work::Opened;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seconds: f64 = std::env::args().nth(1).map_or(Ok(10.0), |word| word.parse())?;
    let folder = std::env::temp_dir().join(format!("palpate-lateness-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let file = folder.join("pad.body");
    Example::Pad.make()?.save(&file)?;
    let config = SessionConfig { seconds: Some(seconds), motion: "hold".into(), ..SessionConfig::default() };
    let opened = Opened::read(&file)?;
    tell("without", &LiveSession::start(opened.session_body(), config.clone())?.join());
    let session = PreparedSession::new(opened.session_body(), config, None)?;
    let until = Instant::now() + Duration::from_secs_f64(seconds + 2.0);
    if let Some(outcome) = watch(opened, session, Box::new(move |_| Instant::now() > until))? {
        tell("with", &outcome);
    }
    std::fs::remove_dir_all(&folder)?;
    Ok(())
}

fn tell(what: &str, outcome: &Outcome) {
    let summary = &outcome.finished.summary;
    let us = |p: &Percentiles| {
        [p.p50, p.p99, p.p99_9, p.max].map(|ns| format!("{:.1}", ns as f64 * 1e-3)).join(" ")
    };
    println!(
        "{what}: {} periods, late (half, 99 %, 99.9 %, most) {} µs, step {} µs, {} overruns; {}",
        summary.periods,
        us(&summary.lateness_ns),
        us(&summary.step_ns),
        summary.overruns,
        outcome.report.end
    );
}
