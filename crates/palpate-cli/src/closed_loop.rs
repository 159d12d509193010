//! The closed loop in virtual time: a simulated device and hand on a body, as fast as the machine can.

use crate::certify::device::{damping_needed, late};
use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::stiffness::stiffness_max;
use palpate_body::{Body, SlipRule};
use palpate_device::simulated::{Energies, Hand, HandMotion as _, figures};
use palpate_device::{Capabilities, Device, Simulated};
use palpate_engine::Waypoint;
use palpate_engine::{Ablation, Contact, Output};
use palpate_runtime::motion::MotionScript;
use palpate_runtime::trace;
use palpate_runtime::{Coupling, Cycle, HapticLoop, PassivityController, Stages, WorkspaceMap};
use serde::Serialize;

/// Of a rest, this much at its beginning (s) is left out when cycles are looked for: the press dies down.
const SETTLING: f64 = 0.3;
/// Below this amplitude (m) nothing is called a cycle: a vibration at 250 Hz is felt from there.
const SMALLEST: f64 = 1e-7;

/// A loop to be run.
#[derive(Debug)]
pub struct Setup {
    /// The device.
    pub capabilities: Capabilities,
    /// The hand that holds it.
    pub hand: Hand,
    /// What it does.
    pub intent: MotionScript,
    /// Periods a second.
    pub rate_hz: f64,
    /// How long, s; `None` for as long as the motion script.
    pub seconds: Option<f64>,
    /// Interpolations taken away.
    pub ablation: Ablation,
    /// Instead of the body's own rule.
    pub slip: Option<SlipRule>,
    /// Whether slip goes without the body's tank.
    pub no_tank: bool,
    /// A virtual coupling of this stiffness, N/m.
    pub coupling_n_per_m: Option<f64>,
    /// Whether the passivity controller may act.
    pub passivity: bool,
}

/// What came out of a run.
#[derive(Debug, Clone, Default, Serialize)]
pub struct LoopSummary {
    /// The device's name.
    pub device: String,
    /// Hz.
    pub rate_hz: f64,
    /// s.
    pub seconds: f64,
    /// What the engine saw and did, as `palpate trace` tells it.
    #[serde(flatten)]
    pub trace: trace::TraceSummary,
    /// What the engine gave out at its port: Σ F_k·(x_k+1 − x_k), J.
    pub out_j: f64,
    /// ½ K_max Σ |x_k+1 − x_k|², J: where the slip rule is passive, out + stored is never above it.
    pub sampling_bound_j: f64,
    /// Of the simulated mechanics.
    pub mechanics: Mechanics,
    /// One for each rest of the motion script in which the tool cycled.
    pub limit_cycles: Vec<LimitCycle>,
    /// Against the sampled-data rule.
    pub sampled_data: SampledData,
    /// Commands that the device cut to what its motors can.
    pub saturations: u64,
    /// What the passivity controller saw and did.
    pub passivity: Option<Passivity>,
}

/// [`Energies`], as JSON, J.
#[derive(Debug, Clone, Default, Serialize)]
#[expect(missing_docs, reason = "the names are those of the simulated device, which documents them")]
pub struct Mechanics {
    pub motor_j: f64,
    pub hand_j: f64,
    pub viscous_j: f64,
    pub coulomb_j: f64,
    pub hand_damper_j: f64,
    pub held_j: f64,
}

/// [`Cycle`], as JSON.
#[derive(Debug, Clone, Serialize)]
pub struct LimitCycle {
    /// The rest's beginning, s.
    pub from_s: f64,
    /// Its end, s.
    pub to_s: f64,
    /// Of the cycle, s.
    pub period_s: f64,
    /// m.
    pub amplitude_m: f64,
    /// How many times as large it was in the second half of the rest as in the first.
    pub growth: f64,
}

