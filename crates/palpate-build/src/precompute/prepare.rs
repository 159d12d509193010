//! From a spec to what a run needs: surface, volume mesh, supports, materials, test points. Cheap checks come first.

use super::elements::Elements;
use super::run::{Prepared, Rounds};
use super::{assemble, volume};
use crate::paths_file::{PathsPlan, Point, Scene, TestPoint};
use crate::spec::{
    COUNT, Fixed, Geometry, Material, MaterialLaw, Place, Selection, Simulation, Spec, TestPoints, ToolShape,
    Volume,
};
use anyhow::{Result, anyhow, bail};
use glam::{DMat3, DVec3};
use palpate_body::{MeshSearch, Surface, SurfacePoint, TriangleMesh};
use palpate_files as files;
use palpate_files::Table;
use palpate_identify::{Amount, further_points, spread_among, test_points, touchable};
use palpate_simulate::material::{self, Bulk};
use palpate_simulate::mesh::Boundary;
use palpate_simulate::mesh::check::check;
use palpate_simulate::path::tangents;
use palpate_simulate::{Drag, Model, PointPlan, TetMesh};
use rayon::prelude::*;
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
    let margin_m = margin(simulation)?;
    let mut ground = Ground { triangles, open: touchable(&surface, &held, margin_m)?, surface, held };
    if let TestPoints::Count(count) | TestPoints::Adaptive { most: count, .. } = points {
        let before = ground.vertices();
        let hold = |surface: &Surface, held: &mut [bool]| {
            simulation.fixed.iter().try_for_each(|support| hold_surface(support, surface, tolerance_m, held))
        };
        while ground.vertices() < count as usize && ground.edge_m() > NEEDLESS * radius_m {
            ground = ground.divided(spec, path, margin_m, hold)?;
        }
        if ground.vertices() > before {
            notes.push(format!(
                "there are more test points than nodes that can be touched: triangles are divided by their edges' middles, {before} nodes become {}",
                ground.vertices()
            ));
        }
    }
    let Ground { triangles, surface, held, open } = ground;
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

/// So few test points, named by the spec, need no compliance prior between them.
const UNGUIDED: usize = 3;

/// Places at which the stiffness at rest is found; between them it is interpolated.
const GUIDED: usize = 600;

/// The body's compliance at rest under a patch as wide as the tool, m/N in its axes, at each of the surface's nodes: what its
/// responses go with from place to place, and known everywhere for one substitution each. None for few named test points.
///
/// Of no use once `cancelled` is true.
fn rest_compliance(
    model: &Model,
    surface: &Surface,
    points: usize,
    radius_m: f64,
    cancelled: &AtomicBool,
) -> Vec<DMat3> {
    let positions = surface.positions();
    if points <= UNGUIDED {
        return Vec::new();
    }
    let (places, of) = sparse(positions, surface.inward_normals());
    let at = |&n: &u32| {
        let n = n as usize;
        if cancelled.load(Relaxed) {
            return DMat3::IDENTITY;
        }
        model.compliance_at(positions[n], surface.inward_normals()[n], radius_m)
    };
    let found: Vec<DMat3> = places.par_iter().map(at).collect();
    let mean = |shares: &Vec<(u32, f64)>| {
        let parts = shares.iter().map(|(place, share)| found[*place as usize] * *share);
        parts.fold(DMat3::ZERO, |sum, part| sum + part)
    };
    of.iter().map(mean).collect()
}

