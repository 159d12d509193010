//! Equilibrium: the least of the energy, by Newton's method with what it costs kept small.
//!
//! Under a tool `near_field.rs` mostly gets there for less; here all of the body is solved for, come what may.
//!
//! Each Newton step is solved by conjugate gradients, preconditioned with a Cholesky factor that is kept as long as it
//! serves: at first that of the body at rest, which all paths share; when the iterations that it wasted would have
//! paid for a factorisation, that of the state at hand. A direction in which the energy curves downwards ends the
//! iterations and is followed (Steihaug 1983; Nash 1984), so that a tangent that is indefinite, as at the edge of a
//! bonded patch, needs no shift; and every step goes down in energy, so that an element is never inverted.

use crate::factor::{Factor, Indefinite, LANES};
use crate::load::Load;
use crate::model::{Fixed, Model};
use crate::near_field::NearField;
use crate::stiffness::Stiffness;
use glam::DVec3;
use std::sync::atomic::{AtomicBool, Ordering};

/// Residual forces (their 2-norm over all free unknowns) are below this share of the reaction.
pub const RESIDUAL_TOLERANCE: f64 = 1e-6;

/// The same where a tool pushes: forces change by a tenth of it, and the penalty's own error is a hundred times as large.
pub(crate) const TOOL_TOLERANCE: f64 = 1e-4;

/// Newton steps for one equilibrium; beyond, the load step is cut.
const MAX_NEWTON: u32 = 60;

/// Halvings of a Newton step.
const MAX_HALVINGS: u32 = 30;

/// Conjugate-gradient iterations that a fresh factor needs: they are not counted as wasted.
const FRESH: f64 = 4.0;

/// How well the first Newton step is solved: the extrapolated guess leaves about this share to the second.
const FIRST_FORCING: f64 = 1e-2;

/// Iterations of one solve, whatever the factor.
const MAX_CG_ITERATIONS: u32 = 200;

/// Iterations of one equilibrium's solves together; beyond, the load step is cut.
const MAX_CG_ITERATIONS_TOGETHER: u32 = 1000;

/// Full steps in a row that need not lower the energy.
const MAX_TRUSTED: u32 = 3;

/// Sufficient decrease (Armijo).
const DECREASE: f64 = 1e-4;

/// Relative rounding of an energy: differences below it say nothing.
const ROUNDING: f64 = 1e-11;

/// Why no equilibrium was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Failure {
    Cancelled,
    /// Too many steps.
    Slow,
    /// No step along the direction lowers the energy.
    Stuck,
    /// The guess itself inverts an element.
    Inverted,
}

impl Failure {
    pub fn words(self) -> &'static str {
        match self {
            Failure::Cancelled => "it was interrupted",
            Failure::Slow => {
                "no equilibrium was found with the steps allowed: the body softens or buckles here"
            }
            Failure::Stuck => "no step lowers the energy any more: the surface folds or buckles here",
            Failure::Inverted => "elements would be inverted, however small the load step",
        }
    }
}

/// The state of one path and the memory that its solves need.
pub(crate) struct Solver<'m> {
    pub model: &'m Model,
    /// Unknowns that the load or a support holds.
    pub held: Vec<bool>,
    /// Displacements, m.
    pub u: Vec<f64>,
    /// ∂(energy + load)/∂u at `u`, N.
    pub gradient: Vec<f64>,
    pub(crate) stiffness: Stiffness,
    body: Assembled,
    /// What the tool can touch, where it is worth while.
    pub(crate) near: Option<NearField>,
    /// The body's share of the gradient, N, and the displacements that it belongs to.
    pub(crate) body_forces: Vec<f64>,
    pub(crate) body_forces_at: Vec<f64>,
    own: Option<Factor>,
    /// Iterations spent beyond what a fresh factor would have taken, since the last factorisation.
    wasted: f64,
    pub counts: Counts,
    /// Whether the last equilibrium is no minimum: the energy curves downwards somewhere.
    pub indefinite: bool,
    /// Whether the last Newton step met negative curvature.
    curved: bool,
    single: Vec<f32>,
    scratch: Vec<f32>,
}

/// The body's share of what was assembled last.
#[derive(Default)]
struct Assembled {
    u: Vec<f64>,
    energy: f64,
    gradient: Vec<f64>,
}

