//! A validation as tables and CSV.

use super::errors::ascending;
use super::{Errors, Percentiles, Source, Spread, Validation};
use anyhow::Result;
use glam::DVec3;
use std::fmt::Write as _;
use std::io::Write;

/// What errors are a part of, and which states count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// All states of all paths, in % of each path's largest force.
    Largest,
    /// States whose force is above a tenth of the path's largest, in % of their own.
    Local,
    /// The largest error of each path, in % of its largest force.
    Paths,
}

impl Measure {
    /// All, the one that weighs all states first.
    pub const ALL: [Measure; 3] = [Measure::Largest, Measure::Local, Measure::Paths];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Measure::Largest => "errors at all states, in % of the path's largest force",
            Measure::Local => {
                "errors where the force is above a tenth of the largest, in % of the force there"
            }
            Measure::Paths => "largest error of each path, in % of its largest force",
        }
    }

    fn of(self, spread: &Spread) -> Percentiles {
        match self {
            Measure::Largest => spread.of_largest,
            Measure::Local => spread.of_local,
            Measure::Paths => spread.of_paths,
        }
    }

    fn cells(self, errors: &Errors) -> impl Iterator<Item = String> + use<> {
        let [n, t] = [errors.normal, errors.lateral].map(|spread| self.of(&spread));
        [n.median, n.p95, n.worst, t.median, t.p95, t.worst].into_iter().map(|x| format!("{x:.1}"))
    }
}

/// A table with its title.
pub type Table = (String, Vec<Vec<String>>);

impl Validation {
    /// All that is printed: sources by each [`Measure`], phases, size and angle, sustained sliding.
    pub fn tables(&self) -> Vec<Table> {
        let mut tables: Vec<Table> =
            Measure::ALL.map(|m| (m.words().to_owned(), self.table(m))).into_iter().collect();
        if self.phases.len() > 1 {
            tables.extend([Measure::Largest, Measure::Local].map(|m| {
                let title = format!("of the body, by phase: {}", m.words());
                let rows = self.phases.iter().map(|p| {
                    let count = if m == Measure::Local { p.errors.local_states } else { p.errors.states };
                    [p.phase.name().to_owned(), count.to_string()]
                        .into_iter()
                        .chain(m.cells(&p.errors))
                        .collect()
                });
                (title, headed(&["phase", "states"], &ERRORS, rows))
            }));
        }
        tables.push(("of the body: the force's size and angle".into(), self.sizes()));
        if let Some(s) = self.sliding {
            let row = |what: &str, p: Percentiles| {
                let values = [p.median, p.p95, p.worst].map(|x| format!("{x:.2}"));
                std::iter::once(what.to_owned()).chain(values).collect()
            };
            let rows = [
                row("the simulated pressures hold", s.pressures_hold),
                row("simulated lateral force", s.simulated),
                row("rendered lateral force", s.rendered),
            ];
            let title = format!("sustained sliding ({} states), in parts of μ f_z", s.states);
            tables.push((title, headed(&[""], &["median", "p95", "worst"], rows.into_iter())));
        }
        if let Some(s) = self.surface {
            let row = |what: &str, p: Percentiles| {
                let values = [p.median, p.p95, p.worst].map(|x| format!("{x:.1}"));
                std::iter::once(what.to_owned()).chain(values).collect()
            };
            let mut rows = vec![
                row("root mean square over what moves", s.rms_percent),
                row("the same near the contact", s.near_rms_percent),
                row("the tool shows through", s.show_through_percent),
                row("root mean square, all states, of the path's depth", s.rms_of_deepest_percent),
            ];
            rows.extend(self.dimple.map(|d| row("root mean square of a plain dimple", d.rms_percent)));
            let title = format!("deformed surface ({} states), in % of the depth there", s.states);
            tables.push((title, headed(&["error"], &["median", "p95", "worst"], rows.into_iter())));
        }
        tables
    }

    /// The body's normal and lateral errors at all states that count, in %, ascending. Not for
    /// [`Measure::Paths`], which has no states.
    pub fn state_errors(&self, measure: Measure) -> [Vec<f64>; 2] {
        let answers = self.paths.iter().filter_map(|p| Some((p, p.answer(Source::Body)?)));
        ascending(answers, measure == Measure::Local)
    }

    /// A row for each source.
    pub fn table(&self, measure: Measure) -> Vec<Vec<String>> {
        let rows = self
            .sources
            .iter()
            .map(|s| std::iter::once(s.source.words().to_owned()).chain(measure.cells(&s.errors)).collect());
        headed(&["force from"], &ERRORS, rows)
    }

    fn sizes(&self) -> Vec<Vec<String>> {
        let e = &self.summary;
        let row = |what: &str, p: Percentiles| {
            let values = [p.median, p.p95, p.worst].map(|x| format!("{x:.1}"));
            std::iter::once(what.to_owned()).chain(values).collect()
        };
        let rows = [
            row("size (% of the path's largest force)", e.size.of_largest),
            row("size (% of the force there)", e.size.of_local),
            row("angle (°)", e.angle_deg),
            row("lateral error (% of the normal force there)", e.lateral_of_normal),
        ];
        headed(&["error of"], &["median", "p95", "worst"], rows.into_iter())
    }

    /// All tables as Markdown.
    pub fn markdown(&self) -> String {
        let mut out = String::new();
        for (title, rows) in self.tables() {
            let _ = writeln!(out, "## {title}\n");
            for (i, row) in rows.iter().enumerate() {
                let _ = writeln!(out, "| {} |", row.join(" | "));
                if i == 0 {
                    let _ = writeln!(out, "|{}", "---|".repeat(row.len()));
                }
            }
            out.push('\n');
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
            "path,x_m,y_m,z_m,phase,offset_x_m,offset_y_m,offset_z_m,depth_m,distance_m,simulated_x_n,simulated_y_n,\
             simulated_z_n,rendered_x_n,rendered_y_n,rendered_z_n,pressed_n,slipping,patch_m2,friction,\
             inward_x,inward_y,inward_z"
        )?;
        for (i, path) in self.paths.iter().enumerate() {
            let ([x, y, z], u) = (path.point_m, DVec3::from_array(path.inward));
            let body = path.sources.first().map_or(&[][..], |body| &body.forces_n);
            for (c, r) in path.states.iter().zip(body) {
                let (s, o) = (c.simulated_n, c.offset_m);
                write!(out, "{i},{x:?},{y:?},{z:?},{},{:?},{:?},{:?},", c.phase().name(), o.x, o.y, o.z)?;
                write!(out, "{:?},{:?},", o.dot(u), o.reject_from(u).length())?;
                write!(out, "{:?},{:?},{:?},{:?},{:?},{:?},", s.x, s.y, s.z, r.x, r.y, r.z)?;
                write!(out, "{:?},{:?},{:?},{:?},", c.pressed_n, c.slipping, c.patch_m2, c.friction)?;
                writeln!(out, "{:?},{:?},{:?}", c.inward.x, c.inward.y, c.inward.z)?;
            }
        }
        Ok(())
    }
}

const ERRORS: [&str; 6] = ["normal: median", "p95", "worst", "lateral: median", "p95", "worst (%)"];

fn headed(first: &[&str], columns: &[&str], rows: impl Iterator<Item = Vec<String>>) -> Vec<Vec<String>> {
    let head = first.iter().chain(columns).map(|&h| h.to_owned()).collect();
    std::iter::once(head).chain(rows).collect()
}
