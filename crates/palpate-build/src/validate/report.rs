//! A validation as tables and CSV.

use super::Validation;
use anyhow::Result;
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
