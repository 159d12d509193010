//! `palpate trace`.

use super::Failure;
use crate::trace::{COLUMNS, Summary, count, rollout, write_row};
use crate::{console, files, path};
use palpate_body::Body;
use palpate_engine::Ablation;
use std::path::PathBuf;

/// Lead the tool along a path and write down every force
///
/// Deterministic: the same body and path give the same bytes, and no clock is read. The path is a CSV file with the
/// columns time_s,x_m,y_m,z_m and optionally qw,qx,qy,qz (a unit quaternion), by name and in any order.
///
/// The trace has the columns time_s, x_m.., in_contact, slipping (0 or 1), element, cx_m.. (contact point at rest),
/// delta_z_m, delta_r_m (deflections), fx_n.., tx_nm.. (force and torque on the tool), and work_j, stored_j,
/// dissipated_j, generated_j (sums since the first row). Without contact, element is -1 and the contact's columns
/// are 0. Every number reads back to the same bits.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  palpate trace liver.body --path drag.csv --rate-hz 1000 -o drag-trace.csv\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage."
)]
pub struct Args {
    /// Body file
    body: PathBuf,
    /// Path CSV
    #[arg(long, value_name = "PATH.csv")]
    path: PathBuf,
    /// Trace CSV to write
    #[arg(short, long, value_name = "TRACE.csv")]
    output: PathBuf,
    /// Slip rule, in place of the body's own
    #[arg(long, value_enum)]
    slip: Option<super::Slip>,
    /// Interpolation to take away, as in the paper's section 5
    #[arg(long, value_enum)]
    ablate: Option<super::Ablate>,
    /// Resample the path to this rate, Hz; its end is kept; without it the rows are the steps
    #[arg(long, value_name = "N")]
    rate_hz: Option<f64>,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    files::refuse_overwrite(&[&args.output], &[&args.body, &args.path])?;
    let body = Body::open(&args.body)?;
    let mut waypoints = path::read(&args.path)?;
    if let Some(rate_hz) = args.rate_hz {
        waypoints = path::resample(&waypoints, rate_hz)?;
    }
    let rule = args.slip.map_or(body.slip(), super::Slip::rule);
    let ablation = args.ablate.map_or(Ablation::None, super::Ablate::ablation);

    let mut summary = Summary::default();
    files::replace_or_stream(&args.output, |out| {
        writeln!(out, "{COLUMNS}")?;
        let mut rollout = rollout(&body, waypoints.iter().map(|w| w.pose), rule, ablation);
        for waypoint in &waypoints {
            let Some(output) = rollout.next() else { break };
            write_row(out, waypoint, &output)?;
            summary.add(&body, rollout.contact(), waypoint, &output);
        }
        summary.finish(rollout.contact());
        Ok(())
    })?;

    for warning in summary.warnings(&body, &waypoints, ablation) {
        console::note(&warning);
    }
    if args.json {
        console::json(&summary)?;
    } else {
        let Summary { steps, contacts, largest_force_n, .. } = summary;
        console::note(&format!(
            "{}, {}, largest force {largest_force_n:.3} N",
            count(steps, "step"),
            count(contacts, "contact")
        ));
    }
    Ok(())
}
