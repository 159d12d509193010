//! Reading a recording, as far as it is whole.

use super::file::{self, Envelope, HEADER_MAX, MAGIC, REASON, VERSION};
use super::{Field, Header, Record};
use bytemuck::{Zeroable, bytes_of, bytes_of_mut};
use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

/// A recording: its header, and its records by iterating. After the last one [`ending`](Self::ending) tells how it ended.
#[derive(Debug)]
pub struct Recording<R = BufReader<File>> {
    header: Header,
    /// Whether its records have `tank_j`.
    has_tank: bool,
    source: R,
    read: u64,
    ending: Option<Ending>,
}

/// How a recording ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// By its writer.
    Clean {
        /// Why.
        reason: String,
        /// Periods that were not recorded because the ring was full.
        dropped: u64,
    },
    /// The file ends without saying so: the program was killed, or the disk was full.
    Cut {
        /// Bytes of a record that was begun.
        left_over: u64,
    },
    /// A record's bytes are not those that were written.
    Damaged {
        /// Which, counted from 0.
        record: u64,
    },
    /// The file can't be read any further.
    Unreadable(String),
}

impl fmt::Display for Ending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Ending::Clean { reason, dropped: 0 } => write!(f, "it ended because {reason}"),
            Ending::Clean { reason, dropped } => {
                write!(f, "it ended because {reason}; {dropped} records were dropped")
            }
            Ending::Cut { left_over } => {
                write!(
                    f,
                    "it was cut off, with {left_over} bytes of a record begun: its writer was killed, or its disk full"
                )
            }
            Ending::Damaged { record } => {
                write!(f, "it is damaged from record {record} on; what comes before is whole")
            }
            Ending::Unreadable(why) => write!(f, "the rest can't be read ({why})"),
        }
    }
}

/// Why a file can't be read as a recording.
#[derive(Debug, thiserror::Error)]
pub enum OpenRecordingError {
    /// The system says no.
    #[error("{0}: can't be read ({1}); check the path and its permissions")]
    System(PathBuf, #[source] io::Error),
    /// It is something else, or damaged in its header.
    #[error("{path}: {problem}; {hint}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
        /// What to do.
        hint: &'static str,
    },
}

impl Recording {
    /// Opens the file at `path`.
    ///
    /// # Errors
    /// It can't be read, is no recording, or its header is damaged or of another version.
    pub fn open(path: &Path) -> Result<Self, OpenRecordingError> {
        let system = |error| OpenRecordingError::System(path.into(), error);
        let file = File::open(path).map_err(system)?;
        if file.metadata().map_err(system)?.is_dir() {
            return Err(system(io::ErrorKind::IsADirectory.into()));
        }
        Recording::read(BufReader::with_capacity(1 << 18, file), path)
    }
}

impl<R: Read> Recording<R> {
    /// Reads a recording from `source`, which errors call `path`.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn read(mut source: R, path: &Path) -> Result<Self, OpenRecordingError> {
        let envelope = envelope(&mut source).map_err(|(problem, hint)| OpenRecordingError::Format {
            path: path.into(),
            problem,
            hint,
        })?;
        let has_tank = has_tank(&envelope.fields);
        Ok(Recording { header: envelope.recording, has_tank, source, read: 0, ending: None })
    }

    /// What it is of.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// How it ended; `None` as long as records come.
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    fn next_record(&mut self) -> Result<Record, Ending> {
        let mut record = Record::zeroed();
        let filled = fill(&mut self.source, bytes_of_mut(&mut record));
        let filled = filled.map_err(|error| Ending::Unreadable(error.to_string()))?;
        if filled < Record::BYTES {
            return Err(Ending::Cut { left_over: filled as u64 });
        }
        let sound = record.crc == file::checksum(&record);
        match record.kind {
            Record::PERIOD if sound => {
                self.read += 1;
                if !self.has_tank {
                    // Spare there, and 0, which would be a level.
                    record.tank_j = f64::NAN;
                }
                Ok(record)
            }
            Record::END if sound => Err(clean(&record)),
            _ => Err(Ending::Damaged { record: self.read }),
        }
    }
}

impl<R: Read> Iterator for Recording<R> {
    type Item = Record;

