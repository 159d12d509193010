//! Sessions: prepared, started, read, steered, ended.

use crate::body::{open_body, slip_rule};
use crate::device::{ForeignDevice, palpate_device};
use crate::handles::{Table, palpate_body, palpate_session};
use crate::status::{
    Failure, PALPATE_STATUS_CLOSED, PALPATE_STATUS_NOTHING, changed, give_text, guarded, palpate_error,
    palpate_status, place, quick, room, sized, text, write_text,
};
use palpate::runtime::{BodyFile, End, Record, Stopper};
use palpate::{LiveSession, Outcome, PreparedSession, SessionBody, SessionConfig, files};
use std::ffi::c_char;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Its time was over.
pub const PALPATE_END_DONE: u32 = 1;
/// The device had no more poses.
pub const PALPATE_END_ENDED: u32 = 2;
/// Somebody asked for it.
pub const PALPATE_END_ASKED: u32 = 3;
/// An emergency stop.
pub const PALPATE_END_EMERGENCY: u32 = 4;
/// The device failed.
pub const PALPATE_END_DEVICE: u32 = 5;
/// The device's pose stayed the same for too long.
pub const PALPATE_END_STALE: u32 = 6;
/// A period was too late.
pub const PALPATE_END_LATE: u32 = 7;
/// The contact finder was silent for too long.
pub const PALPATE_END_FINDER_SILENT: u32 = 8;
/// The body's file gave no more patches.
pub const PALPATE_END_BODY: u32 = 9;
/// The contact finder ended.
pub const PALPATE_END_FINDER_DEAD: u32 = 10;
/// The haptic thread panicked; the device was closed.
pub const PALPATE_END_PANIC: u32 = 11;

/// Bytes of `palpate_outcome.message`.
pub const PALPATE_OUTCOME_BYTES: usize = 512;

/// The latest period of a session. Names end in their units; vectors are in the device's frame where their name begins with `device` or
/// `command`, in the body's else.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_record {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// 1: a period.
    pub kind: u32,
    /// What the output stages did: bits as docs/recording.md has them; bit 0 says that the engine was given a pose.
    pub stage_flags: u32,
    /// Counts periods from 0.
    pub number: u64,
    /// The loop's time, s.
    pub time_s: f64,
    /// When the period really began, ns since the start.
    pub started_ns: u64,
    /// How long after its due time, ns.
    pub lateness_ns: i64,
    /// Since the period before began, ns; 0 in the first.
    pub period_ns: u64,
    /// What stepping and the stages took, without the device, ns.
    pub step_ns: u32,
    /// What the device's read took, ns.
    pub read_ns: u32,
    /// What the device's write took, ns.
    pub write_ns: u32,
    /// What the device reported: 0 nothing, 1 not open, 2 gone, 3 not in time, 4 not understood, 5 an error of the vendor's
    /// (`fault_code`), 6 no more poses.
    pub fault: u32,
    /// The vendor's number of the error, if `fault` is 5.
    pub fault_code: i64,
    /// The sample's number.
    pub device_sequence: u64,
    /// The handle.
    pub device_position_m: [f64; 3],
    /// Its orientation, w x y z.
    pub device_orientation: [f64; 4],
    /// Its velocity, if `device_status` says that the device reports one.
    pub device_velocity_m_per_s: [f64; 3],
    /// Bit i is button i.
    pub device_buttons: u32,
    /// A sum of `PALPATE_DEVICE_...`.
    pub device_status: u32,
    /// The pose that the engine was given.
    pub tool_position_m: [f64; 3],
    /// Its orientation, w x y z.
    pub tool_orientation: [f64; 4],
    /// The engine's force on the tool.
    pub force_n: [f64; 3],
    /// The engine's torque on the tool.
    pub torque_nm: [f64; 3],
    /// Area coordinates of the contact point.
    pub area_coordinates: [f64; 3],
    /// The contact point at rest.
    pub contact_position_m: [f64; 3],
    /// Normal deflection.
    pub delta_z_m: f64,
    /// Lateral deflection.
    pub delta_r_m: f64,
    /// Triangle that is touched; `PALPATE_NO_ELEMENT` for none.
    pub element: u32,
    /// A sum of `PALPATE_FLAG_...`.
    pub engine_flags: u32,
    /// Work of the tool on the body so far.
    pub work_j: f64,
    /// Energy stored now.
    pub stored_j: f64,
    /// Energy dissipated so far.
    pub dissipated_j: f64,
    /// The part of it where slip generated energy, as a positive sum.
    pub generated_j: f64,
    /// Given out at the engine's port so far.
    pub out_j: f64,
    /// Sum of the squares of the tool's ways so far.
    pub squares_m2: f64,
    /// What the passivity controller has observed so far; 0 without one.
    pub observed_j: f64,
    /// The command to the device: force on the hand.
    pub command_force_n: [f64; 3],
    /// The command to the device: torque on the hand.
    pub command_torque_nm: [f64; 3],
    /// Where the patch that was stepped on was asked for.
    pub patch_centre_m: [f64; 3],
    /// Which patch it was; 0 for the whole body.
    pub patch_serial: u64,
    /// How many elements it had.
    pub patch_count: u32,
    /// 0.
    pub spare_half: u32,
    /// Periods so far in which the loop waited for a patch.
    pub patch_waits: u64,
    /// Page faults of the haptic thread so far, without the disk.
    pub minor_faults: u32,
    /// Page faults of the haptic thread so far, with the disk.
    pub major_faults: u32,
    /// The handle's angular velocity, if `device_status` says that the device reports one.
    pub device_angular_velocity_rad_per_s: [f64; 3],
    /// Sum of the squares of the tool's rotation vectors so far.
    pub squares_rad2: f64,
    /// What multiplied the body's friction coefficients.
    pub friction_scale: f64,
    /// The tank: what slips have dissipated, and later ones may give out again. NaN where no tank holds slip back.
    pub tank_j: f64,
    /// 0.
    pub spare: [u64; 2],
    /// `PALPATE_SLIP_...`.
    pub slip_rule_code: u32,
    /// Of a record in a file; 0 here.
    pub crc: u32,
}

