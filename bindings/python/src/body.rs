//! Bodies: opened, kept, inspected.

use crate::arrays::look;
use crate::errors::{Raised, argument};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLike1, PyArrayLike2};
use palpate::body::stiffness::{stiffness_aside, stiffness_max};
use palpate::body::{Element, Node, SlipRule};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use std::sync::Arc;

/// A soft body at rest: surface, responses, tool. It never changes, and any number of contacts share it.
///
/// Make one with `open`, `from_bytes`, `from_samples` or `from_spec`. Lengths are in metres, in the body's own frame. It can be pickled.
#[pyclass(frozen, module = "palpate")]
#[derive(Debug)]
pub struct Body {
    pub shared: Arc<palpate::Body>,
    /// Its file; none for one that was made in memory.
    pub file: Option<PathBuf>,
}

impl Body {
    pub fn new(body: palpate::Body) -> Self {
        Body { shared: Arc::new(body), file: None }
    }

    fn box_m(&self) -> [[f64; 3]; 2] {
        let nowhere = (glam::DVec3::INFINITY, glam::DVec3::NEG_INFINITY);
        let (low, high) = self
            .shared
            .nodes()
            .iter()
            .fold(nowhere, |(low, high), n| (low.min(n.position), high.max(n.position)));
        [low.to_array(), high.to_array()]
    }
}

/// A slip rule by its name; None stands for the body's own.
pub fn slip_rule(name: Option<&str>, body: &palpate::Body) -> PyResult<SlipRule> {
    let Some(name) = name else { return Ok(body.slip()) };
    named_rule(name)
}

pub fn named_rule(name: &str) -> PyResult<SlipRule> {
    let named = SlipRule::ALL.into_iter().find(|rule| rule.name() == name);
    let names = || SlipRule::ALL.map(SlipRule::name).join(", ");
    named.ok_or_else(|| argument(format!("slip_rule is {name:?}; give one of {}", names())))
}

