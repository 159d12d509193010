//! The tree: boxes over the elements, in groups of eight along a Hilbert curve, these again in groups of eight, and so on. It
//! has no pointers and takes about 8 bytes an element, 6 more with the elements' own boxes. Queries look at eight boxes at a
//! time, and walk the tree with a fixed stack.

use super::curve::{CELL_BITS, along_curve};
use crate::parallel;
use crate::patch::Queue;
use glam::DVec3;
use std::array::from_fn;
use std::cmp::Reverse;

const FANOUT: usize = 8;

/// Levels that can occur: 8¹⁰ = 1.07e9 groups, with room to spare.
const MAX_LEVELS: usize = 12;

/// An axis-aligned box in f32, rounded outwards: half the memory, never too small.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Box3 {
    low: [f32; 3],
    high: [f32; 3],
}

impl Box3 {
    const EMPTY: Box3 = Box3 { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    fn around(points: impl Iterator<Item = DVec3>) -> Self {
        let mut b = Box3::EMPTY;
        points.for_each(|p| b.include(p));
        b
    }

    fn include(&mut self, p: DVec3) {
        for (axis, x) in p.to_array().into_iter().enumerate() {
            // A cast rounds to nearest: one step further out holds the exact value.
            self.low[axis] = self.low[axis].min((x as f32).next_down());
            self.high[axis] = self.high[axis].max((x as f32).next_up());
        }
    }
}

/// Eight boxes side by side: their lower bounds (3 coordinates × 8), then their upper ones.
type Eight<T> = [[[T; FANOUT]; 3]; 2];

/// Of a group of boxes; where there are fewer than eight, the rest are empty.
fn side_by_side(boxes: &[Box3]) -> Eight<f32> {
    let of = |i: usize| boxes.get(i).copied().unwrap_or(Box3::EMPTY);
    [from_fn(|axis| from_fn(|i| of(i).low[axis])), from_fn(|axis| from_fn(|i| of(i).high[axis]))]
}

fn one_of([low, high]: &Eight<f32>, i: usize) -> Box3 {
    Box3 { low: low.map(|x| x[i]), high: high.map(|x| x[i]) }
}

/// Around all of them.
fn joined([low, high]: &Eight<f32>) -> Box3 {
    Box3 {
        low: low.map(|x| x.into_iter().fold(f32::INFINITY, f32::min)),
        high: high.map(|x| x.into_iter().fold(f32::NEG_INFINITY, f32::max)),
    }
}

/// What coordinates are counted in: x stands for offset + scale x.
#[derive(Clone, Copy)]
pub(super) struct Grid {
    offset: [f64; 3],
    scale: [f64; 3],
}

impl Grid {
    /// Metres.
    const METRES: Grid = Grid { offset: [0.0; 3], scale: [1.0; 3] };

