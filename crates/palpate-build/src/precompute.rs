//! From a spec to a body by simulation: what is prepared, the run itself, and the body that its record makes.

pub mod assemble;
mod compliance;
pub mod elements;
pub mod fields;
mod of_spec;
pub mod prepare;
pub mod run;
mod supports;
pub mod touched;
pub mod volume;
mod workspace;

pub use of_spec::body_of_spec;
pub use run::{Options, PointSolver, Prepared, Rounds, Shard, Stopped, merge};
pub use workspace::Workspace;

/// What a path that ended early, or a point that could not be pressed at all, is reported as.
pub fn stops(
    index: u32,
    point: &crate::paths_file::TestPoint,
    paths: &palpate_simulate::PointPaths,
) -> Vec<String> {
    let p = point.plan.point * 1e3;
    let place = format!("test point {index} at ({:.2}, {:.2}, {:.2}) mm", p.x, p.y, p.z);
    let mm = |m: Option<f64>| format!("{:.3}", m.unwrap_or_default() * 1e3);
    let mut told = Vec::new();
    if let Some(stop) = &paths.press.stopped {
        let reached = paths.press.states.last().map(|s| s.depth_m);
        let what = match reached {
            None => "could not be pressed in: it is left out".to_string(),
            Some(_) => format!(
                "pressed to {} mm of {}, beyond which its curve goes on straight",
                mm(reached),
                mm(point.plan.depths.last().copied())
            ),
        };
        told.push(format!("{place}: {what} ({})", stop.why));
    }
    for (drag, path) in point.plan.drags.iter().zip(&paths.drags) {
        if let Some(stop) = &path.stopped {
            let d = drag.direction;
            told.push(format!(
                "{place}: dragged along ({:.2}, {:.2}, {:.2}) to {} mm of {} ({})",
                d.x,
                d.y,
                d.z,
                mm(path.states.last().map(|s| s.distance_m)),
                mm(drag.distances.last().copied()),
                stop.why
            ));
        }
    }
    told
}
