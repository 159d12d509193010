//! Measures the error on held-out paths: random paths that no test point has seen, simulated in full, against
//! the body's answer.
//!
//! A path is any motion of the tool, with the same friction on both sides ([`History`]). The simulation's
//! force and the engine's are compared at each state, along û and at right angles to it, in size and in
//! direction, in % of the path's largest force and of the state's own. `docs/validate.md` says how to read
//! it.
//!
//! Where the error comes from shows when the same motion is rendered by a body that lacks one ingredient: see
//! [`Source`].

use crate::precompute::assemble::steps_told;
use anyhow::{Result, anyhow, bail};
use errors::{lateral_part, normal_part};
use glam::DVec3;
use palpate_body::Body;
use palpate_body::curve::between_rows;
use palpate_simulate::{FreePlan, Path as LoadPath, PointPaths, PointPlan, State};
use place::{Ground, Place};
use rayon::prelude::*;
use render::{Rendered, Variant, own_potential, variants};
use serde::Serialize;

mod against;
mod errors;
mod free;
mod kept;
mod place;
mod press;
mod render;
mod report;
mod surface;

pub use against::{Against, is_of_another_spec, validate_against};
pub use errors::{Errors, Percentiles, PhaseErrors, Sliding, Spread, median, percentile};
pub use kept::Kept;
pub use render::{held_force, sticking};
pub use report::Measure;

pub use surface::{SimulatedSurface, SurfaceError, SurfaceErrors, SurfaceTrial};

/// What is simulated and rendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum History {
    /// A free path with Coulomb friction: pressed at an angle, dragged past slip, back, round a circle, let
    /// go, touched again.
    #[default]
    Coulomb,
    /// Pressed straight in to the greatest depth, without friction on both sides.
    Frictionless,
    /// Pressed and dragged while all that touches sticks, from first touch on.
    Stick,
    /// Pressed without friction, and dragged sticking: what bodies with curves are made of.
    FrictionlessPress,
}

impl History {
    /// As files and options name it.
    pub fn name(self) -> &'static str {
        match self {
            History::Coulomb => "coulomb",
            History::Frictionless => "frictionless",
            History::Stick => "stick",
            History::FrictionlessPress => "frictionless-press",
        }
    }
}

/// What paths to try.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Which.
    pub history: History,
    /// How many.
    pub paths: usize,
    /// The same seed gives the same paths, whatever their number.
    pub seed: u64,
    /// Whether they begin at test points, not at points that no test point is near.
    pub at_test_points: bool,
    /// The greatest depth of a path, m; it is at least a tenth of that deep.
    pub normal_max_m: f64,
    /// The greatest distance of a drag, and from the point that a free path is about, m.
    pub lateral_max_m: f64,
    /// States of a press to the greatest depth; no load step of a free path is longer.
    pub steps: u32,
    /// Depths that the test points' drags began at, m.
    pub drag_depths_m: Vec<f64>,
    /// The coefficient of friction over depth, m, with which paths are simulated; none without friction.
    pub friction: Vec<(f64, f64)>,
    /// For each node of the body that places are chosen on, whether the tool can come there.
    pub touchable: Vec<bool>,
}

/// What simulates paths. The same result for the same plan, whatever runs beside; none if it was told to
/// stop.
pub trait Simulator: Sync {
    /// Presses and drags: sticking from first touch on, or dragged only.
    fn press(&self, plan: &PointPlan, sticking: bool) -> Option<PointPaths>;

    /// A free path.
    fn follow(&self, plan: &FreePlan) -> Option<LoadPath>;

    /// Presses and drags sticking for a place's own potential: with the tangents.
    fn own_paths(&self, plan: &PointPlan) -> Option<PointPaths> {
        self.press(plan, true)
    }

    /// What displacements of states are given on; nothing where it gives none.
    fn surface(&self) -> SimulatedSurface {
        SimulatedSurface::default()
    }

    /// What to press and drag for a place's own potential; none where nobody asks for it.
    fn own_plan(&self, _point: DVec3, _inward: DVec3) -> Option<PointPlan> {
        None
    }
}

