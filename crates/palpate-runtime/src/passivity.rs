//! Passivity observer and controller, in the time domain (Hannaford and Ryu 2002).
//!
//! The observer adds up what the loop takes in at the device, exactly for a force that is held over a period:
//!
//! ```text
//! E += −F_k · (x_(k+1) − x_k)
//! ```
//!
//! As long as E ≥ 0 the loop has given out nothing that it hadn't taken in. Where E < 0 the controller renders a damping
//! α = −E/(T |v|²) besides, which takes the excess back if the next period moves as the last did.

use glam::DVec3;

/// Observer and controller, all three axes together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassivityController {
    /// The most that α may be, N·s/m: more than a device's mass over the period would overturn its motion.
    damping_max: f64,
    /// The loop's period, s.
    period: f64,
    /// x and the force rendered there.
    last: Option<(DVec3, DVec3)>,
    observed_j: f64,
    lowest_j: f64,
    active: u64,
}

impl PassivityController {
    /// For a loop of this period (s) and a device of this moving mass (kg): α stays below half of mass/period.
    pub fn new(period_s: f64, mass_kg: f64) -> Self {
        PassivityController {
            damping_max: 0.5 * mass_kg / period_s,
            period: period_s,
            last: None,
            observed_j: 0.0,
            lowest_j: 0.0,
            active: 0,
        }
    }

    /// What the loop has taken in less what it gave out, J.
    pub fn observed_j(&self) -> f64 {
        self.observed_j
    }

    /// The least that was ever observed, J.
    pub fn lowest_j(&self) -> f64 {
        self.lowest_j
    }

    /// In how many periods the controller rendered a damping.
    pub fn active(&self) -> u64 {
        self.active
    }

    /// The force to render at `x` (m) where `wanted` (N) is wanted.
    pub(crate) fn pass(&mut self, x: DVec3, wanted: DVec3) -> DVec3 {
        let mut force = wanted;
        if let Some((before, rendered)) = self.last {
            let way = x - before;
            self.observed_j -= rendered.dot(way);
            self.lowest_j = self.lowest_j.min(self.observed_j);
            let square = way.length_squared() / self.period;
            if self.observed_j < 0.0 && square > 0.0 {
                let damping = (-self.observed_j / square).min(self.damping_max);
                force -= way * (damping / self.period);
                self.active += 1;
            }
        }
        self.last = Some((x, force));
        force
    }

    /// What was rendered in the end, after the stages behind.
    pub(crate) fn rendered(&mut self, force: DVec3) {
        if let Some((_, rendered)) = &mut self.last {
            *rendered = force;
        }
    }
}
