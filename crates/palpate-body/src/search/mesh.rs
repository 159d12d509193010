//! Queries of a bare triangle mesh.

use super::nearest::nearest_on_triangle;
use super::touch::{BACK_OFF, Ray};
use super::tree::{Distance, Entry, Search};
use super::{SurfacePoint, point};
use crate::surface::TriangleMesh;
use glam::DVec3;

/// Nearest points of a bare triangle mesh, with nothing promised of it.
#[derive(Debug, Clone)]
pub struct MeshSearch {
    search: Search,
    /// Along the tree's curve: what is near in space is near in memory.
    corners: Vec<[DVec3; 3]>,
    /// The mesh's number of each of these triangles.
    triangles: Vec<u32>,
}

impl MeshSearch {
    /// Builds the tree.
    ///
    /// # Panics
    /// On a triangle that names a vertex that is not there.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let mut search = Search::build(&mesh.positions, mesh.triangles.len(), |t| mesh.triangles[t]);
        let triangles = std::mem::take(&mut search.order);
        let corners: Vec<[DVec3; 3]> = triangles
            .iter()
            .map(|&t| mesh.triangles[t as usize].map(|v| mesh.positions[v as usize]))
            .collect();
        search.order = (0..corners.len() as u32).collect();
        search.refine(|slot| corners[slot as usize]);
        MeshSearch { search, corners, triangles }
    }

    /// The mesh's point nearest to `p`, if one is within `max_distance` (m), the triangle's number as its element;
    /// and the point itself, m.
    pub fn nearest(&self, p: DVec3, max_distance: f64) -> Option<(SurfacePoint, DVec3)> {
        let mut best: Option<(u32, [f64; 3], DVec3)> = None;
        self.search.walk(max_distance * max_distance, &Distance(p), |slot, bound| {
            let Some(corners) = self.corners.get(slot as usize) else { return bound };
            let n = nearest_on_triangle(p, *corners);
            let q = point(*corners, n);
            let d = (q - p).length_squared();
            if d < bound || (best.is_none() && d <= bound) {
                best = Some((slot, n, q));
                return d;
            }
            bound
        });
        let (slot, n, q) = best?;
        Some((SurfacePoint { element: *self.triangles.get(slot as usize)?, n }, q))
    }

    /// How often a closed mesh winds around `p`: 0 outside, 1 inside, 2 where it overlaps itself. Counted along the
    /// segment from `p` by `way`, which must end outside.
    ///
    /// Edges and vertices on the segment count once: neighbours agree to the bit (Woop, Benthin and Wald 2013).
    pub fn winding(&self, p: DVec3, way: DVec3) -> i32 {
        let ray = Ray::new(p, way);
        let mut winding = 0;
        // A little more than nothing: rounding must never keep what is met.
        self.search.walk(1.0, &Entry::new(p, way, BACK_OFF), |slot, bound| {
            winding += self.corners.get(slot as usize).map_or(0, |corners| ray.crossing(*corners));
            bound
        });
        winding
    }
}
