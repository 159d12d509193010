//! Force Dimension's devices (omega, delta, sigma, lambda) and the Novint Falcon, through the vendor's `libdhd`.
//!
//! The vendor's calls are made in the loop's own thread, as the vendor's examples make them: reading the position and
//! setting the force talk to the device over USB and return when it has answered, within a fraction of a millisecond.
//! A call that hangs holds the loop; the device's own watchdog then disables forces ([`DhdOptions::watchdog_s`]). They are
//! enabled again when the loop has commanded zero, and not if a button or a grip switched them off: that is the hand's.
//!
//! A return below 0 is an error; 1 (the time guard: nothing new since the last call) and 2 (the motors are at their
//! limit) are not.

use crate::frame::Axes;
use crate::latch::Latch;
use crate::library::{self, prototypes, text};
use crate::limit::{self, Limits};
use crate::{
    Capabilities, Command, Device, EmergencyStop, Fault, Figure, Freedom, OpenError, Pose, Sample, Status,
    presets,
};
use std::ffi::{CStr, c_char, c_double, c_int, c_uchar, c_uint};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// As the loader looks for it; `libdrd` holds the same functions and more.
const NAMES: &[&str] = if cfg!(windows) {
    &["dhd64.dll", "drd64.dll"]
} else if cfg!(target_os = "macos") {
    &["libdhd.dylib", "libdhd.3.dylib", "libdrd.dylib", "libdrd.3.dylib"]
} else {
    &["libdhd.so", "libdhd.so.3", "libdrd.so", "libdrd.so.3"]
};
const INSTALL: &str = "install the Force Dimension SDK (forcedimension.com) and put the folder of its library where the \
                       loader looks, or name the file (--device-library)";
/// The device did what it was commanded, but nothing is new since the last call.
const TIME_GUARD: c_int = 1;
/// The motors can't do more.
const MOTOR_SATURATED: c_int = 2;
/// Room for the status words: 17 are documented, later SDKs may write more.
const STATUS_WORDS: usize = 64;
/// The word that is 1 while the device waits to be calibrated.
const STATUS_RESET: usize = 3;
/// The word that is 1 while forces are on.
const STATUS_FORCE: usize = 5;
/// The word that is 1 once the wrist is calibrated.
const STATUS_WRIST_INIT: usize = 12;
/// The word that says what switched the forces off last.
const STATUS_FORCE_OFF_CAUSE: usize = 14;
/// That was the watchdog.
const CAUSE_WATCHDOG: c_int = 3;
/// What the library did not say.
const UNTOLD: c_int = -1;
/// The status is asked for once in so many reads: it changes at a hand's pace. After a silence it is asked for at once.
const STATUS_EVERY: u64 = 16;
/// The velocity is an average over 20 ms by the library's default.
const VELOCITY_DELAY_S: f64 = 0.01;
/// One step of the device's watchdog, s.
const WATCHDOG_STEP_S: f64 = 125e-6;

type Frame = [[c_double; 3]; 3];

