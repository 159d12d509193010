//! The window itself, on a display without a screen (Xvfb): the mouse presses, drags until the contact slips, and releases; what
//! the window shows meanwhile, picture by picture, has the digits of `palpate trace` of the session's recording. And a session that is
//! watched has its core for itself, and ends though its window is hidden.
//!
//! `cargo test -p palpate-viewer --test window`. It needs Xvfb and xdotool (Debian's packages xvfb and xdotool) and something to draw
//! with; where one of them is missing, it says so and tests nothing. A window wants the program's first thread, so this is a
//! program: started by itself with `--window` or `--watch`, it is the window.

mod common;

use glam::DVec3;
use palpate::runtime::{PreparedSession, RealTime, SessionConfig};
use palpate_viewer::command::{Request, open, watch};
use palpate_viewer::gallery::Example;
use palpate_viewer::offscreen::render_state;
use palpate_viewer::work::Opened;
use std::collections::BTreeSet;
use std::fs::{File, read_to_string};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// With the names by which they are chosen.
const TESTS: [(&str, fn()); 2] = [
    ("window: press_drag_slip_release", press_drag_slip_release),
    (
        "window: a_watched_session_has_its_core_and_ends_though_hidden",
        a_watched_session_has_its_core_and_ends_though_hidden,
    ),
];
/// No machine is so busy.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--window", body, recording, log] => window(body.into(), recording.into(), Path::new(log)),
        ["--watch", body, log] => watched(Path::new(body), Path::new(log)),
        // `cargo test` passes on what was given for all tests.
        ref words if words.contains(&"--list") => TESTS.iter().for_each(|(name, _)| println!("{name}: test")),
        ref words => {
            let is_chosen = |name: &str| words.iter().all(|w| w.starts_with('-') || name.contains(w));
            for (name, test) in TESTS.iter().filter(|(name, _)| is_chosen(name)) {
                match missing() {
                    Some(what) => println!("{name}: skipped: {what}"),
                    None => test(),
                }
            }
        }
    }
}

fn missing() -> Option<String> {
    let is_there = |name: &str, word: &str| {
        Command::new(name).arg(word).stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
    };
    if !is_there("Xvfb", "-help") {
        return Some("no Xvfb here; on Debian and Ubuntu install xvfb".into());
    }
    if !is_there("xdotool", "version") {
        return Some("no xdotool here; on Debian and Ubuntu install xdotool".into());
    }
    render_state(1, true).err().map(|e| e.to_string())
}

/// Whether standard input has ended.
fn input_ends() -> Arc<AtomicBool> {
    let ends = Arc::new(AtomicBool::new(false));
    let asked = ends.clone();
    std::thread::spawn(move || {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        asked.store(true, Ordering::Relaxed);
    });
    ends
}

/// The window, until its standard input ends. A line in `log` for each picture: the bits of the period's time, and what is told.
fn window(body: PathBuf, recording: PathBuf, log: &Path) {
    let ends = input_ends();
    let mut log = File::create(log).unwrap();
    let request = Request {
        body: Some(body),
        camera: Some("top".parse().unwrap()),
        record: Some(recording),
        ..Request::default()
    };
    let mut first = None;
    let each = move |viewer: &palpate_viewer::Viewer| {
        if let Some(shown) = viewer.shown() {
            let place = shown.contact.map(|c| DVec3::from_array(c.position_m));
            first = place.map(|place| first.unwrap_or(place));
            let way = place.zip(first).map_or(0.0, |(place, first)| place.distance(first));
            let contact = match shown.contact {
                // Since it was touched: where pictures are seldom, each may be of a moment at rest.
                Some(_) if way > 3e-3 => "slipped",
                Some(c) if c.delta_z_m > 1e-3 => "pressed",
                Some(_) => "touched",
                None => "free",
            };
            let told = common::told(&shown);
            writeln!(log, "{contact}\t{}\t{told:?}", shown.time_s.to_bits()).unwrap();
        }
        ends.load(Ordering::Relaxed)
    };
    open(&request, Box::new(each)).unwrap();
}

