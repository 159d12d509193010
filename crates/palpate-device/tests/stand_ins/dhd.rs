//! Stands in for Force Dimension's `libdhd`.

mod record;

use record::{dawdle, log, setting};
use std::ffi::{c_char, c_double, c_int, c_uchar, c_uint};

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
pub extern "C" fn dhdSetWatchdog(steps: c_uchar, id: c_char) -> c_int {
    plain("watchdog", format!("{steps}, {id}"))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdEnableForce(on: c_uchar, id: c_char) -> c_int {
    plain("enable", format!("{on}, {id}"))
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
    plain("force", format!("{fx}, {fy}, {fz}, {tx}, {ty}, {tz}, {grip}, {id}"))
}

#[unsafe(no_mangle)]
pub extern "C" fn dhdGetButtonMask(_: c_char) -> c_uint {
    setting("buttons", 0.0) as c_uint
}

/// More words than are documented, as a later library might.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dhdGetStatus(words: *mut c_int, _: c_char) -> c_int {
    for i in 0..22 {
        unsafe { *words.add(i) = 1 };
    }
    unsafe { *words.add(5) = setting("forces_on", 1.0) as c_int };
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