prototypes! {
    /// What is used of `libdhd`. A C `char` names the device.
    Calls
    plain {
        count = dhdGetDeviceCount() -> c_int;
        open = dhdOpenID(index: c_char) -> c_int;
        close = dhdClose(id: c_char) -> c_int;
        name = dhdGetSystemName(id: c_char) -> *const c_char;
        has_wrist = dhdHasWrist(id: c_char) -> bool;
        has_active_wrist = dhdHasActiveWrist(id: c_char) -> bool;
        set_gravity_compensation = dhdSetGravityCompensation(on: c_int, id: c_char) -> c_int;
        set_max_force = dhdSetMaxForce(newtons: c_double, id: c_char) -> c_int;
        enable_force = dhdEnableForce(on: c_uchar, id: c_char) -> c_int;
        set_force = dhdSetForceAndTorqueAndGripperForce(
            fx: c_double, fy: c_double, fz: c_double, tx: c_double, ty: c_double, tz: c_double, grip: c_double, id: c_char
        ) -> c_int;
        buttons = dhdGetButtonMask(id: c_char) -> c_uint;
        error_text = dhdErrorGetLastStr() -> *const c_char;
    }
    raw {
        position = dhdGetPosition(*mut c_double, *mut c_double, *mut c_double, c_char) -> c_int;
        pose = dhdGetPositionAndOrientationFrame(*mut c_double, *mut c_double, *mut c_double, *mut Frame, c_char) -> c_int;
        velocity = dhdGetLinearVelocity(*mut c_double, *mut c_double, *mut c_double, c_char) -> c_int;
        status = dhdGetStatus(*mut c_int, c_char) -> c_int;
    }
    optional {
        error_number = dhdErrorGetLast() -> c_int;
        enable_expert_mode = dhdEnableExpertMode() -> c_int;
        set_watchdog = dhdSetWatchdog(c_uchar, c_char) -> c_int;
        get_watchdog = dhdGetWatchdog(*mut c_uchar, c_char) -> c_int;
        is_initialised = drdIsInitialized(c_char) -> bool;
    }
}

/// Which library, which device, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct DhdOptions {
    /// The vendor's library; by default it is looked for by its usual names.
    pub library: Option<PathBuf>,
    /// Of several devices the one at this place in the vendor's list, from 0, the default.
    pub index: Option<u8>,
    /// The largest force, N, where it is lower than the model's.
    pub max_force_n: Option<f64>,
    /// The device disables its forces when it gets no command for so long, s, in steps of 0.125 ms up to 31.875 ms. By
    /// default 20 ms: many periods, and short for a hand.
    pub watchdog_s: f64,
    /// Whether a device that doesn't take the watchdog is refused. It is the only thing that takes the force off when this
    /// program or its machine hangs.
    pub watchdog_required: bool,
    /// Whether the device carries its own weight. It does by default.
    pub gravity_compensation: bool,
}

impl Default for DhdOptions {
    fn default() -> Self {
        DhdOptions {
            library: None,
            index: None,
            max_force_n: None,
            watchdog_s: 0.02,
            watchdog_required: true,
            gravity_compensation: true,
        }
    }
}

/// A device of Force Dimension's.
#[derive(Debug)]
pub struct Dhd {
    options: DhdOptions,
    capabilities: Capabilities,
    port: Option<Port>,
    notes: Vec<String>,
    trouble: Trouble,
}

/// The vendor's words on the last fault, kept where nothing allocates.
#[derive(Debug, Clone, Copy)]
struct Trouble([u8; 96]);

impl Dhd {
    /// A device that is not open yet.
    pub fn new(options: DhdOptions) -> Self {
        let mut capabilities = model("");
        capabilities.name = "Force Dimension".into();
        Dhd { options, capabilities, port: None, notes: Vec::new(), trouble: Trouble([0; 96]) }
    }

    fn error(&self, problem: String, hint: &str) -> OpenError {
        OpenError { device: "dhd".into(), problem, hint: hint.into() }
    }

    /// The library, loaded, and the device that was asked for, connected.
    fn connect(&self) -> Result<Port, OpenError> {
        let library = library::open("dhd", self.options.library.as_deref(), NAMES, INSTALL)?;
        let calls = Calls::of(library)
            .map_err(|name| self.error(format!("its library has no function {name}"), INSTALL))?;
        let count = calls.count();
        if count <= 0 {
            return Err(self.error(
                "no Force Dimension device was found".into(),
                "connect it and switch it on; on Linux give yourself rights to it (a udev rule for USB vendor 1451)",
            ));
        }
        let index = self.options.index.unwrap_or(0);
        if c_int::from(index) >= count {
            return Err(self.error(
                format!("device {index} was asked for, and there are {count}"),
                "count from 0: dhd:0 is the first",
            ));
        }
        let answer = calls.open(index as c_char);
        let Ok(id) =
            c_char::try_from(answer).map_err(|_| ()).and_then(|id| if answer < 0 { Err(()) } else { Ok(id) })
        else {
            return Err(self.error(
                format!("device {index} doesn't open: {}", text(calls.error_text())),
                "close other programs that use it, switch it off and on; on Linux give yourself rights to it (a udev \
                 rule for USB vendor 1451)",
            ));
        };
        Ok(Port::new(calls, id))
    }
}

