//! Rows of a samples file.

use crate::error::FitError;
use csv::StringRecord;
use std::collections::HashMap;
use std::path::Path;

/// What a sample is a sample of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Component {
    /// Force f^z against depth δz, N.
    Normal,
    /// Force f^r against lateral deflection δr, N.
    Lateral,
    /// Friction coefficient μ against depth δz.
    Friction,
}

impl std::fmt::Display for Component {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Component::Normal => "normal",
            Component::Lateral => "lateral",
            Component::Friction => "friction",
        })
    }
}

/// One measured row.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Which point of the surface: rows of one point share its name.
    pub point: String,
    /// Where that point is, m in the body's frame.
    pub position_m: [f64; 3],
    /// What was measured.
    pub component: Component,
    /// δz or δr, m.
    pub deflection_m: f64,
    /// N, or no unit for friction.
    pub value: f64,
    /// Direction of a lateral deflection in the body's frame, of any length.
    pub direction: Option<[f64; 3]>,
    /// Trust relative to other rows; 0 leaves the row out.
    pub weight: Option<f64>,
    /// Line in the file, from 1.
    pub line: u64,
}

const NEEDED: [&str; 7] = ["point", "x_m", "y_m", "z_m", "component", "deflection_m", "value"];
const DIRECTION: [&str; 3] = ["direction_x", "direction_y", "direction_z"];

/// Reads samples: CSV with the columns `point,x_m,y_m,z_m,component,deflection_m,value` in any order, and optionally
/// `direction_x,direction_y,direction_z` and `weight`, whose cells may be empty. Other columns are ignored, lines
/// that start with `#` are comments.
///
/// # Errors
/// The file can't be read, a column is missing, or a cell does not hold what it should. The message names the line.
pub fn read_samples(path: &Path) -> Result<Vec<Sample>, FitError> {
    let bytes =
        std::fs::read(path).map_err(|source| FitError::Io { file: path.display().to_string(), source })?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let valid = e.as_bytes().iter().take(e.utf8_error().valid_up_to());
        let line = 1 + valid.filter(|b| **b == b'\n').count();
        FitError::invalid(format!("line {line}"), "it is not UTF-8 text", "save it as plain text")
            .in_file(path)
    });
    parse(&text?).map_err(|e| e.in_file(path))
}

fn parse(text: &str) -> Result<Vec<Sample>, FitError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .flexible(true)
        .from_reader(text.as_bytes());
    let broken = |e: csv::Error| FitError::invalid("table", e.to_string(), "correct the file");
    let header = reader.headers().map_err(broken)?.clone();
    let columns: HashMap<&str, usize> = header.iter().enumerate().map(|(i, name)| (name, i)).collect();
    if let Some(missing) = NEEDED.iter().find(|name| !columns.contains_key(*name)) {
        return Err(FitError::invalid(
            "header",
            format!("there is no column `{missing}`"),
            if header.len() == 1 && header[0].contains(';') {
                "separate columns by commas, not semicolons (and write decimal points)".into()
            } else {
                format!("the first line names the columns {}", NEEDED.join(","))
            },
        ));
    }
    if DIRECTION.iter().filter(|name| columns.contains_key(*name)).count() % 3 != 0 {
        let hint = format!("give all of {}, or none", DIRECTION.join(", "));
        return Err(FitError::invalid("header", "a direction lacks a column", hint));
    }

    let mut samples = Vec::new();
    for record in reader.records() {
        let record = record.map_err(broken)?;
        let line = record.position().map_or(0, |at| at.line() + skipped(text, at.byte()));
        let row = Row { columns: &columns, record, line };
        if row.record.len() != header.len() {
            let problem = format!("{} cells under {} columns", row.record.len(), header.len());
            return Err(FitError::invalid(row.place(), problem, "give one cell for each column"));
        }
        samples.push(row.sample()?);
    }
    if samples.is_empty() {
        return Err(FitError::invalid(
            "table",
            "it has no rows",
            "give at least one normal and one lateral sample",
        ));
    }
    Ok(samples)
}

/// The reader's position of a record is where it began to look for it: comments and empty lines come in between.
fn skipped(text: &str, start: u64) -> u64 {
    let rest = text.get(start as usize..).unwrap_or_default();
    rest.lines().take_while(|line| line.is_empty() || line.starts_with('#')).count() as u64
}

struct Row<'a> {
    columns: &'a HashMap<&'a str, usize>,
    record: StringRecord,
    line: u64,
}

