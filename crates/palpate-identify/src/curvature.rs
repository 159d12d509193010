//! How curved a surface is on the scale of a tool, and what that makes of friction.
//!
//! While a tool slides at the depth δ over a surface of curvature κ, its reference point moves farther than the contact point,
//! by x = c + (δ − r) û and dû = −κ dc: dx = (1 + (r − δ) κ) dc. Friction works along the tool's way, and the engine counts it so
//! where a potential says how its place is curved ([`palpate_body::law::tool_motion`]).

use crate::error::FitError;
use crate::paths::PointRecord;
use glam::{DMat3, DVec3};
use palpate_body::law::{curvature_bounds, eigenvalues};
use palpate_body::{Curve, Surface};
use std::collections::HashMap;
use std::f64::consts::PI;

/// Where hardly anything presses along û any more the pressures say nothing.
const WRAPPED: f64 = 1.5;
/// Nodes that spread less across than this part of along, both squared, say nothing of the curvature across.
const ON_A_LINE: f64 = 0.01;

/// What a contact that wraps around the tool, a ball of `tool_radius_m` (0: another tool), holds, in parts of μ f_z, over depth (m).
///
/// Friction acts on every part of the contact, Σ μ p in all, and f_z is what of these pressures points along û: with θ the angle
/// between both, Σ p = f_z/⟨cos θ⟩. And the material that slips there goes along arcs, 1/cos θ for each way of the tool where
/// that leads up or down, 1 where it leads past: on the mean over the directions another ⟨cos θ⟩^−½.
///
/// A contact that sticks carries a part of f_z by its grip, and Σ p is less than sliding. What it is sliding is taken to be that of even
/// pressures at least: over a patch of area A under a ball they have ⟨cos θ⟩ = 1 − A/(4 π R²), to the first order. (Hertz's pressures, which
/// are highest in the middle, have a fifth less beside 1, and A is the patch's area at rest.)
pub(crate) fn capacity(record: &PointRecord, tool_radius_m: f64) -> Vec<(f64, f64)> {
    let u = record.inward.normalize();
    let ball = 4.0 * PI * tool_radius_m * tool_radius_m;
    let patches = record.patch_m2.iter().copied().chain(std::iter::repeat(0.0));
    let at =
        record.press.iter().zip(&record.pressed_n).zip(patches).filter(|((row, _), _)| row.1.dot(u) > 0.0);
    let at = at.map(|((row, pressed), patch)| {
        let even = if ball > 0.0 { 1.0 / (1.0 - patch / ball).max(1.0 / WRAPPED) } else { 1.0 };
        let wrapped = (pressed / row.1.dot(u)).clamp(even, WRAPPED);
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

/// Curvatures of a surface, over balls of one radius.
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

    /// At a node, in these tangents, [κ₁₁, κ₁₂, κ₂₂], 1/m, positive where the body is convex: how normals turn on the way to the nodes
    /// around, the least squares of û_j − û = −κ (p_j − p) in the tangent plane. Of nodes beyond an edge or on the body's other side, whose
    /// normals point elsewhere, it takes none. Where the nodes lie nearly on a line, the same in all directions; `None` where there are
    /// none.
    pub fn at(&self, node: u32, [t1, t2]: [DVec3; 2]) -> Option<[f64; 3]> {
        let (positions, normals) = (self.surface.positions(), self.surface.inward_normals());
        let (p, u) = (positions[node as usize], normals[node as usize]);
        let [x, y, z] = cube(p, self.radius);
        // Of κ's components (11, 12, 22): κ₁₁ a + κ₁₂ b and κ₁₂ a + κ₂₂ b are the turns along t₁ and t₂.
        let (mut squares, mut turned) = (DMat3::ZERO, DVec3::ZERO);
        let near = -1..=1;
        for (i, j, k) in
            near.clone().flat_map(|i| near.clone().flat_map(move |j| (-1..=1).map(move |k| (i, j, k))))
        {
            for &n in self.cubes.get(&[x + i, y + j, z + k]).into_iter().flatten() {
                let (way, turn) = (positions[n as usize] - p, u - normals[n as usize]);
                if way.length_squared() <= self.radius * self.radius && normals[n as usize].dot(u) > 0.0 {
                    let [a, b] = [t1, t2].map(|t| t.dot(way));
                    let [c, d] = [t1, t2].map(|t| t.dot(turn));
                    squares += DMat3::from_cols(
                        DVec3::new(a * a, a * b, 0.0),
                        DVec3::new(a * b, a * a + b * b, a * b),
                        DVec3::new(0.0, a * b, b * b),
                    );
                    turned += DVec3::new(a * c, b * c + a * d, b * d);
                }
            }
        }
        let [narrow, wide] = eigenvalues([squares.x_axis.x, squares.x_axis.y, squares.z_axis.z]);
        if wide <= 0.0 {
            return None;
        }
        if narrow < ON_A_LINE * wide {
            let along = (turned.x + turned.z) / (narrow + wide);
            return Some([along, 0.0, along]);
        }
        Some((squares.inverse() * turned).to_array())
    }
}

/// The tensor with eigenvalues that count under a ball of this radius (m; 0: a tool that is none).
pub(crate) fn clamped([a, b, c]: [f64; 3], radius: f64) -> [f64; 3] {
    let ([low, high], [least, most]) = (eigenvalues([a, b, c]), curvature_bounds(radius));
    let (to_low, to_high) = (low.clamp(least, most), high.clamp(least, most));
    let (mean, middle) = (0.5 * (low + high), 0.5 * (to_low + to_high));
    let part = if high > low { (to_high - to_low) / (high - low) } else { 0.0 };
    [middle + (a - mean) * part, b * part, middle + (c - mean) * part]
}

fn cube(p: DVec3, width: f64) -> [i64; 3] {
    (p / width).floor().to_array().map(|x| x as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_body::shape::{Resolution, Shape};

    /// At the node nearest to `at`, along two ways.
    fn curvature(shape: Shape, at: DVec3, tangents: [DVec3; 2]) -> [f64; 3] {
        let mesh = shape.mesh(Resolution { edge_length_mm: Some(4.0), ..Resolution::default() });
        let surface = Surface::build(&mesh.unwrap(), 0.7).unwrap();
        let distance = |n: &u32| surface.positions()[*n as usize].distance(at);
        let nearest =
            (0..surface.positions().len() as u32).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        Curvatures::new(&surface, 8e-3).at(nearest.unwrap(), tangents).unwrap()
    }

    #[test]
    fn a_line_of_nodes_says_nothing_across_it() {
        let mut mesh = Shape::Sphere { radius_mm: 40.0 }
            .mesh(Resolution { edge_length_mm: Some(4.0), ..Resolution::default() })
            .unwrap();
        // 20 times as long as wide: beside a node lie those along x alone.
        mesh.positions.iter_mut().for_each(|p| *p = DVec3::new(p.x * 0.2, p.y * 4.0, p.z * 0.2));
        let surface = Surface::build(&mesh, 0.7).unwrap();
        let curvatures = Curvatures::new(&surface, 1.5e-3);
        // On top, away from the tips.
        let top = |n: &u32| {
            let (p, u) = (surface.positions()[*n as usize], surface.inward_normals()[*n as usize]);
            p.y.abs() < 0.08 && u.z < -0.99
        };
        let nodes = (0..surface.positions().len() as u32).filter(top);
        let found: Vec<_> = nodes.filter_map(|n| curvatures.at(n, [DVec3::X, DVec3::Y])).collect();
        // 1/8 mm along the line, seen a little aslant.
        assert!(found.len() > 10, "{found:?}");
        for [x, across, y] in found {
            assert!(x > 50.0 && x < 135.0 && across == 0.0 && y == x, "{x} {across} {y}");
        }
        assert_eq!(Curvatures::new(&surface, 1e-5).at(0, [DVec3::X, DVec3::Y]), None);
    }

    #[test]
    fn what_is_curved_more_than_the_tool_counts_as_that() {
        let [low, high] = eigenvalues(clamped([300.0, 50.0, -400.0], 5e-3));
        assert!((low + 100.0).abs() < 1e-9 && (high - 200.0).abs() < 1e-9, "{low} {high}");
        assert_eq!(clamped([30.0, 5.0, -40.0], 5e-3), [30.0, 5.0, -40.0]);
        assert_eq!(clamped([300.0, 0.0, 300.0], 5e-3), [200.0, 0.0, 200.0]);
    }

    #[test]
    fn balls_cylinders_and_planes_have_the_curvature_that_they_have() {
        let near = |found: [f64; 3], expected: [f64; 3]| {
            let off = (0..3).map(|i| (found[i] * 0.04 - expected[i]).abs()).fold(0.0, f64::max);
            assert!(off < 0.04, "{found:?}, where {expected:?}/40 mm belongs");
        };
        let ball = curvature(Shape::Sphere { radius_mm: 40.0 }, DVec3::Z * 0.04, [DVec3::X, DVec3::Y]);
        near(ball, [1.0, 0.0, 1.0]);
        let cylinder = Shape::Cylinder { radius_mm: 40.0, length_mm: 120.0, caps: true };
        near(curvature(cylinder, DVec3::X * 0.04, [DVec3::Y, DVec3::Z]), [1.0, 0.0, 0.0]);
        let (y, z) = (DVec3::Y, DVec3::Z);
        let aslant = [(y + z).normalize(), (z - y).normalize()];
        near(curvature(cylinder, DVec3::X * 0.04, aslant), [0.5, -0.5, 0.5]);
        let block = Shape::Block { size_mm: [60.0, 60.0, 30.0] };
        let flat = curvature(block, DVec3::Z * 0.015, [DVec3::X, DVec3::Y]);
        assert!(flat.iter().all(|k| k.abs() < 1e-9), "{flat:?}");
    }

    #[test]
    fn a_patch_under_a_ball_holds_what_even_pressures_do() {
        let press = [1e-3, 2e-3, 3e-3].map(|d| (d, DVec3::NEG_Z * 100.0 * d)).to_vec();
        let record = PointRecord {
            node: 0,
            inward: DVec3::NEG_Z,
            pressed_n: vec![0.095, 0.2, 0.45],
            // Of a ball of 5 mm: none, a fifth and a fifth of its great circle.
            patch_m2: vec![0.0, 5e-6 * PI, 5e-6 * PI],
            press,
            stiffness: Vec::new(),
            drags: Vec::new(),
            stopped: None,
        };
        let held = |radius| capacity(&record, radius).into_iter().map(|row| row.1).collect::<Vec<f64>>();
        let expected = [1.0, 1.0, (1.0f64 / 0.95).powf(1.5), 1.5f64.powf(1.5)];
        for (found, expected) in held(5e-3).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert!((held(0.0)[2] - 1.0).abs() < 1e-12);
    }
}
