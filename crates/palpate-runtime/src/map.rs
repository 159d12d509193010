//! From the device's workspace to the body's frame, and back for forces.

use crate::SafetyError;
use crate::wrench::{Wrench, components, quaternion};
use glam::{DQuat, DVec3};
use palpate_device::{Capabilities, Pose, Sample};
use palpate_engine::ToolState;

/// No tool is longer, m.
const LONGEST_TOOL: f64 = 10.0;

/// point_in_body = offset + scale · R · point_in_device; the point is the tool's tip, which the handle
/// carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkspaceMap {
    /// R, body from device.
    pub rotation: DQuat,
    /// How much longer a way is in the body than at the device. Forces are not scaled, and torques by
    /// 1/scale, as their levers are: with another scale than 1 the operator's work is 1/scale times the
    /// body's.
    pub scale: f64,
    /// Where the device's origin is in the body, m.
    pub offset_m: DVec3,
    /// Where the tool's tip (its reference point) is in the handle's frame, m.
    pub tip_in_handle_m: DVec3,
    /// How the tool is turned in the handle's frame.
    pub handle_from_tool: DQuat,
    /// The button that lifts the tool out of the body's frame while it is held, as a mouse is lifted.
    pub clutch: Option<u32>,
}

impl Default for WorkspaceMap {
    fn default() -> Self {
        WorkspaceMap {
            rotation: DQuat::IDENTITY,
            scale: 1.0,
            offset_m: DVec3::ZERO,
            tip_in_handle_m: DVec3::ZERO,
            handle_from_tool: DQuat::IDENTITY,
            clutch: None,
        }
    }
}

