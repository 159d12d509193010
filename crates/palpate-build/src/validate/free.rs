//! Free paths: the tool comes at an angle, presses, drags past slip, turns back, goes round, lets go and
//! touches again.

use super::place::{Ground, Place, Random};
use super::{Leg, Plan, Trial, Tried};
use glam::{DQuat, DVec3};
use palpate_body::curve::between_rows;
use palpate_simulate::{FreePlan, FreePose};
use std::f64::consts::TAU;

/// The farthest that a press leans, rad.
const LEAN: f64 = TAU / 12.0;
/// How far outside a path begins and passes from touch to touch, m; on a small body this part of the depth.
const GAP: (f64, f64) = (0.5e-3, 0.25);
/// How far to either side of the point a press may lean, in parts of the lateral range.
const LEANING: f64 = 0.33;
/// How far from it the way back may end.
const BACK: f64 = 0.5;
/// Within what the tool touches again.
const AGAIN: f64 = 0.67;

/// A path with Coulomb friction. Laterally the tool stays within the range.
pub fn coulomb(trial: &Trial, ground: &Ground, path: usize) -> Tried {
    let mut random = Random::new(trial.seed, path);
    let place = ground.place(&mut random);
    let friction = trial.friction.clone();
    let range = trial.lateral_max_m;
    let depth = random.between(0.1, 1.0) * trial.normal_max_m;
    let (t1, t2) = place.inward.any_orthonormal_pair();
    let mut around = |length: f64| {
        let angle = random.between(0.0, TAU);
        (t1 * libm::cos(angle) + t2 * libm::sin(angle)) * length
    };
    let (leaning, along, again) = (around(1.0), around(1.0), around(1.0));
    let lean = libm::tan(random.between(0.0, LEAN)).min(2.0 * LEANING * range / depth);
    // Half of the sideways way before the point, half of it behind.
    let pressed = leaning * (0.5 * depth * lean);

    // A ball slips after about μ δz: f_z = ⅔ k_n δz (Hertz), k_t/k_n = 2(1−ν)/(2−ν) (Mindlin), and ν is near
    // ½.
    let slip = between_rows(&friction, depth).unwrap_or(0.0) * depth;
    let past_slip = (random.between(2.0, 3.0) * slip).max(0.25 * range);
    let dragged = pressed + along * past_slip.min(within(pressed, along, range));
    // Back to where the drag began, and beyond.
    let beyond = (0.5 * random.between(0.0, 1.0) * past_slip).min(within(pressed, -along, BACK * range));
    let back = pressed - along * beyond;

    // Round a circle that the way back touches.
    let side = place.inward.cross(along) * if random.between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
    let widest = (range * range - back.length_squared()) / (2.0 * (range + back.dot(side)));
    let radius = (random.between(0.2, 0.4) * range).min(widest);
    let round = |turn: f64| {
        let (sin, cos) = (libm::sin(turn), libm::cos(turn));
        back + (side * (1.0 - cos) - along * sin) * radius
    };
    let again = again * (random.between(0.0, 1.0).sqrt() * AGAIN * range);
    let short = random.between(0.3, 0.7) * depth;

    let gap = gap(trial);
    let at = |depth: f64, lateral: DVec3| place.inward * depth + lateral;
    let mut way = Way::new(trial, at(-gap, -pressed - leaning * (gap * lean)));
    way.straight(Leg::Press, at(depth, pressed));
    way.straight(Leg::Drag, at(depth, dragged));
    way.straight(Leg::Reversal, at(depth, back));
    way.curve(Leg::Circle, TAU * radius, |t| at(depth, round(TAU * t)));
    way.straight(Leg::Release, at(-gap, back));
    way.poses.push((Leg::Release, at(-gap, again)));
    way.straight(Leg::Press, at(short, again));
    Tried {
        place,
        direction: along,
        depth,
        distance: (dragged - pressed).length(),
        plan: Plan::Free(plan(&place, &way.poses, friction)),
        poses: way.poses,
    }
}

/// A straight press to the greatest depth, without friction.
pub fn frictionless(trial: &Trial, ground: &Ground, path: usize) -> Tried {
    let mut random = Random::new(trial.seed, path);
    let place = ground.place(&mut random);
    let depth = trial.normal_max_m;
    let mut way = Way::new(trial, place.inward * -gap(trial));
    way.straight(Leg::Press, place.inward * depth);
    Tried {
        place,
        direction: place.inward.any_orthonormal_vector(),
        depth,
        distance: 0.0,
        plan: Plan::Free(plan(&place, &way.poses, Vec::new())),
        poses: way.poses,
    }
}

fn plan(place: &Place, poses: &[(Leg, DVec3)], friction: Vec<(f64, f64)>) -> FreePlan {
    let pose = |&(_, offset): &(Leg, DVec3)| FreePose { offset, rotation: DQuat::IDENTITY };
    FreePlan { point: place.point, inward: place.inward, poses: poses.iter().map(pose).collect(), friction }
}

fn gap(trial: &Trial) -> f64 {
    GAP.0.min(GAP.1 * trial.normal_max_m)
}

/// How far one can go from a lateral offset along a unit vector until `range` away from the point.
fn within(from: DVec3, along: DVec3, range: f64) -> f64 {
    let b = from.dot(along);
    (b * b + range * range - from.length_squared()).max(0.0).sqrt() - b
}

/// The tool's way, state by state: load steps no longer than the spec's steps of a press.
struct Way {
    poses: Vec<(Leg, DVec3)>,
    step: f64,
}

impl Way {
    /// Each leg has at least so many states, and a circle twice as many.
    const LEAST: f64 = 3.0;

    fn new(trial: &Trial, start: DVec3) -> Self {
        Way { poses: vec![(Leg::Press, start)], step: trial.normal_max_m / f64::from(trial.steps) }
    }

    fn straight(&mut self, leg: Leg, to: DVec3) {
        let from = self.poses.last().map_or(to, |p| p.1);
        self.curve(leg, from.distance(to), |t| from.lerp(to, t));
    }

    /// Along `at`, from 0 to 1.
    fn curve(&mut self, leg: Leg, length: f64, at: impl Fn(f64) -> DVec3) {
        // What is too long by rounding alone is no step more.
        let least = Self::LEAST * if leg == Leg::Circle { 2.0 } else { 1.0 };
        let count = (length / self.step - 1e-9).ceil().max(least);
        self.poses.extend((1..=count as u32).map(|i| (leg, at(f64::from(i) / count))));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_end_at_the_range() {
        let (from, along) = (DVec3::new(1.0, 0.5, 0.0), DVec3::new(0.6, -0.8, 0.0));
        let s = within(from, along, 2.0);
        assert!(s > 0.0 && ((from + along * s).length() - 2.0).abs() < 1e-12);
        assert!(((from - along * within(from, -along, 2.0)).length() - 2.0).abs() < 1e-12);
    }
}
