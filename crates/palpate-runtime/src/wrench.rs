//! Six axes in one: where a rigid body is, how it went on from there, and what acts on it.

use glam::{DQuat, DVec3};
use palpate_device::Pose;
use palpate_engine::ToolState;

/// Position, m, and orientation, (w, x, y, z), in some frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placement {
    pub position: DVec3,
    pub orientation: [f64; 4],
}

/// The way from one placement to the next: a translation, m, and a rotation vector, rad, in the same frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Displacement {
    pub translation: DVec3,
    pub rotation: DVec3,
}

/// A force, N, and a torque about the reference point, N·m, in some frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Wrench {
    pub force: DVec3,
    pub torque: DVec3,
}

impl Default for Placement {
    fn default() -> Self {
        Pose::default().into()
    }
}

impl From<Pose> for Placement {
    fn from(Pose { position_m, orientation }: Pose) -> Self {
        Placement { position: DVec3::from_array(position_m), orientation }
    }
}

impl From<ToolState> for Placement {
    fn from(ToolState { position_m, orientation }: ToolState) -> Self {
        Placement { position: DVec3::from_array(position_m), orientation }
    }
}

impl From<Placement> for ToolState {
    fn from(Placement { position, orientation }: Placement) -> Self {
        ToolState { position_m: position.to_array(), orientation }
    }
}

impl Placement {
    /// From here to `next`.
    #[inline]
    pub fn displacement_to(&self, next: &Placement) -> Displacement {
        Displacement {
            translation: next.position - self.position,
            rotation: rotation_between(self.orientation, next.orientation),
        }
    }
}

impl Wrench {
    /// Work of this wrench, held in its frame, along this displacement, J: F·Δx + τ·Δθ. Exact for a rotation about an axis that stays.
    pub fn work(&self, along: &Displacement) -> f64 {
        let work = self.force.dot(along.translation);
        // No torque costs nothing, to the bit.
        if self.torque == DVec3::ZERO { work } else { work + self.torque.dot(along.rotation) }
    }
}

/// The rotation vector, rad, that leads from one orientation to the other, at most half a turn; its frame is
/// theirs.
#[inline]
pub(crate) fn rotation_between(from: [f64; 4], to: [f64; 4]) -> DVec3 {
    // Most handles don't turn.
    if from == to { DVec3::ZERO } else { turned_between(from, to) }
}

fn turned_between(from: [f64; 4], to: [f64; 4]) -> DVec3 {
    let q = quaternion(to) * quaternion(from).conjugate();
    let q = if q.w < 0.0 { -q } else { q };
    let sine = q.xyz().length();
    if sine == 0.0 { DVec3::ZERO } else { q.xyz() * (2.0 * libm::atan2(sine, q.w) / sine) }
}

/// `orientation` turned on by the rotation vector `by`, rad.
pub(crate) fn turned(orientation: [f64; 4], by: DVec3) -> [f64; 4] {
    let angle = by.length();
    if angle == 0.0 {
        return orientation;
    }
    let (sin, cos) = libm::sincos(0.5 * angle);
    let DVec3 { x, y, z } = by * (sin / angle);
    components((DQuat::from_xyzw(x, y, z, cos) * quaternion(orientation)).normalize())
}

/// From (w, x, y, z).
pub(crate) fn quaternion([w, x, y, z]: [f64; 4]) -> DQuat {
    DQuat::from_xyzw(x, y, z, w)
}

/// As (w, x, y, z).
pub(crate) fn components(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_on_and_back_are_each_others_inverse() {
        let start = components(DQuat::from_xyzw(0.1, -0.5, 0.3, 0.8).normalize());
        for by in [DVec3::new(0.3, -0.2, 1.1), DVec3::X * 3.1, DVec3::splat(1e-9), DVec3::Z * 1e-200] {
            let there = turned(start, by);
            let found = rotation_between(start, there);
            // A quaternion's own rounding.
            assert!(found.distance(by) < 1e-15 * (1.0 + 1e3 * by.length()), "{by}: {found}");
            // The same rotation has two quaternions.
            assert!(rotation_between(start, there.map(|c| -c)).distance(found) < 1e-12);
        }
        assert_eq!(rotation_between(start, start), DVec3::ZERO);
        assert_eq!(turned(start, DVec3::ZERO), start);
    }

    #[test]
    fn work_is_of_force_and_torque() {
        let from = Placement { position: DVec3::X, ..Placement::default() };
        let to = Placement { position: DVec3::Y, orientation: turned(from.orientation, DVec3::Z * 0.5) };
        let wrench = Wrench { force: DVec3::new(1.0, 2.0, 3.0), torque: DVec3::new(4.0, 5.0, 6.0) };
        assert!((wrench.work(&from.displacement_to(&to)) - (1.0 + 3.0)).abs() < 1e-14);
    }
}
