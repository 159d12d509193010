//! Which poses are accepted.

use glam::DVec3;
use palpate_device::Sample;

/// No handle is farther from its device's origin, m: what the very first pose is held to.
const REACH: f64 = 10.0;

/// Refuses poses that hold NaN or infinity, those that lie farther from the last one that was accepted than the handle could
/// have come since, and one that has not changed for too long by the device's own counter. Distances and times are from pose
/// to new pose: a pose that is repeated takes no time. A jump that stays is accepted once it could have been a motion: 10 cm
/// at 10 m/s after 10 ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGuard {
    speed_max: f64,
    reach: f64,
    stale: f64,
    /// The newest pose's number, and when it came, s.
    newest: Option<(u64, f64)>,
    /// The last pose that was accepted, and when it was new, s.
    last: Option<(f64, DVec3)>,
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
    /// Refuses only a NaN or infinite value.
    fn default() -> Self {
        let [speed_max, reach, stale] = [f64::INFINITY; 3];
        PoseGuard { speed_max, reach, stale, newest: None, last: None }
    }
}

impl PoseGuard {
    /// For a handle that is never faster than this, m/s, nor farther than 10 m from the device's origin, and a device that has
    /// a new pose at least every `stale_s`.
    pub fn new(speed_max_m_per_s: f64, stale_s: f64) -> Self {
        PoseGuard { speed_max: speed_max_m_per_s, reach: REACH, stale: stale_s, ..PoseGuard::default() }
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
        let position = DVec3::from_array(sample.pose.position_m);
        let finite = position.is_finite() && sample.pose.orientation.iter().all(|q| q.is_finite());
        let near = match self.last {
            Some((then, from)) if self.speed_max < f64::INFINITY => {
                position.distance(from) <= self.speed_max * (came - then)
            }
            _ => true,
        };
        if !(finite && near && position.abs().max_element() <= self.reach) {
            return Verdict::Refused;
        }
        self.last = Some((came, position));
        Verdict::Accepted
    }

    /// The last pose's position that was accepted, m in the device's frame.
    pub(crate) fn position(&self) -> Option<DVec3> {
        self.last.map(|(_, position)| position)
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
            assert!(!accepts(&mut guard, at(k as u64, wrong), 0.0) && guard.position().is_none());
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
