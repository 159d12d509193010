//! 3D Systems' devices (Touch, Touch X, the PHANToMs) through OpenHaptics' HDAPI.
//!
//! The vendor's scheduler has a thread of its own, which calls back once a millisecond; only there may the device be
//! read and its force be set. That callback (`servo`) exchanges the newest pose and force with the loop, wait-free on
//! both sides. So the force that answers the pose of one callback is rendered in the next: one scheduler period later, or two
//! where the loop is late. When the loop falls silent the callback renders nothing ([`OpenHapticsOptions::watchdog_s`]), and
//! where the device has switched its forces off it leaves them so; both until the loop has commanded zero.

mod calls;
mod servo;

use crate::first_pose::first_pose;
use crate::frame::Axes;
use crate::latest::{Reader, Writer};
use crate::library;
use crate::limit::{self, Limits};
use crate::{Basis, Capabilities, Command, Device, EmergencyStop, Fault, Figure, OpenError, Sample, presets};
use calls::{Calls, Handle};
use servo::{POSE, Servo, Shared};
use std::ffi::{CString, c_ulong};
use std::path::PathBuf;
use std::sync::atomic::{AtomicPtr, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

const NAMES: &[&str] = if cfg!(windows) {
    &["HD.dll"]
} else if cfg!(target_os = "macos") {
    &["libHD.dylib"]
} else {
    &["libHD.so", "libHD.so.3.4", "libHD.so.3.0"]
};
const INSTALL: &str = "install OpenHaptics and the Touch device driver (3D Systems) and put the folder of its library \
                       where the loader looks, or name the file (--device-library)";
const PLUG: &str = "connect it and switch it on, run the vendor's Touch_Setup and Touch_Diagnostic, and name it as that \
                    does (openhaptics:NAME)";
/// Names to try where the default one fails.
const DEFAULTS: [&str; 2] = ["Default Device", "Default PHANToM"];
/// A pose that is older, s, means that the scheduler stands.
const STALE_S: f64 = 0.05;
/// How long the last callback may take; one period where the scheduler runs.
const LAST_CALLBACK: Duration = Duration::from_millis(250);
/// The middle of the scheduler's range, its own default.
const PRIORITY: u16 = u16::MAX / 2;

/// How many devices the one scheduler serves: it must stand while one is added or taken away.
static SERVED: Mutex<u32> = Mutex::new(0);

/// Which library, which device, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct OpenHapticsOptions {
    /// The vendor's library; by default it is looked for by its usual names.
    pub library: Option<PathBuf>,
    /// The device as the vendor's set-up program names it; by default the default one.
    pub name: Option<String>,
    /// The largest force, N, where it is lower than what the device tells.
    pub max_force_n: Option<f64>,
    /// Callbacks a second: 500 or 1000; the default is 1000.
    pub rate_hz: u32,
    /// No force is rendered when the loop has written none for so long, s. 20 ms by default: many periods, and short for a
    /// hand.
    pub watchdog_s: f64,
}

impl Default for OpenHapticsOptions {
    fn default() -> Self {
        OpenHapticsOptions { library: None, name: None, max_force_n: None, rate_hz: 1000, watchdog_s: 0.02 }
    }
}

/// A device of 3D Systems'.
#[derive(Debug)]
pub struct OpenHaptics {
    options: OpenHapticsOptions,
    capabilities: Capabilities,
    port: Option<Port>,
    notes: Vec<String>,
}

impl OpenHaptics {
    /// A device that is not open yet.
    pub fn new(options: OpenHapticsOptions) -> Self {
        let mut capabilities = presets::device("touch").expect("a preset by its own name");
        capabilities.name = "OpenHaptics".into();
        OpenHaptics { options, capabilities, port: None, notes: Vec::new() }
    }

