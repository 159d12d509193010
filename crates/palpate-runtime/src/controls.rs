//! Steering a running loop: settings that change while it runs, each through silence.
//!
//! ```text
//! callers ── lock among themselves ──→ ring ──→ haptic thread: silence, then the change, then the soft start
//! ```
//!
//! A pause is a flag beside the ring: it waits for nothing. A setting that is as it was costs no silence. What was accepted and
//! not yet made when the session ends is not made.
//!
//! The haptic thread takes a change out of the ring, brings the force to zero within the slew limit, makes the change, and lets
//! the force ramp up anew. It never waits, allocates or frees memory: what a change replaced goes back through a ring.

use crate::{Coupling, HapticLoop, Limit, PatchHolder, Safety, SafetyError};
use palpate_body::SlipRule;
use palpate_device::Capabilities;
use palpate_engine::Contact;
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Changes under way at a time, at most.
const ROOM: usize = 64;

/// What can change.
#[derive(Debug)]
pub(crate) enum Change {
    /// The last stage's limits.
    Limits { force: Limit, torque: Limit },
    /// What multiplies the body's friction coefficients.
    FrictionScale(f64),
    /// How the contact point slips.
    Slip(SlipRule),
    /// Another body, with its first patch and a contact for it.
    Body(Box<BodyChange>),
}

/// What goes over to another body; after the change it holds what was there before.
#[derive(Debug)]
pub(crate) struct BodyChange {
    pub patch_holder: PatchHolder,
    pub contact: Contact,
    pub coupling: Option<Coupling>,
    /// Tells the old body's finder that it is no longer asked.
    pub retired: Arc<AtomicBool>,
}

/// Why a change was not made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControlError {
    /// A value that can't be.
    #[error(transparent)]
    Setting(#[from] SafetyError),
    /// The haptic thread has not made the last ones yet.
    #[error("{ROOM} changes are under way already; wait until they are made")]
    Full,
    /// There is no loop any more.
    #[error("the session has ended; start another")]
    Over,
    /// The body does not go with it.
    #[error("{0}")]
    Body(String),
    /// A recording is of one body.
    #[error("a recording is of one body; end the session and start another, or don't record")]
    Recorded,
}

/// The haptic thread's end.
#[derive(Debug)]
pub(crate) struct Inbox {
    changes: Consumer<Change>,
    used: Producer<Box<BodyChange>>,
    pending: Option<Change>,
    paused: Arc<AtomicBool>,
    was_paused: bool,
}

/// The callers' end; clones share it.
#[derive(Debug, Clone)]
pub struct Controls {
    ends: Arc<Mutex<Ends>>,
    limits: Arc<Limits>,
    paused: Arc<AtomicBool>,
}

#[derive(Debug)]
struct Ends {
    changes: Producer<Change>,
    used: Consumer<Box<BodyChange>>,
    safety: Safety,
}

/// What limits are made from.
#[derive(Debug)]
struct Limits {
    capabilities: Capabilities,
    rate_hz: f64,
}

/// Both ends, of a loop with this device and these settings.
pub(crate) fn controls(capabilities: Capabilities, safety: Safety, rate_hz: f64) -> (Controls, Inbox) {
    let (producer, changes) = RingBuffer::new(ROOM);
    let (used, back) = RingBuffer::new(ROOM);
    let ends = Arc::new(Mutex::new(Ends { changes: producer, used: back, safety }));
    let limits = Arc::new(Limits { capabilities, rate_hz });
    let paused = Arc::new(AtomicBool::new(false));
    let inbox = Inbox { changes, used, pending: None, paused: paused.clone(), was_paused: false };
    (Controls { ends, limits, paused }, inbox)
}

impl Controls {
    /// The largest force, N, and how fast it may change, N/s (`None` for the slowest that lets a stop end in two periods).
    ///
    /// # Errors
    /// More than the device was opened with, which its driver and its library hold to; what [`Safety::stages`] refuses;
    /// [`ControlError::Full`], [`ControlError::Over`].
    pub fn set_force_limit(&self, force_max_n: f64, slew_n_per_s: Option<f64>) -> Result<(), ControlError> {
        self.within_device(
            "force_max_n",
            force_max_n,
            Some(self.limits.capabilities.max_force_n.value),
            "N",
        )?;
        self.set_limits(|safety| {
            (safety.force_max_n, safety.slew_n_per_s) = (Some(force_max_n), slew_n_per_s);
        })
    }

    /// The largest force as it was set last, N: no more than the device was opened with.
    pub fn force_limit_n(&self) -> f64 {
        let safety = self.ends.lock().unwrap_or_else(PoisonError::into_inner).safety;
        // What a session has was not refused.
        safety.stages(&self.limits.capabilities, self.limits.rate_hz).map_or(0.0, |s| s.force.most())
    }

