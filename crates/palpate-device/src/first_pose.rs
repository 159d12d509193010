//! Waiting for the first pose from a driver's other thread.

use crate::latest::Reader;
use std::thread;
use std::time::{Duration, Instant};

/// How long the first pose may take.
const PATIENCE: Duration = Duration::from_secs(1);

/// The first pose, or what `trouble` told before one came; `None` if neither came in time.
pub(crate) fn first_pose<const N: usize, T>(
    poses: &mut Reader<N>,
    trouble: impl Fn() -> Option<T>,
) -> Result<[f64; N], Option<T>> {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        if let Some(pose) = poses.take() {
            return Ok(pose);
        }
        if let Some(trouble) = trouble() {
            return Err(Some(trouble));
        }
        thread::sleep(Duration::from_millis(1));
    }
    Err(None)
}
