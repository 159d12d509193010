//! The trait, and what passes through it every period: plain data of fixed size.

use crate::{Capabilities, Fault, OpenError};
use std::sync::Arc;

/// A haptic device, real, simulated or replayed. See the crate's first page for the order of calls.
pub trait Device: Send {
    /// What it can do. What is only known once the device is there (its model, its workspace) is filled in by `open`.
    fn capabilities(&self) -> &Capabilities;

    /// Connects, and makes the device ready to render, with no force yet.
    ///
    /// # Errors
    /// The device, its library or its service is not there, or refuses.
    fn open(&mut self) -> Result<(), OpenError>;

    /// Where the handle is. `now_s` is the loop's time since `open`, s, never decreasing: a simulated device moves up to
    /// it, a replay looks it up, real devices need not read it. A device of [`Pace::Device`](crate::Pace) waits here
    /// for its next pose, within a bound of its own.
    ///
    /// # Errors
    /// See [`Fault`]. A fault may pass: the caller decides when it has seen enough.
    ///
    /// # Real-time
    /// Bounded, no allocation.
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault>;

    /// Renders `command` until the next one, or until `close`. What exceeds the device's limits is the caller's
    /// business; the driver passes it on, and the device may cut it ([`Status::saturated`]).
    ///
    /// # Errors
    /// See [`Fault`].
    ///
    /// # Real-time
    /// Bounded, no allocation.
    fn write(&mut self, command: &Command) -> Result<(), Fault>;

    /// Renders no force and disconnects. Does nothing on a device that is not open.
    fn close(&mut self);

    /// Takes the force off an open device from outside of the loop, also while the loop's thread is in a panic. `None` for
    /// devices that no hand holds.
    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        None
    }

    /// What an open device could not be had for, a line each: a watchdog that it refused, a calibration that it lacks. Known
    /// before its first force.
    fn notes(&self) -> &[String] {
        &[]
    }

    /// A fault in words, with the vendor's text where there is one. Not for the loop.
    fn explain(&self, fault: Fault) -> String {
        fault.to_string()
    }
}

/// Takes a device's force off at once, in place of the loop.
pub trait EmergencyStop: Send + Sync + std::fmt::Debug {
    /// From now on the device renders nothing, whatever is written to it, until it is opened anew. From the thread of the
    /// loop at once; from another with the next callback, message or command. Does nothing once the device is closed.
    ///
    /// # Real-time
    /// Waits for nothing and allocates nothing, so that a panic's hook can call it.
    fn stop(&self);
}

impl<D: Device + ?Sized> Device for Box<D> {
    fn capabilities(&self) -> &Capabilities {
        (**self).capabilities()
    }

    fn open(&mut self) -> Result<(), OpenError> {
        (**self).open()
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        (**self).read(now_s)
    }

    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        (**self).write(command)
    }

    fn close(&mut self) {
        (**self).close();
    }

    fn explain(&self, fault: Fault) -> String {
        (**self).explain(fault)
    }

    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        (**self).emergency_stop()
    }

    fn notes(&self) -> &[String] {
        (**self).notes()
    }
}

/// Position and orientation of the handle in the device's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// m.
    pub position_m: [f64; 3],
    /// Unit quaternion (w, x, y, z), device from handle; the identity where rotations are not sensed.
    pub orientation: [f64; 4],
}

impl Default for Pose {
    fn default() -> Self {
        Pose { position_m: [0.0; 3], orientation: [1.0, 0.0, 0.0, 0.0] }
    }
}

/// What a device says in one period.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// Counts the poses that the device produced: the same number twice is the same pose twice.
    pub sequence: u64,
    /// Where the handle is.
    pub pose: Pose,
    /// Velocity of the handle as the device reports it, m/s, if it does.
    pub velocity_m_per_s: Option<[f64; 3]>,
    /// Its angular velocity as the device reports it, rad/s, about the axes of the device's frame, if it does.
    pub angular_velocity_rad_per_s: Option<[f64; 3]>,
    /// Bit i is button i, 1 while pressed.
    pub buttons: u32,
    /// How the device is.
    pub status: Status,
}

/// How a device is, where it says so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Status {
    /// It renders no force, whatever it is commanded: forces switched off by a button or by its own watchdog, a grip that
    /// nobody holds, not homed; or the driver holds back until it is commanded zero, after a silence.
    pub idle: bool,
    /// It cut the last command to what its motors can.
    pub saturated: bool,
    /// Its motors are warm, and it may soon cut.
    pub warm: bool,
}

/// What a device is to render, on the operator's hand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Command {
    /// N, in the device's frame.
    pub force_n: [f64; 3],
    /// N·m, in the device's frame; ignored by devices without driven rotations.
    pub torque_nm: [f64; 3],
}
