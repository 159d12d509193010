//! Bodies that are made: of samples, or from a spec.

use crate::errors::{Raised, argument};
use glam::DVec3;
use numpy::{AllowTypeChange, PyArray2, PyArrayLike1, PyArrayLike2, PyUntypedArrayMethods};
use palpate::Body;
use palpate::body::import::{self, LengthUnit};
use palpate::body::repair::{self, Options};
use palpate::body::{Interpolation, Provenance, SlipRule, Surface, Tool, TriangleMesh};
use palpate::identify::{BodyOptions, Component, FitOptions, Sample, fit, read_samples};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// A surface mesh of arrays.
pub fn mesh(
    position_m: &PyArrayLike2<'_, f64, AllowTypeChange>,
    triangles: &PyArrayLike2<'_, i64, AllowTypeChange>,
) -> PyResult<TriangleMesh> {
    let positions = crate::path::rows::<3>("position_m", position_m)?;
    let shape = triangles.shape();
    if shape[1] != 3 {
        return Err(argument(format!("triangles has the shape ({}, {}); give (t, 3)", shape[0], shape[1])));
    }
    let corner = |t: usize, vertex: i64| {
        u32::try_from(vertex).ok().filter(|&v| (v as usize) < positions.len()).ok_or_else(|| {
            argument(format!(
                "triangles[{t}] names vertex {vertex}, and there are {}; number them from 0",
                positions.len()
            ))
        })
    };
    let view = triangles.as_array();
    let rows = view.rows().into_iter().enumerate();
    let triangles = rows
        .map(|(t, row)| Ok([corner(t, row[0])?, corner(t, row[1])?, corner(t, row[2])?]))
        .collect::<PyResult<Vec<_>>>()?;
    Ok(TriangleMesh { positions: positions.into_iter().map(DVec3::from_array).collect(), triangles })
}

/// Reads a surface mesh (OBJ, STL, PLY, OFF, VTK, VTU, VTP).
///
/// Args:
///     path: The file.
///     unit: The unit of its coordinates, "m", "cm" or "mm", which a mesh file doesn't say. May be None where it does.
///
/// Returns:
///     Vertices, (n, 3), m, and the vertices of each triangle, (t, 3), uint32.
///
/// Raises:
///     InputError: The file can't be read, or has no unit.
#[pyfunction]
#[pyo3(signature = (path, *, unit))]
#[allow(clippy::type_complexity, reason = "two arrays")]
pub fn read_mesh<'py>(
    py: Python<'py>,
    path: PathBuf,
    unit: Option<&str>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>)> {
    use numpy::{PyArray1, PyArrayMethods};
    let unit = unit.map(length_unit).transpose()?;
    let mesh = py.detach(|| import::read(&path, unit)).map_err(Raised::raised)?;
    let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
    let triangles = PyArray1::from_slice(py, mesh.triangles.as_flattened());
    Ok((crate::arrays::matrix(py, &positions)?, triangles.reshape([mesh.triangles.len(), 3])?))
}

fn length_unit(name: &str) -> PyResult<LengthUnit> {
    name.parse().map_err(|_| argument(format!("unit is {name:?}; give \"m\", \"cm\" or \"mm\"")))
}

pub fn interpolation(name: &str) -> PyResult<Interpolation> {
    match name {
        "pchip" => Ok(Interpolation::Pchip),
        "linear" => Ok(Interpolation::Linear),
        _ => Err(argument(format!("interpolation is {name:?}; give \"pchip\" or \"linear\""))),
    }
}

/// A column by its name, if there is one.
fn column<'py>(table: &Bound<'py, PyAny>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
    match table.get_item(name) {
        Ok(column) => Ok(Some(column)),
        // A structured array says ValueError.
        Err(e)
            if e.is_instance_of::<PyKeyError>(table.py())
                || e.is_instance_of::<pyo3::exceptions::PyValueError>(table.py()) =>
        {
            Ok(None)
        }
        Err(e) => Err(e),
    }
}

fn needed<'py>(table: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    column(table, name)?.ok_or_else(|| argument(format!("samples have no column {name:?}; add it")))
}