    /// What the device tells of itself, and the table's figures for the rest.
    fn ask(&self, calls: &Calls) -> Capabilities {
        let name = calls.model();
        let lower = name.to_lowercase();
        let kind = match () {
            () if lower.contains("omni") => "omni",
            () if lower.contains("desktop") || lower.contains("touch x") => "desktop",
            () => "touch",
        };
        let mut c = presets::device(kind).expect("a preset by its own name");
        c.name = format!("3D Systems {name}").into();
        let told = |value: f64| {
            (value > 0.0 && value.is_finite()).then(|| Figure::measured(value, "the device itself"))
        };
        if let Some(most) = told(calls.doubles::<1>(calls::MAX_FORCE)[0]) {
            c.max_force_n = most;
        }
        // N/mm.
        if let Some(most) = told(calls.doubles::<1>(calls::MAX_STIFFNESS)[0] * 1e3) {
            c.max_stiffness_n_per_m = most;
        }
        let [x0, y0, z0, x1, y1, z1] = calls.doubles::<6>(calls::WORKSPACE).map(|mm| mm * 1e-3);
        if x1 > x0 && y1 > y0 && z1 > z0 {
            let (least, most) = (Axes::Y_UP.ours([x0, y0, z0]), Axes::Y_UP.ours([x1, y1, z1]));
            c.workspace.centre_m = std::array::from_fn(|i| 0.5 * (least[i] + most[i]));
            c.workspace.half_extent_m = std::array::from_fn(|i| 0.5 * (most[i] - least[i]).abs());
            c.workspace.basis = Basis::Measured("the device itself".into());
        }
        c.sensed.rotations = 3;
        c.buttons = 4;
        let rate = f64::from(self.options.rate_hz);
        (c.rates.usual_hz, c.rates.most_hz) = (rate, rate);
        c.velocity_delay_s =
            Some(Figure::guessed(5e-3, "the vendor's library smoothes it; how is not published"));
        c.mechanics.delay_s = Figure::stated(1.0 / rate, "this driver: a force waits for the next callback");
        c
    }
}

fn error(problem: String, hint: &str) -> OpenError {
    OpenError { device: "openhaptics".into(), problem, hint: hint.into() }
}

impl Device for OpenHaptics {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }

    /// The order: initialise, ask, rate, schedule the callback, start the scheduler, wait for the first pose. The force
    /// output is switched on by the callback when the loop's first force has come.
    fn open(&mut self) -> Result<(), OpenError> {
        self.close();
        self.notes.clear();
        limit::lower("openhaptics", &mut self.capabilities.max_force_n.clone(), self.options.max_force_n)?;
        let library = library::open("openhaptics", self.options.library.as_deref(), NAMES, INSTALL)?;
        let calls = Calls::of(library)
            .map_err(|name| error(format!("its library has no function {name}"), INSTALL))?;
        let calls = Arc::new(calls);
        let mut port = {
            let mut served = SERVED.lock().unwrap_or_else(PoisonError::into_inner);
            if *served > 0 {
                calls.stop();
            }
            let port = self.start(calls.clone());
            if *served > 0 && port.is_err() {
                calls.start();
            }
            let port = port?;
            *served += 1;
            port
        };
        limit::lower("openhaptics", &mut self.capabilities.max_force_n, self.options.max_force_n)?;
        port.limits = Limits::of(&self.capabilities);
        port.await_pose()?;
        self.notes.extend(match port.shared.calibration() {
            None | Some(calls::CALIBRATED) => None,
            Some(calls::CALIBRATION_NEEDS_HAND) => Some(
                "it is not calibrated, and its positions may be wrong: put the stylus into its inkwell, and start again".into(),
            ),
            Some(_) => Some(
                "it is not calibrated, and its positions may be wrong: calibrate it with the vendor's Touch_Diagnostic".into(),
            ),
        });
        self.port = Some(port);
        Ok(())
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.port.as_mut().ok_or(Fault::NotOpen)?.read(now_s)
    }

    /// Before the first good pose nothing is rendered.
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        let port = self.port.as_mut().ok_or(Fault::NotOpen)?;
        if port.posed {
            let (command, cut) = port.limits.hold(command);
            port.cut = cut;
            port.forces.put(&Axes::Y_UP.theirs(command.force_n));
        }
        Ok(())
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
        match (fault, &self.port) {
            (Fault::Code(code), Some(port)) => {
                format!("{fault} ({})", port.calls.describe(code as u32))
            }
            _ => fault.to_string(),
        }
    }
}

