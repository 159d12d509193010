//! What several of the verification tests need.

#![allow(dead_code, reason = "each test takes what it needs")]

use glam::DVec3;
use palpate_simulate::{Fixed, Material, Model, Path, TetMesh};
use std::sync::atomic::AtomicBool;

/// Numbers of a table with one line of header.
pub fn numbers(text: &str) -> Vec<Vec<f64>> {
    let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    rows.map(|row| row.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect()).collect()
}

/// Nodes are held along the axes that `axes` says of their place.
pub fn hold(mesh: &TetMesh, axes: impl Fn(DVec3) -> [bool; 3]) -> Vec<Fixed> {
    let fixed = mesh.positions.iter().enumerate();
    let fixed = fixed.map(|(node, p)| Fixed { node: node as u32, axes: axes(*p) });
    fixed.filter(|fixed| fixed.axes.contains(&true)).collect()
}

/// Moves nodes of a body of one material; says what it took.
pub fn moved(
    mesh: &TetMesh,
    material: &Material,
    fixed: &[Fixed],
    nodes: &[Fixed],
    way: &[DVec3],
) -> (Path, Model) {
    let start = std::time::Instant::now();
    let model = Model::new(mesh.clone(), vec![material.clone(); mesh.region_names.len()], fixed).unwrap();
    let (path, counts) = model.move_nodes(nodes, way, &AtomicBool::new(false)).unwrap();
    println!("{} unknowns, {:.1} s, {counts:?}", model.unknowns(), start.elapsed().as_secs_f64());
    (path, model)
}
