//! The first touch of a moving tool: of a point on its segment, by a watertight test, or of a sphere around it.

use super::nearest::nearest_on_triangle;
use super::tree::{Entry, Search};
use super::{SurfacePoint, point};
use crate::model::ContactModel;
use glam::DVec3;

/// How far behind its start a segment still catches the surface, m: far above rounding, far below touch.
pub(super) const BACK_OFF: f64 = 1e-9;

/// The first touch of a moving tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Where on the surface.
    pub at: SurfacePoint,
    /// When, as a fraction of the way, in [0, 1].
    pub fraction: f64,
}

impl Search {
    /// [`ContactModel::first_touch`] of elements with these corners.
    #[inline]
    pub fn first_touch(
        &self,
        from: DVec3,
        to: DVec3,
        radius: f64,
        corners: impl Fn(u32) -> [DVec3; 3],
    ) -> Option<Touch> {
        let way = to - from;
        let mut best: Option<(Touch, f64)> = None;
        let ray = Ray::new(from, way);
        self.walk(1.0, &Entry::new(from, way, radius + BACK_OFF), |element, bound| {
            let corners = corners(element);
            let hit = if radius > 0.0 {
                sphere_touch(from, way, radius, corners)
            } else {
                ray.touch(from, corners)
            };
            let Some((fraction, n)) = hit else { return bound };
            // Of touches at the same moment the nearest counts, then the lowest element: not the tree's order.
            let distance = (from + way * fraction).distance(point(corners, n));
            let earlier = best.is_none_or(|(b, d)| {
                (fraction, distance, element).partial_cmp(&(b.fraction, d, b.at.element))
                    == Some(std::cmp::Ordering::Less)
            });
            if earlier {
                best = Some((Touch { at: SurfacePoint { element, n }, fraction }, distance));
                return fraction;
            }
            bound
        });
        best.map(|(touch, _)| touch)
    }
}

impl ContactModel {
    /// The first inward touch of a tool that moves from `from` to `to`: of the surface by a point, or of a sphere of
    /// `radius` around it with the surface.
    ///
    /// `from` must be outside. A point is caught on faces, edges and vertices alike (the edge tests of neighbours
    /// agree to the bit: Woop, Benthin and Wald 2013), also where rounding has put `from` up to 1e-9 m inside.
    ///
    /// # Real-time
    /// As [`ContactModel::nearest`].
    pub fn first_touch(&self, from: DVec3, to: DVec3, radius: f64) -> Option<Touch> {
        self.search.first_touch(from, to, radius, |element| self.corners(element))
    }
}

/// A segment prepared for the watertight test: the axis it runs along most, and the shear that makes it run along z.
pub(super) struct Ray {
    from: DVec3,
    /// The axis that it runs along most, and whether the others change places.
    axis: u8,
    mirrored: bool,
    shear: [f64; 2],
    along: f64,
}

impl Ray {
    pub fn new(from: DVec3, way: DVec3) -> Self {
        let size = way.abs();
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let [.., along] = turned(way, axis);
        // A mirrored frame would turn faces over; swap to keep it right-handed along +z.
        let mirrored = along < 0.0;
        let [x, y, _] = swapped(turned(way, axis), mirrored);
        Ray { from, axis, mirrored, shear: [x / along, y / along], along }
    }

    /// Corners in the ray's frame, in which it runs from the origin along z.
    #[inline]
    fn sheared(&self, corners: [DVec3; 3]) -> [[f64; 3]; 3] {
        corners.map(|p| {
            let [x, y, z] = swapped(turned(p - self.from, self.axis), self.mirrored);
            [x - self.shear[0] * z, y - self.shear[1] * z, z]
        })
    }

