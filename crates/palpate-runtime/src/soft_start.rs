//! The force ramps up, at the beginning and after anything that went wrong.

/// A factor that rises from 0 to 1, by the same step in every period, however late: a loop that slept does not wake up
/// with all its force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoftStart {
    step: f64,
    factor: f64,
}

impl Default for SoftStart {
    /// None: 1 from the first period.
    fn default() -> Self {
        SoftStart { step: f64::INFINITY, factor: 0.0 }
    }
}

impl SoftStart {
    /// Over `seconds` in a loop of this period, s. The first period's factor is one step.
    pub fn new(seconds: f64, period_s: f64) -> Self {
        SoftStart { step: period_s / seconds, factor: 0.0 }
    }

    /// This period's factor; 0 where there is to be `silence`, and then it begins anew.
    pub(crate) fn factor(&mut self, silence: bool) -> f64 {
        self.factor = if silence { 0.0 } else { (self.factor + self.step).min(1.0) };
        self.factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_rises_to_one_and_begins_anew_after_silence() {
        let mut start = SoftStart::new(0.5, 1e-3);
        let rise: Vec<f64> = (0..600).map(|_| start.factor(false)).collect();
        assert!((rise[0] - 2e-3).abs() < 1e-15 && rise[498] < 1.0 && rise[501] == 1.0);
        assert!(rise.windows(2).all(|w| w[1] - w[0] < 2.001e-3 && w[1] >= w[0]));
        assert_eq!(start.factor(true), 0.0);
        assert!((start.factor(false) - 2e-3).abs() < 1e-15);
    }

    #[test]
    fn none_is_one_at_once() {
        for mut start in [SoftStart::default(), SoftStart::new(0.0, 1e-3)] {
            assert_eq!([start.factor(false), start.factor(true), start.factor(false)], [1.0, 0.0, 1.0]);
        }
    }
}
