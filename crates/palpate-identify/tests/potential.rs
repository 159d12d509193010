//! Potentials from forces: those that are known, and the liver's.

#[path = "../../palpate-engine/tests/common/frictional.rs"]
mod frictional;

use frictional::{Place, places};
use glam::DVec3;
use palpate_body::{Curve, Extension, Potential, SlipRule};
use palpate_identify::{ContactSample, PotentialOptions, fit_potential};

const KNOTS: [f64; 5] = [0.0, 1e-3, 2.5e-3, 4e-3, 5e-3];
const TANGENTS: [DVec3; 2] = [DVec3::X, DVec3::Y];
const RANGE: f64 = 3e-3;

/// A potential of cubics between [`KNOTS`], whose K grows from 10 to 25 N/m.
fn known(cubic: f64) -> Potential {
    let curve = |unit: f64, [v, s]: [[f64; 5]; 2], extension| {
        let slopes = s.map(|s| s * unit * 1e3);
        Curve::hermite(&KNOTS, &v.map(|v| v * unit), &slopes, extension).unwrap()
    };
    let held = |unit: f64, first: f64, last: f64| {
        let step = (last - first) / 4.0;
        let values = [0.0, 1.0, 2.2, 3.8, 4.0].map(|x| first + step * x);
        curve(unit, [values, [0.0, 0.9 * step, step, 0.5 * step, 0.0]], Extension::Constant)
    };
    let rest =
        |unit: f64| curve(unit, [[0.0, 0.5, 2.0, 4.0, 4.5], [0.0, 0.8, 1.2, 0.9, 0.0]], Extension::Constant);
    Potential {
        tangents: TANGENTS,
        // δ², exactly.
        press: curve(3.0, [KNOTS.map(|k| k * k), KNOTS.map(|k| 2e-3 * k)], Extension::Quadratic),
        offset: [rest(2e-3), rest(-4e-3)],
        stiffness: [held(1.0, 10.0, 20.0), held(1.0, 1.0, 2.0), held(1.0, 15.0, 25.0)],
        cubic: [held(cubic, 1.0, 0.5), held(cubic, -0.5, 0.2), held(cubic, 0.3, 0.1), held(cubic, 1.0, 2.0)],
        quartic: held(2e4, 1.0, 1.5),
        friction: Curve::hermite(&KNOTS, &[0.3; 5], &[0.0; 5], Extension::Constant).unwrap(),
        curvature: [0.0; 3],
    }
}

fn samples(of: &Potential) -> Vec<ContactSample> {
    let depths = (1..=20).map(|i| 4.5e-3 * f64::from(i) / 20.0);
    let places =
        depths.flat_map(|depth| (0..8).flat_map(move |a| [0.0, 1e-3, 2e-3, RANGE].map(|r| (depth, a, r))));
    let sample = |(depth_m, angle, r): (f64, i32, f64)| {
        let angle = f64::from(angle) * std::f64::consts::FRAC_PI_4;
        let lateral_m = [r * libm::cos(angle), r * libm::sin(angle)];
        let law = of.at(depth_m, lateral_m, RANGE);
        let force_n = [law.normal, law.lateral[0], law.lateral[1]];
        ContactSample { depth_m, lateral_m, force_n, weight: 1.0 }
    };
    places.map(sample).collect()
}

fn on_known_knots() -> PotentialOptions {
    PotentialOptions { knots_m: Some(KNOTS.to_vec()), range_m: Some(RANGE), friction: 0.3, smoothness: 1e-6 }
}

