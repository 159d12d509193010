//! The haptic engine: contact point, force, slip and energy of one tool on a body.
//!
//! A [`Contact`] holds all that evolves; [`Contact::step`] takes where the tool is, and how much later, and gives one [`Output`]. The body is
//! read, never written, so any number of contacts may share it. The model is that of Mahvash and Hayward, *Haptic
//! simulation of a tool in contact with a nonlinear deformable body* (2003); equation numbers in this crate are
//! theirs.
//!
//! # Real-time
//! `step` never allocates, locks, logs, reads a clock or a file, or panics; every loop in it is bounded. It has no
//! error: what went wrong is in [`Output::flags`] and [`Contact::counters`]. The same poses give the same bits on
//! every x86-64 machine.
//!
//! ```
//! # use palpate_body::{*, shape::Shape};
//! use palpate_engine::{Contact, ToolState};
//! # let surface = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default())?;
//! # let responses = vec![Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3)?];
//! # let body = Body::new(BodyParts { blends: vec![BlendWeights::own(0); surface.positions().len()], surface, responses,
//! #     test_point_nodes: vec![0], coupled: None, lateral_tensors: None, tool: Tool::Point, slip: SlipRule::Paper,
//! #     tank: true,
//! #     partial_slip: false,
//! #     provenance: Provenance::default() })?;
//! let mut contact = Contact::new(&body);
//! contact.step(&body, &ToolState::at([0.0, 0.0, 31e-3]), 1e-3); // above the sphere
//! let output = contact.step(&body, &ToolState::at([0.0, 0.0, 28e-3]), 1e-3); // about 2 mm deep
//! assert!(output.contact.is_some());
//! assert!(output.force_n[2] > 0.2); // the tool is pushed out again
//! # Ok::<(), BodyError>(())
//! ```

mod budget;
pub mod certify;
mod contact;
mod coupled;
mod decoupled;
mod drive;
mod flags;
mod force_law;
mod kernel;
mod output;
mod point_contact;
mod rollout;
mod sensitivity;
mod slip;
mod walk;

pub use contact::{Contact, PARTIAL_SLIP};
pub use flags::Flags;
pub use kernel::Ablation;
pub use output::{ContactPoint, Counters, Ledger, Output, ToolState};
pub use rollout::{Rollout, Waypoint, rollout};
