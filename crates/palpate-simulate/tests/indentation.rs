//! Indentation against exact solutions: a sphere on a half space, a flat punch on a layer.

mod support;

use glam::DVec3;
use palpate_body::shape::Shape;
use palpate_simulate::mesh::shape::fill;
use palpate_simulate::mesh::stuffing::{FillOptions, Finer};
use palpate_simulate::{Contact, Fixed, Material, Model, PointPlan, RigidTool, TetMesh};
use std::sync::atomic::AtomicBool;
use support::{hold, moved, quarter_disc};

const YOUNG_PA: f64 = 1e4;

/// Force (N) at depths (m) of a frictionless sphere on the corner of a quarter of a half space, whose elements within
/// 1.2 contact radii have that edge.
fn sphere(radius_m: f64, contact_m: f64, edge_m: f64, poisson: f64, depths: &[f64]) -> Vec<f64> {
    // A force on a half space still moves it by 0.42 contact radii over the distance, of the depth, far away: 0.2 %
    // of the force remain as the block's error.
    let side_m = 250.0 * contact_m;
    let block = Shape::Block { size_mm: [1e3 * side_m; 3] };
    let corner = DVec3::new(-0.5, -0.5, 0.5) * side_m;
    let mut options = FillOptions::new((side_m / 4.0).min(250.0 * edge_m));
    options.finer.push(Finer::around(corner, 1.2 * contact_m, edge_m));
    let (mesh, _) = fill(&block, &options).unwrap();
    let fixed = hold(&mesh, |p| {
        let bottom = p.z < -0.5 * side_m * (1.0 - 1e-9);
        let plane = |x: f64| x < -0.5 * side_m * (1.0 - 1e-9);
        [bottom || plane(p.x), bottom || plane(p.y), bottom]
    });
    let start = std::time::Instant::now();
    let nodes = mesh.positions.len();
    let model = Model::new(mesh, vec![Material::linear(YOUNG_PA, poisson).unwrap()], &fixed).unwrap();
    let plan = PointPlan { point: corner, inward: DVec3::NEG_Z, depths: depths.to_vec(), drags: vec![] };
    let tool = RigidTool::Sphere { radius_m };
    let (paths, counts) =
        model.simulate_counted(&tool, Contact::Frictionless, &plan, &AtomicBool::new(false)).unwrap();
    assert_eq!(paths.press.stopped, None);
    println!("{nodes} nodes, {:.1} s, {counts:?}", start.elapsed().as_secs_f64());
    paths.press.states.iter().map(|state| -4.0 * state.force_n.z).collect()
}

/// Hertz 1882: F = 4/3 E/(1 − ν²) √R d^(3/2).
fn hertz(radius_m: f64, poisson: f64, depth_m: f64) -> f64 {
    4.0 / 3.0 * YOUNG_PA / (1.0 - poisson * poisson) * radius_m.sqrt() * depth_m.powf(1.5)
}

/// So shallow (a thousandth of the radius) that a sphere is Hertz's paraboloid; an edge of a quarter of the contact
/// radius.
#[test]
fn sphere_on_a_half_space() {
    let (radius, depth): (f64, f64) = (0.1, 1e-4);
    let contact = (radius * depth).sqrt();
    for (poisson, most) in [(0.3, 8e-3), (0.49, 3e-3)] {
        let found = sphere(radius, contact, contact / 4.0, poisson, &[0.5 * depth, depth])[1];
        let error = found / hertz(radius, poisson, depth) - 1.0;
        println!("ν = {poisson}: {found:.5e} N, {:+.2} %", 100.0 * error);
        assert!(error.abs() < most, "ν = {poisson}: {found} N is off by {error}");
    }
}

/// R = 10 mm, small strain, against an axisymmetric solution with FElupe (0.08 mm elements): deeper, a sphere is no
/// paraboloid.
#[test]
#[ignore = "some minutes"]
fn sphere_deeper() {
    for (poisson, expected) in [
        (0.3, [1.4810816e-3, 7.7756643e-3, 1.6806376e-2]),
        (0.49, [1.7422017e-3, 9.0345664e-3, 1.9356984e-2]),
    ] {
        let found = sphere(0.01, 2.236e-3, 4e-4, poisson, &[1e-4, 3e-4, 5e-4]);
        for (found, expected) in found.iter().zip(expected) {
            println!(
                "ν = {poisson}: {found:.5e} N, reference {expected:.5e}, {:+.2} %",
                100.0 * (found / expected - 1.0)
            );
            assert!((found / expected - 1.0).abs() < 6e-3);
        }
    }
}

