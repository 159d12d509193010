//! The decoupled law, the seed's (4): f_z(δz) along û and a lateral force that is alike in all directions, or under the tensors
//! of an anisotropic body (MODEL 2 and 7).
//!
//! The nodes' tensors blend like everything else, A = Σ n_l A_l. ρ = √(δ_t·A δ_t) takes the place of δr in the lateral
//! curve, and f_t = f_r(ρ)/ρ w with w = P_û A δ_t that of f_r u_r: the gradient of F_r(ρ), so that stick is
//! conservative. No tangent basis is needed, and nothing jumps where two of them would meet.
//!
//! A step is compiled once for each of the two, so that isotropic bodies pay nothing.

use crate::drive::Drive;
use crate::force_law::{Blend, ForceLaw, NO_DIRECTION};
use crate::kernel::{Change, Deflection, Drift, Evaluation, Reading};
use glam::DVec3;
use palpate_body::law::decoupled;
use palpate_body::{
    BasisValues, ContactModel, DecoupledEnergies, EnergyCache, Gradients, Interval, Knots, Node, Rows,
    Sample, Tensor, tensor,
};
use std::array::from_fn;

/// Bound on the iterates of [`ForceLaw::implicit_direction`]; mostly none are needed, else two or three.
const DIRECTION_ITERATES: u32 = 6;
/// How near the squared length of a way comes to the one wanted before they begin.
const NEAR: f64 = 2e-3;

/// The curves that an element blends, in the current intervals, and its nodes' tensors.
#[derive(Clone, Copy)]
pub(crate) struct Curves<'a, T> {
    blend: Blend,
    depth: Rows<'a, 9>,
    lateral: Rows<'a, 5>,
    tensors: T,
}

impl<'a, T> Curves<'a, T> {
    /// The blended intervals of the normal and friction curves and of the lateral curve. `n` blends the nodes.
    #[inline(always)]
    fn blended(
        &mut self,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        n: [f64; 3],
        [depth, rho]: [f64; 2],
    ) -> ([f64; 9], [f64; 5]) {
        if self.blend == Blend::Wide {
            return self.blended_widely(model, nodes, n, [depth, rho]);
        }
        if !self.depth.hold(depth) {
            self.depth = model.responses().depth_rows(self.blend.points(nodes), depth);
        }
        if !self.lateral.hold(rho) {
            self.lateral = model.responses().lateral_rows(self.blend.points(nodes), rho);
        }
        let weights = self.blend.weights(nodes, n);
        (self.depth.blend(weights), self.lateral.blend(weights))
    }

    #[cold]
    #[inline(never)]
    fn blended_widely(
        &mut self,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        n: [f64; 3],
        [depth, rho]: [f64; 2],
    ) -> ([f64; 9], [f64; 5]) {
        let (mut z, mut r, responses) = ([0.0; 9], [0.0; 5], model.responses());
        let held = |interval: Interval, knots: &Knots, x: f64| {
            if interval.holds(x) { interval } else { knots.interval(x) }
        };
        let depth = held(self.depth.interval(), responses.depth_knots(), depth);
        let lateral = held(self.lateral.interval(), responses.lateral_knots(), rho);
        for (n, node) in n.into_iter().zip(nodes) {
            let weights = node.weights.map(|w| n * w);
            self.depth = responses.depth_rows_in(node.test_points, depth);
            self.lateral = responses.lateral_rows_in(node.test_points, lateral);
            for (sum, x) in z.iter_mut().zip(self.depth.blend(weights)) {
                *sum += x;
            }
            for (sum, x) in r.iter_mut().zip(self.lateral.blend(weights)) {
                *sum += x;
            }
        }
        (z, r)
    }

