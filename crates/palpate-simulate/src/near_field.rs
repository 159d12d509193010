//! The near field: the nodes that the tool can touch, with the rest of the body condensed onto them.
//!
//! Contact is what is not linear in a load step; the body's stiffness hardly changes. So the nodes of the surface near the tool
//! are eliminated last, and the corner that they have in the factor says what the body, linear about the state at hand, answers
//! their displacements with (Schur's complement). On these few unknowns contact and lift-off are solved for by Newton's method as
//! they are, for little; one substitution then moves the rest of the body along. What the body's own
//! nonlinearity leaves out of balance is the load of the next round (modified Newton: Zienkiewicz & Taylor).

use crate::contact::{Tangent, ToolContact};
use crate::equilibrium::{Failure, Solver, dot};
use crate::factor::{Factor, Indefinite, Symbolic};
use crate::load::Load;
use crate::model::Model;
use crate::stiffness::{Pattern, Stiffness};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, Mat, MatMut, Par};
use glam::{DMat3, DVec3};
use std::rc::Rc;

/// Nodes of a near field at most: beyond, dense matrices cost more than they save.
const MAX_NODES: usize = 350;

/// How far from the tool, in parts of its own radius, a face may be that joins a new near field: the first that few enough nodes
/// belong to. One as near as [`TOUCHABLE`] must be in it.
const REACHES: [f64; 3] = [3.0, 2.0, 1.2];
const TOUCHABLE: f64 = 1.0;

/// What a round costs, in solves with the factor; and how many a load step takes while the factor is young.
const ROUND_IN_SOLVES: f64 = 3.0;
const YOUNG_ROUNDS: f64 = 3.0;

/// Newton steps of one balance of the near field.
const MAX_STEPS: u32 = 40;

/// Halvings of one of them.
const MAX_HALVINGS: u32 = 12;

/// Sufficient decrease (Armijo).
const DECREASE: f64 = 1e-4;

/// Where these steps find no balance the penalties are multiplied with these, one after the other. Under skin thousands of times as stiff as the
/// fat below, a penalty is so much harder than what gives way there that points flip between stick and slip for ever.
const PENALTY_SCALES: [f64; 5] = [1e-4, 1e-3, 0.01, 0.1, 1.0];

/// The index of a node that is not in it.
const OUTSIDE: u32 = u32::MAX;

/// The nodes that the tool can touch, and what the body answers them with.
pub(crate) struct NearField {
    /// Inner numbers, ascending.
    nodes: Vec<u32>,
    /// By inner number: which of `nodes` it is.
    index: Vec<u32>,
    /// For each unknown (3 × index + component).
    held: Vec<bool>,
    pub symbolic: Rc<Symbolic>,
    pub factor: Factor,
    /// The body's stiffness, condensed; symmetric, N/m.
    body: Mat<f64>,
    /// With the contact's; then its Cholesky factor.
    tangent: Mat<f64>,
    memory: MemBuffer,
    /// In the factor's order, between condensing and expanding.
    x: Vec<f32>,
    scale: f64,
    scratch: Vec<f32>,
}

impl NearField {
    fn new(pattern: &Pattern, mut nodes: Vec<u32>, held: &[bool]) -> Self {
        nodes.retain(|&node| (node as usize) < pattern.nodes());
        let mut index = vec![OUTSIDE; held.len() / 3];
        for (i, &node) in nodes.iter().enumerate() {
            index[node as usize] = i as u32;
        }
        let m = 3 * nodes.len();
        let unknowns = nodes.iter().flat_map(|&node| (0..3).map(move |axis| 3 * node as usize + axis));
        NearField {
            held: unknowns.map(|unknown| held[unknown]).collect(),
            symbolic: Rc::new(Symbolic::with_last(pattern, &nodes)),
            factor: Factor::default(),
            body: Mat::zeros(m, m),
            tangent: Mat::zeros(m, m),
            memory: memory(m),
            x: vec![0.0; 3 * pattern.nodes()],
            scale: 1.0,
            scratch: Vec::new(),
            nodes,
            index,
        }
    }

