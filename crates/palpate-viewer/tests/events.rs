//! A thousand random sequences of what a user can do, through the window's own contents, without a display: mouse, keys, drops of
//! good and bad files, sizes. Nothing panics, no error goes without saying what to do, and a session is there whenever one was.

mod common;

use eframe::egui::{self, Key, Modifiers, PointerButton, pos2, vec2};
use palpate_viewer::gallery::Example;
use palpate_viewer::{Event, Settings, Viewer, ui};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        fs::read(&self.0).map_err(|e| e.to_string())
    }
}

const KEYS: [Key; 37] = [
    Key::Space,
    Key::R,
    Key::P,
    Key::T,
    Key::W,
    Key::A,
    Key::S,
    Key::D,
    Key::Q,
    Key::E,
    Key::F,
    Key::C,
    Key::X,
    Key::V,
    Key::M,
    Key::I,
    Key::O,
    Key::U,
    Key::L,
    Key::H,
    Key::N,
    Key::G,
    Key::Z,
    Key::Y,
    Key::Plus,
    Key::Minus,
    Key::Comma,
    Key::Period,
    Key::Num1,
    Key::Num6,
    Key::ArrowLeft,
    Key::ArrowUp,
    Key::Tab,
    Key::Enter,
    Key::Escape,
    Key::F1,
    Key::Questionmark,
];

struct Driven {
    ctx: egui::Context,
    viewer: Viewer,
    time_s: f64,
    size: egui::Vec2,
}

impl Driven {
    fn new() -> Self {
        let ctx = egui::Context::default();
        ui::set_up(&ctx);
        Driven { ctx, viewer: Viewer::default(), time_s: 0.0, size: vec2(1000.0, 700.0) }
    }

    /// Another viewer, in a window that remembers nothing but its letters, which take long to be drawn.
    fn begin(&mut self, viewer: Viewer) {
        self.ctx.memory_mut(|memory| *memory = egui::Memory::default());
        (self.viewer, self.size) = (viewer, vec2(1000.0, 700.0));
    }

    fn frame(&mut self, events: Vec<egui::Event>, dropped: Option<PathBuf>, modifiers: Modifiers) {
        let input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(pos2(0.0, 0.0), self.size)),
            time: Some(self.time_s),
            events: std::iter::once(egui::Event::ModifiersChanged(modifiers)).chain(events).collect(),
            focused: true,
            dropped_files: dropped
                .into_iter()
                .map(|p| Arc::new(Dropped(p)) as egui::DroppedFileHandle)
                .collect(),
            ..Default::default()
        };
        self.time_s += 0.02;
        self.viewer.tick(self.time_s);
        let mut happened = Vec::new();
        let viewer = &self.viewer;
        let mut output = self.ctx.run_ui(input, |ui| happened.extend(ui::show(viewer, ui)));
        output.textures_delta.clear();
        self.viewer.update(happened);
        if let Some(message) = self.viewer.message() {
            let says = [
                "give ",
                "drop ",
                "open ",
                "choose ",
                "check ",
                "make ",
                "record ",
                "export ",
                "take ",
                "start ",
                "read ",
                "goes on",
                "install ",
                "hear ",
                "or a damaged one",
            ];
            assert!(says.iter().any(|w| message.text.contains(w)), "{message:?} says not what to do");
        }
    }

    fn any(&mut self, random: &mut Random, files: &[PathBuf]) {
        let at = pos2(random.unit() * self.size.x, random.unit() * self.size.y);
        let modifiers = match random.below(8) {
            0 => Modifiers::SHIFT,
            1 => Modifiers::COMMAND,
            _ => Modifiers::NONE,
        };
        match random.below(10) {
            0..=3 => {
                let key = KEYS[random.below(KEYS.len())];
                let pressed =
                    |pressed| egui::Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
                self.frame(vec![pressed(true), pressed(false)], None, modifiers);
            }
            4 => self.frame(vec![egui::Event::PointerMoved(at)], None, modifiers),
            5 | 6 => {
                let button = [PointerButton::Primary, PointerButton::Secondary, PointerButton::Middle]
                    [random.below(3)];
                let press = |pos, pressed| egui::Event::PointerButton { pos, button, pressed, modifiers };
                let to = at + vec2(random.unit() - 0.5, random.unit() - 0.5) * 200.0;
                self.frame(vec![egui::Event::PointerMoved(at), press(at, true)], None, modifiers);
                self.frame(vec![egui::Event::PointerMoved(to)], None, modifiers);
                self.frame(vec![press(to, false)], None, modifiers);
            }
            7 => {
                let unit = egui::MouseWheelUnit::Point;
                let delta = vec2(0.0, random.unit() * 400.0 - 200.0);
                let phase = egui::TouchPhase::Move;
                self.frame(
                    vec![egui::Event::MouseWheel {
                        unit,
                        delta,
                        phase,
                        source: egui::MouseWheelSource::Wheel,
                        modifiers,
                    }],
                    None,
                    modifiers,
                );
            }
            8 => {
                let file = files[random.below(files.len())].clone();
                self.frame(vec![], Some(file), modifiers);
            }
            _ => {
                self.size = vec2(40.0 + random.unit() * 1600.0, 40.0 + random.unit() * 1000.0);
                self.frame(vec![], None, modifiers);
            }
        }
    }
}