/// The window on a session, until standard input ends. A line in `log` for each picture: the window's threads that may use the haptic
/// thread's core, after a colon.
fn watched(body: &Path, log: &Path) {
    let ends = input_ends();
    let opened = Opened::read(body).unwrap();
    let real_time = RealTime { priority: None, lock_memory: false, ..RealTime::default() };
    let mut config = SessionConfig { motion: "hold".into(), real_time, ..SessionConfig::default() };
    (config.seconds, config.patience.late_s, config.patience.finder_s) = (Some(1e4), 10.0, 10.0);
    let session = PreparedSession::new(opened.session_body(), config, None).unwrap();
    let before = threads();
    let mut log = File::create(log).unwrap();
    let each = move |viewer: &palpate_viewer::Viewer| {
        assert!(viewer.touch().is_some_and(|t| !t.is_over()));
        let all = threads();
        let core = all.iter().find(|t| t.name == "palpate-haptic").map(|t| t.cores.clone());
        // Those of the session are where they would be without a window, and Mesa's that write its cache choose all cores themselves.
        let is_windows = |t: &Thread| {
            let is_new = !before.iter().any(|b| b.number == t.number);
            t.number == std::process::id()
                || is_new && !t.name.starts_with("palpate-") && !t.name.contains(":disk$")
        };
        let on_it: Vec<&str> = all
            .iter()
            .filter(|t| is_windows(t) && core.as_ref().is_some_and(|core| t.cores.is_superset(core)))
            .map(|t| t.name.as_str())
            .collect();
        writeln!(log, "{} threads of {}: {}", on_it.len(), all.len(), on_it.join(" ")).unwrap();
        ends.load(Ordering::Relaxed)
    };
    let outcome = watch(opened, session, Box::new(each)).unwrap().unwrap();
    assert_eq!(outcome.report.end.to_string(), "the viewer was closed");
}

struct Thread {
    number: u32,
    name: String,
    cores: BTreeSet<u32>,
}

/// Of this process, with the cores that they may use. None where the system has no such list.
fn threads() -> Vec<Thread> {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten();
    // One that has ended meanwhile is none.
    let thread = |task: std::fs::DirEntry| {
        let status = read_to_string(task.path().join("status")).ok()?;
        let of = |key: &str| Some(status.lines().find_map(|line| line.strip_prefix(key))?.trim());
        let range = |part: &str| {
            let (from, to) = part.split_once('-').unwrap_or((part, part));
            from.parse().unwrap()..=to.parse().unwrap()
        };
        Some(Thread {
            number: of("Pid:")?.parse().ok()?,
            name: of("Name:")?.into(),
            cores: of("Cpus_allowed_list:")?.split(',').flat_map(range).collect(),
        })
    };
    tasks.flatten().filter_map(thread).collect()
}

/// Ended with the test, whatever ends that.
struct Started(Child);

