//! The parts of the `palpate` command: what it parses, draws and prints. Programs use the crate `palpate`.

pub mod bench;
pub mod commands;
pub mod console;
pub mod demo;
pub mod glb;
pub mod inspect;
pub mod live;
pub mod plot;
pub mod progress;
pub mod tables;
mod validation_charts;
pub mod vtu;

pub use validation_charts::charts;
