//! Queries of a bare triangle mesh.

use super::nearest::nearest_on_triangle;
use super::touch::Ray;
use super::tree::{Box3, Search, Segment};
use super::{SurfacePoint, point};
use crate::surface::TriangleMesh;
use glam::DVec3;

/// Nearest points of a bare triangle mesh, with nothing promised of it.
#[derive(Debug, Clone)]
pub struct MeshSearch {
    search: Search,
    /// Along the tree's curve: what is near in space is near in memory.
    corners: Vec<[DVec3; 3]>,
    /// Around each of these triangles: most need no closer look.
    boxes: Vec<Box3>,
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
        let corners: Vec<_> = triangles
            .iter()
            .map(|&t| mesh.triangles[t as usize].map(|v| mesh.positions[v as usize]))
            .collect();
        search.order = (0..corners.len() as u32).collect();
        let boxes = corners.iter().map(|c: &[DVec3; 3]| {
            let mut b = Box3::EMPTY;
            c.iter().for_each(|p| b.include(*p));
            b
        });
        MeshSearch { search, boxes: boxes.collect(), corners, triangles }
    }

    /// The mesh's point nearest to `p`, if one is within `max_distance` (m), the triangle's number as its element;
    /// and the point itself, m.
    pub fn nearest(&self, p: DVec3, max_distance: f64) -> Option<(SurfacePoint, DVec3)> {
        let mut best: Option<(u32, [f64; 3], DVec3)> = None;
        self.search.walk(
            max_distance * max_distance,
            |b| b.distance_squared(p),
            |slot, bound| {
                let i = slot as usize;
                let (Some(b), Some(corners)) = (self.boxes.get(i), self.corners.get(i)) else { return bound };
                if b.distance_squared(p) > bound {
                    return bound;
                }
                let n = nearest_on_triangle(p, *corners);
                let q = point(*corners, n);
                let d = (q - p).length_squared();
                if d < bound || (best.is_none() && d <= bound) {
                    best = Some((slot, n, q));
                    return d;
                }
                bound
            },
        );
        let (slot, n, q) = best?;
        Some((SurfacePoint { element: *self.triangles.get(slot as usize)?, n }, q))
    }

    /// How often a closed mesh winds around `p`: 0 outside, 1 inside, 2 where it overlaps itself. Counted along the
    /// segment from `p` by `way`, which must end outside.
    ///
    /// Edges and vertices on the segment count once: neighbours agree to the bit (Woop, Benthin and Wald 2013).
    pub fn winding(&self, p: DVec3, way: DVec3) -> i32 {
        let segment = Segment { middle: p + way * 0.5, half: way * 0.5 };
        let ray = Ray::new(p, way);
        let mut winding = 0;
        self.search.walk(
            1.0,
            |b| if b.meets(&segment, 0.0) { 0.0 } else { f64::INFINITY },
            |slot, bound| {
                winding += self.corners.get(slot as usize).map_or(0, |corners| ray.crossing(*corners));
                bound
            },
        );
        winding
    }
}