/// What the solves took.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Newton steps.
    pub newton: u32,
    /// Conjugate-gradient iterations.
    pub cg_iterations: u32,
    /// Numerical factorisations.
    pub factorisations: u32,
    /// Assemblies of the stiffness.
    pub assemblies: u32,
    /// Of the body's forces alone.
    pub forces: u32,
    /// Newton steps of the contact alone, the body being linear.
    pub contact_steps: u32,
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Model {
    /// Of one of the mesh's nodes, along an axis.
    pub(crate) fn unknown(&self, node: u32, axis: usize) -> usize {
        3 * self.rank[node as usize] as usize + axis
    }

    /// A solver that holds further nodes, with the factor at rest that goes with them; and their unknowns, but for
    /// those that a support holds already.
    pub(crate) fn holding(&self, nodes: impl Iterator<Item = Fixed>) -> (Solver<'_>, Vec<usize>) {
        let mut held = self.held.clone();
        let mut unknowns = Vec::new();
        for fixed in nodes {
            for axis in (0..3).filter(|&axis| fixed.axes[axis]) {
                let unknown = self.unknown(fixed.node, axis);
                if !held[unknown] {
                    held[unknown] = true;
                    unknowns.push(unknown);
                }
            }
        }
        let mut solver = Solver::new(self, held);
        solver.factor_at_rest();
        (solver, unknowns)
    }
}

impl<'m> Solver<'m> {
    pub fn new(model: &'m Model, held: Vec<bool>) -> Self {
        let n = held.len();
        Solver {
            model,
            held,
            u: vec![0.0; n],
            gradient: vec![0.0; n],
            stiffness: Stiffness::default(),
            body: Assembled::default(),
            near: None,
            body_forces: vec![0.0; n],
            body_forces_at: Vec::new(),
            own: None,
            wasted: 0.0,
            counts: Counts::default(),
            indefinite: false,
            curved: false,
            single: vec![0.0; 3 * model.pattern.nodes()],
            scratch: Vec::new(),
        }
    }

    /// Factors the stiffness at rest with this path's own held unknowns: worth it where a patch is held.
    pub fn factor_at_rest(&mut self) {
        self.stiffness.blocks.clone_from(&self.model.rest_stiffness.blocks);
        self.refactor();
    }

    /// Energy, gradient and stiffness of body and load at `u`.
    pub(crate) fn assemble(&mut self, load: &Load) -> f64 {
        self.counts.assemblies += 1;
        if self.body.u == self.u {
            // Only the load is another, which is cheap.
            self.gradient.copy_from_slice(&self.body.gradient);
            self.stiffness.without_added();
        } else {
            self.body.energy = self.model.assemble(&self.u, &mut self.gradient, &mut self.stiffness);
            self.body.u.clone_from(&self.u);
            self.body.gradient.clone_from(&self.gradient);
        }
        let mut energy = self.body.energy;
        if energy.is_finite() {
            energy += load.assemble(self.model, &self.u, &mut self.gradient, &mut self.stiffness);
        }
        energy
    }

    /// Whether the stiffness has a factor: an indefinite one has none, and the old factor goes on serving.
    fn refactor(&mut self) -> bool {
        let model = self.model;
        self.counts.factorisations += 1;
        self.wasted = 0.0;
        match model.symbolic.factor(&model.pattern, &self.stiffness, &self.held) {
            Ok(factor) => {
                self.own = Some(factor);
                true
            }
            Err(Indefinite) => false,
        }
    }

    /// bᵀ K⁻¹ b of the six columns b, with K at hand; none if it is indefinite. The factor's single precision enters squared.
    pub fn condensed(&mut self, load: &Load, columns: &[Vec<f64>; 6]) -> Option<[[f64; 6]; 6]> {
        if self.prepare_near_field(load) {
            self.condensed_near(load, columns)
        } else {
            self.condensed_whole(load, columns)
        }
    }

    /// The same with a factor of all of the body.
    pub(crate) fn condensed_whole(&mut self, load: &Load, columns: &[Vec<f64>; 6]) -> Option<[[f64; 6]; 6]> {
        self.assemble(load);
        if !self.refactor() {
            return None;
        }
        let factor = self.own.as_ref()?;
        let scale = columns.each_ref().map(|b| b.iter().fold(f64::MIN_POSITIVE, |m: f64, v| m.max(v.abs())));
        let mut several = vec![[0.0f32; LANES]; self.single.len()];
        for (i, row) in several.iter_mut().enumerate().filter(|(i, _)| !self.held[*i]) {
            for ((x, b), scale) in row.iter_mut().zip(columns).zip(scale) {
                *x = (b[i] / scale) as f32;
            }
        }
        self.model.symbolic.solve_several(factor, &mut several);
        let mut solutions: [Vec<f64>; 6] = std::array::from_fn(|_| vec![0.0; self.u.len()]);
        let mut residuals = columns.clone();
        let mut product = vec![0.0; self.u.len()];
        for (c, x) in solutions.iter_mut().enumerate() {
            for (i, row) in several.iter().enumerate().filter(|(i, _)| !self.held[*i]) {
                x[i] = f64::from(row[c]) * scale[c];
            }
            self.stiffness.multiply(&self.model.pattern, x, &mut product);
            for ((r, p), held) in residuals[c].iter_mut().zip(&product).zip(&self.held) {
                *r = if *held { 0.0 } else { *r - p };
            }
        }
        Some(std::array::from_fn(|i| {
            std::array::from_fn(|j| dot(&solutions[i], &columns[j]) + dot(&residuals[i], &solutions[j]))
        }))
    }

