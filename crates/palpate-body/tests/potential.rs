//! What a potential promises is checked on its whole range.

use glam::DVec3;
use palpate_body::law::{AtDepth, Monomials, coupled};
use palpate_body::{Curve, Dual, Extension, Number, Potential};
use proptest::prelude::*;

#[path = "support/coupled.rs"]
mod support;

use support::{KNOTS, RANGE, curve, potential};

/// The named curve of a potential, as the law orders them, with some of its ordinates changed.
fn changed(potential: &Potential, which: usize, change: impl Fn(&mut Vec<[f64; 4]>)) -> Potential {
    let mut changed = potential.clone();
    let Potential {
        press,
        offset: [b1, b2],
        stiffness: [k1, k2, k3],
        cubic: [c1, c2, c3, c4],
        quartic,
        friction,
        ..
    } = &mut changed;
    let curve =
        [press, b1, b2, k1, k2, k3, c1, c2, c3, c4, quartic, friction].into_iter().nth(which).unwrap();
    let mut ordinates = curve.ordinates().to_vec();
    change(&mut ordinates);
    *curve = Curve::from_ordinates(curve.knots(), &ordinates, curve.extension()).unwrap();
    changed
}

fn refusal(potential: &Potential) -> String {
    potential.validate(DVec3::Z, RANGE).unwrap_err().to_string()
}

/// e·Ke + 6 r C(e³) + 12 r² Q, N/m, by the law itself.
fn growth(potential: &Potential, depth: f64, angle: f64, r: f64) -> f64 {
    let (c, s) = (libm::cos(angle), libm::sin(angle));
    let value = potential.curves().map(|c| Dual::<f64, 1>::constant(c.value(depth)));
    let r = Dual::variable(r, 0);
    let [x, y] = coupled(&AtDepth { value, slope: value }, &Monomials::new([r * c, r * s], RANGE)).lateral;
    x.partials[0] * c + y.partials[0] * s
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, rng_seed: proptest::test_runner::RngSeed::Fixed(2003), failure_persistence: None, ..Default::default() })]

    /// What is accepted grows everywhere, and what grows everywhere with something to spare is accepted.
    #[test]
    fn growth_is_judged_as_it_is(seed in 0u64.., cubic in 0.0f64..3.0) {
        let potential = potential(seed, cubic);
        let stiffest = potential.curves()[3..6].iter().flat_map(|c| c.ordinates().as_flattened()).fold(0.0f64, |m, k| m.max(k.abs()));
        let mut least = f64::INFINITY;
        for i in 0..=60 {
            for angle in (0..48).map(|a| f64::from(a) * std::f64::consts::TAU / 48.0) {
                for r in [0.0, 0.25, 0.5, 0.75, 0.999_999] {
                    least = least.min(growth(&potential, 7e-3 * f64::from(i) / 60.0, angle, r * RANGE));
                }
            }
        }
        let accepted = potential.validate(DVec3::Z, RANGE).is_ok();
        prop_assert!(!accepted || least > 0.0, "accepted, with {least} N/m");
        // The samples' spacing may hide a little.
        prop_assert!(accepted || least < 0.02 * stiffest, "refused, with {least} of {stiffest} N/m: {}", refusal(&potential));
    }

    #[test]
    fn each_damage_is_refused(seed in 0u64.., knot in 1usize..4) {
        let sound = potential(seed, 0.3);
        sound.validate(DVec3::Z, RANGE).unwrap();
        let scale = |which: usize| sound.curves()[which].ordinates().as_flattened().iter().fold(0.0f64, |m, y| m.max(y.abs()));
        for (which, name) in palpate_body::potential::QUANTITY_NAMES.iter().enumerate().take(11) {
            let off = 1e-3 * scale(which);
            let message = refusal(&changed(&sound, which, |b| b[0][1] += off));
            prop_assert!(message.contains(name) && message.contains("begins"), "{message}");
            let message = refusal(&changed(&sound, which, |b| b[knot][1] += off));
            prop_assert!(message.contains(name) && message.contains("jumps"), "{message}");
            if which > 0 {
                let message = refusal(&changed(&sound, which, |b| { let end = b.len() - 1; b[end][2] += off }));
                prop_assert!(message.contains(name) && message.contains("ends"), "{message}");
            }
            if which < 3 {
                let message = refusal(&changed(&sound, which, |b| b[0][0] += off));
                prop_assert!(message.contains(name) && message.contains("where the depth is 0"), "{message}");
            }
        }
        let message = refusal(&changed(&sound, 11, |b| b[knot][1] = -1.0));
        prop_assert!(message.contains("friction"), "{message}");
        for axis in 0..2 {
            let mut turned = sound.clone();
            turned.tangents[axis] = (turned.tangents[axis] + DVec3::Z * 1e-3).normalize();
            prop_assert!(refusal(&turned).contains("tangents"));
        }
    }
}

