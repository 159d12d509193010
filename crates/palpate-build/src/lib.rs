//! From files to a body, without a command around it: nothing here prints, reads arguments or handles signals.
//!
//! [`fit::FitInputs`] makes a body of curves that were measured or given. A [`spec::Spec`] says what a body is made
//! from. [`precompute`] simulates its test points, keeps what is finished, and makes the body of the whole
//! [`paths_file::PathsRecord`]; [`refine`](mod@refine) gives a body a finer surface; [`validate`] measures how wrong
//! a body is. Long work tells a [`Progress`] how far it is, and ends early where its `cancelled` comes true.

pub mod fit;
pub mod law;
pub mod paths_file;
pub mod precompute;
mod progress;
pub mod refine;
pub mod spec;
pub mod validate;

pub use progress::Progress;
