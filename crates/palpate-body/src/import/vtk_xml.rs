//! VTK's XML files, polygonal (VTP) and unstructured (VTU): arrays as text, base64 or raw bytes, plain or zlib.

use super::cursor::Scalar;
use super::{BodyError, Cursor, Grid, MAX_FILE_BYTES, Result, quote, truncated};
use miniz_oxide::inflate::decompress_to_vec_zlib_with_limit;

const MEND: &str = "save it again with ParaView or meshio, best as text";

pub(super) fn read(bytes: &[u8], wanted: &[&str]) -> Result<Grid> {
    let file = scan(bytes, !wanted.is_empty())?;
    let mut grid = Grid::default();
    // Of the arrays wanted, the first that there is in any piece.
    let on_cells = |a: &&Array| a.section == b"CellData";
    let named =
        |w: &&&str| file.arrays.iter().filter(on_cells).any(|a| a.name.eq_ignore_ascii_case(w.as_bytes()));
    let name = wanted.iter().find(named);
    let mut data = Vec::new();
    for piece in 0..file.pieces {
        let after = |piece: usize| file.arrays.partition_point(|a| a.piece < piece);
        let arrays = &file.arrays[after(piece)..after(piece + 1)];
        let find = |section: &str, name: &str| {
            let named = |a: &&Array| name.is_empty() || a.name.eq_ignore_ascii_case(name.as_bytes());
            let array = arrays.iter().find(|a| a.section == section.as_bytes() && named(a));
            array.map(|a| file.numbers(a)).transpose()
        };
        let first = grid.points.len();
        let points = find("Points", "")?.unwrap_or_default();
        for p in points.chunks(3) {
            let &[x, y, z] = p else {
                return Err(truncated(
                    format!("piece {piece}, Points"),
                    "the last point's three coordinates",
                ));
            };
            grid.point([x, y, z], || format!("piece {piece}, Points"))?;
        }
        let count = grid.points.len() - first;
        let list = |section: &str| -> Result<Option<(Vec<f64>, Vec<f64>)>> {
            let Some(ends) = find(section, "offsets")? else { return Ok(None) };
            Ok(Some((ends, find(section, "connectivity")?.unwrap_or_default())))
        };
        if let Some((ends, vertices)) = list("Polys")? {
            grid.polygons.add("polygon", &ends, &vertices, first, count)?;
        }
        if let Some((ends, vertices)) = list("Strips")? {
            grid.strips.add("strip", &ends, &vertices, first, count)?;
        }
        if let Some((ends, vertices)) = list("Cells")? {
            let kinds = find("Cells", "types")?.unwrap_or_default();
            if kinds.len() != ends.len() {
                let problem = format!("{} cells have {} types", ends.len(), kinds.len());
                return Err(BodyError::invalid(format!("piece {piece}, Cells"), problem, MEND));
            }
            grid.cells.add("cell", &ends, &vertices, first, count)?;
            grid.kinds.extend(kinds.into_iter().map(|k| k as u8));
            if let Some(name) = name {
                let values = find("CellData", name)?.unwrap_or_default();
                if values.len() != ends.len() {
                    let problem = format!("`{name}` has {} numbers for {} cells", values.len(), ends.len());
                    return Err(BodyError::invalid(format!("piece {piece}, CellData"), problem, MEND));
                }
                data.extend(values);
            }
        }
    }
    grid.data = name.map(|name| (name.to_string(), data));
    Ok(grid)
}

/// What the tags say, and where the arrays are.
struct File<'a> {
    big_endian: bool,
    /// Of the sizes in front of binary arrays.
    header: Scalar,
    compressed: bool,
    pieces: usize,
    arrays: Vec<Array<'a>>,
    /// All that follows the underscore of `AppendedData`, and whether it is base64.
    appended: Option<(&'a [u8], bool)>,
}

/// A `DataArray` within `Points`, `Polys`, `Strips`, `Cells` or `CellData`.
struct Array<'a> {
    place: String,
    piece: usize,
    section: &'a [u8],
    name: &'a [u8],
    scalar: Scalar,
    format: Format<'a>,
}

enum Format<'a> {
    Text(&'a [u8]),
    Base64(&'a [u8]),
    Appended(usize),
}

struct Tag<'a> {
    name: &'a [u8],
    attributes: &'a [u8],
    closing: bool,
    empty: bool,
}

impl<'a> Tag<'a> {
    fn attribute(&self, wanted: &[u8]) -> Option<&'a [u8]> {
        let mut rest = self.attributes;
        loop {
            rest = rest.trim_ascii_start();
            let equals = rest.iter().position(|&b| b == b'=')?;
            let (name, value) = (rest[..equals].trim_ascii(), rest[equals + 1..].trim_ascii_start());
            let (&quote, value) = value.split_first()?;
            let end = value.iter().position(|&b| b == quote)?;
            if name == wanted {
                return Some(&value[..end]);
            }
            rest = &value[end + 1..];
        }
    }
}

