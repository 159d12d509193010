//! The force law: local frame, deflection, mixed responses, stored energy (paper, (1) to (5); MODEL 2).
//!
//! Where the body is anisotropic, its nodes' tensors A mix like everything else, ρ = √(δ_t·A δ_t) takes the place of δr
//! in the lateral curve, and f_t = f_r(ρ)/ρ P_û A δ_t that of f_r u_r: still the gradient of W.

use crate::walk::Rates;
use glam::DVec3;
use palpate_body::{Body, Node, Rows, Sample, SurfacePoint, Tensor, tensor};
use std::array::from_fn;

/// Which interpolations are taken away, as in the paper's section 5: either makes the force jump at mesh edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ablation {
    /// Both interpolations on.
    #[default]
    None,
    /// The element's own normal instead of the interpolated frame (2).
    Coordinates,
    /// One response for the whole element, the mean of its nodes', instead of (5).
    Responses,
    /// Both taken away.
    Both,
}

/// What fixes the force for a given contact point and tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Law {
    /// Interpolations.
    pub ablation: Ablation,
    /// Radius of the spherical tool, m; 0 for a point.
    pub radius_m: f64,
}

impl Law {
    fn interpolates_frames(self) -> bool {
        matches!(self.ablation, Ablation::None | Ablation::Responses)
    }

    fn interpolates_responses(self) -> bool {
        matches!(self.ablation, Ablation::None | Ablation::Coordinates)
    }

    /// Whether frames and responses agree on the two sides of every edge that is no crease.
    #[inline]
    pub(crate) fn is_continuous(self) -> bool {
        self.ablation == Ablation::None
    }
}

/// An element as the law sees it: its nodes, and the curves that are mixed at the deflections of the moment. Good
/// for many evaluations, as long as the contact point stays in the element.
#[derive(Clone, Copy)]
pub(crate) struct Site<'a> {
    pub body: &'a Body,
    pub law: Law,
    pub element: u32,
    nodes: [&'a Node; 3],
    mix: Mix,
    depth: Rows<'a, 9>,
    lateral: Rows<'a, 5>,
}

/// Whose curves the element mixes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mix {
    /// Each node is its own test point.
    Own,
    /// All nodes mix the same three test points.
    Shared,
    /// Up to nine test points: where the element lies across the triangles of test points.
    Wide,
}

impl Mix {
    #[inline]
    fn of([a, b, c]: [&Node; 3]) -> Self {
        if a.weights[0] == 1.0 && b.weights[0] == 1.0 && c.weights[0] == 1.0 {
            Mix::Own
        } else if a.test_points == b.test_points && a.test_points == c.test_points {
            Mix::Shared
        } else {
            Mix::Wide
        }
    }
}

/// The state of the force law at one contact point and tip.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Field {
    /// c, m.
    pub c: DVec3,
    /// Σ n u, whose direction is û_c.
    frame: DVec3,
    /// Its length.
    frame_length: f64,
    /// δz, m.
    pub depth: f64,
    /// δr, m.
    pub lateral: f64,
    /// ρ, at which the lateral curve is asked, m: δr where the body is isotropic.
    rho: f64,
    /// Direction of the lateral force f_t, that of the lateral deflection where the body is isotropic; zero where
    /// there is none.
    pub u_t: DVec3,
    /// f_c^z, N.
    pub normal: f64,
    /// |f_t|, N: f_c^r where the body is isotropic.
    pub pull: f64,
    /// How fast it falls when c moves along u_t, the rest held, N/m.
    pub pull_slope: f64,
    /// Friction limit L = μ f^z, N.
    pub limit: f64,
    /// W(c, δ) = F^z(δz) + F^r(ρ), J.
    pub energy: f64,
}

impl<'a> Site<'a> {
    /// The element under the contact point.
    #[inline]
    pub fn new(body: &'a Body, law: Law, element: u32) -> Self {
        let nodes = body.element_nodes(element);
        Site { body, law, element, nodes, mix: Mix::of(nodes), depth: Rows::NONE, lateral: Rows::NONE }
    }

    /// Another element; the curves stay where it mixes the same test points.
    #[inline]
    pub fn move_to(&mut self, element: u32) {
        let (mix, points) = (self.mix, self.points());
        self.element = element;
        self.nodes = self.body.element_nodes(element);
        self.mix = Mix::of(self.nodes);
        if mix != Mix::Shared || self.mix != Mix::Shared || self.points() != points {
            (self.depth, self.lateral) = (Rows::NONE, Rows::NONE);
        }
    }

