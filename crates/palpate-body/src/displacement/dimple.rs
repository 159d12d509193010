//! The surface under a tool where nothing is known but depth and tool: a dimple.

use super::fields::smoothstep;
use std::f64::consts::FRAC_1_PI;

/// Which part of the tool's motion the surface takes on `distance` (m) away from the contact point: 1 there, falling to 0.
///
/// Under a ball of this radius it is Hertz's: 1 − r²/2 in the patch and outside ((2 − r²) asin(1/r) + √(r² − 1))/π, with r in
/// patch radii a = √(R δ) (Johnson, Contact Mechanics, 1985, eqs. 3.42). Far away that goes with 1/r; here it ends at
/// twelve patch radii.
pub(super) fn share(distance: f64, depth: f64, radius: f64) -> f64 {
    // A tip has no patch of its own; its dimple is about as wide as it is deep.
    let patch = if radius > 0.0 { (radius * depth).sqrt().min(radius) } else { 0.5 * depth };
    let r = distance / patch;
    if r <= 1.0 {
        return 1.0 - 0.5 * r * r;
    }
    let outside = ((2.0 - r * r) * libm::asin(1.0 / r) + (r * r - 1.0).sqrt()) * FRAC_1_PI;
    outside * (1.0 - smoothstep((r - 4.0) / 8.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dimple_falls_smoothly_from_one_to_nothing() {
        for radius in [0.0, 5e-3] {
            let depth = 2e-3;
            let at = |i: u32| share(f64::from(i) * 1e-5, depth, radius);
            assert_eq!(at(0), 1.0);
            assert_eq!(share(0.1, depth, radius), 0.0);
            for i in 0..5000 {
                let fall = at(i) - at(i + 1);
                assert!((0.0..0.02).contains(&fall), "{radius} {i} {fall}");
            }
        }
        // Hertz: half of the depth at the patch's rim.
        assert!((share((5e-3f64 * 2e-3).sqrt(), 2e-3, 5e-3) - 0.5).abs() < 1e-12);
    }
}
