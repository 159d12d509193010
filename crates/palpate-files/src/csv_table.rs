//! Tables of numbers as text: columns by name in any order, `#` comments, every complaint with file and line.

use anyhow::{Result, anyhow, bail};
use std::path::Path;

/// A table that was read, with the line each row stood in.
#[derive(Debug)]
pub struct Table<'a> {
    path: &'a Path,
    /// Rows of the columns asked for, in the order asked.
    pub rows: Vec<Row>,
    /// Which of the optional columns are there; all or none.
    pub optional: bool,
}

/// One row.
#[derive(Debug)]
pub struct Row {
    /// Line in the file, from 1.
    pub line: usize,
    /// Values.
    pub values: Vec<f64>,
}

impl<'a> Table<'a> {
    /// Reads the columns `required`, then all or none of `optional`, from `text`. Other columns are ignored.
    ///
    /// # Errors
    /// No header or row, a column missing or given twice, a row too short or too long, a value that is no finite
    /// number.
    pub fn parse(path: &'a Path, text: &str, required: &[&str], optional: &[&str]) -> Result<Self> {
        let file = path.display();
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let lines = text.lines().enumerate().map(|(i, l)| (i + 1, l.trim()));
        let mut lines = lines.filter(|(_, l)| !l.is_empty() && !l.starts_with('#'));
        let Some((header_line, header)) = lines.next() else {
            bail!("{file}: it is empty; give a line of column names ({}) and rows", required.join(","));
        };
        let names: Vec<&str> = cells(header).collect();
        let find = |name: &str| names.iter().position(|n| *n == name);
        if let Some(twice) =
            required.iter().chain(optional).find(|n| names.iter().filter(|m| m == n).count() > 1)
        {
            bail!("{file}:{header_line}: column {twice} is there twice; remove or rename one");
        }
        let missing = |name: &str| {
            if names.len() == 1 && header.contains(';') {
                return anyhow!(
                    "{file}:{header_line}: column {name} is missing; separate columns by commas, not semicolons (and \
                     write decimal points)"
                );
            }
            anyhow!(
                "{file}:{header_line}: column {name} is missing among {}; name it in the first line, separated by \
                 commas",
                names.join(",")
            )
        };
        let mut columns: Vec<(&str, usize)> = Vec::new();
        for name in required {
            columns.push((name, find(name).ok_or_else(|| missing(name))?));
        }
        let has_optional = optional.iter().any(|n| find(n).is_some());
        for name in optional.iter().filter(|_| has_optional) {
            columns.push((name, find(name).ok_or_else(|| missing(name))?));
        }

        let mut rows = Vec::new();
        for (line, text) in lines {
            let fields: Vec<&str> = cells(text).collect();
            if fields.len() != names.len() {
                bail!(
                    "{file}:{line}: {} values for {} columns; give one for each (decimal points, not commas)",
                    fields.len(),
                    names.len()
                );
            }
            let values = columns.iter().map(|&(name, c)| {
                let field = fields.get(c).copied().unwrap_or_default();
                match field.parse::<f64>() {
                    Ok(v) if v.is_finite() => Ok(v),
                    _ => Err(anyhow!(
                        "{file}:{line}: {name} is `{}`; give a finite number",
                        field.escape_debug()
                    )),
                }
            });
            rows.push(Row { line, values: values.collect::<Result<_>>()? });
        }
        if rows.is_empty() {
            bail!("{file}: there is no row below the column names; give one at least");
        }
        Ok(Table { path, rows, optional: has_optional })
    }

    /// A complaint about a row.
    pub fn error(&self, row: &Row, problem: &str) -> anyhow::Error {
        anyhow!("{}:{}: {problem}", self.path.display(), row.line)
    }
}

fn cells(line: &str) -> impl Iterator<Item = &str> {
    line.split(',').map(|cell| {
        let cell = cell.trim();
        cell.strip_prefix('"').and_then(|c| c.strip_suffix('"')).unwrap_or(cell).trim()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name() {
        let text = "\u{feff}# a comment\n\"b\", c,a\r\n\n2,x,1\n# more\n4,y,3e-3\n";
        let table = Table::parse(Path::new("t.csv"), text, &["a", "b"], &["q"]).unwrap();
        assert!(!table.optional);
        let rows: Vec<_> = table.rows.iter().map(|r| (r.line, r.values.clone())).collect();
        assert_eq!(rows, [(4, vec![1.0, 2.0]), (6, vec![3e-3, 4.0])]);
    }

    #[test]
    fn complaints_name_the_line() {
        let message = |text: &str| {
            Table::parse(Path::new("t.csv"), text, &["a", "b"], &["q", "r"]).unwrap_err().to_string()
        };
        assert!(message("").starts_with("t.csv: it is empty"));
        assert!(message("a,b\n").contains("no row"));
        assert!(message("a\n1").starts_with("t.csv:1: column b is missing"));
        assert!(message("a,b,q\n1,2,3").contains("column r is missing"));
        assert!(message("a,b\n1,2\n#\n1,nan").starts_with("t.csv:4: b is `nan`"));
        assert!(message("a,b\n1,2,3").starts_with("t.csv:2: 3 values for 2 columns"));
        assert!(message("a,b,a\n1,2,3").contains("twice"));
    }
}
