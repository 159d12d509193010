//! Gmsh's MSH 2.2 and 4.1, text and binary.
//!
//! After the Gmsh reference manual, sections "MSH file format" and "MSH file format version 2 (Legacy)".

use super::content::{Content, NO_REGION};
use crate::error::{Result, SimulateError};
use palpate_body::import::cursor::{Cursor, Scalar, number, quote, short, truncated};
use std::collections::HashMap;

const AGAIN: &str = "export the mesh again";

/// Where each of our ten nodes is among Gmsh's: it has the edges 23 and 13 the other way round.
const FROM_GMSH: [usize; 10] = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8];

pub(super) fn parse(bytes: &[u8]) -> Result<Content> {
    let mut file = File {
        cursor: Cursor::new(bytes),
        length: bytes.len(),
        line: 1,
        version: None,
        binary: false,
        big_endian: false,
        size: Scalar::U64,
        row: Vec::new(),
        tags: Tags { dense: Vec::new(), sparse: HashMap::new(), dense_below: bytes.len() / 8 },
        entities: HashMap::new(),
        content: Content::default(),
    };
    file.read()?;
    Ok(file.content)
}

/// Where something was read: of a binary file where it ends.
#[derive(Clone, Copy)]
enum Place {
    Line(usize),
    Byte(usize),
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Version {
    Two,
    Four,
}

struct File<'a> {
    cursor: Cursor<'a>,
    /// Of the file, bytes.
    length: usize,
    /// Of the row.
    line: usize,
    version: Option<Version>,
    binary: bool,
    big_endian: bool,
    /// Of tags and counts in binary files of version 4.
    size: Scalar,
    /// The numbers read last.
    row: Vec<f64>,
    tags: Tags,
    /// Physical numbers of each entity, by its dimension and number.
    entities: HashMap<(u8, i64), Vec<f64>>,
    content: Content,
}

