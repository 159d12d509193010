//! Contacts led along paths, without a clock: one, or many on all cores.

use crate::body::Body;
use crate::contact::{self, Contact};
use crate::errors::argument;
use crate::interrupt::interruptible;
use crate::path::Path;
use numpy::{PyArray1, PyArrayMethods, PyReadwriteArray1};
use palpate::engine;
use palpate::engine::Output;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyList, PySlice};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

/// Steps between two looks for Ctrl-C: some tens of milliseconds.
pub const BETWEEN_SIGNALS: usize = 1 << 17;

/// A row of a trace, as `TRACE_DTYPE` tells numpy.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Row {
    force_n: [f64; 3],
    torque_nm: [f64; 3],
    element: i32,
    flags: u32,
    area_coordinates: [f64; 3],
    contact_position_m: [f64; 3],
    delta_z_m: f64,
    delta_r_m: f64,
    work_j: f64,
    stored_j: f64,
    dissipated_j: f64,
    generated_j: f64,
    tank_j: f64,
    relaxed_j: f64,
}

/// Name, numpy's kind, and how many of each field, in the order of [`Row`].
const FIELDS: [(&str, &str, usize); 14] = [
    ("force_n", "<f8", 3),
    ("torque_nm", "<f8", 3),
    ("element", "<i4", 1),
    ("flags", "<u4", 1),
    ("area_coordinates", "<f8", 3),
    ("contact_position_m", "<f8", 3),
    ("delta_z_m", "<f8", 1),
    ("delta_r_m", "<f8", 1),
    ("work_j", "<f8", 1),
    ("stored_j", "<f8", 1),
    ("dissipated_j", "<f8", 1),
    ("generated_j", "<f8", 1),
    ("tank_j", "<f8", 1),
    ("relaxed_j", "<f8", 1),
];

const WORDS: usize = size_of::<Row>() / size_of::<f64>();

impl Row {
    #[inline]
    fn of(output: &Output) -> Self {
        let nowhere = engine::ContactPoint {
            element: u32::MAX,
            n: [f64::NAN; 3],
            position_m: [f64::NAN; 3],
            delta_z_m: 0.0,
            delta_r_m: 0.0,
        };
        let contact = output.contact.unwrap_or(nowhere);
        Row {
            force_n: output.force_n,
            torque_nm: output.torque_nm,
            // No body has 2³¹ elements: none is -1.
            element: contact.element as i32,
            flags: output.flags.bits(),
            area_coordinates: contact.n,
            contact_position_m: contact.position_m,
            delta_z_m: contact.delta_z_m,
            delta_r_m: contact.delta_r_m,
            work_j: output.energy.work_j,
            stored_j: output.energy.stored_j,
            dissipated_j: output.energy.dissipated_j,
            generated_j: output.energy.generated_j,
            tank_j: output.energy.tank_j,
            relaxed_j: output.energy.relaxed_j,
        }
    }
}

/// Leads a contact along the poses from number `from` on, one for each row.
pub fn lead(contact: &mut engine::Contact, body: &palpate::Body, path: &Path, from: usize, rows: &mut [Row]) {
    for (k, row) in (from..).zip(rows) {
        *row = Row::of(&contact.step(body, &path.pose(k), path.dt_s(k)));
    }
}

/// The numpy dtype of a trace's records.
pub fn dtype(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
    static DTYPE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let made = DTYPE.get_or_try_init(py, || {
        let numpy = py.import("numpy")?;
        let fields = PyList::empty(py);
        for (name, kind, count) in FIELDS {
            match count {
                1 => fields.append((name, kind))?,
                _ => fields.append((name, kind, (count,)))?,
            }
        }
        let plain = numpy.getattr("dtype")?.call1((fields,))?;
        let record = numpy.getattr("dtype")?.call1(((numpy.getattr("record")?, plain),))?;
        PyResult::Ok(record.unbind())
    })?;
    Ok(made.bind(py))
}

/// A trace of so many rows: zeros, or the caller's.
pub fn trace<'py>(
    py: Python<'py>,
    rows: usize,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    if let Some(out) = out {
        let fits = out.getattr("dtype")?.eq(dtype(py)?)? && out.getattr("shape")?.eq((rows,))?;
        return if fits {
            Ok(out)
        } else {
            Err(argument(format!("out does not fit; give a trace of {rows} rows from an earlier rollout")))
        };
    }
    let words = PyArray1::<f64>::zeros(py, rows * WORDS, false);
    let arguments = PyDict::new(py);
    arguments.set_item("dtype", dtype(py)?)?;
    arguments.set_item("type", py.import("numpy")?.getattr("recarray")?)?;
    words.call_method("view", (), Some(&arguments))
}

/// A trace's memory, borrowed as numpy's rules ask.
pub struct Room<'py>(PyReadwriteArray1<'py, f64>);

impl Room<'_> {
    pub fn rows(&mut self) -> PyResult<&mut [Row]> {
        let words =
            self.0.as_slice_mut().map_err(|_| argument("out is not contiguous; give a whole trace"))?;
        Ok(bytemuck::cast_slice_mut(words))
    }
}

