//! Load paths: the tool is pressed in, and dragged, step by step.

use crate::contact::{Anchors, Friction, Resultant, ToolContact};
use crate::equilibrium::{Counts, Failure, RESIDUAL_TOLERANCE, Solver, TOOL_TOLERANCE};
use crate::load::Load;
use crate::mesh::Boundary;
use crate::model::{Fixed, Model};
use crate::near_field::NearField;
use crate::path::{Contact, FreePlan, FreePose, Path, PointPaths, PointPlan, State, Stop, StuckTangent};
use crate::tool::{Placement, RigidTool};
use glam::{DMat3, DQuat, DVec3};
use palpate_body::curve::between_rows;
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};

/// A load step that fails is halved this often.
const MAX_CUTS: u32 = 6;

/// As often before it is solved for all of the body at once.
const NEAR_FIELD_CUTS: u32 = 2;

/// Newton steps and conjugate-gradient iterations for one state, for each load step that it takes at least: beyond, one that fails is the last. Where a law
/// collapses every step fails, and slowly; states that are found at all took a third of this at most.
const MAX_NEWTON: u32 = 300;
const MAX_CG_ITERATIONS: u32 = 3000;

/// Of the tool's force: what points that were caught, let go or limited anew change by less than that is worth no solve.
const SETTLED: f64 = 1e-3;

/// The residual, in parts of the reaction, of the first solve of a step, whose grip is a guess.
const FIRST_TOLERANCE: f64 = 1e-2;

/// Residuals up to which a state is exact enough to say what has left the tool.
const RELEASE_TOLERANCE: f64 = 1e-4;

/// Load steps to one state, unless some fail.
const MAX_PIECES: f64 = 100.0;

/// Rounds of the near field for one load step, and steps of the contact alone.
const MAX_NEAR_ROUNDS: u32 = 30;
const MAX_CONTACT_STEPS: u32 = 400;

/// A factor is kept for so many rounds at least.
const LASTING: u32 = 3;

/// How often a step is solved again for that.
const MAX_ROUNDS: u32 = 20;

/// Load steps are no longer than this share of the tool's size, with friction that sticks and with Coulomb's: what comes into
/// contact within a step is caught where it would have touched, to second order in the step. On an organ, under a sphere, steps
/// half as long change forces by 0.2 % and by 0.3 %: four times as long, slipping ones were up to 10 % off where a surface slips from under
/// the tool, and ended on another branch.
const STICKING_STEP: f64 = 0.12;
const SLIPPING_STEP: f64 = 0.02;

/// A path that turns by more begins anew: the states before say nothing about what follows.
const STRAIGHT: f64 = 0.9;

impl Model {
    /// Presses and drags as planned. `None` if `cancelled` was set meanwhile.
    ///
    /// The result depends on the model, tool and plan alone, not on what runs beside.
    pub fn simulate(
        &self,
        tool: &RigidTool,
        contact: Contact,
        plan: &PointPlan,
        cancelled: &AtomicBool,
    ) -> Option<PointPaths> {
        self.simulate_counted(tool, contact, plan, cancelled).map(|(paths, _)| paths)
    }

    /// [`Model::simulate`], with what the solves took.
    pub fn simulate_counted(
        &self,
        tool: &RigidTool,
        contact: Contact,
        plan: &PointPlan,
        cancelled: &AtomicBool,
    ) -> Option<(PointPaths, Counts)> {
        let surface = self.entry(plan.point, plan.inward);
        let walker = match contact {
            Contact::Sticking | Contact::Frictionless => {
                let sticking = contact == Contact::Sticking;
                let friction = if sticking { Friction::Sticking } else { Friction::None };
                match self.touching(tool, surface, plan.inward, DQuat::IDENTITY, friction) {
                    Ok(walker) => walker,
                    Err(stop) => return Some((plan.stopped(stop), Counts::default())),
                }
            }
            Contact::Bonded { patch_radius_m } => {
                let patch = self.patch(surface, patch_radius_m);
                self.bonded(patch.iter().map(|&node| Fixed { node, axes: [true; 3] }), surface)
            }
        };
        walker.run(plan, cancelled)
    }

    /// Leads the tool along any path, with Coulomb friction. `None` if `cancelled` was set meanwhile.
    ///
    /// Each load step is solved with the friction limits of the pressures before, and again until they agree to 10⁻³ of
    /// the force; then what has slipped is caught where it is (LAW 5).
    pub fn follow(&self, tool: &RigidTool, plan: &FreePlan, cancelled: &AtomicBool) -> Option<Path> {
        self.follow_counted(tool, plan, cancelled).map(|(path, _)| path)
    }

