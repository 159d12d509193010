//! How the body is touched, and what is shown besides.

use crate::scene::Section;
use crate::settings::{DEPTHS_M, FORCES_MAX_N, Settings};
use crate::state::{Event, Viewer};
use eframe::egui::{self, RichText, Ui};
use palpate::body::SlipRule;
use palpate::device::presets;

/// Shows them.
pub fn show(viewer: &Viewer, ui: &mut Ui, events: &mut Vec<Event>) {
    let before = *viewer.settings();
    let mut now = before;
    super::section(ui, "Touch", |ui| touch(viewer, ui, &mut now));
    super::section(ui, "Show", |ui| marks(ui, &mut now));
    if now != before {
        events.push(Event::Change(now));
    }
}

fn touch(viewer: &Viewer, ui: &mut Ui, now: &mut Settings) {
    let Some(subject) = viewer.subject() else { return };
    // What is watched was configured by who started it.
    let is_led = viewer.touch().is_none_or(|t| t.lead.is_some());
    if !is_led || viewer.playback().is_some() {
        ui.label(RichText::new("What is shown has its own settings. These are the mouse's:").small());
    }
    ui.add_enabled_ui(is_led, |ui| {
        egui::Grid::new("switches").num_columns(2).spacing([10.0, 5.0]).show(ui, |ui| {
            ui.label("press depth");
            let mut mm = now.press_depth_m * 1e3;
            let range = DEPTHS_M[0] * 1e3..=DEPTHS_M[1] * 1e3;
            if ui
                .add(egui::DragValue::new(&mut mm).range(range).speed(0.05).suffix(" mm").max_decimals(2))
                .changed()
            {
                now.press_depth_m = mm * 1e-3;
            }
            ui.end_row();
            ui.label("slip rule");
            let own = subject.body.slip();
            let rule = now.slip.unwrap_or(own);
            let choice = egui::ComboBox::from_id_salt("slip").selected_text(rule.name()).show_ui(ui, |ui| {
                for rule in SlipRule::ALL {
                    let is_chosen = now.slip.unwrap_or(own) == rule;
                    if ui.selectable_label(is_chosen, rule.name()).clicked() {
                        now.slip = Some(rule);
                    }
                }
            });
            choice.response.on_hover_text("How the contact point slips: U");
            ui.end_row();
            ui.label("law");
            ui.label(if subject.body.is_coupled() { "coupled potential" } else { "curves" }).on_hover_text(
                "The body's own: its responses are of this law, and with another it is another body",
            );
            ui.end_row();
            ui.label("friction ×");
            let field =
                egui::DragValue::new(&mut now.friction_scale).range(0.0..=100.0).speed(0.01).max_decimals(2);
            ui.add(field).on_hover_text("Multiplies the body's friction coefficients");
            ui.end_row();
            ui.label("tool");
            let radius = subject.body.tool().radius_m();
            let size = if radius > 0.0 { format!(", radius {:.1} mm", radius * 1e3) } else { String::new() };
            ui.label(format!("{}{size}", subject.body.tool().name())).on_hover_text(
                "The tool that the body was made for: with another one its responses would be wrong",
            );
            ui.end_row();
            ui.label("device");
            choose(ui, "device", &mut now.device, &presets::DEVICES);
            ui.end_row();
            ui.label("hand");
            // An empty hand can't be led.
            choose(ui, "hand", &mut now.hand, &presets::HANDS[1..]);
            ui.end_row();
            ui.label("largest force");
            ui.add(
                egui::DragValue::new(&mut now.force_max_n)
                    .range(FORCES_MAX_N[0]..=FORCES_MAX_N[1])
                    .speed(0.05)
                    .suffix(" N")
                    .max_decimals(1),
            );
            ui.end_row();
        });
        ui.checkbox(&mut now.coordinates, "interpolate coordinates")
            .on_hover_text("I: without it the force clicks where facets meet");
        ui.checkbox(&mut now.responses, "interpolate responses")
            .on_hover_text("O: without it stiffness jumps from element to element");
        if subject.body.has_tank() {
            ui.checkbox(&mut now.tank, "tank")
                .on_hover_text("Slip gives out no more energy than it dissipated before");
        }
        if subject.body.has_partial_slip() {
            ui.checkbox(&mut now.partial_slip, "partial slip").on_hover_text(
                "Two contact points side by side: the contact slips from its rim inwards, not as a whole",
            );
        }
    });
    ui.checkbox(&mut now.sound, "sound")
        .on_hover_text("H: how fast the force changes; where it jumps, it clicks");
    if let Some(touch) = viewer.touch().filter(|t| t.hand_n_per_m > 0.0) {
        let lag = viewer.shown().and_then(|s| s.command_n).map_or(0.0, |f| f.length()) / touch.hand_n_per_m;
        let words = format!("hand {} N/m: the tool lags by {:.1} mm", touch.hand_n_per_m, lag * 1e3);
        ui.label(RichText::new(words).weak());
    }
}

fn choose(ui: &mut Ui, id: &str, chosen: &mut &'static str, names: &[&'static str]) {
    let choice = egui::ComboBox::from_id_salt(id).selected_text(*chosen).show_ui(ui, |ui| {
        for name in names {
            ui.selectable_value(chosen, *name, *name);
        }
    });
    choice.response.on_hover_text(format!("Which {id} is simulated"));
}

fn marks(ui: &mut Ui, now: &mut Settings) {
    let marks = &mut now.marks;
    egui::Grid::new("marks").num_columns(2).show(ui, |ui| {
        ui.checkbox(&mut marks.force, "force");
        ui.checkbox(&mut marks.contact, "contact and frame");
        ui.end_row();
        ui.checkbox(&mut marks.track, "track");
        ui.checkbox(&mut marks.target, "hand's target");
        ui.end_row();
        ui.checkbox(&mut marks.edges, "edges");
        ui.checkbox(&mut marks.test_points, "test points");
        ui.end_row();
    });
    let mut cuts = now.section.is_some();
    ui.horizontal(|ui| {
        if ui.checkbox(&mut cuts, "cut").on_hover_text("X").changed() {
            now.section = cuts.then(Section::default);
        }
        if let Some(section) = &mut now.section {
            for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                ui.selectable_value(&mut section.axis, axis, name);
            }
            ui.checkbox(&mut section.keeps_lower, "other side");
        }
    });
    if let Some(section) = &mut now.section {
        ui.add(egui::Slider::new(&mut section.share, 0.0..=1.0).show_value(false))
            .on_hover_text("Where the cut is");
    }
}
