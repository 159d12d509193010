//! What a loop steps on.

use palpate_body::{Body, ContactModel, Patch};
use palpate_engine::{Contact, Output, ToolState};

/// A whole body, or the part of it that is at hand.
pub trait Ground {
    /// As the engine takes it.
    fn model(&self) -> &ContactModel;

    /// Whether a tool of `radius_m` at `position_m` can touch nothing of the body but what is at hand.
    fn knows(&self, position_m: [f64; 3], radius_m: f64) -> bool;

    /// What acts on the tool at `pose`, `dt_s` after the last: the engine's step, or `None` where the tool
    /// must wait for the ground ([`Contact::step_where`]). Whatever else renders a wrench from a pose puts its own in this place.
    ///
    /// # Real-time
    /// A step of the engine; another must be as bounded and allocate as little.
    fn step(&self, contact: &mut Contact, pose: &ToolState, dt_s: f64) -> Option<Output>
    where
        Self: Sized,
    {
        let radius_m = self.model().tool().radius_m();
        contact.step_where(self.model(), pose, dt_s, |at| self.knows(at, radius_m))
    }
}

impl Ground for Body {
    fn model(&self) -> &ContactModel {
        self
    }

    fn knows(&self, _: [f64; 3], _: f64) -> bool {
        true
    }
}

impl Ground for Patch {
    fn model(&self) -> &ContactModel {
        Patch::model(self)
    }

    fn knows(&self, position_m: [f64; 3], radius_m: f64) -> bool {
        Patch::knows(self, position_m, radius_m)
    }
}