/// Where an answer comes from. All but [`Source::Body`] lack an ingredient of it, or know one more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The body as it is.
    Body,
    /// With another slip rule.
    PaperSlip,
    /// With another slip rule.
    ConsistentSlip,
    /// With another slip rule.
    ExactSlip,
    /// Slip may give out more energy than was dissipated.
    WithoutTank,
    /// One contact point, which slips as a whole.
    OnePoint,
    /// Eight contact points side by side, which slip one after the other as the rings under a ball do (Mindlin).
    EightPoints,
    /// Friction multiplied by what the simulated pressures of the path hold, in parts of μ f_z.
    PressureFriction,
    /// The simulation's coefficient of friction for that of slip, which counts how far the contact wraps around the tool, and the contact
    /// point's way for the tool's.
    FlatFriction,
    /// A coupled law without the lateral force b of a straight press.
    WithoutOffset,
    /// A coupled law without its terms of third and fourth order.
    WithoutHigherTerms,
    /// A coupled law without b, third and fourth order, and with one lateral stiffness for all depths:
    /// equation (4).
    Decoupled,
    /// The lateral response is alike in all directions.
    Isotropic,
    /// The potential of the path's own point, everywhere: no interpolation, and no other test points.
    OwnPotential,
    /// Curves that the path's own press and a drag in its direction from the test points' depths give: no
    /// interpolation between test points, and none between directions.
    OwnCurves,
    /// The same with the drag from the path's depth: what is left is the form (4) itself.
    OwnCurvesAtDepth,
}

impl Source {
    /// All, in the order of the table.
    pub const ALL: [Source; 16] = [
        Source::Body,
        Source::PaperSlip,
        Source::ConsistentSlip,
        Source::ExactSlip,
        Source::WithoutTank,
        Source::OnePoint,
        Source::EightPoints,
        Source::PressureFriction,
        Source::FlatFriction,
        Source::WithoutOffset,
        Source::WithoutHigherTerms,
        Source::Decoupled,
        Source::Isotropic,
        Source::OwnPotential,
        Source::OwnCurves,
        Source::OwnCurvesAtDepth,
    ];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Source::Body => "the body",
            Source::PaperSlip => "slip rule paper",
            Source::ConsistentSlip => "slip rule consistent",
            Source::ExactSlip => "slip rule exact",
            Source::WithoutTank => "without the tank",
            Source::OnePoint => "one contact point",
            Source::EightPoints => "eight contact points side by side",
            Source::PressureFriction => "friction as the simulated pressures hold",
            Source::FlatFriction => "slip's friction as on a plane",
            Source::WithoutOffset => "law without b",
            Source::WithoutHigherTerms => "law without cubic and quartic terms",
            Source::Decoupled => "law decoupled, equation (4)",
            Source::Isotropic => "alike in all directions",
            Source::OwnPotential => "the place's own potential",
            Source::OwnCurves => "the place's own curves, dragged from the test points' depths",
            Source::OwnCurvesAtDepth => "the place's own curves, dragged from the path's depth",
        }
    }
}

/// A part of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Leg {
    /// In, the first time or again.
    Press,
    /// Laterally from the press's end.
    Drag,
    /// Back.
    Reversal,
    /// Round.
    Circle,
    /// Out.
    Release,
}

/// What a state belongs to: the leg, and of drags whether the simulated contact slips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Pressing.
    Press,
    /// Dragging, and points that carry more than half of the pressure stick.
    Stick,
    /// Dragging, and half or more slips.
    Slip,
    /// Dragging back.
    Reversal,
    /// Going round.
    Circle,
    /// Letting go.
    Release,
}

impl Phase {
    /// All, in the order of a path.
    pub const ALL: [Phase; 6] =
        [Phase::Press, Phase::Stick, Phase::Slip, Phase::Reversal, Phase::Circle, Phase::Release];

    /// As tables and files name it.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Press => "press",
            Phase::Stick => "stick",
            Phase::Slip => "slip",
            Phase::Reversal => "reversal",
            Phase::Circle => "circle",
            Phase::Release => "release",
        }
    }
}

/// Differences over the states of a path.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Difference {
    /// Largest, N.
    pub largest_n: f64,
    /// The same in % of the path's largest force.
    pub largest_percent: f64,
    /// Root of the mean square, in % of the path's largest force.
    pub rms_percent: f64,
}

