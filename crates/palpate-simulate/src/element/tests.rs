use super::*;
use crate::material::Bulk;
use crate::mesh::TetMesh;
use crate::model::{Fixed, Model};
use glam::{DMat3, DQuat};
use std::sync::atomic::AtomicBool;

/// One of each law; with ν = 0.499 nearly all of the bulk modulus acts on the mean.
fn tissues() -> Vec<Tissue> {
    let bulk = Bulk::PoissonRatio(0.499);
    let laws = vec![
        Material::neo_hookean(1e4, 0.499),
        Material::neo_hookean(1e4, 0.3),
        Material::isochoric_neo_hookean(1e4, 0.49),
        Material::mooney_rivlin(1000.0, 700.0, bulk),
        Material::ogden(vec![[1000.0, 4.7], [500.0, -2.0]], bulk),
        Material::yeoh(vec![1200.0, -90.0, 31.0], bulk),
        Material::fung_demiray(1000.0, 1.3, bulk),
        Material::veronda_westmann(900.0, 1.1, bulk),
        Material::st_venant_kirchhoff(1e4, 0.499),
        Material::linear(1e4, 0.499),
    ];
    laws.into_iter().map(|law| Tissue::new(law.unwrap())).collect()
}

/// Numbers from −1 to 1, the same every time.
fn noise(n: usize) -> f64 {
    let x = (n as f64 + 1.0) * 0.754_877_666_246_692_7;
    2.0 * (x * x * 61.8).fract() - 1.0
}

/// An element with curved edges.
fn nodes() -> [DVec3; 10] {
    let corners =
        [DVec3::ZERO, DVec3::new(1.0, 0.1, 0.0), DVec3::new(0.2, 0.9, -0.1), DVec3::new(0.1, 0.2, 1.1)];
    std::array::from_fn(|n| match n.checked_sub(4) {
        None => corners[n],
        Some(edge) => {
            let [a, b] = crate::mesh::EDGES[edge];
            0.5 * (corners[a] + corners[b])
                + 0.03 * DVec3::new(noise(3 * n), noise(3 * n + 1), noise(3 * n + 2))
        }
    })
}

/// Displacements of a turn followed by noise.
fn displacements(turn: DMat3, size: f64) -> [f64; 30] {
    let nodes = nodes();
    std::array::from_fn(|k| {
        let p = nodes[k / 3];
        (turn * p - p + DVec3::new(0.3, -0.1, 0.2))[k % 3] + size * noise(100 + k)
    })
}

#[test]
fn forces_and_stiffness_are_derivatives() {
    let points = gauss_points(nodes()).unwrap();
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.3, 0.8));
    for tissue in tissues() {
        for u in [displacements(turn, 0.06), displacements(DMat3::IDENTITY, 1e-3)] {
            let mut found = Contribution::default();
            tissue.contribute(&points, &u, &mut found);
            let what = format!("{:?}", tissue.material);
            assert!((found.energy - tissue.energy(&points, &u)).abs() <= 1e-13 * found.energy, "{what}");
            let scale = found.stiffness.iter().flatten().fold(0.0, |m: f64, k| m.max(k.abs()));
            let mut alone = [0.0; 30];
            assert!(tissue.forces(&points, &u, &mut alone), "{what}");
            for (alone, force) in alone.iter().zip(&found.force) {
                assert!(
                    (alone - force).abs() < 1e-13 * scale,
                    "{what}: {alone} N alone, {force} N with stiffness"
                );
            }
            let step = 1e-5;
            for column in 0..30 {
                let at = |x: f64| {
                    let mut moved = u;
                    moved[column] += x;
                    let mut contribution = Contribution::default();
                    tissue.contribute(&points, &moved, &mut contribution);
                    contribution
                };
                let (ahead, behind) = (at(step), at(-step));
                let slope = (ahead.energy - behind.energy) / (2.0 * step);
                let error = (slope - found.force[column]).abs() / scale;
                assert!(error < 1e-8, "{what}: force {column} is off by {error}");
                let (b, k) = (column / 3, column % 3);
                for row in 0..30 {
                    let (a, i) = (row / 3, row % 3);
                    let slope = (ahead.force[row] - behind.force[row]) / (2.0 * step);
                    let entry = if a >= b {
                        found.stiffness[a * (a + 1) / 2 + b][3 * i + k]
                    } else {
                        found.stiffness[b * (b + 1) / 2 + a][3 * k + i]
                    };
                    let error = (slope - entry).abs() / scale;
                    assert!(error < 1e-7, "{what}: entry ({row}, {column}) is off by {error}");
                }
            }
        }
    }
}