    fn next(&mut self) -> Option<Record> {
        if self.ending.is_some() {
            return None;
        }
        self.next_record().map_err(|ending| self.ending = Some(ending)).ok()
    }
}

/// The end as its writer told it.
fn clean(block: &Record) -> Ending {
    let bytes = bytes_of(block);
    let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
    let (from, room) = REASON;
    let length = usize::try_from(number(24)).unwrap_or(room).min(room);
    let reason = String::from_utf8_lossy(&bytes[from..from + length]).into_owned();
    Ending::Clean { reason, dropped: number(16) }
}

/// A problem and how to correct it.
type Problem = (String, &'static str);

fn envelope(source: &mut impl Read) -> Result<Envelope, Problem> {
    const CUT: &str = "it ended before its first record: there is nothing to be read from it";
    let cut = |what: &str| (format!("it ends within its {what}"), CUT);
    let bytes = |source: &mut dyn Read, count: usize, what: &str| -> Result<Vec<u8>, Problem> {
        let mut bytes = vec![0; count];
        let filled = fill(source, &mut bytes);
        let filled = filled.map_err(|e| (format!("can't be read ({e})"), "check the disk"))?;
        if filled == count { Ok(bytes) } else { Err(cut(what)) }
    };
    let word = |source: &mut dyn Read, what: &str| -> Result<u32, Problem> {
        let bytes = bytes(source, 4, what)?;
        Ok(u32::from_le_bytes(std::array::from_fn(|i| bytes[i])))
    };
    if bytes(source, 8, "first bytes")? != MAGIC {
        return Err(("it is no recording of palpate".into(), "give a file that `palpate run --record` made"));
    }
    let version = word(source, "version")?;
    if !(1..=VERSION).contains(&version) {
        let problem =
            format!("it is a recording of version {version}; this program reads versions 1 to {VERSION}");
        return Err((problem, "read it with the palpate that its header names"));
    }
    let length = word(source, "header's length")?;
    let damaged = |what: String| (format!("its header is damaged: {what}"), "take another copy");
    if length > HEADER_MAX {
        return Err(damaged(format!("{length} bytes are too many")));
    }
    let json = bytes(source, length as usize, "header")?;
    if word(source, "header's checksum")? != crc32fast::hash(&json) {
        return Err(damaged("its checksum does not fit".into()));
    }
    let envelope: Envelope = serde_json::from_slice(&json).map_err(|e| damaged(e.to_string()))?;
    let (theirs, ours) = (&envelope.fields, Record::fields());
    let same = theirs.iter().all(|a| is_spare(a) || ours.iter().any(|b| lies_alike(a, b)))
        && ours.iter().all(|b| theirs.iter().any(|a| lies_alike(a, b) || is_spare(a) && holds(a, b)));
    if envelope.record_bytes as usize != Record::BYTES || !same {
        return Err(damaged("its records are not those of this version".into()));
    }
    // No checksum covers the version.
    if (version >= 3) != has_tank(&envelope.fields) {
        return Err(damaged("its records are not those of its version".into()));
    }
    Ok(envelope)
}

fn has_tank(fields: &[Field]) -> bool {
    fields.iter().any(|field| field.name == "tank_j")
}

/// Whether a recording's field is one of ours: its meaning may be said in other words, and what is spare have had a name.
fn lies_alike(theirs: &Field, ours: &Field) -> bool {
    let named = theirs.name == ours.name || is_spare(ours);
    named && theirs.kind == ours.kind && (theirs.count, theirs.offset) == (ours.count, ours.offset)
}

fn is_spare(field: &Field) -> bool {
    field.name.starts_with("spare")
}

/// Whether one of ours lies where theirs was spare: it was 0.
fn holds(theirs: &Field, ours: &Field) -> bool {
    let bytes = |field: &Field| {
        let from = u64::from(field.offset);
        from..from + u64::from(field.count) * if field.kind == "u32" { 4 } else { 8 }
    };
    let (theirs, ours) = (bytes(theirs), bytes(ours));
    theirs.start <= ours.start && ours.end <= theirs.end
}

/// As `read_exact`, but says how much there was.
fn fill(source: &mut (impl Read + ?Sized), bytes: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < bytes.len() {
        match source.read(&mut bytes[filled..]) {
            Ok(0) => break,
            Ok(count) => filled += count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}
