//! Friction under a sphere on a half space, against closed forms: stuck stiffness (Mindlin 1949), partial slip (Cattaneo 1938,
//! Mindlin 1949), reciprocity (Betti), the friction cone, and what a loop dissipates.

mod support;

use glam::{DQuat, DVec3};
use palpate_body::shape::Shape;
use palpate_simulate::mesh::shape::fill;
use palpate_simulate::mesh::stuffing::{FillOptions, Finer};
use palpate_simulate::{
    Contact, Drag, FreePlan, FreePose, Material, Model, Path, PointPaths, PointPlan, RigidTool, StuckTangent,
};
use std::sync::atomic::AtomicBool;
use support::{hold, kuhn_grid};

const YOUNG_PA: f64 = 1e4;
const RADIUS_M: f64 = 0.1;
const DEPTH_M: f64 = 1e-4;
const POISSON: f64 = 0.3;
/// Pressed so, a body that keeps its volume has no lateral tractions under the sphere, as Cattaneo and Mindlin assume: at ν = 0.3
/// friction holds the surface back from moving inwards already, and 6 % of the limit are gone.
const UNSTRAINED: f64 = 0.49;

/// A half of a half space that is cut along y = 0, finer around the origin, where the sphere touches.
fn half_space(poisson: f64) -> Model {
    let contact = (RADIUS_M * DEPTH_M).sqrt();
    let side = 60.0 * contact;
    let block = Shape::Block { size_mm: [1e3 * side, 0.5e3 * side, 0.5e3 * side] };
    let centre = DVec3::new(0.0, -0.25, 0.25) * side;
    let mut options = FillOptions::new(side / 4.0);
    options.finer.push(Finer::around(centre, 1.1 * contact, contact / 2.0));
    let (mut mesh, _) = fill(&block, &options).unwrap();
    mesh.positions.iter_mut().for_each(|p| *p -= centre);
    println!("{} nodes", mesh.positions.len());
    let low = 0.5 * side * (1.0 - 1e-9);
    let fixed = hold(&mesh, |p| {
        let far = p.z < -low || p.x.abs() > low || p.y > low;
        [far, far || p.y < 1e-9 * side, far]
    });
    Model::new(mesh, vec![Material::linear(YOUNG_PA, poisson).unwrap()], &fixed).unwrap()
}

/// The half of a block that is cut along y = 0: planes so many m times `half` from the middle of its top, and times `z` below.
fn half_block(unit_m: f64, half: &[f64], z: &[f64], material: Material) -> Model {
    let x: Vec<f64> = half.iter().skip(1).rev().map(|x| -x).chain(half.iter().copied()).collect();
    let z: Vec<f64> = z.iter().rev().map(|z| -z).collect();
    let low = unit_m * z[0] * (1.0 - 1e-9);
    let mesh = kuhn_grid([x, half.to_vec(), z].map(|p| p.iter().map(|p| unit_m * p).collect()));
    println!("{} nodes", mesh.positions.len());
    let fixed = hold(&mesh, |p| [p.z < low, p.z < low || p.y < 1e-9 * unit_m, p.z < low]);
    Model::new(mesh, vec![material], &fixed).unwrap()
}

fn pressed(model: &Model, contact: Contact, depths: &[f64], drags: Vec<Drag>) -> PointPaths {
    let plan = PointPlan { point: DVec3::ZERO, inward: DVec3::NEG_Z, depths: depths.to_vec(), drags };
    let tool = RigidTool::Sphere { radius_m: RADIUS_M };
    model.simulate(&tool, contact, &plan, &AtomicBool::new(false)).unwrap()
}

fn led(model: &Model, friction: f64, offsets: &[DVec3]) -> Path {
    led_with(model, RADIUS_M, &[(0.0, friction)], offsets)
}

/// With a coefficient over depth (m).
fn led_with(model: &Model, radius_m: f64, friction: &[(f64, f64)], offsets: &[DVec3]) -> Path {
    let poses = offsets.iter().map(|&offset| FreePose { offset, rotation: DQuat::IDENTITY }).collect();
    let plan = FreePlan { point: DVec3::ZERO, inward: DVec3::NEG_Z, poses, friction: friction.to_vec() };
    let tool = RigidTool::Sphere { radius_m };
    let path = model.follow(&tool, &plan, &AtomicBool::new(false)).unwrap();
    assert_eq!(path.stopped, None);
    path
}

/// Depths whose contact radii grow evenly.
fn depths(steps: u32) -> Vec<f64> {
    (1..=steps).map(|k| DEPTH_M * (f64::from(k) / f64::from(steps)).powi(2)).collect()
}

