//! The volume that is simulated, and the surface that is touched: the user's own triangles, a shape's, or a volume
//! mesh's boundary.

use super::prepare::layers;
use crate::spec::{Contact, Geometry, Simulation, Spec, TestPoints, ToolShape};
use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::TriangleMesh;
use palpate_body::import;
use palpate_body::repair::{self, Options};
use palpate_body::shape::Shape;
use palpate_simulate::TetMesh;
use palpate_simulate::mesh::Boundary;
use palpate_simulate::mesh::import::{Imported, read_any};
use palpate_simulate::mesh::shape::fill as fill_shape;
use palpate_simulate::mesh::stuffing::{Ball, FillOptions, FillReport, fill};
use std::path::Path;

/// What a body is touched on and solved in.
pub struct Source {
    /// Touched, m.
    pub triangles: TriangleMesh,
    /// Solved in.
    pub mesh: TetMesh,
    /// Nodes this far outside a support still belong to it, m.
    pub tolerance_m: f64,
    /// Whether the surface has nodes of its own, which are not the mesh's.
    pub of_surface: bool,
    /// What was repaired or assumed.
    pub notes: Vec<String>,
}

/// Reads or makes both.
///
/// # Errors
/// A mesh that can't be read, repaired or filled.
pub fn source(spec: &Spec, simulation: &Simulation, path: &Path) -> Result<Source> {
    let mut notes = Vec::new();
    let (triangles, (mesh, report), size) = match &spec.geometry {
        None => bail!("{}: [body] names neither mesh nor shape; add one", path.display()),
        Some(Geometry::Shape(shape, resolution)) => {
            let triangles = shape.mesh(*resolution).map_err(|e| e.in_file(path))?;
            // Regions want elements of their own size.
            let flat = matches!(shape, Shape::Block { .. }) && simulation.regions.is_empty();
            let mut options = options(simulation, &triangles, flat, path, &mut notes)?;
            let half_height = match shape {
                Shape::Block { size_mm } => size_mm[2] / 2e3,
                Shape::Cylinder { length_mm, .. } => length_mm / 2e3,
                // Their elements follow no planes.
                _ => 0.0,
            };
            options.planes_z_m = layers(simulation, -half_height, half_height);
            let filled = fill_shape(shape, &options).map_err(|e| anyhow!("{}: {e}", path.display()))?;
            (triangles, filled, options.surface_edge_m)
        }
        Some(Geometry::Mesh(file)) => {
            let unit = spec.unit.ok_or_else(|| {
                anyhow!("{}: the mesh's unit is missing; add unit to [body]", path.display())
            })?;
            match read_any(file, unit)? {
                Imported::Volume(mesh) => {
                    let triangles = corners(&mesh, &mesh.boundary());
                    let tolerance_m = 1e-6 * diagonal(&mesh.positions);
                    return Ok(Source { triangles, mesh, tolerance_m, of_surface: false, notes });
                }
                Imported::Surface(triangles) => {
                    let (triangles, report) = repair::repair(triangles, Options { allow_open: false })
                        .map_err(|e| e.in_file(file))?;
                    let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
                    notes.extend(report.notes.iter().map(|note| format!("{name}: {note}")));
                    let options = options(simulation, &triangles, false, path, &mut notes)?;
                    let filled =
                        fill(&triangles, &options).map_err(|e| anyhow!("{}: {e}", file.display()))?;
                    (triangles, filled, options.surface_edge_m)
                }
            }
        }
    };
    let FillReport { nodes, elements, surface_edge_m, least_angle_deg, largest_angle_deg, .. } = report;
    notes.push(format!(
        "{elements} elements and {nodes} nodes, {:.2} mm long at the surface, angles {least_angle_deg:.0}° to \
         {largest_angle_deg:.0}°, volume {:+.2} %",
        surface_edge_m * 1e3,
        100.0 * (report.volume_m3 / report.surface_volume_m3 - 1.0)
    ));
    // A mesh that was cut from a lattice has its nodes on the surface as far as its elements allow.
    Ok(Source { triangles, mesh, tolerance_m: 0.05 * size, of_surface: true, notes })
}

fn diagonal(positions: &[DVec3]) -> f64 {
    let fold = |(low, high): (DVec3, DVec3), p: &DVec3| (low.min(*p), high.max(*p));
    let (low, high) = positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), fold);
    (high - low).length()
}

/// A boundary's triangles between corners, which are numbered in their order in the mesh.
pub fn corners(mesh: &TetMesh, boundary: &Boundary) -> TriangleMesh {
    let mut nodes: Vec<u32> = boundary.faces.iter().flat_map(|f| [f[0], f[1], f[2]]).collect();
    nodes.sort_unstable();
    nodes.dedup();
    let index = |n: u32| nodes.binary_search(&n).unwrap_or_default() as u32;
    TriangleMesh {
        positions: nodes.iter().map(|n| mesh.positions[*n as usize]).collect(),
        triangles: boundary.faces.iter().map(|f| [index(f[0]), index(f[1]), index(f[2])]).collect(),
    }
}

/// Meshes beyond this are made coarser, unless the spec says how fine: a solve takes seconds, and there are thousands.
const NODES: f64 = 150e3;
/// Meshes beyond this are refused.
const MAX_NODES: f64 = 3e6;

