//! A panic while the tool is pressed in: the device has zero force before a word of the panic is written, be it in the haptic
//! thread or in another. A hook is the process', so this is a test program of its own.

mod common;

use common::plane;
use glam::DVec3;
use palpate_device::simulated::{Move, Script};
use palpate_device::{
    Capabilities, Command, Device, EmergencyStop, Fault, OpenError, Sample, Simulated, presets,
};
use palpate_engine::Contact;
use palpate_runtime::{
    End, HapticLoop, Opened, Patience, RealTime, Report, Safety, Session, Settings, WorkspaceMap, ring,
};
use std::panic;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// What the motors render, N.
#[derive(Debug, Default)]
struct Motors {
    force: Mutex<DVec3>,
    stopped: AtomicBool,
    panics: AtomicBool,
}

impl EmergencyStop for Motors {
    fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        *self.force.lock().unwrap() = DVec3::ZERO;
    }
}

struct Rigged(Simulated, Arc<Motors>);

impl Device for Rigged {
    fn capabilities(&self) -> &Capabilities {
        self.0.capabilities()
    }
    fn open(&mut self) -> Result<(), OpenError> {
        self.0.open()
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        assert!(!self.1.panics.load(Ordering::SeqCst), "the driver has a bug");
        self.0.read(now_s)
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        if !self.1.stopped.load(Ordering::SeqCst) {
            *self.1.force.lock().unwrap() = DVec3::from_array(command.force_n);
        }
        self.0.write(command)
    }
    fn close(&mut self) {
        *self.1.force.lock().unwrap() = DVec3::ZERO;
        self.0.close();
    }
    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        Some(self.1.clone())
    }
}

/// A session that presses, with a hook as a program installs it, whose words go nowhere until `read` is dropped.
fn pressing() -> (Session, Arc<Motors>, Receiver<f64>, std::sync::mpsc::Sender<()>) {
    let moves = [Move::Press { depth_m: 6e-3, seconds: 0.1 }, Move::Press { depth_m: 6e-3, seconds: 100.0 }];
    let script = Script::new(DVec3::ZERO, 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let motors = Arc::new(Motors::default());
    let device =
        Rigged(Simulated::new(presets::device("touch").unwrap(), hand, Box::new(script)), motors.clone());
    let body = Arc::new(plane(600.0, 500.0, 0.2));
    let safety = Safety { soft_start_s: 0.05, silence_s: Some(1.0), ..Safety::default() };
    let stages = safety.stages(device.capabilities(), 1000.0).unwrap();
    let haptics = HapticLoop::new(Contact::new(&body), WorkspaceMap::default(), stages);
    let settings = Settings {
        real_time: RealTime { priority: None, core: None, lock_memory: true, spin_s: 0.0 },
        patience: Patience { late_s: 5.0, finder_s: 5.0, pose_s: 5.0, ..Patience::default() },
        ..Settings::new(1000.0)
    };
    let (recorder, _records) = ring(4000);
    let opened = Opened::new(Box::new(device)).unwrap();
    let prepared = Session::prepare(body, opened, haptics, recorder, settings).unwrap();
    let (stopper, seen_by) = (prepared.stopper(), motors.clone());
    let (saw, seen) = channel();
    let (read, unread) = channel::<()>();
    let (saw, unread) = (Mutex::new(saw), Mutex::new(unread));
    panic::set_hook(Box::new(move |_| {
        stopper.stop_at_once("a panic");
        saw.lock().unwrap().send(seen_by.force.lock().unwrap().length()).unwrap();
        // Standard error, of which nobody reads.
        let _ = unread.lock().unwrap().recv_timeout(Duration::from_secs(20));
    }));
    let session = prepared.start().unwrap();
    let begun = Instant::now();
    while motors.force.lock().unwrap().length() < 0.5 {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing is touched");
        std::thread::sleep(Duration::from_millis(1));
    }
    (session, motors, seen, read)
}

fn ended(session: Session) -> Report {
    let report = session.join();
    let _ = panic::take_hook();
    report
}

#[test]
fn a_panic_anywhere_brings_zero_force_before_a_word_is_written() {
    // In the haptic thread, which stands in the middle of its panic.
    let (session, motors, seen, read) = pressing();
    motors.panics.store(true, Ordering::SeqCst);
    assert_eq!(seen.recv_timeout(Duration::from_secs(60)), Ok(0.0));
    std::thread::sleep(Duration::from_millis(50));
    assert!(!session.is_over() && *motors.force.lock().unwrap() == DVec3::ZERO);
    drop(read);
    assert_eq!(ended(session).end, End::Panic("the driver has a bug".into()));

    // In another thread: the haptic thread closes the device, while that one still stands there.
    let (session, motors, seen, read) = pressing();
    let other = std::thread::spawn(|| panic!("another bug"));
    assert_eq!(seen.recv_timeout(Duration::from_secs(60)), Ok(0.0));
    let begun = Instant::now();
    while !session.is_over() {
        assert!(begun.elapsed() < Duration::from_secs(60), "the loop goes on");
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(!other.is_finished() && *motors.force.lock().unwrap() == DVec3::ZERO);
    drop(read);
    assert!(other.join().is_err());
    assert_eq!(ended(session).end, End::Emergency("a panic"));
}
