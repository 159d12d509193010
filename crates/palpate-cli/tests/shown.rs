//! A session that something shows, such as a window: whatever becomes of that, and of signals meanwhile, the force is brought to zero and
//! the device is closed. The window is played by a function here, so that no display is needed.

mod common;

use anyhow::anyhow;
use common::TestDirectory;
use glam::DVec3;
use palpate_cli::commands::Failure;
use palpate_cli::live::{self, Told};
use palpate_device::{Capabilities, Command, Device, EmergencyStop, Fault, OpenError, Sample, presets};
use palpate_runtime::motion::MotionScript;
use palpate_runtime::{
    HeldDevice, LiveSession, Outcome, Patience, PreparedSession, RealTime, Safety, SessionBody,
    SessionConfig, WorkspaceSettings,
};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// What the motors were commanded, and what became of the device.
#[derive(Debug, Default)]
struct Motors {
    forces: Mutex<Vec<DVec3>>,
    stopped: AtomicBool,
    closed: AtomicBool,
}

/// Names a file that gets a device's last force when it is closed, and makes the test's program one that is ended in mid-press.
const ENDED: &str = "PALPATE_TEST_ENDED";

impl EmergencyStop for Motors {
    fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        self.forces.lock().unwrap().push(DVec3::ZERO);
    }
}

impl Motors {
    fn presses(&self) -> bool {
        self.forces.lock().unwrap().last().is_some_and(|force| force.length() > 0.3)
    }
}

struct Felt(Box<dyn Device>, Arc<Motors>);

impl Device for Felt {
    fn capabilities(&self) -> &Capabilities {
        self.0.capabilities()
    }
    fn open(&mut self) -> Result<(), OpenError> {
        self.0.open()
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.0.read(now_s)
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        let force = DVec3::from_array(command.force_n);
        // As devices do it: what an emergency stop has switched off stays off.
        let force = if self.1.stopped.load(Ordering::SeqCst) { DVec3::ZERO } else { force };
        self.1.forces.lock().unwrap().push(force);
        self.0.write(command)
    }
    fn close(&mut self) {
        if let Some(file) = std::env::var_os(ENDED) {
            std::fs::write(file, format!("{:?}", self.1.forces.lock().unwrap().last())).unwrap();
        }
        self.1.closed.store(true, Ordering::SeqCst);
        self.0.close();
    }
    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        Some(self.1.clone())
    }
}

const INTENT: &str = "[start]\nclearance_mm = 0.5\n[[move]]\nkind = \"press\"\ndepth_mm = 6\nseconds = 0.15\n\
                      [[move]]\nkind = \"hold\"\nseconds = 600\n";

fn prepared(directory: &TestDirectory) -> (PreparedSession, Arc<Motors>) {
    let body = SessionBody::open(&directory.path("block.body"), None, None, false).unwrap();
    let motion = MotionScript::read(&directory.path("intent.toml")).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let held = HeldDevice::new(&*body.source, presets::device("touch").unwrap(), hand, &motion).unwrap();
    let config = SessionConfig {
        safety: Safety { soft_start_s: 0.05, silence_s: Some(1.0), ..Safety::default() },
        workspace: WorkspaceSettings {
            offset_m: Some(held.map.offset_m.to_array()),
            ..WorkspaceSettings::default()
        },
        patience: Patience { late_s: 10.0, pose_s: 10.0, finder_s: 10.0, ..Patience::default() },
        real_time: RealTime { priority: None, core: None, ..RealTime::default() },
        ..SessionConfig::default()
    };
    let motors = Arc::new(Motors::default());
    let device = Box::new(Felt(Box::new(held.device), motors.clone()));
    (PreparedSession::with_device(body, device, config, None).unwrap(), motors)
}

