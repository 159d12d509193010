//! A device and a hand that exist as equations: deterministic, and much faster than real time.

mod axis;
pub mod figures;
mod hand;
mod lead;
mod script;
mod wrist;

pub use hand::{Hand, HandMotion, Target};
pub use lead::Lead;
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

/// Energies of the simulated mechanics since `open`, of slides and hinges, J. Kinetic energy and that of the
/// hand's springs are what motor and hand put in, less the three dissipations.
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
///
/// The handle turns where rotations are sensed and [`Mechanics::wrist`](crate::Mechanics) is known: on three
/// hinges, one on the other, about z, y and x, in this order from the base, each with its own drive, encoder,
/// friction and inertia. A commanded torque becomes, by virtual work, the torques that the hinges' motors
/// hold until the next command, as a wrist's drives do. So each hinge is integrated as exactly as a slide.
#[derive(Debug)]
pub struct Simulated {
    capabilities: Capabilities,
    plant: Plant,
    motion: Box<dyn HandMotion>,
    slides: [Axis; 3],
    /// Of a wrist that turns.
    hinge: Option<Plant>,
    hinges: [Axis; 3],
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
            hand_damping: hand.damping_n_s_per_m,
            stiffness: hand.stiffness_n_per_m,
            lag: m.lag_s.value,
            slew: m.slew_n_per_s.value,
        };
        let hinge = figures::turning(&capabilities).map(|wrist| Plant {
            mass: wrist.inertia_kg_m2.value + hand.inertia_kg_m2,
            damping: wrist.damping_nm_s_per_rad.value,
            coulomb: wrist.coulomb_nm.value,
            hand_damping: hand.damping_nm_s_per_rad,
            stiffness: hand.stiffness_nm_per_rad,
            lag: m.lag_s.value,
            slew: wrist.slew_nm_per_s.value,
        });
        Simulated {
            capabilities,
            plant,
            motion,
            slides: [Axis::default(); 3],
            hinge,
            hinges: [Axis::default(); 3],
            now: None,
            pending: Pending::default(),
            sequence: 0,
            saturated: false,
            saturations: 0,
        }
    }

    /// Where the tool really is, m: what [`Device::read`] says is rounded to the encoder's steps.
    pub fn position_m(&self) -> DVec3 {
        DVec3::from_array(self.slides.map(|a| a.x))
    }

    /// Its velocity, m/s.
    pub fn velocity_m_per_s(&self) -> DVec3 {
        DVec3::from_array(self.slides.map(|a| a.v))
    }

    /// The force that the motors render now, N.
    pub fn force_n(&self) -> DVec3 {
        DVec3::from_array(self.slides.map(|a| a.force))
    }

    /// Angles of the wrist's hinges about x, y and z, rad; 0 where the handle does not turn. The handle's
    /// orientation is R_z R_y R_x. At ±90° of the middle one, y, the others' axes are parallel, and the
    /// handle can't be turned about every axis.
    pub fn angles_rad(&self) -> DVec3 {
        DVec3::from_array(self.hinges.map(|a| a.x))
    }

    /// How fast they change, rad/s.
    pub fn rates_rad_per_s(&self) -> DVec3 {
        DVec3::from_array(self.hinges.map(|a| a.v))
    }

    /// The torques that the hinges' motors render now, N·m.
    pub fn hinge_torques_nm(&self) -> DVec3 {
        DVec3::from_array(self.hinges.map(|a| a.force))
    }

    /// What the operator wants now.
    pub fn target(&self) -> Target {
        self.motion.target(self.now.unwrap_or(0.0))
    }

    /// Sums since `open`.
    pub fn energies(&self) -> Energies {
        self.slides.iter().chain(&self.hinges).fold(Energies::default(), |sum, Axis { energy: e, .. }| {
            Energies {
                motor_j: sum.motor_j + e.motor_j,
                hand_j: sum.hand_j + e.hand_j,
                viscous_j: sum.viscous_j + e.viscous_j,
                coulomb_j: sum.coulomb_j + e.coulomb_j,
                hand_damper_j: sum.hand_damper_j + e.hand_damper_j,
            }
        })
    }

    /// Kinetic energy, and that of the hand's springs, J.
    pub fn held_j(&self) -> f64 {
        let target = self.target();
        let held = |plant: &Plant, velocity: DVec3, stretched: DVec3| {
            0.5 * plant.mass * velocity.length_squared() + 0.5 * plant.stiffness * stretched.length_squared()
        };
        let slides = held(&self.plant, self.velocity_m_per_s(), target.position_m - self.position_m());
        let turned = target.angles_rad - self.angles_rad();
        slides + self.hinge.as_ref().map_or(0.0, |plant| held(plant, self.rates_rad_per_s(), turned))
    }

    /// How many commands were cut to the force or torque limit since `open`.
    pub fn saturations(&self) -> u64 {
        self.saturations
    }

    /// Moves from `from` to `to`, s, with the commands that arrive on the way.
    fn advance(&mut self, mut from: f64, to: f64) {
        while from < to {
            while let Some(wrench) = self.pending.due(from) {
                self.command(wrench);
            }
            // A sliver that rounding leaves over goes with the last stretch.
            let last = if to - from < STRETCH * 1.001 { to } else { from + STRETCH };
            let until = last.min(self.pending.next().unwrap_or(f64::INFINITY));
            let (a, b) = (self.motion.target(from), self.motion.target(until));
            let span = until - from;
            for (i, axis) in self.slides.iter_mut().enumerate() {
                let end = |t: &Target| [t.position_m[i], t.velocity_m_per_s[i], t.push_n[i]];
                axis.advance(&self.plant, span, &Aim::between(end(&a), end(&b), span));
            }
            if let Some(plant) = &self.hinge {
                for (i, axis) in self.hinges.iter_mut().enumerate() {
                    let end = |t: &Target| [t.angles_rad[i], t.rates_rad_per_s[i], t.torque_nm[i]];
                    axis.advance(plant, span, &Aim::between(end(&a), end(&b), span));
                }
            }
            from = until;
        }
        while let Some(wrench) = self.pending.due(to) {
            self.command(wrench);
        }
    }

    fn command(&mut self, [force, torque]: Wrench) {
        for (axis, f) in self.slides.iter_mut().zip(force.to_array()) {
            axis.command = f;
        }
        if self.hinge.is_some() {
            let directions = wrist::axes(self.angles_rad());
            for (axis, direction) in self.hinges.iter_mut().zip(directions) {
                axis.command = direction.dot(torque);
            }
        }
    }
}