impl Row<'_> {
    fn place(&self) -> String {
        format!("line {}", self.line)
    }

    fn cell(&self, name: &str) -> &str {
        self.columns.get(name).and_then(|&i| self.record.get(i)).unwrap_or_default()
    }

    fn number(&self, name: &str) -> Result<f64, FitError> {
        let cell = self.cell(name);
        cell.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| {
            let place = format!("{}, column `{name}`", self.place());
            FitError::invalid(
                place,
                format!("`{cell}` is NaN or infinite"),
                "write it in SI units, like 0.003 or 3e-3",
            )
        })
    }

    fn sample(&self) -> Result<Sample, FitError> {
        let point = self.cell("point").to_string();
        if point.is_empty() {
            let place = format!("{}, column `point`", self.place());
            return Err(FitError::invalid(place, "the point has no name", "name each point"));
        }
        let component = match self.cell("component") {
            "normal" => Component::Normal,
            "lateral" => Component::Lateral,
            "friction" => Component::Friction,
            other => {
                let place = format!("{}, column `component`", self.place());
                let problem = format!("`{other}` is no component");
                return Err(FitError::invalid(place, problem, "write normal, lateral or friction"));
            }
        };
        let has = |name: &str| !self.cell(name).is_empty();
        let direction = if DIRECTION.iter().any(|name| has(name)) {
            let d = [self.number(DIRECTION[0])?, self.number(DIRECTION[1])?, self.number(DIRECTION[2])?];
            if d == [0.0; 3] {
                let place = format!("{}, column `direction_x`", self.place());
                return Err(FitError::invalid(
                    place,
                    "the direction is zero",
                    "give a vector, or leave it empty",
                ));
            }
            Some(d)
        } else {
            None
        };
        let weight = if has("weight") { Some(self.number("weight")?) } else { None };
        if weight.is_some_and(|w| w < 0.0) {
            let place = format!("{}, column `weight`", self.place());
            return Err(FitError::invalid(place, "the weight is negative", "give a weight of 0 or more"));
        }
        Ok(Sample {
            position_m: [self.number("x_m")?, self.number("y_m")?, self.number("z_m")?],
            deflection_m: self.number("deflection_m")?,
            value: self.number("value")?,
            point,
            component,
            direction,
            weight,
            line: self.line,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "point,x_m,y_m,z_m,component,deflection_m,value";

    #[test]
    fn columns_go_by_name() {
        let text = "\u{feff}# measured on Tuesday\nvalue, point ,note,x_m,y_m,z_m,component,deflection_m,direction_x,\
                    direction_y,direction_z,weight\n\n0.5,a,\"two\nlines\",0.01,0,-2e-3,normal,1e-3,,,,\n# pause\n\
                    1,b,,1,2,3,lateral,0.002,0,1,0,0.5\n";
        let samples = parse(text).unwrap();
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[0].position_m, [0.01, 0.0, -2e-3]);
        assert_eq!(
            (samples[0].component, samples[0].value, samples[0].direction),
            (Component::Normal, 0.5, None)
        );
        assert_eq!((samples[0].line, samples[1].line), (4, 7));
        assert_eq!((samples[1].direction, samples[1].weight), (Some([0.0, 1.0, 0.0]), Some(0.5)));
    }

    #[test]
    fn messages_name_the_line_and_the_hint() {
        let refused = |text: &str, words: &[&str]| {
            let message = parse(text).unwrap_err().to_string();
            assert!(words.iter().all(|w| message.contains(w)), "{message}");
            assert!(!message.contains('\n'), "{message}");
        };
        let row = |row: &str, words: &[&str]| refused(&format!("# comment\n{HEADER}\n# c\n{row}\n"), words);
        row("a,0,0,zero,normal,1e-3,1", &["line 4, column `z_m`", "`zero` is NaN or infinite"]);
        row("a,0,0,0,normal,NaN,1", &["line 4, column `deflection_m`", "`NaN`", "SI units"]);
        row("a,0,0,0,normal,1e-3,", &["line 4, column `value`"]);
        row("a,0,0,0,normaal,1e-3,1", &["line 4", "`normaal`", "normal, lateral or friction"]);
        row(",0,0,0,normal,1e-3,1", &["line 4, column `point`", "no name"]);
        row("a,0,0,0,normal,1e-3", &["line 4", "6 cells under 7 columns"]);
        refused(HEADER, &["no rows"]);
        refused("", &["header", "`point`"]);
        refused("point,x,y,z,component,deflection_m,value\n", &["no column `x_m`", "point,x_m"]);
        refused(&format!("{HEADER},direction_x\n"), &["direction lacks a column"]);
        let wide = format!("{HEADER},direction_x,direction_y,direction_z,weight\n");
        refused(&format!("{wide}a,0,0,0,lateral,1,1,0,0,0,\n"), &["line 2", "direction is zero"]);
        refused(&format!("{wide}a,0,0,0,lateral,1,1,0,1,,\n"), &["line 2, column `direction_z`"]);
        refused(&format!("{wide}a,0,0,0,lateral,1,1,,,,-1\n"), &["line 2, column `weight`"]);
    }

    #[test]
    fn the_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        let message = read_samples(&path).unwrap_err().to_string();
        assert!(message.contains("rows.csv") && message.contains("check that"), "{message}");
        std::fs::write(&path, "point\n").unwrap();
        let message = read_samples(&path).unwrap_err().to_string();
        assert!(message.contains("rows.csv: header: there is no column"), "{message}");
    }
}
