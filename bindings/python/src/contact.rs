//! Contacts: stepped, kept, led along paths.

use crate::body::{Body, named_rule, slip_rule};
use crate::errors::{BusyError, argument};
use crate::path::Path;
use crate::rollout::{self, Row};
use numpy::{AllowTypeChange, PyArray1, PyArrayLike1, PyArrayMethods};
use palpate::engine::{Counters, Flags};
use palpate::{Ablation, ToolState, engine};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};

/// One tool on a body: the contact point, and all else that evolves.
///
/// The first pose only says where the tool is: a tool that begins inside the body feels nothing until it has left it.
///
/// Args:
///     body: What it touches.
///     slip_rule: "consistent", "paper" or "exact"; the body's own if not given.
///     tank: Whether slip is kept from giving out more energy than it has dissipated before; as the body says if not given.
///     partial_slip: Whether there are two contact points side by side, or one; as the body says if not given.
///     friction_scale: What the body's friction coefficients are multiplied by.
///     ablation: Interpolations that are switched off, as in the paper's section 5: "none", "coordinates", "responses" or "both".
///
/// Raises:
///     ArgumentError: A name or number that there is not.
#[pyclass(frozen, module = "palpate")]
#[derive(Debug)]
pub struct Contact {
    body: Py<Body>,
    shared: Arc<palpate::Body>,
    state: Mutex<engine::Contact>,
}

/// A contact's state at a moment, from `Contact.snapshot`.
#[pyclass(frozen, module = "palpate")]
#[derive(Debug)]
pub struct Snapshot {
    identity: u64,
    state: engine::Contact,
}

impl Contact {
    /// The state, if no other thread has it.
    fn alone(&self) -> PyResult<MutexGuard<'_, engine::Contact>> {
        match self.state.try_lock() {
            Ok(state) => Ok(state),
            // The step does not panic; if it did the state is as good as after any step.
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => Err(BusyError::new_err(
                "another thread is using this contact; give each thread one of its own (copy)",
            )),
        }
    }

    /// A copy of the state, and the body.
    pub fn copied(&self) -> PyResult<(engine::Contact, Arc<palpate::Body>)> {
        Ok((self.alone()?.clone(), self.shared.clone()))
    }
}

/// A new contact as keywords say.
pub fn made(
    body: &palpate::Body,
    rule: Option<&str>,
    tank: Option<bool>,
    partial_slip: Option<bool>,
    friction_scale: f64,
    ablation: &str,
) -> PyResult<engine::Contact> {
    let ablation = match ablation {
        "none" => Ablation::None,
        "coordinates" => Ablation::Coordinates,
        "responses" => Ablation::Responses,
        "both" => Ablation::Both,
        other => {
            return Err(argument(format!(
                "ablation is {other:?}; give one of none, coordinates, responses, both"
            )));
        }
    };
    let mut contact = engine::Contact::with_slip(body, slip_rule(rule, body)?, ablation);
    if let Some(tank) = tank {
        contact = contact.with_tank(tank);
    }
    if let Some(partial_slip) = partial_slip {
        contact = contact.with_partial_slip(partial_slip);
    }
    contact.set_friction_scale(checked_scale(friction_scale)?);
    Ok(contact)
}

fn checked_scale(scale: f64) -> PyResult<f64> {
    if (0.0..f64::INFINITY).contains(&scale) {
        return Ok(scale);
    }
    Err(argument(format!("friction_scale is {scale}; give 0 or more")))
}

