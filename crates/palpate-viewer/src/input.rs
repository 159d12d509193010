//! Keys and the mouse, as events.

use crate::camera::StandardView;
use crate::colouring::Colouring;
use crate::palette::Theme;
use crate::scene::Section;
use crate::settings::Settings;
use crate::state::{Event, Viewer};
use eframe::egui::{self, Key, Modifiers, PointerButton};
use glam::DVec2;

/// What keys do, for the help: (keys, what).
pub const KEYS: [(&str, &str); 25] = [
    ("Space", "stop: no force, whatever has the focus"),
    ("R", "start again, with the mouse as tool"),
    ("P", "pause, or go on"),
    ("T", "press, or leave off"),
    ("W A S D", "move the tool over the body"),
    ("Q  E", "press less deep, or deeper"),
    ("Arrows", "turn the view"),
    ("Shift + arrows", "move the view"),
    ("+  −", "nearer, farther"),
    ("F", "see all of the body"),
    ("1 … 7", "oblique, front, back, left, right, top, bottom"),
    ("C  Shift + C", "next colouring, the one before"),
    ("X", "cut the body, or not"),
    ("V", "next axis of the cut"),
    ("M", "elements' edges"),
    ("I", "interpolation of coordinates on or off"),
    ("O", "interpolation of responses on or off"),
    ("U", "next slip rule"),
    ("H", "hear how fast the force changes, or not"),
    ("L", "play the recording, or stop"),
    (",  .", "one period back, one on"),
    ("Ctrl + Z, Ctrl + Y", "undo, redo"),
    ("N", "light or dark"),
    ("G", "to the examples"),
    ("F1  ?  Esc", "this help; away with it"),
];

/// What the mouse does, for the help.
pub const MOUSE: [(&str, &str); 6] = [
    ("Move", "the hand hovers over the body"),
    ("Left button", "press, and drag along the surface"),
    ("Wheel while pressing", "deeper, less deep"),
    ("Right button, or Shift + left", "turn the view"),
    ("Middle button, or Ctrl + left", "move the view"),
    ("Wheel", "nearer, farther"),
];

/// A key press turns the view by this, rad.
const TURN: f64 = 0.12;
/// A key press moves the view or the tool by this, in parts of the view.
const STEP: f64 = 0.04;

/// The space bar, before anything else can have it: a focused button would be clicked by it, a field would take it as text.
pub fn stop(ctx: &egui::Context) -> Option<Event> {
    ctx.input_mut(|i| {
        let is_space = |e: &egui::Event| matches!(e, egui::Event::Key { key: Key::Space, pressed: true, .. });
        let pressed = i.events.iter().any(is_space);
        i.events.retain(|e| match e {
            egui::Event::Key { key: Key::Space, .. } => false,
            egui::Event::Text(text) => text != " ",
            _ => true,
        });
        pressed.then_some(Event::Stop)
    })
}

/// All other keys; none while a number is being typed.
pub fn keys(ctx: &egui::Context, viewer: &Viewer) -> Vec<Event> {
    let mut events = Vec::new();
    let settings = *viewer.settings();
    let is_typing = ctx.text_edit_focused();
    let has_focus = ctx.memory(|m| m.focused().is_some());
    ctx.input_mut(|i| {
        let mut press = |modifiers: Modifiers, key: Key| i.consume_key(modifiers, key);
        if press(Modifiers::NONE, Key::Escape) {
            events.push(Event::Dismiss);
        }
        if press(Modifiers::NONE, Key::F1) {
            events.push(Event::Help);
        }
        if is_typing {
            return;
        }
        if press(Modifiers::SHIFT, Key::Questionmark) || press(Modifiers::NONE, Key::Questionmark) {
            events.push(Event::Help);
        }
        if press(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z) || press(Modifiers::COMMAND, Key::Y) {
            events.push(Event::Redo);
        }
        if press(Modifiers::COMMAND, Key::Z) {
            events.push(Event::Undo);
        }
        if press(Modifiers::SHIFT, Key::C) {
            events.push(Event::Change(next_colouring(settings, -1)));
        }
        let arrows = [
            (Key::ArrowLeft, DVec2::NEG_X),
            (Key::ArrowRight, DVec2::X),
            (Key::ArrowUp, DVec2::Y),
            (Key::ArrowDown, DVec2::NEG_Y),
        ];
        // A slider that has the focus moves by arrows.
        for (key, way) in arrows.into_iter().filter(|_| !has_focus) {
            if press(Modifiers::SHIFT, key) {
                events.push(Event::Pan(way * STEP));
            }
            if press(Modifiers::NONE, key) {
                events.push(Event::Orbit(way * TURN));
            }
        }
        let plain = [
            (Key::R, Event::Start),
            (Key::P, Event::Pause),
            (Key::T, Event::Press(!viewer.is_pressing())),
            (Key::W, Event::Nudge(DVec2::Y * STEP)),
            (Key::A, Event::Nudge(DVec2::NEG_X * STEP)),
            (Key::S, Event::Nudge(DVec2::NEG_Y * STEP)),
            (Key::D, Event::Nudge(DVec2::X * STEP)),
            (Key::Q, Event::Deepen(1.0 / 1.1)),
            (Key::E, Event::Deepen(1.1)),
            (Key::Plus, Event::Zoom(1.15)),
            (Key::Equals, Event::Zoom(1.15)),
            (Key::Minus, Event::Zoom(1.0 / 1.15)),
            (Key::F, Event::Fit),
            (Key::L, Event::Play),
            (Key::Comma, Event::Frames(-1)),
            (Key::Period, Event::Frames(1)),
            (Key::G, Event::Gallery),
            (Key::C, Event::Change(next_colouring(settings, 1))),
            (Key::X, Event::Change(cut(settings))),
            (Key::V, Event::Change(next_axis(settings))),
            (Key::M, Event::Change(edges(settings))),
            (Key::N, Event::Change(Settings { theme: other(settings.theme), ..settings })),
            (Key::I, Event::Change(Settings { coordinates: !settings.coordinates, ..settings })),
            (Key::O, Event::Change(Settings { responses: !settings.responses, ..settings })),
            (Key::U, Event::Change(next_rule(viewer))),
            (Key::H, Event::Change(Settings { sound: !settings.sound, ..settings })),
        ];
        let views = [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7];
        let views = views.into_iter().zip(StandardView::ALL.map(Event::Look));
        events.extend(
            plain.into_iter().chain(views).filter_map(|(key, e)| press(Modifiers::NONE, key).then_some(e)),
        );
    });
    events
}