/// What comes before a record's own bytes.
const BEFORE: usize = 8;
const _: () = assert!(size_of::<palpate_record>() == BEFORE + Record::BYTES);

/// What became of a session.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_outcome {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// Why it ended: `PALPATE_END_...`.
    pub end: u32,
    /// 1 if it went as it should: its time was over, the device had no more poses, or somebody asked.
    pub is_well: u32,
    /// 1 if what should have been recorded is not all in its file.
    pub is_recording_cut: u32,
    /// Periods that were run.
    pub periods: u64,
    /// Periods in contact.
    pub periods_in_contact: u64,
    /// Periods that began later than a whole period after their time.
    pub overruns: u64,
    /// Records that were written to the file.
    pub recorded: u64,
    /// The largest force that was commanded, N.
    pub force_max_n: f64,
    /// The largest torque that was commanded, N m.
    pub torque_max_nm: f64,
    /// Why it ended, in words: UTF-8 that ends in a zero.
    pub message: [c_char; PALPATE_OUTCOME_BYTES],
}

sized!(palpate_record, palpate_outcome);

/// Where a session is.
enum Phase {
    Prepared(Mutex<Box<PreparedSession>>),
    Live(Box<LiveSession>),
    /// It could not be started.
    Gone,
}

/// What is open as a session.
struct OpenSession {
    phase: Phase,
    stopper: Stopper,
}

static SESSIONS: Table<OpenSession> = Table::new(3);

/// What a reader may do with a session that runs.
fn live<R>(
    session: palpate_session,
    call: impl FnOnce(&LiveSession) -> Result<R, Failure>,
) -> Result<R, Failure> {
    let open = SESSIONS.read(session.id)?;
    match &open.phase {
        Phase::Live(live) => call(live),
        _ => Err(not_started()),
    }
}

fn not_started() -> Failure {
    Failure::new(PALPATE_STATUS_NOTHING, "the session does not run; start it first (palpate_session_start)")
}

/// A body for sessions. A recording names the body's file with its digest.
fn session_body(body: palpate_body, is_recorded: bool) -> Result<SessionBody, Failure> {
    let (body, file) = open_body(body)?;
    let file = match file.filter(|_| is_recorded) {
        Some(path) => BodyFile::of(&path)
            .map_err(|e| Failure::new(crate::PALPATE_STATUS_SESSION, files::message(&e)))?,
        None => BodyFile::default(),
    };
    Ok(SessionBody { source: body, file })
}