fn until(what: &str, is_so: impl Fn() -> bool) {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{what}: not within a minute");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Shows a session by a function that is given it once it presses; what came of it, and that the device has zero force and is closed.
fn shown(
    directory: &TestDirectory,
    is_asked: &(dyn Fn() -> bool + Sync),
    window: impl FnOnce(LiveSession, &Motors) -> anyhow::Result<Option<Outcome>>,
) -> Result<Option<Told>, Failure> {
    let (session, motors) = prepared(directory);
    let told = live::show(session, is_asked, |session| {
        let session = session.start()?;
        until("a press", || motors.presses());
        window(session, &motors)
    });
    assert!(motors.closed.load(Ordering::SeqCst));
    assert_eq!(motors.forces.lock().unwrap().last(), Some(&DVec3::ZERO));
    told
}

/// What a library does that finds its display gone: it ends the program, and asks nobody.
#[cfg(unix)]
#[test]
fn a_library_that_ends_the_program_leaves_no_force() {
    if std::env::var_os(ENDED).is_some() {
        let directory = TestDirectory::new(4);
        directory.write("intent.toml", INTENT);
        let _ = shown(&directory, &|| false, |_session, _| std::process::exit(7));
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("closed");
    let ended = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "a_library_that_ends_the_program_leaves_no_force"])
        .env(ENDED, &file)
        .output()
        .unwrap();
    assert_eq!(ended.status.code(), Some(7), "{ended:?}");
    assert_eq!(std::fs::read_to_string(&file).ok(), Some(format!("{:?}", Some(&DVec3::ZERO))));
}

/// One after the other: a panic's hook is the process'.
#[test]
fn whatever_becomes_of_the_window_the_force_is_zero_and_the_device_closed() {
    let directory = TestDirectory::new(4);
    directory.write("intent.toml", INTENT);

    // A signal, while the window is hidden and looks at nothing.
    let asked = AtomicBool::new(false);
    let is_asked = || asked.load(Ordering::SeqCst);
    let told = shown(&directory, &is_asked, |session, motors| {
        asked.store(true, Ordering::SeqCst);
        until("the end", || session.is_over());
        assert!(motors.closed.load(Ordering::SeqCst));
        Ok(Some(session.join()))
    });
    let told = told.unwrap().unwrap();
    assert_eq!((told.end.as_str(), told.well), ("a signal asked for it", true));

    // The window is closed.
    let told = shown(&directory, &|| false, |session, _| {
        session.stopper().stop("the window was closed");
        Ok(Some(session.join()))
    });
    assert_eq!(told.unwrap().unwrap().end, "the window was closed");

    // Its display is gone: the session is dropped.
    let told = shown(&directory, &|| false, |_session, _| Err(anyhow!("there is no display any more")));
    assert!(matches!(told, Err(Failure::Input(e)) if e.to_string() == "there is no display any more"));

    // It panics, and whoever writes the panic's words finds the force off.
    let found = Arc::new(Mutex::new(None));
    let (saw, felt) = (found.clone(), Arc::new(Mutex::new(None::<Arc<Motors>>)));
    let feels = felt.clone();
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let motors = feels.lock().unwrap().clone().unwrap();
        *saw.lock().unwrap() = Some((panic.to_string(), motors.stopped.load(Ordering::SeqCst)));
    }));
    let (session, motors) = prepared(&directory);
    *felt.lock().unwrap() = Some(motors.clone());
    let told = live::show(session, &|| false, |session| {
        let _session = session.start()?;
        until("a press", || motors.presses());
        panic!("the toolkit has a bug")
    });
    std::panic::set_hook(usual);
    assert!(matches!(told, Err(Failure::Loop(words)) if words.contains("a panic in this program")));
    let (words, stopped) = found.lock().unwrap().clone().unwrap();
    assert!(words.contains("the toolkit has a bug") && stopped);
    assert!(motors.closed.load(Ordering::SeqCst));
    assert_eq!(motors.forces.lock().unwrap().last(), Some(&DVec3::ZERO));

    // It never came up.
    let (session, motors) = prepared(&directory);
    assert!(live::show(session, &|| false, |_session| Ok(None)).unwrap().is_none());
    assert!(motors.closed.load(Ordering::SeqCst) && motors.forces.lock().unwrap().is_empty());
}
