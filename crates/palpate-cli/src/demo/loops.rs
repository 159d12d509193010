//! The experiment with the loop closed: a simulated hand and device slide over the cylinder, and rest inside it.
//!
//! Sliding shows textures: vibration that no smooth body has. Resting over an edge of the same tube, touched from
//! inside, shows limit cycles: there each edge is a groove in which the ablated force flips from side to side.

use super::canvas::{Area, INK, font, key, named_stroke, names, paint};
use super::cylinder::{self, ALONG, AROUND, LATERAL_STIFFNESS, NORMAL_STIFFNESS, RADIUS};
use super::experiment::SETTINGS;
use super::pictures::TITLES;
use crate::plot::COLOURS;
use anyhow::{Context, Result};
use glam::DVec3;
use palpate_body::{Body, Response, SlipRule, Surface};
use palpate_device::simulated::{HandMotion, Target};
use palpate_device::{Device, Simulated, presets};
use palpate_engine::{Ablation, Contact};
use palpate_runtime::{Cycle, HapticLoop, Stages, WorkspaceMap};
use plotters::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;
use std::path::Path;

/// The loop's rate, Hz.
const RATE: f64 = 1e3;
/// Vibration above this is texture, Hz: hands move slower, and the ridges of 24 smooth facets pass slower.
pub const TEXTURE_ABOVE: f64 = 100.0;
/// With both interpolations the texture may be no more, N.
pub const TEXTURE_MAX: f64 = 0.5e-3;
/// Without either one it must be more, N.
pub const ABLATED_TEXTURE_MIN: f64 = 2e-3;

/// How deep the hand wants to be, m.
const DEPTH: f64 = 5.5e-3;
/// How fast it slides, m/s, and how far, m.
const SLIDE: (f64, f64) = (30e-3, 0.1);
/// The first of the slide is left out, and as much of its end, s.
const EDGES: f64 = 0.4;
/// Pressing takes, s.
const PRESS: f64 = 0.7;

/// Friction inside: a wet wall.
const WET: f64 = 0.05;
/// An edge along the tube, rad, around which the hand rests, and how far on either side of it, m.
const EDGE: (f64, f64) = (TAU / 3.0, 0.5e-3);
/// At so many places.
const PLACES: u32 = 17;
/// So long at each, s; cycles are sought in the last of it.
const REST: (f64, f64) = (5.0, 3.0);

/// What the closed loops did.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Loops {
    /// Sliding over the cylinder, in the order of the settings.
    pub sliding: Vec<Sliding>,
    /// Resting inside it.
    pub resting: Vec<Resting>,
}

/// A slide in one setting.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sliding {
    /// The setting's name.
    pub name: &'static str,
    /// Root mean square of the force above 100 Hz, N.
    pub texture_n: f64,
    /// The same of the tool's velocity, m/s.
    pub vibration_m_per_s: f64,
    /// Largest |ΔF| from one sample to the next, N.
    pub largest_step_n: f64,
    /// Energy that slip created, J.
    pub generated_j: f64,
    /// (Hz, N/√Hz) of the force.
    #[serde(skip)]
    spectrum: Vec<(f64, f64)>,
}

/// Rests in one setting.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Resting {
    /// The setting's name.
    pub name: &'static str,
    /// Places that the hand rested at.
    pub places: u32,
    /// Those at which the tool went on moving to and fro.
    pub cycling: u32,
    /// The largest amplitude, m.
    pub amplitude_m: f64,
    /// Its frequency, Hz.
    pub frequency_hz: f64,
    /// (s, mm around the tube) at the place of the largest amplitude, or the first.
    #[serde(skip)]
    motion: Vec<(f64, f64)>,
}

/// Closes the loop on the demo's cylinder, and on the same tube from inside, in all settings.
///
/// # Errors
/// None that the constants allow.
pub fn run(body: &Body) -> Result<Loops> {
    let inside = tube()?;
    let sliding = SETTINGS.iter().map(|&(name, ablation)| slide(body, name, ablation));
    let resting = SETTINGS.iter().map(|&(name, ablation)| rests(&inside, name, ablation));
    Ok(Loops { sliding: sliding.collect::<Result<_>>()?, resting: resting.collect::<Result<_>>()? })
}

