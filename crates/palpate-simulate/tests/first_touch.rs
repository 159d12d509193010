//! Where a tool begins: where it first touches the body at rest, in the orientation in which it comes. Depth counts from there.

mod support;

use glam::{DQuat, DVec3};
use palpate_simulate::tool::{Placement, Shape};
use palpate_simulate::{
    Contact, FreePlan, FreePose, Material, Model, Path, PointPlan, RigidTool, State, TetMesh,
};
use std::f64::consts::PI;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use support::{hold, kuhn_grid};

const YOUNG_PA: f64 = 1e4;

fn led(model: &Model, tool: &RigidTool, point: DVec3, friction: f64, poses: Vec<FreePose>) -> Path {
    let plan = FreePlan { point, inward: DVec3::NEG_Z, poses, friction: vec![(0.0, friction)] };
    model.follow(tool, &plan, &AtomicBool::new(false)).unwrap()
}

/// A block under z = 0, so many mm high, finer around the origin, held at its bottom; without the cells (m) that `cut` says.
fn block(height_mm: f64, cut: impl Fn(DVec3) -> bool) -> Model {
    let half = [0.0, 2.0, 4.0, 7.0, 11.0];
    let x: Vec<f64> = half.iter().skip(1).rev().map(|x| -x).chain(half).map(|x| 1e-3 * x).collect();
    let z = [0.0, 2.0, 4.0, 8.0, 14.0, 22.0, 30.0, 40.0];
    let z = z.into_iter().filter(|z| *z <= height_mm).rev().map(|z| -1e-3 * z).collect();
    let whole = kuhn_grid([x.clone(), x, z]);
    // Only nodes of cells that are left.
    let left = whole.elements.iter().filter(|e| {
        let corners = e[..4].iter().map(|&n| whole.positions[n as usize]);
        !cut(corners.sum::<DVec3>() / 4.0)
    });
    let mut number = vec![u32::MAX; whole.positions.len()];
    let (mut positions, mut corners) = (Vec::new(), Vec::new());
    for element in left {
        corners.push([0, 1, 2, 3].map(|i: usize| {
            let node = element[i] as usize;
            if number[node] == u32::MAX {
                number[node] = positions.len() as u32;
                positions.push(whole.positions[node]);
            }
            number[node]
        }));
    }
    let mesh = TetMesh::from_corners(positions, &corners);
    let fixed = hold(&mesh, |p| [p.z < -1e-3 * height_mm + 1e-9; 3]);
    println!("{} nodes", mesh.positions.len());
    Model::new(mesh, vec![Material::neo_hookean(YOUNG_PA, 0.45).unwrap()], &fixed).unwrap()
}

/// Another tool, turned about its tip.
#[derive(Debug)]
struct Turned(RigidTool, DQuat);

impl Shape for Turned {
    fn distance(&self, point: DVec3) -> (f64, DVec3) {
        let found = self.0.distance(self.1.inverse() * point);
        (found.value, self.1 * found.gradient)
    }
}

/// Pressed in to 1 mm in four steps, in one orientation.
fn press(rotation: DQuat) -> Vec<FreePose> {
    (0..=4).map(|k| FreePose { offset: DVec3::NEG_Z * (2.5e-4 * f64::from(k)), rotation }).collect()
}

/// A tool that comes turned is one of that shape that comes as it is: it touches with its side, at depth 0.
#[test]
fn a_turned_tool_is_the_turned_shape() {
    let model = block(14.0, |_| false);
    let frame = DQuat::from_mat3(&Placement::pressing(DVec3::ZERO, DVec3::NEG_Z).rotation);
    for (tool, angle) in [
        (RigidTool::Capsule { radius_m: 0.004, length_m: 0.006 }, 1.2),
        (RigidTool::FlatPunch { radius_m: 0.003, edge_m: 0.001 }, 0.3),
    ] {
        let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), angle);
        let turned = led(&model, &tool, DVec3::ZERO, 0.0, press(turn));
        let shape = RigidTool::Other(Arc::new(Turned(tool.clone(), frame.inverse() * turn * frame)));
        let shaped = led(&model, &shape, DVec3::ZERO, 0.0, press(DQuat::IDENTITY));
        assert_eq!((&turned.stopped, &shaped.stopped), (&None, &None));
        let (last, other) = (turned.states.last().unwrap(), shaped.states.last().unwrap());
        println!("{tool:?}: {} N, {} N m", last.force_n, last.torque_n_m);
        let first = turned.states[0].force_n.length();
        assert!(first < 1e-4 * last.force_n.length(), "{tool:?} begins in the body: {first} N");
        assert!(last.force_n.z < 2.0 * turned.states[1].force_n.z && turned.states[1].force_n.z < 0.0);
        for (a, b) in turned.states.iter().zip(&shaped.states) {
            let (size, arm) = (last.force_n.length(), 0.004);
            assert!(a.force_n.distance(b.force_n) < 1e-4 * size, "{tool:?}: {} {}", a.force_n, b.force_n);
            let torques = a.torque_n_m.distance(b.torque_n_m);
            assert!(torques < 1e-4 * size * arm, "{tool:?}: {} {}", a.torque_n_m, b.torque_n_m);
        }
        assert_eq!(last.patch_m2, other.patch_m2);
    }
}

