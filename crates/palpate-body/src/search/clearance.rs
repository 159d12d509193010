//! How far away the surface is at least: less than the nearest point, and cheaper.

use super::nearest::nearest_on_triangle;
use super::point;
use super::tree::Distance;
use crate::model::ContactModel;
use glam::DVec3;

impl ContactModel {
    /// A distance (m) that the surface is at least away from `p`, at least 0.7 of the true one, and the element that
    /// showed it. `hint` is an element that may be near, such as the last answer's.
    ///
    /// Far from a fine mesh thousands of elements are nearly equally near: this need not tell them apart.
    ///
    /// # Real-time
    /// As [`ContactModel::nearest`].
    pub fn clearance(&self, p: DVec3, hint: u32) -> (f64, u32) {
        const SURE: f64 = 0.7;
        let distance_squared = |element| {
            let corners = self.corners(element);
            (point(corners, nearest_on_triangle(p, corners)) - p).length_squared()
        };
        let mut best = (distance_squared(hint), hint);
        self.search.walk(best.0 * SURE * SURE, &Distance(p), |element, bound| {
            let d = distance_squared(element);
            if d < best.0 {
                best = (d, element);
                return d * SURE * SURE;
            }
            bound
        });
        (best.0.sqrt() * SURE, best.1)
    }
}