    /// Corner positions, m.
    #[inline]
    pub fn corners(&self) -> [DVec3; 3] {
        self.nodes.map(|n| n.position)
    }

    #[inline]
    fn points(&self) -> [u32; 3] {
        match self.mix {
            Mix::Own => self.nodes.map(|n| n.test_points[0]),
            Mix::Shared | Mix::Wide => self.nodes[0].test_points,
        }
    }

    /// Weights of the test points at area coordinates `n`; linear in `n`.
    #[inline]
    fn weights(&self, n: [f64; 3]) -> [f64; 3] {
        match self.mix {
            Mix::Own => n,
            Mix::Shared | Mix::Wide => {
                let [a, b, c] = self.nodes.map(|n| n.weights);
                from_fn(|j| n[0] * a[j] + n[1] * b[j] + n[2] * c[j])
            }
        }
    }

    /// The mixed intervals of the normal and friction curves and of the lateral curve. `n` mixes the nodes.
    #[inline(always)]
    fn mixed(&mut self, n: [f64; 3], depth: f64, rho: f64) -> ([f64; 9], [f64; 5]) {
        if self.mix == Mix::Wide {
            return self.mixed_widely(n, depth, rho);
        }
        if !self.depth.hold(depth) {
            self.depth = self.body.responses().depth_rows(self.points(), depth);
        }
        if !self.lateral.hold(rho) {
            self.lateral = self.body.responses().lateral_rows(self.points(), rho);
        }
        let weights = self.weights(n);
        (self.depth.mix(weights), self.lateral.mix(weights))
    }

    #[cold]
    #[inline(never)]
    fn mixed_widely(&mut self, n: [f64; 3], depth: f64, rho: f64) -> ([f64; 9], [f64; 5]) {
        let (mut z, mut r) = ([0.0; 9], [0.0; 5]);
        for (n, node) in n.into_iter().zip(self.nodes) {
            let weights = node.weights.map(|w| n * w);
            self.depth = self.body.responses().depth_rows(node.test_points, depth);
            self.lateral = self.body.responses().lateral_rows(node.test_points, rho);
            for (sum, x) in z.iter_mut().zip(self.depth.mix(weights)) {
                *sum += x;
            }
            for (sum, x) in r.iter_mut().zip(self.lateral.mix(weights)) {
                *sum += x;
            }
        }
        (z, r)
    }

    /// Σ n u, before normalising.
    #[inline]
    fn frame(&self, n: [f64; 3]) -> DVec3 {
        let [a, b, c] = self.nodes;
        if self.law.interpolates_frames() {
            a.inward * n[0] + b.inward * n[1] + c.inward * n[2]
        } else {
            (c.position - a.position).cross(b.position - a.position)
        }
    }

    /// Σ n A, of the tensors that mix with the responses.
    #[inline]
    fn tensor(&self, n: [f64; 3]) -> Tensor {
        let [a, b, c] = self.body.element_tensors(self.element);
        from_fn(|i| n[0] * a[i] + n[1] * b[i] + n[2] * c[i])
    }

    /// Frame (2), deflection, and mixed responses (5) for area coordinates `n` and tool reference point `tip`.
    #[inline(always)]
    pub fn evaluate(&mut self, n: [f64; 3], tip: DVec3) -> Field {
        if self.body.is_isotropic() {
            self.evaluate_as::<true>(n, tip)
        } else {
            self.evaluate_anisotropic(n, tip)
        }
    }

    /// Apart, so that isotropic bodies pay one comparison for it.
    #[inline(never)]
    fn evaluate_anisotropic(&mut self, n: [f64; 3], tip: DVec3) -> Field {
        self.evaluate_as::<false>(n, tip)
    }

