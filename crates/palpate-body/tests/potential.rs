//! What a potential promises is checked on its whole range.

use glam::DVec3;
use palpate_body::law::{AtDepth, coupled_alone};
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
    let [x, y] = coupled_alone(&AtDepth { value, slope: value }, [r * c, r * s], RANGE).lateral;
    x.partials[0] * c + y.partials[0] * s
}

/// What is accepted grows everywhere, and what grows everywhere with something to spare is accepted.
#[test]
fn growth_is_judged_as_it_is() {
    let mut count = [0, 0];
    for seed in 0..60 {
        let potential = potential(seed, (seed % 10) as f64);
        let ordinates = potential.stiffness.iter().flat_map(|c| c.ordinates().as_flattened());
        let stiffest = ordinates.fold(0.0f64, |m, k| m.max(k.abs()));
        let mut least = f64::INFINITY;
        for depth in (0..=40).map(|i| 7e-3 * f64::from(i) / 40.0) {
            for angle in (0..48).map(|a| f64::from(a) * std::f64::consts::TAU / 48.0) {
                for r in [0.0, 0.25, 0.5, 0.75, 0.999_999] {
                    least = least.min(growth(&potential, depth, angle, r * RANGE));
                }
            }
        }
        let verdict = potential.validate(DVec3::Z, RANGE);
        count[usize::from(verdict.is_ok())] += 1;
        // The samples' spacing may hide a little.
        match verdict {
            Ok(()) => assert!(least > 0.0, "{seed}: accepted, with {least} N/m"),
            Err(e) => assert!(least < 0.02 * stiffest, "{seed}: {e}, with {least} of {stiffest} N/m"),
        }
    }
    assert!(count.iter().all(|&c| c > 10), "{count:?} were refused and accepted");
}

/// No stiffness that differences find is above the bound, and the bound is no idle one.
#[test]
fn stiffness_is_bounded() {
    let mut tightest = 0.0f64;
    for seed in 0..20 {
        let potential = potential(seed, 0.5);
        let bounds = potential.stiffness_bounds(RANGE);
        let mut greatest = 0.0f64;
        for i in 0..100 {
            let depth = 6e-3 * f64::from(i) / 99.0;
            for angle in (0..16).map(|a| f64::from(a) * std::f64::consts::TAU / 16.0) {
                for r in [0.0, 0.3, 0.7, 0.999_999].map(|r| r * RANGE) {
                    greatest = greatest.max(stiffness(
                        &potential,
                        depth,
                        [r * libm::cos(angle), r * libm::sin(angle)],
                    ));
                }
            }
            let bound = bounds[KNOTS.iter().position(|&k| k >= depth).unwrap()];
            assert!(greatest <= bound, "{seed}: {greatest} N/m above {bound} at {depth} m");
        }
        tightest = tightest.max(greatest / bounds[5]);
        assert!(greatest > 0.3 * bounds[5], "{seed}: {greatest} of {} N/m", bounds[5]);
    }
    println!("at best {tightest:.2} of the bound is reached");
}

/// The greatest v·H v over unit vectors v, N/m.
fn stiffness(potential: &Potential, depth: f64, xi: [f64; 2]) -> f64 {
    let force = |d: f64, xi| {
        let law = potential.at(d, xi, RANGE);
        DVec3::new(law.normal, law.lateral[0], law.lateral[1])
    };
    let h = 1e-8;
    let at = [[h, 0.0, 0.0], [0.0, h, 0.0], [0.0, 0.0, h]];
    let columns = at.map(|[d, x, y]| (force(depth + d, [xi[0] + x, xi[1] + y]) - force(depth, xi)) / h);
    let hessian = glam::DMat3::from_cols(columns[0], columns[1], columns[2]);
    // The power method on a matrix that is shifted to be positive.
    let shift = 2.0 * columns.iter().map(|c| c.length()).fold(0.0, f64::max);
    let v = (0..60).fold(DVec3::new(0.5, 0.6, 0.7), |v, _| (hessian * v + v * shift).normalize());
    // Differences are off by some 10⁻⁶.
    v.dot(hessian * v) * (1.0 - 1e-5)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, rng_seed: proptest::test_runner::RngSeed::Fixed(2003), failure_persistence: None, ..Default::default() })]

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

/// Between two knots alone, and by little.
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
