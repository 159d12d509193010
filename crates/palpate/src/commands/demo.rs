//! `palpate demo`.

use super::Failure;
use crate::demo::{cylinder, experiment};

/// Runs the paper's experiment.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(_: &Args) -> Result<(), Failure> {
    let body = cylinder::body()?;
    for hz in [1e3, 1e4, 1e5] {
        let now = std::time::Instant::now();
        let r = experiment::roll_out(&body, hz, false);
        println!("{hz} bounds {:?} unbounded {} fastest {} {:?}", r.bounds, r.unbounded, r.fastest, now.elapsed());
        for s in &r.settings {
            println!("  largest {:.6} excess {:.6} clicks {} strongest {:.3} {:?} {:?}", s.largest, s.excess, s.clicks.len(), s.strongest, s.energy, s.counters);
            if hz == 1e3 { println!("     {:?}", s.clicks); }
        }
    }
    Ok(())
}
