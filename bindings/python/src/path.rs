//! A tool's path, checked once.

use crate::errors::{Raised, argument};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLike1, PyArrayLike2, PyUntypedArrayMethods};
use palpate::ToolState;
use palpate::runtime::path as table;
use pyo3::prelude::*;
use std::path::PathBuf;

/// A tool's path in the body's frame: poses and their times.
///
/// Give times, or one time step for all. It keeps copies of the arrays, so that contacts on several threads can follow it
/// while the interpreter does something else.
///
/// Args:
///     position_m: The tool's reference point at each pose: the tip; of a spherical tool its centre. (n, 3), m.
///     time_s: Times that never decrease. (n,), s.
///     dt_s: The time from each pose to the next, in place of `time_s`, s.
///     orientation: Unit quaternions w x y z, body from tool; without them no rotation. (n, 4).
///
/// Raises:
///     ArgumentError: An array has another shape, times decrease, or neither or both of `time_s` and `dt_s` are given.
#[pyclass(frozen, module = "palpate")]
#[derive(Debug)]
pub struct Path {
    pub positions: Vec<[f64; 3]>,
    pub times: Times,
    pub orientations: Option<Vec<[f64; 4]>>,
}

#[derive(Debug, Clone)]
pub enum Times {
    At(Vec<f64>),
    Every(f64),
}

impl Path {
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// How long after the pose before it pose `k` comes, s.
    #[inline]
    pub fn dt_s(&self, k: usize) -> f64 {
        match &self.times {
            _ if k == 0 => 0.0,
            Times::At(times) => times[k] - times[k - 1],
            Times::Every(dt) => *dt,
        }
    }

    #[inline]
    pub fn pose(&self, k: usize) -> ToolState {
        let mut tool = ToolState::at(self.positions[k]);
        if let Some(q) = self.orientations.as_ref().map(|all| all[k]) {
            tool.orientation = q;
        }
        tool
    }
}

/// Rows of an (n, N) array.
pub fn rows<const N: usize>(
    name: &str,
    array: &PyArrayLike2<'_, f64, AllowTypeChange>,
) -> PyResult<Vec<[f64; N]>> {
    let shape = array.shape();
    if shape[1] != N {
        return Err(argument(format!("{name} has the shape ({}, {}); give (n, {N})", shape[0], shape[1])));
    }
    // Fortran's order is contiguous, too.
    if let (true, Ok(slice)) = (array.is_c_contiguous(), array.as_slice()) {
        return Ok(slice.as_chunks::<N>().0.to_vec());
    }
    let view = array.as_array();
    Ok(view.rows().into_iter().map(|row| std::array::from_fn(|k| row[k])).collect())
}

#[pymethods]
impl Path {
    #[new]
    #[pyo3(signature = (*, position_m, time_s=None, dt_s=None, orientation=None))]
    fn new(
        position_m: PyArrayLike2<'_, f64, AllowTypeChange>,
        time_s: Option<PyArrayLike1<'_, f64, AllowTypeChange>>,
        dt_s: Option<f64>,
        orientation: Option<PyArrayLike2<'_, f64, AllowTypeChange>>,
    ) -> PyResult<Self> {
        let positions = rows("position_m", &position_m)?;
        let times = match (time_s, dt_s) {
            (Some(times), None) => {
                let times: Vec<f64> = times.as_array().to_vec();
                if times.len() != positions.len() {
                    return Err(argument(format!(
                        "time_s has {} times for {} positions; give one for each",
                        times.len(),
                        positions.len()
                    )));
                }
                if let Some(k) = times.iter().position(|t| !t.is_finite()) {
                    return Err(argument(format!("time_s[{k}] is {}; give a finite number", times[k])));
                }
                if let Some(k) = times.windows(2).position(|t| t[1] < t[0]) {
                    return Err(argument(format!(
                        "time_s[{}] comes before time_s[{k}]; sort the poses by time",
                        k + 1
                    )));
                }
                Times::At(times)
            }
            (None, Some(dt)) if (0.0..f64::INFINITY).contains(&dt) => Times::Every(dt),
            (None, Some(dt)) => return Err(argument(format!("dt_s is {dt}; give 0 or more"))),
            _ => return Err(argument("give one of time_s and dt_s")),
        };
        let orientations = orientation.map(|q| rows("orientation", &q)).transpose()?;
        if let Some(q) = orientations.as_ref().filter(|q| q.len() != positions.len()) {
            return Err(argument(format!(
                "orientation has {} quaternions for {} positions; give one for each",
                q.len(),
                positions.len()
            )));
        }
        Ok(Path { positions, times, orientations })
    }

    /// Reads a Path CSV: the columns `time_s,x_m,y_m,z_m`, and all or none of `qw,qx,qy,qz`, as `palpate trace` takes it.
    ///
    /// Args:
    ///     path: The file.
    ///     rate_hz: With it the path is interpolated to so many poses a second, Hz.
    ///
    /// Raises:
    ///     InputError: The file can't be read, or a row is wrong; the message names its line.
    #[staticmethod]
    #[pyo3(signature = (path, *, rate_hz=None))]
    fn open(path: PathBuf, rate_hz: Option<f64>) -> PyResult<Self> {
        let mut waypoints = table::read(&path).map_err(Raised::raised)?;
        if let Some(rate) = rate_hz {
            waypoints = table::resample(&waypoints, rate).map_err(Raised::raised)?;
        }
        Ok(Path {
            positions: waypoints.iter().map(|w| w.pose.position_m).collect(),
            times: Times::At(waypoints.iter().map(|w| w.time_s).collect()),
            orientations: Some(waypoints.iter().map(|w| w.pose.orientation).collect()),
        })
    }

    fn __len__(&self) -> usize {
        self.positions.len()
    }

    fn __repr__(&self) -> String {
        let n = self.positions.len();
        let times = match &self.times {
            Times::At(t) => match (t.first(), t.last()) {
                (Some(first), Some(last)) => format!("from {first} to {last} s"),
                _ => "empty".into(),
            },
            Times::Every(dt) => format!("every {dt} s"),
        };
        format!("<palpate.Path: {n} poses, {times}>")
    }

    /// The tool's reference point, (n, 3), m; a copy.
    #[getter]
    fn position_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        crate::arrays::matrix(py, &self.positions)
    }

    /// Times, (n,), s; from 0 on if the path has one time step. A copy.
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        match &self.times {
            Times::At(times) => PyArray1::from_slice(py, times),
            Times::Every(dt) => PyArray1::from_iter(py, (0..self.positions.len()).map(|k| k as f64 * dt)),
        }
    }

    /// Unit quaternions w x y z, (n, 4), or None; a copy.
    #[getter]
    fn orientation<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.orientations.as_deref().map(|q| crate::arrays::matrix(py, q)).transpose()
    }
}
