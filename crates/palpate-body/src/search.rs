//! Where is the surface? A tree of boxes over the elements, for the first touch and the nearest point.
//!
//! The elements are sorted along a Hilbert curve and boxed in groups of eight, these again in groups of eight, and so
//! on: the tree has no pointers and takes about 8 bytes an element. Queries walk it with a fixed stack: bounded,
//! without allocation, without panics.

use crate::model::ContactModel;
use crate::patch::Queue;
use crate::surface::TriangleMesh;
use glam::DVec3;
use std::cmp::Reverse;

const FANOUT: usize = 8;

/// Levels that can occur: 8¹⁰ = 1.07e9 groups, with room to spare.
const MAX_LEVELS: usize = 12;

/// An axis-aligned box in f32, rounded outwards: half the memory, never too small.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Box3 {
    low: [f32; 3],
    high: [f32; 3],
}

impl Box3 {
    const EMPTY: Box3 = Box3 { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    fn include(&mut self, p: DVec3) {
        for (axis, x) in p.to_array().into_iter().enumerate() {
            // A cast rounds to nearest: one step further out holds the exact value.
            self.low[axis] = self.low[axis].min((x as f32).next_down());
            self.high[axis] = self.high[axis].max((x as f32).next_up());
        }
    }

    fn join(&mut self, other: &Box3) {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(other.low[axis]);
            self.high[axis] = self.high[axis].max(other.high[axis]);
        }
    }

    fn distance_squared(&self, p: DVec3) -> f64 {
        let mut sum = 0.0;
        for (axis, x) in p.to_array().into_iter().enumerate() {
            let out = (self.low[axis] as f64 - x).max(x - self.high[axis] as f64).max(0.0);
            sum += out * out;
        }
        sum
    }

    /// Whether a segment (middle, half extent) grown by `radius` may meet the box; by separating axes, so that
    /// segments along an axis need no special case.
    fn meets(&self, segment: &Segment, radius: f64) -> bool {
        let low = DVec3::new(self.low[0] as f64, self.low[1] as f64, self.low[2] as f64);
        let high = DVec3::new(self.high[0] as f64, self.high[1] as f64, self.high[2] as f64);
        let half = (high - low) * 0.5 + DVec3::splat(radius);
        let gap = segment.middle - (high + low) * 0.5;
        let reach = segment.half.abs();
        if gap.abs().cmpgt(half + reach).any() {
            return false;
        }
        let cross = segment.half.cross(gap).abs();
        let limit = DVec3::new(
            half.y * reach.z + half.z * reach.y,
            half.x * reach.z + half.z * reach.x,
            half.x * reach.y + half.y * reach.x,
        );
        // Rounding must never separate what touches.
        !cross.cmpgt(limit * (1.0 + 1e-9) + DVec3::splat(1e-15)).any()
    }
}

impl Box3 {
    /// A fraction of the way before which nothing of the box, grown by `radius`, is reached.
    fn earliest(&self, from: DVec3, way: DVec3, radius: f64) -> f64 {
        let low = DVec3::new(self.low[0] as f64, self.low[1] as f64, self.low[2] as f64);
        let high = DVec3::new(self.high[0] as f64, self.high[1] as f64, self.high[2] as f64);
        let middle = ((high + low) * 0.5 - from).dot(way);
        let reach = ((high - low) * 0.5 + DVec3::splat(radius)).dot(way.abs());
        let square = way.length_squared();
        if square > 0.0 { ((middle - reach) / square * (1.0 - 1e-9)).max(0.0) } else { 0.0 }
    }
}

struct Segment {
    middle: DVec3,
    half: DVec3,
}

/// The tree over a surface's elements.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Search {
    /// Elements along the curve.
    order: Vec<u32>,
    /// Boxes of each level, the leaves' groups first.
    levels: Vec<Vec<Box3>>,
}

/// A point of the surface: an element and area coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Element.
    pub element: u32,
    /// Area coordinates (3) of its nodes; non-negative, sum 1.
    pub n: [f64; 3],
}

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

/// The first touch of a moving tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Where on the surface.
    pub at: SurfacePoint,
    /// When, as a fraction of the way, in [0, 1].
    pub fraction: f64,
}