/// MODEL 5: the loop is passive where b ≥ K T/2 + K D, as long as nothing slips ([`damping_needed`]).
#[derive(Debug, Clone, Default, Serialize)]
pub struct SampledData {
    /// K_max down to the greatest depth of the run, N/m.
    pub stiffness_max_n_per_m: f64,
    /// The same as the device meets it: K, or in series with a virtual coupling K k_c/(K + k_c), N/m.
    pub met_n_per_m: f64,
    /// What the device's damping allows, N/m.
    pub passive_up_to_n_per_m: f64,
}

/// What the passivity controller saw and did.
#[derive(Debug, Clone, Serialize)]
pub struct Passivity {
    /// What the loop has taken in less what it gave out, J.
    pub observed_j: f64,
    /// Its least value, J.
    pub lowest_j: f64,
    /// Periods in which it rendered a damping.
    pub active: u64,
}

/// The stiffness (N/m) up to which a device's damping keeps a loop passive while nothing slips: b = K T/2 + K D.
pub fn passive_up_to(capabilities: &Capabilities, period_s: f64) -> f64 {
    let m = &capabilities.mechanics;
    m.damping_n_s_per_m.value / damping_needed(1.0, 1.0, period_s, late(m))
}

/// So many periods at most: their places are kept to look for cycles.
const STEPS_MAX: f64 = 2e7;

/// Runs a loop and gives every period to `row`.
///
/// # Errors
/// A motion script that takes too many periods, or does not go on this body; a device or hand that can't be simulated; what
/// `row` reports.
pub fn run(
    body: &Body,
    setup: Setup,
    mut row: impl FnMut(&Waypoint, &Output) -> Result<()>,
) -> Result<LoopSummary> {
    let Setup { capabilities, hand, intent, rate_hz, seconds, ablation, slip, no_tank, .. } = setup;
    let Setup { coupling_n_per_m, passivity, .. } = setup;
    let period = 1.0 / rate_hz;
    figures::check(&capabilities, &hand).map_err(|e| anyhow!("{} in this hand: {e}", capabilities.name))?;
    let delay = capabilities.mechanics.delay_s.value;
    if delay * rate_hz > figures::PERIODS_UNDER_WAY as f64 {
        bail!(
            "{}: a delay of {} ms is more than {} periods at {rate_hz} Hz; give less delay_ms, or a lower --rate-hz",
            capabilities.name,
            delay * 1e3,
            figures::PERIODS_UNDER_WAY
        );
    }
    let [place, into] = intent.place(body)?;
    let script = intent.script(into, body.tool().radius_m())?;
    let rests = script.rests();
    let seconds = seconds.unwrap_or(script.duration_s());
    if seconds * rate_hz > STEPS_MAX {
        bail!(
            "{seconds} s at {rate_hz} Hz are more than {STEPS_MAX} periods; give --seconds, or a lower --rate-hz"
        );
    }
    let mass = capabilities.mechanics.mass_kg.value + hand.mass_kg;
    let mut summary = LoopSummary {
        device: capabilities.name.to_string(),
        rate_hz,
        seconds,
        sampled_data: SampledData {
            passive_up_to_n_per_m: passive_up_to(&capabilities, period),
            ..SampledData::default()
        },
        ..LoopSummary::default()
    };
    let stages = Stages {
        coupling: coupling_n_per_m.map(|k| Coupling::new(k, stiffness_down_to(body, f64::INFINITY))),
        passivity: passivity.then(|| PassivityController::new(period, mass)),
        // The device cuts, and counts.
        ..Stages::default()
    };
    let map = WorkspaceMap { offset_m: place, ..WorkspaceMap::default() };
    let contact = Contact::with_slip(body, slip.unwrap_or(body.slip()), ablation);
    let mut closed = HapticLoop::new(contact.with_tank(body.has_tank() && !no_tank), map, stages);
    let mut device = Simulated::new(capabilities, hand, Box::new(script));
    device.open()?;
    let steps = (seconds * rate_hz).round() as u64;
    let mut places = Vec::with_capacity(steps as usize + 1);
    let mut deepest = 0.0f64;
    for k in 0..=steps {
        let step = closed.step(body, &mut device, k as f64 / rate_hz);
        let step = step.map_err(|fault| anyhow!("{}: {}", summary.device, device.explain(fault)))?;
        let waypoint = Waypoint { time_s: step.time_s, pose: step.pose };
        summary.trace.add(body, closed.contact(), &waypoint, &step.output);
        deepest = deepest.max(step.output.contact.map_or(0.0, |c| c.delta_z_m));
        places.push(device.position_m());
        row(&waypoint, &step.output)?;
    }
    summary.trace.finish(closed.contact());
    summary.limit_cycles = cycles(&rests, &places, rate_hz);
    let stiffness = stiffness_down_to(body, deepest);
    summary.sampled_data.stiffness_max_n_per_m = stiffness;
    summary.sampled_data.met_n_per_m = coupling_n_per_m.map_or(stiffness, |k| in_series(stiffness, k));
    summary.out_j = closed.port().out_j;
    summary.sampling_bound_j = 0.5 * summary.sampled_data.stiffness_max_n_per_m * closed.port().squares_m2;
    summary.saturations = device.saturations();
    summary.passivity = closed.stages().passivity.map(|p| Passivity {
        observed_j: p.observed_j(),
        lowest_j: p.lowest_j(),
        active: p.active(),
    });
    let Energies { motor_j, hand_j, viscous_j, coulomb_j, hand_damper_j } = device.energies();
    summary.mechanics =
        Mechanics { motor_j, hand_j, viscous_j, coulomb_j, hand_damper_j, held_j: device.held_j() };
    device.close();
    Ok(summary)
}

