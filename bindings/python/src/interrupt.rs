//! Long work on a thread of its own, while the caller's waits for signals and hears how far it is.

use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

/// How soon Ctrl-C is heard.
const PATIENCE: Duration = Duration::from_millis(50);

/// Runs `work` on another thread without the interpreter's lock. What it sends, `hear` is given on the caller's thread with the lock.
/// `work` is to end soon once its flag comes true: that is when a signal came (Ctrl-C), or `hear` failed, whose exception
/// is then the result.
pub fn interruptible<T: Send, E: Send>(
    py: Python<'_>,
    work: impl FnOnce(Sender<E>, &AtomicBool) -> T + Send,
    mut hear: impl FnMut(Python<'_>, E) -> PyResult<()> + Send,
) -> PyResult<T> {
    let cancelled = AtomicBool::new(false);
    py.detach(|| {
        thread::scope(|scope| {
            let (sender, receiver): (Sender<E>, Receiver<E>) = channel();
            let flag = &cancelled;
            let worker = thread::Builder::new().spawn_scoped(scope, move || work(sender, flag))?;
            let mut failed: Option<PyErr> = None;
            loop {
                let event = match receiver.recv_timeout(PATIENCE) {
                    Ok(event) => Some(event),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                if failed.is_some() {
                    continue;
                }
                let heard = Python::attach(|py| {
                    py.check_signals()?;
                    event.map_or(Ok(()), |event| hear(py, event))
                });
                if let Err(e) = heard {
                    cancelled.store(true, Ordering::Relaxed);
                    failed = Some(e);
                }
            }
            let result = worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            failed.map_or(Ok(result), Err)
        })
    })
}
