//! Viscous damping, −b v and −b_θ ω, of the device: takes energy out of the hand's motion, in contact and
//! free.

use crate::wrench::{Placement, Wrench, rotation_between};
use glam::DVec3;
use palpate_device::{Capabilities, Sample};

/// Of the estimated velocity, s: an encoder's steps would otherwise be felt as a buzz. About 50 Hz.
const SMOOTHING: f64 = 3e-3;

/// −b v and −b_θ ω, with the velocities that the device reports, or else estimated from its poses and
/// smoothed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    coefficient: f64,
    angular_coefficient: f64,
    last: Option<(f64, Placement)>,
    velocity: DVec3,
    angular_velocity: DVec3,
}

impl Damping {
    /// Of this coefficient, N·s/m. A damping beyond half of mass/delay overturns the motion that it should calm:
    /// [`Safety::stages`](crate::Safety::stages) refuses it.
    pub fn new(coefficient_n_s_per_m: f64) -> Self {
        Damping {
            coefficient: coefficient_n_s_per_m,
            angular_coefficient: 0.0,
            last: None,
            velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
        }
    }

    /// And of this one against turning, N·m·s/rad; half of inertia/delay is the most here.
    #[must_use]
    pub fn with_angular(self, coefficient_nm_s_per_rad: f64) -> Self {
        Damping { angular_coefficient: coefficient_nm_s_per_rad, ..self }
    }

    /// From a motion to the force that damps it, s: a period, the device's delay and lag, and the age of the velocity, which is
    /// the device's own or that of the smoothing here.
    pub(crate) fn delay_s(device: &Capabilities, period_s: f64) -> f64 {
        let m = &device.mechanics;
        let velocity = device.velocity_delay_s.as_ref().map_or(SMOOTHING, |delay| delay.value);
        period_s + m.delay_s.value + m.lag_s.value + velocity
    }

    /// The same for turning: no device tells how old its angular velocity is, so neither is younger.
    pub(crate) fn angular_delay_s(device: &Capabilities, period_s: f64) -> f64 {
        let m = &device.mechanics;
        let velocity = device.velocity_delay_s.as_ref().map_or(SMOOTHING, |delay| delay.value.max(SMOOTHING));
        period_s + m.delay_s.value + m.lag_s.value + velocity
    }

    /// What damps a handle that is at `placement`, `now` (s), with the velocities that `sample` reports or
    /// none.
    pub(crate) fn wrench(&mut self, now: f64, placement: Placement, sample: &Sample) -> Wrench {
        let passed = self.last.replace((now, placement)).filter(|(then, _)| now > *then);
        // First order: v' = (Δx/Δt − v)/τ, one implicit step.
        let smooth = |v: &mut DVec3, way: DVec3, time: f64| *v += (way - *v * time) / (SMOOTHING + time);
        let mut wrench = Wrench::default();
        if self.coefficient != 0.0 {
            if let Some((then, from)) = passed {
                smooth(&mut self.velocity, placement.position - from.position, now - then);
            }
            let velocity = sample.velocity_m_per_s.map_or(self.velocity, DVec3::from_array);
            wrench.force = -self.coefficient * velocity;
        }
        if self.angular_coefficient != 0.0 {
            if let Some((then, from)) = passed {
                let turned = rotation_between(from.orientation, placement.orientation);
                smooth(&mut self.angular_velocity, turned, now - then);
            }
            let velocity = sample.angular_velocity_rad_per_s.map_or(self.angular_velocity, DVec3::from_array);
            wrench.torque = -self.angular_coefficient * velocity;
        }
        wrench
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wrench::turned;

    fn at(position: DVec3) -> Placement {
        Placement { position, ..Placement::default() }
    }

    #[test]
    fn it_opposes_the_motion() {
        let mut damping = Damping::new(2.0).with_angular(0.1);
        let mut wrench = Wrench::default();
        for k in 0..50 {
            let t = f64::from(k) * 1e-3;
            let placement = Placement {
                orientation: turned([1.0, 0.0, 0.0, 0.0], DVec3::Y * 3.0 * t),
                ..at(DVec3::X * 0.1 * t)
            };
            wrench = damping.wrench(t, placement, &Sample::default());
        }
        assert!((wrench.force - DVec3::new(-0.2, 0.0, 0.0)).length() < 1e-6, "{wrench:?}");
        assert!((wrench.torque - DVec3::new(0.0, -0.3, 0.0)).length() < 1e-6, "{wrench:?}");
        let told = Sample {
            velocity_m_per_s: Some([0.0, 0.5, 0.0]),
            angular_velocity_rad_per_s: Some([2.0, 0.0, 0.0]),
            ..Sample::default()
        };
        let told = damping.wrench(0.05, at(DVec3::ZERO), &told);
        assert_eq!(told, Wrench { force: DVec3::new(0.0, -1.0, 0.0), torque: DVec3::new(-0.2, 0.0, 0.0) });
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
                let sample = Sample { velocity_m_per_s: Some([average, 0.0, 0.0]), ..Sample::default() };
                let force = damping.wrench(0.0, Placement::default(), &sample).force;
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
        let mut force = |t, x| damping.wrench(t, at(DVec3::X * x), &Sample::default()).force;
        force(0.0, 0.0);
        let pulse = force(1e-3, 5e-5);
        assert!((pulse.x + 0.25 * 0.05).abs() < 1e-12, "{pulse}");
        // Asked twice at the same time it stays what it is.
        assert_eq!(force(1e-3, 5e-5), pulse);
    }
}
