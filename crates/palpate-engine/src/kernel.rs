//! The force law: local frame, deflection, blended responses, stored energy (paper, (1) to (5); MODEL 2).
//!
//! The step is compiled once for each kind of law: see [`crate::force_law`] and [`crate::coupled`].

use crate::drive::Drive;
use crate::force_law::{ForceLaw, ToolMotion};
use crate::walk::Rates;
use glam::DVec3;
use palpate_body::{ContactModel, Node};

/// Which interpolations are switched off, as in the paper's section 5: either makes the force jump at mesh edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ablation {
    /// Both interpolations on.
    #[default]
    None,
    /// The element's own normal instead of the interpolated frame (2).
    Coordinates,
    /// One response for the whole element, the mean of its nodes', instead of (5).
    Responses,
    /// Both switched off.
    Both,
}

/// What fixes the force for a given contact point and tool position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Setting {
    /// Interpolations.
    pub ablation: Ablation,
    /// Radius of the spherical tool, m; 0 for a point.
    pub radius_m: f64,
    /// What multiplies the body's friction coefficients.
    pub friction_scale: f64,
}

impl Setting {
    /// With the body's own friction coefficients.
    pub(crate) fn new(ablation: Ablation, radius_m: f64) -> Self {
        Setting { ablation, radius_m, friction_scale: 1.0 }
    }

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

/// An element prepared for evaluating the law: its nodes, and the coefficients that are blended at the current deflections. Good for
/// many evaluations, as long as the contact point stays in the element.
#[derive(Clone, Copy)]
pub(crate) struct ElementKernel<'a, L: ForceLaw> {
    pub body: &'a ContactModel,
    pub setting: Setting,
    pub element: u32,
    pub nodes: [&'a Node; 3],
    /// Of the element's test points.
    pub coefficients: L::Element<'a>,
    /// What the last evaluation left for derivatives and slip.
    pub stretch: L,
}

/// A deflection, the law's argument.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Deflection {
    /// δz, m.
    pub depth: f64,
    /// δ_t, m.
    pub tangential: DVec3,
    /// δr = |δ_t|, m.
    pub lateral: f64,
    /// Σ n u and its square.
    pub frame: DVec3,
    pub square: f64,
}

impl Deflection {
    /// P_û v.
    #[inline(always)]
    pub fn project(&self, v: DVec3) -> DVec3 {
        v - self.frame * (v.dot(self.frame) / self.square)
    }
}

/// A law's answer at a deflection.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    /// Direction of the lateral force; zero where there is none.
    pub u_t: DVec3,
    /// f_z, N.
    pub normal: f64,
    /// |f_t|, N.
    pub lateral_force: f64,
    /// Estimate of its rate of fall while c moves along it, N/m.
    pub lateral_slope: f64,
    /// μ f_z, N.
    pub limit: f64,
    /// W, J.
    pub energy: f64,
}

/// The state of the force law at one contact point and tool position.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Evaluation {
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
    pub lateral_force: f64,
    /// Estimate of its rate of fall while c moves along u_t, the rest held, N/m: f_c^r' where the body is isotropic.
    pub lateral_slope: f64,
    /// Friction limit L = μ f^z, N.
    pub limit: f64,
    /// W(c, δ) = F^z(δz) + F^r(ρ), J.
    pub energy: f64,
}

impl<'a, L: ForceLaw> ElementKernel<'a, L> {
    /// The element under the contact point.
    #[inline]
    pub fn new(body: &'a ContactModel, setting: Setting, element: u32) -> Self {
        Self::expecting(body, setting, element, [0; 2])
    }

    /// The same, where the deflections are likely to lie in these intervals of the knots.
    #[inline(always)]
    pub fn expecting(body: &'a ContactModel, setting: Setting, element: u32, intervals: [u32; 2]) -> Self {
        let nodes = body.element_nodes(element);
        let coefficients = L::element(body, element, nodes, intervals);
        ElementKernel { body, setting, element, nodes, coefficients, stretch: L::default() }
    }

    /// The intervals of the last deflections.
    #[inline(always)]
    pub fn intervals(&self) -> [u32; 2] {
        L::intervals(&self.coefficients)
    }

