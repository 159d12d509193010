//! `palpate bench`.

mod simulate;

use super::Failure;
use crate::bench::{Clock, REGIMES, Row, coupled_cylinder, cylinder, run as run_regime};
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
///
/// With --simulate, times a path of the offline simulation instead: a finite-element mesh whose patch is pressed along −y
/// and then, if wanted, dragged. Without further options that is 4 mm in 8 steps, in isochoric neo-Hookean tissue of
/// E = 10 kPa, ν = 0.45. Tables are NODES.csv (x_m,y_m,z_m), TET10.csv (n0 to n9: four corners, then the nodes on edges
/// 01, 12, 20, 03, 13, 23) and PATCH.csv (node), nodes numbered from 0. A mesh that begins at x = 0 or z = 0 is taken for
/// half a body, with that plane of symmetry; forces are the whole body's. The ends in z are held.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  palpate bench --triangles 528,50000 --json\n  \
                        palpate bench --simulate nodes.csv tet10.csv patch.csv --drag-mm 2\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
pub struct Args {
    /// Sizes of the meshes
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', default_value = "528,50000,5000000")]
    triangles: Vec<usize>,
    /// Steps of each regime [default: 200000]; with --simulate, load steps down to the depth [default: 8]
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Slip rules to time
    #[arg(
        long,
        value_enum,
        value_name = "RULE,...",
        value_delimiter = ',',
        default_value = "paper,consistent,exact"
    )]
    slip: Vec<super::Slip>,
    /// Laws to time
    #[arg(
        long,
        value_enum,
        value_name = "LAW,...",
        value_delimiter = ',',
        default_value = "decoupled,coupled"
    )]
    law: Vec<Law>,
    /// Tubes that are 1.9 times as stiff laterally along the axis as around it
    #[arg(long)]
    anisotropic: bool,
    /// Time each also with partial slip: two contact points side by side
    #[arg(long)]
    partial_slip: bool,
    #[command(flatten)]
    simulate: simulate::Options,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// A kind of force law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Law {
    /// f_z(δz) and f_r(δr)
    Decoupled,
    /// W(δz, δ_t)
    Coupled,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    if args.simulate.asked() {
        return simulate::run(&args.simulate, args.steps.unwrap_or(8), args.json);
    }
    let steps = args.steps.unwrap_or(200_000);
    if let Some(n) = args.triangles.iter().find(|n| !(24..=50_000_000).contains(*n)) {
        return Err(anyhow!("--triangles {n}: give numbers between 24 and 50000000").into());
    }
    if !(10_000..=100_000_000).contains(&steps) {
        return Err(anyhow!("--steps {steps}: give a number between 10000 and 100000000").into());
    }
    if cfg!(debug_assertions) {
        console::note("this is a debug build: its times mean little");
    }
    let clock = Clock::measure();
    console::note(&format!("reading the clock takes {:.0} ns", clock.overhead_ns));
    let mut rows: Vec<Row> = Vec::new();
    for &triangles in &args.triangles {
        for law in &args.law {
            let start = Instant::now();
            let ratio = if args.anisotropic { 1.9 } else { 1.0 };
            let body = match law {
                Law::Decoupled => cylinder(triangles, ratio)?,
                Law::Coupled => coupled_cylinder(triangles, ratio)?,
            };
            let built = start.elapsed().as_secs_f64();
            console::note(&format!("{} triangles: built in {built:.1} s", body.elements().len()));
            for partial in [false, true].into_iter().filter(|partial| args.partial_slip || !partial) {
                for rule in args.slip.iter().map(|s| s.rule()) {
                    let row = |regime| Row {
                        anisotropic: args.anisotropic,
                        ..run_regime(&body, rule, partial, regime, steps, &clock)
                    };
                    rows.extend(REGIMES.map(row));
                }
            }
        }
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
    let first = rows.first().map_or(("", ""), |r| (r.law, r.slip));
    let head = [
        "regime",
        "triangles",
        "law",
        "slip rule",
        "median (ns)",
        "p99 (ns)",
        "p99.9 (ns)",
        "evaluations",
        "crossings",
    ];
    let mut lines = vec![head.map(str::to_owned).to_vec()];
    lines[0].extend([format!("to {least}"), format!("to {}", first.1)]);
    for regime in REGIMES {
        let of = |r: &&Row| r.regime == regime;
        let median = |triangles: usize, law: &str, slip: &str, partial: bool| {
            let same =
                |r: &&Row| (r.triangles, r.law, r.slip, r.partial_slip) == (triangles, law, slip, partial);
            let row = rows.iter().filter(of).find(same);
            row.map_or(f64::NAN, |r| r.times.median_ns)
        };
        lines.extend(rows.iter().filter(of).map(|r| {
            vec![
                r.regime.to_owned(),
                r.triangles.to_string(),
                r.law.to_owned(),
                format!("{}{}", r.slip, if r.partial_slip { ", partial" } else { "" }),
                format!("{:.1}", r.times.median_ns),
                format!("{:.0}", r.times.p99_ns),
                format!("{:.0}", r.times.p999_ns),
                format!("{:.2}", r.evaluations_per_step),
                format!("{:.2}", r.crossings_per_step),
                format!("{:.2}×", r.times.median_ns / median(least, r.law, r.slip, r.partial_slip)),
                format!("{:.2}×", r.times.median_ns / median(r.triangles, first.0, first.1, false)),
            ]
        }));
    }
    console::table(&lines)
}