impl Search {
    /// Over `count` elements whose nodes are `nodes(element)`.
    pub fn build(positions: &[DVec3], count: usize, nodes: impl Fn(usize) -> [u32; 3]) -> Self {
        let mut bounds = Box3::EMPTY;
        for p in positions {
            bounds.include(*p);
        }
        let low = bounds.low.map(f64::from);
        let size = (0..3).map(|i| bounds.high[i] as f64 - low[i]).fold(1e-9, f64::max);
        let cell = |element: u32| {
            let corners = nodes(element as usize).map(|n| positions[n as usize]);
            let centre: DVec3 = corners.into_iter().sum::<DVec3>() / 3.0;
            [0, 1, 2].map(|i| ((centre[i] - low[i]) / size * ((1u64 << CELL_BITS) - 1) as f64) as u32)
        };
        let order = along_curve(count as u32, cell);

        let leaves = order.chunks(FANOUT).map(|group| {
            let mut b = Box3::EMPTY;
            for n in group.iter().flat_map(|&e| nodes(e as usize)) {
                b.include(positions[n as usize]);
            }
            b
        });
        let levels = vec![leaves.collect()];
        let mut search = Search { order, levels };
        search.raise();
        search
    }

    /// Builds the levels above the leaves' groups, in the memory of those that are there.
    fn raise(&mut self) {
        let mut top = 0;
        while self.levels[top].len() > 1 {
            if self.levels.len() == top + 1 {
                self.levels.push(Vec::new());
            }
            let (below, above) = self.levels.split_at_mut(top + 1);
            above[0].clear();
            above[0].extend(below[top].chunks(FANOUT).map(|group| {
                let mut b = Box3::EMPTY;
                group.iter().for_each(|other| b.join(other));
                b
            }));
            top += 1;
        }
        self.levels.truncate(top + 1);
    }

    /// How many elements it is over.
    pub fn count(&self) -> usize {
        self.order.len()
    }

