//! What the stand-ins share: a log of every call, and settings by which a test makes them misbehave. A test opens its own
//! copy of the library, and reaches both through the two functions at the end; in another process, through its environment.

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::Mutex;

static LOG: Mutex<Vec<String>> = Mutex::new(Vec::new());
static SETTINGS: Mutex<BTreeMap<String, f64>> = Mutex::new(BTreeMap::new());

/// `STAND_IN_LOG` names a file for the log.
pub fn log(call: String) {
    if let Ok(file) = std::env::var("STAND_IN_LOG") {
        use std::io::Write;
        let file = std::fs::File::options().create(true).append(true).open(file);
        writeln!(file.unwrap(), "{call}").unwrap();
    }
    LOG.lock().unwrap().push(call);
}

/// What the test set, or `STAND_IN_NAME`, or `usual`.
pub fn setting(name: &str, usual: f64) -> f64 {
    let from_outside = || std::env::var(format!("STAND_IN_{name}")).ok()?.parse().ok();
    SETTINGS.lock().unwrap().get(name).copied().or_else(from_outside).unwrap_or(usual)
}

/// Does as a slow device does.
#[allow(dead_code, reason = "each stand-in uses its own part")]
pub fn dawdle(name: &str) {
    let seconds = setting(name, 0.0);
    if seconds > 0.0 {
        std::thread::sleep(std::time::Duration::from_secs_f64(seconds));
    }
}

/// # Safety
/// `name` is a C string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stand_in_set(name: *const c_char, value: f64) {
    let name = unsafe { CStr::from_ptr(name) }.to_str().unwrap().to_owned();
    SETTINGS.lock().unwrap().insert(name, value);
}

/// Hands the calls since the last time to `sink`, one by one.
#[unsafe(no_mangle)]
pub extern "C" fn stand_in_take_log(sink: extern "C" fn(*const c_char, *mut c_void), context: *mut c_void) {
    for call in LOG.lock().unwrap().drain(..) {
        let call = CString::new(call).unwrap();
        sink(call.as_ptr(), context);
    }
}
