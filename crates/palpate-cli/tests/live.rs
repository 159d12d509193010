//! `palpate run` against the clock from outside: recordings that are traced to the bit, signals, two devices at once, a body
//! cut short and a disk full meanwhile, and complaints.
//!
//! No times are judged: the machine may be busy with something else, and give no rights.

mod common;
#[path = "../../palpate-device/tests/stand_in/mod.rs"]
mod stand_in;

use common::{TestDirectory, said, spec};
use glam::DVec3;
use palpate_body::Body;
use palpate_cli::live;
use palpate_device::simulated::HandMotion as _;
use palpate_device::{Capabilities, Device, EmergencyStop, Fault, OpenError, Sample, presets};
use palpate_engine::Flags;
use palpate_runtime::motion::MotionScript;
use palpate_runtime::{
    Ending, HeldDevice, Patience, PreparedSession, RealTime, Record, Recording, RecordingFile, Safety,
    SessionBody, SessionConfig, WorkspaceSettings,
};
use serde_json::Value;
use std::fs;
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Down at once and to and fro, for as long as it is let.
const INTENT: &str = r#"
[start]
clearance_mm = 0.5
[[move]]
kind = "press"
depth_mm = 6
seconds = 0.15
[[move]]
kind = "drag"
along_mm = 20
seconds = 0.6
[[move]]
kind = "hold"
seconds = 60
"#;

/// On any machine: no rights are asked for, and load beside is forgiven.
const CALM: &str = "--priority 0 --late-ms 10000 --stale-ms 10000 --soft-start-s 0.05 --silence-ms 10";

/// The desk, with `intent.toml`.
fn directory() -> TestDirectory {
    let directory = TestDirectory::new(4);
    directory.write("intent.toml", INTENT);
    directory
}

impl TestDirectory {
    /// A loop with a simulated device; the last line for each device.
    fn live(&self, args: &str) -> Vec<Value> {
        let devices = args.matches("--device").count();
        let simulated = "--intent intent.toml --stale-ms 10000 --soft-start-s 0.05 --silence-ms 10";
        let more = if args.contains("simulated") { simulated } else { "" };
        told(
            &self.done(&format!("run block.body {more} --priority 0 --late-ms 10000 --json {args}")),
            devices,
        )
    }

