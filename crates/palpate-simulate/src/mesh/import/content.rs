//! What the readers fill, and what becomes of it.

use super::Imported;
use crate::error::{Result, SimulateError};
use crate::mesh::{EDGES, TetMesh};
use glam::DVec3;
use palpate_body::TriangleMesh;
use palpate_body::import::LengthUnit;
use palpate_body::import::cursor::short;
use std::collections::{BTreeMap, HashMap};

/// Coordinates beyond this are a wrong unit, m.
const MAX_COORDINATE_M: f64 = 1000.0;

/// Nodes and elements are numbered with 32 bits; a linear mesh has some 1.4 edges to each element.
const MAX_TETRAHEDRA: usize = 1 << 28;

/// The number of a region that has none. It sorts first.
pub(super) const NO_REGION: f64 = f64::NEG_INFINITY;

/// What a file says, in its unit.
#[derive(Default)]
pub(super) struct Content {
    pub positions: Vec<DVec3>,
    /// With straight edges.
    pub linear: Vec<[u32; 4]>,
    /// In the order of [`TetMesh`].
    pub quadratic: Vec<[u32; 10]>,
    /// Each tetrahedron's region by number.
    pub regions: Vec<f64>,
    /// Of physical groups, by dimension and number.
    pub names: BTreeMap<(u8, u64), String>,
    /// Cells of lower dimension, by name, as their edges; a point is an edge from itself to itself.
    pub groups: BTreeMap<String, Vec<[u32; 2]>>,
    /// Nodes on the boundary that bear a mark, by name.
    pub marks: BTreeMap<String, Vec<u32>>,
    pub triangles: Vec<[u32; 3]>,
}

impl Content {
    /// Adds a node; `place` says where it was read.
    pub fn node(&mut self, p: [f64; 3], place: impl Fn() -> String) -> Result<()> {
        if let Some(x) = p.iter().find(|x| !x.is_finite()) {
            let problem = format!("a coordinate is {x}, not a finite number");
            return Err(SimulateError::invalid(
                place(),
                problem,
                "correct the coordinate, or export the mesh again",
            ));
        }
        if self.positions.len() >= u32::MAX as usize / 2 {
            return Err(SimulateError::invalid(place(), "more than two billion nodes", "mesh it coarser"));
        }
        self.positions.push(DVec3::from_array(p));
        Ok(())
    }

    /// Adds a tetrahedron of 4 or 10 nodes in this module's order, in the region of a number.
    pub fn tetrahedron(&mut self, nodes: &[u32], region: f64, place: impl Fn() -> String) -> Result<()> {
        for (i, node) in nodes.iter().enumerate() {
            if nodes[..i].contains(node) {
                let problem = "a tetrahedron has one node twice";
                return Err(SimulateError::invalid(
                    place(),
                    problem,
                    "remove the element, or export the mesh again",
                ));
            }
        }
        match *nodes {
            [a, b, c, d] => self.linear.push([a, b, c, d]),
            _ => self.quadratic.push(std::array::from_fn(|i| nodes[i])),
        }
        if !self.linear.is_empty() && !self.quadratic.is_empty() {
            let problem = "tetrahedra with 4 nodes and with 10 are mixed";
            return Err(SimulateError::invalid(
                place(),
                problem,
                "mesh all of it with one order (Gmsh: SetOrder 2)",
            ));
        }
        self.regions.push(region);
        if self.regions.len() > MAX_TETRAHEDRA {
            return Err(SimulateError::invalid(
                place(),
                "more than 268 million tetrahedra",
                "mesh it coarser",
            ));
        }
        Ok(())
    }

    /// Adds a point, line or polygon to a group, by its corners.
    pub fn cell(&mut self, group: &str, corners: &[u32]) {
        if !self.groups.contains_key(group) {
            self.groups.insert(group.into(), Vec::new());
        }
        let Some(edges) = self.groups.get_mut(group) else { return };
        for (i, &a) in corners.iter().enumerate() {
            edges.push([a, corners[(i + 1) % corners.len()]]);
        }
    }

