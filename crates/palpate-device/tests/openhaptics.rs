//! The OpenHaptics driver against a stand-in whose scheduler calls back from a thread of its own: units, axes, order of
//! calls, limits, errors, and that no force is left behind however it ends.

mod stand_in;

use palpate_device::{Basis, Command, Device, Fault, OpenHaptics, OpenHapticsOptions, Sample};
use stand_in::{Built, StandIn};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

static LIBRARY: LazyLock<Built> = LazyLock::new(|| Built::new("openhaptics"));

/// There is one scheduler in a process: tests take turns.
fn turn() -> (MutexGuard<'static, ()>, StandIn) {
    static TURN: Mutex<()> = Mutex::new(());
    (TURN.lock().unwrap_or_else(PoisonError::into_inner), LIBRARY.copy())
}

fn options(library: &StandIn) -> OpenHapticsOptions {
    OpenHapticsOptions {
        library: Some(library.file.clone()),
        watchdog_s: 10.0,
        ..OpenHapticsOptions::default()
    }
}

fn opened(library: &StandIn) -> OpenHaptics {
    let mut device = OpenHaptics::new(options(library));
    device.open().unwrap();
    library.take_log();
    device
}

fn push(force_n: [f64; 3]) -> Command {
    Command { force_n, ..Command::default() }
}

/// What the log says until `call` is in it.
fn log_until(library: &StandIn, call: &str) -> Vec<String> {
    let start = Instant::now();
    let mut log = Vec::new();
    while !log.iter().any(|c| c == call) {
        assert!(start.elapsed() < Duration::from_secs(5), "no {call} in {log:?}");
        thread::sleep(Duration::from_millis(1));
        log.extend(library.take_log());
    }
    log
}

/// Reads until `good` holds of what is read.
fn read_until(
    device: &mut OpenHaptics,
    good: impl Fn(&Result<Sample, Fault>) -> bool,
) -> Result<Sample, Fault> {
    let start = Instant::now();
    loop {
        let read = device.read(0.0);
        if good(&read) {
            return read;
        }
        assert!(start.elapsed() < Duration::from_secs(5), "{read:?}");
        thread::sleep(Duration::from_millis(1));
    }
}

fn pressing(library: &StandIn) -> OpenHaptics {
    let mut device = opened(library);
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.0, 2.0])).unwrap();
    log_until(library, "force(0, 2, 0)");
    device
}

/// How a press must end.
const END: [&str; 3] = ["force(0, 0, 0)", "stop()", "disable(0)"];

#[test]
fn the_order_of_calls() {
    let (_turn, library) = turn();
    let mut device = OpenHaptics::new(options(&library));
    device.open().unwrap();
    assert_eq!(library.take_log(), ["init(NULL)", "rate(1000)", "schedule()", "start()"]);
    // No force before a pose was read.
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    thread::sleep(Duration::from_millis(10));
    assert!(library.take_log().is_empty());
    device.read(0.0).unwrap();
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    assert_eq!(log_until(&library, "force(1, 0, 0)"), ["enable(0x4000)", "force(1, 0, 0)"]);
    device.close();
    assert_eq!(library.take_log(), END);
    device.close();
    assert_eq!(device.read(0.0), Err(Fault::NotOpen));
    assert_eq!(device.write(&push([1.0, 0.0, 0.0])), Err(Fault::NotOpen));
    drop(device);
    assert!(library.take_log().is_empty());
}

/// mm become m; the vendor's y is up and its z points at the operator.
#[test]
fn units_and_axes() {
    let (_turn, library) = turn();
    for (name, value) in [("x", 10.0), ("y", 20.0), ("z", 30.0), ("vx", 100.0), ("vy", 200.0), ("vz", 300.0)]
    {
        library.set(name, value);
    }
    library.set("buttons", 2.0);
    library.set("turn", 0.4);
    let mut device = opened(&library);
    let sample = device.read(0.0).unwrap();
    let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(near(&sample.pose.position_m, &[0.01, -0.03, 0.02]), "{sample:?}");
    assert!(near(&sample.velocity_m_per_s.unwrap(), &[0.1, -0.3, 0.2]), "{sample:?}");
    // About the vendor's up, so about z.
    assert!(near(&sample.pose.orientation, &[0.2_f64.cos(), 0.0, 0.0, 0.2_f64.sin()]), "{sample:?}");
    assert_eq!(sample.buttons, 2);
    device.write(&push([1.0, 2.0, 3.0])).unwrap();
    log_until(&library, "force(1, 3, -2)");
}