    /// [`Model::follow`], with what the solves took.
    pub fn follow_counted(
        &self,
        tool: &RigidTool,
        plan: &FreePlan,
        cancelled: &AtomicBool,
    ) -> Option<(Path, Counts)> {
        let mut path = Path::default();
        let surface = self.entry(plan.point, plan.inward);
        // It comes from outside, in its first orientation.
        let first = plan.poses.first().map_or(DQuat::IDENTITY, |pose| pose.rotation);
        let mut walker = match self.touching(tool, surface, plan.inward, first, Friction::None) {
            Ok(walker) => walker,
            Err(stop) => {
                path.stopped = Some(stop);
                return Some((path, Counts::default()));
            }
        };
        for pose in &plan.poses {
            let depth = pose.offset.dot(plan.inward);
            let target = Target {
                pose: *pose,
                depth_m: depth,
                distance_m: (pose.offset - plan.inward * depth).length(),
            };
            walker.friction = match between_rows(&plan.friction, depth) {
                None | Some(0.0) => Friction::None,
                Some(coefficient) => Friction::Coulomb(coefficient),
            };
            let before = walker.snapshot();
            if !walker.lead(&mut path, &target, target.distance_m, cancelled)? {
                break;
            }
            if path.states.len().is_multiple_of(CHECKED) {
                let (after, trail) = (walker.snapshot(), walker.trail.clone());
                let (travelled, direction) = (walker.travelled, walker.direction);
                walker.check(&mut path, &before, &target, cancelled)?;
                walker.go_back(&after);
                (walker.trail, walker.travelled, walker.direction) = (trail, travelled, direction);
            }
        }
        Some((path, walker.solver.counts))
    }

    /// Moves `nodes` together, along the axes that they are held in, through a list of displacements (m) from rest;
    /// each is a state of the result. `None` if `cancelled` was set meanwhile.
    pub fn move_nodes(
        &self,
        nodes: &[Fixed],
        displacements: &[DVec3],
        cancelled: &AtomicBool,
    ) -> Option<(Path, Counts)> {
        let centre = nodes.iter().map(|n| self.mesh().positions[n.node as usize]).sum::<DVec3>();
        let mut walker = self.bonded(nodes.iter().copied(), centre / nodes.len().max(1) as f64);
        let mut path = Path::default();
        for &displacement in displacements {
            let target =
                Target { pose: displacement.into(), depth_m: displacement.length(), distance_m: 0.0 };
            if !walker.lead(&mut path, &target, target.depth_m, cancelled)? {
                break;
            }
        }
        Some((path, walker.solver.counts))
    }

    fn bonded(&self, nodes: impl Iterator<Item = Fixed>, tip: DVec3) -> LoadStepper<'_, '_> {
        let (solver, unknowns) = self.holding(nodes);
        LoadStepper::new(solver, Load::Held(unknowns), Placement::pressing(tip, DVec3::Z), Friction::None)
    }

