//! What colours mean, over the view; and what arrows are.

use crate::colouring::Legend;
use crate::state::Viewer;
use crate::ui::colour;
use eframe::egui::{self, Align2, Color32, FontId, Rect, Ui, pos2, vec2};

const WIDTH: f32 = 250.0;

/// Shows it at the lower left of the view.
pub fn show(viewer: &Viewer, ui: &Ui, view: Rect) {
    let Some(subject) = viewer.subject() else { return };
    let painter = ui.painter_at(view);
    let ink = ui.visuals().text_color();
    if let Some(legend) = &subject.coloured.legend {
        bar(&painter, legend, pos2(view.left() + 16.0, view.bottom() - 16.0), ink);
    }
    if viewer.settings().marks.force && viewer.shown().is_some_and(|s| s.contact.is_some()) {
        let words = format!("force: 1 N is drawn as {}", length(subject.metres_per_newton));
        let at = view.right_top() + vec2(-14.0, 12.0);
        painter.text(at, Align2::RIGHT_TOP, words, FontId::proportional(11.0), ink);
    }
}

/// A length in a unit that suits it.
fn length(m: f64) -> String {
    if m < 1e-2 { format!("{:.1} mm", m * 1e3) } else { format!("{:.1} cm", m * 1e2) }
}

fn bar(painter: &egui::Painter, legend: &Legend, lower_left: egui::Pos2, ink: Color32) {
    let font = FontId::proportional(12.0);
    let small = FontId::proportional(11.0);
    let unit = if legend.unit.is_empty() { String::new() } else { format!(" ({})", legend.unit) };
    let note = painter.layout(legend.note.clone(), small.clone(), ink, WIDTH);
    let note_height = if legend.note.is_empty() { 0.0 } else { note.size().y + 5.0 };
    let title = painter.layout(format!("{}{unit}", legend.title), font, ink, WIDTH);
    let bar_height = if legend.has_values { 34.0 } else { 0.0 };
    let height = title.size().y + 5.0 + bar_height + note_height;
    let top = lower_left.y - height;
    let back = Rect::from_min_size(pos2(lower_left.x - 9.0, top - 8.0), vec2(WIDTH + 18.0, height + 15.0));
    let ground = painter.ctx().global_style().visuals.panel_fill.gamma_multiply(0.88);
    painter.rect_filled(back, 6.0, ground);
    let mut y = top;
    painter.galley(pos2(lower_left.x, y), title.clone(), ink);
    y += title.size().y + 5.0;
    if legend.has_values {
        let strips = 100;
        for i in 0..strips {
            let share = (i as f64 + 0.5) / f64::from(strips);
            let x = |k: i32| lower_left.x + WIDTH * k as f32 / strips as f32;
            let strip = Rect::from_min_max(pos2(x(i), y), pos2(x(i + 1) + 0.4, y + 14.0));
            painter.rect_filled(strip, 0.0, colour(legend.map.at(share)));
        }
        let [least, most] = legend.range;
        for (part, align) in [(0.0, Align2::LEFT_TOP), (0.5, Align2::CENTER_TOP), (1.0, Align2::RIGHT_TOP)] {
            let value = least + (most - least) * part;
            let at = pos2(lower_left.x + WIDTH * part as f32, y + 17.0);
            painter.text(at, align, number(value, most - least), small.clone(), ink);
        }
        y += bar_height;
    }
    if !legend.note.is_empty() {
        painter.galley(pos2(lower_left.x, y + 2.0), note, ink);
    }
}

/// With as many digits as tell places of the range apart.
fn number(value: f64, span: f64) -> String {
    let size = if span > 0.0 { span } else { value.abs() }.max(1e-12);
    let digits = (2.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}
