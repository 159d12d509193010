//! From a spec to what a run needs: surface, volume mesh, supports, materials, test points. Cheap checks come first.

use super::compliance::{compliance_prior, rest_compliance};
use super::elements::Elements;
use super::run::{Prepared, Rounds};
use super::supports::{extent, held_nodes, hold_surface, no_group};
use super::touched::{TouchedSurface, affordable, choose, one_for_each_vertex};
use super::{assemble, volume};
use crate::paths_file::{PathsPlan, Point, Scene, TestPoint};
use crate::spec::{
    Geometry, Material, MaterialLaw, Place, Selection, Simulation, Spec, TestPoints, ToolShape, Volume,
};
use anyhow::{Result, anyhow, bail};
use glam::{DMat3, DVec3};
use palpate_body::{MeshSearch, Surface, SurfacePoint, TriangleMesh};
use palpate_files as files;
use palpate_identify::{further_points, spread_among};
use palpate_simulate::material::{self, Bulk};
use palpate_simulate::mesh::Boundary;
use palpate_simulate::mesh::check::check;
use palpate_simulate::path::tangents;
use palpate_simulate::{Drag, PointPlan, TetMesh};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;

/// A mesh's regions and supports as the solver wants them.
pub struct Physics {
    /// With an index into `materials` as each element's region.
    pub mesh: TetMesh,
    /// By region.
    pub materials: Vec<material::Material>,
    /// The axes along which each held node can't move.
    pub fixed: BTreeMap<u32, [bool; 3]>,
}

/// What a run of this spec is asked.
///
/// # Errors
/// A file that the spec names can't be read.
pub fn plan(spec: &Spec, simulation: &Simulation, path: &Path) -> Result<PathsPlan> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut inputs = BTreeMap::new();
    for file in inputs_of(spec, simulation) {
        let name = file.strip_prefix(folder).unwrap_or(&file).display().to_string();
        inputs.insert(name, files::sha256(&file)?);
    }
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    Ok(PathsPlan {
        software: concat!("palpate ", env!("CARGO_PKG_VERSION")).into(),
        spec_name: name,
        spec: spec.text.clone(),
        inputs,
        contact: Some(simulation.contact.name().into()),
        machine: Some(palpate_simulate::instruction_set().into()),
    })
}

/// The files that the spec names.
pub fn inputs_of(spec: &Spec, simulation: &Simulation) -> Vec<PathBuf> {
    let mut inputs = Vec::new();
    if let Some(Geometry::Mesh(mesh)) = &spec.geometry {
        inputs.push(mesh.clone());
        // TetGen's meshes are two files.
        for (one, other) in [("node", "ele"), ("ele", "node")] {
            if mesh.extension().is_some_and(|e| e.eq_ignore_ascii_case(one)) {
                inputs.extend(Some(mesh.with_extension(other)).filter(|p| p.is_file()));
            }
        }
    }
    if let ToolShape::Mesh { file, .. } = &simulation.tool {
        inputs.push(file.clone());
    }
    inputs.extend(simulation.fixed.iter().filter_map(|f| match &f.selection {
        Selection::Nodes(file) => Some(file.clone()),
        _ => None,
    }));
    inputs
}

/// A signal came while a run was prepared: it ended with the stage under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interrupted {
    /// What was done last.
    pub after: &'static str,
}

impl std::fmt::Display for Interrupted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "stopped while the run was prepared, after {}: nothing was simulated or written",
            self.after
        )
    }
}

impl std::error::Error for Interrupted {}

