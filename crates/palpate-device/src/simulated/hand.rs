//! The operator: an impedance, and what it wants.

use glam::DVec3;
use std::fmt;

/// The operator's hand at the handle, alike in all directions: a mass that moves with the tool, and a spring and a
/// damper to where the operator wants it to be; the same for turning, at each hinge of the wrist.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hand {
    /// kg.
    pub mass_kg: f64,
    /// N·s/m.
    pub damping_n_s_per_m: f64,
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// Rotational inertia that turns with the handle, kg·m².
    pub inertia_kg_m2: f64,
    /// Rotational damper, N·m·s/rad.
    pub damping_nm_s_per_rad: f64,
    /// Rotational spring, N·m/rad.
    pub stiffness_nm_per_rad: f64,
}

/// What the operator wants at a time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Target {
    /// Where the hand's spring pulls to, m, in the device's frame.
    pub position_m: DVec3,
    /// How fast that place moves, m/s.
    pub velocity_m_per_s: DVec3,
    /// A force that the hand exerts besides, N.
    pub push_n: DVec3,
    /// Angles of the wrist's hinges that the hand's rotational spring pulls to, rad: about x, y and z, as
    /// [`Simulated::angles_rad`](super::Simulated::angles_rad) has them.
    pub angles_rad: DVec3,
    /// How fast they change, rad/s.
    pub rates_rad_per_s: DVec3,
    /// Torques that the hand exerts at the hinges besides, N·m.
    pub torque_nm: DVec3,
}

/// What the operator does, as a function of time: the same time gives the same target. One that is led from outside ([`Lead`]) keeps
/// this for the last time that it was asked for, and is asked in the order of time.
///
/// [`Lead`]: super::Lead
pub trait HandMotion: Send + fmt::Debug {
    /// The target at `time_s` since the beginning.
    fn target(&self, time_s: f64) -> Target;

    /// How long it takes, s.
    fn duration_s(&self) -> f64;

    /// The longest stretches (from, to), s, in which the target rests: where a loop may be judged for cycles.
    fn rests(&self) -> Vec<(f64, f64)> {
        Vec::new()
    }
}
