//! The body in two views, coloured by stiffness, with the contact point's track.

use super::canvas::{Area, INK, font, paint, polyline};
use super::cylinder::{LENGTH, NORMAL_STIFFNESS, RADIUS, stiffness};
use super::experiment::{Rate, Rollout};
use crate::plot::COLOURS;
use anyhow::Result;
use glam::DVec3;
use palpate_body::Body;
use plotters::prelude::*;
use std::ops::Range;
use std::path::Path;

/// Each element is painted as the square of this many triangles, so that colours run on as responses do.
const FINENESS: usize = 12;

/// Marks of clicks with coordinates off and with responses off: where both click, both are seen.
const MARKS: [(RGBColor, i32); 2] = [(COLOURS[1], 22), (COLOURS[3], 11)];

/// `body.png`: from both sides, hidden parts left out.
///
/// # Errors
/// A file that can't be written.
pub fn body(path: &Path, body: &Body, rate: &Rate) -> Result<()> {
    let values = body.nodes().iter().map(|n| stiffness(n.position));
    let range = values.fold(f64::INFINITY..f64::NEG_INFINITY, |r, g| r.start.min(g)..r.end.max(g));
    paint(path, (1300, 1080), |area| {
        area.draw(&Text::new("The body and where it was touched", (40, 30), font(50)))?;
        let (_, rest) = area.split_vertically(120);
        let (views, bar) = rest.split_horizontally(2200);
        let (views, foot) = views.split_vertically(1900);
        for (panel, azimuth) in views.split_evenly((1, 2)).iter().zip([1.25, 1.25 + std::f64::consts::PI]) {
            let camera = Camera::new(azimuth, 0.38, panel);
            skin(panel, &camera, body, &range)?;
            track(panel, &camera, rate)?;
        }
        colour_bar(&bar, &range)?;
        key(&foot)
    })
}

/// An orthographic view from outside, and the pixels it falls on.
struct Camera {
    towards: DVec3,
    right: DVec3,
    up: DVec3,
    centre: DVec3,
    scale: f64,
}

impl Camera {
    fn new(azimuth: f64, elevation: f64, panel: &Area) -> Self {
        let ((sin_a, cos_a), (sin_e, cos_e)) = (libm::sincos(azimuth), libm::sincos(elevation));
        let towards = DVec3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
        let right = DVec3::new(-sin_a, cos_a, 0.0);
        let (width, height) = panel.dim_in_pixel();
        let (wide, high) = (2.0 * RADIUS, LENGTH * cos_e + 2.0 * RADIUS * sin_e);
        let scale = (f64::from(width) / wide).min(f64::from(height) / high) * 0.93;
        let centre = DVec3::new(f64::from(width) / 2.0, f64::from(height) / 2.0, 0.0);
        Camera { towards, right, up: towards.cross(right), centre, scale }
    }

    fn pixel(&self, p: DVec3) -> (i32, i32) {
        let x = self.centre.x + self.scale * p.dot(self.right);
        let y = self.centre.y - self.scale * p.dot(self.up);
        (x.round() as i32, y.round() as i32)
    }

    /// Whether the outside is seen at a point of the cylinder, which is convex: nothing else can hide it.
    fn sees(&self, p: DVec3) -> bool {
        DVec3::new(p.x, p.y, 0.0).dot(self.towards) > 0.0
    }
}

/// Elements from far to near: inside walls plain, the outside coloured.
fn skin(area: &Area, camera: &Camera, body: &Body, range: &Range<f64>) -> Result<()> {
    let mut order: Vec<u32> = (0..body.elements().len() as u32).collect();
    let depth = |&e: &u32| body.corners(e).iter().sum::<DVec3>().dot(camera.towards);
    order.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
    for element in order {
        let [a, b, c] = body.corners(element);
        let outline = [a, b, c, a].map(|p| camera.pixel(p));
        if (b - a).cross(c - a).dot(camera.towards) > 0.0 {
            for part in parts([a, b, c]) {
                let g = part.iter().map(|&p| stiffness(p)).sum::<f64>() / 3.0;
                area.draw(&Polygon::new(part.map(|p| camera.pixel(p)), colour(share(g, range)).filled()))?;
            }
            area.draw(&PathElement::new(outline, INK.mix(0.45).stroke_width(2)))?;
        } else {
            area.draw(&Polygon::new(outline, RGBColor(228, 228, 228).filled()))?;
            area.draw(&PathElement::new(outline, INK.mix(0.15).stroke_width(2)))?;
        }
    }
    Ok(())
}