    /// 256 values over a box.
    fn over(b: &Box3) -> Self {
        let [low, high] = [b.low, b.high].map(|x| x.map(f64::from));
        Grid { offset: low, scale: from_fn(|i| (high[i] - low[i]) / 255.0) }
    }
}

/// What a walk through the tree asks of boxes.
pub(super) trait Query {
    /// For each of eight boxes a bound below what is sought of anything in it; infinite for one that can't matter.
    fn keys<T: Copy + Into<f64>>(&self, boxes: &Eight<T>, grid: &Grid) -> [f64; FANOUT];
}

/// The square of the distance from a place, m².
pub(super) struct Distance(pub DVec3);

impl Query for Distance {
    #[inline(always)]
    fn keys<T: Copy + Into<f64>>(&self, [low, high]: &Eight<T>, grid: &Grid) -> [f64; FANOUT] {
        let mut sums = [0.0; FANOUT];
        for (axis, x) in self.0.to_array().into_iter().enumerate() {
            let (offset, scale) = (grid.offset[axis] - x, grid.scale[axis]);
            for i in 0..FANOUT {
                let (below, above) =
                    (offset + low[axis][i].into() * scale, offset + high[axis][i].into() * scale);
                let out = greater(greater(below, -above), 0.0);
                sums[i] += out * out;
            }
        }
        sums
    }
}

/// The fraction of a way at which a box that is grown by `reach` (m) is entered.
pub(super) struct Entry {
    /// 1/way, m⁻¹.
    per: [f64; 3],
    /// Where coordinate x of the box is passed at the fraction x per + this: entering, and leaving.
    entering: [f64; 3],
    leaving: [f64; 3],
}

impl Entry {
    pub fn new(from: DVec3, way: DVec3, reach: f64) -> Self {
        // A way that stands still along an axis is in the box there or never comes to it.
        const STILL: f64 = 1e-290;
        let per = way.to_array().map(|w| 1.0 / if w.abs() < STILL { STILL } else { w });
        let start = from.to_array();
        Entry {
            per,
            entering: from_fn(|i| -start[i] * per[i] - reach * per[i].abs()),
            leaving: from_fn(|i| -start[i] * per[i] + reach * per[i].abs()),
        }
    }
}

impl Query for Entry {
    #[inline(always)]
    fn keys<T: Copy + Into<f64>>(&self, [low, high]: &Eight<T>, grid: &Grid) -> [f64; FANOUT] {
        let (mut first, mut last) = ([0.0; FANOUT], [1.0; FANOUT]);
        for axis in 0..3 {
            let per = self.per[axis];
            let (near, far) = if per > 0.0 { (low, high) } else { (high, low) };
            let scale = grid.scale[axis] * per;
            let entering = grid.offset[axis] * per + self.entering[axis];
            let leaving = grid.offset[axis] * per + self.leaving[axis];
            for i in 0..FANOUT {
                first[i] = greater(near[axis][i].into() * scale + entering, first[i]);
                last[i] = less(far[axis][i].into() * scale + leaving, last[i]);
            }
        }
        // Rounding must never keep what is met at the same moment.
        from_fn(|i| if first[i] <= last[i] { first[i] * (1.0 - 1e-9) } else { f64::INFINITY })
    }
}

/// As the machine compares: nothing is done for what is not a number.
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline(always)]
fn less(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The tree over a surface's elements.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Search {
    /// Elements along the curve.
    pub(super) order: Vec<u32>,
    /// Boxes of each level, the leaves' groups first, up to the one that has no more than eight.
    levels: Vec<Vec<Eight<f32>>>,
    /// Boxes of the elements of each leaves' group, in the [`Grid::over`] its own box; none if they are not known.
    elements: Vec<Eight<u8>>,
}

