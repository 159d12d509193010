//! The one error of this crate: what is wrong with the user's input, where, and how to correct it.

use std::path::Path;

/// Why a mesh, shape, response or body file was refused.
#[derive(Debug, thiserror::Error)]
pub enum BodyError {
    /// The input is wrong; nothing was changed.
    #[error("{file}{place}: {problem}; {hint}", file = file.as_ref().map(|f| format!("{f}: ")).unwrap_or_default())]
    Invalid {
        /// The file, once it is known (see [`BodyError::in_file`]).
        file: Option<String>,
        /// Where in the input: a line, triangle, tensor or key.
        place: String,
        /// What is wrong there: what was expected, and what was found.
        problem: String,
        /// What the user can do about it.
        hint: String,
    },
    /// The operating system refused to read or write.
    #[error(
        "{file}: {source}; check that the path exists, is readable and writable, and that the disk has room"
    )]
    Io {
        /// The file.
        file: String,
        /// The operating system's answer.
        source: std::io::Error,
    },
}

impl BodyError {
    /// An input error at `place`, not yet tied to a file.
    pub fn invalid(place: impl Into<String>, problem: impl Into<String>, hint: impl Into<String>) -> Self {
        BodyError::Invalid { file: None, place: place.into(), problem: problem.into(), hint: hint.into() }
    }

    /// An operating-system error on `path`.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        BodyError::Io { file: path.display().to_string(), source }
    }

    /// The same error with the file's name in it, unless it already names one.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        match self {
            BodyError::Invalid { file: None, place, problem, hint } => {
                BodyError::Invalid { file: Some(path.display().to_string()), place, problem, hint }
            }
            other => other,
        }
    }
}

/// Shorthand for this crate's results.
pub type Result<T> = std::result::Result<T, BodyError>;
