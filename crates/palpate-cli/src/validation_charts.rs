//! Pictures of a validation.

use crate::plot::{Line, LineChart};
use glam::DVec3;
use palpate_build::validate::{Compared, PathResult, Source, Validation};

/// How the errors are distributed, and the paths of median and worst error, simulated and rendered.
pub fn charts(validation: &Validation) -> Vec<LineChart> {
    let shares = |name: &str, errors: &dyn Fn(&PathResult) -> Option<f64>| {
        let mut errors: Vec<f64> = validation.paths.iter().filter_map(errors).collect();
        errors.sort_by(f64::total_cmp);
        let n = errors.len() as f64;
        let points = errors.iter().enumerate().map(|(i, &e)| (100.0 * (i as f64 + 1.0) / n, e)).collect();
        Line { name: name.into(), points }
    };
    let lateral_of = |source: Source| {
        move |p: &PathResult| {
            let found = p.sources.iter().find(|c| c.source == source)?;
            Some(found.lateral.largest_percent)
        }
    };
    let [alike, body] = [0, 1].map(|i| validation.sources.get(i).map(|s| (s.normal, s.lateral)));
    let differs = alike != body;
    let distribution = LineChart {
        title: format!("Largest error of a path ({} paths)", validation.paths.len()),
        x_label: "paths (%)".into(),
        y_label: "error (% of the path's largest force)".into(),
        lines: vec![
            shares("normal", &|p| Some(p.normal_error_percent)),
            shares("lateral", &|p| Some(p.lateral_error_percent)),
            shares("lateral, the place's own responses", &lateral_of(Source::Own)),
        ]
        .into_iter()
        .chain(differs.then(|| shares("lateral, alike in all directions", &lateral_of(Source::Isotropic))))
        .collect(),
        from_zero: true,
    };
    let mut order: Vec<&PathResult> = validation.paths.iter().collect();
    let worse = |p: &PathResult| p.normal_error_percent.max(p.lateral_error_percent);
    order.sort_by(|a, b| worse(a).total_cmp(&worse(b)));
    let chosen = [("median", order.get(order.len() / 2)), ("worst", order.last())];
    let charts = chosen.into_iter().filter_map(|(name, p)| Some(chart(name, p?)));
    std::iter::once(distribution).chain(charts).collect()
}

fn chart(name: &str, path: &PathResult) -> LineChart {
    let (u, d) = (DVec3::from_array(path.inward), DVec3::from_array(path.direction));
    let line = |name: &str, of: DVec3, force: &dyn Fn(&Compared) -> Option<DVec3>| {
        let point = |c: &Compared| Some(((c.depth_m + c.distance_m) * 1e3, force(c)?.dot(of)));
        let points = std::iter::once((0.0, 0.0)).chain(path.states.iter().filter_map(point)).collect();
        Line { name: name.into(), points }
    };
    LineChart {
        title: format!(
            "The path of {name} error: {:.2} mm deep, then {:.2} mm laterally",
            path.depth_m * 1e3,
            path.distance_m * 1e3
        ),
        x_label: "way (mm)".into(),
        y_label: "force (N)".into(),
        lines: vec![
            line("normal, simulated", u, &|c| Some(c.simulated_n)),
            line("normal, rendered", u, &|c| c.answers_n[1]),
            line("along the drag, simulated", d, &|c| Some(c.simulated_n)),
            line("along the drag, rendered", d, &|c| c.answers_n[1]),
        ],
        from_zero: true,
    }
}
