//! From a vendor's axes to those of the crate: x to the right, y away from the operator, z up.

use glam::{DMat3, DQuat, DVec3};

/// A change of axes, without scaling.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axes(DMat3);

impl Axes {
    /// The vendor's axes are the crate's.
    pub const SAME: Axes = Axes(DMat3::IDENTITY);
    /// The vendor's x towards the operator, y to the right, z up.
    pub const X_TOWARDS: Axes = Axes(DMat3::from_cols(DVec3::NEG_Y, DVec3::X, DVec3::Z));
    /// The vendor's x to the right, y up, z towards the operator.
    pub const Y_UP: Axes = Axes(DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y));

    /// A vector in the crate's axes.
    pub fn ours(self, v: [f64; 3]) -> [f64; 3] {
        (self.0 * DVec3::from_array(v)).to_array()
    }

    /// A vector in the vendor's axes.
    pub fn theirs(self, v: [f64; 3]) -> [f64; 3] {
        (self.0.transpose() * DVec3::from_array(v)).to_array()
    }

    /// The quaternion (w, x, y, z) of the vendor's rotation, whose columns are the handle's axes; the handle's axes are
    /// renamed as the device's are, so that no rotation stays none. `None` where it is no rotation.
    pub fn orientation(self, columns: [[f64; 3]; 3]) -> Option<[f64; 4]> {
        let vendor = DMat3::from_cols_array_2d(&columns);
        let off = (vendor.transpose() * vendor - DMat3::IDENTITY).to_cols_array();
        // A device's kinematics are good to some per mil: its matrix is no rotation only where it is garbage.
        let rotates = off.iter().all(|e| e.abs() < 0.05) && vendor.determinant() > 0.0;
        rotates.then(|| quaternion(DQuat::from_mat3(&(self.0 * vendor * self.0.transpose()))))
    }

    /// The same for a quaternion (w, x, y, z) of the vendor's.
    pub fn orientation_of(self, [w, x, y, z]: [f64; 4]) -> Option<[f64; 4]> {
        let q = DQuat::from_xyzw(x, y, z, w);
        let v = self.0 * DVec3::new(x, y, z);
        ((q.length() - 1.0).abs() < 0.05).then(|| quaternion(DQuat::from_xyzw(v.x, v.y, v.z, w)))
    }
}

fn quaternion(q: DQuat) -> [f64; 4] {
    let q = q.normalize();
    [q.w, q.x, q.y, q.z]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_right_handed_and_undone() {
        for axes in [Axes::SAME, Axes::X_TOWARDS, Axes::Y_UP] {
            assert_eq!(axes.0.determinant(), 1.0);
            let v = [1.0, 2.0, 3.0];
            assert_eq!(axes.theirs(axes.ours(v)), v);
        }
        assert_eq!(Axes::X_TOWARDS.ours([1.0, 0.0, 0.0]), [0.0, -1.0, 0.0]);
        assert_eq!(Axes::X_TOWARDS.ours([0.0, 1.0, 0.0]), [1.0, 0.0, 0.0]);
        assert_eq!(Axes::Y_UP.ours([0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
        assert_eq!(Axes::Y_UP.ours([0.0, 0.0, 1.0]), [0.0, -1.0, 0.0]);
    }

    /// A rotation about the vendor's up is one about z, by the same angle, however it is written.
    #[test]
    fn rotations_follow() {
        let turned = DQuat::from_rotation_y(0.3);
        let columns = DMat3::from_quat(turned).to_cols_array_2d();
        let written = Axes::Y_UP.orientation_of(quaternion(turned)).unwrap();
        let expected = quaternion(DQuat::from_rotation_z(0.3));
        for got in [Axes::Y_UP.orientation(columns).unwrap(), written] {
            assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{got:?}");
        }
    }

    #[test]
    fn what_is_no_rotation_is_refused() {
        let mirror = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        for columns in [[[0.0; 3]; 3], [[f64::NAN; 3]; 3], mirror] {
            assert_eq!(Axes::SAME.orientation(columns), None);
        }
        assert_eq!(Axes::SAME.orientation_of([0.0; 4]), None);
        assert_eq!(Axes::SAME.orientation_of([f64::NAN, 0.0, 0.0, 0.0]), None);
    }
}
