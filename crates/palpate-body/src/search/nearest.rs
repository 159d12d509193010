//! The nearest point of the surface, and on which side of it a place is.

use super::tree::{Distance, Search};
use super::{SurfacePoint, point};
use crate::model::ContactModel;
use crate::surface::corner_angle;
use glam::DVec3;

/// The nearest surface point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Where.
    pub at: SurfacePoint,
    /// How far, m.
    pub distance: f64,
    /// Whether the query lies outside the body, by the pseudo-normal there (Bærentzen and Aanæs 2005).
    pub outside: bool,
}

impl Search {
    /// [`ContactModel::nearest`] among elements with these corners: where, and how far.
    #[inline]
    pub fn nearest(
        &self,
        p: DVec3,
        max_distance: f64,
        corners: impl Fn(u32) -> [DVec3; 3],
    ) -> Option<(SurfacePoint, f64)> {
        let mut best: Option<(SurfacePoint, f64)> = None;
        self.walk(max_distance * max_distance, &Distance(p), |element, bound| {
            let corners = corners(element);
            let n = nearest_on_triangle(p, corners);
            let d = (point(corners, n) - p).length_squared();
            if d < bound || (best.is_none() && d <= bound) {
                best = Some((SurfacePoint { element, n }, d));
                return d;
            }
            bound
        });
        best.map(|(at, d)| (at, d.sqrt()))
    }
}

impl ContactModel {
    /// The surface point nearest to `p`, if one is nearer than `max_distance` (m).
    ///
    /// # Real-time
    /// Bounded by the number of elements, in practice logarithmic; no allocation, never panics.
    pub fn nearest(&self, p: DVec3, max_distance: f64) -> Option<Nearest> {
        let found = self.search.nearest(p, max_distance, |element| self.corners(element));
        found.map(|(at, distance)| Nearest { at, distance, outside: self.is_outside(p, at) })
    }

    /// Whether `p` lies outside, seen from its nearest surface point: by the sum of the normals of the faces that
    /// meet there, weighted by their angles.
    fn is_outside(&self, p: DVec3, at: SurfacePoint) -> bool {
        let corners = self.corners(at.element);
        let offset = p - point(corners, at.n);
        let face = |c: [DVec3; 3]| (c[1] - c[0]).cross(c[2] - c[0]).normalize_or_zero();
        let zero = |i: usize| at.n.get(i).is_some_and(|&n| n == 0.0);
        let zeros = (0..3).filter(|&i| zero(i)).count();
        let mut normal = face(corners);
        if zeros == 1 {
            let opposite = (0..3).find(|&i| zero(i)).unwrap_or(0);
            if let Some((other, _)) = self.across(at.element, (opposite + 1) % 3) {
                normal += face(self.corners(other));
            }
        } else if zeros == 2 {
            let vertex = (0..3).find(|&i| !zero(i)).unwrap_or(0);
            normal = DVec3::ZERO;
            self.around(at.element, vertex, |element, corner| {
                let c = self.corners(element);
                normal += face(c) * corner_angle(c, corner);
            });
        }
        offset.dot(normal) >= 0.0
    }
}

/// Area coordinates of the point of a triangle nearest to `p` (Ericson 2005, section 5.1.5).
pub(crate) fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    [va / sum, vb / sum, vc / sum]
}