#[pymethods]
impl Body {
    /// Opens a body file, reads and checks all of it.
    ///
    /// Raises:
    ///     InputError: It can't be read, is damaged, or of a newer version.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let body = py.detach(|| palpate::Body::open(&path)).map_err(Raised::raised)?;
        Ok(Body { shared: Arc::new(body), file: Some(path) })
    }

    /// The same from the bytes of a body file.
    ///
    /// Raises:
    ///     InputError: They are no sound body.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: &Bound<'_, PyBytes>) -> PyResult<Self> {
        let bytes = data.as_bytes();
        Ok(Body::new(py.detach(|| palpate::Body::from_bytes(bytes)).map_err(Raised::raised)?))
    }

    /// Makes a body of a surface and measured values.
    ///
    /// Each point that samples name gets a curve of each kind, on the surface's node nearest to it; every other node blends
    /// the points around it. The mesh is repaired as `palpate fit` does.
    ///
    /// Args:
    ///     position_m: Vertices in the body's frame. (n, 3), m.
    ///     triangles: Vertices of each triangle, counter-clockwise seen from outside. (t, 3), whole numbers.
    ///     samples: A Samples CSV's path; or its columns, had by name: a dict of arrays, a data frame, a structured array. `point`
    ///         (any name), `x_m`, `y_m`, `z_m` (m), `component` ("normal", "lateral", "friction"), `deflection_m` (m), `value` (N;
    ///         friction has no unit), and, if there are any, `weight` and `direction_x`, `direction_y`, `direction_z`.
    ///     friction: The coefficient of points without samples of it.
    ///     tool_radius_m: Radius of the sphere that the samples were taken with, m; 0 for a tip.
    ///     interpolation: How curves pass between samples: "pchip" (monotone cubics) or "linear".
    ///     slip_rule: "consistent", "paper" or "exact".
    ///     tank: Whether slip is kept from giving out more energy than it has dissipated before.
    ///     crease_angle_rad: Edges that turn by more than this stay sharp, rad; None for no creases.
    ///     is_open: Whether the surface may have borders.
    ///
    /// Raises:
    ///     InputError: Mesh or samples are wrong; in the message "line" counts samples from 1, or lines of the CSV.
    ///     ArgumentError: An array has another shape, or a column is missing.
    #[staticmethod]
    #[pyo3(signature = (*, position_m, triangles, samples, friction=None, tool_radius_m=0.0, interpolation="pchip",
                        slip_rule="consistent", tank=true, crease_angle_rad=None, is_open=false))]
    #[allow(clippy::too_many_arguments, reason = "in Python all are keywords")]
    fn from_samples(
        py: Python<'_>,
        position_m: PyArrayLike2<'_, f64, AllowTypeChange>,
        triangles: PyArrayLike2<'_, i64, AllowTypeChange>,
        samples: &Bound<'_, PyAny>,
        friction: Option<f64>,
        tool_radius_m: f64,
        interpolation: &str,
        slip_rule: &str,
        tank: bool,
        crease_angle_rad: Option<f64>,
        is_open: bool,
    ) -> PyResult<Self> {
        let making = crate::make::Samples {
            mesh: crate::make::mesh(&position_m, &triangles)?,
            samples: crate::make::samples(samples)?,
            friction,
            tool_radius_m,
            interpolation: crate::make::interpolation(interpolation)?,
            slip: named_rule(slip_rule)?,
            tank,
            crease_angle_rad,
            is_open,
        };
        Ok(Body::new(py.detach(|| making.body())?))
    }

    /// Makes a body from a spec (docs/spec.md): of its law at once, or by simulating its test points by finite elements, from
    /// seconds to hours.
    ///
    /// Ctrl-C ends it; with `work_folder`, a further call goes on from there.
    ///
    /// Args:
    ///     path: The spec, TOML.
    ///     progress: Called, in the calling thread, with a `Progress` whenever there is something new. If it returns False the work ends.
    ///     work_folder: Where finished points are kept; a call with the same folder and spec goes on with them. Without it a
    ///         temporary folder that is removed.
    ///     threads: How many points are simulated at a time; one for each core if not given.
    ///
    /// Raises:
    ///     InputError: The spec, or a file that it names, is wrong; the message names its line.
    ///     CancelledError: `progress` returned False.
    #[staticmethod]
    #[pyo3(signature = (path, *, progress=None, work_folder=None, threads=None))]
    fn from_spec(
        py: Python<'_>,
        path: PathBuf,
        progress: Option<Py<PyAny>>,
        work_folder: Option<PathBuf>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let jobs = crate::rollout::threads(threads)?;
        #[cfg(feature = "build")]
        {
            crate::from_spec::from_spec(py, &path, progress, work_folder, jobs).map(Body::new)
        }
        #[cfg(not(feature = "build"))]
        {
            let _ = (py, path, progress, work_folder, jobs);
            Err(crate::errors::Error::new_err(
                "palpate was built without the feature `build`; build it with it",
            ))
        }
    }

    /// Proves that the body is passive and free of snaps, or shows where it is not (docs/passivity.md), as `palpate certify` does.
    ///
    /// For every element, all depths and all directions of slip. It takes seconds to hours, on all cores; the interpreter is free
    /// meanwhile, and Ctrl-C ends it.
    ///
    /// Args:
    ///     slip_rule: "consistent", "paper" or "exact"; the body's own if not given.
    ///     step_m: Longest way of the tool from one step to the next, m.
    ///     depth_m: Deepest that the tool goes, m; the end of the responses if not given.
    ///     evaluations: Bounds computed for each element and certificate, at most; 3000 for the rule "paper", 600 for the others, 200
    ///         for coupled laws if not given.
    ///     window: Whether to search how both fare with less and more friction.
    ///     device: A device that the sampled loop is judged for, by name ("touch", "omega", "falcon" and so on).
    ///     rate_hz: Rate of its loop, Hz; 1000 if not given.
    ///     damping_n_s_per_m: Its viscous damping, N s/m, in place of what is known of it, or without a name.
    ///     position_error_m: Greatest error of its position, m; half a step of its encoders along each axis, or none.
    ///     coulomb_n: Its Coulomb friction, N.
    ///     delay_samples: Samples by which its force comes late.
    ///     progress: Called, in the calling thread, with a `Progress` for each element. If it returns False the work ends.
    ///     threads: How many; one for each core if not given.
    ///
    /// Returns:
    ///     A dict, the JSON of `palpate certify --json`: `passive` and `snap_free` (`holds`, `margin`, `found`, counts of elements, `worst`,
    ///     `witness`), `lipschitz_n_per_m`, `stiffness_max_n_per_m`, `device` (`depth_limit_m`, `force_limit_n` and so on), `scope`,
    ///     `remarks`. None stands for what is not proved.
    ///
    /// Raises:
    ///     ArgumentError: A name or number that can't be.
    ///     CancelledError: `progress` returned False.
    #[pyo3(signature = (*, slip_rule=None, step_m=1e-3, depth_m=None, evaluations=None, window=false, device=None, rate_hz=None,
                        damping_n_s_per_m=None, position_error_m=None, coulomb_n=None, delay_samples=None, progress=None, threads=None))]
    #[allow(clippy::too_many_arguments, reason = "in Python all are keywords")]
    fn certify<'py>(
        &self,
        py: Python<'py>,
        slip_rule: Option<&str>,
        step_m: f64,
        depth_m: Option<f64>,
        evaluations: Option<u32>,
        window: bool,
        device: Option<&str>,
        rate_hz: Option<f64>,
        damping_n_s_per_m: Option<f64>,
        position_error_m: Option<f64>,
        coulomb_n: Option<f64>,
        delay_samples: Option<f64>,
        progress: Option<Py<PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let device = crate::certify::Loop {
            device,
            rate_hz,
            damping_n_s_per_m,
            position_error_m,
            coulomb_n,
            delay_samples,
        };
        let threads = crate::rollout::threads(threads)?;
        let asked =
            crate::certify::Asked { slip_rule, step_m, depth_m, evaluations, window, device, threads };
        crate::certify::certify(py, &self.shared, &asked, progress)
    }

    /// Says how wrong the body's forces are, on random paths that no test point has seen, as `palpate validate` does (docs/validate.md).
    ///
    /// Each path is simulated in full, with the spec's mesh, material and tool and the body's friction, and compared with what the
    /// body answers. It takes minutes to hours, on all cores; the interpreter is free meanwhile, and Ctrl-C ends it.
    ///
    /// Args:
    ///     spec: The spec that the body was made from, TOML.
    ///     paths: How many paths.
    ///     seed: Which: the same seed gives the same.
    ///     history: What is simulated: "coulomb" (pressed, dragged past slip, back, round, let go, touched again), "frictionless", "stick" or
    ///         "frictionless-press".
    ///     at_test_points: Whether paths begin at test points: the error without interpolation.
    ///     own: Whether the potential of each path's own point is found, too, which costs as much again.
    ///     steps: States of a press to the greatest depth; the spec's if not given.
    ///     progress: Called, in the calling thread, with a `Progress` for each path. If it returns False the work ends.
    ///     threads: How many paths are simulated at a time; one for each core if not given.
    ///
    /// Returns:
    ///     A dict, the JSON of `palpate validate --json`: `summary`, `phases`, `sources` (errors in % of the path's largest force and of the
    ///     force at hand), and `paths`, one for each.
    ///
    /// Raises:
    ///     InputError: The spec, or a file that it names, is wrong, or the body is of another mesh.
    ///     ArgumentError: A name or number that can't be.
    ///     CancelledError: `progress` returned False.
    #[pyo3(signature = (spec, *, paths=40, seed=1, history="coulomb", at_test_points=false, own=false, steps=None, progress=None,
                        threads=None))]
    #[allow(clippy::too_many_arguments, reason = "in Python all but one are keywords")]
    fn validate<'py>(
        &self,
        py: Python<'py>,
        spec: PathBuf,
        paths: usize,
        seed: u64,
        history: &str,
        at_test_points: bool,
        own: bool,
        steps: Option<u32>,
        progress: Option<Py<PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let jobs = crate::rollout::threads(threads)?;
        #[cfg(feature = "build")]
        {
            if paths == 0 || paths > 100_000 {
                return Err(argument(format!("paths is {paths}; give 1 to 100000")));
            }
            if let Some(steps) = steps.filter(|n| !(1..=1000).contains(n)) {
                return Err(argument(format!("steps is {steps}; give 1 to 1000")));
            }
            let history = crate::from_spec::history(history)?;
            let against = palpate::build::validate::Against {
                history,
                paths,
                seed,
                at_test_points,
                own,
                steps,
                jobs,
                places_of: None,
                kept: None,
            };
            crate::from_spec::validate(py, &self.shared, &spec, &against, progress)
        }
        #[cfg(not(feature = "build"))]
        {
            let _ = (py, spec, paths, seed, history, at_test_points, own, steps, progress, jobs);
            Err(crate::errors::Error::new_err(
                "palpate was built without the feature `build`; build it with it",
            ))
        }
    }

    /// Writes the body to a file, which is replaced only when the new one is whole.
    ///
    /// Raises:
    ///     InputError: The file can't be written.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.shared.save(&path)).map_err(Raised::raised)
    }

    /// The bytes of its body file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| self.shared.to_bytes()).map_err(Raised::raised)?;
        Ok(PyBytes::new(py, &bytes))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((py.get_type::<Body>().getattr("from_bytes")?, (self.to_bytes(py)?,)))
    }

    /// Places of the nodes: vertices, and those that creases doubled. (n, 3), m; a view that can't be written to.
    #[getter]
    fn position_m<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let nodes: &[f64] = bytemuck::cast_slice(this.get().shared.nodes());
        const STRIDE: usize = size_of::<Node>() / size_of::<f64>();
        // SAFETY: the object holds the body, which never changes.
        #[allow(unsafe_code, reason = "a view of the nodes without a copy")]
        unsafe {
            look(nodes, 0, STRIDE, this.clone().into_any())
        }
    }

    /// Unit normals of the nodes, into the body. (n, 3); a view that can't be written to.
    #[getter]
    fn inward<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        const STRIDE: usize = size_of::<Node>() / size_of::<f64>();
        const AFTER: usize = std::mem::offset_of!(Node, inward) / size_of::<f64>();
        let nodes: &[f64] = bytemuck::cast_slice(this.get().shared.nodes());
        // SAFETY: the object holds the body, which never changes.
        #[allow(unsafe_code, reason = "a view of the nodes without a copy")]
        unsafe {
            look(nodes, AFTER, STRIDE, this.clone().into_any())
        }
    }

    /// Nodes of the surface's triangles, counter-clockwise seen from outside. (t, 3), uint32; a view that can't be written to.
    #[getter]
    fn triangles<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let elements: &[u32] = bytemuck::cast_slice(this.get().shared.elements());
        const STRIDE: usize = size_of::<Element>() / size_of::<u32>();
        // SAFETY: the object holds the body, which never changes.
        #[allow(unsafe_code, reason = "a view of the elements without a copy")]
        unsafe {
            look(elements, 0, STRIDE, this.clone().into_any())
        }
    }

    /// Nodes that have responses of their own. (p,), uint32.
    #[getter]
    fn test_point_nodes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.shared.test_point_nodes())
    }

    /// How many vertices the surface has: nodes less those that creases doubled.
    #[getter]
    fn vertex_count(&self) -> usize {
        self.shared.vertex_count()
    }

    /// Its box at rest: lowest and highest corner. (2, 3), m.
    #[getter]
    fn bounds_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        crate::arrays::matrix(py, &self.box_m())
    }

    /// The tool that its responses hold for: "point", "sphere", "flat-punch", "cone", "capsule" or "mesh".
    #[getter]
    fn tool(&self) -> &'static str {
        self.shared.tool().name()
    }

    /// Radius of a spherical tool, m; 0 for one whose tip counts.
    #[getter]
    fn tool_radius_m(&self) -> f64 {
        self.shared.tool().radius_m()
    }

    /// The slip rule that it asks for: "consistent", "paper" or "exact".
    #[getter]
    fn slip_rule(&self) -> &'static str {
        self.shared.slip().name()
    }

    /// Whether contacts have the tank that keeps slip from giving out energy.
    #[getter]
    fn has_tank(&self) -> bool {
        self.shared.has_tank()
    }

    /// Whether contacts are two contact points side by side, one with more, one with less friction.
    #[getter]
    fn has_partial_slip(&self) -> bool {
        self.shared.has_partial_slip()
    }

    /// Whether its law is a coupled potential; if not, it is curves.
    #[getter]
    fn is_coupled(&self) -> bool {
        self.shared.is_coupled()
    }

    /// Whether its lateral response is alike in all directions.
    #[getter]
    fn is_isotropic(&self) -> bool {
        self.shared.is_isotropic()
    }

    /// How deep its responses were found, m; they go on straight beyond.
    #[getter]
    fn depth_max_m(&self) -> f64 {
        self.shared.responses().depth_knots().values().last().copied().unwrap_or_default()
    }

    /// The greatest stiffness that it answers with, N/m: what a device must be able to hold.
    #[getter]
    fn stiffness_max_n_per_m(&self) -> f64 {
        stiffness_max(&self.shared).last().map_or(0.0, |k| k.value)
    }

    /// The greatest lateral stiffness in stick, N/m; 0 of a coupled law, which has none apart from the depth.
    #[getter]
    fn stiffness_aside_n_per_m(&self) -> f64 {
        stiffness_aside(&self.shared)
    }

    /// The greatest stiffness at each depth to which responses were found: columns depth (m) and stiffness (N/m). (k, 2).
    #[getter]
    fn stiffness_by_depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows: Vec<[f64; 2]> = stiffness_max(&self.shared).iter().map(|k| [k.depth_m, k.value]).collect();
        crate::arrays::matrix(py, &rows)
    }

    /// Where it came from, as the file has it: command, software, spec, inputs' digests, notes, errors of the fit.
    #[getter]
    fn provenance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        crate::python_of(py, self.shared.provenance())
    }

    /// The curves of one node: the blend of its test points'.
    ///
    /// Args:
    ///     node: Which, from 0.
    ///     deflection_m: Where the curves are read. (k,), m, 0 or more.
    ///
    /// Returns:
    ///     A dict with `normal_n` (at depths), `lateral_n` (at lateral deflections) and `friction` (at depths), (k,) each.
    ///
    /// Raises:
    ///     InputError: There is no such node, or the law is a coupled potential.
    #[pyo3(signature = (node, *, deflection_m))]
    fn node_curves<'py>(
        &self,
        py: Python<'py>,
        node: usize,
        deflection_m: PyArrayLike1<'_, f64, AllowTypeChange>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let response = self.shared.node_response(node).map_err(Raised::raised)?;
        let at = deflection_m.as_array();
        let curves = PyDict::new(py);
        for (name, curve) in [
            ("normal_n", &response.normal),
            ("lateral_n", &response.lateral),
            ("friction", &response.friction),
        ] {
            curves.set_item(name, PyArray1::from_iter(py, at.iter().map(|&d| curve.value(d))))?;
        }
        Ok(curves)
    }

    /// A table of what it is, for notebooks.
    fn _repr_html_<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        this.py().import("palpate._display")?.call_method1("body_html", (this,))
    }

    fn __repr__(&self) -> String {
        format!(
            "<palpate.Body: {} nodes, {} triangles, {} test points, {} tool>",
            self.shared.nodes().len(),
            self.shared.elements().len(),
            self.shared.test_point_nodes().len(),
            self.tool()
        )
    }
}
