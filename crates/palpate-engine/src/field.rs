//! The force law: local frame, deflection, mixed responses, stored energy (paper, (1) to (5); MODEL 2).
//!
//! What is sideways depends on whether the body is anisotropic: see [`crate::lateral`].

use crate::drive::Drive;
use crate::lateral::{Change, Lateral};
use crate::walk::Rates;
use glam::DVec3;
use palpate_body::{ContactModel, Node, Rows, Sample, Strain};
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
    #[inline]
    pub(crate) fn interpolates_frames(self) -> bool {
        matches!(self.ablation, Ablation::None | Ablation::Responses)
    }

    #[inline]
    pub(crate) fn interpolates_responses(self) -> bool {
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
pub(crate) struct Site<'a, L: Lateral> {
    pub body: &'a ContactModel,
    pub law: Law,
    pub element: u32,
    pub nodes: [&'a Node; 3],
    mix: Mix,
    depth: Rows<'a, 9>,
    lateral: Rows<'a, 5>,
    tensors: L::Nodes<'a>,
    /// What the last evaluation left for derivatives and slip.
    pub stretch: L,
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
    pub frame_length: f64,
    /// δz, m.
    pub depth: f64,
    /// δr, m.
    pub lateral: f64,
    /// Direction of the lateral force f_t, that of the lateral deflection where the body is isotropic; zero where
    /// there is none.
    pub u_t: DVec3,
    /// f_c^z, N.
    pub normal: f64,
    /// |f_t|, N: f_c^r where the body is isotropic.
    pub pull: f64,
    /// About how fast it falls when c moves along u_t, the rest held, N/m: f_c^r' where the body is isotropic.
    pub pull_slope: f64,
    /// Friction limit L = μ f^z, N.
    pub limit: f64,
    /// W(c, δ) = F^z(δz) + F^r(ρ), J.
    pub energy: f64,
}

impl<'a, L: Lateral> Site<'a, L> {
    /// The element under the contact point.
    #[inline]
    pub fn new(body: &'a ContactModel, law: Law, element: u32) -> Self {
        let nodes = body.element_nodes(element);
        Site {
            body,
            law,
            element,
            nodes,
            mix: Mix::of(nodes),
            depth: Rows::NONE,
            lateral: Rows::NONE,
            tensors: L::nodes(body, element),
            stretch: L::default(),
        }
    }

    /// Another element; the curves stay where it mixes the same test points.
    #[inline]
    pub fn move_to(&mut self, element: u32) {
        let (mix, points) = (self.mix, self.points());
        self.element = element;
        self.nodes = self.body.element_nodes(element);
        self.tensors = L::nodes(self.body, element);
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

    /// Where the energies of test points are, for `f`, which was just evaluated.
    #[inline]
    pub fn strain(&self, f: &Field) -> Strain<'a> {
        self.body.responses().strain([f.depth, self.stretch.rho(f)], (&self.depth, &self.lateral))
    }

    /// The test points that all nodes mix, if they are the same.
    #[inline]
    pub fn shared(&self) -> Option<[u32; 3]> {
        (self.mix == Mix::Shared).then_some(self.nodes[0].test_points)
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

    /// Frame (2), deflection, and mixed responses (5) for area coordinates `n` and tool reference point `tip`.
    #[inline(always)]
    pub fn evaluate(&mut self, n: [f64; 3], tip: DVec3) -> Field {
        let [p, q, r] = self.corners();
        let c = p + (q - p) * n[1] + (r - p) * n[2];
        let offset = tip - c;
        // δ_t from the frame before it is normalised: the square root need not be waited for.
        let frame = self.frame(n);
        let (square, along) = (frame.length_squared(), offset.dot(frame));
        let tangential = offset - frame * (along / square);
        let lateral = tangential.length();
        let (stretch, rho, u_t) = L::of(
            || L::mix(self.tensors, self.response_coordinates(n)),
            tangential,
            lateral,
            |v| v - frame * (v.dot(frame) / square),
        );
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
        let (pull, pull_slope) = stretch.pull(pull, slope);
        self.stretch = stretch;
        Field {
            c,
            frame,
            frame_length,
            depth,
            lateral,
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

    /// b = (f_z − g û·A δ_t) δ_t − (δ·û) f_t, N·m: while û turns by dû, W rises by b·dû.
    #[inline]
    pub fn leverage(&self, n: [f64; 3], f: &Field) -> DVec3 {
        let aside = self.stretch.beside(|| L::mix(self.tensors, self.response_coordinates(n)), f);
        self.stretch.deflection(f) * (f.normal - aside) - f.u_t * (f.pull * (f.depth - self.law.radius_m))
    }

    /// δ_t·A_l δ_t of each node, m².
    #[inline]
    pub fn squares(&self, f: &Field) -> [f64; 3] {
        L::squares(self.tensors, self.stretch.deflection(f))
    }

    /// [`Rates`] in this element.
    #[inline]
    pub fn rates(&self, v: DVec3) -> Rates {
        Rates::new(self.corners(), v)
    }

    /// See [`Lateral::lead`], at `n`.
    #[inline]
    pub fn lead(&self, n: [f64; 3], f: &Field, drive: &Drive) -> DVec3 {
        L::lead(|| L::mix(self.tensors, self.response_coordinates(n)), f, drive)
    }

    /// See [`Lateral::turned`], at `n`.
    #[inline]
    pub fn turned(&self, n: [f64; 3], old: DVec3, new: DVec3) -> f64 {
        L::turned(|| L::mix(self.tensors, self.response_coordinates(n)), old, new)
    }

    /// How `f`, just evaluated here at `n`, changes while c moves with the projection of the unit vector `v`.
    #[inline(never)]
    pub fn drift(&mut self, n: [f64; 3], f: &Field, v: DVec3) -> Drift {
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
        let d_depth = self.stretch.along_deflection(f, du) - t.dot(u);
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
        let change = Change { u, du, d_tangential, curve: pull, gradient: pull_gradient.value };
        let lateral = self.stretch.drift(|| [mixing, along].map(|n| L::mix(self.tensors, n)), f, v, &change);
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
        let rho = self.stretch.rho(f);
        let ([i, z0, z1, z2, z3, m0, m1, m2, m3], [j, r0, r1, r2, r3]) = self.mixed(n, f.depth, rho);
        let (t, s) = (self.depth.distance(f.depth), self.lateral.distance(rho));
        let normal = if f.depth > 0.0 { Sample::at(i, [z0, z1, z2, z3], t) } else { Sample::default() };
        (normal, Sample::at(0.0, [m0, m1, m2, m3], t), Sample::at(j, [r0, r1, r2, r3], s))
    }
}

impl Field {
    /// (4): the force on the body, N.
    #[inline]
    pub(crate) fn force(&self) -> DVec3 {
        self.u() * self.normal + self.u_t * self.pull
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
