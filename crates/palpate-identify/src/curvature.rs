//! How curved a surface is on the scale of a tool, and what that makes of friction.
//!
//! While a tool slides at the depth δ over a surface of curvature κ, its reference point moves farther than the contact point,
//! by x = c + (δ − r) û and dû = −κ dc: |dx| = (1 + (r − δ) κ) |dc|. Friction works along the tool's way, and slip counts the
//! contact point's (LAW, (L1)). So that both dissipate the same, the coefficient of slip is
//!
//! ```text
//! μ_slip(δ) = μ(δ) (1 + (r − δ) κ)
//! ```
//!
//! and what the tool then feels in sustained sliding is μ f_z.

use crate::error::FitError;
use crate::paths::PointRecord;
use glam::DVec3;
use palpate_body::{Curve, Surface};
use std::collections::HashMap;

/// Between which ends the factor stays: an edge that is sharp against the tool, or a hollow as narrow as it, has no one curvature.
const ENDS: [f64; 2] = [0.5, 2.0];
/// Where hardly anything presses along û any more the pressures say nothing.
const WRAPPED: f64 = 1.5;

/// The coefficient of slip at a place of this curvature (1/m) under a sphere of radius `tool_radius_m` (0 for a tool whose
/// reference point is its tip), from the material's.
pub(crate) fn slip_friction(material: &Curve, tool_radius_m: f64, curvature: f64) -> Result<Curve, FitError> {
    let [low, high] = ENDS;
    let factor = |depth: f64| (1.0 + (tool_radius_m - depth) * curvature).clamp(low, high);
    scaled(material, factor)
}

/// What a contact that wraps around the tool holds, in parts of μ f_z, over depth (m).
///
/// Friction acts on every part of the contact, Σ μ p in all, and f_z is what of these pressures points along û: with θ the angle
/// between both, Σ p = f_z/⟨cos θ⟩. And the material that slips there goes along arcs, 1/cos θ for each way of the tool where
/// that leads up or down, 1 where it leads past: on the mean over the directions another ⟨cos θ⟩^−½.
pub(crate) fn capacity(record: &PointRecord) -> Vec<(f64, f64)> {
    let u = record.inward.normalize();
    let at = record.press.iter().zip(&record.pressed_n).filter(|(row, _)| row.1.dot(u) > 0.0);
    let at = at.map(|(row, pressed)| {
        let wrapped = (pressed / row.1.dot(u)).clamp(1.0, WRAPPED);
        (row.0, wrapped * wrapped.sqrt())
    });
    std::iter::once((0.0, 1.0)).chain(at).collect()
}

/// A friction's curve times a factor of the depth, m.
pub(crate) fn scaled(friction: &Curve, factor: impl Fn(f64) -> f64) -> Result<Curve, FitError> {
    let knots = friction.knots();
    let rows: Vec<(f64, f64)> = knots.iter().map(|&k| (k, friction.value(k) * factor(k))).collect();
    crate::paths::friction(&rows, knots)
}

/// Mean curvatures of a surface over balls of one radius.
pub(crate) struct Curvatures<'a> {
    surface: &'a Surface,
    radius: f64,
    /// Nodes by the cube, as wide as the radius, that they lie in.
    cubes: HashMap<[i64; 3], Vec<u32>>,
}

impl<'a> Curvatures<'a> {
    pub fn new(surface: &'a Surface, radius: f64) -> Self {
        let mut cubes: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (n, &p) in surface.positions().iter().enumerate() {
            cubes.entry(cube(p, radius)).or_default().push(n as u32);
        }
        Curvatures { surface, radius, cubes }
    }

    /// At a node, 1/m, positive where the body is convex: how normals turn on the way to the nodes around, the least squares of
    /// û_j − û = −κ (p_j − p). Of nodes beyond an edge or on the body's other side, whose normals point elsewhere, it takes none.
    pub fn at(&self, node: u32) -> f64 {
        let (positions, normals) = (self.surface.positions(), self.surface.inward_normals());
        let (p, u) = (positions[node as usize], normals[node as usize]);
        let [x, y, z] = cube(p, self.radius);
        let (mut turned, mut squares) = (0.0, 0.0);
        let near = -1..=1;
        for (i, j, k) in
            near.clone().flat_map(|i| near.clone().flat_map(move |j| (-1..=1).map(move |k| (i, j, k))))
        {
            for &n in self.cubes.get(&[x + i, y + j, z + k]).into_iter().flatten() {
                let (way, turn) = (positions[n as usize] - p, normals[n as usize] - u);
                if way.length_squared() <= self.radius * self.radius && normals[n as usize].dot(u) > 0.0 {
                    turned -= turn.dot(way);
                    squares += way.length_squared();
                }
            }
        }
        if squares > 0.0 { turned / squares } else { 0.0 }
    }
}

fn cube(p: DVec3, width: f64) -> [i64; 3] {
    (p / width).floor().to_array().map(|x| x as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::friction;
    use palpate_body::shape::{Resolution, Shape};

    fn curvature(shape: Shape, at: DVec3) -> f64 {
        let mesh = shape.mesh(Resolution { edge_length_mm: Some(4.0), ..Resolution::default() });
        let surface = Surface::build(&mesh.unwrap(), 0.7).unwrap();
        let distance = |n: &u32| surface.positions()[*n as usize].distance(at);
        let nearest =
            (0..surface.positions().len() as u32).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        Curvatures::new(&surface, 8e-3).at(nearest.unwrap())
    }

    #[test]
    fn balls_cylinders_and_planes_have_the_curvature_that_they_have() {
        let ball = curvature(Shape::Sphere { radius_mm: 40.0 }, DVec3::Z * 0.04);
        assert!((ball * 0.04 - 1.0).abs() < 0.02, "{ball}");
        let cylinder = Shape::Cylinder { radius_mm: 40.0, length_mm: 120.0, caps: true };
        let side = curvature(cylinder, DVec3::X * 0.04);
        assert!((side * 0.04 - 0.5).abs() < 0.1, "{side}");
        let block = Shape::Block { size_mm: [60.0, 60.0, 30.0] };
        assert!(curvature(block, DVec3::Z * 0.015).abs() < 1e-9);
    }

    #[test]
    fn the_way_of_the_tool_is_what_friction_works_along() {
        let rows = [(0.0, 0.3), (4e-3, 0.5)];
        let knots = [0.0, 2e-3, 4e-3, 6e-3];
        let material = friction(&rows, &knots).unwrap();
        let curve = slip_friction(&material, 5e-3, 20.0).unwrap();
        for (depth, mu) in [(0.0, 0.3), (2e-3, 0.4), (4e-3, 0.5), (6e-3, 0.5)] {
            let expected = mu * (1.0 + (5e-3 - depth) * 20.0);
            assert!((curve.value(depth) - expected).abs() < 1e-12);
        }
        // A hollow that is narrower than the tool.
        assert!((slip_friction(&material, 5e-3, -300.0).unwrap().value(0.0) - 0.15).abs() < 1e-12);
    }
}
