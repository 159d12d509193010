//! A session that a program owns: read and steered while it runs, each change through silence and the soft start.

mod common;

use common::{patch, plane, with_field};
use palpate_body::{Body, SlipRule};
use palpate_device::{Capabilities, Command, Device, Fault, OpenError, Pose, Sample, presets};
use palpate_runtime::{
    ControlError, End, History, LiveSession, Observer, Outcome, Patience, PreparedSession, RealTime, Record,
    Safety, SessionBody, SessionConfig, SessionError, StageFlags, WorkspaceSettings, supervise,
};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A device that stands still, or slides to and fro, 3 mm deep in the plane z = 0, from above within the first periods; and all its
/// commands, N.
struct Pressed {
    capabilities: Capabilities,
    commands: Arc<Mutex<Vec<f64>>>,
    reads: u64,
    slides: bool,
}

impl Pressed {
    fn new(slides: bool) -> (Box<Self>, Arc<Mutex<Vec<f64>>>) {
        let commands = Arc::new(Mutex::new(Vec::with_capacity(100_000)));
        let capabilities = presets::device("bench").unwrap();
        (Box::new(Pressed { capabilities, commands: commands.clone(), reads: 0, slides }), commands)
    }
}

impl Device for Pressed {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }
    fn open(&mut self) -> Result<(), OpenError> {
        Ok(())
    }
    fn read(&mut self, _: f64) -> Result<Sample, Fault> {
        self.reads += 1;
        let k = self.reads as f64;
        let z = (1e-3 - 0.1e-3 * k).max(-3e-3);
        let x = if self.slides { 4e-3 * libm::sin(0.02 * k) } else { 0.0 };
        let pose = Pose { position_m: [x, 0.0, z], ..Pose::default() };
        Ok(Sample { sequence: self.reads, pose, ..Sample::default() })
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        let [x, y, z] = command.force_n;
        self.commands.lock().unwrap().push((x * x + y * y + z * z).sqrt());
        Ok(())
    }
    fn close(&mut self) {}
}

const SOFT_START: f64 = 0.05;
/// Periods after which the device is as deep as it goes, and the first soft start is over.
const ARRIVED: u64 = 60;

/// As on any machine: no rights are asked for, and load beside is forgiven.
fn config() -> SessionConfig {
    SessionConfig {
        workspace: WorkspaceSettings { offset_m: Some([0.0; 3]), ..WorkspaceSettings::default() },
        safety: Safety { soft_start_s: SOFT_START, silence_s: Some(5.0), ..Safety::default() },
        patience: Patience { late_s: 5.0, finder_s: 5.0, ..Patience::default() },
        real_time: RealTime { priority: None, core: None, lock_memory: false, spin_s: 0.0 },
        ..SessionConfig::default()
    }
}

fn started(body: Body, slides: bool, config: SessionConfig) -> (LiveSession, Arc<Mutex<Vec<f64>>>) {
    let (device, commands) = Pressed::new(slides);
    let prepared = PreparedSession::with_device(body.into(), device, config, None).unwrap();
    (prepared.start().unwrap(), commands)
}

/// The latest record for which `wanted` holds, or a failed test after ten seconds.
fn when(session: &LiveSession, wanted: impl Fn(&Record) -> bool) -> Record {
    let begun = Instant::now();
    loop {
        if let Some(record) = session.latest().filter(&wanted) {
            return record;
        }
        assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", session.latest());
        std::thread::sleep(Duration::from_micros(500));
    }
}