    /// A tool where it first touches, coming along `inward` through `surface`, where its tip ends at most; `rotation` turns it from
    /// the orientation in which it points along `inward`.
    fn touching<'t>(
        &self,
        tool: &'t RigidTool,
        surface: DVec3,
        inward: DVec3,
        rotation: DQuat,
        friction: Friction,
    ) -> Result<LoadStepper<'_, 't>, Stop> {
        let turned = Placement::pressing(surface, inward).moved(DVec3::ZERO, rotation);
        let mut contact = ToolContact::new(self, tool, turned);
        let solver = Solver::new(self, self.held.clone());
        let (low, high) = extent(&self.rest);
        let resolution = 1e-9 * (high - low).length();
        let mut overlaps = |back: f64| {
            contact.placement.tip = surface - inward * back;
            contact.overlap(self, &solver.u) > resolution
        };
        // Around a tip in a hollow the sides touch first, and of a turned tool its side may.
        let (mut inside, mut free) = (0.0, 0.0);
        if overlaps(0.0) {
            free = 1e-3 * (high - low).length();
            while overlaps(free) {
                (inside, free) = (free, 2.0 * free);
                if free > 0.5 * (high - low).length() {
                    let why = "the tool overlaps the body at rest, however far it is drawn back".into();
                    return Err(Stop { at_m: 0.0, why });
                }
            }
            while free - inside > resolution {
                let middle = 0.5 * (inside + free);
                *(if overlaps(middle) { &mut inside } else { &mut free }) = middle;
            }
        }
        let start = Placement::pressing(surface - inward * free, inward);
        let mut walker = LoadStepper::new(solver, Load::Tool(Box::new(contact)), start, friction);
        walker.at.rotation = rotation;
        walker.place(walker.at);
        Ok(walker)
    }

    /// Where the line along `inward` through a point enters the mesh: nearest to the point, or the point itself where the
    /// line misses.
    fn entry(&self, point: DVec3, inward: DVec3) -> DVec3 {
        let mut nearest = (f64::INFINITY, point);
        for face in &self.boundary().faces {
            let [a, b, c] = [0, 1, 2].map(|i| self.mesh().positions[face[i] as usize]);
            let (ab, ac) = (b - a, c - a);
            let normal = ab.cross(ac);
            let towards = normal.dot(inward);
            if towards >= 0.0 {
                continue;
            }
            let along = normal.dot(a - point) / towards;
            let at = point + inward * along - a;
            // Area coordinates, with some slack so that lines through edges miss neither side.
            let scale = normal.length_squared();
            let (v, w) = (at.cross(ac).dot(normal) / scale, ab.cross(at).dot(normal) / scale);
            // Not another part of the body: a filled surface is off by less than a face.
            if along * along > scale.sqrt() {
                continue;
            }
            if v >= -1e-9 && w >= -1e-9 && v + w <= 1.0 + 1e-9 && along.abs() < nearest.0 {
                nearest = (along.abs(), self.on_curved(face, [v, w], point, inward, along));
            }
        }
        nearest.1
    }

    /// Where the line meets a face that may be curved, by Newton's method from where it meets the triangle of its corners: at
    /// these area coordinates of corners 1 and 2, and so far along.
    fn on_curved(&self, face: &[u32; 6], at: [f64; 2], point: DVec3, inward: DVec3, along: f64) -> DVec3 {
        let p = face.map(|n| self.mesh().positions[n as usize]);
        let size = p[0].distance(p[1]);
        let ([mut v, mut w], mut s) = (at, along);
        for _ in 0..8 {
            let l = [1.0 - v - w, v, w];
            let (mut off, mut by) = (-(point + inward * s), [DVec3::ZERO; 3]);
            for i in 0..3 {
                let j = (i + 1) % 3;
                off += p[i] * (l[i] * (2.0 * l[i] - 1.0)) + p[3 + i] * (4.0 * l[i] * l[j]);
                by[i] += p[i] * (4.0 * l[i] - 1.0) + p[3 + i] * (4.0 * l[j]);
                by[j] += p[3 + i] * (4.0 * l[i]);
            }
            if off.length() < 1e-12 * size {
                break;
            }
            let jacobian = DMat3::from_cols(by[1] - by[0], by[2] - by[0], -inward);
            let step = jacobian.inverse() * off;
            (v, w, s) = (v - step.x, w - step.y, s - step.z);
        }
        // Not farther than a curved face can be from its corners' triangle.
        if (s - along).abs() < 0.25 * size { point + inward * s } else { point + inward * along }
    }

    /// Nodes of the surface around `centre`, within a geodesic radius.
    ///
    /// The distance of two points of a smooth surface is that of the circle through both which is perpendicular to
    /// the normals: chord × (1 + (Δn·t)²/24), t along the chord (the next term is of fourth order).
    pub fn patch(&self, centre: DVec3, radius_m: f64) -> Vec<u32> {
        let boundary = self.boundary();
        let positions = &self.mesh().positions;
        let normals = node_normals(boundary, positions);
        let nearest = boundary.nodes.iter().copied().min_by(|&a, &b| {
            let distance = |n: u32| positions[n as usize].distance_squared(centre);
            distance(a).total_cmp(&distance(b))
        });
        let Some(nearest) = nearest else { return Vec::new() };
        let own = normals[&nearest];
        let inside = |node: u32| {
            let chord = positions[node as usize] - centre;
            let length = chord.length();
            let turn = (normals[&node] - own).dot(chord) / length.max(f64::MIN_POSITIVE);
            // Half a thousandth more: nodes put on the rim on purpose belong to the patch.
            length * (1.0 + turn * turn / 24.0) <= radius_m * 1.0005
        };
        let mut neighbours: HashMap<u32, Vec<u32>> = HashMap::new();
        for face in &boundary.faces {
            for &node in face {
                neighbours.entry(node).or_default().extend(face);
            }
        }
        // Only what hangs together with the centre: not the far side of a thin part.
        let (mut patch, mut queue) = (HashSet::from([nearest]), VecDeque::from([nearest]));
        while let Some(node) = queue.pop_front() {
            for &next in &neighbours[&node] {
                if !patch.contains(&next) && inside(next) {
                    patch.insert(next);
                    queue.push_back(next);
                }
            }
        }
        let mut patch: Vec<u32> = patch.into_iter().collect();
        patch.sort_unstable();
        patch
    }
}