    /// Where the energies of test points are, at the deflections that were just evaluated.
    #[inline]
    fn basis(&self, model: &'a ContactModel, depth: f64, rho: f64) -> BasisValues<'a> {
        model.responses().basis([depth, rho], (&self.depth, &self.lateral))
    }

    /// Normal, friction and lateral curves blended with `n`.
    fn samples(
        &mut self,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        n: [f64; 3],
        [depth, rho]: [f64; 2],
    ) -> (Sample, Sample, Sample) {
        let ([i, z0, z1, z2, z3, m0, m1, m2, m3], [j, r0, r1, r2, r3]) =
            self.blended(model, nodes, n, [depth, rho]);
        let (t, s) = (self.depth.distance(depth), self.lateral.distance(rho));
        let normal = if depth > 0.0 { Sample::at(i, [z0, z1, z2, z3], t) } else { Sample::default() };
        (normal, Sample::at(0.0, [m0, m1, m2, m3], t), Sample::at(j, [r0, r1, r2, r3], s))
    }
}

impl<M: Metric> ForceLaw for M {
    const ISOTROPIC: bool = M::EVEN;
    type Element<'a> = Curves<'a, M::Nodes<'a>>;
    type Energies<'a> = DecoupledEnergies<'a>;

    #[inline(always)]
    fn element<'a>(
        model: &'a ContactModel,
        element: u32,
        nodes: [&'a Node; 3],
        [depth, lateral]: [u32; 2],
    ) -> Self::Element<'a> {
        let (responses, blend) = (model.responses(), Blend::of(nodes));
        let (points, knots) = (blend.points(nodes), [responses.depth_knots(), responses.lateral_knots()]);
        Curves {
            blend,
            depth: responses.depth_rows_in(points, knots[0].interval_at(depth)),
            lateral: responses.lateral_rows_in(points, knots[1].interval_at(lateral)),
            tensors: M::nodes(model, element),
        }
    }

    #[inline(always)]
    fn intervals(curves: &Self::Element<'_>) -> [u32; 2] {
        [curves.depth.interval().index as u32, curves.lateral.interval().index as u32]
    }

    #[inline]
    fn change_element<'a>(
        curves: &mut Self::Element<'a>,
        model: &'a ContactModel,
        element: u32,
        [before, nodes]: [[&'a Node; 3]; 2],
    ) {
        curves.tensors = M::nodes(model, element);
        if !curves.blend.change_element(before, nodes) {
            let (responses, points) = (model.responses(), curves.blend.points(nodes));
            curves.depth = responses.depth_rows_in(points, curves.depth.interval());
            curves.lateral = responses.lateral_rows_in(points, curves.lateral.interval());
        }
    }

    #[inline(always)]
    fn read<'a>(
        curves: &mut Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        n: [f64; 3],
        at: &Deflection,
    ) -> (Self, Reading) {
        let depth = at.depth;
        let tensor = || M::blend(curves.tensors, n);
        let (metric, rho, u_t) = M::of(tensor, at.tangential, at.lateral, |v| at.project(v));
        let ([integral, z0, z1, z2, z3, m0, m1, m2, m3], lateral) =
            curves.blended(model, nodes, n, [depth, rho]);
        let (t, s) = (curves.depth.distance(depth), curves.lateral.distance(rho));
        let law = decoupled([integral, z0, z1, z2, z3], lateral, [t, s]);
        let ([normal, lateral_force], [stored, lateral_energy]) = (law.force, law.energy);
        let (normal, stored) = if depth > 0.0 { (normal, stored) } else { (0.0, 0.0) };
        let (lateral_force, lateral_slope) = metric.lateral_force(lateral_force, law.lateral_slope);
        let limit = (m0 + t * (m1 + t * (m2 + t * m3))) * normal;
        (
            metric,
            Reading { u_t, normal, lateral_force, lateral_slope, limit, energy: stored + lateral_energy },
        )
    }

    #[inline(always)]
    fn rho(&self, f: &Evaluation) -> f64 {
        Metric::length(self, f)
    }

    #[inline(always)]
    fn deflection(&self, f: &Evaluation) -> DVec3 {
        Metric::tangential(self, f)
    }

    #[inline(always)]
    fn along_deflection(&self, f: &Evaluation, v: DVec3) -> f64 {
        Metric::along(self, f, v)
    }

    #[inline(always)]
    fn normal_coupling(&self, curves: &Self::Element<'_>, n: [f64; 3], f: &Evaluation) -> f64 {
        Metric::along_normal(self, || M::blend(curves.tensors, n), f)
    }

