//! A device of the caller's: a table of C functions as a [`Device`].

use crate::PALPATE_ABI_VERSION;
use crate::status::{
    Failure, PALPATE_STATUS_NULL, PALPATE_STATUS_WRONG_VERSION, given, palpate_status, sized,
};
use palpate::device::{
    Capabilities, Command, Device, EmergencyStop, Fault, Figure, Freedom, Mechanics, OpenError, Pace, Pose,
    Rates, Sample, Status, Workspace,
};
use std::ffi::{CStr, c_char, c_void};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What a device's function returns: `PALPATE_FAULT_NONE`, another `PALPATE_FAULT_...`, or a positive number, the vendor's own.
pub type palpate_fault = i64;

/// It went well.
pub const PALPATE_FAULT_NONE: palpate_fault = 0;
/// The device is not open.
pub const PALPATE_FAULT_NOT_OPEN: palpate_fault = -1;
/// The device, its connection or its service is gone.
pub const PALPATE_FAULT_DISCONNECTED: palpate_fault = -2;
/// The device did not answer in time.
pub const PALPATE_FAULT_TIMED_OUT: palpate_fault = -3;
/// What came can't be understood.
pub const PALPATE_FAULT_GARBLED: palpate_fault = -4;
/// There are no more poses, and nothing is wrong: the session ends well.
pub const PALPATE_FAULT_ENDED: palpate_fault = -5;

/// `palpate_capabilities.basis`: somebody measured the figures, or the device reports them.
pub const PALPATE_BASIS_MEASURED: u32 = 1;
/// A data sheet states them.
pub const PALPATE_BASIS_STATED: u32 = 2;
/// They are guesses.
pub const PALPATE_BASIS_GUESSED: u32 = 3;

/// `palpate_sample.status`: it renders no force, whatever it is commanded.
pub const PALPATE_DEVICE_IDLE: u32 = 1;
/// It cut the last command to what its motors can.
pub const PALPATE_DEVICE_SATURATED: u32 = 2;
/// Its motors are warm.
pub const PALPATE_DEVICE_WARM: u32 = 4;
/// `velocity_m_per_s` is the device's own.
pub const PALPATE_DEVICE_HAS_VELOCITY: u32 = 8;
/// `angular_velocity_rad_per_s` is the device's own.
pub const PALPATE_DEVICE_HAS_ANGULAR_VELOCITY: u32 = 16;

/// What a device can do, at its handle: filled in by its `open`, which finds size and zeros in it.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_capabilities {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// Where the figures come from: `PALPATE_BASIS_...`; `source` says who.
    pub basis: u32,
    /// Maker and model, UTF-8 that ends in a zero.
    pub name: [c_char; 64],
    /// Where the figures come from, UTF-8 that ends in a zero.
    pub source: [c_char; 128],
    /// The force that it renders in any direction, N; above 0.
    pub max_force_n: f64,
    /// The torque that it renders about any axis, N m; 0 where rotations are not driven.
    pub max_torque_nm: f64,
    /// The stiffest wall that it holds, N/m; above 0.
    pub max_stiffness_n_per_m: f64,
    /// Middle of the box in which the handle can be, m.
    pub workspace_centre_m: [f64; 3],
    /// Half that box's extent along each axis, m.
    pub workspace_half_extent_m: [f64; 3],
    /// Translations that are sensed, 0 to 3.
    pub sensed_translations: u32,
    /// Rotations that are sensed, 0 to 3.
    pub sensed_rotations: u32,
    /// Translations that are driven, 0 to 3.
    pub driven_translations: u32,
    /// Rotations that are driven, 0 to 3.
    pub driven_rotations: u32,
    /// Buttons.
    pub buttons: u32,
    /// 1 if `read` waits for the device's next pose and so sets the pace; 0 if the loop does.
    pub sets_pace: u32,
    /// Slower than this the device stops or complains, Hz; 0 where it does not.
    pub least_hz: f64,
    /// What it is made for, Hz.
    pub usual_hz: f64,
    /// Faster than this brings nothing, Hz.
    pub most_hz: f64,
    /// How old the velocity is that it reports, s; negative if it reports none.
    pub velocity_delay_s: f64,
    /// Moving mass, kg.
    pub mass_kg: f64,
    /// Viscous damping, N s/m.
    pub damping_n_s_per_m: f64,
    /// Coulomb friction, N.
    pub coulomb_n: f64,
    /// Smallest step of the position, m.
    pub resolution_m: f64,
    /// From the pose's sampling to the moment when the force that answers it acts, s, beyond the loop's own hold.
    pub delay_s: f64,
    /// Time constant of amplifier and motor, s; 0 for none.
    pub lag_s: f64,
    /// How fast the force can change, N/s; 0 where nothing limits it.
    pub slew_n_per_s: f64,
}

