//! Parts of the window, one a module.

pub mod dialogs;
pub mod help;
pub mod legend;
pub mod numbers;
pub mod plots;
pub mod safety;
pub mod scrub;
pub mod switches;

use eframe::egui::{self, RichText, Ui};

/// A part with a title.
fn section(ui: &mut Ui, title: &str, contents: impl FnOnce(&mut Ui)) {
    ui.add_space(4.0);
    ui.label(RichText::new(title).heading());
    contents(ui);
    ui.add_space(4.0);
    ui.separator();
}

/// Names on the left, values on the right.
fn rows<S: AsRef<str>>(ui: &mut Ui, id: &str, rows: &[(&str, S)]) {
    egui::Grid::new(id).num_columns(2).spacing([10.0, 3.0]).show(ui, |ui| {
        for (name, value) in rows {
            ui.label(RichText::new(*name).weak());
            ui.label(value.as_ref());
            ui.end_row();
        }
    });
}
