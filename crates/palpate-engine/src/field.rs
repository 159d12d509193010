//! The force law: local frame, deflection, mixed responses, stored energy (paper, (1) to (5); MODEL 2).

use glam::DVec3;
use palpate_body::{Body, Node, Sample, SurfacePoint};

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
pub struct Law {
    /// Interpolations.
    pub ablation: Ablation,
    /// Radius of the spherical tool, m; 0 for a point.
    pub radius_m: f64,
}

/// The state of the force law at one contact point and tip.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Field {
    /// û_c, into the body.
    pub u: DVec3,
    /// |Σ n u| before normalising.
    pub u_length: f64,
    /// δz, m.
    pub depth: f64,
    /// δr, m.
    pub lateral: f64,
    /// Direction of the lateral deflection; zero where there is none.
    pub u_r: DVec3,
    /// f_c^z, its slope, its energy.
    pub normal: Sample,
    /// μ_c and its slope.
    pub friction: Sample,
    /// f_c^r, its slope, its energy.
    pub pull: Sample,
    /// Friction limit L = μ f^z, N.
    pub limit: f64,
}

impl Law {
    /// The frame's û before normalising.
    #[inline]
    pub(crate) fn frame(&self, nodes: [&Node; 3], n: [f64; 3]) -> DVec3 {
        match self.ablation {
            Ablation::None | Ablation::Responses => {
                nodes[0].inward * n[0] + nodes[1].inward * n[1] + nodes[2].inward * n[2]
            }
            Ablation::Coordinates | Ablation::Both => {
                let [a, b, c] = nodes.map(|n| n.position);
                (c - a).cross(b - a)
            }
        }
    }

    /// The area coordinates that mix the responses.
    #[inline]
    pub(crate) fn response_coordinates(&self, n: [f64; 3]) -> [f64; 3] {
        match self.ablation {
            Ablation::None | Ablation::Coordinates => n,
            Ablation::Responses | Ablation::Both => [1.0 / 3.0; 3],
        }
    }

    /// Whether frames and responses agree on the two sides of every edge that is no crease.
    #[inline]
    pub(crate) fn is_continuous(&self) -> bool {
        self.ablation == Ablation::None
    }

    /// Frame (2), deflection, and mixed responses (5) for contact point `at` and tool reference point `tip`.
    #[inline]
    pub(crate) fn evaluate(&self, body: &Body, at: SurfacePoint, tip: DVec3) -> Field {
        let nodes = body.element_nodes(at.element);
        let c = nodes[0].position
            + (nodes[1].position - nodes[0].position) * at.n[1]
            + (nodes[2].position - nodes[0].position) * at.n[2];
        let frame = self.frame(nodes, at.n);
        let u_length = frame.length();
        let u = frame / u_length;

        // x = p + R û: the radius adds to the depth and leaves the lateral part alone.
        let offset = tip - c;
        let height = offset.dot(u);
        let depth = height + self.radius_m;
        let tangential = offset - u * height;
        let lateral = tangential.length();
        let u_r = if lateral > 0.0 { tangential / lateral } else { DVec3::ZERO };

        let mixture = Body::mixture(nodes, self.response_coordinates(at.n));
        let (mut normal, friction) = body.responses().normal_and_friction(&mixture, depth);
        if depth <= 0.0 {
            normal = Sample::default();
        }
        let pull = body.responses().lateral(&mixture, lateral);
        Field { u, u_length, depth, lateral, u_r, normal, friction, pull, limit: friction.value * normal.value }
    }
}

impl Field {
    /// (4): the force on the body, N.
    #[inline]
    pub(crate) fn force(&self) -> DVec3 {
        self.u * self.normal.value + self.u_r * self.pull.value
    }

    /// W(c, δ) = F^z(δz) + F^r(δr), J.
    #[inline]
    pub(crate) fn energy(&self) -> f64 {
        self.normal.energy + self.pull.energy
    }

    /// (μ f^z)', N/m.
    #[inline]
    pub(crate) fn limit_slope(&self) -> f64 {
        self.friction.slope * self.normal.value + self.friction.value * self.normal.slope
    }
}