/// Splits at the next tag: what stands before it, the tag, and what follows. Comments and declarations are passed.
fn next_tag(mut bytes: &[u8]) -> Option<(&[u8], Tag<'_>, &[u8])> {
    loop {
        let start = bytes.iter().position(|&b| b == b'<')?;
        let (before, after) = (&bytes[..start], &bytes[start + 1..]);
        if let Some(comment) = after.strip_prefix(b"!--") {
            bytes = &comment[comment.windows(3).position(|w| w == b"-->")? + 3..];
            continue;
        }
        let mut quoted = None;
        let end = after.iter().position(|&b| {
            match quoted {
                Some(q) if b == q => quoted = None,
                None if b == b'"' || b == b'\'' => quoted = Some(b),
                _ => {}
            }
            b == b'>' && quoted.is_none()
        })?;
        let (inner, rest) = (&after[..end], &after[end + 1..]);
        if inner.starts_with(b"?") || inner.starts_with(b"!") {
            bytes = rest;
            continue;
        }
        let closing = inner.starts_with(b"/");
        let empty = inner.ends_with(b"/");
        let inner = inner.strip_prefix(b"/").unwrap_or(inner);
        let inner = inner.strip_suffix(b"/").unwrap_or(inner);
        let (name, attributes) =
            inner.split_at(inner.iter().position(u8::is_ascii_whitespace).unwrap_or(inner.len()));
        return Some((before, Tag { name, attributes, closing, empty }, rest));
    }
}

fn scan(bytes: &[u8], with_data: bool) -> Result<File<'_>> {
    let mut file = File {
        big_endian: false,
        header: Scalar::U32,
        compressed: false,
        pieces: 0,
        arrays: Vec::new(),
        appended: None,
    };
    let (mut rest, mut section, mut known) = (bytes, &b""[..], false);
    let mut lines = Lines { bytes, at: 0, line: 1 };
    while let Some((_, tag, after)) = next_tag(rest) {
        let place = format!("line {}", lines.of(bytes.len() - after.len()));
        let bad = |problem: String| Err(BodyError::invalid(place.clone(), problem, MEND));
        rest = after;
        match tag.name {
            b"VTKFile" if !tag.closing => {
                known = true;
                file.big_endian = tag.attribute(b"byte_order") == Some(b"BigEndian");
                if tag.attribute(b"header_type") == Some(b"UInt64") {
                    file.header = Scalar::U64;
                }
                match tag.attribute(b"type").unwrap_or_default() {
                    b"PolyData" | b"UnstructuredGrid" => {}
                    other => return bad(format!("a data set of kind {} is no surface", quote(other))),
                }
                match tag.attribute(b"compressor") {
                    None | Some(b"") => {}
                    Some(b"vtkZLibDataCompressor") => file.compressed = true,
                    Some(other) => return bad(format!("compression by {} is not read", quote(other))),
                }
            }
            b"Piece" if !tag.closing => file.pieces += 1,
            b"CellData" if !with_data => {}
            b"Points" | b"Polys" | b"Strips" | b"Cells" | b"CellData" => {
                section = if tag.closing || tag.empty { b"" } else { tag.name };
            }
            b"DataArray" if !tag.closing && !section.is_empty() && file.pieces > 0 => {
                let text =
                    if tag.empty { &b""[..] } else { rest.split(|&b| b == b'<').next().unwrap_or_default() };
                let Some(scalar) = scalar(tag.attribute(b"type").unwrap_or_default()) else {
                    // Text, say: nobody can ask for it.
                    if section == b"CellData" {
                        continue;
                    }
                    return bad("the array's `type` is none that is read".into());
                };
                let format = match tag.attribute(b"format").unwrap_or(b"ascii") {
                    b"ascii" => Format::Text(text),
                    b"binary" => Format::Base64(text),
                    b"appended" => {
                        let offset =
                            tag.attribute(b"offset").and_then(|o| std::str::from_utf8(o).ok()?.parse().ok());
                        let Some(offset) = offset else {
                            return bad("the array's `offset` is NaN or infinite".into());
                        };
                        Format::Appended(offset)
                    }
                    other => return bad(format!("an array in format {} is not read", quote(other))),
                };
                let name = tag.attribute(b"Name").unwrap_or_default();
                file.arrays.push(Array { place, piece: file.pieces - 1, section, name, scalar, format });
            }
            b"AppendedData" => {
                let Some(start) = rest.iter().position(|&b| b == b'_') else {
                    return bad("the appended data has no underscore in front".into());
                };
                file.appended = Some((&rest[start + 1..], tag.attribute(b"encoding") == Some(b"base64")));
                break;
            }
            _ => {}
        }
    }
    if known {
        return Ok(file);
    }
    Err(BodyError::invalid(
        "line 1",
        "there is no tag `VTKFile`",
        "save the mesh as VTP or VTU, or rename it",
    ))
}

/// Line numbers of rising offsets.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    line: usize,
}