    /// The elements of a group of the lowest level.
    pub fn group(&self, group: u32) -> impl Iterator<Item = u32> + '_ {
        self.order.iter().skip(group as usize * FANOUT).take(FANOUT).copied()
    }

    /// Groups of the lowest level, the nearest to `p` first until they hold `count` elements, put in ascending order. Returns
    /// how far all others are at least, m.
    pub fn nearest_groups(&self, p: DVec3, count: usize, groups: &mut Vec<u32>, queue: &mut Queue) -> f64 {
        groups.clear();
        queue.clear();
        queue.push(Reverse((0, self.levels.len() as u32 - 1, 0)));
        let mut next = f64::INFINITY;
        while let Some(Reverse((square, level, group))) = queue.pop() {
            if groups.len() * FANOUT >= count {
                next = f64::from_bits(square).sqrt();
                break;
            }
            if level == 0 {
                groups.push(group);
                continue;
            }
            let below = self.levels[level as usize - 1].iter().enumerate();
            for (i, b) in below.skip(group as usize * FANOUT).take(FANOUT) {
                queue.push(Reverse((b.distance_squared(p).to_bits(), level - 1, i as u32)));
            }
        }
        groups.sort_unstable();
        next
    }

    /// Becomes the tree over these groups of `from`, in their order there, with elements numbered by `renumber`. Only the
    /// last group of a tree may be short of elements, and it stays the last.
    pub fn copy(&mut self, from: &Search, groups: &[u32], renumber: impl Fn(u32) -> u32) {
        self.order.clear();
        self.order.extend(groups.iter().flat_map(|&g| from.group(g)).map(renumber));
        if self.levels.is_empty() {
            self.levels.push(Vec::new());
        }
        self.levels[0].clear();
        self.levels[0].extend(groups.iter().map(|&g| from.levels[0][g as usize]));
        self.raise();
    }

    /// Bytes that a step may read.
    pub fn memory(&self) -> impl Iterator<Item = &[u8]> {
        self.levels.iter().map(|l| bytemuck::cast_slice(l)).chain([bytemuck::cast_slice(&self.order)])
    }

    /// Visits elements whose group's box has a key below the bound, the nearest groups first. `visit` returns the
    /// new bound.
    #[inline]
    fn walk(&self, mut bound: f64, key: impl Fn(&Box3) -> f64, mut visit: impl FnMut(u32, f64) -> f64) {
        // Each level leaves at most FANOUT - 1 siblings waiting.
        let mut stack = [(0.0f64, 0u32, 0u32); MAX_LEVELS * FANOUT];
        let Some(top) = self.levels.len().checked_sub(1) else { return };
        set(&mut stack, 0, (0.0, top as u32, 0));
        let mut len = 1;
        while len > 0 {
            len -= 1;
            let Some(&(k, level, group)) = stack.get(len) else { return };
            if k > bound {
                continue;
            }
            let first = group as usize * FANOUT;
            if level == 0 {
                for &element in self.order.iter().skip(first).take(FANOUT) {
                    bound = visit(element, bound);
                }
                continue;
            }
            let Some(below) = self.levels.get(level as usize - 1) else { return };
            let mut children = [(f64::INFINITY, 0u32); FANOUT];
            let mut count = 0usize;
            for (i, b) in below.iter().enumerate().skip(first).take(FANOUT) {
                let k = key(b);
                if k <= bound {
                    // Insertion, the farthest first: the stack then gives the nearest.
                    let mut at = count;
                    while let Some(&before) =
                        at.checked_sub(1).and_then(|i| children.get(i)).filter(|c| c.0 < k)
                    {
                        set(&mut children, at, before);
                        at -= 1;
                    }
                    set(&mut children, at, (k, i as u32));
                    count += 1;
                }
            }
            for &(k, i) in children.iter().take(count) {
                set(&mut stack, len, (k, level - 1, i));
                len += 1;
            }
        }
    }

    /// [`ContactModel::nearest`] among elements with these corners: where, and how far.
    #[inline]
    pub fn nearest(
        &self,
        p: DVec3,
        max_distance: f64,
        corners: impl Fn(u32) -> [DVec3; 3],
    ) -> Option<(SurfacePoint, f64)> {
        let mut best: Option<(SurfacePoint, f64)> = None;
        let bound = max_distance * max_distance;
        self.walk(
            bound,
            |b| b.distance_squared(p),
            |element, bound| {
                let corners = corners(element);
                let n = nearest_on_triangle(p, corners);
                let d = (point(corners, n) - p).length_squared();
                if d < bound || (best.is_none() && d <= bound) {
                    best = Some((SurfacePoint { element, n }, d));
                    return d;
                }
                bound
            },
        );
        best.map(|(at, d)| (at, d.sqrt()))
    }

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
        let segment = Segment { middle: (from + to) * 0.5, half: way * 0.5 };
        let mut best: Option<(Touch, f64)> = None;
        let reach = radius + BACK_OFF;
        let ray = Ray::new(from, way);
        self.walk(
            1.0,
            // A box is of interest from the earliest fraction at which the segment can come to it.
            |b| if b.meets(&segment, reach) { b.earliest(from, way, reach) } else { f64::INFINITY },
            |element, bound| {
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
            },
        );
        best.map(|(touch, _)| touch)
    }
}

/// Nearest points of a bare triangle mesh, with nothing promised of it.
#[derive(Debug, Clone)]
pub struct MeshSearch {
    search: Search,
    /// Along the tree's curve: what is near in space is near in memory.
    corners: Vec<[DVec3; 3]>,
    /// Around each of these triangles: most need no closer look.
    boxes: Vec<Box3>,
    /// The mesh's number of each of these triangles.
    triangles: Vec<u32>,
}

