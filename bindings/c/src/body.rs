//! Bodies: opened, saved, inspected.

use crate::handles::{Table, palpate_body};
use crate::status::{
    Failure, PALPATE_STATUS_TOO_SMALL, array, changed, guarded, palpate_error, palpate_status, place, quick,
    room, sized, text,
};
use glam::DVec3;
use palpate::Body;
use palpate::body::stiffness::{stiffness_aside, stiffness_max};
use palpate::body::{SlipRule, Tool};
use std::ffi::c_char;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The paper's slip rule.
pub const PALPATE_SLIP_PAPER: u32 = 1;
/// The paper's rule with the energy's gradient along the surface: the usual one.
pub const PALPATE_SLIP_CONSISTENT: u32 = 2;
/// Down the energy's own slope: it generates none, and the force clicks where facets meet.
pub const PALPATE_SLIP_EXACT: u32 = 3;

/// A tip without extent, or another tool that is given by its tip.
pub const PALPATE_TOOL_TIP: u32 = 0;
/// A sphere, given by its centre.
pub const PALPATE_TOOL_SPHERE: u32 = 1;

/// What is open as a body.
#[derive(Debug)]
pub(crate) struct OpenBody {
    pub body: Arc<Body>,
    /// Its file; none for one that was made in memory.
    pub file: Option<PathBuf>,
}

static BODIES: Table<OpenBody> = Table::new(1);

/// What a body is.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_body_info {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// The slip rule that the body asks for: `PALPATE_SLIP_...`.
    pub slip_rule: u32,
    /// 1 if the body asks for the tank, with which slip gives out no more energy than it has dissipated before.
    pub has_tank: u32,
    /// 1 if its law is a coupled potential, 0 if it is curves.
    pub is_coupled: u32,
    /// 1 if its lateral response is alike in all directions.
    pub is_isotropic: u32,
    /// The tool that its responses hold for: `PALPATE_TOOL_...`.
    pub tool: u32,
    /// Radius of that tool's sphere, m; 0 for a tip.
    pub tool_radius_m: f64,
    /// Nodes: vertices, and those that creases doubled.
    pub nodes: u64,
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub elements: u64,
    /// Test points: places with responses of their own.
    pub test_points: u64,
    /// What tells it from another body.
    pub identity: u64,
    /// Its box at rest, from here, m.
    pub low_m: [f64; 3],
    /// To here, m.
    pub high_m: [f64; 3],
    /// How deep its responses were found, m; they go on straight beyond.
    pub depth_max_m: f64,
    /// The greatest stiffness that it answers with, N/m: what a device must be able to hold.
    pub stiffness_max_n_per_m: f64,
    /// The greatest lateral stiffness in stick, N/m; 0 with a coupled law, which has none apart from the depth.
    pub stiffness_aside_n_per_m: f64,
}

sized!(palpate_body_info);

/// A rule by its number.
pub(crate) fn slip_rule(number: u32) -> Result<SlipRule, Failure> {
    match number {
        PALPATE_SLIP_PAPER => Ok(SlipRule::Paper),
        PALPATE_SLIP_CONSISTENT => Ok(SlipRule::Consistent),
        PALPATE_SLIP_EXACT => Ok(SlipRule::Exact),
        _ => Err(Failure::invalid(format!("slip rule {number}: give one of PALPATE_SLIP_..."))),
    }
}

/// A rule's number; 0 for one that this version does not know.
pub(crate) fn slip_number(rule: SlipRule) -> u32 {
    match rule {
        SlipRule::Paper => PALPATE_SLIP_PAPER,
        SlipRule::Consistent => PALPATE_SLIP_CONSISTENT,
        SlipRule::Exact => PALPATE_SLIP_EXACT,
        _ => 0,
    }
}

/// What a handle of a body names.
pub(crate) fn open_body(body: palpate_body) -> Result<(Arc<Body>, Option<PathBuf>), palpate_status> {
    let open = BODIES.read(body.id)?;
    Ok((open.body.clone(), open.file.clone()))
}

/// A handle for it.
pub(crate) fn hand_out(body: Body, file: Option<PathBuf>) -> palpate_body {
    palpate_body { id: BODIES.open(OpenBody { body: Arc::new(body), file }) }
}

/// Opens the body file at `path` (UTF-8), reads and checks all of it, and writes a handle to `*body`. Bodies that palpate's commands or
/// `palpate_body_save` wrote.
/// Fails with `PALPATE_STATUS_BODY`: the file can't be read, is damaged, or of a newer version.
/// Not real-time: reads the disk, allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_open(
    path: *const c_char,
    body: *mut palpate_body,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let (path, to) = (Path::new(text(path, "the path")?), place(body)?);
            let opened = Body::open(path)?;
            *to = hand_out(opened, Some(path.to_path_buf()));
            Ok(())
        })
    }
}

/// The same from the bytes of a body file, of any alignment, which are not needed after the call.
/// Not real-time: allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_from_memory(
    bytes: *const u8,
    length: usize,
    body: *mut palpate_body,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let (bytes, to) = (array(bytes, length)?, place(body)?);
            *to = hand_out(Body::from_bytes(bytes)?, None);
            Ok(())
        })
    }
}

