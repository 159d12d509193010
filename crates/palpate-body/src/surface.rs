//! The triangulated surface of a body at rest: nodes, elements, and who is whose neighbour.

use crate::error::{BodyError, Result};
use crate::parallel;
use glam::DVec3;

/// A triangle mesh as it was read or generated: positions in m, triangles anticlockwise seen from outside.
///
/// Nothing is promised of it; [`Surface::build`] makes the promises.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertices, m.
    pub positions: Vec<DVec3>,
    /// Vertex indices, (triangles × 3).
    pub triangles: Vec<[u32; 3]>,
}

/// No neighbour across this edge: the surface's border.
pub const NO_TWIN: u32 = u32::MAX;

/// The neighbour across this edge was left out of a [`Patch`](crate::Patch).
pub(crate) const FENCE: u32 = u32::MAX - 1;

/// Elements a surface may have: a half-edge (element × 3 + edge) must fit in 32 bits, and [`NO_TWIN`] and
/// a patch's boundary be free.
pub const MAX_ELEMENTS: usize = (u32::MAX / 3) as usize - 1;

/// Coordinates beyond this (m) are taken for a mistake in the unit.
pub const MAX_COORDINATE: f64 = 1e3;

/// A triangle of the surface.
///
/// Edge i runs from node i to node (i + 1) % 3; node (i + 2) % 3 lies opposite. Half-edge `3 * element + i` is edge
/// i seen from this element, its *twin* the same edge seen from the neighbour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Element {
    /// Node indices, anticlockwise seen from outside.
    pub nodes: [u32; 3],
    /// Twins of the three half-edges; [`NO_TWIN`] at a border.
    pub twins: [u32; 3],
}

/// Elements, however they lie in memory.
pub(crate) trait Elements: Copy + Sync {
    fn count(self) -> usize;
    /// Element `e` < `count`.
    fn element(self, e: usize) -> Element;

    fn all(self) -> impl Iterator<Item = Element> {
        (0..self.count()).map(move |e| self.element(e))
    }

    /// Half-edges without a neighbour, as (element, edge).
    fn border(self) -> impl Iterator<Item = (usize, usize)> {
        let edges = |(e, element): (usize, Element)| {
            let twins = element.twins;
            (0..3).filter(move |&i| twins[i] == NO_TWIN).map(move |i| (e, i))
        };
        self.all().enumerate().flat_map(edges)
    }
}

impl Elements for &[Element] {
    fn count(self) -> usize {
        self.len()
    }

    fn element(self, e: usize) -> Element {
        self[e]
    }
}

/// As a body file has them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Columns<'a> {
    pub nodes: &'a [[u32; 3]],
    pub twins: &'a [[u32; 3]],
}

impl Elements for Columns<'_> {
    fn count(self) -> usize {
        self.nodes.len()
    }

    fn element(self, e: usize) -> Element {
        Element { nodes: self.nodes[e], twins: self.twins[e] }
    }
}

/// A checked surface: every element has an area, every edge at most one neighbour, twins agree.
///
/// At a crease a vertex carries several nodes, one for each smooth side: they share the position, and each has its
/// own normal (and may have its own response).
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) inward: Vec<DVec3>,
    pub(crate) elements: Vec<Element>,
    pub(crate) vertices: Vec<u32>,
    pub(crate) smoothed: usize,
}

impl Surface {
    /// Builds adjacency and nodal inward normals (weighted by the corners' angles).
    ///
    /// An edge whose faces turn by more than `crease_angle` (rad) is a crease: normals stay apart there. Give
    /// `f64::INFINITY` for none.
    ///
    /// # Errors
    /// A non-finite or absurd coordinate, an index out of range, an element without area, an edge of three or more
    /// elements, neighbours that face opposite ways, a vertex that no element uses. Borders are no error here.
    pub fn build(mesh: &TriangleMesh, crease_angle: f64) -> Result<Self> {
        check_mesh(mesh)?;
        let twins = twins(&mesh.triangles)?;
        let corners = smooth_corners(mesh, &twins, crease_angle);

        // A vertex's first node keeps the vertex's number, so that without creases nodes are vertices.
        let mut node_of_root = vec![u32::MAX; corners.len()];
        let mut vertices: Vec<u32> = (0..mesh.positions.len() as u32).collect();
        let mut taken = vec![false; mesh.positions.len()];
        let mut elements = Vec::with_capacity(mesh.triangles.len());
        for (e, (triangle, twins)) in mesh.triangles.iter().zip(&twins).enumerate() {
            let nodes = std::array::from_fn(|i| {
                let (root, vertex) = (corners[3 * e + i] as usize, triangle[i]);
                if node_of_root[root] == u32::MAX {
                    node_of_root[root] = if std::mem::replace(&mut taken[vertex as usize], true) {
                        vertices.push(vertex);
                        vertices.len() as u32 - 1
                    } else {
                        vertex
                    };
                }
                node_of_root[root]
            });
            elements.push(Element { nodes, twins: *twins });
        }
        if let Some(unused) = taken.iter().position(|t| !t) {
            return Err(BodyError::invalid(format!("vertex {unused}"), "no triangle uses it", "remove it"));
        }

        let positions: Vec<DVec3> = vertices.iter().map(|&v| mesh.positions[v as usize]).collect();
        let (inward, smoothed) = inward_normals(&positions, &elements)?;
        Ok(Surface { positions, inward, elements, vertices, smoothed })
    }

