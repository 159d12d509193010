//! The volume that is simulated, and the surface that is touched: the user's own triangles, a shape's, or a volume
//! mesh's boundary.

use super::prepare::layers;
use crate::spec::{Contact, Geometry, Place, Simulation, Spec, TestPoints, ToolShape};
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
use palpate_simulate::mesh::stuffing::{FillOptions, FillReport, Finer, fill};
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
            let half_height = match shape {
                Shape::Block { size_mm } => size_mm[2] / 2e3,
                Shape::Cylinder { length_mm, .. } => length_mm / 2e3,
                // Their elements follow no planes.
                _ => 0.0,
            };
            let planes_z_m = layers(simulation, -half_height, half_height);
            let block = match shape {
                Shape::Block { size_mm } => Some(DVec3::from_array(*size_mm) / 1e3),
                _ => None,
            };
            let form = Form { block, layered: !planes_z_m.is_empty() };
            let mut options = options(simulation, &triangles, form, path, &mut notes)?;
            options.planes_z_m = planes_z_m;
            let filled = fill_shape(shape, &options).map_err(|e| anyhow!("{}: {e}", path.display()))?;
            // A block's nodes lie on its faces.
            let sizes = options.finer.iter().filter(|_| block.is_some()).map(|place| place.edge_m);
            (triangles, filled, sizes.fold(options.surface_edge_m, f64::min))
        }
        Some(Geometry::Mesh(file)) => {
            let unit = spec.unit.ok_or_else(|| {
                anyhow!("{}: the mesh's unit is missing; add unit to [body]", path.display())
            })?;
            match read_any(file, unit)? {
                Imported::Volume(mesh) => {
                    let triangles = corners(&mesh, &mesh.boundary());
                    let (low, high) = bounds(&mesh.positions);
                    let tolerance_m = 1e-6 * high.distance(low);
                    return Ok(Source { triangles, mesh, tolerance_m, of_surface: false, notes });
                }
                Imported::Surface(triangles) => {
                    let (triangles, report) = repair::repair(triangles, Options { allow_open: false })
                        .map_err(|e| e.in_file(file))?;
                    let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
                    notes.extend(report.notes.iter().map(|note| format!("{name}: {note}")));
                    let options = options(simulation, &triangles, Form::default(), path, &mut notes)?;
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

/// What is known of a body's form.
#[derive(Clone, Copy, Default)]
struct Form {
    /// A block's size, m.
    block: Option<DVec3>,
    /// Whether planes part its elements.
    layered: bool,
}

/// Elements that are smaller in some places of the surface than elsewhere.
struct Graded {
    finer: Vec<Finer>,
    elsewhere_m: f64,
    /// Where they are, in words.
    place: &'static str,
}

/// Where elements are smaller than elsewhere, if the spec leaves their size open: around a few named test points, and where the body is
/// touched, if that is a part of it.
fn graded(
    simulation: &Simulation,
    tool: f64,
    surface: &TriangleMesh,
    (volume, area): (f64, f64),
    form: Form,
) -> Option<Graded> {
    if simulation.mesh.element_size_m.is_some() {
        return None;
    }
    // What the body's shape needs; flat faces need no small elements for their shape's sake, but regions want elements of their own.
    let flat = form.block.is_some() && simulation.regions.is_empty();
    let shape = (volume.cbrt() / 8.0).min(0.75 * volume / area) * if flat { 2.0 } else { 1.0 };
    match &simulation.test_points {
        TestPoints::At(points) if points.len() <= FEW => {
            let fine = tool / ACROSS;
            let around = |p: &DVec3| Finer::around(on(surface, *p), tool, fine);
            // Cells are halved: sizes in between would all become smaller.
            let elsewhere_m = fine * libm::exp2(libm::log2(shape.max(tool / 2.0) / fine).floor());
            let finer = points.iter().map(around).collect();
            Some(Graded { finer, elsewhere_m, place: "around the test points" })
        }
        _ => where_touched(simulation, tool, surface, (volume, area), form, shape),
    }
}

/// Around the box that a body is touched in. None where all of it may as well have small elements, where the box goes through a block, or
/// with layers, which cells of several sizes would cut too thinly.
fn where_touched(
    simulation: &Simulation,
    tool: f64,
    surface: &TriangleMesh,
    (volume, area): (f64, f64),
    form: Form,
    shape: f64,
) -> Option<Graded> {
    let Some(Place::Box { low, high }) = simulation.touched else { return None };
    let (least, greatest) = bounds(&surface.positions);
    let (low, high) = (low.max(least), high.min(greatest));
    let extent = high - low;
    if extent.min_element() < 0.0 || form.layered {
        return None;
    }
    let beyond = match simulation.tool {
        // No telling which part of it touches.
        ToolShape::Mesh { .. } => return None,
        ToolShape::Capsule { length_m, .. } => length_m / 2.0,
        _ => 0.0,
    };
    // As far as the tool is dragged.
    let mut aside = DVec3::splat(simulation.deflection.lateral_max_m + beyond);
    if let Some(half) = form.block.map(|size| size / 2.0) {
        let on_face = |a: usize| low[a] <= -half[a] * (1.0 - 1e-9) || high[a] >= half[a] * (1.0 - 1e-9);
        aside[(0..3).find(|&a| on_face(a) && extent[a] <= tool)?] = 0.0;
    }
    let fine = tool / 2.0;
    let finer = Finer { low: low - aside, high: high + aside, within_m: tool, edge_m: fine };
    let interior = |edge: f64| interior(simulation, edge);
    // A block's cells are an even number along each axis, and stretched to fit: halved they stay so.
    let fits = |edge: f64| {
        let stretch = |length: f64| length / (2.0 * (length / edge / 2.0).round().max(1.0)) / edge;
        form.block.is_none_or(|size| size.to_array().into_iter().map(stretch).fold(0.0, f64::max) <= STRETCH)
    };
    let coarse = (1..=6).rev().map(|k| fine * f64::from(1 << k)).find(|&c| c <= SLACK * shape && fits(c))?;
    let around = (finer.low - tool).max(least)..(finer.high + tool).min(greatest);
    let area_there = area_within(surface, around.start, around.end);
    let elsewhere = nodes(volume, area, coarse, interior(coarse));
    let spared =
        elsewhere + nodes(0.0, area_there, fine, fine) < 0.8 * nodes(volume, area, fine, interior(fine));
    // Cells of one size as deep as the place reaches.
    let cells = (around.end - around.start).element_product() / fine.powi(3);
    let within_budget = elsewhere + 16.0 * cells < NODES;
    (spared && within_budget).then(|| Graded {
        finer: vec![finer],
        elsewhere_m: coarse,
        place: "where it is touched",
    })
}

/// Least and greatest coordinates.
fn bounds(positions: &[DVec3]) -> (DVec3, DVec3) {
    let fold = |(low, high): (DVec3, DVec3), p: &DVec3| (low.min(*p), high.max(*p));
    positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), fold)
}

/// Of a surface what lies in a box, m²: each triangle cut by the box's planes, one after the other (Sutherland and Hodgman 1974).
fn area_within(surface: &TriangleMesh, low: DVec3, high: DVec3) -> f64 {
    let mut area = 0.0;
    for t in &surface.triangles {
        let mut polygon: Vec<DVec3> = t.iter().map(|n| surface.positions[*n as usize]).collect();
        for (axis, end, sign) in (0..3).flat_map(|a| [(a, low[a], 1.0), (a, high[a], -1.0)]) {
            let within = |p: DVec3| sign * (p[axis] - end);
            let mut kept = Vec::with_capacity(polygon.len() + 1);
            for (i, &p) in polygon.iter().enumerate() {
                let q = polygon[(i + 1) % polygon.len()];
                let (at_p, at_q) = (within(p), within(q));
                if at_p >= 0.0 {
                    kept.push(p);
                }
                if (at_p >= 0.0) != (at_q >= 0.0) {
                    kept.push(p + (q - p) * (at_p / (at_p - at_q)));
                }
            }
            polygon = kept;
        }
        let fan = polygon.windows(2).skip(1).map(|e| (e[0] - polygon[0]).cross(e[1] - polygon[0]));
        area += fan.sum::<DVec3>().length() / 2.0;
    }
    area
}

/// Longest edges inside, for elements of that edge at the surface, m.
fn interior(simulation: &Simulation, edge: f64) -> f64 {
    simulation.mesh.interior_size_m.unwrap_or(FillOptions::new(edge).interior_edge_m).max(edge)
}

/// Element sizes: those of the spec, else half the tool's radius at the surface, where a contact needs a few elements
/// across, or what the grading says.
fn options(
    simulation: &Simulation,
    surface: &TriangleMesh,
    form: Form,
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
    let graded = graded(simulation, tool, surface, (volume, area), form);
    let by_default = graded.as_ref().map_or(tool / 2.0, |g| g.elsewhere_m);
    let wanted = sizes.element_size_m.unwrap_or(by_default);
    let interior = |edge: f64| interior(simulation, edge);
    let mut edge = wanted;
    if sizes.element_size_m.is_none() {
        // Not larger than what a small body needs to have a shape at all.
        edge = edge.min(volume.cbrt() / 4.0);
        while nodes(volume, area, edge, interior(edge)) > NODES {
            edge *= 1.05;
        }
        if edge > wanted {
            let what = if graded.is_some() { "what its shape needs" } else { "half the tool's radius" };
            notes.push(format!(
                "elements at the surface have {:.2} mm instead of {:.2} mm, {what}, so that there are no more than about {NODES} \
                 nodes; [mesh] element_size_mm says otherwise",
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
    if let Some(Graded { finer, place, .. }) = graded
        && let Some(Finer { edge_m: fine, .. }) = finer.first().filter(|place| place.edge_m < edge)
    {
        notes.push(format!(
            "elements {place} have {:.2} mm, 1/{:.0} of the tool's radius, and elsewhere up to {:.2} mm at the surface",
            fine * 1e3,
            tool / fine,
            edge * 1e3
        ));
        options.finer = finer.iter().map(|place| Finer { edge_m: SLACK * fine, ..*place }).collect();
    }
    Ok(options)
}

/// So few test points named by the spec get small elements around each: one wants to know them well.
const FEW: usize = 3;
/// Of those elements, edges along the tool's radius.
const ACROSS: f64 = 5.0;
/// Cells that a shape's length stretches a little are not halved.
const SLACK: f64 = 1.2;
/// So much a block's size may stretch cells that are still called as long as they are asked to be.
const STRETCH: f64 = 1.1;

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
            let (low, high) = bounds(&mesh.positions);
            (high - low).min_element() / 2.0
        }
        (ToolShape::Point, _) => depth,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(test_points: &str, mesh: &str) -> Source {
        solid("kind = \"block\", size_mm = [80, 80, 40], edge_length_mm = 20", test_points, mesh)
    }

    fn solid(shape: &str, test_points: &str, mesh: &str) -> Source {
        let text = format!(
            "body.shape = {{ {shape} }}\n\
             [[body.fixed]]\nhalf_space = {{ point_mm = [0, 0, -20], normal = [0, 0, -1] }}\n\
             [material]\nmodel = \"neo-hookean\"\nyoung_modulus_pa = 10e3\npoisson_ratio = 0.45\n\
             [tool]\nshape = \"sphere\"\nradius_mm = 8\n\
             [deflection]\nnormal_max_mm = 3\nlateral_max_mm = 2\nsteps = 3\n\
             [test_points]\n{test_points}\n{mesh}\n"
        );
        let path = Path::new("block.toml");
        let spec = Spec::parse(path, text).unwrap();
        let simulation = spec.simulation(path).unwrap();
        source(&spec, &simulation, path).unwrap()
    }

    /// The longest edge of an element between corners whose middle `place` holds, m.
    fn longest(source: &Source, place: impl Fn(DVec3) -> bool) -> f64 {
        let corners = source.mesh.elements.iter().map(|e| [e[0], e[1], e[2], e[3]]);
        let corners = corners.map(|e| e.map(|n| source.mesh.positions[n as usize]));
        let edges = corners
            .filter(|p| place(p.iter().sum::<DVec3>() / 4.0))
            .flat_map(|p| [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)].map(|(i, j)| p[i].distance(p[j])));
        edges.fold(0.0, f64::max)
    }

    #[test]
    fn a_block_has_small_elements_where_it_is_touched() {
        let touched = "count = 9\nbox_mm = [[-10, -10, 19.9], [10, 10, 20.1]]";
        let under = |p: DVec3| p.truncate().abs().max_element() < 10e-3 && p.z > 14e-3;
        let aside = |p: DVec3| p.truncate().abs().max_element() > 30e-3;
        let [part, all] = [touched, "count = 9"].map(|test_points| block(test_points, ""));
        let told =
            |s: &Source| s.notes.iter().any(|n| n.starts_with("elements where it is touched have 4.00 mm"));
        assert!(told(&part) && !told(&all), "{:?}", part.notes);
        // Cubes of half of the ball's radius, with the diagonals of their faces.
        assert!(longest(&part, under) < 5.7e-3, "{}", longest(&part, under));
        assert!(longest(&all, under) < 5.7e-3, "{}", longest(&all, under));
        assert!(longest(&part, aside) > 7e-3, "{}", longest(&part, aside));
        let [few, many] = [&part, &all].map(|s| s.mesh.positions.len());
        assert!(4 * few < 3 * many, "{few} of {many}");
        // A box that holds more than a side is none on one side.
        let through = block("count = 9\nbox_mm = [[-10, -10, -21], [10, 10, 21]]", "");
        assert_eq!(through.mesh.positions.len(), many);
        // Who says how long they are gets them so.
        let asked = block(touched, "[mesh]\nelement_size_mm = 10");
        assert!(!told(&asked) && longest(&asked, under) > 8e-3, "{}", longest(&asked, under));
    }

    #[test]
    fn a_round_body_has_small_elements_where_it_is_touched() {
        let shape = "kind = \"cylinder\", radius_mm = 30, length_mm = 90, edge_length_mm = 5";
        let touched = "count = 9\nbox_mm = [[25, -8, -8], [31, 8, 8]]";
        let [part, all] = [touched, "count = 9"].map(|test_points| solid(shape, test_points, ""));
        let told =
            |s: &Source| s.notes.iter().any(|n| n.starts_with("elements where it is touched have 4.00 mm"));
        assert!(told(&part) && !told(&all), "{:?}", part.notes);
        let [few, many] = [&part, &all].map(|s| s.mesh.positions.len());
        assert!(4 * few < 3 * many, "{few} of {many}");
        // Where the tool can come to they are alike; beyond they are larger.
        let under = |p: DVec3| p.x > 22e-3 && p.y.abs().max(p.z.abs()) < 10e-3;
        let aside = |p: DVec3| p.x < -20e-3;
        assert!(longest(&part, under) < 1.1 * longest(&all, under));
        assert!(longest(&part, aside) > 1.5 * longest(&all, aside));
    }

    #[test]
    fn the_area_in_a_box_is_cut_at_its_sides() {
        let shape = Shape::Block { size_mm: [80.0, 80.0, 40.0] };
        let surface = shape.mesh(palpate_body::shape::Resolution::default()).unwrap();
        let within = |low: [f64; 3], high: [f64; 3]| {
            1e6 * area_within(&surface, DVec3::from_array(low) / 1e3, DVec3::from_array(high) / 1e3)
        };
        assert!((within([-50.0; 3], [50.0; 3]) - 25_600.0).abs() < 1e-6);
        assert!((within([-7.0, -3.0, 10.0], [5.0, 4.0, 30.0]) - 84.0).abs() < 1e-6);
        // Around an edge: of the top and of the side.
        assert!((within([30.0, -5.0, 12.0], [50.0, 5.0, 30.0]) - 180.0).abs() < 1e-6);
        assert!(within([-5.0; 3], [5.0; 3]) < 1e-9);
    }
}