    /// W_l + ½ g δ_t·A_l δ_t.
    #[inline]
    fn node_energies(
        &self,
        curves: &Self::Element<'_>,
        model: &ContactModel,
        nodes: [&Node; 3],
        f: &Evaluation,
    ) -> [f64; 3] {
        let basis = model.responses().basis([f.depth, self.rho(f)], (&curves.depth, &curves.lateral));
        let own = nodes.map(|node| {
            let [a, b, c] = node.test_points.map(|t| basis.energy(t));
            let [x, y, z] = node.weights;
            x * a + y * b + z * c
        });
        if M::EVEN {
            return own;
        }
        let half = 0.5 * self.gain(f);
        let ([a, b, c], [x, y, z]) = (own, M::squares(curves.tensors, self.deflection(f)));
        [a + half * x, b + half * y, c + half * z]
    }

    #[inline(always)]
    fn energies<'a>(
        &self,
        curves: &Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&Node; 3],
        f: &Evaluation,
    ) -> DecoupledEnergies<'a> {
        let basis = curves.basis(model, f.depth, self.rho(f));
        let shared = (curves.blend == Blend::Shared).then(|| curves.blend.points(nodes));
        DecoupledEnergies { basis, cache: shared.map_or(EnergyCache::NONE, |points| basis.cache(points)) }
    }

    #[inline(always)]
    fn greatest_gradient(
        &self,
        _: &Self::Element<'_>,
        gradients: &Gradients,
        nodes: [u32; 3],
        f: &Evaluation,
    ) -> f64 {
        // Each node's is beyond its own share of W, n_l W_l ≤ W.
        let [a, b, c] = nodes.map(|node| gradients.bound(node).energy);
        f64::from(a.max(b).max(c)) * f.energy
    }

    #[inline(always)]
    fn tensor_gradient(&self, f: &Evaluation) -> Option<(DVec3, f64)> {
        if M::EVEN { None } else { Some((self.deflection(f), 0.5 * self.gain(f))) }
    }

    fn drift<'a>(
        &self,
        curves: &mut Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        f: &Evaluation,
        change: &Change,
    ) -> Drift {
        let at = [f.depth, self.rho(f)];
        let (normal, friction, lateral_force) = curves.samples(model, nodes, change.blending, at);
        let (normal_gradient, friction_gradient, lateral_force_gradient) =
            curves.samples(model, nodes, change.along, at);
        let d_depth = change.d_depth;
        let d_normal = normal.slope * d_depth + normal_gradient.value;
        let limit_slope = friction.slope * normal.value + friction.value * normal.slope;
        let limit = limit_slope * d_depth
            + friction_gradient.value * normal.value
            + friction.value * normal_gradient.value;
        let tensors = || [change.blending, change.along].map(|n| M::blend(curves.tensors, n));
        let lateral = self.lateral_drift(tensors, f, change, lateral_force, lateral_force_gradient.value);
        let [a, b] = lateral.force;
        Drift {
            force: change.u * d_normal + change.du * f.normal + a + b,
            normal_slope: normal.slope,
            limit_slope: limit_slope * change.friction_scale,
            lateral_stiffness: lateral.stiffness,
            lateral_force_gradient: lateral.lateral_force_gradient,
            eta: limit * change.friction_scale - lateral.lateral_force,
        }
    }

    #[inline(always)]
    fn implicit_direction(&self, f: &Evaluation) -> DVec3 {
        Metric::metric_direction(self, f)
    }

    #[inline(always)]
    fn implicit_drive_direction(
        curves: &Self::Element<'_>,
        n: [f64; 3],
        f: &Evaluation,
        drive: &Drive,
    ) -> DVec3 {
        M::metric_drive_direction(|| M::blend(curves.tensors, n), f, drive)
    }

    #[inline(always)]
    fn slope_ratio(curves: &Self::Element<'_>, n: [f64; 3], old: DVec3, new: DVec3) -> f64 {
        M::metric_slope_ratio(|| M::blend(curves.tensors, n), old, new)
    }
}