/// Outward unit normals of the surface's nodes, weighted by area.
fn node_normals(boundary: &Boundary, positions: &[DVec3]) -> HashMap<u32, DVec3> {
    let mut normals: HashMap<u32, DVec3> = HashMap::new();
    for face in &boundary.faces {
        let [a, b, c] = [0, 1, 2].map(|i| positions[face[i] as usize]);
        for &node in face {
            *normals.entry(node).or_default() += (b - a).cross(c - a);
        }
    }
    normals.values_mut().for_each(|n| *n = n.normalize_or_zero());
    normals
}

fn extent(positions: &[DVec3]) -> (DVec3, DVec3) {
    let each = positions.iter();
    each.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
}

impl PointPlan {
    /// Paths without any state, and why.
    fn stopped(&self, stop: Stop) -> PointPaths {
        let press = Path { stopped: Some(stop), ..Path::default() };
        PointPaths { press, drags: vec![Path::default(); self.drags.len()] }
    }
}

impl From<DVec3> for FreePose {
    fn from(offset: DVec3) -> Self {
        FreePose { offset, rotation: DQuat::IDENTITY }
    }
}

impl FreePose {
    /// m.
    fn way_to(&self, other: &FreePose) -> f64 {
        self.offset.distance(other.offset) + TURN * self.rotation.angle_between(other.rotation)
    }

    fn towards(&self, other: &FreePose, share: f64) -> FreePose {
        FreePose {
            offset: self.offset.lerp(other.offset, share),
            rotation: self.rotation.slerp(other.rotation, share),
        }
    }
}

/// How a load step is tried: by the near field, then by all of the body.
#[derive(Debug, Clone, Copy)]
enum Attempt {
    NearField,
    Extrapolated,
    FromTheLast,
}

impl Attempt {
    const ALL: [Attempt; 3] = [Attempt::NearField, Attempt::Extrapolated, Attempt::FromTheLast];
}

/// A turn by one radian counts as a way of so many m.
const TURN: f64 = 1e-2;

/// Where the load goes next.
#[derive(Debug, Clone, Copy)]
struct Target {
    pose: FreePose,
    depth_m: f64,
    distance_m: f64,
}

/// Every so many states of a free path one is found again in shorter load steps.
const CHECKED: usize = 10;

/// A load on its way.
struct LoadStepper<'m, 't> {
    solver: Solver<'m>,
    load: Load<'t>,
    friction: Friction,
    start: Placement,
    /// Where the load is.
    at: FreePose,
    /// The equilibria behind, newest first: displacements by the path's length so far.
    trail: VecDeque<(f64, Vec<f64>)>,
    travelled: f64,
    /// The last step's.
    direction: DVec3,
    /// The last equilibrium's.
    resultant: Resultant,
    /// How many times as many load steps as usual.
    finer: f64,
}

/// What a drag starts from.
struct Snapshot {
    u: Vec<f64>,
    at: FreePose,
    anchors: Option<Anchors>,
    resultant: Resultant,
}

impl<'m, 't> LoadStepper<'m, 't> {
    fn new(solver: Solver<'m>, load: Load<'t>, start: Placement, friction: Friction) -> Self {
        let mut walker = LoadStepper {
            solver,
            load,
            friction,
            start,
            at: DVec3::ZERO.into(),
            trail: VecDeque::new(),
            travelled: 0.0,
            direction: DVec3::ZERO,
            resultant: Resultant::default(),
            finer: 1.0,
        };
        walker.remember();
        walker
    }

