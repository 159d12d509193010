//! Sessions: a device on a body, prepared, started, read, steered, ended.

use crate::body::{Body, named_rule};
use crate::errors::{BusyError, Raised, SessionError, argument};
use palpate::runtime::{BodyFile, Record, Stopper, Summary};
use palpate::{LiveSession, PreparedSession, SessionBody, SessionConfig};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard, TryLockError};
use std::thread;
use std::time::{Duration, Instant};

/// Between two looks whether a session is over.
const BETWEEN_LOOKS: Duration = Duration::from_millis(2);
/// How soon Ctrl-C is heard.
const PATIENCE: Duration = Duration::from_millis(50);

impl Raised for palpate::SessionError {
    fn raised(self) -> PyErr {
        SessionError::new_err(self.to_string())
    }
}

impl Raised for palpate::runtime::ControlError {
    fn raised(self) -> PyErr {
        SessionError::new_err(self.to_string())
    }
}

/// Where a session is.
enum Phase {
    /// Behind a lock, since it can be sent to another thread and not be shared.
    Prepared(Mutex<Box<PreparedSession>>),
    Live(Box<LiveSession>),
    /// Closed, or it could not be started.
    Over(Box<Last>),
}

/// What is kept of a session that is closed.
#[derive(Default)]
struct Last {
    latest: Option<Record>,
    history: Vec<Record>,
    summary: Summary,
    notes: Vec<String>,
    advice: Option<String>,
    outcome: Option<Outcome>,
}

/// What became of a session.
#[pyclass(frozen, get_all, module = "palpate")]
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The device's name.
    pub device: String,
    /// Why it ended, in words.
    pub end: String,
    /// Whether it went as it should: its time was over, the device had no more poses, or somebody asked.
    pub is_well: bool,
    /// Periods that were run.
    pub periods: u64,
    /// Records that were written to the file.
    pub recorded: u64,
    /// What ended the recording early, or None.
    pub trouble: Option<String>,
}

#[pymethods]
impl Outcome {
    fn __repr__(&self) -> String {
        format!("<palpate.Outcome: {} after {} periods on {}>", self.end, self.periods, self.device)
    }
}

/// A device on a body, with its own thread, limits and watchdogs (docs/session.md).
///
/// Made, it is prepared: the device is open, and there is no force. `start`, or `with`, starts it; at the end of a `with` block it is closed.
/// Settings are those of docs/session.md, by name, tables as dicts: `Session(body, device="simulated:touch", seconds=2,
/// safety={"force_max_n": 1}, record="a.rec")`. Without any it is a simulated device in a simulated hand. docs/safety.md holds: read it before
/// the first touch of a real one. The haptic thread never waits for Python.
///
/// Args:
///     body: What is touched.
///     settings: Keys of docs/session.md.
///
/// Raises:
///     ArgumentError: A setting that there is not, or of the wrong kind.
///     SessionError: A value, or the device, was refused; the message says what to do.
#[pyclass(frozen, module = "palpate")]
pub struct Session {
    phase: RwLock<Phase>,
    stopper: Stopper,
    config: SessionConfig,
}

fn busy() -> PyErr {
    BusyError::new_err("another thread is starting, changing or closing this session; call again")
}

/// A body as sessions want it. A recording names the body's file with its digest.
fn session_body(body: &Body, is_recorded: bool) -> PyResult<SessionBody> {
    let file = match body.file.as_ref().filter(|_| is_recorded) {
        Some(path) => BodyFile::of(path).map_err(Raised::raised)?,
        None => BodyFile::default(),
    };
    Ok(SessionBody { source: body.shared.clone(), file })
}