#[test]
fn what_the_device_tells_of_itself() {
    let (_turn, library) = turn();
    let device = opened(&library);
    let c = device.capabilities();
    assert_eq!(
        (c.name.as_ref(), c.max_force_n.value, c.max_stiffness_n_per_m.value),
        ("3D Systems Touch", 4.0, 500.0)
    );
    assert!(matches!(c.max_force_n.basis, Basis::Measured(_)));
    // From −200 −100 −50 to 200 300 150 mm: the vendor's y is z here, its z is −y.
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(near(c.workspace.centre_m, [0.0, -0.05, 0.1]), "{:?}", c.workspace);
    assert!(near(c.workspace.half_extent_m, [0.2, 0.1, 0.2]), "{:?}", c.workspace);
    drop(device);
    // Where it doesn't tell, the table's figure stands.
    library.set("max_force", 0.0);
    let device = opened(&library);
    let most = &device.capabilities().max_force_n;
    assert_eq!(most.value, 3.3);
    assert!(matches!(most.basis, Basis::Stated(_)));
}

#[test]
fn limits() {
    let (_turn, library) = turn();
    let mut device = opened(&library);
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.0, 50.0])).unwrap();
    log_until(&library, "force(0, 4, 0)");
    assert!(device.read(0.0).unwrap().status.saturated);
    device.write(&push([f64::NAN, 0.0, 1.0])).unwrap();
    log_until(&library, "force(0, 0, 0)");
    drop(device);
    let mut device = OpenHaptics::new(OpenHapticsOptions { max_force_n: Some(1.0), ..options(&library) });
    device.open().unwrap();
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.0, 50.0])).unwrap();
    log_until(&library, "force(0, 1, 0)");
    drop(device);
    let wrong = OpenHapticsOptions { max_force_n: Some(f64::NAN), ..options(&library) };
    assert!(OpenHaptics::new(wrong).open().is_err());
}

/// 0x200 to 0x203 are said, and go on.
#[test]
fn warm_motors_and_limits_are_no_errors() {
    let (_turn, library) = turn();
    let mut device = pressing(&library);
    library.set("error", f64::from(0x200));
    assert!(read_until(&mut device, |r| r.unwrap().status.warm).is_ok());
    for code in 0x201..=0x203 {
        library.set("error", 0.0);
        read_until(&mut device, |r| !r.unwrap().status.saturated).unwrap();
        library.set("error", f64::from(code));
        read_until(&mut device, |r| r.unwrap().status.saturated).unwrap();
    }
    // The force is the loop's all the while.
    assert!(library.take_log().is_empty());
}

#[test]
fn a_disconnect_in_mid_press() {
    let (_turn, library) = turn();
    let mut device = pressing(&library);
    let before = device.read(0.0).unwrap();
    library.set("error", f64::from(0x302));
    assert_eq!(read_until(&mut device, Result::is_err), Err(Fault::Disconnected));
    library.set("error", f64::from(0x300));
    let failed = |r: &Result<Sample, Fault>| *r == Err(Fault::Code(0x300));
    let fault = read_until(&mut device, failed).unwrap_err();
    assert!(device.explain(fault).contains("0x300 some error"), "{}", device.explain(fault));
    // It may pass.
    library.set("error", 0.0);
    let after = read_until(&mut device, Result::is_ok).unwrap();
    assert!(after.sequence > before.sequence);
    library.set("error", f64::from(0x302));
    drop(device);
    assert_eq!(library.take_log(), END);
}