impl Difference {
    fn new(differences: impl Iterator<Item = f64>, force: f64) -> Self {
        let (mut largest, mut squares, mut count) = (0.0f64, 0.0, 0.0f64);
        for d in differences {
            largest = largest.max(d);
            squares += d * d;
            count += 1.0;
        }
        let percent = |x: f64| if force > 0.0 { 100.0 * x / force } else { 0.0 };
        Difference {
            largest_n: largest,
            largest_percent: percent(largest),
            rms_percent: percent((squares / count.max(1.0)).sqrt()),
        }
    }
}

/// One source's forces along a path, and how far they are from the simulation's.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Answer {
    /// Whose.
    pub source: Source,
    /// Along û.
    pub normal: Difference,
    /// At right angles to û, as a vector.
    pub lateral: Difference,
    /// On the body, N; one for each state.
    #[serde(skip)]
    pub forces_n: Vec<DVec3>,
}

/// One state of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compared {
    /// The part of the path that it ends or lies on.
    pub leg: Leg,
    /// Of the tool from first touch, m.
    pub offset_m: DVec3,
    /// On the body, N.
    pub simulated_n: DVec3,
    /// Simulated pressures whatever their directions, N.
    pub pressed_n: f64,
    /// The share of them where the simulated contact slips.
    pub slipping: f64,
    /// Of the simulated contact, m².
    pub patch_m2: f64,
    /// μ at this depth.
    pub friction: f64,
    /// û at the rendered contact point; that of the path out of contact.
    pub inward: DVec3,
}

impl Compared {
    /// What it belongs to.
    pub fn phase(&self) -> Phase {
        match self.leg {
            Leg::Press => Phase::Press,
            Leg::Drag if self.slipping < 0.5 => Phase::Stick,
            Leg::Drag => Phase::Slip,
            Leg::Reversal => Phase::Reversal,
            Leg::Circle => Phase::Circle,
            Leg::Release => Phase::Release,
        }
    }
}

/// What came of one path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathResult {
    /// On the surface at rest, m.
    pub point_m: [f64; 3],
    /// û there.
    pub inward: [f64; 3],
    /// Unit vector of the drag.
    pub direction: [f64; 3],
    /// Of the press, as planned, m.
    pub depth_m: f64,
    /// Of the drag, as planned, m.
    pub distance_m: f64,
    /// Of the simulation, N.
    pub largest_force_n: f64,
    /// Where the simulation ended early, and why.
    pub stopped: Option<String>,
    /// By how much halving the simulation's load steps changes a force, in % of it, where that was checked.
    pub halving_percent: Option<f64>,
    /// Every source's, the body's first.
    pub sources: Vec<Answer>,
    /// State by state.
    #[serde(skip)]
    pub states: Vec<Compared>,
    /// The deformed surface at the states that touch on both sides; and a dimple's in its place.
    #[serde(skip)]
    pub surface: [Vec<SurfaceError>; 2],
}

impl Validation {
    /// What is to be said of the simulation's load steps, where they matter.
    pub fn steps_told(&self) -> Option<String> {
        steps_told(self.paths.iter().map(|p| p.halving_percent.map(|h| h / 100.0)))
    }
}

impl PathResult {
    /// One source's, if the path has it.
    pub fn answer(&self, source: Source) -> Option<&Answer> {
        self.sources.iter().find(|a| a.source == source)
    }
}

/// Over all paths, for one source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SourceSummary {
    /// Which.
    pub source: Source,
    /// Paths that have it.
    pub paths: usize,
    /// Over all their states.
    #[serde(flatten)]
    pub errors: Errors,
}

/// What `palpate validate --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Validation {
    /// What was simulated.
    pub history: History,
    /// The paths' seed.
    pub seed: u64,
    /// Whether the paths begin at test points.
    pub at_test_points: bool,
    /// The body's errors.
    pub summary: Errors,
    /// The body's errors in each phase that there is.
    pub phases: Vec<PhaseErrors>,
    /// What the simulation says of sustained sliding.
    pub sliding: Option<Sliding>,
    /// Every source's errors.
    pub sources: Vec<SourceSummary>,
    /// Of the deformed surface, where the simulator gives displacements.
    pub surface: Option<SurfaceErrors>,
    /// The same of a dimple that only fits depth and tool, where the body has displacement fields.
    pub dimple: Option<SurfaceErrors>,
    /// Paths without any state, which count nowhere.
    pub failed: usize,
    /// Paths that ended early, which count as far as they went.
    pub cut_short: usize,
    /// One for each path that was simulated.
    pub paths: Vec<PathResult>,
}

