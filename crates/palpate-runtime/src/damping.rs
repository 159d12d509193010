//! Viscous damping, −b v, of the device: takes energy out of the hand's motion, in contact and free.

use glam::DVec3;
use palpate_device::Capabilities;

/// Of the estimated velocity, s: an encoder's steps would otherwise be felt as a buzz. About 50 Hz.
const SMOOTHING: f64 = 3e-3;

/// −b v, with the velocity that the device reports, or else one estimated from its poses and smoothed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    coefficient: f64,
    last: Option<(f64, DVec3)>,
    velocity: DVec3,
}

impl Damping {
    /// Of this coefficient, N·s/m. A damping beyond half of mass/delay overturns the motion that it should calm:
    /// [`Safety::stages`](crate::Safety::stages) refuses it.
    pub fn new(coefficient_n_s_per_m: f64) -> Self {
        Damping { coefficient: coefficient_n_s_per_m, last: None, velocity: DVec3::ZERO }
    }

    /// From a motion to the force that damps it, s: a period, the device's delay and lag, and the age of the velocity, which is
    /// the device's own or that of the smoothing here.
    pub(crate) fn delay_s(device: &Capabilities, period_s: f64) -> f64 {
        let m = &device.mechanics;
        let velocity = device.velocity_delay_s.as_ref().map_or(SMOOTHING, |delay| delay.value);
        period_s + m.delay_s.value + m.lag_s.value + velocity
    }

    /// The force at `position` (m), `now` (s), where the device reports the velocity `reported` (m/s) or none.
    pub(crate) fn force(&mut self, now: f64, position: DVec3, reported: Option<[f64; 3]>) -> DVec3 {
        let passed = self.last.map(|(then, from)| (now - then, position - from));
        if let Some((time, way)) = passed.filter(|(time, _)| *time > 0.0) {
            // First order: v' = (Δx/Δt − v)/τ, one implicit step.
            self.velocity += (way - self.velocity * time) / (SMOOTHING + time);
        }
        self.last = Some((now, position));
        let velocity = reported.map_or(self.velocity, DVec3::from_array);
        -self.coefficient * velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_opposes_the_motion() {
        let mut damping = Damping::new(2.0);
        let mut force = DVec3::ZERO;
        for k in 0..50 {
            let t = f64::from(k) * 1e-3;
            force = damping.force(t, DVec3::X * 0.1 * t, None);
        }
        assert!((force - DVec3::new(-0.2, 0.0, 0.0)).length() < 1e-6, "{force}");
        assert_eq!(damping.force(0.05, DVec3::ZERO, Some([0.0, 0.5, 0.0])), DVec3::new(0.0, -1.0, 0.0));
    }

    /// A handle of 0.2 kg, let go at 1 m/s, with the velocity averaged over 20 ms: what is allowed for that delay brings it to
    /// rest; what a period's delay would allow throws it to and fro, ever faster.
    #[test]
    fn what_is_allowed_for_an_averaged_velocity_calms() {
        let mut device = palpate_device::presets::device("omega").unwrap();
        device.velocity_delay_s = Some(palpate_device::Figure::chosen(0.01));
        let (mass, period) = (device.mechanics.mass_kg.value, 1e-3);
        let run = |coefficient: f64| {
            let mut damping = Damping::new(coefficient);
            let mut velocities = vec![1.0; 20];
            for k in 0..1000 {
                let average = velocities[k..].iter().sum::<f64>() / 20.0;
                let force = damping.force(0.0, DVec3::ZERO, Some([average, 0.0, 0.0]));
                velocities.push(velocities[k + 19] + force.x / mass * period);
            }
            velocities
        };
        let calm = run(0.5 * mass / Damping::delay_s(&device, period));
        assert!(calm.iter().all(|v| (-0.05..=1.0).contains(v)) && calm[1019].abs() < 1e-6);
        assert!(run(0.5 * mass / period)[1019].abs() > 1e3);
    }

    /// A step of an encoder, 0.05 mm, is a pulse of a quarter of what the bare difference would give.
    #[test]
    fn an_encoders_step_is_smoothed() {
        let mut damping = Damping::new(1.0);
        damping.force(0.0, DVec3::ZERO, None);
        let pulse = damping.force(1e-3, DVec3::X * 5e-5, None);
        assert!((pulse.x + 0.25 * 0.05).abs() < 1e-12, "{pulse}");
        // Asked twice at the same time it stays what it is.
        assert_eq!(damping.force(1e-3, DVec3::X * 5e-5, None), pulse);
    }
}
