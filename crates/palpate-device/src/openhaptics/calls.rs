//! HDAPI: own prototypes, as public headers and programs that use it tell. Lengths are mm here.

use super::servo::{self, Servo};
use crate::Fault;
use crate::library::{prototypes, text};
use std::ffi::{CStr, c_char, c_double, c_int, c_uchar, c_uint, c_ulong, c_void};
use std::ptr;

/// HHD: the vendor's name of an open device.
pub(super) type Handle = c_uint;
type Callback = unsafe extern "C" fn(*mut c_void) -> c_uint;

/// HDErrorInfo.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub(super) struct ErrorInfo {
    code: c_uint,
    internal: c_int,
    device: Handle,
}

const BUTTONS: c_uint = 0x2000;
pub(super) const POSITION: c_uint = 0x2050;
pub(super) const VELOCITY: c_uint = 0x2051;
/// Column major, the translation in the last column.
pub(super) const TRANSFORM: c_uint = 0x2052;
const MODEL: c_uint = 0x2501;
/// Least x, y, z, largest x, y, z.
pub(super) const WORKSPACE: c_uint = 0x2551;
/// N/mm.
pub(super) const MAX_STIFFNESS: c_uint = 0x2602;
/// N.
pub(super) const MAX_FORCE: c_uint = 0x2603;
const FORCE: c_uint = 0x2700;
const FORCE_OUTPUT: c_uint = 0x4000;
/// Bits of the ways in which it can be calibrated.
const CALIBRATION_STYLE: c_uint = 0x2555;
/// By itself, or when the stylus is in its inkwell. A reset of the encoders is not among them: it takes a person who puts the
/// device into its reset position.
const CALIBRATION_STYLES: [c_uint; 2] = [4, 2];
pub(super) const CALIBRATED: c_uint = 0x5000;
pub(super) const CALIBRATION_NEEDS_UPDATE: c_uint = 0x5001;
pub(super) const CALIBRATION_NEEDS_HAND: c_uint = 0x5002;

/// Warm motors; the device may soon cut.
pub(super) const WARM: c_uint = 0x200;
/// More errors at once than this are left for the next time.
const ERRORS_AT_ONCE: usize = 8;

/// Warm motors, and limits of force, its change and velocity that the device keeps by itself. 0x204, a force error, is not.
pub(super) fn harmless(code: u32) -> bool {
    (WARM..=0x203).contains(&code)
}

/// 0x302 and 0x303 are those of the communication.
pub(super) fn fault(code: u32) -> Fault {
    if matches!(code, 0x302 | 0x303) { Fault::Disconnected } else { Fault::Code(code.into()) }
}

prototypes! {
    /// What is used of `libHD`.
    pub(super) Calls
    plain {
        disable_device = hdDisableDevice(device: Handle);
        make_current = hdMakeCurrentDevice(device: Handle);
        begin = hdBeginFrame(device: Handle);
        end = hdEndFrame(device: Handle);
        get_error = hdGetError() -> ErrorInfo;
        enable = hdEnable(what: c_uint);
        start = hdStartScheduler();
        stop = hdStopScheduler();
        set_rate = hdSetSchedulerRate(hertz: c_ulong);
        unschedule = hdUnschedule(callback: c_ulong);
    }
    raw {
        init = hdInitDevice(*const c_char) -> Handle;
        get_doubles = hdGetDoublev(c_uint, *mut c_double);
        get_integers = hdGetIntegerv(c_uint, *mut c_int);
        set_doubles = hdSetDoublev(c_uint, *const c_double);
        schedule = hdScheduleAsynchronous(Callback, *mut c_void, u16) -> c_ulong;
    }
    optional {
        get_string = hdGetString(c_uint) -> *const c_char;
        error_string = hdGetErrorString(c_uint) -> *const c_char;
        is_enabled = hdIsEnabled(c_uint) -> c_uchar;
        check_calibration = hdCheckCalibration() -> c_uint;
        update_calibration = hdUpdateCalibration(c_uint);
    }
}

#[allow(unsafe_code, reason = "each is a call into the vendor's library")]
impl Calls {
    pub(super) fn initialise(&self, name: Option<&CStr>) -> Handle {
        // SAFETY: the library is open; NULL stands for the default device.
        unsafe { (self.init)(name.map_or(ptr::null(), CStr::as_ptr)) }
    }

    /// The `N` numbers of a parameter of the current device; no numbers where it has none.
    pub(super) fn doubles<const N: usize>(&self, what: c_uint) -> [f64; N] {
        // The longest parameter has 16.
        let mut values = [f64::NAN; 16];
        // SAFETY: the library is open, and writes no more than there is room for.
        unsafe { (self.get_doubles)(what, values.as_mut_ptr()) };
        std::array::from_fn(|i| values[i])
    }

    pub(super) fn buttons(&self) -> u32 {
        let mut mask = 0;
        // SAFETY: the library is open, and writes one number.
        unsafe { (self.get_integers)(BUTTONS, &mut mask) };
        mask.cast_unsigned()
    }

    pub(super) fn set_force(&self, newtons: [f64; 3]) {
        // SAFETY: the library is open, and reads three numbers.
        unsafe { (self.set_doubles)(FORCE, newtons.as_ptr()) }
    }

    pub(super) fn enable_forces(&self) {
        self.enable(FORCE_OUTPUT);
    }

    /// Whether the device, or its driver, has switched them off. Older libraries don't tell.
    pub(super) fn forces_are_off(&self) -> bool {
        // SAFETY: the library is open.
        self.is_enabled.is_some_and(|ask| unsafe { ask(FORCE_OUTPUT) } == 0)
    }

    /// How the current device is calibrated, if the library tells. Only the scheduler's thread gets an answer that is true,
    /// inside a frame.
    pub(super) fn calibration(&self) -> Option<u32> {
        // SAFETY: the library is open.
        self.check_calibration.map(|ask| unsafe { ask() })
    }

    /// Calibrates the current device, if it can be done without a hand. Positions may jump.
    pub(super) fn calibrate(&self) {
        let mut styles = 0;
        // SAFETY: the library is open, and writes one number.
        unsafe { (self.get_integers)(CALIBRATION_STYLE, &mut styles) };
        let style = CALIBRATION_STYLES.into_iter().find(|style| styles.cast_unsigned() & style != 0);
        if let (Some(style), Some(update)) = (style, self.update_calibration) {
            // SAFETY: the library is open.
            unsafe { update(style) }
        }
    }

    /// `servo` must live until the callback has returned for the last time.
    pub(super) fn schedule_servo(&self, servo: *mut Servo, priority: u16) -> c_ulong {
        // SAFETY: the library is open, and hands the pointer to nobody but the callback.
        unsafe { (self.schedule)(servo::callback, servo.cast(), priority) }
    }

    /// Takes the errors since the last time from the vendor's stack.
    pub(super) fn errors(&self) -> impl Iterator<Item = u32> {
        (0..ERRORS_AT_ONCE).map(|_| self.get_error().code).take_while(|code| *code != 0)
    }

    pub(super) fn model(&self) -> String {
        // SAFETY: the library is open.
        self.get_string.map_or_else(|| "device".into(), |ask| text(unsafe { ask(MODEL) }))
    }

    pub(super) fn describe(&self, code: u32) -> String {
        // SAFETY: the library is open.
        let words = self.error_string.map(|ask| text(unsafe { ask(code) })).unwrap_or_default();
        format!("error {code:#05x} {words}").trim_end().to_owned()
    }
}
