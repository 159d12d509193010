//! The Force Dimension driver against a stand-in for the vendor's library: units, axes, order of calls, limits, errors,
//! and that no force is left behind however it ends.

mod stand_in;

use palpate_device::{Basis, Command, Device, Dhd, DhdOptions, Fault};
use stand_in::{Built, StandIn};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::LazyLock;

static LIBRARY: LazyLock<Built> = LazyLock::new(|| Built::new("dhd"));

fn options(library: &StandIn) -> DhdOptions {
    DhdOptions { library: Some(library.file.clone()), ..DhdOptions::default() }
}

/// An open device with its log emptied.
fn opened(library: &StandIn) -> Dhd {
    let mut device = Dhd::new(options(library));
    device.open().unwrap();
    library.take_log();
    device
}

fn push(force_n: [f64; 3]) -> Command {
    Command { force_n, ..Command::default() }
}

/// A device in the middle of a press.
fn pressing(library: &StandIn) -> Dhd {
    let mut device = opened(library);
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.0, 2.0])).unwrap();
    assert!(library.take_log().last().unwrap().starts_with("force(0, 0, 2,"));
    device
}

const NOTHING: &str = "force(0, 0, 0, 0, 0, 0, 0, 5)";
/// How every open device must end.
const END: [&str; 3] = [NOTHING, "enable(0, 5)", "close(5)"];

#[test]
fn the_order_of_calls() {
    let library = LIBRARY.copy();
    let mut device = Dhd::new(options(&library));
    device.open().unwrap();
    // 20 ms are 160 steps of 125 µs, and only an expert may set them; an omega renders 12 N.
    let expected =
        ["count()", "open(0)", "expert()", "watchdog(160, 5)", "gravity(1, 5)", "max_force(12, 5)"];
    assert_eq!(library.take_log(), expected);
    // No force before a pose.
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    assert!(library.take_log().is_empty());
    device.read(0.0).unwrap();
    assert_eq!(library.take_log(), ["position(5)"]);
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    assert_eq!(library.take_log(), [NOTHING, "enable(1, 5)", "force(0, 1, 0, 0, 0, 0, 0, 5)"]);
    device.write(&push([0.0, 1.0, 0.0])).unwrap();
    assert_eq!(library.take_log(), ["force(-1, 0, 0, 0, 0, 0, 0, 5)"]);
    device.close();
    assert_eq!(library.take_log(), END);
    device.close();
    drop(device);
    assert!(library.take_log().is_empty());
}

#[test]
fn nothing_after_close_and_all_anew_after_open() {
    let library = LIBRARY.copy();
    let mut device = pressing(&library);
    device.close();
    library.take_log();
    assert_eq!(device.read(1.0), Err(Fault::NotOpen));
    assert_eq!(device.write(&push([1.0, 0.0, 0.0])), Err(Fault::NotOpen));
    assert!(library.take_log().is_empty());
    device.open().unwrap();
    library.take_log();
    // Enabled anew, and only after a pose.
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    assert!(library.take_log().is_empty());
    assert_eq!(device.read(0.0).unwrap().sequence, 1);
    device.write(&push([0.0; 3])).unwrap();
    assert!(library.take_log().contains(&"enable(1, 5)".into()));
}

/// Metres and newtons as they are; the vendor's x points at the operator and its y to the right.
#[test]
fn units_and_axes() {
    let library = LIBRARY.copy();
    let mut device = opened(&library);
    for (name, value) in [("x", 0.01), ("y", 0.02), ("z", 0.03), ("vx", 0.1), ("vy", 0.2), ("vz", 0.3)] {
        library.set(name, value);
    }
    library.set("buttons", 5.0);
    let sample = device.read(0.0).unwrap();
    assert_eq!(sample.pose.position_m, [0.02, -0.01, 0.03]);
    assert_eq!(sample.velocity_m_per_s, Some([0.2, -0.1, 0.3]));
    assert_eq!((sample.buttons, sample.pose.orientation), (5, [1.0, 0.0, 0.0, 0.0]));
    device.write(&push([1.0, 2.0, 3.0])).unwrap();
    assert_eq!(library.take_log().last().unwrap(), "force(-2, 1, 3, 0, 0, 0, 0, 5)");
    library.set("velocity", -1.0);
    assert_eq!(device.read(0.0).unwrap().velocity_m_per_s, None);
}

