//! Certificates: bounds, over all states that a slip can come through on an element, of the energy that it takes out,
//! of its stability, and of how fast the force changes (MODEL 5; docs/passivity.md derives them).
//!
//! A [`ElementStates`] is an element, a [`Cell`] a set of its states, a [`Criterion`] what is bounded over it. [`least`] cuts
//! cells until the bound is near the least value found, or decides. The bound is interval arithmetic over the curves'
//! Bernstein ordinates: a proof up to rounding, not a sample. Offline: this allocates, and [`Contact::step`] never
//! comes here.
//!
//! [`Contact::step`]: crate::Contact::step

mod centred;
mod consistent;
mod coupled;
mod criteria;
mod curves;
mod drive;
mod interval;
mod law;
mod patch;
mod rates;
mod search;
mod slopes;
mod states;
#[cfg(test)]
mod tests;
mod turning;

use crate::PARTIAL_SLIP;
use palpate_body::{ContactModel, SlipRule};

pub use coupled::SHALLOWEST;
pub use criteria::Criterion;
pub use patch::{Cell, ElementStates, SlipState};
pub use search::{Bounds, Effort, ROUNDING, least};

/// For which motions a certificate holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assumptions {
    /// Longest way of the tool from one step to the next, m: a slip begins no farther from a state within the friction
    /// limit.
    pub step_m: f64,
    /// Deepest δz, m; none is the curves' last knot.
    pub depth_m: Option<f64>,
    /// How far off the drive the way of a slip may be, rad: the slip search follows the drive in straight pieces.
    pub aside_rad: f64,
    /// What the body's friction is multiplied by.
    pub friction_factor: f64,
    /// The rule that slips follow.
    pub slip: SlipRule,
}

impl Assumptions {
    /// Of a contact point with so many times the friction.
    pub fn with_friction(&self, factor: f64) -> Self {
        Assumptions { friction_factor: self.friction_factor * factor, ..*self }
    }
}

/// The frictions of a body's contact points, in parts of the body's: force and energies are their means, so that what is bounded for each
/// is bounded for the contact.
pub fn frictions(body: &ContactModel) -> &'static [f64] {
    if body.has_partial_slip() { &PARTIAL_SLIP } else { &[1.0] }
}

impl Default for Assumptions {
    /// 1 mm, as of a hand at 1 m/s and 1 kHz; 3°, more than a body turns over the way of such a slip.
    fn default() -> Self {
        Assumptions {
            step_m: 1e-3,
            depth_m: None,
            aside_rad: 0.05,
            friction_factor: 1.0,
            slip: SlipRule::default(),
        }
    }
}