    fn start(&self, args: &str) -> Child {
        let args = format!("run block.body --device simulated --intent intent.toml {CALM} --json {args}");
        self.command(&args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    fn records(&self, name: &str) -> (Vec<Record>, Ending) {
        let mut recording = Recording::open(&self.path(name)).unwrap();
        let records = recording.by_ref().collect();
        (records, recording.ending().unwrap().clone())
    }

    /// Waits until a recording holds this many periods.
    fn wait_for(&self, name: &str, periods: usize) {
        let begun = Instant::now();
        let there = || Recording::open(&self.path(name)).map_or(0, Iterator::count);
        while there() < periods {
            assert!(begun.elapsed() < Duration::from_secs(60), "{name} does not grow");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// Every line of standard output is JSON, and the last ones tell how it ended.
fn told(output: &Output, devices: usize) -> Vec<Value> {
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let (live, last) = lines.split_at(lines.len() - devices);
    let is_told =
        |line: &Value| line["end"].is_null() && (line["periods"].is_u64() || line["force_n"].is_array());
    assert!(live.iter().all(is_told), "{text}");
    assert!(last.iter().all(|line| line["end"].is_string() && line["end_kind"].is_string()), "{text}");
    last.to_vec()
}

fn touches(record: &&Record) -> bool {
    record.engine().has(Flags::IN_CONTACT)
}

/// Run, trace to the same bits, export, and run again from the recording and from a path.
#[test]
fn a_recording_is_traced_exported_and_replayed() {
    let directory = directory();
    let last = directory.live("--device simulated --seconds 1.2 --record a.rec");
    assert_eq!((&last[0]["end"], &last[0]["well"]), (&"the time is over".into(), &true.into()));
    let (records, ending) = directory.records("a.rec");
    assert!(matches!(ending, Ending::Clean { ref reason, dropped: 0 } if reason == "the time is over"));
    assert_eq!(last[0]["recorded"], records.len());
    assert_eq!(last[0]["statistics"]["periods"], records.len());
    assert!(records.iter().filter(touches).count() > 50);
    let end = records.last().unwrap();
    assert_eq!((end.command_force_n, end.tool()), ([0.0; 3], None));

    let traced = directory.done("trace block.body --path a.rec -o a.csv --json");
    assert!(said(&traced).contains("the same bits"), "{}", said(&traced));
    let steps = records.iter().filter(|r| r.tool().is_some()).count();
    assert_eq!(fs::read_to_string(directory.path("a.csv")).unwrap().lines().count(), 1 + steps);
    let summary: Value = serde_json::from_slice(&traced.stdout).unwrap();
    assert_eq!(summary["steps"], steps);

    directory.done("export a.rec --csv tables");
    let periods = fs::read_to_string(directory.path("tables/periods.csv")).unwrap();
    assert_eq!(periods.lines().count(), 1 + records.len());
    let about: Value =
        serde_json::from_slice(&fs::read(directory.path("tables/recording.json")).unwrap()).unwrap();
    assert_eq!((&about["device"], about["rate_hz"].as_f64()), (&last[0]["device"], Some(1000.0)));

    let ended: Value = "the device's poses are at their end".into();
    let again = &directory.live("--device replay:a.rec --record again.rec")[0];
    assert_eq!(again["end"], ended);
    assert!(again["statistics"]["periods_in_contact"].as_u64().unwrap() > 50, "{again}");
    directory.done("trace block.body --path again.rec -o again.csv");
    let body = Body::open(&directory.path("block.body")).unwrap();
    let top = body.point(body.first_touch(DVec3::Z, -DVec3::Z, 0.0).unwrap().at).z;
    directory.write(
        "path.csv",
        &format!(
            "time_s,x_m,y_m,z_m\n0,0,0,{}\n0.1,0,0,{}\n0.4,0.01,0,{}\n",
            top + 1e-3,
            top - 4e-3,
            top - 4e-3
        ),
    );
    let along = &directory.live("--device replay:path.csv --record path.rec")[0];
    assert_eq!(along["end"], ended);
    let deepest = directory.records("path.rec").0.iter().map(|r| r.delta_z_m).fold(0.0, f64::max);
    assert!((deepest - 4e-3).abs() < 1e-4, "{deepest}");
}

/// Other bits than recorded end with status 3, another body with 1; what is whole of a damaged or cut recording is traced.
#[test]
fn what_was_changed_is_found_and_what_was_cut_is_traced_up_to_there() {
    let directory = directory();
    directory.live("--device simulated --seconds 0.6 --record a.rec");
    let (records, _) = directory.records("a.rec");
    let touched = records.iter().position(|r| r.engine().has(Flags::IN_CONTACT)).unwrap();
    let header = Recording::open(&directory.path("a.rec")).unwrap().header().clone();
    // One force, by one bit, with a checksum that fits.
    let mut file =
        RecordingFile::begin(fs::File::create(directory.path("force.rec")).unwrap(), &header).unwrap();
    for (i, record) in records.iter().enumerate() {
        let mut record = *record;
        if i == touched {
            record.force_n[2] = f64::from_bits(record.force_n[2].to_bits() ^ 1);
        }
        file.write(&record).unwrap();
    }
    file.end("it was changed", records.len() as u64, 0).unwrap();
    let output = directory.run("trace block.body --path force.rec -o force.csv");
    assert_eq!(output.status.code(), Some(3));
    let time = records[touched].time_s;
    assert!(said(&output).contains("force.rec: 1 of "), "{}", said(&output));
    assert!(said(&output).contains(&format!("the first at {time} s")), "{}", said(&output));

    let bytes = fs::read(directory.path("a.rec")).unwrap();
    let start = bytes.len() - (records.len() + 1) * Record::BYTES;
    let mut damaged = bytes.clone();
    damaged[start + 200 * Record::BYTES + 100] ^= 1;
    fs::write(directory.path("damaged.rec"), damaged).unwrap();
    fs::write(directory.path("cut.rec"), &bytes[..start + 300 * Record::BYTES + 50]).unwrap();
    for (name, whole, words) in [
        ("damaged", 200, "damaged from record 200 on"),
        ("cut", 300, "cut off, with 50 bytes of a record begun"),
    ] {
        let traced = directory.done(&format!("trace block.body --path {name}.rec -o {name}.csv"));
        assert!(
            said(&traced).contains(words) && said(&traced).contains("the same bits"),
            "{}",
            said(&traced)
        );
        let steps = records[..whole].iter().filter(|r| r.tool().is_some()).count();
        assert_eq!(
            fs::read_to_string(directory.path(&format!("{name}.csv"))).unwrap().lines().count(),
            1 + steps
        );
        let exported = directory.done(&format!("export {name}.rec --csv {name}"));
        assert!(said(&exported).contains(words));
    }
    fs::write(directory.path("header.rec"), &bytes[..1000]).unwrap();
    directory.refused("trace block.body --path header.rec -o none.csv", 1, &["header.rec: "]);

    directory.write("spec.toml", &spec(4).replace("600", "601"));
    directory.done("fit --spec spec.toml -o other.body");
    directory.refused(
        "trace other.body --path a.rec -o none.csv",
        1,
        &["another body", "other.body", "block.body"],
    );
    assert!(!directory.path("none.csv").exists());
}

#[test]
fn two_devices_on_one_body_have_two_recordings() {
    let directory = directory();
    let last = directory
        .live("--device simulated --device simulated:omega --seconds 0.8 --record a.rec --record b.rec");
    assert_ne!(last[0]["device"], last[1]["device"]);
    for (name, last) in ["a", "b"].iter().zip(&last) {
        assert_eq!(last["well"], true, "{last}");
        let (records, _) = directory.records(&format!("{name}.rec"));
        assert_eq!(last["recorded"], records.len());
        assert!(records.iter().filter(touches).count() > 50);
        let header = Recording::open(&directory.path(&format!("{name}.rec"))).unwrap().header().clone();
        assert_eq!(last["device"], *header.device);
        directory.done(&format!("trace block.body --path {name}.rec -o {name}.csv"));
    }
}

/// Scale, place and turn of the device are as they were given.
#[test]
fn the_workspace_is_mapped_as_asked() {
    let directory = directory();
    let map = "--scale 2 --offset-mm -1,2.5,300 --rotation 0,0,0,-1";
    directory.live(&format!("--device simulated --seconds 0.05 --record a.rec {map}"));
    let map = Recording::open(&directory.path("a.rec")).unwrap().header().map;
    assert_eq!((map.scale, map.offset_m, map.rotation), (2.0, [-1e-3, 2.5e-3, 0.3], [0.0, 0.0, 0.0, -1.0]));
    for record in directory.records("a.rec").0.iter().filter(|r| r.tool().is_some()) {
        let [x, y, z] = record.device_position_m;
        let expected = DVec3::new(-1e-3 - 2.0 * x, 2.5e-3 - 2.0 * y, 0.3 + 2.0 * z);
        assert!(DVec3::from_array(record.tool_position_m).distance(expected) < 1e-12);
    }
}

#[cfg(unix)]
fn send(signal: &str, child: &Child) {
    let kill = format!("kill -{signal} {}", child.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}

/// In mid-press: status 0, zero as the last command, and a recording with its end.
#[cfg(unix)]
#[test]
fn signals_end_it_with_zero_force() {
    let directory = directory();
    // Ctrl-Z would leave the device with its last force.
    for signal in ["INT", "TERM", "TSTP"] {
        let name = format!("{signal}.rec");
        let child = directory.start(&format!("--seconds 600 --record {name}"));
        directory.wait_for(&name, 400);
        send(signal, &child);
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{signal}: {}", said(&output));
        assert_eq!(told(&output, 1)[0]["end"], "a signal asked for it");
        let (records, ending) = directory.records(&name);
        assert!(matches!(ending, Ending::Clean { ref reason, .. } if reason == "a signal asked for it"));
        let pressed = records.iter().rposition(|r| r.tool().is_some()).unwrap();
        let size = |r: &Record| r.command_force_n.map(|x| x * x).iter().sum::<f64>().sqrt();
        assert!(size(&records[pressed]) > 0.1);
        let after = &records[pressed + 1..];
        assert!((1..=2).contains(&after.len()) && size(after.last().unwrap()) == 0.0, "{}", after.len());
    }
}

/// Nobody reads what the program tells, neither meanwhile nor at its end, so that it hangs there: the first signal brings zero
/// force and ends the recording all the same, and a second one the program.
#[cfg(unix)]
#[test]
fn signals_end_it_where_nobody_reads_what_it_tells() {
    signals_end_it("");
    signals_end_it("--json");
}

#[cfg(unix)]
fn signals_end_it(json: &str) {
    use std::io::Write;
    use std::os::unix::net::UnixStream;
    let directory = directory();
    // Filled byte by byte: then there is no room for anything.
    let (_reader, mut full) = UnixStream::pair().unwrap();
    full.set_nonblocking(true).unwrap();
    while full.write(b" ").is_ok() {}
    full.set_nonblocking(false).unwrap();
    let args = format!("run block.body --device simulated --intent intent.toml {CALM} --record a.rec {json}");
    // Without `--json`, what is told meanwhile goes to standard error.
    let end = std::os::fd::OwnedFd::from(full);
    let error = if json.is_empty() { end.try_clone().unwrap().into() } else { Stdio::null() };
    let mut child = directory.command(&args).stdout(end).stderr(error).spawn().unwrap();
    // Longer than until the first line.
    directory.wait_for("a.rec", 1400);
    send("INT", &child);
    let begun = Instant::now();
    let (records, reason) = loop {
        if let (records, Ending::Clean { reason, .. }) = directory.records("a.rec") {
            break (records, reason);
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "the first signal ends nothing");
        std::thread::sleep(Duration::from_millis(20));
    };
    assert_eq!(
        (reason.as_str(), records.last().unwrap().command_force_n),
        ("a signal asked for it", [0.0; 3])
    );
    // Long after the end.
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(child.try_wait().unwrap(), None, "the end does not hang");
    send("INT", &child);
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if begun.elapsed() > Duration::from_secs(20) {
            child.kill().unwrap();
            panic!("the second signal ends nothing");
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert_eq!(status.code(), Some(130));
}

/// A simulated device with a list of its commands. The first of two is gone as soon as both have pressed; when the other has
/// gone on without it for a while, its driver panics.
struct Leaving {
    device: Box<dyn Device>,
    log: Arc<Mutex<Log>>,
    other: Arc<Mutex<Log>>,
    is_first: bool,
    alone: u32,
}

#[derive(Debug, Default)]
struct Log {
    forces: Vec<DVec3>,
    closed: bool,
    stopped: bool,
}

/// The device's emergency stop.
#[derive(Debug)]
struct Stop(Arc<Mutex<Log>>);

impl EmergencyStop for Stop {
    fn stop(&self) {
        let mut log = self.0.lock().unwrap();
        log.forces.push(DVec3::ZERO);
        log.stopped = true;
    }
}

impl Log {
    fn pressed(&self) -> bool {
        self.forces.iter().any(|force| force.length() > 0.5)
    }
}

impl Device for Leaving {
    fn capabilities(&self) -> &Capabilities {
        self.device.capabilities()
    }
    fn open(&mut self) -> Result<(), OpenError> {
        self.device.open()
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        let pressed = |log: &Mutex<Log>| log.lock().unwrap().pressed();
        if self.is_first && pressed(&self.other) && pressed(&self.log) {
            return Err(Fault::Disconnected);
        }
        if !self.is_first && self.other.lock().unwrap().closed {
            self.alone += u32::from(self.log.lock().unwrap().forces.last().is_some_and(|f| f.length() > 0.5));
            assert!(self.alone < ALONE, "the driver has a bug");
        }
        self.device.read(now_s)
    }
    fn write(&mut self, command: &palpate_device::Command) -> Result<(), Fault> {
        self.log.lock().unwrap().forces.push(DVec3::from_array(command.force_n));
        self.device.write(command)
    }
    fn close(&mut self) {
        self.log.lock().unwrap().closed = true;
        self.device.close();
    }
    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        Some(Arc::new(Stop(self.log.clone())))
    }
}

/// Periods with a force that the second device renders after the first one's end.
const ALONE: u32 = 100;

/// One of two devices on one body fails in mid-press: its loop ends, and the other's goes on. Then that one's driver panics:
/// zero force before a word of the panic is written.
/// The only test that runs loops in its own process: signals can be handled once.
#[test]
fn a_device_that_fails_ends_its_own_loop_alone_and_a_panic_takes_the_force_off_first() {
    let directory = directory();
    let body = SessionBody::open(&directory.path("block.body"), None, None, false).unwrap();
    let motion = MotionScript::read(&directory.path("intent.toml")).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let logs: [Arc<Mutex<Log>>; 2] = Default::default();
    let saw = Arc::new(Mutex::new(Vec::new()));
    let (words, log) = (saw.clone(), logs[1].clone());
    std::panic::set_hook(Box::new(move |panic| {
        let log = log.lock().unwrap();
        words.lock().unwrap().push((panic.to_string(), log.stopped, log.forces.last().copied()));
    }));
    let others = [(logs[1].clone(), true), (logs[0].clone(), false)];
    let sessions = logs.iter().zip(others).map(|(log, (other, is_first))| {
        let touch = presets::device("touch").unwrap();
        let held = HeldDevice::new(&*body.source, touch, hand, &motion).unwrap();
        let config = SessionConfig {
            seconds: Some(held.script.duration_s()),
            safety: Safety { soft_start_s: 0.05, silence_s: Some(1.0), ..Safety::default() },
            workspace: WorkspaceSettings {
                offset_m: Some(held.map.offset_m.to_array()),
                ..WorkspaceSettings::default()
            },
            patience: Patience { late_s: 10.0, pose_s: 10.0, finder_s: 10.0, ..Patience::default() },
            real_time: RealTime { priority: None, core: None, ..RealTime::default() },
            ..SessionConfig::default()
        };
        let leaving = Leaving { device: Box::new(held.device), log: log.clone(), other, is_first, alone: 0 };
        PreparedSession::with_device(body.clone(), Box::new(leaving), config, None).unwrap()
    });
    let ended = live::run(sessions.collect(), &|| false, false, None).unwrap();
    let _ = std::panic::take_hook();
    let [gone, other] = &ended[..] else { panic!("{ended:?}") };
    assert_eq!((gone.end.as_str(), gone.well), ("the device is gone", false));
    let saw = saw.lock().unwrap();
    let [(words, stopped, last)] = &saw[..] else { panic!("{saw:?}") };
    assert!(words.contains("the driver has a bug") && *stopped && *last == Some(DVec3::ZERO), "{saw:?}");
    assert_eq!(other.end, "the haptic thread panicked: the driver has a bug");
    for log in &logs {
        // What is gone may not get the commands; they are sent all the same.
        let log = log.lock().unwrap();
        assert!(log.pressed() && log.closed);
        assert_eq!(log.forces.last(), Some(&DVec3::ZERO));
    }
}

/// A body in memory was read as a whole before the loop began: what becomes of its file then is nothing to the loop.
#[test]
fn a_body_that_is_cut_short_meanwhile_is_not_missed() {
    let directory = directory();
    let whole = fs::read(directory.path("block.body")).unwrap();
    let child = directory.start("--seconds 1.2 --record a.rec");
    directory.wait_for("a.rec", 1);
    fs::File::options().write(true).open(directory.path("block.body")).unwrap().set_len(100).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert_eq!(told(&output, 1)[0]["end"], "the time is over");
    directory.refused("trace block.body --path a.rec -o a.csv", 1, &["block.body"]);
    fs::write(directory.path("block.body"), whole).unwrap();
    directory.done("trace block.body --path a.rec -o a.csv");
}

/// One that stays in its file gives the same bits, and ends the loop when it is cut.
#[test]
fn a_body_in_its_file_gives_the_same_bits_and_is_missed_when_it_is_cut() {
    let directory = directory();
    let ended =
        directory.live("--device simulated --body-in file --patch-elements 64 --seconds 1.2 --record a.rec");
    assert_eq!(ended[0]["end"], "the time is over");
    let patches = |(records, _): &(Vec<Record>, Ending)| {
        records.chunk_by(|a, b| a.patch_serial == b.patch_serial).count()
    };
    assert!(patches(&directory.records("a.rec")) > 3, "{}", patches(&directory.records("a.rec")));
    directory.done("trace block.body --path a.rec -o a.csv");

    // Round and round.
    directory.write("intent.toml", &INTENT.replace("\"hold\"", "\"circle\"\nradius_mm = 5\nturns = 60"));
    let child = directory.start("--body-in file --patch-elements 64 --record b.rec");
    directory.wait_for("b.rec", 1);
    fs::File::options().write(true).open(directory.path("block.body")).unwrap().set_len(100).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(4), "{}", said(&output));
    let words = "block.body: body file: it was cut short while it was in use";
    assert!(told(&output, 1)[0]["end"].as_str().unwrap().contains(words), "{}", said(&output));
    let (records, ending) = directory.records("b.rec");
    assert!(matches!(&ending, Ending::Clean { reason, .. } if reason.contains(words)), "{ending:?}");
    assert_eq!(records.last().unwrap().command_force_n, [0.0; 3]);
}

/// A disk of 400 KiB, which the recording fills: that is told once, the loop goes on, and what was written can be read.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_recording_and_not_the_loop() {
    let directory = directory();
    // In a namespace of its own, so that nothing is left behind; without rights, as its own root.
    let unshare = |script: &str| {
        let mut command = Command::new("unshare");
        command
            .args(["--user", "--map-root-user", "--mount", "sh", "-c", script])
            .current_dir(directory.path(""));
        command.output()
    };
    fs::create_dir(directory.path("full")).unwrap();
    let mount = "mount -t tmpfs -o size=400k none full";
    if !unshare(mount).is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: no disk may be mounted here, so none is filled");
        return;
    }
    let palpate = env!("CARGO_BIN_EXE_palpate");
    let script = format!(
        "{mount}; {palpate} run block.body --device simulated --intent intent.toml {CALM} --json \
         --seconds 1.2 --record full/a.rec; code=$?; cp full/a.rec a.rec; exit $code"
    );
    let output = unshare(&script).unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let last = &told(&output, 1)[0];
    assert_eq!((&last["end"], &last["well"]), (&"the time is over".into(), &true.into()));
    assert!(last["recording_trouble"].as_str().unwrap().contains("the loop goes on"), "{last}");
    assert_eq!(said(&output).matches("the recording ends here").count(), 1, "{}", said(&output));
    let (records, ending) = directory.records("a.rec");
    assert!(matches!(ending, Ending::Cut { .. }), "{ending:?}");
    assert!(records.len() > 100 && (records.len() as u64) < last["statistics"]["periods"].as_u64().unwrap());
    directory.done("trace block.body --path a.rec -o a.csv");
}

#[test]
fn what_is_not_installed_is_said_with_what_to_do() {
    let directory = directory();
    let missing = "--device-library nowhere/lib.so";
    let run = "run block.body --priority 0";
    directory.refused(
        &format!("{run} --device dhd {missing}"),
        1,
        &["nowhere/lib.so", "Force Dimension", "install"],
    );
    directory.refused(
        &format!("{run} --device openhaptics {missing}"),
        1,
        &["nowhere/lib.so", "OpenHaptics", "install"],
    );
    let nobody = "--device-url ws://127.0.0.1:1";
    directory.refused(
        &format!("{run} --device haply {nobody}"),
        1,
        &["127.0.0.1:1", "Inverse Service", "start it"],
    );
}

/// The limit reaches the vendor's library, the gentle one where none is given; a watchdog that is refused ends it before the
/// first force, or is told where it is done without.
#[test]
fn the_limit_and_the_watchdog_reach_the_vendors_library() {
    let directory = directory();
    let library = stand_in::Built::new("dhd");
    let run = format!(
        "run block.body --priority 0 --device dhd --device-library {} --seconds 0.1 --late-ms 10000",
        library.file().display()
    );
    let run = |more: &str, watchdog: &str| {
        let _ = fs::remove_file(directory.path("calls"));
        let mut command = directory.command(&format!("{run} {more}"));
        command.env("STAND_IN_LOG", "calls").env("STAND_IN_watchdog", watchdog);
        let output = command.output().unwrap();
        let calls = fs::read_to_string(directory.path("calls")).unwrap();
        (output.status.code(), said(&output), calls)
    };
    for (more, limit) in [("", "max_force(3, 5)"), ("--force-max-n 0.5", "max_force(0.5, 5)")] {
        let (code, said, calls) = run(more, "0");
        assert_eq!(code, Some(0), "{said}");
        let order = ["open(0)", "expert()", "watchdog(160, 5)", limit, "enable(1, 5)", "close(5)"];
        let places = order.map(|call| calls.lines().position(|c| c == call).expect(call));
        assert!(places.is_sorted(), "{calls}");
    }
    let (code, said, calls) = run("", "-1");
    assert!(code == Some(1) && said.contains("--without-device-watchdog"), "{said}");
    assert!(!calls.contains("enable(1"), "{calls}");
    let (code, said, calls) = run("--without-device-watchdog", "-1");
    assert!(code == Some(0) && said.contains("nothing takes the force off"), "{said}");
    assert!(calls.contains("enable(1, 5)"));
    let (code, said, calls) = run("--without-device-watchdog --strict", "-1");
    assert!(code == Some(3) && said.contains("--strict: omega.3: its watchdog can't be armed"), "{said}");
    assert!(!calls.contains("enable(1"), "{calls}");
}

/// What the system refuses ends it where that is asked for, before anything is rendered; else it is told before it begins. Both
/// only where something is refused, which is so wherever no rights were given.
#[test]
fn what_could_not_be_had_is_told_first_or_an_error() {
    let directory = directory();
    let run = "run block.body --device simulated --intent intent.toml --seconds 0.1 --soft-start-s 0.05 --late-ms 10000";
    let output = directory.run(run);
    let refused = said(&output).contains("was refused");
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let output = directory.run(&format!("{run} --strict --record a.rec"));
    assert_eq!(output.status.code(), Some(if refused { 3 } else { 0 }), "{}", said(&output));
    if refused {
        assert!(said(&output).contains("--strict: 3D Systems Touch: "), "{}", said(&output));
        assert!(!directory.path("a.rec").exists());
    }
    // A body that is as stiff as no Touch is, by the longer way that it is seen on.
    let output = directory.run(&format!("{run} --priority 0 --scale 10"));
    assert!(said(&output).contains("(with a scale of 10); the device holds 400 N/m"), "{}", said(&output));
}

/// An option that would do nothing is an error, and says why.
#[test]
fn options_that_do_not_apply_are_refused() {
    let directory = directory();
    for (args, words) in [
        ("--device haply --intent press", ["--intent", "simulated device"]),
        ("--device dhd --hand arm", ["--hand", "simulated device"]),
        ("--device simulated:omega --preset touch", ["--preset", "without a name"]),
        ("--device simulated --device-url ws://127.0.0.1:1", ["--device-url", "haply"]),
        ("--device dhd --haply-force-key values", ["--haply-force-key", "haply"]),
        ("--device simulated --device-library a.so", ["--device-library", "dhd"]),
        ("--device haply --without-device-watchdog", ["--without-device-watchdog", "dhd"]),
        ("--device simulated --virtual-time --priority 50", ["--priority", "virtual time"]),
        ("--device simulated --virtual-time --late-ms 5", ["--late-ms", "virtual time"]),
        ("--device simulated --virtual-time --strict", ["--strict", "virtual time"]),
        ("--device simulated --virtual-time --body-in file", ["--body-in", "virtual time"]),
        ("--device simulated --virtual-time --json --stream-hz 5", ["--stream-hz", "virtual time"]),
    ] {
        directory.refused(&format!("run block.body --seconds 5 {args}"), 1, &words);
    }
    directory.refused("run block.body --device simulated --stream-hz 5", 2, &["--json"]);
    directory.refused("run block.body", 2, &["--device"]);
}

/// The file says what the options would; an option goes before it; what it can't mean is refused with its line.
#[test]
fn settings_come_from_a_file_and_options_go_before_it() {
    let directory = directory();
    let file = "device = \"simulated:omega\"\nmotion = \"intent.toml\"\nseconds = 0.4\nrecord = \"a.rec\"\n\
                [safety]\nforce_max_n = 0.7\nsoft_start_s = 0.05\nsilence_s = 1.0\n[patience]\nlate_s = 10\npose_s = 10\n\
                [real_time]\nlock_memory = false\n";
    directory.write("run.toml", file);
    let output = directory.done("run block.body --config run.toml --priority 0 --json --stream-hz 100");
    let last = &told(&output, 1)[0];
    assert_eq!((&last["device"], &last["end_kind"]), (&"Force Dimension omega".into(), &"done".into()));
    let text = String::from_utf8(output.stdout).unwrap();
    let states: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .filter(|line: &Value| line["position_m"].is_array())
        .collect();
    assert!(states.len() > 5 && states.iter().all(|s| s["time_s"].is_f64()), "{text}");
    let (records, _) = directory.records("a.rec");
    let most = records.iter().map(|r| DVec3::from_array(r.command_force_n).length()).fold(0.0, f64::max);
    assert!(most > 0.5 && most < 0.7001, "{most}");
    let again =
        "run block.body --config run.toml --priority 0 --json --force-max-n 0.2 --record b.rec --seconds 0.3";
    assert_eq!(told(&directory.done(again), 1)[0]["end_kind"], "done");
    let (records, _) = directory.records("b.rec");
    let most = records.iter().map(|r| DVec3::from_array(r.command_force_n).length()).fold(0.0, f64::max);
    assert!(most > 0.1 && most < 0.2001 && records.len() < 310, "{most}");

    for (text, words) in [
        ("rate = 1000\n", ["wrong.toml:1", "rate"]),
        ("[safety]\nforce_max = 1\n", ["wrong.toml", "force_max"]),
        ("device = \"pencil\"\n", ["wrong.toml:1", "replay:FILE"]),
        ("rate_hz = 1\n", ["rate_hz", "from 10"]),
        ("\n[real_time]\npriority = \"high\"\n", ["wrong.toml:3", "high"]),
        ("clock = \"virtual\"\ndevice = \"haply\"\n", ["--virtual-time", "simulated"]),
    ] {
        directory.write("wrong.toml", text);
        directory.refused("run block.body --config wrong.toml", 1, &words);
    }
    directory.refused("run block.body --config none.toml", 1, &["none.toml"]);
}

/// A loop that fails on its way has an exit status of its own.
#[test]
fn a_watchdog_that_trips_is_told_from_a_wrong_option() {
    let directory = directory();
    let output = directory.run(
        "run block.body --device simulated --intent intent.toml --priority 0 --seconds 5 --stale-ms 10000 \
         --late-ms 1 --spin-us 0 --rate-hz 20000 --json",
    );
    // No machine keeps a millisecond for five seconds at 20 kHz without rights; one that does has nothing to tell.
    let last = &told(&output, 1)[0];
    if last["end_kind"] == "late" {
        assert_eq!(output.status.code(), Some(4), "{}", said(&output));
    } else {
        assert_eq!((&last["end_kind"], output.status.code()), (&"done".into(), Some(0)));
    }
}

#[test]
fn what_is_attached_is_told_with_what_nobody_verified() {
    let directory = directory();
    let library = stand_in::Built::new("dhd");
    let nobody = "--device-url ws://127.0.0.1:1";
    let devices = |more: &str| -> Value {
        let mut command = directory.command(&format!("devices --json {nobody} {more}"));
        let output = command.env("STAND_IN_LOG", "calls").output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let none = devices("");
    assert_eq!(none["devices"].as_array().unwrap().len(), 0, "{none}");
    let unreached: Vec<&str> =
        none["unreached"].as_array().unwrap().iter().filter_map(|u| u["device"].as_str()).collect();
    assert_eq!(unreached, ["dhd:0", "openhaptics", "haply"]);
    assert!(none["unreached"][2]["reason"].as_str().unwrap().contains("Inverse Service"), "{none}");
    let one = devices(&format!("--device-library {}", library.file().display()));
    let found = &one["devices"][0];
    assert_eq!((&found["device"], &found["name"]), (&"dhd:0".into(), &"omega.3".into()), "{one}");
    // The device's own, not the limit of a session.
    assert_eq!(found["max_force_n"], 12.0, "{one}");
    let unverified = found["unverified"].as_array().unwrap();
    assert!(unverified.iter().any(|u| u["figure"] == "mass_kg" && u["because"].is_string()), "{one}");
    // Opened and closed, and no force but zero.
    let calls = fs::read_to_string(directory.path("calls")).unwrap();
    // Others were looked for after it.
    let last = calls.lines().rfind(|call| *call != "count()").unwrap_or_default();
    assert!(calls.contains("open(0)") && last.starts_with("close("), "{calls}");
    for call in calls.lines().filter(|call| call.starts_with("force(")) {
        assert!(call.starts_with("force(0, 0, 0") || call.starts_with("force(-0, -0, -0"), "{call}");
    }
    assert!(
        String::from_utf8(directory.done(&format!("devices {nobody}")).stdout)
            .unwrap()
            .contains("no device answers")
    );
}

#[test]
fn shells_and_manuals_know_every_command() {
    let directory = directory();
    for shell in ["bash", "fish", "zsh"] {
        let script = String::from_utf8(directory.done(&format!("completions {shell}")).stdout).unwrap();
        assert!(script.contains("precompute") && script.contains("friction-scale"), "{shell}");
    }
    directory.done("man -o man1");
    for name in ["palpate", "palpate-run", "palpate-devices", "palpate-fit"] {
        let page = fs::read_to_string(directory.path(&format!("man1/{name}.1"))).unwrap();
        assert!(page.starts_with(".ie") || page.contains(".TH"), "{name}: {page}");
    }
    let page = fs::read_to_string(directory.path("man1/palpate-run.1")).unwrap();
    assert!(page.contains("Examples") && page.contains("force"), "{page}");
    directory.refused("man -o block.body", 1, &["block.body"]);
    directory.refused("completions tcsh", 2, &["tcsh"]);
}

#[test]
fn wrong_options_are_refused_before_anything_moves() {
    let directory = directory();
    directory.write("there.rec", "somebody's");
    let run = "run block.body --priority 0 --device simulated";
    for (more, code, words) in [
        ("--force-max-n=-1", 1, &["force_max_n", "-1"][..]),
        ("--force-max-n nan", 1, &["force_max_n"]),
        ("--slew-n-per-s 10", 1, &["slew_n_per_s", "at least 1500 N/s"]),
        ("--soft-start-s=-1", 1, &["soft_start_s"]),
        ("--damping-n-s-per-m 1000", 1, &["damping_n_s_per_m"]),
        ("--scale 0", 1, &["scale"]),
        ("--rotation 0,0,0,0", 1, &["rotation"]),
        ("--offset-mm 1,2", 2, &["--offset-mm", "3 numbers"]),
        ("--clutch-button 40", 1, &["clutch"]),
        ("--record there.rec", 1, &["there.rec", "there already"]),
        ("--record block.body", 1, &["block.body", "input"]),
        ("--record a.csv", 1, &["a.csv", "palpate export"]),
        ("--record a.rec --record b.rec", 1, &["as many files as devices"]),
        ("--record none/a.rec", 1, &["none/a.rec"]),
        ("--device simulated --virtual-time", 1, &["--virtual-time", "one simulated device"]),
        ("--device replay:none.rec", 1, &["none.rec"]),
        ("--device replay:there.rec", 1, &["there.rec"]),
        ("--device pencil", 2, &["pencil", "replay:FILE"]),
        ("--device dhd:first", 2, &["first"]),
        ("--rate-hz 1e6", 1, &["--rate-hz"]),
        ("--patch-elements 0", 1, &["--patch-elements 0"]),
        ("--late-ms 0", 1, &["--late-ms 0"]),
        ("--stale-ms nan", 1, &["--stale-ms"]),
        ("--silence-ms 11", 1, &["--silence-ms 11", "10 ms"]),
        ("--silence-ms 0.5", 1, &["--silence-ms 0.5"]),
        ("--spin-us=-1", 1, &["--spin-us"]),
    ] {
        // Where it is not refused it would go on for long.
        directory.refused(&format!("{run} --seconds 5 {more}"), code, words);
    }
    directory.refused("run block.body --device simulated --priority 99", 1, &["--priority 99"]);
    directory.refused("run none.body --device simulated --priority 0", 1, &["none.body"]);
    assert_eq!(fs::read_to_string(directory.path("there.rec")).unwrap(), "somebody's");
    for name in ["a.rec", "b.rec", "a.csv"] {
        assert!(!directory.path(name).exists(), "{name}");
    }
}
