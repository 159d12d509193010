//! The budget of a step.

/// The evaluations of the force law and the looks at elements that are left to a step.
///
/// One for all that a step does: slip searches, the start directions that they try around a vertex, their derivatives,
/// the first settling of a sphere's contact point, and every place that is tried after a release.
#[derive(Debug)]
pub(crate) struct Budget {
    left: u32,
    /// Evaluations of the force law so far.
    pub evaluations: u32,
    /// Edges crossed so far, and elements looked at around a vertex for a start direction.
    pub crossings: u32,
}

impl Budget {
    /// Evaluations and crossings that a step makes at most, together, besides the evaluation with which every step in contact
    /// begins. One look around a vertex may take 256 of them, a step on a smooth body takes some four.
    pub const STEP: u32 = 512;

    /// What a search that has to stop may still take, to read the law where it left the contact point.
    const CLOSING: u32 = 8;

    #[inline(always)]
    pub fn new(step: u32) -> Self {
        Budget { left: step.saturating_sub(Self::CLOSING), evaluations: 0, crossings: 0 }
    }

    /// Whether nothing more may be begun.
    #[inline(always)]
    pub fn is_spent(&self) -> bool {
        self.left == 0
    }

    /// The law is evaluated, or differentiated.
    #[inline(always)]
    pub fn evaluate(&mut self) {
        self.left = self.left.saturating_sub(1);
        self.evaluations += 1;
    }

    /// An edge is crossed, or an element looked at; false if it must not be.
    #[inline(always)]
    pub fn cross(&mut self) -> bool {
        let may = self.left > 0;
        self.left -= u32::from(may);
        self.crossings += u32::from(may);
        may
    }
}
