//! Straight presses with a drag from their end, as test points have them.

use super::place::{Ground, Random};
use super::{History, Leg, Plan, Trial, Tried};
use glam::DVec3;
use palpate_body::curve::between_rows;
use palpate_identify::{DragRecord, PointFit, PointRecord, fit_point};
use palpate_simulate::{Drag, Path, PointPaths, PointPlan, State};
use std::f64::consts::TAU;
use std::ops::Range;

/// A press to a random depth and a drag from there. A frictionless press has further drags from the test
/// points' depths; one that sticks is dragged no farther than 1.5 times what friction would hold, as a law's
/// samples are.
pub fn press_and_drag(trial: &Trial, ground: &Ground, path: usize) -> Tried {
    let mut random = Random::new(trial.seed, path);
    let depth = random.between(0.1, 1.0) * trial.normal_max_m;
    let mut distance = random.between(0.25, 1.0) * trial.lateral_max_m;
    let angle = random.between(0.0, TAU);
    let place = ground.place(&mut random);
    let inward = place.inward;
    let (p, q) = inward.any_orthonormal_pair();
    let direction = p * libm::cos(angle) + q * libm::sin(angle);
    let mut further: &[f64] = &trial.drag_depths_m;
    if trial.history == History::Stick {
        further = &[];
        let held = 1.5 * between_rows(&trial.friction, depth).unwrap_or(0.0) * depth;
        distance = if held > 0.0 { distance.min(held) } else { distance };
    }
    let along = |end: f64| (1..=trial.steps).map(move |k| end * f64::from(k) / f64::from(trial.steps));
    let mut depths: Vec<f64> = along(depth).chain(further.iter().copied()).collect();
    depths.sort_by(f64::total_cmp);
    // The path's own depth stays as it is.
    depths.dedup_by(|next, kept| {
        let same = *next - *kept < 1e-6;
        if same && *next == depth {
            *kept = depth;
        }
        same
    });
    let nearest = |d: f64| {
        let off = |i: &usize| (depths[*i] - d).abs();
        (0..depths.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
    };
    let drag = |from: f64| Drag { from: nearest(from), direction, distances: along(distance).collect() };
    let drags = std::iter::once(depth).chain(further.iter().copied()).map(drag).collect();
    let poses = along(depth).map(|d| (Leg::Press, inward * d));
    let poses = poses.chain(along(distance).map(|s| (Leg::Drag, inward * depth + direction * s))).collect();
    let plan = Plan::Press(PointPlan { point: place.point, inward, depths, drags });
    Tried { place, direction, depth, distance, poses, plan }
}

/// The simulated states at the path's poses as far as it went, and why it ended early.
pub fn own_states<'p>(tried: &Tried, paths: &'p PointPaths) -> (Vec<&'p State>, Option<String>) {
    let steps = tried.poses.iter().filter(|p| p.0 == Leg::Press).count();
    let step = tried.depth / steps as f64;
    // Not those that only the drags from the test points' depths are for.
    let whole = |depth: f64| (depth / step - (depth / step).round()).abs() * step < 1e-6;
    let press = paths.press.states.iter();
    let press = press.filter(|s| s.depth_m <= tried.depth * (1.0 + 1e-9) && whole(s.depth_m));
    let drag = paths.drags.first().into_iter().flat_map(|d| &d.states);
    let stop = |path: &Path, what: &str| {
        path.stopped.as_ref().map(|s| format!("{what} at {:.3} mm: {}", s.at_m * 1e3, s.why))
    };
    let short = paths.press.states.last().is_none_or(|s| s.depth_m < tried.depth * (1.0 - 1e-9));
    let stopped = match stop(&paths.press, "the press").filter(|_| short) {
        Some(stopped) => Some(stopped),
        None => paths.drags.first().and_then(|d| stop(d, "the drag")),
    };
    (press.chain(drag).collect(), stopped)
}

/// The curves at this place, from its own press and the drags that `which` chooses.
pub fn own_curves(
    tried: &Tried,
    plan: &PointPlan,
    paths: &PointPaths,
    which: Range<usize>,
) -> Option<PointFit> {
    let rows = |path: &Path, at: fn(&State) -> f64| {
        path.states.iter().map(|s| (at(s), s.force_n)).collect::<Vec<_>>()
    };
    let drags = paths.drags.iter().zip(&plan.drags).collect::<Vec<_>>();
    let drags = drags.get(which)?.iter().filter(|(path, _)| !path.states.is_empty());
    let drags: Vec<DragRecord> = drags
        .map(|(path, drag)| DragRecord {
            depth_m: plan.depths[drag.from],
            direction: drag.direction,
            rows: rows(path, |s| s.distance_m),
        })
        .collect();
    let press = rows(&paths.press, |s| s.depth_m);
    let record = PointRecord { inward: tried.place.inward, press, drags, ..PointRecord::default() };
    let distances = plan.drags.first()?.distances.iter().copied();
    let knots: Vec<f64> = std::iter::once(0.0).chain(distances).collect();
    fit_point(&record, &knots, false).ok().filter(|fit| fit.lateral.is_some())
}

/// What those curves answer at a lateral and a normal deflection: as the decoupled form does.
pub fn curves_force(tried: &Tried, fit: &PointFit, offset: DVec3) -> Option<DVec3> {
    let (depth, distance) = (offset.dot(tried.place.inward), offset.dot(tried.direction));
    let lateral = fit.lateral.as_ref()?.value(distance);
    Some(tried.place.inward * fit.normal.value(depth) + tried.direction * lateral)
}
