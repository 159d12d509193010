//! `palpate validate`.

use super::Failure;
use super::precompute::cores;
use crate::progress::Progress;
use crate::validation_charts::charts;
use crate::{console, plot};
use anyhow::anyhow;
use palpate_body::Body;
use palpate_build::Progress as _;
use palpate_build::paths_file::TestPoint;
use palpate_build::precompute::prepare::{inputs_of, margin, prepare};
use palpate_build::precompute::{PointSolver, Prepared};
use palpate_build::spec::Spec;
use palpate_build::validate::{Measure, Trial, Validation, touchable, validate};
use palpate_files as files;
use palpate_simulate::PointPlan;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Say how wrong a body's forces are, on random paths that no test point has seen
///
/// Each path presses the tool in at a random point and drags it, sticking, in a random direction. It is simulated in
/// full, with the spec's mesh, material and tool, and compared with what the engine renders: errors in % of the path's
/// largest force, and a table of where they come from. docs/validate.md explains the measure.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  palpate validate liver.body liver.toml --paths 40 -o liver-errors\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage, 130 stopped by a signal.")]
pub struct Args {
    /// Body file
    body: PathBuf,
    /// The spec that it was made from
    #[arg(value_name = "SPEC.toml")]
    spec: PathBuf,
    /// How many paths
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    paths: u32,
    /// Which paths: the same seed gives the same
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// How many are simulated at a time [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: Option<u32>,
    /// Print JSON instead of the table
    #[arg(long)]
    json: bool,
    /// Folder for the table, a picture, and every state's forces: validate.md, validate.png, states.csv
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let body = Body::open(&args.body)?;
    let spec = Spec::read(&args.spec)?;
    let simulation = spec.simulation(&args.spec)?;
    let names = ["validate.md", "validate.png", "states.csv"];
    let outputs: Vec<PathBuf> =
        args.output.iter().flat_map(|folder| names.map(|name| folder.join(name))).collect();
    let mut inputs = inputs_of(&spec, &simulation);
    inputs.extend([args.body.clone(), args.spec.clone()]);
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    files::refuse_overwrite(&outputs, &inputs)?;
    if let Some(folder) = &args.output {
        files::make_folder(folder)?;
    }
    if body.provenance().spec.as_ref().is_some_and(|made_from| *made_from != spec.text) {
        console::note(&format!(
            "{}: {} was made from another spec; errors include what differs",
            args.spec.display(),
            args.body.display()
        ));
    }

    static CANCELLED: AtomicBool = AtomicBool::new(false);
    console::stop_on_signals(&CANCELLED)?;
    let Prepared { solver, .. } = prepare(&spec, &simulation, &args.spec, &CANCELLED)?;
    let model = solver.model();
    let boundary = &model.boundary().nodes;
    let held = boundary.iter().map(|&n| (model.mesh().positions[n as usize], model.is_held(n)));
    let trial = Trial {
        paths: args.paths as usize,
        seed: args.seed,
        normal_max_m: simulation.deflection.normal_max_m,
        lateral_max_m: simulation.deflection.lateral_max_m,
        steps: simulation.deflection.steps,
        drag_depths_m: simulation.drag_from.iter().map(|&i| simulation.depths_m[i]).collect(),
        touchable: touchable(&body, held, margin(&simulation)?)?,
    };
    let simulate = |plan: &PointPlan| {
        if CANCELLED.load(Ordering::Relaxed) {
            return None;
        }
        solver.simulate(&TestPoint { node: 0, plan: plan.clone() }, &CANCELLED)
    };
    let jobs = args.jobs.map_or_else(cores, |n| n as usize);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(jobs)
        .build()
        .map_err(|e| anyhow!("{jobs} threads can't be started ({e}); give fewer --jobs"))?;
    let progress = Progress::default();
    progress.begin(trial.paths, 0);
    let result = pool.install(|| validate(&body, &trial, &simulate, &|| progress.done(1)));
    progress.end();
    if CANCELLED.load(Ordering::Relaxed) {
        return Err(Failure::Interrupted("stopped; nothing was written".into()));
    }
    let validation = result?;
    if let [table, picture, states] = &outputs[..] {
        files::replace(table, |out| Ok(out.write_all(document(&validation).as_bytes())?))?;
        plot::save(picture, &charts(&validation))?;
        files::replace(states, |out| validation.csv(out))?;
    }
    if args.json {
        console::json(&validation)?;
    } else {
        for measure in Measure::ALL {
            console::text(&format!("{}\n{}", measure.words(), console::table(&validation.table(measure))))?;
        }
    }
    for path in validation.paths.iter().filter_map(|p| p.stopped.as_ref()).take(5) {
        console::note(&format!("a path ended early: {path}"));
    }
    if validation.cut_short + validation.failed > 0 {
        console::note(&format!(
            "{} of {} paths ended early and count as far as they went; {} have no state and count nowhere",
            validation.cut_short, trial.paths, validation.failed
        ));
    }
    Ok(())
}

fn document(v: &Validation) -> String {
    let tables = Measure::ALL.map(|m| format!("## {}\n\n{}\n", m.words(), v.markdown(m))).concat();
    format!(
        "# {} random paths (seed {})\n\n{tables}\
         {} paths ended early and count as far as they went; {} have no state and count nowhere.\n",
        v.paths.len() + v.failed,
        v.seed,
        v.cut_short,
        v.failed
    )
}
