//! What errors there are, over which states, and how they are spread.

use super::{Answer, Compared, Leg, PathResult, Phase};
use glam::DVec3;
use serde::Serialize;

/// Below this part of the path's largest force a state's own force is no measure, and has no angle.
const LOCAL: f64 = 0.1;

/// Of some values, the middle one, that which no more than one in twenty exceeds, and the greatest.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Percentiles {
    /// Half of them are no greater.
    pub median: f64,
    /// No more than one in twenty is greater.
    pub p95: f64,
    /// The greatest.
    pub worst: f64,
}

impl Percentiles {
    pub(super) fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.collect();
        sorted.sort_by(f64::total_cmp);
        Percentiles {
            median: median(&sorted),
            p95: percentile(&sorted, 0.95),
            worst: percentile(&sorted, 1.0),
        }
    }
}

/// One kind of error.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Spread {
    /// At all states, in % of the largest force of the path that each belongs to.
    pub of_largest: Percentiles,
    /// At the states whose force is above a tenth of the path's largest, in % of the state's own force.
    pub of_local: Percentiles,
    /// The largest of each path, in % of its largest force.
    pub of_paths: Percentiles,
}

/// How far forces are from the simulation's. States in which neither side touches are left out.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Errors {
    /// How many states there are.
    pub states: usize,
    /// Those whose force is above a tenth of their path's largest.
    pub local_states: usize,
    /// Along û.
    pub normal: Spread,
    /// At right angles to û, the length of a vector.
    pub lateral: Spread,
    /// Of the force's size.
    pub size: Spread,
    /// Between the forces, where they are above a tenth of the path's largest, degrees.
    pub angle_deg: Percentiles,
    /// The lateral error in % of the state's own normal force, where the force is above a tenth of the path's
    /// largest.
    pub lateral_of_normal: Percentiles,
}

/// One state's errors.
struct At {
    path: usize,
    /// The largest force of the path and the state's own, N.
    largest: f64,
    own: f64,
    simulated_normal: f64,
    /// Normal, lateral, and of the size, N.
    off: [f64; 3],
    angle_deg: f64,
}

impl At {
    fn is_local(&self) -> bool {
        self.own > LOCAL * self.largest
    }
}

/// The errors of these answers at the states that `chosen` takes and either side touches at.
fn at_states<'p>(
    answers: impl Iterator<Item = (&'p PathResult, &'p Answer)>,
    chosen: impl Fn(&Compared) -> bool,
) -> Vec<At> {
    let mut all: Vec<At> = Vec::new();
    for (path, (result, answer)) in answers.enumerate() {
        let u = DVec3::from_array(result.inward);
        let states = result.states.iter().zip(&answer.forces_n).filter(|(state, _)| chosen(state));
        let touching = states.filter(|(s, force)| s.simulated_n != DVec3::ZERO || **force != DVec3::ZERO);
        all.extend(touching.map(|(s, &rendered)| {
            let simulated = s.simulated_n;
            let off = rendered - simulated;
            At {
                path,
                largest: result.largest_force_n,
                own: simulated.length(),
                simulated_normal: simulated.dot(u).abs(),
                off: [
                    normal_part(off, u),
                    lateral_part(off, u),
                    (rendered.length() - simulated.length()).abs(),
                ],
                angle_deg: libm::atan2(rendered.cross(simulated).length(), rendered.dot(simulated))
                    .to_degrees(),
            }
        }));
    }
    all
}

/// All normal and all lateral errors of these answers, ascending.
pub(super) fn ascending<'p>(
    answers: impl Iterator<Item = (&'p PathResult, &'p Answer)>,
    local: bool,
) -> [Vec<f64>; 2] {
    let states = at_states(answers, |_| true);
    [0, 1].map(|kind| {
        let of = |s: &At| if local { s.own } else { s.largest };
        let counted = states.iter().filter(|s| !local || s.is_local());
        let mut errors: Vec<f64> = counted.map(|s| percent(s.off[kind], of(s))).collect();
        errors.sort_by(f64::total_cmp);
        errors
    })
}

pub(super) fn percent(x: f64, of: f64) -> f64 {
    if of > 0.0 { 100.0 * x / of } else { 0.0 }
}