    fn run(mut self, plan: &PointPlan, cancelled: &AtomicBool) -> Option<(PointPaths, Counts)> {
        let mut paths = PointPaths::default();
        let mut pressed: Vec<Option<Snapshot>> = Vec::new();
        let mut last = None;
        for (i, &depth) in plan.depths.iter().enumerate() {
            let target = Target { pose: (plan.inward * depth).into(), depth_m: depth, distance_m: 0.0 };
            let before = self.snapshot();
            if !self.lead(&mut paths.press, &target, depth, cancelled)? {
                break;
            }
            if let (Friction::Sticking, Some(state)) = (self.friction, paths.press.states.last_mut()) {
                state.tangent = self.stuck_tangent(&mut state.indefinite).map(Box::new);
            }
            let wanted = plan.drags.iter().any(|drag| drag.from == i);
            pressed.push(wanted.then(|| self.snapshot()));
            last = Some((before, target));
        }
        if let Some((before, target)) = last {
            self.check(&mut paths.press, &before, &target, cancelled)?;
        }
        // Of a frictionless press too the drags stick, each from the press on.
        let pressed_with = self.friction;
        // Drags from the same state begin with the same factor.
        let mut shared: Option<(usize, NearField)> = None;
        for drag in &plan.drags {
            let mut path = Path::default();
            let Some(Some(snapshot)) = pressed.get(drag.from) else {
                paths.drags.push(path);
                continue;
            };
            self.restore(snapshot);
            if pressed_with == Friction::None {
                self.restick();
            }
            match &shared {
                Some((from, near)) if *from == drag.from => self.solver.near = Some(near.copy()),
                _ => {
                    let there = self.solver.prepare_near_field(&self.load)
                        && self.solver.refactor_near_field(&self.load);
                    shared = self.solver.near.as_ref().filter(|_| there).map(|near| (drag.from, near.copy()));
                }
            }
            let mut last = None;
            for &distance in &drag.distances {
                let before = self.snapshot();
                let pose = FreePose { offset: snapshot.at.offset + drag.direction * distance, ..snapshot.at };
                let target = Target { pose, depth_m: plan.depths[drag.from], distance_m: distance };
                if !self.lead(&mut path, &target, distance, cancelled)? {
                    break;
                }
                last = Some((before, target));
            }
            // One speaks for all: they are alike, and a check costs half as much as a drag.
            if let Some((before, target)) = last.filter(|_| paths.drags.is_empty()) {
                self.check(&mut path, &before, &target, cancelled)?;
            }
            paths.drags.push(path);
        }
        Some((paths, self.solver.counts))
    }

    /// Goes to the target and adds its state to `path`, or that it stopped at `at_m`; whether it got there. `None` if cancelled.
    fn lead(&mut self, path: &mut Path, target: &Target, at_m: f64, cancelled: &AtomicBool) -> Option<bool> {
        match self.go(target, cancelled) {
            Ok(state) => path.states.push(state),
            Err(Failure::Cancelled) => return None,
            Err(failure) => path.stopped = Some(Stop { at_m, why: failure.words().into() }),
        }
        Some(path.stopped.is_none())
    }

    /// Finds the last state of `path`, at `target`, again from the state before in half the load steps, and tells the path how much that
    /// changes. The load ends where that led. `None` if cancelled.
    fn check(
        &mut self,
        path: &mut Path,
        before: &Snapshot,
        target: &Target,
        cancelled: &AtomicBool,
    ) -> Option<()> {
        let Some(found) = path.states.last() else { return Some(()) };
        let (force, most) = (found.force_n, path.halved.unwrap_or(0.0));
        self.restore(before);
        self.finer = 2.0;
        let again = self.go(target, cancelled);
        self.finer = 1.0;
        match again {
            Ok(again) => {
                let least = self.solver.model.least_force_n;
                path.halved = Some(most.max(again.force_n.distance(force) / force.length().max(least)));
            }
            Err(Failure::Cancelled) => return None,
            // That it can't be found in shorter steps says nothing of it.
            Err(_) => {}
        }
        Some(())
    }

    fn snapshot(&self) -> Snapshot {
        let anchors = match &self.load {
            Load::Tool(contact) => Some(contact.anchors()),
            Load::Held(_) => None,
        };
        Snapshot { u: self.solver.u.clone(), at: self.at, anchors, resultant: self.resultant }
    }

    fn restore(&mut self, snapshot: &Snapshot) {
        self.go_back(snapshot);
        self.travelled = 0.0;
        self.trail.clear();
        self.remember();
    }

    fn go_back(&mut self, snapshot: &Snapshot) {
        self.solver.u.copy_from_slice(&snapshot.u);
        self.at = snapshot.at;
        self.resultant = snapshot.resultant;
        if let (Load::Tool(contact), Some(anchors)) = (&mut self.load, &snapshot.anchors) {
            contact.restore(anchors);
        }
        self.place(snapshot.at);
    }

    /// From now on what touches sticks.
    fn restick(&mut self) {
        if let Load::Tool(contact) = &mut self.load {
            self.friction = Friction::Sticking;
            contact.unstick();
            contact.catch(self.solver.model, &self.solver.u, None, self.friction);
        }
    }

    fn place(&mut self, at: FreePose) {
        if let Load::Tool(contact) = &mut self.load {
            contact.placement = self.start.moved(at.offset, at.rotation);
        }
    }

    fn remember(&mut self) {
        self.trail.push_front((self.travelled, self.solver.u.clone()));
        self.trail.truncate(3);
    }

    /// How many load steps the way to the target takes at least.
    fn pieces(&self, target: &Target) -> f64 {
        let Load::Tool(contact) = &self.load else { return 1.0 };
        let share = match self.friction {
            Friction::None => return self.finer,
            Friction::Sticking => STICKING_STEP,
            Friction::Coulomb(_) => SLIPPING_STEP,
        };
        let size = contact.tool().size_m(target.depth_m.max(0.0));
        (self.at.way_to(&target.pose) / (share * size) - 1e-6).ceil().clamp(1.0, MAX_PIECES) * self.finer
    }