#[test]
fn a_known_potential_is_found_again() {
    let known = known(5e2);
    known.validate(DVec3::Z, RANGE).unwrap();
    let fit = fit_potential(&samples(&known), TANGENTS, &on_known_knots()).unwrap();
    let largest = samples(&known).iter().flat_map(|s| s.force_n).fold(0.0f64, |most, f| most.max(f.abs()));
    for off in fit.residuals_n.iter().flatten() {
        assert!(off.abs() < 1e-5 * largest, "{off} of {largest}");
    }
    assert!(fit.reciprocity < 1e-4, "{}", fit.reciprocity);
    for (name, (got, want)) in fit.potential.curves().into_iter().zip(known.curves()).enumerate() {
        for d in (1..45).map(|i| 1e-4 * f64::from(i)) {
            let scale = want.ordinates().as_flattened().iter().fold(0.0f64, |m, y| m.max(y.abs()));
            assert!((got.value(d) - want.value(d)).abs() < 1e-3 * scale, "{name} at {d}");
        }
    }
}

/// What no potential with growing lateral forces gives is fitted by one that has them, as near as it comes.
#[test]
fn forces_that_fall_along_rays_are_fitted_by_ones_that_grow() {
    let falling = known(2e4);
    falling.validate(DVec3::Z, RANGE).unwrap_err();
    let fit = fit_potential(&samples(&falling), TANGENTS, &on_known_knots()).unwrap();
    fit.potential.validate(DVec3::Z, RANGE).unwrap();
    assert!(fit.residuals_n.iter().flatten().any(|off| off.abs() > 1e-3));
}

/// Forces whose work depends on the way are no potential's, and the fit says so.
#[test]
fn what_is_no_potential_shows() {
    let mut samples = samples(&known(5e2));
    for s in &mut samples {
        // Twice the change of the normal force that belongs to the lateral forces.
        let straight = known(5e2).at(s.depth_m, [0.0; 2], RANGE).normal;
        s.force_n[0] += s.force_n[0] - straight;
    }
    let fit = fit_potential(&samples, TANGENTS, &on_known_knots()).unwrap();
    assert!(fit.reciprocity > 0.1, "{}", fit.reciprocity);
}

#[test]
fn what_cannot_be_fitted_is_refused() {
    let all = samples(&known(5e2));
    let refused = |samples: &[ContactSample], options: PotentialOptions, word: &str| {
        let message = fit_potential(samples, TANGENTS, &options).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    refused(&[], on_known_knots(), "none has depth");
    let press: Vec<_> = all.iter().copied().filter(|s| s.lateral_m == [0.0; 2]).collect();
    refused(&press, on_known_knots(), "laterally");
    let changed = |change: fn(&mut ContactSample)| {
        let mut all = all.clone();
        change(&mut all[5]);
        all
    };
    refused(&changed(|s| s.force_n[1] = f64::NAN), on_known_knots(), "sample 5");
    refused(&changed(|s| s.depth_m = -1e-3), on_known_knots(), "sample 5");
    refused(&changed(|s| s.weight = -1.0), on_known_knots(), "sample 5");
    refused(&all, PotentialOptions { knots_m: Some(vec![0.0, 1e-3, 2e-3]), ..on_known_knots() }, "beyond");
    refused(&all, PotentialOptions { friction: -0.1, ..on_known_knots() }, "friction");
    refused(&all, PotentialOptions { smoothness: 0.0, ..on_known_knots() }, "smoothness");
    refused(&all, PotentialOptions { range_m: Some(0.0), ..on_known_knots() }, "range");
    // A surface that pulls the tool in.
    let pulled: Vec<_> = all.iter().map(|s| ContactSample { force_n: s.force_n.map(|f| -f), ..*s }).collect();
    refused(&pulled, on_known_knots(), "pull");
}

/// Median and 95th percentile of normal and lateral errors in % of the state's own force (and 5 % of the largest), of states
/// with up to this ratio of lateral to normal force.
fn errors<'a>(of: impl Iterator<Item = (&'a Place, Vec<[f64; 3]>)>, ratio: f64) -> [[f64; 2]; 2] {
    let mut errors: [Vec<f64>; 2] = Default::default();
    let size = |f: [f64; 3]| f.iter().map(|f| f * f).sum::<f64>().sqrt();
    for (place, residuals) in of {
        let samples = place.samples();
        let largest = samples.iter().map(|s| size(s.force_n)).fold(0.0, f64::max);
        for (s, off) in samples.iter().zip(residuals) {
            let [z, x, y] = s.force_n;
            if x.hypot(y) <= ratio * z {
                let per = 100.0 / (size(s.force_n) + 0.05 * largest);
                errors[0].push(off[0].abs() * per);
                errors[1].push(off[1].hypot(off[2]) * per);
            }
        }
    }
    errors.map(|mut errors| {
        errors.sort_by(f64::total_cmp);
        [0.5, 0.95].map(|p| errors[(p * (errors.len() - 1) as f64).round() as usize])
    })
}

