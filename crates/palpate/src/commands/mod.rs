//! One module a subcommand: its arguments, and what it does with them.

pub mod bench;
pub mod certify;
pub mod demo;
pub mod export;
pub mod fit;
pub mod inspect;
pub mod merge;
pub mod precompute;
pub mod trace;
pub mod validate;

/// Why a command did not end with 0.
#[derive(Debug)]
pub enum Failure {
    /// The input was wrong: exit status 1, one message that says what, where, and how to mend it.
    Input(anyhow::Error),
    /// A check fell short: exit status 3.
    Check(String),
    /// A signal stopped it, and what is done is kept: exit status 130.
    Interrupted(String),
}

impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Failure::Input(error.into())
    }
}