impl Session {
    fn read(&self) -> PyResult<RwLockReadGuard<'_, Phase>> {
        match self.phase.try_read() {
            Ok(phase) => Ok(phase),
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => Err(busy()),
        }
    }

    fn write(&self) -> PyResult<RwLockWriteGuard<'_, Phase>> {
        match self.phase.try_write() {
            Ok(phase) => Ok(phase),
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => Err(busy()),
        }
    }

    /// What is done with a session that runs.
    fn live<R>(&self, call: impl FnOnce(&LiveSession) -> PyResult<R>) -> PyResult<R> {
        match &*self.read()? {
            Phase::Live(live) => call(live),
            Phase::Prepared(_) => Err(SessionError::new_err("the session does not run; start it first")),
            Phase::Over(_) => Err(SessionError::new_err("the session is closed; make another")),
        }
    }

    fn is_over_now(&self) -> PyResult<bool> {
        match self.phase.try_read().as_deref() {
            Ok(Phase::Live(live)) => Ok(live.is_over()),
            Ok(Phase::Prepared(_)) => Err(SessionError::new_err("the session does not run; start it first")),
            Ok(Phase::Over(_)) => Ok(true),
            // Being changed, or closed.
            Err(_) => Ok(false),
        }
    }

    /// Ends it, and waits for its threads.
    fn end(&self) {
        // Others are in there for moments only, and a session must not be left running because of them.
        let mut phase = self.phase.write().unwrap_or_else(PoisonError::into_inner);
        if matches!(&*phase, Phase::Over(_)) {
            return;
        }
        let last = match std::mem::replace(&mut *phase, Phase::Over(Box::default())) {
            Phase::Live(live) => {
                self.stopper.stop("the program asked for the end");
                let (notes, advice) = (live.notes().to_vec(), live.advice().map(str::to_owned));
                let history = wait_for(&live);
                let latest = live.latest();
                let outcome = live.join();
                let finished = outcome.finished;
                Last {
                    latest,
                    history,
                    summary: finished.summary,
                    notes,
                    advice,
                    outcome: Some(Outcome {
                        device: outcome.device,
                        end: outcome.report.end.to_string(),
                        is_well: outcome.report.end.is_well(),
                        periods: outcome.report.periods,
                        recorded: finished.written,
                        trouble: finished.trouble,
                    }),
                }
            }
            Phase::Prepared(prepared) => {
                let prepared = prepared.into_inner().unwrap_or_else(PoisonError::into_inner);
                let advice = prepared.advice().map(str::to_owned);
                Last { notes: prepared.notes().to_vec(), advice, ..Last::default() }
            }
            Phase::Over(last) => *last,
        };
        *phase = Phase::Over(Box::new(last));
    }
}

fn locked(prepared: &Mutex<Box<PreparedSession>>) -> MutexGuard<'_, Box<PreparedSession>> {
    prepared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Until its haptic thread has ended; then what the recorder has kept of the past.
fn wait_for(live: &LiveSession) -> Vec<Record> {
    while !live.is_over() {
        thread::sleep(BETWEEN_LOOKS);
    }
    live.history()
}