/// LAW 1's table, last line, says what is reachable: 0.5 and 2.1 % of the normal force, 0.6 and 2.0 % of the lateral.
#[test]
fn the_livers_stuck_forces_are_a_potentials() {
    for file in ["liver_sticking.csv", "liver_patch_sticking.csv"] {
        let Some(places) = places(file) else { return };
        let fits = frictional::potentials(&places, 0.3);
        let off = || places.iter().zip(fits.iter().map(|fit| fit.residuals_n.clone()));
        for (ratio, most) in [(0.5, [[0.2, 0.6], [0.7, 1.6]]), (1.0, [[0.3, 1.4], [1.0, 3.2]])] {
            let errors = errors(off(), ratio);
            println!("{file}, |f_t| ≤ {ratio} f_z: {errors:.2?} %");
            let all = errors.as_flattened().iter().zip(most.as_flattened());
            assert!(all.clone().all(|(error, most)| error < most), "{errors:?}");
        }
        println!("{file}, all: {:.2?} %", errors(off(), f64::INFINITY));
        for fit in &fits {
            assert!(fit.reciprocity < 0.05, "{}", fit.reciprocity);
        }
    }
}

/// Fitted to a press and to drags from 3 and 6 mm, it gives those from 2 and 4 mm.
#[test]
fn depths_that_nobody_dragged_from_are_predicted() {
    let (Some(patch), Some(other)) = (places("liver_patch_sticking.csv"), places("liver_sticking.csv"))
    else {
        return;
    };
    let [fit, ..] = &frictional::potentials(&patch, 0.3)[..] else { panic!("no place") };
    let off = |s: ContactSample| {
        let law = fit.potential.at(s.depth_m, s.lateral_m, fit.range_m);
        [law.normal - s.force_n[0], law.lateral[0] - s.force_n[1], law.lateral[1] - s.force_n[2]]
    };
    let off: Vec<_> = other[0].samples().into_iter().map(off).collect();
    for (ratio, most) in [(0.5, [[0.3, 2.5], [0.7, 2.0]]), (1.0, [[0.5, 8.0], [1.2, 5.0]])] {
        let errors = errors([(&other[0], off.clone())].into_iter(), ratio);
        println!("|f_t| ≤ {ratio} f_z: {errors:.2?} %");
        assert!(
            errors.as_flattened().iter().zip(most.as_flattened()).all(|(e, most)| e < most),
            "{errors:?}"
        );
    }
}

#[test]
fn the_livers_patch_is_a_body() {
    let Some(body) = frictional::liver_patch_body(0.3, SlipRule::Consistent) else { return };
    assert_eq!((body.nodes().len(), body.potentials().len()), (14, 14));
    println!("{} triangles", body.elements().len());
    // One outline, without holes.
    let border = body.elements().iter().flat_map(|e| e.twins).filter(|t| *t == palpate_body::NO_TWIN).count();
    assert_eq!(body.elements().len(), 2 * 14 - 2 - border);
    for (node, place) in body.nodes().iter().zip(places("liver_patch_sticking.csv").unwrap()) {
        assert_eq!((node.position, node.inward), (place.position, place.inward));
    }
}