/// N numbers: of a tuple, an array, or what else is a sequence.
#[inline]
fn numbers<const N: usize>(what: &str, given: &Bound<'_, PyAny>) -> PyResult<[f64; N]> {
    if let Ok(tuple) = given.cast_exact::<PyTuple>() {
        if tuple.len() == N {
            let mut numbers = [0.0; N];
            for (to, item) in numbers.iter_mut().zip(tuple.iter_borrowed()) {
                *to = item.extract()?;
            }
            return Ok(numbers);
        }
    } else if let Ok(array) = given.cast::<PyArray1<f64>>() {
        let numbers = std::array::from_fn(|k| array.get_owned([k]));
        if numbers.iter().all(Option::is_some) && array.get_owned([N]).is_none() {
            return Ok(numbers.map(Option::unwrap_or_default));
        }
    } else if let Ok(numbers) = given.extract() {
        return Ok(numbers);
    } else if let Ok(array) = given.extract::<PyArrayLike1<'_, f64, AllowTypeChange>>()
        && let Some(numbers) = array.as_slice().ok().and_then(|slice| slice.try_into().ok())
    {
        return Ok(numbers);
    }
    Err(argument(format!("{what} is {}; give {N} numbers", given.repr()?)))
}

#[pymethods]
impl Contact {
    #[new]
    #[pyo3(signature = (body, *, slip_rule=None, tank=None, partial_slip=None, friction_scale=1.0, ablation="none"))]
    fn new(
        py: Python<'_>,
        body: Py<Body>,
        slip_rule: Option<&str>,
        tank: Option<bool>,
        partial_slip: Option<bool>,
        friction_scale: f64,
        ablation: &str,
    ) -> PyResult<Self> {
        let shared = body.get().shared.clone();
        let state = py.detach(|| made(&shared, slip_rule, tank, partial_slip, friction_scale, ablation))?;
        Ok(Contact { body, shared, state: Mutex::new(state) })
    }

    /// One sample: where the tool is, and how long after the last one; out comes the force on it.
    ///
    /// It never fails on numbers: a pose that can't be used gives no force and a flag.
    ///
    /// Args:
    ///     position_m: The tool's reference point in the body's frame: the tip; of a spherical tool its centre. (3,), m.
    ///     dt_s: Time since the last sample, s. Nothing depends on it yet.
    ///     orientation: Unit quaternion w x y z, body from tool. (4,). Responses do not depend on it yet.
    ///
    /// Raises:
    ///     ArgumentError: Something else than so many numbers.
    ///     BusyError: Another thread is using this contact.
    #[pyo3(signature = (*, position_m, dt_s, orientation=None))]
    fn step(
        &self,
        position_m: &Bound<'_, PyAny>,
        dt_s: f64,
        orientation: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Output> {
        let mut tool = ToolState::at(numbers("position_m", position_m)?);
        if let Some(q) = orientation {
            tool.orientation = numbers("orientation", q)?;
        }
        Ok(Output(self.alone()?.step(&self.shared, &tool, dt_s)))
    }

    /// Leads the contact along a path from the state that it is in: the same bits as step after step.
    ///
    /// The interpreter is free meanwhile. Ctrl-C ends it and leaves the contact as it was.
    ///
    /// Args:
    ///     path: Poses and times. The first pose has a time step of 0.
    ///     out: A trace of the same length from an earlier rollout, which is written over and returned.
    ///
    /// Returns:
    ///     A record array with one row for each pose (n,), fields as `TRACE_DTYPE` has them.
    ///
    /// Raises:
    ///     BusyError: Another thread is using this contact.
    ///     ArgumentError: `out` does not fit.
    #[pyo3(signature = (path, *, out=None))]
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        path: &Bound<'py, Path>,
        out: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let path = path.get();
        let mut state = self.alone()?;
        let before = state.clone();
        let trace = rollout::trace(py, path.len(), out)?;
        let mut borrowed = rollout::room(&trace)?;
        let rows: &mut [Row] = borrowed.rows()?;
        let mut done = 0;
        for part in rows.chunks_mut(rollout::BETWEEN_SIGNALS) {
            let contact = &mut *state;
            py.detach(|| rollout::lead(contact, &self.shared, path, done, part));
            done += part.len();
            if let Err(e) = py.check_signals() {
                *state = before;
                return Err(e);
            }
        }
        drop(borrowed);
        Ok(trace)
    }

