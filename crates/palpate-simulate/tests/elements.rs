//! Elements in an assembly: patch tests and closed forms. Forces and stiffness as derivatives, rigid motion and locking
//! are tested inside the crate.

mod support;

use glam::{DMat3, DVec3};
use palpate_simulate::material::{Bulk, Density, Material, Tensor};
use palpate_simulate::{Deformed, Fixed, Model, TetMesh};
use std::sync::atomic::AtomicBool;
use support::{cube, hold, named};

/// One of each law, of some kPa, nearly incompressible.
fn laws() -> Vec<Material> {
    let bulk = Bulk::PoissonRatio(0.49);
    vec![
        Material::neo_hookean(1e4, 0.49).unwrap(),
        Material::isochoric_neo_hookean(1e4, 0.3).unwrap(),
        Material::mooney_rivlin(1000.0, 700.0, bulk).unwrap(),
        Material::ogden(vec![[1000.0, 4.7], [500.0, -2.0]], bulk).unwrap(),
        Material::yeoh(vec![1200.0, -90.0, 31.0], bulk).unwrap(),
        Material::fung_demiray(1000.0, 1.3, bulk).unwrap(),
        Material::veronda_westmann(900.0, 1.1, bulk).unwrap(),
        Material::st_venant_kirchhoff(1e4, 0.4).unwrap(),
        Material::linear(1e4, 0.49).unwrap(),
    ]
}

/// ψ and P of the whole law.
fn law(material: &Material, f: &Tensor) -> (f64, Tensor) {
    let mut density = Density::default();
    material.distortion(f, &mut density);
    let theta = material.measure().evaluate(f);
    let k = material.bulk_pa();
    let stress = std::array::from_fn(|r| density.stress[r] + k * theta.value * theta.gradient[r]);
    (density.energy + 0.5 * k * theta.value * theta.value, stress)
}

/// Holds a unit cube at three corners as any upper triangular F does.
fn supports(mesh: &TetMesh) -> Vec<Fixed> {
    hold(mesh, |p| {
        let at = |corner: DVec3| p.distance(corner) < 1e-12;
        [
            at(DVec3::ZERO),
            at(DVec3::ZERO) || at(DVec3::X),
            [DVec3::ZERO, DVec3::X, DVec3::Y].into_iter().any(at),
        ]
    })
}

/// Nodes for which `which` says so go where F takes them.
fn driven(mesh: &TetMesh, f: &Tensor, which: impl Fn(u32) -> bool) -> Vec<(Fixed, DVec3)> {
    let to = DMat3::from_cols_array(f).transpose() - DMat3::IDENTITY;
    let all = mesh.positions.iter().enumerate().filter(|(n, _)| which(*n as u32));
    all.map(|(n, p)| (Fixed { node: n as u32, axes: [true; 3] }, to * *p)).collect()
}

fn displaced(model: &Model, nodes: &[(Fixed, DVec3)], steps: u32) -> Deformed {
    model.displace(nodes, steps, &AtomicBool::new(false)).unwrap().unwrap()
}

/// Sum of the forces on the face x = 1.
fn pull(mesh: &TetMesh, deformed: &Deformed, axis: usize) -> DVec3 {
    let on = mesh.positions.iter().zip(&deformed.force_n).filter(|(p, _)| p[axis] > 1.0 - 1e-9);
    on.map(|(_, force)| *force).sum()
}