/// How the lateral force follows from the lateral deflection; a value is what one evaluation knows of it besides its
/// [`Evaluation`].
pub(crate) trait Metric: Copy + Default {
    /// Whether f_t lies along δ_t.
    const EVEN: bool;
    /// What it reads of an element's nodes.
    type Nodes<'a>: Copy;

    /// Of an element.
    fn nodes(body: &ContactModel, element: u32) -> Self::Nodes<'_>;

    /// Σ n A.
    fn blend(nodes: Self::Nodes<'_>, n: [f64; 3]) -> Tensor;

    /// From δ_t and its length: ρ, and the direction of f_t, zero where there is none. `project` is P_û.
    fn of(
        tensor: impl FnOnce() -> Tensor,
        tangential: DVec3,
        lateral: f64,
        project: impl Fn(DVec3) -> DVec3,
    ) -> (Self, f64, DVec3);

    /// |f_t| and how fast it falls when c moves along it, the rest held; from the curve's value and slope at ρ.
    fn lateral_force(&self, value: f64, slope: f64) -> (f64, f64);

    /// ρ, m.
    fn length(&self, f: &Evaluation) -> f64;

    /// δ_t, m.
    fn tangential(&self, f: &Evaluation) -> DVec3;

    /// g = f_r/ρ, N/m; 0 where there is no lateral deflection.
    fn gain(&self, f: &Evaluation) -> f64;

    /// g û·A δ_t, N: what the tensor makes of the deflection along û.
    fn along_normal(&self, tensor: impl FnOnce() -> Tensor, f: &Evaluation) -> f64;

    /// δ_t·A_l δ_t of each node.
    fn squares(nodes: Self::Nodes<'_>, deflection: DVec3) -> [f64; 3];

    /// δ_t·v.
    fn along(&self, f: &Evaluation, v: DVec3) -> f64;

    /// Direction that the implicit step takes for f_t, a unit vector.
    fn metric_direction(&self, f: &Evaluation) -> DVec3;

    /// The same for another drive, of which f_t is the part that changes as c moves.
    fn metric_drive_direction(tensor: impl FnOnce() -> Tensor, f: &Evaluation, drive: &Drive) -> DVec3;

    /// How much less f_t falls along `old` than along `new`, or more.
    fn metric_slope_ratio(tensor: impl FnOnce() -> Tensor, old: DVec3, new: DVec3) -> f64;

    /// How f_t changes; `tensors` are A and its rate, `curve` the lateral curve at ρ, `gradient` the rate at which it changes
    /// along the surface, N/m.
    fn lateral_drift(
        &self,
        tensors: impl FnOnce() -> [Tensor; 2],
        f: &Evaluation,
        change: &Change,
        curve: Sample,
        gradient: f64,
    ) -> LateralDrift;
}

/// The part of [`Drift`](crate::kernel::Drift) that comes from f_t.
pub(crate) struct LateralDrift {
    /// Its rate, in two parts, N/m.
    pub force: [DVec3; 2],
    /// The rate of its component along the way, N/m.
    pub lateral_force: f64,
    /// The greatest stiffness in stick, N/m.
    pub stiffness: f64,
    /// |∂|f_t|/∂x|, N/m.
    pub lateral_force_gradient: f64,
}

/// f_t = f_r(δr) u_r.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Isotropic;

impl Metric for Isotropic {
    const EVEN: bool = true;
    type Nodes<'a> = ();

    #[inline(always)]
    fn nodes(_: &ContactModel, _: u32) {}

    #[inline(always)]
    fn blend((): (), _: [f64; 3]) -> Tensor {
        tensor::IDENTITY
    }

    #[inline(always)]
    fn of(
        _: impl FnOnce() -> Tensor,
        tangential: DVec3,
        lateral: f64,
        _: impl Fn(DVec3) -> DVec3,
    ) -> (Self, f64, DVec3) {
        let u_t = if lateral > 0.0 { tangential * (1.0 / lateral) } else { DVec3::ZERO };
        (Isotropic, lateral, u_t)
    }

    #[inline(always)]
    fn lateral_force(&self, value: f64, slope: f64) -> (f64, f64) {
        (value, slope)
    }

    #[inline(always)]
    fn length(&self, f: &Evaluation) -> f64 {
        f.lateral
    }

    #[inline(always)]
    fn tangential(&self, f: &Evaluation) -> DVec3 {
        f.u_t * f.lateral
    }

    #[inline(always)]
    fn gain(&self, f: &Evaluation) -> f64 {
        if f.lateral > 0.0 { f.lateral_force / f.lateral } else { 0.0 }
    }

    #[inline(always)]
    fn along_normal(&self, _: impl FnOnce() -> Tensor, _: &Evaluation) -> f64 {
        0.0
    }

    #[inline(always)]
    fn squares((): (), deflection: DVec3) -> [f64; 3] {
        [deflection.length_squared(); 3]
    }

    #[inline(always)]
    fn along(&self, f: &Evaluation, v: DVec3) -> f64 {
        f.lateral * f.u_t.dot(v)
    }

    #[inline(always)]
    fn metric_direction(&self, f: &Evaluation) -> DVec3 {
        f.u_t
    }

    #[inline(always)]
    fn metric_drive_direction(_: impl FnOnce() -> Tensor, _: &Evaluation, drive: &Drive) -> DVec3 {
        drive.along
    }

    #[inline(always)]
    fn metric_slope_ratio(_: impl FnOnce() -> Tensor, _: DVec3, _: DVec3) -> f64 {
        1.0
    }

    #[inline(always)]
    fn lateral_drift(
        &self,
        _: impl FnOnce() -> [Tensor; 2],
        f: &Evaluation,
        change: &Change,
        _: Sample,
        gradient: f64,
    ) -> LateralDrift {
        let d_lateral = f.u_t.dot(change.d_tangential);
        let du_t = if f.lateral > 0.0 {
            (change.d_tangential - f.u_t * d_lateral) * (1.0 / f.lateral)
        } else {
            DVec3::ZERO
        };
        let d_pull = f.lateral_slope * d_lateral + gradient;
        let secant = if f.lateral < NO_DIRECTION { 0.0 } else { f.lateral_force / f.lateral };
        LateralDrift {
            force: [f.u_t * d_pull, du_t * f.lateral_force],
            lateral_force: d_pull,
            stiffness: f.lateral_slope.max(secant),
            lateral_force_gradient: f.lateral_slope,
        }
    }
}

/// f_t = f_r(ρ)/ρ P_û A δ_t, as one evaluation found it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Anisotropic {
    /// δ_t, m.
    deflection: DVec3,
    /// Its square, m².
    square: f64,
    /// ρ, m.
    rho: f64,
    /// |w|/ρ.
    gain: f64,
}

impl Metric for Anisotropic {
    const EVEN: bool = false;
    type Nodes<'a> = [&'a Tensor; 3];