fn last_tangent(paths: &PointPaths) -> StuckTangent {
    **paths.press.states.last().unwrap().tangent.as_ref().unwrap()
}

/// k_t/k_n = 2(1 − ν)/(2 − ν), whatever the contact's size.
#[test]
fn stuck_stiffness_is_mindlins() {
    let model = half_space(POISSON);
    let tangent = last_tangent(&pressed(&model, Contact::Sticking, &depths(4), Vec::new()));
    let found = tangent[0][0] / tangent[2][2];
    let expected = 2.0 * (1.0 - POISSON) / (2.0 - POISSON);
    println!("k_t/k_n = {found:.4}, Mindlin {expected:.4}: {:+.2} %", 100.0 * (found / expected - 1.0));
    assert!((found / expected - 1.0).abs() < 0.015, "{found} against {expected}");
}

/// Of a frictionless press the drags stick, the second no less than the first: all that touches is pulled along from the first load step on.
#[test]
fn equal_drags_after_a_frictionless_press_are_equal() {
    let model = half_space(POISSON);
    let way = |direction| Drag { from: 1, direction, distances: vec![0.02 * DEPTH_M, 0.1 * DEPTH_M] };
    let drags = vec![way(DVec3::X), way(DVec3::X), way(DVec3::NEG_X)];
    let paths = pressed(&model, Contact::Frictionless, &depths(2), drags);
    let forces = |i: usize| -> Vec<DVec3> { paths.drags[i].states.iter().map(|s| s.force_n).collect() };
    for (once, again) in forces(0).into_iter().zip(forces(1)) {
        assert!(once.x > 1e-6 && (once.x - again.x).abs() < 1e-3 * once.x, "{once} {again}");
        assert!(once.distance(again) < 1e-4 * once.length(), "{once} {again}");
    }
    for (there, back) in forces(0).into_iter().zip(forces(2)) {
        assert!((there.x + back.x).abs() < 1e-2 * there.x, "{there} {back}");
    }
}

/// The tangent is the derivative of the force: a drag of a hundredth of the depth finds the same, in all its components, and it is
/// symmetric (Betti), though the two drags share nothing with it but the pressed state.
#[test]
fn the_stuck_tangent_is_the_forces_derivative() {
    let model = half_space(POISSON);
    let step = 0.01 * DEPTH_M;
    let drags = vec![
        Drag { from: 2, direction: DVec3::X, distances: vec![step] },
        Drag { from: 2, direction: DVec3::NEG_X, distances: vec![step] },
    ];
    let depths = [0.5 * DEPTH_M, 0.99 * DEPTH_M, DEPTH_M, 1.01 * DEPTH_M];
    let paths = pressed(&model, Contact::Sticking, &depths, drags);
    let states = &paths.press.states;
    let tangent = states[2].tangent.as_ref().unwrap();
    let [forth, back] = [0, 1].map(|i| paths.drags[i].states[0].force_n);
    let lateral = (forth - back) / (2.0 * step);
    let pressing = (states[3].force_n - states[1].force_n) / -(2.0 * step);
    println!("by x {lateral} against {:?}, by z {pressing} against {:?}", tangent[0], tangent[2]);
    let size = tangent[2][2];
    for i in 0..3 {
        assert!((lateral[i] - tangent[0][i]).abs() < 1e-6 * size, "{lateral} against {:?}", tangent[0]);
        // New contact is born without traction: the press's slope is the frozen contact's.
        assert!((pressing[i] - tangent[2][i]).abs() < 1e-3 * size, "{pressing} against {:?}", tangent[2]);
    }
    let mut asymmetry = 0.0f64;
    for i in 0..6 {
        for j in 0..i {
            let mean = (tangent[i][i] * tangent[j][j]).sqrt();
            asymmetry = asymmetry.max((tangent[i][j] - tangent[j][i]).abs() / mean);
        }
    }
    println!("asymmetry {asymmetry:.1e}");
    assert!(asymmetry < 1e-10, "{asymmetry} of {tangent:?}");
}

