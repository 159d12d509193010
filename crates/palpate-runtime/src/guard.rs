//! Which poses are accepted.

use crate::wrench::{Placement, quaternion, rotation_between};
use palpate_device::Sample;

/// No handle is farther from its device's origin, m: what the very first pose is held to.
const REACH: f64 = 10.0;

/// How far from 1 the length of an orientation's quaternion may be: as far as the engine takes it.
const NEARLY_UNIT: f64 = 1e-3;

/// Refuses poses that hold NaN or infinity or an orientation that is none, those that lie farther from the
/// last one that was accepted, or are turned further, than the handle could have come since, and one that has
/// not changed for too long by the device's own counter. Distances and times are from pose to new pose: a
/// pose that is repeated takes no time. A jump that stays is accepted once it could have been a motion: 10 cm
/// at 10 m/s after 10 ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGuard {
    speed_max: f64,
    turn_max: f64,
    reach: f64,
    stale: f64,
    /// The newest pose's number, and when it came, s.
    newest: Option<(u64, f64)>,
    /// The last pose that was accepted, and when it was new, s.
    last: Option<(f64, Placement)>,
}

/// What becomes of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    Accepted,
    Refused,
    /// It is an old one.
    Stale,
}

impl Default for PoseGuard {
    /// Refuses only a NaN or infinite value, and an orientation that is none.
    fn default() -> Self {
        let [speed_max, turn_max, reach, stale] = [f64::INFINITY; 4];
        PoseGuard { speed_max, turn_max, reach, stale, newest: None, last: None }
    }
}

impl PoseGuard {
    /// For a handle that is never faster than this, m/s, nor farther than 10 m from the device's origin, and a device that has
    /// a new pose at least every `stale_s`.
    pub fn new(speed_max_m_per_s: f64, stale_s: f64) -> Self {
        PoseGuard { speed_max: speed_max_m_per_s, reach: REACH, stale: stale_s, ..PoseGuard::default() }
    }

    /// For one that is besides never turned faster than this, rad/s.
    #[must_use]
    pub fn with_turn_max(self, turn_max_rad_per_s: f64) -> Self {
        PoseGuard { turn_max: turn_max_rad_per_s, ..self }
    }

    /// Whether the pose of `sample`, read at `now_s`, is accepted.
    pub(crate) fn accept(&mut self, sample: &Sample, now_s: f64) -> Verdict {
        let came = match self.newest {
            Some((number, came)) if number == sample.sequence => came,
            _ => now_s,
        };
        self.newest = Some((sample.sequence, came));
        if now_s - came > self.stale {
            return Verdict::Stale;
        }
        let placement = Placement::from(sample.pose);
        let Placement { position, orientation } = placement;
        // False of a NaN too.
        let rotates = (quaternion(orientation).length() - 1.0).abs() <= NEARLY_UNIT;
        let near = self.last.is_none_or(|(then, from)| {
            let within = |most: f64, way: f64| most == f64::INFINITY || way <= most * (came - then);
            within(self.speed_max, position.distance(from.position))
                && within(self.turn_max, rotation_between(from.orientation, orientation).length())
        });
        if !(position.is_finite() && rotates && near && position.abs().max_element() <= self.reach) {
            return Verdict::Refused;
        }
        self.last = Some((came, placement));
        Verdict::Accepted
    }