    /// Node positions, m, (nodes × 3).
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Unit vectors u^z into the body, (nodes × 3).
    pub fn inward_normals(&self) -> &[DVec3] {
        &self.inward
    }

    /// Elements.
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// The vertex that each node sits on; the node's own number unless a crease passes through it.
    pub fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// Nodes in folds, whose normals opposed each other and were replaced by the mean of those around.
    pub fn smoothed_normals(&self) -> usize {
        self.smoothed
    }

    /// Replaces the nodal normals, e.g. by a shape's exact ones.
    ///
    /// # Errors
    /// A wrong count, a vector that is not of unit length, or an element whose three normals oppose each other.
    pub fn with_inward_normals(mut self, inward: Vec<DVec3>) -> Result<Self> {
        check_normals(&inward, &self.positions, self.elements.as_slice())?;
        self.inward = inward;
        Ok(self)
    }

    /// Half-edges without a neighbour, as (element, edge).
    pub fn border(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        Elements::border(self.elements.as_slice())
    }
}

fn check_mesh(mesh: &TriangleMesh) -> Result<()> {
    if mesh.triangles.is_empty() {
        return Err(BodyError::invalid("mesh", "there is no triangle in it", "give a triangulated surface"));
    }
    if mesh.triangles.len() > MAX_ELEMENTS || mesh.positions.len() > MAX_ELEMENTS {
        return Err(BodyError::invalid("mesh", "more than 1.4 billion elements", "decimate it"));
    }
    for (v, p) in mesh.positions.iter().enumerate() {
        check_position("vertex", v, *p)?;
    }
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        if let Some(v) = triangle.iter().find(|&&v| v as usize >= mesh.positions.len()) {
            return Err(BodyError::invalid(
                format!("triangle {t}"),
                format!("it names vertex {v}, but there are {}", mesh.positions.len()),
                "correct the mesh's indices",
            ));
        }
        check_area(t, triangle.map(|v| mesh.positions[v as usize]))?;
    }
    check_fans(&mesh.positions, mesh.triangles.iter().copied())
}

/// The step looks at no more than [`crate::body::MAX_FAN`] elements around a vertex: no surface may have more.
pub(crate) fn check_fans(positions: &[DVec3], triangles: impl Iterator<Item = [u32; 3]>) -> Result<()> {
    let mut fans = vec![0u32; positions.len()];
    for v in triangles.flatten() {
        fans[v as usize] += 1;
    }
    let Some(v) = fans.iter().position(|&n| n as usize > crate::body::MAX_FAN) else { return Ok(()) };
    let p = positions[v];
    Err(BodyError::invalid(
        format!("vertex {v} at ({:.6}, {:.6}, {:.6}) m", p.x, p.y, p.z),
        format!("{} triangles meet there, more than {}", fans[v], crate::body::MAX_FAN),
        "remesh around it",
    ))
}

pub(crate) fn check_position(what: &str, number: usize, p: DVec3) -> Result<()> {
    if p.is_finite() && p.abs().max_element() <= MAX_COORDINATE {
        return Ok(());
    }
    Err(BodyError::invalid(
        format!("{what} {number}"),
        format!("its coordinates ({}, {}, {}) m are not finite or beyond {MAX_COORDINATE} m", p.x, p.y, p.z),
        "correct the coordinate or the mesh's unit",
    ))
}

/// An element needs an area that rounding cannot turn over.
pub(crate) fn check_area(t: usize, [a, b, c]: [DVec3; 3]) -> Result<()> {
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    let twice_area = (b - a).cross(c - a).length();
    if longest >= 1e-18 && twice_area > 1e-7 * longest {
        return Ok(());
    }
    Err(BodyError::invalid(
        format!("triangle {t} at ({:.6}, {:.6}, {:.6}) m", a.x, a.y, a.z),
        "it has no area",
        "collapse or remove degenerate triangles in a mesh editor",
    ))
}

