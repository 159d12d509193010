//! A body against the spec that it was made from.

use super::{
    History, Kept, SimulatedSurface, Simulator, Trial, Validation, held_as_simulated, validate_at_places_of,
};
use crate::Progress;
use crate::precompute::Prepared;
use crate::precompute::assemble::friction;
use crate::precompute::elements::Elements;
use crate::precompute::prepare::{inputs_of, point_plan, prepare};
use crate::precompute::touched::can_be_touched;
use crate::spec::{self, Simulation, Spec};
use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::Body;
use palpate_files as files;
use palpate_simulate::{Contact, FreePlan, PointPaths, PointPlan};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Which paths are tried, and how.
#[derive(Debug, Clone)]
pub struct Against {
    /// What is simulated and rendered.
    pub history: History,
    /// How many paths.
    pub paths: usize,
    /// The same seed gives the same paths.
    pub seed: u64,
    /// Whether they begin at test points, not between them.
    pub at_test_points: bool,
    /// Whether the potential of each path's own point is found, too, which costs as much again.
    pub own: bool,
    /// States of a press to the greatest depth; the spec's steps if none.
    pub steps: Option<u32>,
    /// How many are simulated at a time.
    pub jobs: usize,
    /// A body whose places are tried, if not those of the body that is judged.
    pub places_of: Option<Body>,
    /// A file of simulated paths, which are then not simulated again, if there is to be one: see [`Kept`].
    pub kept: Option<PathBuf>,
}

impl Against {
    /// Whether the spec's contact can do what is asked.
    ///
    /// # Errors
    /// Slip is asked of a patch that is bonded to the tool.
    pub fn check(&self, simulation: &Simulation, path: &Path) -> Result<()> {
        if self.history != History::FrictionlessPress
            && let spec::Contact::Bonded { .. } = simulation.contact
        {
            bail!(
                "{}: [tool] contact: a bonded patch neither slips nor lets go; ask for the history frictionless-press",
                path.display()
            );
        }
        Ok(())
    }
}

/// Whether a body says that it was made from another spec than this.
pub fn is_of_another_spec(body: &Body, spec: &Spec) -> bool {
    body.provenance().spec.as_ref().is_some_and(|made_from| *made_from != spec.text)
}

/// Simulates random paths by the spec, whose file is `path`, and compares them with what the body answers; none if it was
/// cancelled. It tells `progress` of each path.
///
/// # Errors
/// The spec, or a file that it names, is wrong; the body doesn't belong to the spec's mesh; the contact can't do what is asked.
pub fn validate_against(
    body: &Body,
    (spec, simulation, path): (&Spec, &Simulation, &Path),
    asked: &Against,
    progress: &dyn Progress,
    cancelled: &AtomicBool,
) -> Result<Option<Validation>> {
    asked.check(simulation, path)?;
    let prepared = prepare(spec, simulation, path, cancelled);
    if cancelled.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let Prepared { solver, .. } = prepared?;
    let model = solver.model();
    let boundary = &model.boundary().nodes;
    let places_of = asked.places_of.as_ref().unwrap_or(body);
    let held = boundary.iter().map(|&n| (model.mesh().positions[n as usize], model.is_held(n)));
    let held = held_as_simulated(places_of, held);
    let trial = Trial {
        history: asked.history,
        paths: asked.paths,
        seed: asked.seed,
        at_test_points: asked.at_test_points,
        normal_max_m: simulation.deflection.normal_max_m,
        lateral_max_m: simulation.deflection.lateral_max_m,
        steps: asked.steps.unwrap_or(simulation.deflection.steps),
        drag_depths_m: simulation.drag_from.iter().map(|&i| simulation.depths_m[i]).collect(),
        friction: friction(simulation),
        touchable: can_be_touched(simulation, &places_of.parts().surface, &held)?,
    };
    let bonded = match simulation.contact {
        spec::Contact::Bonded { patch_radius_m } => Some(Contact::Bonded { patch_radius_m }),
        _ => None,
    };
    let own = asked.own.then_some(simulation);
    let simulator = Cancellable { solver: &solver, bonded, own, cancelled };
    let jobs = asked.jobs;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(jobs)
        .build()
        .map_err(|e| anyhow!("{jobs} threads can't be started ({e}); give fewer"))?;
    let inputs = inputs_of(spec, simulation);
    let kept = asked
        .kept
        .as_ref()
        .map(|file| Kept::open(&simulator, file, &spec.without_fit(), &inputs))
        .transpose()?;
    // From here on nothing goes back before `end`.
    progress.begin(trial.paths, 0);
    let source: &dyn Simulator = kept.as_ref().map_or(&simulator, |kept| kept);
    let done = || progress.done(1);
    let result = pool.install(|| validate_at_places_of(places_of, body, &trial, source, &done));
    progress.end();
    if let Some(Err(e)) = kept.map(Kept::finish) {
        progress.note(&format!("{}; its paths will be simulated again", files::message(&e)));
    }
    if cancelled.load(Ordering::Relaxed) { Ok(None) } else { result.map(Some) }
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
    /// What `simulate` finds, unless it was cancelled before.
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
