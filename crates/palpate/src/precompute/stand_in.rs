//! In place of the finite elements, until they are here: the same signatures, with the half space's formulas inside.

use super::run::Solver;
use crate::record::TestPoint;
use anyhow::Result;
use glam::DVec3;
use palpate_body::TriangleMesh;
use palpate_body::import::{self, LengthUnit};
use palpate_body::shape::{Resolution, Shape};
use palpate_simulate::{Path, PointPaths, State, TetMesh};
use std::sync::atomic::{AtomicBool, Ordering};

pub enum Imported {
    #[allow(dead_code, reason = "its readers are not here yet")]
    Volume(TetMesh),
    Surface(TriangleMesh),
}

pub fn read_any(path: &std::path::Path, unit: LengthUnit) -> Result<Imported> {
    Ok(Imported::Surface(import::read(path, Some(unit))?))
}

pub struct FillOptions {
    pub surface_edge_m: f64,
    pub interior_edge_m: f64,
    pub planes_z_m: Vec<f64>,
}

impl FillOptions {
    pub fn new(surface_edge_m: f64) -> Self {
        FillOptions { surface_edge_m, interior_edge_m: 6.0 * surface_edge_m, planes_z_m: Vec::new() }
    }
}

/// A tetrahedron behind each triangle, up to the middle.
pub fn fill(surface: &TriangleMesh, _: &FillOptions) -> Result<TetMesh> {
    let mut positions = surface.positions.clone();
    let middle = positions.iter().sum::<DVec3>() / positions.len().max(1) as f64;
    let apex = positions.len() as u32;
    positions.push(middle);
    let tetrahedra: Vec<[u32; 4]> = surface.triangles.iter().map(|&[a, b, c]| [a, b, c, apex]).collect();
    Ok(TetMesh::from_corners(positions, &tetrahedra))
}

pub fn fill_shape(shape: &Shape, options: &FillOptions) -> Result<TetMesh> {
    let closed = match *shape {
        Shape::Cylinder { radius_mm, length_mm, .. } => Shape::Cylinder { radius_mm, length_mm, caps: true },
        other => other,
    };
    fill(&closed.mesh(Resolution::default())?, options)
}

/// A ball on an elastic half space that sticks to it.
pub struct HalfSpace {
    pub shear_modulus_pa: f64,
    pub radius_m: f64,
    pub nodes: usize,
}

impl Solver for HalfSpace {
    fn simulate(&self, point: &TestPoint, cancelled: &AtomicBool) -> Option<PointPaths> {
        if cancelled.load(Ordering::Relaxed) {
            return None;
        }
        let plan = &point.plan;
        // Some points are stiffer, so that a body shows them.
        let stiffness = self.shear_modulus_pa * (1.5 + libm::sin(100.0 * plan.point.x));
        let state = |depth: f64, distance: f64, direction: DVec3| {
            let contact = (self.radius_m * depth).sqrt();
            let force = 16.0 / 3.0 * stiffness * contact * depth;
            let lateral = 16.0 / 3.0 * stiffness * contact * distance;
            State {
                depth_m: depth,
                distance_m: distance,
                force_n: plan.inward * force + direction * lateral,
                patch_m2: std::f64::consts::PI * contact * contact,
                displacement_m: vec![(plan.inward * depth).as_vec3().to_array(); self.nodes],
                ..State::default()
            }
        };
        let press = plan.depths.iter().map(|&d| state(d, 0.0, DVec3::ZERO)).collect();
        let drags = plan.drags.iter().map(|drag| {
            let depth = plan.depths.get(drag.from).copied().unwrap_or_default();
            let states = drag.distances.iter().map(|&s| state(depth, s, drag.direction)).collect();
            Path { states, stopped: None }
        });
        Some(PointPaths { press: Path { states: press, stopped: None }, drags: drags.collect() })
    }
}