impl Device for Dhd {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }

    /// The order: count, open, what it is, watchdog, gravity compensation, largest force, calibration. Forces stay off until
    /// the first `write` after a good pose.
    fn open(&mut self) -> Result<(), OpenError> {
        self.close();
        self.notes.clear();
        // A limit that can't be is said before anything is opened.
        limit::lower("dhd", &mut self.capabilities.max_force_n.clone(), self.options.max_force_n)?;
        let mut port = self.connect()?;
        let Shared { calls, id, .. } = &*port.shared;
        let mut capabilities = model(&text(calls.name(*id)));
        let wrist = calls.has_wrist(*id);
        let driven = calls.has_active_wrist(*id);
        capabilities.sensed = Freedom { translations: 3, rotations: if wrist { 3 } else { 0 } };
        capabilities.driven = Freedom { translations: 3, rotations: if driven { 3 } else { 0 } };
        if !driven {
            capabilities.max_torque_nm = None;
        }
        limit::lower("dhd", &mut capabilities.max_force_n, self.options.max_force_n)?;
        port.wrist = wrist;
        port.limits = Limits::of(&capabilities);
        let steps = (self.options.watchdog_s / WATCHDOG_STEP_S).round().clamp(1.0, 255.0);
        port.watchdog_s = steps * WATCHDOG_STEP_S;
        if let Err(problem) = port.shared.calls.arm_watchdog(steps as c_uchar, port.shared.id) {
            let problem = format!("its watchdog can't be armed: {problem}");
            if self.options.watchdog_required {
                return Err(self.error(
                    problem,
                    "get the current SDK and firmware; or do without (--without-device-watchdog), and nothing takes the force \
                     off when this program hangs",
                ));
            }
            self.notes.push(format!("{problem}: nothing takes the force off when this program hangs"));
        }
        let Shared { calls, id, .. } = &*port.shared;
        let gravity = c_int::from(self.options.gravity_compensation);
        for (answer, what) in [
            (calls.set_gravity_compensation(gravity, *id), "compensation of its weight"),
            (calls.set_max_force(capabilities.max_force_n.value, *id), "a limit of the force"),
        ] {
            if answer < 0 {
                self.notes.push(format!("it refuses {what}: {}", text(calls.error_text())));
            }
        }
        if calls.is_uncalibrated(wrist, *id) {
            self.notes.push(
                "it is not calibrated, and its positions may be wrong: run the vendor's HapticInit".into(),
            );
        }
        (self.capabilities, self.port) = (capabilities, Some(port));
        Ok(())
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        let port = self.port.as_mut().ok_or(Fault::NotOpen)?;
        port.read(now_s).inspect_err(|_| self.trouble = Trouble::of(port.shared.calls.error_text()))
    }

    /// Before the first good pose nothing is rendered, and nothing is sent.
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        let port = self.port.as_mut().ok_or(Fault::NotOpen)?;
        port.write(command).inspect_err(|_| self.trouble = Trouble::of(port.shared.calls.error_text()))
    }

    fn close(&mut self) {
        self.port = None;
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        Some(self.port.as_ref()?.shared.clone())
    }

    fn explain(&self, fault: Fault) -> String {
        match self.trouble.0.iter().position(|&byte| byte == 0) {
            None | Some(0) => fault.to_string(),
            Some(end) => format!("{fault} ({})", String::from_utf8_lossy(&self.trouble.0[..end])),
        }
    }
}

