//! Haptic devices as a loop sees them.
//!
//! A [`Device`] gives a [`Sample`] (where its handle is) and takes a [`Command`] (what force to render), once a period.
//! [`Capabilities`] say what it can do, each figure with where it comes from. The crate knows nothing of bodies or of
//! the engine: whoever joins them (palpate-runtime) maps the device's workspace onto the body's frame.
//!
//! [`Simulated`] and [`Replay`] need no hardware. [`Dhd`] (Force Dimension), [`OpenHaptics`] (3D Systems) and [`Haply`]
//! (Inverse3) are drivers: the vendors' libraries are opened, and the service is called, at run time, so that the crate
//! builds without any SDK. They were tested against stand-ins only, none with a device. What they have in common: no
//! force before the first good pose; what leaves is finite and within the limits; none after a silence of the loop's, or after the
//! device took its forces off by itself, until the loop has commanded zero; and however they end, by `close`, a fault, a
//! panic or a drop, there is zero force first.
//!
//! # Order of calls
//! `open`, then any number of periods of `read` and `write` in this order, then `close`. A device that was opened
//! renders no force until the first `write`; `close` renders none again, may come at any time and more than once, and a
//! closed device can be opened anew. Dropping an open device closes it.
//!
//! # Real-time
//! `open` and `close` may allocate, wait and load libraries. `read` and `write` are for a loop's thread: bounded, no
//! allocation, no lock that another thread could hold for long, no log; their error is a plain [`Fault`]. A driver
//! whose protocol can't do that (sockets, a vendor's own thread) keeps a thread of its own behind its `read` and
//! `write`.
//!
//! # Units and frame
//! SI: m, rad, m/s, N, N·m, s. The device's frame is right-handed, as the operator who sits before it sees it: x to the
//! right, y away from the operator, z up. Drivers whose vendor uses other axes or units convert.

/// What the exchange between threads is made of: under loom, in the tests, it is loom's.
#[cfg(feature = "vendors")]
mod shared {
    pub use std::sync::Arc;
    pub use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
}

mod capabilities;
mod device;
#[cfg(feature = "vendors")]
mod dhd;
mod error;
#[cfg(feature = "vendors")]
mod first_pose;
#[cfg(feature = "vendors")]
mod frame;
#[cfg(feature = "vendors")]
mod haply;
#[cfg(feature = "vendors")]
mod latch;
#[cfg(feature = "vendors")]
mod latest;
#[cfg(feature = "vendors")]
mod library;
#[cfg(feature = "vendors")]
mod limit;
#[cfg(feature = "vendors")]
mod openhaptics;
pub mod presets;
mod replay;
pub mod simulated;

pub use capabilities::{Basis, Capabilities, Figure, Freedom, Mechanics, Pace, Rates, Workspace, Wrist};
pub use device::{Command, Device, EmergencyStop, Pose, Sample, Status};
#[cfg(feature = "vendors")]
pub use dhd::{Dhd, DhdOptions};
pub use error::{Fault, OpenError};
#[cfg(feature = "vendors")]
pub use haply::{Haply, HaplyForceKey, HaplyOptions};
#[cfg(feature = "vendors")]
pub use openhaptics::{OpenHaptics, OpenHapticsOptions};
pub use replay::{Replay, ReplaySample};
pub use simulated::Simulated;
