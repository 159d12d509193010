//! Load paths: the tool is pressed in, and dragged, step by step.

use crate::contact::ToolContact;
use crate::equilibrium::{Counts, Failure, Solver};
use crate::load::Load;
use crate::mesh::Boundary;
use crate::model::{Fixed, Model};
use crate::path::{Contact, Path, PointPaths, PointPlan, State, Stop};
use crate::tool::{Placement, RigidTool};
use glam::DVec3;
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::atomic::AtomicBool;

/// A load step that fails is halved this often.
const MAX_CUTS: u32 = 6;

/// Newton steps and conjugate-gradient iterations for one state: beyond, a load step that fails is the last. Where a law
/// collapses every step fails, and slowly; states that are found at all took a third of this at most.
const MAX_NEWTON: u32 = 300;
const MAX_CG_ITERATIONS: u32 = 3000;

/// Of the tool's force: less than that, let go by points that have left the tool, changes nothing worth a solve.
const LET_GO: f64 = 5e-3;

/// How often a step is solved again because points that stuck have left the tool.
const MAX_RELEASES: u32 = 4;

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
        let surface = self.entry(plan);
        let start = Placement::pressing(surface, plan.inward);
        let walker = match contact {
            Contact::Sticking | Contact::Frictionless => {
                let solver = Solver::new(self, self.held.clone());
                LoadStepper::new(solver, Load::Tool(Box::new(ToolContact::new(self, tool, start))), start.tip)
            }
            Contact::Bonded { patch_radius_m } => {
                let patch = self.patch(surface, patch_radius_m);
                self.bonded(patch.iter().map(|&node| Fixed { node, axes: [true; 3] }), surface)
            }
        };
        walker.run(plan, cancelled)
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
            let target = Target { offset: displacement, depth_m: displacement.length(), distance_m: 0.0 };
            match walker.go(&target, false, cancelled) {
                Ok(state) => path.states.push(state),
                Err(Failure::Cancelled) => return None,
                Err(failure) => {
                    path.stopped = Some(Stop { at_m: target.depth_m, why: failure.words().into() });
                    break;
                }
            }
        }
        Some((path, walker.solver.counts))
    }

    fn bonded(&self, nodes: impl Iterator<Item = Fixed>, tip: DVec3) -> LoadStepper<'_, '_> {
        let (solver, unknowns) = self.holding(nodes);
        LoadStepper::new(solver, Load::Held(unknowns), tip)
    }

    /// Where the line along `inward` through the planned point enters the mesh: nearest to the point, or the point
    /// itself where the line misses.
    fn entry(&self, plan: &PointPlan) -> DVec3 {
        let mut nearest = (f64::INFINITY, plan.point);
        for face in &self.boundary().faces {
            let [a, b, c] = [0, 1, 2].map(|i| self.mesh().positions[face[i] as usize]);
            let (ab, ac) = (b - a, c - a);
            let normal = ab.cross(ac);
            let towards = normal.dot(plan.inward);
            if towards >= 0.0 {
                continue;
            }
            let along = normal.dot(a - plan.point) / towards;
            let at = plan.point + plan.inward * along - a;
            // Area coordinates, with some slack so that lines through edges miss neither side.
            let scale = normal.length_squared();
            let (v, w) = (at.cross(ac).dot(normal) / scale, ab.cross(at).dot(normal) / scale);
            // Not another part of the body: a filled surface is off by less than a face.
            if along * along > scale.sqrt() {
                continue;
            }
            if v >= -1e-9 && w >= -1e-9 && v + w <= 1.0 + 1e-9 && along.abs() < nearest.0 {
                nearest = (along.abs(), plan.point + plan.inward * along);
            }
        }
        nearest.1
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

/// Where the load goes next.
#[derive(Debug, Clone, Copy)]
struct Target {
    /// Of the tip from its start, m.
    offset: DVec3,
    depth_m: f64,
    distance_m: f64,
}

/// A load on its way.
struct LoadStepper<'m, 't> {
    solver: Solver<'m>,
    load: Load<'t>,
    start: DVec3,
    /// Where the load is, m from its start.
    offset: DVec3,
    /// The equilibria behind, newest first: displacements by the path's length so far.
    trail: VecDeque<(f64, Vec<f64>)>,
    travelled: f64,
}

/// What a drag starts from.
struct Snapshot {
    u: Vec<f64>,
    offset: DVec3,
}

impl<'m, 't> LoadStepper<'m, 't> {
    fn new(solver: Solver<'m>, load: Load<'t>, start: DVec3) -> Self {
        let mut walker =
            LoadStepper { solver, load, start, offset: DVec3::ZERO, trail: VecDeque::new(), travelled: 0.0 };
        walker.remember();
        walker
    }

    fn run(mut self, plan: &PointPlan, cancelled: &AtomicBool) -> Option<(PointPaths, Counts)> {
        let mut paths = PointPaths::default();
        let mut pressed: Vec<Option<Snapshot>> = Vec::new();
        for (i, &depth) in plan.depths.iter().enumerate() {
            let target = Target { offset: plan.inward * depth, depth_m: depth, distance_m: 0.0 };
            match self.go(&target, false, cancelled) {
                Ok(state) => paths.press.states.push(state),
                Err(Failure::Cancelled) => return None,
                Err(failure) => {
                    paths.press.stopped = Some(Stop { at_m: depth, why: failure.words().into() });
                    break;
                }
            }
            let wanted = plan.drags.iter().any(|drag| drag.from == i);
            pressed.push(wanted.then(|| Snapshot { u: self.solver.u.clone(), offset: self.offset }));
        }
        for drag in &plan.drags {
            let mut path = Path::default();
            let Some(Some(snapshot)) = pressed.get(drag.from) else {
                paths.drags.push(path);
                continue;
            };
            self.restore(snapshot);
            self.restick();
            for &distance in &drag.distances {
                let offset = snapshot.offset + drag.direction * distance;
                let target = Target { offset, depth_m: plan.depths[drag.from], distance_m: distance };
                match self.go(&target, true, cancelled) {
                    Ok(state) => path.states.push(state),
                    Err(Failure::Cancelled) => return None,
                    Err(failure) => {
                        path.stopped = Some(Stop { at_m: distance, why: failure.words().into() });
                        break;
                    }
                }
            }
            paths.drags.push(path);
        }
        Some((paths, self.solver.counts))
    }

    fn restore(&mut self, snapshot: &Snapshot) {
        self.solver.u.copy_from_slice(&snapshot.u);
        self.offset = snapshot.offset;
        self.travelled = 0.0;
        self.trail.clear();
        self.remember();
        self.place(snapshot.offset);
    }

    /// From now on what touches sticks.
    fn restick(&mut self) {
        if let Load::Tool(contact) = &mut self.load {
            contact.unstick();
            contact.update_sticking(self.solver.model, &self.solver.u);
        }
    }

    fn place(&mut self, offset: DVec3) {
        if let Load::Tool(contact) = &mut self.load {
            contact.placement.tip = self.start + offset;
        }
    }

    fn remember(&mut self) {
        self.trail.push_front((self.travelled, self.solver.u.clone()));
        self.trail.truncate(3);
    }

    /// Goes to the target, in smaller steps where the whole one fails.
    fn go(&mut self, target: &Target, sticking: bool, cancelled: &AtomicBool) -> Result<State, Failure> {
        let (from, mut done, mut step, mut cuts) = (self.offset, 0.0, 1.0, 0);
        let before = self.solver.counts;
        while done < 1.0 {
            let next = if done + step > 1.0 - 1e-9 { 1.0 } else { done + step };
            match self.advance(from.lerp(target.offset, next), sticking, cancelled) {
                Ok(()) => {
                    done = next;
                    step = (2.0 * step).min(1.0 - done).max(f64::EPSILON);
                }
                Err(Failure::Cancelled) => return Err(Failure::Cancelled),
                Err(failure) => {
                    cuts += 1;
                    let spent = self.solver.counts;
                    let tired = spent.newton - before.newton > MAX_NEWTON
                        || spent.cg_iterations - before.cg_iterations > MAX_CG_ITERATIONS;
                    if tired || cuts > 2 * MAX_CUTS || step < 1.5 / f64::from(1u32 << MAX_CUTS) {
                        return Err(failure);
                    }
                    step /= 2.0;
                }
            }
        }
        Ok(self.state(target, self.solver.counts.newton - before.newton))
    }

    /// One load step; on failure all is as before.
    fn advance(&mut self, offset: DVec3, sticking: bool, cancelled: &AtomicBool) -> Result<(), Failure> {
        let (old_offset, old_u) = (self.offset, self.solver.u.clone());
        let old_anchors = match &self.load {
            Load::Tool(contact) => Some(contact.anchors()),
            Load::Held(_) => None,
        };
        let move_by = offset - self.offset;
        let travelled = self.travelled + move_by.length();
        self.predict(travelled, move_by);
        self.place(offset);
        let mut result = self.solver.equilibrate(&self.load, cancelled);
        if matches!(result, Err(failure) if failure != Failure::Cancelled) && self.trail.len() > 1 {
            // The extrapolation may have led astray: once more from the last equilibrium.
            self.solver.u.copy_from_slice(&old_u);
            self.place(old_offset);
            self.solver.predict_motion(&self.load, move_by);
            self.place(offset);
            result = self.solver.equilibrate(&self.load, cancelled);
        }
        if sticking && result.is_ok() {
            for _ in 0..MAX_RELEASES {
                let Load::Tool(contact) = &mut self.load else { break };
                let model = self.solver.model;
                let force = contact.resultant(model, &self.solver.u).force_n.length();
                if contact.update_sticking(model, &self.solver.u) <= LET_GO * force {
                    break;
                }
                result = self.solver.equilibrate(&self.load, cancelled);
                if result.is_err() {
                    break;
                }
            }
        }
        match result {
            Ok(_) => {
                self.offset = offset;
                self.travelled = travelled;
                self.remember();
                Ok(())
            }
            Err(failure) => {
                self.solver.u = old_u;
                if let (Load::Tool(contact), Some(anchors)) = (&mut self.load, old_anchors) {
                    contact.restore(anchors);
                }
                self.place(old_offset);
                Err(failure)
            }
        }
    }

    /// A first guess: the polynomial through the last equilibria, continued.
    fn predict(&mut self, travelled: f64, move_by: DVec3) {
        if self.trail.len() < 2 {
            self.solver.predict_motion(&self.load, move_by);
            return;
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
    }

    fn state(&self, target: &Target, iterations: u32) -> State {
        let solver = &self.solver;
        let model = solver.model;
        let u = &solver.u;
        let (force_n, torque_n_m, patch_m2) = match &self.load {
            Load::Tool(contact) => {
                let sum = contact.resultant(model, u);
                (sum.force_n, sum.torque_n_m, sum.patch_m2)
            }
            Load::Held(unknowns) => self.reaction(unknowns),
        };
        let displacement_m = model.boundary().nodes.iter().map(|&node| {
            let n = 3 * model.rank[node as usize] as usize;
            [u[n] as f32, u[n + 1] as f32, u[n + 2] as f32]
        });
        State {
            depth_m: target.depth_m,
            distance_m: target.distance_m,
            force_n,
            torque_n_m,
            patch_m2,
            displacement_m: displacement_m.collect(),
            iterations,
            ..State::default()
        }
    }

    /// Force on a held patch, its moment about the tip, and the patch's area.
    fn reaction(&self, unknowns: &[usize]) -> (DVec3, DVec3, f64) {
        let solver = &self.solver;
        let model = solver.model;
        let tip = self.start + self.offset;
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
        (force, torque, area)
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