/// Makes all that a run needs.
///
/// # Errors
/// Whatever is wrong with meshes, supports, regions or test points, with its place; [`Interrupted`] at the end of a stage
/// in which `cancelled` came true.
pub fn prepare(
    spec: &Spec,
    simulation: &Simulation,
    path: &Path,
    cancelled: &AtomicBool,
) -> Result<Prepared<Elements>> {
    let go_on = |after| if cancelled.load(Relaxed) { Err(Interrupted { after }) } else { Ok(()) };
    let in_spec = |e: palpate_body::BodyError| e.in_file(path);
    let volume::Source { triangles, mut mesh, tolerance_m, of_surface, mut notes } =
        volume::source(spec, simulation, path)?;
    go_on("the volume's mesh")?;
    let surface = assemble::surface(spec, &triangles).map_err(in_spec)?;
    let boundary = mesh.boundary();
    let name = match &spec.geometry {
        Some(Geometry::Mesh(file)) => file.as_path(),
        _ => path,
    };

    let mut fixed: BTreeMap<u32, [bool; 3]> = BTreeMap::new();
    let mut held = vec![false; surface.positions().len()];
    for support in &simulation.fixed {
        let nodes = held_nodes(support, &mesh, tolerance_m)?;
        for node in nodes {
            let axes = fixed.entry(node).or_default();
            for (axis, held) in axes.iter_mut().zip(support.axes) {
                *axis |= held;
            }
        }
        hold_surface(support, &surface, tolerance_m, &mut held)?;
    }
    let fully: HashMap<[u64; 3], bool> = boundary
        .nodes
        .iter()
        .map(|n| {
            (bits(mesh.positions[*n as usize]), fixed.get(n).is_some_and(|axes| axes.iter().any(|a| *a)))
        })
        .collect();
    if matches!(spec.geometry, Some(Geometry::Mesh(_))) {
        notes.extend(smooth_boundary(&mut mesh, &boundary, &triangles, &surface, &fixed));
    }
    if !of_surface {
        // The surface's nodes are the mesh's.
        for (held, p) in held.iter_mut().zip(surface.positions()) {
            *held = fully.get(&bits(*p)).copied().unwrap_or(false);
        }
    }

    let axes = |n| fixed.get(&n).copied().unwrap_or_default();
    let axes: Vec<[bool; 3]> = (0..mesh.positions.len() as u32).map(axes).collect();
    let (mesh, materials) = regions(simulation, mesh)?;
    let named = |e: palpate_simulate::SimulateError| anyhow!("{}: {e}", name.display());
    notes.extend(check(&mesh, &axes).map_err(named)?);
    go_on("the mesh's checks")?;
    let solver = Elements::new(Physics { mesh, materials, fixed }, simulation, path)?;
    let named = match &simulation.test_points {
        TestPoints::At(points) => points.len(),
        _ => usize::MAX,
    };
    go_on("the stiffness's factorisation")?;
    let radius_m = super::volume::tool_radius(simulation)?;
    let (points, drags) = match &simulation.test_points {
        TestPoints::Affordable => {
            let [count, drags] = affordable(solver.model().press_estimate_s(), simulation.drag_points);
            (TestPoints::Count(count as u32), drags)
        }
        points => (points.clone(), simulation.drag_points),
    };
    let mut touched = TouchedSurface::new(simulation, triangles, surface, held, path)?;
    if let TestPoints::Count(count) | TestPoints::Adaptive { most: count, .. } = points {
        let before = touched.vertices();
        let hold = |surface: &Surface, held: &mut [bool]| {
            simulation.fixed.iter().try_for_each(|support| hold_surface(support, surface, tolerance_m, held))
        };
        touched = touched.with_vertices(count as usize, radius_m, spec, simulation, path, hold)?;
        if touched.vertices() > before {
            notes.push(format!(
                "there are more test points than nodes that can be touched: triangles are divided by their edges' middles, {before} nodes become {}",
                touched.vertices()
            ));
        }
    }
    let TouchedSurface { triangles, surface, held, open } = touched;
    let compliance = rest_compliance(solver.model(), &surface, named, radius_m, cancelled);
    let compliance_prior = compliance_prior(&surface, &compliance);
    go_on("the search for the stiffness at rest")?;
    let nodes = choose(&points, &surface, &held, &open, &compliance_prior, path, &mut notes)?;
    let dragged = spread_among(&surface, &open, &nodes, drags, Some(&compliance_prior))?;
    let points = nodes.into_iter().map(|node| TestPoint {
        node,
        plan: point_plan(
            simulation,
            surface.positions()[node as usize],
            surface.inward_normals()[node as usize],
            dragged.binary_search(&node).is_ok(),
        ),
    });
    let points = points.collect();
    let rounds = match simulation.test_points {
        TestPoints::Adaptive { tolerance_percent, most } => {
            let most = (most as usize).min(one_for_each_vertex(&surface, &open).len());
            let (guide, compliance) = (compliance_prior.clone(), compliance.clone());
            Some(rounds(simulation.clone(), surface, open, guide, compliance, tolerance_percent, most))
        }
        _ => None,
    };
    let index: HashMap<u32, u32> = boundary.nodes.iter().zip(0..).map(|(n, i)| (*n, i)).collect();
    let scene = Scene {
        surface: triangles,
        guide_n_per_m: compliance_prior,
        compliance_m_per_n: compliance,
        boundary_m: boundary.nodes.iter().map(|n| solver.model().mesh().positions[*n as usize]).collect(),
        faces: boundary.faces.iter().map(|face| face.map(|n| index[&n])).collect(),
        notes,
    };
    Ok(Prepared { scene, points, solver, rounds })
}

