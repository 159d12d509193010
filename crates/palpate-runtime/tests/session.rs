//! The loop against the clock, with a simulated device that something happens to: the force stays bounded, goes to zero in
//! time, and the reason is said.

mod common;

use common::{Random, plane, shape, with_field};
use glam::DVec3;
use palpate_body::shape::Shape;
use palpate_body::{
    Body, BodySource, ContactModel, Extent, Patch, Potential, Response, SlipRule, StoredBody, Tensor,
};
use palpate_device::simulated::{Move, Script};
use palpate_device::{Capabilities, Command, Device, Fault, OpenError, Sample, Simulated, presets};
use palpate_engine::{Ablation, Contact, Flags};
use palpate_runtime::{
    End, Ending, HapticLoop, Header, Opened, Patience, RealTime, Record, RecorderThread, Recording,
    RecordingFile, Report, Retrace, Safety, Session, Settings, WorkspaceMap, ring,
};
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// What happens to the device, from `at_s` on.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mishap {
    None,
    Gone,
    NoNumbers,
    Frozen,
    Jumps,
    JumpsBack,
    ReadPanics,
    WritePanics,
    /// In the first command that lets go.
    FadePanics,
    Stalls,
    Unanswering,
}

/// A simulated device with a mishap, and a list of its commands.
struct Rigged {
    device: Simulated,
    mishap: Mishap,
    at_s: f64,
    now_s: f64,
    last: Sample,
    log: Arc<Mutex<Log>>,
    notes: Vec<String>,
}

#[derive(Debug, Default)]
struct Log {
    commands: Vec<(f64, DVec3)>,
    closed: bool,
}

impl Rigged {
    fn happens(&self, mishap: Mishap) -> bool {
        self.mishap == mishap && self.now_s >= self.at_s
    }
}

impl Device for Rigged {
    fn capabilities(&self) -> &Capabilities {
        self.device.capabilities()
    }
    fn open(&mut self) -> Result<(), OpenError> {
        self.device.open()
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.now_s = now_s;
        let mut sample = self.device.read(now_s)?;
        assert!(!self.happens(Mishap::ReadPanics), "the driver has a bug");
        if self.happens(Mishap::Stalls) {
            self.mishap = Mishap::None;
            std::thread::sleep(Duration::from_millis(300));
        }
        if self.happens(Mishap::Gone) {
            return Err(Fault::Disconnected);
        }
        if self.happens(Mishap::Unanswering) {
            return Err(Fault::TimedOut);
        }
        if self.happens(Mishap::Frozen) {
            return Ok(self.last);
        }
        if self.happens(Mishap::NoNumbers) {
            sample.pose.position_m[1] = f64::NAN;
        }
        if self.happens(Mishap::Jumps) {
            sample.pose.position_m[2] -= 0.1;
        }
        if self.happens(Mishap::JumpsBack) && self.now_s < self.at_s + AWAY {
            sample.pose.position_m[2] -= 0.5;
        }
        self.last = sample;
        Ok(sample)
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        assert!(!self.happens(Mishap::WritePanics), "the driver has a bug");
        let force = DVec3::from_array(command.force_n);
        let last = self.log.lock().unwrap().commands.last().map_or(DVec3::ZERO, |(_, last)| *last);
        if self.happens(Mishap::FadePanics) && force.length() < 0.8 * last.length() {
            self.mishap = Mishap::None;
            panic!("the driver has a bug");
        }
        if self.happens(Mishap::Gone) {
            return Err(Fault::Disconnected);
        }
        self.log.lock().unwrap().commands.push((self.now_s, DVec3::from_array(command.force_n)));
        self.device.write(command)
    }
    fn close(&mut self) {
        self.log.lock().unwrap().closed = true;
        self.device.close();
    }
    fn notes(&self) -> &[String] {
        &self.notes
    }
}

const HURT: f64 = 0.25;
/// A jump of half a metre that comes back does so after this, s: long before it could have been a motion.
const AWAY: f64 = 8e-3;

