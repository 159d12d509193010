//! The haptic loop: where a device, a body and the engine meet.
//!
//! A [`HapticLoop`] holds all that evolves from period to period; [`HapticLoop::period`] is one: read the pose, map it,
//! step the engine, pass the output [`Stages`], write the force. It keeps no clock: the caller says what time it is, so
//! the same loop runs against a clock or, with a [`Simulated`](palpate_device::Simulated) device, in virtual time, as
//! fast as the machine can.
//!
//! [`Safety`] makes the stages for a device that somebody holds. A [`Record`] keeps what a period saw and did; it goes
//! through a [`ring`] to a [`RecorderThread`], which counts and writes. [`Cycle`] tells afterwards whether a motion was at rest or
//! cycled.
//!
//! ```
//! # use palpate_body::{*, shape::Shape};
//! use palpate_device::simulated::{Move, Script};
//! use palpate_device::{Device, Simulated, presets};
//! use palpate_engine::Contact;
//! use palpate_runtime::{HapticLoop, Stages, WorkspaceMap};
//! # let surface = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default())?;
//! # let responses = vec![Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3)?];
//! # let body = Body::new(BodyParts { blends: vec![BlendWeights::own(0); surface.positions().len()], surface, responses,
//! #     test_point_nodes: vec![0], coupled: None, lateral_tensors: None, tool: Tool::Point, slip: SlipRule::Paper,
//! #     tank: true,
//! #     partial_slip: false,
//! #     provenance: Provenance::default() })?;
//! // Down by 5 mm on top of a ball of 30 mm, from 2 mm above it, in half a second.
//! let (top, down, along) = ([0.0, 0.0, 30e-3].into(), [0.0, 0.0, -1.0].into(), [1.0, 0.0, 0.0].into());
//! let script = Script::new(top, 2e-3, down, along, &[Move::Press { depth_m: 5e-3, seconds: 0.5 }])?;
//! let (hand, _) = presets::hand("fingers").unwrap();
//! let mut device = Simulated::new(presets::device("touch").unwrap(), hand, Box::new(script));
//! let mut haptics = HapticLoop::new(Contact::new(&body), WorkspaceMap::default(), Stages::default());
//! device.open()?;
//! for period in 0..600 {
//!     haptics.step(&body, &mut device, f64::from(period) * 1e-3)?;
//! }
//! // The spring of the hand has met the body's.
//! assert!(device.force_n().z > 0.1 && device.position_m().z < 29e-3);
//! device.close();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Real-time
//! `period` never allocates, locks, logs, or reads a clock or a file, as far as the device's `read` and `write` don't.

/// What the exchange is made of: under loom, in the tests, it is loom's.
mod atomic {
    pub use std::sync::atomic::{AtomicPtr, AtomicU64, Ordering, fence};
}

mod closed_loop;
mod config;
mod controls;
mod coupling;
mod cycle;
mod damping;
mod device_choice;
mod devices;
mod exchange;
mod finder;
mod flags;
mod ground;
mod guard;
mod limit;
mod live_session;
mod map;
pub mod motion;
mod opened;
mod page_faults;
mod passivity;
pub mod path;
mod real_time;
mod record;
mod safety;
pub mod sampled_data;
mod session;
mod soft_start;
mod stages;
mod statistics;
mod supervise;
mod timed;
pub mod trace;
mod virtual_session;
mod wall_clock;
mod watch;
mod wrench;

pub use closed_loop::{HapticLoop, Period, Port};
pub use config::{ClockChoice, History, SessionConfig, WorkspaceSettings};
pub use controls::{ControlError, Controls};
pub use coupling::Coupling;
pub use cycle::Cycle;
pub use damping::Damping;
pub use device_choice::{DeviceChoice, Drivers, ForceKey};
pub use devices::{Attached, Unreached, attached};
pub use exchange::{Board, Mailbox};
pub use finder::{Finder, PATCH_ELEMENTS, PatchHolder, patch_holder};
pub use flags::{StageCounts, StageFlags};
pub use ground::Ground;
pub use guard::PoseGuard;
pub use limit::Limit;
pub use live_session::{
    BodyIn, HeldDevice, LiveSession, Outcome, PreparedSession, SessionBody, SessionError, ablation_name,
    is_recording,
};
pub use map::WorkspaceMap;
pub use opened::Opened;
pub use page_faults::PageFaults;
pub use passivity::PassivityController;
pub use real_time::{MemoryLock, RealTime};
pub use record::{
    BodyFile, CreateError, Ending, Field, Finished, Header, Listener, Map, OpenRecordingError,
    RECORDING_MAGIC, Record, Recorder, RecorderThread, Recording, RecordingFile, Records, Retrace, ring,
};
pub use safety::{GENTLE_N, GENTLE_NM, Safety, SafetyError};
pub use session::{Prepared, Report, Session, Settings, StartError, Stopper};
pub use soft_start::SoftStart;
pub use stages::Stages;
pub use statistics::{Percentiles, Statistics, Summary};
pub use supervise::{Observer, supervise};
pub use timed::Timed;
pub use virtual_session::{
    LimitCycle, Limits, LoopSummary, Mechanics, Passivity, SampledData, run_held, run_virtual,
};
pub use watch::{End, Patience};