pub fn room<'py>(trace: &Bound<'py, PyAny>) -> PyResult<Room<'py>> {
    let py = trace.py();
    let arguments = PyDict::new(py);
    arguments.set_item("dtype", "<f8")?;
    arguments.set_item("type", py.import("numpy")?.getattr("ndarray")?)?;
    let words = trace.call_method("view", (), Some(&arguments))?;
    let words = words.cast_into::<PyArray1<f64>>().map_err(|_| argument("out is no trace of a rollout"))?;
    let borrowed = words.try_readwrite().map_err(|e| argument(format!("out can't be written to: {e}")))?;
    Ok(Room(borrowed))
}

/// So many threads, or one for each core.
pub fn threads(given: Option<usize>) -> PyResult<usize> {
    match given {
        None => Ok(thread::available_parallelism().map_or(1, usize::from)),
        Some(0) => Err(argument("threads is 0; give 1 or more, or None for one on each core")),
        Some(n) => Ok(n.min(1024)),
    }
}

/// Leads a new contact along each path, on all cores: the same bits as one after the other.
///
/// The interpreter is free meanwhile; Ctrl-C ends it. Threads are started for the call and end with it, so that it also works in a
/// forked process.
///
/// Args:
///     body: What they touch.
///     paths: As many as there shall be contacts.
///     start: A contact on the body whose present state all of them begin with, in place of the keywords below: for planning from a
///         moment. It is not changed.
///     slip_rule, tank, partial_slip, friction_scale, ablation: As `Contact` has them.
///     threads: How many; one for each core if not given.
///
/// Returns:
///     A trace for each path, as `Contact.rollout` makes it. All are parts of one array: keep a copy of one to let go of the others.
///
/// Raises:
///     ArgumentError: `start` is on another body, or a value that is impossible.
#[pyfunction]
#[pyo3(signature = (body, paths, *, start=None, slip_rule=None, tank=None, partial_slip=None, friction_scale=1.0, ablation="none", threads=None))]
#[allow(clippy::too_many_arguments, reason = "in Python all but two are keywords")]
pub fn rollout_many<'py>(
    py: Python<'py>,
    body: &Body,
    paths: Vec<Bound<'py, Path>>,
    start: Option<&Contact>,
    slip_rule: Option<&str>,
    tank: Option<bool>,
    partial_slip: Option<bool>,
    friction_scale: f64,
    ablation: &str,
    threads: Option<usize>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let shared = &body.shared;
    let threads = self::threads(threads)?;
    let first = match start {
        None => {
            py.detach(|| contact::made(shared, slip_rule, tank, partial_slip, friction_scale, ablation))?
        }
        Some(start) => {
            let (state, on) = start.copied()?;
            if on.identity() != shared.identity() {
                return Err(argument("start is a contact on another body; give one on this body"));
            }
            state
        }
    };
    let ends: Vec<usize> = paths
        .iter()
        .scan(0, |end, path| {
            *end += path.get().len();
            Some(*end)
        })
        .collect();
    // One array for all of them: the system gives memory for one large one sooner than for many small ones, and the cores don't wait
    // for each other there.
    let all = trace(py, ends.last().copied().unwrap_or(0), None)?;
    let mut borrowed = room(&all)?;
    let mut rest = borrowed.rows()?;
    let mut rides = Vec::with_capacity(paths.len());
    for path in &paths {
        let (rows, others) = rest.split_at_mut(path.get().len());
        rides.push(Mutex::new(Ride { path: path.get(), rows }));
        rest = others;
    }
    interruptible(py, |_, cancelled| run(&first, shared, &rides, threads, cancelled), |_, ()| Ok(()))?;
    drop(rides);
    drop(borrowed);
    let part = |(k, &end): (usize, &usize)| {
        let begin = if k == 0 { 0 } else { ends[k - 1] };
        all.get_item(PySlice::new(py, begin as isize, end as isize, 1))
    };
    ends.iter().enumerate().map(part).collect()
}

/// A path, and where its trace goes.
struct Ride<'a> {
    path: &'a Path,
    rows: &'a mut [Row],
}

/// All of them, each by the thread that is free next.
fn run(
    first: &engine::Contact,
    body: &palpate::Body,
    rides: &[Mutex<Ride<'_>>],
    threads: usize,
    cancelled: &AtomicBool,
) {
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(ride) = rides.get(next.fetch_add(1, Ordering::Relaxed)) {
            let ride = &mut *ride.lock().unwrap_or_else(PoisonError::into_inner);
            let mut contact = first.clone();
            for (k, part) in ride.rows.chunks_mut(BETWEEN_SIGNALS).enumerate() {
                if cancelled.load(Ordering::Relaxed) {
                    return;
                }
                lead(&mut contact, body, ride.path, k * BETWEEN_SIGNALS, part);
            }
        }
    };
    thread::scope(|scope| {
        // Where the system gives no more threads, those that there are do all of it.
        let spawn = |_| thread::Builder::new().spawn_scoped(scope, work).map(drop);
        let _ = (1..threads.min(rides.len())).try_for_each(spawn);
        work();
    });
}