    /// The same with room of its own to work in.
    pub fn copy(&self) -> Self {
        let m = self.held.len();
        NearField {
            nodes: self.nodes.clone(),
            index: self.index.clone(),
            held: self.held.clone(),
            symbolic: self.symbolic.clone(),
            factor: self.factor.clone(),
            body: self.body.clone(),
            tangent: Mat::zeros(m, m),
            memory: memory(m),
            x: self.x.clone(),
            scale: self.scale,
            scratch: Vec::new(),
        }
    }

    /// Whether all of these that are free are in it.
    fn covers(&self, nodes: &[u32]) -> bool {
        let free = |node: &&u32| 3 * **node as usize + 2 < self.x.len();
        nodes.iter().filter(free).all(|&node| self.index[node as usize] != OUTSIDE)
    }

    /// Factors a stiffness that holds the contact's part, as far as it is convex, already.
    fn refactor(
        &mut self,
        model: &Model,
        contact: &ToolContact,
        u: &[f64],
        stiffness: &Stiffness,
        held: &[bool],
    ) -> Result<(), Indefinite> {
        self.factor = self.symbolic.factor(&model.pattern, stiffness, held)?;
        let m = self.held.len();
        let mut lower = Mat::<f64>::zeros(m, m);
        self.symbolic.each_last(&self.factor, |row, column, value| lower[(row, column)] = f64::from(value));
        matmul(
            self.body.as_mut(),
            BlockStructure::TriangularLower,
            Accum::Replace,
            lower.as_ref(),
            BlockStructure::TriangularLower,
            lower.transpose(),
            BlockStructure::TriangularUpper,
            1.0,
            Par::Seq,
        );
        // The contact's share goes: it changes from step to step.
        let (index, held, body) = (&self.index, &self.held, &mut self.body);
        contact.assemble_into(
            model,
            u,
            Tangent::Convex,
            |_, _| (),
            |i, j, block| add_block(body.as_mut(), index, held, i, j, &-*block),
        );
        for column in 0..m {
            for row in 0..column {
                self.body[(row, column)] = self.body[(column, row)];
            }
        }
        Ok(())
    }

    /// What the load `b` (N) on all nodes comes to on those of the near field.
    fn condense(&mut self, b: &[f64], held: &[bool]) -> Vec<f64> {
        let split = self.symbolic.split();
        // Scaled, lest small forces vanish in single precision.
        let of = |place: usize| {
            let unknown = self.symbolic.unknown(place);
            if held[unknown] { 0.0 } else { b[unknown] }
        };
        let scale = (0..split).fold(0.0, |m: f64, place| m.max(of(place).abs()));
        let scale = if scale > 0.0 { scale } else { 1.0 };
        for place in 0..split {
            self.x[place] = (of(place) / scale) as f32;
        }
        self.x[split..].fill(0.0);
        self.scale = scale;
        let own: Vec<f64> = (split..self.x.len()).map(of).collect();
        self.symbolic.condense(&self.factor, &mut self.x, &mut self.scratch);
        own.iter().zip(&self.x[split..]).map(|(own, more)| own + scale * f64::from(*more)).collect()
    }

    /// The displacements of all nodes that go with those of the near field, after [`NearField::condense`]; added to `u`.
    fn expand(&mut self, near: &[f64], held: &[bool], u: &mut [f64]) {
        let split = self.symbolic.split();
        for (x, near) in self.x[split..].iter_mut().zip(near) {
            *x = (near / self.scale) as f32;
        }
        self.symbolic.expand(&self.factor, &mut self.x, &mut self.scratch);
        for place in 0..split {
            let unknown = self.symbolic.unknown(place);
            if !held[unknown] {
                u[unknown] += self.scale * f64::from(self.x[place]);
            }
        }
    }

    /// Energy and forces (N, ∂energy/∂u) of the contact; its stiffness, with the body's, is in `tangent`.
    fn contact(
        &mut self,
        model: &Model,
        contact: &ToolContact,
        u: &[f64],
        kind: Tangent,
        gradient: &mut [f64],
    ) -> f64 {
        self.tangent.copy_from(&self.body);
        gradient.fill(0.0);
        let (index, held, tangent) = (&self.index, &self.held, &mut self.tangent);
        contact.assemble_into(
            model,
            u,
            kind,
            |node, force| {
                let i = index[node as usize];
                if i != OUTSIDE {
                    for (g, f) in gradient[3 * i as usize..].iter_mut().zip(force.to_array()) {
                        *g -= f;
                    }
                }
            },
            |i, j, block| add_block(tangent.as_mut(), index, held, i, j, block),
        )
    }

