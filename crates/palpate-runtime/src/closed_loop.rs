//! One period of the loop.

use crate::{Coupling, PassivityController, WorkspaceMap};
use glam::DVec3;
use palpate_body::Body;
use palpate_device::{Command, Device, Fault, Sample};
use palpate_engine::{Contact, Output, ToolPose};

/// What lies between the engine and the device. All but the force limit are off by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stages {
    /// A spring between the device and a virtual tool that touches the body in its place.
    pub coupling: Option<Coupling>,
    /// Takes back energy that the loop would give out.
    pub passivity: Option<PassivityController>,
    /// No command is larger, N; `None` for no limit.
    pub force_max_n: Option<f64>,
}

/// The loop on one body with one device.
#[derive(Debug, Clone)]
pub struct HapticLoop {
    contact: Contact,
    map: WorkspaceMap,
    stages: Stages,
    port: Port,
    limited: u64,
}

/// What a period saw and did.
#[derive(Debug, Clone, Copy)]
pub struct Period {
    /// s.
    pub time_s: f64,
    /// What the device said.
    pub sample: Sample,
    /// The pose that the engine was given, in the body's frame: the virtual tool's under a coupling.
    pub pose: ToolPose,
    /// What the engine answered.
    pub output: Output,
    /// What the device was told.
    pub command: Command,
}

/// The engine's port to the loop: its force is held from one pose to the next.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Port {
    /// E_out = Σ F_k · (x_(k+1) − x_k), F on the tool, J: what was given out.
    pub out_j: f64,
    /// Σ |x_(k+1) − x_k|², m²: half of K_max times this is what sampling alone can let out (MODEL 9 j).
    pub squares_m2: f64,
    last: Option<(DVec3, DVec3)>,
}

impl Port {
    fn pass(&mut self, x: DVec3, force: DVec3) {
        if let Some((before, held)) = self.last {
            self.out_j += held.dot(x - before);
            self.squares_m2 += x.distance_squared(before);
        }
        self.last = Some((x, force));
    }
}

impl HapticLoop {
    /// A loop that renders `contact` through `stages`.
    pub fn new(contact: Contact, map: WorkspaceMap, stages: Stages) -> Self {
        HapticLoop { contact, map, stages, port: Port::default(), limited: 0 }
    }

    /// The contact as it is now.
    pub fn contact(&self) -> &Contact {
        &self.contact
    }

    /// The engine's port.
    pub fn port(&self) -> &Port {
        &self.port
    }

    /// The stages as they are now.
    pub fn stages(&self) -> &Stages {
        &self.stages
    }

    /// How many commands were cut to the force limit.
    pub fn limited(&self) -> u64 {
        self.limited
    }

    /// One period at `now_s` after the device's opening: read, map, step, output stages, write.
    ///
    /// # Errors
    /// What the device's `read` or `write` reports.
    ///
    /// # Real-time
    /// As bounded as the device's `read` and `write`.
    pub fn step(&mut self, body: &Body, device: &mut dyn Device, now_s: f64) -> Result<Period, Fault> {
        let sample = device.read(now_s)?;
        let mut pose = self.map.body_from_device(&sample.pose);
        if let Some(coupling) = &mut self.stages.coupling {
            pose.position_m = coupling.tool(DVec3::from_array(pose.position_m)).to_array();
        }
        let output = self.contact.step(body, &pose);
        let force = DVec3::from_array(output.force_n);
        self.port.pass(DVec3::from_array(pose.position_m), force);
        let command = self.command(DVec3::from_array(sample.pose.position_m), force, output.torque_nm);
        device.write(&command)?;
        Ok(Period { time_s: now_s, sample, pose, output, command })
    }

    /// The output stages, in order: coupling, map, passivity, limit.
    fn command(&mut self, device: DVec3, force: DVec3, torque: [f64; 3]) -> Command {
        let Stages { coupling, passivity, force_max_n } = &mut self.stages;
        let coupled = coupling.as_mut().map_or(force, |c| c.force(force));
        let wanted = self.map.device_from_body(coupled);
        let passive = passivity.as_mut().map_or(wanted, |p| p.pass(device, wanted));
        let most = force_max_n.unwrap_or(f64::INFINITY);
        self.limited += u64::from(passive.length() > most);
        let limited = passive.clamp_length_max(most);
        if let Some(passivity) = passivity {
            passivity.rendered(limited);
        }
        let torque = self.map.device_from_body(DVec3::from_array(torque));
        Command { force_n: limited.to_array(), torque_nm: torque.to_array() }
    }
}