    /// What it is now, to go back to.
    fn snapshot(&self) -> PyResult<Snapshot> {
        Ok(Snapshot { identity: self.shared.identity(), state: self.alone()?.clone() })
    }

    /// Goes back to a snapshot, of this contact or another one on the same body.
    ///
    /// Raises:
    ///     ArgumentError: The snapshot is of a contact on another body.
    fn restore(&self, snapshot: &Snapshot) -> PyResult<()> {
        if snapshot.identity != self.shared.identity() {
            return Err(argument("the snapshot is of a contact on another body; take one of this body's"));
        }
        *self.alone()? = snapshot.state.clone();
        Ok(())
    }

    /// A contact of its own in the same state.
    fn copy(&self, py: Python<'_>) -> PyResult<Self> {
        let (state, shared) = self.copied()?;
        Ok(Contact { body: self.body.clone_ref(py), shared, state: Mutex::new(state) })
    }

    fn __copy__(&self, py: Python<'_>) -> PyResult<Self> {
        self.copy(py)
    }

    /// Forgets where the tool was: the next pose counts as the first one.
    fn forget(&self) -> PyResult<()> {
        self.alone()?.forget();
        Ok(())
    }

    /// The Lipschitz bound of the force at the present contact, N/m: by how much it changes at most for each metre that the tool moves. None in
    /// free space, or where the slip equation has no stable root, so that no bound exists.
    fn lipschitz_n_per_m(&self) -> PyResult<Option<f64>> {
        Ok(self.alone()?.lipschitz_n_per_m(&self.shared))
    }

    /// What it touches.
    #[getter]
    fn body(&self, py: Python<'_>) -> Py<Body> {
        self.body.clone_ref(py)
    }

    /// The slip rule in force: "consistent", "paper" or "exact". Can be set.
    #[getter]
    fn slip_rule(&self) -> PyResult<&'static str> {
        Ok(self.alone()?.slip_rule().name())
    }

    #[setter]
    fn set_slip_rule(&self, py: Python<'_>, name: &str) -> PyResult<()> {
        let rule = named_rule(name)?;
        let mut state = self.alone()?;
        py.detach(|| self.shared.prepare(rule));
        state.set_slip_rule(rule);
        Ok(())
    }

    /// What the body's friction coefficients are multiplied by. Can be set, from the next step on.
    #[getter]
    fn friction_scale(&self) -> PyResult<f64> {
        Ok(self.alone()?.friction_scale())
    }

    #[setter]
    fn set_friction_scale(&self, scale: f64) -> PyResult<()> {
        self.alone()?.set_friction_scale(checked_scale(scale)?);
        Ok(())
    }

    /// Whether the tool touches the body.
    #[getter]
    fn is_touching(&self) -> PyResult<bool> {
        Ok(self.alone()?.touching().is_some())
    }

    /// How often things happened since the contact was made, by name: steps, onsets, slips and the like.
    #[getter]
    fn counters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Counters {
            steps,
            onsets,
            slips,
            evaluations,
            crossings,
            queries,
            blocked,
            fenced,
            capped,
            held_back,
            invalid_poses,
            invalid_times,
            other_bodies,
            contained,
            without_gradients,
        } = *self.alone()?.counters();
        let counters = PyDict::new(py);
        for (name, count) in [
            ("steps", steps),
            ("onsets", onsets),
            ("slips", slips),
            ("evaluations", evaluations),
            ("crossings", crossings),
            ("queries", queries),
            ("blocked", blocked),
            ("fenced", fenced),
            ("capped", capped),
            ("held_back", held_back),
            ("invalid_poses", invalid_poses),
            ("invalid_times", invalid_times),
            ("other_bodies", other_bodies),
            ("contained", contained),
            ("without_gradients", without_gradients),
        ] {
            counters.set_item(name, count)?;
        }
        Ok(counters)
    }

    fn __repr__(&self) -> String {
        match self.alone() {
            Ok(state) => format!(
                "<palpate.Contact: {} steps, {}, slip rule {}>",
                state.counters().steps,
                if state.touching().is_some() { "touching" } else { "free" },
                state.slip_rule().name()
            ),
            Err(_) => "<palpate.Contact: in use by another thread>".into(),
        }
    }
}