/// A path to try.
struct Tried {
    place: Place,
    direction: DVec3,
    depth: f64,
    distance: f64,
    /// The tool's offsets from first touch, m: one for each state, in the order of the plan.
    poses: Vec<(Leg, DVec3)>,
    plan: Plan,
}

/// What the simulation is asked.
enum Plan {
    Press(PointPlan),
    Free(FreePlan),
}

/// What the simulation gave.
enum Simulated {
    Press(PointPaths),
    Free(LoadPath),
}

impl Simulated {
    /// The most of its paths'.
    fn halved(&self) -> Option<f64> {
        match self {
            Simulated::Free(path) => path.halved,
            Simulated::Press(paths) => {
                std::iter::once(&paths.press).chain(&paths.drags).filter_map(|p| p.halved).reduce(f64::max)
            }
        }
    }
}

impl Tried {
    fn new(trial: &Trial, ground: &Ground, path: usize) -> Self {
        match trial.history {
            History::Coulomb => free::coulomb(trial, ground, path),
            History::Frictionless => free::frictionless(trial, ground, path),
            History::Stick | History::FrictionlessPress => press::press_and_drag(trial, ground, path),
        }
    }

    fn simulate(&self, trial: &Trial, simulator: &dyn Simulator) -> Option<Simulated> {
        Some(match &self.plan {
            Plan::Press(plan) => Simulated::Press(simulator.press(plan, trial.history == History::Stick)?),
            Plan::Free(plan) => Simulated::Free(simulator.follow(plan)?),
        })
    }

    /// The states at the path's poses as far as it went, and why it ended early.
    fn states<'s>(&self, simulated: &'s Simulated) -> (Vec<&'s State>, Option<String>) {
        match simulated {
            Simulated::Press(paths) => press::own_states(self, paths),
            Simulated::Free(path) => {
                let next = self.poses.get(path.states.len());
                let stopped = path.stopped.as_ref().zip(next).map(|(stop, (leg, offset))| {
                    let depth = offset.dot(self.place.inward);
                    let [depth, aside] =
                        [depth, (*offset - self.place.inward * depth).length()].map(|x| x * 1e3);
                    format!("the {} {depth:.3} mm deep, {aside:.3} mm off: {}", leg.name(), stop.why)
                });
                (path.states.iter().collect(), stopped)
            }
        }
    }

    fn friction(&self, depth: f64) -> f64 {
        match &self.plan {
            Plan::Press(_) => 0.0,
            Plan::Free(plan) => between_rows(&plan.friction, depth).unwrap_or(0.0),
        }
    }
}

impl Leg {
    /// In words.
    fn name(self) -> &'static str {
        match self {
            Leg::Press => "press",
            Leg::Drag => "drag",
            Leg::Reversal => "way back",
            Leg::Circle => "circle",
            Leg::Release => "release",
        }
    }
}

/// For each node of the body whether it is held: whether the nearest of the simulated surface's nodes, given as (position, held), is.
fn held_as_simulated(body: &Body, surface: impl Iterator<Item = (DVec3, bool)>) -> Vec<bool> {
    let mut nodes: Vec<(DVec3, bool)> = surface.collect();
    nodes.sort_by(|a, b| a.0.x.total_cmp(&b.0.x));
    let is_held = |p: DVec3| {
        let mut best = (f64::INFINITY, false);
        // Outwards along x, until x alone is farther than the nearest so far.
        let mut visit = |&(q, held): &(DVec3, bool)| {
            let distance = p.distance_squared(q);
            if distance < best.0 {
                best = (distance, held);
            }
            (q.x - p.x) * (q.x - p.x) <= best.0
        };
        let (below, above) = nodes.split_at(nodes.partition_point(|n| n.0.x < p.x));
        let _ = above.iter().all(&mut visit);
        let _ = below.iter().rev().all(&mut visit);
        best.1
    };
    body.nodes().iter().map(|n| is_held(n.position)).collect()
}