#[test]
fn a_wrist_turns() {
    let library = LIBRARY.copy();
    for (name, value) in [("wrist", 1.0), ("active_wrist", 1.0), ("name", 1.0), ("turn", 0.4)] {
        library.set(name, value);
    }
    let mut device = opened(&library);
    let c = device.capabilities();
    assert_eq!((c.name.as_ref(), c.sensed.rotations, c.driven.rotations), ("sigma.7", 3, 3));
    let most = c.max_torque_nm.as_ref().unwrap().value;
    let [w, x, y, z] = device.read(0.0).unwrap().pose.orientation;
    let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
    assert!(near(w, 0.2_f64.cos()) && near(x, 0.0) && near(y, 0.0) && near(z, 0.2_f64.sin()));
    device.write(&Command { force_n: [0.0; 3], torque_nm: [0.0, 0.0, 9.0] }).unwrap();
    assert_eq!(library.take_log().last().unwrap(), &format!("force(0, 0, 0, 0, 0, {most}, 0, 5)"));
    // What is no rotation is not passed on as one.
    library.set("frame_scale", -1.0);
    assert_eq!(device.read(0.0), Err(Fault::Garbled));
}

#[test]
fn limits() {
    let library = LIBRARY.copy();
    let mut device = opened(&library);
    assert_eq!(device.capabilities().max_force_n.value, 12.0);
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.0, 50.0])).unwrap();
    assert_eq!(library.take_log().last().unwrap(), "force(0, 0, 12, 0, 0, 0, 0, 5)");
    assert!(device.read(0.0).unwrap().status.saturated);
    device.write(&push([0.0, 0.0, 1.0])).unwrap();
    assert!(!device.read(0.0).unwrap().status.saturated);
    for wild in [f64::NAN, f64::INFINITY] {
        device.write(&push([wild, 1.0, 1.0])).unwrap();
        assert_eq!(library.take_log().last().unwrap(), NOTHING);
    }
    // An omega has no driven wrist.
    device.write(&Command { force_n: [0.0; 3], torque_nm: [1.0; 3] }).unwrap();
    assert_eq!(library.take_log().last().unwrap(), NOTHING);
}

#[test]
fn the_user_sets_limit_watchdog_and_weight() {
    let library = LIBRARY.copy();
    let chosen = DhdOptions {
        max_force_n: Some(1.0),
        watchdog_s: 0.001,
        gravity_compensation: false,
        ..options(&library)
    };
    let mut device = Dhd::new(chosen);
    device.open().unwrap();
    assert_eq!(library.take_log()[3..], ["watchdog(8, 5)", "gravity(0, 5)", "max_force(1, 5)"]);
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.0, 5.0])).unwrap();
    assert_eq!(library.take_log().last().unwrap(), "force(0, 0, 1, 0, 0, 0, 0, 5)");
    for (watchdog_s, steps) in [(9.0, 255), (0.0, 1)] {
        Dhd::new(DhdOptions { watchdog_s, ..options(&library) }).open().unwrap();
        assert!(library.take_log().contains(&format!("watchdog({steps}, 5)")));
    }
    let wrong = DhdOptions { max_force_n: Some(-1.0), ..options(&library) };
    let error = Dhd::new(wrong).open().unwrap_err().to_string();
    assert!(error.contains("largest force is -1 N"), "{error}");
    assert!(library.take_log().is_empty());
}

/// Each model with the table's figures, and a stranger with the smallest.
#[test]
fn models() {
    let library = LIBRARY.copy();
    for (name, expected, most) in [
        (0, "omega.3", 12.0),
        (1, "sigma.7", 12.0),
        (2, "delta.3", 20.0),
        (3, "lambda.7", 12.0),
        (4, "FALCON", 8.0),
    ] {
        library.set("name", f64::from(name));
        let device = opened(&library);
        let c = device.capabilities();
        assert_eq!((c.name.as_ref(), c.max_force_n.value), (expected, most));
        assert!(matches!(c.max_force_n.basis, Basis::Stated(_)));
    }
    for name in [5.0, 99.0] {
        library.set("name", name);
        let device = opened(&library);
        let most = &device.capabilities().max_force_n;
        assert_eq!(most.value, 8.0);
        assert!(matches!(most.basis, Basis::Guessed(_)));
    }
}

