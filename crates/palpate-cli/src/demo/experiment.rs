//! The experiment: one path, four settings in step, three sampling rates.

use super::path;
use glam::DVec3;
use palpate_body::Body;
use palpate_engine::{Ablation, Contact, Counters, Ledger, Output, ToolState};

/// The paper's four settings, in the order of all results: name and what is taken away.
pub const SETTINGS: [(&str, Ablation); 4] = [
    ("both", Ablation::None),
    ("coordinates-off", Ablation::Coordinates),
    ("responses-off", Ablation::Responses),
    ("both-off", Ablation::Both),
];

/// A step whose excess is above this (N) is a click.
pub const CLICK: f64 = 1e-3;

/// One setting at one sampling rate.
#[derive(Debug, Clone, Default)]
pub struct Rollout {
    /// A sample at each 1/rate, from time 0; kept where asked for.
    pub samples: Vec<Output>,
    /// Largest |ΔF| of a step, N.
    pub largest: f64,
    /// Largest excess max(0, |ΔF| − L|Δx|) of a step, N.
    pub excess: f64,
    /// Largest |ΔF| / (L|Δx|) of a step: 1 where the bound is reached.
    pub share: f64,
    /// Steps whose excess is above [`CLICK`]: the number of the sample after it, and the excess, N.
    pub clicks: Vec<(usize, f64)>,
    /// Largest force, N.
    pub strongest: f64,
    /// Energies at the end.
    pub energy: Ledger,
    /// What happened on the way.
    pub counters: Counters,
}

/// All settings at one sampling rate.
#[derive(Debug, Clone)]
pub struct Rate {
    /// Samples a second.
    pub hz: f64,
    /// In the order of [`SETTINGS`].
    pub settings: [Rollout; 4],
    /// Bounds L (N/m) that steps were measured against, smallest and largest.
    pub bounds: (f64, f64),
    /// Touching samples where the smooth model has no bound; 0 unless it snaps.
    pub unbounded: usize,
    /// Fastest tool, m/s.
    pub fastest: f64,
}

/// The number of the path's last sample, counted from 0.
pub fn last_sample(hz: f64) -> usize {
    (path::DURATION * hz).round() as usize
}

/// Rolls the path out at `hz` in all settings, in step.
///
/// The bound L of a step is the smooth setting's: the larger of those at its two ends. It serves all settings, so
/// that a jump which the smooth model does not have shows as excess. A step that leaves free space starts where
/// there is no bound yet; the force there is zero and its end's bound holds on the whole of it.
pub fn roll_out(body: &Body, hz: f64, keep: bool) -> Rate {
    let mut contacts = SETTINGS.map(|(_, ablation)| Contact::with_ablation(body, ablation));
    let mut settings: [Rollout; 4] = Default::default();
    let mut rate =
        Rate { hz, settings: Default::default(), bounds: (f64::INFINITY, 0.0), unbounded: 0, fastest: 0.0 };
    let mut before: Option<(DVec3, [DVec3; 4], f64)> = None;
    for sample in 0..=last_sample(hz) {
        let tip = path::tip(sample as f64 / hz);
        let pose = ToolState::at(tip.to_array());
        let mut forces = [DVec3::ZERO; 4];
        for ((contact, rollout), force) in contacts.iter_mut().zip(&mut settings).zip(&mut forces) {
            let output = contact.step(body, &pose, 1.0 / hz);
            *force = DVec3::from_array(output.force_n);
            rollout.strongest = rollout.strongest.max(force.length());
            if keep {
                rollout.samples.push(output);
            }
        }
        let own = contacts[0].lipschitz_n_per_m(body);
        rate.unbounded += usize::from(own.is_none() && forces[0] != DVec3::ZERO);
        // An ablated contact may end a little later than the smooth one: the last bound goes on.
        let bound = own.unwrap_or(before.map_or(0.0, |(_, _, bound)| bound));
        if let Some((tip_before, forces_before, bound_before)) = before {
            let way = tip.distance(tip_before);
            rate.fastest = rate.fastest.max(way * hz);
            let allowed = bound.max(bound_before);
            if own.is_some() {
                rate.bounds = (rate.bounds.0.min(allowed), rate.bounds.1.max(allowed));
            }
            for ((rollout, force), force_before) in settings.iter_mut().zip(forces).zip(forces_before) {
                rollout.measure(sample, force.distance(force_before), allowed * way);
            }
        }
        before = Some((tip, forces, bound));
    }
    for (rollout, contact) in settings.iter_mut().zip(&contacts) {
        (rollout.energy, rollout.counters) = (contact.energy(), *contact.counters());
    }
    rate.settings = settings;
    rate
}

impl Rollout {
    fn measure(&mut self, sample: usize, step: f64, allowed: f64) {
        // A NaN or infinite value must not pass for small.
        let excess = if (step - allowed).is_finite() { (step - allowed).max(0.0) } else { f64::INFINITY };
        self.largest = self.largest.max(step);
        self.excess = self.excess.max(excess);
        // At rest only the slip search's tolerance is left, a nanonewton: no share of anything.
        if allowed > 1e-6 {
            self.share = self.share.max(step / allowed);
        }
        if excess > CLICK {
            self.clicks.push((sample, excess));
        }
    }
}
