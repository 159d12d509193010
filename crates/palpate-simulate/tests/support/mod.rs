//! What several of the verification tests need.

#![allow(dead_code, reason = "each test takes what it needs")]

use glam::DVec3;
use palpate_simulate::material::Bulk;
use palpate_simulate::{Fixed, Material, Model, Path, TetMesh};
use std::f64::consts::FRAC_PI_2;
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

/// A unit cube of n³ cells, each of six tetrahedra, its inner nodes shaken so that no order is a gift of symmetry.
pub fn cube(n: usize) -> TetMesh {
    let mut positions = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            for k in 0..=n {
                let p = DVec3::new(i as f64, j as f64, k as f64) / n as f64;
                let inside = [i, j, k].iter().all(|&c| c > 0 && c < n);
                // Smooth, so that elements stay as well shaped on finer meshes.
                let shift =
                    DVec3::new((7.0 * p.y).sin(), (7.0 * p.z).sin(), (7.0 * p.x).sin()) * (0.12 / n as f64);
                positions.push(if inside { p + shift } else { p });
            }
        }
    }
    let tetrahedra = kuhn_tetrahedra([n; 3]);
    TetMesh::from_corners(positions, &tetrahedra)
}

/// Corners of six tetrahedra for each cell of a grid, around the cell's diagonal from its lowest to its highest corner.
fn kuhn_tetrahedra(cells: [usize; 3]) -> Vec<[u32; 4]> {
    let index = |at: [usize; 3]| ((at[0] * (cells[1] + 1) + at[1]) * (cells[2] + 1) + at[2]) as u32;
    let mut tetrahedra = Vec::new();
    for i in 0..cells[0] {
        for j in 0..cells[1] {
            for k in 0..cells[2] {
                for [a, b] in [[0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2]] {
                    // From corner to corner along one axis after another.
                    let mut at = [i, j, k];
                    let mut corners = [index(at); 4];
                    at[a] += 1;
                    corners[1] = index(at);
                    at[b] += 1;
                    corners[2] = index(at);
                    corners[3] = index([i + 1, j + 1, k + 1]);
                    tetrahedra.push(corners);
                }
            }
        }
    }
    tetrahedra
}

/// A block between planes across x, y and z (m, ascending), six tetrahedra a cell.
pub fn kuhn_grid(planes: [Vec<f64>; 3]) -> TetMesh {
    let mut positions = Vec::new();
    for &x in &planes[0] {
        for &y in &planes[1] {
            positions.extend(planes[2].iter().map(|&z| DVec3::new(x, y, z)));
        }
    }
    TetMesh::from_corners(positions, &kuhn_tetrahedra(planes.map(|p| p.len() - 1)))
}

/// A quarter of a disc with a layer under it: rings at the radii `rings` (m, ascending from the centre), planes at the
/// depths `planes` (m, ascending from the surface z = 0).
pub fn quarter_disc(rings: &[f64], planes: &[f64]) -> TetMesh {
    let between = |knots: &[f64], t: f64| {
        let i = (t.floor() as usize).min(knots.len() - 2);
        knots[i] + (t - i as f64) * (knots[i + 1] - knots[i])
    };
    let count = |knots: &[f64]| (0..knots.len()).map(|i| i as f64).collect::<Vec<_>>();
    let mut mesh = kuhn_grid([count(rings), count(rings), count(planes)]);
    for p in &mut mesh.positions {
        // Squares become rings; the surface is up.
        let (large, small) = (p.x.max(p.y), p.x.min(p.y));
        let angle = if large > 0.0 { 0.5 * FRAC_PI_2 * small / large } else { 0.0 };
        let angle = if p.y > p.x { FRAC_PI_2 - angle } else { angle };
        let r = between(rings, large);
        *p = DVec3::new(r * angle.cos(), r * angle.sin(), -between(planes, p.z));
    }
    // The map may turn all tetrahedra over.
    for element in &mut mesh.elements {
        let p = element.map(|n| mesh.positions[n as usize]);
        if (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) < 0.0 {
            let [a, b, c, d, ab, bc, ca, ad, bd, cd] = *element;
            *element = [a, b, d, c, ab, bd, ad, ca, bc, cd];
        }
    }
    mesh
}

/// The law that a table's `model` column means.
pub fn named(model: &str) -> Material {
    let (mu, bulk) = (1e4 / 2.9, Bulk::ModulusPa(1e5 / 3.0));
    match model {
        "neo_hooke" => Material::isochoric_neo_hookean(1e4, 0.45),
        "neo_hooke_log" => Material::neo_hookean(1e4, 0.45),
        "mooney_rivlin" => Material::mooney_rivlin(1000.0, mu / 2.0 - 1000.0, bulk),
        "ogden1" => Material::ogden(vec![[mu, 6.0]], bulk),
        "yeoh" => Material::yeoh(vec![mu / 2.0, 500.0, 100.0], bulk),
        "demiray_fung" => Material::fung_demiray(mu, 2.0, bulk),
        "veronda_westmann" => Material::veronda_westmann(mu / 2.0, 2.0, bulk),
        other => panic!("the table has a model {other} that this test does not know"),
    }
    .unwrap()
}