/// 1 and 2 are no errors: nothing new, and motors at their limit.
#[test]
fn time_guard_and_saturation_are_no_errors() {
    let library = LIBRARY.copy();
    let mut device = opened(&library);
    assert_eq!(device.read(0.0).unwrap().sequence, 1);
    library.set("position", 1.0);
    assert_eq!(device.read(0.0).unwrap().sequence, 1);
    library.set("position", 0.0);
    assert_eq!(device.read(0.0).unwrap().sequence, 2);
    library.set("force", 2.0);
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    assert!(device.read(0.0).unwrap().status.saturated);
    library.set("force", 1.0);
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    assert!(!device.read(0.0).unwrap().status.saturated);
}

#[test]
fn errors_by_their_numbers() {
    let library = LIBRARY.copy();
    let mut device = opened(&library);
    device.read(0.0).unwrap();
    for (number, fault) in
        [(2.0, Fault::Disconnected), (7.0, Fault::TimedOut), (8.0, Fault::Code(8)), (0.0, Fault::Code(-1))]
    {
        library.set("error", number);
        library.set("position", -1.0);
        assert_eq!(device.read(0.0), Err(fault));
        library.set("position", 0.0);
        for call in ["enable", "force"] {
            library.set(call, -1.0);
            assert_eq!(device.write(&push([1.0, 0.0, 0.0])), Err(fault), "{call}");
            library.set(call, 0.0);
        }
    }
    library.set("error", 2.0);
    library.set("position", -1.0);
    let fault = device.read(0.0).unwrap_err();
    assert_eq!(device.explain(fault), "the device is gone (communication error)");
}

/// Gone in the middle of a press, with every call failing: no force, disabled, closed are still tried, each.
#[test]
fn a_disconnect_in_mid_press() {
    let library = LIBRARY.copy();
    let mut device = pressing(&library);
    for call in ["position", "force", "enable", "close"] {
        library.set(call, -1.0);
    }
    library.set("error", 2.0);
    assert_eq!(device.read(0.001), Err(Fault::Disconnected));
    assert_eq!(device.write(&push([0.0; 3])), Err(Fault::Disconnected));
    library.take_log();
    drop(device);
    assert_eq!(library.take_log(), END);
}

#[test]
fn a_panic_in_mid_press() {
    let library = LIBRARY.copy();
    let mut device = pressing(&library);
    let caught = catch_unwind(AssertUnwindSafe(move || {
        device.read(0.001).unwrap();
        panic!("the loop fell over");
    }));
    assert!(caught.is_err());
    let log = library.take_log();
    assert_eq!(log[log.len() - 3..], END);
}

/// Poses that are NaN or infinite are faults, and don't count as the first good one.
#[test]
fn no_numbers() {
    let library = LIBRARY.copy();
    library.set("y", f64::NAN);
    let mut device = opened(&library);
    assert_eq!(device.read(0.0), Err(Fault::Garbled));
    library.take_log();
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    assert!(library.take_log().is_empty());
    library.set("y", 0.0);
    assert!(device.read(0.0).is_ok());
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    assert_eq!(library.take_log().len(), 4);
}

#[test]
fn one_of_several() {
    let library = LIBRARY.copy();
    library.set("count", 2.0);
    let mut second = Dhd::new(DhdOptions { index: Some(1), ..options(&library) });
    second.open().unwrap();
    assert_eq!(library.take_log()[1..5], ["open(1)", "expert()", "watchdog(160, 6)", "gravity(1, 6)"]);
    second.close();
    assert_eq!(library.take_log().last().unwrap(), "close(6)");
    let error = Dhd::new(DhdOptions { index: Some(2), ..options(&library) }).open().unwrap_err().to_string();
    assert!(error.contains("device 2 was asked for, and there are 2"), "{error}");
}