/// What a step answers.
#[pyclass(frozen, module = "palpate")]
#[derive(Debug)]
pub struct Output(engine::Output);

#[pymethods]
impl Output {
    /// Force on the tool, (3,), N.
    #[getter]
    fn force_n(&self) -> (f64, f64, f64) {
        self.0.force_n.into()
    }

    /// Torque on the tool about its reference point, (3,), N m; zero for the tools that there are so far.
    #[getter]
    fn torque_nm(&self) -> (f64, f64, f64) {
        self.0.torque_nm.into()
    }

    /// Whether the tool touches the body after this step.
    #[getter]
    fn in_contact(&self) -> bool {
        self.0.flags.has(Flags::IN_CONTACT)
    }

    /// The triangle that is touched, or None.
    #[getter]
    fn element(&self) -> Option<u32> {
        self.0.contact.map(|c| c.element)
    }

    /// Area coordinates of the contact point in its triangle, (3,), or None.
    #[getter]
    fn area_coordinates(&self) -> Option<(f64, f64, f64)> {
        self.0.contact.map(|c| c.n.into())
    }

    /// The contact point at rest, (3,), m, or None.
    #[getter]
    fn contact_position_m(&self) -> Option<(f64, f64, f64)> {
        self.0.contact.map(|c| c.position_m.into())
    }

    /// Normal deflection, m; 0 without contact.
    #[getter]
    fn delta_z_m(&self) -> f64 {
        self.0.contact.map_or(0.0, |c| c.delta_z_m)
    }

    /// Lateral deflection, m; 0 without contact.
    #[getter]
    fn delta_r_m(&self) -> f64 {
        self.0.contact.map_or(0.0, |c| c.delta_r_m)
    }

    /// What happened, as a sum of `FLAGS`.
    #[getter]
    fn flags(&self) -> u32 {
        self.0.flags.bits()
    }

    /// The names of what happened.
    #[getter]
    fn flag_names(&self) -> Vec<&'static str> {
        self.0.flags.names().collect()
    }

    /// Work of the tool on the body so far, J: stored + dissipated + relaxed.
    #[getter]
    fn work_j(&self) -> f64 {
        self.0.energy.work_j
    }

    /// Energy stored in the body now, J.
    #[getter]
    fn stored_j(&self) -> f64 {
        self.0.energy.stored_j
    }

    /// Energy that slip and release took out so far, J, signed.
    #[getter]
    fn dissipated_j(&self) -> f64 {
        self.0.energy.dissipated_j
    }

    /// The part of it that slip generated, J, as a positive sum.
    #[getter]
    fn generated_j(&self) -> f64 {
        self.0.energy.generated_j
    }

    /// What slips have dissipated and later ones may give out again, J.
    #[getter]
    fn tank_j(&self) -> f64 {
        self.0.energy.tank_j
    }

    /// What relaxed at a fixed tool, J; 0 as long as no response has internal variables.
    #[getter]
    fn relaxed_j(&self) -> f64 {
        self.0.energy.relaxed_j
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.0.force_n;
        let names: Vec<_> = self.0.flags.names().collect();
        format!("<palpate.Output: force ({x:.4}, {y:.4}, {z:.4}) N, {}>", names.join(" "))
    }
}

/// The names of what a sum of `FLAGS` says.
#[pyfunction]
#[pyo3(signature = (flags, /))]
pub fn flag_names(flags: u32) -> Vec<&'static str> {
    Flags::from_bits(flags).names().collect()
}
