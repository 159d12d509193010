//! Which states of a cell slip, under a drive that is more than the lateral force.

use super::criteria::{Frame, below};
use super::drive::Drive;
use super::interval::{Interval, IntervalVector, direction, flat, length};
use super::law::Forces;
use super::patch::{Cell, ElementStates, View};
use palpate_body::SlipRule;

/// Into how many parts the share s is cut at most.
pub(super) const SHARES: usize = 4;

/// Slip states of a cell with a part of the shares s.
pub(super) struct Piece {
    pub share: Interval,
    /// |P g̃|/f, at least.
    pub least: f64,
    /// g̃/f, (g − P g̃)/f, and P g̃'s direction.
    pub vector: IntervalVector,
    pub miss: [Interval; 2],
    pub way: [Interval; 2],
}

/// Friction over a cell, and the shares there can be; none without a normal force.
fn shares(patch: &ElementStates, cell: &Cell) -> Option<(Interval, [Interval; SHARES], usize)> {
    let Forces { normal, lateral, friction } = patch.law.forces(cell);
    if normal.hi <= 0.0 {
        return None;
    }
    let share = |a: f64, b: f64| if a > 0.0 { a / (a + b) } else { 0.0 };
    let (low, high) = (share(lateral.lo, normal.hi), share(lateral.hi, normal.lo.max(0.0)));
    let count = (((high - low) * SHARES as f64).ceil() as usize).clamp(1, SHARES);
    let at = |i: usize| low + (high - low) * (i as f64 / count as f64);
    Some((friction, std::array::from_fn(|i| Interval::new(at(i), at(i + 1))), count))
}

/// The slip states of a cell; none where there are none.
pub(super) fn slips(
    patch: &ElementStates,
    cell: &Cell,
    view: &View,
    frame: &Frame,
    drive: &Drive,
) -> Option<[Option<Piece>; SHARES]> {
    let (friction, shares, count) = shares(patch, cell)?;
    let below = below(patch.slip);
    let flatness = if patch.slip == SlipRule::Exact { 1.0 } else { frame.u[2].lo };
    let mut rests = false;
    let pieces = std::array::from_fn(|i| {
        let share = *shares.get(i).filter(|_| i < count)?;
        let (vector, miss) = drive.at(share);
        let (size, noise) = (length(vector), drive.noise_at(share));
        let limit = (friction.lo.max(0.0) * (1.0 - share.hi) * below - noise).max(0.0);
        if size.hi < limit {
            return None;
        }
        rests |= can_rest(size * below, noise, friction, share);
        let along = [vector[0], vector[1]];
        let least = length(flat(vector)).lo.max(limit * flatness);
        Some(Piece { share, least, vector, miss, way: direction(along) })
    });
    let any = pieces.iter().any(Option::is_some);
    (any && (rests || came_from_rest(patch, cell, view, frame))).then_some(pieces)
}

/// Whether a drive of this size, less the search's tolerance, by the forces, can be within the limit.
fn can_rest(size: Interval, noise: f64, friction: Interval, share: Interval) -> bool {
    size.lo - noise <= friction.hi * (1.0 - share.lo)
}

/// All states that a state of the cell can have been a step before; none where that is any. `lean` is û's
/// least part along the element's normal.
pub(super) fn before(patch: &ElementStates, cell: &Cell, view: &View, lean: f64) -> Option<Cell> {
    let [least, greatest] = patch.stretch().map(f64::sqrt);
    let way = patch.step_m * greatest;
    if cell.reach_m[0] <= way {
        return None;
    }
    // δ_t turns by no more than this, and its projection a little more.
    let azimuth = (patch.step_m * greatest / cell.reach_m[0]).min(1.0).asin() / lean.max(0.1);
    (view.half + azimuth <= 1.4 && least > 0.0).then(|| Cell {
        depth_m: [(cell.depth_m[0] - patch.step_m).max(0.0), cell.depth_m[1] + patch.step_m],
        azimuth: [cell.azimuth[0] - azimuth, cell.azimuth[1] + azimuth],
        reach_m: [cell.reach_m[0] - way, cell.reach_m[1] + way],
        ..*cell
    })
}

/// Whether a step before a state could have been within the limit.
fn came_from_rest(patch: &ElementStates, cell: &Cell, view: &View, frame: &Frame) -> bool {
    let Some(slopes) = &patch.slopes else { return true };
    let Some(before) = before(patch, cell, view, frame.u[2].lo) else { return true };
    let view = patch.view(&before);
    let frame = Frame::new(patch, &view);
    let drive = Drive::new(patch, slopes, &before, &view, &frame);
    let Some((friction, shares, count)) = shares(patch, &before) else { return false };
    let below = below(patch.slip);
    let rests = |&share: &Interval| {
        can_rest(length(drive.at(share).0) * below, drive.noise_at(share), friction, share)
    };
    shares.iter().take(count).any(rests)
}

/// Where a state's drive comes to its limit as the deflection grows, m; its own where it does not.
pub(super) fn limit_reach(patch: &ElementStates, state: &Cell) -> f64 {
    let reach = state.reach_m[0];
    crossing(patch, state, [0.0, patch.reach_m], 16).unwrap_or(reach)
}

/// The largest ρ in a range beyond which the drive is over its limit, m, or where it is least over it: to a third of the range
/// by look, and from there in so many steps.
pub(super) fn crossing(
    patch: &ElementStates,
    state: &Cell,
    [least, most]: [f64; 2],
    steps: u32,
) -> Option<f64> {
    let excess = |reach: f64| {
        let state = Cell { reach_m: [reach; 2], ..*state };
        over(patch, &state)
    };
    let at = |i: u32| least + (most - least) * f64::from(i) / 3.0;
    let (mut high, mut beyond) = (most, excess(most)?);
    let mut nearest = (beyond, most);
    for i in (0..3).rev() {
        let (low, within) = (at(i), excess(at(i))?);
        if beyond >= 0.0 && within < 0.0 {
            let (mut a, mut b, mut fa, mut fb) = (low, high, within, beyond);
            for _ in 0..steps {
                // The false position, with the end that stays halved (Illinois); what is kept is beyond the limit.
                let c = (b - fb * (b - a) / (fb - fa)).clamp(a, b);
                let f = excess(c)?;
                if f >= 0.0 {
                    (b, fb) = (c, f);
                    fa *= 0.5;
                } else {
                    (a, fa) = (c, f);
                    fb *= 0.5;
                }
                if b - a < 1e-9 * most {
                    break;
                }
            }
            return Some(b);
        }
        (high, beyond) = (low, within);
        if within.abs() < nearest.0.abs() {
            nearest = (within, low);
        }
    }
    Some(nearest.1).filter(|_| nearest.0 >= 0.0)
}

/// How far the drive is over the limit at a state: |g̃|/f − μ f_z/f, or of a coupled body |d| − L.
fn over(patch: &ElementStates, state: &Cell) -> Option<f64> {
    if let Some(law) = &patch.coupled {
        return super::coupled::excess(patch, law, state);
    }
    let slopes = patch.slopes.as_ref()?;
    let view = patch.view(state);
    let frame = Frame::new(patch, &view);
    let drive = Drive::new(patch, slopes, state, &view, &frame);
    let (friction, shares, _) = shares(patch, state)?;
    let share = shares[0];
    Some(length(drive.at(share).0).hi - friction.hi * (1.0 - share.lo))
}