#[pymethods]
impl Session {
    #[new]
    #[pyo3(signature = (body, **settings))]
    fn new(py: Python<'_>, body: &Body, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let config = match settings {
            None => SessionConfig::default(),
            Some(settings) => {
                let text: String =
                    py.import("palpate._settings")?.call_method1("as_json", (settings,))?.extract()?;
                serde_json::from_str(&text)
                    .map_err(|e| argument(format!("settings: {e}; docs/session.md has their names")))?
            }
        };
        let prepared = py.detach(|| {
            let body = session_body(body, config.record.is_some())?;
            PreparedSession::new(body, config.clone(), None).map_err(Raised::raised)
        })?;
        let stopper = prepared.stopper();
        Ok(Session { phase: RwLock::new(Phase::Prepared(Mutex::new(Box::new(prepared)))), stopper, config })
    }

    /// Starts the threads, and the recording if there is to be one: from now on there are forces.
    ///
    /// Raises:
    ///     SessionError: It was started before, or a thread or the recording can't be had; the device is closed then.
    fn start(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| {
            let mut phase = self.write()?;
            if !matches!(&*phase, Phase::Prepared(_)) {
                return Err(SessionError::new_err("the session was started before; make another"));
            }
            if let Phase::Prepared(prepared) = std::mem::replace(&mut *phase, Phase::Over(Box::default())) {
                let prepared = prepared.into_inner().unwrap_or_else(PoisonError::into_inner);
                *phase = Phase::Live(Box::new(prepared.start().map_err(Raised::raised)?));
            }
            Ok(())
        })
    }

    /// Waits until the session is over by itself, or a time has passed. The interpreter is free meanwhile; Ctrl-C ends the waiting,
    /// not the session.
    ///
    /// Args:
    ///     timeout_s: How long at most, s; without it for as long as it takes.
    ///
    /// Returns:
    ///     Whether it is over.
    ///
    /// Raises:
    ///     SessionError: It was never started.
    #[pyo3(signature = (*, timeout_s=None))]
    fn wait(&self, py: Python<'_>, timeout_s: Option<f64>) -> PyResult<bool> {
        let begun = Instant::now();
        // What is no number does not wait.
        let left = || timeout_s.map(|t| t - begun.elapsed().as_secs_f64());
        let is_up = || left().is_some_and(|left| left.is_nan() || left <= 0.0);
        loop {
            let part = Instant::now();
            let is_over = py.detach(|| {
                loop {
                    let is_over = self.is_over_now()?;
                    if is_over || is_up() || part.elapsed() >= PATIENCE {
                        return PyResult::Ok(is_over);
                    }
                    let nap = left().map_or(BETWEEN_LOOKS, |s| {
                        Duration::from_secs_f64(s.clamp(0.0, BETWEEN_LOOKS.as_secs_f64()))
                    });
                    thread::sleep(nap);
                }
            })?;
            py.check_signals()?;
            if is_over || is_up() {
                return Ok(is_over);
            }
        }
    }

    /// The latest period, a record with the fields of `RECORD_DTYPE` (docs/recording.md says what each is): poses, forces, command,
    /// contact, energies, flags, times. None before the first. The haptic thread does not notice who reads.
    fn latest<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let record = match &*self.read()? {
            Phase::Live(live) => live.latest(),
            Phase::Prepared(_) => None,
            Phase::Over(last) => last.latest,
        };
        record.map(|record| records(py, &[record])?.get_item(0)).transpose()
    }

    /// Periods of the past, as many a second as the setting `history` says, the oldest first.
    ///
    /// Returns:
    ///     A record array (n,), fields as `RECORD_DTYPE` has them.
    fn history<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let past = py.detach(|| {
            PyResult::Ok(match &*self.read()? {
                Phase::Live(live) => live.history(),
                Phase::Prepared(_) => Vec::new(),
                Phase::Over(last) => last.history.clone(),
            })
        })?;
        records(py, &past)
    }

    /// Statistics so far, as a dict: periods, percentiles of times (ns), energies (J), the largest force (N).
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let summary = py.detach(|| {
            PyResult::Ok(match &*self.read()? {
                Phase::Live(live) => live.summary(),
                Phase::Prepared(_) => Summary::default(),
                Phase::Over(last) => last.summary.clone(),
            })
        })?;
        crate::python_of(py, &summary)
    }

    /// All settings, also those that were not given, as a dict.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        crate::python_of(py, &self.config)
    }

    /// What could not be had (a watchdog, locked memory, a priority), a line each: known before the first force.
    #[getter]
    fn notes(&self) -> PyResult<Vec<String>> {
        Ok(match &*self.read()? {
            Phase::Prepared(prepared) => locked(prepared).notes().to_vec(),
            Phase::Live(live) => live.notes().to_vec(),
            Phase::Over(last) => last.notes.clone(),
        })
    }

    /// What the hand should know of this device on this body before it touches it, or None.
    #[getter]
    fn advice(&self) -> PyResult<Option<String>> {
        Ok(match &*self.read()? {
            Phase::Prepared(prepared) => locked(prepared).advice().map(str::to_owned),
            Phase::Live(live) => live.advice().map(str::to_owned),
            Phase::Over(last) => last.advice.clone(),
        })
    }

    /// What became of it; None until it is closed, or if it was never started.
    #[getter]
    fn outcome(&self) -> PyResult<Option<Outcome>> {
        Ok(match &*self.read()? {
            Phase::Over(last) => last.outcome.clone(),
            _ => None,
        })
    }

    /// Sets the largest force, and how fast it may change. Like every change it is made in silence: the force goes to zero, the change is
    /// made, the force ramps up anew.
    ///
    /// Args:
    ///     force_max_n: N; up to what the device was opened with.
    ///     slew_n_per_s: N/s; the slowest that lets a stop end in two periods if not given.
    ///
    /// Raises:
    ///     SessionError: It was refused, or the session does not run.
    #[pyo3(signature = (*, force_max_n, slew_n_per_s=None))]
    fn set_force_limit(&self, force_max_n: f64, slew_n_per_s: Option<f64>) -> PyResult<()> {
        self.live(|live| live.controls().set_force_limit(force_max_n, slew_n_per_s).map_err(Raised::raised))
    }

    /// Sets the largest torque, and how fast it may change.
    ///
    /// Args:
    ///     torque_max_nm: N m.
    ///     slew_nm_per_s: N m/s.
    ///
    /// Raises:
    ///     SessionError: It was refused, or the session does not run.
    #[pyo3(signature = (*, torque_max_nm, slew_nm_per_s=None))]
    fn set_torque_limit(&self, torque_max_nm: f64, slew_nm_per_s: Option<f64>) -> PyResult<()> {
        self.live(|live| {
            live.controls().set_torque_limit(torque_max_nm, slew_nm_per_s).map_err(Raised::raised)
        })
    }

    /// Sets what multiplies the body's friction coefficients, 0 to 100.
    ///
    /// Raises:
    ///     SessionError: It was refused, or the session does not run.
    #[pyo3(signature = (scale, /))]
    fn set_friction_scale(&self, scale: f64) -> PyResult<()> {
        self.live(|live| live.controls().set_friction_scale(scale).map_err(Raised::raised))
    }

    /// Goes over to another slip rule: "consistent", "paper" or "exact".
    ///
    /// Raises:
    ///     ArgumentError: There is no such rule.
    ///     SessionError: It was refused, or the session does not run.
    #[pyo3(signature = (rule, /))]
    fn set_slip_rule(&self, rule: &str) -> PyResult<()> {
        let rule = named_rule(rule)?;
        match &mut *self.write()? {
            Phase::Live(live) => live.set_slip_rule(rule).map_err(Raised::raised),
            _ => Err(SessionError::new_err("the session does not run")),
        }
    }

    /// Goes over to another body; not while a recording is written. A tool that is inside the new body feels nothing until it has left it.
    ///
    /// Raises:
    ///     SessionError: It was refused, or the session does not run.
    #[pyo3(signature = (body, /))]
    fn change_body(&self, py: Python<'_>, body: &Body) -> PyResult<()> {
        py.detach(|| match &mut *self.write()? {
            Phase::Live(live) => live.change_body(session_body(body, false)?).map_err(Raised::raised),
            _ => Err(SessionError::new_err("the session does not run")),
        })
    }

    /// No force, until `resume`.
    fn pause(&self) -> PyResult<()> {
        self.live(|live| {
            live.controls().pause();
            Ok(())
        })
    }

    /// Ends a pause: the force ramps up anew.
    fn resume(&self) -> PyResult<()> {
        self.live(|live| {
            live.controls().resume();
            Ok(())
        })
    }

    /// Asks for the end, and waits for nothing: zero force within two periods, and a closed device.
    fn stop(&self) {
        self.stopper.stop("the program asked for the end");
    }

    /// The same with zero force before anything else, by the device's own emergency stop.
    fn stop_at_once(&self) {
        self.stopper.stop_at_once("the program asked for an emergency stop");
    }

    /// Ends it if it has not ended, waits for its threads and its recording, and closes the device. Once more does nothing.
    ///
    /// Returns:
    ///     What became of it; None if it was never started.
    fn close(&self, py: Python<'_>) -> PyResult<Option<Outcome>> {
        py.detach(|| self.end());
        self.outcome()
    }

    fn __enter__(this: Bound<'_, Self>) -> PyResult<Bound<'_, Self>> {
        let is_prepared = matches!(&*this.get().read()?, Phase::Prepared(_));
        if is_prepared {
            this.get().start(this.py())?;
        }
        Ok(this)
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) {
        py.detach(|| self.end());
    }

    fn __repr__(&self) -> String {
        let phase = match self.phase.try_read().as_deref() {
            Ok(Phase::Prepared(_)) => "prepared",
            Ok(Phase::Live(live)) if live.is_over() => "over",
            Ok(Phase::Live(_)) => "running",
            Ok(Phase::Over(_)) => "closed",
            Err(_) => "changing",
        };
        format!("<palpate.Session: {phase}>")
    }
}