impl File<'_> {
    fn read(&mut self) -> Result<()> {
        let (mut nodes, mut elements) = (false, false);
        while let Some(word) = self.cursor.word() {
            let place = self.cursor.place();
            let version = self.version;
            // Binary numbers begin with the next line.
            self.cursor.next_line();
            let no_format = || {
                let problem = format!("{} where `$MeshFormat` is expected", quote(word));
                SimulateError::invalid(
                    place.clone(),
                    problem,
                    "save the mesh as .msh, or with the right extension",
                )
            };
            match (word, version) {
                (b"$NOD" | b"$ELM", None) => {
                    return Err(SimulateError::invalid(
                        place,
                        format!("{} begins the old MSH 1 format, which is not read", quote(word)),
                        "convert it: gmsh OLD.msh -save -format msh41 -o NEW.msh",
                    ));
                }
                (b"$MeshFormat", None) => self.format()?,
                (b"$Comments", None) => {}
                (_, None) => return Err(no_format()),
                (b"$PhysicalNames", _) => self.physical_names()?,
                (b"$Entities", Some(Version::Four)) => self.entities()?,
                (b"$PartitionedEntities", _) => {
                    return Err(SimulateError::invalid(
                        place,
                        "the mesh is partitioned",
                        "put it together: gmsh PARTS.msh -save -format msh22 -o WHOLE.msh",
                    ));
                }
                (b"$Nodes" | b"$Elements", _) if elements || nodes && word == b"$Nodes" => {
                    let problem = format!("a second section {}", quote(word));
                    return Err(SimulateError::invalid(place, problem, AGAIN));
                }
                (b"$Nodes", Some(version)) => {
                    nodes = true;
                    match version {
                        Version::Two => self.nodes_2()?,
                        Version::Four => self.nodes_4()?,
                    }
                }
                (b"$Elements", Some(_)) if !nodes => {
                    let problem = "the elements stand before the nodes";
                    return Err(SimulateError::invalid(place, problem, "put `$Nodes` first"));
                }
                (b"$Elements", Some(version)) => {
                    elements = true;
                    match version {
                        Version::Two => self.elements_2()?,
                        Version::Four => self.elements_4()?,
                    }
                }
                _ if word.starts_with(b"$") && !word.starts_with(b"$End") => {}
                _ => {
                    let problem = format!("{} where a section is expected", quote(word));
                    return Err(SimulateError::invalid(place, problem, AGAIN));
                }
            }
            self.end(&word[1..])?;
        }
        let missing = if self.version.is_none() {
            "`$MeshFormat`"
        } else if !nodes {
            "`$Nodes`"
        } else {
            "`$Elements`"
        };
        if !elements {
            return Err(truncated(self.cursor.place(), &format!("{missing} begins")).into());
        }
        Ok(())
    }

    /// Goes on to behind `$End...` of a section; one that was read must be at its end.
    fn end(&mut self, name: &[u8]) -> Result<()> {
        let wanted = [b"$End", name].concat();
        let read = [&b"MeshFormat"[..], b"PhysicalNames", b"Entities", b"Nodes", b"Elements"].contains(&name);
        if read {
            let place = self.place();
            let word = self.cursor.word();
            let place = if self.binary { place } else { self.cursor.place() };
            return match word {
                Some(word) if word == wanted => Ok(()),
                Some(word) => {
                    let problem = format!("{} where {} is expected", quote(word), quote(&wanted));
                    Err(SimulateError::invalid(place, problem, AGAIN))
                }
                None => Err(truncated(place, &quote(&wanted)).into()),
            };
        }
        if self.binary {
            let length = self.cursor.rest().windows(wanted.len()).position(|w| w == wanted);
            let length = length.ok_or_else(|| truncated(self.place(), &quote(&wanted)))?;
            self.cursor.take(length + wanted.len(), "its end")?;
            return Ok(());
        }
        let place = self.place();
        while let Some(line) = self.cursor.next_line() {
            if line.trim_ascii() == wanted {
                return Ok(());
            }
        }
        Err(truncated(place, &quote(&wanted)).into())
    }

    fn place(&self) -> String {
        if self.binary { self.cursor.byte_place() } else { self.cursor.place() }
    }

    /// Of the row. Not yet text: there is one for every element.
    fn row_at(&self) -> Place {
        if self.binary { Place::Byte(self.length - self.cursor.rest().len()) } else { Place::Line(self.line) }
    }

    fn row_place(&self) -> String {
        self.row_at().to_string()
    }

    fn format(&mut self) -> Result<()> {
        self.text_row("the format")?;
        let place = self.row_place();
        let &[version, kind, size, ..] = self.row.as_slice() else {
            let problem = "version, kind and size are expected, three numbers";
            return Err(SimulateError::invalid(place, problem, AGAIN));
        };
        self.version = Some(match version {
            2.0..=2.2 => Version::Two,
            4.1 => Version::Four,
            _ => {
                let problem = format!("MSH version {} is not read", short(version));
                let hint = "convert it: gmsh OLD.msh -save -format msh41 -o NEW.msh";
                return Err(SimulateError::invalid(place, problem, hint));
            }
        });
        if kind != 0.0 && kind != 1.0 || size != 4.0 && size != 8.0 {
            let problem = format!(
                "kind {} and size {}, but kind 0 or 1 and size 8 are expected",
                short(kind),
                short(size)
            );
            return Err(SimulateError::invalid(place, problem, AGAIN));
        }
        if kind == 1.0 {
            self.binary = true;
            self.size = if size == 8.0 { Scalar::U64 } else { Scalar::U32 };
            self.big_endian = match self.cursor.take(4, "the number 1 that tells the order of bytes")? {
                [1, 0, 0, 0] => false,
                [0, 0, 0, 1] => true,
                other => {
                    let problem = format!("the bytes {other:?} are no 1 in either order");
                    let hint = "copy the file in binary mode, or save the mesh as text (without gmsh -bin)";
                    return Err(SimulateError::invalid(self.place(), problem, hint));
                }
            };
        }
        Ok(())
    }

    fn physical_names(&mut self) -> Result<()> {
        let count = self.text_count("names")?;
        for _ in 0..count {
            let (mut line, mut at) = (&b""[..], 0);
            while line.is_empty() {
                at = self.cursor.line();
                let next = self.cursor.next_line();
                line = next
                    .ok_or_else(|| truncated(format!("line {at}"), "the last of the names"))?
                    .trim_ascii();
            }
            let place = || format!("line {at}");
            let mut quotes = line.splitn(2, |&b| b == b'"');
            let mut head = Cursor::new(quotes.next().unwrap_or_default());
            let name = quotes.next().and_then(|n| n.strip_suffix(b"\""));
            let (dimension, tag) = (head.word(), head.word());
            let (Some(dimension), Some(tag), Some(name)) = (dimension, tag, name) else {
                let problem = format!("{} is no dimension, number, and name in quotes", quote(line));
                return Err(SimulateError::invalid(place(), problem, "correct the line"));
            };
            let (dimension, tag) = (number(dimension, place)?, number(tag, place)?);
            let text = std::str::from_utf8(name).ok().filter(|n| !n.contains(char::is_control));
            let Some(name) = text else {
                let problem = format!("the name {} is no plain text in UTF-8", quote(name));
                return Err(SimulateError::invalid(place(), problem, "rename the group"));
            };
            // A name of another dimension is never asked for.
            self.content.names.insert((dimension as u8, tag.abs() as u64), name.to_string());
        }
        Ok(())
    }

    fn entities(&mut self) -> Result<()> {
        let mut counts = [0; 4];
        for count in &mut counts {
            *count = self.count("entities")?;
        }
        for (dimension, count) in (0..).zip(counts) {
            for _ in 0..count {
                let tag = self.integer(Scalar::I32, "an entity's number")?;
                for _ in 0..if dimension == 0 { 3 } else { 6 } {
                    self.next(Scalar::F64, "an entity's bounds")?;
                }
                let mut physical = Vec::new();
                for _ in 0..self.count("physical groups")? {
                    // A minus tells of orientation.
                    physical.push(self.integer(Scalar::I32, "an entity's physical groups")?.abs() as f64);
                }
                if dimension > 0 {
                    for _ in 0..self.count("entities on the border")? {
                        self.next(Scalar::I32, "an entity's border")?;
                    }
                }
                if dimension == 3 && physical.len() > 1 {
                    let names = physical.iter().take(3).map(|&p| self.content.name(3, p));
                    let names: Vec<String> = names.map(|n| quote(n.as_bytes())).collect();
                    let (count, names) = (physical.len(), names.join(", "));
                    let problem = format!("a volume belongs to {count} physical groups: {names}");
                    let hint = "leave it in one: each element has one material";
                    return Err(SimulateError::invalid(self.place(), problem, hint));
                }
                self.entities.insert((dimension, tag), physical);
            }
        }
        Ok(())
    }

    fn nodes_2(&mut self) -> Result<()> {
        for _ in 0..self.text_count("nodes")? {
            self.row(
                &[Scalar::I32, Scalar::F64, Scalar::F64, Scalar::F64],
                "a node's number and coordinates",
            )?;
            self.node(self.row[0], [self.row[1], self.row[2], self.row[3]])?;
        }
        Ok(())
    }

    fn nodes_4(&mut self) -> Result<()> {
        let heading = [self.size; 4];
        self.row(&heading, "the nodes' heading")?;
        let (blocks, announced) = (self.bounded(self.row[0], "blocks")?, self.bounded(self.row[1], "nodes")?);
        let (mut tags, place) = (Vec::new(), self.row_place());
        for _ in 0..blocks {
            self.row(&[Scalar::I32, Scalar::I32, Scalar::I32, self.size], "a block's heading")?;
            let (dimension, parametric) = (self.row[0], self.row[2] != 0.0);
            let count = self.bounded(self.row[3], "nodes")?;
            if !(0.0..=3.0).contains(&dimension) {
                return Err(self.bad_dimension(dimension));
            }
            tags.clear();
            for _ in 0..count {
                tags.push(self.next(self.size, "a node's number")?);
            }
            // A block of text may end behind its last number.
            let row = [Scalar::F64; 6];
            let row = &row[..3 + if parametric { dimension as usize } else { 0 }];
            for &tag in &tags {
                self.row(row, "a node's coordinates")?;
                self.node(tag, [self.row[0], self.row[1], self.row[2]])?;
            }
        }
        self.as_announced(place, announced, self.content.positions.len(), "nodes")
    }

    fn node(&mut self, tag: f64, p: [f64; 3]) -> Result<()> {
        let place = self.row_at();
        let number = self.content.positions.len() as u32;
        if !(tag >= 0.0 && tag < 2f64.powi(53) && tag == tag.trunc()) {
            return Err(SimulateError::invalid(
                place.to_string(),
                format!("{} is no node number", short(tag)),
                AGAIN,
            ));
        }
        if !self.tags.insert(tag as u64, number) {
            return Err(SimulateError::invalid(
                place.to_string(),
                format!("node {tag} is there twice"),
                "remove one of the two",
            ));
        }
        self.content.node(p, || place.to_string())
    }

    fn elements_2(&mut self) -> Result<()> {
        let count = self.text_count("elements")?;
        let place = self.row_place();
        if !self.binary {
            for _ in 0..count {
                self.text_row("the last of the elements")?;
                let &[_, kind, tags, ref rest @ ..] = self.row.as_slice() else {
                    return Err(self.bad_row("an element", 3));
                };
                let kind = self.kind(kind)?;
                // Anything that is no count becomes one that doesn't fit.
                let tags = if tags >= 0.0 && tags == tags.trunc() { tags.min(1e6) as usize } else { 0 };
                if rest.len() != tags + kind.nodes {
                    return Err(self.bad_row("an element with its tags and nodes", 3 + tags + kind.nodes));
                }
                self.element_2(kind, 3, tags)?;
            }
            return Ok(());
        }
        let mut found = 0;
        while found < count {
            self.row(&[Scalar::I32; 3], "a block's heading")?;
            let &[kind, block, tags] = self.row.as_slice() else { return Err(self.bad_row("a heading", 3)) };
            let (kind, block, tags) =
                (self.kind(kind)?, self.bounded(block, "elements")?, self.bounded(tags, "tags")?);
            if block == 0 {
                return Err(SimulateError::invalid(self.row_place(), "a block without elements", AGAIN));
            }
            let row = vec![Scalar::I32; 1 + tags + kind.nodes];
            for _ in 0..block {
                self.row(&row, "an element")?;
                self.element_2(kind, 1, tags)?;
            }
            found += block;
        }
        self.as_announced(place, count, found, "elements")
    }

    /// Of the row, whose tags begin at `first`.
    fn element_2(&mut self, kind: Kind, first: usize, tags: usize) -> Result<()> {
        let physical = if tags > 0 { self.row[first].abs() } else { 0.0 };
        let physical = if physical == 0.0 { None } else { Some(physical) };
        self.element(kind, first + tags, physical.as_slice())
    }

    fn elements_4(&mut self) -> Result<()> {
        let heading = [self.size; 4];
        self.row(&heading, "the elements' heading")?;
        let (blocks, announced) =
            (self.bounded(self.row[0], "blocks")?, self.bounded(self.row[1], "elements")?);
        let (mut found, place) = (0, self.row_place());
        for _ in 0..blocks {
            self.row(&[Scalar::I32, Scalar::I32, Scalar::I32, self.size], "a block's heading")?;
            let &[dimension, tag, kind, count] = self.row.as_slice() else {
                return Err(self.bad_row("a heading", 4));
            };
            let (kind, count) = (self.kind(kind)?, self.bounded(count, "elements")?);
            if f64::from(kind.dimension) != dimension {
                return Err(self.bad_dimension(dimension));
            }
            let physical = self.entities.get(&(kind.dimension, tag as i64)).cloned().unwrap_or_default();
            let row = vec![self.size; 1 + kind.nodes];
            for _ in 0..count {
                self.row(&row, "an element's number and nodes")?;
                self.element(kind, 1, &physical)?;
            }
            found += count;
        }
        self.as_announced(place, announced, found, "elements")
    }

    /// Of the row, whose nodes begin at `first`.
    fn element(&mut self, kind: Kind, first: usize, physical: &[f64]) -> Result<()> {
        let place = self.row_at();
        let mut nodes = [0; 10];
        // Of those with more only the corners matter.
        for (node, &tag) in nodes.iter_mut().zip(&self.row[first..]) {
            *node = self.tags.find(tag).ok_or_else(|| {
                SimulateError::invalid(
                    place.to_string(),
                    format!("there is no node {}", short(tag)),
                    "correct the node, or export the mesh again",
                )
            })?;
        }
        if kind.dimension < 3 {
            for &number in physical {
                let name = self.content.name(kind.dimension, number);
                self.content.cell(&name, &nodes[..kind.corners]);
            }
            let n = nodes;
            match (kind.dimension, kind.corners, kind.nodes) {
                (2, 3, 6) => {
                    let parts = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]];
                    self.content.triangles.extend(parts.map(|t| t.map(|i| n[i])));
                }
                (2, 3, _) => self.content.triangles.push([n[0], n[1], n[2]]),
                (2, ..) => self.content.triangles.extend([[n[0], n[1], n[2]], [n[0], n[2], n[3]]]),
                _ => {}
            }
            return Ok(());
        }
        if kind.corners != 4 {
            return Err(SimulateError::invalid(
                place.to_string(),
                format!("a solid of {} corners is no tetrahedron", kind.corners),
                "mesh with tetrahedra alone (Gmsh: no transfinite, recombined or extruded layers)",
            ));
        }
        let region = physical.first().copied().unwrap_or(NO_REGION);
        match kind.nodes {
            4 => self.content.tetrahedron(&nodes[..4], region, || place.to_string()),
            10 => self.content.tetrahedron(&FROM_GMSH.map(|i| nodes[i]), region, || place.to_string()),
            count => {
                let problem = format!("a tetrahedron of {count} nodes, but 4 or 10 are read");
                Err(SimulateError::invalid(
                    place.to_string(),
                    problem,
                    "mesh it with order 1 or 2 (Gmsh: SetOrder 2)",
                ))
            }
        }
    }

    fn kind(&self, number: f64) -> Result<Kind> {
        kind(number).ok_or_else(|| {
            let problem = format!("element type {} is not read", short(number));
            SimulateError::invalid(self.row_place(), problem, "mesh it with tetrahedra of order 1 or 2")
        })
    }

    fn bad_dimension(&self, dimension: f64) -> SimulateError {
        let problem = format!("dimension {} doesn't go with what the block holds", short(dimension));
        SimulateError::invalid(self.row_place(), problem, AGAIN)
    }

    fn bad_row(&self, what: &str, expected: usize) -> SimulateError {
        let problem = format!("{} numbers, but {expected} are expected: {what}", self.row.len());
        SimulateError::invalid(self.row_place(), problem, "correct the line, or export the mesh again")
    }

    fn as_announced(&self, place: String, announced: usize, found: usize, what: &str) -> Result<()> {
        if announced == found {
            return Ok(());
        }
        let problem = format!("{announced} {what} are announced, and {found} follow");
        Err(SimulateError::invalid(place, problem, AGAIN))
    }

    /// A count, each of which takes a byte at least.
    fn bounded(&self, value: f64, what: &str) -> Result<usize> {
        if !(value >= 0.0 && value == value.trunc()) {
            let problem = format!("{} is no number of {what}", short(value));
            return Err(SimulateError::invalid(self.row_place(), problem, AGAIN));
        }
        if value > self.cursor.rest().len() as f64 {
            return Err(truncated(self.row_place(), &format!("the last of {} {what}", short(value))).into());
        }
        Ok(value as usize)
    }

    fn count(&mut self, what: &str) -> Result<usize> {
        let value = self.next(self.size, what)?;
        self.line = self.cursor.line();
        self.bounded(value, what)
    }

    /// A count on a line of its own, which is text in binary files too.
    fn text_count(&mut self, what: &str) -> Result<usize> {
        self.text_row(what)?;
        match *self.row.as_slice() {
            [count] => self.bounded(count, what),
            _ => {
                let problem = format!("{} numbers where the number of {what} is expected", self.row.len());
                Err(SimulateError::invalid(format!("line {}", self.line), problem, AGAIN))
            }
        }
    }

    /// The next number, wherever its line ends.
    fn next(&mut self, scalar: Scalar, what: &str) -> Result<f64> {
        if self.binary {
            let bytes = self.cursor.take(scalar.size(), what)?;
            return Ok(scalar.value(bytes, self.big_endian));
        }
        let word = self.cursor.word().ok_or_else(|| truncated(self.cursor.place(), what))?;
        self.line = self.cursor.line();
        parse_number(word, self.line)
    }

    fn integer(&mut self, scalar: Scalar, what: &str) -> Result<i64> {
        let value = self.next(scalar, what)?;
        if value == value.trunc() && value.abs() < 2f64.powi(31) {
            return Ok(value as i64);
        }
        Err(SimulateError::invalid(self.row_place(), format!("{} is not {what}", short(value)), AGAIN))
    }

    /// So many numbers: of a text file's next line, which must hold no more nor less.
    fn row(&mut self, scalars: &[Scalar], what: &str) -> Result<()> {
        if !self.binary {
            self.text_row(what)?;
            return if self.row.len() == scalars.len() {
                Ok(())
            } else {
                Err(self.bad_row(what, scalars.len()))
            };
        }
        let length = scalars.iter().map(|s| s.size()).sum();
        let mut bytes = self.cursor.take(length, what)?;
        self.row.clear();
        for scalar in scalars {
            let (value, rest) = bytes.split_at(scalar.size());
            self.row.push(scalar.value(value, self.big_endian));
            bytes = rest;
        }
        Ok(())
    }

    /// The numbers of the next line that isn't empty.
    fn text_row(&mut self, what: &str) -> Result<()> {
        self.row.clear();
        while self.row.is_empty() {
            self.line = self.cursor.line();
            let Some(line) = self.cursor.next_line() else {
                return Err(truncated(format!("line {}", self.line), what).into());
            };
            if line.starts_with(b"$") {
                let problem = format!("{} where {what} is expected", quote(line));
                return Err(SimulateError::invalid(format!("line {}", self.line), problem, AGAIN));
            }
            for word in line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()) {
                self.row.push(parse_number(word, self.line)?);
            }
        }
        Ok(())
    }
}

