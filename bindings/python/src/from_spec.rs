//! Bodies from a spec, simulated; what their progress tells.

use crate::errors::{CancelledError, Raised};
use crate::interrupt::interruptible;
use crate::make::Progress;
use palpate::Body;
use palpate::build::Progress as Listening;
use palpate::build::precompute::{Stopped, body_of_spec};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Sender;
use std::sync::{Mutex, PoisonError};

/// Sends on what it hears.
pub struct Listener {
    sender: Mutex<(Sender<Progress>, Progress)>,
}

impl Listener {
    pub fn new(sender: Sender<Progress>) -> Self {
        let progress = Progress { done: 0, total: 0, message: None };
        Listener { sender: Mutex::new((sender, progress)) }
    }

    fn tell(&self, message: Option<&str>, change: impl FnOnce(&mut Progress)) {
        let mut state = self.sender.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut state.1);
        // Whoever does not listen any more has ended the work.
        let _ = state.0.send(Progress { message: message.map(str::to_owned), ..state.1.clone() });
    }
}

impl Listening for Listener {
    fn begin(&self, points: usize, before: usize) {
        self.tell(None, |p| (p.total, p.done) = (points, before));
    }

    fn done(&self, _: usize) {
        self.tell(None, |p| p.done += 1);
    }

    fn note(&self, message: &str) {
        self.tell(Some(message), |_| ());
    }
}

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

/// What gives the events to a Python function, which ends the work with False.
fn hearer(function: Option<Py<PyAny>>) -> impl FnMut(Python<'_>, Progress) -> PyResult<()> + Send {
    move |py, progress| {
        let Some(function) = &function else { return Ok(()) };
        let answer = function.bind(py).call1((progress,))?;
        match answer.extract::<bool>() {
            Ok(false) => Err(CancelledError::new_err("ended: the progress function returned False")),
            _ => Ok(()),
        }
    }
}
