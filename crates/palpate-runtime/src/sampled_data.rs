//! The sampled-data rule (MODEL 5): how much damping makes up for a force that is held and comes late.

use palpate_device::{Capabilities, Mechanics};

/// By how much a device's force comes late, s: the amplifier's lag counts as a delay, which it is for slow motions.
pub fn late(mechanics: &Mechanics) -> f64 {
    mechanics.delay_s.value + mechanics.lag_s.value
}

/// The damping (N·s/m) that makes up for a hold of T and a delay d, if the force is K-Lipschitz within a step and
/// L-Lipschitz over several (K ≤ L; L = K as long as nothing slips):
///
/// ```text
/// b ≥ K T/2 + L D,   D = (⌈d/T⌉ T + d)/2
/// ```
///
/// The hold costs at most ½ K |Δx|² a step, and |Δx|² ≤ T ∫v². The delayed force is off by at most L ∫|v| over the samples
/// it is behind; with 2 |v(t) v(s)| ≤ v(t)² + v(s)² each moment's v² then counts for the ⌈d/T⌉ samples that its own force
/// is behind at most, and for the d during which later forces don't know of it. For whole samples D is d.
pub fn damping_needed(stiffness: f64, lipschitz: f64, period_s: f64, delay_s: f64) -> f64 {
    // A hair less: what is a whole number of samples stays one.
    let samples = (delay_s / period_s - 1e-9).ceil().max(0.0);
    let delay = if delay_s > 0.0 { lipschitz * 0.5 * (samples * period_s + delay_s) } else { 0.0 };
    0.5 * stiffness * period_s + delay
}

/// The stiffness (N/m) up to which a device's damping keeps a loop passive while nothing slips: b = K T/2 + K D.
pub fn passive_up_to(capabilities: &Capabilities, period_s: f64) -> f64 {
    let m = &capabilities.mechanics;
    m.damping_n_s_per_m.value / damping_needed(1.0, 1.0, period_s, late(m))
}

/// The stiffness of two springs one behind the other, N/m.
pub fn in_series(a: f64, b: f64) -> f64 {
    a * b / (a + b)
}
