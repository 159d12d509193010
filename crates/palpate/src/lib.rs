//! Touch soft bodies: haptic rendering of contact with nonlinear deformable bodies.
//!
//! Programs that render contact themselves need [`Body`] and [`Contact`] only:
//!
//! ```no_run
//! use palpate::{Body, Contact, ToolState};
//!
//! let body = Body::open("liver.body".as_ref())?;
//! let mut contact = Contact::new(&body);
//! let output = contact.step(&body, &ToolState::at([0.0, 0.0, 31e-3]), 1e-3);
//! println!("{:?} N", output.force_n);
//! # Ok::<(), palpate::BodyError>(())
//! ```

pub use palpate_body as body;
#[cfg(feature = "simulate")]
pub use palpate_build as build;
pub use palpate_device as device;
pub use palpate_engine as engine;
pub use palpate_identify as identify;
pub use palpate_runtime as runtime;

pub use palpate_body::{Body, BodyError};
pub use palpate_engine::{Ablation, Contact, Output, ToolState};

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
