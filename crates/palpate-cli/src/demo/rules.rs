//! The slip rules' energy: pressed in where the body is soft, dragged without friction to where it is stiff, let go.

use super::cylinder::{LATERAL_STIFFNESS, NORMAL_STIFFNESS, RADIUS, SHAPE, parts, resolution};
use super::experiment::CLICK;
use crate::plot::{Line, LineChart, save};
use anyhow::Result;
use glam::DVec3;
use palpate_body::{Body, Response, SlipRule};
use palpate_engine::{Ablation, Contact, Flags, ToolState};
use serde::Serialize;
use std::f64::consts::PI;
use std::fmt::Write;
use std::path::Path;

/// Elements around the tube: the paper's, and four times as many.
const AROUND: [u32; 2] = [24, 96];
/// How deep, m.
const DEPTH: f64 = 8e-3;
/// Samples of the press, and as many of the release; at 1 kHz.
const PRESS: u32 = 800;
/// Samples of the drag half around the tube.
const DRAG: u32 = 6000;
/// The default rule may hand out at most this share of the paper's energy.
const SHARE_MAX: f64 = 0.1;

/// One rule on one mesh.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cycle {
    /// Elements around the tube.
    pub around: u32,
    /// Slip rule.
    pub slip: &'static str,
    /// What the hand got for nothing: the force along the tool's way from free space to free space, J.
    pub handed_out_j: f64,
    /// What the ledger counts as generated on the way, J; it may have been lost again.
    pub generated_j: f64,
    /// Largest step of the force in a millisecond, N.
    pub largest_step_n: f64,
    /// Largest step beyond the bound, N.
    pub excess_step_n: f64,
    /// What the hand got so far, mJ, each tenth sample.
    #[serde(skip)]
    course: Vec<(f64, f64)>,
}

/// Leads every rule over every mesh.
///
/// # Errors
/// None that the constants above allow.
pub fn run() -> Result<Vec<Cycle>> {
    let mut cycles = Vec::new();
    for around in AROUND {
        let body = tube(around)?;
        cycles.extend(SlipRule::ALL.map(|rule| cycle(&body, around, rule)));
    }
    Ok(cycles)
}

/// Three times as stiff on one side as on the other, and without friction.
fn tube(around: u32) -> Result<Body> {
    let surface = SHAPE.surface(resolution(around, 10))?;
    let response = |p: DVec3| {
        let normal = NORMAL_STIFFNESS * (1.0 + 0.5 * p.x / RADIUS);
        Response::paper(normal, LATERAL_STIFFNESS, 0.0, DEPTH, DEPTH)
    };
    // Each rule by itself.
    Ok(Body::new(parts(surface, response, SlipRule::Consistent)?)?)
}

fn path() -> impl Iterator<Item = DVec3> {
    let at = |angle: f64, r: f64| DVec3::new(r * libm::cos(angle), r * libm::sin(angle), 1e-3);
    let fall = move |i: u32| 1e-3 - (DEPTH + 1e-3) * f64::from(i) / f64::from(PRESS);
    let press = (0..=PRESS).map(move |i| at(PI, RADIUS + fall(i)));
    let drag = (1..=DRAG).map(move |i| at(PI * (1.0 - f64::from(i) / f64::from(DRAG)), RADIUS - DEPTH));
    let release = (0..PRESS).rev().map(move |i| at(0.0, RADIUS + fall(i)));
    press.chain(drag).chain(release)
}

fn cycle(body: &Body, around: u32, rule: SlipRule) -> Cycle {
    let mut contact = Contact::with_slip(body, rule, Ablation::None);
    let mut last: Option<(DVec3, DVec3, f64)> = None;
    let mut cycle = Cycle {
        around,
        slip: rule.name(),
        handed_out_j: 0.0,
        generated_j: 0.0,
        largest_step_n: 0.0,
        excess_step_n: 0.0,
        course: Vec::new(),
    };
    for (i, x) in path().enumerate() {
        let output = contact.step(body, &ToolState::at(x.to_array()), 1e-3);
        let force = DVec3::from_array(output.force_n);
        let bound = contact.lipschitz_n_per_m(body).unwrap_or(f64::INFINITY);
        if let Some((from, before, bound_before)) = last {
            let (way, step) = (x - from, (force - before).length());
            // The mean force along the way: a step's stretch of the lateral spring, k_r h²/2, is no part of the rule.
            cycle.handed_out_j += 0.5 * (force + before).dot(way);
            cycle.largest_step_n = cycle.largest_step_n.max(step);
            cycle.excess_step_n = cycle.excess_step_n.max(step - bound.max(bound_before) * way.length());
        }
        let bound = if output.flags.has(Flags::IN_CONTACT) { bound } else { 0.0 };
        last = Some((x, force, bound));
        cycle.generated_j = output.energy.generated_j;
        if i % 10 == 0 {
            cycle.course.push((i as f64 * 1e-3, cycle.handed_out_j * 1e3));
        }
    }
    cycle
}

/// One sentence for each bar that was not reached.
pub fn judge(cycles: &[Cycle]) -> Vec<String> {
    let mut shortfalls = Vec::new();
    for rules in cycles.chunks(SlipRule::ALL.len()) {
        let [paper, consistent, exact] = rules else { continue };
        if consistent.handed_out_j > SHARE_MAX * paper.handed_out_j {
            shortfalls.push(format!(
                "consistent, {} around: hands out {:.2} mJ, where the paper's rule hands out {:.2} mJ",
                consistent.around,
                consistent.handed_out_j * 1e3,
                paper.handed_out_j * 1e3
            ));
        }
        if consistent.excess_step_n > CLICK {
            shortfalls.push(format!("consistent: a click of {:.1} mN", consistent.excess_step_n * 1e3));
        }
        if exact.handed_out_j > 0.0 {
            shortfalls.push(format!("exact: hands out {:.2} mJ", exact.handed_out_j * 1e3));
        }
    }
    shortfalls
}

/// For the report.
pub fn table(cycles: &[Cycle]) -> String {
    let mut text = String::from(
        "| slip rule  | elements around | energy to the hand | largest step | excess step |\n\
         |:-----------|----------------:|-------------------:|-------------:|------------:|\n",
    );
    for c in cycles {
        let _ = writeln!(
            text,
            "| {:10} | {:15} | {:+15.3} mJ | {:9.1} mN | {:8.1} mN |",
            c.slip,
            c.around,
            c.handed_out_j * 1e3,
            c.largest_step_n * 1e3,
            c.excess_step_n.max(0.0) * 1e3
        );
    }
    text
}

/// `rules.png`: what the hand got so far, on the coarse mesh.
///
/// # Errors
/// A file that can't be written.
pub fn picture(path: &Path, cycles: &[Cycle]) -> Result<()> {
    let lines = cycles.iter().take(SlipRule::ALL.len());
    let line = |c: &Cycle| Line { name: c.slip.into(), points: c.course.clone(), ..Line::default() };
    let lines = lines.map(line).collect();
    let chart = LineChart {
        title: "Press where it is soft, drag without friction, let go where it is stiff".into(),
        x_label: "time (s)".into(),
        y_label: "energy that the hand got so far (mJ)".into(),
        lines,
        from_zero: false,
    };
    save(path, &[chart])
}
