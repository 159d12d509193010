//! How frames and tensors change along the surface, over a cell: the nodes' means, and what they differ by from the
//! element's own.

use super::interval::{Interval, IntervalVector, dot, less, points, scaled, sum};
use super::patch::{Cell, View};
use super::slopes::Slopes;
use glam::{DMat3, DVec3};

/// Rows of matrices along x, y and z, and what the two ways of reading them differ by.
pub(super) type Change = ([[IntervalVector; 3]; 3], [[IntervalVector; 3]; 2]);

/// What nodes' gradients of frames and tensors are over a cell.
pub(super) struct Turning {
    /// ∇(u·b) as a matrix that takes b, by rows; nodes' means less the element's own.
    pub frame_gradient: [IntervalVector; 3],
    pub miss: [IntervalVector; 2],
    /// ∇A along x, y and z; the same.
    pub change: Option<Change>,
    /// Both at the nodes.
    pub each: [DMat3; 3],
    pub changes: Option<[[DMat3; 3]; 3]>,
}

impl Turning {
    pub fn new(slopes: &Slopes, cell: &Cell, view: &View) -> Self {
        let [cos, sin] = view.azimuth;
        let r = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
        let each = slopes.turns(r);
        let frame_gradient = hull(cell, &each);
        let less = |row: IntervalVector, own: DVec3| less(row, points(own));
        let miss = [0, 1].map(|i| less(frame_gradient[i], view.du[i]));
        let changes = slopes.changes(r);
        let change = changes.as_ref().zip(view.stretch.as_ref()).map(|(nodes, (_, own))| {
            let along = [0, 1, 2].map(|axis| hull(cell, &nodes.map(|n| n[axis])));
            let rows = |axis: usize| [0, 1, 2].map(|i| less(along[axis][i], own[axis].row(i)));
            (along, [rows(0), rows(1)])
        });
        Turning { frame_gradient, miss, change, each, changes }
    }
}

/// Σ n m over a cell, by rows.
fn hull(cell: &Cell, m: &[DMat3; 3]) -> [IntervalVector; 3] {
    let at = cell.corners.map(|n| m[0] * n[0] + m[1] * n[1] + m[2] * n[2]);
    std::array::from_fn(|i| std::array::from_fn(|j| Interval::hull(at.map(|m| m.col(j)[i]))))
}

/// The area coordinates.
pub(super) fn coordinates(cell: &Cell) -> [Interval; 3] {
    [0, 1, 2].map(|l| Interval::hull(cell.corners.map(|n| n[l])))
}

/// Σ n_l u_l ((û − u_l)·X_l)/2: what turning vectors from the nodes' planes takes off their blend. A node's X_l has no part
/// along u_l.
pub(super) fn turned(
    n: [Interval; 3],
    view: &View,
    u: IntervalVector,
    x: &[IntervalVector; 3],
) -> IntervalVector {
    sum([0, 1, 2].map(|l| {
        let own = view.frames[l];
        scaled(points(own), n[l] * dot(less(u, points(own)), x[l]) * 0.5)
    }))
}
