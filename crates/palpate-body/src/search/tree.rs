//! The tree: boxes over the elements, in groups of eight along a Hilbert curve, these again in groups of eight, and so on. It
//! has no pointers and takes about 8 bytes an element. Queries walk it with a fixed stack.

use super::curve::{CELL_BITS, along_curve};
use crate::patch::Queue;
use glam::DVec3;
use std::cmp::Reverse;

const FANOUT: usize = 8;

/// Levels that can occur: 8¹⁰ = 1.07e9 groups, with room to spare.
const MAX_LEVELS: usize = 12;

/// An axis-aligned box in f32, rounded outwards: half the memory, never too small.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Box3 {
    low: [f32; 3],
    high: [f32; 3],
}

impl Box3 {
    pub const EMPTY: Box3 = Box3 { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    pub fn include(&mut self, p: DVec3) {
        for (axis, x) in p.to_array().into_iter().enumerate() {
            // A cast rounds to nearest: one step further out holds the exact value.
            self.low[axis] = self.low[axis].min((x as f32).next_down());
            self.high[axis] = self.high[axis].max((x as f32).next_up());
        }
    }

    pub fn join(&mut self, other: &Box3) {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(other.low[axis]);
            self.high[axis] = self.high[axis].max(other.high[axis]);
        }
    }

    pub fn distance_squared(&self, p: DVec3) -> f64 {
        let mut sum = 0.0;
        for (axis, x) in p.to_array().into_iter().enumerate() {
            let out = (self.low[axis] as f64 - x).max(x - self.high[axis] as f64).max(0.0);
            sum += out * out;
        }
        sum
    }

    /// Whether a segment (middle, half extent) grown by `radius` may meet the box; by separating axes, so that
    /// segments along an axis need no special case.
    pub fn meets(&self, segment: &Segment, radius: f64) -> bool {
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

    /// A fraction of the way before which nothing of the box, grown by `radius`, is reached.
    pub fn earliest(&self, from: DVec3, way: DVec3, radius: f64) -> f64 {
        let low = DVec3::new(self.low[0] as f64, self.low[1] as f64, self.low[2] as f64);
        let high = DVec3::new(self.high[0] as f64, self.high[1] as f64, self.high[2] as f64);
        let middle = ((high + low) * 0.5 - from).dot(way);
        let reach = ((high - low) * 0.5 + DVec3::splat(radius)).dot(way.abs());
        let square = way.length_squared();
        if square > 0.0 { ((middle - reach) / square * (1.0 - 1e-9)).max(0.0) } else { 0.0 }
    }
}

pub(super) struct Segment {
    pub middle: DVec3,
    pub half: DVec3,
}

/// The tree over a surface's elements.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Search {
    /// Elements along the curve.
    pub(super) order: Vec<u32>,
    /// Boxes of each level, the leaves' groups first.
    levels: Vec<Vec<Box3>>,
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
    pub(super) fn walk(
        &self,
        mut bound: f64,
        key: impl Fn(&Box3) -> f64,
        mut visit: impl FnMut(u32, f64) -> f64,
    ) {
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
}

/// Writes where there is room.
#[inline]
fn set<T>(slice: &mut [T], i: usize, value: T) {
    if let Some(slot) = slice.get_mut(i) {
        *slot = value;
    }
}
