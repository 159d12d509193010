//! Which poses are accepted.

use glam::DVec3;
use palpate_device::Pose;

/// No handle is farther from its device's origin, m: what the very first pose is held to.
const REACH: f64 = 10.0;

/// Refuses poses that hold NaN or infinity, and those that lie farther from the last one that was accepted than the handle
/// could have come since. A jump that stays is accepted once it could have been a motion: 10 cm at 10 m/s after 10 ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseGuard {
    speed_max: f64,
    reach: f64,
    last: Option<(f64, DVec3)>,
}

impl Default for PoseGuard {
    /// Refuses only a NaN or infinite value.
    fn default() -> Self {
        PoseGuard { speed_max: f64::INFINITY, reach: f64::INFINITY, last: None }
    }
}

impl PoseGuard {
    /// For a handle that is never faster than this, m/s, nor farther than 10 m from the device's origin.
    pub fn new(speed_max_m_per_s: f64) -> Self {
        PoseGuard { speed_max: speed_max_m_per_s, reach: REACH, last: None }
    }

    /// Whether `pose` at `now_s` is accepted.
    pub(crate) fn accept(&mut self, pose: &Pose, now_s: f64) -> bool {
        let position = DVec3::from_array(pose.position_m);
        let finite = position.is_finite() && pose.orientation.iter().all(|q| q.is_finite());
        let near = match self.last {
            Some((then, from)) if self.speed_max < f64::INFINITY => {
                position.distance(from) <= self.speed_max * (now_s - then)
            }
            _ => true,
        };
        let believed = finite && near && position.abs().max_element() <= self.reach;
        if believed {
            self.last = Some((now_s, position));
        }
        believed
    }

    /// The last pose's position that was accepted, m in the device's frame.
    pub(crate) fn position(&self) -> Option<DVec3> {
        self.last.map(|(_, position)| position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> Pose {
        Pose { position_m: [x, 0.0, 0.0], ..Pose::default() }
    }

    #[test]
    fn jumps_and_what_is_no_number_are_refused() {
        let mut guard = PoseGuard::new(10.0);
        for wrong in [f64::NAN, -f64::MAX, 11.0] {
            assert!(!guard.accept(&at(wrong), 0.0) && guard.position().is_none());
        }
        assert!(guard.accept(&at(5.0), 1e-3));
        assert!(guard.accept(&at(5.0099), 2e-3) && !guard.accept(&at(5.03), 3e-3));
        assert!(!guard.accept(&at(f64::INFINITY), 4e-3) && !guard.accept(&at(f64::MAX), 4e-3));
        let turned = Pose { orientation: [f64::NAN; 4], ..at(5.0099) };
        assert!(!guard.accept(&turned, 4e-3) && guard.accept(&at(5.0099), 4e-3));
        assert!(
            PoseGuard::default().accept(&at(1e300), 0.0) && !PoseGuard::default().accept(&at(f64::NAN), 0.0)
        );
    }

    #[test]
    fn a_jump_that_stays_is_believed_when_it_could_have_been_a_motion() {
        let mut guard = PoseGuard::new(10.0);
        assert!(guard.accept(&at(0.0), 0.0));
        let refused = (1..100).take_while(|k| !guard.accept(&at(0.0995), f64::from(*k) * 1e-3)).count();
        assert_eq!(refused, 9);
    }
}