/// The numpy dtype of records.
pub fn dtype(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
    static DTYPE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let made = DTYPE.get_or_try_init(py, || {
        let fields = Record::fields();
        let kind = |kind: &str, count: u32| {
            let code = match kind {
                "f64" => "<f8",
                "u64" => "<u8",
                "i64" => "<i8",
                _ => "<u4",
            };
            if count == 1 { code.to_owned() } else { format!("({count},){code}") }
        };
        let layout = PyDict::new(py);
        layout.set_item("names", fields.iter().map(|f| f.name.as_str()).collect::<Vec<_>>())?;
        layout.set_item("formats", fields.iter().map(|f| kind(&f.kind, f.count)).collect::<Vec<_>>())?;
        layout.set_item("offsets", fields.iter().map(|f| f.offset).collect::<Vec<_>>())?;
        layout.set_item("itemsize", Record::BYTES)?;
        let numpy = py.import("numpy")?;
        let plain = numpy.getattr("dtype")?.call1((layout,))?;
        let record = numpy.getattr("dtype")?.call1(((numpy.getattr("record")?, plain),))?;
        PyResult::Ok(record.unbind())
    })?;
    Ok(made.bind(py))
}

/// A record array that can't be written to.
fn records<'py>(py: Python<'py>, all: &[Record]) -> PyResult<Bound<'py, PyAny>> {
    let bytes = PyBytes::new(py, bytemuck::cast_slice(all));
    let numpy = py.import("numpy")?;
    let plain = numpy.call_method1("frombuffer", (bytes, "u1"))?;
    let arguments = PyDict::new(py);
    arguments.set_item("dtype", dtype(py)?)?;
    arguments.set_item("type", numpy.getattr("recarray")?)?;
    plain.call_method("view", (), Some(&arguments))
}