    #[inline(always)]
    fn evaluate_as<const ISOTROPIC: bool>(&mut self, n: [f64; 3], tip: DVec3) -> Field {
        let [p, q, r] = self.corners();
        let c = p + (q - p) * n[1] + (r - p) * n[2];
        let offset = tip - c;
        // δ_t from the frame before it is normalised: the square root need not be waited for.
        let frame = self.frame(n);
        let (square, along) = (frame.length_squared(), offset.dot(frame));
        let tangential = offset - frame * (along / square);
        let lateral = tangential.length();
        let stretch = if ISOTROPIC {
            Stretch::none(tangential, lateral)
        } else {
            Stretch::of(&self.tensor(self.response_coordinates(n)), tangential, |v| {
                v - frame * (v.dot(frame) / square)
            })
        };
        let Stretch { rho, u_t, .. } = stretch;
        let frame_length = square.sqrt();
        // x = p + R û: the radius adds to the depth and leaves the lateral part alone.
        let depth = along / frame_length + self.law.radius_m;

        let ([integral, z0, z1, z2, z3, m0, m1, m2, m3], [r_integral, r0, r1, r2, r3]) =
            self.mixed(self.response_coordinates(n), depth, rho);
        let (t, s) = (self.depth.distance(depth), self.lateral.distance(rho));
        // Both forces' polynomials side by side: values, then integrals.
        let (x, a, b, c2, d) = ([t, s], [z0, r0], [z1, r1], [z2, r2], [z3, r3]);
        let [normal, pull]: [f64; 2] = from_fn(|i| a[i] + x[i] * (b[i] + x[i] * (c2[i] + x[i] * d[i])));
        let [stored, strain]: [f64; 2] = from_fn(|i| {
            x[i] * (a[i] + x[i] * (b[i] * 0.5 + x[i] * (c2[i] * (1.0 / 3.0) + x[i] * (d[i] * 0.25))))
        });
        let (normal, stored) = if depth > 0.0 { (normal, integral + stored) } else { (0.0, 0.0) };
        let slope = r1 + s * (2.0 * r2 + s * (3.0 * r3));
        let (pull, pull_slope) = if ISOTROPIC { (pull, slope) } else { stretch.pull(pull, slope) };
        Field {
            c,
            frame,
            frame_length,
            depth,
            lateral,
            rho,
            u_t,
            normal,
            pull,
            pull_slope,
            limit: (m0 + t * (m1 + t * (m2 + t * m3))) * normal,
            energy: stored + (r_integral + strain),
        }
    }

    /// The area coordinates that mix the responses.
    #[inline]
    fn response_coordinates(&self, n: [f64; 3]) -> [f64; 3] {
        if self.law.interpolates_responses() { n } else { [1.0 / 3.0; 3] }
    }

    /// [`Rates`] in this element.
    #[inline]
    pub fn rates(&self, v: DVec3) -> Rates {
        Rates::new(self.corners(), v)
    }

    /// How `f`, just evaluated here at `n` and `tip`, changes while c moves with the projection of the unit vector `v`.
    #[inline(never)]
    pub fn drift(&mut self, n: [f64; 3], f: &Field, tip: DVec3, v: DVec3) -> Drift {
        let r = self.rates(v).each();
        let [p, q, s] = self.corners();
        let t = (q - p) * r[1] + (s - p) * r[2];
        let u = f.u();
        let du = if self.law.interpolates_frames() {
            let turn = self.frame(r);
            (turn - u * u.dot(turn)) * (1.0 / f.frame_length)
        } else {
            DVec3::ZERO
        };

        // δ = p − c changes by −t, and with it δz = δ·û + R and δ_t = δ − (δ·û) û.
        let isotropic = self.body.is_isotropic();
        let deflection = f.deflection(tip);
        let turned = if isotropic { f.lateral * f.u_t.dot(du) } else { deflection.dot(du) };
        let d_depth = turned - t.dot(u);
        let d_tangential = -t - u * d_depth - du * (f.depth - self.law.radius_m);

        // (5) is linear in the area coordinates: their rates mix the responses' own gradient.
        let mixing = self.response_coordinates(n);
        let (normal, friction, pull) = self.samples(mixing, f);
        let along = if self.law.interpolates_responses() { r } else { [0.0; 3] };
        let (normal_gradient, friction_gradient, pull_gradient) = self.samples(along, f);

        let d_normal = normal.slope * d_depth + normal_gradient.value;
        let limit_slope = friction.slope * normal.value + friction.value * normal.slope;
        let limit = limit_slope * d_depth
            + friction_gradient.value * normal.value
            + friction.value * normal_gradient.value;
        let lateral = if isotropic {
            let d_lateral = f.u_t.dot(d_tangential);
            let du_t = if f.lateral > 0.0 {
                (d_tangential - f.u_t * d_lateral) * (1.0 / f.lateral)
            } else {
                DVec3::ZERO
            };
            let d_pull = f.pull_slope * d_lateral + pull_gradient.value;
            let greatest = if f.lateral < NO_DIRECTION { 0.0 } else { f.pull / f.lateral };
            LateralDrift {
                force: [f.u_t * d_pull, du_t * f.pull],
                pull: d_pull,
                stiffness: f.pull_slope.max(greatest),
                pull_gradient: f.pull_slope,
            }
        } else {
            let tensors = (self.tensor(mixing), self.tensor(along));
            lateral_drift(tensors, u, du, deflection, d_tangential, pull, pull_gradient.value, f, v)
        };
        let [a, b] = lateral.force;
        Drift {
            force: u * d_normal + du * f.normal + a + b,
            normal_slope: normal.slope,
            limit_slope,
            lateral_stiffness: lateral.stiffness,
            pull_gradient: lateral.pull_gradient,
            eta: limit - lateral.pull,
        }
    }