/// A field of constant strain on distorted elements is an equilibrium, stores ψ V, and pulls with P N at each face.
#[test]
fn patch_test() {
    let mesh = cube(3);
    let surface = mesh.boundary().nodes;
    let small = [1.0 + 1e-4, 2e-4, -1e-4, 0.0, 1.0 - 2e-4, 1e-4, 0.0, 0.0, 1.0 + 1.5e-4];
    let large = [1.25, 0.3, -0.2, 0.0, 0.85, 0.15, 0.0, 0.0, 0.95];
    for material in laws() {
        let model = Model::new(mesh.clone(), vec![material.clone()], &supports(&mesh)).unwrap();
        let modulus = material.small_strain().shear_pa;
        for f in [small, large] {
            let (energy, stress) = law(&material, &f);
            let size = stress.iter().fold(0.0, |m: f64, s| m.max(s.abs()));
            let check = |deformed: &Deformed, tolerance: f64, what: &str| {
                let error = (deformed.energy_j / energy - 1.0).abs();
                assert!(error < tolerance, "{material:?}, {what}: energy is off by {error}");
                for axis in 0..3 {
                    let expected = DVec3::new(stress[axis], stress[3 + axis], stress[6 + axis]);
                    let error = pull(&mesh, deformed, axis).distance(expected) / size;
                    assert!(error < tolerance, "{material:?}, {what}: pull on face {axis} is off by {error}");
                }
            };
            // Put there: nothing but rounding remains. (Stresses round with 1e-16 moduli, the bulk one too.)
            let there = displaced(&model, &driven(&mesh, &f, |_| true), 1);
            let rounding = 1e-13 * (modulus + material.bulk_pa()) / size;
            check(&there, 1e-12 + rounding, "put there");
            for node in (0..mesh.positions.len() as u32).filter(|n| surface.binary_search(n).is_err()) {
                let force = there.force_n[node as usize].length() / size;
                assert!(force < 1e-13 + rounding, "{material:?}: {force} at node {node}");
            }
            // Found, when only the surface is put there.
            let found = displaced(&model, &driven(&mesh, &f, |n| surface.binary_search(&n).is_ok()), 4);
            check(&found, 1e-5, "found");
            let far = found.displacement_m.iter().zip(&there.displacement_m).map(|(a, b)| a.distance(*b));
            let largest = there.displacement_m.iter().map(|u| u.length()).fold(0.0, f64::max);
            let far = far.fold(0.0, f64::max) / largest;
            assert!(far < 1e-4, "{material:?}: the inside is off by {far}");
        }
    }
}

/// Closed forms of uniaxial tension, and simple shear, by a cube of six elements: its sides free, or put where they go.
#[test]
fn closed_forms() {
    let mesh = cube(1);
    let planes = hold(&mesh, |p| [p.x == 0.0, p.y == 0.0, p.z == 0.0]);
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_reader(include_str!("data/compressible.csv").as_bytes());
    let header = reader.headers().unwrap().clone();
    let (mut checked, mut worst) = (0, [0.0f64; 2]);
    for row in reader.records() {
        let row = row.unwrap();
        let number = |column: &str| -> f64 {
            row[header.iter().position(|name| name == column).unwrap()].parse().unwrap_or(f64::NAN)
        };
        let (model, mode, stretch) = (&row[0], &row[1], number("value"));
        let material = named(model);
        if mode == "simple_shear" {
            let f = [1.0, stretch, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
            let body = Model::new(mesh.clone(), vec![material], &supports(&mesh)).unwrap();
            let (found, expected) = (
                pull(&mesh, &displaced(&body, &driven(&mesh, &f, |_| true), 1), 1).x,
                number("shear_stress"),
            );
            worst[0] = worst[0].max((found / expected - 1.0).abs());
            assert!(
                (found / expected - 1.0).abs() < 5e-10,
                "{model}, shear {stretch}: {found}, not {expected}"
            );
            checked += 1;
            continue;
        }
        let expected = number("nominal_stress");
        // The table's stretch across has ten digits; no stress across gives it all its digits.
        let mut lateral = number("lateral_stretch");
        let across = |s: f64| law(&material, &[stretch, 0.0, 0.0, 0.0, s, 0.0, 0.0, 0.0, s]).1[4];
        for _ in 0..3 {
            lateral -= across(lateral) * 2e-6 / (across(lateral + 1e-6) - across(lateral - 1e-6));
        }
        let f = [stretch, 0.0, 0.0, 0.0, lateral, 0.0, 0.0, 0.0, lateral];
        let body = Model::new(mesh.clone(), vec![material], &planes).unwrap();
        // Put there; then with the sides left free.
        for (k, free) in [false, true].into_iter().enumerate() {
            let mut nodes = driven(&mesh, &f, |_| true);
            if free {
                nodes.retain(|(fixed, _)| mesh.positions[fixed.node as usize].x == 1.0);
                nodes.iter_mut().for_each(|(fixed, _)| fixed.axes = [true, false, false]);
            }
            let found = pull(&mesh, &displaced(&body, &nodes, if free { 8 } else { 1 }), 0).x;
            let error = (found / expected - 1.0).abs();
            worst[k] = worst[k].max(error);
            // An equilibrium is found to a millionth of the force.
            let tolerance = [5e-10, 5e-7][k];
            assert!(error < tolerance, "{model}, {stretch}, free: {free}: {found}, not {expected}");
        }
        checked += 1;
    }
    println!("{checked} rows; worst error {worst:?}");
    assert_eq!(checked, 7 * 10);
}
