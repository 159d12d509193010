//! What a trace says of a path.

use palpate_body::shape::{Resolution, Shape};
use palpate_body::{Body, Response, SlipRule};
use palpate_engine::{Ablation, Flags, ToolState, Waypoint, rollout};
use palpate_runtime::trace::TraceSummary;

/// Of two contact points one alone went over the border, untold: the steps without force after that counted as begun inside.
#[test]
fn what_is_inside_after_a_border_did_not_begin_there() {
    let tube = Shape::Cylinder { radius_mm: 30.0, length_mm: 40.0, caps: false };
    let edge = Resolution { edge_length_mm: Some(4.0), ..Default::default() };
    let response = Response::paper(600.0, 200.0, 0.5, 8e-3, 8e-3).unwrap();
    let body = Body::uniform(tube.surface(edge).unwrap(), response).unwrap().with_partial_slip(true);
    // Down at 10 mm from the middle, over the border at 20 mm, and back under the surface.
    let path: Vec<Waypoint> = (0..600)
        .map(|k| {
            let t = f64::from(k);
            let depth = -1e-3 + 4e-3 * (t / 100.0).min(1.0);
            let z = 10e-3 + 12e-3 * ((t - 100.0) / 240.0).clamp(0.0, 1.0)
                - 20e-3 * ((t - 340.0) / 200.0).max(0.0);
            let pose = ToolState::at([0.0298 - depth, 1e-3, z]);
            Waypoint { time_s: 1e-3 * t, pose }
        })
        .collect();
    for rule in SlipRule::ALL {
        let mut summary = TraceSummary::default();
        let mut led = rollout(&body, path.iter().copied(), rule, Ablation::None);
        for waypoint in &path {
            let output = led.next().unwrap();
            summary.add(&body, led.contact(), waypoint, &output);
        }
        summary.finish(led.contact());
        let [border, inside] = [Flags::BORDER, Flags::STARTED_INSIDE].map(|f| summary.flags.of(f));
        assert!(border == 1 && inside > 100, "{rule:?}: {border} {inside}");
        let warnings = summary.warnings(&body, &path, Ablation::None);
        assert!(warnings.iter().all(|w| !w.contains("began inside")), "{warnings:?}");
    }
}
