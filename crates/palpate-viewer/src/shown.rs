//! A state of tool and contact, as it is shown: of a session's or a recording's period, or of a step in virtual time.

use glam::DVec3;
use palpate::engine::{ContactPoint, Flags, Ledger};
use palpate::runtime::{Record, StageFlags};
use palpate::{Contact, Output, ToolState};

/// What is drawn and told of one moment, in the body's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// The loop's time, s.
    pub time_s: f64,
    /// The tool.
    pub tool: ToolState,
    /// The engine's force on the tool, N.
    pub force_n: DVec3,
    /// The engine's torque on the tool, N·m.
    pub torque_nm: DVec3,
    /// Where the body is touched.
    pub contact: Option<ContactPoint>,
    /// What happened in the engine.
    pub flags: Flags,
    /// Energies but for the tank's.
    pub energy: Ledger,
    /// The tank's, J; none where no tank holds slip back, or where it is not known.
    pub tank_j: Option<f64>,
    /// What the device was commanded, N in its own frame; none outside of a loop.
    pub command_n: Option<DVec3>,
    /// What the output stages did.
    pub stages: StageFlags,
    /// What multiplied the body's friction coefficients.
    pub friction_scale: f64,
}

impl Shown {
    /// A step's of this contact.
    pub fn of_step(time_s: f64, tool: ToolState, output: &Output, contact: &Contact) -> Self {
        Shown {
            time_s,
            tool,
            force_n: DVec3::from_array(output.force_n),
            torque_nm: DVec3::from_array(output.torque_nm),
            contact: output.contact,
            flags: output.flags,
            energy: output.energy,
            tank_j: contact.has_tank().then_some(output.energy.tank_j),
            command_n: None,
            stages: StageFlags::default(),
            friction_scale: contact.friction_scale(),
        }
    }

    /// A period's.
    pub fn of_record(record: &Record) -> Self {
        let contact = (record.element != Record::NONE).then_some(ContactPoint {
            element: record.element,
            n: record.area_coordinates,
            position_m: record.contact_position_m,
            delta_z_m: record.delta_z_m,
            delta_r_m: record.delta_r_m,
        });
        let energy = Ledger {
            work_j: record.work_j,
            stored_j: record.stored_j,
            dissipated_j: record.dissipated_j,
            generated_j: record.generated_j,
            ..Ledger::default()
        };
        Shown {
            time_s: record.time_s,
            tool: ToolState { position_m: record.tool_position_m, orientation: record.tool_orientation },
            force_n: DVec3::from_array(record.force_n),
            torque_nm: DVec3::from_array(record.torque_nm),
            contact,
            flags: record.engine(),
            energy,
            tank_j: Some(record.tank_j).filter(|j| !j.is_nan()),
            command_n: Some(DVec3::from_array(record.command_force_n)),
            stages: record.stages(),
            friction_scale: if record.slip_rule_code == 0 { 1.0 } else { record.friction_scale },
        }
    }

    /// As a period's record, as far as panels read one: nothing of clocks, devices and stages.
    pub fn record(&self) -> Record {
        let contact = self.contact.as_ref();
        Record {
            kind: Record::PERIOD,
            time_s: self.time_s,
            tool_position_m: self.tool.position_m,
            tool_orientation: self.tool.orientation,
            force_n: self.force_n.to_array(),
            torque_nm: self.torque_nm.to_array(),
            command_force_n: self.command_n.unwrap_or(self.force_n).to_array(),
            element: contact.map_or(Record::NONE, |c| c.element),
            area_coordinates: contact.map_or([0.0; 3], |c| c.n),
            contact_position_m: contact.map_or([0.0; 3], |c| c.position_m),
            delta_z_m: contact.map_or(0.0, |c| c.delta_z_m),
            delta_r_m: contact.map_or(0.0, |c| c.delta_r_m),
            engine_flags: self.flags.bits(),
            work_j: self.energy.work_j,
            stored_j: self.energy.stored_j,
            dissipated_j: self.energy.dissipated_j,
            generated_j: self.energy.generated_j,
            tank_j: self.tank_j.unwrap_or(f64::NAN),
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// Where the tool is, m: what a drawing can have.
    pub fn tool_m(&self) -> DVec3 {
        let p = DVec3::from_array(self.tool.position_m);
        if p.is_finite() { p.clamp(DVec3::splat(-1e3), DVec3::splat(1e3)) } else { DVec3::ZERO }
    }

    /// How the tool is turned; not at all where its quaternion says nothing.
    pub fn tool_rotation(&self) -> glam::DQuat {
        let [w, x, y, z] = self.tool.orientation;
        let q = glam::DQuat::from_xyzw(x, y, z, w);
        if q.is_finite() && q.length_squared() > 0.25 { q.normalize() } else { glam::DQuat::IDENTITY }
    }
}

/// Why there is no force, or what of it is held back, in words; `None` where it goes out as it is.
pub fn silence(stages: StageFlags) -> Option<&'static str> {
    [
        (StageFlags::STOPPED, "stopped: zero is commanded"),
        (StageFlags::UNREAD, "the device could not be read"),
        (StageFlags::UNWRITTEN, "the device took no command"),
        (StageFlags::IDLE, "the device renders nothing: its forces are off, or nobody holds its grip"),
        (StageFlags::STALE, "the device's pose has not changed for too long"),
        (StageFlags::REFUSED, "a pose was refused: no number, or a jump"),
        (StageFlags::LATE, "a period came too late: the force begins anew"),
        (StageFlags::CLUTCHED, "the clutch is held"),
        (StageFlags::CHANGING, "a setting is being changed"),
        (StageFlags::WAITED, "waiting for the ground under the tool"),
        (StageFlags::CONTAINED, "a force was no number: zero in its place"),
        (StageFlags::STARTING, "soft start: the force ramps up"),
        (StageFlags::SATURATED, "cut to the force limit"),
        (StageFlags::SLEWED, "held back by the slew limit"),
    ]
    .into_iter()
    .find_map(|(flag, words)| stages.has(flag).then_some(words))
}
