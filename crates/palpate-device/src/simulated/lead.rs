//! A hand that somebody leads while the loop runs: with a mouse, or from a program.

use super::{HandMotion, Target};
use glam::DVec3;
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How fast the hand follows, 1/s: nine tenths of a short way within a tenth of a second, as quick as a hand that points.
const PER_S: f64 = 40.0;
/// It never wants to be faster than this, m/s, however far the lead jumps: a damper of 10 N·s/m then pulls with 5 N.
const SPEED_MAX_M_PER_S: f64 = 0.5;

/// Where a simulated hand is led to, m in the device's frame. Clones share it.
///
/// Whoever leads sets it at any time and from any thread; the loop reads it without waiting. A loop that reads while it is set may
/// see coordinates of both places: the hand follows smoothly, so that it is on its way to the new one a millisecond later.
#[derive(Debug, Clone)]
pub struct Lead(Arc<[AtomicU64; 3]>);

impl Lead {
    /// Begins here, m.
    pub fn new(position_m: [f64; 3]) -> Self {
        Lead(Arc::new(position_m.map(|x| AtomicU64::new(x.to_bits()))))
    }

    /// Leads the hand here, m. What is not finite leads nowhere: the hand stays led to where it was.
    pub fn set(&self, position_m: [f64; 3]) {
        if position_m.iter().all(|x| x.is_finite()) {
            self.0.iter().zip(position_m).for_each(|(word, x)| word.store(x.to_bits(), Ordering::Relaxed));
        }
    }

    /// Where it leads to, m.
    pub fn position_m(&self) -> [f64; 3] {
        std::array::from_fn(|i| f64::from_bits(self.0[i].load(Ordering::Relaxed)))
    }

    /// The motion of a hand that begins where the lead is, and follows it.
    pub fn motion(&self) -> impl HandMotion + use<> {
        let place = DVec3::from_array(self.position_m());
        Led { lead: self.clone(), last: Cell::new(Follower { time_s: 0.0, place, rate: DVec3::ZERO }) }
    }
}

/// What follows a [`Lead`], in every direction as a critically damped oscillator does. It knows the last time that it was asked for:
/// earlier ones have the same answer.
#[derive(Debug)]
struct Led {
    lead: Lead,
    last: Cell<Follower>,
}

/// Place, m, and velocity, m/s, at a time, s.
#[derive(Debug, Clone, Copy)]
struct Follower {
    time_s: f64,
    place: DVec3,
    rate: DVec3,
}

impl Follower {
    /// `span` s later, with the lead at rest at `to`: x = to + (a + b t) e^(−ω t).
    fn after(self, span: f64, to: DVec3) -> Self {
        // Of a lead that keeps ahead by d: x″ = ω² d − 2ω x′ comes to ω d/2, from below.
        let way = (to - self.place).clamp_length_max(2.0 * SPEED_MAX_M_PER_S / PER_S);
        let to = self.place + way;
        let a = self.place - to;
        let b = self.rate + a * PER_S;
        let decay = libm::exp(-PER_S * span);
        let left = (a + b * span) * decay;
        Follower { time_s: self.time_s + span, place: to + left, rate: b * decay - left * PER_S }
    }
}

impl HandMotion for Led {
    fn target(&self, time_s: f64) -> Target {
        let mut last = self.last.get();
        if time_s > last.time_s {
            let to = DVec3::from_array(self.lead.position_m());
            last = Follower { time_s, ..last.after(time_s - last.time_s, to) };
            self.last.set(last);
        }
        Target { position_m: last.place, velocity_m_per_s: last.rate, ..Target::default() }
    }

    /// As long as it is led.
    fn duration_s(&self) -> f64 {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hand_comes_to_where_it_is_led_without_haste() {
        let lead = Lead::new([0.0, 0.0, 0.05]);
        let led = lead.motion();
        assert_eq!(led.target(0.0).position_m, DVec3::Z * 0.05);
        lead.set([0.2, 0.0, -0.1]);
        lead.set([f64::NAN, 0.0, 0.0]);
        assert_eq!(lead.position_m(), [0.2, 0.0, -0.1]);
        let mut before = led.target(0.0);
        for k in 1..=2000 {
            let now = led.target(f64::from(k) * 1e-3);
            assert!(now.velocity_m_per_s.length() <= SPEED_MAX_M_PER_S * 1.001, "{now:?}");
            // The velocity is that of the place: half of the sum of both ends', as far as they change in a millisecond.
            let mean = (now.position_m - before.position_m) / 1e-3;
            let ends = (now.velocity_m_per_s + before.velocity_m_per_s) * 0.5;
            assert!(mean.distance(ends) < 5e-3, "{k}: {mean} {ends}");
            before = now;
        }
        assert!(before.position_m.distance(DVec3::new(0.2, 0.0, -0.1)) < 1e-9, "{before:?}");
        // The past has the present's answer.
        assert_eq!(led.target(1.0), before);
    }

    /// A loop that asks twice as often sees the same motion, as long as the lead rests.
    #[test]
    fn the_way_does_not_depend_on_how_often_it_is_asked_for() {
        let [coarse, fine] = [0, 1].map(|_| {
            let lead = Lead::new([0.0; 3]);
            let led = lead.motion();
            lead.set([0.0, 0.01, 0.0]);
            led
        });
        for k in 1..=50 {
            let time_s = f64::from(k) * 2e-3;
            fine.target(time_s - 1e-3);
            let (a, b) = (coarse.target(time_s), fine.target(time_s));
            assert!(a.position_m.distance(b.position_m) < 1e-12, "{a:?} {b:?}");
        }
    }
}
