//! STL, text and binary. The format repeats a vertex for each triangle: equal ones are made one here.

use super::cursor::Scalar;
use super::{BodyError, Cursor, Result, Soup, few_corners, number, quote, truncated};
use crate::repair::weld;

/// A header of 80 bytes and the count.
const HEADER: usize = 84;
/// A normal and three corners of three 32-bit floats, two bytes of attributes.
const TRIANGLE: usize = 50;

pub(super) fn parse(bytes: &[u8]) -> Result<Soup> {
    let announced = bytes.get(80..HEADER).map(|count| Scalar::U32.value(count, false) as usize);
    let expected = announced.and_then(|n| n.checked_mul(TRIANGLE)?.checked_add(HEADER));
    // Many binary files start with "solid", too; their length tells.
    let text = bytes.trim_ascii_start().get(..5).is_some_and(|w| w.eq_ignore_ascii_case(b"solid"));
    let mut soup = match expected {
        Some(length) if length == bytes.len() || !text && length < bytes.len() => {
            binary(bytes.get(HEADER..length).unwrap_or_default())?
        }
        _ if text => ascii(bytes)?,
        Some(_) => {
            let announced = announced.unwrap_or_default();
            return Err(truncated(
                "byte 80".into(),
                &format!("the last of the {announced} triangles it announces"),
            ));
        }
        None => return Err(truncated("byte 0".into(), "the binary header's 84 bytes")),
    };
    weld(&mut soup.positions, &mut soup.triangles);
    Ok(soup)
}

fn binary(bytes: &[u8]) -> Result<Soup> {
    let mut soup = Soup::default();
    for (t, triangle) in bytes.chunks_exact(TRIANGLE).enumerate() {
        let place = || format!("triangle {t}");
        let value = |i: usize| Scalar::F32.value(&triangle[4 * i..], false);
        let first = soup.positions.len() as u32;
        for corner in [3, 6, 9] {
            soup.vertex([value(corner), value(corner + 1), value(corner + 2)], place)?;
        }
        soup.polygon(&[first, first + 1, first + 2], place)?;
    }
    Ok(soup)
}

fn ascii(bytes: &[u8]) -> Result<Soup> {
    let (mut soup, mut cursor, mut corners, mut open) =
        (Soup::default(), Cursor::new(bytes), Vec::new(), false);
    loop {
        let number_of_line = cursor.line();
        let place = || format!("line {number_of_line}");
        let Some(line) = cursor.next_line() else { break };
        let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        let Some(keyword) = words.next() else { continue };
        match keyword.to_ascii_lowercase().as_slice() {
            b"vertex" => {
                let mut next =
                    || number(words.next().ok_or_else(|| truncated(place(), "three coordinates"))?, place);
                corners.push(soup.positions.len() as u32);
                soup.vertex([next()?, next()?, next()?], place)?;
            }
            b"facet" | b"outer" => open = true,
            b"endloop" => {
                if corners.len() < 3 {
                    return Err(few_corners(place(), corners.len()));
                }
                soup.polygon(&corners, place)?;
                corners.clear();
            }
            b"endfacet" => open = false,
            b"solid" | b"endsolid" => {}
            _ => {
                let problem = format!("{} does not belong into a text STL file", quote(keyword));
                return Err(BodyError::invalid(
                    place(),
                    problem,
                    "remove the line, or export the mesh again",
                ));
            }
        }
    }
    if open || !corners.is_empty() {
        return Err(truncated(cursor.place(), "the last facet does"));
    }
    Ok(soup)
}
