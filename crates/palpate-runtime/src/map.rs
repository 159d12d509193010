//! From the device's workspace to the body's frame, and back for forces.

use glam::{DQuat, DVec3};
use palpate_device::Pose;
use palpate_engine::ToolPose;

/// point_in_body = offset + scale · R · point_in_device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkspaceMap {
    /// R, body from device.
    pub rotation: DQuat,
    /// How much longer a way is in the body than at the device. Forces are not scaled: with another scale than 1 the
    /// operator's work is 1/scale times the body's.
    pub scale: f64,
    /// Where the device's origin is in the body, m.
    pub offset_m: DVec3,
}

impl Default for WorkspaceMap {
    fn default() -> Self {
        WorkspaceMap { rotation: DQuat::IDENTITY, scale: 1.0, offset_m: DVec3::ZERO }
    }
}

impl WorkspaceMap {
    /// A device's pose as the body sees it.
    pub fn body_from_device(&self, pose: &Pose) -> ToolPose {
        let position = self.offset_m + self.rotation * DVec3::from_array(pose.position_m) * self.scale;
        let [w, x, y, z] = pose.orientation;
        let q = self.rotation * DQuat::from_xyzw(x, y, z, w);
        ToolPose { position_m: position.to_array(), orientation: [q.w, q.x, q.y, q.z] }
    }

    /// A force or torque in the body's frame as the device renders it.
    pub fn device_from_body(&self, vector: DVec3) -> DVec3 {
        self.rotation.conjugate() * vector
    }
}
