//! `palpate inspect`.

use super::Failure;

/// (to come)
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(_: &Args) -> Result<(), Failure> {
    Ok(())
}
