//! Polygon File Format, text and binary of both byte orders: elements `vertex` (x, y, z) and `face` (vertex_indices).

use super::cursor::Scalar;
use super::{BodyError, Cursor, Result, Soup, index, quote, truncated};

struct Element<'a> {
    name: &'a [u8],
    count: usize,
    properties: Vec<Property<'a>>,
}

struct Property<'a> {
    name: &'a [u8],
    /// The type of a list's length.
    list: Option<Scalar>,
    scalar: Scalar,
}

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

pub(super) fn parse(bytes: &[u8]) -> Result<Soup> {
    let mut cursor = Cursor::new(bytes);
    let (encoding, elements) = header(&mut cursor)?;
    let mut reader = Reader { cursor, encoding };
    let vertices = elements.iter().find(|e| e.name == b"vertex").map_or(0, |e| e.count);
    let mut soup = Soup::default();
    for element in &elements {
        reader.check_count(element)?;
        match element.name {
            b"vertex" => read_vertices(&mut reader, element, &mut soup)?,
            b"face" => read_faces(&mut reader, element, vertices, &mut soup)?,
            b"tristrips" => {
                let hint = "export it with triangles or polygons as faces";
                return Err(BodyError::invalid("element tristrips", "triangle strips are not read", hint));
            }
            _ if element.properties.is_empty() => {}
            _ => {
                for _ in 0..element.count {
                    for property in &element.properties {
                        reader.property(property, &mut |_| ())?;
                    }
                }
            }
        }
    }
    if soup.positions.len() != vertices {
        return Err(BodyError::invalid(
            "header",
            "more than one element is called vertex",
            "export it with one",
        ));
    }
    Ok(soup)
}

fn header<'a>(cursor: &mut Cursor<'a>) -> Result<(Encoding, Vec<Element<'a>>)> {
    let (mut encoding, mut elements) = (None, Vec::<Element>::new());
    let bad = |line: usize, text: &[u8], what: &str| {
        let problem = format!("{} is no {what}", quote(text));
        Err(BodyError::invalid(format!("line {line}"), problem, "export the mesh again as PLY 1.0"))
    };
    if cursor.next_line().map(<[u8]>::trim_ascii_end) != Some(b"ply") {
        return bad(1, &cursor.rest()[..0], "first line of a PLY file, which is `ply`");
    }
    loop {
        let number = cursor.line();
        let line =
            cursor.next_line().ok_or_else(|| truncated(cursor.place(), "the header's `end_header`"))?;
        let words: Vec<_> = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).collect();
        match words[..] {
            [] | [b"comment" | b"obj_info", ..] => {}
            [b"format", b"ascii", ..] => encoding = Some(Encoding::Text),
            [b"format", b"binary_little_endian", ..] => encoding = Some(Encoding::LittleEndian),
            [b"format", b"binary_big_endian", ..] => encoding = Some(Encoding::BigEndian),
            [b"element", name, count] => {
                let Some(count) = std::str::from_utf8(count).ok().and_then(|c| c.parse().ok()) else {
                    return bad(number, count, "count");
                };
                elements.push(Element { name, count, properties: Vec::new() });
            }
            [b"property", ref definition @ ..] => {
                let property = match *definition {
                    [b"list", length, item, name] => scalar(length)
                        .zip(scalar(item))
                        .filter(|(length, _)| !matches!(length, Scalar::F32 | Scalar::F64))
                        .map(|(length, scalar)| Property { name, list: Some(length), scalar }),
                    [item, name] => scalar(item).map(|scalar| Property { name, list: None, scalar }),
                    _ => None,
                };
                match (property, elements.last_mut()) {
                    (Some(property), Some(element)) => element.properties.push(property),
                    _ => return bad(number, line, "property of an element"),
                }
            }
            [b"end_header"] => break,
            _ => return bad(number, line, "line of a PLY header"),
        }
    }
    match encoding {
        Some(encoding) => Ok((encoding, elements)),
        None => Err(truncated("header".into(), "its `format` line")),
    }
}

