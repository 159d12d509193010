//! The window's contents: bars, panels, and what lies over them. It reads a [`Viewer`] and answers with events.

use crate::camera::StandardView;
use crate::colouring::Colouring;
use crate::gallery::Example;
use crate::input;
use crate::palette::{Rgb, Theme};
use crate::panels;
use crate::renderer::View;
use crate::settings::Settings;
use crate::state::{Event, Viewer};
use eframe::egui::{self, Color32, RichText, Sense, Ui};
use std::sync::Arc;

/// The letters, as in all of the program's pictures; under its own licence, which lies beside it.
const FONT: &[u8] = include_bytes!("../../palpate-cli/assets/DejaVuSans.ttf");

/// Letters, sizes and colours of a window; once.
pub fn set_up(ctx: &egui::Context) {
    let mut fonts = egui::FontDefinitions::empty();
    fonts.font_data.insert("sans".into(), Arc::new(egui::FontData::from_static(FONT)));
    for family in [egui::FontFamily::Proportional, egui::FontFamily::Monospace] {
        fonts.families.insert(family, vec!["sans".into()]);
    }
    ctx.set_fonts(fonts);
    ctx.all_styles_mut(|style| {
        use egui::{FontFamily::Proportional, FontId, TextStyle};
        style.text_styles = [
            (TextStyle::Heading, FontId::new(16.0, Proportional)),
            (TextStyle::Body, FontId::new(12.5, Proportional)),
            (TextStyle::Button, FontId::new(12.5, Proportional)),
            (TextStyle::Monospace, FontId::new(12.5, Proportional)),
            (TextStyle::Small, FontId::new(10.5, Proportional)),
        ]
        .into();
        style.spacing.item_spacing = egui::vec2(7.0, 5.0);
        style.spacing.button_padding = egui::vec2(7.0, 3.0);
        style.animation_time = 0.0;
        style.visuals.widgets.noninteractive.corner_radius = egui::CornerRadius::same(5);
    });
    for theme in [egui::Theme::Light, egui::Theme::Dark] {
        ctx.style_mut_of(theme, |style| {
            let visuals = &mut style.visuals;
            let (panel, line, text) = match theme {
                egui::Theme::Light => {
                    (Color32::from_gray(250), Color32::from_gray(214), Color32::from_gray(30))
                }
                egui::Theme::Dark => {
                    (Color32::from_gray(29), Color32::from_gray(58), Color32::from_gray(225))
                }
            };
            (visuals.panel_fill, visuals.window_fill) = (panel, panel);
            visuals.widgets.noninteractive.bg_stroke.color = line;
            visuals.widgets.noninteractive.fg_stroke.color = text;
            visuals.widgets.inactive.fg_stroke.color = text;
        });
    }
}

/// A colour for the window.
pub fn colour([r, g, b]: Rgb) -> Color32 {
    let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
    Color32::from_rgb(byte(r), byte(g), byte(b))
}

/// Shows all of it, and gives what happened.
pub fn show(viewer: &Viewer, ui: &mut Ui) -> Vec<Event> {
    let ctx = ui.ctx().clone();
    let mut events: Vec<Event> = input::stop(&ctx).into_iter().collect();
    events.extend(input::keys(&ctx, viewer));
    events.extend(input::drops(&ctx));
    ctx.set_theme(match viewer.settings().theme {
        Theme::Light => egui::Theme::Light,
        Theme::Dark => egui::Theme::Dark,
    });
    if viewer.subject().is_none() {
        egui::CentralPanel::default().show(ui, |ui| start_page(viewer, ui, &mut events));
    } else {
        egui::Panel::top("bar").show(ui, |ui| bar(viewer, ui, &mut events));
        if viewer.playback().is_some() {
            egui::Panel::bottom("scrub").show(ui, |ui| panels::scrub::show(viewer, ui, &mut events));
        }
        egui::Panel::left("left").default_size(262.0).min_size(240.0).show(ui, |ui| {
            egui::ScrollArea::vertical().show(ui, |ui| {
                panels::safety::show(viewer, ui, &mut events);
                panels::numbers::show(viewer, ui);
                panels::switches::show(viewer, ui, &mut events);
            });
        });
        egui::Panel::right("right").default_size(330.0).min_size(260.0).show(ui, |ui| {
            egui::ScrollArea::vertical().show(ui, |ui| panels::plots::show(viewer, ui));
        });
        egui::CentralPanel::default().frame(egui::Frame::NONE).show(ui, |ui| view(viewer, ui, &mut events));
    }
    over(viewer, &ctx, &mut events);
    events
}