/// Tries paths on `body`; `progress` hears of each path that is done. Paths run beside each other on the
/// threads of rayon's present pool, and the result does not depend on their number.
///
/// # Errors
/// The trial does not fit the body, no path gave a state, or it was stopped.
pub fn validate(
    body: &Body,
    trial: &Trial,
    simulator: &dyn Simulator,
    progress: &(dyn Fn() + Sync),
) -> Result<Validation> {
    validate_at_places_of(body, body, trial, simulator, progress)
}

/// The same at places that are chosen on `other`, a body of the same surface, to which the trial belongs: two bodies are so tried on the same
/// paths.
///
/// # Errors
/// The same.
pub fn validate_at_places_of(
    other: &Body,
    body: &Body,
    trial: &Trial,
    simulator: &dyn Simulator,
    progress: &(dyn Fn() + Sync),
) -> Result<Validation> {
    if trial.paths == 0 || trial.steps == 0 {
        bail!("there is no path to try; give --paths 1 or more, and --steps 1 or more");
    }
    let ground = Ground::new(other, &trial.touchable, trial.at_test_points)?.of(body);
    let variants = variants(body, trial)?;
    let boundary = simulator.surface();
    let plain = body.clone().with_displacement_fields(None)?;
    let dimple = match body.displacement_fields()? {
        Some(_) => SurfaceTrial::new(&plain, &boundary)?,
        None => None,
    };
    let surfaces = [SurfaceTrial::new(body, &boundary)?, dimple];
    let results: Option<Vec<Option<PathResult>>> = (0..trial.paths)
        .into_par_iter()
        .map(|path| {
            let tried = Tried::new(trial, &ground, path);
            let simulated = tried.simulate(trial, simulator)?;
            let mut further = Vec::new();
            if let Some(plan) = simulator.own_plan(tried.place.point, tried.place.inward) {
                let paths = simulator.own_paths(&plan)?;
                further.extend(own_potential(body, trial, &tried.place, &plan, &paths, &variants));
            }
            let variants = variants.iter().chain(&further);
            let result = compare(body, trial.history, &tried, &simulated, &surfaces, variants);
            progress();
            Some(result)
        })
        .collect();
    let results = results.ok_or_else(|| anyhow!("stopped before all paths were simulated"))?;
    let paths: Vec<PathResult> = results.into_iter().flatten().collect();
    if paths.is_empty() {
        bail!("the simulation found no state on any path; look at the mesh and the material");
    }
    let errors = |source: Source, chosen: &dyn Fn(&Compared) -> bool| {
        let answers = paths.iter().filter_map(|p| Some((p, p.answer(source)?)));
        (answers.clone().count(), Errors::new(answers, chosen))
    };
    let sources = Source::ALL.into_iter().map(|source| {
        let (paths, errors) = errors(source, &|_| true);
        SourceSummary { source, paths, errors }
    });
    let phases = Phase::ALL.into_iter().map(|phase| {
        let (_, errors) = errors(Source::Body, &|s| s.phase() == phase);
        PhaseErrors { phase, errors }
    });
    let surface = |which: usize| {
        let states: Vec<SurfaceError> = paths.iter().flat_map(|p| p.surface[which].iter().copied()).collect();
        SurfaceErrors::new(&states)
    };
    Ok(Validation {
        surface: surface(0),
        dimple: surface(1),
        history: trial.history,
        seed: trial.seed,
        at_test_points: trial.at_test_points,
        summary: errors(Source::Body, &|_| true).1,
        phases: phases.filter(|p| p.errors.states > 0).collect(),
        sliding: Sliding::new(paths.iter().filter_map(|p| Some((p, p.answer(Source::Body)?)))),
        sources: sources.filter(|s| s.paths > 0).collect(),
        failed: trial.paths - paths.len(),
        cut_short: paths.iter().filter(|p| p.stopped.is_some()).count(),
        paths,
    })
}

