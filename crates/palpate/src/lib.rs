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

pub mod colours;

pub use palpate_body as body;
#[cfg(feature = "simulate")]
pub use palpate_build as build;
pub use palpate_certify as certify;
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

/// Version, commit and features: "0.1.0 (commit 0123456789ab; features: devices, simulate)". The commit is known in release builds
/// from a repository's checkout, or where `PALPATE_COMMIT` said it to the build.
pub const VERSION: &str = env!("PALPATE_BUILT_VERSION");

/// The README's programs, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;

#[cfg(test)]
mod tests {
    #[test]
    fn the_version_says_commit_and_features() {
        let (number, rest) = super::VERSION.split_once(" (").unwrap();
        assert_eq!(number, env!("CARGO_PKG_VERSION"));
        let (built, features) = rest.trim_end_matches(')').split_once("; features: ").unwrap();
        assert!(built.starts_with("commit ") || built == "development build", "{built}");
        for (name, is_on) in
            [("devices", cfg!(feature = "devices")), ("simulate", cfg!(feature = "simulate"))]
        {
            assert_eq!(features.contains(name), is_on, "{features}");
        }
        // The same bytes wherever it was built.
        assert!(!super::VERSION.contains(['/', '\\']), "{}", super::VERSION);
    }
}