/// How fine must the mesh be? Prints errors against elements per contact radius.
#[test]
#[ignore = "a table; some minutes"]
fn table_of_sphere() {
    let (radius, depth): (f64, f64) = (0.1, 1e-4);
    let contact = (radius * depth).sqrt();
    for poisson in [0.3, 0.49] {
        for per_radius in [0.25, 0.5, 1.0, 2.0, 4.0] {
            let found = sphere(radius, contact, contact / per_radius, poisson, &[0.5 * depth, depth])[1];
            let error = found / hertz(radius, poisson, depth) - 1.0;
            println!("| {poisson} | {per_radius} | {:+.2} % |", 100.0 * error);
        }
    }
}

/// How far forces of one depth are from their mean at two places on a block that only the elements under them tell apart: a ball of
/// 6 mm, sticking, on elements of that edge (mm) around the places.
fn spread_over_places(edge_mm: f64, depths_mm: &[f64]) -> Vec<f64> {
    let block = Shape::Block { size_mm: [48.0, 48.0, 24.0] };
    let top = DVec3::Z * 0.012;
    let mut options = FillOptions::new(6e-3);
    options.finer.push(Finer::around(top, 8e-3, 1e-3 * edge_mm));
    let (mesh, _) = fill(&block, &options).unwrap();
    let fixed = hold(&mesh, |p| [p.z < -0.012 * (1.0 - 1e-9); 3]);
    println!("elements of {edge_mm} mm: {} nodes", mesh.positions.len());
    let model = Model::new(mesh, vec![Material::neo_hookean(5e3, 0.45).unwrap()], &fixed).unwrap();
    // A corner of an element, and within one.
    let places = [top, top + DVec3::new(2.5e-3, 1.25e-3, 0.0)];
    let forces = places.map(|point| {
        let depths = depths_mm.iter().map(|d| 1e-3 * d).collect();
        let plan = PointPlan { point, inward: DVec3::NEG_Z, depths, drags: vec![] };
        let tool = RigidTool::Sphere { radius_m: 6e-3 };
        let press = model.simulate(&tool, Contact::Sticking, &plan, &AtomicBool::new(false)).unwrap().press;
        press.states.iter().map(|state| -state.force_n.z).collect::<Vec<f64>>()
    });
    let spread = |(i, depth): (usize, &f64)| {
        let [one, other] = [0, 1].map(|place| forces[place][i]);
        let spread = (one - other).abs() / (one + other);
        println!("{depth} mm deep: {one:.4} and {other:.4} N, ±{:.1} %", 100.0 * spread);
        spread
    };
    depths_mm.iter().enumerate().map(spread).collect()
}

/// With elements of half the ball's radius, a spec's default, an element's corner and a place within it have one force to 1 %, from a
/// fifth of the radius on; with elements as long as the radius they differ by several per cent.
#[test]
fn forces_do_not_depend_on_where_the_elements_lie() {
    let depths = [1.2, 2.4, 3.6];
    let half = spread_over_places(3.0, &depths);
    let whole = spread_over_places(6.0, &depths);
    assert!(half.iter().all(|s| *s < 0.01));
    assert!(whole.iter().any(|s| *s > 0.03));
}

/// A punch's radius a, and how deep it is pressed, m.
const PUNCH_M: (f64, f64) = (0.01, 1e-4);

/// κ of F = 2 E a d κ/(1 − ν²) (Hayes et al. 1972), from the force (N) on a quarter of the punch.
fn kappa(quarter_n: f64, poisson: f64) -> f64 {
    let (radius, depth) = PUNCH_M;
    4.0 * quarter_n * (1.0 - poisson * poisson) / (2.0 * YOUNG_PA * radius * depth)
}

/// A quarter of a layer of a/h = `per_height` that is bonded below; elements at the punch's rim are `finest` radii large.
fn quarter(per_height: f64, finest: f64) -> (TetMesh, Vec<Fixed>) {
    let (radius, _) = PUNCH_M;
    let height = radius / per_height;
    // Towards the rim of the punch from both sides, then outwards to five heights beyond.
    let mut inwards = vec![radius];
    let mut outwards = vec![];
    let mut step = finest * radius;
    while inwards[inwards.len() - 1] > 1.7 * step {
        inwards.push(inwards[inwards.len() - 1] - step);
        outwards.push(2.0 * radius - inwards[inwards.len() - 1]);
        step = (1.6 * step).min(0.3 * radius);
    }
    inwards.push(0.0);
    inwards.reverse();
    let mut rings = inwards;
    rings.extend(outwards);
    while rings[rings.len() - 1] < radius + 4.0 * height {
        rings.push(rings[rings.len() - 1] + step);
        step *= 1.5;
    }
    let mut planes = vec![0.0];
    let mut step = finest * radius;
    while planes[planes.len() - 1] + 1.6 * step < height {
        planes.push(planes[planes.len() - 1] + step);
        step = (1.6 * step).min(0.3 * height);
    }
    planes.push(height);
    let mesh = quarter_disc(&rings, &planes);
    let fixed = hold(&mesh, |p| {
        let bottom = p.z < -height * (1.0 - 1e-9);
        [bottom || p.x.abs() < 1e-12, bottom || p.y.abs() < 1e-12, bottom]
    });
    (mesh, fixed)
}