pub(crate) fn check_normals(inward: &[DVec3], positions: &[DVec3], elements: impl Elements) -> Result<()> {
    if inward.len() != positions.len() {
        return Err(BodyError::invalid(
            "normals",
            "their number is not the nodes'",
            "give one for each node",
        ));
    }
    parallel::check(inward.len(), |n| {
        if inward[n].is_normalized() {
            return Ok(());
        }
        Err(BodyError::invalid(format!("normal {n}"), "it is not a unit vector", "normalise it, to 1e-4"))
    })?;
    let outward = |e: &Element| {
        let [a, b, c] = e.nodes.map(|n| positions[n as usize]);
        let face = (c - a).cross(b - a);
        e.nodes.iter().all(|&n| inward[n as usize].dot(face) < 0.0)
    };
    let counts = parallel::in_parts(elements.count(), |range| {
        range.filter(|&e| outward(&elements.element(e))).count()
    });
    if 2 * counts.iter().sum::<usize>() > elements.count() {
        return Err(BodyError::invalid(
            "normals",
            "most of them point out of the body",
            "turn them, or the triangles, round",
        ));
    }
    parallel::check(elements.count(), |t| {
        let element = elements.element(t);
        if !opposes(&element, inward) {
            return Ok(());
        }
        let p = positions[element.nodes[0] as usize];
        Err(BodyError::invalid(
            format!("triangle {t} at ({:.6}, {:.6}, {:.6}) m", p.x, p.y, p.z),
            "the inward normals of its nodes oppose each other: the surface is folded too sharply there",
            "refine or smooth the mesh there, or keep the edge sharp with a crease angle",
        ))
    })
}

/// Whether the blend of an element's three normals may come near to vanishing in it: it does not as long as all three
/// have a part along their sum.
fn opposes(element: &Element, inward: &[DVec3]) -> bool {
    let u = element.nodes.map(|n| inward[n as usize]);
    let sum = (u[0] + u[1] + u[2]).normalize_or_zero();
    u.iter().any(|u| u.dot(sum).is_nan() || u.dot(sum) < 0.1)
}

/// Twin half-edges by sorting undirected edges.
pub(crate) fn twins(triangles: &[[u32; 3]]) -> Result<Vec<[u32; 3]>> {
    let mut edges: Vec<(u64, u32)> = Vec::with_capacity(3 * triangles.len());
    for (t, v) in triangles.iter().enumerate() {
        for i in 0..3 {
            let (a, b) = (v[i], v[(i + 1) % 3]);
            edges.push(((a.min(b) as u64) << 32 | a.max(b) as u64, (3 * t + i) as u32));
        }
    }
    edges.sort_unstable();
    let mut twins = vec![[NO_TWIN; 3]; triangles.len()];
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        let place = |h: u32| {
            format!("the edge of vertices {} and {} (triangle {})", run[0].0 >> 32, run[0].0 as u32, h / 3)
        };
        let start = |h: u32| triangles[h as usize / 3][h as usize % 3];
        match *run {
            [_] => {}
            [(_, g), (_, h)] if start(g) != start(h) => {
                twins[g as usize / 3][g as usize % 3] = h;
                twins[h as usize / 3][h as usize % 3] = g;
            }
            [_, (_, h)] => {
                return Err(BodyError::invalid(
                    place(h),
                    "its two triangles face opposite ways",
                    "orient the triangles alike",
                ));
            }
            _ => {
                return Err(BodyError::invalid(
                    place(run[2].1),
                    format!("{} triangles share it: the surface is not manifold", run.len()),
                    "separate or remove the extra sheets in a mesh editor",
                ));
            }
        }
    }
    Ok(twins)
}

/// For each corner (element × 3 + i) the representative of its smooth group around the vertex.
fn smooth_corners(mesh: &TriangleMesh, twins: &[[u32; 3]], crease_angle: f64) -> Vec<u32> {
    let face = |t: usize| {
        let [a, b, c] = mesh.triangles[t].map(|v| mesh.positions[v as usize]);
        (b - a).cross(c - a).normalize_or_zero()
    };
    let mut parent: Vec<u32> = (0..3 * twins.len() as u32).collect();
    fn root(parent: &mut [u32], mut x: u32) -> u32 {
        while parent[x as usize] != x {
            parent[x as usize] = parent[parent[x as usize] as usize];
            x = parent[x as usize];
        }
        x
    }
    for (t, own) in twins.iter().enumerate() {
        for (i, &twin) in own.iter().enumerate() {
            if twin == NO_TWIN || twin < (3 * t + i) as u32 {
                continue;
            }
            let (t2, j) = (twin as usize / 3, twin as usize % 3);
            let (a, b) = (face(t), face(t2));
            if libm::atan2(a.cross(b).length(), a.dot(b)) > crease_angle {
                continue;
            }
            for (mine, other) in [(i, (j + 1) % 3), ((i + 1) % 3, j)] {
                let (x, y) =
                    (root(&mut parent, (3 * t + mine) as u32), root(&mut parent, (3 * t2 + other) as u32));
                parent[x.max(y) as usize] = x.min(y);
            }
        }
    }
    (0..parent.len() as u32).map(|c| root(&mut parent, c)).collect()
}

