//! A device that is a table of C functions: whatever goes wrong in it ends the session as the same fault of a device in Rust does.

#![allow(unsafe_code, reason = "it calls functions that take pointers, as a C program does")]

use palpate::body::shape::Shape;
use palpate::body::{Body, Response};
use palpate::device::{
    Capabilities, Command, Device, EmergencyStop, Fault, OpenError, Pose, Sample, presets,
};
use palpate::{PreparedSession, SessionConfig};
use palpate_c::*;
use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex};

/// What goes wrong, from the hundredth period on.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mishap {
    Nothing,
    Unread(Fault),
    /// For fewer periods than the session has patience for.
    Passing(Fault),
    Unwritten(Fault),
    NoNumber,
    /// The same pose, by its own counter.
    Still,
}

const MISHAPS: [Mishap; 11] = [
    Mishap::Nothing,
    Mishap::Unread(Fault::Ended),
    Mishap::Unread(Fault::Disconnected),
    Mishap::Unread(Fault::TimedOut),
    Mishap::Unread(Fault::Garbled),
    Mishap::Unread(Fault::Code(7)),
    Mishap::Passing(Fault::TimedOut),
    Mishap::Unwritten(Fault::Disconnected),
    Mishap::Unwritten(Fault::Code(9)),
    Mishap::NoNumber,
    Mishap::Still,
];

/// What both devices do: press 4 mm into a ball within a tenth of a second, and rest there.
#[derive(Debug)]
struct Stand {
    mishap: Mishap,
    periods: u64,
    /// Commanded since it was opened, and last, N.
    largest: f64,
    last: f64,
    opened: u32,
    closed: u32,
}

impl Stand {
    fn new(mishap: Mishap) -> Self {
        Stand { mishap, periods: 0, largest: 0.0, last: f64::NAN, opened: 0, closed: 0 }
    }

    fn is_wrong(&self) -> bool {
        self.periods > 300
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.periods += 1;
        let z = 31e-3 - 5e-3 * (now_s / 0.1).min(1.0);
        let mut sample = Sample { sequence: self.periods, ..Sample::default() };
        sample.pose = Pose { position_m: [1e-3, 2e-3, z], ..Pose::default() };
        match self.mishap {
            Mishap::Unread(fault) if self.is_wrong() => return Err(fault),
            Mishap::Passing(fault) if (301..305).contains(&self.periods) => return Err(fault),
            Mishap::NoNumber if self.is_wrong() => sample.pose.position_m[1] = f64::NAN,
            Mishap::Still if self.is_wrong() => sample.sequence = 300,
            _ => {}
        }
        Ok(sample)
    }

    fn write(&mut self, force_n: [f64; 3]) -> Result<(), Fault> {
        match self.mishap {
            Mishap::Unwritten(fault) if self.is_wrong() => return Err(fault),
            _ => {}
        }
        (self.largest, self.last) = (self.largest.max(force_n[2]), force_n[2]);
        Ok(())
    }
}

fn can() -> Capabilities {
    presets::device("touch").unwrap()
}

struct Native(Arc<Mutex<Stand>>, Capabilities);

impl Device for Native {
    fn capabilities(&self) -> &Capabilities {
        &self.1
    }
    fn open(&mut self) -> Result<(), OpenError> {
        self.0.lock().unwrap().opened += 1;
        Ok(())
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.0.lock().unwrap().read(now_s)
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        self.0.lock().unwrap().write(command.force_n)
    }
    fn close(&mut self) {
        let mut stand = self.0.lock().unwrap();
        stand.closed = stand.opened;
    }
    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        None
    }
}

fn number(result: Result<(), Fault>) -> palpate_fault {
    match result {
        Ok(()) => PALPATE_FAULT_NONE,
        Err(Fault::NotOpen) => PALPATE_FAULT_NOT_OPEN,
        Err(Fault::Disconnected) => PALPATE_FAULT_DISCONNECTED,
        Err(Fault::TimedOut) => PALPATE_FAULT_TIMED_OUT,
        Err(Fault::Garbled) => PALPATE_FAULT_GARBLED,
        Err(Fault::Ended) => PALPATE_FAULT_ENDED,
        Err(Fault::Code(code)) => code,
    }
}

/// What a C program would write.
mod table {
    use super::*;

    /// The stand that a device's pointer leads to.
    unsafe fn stand<'a>(user: *mut c_void) -> &'a Mutex<Stand> {
        // SAFETY: the tests give every device a stand that outlives its session.
        unsafe { &*user.cast::<Mutex<Stand>>() }
    }

