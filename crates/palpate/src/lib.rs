//! Touch soft bodies: haptic rendering of contact with nonlinear deformable bodies.
//!
//! A program that has a loop of its own needs [`Body`] and [`Contact`]:
//!
//! ```
//! use palpate::body::{Response, shape::Shape};
//! use palpate::{Body, Contact, ToolState};
//!
//! // Or Body::open("liver.body".as_ref())?
//! let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default())?;
//! let body = Body::uniform(ball, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3)?)?;
//! let mut contact = Contact::new(&body);
//! contact.step(&body, &ToolState::at([0.0, 0.0, 31e-3]), 1e-3); // above it
//! let output = contact.step(&body, &ToolState::at([0.0, 0.0, 28e-3]), 1e-3);
//! assert!(output.force_n[2] > 0.2); // N, on the tool
//! # Ok::<(), palpate::BodyError>(())
//! ```
//!
//! One that lets palpate run the device owns a [`LiveSession`]: haptic thread, contact finder, limits and watchdogs. It is
//! made from a [`SessionConfig`], read at any rate ([`LiveSession::latest`]), and steered ([`LiveSession::controls`]); see
//! `docs/session.md`, and the example `own_session`.
//!
//! # Features
//! - `devices`: the drivers of vendors' devices, whose libraries are opened at run time.
//! - `simulate`: bodies from a spec, by finite elements; how wrong they are ([`build`]).
//!
//! Both are on by default. Nothing here prints, parses arguments, or handles signals.

pub use palpate_body as body;
#[cfg(feature = "simulate")]
pub use palpate_build as build;
pub use palpate_device as device;
pub use palpate_engine as engine;
pub use palpate_files as files;
pub use palpate_identify as identify;
pub use palpate_runtime as runtime;

pub use palpate_body::{Body, BodyError};
pub use palpate_engine::{Ablation, Contact, Output, ToolState};
pub use palpate_runtime::{
    Controls, LiveSession, Outcome, PreparedSession, SessionBody, SessionConfig, SessionError, run_virtual,
};

/// The README's programs, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
