//! Keeps the tool from showing through the deformed surface.

use crate::Body;
use crate::search::{nearest_on_triangle, point};
use glam::DVec3;

/// Within this share of the depth of the tool nodes lift off it little by little, so that the patch has no edge.
const SOFT_SHARE: f64 = 0.02;
/// Facets that still cut into the tool are lifted so often; each time what is left goes with the square.
const ROUNDS: usize = 4;
/// No node is lifted by more than what is missing over this: one that lies beside the ball would fly away.
const LEAST_ALONG: f64 = 0.4;

/// Room for what is found, reused.
#[derive(Debug, Clone, Default)]
pub(super) struct Clearance {
    /// Elements near the tool.
    near: Vec<u32>,
    /// For each vertex how far it has to be lifted, m.
    lift: Vec<f64>,
    lifted: Vec<u32>,
}

impl Clearance {
    /// Moves nodes out of a ball, away from its centre: first those in it, then those of facets that cut it. A function of the
    /// positions, and continuous in them but at the ball's centre.
    pub fn push_out(&mut self, body: &Body, centre: DVec3, radius: f64, depth: f64, positions: &mut [DVec3]) {
        let soft = (SOFT_SHARE * depth).min(0.1 * radius);
        for p in positions.iter_mut() {
            let out = *p - centre;
            let distance = out.length();
            if distance < radius + soft {
                let over = (distance - radius + soft).max(0.0);
                *p = centre + out.normalize_or_zero() * (radius + over * over / (4.0 * soft));
            }
        }
        let elements = body.elements();
        let corners = |positions: &[DVec3], e: u32| elements[e as usize].nodes.map(|n| positions[n as usize]);
        self.near.clear();
        for (e, element) in elements.iter().enumerate() {
            let [a, b, c] = element.nodes.map(|n| positions[n as usize]);
            let [ab, ac, from] = [b - a, c - a, a - centre];
            // What is farther from a corner than the longer edge there is not in the facet.
            let reach = radius + ab.length_squared().max(ac.length_squared()).sqrt();
            if from.length_squared() < reach * reach {
                self.near.push(e as u32);
            }
        }
        self.lift.resize(positions.len(), 0.0);
        for _ in 0..ROUNDS {
            for &e in &self.near {
                let facet = corners(positions, e);
                let nearest = point(facet, nearest_on_triangle(centre, facet)) - centre;
                let missing = radius - nearest.length();
                if missing <= 0.0 {
                    continue;
                }
                let out = nearest.normalize_or_zero();
                for n in elements[e as usize].nodes {
                    let vertex = body.vertices[n as usize] as usize;
                    if self.lift[vertex] == 0.0 {
                        self.lifted.push(vertex as u32);
                    }
                    // Away from the centre, so far that the facet's nearest point comes out.
                    let along = (positions[n as usize] - centre).normalize_or_zero().dot(out);
                    self.lift[vertex] = self.lift[vertex].max(missing / along.max(LEAST_ALONG));
                }
            }
            if self.lifted.is_empty() {
                break;
            }
            // All nodes of a vertex alike, or a crease would tear.
            for (p, &vertex) in positions.iter_mut().zip(&body.vertices) {
                let lift = self.lift[vertex as usize];
                if lift > 0.0 {
                    *p += (*p - centre).normalize_or_zero() * lift;
                }
            }
            self.lifted.drain(..).for_each(|v| self.lift[v as usize] = 0.0);
        }
    }
}