/// Writes a body to a file, which is replaced only when the new one is whole.
/// Fails with `PALPATE_STATUS_BODY`: the file can't be written. Not real-time: writes the disk.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_save(
    body: palpate_body,
    path: *const c_char,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let path = text(path, "the path")?;
            open_body(body)?.0.save(Path::new(path))?;
            Ok(())
        })
    }
}

/// What a body is: sizes, law, tool, box, stiffness.
/// Not real-time: it looks at every test point.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_inspect(
    body: palpate_body,
    info: *mut palpate_body_info,
) -> palpate_status {
    quick(|| {
        // SAFETY: the caller keeps the header's promises.
        let to = unsafe { changed(info) }?;
        let (body, _) = open_body(body)?;
        let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) =
            body.nodes().iter().fold(nowhere, |(low, high), n| (low.min(n.position), high.max(n.position)));
        let tool =
            if matches!(body.tool(), Tool::Sphere { .. }) { PALPATE_TOOL_SPHERE } else { PALPATE_TOOL_TIP };
        *to = palpate_body_info {
            struct_size: to.struct_size,
            slip_rule: slip_number(body.slip()),
            has_tank: body.has_tank().into(),
            is_coupled: body.is_coupled().into(),
            is_isotropic: body.is_isotropic().into(),
            tool,
            tool_radius_m: body.tool().radius_m(),
            nodes: body.nodes().len() as u64,
            vertices: body.vertex_count() as u64,
            elements: body.elements().len() as u64,
            test_points: body.test_point_nodes().len() as u64,
            identity: body.identity(),
            low_m: low.to_array(),
            high_m: high.to_array(),
            depth_max_m: body.responses().depth_knots().values().last().copied().unwrap_or_default(),
            stiffness_max_n_per_m: stiffness_max(&body).last().map_or(0.0, |k| k.value),
            stiffness_aside_n_per_m: stiffness_aside(&body),
        };
        Ok(())
    })
}

/// The greatest stiffness at each depth to which the body's responses were found (its depth knots): writes up to `capacity` depths, m, to
/// `depths_m` and stiffnesses, N/m, to `stiffness_n_per_m`, and to `*count` how many there are. Either array may be null.
/// `PALPATE_STATUS_TOO_SMALL` if there are more than `capacity`. `palpate_body_certify` certifies
/// more than that. Not real-time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_stiffness(
    body: palpate_body,
    depths_m: *mut f64,
    stiffness_n_per_m: *mut f64,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    quick(|| {
        let (body, _) = open_body(body)?;
        let most = stiffness_max(&body);
        // SAFETY: the caller keeps the header's promises.
        unsafe {
            *place(count)? = most.len();
            let there = |array: *mut f64| if array.is_null() { 0 } else { capacity };
            room(depths_m, there(depths_m))?.iter_mut().zip(&most).for_each(|(to, k)| *to = k.depth_m);
            room(stiffness_n_per_m, there(stiffness_n_per_m))?
                .iter_mut()
                .zip(&most)
                .for_each(|(to, k)| *to = k.value);
        }
        if most.len() > capacity { Err(PALPATE_STATUS_TOO_SMALL) } else { Ok(()) }
    })
}

/// Copies the surface at rest, as a renderer wants it: to `positions_m` the nodes' places in the body's frame, m (nodes × 3), and to
/// `triangles` the elements' nodes, counter-clockwise seen from outside (elements × 3). Sizes are those of `palpate_body_inspect`;
/// `node_capacity` and `element_capacity` say for how many there is room. Either array may be null.
/// `PALPATE_STATUS_TOO_SMALL` if there are more than room is for. Not real-time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_surface(
    body: palpate_body,
    positions_m: *mut f64,
    node_capacity: usize,
    triangles: *mut u32,
    element_capacity: usize,
) -> palpate_status {
    quick(|| {
        let (body, _) = open_body(body)?;
        let (nodes, elements) = (body.nodes(), body.elements());
        let lacks = |is_there: bool, capacity: usize, needed: usize| is_there && capacity < needed;
        if lacks(!positions_m.is_null(), node_capacity, nodes.len())
            || lacks(!triangles.is_null(), element_capacity, elements.len())
        {
            return Err(PALPATE_STATUS_TOO_SMALL);
        }
        // SAFETY: the caller keeps the header's promises.
        unsafe {
            let count = if positions_m.is_null() { 0 } else { nodes.len() };
            let places = nodes.iter().flat_map(|n| n.position.to_array());
            room(positions_m, 3 * count)?.iter_mut().zip(places).for_each(|(to, x)| *to = x);
            let count = if triangles.is_null() { 0 } else { elements.len() };
            let corners = elements.iter().flat_map(|e| e.nodes);
            room(triangles, 3 * count)?.iter_mut().zip(corners).for_each(|(to, n)| *to = n);
        }
        Ok(())
    })
}

/// Closes a handle. Contacts and sessions on the body keep it for as long as they need it.
/// `PALPATE_STATUS_CLOSED` if it was closed before. Not real-time: it may free memory.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_body_close(body: palpate_body) -> palpate_status {
    quick(|| BODIES.close(body.id).map(drop))
}