impl Trouble {
    /// As much of a C string as there is room for.
    fn of(text: *const c_char) -> Self {
        let mut kept = [0; 96];
        if !text.is_null() {
            #[allow(unsafe_code, reason = "the vendor's text is a C string")]
            // SAFETY: the vendor gives a string that ends in 0.
            let bytes = unsafe { CStr::from_ptr(text) }.to_bytes();
            let room = kept.len() - 1;
            kept.iter_mut().zip(&bytes[..bytes.len().min(room)]).for_each(|(to, from)| *to = *from);
        }
        Trouble(kept)
    }
}

/// What the loop and an emergency stop share.
#[derive(Debug)]
struct Shared {
    calls: Calls,
    id: c_char,
    open: AtomicBool,
    stopped: AtomicBool,
    /// The thread that reads and writes.
    thread: AtomicUsize,
}

/// Tells threads from each other, in a panic too.
fn this_thread() -> usize {
    thread_local!(static HERE: u8 = const { 0 });
    HERE.try_with(|here| (&raw const *here).addr()).unwrap_or(0)
}

impl EmergencyStop for Shared {
    /// Two threads in the vendor's library at once are nowhere allowed: from another thread than the loop's, the loop's next
    /// write is zero.
    fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        if self.open.load(Ordering::SeqCst) && self.thread.load(Ordering::SeqCst) == this_thread() {
            self.calls.set_all([0.0; 3], [0.0; 3], self.id);
        }
    }
}

/// An open device. Dropped, in whatever way, it renders no force, is disabled, and closed.
#[derive(Debug)]
struct Port {
    shared: Arc<Shared>,
    wrist: bool,
    limits: Limits,
    watchdog_s: f64,
    latch: Latch,
    /// Forces are off; whether the watchdog did it, so that they may be enabled again.
    off: Option<bool>,
    /// When the loop read last, s.
    read_s: Option<f64>,
    /// In the vendor's axes: what it last said, NaN before.
    position: [f64; 3],
    frame: Frame,
    sequence: u64,
    reads: u64,
    enabled: bool,
    status: Status,
}

impl Port {
    fn new(calls: Calls, id: c_char) -> Self {
        let shared = Shared {
            calls,
            id,
            open: AtomicBool::new(true),
            stopped: AtomicBool::new(false),
            thread: AtomicUsize::new(this_thread()),
        };
        Port {
            shared: Arc::new(shared),
            wrist: false,
            limits: Limits::NONE,
            watchdog_s: 0.0,
            latch: Latch::default(),
            off: None,
            read_s: None,
            position: [f64::NAN; 3],
            frame: [[f64::NAN; 3]; 3],
            sequence: 0,
            reads: 0,
            enabled: false,
            status: Status::default(),
        }
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        let shared = self.shared.clone();
        let Shared { calls, id, thread, .. } = &*shared;
        thread.store(this_thread(), Ordering::SeqCst);
        let answer = calls.read_pose(self.wrist, &mut self.position, &mut self.frame, *id);
        let answer = self.check(answer)?;
        let orientation = if self.wrist {
            // C's m[row][column].
            let m = self.frame;
            let columns = [0, 1, 2].map(|c| [m[0][c], m[1][c], m[2][c]]);
            Axes::X_TOWARDS.orientation(columns)
        } else {
            Some(Pose::default().orientation)
        };
        let good = self.position.iter().all(|x| x.is_finite());
        let orientation = orientation.filter(|_| good).ok_or(Fault::Garbled)?;
        self.sequence += u64::from(answer != TIME_GUARD || self.sequence == 0);
        self.look_at_forces(now_s);
        self.status.idle = self.off.is_some() || self.latch.is_closed();
        self.reads += 1;
        Ok(Sample {
            sequence: self.sequence,
            pose: Pose { position_m: Axes::X_TOWARDS.ours(self.position), orientation },
            velocity_m_per_s: calls.read_velocity(*id).map(|v| Axes::X_TOWARDS.ours(v)),
            angular_velocity_rad_per_s: None,
            buttons: calls.buttons(*id),
            status: self.status,
        })
    }

