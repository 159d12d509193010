//! Branch and bound: from both sides, the least value of a criterion over the slip states of an element.

use super::criteria::{Criterion, limit_reach};
use super::patch::{Cell, Cut, ElementStates};
use super::states;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// How far a search goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Evaluations of the bound: a quarter as many where P or S is lost, four to sixteen times as many while either is
    /// undecided.
    pub evaluations: u32,
    /// It ends where bound and least value differ by no more than this, in the criterion's unit,
    pub absolute: f64,
    /// or by this share of the value.
    pub relative: f64,
}

/// The least value of a criterion, from both sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// No slip state has less. Infinite where none slips.
    pub proved: f64,
    /// The least value that was found,
    pub found: f64,
    /// and the state that has it.
    pub at: Option<Cell>,
    /// What the search took.
    pub evaluations: u32,
}

impl Bounds {
    /// What bounds both.
    pub fn worse(self, other: Bounds) -> Bounds {
        let (proved, evaluations) = (self.proved.min(other.proved), self.evaluations + other.evaluations);
        let least = if self.found <= other.found { self } else { other };
        Bounds { proved, evaluations, ..least }
    }
}

/// Less than this below zero is rounding, in the criterion's unit.
pub const ROUNDING: f64 = 1e-9;

/// How many times as many evaluations there are while P or S is undecided: and where the bound is so near to 0 that they
/// are likely to decide it.
const UNDECIDED: u32 = 4;
const NEARLY: u32 = 16;

/// A cell and its bound.
struct Open {
    bound: f64,
    cell: Cell,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    /// The least bound comes first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound)
    }
}

/// Looks for the least value of `criterion` on `patch` from both sides: among single states, going down from the best of
/// a coarse grid, and by bounds, always cutting the cell whose bound is least. Once P or S is lost it ends soon.
pub fn least(criterion: Criterion, patch: &ElementStates, cells: &[Cell], effort: Effort) -> Bounds {
    let mut found = Bounds { proved: f64::INFINITY, found: f64::INFINITY, at: None, evaluations: 0 };
    for cell in cells {
        scan(criterion, patch, cell, &mut found);
    }
    descend(criterion, patch, cells, &mut found);
    let mut open = BinaryHeap::with_capacity(64);
    let add = |cell: Cell, found: &mut Bounds, open: &mut BinaryHeap<Open>| {
        let bound = criterion.bound(patch, &cell);
        found.evaluations += 1;
        if bound < f64::INFINITY {
            // Where the limit is found by a search of its own, an eighth of the cells has to do.
            if bound < found.found && (patch.drives_by_curve() || open.len().is_multiple_of(8)) {
                sample(criterion, patch, cell.middle(), cell.reach_m, found);
            }
            open.push(Open { bound, cell });
        }
    };
    for cell in cells {
        add(*cell, &mut found, &mut open);
    }
    let mut cuts = Cuts::default();
    while let Some(Open { bound, cell }) = open.peek() {
        found.proved = *bound;
        let near = effort.absolute.max(effort.relative * found.found.abs());
        // A quarter will do where P or S is lost; what is neither lost nor proved is worth more than a closer bound.
        let decides = matches!(criterion, Criterion::Passive | Criterion::SnapFree);
        let evaluations = match decides {
            true if found.found < -ROUNDING => effort.evaluations / 4,
            true if *bound < -ROUNDING && -bound < found.found => effort.evaluations * NEARLY,
            true if *bound < -ROUNDING => effort.evaluations * UNDECIDED,
            _ => effort.evaluations,
        };
        if found.found - bound <= near || found.evaluations >= evaluations {
            return found;
        }
        let cut = cuts.best(criterion, patch, cell, *bound, &mut found.evaluations);
        let Some(cut) = cut else { return found };
        let halves = cell.halves(cut);
        open.pop();
        for half in halves {
            add(half, &mut found, &mut open);
        }
    }
    // Nothing slips.
    found.proved = f64::INFINITY;
    found
}

/// States of a cell on a coarse grid.
fn scan(criterion: Criterion, patch: &ElementStates, cell: &Cell, found: &mut Bounds) {
    let state = cell.middle();
    let places = [cell.corners[0], cell.corners[1], cell.corners[2], state.corners[0]];
    for place in places {
        // Where the limit has to be searched for, fewer depths.
        let shares: &[f64] = if patch.drives_by_curve() { &[0.05, 0.3, 0.65, 1.0] } else { &[0.3, 1.0] };
        for share in shares {
            let depth = cell.depth_m[0] + share * (cell.depth_m[1] - cell.depth_m[0]);
            let state = Cell { corners: [place; 3], depth_m: [depth; 2], ..state };
            sample(criterion, patch, state, cell.reach_m, found);
        }
    }
}