#[test]
fn a_panic_in_mid_press() {
    let (_turn, library) = turn();
    let device = pressing(&library);
    let caught = catch_unwind(AssertUnwindSafe(move || {
        let _held = device;
        panic!("the loop fell over");
    }));
    assert!(caught.is_err());
    assert_eq!(library.take_log(), END);
}

/// 0x204: what the motors do is not what they were told.
#[test]
fn a_force_error_is_an_error() {
    let (_turn, library) = turn();
    let mut device = pressing(&library);
    library.set("error", f64::from(0x204));
    assert_eq!(read_until(&mut device, Result::is_err), Err(Fault::Code(0x204)));
}

/// Forces that the device switched off are on again when the loop has commanded zero, not before, and not with a force.
#[test]
fn forces_that_the_device_switched_off() {
    let (_turn, library) = turn();
    let mut device = pressing(&library);
    library.set("trip", 1.0);
    assert!(read_until(&mut device, |r| r.unwrap().status.idle).is_ok());
    log_until(&library, "force(0, 0, 0)");
    library.set("trip", 0.0);
    for _ in 0..20 {
        device.write(&push([0.0, 0.0, 2.0])).unwrap();
        thread::sleep(Duration::from_millis(1));
        assert!(device.read(0.0).unwrap().status.idle);
    }
    assert!(library.take_log().is_empty());
    device.write(&push([0.0; 3])).unwrap();
    assert!(read_until(&mut device, |r| !r.unwrap().status.idle).is_ok());
    assert_eq!(library.take_log(), ["enable(0x4000)"]);
    device.write(&push([0.0, 0.0, 0.1])).unwrap();
    log_until(&library, "force(0, 0.1, 0)");
}

#[test]
fn an_emergency_stop() {
    let (_turn, library) = turn();
    let mut device = pressing(&library);
    device.emergency_stop().unwrap().stop();
    log_until(&library, "force(0, 0, 0)");
    device.write(&push([0.0, 0.0, 2.0])).unwrap();
    thread::sleep(Duration::from_millis(10));
    assert!(library.take_log().is_empty());
    // Opened anew it renders again.
    device.open().unwrap();
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.0, 2.0])).unwrap();
    log_until(&library, "force(0, 2, 0)");
}

/// One that only has to be taken over is, before the first pose; one that takes a hand is told, with what the hand has to do.
#[test]
fn the_calibration_is_asked_and_told() {
    for (calibration, updated, calls, words) in [
        (0x5000, 0x5000, &[][..], None),
        (0x5001, 0x5000, &["calibrate(4)"][..], None),
        (0x5001, 0x5001, &["calibrate(4)"][..], Some("Touch_Diagnostic")),
        (0x5002, 0x5002, &[][..], Some("inkwell")),
    ] {
        let (_turn, library) = turn();
        library.set("calibration", f64::from(calibration));
        library.set("updated", f64::from(updated));
        let mut device = OpenHaptics::new(options(&library));
        device.open().unwrap();
        assert_eq!(library.take_log()[4..], *calls, "{calibration:#x}");
        match (device.notes(), words) {
            ([], None) => {}
            ([note], Some(words)) => {
                assert!(note.contains("not calibrated") && note.contains(words), "{note}")
            }
            (notes, words) => panic!("{notes:?}: {words:?}"),
        }
    }
}

/// The loop is silent: after the watchdog's time the callback renders nothing, and does so until the loop has commanded zero:
/// the hand has sunk in meanwhile.
#[test]
fn a_silent_loop() {
    let (_turn, library) = turn();
    let mut device = OpenHaptics::new(OpenHapticsOptions { watchdog_s: 0.02, ..options(&library) });
    device.open().unwrap();
    device.read(0.0).unwrap();
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    log_until(&library, "force(0, 0, 0)");
    assert!(device.read(0.0).unwrap().status.idle);
    for _ in 0..20 {
        device.write(&push([1.0, 0.0, 0.0])).unwrap();
        thread::sleep(Duration::from_millis(1));
    }
    assert!(library.take_log().is_empty());
    device.write(&push([0.0; 3])).unwrap();
    assert!(read_until(&mut device, |r| !r.unwrap().status.idle).is_ok());
    device.write(&push([0.1, 0.0, 0.0])).unwrap();
    log_until(&library, "force(0.1, 0, 0)");
}

