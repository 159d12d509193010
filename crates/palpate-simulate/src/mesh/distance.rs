//! How far is the surface, and on which side? Signed distances to closed triangle meshes.

use crate::{Result, SimulateError};
use glam::DVec3;
use palpate_body::{MeshSearch, TriangleMesh};

/// The signed distance to a closed triangle mesh, negative inside.
///
/// The nearest point comes from a tree of boxes; its face's, edge's or vertex's pseudonormal, the sum of the faces'
/// normals weighted by their angles there, tells the side (Bærentzen and Aanæs 2005).
#[derive(Debug, Clone)]
pub struct SignedDistance {
    search: MeshSearch,
    faces: Vec<Pseudonormals>,
    low: DVec3,
    high: DVec3,
    /// To beyond the box from any point in it, along no line of symmetry.
    way: DVec3,
    volume: f64,
    shells: Vec<f64>,
    euler: i64,
}

/// Of one triangle; edges and vertices not of unit length.
#[derive(Debug, Clone, Copy)]
struct Pseudonormals {
    face: DVec3,
    /// Of edge i, from corner i to corner (i + 1) % 3.
    edges: [DVec3; 3],
    vertices: [DVec3; 3],
}

impl SignedDistance {
    /// Prepares the tree and the pseudonormals.
    ///
    /// # Errors
    /// A mesh without triangles, an index out of range, a coordinate that is not finite, an edge that is not shared
    /// by two triangles that run along it in opposite directions, and a mesh that faces inwards.
    pub fn new(mesh: &TriangleMesh) -> Result<Self> {
        let invalid =
            |place: String, problem: &str, hint: &str| Err(SimulateError::invalid(place, problem, hint));
        if mesh.triangles.is_empty() {
            return invalid("surface".into(), "there is no triangle in it", "give a closed triangle mesh");
        }
        if let Some(v) = mesh.positions.iter().position(|p| !p.is_finite()) {
            return invalid(format!("vertex {v}"), "a coordinate is not finite", "repair the mesh");
        }
        let count = mesh.positions.len();
        if let Some(t) = mesh.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= count)) {
            return invalid(
                format!("triangle {t}"),
                "it names a vertex that is not there",
                "repair the mesh",
            );
        }
        let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
        let normals: Vec<DVec3> = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = corners(t);
                (b - a).cross(c - a).normalize_or_zero()
            })
            .collect();
        let twins = twins(mesh)?;
        let mut vertices = vec![DVec3::ZERO; count];
        let mut shells = Shells::new(count);
        for (triangle, normal) in mesh.triangles.iter().zip(&normals) {
            let p = corners(triangle);
            for i in 0..3 {
                let (u, v) = (p[(i + 1) % 3] - p[i], p[(i + 2) % 3] - p[i]);
                vertices[triangle[i] as usize] += *normal * libm::atan2(u.cross(v).length(), u.dot(v));
                shells.join(triangle[i], triangle[(i + 1) % 3]);
            }
        }
        let faces = mesh.triangles.iter().enumerate().map(|(t, triangle)| Pseudonormals {
            face: normals[t],
            edges: std::array::from_fn(|i| normals[t] + normals[twins[3 * t + i] as usize / 3]),
            vertices: triangle.map(|v| vertices[v as usize]),
        });

        let low = mesh.positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = mesh.positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let middle = (low + high) / 2.0;
        let mut volumes = std::collections::BTreeMap::<u32, f64>::new();
        for triangle in &mesh.triangles {
            let [a, b, c] = corners(triangle).map(|p| p - middle);
            *volumes.entry(shells.root(triangle[0])).or_default() += a.cross(b).dot(c) / 6.0;
        }
        let volume: f64 = volumes.values().sum();
        if volume <= 0.0 {
            let hint = "turn its triangles round: anticlockwise seen from outside";
            return invalid("surface".into(), "it faces inwards, or has no volume", hint);
        }
        let mut used = vec![false; count];
        mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
        let used = used.into_iter().filter(|u| *u).count() as i64;
        Ok(SignedDistance {
            search: MeshSearch::new(mesh),
            faces: faces.collect(),
            low,
            high,
            way: DVec3::new(0.2718, 0.3142, 1.0) * (1.1 * (high - low).length()),
            volume,
            shells: volumes.into_values().collect(),
            euler: used - mesh.triangles.len() as i64 / 2,
        })
    }

    /// The distance (m), negative inside, and its gradient: the unit vector from the nearest point if outside,
    /// towards it if inside; on the surface the pseudonormal.
    pub fn distance(&self, p: DVec3) -> (f64, DVec3) {
        self.distance_within(p, f64::INFINITY).unwrap_or((f64::INFINITY, DVec3::ZERO))
    }

    /// The same where the surface is at most `reach` (m) away; from afar a small reach is faster.
    pub fn distance_within(&self, p: DVec3, reach: f64) -> Option<(f64, DVec3)> {
        let (at, nearest) = self.search.nearest(p, reach)?;
        let normals = &self.faces[at.element as usize];
        // The nearest point's coordinates are exactly zero where an edge or a vertex is nearest.
        let zero = at.n.map(|n| n == 0.0);
        let normal = match zero {
            [false, false, false] => normals.face,
            [false, false, true] => normals.edges[0],
            [true, false, false] => normals.edges[1],
            [false, true, false] => normals.edges[2],
            [false, true, true] => normals.vertices[0],
            [true, false, true] => normals.vertices[1],
            _ => normals.vertices[2],
        };
        let offset = p - nearest;
        let length = offset.length();
        let sign = if offset.dot(normal) < 0.0 { -1.0 } else { 1.0 };
        // Nearer than rounding the offset has no direction.
        let rounding = 1e-15 * (self.high - self.low).max_element().max(p.abs().max_element());
        let gradient =
            if length > 1e3 * rounding { offset * (sign / length) } else { normal.normalize_or_zero() };
        Some((sign * length, gradient))
    }

    /// As [`SignedDistance::distance`], but inside is where the surface winds around once or more often: right also
    /// where it crosses itself, at twice the time.
    pub fn distance_by_winding(&self, p: DVec3) -> (f64, DVec3) {
        let (d, gradient) = self.distance(p);
        let inside = self.search.winding(p, self.way) > 0;
        if inside == (d < 0.0) { (d, gradient) } else { (-d, -gradient) }
    }

    /// The smallest box around the mesh, m.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.low, self.high)
    }

    /// The volume inside, m³.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Volumes of the mesh's connected pieces, m³; those of cavities are negative.
    pub fn shells(&self) -> &[f64] {
        &self.shells
    }

    /// Vertices − edges + triangles: twice the number of pieces, less twice the number of handles.
    pub fn euler(&self) -> i64 {
        self.euler
    }
}