impl Drop for Started {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn until<T>(what: &str, mut found: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = found() {
            return found;
        }
        assert!(Instant::now() < deadline, "{what}: not within {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A window on a display of its own.
struct Shown {
    window: Started,
    number: String,
    display: String,
    _server: Started,
}

impl Shown {
    /// This program with these words as the window.
    fn new(folder: &Path, words: &[&Path]) -> Self {
        let mut server = Command::new("Xvfb");
        server.args(["-displayfd", "1", "-screen", "0", "1400x900x24", "-nolisten", "tcp"]);
        let mut server = Started(server.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap());
        let mut number = String::new();
        BufReader::new(server.0.stdout.take().unwrap()).read_line(&mut number).unwrap();
        let display = format!(":{}", number.trim());

        let mut window = Command::new(std::env::current_exe().unwrap());
        window.args(words).stdin(Stdio::piped());
        window
            .env("DISPLAY", &display)
            .env("XDG_RUNTIME_DIR", folder)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET");
        let window = Started(window.spawn().unwrap());
        let mut shown = Shown { window, number: String::new(), display, _server: server };
        shown.number = until("the window", || {
            if let Some(ended) = shown.window.0.try_wait().unwrap() {
                panic!("the window has ended: {ended}");
            }
            shown.xdotool(&["search", "--onlyvisible", "--name", "^palpate$"])
        });
        shown
    }

    fn xdotool(&self, words: &[&str]) -> Option<String> {
        let output = Command::new("xdotool").env("DISPLAY", &self.display).args(words).output().unwrap();
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
    }

    /// Lets it end by itself.
    fn end(mut self) {
        drop(self.window.0.stdin.take());
        let ended = until("the end", || self.window.0.try_wait().unwrap());
        assert!(ended.success(), "{ended}");
    }
}

fn a_watched_session_has_its_core_and_ends_though_hidden() {
    let folder = tempfile::tempdir().unwrap();
    let (body, _) = common::saved(Example::Pad, folder.path());
    let log = folder.path().join("log");
    let shown = Shown::new(folder.path(), &[Path::new("--watch"), &body, &log]);
    let pictures = || read_to_string(&log).unwrap_or_default().lines().count();
    until("some pictures", || (pictures() > 5).then_some(()));
    shown.xdotool(&["windowunmap", "--sync", &shown.number]).unwrap();
    shown.end();
    let log = read_to_string(&log).unwrap();
    let several = std::thread::available_parallelism().is_ok_and(|cores| cores.get() > 1);
    let is_off = |line: &str| line.starts_with("0 threads");
    assert!(!several || !cfg!(target_os = "linux") || log.lines().all(is_off), "{log}");
    println!("{}", log.lines().last().unwrap_or_default());
}

fn press_drag_slip_release() {
    let folder = tempfile::tempdir().unwrap();
    let (body, _) = common::saved(Example::Pad, folder.path());
    let [recording, log] = ["mouse.rec", "log"].map(|name| folder.path().join(name));
    let shown = Shown::new(folder.path(), &[Path::new("--window"), &body, &recording, &log]);
    let last = || read_to_string(&log).ok()?.lines().last()?.split('\t').next().map(String::from);
    let mut mouse = |words: &[&str]| shown.xdotool(words).unwrap();
    // Between the panels, over the middle of the pad.
    let move_to = |x: i32| ["mousemove".into(), x.to_string(), "460".into()];
    let to = |x: i32, mouse: &mut dyn FnMut(&[&str]) -> String| {
        mouse(&move_to(x).each_ref().map(String::as_str));
    };
    until("a picture", last);
    to(600, &mut mouse);
    until("nothing is touched", || last().filter(|word| word == "free"));
    mouse(&["mousedown", "1"]);
    until("a press", || last().filter(|word| word == "pressed" || word == "slipped"));
    let mut step = 0i32;
    until("a slip", || {
        // There and back, ever again: slowly enough for a hand.
        step += 1;
        to(600 + (step % 240 - 120).abs() - 120, &mut mouse);
        last().filter(|word| word == "slipped")
    });
    mouse(&["mouseup", "1"]);
    until("a release", || last().filter(|word| word == "free"));
    shown.end();

    let traced = common::trace(&body, &recording);
    let (mut pictures, mut touching) = (0, 0);
    for line in read_to_string(&log).unwrap().lines() {
        let [contact, time, told] = line.split('\t').collect::<Vec<_>>()[..] else { panic!("{line}") };
        // The engine is not asked before the first patch has come.
        let Some(period) = traced.get(&time.parse().unwrap()) else { continue };
        assert_eq!(told, format!("{period:?}"));
        pictures += 1;
        touching += u32::from(contact != "free");
    }
    let [periods, in_contact, slipping] = common::compare(&body, &recording);
    assert!(touching > 0 && in_contact > slipping && slipping > 0, "{touching} {in_contact} {slipping}");
    println!(
        "{pictures} pictures, {touching} of them in contact, and {periods} periods have the digits of palpate trace \
         ({in_contact} in contact, {slipping} slipping)"
    );
}
