//! Object File Format: a keyword, three counts, a line for each vertex and face.

use super::{BodyError, Cursor, Result, Soup, index, number, quote, truncated};

pub(super) fn parse(bytes: &[u8]) -> Result<Soup> {
    let mut cursor = Cursor::new(bytes);
    let (line, mut header) = words(&mut cursor, "the keyword OFF")?;
    let keyword = header.first().copied().unwrap_or_default();
    let binary = header.get(1) == Some(&&b"BINARY"[..]);
    if binary
        || ![&b"OFF"[..], b"COFF", b"NOFF", b"CNOFF", b"STOFF", b"STCOFF", b"STNOFF", b"STCNOFF"]
            .contains(&keyword)
    {
        let problem = format!("it starts with {}, not as a text OFF file", quote(keyword));
        return Err(BodyError::invalid(
            format!("line {line}"),
            problem,
            "save the mesh as text OFF in three dimensions",
        ));
    }
    header.remove(0);
    let (line, counts) = if header.is_empty() { words(&mut cursor, "the counts")? } else { (line, header) };
    let [vertices, faces] = [0, 1].map(|i| {
        let place = || format!("line {line}");
        let count = counts.get(i).ok_or_else(|| truncated(place(), "the counts of vertices and faces"))?;
        let value = number(count, place)?;
        // A vertex takes at least six characters, a face two.
        if value >= 0.0 && value == value.trunc() && value <= bytes.len() as f64 / 2.0 {
            return Ok(value as usize);
        }
        let problem = format!("a count of {value}, more than the file can hold");
        Err(BodyError::invalid(place(), problem, "the file is damaged: export it again"))
    });
    let (vertices, faces) = (vertices?, faces?);

    let mut soup = Soup::default();
    for v in 0..vertices {
        let (line, words) = words(&mut cursor, "its last vertex")?;
        let place = || format!("line {line}");
        let [x, y, z, ..] = words[..] else {
            return Err(truncated(place(), &format!("vertex {v} has three coordinates")));
        };
        soup.vertex([number(x, place)?, number(y, place)?, number(z, place)?], place)?;
    }
    for f in 0..faces {
        let (line, words) = words(&mut cursor, "its last face")?;
        let place = || format!("line {line}");
        let count = number(words.first().copied().unwrap_or_default(), place)?;
        if count >= words.len() as f64 || count < 0.0 {
            return Err(truncated(place(), &format!("face {f} has its {count} vertices")));
        }
        let corners =
            words[1..].iter().take(count as usize).map(|w| index(number(w, place)?, vertices, place));
        soup.polygon(&corners.collect::<Result<Vec<_>>>()?, place)?;
    }
    Ok(soup)
}

/// The next line that has words, without comments, and its number.
fn words<'a>(cursor: &mut Cursor<'a>, what: &str) -> Result<(usize, Vec<&'a [u8]>)> {
    loop {
        let number = cursor.line();
        let line = cursor.next_line().ok_or_else(|| truncated(cursor.place(), what))?;
        let content = line.split(|&b| b == b'#').next().unwrap_or_default();
        let words: Vec<_> = content.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).collect();
        if !words.is_empty() {
            return Ok((number, words));
        }
    }
}