/// f_t/(μ f_n) = 1 − (1 − k_t δ/(1.5 μ f_n))^1.5 up to 1.5 μ f_n/k_t, from where all slips: within 0.7 % of the limit, on elements
/// half as long as the contact's radius.
#[test]
fn partial_slip_is_cattaneo_mindlins() {
    const FRICTION: f64 = 0.2;
    const STEPS: u32 = 6;
    let model = half_space(UNSTRAINED);
    let paths = pressed(&model, Contact::Sticking, &depths(4), Vec::new());
    let stuck = last_tangent(&paths)[0][0];
    let press = depths(4).into_iter().map(|depth| DVec3::NEG_Z * depth);
    let limit = FRICTION * -paths.press.states.last().unwrap().force_n.z;
    let slides = 1.5 * limit / stuck;
    let way = (1..=STEPS)
        .map(|k| DVec3::NEG_Z * DEPTH_M + DVec3::X * (1.2 * slides * f64::from(k) / f64::from(STEPS)));
    let path = led(&model, FRICTION, &press.chain(way).collect::<Vec<_>>());
    for state in &path.states[4..] {
        let limit = FRICTION * -state.force_n.z;
        let expected = 1.0 - (1.0 - state.distance_m / slides).max(0.0).powf(1.5);
        let found = state.force_n.x / limit;
        println!(
            "δ = {:.2}: {found:.4}, Cattaneo–Mindlin {expected:.4}, slipping {:.2}",
            state.distance_m / slides,
            state.slipping
        );
        assert!((found - expected).abs() < 0.007, "{found} against {expected}");
        // Slip grows from the rim inwards; the cone is never left.
        assert!(state.force_n.x <= FRICTION * state.pressed_n * (1.0 + 1e-3));
    }
    let slipping: Vec<f64> = path.states[4..].iter().map(|s| s.slipping).collect();
    assert!(slipping[0] < 0.5 && slipping[STEPS as usize - 1] > 0.99, "{slipping:?}");
}

/// Forth, back and forth again beyond slip: the force depends on the way, and a closed loop takes work.
#[test]
fn a_sliding_loop_dissipates() {
    let model = half_space(POISSON);
    let press = depths(3).into_iter().map(|depth| DVec3::NEG_Z * depth);
    let turns = [1.0, 2.0, 1.0, 0.0, -1.0, -2.0, -1.0, 0.0, 1.0, 2.0];
    let way = turns.map(|x| DVec3::NEG_Z * DEPTH_M + DVec3::X * (0.2 * x * DEPTH_M));
    let path = led(&model, 0.2, &press.chain(way).collect::<Vec<_>>());
    let lateral: Vec<f64> = path.states[3..].iter().map(|s| s.force_n.x).collect();
    let loop_ = 1..10;
    let work: f64 = loop_
        .clone()
        .skip(1)
        .map(|i| 0.5 * (lateral[i] + lateral[i - 1]) * 0.2 * DEPTH_M * (turns[i] - turns[i - 1]))
        .sum();
    let largest = lateral.iter().fold(0.0f64, |m, f| m.max(f.abs()));
    println!("{lateral:?} N, work {work:.3e} J");
    assert!((lateral[1] - lateral[9]).abs() < 5e-3 * largest, "the loop does not close: {lateral:?}");
    assert!(work > largest * 0.2 * DEPTH_M, "{work} J");
}

/// Where all slips the force along the tool is μ times that across, with μ of the depth at hand: between the table's rows, at
/// them, beyond the last, and none where μ is none, though it stuck before.
#[test]
fn friction_follows_its_table_over_depth() {
    const TABLE: [(f64, f64); 2] = [(0.6 * DEPTH_M, 0.1), (0.9 * DEPTH_M, 0.25)];
    let unit = (RADIUS_M * DEPTH_M).sqrt();
    let (half, z) = ([0.0, 0.4, 0.8, 1.2, 3.0, 8.0], [0.0, 0.4, 1.2, 3.0, 8.0]);
    let model = half_block(unit, &half, &z, Material::linear(YOUNG_PA, UNSTRAINED).unwrap());
    // Down and along: far enough from state to state that all slips again.
    let depths = [0.3, 0.6, 0.7, 0.8, 0.9, 1.0, 0.75];
    let way = |steps: &[f64]| -> Vec<DVec3> {
        let along = |k: usize| DVec3::X * (0.5 * DEPTH_M * k as f64);
        steps.iter().enumerate().map(|(k, depth)| along(k) + DVec3::NEG_Z * (depth * DEPTH_M)).collect()
    };
    let path = led_with(&model, RADIUS_M, &TABLE, &way(&depths));
    for (state, depth) in path.states.iter().zip(depths).skip(1) {
        let expected = (0.1 + (depth - 0.6) * 0.5).clamp(0.1, 0.25);
        let found = state.force_n.x / state.pressed_n;
        println!("{depth} d: {found:.4}, table {expected:.4}; {:.3} slips", state.slipping);
        assert!(state.slipping > 0.99 && (found / expected - 1.0).abs() < 0.02, "{found}, not {expected}");
    }
    // The sphere leans on what it has pushed up, by far less than friction.
    let none = led_with(
        &model,
        RADIUS_M,
        &[(0.8 * DEPTH_M, 0.25), (0.9 * DEPTH_M, 0.0)],
        &way(&[0.5, 0.8, 0.9, 1.0]),
    );
    let share: Vec<f64> = none.states.iter().map(|s| s.force_n.x / s.pressed_n).collect();
    println!("{share:?}");
    assert!((share[1] / 0.25 - 1.0).abs() < 0.02 && share[2..].iter().all(|s| s.abs() < 1e-3), "{share:?}");
}