impl Loops {
    /// One sentence for each bar that was not reached.
    pub fn judge(&self) -> Vec<String> {
        let textures = self.sliding.iter().filter_map(|s| {
            let mn = s.texture_n * 1e3;
            match s.name {
                "both" => (s.texture_n > TEXTURE_MAX)
                    .then(|| format!("closed loop, both: sliding has a texture of {mn:.2} mN")),
                _ => (s.texture_n < ABLATED_TEXTURE_MIN)
                    .then(|| format!("closed loop, {}: the texture is only {mn:.2} mN", s.name)),
            }
        });
        let cycles = self.resting.iter().filter_map(|r| match (r.name, r.cycling) {
            ("both", 1..) => Some(format!("closed loop, both: {} rests have a limit cycle", r.cycling)),
            ("coordinates-off", 0) => Some("closed loop, coordinates-off: no rest has a limit cycle".into()),
            _ => None,
        });
        textures.chain(cycles).collect()
    }

    /// The table of the report.
    pub fn table(&self) -> String {
        let mut text = String::from(
            "| setting              | texture while sliding | limit cycles at rest | largest           |\n\
             |:---------------------|----------------------:|---------------------:|------------------:|\n",
        );
        for ((s, r), title) in self.sliding.iter().zip(&self.resting).zip(TITLES) {
            let largest = match r.cycling {
                0 => String::new(),
                _ => format!("{:.3} mm at {:.0} Hz", r.amplitude_m * 1e3, r.frequency_hz),
            };
            text += &format!(
                "| {title:20} | {:18.2} mN | {:14} of {} | {largest:>17} |\n",
                s.texture_n * 1e3,
                r.cycling,
                r.places
            );
        }
        text
    }
}

/// The demo's tube, touched from inside, wet.
fn tube() -> Result<Body> {
    let mut mesh = cylinder::SHAPE.mesh(cylinder::resolution(AROUND, ALONG))?;
    for triangle in &mut mesh.triangles {
        triangle.swap(1, 2);
    }
    let surface = Surface::build(&mesh, f64::INFINITY)?;
    let into = surface.positions().iter().map(|p| DVec3::new(p.x, p.y, 0.0).normalize()).collect();
    let surface = surface.with_inward_normals(into)?;
    let response = |p: DVec3| {
        let [kz, kr] = [NORMAL_STIFFNESS, LATERAL_STIFFNESS].map(|k| k * cylinder::stiffness(p));
        Response::paper(kz, kr, WET, cylinder::DEFLECTION_MAX, cylinder::DEFLECTION_MAX)
    };
    Ok(Body::new(cylinder::parts(surface, response, SlipRule::Paper)?)?)
}

/// A hand that presses to a depth and then goes around, and along as it goes.
#[derive(Debug, Clone, Copy)]
struct Around {
    /// 1 outside, −1 inside.
    side: f64,
    /// rad, m.
    from: (f64, f64),
    /// How far around, rad, and how far along for each m of that.
    way: (f64, f64),
    /// How long that takes, s.
    seconds: f64,
}

impl Around {
    fn place(&self, t: f64) -> DVec3 {
        let least_jerk = |u: f64| {
            let u = u.clamp(0.0, 1.0);
            u * u * u * (10.0 + u * (6.0 * u - 15.0))
        };
        let above = 2e-3;
        let depth = (above + DEPTH) * least_jerk(t / PRESS) - above;
        let turn = self.way.0 * least_jerk((t - PRESS) / self.seconds);
        let radius = RADIUS - self.side * depth;
        let (sin, cos) = libm::sincos(self.from.0 + turn);
        DVec3::new(radius * cos, radius * sin, self.from.1 + self.way.1 * RADIUS * turn)
    }
}

impl HandMotion for Around {
    fn target(&self, t: f64) -> Target {
        // A central difference: its error, jerk h²/6, is below a nanometre a second.
        let h = 1e-6;
        let velocity_m_per_s = (self.place(t + h) - self.place(t - h)) / (2.0 * h);
        Target { position_m: self.place(t), velocity_m_per_s, ..Target::default() }
    }

    fn duration_s(&self) -> f64 {
        PRESS + self.seconds
    }
}

/// One sample of a loop: the force, the tool's velocity and its place.
type Sample = (DVec3, DVec3, DVec3);

fn close(body: &Body, ablation: Ablation, intent: Around, seconds: f64) -> Result<(Vec<Sample>, Contact)> {
    let capabilities = presets::device("bench").context("the bench device is gone")?;
    let (hand, _) = presets::hand("fingers").context("the fingers are gone")?;
    let mut device = Simulated::new(capabilities, hand, Box::new(intent));
    device.open()?;
    let contact = Contact::with_ablation(body, ablation);
    let mut closed = HapticLoop::new(contact, WorkspaceMap::default(), Stages::default());
    let mut samples = Vec::new();
    for k in 0..(seconds * RATE) as u32 {
        let step = closed.step(body, &mut device, f64::from(k) / RATE)?;
        let force = DVec3::from_array(step.output.force_n);
        samples.push((force, device.velocity_m_per_s(), device.position_m()));
    }
    Ok((samples, closed.contact().clone()))
}