/// The body.
fn view(viewer: &Viewer, ui: &mut Ui, events: &mut Vec<Event>) {
    let rect = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    let aspect = f64::from(rect.width().max(1.0) / rect.height().max(1.0));
    events.push(Event::Resize(aspect));
    events.extend(input::mouse(ui, &response, viewer));
    if let Some(scene) = viewer.scene() {
        let pixels = ui.ctx().pixels_per_point();
        let size = [rect.width(), rect.height()].map(|s| (s * pixels).round().max(1.0) as u32);
        ui.painter().add(View { scene: Arc::new(scene), size }.shape(rect));
    }
    panels::legend::show(viewer, ui, rect);
}

fn bar(viewer: &Viewer, ui: &mut Ui, events: &mut Vec<Event>) {
    let settings = *viewer.settings();
    let mut changed = settings;
    ui.add_space(3.0);
    ui.horizontal_wrapped(|ui| {
        if ui.button("Examples").on_hover_text("G").clicked() {
            events.push(Event::Gallery);
        }
        if let Some(subject) = viewer.subject() {
            ui.label(RichText::new(&subject.name).strong());
            let count = subject.body.elements().len();
            ui.label(RichText::new(format!("{} triangles", thousands(count))).weak());
        }
        ui.separator();
        for (i, view) in StandardView::ALL.into_iter().enumerate() {
            if ui.small_button(view.name()).on_hover_text(format!("{}", i + 1)).clicked() {
                events.push(Event::Look(view));
            }
        }
        if ui.small_button("fit").on_hover_text("F").clicked() {
            events.push(Event::Fit);
        }
        ui.separator();
        let choice =
            egui::ComboBox::from_id_salt("colouring").selected_text(settings.colouring.title()).width(150.0);
        let chosen = choice.show_ui(ui, |ui| {
            for colouring in Colouring::ALL {
                ui.selectable_value(&mut changed.colouring, colouring, colouring.title());
            }
        });
        chosen.response.on_hover_text("What colours show: C");
        if settings.colouring.has_depth() {
            let mut mm = changed.colour_depth_m * 1e3;
            let field =
                egui::DragValue::new(&mut mm).range(0.0..=50.0).speed(0.05).suffix(" mm").max_decimals(2);
            if ui.add(field).on_hover_text("Depth of the press that is coloured").changed() {
                changed.colour_depth_m = mm * 1e-3;
            }
        }
        ui.separator();
        let [can_undo, can_redo] = viewer.can_undo();
        if ui.add_enabled(can_undo, egui::Button::new("Undo")).on_hover_text("Ctrl + Z").clicked() {
            events.push(Event::Undo);
        }
        if ui.add_enabled(can_redo, egui::Button::new("Redo")).on_hover_text("Ctrl + Y").clicked() {
            events.push(Event::Redo);
        }
        let other = match settings.theme {
            Theme::Light => "Dark",
            Theme::Dark => "Light",
        };
        if ui.button(other).on_hover_text("N").clicked() {
            changed.theme = input::other(settings.theme);
        }
        if ui.button("Help").on_hover_text("F1").clicked() {
            events.push(Event::Help);
        }
    });
    ui.add_space(2.0);
    if changed != settings {
        events.push(Event::Change(changed));
    }
}