fn rigged(mishap: Mishap, place: DVec3) -> (Rigged, Arc<Mutex<Log>>) {
    let moves = [
        Move::Press { depth_m: 6e-3, seconds: 0.1 },
        Move::Drag { along_m: 0.03, across_m: 0.0, seconds: 0.6 },
    ];
    let script = Script::new(place, 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let device = Simulated::new(presets::device("touch").unwrap(), hand, Box::new(script));
    let log = Arc::new(Mutex::new(Log::default()));
    (
        Rigged {
            device,
            mishap,
            at_s: HURT,
            now_s: 0.0,
            last: Sample::default(),
            log: log.clone(),
            notes: Vec::new(),
        },
        log,
    )
}

/// As on any machine: no rights are asked for, and load beside is forgiven.
fn settings(seconds: f64) -> Settings {
    Settings {
        seconds: Some(seconds),
        real_time: RealTime { priority: None, own_core: false, spin_s: 0.0 },
        patience: Patience { late_s: 5.0, finder_s: 5.0, ..Patience::default() },
        ..Settings::new(1000.0)
    }
}

fn haptics(model: &ContactModel, device: &Capabilities) -> HapticLoop {
    // A busy machine leaves periods out; what that does to the force is tested in virtual time.
    let safety = Safety { soft_start_s: 0.05, silence_s: Some(1.0), ..Safety::default() };
    let stages = safety.stages(device, 1000.0).unwrap();
    HapticLoop::new(Contact::on(model, model.slip(), Ablation::None), WorkspaceMap::default(), stages)
}

fn run<B: BodySource + 'static>(body: &Arc<B>, device: Rigged, settings: Settings) -> Report {
    let haptics = haptics(body.model_header(), device.capabilities());
    let (recorder, _records) = ring(4000);
    Session::start(body.clone(), Opened::new(Box::new(device)).unwrap(), haptics, recorder, settings)
        .unwrap()
        .join()
}

fn ball(edge_length_mm: f64) -> Arc<Body> {
    let mesh = shape(Shape::Sphere { radius_mm: 30.0 }, edge_length_mm);
    Arc::new(with_field(&mesh, 600.0, 500.0, 0.1, &|p| 1.0 + 0.3 * libm::sin(p.x * 90.0)))
}

/// No force beyond the limit, no step beyond half of it but to zero, and closed at the end.
fn checked(log: &Mutex<Log>) -> Vec<(f64, DVec3)> {
    let log = log.lock().unwrap();
    assert!(log.closed);
    let mut last = DVec3::ZERO;
    for (t, force) in &log.commands {
        let way = if *force == DVec3::ZERO { 0.0 } else { force.distance(last) };
        assert!(force.length() <= 3.0 && way <= 1.5 + 1e-9, "{t}: {last} {force}");
        last = *force;
    }
    log.commands.clone()
}

