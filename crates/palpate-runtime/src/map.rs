//! From the device's workspace to the body's frame, and back for forces.

use crate::SafetyError;
use glam::{DQuat, DVec3};
use palpate_device::{Capabilities, Pose, Sample};
use palpate_engine::ToolState;

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
    /// The button that lifts the tool out of the body's frame while it is held, as a mouse is lifted.
    pub clutch: Option<u32>,
}

impl Default for WorkspaceMap {
    fn default() -> Self {
        WorkspaceMap { rotation: DQuat::IDENTITY, scale: 1.0, offset_m: DVec3::ZERO, clutch: None }
    }
}

impl WorkspaceMap {
    /// The map with its rotation made a unit again, if it can be used with this device.
    ///
    /// # Errors
    /// A number that is not finite, a scale that is not above 0, a rotation of no length, a button that is not there.
    pub fn checked(self, device: &Capabilities) -> Result<Self, SafetyError> {
        let error =
            |setting, problem: String, hint: &str| SafetyError { setting, problem, hint: hint.into() };
        if !(1e-3..=1e3).contains(&self.scale) {
            let problem = format!("{} is not between 0.001 and 1000", self.scale);
            return Err(error("scale", problem, "give a number in between"));
        }
        // Beyond a kilometre a pose loses the engine's precision.
        if !self.offset_m.is_finite() || self.offset_m.abs().max_element() > 1e3 {
            let problem = format!("{} holds NaN or infinity, or one beyond 1000 m", self.offset_m);
            return Err(error("offset_m", problem, "give three numbers in metres"));
        }
        let length = self.rotation.length();
        if !(0.5..=2.0).contains(&length) {
            let problem = format!("{} is no rotation: its length is {length}, not 1", self.rotation);
            return Err(error("rotation", problem, "give a unit quaternion"));
        }
        let buttons = device.buttons.min(32);
        if let Some(button) = self.clutch.filter(|button| *button >= buttons) {
            let problem =
                format!("{} has {buttons} buttons, counted from 0, and no button {button}", device.name);
            return Err(error("clutch", problem, "name another one, or none"));
        }
        Ok(WorkspaceMap { rotation: self.rotation.normalize(), ..self })
    }

    /// A device's pose as the body sees it.
    pub fn body_from_device(&self, pose: &Pose) -> ToolState {
        let position = self.offset_m + self.rotation * DVec3::from_array(pose.position_m) * self.scale;
        let q = self.rotation * quaternion(pose.orientation);
        ToolState { position_m: position.to_array(), orientation: components(q) }
    }

    /// A force or torque in the body's frame as the device renders it.
    pub fn device_from_body(&self, vector: DVec3) -> DVec3 {
        self.rotation.conjugate() * vector
    }
}

fn quaternion([w, x, y, z]: [f64; 4]) -> DQuat {
    DQuat::from_xyzw(x, y, z, w)
}

fn components(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}

/// The map and its clutch: while the button is held the body's side stays where it was, and on release the offset (and a
/// turn of the tool) are taken anew, so that nothing jumps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mapping {
    pub map: WorkspaceMap,
    /// Of the tool in its own frame, taken up by clutching; `None` for none, to the bit.
    turn: Option<DQuat>,
    held: Option<ToolState>,
}

impl Mapping {
    pub fn new(map: WorkspaceMap) -> Self {
        Mapping { map, turn: None, held: None }
    }

    /// Whether the clutch is held.
    pub fn is_held(&self) -> bool {
        self.held.is_some()
    }

    /// The pose for the body.
    pub fn pose(&mut self, sample: &Sample) -> ToolState {
        let pressed = self.map.clutch.is_some_and(|button| sample.buttons & (1 << (button % 32)) != 0);
        match (self.held, pressed) {
            (Some(held), true) => held,
            (Some(held), false) => {
                self.held = None;
                self.take(&sample.pose, &held);
                // What it was held at, to the bit; from the next pose on, the map's.
                held
            }
            (None, pressed) => {
                let mut pose = self.map.body_from_device(&sample.pose);
                if let Some(turn) = self.turn {
                    pose.orientation = components(quaternion(pose.orientation) * turn);
                }
                self.held = pressed.then_some(pose);
                pose
            }
        }
    }

