//! P, S and L for the rules whose drive is more than the lateral force: `consistent`, and S and L of `exact` within an
//! element.

use super::criteria::{Criterion, Frame, lipschitz};
use super::drive::Drive;
use super::interval::{Interval, across, direction, dot, length, less, scaled};
use super::patch::{Cell, ElementStates, View};
use super::rates::Rates;
use super::states::{Piece, SHARES, slips};
use palpate_body::SlipRule;

/// As [`Criterion::bound`].
pub(super) fn bound(
    criterion: Criterion,
    patch: &ElementStates,
    cell: &Cell,
    view: &View,
    frame: &Frame,
) -> f64 {
    let Some(slopes) = &patch.slopes else { return f64::NEG_INFINITY };
    let drive = Drive::new(patch, slopes, cell, view, frame);
    let Some(pieces) = slips(patch, cell, view, frame, &drive) else { return f64::INFINITY };
    match criterion {
        Criterion::Passive if patch.slip == SlipRule::Exact => 0.0,
        Criterion::Passive => passive(patch, cell, frame, &pieces),
        // The floor is the paper's rule's.
        Criterion::Floor => f64::NEG_INFINITY,
        Criterion::SnapFree | Criterion::Lipschitz | Criterion::Pace => {
            let rates = Rates::new(patch, slopes, cell, view, frame);
            lipschitz(criterion, patch, &rates.slope(&pieces, criterion != Criterion::SnapFree))
        }
    }
}

/// The least g·t/f = |P g̃|/f + (g − P g̃)·t/f, t along P g̃ or off it.
fn passive(patch: &ElementStates, cell: &Cell, frame: &Frame, pieces: &[Option<Piece>; SHARES]) -> f64 {
    let (sin, cos) = patch.aside.sin_cos();
    let friction = patch.law.forces(cell).friction;
    let of = |p: &Piece| {
        let rest = Interval::new(1.0 - p.share.hi, 1.0 - p.share.lo);
        let miss = p.miss;
        let size = (miss[0].square() + miss[1].square()).sqrt().hi;
        let along = |t: [Interval; 2], own: f64| {
            let helps = (t[0] * miss[0] + t[1] * miss[1]).lo;
            own * if own > 0.0 { cos } else { 1.0 } + (helps.min(helps * cos) - size * sin).max(-size)
        };
        let straight = along(p.way, p.least);
        if !patch.is_stretched() {
            return straight;
        }
        // The search leads off it (`ForceLaw::implicit_drive_direction`).
        let lateral_force = p.vector;
        let (force, stretched) = (length(lateral_force), across(frame.u, frame.stretch(lateral_force)));
        let limit = friction * rest;
        let way = (force - limit).clip(0.0, f64::INFINITY);
        let part = dot(lateral_force, stretched).per(force.square()).clip(0.0, f64::INFINITY);
        let led = less(scaled(lateral_force, limit * part + way * 2.0), scaled(stretched, way));
        let t = direction([led[0], led[1]]);
        // In û's plane the two are no farther apart than (2 − A) can turn a vector, and the element's is tilted.
        let [least, greatest] = patch.stretch().map(|a| (2.0 - a).max(0.0));
        let turned = 2.0 * (least * greatest).sqrt() / (least + greatest) - (1.0 - frame.u[2].lo.powi(2));
        let own = (t[0] * p.vector[0] + t[1] * p.vector[1]).lo;
        straight.min(along(t, if turned > 0.0 { own.max(p.least * turned) } else { own }))
    };
    pieces.iter().flatten().map(of).fold(f64::INFINITY, f64::min)
}