    /// Normal, friction and lateral curves mixed with `n` at the deflections of `f`.
    fn samples(&mut self, n: [f64; 3], f: &Field) -> (Sample, Sample, Sample) {
        let ([i, z0, z1, z2, z3, m0, m1, m2, m3], [j, r0, r1, r2, r3]) = self.mixed(n, f.depth, f.rho);
        let (t, s) = (self.depth.distance(f.depth), self.lateral.distance(f.rho));
        let normal = if f.depth > 0.0 { Sample::at(i, [z0, z1, z2, z3], t) } else { Sample::default() };
        (normal, Sample::at(0.0, [m0, m1, m2, m3], t), Sample::at(j, [r0, r1, r2, r3], s))
    }
}

impl Law {
    /// The field at a contact point, once.
    pub(crate) fn evaluate(self, body: &Body, at: SurfacePoint, tip: DVec3) -> Field {
        Site::new(body, self, at.element).evaluate(at.n, tip)
    }
}

/// Below this the lateral deflection is rounding, and its direction noise, m.
pub(crate) const NO_DIRECTION: f64 = 1e-12;

/// How a tensor stretches a lateral deflection: w = P_û A δ_t.
struct Stretch {
    /// √(δ_t·A δ_t), m.
    rho: f64,
    /// Direction of w.
    u_t: DVec3,
    /// |w|/ρ.
    gain: f64,
    /// u_t·A u_t.
    stiffness: f64,
}

impl Stretch {
    #[inline(always)]
    fn none(tangential: DVec3, lateral: f64) -> Self {
        let u_t = if lateral > 0.0 { tangential * (1.0 / lateral) } else { DVec3::ZERO };
        Stretch { rho: lateral, u_t, gain: 1.0, stiffness: 1.0 }
    }

    /// `project` is P_û.
    #[inline(always)]
    fn of(a: &Tensor, tangential: DVec3, project: impl Fn(DVec3) -> DVec3) -> Self {
        let stretched = tensor::apply(a, tangential);
        let square = tangential.dot(stretched);
        let w = project(stretched);
        let length = w.length();
        if !(square > 0.0 && length > 0.0) {
            return Stretch { rho: 0.0, u_t: DVec3::ZERO, gain: 1.0, stiffness: 1.0 };
        }
        let rho = square.sqrt();
        let u_t = w * (1.0 / length);
        Stretch { rho, u_t, gain: length / rho, stiffness: u_t.dot(tensor::apply(a, u_t)) }
    }

    /// |f_t| = f_r(ρ) |w|/ρ and its slope along u_t, from the curve's value and slope at ρ:
    /// ∂f_t/∂δ_t = f_r/ρ P A P + (f_r' − f_r/ρ) w wᵀ/ρ².
    #[inline(always)]
    fn pull(&self, value: f64, slope: f64) -> (f64, f64) {
        let secant = if self.rho > 0.0 { value / self.rho } else { slope };
        (value * self.gain, (slope - secant) * (self.gain * self.gain) + secant * self.stiffness)
    }
}

/// The part of [`Drift`] that comes from f_t.
struct LateralDrift {
    /// Its rate, in two parts.
    force: [DVec3; 2],
    /// The rate of its component along the way.
    pull: f64,
    /// The greatest stiffness in stick.
    stiffness: f64,
    /// |∂|f_t|/∂x|.
    pull_gradient: f64,
}

