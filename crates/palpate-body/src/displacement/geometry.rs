//! The simulated mesh's boundary: what displacement fields are given on.

use crate::error::{BodyError, Result};
use crate::search::{MeshSearch, SurfacePoint, nearest_on_triangle, point};
use crate::surface::TriangleMesh;
use glam::DVec3;

/// The boundary of a simulated mesh at rest: nodes, and faces of six of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FieldSurface {
    positions: Vec<DVec3>,
    faces: Vec<[u32; 6]>,
    /// For each node that is the middle of an edge, the edge's ends; for others twice the node itself.
    ends: Vec<[u32; 2]>,
}

/// Corners of a face's four parts: its middles divide it.
const PARTS: [[usize; 3]; 4] = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]];
/// Area coordinates of a face's six nodes.
const AT: [[f64; 3]; 6] =
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]];

impl FieldSurface {
    /// From nodes (m) and faces: three corners and the middles of the edges 01, 12, 20.
    ///
    /// # Errors
    /// No face, a node that does not exist, or one that is not finite.
    pub fn new(positions: Vec<DVec3>, faces: Vec<[u32; 6]>) -> Result<Self> {
        let bad = |problem: &str| {
            Err(BodyError::invalid("displacement fields' surface", problem, "make the body again"))
        };
        if faces.is_empty() {
            return bad("it has no faces");
        }
        if faces.iter().flatten().any(|&n| n as usize >= positions.len()) {
            return bad("a face names a node that does not exist");
        }
        if !positions.iter().all(|p| p.is_finite()) {
            return bad("a position is not finite");
        }
        let mut ends: Vec<[u32; 2]> = (0..positions.len() as u32).map(|n| [n, n]).collect();
        for [a, b, c, ab, bc, ca] in &faces {
            ends[*ab as usize] = [*a, *b];
            ends[*bc as usize] = [*b, *c];
            ends[*ca as usize] = [*c, *a];
        }
        // A corner is no middle, whatever a face of straight edges names for one.
        faces.iter().flat_map(|f| &f[..3]).for_each(|&n| ends[n as usize] = [n, n]);
        Ok(FieldSurface { positions, faces, ends })
    }

    /// Nodes at rest, m.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Faces: three corners and the middles of the edges 01, 12, 20.
    pub fn faces(&self) -> &[[u32; 6]] {
        &self.faces
    }

    /// The ends of the edge that a node is the middle of, or twice the node.
    pub(super) fn ends(&self) -> &[[u32; 2]] {
        &self.ends
    }
}

/// A point of a face: its six nodes, and how much each counts there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Binding {
    face: u32,
    shares: [f32; 6],
}

impl Binding {
    /// What a field is at this point.
    pub fn of(&self, surface: &FieldSurface, field: &[DVec3]) -> DVec3 {
        let nodes = surface.faces[self.face as usize];
        (0..6).map(|i| field[nodes[i] as usize] * f64::from(self.shares[i])).sum()
    }
}

/// The surface's facets, four for each face, and which of them touch.
#[derive(Debug, Clone)]
pub(super) struct Facets {
    corners: Vec<[u32; 3]>,
    /// Those that share a corner with each, one after another; and where each one's begin.
    around: Vec<u32>,
    first: Vec<u32>,
    /// One at each node.
    at_node: Vec<u32>,
}

impl Facets {
    pub fn new(surface: &FieldSurface) -> Self {
        let corners: Vec<[u32; 3]> =
            surface.faces.iter().flat_map(|f| PARTS.map(|part| part.map(|i| f[i]))).collect();
        let mut of_node: Vec<Vec<u32>> = vec![Vec::new(); surface.positions.len()];
        for (t, nodes) in corners.iter().enumerate() {
            nodes.iter().for_each(|&n| of_node[n as usize].push(t as u32));
        }
        let (mut around, mut first) = (Vec::new(), vec![0]);
        for (t, nodes) in corners.iter().enumerate() {
            let start = around.len();
            around.extend(nodes.iter().flat_map(|&n| &of_node[n as usize]).filter(|&&o| o != t as u32));
            around[start..].sort_unstable();
            let mut kept = start;
            for i in start..around.len() {
                if i == start || around[i] != around[kept - 1] {
                    around[kept] = around[i];
                    kept += 1;
                }
            }
            around.truncate(kept);
            first.push(around.len() as u32);
        }
        let at_node = of_node.iter().map(|t| t.first().copied().unwrap_or(u32::MAX)).collect();
        Facets { corners, around, first, at_node }
    }

    /// The nearest facet to each of these points, and what its face's nodes count there.
    pub fn bind(&self, surface: &FieldSurface, points: impl Iterator<Item = DVec3>) -> Vec<Binding> {
        let mesh = TriangleMesh { positions: surface.positions.clone(), triangles: self.corners.clone() };
        let search = MeshSearch::new(&mesh);
        let at = |p: DVec3| {
            let found = search.nearest(p, f64::INFINITY).map(|(at, _)| at);
            let SurfacePoint { element, n } =
                found.unwrap_or(SurfacePoint { element: 0, n: [1.0, 0.0, 0.0] });
            let part = PARTS[element as usize % 4];
            let l: [f64; 3] = std::array::from_fn(|j| (0..3).map(|i| n[i] * AT[part[i]][j]).sum());
            // Shape functions of the quadratic triangle.
            let corner = |i: usize| l[i] * (2.0 * l[i] - 1.0);
            let middle = |i: usize, j: usize| 4.0 * l[i] * l[j];
            let shares = [corner(0), corner(1), corner(2), middle(0, 1), middle(1, 2), middle(2, 0)];
            Binding { face: element / 4, shares: shares.map(|s| s as f32) }
        };
        points.map(at).collect()
    }

    /// What `field` is at the surface's point near `to` that is found from node `from` by going nearer along the surface: so the
    /// two sides of a thin rim stay apart.
    pub fn sample(&self, surface: &FieldSurface, from: usize, to: DVec3, field: &[DVec3]) -> DVec3 {
        /// Enough to cross a few dozen facets; beyond, the nearest so far will do.
        const STEPS: usize = 64;
        let mut facet = self.at_node[from];
        if facet == u32::MAX {
            return field[from];
        }
        let nearest = |facet: u32| {
            let corners = self.corners[facet as usize].map(|n| surface.positions[n as usize]);
            let n = nearest_on_triangle(to, corners);
            (point(corners, n).distance_squared(to), n)
        };
        let (mut least, mut n) = nearest(facet);
        for _ in 0..STEPS {
            let range = self.first[facet as usize] as usize..self.first[facet as usize + 1] as usize;
            let before = least;
            for &other in &self.around[range] {
                let (distance, at) = nearest(other);
                if distance < least {
                    (least, n, facet) = (distance, at, other);
                }
            }
            if least >= before {
                break;
            }
        }
        let corners = self.corners[facet as usize];
        (0..3).map(|i| field[corners[i] as usize] * n[i]).sum()
    }
}