/// What a device says in one period, in its own frame: right-handed, x to the operator's right, y away from him, z up.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_sample {
    /// Size of this struct, bytes; set by the library.
    pub struct_size: u32,
    /// A sum of `PALPATE_DEVICE_...`.
    pub status: u32,
    /// Counts the poses: the same number twice is the same pose twice, which the watchdog for a device that stands still goes by.
    pub sequence: u64,
    /// The handle, m.
    pub position_m: [f64; 3],
    /// Unit quaternion w x y z, device from handle; the identity where rotations are not sensed.
    pub orientation: [f64; 4],
    /// Velocity, m/s, if `status` says so.
    pub velocity_m_per_s: [f64; 3],
    /// Angular velocity, rad/s, if `status` says so.
    pub angular_velocity_rad_per_s: [f64; 3],
    /// Bit i is button i, 1 while pressed.
    pub buttons: u32,
    /// 0.
    pub reserved: u32,
}

/// What a device is to render on the operator's hand, in its own frame.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_command {
    /// Size of this struct, bytes; set by the library.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// N.
    pub force_n: [f64; 3],
    /// N m; to be left out by devices that drive no rotation.
    pub torque_nm: [f64; 3],
}

sized!(palpate_capabilities, palpate_sample, palpate_command, palpate_device);

/// A device of the caller's, as a table of functions. The library copies the table; `user` must live until the session is closed. The
/// order of calls is `open`, any number of periods of `read` and `write`, `close`; they come from one thread at a time, `read` and `write`
/// from the haptic thread. No function may throw an exception or jump out.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_device {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// `PALPATE_ABI_VERSION`.
    pub abi_version: u32,
    /// Given to every function.
    pub user: *mut c_void,
    /// Connects, with no force yet, and fills in what the device can do. If it fails it writes why, and what to do, to `message` (UTF-8
    /// that ends in a zero, `message_bytes` at most).
    pub open: Option<
        unsafe extern "C" fn(
            user: *mut c_void,
            capabilities: *mut palpate_capabilities,
            message: *mut c_char,
            message_bytes: usize,
        ) -> palpate_fault,
    >,
    /// Where the handle is. `now_s` is the loop's time since `open`, s. Real-time: bounded, no allocation, no lock that others hold long.
    pub read: Option<
        unsafe extern "C" fn(user: *mut c_void, now_s: f64, sample: *mut palpate_sample) -> palpate_fault,
    >,
    /// Renders `command` until the next one. Real-time, as `read`.
    pub write:
        Option<unsafe extern "C" fn(user: *mut c_void, command: *const palpate_command) -> palpate_fault>,
    /// Renders no force and disconnects. Called once for every `open` that went well.
    pub close: Option<unsafe extern "C" fn(user: *mut c_void)>,
    /// May be null. Takes the force off an open device at once, from any thread, at any time between `open` and `close`; it waits for
    /// nothing.
    pub emergency_stop: Option<unsafe extern "C" fn(user: *mut c_void)>,
    /// May be null. The vendor's words for its own error number, UTF-8 that ends in a zero, `message_bytes` at most.
    pub explain: Option<
        unsafe extern "C" fn(user: *mut c_void, code: i64, message: *mut c_char, message_bytes: usize),
    >,
}

/// Bytes of a device's message.
const MESSAGE: usize = 512;

