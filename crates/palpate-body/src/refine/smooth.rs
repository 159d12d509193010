//! The smooth surface of a body (LAW 6): Phong tessellation (Boubekeur and Alexa 2008) with the factor ½.
//!
//! With p on the facet, nodes i with unit normals N_i and area coordinates n_i,
//!
//! ```text
//! p* = p − ½ Σ n_i ((p − p_i)·N_i) N_i = p + Σ n_i n_j d_ij,
//! d_ij = ½ ((e·N_j) N_j − (e·N_i) N_i),  e = p_j − p_i,
//! ```
//!
//! the sum over the three edges: a quadratic triangle whose edges bulge by d_ij/4 in their middle, whichever element they are
//! seen from. Along a crease an end has two normals, N and M, and is projected onto the crease's tangent N × M in place of the
//! tangent plane, so that both sides bulge alike.

use crate::body::Body;
use crate::surface::{Element, NO_TWIN, Surface};
use glam::DVec3;

/// A facet that turns by more than this (its cosine) against a node's normal is no part of a smooth surface there: at the
/// edge of a block (45°) it would bulge out of flat faces. Those of an icosahedron turn by 37°.
const SHARP: f64 = 0.766; // 40°

/// An edge of the coarse mesh, from the element that comes first.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    /// Half-edge: 3 × element + edge.
    pub half: u32,
    /// d, m.
    pub bend: DVec3,
    /// Whether its two sides have nodes of their own.
    pub creased: bool,
}

/// Facets with nodal normals.
pub(super) trait Facets {
    fn elements(&self) -> &[Element];
    /// Of a node, m.
    fn position(&self, node: u32) -> DVec3;
    /// Of a node, a unit vector.
    fn inward(&self, node: u32) -> DVec3;
}

impl Facets for Body {
    fn elements(&self) -> &[Element] {
        &self.elements
    }

    fn position(&self, node: u32) -> DVec3 {
        self.nodes[node as usize].position
    }

    fn inward(&self, node: u32) -> DVec3 {
        self.nodes[node as usize].inward
    }
}

impl Facets for Surface {
    fn elements(&self) -> &[Element] {
        &self.elements
    }

    fn position(&self, node: u32) -> DVec3 {
        self.positions[node as usize]
    }

    fn inward(&self, node: u32) -> DVec3 {
        self.inward[node as usize]
    }
}

/// The edges of a body, and how they bulge.
pub(super) struct SmoothSurface {
    pub edges: Vec<Edge>,
    /// The edge of each half-edge, (elements × 3).
    pub edge_of: Vec<[u32; 3]>,
    sharp: Vec<bool>,
}

impl SmoothSurface {
    pub fn of(body: &impl Facets) -> Self {
        let sharp = sharp_nodes(body);
        let mut edges: Vec<Edge> = Vec::with_capacity(body.elements().len() * 3 / 2 + 1);
        let mut edge_of = vec![[0; 3]; body.elements().len()];
        for (e, element) in body.elements().iter().enumerate() {
            for (i, &twin) in element.twins.iter().enumerate() {
                let half = (3 * e + i) as u32;
                edge_of[e][i] = if twin != NO_TWIN && twin < half {
                    edge_of[twin as usize / 3][twin as usize % 3]
                } else {
                    edges.push(edge(body, &sharp, half, twin));
                    edges.len() as u32 - 1
                };
            }
        }
        SmoothSurface { edges, edge_of, sharp }
    }

    /// d of an element's edges, in its order, m.
    pub fn bends(&self, element: u32) -> [DVec3; 3] {
        self.edge_of[element as usize].map(|edge| self.edges[edge as usize].bend)
    }

    /// The point of the smooth surface at an element's area coordinates, m.
    pub fn point(&self, body: &impl Facets, element: u32, n: [f64; 3]) -> DVec3 {
        let [ab, bc, ca] = self.bends(element);
        let [a, b, c] = body.elements()[element as usize].nodes.map(|n| body.position(n));
        a * n[0] + b * n[1] + c * n[2] + ab * (n[0] * n[1]) + bc * (n[1] * n[2]) + ca * (n[2] * n[0])
    }

    pub fn sharp_nodes(&self) -> usize {
        self.sharp.iter().filter(|&&sharp| sharp).count()
    }
}

fn edge(body: &impl Facets, sharp: &[bool], half: u32, twin: u32) -> Edge {
    let end = |half: u32, end: usize| body.elements()[half as usize / 3].nodes[(half as usize + end) % 3];
    let here = [end(half, 0), end(half, 1)];
    let there = if twin == NO_TWIN { here } else { [end(twin, 1), end(twin, 0)] };
    let along = body.position(here[1]) - body.position(here[0]);
    // How far the edge points out of what is tangent at an end.
    let out = |end: usize| {
        let [n, m] = [here[end], there[end]];
        if sharp[n as usize] || sharp[m as usize] {
            return DVec3::ZERO;
        }
        let [u, v] = [n, m].map(|n| body.inward(n));
        let tangent = u.cross(v);
        // Normals nearly alike have no tangent to speak of, and need none.
        if tangent.length() > 0.05 {
            let tangent = tangent.normalize();
            return along - tangent * along.dot(tangent);
        }
        u * along.dot(u)
    };
    Edge { half, bend: (out(1) - out(0)) * 0.5, creased: here != there }
}

fn sharp_nodes(body: &impl Facets) -> Vec<bool> {
    let nodes = body.elements().iter().flat_map(|e| e.nodes).max().map_or(0, |n| n as usize + 1);
    let mut sharp = vec![false; nodes];
    for element in body.elements() {
        let [a, b, c] = element.nodes.map(|n| body.position(n));
        let inward = (c - a).cross(b - a).normalize_or_zero();
        for n in element.nodes {
            sharp[n as usize] |= body.inward(n).dot(inward) < SHARP;
        }
    }
    sharp
}
