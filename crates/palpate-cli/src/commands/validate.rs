//! `palpate validate`.

use super::Failure;
use super::precompute::cores;
use crate::progress::Progress;
use crate::validation_charts::charts;
use crate::{console, plot};
use palpate_body::Body;
use palpate_build::precompute::prepare::inputs_of;
use palpate_build::spec::Spec;
use palpate_build::validate::{self, Against, Validation, is_of_another_spec, validate_against};
use palpate_files as files;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

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
    /// Try the paths that this body, made from the same spec but for [test_points] and [fit], would be tried on: two bodies are then
    /// compared by the same paths
    #[arg(long, value_name = "BODY")]
    paths_of: Option<PathBuf>,
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

/// Where simulated paths are kept.
const SIMULATED: &str = "simulated.jsonl";

impl Args {
    fn against(&self) -> Result<Against, Failure> {
        Ok(Against {
            history: self.history.history(),
            paths: self.paths as usize,
            seed: self.seed,
            at_test_points: self.at_test_points,
            own: self.own,
            steps: self.steps,
            jobs: self.jobs.map_or_else(cores, |n| n as usize),
            places_of: self.paths_of.as_deref().map(Body::open).transpose()?,
            kept: self.output.as_ref().map(|folder| folder.join(SIMULATED)),
        })
    }
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let body = Body::open(&args.body)?;
    let spec = Spec::read(&args.spec)?;
    let simulation = spec.simulation(&args.spec)?;
    let against = args.against()?;
    against.check(&simulation, &args.spec)?;
    let names = ["validate.md", "validate.png", "states.csv", SIMULATED];
    let outputs: Vec<PathBuf> =
        args.output.iter().flat_map(|folder| names.map(|name| folder.join(name))).collect();
    let mut inputs = inputs_of(&spec, &simulation);
    inputs.extend([args.body.clone(), args.spec.clone()]);
    inputs.extend(args.paths_of.clone());
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    files::refuse_overwrite(&outputs, &inputs)?;
    if let Some(folder) = &args.output {
        files::make_folder(folder)?;
    }
    if is_of_another_spec(&body, &spec) {
        console::note(&format!(
            "{}: {} was made from another spec; errors include what differs",
            args.spec.display(),
            args.body.display()
        ));
    }

    static CANCELLED: AtomicBool = AtomicBool::new(false);
    console::stop_on_signals(&CANCELLED)?;
    let asked = (&spec, &simulation, args.spec.as_path());
    let Some(validation) = validate_against(&body, asked, &against, &Progress::default(), &CANCELLED)? else {
        let what = if args.output.is_some() {
            "stopped; the paths that were done are kept, and the same command goes on"
        } else {
            "stopped; nothing was written"
        };
        return Err(Failure::Interrupted(what.into()));
    };
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
    if let Some(note) = validation.steps_told() {
        console::note(&note);
    }
    if validation.cut_short + validation.failed > 0 {
        console::note(&format!(
            "{} of {} paths ended early and count as far as they went; {} have no state and count nowhere",
            validation.cut_short, args.paths, validation.failed
        ));
    }
    Ok(())
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
