//! No force that steps up by itself: after a silence nothing is rendered until the loop has commanded zero.

/// Closed while the device is not to render what it is commanded.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Latch {
    closed: bool,
}

impl Latch {
    /// The loop was silent for too long, or the device has taken its forces off.
    pub fn close(&mut self) {
        self.closed = true;
    }

    /// Whether commands don't pass.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// What passes of a command. Zero opens it: the loop that commands it knows that the hand has felt nothing.
    pub fn pass<const N: usize>(&mut self, command: [f64; N]) -> [f64; N] {
        self.closed &= command != [0.0; N];
        if self.closed { [0.0; N] } else { command }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_opens_at_zero_and_not_before() {
        let mut latch = Latch::default();
        assert_eq!(latch.pass([1.0, 0.0]), [1.0, 0.0]);
        latch.close();
        assert_eq!(latch.pass([1.0, 0.0]), [0.0; 2]);
        assert!(latch.is_closed());
        assert_eq!(latch.pass([-0.0, 0.0]), [0.0; 2]);
        assert_eq!(latch.pass([1.0, 0.0]), [1.0, 0.0]);
    }
}
