//! Tetrahedra with ten nodes, in which all is computed.

pub mod check;
mod curved;
pub mod distance;
pub mod import;
mod octree;
pub mod shape;
pub mod stuffing;

use glam::DVec3;
use std::collections::{BTreeMap, HashMap};

/// A volume mesh of quadratic tetrahedra.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TetMesh {
    /// Nodes at rest, m.
    pub positions: Vec<DVec3>,
    /// Four corners, positively oriented ((p1 − p0) × (p2 − p0) · (p3 − p0) > 0), then the nodes on the edges 01, 12,
    /// 20, 03, 13, 23 (the order of VTK and Abaqus).
    pub elements: Vec<[u32; 10]>,
    /// Each element's region, an index into `region_names`.
    pub regions: Vec<u32>,
    /// What the regions are called; one without a name is `""`.
    pub region_names: Vec<String>,
    /// Nodes of each named group (of points, lines, surfaces or volumes), ascending.
    pub groups: BTreeMap<String, Vec<u32>>,
}

/// The corners that each of the six nodes on edges lies between.
pub const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];

/// Corners of each face, seen from outside counter-clockwise; face f lies opposite corner f.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// The surface of a volume mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Boundary {
    /// Three corners, counter-clockwise from outside, then the nodes on the edges 01, 12, 20.
    pub faces: Vec<[u32; 6]>,
    /// The element behind each face.
    pub elements: Vec<u32>,
    /// The nodes on the faces, ascending.
    pub nodes: Vec<u32>,
}

impl TetMesh {
    /// Tetrahedra with straight edges, all of one region: nodes on edges are put at their middles, after the corners.
    /// Tetrahedra that are inverted are turned back.
    pub fn from_corners(mut positions: Vec<DVec3>, tetrahedra: &[[u32; 4]]) -> Self {
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut elements = Vec::with_capacity(tetrahedra.len());
        for tetrahedron in tetrahedra {
            let mut corners = *tetrahedron;
            let p = corners.map(|n| positions[n as usize]);
            if (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) < 0.0 {
                corners.swap(2, 3);
            }
            let mut element = [0; 10];
            element[..4].copy_from_slice(&corners);
            for (i, [a, b]) in EDGES.iter().enumerate() {
                let (a, b) = (corners[*a], corners[*b]);
                element[4 + i] = *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    positions.push((positions[a as usize] + positions[b as usize]) / 2.0);
                    positions.len() as u32 - 1
                });
            }
            elements.push(element);
        }
        let regions = vec![0; elements.len()];
        TetMesh { positions, elements, regions, region_names: vec![String::new()], groups: BTreeMap::new() }
    }

    /// The faces that belong to one element only.
    pub fn boundary(&self) -> Boundary {
        let mut count: HashMap<[u32; 3], u32> = HashMap::new();
        let key = |element: &[u32; 10], face: [usize; 3]| {
            let mut key = face.map(|c| element[c]);
            key.sort_unstable();
            key
        };
        for element in &self.elements {
            for face in FACES {
                *count.entry(key(element, face)).or_default() += 1;
            }
        }
        let mut boundary = Boundary::default();
        for (e, element) in self.elements.iter().enumerate() {
            for face in FACES.into_iter().filter(|&face| count[&key(element, face)] == 1) {
                let middle = |a: usize, b: usize| {
                    let edge = EDGES.iter().position(|&[p, q]| [p, q] == [a, b] || [q, p] == [a, b]);
                    element[4 + edge.expect("a tetrahedron's corners are all joined")]
                };
                let [a, b, c] = face;
                let nodes = [element[a], element[b], element[c], middle(a, b), middle(b, c), middle(c, a)];
                boundary.faces.push(nodes);
                boundary.elements.push(e as u32);
                boundary.nodes.extend(nodes);
            }
        }
        boundary.nodes.sort_unstable();
        boundary.nodes.dedup();
        boundary
    }
}