/// The caller's pointer, given back to his functions alone.
#[derive(Debug, Clone, Copy)]
struct User(*mut c_void);

// SAFETY: the library never follows it; the header says from which threads the functions are called.
unsafe impl Send for User {}
// SAFETY: as above.
unsafe impl Sync for User {}

/// The functions that there must be.
#[derive(Debug, Clone, Copy)]
struct Functions {
    open: unsafe extern "C" fn(*mut c_void, *mut palpate_capabilities, *mut c_char, usize) -> palpate_fault,
    read: unsafe extern "C" fn(*mut c_void, f64, *mut palpate_sample) -> palpate_fault,
    write: unsafe extern "C" fn(*mut c_void, *const palpate_command) -> palpate_fault,
    close: unsafe extern "C" fn(*mut c_void),
    emergency_stop: Option<unsafe extern "C" fn(*mut c_void)>,
    explain: Option<unsafe extern "C" fn(*mut c_void, i64, *mut c_char, usize)>,
}

/// A device that is the caller's.
#[derive(Debug)]
pub(crate) struct ForeignDevice {
    functions: Functions,
    user: User,
    capabilities: Capabilities,
    is_open: Arc<AtomicBool>,
}

/// Its emergency stop.
#[derive(Debug)]
struct ForeignStop {
    stop: unsafe extern "C" fn(*mut c_void),
    user: User,
    is_open: Arc<AtomicBool>,
}

impl EmergencyStop for ForeignStop {
    fn stop(&self) {
        if self.is_open.load(Ordering::Acquire) {
            // SAFETY: the caller's function with the caller's pointer; the device is open.
            unsafe { (self.stop)(self.user.0) }
        }
    }
}

fn fault(code: palpate_fault) -> Option<Fault> {
    Some(match code {
        PALPATE_FAULT_NONE => return None,
        PALPATE_FAULT_NOT_OPEN => Fault::NotOpen,
        PALPATE_FAULT_DISCONNECTED => Fault::Disconnected,
        PALPATE_FAULT_TIMED_OUT => Fault::TimedOut,
        PALPATE_FAULT_ENDED => Fault::Ended,
        PALPATE_FAULT_GARBLED => Fault::Garbled,
        code if code > 0 => Fault::Code(code),
        _ => Fault::Garbled,
    })
}

/// The text up to its zero, or all of it.
fn text_of(bytes: &[c_char]) -> String {
    let bytes: Vec<u8> = bytes.iter().map(|c| *c as u8).collect();
    let text = CStr::from_bytes_until_nul(&bytes).map_or(&*bytes, CStr::to_bytes);
    String::from_utf8_lossy(text).into_owned()
}

/// With nothing in it that a device could do.
fn unknown() -> palpate_capabilities {
    // SAFETY: numbers alone, for which all bits zero is zero.
    let zero: palpate_capabilities = unsafe { std::mem::zeroed() };
    palpate_capabilities {
        struct_size: size_of::<palpate_capabilities>() as u32,
        velocity_delay_s: -1.0,
        ..zero
    }
}