/// Most words of a mesh are whole numbers.
fn parse_number(word: &[u8], line: usize) -> Result<f64> {
    if word.len() <= 15 && word.iter().all(u8::is_ascii_digit) {
        return Ok(word.iter().fold(0u64, |n, digit| 10 * n + u64::from(digit - b'0')) as f64);
    }
    Ok(number(word, || format!("line {line}"))?)
}

/// Which node has which number in the file.
struct Tags {
    dense: Vec<u32>,
    sparse: HashMap<u64, u32>,
    /// Numbers below are kept densely; what that takes is bounded by the file's size.
    dense_below: usize,
}

impl Tags {
    /// False if it was there.
    fn insert(&mut self, tag: u64, node: u32) -> bool {
        if tag >= self.dense_below as u64 {
            return self.sparse.insert(tag, node).is_none();
        }
        let tag = tag as usize;
        if self.dense.len() <= tag {
            self.dense.resize(tag + 1, u32::MAX);
        }
        std::mem::replace(&mut self.dense[tag], node) == u32::MAX
    }

    fn find(&self, tag: f64) -> Option<u32> {
        if !(tag >= 0.0 && tag == tag.trunc()) {
            return None;
        }
        if tag >= self.dense_below as f64 {
            return self.sparse.get(&(tag as u64)).copied();
        }
        self.dense.get(tag as usize).copied().filter(|&n| n != u32::MAX)
    }
}

