//! A session's haptic thread allocates and frees nothing between its second period and its end, whatever the threads beside
//! it do: it is counted.

#![allow(unsafe_code, reason = "an allocator that counts is an unsafe trait")]

mod common;

use common::{shape, with_field};
use glam::DVec3;
use palpate_body::shape::Shape;
use palpate_body::{BodySource, SlipRule, StoredBody};
use palpate_device::simulated::{Move, Script};
use palpate_device::{Capabilities, Command, Device, Fault, OpenError, Sample, Simulated, presets};
use palpate_engine::{Ablation, Contact};
use palpate_runtime::{
    End, HapticLoop, Header, Opened, Patience, PreparedSession, RealTime, RecorderThread, RecordingFile,
    Safety, Session, SessionConfig, Settings, WorkspaceMap, WorkspaceSettings, ring,
};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

thread_local! {
    static WATCHED: Cell<bool> = const { Cell::new(false) };
}
static COUNTED: AtomicU64 = AtomicU64::new(0);
/// One loop is counted at a time.
static ALONE: std::sync::Mutex<()> = std::sync::Mutex::new(());

struct Counting;

fn count() {
    if WATCHED.get() {
        COUNTED.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Says when its thread is watched: from its second `read` to its last.
struct Watching {
    device: Simulated,
    until_s: f64,
    reads: u64,
    /// Boxes a number in this read, to see that it is counted.
    slip_at: Option<u64>,
}

impl Device for Watching {
    fn capabilities(&self) -> &Capabilities {
        self.device.capabilities()
    }
    fn open(&mut self) -> Result<(), OpenError> {
        self.device.open()
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.reads += 1;
        // The first is the preparation's, in another thread.
        WATCHED.set(self.reads > 2 && now_s < self.until_s);
        if self.slip_at == Some(self.reads) {
            drop(std::hint::black_box(Box::new(self.reads)));
        }
        self.device.read(now_s)
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        self.device.write(command)
    }
    fn close(&mut self) {
        WATCHED.set(false);
        self.device.close();
    }
}

#[test]
fn the_haptic_thread_of_a_session_allocates_and_frees_nothing() {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let mesh = shape(Shape::Sphere { radius_mm: 30.0 }, 0.7);
    let body = with_field(&mesh, 600.0, 500.0, 0.1, &|p| 1.0 + 0.3 * libm::sin(p.x * 90.0));
    let folder = tempfile::tempdir().unwrap();
    body.save(&folder.path().join("x.body")).unwrap();
    let body = Arc::new(StoredBody::open(&folder.path().join("x.body"), None).unwrap());
    for slip_at in [None, Some(100)] {
        COUNTED.store(0, Ordering::Relaxed);
        let moves = [
            Move::Press { depth_m: 5e-3, seconds: 0.1 },
            Move::Circle { radius_m: 5e-3, turns: 2.0, seconds: 1.0 },
            Move::Tap { depth_m: -8e-3, times: 3, seconds: 0.4 },
        ];
        let script = Script::new(DVec3::Z * 0.03, 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
        let (hand, _) = presets::hand("fingers").unwrap();
        let device = Simulated::new(presets::device("touch").unwrap(), hand, Box::new(script));
        let device = Watching { device, until_s: 1.4, reads: 0, slip_at };
        let stages = Safety::default().stages(device.capabilities(), 1000.0).unwrap();
        let haptics = HapticLoop::new(
            Contact::on(body.model_header(), body.model_header().slip(), Ablation::None),
            WorkspaceMap::default(),
            stages,
        );
        let (recorder, records) = ring(4000);
        let path = folder.path().join(format!("{slip_at:?}.rec"));
        let file = RecordingFile::create(&path, false, &Header::default()).unwrap();
        let recorder_thread = RecorderThread::start(records, Some(file), 1000.0).unwrap();
        let settings = Settings {
            seconds: Some(1.5),
            patch_elements: 200,
            real_time: RealTime { priority: None, core: None, lock_memory: true, spin_s: 0.0 },
            patience: Patience { late_s: 5.0, finder_s: 5.0, pose_s: 5.0, ..Patience::default() },
            ..Settings::new(1000.0)
        };
        let opened = Opened::new(Box::new(device)).unwrap();
        let report = Session::start(body.clone(), opened, haptics, recorder, settings).unwrap().join();
        let finished = recorder_thread.finish("");
        assert_eq!(report.end, End::Done);
        assert!(finished.trouble.is_none() && finished.summary.periods_in_contact > 300);
        // An allocation and its end.
        assert_eq!(COUNTED.load(Ordering::Relaxed), slip_at.map_or(0, |_| 2), "{slip_at:?}");
    }
}

/// Read a thousand times a second, and its inbox filled as often: limits, friction, slip rule, pauses, another body.
#[test]
fn an_observer_and_a_full_inbox_make_it_allocate_nothing_either() {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let mesh = shape(Shape::Sphere { radius_mm: 30.0 }, 0.7);
    let body = with_field(&mesh, 600.0, 500.0, 0.1, &|p| 1.0 + 0.3 * libm::sin(p.x * 90.0));
    COUNTED.store(0, Ordering::Relaxed);
    let moves = [
        Move::Press { depth_m: 5e-3, seconds: 0.1 },
        Move::Circle { radius_m: 5e-3, turns: 2.0, seconds: 1.4 },
    ];
    let script = Script::new(DVec3::Z * 0.03, 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let device = Simulated::new(presets::device("touch").unwrap(), hand, Box::new(script));
    let device = Box::new(Watching { device, until_s: 1.4, reads: 0, slip_at: None });
    let config = SessionConfig {
        seconds: Some(1.5),
        patch_elements: 200,
        safety: Safety { soft_start_s: 0.01, silence_s: Some(5.0), ..Safety::default() },
        workspace: WorkspaceSettings { offset_m: Some([0.0; 3]), ..WorkspaceSettings::default() },
        real_time: RealTime { priority: None, core: None, lock_memory: false, spin_s: 0.0 },
        patience: Patience { late_s: 5.0, finder_s: 5.0, pose_s: 5.0, ..Patience::default() },
        ..SessionConfig::default()
    };
    let prepared = PreparedSession::with_device(body.clone().into(), device, config, None).unwrap();
    let mut session = prepared.start().unwrap();
    let (mut read, mut taken, mut changed) = (0, 0, 0);
    for turn in 0u32.. {
        if session.is_over() {
            break;
        }
        read += u32::from(session.latest().is_some());
        let controls = session.controls().clone();
        let sent = match turn % 5 {
            0 => controls.set_force_limit(1.0 + f64::from(turn % 3), None),
            1 => controls.set_friction_scale(f64::from(turn % 4) * 0.5),
            2 => session.set_slip_rule(if turn % 2 == 0 { SlipRule::Exact } else { SlipRule::Paper }),
            3 => {
                controls.pause();
                Ok(())
            }
            _ => {
                controls.resume();
                Ok(())
            }
        };
        taken += u32::from(sent.is_ok());
        if turn % 20 == 19 {
            changed += u32::from(session.change_body(body.clone()).is_ok());
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let outcome = session.join();
    assert_eq!(outcome.report.end, End::Done);
    assert!(read > 50 && taken > 40 && changed > 2, "{read} {taken} {changed}");
    assert!(outcome.finished.summary.stages["changing"] > 40, "{:?}", outcome.finished.summary.stages);
    assert_eq!(COUNTED.load(Ordering::Relaxed), 0);
}

/// What an observer and an inbox, both at 1 kHz, do to a loop's times: percentiles of alternating runs, for a quiet machine.
/// `cargo test --release -p palpate-runtime --test session_allocation -- --ignored --nocapture`
#[test]
#[ignore = "a minute, and its figures need a quiet machine"]
fn times_with_and_without_an_observer() {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let body = with_field(&shape(Shape::Sphere { radius_mm: 30.0 }, 0.7), 600.0, 500.0, 0.1, &|_| 1.0);
    eprintln!("| run | observed | step p50 | p99 | p99.9 (µs) | lateness p50 | p99 | p99.9 (µs) |");
    for run in 0..12 {
        let observed = run % 2 == 1;
        let config = SessionConfig {
            device: "simulated:touch".parse().unwrap(),
            motion: "circle".into(),
            seconds: Some(5.0),
            safety: Safety { silence_s: Some(5.0), ..Safety::default() },
            ..SessionConfig::default()
        };
        let session = palpate_runtime::LiveSession::start(body.clone(), config).unwrap();
        let mut turn = 0u32;
        while !session.is_over() {
            if observed {
                std::hint::black_box(session.latest());
                let _ = session.controls().set_friction_scale(1.0);
                turn += 1;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        let summary = session.join().finished.summary;
        let us = |ns: u64| format!("{:.1}", ns as f64 * 1e-3);
        let (s, l) = (&summary.step_ns, &summary.lateness_ns);
        let figures = [s.p50, s.p99, s.p99_9, l.p50, l.p99, l.p99_9].map(us).join(" | ");
        eprintln!("| {run} | {} | {figures} |", if observed { format!("{turn} times") } else { "no".into() });
    }
}