/// What the caller's device said that it can do, if that can be.
fn capabilities(said: &palpate_capabilities) -> Result<Capabilities, String> {
    let source = text_of(&said.source);
    let figure = |value: f64| match said.basis {
        PALPATE_BASIS_MEASURED => Figure::measured(value, source.clone()),
        PALPATE_BASIS_STATED => Figure::stated(value, source.clone()),
        _ => Figure::guessed(value, source.clone()),
    };
    let above = |name: &str, value: f64| {
        if value > 0.0 { Ok(figure(value)) } else { Err(format!("{name} is {value}; give a number above 0")) }
    };
    let least = |name: &str, value: f64| {
        if (0.0..f64::INFINITY).contains(&value) {
            Ok(figure(value))
        } else {
            Err(format!("{name} is {value}; give a number from 0 on"))
        }
    };
    let axes = |name: &str, [translations, rotations]: [u32; 2]| match (translations, rotations) {
        (0..=3, 0..=3) => Ok(Freedom { translations: translations as u8, rotations: rotations as u8 }),
        _ => Err(format!("{name} axes are {translations} and {rotations}; give 0 to 3 of each")),
    };
    let place = |name: &str, value: [f64; 3]| {
        if value.iter().all(|x| x.is_finite()) { Ok(value) } else { Err(format!("{name} is not finite")) }
    };
    let driven = axes("driven", [said.driven_translations, said.driven_rotations])?;
    let max_torque_nm =
        (driven.rotations > 0).then(|| above("max_torque_nm", said.max_torque_nm)).transpose()?;
    let unlimited = |value: f64| if value == 0.0 { f64::INFINITY } else { value };
    Ok(Capabilities {
        name: text_of(&said.name).into(),
        max_force_n: above("max_force_n", said.max_force_n)?,
        max_torque_nm,
        max_stiffness_n_per_m: above("max_stiffness_n_per_m", said.max_stiffness_n_per_m)?,
        workspace: Workspace {
            centre_m: place("workspace_centre_m", said.workspace_centre_m)?,
            half_extent_m: place("workspace_half_extent_m", said.workspace_half_extent_m)?,
            basis: figure(0.0).basis,
        },
        sensed: axes("sensed", [said.sensed_translations, said.sensed_rotations])?,
        driven,
        buttons: said.buttons,
        rates: Rates { least_hz: said.least_hz, usual_hz: said.usual_hz, most_hz: said.most_hz },
        pace: if said.sets_pace == 0 { Pace::Loop } else { Pace::Device },
        velocity_delay_s: (said.velocity_delay_s >= 0.0).then(|| figure(said.velocity_delay_s)),
        mechanics: Mechanics {
            mass_kg: above("mass_kg", said.mass_kg)?,
            damping_n_s_per_m: least("damping_n_s_per_m", said.damping_n_s_per_m)?,
            coulomb_n: least("coulomb_n", said.coulomb_n)?,
            resolution_m: least("resolution_m", said.resolution_m)?,
            delay_s: least("delay_s", said.delay_s)?,
            lag_s: least("lag_s", said.lag_s)?,
            slew_n_per_s: above("slew_n_per_s", unlimited(said.slew_n_per_s))?,
            wrist: None,
        },
    })
}

impl ForeignDevice {
    /// The caller's device, if its table is whole.
    pub unsafe fn new(table: *const palpate_device) -> Result<Self, Failure> {
        // SAFETY: as the caller's.
        let table = unsafe { given(table) }?;
        if table.abi_version != PALPATE_ABI_VERSION {
            return Err(PALPATE_STATUS_WRONG_VERSION.into());
        }
        let lacks = |name: &str| {
            Failure::new(PALPATE_STATUS_NULL, format!("the device's function {name} is null; give one"))
        };
        let functions = Functions {
            open: table.open.ok_or_else(|| lacks("open"))?,
            read: table.read.ok_or_else(|| lacks("read"))?,
            write: table.write.ok_or_else(|| lacks("write"))?,
            close: table.close.ok_or_else(|| lacks("close"))?,
            emergency_stop: table.emergency_stop,
            explain: table.explain,
        };
        // What holds until it is open, and says so.
        let mut before = unknown();
        (before.max_force_n, before.max_stiffness_n_per_m, before.mass_kg) = (1.0, 1.0, 1.0);
        let mut capabilities = capabilities(&before).map_err(Failure::invalid)?;
        capabilities.name = "device".into();
        let user = User(table.user);
        Ok(ForeignDevice { functions, user, capabilities, is_open: Arc::default() })
    }
}

