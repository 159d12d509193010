//! A device and a hand that exist as equations: deterministic, and much faster than real time.

mod axis;
pub mod figures;
mod hand;
mod script;

pub use hand::{Hand, HandMotion, Target};
pub use script::{Move, Script, ScriptError};

use crate::{Capabilities, Command, Device, Fault, OpenError, Pose, Sample, Status};
use axis::{Aim, Axis, Plant};
use glam::DVec3;

/// The hand's aim is a cubic over no longer than this, s.
const STRETCH: f64 = 1e-3;
/// A device that nobody asks for longer than this (s) stands still for the rest of the time.
const LONGEST_GAP: f64 = 1.0;
/// Commands that can be under way at once; of more, the oldest acts early.
const UNDER_WAY: usize = 64;

/// Energies of the simulated mechanics since `open`, J: kinetic + hand's spring = motor + hand − the three dissipations.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Energies {
    /// Work of the motors on the tool.
    pub motor_j: f64,
    /// Work of the operator: of the spring and damper at the moving target, and of the push.
    pub hand_j: f64,
    /// Taken by the device's viscous damping.
    pub viscous_j: f64,
    /// Taken by the device's Coulomb friction.
    pub coulomb_j: f64,
    /// Taken by the hand's damper.
    pub hand_damper_j: f64,
}

/// A tool of the mass, damping and friction that [`Capabilities`] tell, held by a [`Hand`] that follows an [`HandMotion`],
/// with the device's encoder, delay, amplifier and force limit between it and the loop.
///
/// Each axis has its own drive, encoder, and friction, as on a gantry. Forces are held from one command to the next.
#[derive(Debug)]
pub struct Simulated {
    capabilities: Capabilities,
    plant: Plant,
    motion: Box<dyn HandMotion>,
    axes: [Axis; 3],
    /// s since `open`; `None` while closed.
    now: Option<f64>,
    pending: Pending,
    sequence: u64,
    saturated: bool,
    saturations: u64,
}

impl Simulated {
    /// A device with these capabilities, in this hand.
    ///
    /// # Panics
    /// A figure of the mechanics or of the hand that [`figures::check`] refuses: figures from outside are asked first.
    pub fn new(capabilities: Capabilities, hand: Hand, motion: Box<dyn HandMotion>) -> Self {
        if let Err(e) = figures::check(&capabilities, &hand) {
            panic!("{e}");
        }
        let m = &capabilities.mechanics;
        let plant = Plant {
            mass: m.mass_kg.value + hand.mass_kg,
            damping: m.damping_n_s_per_m.value,
            coulomb: m.coulomb_n.value,
            hand,
            lag: m.lag_s.value,
            slew: m.slew_n_per_s.value,
        };
        Simulated {
            capabilities,
            plant,
            motion,
            axes: [Axis::default(); 3],
            now: None,
            pending: Pending::default(),
            sequence: 0,
            saturated: false,
            saturations: 0,
        }
    }

    /// Where the tool really is, m: what [`Device::read`] says is rounded to the encoder's steps.
    pub fn position_m(&self) -> DVec3 {
        DVec3::from_array(self.axes.map(|a| a.x))
    }

    /// Its velocity, m/s.
    pub fn velocity_m_per_s(&self) -> DVec3 {
        DVec3::from_array(self.axes.map(|a| a.v))
    }

    /// The force that the motors render now, N.
    pub fn force_n(&self) -> DVec3 {
        DVec3::from_array(self.axes.map(|a| a.force))
    }

    /// What the operator wants now.
    pub fn target(&self) -> Target {
        self.motion.target(self.now.unwrap_or(0.0))
    }

    /// Sums since `open`.
    pub fn energies(&self) -> Energies {
        self.axes.iter().fold(Energies::default(), |sum, Axis { energy: e, .. }| Energies {
            motor_j: sum.motor_j + e.motor_j,
            hand_j: sum.hand_j + e.hand_j,
            viscous_j: sum.viscous_j + e.viscous_j,
            coulomb_j: sum.coulomb_j + e.coulomb_j,
            hand_damper_j: sum.hand_damper_j + e.hand_damper_j,
        })
    }

    /// Kinetic energy, and that of the hand's spring, J.
    pub fn held_j(&self) -> f64 {
        let stretched = self.target().position_m - self.position_m();
        0.5 * self.plant.mass * self.velocity_m_per_s().length_squared()
            + 0.5 * self.plant.hand.stiffness_n_per_m * stretched.length_squared()
    }

