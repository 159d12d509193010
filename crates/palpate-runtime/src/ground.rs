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
    /// must wait for the ground. Whatever else renders a wrench from a pose puts its own in this place.
    ///
    /// # Real-time
    /// A step of the engine; another must be as bounded and allocate as little.
    fn step(&self, contact: &mut Contact, pose: &ToolState, dt_s: f64) -> Option<Output>
    where
        Self: Sized,
    {
        ready(self, contact, pose).then(|| contact.step(self.model(), pose, dt_s))
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

/// Whether `contact` can take a step to `pose` on this ground. A tool that touches can: at the ground's end its contact
/// point waits. A free tool must be where the ground is known, and must have been there the step before: the way between
/// is then known too. What came from elsewhere is forgotten, and inside the body feels nothing until it has left it.
pub(crate) fn ready<G: Ground>(ground: &G, contact: &mut Contact, pose: &ToolState) -> bool {
    if contact.touching().is_some() {
        return true;
    }
    let radius = ground.model().tool().radius_m();
    // NaN and infinity are the engine's to refuse.
    if !ground.knows(pose.position_m, radius) && pose.position_m.iter().all(|x| x.is_finite()) {
        return false;
    }
    if contact.last_position_m().is_some_and(|from| !ground.knows(from, radius)) {
        contact.forget();
    }
    true
}