    /// 1 where the ray leaves through the triangle, −1 where it enters, ahead of its start; else 0.
    pub fn crossing(&self, corners: [DVec3; 3]) -> i32 {
        let [a, b, c] = self.sheared(corners);
        // On which side of the edge the ray passes; on the edge itself, the side that its direction says: opposite
        // ones for its two triangles.
        let side = |p: [f64; 3], q: [f64; 3]| {
            let area = p[0] * q[1] - p[1] * q[0];
            let ahead = if p[1] == q[1] { q[0] > p[0] } else { q[1] > p[1] };
            (area, area > 0.0 || (area == 0.0 && ahead))
        };
        let ((u, left_u), (v, left_v), (w, left_w)) = (side(c, b), side(a, c), side(b, a));
        let sum = u + v + w;
        if left_u != left_v || left_v != left_w || sum == 0.0 {
            return 0;
        }
        let fraction = (u * a[2] + v * b[2] + w * c[2]) / sum / self.along;
        match fraction > 0.0 {
            true if left_u => -1,
            true => 1,
            false => 0,
        }
    }

    /// Fraction and area coordinates where the segment enters through the triangle's outer side.
    fn touch(&self, from: DVec3, corners: [DVec3; 3]) -> Option<(f64, [f64; 3])> {
        if self.along == 0.0 {
            return None;
        }
        let [a, b, c] = self.sheared(corners);
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        // Anticlockwise seen from outside: a segment that comes from there has all three on its left, or at zero.
        let sum = u + v + w;
        if u < 0.0 || v < 0.0 || w < 0.0 || sum.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return None;
        }
        let n = [u / sum, v / sum, w / sum];
        let fraction = (n[0] * a[2] + n[1] * b[2] + n[2] * c[2]) / self.along;
        if (0.0..=1.0).contains(&fraction) {
            return Some((fraction, n));
        }
        // A start that rounding has put inside: by its depth, since a grazing way comes from far behind.
        let outward = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let at_start = nearest_on_triangle(from, corners);
        let offset = from - point(corners, at_start);
        (fraction < 0.0 && offset.length() <= BACK_OFF && offset.dot(outward) <= 0.0)
            .then_some((0.0, at_start))
    }
}

/// With this axis as the last.
#[inline(always)]
fn turned(v: DVec3, axis: u8) -> [f64; 3] {
    match axis {
        0 => [v.y, v.z, v.x],
        1 => [v.z, v.x, v.y],
        _ => [v.x, v.y, v.z],
    }
}

/// Seen in a mirror, if so.
#[inline(always)]
fn swapped([x, y, z]: [f64; 3], mirrored: bool) -> [f64; 3] {
    if mirrored { [y, x, z] } else { [x, y, z] }
}

/// Fraction and area coordinates where a sphere that moves from `from` by `way` first touches a triangle's outer side.
fn sphere_touch(from: DVec3, way: DVec3, radius: f64, corners: [DVec3; 3]) -> Option<(f64, [f64; 3])> {
    let at_start = nearest_on_triangle(from, corners);
    let outward = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    // From behind an open sheet nothing is touched.
    let before = |centre: DVec3, n: [f64; 3]| {
        (centre - point(corners, n)).dot(outward) >= -1e-9 * radius * outward.length()
    };
    if (from - point(corners, at_start)).length() <= radius {
        return before(from, at_start).then_some((0.0, at_start));
    }
    let mut first: Option<f64> = None;
    let mut offer = |t: f64| {
        if (0.0..=1.0).contains(&t) && first.is_none_or(|f| t < f) {
            first = Some(t);
        }
    };
    // The face, moved out by the radius.
    let normal = outward.normalize_or_zero();
    let speed = way.dot(normal);
    if speed < 0.0 {
        let t = (radius - (from - corners[0]).dot(normal)) / speed;
        let n = nearest_on_triangle(from + way * t, corners);
        if n[0] > 0.0 && n[1] > 0.0 && n[2] > 0.0 {
            offer(t);
        }
    }
    // The edges' cylinders and the vertices' spheres.
    for i in 0..3 {
        let (Some(&a), Some(&b)) = (corners.get(i), corners.get((i + 1) % 3)) else { continue };
        let along = (b - a).normalize_or_zero();
        let across = |v: DVec3| v - along * v.dot(along);
        if let Some(t) = first_root(across(from - a), across(way), radius) {
            let s = (from + way * t - a).dot(along);
            if s >= 0.0 && s <= (b - a).length() {
                offer(t);
            }
        }
        if let Some(t) = first_root(from - a, way, radius) {
            offer(t);
        }
    }
    let first = first.map(|t| (t, nearest_on_triangle(from + way * t, corners)));
    first.filter(|&(t, n)| before(from + way * t, n))
}

