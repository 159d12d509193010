//! The sampled loop: down to which depth a device's damping and friction make up for the sampling (MODEL 5).

use palpate_body::{Body, Curve};
use palpate_device::Mechanics;
use palpate_runtime::sampled_data::{damping_needed, late};
use serde::Serialize;

/// What of a device bears on it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Device {
    /// Viscous damping b that is always there, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Rate of the loop 1/T, Hz.
    pub rate_hz: f64,
    /// Greatest error e of a measured position, m: √3/2 of the encoder's step at the tool, half a step along each axis.
    pub position_error_m: f64,
    /// Coulomb friction c_f, N.
    pub coulomb_n: f64,
    /// Samples by which a force comes late, or parts of one.
    pub delay_samples: f64,
}

impl Device {
    /// A real device's mechanics, in a loop of this rate.
    pub fn of(mechanics: &Mechanics, rate_hz: f64) -> Self {
        Device {
            damping_n_s_per_m: mechanics.damping_n_s_per_m.value,
            rate_hz,
            // The body's stiffness couples the axes, so that the error's length counts, not its part along one axis.
            position_error_m: 0.5 * 3f64.sqrt() * mechanics.resolution_m.value,
            coulomb_n: mechanics.coulomb_n.value,
            delay_samples: late(mechanics) * rate_hz,
        }
    }
}

/// Down to where the sampled loop is passive.
#[derive(Debug, Clone, Serialize)]
pub struct Limits {
    /// Of the device.
    #[serde(flatten)]
    pub device: Device,
    /// The greatest stiffness it can hold, N/m; null, like the two below, where a delay or an error of position makes it a
    /// matter of L or of the contact point's way, and that is not bounded.
    pub stiffness_limit_n_per_m: Option<f64>,
    /// The depth δz down to which no place of the body is stiffer; 0 if the body is too stiff laterally at any depth.
    pub depth_limit_m: Option<f64>,
    /// The normal force up to which no place is as deep.
    pub force_limit_n: Option<f64>,
    /// Whether that is all of the depth that the curves know.
    pub whole_depth: bool,
    /// The contact point's way by the tool's, at most; null where it is not bounded.
    pub contact_way_ratio: Option<f64>,
}

/// The limits of `device` on `body`: b ≥ K T/2 + L D ([`damping_needed`]), and c_f ≥ K e (1 + |Δc|/|Δx|).
///
/// `lipschitz` is L, N/m, and `pace` the bound of |Δc|/|Δx|, where they exist; without them nothing is known of a device
/// with a delay, or of one with an error of position.
pub fn limits(body: &Body, device: Device, lipschitz: Option<f64>, pace: Option<f64>) -> Limits {
    let period = 1.0 / device.rate_hz;
    let delay = device.delay_samples * period;
    let delayed =
        if delay == 0.0 { Some(0.0) } else { lipschitz.map(|l| damping_needed(0.0, l, period, delay)) };
    let by_friction = if device.position_error_m == 0.0 {
        Some(f64::INFINITY)
    } else {
        pace.map(|pace| device.coulomb_n / (device.position_error_m * (1.0 + pace)))
    };
    let stiffness = delayed.zip(by_friction).map(|(delayed, by_friction)| {
        let by_damping = (device.damping_n_s_per_m - delayed) / damping_needed(1.0, 0.0, period, 0.0);
        by_damping.min(by_friction).max(0.0)
    });
    let end = body.responses().depth_knots().values().last().copied().unwrap_or_default();
    let depth = stiffness.map(|stiffness| {
        if palpate_body::stiffness::stiffness_aside(body) > stiffness {
            return 0.0;
        }
        if body.is_coupled() {
            let table = palpate_body::stiffness::stiffness_max(body);
            return table.iter().take_while(|at| at.value <= stiffness).last().map_or(0.0, |at| at.depth_m);
        }
        let depth = |curve: &Curve| depth_of_slope(curve, stiffness);
        body.curves().iter().map(|r| depth(&r.normal)).fold(end, f64::min)
    });
    // Pressed deeper, every blend of curves gives at least the softest one's force.
    let force = |depth| body.curves().iter().map(|r| r.normal.value(depth)).fold(f64::INFINITY, f64::min);
    Limits {
        device,
        stiffness_limit_n_per_m: stiffness,
        depth_limit_m: depth,
        // A coupled law's normal force depends on the lateral deflection, too.
        force_limit_n: depth.filter(|_| !body.is_coupled()).map(force),
        whole_depth: depth == Some(end),
        contact_way_ratio: pace,
    }
}