/// The stiffness at rest along each node's normal, N/m; 1 where no compliance is known.
fn compliance_prior(surface: &Surface, compliance: &[DMat3]) -> Vec<f64> {
    if compliance.is_empty() {
        return vec![1.0; surface.positions().len()];
    }
    let along = compliance.iter().zip(surface.inward_normals()).map(|(s, u)| u.dot(*s * *u));
    let mut found: Vec<f64> = along.map(|s| if s > 0.0 { 1.0 / s } else { f64::INFINITY }).collect();
    // What supports carry alone is no stiffer than a hundred times the usual.
    let mut sorted: Vec<f64> = found.iter().copied().filter(|k| k.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let most = sorted.get(sorted.len() / 4).map_or(1.0, |k| 100.0 * k);
    found.iter_mut().for_each(|k| *k = k.min(most));
    found
}

/// At most [`GUIDED`] nodes spread over the surface, and for each node the shares of those around it.
fn sparse(positions: &[DVec3], normals: &[DVec3]) -> (Vec<u32>, Vec<Vec<(u32, f64)>>) {
    let all = positions.len();
    if all <= GUIDED {
        return ((0..all as u32).collect(), (0..all as u32).map(|n| vec![(n, 1.0)]).collect());
    }
    let low = positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = positions.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    let mut cell = (high - low).length() / (GUIDED as f64).sqrt();
    let key = |p: DVec3, cell: f64| ((p - low) / cell).floor().to_array().map(|c| c as i64);
    let places = loop {
        // The first node of each cell.
        let mut cells: BTreeMap<[i64; 3], u32> = BTreeMap::new();
        for (n, p) in positions.iter().enumerate() {
            cells.entry(key(*p, cell)).or_insert(n as u32);
        }
        if cells.len() <= GUIDED {
            break cells;
        }
        cell *= 1.1;
    };
    let listed: Vec<u32> = places.values().copied().collect();
    let index: HashMap<[i64; 3], u32> = places.keys().copied().zip(0..).collect();
    let shares = positions.iter().zip(normals).map(|(p, normal)| {
        let [x, y, z] = key(*p, cell);
        let mut near: Vec<(u32, f64)> = Vec::new();
        for (dx, dy, dz) in
            (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| (x, y, z))))
        {
            let Some(&place) = index.get(&[x + dx, y + dy, z + dz]) else { continue };
            let other = listed[place as usize] as usize;
            // Not what lies on the other side of a thin part.
            if normals[other].dot(*normal) > 0.0 {
                near.push((place, 1.0 / (p.distance_squared(positions[other]) + 1e-3 * cell * cell)));
            }
        }
        if near.is_empty() {
            near.push((index[&[x, y, z]], 1.0));
        }
        let total: f64 = near.iter().map(|(_, w)| w).sum();
        near.iter_mut().for_each(|(_, w)| *w /= total);
        near
    });
    let shares = shares.collect();
    (listed, shares)
}

fn bits(p: DVec3) -> [u64; 3] {
    p.to_array().map(f64::to_bits)
}