impl Lines<'_> {
    fn of(&mut self, offset: usize) -> usize {
        self.line += self.bytes[self.at..offset].iter().filter(|&&b| b == b'\n').count();
        self.at = offset;
        self.line
    }
}

fn scalar(name: &[u8]) -> Option<Scalar> {
    Some(match name {
        b"Int8" => Scalar::I8,
        b"UInt8" => Scalar::U8,
        b"Int16" => Scalar::I16,
        b"UInt16" => Scalar::U16,
        b"Int32" => Scalar::I32,
        b"UInt32" => Scalar::U32,
        b"Int64" => Scalar::I64,
        b"UInt64" => Scalar::U64,
        b"Float32" => Scalar::F32,
        b"Float64" => Scalar::F64,
        _ => return None,
    })
}

impl File<'_> {
    fn numbers(&self, array: &Array) -> Result<Vec<f64>> {
        let in_array = |what: &str| truncated(array.place.clone(), what);
        let bytes = match array.format {
            Format::Text(text) => {
                let mut cursor = Cursor::new(text);
                let mut values = Vec::new();
                while !cursor.rest().trim_ascii_start().is_empty() {
                    let word = cursor.word().unwrap_or_default();
                    values.push(super::number(word, || array.place.clone())?);
                }
                return Ok(values);
            }
            Format::Base64(text) => self.unpack(&|count| base64(text, count)),
            Format::Appended(offset) => {
                let (data, is_base64) = self.appended.ok_or_else(|| in_array("the appended data begins"))?;
                let data = data.get(offset..).ok_or_else(|| in_array("the array's offset"))?;
                if is_base64 {
                    self.unpack(&|count| base64(data, count))
                } else {
                    self.unpack(&|count| data.get(..count).map(<[u8]>::to_vec))
                }
            }
        };
        let bytes = bytes.ok_or_else(|| in_array("the array's last number, or the array is damaged"))?;
        if bytes.len() % array.scalar.size() != 0 {
            return Err(in_array("the array's last number"));
        }
        Ok(bytes.chunks_exact(array.scalar.size()).map(|b| array.scalar.value(b, self.big_endian)).collect())
    }

    /// An array's bytes; `fetch` gives as many as are asked for from the beginning of what is stored, sizes first:
    /// either the number of bytes, or the number of blocks, the size of a block and of the last before compression,
    /// and the size of each after it.
    fn unpack(&self, fetch: &dyn Fn(usize) -> Option<Vec<u8>>) -> Option<Vec<u8>> {
        let word = self.header.size();
        let size = |bytes: &[u8], i: usize| {
            let value = self.header.value(bytes.get(i * word..(i + 1) * word)?, self.big_endian);
            (value <= MAX_FILE_BYTES as f64).then_some(value as usize)
        };
        let first = size(&fetch(word)?, 0)?;
        if !self.compressed {
            return Some(fetch(first.checked_add(word)?)?.split_off(word));
        }
        let head = first.checked_add(3)?.checked_mul(word)?;
        let sizes = fetch(head)?;
        let ends = (0..first).scan(head, |end, block| {
            *end = end.checked_add(size(&sizes, block + 3)?)?;
            Some(*end)
        });
        let ends: Vec<usize> = ends.collect();
        let stored = fetch(*ends.last().unwrap_or(&head))?;
        let (full, last) = (size(&sizes, 1)?, size(&sizes, 2)?);
        let (mut start, mut bytes) = (head, Vec::new());
        for (block, &end) in ends.iter().enumerate() {
            let expected = if block + 1 == first && last > 0 { last } else { full };
            let block = decompress_to_vec_zlib_with_limit(stored.get(start..end)?, expected).ok()?;
            if block.len() != expected || bytes.len() + expected > MAX_FILE_BYTES as usize {
                return None;
            }
            bytes.extend_from_slice(&block);
            start = end;
        }
        (ends.len() == first).then_some(bytes)
    }
}

/// The first `count` bytes of base64 text. Padding may end a part within it, as VTK writes sizes and data apart.
fn base64(text: &[u8], count: usize) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut quad = [0u8; 4];
    let mut filled = 0;
    for &c in text.iter().filter(|c| !c.is_ascii_whitespace()) {
        if bytes.len() >= count {
            break;
        }
        quad[filled] = c;
        filled += 1;
        if filled < 4 {
            continue;
        }
        filled = 0;
        let padding = quad.iter().rev().take_while(|&&c| c == b'=').count();
        let mut value = 0;
        for &c in &quad[..4 - padding.min(2)] {
            value = value << 6 | sextet(c)?;
        }
        let value: u32 = value << (6 * padding.min(2));
        bytes.extend_from_slice(&value.to_be_bytes()[1..4 - padding.min(2)]);
    }
    (bytes.len() >= count).then(|| {
        bytes.truncate(count);
        bytes
    })
}

fn sextet(c: u8) -> Option<u32> {
    Some(u32::from(match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        _ => return None,
    }))
}