/// First t with |gap + way t| = radius, for a start outside.
fn first_root(gap: DVec3, way: DVec3, radius: f64) -> Option<f64> {
    let (a, b, c) = (way.length_squared(), gap.dot(way), gap.length_squared() - radius * radius);
    let discriminant = b * b - a * c;
    if a == 0.0 || b >= 0.0 || discriminant < 0.0 {
        return None;
    }
    // b < 0: the sum below does not cancel.
    Some(c / (-b + discriminant.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::nearest::nearest_on_triangle;

    fn unit(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Neither the groups' boxes nor the elements' own hide what a look at every triangle finds: ways along the axes, ways of no
    /// length, triangles that lie in a plane of coordinates, starts on the surface.
    #[test]
    fn boxes_hide_nothing() {
        let mut seed = 1;
        let (mut hits, mut random) = (0, move || unit(&mut seed));
        for round in 0..60 {
            let count = 1 + (random() * 300.0) as u32;
            let flat = round % 3 == 0;
            let mut place = |size: f64| {
                DVec3::new(random() - 0.5, random() - 0.5, if flat { 0.0 } else { random() - 0.5 }) * size
            };
            let triangles: Vec<[DVec3; 3]> = (0..count)
                .map(|_| {
                    let middle = place(0.1);
                    [0; 3].map(|_| middle + place(0.02))
                })
                .collect();
            let positions = triangles.as_flattened();
            let corners = |e: u32| triangles[e as usize];
            let coarse = Search::build(positions, count as usize, |e| [0, 1, 2].map(|i| 3 * e as u32 + i));
            let mut fine = coarse.clone();
            fine.refine(corners);
            for case in 0..60 {
                let mut way = DVec3::new(random() - 0.5, random() - 0.5, random() - 0.5) * 0.2;
                match case % 5 {
                    0 => (way.x, way.y) = (0.0, 0.0),
                    1 => way.z = 0.0,
                    2 if case % 2 == 0 => way = DVec3::ZERO,
                    _ => {}
                }
                let target = positions[(random() * positions.len() as f64) as usize];
                let from = target - way * if case % 4 == 0 { 0.0 } else { random() };
                let (to, radius) = (from + way, if case % 2 == 0 { 0.0 } else { 5e-3 });
                let ray = Ray::new(from, to - from);
                let touches = (0..count).filter_map(|element| {
                    let corners = corners(element);
                    let (fraction, n) = match radius > 0.0 {
                        true => sphere_touch(from, to - from, radius, corners),
                        false => ray.touch(from, corners),
                    }?;
                    let distance = (from + (to - from) * fraction).distance(point(corners, n));
                    Some((fraction, distance, element))
                });
                let first = touches.min_by(|a, b| a.partial_cmp(b).unwrap()).map(|(f, _, e)| (f, e));
                let distance =
                    |e| (point(corners(e), nearest_on_triangle(from, corners(e))) - from).length_squared();
                let nearest = (0..count).map(distance).fold(f64::INFINITY, f64::min).sqrt();
                for search in [&coarse, &fine] {
                    let found = search.first_touch(from, to, radius, corners);
                    assert_eq!(found.map(|t| (t.fraction, t.at.element)), first, "{round} {case}");
                    assert_eq!(search.nearest(from, f64::INFINITY, corners).unwrap().1, nearest);
                }
                hits += u32::from(first.is_some());
            }
        }
        assert!(hits > 500, "{hits}");
    }
}
