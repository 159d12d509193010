//! Coupled laws by chance, for tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use glam::DVec3;
use palpate_body::{Curve, Extension, Potential};

/// Of all potentials here, m.
pub const KNOTS: [f64; 6] = [0.0, 0.5e-3, 1.5e-3, 3e-3, 5e-3, 6e-3];
/// Up to which |ξ| they hold, m.
pub const RANGE: f64 = 2e-3;

/// A curve on [`KNOTS`].
pub fn curve(values: [f64; 6], slopes: [f64; 6], extension: Extension) -> Curve {
    Curve::hermite(&KNOTS, &values, &slopes, extension).unwrap()
}

/// A potential at a test point whose normal is z, the same for the same seed. Its cubic terms have some `cubic` times the size
/// up to which its lateral forces surely grow.
pub fn potential(seed: u64, cubic: f64) -> Potential {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut unit = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    // Between two values, with modest slopes that end as they must; from 0 where it begins there.
    let mut between = |low: f64, high: f64, from_zero: bool| {
        let mut values: [f64; 6] = std::array::from_fn(|_| low + (high - low) * unit());
        let mut slopes: [f64; 6] = std::array::from_fn(|_| (high - low) * (unit() - 0.5) * 100.0);
        (slopes[0], slopes[5]) = (0.0, 0.0);
        if from_zero {
            values[0] = 0.0;
        }
        curve(values, slopes, Extension::Constant)
    };
    let offset = [between(-0.05, 0.05, true), between(-0.05, 0.05, true)];
    let stiffness = [between(12.0, 25.0, false), between(-4.0, 4.0, false), between(12.0, 25.0, false)];
    // 6 r C(e³) reaches 6 × 2 mm × 2 c at most.
    let c = 200.0 * cubic;
    let cubic = std::array::from_fn(|_| between(-c, c, false));
    let quartic = between(0.0, 1e4, false);
    let friction = between(0.1, 0.5, false);
    let stiff = 100.0 + 400.0 * unit();
    let (values, slopes): (Vec<f64>, Vec<f64>) =
        KNOTS.iter().map(|k| (stiff * k * k * (1.0 + 100.0 * k), stiff * k * (2.0 + 300.0 * k))).unzip();
    let [values, slopes] = [values, slopes].map(|v| <[f64; 6]>::try_from(v).unwrap());
    let press = curve(values, slopes, Extension::Quadratic);
    let turn = DVec3::new(unit() - 0.5, unit() - 0.5, 0.0).normalize();
    Potential {
        tangents: [turn, DVec3::Z.cross(turn)],
        press,
        offset,
        stiffness,
        cubic,
        quartic,
        friction,
        curvature: [0.0; 3],
    }
}