#[test]
fn what_is_missing_is_said() {
    let library = LIBRARY.copy();
    library.set("count", 0.0);
    let error = Dhd::new(options(&library)).open().unwrap_err().to_string();
    assert!(error.contains("no Force Dimension device") && error.contains("1451"), "{error}");
    assert_eq!(library.take_log(), ["count()"]);
    library.set("count", 1.0);
    library.set("open", -1.0);
    let error = Dhd::new(options(&library)).open().unwrap_err().to_string();
    assert!(error.contains("doesn't open: device error"), "{error}");
    // What was not opened is not closed.
    assert_eq!(library.take_log(), ["count()", "open(0)"]);
    library.set("open", 300.0);
    assert!(Dhd::new(options(&library)).open().is_err());

    let error = Dhd::new(DhdOptions::default()).open().unwrap_err();
    assert!(error.problem.contains("libd") || error.problem.contains("dhd64"), "{error}");
    assert!(error.hint.contains("SDK") && error.hint.contains("--device-library"), "{error}");
    let nowhere = library.file.with_file_name("nowhere.so");
    let error = Dhd::new(DhdOptions { library: Some(nowhere), ..DhdOptions::default() }).open().unwrap_err();
    assert!(error.problem.contains("nowhere.so"), "{error}");
}

/// What it refuses is told, and is no reason to stop.
#[test]
fn refused_settings_are_noted() {
    let library = LIBRARY.copy();
    let device = opened(&library);
    assert!(device.notes().is_empty());
    drop(device);
    library.set("gravity", -1.0);
    library.set("reset", 1.0);
    let device = opened(&library);
    assert!(device.notes()[0].contains("weight: device error"), "{:?}", device.notes());
    assert!(device.notes()[1].contains("not calibrated"), "{:?}", device.notes());
    assert_eq!(device.notes().len(), 2);
}

/// A limit above the model's does not lift it.
#[test]
fn a_users_limit_only_lowers_the_models() {
    let library = LIBRARY.copy();
    let mut device = Dhd::new(DhdOptions { max_force_n: Some(50.0), ..options(&library) });
    device.open().unwrap();
    assert!(library.take_log().contains(&"max_force(12, 5)".into()));
    assert_eq!(device.capabilities().max_force_n.value, 12.0);
}

/// Refused, forgotten, or taken for another time: without it nothing would take the force off when the program hangs.
#[test]
fn a_device_whose_watchdog_is_not_armed_is_refused_unless_it_was_asked_for() {
    for (setting, value, words) in [
        ("watchdog", -1.0, "device error"),
        ("expert", -1.0, "device error"),
        ("watchdog_takes", 0.0, "is at 0"),
    ] {
        let library = LIBRARY.copy();
        library.set(setting, value);
        let error = Dhd::new(options(&library)).open().unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("--without-device-watchdog"), "{error}");
        // It was open, and nothing is left behind.
        let log = library.take_log();
        assert_eq!(log[log.len() - 3..], END);
        let mut device = Dhd::new(DhdOptions { watchdog_required: false, ..options(&library) });
        device.open().unwrap();
        assert!(device.notes()[0].contains("nothing takes the force off"), "{:?}", device.notes());
    }
}

/// A period of a loop at this time that wants `force`, N upwards: whether the device was idle, and what it rendered after.
fn period(library: &StandIn, device: &mut Dhd, now_s: f64, force: f64) -> (bool, f64) {
    library.set("now", now_s);
    let idle = device.read(now_s).unwrap().status.idle;
    device.write(&push([0.0, 0.0, force])).unwrap();
    (idle, library.rendered()[2])
}

