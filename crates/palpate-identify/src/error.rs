//! The one error of this crate.

use palpate_body::BodyError;
use std::path::Path;

/// Why samples could not become responses.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The samples or options are wrong.
    #[error("{file}{place}: {problem}; {hint}", file = file.as_ref().map(|f| format!("{f}: ")).unwrap_or_default())]
    Invalid {
        /// The samples' file, once it is known (see [`FitError::in_file`]).
        file: Option<String>,
        /// Where: a line, column, point or node.
        place: String,
        /// What was found there, and what was expected.
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
    /// A curve or surface was refused.
    #[error(transparent)]
    Body(#[from] BodyError),
}

impl FitError {
    pub(crate) fn invalid(
        place: impl Into<String>,
        problem: impl Into<String>,
        hint: impl Into<String>,
    ) -> Self {
        FitError::Invalid { file: None, place: place.into(), problem: problem.into(), hint: hint.into() }
    }

    /// The same error with the samples' file in it, unless it already names one.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        match self {
            FitError::Invalid { file: None, place, problem, hint } => {
                FitError::Invalid { file: Some(path.display().to_string()), place, problem, hint }
            }
            other => other,
        }
    }
}