/// A triangle cut into equal small ones.
fn parts([a, b, c]: [DVec3; 3]) -> impl Iterator<Item = [DVec3; 3]> {
    let at = move |i: usize, j: usize| {
        a + (b - a) * (i as f64 / FINENESS as f64) + (c - a) * (j as f64 / FINENESS as f64)
    };
    (0..FINENESS).flat_map(move |i| {
        let upright = (0..FINENESS - i).map(move |j| [at(i, j), at(i + 1, j), at(i, j + 1)]);
        let turned = (1..FINENESS - i).map(move |j| [at(i, j), at(i + 1, j), at(i + 1, j - 1)]);
        upright.chain(turned)
    })
}

/// The contact point's way with both interpolations, and where it was when a setting without one clicked.
fn track(area: &Area, camera: &Camera, rate: &Rate) -> Result<()> {
    let [smooth, ablated @ ..] = &rate.settings;
    let way: Vec<DVec3> = contact_points(smooth).map(|(_, p)| p).collect();
    for (ink, width) in [(WHITE, 16), (BLACK, 8)] {
        for run in way.split(|&p| !camera.sees(p)).filter(|run| run.len() > 1) {
            let pixels: Vec<_> = run.iter().map(|&p| camera.pixel(p)).collect();
            polyline(area, &pixels, ink.into(), width)?;
        }
    }
    for (rollout, (ink, size)) in ablated.iter().zip(MARKS) {
        for &(sample, _) in &rollout.clicks {
            let place = contact_points(rollout).find(|&(i, _)| i + 1 >= sample);
            if let Some((_, p)) = place.filter(|&(_, p)| camera.sees(p)) {
                area.draw(&Circle::new(camera.pixel(p), size + 3, WHITE.filled()))?;
                area.draw(&Circle::new(camera.pixel(p), size, ink.filled()))?;
            }
        }
    }
    for (p, text) in [(way.first(), "press"), (way.last(), "release")] {
        if let Some(&p) = p.filter(|&&p| camera.sees(p)) {
            let (x, y) = camera.pixel(p);
            area.draw(&Circle::new((x, y), 20, WHITE.filled()))?;
            area.draw(&Circle::new((x, y), 15, BLACK.filled()))?;
            for (dx, dy) in [(-4, 0), (4, 0), (0, -4), (0, 4), (-3, -3), (3, -3), (-3, 3), (3, 3)] {
                let halo = ("sans-serif", 40).into_font().color(&WHITE);
                area.draw(&Text::new(text, (x - 10 + dx, y - 76 + dy), halo))?;
            }
            area.draw(&Text::new(text, (x - 10, y - 76), font(40)))?;
        }
    }
    Ok(())
}

/// (sample, contact point) while touching.
fn contact_points(rollout: &Rollout) -> impl Iterator<Item = (usize, DVec3)> {
    let touching =
        |(i, o): (usize, &palpate_engine::Output)| Some((i, DVec3::from_array(o.contact?.position_m)));
    rollout.samples.iter().enumerate().filter_map(touching)
}

fn colour_bar(area: &Area, range: &Range<f64>) -> Result<()> {
    let (left, top, width, height) = (40, 360, 60, 1100);
    for y in 0..height {
        let shade = colour(1.0 - f64::from(y) / f64::from(height)).filled();
        area.draw(&Rectangle::new([(left, top + y), (left + width, top + y + 1)], shade))?;
    }
    area.draw(&Text::new("normal stiffness", (left, top - 120), font(36)))?;
    area.draw(&Text::new("kᶻ (N/m)", (left, top - 70), font(36)))?;
    let [least, most] = [range.start, range.end].map(|g| g * NORMAL_STIFFNESS);
    for tick in (0..).map(|i| 100.0 * f64::from(i)).skip_while(|&k| k < least).take_while(|&k| k <= most) {
        let y = top + ((most - tick) / (most - least) * f64::from(height)).round() as i32;
        area.draw(&PathElement::new([(left + width, y), (left + width + 14, y)], INK.stroke_width(3)))?;
        area.draw(&Text::new(format!("{tick:.0}"), (left + width + 24, y - 17), font(34)))?;
    }
    Ok(())
}

fn key(area: &Area) -> Result<()> {
    area.draw(&PathElement::new([(40, 26), (110, 26)], BLACK.stroke_width(8)))?;
    area.draw(&Text::new("contact point", (126, 16), font(38)))?;
    for (x, (ink, size), what) in [(480, MARKS[0], "coordinates"), (1140, MARKS[1], "responses")] {
        area.draw(&Circle::new((x, 26), size, ink.filled()))?;
        area.draw(&Text::new(format!("click with {what} off"), (x + 36, 16), font(38)))?;
    }
    Ok(())
}

fn share(g: f64, range: &Range<f64>) -> f64 {
    (g - range.start) / (range.end - range.start)
}

/// From viridis.
fn colour(share: f64) -> RGBColor {
    let [r, g, b] = palpate::colours::viridis(share).map(|c| (255.0 * c).round() as u8);
    RGBColor(r, g, b)
}
