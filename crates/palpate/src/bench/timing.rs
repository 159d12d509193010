//! Times of steps, with the clock's own taken off.

use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Steps timed together for the median, so that reading the clock does not count.
pub const BATCH: usize = 64;

/// What a step costs, ns.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Times {
    /// Of a batch's mean: over batches of 64 steps in a row.
    pub median_ns: f64,
    /// Of single steps.
    pub p99_ns: f64,
    /// Of single steps.
    pub p999_ns: f64,
}

/// The clock, and what reading it costs.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    /// Between two readings in a row, ns: the median.
    pub overhead_ns: f64,
}

impl Clock {
    /// Measures the clock itself.
    pub fn measure() -> Self {
        let mut times: Vec<f64> = (0..20_001).map(|_| Self::nanoseconds(|| ())).collect();
        Clock { overhead_ns: percentile(&mut times, 0.5) }
    }

    /// The time of `work`, the clock's included.
    pub fn nanoseconds(work: impl FnOnce()) -> f64 {
        let start = Instant::now();
        work();
        black_box(start).elapsed().as_nanos() as f64
    }

    /// Sums up times of whole batches and of single steps.
    pub fn sum_up(&self, mut batches: Vec<f64>, mut singles: Vec<f64>) -> Times {
        let median_ns = (percentile(&mut batches, 0.5) - self.overhead_ns).max(0.0) / BATCH as f64;
        // Reading the clock overlaps with the step: taking all of it off may take a little too much.
        let single = |q: f64, times: &mut [f64]| (percentile(times, q) - self.overhead_ns).max(median_ns);
        Times { median_ns, p99_ns: single(0.99, &mut singles), p999_ns: single(0.999, &mut singles) }
    }
}

/// The value below which a share `q` of `values` lies; 0 of none.
fn percentile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let i = (q * values.len() as f64) as usize;
    values.get(i.min(values.len().saturating_sub(1))).copied().unwrap_or(0.0)
}