/// Test points added where those so far predict each other worst; only pressed at.
fn rounds(
    simulation: Simulation,
    surface: Surface,
    touchable: Vec<bool>,
    guide: Vec<f64>,
    compliance: Vec<DMat3>,
    tolerance_percent: f64,
    most: usize,
) -> Rounds {
    let next = move |points: &BTreeMap<u32, Point>| {
        let options = assemble::coupled_options(&simulation, &guide, &compliance);
        let records = assemble::records(points);
        let nodes = further_points(&surface, &touchable, &records, &options, tolerance_percent, most)?;
        let point = |node: u32| {
            let (at, inward) = (surface.positions()[node as usize], surface.inward_normals()[node as usize]);
            TestPoint { node, plan: point_plan(&simulation, at, inward, false) }
        };
        Ok(nodes.into_iter().map(point).collect())
    };
    Rounds { most, next: Box::new(next) }
}

fn bits(p: DVec3) -> [u64; 3] {
    p.to_array().map(f64::to_bits)
}

/// Puts the boundary's nodes that lie on the touched surface's facets onto the smooth surface, which the body is refined to: of a
/// volume mesh the nodes in the middle of edges. What is held stays, and what an element would be spoiled by. Shapes need none of it:
/// their elements are round already.
fn smooth_boundary(
    mesh: &mut TetMesh,
    boundary: &Boundary,
    triangles: &TriangleMesh,
    surface: &Surface,
    fixed: &BTreeMap<u32, [bool; 3]>,
) -> Option<String> {
    /// In edges: farther from a facet a node is where somebody put it.
    const ON_FACET: f64 = 1e-4;
    let search = MeshSearch::new(triangles);
    let edge = |face: &[u32; 6]| {
        let [a, b] = [0, 1].map(|i| mesh.positions[face[i] as usize]);
        a.distance(b)
    };
    let edge = boundary.faces.iter().map(edge).sum::<f64>() / boundary.faces.len().max(1) as f64;
    let on_facets = boundary.nodes.iter().filter(|n| !fixed.contains_key(n)).filter_map(|&n| {
        let p = mesh.positions[n as usize];
        let (at, flat) = search.nearest(p, edge)?;
        (flat.distance(p) <= ON_FACET * edge).then_some((n, at))
    });
    let (nodes, at): (Vec<u32>, Vec<SurfacePoint>) = on_facets.unzip();
    let moved = |(n, to): &(u32, DVec3)| to.distance(mesh.positions[*n as usize]) > 1e-6 * edge;
    let targets: BTreeMap<u32, DVec3> =
        nodes.into_iter().zip(surface.smooth_points(&at)).filter(moved).collect();
    let asked = targets.len();
    let farthest = targets.iter().map(|(n, to)| to.distance(mesh.positions[*n as usize])).fold(0.0, f64::max);
    let stay = mesh.move_nodes(targets);
    (asked > stay).then(|| {
        format!(
            "{} nodes of the boundary are on the smooth surface, {:.3} mm off the facets at most{}",
            asked - stay,
            farthest * 1e3,
            if stay > 0 { format!("; {stay} stay, for the elements' sake") } else { String::new() }
        )
    })
}