/// From the best state so far, one coordinate at a time, with ever shorter ways, as long as the criterion falls.
fn descend(criterion: Criterion, patch: &ElementStates, cells: &[Cell], found: &mut Bounds) {
    let Some(first) = cells.first() else { return };
    let (depths, reaches) = (first.depth_m, first.reach_m);
    for size in [0.3, 0.15, 0.08, 0.04, 0.02] {
        let before = found.found;
        let Some(state) = found.at else { return };
        let at = |n: [f64; 3], depth: f64, azimuth: f64| Cell {
            corners: [n; 3],
            depth_m: [depth.clamp(depths[0], depths[1]); 2],
            azimuth: [azimuth; 2],
            ..state
        };
        let (n, depth, azimuth) = (state.corners[0], state.depth_m[0], state.azimuth[0]);
        for to in first.corners {
            let n = std::array::from_fn(|i| n[i] + size * (to[i] - n[i]));
            sample(criterion, patch, at(n, depth, azimuth), reaches, found);
        }
        for sign in [-1.0, 1.0] {
            sample(
                criterion,
                patch,
                at(n, depth + sign * size * (depths[1] - depths[0]), azimuth),
                reaches,
                found,
            );
            sample(criterion, patch, at(n, depth, azimuth + sign * size), reaches, found);
        }
        if found.found < before {
            // Farther the same way, as often as it pays.
            descend_along(criterion, patch, state, depths, reaches, found);
        }
    }
}

/// On from the best state, by the way that led to it from `before`.
fn descend_along(
    criterion: Criterion,
    patch: &ElementStates,
    before: Cell,
    depths: [f64; 2],
    reaches: [f64; 2],
    found: &mut Bounds,
) {
    let Some(state) = found.at else { return };
    let on = |a: f64, b: f64| 2.0 * b - a;
    let n: [f64; 3] = std::array::from_fn(|i| on(before.corners[0][i], state.corners[0][i]));
    if n.iter().any(|&n| n < 0.0) {
        return;
    }
    let depth = on(before.depth_m[0], state.depth_m[0]).clamp(depths[0], depths[1]);
    let azimuth = on(before.azimuth[0], state.azimuth[0]);
    let next = Cell { corners: [n; 3], depth_m: [depth; 2], azimuth: [azimuth; 2], ..state };
    sample(criterion, patch, next, reaches, found);
}

/// What the extent in each direction costs the bound.
#[derive(Default)]
struct Cuts {
    /// By width, as it was lately.
    worth: [f64; 4],
    made: u32,
}

impl Cuts {
    /// Cuts after the first ones for each that is tried in all directions: trying costs twice as much as cutting.
    const TRIED: u32 = 4;

    /// The direction whose extent costs the bound most; the widest where no one direction does.
    fn best(
        &mut self,
        criterion: Criterion,
        patch: &ElementStates,
        cell: &Cell,
        bound: f64,
        evaluations: &mut u32,
    ) -> Option<Cut> {
        // A hundred-thousandth of all there is: what differs within that is rounding.
        let widths = Cut::ALL.map(|cut| Some(cell.width(cut, patch)).filter(|w| *w >= 1e-5));
        self.made += 1;
        let tried = self.made < 16 || self.made.is_multiple_of(Self::TRIED);
        if tried || bound == f64::NEG_INFINITY {
            let mut best: Option<(f64, f64, Cut)> = None;
            for ((cut, width), worth) in Cut::ALL.into_iter().zip(widths).zip(&mut self.worth) {
                let Some(width) = width else { continue };
                *evaluations += 1;
                let without = criterion.bound(patch, &cell.flat(cut));
                if best.is_none_or(|(bound, w, _)| (without, width) > (bound, w)) {
                    best = Some((without, width, cut));
                }
                let gain = (without - bound) / width;
                if gain.is_finite() {
                    *worth += 0.3 * (gain - *worth);
                }
            }
            return best.map(|(.., cut)| cut);
        }
        let cost = |i: usize| widths[i].map(|w| w * self.worth[i].max(0.0));
        let worst = (0..4)
            .filter(|&i| widths[i].is_some())
            .max_by(|&i, &j| cost(i).partial_cmp(&cost(j)).unwrap_or(Ordering::Equal));
        worst.map(|i| Cut::ALL[i])
    }
}

/// The value at a state, with the least deflection within `reaches` that slips.
fn sample(
    criterion: Criterion,
    patch: &ElementStates,
    state: Cell,
    [least, most]: [f64; 2],
    found: &mut Bounds,
) {
    if !patch.drives_by_curve() {
        // At its limit, and as it is.
        let crossing = states::crossing(patch, &state, [least, most], 4).map(|reach| [reach; 2]);
        for reach_m in crossing.into_iter().chain([state.reach_m]) {
            note(criterion, patch, Cell { reach_m, ..state }, found);
        }
        return;
    }
    let reach = limit_reach(patch, &state);
    if reach > most {
        return;
    }
    note(criterion, patch, Cell { reach_m: [reach.max(least); 2], ..state }, found);
}

/// The value at a state, if it is the least so far.
fn note(criterion: Criterion, patch: &ElementStates, state: Cell, found: &mut Bounds) {
    let value = criterion.bound(patch, &state);
    found.evaluations += 1;
    if value < found.found {
        (found.found, found.at) = (value, Some(state));
    }
}
