//! The haptic loop: where a device, a body and the engine meet.
//!
//! A [`HapticLoop`] holds all that evolves from period to period; [`HapticLoop::step`] is one period: read the pose,
//! map it, step the engine, pass the output stages, write the force. It keeps no clock: the caller says what time it is,
//! so the same loop runs against a clock or, with a [`Simulated`](palpate_device::Simulated) device, in virtual time, as
//! fast as the machine can.
//!
//! [`Cycle`] tells afterwards whether a motion was at rest or cycled.
//!
//! # Real-time
//! `step` never allocates, locks, logs, or reads a clock or a file, as far as the device's `read` and `write` don't.

mod closed_loop;
mod coupling;
mod cycle;
mod map;
mod passivity;

pub use closed_loop::{HapticLoop, Period, Port, Stages};
pub use coupling::Coupling;
pub use cycle::Cycle;
pub use map::WorkspaceMap;
pub use passivity::PassivityController;