/// Prepares a session of `body`: opens the device, lays out the first patch, and starts nothing yet; there is no force before
/// `palpate_session_start`. `config_json` holds the settings of docs/session.md as a JSON object, e.g.
/// `{"device": "simulated:touch", "seconds": 2, "safety": {"force_max_n": 1}}`; null or empty for the defaults. With a `device` of the
/// caller's (not null) the setting `device` counts for nothing; its table is copied. What could not be had is told by
/// `palpate_session_notes`, before the first force.
/// Fails with `PALPATE_STATUS_INVALID` (the JSON), `PALPATE_STATUS_SESSION` (a setting, the device; the message says what to do).
/// Not real-time: it may take seconds.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_prepare(
    body: palpate_body,
    config_json: *const c_char,
    device: *const palpate_device,
    session: *mut palpate_session,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let to = place(session)?;
            let json = if config_json.is_null() { "" } else { text(config_json, "the configuration")? };
            let config: SessionConfig = if json.trim().is_empty() {
                SessionConfig::default()
            } else {
                serde_json::from_str(json).map_err(|e| {
                    Failure::invalid(format!(
                        "the configuration's JSON: {e}; see docs/session.md for its keys"
                    ))
                })?
            };
            let body = session_body(body, config.record.is_some())?;
            let prepared = if device.is_null() {
                PreparedSession::new(body, config, None)?
            } else {
                PreparedSession::with_device(body, Box::new(ForeignDevice::new(device)?), config, None)?
            };
            let stopper = prepared.stopper();
            let phase = Phase::Prepared(Mutex::new(Box::new(prepared)));
            to.id = SESSIONS.open(OpenSession { phase, stopper });
            Ok(())
        })
    }
}

/// Starts the threads, and the recording if there is to be one: from now on there are forces.
/// Fails with `PALPATE_STATUS_SESSION`: the device is closed then, and the handle is only good for `palpate_session_close`.
/// Not real-time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_start(
    session: palpate_session,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let mut open = SESSIONS.alone(session.id)?;
            match std::mem::replace(&mut open.phase, Phase::Gone) {
                Phase::Prepared(prepared) => {
                    let prepared = prepared.into_inner().unwrap_or_else(PoisonError::into_inner);
                    open.phase = Phase::Live(Box::new(prepared.start()?));
                    Ok(())
                }
                other => {
                    open.phase = other;
                    Err(Failure::new(
                        PALPATE_STATUS_NOTHING,
                        "the session was started before; prepare another",
                    ))
                }
            }
        })
    }
}

/// What could not be had (a watchdog, locked memory, a priority), and what the hand should know of this device on this body: one
/// line each. Copies them to `buffer` (`capacity` bytes) with a zero at the end, and to `*needed` (may be null) the bytes that all of it
/// takes; `PALPATE_STATUS_TOO_SMALL` if they did not fit. Not real-time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_notes(
    session: palpate_session,
    buffer: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> palpate_status {
    quick(|| {
        let open = SESSIONS.read(session.id)?;
        let lines = |notes: &[String], advice: Option<&str>| {
            notes.iter().map(String::as_str).chain(advice).collect::<Vec<_>>().join("\n")
        };
        let told = match &open.phase {
            Phase::Prepared(prepared) => {
                let prepared = prepared.lock().unwrap_or_else(PoisonError::into_inner);
                lines(prepared.notes(), prepared.advice())
            }
            Phase::Live(live) => lines(live.notes(), live.advice()),
            Phase::Gone => String::new(),
        };
        // SAFETY: the caller keeps the header's promises.
        unsafe { give_text(&told, buffer, capacity, needed) }
    })
}

/// The latest period: poses, wrench, command, contact, energies, flags, times. `PALPATE_STATUS_NOTHING` before the first. The haptic
/// thread does not notice who reads.
/// Real-time: O(1), without a lock; it tries again while the record changes under it. `PALPATE_STATUS_BUSY` only while
/// `palpate_session_start`, `_set_slip_rule`, `_change_body` or `_close` is under way.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_latest(
    session: palpate_session,
    record: *mut palpate_record,
) -> palpate_status {
    quick(|| {
        // SAFETY: the caller keeps the header's promises.
        let to = unsafe { changed(record) }?;
        let open = SESSIONS.read(session.id)?;
        let Phase::Live(live) = &open.phase else { return Err(PALPATE_STATUS_NOTHING) };
        write_record(&live.latest().ok_or(PALPATE_STATUS_NOTHING)?, to);
        Ok(())
    })
}

fn write_record(record: &Record, to: &mut palpate_record) {
    (to.struct_size, to.reserved) = (size_of::<palpate_record>() as u32, 0);
    // SAFETY: behind its first eight bytes a `palpate_record` has the members of a `Record`, which is plain data, at the same
    // distances: the sizes are compared above, the members by a test.
    unsafe {
        let bytes = std::ptr::from_mut(to).cast::<u8>().add(BEFORE);
        std::ptr::copy_nonoverlapping(std::ptr::from_ref(record).cast::<u8>(), bytes, Record::BYTES);
    }
}