    /// Another element; what was looked up stays where it blends the same test points.
    #[inline]
    pub fn move_to(&mut self, element: u32) {
        let before = self.nodes;
        self.element = element;
        self.nodes = self.body.element_nodes(element);
        L::change_element(&mut self.coefficients, self.body, element, [before, self.nodes]);
    }

    /// Corner positions, m.
    #[inline]
    pub fn corners(&self) -> [DVec3; 3] {
        self.nodes.map(|n| n.position)
    }

    /// Σ n u, before normalising.
    #[inline]
    fn frame(&self, n: [f64; 3]) -> DVec3 {
        let [a, b, c] = self.nodes;
        if self.setting.interpolates_frames() {
            a.inward * n[0] + b.inward * n[1] + c.inward * n[2]
        } else {
            (c.position - a.position).cross(b.position - a.position)
        }
    }

    /// Frame (2), deflection, and blended responses (5) for area coordinates `n` and tool reference point `tool_position`.
    #[inline(always)]
    pub fn evaluate(&mut self, n: [f64; 3], tool_position: DVec3) -> Evaluation {
        let [p, q, r] = self.corners();
        let c = p + (q - p) * n[1] + (r - p) * n[2];
        let offset = tool_position - c;
        // δ_t from the frame before it is normalised: the square root need not be waited for.
        let frame = self.frame(n);
        let (square, along) = (frame.length_squared(), offset.dot(frame));
        let tangential = offset - frame * (along / square);
        let lateral = tangential.length();
        let frame_length = square.sqrt();
        // x = p + R û: the radius adds to the depth and leaves the lateral part alone.
        let depth = along / frame_length + self.setting.radius_m;
        let deflection = Deflection { depth, tangential, lateral, frame, square };
        let blending = self.response_coordinates(n);
        let (left, reading) = L::read(&mut self.coefficients, self.body, self.nodes, blending, &deflection);
        self.stretch = left;
        let Reading { u_t, normal, lateral_force, lateral_slope, limit, energy } = reading;
        Evaluation {
            c,
            frame,
            frame_length,
            depth,
            lateral,
            u_t,
            normal,
            lateral_force,
            lateral_slope,
            limit: limit * self.setting.friction_scale,
            energy,
        }
    }

    /// The area coordinates that blend the responses.
    #[inline]
    pub fn response_coordinates(&self, n: [f64; 3]) -> [f64; 3] {
        if self.setting.interpolates_responses() { n } else { [1.0 / 3.0; 3] }
    }

    /// b = (f_z − û·p) δ_t − (δ·û) f_t, N·m: while û turns by dû, W rises by b·dû.
    #[inline]
    pub fn couple(&self, n: [f64; 3], f: &Evaluation) -> DVec3 {
        if L::ISOTROPIC {
            return f.u_t * self.couple_along(f);
        }
        let normal_coupling =
            self.stretch.normal_coupling(&self.coefficients, self.response_coordinates(n), f);
        self.stretch.deflection(f) * (f.normal - normal_coupling)
            - f.u_t * (f.lateral_force * (f.depth - self.setting.radius_m))
    }

    /// |b|, N·m.
    #[inline(always)]
    pub fn couple_length(&self, n: [f64; 3], f: &Evaluation) -> f64 {
        if L::ISOTROPIC { self.couple_along(f).abs() } else { self.couple(n, f).length() }
    }

    /// b's component along u_t, which is all of it where f_t lies along δ_t.
    #[inline(always)]
    fn couple_along(&self, f: &Evaluation) -> f64 {
        f.normal * f.lateral - f.lateral_force * (f.depth - self.setting.radius_m)
    }

    /// [`Rates`] in this element.
    #[inline]
    pub fn rates(&self, v: DVec3) -> Rates {
        Rates::new(self.corners(), v)
    }

    /// See [`ForceLaw::implicit_direction`], at `n`.
    #[inline(always)]
    pub fn implicit_direction(&self, f: &Evaluation) -> DVec3 {
        self.stretch.implicit_direction(f)
    }