    /// Factors body and contact as [`NearField::contact`] left them; whether they are positive definite.
    fn factor_tangent(&mut self) -> bool {
        let stack = MemStack::new(&mut self.memory);
        let (tangent, regularization) = (self.tangent.as_mut(), LltRegularization::default());
        cholesky_in_place(tangent, regularization, Par::Seq, stack, Default::default()).is_ok()
    }

    /// Solves with what [`NearField::factor_tangent`] made.
    fn solve(&self, r: &[f64]) -> Vec<f64> {
        let mut x = Mat::from_fn(r.len(), 1, |i, _| r[i]);
        solve_lower_triangular_in_place(self.tangent.as_ref(), x.as_mut(), Par::Seq);
        solve_upper_triangular_in_place(self.tangent.transpose(), x.as_mut(), Par::Seq);
        (0..r.len()).map(|i| x[(i, 0)]).collect()
    }

    /// y = body's stiffness × x.
    fn multiply(&self, x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for (j, &x) in x.iter().enumerate() {
            for (y, k) in y.iter_mut().zip(self.body.col_as_slice(j)) {
                *y += k * x;
            }
        }
    }
}

/// To factor m × m.
fn memory(m: usize) -> MemBuffer {
    MemBuffer::new(cholesky_in_place_scratch::<f64>(m, Par::Seq, Default::default()))
}

fn add_block(mut matrix: MatMut<f64>, index: &[u32], held: &[bool], i: u32, j: u32, block: &DMat3) {
    let (i, j) = (index[i as usize], index[j as usize]);
    if i == OUTSIDE || j == OUTSIDE {
        return;
    }
    // Symmetric: rows and columns are the same.
    let (row, column) = (3 * i.max(j) as usize, 3 * i.min(j) as usize);
    for c in 0..3 {
        for r in 0..3 {
            if !held[row + r] && !held[column + c] {
                matrix[(row + r, column + c)] += block.col(c)[r];
            }
        }
    }
}

