//! Passivity observer and controller, in the time domain (Hannaford and Ryu 2002).
//!
//! The observer adds up what the loop takes in at the device, exactly for a force that is held over a period:
//!
//! ```text
//! E += −F_k · (x_(k+1) − x_k) − τ_k · θ_k
//! ```
//!
//! with θ_k the rotation vector of the period. There is one book for all six axes: what turning has taken in,
//! moving may give out. As long as E ≥ 0 the loop has given out nothing that it hadn't taken in. Where E < 0
//! the controller renders a damping besides, which takes the excess back if the next period moves as the last
//! did: α = −E/(T (|v|² + r²|ω|²)) of the motion, and α r² of the turning. r² is inertia/mass, so that both
//! decay at the same rate α/mass, and each bears its share of the kinetic energy.

use crate::wrench::{Placement, Wrench};

/// Observer and controller, all axes together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassivityController {
    /// kg. A damping α of more than this over the period would overturn the device's motion; half of it is
    /// the most.
    mass: f64,
    /// r², m².
    inertia_per_mass: f64,
    /// The loop's period, s.
    period: f64,
    /// A pose and what was rendered there.
    last: Option<(Placement, Wrench)>,
    observed_j: f64,
    lowest_j: f64,
    active: u64,
}

impl PassivityController {
    /// For a loop of this period (s) and a device of this moving mass (kg): α stays below half of
    /// mass/period. It damps no turning: [`with_inertia`](Self::with_inertia).
    pub fn new(period_s: f64, mass_kg: f64) -> Self {
        PassivityController {
            mass: mass_kg,
            inertia_per_mass: 0.0,
            period: period_s,
            last: None,
            observed_j: 0.0,
            lowest_j: 0.0,
            active: 0,
        }
    }

    /// For a device of this rotational inertia (kg·m²): what damps its turning stays below half of
    /// inertia/period.
    #[must_use]
    pub fn with_inertia(self, inertia_kg_m2: f64) -> Self {
        let known = self.mass > 0.0;
        PassivityController { inertia_per_mass: if known { inertia_kg_m2 / self.mass } else { 0.0 }, ..self }
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

    /// What to render at `placement` where `wanted` is wanted.
    pub(crate) fn pass(&mut self, placement: Placement, wanted: Wrench) -> Wrench {
        let mut wrench = wanted;
        if let Some((before, rendered)) = self.last {
            let way = before.displacement_to(&placement);
            self.observed_j -= rendered.work(&way);
            self.lowest_j = self.lowest_j.min(self.observed_j);
            let turning = self.inertia_per_mass * way.rotation.length_squared();
            let square = (way.translation.length_squared() + turning) / self.period;
            if self.observed_j < 0.0 && square > 0.0 {
                let damping = (-self.observed_j / square).min(0.5 * self.mass / self.period) / self.period;
                wrench.force -= way.translation * damping;
                if turning > 0.0 {
                    wrench.torque -= way.rotation * (damping * self.inertia_per_mass);
                }
                self.active += 1;
            }
        }
        self.last = Some((placement, wrench));
        wrench
    }

    /// What was rendered in the end, after the stages behind.
    pub(crate) fn rendered(&mut self, wrench: Wrench) {
        if let Some((_, rendered)) = &mut self.last {
            *rendered = wrench;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wrench::turned;
    use glam::DVec3;

    /// A torque that turned the handle by 10 mrad has given out 1 mJ: a motion that goes on pays for it, each
    /// part by its share of the kinetic energy.
    #[test]
    fn torque_is_in_the_same_book_and_pays_its_share() {
        let (mass, inertia, period) = (0.2, 1e-3, 1e-3);
        let mut controller = PassivityController::new(period, mass).with_inertia(inertia);
        let start = Placement::default();
        let torque = Wrench { torque: DVec3::Z * 0.1, ..Wrench::default() };
        assert_eq!(controller.pass(start, torque), torque);
        let (along, about) = (DVec3::X * 2e-3, DVec3::Z * 10e-3);
        let next = Placement { position: along, orientation: turned(start.orientation, about) };
        let answer = controller.pass(next, Wrench::default());
        assert!((controller.observed_j() + 1e-3).abs() < 1e-15);
        let twice_kinetic =
            (mass * along.length_squared() + inertia * about.length_squared()) / (period * period);
        // At the most: half of what there is of momentum in a period.
        let rate = (1e-3 / (period * twice_kinetic)).min(0.5 / period);
        assert!(answer.force.distance(along * (-rate * mass / period)) < 1e-9, "{answer:?}");
        assert!(answer.torque.distance(about * (-rate * inertia / period)) < 1e-9, "{answer:?}");
        // Without an inertia the torque is booked, and only the motion pays.
        let mut controller = PassivityController::new(period, mass);
        controller.pass(start, torque);
        let answer = controller.pass(next, Wrench::default());
        assert!(controller.observed_j() < 0.0 && answer.torque == DVec3::ZERO && answer.force.x < 0.0);
    }
}