    /// How many commands were cut to the force limit since `open`.
    pub fn saturations(&self) -> u64 {
        self.saturations
    }

    /// Moves from `from` to `to`, s, with the commands that arrive on the way.
    fn advance(&mut self, mut from: f64, to: f64) {
        while from < to {
            while let Some(force) = self.pending.due(from) {
                self.command(force);
            }
            // A sliver that rounding leaves over goes with the last stretch.
            let last = if to - from < STRETCH * 1.001 { to } else { from + STRETCH };
            let until = last.min(self.pending.next().unwrap_or(f64::INFINITY));
            let (a, b) = (self.motion.target(from), self.motion.target(until));
            for (i, axis) in self.axes.iter_mut().enumerate() {
                let end = |t: &Target| [t.position_m[i], t.velocity_m_per_s[i], t.push_n[i]];
                let span = until - from;
                axis.advance(&self.plant, span, &Aim::between(end(&a), end(&b), span));
            }
            from = until;
        }
        while let Some(force) = self.pending.due(to) {
            self.command(force);
        }
    }

    fn command(&mut self, force: DVec3) {
        for (axis, f) in self.axes.iter_mut().zip(force.to_array()) {
            axis.command = f;
        }
    }
}

impl Device for Simulated {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }

    /// Starts at rest, at the motion script's beginning.
    fn open(&mut self) -> Result<(), OpenError> {
        let start = self.motion.target(0.0).position_m.to_array();
        self.axes = start.map(|x| Axis { x, ..Axis::default() });
        (self.now, self.pending) = (Some(0.0), Pending::default());
        (self.sequence, self.saturated, self.saturations) = (0, false, 0);
        Ok(())
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        let before = self.now.ok_or(Fault::NotOpen)?;
        if now_s > before {
            self.advance(before.max(now_s - LONGEST_GAP), now_s);
            self.now = Some(now_s);
        }
        self.sequence += 1;
        let step = self.capabilities.mechanics.resolution_m.value;
        let read = |x: f64| if step > 0.0 { libm::rint(x / step) * step } else { x };
        let pose = Pose { position_m: self.axes.map(|a| read(a.x)), ..Pose::default() };
        let status = Status { saturated: self.saturated, ..Status::default() };
        Ok(Sample { sequence: self.sequence, pose, status, ..Sample::default() })
    }

    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        let now = self.now.ok_or(Fault::NotOpen)?;
        let force = DVec3::from_array(command.force_n);
        // A real amplifier renders something for anything; nothing is the safest.
        let force = if force.is_finite() { force } else { DVec3::ZERO };
        let most = self.capabilities.max_force_n.value;
        self.saturated = force.length() > most;
        self.saturations += u64::from(self.saturated);
        let force = force.clamp_length_max(most);
        let delay = self.capabilities.mechanics.delay_s.value;
        if delay == 0.0 {
            self.command(force);
        } else if let Some(early) = self.pending.push(now + delay, force) {
            self.command(early);
        }
        Ok(())
    }

    fn close(&mut self) {
        self.command(DVec3::ZERO);
        self.now = None;
    }
}

/// Commands under way: a ring of fixed size.
#[derive(Debug)]
struct Pending {
    ring: [(f64, DVec3); UNDER_WAY],
    first: usize,
    count: usize,
}

impl Default for Pending {
    fn default() -> Self {
        Pending { ring: [(0.0, DVec3::ZERO); UNDER_WAY], first: 0, count: 0 }
    }
}

impl Pending {
    /// When the next one arrives, s.
    fn next(&self) -> Option<f64> {
        (self.count > 0).then(|| self.ring[self.first].0)
    }

    /// Takes the next one if it has arrived at `now`.
    fn due(&mut self, now: f64) -> Option<DVec3> {
        if self.next()? > now {
            return None;
        }
        let (_, force) = self.ring[self.first];
        (self.first, self.count) = ((self.first + 1) % UNDER_WAY, self.count - 1);
        Some(force)
    }

    /// Adds one that arrives at `when`; where there is no room, gives back the oldest.
    fn push(&mut self, when: f64, force: DVec3) -> Option<DVec3> {
        let oldest = if self.count == UNDER_WAY { self.due(f64::INFINITY) } else { None };
        self.ring[(self.first + self.count) % UNDER_WAY] = (when, force);
        self.count += 1;
        oldest
    }
}
