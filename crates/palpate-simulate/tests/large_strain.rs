//! Large deformations against other programs: CalculiX 2.20 (a block under combined load) and FElupe 11.3 (a sphere pressed into
//! a cylinder by 0.8 radii). `reference_solutions` has their tables, and the scripts that made them.

mod support;

use glam::{DQuat, DVec3};
use palpate_simulate::{Contact, FreePlan, FreePose, Material, Model, PointPlan, RigidTool, State};
use std::sync::atomic::AtomicBool;
use support::{hold, kuhn_grid, quarter_disc};

const TOOL: RigidTool = RigidTool::Sphere { radius_m: 0.01 };

/// Half a block, as `reference_solutions/block.py` has it.
fn block() -> Model {
    let half = [0.0, 2.0, 4.0, 6.0, 8.0, 10.5, 14.0, 19.0, 25.0];
    let x: Vec<f64> = half.iter().skip(1).rev().map(|x| -x).chain(half).collect();
    let y = vec![0.0, 2.0, 4.0, 6.5, 10.5, 16.5, 25.0];
    let z = vec![-20.0, -14.5, -10.0, -6.5, -4.0, -2.0, 0.0];
    let mesh = kuhn_grid([x, y, z].map(|planes| planes.iter().map(|p| 1e-3 * p).collect()));
    let fixed = hold(&mesh, |p| {
        let bottom = p.z < -0.02 + 1e-9;
        [bottom, bottom || p.y < 1e-9, bottom]
    });
    let model = Model::new(mesh, vec![Material::isochoric_neo_hookean(1e4, 0.45).unwrap()], &fixed).unwrap();
    println!("{} unknowns", model.unknowns());
    model
}

/// Lateral and normal force on the whole block at each row of `block.csv`, by our solver and by CalculiX.
fn on_block(contact: &str) -> Vec<[[f64; 2]; 2]> {
    let name = format!("{contact},");
    let rows = include_str!("reference_solutions/block.csv").lines().filter_map(|l| l.strip_prefix(&name));
    let rows: Vec<[f64; 4]> = rows
        .map(|row| {
            let mut numbers = row.split(',').map(|v| v.parse().unwrap());
            std::array::from_fn(|_| numbers.next().unwrap())
        })
        .collect();
    let model = block();
    let (point, inward, go_on) = (DVec3::ZERO, DVec3::NEG_Z, AtomicBool::new(false));
    let start = std::time::Instant::now();
    let offset = |r: &[f64; 4]| DVec3::new(r[1], 0.0, -r[0]) * 1e-3;
    let path = if contact == "tied" {
        let patch = hold(model.mesh(), |p| [p.z > -1e-9 && p.x.hypot(p.y) < 0.006 + 1e-9; 3]);
        model.move_nodes(&patch, &rows.iter().map(offset).collect::<Vec<_>>(), &go_on).unwrap().0
    } else {
        let poses = rows.iter().map(|r| FreePose { offset: offset(r), rotation: DQuat::IDENTITY }).collect();
        let plan = FreePlan { point, inward, poses, friction: vec![(0.0, 0.3)] };
        model.follow(&TOOL, &plan, &go_on).unwrap()
    };
    let states = path.states;
    assert_eq!(path.stopped, None);
    println!("{:.1} s", start.elapsed().as_secs_f64());
    assert_eq!(states.len(), rows.len());
    let both = |(r, s): (&[f64; 4], &State)| {
        // Half the block's.
        let found = [2.0 * s.force_n.x, -2.0 * s.force_n.z];
        let errors = [0, 1].map(|i| 100.0 * (found[i] - r[2 + i]) / r[3]);
        println!(
            "{contact}: {:.1} mm deep, {:.1} mm along: {:.6}, {:.6} N; CalculiX {:.6}, {:.6} N; {:+.4}, {:+.4} % of the normal force; {:.2} slips",
            r[0], r[1], found[0], found[1], r[2], r[3], errors[0], errors[1], s.slipping
        );
        [found, [r[2], r[3]]]
    };
    rows.iter().zip(&states).map(both).collect()
}

