//! `palpate precompute`.

use super::Failure;
use crate::console;
use crate::progress::Progress;
use anyhow::anyhow;
use palpate_build::paths_file::PathsRecord;
use palpate_build::precompute::assemble::{self, Report};
use palpate_build::precompute::prepare::{inputs_of, plan, prepare};
use palpate_build::precompute::{Options, Prepared, Shard, Stopped, run};
use palpate_build::spec::Spec;
use palpate_files as files;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Simulate a body: how it answers a tool at points of its surface, by finite elements
///
/// Every test point is pressed and dragged in a simulation of its own. Finished points are kept in BODY.partial/ while
/// it runs; at the end there are BODY, and BODY.paths with all that was simulated. A run that was stopped, by Ctrl-C
/// or otherwise, goes on with --resume. Neither that, nor --jobs, nor shards change a byte of the results.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  palpate precompute liver.toml -o liver.body\n  \
                        palpate precompute liver.toml -o liver.body --resume\n  \
                        palpate precompute liver.toml -o liver-1.paths --shard 1/4\n  \
                        palpate precompute liver.toml -o liver-2.paths --shard 2/4 --merges-with liver-1.paths\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage, 130 stopped by a signal.")]
pub struct Args {
    /// Spec
    #[arg(value_name = "SPEC.toml")]
    spec: PathBuf,
    /// Body file to write; with --shard, the shard's .paths file
    #[arg(short, long, value_name = "BODY")]
    output: PathBuf,
    /// How many points are simulated at a time [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: Option<u32>,
    /// Go on with a run that was stopped
    #[arg(long)]
    resume: bool,
    /// Only the I-th of N shares of the test points, for `palpate merge`
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Do not begin unless the shard will merge with this one: same spec, files, program and kind of machine
    #[arg(long, value_name = "SHARD.paths", requires = "shard")]
    merges_with: Option<PathBuf>,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let spec = Spec::read(&args.spec)?;
    let simulation = spec.simulation(&args.spec)?;
    let record = match args.shard {
        Some(_) => args.output.clone(),
        None => beside(&args.output, ".paths"),
    };
    let mut inputs = inputs_of(&spec, &simulation);
    inputs.push(args.spec.clone());
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    files::refuse_overwrite(&[&args.output, &record][usize::from(args.shard.is_some())..], &inputs)?;
    files::check_target(&args.output)?;
    let plan = plan(&spec, &simulation, &args.spec)?;
    if let Some(other) = &args.merges_with
        && let Some(what) = PathsRecord::open(other)?.plan.difference(&plan)
    {
        let hint = "give the same spec and files, on a machine of the same kind";
        return Err(anyhow!("{}: would not merge: {what} differs; {hint}", other.display()).into());
    }
    if let (Some(_), Some(kind)) = (args.shard, &plan.machine) {
        console::note(&format!("made on {kind}: shards of machines of other kinds do not merge with it"));
    }

    static CANCELLED: AtomicBool = AtomicBool::new(false);
    console::stop_on_signals(&CANCELLED)?;
    let options = Options {
        record: record.clone(),
        partial: beside(&args.output, ".partial"),
        jobs: args.jobs.map_or_else(cores, |n| n as usize),
        resume: args.resume,
        shard: args.shard,
    };
    let progress = Progress::default();
    let ready = || {
        let prepared = prepare(&spec, &simulation, &args.spec, &CANCELLED)?;
        let Prepared { scene, points, .. } = &prepared;
        scene.notes.iter().for_each(|note| console::note(note));
        let paths: usize = points.iter().map(|p| 1 + p.plan.drags.len()).sum();
        console::note(&format!("{} test points, {paths} paths, {} at a time", points.len(), options.jobs));
        Ok(prepared)
    };
    let (whole, workspace) = match run::run(&plan, &options, ready, &progress, &CANCELLED) {
        Ok(done) => done,
        Err(Stopped::Error(e)) => return Err(e.into()),
        Err(Stopped::Cancelled { done, of }) => {
            let kept = options.partial.display();
            return Err(Failure::Interrupted(if done > 0 {
                format!("stopped: {done} of {of} points are kept in {kept}; go on with --resume")
            } else {
                "stopped before the first point was done".into()
            }));
        }
    };
    if args.shard.is_some() {
        workspace.finish(&progress)?;
        console::note(&format!(
            "{}: {} test points of {}",
            record.display(),
            whole.points.len(),
            whole.total
        ));
        if args.json {
            console::json(&serde_json::json!({ "test_points": whole.points.len(), "of": whole.total }))?;
        }
        return Ok(());
    }
    let assembled = assemble::body(&whole)?;
    assembled.body.save(&args.output)?;
    workspace.finish(&progress)?;
    tell(&args.output, &record, &assembled);
    if args.json {
        console::json(&Report::new(&whole, assembled))?;
    }
    Ok(())
}

/// What was made.
pub(super) fn tell(output: &Path, record: &Path, assembled: &assemble::Assembled) {
    let body = &assembled.body;
    console::note(&format!(
        "{}: {} nodes, {} triangles, {} test points; their paths are in {}",
        output.display(),
        body.nodes().len(),
        body.elements().len(),
        assembled.report.points.len(),
        record.display()
    ));
    if !assembled.stops.is_empty() {
        console::note(&format!("{} paths ended early: `palpate inspect` tells which", assembled.stops.len()));
    }
}

/// The path with more at its end.
pub(super) fn beside(path: &Path, more: &str) -> PathBuf {
    let mut name: OsString = path.as_os_str().to_owned();
    name.push(more);
    name.into()
}

pub(super) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