/// κ of a punch whose surface nodes are moved down, along the axis only.
fn hayes(per_height: f64, poisson: f64, finest: f64) -> f64 {
    let (radius, depth) = PUNCH_M;
    let (mesh, fixed) = quarter(per_height, finest);
    let punch: Vec<Fixed> = hold(&mesh, |p| {
        let under = p.z > -1e-12 && p.x.hypot(p.y) < radius * (1.0 + 1e-6);
        [false, false, under]
    });
    let material = Material::linear(YOUNG_PA, poisson).unwrap();
    let (path, _) = moved(&mesh, &material, &fixed, &punch, &[DVec3::NEG_Z * depth]);
    kappa(-path.states[0].force_n.z, poisson)
}

/// κ of the tool that a spec's `shape = "flat-punch"` presses with, in frictionless contact: `radius` and the rounding of
/// its rim, `edge`, by the radius of Hayes' punch.
fn hayes_by_tool(per_height: f64, poisson: f64, finest: f64, [radius, edge]: [f64; 2]) -> f64 {
    let (unit, depth) = PUNCH_M;
    let (mesh, fixed) = quarter(per_height, finest);
    let nodes = mesh.positions.len();
    let start = std::time::Instant::now();
    let model = Model::new(mesh, vec![Material::linear(YOUNG_PA, poisson).unwrap()], &fixed).unwrap();
    let tool = RigidTool::FlatPunch { radius_m: radius * unit, edge_m: edge * unit };
    let plan = PointPlan {
        point: DVec3::ZERO,
        inward: DVec3::NEG_Z,
        depths: vec![depth / 2.0, depth],
        drags: vec![],
    };
    let paths = model.simulate(&tool, Contact::Frictionless, &plan, &AtomicBool::new(false)).unwrap();
    assert_eq!(paths.press.stopped, None);
    println!("{nodes} nodes, {:.1} s", start.elapsed().as_secs_f64());
    kappa(-paths.press.states[1].force_n.z, poisson)
}

/// κ from an integral equation, confirmed with FElupe and CalculiX to 0.1 %; elements of a/25 at the rim.
#[test]
fn flat_punch_on_a_layer() {
    for (per_height, poisson, expected) in [(0.5, 0.3, 1.62403), (1.0, 0.49, 3.48398)] {
        let error = hayes(per_height, poisson, 0.04) / expected - 1.0;
        println!("a/h = {per_height}, ν = {poisson}: {:+.2} %", 100.0 * error);
        assert!(error.abs() < 0.011, "a/h = {per_height}, ν = {poisson}: κ is off by {error}");
    }
}

/// The tool itself. It touches with its flat part and a little of the rounded rim: by its outer radius it is too soft.
#[test]
fn flat_punch_as_a_tool() {
    let (per_height, poisson, expected) = (1.0, 0.45, 3.09141);
    for (size, least, most) in [([1.0, 0.02], -0.032, -0.026), ([1.02, 0.02], 0.0, 0.006)] {
        let found = hayes_by_tool(per_height, poisson, 0.04, size);
        let error = found / expected - 1.0;
        println!("radius, edge {size:?} a: {found:.4}, {:+.2} %", 100.0 * error);
        assert!(error > least && error < most, "{size:?} a: {found}, not {expected}");
    }
}

#[test]
#[ignore = "a table; some minutes"]
fn table_of_flat_punch_as_a_tool() {
    for (per_height, poisson, expected) in [(0.5, 0.3, 1.62403), (1.0, 0.45, 3.09141), (1.0, 0.49, 3.48398)] {
        for finest in [0.04, 0.02] {
            for size in [[1.0, 0.02], [1.02, 0.02]] {
                let found = hayes_by_tool(per_height, poisson, finest, size);
                let error = 100.0 * (found / expected - 1.0);
                println!("| {per_height} | {poisson} | {finest} a | {size:?} a | {error:+.2} % |");
            }
        }
    }
}

#[test]
#[ignore = "a table; a minute"]
fn table_of_flat_punch() {
    for (per_height, poisson, expected) in [
        (0.5, 0.3, 1.62403),
        (0.5, 0.45, 1.80626),
        (0.5, 0.49, 1.90275),
        (1.0, 0.3, 2.48352),
        (1.0, 0.45, 3.09141),
        (1.0, 0.49, 3.48398),
    ] {
        for finest in [0.16, 0.08, 0.04, 0.02] {
            let found = hayes(per_height, poisson, finest);
            println!("| {per_height} | {poisson} | {finest} | {:+.2} % |", 100.0 * (found / expected - 1.0));
        }
    }
}
