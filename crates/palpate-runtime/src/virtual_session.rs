//! The closed loop in virtual time: a simulated device and hand on a body, as fast as the machine can.

use crate::config::{ClockChoice, SessionConfig};
use crate::device_choice::DeviceChoice;
use crate::live_session::{HeldDevice, SessionError, haptic_loop};
use crate::sampled_data::{in_series, passive_up_to};
use crate::{BodyFile, Cycle, StageFlags, trace};
use anyhow::anyhow;
use glam::DVec3;
use palpate_body::Body;
use palpate_body::stiffness::stiffness_max;
use palpate_device::Device;
use palpate_device::simulated::{Energies, HandMotion as _, figures};
use palpate_engine::{Ablation, Output, Waypoint};
use serde::Serialize;
use std::collections::BTreeMap;

/// Of a rest, this much at its beginning (s) is left out when cycles are looked for: the press dies down.
const SETTLING: f64 = 0.3;
/// Below this amplitude (m) nothing is called a cycle: a vibration at 250 Hz is felt from there.
const SMALLEST: f64 = 1e-7;

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
    /// Of the output stages, as they were.
    pub limits: Limits,
    /// Periods in which the output stages did what, by the names of [`StageFlags`].
    pub stages: BTreeMap<&'static str, u64>,
}

/// What the output stages allow.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Limits {
    /// N.
    pub force_max_n: f64,
    /// N/s.
    pub slew_n_per_s: f64,
    /// s.
    pub soft_start_s: f64,
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

/// MODEL 5: the loop is passive where b ≥ K T/2 + K D, as long as nothing slips ([`damping_needed`](crate::sampled_data::damping_needed)).
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

/// So many periods at most: their places are kept to look for cycles.
const STEPS_MAX: f64 = 2e7;

/// Runs a loop and gives every period to `row`. The stages and their limits are those of a session against the clock.
///
/// # Errors
/// A setting; a motion script that takes too many periods, or does not go on this body; a device or hand that can't be simulated; what
/// `row` reports.
pub fn run_virtual(
    body: &Body,
    config: &SessionConfig,
    row: impl FnMut(&Waypoint, &Output) -> anyhow::Result<()>,
) -> Result<LoopSummary, SessionError> {
    SessionConfig { clock: ClockChoice::Virtual, ..config.clone() }.check()?;
    let preset = match &config.device {
        DeviceChoice::Simulated(preset) => preset.as_deref(),
        // Refused by the check.
        _ => None,
    };
    run_held(body, HeldDevice::chosen(body, preset, config)?, config, row)
}

/// The same with a device and a hand that have no name.
///
/// # Errors
/// As [`run_virtual`].
pub fn run_held(
    body: &Body,
    held: HeldDevice,
    config: &SessionConfig,
    mut row: impl FnMut(&Waypoint, &Output) -> anyhow::Result<()>,
) -> Result<LoopSummary, SessionError> {
    let rate_hz = config.rate_hz;
    body.prepare(config.slip.unwrap_or(body.slip()));
    let HeldDevice { mut device, script, map } = held;
    let capabilities = device.capabilities().clone();
    let delay = capabilities.mechanics.delay_s.value;
    if delay * rate_hz > figures::PERIODS_UNDER_WAY as f64 {
        return Err(anyhow!(
            "{}: a delay of {} ms is more than {} periods at {rate_hz} Hz; give less delay_ms, or a lower rate_hz",
            capabilities.name,
            delay * 1e3,
            figures::PERIODS_UNDER_WAY
        )
        .into());
    }
    let rests = script.rests();
    let seconds = config.seconds.unwrap_or(script.duration_s());
    if seconds * rate_hz > STEPS_MAX {
        return Err(anyhow!(
            "{seconds} s at {rate_hz} Hz are more than {STEPS_MAX} periods; give seconds, or a lower rate_hz"
        )
        .into());
    }
    let mut summary = LoopSummary {
        device: capabilities.name.to_string(),
        rate_hz,
        seconds,
        sampled_data: SampledData {
            passive_up_to_n_per_m: passive_up_to(&capabilities, 1.0 / rate_hz),
            ..SampledData::default()
        },
        ..LoopSummary::default()
    };
    device.open()?;
    let (mut closed, _) =
        haptic_loop(body, &BodyFile::default(), &mut device, Some(map), config.safety, config)?;
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
    summary.sampled_data.met_n_per_m = config.coupling_n_per_m.map_or(stiffness, |k| in_series(stiffness, k));
    summary.out_j = closed.port().out_j;
    summary.sampling_bound_j = 0.5 * summary.sampled_data.stiffness_max_n_per_m * closed.port().squares_m2;
    summary.stages =
        StageFlags::NAMED.iter().map(|(name, flag)| (*name, closed.counts().of(*flag))).collect();
    summary.limits = Limits {
        force_max_n: closed.stages().force.most(),
        slew_n_per_s: closed.stages().force.step() * rate_hz,
        soft_start_s: config.safety.soft_start_s,
    };
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
