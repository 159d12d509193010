//! Deterministic rollout of a tool path: one output for each pose, no clock.

use crate::contact::Contact;
use crate::kernel::Ablation;
use crate::output::{Output, ToolState};
use palpate_body::{Body, SlipRule};

/// The tool's pose at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// s.
    pub time_s: f64,
    /// In the body's frame.
    pub pose: ToolState,
}

/// A contact that is led along a path: an iterator over its outputs.
#[derive(Debug)]
pub struct Rollout<'b, I> {
    body: &'b Body,
    contact: Contact,
    path: I,
    last_s: Option<f64>,
}

/// Leads a new contact on `body` along `path`, with this slip rule.
pub fn rollout<I>(body: &Body, path: I, rule: SlipRule, ablation: Ablation) -> Rollout<'_, I::IntoIter>
where
    I: IntoIterator<Item = Waypoint>,
{
    let contact = Contact::with_slip(body, rule, ablation);
    Rollout { body, contact, path: path.into_iter(), last_s: None }
}

impl<I> Rollout<'_, I> {
    /// The same with the slip rule alone, without the tank that keeps it from giving out energy.
    pub fn without_tank(self) -> Self {
        Rollout { contact: self.contact.with_tank(false), ..self }
    }

    /// The same with two contact points side by side, or with one: see [`Contact::with_partial_slip`].
    pub fn with_partial_slip(self, partial_slip: bool) -> Self {
        Rollout { contact: self.contact.with_partial_slip(partial_slip), ..self }
    }

    /// The same with the body's friction coefficients multiplied by `scale`, from the next pose on.
    pub fn with_friction_scale(mut self, scale: f64) -> Self {
        self.contact.set_friction_scale(scale);
        self
    }

    /// The contact as it is now.
    pub fn contact(&self) -> &Contact {
        &self.contact
    }
}

impl<I: Iterator<Item = Waypoint>> Iterator for Rollout<'_, I> {
    type Item = Output;

    fn next(&mut self) -> Option<Output> {
        let Waypoint { time_s, pose } = self.path.next()?;
        let dt = time_s - self.last_s.replace(time_s).unwrap_or(time_s);
        Some(self.contact.step(self.body, &pose, dt))
    }
}