    /// Goes to the target, in smaller steps where a whole one fails; how often, and what it may cost, is for each of them.
    fn go(&mut self, target: &Target, cancelled: &AtomicBool) -> Result<State, Failure> {
        let (from, mut done, mut cuts) = (self.at, 0.0, 0);
        let pieces = self.pieces(target);
        let (longest, limit) = (1.0 / pieces, pieces as u32);
        let mut step = longest;
        let before = self.solver.counts;
        // What was caught while there was friction is held no longer.
        if let (Load::Tool(contact), Friction::None) = (&mut self.load, self.friction) {
            contact.unstick();
        }
        while done < 1.0 {
            let next = if done + step > 1.0 - 1e-9 { 1.0 } else { done + step };
            let whole = step < 1.5 * longest / f64::from(1u32 << NEAR_FIELD_CUTS);
            match self.advance(from.towards(&target.pose, next), whole, cancelled) {
                Ok(()) => {
                    done = next;
                    step = (2.0 * step).min(longest).min(1.0 - done).max(f64::EPSILON);
                }
                Err(Failure::Cancelled) => return Err(Failure::Cancelled),
                Err(failure) => {
                    cuts += 1;
                    let spent = self.solver.counts;
                    let tired = spent.newton - before.newton > MAX_NEWTON * limit
                        || spent.cg_iterations - before.cg_iterations > MAX_CG_ITERATIONS * limit;
                    if tired
                        || cuts > 2 * MAX_CUTS * limit
                        || step < 1.5 * longest / f64::from(1u32 << MAX_CUTS)
                    {
                        return Err(failure);
                    }
                    step /= 2.0;
                }
            }
        }
        Ok(self.state(target, self.solver.counts.newton - before.newton))
    }

    /// One load step; on failure all is as before. Unless the `whole` body may be solved for, the near field has to do where there is
    /// one.
    fn advance(&mut self, to: FreePose, whole: bool, cancelled: &AtomicBool) -> Result<(), Failure> {
        let old = self.snapshot();
        let move_by = to.offset - self.at.offset;
        let way = self.at.way_to(&to);
        let turned = move_by.normalize_or_zero().dot(self.direction) < STRAIGHT;
        if turned && self.trail.len() > 1 {
            self.trail.truncate(1);
        }
        let travelled = self.travelled + way;
        let mut result = Err(Failure::Stuck);
        for attempt in Attempt::ALL {
            let guessed = match attempt {
                Attempt::NearField => self.predict(travelled, move_by, true),
                Attempt::Extrapolated => self.predict(travelled, move_by, false),
                // The extrapolation may lead astray: then once more from the last equilibrium.
                Attempt::FromTheLast if self.trail.len() > 1 => {
                    self.solver.predict_motion(&self.load, move_by);
                    true
                }
                Attempt::FromTheLast => false,
            };
            if !guessed {
                continue;
            }
            self.place(to);
            let near_field = matches!(attempt, Attempt::NearField);
            if !near_field {
                result = self.settle(&old, cancelled);
            } else if self.solver.prepare_near_field(&self.load) {
                result = self.settle_near(&old, cancelled);
            }
            if matches!(result, Ok(()) | Err(Failure::Cancelled)) {
                break;
            }
            self.go_back(&old);
            // Shorter steps by the near field cost less than one by all of the body.
            if near_field && !whole && self.solver.near.is_some() {
                break;
            }
        }
        if let Err(failure) = result {
            self.go_back(&old);
            return Err(failure);
        }
        if let Load::Tool(contact) = &mut self.load {
            self.resultant = contact.resultant(self.solver.model, &self.solver.u);
            contact.release(self.solver.model, &self.solver.u);
            contact.slip(self.solver.model, &self.solver.u);
        }
        self.at = to;
        self.travelled = travelled;
        self.direction = move_by.normalize_or_zero();
        self.remember();
        Ok(())
    }