    /// The name of a physical group: its own or its number.
    pub fn name(&self, dimension: u8, number: f64) -> String {
        let named = self.names.get(&(dimension, number as u64)).filter(|n| !n.is_empty());
        named.cloned().unwrap_or_else(|| short(number))
    }

    /// A volume if there is any tetrahedron, else a surface.
    pub fn build(self, unit: LengthUnit) -> Result<Imported> {
        if !self.regions.is_empty() {
            return self.volume(unit).map(Imported::Volume);
        }
        if self.triangles.is_empty() {
            let problem = "there is neither a tetrahedron nor a triangle in it";
            return Err(SimulateError::invalid(
                "mesh",
                problem,
                "mesh it first (gmsh -3), and save all elements",
            ));
        }
        let positions = self.positions.into_iter().map(|p| p / unit.per_metre()).collect();
        Ok(Imported::Surface(TriangleMesh { positions, triangles: self.triangles }))
    }

    pub fn volume(mut self, unit: LengthUnit) -> Result<TetMesh> {
        if self.regions.is_empty() {
            return Err(super::no_solid());
        }
        let number = self.drop_unused();
        for (node, p) in self.positions.iter_mut().enumerate() {
            *p /= unit.per_metre();
            if p.abs().max_element() > MAX_COORDINATE_M {
                let far = short(p.abs().max_element());
                let problem = format!("a coordinate is {far} m, beyond {MAX_COORDINATE_M} m");
                return Err(SimulateError::invalid(
                    format!("node {node} (from 0)"),
                    problem,
                    "check the mesh's unit",
                ));
            }
        }
        let (region_names, regions) = self.regions();
        let mut mesh = if self.quadratic.is_empty() {
            TetMesh::from_corners(self.positions, &self.linear)
        } else {
            let mut elements = self.quadratic;
            turn_back(&self.positions, &mut elements)?;
            TetMesh { positions: self.positions, elements, ..TetMesh::default() }
        };
        (mesh.region_names, mesh.regions) = (region_names, regions);
        mesh.groups = groups(&mesh, &self.groups, &self.marks, &number);
        Ok(mesh)
    }

    /// Renumbers so that only nodes of tetrahedra are left; gives each old node's new number, if any.
    fn drop_unused(&mut self) -> Vec<Option<u32>> {
        let mut used = vec![false; self.positions.len()];
        let nodes = self.linear.iter().flatten().chain(self.quadratic.iter().flatten());
        nodes.for_each(|&n| used[n as usize] = true);
        let mut next = 0;
        let number: Vec<Option<u32>> = used
            .iter()
            .map(|&used| {
                next += u32::from(used);
                used.then(|| next - 1)
            })
            .collect();
        if next as usize == used.len() {
            return number;
        }
        let mut kept = used.iter();
        self.positions.retain(|_| *kept.next().unwrap_or(&true));
        for n in self.linear.iter_mut().flatten().chain(self.quadratic.iter_mut().flatten()) {
            *n = number[*n as usize].unwrap_or_default();
        }
        number
    }

    /// The regions' names in the order of their numbers, and each tetrahedron's index into them.
    fn regions(&self) -> (Vec<String>, Vec<u32>) {
        let mut numbers = self.regions.clone();
        numbers.sort_unstable_by(f64::total_cmp);
        numbers.dedup();
        let mut names: Vec<String> = Vec::new();
        let index: Vec<u32> = numbers
            .iter()
            .map(|&number| {
                let name = if number == NO_REGION { String::new() } else { self.name(3, number) };
                // Two numbers may share a name.
                names.iter().position(|n| *n == name).unwrap_or_else(|| {
                    names.push(name);
                    names.len() - 1
                }) as u32
            })
            .collect();
        let find = |r: &f64| index[numbers.partition_point(|n| n.total_cmp(r).is_lt())];
        let regions = self.regions.iter().map(find).collect();
        (names, regions)
    }
}

