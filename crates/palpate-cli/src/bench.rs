//! The cost of a step against the size of the mesh: cylinders of the same responses, ever finer. And that of a path of
//! the offline simulation.

mod cylinder;
pub mod reference;
mod regimes;
mod timing;

pub use cylinder::{coupled_cylinder, cylinder};
pub use regimes::{REGIMES, run};
pub use timing::{Clock, Spent, Stopwatch, Times};

use serde::Serialize;

/// One regime on one mesh.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Of the mesh.
    pub triangles: usize,
    /// What the tool did.
    pub regime: &'static str,
    /// Whether the lateral response depends on the direction.
    pub anisotropic: bool,
    /// The law: `decoupled` or `coupled`.
    pub law: &'static str,
    /// Slip rule.
    pub slip: &'static str,
    /// Two contact points side by side.
    pub partial_slip: bool,
    /// Steps that were timed one by one.
    pub steps: usize,
    /// Times of a step.
    #[serde(flatten)]
    pub times: Times,
    /// Evaluations of the force law in the slip search.
    pub evaluations_per_step: f64,
    /// Edges that the contact point crossed.
    pub crossings_per_step: f64,
    /// Steps with slip, as a share.
    pub slipping: f64,
    /// Steps that touched, as a share.
    pub in_contact: f64,
    /// Steps in which the slip search ran into its bound.
    pub capped: u64,
}
