//! Curves: force over time, the operating point on the law of this place, energies, lateness.

use crate::palette::Rgb;
use crate::place::{self, Place};
use crate::state::{PAST_S, Viewer};
use crate::ui::colour;
use eframe::egui::{self, Color32, RichText, Ui};
use egui_plot::{AxisHints, Bar, BarChart, Corner, Legend, Line, Plot, PlotPoints, Points};
use palpate::runtime::{Percentiles, Record};

/// Height of a plot, points.
const HEIGHT: f32 = 138.0;
/// Points along a curve of the law.
const ALONG: usize = 90;
/// More than a screen can show.
const MOST: usize = 700;

/// Shows all of them.
pub fn show(viewer: &Viewer, ui: &mut Ui) {
    let past = thinned(viewer.past());
    let now_s = viewer.shown().map_or(0.0, |s| s.time_s);
    let curves = viewer.settings().theme.colours().curves;
    part(ui, "Force on the tool", |ui| force(ui, &past, now_s, curves));
    part(ui, "The law at this place", |ui| law(viewer, ui, curves));
    part(ui, "Energy", |ui| energy(viewer, ui, &past, now_s, curves));
    part(ui, "Lateness and step", |ui| lateness(viewer, ui, curves));
}

fn part(ui: &mut Ui, title: &str, contents: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(title).strong())
        .default_open(true)
        .show_unindented(ui, contents);
}

/// So many as a plot has pixels, and the last one.
fn thinned(records: &[Record]) -> Vec<&Record> {
    let stride = records.len().div_ceil(MOST).max(1);
    let last = records.len().saturating_sub(1);
    records.iter().enumerate().filter(|(i, _)| i % stride == 0 || *i == last).map(|(_, r)| r).collect()
}

fn plot<'a>(id: &'a str, x: &'a str, y: &'a str, ink: Color32) -> Plot<'a> {
    let small = egui::FontId::proportional(9.5);
    let axis = |hints: AxisHints<'a>, name: &'a str, closest: f32| {
        let hints = hints.label(RichText::new(name).small()).tick_label_font(small.clone());
        hints.label_spacing(egui::Rangef::new(closest, 1.2 * closest))
    };
    Plot::new(id)
        .height(HEIGHT)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .grid_color(ink.gamma_multiply(0.28))
        .custom_x_axes(vec![axis(AxisHints::new_x(), x, 18.0)])
        .custom_y_axes(vec![axis(AxisHints::new_y(), y, 12.0).min_thickness(34.0)])
}

fn legend() -> Legend {
    Legend::default().position(Corner::LeftTop).text_style(egui::TextStyle::Small).background_alpha(0.6)
}

fn line<'a>(name: &str, points: impl Iterator<Item = [f64; 2]>, rgb: Rgb) -> Line<'a> {
    let finite = points.filter(|[x, y]| x.is_finite() && y.is_finite());
    Line::new(name, finite.collect::<PlotPoints>()).color(colour(rgb)).width(1.6)
}

/// Seconds before now.
fn ago(record: &Record, now_s: f64) -> f64 {
    record.time_s - now_s
}

/// Where the time axis begins, s: as far back as there is something, at most [`PAST_S`].
fn begin(past: &[&Record], now_s: f64) -> f64 {
    past.first().map_or(-PAST_S, |r| ago(r, now_s).clamp(-PAST_S, -0.05))
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn force(ui: &mut Ui, past: &[&Record], now_s: f64, curves: [Rgb; 4]) {
    let from = begin(past, now_s);
    let of = |name: &'static str, rgb, of: fn(&Record) -> f64| {
        line(name, past.iter().map(move |r| [ago(r, now_s), of(r)]), rgb)
    };
    plot("force", "s", "N", ui.visuals().text_color())
        .legend(legend())
        .include_x(from)
        .include_x(0.0)
        .include_y(0.0)
        .include_y(0.5)
        .show(ui, |p| {
            p.line(of("engine", curves[0], |r| norm(r.force_n)));
            p.line(of("commanded", curves[1], |r| norm(r.command_force_n)));
        });
}

