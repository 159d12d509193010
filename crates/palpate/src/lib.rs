//! Touch soft bodies: the facade of palpate's crates, and the parts of the `palpate` command.
//!
//! Programs that render contact need [`Body`] and [`Contact`] only:
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

pub mod bench;
pub mod certify;
pub mod closed_loop;
pub mod commands;
pub mod console;
pub mod csv_table;
pub mod demo;
pub mod files;
pub mod inspect;
pub mod intent;
pub mod law;
pub mod live;
pub mod path;
pub mod plot;
pub mod precompute;
pub mod record;
pub mod spec;
pub mod tables;
pub mod trace;
pub mod validate;
pub mod vtu;

pub use palpate_body::{Body, BodyError};
pub use palpate_engine::{Ablation, Contact, Output, ToolState};

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
