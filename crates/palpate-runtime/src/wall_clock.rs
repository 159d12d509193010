//! The machine's clock that somebody sets, for the one thing that may go by it: when a recording began.

use std::time::SystemTime;

/// s since 1970.
pub(crate) fn unix_now_s() -> f64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0.0, |t| t.as_secs_f64())
}