impl Device for ForeignDevice {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }

    fn open(&mut self) -> Result<(), OpenError> {
        let (mut said, mut message) = (unknown(), [0; MESSAGE]);
        // SAFETY: the caller's function with the caller's pointer, and room for what it writes.
        let code = unsafe { (self.functions.open)(self.user.0, &mut said, message.as_mut_ptr(), MESSAGE) };
        let device = match text_of(&said.name) {
            name if name.is_empty() => "device".to_owned(),
            name => name,
        };
        if let Some(fault) = fault(code) {
            let words = text_of(&message);
            let problem = if words.is_empty() { self.explain(fault) } else { words };
            return Err(OpenError { device, problem, hint: "correct that and start again".into() });
        }
        self.is_open.store(true, Ordering::Release);
        match capabilities(&said) {
            Ok(capabilities) => {
                self.capabilities = capabilities;
                Ok(())
            }
            Err(problem) => {
                self.close();
                let problem = format!("it says of itself what can't be: {problem}");
                Err(OpenError { device, problem, hint: "correct what `open` fills in".into() })
            }
        }
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        if !self.is_open.load(Ordering::Relaxed) {
            return Err(Fault::NotOpen);
        }
        let mut said = palpate_sample {
            struct_size: size_of::<palpate_sample>() as u32,
            status: 0,
            sequence: 0,
            position_m: [0.0; 3],
            orientation: [1.0, 0.0, 0.0, 0.0],
            velocity_m_per_s: [0.0; 3],
            angular_velocity_rad_per_s: [0.0; 3],
            buttons: 0,
            reserved: 0,
        };
        // SAFETY: the caller's function with the caller's pointer, and a place for its sample.
        if let Some(fault) = fault(unsafe { (self.functions.read)(self.user.0, now_s, &mut said) }) {
            return Err(fault);
        }
        let has = |bit: u32| said.status & bit != 0;
        Ok(Sample {
            sequence: said.sequence,
            pose: Pose { position_m: said.position_m, orientation: said.orientation },
            velocity_m_per_s: has(PALPATE_DEVICE_HAS_VELOCITY).then_some(said.velocity_m_per_s),
            angular_velocity_rad_per_s: has(PALPATE_DEVICE_HAS_ANGULAR_VELOCITY)
                .then_some(said.angular_velocity_rad_per_s),
            buttons: said.buttons,
            status: Status {
                idle: has(PALPATE_DEVICE_IDLE),
                saturated: has(PALPATE_DEVICE_SATURATED),
                warm: has(PALPATE_DEVICE_WARM),
            },
        })
    }

    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        if !self.is_open.load(Ordering::Relaxed) {
            return Err(Fault::NotOpen);
        }
        let command = palpate_command {
            struct_size: size_of::<palpate_command>() as u32,
            reserved: 0,
            force_n: command.force_n,
            torque_nm: command.torque_nm,
        };
        // SAFETY: the caller's function with the caller's pointer.
        fault(unsafe { (self.functions.write)(self.user.0, &command) }).map_or(Ok(()), Err)
    }

    fn close(&mut self) {
        if self.is_open.swap(false, Ordering::AcqRel) {
            // SAFETY: the caller's function with the caller's pointer.
            unsafe { (self.functions.close)(self.user.0) }
        }
    }

    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        let stop = self.functions.emergency_stop?;
        Some(Arc::new(ForeignStop { stop, user: self.user, is_open: self.is_open.clone() }))
    }

    fn explain(&self, fault: Fault) -> String {
        let (Fault::Code(code), Some(explain)) = (fault, self.functions.explain) else {
            return fault.to_string();
        };
        let mut message = [0; MESSAGE];
        // SAFETY: the caller's function with the caller's pointer, and room for what it writes.
        unsafe { explain(self.user.0, code, message.as_mut_ptr(), MESSAGE) };
        match text_of(&message) {
            words if words.is_empty() => fault.to_string(),
            words => format!("{words} ({code})"),
        }
    }
}

impl Drop for ForeignDevice {
    fn drop(&mut self) {
        self.close();
    }
}

/// What a device in the caller's program can test its own table with: `PALPATE_STATUS_OK` if it is whole, else
/// `PALPATE_STATUS_NULL`, `PALPATE_STATUS_WRONG_SIZE` or `PALPATE_STATUS_WRONG_VERSION`. No function of it is called. Real-time: O(1).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_device_check(
    device: *const palpate_device,
    error: *mut crate::palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe { crate::status::guarded(error, || ForeignDevice::new(device).map(drop)) }
}
