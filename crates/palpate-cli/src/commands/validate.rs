//! `palpate validate`.

use super::Failure;
use super::precompute::cores;
use crate::progress::Progress;
use crate::validation_charts::charts;
use crate::{console, plot};
use anyhow::anyhow;
use glam::DVec3;
use palpate_body::Body;
use palpate_build::Progress as _;
use palpate_build::precompute::Prepared;
use palpate_build::precompute::assemble::friction;
use palpate_build::precompute::elements::Elements;
use palpate_build::precompute::prepare::{inputs_of, margin, point_plan, prepare};
use palpate_build::spec::{self, Simulation, Spec};
use palpate_build::validate::{
    self, Kept, SimulatedSurface, Simulator, Trial, Validation, touchable, validate,
};
use palpate_files as files;
use palpate_simulate::{Contact, FreePlan, PointPaths, PointPlan};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// What is simulated and rendered, as options name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum History {
    /// Free paths with the body's friction: pressed at an angle, dragged past slip, back, round, let go,
    /// touched again
    Coulomb,
    /// Pressed straight in to the greatest depth, without friction on both sides
    Frictionless,
    /// Pressed and dragged while all that touches sticks: how well a coupled law holds
    Stick,
    /// Pressed without friction and dragged sticking: what bodies with curves are made of
    FrictionlessPress,
}

impl History {
    /// The same in a trial.
    fn history(self) -> validate::History {
        match self {
            History::Coulomb => validate::History::Coulomb,
            History::Frictionless => validate::History::Frictionless,
            History::Stick => validate::History::Stick,
            History::FrictionlessPress => validate::History::FrictionlessPress,
        }
    }
}

