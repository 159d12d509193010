//! An equilibrium that is no minimum says so: a bar whose law collapses, held in its even state.

mod support;

use glam::DVec3;
use palpate_simulate::{Contact, Material, Model, PointPlan, RigidTool};
use std::sync::atomic::AtomicBool;
use support::{hold, kuhn_grid};

/// St. Venant–Kirchhoff's bar of ν = 0, held across, answers a stretch λ with E λ(λ² − 1)/2: from λ² = 1/3 on, ever less. Between two
/// plates it is still in equilibrium there, but any unevenness would grow.
#[test]
fn a_bar_beyond_its_collapse_is_indefinite() {
    const YOUNG_PA: f64 = 1e4;
    const SIDE_M: f64 = 0.01;
    const HEIGHT_M: f64 = 0.02;
    let planes = |length: f64, cells: u32| -> Vec<f64> {
        (0..=cells).map(|i| length * f64::from(i) / f64::from(cells)).collect()
    };
    let z = planes(HEIGHT_M, 4).iter().map(|z| z - HEIGHT_M).collect();
    let mesh = kuhn_grid([planes(SIDE_M, 2), planes(SIDE_M, 2), z]);
    let fixed = hold(&mesh, |p| [true, true, p.z < -HEIGHT_M * (1.0 - 1e-9)]);
    let law = Material::StVenantKirchhoff { mu_pa: 0.5 * YOUNG_PA, lambda_pa: 0.0 };
    let model = Model::new(mesh, vec![law], &fixed).unwrap();
    let depths: Vec<f64> = (1..=24).map(|k| 0.02 * HEIGHT_M * f64::from(k)).collect();
    let point = DVec3::new(0.5 * SIDE_M, 0.5 * SIDE_M, 0.0);
    let plan = PointPlan { point, inward: DVec3::NEG_Z, depths, drags: Vec::new() };
    let tool = RigidTool::flat_punch(0.1);
    let press = model.simulate(&tool, Contact::Sticking, &plan, &AtomicBool::new(false)).unwrap().press;
    println!("{:?}", press.stopped);
    let mut indefinite = 0;
    for state in &press.states {
        let stretch = 1.0 - state.depth_m / HEIGHT_M;
        let expected = YOUNG_PA * SIDE_M * SIDE_M * stretch * (1.0 - stretch * stretch) / 2.0;
        let error = -state.force_n.z / expected - 1.0;
        println!("λ = {stretch:.2}: {:+.2} %, indefinite: {}", 100.0 * error, state.indefinite);
        assert!(error.abs() < 0.02, "{error} at {stretch}");
        assert_eq!(state.indefinite, stretch * stretch < 1.0 / 3.0, "at {stretch}");
        assert_eq!(state.tangent.is_none(), state.indefinite, "at {stretch}");
        indefinite += u32::from(state.indefinite);
    }
    assert!(indefinite > 1);
}