    /// Whether the device has disabled its forces, and why.
    fn look_at_forces(&mut self, now_s: f64) {
        let silent_s = self.read_s.replace(now_s).map_or(0.0, |then| now_s - then);
        let is_due = self.reads.is_multiple_of(STATUS_EVERY);
        let suspect = self.off.is_some() || self.latch.is_closed() || silent_s > 0.5 * self.watchdog_s;
        if !self.enabled || !(is_due || suspect) {
            return;
        }
        match self.shared.calls.forces(self.shared.id) {
            Some(Forces { on: false, cause }) => {
                self.off = Some(match cause {
                    CAUSE_WATCHDOG => true,
                    // Of an older library the silence tells, once.
                    UNTOLD => self.off.unwrap_or(silent_s > 0.9 * self.watchdog_s),
                    _ => false,
                });
                self.latch.close();
            }
            Some(Forces { on: true, .. }) => self.off = None,
            None => {}
        }
    }

    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        if self.sequence == 0 {
            return Ok(());
        }
        let shared = self.shared.clone();
        let Shared { calls, id, thread, stopped, .. } = &*shared;
        thread.store(this_thread(), Ordering::SeqCst);
        let (command, cut) = self.limits.hold(command);
        let [[fx, fy, fz], [tx, ty, tz]] = [command.force_n, command.torque_nm];
        let [fx, fy, fz, tx, ty, tz] = self.latch.pass([fx, fy, fz, tx, ty, tz]);
        let is_stopped = stopped.load(Ordering::SeqCst);
        let rearm = self.off == Some(true) && !self.latch.is_closed();
        if (!self.enabled || rearm) && !is_stopped {
            // Whatever another program left behind, or the device before its silence, is not to be felt.
            self.check(calls.set_all([0.0; 3], [0.0; 3], *id))?;
            self.check(calls.enable_force(1, *id))?;
            // Whether it did is looked at in the next read.
            (self.enabled, self.reads) = (true, 0);
        }
        // While forces are off a hand may switch them on at any time.
        let silent = is_stopped || self.off.is_some();
        let [force, torque] =
            [[fx, fy, fz], [tx, ty, tz]].map(|v| if silent { [0.0; 3] } else { Axes::X_TOWARDS.theirs(v) });
        let answer = self.check(calls.set_all(force, torque, *id))?;
        self.status.saturated = cut || answer == MOTOR_SATURATED;
        Ok(())
    }

    fn check(&self, answer: c_int) -> Result<c_int, Fault> {
        if answer >= 0 {
            return Ok(answer);
        }
        // The vendor's list of errors: 2 communication, 5 no device, 7 time-out. Older libraries have no number.
        Err(match self.shared.calls.last_error() {
            Some(2 | 5) => Fault::Disconnected,
            Some(7) => Fault::TimedOut,
            Some(number) if number != 0 => Fault::Code(number.into()),
            _ => Fault::Code(answer.into()),
        })
    }
}

impl Drop for Port {
    /// Each call is made whatever the ones before answered: a device that is half gone may still hear the next.
    fn drop(&mut self) {
        let Shared { calls, id, open, .. } = &*self.shared;
        calls.set_all([0.0; 3], [0.0; 3], *id);
        calls.enable_force(0, *id);
        open.store(false, Ordering::SeqCst);
        calls.close(*id);
    }
}

/// Whether forces are on, and what switched them off last.
struct Forces {
    on: bool,
    cause: c_int,
}

/// The rest of the vendor's functions as safe ones.
#[allow(unsafe_code, reason = "each is a call into the vendor's library")]
impl Calls {
    fn read_pose(&self, wrist: bool, [x, y, z]: &mut [f64; 3], frame: &mut Frame, id: c_char) -> c_int {
        // SAFETY: the library is open, and writes three numbers and a matrix where they are.
        unsafe { if wrist { (self.pose)(x, y, z, frame, id) } else { (self.position)(x, y, z, id) } }
    }

