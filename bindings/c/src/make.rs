//! Bodies made in the caller's program: of arrays, or from a spec.

use crate::PALPATE_ABI_VERSION;
use crate::body::{hand_out, slip_rule};
use crate::handles::palpate_body;
use crate::status::{
    Failure, PALPATE_STATUS_BODY, PALPATE_STATUS_WRONG_VERSION, array, given, guarded, palpate_error,
    palpate_status, place, sized, text,
};
use glam::DVec3;
use palpate::Body;
use palpate::body::repair::{self, Options};
use palpate::body::{Interpolation, Provenance, SlipRule, Surface, Tool, TriangleMesh};
use palpate::identify::{BodyOptions, Component, FitError, FitOptions, Sample, fit};
use std::ffi::{c_char, c_void};

/// Force against depth, N against m.
pub const PALPATE_NORMAL: u32 = 1;
/// Lateral force against lateral deflection, N against m.
pub const PALPATE_LATERAL: u32 = 2;
/// Friction coefficient against depth, m.
pub const PALPATE_FRICTION: u32 = 3;

/// Curves pass between samples as monotone cubics.
pub const PALPATE_BETWEEN_PCHIP: u32 = 0;
/// Curves pass between samples as straight lines.
pub const PALPATE_BETWEEN_LINEAR: u32 = 1;

/// One measured value.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_sample_row {
    /// Which point of the surface: rows of one point share its number.
    pub point: u32,
    /// `PALPATE_NORMAL`, `PALPATE_LATERAL` or `PALPATE_FRICTION`.
    pub component: u32,
    /// Where that point is in the body's frame, m; it counts for the surface's nearest node.
    pub position_m: [f64; 3],
    /// Depth or lateral deflection, m.
    pub deflection_m: f64,
    /// N; a friction coefficient has no unit.
    pub value: f64,
}

/// What a body is made of. `PALPATE_BODY_ARRAYS_INIT` sets size and version, and zeros: a point tool, the usual slip rule with the tank.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_body_arrays {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// `PALPATE_ABI_VERSION`.
    pub abi_version: u32,
    /// Vertices in the body's frame, m (vertex_count x 3).
    pub positions_m: *const f64,
    /// How many.
    pub vertex_count: usize,
    /// Vertices of each triangle, counter-clockwise seen from outside (triangle_count x 3).
    pub triangles: *const u32,
    /// How many.
    pub triangle_count: usize,
    /// Measured values, in any order (sample_count).
    pub samples: *const palpate_sample_row,
    /// How many.
    pub sample_count: usize,
    /// Size of a row, bytes: that of `palpate_sample_row`.
    pub sample_size: u32,
    /// 1 if the surface may have borders.
    pub is_open: u32,
    /// Edges that turn by more than this stay sharp, rad; 0 for none.
    pub crease_angle_rad: f64,
    /// Friction coefficient of every point if no row gives one; negative for none.
    pub default_friction: f64,
    /// Radius of the spherical tool that the samples were taken with, m; 0 for a tip.
    pub tool_radius_m: f64,
    /// `PALPATE_SLIP_...`; 0 for the usual one.
    pub slip_rule: u32,
    /// 1 for a body without the tank that keeps slip from giving out energy.
    pub without_tank: u32,
    /// How curves pass between samples: `PALPATE_BETWEEN_...`.
    pub between: u32,
    /// 0.
    pub reserved: u32,
}

/// How far a body from a spec, or its certificate, is. It lives as long as the call of the progress function.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_progress {
    /// Size of this struct, bytes; set by the library.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Test points, or elements, that are done.
    pub points_done: u64,
    /// Of how many; 0 as long as that is not known. Where test points are added in rounds it grows.
    pub points: u64,
    /// Something that deserves to be said, UTF-8 that ends in a zero; else null.
    pub message: *const c_char,
}

/// Hears how far it is. It returns 0 to go on, and anything else to end it: what was done is kept in the work folder. Called from threads
/// of the library's, one call at a time.
pub type palpate_progress_function =
    Option<unsafe extern "C" fn(user: *mut c_void, progress: *const palpate_progress) -> i32>;

sized!(palpate_body_arrays, palpate_progress);