/// Periods of the past, as many a second as the setting `history` says, the oldest first: up to `capacity` of the newest go to
/// `records`, whose sizes need not be set; `*count` says how many there are. `PALPATE_STATUS_TOO_SMALL` if there are more than `capacity`.
/// Not real-time: allocates, and waits for the recorder.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_history(
    session: palpate_session,
    records: *mut palpate_record,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    quick(|| {
        let open = SESSIONS.read(session.id)?;
        let Phase::Live(live) = &open.phase else { return Err(PALPATE_STATUS_NOTHING) };
        let history = live.history();
        // SAFETY: the caller keeps the header's promises.
        let (to, count) = unsafe { (room(records, capacity)?, place(count)?) };
        *count = history.len();
        let newest = history.len().saturating_sub(capacity);
        to.iter_mut().zip(&history[newest..]).for_each(|(to, record)| write_record(record, to));
        if newest > 0 { Err(crate::PALPATE_STATUS_TOO_SMALL) } else { Ok(()) }
    })
}

/// Statistics so far (periods, percentiles of times in ns, energies in J, the largest force in N) as JSON: copied as
/// `palpate_session_notes` does. Not real-time: allocates, and waits for the recorder.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_summary(
    session: palpate_session,
    buffer: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> palpate_status {
    quick(|| {
        let open = SESSIONS.read(session.id)?;
        let Phase::Live(live) = &open.phase else { return Err(PALPATE_STATUS_NOTHING) };
        let json = serde_json::to_string(&live.summary()).map_err(|_| PALPATE_STATUS_NOTHING)?;
        // SAFETY: the caller keeps the header's promises.
        unsafe { give_text(&json, buffer, capacity, needed) }
    })
}

/// 0 or less, and what is no number, stand for the slowest slew that lets a stop end in two periods.
fn slew(given: f64) -> Option<f64> {
    (given > 0.0).then_some(given)
}

/// The largest force, N, and how fast it may change, N/s (0 for the slowest slew that lets a stop end in two periods). As every
/// change it is made in silence: the force goes to zero, the change is made, the force ramps up over the soft start.
/// Fails with `PALPATE_STATUS_SESSION`: more than the device was opened with, 64 changes under way already, an ended session.
/// It waits for no haptic thread, but may for another caller of these functions.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_set_force_limit(
    session: palpate_session,
    force_max_n: f64,
    slew_n_per_s: f64,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            live(session, |live| Ok(live.controls().set_force_limit(force_max_n, slew(slew_n_per_s))?))
        })
    }
}

/// The largest torque, N m, and how fast it may change, N m/s; else as `palpate_session_set_force_limit`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_set_torque_limit(
    session: palpate_session,
    torque_max_nm: f64,
    slew_nm_per_s: f64,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            live(session, |live| Ok(live.controls().set_torque_limit(torque_max_nm, slew(slew_nm_per_s))?))
        })
    }
}

/// What multiplies the body's friction coefficients, 0 to 100; else as `palpate_session_set_force_limit`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_set_friction_scale(
    session: palpate_session,
    scale: f64,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe { guarded(error, || live(session, |live| Ok(live.controls().set_friction_scale(scale)?))) }
}

/// No force from the next period on, within the slew limit, until `palpate_session_resume`. It waits for no other change.
/// Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_session_pause(session: palpate_session) -> palpate_status {
    quick(|| {
        let open = SESSIONS.read(session.id)?;
        let Phase::Live(live) = &open.phase else { return Err(PALPATE_STATUS_NOTHING) };
        live.controls().pause();
        Ok(())
    })
}

/// Ends a pause: the force ramps up anew. Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_session_resume(session: palpate_session) -> palpate_status {
    quick(|| {
        let open = SESSIONS.read(session.id)?;
        let Phase::Live(live) = &open.phase else { return Err(PALPATE_STATUS_NOTHING) };
        live.controls().resume();
        Ok(())
    })
}

/// Goes over to another slip rule, `PALPATE_SLIP_...`; else as `palpate_session_set_force_limit`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_set_slip_rule(
    session: palpate_session,
    rule: u32,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let rule = slip_rule(rule)?;
            match &mut SESSIONS.alone(session.id)?.phase {
                Phase::Live(live) => Ok(live.set_slip_rule(rule)?),
                _ => Err(not_started()),
            }
        })
    }
}

/// Goes over to another body, through silence and the soft start; not while a recording is written. A tool that is inside the new body
/// feels nothing until it has left it. Not real-time for the caller: it lays out the new body's first patch.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_change_body(
    session: palpate_session,
    body: palpate_body,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let body = session_body(body, false)?;
            match &mut SESSIONS.alone(session.id)?.phase {
                Phase::Live(live) => Ok(live.change_body(body)?),
                _ => Err(not_started()),
            }
        })
    }
}

