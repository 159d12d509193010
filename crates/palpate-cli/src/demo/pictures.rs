//! Force against time in the four settings, the same close up, and the curves at two nodes.

use super::canvas::{Area, INK, RED, font, named_stroke, names, paint, stroke};
use super::cylinder::DEFLECTION_MAX;
use super::experiment::{Rate, Rollout};
use super::path::{CIRCLED, DRAGGED, DURATION, PRESSED, tip};
use crate::plot::COLOURS;
use anyhow::Result;
use glam::DVec3;
use palpate_body::{Body, Response};
use plotters::prelude::*;
use std::ops::Range;
use std::path::Path;

/// Each setting as a person names it, in the order of the results.
pub const TITLES: [&str; 4] = ["both interpolations", "coordinates off", "responses off", "both off"];

/// The force's components, seen from the body's axis through the tool.
const COMPONENTS: [&str; 3] = ["outward", "around", "along"];

/// What `clicks.png` shows, s: a part of the drag.
pub const CLOSE_UP: Range<f64> = 1.30..1.60;

/// Unit vectors outward, around and along at the tool.
pub fn frame(tip: DVec3) -> [DVec3; 3] {
    let out = DVec3::new(tip.x, tip.y, 0.0).normalize_or_zero();
    [out, DVec3::Z.cross(out), DVec3::Z]
}

/// `force.png`: four panels with the same axes, clicks in red.
///
/// # Errors
/// A file that can't be written.
pub fn force(path: &Path, rate: &Rate) -> Result<()> {
    let range = rate
        .settings
        .iter()
        .flat_map(|r| components(r, rate.hz))
        .fold(0.0..0.0, |range: Range<f64>, (_, f)| {
            f.iter().fold(range, |r, &f| r.start.min(f)..r.end.max(f))
        });
    paint(path, (1300, 1560), |area| {
        let (head, rest) = area.split_vertically(150);
        let (rest, foot) = rest.split_vertically(2920);
        head.draw(&Text::new(
            "Force on the tool while it presses, drags, circles and lets go",
            (40, 30),
            font(50),
        ))?;
        legend(&head, 40, 100)?;
        let panels = rest.split_evenly((4, 1));
        for ((panel, rollout), title) in panels.iter().zip(&rate.settings).zip(TITLES) {
            force_panel(panel, rollout, rate.hz, range.clone(), title)?;
        }
        foot.draw(&Text::new("time (s)", (1250, 0), font(38)))?;
        Ok(())
    })
}

fn legend(area: &Area, left: i32, y: i32) -> Result<()> {
    let mut x = left;
    for (name, colour) in COMPONENTS.iter().zip(COLOURS) {
        area.draw(&PathElement::new([(x, y + 9), (x + 60, y + 9)], colour.stroke_width(6)))?;
        area.draw(&Text::new(*name, (x + 74, y), font(36)))?;
        x += 74 + 22 * name.len() as i32 + 50;
    }
    area.draw(&TriangleMarker::new((x + 14, y + 12), 16, RED.filled()))?;
    area.draw(&Text::new(
        "click: the force jumps by more than smooth contact can explain",
        (x + 40, y),
        font(36),
    ))?;
    Ok(())
}

fn force_panel(area: &Area, rollout: &Rollout, hz: f64, range: Range<f64>, title: &str) -> Result<()> {
    let room = range.end - range.start;
    let y = range.start - 0.2 * room..range.end + 0.28 * room;
    let mut chart = ChartBuilder::on(area)
        .margin_right(50)
        .margin_top(10)
        .margin_left(20)
        .x_label_area_size(60)
        .y_label_area_size(120)
        .build_cartesian_2d(0.0..DURATION, y.clone())?;
    chart
        .configure_mesh()
        .y_desc("force (N)")
        .axis_desc_style(font(38))
        .label_style(font(34))
        .light_line_style(TRANSPARENT)
        .bold_line_style(INK.mix(0.12))
        .x_labels(10)
        .y_labels(6)
        .draw()?;
    for joint in [PRESSED, DRAGGED, CIRCLED] {
        let line = [(joint, y.start), (joint, range.end + 0.13 * room)];
        chart.draw_series([PathElement::new(line, INK.mix(0.45).stroke_width(2))])?;
    }
    for (from, phase) in [(0.0, "press"), (PRESSED, "drag"), (DRAGGED, "circle"), (CIRCLED, "release")] {
        let place = (from + 0.03, range.end + 0.11 * room);
        chart.draw_series([Text::new(phase, place, ("sans-serif", 34).into_font().color(&INK.mix(0.7)))])?;
    }
    for (colour, i) in COLOURS.into_iter().zip(0..3) {
        stroke(&chart, components(rollout, hz).map(|(t, f)| (t, f[i])), colour.into(), 5)?;
    }
    let ticks = rollout.clicks.iter().map(|&(sample, _)| (sample as f64 / hz, range.start - 0.1 * room));
    chart.draw_series(ticks.map(|at| TriangleMarker::new(at, 14, RED.filled())))?;
    let count = rollout.clicks.len();
    let text = match count {
        0 => format!("{title}: no click"),
        _ => format!("{title}: {count} clicks, excess up to {:.0} mN", rollout.excess * 1e3),
    };
    chart.draw_series([Text::new(text, (0.03, range.end + 0.26 * room), font(42))])?;
    Ok(())
}

/// (time, force components) of each sample.
fn components(rollout: &Rollout, hz: f64) -> impl Iterator<Item = (f64, [f64; 3])> {
    rollout.samples.iter().enumerate().map(move |(sample, output)| {
        let t = sample as f64 / hz;
        let force = DVec3::from_array(output.force_n);
        (t, frame(tip(t)).map(|axis| axis.dot(force)))
    })
}

