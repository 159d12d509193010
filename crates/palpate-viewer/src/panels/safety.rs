//! Limits, what could not be had, silence and its reason; and the stop.

use crate::shown::silence;
use crate::state::{Event, Viewer};
use crate::touch::Touch;
use eframe::egui::{self, Color32, RichText, Ui};
use palpate::device::Basis;

const RED: Color32 = Color32::from_rgb(190, 30, 45);

/// Shows them.
pub fn show(viewer: &Viewer, ui: &mut Ui, events: &mut Vec<Event>) {
    super::section(ui, "Safety", |ui| {
        let Some(touch) = viewer.touch() else {
            ui.label(match viewer.playback() {
                Some(_) => "A recording: no device is open.",
                None => "No device is open.",
            });
            if ui.button("Touch it with the mouse").on_hover_text("R").clicked() {
                events.push(if viewer.playback().is_some() { Event::CloseRecording } else { Event::Start });
            }
            return;
        };
        let wide = egui::vec2(ui.available_width(), 30.0);
        if touch.is_stopped() || touch.is_over() {
            let why = match touch.session().end() {
                _ if touch.is_stopped() => "Stopped: no force, the device is closed.".into(),
                Some(end) => format!("It has ended: {end}. The device is closed."),
                None => "It has ended.".into(),
            };
            ui.label(RichText::new(why).color(RED).strong());
            let again = egui::Button::new(RichText::new("Start again").strong()).min_size(wide);
            if ui.add(again).on_hover_text("R").clicked() {
                events.push(Event::Start);
            }
        } else {
            let stop = RichText::new("STOP   (space bar)").strong().color(Color32::WHITE).size(15.0);
            if ui.add(egui::Button::new(stop).fill(RED).min_size(wide)).clicked() {
                events.push(Event::Stop);
            }
        }
        state(viewer, touch, ui);
        unverified(touch, ui);
    });
}

fn state(viewer: &Viewer, touch: &Touch, ui: &mut Ui) {
    let shown = viewer.shown();
    let why = shown.as_ref().and_then(|s| silence(s.stages));
    let command = shown.as_ref().and_then(|s| s.command_n).map_or(0.0, |f| f.length());
    let output = match why {
        _ if touch.is_paused() => "paused: zero is commanded".into(),
        Some(words) => words.into(),
        None => String::from("as the body answers"),
    };
    let rows = [
        ("device", touch.session().capabilities().name.to_string()),
        ("largest force", format!("{} N", touch.controls().force_limit_n())),
        ("commanded", format!("{command:.3} N")),
        ("output", output),
    ];
    super::rows(ui, "safety", &rows);
}

/// What was refused, and which of the device's figures nobody has measured.
fn unverified(touch: &Touch, ui: &mut Ui) {
    for note in touch.session().notes() {
        ui.label(RichText::new(format!("Not had: {note}")).color(RED));
    }
    if let Some(advice) = touch.session().advice() {
        ui.label(RichText::new(advice).small());
    }
    let capabilities = touch.session().capabilities();
    let figures = [
        ("largest force", &capabilities.max_force_n),
        ("stiffness", &capabilities.max_stiffness_n_per_m),
        ("mass", &capabilities.mechanics.mass_kg),
        ("damping", &capabilities.mechanics.damping_n_s_per_m),
        ("friction", &capabilities.mechanics.coulomb_n),
        ("delay", &capabilities.mechanics.delay_s),
    ];
    let guessed: Vec<&str> =
        figures.iter().filter(|(_, f)| matches!(f.basis, Basis::Guessed(_))).map(|(name, _)| *name).collect();
    if !guessed.is_empty() {
        let words = format!("Unverified figures of this device: {}.", guessed.join(", "));
        ui.label(RichText::new(words).small());
    }
}
