//! Stands in for OpenHaptics' `libHD`, with a scheduler in a thread of its own. It complains in the log where a call is
//! made out of its place: outside a frame, or with another device current.

mod record;

use record::{dawdle, log, setting};
use std::cell::Cell;
use std::collections::VecDeque;
use std::ffi::{CStr, c_char, c_double, c_int, c_uchar, c_uint, c_ulong, c_void};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

type Callback = unsafe extern "C" fn(*mut c_void) -> c_uint;

#[repr(C)]
pub struct ErrorInfo {
    code: c_uint,
    internal: c_int,
    device: c_uint,
}

struct Scheduled {
    id: c_ulong,
    callback: Callback,
    data: usize,
}

static SCHEDULED: Mutex<Vec<Scheduled>> = Mutex::new(Vec::new());
static RUNNING: AtomicBool = AtomicBool::new(false);
static THREAD: Mutex<Option<JoinHandle<()>>> = Mutex::new(None);
static ERRORS: Mutex<VecDeque<c_uint>> = Mutex::new(VecDeque::new());
static LAST_FORCE: Mutex<Option<[f64; 3]>> = Mutex::new(None);
static DEVICES: AtomicU32 = AtomicU32::new(0);
static TICKS: AtomicU32 = AtomicU32::new(0);
static FORCES_ON: AtomicBool = AtomicBool::new(false);
static CALIBRATED: AtomicBool = AtomicBool::new(false);

thread_local! {
    static CURRENT: Cell<c_uint> = const { Cell::new(u32::MAX) };
    static IN_FRAME: Cell<bool> = const { Cell::new(false) };
    static IS_SCHEDULER: Cell<bool> = const { Cell::new(false) };
}

fn fail(code: f64) {
    if code > 0.0 {
        ERRORS.lock().unwrap().push_back(code as c_uint);
    }
}

fn framed(call: &str) {
    if !IN_FRAME.get() {
        log(format!("{call} outside a frame"));
    }
}

/// The setting `refused` is the number of names that don't open before one does.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdInitDevice(name: *const c_char) -> c_uint {
    let name = if name.is_null() { "NULL" } else { unsafe { CStr::from_ptr(name) }.to_str().unwrap() };
    log(format!("init({name})"));
    if RUNNING.load(Ordering::SeqCst) {
        log("init while the scheduler runs".into());
    }
    let tries = TICKS.fetch_add(1, Ordering::SeqCst);
    if f64::from(tries) < setting("refused", 0.0) {
        fail(769.0);
        return u32::MAX;
    }
    DEVICES.fetch_add(1, Ordering::SeqCst)
}

#[unsafe(no_mangle)]
pub extern "C" fn hdDisableDevice(device: c_uint) {
    if RUNNING.load(Ordering::SeqCst) {
        log("disable while the scheduler runs".into());
    }
    log(format!("disable({device})"));
}

#[unsafe(no_mangle)]
pub extern "C" fn hdMakeCurrentDevice(device: c_uint) {
    CURRENT.set(device);
}