/// The rate of f_t = g w with g = f_r(ρ)/ρ and w = P_û A δ_t, where A, û, δ_t and the curve itself change at the rates
/// `tensors.1`, `du`, `d_tangential` and `gradient`.
#[expect(clippy::too_many_arguments, reason = "everything changes")]
fn lateral_drift(
    tensors: (Tensor, Tensor),
    u: DVec3,
    du: DVec3,
    deflection: DVec3,
    d_tangential: DVec3,
    curve: Sample,
    gradient: f64,
    f: &Field,
    v: DVec3,
) -> LateralDrift {
    let (a, da) = tensors;
    let project = |v: DVec3| v - u * u.dot(v);
    let stretched = tensor::apply(&a, deflection);
    let turned = tensor::apply(&da, deflection);
    let d_stretched = turned + tensor::apply(&a, d_tangential);
    let w = project(stretched);
    let dw = project(d_stretched) - u * du.dot(stretched) - du * u.dot(stretched);
    let (secant, d_secant, bend) = if f.rho > 0.0 {
        let d_rho = (d_tangential.dot(stretched) + 0.5 * deflection.dot(turned)) / f.rho;
        let secant = curve.value / f.rho;
        let bend = (curve.slope - secant) / f.rho;
        (secant, bend * d_rho + gradient / f.rho, bend / f.rho)
    } else {
        (curve.slope, 0.0, 0.0)
    };
    let force = w * d_secant + dw * secant;
    // ∂f_t/∂x u_t, and the norm of ∂f_t/∂x = B^½ (g I + (f_r' − g) ŝ ŝᵀ) B^½ with B = P A P.
    let along = project(tensor::apply(&a, f.u_t)) * secant + w * (bend * w.dot(f.u_t));
    LateralDrift {
        force: [force, DVec3::ZERO],
        pull: force.dot(v),
        stiffness: greatest_eigenvalue(&a, u) * secant.max(curve.slope),
        pull_gradient: along.length(),
    }
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

impl Field {
    /// (4): the force on the body, N.
    #[inline]
    pub(crate) fn force(&self) -> DVec3 {
        self.u() * self.normal + self.u_t * self.pull
    }

    /// δ_t, m.
    #[inline]
    fn deflection(&self, tip: DVec3) -> DVec3 {
        let (u, offset) = (self.u(), tip - self.c);
        offset - u * offset.dot(u)
    }

    /// Which way slip leads under a tensor: as in an implicit step, along f_t where the contact point will come to rest,
    /// not where it starts. On a uniform plane one iterate is then exact, with and without friction.
    ///
    /// While c moves by λ v, f_t = g A δ_t goes to g A (δ_t − λ v), and that is L v if (λ A + ℓ I) v = w, with w = A δ_t
    /// and ℓ = L/g. In the plane (tr(A) I − A) A = det(A) I, so that v ∝ ℓ w + λ det(A) δ_t: along the force where little
    /// is left to go, straight under the tip where there is no friction. λ makes v's length 1.
    pub(crate) fn aim(&self, tip: DVec3) -> DVec3 {
        let deflection = self.deflection(tip);
        // ρ² = δ_t·w gives |w|; everything in units of it from here on.
        let square = self.rho * self.rho;
        let length = square / deflection.dot(self.u_t);
        let (rest, stretch) = (self.limit / self.pull, square / (length * length));
        // A's trace in the plane is 2, and w·A w = tr(A) |w|² − det(A) ρ²; its eigenvalues are 1 ± spread.
        let determinant = ((2.0 * square - length * length) / deflection.length_squared()).clamp(0.0, 1.0);
        let along = 2.0 - determinant * stretch;
        let spread = (1.0 - determinant).sqrt();
        let share =
            if spread > 1e-6 { ((along - 1.0 + spread) / (2.0 * spread)).clamp(0.0, 1.0) } else { 1.0 };
        let parts = [(share, 1.0 + spread), (1.0 - share, 1.0 - spread)];
        // |(λ A + ℓ I)⁻¹ w| = 1 by Newton's method on the reciprocal, which is nearly linear in λ.
        let mut way = (1.0 - rest) / along;
        for _ in 0..2 {
            let (mut h2, mut fall) = (0.0, 0.0);
            for (part, eigenvalue) in parts {
                let per = 1.0 / (rest + way * eigenvalue);
                h2 += part * per * per;
                fall += part * eigenvalue * per * per * per;
            }
            let h = h2.sqrt();
            way = (way + h2 * (h - 1.0) / fall).max(0.0);
        }
        let v = (self.u_t * rest + deflection * (way * determinant / length)).normalize_or(self.u_t);
        // A direction that has lost the force is none.
        if self.pull * self.u_t.dot(v) > self.limit { v } else { self.u_t }
    }

    /// û_c, into the body.
    #[inline]
    pub(crate) fn u(&self) -> DVec3 {
        self.frame * (1.0 / self.frame_length)
    }
}

/// How a field changes while the contact point moves at a fixed tip.
pub(crate) struct Drift {
    /// Rate of f_c, N/m.
    pub force: DVec3,
    /// f_z', N/m.
    pub normal_slope: f64,
    /// (μ f_z)', N/m.
    pub limit_slope: f64,
    /// The greatest stiffness in stick sideways, N/m.
    pub lateral_stiffness: f64,
    /// |∂|f_t|/∂x|, N/m.
    pub pull_gradient: f64,
    /// d(L − f_t·v)/ds of MODEL 5, certificate S: how fast slip takes the drive to its limit, N/m.
    pub eta: f64,
}