impl Search {
    /// Over `count` elements whose nodes are `nodes(element)`.
    pub fn build(positions: &[DVec3], count: usize, nodes: impl Fn(usize) -> [u32; 3] + Sync) -> Self {
        let bounds = Box3::around(positions.iter().copied());
        let low = bounds.low.map(f64::from);
        let size = (0..3).map(|i| bounds.high[i] as f64 - low[i]).fold(1e-9, f64::max);
        let cell = |element: u32| {
            let corners = nodes(element as usize).map(|n| positions[n as usize]);
            let centre: DVec3 = corners.into_iter().sum::<DVec3>() / 3.0;
            [0, 1, 2].map(|i| ((centre[i] - low[i]) / size * ((1u64 << CELL_BITS) - 1) as f64) as u32)
        };
        let order = along_curve(count as u32, cell);

        let corners = |e: &u32| nodes(*e as usize).map(|n| positions[n as usize]);
        let group = |members: &[u32]| Box3::around(members.iter().flat_map(corners));
        let leaves = parallel::collect(order.len().div_ceil(FANOUT * FANOUT), |i| {
            let members = &order[i * FANOUT * FANOUT..];
            let groups = members.chunks(FANOUT).take(FANOUT);
            let mut boxes = [Box3::EMPTY; FANOUT];
            boxes.iter_mut().zip(groups).for_each(|(b, members)| *b = group(members));
            side_by_side(&boxes)
        });
        let mut search = Search { levels: vec![leaves], ..Search::default() };
        search.order = order;
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
            fill(&mut above[0], &mut below[top].iter().map(joined));
            top += 1;
        }
        self.levels.truncate(top + 1);
    }

    /// Learns the elements' own boxes: queries then look at fewer elements.
    pub fn refine(&mut self, corners: impl Fn(u32) -> [DVec3; 3] + Sync) {
        let Search { order, levels, elements } = self;
        *elements = parallel::collect(order.len().div_ceil(FANOUT), |group| {
            let grid = Grid::over(&one_of(&levels[0][group / FANOUT], group % FANOUT));
            let mut all = [[[255; FANOUT]; 3], [[0; FANOUT]; 3]];
            for (i, &element) in order[group * FANOUT..].iter().take(FANOUT).enumerate() {
                let corners = corners(element);
                for axis in 0..3 {
                    let x = corners.map(|p| (p[axis] - grid.offset[axis]) / grid.scale[axis]);
                    // A cast cuts off and stays within 0 to 255; a millionth of a cell is far beyond rounding.
                    all[0][axis][i] = (x[0].min(x[1]).min(x[2]) - 1e-6) as u8;
                    let high = x[0].max(x[1]).max(x[2]) + 1e-6;
                    all[1][axis][i] = (high as u8).saturating_add(u8::from(f64::from(high as u8) < high));
                }
            }
            all
        });
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
        queue.push(Reverse((0, self.levels.len() as u32, 0)));
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
            let below = self.levels[level as usize - 1].get(group as usize);
            let squares = below.map_or([f64::INFINITY; FANOUT], |b| Distance(p).keys(b, &Grid::METRES));
            for (i, square) in (group * FANOUT as u32..).zip(squares).filter(|(_, s)| s.is_finite()) {
                queue.push(Reverse((square.to_bits(), level - 1, i)));
            }
        }
        groups.sort_unstable();
        next
    }

    /// Becomes the tree over these groups of `from`, in their order there, with elements numbered by `renumber`; their own boxes
    /// are to be learned anew. Only the last group of a tree may be short of elements, and it stays the last.
    pub fn copy(&mut self, from: &Search, groups: &[u32], renumber: impl Fn(u32) -> u32) {
        self.order.clear();
        self.order.extend(groups.iter().flat_map(|&g| from.group(g)).map(renumber));
        self.elements.clear();
        if self.levels.is_empty() {
            self.levels.push(Vec::new());
        }
        let of = |g: &u32| one_of(&from.levels[0][*g as usize / FANOUT], *g as usize % FANOUT);
        fill(&mut self.levels[0], &mut groups.iter().map(of));
        self.raise();
    }

    /// Bytes that a step may read.
    pub fn memory(&self) -> impl Iterator<Item = &[u8]> {
        let own = [bytemuck::cast_slice(&self.elements), bytemuck::cast_slice(&self.order)];
        self.levels.iter().map(|l| bytemuck::cast_slice(l)).chain(own)
    }

    /// Visits elements whose box, or group's box, has a key below the bound, the nearest groups first. `visit` returns the
    /// new bound.
    #[inline]
    pub(super) fn walk(&self, mut bound: f64, query: &impl Query, mut visit: impl FnMut(u32, f64) -> f64) {
        // Each level leaves at most FANOUT - 1 siblings waiting.
        let mut stack = [(0.0f64, 0u32, 0u32); MAX_LEVELS * FANOUT];
        set(&mut stack, 0, (0.0, self.levels.len() as u32, 0));
        let mut len = 1;
        while len > 0 {
            len -= 1;
            let Some(&(k, level, group)) = stack.get(len) else { return };
            if k > bound {
                continue;
            }
            if level == 0 {
                let keys = self.elements.get(group as usize).map_or([0.0; FANOUT], |own| {
                    let boxes = self.levels.first().and_then(|l| l.get(group as usize / FANOUT));
                    let grid =
                        boxes.map_or(Grid::METRES, |b| Grid::over(&one_of(b, group as usize % FANOUT)));
                    query.keys(own, &grid)
                });
                let elements = self.order.iter().skip(group as usize * FANOUT);
                for (&element, k) in elements.zip(keys) {
                    if k <= bound {
                        bound = visit(element, bound);
                    }
                }
                continue;
            }
            let below = self.levels.get(level as usize - 1).and_then(|l| l.get(group as usize));
            let Some(below) = below else { return };
            let mut children = [(f64::INFINITY, 0u32); FANOUT];
            let mut count = 0usize;
            for (i, k) in (group * FANOUT as u32..).zip(query.keys(below, &Grid::METRES)) {
                if k <= bound && k < f64::INFINITY {
                    // Insertion, the farthest first: the stack then gives the nearest.
                    let mut at = count;
                    while let Some(&before) =
                        at.checked_sub(1).and_then(|i| children.get(i)).filter(|c| c.0 < k)
                    {
                        set(&mut children, at, before);
                        at -= 1;
                    }
                    set(&mut children, at, (k, i));
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

/// Puts boxes side by side.
fn fill(level: &mut Vec<Eight<f32>>, boxes: &mut impl Iterator<Item = Box3>) {
    level.clear();
    loop {
        let mut group = [Box3::EMPTY; FANOUT];
        let count = group.iter_mut().zip(&mut *boxes).map(|(slot, b)| *slot = b).count();
        if count > 0 {
            level.push(side_by_side(&group));
        }
        if count < FANOUT {
            return;
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