/// Of a whole path, pressed in, dragged until all slips, and back beyond where it slips again: load steps half as long change no
/// force by 0.5 % of the largest, the patch by less than 2 %, and what slips while it is dragged by less than
/// 3 % of the pressures.
#[test]
fn halving_all_load_steps_changes_little() {
    const RADIUS_M: f64 = 0.01;
    /// The longest load step, as simulate.rs has it; the path's legs are two such.
    const STEP_M: f64 = 0.02 * RADIUS_M;
    let (half, z) = ([0.0, 1.2, 2.4, 3.6, 6.0, 12.0], [0.0, 1.2, 3.0, 6.0, 12.0]);
    let material = Material::isochoric_neo_hookean(YOUNG_PA, 0.45).unwrap();
    let model = half_block(1e-3, &half, &z, material);
    let turns = [(0.0, 0.0), (0.0, 4.0), (4.0, 4.0), (-2.0, 4.0)];
    let offset = |(x, depth): (f64, f64)| DVec3::new(x, 0.0, -depth) * STEP_M;
    // Each leg in `parts` of a load step's length.
    let way = |parts: f64| -> Vec<DVec3> {
        let leg = |ends: &[(f64, f64)]| -> Vec<DVec3> {
            let (from, to) = (offset(ends[0]), offset(ends[1]));
            let count = (from.distance(to) / (parts * STEP_M)).round() as u32;
            (1..=count).map(|k| from.lerp(to, f64::from(k) / f64::from(count))).collect()
        };
        turns.windows(2).flat_map(leg).collect()
    };
    let friction = [(0.0, 0.25)];
    let [whole, halves] = [2.0, 0.5].map(|parts| {
        let start = std::time::Instant::now();
        let path = led_with(&model, RADIUS_M, &friction, &way(parts));
        println!("{} states, {:.1} s", path.states.len(), start.elapsed().as_secs_f64());
        path.states
    });
    assert_eq!(4 * whole.len(), halves.len());
    let largest = whole.iter().map(|s| s.force_n.length()).fold(0.0, f64::max);
    let pressed = whole.iter().map(|s| s.pressed_n).fold(0.0, f64::max);
    let ([mut force, mut patch], mut slipping) = ([0.0f64; 2], [0.0f64; 2]);
    for (a, b) in whole.iter().zip(halves.iter().skip(3).step_by(4)) {
        assert!((a.depth_m - b.depth_m).abs() < 1e-12 && (a.distance_m - b.distance_m).abs() < 1e-12);
        let differs = 100.0 * a.force_n.distance(b.force_n) / largest;
        println!(
            "{:.2} mm deep, {:.2} mm along: {:.5} N, {differs:.3} % of the largest; patch {:.2}, {:.2} mm²; slips {:.3}, {:.3}",
            1e3 * a.depth_m,
            1e3 * a.distance_m,
            a.force_n,
            1e6 * a.patch_m2,
            1e6 * b.patch_m2,
            a.slipping,
            b.slipping
        );
        force = force.max(differs);
        patch = patch.max(100.0 * (a.patch_m2 / b.patch_m2 - 1.0).abs());
        let slips = 100.0 * (a.slipping * a.pressed_n - b.slipping * b.pressed_n).abs() / pressed;
        let of = &mut slipping[usize::from(a.distance_m == 0.0)];
        *of = of.max(slips);
    }
    println!(
        "at most {force:.3} % of force, {patch:.2} % of the patch, {slipping:.2?} % of the pressures slip or stick otherwise, dragged and pressed"
    );
    // It did slip, on both ways, and stick in between.
    let slips = |k: usize| whole[k].slipping;
    assert!(slips(3) > 0.99 && slips(4) < 0.8 && slips(6) > 0.99);
    assert!(force < 0.5 && patch < 2.0);
    // While it is pressed only, points at the rim are just at their limit: more of them count otherwise than the forces show.
    assert!(slipping[0] < 3.0 && slipping[1] < 8.0);
}

