//! Where three hinges bring the handle: about z, then y, then x, each on the one before.

use glam::{DQuat, DVec3};

/// The handle's orientation (w, x, y, z) at these angles about x, y and z, rad: R_z R_y R_x.
pub(super) fn orientation(angles: DVec3) -> [f64; 4] {
    let [x, y, z] = angles.to_array().map(|angle| libm::sincos(0.5 * angle));
    let q = DQuat::from_xyzw(0.0, 0.0, z.0, z.1) * DQuat::from_xyzw(0.0, y.0, 0.0, y.1);
    let q = q * DQuat::from_xyzw(x.0, 0.0, 0.0, x.1);
    [q.w, q.x, q.y, q.z]
}

/// The directions, in the device's frame, of the hinges that turn the handle about its x, y and z. The
/// angular velocity is their sum times the angles' rates, and so by virtual work a hinge's torque is its
/// direction times the torque.
pub(super) fn axes(angles: DVec3) -> [DVec3; 3] {
    let [_, (sy, cy), (sz, cz)] = angles.to_array().map(libm::sincos);
    [DVec3::new(cz * cy, sz * cy, -sy), DVec3::new(-sz, cz, 0.0), DVec3::Z]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turned by a little more at one hinge, the handle turns about that hinge's direction.
    #[test]
    fn the_axes_are_the_orientations_derivatives() {
        let quaternion = |angles| {
            let [w, x, y, z] = orientation(angles);
            DQuat::from_xyzw(x, y, z, w)
        };
        let angles = DVec3::new(0.7, -1.1, 2.3);
        let h = 1e-6;
        for (hinge, direction) in DVec3::AXES.into_iter().zip(axes(angles)) {
            let turn = quaternion(angles + hinge * h) * quaternion(angles - hinge * h).conjugate();
            assert!((turn.xyz() / h).distance(direction) < 1e-9, "{hinge}: {turn} {direction}");
        }
    }
}