#[test]
fn whatever_happens_to_the_device_the_force_ends_in_time_and_the_reason_is_said() {
    let body = Arc::new(plane(600.0, 500.0, 0.2));
    for mishap in [
        Mishap::None,
        Mishap::Gone,
        Mishap::NoNumbers,
        Mishap::Frozen,
        Mishap::Jumps,
        Mishap::JumpsBack,
        Mishap::ReadPanics,
        Mishap::WritePanics,
        Mishap::Unanswering,
    ] {
        let (device, log) = rigged(mishap, DVec3::ZERO);
        let report = run(&body, device, settings(0.5));
        let commands = checked(&log);
        let touched = commands.iter().filter(|(t, f)| *t < HURT && f.length() > 0.1).count();
        assert!(touched > 20, "{mishap:?}: {touched}");
        match mishap {
            Mishap::None | Mishap::NoNumbers | Mishap::Jumps | Mishap::JumpsBack => {
                assert_eq!(report.end, End::Done);
            }
            Mishap::Gone => assert_eq!(report.end, End::Device("the device is gone".into())),
            Mishap::Unanswering => {
                assert_eq!(report.end, End::Device("the device did not answer in time".into()))
            }
            Mishap::Frozen => assert!(matches!(report.end, End::Stale(s) if s < 0.5), "{:?}", report.end),
            Mishap::ReadPanics | Mishap::WritePanics => {
                assert_eq!(report.end, End::Panic("the driver has a bug".into()));
            }
            Mishap::Stalls | Mishap::FadePanics => {}
        }
        assert_eq!(report.end.is_well(), report.end == End::Done);
        // A device that can't be told anything more keeps its last command, or what its own watchdog makes of it.
        if !matches!(mishap, Mishap::Gone | Mishap::WritePanics) {
            assert_eq!(commands.last().unwrap().1, DVec3::ZERO, "{mishap:?}");
        }
        // By the second period.
        let mut after = commands.iter().filter(|(t, _)| *t >= HURT).skip(1);
        match mishap {
            Mishap::NoNumbers | Mishap::Unanswering => {
                assert!(after.all(|(_, f)| *f == DVec3::ZERO), "{mishap:?}");
            }
            // Away for less than a motion takes: nothing is felt there, and the force ramps up again where it was.
            Mishap::JumpsBack => {
                let mut away = after.take_while(|(t, _)| *t < HURT + AWAY);
                assert!(away.all(|(_, f)| *f == DVec3::ZERO), "{commands:?}");
                let back = commands.iter().filter(|(t, f)| *t > HURT + 0.1 && f.length() > 0.1).count();
                assert!(back > 20, "{back}");
            }
            _ => {}
        }
    }
}

#[test]
fn a_late_loop_ends_with_zero_force() {
    let body = Arc::new(plane(600.0, 500.0, 0.2));
    let (device, log) = rigged(Mishap::Stalls, DVec3::ZERO);
    let patience = Patience { late_s: 0.2, ..settings(0.0).patience };
    let report = run(&body, device, Settings { patience, ..settings(2.0) });
    assert!(matches!(report.end, End::Late(s) if s > 0.2), "{:?}", report.end);
    assert_eq!(checked(&log).last().unwrap().1, DVec3::ZERO);
}

#[test]
fn a_finder_that_stalls_is_waited_for_and_one_that_is_silent_ends_the_loop() {
    let body = ball(0.7);
    let top = DVec3::new(0.0, 0.0, 0.03);
    let stalled = Settings { finder_pause_s: 0.5, patch_elements: 64, ..settings(0.7) };
    let (device, log) = rigged(Mishap::None, top);
    let report = run(&body, device, stalled);
    assert_eq!(report.end, End::Done);
    let fenced = report.haptics.unwrap().contact().counters().fenced;
    assert!(fenced > 0, "{fenced}");
    checked(&log);
    let (device, log) = rigged(Mishap::None, top);
    let patience = Patience { finder_s: 0.1, ..stalled.patience };
    let report = run(&body, device, Settings { finder_pause_s: 0.4, patience, ..stalled });
    assert!(matches!(report.end, End::FinderSilent(_)), "{:?}", report.end);
    assert_eq!(checked(&log).last().unwrap().1, DVec3::ZERO);
}

/// A body whose next patch takes long, as one on a slow disk, and says now and then that something has come, or nothing.
#[derive(Debug)]
struct Slow {
    body: Arc<Body>,
    each_s: f64,
    beats: usize,
    silent_s: f64,
}