    unsafe extern "C" fn open(
        user: *mut c_void,
        to: *mut palpate_capabilities,
        _: *mut c_char,
        _: usize,
    ) -> palpate_fault {
        // SAFETY: the library gives a place for capabilities.
        let (stand, to, from) = unsafe { (stand(user), &mut *to, can()) };
        stand.lock().unwrap().opened += 1;
        for (to, byte) in to.name.iter_mut().zip(from.name.bytes()) {
            *to = byte as c_char;
        }
        to.basis = PALPATE_BASIS_STATED;
        to.max_force_n = from.max_force_n.value;
        to.max_stiffness_n_per_m = from.max_stiffness_n_per_m.value;
        to.workspace_centre_m = from.workspace.centre_m;
        to.workspace_half_extent_m = from.workspace.half_extent_m;
        to.sensed_translations = from.sensed.translations.into();
        to.driven_translations = from.driven.translations.into();
        (to.usual_hz, to.most_hz) = (from.rates.usual_hz, from.rates.most_hz);
        to.mass_kg = from.mechanics.mass_kg.value;
        to.damping_n_s_per_m = from.mechanics.damping_n_s_per_m.value;
        to.coulomb_n = from.mechanics.coulomb_n.value;
        to.resolution_m = from.mechanics.resolution_m.value;
        to.delay_s = from.mechanics.delay_s.value;
        to.lag_s = from.mechanics.lag_s.value;
        PALPATE_FAULT_NONE
    }

    unsafe extern "C" fn read(user: *mut c_void, now_s: f64, to: *mut palpate_sample) -> palpate_fault {
        // SAFETY: the library gives a place for a sample.
        let (stand, to) = unsafe { (stand(user), &mut *to) };
        assert_eq!(to.struct_size as usize, size_of::<palpate_sample>());
        let result = stand.lock().unwrap().read(now_s);
        if let Ok(sample) = result {
            (to.sequence, to.position_m) = (sample.sequence, sample.pose.position_m);
        }
        number(result.map(drop))
    }

    unsafe extern "C" fn write(user: *mut c_void, command: *const palpate_command) -> palpate_fault {
        // SAFETY: the library gives a command.
        let (stand, command) = unsafe { (stand(user), &*command) };
        number(stand.lock().unwrap().write(command.force_n))
    }

    unsafe extern "C" fn close(user: *mut c_void) {
        // SAFETY: see `stand`.
        unsafe { stand(user) }.lock().unwrap().closed += 1;
    }

    unsafe extern "C" fn explain(_: *mut c_void, code: i64, to: *mut c_char, bytes: usize) {
        let words = CString::new(format!("its word for {code}")).unwrap();
        assert!(words.as_bytes_with_nul().len() <= bytes);
        // SAFETY: the library gives room for so many bytes.
        unsafe { to.copy_from(words.as_ptr(), words.as_bytes_with_nul().len()) };
    }

    /// How often the emergency stop was called.
    pub static STOPS: AtomicU64 = AtomicU64::new(0);

    unsafe extern "C" fn emergency_stop(_: *mut c_void) {
        STOPS.fetch_add(1, SeqCst);
    }

    pub fn of(stand: &Mutex<Stand>) -> palpate_device {
        palpate_device {
            struct_size: size_of::<palpate_device>() as u32,
            abi_version: PALPATE_ABI_VERSION,
            user: std::ptr::from_ref(stand).cast_mut().cast(),
            open: Some(open),
            read: Some(read),
            write: Some(write),
            close: Some(close),
            emergency_stop: Some(emergency_stop),
            explain: Some(explain),
        }
    }
}

/// Whatever the machine does besides is no reason to end.
const CONFIG: &str = r#"{"seconds": 0.6, "workspace": {"offset_m": [0, 0, 0]},
    "safety": {"soft_start_s": 0.05, "silence_s": 5},
    "patience": {"late_s": 10, "finder_s": 60},
    "real_time": {"priority": 0, "core": -1, "lock_memory": false, "spin_s": 0}}"#;

fn ball() -> Body {
    let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default()).unwrap();
    Body::uniform(ball, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()).unwrap()
}

fn error() -> palpate_error {
    palpate_error { struct_size: size_of::<palpate_error>() as u32, status: 0, message: [0; _] }
}

fn words(text: &[c_char]) -> String {
    let bytes: Vec<u8> = text.iter().map(|c| *c as u8).collect();
    CStr::from_bytes_until_nul(&bytes).unwrap().to_str().unwrap().to_owned()
}

fn outcome() -> palpate_outcome {
    // SAFETY: numbers and characters, for which all bits zero is zero.
    let zero: palpate_outcome = unsafe { std::mem::zeroed() };
    palpate_outcome { struct_size: size_of::<palpate_outcome>() as u32, ..zero }
}