    /// The equilibrium at the load's place, with what is caught, let go, and held no more than friction can: `old` is the last one.
    fn settle(&mut self, old: &Snapshot, cancelled: &AtomicBool) -> Result<(), Failure> {
        let friction = self.friction;
        let before = self.start.moved(old.at.offset, old.at.rotation);
        let (Load::Tool(_), true) = (&self.load, friction != Friction::None) else {
            let share = if matches!(self.load, Load::Tool(_)) { TOOL_TOLERANCE } else { RESIDUAL_TOLERANCE };
            return self.solver.equilibrate(&self.load, share, cancelled).map(|_| ());
        };
        // What touches on the way is caught as the guess has it, before the first solve.
        let mut share = FIRST_TOLERANCE;
        if let Load::Tool(contact) = &mut self.load {
            // Of the pressures the guess knows nothing: only what sticks holds already.
            let guess = if friction == Friction::Sticking { friction } else { Friction::None };
            contact.catch(self.solver.model, &self.solver.u, Some((&before, &old.u)), guess);
        }
        for _ in 0..MAX_ROUNDS {
            self.solver.equilibrate(&self.load, share, cancelled)?;
            // An inexact state lets nothing go: what came back would have lost its place on the tool.
            let changed = self.regrip(&before, &old.u, share <= RELEASE_TOLERANCE);
            if changed <= SETTLED && share <= TOOL_TOLERANCE {
                return Ok(());
            }
            share = (0.1 * changed).clamp(TOOL_TOLERANCE, FIRST_TOLERANCE);
        }
        Err(Failure::Slow)
    }

    /// The same by way of the near field, for much less; where that fails nothing is known.
    fn settle_near(&mut self, old: &Snapshot, cancelled: &AtomicBool) -> Result<(), Failure> {
        let friction = self.friction;
        let before = self.start.moved(old.at.offset, old.at.rotation);
        let last_state = Some((&before, &old.u[..]));
        if let (Load::Tool(contact), true) = (&mut self.load, friction != Friction::None) {
            let guess = if friction == Friction::Sticking { friction } else { Friction::None };
            contact.catch(self.solver.model, &self.solver.u, last_state, guess);
        }
        let (mut last, mut since_factor) = (f64::INFINITY, LASTING);
        let before_steps = self.solver.counts.contact_steps;
        for _ in 0..MAX_NEAR_ROUNDS {
            if cancelled.load(Ordering::Relaxed) {
                return Err(Failure::Cancelled);
            }
            if self.solver.counts.contact_steps - before_steps > MAX_CONTACT_STEPS {
                return Err(Failure::Slow);
            }
            // The body may have come nearer elsewhere.
            if !self.solver.prepare_near_field(&self.load) {
                return Err(Failure::Slow);
            }
            let (mut share, reaction) = self.solver.imbalance(&self.load)?;
            if share <= TOOL_TOLERANCE {
                // Only now does anything let go, as in `settle`.
                let changed =
                    if friction == Friction::None { 0.0 } else { self.regrip(&before, &old.u, true) };
                if changed <= SETTLED {
                    // Rounds with a positive definite matrix settle at a minimum only.
                    self.solver.indefinite = false;
                    return Ok(());
                }
                share = share.max(changed);
            } else if since_factor >= LASTING && self.solver.near_field_is_old(share, last, TOOL_TOLERANCE) {
                if !self.solver.refactor_near_field(&self.load) {
                    return Err(Failure::Slow);
                }
                since_factor = 0;
            }
            since_factor += 1;
            last = share;
            let LoadStepper { solver, load: Load::Tool(contact), .. } = self else {
                return Err(Failure::Slow);
            };
            let model = solver.model;
            let tolerance = reaction * (0.1 * share).clamp(0.2 * TOOL_TOLERANCE, FIRST_TOLERANCE);
            let mut regrips = 0;
            solver.near_field_round(contact, tolerance, |contact, u| {
                regrips += 1;
                let mut changed = match friction {
                    Friction::Coulomb(_) => contact.limit(model, u, friction),
                    _ => 0.0,
                };
                if friction != Friction::None && share <= FIRST_TOLERANCE {
                    changed += contact.catch(model, u, last_state, friction);
                }
                changed <= reaction * (0.3 * share).max(0.3 * SETTLED) || regrips >= MAX_ROUNDS
            })?;
        }
        Err(Failure::Slow)
    }

    /// Catches, lets go and limits as the state at hand asks for; the change of forces along the tool, in parts of its force.
    fn regrip(&mut self, before: &Placement, u_before: &[f64], release: bool) -> f64 {
        let (model, u, friction) = (self.solver.model, &self.solver.u, self.friction);
        let Load::Tool(contact) = &mut self.load else { return 0.0 };
        let force = contact.resultant(model, u).force_n.length().max(model.least_force_n);
        let mut changed = match friction {
            // Without pressure nothing is held: what comes back within the step has not lost its place.
            Friction::Coulomb(_) => contact.limit(model, u, friction),
            _ if release => contact.release(model, u),
            _ => 0.0,
        };
        changed += contact.catch(model, u, Some((before, u_before)), friction);
        changed / force
    }