fn law(viewer: &Viewer, ui: &mut Ui, curves: [Rgb; 4]) {
    let Some(subject) = viewer.subject() else { return };
    let body = &*subject.body;
    let shown = viewer.shown();
    let contact = shown.as_ref().and_then(|s| s.contact);
    let here = match &contact {
        Some(contact) => Place::of(body, contact),
        None => Place::of_node(body, 0),
    };
    if contact.is_none() {
        ui.label(RichText::new("Nothing is touched: the curves of the first node.").small());
    }
    let (depth_m, lateral_m) = (place::depth_range_m(body), place::lateral_range_m(body));
    let at = contact.as_ref().map_or([0.0; 2], |c| [c.delta_z_m.max(0.0), c.delta_r_m]);
    let scale = shown.as_ref().map_or(viewer.settings().friction_scale, |s| s.friction_scale);
    let along = |to: f64| (0..=ALONG).map(move |i| to * i as f64 / ALONG as f64);
    let ink = ui.visuals().text_color();
    let dot = |x: f64, y: f64| Points::new("", vec![[x * 1e3, y]]).radius(4.0).color(ink);
    let now = here.press(body, at[0]);
    let deepest = depth_m.max(at[0]);
    let normal_name = if body.is_coupled() { "F′" } else { "f_z" };
    let small =
        |id, x, y| plot(id, x, y, ink).height(0.72 * HEIGHT).legend(legend()).include_x(0.0).include_y(0.0);
    small("normal", "depth, mm", "N").show(ui, |p| {
        p.line(line(normal_name, along(deepest).map(|d| [d * 1e3, here.press(body, d).force_n]), curves[0]));
        p.points(dot(at[0], now.force_n));
    });
    if body.is_coupled() {
        small("stiffness", "depth, mm", "N/m").show(ui, |p| {
            p.line(line(
                "K, mean",
                along(deepest).map(|d| [d * 1e3, here.press(body, d).lateral_n_per_m]),
                curves[2],
            ));
            p.points(dot(at[0], now.lateral_n_per_m));
        });
    } else {
        let farthest = lateral_m.max(at[1]);
        let limit = scale * now.friction * now.force_n;
        small("lateral", "lateral, mm", "N").show(ui, |p| {
            let force = along(farthest).map(|r| [r * 1e3, here.lateral_force_n(body, at[0], r)]);
            p.line(line("f_r", force, curves[2]));
            p.line(line("μ f_z", [0.0, farthest * 1e3].into_iter().map(|x| [x, limit]), curves[1]));
            p.points(dot(at[1], here.lateral_force_n(body, at[0], at[1])));
        });
    }
    small("friction", "depth, mm", "μ").include_y(0.5).show(ui, |p| {
        p.line(line("μ", along(deepest).map(|d| [d * 1e3, scale * here.press(body, d).friction]), curves[3]));
        p.points(dot(at[0], scale * now.friction));
    });
    let stiffness = format!(
        "stiffness here: {:.0} N/m straight in, {:.0} N/m along the surface",
        now.stiffness_n_per_m, now.lateral_n_per_m
    );
    ui.label(RichText::new(stiffness).small());
}

fn energy(viewer: &Viewer, ui: &mut Ui, past: &[&Record], now_s: f64, curves: [Rgb; 4]) {
    let from = begin(past, now_s);
    let of = |name: &'static str, rgb, of: fn(&Record) -> f64| {
        line(name, past.iter().map(move |r| [ago(r, now_s), of(r) * 1e3]), rgb)
    };
    plot("energy", "s", "mJ", ui.visuals().text_color())
        .legend(legend())
        .include_x(from)
        .include_x(0.0)
        .include_y(0.0)
        .show(ui, |p| {
            p.line(of("work", curves[0], |r| r.work_j));
            p.line(of("stored", curves[2], |r| r.stored_j));
            p.line(of("dissipated", curves[1], |r| r.dissipated_j));
            p.line(of("generated", curves[3], |r| r.generated_j));
        });
    let Some(shown) = viewer.shown() else { return };
    let energy = &shown.energy;
    let words = format!(
        "slip dissipated {:.3} mJ, less {:.3} mJ that it generated",
        (energy.dissipated_j + energy.generated_j) * 1e3,
        energy.generated_j * 1e3
    );
    ui.label(RichText::new(words).small());
    if let Some(tank_j) = shown.tank_j {
        let most = energy.tank_limit_j() * 1e3;
        let words = format!("the tank has {:.3} mJ of at most {most:.3} mJ", tank_j * 1e3);
        ui.label(RichText::new(words).small()).on_hover_text(
            "What slips have dissipated, and later ones may give out again: a quarter of what is stored at most",
        );
    }
}

