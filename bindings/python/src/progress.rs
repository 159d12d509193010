//! How far long work is: what it sends, and who hears it.

use crate::errors::CancelledError;
use pyo3::prelude::*;

/// How far long work is.
#[pyclass(frozen, get_all, module = "palpate")]
#[derive(Debug, Clone)]
pub struct Progress {
    /// Points, paths, or elements that are done.
    pub done: usize,
    /// Of how many; 0 as long as that is not known. Where test points are added in rounds it grows.
    pub total: usize,
    /// Something that deserves to be said, or None.
    pub message: Option<String>,
}

#[pymethods]
impl Progress {
    fn __repr__(&self) -> String {
        let message = self.message.as_ref().map(|m| format!(", {m}")).unwrap_or_default();
        format!("<palpate.Progress: {} of {}{message}>", self.done, self.total)
    }
}

/// What gives the events to a Python function, which ends the work with False.
pub fn hearer(function: Option<Py<PyAny>>) -> impl FnMut(Python<'_>, Progress) -> PyResult<()> + Send {
    move |py, progress| {
        let Some(function) = &function else { return Ok(()) };
        let answer = function.bind(py).call1((progress,))?;
        match answer.extract::<bool>() {
            Ok(false) => Err(CancelledError::new_err("ended: the progress function returned False")),
            _ => Ok(()),
        }
    }
}

#[cfg(feature = "build")]
pub use listener::Listener;

#[cfg(feature = "build")]
mod listener {
    use super::Progress;
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

    impl palpate::build::Progress for Listener {
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
}