fn cycles(rests: &[(f64, f64)], places: &[DVec3], rate_hz: f64) -> Vec<LimitCycle> {
    let within = |&(from, to): &(f64, f64)| {
        let sample = |t: f64| ((t * rate_hz).round() as usize).min(places.len());
        let part = places.get(sample(from + SETTLING)..sample(to))?;
        let Cycle { period_s, amplitude_m, growth } = Cycle::find(part, 1.0 / rate_hz, SMALLEST)?;
        Some(LimitCycle { from_s: from, to_s: to, period_s, amplitude_m, growth })
    };
    rests.iter().filter_map(within).collect()
}

/// Of two springs one behind the other.
pub(crate) fn in_series(a: f64, b: f64) -> f64 {
    a * b / (a + b)
}

/// K_max down to a depth: the table's, at the first knot as deep or deeper.
fn stiffness_down_to(body: &Body, depth: f64) -> f64 {
    let table = stiffness_max(body);
    let at = table.iter().find(|s| s.depth_m >= depth).or(table.last());
    at.map_or(0.0, |s| s.value)
}

impl LoopSummary {
    /// What deserves to be said aloud.
    pub fn warnings(&self, body: &Body, ablation: Ablation) -> Vec<String> {
        let mut said = self.trace.warnings(body, &[], ablation);
        // The path that it means is the loop's own.
        said.retain(|s| !s.starts_with("nothing was touched"));
        if self.trace.contacts == 0 {
            said.push("nothing was touched: let the motion script go deeper".into());
        }
        for c in &self.limit_cycles {
            said.push(format!(
                "a limit cycle of {:.3} mm at {:.1} Hz while the hand rested from {:.2} to {:.2} s",
                c.amplitude_m * 1e3,
                1.0 / c.period_s,
                c.from_s,
                c.to_s
            ));
        }
        let SampledData { stiffness_max_n_per_m, met_n_per_m: k, passive_up_to_n_per_m: limit } =
            self.sampled_data;
        if k > limit {
            let coupled = if k < stiffness_max_n_per_m { " through the virtual coupling" } else { "" };
            said.push(format!(
                "the body is as stiff as {k:.0} N/m{coupled} where it was touched; this device's damping keeps a loop of \
                 {} Hz passive up to {limit:.0} N/m, and the hand's may be needed beyond",
                self.rate_hz
            ));
        }
        if self.saturations > 0 {
            said.push(format!(
                "{} cut to the device's largest force",
                trace::count(self.saturations, "command")
            ));
        }
        said
    }
}
