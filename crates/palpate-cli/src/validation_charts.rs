//! Pictures of a validation.

use crate::plot::{Line, LineChart};
use glam::DVec3;
use palpate_build::validate::{Measure, PathResult, Source, Validation};

/// How the errors are distributed, and the paths of worst, median and best error, simulated and rendered.
pub fn charts(validation: &Validation) -> Vec<LineChart> {
    let error = |p: &PathResult| {
        p.answer(Source::Body).map_or(0.0, |a| a.normal.rms_percent.hypot(a.lateral.rms_percent))
    };
    let mut order: Vec<&PathResult> = validation.paths.iter().collect();
    order.sort_by(|a, b| error(a).total_cmp(&error(b)));
    let chosen = [("worst", order.last()), ("median", order.get(order.len() / 2)), ("best", order.first())];
    let charts = chosen.into_iter().filter_map(|(name, p)| chart(name, p?, error(p?)));
    std::iter::once(distribution(validation)).chain(charts).collect()
}

fn distribution(validation: &Validation) -> LineChart {
    let lines = [Measure::Largest, Measure::Local].into_iter().flat_map(|measure| {
        let of = match measure {
            Measure::Local => "% of the force there",
            _ => "% of the path's largest force",
        };
        let [normal, lateral] = validation.state_errors(measure);
        [("normal", normal), ("lateral", lateral)].map(|(name, errors)| {
            let n = errors.len() as f64;
            // The last one in a hundred would set the scale.
            let shares = errors.iter().enumerate().map(|(i, &e)| (100.0 * (i as f64 + 1.0) / n, e));
            let points = shares.filter(|p| p.0 <= 99.0).collect();
            Line { name: format!("{name}, {of}"), points, ..Line::default() }
        })
    });
    LineChart {
        title: format!("Errors at all states ({} paths)", validation.paths.len()),
        x_label: "states (%)".into(),
        y_label: "error (%)".into(),
        lines: lines.collect(),
        from_zero: true,
    }
}

/// None of a path whose forces were not kept.
fn chart(name: &str, path: &PathResult, error: f64) -> Option<LineChart> {
    let body = path.answer(Source::Body)?;
    let (u, d) = (DVec3::from_array(path.inward), DVec3::from_array(path.direction));
    let first = path.states.first()?.offset_m;
    let way = path.states.iter().scan((first, 0.0), |(last, way), s| {
        *way += last.distance(s.offset_m) * 1e3;
        *last = s.offset_m;
        Some(*way)
    });
    let way: Vec<f64> = way.collect();
    let line = |name: &str, along: DVec3| Line {
        name: name.into(),
        points: way.iter().copied().zip(body.forces_n.iter().map(|f| f.dot(along))).collect(),
        dots: way.iter().copied().zip(path.states.iter().map(|s| s.simulated_n.dot(along))).collect(),
    };
    Some(LineChart {
        title: format!(
            "The path of {name} error ({error:.1} %, rms): {:.2} mm deep, dragged by {:.2} mm. Dots: simulated",
            path.depth_m * 1e3,
            path.distance_m * 1e3
        ),
        x_label: "way of the tool (mm)".into(),
        y_label: "force on the body (N)".into(),
        lines: vec![line("normal", u), line("along the drag", d), line("across both", u.cross(d))],
        from_zero: true,
    })
}