fn size([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

fn is_steady(r: &Record) -> bool {
    r.number > ARRIVED && !r.stages().has(StageFlags::STARTING) && size(r.command_force_n) > 0.05
}

/// After each silence the force rises by no more than the soft start's step of what is rendered at its end; and how many
/// silences there were after the first contact.
fn rises_softly(commands: &[f64]) -> usize {
    let most = commands.iter().fold(0.0f64, |a, &b| a.max(b));
    let falls =
        commands.windows(2).position(|pair| pair[0] > 0.0 && pair[1] == 0.0).unwrap_or(commands.len());
    let after = commands.get(falls..).unwrap_or_default();
    for (i, pair) in after.windows(2).enumerate() {
        let step = 2.0 * most * 1e-3 / SOFT_START;
        assert!(pair[1] - pair[0] <= step, "command {}: {} to {} N", falls + i, pair[0], pair[1]);
    }
    after.windows(2).filter(|pair| pair[0] == 0.0 && pair[1] > 0.0).count()
}

#[test]
fn a_program_reads_steers_and_ends_its_session() {
    // f = 100 k δ² of the paper's law: a force that a lower limit cuts.
    let (mut session, commands) = started(plane(2000.0, 2000.0, 0.3), true, config());
    let steady = when(&session, is_steady);
    assert!(steady.delta_z_m > 2.9e-3 && steady.element != Record::NONE);
    let force = size(steady.force_n);
    assert!(force > 1.0, "{force}");

    let controls = session.controls().clone();
    controls.set_force_limit(0.4, None).unwrap();
    let limited = when(&session, |r| is_steady(r) && size(r.command_force_n) < 0.401);
    assert!(limited.stages().has(StageFlags::SATURATED), "{limited:?}");
    controls.set_force_limit(3.0, None).unwrap();
    when(&session, |r| is_steady(r) && size(r.command_force_n) > 0.9);

    controls.pause();
    let paused = when(&session, |r| r.stages().has(StageFlags::STOPPED) && size(r.command_force_n) == 0.0);
    // The engine goes on in silence.
    when(&session, |r| {
        r.number > paused.number + 20 && size(r.force_n) > 1.0 && size(r.command_force_n) == 0.0
    });
    controls.resume();
    when(&session, |r| r.number > paused.number + 20 && is_steady(r));

    // Slid to and fro, the lateral force is up to μ of the normal one; without friction there is none to speak of.
    let lateral = |r: &Record| r.force_n[0].hypot(r.force_n[1]) / r.force_n[2].abs();
    when(&session, |r| lateral(r) > 0.25);
    controls.set_friction_scale(0.0).unwrap();
    let slippery = when(&session, |r| is_steady(r) && r.friction_scale == 0.0);
    let most = (0..200).map(|_| {
        std::thread::sleep(Duration::from_millis(1));
        session.latest().map_or(0.0, |r| lateral(&r))
    });
    assert!(most.fold(0.0, f64::max) < 0.01 && slippery.friction_scale == 0.0);
    session.set_slip_rule(SlipRule::Exact).unwrap();
    when(&session, |r| is_steady(r) && r.slip_rule() == Some(SlipRule::Exact));
    // What that rule reads came with the patch, though the body's own rule is another.
    session.set_slip_rule(SlipRule::Consistent).unwrap();
    when(&session, |r| is_steady(r) && r.slip_rule() == Some(SlipRule::Consistent));

    let history = session.history();
    assert!(
        history.len() > 10
            && history.windows(2).all(|w| w[1].number > w[0].number && w[1].number.is_multiple_of(10)),
        "{}",
        history.len()
    );
    assert!(session.summary().periods_in_contact > 100);
    session.stopper().stop("the program has seen enough");
    let Outcome { report, .. } = session.join();
    assert_eq!(report.haptics.as_ref().map(|h| h.contact().counters().without_gradients), Some(0));
    assert_eq!(report.end, End::Asked("the program has seen enough"));
    let commands = commands.lock().unwrap();
    assert_eq!(commands.last(), Some(&0.0));
    // Two limits, a pause, the friction, two rules.
    assert_eq!(rises_softly(&commands), 6, "a silence for each change");
    assert_eq!(controls.set_friction_scale(0.5), Err(ControlError::Over));
}

/// The tool is inside the new body when it comes: it feels nothing, as in a session that begins inside. What was set for the last
/// body goes for this one; the last one is let go of.
#[test]
fn another_body_comes_through_silence() {
    let first = std::sync::Arc::new(plane(2000.0, 2000.0, 0.3));
    let last = Arc::downgrade(&first);
    let (device, commands) = Pressed::new(true);
    let body = SessionBody { source: first, file: Default::default() };
    let config = SessionConfig { patch_elements: 200, ..config() };
    let prepared = PreparedSession::with_device(body, device, config, None).unwrap();
    let mut session = prepared.start().unwrap();
    when(&session, is_steady);
    session.controls().set_friction_scale(0.2).unwrap();
    session.set_slip_rule(SlipRule::Consistent).unwrap();
    // Its own finder works: the tool slides over many patches of a fine one.
    let fine = with_field(&patch(0.1, 120), 600.0, 500.0, 0.3, &|_| 1.0);
    session.change_body(fine).unwrap();
    let changed = when(&session, |r| r.engine().has(palpate_engine::Flags::STARTED_INSIDE));
    assert!(size(changed.command_force_n) == 0.0, "{changed:?}");
    let kept = (changed.friction_scale, changed.slip_rule());
    assert_eq!(kept, (0.2, Some(SlipRule::Consistent)));
    when(&session, |r| r.number > changed.number + 200 && r.patch_serial > 3);
    let begun = Instant::now();
    while last.strong_count() > 0 {
        // The box that holds its patch comes back with the next control.
        session.controls().set_friction_scale(0.2).unwrap();
        assert!(begun.elapsed() < Duration::from_secs(10), "the first body is still held");
        std::thread::sleep(Duration::from_millis(5));
    }
    session.stopper().stop("done");
    assert!(session.join().report.end.is_well());
    rises_softly(&commands.lock().unwrap());
}

/// Sixty changes at once, another body among them: none is lost, in their order, and the session goes on.
#[test]
fn changes_queue_around_another_body() {
    let patience = Patience { finder_s: 2.0, ..config().patience };
    let config =
        SessionConfig { patience, safety: Safety { soft_start_s: 0.0, ..config().safety }, ..config() };
    let (mut session, _) = started(plane(2000.0, 2000.0, 0.3), false, config);
    when(&session, |r| r.number > ARRIVED);
    for i in 0..30 {
        session.controls().set_friction_scale(0.1 + 0.01 * f64::from(i)).unwrap();
    }
    session.change_body(plane(600.0, 500.0, 0.3)).unwrap();
    for i in 0..29 {
        session.controls().set_friction_scale(0.5 + 0.01 * f64::from(i)).unwrap();
    }
    let last = when(&session, |r| r.friction_scale > 0.7799);
    when(&session, |r| r.number > last.number + 400 && !r.stages().has(StageFlags::CHANGING));
    session.stopper().stop("done");
    assert!(session.join().report.end.is_well());
}

/// Two callers, one for the force and one for the torque: neither takes back what the other has set.
#[test]
fn callers_do_not_undo_each_other() {
    let (session, _) = started(plane(2000.0, 2000.0, 0.3), false, config());
    when(&session, is_steady);
    std::thread::scope(|scope| {
        for caller in 0..2 {
            let controls = session.controls().clone();
            scope.spawn(move || {
                for turn in 0..200 {
                    let most = if turn % 2 == 0 { 2.0 } else { 0.5 + 0.1 * f64::from(caller) };
                    while controls.set_force_limit(most, Some(2000.0 + f64::from(caller))).is_err() {
                        std::thread::sleep(Duration::from_micros(200));
                    }
                }
            });
        }
    });
    while session.controls().set_force_limit(0.3, None).is_err() {}
    let limited = when(&session, |r| is_steady(r) && size(r.command_force_n) < 0.301);
    let settled = when(&session, |r| r.number > limited.number + 200);
    assert!(size(settled.command_force_n) < 0.301, "{settled:?}");
    // More than the device was opened with would do nothing.
    let refused = session.controls().set_torque_limit(0.05, None).unwrap_err();
    assert!(refused.to_string().contains("torque_max_nm"), "{refused}");
}

/// An emergency stop is no orderly end, whoever asked for it.
#[test]
fn an_emergency_is_told_from_a_stop() {
    let (session, commands) = started(plane(2000.0, 2000.0, 0.3), false, config());
    when(&session, is_steady);
    session.stopper().stop_at_once("a panic in this program");
    let end = session.join().report.end;
    assert!(end == End::Emergency("a panic in this program") && !end.is_well() && end.kind() == "emergency");
    assert_eq!(commands.lock().unwrap().last(), Some(&0.0));
}

#[test]
fn a_recording_keeps_to_its_body_and_to_its_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rec");
    let record = Some(path.clone());
    // Two contact points, over patches.
    let body = plane(2000.0, 2000.0, 0.3).with_partial_slip(true);
    let (mut session, _) = started(body.clone(), true, SessionConfig { record, ..config() });
    when(&session, is_steady);
    assert_eq!(session.change_body(plane(600.0, 500.0, 0.3)), Err(ControlError::Recorded));
    session.controls().set_friction_scale(0.4).unwrap();
    when(&session, |r| is_steady(r) && r.friction_scale == 0.4);
    // From the body's own rule to one that reads more of a patch, and once more to the same.
    assert_eq!(body.slip(), SlipRule::Paper);
    for rule in [SlipRule::Consistent, SlipRule::Consistent, SlipRule::Exact] {
        session.set_slip_rule(rule).unwrap();
        let there = when(&session, |r| is_steady(r) && r.slip_rule() == Some(rule));
        when(&session, |r| r.number > there.number + 150);
    }
    session.stopper().stop("done");
    session.join();
    let recording = palpate_runtime::Recording::open(&path).unwrap();
    let contact = palpate_engine::Contact::with_slip(&body, body.slip(), palpate_engine::Ablation::None);
    let mut again = palpate_runtime::Retrace::new(&body, contact);
    let (mut judged, mut slips) = (0, 0);
    for record in recording {
        let Some(output) = again.step(&record).unwrap() else { continue };
        assert_eq!(output.force_n, record.force_n, "period {}", record.number);
        judged += 1;
        slips += u32::from(output.flags.has(palpate_engine::Flags::SLIPPING));
    }
    assert!(judged > 300 && slips > 50, "{judged} {slips}");
}

#[test]
fn what_cannot_be_is_refused_and_the_session_goes_on() {
    let (session, _) = started(plane(600.0, 500.0, 0.3), false, config());
    let controls = session.controls();
    for wrong in [f64::NAN, -1.0, f64::INFINITY] {
        assert!(matches!(controls.set_force_limit(wrong, None), Err(ControlError::Setting(_))), "{wrong}");
        assert!(matches!(controls.set_friction_scale(wrong), Err(ControlError::Setting(_))), "{wrong}");
    }
    assert!(matches!(controls.set_force_limit(2.0, Some(1.0)), Err(ControlError::Setting(_))));
    let number = when(&session, |_| true).number;
    when(&session, |r| r.number > number + 50);
    // A burst is either taken or refused, and the loop is not late by it.
    let taken = (0..10_000).filter(|i| controls.set_friction_scale(f64::from(i % 3)).is_ok()).count();
    assert!(taken >= 32, "{taken}");
    let number = when(&session, |_| true).number;
    when(&session, |r| r.number > number + 50);
    drop(session);
    for (config, words) in [
        (SessionConfig { rate_hz: 0.0, ..config() }, "rate_hz"),
        (SessionConfig { device: "simulated:pencil".parse().unwrap(), ..config() }, "pencil"),
        (SessionConfig { motion: "wave".into(), ..config() }, "wave"),
        (SessionConfig { hand: "foot".into(), ..config() }, "foot"),
        (SessionConfig { device: "replay:none.csv".parse().unwrap(), ..config() }, "none.csv"),
    ] {
        let error = LiveSession::start(plane(600.0, 500.0, 0.3), config).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
    }
    let strict = SessionConfig {
        strict: true,
        real_time: RealTime { priority: Some(98), core: None, lock_memory: false, spin_s: 0.0 },
        ..config()
    };
    // Only where it is refused, which is so wherever no rights were given.
    if let Err(error) = LiveSession::start(plane(600.0, 500.0, 0.3), strict) {
        assert!(
            matches!(&error, SessionError::Strict { .. }) && error.to_string().contains("refused"),
            "{error}"
        );
    }
}

#[test]
fn why_it_has_ended_is_known_before_it_is_waited_for() {
    let device = Pressed::new(false).0;
    let body = plane(600.0, 500.0, 0.3).into();
    let session = PreparedSession::with_device(body, device, config(), None).unwrap().start().unwrap();
    assert_eq!(session.end(), None);
    session.stopper().stop("enough");
    while !session.is_over() {
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(session.end(), Some(&End::Asked("enough")));
    assert_eq!(session.join().report.end, End::Asked("enough"));
}

/// A core is given back with its thread: the next session has it again, and one beside it asks for another.
#[cfg(target_os = "linux")]
#[test]
fn sessions_after_each_other_have_the_same_core() {
    let core_of = |nth: u32| {
        let cores = Arc::new(Mutex::new(Vec::new()));
        let device = Box::new(Where(cores.clone(), Pressed::new(false).0));
        let real_time = RealTime { core: Some(nth), ..config().real_time };
        let config = SessionConfig { seconds: Some(0.05), real_time, ..config() };
        let prepared = PreparedSession::with_device(plane(600.0, 500.0, 0.3).into(), device, config, None);
        assert!(prepared.unwrap().start().unwrap().join().report.end.is_well());
        let cores = cores.lock().unwrap();
        let first = cores[0];
        assert!(cores.iter().all(|core| *core == first), "{cores:?}");
        first
    };
    let Some(count) = several_cores() else { return };
    assert_eq!(core_of(0), core_of(0));
    assert_eq!(core_of(0) != core_of(1), count > 2);
}

/// A device that says on which core the haptic thread is.
#[cfg(target_os = "linux")]
struct Where(Arc<Mutex<Vec<usize>>>, Box<Pressed>);

#[cfg(target_os = "linux")]
impl Device for Where {
    fn capabilities(&self) -> &Capabilities {
        self.1.capabilities()
    }
    fn open(&mut self) -> Result<(), OpenError> {
        Ok(())
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.1.read(now_s)
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        self.0.lock().unwrap().push(rustix::thread::sched_getcpu());
        self.1.write(command)
    }
    fn close(&mut self) {}
}

/// How many cores there are, if there are several.
#[cfg(target_os = "linux")]
fn several_cores() -> Option<u32> {
    let count = rustix::thread::sched_getaffinity(None).unwrap().count();
    if count < 2 {
        eprintln!("skipped: there is one core, which no thread has for its own");
    }
    Some(count).filter(|count| *count > 1)
}

/// What opens a window keeps off, and so do the threads that the window starts; again and again, it is the same cores.
#[cfg(target_os = "linux")]
#[test]
fn a_thread_and_what_it_starts_keep_off_the_haptic_threads_core() {
    let Some(count) = several_cores() else { return };
    let allowed = || rustix::thread::sched_getaffinity(None).unwrap();
    let prepared = |core| {
        let cores = Arc::new(Mutex::new(Vec::new()));
        let device = Box::new(Where(cores.clone(), Pressed::new(false).0));
        let real_time = RealTime { core, ..config().real_time };
        let config = SessionConfig { seconds: Some(0.05), real_time, ..config() };
        let body = plane(600.0, 500.0, 0.3).into();
        (PreparedSession::with_device(body, device, config, None).unwrap(), cores)
    };
    let (free, _) = prepared(None);
    free.keep_off_its_core().unwrap();
    assert_eq!(allowed().count(), count);

    let (own, cores) = prepared(Some(0));
    own.keep_off_its_core().unwrap();
    let session = own.start().unwrap();
    session.keep_off_its_core().unwrap();
    let theirs = std::thread::spawn(allowed).join().unwrap();
    assert!(session.join().report.end.is_well());
    let core = cores.lock().unwrap()[0];
    assert_eq!((allowed().count(), theirs), (count - 1, allowed()));
    assert!(!theirs.is_set(core), "{core}");
}

#[derive(Default)]
struct Watcher {
    looks: u64,
    ended: Vec<usize>,
}

impl Observer for Watcher {
    fn look(&mut self, _: usize, session: &LiveSession) {
        self.looks += u64::from(session.latest().is_some());
    }
    fn ended(&mut self, index: usize, _: &Outcome) {
        self.ended.push(index);
    }
}

#[test]
fn several_sessions_are_watched_until_each_has_ended() {
    let body: SessionBody = plane(600.0, 500.0, 0.3).into();
    let sessions = [2.0, 0.1].map(|seconds| {
        let config = SessionConfig {
            seconds: Some(seconds),
            history: History { seconds: 0.0, ..History::default() },
            ..config()
        };
        let device = Pressed::new(false).0;
        PreparedSession::with_device(body.clone(), device, config, None).unwrap().start().unwrap()
    });
    let mut watcher = Watcher::default();
    let outcomes = supervise(sessions.into(), &|| None, &mut watcher);
    assert_eq!(outcomes.len(), 2);
    assert!(outcomes.iter().all(|o| o.report.end == End::Done), "{outcomes:?}");
    assert!(watcher.ended == [1, 0] && watcher.looks > 5, "{:?}", watcher.ended);
}

/// The simulated device of a configuration, and the virtual clock with the same limits.
#[test]
fn the_limits_are_the_same_on_both_clocks() {
    let body = plane(2000.0, 2000.0, 0.3);
    let config = SessionConfig {
        seconds: Some(0.8),
        motion: "press".into(),
        safety: Safety {
            force_max_n: Some(0.5),
            soft_start_s: 0.1,
            silence_s: Some(5.0),
            ..Safety::default()
        },
        workspace: WorkspaceSettings::default(),
        ..config()
    };
    let summary = palpate_runtime::run_virtual(&body, &config, |_, _| Ok(())).unwrap();
    assert!(summary.limits.force_max_n == 0.5 && summary.stages["saturated"] > 50, "{:?}", summary.stages);
    assert_eq!(summary.stages["starting"], 99);
    let session = LiveSession::start(body, config).unwrap();
    let outcome = session.join();
    assert!(outcome.report.end.is_well());
    assert!(outcome.finished.summary.stages["saturated"] > 50, "{:?}", outcome.finished.summary.stages);
}
