//! What a spec says, simulated: a body made of it, or compared with it.

use crate::errors::{CancelledError, Raised, argument};
use crate::interrupt::interruptible;
use crate::progress::{Listener, Progress, hearer};
use palpate::Body;
use palpate::build::Progress as _;
use palpate::build::precompute::{Stopped, body_of_spec};
use palpate::build::spec::Spec;
use palpate::build::validate::{Against, History, Validation, is_of_another_spec, validate_against};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Sender;

pub fn from_spec(
    py: Python<'_>,
    path: &Path,
    progress: Option<Py<PyAny>>,
    folder: Option<PathBuf>,
    jobs: usize,
) -> PyResult<Body> {
    let work = |sender: Sender<Progress>, cancelled: &AtomicBool| -> Result<Body, Stopped> {
        body_of_spec(path, folder.as_deref(), jobs, &Listener::new(sender), cancelled)
    };
    interruptible(py, work, hearer(progress))?.map_err(|stopped| match stopped {
        Stopped::Error(e) => e.raised(),
        Stopped::Cancelled { done, of } => {
            CancelledError::new_err(format!("ended: {done} of {of} test points are done"))
        }
    })
}

pub fn history(name: &str) -> PyResult<History> {
    let all = [History::Coulomb, History::Frictionless, History::Stick, History::FrictionlessPress];
    let names = || all.map(History::name).join(", ");
    let found = all.into_iter().find(|h| h.name() == name);
    found.ok_or_else(|| argument(format!("history is {name:?}; give one of {}", names())))
}

pub fn validate<'py>(
    py: Python<'py>,
    body: &Body,
    path: &Path,
    against: &Against,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let work = |sender: Sender<Progress>, cancelled: &AtomicBool| -> anyhow::Result<Option<Validation>> {
        let listener = Listener::new(sender);
        let spec = Spec::read(path)?;
        let simulation = spec.simulation(path)?;
        if is_of_another_spec(body, &spec) {
            let note = "the body was made from another spec; errors include what differs";
            listener.note(&format!("{}: {note}", path.display()));
        }
        validate_against(body, (&spec, &simulation, path), against, &listener, cancelled)
    };
    let found = interruptible(py, work, hearer(progress))?.map_err(Raised::raised)?;
    let found = found.ok_or_else(|| CancelledError::new_err("ended before all paths were simulated"))?;
    crate::python_of(py, &found)
}