impl WorkspaceMap {
    /// The map with its rotations made units again, if it can be used with this device.
    ///
    /// # Errors
    /// A number that is not finite, a scale that is not above 0, a tip that no handle holds, a rotation of no
    /// length, a button that is not there.
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
        let tip = self.tip_in_handle_m;
        if !(tip.is_finite() && tip.length() <= LONGEST_TOOL) {
            let problem = format!("{tip} holds NaN or infinity, or is longer than {LONGEST_TOOL} m");
            return Err(error("tip_in_handle_m", problem, "give three numbers in metres"));
        }
        let unit = |setting, q: DQuat| {
            let length = q.length();
            if (0.5..=2.0).contains(&length) {
                return Ok(q.normalize());
            }
            let problem = format!("{q} is no rotation: its length is {length}, not 1");
            Err(error(setting, problem, "give a unit quaternion"))
        };
        let rotation = unit("rotation", self.rotation)?;
        let handle_from_tool = unit("handle_from_tool", self.handle_from_tool)?;
        let buttons = device.buttons.min(32);
        if let Some(button) = self.clutch.filter(|button| *button >= buttons) {
            let problem =
                format!("{} has {buttons} buttons, counted from 0, and no button {button}", device.name);
            return Err(error("clutch", problem, "name another one, or none"));
        }
        Ok(WorkspaceMap { rotation, handle_from_tool, ..self })
    }

    /// The tool, its tip, as the body sees it, at a device's pose.
    pub fn body_from_device(&self, pose: &Pose) -> ToolState {
        let mut tip = DVec3::from_array(pose.position_m);
        if let Some(lever) = self.lever(pose) {
            tip += lever;
        }
        let position = self.offset_m + self.rotation * tip * self.scale;
        let mut q = self.rotation * quaternion(pose.orientation);
        if self.handle_from_tool != DQuat::IDENTITY {
            q *= self.handle_from_tool;
        }
        ToolState { position_m: position.to_array(), orientation: components(q) }
    }

    /// A force in the body's frame as the device renders it.
    pub fn device_from_body(&self, vector: DVec3) -> DVec3 {
        self.rotation.conjugate() * vector
    }

    /// What the handle at `pose` feels, in the device's frame, of a wrench at the tool's tip in the body's:
    /// the same force, and r × F besides the torque, with r from the handle to the tip.
    pub(crate) fn at_handle(&self, pose: &Pose, at_tip: Wrench) -> Wrench {
        let force = self.device_from_body(at_tip.force);
        let mut torque = self.device_from_body(at_tip.torque) / self.scale;
        // Without a force the pose may be one that was not accepted.
        if let Some(lever) = self.lever(pose).filter(|_| force != DVec3::ZERO) {
            torque += lever.cross(force);
        }
        Wrench { force, torque }
    }

    /// From the handle to the tip, in the device's frame, if they are not the same point.
    fn lever(&self, pose: &Pose) -> Option<DVec3> {
        (self.tip_in_handle_m != DVec3::ZERO).then(|| quaternion(pose.orientation) * self.tip_in_handle_m)
    }
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
    use crate::wrench::{Placement, turned};

    fn sample(position_m: [f64; 3], orientation: [f64; 4], buttons: u32) -> Sample {
        Sample { pose: Pose { position_m, orientation }, buttons, ..Sample::default() }
    }

    #[test]
    fn points_and_forces_go_each_its_way() {
        let map = WorkspaceMap {
            rotation: DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
            scale: 2.0,
            offset_m: DVec3::Z,
            ..WorkspaceMap::default()
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
            (WorkspaceMap { tip_in_handle_m: DVec3::X * f64::NAN, ..map }, "tip_in_handle_m"),
            (WorkspaceMap { tip_in_handle_m: DVec3::X * 11.0, ..map }, "tip_in_handle_m"),
            (
                WorkspaceMap { handle_from_tool: DQuat::from_xyzw(0.0, 0.0, 9.0, 0.0), ..map },
                "handle_from_tool",
            ),
            (WorkspaceMap { clutch: Some(1), ..map }, "clutch"),
        ];
        for (map, setting) in wrong {
            assert_eq!(map.checked(&device).unwrap_err().setting, setting);
        }
    }

    /// The tool's tip 5 cm below the handle and the device's frame turned: whichever way the handle goes, the
    /// operator's work at it is 1/scale times the body's work at the tip.
    #[test]
    fn the_wrench_at_the_handle_does_the_work_of_the_one_at_the_tip() {
        let map = WorkspaceMap {
            rotation: DQuat::from_euler(Default::default(), 0.4, -1.2, 2.0),
            scale: 2.5,
            offset_m: DVec3::X,
            tip_in_handle_m: DVec3::new(0.01, 0.0, -0.05),
            handle_from_tool: DQuat::from_rotation_y(0.7),
            clutch: None,
        };
        let pose = |t: f64| Pose {
            position_m: [0.1 * t, -0.2, 0.3 * t],
            orientation: turned(components(DQuat::from_rotation_x(0.9)), DVec3::new(0.5, 0.2, -1.0) * t),
        };
        let tip = Wrench { force: DVec3::new(1.0, -2.0, 0.5), torque: DVec3::new(0.02, 0.01, -0.03) };
        let h = 1e-6;
        let [before, now, after] = [pose(-h), pose(0.0), pose(h)];
        let [body_before, body_after] = [before, after].map(|p| Placement::from(map.body_from_device(&p)));
        let at_tip = tip.work(&body_before.displacement_to(&body_after));
        let at_handle =
            map.at_handle(&now, tip).work(&Placement::from(before).displacement_to(&Placement::from(after)));
        assert!((at_handle * map.scale - at_tip).abs() < 1e-9 * at_tip.abs(), "{at_handle} {at_tip}");
        // A force on the tip, across the handle: the lever's torque.
        let map = WorkspaceMap { tip_in_handle_m: DVec3::Z * -0.05, ..WorkspaceMap::default() };
        let wrench = map.at_handle(&Pose::default(), Wrench { force: DVec3::X, torque: DVec3::ZERO });
        assert_eq!((wrench.force, wrench.torque), (DVec3::X, DVec3::Y * -0.05));
    }

    /// Pressed, moved and turned, released: the body's side stands still and then goes on from where it was.
    #[test]
    fn nothing_jumps_at_the_clutch() {
        let map = WorkspaceMap {
            rotation: DQuat::from_rotation_x(0.4),
            scale: 1.5,
            offset_m: DVec3::new(0.1, 0.2, 0.3),
            clutch: Some(1),
            tip_in_handle_m: DVec3::new(0.0, 0.01, -0.05),
            handle_from_tool: DQuat::from_rotation_x(0.2),
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
