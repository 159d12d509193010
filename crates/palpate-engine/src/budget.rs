//! The budget of a step.

/// The evaluations of the force law and the looks at elements that are left to a contact point's step.
///
/// One for all that the step does: slip searches, the start directions that they try around a vertex, their derivatives,
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
    /// Evaluations and crossings that a contact point's step makes at most, together, besides the evaluation with which every step
    /// in contact begins; with two contact points (partial slip) each has as many. One look around a vertex may take 256 of them, a
    /// step on a smooth body takes some four.
    pub const STEP: u32 = 512;

    /// What is read of the law after the rest is spent, to leave the contact point where the law is known. At most, one after the
    /// other:
    ///
    /// - 5 by the search in which it is spent: the last iterate of Newton's method, the way back and the slope of its second
    ///   try, the slope of the bracket and the way back to its lower end;
    /// - 1 where the tank holds that back;
    /// - 3 after a wait at a patch's boundary: where the point was, where it goes, and where the tank holds it;
    /// - 5 after a contact that ended there: one for each place that is tried.
    ///
    /// A search that begins on a spent budget reads nothing.
    pub(crate) const CLOSING: u32 = 14;

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
