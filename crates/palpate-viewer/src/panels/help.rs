//! What keys and mouse do.

use crate::input::{KEYS, MOUSE};
use crate::state::Event;
use eframe::egui::{self, RichText};

/// Lies over the window until it is dismissed.
pub fn show(ctx: &egui::Context, events: &mut Vec<Event>) {
    let modal = egui::Modal::new(egui::Id::unique("help")).show(ctx, |ui| {
        ui.set_max_width(760.0);
        ui.label(RichText::new("Keys and mouse").heading());
        ui.add_space(6.0);
        ui.horizontal_top(|ui| {
            let (left, right) = KEYS.split_at(KEYS.len() / 2 + 3);
            table(ui, "keys", left);
            ui.add_space(16.0);
            ui.vertical(|ui| {
                table(ui, "more keys", right);
                ui.add_space(10.0);
                table(ui, "mouse", &MOUSE);
            });
        });
        ui.add_space(8.0);
        ui.label(
            "The mouse moves where a simulated hand wants the tool to be. The hand is a spring: the tool stays behind by the \
             force over the spring's stiffness, so that a stiffer place is seen to give way less.",
        );
        ui.add_space(6.0);
        ui.button("Close").clicked()
    });
    if modal.inner || modal.should_close() {
        events.push(Event::Dismiss);
    }
}

fn table(ui: &mut egui::Ui, id: &str, rows: &[(&str, &str)]) {
    egui::Grid::new(id).num_columns(2).spacing([12.0, 4.0]).show(ui, |ui| {
        for (keys, what) in rows {
            ui.label(RichText::new(*keys).strong());
            ui.label(*what);
            ui.end_row();
        }
    });
}