#[test]
fn a_turned_element_stores_nothing() {
    let points = gauss_points(nodes()).unwrap();
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 1.4, -0.3, 2.8));
    for tissue in tissues() {
        let linear = matches!(tissue.material, Material::Linear { .. });
        let turn = if linear { DMat3::IDENTITY } else { turn };
        let mut found = Contribution::default();
        tissue.contribute(&points, &displacements(turn, 0.0), &mut found);
        let modulus = tissue.material.bulk_pa();
        let largest = found.force.iter().fold(0.0, |m: f64, f| m.max(f.abs()));
        assert!(found.energy.abs() < 1e-15 * modulus, "{:?}: {} J", tissue.material, found.energy);
        assert!(largest < 1e-13 * modulus, "{:?}: {largest} N", tissue.material);
    }
}

/// Cells of six tetrahedra, their nodes put in place by `place` (edge nodes too).
fn grid(cells: [usize; 3], place: impl Fn(DVec3) -> DVec3) -> TetMesh {
    let [n, m, l] = cells;
    let index = |at: [usize; 3]| ((at[0] * (m + 1) + at[1]) * (l + 1) + at[2]) as u32;
    let (mut positions, mut tetrahedra) = (Vec::new(), Vec::new());
    for i in 0..=n {
        for j in 0..=m {
            for k in 0..=l {
                positions.push(DVec3::new(i as f64 / n as f64, j as f64 / m as f64, k as f64 / l as f64));
                if i < n && j < m && k < l {
                    for [a, b] in [[0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2]] {
                        let mut at = [i, j, k];
                        at[a] += 1;
                        let second = index(at);
                        at[b] += 1;
                        tetrahedra.push([index([i, j, k]), second, index(at), index([i + 1, j + 1, k + 1])]);
                    }
                }
            }
        }
    }
    let mut mesh = TetMesh::from_corners(positions, &tetrahedra);
    mesh.positions.iter_mut().for_each(|p| *p = place(*p));
    mesh
}

/// Force and energy for driving nodes along their axes, in plane strain; with the volumetric energy split, or all of it point by
/// point (`plain`).
fn reaction(
    mesh: &TetMesh,
    poisson: f64,
    axes: impl Fn(usize) -> [bool; 3],
    drive: impl Fn(usize) -> Option<(Fixed, DVec3)>,
    plain: bool,
) -> (DVec3, f64) {
    let nodes = 0..mesh.positions.len();
    let fixed: Vec<Fixed> = nodes.clone().map(|n| Fixed { node: n as u32, axes: axes(n) }).collect();
    let material = Material::linear(1e4, poisson).unwrap();
    let mut model = Model::new(mesh.clone(), vec![material], &fixed).unwrap();
    if plain {
        let tissue = &mut model.tissues[0];
        (tissue.pointwise_pa, tissue.mean_pa) = (tissue.pointwise_pa + tissue.mean_pa, 0.0);
        let zero = vec![0.0; model.held.len()];
        let mut stiffness = crate::stiffness::Stiffness::default();
        model.assemble(&zero, &mut zero.clone(), &mut stiffness);
        model.rest_stiffness = stiffness;
    }
    let driven: Vec<(Fixed, DVec3)> = nodes.filter_map(drive).collect();
    let deformed = model.displace(&driven, 1, &AtomicBool::new(false)).unwrap().unwrap();
    let force = driven.iter().map(|(f, _)| deformed.force_n[f.node as usize]).sum();
    (force, deformed.energy_j)
}