impl OpenHaptics {
    /// The device with its callback, the scheduler running.
    fn start(&mut self, calls: Arc<Calls>) -> Result<Port, OpenError> {
        let device = self.initialise(&calls)?;
        calls.make_current(device);
        self.capabilities = self.ask(&calls);
        let rate_hz = self.options.rate_hz.max(1);
        calls.set_rate(c_ulong::from(rate_hz));
        if let Some(code) = calls.errors().next() {
            self.notes.push(format!("it refuses {rate_hz} callbacks a second: {}", calls.describe(code)));
        }
        let quiet_ticks = (self.options.watchdog_s * f64::from(rate_hz)).ceil().clamp(1.0, 1e6) as u32;
        let (servo, poses, forces, shared) = Servo::new(calls.clone(), device, quiet_ticks);
        let servo = Box::into_raw(Box::new(servo));
        let callback = calls.schedule_servo(servo, PRIORITY);
        calls.start();
        Ok(Port {
            calls,
            device,
            servo: AtomicPtr::new(servo),
            callback,
            poses,
            forces,
            shared,
            limits: Limits::NONE,
            last: [f64::NAN; POSE],
            since_s: None,
            posed: false,
            cut: false,
        })
    }

    fn initialise(&self, calls: &Calls) -> Result<Handle, OpenError> {
        let names = match &self.options.name {
            Some(name) => vec![Some(name.as_str())],
            None => [None].into_iter().chain(DEFAULTS.map(Some)).collect(),
        };
        let mut tried = Vec::new();
        for name in names {
            let shown = name.unwrap_or("the default device");
            let Ok(c_name) = name.map(CString::new).transpose() else {
                return Err(error(format!("`{shown}` is no name"), PLUG));
            };
            // What others left behind is not this device's.
            calls.errors().for_each(drop);
            let device = calls.initialise(c_name.as_deref());
            match calls.errors().find(|code| !calls::harmless(*code)) {
                None if device != Handle::MAX => return Ok(device),
                Some(code) => tried.push(format!("{shown}: {}", calls.describe(code))),
                None => tried.push(format!("{shown}: no handle")),
            }
        }
        Err(error(format!("no device opens: {}", tried.join("; ")), PLUG))
    }
}

/// An open device. Dropped, in whatever way, it renders no force, and the scheduler has let go of it.
#[derive(Debug)]
struct Port {
    calls: Arc<Calls>,
    device: Handle,
    /// Owned by the scheduler's thread while the callback is scheduled.
    servo: AtomicPtr<Servo>,
    callback: c_ulong,
    poses: Reader<POSE>,
    forces: Writer<3>,
    shared: Arc<Shared>,
    limits: Limits,
    last: [f64; POSE],
    /// When the loop first saw the last pose, s.
    since_s: Option<f64>,
    posed: bool,
    cut: bool,
}

impl Port {
    /// # Errors
    /// The scheduler doesn't call, or the device fails.
    fn await_pose(&mut self) -> Result<(), OpenError> {
        self.last = first_pose(&mut self.poses, || self.shared.fault()).map_err(|code| {
            if let Some(code) = code {
                return error(format!("it fails at once: {}", self.calls.describe(code)), PLUG);
            }
            let reason = self.calls.errors().next().map(|code| format!(" ({})", self.calls.describe(code)));
            error(format!("its scheduler never calls back{}", reason.unwrap_or_default()), PLUG)
        })?;
        Ok(())
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        if let Some(code) = self.shared.fault() {
            return Err(calls::fault(code));
        }
        if let Some(pose) = self.poses.take() {
            (self.last, self.since_s) = (pose, None);
        }
        let since = *self.since_s.get_or_insert(now_s);
        if now_s - since > STALE_S {
            return Err(Fault::TimedOut);
        }
        let mut sample = servo::sample(&self.last).ok_or(Fault::Garbled)?;
        sample.status.saturated |= self.cut;
        self.posed = true;
        Ok(sample)
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        let mut served = SERVED.lock().unwrap_or_else(PoisonError::into_inner);
        let done = self.shared.end(LAST_CALLBACK);
        if !done {
            self.calls.unschedule(self.callback);
        }
        self.calls.stop();
        if done {
            servo::free(self.servo.load(Ordering::Acquire));
        } else {
            // The scheduler stood: the last word is this thread's, and what the other may still hold is never freed.
            self.calls.make_current(self.device);
            self.calls.begin(self.device);
            self.calls.set_force([0.0; 3]);
            self.calls.end(self.device);
        }
        self.calls.disable_device(self.device);
        *served -= 1;
        if *served > 0 {
            self.calls.start();
        }
    }
}
