//! Where is the surface? One query a file, over a tree of boxes: bounded, without allocation, without panics.

mod clearance;
mod curve;
mod mesh;
mod nearest;
mod touch;
mod tree;

pub use mesh::MeshSearch;
pub use nearest::Nearest;
pub(crate) use nearest::nearest_on_triangle;
pub use touch::Touch;
pub(crate) use tree::Search;

use glam::DVec3;

/// A point of the surface: an element and area coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Element.
    pub element: u32,
    /// Area coordinates (3) of its nodes; non-negative, sum 1.
    pub n: [f64; 3],
}

/// The point with area coordinates `n`.
#[inline]
pub(crate) fn point([a, b, c]: [DVec3; 3], n: [f64; 3]) -> DVec3 {
    a + (b - a) * n[1] + (c - a) * n[2]
}