    /// z = M⁻¹ r, zero in held unknowns.
    fn precondition(&mut self, r: &[f64], z: &mut [f64]) {
        // Scaled, lest small forces vanish in single precision.
        let scale = r.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        if scale == 0.0 {
            z.fill(0.0);
            return;
        }
        for (single, r) in self.single.iter_mut().zip(r) {
            *single = (r / scale) as f32;
        }
        let factor = self.own.as_ref().unwrap_or(&self.model.rest_factor);
        self.model.symbolic.solve(factor, &mut self.single, &mut self.scratch);
        z[self.single.len()..].fill(0.0);
        for ((z, single), held) in z.iter_mut().zip(&self.single).zip(&self.held) {
            *z = if *held { 0.0 } else { f64::from(*single) * scale };
        }
    }

    /// Free part's 2-norm.
    pub(crate) fn free_norm(&self, v: &[f64]) -> f64 {
        v.iter().zip(&self.held).filter(|(_, held)| !**held).map(|(v, _)| v * v).sum::<f64>().sqrt()
    }

    /// Solves K d = −b in the free unknowns to a residual of `tolerance` (N), or follows negative curvature.
    fn direction(&mut self, b: &[f64], tolerance: f64) -> Vec<f64> {
        let n = b.len();
        let mut r: Vec<f64> =
            b.iter().zip(&self.held).map(|(b, held)| if *held { 0.0 } else { -b }).collect();
        let (mut d, mut z, mut kp) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        self.precondition(&r, &mut z);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        let mut iterations = 0;
        self.curved = false;
        while iterations < MAX_CG_ITERATIONS {
            iterations += 1;
            self.stiffness.multiply(&self.model.pattern, &p, &mut kp);
            for (k, held) in kp.iter_mut().zip(&self.held) {
                if *held {
                    *k = 0.0;
                }
            }
            let curvature = dot(&p, &kp);
            if curvature <= 0.0 {
                self.curved = true;
                if iterations == 1 {
                    d.copy_from_slice(&p);
                }
                break;
            }
            let step = rz / curvature;
            for ((d, r), (p, kp)) in d.iter_mut().zip(&mut r).zip(p.iter().zip(&kp)) {
                *d += step * p;
                *r -= step * kp;
            }
            if dot(&r, &r).sqrt() <= tolerance {
                break;
            }
            self.precondition(&r, &mut z);
            let next = dot(&r, &z);
            // z·r of two residuals would vanish but for the single precision of the factor: the plain formula does.
            let beta = next / rz;
            rz = next;
            if !(rz > 0.0 && beta.is_finite()) {
                break;
            }
            for (p, z) in p.iter_mut().zip(&z) {
                *p = z + beta * *p;
            }
        }
        self.counts.cg_iterations += iterations;
        self.wasted += (f64::from(iterations) - FRESH).max(0.0);
        d
    }

    /// Moves the body along with a small move of its load, to first order.
    pub fn predict_motion(&mut self, load: &Load, move_by: DVec3) {
        match load {
            Load::Held(unknowns) => {
                let mut moved = vec![0.0; self.u.len()];
                for &unknown in unknowns {
                    moved[unknown] = move_by[unknown % 3];
                }
                self.predict_displacement(load, &moved);
            }
            Load::Tool(contact) => {
                let mut forces = vec![0.0; self.u.len()];
                self.assemble(load);
                contact.pull(self.model, &self.u, move_by, &mut forces);
                self.solve_predictor(&forces);
            }
        }
    }

    /// Moves held unknowns by `moved`, and the others along to first order.
    pub fn predict_displacement(&mut self, load: &Load, moved: &[f64]) {
        let mut forces = vec![0.0; self.u.len()];
        self.assemble(load);
        self.stiffness.multiply(&self.model.pattern, moved, &mut forces);
        self.solve_predictor(&forces);
        for (u, moved) in self.u.iter_mut().zip(moved) {
            *u += moved;
        }
    }

    /// Adds −K⁻¹ `forces`, about.
    fn solve_predictor(&mut self, forces: &[f64]) {
        let tolerance = FIRST_FORCING * self.free_norm(forces);
        if tolerance > 0.0 {
            let d = self.direction(forces, tolerance);
            for (u, d) in self.u.iter_mut().zip(&d) {
                *u += d;
            }
        }
    }

