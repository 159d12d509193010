//! A place in a file: lines, words and bytes from there on, each with its line for messages.

use crate::error::{BodyError, Result};

/// Text from a file for a message: short, on one line.
pub fn quote(bytes: &[u8]) -> String {
    let text = bytes[..bytes.len().min(40)].escape_ascii();
    if bytes.len() > 40 { format!("`{text}...`") } else { format!("`{text}`") }
}

/// A number from a file for a message: whatever it is, it won't fill the screen.
pub fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e15).contains(&value.abs()) {
        format!("{value}")
    } else {
        format!("{value:e}")
    }
}

/// A word as a number; `place` says where it was read.
///
/// # Errors
/// It is none.
pub fn number(word: &[u8], place: impl Fn() -> String) -> Result<f64> {
    std::str::from_utf8(word).ok().and_then(|w| w.parse().ok()).ok_or_else(|| {
        BodyError::invalid(
            place(),
            format!("{} is not a number", quote(word)),
            "correct it, or export the mesh again",
        )
    })
}

/// The file ends, or a number is larger than what follows can hold.
pub fn truncated(place: String, what: &str) -> BodyError {
    let hint = "the file is cut short or damaged: export or copy it again";
    BodyError::invalid(place, format!("the file ends before {what}"), hint)
}

/// Reads forwards and never beyond the end.
#[derive(Debug, Clone)]
pub struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    line: usize,
}

impl<'a> Cursor<'a> {
    /// At the first byte.
    pub fn new(bytes: &'a [u8]) -> Self {
        Cursor { bytes, at: 0, line: 1 }
    }

    /// The line that the cursor stands in, from 1.
    pub fn line(&self) -> usize {
        self.line
    }

    /// The line, for a message.
    pub fn place(&self) -> String {
        format!("line {}", self.line)
    }

    /// The byte, from 0, for a message.
    pub fn byte_place(&self) -> String {
        format!("byte {}", self.at)
    }

    /// All that follows.
    pub fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    /// The line's rest, without its end (LF, CRLF or CR).
    pub fn next_line(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest();
        if rest.is_empty() {
            return None;
        }
        let length = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
        self.at += length
            + if rest[length..].starts_with(b"\r\n") { 2 } else { rest.len().min(length + 1) - length };
        self.line += 1;
        Some(&rest[..length])
    }

    /// The next line, if it is wanted.
    pub fn next_line_if(&mut self, wanted: bool) -> Option<&'a [u8]> {
        if wanted { self.next_line() } else { None }
    }

    /// The next word, over any white space and line ends.
    pub fn word(&mut self) -> Option<&'a [u8]> {
        while let Some(b) = self.rest().first().filter(|b| b.is_ascii_whitespace()) {
            let ends = *b == b'\n' || *b == b'\r' && self.bytes.get(self.at + 1) != Some(&b'\n');
            self.line += usize::from(ends);
            self.at += 1;
        }
        let rest = self.rest();
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.at += length;
        (length > 0).then_some(&rest[..length])
    }

    /// The next word as a number.
    ///
    /// # Errors
    /// The file ends before `what`; the word is NaN or infinite.
    pub fn number(&mut self, what: &str) -> Result<f64> {
        let word = self.word().ok_or_else(|| truncated(self.place(), what))?;
        number(word, || self.place())
    }

    /// The next bytes.
    ///
    /// # Errors
    /// The file ends before `what`.
    pub fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8]> {
        let bytes = self.rest().get(..count).ok_or_else(|| truncated(self.byte_place(), what))?;
        self.at += count;
        Ok(bytes)
    }
}

/// Number formats of binary files.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "the names say it: integers and floating-point numbers of so many bits")]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// Bytes of one.
    pub fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }

    /// The value of `size` bytes. Integers beyond 2^53 lose digits, but no index reaches there.
    pub fn value(self, bytes: &[u8], big_endian: bool) -> f64 {
        let mut word = [0; 8];
        for (i, b) in bytes.iter().take(self.size()).enumerate() {
            word[if big_endian { self.size() - 1 - i } else { i }] = *b;
        }
        let raw = u64::from_le_bytes(word);
        match self {
            Scalar::I8 => f64::from(raw as i8),
            Scalar::U8 => f64::from(raw as u8),
            Scalar::I16 => f64::from(raw as i16),
            Scalar::U16 => f64::from(raw as u16),
            Scalar::I32 => f64::from(raw as i32),
            Scalar::U32 => f64::from(raw as u32),
            Scalar::I64 => raw as i64 as f64,
            Scalar::U64 => raw as f64,
            Scalar::F32 => f64::from(f32::from_bits(raw as u32)),
            Scalar::F64 => f64::from_bits(raw),
        }
    }
}