/// A pose far from the last takes many load steps; where each has to be cut, as on elements of a quarter of the contact's radius, it is reached
/// like one of several.
#[test]
fn a_long_way_to_one_pose_is_gone_as_well_as_in_parts() {
    let (half, z) = ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 8.0], [0.0, 1.5, 4.0, 10.0]);
    let model = half_block(1e-3, &half, &z, Material::isochoric_neo_hookean(YOUNG_PA, 0.45).unwrap());
    let [at_once, in_parts] = [1, 2].map(|parts| {
        let way: Vec<DVec3> =
            (1..=parts).map(|k| DVec3::NEG_Z * (2e-3 * f64::from(k) / f64::from(parts))).collect();
        let path = led_with(&model, 0.01, &[(0.0, 0.3)], &way);
        assert_eq!((path.stopped, path.states.len()), (None, way.len()));
        path.states.last().unwrap().force_n
    });
    assert!(at_once.distance(in_parts) < 2e-3 * at_once.length(), "{at_once} {in_parts}");
}

/// What halving the load steps changes is told: of a press, of one drag of a place, and of every tenth state of a free path; and the
/// path goes on as if nobody had asked.
#[test]
fn paths_tell_what_halving_their_load_steps_changes() {
    let model = half_space(POISSON);
    let drag = |direction: DVec3| Drag { from: 9, direction, distances: vec![0.1 * DEPTH_M, 0.2 * DEPTH_M] };
    // Twice as deep in one load step is too much, and the path says so.
    let hasty = pressed(&model, Contact::Sticking, &depths(3), Vec::new()).press.halved.unwrap();
    assert!(hasty > 5e-3, "{hasty}");
    let paths = pressed(&model, Contact::Sticking, &depths(10), vec![drag(DVec3::X), drag(DVec3::NEG_X)]);
    let told = [paths.press.halved, paths.drags[0].halved].map(Option::unwrap);
    println!("sticking: {told:?}");
    assert!(told.iter().all(|h| *h > 0.0 && *h < 5e-3), "{told:?}");
    assert_eq!(paths.drags[1].halved, None);
    // Symmetric, but for what the check of the first would leave.
    let x = |drag: usize| paths.drags[drag].states.last().unwrap().force_n.x;
    assert!((x(0) + x(1)).abs() < 2e-3 * x(0).abs(), "{} {}", x(0), x(1));

    let way = |outside: usize| {
        let gap = std::iter::repeat_n(DVec3::Z * (0.1 * DEPTH_M), outside);
        let press = depths(3).into_iter().map(|depth| DVec3::NEG_Z * depth);
        let turns = [0.5, 1.0, 1.5, 1.0, 0.5, 0.0, -0.5, -1.0];
        let drag = turns.map(|x| DVec3::NEG_Z * DEPTH_M + DVec3::X * (0.1 * x * DEPTH_M));
        led(&model, 0.1, &gap.chain(press).chain(drag).collect::<Vec<_>>())
    };
    let (one, other) = (way(0), way(3));
    println!("sliding: {:?} {:?}", one.halved, other.halved);
    assert!([one.halved, other.halved].iter().all(|h| h.is_some_and(|h| h > 0.0 && h < 5e-3)));
    let largest = one.states.iter().map(|s| s.force_n.length()).fold(0.0, f64::max);
    for (a, b) in one.states.iter().zip(&other.states[3..]) {
        assert!(a.force_n.distance(b.force_n) < 2e-3 * largest, "{} {}", a.force_n, b.force_n);
    }
}

/// Before first touch, and drawn back out of the body, there is neither force nor patch; pressed in again the force is what it was.
#[test]
fn contact_is_lost_and_found() {
    let model = half_space(POISSON);
    let z = [1e-2, -1.0, 0.5, -1.0].map(|depth| DVec3::Z * (depth * DEPTH_M));
    let path = led(&model, 0.2, &z);
    let forces: Vec<f64> = path.states.iter().map(|s| -s.force_n.z).collect();
    println!("{forces:?}");
    assert!(forces[0] == 0.0 && forces[2] == 0.0 && path.states[2].patch_m2 == 0.0);
    assert!(forces[1] > 0.0 && (forces[3] / forces[1] - 1.0).abs() < 1e-6);
}