fn slide(body: &Body, name: &'static str, ablation: Ablation) -> Result<Sliding> {
    let seconds = SLIDE.1 / SLIDE.0;
    // Off the mesh's own lines: as the open-loop path, a helix.
    let intent = Around { side: 1.0, from: (0.37, -14.3e-3), way: (SLIDE.1 / RADIUS, 0.27), seconds };
    let (samples, contact) = close(body, ablation, intent, PRESS + seconds)?;
    let steps = samples.windows(2).map(|w| w[1].0.distance(w[0].0));
    let largest_step_n = steps.fold(0.0, f64::max);
    let edge = (EDGES * RATE) as usize;
    let steady =
        samples.get((PRESS * RATE) as usize + edge..samples.len() - edge).context("a short slide")?;
    let [force, velocity] = [0, 1].map(|i| power(&steady.iter().map(|s| [s.0, s.1][i]).collect::<Vec<_>>()));
    Ok(Sliding {
        name,
        texture_n: above(&force, TEXTURE_ABOVE),
        vibration_m_per_s: above(&velocity, TEXTURE_ABOVE),
        largest_step_n,
        generated_j: contact.energy().generated_j,
        spectrum: force.into_iter().map(|(f, p)| (f, p.sqrt())).collect(),
    })
}

fn rests(body: &Body, name: &'static str, ablation: Ablation) -> Result<Resting> {
    let mut resting =
        Resting { name, places: PLACES, cycling: 0, amplitude_m: 0.0, frequency_hz: 0.0, motion: Vec::new() };
    for i in 0..PLACES {
        let aside = EDGE.1 * (2.0 * f64::from(i) / f64::from(PLACES - 1) - 1.0) / RADIUS;
        // Comes sliding, as a hand does.
        let way = 0.05;
        let intent = Around { side: -1.0, from: (EDGE.0 + aside - way, 3e-3), way: (way, 0.0), seconds: 0.1 };
        let (samples, _) = close(body, ablation, intent, REST.0)?;
        let rest = samples.get(((REST.0 - REST.1) * RATE) as usize..).unwrap_or_default();
        let places: Vec<DVec3> = rest.iter().map(|s| s.2).collect();
        let cycle = Cycle::find(&places, 1.0 / RATE, 1e-6);
        resting.cycling += u32::from(cycle.is_some());
        let larger = cycle.filter(|c| c.amplitude_m > resting.amplitude_m);
        if let Some(Cycle { period_s, amplitude_m, .. }) = larger {
            (resting.amplitude_m, resting.frequency_hz) = (amplitude_m, 1.0 / period_s);
        }
        if larger.is_some() || i == 0 {
            let around = |p: DVec3| (libm::atan2(p.y, p.x) - EDGE.0) * RADIUS * 1e3;
            resting.motion =
                samples.iter().enumerate().map(|(k, s)| (k as f64 / RATE, around(s.2))).collect();
        }
    }
    Ok(resting)
}

/// Samples of a window of Welch's method.
const WINDOW: usize = 512;

/// Power spectral density (Hz, unit²/Hz) of all components together: Welch's method, Hann windows half over each other.
fn power(signal: &[DVec3]) -> Vec<(f64, f64)> {
    let hann: Vec<f64> =
        (0..WINDOW).map(|i| 0.5 - 0.5 * libm::cos(TAU * (i as f64 + 0.5) / WINDOW as f64)).collect();
    let weight: f64 = hann.iter().map(|w| w * w).sum();
    let starts: Vec<usize> =
        (0..).map(|s| s * WINDOW / 2).take_while(|s| s + WINDOW <= signal.len()).collect();
    let bins = 1..WINDOW / 2;
    let at = |bin: usize| {
        // Goertzel's recurrence at this bin.
        let turn = 2.0 * libm::cos(TAU * bin as f64 / WINDOW as f64);
        let sum: f64 = starts
            .iter()
            .map(|&start| {
                let part = &signal[start..start + WINDOW];
                let mean = part.iter().sum::<DVec3>() / WINDOW as f64;
                let (a, b) = part
                    .iter()
                    .zip(&hann)
                    .fold((DVec3::ZERO, DVec3::ZERO), |(a, b), (x, w)| ((*x - mean) * *w + turn * a - b, a));
                (a * a + b * b - turn * a * b).element_sum()
            })
            .sum();
        2.0 * sum / (starts.len().max(1) as f64 * weight * RATE)
    };
    bins.map(|bin| (bin as f64 * RATE / WINDOW as f64, at(bin))).collect()
}

