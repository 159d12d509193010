//! The one error of this crate.

use palpate_body::BodyError;
use std::path::Path;

/// Why a body can't be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// The input is wrong; nothing was changed.
    #[error("{file}{place}: {problem}; {hint}", file = file.as_ref().map(|f| format!("{f}: ")).unwrap_or_default())]
    Invalid {
        /// The file, once it is known (see [`SimulateError::in_file`]).
        file: Option<String>,
        /// Where in the input: a line, byte, element, node or key.
        place: String,
        /// What is wrong there: what was expected, and what was found.
        problem: String,
        /// What the user can do about it.
        hint: String,
    },
    /// The operating system refused to read.
    #[error("{file}: {source}; check that the path exists and is readable")]
    Io {
        /// The file.
        file: String,
        /// The operating system's answer.
        source: std::io::Error,
    },
    /// A surface or shape was refused.
    #[error(transparent)]
    Body(#[from] BodyError),
}

impl SimulateError {
    /// An input error at `place`, not yet tied to a file.
    pub fn invalid(place: impl Into<String>, problem: impl Into<String>, hint: impl Into<String>) -> Self {
        SimulateError::Invalid { file: None, place: place.into(), problem: problem.into(), hint: hint.into() }
    }

    /// The same error with the file's name in it, unless it already names one.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        match self {
            SimulateError::Invalid { file: None, place, problem, hint } => {
                SimulateError::Invalid { file: Some(path.display().to_string()), place, problem, hint }
            }
            SimulateError::Body(e) => SimulateError::Body(e.in_file(path)),
            other => other,
        }
    }
}

/// Shorthand for this crate's results.
pub type Result<T> = std::result::Result<T, SimulateError>;
