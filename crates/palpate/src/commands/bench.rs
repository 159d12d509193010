//! `palpate bench`.

use super::Failure;
use crate::bench::{Clock, REGIMES, Row, cylinder, run as run_regime};
use crate::console;
use anyhow::anyhow;
use std::time::Instant;

/// Time the step against the size of the mesh, on this machine
///
/// Tubes of 60 mm diameter and 100 mm length with the same 288 responses, ever finer. Regimes: `stick`, small circles
/// 3 mm deep within the friction limit; `slide`, a helical drag at 0.1 m/s and 1 kHz, repeated; `slide-cold`, a drag
/// over places not touched before; `free`, flying 5 to 20 mm above the surface; `poke`, the steps in which contacts
/// begin, at random places.
///
/// The median is that of batches of 64 steps in a row, divided by 64. The percentiles are those of steps timed one by
/// one, less the time that reading the clock takes (measured first), but no less than the median. Other programs that
/// run meanwhile count too.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  palpate bench --triangles 528,50000 --json\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
pub struct Args {
    /// Sizes of the meshes
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', default_value = "528,50000,5000000")]
    triangles: Vec<usize>,
    /// Steps of each regime
    #[arg(long, value_name = "N", default_value_t = 200_000)]
    steps: usize,
    /// Tubes that are 1.9 times as stiff sideways along the axis as around it
    #[arg(long)]
    anisotropic: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    if let Some(n) = args.triangles.iter().find(|n| !(24..=50_000_000).contains(*n)) {
        return Err(anyhow!("--triangles {n}: give numbers between 24 and 50000000").into());
    }
    if !(10_000..=100_000_000).contains(&args.steps) {
        return Err(anyhow!("--steps {}: give a number between 10000 and 100000000", args.steps).into());
    }
    if cfg!(debug_assertions) {
        console::note("this is a debug build: its times mean little");
    }
    let clock = Clock::measure();
    console::note(&format!("reading the clock takes {:.0} ns", clock.overhead_ns));
    let mut rows: Vec<Row> = Vec::new();
    for &triangles in &args.triangles {
        let start = Instant::now();
        let body = cylinder(triangles, if args.anisotropic { 1.9 } else { 1.0 })?;
        let built = start.elapsed().as_secs_f64();
        console::note(&format!("{} triangles: built in {built:.1} s", body.elements().len()));
        rows.extend(REGIMES.map(|regime| run_regime(&body, regime, args.steps, &clock)));
    }
    if args.json {
        console::json(&serde_json::json!({ "results": rows }))?;
    } else {
        console::text(&text(&rows))?;
    }
    Ok(())
}

fn text(rows: &[Row]) -> String {
    let least = rows.iter().map(|r| r.triangles).min().unwrap_or(0);
    let head = ["regime", "triangles", "median (ns)", "p99 (ns)", "p99.9 (ns)", "evaluations", "crossings"];
    let mut lines = vec![head.map(str::to_owned).to_vec()];
    lines[0].push(format!("to {least}"));
    for regime in REGIMES {
        let of = |r: &&Row| r.regime == regime;
        let base =
            rows.iter().filter(of).find(|r| r.triangles == least).map_or(f64::NAN, |r| r.times.median_ns);
        lines.extend(rows.iter().filter(of).map(|r| {
            vec![
                r.regime.to_owned(),
                r.triangles.to_string(),
                format!("{:.1}", r.times.median_ns),
                format!("{:.0}", r.times.p99_ns),
                format!("{:.0}", r.times.p999_ns),
                format!("{:.2}", r.evaluations_per_step),
                format!("{:.2}", r.crossings_per_step),
                format!("{:.2}×", r.times.median_ns / base),
            ]
        }));
    }
    console::table(&lines)
}
