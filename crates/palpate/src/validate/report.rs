//! A validation as tables, charts and CSV.

use super::{Compared, PathResult, Source, Validation};
use crate::plot::{Line, LineChart};
use anyhow::Result;
use glam::DVec3;
use std::fmt::Write as _;
use std::io::Write;

/// What a median and a percentile are taken over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// The errors at all states of all paths.
    States,
    /// The largest error of each path.
    Paths,
}

impl Measure {
    /// Both, the milder one first.
    pub const ALL: [Measure; 2] = [Measure::States, Measure::Paths];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Measure::States => "errors at all states, in % of the path's largest force",
            Measure::Paths => "largest error of each path, in % of its largest force",
        }
    }
}

impl Validation {
    /// A table for each [`Measure`]: a row for each source, in % of the paths' largest forces.
    pub fn table(&self, measure: Measure) -> Vec<Vec<String>> {
        let head = ["force from", "normal: median", "p95", "worst", "lateral: median", "p95", "worst (%)"];
        let rows = self.sources.iter().filter(|s| s.paths > 0).map(|s| {
            let errors = [s.normal, s.lateral].map(|s| match measure {
                Measure::States => [s.states.median_percent, s.states.p95_percent, s.worst_percent],
                Measure::Paths => [s.median_percent, s.p95_percent, s.worst_percent],
            });
            let mut row = vec![s.source.words().to_owned()];
            row.extend(errors.as_flattened().iter().map(|x| format!("{x:.1}")));
            row
        });
        std::iter::once(head.map(str::to_owned).to_vec()).chain(rows).collect()
    }

    /// The same as Markdown.
    pub fn markdown(&self, measure: Measure) -> String {
        let mut out = String::new();
        for (i, row) in self.table(measure).iter().enumerate() {
            let _ = writeln!(out, "| {} |", row.join(" | "));
            if i == 0 {
                let _ = writeln!(out, "|{}", "---|".repeat(row.len()));
            }
        }
        out
    }

    /// How the errors are distributed, and the paths of median and worst error, simulated and rendered.
    pub fn charts(&self) -> Vec<LineChart> {
        let shares = |name: &str, errors: &dyn Fn(&PathResult) -> Option<f64>| {
            let mut errors: Vec<f64> = self.paths.iter().filter_map(errors).collect();
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
        let [alike, body] = [0, 1].map(|i| self.sources.get(i).map(|s| (s.normal, s.lateral)));
        let differs = alike != body;
        let distribution = LineChart {
            title: format!("Largest error of a path ({} paths)", self.paths.len()),
            x_label: "paths (%)".into(),
            y_label: "error (% of the path's largest force)".into(),
            lines: vec![
                shares("normal", &|p| Some(p.normal_error_percent)),
                shares("lateral", &|p| Some(p.lateral_error_percent)),
                shares("lateral, the place's own responses", &lateral_of(Source::Own)),
            ]
            .into_iter()
            .chain(
                differs.then(|| shares("lateral, alike in all directions", &lateral_of(Source::Isotropic))),
            )
            .collect(),
            from_zero: true,
        };
        let mut order: Vec<&PathResult> = self.paths.iter().collect();
        let worse = |p: &PathResult| p.normal_error_percent.max(p.lateral_error_percent);
        order.sort_by(|a, b| worse(a).total_cmp(&worse(b)));
        let chosen = [("median", order.get(order.len() / 2)), ("worst", order.last())];
        let charts = chosen.into_iter().filter_map(|(name, p)| Some(self.chart(name, p?)));
        std::iter::once(distribution).chain(charts).collect()
    }

    fn chart(&self, name: &str, path: &PathResult) -> LineChart {
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

    /// Writes every state of every path as CSV.
    ///
    /// # Errors
    /// `out` can't be written.
    pub fn csv(&self, out: &mut dyn Write) -> Result<()> {
        writeln!(
            out,
            "path,x_m,y_m,z_m,depth_m,distance_m,simulated_x_n,simulated_y_n,simulated_z_n,rendered_x_n,\
             rendered_y_n,rendered_z_n"
        )?;
        for (i, path) in self.paths.iter().enumerate() {
            let [x, y, z] = path.point_m;
            for c in &path.states {
                let [s, r] = [c.simulated_n, c.answers_n[1].unwrap_or_default()];
                write!(out, "{i},{x:?},{y:?},{z:?},{:?},{:?},", c.depth_m, c.distance_m)?;
                writeln!(out, "{:?},{:?},{:?},{:?},{:?},{:?}", s.x, s.y, s.z, r.x, r.y, r.z)?;
            }
        }
        Ok(())
    }
}