impl BodySource for Slow {
    fn model_header(&self) -> &ContactModel {
        self.body.model_header()
    }
    fn element_count(&self) -> usize {
        self.body.element_count()
    }
    fn serves(&self, rule: SlipRule) -> palpate_body::Result<()> {
        self.body.serves(rule)
    }
    fn take(
        &self,
        patch: &mut Patch,
        centre: [f64; 3],
        count: usize,
        beat: &dyn Fn(),
    ) -> palpate_body::Result<()> {
        if centre[0] != 0.0 {
            for _ in 0..self.beats {
                std::thread::sleep(Duration::from_secs_f64(self.each_s));
                beat();
            }
            std::thread::sleep(Duration::from_secs_f64(self.silent_s));
        }
        BodySource::take(&*self.body, patch, centre, count, beat)
    }
    fn extent(&self) -> Extent {
        self.body.extent()
    }
    fn first_touch(&self, from: DVec3, to: DVec3) -> palpate_body::Result<Option<DVec3>> {
        BodySource::first_touch(&*self.body, from, to)
    }
    fn nearest(&self, p: DVec3) -> palpate_body::Result<[DVec3; 2]> {
        BodySource::nearest(&*self.body, p)
    }
    fn each_potential(&self, visit: &mut dyn FnMut(&Potential)) -> palpate_body::Result<()> {
        self.body.each_potential(visit)
    }
    fn each_response(&self, visit: &mut dyn FnMut(&Response)) -> palpate_body::Result<()> {
        self.body.each_response(visit)
    }
    fn each_tensor(&self, visit: &mut dyn FnMut(&Tensor, DVec3)) -> palpate_body::Result<()> {
        self.body.each_tensor(visit)
    }
    fn unlock_memory(&self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_slow_disk_is_waited_for_and_nobody_waits_for_one_that_hangs() {
    let patience = Patience { finder_s: 0.3, ..settings(0.0).patience };
    let settings = Settings { patch_elements: 64, patience, ..settings(0.9) };
    // Twice as long as the finder may be silent.
    let slow = Arc::new(Slow { body: ball(0.7), each_s: 0.02, beats: 30, silent_s: 0.0 });
    let (device, log) = rigged(Mishap::None, DVec3::new(0.0, 0.0, 0.03));
    let report = run(&slow, device, settings);
    assert_eq!(report.end, End::Done);
    assert!(report.haptics.unwrap().contact().counters().fenced > 50);
    checked(&log);

    let hanging = Arc::new(Slow { body: ball(0.7), each_s: 0.0, beats: 1, silent_s: 20.0 });
    let (device, log) = rigged(Mishap::None, DVec3::new(0.0, 0.0, 0.03));
    let begun = std::time::Instant::now();
    let report = run(&hanging, device, settings);
    assert!(matches!(report.end, End::FinderSilent(_)), "{:?}", report.end);
    assert!(begun.elapsed() < Duration::from_secs(10), "the end waited for the disk");
    assert_eq!(checked(&log).last().unwrap().1, DVec3::ZERO);
}

#[test]
fn a_panic_on_the_way_to_zero_leaves_zero_force_and_a_closed_device() {
    let (device, log) = rigged(Mishap::FadePanics, DVec3::ZERO);
    let report = run(&Arc::new(plane(600.0, 500.0, 0.2)), device, settings(0.3));
    assert_eq!(report.end, End::Panic("the driver has a bug".into()));
    let log = log.lock().unwrap();
    assert!(log.closed && log.commands.last().unwrap().1 == DVec3::ZERO, "{:?}", log.commands.last());
    assert!(log.commands.iter().any(|(_, force)| force.length() > 0.3));
}

#[test]
fn a_body_that_is_left_in_its_file_for_another_slip_rule_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    ball(2.0).save(&path).unwrap();
    let body = Arc::new(StoredBody::open(&path, Some(SlipRule::Paper)).unwrap());
    let (device, log) = rigged(Mishap::None, DVec3::ZERO);
    let mut haptics = haptics(body.model_header(), device.capabilities());
    *haptics.contact_mut() = Contact::on(body.model_header(), SlipRule::Consistent, Ablation::None);
    let (recorder, _records) = ring(10);
    let opened = Opened::new(Box::new(device)).unwrap();
    let error =
        Session::start(body.clone(), opened, haptics, recorder, settings(0.1)).unwrap_err().to_string();
    assert!(error.contains("x.body") && error.contains("StoredBody::open"), "{error}");
    assert!(log.lock().unwrap().closed);
    // And it is no worse for it.
    body.take(&mut body.patch(), [0.0, 0.0, 0.03], 100, &|| ()).unwrap();
}

#[test]
fn a_body_that_is_cut_or_changed_in_its_file_ends_the_loop() {
    use std::io::{Seek, SeekFrom, Write};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    let cut = |file: &mut std::fs::File| file.set_len(1000).unwrap();
    let change = |file: &mut std::fs::File| {
        file.seek(SeekFrom::End(-64)).unwrap();
        file.write_all(&[0xff; 64]).unwrap();
    };
    let all = |file: &mut std::fs::File| {
        let length = file.metadata().unwrap().len() as usize;
        file.write_all(&vec![0xff; length]).unwrap();
    };
    // One that is replaced is still there for who has opened it.
    let replace = |_: &mut std::fs::File| {
        std::fs::write(folder.path().join("other"), b"no body").unwrap();
        std::fs::rename(folder.path().join("other"), &path).unwrap();
    };
    type OfFile<'a> = &'a dyn Fn(&mut std::fs::File);
    let changed = Some("changed while");
    let mishaps: [(OfFile, _); 4] =
        [(&cut, Some("cut short while")), (&change, changed), (&all, changed), (&replace, None)];
    for (mishap, words) in mishaps {
        ball(0.7).save(&path).unwrap();
        let body = Arc::new(StoredBody::open(&path, Some(SlipRule::Paper)).unwrap());
        let (device, log) = rigged(Mishap::None, DVec3::new(0.0, 0.0, 0.03));
        let haptics = haptics(body.model_header(), device.capabilities());
        let (recorder, _records) = ring(4000);
        let settings = Settings { patch_elements: 64, ..settings(0.7) };
        let opened = Opened::new(Box::new(device)).unwrap();
        let session = Session::start(body, opened, haptics, recorder, settings).unwrap();
        while log.lock().unwrap().commands.last().is_none_or(|(_, f)| f.length() < 0.1) {
            std::thread::sleep(Duration::from_millis(1));
        }
        mishap(&mut std::fs::File::options().read(true).write(true).open(&path).unwrap());
        let report = session.join();
        match (&report.end, words) {
            (End::Body(said), Some(words)) => {
                assert!(said.contains(words) && said.contains("x.body"), "{said}")
            }
            (end, words) => assert!(*end == End::Done && words.is_none(), "{end:?} {words:?}"),
        }
        assert_eq!(report.end.is_well(), words.is_none());
        assert_eq!(checked(&log).last().unwrap().1, DVec3::ZERO);
    }
}

/// What the device and the system refuse is known while nothing has been commanded; who does not like it lets go, and the
/// device is closed.
#[test]
fn what_could_not_be_had_is_known_before_the_first_force() {
    let body = Arc::new(plane(600.0, 500.0, 0.2));
    let (mut device, log) = rigged(Mishap::None, DVec3::ZERO);
    device.notes = vec!["it refuses a watchdog".into()];
    let haptics = haptics(&body, device.capabilities());
    let (recorder, _records) = ring(4000);
    let opened = Opened::new(Box::new(device)).unwrap();
    // A priority that is refused wherever this program may not have it, and a core.
    let real_time = RealTime { priority: Some(98), own_core: true, spin_s: 0.0 };
    let settings = Settings { real_time, ..settings(0.1) };
    let prepared = Session::prepare(body, opened, haptics, recorder, settings).unwrap();
    let allowed = std::process::Command::new("chrt").args(["-f", "98", "true"]).status();
    let allowed = allowed.is_ok_and(|status| status.success());
    let told = |words: &str| prepared.notes().iter().any(|note| note.contains(words));
    assert!(told("it refuses a watchdog"), "{:?}", prepared.notes());
    assert!(allowed || told("real-time scheduling was refused"), "{:?}", prepared.notes());
    assert!(log.lock().unwrap().commands.is_empty());
    drop(prepared);
    let log = log.lock().unwrap();
    assert!(log.closed && log.commands.is_empty(), "{log:?}");
}

#[test]
fn asked_to_it_ends_at_once() {
    let body = Arc::new(plane(600.0, 500.0, 0.2));
    let (device, log) = rigged(Mishap::None, DVec3::ZERO);
    let haptics = haptics(&body, device.capabilities());
    let (recorder, _records) = ring(4000);
    let endless = Settings { seconds: None, ..settings(0.0) };
    let session =
        Session::start(body, Opened::new(Box::new(device)).unwrap(), haptics, recorder, endless).unwrap();
    std::thread::sleep(Duration::from_millis(200));
    assert!(!session.is_over());
    session.stopper().stop("SIGINT");
    let report = session.join();
    assert_eq!(report.end, End::Asked("SIGINT"));
    assert!(report.end.is_well() && report.periods > 50);
    assert_eq!(checked(&log).last().unwrap().1, DVec3::ZERO);
}

/// As when the program that holds it unwinds: nobody joins it, and still nothing is left in the hand.
#[test]
fn a_session_that_is_dropped_in_mid_press_leaves_zero_force_and_a_closed_device() {
    let body = Arc::new(plane(600.0, 500.0, 0.2));
    let (device, log) = rigged(Mishap::None, DVec3::ZERO);
    let haptics = haptics(&body, device.capabilities());
    let (recorder, _records) = ring(4000);
    let endless = Settings { seconds: None, ..settings(0.0) };
    let opened = Opened::new(Box::new(device)).unwrap();
    let session = Session::start(body, opened, haptics, recorder, endless).unwrap();
    let begun = Instant::now();
    let pressing = || log.lock().unwrap().commands.last().is_some_and(|(_, force)| force.length() > 0.5);
    while !pressing() {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing is touched");
        std::thread::sleep(Duration::from_millis(5));
    }
    drop(session);
    assert_eq!(checked(&log).last().unwrap().1, DVec3::ZERO);
}

/// A disk with room for so many records, whose driver panics where others say that it is full.
#[derive(Clone)]
struct Broken {
    written: Arc<Mutex<Vec<u8>>>,
    room: usize,
}

impl Write for Broken {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let is_header = self.written.lock().unwrap().is_empty();
        assert!(is_header || self.room > 0, "the disk has a bug");
        self.room -= usize::from(!is_header);
        self.written.lock().unwrap().extend(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_scribe_that_panics_cuts_the_recording_and_the_loop_goes_on() {
    const WRITTEN: usize = 20;
    let body = Arc::new(plane(600.0, 500.0, 0.2));
    let (device, log) = rigged(Mishap::None, DVec3::ZERO);
    let haptics = haptics(&body, device.capabilities());
    // Full long before the end: then there is no one to make room, and nobody to wait for.
    let (recorder, records) = ring(50);
    let disk = Broken { written: Arc::default(), room: WRITTEN };
    let file = RecordingFile::begin(disk.clone(), &Header::default()).unwrap();
    let recorder_thread = RecorderThread::start(records, Some(file), 1000.0).unwrap();
    let opened = Opened::new(Box::new(device)).unwrap();
    let report = Session::start(body, opened, haptics, recorder, settings(0.5)).unwrap().join();
    assert_eq!(report.end, End::Done);
    let commands = checked(&log);
    assert_eq!(commands.last().unwrap().1, DVec3::ZERO);
    let later = commands.iter().filter(|(t, f)| *t > HURT && f.length() > 0.1).count();
    assert!(later > 20, "{later}");
    let finished = recorder_thread.finish("the end");
    assert_eq!(finished.trouble.as_deref(), Some("the thread that writes the recording panicked"));
    assert!(finished.written <= WRITTEN as u64 && finished.summary.dropped_records > 0);
    let bytes = disk.written.lock().unwrap().clone();
    let mut recording = Recording::read(&bytes[..], Path::new("a.rec")).unwrap();
    assert_eq!(recording.by_ref().count(), WRITTEN);
    assert_eq!(recording.ending(), Some(&Ending::Cut { left_over: 0 }));
}

#[test]
fn load_beside_is_borne() {
    let body = Arc::new(plane(600.0, 500.0, 0.2));
    let stop = Arc::new(std::sync::atomic::AtomicBool::new(false));
    let burners = (0..2 * std::thread::available_parallelism().unwrap().get()).map(|_| {
        let stop = stop.clone();
        std::thread::spawn(move || while !stop.load(std::sync::atomic::Ordering::Relaxed) {})
    });
    let burners: Vec<_> = burners.collect();
    let (device, log) = rigged(Mishap::None, DVec3::ZERO);
    let report = run(&body, device, settings(0.4));
    stop.store(true, std::sync::atomic::Ordering::Relaxed);
    burners.into_iter().for_each(|b| b.join().unwrap());
    assert_eq!(report.end, End::Done);
    assert_eq!(checked(&log).last().unwrap().1, DVec3::ZERO);
}

/// A recording of a loop on patches holds what the engine needs to give the same bits again: poses and patches.
#[test]
fn a_recording_on_patches_is_replayed_to_the_bit_by_two_devices_at_once() {
    let body = ball(1.0);
    let folder = tempfile::tempdir().unwrap();
    body.save(&folder.path().join("x.body")).unwrap();
    let whole = Arc::new(StoredBody::open(&folder.path().join("x.body"), None).unwrap());
    // One has the body in memory, the other in its file; the records of both are replayed with it where the other had it.
    let of: [Arc<dyn BodySource>; 2] = [body.clone(), whole.clone()];
    let sessions = [0, 1].map(|i| {
        let turn = Random::new(i as u64).range(0.0, 6.0);
        let place = DVec3::new(6e-3 * libm::cos(turn), 6e-3 * libm::sin(turn), 29.4e-3);
        let (device, _) = rigged(Mishap::None, place);
        let haptics = haptics(&body, device.capabilities());
        let (recorder, records) = ring(4000);
        let path = folder.path().join(format!("{i}.rec"));
        let file = RecordingFile::create(&path, false, &Header::default()).unwrap();
        let recorder_thread = RecorderThread::start(records, Some(file), 1000.0).unwrap();
        let fine = Settings { patch_elements: 200, ..settings(0.5) };
        (
            Session::start(of[i].clone(), Opened::new(Box::new(device)).unwrap(), haptics, recorder, fine)
                .unwrap(),
            recorder_thread,
            path,
        )
    });
    for ((session, recorder_thread, path), other) in sessions.into_iter().zip([of[1].clone(), of[0].clone()])
    {
        let report = session.join();
        let finished = recorder_thread.finish(&report.end.to_string());
        assert!(finished.written == report.periods && finished.trouble.is_none());
        let mut recording = Recording::open(&path).unwrap();
        let mut replay = Retrace::new(&*other, Contact::new(&body));
        let (mut steps, mut patches) = (0, 0);
        let mut last: Option<Record> = None;
        for record in &mut recording {
            let Some(output) = replay.step(&record).unwrap() else { continue };
            assert_eq!(output.force_n, record.force_n, "period {}", record.number);
            assert_eq!(output.contact.map_or(Record::NONE, |c| c.element), record.element);
            assert_eq!(output.energy.work_j.to_bits(), record.work_j.to_bits());
            patches += usize::from(last.is_none_or(|l| l.patch_serial != record.patch_serial));
            steps += usize::from(output.flags.has(Flags::IN_CONTACT));
            last = Some(record);
        }
        assert!(steps > 50 && patches > 3, "{steps} {patches}");
    }
}