impl Device for Simulated {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }

    /// Starts at rest, at the motion script's beginning.
    fn open(&mut self) -> Result<(), OpenError> {
        let start = self.motion.target(0.0);
        let at = |x: DVec3| x.to_array().map(|x| Axis { x, ..Axis::default() });
        self.slides = at(start.position_m);
        self.hinges = at(if self.hinge.is_some() { start.angles_rad } else { DVec3::ZERO });
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
        let read = |x: f64, step: f64| if step > 0.0 { libm::rint(x / step) * step } else { x };
        let step = self.capabilities.mechanics.resolution_m.value;
        let mut pose = Pose { position_m: self.slides.map(|a| read(a.x, step)), ..Pose::default() };
        if let Some(wrist) = figures::turning(&self.capabilities) {
            let step = wrist.resolution_rad.value;
            pose.orientation = wrist::orientation(DVec3::from_array(self.hinges.map(|a| read(a.x, step))));
        }
        let status = Status { saturated: self.saturated, ..Status::default() };
        Ok(Sample { sequence: self.sequence, pose, status, ..Sample::default() })
    }

    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        let now = self.now.ok_or(Fault::NotOpen)?;
        let (force, too_strong) = cut(command.force_n, self.capabilities.max_force_n.value);
        let driven =
            self.capabilities.max_torque_nm.as_ref().filter(|_| self.capabilities.driven.rotations > 0);
        let (torque, too_hard) =
            driven.map_or((DVec3::ZERO, false), |most| cut(command.torque_nm, most.value));
        self.saturated = too_strong || too_hard;
        self.saturations += u64::from(self.saturated);
        let delay = self.capabilities.mechanics.delay_s.value;
        if delay == 0.0 {
            self.command([force, torque]);
        } else if let Some(early) = self.pending.push(now + delay, [force, torque]) {
            self.command(early);
        }
        Ok(())
    }

    fn close(&mut self) {
        self.command([DVec3::ZERO; 2]);
        self.now = None;
    }
}

/// The vector, no longer than `most`, and whether it had to be cut.
fn cut(wanted: [f64; 3], most: f64) -> (DVec3, bool) {
    let wanted = DVec3::from_array(wanted);
    // A real amplifier renders something for anything; nothing is the safest.
    let wanted = if wanted.is_finite() { wanted } else { DVec3::ZERO };
    (wanted.clamp_length_max(most), wanted.length() > most)
}

/// Force, N, and torque, N·m.
type Wrench = [DVec3; 2];

/// Commands under way: a ring of fixed size.
#[derive(Debug)]
struct Pending {
    ring: [(f64, Wrench); UNDER_WAY],
    first: usize,
    count: usize,
}

impl Default for Pending {
    fn default() -> Self {
        Pending { ring: [(0.0, [DVec3::ZERO; 2]); UNDER_WAY], first: 0, count: 0 }
    }
}

impl Pending {
    /// When the next one arrives, s.
    fn next(&self) -> Option<f64> {
        (self.count > 0).then(|| self.ring[self.first].0)
    }

    /// Takes the next one if it has arrived at `now`.
    fn due(&mut self, now: f64) -> Option<Wrench> {
        if self.next()? > now {
            return None;
        }
        let (_, wrench) = self.ring[self.first];
        (self.first, self.count) = ((self.first + 1) % UNDER_WAY, self.count - 1);
        Some(wrench)
    }

    /// Adds one that arrives at `when`; where there is no room, gives back the oldest.
    fn push(&mut self, when: f64, wrench: Wrench) -> Option<Wrench> {
        let oldest = if self.count == UNDER_WAY { self.due(f64::INFINITY) } else { None };
        self.ring[(self.first + self.count) % UNDER_WAY] = (when, wrench);
        self.count += 1;
        oldest
    }
}
