//! Shapes that mesh themselves.
use crate::error::Result;
use crate::surface::{Surface, TriangleMesh};
/// A shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Sphere.
    Sphere {
        /// mm
        radius_mm: f64,
    },
}
/// Fineness.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Resolution {
    /// mm
    pub edge_length_mm: Option<f64>,
}
impl Shape {
    /// Mesh.
    /// # Errors
    /// None.
    pub fn mesh(&self, _: Resolution) -> Result<TriangleMesh> {
        Ok(TriangleMesh::default())
    }
    /// Surface.
    /// # Errors
    /// None.
    pub fn surface(&self, r: Resolution) -> Result<Surface> {
        Surface::build(&self.mesh(r)?, f64::INFINITY)
    }
}