/// Asks for the end: zero force within two periods, and a closed device. It waits for nothing; `palpate_session_close` waits.
/// Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_session_stop(session: palpate_session) -> palpate_status {
    quick(|| {
        SESSIONS.read(session.id)?.stopper.stop("the program asked for the end");
        Ok(())
    })
}

/// The same with zero force before anything else, past the slew limit, by the device's own emergency stop: for a button, or when the
/// program itself fails. Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_session_stop_at_once(session: palpate_session) -> palpate_status {
    quick(|| {
        SESSIONS.read(session.id)?.stopper.stop_at_once("the program asked for an emergency stop");
        Ok(())
    })
}

/// Waits until the session is over, or `timeout_s` (s) have passed; 0 does not wait. Writes 1 to `*is_over` if it is over, else 0. The
/// session stays open: `palpate_session_close` tells what became of it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_wait(
    session: palpate_session,
    timeout_s: f64,
    is_over: *mut u32,
) -> palpate_status {
    quick(|| {
        // SAFETY: the caller keeps the header's promises.
        let to = unsafe { place(is_over) }?;
        let begun = Instant::now();
        loop {
            // Entered anew each time, so that others may stop, change and close it meanwhile.
            *to = match SESSIONS.read(session.id) {
                Ok(open) => match &open.phase {
                    Phase::Live(live) => live.is_over().into(),
                    Phase::Prepared(_) => return Err(PALPATE_STATUS_NOTHING),
                    Phase::Gone => 1,
                },
                Err(PALPATE_STATUS_CLOSED) => return Err(PALPATE_STATUS_CLOSED),
                Err(_) => 0,
            };
            let left = timeout_s - begun.elapsed().as_secs_f64();
            if *to == 1 || left.is_nan() || left <= 0.0 {
                return Ok(());
            }
            std::thread::sleep(Duration::from_secs_f64(left.min(2e-3)));
        }
    })
}

/// Ends a session, if it has not ended, waits for its threads and its recording, and closes the handle. What became of it goes to
/// `*outcome` (may be null); of one that was never started `end` is 0. `PALPATE_STATUS_BUSY` while another thread is in a call with it: the
/// session goes on then. Not real-time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_session_close(
    session: palpate_session,
    outcome: *mut palpate_outcome,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let to = if outcome.is_null() { None } else { Some(changed(outcome)?) };
            let OpenSession { phase, stopper } = SESSIONS.close(session.id)?;
            stopper.stop("the program asked for the end");
            let told = match phase {
                Phase::Live(live) => Some(live.join()),
                Phase::Prepared(_) | Phase::Gone => None,
            };
            if let Some(to) = to {
                *to = outcome_of(told.as_ref());
            }
            Ok(())
        })
    }
}

fn outcome_of(outcome: Option<&Outcome>) -> palpate_outcome {
    let mut to = palpate_outcome {
        struct_size: size_of::<palpate_outcome>() as u32,
        end: 0,
        is_well: 1,
        is_recording_cut: 0,
        periods: 0,
        periods_in_contact: 0,
        overruns: 0,
        recorded: 0,
        force_max_n: 0.0,
        torque_max_nm: 0.0,
        message: [0; PALPATE_OUTCOME_BYTES],
    };
    let Some(Outcome { report, finished, .. }) = outcome else {
        write_text("it was never started", &mut to.message);
        return to;
    };
    to.end = match report.end {
        End::Done => PALPATE_END_DONE,
        End::Ended => PALPATE_END_ENDED,
        End::Asked(_) => PALPATE_END_ASKED,
        End::Emergency(_) => PALPATE_END_EMERGENCY,
        End::Device(_) => PALPATE_END_DEVICE,
        End::Stale(_) => PALPATE_END_STALE,
        End::Late(_) => PALPATE_END_LATE,
        End::FinderSilent(_) => PALPATE_END_FINDER_SILENT,
        End::Body(_) => PALPATE_END_BODY,
        End::FinderDead => PALPATE_END_FINDER_DEAD,
        End::Panic(_) => PALPATE_END_PANIC,
    };
    to.is_well = report.end.is_well().into();
    to.is_recording_cut = finished.trouble.is_some().into();
    to.periods = report.periods;
    to.periods_in_contact = finished.summary.periods_in_contact;
    to.overruns = finished.summary.overruns;
    to.recorded = finished.written;
    to.force_max_n = finished.summary.force_max_n;
    to.torque_max_nm = finished.summary.torque_max_nm;
    let mut words = report.end.to_string();
    finished.trouble.iter().for_each(|trouble| words.push_str(&format!("; recording: {trouble}")));
    write_text(&words, &mut to.message);
    to
}
