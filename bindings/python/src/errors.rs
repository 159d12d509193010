//! The one tree of exceptions: what Rust's errors become in Python.

use palpate::identify::FitError;
use palpate::{BodyError, files};
use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(palpate, Error, PyException, "What all of palpate's exceptions are.");
create_exception!(
    palpate,
    InputError,
    Error,
    "A mesh, samples, a spec, a path or a body file is wrong or can't be read; the message names file and place."
);
create_exception!(
    palpate,
    ArgumentError,
    Error,
    "An argument has the wrong shape, or a value that is impossible; the message names it."
);
create_exception!(
    palpate,
    BusyError,
    Error,
    "Another thread is using this contact, or changing this session."
);
create_exception!(
    palpate,
    CancelledError,
    Error,
    "Long work ended early because its progress function returned False."
);
create_exception!(
    palpate,
    SessionError,
    Error,
    "A session, its device, a setting or a change was refused; the message says what to do."
);
/// A Rust error as the exception that it is in Python.
pub trait Raised {
    /// It.
    fn raised(self) -> PyErr;
}

impl Raised for BodyError {
    fn raised(self) -> PyErr {
        InputError::new_err(self.to_string())
    }
}

impl Raised for FitError {
    fn raised(self) -> PyErr {
        InputError::new_err(self.to_string())
    }
}

impl Raised for anyhow::Error {
    fn raised(self) -> PyErr {
        InputError::new_err(files::message(&self))
    }
}

/// An argument that can't be used.
pub fn argument(message: impl Into<String>) -> PyErr {
    ArgumentError::new_err(message.into())
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("Error", py.get_type::<Error>())?;
    module.add("InputError", py.get_type::<InputError>())?;
    module.add("ArgumentError", py.get_type::<ArgumentError>())?;
    module.add("BusyError", py.get_type::<BusyError>())?;
    module.add("CancelledError", py.get_type::<CancelledError>())?;
    module.add("SessionError", py.get_type::<SessionError>())
}