/// Element sizes: those of the spec, else half the tool's radius at the surface, where a contact needs a few elements
/// across. Faces that are `flat` need no small elements for their shape's sake.
fn options(
    simulation: &Simulation,
    surface: &TriangleMesh,
    flat: bool,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<FillOptions> {
    let (volume, area) = volume_and_area(surface);
    let sizes = simulation.mesh;
    let tool = tool_radius(simulation)?;
    if !(tool.is_finite() && tool > 0.0 && volume.is_finite() && volume > 0.0) {
        let hint = "give a tool and a surface that enclose a volume";
        bail!(
            "{}: the tool or the body is flat ({:.3} mm, {volume:.3e} m³); {hint}",
            path.display(),
            tool * 1e3
        );
    }
    let few = match &simulation.test_points {
        TestPoints::At(points) if points.len() <= FEW && sizes.element_size_m.is_none() => &points[..],
        _ => &[],
    };
    let fine = tool / ACROSS;
    let coarse = match few {
        [] => tool / 2.0,
        // What the body's shape needs; cells are halved, so that sizes in between would all become smaller.
        _ => {
            let per_shape = if flat { 2.0 } else { 1.0 };
            let shape = (volume.cbrt() / 8.0).min(0.75 * volume / area) * per_shape;
            let shape = shape.max(tool / 2.0);
            fine * libm::exp2(libm::log2(shape / fine).floor())
        }
    };
    let wanted = sizes.element_size_m.unwrap_or(coarse);
    let interior =
        |edge: f64| sizes.interior_size_m.unwrap_or(FillOptions::new(edge).interior_edge_m).max(edge);
    let mut edge = wanted;
    if sizes.element_size_m.is_none() {
        // Not larger than what a small body needs to have a shape at all.
        edge = edge.min(volume.cbrt() / 4.0);
        while nodes(volume, area, edge, interior(edge)) > NODES {
            edge *= 1.05;
        }
        if edge > wanted {
            notes.push(format!(
                "elements at the surface have {:.2} mm instead of {:.2} mm, half the tool's radius, so that there are no \
                 more than about {NODES} nodes; [mesh] element_size_mm says otherwise",
                edge * 1e3,
                wanted * 1e3
            ));
        }
    }
    let count = nodes(volume, area, edge, interior(edge));
    if count > MAX_NODES {
        bail!(
            "{}: [mesh] element_size_mm {} would make about {count:.0} nodes, where {MAX_NODES:.0} are the most; give a \
             larger one",
            path.display(),
            edge * 1e3
        );
    }
    let mut options = FillOptions::new(edge);
    options.interior_edge_m = interior(edge);
    if !few.is_empty() && fine < edge {
        options.finer = few
            .iter()
            .map(|p| Ball { centre: on(surface, *p), radius_m: tool, edge_m: SLACK * fine })
            .collect();
        let millimetres = fine * 1e3;
        notes.push(format!(
            "elements around the test points have {millimetres:.2} mm, a fifth of the tool's radius"
        ));
    }
    Ok(options)
}

/// So few test points named by the spec get small elements around each: one wants to know them well.
const FEW: usize = 3;
/// Of those elements, edges along the tool's radius.
const ACROSS: f64 = 5.0;
/// Cells that a shape's length stretches a little are not halved.
const SLACK: f64 = 1.2;

/// The surface's node nearest to a point.
fn on(surface: &TriangleMesh, p: DVec3) -> DVec3 {
    let distance = |q: &&DVec3| q.distance_squared(p);
    let nearest = surface.positions.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.copied().unwrap_or(p)
}

/// About how many nodes a mesh has: a lattice cell has 16, cells grow inwards, and are largest deep inside.
fn nodes(volume: f64, area: f64, edge: f64, interior: f64) -> f64 {
    8.0 * area / edge.powi(2) + 8.0 * volume / interior.powi(3)
}

/// Volume (m³) and area (m²) of a closed surface.
fn volume_and_area(surface: &TriangleMesh) -> (f64, f64) {
    let mut sums = (0.0, 0.0);
    for t in &surface.triangles {
        let [a, b, c] = t.map(|n| surface.positions[n as usize]);
        sums.0 += a.dot(b.cross(c)) / 6.0;
        sums.1 += (b - a).cross(c - a).length() / 2.0;
    }
    (sums.0.abs(), sums.1)
}

/// The length that tells how fine a contact with the tool is, m.
pub fn tool_radius(simulation: &Simulation) -> Result<f64> {
    let depth = simulation.deflection.normal_max_m;
    Ok(match (&simulation.tool, simulation.contact) {
        (_, Contact::Bonded { patch_radius_m }) => patch_radius_m,
        (ToolShape::Sphere { radius_m } | ToolShape::FlatPunch { radius_m }, _)
        | (ToolShape::Capsule { radius_m, .. }, _) => *radius_m,
        // At half of its depth.
        (ToolShape::Cone { half_angle_rad, tip_radius_m }, _) => {
            tip_radius_m.max(0.5 * depth * libm::tan(*half_angle_rad))
        }
        (ToolShape::Mesh { file, unit }, _) => {
            let mesh = import::read(file, Some(*unit))?;
            let fold = |(low, high): (DVec3, DVec3), p: &DVec3| (low.min(*p), high.max(*p));
            let (low, high) = mesh.positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), fold);
            (high - low).min_element() / 2.0
        }
        (ToolShape::Point, _) => depth,
    })
}