fn scalar(name: &[u8]) -> Option<Scalar> {
    Some(match name {
        b"char" | b"int8" => Scalar::I8,
        b"uchar" | b"uint8" => Scalar::U8,
        b"short" | b"int16" => Scalar::I16,
        b"ushort" | b"uint16" => Scalar::U16,
        b"int" | b"int32" => Scalar::I32,
        b"uint" | b"uint32" => Scalar::U32,
        b"float" | b"float32" => Scalar::F32,
        b"double" | b"float64" => Scalar::F64,
        _ => return None,
    })
}

fn read_vertices(reader: &mut Reader, element: &Element, soup: &mut Soup) -> Result<()> {
    let mut axes = Vec::new();
    for axis in [b"x", b"y", b"z"] {
        let column = element.properties.iter().position(|p| p.name == axis && p.list.is_none());
        axes.push(column.ok_or_else(|| {
            let problem = format!("its vertices have no property `{}`", axis.escape_ascii());
            BodyError::invalid("element vertex", problem, "export the mesh again as PLY 1.0")
        })?);
    }
    for v in 0..element.count {
        let mut p = [f64::NAN; 3];
        for (i, property) in element.properties.iter().enumerate() {
            let axis = axes.iter().position(|&a| a == i);
            reader.property(property, &mut |value| {
                if let Some(axis) = axis {
                    p[axis] = value;
                }
            })?;
        }
        soup.vertex(p, || reader.place("vertex", v))?;
    }
    Ok(())
}

fn read_faces(reader: &mut Reader, element: &Element, vertices: usize, soup: &mut Soup) -> Result<()> {
    let named = |p: &Property| p.list.is_some() && matches!(p.name, b"vertex_indices" | b"vertex_index");
    if element.count > 0 && !element.properties.iter().any(named) {
        let problem = "its faces have no list `vertex_indices`";
        return Err(BodyError::invalid("element face", problem, "export the mesh again as PLY 1.0"));
    }
    let mut corners = Vec::new();
    for f in 0..element.count {
        for property in &element.properties {
            if !named(property) {
                reader.property(property, &mut |_| ())?;
                continue;
            }
            corners.clear();
            reader.property(property, &mut |value| corners.push(value))?;
        }
        let place = || reader.place("face", f);
        let corners = corners.iter().map(|&value| index(value, vertices, place));
        soup.polygon(&corners.collect::<Result<Vec<_>>>()?, place)?;
    }
    Ok(())
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    encoding: Encoding,
}

impl Reader<'_> {
    fn place(&self, what: &str, number: usize) -> String {
        match self.encoding {
            Encoding::Text => format!("{what} {number} (line {})", self.cursor.line()),
            _ => format!("{what} {number}"),
        }
    }

    /// No element may be announced that the rest of the file cannot hold.
    fn check_count(&self, element: &Element) -> Result<()> {
        let least = |p: &Property| match self.encoding {
            Encoding::Text => 1,
            _ => p.list.unwrap_or(p.scalar).size(),
        };
        let size: usize = element.properties.iter().map(least).sum();
        if element.count.checked_mul(size).is_some_and(|total| total <= self.cursor.rest().len()) {
            return Ok(());
        }
        let what = format!("the last of the {} elements `{}`", element.count, element.name.escape_ascii());
        Err(truncated("header".into(), &what))
    }

    fn property(&mut self, property: &Property, visit: &mut dyn FnMut(f64)) -> Result<()> {
        let count = match property.list {
            Some(length) => self.scalar(length)?,
            None => 1.0,
        };
        if !(count >= 0.0 && count <= self.cursor.rest().len() as f64) {
            return Err(truncated(self.cursor.place(), &format!("a list of {count} numbers does")));
        }
        for _ in 0..count as usize {
            visit(self.scalar(property.scalar)?);
        }
        Ok(())
    }

    fn scalar(&mut self, scalar: Scalar) -> Result<f64> {
        let what = "the last of the elements that its header announces";
        match self.encoding {
            Encoding::Text => self.cursor.number(what),
            encoding => {
                Ok(scalar.value(self.cursor.take(scalar.size(), what)?, encoding == Encoding::BigEndian))
            }
        }
    }
}
