//! The state in numbers, with units.

use crate::shown::Shown;
use crate::state::Viewer;
use eframe::egui::Ui;
use palpate::engine::Flags;

/// The numbers of a state: (what, value with unit). The same digits wherever the state comes from.
pub fn told(shown: &Shown) -> Vec<(&'static str, String)> {
    let mm = |m: f64| format!("{:.3} mm", m * 1e3);
    let places = |p: [f64; 3]| p.map(|x| format!("{:.2}", x * 1e3)).join(", ") + " mm";
    let [x, y, z] = shown.force_n.to_array();
    let touched = |told: &dyn Fn(&palpate::engine::ContactPoint) -> String| {
        shown.contact.as_ref().map_or_else(|| "–".into(), told)
    };
    vec![
        ("time", format!("{:.3} s", shown.time_s)),
        ("contact", words(shown).into()),
        ("force", format!("{:.4} N", shown.force_n.length())),
        ("force x, y, z", format!("{x:.3}, {y:.3}, {z:.3} N")),
        ("torque", format!("{:.5} N·m", shown.torque_nm.length())),
        ("depth δz", touched(&|c| mm(c.delta_z_m))),
        ("lateral δr", touched(&|c| mm(c.delta_r_m))),
        ("contact point", touched(&|c| places(c.position_m))),
        ("element", touched(&|c| c.element.to_string())),
        ("tool", places(shown.tool.position_m)),
        ("stored", mj(shown.energy.stored_j)),
        ("dissipated", mj(shown.energy.dissipated_j)),
        ("work", mj(shown.energy.work_j)),
    ]
}

/// An energy.
pub fn mj(j: f64) -> String {
    format!("{:.4} mJ", j * 1e3)
}

fn words(shown: &Shown) -> &'static str {
    let is = |flag| shown.flags.has(flag);
    if !is(Flags::IN_CONTACT) {
        "none"
    } else if is(Flags::SLIPPING) {
        "slips"
    } else {
        "sticks"
    }
}

/// Shows them.
pub fn show(viewer: &Viewer, ui: &mut Ui) {
    super::section(ui, "Now", |ui| match viewer.shown() {
        Some(shown) => super::rows(ui, "numbers", &told(&shown)),
        None => drop(ui.label("Nothing touches the body.")),
    });
}