/// A sphere that turns about its tip while it presses is the sphere whose middle moves: without friction forces are the same, and so
/// are torques about the middle, none.
#[test]
fn a_sphere_that_turns_without_friction_only_moves() {
    const RADIUS_M: f64 = 0.005;
    let model = block(14.0, |_| false);
    let tool = RigidTool::Sphere { radius_m: RADIUS_M };
    let rotation = |angle: f64| DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), angle);
    let poses: Vec<FreePose> = [(5e-4, 0.0), (1e-3, 0.0), (1e-3, 0.1), (1e-3, 0.2), (7e-4, 0.2)]
        .map(|(depth, angle)| FreePose { offset: DVec3::NEG_Z * depth, rotation: rotation(angle) })
        .to_vec();
    let middle = |pose: &FreePose| RADIUS_M * (pose.rotation * DVec3::Z);
    let moved = poses.iter().map(|pose| {
        let offset = pose.offset + middle(pose) - RADIUS_M * DVec3::Z;
        FreePose { offset, rotation: DQuat::IDENTITY }
    });
    let [turns, moves] = [poses.clone(), moved.collect()].map(|p| led(&model, &tool, DVec3::ZERO, 0.0, p));
    assert_eq!((&turns.stopped, &moves.stopped), (&None, &None));
    let size = turns.states[1].force_n.length();
    for ((a, b), pose) in turns.states.iter().zip(&moves.states).zip(&poses) {
        let about_middle = a.torque_n_m - middle(pose).cross(a.force_n);
        println!("{} N, {} N; about its middle {about_middle} N m", a.force_n, b.force_n);
        assert!(a.force_n.distance(b.force_n) < 3e-4 * size, "{} {}", a.force_n, b.force_n);
        assert!(about_middle.length() < 1e-12 * size, "{about_middle}");
    }
    assert!(turns.states[3].force_n.distance(turns.states[1].force_n) > 0.01 * size);
}

/// A sphere spun about the normal of a half space twists it: not at all without friction; where all slips, by 3π/16 μ F a (Hertz's
/// pressures; Lubkin 1951).
#[test]
fn a_spinning_sphere_twists() {
    const RADIUS_M: f64 = 0.1;
    const DEPTH_M: f64 = 1e-4;
    const FRICTION: f64 = 0.3;
    const POISSON: f64 = 0.49;
    let contact = (RADIUS_M * DEPTH_M).sqrt();
    let half = [0.0, 0.5, 1.0, 1.6, 3.5, 8.0];
    let x: Vec<f64> = half.iter().skip(1).rev().map(|x| -x).chain(half).collect();
    let z = vec![-8.0, -3.0, -1.2, -0.5, 0.0];
    let mesh = kuhn_grid([x.clone(), x, z].map(|planes| planes.iter().map(|p| contact * p).collect()));
    let far = 8.0 * contact * (1.0 - 1e-9);
    let fixed = hold(&mesh, |p| [p.z < -far || p.x.abs() > far || p.y.abs() > far; 3]);
    let model = Model::new(mesh, vec![Material::linear(YOUNG_PA, POISSON).unwrap()], &fixed).unwrap();
    let tool = RigidTool::Sphere { radius_m: RADIUS_M };
    let poses = || {
        let press = [0.3, 0.6, 1.0].map(|share| (share, 0.0)).into_iter();
        let spin = [0.002, 0.005, 0.02, 0.04].map(|angle| (1.0, angle));
        let pose = |(share, angle)| FreePose {
            offset: DVec3::NEG_Z * (share * DEPTH_M),
            rotation: DQuat::from_rotation_z(angle),
        };
        press.chain(spin).map(pose).collect::<Vec<_>>()
    };
    let [smooth, rough] = [0.0, FRICTION].map(|friction| led(&model, &tool, DVec3::ZERO, friction, poses()));
    // Hertz's radius of contact, of the force.
    let radius = |force_n: f64| (0.75 * force_n * RADIUS_M * (1.0 - POISSON * POISSON) / YOUNG_PA).cbrt();
    let limit = |s: &State| 3.0 * PI / 16.0 * FRICTION * s.pressed_n * radius(s.pressed_n);
    for (state, smooth) in rough.states.iter().zip(&smooth.states).skip(2) {
        let twist = state.torque_n_m.z / limit(state);
        println!("{twist:.4} of the limit, {:.2} slips", state.slipping);
        assert!(smooth.torque_n_m.z.abs() < 1e-9 * limit(state), "{}", smooth.torque_n_m);
    }
    let last = rough.states.last().unwrap();
    assert!(rough.states[2].torque_n_m.z.abs() < 0.01 * limit(last));
    assert!(rough.states[2..].windows(2).all(|s| s[1].torque_n_m.z > s[0].torque_n_m.z - 1e-3 * limit(last)));
    assert!(last.slipping > 0.99 && (last.torque_n_m.z / limit(last) - 1.0).abs() < 0.03);
}