/// Cook's membrane, 48 mm long, in plane strain: clamped on the left, its right edge lifted. Force for each mm of it.
fn cook(n: usize, poisson: f64, plain: bool) -> f64 {
    let mesh = grid([n, n, 1], |p| {
        let (low, high) = (44.0 * p.x, 44.0 + 16.0 * p.x);
        DVec3::new(48.0 * p.x, low + p.y * (high - low), 5.0 * p.z) * 1e-3
    });
    let at = |n: usize| mesh.positions[n];
    let clamped = |n: usize| [at(n).x < 1e-9, at(n).x < 1e-9, true];
    let lifted = |n: usize| {
        (at(n).x > 0.048 - 1e-9)
            .then(|| (Fixed { node: n as u32, axes: [false, true, false] }, DVec3::Y * 1e-5))
    };
    reaction(&mesh, poisson, clamped, lifted, plain).0.y / 1e-2
}

/// A quarter of a thick tube, radii 10 and 20 mm, 5 mm of it in plane strain, widened from inside; energy against
/// Lamé's exact one.
fn tube(n: usize, poisson: f64, plain: bool) -> f64 {
    let (inner, outer, length, widening) = (0.01, 0.02, 0.005, 1e-5);
    let mesh = grid([n, 2 * n, 1], |p| {
        let (r, angle) = (inner + (outer - inner) * p.x, std::f64::consts::FRAC_PI_2 * p.y);
        DVec3::new(r * angle.cos(), r * angle.sin(), length * p.z)
    });
    let at = |n: usize| mesh.positions[n];
    let planes = |n: usize| [at(n).x.abs() < 1e-9, at(n).y.abs() < 1e-9, true];
    let inside = |n: usize| {
        let outwards = DVec3::new(at(n).x, at(n).y, 0.0);
        let on = outwards.length() < inner * (1.0 + 1e-6);
        on.then(|| (Fixed { node: n as u32, axes: [true, true, false] }, outwards / inner * widening))
    };
    let (_, energy) = reaction(&mesh, poisson, planes, inside, plain);
    let lame = (1.0 + poisson) / 1e4 * inner * inner / (outer * outer - inner * inner)
        * ((1.0 - 2.0 * poisson) * inner + outer * outer / inner);
    let pressure = widening / lame;
    energy / (0.5 * pressure * widening * std::f64::consts::FRAC_PI_2 * inner * length)
}

#[test]
fn nearly_incompressible_bodies_do_not_lock() {
    println!("| ν | Cook n = 2 | 4 | 8 | plain n = 2 | 4 | 8 | tube n = 2 | 4 | plain n = 2 | 4 |");
    let mut worst = Vec::new();
    for poisson in [0.3, 0.45, 0.49, 0.499] {
        let fine = cook(16, poisson, false);
        let ours = [2, 4, 8].map(|n| cook(n, poisson, false) / fine - 1.0);
        let plain = [2, 4, 8].map(|n| cook(n, poisson, true) / fine - 1.0);
        let tubes = [2, 4].map(|n| tube(n, poisson, false) - 1.0);
        let plain_tubes = [2, 4].map(|n| tube(n, poisson, true) - 1.0);
        print!("| {poisson} |");
        for error in ours.iter().chain(&plain).chain(&tubes).chain(&plain_tubes) {
            print!(" {:+.2} % |", 100.0 * error);
        }
        println!();
        worst.push((ours[1], plain[1], tubes[0], plain_tubes[0]));
    }
    // From ν = 0.45 to 0.499 the error grows by a quarter; without the split, to nearly three times.
    let (at_45, at_499) = (worst[1], worst[3]);
    assert!(at_499.0 < 1.35 * at_45.0 && at_499.1 > 2.5 * at_45.1, "{at_45:?} {at_499:?}");
    assert!(at_499.2.abs() < 3e-3 && at_499.3 > 3.0 * at_499.2, "{at_499:?}");
}