/// The other one.
pub fn other(theme: Theme) -> Theme {
    if theme == Theme::Light { Theme::Dark } else { Theme::Light }
}

fn next_colouring(settings: Settings, by: isize) -> Settings {
    let all = Colouring::ALL;
    let at = all.iter().position(|c| *c == settings.colouring).unwrap_or(0) as isize;
    let next = (at + by).rem_euclid(all.len() as isize) as usize;
    Settings { colouring: all[next], ..settings }
}

fn cut(settings: Settings) -> Settings {
    let section = if settings.section.is_some() { None } else { Some(Section::default()) };
    Settings { section, ..settings }
}

fn next_axis(settings: Settings) -> Settings {
    let next = |s: Section| Section { axis: (s.axis + 1) % 3, ..s };
    Settings { section: settings.section.map(next), ..settings }
}

fn edges(mut settings: Settings) -> Settings {
    settings.marks.edges = !settings.marks.edges;
    settings
}

fn next_rule(viewer: &Viewer) -> Settings {
    let settings = *viewer.settings();
    let all = palpate::body::SlipRule::ALL;
    let own = viewer.subject().map(|s| s.body.slip()).unwrap_or_default();
    let at = all.iter().position(|r| *r == settings.slip.unwrap_or(own)).unwrap_or(0);
    Settings { slip: Some(all[(at + 1) % all.len()]), ..settings }
}

/// The mouse over the view. `response` senses clicks and drags.
pub fn mouse(ui: &egui::Ui, response: &egui::Response, viewer: &Viewer) -> Vec<Event> {
    let mut events = Vec::new();
    let rect = response.rect;
    let height = f64::from(rect.height().max(1.0));
    let place = |p: egui::Pos2| {
        let x = 2.0 * f64::from((p.x - rect.left()) / rect.width().max(1.0)) - 1.0;
        DVec2::new(x, 1.0 - 2.0 * f64::from((p.y - rect.top()) / rect.height().max(1.0)))
    };
    let (modifiers, delta, scroll, pointer) =
        ui.input(|i| (i.modifiers, i.pointer.delta(), i.smooth_scroll_delta().y, i.pointer.latest_pos()));
    let moved = DVec2::new(f64::from(delta.x), -f64::from(delta.y));
    let turns = response.dragged_by(PointerButton::Secondary)
        || response.dragged_by(PointerButton::Primary) && modifiers.shift;
    let moves = response.dragged_by(PointerButton::Middle)
        || response.dragged_by(PointerButton::Primary) && modifiers.command;
    if turns {
        events.push(Event::Orbit(DVec2::new(moved.x, -moved.y) / height * 4.0));
    }
    if moves {
        events.push(Event::Pan(moved / height));
    }
    let touches = response.is_pointer_button_down_on()
        && ui.input(|i| i.pointer.primary_down())
        && !modifiers.shift
        && !modifiers.command;
    if response.hovered() || touches {
        if delta != egui::Vec2::ZERO || touches != viewer.is_pressing() {
            events.extend(pointer.map(|p| Event::Point(Some(place(p)))));
        }
        if scroll != 0.0 {
            let by = (f64::from(scroll) / 240.0).exp();
            // Upwards is nearer; while pressing, less deep, as if the tool were drawn up.
            events.push(if touches { Event::Deepen(1.0 / by) } else { Event::Zoom(by) });
        }
    }
    // A press by the key T stays until the key, or the mouse, ends it.
    let begins = response.is_pointer_button_down_on() && ui.input(|i| i.pointer.primary_pressed());
    if begins && touches {
        events.push(Event::Press(true));
    }
    if ui.input(|i| i.pointer.primary_released()) && viewer.is_pressing() {
        events.push(Event::Press(false));
    }
    events
}

/// Files that were dropped on the window.
pub fn drops(ctx: &egui::Context) -> Vec<Event> {
    ctx.input(|i| i.raw.dropped_files.iter().map(|f| Event::Open(f.path().to_path_buf())).collect())
}