    /// See [`ForceLaw::implicit_drive_direction`], at `n`.
    #[inline]
    pub fn implicit_drive_direction(&self, n: [f64; 3], f: &Evaluation, drive: &Drive) -> DVec3 {
        L::implicit_drive_direction(&self.coefficients, self.response_coordinates(n), f, drive)
    }

    /// See [`ForceLaw::tool_motion`], at `n`, where `f` was evaluated.
    #[inline(always)]
    pub fn tool_motion(&self, n: [f64; 3], f: &Evaluation, normal: DVec3) -> Option<ToolMotion> {
        let (radius, n) = (self.setting.radius_m, self.response_coordinates(n));
        let heights = [radius - f.depth, radius];
        L::tool_motion(&self.coefficients, self.body, self.nodes, n, normal, heights)
    }

    /// See [`ForceLaw::slope_ratio`], at `n`.
    #[inline]
    pub fn slope_ratio(&self, n: [f64; 3], old: DVec3, new: DVec3) -> f64 {
        L::slope_ratio(&self.coefficients, self.response_coordinates(n), old, new)
    }

    /// How `f`, just evaluated here at `n`, changes while c moves with the projection of the unit vector `v`.
    #[inline(never)]
    pub fn drift(&mut self, n: [f64; 3], f: &Evaluation, v: DVec3) -> Drift {
        let r = self.rates(v).each();
        let [p, q, s] = self.corners();
        let t = (q - p) * r[1] + (s - p) * r[2];
        let u = f.u();
        let du = if self.setting.interpolates_frames() {
            let frame_rate = self.frame(r);
            (frame_rate - u * u.dot(frame_rate)) * (1.0 / f.frame_length)
        } else {
            DVec3::ZERO
        };

        // δ = p − c changes by −t, and with it δz = δ·û + R and δ_t = δ − (δ·û) û.
        let d_depth = self.stretch.along_deflection(f, du) - t.dot(u);
        let d_tangential = -t - u * d_depth - du * (f.depth - self.setting.radius_m);
        // (5) is linear in the area coordinates: their rates blend the coefficients' own gradient.
        let blending = self.response_coordinates(n);
        let along = if self.setting.interpolates_responses() { r } else { [0.0; 3] };
        let friction_scale = self.setting.friction_scale;
        let change = Change { blending, along, u, du, d_depth, d_tangential, v, friction_scale };
        self.stretch.drift(&mut self.coefficients, self.body, self.nodes, f, &change)
    }
}

/// How the deflection and the blend change while c moves.
pub(crate) struct Change {
    /// The area coordinates that blend the coefficients, and their rates, 1/m.
    pub blending: [f64; 3],
    pub along: [f64; 3],
    /// û and its rate, 1/m.
    pub u: DVec3,
    pub du: DVec3,
    /// The rates of δz and δ_t.
    pub d_depth: f64,
    pub d_tangential: DVec3,
    /// Direction in which c moves, a unit vector.
    pub v: DVec3,
    /// See [`Setting::friction_scale`].
    pub friction_scale: f64,
}

impl Evaluation {
    /// (4): the force on the body, N.
    #[inline]
    pub(crate) fn force(&self) -> DVec3 {
        self.u() * self.normal + self.u_t * self.lateral_force
    }

    /// û_c, into the body.
    #[inline]
    pub(crate) fn u(&self) -> DVec3 {
        self.frame * (1.0 / self.frame_length)
    }
}

/// How an evaluation changes while the contact point moves at a fixed tool position.
pub(crate) struct Drift {
    /// Rate of f_c, N/m.
    pub force: DVec3,
    /// f_z', N/m.
    pub normal_slope: f64,
    /// (μ f_z)', N/m.
    pub limit_slope: f64,
    /// The greatest stiffness in stick along the surface, N/m.
    pub lateral_stiffness: f64,
    /// |∂|f_t|/∂x|, N/m.
    pub lateral_force_gradient: f64,
    /// d(L − f_t·v)/ds of MODEL 5, certificate S: how fast slip takes the drive to its limit, N/m.
    pub eta: f64,
}