/// None if the simulation felt nothing.
fn compare<'v>(
    body: &Body,
    history: History,
    tried: &Tried,
    simulated: &Simulated,
    surfaces: &[Option<SurfaceTrial<'_>>; 2],
    variants: impl Iterator<Item = &'v Variant> + Clone,
) -> Option<PathResult> {
    let (found, stopped) = tried.states(simulated);
    let force = found.iter().map(|s| s.force_n.length()).fold(0.0, f64::max);
    if force == 0.0 {
        return None;
    }
    let (start, u) = (place::first_touch(body, &tried.place), tried.place.inward);
    let poses = &tried.poses[..found.len().min(tried.poses.len())];
    let offsets: Vec<DVec3> = poses.iter().map(|p| p.1).collect();
    let mut rendered: Vec<(Source, Vec<DVec3>)> = Vec::new();
    // What sticks is held.
    let held = match simulated {
        Simulated::Press(_) if history == History::Stick => Some(tried.place.at),
        _ => None,
    };
    let (mut normals, mut touched) = (Vec::new(), Vec::new());
    for variant in variants.clone() {
        let Rendered { forces, normals: there, contacts } = variant.forces(start, u, &offsets, held);
        if variant.source == Source::Body {
            (normals, touched) = (there, contacts);
        }
        rendered.push((variant.source, forces));
    }
    let surface = surfaces.each_ref().map(|trial| {
        let states = touched.iter().zip(&offsets).zip(&found).filter(|(_, s)| s.force_n != DVec3::ZERO);
        let states =
            states.map(|((at, offset), s)| (*at, start + *offset, offset.dot(u), &s.displacement_m[..]));
        trial.as_ref().map_or(Vec::new(), |trial| trial.compare(states))
    });
    match (simulated, &tried.plan) {
        (Simulated::Press(paths), Plan::Press(plan)) if plan.drags.len() > 1 => {
            let which = [(Source::OwnCurves, 1..plan.drags.len()), (Source::OwnCurvesAtDepth, 0..1)];
            for (source, drags) in which {
                let Some(fit) = press::own_curves(tried, plan, paths, drags) else { continue };
                let forces = offsets.iter().map(|o| press::curves_force(tried, &fit, *o));
                rendered.extend(forces.collect::<Option<_>>().map(|forces| (source, forces)));
            }
        }
        (_, Plan::Free(plan)) if !plan.friction.is_empty() => {
            let source = Source::PressureFriction;
            let variant = variants.clone().next().zip(pressures_hold(&found, u));
            let variant = variant.map(|(v, scale)| v.with_friction(source, scale));
            rendered.extend(variant.map(|v| (source, v.forces(start, u, &offsets, held).forces)));
        }
        _ => {}
    }
    let states = poses.iter().zip(&found).zip(normals).map(|((&(leg, offset_m), state), inward)| Compared {
        leg,
        offset_m,
        simulated_n: state.force_n,
        pressed_n: state.pressed_n,
        slipping: state.slipping,
        patch_m2: state.patch_m2,
        friction: tried.friction(offset_m.dot(u)),
        inward,
    });
    let states: Vec<Compared> = states.collect();
    let sources = rendered.into_iter().map(|(source, forces_n)| {
        let off = || states.iter().zip(&forces_n).map(|(s, f)| *f - s.simulated_n);
        Answer {
            source,
            normal: Difference::new(off().map(|d| normal_part(d, u)), force),
            lateral: Difference::new(off().map(|d| lateral_part(d, u)), force),
            forces_n,
        }
    });
    Some(PathResult {
        point_m: tried.place.point.to_array(),
        inward: u.to_array(),
        direction: tried.direction.to_array(),
        depth_m: tried.depth,
        distance_m: tried.distance,
        largest_force_n: force,
        stopped,
        halving_percent: simulated.halved().map(|h| 100.0 * h),
        sources: sources.collect(),
        states,
        surface,
    })
}

/// What the pressures of slipping states hold, in parts of μ f_z: the median, if any slips.
fn pressures_hold(states: &[&State], u: DVec3) -> Option<f64> {
    let slipping = states.iter().filter(|s| s.slipping > 0.5 && s.force_n.dot(u) > 0.0);
    let mut ratios: Vec<f64> = slipping.map(|s| s.pressed_n / s.force_n.dot(u)).collect();
    ratios.sort_by(f64::total_cmp);
    (!ratios.is_empty()).then(|| median(&ratios))
}