/// A quarter of the cylinder of `reference_solutions/cylinder.py`, elements of `edge` (mm) where it is touched.
fn cylinder(edge: f64) -> Model {
    // Even distances up to `even`, which then grow by a half each.
    let planes = |even: f64, end: f64| -> Vec<f64> {
        let mut at: Vec<f64> = (0..=(even / edge).round() as usize).map(|i| i as f64 * edge).collect();
        let from = at[at.len() - 1];
        let mut rest = vec![from];
        let mut step = edge;
        while rest[rest.len() - 1] < end {
            step *= 1.5;
            rest.push(rest[rest.len() - 1] + step);
        }
        let scale = (end - from) / (rest[rest.len() - 1] - from);
        at.extend(rest[1..].iter().map(|x| from + scale * (x - from)));
        at.iter().map(|x| 1e-3 * x).collect()
    };
    let mesh = quarter_disc(&planes(12.0, 30.0), &planes(edge, 25.0));
    let fixed = hold(&mesh, |p| {
        let bottom = p.z < -0.025 + 1e-9;
        [bottom || p.x < 1e-9, bottom || p.y < 1e-9, bottom]
    });
    let model = Model::new(mesh, vec![Material::isochoric_neo_hookean(1e4, 0.45).unwrap()], &fixed).unwrap();
    println!("{} unknowns", model.unknowns());
    model
}

/// Depth (mm) and normal force (N) on the whole cylinder, by our solver and by FElupe's finer mesh.
fn on_cylinder(edge: f64, contact: Contact) -> Vec<[f64; 3]> {
    let name = if contact == Contact::Sticking { "0.4,sticking," } else { "0.4,frictionless," };
    let rows = include_str!("reference_solutions/cylinder.csv").lines().filter_map(|l| l.strip_prefix(name));
    let rows: Vec<[f64; 2]> = rows
        .map(|row| {
            let mut numbers = row.split(',').map(|v| v.parse().unwrap());
            std::array::from_fn(|_| numbers.next().unwrap())
        })
        .collect();
    let model = cylinder(edge);
    let start = std::time::Instant::now();
    let depths = rows.iter().map(|r| 1e-3 * r[0]).collect();
    let plan = PointPlan { point: DVec3::ZERO, inward: DVec3::NEG_Z, depths, drags: Vec::new() };
    let press = model.simulate(&TOOL, contact, &plan, &AtomicBool::new(false)).unwrap().press;
    println!("{:.1} s, {:?}", start.elapsed().as_secs_f64(), press.stopped);
    assert_eq!(press.states.len(), rows.len());
    let both = |(r, s): (&[f64; 2], &State)| {
        let found = -4.0 * s.force_n.z;
        println!(
            "elements of {edge} mm, {contact:?}: {} mm deep: {found:.5} N, FElupe {:.5} N, {:+.3} %",
            r[0],
            r[1],
            100.0 * (found / r[1] - 1.0)
        );
        [r[0], found, r[1]]
    };
    rows.iter().zip(&press.states).map(both).collect()
}

/// The largest error of any row, in parts of the row's normal force.
fn worst(rows: &[[[f64; 2]; 2]]) -> f64 {
    let errors = rows
        .iter()
        .flat_map(|[found, expected]| [0, 1].map(|i| (found[i] - expected[i]).abs() / expected[1]));
    errors.fold(0.0, f64::max)
}

/// The same elements with the same patch held: what is left is what both programs stop at.
#[test]
fn a_patch_pressed_and_moved_along() {
    assert!(worst(&on_block("tied")) < 2e-6);
}

/// A sphere with Coulomb friction, pressed in by 0.4 radii and moved along until all slips: contact by two different
/// integrations and penalties, on elements of a third of the contact's radius.
#[test]
fn a_sphere_slides_over_a_block() {
    let found = on_block("sliding");
    // The last two rows are those in which all slips: docs/verification.md.
    let (sticks, slides) = found.split_at(found.len() - 2);
    assert!(worst(sticks) < 0.01 && worst(slides) < 0.032);
}

/// Within `most` (depth up to which, mm, and error) of FElupe's solution.
fn check_cylinder(edge: f64, contact: Contact, most: &[[f64; 2]]) {
    for [depth, found, expected] in on_cylinder(edge, contact) {
        let [_, most] = most.iter().find(|m| depth <= m[0]).unwrap();
        assert!((found / expected - 1.0).abs() < *most, "{depth} mm: {found} N, not {expected} N");
    }
}

#[test]
fn a_sphere_in_a_cylinder() {
    check_cylinder(2.0, Contact::Frictionless, &[[2.0, 6e-3], [8.0, 2.5e-3]]);
}

/// Where the surface folds into the rim of a contact that sticks, it is the elements' size that counts.
#[test]
fn a_sphere_sticks_to_a_cylinder() {
    check_cylinder(2.0, Contact::Sticking, &[[3.0, 5e-3], [5.0, 0.02], [8.0, 0.06]]);
}

#[test]
#[ignore = "half a minute"]
fn finer_elements_under_the_sphere() {
    check_cylinder(1.5, Contact::Frictionless, &[[8.0, 2.5e-3]]);
    check_cylinder(1.5, Contact::Sticking, &[[3.0, 3e-3], [5.0, 0.01], [8.0, 0.023]]);
}
