//! Ridges: a tool dragged around a tube of 24 flat sides, with neither interpolation of frames, with the paper's, and
//! over a refined surface.

use super::cylinder::{
    ALONG, AROUND, FRICTION, LATERAL_STIFFNESS, NORMAL_STIFFNESS, RADIUS, SHAPE, parts, resolution,
};
use crate::plot::{Line, LineChart, save};
use anyhow::Result;
use glam::DVec3;
use palpate_body::{Body, Fineness, Response, SlipRule};
use palpate_engine::{Ablation, Contact, ToolState};
use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

/// How deep below the true cylinder, m.
const DEPTH: f64 = 5e-3;
/// Of the refined surface, m. Ridges of 10 µm would be 6 mN: this tube has 600 N/m at that depth.
const SAGITTA: f64 = 1e-6;
/// Samples of a full turn; 0.1 m/s at 1 kHz.
const TURN: u32 = 1571;
/// Samples before it, in which the contact point begins to slip.
const BEFORE: u32 = 200;

/// On the refined surface the force may ripple by this share of itself, %, and by this much, N.
pub const RIPPLE_MAX: (f64, f64) = (0.2, 3e-3);

/// A turn around the tube.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ridges {
    /// `flat-facets`, `interpolated-normals` or `refined-surface`.
    pub name: &'static str,
    /// Of the mesh.
    pub triangles: usize,
    /// Mean magnitude of the force, N.
    pub mean_force_n: f64,
    /// Greatest less least magnitude, N.
    pub ripple_n: f64,
    /// The same as a share of the mean, %.
    pub ripple_percent: f64,
    /// Largest |ΔF| from one sample to the next, N.
    pub largest_step_n: f64,
    /// The same as a share of the mean, %.
    pub largest_step_percent: f64,
    /// The angle, degrees, and the magnitude, N.
    #[serde(skip)]
    course: Vec<(f64, f64)>,
}

/// All three.
///
/// # Errors
/// None that the constants above allow.
pub fn run() -> Result<Vec<Ridges>> {
    let surface = SHAPE.surface(resolution(AROUND, ALONG))?;
    let radial = surface.positions().iter().map(|p| -DVec3::new(p.x, p.y, 0.0).normalize()).collect();
    // Alike everywhere, so that all that ripples is the surface.
    let alike = |_| Response::paper(NORMAL_STIFFNESS, LATERAL_STIFFNESS, FRICTION, 8e-3, 8e-3);
    let coarse = Body::new(parts(surface.with_inward_normals(radial)?, alike, SlipRule::Consistent)?)?;
    let refined = coarse.refined(Fineness::sagitta(SAGITTA))?.body;
    Ok(vec![
        turn("flat-facets", &coarse, Ablation::Coordinates),
        turn("interpolated-normals", &coarse, Ablation::None),
        turn("refined-surface", &refined, Ablation::None),
    ])
}

fn turn(name: &'static str, body: &Body, ablation: Ablation) -> Ridges {
    let mut contact = Contact::with_ablation(body, ablation);
    let at = |angle: f64, r: f64| DVec3::new(r * libm::cos(angle), r * libm::sin(angle), 1e-3);
    let step = |contact: &mut Contact, x: DVec3| {
        DVec3::from_array(contact.step(body, &ToolState::at(x.to_array()), 1e-3).force_n)
    };
    let per = TAU / f64::from(TURN);
    let start = -f64::from(BEFORE) * per;
    for i in 0..=60 {
        step(&mut contact, at(start, RADIUS + 1e-3 - (DEPTH + 1e-3) * f64::from(i) / 60.0));
    }
    for i in 1..BEFORE {
        step(&mut contact, at(start + f64::from(i) * per, RADIUS - DEPTH));
    }
    let angles = (0..=TURN).map(|i| f64::from(i) * per);
    let forces: Vec<DVec3> = angles.map(|angle| step(&mut contact, at(angle, RADIUS - DEPTH))).collect();
    let sizes: Vec<f64> = forces.iter().map(|f| f.length()).collect();
    let [least, most] =
        [sizes.iter().fold(f64::INFINITY, |m, f| m.min(*f)), sizes.iter().fold(0.0, |m, f| f.max(m))];
    let mean = sizes.iter().sum::<f64>() / sizes.len() as f64;
    let largest = forces.windows(2).map(|f| f[1].distance(f[0])).fold(0.0, f64::max);
    let degrees = |i: usize| (i as f64 * per).to_degrees();
    Ridges {
        name,
        triangles: body.elements().len(),
        mean_force_n: mean,
        ripple_n: most - least,
        ripple_percent: (most - least) / mean * 1e2,
        largest_step_n: largest,
        largest_step_percent: largest / mean * 1e2,
        course: sizes.iter().enumerate().map(|(i, f)| (degrees(i), *f)).collect(),
    }
}

/// One sentence for each bar that was not reached.
pub fn judge(ridges: &[Ridges]) -> Vec<String> {
    let (percent, newton) = RIPPLE_MAX;
    let refined = ridges.iter().filter(|r| r.name == "refined-surface");
    // NaN must not pass for small.
    let short = refined.filter(|r| !(r.ripple_percent < percent && r.ripple_n < newton));
    short
        .map(|r| {
            format!(
                "{}: the force ripples by {:.3} % and {:.2} mN, where {percent} % and {} mN are the most",
                r.name,
                r.ripple_percent,
                r.ripple_n * 1e3,
                newton * 1e3
            )
        })
        .collect()
}

/// For the report.
pub fn table(ridges: &[Ridges]) -> String {
    let mut text = String::from(
        "| surface              | triangles | force   | ripple             | largest step      |\n\
         |:---------------------|----------:|--------:|-------------------:|------------------:|\n",
    );
    for r in ridges {
        let _ = writeln!(
            text,
            "| {:20} | {:9} | {:5.3} N | {:6.2} mN, {:5.2} % | {:6.1} mN, {:4.1} % |",
            r.name.replace('-', " "),
            r.triangles,
            r.mean_force_n,
            r.ripple_n * 1e3,
            r.ripple_percent,
            r.largest_step_n * 1e3,
            r.largest_step_percent
        );
    }
    text
}

/// `ridges.png`: a part of the turn.
///
/// # Errors
/// A file that can't be written.
pub fn picture(path: &Path, ridges: &[Ridges]) -> Result<()> {
    let part = |r: &Ridges| r.course.iter().copied().take_while(|(angle, _)| *angle <= 90.0).collect();
    let line = |r: &Ridges| Line { name: r.name.replace('-', " "), points: part(r), ..Line::default() };
    let chart = LineChart {
        title: "Dragged around a tube of 24 flat sides, 5 mm deep".into(),
        x_label: "angle (degrees)".into(),
        y_label: "magnitude of the force (N)".into(),
        lines: ridges.iter().map(line).collect(),
        from_zero: false,
    };
    save(path, &[chart])
}
