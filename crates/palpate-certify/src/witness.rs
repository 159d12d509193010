//! Witnesses: tool paths that show what a certificate says may happen. Each was traced before it is given.

use glam::DVec3;
use palpate_body::{Body, SlipRule};
use palpate_engine::Waypoint;
use palpate_engine::certify::{Assumptions, Cell, Criterion, ElementStates, SlipState};
use palpate_engine::rollout;
use palpate_engine::{Ablation, Flags, ToolState};
use serde::Serialize;
use std::path::PathBuf;

/// From one row of a witness to the next, m: fine enough that a click stands out.
const FINE: f64 = 1e-5;
/// The tool comes from this high, m.
const ABOVE: f64 = 1e-3;
/// Clicks below this are none, N (MODEL 5).
const CLICK: f64 = 1e-3;

/// A witness as it was traced.
#[derive(Debug, Clone, Serialize)]
pub struct Shown {
    /// The path's file, if it was written.
    pub path: Option<PathBuf>,
    /// Its rows.
    pub rows: usize,
    /// Energy that slip generated along it, J.
    pub generated_j: f64,
    /// Largest step of the force, N, at its own rate,
    pub largest_step_n: f64,
    /// and sampled ten times finer: a jump stays.
    pub finer_step_n: f64,
    /// The path itself.
    #[serde(skip)]
    pub waypoints: Vec<Waypoint>,
}

/// Shares of a state's depth at which it is tried: where P and S are both broken no path may come as deep.
const DEPTHS: [f64; 5] = [1.0, 0.7, 0.5, 0.3, 0.2];

/// A path that makes energy out of nothing near a state that breaks P, as deep or less.
pub fn of_energy(body: &Body, assumptions: &Assumptions, element: u32, cell: &Cell) -> Option<Shown> {
    DEPTHS.iter().find_map(|share| {
        let cell = Cell {
            depth_m: cell.depth_m.map(|z| z * share),
            reach_m: cell.reach_m.map(|r| r * share),
            ..*cell
        };
        generating(body, assumptions, element, &cell)
    })
}

/// Presses at the state's contact point, or a little before it, and drags across, with all slips where P is broken.
fn generating(body: &Body, assumptions: &Assumptions, element: u32, cell: &Cell) -> Option<Shown> {
    let patch = ElementStates::new(body, element, assumptions);
    let broken = |cell: &Cell| Criterion::Passive.bound(&patch, cell) < 0.0;
    // Along the way, with friction just overcome.
    let at = |way: f64| patch.moved(cell, way).map(|c| patch.at_limit(&c)).filter(|c| broken(c));
    let far = |sign: f64| (1..1000).take_while(|i| at(sign * f64::from(*i) * FINE).is_some()).count() as i32;
    if at(0.0).is_some() {
        let (from, to) = (-far(-1.0), far(1.0));
        let drag: Vec<SlipState> =
            (from..=to).filter_map(|i| at(f64::from(i) * FINE)).map(|c| patch.state(&c)).collect();
        if let Some(shown) =
            traced(body, assumptions.slip, &[pressed(body, drag.first()?), tips(&drag)].concat())
            && shown.generated_j > 0.0
        {
            return Some(shown);
        }
    }
    // Only beyond the limit: a leap from within it.
    let start = patch.state(&patch.at_limit(cell));
    let leap = patch.state(cell);
    traced(body, assumptions.slip, &[pressed(body, &start), vec![leap.tool_position]].concat())
        .filter(|s| s.generated_j > 0.0)
}

/// A path on which the force jumps near a state that breaks S: presses at its contact point and moves laterally until friction
/// is overcome.
pub fn of_snap(body: &Body, assumptions: &Assumptions, element: u32, cell: &Cell) -> Option<Shown> {
    let patch = ElementStates::new(body, element, assumptions);
    let state = patch.state(&patch.at_limit(cell));
    let mut path = pressed(body, &state);
    let aside = state.lateral.try_normalize().unwrap_or(state.along);
    let beyond = 0.2 * state.lateral.length() + 2e-4;
    path.extend(line(state.tool_position, state.tool_position + aside * beyond));
    let shown = traced(body, assumptions.slip, &path)?;
    // A jump does not shrink with the steps.
    (shown.finer_step_n > CLICK && shown.finer_step_n > 0.5 * shown.largest_step_n).then_some(shown)
}

/// From above the contact point down along its frame, and laterally to the state: in stick.
fn pressed(body: &Body, state: &SlipState) -> Vec<DVec3> {
    let outside = state.contact - state.inward * (ABOVE + body.tool().radius_m());
    let down = state.tool_position - state.lateral;
    [line(outside, down), line(down, state.tool_position)].concat()
}

fn tips(states: &[SlipState]) -> Vec<DVec3> {
    states.iter().map(|s| s.tool_position).collect()
}

/// Its end, and its beginning where it is a point.
fn line(from: DVec3, to: DVec3) -> Vec<DVec3> {
    let steps = (from.distance(to) / FINE).ceil().max(1.0);
    (0..=steps as u32).map(|i| from + (to - from) * (f64::from(i) / steps)).collect()
}

/// Leads a contact along the tips, one millisecond a row; none if the contact was lost, or did something that no
/// certificate speaks of.
fn traced(body: &Body, slip: SlipRule, tips: &[DVec3]) -> Option<Shown> {
    let mut tips = tips.to_vec();
    tips.dedup_by(|a, b| a.distance(*b) < 1e-9);
    let (generated_j, largest_step_n) = led(body, slip, &tips)?;
    let finer: Vec<DVec3> = tips
        .windows(2)
        .flat_map(|w| (0..10).map(move |i| w[0] + (w[1] - w[0]) * (f64::from(i) / 10.0)))
        .chain(tips.last().copied())
        .collect();
    let (_, finer_step_n) = led(body, slip, &finer)?;
    let waypoints: Vec<Waypoint> = waypoints(&tips).collect();
    Some(Shown { path: None, rows: waypoints.len(), generated_j, largest_step_n, finer_step_n, waypoints })
}

/// A millisecond each.
fn waypoints(tips: &[DVec3]) -> impl Iterator<Item = Waypoint> {
    let at =
        |(i, x): (usize, &DVec3)| Waypoint { time_s: i as f64 * 1e-3, pose: ToolState::at(x.to_array()) };
    tips.iter().enumerate().map(at)
}

/// Energy generated, and the largest step of the force while in contact.
fn led(body: &Body, slip: SlipRule, tips: &[DVec3]) -> Option<(f64, f64)> {
    // What the rule does, which the tank would hold back.
    let mut outputs = rollout(body, waypoints(tips), slip, Ablation::None).without_tank();
    let (mut before, mut largest, mut touching) = (DVec3::ZERO, 0.0f64, false);
    for output in outputs.by_ref() {
        let flags = output.flags;
        let odd = Flags::REANCHORED | Flags::CAPPED | Flags::BLOCKED | Flags::STARTED_INSIDE | Flags::BORDER;
        if flags.has(odd) {
            return None;
        }
        let force = DVec3::from_array(output.force_n);
        if touching {
            largest = largest.max(force.distance(before));
        }
        (before, touching) = (force, flags.has(Flags::IN_CONTACT));
    }
    // Rounding is no gain.
    let energy = outputs.contact().energy();
    let noise = 1e-12 * (energy.work_j.abs() + energy.dissipated_j.abs());
    touching.then_some((if energy.generated_j > noise { energy.generated_j } else { 0.0 }, largest))
}
