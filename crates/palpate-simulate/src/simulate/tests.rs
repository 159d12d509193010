use super::*;
use crate::near_field::tests::block;

/// Force and torque (N, N m).
type Wrench = [f64; 6];

fn wrench(stepper: &LoadStepper) -> Wrench {
    let Load::Tool(contact) = &stepper.load else { unreachable!("it is a tool") };
    let Resultant { force_n, torque_n_m, .. } = contact.resultant(stepper.solver.model, &stepper.solver.u);
    std::array::from_fn(|i| if i < 3 { force_n[i] } else { torque_n_m[i - 3] })
}

/// All 36 entries of a stuck tangent against differences of wrenches with the contact frozen, where nothing is symmetric: off the
/// block's middle, leaning, and twisted and dragged while it stuck.
#[test]
fn the_stuck_tangent_is_the_wrenchs_derivative_by_translations_and_rotations() {
    const STEP_M: f64 = 1e-6;
    const ANGLE_RAD: f64 = 5e-4;
    let (model, go_on) = (block(), AtomicBool::new(false));
    let tool = RigidTool::Capsule { radius_m: 0.006, length_m: 0.01 };
    let lean = DQuat::from_axis_angle(DVec3::new(0.8, -0.6, 0.0), 0.5);
    let (point, inward) = (DVec3::new(0.019, 0.016, 0.02), DVec3::NEG_Z);
    let mut stepper = model.touching(&tool, point, inward, lean, Friction::Sticking).unwrap();
    for (x, depth, twist) in [(0.0, 1.0, 0.0), (0.0, 2.0, 0.0), (0.4, 2.0, 0.1)] {
        let offset = DVec3::new(x, 0.5 * x, -depth) * 1e-3;
        let pose =
            FreePose { offset, rotation: DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), twist) * lean };
        let target = Target { pose, depth_m: 1e-3 * depth, distance_m: 0.0 };
        stepper.go(&target, &go_on).map_err(Failure::words).unwrap();
    }
    // Exactly, as what it is compared with.
    stepper.solver.equilibrate(&stepper.load, 1e-10, &go_on).map_err(Failure::words).unwrap();
    let mut indefinite = false;
    let tangent = stepper.stuck_tangent(&mut indefinite).unwrap();
    assert!(!indefinite);
    let pressed = stepper.snapshot();
    let mut moved = |translation: DVec3, rotation: DVec3| {
        stepper.go_back(&pressed);
        let FreePose { offset, rotation: before } = pressed.at;
        let turn = DQuat::from_scaled_axis(rotation);
        stepper.place(FreePose { offset: offset + translation, rotation: turn * before });
        stepper.solver.equilibrate(&stepper.load, 1e-10, &go_on).map_err(Failure::words).unwrap();
        wrench(&stepper)
    };
    let rest = moved(DVec3::ZERO, DVec3::ZERO);
    let torque = DVec3::new(rest[3], rest[4], rest[5]);
    println!("at rest {rest:?}");
    let mut worst = 0.0f64;
    for column in 0..6 {
        let axis = DVec3::AXES[column % 3];
        let (step, by) = if column < 3 {
            (STEP_M, [axis * STEP_M, DVec3::ZERO])
        } else {
            (ANGLE_RAD, [DVec3::ZERO, axis * ANGLE_RAD])
        };
        let (ahead, behind) = (moved(by[0], by[1]), moved(-by[0], -by[1]));
        // Of the torque about fixed axes, but for the Hessian's.
        let besides = if column < 3 { DVec3::ZERO } else { 0.5 * axis.cross(torque) };
        for row in 0..6 {
            let found = (ahead[row] - behind[row]) / (2.0 * step);
            let expected = tangent[row][column] + if row < 3 { 0.0 } else { besides[row - 3] };
            let size = (tangent[row][row] * tangent[column][column]).sqrt();
            let error = (found - expected) / size;
            println!("({row}, {column}): {found:.6e}, tangent {expected:.6e}: {error:+.1e}");
            worst = worst.max(error.abs());
        }
    }
    println!("worst {worst:.1e}");
    // What turns along is not below what this can see.
    assert!(torque.length() > 1e-3 * tangent[3][3].min(tangent[5][5]));
    assert!(worst < 1e-6, "{worst}");
}

/// Where the table of friction comes to nothing, what was caught is held no longer.
#[test]
fn without_friction_nothing_stays_caught() {
    let (model, go_on) = (block(), AtomicBool::new(false));
    let tool = RigidTool::Sphere { radius_m: 0.006 };
    let (point, inward) = (DVec3::new(0.019, 0.016, 0.02), DVec3::NEG_Z);
    let mut stepper = model.touching(&tool, point, inward, DQuat::IDENTITY, Friction::Coulomb(0.3)).unwrap();
    let mut to = |x: f64, depth: f64, friction: Friction| {
        stepper.friction = friction;
        let pose = DVec3::new(x, 0.0, -depth).into();
        stepper.go(&Target { pose, depth_m: depth, distance_m: x }, &go_on).map_err(Failure::words).unwrap()
    };
    to(0.0, 1e-3, Friction::Coulomb(0.3));
    let held = to(5e-4, 1e-3, Friction::Coulomb(0.3));
    let free = to(5e-4, 1e-3, Friction::None);
    println!("{} N, then {} N", held.force_n, free.force_n);
    assert!(held.force_n.x > 0.1 * held.pressed_n && free.force_n.x.abs() < 0.01 * free.pressed_n);
    assert_eq!(free.slipping, 1.0);
}
