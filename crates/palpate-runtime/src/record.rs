//! What the loop saw and did in one period, as plain data of fixed size, and the file that keeps it.
//!
//! The haptic thread fills a [`Record`] each period and pushes it into a ring ([`Recorder`]); a thread of its own, the
//! [`RecorderThread`], takes it out, counts it in the [`Statistics`](crate::Statistics), and writes it if there is a file.
//! [`Recording`] reads the file, as far as it is whole. The format is in `docs/recording.md`.

mod file;
mod reading;
mod recorder;
mod retrace;
mod table;

pub use file::MAGIC as RECORDING_MAGIC;
pub use file::{BodyFile, CreateError, Header, Map, RecordingFile};
pub use reading::{Ending, OpenRecordingError, Recording};
pub use recorder::{Finished, Listener, Recorder, RecorderThread, Records, ring};
pub use retrace::Retrace;

use crate::{HapticLoop, Period, StageFlags};
use bytemuck::{Pod, Zeroable};
use palpate_body::SlipRule;
use palpate_device::{Fault, Pose, Sample, Status};
use palpate_engine::{Flags, ToolState};
use serde::{Deserialize, Serialize};

/// Where a field of a record lies: a recording's header has them all, so that its records can be read by what they say.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Field {
    /// Its name, with its unit at the end.
    pub name: String,
    /// `f64`, `u64`, `i64` or `u32`, little endian.
    pub kind: String,
    /// How many of them.
    pub count: u32,
    /// Bytes from the record's beginning.
    pub offset: u32,
    /// What it is.
    pub about: String,
}

/// What a field may hold.
trait Kind {
    const NAME: &str;
    const COUNT: u32 = 1;
}

impl Kind for f64 {
    const NAME: &str = "f64";
}
impl Kind for u64 {
    const NAME: &str = "u64";
}
impl Kind for i64 {
    const NAME: &str = "i64";
}
impl Kind for u32 {
    const NAME: &str = "u32";
}
impl<T: Kind, const N: usize> Kind for [T; N] {
    const NAME: &str = T::NAME;
    const COUNT: u32 = N as u32;
}