/// Gives each element the index of its material.
fn regions(simulation: &Simulation, mut mesh: TetMesh) -> Result<(TetMesh, Vec<material::Material>)> {
    let mut materials = vec![made_of(&simulation.material)?];
    let mut regions = vec![0; mesh.elements.len()];
    for region in &simulation.regions {
        let (place, index) = (&region.place, materials.len() as u32);
        let mut count = 0;
        let named = match &region.selection {
            Selection::Group(name) => {
                let found = mesh.region_names.iter().position(|n| n == name);
                Some(found.ok_or_else(|| {
                    anyhow!("{}; a region's group is one of volumes", no_group(place, name, &mesh))
                })?)
            }
            _ => None,
        };
        for (e, element) in mesh.elements.iter().enumerate() {
            let within = match &region.selection {
                Selection::Place(region) => {
                    let sum: DVec3 = element[..4].iter().map(|n| mesh.positions[*n as usize]).sum();
                    region.contains(sum / 4.0, 0.0)
                }
                _ => named.is_some_and(|r| mesh.regions[e] as usize == r),
            };
            if within {
                regions[e] = index;
                count += 1;
            }
        }
        if count == 0 {
            let (low, high) = extent(mesh.positions.iter());
            bail!(
                "{place}: no element's middle lies in this region; the mesh reaches from {low} to {high} mm: move the \
                 region, enlarge it, or make elements smaller there"
            );
        }
        materials.push(made_of(&region.material)?);
    }
    mesh.regions = regions;
    mesh.region_names = (0..materials.len()).map(|i| i.to_string()).collect();
    Ok((mesh, materials))
}

/// The solver's material.
fn made_of(given: &Material) -> Result<material::Material> {
    use material::Material as M;
    let bulk = match given.volume {
        Volume::BulkModulus(k) => Bulk::ModulusPa(k),
        Volume::PoissonRatio(nu) => Bulk::PoissonRatio(nu),
    };
    let nu = |e: f64| match given.volume {
        Volume::PoissonRatio(nu) => nu,
        Volume::BulkModulus(k) => (3.0 * k - e) / (6.0 * k),
    };
    let made = match &given.law {
        MaterialLaw::NeoHookean { young_modulus_pa: e } => M::neo_hookean(*e, nu(*e)),
        MaterialLaw::NeoHookeanIsochoric { young_modulus_pa: e } => M::isochoric_neo_hookean(*e, nu(*e)),
        MaterialLaw::StVenantKirchhoff { young_modulus_pa: e } => M::st_venant_kirchhoff(*e, nu(*e)),
        MaterialLaw::Linear { young_modulus_pa: e } => M::linear(*e, nu(*e)),
        MaterialLaw::MooneyRivlin { c10_pa, c01_pa } => M::mooney_rivlin(*c10_pa, *c01_pa, bulk),
        MaterialLaw::Ogden { terms } => M::ogden(terms.clone(), bulk),
        MaterialLaw::Yeoh { c_pa } => M::yeoh(c_pa.clone(), bulk),
        MaterialLaw::FungDemiray { mu_pa, b } => M::fung_demiray(*mu_pa, *b, bulk),
        MaterialLaw::VerondaWestmann { c1_pa, c3 } => M::veronda_westmann(*c1_pa, *c3, bulk),
    };
    Ok(made?)
}