fn numbers(column: &Bound<'_, PyAny>, name: &str, count: usize) -> PyResult<Vec<f64>> {
    let array: PyArrayLike1<'_, f64, AllowTypeChange> = column
        .extract()
        .map_err(|e| argument(format!("samples' column {name:?} is no array of numbers (n,): {e}")))?;
    let all = array.as_array().to_vec();
    if all.len() != count {
        return Err(argument(format!(
            "samples' column {name:?} has {} rows, and `point` {count}; give one for each",
            all.len()
        )));
    }
    Ok(all)
}

/// Samples from a CSV, or from columns.
pub fn samples(table: &Bound<'_, PyAny>) -> PyResult<Vec<Sample>> {
    if let Ok(path) = table.extract::<PathBuf>() {
        return read_samples(&path).map_err(Raised::raised);
    }
    let words = |name: &str| -> PyResult<Vec<String>> {
        needed(table, name)?.try_iter()?.map(|word| Ok(word?.str()?.to_string())).collect()
    };
    let points = words("point")?;
    let n = points.len();
    let components = words("component")?;
    if components.len() != n {
        return Err(argument(format!(
            "samples' column \"component\" has {} rows, and `point` {n}; give one for each",
            components.len()
        )));
    }
    let filled = |name: &str| numbers(&needed(table, name)?, name, n);
    let [x, y, z] = [filled("x_m")?, filled("y_m")?, filled("z_m")?];
    let (deflections, values) = (filled("deflection_m")?, filled("value")?);
    let maybe = |name: &str| column(table, name)?.map(|c| numbers(&c, name, n)).transpose();
    let weights = maybe("weight")?;
    let directions = match [maybe("direction_x")?, maybe("direction_y")?, maybe("direction_z")?] {
        [Some(x), Some(y), Some(z)] => Some([x, y, z]),
        [None, None, None] => None,
        _ => {
            return Err(argument(
                "samples have some of direction_x, direction_y, direction_z; give all or none",
            ));
        }
    };
    let row = |(k, point): (usize, String)| {
        let component = match components[k].as_str() {
            "normal" => Component::Normal,
            "lateral" => Component::Lateral,
            "friction" => Component::Friction,
            other => {
                return Err(argument(format!(
                    "samples' component {k} is {other:?}; give \"normal\", \"lateral\" or \"friction\""
                )));
            }
        };
        let direction = directions.as_ref().map(|d| [d[0][k], d[1][k], d[2][k]]);
        Ok(Sample {
            point,
            position_m: [x[k], y[k], z[k]],
            component,
            deflection_m: deflections[k],
            value: values[k],
            // A cell may be empty.
            direction: direction.filter(|d| d.iter().all(|x| !x.is_nan())),
            weight: weights.as_ref().map(|w| w[k]).filter(|w| !w.is_nan()),
            line: k as u64 + 1,
        })
    };
    points.into_iter().enumerate().map(row).collect()
}

/// What `Body.from_samples` was given.
pub struct Samples {
    pub mesh: TriangleMesh,
    pub samples: Vec<Sample>,
    pub friction: Option<f64>,
    pub tool_radius_m: f64,
    pub interpolation: Interpolation,
    pub slip: SlipRule,
    pub tank: bool,
    pub crease_angle_rad: Option<f64>,
    pub is_open: bool,
}

impl Samples {
    pub fn body(self) -> PyResult<Body> {
        let (mesh, report) =
            repair::repair(self.mesh, Options { allow_open: self.is_open }).map_err(Raised::raised)?;
        let crease = self.crease_angle_rad.unwrap_or(f64::INFINITY);
        let surface = Surface::build(&mesh, crease).map_err(Raised::raised)?;
        let options = FitOptions { interpolation: self.interpolation, default_friction: self.friction };
        let fitted = fit(&surface, &self.samples, &options).map_err(Raised::raised)?;
        let tool = match self.tool_radius_m {
            0.0 => Tool::Point,
            radius_m => Tool::Sphere { radius_m },
        };
        let software = concat!("palpate ", env!("CARGO_PKG_VERSION")).into();
        let provenance = Provenance { software, notes: report.notes, ..Provenance::default() };
        let options = BodyOptions { tool, slip: self.slip, tank: self.tank, partial_slip: false, provenance };
        fitted.into_body(surface, options).map_err(Raised::raised)
    }
}
