//! TOML that users write: complaints with file, line, problem, hint.

use anyhow::{Result, anyhow};
use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};
use toml::Spanned;

/// A list of so many values, no fewer and no more.
#[derive(Clone, Copy, serde::Deserialize)]
#[serde(try_from = "Vec<T>", bound = "T: serde::Deserialize<'de>")]
pub struct List<const N: usize, T = f64>(pub [T; N]);

impl<const N: usize, T> TryFrom<Vec<T>> for List<N, T> {
    type Error = String;

    fn try_from(list: Vec<T>) -> std::result::Result<Self, String> {
        let count = list.len();
        list.try_into().map(List).map_err(|_| format!("invalid length {count}, expected {N}"))
    }
}

/// The text that spans point into.
pub struct Source<'a> {
    /// The file, as complaints name it.
    pub path: &'a Path,
    /// What is in it.
    pub text: &'a str,
}

impl Source<'_> {
    /// `file:line` of a span.
    pub fn place(&self, span: Range<usize>) -> String {
        let before = self.text.as_bytes().get(..span.start).unwrap_or_default();
        let line = 1 + before.iter().filter(|b| **b == b'\n').count();
        format!("{}:{line}", self.path.display())
    }

    /// Where `key` stands in the table at `table`, or else the table itself.
    pub fn find_key(&self, table: Range<usize>, key: &str) -> Range<usize> {
        let mut start = table.start;
        for (i, line) in self.text.get(table.start..).unwrap_or_default().split_inclusive('\n').enumerate() {
            if i > 0 && line.starts_with('[') {
                break;
            }
            if line.split('=').next().is_some_and(|name| name.trim() == key) {
                return start..start + line.len();
            }
            start += line.len();
        }
        table
    }

    /// A file that the text names, relative to its own folder.
    pub fn beside(&self, file: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(file)
    }

    /// A complaint about a value.
    pub fn error(&self, span: Range<usize>, problem: &str, hint: &str) -> anyhow::Error {
        anyhow!("{}: {problem}; {hint}", self.place(span))
    }

    /// The value, if it lies within `range`; a number that is none does not.
    pub fn within(&self, value: &Spanned<f64>, key: &str, range: RangeInclusive<f64>) -> Result<f64> {
        match *value.get_ref() {
            v if range.contains(&v) => Ok(v),
            v => Err(self.error(
                value.span(),
                &format!("{key} is {v}"),
                &format!("give a number between {} and {}", range.start(), range.end()),
            )),
        }
    }

    /// The parser's complaint, with a hint.
    pub fn syntax(&self, error: &toml::de::Error) -> anyhow::Error {
        let message = error.message().lines().map(str::trim).collect::<Vec<_>>().join(", ");
        let hint = if message.starts_with("unknown field") {
            "correct the key's spelling and unit, or remove it"
        } else if message.starts_with("missing field") {
            "add it to this table"
        } else if message.starts_with("invalid type")
            || message.starts_with("invalid length")
            || message.starts_with("unknown variant")
        {
            "give a value of the kind that is expected"
        } else {
            "correct the TOML there"
        };
        match error.span() {
            Some(span) => self.error(span, &message, hint),
            None => anyhow!("{}: {message}; {hint}", self.path.display()),
        }
    }
}