fn samples(rows: &[palpate_sample_row]) -> Result<Vec<Sample>, Failure> {
    let sample = |(k, row): (usize, &palpate_sample_row)| {
        let component = match row.component {
            PALPATE_NORMAL => Component::Normal,
            PALPATE_LATERAL => Component::Lateral,
            PALPATE_FRICTION => Component::Friction,
            other => {
                return Err(Failure::invalid(format!(
                    "sample {k}: component {other}; give PALPATE_NORMAL, PALPATE_LATERAL or PALPATE_FRICTION"
                )));
            }
        };
        Ok(Sample {
            point: row.point.to_string(),
            position_m: row.position_m,
            component,
            deflection_m: row.deflection_m,
            value: row.value,
            direction: None,
            weight: None,
            line: k as u64 + 1,
        })
    };
    rows.iter().enumerate().map(sample).collect()
}

/// Makes a body of a surface and measured values: one curve of each kind for every point, placed on the surface, and every other
/// node a blend of the points around it. The mesh is repaired as `palpate fit` does (vertices welded, triangles turned). The arrays are
/// not needed after the call.
/// Fails with `PALPATE_STATUS_INVALID` (a value) or `PALPATE_STATUS_BODY` (mesh or samples; the message's "line" counts samples from 1).
/// Not real-time: allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_from_arrays(
    arrays: *const palpate_body_arrays,
    body: *mut palpate_body,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let (arrays, to) = (given(arrays)?, place(body)?);
            if arrays.abi_version != PALPATE_ABI_VERSION {
                return Err(PALPATE_STATUS_WRONG_VERSION.into());
            }
            if arrays.sample_size as usize != size_of::<palpate_sample_row>() {
                return Err(crate::PALPATE_STATUS_WRONG_SIZE.into());
            }
            let positions = array(arrays.positions_m.cast::<[f64; 3]>(), arrays.vertex_count)?;
            let triangles = array(arrays.triangles.cast::<[u32; 3]>(), arrays.triangle_count)?;
            let samples = samples(array(arrays.samples, arrays.sample_count)?)?;
            let mesh = TriangleMesh {
                positions: positions.iter().copied().map(DVec3::from_array).collect(),
                triangles: triangles.to_vec(),
            };
            *to = hand_out(made(mesh, &samples, arrays)?, None);
            Ok(())
        })
    }
}

fn made(mesh: TriangleMesh, samples: &[Sample], arrays: &palpate_body_arrays) -> Result<Body, Failure> {
    let (mesh, report) = repair::repair(mesh, Options { allow_open: arrays.is_open != 0 })?;
    let crease = arrays.crease_angle_rad;
    let surface = Surface::build(&mesh, if crease > 0.0 { crease } else { f64::INFINITY })?;
    let interpolation = match arrays.between {
        PALPATE_BETWEEN_PCHIP => Interpolation::Pchip,
        PALPATE_BETWEEN_LINEAR => Interpolation::Linear,
        other => {
            return Err(Failure::invalid(format!("between is {other}; give one of PALPATE_BETWEEN_...")));
        }
    };
    let default_friction = (arrays.default_friction >= 0.0).then_some(arrays.default_friction);
    let refused = |e: FitError| Failure::new(PALPATE_STATUS_BODY, e.to_string());
    let fitted = fit(&surface, samples, &FitOptions { interpolation, default_friction }).map_err(refused)?;
    let tool = match arrays.tool_radius_m {
        0.0 => Tool::Point,
        radius_m => Tool::Sphere { radius_m },
    };
    let slip = match arrays.slip_rule {
        0 => SlipRule::default(),
        number => slip_rule(number)?,
    };
    let software = concat!("palpate ", env!("CARGO_PKG_VERSION")).into();
    let provenance = Provenance { software, notes: report.notes, ..Provenance::default() };
    let options = BodyOptions { tool, slip, tank: arrays.without_tank == 0, partial_slip: false, provenance };
    Ok(fitted.into_body(surface, options)?)
}