impl Solver<'_> {
    /// Sees to it that all that the tool can touch is in the near field, which has a factor. `false` if it can't be: nothing is
    /// near, too much is, or the stiffness has no factor.
    pub fn prepare_near_field(&mut self, load: &Load) -> bool {
        let Load::Tool(contact) = load else { return false };
        let touchable = contact.nodes_within(self.model, &self.u, TOUCHABLE);
        if touchable.is_empty() {
            return false;
        }
        if self.near.as_ref().is_some_and(|near| near.covers(&touchable)) {
            return true;
        }
        let mut chosen = REACHES.iter().map(|reach| contact.nodes_within(self.model, &self.u, *reach));
        let nodes = chosen.find(|nodes| nodes.len() <= MAX_NODES);
        // None where too much is near: shorter steps would not help, and who calls sees it by that.
        self.near = nodes.map(|nodes| NearField::new(&self.model.pattern, nodes, &self.held));
        self.refactor_near_field(load)
    }

    /// Whether a new factor would pay for itself, where a round has taken the residual from `last` to `share` and has to get to
    /// `target`. Costs are counted from the pattern, not read from a clock.
    pub fn near_field_is_old(&self, share: f64, last: f64, target: f64) -> bool {
        let Some(near) = &self.near else { return false };
        let rate = libm::log(last / share);
        let rounds = libm::log(share / target) / rate;
        rate <= 0.0 || rounds > YOUNG_ROUNDS + near.symbolic.factor_in_solves / ROUND_IN_SOLVES
    }

    /// Factors the stiffness at hand.
    pub fn refactor_near_field(&mut self, load: &Load) -> bool {
        let (Load::Tool(contact), Some(mut near)) = (load, self.near.take()) else { return false };
        if !self.assemble(load).is_finite() {
            return false;
        }
        let (model, u) = (self.model, &self.u);
        self.stiffness.without_added();
        let stiffness = &mut self.stiffness;
        contact.assemble_into(
            model,
            u,
            Tangent::Convex,
            |_, _| (),
            |i, j, block| stiffness.add_block(&model.pattern, i, j, &block.to_cols_array()),
        );
        self.counts.factorisations += 1;
        // One without a factor is of no use any more.
        if near.refactor(self.model, contact, &self.u, &self.stiffness, &self.held).is_ok() {
            self.near = Some(near);
        }
        self.near.is_some()
    }

    /// Residual force, in parts of the reaction; and the reaction, N.
    pub fn imbalance(&mut self, load: &Load) -> Result<(f64, f64), Failure> {
        let Load::Tool(contact) = load else { return Err(Failure::Stuck) };
        if self.body_forces_at != self.u {
            self.counts.forces += 1;
            if !self.model.forces(&self.u, &mut self.body_forces) {
                return Err(Failure::Inverted);
            }
            self.body_forces_at.clone_from(&self.u);
        }
        self.gradient.copy_from_slice(&self.body_forces);
        let gradient = &mut self.gradient;
        let mut sum = DVec3::ZERO;
        contact.assemble_into(
            self.model,
            &self.u,
            Tangent::Convex,
            |node, force| {
                sum += force;
                for (g, f) in gradient[3 * node as usize..].iter_mut().zip(force.to_array()) {
                    *g -= f;
                }
            },
            |_, _, _| (),
        );
        let reaction = sum.length().max(self.model.least_force_n);
        Ok((self.free_norm(&self.gradient) / reaction, reaction))
    }

    /// Moves the body along with a small move of its tool, to first order: the contact is still where it was.
    pub fn predict_near_field(&mut self, contact: &ToolContact, move_by: DVec3) -> bool {
        let Some(mut near) = self.near.take() else { return false };
        let mut pull = vec![0.0; self.u.len()];
        contact.pull(self.model, &self.u, move_by, &mut pull);
        pull.iter_mut().for_each(|f| *f = -*f);
        let load = near.condense(&pull, &self.held);
        let mut gradient = vec![0.0; load.len()];
        near.contact(self.model, contact, &self.u, Tangent::Full, &mut gradient);
        let definite = near.factor_tangent();
        if definite {
            let moved = near.solve(&load);
            let start = self.near_displacements(&near);
            self.put_near(&near, &start, &moved);
            near.expand(&moved, &self.held, &mut self.u);
        }
        self.near = Some(near);
        definite
    }

    /// bᵀ K⁻¹ b of the six columns b, which load the near field only, with K at hand: `None` if it is indefinite. The factor's
    /// single precision enters squared.
    pub fn condensed_near(&mut self, load: &Load, columns: &[Vec<f64>; 6]) -> Option<[[f64; 6]; 6]> {
        if !self.refactor_near_field(load) {
            return None;
        }
        let (Load::Tool(contact), Some(mut near)) = (load, self.near.take()) else { return None };
        // The whole stiffness again, for the residuals.
        self.assemble(load);
        let mut gradient = vec![0.0; near.held.len()];
        near.contact(self.model, contact, &self.u, Tangent::Full, &mut gradient);
        let definite = near.factor_tangent();
        let answer = definite.then(|| {
            let mut solutions: [Vec<f64>; 6] = std::array::from_fn(|_| vec![0.0; self.u.len()]);
            let mut residuals = columns.clone();
            let mut product = vec![0.0; self.u.len()];
            for ((x, b), residual) in solutions.iter_mut().zip(columns).zip(&mut residuals) {
                let load = near.condense(b, &self.held);
                let moved = near.solve(&load);
                for (&node, moved) in near.nodes.iter().zip(moved.chunks_exact(3)) {
                    x[3 * node as usize..][..3].copy_from_slice(moved);
                }
                near.expand(&moved, &self.held, x);
                self.stiffness.multiply(&self.model.pattern, x, &mut product);
                for ((r, p), held) in residual.iter_mut().zip(&product).zip(&self.held) {
                    *r = if *held { 0.0 } else { *r - p };
                }
            }
            std::array::from_fn(|i| {
                std::array::from_fn(|j| dot(&solutions[i], &columns[j]) + dot(&residuals[i], &solutions[j]))
            })
        });
        self.near = Some(near);
        answer
    }

    fn near_displacements(&self, near: &NearField) -> Vec<f64> {
        near.nodes
            .iter()
            .flat_map(|&node| (0..3).map(move |axis| 3 * node as usize + axis))
            .map(|i| self.u[i])
            .collect()
    }

    fn put_near(&mut self, near: &NearField, start: &[f64], d: &[f64]) {
        for (i, &node) in near.nodes.iter().enumerate() {
            for axis in 0..3 {
                self.u[3 * node as usize + axis] = start[3 * i + axis] + d[3 * i + axis];
            }
        }
    }

    /// One round: the near field is brought to balance, all of the body being linear, until `regrip` says that nothing more is
    /// caught; then the rest follows. After [`Solver::imbalance`]; the balance is found to `tolerance`, N.
    pub fn near_field_round(
        &mut self,
        contact: &mut ToolContact,
        tolerance: f64,
        mut regrip: impl FnMut(&mut ToolContact, &[f64]) -> bool,
    ) -> Result<(), Failure> {
        let Some(mut near) = self.near.take() else { return Err(Failure::Stuck) };
        self.counts.newton += 1;
        let b: Vec<f64> = self.body_forces.iter().map(|f| -f).collect();
        let load = near.condense(&b, &self.held);
        let start = self.near_displacements(&near);
        let mut d = vec![0.0; load.len()];
        contact.watch(Some(&near.index));
        let result = loop {
            let from = d.clone();
            let mut found = self.balance(&mut near, contact, &load, &start, &mut d, tolerance);
            if found.is_err() {
                let scale = contact.penalty_scale;
                d = from;
                found = PENALTY_SCALES.iter().try_for_each(|softer| {
                    contact.penalty_scale = softer * scale;
                    self.balance(&mut near, contact, &load, &start, &mut d, tolerance)
                });
                contact.penalty_scale = scale;
            }
            if let Err(failure) = found {
                break Err(failure);
            }
            if regrip(contact, &self.u) {
                break Ok(());
            }
        };
        contact.watch(None);
        if result.is_ok() {
            near.expand(&d, &self.held, &mut self.u);
        }
        self.near = Some(near);
        result
    }

    /// The least of ½ dᵀ S d − loadᵀ d + the contact's energy.
    fn balance(
        &mut self,
        near: &mut NearField,
        contact: &ToolContact,
        load: &[f64],
        start: &[f64],
        d: &mut Vec<f64>,
        tolerance: f64,
    ) -> Result<(), Failure> {
        let m = d.len();
        let (mut product, mut gradient, mut residual) = (vec![0.0; m], vec![0.0; m], vec![0.0; m]);
        near.multiply(d, &mut product);
        for _ in 0..MAX_STEPS {
            self.put_near(near, start, d);
            let contact_energy = near.contact(self.model, contact, &self.u, Tangent::Full, &mut gradient);
            let energy = 0.5 * dot(d, &product) - dot(load, d) + contact_energy;
            for i in 0..m {
                residual[i] = if near.held[i] { 0.0 } else { load[i] - product[i] - gradient[i] };
            }
            if dot(&residual, &residual).sqrt() <= tolerance {
                return Ok(());
            }
            self.counts.contact_steps += 1;
            // Where the energy curves downwards the tool slips off or the surface snaps: no matter for a linear body.
            if !near.factor_tangent() {
                return Err(Failure::Stuck);
            }
            let step = near.solve(&residual);
            let slope = -dot(&residual, &step);
            let mut more = vec![0.0; m];
            near.multiply(&step, &mut more);
            let (mut scale, mut halvings) = (1.0, 0);
            loop {
                let tried: Vec<f64> = d.iter().zip(&step).map(|(d, step)| d + scale * step).collect();
                self.put_near(near, start, &tried);
                let bent: Vec<f64> = product.iter().zip(&more).map(|(p, more)| p + scale * more).collect();
                let trial =
                    0.5 * dot(&tried, &bent) - dot(load, &tried) + contact.energy(self.model, &self.u);
                if trial <= energy + DECREASE * scale * slope + 1e-11 * contact_energy.abs() {
                    (*d, product) = (tried, bent);
                    break;
                }
                halvings += 1;
                if halvings > MAX_HALVINGS {
                    return Err(Failure::Stuck);
                }
                // The parabola's least point, kept between a tenth and a half.
                scale *= (-0.5 * slope * scale / (trial - energy - slope * scale)).clamp(0.1, 0.5);
            }
        }
        Err(Failure::Slow)
    }
}

#[cfg(test)]
pub(crate) mod tests;
