//! The last gate before a vendor's call: whatever comes, what leaves is finite and within the device's limits.

use crate::{Capabilities, Command, Figure, OpenError};
use glam::DVec3;

/// The lengths that a driver lets through.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// N.
    force: f64,
    /// N·m; 0 where rotations are not driven.
    torque: f64,
}

impl Limits {
    /// Nothing passes.
    pub const NONE: Limits = Limits { force: 0.0, torque: 0.0 };

    pub fn of(capabilities: &Capabilities) -> Self {
        Limits {
            force: capabilities.max_force_n.value,
            torque: capabilities.max_torque_nm.as_ref().map_or(0.0, |t| t.value),
        }
    }

    /// The command, cut to the limits, and whether its force had to be: nothing in place of NaN or infinity.
    pub fn hold(self, command: &Command) -> (Command, bool) {
        let (force_n, cut) = held(command.force_n, self.force);
        let (torque_nm, _) = held(command.torque_nm, self.torque);
        (Command { force_n, torque_nm }, cut)
    }
}

fn held(v: [f64; 3], most: f64) -> ([f64; 3], bool) {
    let v = DVec3::from_array(v);
    if !v.is_finite() {
        return ([0.0; 3], true);
    }
    let length = v.length();
    if length <= most {
        return (v.to_array(), false);
    }
    // The length of a huge vector is infinite, and a vector divided by that is nothing: safe as well.
    let v = v / length * most;
    // Rounding must not lift it above the limit.
    let v = if v.length() > most { v * (1.0 - 2.0 * f64::EPSILON) } else { v };
    (v.to_array(), true)
}

/// Lowers a device's largest force to the user's own, if there is one.
///
/// # Errors
/// It is not above 0.
pub(crate) fn lower(device: &str, most: &mut Figure, user: Option<f64>) -> Result<(), OpenError> {
    match user {
        Some(user) if !(user > 0.0 && user.is_finite()) => Err(OpenError {
            device: device.into(),
            problem: format!("the largest force is {user} N"),
            hint: "give a number above 0".into(),
        }),
        Some(user) if user < most.value => {
            *most = Figure::stated(user, "the user");
            Ok(())
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_leaves_above_the_limits() {
        let limits = Limits { force: 2.5, torque: 0.0 };
        let hold = |force_n| limits.hold(&Command { force_n, torque_nm: [0.0, 1.0, 0.0] });
        assert_eq!(
            hold([0.0, 0.0, 1.5]),
            (Command { force_n: [0.0, 0.0, 1.5], ..Command::default() }, false)
        );
        assert_eq!(hold([0.0, 3.0, 4.0]).0.force_n, [0.0, 1.5, 2.0]);
        for wild in [[f64::NAN, 0.0, 0.0], [0.0, f64::INFINITY, 0.0], [1e300, 1e300, 1e300]] {
            let (command, cut) = hold(wild);
            assert!(cut && DVec3::from_array(command.force_n).length() <= 2.5, "{command:?}");
        }
        for k in 0..10_000 {
            let angle = f64::from(k) * 0.1;
            let wild = DVec3::new(libm::cos(angle), libm::sin(angle), libm::sin(7.0 * angle)) * (3.0 + angle);
            let force = DVec3::from_array(hold(wild.to_array()).0.force_n);
            assert!(force.length() <= 2.5 && force.length() > 2.499, "{force}");
        }
    }
}