/// Between two knots alone, and by less than a sample a tenth of the interval apart would see.
#[test]
fn a_dip_between_knots_is_refused() {
    let sound = potential(1, 0.0);
    let h = KNOTS[2] - KNOTS[1];
    // K₁₁ with both ends and slopes of an interval such that its least value, near the middle, is this.
    let dipping = |least: f64| {
        let mut dipping = sound.clone();
        let depth = (20.0 - least) * 4.0 / h;
        dipping.stiffness[0] = curve([20.0; 6], [0.0, -depth, depth, 0.0, 0.0, 0.0], Extension::Constant);
        dipping.stiffness[1] = curve([0.0; 6], [0.0; 6], Extension::Constant);
        dipping
    };
    dipping(0.01).validate(DVec3::Z, RANGE).unwrap();
    let message = refusal(&dipping(-1e-4));
    let middle = format!("{:.1}", 0.5e3 * (KNOTS[1] + KNOTS[2]));
    assert!(message.contains("not positive definite") && message.contains(&middle), "{message}");
}

/// Each of K₁₁ and K₂₂ is well above 0, and K is not definite.
#[test]
fn an_indefinite_stiffness_is_refused() {
    let mut potential = potential(1, 0.0);
    potential.stiffness = [10.0, 11.0, 12.0].map(|k| curve([k; 6], [0.0; 6], Extension::Constant));
    potential.validate(DVec3::Z, RANGE).unwrap_err();
    potential.stiffness = [10.0, 10.9, 12.0].map(|k| curve([k; 6], [0.0; 6], Extension::Constant));
    potential.cubic = std::array::from_fn(|_| curve([0.0; 6], [0.0; 6], Extension::Constant));
    potential.validate(DVec3::Z, RANGE).unwrap();
}

#[test]
fn a_press_that_softens_is_refused() {
    let sound = potential(1, 0.0);
    let mut soft = sound.clone();
    let (values, slopes): (Vec<f64>, Vec<f64>) = KNOTS.iter().map(|k| (k * k, 2.0 * k)).unzip();
    let [mut values, mut slopes] = [values, slopes].map(|v| <[f64; 6]>::try_from(v).unwrap());
    soft.press = curve(values, slopes, Extension::Quadratic);
    soft.validate(DVec3::Z, RANGE).unwrap();
    // The force at a knot falls behind a parabola's.
    slopes[3] *= 0.7;
    values[3] *= 0.95;
    soft.press = curve(values, slopes, Extension::Quadratic);
    let message = refusal(&soft);
    assert!(message.contains("press force F' falls"), "{message}");
}

#[test]
fn knots_and_extensions_must_agree() {
    let sound = potential(1, 0.3);
    let mut other = sound.clone();
    let knots = [0.0, 1e-3, 6e-3];
    other.quartic = Curve::hermite(&knots, &[1e4; 3], &[0.0; 3], Extension::Constant).unwrap();
    assert!(refusal(&other).contains("Q is on other knots"));
    let mut other = sound.clone();
    other.quartic = curve([1e4; 6], [0.0; 6], Extension::Linear);
    assert!(refusal(&other).contains("Q goes on Linear"));
}
