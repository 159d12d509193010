//! The window itself, on a display without a screen (Xvfb): the mouse presses, drags until the contact slips, and releases; what
//! the window shows meanwhile, picture by picture, has the digits of `palpate trace` of the session's recording.
//!
//! `cargo test -p palpate-viewer --test window`. It needs Xvfb and xdotool (Debian's packages xvfb and xdotool) and something to draw
//! with; where one of them is missing, it says so and tests nothing. A window wants the program's first thread, so this is a
//! program: started by itself with `--window`, it is the window.

mod common;

use glam::DVec3;
use palpate_viewer::command::{Request, open};
use palpate_viewer::gallery::Example;
use palpate_viewer::offscreen::render_state;
use std::fs::{File, read_to_string};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// By which it is chosen among others.
const NAME: &str = "window: press_drag_slip_release";
/// No machine is so busy.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--window", body, recording, log] => window(body.into(), recording.into(), Path::new(log)),
        // `cargo test` passes on what was given for all tests.
        ref words if words.contains(&"--list") => println!("{NAME}: test"),
        ref words if words.iter().any(|w| !w.starts_with('-') && !NAME.contains(w)) => {}
        _ => match missing() {
            Some(what) => println!("skipped: {what}"),
            None => press_drag_slip_release(),
        },
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

/// The window, until its standard input ends. A line in `log` for each picture: the bits of the period's time, and what is told.
fn window(body: PathBuf, recording: PathBuf, log: &Path) {
    let ends = Arc::new(AtomicBool::new(false));
    let asked = ends.clone();
    std::thread::spawn(move || {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        asked.store(true, Ordering::Relaxed);
    });
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

fn press_drag_slip_release() {
    let folder = tempfile::tempdir().unwrap();
    let (body, _) = common::saved(Example::Pad, folder.path());
    let [recording, log] = ["mouse.rec", "log"].map(|name| folder.path().join(name));

    let mut server = Command::new("Xvfb");
    server.args(["-displayfd", "1", "-screen", "0", "1400x900x24", "-nolisten", "tcp"]);
    let mut server = Started(server.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap());
    let mut number = String::new();
    BufReader::new(server.0.stdout.take().unwrap()).read_line(&mut number).unwrap();
    let display = format!(":{}", number.trim());

    let mut window = Command::new(std::env::current_exe().unwrap());
    window.arg("--window").args([&body, &recording, &log]).stdin(Stdio::piped());
    window
        .env("DISPLAY", &display)
        .env("XDG_RUNTIME_DIR", folder.path())
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET");
    let mut window = Started(window.spawn().unwrap());
    let xdotool = |words: &[&str]| {
        let output = Command::new("xdotool").env("DISPLAY", &display).args(words).output().unwrap();
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
    };
    until("the window", || {
        if let Some(ended) = window.0.try_wait().unwrap() {
            panic!("the window has ended: {ended}");
        }
        xdotool(&["search", "--onlyvisible", "--name", "^palpate$"])
    });
    let last = || read_to_string(&log).ok()?.lines().last()?.split('\t').next().map(String::from);
    let mut mouse = |words: &[&str]| xdotool(words).unwrap();
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
    drop(window.0.stdin.take());
    let ended = until("the end", || window.0.try_wait().unwrap());
    assert!(ended.success(), "{ended}");

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