/// The nodes of each group: corners, and the nodes on edges between them.
fn groups(
    mesh: &TetMesh,
    cells: &BTreeMap<String, Vec<[u32; 2]>>,
    marks: &BTreeMap<String, Vec<u32>>,
    number: &[Option<u32>],
) -> BTreeMap<String, Vec<u32>> {
    let key = |a: u32, b: u32| [a.min(b), a.max(b)];
    let renumbered = |[a, b]: &[u32; 2]| Some((number[*a as usize]?, number[*b as usize]?));
    let mut middles: HashMap<[u32; 2], Option<u32>> = HashMap::new();
    let mut ends = vec![false; mesh.positions.len()];
    for (a, b) in cells.values().flatten().filter_map(renumbered) {
        middles.insert(key(a, b), None);
        ends[a as usize] = true;
        ends[b as usize] = true;
    }
    for element in &mesh.elements {
        for (i, [a, b]) in EDGES.iter().enumerate() {
            let (a, b) = (element[*a], element[*b]);
            if ends[a as usize]
                && ends[b as usize]
                && let Some(middle) = middles.get_mut(&key(a, b))
            {
                *middle = Some(element[4 + i]);
            }
        }
    }
    let mut groups: BTreeMap<String, Vec<u32>> = BTreeMap::new();
    for (name, edges) in cells {
        let nodes = groups.entry(name.clone()).or_default();
        for edge in edges {
            // One end may be left where the other was dropped.
            nodes.extend(edge.iter().filter_map(|&n| number[n as usize]));
            nodes.extend(renumbered(edge).and_then(|(a, b)| middles[&key(a, b)]));
        }
    }
    if !marks.is_empty() {
        let faces = mesh.boundary().faces;
        let mut marked = vec![false; mesh.positions.len()];
        for (name, nodes) in marks {
            let nodes: Vec<u32> = nodes.iter().filter_map(|&n| number[n as usize]).collect();
            nodes.iter().for_each(|&n| marked[n as usize] = true);
            let on_faces =
                faces.iter().filter(|f| f[..3].iter().all(|&n| marked[n as usize])).flatten().copied();
            let group = groups.entry(name.clone()).or_default();
            group.extend(on_faces);
            group.extend(&nodes);
            nodes.iter().for_each(|&n| marked[n as usize] = false);
        }
    }
    for (region, name) in mesh.region_names.iter().enumerate().filter(|(_, n)| !n.is_empty()) {
        if !groups.contains_key(name) {
            let inside = mesh.elements.iter().zip(&mesh.regions).filter(|(_, r)| **r == region as u32);
            groups.insert(name.clone(), inside.flat_map(|(e, _)| *e).collect());
        }
    }
    for nodes in groups.values_mut() {
        nodes.sort_unstable();
        nodes.dedup();
    }
    // A group of which no node is left holds nothing, and would only look as if it did.
    groups.retain(|_, nodes| !nodes.is_empty());
    groups
}

/// Turns quadratic elements back if the file has them all inverted.
fn turn_back(positions: &[DVec3], elements: &mut [[u32; 10]]) -> Result<()> {
    let volume = |e: &[u32; 10]| {
        let [a, b, c, d] = std::array::from_fn(|i| positions[e[i] as usize]);
        (b - a).cross(c - a).dot(d - a)
    };
    let inside_out = elements.iter().filter(|e| volume(e) < 0.0).count();
    if inside_out == elements.len() {
        for e in elements {
            // Corners 2 and 3 change places, and the edges at them: 12 with 13, 20 with 03.
            e.swap(2, 3);
            e.swap(5, 8);
            e.swap(6, 7);
        }
    } else if let Some(e) = elements.iter().position(|e| volume(e) < 0.0) {
        let p = positions[elements[e][0] as usize] * 1e3;
        return Err(SimulateError::invalid(
            format!("element {e} (from 0) at ({:.3}, {:.3}, {:.3}) mm", p.x, p.y, p.z),
            format!("it is inverted, as are {inside_out} of {}", elements.len()),
            "mesh it again, or make it linear (Gmsh: SetOrder 1)",
        ));
    }
    Ok(())
}
