//! Curved quadratic tetrahedra: how far their nodes may be moved.

use super::{EDGES, TetMesh};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Elements whose Jacobian falls below this share of its mean are kept as they were.
const LEAST_JACOBIAN: f64 = 0.3;

impl TetMesh {
    /// Moves nodes to these places (m), but for those that would spoil an element; returns how many stay for that.
    pub fn move_nodes(&mut self, mut targets: BTreeMap<u32, DVec3>) -> usize {
        let asked = targets.len();
        move_nodes(self, &mut targets);
        asked - targets.len()
    }
}

/// Moves nodes to their `targets`; takes back, and out of these, those that spoil an element.
pub(super) fn move_nodes(mesh: &mut TetMesh, targets: &mut BTreeMap<u32, DVec3>) {
    let touched = mesh.elements.iter().enumerate().filter(|(_, e)| e.iter().any(|n| targets.contains_key(n)));
    let touched: Vec<u32> = touched.map(|(e, _)| e as u32).collect();
    let before: BTreeMap<u32, DVec3> =
        targets.iter().map(|(&n, &to)| (n, std::mem::replace(&mut mesh.positions[n as usize], to))).collect();
    // Taking one back may spoil a neighbour: go on until all are good. As they were all are.
    loop {
        let bad: Vec<u32> = touched
            .par_iter()
            .copied()
            .filter(|e| jacobian_ratio(&mesh.positions, &mesh.elements[*e as usize]) < LEAST_JACOBIAN)
            .collect();
        let mut back = false;
        for n in bad.iter().flat_map(|e| &mesh.elements[*e as usize]) {
            if targets.remove(n).is_some() {
                mesh.positions[*n as usize] = before[n];
                back = true;
            }
        }
        if !back {
            return;
        }
    }
}

/// Jacobian determinant of a quadratic tetrahedron at barycentric coordinates l.
pub(super) fn jacobian(x: &[DVec3; 10], l: [f64; 4]) -> f64 {
    // dx/dl_i of Σ l_i (2 l_i − 1) x_i + Σ 4 l_a l_b x_ab; then the differences from the first.
    let mut d: [DVec3; 4] = std::array::from_fn(|i| x[i] * (4.0 * l[i] - 1.0));
    for (e, [a, b]) in EDGES.iter().enumerate() {
        d[*a] += x[4 + e] * (4.0 * l[*b]);
        d[*b] += x[4 + e] * (4.0 * l[*a]);
    }
    (d[1] - d[0]).cross(d[2] - d[0]).dot(d[3] - d[0])
}

/// Points and weights that integrate cubics, as Jacobians are (Zienkiewicz and Taylor, table 5.3).
pub(super) const CUBIC: [([f64; 4], f64); 5] = {
    const S: f64 = 1.0 / 6.0;
    [
        ([0.25; 4], -0.8),
        ([0.5, S, S, S], 0.45),
        ([S, 0.5, S, S], 0.45),
        ([S, S, 0.5, S], 0.45),
        ([S, S, S, 0.5], 0.45),
    ]
};

pub(super) fn element_points(positions: &[DVec3], element: &[u32; 10]) -> [DVec3; 10] {
    element.map(|n| positions[n as usize])
}

/// Smallest Jacobian at the nodes, at the faces' and the element's middles and between, over the element's mean.
pub(super) fn jacobian_ratio(positions: &[DVec3], element: &[u32; 10]) -> f64 {
    let x = element_points(positions, element);
    let mean: f64 = CUBIC.iter().map(|(l, w)| w * jacobian(&x, *l)).sum();
    let mut least = f64::INFINITY;
    let mut look = |l: [f64; 4]| least = least.min(jacobian(&x, l));
    CUBIC.iter().for_each(|(l, _)| look(*l));
    for i in 0..4 {
        look(std::array::from_fn(|j| f64::from(u8::from(i == j))));
        look(std::array::from_fn(|j| if i == j { 0.0 } else { 1.0 / 3.0 }));
    }
    for edge in EDGES {
        look(std::array::from_fn(|j| if edge.contains(&j) { 0.5 } else { 0.0 }));
    }
    if mean > 0.0 { least / mean } else { f64::NEG_INFINITY }
}