impl MeshSearch {
    /// Builds the tree.
    ///
    /// # Panics
    /// On a triangle that names a vertex that is not there.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let mut search = Search::build(&mesh.positions, mesh.triangles.len(), |t| mesh.triangles[t]);
        let triangles = std::mem::take(&mut search.order);
        let corners: Vec<_> = triangles
            .iter()
            .map(|&t| mesh.triangles[t as usize].map(|v| mesh.positions[v as usize]))
            .collect();
        search.order = (0..corners.len() as u32).collect();
        let boxes = corners.iter().map(|c: &[DVec3; 3]| {
            let mut b = Box3::EMPTY;
            c.iter().for_each(|p| b.include(*p));
            b
        });
        MeshSearch { search, boxes: boxes.collect(), corners, triangles }
    }

    /// The mesh's point nearest to `p`, if one is within `max_distance` (m), the triangle's number as its element;
    /// and the point itself, m.
    pub fn nearest(&self, p: DVec3, max_distance: f64) -> Option<(SurfacePoint, DVec3)> {
        let mut best: Option<(u32, [f64; 3], DVec3)> = None;
        self.search.walk(
            max_distance * max_distance,
            |b| b.distance_squared(p),
            |slot, bound| {
                let i = slot as usize;
                let (Some(b), Some(corners)) = (self.boxes.get(i), self.corners.get(i)) else { return bound };
                if b.distance_squared(p) > bound {
                    return bound;
                }
                let n = nearest_on_triangle(p, *corners);
                let q = point(*corners, n);
                let d = (q - p).length_squared();
                if d < bound || (best.is_none() && d <= bound) {
                    best = Some((slot, n, q));
                    return d;
                }
                bound
            },
        );
        let (slot, n, q) = best?;
        Some((SurfacePoint { element: *self.triangles.get(slot as usize)?, n }, q))
    }

    /// How often a closed mesh winds around `p`: 0 outside, 1 inside, 2 where it overlaps itself. Counted along the
    /// segment from `p` by `way`, which must end outside.
    ///
    /// Edges and vertices on the segment count once: neighbours agree to the bit (Woop, Benthin and Wald 2013).
    pub fn winding(&self, p: DVec3, way: DVec3) -> i32 {
        let segment = Segment { middle: p + way * 0.5, half: way * 0.5 };
        let ray = Ray::new(p, way);
        let mut winding = 0;
        self.search.walk(
            1.0,
            |b| if b.meets(&segment, 0.0) { 0.0 } else { f64::INFINITY },
            |slot, bound| {
                winding += self.corners.get(slot as usize).map_or(0, |corners| ray.crossing(*corners));
                bound
            },
        );
        winding
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
        self.search.walk(
            best.0 * SURE * SURE,
            |b| b.distance_squared(p),
            |element, bound| {
                let d = distance_squared(element);
                if d < best.0 {
                    best = (d, element);
                    return d * SURE * SURE;
                }
                bound
            },
        );
        (best.0.sqrt() * SURE, best.1)
    }

    /// The first inward touch of a tip that moves from `from` to `to`: of the surface by a point, or of a sphere of
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
                normal += face(c) * crate::surface::corner_angle(c, corner);
            });
        }
        offset.dot(normal) >= 0.0
    }
}

/// Writes where there is room.
#[inline]
fn set<T>(slice: &mut [T], i: usize, value: T) {
    if let Some(slot) = slice.get_mut(i) {
        *slot = value;
    }
}

/// How far behind its start a segment still catches the surface, m: far above rounding, far below touch.
const BACK_OFF: f64 = 1e-9;

/// The point with area coordinates `n`.
#[inline]
pub(crate) fn point([a, b, c]: [DVec3; 3], n: [f64; 3]) -> DVec3 {
    a + (b - a) * n[1] + (c - a) * n[2]
}

/// Area coordinates of the point of a triangle nearest to `p` (Ericson 2005, section 5.1.5).
fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
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

/// A segment prepared for the watertight test: the axis it runs along most, and the shear that makes it run along z.
struct Ray {
    from: DVec3,
    axes: [usize; 3],
    shear: [f64; 2],
    along: f64,
}

impl Ray {
    fn new(from: DVec3, way: DVec3) -> Self {
        let size = way.abs();
        let z = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        // A mirrored frame would turn faces over; swap to keep it right-handed along +z.
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        let pick = |v: DVec3, i: usize| match i {
            0 => v.x,
            1 => v.y,
            _ => v.z,
        };
        let along = pick(way, z);
        if along < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let shear = [pick(way, x) / along, pick(way, y) / along];
        Ray { from, axes: [x, y, z], shear, along }
    }

    /// Corners in the ray's frame, in which it runs from the origin along z.
    #[inline]
    fn sheared(&self, corners: [DVec3; 3]) -> [[f64; 3]; 3] {
        corners.map(|p| {
            let p = p - self.from;
            let pick = |i: usize| match i {
                0 => p.x,
                1 => p.y,
                _ => p.z,
            };
            let [x, y, z] = self.axes.map(pick);
            [x - self.shear[0] * z, y - self.shear[1] * z, z]
        })
    }