/// Edges of the histogram's bars, µs: each twice the one before.
const EDGES: [f64; 12] = [0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1024.0];

/// In which bar a time falls, µs.
fn bin(us: f64) -> usize {
    EDGES.iter().rposition(|edge| us >= *edge).unwrap_or(0)
}

fn lateness(viewer: &Viewer, ui: &mut Ui, curves: [Rgb; 4]) {
    if viewer.touch().is_none() && viewer.playback().is_none() {
        ui.label(RichText::new("No loop runs.").small());
        return;
    }
    let records = viewer.past();
    let bars = |name: &str, of: &dyn Fn(&Record) -> f64, shift: f64, rgb: Rgb| {
        let mut counts = [0u32; EDGES.len()];
        records.iter().for_each(|r| counts[bin(of(r))] += 1);
        let percent = |count: u32| 100.0 * f64::from(count) / records.len().max(1) as f64;
        let bars = counts.into_iter().enumerate();
        let bars = bars.map(|(i, count)| Bar::new(i as f64 + shift, percent(count)).width(0.38)).collect();
        BarChart::new(name, bars).color(colour(rgb))
    };
    plot("lateness", "µs, from", "%", ui.visuals().text_color())
        .legend(legend().position(Corner::RightTop))
        .include_y(0.0)
        .include_y(60.0)
        .x_grid_spacer(|_| {
            let mark = |i: usize| egui_plot::GridMark { value: i as f64, step_size: 2.0 };
            (0..EDGES.len()).step_by(2).map(mark).collect()
        })
        .x_axis_formatter(|mark, _| {
            EDGES.get(mark.value.round() as usize).map_or(String::new(), |e| format!("{e}"))
        })
        .show(ui, |p| {
            p.bar_chart(bars("late", &|r| (r.lateness_ns.max(0) as f64) * 1e-3, -0.2, curves[0]));
            p.bar_chart(bars("step", &|r| f64::from(r.step_ns) * 1e-3, 0.2, curves[1]));
        });
    if let Some(summary) = viewer.summary() {
        let told =
            |p: &Percentiles| [p.p50, p.p99, p.p99_9, p.max].map(|ns| format!("{:.1}", ns as f64 * 1e-3));
        egui::Grid::new("percentiles").num_columns(5).spacing([12.0, 2.0]).show(ui, |ui| {
            for head in ["µs", "half", "99 %", "99.9 %", "most"] {
                ui.label(RichText::new(head).small().weak());
            }
            ui.end_row();
            for (name, percentiles) in [("late", &summary.lateness_ns), ("step", &summary.step_ns)] {
                ui.label(RichText::new(name).small());
                for value in told(percentiles) {
                    ui.label(RichText::new(value).small());
                }
                ui.end_row();
            }
        });
        let words = format!("{} periods, {} later than a whole period", summary.periods, summary.overruns);
        ui.label(RichText::new(words).small());
    }
}

#[cfg(test)]
mod tests {
    use super::bin;

    #[test]
    fn times_fall_into_their_bars() {
        for (us, expected) in [(0.0, 0), (0.9, 0), (1.0, 1), (3.9, 2), (1023.0, 10), (1e9, 11), (-1.0, 0)] {
            assert_eq!(bin(us), expected, "{us}");
        }
    }
}