#[unsafe(no_mangle)]
pub extern "C" fn hdBeginFrame(device: c_uint) {
    if IN_FRAME.replace(true) || CURRENT.get() != device {
        log("a frame out of its place".into());
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdEndFrame(device: c_uint) {
    if !IN_FRAME.replace(false) || CURRENT.get() != device {
        log("a frame's end out of its place".into());
    }
    fail(setting("error", 0.0));
    if setting("trip", 0.0) > 0.0 {
        FORCES_ON.store(false, Ordering::SeqCst);
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetError() -> ErrorInfo {
    let code = ERRORS.lock().unwrap().pop_front().unwrap_or(0);
    ErrorInfo { code, internal: -7, device: CURRENT.get() }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetErrorString(code: c_uint) -> *const c_char {
    if code == 769 { c"device already initiated" } else { c"some error" }.as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetString(_: c_uint) -> *const c_char {
    c"Touch".as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn hdEnable(what: c_uint) {
    log(format!("enable({what:#x})"));
    FORCES_ON.store(true, Ordering::SeqCst);
}

#[unsafe(no_mangle)]
pub extern "C" fn hdIsEnabled(what: c_uint) -> c_uchar {
    assert_eq!(what, 0x4000);
    FORCES_ON.load(Ordering::SeqCst).into()
}

/// The setting `calibration` until it was updated, then `updated`. Outside of the scheduler's frames nobody gets an answer.
#[unsafe(no_mangle)]
pub extern "C" fn hdCheckCalibration() -> c_uint {
    if !IS_SCHEDULER.get() || !IN_FRAME.get() {
        log("calibration asked out of its place".into());
    }
    let ok = f64::from(0x5000);
    match CALIBRATED.load(Ordering::SeqCst) {
        true => setting("updated", ok) as c_uint,
        false => setting("calibration", ok) as c_uint,
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdUpdateCalibration(style: c_uint) {
    log(format!("calibrate({style})"));
    if FORCES_ON.load(Ordering::SeqCst) || IN_FRAME.get() || !IS_SCHEDULER.get() {
        log("calibrated out of its place".into());
    }
    CALIBRATED.store(true, Ordering::SeqCst);
}

/// A turn about the vendor's y, its up, by the setting `turn`, rad; mm and mm/s.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetDoublev(what: c_uint, to: *mut c_double) {
    let three = |names: [&str; 3]| names.map(|n| setting(n, 0.0)).to_vec();
    let values = match what {
        0x2050 => {
            framed("position");
            three(["x", "y", "z"])
        }
        0x2051 => three(["vx", "vy", "vz"]),
        0x2052 => {
            framed("transform");
            let (sin, cos) = setting("turn", 0.0).sin_cos();
            let (x, y, z) = (setting("x", 0.0), setting("y", 0.0), setting("z", 0.0));
            vec![cos, 0.0, -sin, 0.0, 0.0, 1.0, 0.0, 0.0, sin, 0.0, cos, 0.0, x, y, z, 1.0]
        }
        0x2551 => vec![-200.0, -100.0, -50.0, 200.0, 300.0, 150.0],
        0x2602 => vec![0.5],
        0x2603 => vec![setting("max_force", 4.0)],
        _ => return fail(0x100 as f64),
    };
    for (i, value) in values.into_iter().enumerate() {
        unsafe { *to.add(i) = value };
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetIntegerv(what: c_uint, to: *mut c_int) {
    unsafe {
        *to = match what {
            0x2000 => setting("buttons", 0.0),
            0x2555 => setting("styles", 5.0),
            _ => unreachable!(),
        } as c_int;
    }
}

/// Only what changes is logged.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdSetDoublev(what: c_uint, from: *const c_double) {
    assert_eq!(what, 0x2700);
    framed("force");
    let force = [0, 1, 2].map(|i| unsafe { *from.add(i) });
    if LAST_FORCE.lock().unwrap().replace(force) != Some(force) {
        log(format!("force({}, {}, {})", force[0], force[1], force[2]));
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdSetSchedulerRate(hertz: c_ulong) {
    log(format!("rate({hertz})"));
    fail(setting("rate_error", 0.0));
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdScheduleAsynchronous(callback: Callback, data: *mut c_void, _: u16) -> c_ulong {
    log("schedule()".into());
    let mut scheduled = SCHEDULED.lock().unwrap();
    let id = 40 + scheduled.len() as c_ulong;
    scheduled.push(Scheduled { id, callback, data: data as usize });
    id
}

#[unsafe(no_mangle)]
pub extern "C" fn hdUnschedule(id: c_ulong) {
    log(format!("unschedule({id})"));
    SCHEDULED.lock().unwrap().retain(|s| s.id != id);
}

/// Calls back once a millisecond, but while the setting `stands` holds.
#[unsafe(no_mangle)]
pub extern "C" fn hdStartScheduler() {
    log("start()".into());
    RUNNING.store(true, Ordering::SeqCst);
    let run = || {
        IS_SCHEDULER.set(true);
        while RUNNING.load(Ordering::SeqCst) {
            if setting("stands", 0.0) == 0.0 {
                dawdle("slow");
                SCHEDULED.lock().unwrap().retain(|s| unsafe { (s.callback)(s.data as *mut c_void) } == 1);
            }
            thread::sleep(Duration::from_millis(1));
        }
    };
    THREAD.lock().unwrap().replace(thread::spawn(run));
}

#[unsafe(no_mangle)]
pub extern "C" fn hdStopScheduler() {
    log("stop()".into());
    RUNNING.store(false, Ordering::SeqCst);
    if let Some(thread) = THREAD.lock().unwrap().take() {
        thread.join().unwrap();
    }
}
