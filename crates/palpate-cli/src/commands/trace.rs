//! `palpate trace`.

use super::Failure;
use crate::console;
use anyhow::{anyhow, bail};
use palpate_body::{Body, SlipRule};
use palpate_engine::Waypoint;
use palpate_engine::rollout;
use palpate_engine::{Ablation, Contact, Output};
use palpate_files as files;
use palpate_runtime::path;
use palpate_runtime::trace::{COLUMNS, TraceSummary, count, write_row};
use palpate_runtime::{Ending, Record, Recording, Retrace, SessionBody};
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
///
/// The path may also be a recording of `palpate run`. Without --slip, --no-tank, --no-partial-slip, --ablate and --rate-hz the engine then takes the
/// recorded steps once more, on the recorded patches, and must give the recorded forces and energies to the bit.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  palpate trace liver.body --path drag.csv --rate-hz 1000 -o drag-trace.csv\n  \
                        palpate trace liver.body --path first-touch.rec -o first-touch.csv\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage, 3 other bits than recorded."
)]
pub struct Args {
    /// Body file
    body: PathBuf,
    /// Path CSV, or a recording
    #[arg(long, value_name = "FILE")]
    path: PathBuf,
    /// Trace CSV to write
    #[arg(short, long, value_name = "TRACE.csv")]
    output: PathBuf,
    /// Slip rule, in place of the body's own
    #[arg(long, value_enum)]
    slip: Option<super::Slip>,
    /// Let slip give out energy, where the body's tank would hold it back
    #[arg(long)]
    no_tank: bool,
    /// Let the contact slip as a whole, where the body has two contact points side by side
    #[arg(long)]
    no_partial_slip: bool,
    /// Interpolation to take away, as in the paper's section 5
    #[arg(long, value_enum)]
    ablate: Option<super::Ablate>,
    /// Resample the path to this rate, Hz; its end is kept; without it the rows are the steps
    #[arg(long, value_name = "N")]
    rate_hz: Option<f64>,
    /// Where the body of a recording is while its steps are repeated [default: in its file from 1,048,576 triangles on]
    #[arg(long, value_enum, value_name = "WHERE")]
    body_in: Option<super::run::Where>,
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
    let recorded = palpate_runtime::is_recording(&args.path)?;
    let as_recorded = args.slip.is_none()
        && !args.no_tank
        && !args.no_partial_slip
        && args.ablate.is_none()
        && args.rate_hz.is_none();
    if recorded && as_recorded {
        return retrace(args);
    }
    let body = Body::open(&args.body)?;
    let mut waypoints = if recorded { poses(args)? } else { path::read(&args.path)? };
    if let Some(rate_hz) = args.rate_hz {
        waypoints = path::resample(&waypoints, rate_hz)?;
    }
    let rule = args.slip.map_or(body.slip(), super::Slip::rule);
    let ablation = args.ablate.map_or(Ablation::None, super::Ablate::ablation);

    let mut summary = TraceSummary::default();
    files::replace_or_stream(&args.output, |out| {
        writeln!(out, "{COLUMNS}")?;
        let mut rollout = rollout(&body, waypoints.iter().copied(), rule, ablation);
        if args.no_tank {
            rollout = rollout.without_tank();
        }
        if args.no_partial_slip {
            rollout = rollout.with_partial_slip(false);
        }
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
    told(args, summary)
}

fn told(args: &Args, summary: TraceSummary) -> Result<(), Failure> {
    if args.json {
        console::json(&summary)?;
    } else {
        let TraceSummary { steps, contacts, largest_force_n, .. } = summary;
        console::note(&format!(
            "{}, {}, largest force {largest_force_n:.3} N",
            count(steps, "step"),
            count(contacts, "contact")
        ));
    }
    Ok(())
}

/// A recording's poses as a path.
fn poses(args: &Args) -> anyhow::Result<Vec<Waypoint>> {
    let recording = Recording::open(&args.path)?;
    Ok(recording.filter_map(|r| r.tool().map(|pose| Waypoint { time_s: r.time_s, pose })).collect())
}

/// The engine's steps of a recording once more, compared with what was recorded.
fn retrace(args: &Args) -> Result<(), Failure> {
    let mut recording = Recording::open(&args.path)?;
    let header = recording.header().clone();
    let name = args.path.display();
    if header.body.sha256 != files::sha256(&args.body)? {
        return Err(anyhow!(
            "{name}: it is of another body than {}: its own was {} with SHA-256 {}; give that one",
            args.body.display(),
            header.body.name,
            header.body.sha256
        )
        .into());
    }
    let rule = SlipRule::ALL.into_iter().find(|r| r.name() == header.slip);
    let ablations = [Ablation::None, Ablation::Coordinates, Ablation::Responses, Ablation::Both];
    let ablation = ablations.into_iter().find(|a| palpate_runtime::ablation_name(*a) == header.ablation);
    let (Some(rule), Some(ablation)) = (rule, ablation) else {
        return Err(
            anyhow!("{name}: it names a slip rule or ablation that this version does not know").into()
        );
    };
    let body = SessionBody::open(&args.body, Some(rule), args.body_in.map(Into::into), false)?.source;
    let contact = Contact::on(body.model_header(), rule, ablation)
        .with_tank(header.tank)
        .with_partial_slip(header.partial_slip);
    let mut again = Retrace::new(&*body, contact);
    let mut summary = TraceSummary::default();
    let (mut differ, mut first, mut number, mut missing) = (0u64, None, None, 0u64);
    files::replace_or_stream(&args.output, |out| {
        writeln!(out, "{COLUMNS}")?;
        for record in &mut recording {
            missing += number.map_or(0, |n: u64| record.number.saturating_sub(n + 1));
            number = Some(record.number);
            let (Some(output), Some(pose)) = (again.step(&record)?, record.tool()) else { continue };
            let waypoint = Waypoint { time_s: record.time_s, pose };
            write_row(out, &waypoint, &output)?;
            summary.add(again.ground(), again.contact(), &waypoint, &output);
            if !same(&record, &output) {
                differ += 1;
                first.get_or_insert(record.time_s);
            }
        }
        if summary.steps == 0 {
            bail!("{name}: the engine took no step in it");
        }
        summary.finish(again.contact());
        Ok(())
    })?;
    match recording.ending() {
        Some(Ending::Clean { .. }) | None => {}
        Some(ending) => console::note(&format!("{name}: {ending}")),
    }
    if missing > 0 {
        console::note(&format!("{name}: {} missed or dropped", count(missing, "period")));
    }
    let steps = summary.steps;
    told(args, summary)?;
    match first {
        None => console::note("the same bits as recorded, in every step"),
        Some(time) => {
            return Err(Failure::Check(format!(
                "{name}: {differ} of {steps} steps gave other bits than recorded, the first at {time} s; \
                 records that were dropped, or another version of the program, do that"
            )));
        }
    }
    Ok(())
}

/// Whether the engine gave the recorded bits.
fn same(record: &Record, output: &Output) -> bool {
    let bits = |v: [f64; 3]| v.map(f64::to_bits);
    let e = output.energy;
    bits(output.force_n) == bits(record.force_n)
        && output.contact.map_or(Record::NONE, |c| c.element) == record.element
        && [e.work_j, e.stored_j, e.dissipated_j, e.generated_j].map(f64::to_bits)
            == [record.work_j, record.stored_j, record.dissipated_j, record.generated_j].map(f64::to_bits)
}