/// The loop is silent: the firmware disables forces. A loop that goes on as if nothing had been gets no force until it has
/// commanded zero: else the hand, which has sunk in, would be met with all of it at once.
#[test]
fn a_silent_loop() {
    let library = LIBRARY.copy();
    let mut device = Dhd::new(options(&library));
    device.open().unwrap();
    assert_eq!(period(&library, &mut device, 3.0, 2.0), (false, 2.0));
    assert_eq!(period(&library, &mut device, 3.019, 2.0), (false, 2.0));
    library.set("now", 3.0395);
    assert_eq!(library.rendered()[2], 0.0);
    library.take_log();
    for k in 0..10 {
        assert_eq!(period(&library, &mut device, 3.04 + f64::from(k) * 1e-3, 2.0), (true, 0.0));
    }
    assert!(!library.take_log().iter().any(|call| call.starts_with("enable")));
    assert_eq!(period(&library, &mut device, 3.05, 0.0), (true, 0.0));
    let log = library.take_log();
    assert!(log.ends_with(&[NOTHING.into(), "enable(1, 5)".into(), NOTHING.into()]), "{log:?}");
    assert_eq!(period(&library, &mut device, 3.051, 0.5), (false, 0.5));
    // An older library does not say what it was: the silence does.
    library.set("cause", -1.0);
    assert_eq!(period(&library, &mut device, 3.09, 2.0), (true, 0.0));
    assert_eq!(period(&library, &mut device, 3.091, 0.0), (true, 0.0));
    assert_eq!(period(&library, &mut device, 3.092, 0.5), (false, 0.5));
}

/// Forces that somebody switched off by the button are that somebody's to switch on.
#[test]
fn forces_switched_off_by_hand_are_not_switched_on_by_the_driver() {
    let library = LIBRARY.copy();
    let mut device = pressing(&library);
    library.set("forces_on", 0.0);
    assert!((0..20).any(|_| period(&library, &mut device, 0.0, 2.0).0));
    library.take_log();
    for _ in 0..40 {
        assert_eq!(period(&library, &mut device, 0.0, 0.0), (true, 0.0));
    }
    assert!(!library.take_log().iter().any(|call| call.starts_with("enable")));
    // Switched on between two reads it has no force either, whatever was wanted meanwhile.
    device.write(&push([0.0, 0.0, 2.0])).unwrap();
    library.set("forces_on", 1.0);
    assert_eq!(library.rendered()[2], 0.0);
    assert_eq!(period(&library, &mut device, 0.0, 0.0), (false, 0.0));
    assert_eq!(period(&library, &mut device, 0.0, 0.1), (false, 0.1));

    // The watchdog was first, and then somebody's hand.
    assert_eq!(period(&library, &mut device, 0.1, 2.0), (true, 0.0));
    library.set("cause", 1.0);
    library.take_log();
    for k in 0..5 {
        assert_eq!(period(&library, &mut device, 0.101 + f64::from(k) * 1e-3, 0.0), (true, 0.0));
    }
    assert!(!library.take_log().iter().any(|call| call.starts_with("enable")));
}

/// From the loop's thread, as a panic's hook calls it, at once; from another with the next write. What is written afterwards
/// is not rendered; once closed nothing is called any more.
#[test]
fn an_emergency_stop() {
    let library = LIBRARY.copy();
    let mut device = pressing(&library);
    let stop = device.emergency_stop().unwrap();
    stop.stop();
    assert_eq!(library.take_log(), [NOTHING]);
    device.write(&push([0.0, 0.0, 2.0])).unwrap();
    assert_eq!(library.take_log(), [NOTHING]);
    device.close();
    library.take_log();
    stop.stop();
    assert!(library.take_log().is_empty() && device.emergency_stop().is_none());

    let mut device = pressing(&library);
    let stop = device.emergency_stop().unwrap();
    std::thread::spawn(move || stop.stop()).join().unwrap();
    assert!(library.take_log().is_empty());
    device.write(&push([0.0, 0.0, 2.0])).unwrap();
    assert_eq!(library.take_log(), [NOTHING]);
}

/// A thread of the vendor's may still run in it.
#[cfg(target_os = "linux")]
#[test]
fn the_vendors_library_stays_in_memory_when_the_device_is_closed() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let own = folder.path().join("libown.so");
    std::fs::copy(LIBRARY.file(), &own).unwrap();
    let mut device = Dhd::new(DhdOptions { library: Some(own.clone()), ..DhdOptions::default() });
    device.open().unwrap();
    drop(device);
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    assert!(maps.contains(own.to_str().unwrap()));
}