/// A punch over a pit that is narrower begins on the rim, though the plan's point is the pit's bottom: without force at depth 0, and
/// with the forces of a punch that was led there from the rim.
#[test]
fn over_a_hollow_depth_counts_from_first_touch() {
    let model = block(14.0, |p| p.x.abs() < 0.004 && p.y.abs() < 0.004 && p.z > -0.004);
    let tool = RigidTool::FlatPunch { radius_m: 0.007, edge_m: 0.001 };
    let (bottom, rim) = (DVec3::NEG_Z * 0.004, DVec3::X * 0.006);
    let depths = [0.0, 1e-4, 5e-4];
    let from = |start: DVec3| {
        let offset = |depth: f64| DVec3::NEG_Z * depth - start.reject_from(DVec3::Z);
        let poses = depths.map(|depth| FreePose::from(offset(depth))).to_vec();
        let path = led(&model, &tool, start, 0.0, poses);
        assert_eq!(path.stopped, None);
        path.states.into_iter().map(|s| s.force_n).collect::<Vec<_>>()
    };
    let (found, expected) = (from(bottom), from(rim));
    println!("{found:?}, from the rim {expected:?}");
    // Up to what first touch is found to, 10⁻⁹ of the body's size.
    assert!(found[0].length() < 1e-4 * found[1].length(), "{}", found[0]);
    assert!(found[1].z < 0.0 && found[2].z < 3.0 * found[1].z);
    for (found, expected) in found.iter().zip(&expected).skip(1) {
        assert!(found.distance(*expected) < 1e-4 * expected.length(), "{found} {expected}");
    }
    // And so in a press.
    let plan = PointPlan { point: bottom, inward: DVec3::NEG_Z, depths: depths[1..].to_vec(), drags: vec![] };
    let paths = model.simulate(&tool, Contact::Frictionless, &plan, &AtomicBool::new(false)).unwrap();
    for (state, expected) in paths.press.states.iter().zip(&expected[1..]) {
        assert!(state.force_n.distance(*expected) < 1e-4 * expected.length(), "{}", state.force_n);
    }
}

/// In a shaft that is narrower and deeper than half the body a tool can't be drawn out: the path ends before it begins, and says why.
#[test]
fn a_tool_that_overlaps_the_body_is_refused() {
    let shaft = |half: f64| block(40.0, move |p| p.x.abs() < half && p.y.abs() < half && p.z > -0.030);
    let tool = RigidTool::flat_punch(0.003);
    let point = DVec3::NEG_Z * 0.030;
    let why = "the tool overlaps the body at rest, however far it is drawn back";
    let narrow = shaft(0.002);
    let path = led(&narrow, &tool, point, 0.3, vec![DVec3::ZERO.into()]);
    let stop = path.stopped.unwrap();
    assert_eq!((path.states.len(), stop.at_m, &*stop.why), (0, 0.0, why));
    let plan = PointPlan { point, inward: DVec3::NEG_Z, depths: vec![1e-3], drags: vec![] };
    for contact in [Contact::Sticking, Contact::Frictionless] {
        let press = narrow.simulate(&tool, contact, &plan, &AtomicBool::new(false)).unwrap().press;
        let stop = press.stopped.unwrap();
        assert_eq!((press.states.len(), stop.at_m, &*stop.why), (0, 0.0, why));
    }
    // A wider shaft takes it.
    assert_eq!(led(&shaft(0.004), &tool, point, 0.3, vec![DVec3::ZERO.into()]).stopped, None);
}