    #[inline(always)]
    fn nodes(body: &ContactModel, element: u32) -> [&Tensor; 3] {
        body.element_tensors(element)
    }

    #[inline(always)]
    fn blend([a, b, c]: [&Tensor; 3], n: [f64; 3]) -> Tensor {
        from_fn(|i| n[0] * a[i] + n[1] * b[i] + n[2] * c[i])
    }

    #[inline(always)]
    fn of(
        tensor: impl FnOnce() -> Tensor,
        tangential: DVec3,
        lateral: f64,
        project: impl Fn(DVec3) -> DVec3,
    ) -> (Self, f64, DVec3) {
        let tensor = tensor();
        let stretched = tensor::apply(&tensor, tangential);
        let w = project(stretched);
        let (rho2, w2) = (tangential.dot(stretched), w.length_squared());
        let (mut rho, mut gain, mut u_t) = (0.0, 1.0, DVec3::ZERO);
        if rho2 > 0.0 && w2 > 0.0 {
            let length = w2.sqrt();
            rho = rho2.sqrt();
            gain = length / rho;
            u_t = w * (1.0 / length);
        }
        (Anisotropic { deflection: tangential, square: lateral * lateral, rho, gain }, rho, u_t)
    }

    /// |f_t| = f_r |w|/ρ. Of ∂f_t/∂δ_t = f_r/ρ P A P + (f_r' − f_r/ρ) w wᵀ/ρ² the slope takes w wᵀ/ρ² for P A P, which are
    /// the same along a principal axis; elsewhere it is too low, for a ratio κ by a factor down to 4 κ/(1 + κ)².
    #[inline(always)]
    fn lateral_force(&self, value: f64, slope: f64) -> (f64, f64) {
        (value * self.gain, slope * (self.gain * self.gain))
    }

