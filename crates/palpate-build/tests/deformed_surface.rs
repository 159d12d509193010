//! The deformed surface of a body against places of its own record that it was made without.

use palpate_body::DisplacementFields;
use palpate_build::paths_file::PathsRecord;
use palpate_build::precompute::assemble;
use palpate_build::validate::{SimulatedSurface, SurfaceErrors, SurfaceTrial};
use palpate_simulate::Path;

/// `PALPATE_PATHS=liver.body.paths cargo test --release -p palpate-build --test deformed_surface -- --ignored --nocapture`:
/// of every second, third and eighth of its test points makes a body, and compares it at the others.
#[test]
#[ignore = "it needs a record of a simulation"]
fn places_that_were_left_out() {
    let file = std::env::var("PALPATE_PATHS").expect("PALPATE_PATHS names a .paths file");
    let record = PathsRecord::open(file.as_ref()).unwrap();
    let scene = record.scene.clone().unwrap();
    let simulated = SimulatedSurface { positions: scene.boundary_m.clone(), faces: scene.faces.clone() };
    for every in [2, 3, 8] {
        let mut fewer = record.clone();
        fewer.points.retain(|i, _| i % every == 0);
        // All of the fields, whatever they take.
        fewer.plan.spec = fewer.plan.spec.replacen("[body]", "[body]\ndisplacements = true", 1);
        let body = assemble::body(&fewer).unwrap().body;
        let fields = body.displacement_fields().unwrap().unwrap();
        println!(
            "{} of {} test points, {} of them dragged: {:.1} MB",
            fields.press().places(),
            record.points.len(),
            fields.lateral().places(),
            fields.bytes() as f64 / 1e6
        );
        let plain = body.clone().with_displacement_fields(None).unwrap();
        let without = DisplacementFields::new(
            fields.surface().clone(),
            fields.press().clone(),
            Default::default(),
            body.test_point_nodes().len(),
        );
        let pressed_only = body.clone().with_displacement_fields(Some(without.unwrap())).unwrap();
        for (name, body) in [("fields", &body), ("without lateral fields", &pressed_only), ("dimple", &plain)]
        {
            let trial = SurfaceTrial::new(body, &simulated).unwrap().unwrap();
            let (mut press, mut drag) = (Vec::new(), Vec::new());
            for (_, point) in
                record.points.iter().filter(|(i, _)| *i % every != 0).step_by(4 * every as usize / 2)
            {
                let (place, paths) = (point.test_point(), point.paths_with_displacements().unwrap());
                let (plan, radius) = (&place.plan, body.tool().radius_m());
                let at = Some(body.nearest(plan.point, 1e-3).unwrap().at);
                let states = |path: &Path, along: glam::DVec3| -> Vec<_> {
                    let tool = |s: &palpate_simulate::State| {
                        plan.point + plan.inward * (s.depth_m - radius) + along * s.distance_m
                    };
                    let state =
                        |s: &palpate_simulate::State| (at, tool(s), s.depth_m, s.displacement_m.clone());
                    path.states.iter().map(state).collect()
                };
                let compare = |all: &[(_, _, f64, Vec<[f32; 3]>)], to: &mut Vec<_>| {
                    to.extend(
                        trial.compare(all.iter().map(|(at, tool, depth, u)| (*at, *tool, *depth, &u[..]))),
                    );
                };
                compare(&states(&paths.press, glam::DVec3::ZERO), &mut press);
                for (d, path) in plan.drags.iter().zip(&paths.drags) {
                    // As far as friction of 0.3 holds a stuck contact, about.
                    let mut held = states(path, d.direction);
                    held.truncate(path.states.iter().filter(|s| s.distance_m < 0.45 * s.depth_m).count());
                    compare(&held, &mut drag);
                }
            }
            for (what, errors) in [("pressed", &press), ("dragged", &drag)] {
                if let Some(e) = SurfaceErrors::new(errors) {
                    println!(
                        "  {name}, {what}, {} states: RMS {:.1?} near {:.1?} shows through {:.2?} % of the depth",
                        e.states, e.rms_percent, e.near_rms_percent, e.show_through_percent
                    );
                }
            }
        }
    }
}