    /// The stuck tangent here, with a factor of its own; `indefinite` comes true where the energy curves downwards.
    fn stuck_tangent(&mut self, indefinite: &mut bool) -> Option<StuckTangent> {
        let Load::Tool(contact) = &self.load else { return None };
        let mut forces: [Vec<f64>; 6] = std::array::from_fn(|_| vec![0.0; self.solver.u.len()]);
        let own = contact.motion(self.solver.model, &self.solver.u, &mut forces);
        let answer = self.solver.condensed(&self.load, &forces);
        let Some(answer) = answer else {
            *indefinite = true;
            return None;
        };
        let mut tangent = own;
        for (row, taken) in tangent.iter_mut().zip(answer) {
            row.iter_mut().zip(taken).for_each(|(t, a)| *t -= a);
        }
        Some(tangent)
    }

    /// A first guess: the polynomial through the last equilibria, continued. `false` if there is none by way of the near field.
    fn predict(&mut self, travelled: f64, move_by: DVec3, near: bool) -> bool {
        let contact = match &self.load {
            Load::Tool(contact) if near => Some(contact),
            _ if near => return false,
            _ => None,
        };
        if self.trail.len() < 2 {
            if !contact.is_some_and(|contact| self.solver.predict_near_field(contact, move_by)) {
                self.solver.predict_motion(&self.load, move_by);
            }
            return true;
        }
        let weights = lagrange(self.trail.iter().map(|(t, _)| *t), travelled);
        self.solver.u.fill(0.0);
        for (weight, (_, u)) in weights.iter().zip(&self.trail) {
            for (sum, u) in self.solver.u.iter_mut().zip(u) {
                *sum += weight * u;
            }
        }
        // Held unknowns go exactly where they are put.
        if let Load::Held(unknowns) = &self.load {
            let newest = &self.trail[0].1;
            for &unknown in unknowns {
                self.solver.u[unknown] = newest[unknown] + move_by[unknown % 3];
            }
        }
        if !self.solver.model.energy(&self.solver.u).is_finite() {
            self.solver.u.copy_from_slice(&self.trail[0].1);
            self.solver.predict_motion(&self.load, move_by);
        }
        true
    }

    fn state(&self, target: &Target, iterations: u32) -> State {
        let solver = &self.solver;
        let model = solver.model;
        let u = &solver.u;
        let sum = match &self.load {
            Load::Tool(_) => self.resultant,
            Load::Held(unknowns) => self.reaction(unknowns),
        };
        let displacement_m = model.boundary().nodes.iter().map(|&node| {
            let n = 3 * model.rank[node as usize] as usize;
            [u[n] as f32, u[n + 1] as f32, u[n + 2] as f32]
        });
        State {
            depth_m: target.depth_m,
            distance_m: target.distance_m,
            force_n: sum.force_n,
            torque_n_m: sum.torque_n_m,
            patch_m2: sum.patch_m2,
            pressed_n: sum.pressed_n,
            slipping: if sum.pressed_n > 0.0 { sum.slipping_n / sum.pressed_n } else { 0.0 },
            tangent: None,
            indefinite: solver.indefinite,
            displacement_m: displacement_m.collect(),
            iterations,
        }
    }

    /// Force on a held patch, its moment about the tip, and the patch's area.
    fn reaction(&self, unknowns: &[usize]) -> Resultant {
        let solver = &self.solver;
        let model = solver.model;
        let tip = self.start.tip + self.at.offset;
        let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
        for &unknown in unknowns {
            let n = unknown / 3;
            let at = model.rest[n] + DVec3::new(solver.u[3 * n], solver.u[3 * n + 1], solver.u[3 * n + 2]);
            let mut part = DVec3::ZERO;
            part[unknown % 3] = solver.gradient[unknown];
            force += part;
            torque += (at - tip).cross(part);
        }
        let held: HashSet<usize> = unknowns.iter().map(|unknown| unknown / 3).collect();
        let mut area = 0.0;
        for face in &model.boundary().faces {
            if face.iter().all(|&n| held.contains(&(model.rank[n as usize] as usize))) {
                let [a, b, c] = [0, 1, 2].map(|i| model.mesh().positions[face[i] as usize]);
                area += 0.5 * (b - a).cross(c - a).length();
            }
        }
        Resultant { force_n: force, torque_n_m: torque, patch_m2: area, ..Resultant::default() }
    }
}

/// Weights of values at `nodes` in the polynomial through them, at `t`.
fn lagrange(nodes: impl Iterator<Item = f64>, t: f64) -> Vec<f64> {
    let nodes: Vec<f64> = nodes.collect();
    let weight = |i: usize| {
        let others = nodes.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, n)| (t - n) / (nodes[i] - n)).product()
    };
    (0..nodes.len()).map(weight).collect()
}

#[cfg(test)]
mod tests;