    #[inline(always)]
    fn length(&self, _: &Evaluation) -> f64 {
        self.rho
    }

    #[inline(always)]
    fn tangential(&self, _: &Evaluation) -> DVec3 {
        self.deflection
    }

    #[inline(always)]
    fn gain(&self, f: &Evaluation) -> f64 {
        if self.rho > 0.0 { f.lateral_force / (self.gain * self.rho) } else { 0.0 }
    }

    #[inline(always)]
    fn along_normal(&self, tensor: impl FnOnce() -> Tensor, f: &Evaluation) -> f64 {
        f.u().dot(tensor::apply(&tensor(), self.deflection)) * Metric::gain(self, f)
    }

    #[inline(always)]
    fn squares(nodes: [&Tensor; 3], deflection: DVec3) -> [f64; 3] {
        nodes.map(|a| deflection.dot(tensor::apply(a, deflection)))
    }

    #[inline(always)]
    fn along(&self, _: &Evaluation, v: DVec3) -> f64 {
        self.deflection.dot(v)
    }

    /// As in an implicit step, along f_t where the contact point will come to rest, not where it starts: on a uniform
    /// plane one iterate is then nearly enough, with and without friction.
    ///
    /// While c moves by λ v, f_t = g A δ_t goes to g A (δ_t − λ v), and that is L v if (λ A + ℓ I) v = w, with w = A δ_t
    /// and ℓ = L/g. In the plane (tr(A) I − A) A = det(A) I, so that v ∝ ℓ w + λ det(A) δ_t: along the force where little
    /// is left to go, straight under the tool where there is no friction. λ makes v's length 1.
    #[inline(always)]
    fn metric_direction(&self, f: &Evaluation) -> DVec3 {
        // With |w| as the unit u_t·δ_t = ρ²/|w|² = 1/gain², and u_t·A u_t = tr(A) − det(A)/gain². A's trace in the plane is
        // 2 where û is the nodes' own, and never far from it.
        let gain2 = self.gain * self.gain;
        let part = (self.rho * self.rho * (2.0 - gain2) / (self.square * gain2)).max(0.0);
        let (determinant, square) = (part * gain2, part * (2.0 - gain2));
        let straight = self.deflection * (determinant / (self.gain * self.rho));
        // v along a u_t + b det(A) δ_t with a : b = ℓ : λ; λ from where the force alone would lead, (1 − ℓ)/(u_t·A u_t), is
        // mostly near enough. In whatever unit a and b are, no quotient has to be waited for.
        let (mut a, mut b) = (f.limit * (2.0 - part), f.lateral_force - f.limit);
        let length2 = |a: f64, b: f64| a * (a + 2.0 * b * part) + b * b * square;
        let mut v2 = length2(a, b);
        let d = (b * (b * determinant + 2.0 * a) + a * a) / (f.lateral_force * (2.0 - part));
        if (d * d - v2).abs() >= NEAR * v2 {
            (a, b) = share(f.limit / f.lateral_force, part, determinant, square);
            v2 = length2(a, b);
        }
        let per = 1.0 / v2.sqrt();
        let v = (f.u_t * a + straight * b) * per;
        // A direction that has lost the force, or is none, leads nowhere.
        if f.lateral_force * (a + b * part) * per > f.limit && v.is_finite() { v } else { f.u_t }
    }