/// The struct and the table of its fields, from one list.
macro_rules! record {
    ($($(#[doc = $about:literal])+ $name:ident: $kind:ty,)+) => {
        /// One period, 576 bytes without a hole. Names end in their units; vectors are in the device's frame where their
        /// name begins with `device` or `command`, in the body's else.
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
        pub struct Record {
            $($(#[doc = $about])+ pub $name: $kind,)+
        }

        impl Record {
            /// Name, kind, place and meaning of each field.
            pub fn fields() -> Vec<Field> {
                vec![$(Field {
                    name: stringify!($name).into(),
                    kind: <$kind as Kind>::NAME.into(),
                    count: <$kind as Kind>::COUNT,
                    offset: std::mem::offset_of!(Record, $name) as u32,
                    about: concat!($($about),+).trim().into(),
                }),+]
            }
        }
    };
}

record! {
    /// 1 for a period; a file also holds blocks of another kind.
    kind: u32,
    /// What the stages did: the bits of `StageFlags`.
    stage_flags: u32,
    /// Counts periods from 0: a gap is a record that was dropped.
    number: u64,
    /// The loop's time, s.
    time_s: f64,
    /// When the period really began, ns since the start.
    started_ns: u64,
    /// How long after its due time, ns.
    lateness_ns: i64,
    /// Since the period before began, ns; 0 in the first.
    period_ns: u64,
    /// What stepping and the stages took, without the device, ns.
    step_ns: u32,
    /// What the device's read took, ns.
    read_ns: u32,
    /// What the device's write took, ns.
    write_ns: u32,
    /// What the device reported: 0 nothing, 1 it is not open, 2 it is gone, 3 it did not answer in time, 4 it can't be
    /// understood, 5 an error of the vendor's (`fault_code`), 6 its recording has ended.
    fault: u32,
    /// The vendor's number of the error, if `fault` is 5.
    fault_code: i64,
    /// The sample's number.
    device_sequence: u64,
    /// The handle.
    device_position_m: [f64; 3],
    /// Its orientation, w x y z.
    device_orientation: [f64; 4],
    /// Its velocity, if bit 3 of `device_status` says that the device reports one.
    device_velocity_m_per_s: [f64; 3],
    /// Bit i is button i.
    device_buttons: u32,
    /// 1 idle, 2 saturated, 4 warm, 8 a velocity is reported, 16 an angular velocity is.
    device_status: u32,
    /// The pose that the engine was given, in this period if bit 0 of `stage_flags` says so.
    tool_position_m: [f64; 3],
    /// Its orientation, w x y z.
    tool_orientation: [f64; 4],
    /// The engine's force on the tool.
    force_n: [f64; 3],
    /// The engine's torque on the tool.
    torque_nm: [f64; 3],
    /// Area coordinates of the contact point.
    area_coordinates: [f64; 3],
    /// The contact point at rest.
    contact_position_m: [f64; 3],
    /// Normal deflection.
    delta_z_m: f64,
    /// Lateral deflection.
    delta_r_m: f64,
    /// Element of the contact point, numbered in the whole body; 4294967295 for no contact.
    element: u32,
    /// What happened in the engine: the bits of the engine's `Flags`.
    engine_flags: u32,
    /// Work of the tool on the body so far.
    work_j: f64,
    /// Energy stored now.
    stored_j: f64,
    /// Energy dissipated so far.
    dissipated_j: f64,
    /// The part of it where slip generated energy, as a positive sum.
    generated_j: f64,
    /// Given out at the engine's port so far.
    out_j: f64,
    /// Sum of the squares of the tool's ways so far.
    squares_m2: f64,
    /// What the passivity controller has observed so far; 0 without one.
    observed_j: f64,
    /// The command to the device.
    command_force_n: [f64; 3],
    /// The command to the device.
    command_torque_nm: [f64; 3],
    /// Where the patch that was stepped on was asked for.
    patch_centre_m: [f64; 3],
    /// Which patch it was; 0 for the whole body.
    patch_serial: u64,
    /// How many elements it had.
    patch_count: u32,
    /// For later; 0. Older recordings call it `patch_element`, and hold 4294967295.
    spare_half: u32,
    /// Periods so far in which the loop waited for a patch.
    patch_waits: u64,
    /// Page faults of the haptic thread so far, without the disk.
    minor_faults: u32,
    /// Page faults of the haptic thread so far, with the disk.
    major_faults: u32,
    /// The handle's angular velocity, if bit 4 of `device_status` says that the device reports one. From
    /// version 2 on.
    device_angular_velocity_rad_per_s: [f64; 3],
    /// Sum of the squares of the tool's rotation vectors so far. From version 2 on.
    squares_rad2: f64,
    /// What multiplied the body's friction coefficients. From version 2 on, where `slip_rule_code` is not 0.
    friction_scale: f64,
    /// The tank: what slips have dissipated, and later ones may give out again. NaN where no tank holds slip back, and in recordings
    /// before version 3.
    tank_j: f64,
    /// For later; 0.
    spare: [u64; 2],
    /// The slip rule: 1 paper, 2 consistent, 3 exact; 0 for the header's. From version 2 on.
    slip_rule_code: u32,
    /// CRC-32 (IEEE 802.3) of all bytes before; filled in when it is written.
    crc: u32,
}

/// In the order of [`Record::slip_rule_code`].
const RULES: [SlipRule; 3] = [SlipRule::Paper, SlipRule::Consistent, SlipRule::Exact];

impl Record {
    /// [`kind`](Self::kind) of a period.
    pub const PERIOD: u32 = 1;
    /// [`kind`](Self::kind) of the block that ends a file.
    pub const END: u32 = 2;
    /// Its size in memory and in the file, bytes.
    pub const BYTES: usize = size_of::<Record>();
    /// No element.
    pub const NONE: u32 = u32::MAX;

    /// Period `number` of a loop on a whole body. What concerns clocks, patches and page faults is 0 and the caller's to
    /// fill in; so is [`element`](Self::element) where the body was a patch with numbers of its own.
    ///
    /// # Real-time
    /// Bounded; allocates nothing.
    pub fn new(number: u64, haptics: &HapticLoop, period: &Period) -> Self {
        let Period { time_s, sample, pose, output, command, flags, fault } = period;
        let contact = output.contact;
        let (fault, fault_code) = fault_to(*fault);
        let status = sample.status;
        let [reported, turning] = [sample.velocity_m_per_s, sample.angular_velocity_rad_per_s];
        Record {
            kind: Self::PERIOD,
            stage_flags: flags.bits(),
            number,
            time_s: *time_s,
            fault,
            fault_code,
            device_sequence: sample.sequence,
            device_position_m: sample.pose.position_m,
            device_orientation: sample.pose.orientation,
            device_velocity_m_per_s: reported.unwrap_or_default(),
            device_buttons: sample.buttons,
            device_status: bits([
                status.idle,
                status.saturated,
                status.warm,
                reported.is_some(),
                turning.is_some(),
            ]),
            device_angular_velocity_rad_per_s: turning.unwrap_or_default(),
            tool_position_m: pose.position_m,
            tool_orientation: pose.orientation,
            force_n: output.force_n,
            torque_nm: output.torque_nm,
            area_coordinates: contact.map_or([0.0; 3], |c| c.n),
            contact_position_m: contact.map_or([0.0; 3], |c| c.position_m),
            delta_z_m: contact.map_or(0.0, |c| c.delta_z_m),
            delta_r_m: contact.map_or(0.0, |c| c.delta_r_m),
            element: contact.map_or(Self::NONE, |c| c.element),
            engine_flags: output.flags.bits(),
            work_j: output.energy.work_j,
            stored_j: output.energy.stored_j,
            dissipated_j: output.energy.dissipated_j,
            generated_j: output.energy.generated_j,
            out_j: haptics.port().out_j,
            squares_m2: haptics.port().squares_m2,
            squares_rad2: haptics.port().squares_rad2,
            observed_j: haptics.stages().passivity.map_or(0.0, |p| p.observed_j()),
            command_force_n: command.force_n,
            command_torque_nm: command.torque_nm,
            friction_scale: haptics.contact().friction_scale(),
            tank_j: if haptics.contact().has_tank() { output.energy.tank_j } else { f64::NAN },
            slip_rule_code: 1 + RULES.iter().position(|r| *r == haptics.contact().slip_rule()).unwrap_or(0)
                as u32,
            ..Self::zeroed()
        }
    }

    /// The slip rule of the period; `None` for that of the recording's header.
    pub fn slip_rule(&self) -> Option<SlipRule> {
        RULES.get((self.slip_rule_code as usize).checked_sub(1)?).copied()
    }

    /// What the stages did.
    pub fn stages(&self) -> StageFlags {
        StageFlags::from_bits(self.stage_flags)
    }

    /// What happened in the engine.
    pub fn engine(&self) -> Flags {
        Flags::from_bits(self.engine_flags)
    }

    /// What the device said.
    pub fn sample(&self) -> Sample {
        let [idle, saturated, warm, reported, turning] = unbits(self.device_status);
        Sample {
            sequence: self.device_sequence,
            pose: Pose { position_m: self.device_position_m, orientation: self.device_orientation },
            velocity_m_per_s: reported.then_some(self.device_velocity_m_per_s),
            angular_velocity_rad_per_s: turning.then_some(self.device_angular_velocity_rad_per_s),
            buttons: self.device_buttons,
            status: Status { idle, saturated, warm },
        }
    }

    /// The pose that the engine was given, if it was given one in this period.
    pub fn tool(&self) -> Option<ToolState> {
        let pose = ToolState { position_m: self.tool_position_m, orientation: self.tool_orientation };
        self.stages().has(StageFlags::STEPPED).then_some(pose)
    }

    /// What the device reported as wrong.
    pub fn fault(&self) -> Option<Fault> {
        Some(match self.fault {
            1 => Fault::NotOpen,
            2 => Fault::Disconnected,
            3 => Fault::TimedOut,
            4 => Fault::Garbled,
            5 => Fault::Code(self.fault_code),
            6 => Fault::Ended,
            _ => return None,
        })
    }
}

fn fault_to(fault: Option<Fault>) -> (u32, i64) {
    match fault {
        None => (0, 0),
        Some(Fault::NotOpen) => (1, 0),
        Some(Fault::Disconnected) => (2, 0),
        Some(Fault::TimedOut) => (3, 0),
        Some(Fault::Garbled) => (4, 0),
        Some(Fault::Code(code)) => (5, code),
        Some(Fault::Ended) => (6, 0),
    }
}

fn bits<const N: usize>(flags: [bool; N]) -> u32 {
    flags.into_iter().rev().fold(0, |bits, flag| bits << 1 | u32::from(flag))
}

fn unbits<const N: usize>(bits: u32) -> [bool; N] {
    std::array::from_fn(|i| bits >> i & 1 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fields_fill_the_record_without_a_hole() {
        let size = |field: &Field| field.count * if field.kind == "u32" { 4 } else { 8 };
        let mut offset = 0;
        for field in Record::fields() {
            assert_eq!(field.offset, offset, "{field:?}");
            assert!(!field.about.is_empty());
            offset += size(&field);
        }
        assert_eq!((offset as usize, Record::BYTES), (576, 576));
    }

    #[test]
    fn flags_and_faults_come_back() {
        // As recordings have had them since the first.
        let first = [
            "in_contact",
            "slipping",
            "onset",
            "released",
            "reanchored",
            "border",
            "blocked",
            "capped",
            "invalid_pose",
            "contained",
            "started_inside",
            "fenced",
        ];
        for (i, name) in first.into_iter().enumerate() {
            let record = Record { engine_flags: 1 << i, ..Record::zeroed() };
            assert_eq!(record.engine().names().collect::<Vec<_>>(), [name]);
        }
        let faults = [
            Fault::NotOpen,
            Fault::Disconnected,
            Fault::TimedOut,
            Fault::Garbled,
            Fault::Code(i64::MIN),
            Fault::Ended,
        ];
        for expected in faults.map(Some).into_iter().chain([None]) {
            let (fault, fault_code) = fault_to(expected);
            assert_eq!(Record { fault, fault_code, ..Record::zeroed() }.fault(), expected);
        }
    }
}