/// `clicks.png`: some of the drag, sample by sample; outward above, around below.
///
/// # Errors
/// A file that can't be written.
pub fn clicks(path: &Path, rate: &Rate) -> Result<()> {
    paint(path, (1300, 1200), |area| {
        let (head, rest) = area.split_vertically(150);
        let text = "Close up: 0.3 s of the drag, one dot a millisecond";
        head.draw(&Text::new(text, (40, 30), font(50)))?;
        let mut x = 40;
        for ((title, colour), _) in TITLES.iter().zip(COLOURS).zip(0..3) {
            head.draw(&Circle::new((x + 12, 109), 11, colour.filled()))?;
            head.draw(&Text::new(*title, (x + 36, 100), font(36)))?;
            x += 36 + 20 * title.len() as i32 + 50;
        }
        for (panel, i) in rest.split_evenly((2, 1)).iter().zip(0..) {
            click_panel(panel, rate, i)?;
        }
        Ok(())
    })
}

fn click_panel(area: &Area, rate: &Rate, component: usize) -> Result<()> {
    let samples = |setting: usize| {
        let all = components(&rate.settings[setting], rate.hz).map(move |(t, f)| (t, f[component]));
        all.filter(|(t, _)| CLOSE_UP.contains(t))
    };
    let range = (0..3)
        .flat_map(samples)
        .fold(f64::INFINITY..f64::NEG_INFINITY, |r, (_, f)| r.start.min(f)..r.end.max(f));
    let air = 0.06 * (range.end - range.start);
    let mut chart = ChartBuilder::on(area)
        .margin_right(50)
        .margin_top(10)
        .margin_left(20)
        .x_label_area_size(88)
        .y_label_area_size(140)
        .build_cartesian_2d(CLOSE_UP, range.start - air..range.end + air)?;
    chart
        .configure_mesh()
        .x_desc("time (s)")
        .y_desc(format!("force {} (N)", COMPONENTS[component]))
        .axis_desc_style(font(38))
        .label_style(font(34))
        .light_line_style(TRANSPARENT)
        .bold_line_style(INK.mix(0.12))
        .draw()?;
    for (setting, colour) in [(1, COLOURS[1]), (2, COLOURS[2]), (0, COLOURS[0])] {
        chart.draw_series(LineSeries::new(samples(setting), colour.mix(0.5).stroke_width(2)))?;
        chart.draw_series(samples(setting).map(|at| Circle::new(at, 6, colour.filled())))?;
    }
    // The setting whose clicks show in this component, and the largest of them.
    let steps: Vec<_> = samples([2, 1][component]).collect();
    let largest = steps.windows(2).max_by(|a, b| (a[1].1 - a[0].1).abs().total_cmp(&(b[1].1 - b[0].1).abs()));
    if let Some([a, b]) = largest {
        let text = format!("click: {:.2} N in a millisecond", (b.1 - a.1).abs());
        let style = ("sans-serif", 38).into_font().color(&RED);
        chart.draw_series([Text::new(text, (b.0 + 0.003, a.1), style)])?;
    }
    Ok(())
}

/// `curves.png`: normal force, lateral force and friction limit at the softest and the stiffest node.
///
/// # Errors
/// A file that can't be written.
pub fn curves(path: &Path, body: &Body) -> Result<()> {
    let by_stiffness = |a: &&Response, b: &&Response| a.lateral.value(1e-3).total_cmp(&b.lateral.value(1e-3));
    let (soft, stiff) =
        (body.curves().iter().min_by(by_stiffness), body.curves().iter().max_by(by_stiffness));
    type Law = fn(&Response, f64) -> f64;
    let panels: [(&str, &str, Law); 3] = [
        ("Normal force", "pressed in by δz (mm)", |r, d| r.normal.value(d)),
        ("Lateral force", "displaced laterally by δr (mm)", |r, d| r.lateral.value(d)),
        ("Friction limit", "pressed in by δz (mm)", |r, d| r.friction.value(d) * r.normal.value(d)),
    ];
    paint(path, (1500, 600), |area| {
        for (panel, (title, label, law)) in area.split_evenly((1, 3)).iter().zip(panels) {
            let line = |response: Option<&Response>| -> Vec<(f64, f64)> {
                let at = |i: i32| f64::from(i) / 100.0 * DEFLECTION_MAX;
                response.iter().flat_map(|r| (0..=100).map(move |i| (at(i) * 1e3, law(r, at(i))))).collect()
            };
            let lines = [("soft node", line(soft), COLOURS[0]), ("stiff node", line(stiff), COLOURS[1])];
            let top = lines.iter().flat_map(|l| &l.1).fold(0.0, |top: f64, p| top.max(p.1));
            let mut chart = ChartBuilder::on(panel)
                .caption(title, font(44))
                .margin(24)
                .x_label_area_size(96)
                .y_label_area_size(110)
                .build_cartesian_2d(0.0..DEFLECTION_MAX * 1e3, 0.0..top * 1.05)?;
            chart
                .configure_mesh()
                .x_desc(label)
                .y_desc("force (N)")
                .axis_desc_style(font(38))
                .label_style(font(34))
                .light_line_style(TRANSPARENT)
                .bold_line_style(INK.mix(0.12))
                .x_labels(8)
                .y_labels(8)
                .draw()?;
            for (name, points, colour) in lines {
                named_stroke(&mut chart, name, points.into_iter(), colour, 6)?;
            }
            names(&mut chart, SeriesLabelPosition::UpperLeft)?;
        }
        Ok(())
    })
}
