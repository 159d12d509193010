//! What long work tells while it is under way.

/// Hears of it; from any thread.
pub trait Progress: Sync {
    /// It begins: of `points`, `before` are done already.
    fn begin(&self, _points: usize, _before: usize) {}

    /// One more point is done, with so many paths.
    fn done(&self, _paths: usize) {}

    /// Something that deserves to be said.
    fn note(&self, _message: &str) {}

    /// It has ended, well or badly.
    fn end(&self) {}
}

/// Nobody listens.
impl Progress for () {}