/// The load paths at a point: a press and, if it is to be dragged, drags.
pub fn point_plan(simulation: &Simulation, point: DVec3, inward: DVec3, dragged: bool) -> PointPlan {
    let (first, second) = tangents(inward);
    let count = simulation.directions;
    let direction = |i: u32| {
        let turn = std::f64::consts::TAU * f64::from(i) / f64::from(count);
        let (sin, cos) = (libm::sin(turn), libm::cos(turn));
        (first * cos + second * sin).reject_from_normalized(inward).normalize()
    };
    let end = simulation.deflection.lateral_max_m;
    // Drags are straighter than presses, and there are four of them and more.
    let steps = simulation.deflection.steps.div_ceil(3).max(4);
    let distances: Vec<f64> = (1..=steps).map(|i| end * f64::from(i) / f64::from(steps)).collect();
    let drag = |&from: &usize| {
        let distances = distances.clone();
        (0..count).map(move |i| Drag { from, direction: direction(i), distances: distances.clone() })
    };
    PointPlan {
        point,
        inward,
        depths: simulation.depths_m.clone(),
        drags: simulation.drag_from.iter().filter(|_| dragged).flat_map(drag).collect(),
    }
}

/// The parts of a box's height at which one material ends and another begins, where elements should end as well.
pub fn layers(simulation: &Simulation, low: f64, high: f64) -> Vec<f64> {
    let mut planes: Vec<f64> = simulation
        .regions
        .iter()
        .filter_map(|region| match region.selection {
            Selection::Place(Place::Box { low, high }) => Some([low.z, high.z]),
            _ => None,
        })
        .flatten()
        .filter(|z| *z > low + 1e-9 && *z < high - 1e-9)
        .collect();
    planes.sort_by(f64::total_cmp);
    planes.dedup_by(|b, a| *b - *a < 1e-9);
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_body::shape::Shape;
    use palpate_simulate::mesh::shape::fill;
    use palpate_simulate::mesh::stuffing::FillOptions;

    #[test]
    fn middles_of_a_volume_meshs_edges_are_put_on_the_smooth_surface() {
        let radius = 30e-3;
        let options = FillOptions { curved: false, volume_tolerance: 0.2, ..FillOptions::new(8e-3) };
        let (mut mesh, _) = fill(&Shape::Sphere { radius_mm: 30.0 }, &options).unwrap();
        let boundary = mesh.boundary();
        let triangles = volume::corners(&mesh, &boundary);
        let surface = Surface::build(&triangles, f64::INFINITY).unwrap();
        let middle = |face: &[u32; 6]| [face[3], face[4], face[5]];
        let fixed: BTreeMap<u32, [bool; 3]> = boundary
            .faces
            .iter()
            .flat_map(middle)
            .filter(|&n| mesh.positions[n as usize].z < -20e-3)
            .map(|n| (n, [true; 3]))
            .collect();
        let before = mesh.positions.clone();
        let off = |mesh: &TetMesh| {
            let free = boundary.faces.iter().flat_map(middle).filter(|n| !fixed.contains_key(n));
            free.map(|n| (mesh.positions[n as usize].length() - radius).abs()).fold(0.0, f64::max)
        };
        let flat = off(&mesh);
        let note = smooth_boundary(&mut mesh, &boundary, &triangles, &surface, &fixed).unwrap();
        assert!(note.contains("on the smooth surface") && !note.contains("stay"), "{note}");
        // Normals of an uneven mesh are off by some degrees: a tenth of the sagitta is left.
        assert!(flat > 2e-4 && off(&mesh) < 0.15 * flat, "{flat} {}", off(&mesh));
        let corners: Vec<u32> = mesh.elements.iter().flat_map(|e| e[..4].to_vec()).collect();
        for n in corners.iter().chain(fixed.keys()) {
            assert_eq!(mesh.positions[*n as usize], before[*n as usize]);
        }
        // Once there, they stay.
        let there = mesh.positions.clone();
        smooth_boundary(&mut mesh, &boundary, &triangles, &surface, &fixed);
        assert_eq!(mesh.positions, there);
    }
}
