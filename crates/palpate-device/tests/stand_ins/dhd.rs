//! Stands in for Force Dimension's `libdhd`.

mod record;

use record::{dawdle, log, setting};
use std::ffi::{c_char, c_double, c_int, c_uchar, c_uint};
use std::sync::Mutex;

/// The firmware: what it does by itself depends on the setting `now`, s.
struct Firmware {
    expert: bool,
    /// Steps of 125 µs; 0 for none.
    watchdog: c_uchar,
    fed_s: f64,
    on: bool,
    /// What switched the forces off last: 0 nothing, 1 the button, 3 the watchdog, 4 the program.
    cause: c_int,
    /// What was commanded last: rendered as soon as forces are on.
    force: [f64; 3],
}

static FIRMWARE: Mutex<Firmware> =
    Mutex::new(Firmware { expert: false, watchdog: 0, fed_s: 0.0, on: false, cause: 0, force: [0.0; 3] });

/// As it is at this time: the watchdog may have acted, and the button been pressed (the setting `forces_on`), which switches
/// forces off, and on again.
fn firmware<T>(with: impl FnOnce(&mut Firmware) -> T) -> T {
    let mut firmware = FIRMWARE.lock().unwrap();
    let silent = setting("now", 0.0) - firmware.fed_s;
    if firmware.on && firmware.watchdog > 0 && silent > f64::from(firmware.watchdog) * 125e-6 {
        (firmware.on, firmware.cause) = (false, 3);
    }
    if setting("forces_on", 1.0) == 0.0 {
        if firmware.on {
            (firmware.on, firmware.cause) = (false, 1);
        }
    } else if firmware.cause == 1 && !firmware.on {
        (firmware.on, firmware.fed_s) = (true, setting("now", 0.0));
    }
    with(&mut firmware)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn stand_in_rendered(to: *mut c_double) {
    let force = firmware(|f| if f.on { f.force } else { [0.0; 3] });
    unsafe { to.copy_from(force.as_ptr(), 3) };
}

/// What the setting of the call's name says it returns.
fn answer(call: &str, usual: f64) -> c_int {
    setting(call, usual) as c_int
}

fn plain(call: &str, arguments: String) -> c_int {
    log(format!("{call}({arguments})"));
    answer(call, 0.0)
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetDeviceCount() -> c_int {
    log("count()".into());
    answer("count", 1.0)
}

/// The id that the calls after it must name is 5 more than the index.
#[unsafe(no_mangle)]
pub extern "C" fn dhdOpenID(index: c_char) -> c_int {
    log(format!("open({index})"));
    answer("open", f64::from(index) + 5.0)
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdClose(id: c_char) -> c_int {
    plain("close", format!("{id}"))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetSystemName(_: c_char) -> *const c_char {
    let names = [c"omega.3", c"sigma.7", c"delta.3", c"lambda.7", c"FALCON", c"thing"];
    match setting("name", 0.0) as usize {
        99 => std::ptr::null(),
        name => names[name].as_ptr(),
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdHasWrist(_: c_char) -> bool {
    setting("wrist", 0.0) > 0.0
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdHasActiveWrist(_: c_char) -> bool {
    setting("active_wrist", 0.0) > 0.0
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdSetGravityCompensation(on: c_int, id: c_char) -> c_int {
    plain("gravity", format!("{on}, {id}"))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdSetMaxForce(newtons: c_double, id: c_char) -> c_int {
    plain("max_force", format!("{newtons}, {id}"))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdEnableExpertMode() -> c_int {
    firmware(|f| f.expert = true);
    plain("expert", String::new())
}

/// An expert's call: outside of that mode it is refused.
#[unsafe(no_mangle)]
pub extern "C" fn dhdSetWatchdog(steps: c_uchar, id: c_char) -> c_int {
    let answer = plain("watchdog", format!("{steps}, {id}"));
    firmware(|f| {
        if !f.expert || answer < 0 {
            return -1;
        }
        f.watchdog = setting("watchdog_takes", f64::from(steps)) as c_uchar;
        answer
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetWatchdog(to: *mut c_uchar, _: c_char) -> c_int {
    firmware(|f| unsafe { *to = f.watchdog });
    0
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdEnableForce(on: c_uchar, id: c_char) -> c_int {
    let answer = plain("enable", format!("{on}, {id}"));
    firmware(|f| {
        if answer >= 0 {
            f.on = on == 1;
            f.fed_s = setting("now", 0.0);
            f.cause = if f.on { f.cause } else { 4 };
        }
    });
    answer
}

/// Writes nothing where it fails.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetPosition(
    x: *mut c_double,
    y: *mut c_double,
    z: *mut c_double,
    id: c_char,
) -> c_int {
    dawdle("slow");
    let answer = plain("position", format!("{id}"));
    if answer >= 0 {
        for (to, name) in [(x, "x"), (y, "y"), (z, "z")] {
            unsafe { *to = setting(name, 0.0) };
        }
    }
    answer
}

/// A turn about the vendor's z by the setting `turn`, rad: rows, then columns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetPositionAndOrientationFrame(
    x: *mut c_double,
    y: *mut c_double,
    z: *mut c_double,
    frame: *mut [[c_double; 3]; 3],
    id: c_char,
) -> c_int {
    let (sin, cos) = setting("turn", 0.0).sin_cos();
    let scale = setting("frame_scale", 1.0);
    unsafe { *frame = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, scale]] };
    unsafe { dhdGetPosition(x, y, z, id) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetLinearVelocity(
    x: *mut c_double,
    y: *mut c_double,
    z: *mut c_double,
    _: c_char,
) -> c_int {
    for (to, name) in [(x, "vx"), (y, "vy"), (z, "vz")] {
        unsafe { *to = setting(name, 0.0) };
    }
    answer("velocity", 0.0)
}

#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments, reason = "the vendor's signature")]
pub extern "C" fn dhdSetForceAndTorqueAndGripperForce(
    fx: c_double,
    fy: c_double,
    fz: c_double,
    tx: c_double,
    ty: c_double,
    tz: c_double,
    grip: c_double,
    id: c_char,
) -> c_int {
    let answer = plain("force", format!("{fx}, {fy}, {fz}, {tx}, {ty}, {tz}, {grip}, {id}"));
    firmware(|f| {
        if answer >= 0 {
            f.fed_s = setting("now", 0.0);
            f.force = [fx, fy, fz];
        }
    });
    answer
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetButtonMask(_: c_char) -> c_uint {
    setting("buttons", 0.0) as c_uint
}

/// More words than are documented, as a later library might.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetStatus(words: *mut c_int, _: c_char) -> c_int {
    let (on, cause) = firmware(|f| (f.on, f.cause));
    for i in 0..22 {
        let word = match i {
            3 => setting("reset", 0.0) as c_int,
            5 => c_int::from(on),
            12 => setting("wrist_init", 1.0) as c_int,
            14 => setting("cause", f64::from(cause)) as c_int,
            _ => 1,
        };
        unsafe { *words.add(i) = word };
    }
    0
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdErrorGetLast() -> c_int {
    answer("error", 0.0)
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdErrorGetLastStr() -> *const c_char {
    if setting("error", 0.0) == 2.0 { c"communication error" } else { c"device error" }.as_ptr()
}