/// Say how wrong a body's forces are, on random paths that no test point has seen
///
/// Each path touches at a random point at an angle, presses, drags past slip, turns back, goes round a
/// circle, lets go and touches again. It is simulated in full, with the spec's mesh, material and tool and
/// the body's friction, and compared with what the engine renders: errors in % of the path's largest force
/// and of the force at hand, for each part of the path, and a table of where they come from. docs/validate.md
/// explains the measure.
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
    /// What is simulated and rendered
    #[arg(long, value_enum, default_value = "coulomb")]
    history: History,
    /// Begin paths at test points, not between them: the error without interpolation
    #[arg(long)]
    at_test_points: bool,
    /// Also find the potential of each path's own point, which costs as much again: what test points and
    /// interpolation take
    #[arg(long)]
    own: bool,
    /// States of a press to the greatest depth; no load step is longer [default: the spec's steps]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    steps: Option<u32>,
    /// How many are simulated at a time [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: Option<u32>,
    /// Print JSON instead of the table
    #[arg(long)]
    json: bool,
    /// Folder for the table, a picture, every state's forces, and the simulated paths: validate.md, validate.png, states.csv,
    /// simulated.jsonl. Paths that are kept there are not simulated again, whatever the body
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
    if args.history != History::FrictionlessPress
        && let spec::Contact::Bonded { .. } = simulation.contact
    {
        return Err(anyhow!(
            "{}: [tool] contact: a bonded patch neither slips nor lets go; give --history frictionless-press",
            args.spec.display()
        )
        .into());
    }
    let names = ["validate.md", "validate.png", "states.csv", "simulated.jsonl"];
    let outputs: Vec<PathBuf> =
        args.output.iter().flat_map(|folder| names.map(|name| folder.join(name))).collect();
    let simulated = inputs_of(&spec, &simulation);
    let inputs = simulated.iter().chain([&args.body, &args.spec]);
    let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
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
        history: args.history.history(),
        paths: args.paths as usize,
        seed: args.seed,
        at_test_points: args.at_test_points,
        normal_max_m: simulation.deflection.normal_max_m,
        lateral_max_m: simulation.deflection.lateral_max_m,
        steps: args.steps.unwrap_or(simulation.deflection.steps),
        drag_depths_m: simulation.drag_from.iter().map(|&i| simulation.depths_m[i]).collect(),
        friction: friction(&simulation),
        touchable: touchable(&body, held, margin(&simulation)?)?,
    };
    let bonded = match simulation.contact {
        spec::Contact::Bonded { patch_radius_m } => Some(Contact::Bonded { patch_radius_m }),
        _ => None,
    };
    let own = args.own.then_some(&simulation);
    let simulator = Cancellable { solver: &solver, bonded, own, cancelled: &CANCELLED };
    let jobs = args.jobs.map_or_else(cores, |n| n as usize);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(jobs)
        .build()
        .map_err(|e| anyhow!("{jobs} threads can't be started ({e}); give fewer --jobs"))?;
    let progress = Progress::default();
    progress.begin(trial.paths, 0);
    let kept = outputs.get(3).map(|path| Kept::open(&simulator, path, &spec.text, &simulated)).transpose()?;
    let source: &dyn Simulator = kept.as_ref().map_or(&simulator, |kept| kept);
    let result = pool.install(|| validate(&body, &trial, source, &|| progress.done(1)));
    progress.end();
    if let Some(Err(e)) = kept.map(Kept::finish) {
        console::note(&format!("{}; its paths will be simulated again", files::message(&e)));
    }
    if CANCELLED.load(Ordering::Relaxed) {
        let what = if args.output.is_some() {
            "stopped; the paths that were done are kept, the same command goes on"
        } else {
            "stopped; nothing was written"
        };
        return Err(Failure::Interrupted(what.into()));
    }
    let validation = result?;
    if let [table, picture, states, _] = &outputs[..] {
        files::replace(table, |out| Ok(out.write_all(document(&validation).as_bytes())?))?;
        plot::save(picture, &charts(&validation))?;
        files::replace(states, |out| validation.csv(out))?;
    }
    if args.json {
        console::json(&validation)?;
    } else {
        for (title, rows) in validation.tables() {
            console::text(&format!("{title}\n{}\n", console::table(&rows)))?;
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

/// The spec's model and tool, until it is told to stop.
struct Cancellable<'a> {
    solver: &'a Elements,
    /// The spec's contact, where it is that.
    bonded: Option<Contact>,
    /// Where each place's own potential is asked for.
    own: Option<&'a Simulation>,
    cancelled: &'a AtomicBool,
}

impl Cancellable<'_> {
    /// What `simulate` finds, unless a signal came before.
    fn unless_cancelled<T>(&self, simulate: impl FnOnce() -> Option<T>) -> Option<T> {
        if self.cancelled.load(Ordering::Relaxed) { None } else { simulate() }
    }
}

impl Simulator for Cancellable<'_> {
    fn press(&self, plan: &PointPlan, sticking: bool) -> Option<PointPaths> {
        let free = if sticking { Contact::Sticking } else { Contact::Frictionless };
        let contact = self.bonded.unwrap_or(free);
        let model = self.solver.model();
        self.unless_cancelled(|| model.simulate(self.solver.tool(), contact, plan, self.cancelled))
    }

    fn follow(&self, plan: &FreePlan) -> Option<palpate_simulate::Path> {
        let model = self.solver.model();
        self.unless_cancelled(|| model.follow(self.solver.tool(), plan, self.cancelled))
    }

    fn surface(&self) -> SimulatedSurface {
        let model = self.solver.model();
        let boundary = model.boundary();
        let index = |n: &u32| boundary.nodes.binary_search(n).unwrap_or_default() as u32;
        SimulatedSurface {
            positions: boundary.nodes.iter().map(|n| model.mesh().positions[*n as usize]).collect(),
            faces: boundary.faces.iter().map(|face| face.each_ref().map(index)).collect(),
        }
    }

    fn own_plan(&self, point: DVec3, inward: DVec3) -> Option<PointPlan> {
        Some(point_plan(self.own?, point, inward, true))
    }
}

fn document(v: &Validation) -> String {
    format!(
        "# {} random paths (history {}, seed {})\n\n{}\
         {} paths ended early and count as far as they went; {} have no state and count nowhere.\n",
        v.paths.len() + v.failed,
        v.history.name(),
        v.seed,
        v.markdown(),
        v.cut_short,
        v.failed
    )
}
