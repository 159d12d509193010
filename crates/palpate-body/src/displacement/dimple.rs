//! The surface under a tool where nothing is known but depth and tool: a dimple.

use super::fields::smoothstep;
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// How the surface moves under a tool where nothing else is known of it, as an elastic half-space does under a ball. A picture, of
/// which no force knows. [`ContactState::dimple`](super::ContactState::dimple) makes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dimple {
    /// The contact point at rest, m, and the unit vector into the body there.
    point: DVec3,
    inward: DVec3,
    /// What the contact point is displaced by, m.
    motion: DVec3,
    /// Radius of the contact patch, m.
    patch: f64,
}

impl Dimple {
    /// Of a contact that is so deep, under a ball of this radius or a tip, 0.
    pub(super) fn new(point: DVec3, inward: DVec3, motion: DVec3, depth: f64, radius: f64) -> Self {
        // A tip has no patch of its own; its dimple is about as wide as it is deep.
        let patch = if radius > 0.0 { (radius * depth).sqrt().min(radius) } else { 0.5 * depth };
        Dimple { point, inward, motion, patch }
    }

    /// The displacement, m, of a place (m, at rest) where `inward` is the unit vector into the body: what faces another way than
    /// the contact point, as the other side of something thin does, stays.
    pub fn displacement(&self, place: DVec3, inward: DVec3) -> DVec3 {
        let share = share(place.distance(self.point) / self.patch);
        let facing = if share > 0.0 { smoothstep((inward.dot(self.inward) + 0.2) / 0.7) } else { 0.0 };
        self.motion * (facing * share)
    }
}

/// Where the dimple begins to fade, and where it ends, in radii of the patch.
const FADES: [f64; 2] = [4.0, 12.0];

/// Which part of the contact point's motion the surface takes on r patch radii away from it: 1 there, falling to 0.
///
/// Hertz's: 1 − r²/2 in the patch and outside ((2 − r²) asin(1/r) + √(r² − 1))/π (Johnson, Contact Mechanics, 1985,
/// eqs. 3.42). Far away that goes with 1/r; here it fades and ends.
fn share(r: f64) -> f64 {
    let [first, last] = FADES;
    if r <= 1.0 {
        return 1.0 - 0.5 * r * r;
    }
    if r >= last {
        return 0.0;
    }
    let outside = ((2.0 - r * r) * libm::asin(1.0 / r) + (r * r - 1.0).sqrt()) * FRAC_1_PI;
    outside * (1.0 - smoothstep((r - first) / (last - first)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dimple_falls_smoothly_from_one_to_nothing() {
        for radius in [0.0, 5e-3] {
            let dimple = Dimple::new(DVec3::ZERO, DVec3::NEG_Z, DVec3::NEG_Z, 2e-3, radius);
            let at = |x: f64| -dimple.displacement(DVec3::X * x, DVec3::NEG_Z).z;
            assert_eq!((at(0.0), at(0.1)), (1.0, 0.0));
            for i in 0..5000 {
                let fall = at(f64::from(i) * 1e-5) - at(f64::from(i + 1) * 1e-5);
                assert!((0.0..0.02).contains(&fall), "{radius} {i} {fall}");
            }
            // The far side of something thin.
            assert_eq!(dimple.displacement(DVec3::ZERO, DVec3::Z), DVec3::ZERO);
        }
        // Hertz: half of the depth at the patch's rim, and 4/(3π) a/r as under a point force, as far as nothing fades.
        assert!((share(1.0) - 0.5).abs() < 1e-12 && (share(1.0 + 1e-6) - 0.5).abs() < 1e-5);
        assert!((share(4.0) * 4.0 - 4.0 / (3.0 * std::f64::consts::PI)).abs() < 0.02);
    }
}
