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

/// What something took, s.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spent {
    /// Processor time of all threads, the system's for them included; `None` where the system doesn't tell.
    pub cpu_s: Option<f64>,
    /// By the clock on the wall.
    pub wall_s: f64,
}

impl std::ops::Add for Spent {
    type Output = Spent;

    fn add(self, other: Spent) -> Spent {
        let cpu_s = self.cpu_s.zip(other.cpu_s).map(|(a, b)| a + b);
        Spent { cpu_s, wall_s: self.wall_s + other.wall_s }
    }
}

/// Measures what long things take.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    wall: Instant,
    cpu_s: Option<f64>,
}

impl Stopwatch {
    /// Begins.
    pub fn start() -> Self {
        Stopwatch { wall: Instant::now(), cpu_s: cpu_seconds() }
    }

    /// Since the start.
    pub fn stop(self) -> Spent {
        let cpu_s = cpu_seconds().zip(self.cpu_s).map(|(now, then)| now - then);
        Spent { cpu_s, wall_s: self.wall.elapsed().as_secs_f64() }
    }
}

#[cfg(unix)]
fn cpu_seconds() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
}

#[cfg(not(unix))]
fn cpu_seconds() -> Option<f64> {
    None
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