    /// As [`Metric::towards`], with the deflection that would make this drive: (λ A + ℓ I) v = w', hence
    /// v ∝ (ℓ + 2 λ) w' − λ P A w' (A's trace in the plane is 2), and λ from where the drive alone would lead.
    #[inline(always)]
    fn metric_drive_direction(tensor: impl FnOnce() -> Tensor, f: &Evaluation, drive: &Drive) -> DVec3 {
        let (u, stretched) = (f.u(), tensor::apply(&tensor(), drive.along));
        let stretched = stretched - u * u.dot(stretched);
        let (rest, part) = (f.limit, drive.along.dot(stretched));
        // Times the part, so that there is no quotient.
        let way = drive.force - rest;
        let v = drive.along * (rest * part + 2.0 * way) - stretched * way;
        let v = v * (1.0 / v.length());
        // A direction that has lost the drive, or is none, leads nowhere.
        if drive.force * drive.along.dot(v) > rest && v.is_finite() { v } else { drive.along }
    }

    #[inline(always)]
    fn metric_slope_ratio(tensor: impl FnOnce() -> Tensor, old: DVec3, new: DVec3) -> f64 {
        let a = tensor();
        old.dot(tensor::apply(&a, old)) / new.dot(tensor::apply(&a, new))
    }

    #[inline(always)]
    fn lateral_drift(
        &self,
        tensors: impl FnOnce() -> [Tensor; 2],
        f: &Evaluation,
        change: &Change,
        curve: Sample,
        gradient: f64,
    ) -> LateralDrift {
        let Change { u, du, d_tangential, v, .. } = *change;
        let ([a, da], deflection) = (tensors(), self.deflection);
        let project = |v: DVec3| v - u * u.dot(v);
        let stretched = tensor::apply(&a, deflection);
        let turned = tensor::apply(&da, deflection);
        let w = project(stretched);
        let dw =
            project(turned + tensor::apply(&a, d_tangential)) - u * du.dot(stretched) - du * u.dot(stretched);
        // f_t = g w with g = f_r/ρ.
        let (g, dg, bend) = if self.rho > 0.0 {
            let per = 1.0 / self.rho;
            let d_rho = (d_tangential.dot(stretched) + 0.5 * deflection.dot(turned)) * per;
            let g = curve.value * per;
            (g, ((curve.slope - g) * d_rho + gradient) * per, (curve.slope - g) * per * per)
        } else {
            (curve.slope, 0.0, 0.0)
        };
        let force = w * dg + dw * g;
        // ∂f_t/∂x u_t, and the norm of ∂f_t/∂x = B^½ (g I + (f_r' − g) ŝ ŝᵀ) B^½ with B = P A P.
        let along = project(tensor::apply(&a, f.u_t)) * g + w * (bend * w.dot(f.u_t));
        LateralDrift {
            force: [force, DVec3::ZERO],
            lateral_force: force.dot(v),
            stiffness: greatest_eigenvalue(&a, u) * g.max(curve.slope),
            lateral_force_gradient: along.length(),
        }
    }
}

/// ℓ and λ in units of |w|: v = ℓ u_t + λ det(A) δ_t has the length det(λ A + ℓ I), by Newton's method on the quotient of
/// the two, which is nearly linear in λ.
#[cold]
fn share(rest: f64, part: f64, determinant: f64, square: f64) -> (f64, f64) {
    let mut way = (1.0 - rest) / (2.0 - part);
    for _ in 0..DIRECTION_ITERATES {
        let (forced, straight) = (rest + way * part, rest * part + way * square);
        let v2 = rest * forced + way * straight;
        let d = way * (way * determinant + 2.0 * rest) + rest * rest;
        let miss = d - v2.sqrt();
        way -= miss * v2 / (2.0 * (way * determinant + rest) * v2 - d * straight);
        // Newton squares it.
        if miss.abs() < NEAR * d {
            break;
        }
    }
    (rest, way)
}

/// Of a tensor in the plane at right angles to the unit vector `u`.
fn greatest_eigenvalue(a: &Tensor, u: DVec3) -> f64 {
    let [xx, yy, zz, xy, xz, yz] = *a;
    let [x, y, z] = [DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz)];
    let half = 0.5 * (xx + yy + zz - u.dot(tensor::apply(a, u)));
    // u·adj(A) u is the determinant there.
    let determinant = u.dot(y.cross(z) * u.x + z.cross(x) * u.y + x.cross(y) * u.z);
    half + (half * half - determinant).max(0.0).sqrt()
}