impl Errors {
    /// Of the paths' answers by one source, at the states that `chosen` takes.
    pub(super) fn new<'p>(
        answers: impl Iterator<Item = (&'p PathResult, &'p Answer)>,
        chosen: impl Fn(&Compared) -> bool,
    ) -> Self {
        let all = at_states(answers, chosen);
        let local: Vec<&At> = all.iter().filter(|s| s.is_local()).collect();
        let paths = all.last().map_or(0, |s| s.path + 1);
        let spread = |kind: usize| {
            let mut worst: Vec<Option<f64>> = vec![None; paths];
            for s in &all {
                let error = percent(s.off[kind], s.largest);
                worst[s.path] = Some(worst[s.path].map_or(error, |w: f64| w.max(error)));
            }
            Spread {
                of_largest: Percentiles::of(all.iter().map(|s| percent(s.off[kind], s.largest))),
                of_local: Percentiles::of(local.iter().map(|s| percent(s.off[kind], s.own))),
                of_paths: Percentiles::of(worst.into_iter().flatten()),
            }
        };
        Errors {
            states: all.len(),
            local_states: local.len(),
            normal: spread(0),
            lateral: spread(1),
            size: spread(2),
            angle_deg: Percentiles::of(local.iter().map(|s| s.angle_deg)),
            lateral_of_normal: Percentiles::of(local.iter().map(|s| percent(s.off[1], s.simulated_normal))),
        }
    }
}

/// What the simulation says of sustained sliding: states of drags, ways back and circles where nearly all
/// slips. Normal is along û at the rendered contact point, which has left the path's own.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Sliding {
    /// How many.
    pub states: usize,
    /// What the pressures can hold, in parts of μ f_z: more than 1 where the surface wraps around the tool.
    pub pressures_hold: Percentiles,
    /// The simulated lateral force, in parts of μ f_z.
    pub simulated: Percentiles,
    /// The body's, in parts of its own μ f_z.
    pub rendered: Percentiles,
}

/// From this share of the pressure on, all counts as slipping.
const ALL_SLIPS: f64 = 0.95;

impl Sliding {
    /// None without friction, or where nothing slides.
    pub(super) fn new<'p>(answers: impl Iterator<Item = (&'p PathResult, &'p Answer)>) -> Option<Self> {
        let mut ratios: Vec<[f64; 3]> = Vec::new();
        for (result, answer) in answers {
            for (s, rendered) in result.states.iter().zip(&answer.forces_n) {
                let u = s.inward;
                let dragged = matches!(s.leg, Leg::Drag | Leg::Reversal | Leg::Circle);
                let [normal, own] = [s.simulated_n, *rendered].map(|f| f.dot(u));
                if !(dragged && s.slipping >= ALL_SLIPS && s.friction > 0.0 && normal > 0.0 && own > 0.0) {
                    continue;
                }
                let used = |f: DVec3, normal: f64| lateral_part(f, u) / (s.friction * normal);
                ratios.push([s.pressed_n / normal, used(s.simulated_n, normal), used(*rendered, own)]);
            }
        }
        let of = |i: usize| Percentiles::of(ratios.iter().map(|r| r[i]));
        let sliding =
            Sliding { states: ratios.len(), pressures_hold: of(0), simulated: of(1), rendered: of(2) };
        (!ratios.is_empty()).then_some(sliding)
    }
}

/// The body's errors in one phase of the paths.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PhaseErrors {
    /// Which.
    pub phase: Phase,
    /// There.
    #[serde(flatten)]
    pub errors: Errors,
}

/// Length along the unit vector `u`.
pub(super) fn normal_part(v: DVec3, u: DVec3) -> f64 {
    v.dot(u).abs()
}

/// Length at right angles to the unit vector `u`.
pub(super) fn lateral_part(v: DVec3, u: DVec3) -> f64 {
    v.reject_from(u).length()
}

/// The middle one of ascending numbers, or the mean of the two in the middle.
pub fn median(sorted: &[f64]) -> f64 {
    match sorted.len() {
        0 => 0.0,
        n => (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0,
    }
}

/// The least of ascending numbers that this share of them does not exceed.
pub fn percentile(sorted: &[f64], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.clamp(1, sorted.len().max(1)) - 1).copied().unwrap_or(0.0)
}