    /// Makes `pose` of the device mean `held` in the body.
    fn take(&mut self, pose: &Pose, held: &ToolState) {
        let now = self.map.body_from_device(pose);
        self.map.offset_m += DVec3::from_array(held.position_m) - DVec3::from_array(now.position_m);
        let turn = quaternion(now.orientation).conjugate() * quaternion(held.orientation);
        // A handle without sensed rotations gives the identity, up to rounding.
        self.turn = (turn.xyz().length() > 1e-12).then(|| turn.normalize());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(position_m: [f64; 3], orientation: [f64; 4], buttons: u32) -> Sample {
        Sample { pose: Pose { position_m, orientation }, buttons, ..Sample::default() }
    }

    #[test]
    fn points_and_forces_go_each_its_way() {
        let map = WorkspaceMap {
            rotation: DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
            scale: 2.0,
            offset_m: DVec3::Z,
            clutch: None,
        };
        let pose = map.body_from_device(&sample([0.1, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], 0).pose);
        assert!(DVec3::from_array(pose.position_m).distance(DVec3::new(0.0, 0.2, 1.0)) < 1e-15);
        assert!(map.device_from_body(DVec3::Y).distance(DVec3::X) < 1e-15);
    }

    #[test]
    fn a_map_that_cant_be_is_refused() {
        let device = palpate_device::presets::device("touch").unwrap();
        let map = WorkspaceMap { clutch: Some(0), ..WorkspaceMap::default() };
        assert_eq!(map.checked(&device), Ok(map));
        let wrong = [
            (WorkspaceMap { scale: -1.0, ..map }, "scale"),
            (WorkspaceMap { scale: f64::NAN, ..map }, "scale"),
            (WorkspaceMap { offset_m: DVec3::new(0.0, f64::NAN, 0.0), ..map }, "offset_m"),
            (WorkspaceMap { offset_m: DVec3::splat(2e3), ..map }, "offset_m"),
            (WorkspaceMap { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..map }, "rotation"),
            (WorkspaceMap { clutch: Some(1), ..map }, "clutch"),
        ];
        for (map, setting) in wrong {
            assert_eq!(map.checked(&device).unwrap_err().setting, setting);
        }
    }

    /// Pressed, moved and turned, released: the body's side stands still and then goes on from where it was.
    #[test]
    fn nothing_jumps_at_the_clutch() {
        let map = WorkspaceMap {
            rotation: DQuat::from_rotation_x(0.4),
            scale: 1.5,
            offset_m: DVec3::new(0.1, 0.2, 0.3),
            clutch: Some(1),
        };
        let mut mapping = Mapping::new(map);
        let turned = |angle: f64| components(DQuat::from_rotation_y(angle));
        let free = mapping.pose(&sample([0.01, 0.0, 0.0], turned(0.1), 0b01));
        assert!(!mapping.is_held());
        let pressed = mapping.pose(&sample([0.011, 0.0, 0.0], turned(0.11), 0b10));
        assert_ne!(free, pressed);
        for k in 0..10 {
            let held = mapping.pose(&sample([0.01 * f64::from(k), 0.03, 0.0], turned(0.3), 0b11));
            assert!(mapping.is_held() && held == pressed);
        }
        let released = mapping.pose(&sample([0.09, 0.03, 0.0], turned(0.3), 0));
        assert!(!mapping.is_held() && released == pressed);
        let next = mapping.pose(&sample([0.09, 0.03, 0.001], turned(0.3), 0));
        let way = DVec3::from_array(next.position_m) - DVec3::from_array(pressed.position_m);
        assert!((way - map.rotation * DVec3::Z * 1.5e-3).length() < 1e-15, "{way}");
        assert!(quaternion(next.orientation).angle_between(quaternion(pressed.orientation)) < 1e-7);
    }
}
