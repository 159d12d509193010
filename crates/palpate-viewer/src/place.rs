//! The law at a place of the body, whichever law the body has: what panels plot and colourings show.

use glam::DVec3;
use palpate::Body;
use palpate::engine::ContactPoint;

/// Test points and their weights, of one place.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Place {
    /// (test point, weight) with weights above 0.
    pub terms: Vec<(u32, f64)>,
}

/// What the law says straight in, at a depth.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Press {
    /// f_z, N.
    pub force_n: f64,
    /// Its slope, N/m.
    pub stiffness_n_per_m: f64,
    /// Stiffness along the surface, N/m: of a decoupled law at its beginning, of a coupled one at this depth, the mean of all
    /// directions.
    pub lateral_n_per_m: f64,
    /// Friction coefficient.
    pub friction: f64,
    /// Stored, J.
    pub energy_j: f64,
}

impl Place {
    /// At a contact point.
    pub fn of(body: &Body, contact: &ContactPoint) -> Self {
        let mut place = Place::default();
        for (node, share) in body.element_nodes(contact.element).into_iter().zip(contact.n) {
            place.add(node.test_points, node.weights, share);
        }
        place
    }

    /// At a node.
    pub fn of_node(body: &Body, node: usize) -> Self {
        let mut place = Place::default();
        if let Some(n) = body.nodes().get(node) {
            place.add(n.test_points, n.weights, 1.0);
        }
        place
    }

    fn add(&mut self, points: [u32; 3], weights: [f64; 3], share: f64) {
        for (t, w) in points.into_iter().zip(weights) {
            if w * share > 0.0 {
                match self.terms.iter_mut().find(|(known, _)| *known == t) {
                    Some((_, weight)) => *weight += w * share,
                    None => self.terms.push((t, w * share)),
                }
            }
        }
    }

    /// What the blended law says straight in.
    pub fn press(&self, body: &Body, depth_m: f64) -> Press {
        self.terms.iter().fold(Press::default(), |sum, &(t, w)| {
            let p = press(body, t, depth_m);
            Press {
                force_n: sum.force_n + w * p.force_n,
                stiffness_n_per_m: sum.stiffness_n_per_m + w * p.stiffness_n_per_m,
                lateral_n_per_m: sum.lateral_n_per_m + w * p.lateral_n_per_m,
                friction: sum.friction + w * p.friction,
                energy_j: sum.energy_j + w * p.energy_j,
            }
        })
    }

    /// The lateral force at a lateral deflection, N, of a decoupled law alike in all directions; of a coupled one K r at this
    /// depth, its terms of second order.
    pub fn lateral_force_n(&self, body: &Body, depth_m: f64, lateral_m: f64) -> f64 {
        let of = |t: u32| match (body.curves().get(t as usize), body.coupled_law()) {
            (Some(response), _) => response.lateral.value(lateral_m),
            (None, Some(law)) => law.potentials.get(t as usize).map_or(0.0, |p| {
                let [a, b] = p.principal_stiffness(depth_m);
                0.5 * (a + b) * lateral_m
            }),
            (None, None) => 0.0,
        };
        self.terms.iter().map(|&(t, w)| w * of(t)).sum()
    }
}

/// What one test point's law says straight in.
pub fn press(body: &Body, test_point: u32, depth_m: f64) -> Press {
    let depth = depth_m.max(0.0);
    if let Some(r) = body.curves().get(test_point as usize) {
        return Press {
            force_n: r.normal.value(depth),
            stiffness_n_per_m: r.normal.slope(depth),
            lateral_n_per_m: r.lateral.slope(0.0),
            friction: r.friction.value(depth),
            energy_j: r.normal.integral(depth),
        };
    }
    let Some(p) = body.coupled_law().and_then(|law| law.potentials.get(test_point as usize)) else {
        return Press::default();
    };
    let [a, b] = p.principal_stiffness(depth);
    Press {
        force_n: p.press.slope(depth),
        stiffness_n_per_m: p.press.bend(depth),
        lateral_n_per_m: 0.5 * (a + b),
        friction: p.friction.value(depth),
        energy_j: p.press.value(depth),
    }
}

/// How deep the body's curves go, m.
pub fn depth_range_m(body: &Body) -> f64 {
    let knots = body.responses().depth_knots().values();
    knots.last().copied().filter(|d| *d > 0.0).unwrap_or(5e-3)
}

/// How far the body's curves go laterally, m.
pub fn lateral_range_m(body: &Body) -> f64 {
    if body.is_coupled() {
        return body.potentials().range_m();
    }
    let knots = body.responses().lateral_knots().values();
    knots.last().copied().filter(|d| *d > 0.0).unwrap_or(3e-3)
}

/// The tool's foremost point as the contact point's frame sees it, m: that which touches.
pub fn tip_m(body: &Body, contact: &ContactPoint, tool_m: DVec3) -> DVec3 {
    tool_m + inward(body, contact) * body.tool().radius_m()
}

/// The blended unit vector into the body at a contact point.
pub fn inward(body: &Body, contact: &ContactPoint) -> DVec3 {
    body.inward(palpate::body::SurfacePoint { element: contact.element, n: contact.n })
}