/// Makes a body from the spec at `spec_path` (docs/spec.md; UTF-8): of its law at once, or by simulating its test points by finite elements,
/// on `threads` threads (0: one for each core). Finished points are kept in `work_folder`, and a call with the same folder and spec goes
/// on with them; with null a folder of the system's for temporary files is used and removed. `progress` (may be null) hears how far it
/// is, and is given `user`.
/// Fails with `PALPATE_STATUS_BODY` (the spec; the message names its line), `PALPATE_STATUS_CANCELLED` (`progress` said so),
/// `PALPATE_STATUS_UNSUPPORTED` (built without `PALPATE_FEATURE_BUILD`). Not real-time: from seconds to hours.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_from_spec(
    spec_path: *const c_char,
    work_folder: *const c_char,
    threads: u32,
    progress: palpate_progress_function,
    user: *mut c_void,
    body: *mut palpate_body,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let (spec, to) = (text(spec_path, "the spec's path")?, place(body)?);
            let folder =
                if work_folder.is_null() { None } else { Some(text(work_folder, "the work folder")?) };
            *to = hand_out(from_spec(spec, folder, threads, progress, user)?, None);
            Ok(())
        })
    }
}

#[cfg(not(feature = "build"))]
fn from_spec(
    _: &str,
    _: Option<&str>,
    _: u32,
    _: palpate_progress_function,
    _: *mut c_void,
) -> Result<Body, Failure> {
    Err(crate::PALPATE_STATUS_UNSUPPORTED.into())
}

#[cfg(feature = "build")]
use simulated::from_spec;

#[cfg(feature = "build")]
mod simulated {
    use super::{palpate_progress, palpate_progress_function};
    use crate::status::{Failure, PALPATE_STATUS_BODY, PALPATE_STATUS_CANCELLED};
    use palpate::build::Progress;
    use palpate::build::precompute::{Stopped, body_of_spec};
    use palpate::{Body, files};
    use std::ffi::{CString, c_void};
    use std::path::Path;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Mutex, PoisonError};

    /// The caller's function, how far it is, and whether it said that it ends.
    struct Listener<'a> {
        told: palpate_progress_function,
        user: Mutex<(*mut c_void, palpate_progress)>,
        cancelled: &'a AtomicBool,
    }

    // SAFETY: the caller's pointer is not followed, and given to his function alone, under the lock.
    unsafe impl Sync for Listener<'_> {}

    impl Listener<'_> {
        fn tell(&self, message: Option<&str>, change: impl FnOnce(&mut palpate_progress)) {
            let mut state = self.user.lock().unwrap_or_else(PoisonError::into_inner);
            let (user, progress) = &mut *state;
            change(progress);
            let Some(told) = self.told else { return };
            let message = message.map(|m| CString::new(m.replace('\0', " ")).unwrap_or_default());
            progress.message = message.as_ref().map_or(std::ptr::null(), |m| m.as_ptr());
            // SAFETY: the caller's function with the caller's pointer; what it is shown lives until it returns.
            if unsafe { told(*user, progress) } != 0 {
                self.cancelled.store(true, Ordering::Relaxed);
            }
            progress.message = std::ptr::null();
        }
    }

    impl Progress for Listener<'_> {
        fn begin(&self, points: usize, before: usize) {
            self.tell(None, |p| (p.points, p.points_done) = (points as u64, before as u64));
        }

        fn done(&self, _: usize) {
            self.tell(None, |p| p.points_done += 1);
        }

        fn note(&self, message: &str) {
            self.tell(Some(message), |_| ());
        }
    }

    pub fn from_spec(
        path: &str,
        folder: Option<&str>,
        threads: u32,
        told: palpate_progress_function,
        user: *mut c_void,
    ) -> Result<Body, Failure> {
        let path = Path::new(path);
        let wrong = |e: anyhow::Error| Failure::new(PALPATE_STATUS_BODY, files::message(&e));
        let cancelled = AtomicBool::new(false);
        let progress = palpate_progress {
            struct_size: size_of::<palpate_progress>() as u32,
            reserved: 0,
            points_done: 0,
            points: 0,
            message: std::ptr::null(),
        };
        let listener = Listener { told, user: Mutex::new((user, progress)), cancelled: &cancelled };
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = if threads == 0 { cores } else { threads as usize };
        body_of_spec(path, folder.map(Path::new), jobs, &listener, &cancelled).map_err(
            |stopped| match stopped {
                Stopped::Error(_) if cancelled.load(Ordering::Relaxed) => PALPATE_STATUS_CANCELLED.into(),
                Stopped::Error(e) => wrong(e),
                Stopped::Cancelled { done, of } => Failure::new(
                    PALPATE_STATUS_CANCELLED,
                    format!("ended: {done} of {of} test points are done"),
                ),
            },
        )
    }
}
