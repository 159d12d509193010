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

/// Integration over a tetrahedron: points (area coordinates) and weights that sum to one; exact to degree 5 (Keast
/// 1986, 15 points).
pub fn fine_rule() -> Vec<([f64; 4], f64)> {
    let root = 15f64.sqrt();
    let mut rule = vec![([0.25; 4], 16.0 / 135.0)];
    for sign in [1.0, -1.0] {
        let a = (7.0 - sign * root) / 34.0;
        for i in 0..4 {
            let mut at = [a; 4];
            at[i] = 1.0 - 3.0 * a;
            rule.push((at, (2665.0 + sign * 14.0 * root) / 37800.0));
        }
    }
    let (a, b) = ((10.0 - 2.0 * root) / 40.0, (10.0 + 2.0 * root) / 40.0);
    for i in 0..4 {
        for j in 0..i {
            let mut at = [a; 4];
            (at[i], at[j]) = (b, b);
            rule.push((at, 20.0 / 378.0));
        }
    }
    rule
}

/// The ten shape functions at area coordinates, and their derivatives by coordinates 1, 2, 3.
pub fn shape(at: [f64; 4]) -> ([f64; 10], [[f64; 3]; 10]) {
    const L: [[f64; 3]; 4] = [[-1.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let (mut values, mut slopes) = ([0.0; 10], [[0.0; 3]; 10]);
    for i in 0..10 {
        if i < 4 {
            values[i] = at[i] * (2.0 * at[i] - 1.0);
            slopes[i] = L[i].map(|l| (4.0 * at[i] - 1.0) * l);
        } else {
            let [a, b] = palpate_simulate::mesh::EDGES[i - 4];
            values[i] = 4.0 * at[a] * at[b];
            slopes[i] = std::array::from_fn(|k| 4.0 * (at[a] * L[b][k] + at[b] * L[a][k]));
        }
    }
    (values, slopes)
}
