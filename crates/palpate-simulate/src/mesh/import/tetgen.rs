//! TetGen's .node and .ele: linear, or with ten nodes (`-o2`).
//!
//! The format is that of the TetGen manual (WIAS Technical Report 13, 2013, section 5.2): nodes and elements are
//! numbered one after another from 0 or 1, `#` begins a comment.

use super::content::{Content, NO_REGION};
use crate::error::{Result, SimulateError};
use palpate_body::import::cursor::{Cursor, number, short, truncated};

/// The edges of TetGen's nodes 4 to 9 are 23, 03, 01, 12, 13, 02, which its manual only shows as a figure: this is what
/// versions 1.5.0 and 1.6 write. Where each of ours is among its ten.
const FROM_TETGEN: [usize; 10] = [0, 1, 2, 3, 6, 7, 9, 5, 8, 4];

/// Lines with their numbers, without comments and empty ones.
struct Lines<'a> {
    cursor: Cursor<'a>,
    /// Of the row.
    line: usize,
    row: Vec<f64>,
}

impl<'a> Lines<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Lines { cursor: Cursor::new(bytes), line: 1, row: Vec::new() }
    }

    fn place(&self) -> String {
        format!("line {}", self.line)
    }

    /// Reads the next row, which must have as many numbers.
    fn next(&mut self, at_least: usize, what: &str) -> Result<()> {
        self.row.clear();
        while self.row.is_empty() {
            self.line = self.cursor.line();
            let Some(line) = self.cursor.next_line() else {
                return Err(truncated(self.place(), what).into());
            };
            let line = line.split(|&b| b == b'#').next().unwrap_or_default();
            for word in line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()) {
                self.row.push(number(word, || format!("line {}", self.line))?);
            }
        }
        if self.row.len() < at_least {
            let problem = format!("{} numbers, but {what} has {at_least}", self.row.len());
            return Err(SimulateError::invalid(
                self.place(),
                problem,
                "correct the line, or run TetGen again",
            ));
        }
        Ok(())
    }

    /// One of the heading's numbers.
    fn heading(&self, i: usize, what: &str) -> Result<usize> {
        // An absent one is 0, and every entry takes a byte at least.
        let value = self.row.get(i).copied().unwrap_or(0.0);
        if value >= 0.0 && value == value.trunc() && value <= self.cursor.rest().len() as f64 {
            return Ok(value as usize);
        }
        let problem = format!("{} {what} are announced, which the file can't hold", short(value));
        Err(SimulateError::invalid(self.place(), problem, "correct the heading, or run TetGen again"))
    }
}

/// The file's nodes, and the number of the first.
pub(super) fn nodes(bytes: &[u8]) -> Result<(Content, usize)> {
    let mut lines = Lines::new(bytes);
    lines.next(1, "the heading")?;
    let count = lines.heading(0, "nodes")?;
    if let Some(&dimension) = lines.row.get(1)
        && dimension != 3.0
    {
        let problem = format!("nodes of dimension {}, but 3 are needed", short(dimension));
        return Err(SimulateError::invalid(
            lines.place(),
            problem,
            "give a mesh of TetGen's, not of Triangle's",
        ));
    }
    let (attributes, marks) = (lines.heading(2, "attributes")?, lines.heading(3, "marks")?);
    let (mut content, mut first) = (Content::default(), 0);
    for n in 0..count {
        lines.next(4 + attributes + marks.min(1), "a node")?;
        let place = || lines.place();
        if n == 0 {
            first = first_number(lines.row[0], "node", place)?;
        }
        in_turn(lines.row[0], first + n, "node", place)?;
        content.node([lines.row[1], lines.row[2], lines.row[3]], place)?;
        let mark = if marks > 0 { lines.row[4 + attributes] } else { 0.0 };
        if mark != 0.0 {
            content.marks.entry(short(mark)).or_default().push(n as u32);
        }
    }
    Ok((content, first))
}

/// The tetrahedra on these nodes.
pub(super) fn elements(bytes: &[u8], (mut content, first_node): (Content, usize)) -> Result<Content> {
    let mut lines = Lines::new(bytes);
    lines.next(1, "the heading")?;
    let count = lines.heading(0, "elements")?;
    let size = lines.row.get(1).copied().unwrap_or(4.0);
    if size != 4.0 && size != 10.0 {
        let problem = format!("elements of {} nodes, but 4 or 10 are read", short(size));
        return Err(SimulateError::invalid(
            lines.place(),
            problem,
            "run TetGen again, for 10 nodes with -o2",
        ));
    }
    let (size, attributes) = (size as usize, lines.heading(2, "attributes")?);
    let mut first = 0;
    for e in 0..count {
        lines.next(1 + size + attributes, "an element")?;
        let place = || lines.place();
        if e == 0 {
            first = first_number(lines.row[0], "element", place)?;
        }
        in_turn(lines.row[0], first + e, "element", place)?;
        let mut nodes = [0; 10];
        for (node, &value) in nodes.iter_mut().zip(&lines.row[1..=size]) {
            let last = first_node + content.positions.len();
            if !(value >= first_node as f64 && value < last as f64 && value == value.trunc()) {
                let problem = format!(
                    "there is no node {}; they run from {first_node} to {}",
                    short(value),
                    last.max(1) - 1
                );
                return Err(SimulateError::invalid(place(), problem, "give the .node file of the same run"));
            }
            *node = (value as usize - first_node) as u32;
        }
        let region = if attributes > 0 { lines.row[1 + size] } else { NO_REGION };
        if attributes > 0 && !region.is_finite() {
            let problem = format!("the region is {region}, not a finite number");
            return Err(SimulateError::invalid(place(), problem, "correct it, or run TetGen again"));
        }
        let nodes = if size == 4 { nodes } else { FROM_TETGEN.map(|i| nodes[i]) };
        content.tetrahedron(&nodes[..size], region, place)?;
    }
    Ok(content)
}

fn first_number(value: f64, what: &str, place: impl Fn() -> String) -> Result<usize> {
    if value == 0.0 || value == 1.0 {
        return Ok(value as usize);
    }
    let problem = format!("the first {what} has the number {}, but 0 or 1 is expected", short(value));
    Err(SimulateError::invalid(place(), problem, "run TetGen again"))
}

fn in_turn(value: f64, expected: usize, what: &str, place: impl Fn() -> String) -> Result<()> {
    if value == expected as f64 {
        return Ok(());
    }
    let problem = format!("{what} {} stands where {what} {expected} is expected", short(value));
    Err(SimulateError::invalid(place(), problem, "put them in order, or run TetGen again"))
}
