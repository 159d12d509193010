//! Branch and bound: from both sides, the least value of a criterion over the slip states of an element.

use super::criteria::{Criterion, limit_reach};
use super::patch::{Cell, Cut, Patch};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// How far a search goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Evaluations of the bound.
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

/// Looks for the least value of `criterion` on `patch` from both sides, always cutting the cell whose bound is least.
pub fn least(criterion: Criterion, patch: &Patch, cells: &[Cell], effort: Effort) -> Bounds {
    let mut found = Bounds { proved: f64::INFINITY, found: f64::INFINITY, at: None, evaluations: 0 };
    let mut open = BinaryHeap::with_capacity(64);
    let add = |cell: Cell, found: &mut Bounds, open: &mut BinaryHeap<Open>| {
        let bound = criterion.bound(patch, &cell);
        found.evaluations += 1;
        if bound < f64::INFINITY {
            sample(criterion, patch, &cell, found);
            open.push(Open { bound, cell });
        }
    };
    for cell in cells {
        add(*cell, &mut found, &mut open);
    }
    while let Some(Open { bound, cell }) = open.peek() {
        found.proved = *bound;
        let near = effort.absolute.max(effort.relative * found.found.abs());
        if found.found - bound <= near || found.evaluations >= effort.evaluations {
            return found;
        }
        let Some(cut) = best_cut(criterion, patch, cell, &mut found.evaluations) else { return found };
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

/// The direction whose extent costs the bound most; the widest where no one direction does.
fn best_cut(criterion: Criterion, patch: &Patch, cell: &Cell, evaluations: &mut u32) -> Option<Cut> {
    let mut best: Option<(f64, f64, Cut)> = None;
    for cut in Cut::ALL {
        let width = cell.width(cut, patch);
        // A hundred-thousandth of all there is: what differs within that is rounding.
        if width < 1e-5 {
            continue;
        }
        *evaluations += 1;
        let without = criterion.bound(patch, &cell.flat(cut));
        if best.is_none_or(|(bound, w, _)| (without, width) > (bound, w)) {
            best = Some((without, width, cut));
        }
    }
    best.map(|(.., cut)| cut)
}

/// A state of the cell's: in its middle, with the least deflection in it that slips.
fn sample(criterion: Criterion, patch: &Patch, cell: &Cell, found: &mut Bounds) {
    let mut state = cell.middle();
    let [lo, hi] = cell.reach_m;
    let reach = limit_reach(patch, &state);
    if reach > hi {
        return;
    }
    state.reach_m = [reach.max(lo); 2];
    let value = criterion.bound(patch, &state);
    found.evaluations += 1;
    if value < found.found {
        (found.found, found.at) = (value, Some(state));
    }
}