/// The scheduler freezes in the middle of a press: that is said, and the close takes the force off by itself.
#[test]
fn a_scheduler_that_stands() {
    let (_turn, library) = turn();
    let mut device = pressing(&library);
    library.set("stands", 1.0);
    thread::sleep(Duration::from_millis(50));
    let sequence = device.read(1.0).unwrap().sequence;
    assert_eq!(device.read(1.04).unwrap().sequence, sequence);
    assert_eq!(device.read(1.06), Err(Fault::TimedOut));
    library.take_log();
    drop(device);
    assert_eq!(library.take_log(), ["unschedule(40)", "stop()", "force(0, 0, 0)", "disable(0)"]);
    let error = OpenHaptics::new(options(&library)).open().unwrap_err().to_string();
    assert!(error.contains("never calls back"), "{error}");
}

/// A scheduler that takes its time blocks no other thread.
#[test]
fn a_slow_scheduler() {
    let (_turn, library) = turn();
    let mut device = opened(&library);
    library.set("slow", 0.03);
    let start = Instant::now();
    for _ in 0..1000 {
        device.read(0.0).unwrap();
        device.write(&push([0.0; 3])).unwrap();
    }
    // Had each of them waited for the scheduler, it would have been for 60 s.
    assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
}

#[test]
fn no_numbers() {
    let (_turn, library) = turn();
    library.set("y", f64::NAN);
    let mut device = opened(&library);
    assert_eq!(device.read(0.0), Err(Fault::Garbled));
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    thread::sleep(Duration::from_millis(10));
    assert!(library.take_log().is_empty());
    library.set("y", 0.0);
    read_until(&mut device, Result::is_ok).unwrap();
}

#[test]
fn names() {
    let (_turn, library) = turn();
    library.set("refused", 2.0);
    let device = OpenHaptics::new(options(&library)).open();
    assert!(device.is_ok());
    let log = library.take_log();
    assert_eq!(log[..3], ["init(NULL)", "init(Default Device)", "init(Default PHANToM)"]);
    library.set("refused", 99.0);
    let error = OpenHaptics::new(options(&library)).open().unwrap_err();
    assert!(error.problem.contains("the default device: error 0x301 device already initiated"), "{error}");
    assert!(error.hint.contains("openhaptics:NAME"), "{error}");
    library.take_log();
    let named = OpenHapticsOptions { name: Some("Left".into()), ..options(&library) };
    assert!(OpenHaptics::new(named).open().is_err());
    assert_eq!(library.take_log(), ["init(Left)"]);
    let error = OpenHaptics::new(OpenHapticsOptions::default()).open().unwrap_err();
    assert!(error.problem.contains("HD") && error.hint.contains("OpenHaptics"), "{error}");
}

#[test]
fn a_rate_that_is_refused_is_noted() {
    let (_turn, library) = turn();
    library.set("rate_error", 785.0);
    let device = opened(&library);
    assert!(device.notes()[0].contains("refuses 1000"), "{:?}", device.notes());
}

/// The scheduler stands while a second device is added or taken away, and goes on with the other.
#[test]
fn two_devices() {
    let (_turn, library) = turn();
    let mut left = opened(&library);
    let mut right = OpenHaptics::new(OpenHapticsOptions { name: Some("Right".into()), ..options(&library) });
    right.open().unwrap();
    assert_eq!(library.take_log(), ["stop()", "init(Right)", "rate(1000)", "schedule()", "start()"]);
    right.close();
    assert_eq!(library.take_log(), ["force(0, 0, 0)", "stop()", "disable(1)", "start()"]);
    let sequence = left.read(0.0).unwrap().sequence;
    read_until(&mut left, |r| r.unwrap().sequence > sequence).unwrap();
    left.close();
    assert_eq!(library.take_log(), ["stop()", "disable(0)"]);
}