    /// The last pose that was accepted, in the device's frame.
    pub(crate) fn placement(&self) -> Option<Placement> {
        self.last.map(|(_, placement)| placement)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_device::Pose;

    /// The sample `number` is at `x`.
    fn at(number: u64, x: f64) -> Sample {
        let pose = Pose { position_m: [x, 0.0, 0.0], ..Pose::default() };
        Sample { sequence: number, pose, ..Sample::default() }
    }

    fn accepts(guard: &mut PoseGuard, sample: Sample, now_s: f64) -> bool {
        guard.accept(&sample, now_s) == Verdict::Accepted
    }

    #[test]
    fn jumps_and_what_is_no_number_are_refused() {
        let mut guard = PoseGuard::new(10.0, 1.0);
        for (k, wrong) in [f64::NAN, -f64::MAX, 11.0].into_iter().enumerate() {
            assert!(!accepts(&mut guard, at(k as u64, wrong), 0.0) && guard.placement().is_none());
        }
        assert!(accepts(&mut guard, at(3, 5.0), 1e-3));
        assert!(accepts(&mut guard, at(4, 5.0099), 2e-3) && !accepts(&mut guard, at(5, 5.03), 3e-3));
        assert!(
            !accepts(&mut guard, at(6, f64::INFINITY), 4e-3) && !accepts(&mut guard, at(7, f64::MAX), 4e-3)
        );
        let mut turned = at(8, 5.0099);
        turned.pose.orientation = [f64::NAN; 4];
        assert!(!accepts(&mut guard, turned, 4e-3) && accepts(&mut guard, at(9, 5.0099), 4e-3));
        assert!(accepts(&mut PoseGuard::default(), at(0, 1e300), 0.0));
        assert!(!accepts(&mut PoseGuard::default(), at(0, f64::NAN), 0.0));
    }

    #[test]
    fn a_jump_that_stays_is_believed_when_it_could_have_been_a_motion() {
        let mut guard = PoseGuard::new(10.0, 1.0);
        assert!(accepts(&mut guard, at(0, 0.0), 0.0));
        let refused = (1..100).take_while(|&k| !accepts(&mut guard, at(k, 0.0995), k as f64 * 1e-3)).count();
        assert_eq!(refused, 9);
    }

    /// Half a turn in a millisecond is no motion, nor is a quaternion of no length an orientation; -q is the
    /// same as q.
    #[test]
    fn a_turn_that_no_wrist_makes_is_refused() {
        let mut guard = PoseGuard::new(10.0, 1.0).with_turn_max(100.0);
        let turned = |number: u64, angle: f64| {
            let (sin, cos) = libm::sincos(0.5 * angle);
            Sample { pose: Pose { orientation: [cos, 0.0, sin, 0.0], ..Pose::default() }, ..at(number, 0.0) }
        };
        assert!(accepts(&mut guard, turned(0, 0.0), 0.0) && accepts(&mut guard, turned(1, 0.099), 1e-3));
        assert!(!accepts(&mut guard, turned(2, 0.25), 2e-3));
        let mut same = turned(3, 0.099);
        same.pose.orientation = same.pose.orientation.map(|c| -c);
        assert!(accepts(&mut guard, same, 3e-3));
        // A turn that stays is a motion once it could have been one.
        let refused =
            (4..100).take_while(|&k| !accepts(&mut guard, turned(k, 1.099), k as f64 * 1e-3)).count();
        assert_eq!(refused, 9);
        for orientation in [[0.0; 4], [1.1, 0.0, 0.0, 0.0]] {
            let pose = Pose { orientation, ..Pose::default() };
            assert!(!accepts(&mut PoseGuard::default(), Sample { pose, ..at(0, 0.0) }, 0.0));
        }
    }

    /// A hand at 1 m/s, and a device that has a new pose every 8 ms, asked every millisecond: its 8 mm are no jump.
    #[test]
    fn a_repeated_pose_takes_no_time_off_the_next_ones_way() {
        let mut guard = PoseGuard::new(2.0, 0.02);
        for k in 0..200u64 {
            let number = k / 8;
            assert!(accepts(&mut guard, at(number, number as f64 * 8e-3), k as f64 * 1e-3), "{k}");
        }
    }

    /// A jump that is only repeated does not become a motion by waiting.
    #[test]
    fn a_refused_pose_that_is_repeated_stays_refused() {
        let mut guard = PoseGuard::new(10.0, 1.0);
        assert!(accepts(&mut guard, at(0, 0.0), 0.0));
        assert!((1..100).all(|k| !accepts(&mut guard, at(1, 0.05), f64::from(k) * 1e-3)));
    }

    #[test]
    fn a_pose_that_stays_the_same_by_its_counter_is_stale_until_a_new_one_comes() {
        let mut guard = PoseGuard::new(10.0, 0.02);
        // Not at zero: a clock that begins elsewhere makes no difference.
        assert_eq!(guard.accept(&at(7, 0.0), 5.0), Verdict::Accepted);
        assert_eq!(guard.accept(&at(7, 0.0), 5.0199), Verdict::Accepted);
        assert_eq!(guard.accept(&at(7, 0.0), 5.0201), Verdict::Stale);
        assert_eq!(guard.accept(&at(8, 0.0), 5.03), Verdict::Accepted);
    }
}
