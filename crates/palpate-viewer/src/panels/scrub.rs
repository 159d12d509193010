//! The bar of a recording.

use crate::state::{Event, Viewer};
use eframe::egui::{self, RichText, Ui};

/// Shows it.
pub fn show(viewer: &Viewer, ui: &mut Ui, events: &mut Vec<Event>) {
    let Some(playback) = viewer.playback() else { return };
    let [first, last] = playback.span_s();
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        if ui.button(if playback.is_playing { "Stop" } else { "Play" }).on_hover_text("L").clicked() {
            events.push(Event::Play);
        }
        for (label, by, key) in [("◀", -1, ","), ("▶", 1, ".")] {
            if ui.button(label).on_hover_text(format!("one period: {key}")).clicked() {
                events.push(Event::Frames(by));
            }
        }
        let told = format!("{:.3} s of {:.3} s", playback.time_s(), last);
        ui.label(told);
        ui.spacing_mut().slider_width = (ui.available_width() - 110.0).max(60.0);
        let mut time_s = playback.time_s();
        let slider = egui::Slider::new(&mut time_s, first..=last.max(first + 1e-9)).show_value(false);
        if ui.add(slider).on_hover_text("Time of the recording").changed() {
            events.push(Event::Scrub(time_s));
        }
        if ui.button("Close").clicked() {
            events.push(Event::CloseRecording);
        }
    });
    ui.horizontal(|ui| {
        let header = &playback.header;
        let every =
            if playback.stride > 1 { format!(", every {}th period", playback.stride) } else { String::new() };
        let words = format!(
            "{}: {} at {} Hz, slip rule {}; {}{every}",
            crate::work::name_of(&playback.file),
            header.device,
            header.rate_hz,
            header.slip,
            playback.ending
        );
        ui.label(RichText::new(words).weak());
    });
    ui.add_space(2.0);
}