/// Good and bad ones.
fn files(folder: &Path) -> Vec<PathBuf> {
    let (body, _) = common::saved(Example::Ring, folder);
    let (other, _) = common::saved(Example::Cylinder, folder);
    let recording = folder.join("ring.rec");
    common::write_recording(&body, &recording);
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let (whole, recorded) = (fs::read(&body).unwrap(), fs::read(&recording).unwrap());
    vec![
        write("cut.body", &whole[..whole.len() / 3]),
        write("none.body", b""),
        write("cut.rec", &recorded[..recorded.len() / 2]),
        write("torn.rec", &recorded[..100]),
        write("letter.txt", b"Dear body,"),
        write("wrong.toml", b"[body]\nshape = 3\n"),
        write("empty.obj", b""),
        write("four.obj", b"v 0 0 0\nv 40 0 0\nv 0 40 0\nv 0 0 40\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"),
        folder.join("not there"),
        folder.to_path_buf(),
        body,
        other,
        recording,
    ]
}

#[test]
fn a_thousand_random_sequences() {
    let folder = tempfile::tempdir().unwrap();
    let files = files(folder.path());
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    std::thread::scope(|scope| {
        for core in 0..cores {
            let files = &files;
            scope.spawn(move || {
                let mut driven = Driven::new();
                (core..1000).step_by(cores as usize).for_each(|seed| sequence(&mut driven, seed, files));
            });
        }
    });
}

fn sequence(driven: &mut Driven, seed: u64, files: &[PathBuf]) {
    let mut random = Random(seed);
    let mut viewer = Viewer::default();
    // Sessions have threads of their own: every tenth sequence has them.
    viewer.touches = seed.is_multiple_of(10);
    driven.begin(viewer);
    if !seed.is_multiple_of(3) {
        driven.viewer.update([Event::Open(files[10 + random.below(2)].clone())]);
        driven.viewer.finish_work().unwrap();
    }
    for _ in 0..12 {
        driven.any(&mut random, files);
        let viewer = &driven.viewer;
        // Whatever happened, what was there is there, or was left on purpose.
        if let Some(shown) = viewer.shown() {
            assert!(shown.tool_m().is_finite(), "{seed}");
        }
        assert!(viewer.scene().is_none() == viewer.subject().is_none(), "{seed}");
    }
    if let Some(message) = driven.viewer.message() {
        assert!(!message.title.is_empty() && message.text.len() > 10, "{seed}: {message:?}");
    }
    // It can still be used; there may be nothing to hear it with.
    driven.viewer.update([
        Event::Change(Settings { sound: false, ..*driven.viewer.settings() }),
        Event::Dismiss,
        Event::Dismiss,
        Event::Dismiss,
        Event::Open(files[10].clone()),
        // Where a simulation is under way it was asked.
        Event::Instead,
    ]);
    driven.viewer.finish_work().unwrap();
    driven.frame(vec![], None, Modifiers::NONE);
    assert!(driven.viewer.subject().is_some_and(|s| s.name == "ring.body"), "{seed}");
    if driven.viewer.touches {
        assert!(driven.viewer.touch().is_some_and(|t| !t.is_over()), "{seed}: {:?}", driven.viewer.message());
    }
}

/// The space bar stops whatever has the focus: a button, a number that is being typed, a dialogue.
#[test]
fn the_space_bar_stops_whatever_has_the_focus() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = common::saved(Example::Ring, folder.path());
    let space = || {
        let key = |pressed| egui::Event::Key {
            key: Key::Space,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers: Modifiers::NONE,
        };
        vec![key(true), egui::Event::Text(" ".into()), key(false)]
    };
    let tab = || egui::Event::Key {
        key: Key::Tab,
        physical_key: None,
        pressed: true,
        repeat: false,
        modifiers: Modifiers::NONE,
    };
    let mut driven = Driven::new();
    for tabs in [0, 1, 2, 9, 14, 20, 27] {
        driven.begin(Viewer::default());
        driven.viewer.update([Event::Open(path.clone())]);
        driven.viewer.finish_work().unwrap();
        for _ in 0..tabs {
            driven.frame(vec![tab()], None, Modifiers::NONE);
        }
        if tabs == 9 {
            driven.viewer.update([Event::Help]);
        }
        assert!(driven.viewer.touch().is_some_and(|t| !t.is_stopped()));
        let before = *driven.viewer.settings();
        driven.frame(space(), None, Modifiers::NONE);
        assert!(driven.viewer.touch().is_some_and(|t| t.is_stopped()), "after {tabs} tabs");
        assert_eq!(*driven.viewer.settings(), before, "the space bar clicked something after {tabs} tabs");
    }
}
