//! Work under way, what a mesh is asked, and what has to be said.

use crate::drop::{Held, MeshQuestion, Tissue};
use crate::state::{Event, Message, Viewer};
use crate::work::{Work, name_of};
use eframe::egui::{self, Align2, RichText, vec2};
use palpate::body::import::LengthUnit;

/// How far something is.
pub fn work(work: &Work, ctx: &egui::Context, events: &mut Vec<Event>) {
    let window =
        egui::Window::new(&work.title).id(egui::Id::unique("work")).collapsible(false).resizable(false);
    window.anchor(Align2::CENTER_TOP, vec2(0.0, 70.0)).show(ctx, |ui| {
        ui.set_width(330.0);
        let (done, of) = work.meter.read();
        if of > 0 {
            let text = format!("{done} of {of} test points");
            ui.add(egui::ProgressBar::new(done as f32 / of as f32).text(text));
        } else {
            ui.horizontal(|ui| {
                ui.spinner();
                ui.label("a moment");
            });
        }
        for note in work.meter.notes().iter().rev().take(3) {
            ui.label(RichText::new(note).small());
        }
        if work.can_cancel {
            let label = if work.is_cancelled() { "Being cancelled" } else { "Cancel" };
            if ui.add_enabled(!work.is_cancelled(), egui::Button::new(label)).clicked() {
                events.push(Event::Cancel);
            }
        }
    });
}

/// Unit, tissue, what holds it.
pub fn mesh(question: &MeshQuestion, ctx: &egui::Context, events: &mut Vec<Event>) {
    let mut now = question.clone();
    let modal = egui::Modal::new(egui::Id::unique("mesh")).show(ctx, |ui| {
        ui.set_width(430.0);
        ui.label(RichText::new(format!("A body of {}", name_of(&question.path))).heading());
        ui.add_space(4.0);
        ui.label("A mesh says where a surface is, and no more. What is left to say:");
        ui.add_space(6.0);
        egui::Grid::new("question").num_columns(2).spacing([14.0, 7.0]).show(ui, |ui| {
            ui.label("its coordinates are in");
            ui.horizontal(|ui| {
                for (unit, name) in [(LengthUnit::Metre, "m"), (LengthUnit::Centimetre, "cm"), (LengthUnit::Millimetre, "mm")]
                {
                    ui.selectable_value(&mut now.unit, Some(unit), name);
                }
            });
            ui.end_row();
            ui.label("it is made of");
            let choice = egui::ComboBox::from_id_salt("tissue").selected_text(now.tissue.title()).width(250.0).show_ui(ui, |ui| {
                for tissue in Tissue::ALL {
                    ui.selectable_value(&mut now.tissue, tissue, tissue.title());
                }
            });
            choice.response.on_hover_text("What it is made of");
            ui.end_row();
            ui.label("what holds it");
            let choice = egui::ComboBox::from_id_salt("held").selected_text(now.held.title()).width(250.0).show_ui(ui, |ui| {
                for held in Held::ALL {
                    ui.selectable_value(&mut now.held, held, held.title());
                }
            });
            choice.response.on_hover_text("What holds it");
            ui.end_row();
            ui.label("a ball presses it, of radius");
            ui.add(egui::DragValue::new(&mut now.tool_radius_mm).range(0.5..=30.0).speed(0.1).suffix(" mm"));
            ui.end_row();
            ui.label("at");
            ui.add(egui::DragValue::new(&mut now.test_points).range(4..=400).suffix(" places"));
            ui.end_row();
        });
        ui.add_space(4.0);
        match question.unit {
            None => ui.label("Choose the unit: it is never guessed."),
            Some(_) => ui.label("The spec, and what is finished, go into a folder beside the mesh: whatever ends it, it goes on from there."),
        };
        ui.add_space(6.0);
        ui.horizontal(|ui| {
            let make = egui::Button::new(RichText::new("Simulate").strong());
            if ui.add_enabled(question.unit.is_some(), make).clicked() {
                events.push(Event::Make);
            }
            if ui.button("Not now").clicked() {
                events.push(Event::Dismiss);
            }
        });
    });
    if now != *question {
        events.push(Event::Ask(now));
    }
    if modal.should_close() {
        events.push(Event::Dismiss);
    }
}

/// Whether what was asked for shall end the simulation that is under way.
pub fn instead(asked: &Event, work: &Work, ctx: &egui::Context, events: &mut Vec<Event>) {
    let wanted = match asked {
        Event::Open(path) => format!("Open {}", name_of(path)),
        Event::Example(example) => format!("Make: {}", example.title()),
        _ => "Simulate the mesh".into(),
    };
    let modal = egui::Modal::new(egui::Id::unique("instead")).show(ctx, |ui| {
        ui.set_width(430.0);
        ui.label(RichText::new(format!("{wanted} instead?")).heading());
        ui.add_space(4.0);
        ui.label(format!(
            "{} would be left off. Of a mesh or a spec, finished test points are kept: made again, it goes on from there.",
            work.title
        ));
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            if ui.button("Let it go on").clicked() {
                events.push(Event::Dismiss);
            }
            if ui.button(wanted).clicked() {
                events.push(Event::Instead);
            }
        });
    });
    if modal.should_close() {
        events.push(Event::Dismiss);
    }
}

/// What is wrong, and what to do.
pub fn message(viewer: &Viewer, message: &Message, ctx: &egui::Context, events: &mut Vec<Event>) {
    let modal = egui::Modal::new(egui::Id::unique("message")).show(ctx, |ui| {
        ui.set_width(430.0);
        ui.label(RichText::new(&message.title).heading());
        ui.add_space(4.0);
        ui.label(&message.text);
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            if viewer.is_unfinished() && ui.button("Go on with it").clicked() {
                events.push(Event::GoOn);
            }
            if ui.button("Close").clicked() {
                events.push(Event::Dismiss);
            }
        });
    });
    if modal.should_close() {
        events.push(Event::Dismiss);
    }
}

/// While a file is held over the window.
pub fn hovering(ctx: &egui::Context) {
    let painter =
        ctx.layer_painter(egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("hovering")));
    let rect = ctx.content_rect();
    painter.rect_filled(rect, 0.0, egui::Color32::from_black_alpha(150));
    let words = "Drop a body, a recording, a spec or a mesh";
    painter.text(
        rect.center(),
        Align2::CENTER_CENTER,
        words,
        egui::FontId::proportional(22.0),
        egui::Color32::WHITE,
    );
}