/// Where nothing is opened.
fn start_page(viewer: &Viewer, ui: &mut Ui, events: &mut Vec<Event>) {
    ui.vertical_centered(|ui| {
        ui.add_space(0.09 * ui.available_height());
        ui.label(RichText::new("palpate").size(38.0).strong());
        ui.label(RichText::new("Touch soft bodies. Choose one, or drop a body, a recording, a spec or a mesh on this window.").size(14.0));
        ui.add_space(22.0);
    });
    let width = 212.0;
    let columns = ((ui.available_width() / (width + 14.0)) as usize).clamp(1, Example::ALL.len());
    let whole = columns as f32 * (width + 12.0);
    ui.horizontal(|ui| {
        ui.add_space((0.5 * (ui.available_width() - whole)).max(0.0));
        egui::Grid::new("gallery").spacing([12.0, 12.0]).show(ui, |ui| {
            for (i, example) in Example::ALL.into_iter().enumerate() {
                card(viewer, ui, example, width, events);
                if (i + 1) % columns == 0 {
                    ui.end_row();
                }
            }
        });
    });
    ui.vertical_centered(|ui| {
        ui.add_space(24.0);
        ui.label(RichText::new("F1 shows what keys and mouse do. The space bar always stops.").weak());
        let settings: Settings = *viewer.settings();
        let other = if settings.theme == Theme::Light { "Dark window" } else { "Light window" };
        if ui.button(other).clicked() {
            events.push(Event::Change(Settings { theme: input::other(settings.theme), ..settings }));
        }
    });
}

fn card(viewer: &Viewer, ui: &mut Ui, example: Example, width: f32, events: &mut Vec<Event>) {
    let stroke = ui.visuals().widgets.noninteractive.bg_stroke;
    let is_free = viewer.work().is_none();
    egui::Frame::new()
        .stroke(stroke)
        .corner_radius(8u8)
        .inner_margin(12i8)
        .fill(ui.visuals().faint_bg_color)
        .show(ui, |ui| {
            ui.set_width(width - 24.0);
            ui.set_min_height(112.0);
            ui.vertical(|ui| {
                if ui
                    .add_enabled(
                        is_free,
                        egui::Button::new(RichText::new(example.title()).strong().size(15.0))
                            .min_size(egui::vec2(width - 24.0, 30.0)),
                    )
                    .clicked()
                {
                    events.push(Event::Example(example));
                }
                ui.add_space(4.0);
                ui.label(example.about());
            });
        });
}

/// What lies over the window: work, questions, messages, help.
fn over(viewer: &Viewer, ctx: &egui::Context, events: &mut Vec<Event>) {
    if let Some(work) = viewer.work() {
        panels::dialogs::work(work, ctx, events);
    }
    if let Some(question) = viewer.question() {
        panels::dialogs::mesh(question, ctx, events);
    }
    if let (Some(instead), Some(work)) = (viewer.instead(), viewer.work()) {
        panels::dialogs::instead(instead, work, ctx, events);
    }
    if let Some(message) = viewer.message() {
        panels::dialogs::message(viewer, message, ctx, events);
    }
    if viewer.is_help_shown() {
        panels::help::show(ctx, events);
    }
    if ctx.input(|i| !i.raw.hovered_files.is_empty()) {
        panels::dialogs::hovering(ctx);
    }
}

/// 1234567 as 1,234,567.
pub fn thousands(count: usize) -> String {
    let digits = count.to_string();
    let first = digits.len() % 3;
    let mut told = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && i % 3 == first {
            told.push(',');
        }
        told.push(c);
    }
    told
}

#[cfg(test)]
mod tests {
    use super::thousands;

    #[test]
    fn thousands_are_told_apart() {
        let told = [0, 12, 123, 1234, 12345, 123_456, 1_234_567].map(thousands);
        assert_eq!(told, ["0", "12", "123", "1,234", "12,345", "123,456", "1,234,567"]);
    }
}