/// Inward unit normals, the faces' weighted by their corner's angle (Thürmer and Wüthrich 1998).
fn inward_normals(positions: &[DVec3], elements: &[Element]) -> Result<(Vec<DVec3>, usize)> {
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for element in elements {
        let p = element.nodes.map(|n| positions[n as usize]);
        let inward = (p[2] - p[0]).cross(p[1] - p[0]).normalize_or_zero();
        for i in 0..3 {
            sums[element.nodes[i] as usize] += inward * corner_angle(p, i);
        }
    }
    let mut inward: Vec<DVec3> = sums.into_iter().map(DVec3::normalize_or_zero).collect();
    let smoothed = smooth_folds(&mut inward, elements);
    check_normals(&inward, positions, elements)?;
    Ok((inward, smoothed))
}

/// Organ meshes have the odd fin or fold, a triangle wide, where normals oppose: there they are replaced by the mean
/// of those around. Returns how many were.
fn smooth_folds(inward: &mut [DVec3], elements: &[Element]) -> usize {
    let mut folded = std::collections::BTreeSet::new();
    for _ in 0..10 {
        let before = folded.len();
        for element in elements.iter().filter(|e| opposes(e, inward)) {
            folded.extend(element.nodes);
        }
        if folded.is_empty() || (folded.len() == before && !elements.iter().any(|e| opposes(e, inward))) {
            break;
        }
        let mut sums: std::collections::BTreeMap<u32, DVec3> =
            folded.iter().map(|&n| (n, DVec3::ZERO)).collect();
        for element in elements {
            let sum: DVec3 = element.nodes.iter().map(|&n| inward[n as usize]).sum();
            for n in element.nodes {
                if let Some(s) = sums.get_mut(&n) {
                    *s += sum;
                }
            }
        }
        for (n, sum) in sums {
            inward[n as usize] = sum.normalize_or(inward[n as usize]);
        }
    }
    folded.len()
}

/// Angle of corner i (modulo 3), rad.
pub(crate) fn corner_angle([a, b, c]: [DVec3; 3], i: usize) -> f64 {
    let (p, q, r) = match i % 3 {
        0 => (a, b, c),
        1 => (b, c, a),
        _ => (c, a, b),
    };
    libm::atan2((q - p).cross(r - p).length(), (q - p).dot(r - p))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> TriangleMesh {
        let positions =
            (0..8).map(|i| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64) * 0.04).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        TriangleMesh { positions, triangles }
    }

    #[test]
    fn a_cube_without_creases_has_diagonal_normals() {
        let s = Surface::build(&cube(), f64::INFINITY).unwrap();
        assert_eq!(s.positions.len(), 8);
        assert_eq!(s.border().count(), 0);
        let diagonal = DVec3::splat(1.0 / 3f64.sqrt());
        assert!((s.inward[0] - diagonal).length() < 1e-12);
        assert!((s.inward[7] + diagonal).length() < 1e-12);
    }

    #[test]
    fn a_cube_with_creases_has_three_nodes_at_each_vertex() {
        let s = Surface::build(&cube(), 0.5).unwrap();
        assert_eq!(s.positions.len(), 24);
        assert!(s.elements.iter().all(|e| {
            let p = e.nodes.map(|n| s.positions[n as usize]);
            let face = (p[2] - p[0]).cross(p[1] - p[0]).normalize();
            e.nodes.iter().all(|&n| (s.inward[n as usize] - face).length() < 1e-12)
        }));
        assert_eq!(s.border().count(), 0, "a crease is no border");
    }

    #[test]
    fn defects_are_named() {
        let refused = |change: fn(&mut TriangleMesh), word: &str| {
            let mut mesh = cube();
            change(&mut mesh);
            let message = Surface::build(&mesh, f64::INFINITY).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        };
        refused(|m| m.positions[3].x = f64::NAN, "vertex 3");
        refused(|m| m.triangles[5][1] = 99, "triangle 5");
        refused(|m| m.triangles[5].swap(0, 1), "opposite ways");
        refused(|m| m.triangles.push([0, 2, 7]), "not manifold");
        refused(|m| m.positions[1] = m.positions[0], "no area");
        refused(|m| m.positions.push(DVec3::ZERO), "no triangle uses it");
    }
}
