//! Wavefront OBJ: `v` and `f` lines; all else is about looks.

use super::{BodyError, Cursor, Result, Soup, few_corners, number, quote, truncated};

pub(super) fn parse(bytes: &[u8]) -> Result<Soup> {
    let count = count_vertices(bytes);
    let mut soup = Soup::default();
    let (mut cursor, mut words, mut corners) = (Cursor::new(bytes), Vec::new(), Vec::new());
    loop {
        let line = cursor.line();
        let place = || format!("line {line}");
        if !logical_line(&mut cursor, &mut words) {
            return Ok(soup);
        }
        match words.as_slice() {
            [b"v", x, y, z, ..] => {
                soup.vertex([number(x, place)?, number(y, place)?, number(z, place)?], place)?;
            }
            [b"v", ..] => return Err(truncated(place(), "the vertex has three coordinates")),
            [b"f", faces @ ..] => {
                corners.clear();
                for word in faces {
                    corners.push(corner(word, soup.positions.len(), count, place)?);
                }
                if corners.len() < 3 {
                    return Err(few_corners(place(), corners.len()));
                }
                soup.polygon(&corners, place)?;
            }
            _ => {}
        }
    }
}

/// Faces may name vertices that follow, so the number must be known before.
fn count_vertices(bytes: &[u8]) -> usize {
    let (mut cursor, mut words, mut count) = (Cursor::new(bytes), Vec::new(), 0);
    while logical_line(&mut cursor, &mut words) {
        count += usize::from(words.first() == Some(&&b"v"[..]));
    }
    count
}

/// Words of a line and of those that a backslash at its end joins to it, up to a comment; false at the end.
fn logical_line<'a>(cursor: &mut Cursor<'a>, words: &mut Vec<&'a [u8]>) -> bool {
    words.clear();
    let Some(mut line) = cursor.next_line() else { return false };
    loop {
        let comment = line.iter().position(|&b| b == b'#');
        let content = line[..comment.unwrap_or(line.len())].trim_ascii_end();
        let (content, joined) = match content.strip_suffix(b"\\") {
            Some(start) if comment.is_none() => (start, true),
            _ => (content, false),
        };
        words.extend(content.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()));
        match cursor.next_line_if(joined) {
            Some(next) => line = next,
            None => return true,
        }
    }
}

/// `7`, `7/1`, `7//2`, `7/1/2`: the vertex, counted from 1, or with a sign backwards from the last.
fn corner(word: &[u8], so_far: usize, count: usize, place: impl Fn() -> String) -> Result<u32> {
    let digits = word.split(|&b| b == b'/').next().unwrap_or_default();
    let value = std::str::from_utf8(digits).ok().and_then(|d| d.parse::<i64>().ok());
    let vertex = match value {
        Some(v) if v > 0 => v.checked_sub(1),
        Some(v) if v < 0 => v.checked_add(so_far as i64),
        _ => None,
    };
    match vertex {
        Some(v) if v >= 0 && (v as u64) < count as u64 => Ok(v as u32),
        _ => Err(BodyError::invalid(
            place(),
            format!("the face names vertex {}, but there are {count} (counted from 1)", quote(word)),
            "correct the index, or export the mesh again",
        )),
    }
}