#[derive(Clone, Copy)]
struct Kind {
    dimension: u8,
    nodes: usize,
    corners: usize,
}

/// Gmsh's element types.
fn kind(number: f64) -> Option<Kind> {
    if !(number >= 0.0 && number == number.trunc()) {
        return None;
    }
    let (dimension, nodes, corners) = match number as u32 {
        15 => (0, 1, 1),
        1 => (1, 2, 2),
        8 => (1, 3, 2),
        26 => (1, 4, 2),
        27 => (1, 5, 2),
        28 => (1, 6, 2),
        2 => (2, 3, 3),
        9 => (2, 6, 3),
        20 => (2, 9, 3),
        21 => (2, 10, 3),
        22 => (2, 12, 3),
        23 | 24 => (2, 15, 3),
        25 => (2, 21, 3),
        3 => (2, 4, 4),
        10 => (2, 9, 4),
        16 => (2, 8, 4),
        36 => (2, 16, 4),
        37 => (2, 25, 4),
        4 => (3, 4, 4),
        11 => (3, 10, 4),
        29 => (3, 20, 4),
        30 => (3, 35, 4),
        31 => (3, 56, 4),
        5 => (3, 8, 8),
        12 => (3, 27, 8),
        17 => (3, 20, 8),
        92 => (3, 64, 8),
        93 => (3, 125, 8),
        6 => (3, 6, 6),
        13 => (3, 18, 6),
        18 => (3, 15, 6),
        7 => (3, 5, 5),
        14 => (3, 14, 5),
        19 => (3, 13, 5),
        _ => return None,
    };
    Some(Kind { dimension, nodes, corners })
}