/// The half-edge (3 × triangle + edge) on the other side of each.
fn twins(mesh: &TriangleMesh) -> Result<Vec<u32>> {
    let mut edges: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * mesh.triangles.len());
    for (t, v) in mesh.triangles.iter().enumerate() {
        for i in 0..3 {
            let (a, b) = (v[i], v[(i + 1) % 3]);
            edges.push(([a.min(b), a.max(b)], (3 * t + i) as u32));
        }
    }
    edges.sort_unstable();
    let mut twins = vec![0; edges.len()];
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        let start = |h: u32| mesh.triangles[h as usize / 3][h as usize % 3];
        let (problem, hint) = match *run {
            [(_, g), (_, h)] if start(g) != start(h) => {
                twins[g as usize] = h;
                twins[h as usize] = g;
                continue;
            }
            [_] => ("the surface has a hole there".to_owned(), "close it in a mesh editor"),
            [_, _] => ("its two triangles face opposite ways".to_owned(), "orient the triangles alike"),
            _ => (format!("{} triangles share it", run.len()), "separate or remove the extra sheets"),
        };
        let [a, b] = run[0].0;
        let p = (mesh.positions[a as usize] + mesh.positions[b as usize]) * 500.0;
        let place = format!("the edge of vertices {a} and {b} at ({:.3}, {:.3}, {:.3}) mm", p.x, p.y, p.z);
        return Err(SimulateError::invalid(place, problem, hint));
    }
    Ok(twins)
}

/// Connected sets.
pub(super) struct Shells(Vec<u32>);

impl Shells {
    pub fn new(count: usize) -> Self {
        Shells((0..count as u32).collect())
    }

    /// The smallest member of x's set.
    pub fn root(&mut self, mut x: u32) -> u32 {
        while self.0[x as usize] != x {
            self.0[x as usize] = self.0[self.0[x as usize] as usize];
            x = self.0[x as usize];
        }
        x
    }

    pub fn join(&mut self, x: u32, y: u32) {
        let (x, y) = (self.root(x), self.root(y));
        self.0[x.max(y) as usize] = x.min(y);
    }
}