/// A mesh's nodes that a support holds.
fn held_nodes(support: &Fixed, mesh: &TetMesh, tolerance_m: f64) -> Result<Vec<u32>> {
    let place = &support.place;
    let nodes: Vec<u32> = match &support.selection {
        Selection::Place(region) => (0..mesh.positions.len() as u32)
            .filter(|n| region.contains(mesh.positions[*n as usize], tolerance_m))
            .collect(),
        Selection::Group(name) => {
            mesh.groups.get(name).cloned().ok_or_else(|| no_group(place, name, mesh))?
        }
        Selection::Nodes(file) => listed(file)?
            .iter()
            .map(|p| nearest(p.at, mesh.positions.iter().copied(), tolerance_m).ok_or_else(|| p.far()))
            .collect::<Result<_>>()?,
    };
    if nodes.is_empty() {
        let (low, high) = extent(mesh.positions.iter());
        bail!(
            "{place}: it holds no node of the mesh; the mesh reaches from {low} to {high} mm: move it there"
        );
    }
    Ok(nodes)
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

/// In parts of the tool's radius: test points nearer to each other than that are told the same.
const NEEDLESS: f64 = 0.3;

/// What is touched.
struct Ground {
    triangles: TriangleMesh,
    surface: Surface,
    /// The nodes that are.
    held: Vec<bool>,
    /// Those that the tool can come to.
    open: Vec<bool>,
}

impl Ground {
    /// That can be touched.
    fn vertices(&self) -> usize {
        one_for_each_vertex(&self.surface, &self.open).len()
    }

    /// The mean edge of triangles that can be touched, m; 0 if there are none.
    fn edge_m(&self) -> f64 {
        let open = self.triangles.triangles.iter().filter(|t| t.iter().all(|&n| self.open[n as usize]));
        let at = |n: u32| self.triangles.positions[n as usize];
        let lengths =
            open.map(|&[a, b, c]| at(a).distance(at(b)) + at(b).distance(at(c)) + at(c).distance(at(a)));
        let (sum, count) = lengths.fold((0.0, 0.0f64), |(sum, count), length| (sum + length, count + 3.0));
        sum / count.max(1.0)
    }

    /// Each triangle as four, with nodes in the middles of edges on the smooth surface after the others. Those are held that lie between two
    /// that are, or where a support is.
    fn divided(
        self,
        spec: &Spec,
        path: &Path,
        margin_m: f64,
        hold: impl Fn(&Surface, &mut [bool]) -> Result<()>,
    ) -> Result<Self> {
        let Ground { triangles: TriangleMesh { mut positions, triangles }, surface, mut held, .. } = self;
        // A vertex's first node has its number.
        held.truncate(positions.len());
        let (mut middles, mut at) = (HashMap::new(), Vec::new());
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for (element, [a, b, c]) in (0..).zip(triangles) {
            let edges = [([b, c], [0.0, 0.5, 0.5]), ([c, a], [0.5, 0.0, 0.5]), ([a, b], [0.5, 0.5, 0.0])];
            let [bc, ca, ab] = edges.map(|([p, q], n)| {
                *middles.entry([p.min(q), p.max(q)]).or_insert_with(|| {
                    at.push(SurfacePoint { element, n });
                    held.push(held[p as usize] && held[q as usize]);
                    held.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        positions.extend(surface.smooth_points(&at));
        let triangles = TriangleMesh { positions, triangles: finer };
        let surface = assemble::surface(spec, &triangles).map_err(|e| e.in_file(path))?;
        let mut held: Vec<bool> = surface.vertices().iter().map(|&v| held[v as usize]).collect();
        hold(&surface, &mut held)?;
        let open = touchable(&surface, &held, margin_m)?;
        Ok(Ground { triangles, surface, held, open })
    }
}

/// Marks the nodes of a surface of its own that a support holds.
fn hold_surface(support: &Fixed, surface: &Surface, tolerance_m: f64, held: &mut [bool]) -> Result<()> {
    match &support.selection {
        Selection::Place(region) => {
            for (held, p) in held.iter_mut().zip(surface.positions()) {
                *held |= region.contains(*p, tolerance_m);
            }
        }
        // Surfaces have no groups.
        Selection::Group(_) => {}
        Selection::Nodes(file) => {
            for p in listed(file)? {
                if let Some(n) = nearest(p.at, surface.positions().iter().copied(), tolerance_m) {
                    held[n as usize] = true;
                }
            }
        }
    }
    Ok(())
}

fn no_group(place: &str, name: &str, mesh: &TetMesh) -> anyhow::Error {
    let mut names: Vec<&str> = mesh.groups.keys().map(String::as_str).collect();
    names.extend(mesh.region_names.iter().map(String::as_str).filter(|n| !n.is_empty()));
    names.sort_unstable();
    names.dedup();
    let hint = match names.len() {
        0 => "it has none: give half_space or box_mm".to_string(),
        _ => format!("it has {}", names.join(", ")),
    };
    anyhow!("{place}: the mesh has no group `{}`; {hint}", name.escape_debug())
}

/// A point in a list of nodes.
struct Listed {
    at: DVec3,
    place: String,
}

impl Listed {
    fn far(&self) -> anyhow::Error {
        let p = self.at * 1e3;
        let place = &self.place;
        anyhow!(
            "{place}: no node is at ({:.4}, {:.4}, {:.4}) mm; give nodes of this mesh, in m",
            p.x,
            p.y,
            p.z
        )
    }
}

fn listed(file: &Path) -> Result<Vec<Listed>> {
    let text = files::read_text(file)?;
    let table = Table::parse(file, &text, &["x_m", "y_m", "z_m"], &[])?;
    let row = |row: &palpate_files::Row| Listed {
        at: DVec3::new(row.values[0], row.values[1], row.values[2]),
        place: format!("{}:{}", file.display(), row.line),
    };
    Ok(table.rows.iter().map(row).collect())
}

fn nearest(at: DVec3, positions: impl Iterator<Item = DVec3>, within_m: f64) -> Option<u32> {
    let distances = positions.map(|p| p.distance_squared(at)).enumerate();
    let (n, d) = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (d <= within_m * within_m).then_some(n as u32)
}

/// Least and greatest coordinates, as text in mm.
fn extent<'a>(positions: impl Iterator<Item = &'a DVec3>) -> (String, String) {
    let (low, high) =
        positions.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
    let text = |p: DVec3| format!("({:.2}, {:.2}, {:.2})", p.x * 1e3, p.y * 1e3, p.z * 1e3);
    (text(low), text(high))
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

/// How far from what is held the tool stays, m: by its radius and the longest drag, so that it comes over nothing that
/// can't give way, in no direction.
///
/// # Errors
/// The tool's size is not known.
pub fn margin(simulation: &Simulation) -> Result<f64> {
    Ok(super::volume::tool_radius(simulation)? + simulation.deflection.lateral_max_m)
}

/// The first node of each vertex that can be touched.
fn one_for_each_vertex(surface: &Surface, touchable: &[bool]) -> Vec<u32> {
    let mut free: BTreeMap<u32, u32> = BTreeMap::new();
    for (n, (&v, _)) in surface.vertices().iter().zip(touchable).enumerate().filter(|(_, (_, open))| **open) {
        free.entry(v).or_insert(n as u32);
    }
    let mut nodes: Vec<u32> = free.into_values().collect();
    nodes.sort_unstable();
    nodes
}

/// How many test points three quarters of an hour on two cores are about enough for, and how many of these are dragged, if a press takes so long (s):
/// a third of the time goes to drags, at `most` of them. Not fewer points than a decoupled law has.
fn affordable(press_s: f64, most: usize) -> [usize; 2] {
    const CORE_S: f64 = 5400.0;
    /// What the drags from a pressed point take, in presses.
    const DRAGS: f64 = 9.0;
    /// Terms of third and fourth order want to be known at a few.
    const LEAST: f64 = 8.0;
    let presses = CORE_S / press_s;
    // A float beyond all integers becomes the largest one.
    let dragged = most.min((presses / (3.0 * DRAGS)).max(LEAST) as usize);
    [(presses - DRAGS * dragged as f64).clamp(f64::from(COUNT), 1e6) as usize, dragged]
}

/// The test points' nodes, ascending; or in the spec's order, where it names them.
fn choose(
    points: &TestPoints,
    surface: &Surface,
    held: &[bool],
    touchable: &[bool],
    compliance_prior: &[f64],
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<u32>> {
    let free = one_for_each_vertex(surface, touchable);
    let amount = match points {
        TestPoints::Count(_) | TestPoints::Adaptive { .. } => {
            let count = match *points {
                TestPoints::Adaptive { most, .. } => assemble::first_round(most),
                TestPoints::Count(count) => count as usize,
                _ => 0,
            };
            if free.len() < count && !free.is_empty() {
                notes.push(format!("the surface has {} vertices to touch: each is a test point", free.len()));
            }
            Amount::Count(count.min(free.len().max(1)))
        }
        // What is affordable is a count by now.
        TestPoints::EveryNode | TestPoints::Affordable => Amount::Count(free.len().max(1)),
        TestPoints::Spacing(spacing) => Amount::Spacing(*spacing),
        TestPoints::At(points) => return named_points(points, surface, held, path, notes),
    };
    if amount == Amount::Count(free.len()) {
        return Ok(free);
    }
    test_points(surface, touchable, amount, Some(compliance_prior))
        .map_err(|e| anyhow!("{}: [test_points]: {e}", path.display()))
}

fn named_points(
    points: &[DVec3],
    surface: &Surface,
    held: &[bool],
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<u32>> {
    let (low, high) = surface
        .positions()
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
    let file = path.display();
    let mut nodes: Vec<u32> = Vec::new();
    let mut farthest: f64 = 0.0;
    for (i, p) in points.iter().enumerate() {
        let q = *p * 1e3;
        let place =
            format!("{file}: [test_points] at_mm, point {i} at ({:.2}, {:.2}, {:.2}) mm", q.x, q.y, q.z);
        let Some(node) = nearest(*p, surface.positions().iter().copied(), (high - low).length() / 10.0)
        else {
            let (low, high) = extent(surface.positions().iter());
            bail!(
                "{place}: it is far from the surface, which reaches from {low} to {high} mm; move it there"
            );
        };
        if let Some(other) = nodes.iter().position(|n| *n == node) {
            bail!("{place}: the surface's nearest node is that of point {other}; remove one of them");
        }
        if held[node as usize] {
            bail!("{place}: the surface is fixed there; move it, or the support");
        }
        farthest = farthest.max(surface.positions()[node as usize].distance(*p));
        nodes.push(node);
    }
    if farthest > 1e-6 {
        notes.push(format!(
            "test points were moved to the surface's nearest nodes, by up to {:.3} mm",
            farthest * 1e3
        ));
    }
    Ok(nodes)
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

    fn spec(text: &str) -> (Spec, Simulation) {
        let path = Path::new("ball.toml");
        let spec = Spec::parse(path, text.into()).unwrap();
        let simulation = spec.simulation(path).unwrap();
        (spec, simulation)
    }

    /// More test points than nodes lie between them, on the round surface, and nowhere on what is held.
    #[test]
    fn test_points_beyond_the_nodes_lie_between_them() {
        let text = |count: usize| {
            format!(
                "body.shape = {{ kind = \"sphere\", radius_mm = 30, edge_length_mm = 16 }}\n\
                 [[body.fixed]]\nhalf_space = {{ point_mm = [0, 0, -15], normal = [0, 0, -1] }}\n\
                 [material]\nmodel = \"neo-hookean\"\nyoung_modulus_pa = 10e3\npoisson_ratio = 0.45\n\
                 [tool]\nshape = \"sphere\"\nradius_mm = 6\n\
                 [deflection]\nnormal_max_mm = 3\nlateral_max_mm = 2\nsteps = 3\n\
                 [test_points]\ncount = {count}\n[mesh]\nelement_size_mm = 12\n"
            )
        };
        let prepared = |count: usize| {
            let (spec, simulation) = spec(&text(count));
            prepare(&spec, &simulation, Path::new("ball.toml"), &AtomicBool::new(false)).unwrap()
        };
        let (few, many) = (prepared(6), prepared(90));
        let [coarse, fine] = [&few.scene.surface, &many.scene.surface];
        assert_eq!((few.points.len(), many.points.len()), (6, 90));
        assert_eq!(fine.triangles.len(), 4 * coarse.triangles.len());
        assert_eq!(fine.positions.len(), coarse.positions.len() + coarse.triangles.len() * 3 / 2);
        assert_eq!(fine.positions[..coarse.positions.len()], coarse.positions[..]);
        assert!(
            many.scene.notes.iter().any(|n| n.contains("divided"))
                && few.scene.notes.iter().all(|n| !n.contains("divided"))
        );
        for p in &fine.positions {
            // An edge's middle is 1 mm inside.
            assert!((p.length() - 30e-3).abs() < 0.2e-3, "{p}");
        }
        let mut nodes: Vec<u32> = many.points.iter().map(|p| p.node).collect();
        nodes.sort_unstable();
        nodes.dedup();
        assert_eq!(nodes.len(), 90);
        assert!(nodes.iter().any(|&n| n as usize >= coarse.positions.len()));
        for point in &many.points {
            assert_eq!(point.plan.point, fine.positions[point.node as usize]);
            assert!(point.plan.point.z > -15e-3 + 5e-3, "{}", point.plan.point);
        }
    }

    /// Where a crease passes through a vertex it has nodes on both sides, and all of them are held or none.
    #[test]
    fn creases_and_supports_are_divided_too() {
        let (spec, _) = spec(
            "[body]\ncrease_angle_deg = 40\nshape = { kind = \"block\", size_mm = [20, 20, 20], edge_length_mm = 10 }\n\
             [[body.fixed]]\nhalf_space = { point_mm = [0, 0, -10], normal = [0, 0, -1] }\n\
             [material]\nmodel = \"neo-hookean\"\nyoung_modulus_pa = 10e3\npoisson_ratio = 0.45\n\
             [tool]\nshape = \"sphere\"\nradius_mm = 6\n[deflection]\nnormal_max_mm = 3\nlateral_max_mm = 2\nsteps = 3\n",
        );
        let triangles = match &spec.geometry {
            Some(Geometry::Shape(shape, resolution)) => shape.mesh(*resolution).unwrap(),
            _ => unreachable!(),
        };
        let surface = assemble::surface(&spec, &triangles).unwrap();
        assert!(surface.positions().len() > triangles.positions.len());
        let is_held = |p: &DVec3| p.z < -10e-3 + 1e-9;
        let held: Vec<bool> = surface.positions().iter().map(is_held).collect();
        let count = triangles.triangles.len();
        let open = touchable(&surface, &held, 1e-3).unwrap();
        let before = Ground { triangles, surface, held, open };
        let (edge, vertices) = (before.edge_m(), before.vertices());
        let after = before.divided(&spec, Path::new("block.toml"), 1e-3, |_, _| Ok(())).unwrap();
        assert_eq!(after.triangles.triangles.len(), 4 * count);
        assert!(after.vertices() > 3 * vertices, "{} {vertices}", after.vertices());
        assert!((after.edge_m() / edge - 0.5).abs() < 0.02, "{} {edge}", after.edge_m());
        assert_eq!(after.held.len(), after.surface.positions().len());
        for ((p, held), open) in after.surface.positions().iter().zip(&after.held).zip(&after.open) {
            assert_eq!(*held, is_held(p), "{p}");
            assert!(p.abs().max_element() < 10e-3 + 1e-9, "flat faces stay flat: {p}");
            assert!(*open == (p.z > -9e-3 + 1e-9) || p.z < -9e-3 + 1e-6, "{p}");
        }
    }
}
