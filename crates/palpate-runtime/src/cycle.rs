//! Limit cycles: an oscillation that keeps itself alive while the hand rests.

use glam::DVec3;

/// An oscillation that does not die down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cycle {
    /// s.
    pub period_s: f64,
    /// Half of the way from one turning point to the other along the axis that moves most, m, in the second half.
    pub amplitude_m: f64,
    /// The second half's amplitude over the first's.
    pub growth: f64,
}

/// Below this share of its amplitude an oscillation's crossings of the middle are noise.
const HYSTERESIS: f64 = 0.25;
/// As many periods at least make a cycle.
const PERIODS: usize = 6;
/// What has lost more than this from the first half to the second dies down.
const SUSTAINED: f64 = 0.9;

impl Cycle {
    /// The cycle in `places` (m), sampled every `period_s` while the operator rests, if there is one above `smallest_m`.
    /// A slow drift is no cycle; nor is an oscillation that loses a tenth of its amplitude from the first half of the
    /// time to the second: give it a time in which what is damped dies down.
    pub fn find(places: &[DVec3], period_s: f64, smallest_m: f64) -> Option<Cycle> {
        let (first, second) = places.split_at(places.len() / 2);
        let axis = (0..3).max_by(|&a, &b| extent(second, a).total_cmp(&extent(second, b)))?;
        let (turn, late) = oscillation(second, axis)?;
        let growth = oscillation(first, axis).map_or(f64::INFINITY, |(_, early)| late / early);
        let sustained = late > smallest_m && growth >= SUSTAINED;
        sustained.then_some(Cycle { period_s: turn * period_s, amplitude_m: late, growth })
    }
}

/// Mean length of a swing to and fro, in samples, and mean of half their ways, m; `None` for too few.
fn oscillation(places: &[DVec3], axis: usize) -> Option<(f64, f64)> {
    let ups = crossings(places, axis, HYSTERESIS * extent(places, axis));
    let (first, last) = (ups.first()?, ups.last()?);
    let count = ups.len() - 1;
    let half = |pair: &[f64]| {
        let heights = places[pair[0] as usize..pair[1] as usize].iter().map(|p| p[axis]);
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (x.min(l), x.max(h)));
        0.5 * (high - low)
    };
    let sum: f64 = ups.windows(2).map(half).sum();
    (count >= PERIODS).then(|| ((last - first) / count as f64, sum / count as f64))
}

/// The line through the means of the first and the last quarter: what is left of a drift.
fn level(places: &[DVec3], axis: usize) -> impl Fn(usize) -> f64 + '_ {
    let (count, quarter) = (places.len() as f64, (places.len() / 4).max(1));
    let mean = |part: &mut dyn Iterator<Item = &DVec3>| part.map(|p| p[axis]).sum::<f64>() / quarter as f64;
    let a = mean(&mut places.iter().take(quarter));
    let b = mean(&mut places.iter().rev().take(quarter));
    let middle = 0.5 * (quarter as f64 - 1.0);
    let slope = (b - a) / (count - 1.0 - 2.0 * middle).max(1.0);
    move |i| a + slope * (i as f64 - middle)
}

/// Half of the way between the extremes, without drift.
fn extent(places: &[DVec3], axis: usize) -> f64 {
    let level = level(places, axis);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (i, p) in places.iter().enumerate() {
        let x = p[axis] - level(i);
        (low, high) = (low.min(x), high.max(x));
    }
    if high > low { 0.5 * (high - low) } else { 0.0 }
}

/// Where the motion goes up through its level, in samples, straight between two; it must have been below by `margin`.
fn crossings(places: &[DVec3], axis: usize, margin: f64) -> Vec<f64> {
    let level = level(places, axis);
    let x = |i: usize| places[i][axis] - level(i);
    let mut armed = false;
    let mut ups = Vec::new();
    for i in 1..places.len() {
        armed |= x(i) < -margin;
        if armed && x(i) >= 0.0 {
            let (a, b) = (x(i - 1), x(i));
            ups.push(i as f64 - if b > a { b / (b - a) } else { 0.0 });
            armed = false;
        }
    }
    ups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn oscillation(decay: f64, drift: f64) -> Vec<DVec3> {
        let at = |i: u32| {
            let t = f64::from(i) * 1e-3;
            DVec3::new(0.0, drift * t + 2e-4 * libm::exp(-decay * t) * libm::sin(40.0 * t), 1.0)
        };
        (0..4000).map(at).collect()
    }

    #[test]
    fn a_cycle_is_found_and_a_decay_is_none() {
        for drift in [0.0, 1e-4] {
            let cycle = Cycle::find(&oscillation(0.0, drift), 1e-3, 1e-6).unwrap();
            assert!((cycle.period_s - std::f64::consts::TAU / 40.0).abs() < 1e-3, "{cycle:?}");
            assert!((cycle.amplitude_m - 2e-4).abs() < 1e-5 && (cycle.growth - 1.0).abs() < 0.05);
            assert_eq!(Cycle::find(&oscillation(0.5, drift), 1e-3, 1e-6), None);
        }
        assert!(Cycle::find(&oscillation(-0.5, 0.0), 1e-3, 1e-6).unwrap().growth > 2.0);
        assert_eq!(Cycle::find(&oscillation(0.0, 0.0), 1e-3, 1e-3), None);
        assert_eq!(Cycle::find(&[], 1e-3, 1e-6), None);
        assert_eq!(Cycle::find(&[DVec3::ZERO; 100], 1e-3, 1e-6), None);
    }
}
