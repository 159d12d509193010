//! The state in numbers, with units.

use crate::shown::Shown;
use crate::state::Viewer;
use eframe::egui::Ui;
use palpate::engine::Flags;

/// The numbers of a state: (what, value with unit). The same digits wherever the state comes from.
pub fn told(shown: &Shown) -> Vec<(&'static str, String)> {
    let mm = |m: f64| fixed(m * 1e3, 3) + " mm";
    let places = |p: [f64; 3]| p.map(|x| fixed(x * 1e3, 2)).join(", ") + " mm";
    let force = shown.force_n.to_array().map(|f| fixed(f, 3)).join(", ");
    let touched = |told: &dyn Fn(&palpate::engine::ContactPoint) -> String| {
        shown.contact.as_ref().map_or_else(|| "–".into(), told)
    };
    vec![
        ("time", format!("{:.3} s", shown.time_s)),
        ("contact", words(shown).into()),
        ("force", format!("{:.4} N", shown.force_n.length())),
        ("force x, y, z", format!("{force} N")),
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
    fixed(j * 1e3, 4) + " mJ"
}

/// With so many digits after the point; a zero has no sign.
fn fixed(x: f64, digits: usize) -> String {
    let told = format!("{x:.digits$}");
    match told.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|b| matches!(b, b'0' | b'.')) => zero.into(),
        _ => told,
    }
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

#[cfg(test)]
mod tests {
    use super::fixed;

    #[test]
    fn a_zero_has_no_sign() {
        let told = [-0.0004, -0.0006, 0.0, -12.5].map(|x| fixed(x, 3));
        assert_eq!(told, ["0.000", "-0.001", "0.000", "-12.500"]);
    }
}