/// The depth down to which the slope stays at or below `most`; the curve's end where it always does.
fn depth_of_slope(curve: &Curve, most: f64) -> f64 {
    for (b, k) in curve.ordinates().iter().zip(curve.knots().windows(2)) {
        // The slope's Bernstein ordinates, and its powers in t from 0 to 1.
        let [d0, d1, d2] = [b[1] - b[0], b[2] - b[1], b[3] - b[2]].map(|d| 3.0 * d / (k[1] - k[0]));
        let (p, q, r) = (d0 - 2.0 * d1 + d2, 2.0 * (d1 - d0), d0 - most);
        // Rounding of a curve that is straight.
        if r > 1e-9 * most {
            return k[0];
        }
        let root = (q * q - 4.0 * p * r).max(0.0).sqrt();
        // Both roots without cancellation.
        let s = -0.5 * (q + if q < 0.0 { -root } else { root });
        let roots = [s / p, r / s];
        let first = roots.into_iter().filter(|t| *t > 1e-9 && *t < 1.0).fold(f64::INFINITY, f64::min);
        if first < 1.0 && q * q >= 4.0 * p * r && r < 0.0 {
            return k[0] + first * (k[1] - k[0]);
        }
        if r.abs() <= 1e-9 * most && (q > 1e-9 * most || (q.abs() <= 1e-9 * most && p > 1e-9 * most)) {
            return k[0];
        }
    }
    curve.knots().last().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_device::presets;

    #[test]
    fn damping_for_a_hold_and_a_delay() {
        let (k, l, t) = (600.0, 900.0, 1e-3);
        let close = |d: f64, expected: f64| {
            let found = damping_needed(k, l, t, d);
            assert!((found - expected).abs() < 1e-12, "{d}: {found}, not {expected}");
        };
        close(0.0, 0.3);
        // Whole samples: (K/2 + n L) T.
        close(1e-3, 0.3 + 0.9);
        close(3e-3, 0.3 + 2.7);
        // Between them it grows, from half a sample at once.
        close(1e-9, 0.3 + 0.45 + 0.5 * l * 1e-9);
        close(0.4e-3, 0.3 + 900.0 * 0.7e-3);
    }

    /// A device's three encoders are off by half a step each at worst.
    #[test]
    fn the_error_of_a_position_has_three_axes() {
        let falcon = presets::device("falcon").unwrap().mechanics;
        let half = 0.5 * falcon.resolution_m.value;
        let corner = glam::DVec3::splat(half).length();
        assert!((Device::of(&falcon, 1e3).position_error_m / corner - 1.0).abs() < 1e-15);
    }
    use palpate_body::{Extension, Interpolation};

    #[test]
    fn a_slope_is_found_where_it_is_reached() {
        // f = 100 k δ², slope 200 k δ.
        let knots: Vec<f64> = (0..=8).map(|i| f64::from(i) * 1e-3).collect();
        let (values, slopes): (Vec<f64>, Vec<f64>) = knots.iter().map(|d| (6e4 * d * d, 1.2e5 * d)).unzip();
        let curve = Curve::hermite(&knots, &values, &slopes, Extension::Linear).unwrap();
        for most in [1.0, 119.0, 121.0, 490.0, 959.0] {
            assert!((depth_of_slope(&curve, most) - most / 1.2e5).abs() < 1e-9, "{most}");
        }
        assert_eq!(depth_of_slope(&curve, 961.0), 8e-3);
        let line =
            Curve::through(&[0.0, 1e-3, 8e-3], &[0.0, 0.5, 4.0], Interpolation::Linear, Extension::Linear);
        assert_eq!(depth_of_slope(line.as_ref().unwrap(), 500.0), 8e-3);
        assert_eq!(depth_of_slope(&line.unwrap(), 499.0), 0.0);
        // Greatest in the middle of a piece: 3 t (1 − t) and so on.
        let curve = Curve::hermite(&[0.0, 1.0], &[0.0, 1.0], &[0.0, 0.0], Extension::Linear).unwrap();
        let t = 0.5 - (0.25f64 - 1.0 / 6.0).sqrt();
        assert!((depth_of_slope(&curve, 1.0) - t).abs() < 1e-12);
        assert_eq!(depth_of_slope(&curve, 1.6), 1.0);
    }
}