    /// Brings the free unknowns to equilibrium under `load`, from where they are,
    /// to a residual of `share` of the reaction.
    pub fn equilibrate(&mut self, load: &Load, share: f64, cancelled: &AtomicBool) -> Result<u32, Failure> {
        let mut energy = self.assemble(load);
        if !energy.is_finite() {
            return Err(Failure::Inverted);
        }
        let mut last_norm = None;
        let mut watch = None;
        let before = self.counts.cg_iterations;
        for iteration in 0..MAX_NEWTON {
            if cancelled.load(Ordering::Relaxed) {
                return Err(Failure::Cancelled);
            }
            let norm = self.free_norm(&self.gradient);
            let target =
                share * load.reaction(self.model, &self.u, &self.gradient).max(self.model.least_force_n);
            if norm <= target {
                // Iterates that met negative curvature may have been on their way to where there is none.
                self.indefinite = self.curved && !self.refactor();
                self.curved = self.indefinite;
                return Ok(iteration);
            }
            if self.counts.cg_iterations - before > MAX_CG_ITERATIONS_TOGETHER {
                return Err(Failure::Slow);
            }
            if self.wasted > self.model.symbolic.factor_in_solves {
                self.refactor();
            }
            self.counts.newton += 1;
            // Solved no better than the linear model is good (Eisenstat & Walker 1996, choice 2).
            let forcing = last_norm.map_or(FIRST_FORCING, |last: f64| 0.9 * (norm / last).powi(2));
            let forcing = forcing.clamp(1e-4, 0.1);
            let tolerance = (forcing * norm).max(0.5 * target);
            last_norm = Some(norm);
            let gradient = std::mem::take(&mut self.gradient);
            let d = self.direction(&gradient, tolerance);
            let slope = dot(&gradient, &d);
            self.gradient = gradient;
            if slope >= 0.0 || slope.is_nan() {
                return Err(Failure::Stuck);
            }
            energy = self.search(load, energy, slope, d, &mut watch)?;
        }
        Err(Failure::Slow)
    }

    /// Takes a step along `d`; returns the new energy, with all assembled there.
    ///
    /// The full step is nearly always right, though points that it brings into contact may raise the energy for a
    /// moment: it is taken on trust a few times (the watchdog of Chamberlain et al. 1982) before one goes back.
    fn search(
        &mut self,
        load: &Load,
        energy: f64,
        slope: f64,
        d: Vec<f64>,
        watch: &mut Option<Watch>,
    ) -> Result<f64, Failure> {
        let here = Watch { u: self.u.clone(), energy, slope, d, trusted: 0 };
        here.step(1.0, &mut self.u);
        let full = self.assemble(load);
        let end_slope = dot(&self.gradient, &here.d);
        let reference = watch.as_ref().unwrap_or(&here);
        let noise = ROUNDING * reference.energy.abs();
        let settled =
            full <= reference.energy + noise && end_slope.abs() <= (1.0 - 2.0 * DECREASE) * slope.abs();
        if full.is_finite() && (full <= reference.energy + DECREASE * reference.slope || settled) {
            *watch = None;
            return Ok(full);
        }
        let mut origin = watch.take().unwrap_or(here);
        if full.is_finite() && origin.trusted < MAX_TRUSTED {
            origin.trusted += 1;
            *watch = Some(origin);
            return Ok(full);
        }
        // Back to where the trust began, and only as far as the energy falls.
        let (energy, slope) = (origin.energy, origin.slope);
        let (mut scale, mut last) = (1.0, if origin.trusted == 0 { full } else { f64::INFINITY });
        for _ in 0..MAX_HALVINGS {
            // The parabola's least point, kept between a tenth and a half.
            let shrink = if last.is_finite() {
                (-0.5 * slope * scale / (last - energy - slope * scale)).clamp(0.1, 0.5)
            } else {
                0.5
            };
            scale *= shrink;
            origin.step(scale, &mut self.u);
            last = self.model.energy(&self.u);
            if last.is_finite() {
                last += load.energy(self.model, &self.u);
            }
            if last <= energy + DECREASE * scale * slope
                || (scale * -slope <= noise && last <= energy + noise)
            {
                return Ok(self.assemble(load));
            }
        }
        self.u = origin.u;
        Err(Failure::Stuck)
    }
}

/// A point that one may have to go back to, and the step from it.
struct Watch {
    u: Vec<f64>,
    energy: f64,
    slope: f64,
    d: Vec<f64>,
    /// Steps since then that have not lowered the energy yet.
    trusted: u32,
}

impl Watch {
    fn step(&self, scale: f64, u: &mut [f64]) {
        for ((u, start), d) in u.iter_mut().zip(&self.u).zip(&self.d) {
            *u = start + scale * d;
        }
    }
}
