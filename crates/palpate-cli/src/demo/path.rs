//! The scripted path: press, drag, circle, release, as one smooth function of time.

use super::cylinder::RADIUS;
use glam::DVec3;
use std::f64::consts::TAU;

/// Duration, s.
pub const DURATION: f64 = PRESSED + DRAG + CIRCLE + PRESS;
/// From here to [`DRAGGED`] the tool drags at constant depth, s.
pub const PRESSED: f64 = 0.7;
/// The drag's end and the circle's beginning, s.
pub const DRAGGED: f64 = PRESSED + DRAG;
/// The circle's end and the release's beginning, s.
pub const CIRCLED: f64 = DRAGGED + CIRCLE;

const PRESS: f64 = PRESSED;
const DRAG: f64 = 2.0;
const CIRCLE: f64 = 1.3;
/// Speeds rise and fall in this time, s.
const RAMP: f64 = 0.25;

/// Height above the body at both ends, m.
const CLEARANCE: f64 = 2e-3;
/// Depth below the true cylinder while dragging, m.
pub const DEPTH: f64 = 5.5e-3;
/// Where the press begins: angle from the x axis, rad, and height, m.
const START: (f64, f64) = (0.37, -14.3e-3);
/// How far the drag goes: around, rad, and along, m.
const WAY: (f64, f64) = (3.4, 27e-3);
/// Radius of the circle, measured on the surface, m.
const CIRCLE_RADIUS: f64 = 8e-3;

/// The tool at time `t` (s), m: three times continuously differentiable, the same curve at every sampling rate.
pub fn tip(t: f64) -> DVec3 {
    let drag = travelled(t - PRESSED, DRAG);
    let turn = TAU * travelled(t - DRAGGED, CIRCLE);
    let angle = START.0 + WAY.0 * drag + CIRCLE_RADIUS / RADIUS * libm::sin(turn);
    let z = START.1 + WAY.1 * drag - CIRCLE_RADIUS * (1.0 - libm::cos(turn));
    let pressed = travelled(t, PRESS) - travelled(t - CIRCLED, PRESS);
    let radius = RADIUS + CLEARANCE - (CLEARANCE + DEPTH) * pressed;
    DVec3::new(radius * libm::cos(angle), radius * libm::sin(angle), z)
}

/// The share of a way that is done after `t` of `duration`: from rest to rest, at constant speed between ramps.
///
/// In a ramp the speed follows the least polynomial that starts and ends without acceleration or jerk,
/// 10τ³ − 15τ⁴ + 6τ⁵, so that what is travelled is its integral τ⁶ − 3τ⁵ + 2.5τ⁴.
fn travelled(t: f64, duration: f64) -> f64 {
    let square = |u: f64| u * u;
    let ramp = |t: f64| {
        let u = t / RAMP;
        if u >= 1.0 { t - RAMP / 2.0 } else { RAMP * square(square(u.max(0.0))) * (2.5 + u * (u - 3.0)) }
    };
    (ramp(t) - ramp(t - (duration - RAMP))).clamp(0.0, duration - RAMP) / (duration - RAMP)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_path_is_smooth() {
        // Third differences are jerk × h³. A jump of the acceleration would show as its size × h², far more.
        let h = 1e-3;
        let third = |t: f64| tip(t + 2.0 * h) - 3.0 * tip(t + h) + 3.0 * tip(t) - tip(t - h);
        let jerk = (0..5000).map(|i| third(f64::from(i) * h).length() / (h * h * h)).fold(0.0, f64::max);
        assert!(jerk < 20.0, "{jerk} m/s³");
    }

    #[test]
    fn it_starts_and_ends_outside_and_keeps_away_from_the_ends() {
        for t in [0.0, DURATION] {
            let p = tip(t);
            assert!((p.x.hypot(p.y) - RADIUS - CLEARANCE).abs() < 1e-12);
        }
        assert!((0..4700).all(|i| tip(i as f64 * 1e-3).z.abs() < 30e-3));
    }
}
