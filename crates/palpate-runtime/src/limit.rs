//! The last stage: no command is larger than the device's limit, and none is farther from the last than the slew allows.
//!
//! ```text
//! F_k = F_(k-1) + min(1, s/|w|) w,    w = sat(F) - F_(k-1),    sat(F) = min(1, F_max/|F|) F
//! ```
//!
//! Both hold at once. `sat` ends in the ball |F| ≤ F_max, F_(k-1) lies in it, and F_k is between the two: a ball is
//! convex. And as s ≥ F_max/2, a command of zero is reached from anywhere within two periods.

use crate::StageFlags;
use glam::DVec3;

/// Rounding must not carry a command over its limit, nor a stop into a third period.
const WITHIN: f64 = 1.0 - 1e-12;

/// Saturation and slew of a force or torque: what it renders follows what is wanted as nearly as both allow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limit {
    most: f64,
    step: f64,
    rendered: DVec3,
}

impl Default for Limit {
    /// Lets everything pass.
    fn default() -> Self {
        Limit::new(f64::INFINITY, f64::INFINITY)
    }
}

impl Limit {
    /// At most `most` (N or N·m, may be infinite), changing by at most `step` a period, or half of `most` if that is
    /// more: less would not let a stop end in time. [`Safety::stages`](crate::Safety::stages) says so instead.
    pub fn new(most: f64, step: f64) -> Self {
        let most = most.max(0.0);
        Limit { most, step: step.max(0.5 * most), rendered: DVec3::ZERO }
    }

    /// N or N·m.
    pub fn most(&self) -> f64 {
        self.most
    }

    /// The largest change from one period to the next, N or N·m.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// What was rendered last.
    pub fn rendered(&self) -> DVec3 {
        self.rendered
    }

    /// What to render where `wanted` is wanted, and the soft start lets this share of it through. The share is of what is
    /// within the limit: a force far above it would else be at the limit long before the soft start is over.
    pub(crate) fn pass(&mut self, wanted: DVec3, share: f64, flags: &mut StageFlags) -> DVec3 {
        // The last choke point, whatever the stages before made of their numbers.
        flags.set(StageFlags::CONTAINED, !wanted.is_finite());
        let wanted = if wanted.is_finite() { wanted } else { DVec3::ZERO };
        let held = toward(DVec3::ZERO, wanted, self.most, WITHIN);
        flags.set(StageFlags::SATURATED, held != wanted);
        let held = held * share;
        self.rendered = toward(self.rendered, held, self.step, 1.0);
        flags.set(StageFlags::SLEWED, self.rendered != held);
        self.rendered
    }

    /// What the device renders is not known, or nothing: the next way begins at zero.
    pub(crate) fn reset(&mut self) {
        self.rendered = DVec3::ZERO;
    }
}

/// From `a` towards `b`, no farther than `most`; short of it by the factor `within` where it would be farther.
fn toward(a: DVec3, b: DVec3, most: f64, within: f64) -> DVec3 {
    let way = b - a;
    // Scaled first: the square of a huge way would overflow.
    let scale = way.abs().max_element();
    if most == f64::INFINITY || scale == 0.0 || scale * (way / scale).length() <= most {
        return b;
    }
    let unit = (way / scale).normalize();
    a + unit * (most * within)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pass(limit: &mut Limit, wanted: DVec3) -> DVec3 {
        limit.pass(wanted, 1.0, &mut StageFlags::default())
    }

    #[test]
    fn without_limits_everything_passes_to_the_bit() {
        let mut limit = Limit::default();
        for f in [DVec3::new(0.1, -0.2, 1e9), DVec3::MAX, DVec3::MIN, DVec3::ZERO, DVec3::splat(1e-300)] {
            assert_eq!(pass(&mut limit, f), f);
        }
    }

    #[test]
    fn both_limits_hold_at_once_and_zero_is_two_periods_away() {
        let mut limit = Limit::new(3.3, 0.0);
        assert_eq!(limit.step(), 1.65);
        let mut last = DVec3::ZERO;
        for k in 0..4000 {
            let angle = f64::from(k) * 0.7;
            let size = [0.5, 3.0, 40.0, 1e200, f64::MAX, f64::NAN][k as usize % 6];
            let f = pass(&mut limit, DVec3::new(libm::cos(angle), libm::sin(angle), 0.3) * size);
            assert!(f.length() <= 3.3 && f.distance(last) <= 1.65 * (1.0 + 1e-12), "{k}: {last} {f}");
            if k % 7 == 0 {
                pass(&mut limit, DVec3::ZERO);
                assert_eq!(pass(&mut limit, DVec3::ZERO), DVec3::ZERO);
            }
            last = limit.rendered();
        }
    }

    /// Twenty times the limit is wanted: the soft start's tenth is a tenth of the limit, not twice the limit.
    #[test]
    fn the_soft_start_is_a_share_of_what_is_within_the_limit() {
        let mut limit = Limit::new(2.0, 2.0);
        let mut flags = StageFlags::default();
        assert!((limit.pass(DVec3::X * 40.0, 0.1, &mut flags).x - 0.2).abs() < 1e-9);
        assert!(flags.has(StageFlags::SATURATED));
        limit.reset();
        assert_eq!(limit.rendered(), DVec3::ZERO);
    }
}