    fn read_velocity(&self, id: c_char) -> Option<[f64; 3]> {
        let [mut x, mut y, mut z] = [f64::NAN; 3];
        // SAFETY: the library is open, and writes three numbers where they are.
        let answer = unsafe { (self.velocity)(&mut x, &mut y, &mut z, id) };
        Some([x, y, z]).filter(|v| answer >= 0 && v.iter().all(|c| c.is_finite()))
    }

    /// The status words; what the library does not write stays [`UNTOLD`]. `None` where it fails.
    fn words(&self, id: c_char) -> Option<[c_int; STATUS_WORDS]> {
        let mut words = [UNTOLD; STATUS_WORDS];
        // SAFETY: the library is open, and writes fewer words than there is room for.
        let answer = unsafe { (self.status)(words.as_mut_ptr(), id) };
        (answer >= 0).then_some(words)
    }

    fn forces(&self, id: c_char) -> Option<Forces> {
        let words = self.words(id)?;
        Some(Forces { on: words[STATUS_FORCE] != 0, cause: words[STATUS_FORCE_OFF_CAUSE] })
    }

    /// Whether it says so; of an older library nobody knows.
    fn is_uncalibrated(&self, wrist: bool, id: c_char) -> bool {
        let told = self
            .words(id)
            .is_some_and(|words| words[STATUS_RESET] == 1 || (wrist && words[STATUS_WRIST_INIT] == 0));
        // SAFETY: the library is open.
        told || self.is_initialised.is_some_and(|ask| unsafe { !ask(id) })
    }

    /// Arms the device's watchdog, and sees whether it is. The calls are of the vendor's expert mode, and do nothing outside
    /// of it.
    fn arm_watchdog(&self, steps: c_uchar, id: c_char) -> Result<(), String> {
        let (Some(expert), Some(set), Some(get)) =
            (self.enable_expert_mode, self.set_watchdog, self.get_watchdog)
        else {
            return Err("its library is too old for one".into());
        };
        // SAFETY: the library is open.
        if unsafe { expert() < 0 || set(steps, id) < 0 } {
            return Err(text(self.error_text()));
        }
        let mut armed = 0;
        // SAFETY: the library is open, and writes one byte.
        if unsafe { get(&mut armed, id) } < 0 {
            return Err(text(self.error_text()));
        }
        if armed != steps {
            return Err(format!("it was set to {steps} steps, and is at {armed}"));
        }
        Ok(())
    }

    fn set_all(&self, [fx, fy, fz]: [f64; 3], [tx, ty, tz]: [f64; 3], id: c_char) -> c_int {
        self.set_force(fx, fy, fz, tx, ty, tz, 0.0, id)
    }

    fn last_error(&self) -> Option<c_int> {
        // SAFETY: the library is open.
        self.error_number.map(|ask| unsafe { ask() })
    }
}

/// The capabilities of the model of this name, or the family's smallest.
fn model(name: &str) -> Capabilities {
    let lower = name.to_lowercase();
    let known =
        ["delta", "omega", "sigma", "lambda", "falcon"].into_iter().find(|known| lower.contains(known));
    let mut capabilities = presets::device(known.unwrap_or("falcon")).expect("a preset by its own name");
    if known.is_none() {
        let unknown = "the model is not known: the smallest of the family's";
        capabilities.max_force_n = Figure::guessed(capabilities.max_force_n.value, unknown);
        capabilities.max_stiffness_n_per_m =
            Figure::guessed(capabilities.max_stiffness_n_per_m.value, unknown);
    }
    capabilities.name = if name.is_empty() { "Force Dimension".into() } else { name.to_owned().into() };
    capabilities.buttons = u32::BITS;
    let averaged = "half of the 20 ms over which the vendor's library averages by default";
    capabilities.velocity_delay_s = Some(Figure::stated(VELOCITY_DELAY_S, averaged));
    capabilities
}