    /// 1 where the ray leaves through the triangle, −1 where it enters, ahead of its start; else 0.
    fn crossing(&self, corners: [DVec3; 3]) -> i32 {
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

/// Bits of an axis of the curve's cells, and those of them that tell which bucket a cell is in.
const CELL_BITS: u32 = 20;
const BUCKET_BITS: u32 = 5;

/// The numbers below `count` in the order in which their cells lie along the curve: bucket by bucket, since beside a body that
/// hardly fits into memory there is no room for all keys.
fn along_curve(count: u32, cell: impl Fn(u32) -> [u32; 3]) -> Vec<u32> {
    const BUCKETS: usize = 1 << (3 * BUCKET_BITS);
    let bucket = |i: u32| hilbert(cell(i).map(|x| x >> (CELL_BITS - BUCKET_BITS)), BUCKET_BITS) as usize;
    let mut ends = vec![0u32; BUCKETS + 1];
    (0..count).for_each(|i| ends[bucket(i) + 1] += 1);
    for b in 0..BUCKETS {
        ends[b + 1] += ends[b];
    }
    let starts = ends.clone();
    let mut order = vec![0; count as usize];
    for i in 0..count {
        let end = &mut ends[bucket(i)];
        order[*end as usize] = i;
        *end += 1;
    }
    let mut keyed = Vec::new();
    for bounds in starts.windows(2) {
        let numbers = &mut order[bounds[0] as usize..bounds[1] as usize];
        keyed.clear();
        keyed.extend(numbers.iter().map(|&i| (hilbert(cell(i), CELL_BITS), i)));
        keyed.sort_unstable();
        numbers.iter_mut().zip(&keyed).for_each(|(slot, (_, i))| *slot = *i);
    }
    order
}

/// Position along a 3-D Hilbert curve of `bits` bits an axis, at most 21 (Skilling 2004). Its first digits are those of the
/// curve of fewer bits.
fn hilbert(mut x: [u32; 3], bits: u32) -> u64 {
    let mut q = 1 << (bits - 1);
    while q > 1 {
        let p = q - 1;
        for i in 0..3 {
            if x[i] & q != 0 {
                x[0] ^= p;
            } else {
                let t = (x[0] ^ x[i]) & p;
                x[0] ^= t;
                x[i] ^= t;
            }
        }
        q >>= 1;
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    // Bit k of t: whether an odd number of the bits above it are set.
    let mut t = x[2];
    [1, 2, 4, 8, 16].iter().for_each(|shift| t ^= t >> shift);
    let [a, b, c] = x.map(|v| spread(v ^ t >> 1));
    a << 2 | b << 1 | c
}

/// Two zeros behind each of 21 bits.
fn spread(v: u32) -> u64 {
    let mut v = u64::from(v);
    v = (v | v << 32) & 0x001f_0000_0000_ffff;
    v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_goes_from_cell_to_neighbouring_cell_and_is_the_coarser_ones() {
        let cells = || (0..16u32).flat_map(|x| (0..16).flat_map(move |y| (0..16).map(move |z| [x, y, z])));
        let mut along: Vec<_> = cells().map(|cell| (hilbert(cell, 4), cell)).collect();
        along.sort_unstable();
        assert!(along.iter().enumerate().all(|(i, (key, _))| *key == i as u64));
        for pair in along.windows(2) {
            let apart: u32 = (0..3).map(|axis| pair[0].1[axis].abs_diff(pair[1].1[axis])).sum();
            assert_eq!(apart, 1, "{pair:?}");
        }
        let fine = |cell: [u32; 3]| cell.map(|x| x << 16 | (x.wrapping_mul(0x9E37) & 0xffff));
        assert!(cells().all(|cell| hilbert(fine(cell), 20) >> 48 == hilbert(cell, 4)));
    }

    #[test]
    fn the_order_is_that_of_all_keys() {
        let cell = |i: u32| {
            [7919, 104_729, 1_299_709].map(|p: u32| i.wrapping_mul(p).wrapping_mul(i) >> 12 & 0xfffff)
        };
        let mut keyed: Vec<_> = (0..5000).map(|i| (hilbert(cell(i), CELL_BITS), i)).collect();
        keyed.sort_unstable();
        assert!(keyed.iter().map(|(_, i)| *i).eq(along_curve(5000, cell)));
        assert!(along_curve(0, cell).is_empty());
    }
}