/// Root mean square above a frequency.
fn above(power: &[(f64, f64)], hz: f64) -> f64 {
    let sum: f64 = power.iter().filter(|(f, _)| *f >= hz).map(|(_, p)| p).sum();
    (sum * RATE / WINDOW as f64).sqrt()
}

/// `loops.png`: the sliding force's spectrum above, the resting tool's motion below.
///
/// # Errors
/// A file that can't be written.
pub fn picture(path: &Path, loops: &Loops) -> Result<()> {
    paint(path, (1300, 1120), |area| {
        let (head, rest) = area.split_vertically(90);
        head.draw(&Text::new(
            "The loop closed: a hand slides over the cylinder, and rests inside it",
            (40, 30),
            font(50),
        ))?;
        let (upper, lower) = rest.split_vertically(1180);
        spectra(&upper, loops)?;
        motions(&lower, loops)
    })
}

fn spectra(area: &Area, loops: &Loops) -> Result<()> {
    let (low, high) = (1e-7, 1e-1);
    let mut chart = ChartBuilder::on(area)
        .margin(30)
        .x_label_area_size(100)
        .y_label_area_size(190)
        .build_cartesian_2d((4.0..500.0).log_scale(), (low..high).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("frequency (Hz)")
        .y_desc("force while sliding (N/√Hz)")
        .axis_desc_style(font(38))
        .label_style(font(34))
        .x_label_formatter(&|hz| format!("{hz:.0}"))
        .y_label_formatter(&|v| format!("{v:.0e}"))
        .light_line_style(TRANSPARENT)
        .bold_line_style(INK.mix(0.12))
        .draw()?;
    for ((s, colour), title) in loops.sliding.iter().zip(COLOURS).zip(TITLES) {
        let inside = s.spectrum.iter().map(|&(f, v)| (f, v.clamp(low, high)));
        let style = colour.stroke_width(5);
        chart
            .draw_series(LineSeries::new(inside.filter(|p| p.0 >= 4.0), style))?
            .label(format!("{title}: {:.2} mN above 100 Hz", s.texture_n * 1e3))
            .legend(key(style));
    }
    names(&mut chart, SeriesLabelPosition::LowerLeft)
}

fn motions(area: &Area, loops: &Loops) -> Result<()> {
    let shown: Vec<_> = [0, 1].into_iter().filter_map(|i| loops.resting.get(i)).collect();
    let from = REST.0 - 2.0;
    let late = |r: &Resting| r.motion.iter().copied().filter(|p| p.0 >= from).collect::<Vec<_>>();
    let lines: Vec<Vec<(f64, f64)>> = shown.iter().map(|r| late(r)).collect();
    // Each around its own mean: they rest at different places.
    let centred = lines.iter().map(|line| {
        let mean = line.iter().map(|p| p.1).sum::<f64>() / line.len().max(1) as f64;
        line.iter().map(|p| (p.0, p.1 - mean)).collect::<Vec<_>>()
    });
    let lines: Vec<Vec<(f64, f64)>> = centred.collect();
    let top = lines.iter().flatten().map(|p| p.1.abs()).fold(1e-3, f64::max) * 1.15;
    let mut chart = ChartBuilder::on(area)
        .margin(30)
        .x_label_area_size(100)
        .y_label_area_size(190)
        .build_cartesian_2d(from..REST.0, -top..top)?;
    chart
        .configure_mesh()
        .x_desc("time (s); the hand rests over an edge inside")
        .y_desc("tool, around (mm)")
        .y_label_formatter(&|mm| format!("{:.2}", (mm * 100.0).round() / 100.0 + 0.0))
        .axis_desc_style(font(38))
        .label_style(font(34))
        .light_line_style(TRANSPARENT)
        .bold_line_style(INK.mix(0.12))
        .draw()?;
    for ((line, colour), title) in lines.into_iter().zip(COLOURS).zip(TITLES).rev() {
        named_stroke(&mut chart, title, line.into_iter(), colour, 5)?;
    }
    names(&mut chart, SeriesLabelPosition::UpperRight)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sine of amplitude 2 mN has 1.41 mN, all of it at its frequency.
    #[test]
    fn the_spectrum_is_true_to_scale() {
        let wave = |i: i32| DVec3::Y * (2e-3 * libm::sin(TAU * 250.0 * f64::from(i) / RATE + 0.3) + 0.7);
        let power = power(&(0..2000).map(wave).collect::<Vec<_>>());
        assert!((above(&power, 100.0) - 2e-3 / f64::sqrt(2.0)).abs() < 1e-6);
        assert!(above(&power, 300.0) < 1e-8);
    }
}
