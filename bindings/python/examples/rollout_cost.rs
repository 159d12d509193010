//! What a rollout costs in Rust, for `measure.py` to compare with: `rollout_cost BODY PATH REPEATS`. PATH holds positions, 64-bit numbers;
//! printed is the least processor time of a repeat, ns a step (Linux).

use palpate::engine::{Output, Waypoint, rollout};
use palpate::{Ablation, Body, ToolState};

/// Of this thread so far, ns.
fn processor_time() -> Option<u64> {
    std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, body, path, repeats] = &arguments[..] else { return Err("give BODY, PATH and REPEATS".into()) };
    let body = Body::open(body.as_ref())?;
    let bytes = std::fs::read(path)?;
    let numbers = bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b));
    let numbers: Vec<f64> = numbers.collect();
    let place = |(k, p): (usize, &[f64; 3])| Waypoint { time_s: k as f64 * 1e-3, pose: ToolState::at(*p) };
    let waypoints: Vec<Waypoint> = numbers.as_chunks::<3>().0.iter().enumerate().map(place).collect();
    let mut least = f64::INFINITY;
    for _ in 0..repeats.parse()? {
        let begun = processor_time().ok_or("this needs Linux's /proc")?;
        let outputs: Vec<Output> =
            rollout(&body, waypoints.iter().copied(), body.slip(), Ablation::None).collect();
        let spent = processor_time().ok_or("this needs Linux's /proc")? - begun;
        least = least.min(spent as f64 / outputs.len() as f64);
    }
    println!("{least:.1}");
    Ok(())
}
