//! The engine's steps of a recording, once more.

use super::Record;
use crate::ground::Ground;
use crate::live_session::serves_any_rule;
use palpate_body::{BodyError, BodySource, ContactModel, Patch, Result};
use palpate_engine::{Contact, Output};

/// Steps a contact through a recording's poses, on the patches that the loop had: the same bits come out.
#[derive(Debug)]
pub struct Retrace<'a> {
    body: &'a dyn BodySource,
    contact: Contact,
    /// The patch and its serial.
    patch: Option<(u64, Patch)>,
    /// When the last step was, s.
    stepped_s: Option<f64>,
    /// Whether the body was asked for what any rule reads, as a session does before its first patch.
    is_prepared: bool,
}

impl<'a> Retrace<'a> {
    /// `contact` must be as the loop's was: new, with its slip rule and ablation.
    pub fn new(body: &'a dyn BodySource, contact: Contact) -> Self {
        Retrace { body, contact, patch: None, stepped_s: None, is_prepared: false }
    }

    /// The contact as it is now.
    pub fn contact(&self) -> &Contact {
        &self.contact
    }

    /// What the last step was on: a patch, or the whole body.
    pub fn ground(&self) -> &ContactModel {
        self.patch.as_ref().map_or(self.body.model_header(), |(_, patch)| patch.model())
    }

    /// The engine's answer in the period of `record`, with its element numbered in the whole body; `None` if the engine was
    /// not asked then.
    ///
    /// # Errors
    /// The body's file can't be read; it stays in its file, and the record is of a loop on the whole body.
    pub fn step(&mut self, record: &Record) -> Result<Option<Output>> {
        if !std::mem::replace(&mut self.is_prepared, true) {
            serves_any_rule(self.body, self.contact.slip_rule());
        }
        self.go_over(record)?;
        if let Some(rule) = record.slip_rule() {
            if rule != self.contact.slip_rule() {
                self.body.serves(rule)?;
                self.contact.set_slip_rule(rule);
            }
            self.contact.set_friction_scale(record.friction_scale);
        }
        let Some(pose) = record.tool() else { return Ok(None) };
        let dt = record.time_s - self.stepped_s.replace(record.time_s).unwrap_or(record.time_s);
        let Some((_, patch)) = &self.patch else {
            let whole = self.body.model_header();
            if whole.elements().is_empty() {
                let problem = "its steps were on a whole body, which is not in memory";
                return Err(BodyError::invalid("recording", problem, "open the body with Body::open"));
            }
            self.body.serves(self.contact.slip_rule())?;
            return Ok(Some(self.contact.step(whole, &pose, dt)));
        };
        // As the loop did: what came from beyond the patch is forgotten. A record of a step is of one that was taken.
        let taken = Ground::step(patch, &mut self.contact, &pose, dt);
        let mut output = taken.unwrap_or_else(|| self.contact.step(patch.model(), &pose, dt));
        if let Some(contact) = &mut output.contact {
            contact.element = patch.global(contact.element);
        }
        Ok(Some(output))
    }

    /// To the patch that the period had, if it is another.
    fn go_over(&mut self, record: &Record) -> Result<()> {
        if record.patch_serial == 0
            || self.patch.as_ref().is_some_and(|(serial, _)| *serial == record.patch_serial)
        {
            return Ok(());
        }
        self.body.serves(self.contact.slip_rule())?;
        let mut next = self.body.patch();
        self.body.take(&mut next, record.patch_centre_m, record.patch_count as usize, &|| ())?;
        let from = |e: u32| self.patch.as_ref().map_or(e, |(_, patch)| patch.global(e));
        if !self.contact.renumber(|e| next.local(from(e))) {
            self.contact.forget();
        }
        self.patch = Some((record.patch_serial, next));
        Ok(())
    }
}