/// A session on the C device, prepared and started.
fn started(body: palpate_body, stand: &Mutex<Stand>) -> palpate_session {
    let (device, config) = (table::of(stand), CString::new(CONFIG).unwrap());
    let (mut session, mut told) = (palpate_session::default(), error());
    // SAFETY: pointers to what the functions ask for.
    unsafe {
        let status = palpate_session_prepare(body, config.as_ptr(), &device, &mut session, &mut told);
        assert_eq!(status, PALPATE_STATUS_OK, "{}", words(&told.message));
        assert_eq!(palpate_session_start(session, &mut told), PALPATE_STATUS_OK, "{}", words(&told.message));
    }
    session
}

fn body_handle() -> palpate_body {
    let (bytes, mut body) = (ball().to_bytes().unwrap(), palpate_body::default());
    // SAFETY: as many bytes as said.
    let status = unsafe { palpate_body_from_memory(bytes.as_ptr(), bytes.len(), &mut body, &mut error()) };
    assert_eq!(status, PALPATE_STATUS_OK);
    body
}

#[test]
fn every_fault_ends_as_a_rust_devices_does() {
    let body = body_handle();
    let config: SessionConfig = serde_json::from_str(CONFIG).unwrap();
    for mishap in MISHAPS {
        let stand = Arc::new(Mutex::new(Stand::new(mishap)));
        let native = Native(stand.clone(), can());
        let session =
            PreparedSession::with_device(ball().into(), Box::new(native), config.clone(), None).unwrap();
        let expected = session.start().unwrap();
        while !expected.is_over() {
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        let expected = expected.join().report.end;
        let rust = Arc::into_inner(stand).unwrap().into_inner().unwrap();

        let stand = Mutex::new(Stand::new(mishap));
        let session = started(body, &stand);
        let (mut is_over, mut outcome, mut told) = (0, outcome(), error());
        // SAFETY: pointers to what the functions ask for.
        unsafe {
            assert_eq!(palpate_session_wait(session, 60.0, &mut is_over), PALPATE_STATUS_OK);
            assert_eq!(is_over, 1, "{mishap:?}");
            assert_eq!(palpate_session_close(session, &mut outcome, &mut told), PALPATE_STATUS_OK);
        }
        let message = words(&outcome.message);
        let kinds = [
            "",
            "done",
            "ended",
            "asked",
            "emergency",
            "device",
            "stale",
            "late",
            "finder-silent",
            "body",
            "finder-dead",
            "panic",
        ];
        assert_eq!(kinds[outcome.end as usize], expected.kind(), "{mishap:?}: {message}");
        assert_eq!(outcome.is_well == 1, expected.is_well(), "{mishap:?}: {message}");
        match mishap {
            Mishap::Unread(Fault::Code(code)) | Mishap::Unwritten(Fault::Code(code)) => {
                assert!(message.contains(&format!("its word for {code}")), "{message}");
            }
            // How long it stood still differs.
            Mishap::Still => assert!(message.contains("no new pose"), "{message}"),
            _ => assert_eq!(message, expected.to_string(), "{mishap:?}"),
        }
        let c = stand.into_inner().unwrap();
        for (name, stand) in [("Rust", &rust), ("C", &c)] {
            assert_eq!((stand.opened, stand.closed), (1, 1), "{mishap:?}, {name}");
            assert!(stand.largest > 0.3, "{mishap:?}, {name}: {}", stand.largest);
            // A device that takes no more commands keeps its last: closing it takes the force off.
            if !matches!(mishap, Mishap::Unwritten(_)) {
                assert_eq!(stand.last, 0.0, "{mishap:?}, {name}");
            }
        }
    }
    assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
}

#[test]
fn an_emergency_stop_reaches_the_caller() {
    let (body, stand) = (body_handle(), Mutex::new(Stand::new(Mishap::Nothing)));
    let session = started(body, &stand);
    assert_eq!(table::STOPS.load(SeqCst), 0);
    assert_eq!(palpate_session_stop_at_once(session), PALPATE_STATUS_OK);
    assert_eq!(table::STOPS.load(SeqCst), 1);
    let mut outcome = outcome();
    // SAFETY: a place for an outcome.
    let status = unsafe { palpate_session_close(session, &mut outcome, std::ptr::null_mut()) };
    assert_eq!((status, outcome.end), (PALPATE_STATUS_OK, PALPATE_END_EMERGENCY));
    assert_eq!(stand.lock().unwrap().closed, 1);
    assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
}