    /// The largest torque, N·m, and how fast it may change, N·m/s.
    ///
    /// # Errors
    /// As [`Controls::set_force_limit`].
    pub fn set_torque_limit(
        &self,
        torque_max_nm: f64,
        slew_nm_per_s: Option<f64>,
    ) -> Result<(), ControlError> {
        let most = self.limits.capabilities.max_torque_nm.as_ref().map(|most| most.value);
        self.within_device("torque_max_nm", torque_max_nm, most, "N·m")?;
        self.set_limits(|safety| {
            (safety.torque_max_nm, safety.torque_slew_nm_per_s) = (Some(torque_max_nm), slew_nm_per_s);
        })
    }

    /// Under one lock, so that two callers' limits don't undo each other.
    fn set_limits(&self, change: impl FnOnce(&mut Safety)) -> Result<(), ControlError> {
        let mut ends = self.ends.lock().unwrap_or_else(PoisonError::into_inner);
        let mut safety = ends.safety;
        change(&mut safety);
        let stages = safety.stages(&self.limits.capabilities, self.limits.rate_hz)?;
        ends.send(Change::Limits { force: stages.force, torque: stages.torque })?;
        ends.safety = safety;
        Ok(())
    }

    /// What multiplies the body's friction coefficients, from 0 to 100.
    ///
    /// # Errors
    /// A number that is not; [`ControlError::Full`], [`ControlError::Over`].
    pub fn set_friction_scale(&self, scale: f64) -> Result<(), ControlError> {
        if !(0.0..=100.0).contains(&scale) {
            let problem = format!("it is {scale}");
            let hint = "give a number from 0 to 100".into();
            return Err(SafetyError { setting: "friction_scale", problem, hint }.into());
        }
        self.send(Change::FrictionScale(scale))
    }

    /// No force from the next period on, within the slew limit, until [`Controls::resume`]. It waits for no other change.
    pub fn pause(&self) {
        self.paused.store(true, Ordering::Release);
    }

    /// Ends a pause: the force ramps up anew.
    pub fn resume(&self) {
        self.paused.store(false, Ordering::Release);
    }

    /// A limit above the device's own would do nothing.
    fn within_device(
        &self,
        setting: &'static str,
        asked: f64,
        most: Option<f64>,
        unit: &str,
    ) -> Result<(), SafetyError> {
        let (problem, hint) = match most {
            Some(most) if asked > most => (
                format!("{asked} {unit} is above the {most} {unit} that the device was opened with"),
                "give no more, or start the session with a larger limit",
            ),
            None => ("the device drives no rotation".into(), "leave it out"),
            Some(_) => return Ok(()),
        };
        Err(SafetyError { setting, problem, hint: hint.into() })
    }

    pub(crate) fn send(&self, change: Change) -> Result<(), ControlError> {
        self.ends.lock().unwrap_or_else(PoisonError::into_inner).send(change)
    }
}

impl Ends {
    fn send(&mut self, change: Change) -> Result<(), ControlError> {
        while self.used.pop().is_ok() {}
        if self.changes.is_abandoned() {
            return Err(ControlError::Over);
        }
        self.changes.push(change).map_err(|_| ControlError::Full)
    }
}

impl Inbox {
    /// At the beginning of a period: makes the next change if there is no force, else asks for silence in this period.
    ///
    /// # Real-time
    /// Bounded; never waits, allocates or frees.
    pub(crate) fn attend(&mut self, haptics: &mut HapticLoop, patch_holder: &mut PatchHolder) {
        if self.pending.is_none() {
            self.pending = self.changes.pop().ok();
        }
        let paused = self.paused.load(Ordering::Acquire);
        if paused != self.was_paused {
            self.was_paused = paused;
            if paused { haptics.stop() } else { haptics.resume() }
        }
        let Some(change) = self.pending.take() else { return };
        let nothing_new = match change {
            Change::FrictionScale(scale) => scale == haptics.contact().friction_scale(),
            Change::Slip(rule) => rule == haptics.contact().slip_rule(),
            Change::Limits { .. } | Change::Body(_) => false,
        };
        if nothing_new {
            return;
        }
        haptics.hush();
        if !haptics.is_silent() {
            self.pending = Some(change);
            return;
        }
        match change {
            Change::Limits { force, torque } => haptics.set_limits(force, torque),
            Change::FrictionScale(scale) => haptics.contact_mut().set_friction_scale(scale),
            Change::Slip(rule) => haptics.contact_mut().set_slip_rule(rule),
            Change::Body(mut change) => {
                std::mem::swap(patch_holder, &mut change.patch_holder);
                haptics.replace_body(&mut change.contact, &mut change.coupling);
                change.retired.store(true, Ordering::Release);
                if let Err(rtrb::PushError::Full(change)) = self.used.push(change) {
                    // Freed memory may take a lock: rather kept for good. No more come back than were sent.
                    std::mem::forget(change);
                }
            }
        }
    }
}
