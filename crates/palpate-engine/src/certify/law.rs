//! The force law over a cell: every question that the certificates ask of a body's responses, answered in intervals. This
//! is the decoupled law, f_z(δz) and f_r(ρ); what another one has to answer is what is public here, and in
//! [`Slopes`](super::slopes::Slopes) of its energies' gradients.

use super::curves::{Corners, Curves};
use super::interval::Interval;
use super::patch::{Cell, WHOLE};
use palpate_body::{Body, Node};

/// The responses of an element's three nodes.
#[derive(Debug, Clone)]
pub(super) struct Law {
    normal: Curves,
    lateral: Curves,
    friction: Curves,
}

/// f_z and f_r, N, and μ; or how they change, by the metre.
#[derive(Debug, Clone, Copy)]
pub(super) struct Forces {
    pub normal: Interval,
    pub lateral: Interval,
    pub friction: Interval,
}

/// The forces over a cell, and how they change with the deflections.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    pub at: Forces,
    /// f_z', f_r' and μ'.
    pub slope: Forces,
    /// g = f_r/ρ, N/m.
    pub secant: Interval,
    /// f_r' − f_r/ρ, N/m.
    pub bend: Interval,
}

impl Reading {
    /// (μ f_z)', N/m.
    pub fn limit_slope(&self) -> Interval {
        self.slope.friction * self.at.normal + self.at.friction * self.slope.normal
    }

    /// How L changes while δz does, and the responses do `along` the surface.
    pub fn limit_rate(&self, d_depth: Interval, along: &Forces) -> Interval {
        self.limit_slope() * d_depth + along.friction * self.at.normal + self.at.friction * along.normal
    }

    /// The greatest stiffness in stick, N/m, A's greatest eigenvalue being `stretch`.
    pub fn stiffness(&self, stretch: f64) -> f64 {
        self.slope.normal.hi.max(self.lateral_stiffness(stretch))
    }

    /// The same laterally.
    pub fn lateral_stiffness(&self, stretch: f64) -> f64 {
        stretch * self.slope.lateral.hi.max(self.secant.hi)
    }
}

impl Law {
    /// Of an element's nodes, with friction times `factor`.
    pub fn new(body: &Body, nodes: [&Node; 3], factor: f64) -> Self {
        let responses = body.responses();
        let (depths, laterals) = (responses.depth_knots().values(), responses.lateral_knots().values());
        let depth_rows: Vec<[[f64; 9]; 3]> = depths
            .iter()
            .map(|&k| nodes.map(|n| responses.depth_rows(n.test_points, k).blend(n.weights)))
            .collect();
        let lateral = laterals.iter().map(|&k| {
            nodes.map(|n| {
                let [integral, a, b, c, d] = responses.lateral_rows(n.test_points, k).blend(n.weights);
                ([a, b, c, d], integral)
            })
        });
        let normal = depth_rows.iter().map(|r| r.map(|[i, a, b, c, d, ..]| ([a, b, c, d], i)));
        let friction =
            depth_rows.iter().map(|r| r.map(|[.., a, b, c, d]| ([a, b, c, d].map(|x| x * factor), 0.0)));
        Law {
            normal: Curves::new(depths, normal.collect()),
            lateral: Curves::new(laterals, lateral.collect()),
            friction: Curves::new(depths, friction.collect()),
        }
    }

    /// The curves of f_z and f_r.
    pub fn curves(&self) -> [&Curves; 2] {
        [&self.normal, &self.lateral]
    }

    /// The forces over a cell.
    pub fn forces(&self, cell: &Cell) -> Forces {
        let c = &cell.corners;
        Forces {
            normal: self.normal.rising(c, cell.depth_m),
            lateral: self.lateral.rising(c, cell.reach_m),
            friction: self.friction.hull(c, cell.depth_m),
        }
    }

    /// And how they change.
    pub fn reading(&self, cell: &Cell) -> Reading {
        let (c, z, r) = (&cell.corners, cell.depth_m, cell.reach_m);
        Reading {
            at: self.forces(cell),
            slope: Forces {
                normal: self.normal.slope(c, z),
                lateral: self.lateral.slope(c, r),
                friction: self.friction.slope(c, z),
            },
            secant: self.lateral.secant(c, r),
            bend: self.lateral.bend(c, r),
        }
    }

    /// Σ g_l of the nodes' forces and friction, for a gradient of the area coordinates.
    pub fn gradient(&self, cell: &Cell, g: [f64; 3]) -> Forces {
        Forces {
            normal: self.normal.gradient(g, cell.depth_m),
            lateral: self.lateral.gradient(g, cell.reach_m),
            friction: self.friction.gradient(g, cell.depth_m),
        }
    }

    /// Σ g_l F_l/f of the normal and the lateral energies and forces, m, for two gradients.
    pub fn energies_by_force(&self, cell: &Cell, g: [[f64; 3]; 2]) -> [[Interval; 2]; 2] {
        [
            self.normal.energy_gradient(&cell.corners, g, cell.depth_m),
            self.lateral.energy_gradient(&cell.corners, g, cell.reach_m),
        ]
    }

    /// f_z − g (δz − R), N.
    pub fn normal_less(&self, cell: &Cell, secant: Interval, radius_m: f64) -> Interval {
        self.normal.above_line(&cell.corners, cell.depth_m, secant, radius_m)
    }

    /// The most that friction holds at depths, N.
    pub fn held(&self, corners: &Corners, depths: [f64; 2]) -> f64 {
        self.friction.hull(corners, depths).hi * self.normal.rising(corners, depths).hi
    }

    /// The least lateral force at a deflection ρ, N.
    pub fn least_lateral(&self, corners: &Corners, reach: f64) -> f64 {
        self.lateral.rising(corners, [reach; 2]).lo
    }

    /// f_r at a state, N.
    #[cfg(test)]
    pub fn lateral_at(&self, n: [f64; 3], reach: f64) -> f64 {
        self.lateral.value(n, reach)
    }

    /// The deflection, up to `most`, with which f_r is L divided by `gain` at a state, m.
    pub fn limit_reach(&self, n: [f64; 3], depth: f64, gain: f64, most: f64) -> f64 {
        let limit = self.friction.value(n, depth) * self.normal.value(n, depth);
        self.lateral.root(n, limit / gain, most)
    }

    /// The deflection, m, to which friction holds anywhere on the element down to a depth; f_r is at least `gain` times the
    /// lateral curve's.
    pub fn farthest(&self, depth: f64, gain: f64) -> f64 {
        self.lateral.reaches(self.held(&WHOLE, [0.0, depth]) / gain)
    }

    /// The last knots of δz and ρ, m.
    pub fn ends(&self) -> [f64; 2] {
        [self.normal.end(), self.lateral.end()]
    }
}
