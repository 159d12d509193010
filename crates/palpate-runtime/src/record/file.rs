//! Writing a recording.

use super::{Field, Record};
use crate::wrench::{components, quaternion};
use crate::{Safety, WorkspaceMap};
use bytemuck::{Zeroable, bytes_of, bytes_of_mut};
use glam::DVec3;
use palpate_body::BodyError;
use palpate_body::file::Fingerprint;
use palpate_files as files;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

// Records are copied as they lie in memory.
const _: () =
    assert!(cfg!(target_endian = "little"), "recordings are written and read on little-endian machines");

/// The first eight bytes.
pub const MAGIC: [u8; 8] = *b"palprec\n";
/// The format's number. Version 1 has `spare` where version 2 has the handle's angular velocity and `squares_rad2`, and both have it
/// where version 3 has `tank_j`.
pub(super) const VERSION: u32 = 3;
/// No header is longer, bytes.
pub(super) const HEADER_MAX: u32 = 1 << 20;
/// Where the text of the block that ends a file begins, and how much of it there is room for, bytes.
pub(super) const REASON: (usize, usize) = (48, 512);

/// What a recording is of: enough to play it again.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Header {
    /// The program that wrote it, with its version.
    pub program: String,
    /// When it began, s since 1970, by the machine's clock.
    pub began_unix_s: f64,
    /// Periods a second.
    pub rate_hz: f64,
    /// The body.
    pub body: BodyFile,
    /// The slip rule in force.
    pub slip: String,
    /// Whether slip was kept from giving out energy; it was not in recordings that don't say.
    pub tank: bool,
    /// Whether the contact was two contact points side by side; it was not in recordings that don't say.
    pub partial_slip: bool,
    /// The interpolations taken away.
    pub ablation: String,
    /// The device's name.
    pub device: String,
    /// The output stages' settings; `None` where only a NaN or infinite value was stopped.
    pub safety: Option<Safety>,
    /// The virtual coupling's stiffness, if there was one.
    pub coupling_n_per_m: Option<f64>,
    /// The same of its rotational spring.
    pub coupling_nm_per_rad: Option<f64>,
    /// The workspace map at the beginning.
    pub map: Map,
}

/// Which body it was.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct BodyFile {
    /// Its file's name.
    pub name: String,
    /// Its file's SHA-256, in hexadecimal digits.
    pub sha256: String,
}

impl BodyFile {
    /// The body file at `path`, with its digest, as recordings want it.
    ///
    /// # Errors
    /// It can't be read, or is changed meanwhile.
    pub fn of(path: &Path) -> anyhow::Result<Self> {
        BodyFile::read_with(path, true, || Ok(())).map(|((), file)| file)
    }

    /// The same beside what `read` makes of that file: both are of one state of it. Without `digest` its SHA-256 is left out.
    ///
    /// # Errors
    /// As [`BodyFile::of`], and those of `read`.
    pub fn read_with<T, E: From<anyhow::Error>>(
        path: &Path,
        digest: bool,
        read: impl FnOnce() -> Result<T, E>,
    ) -> Result<(T, Self), E> {
        let fingerprint =
            |file: &File| Fingerprint::of(file).map_err(|e| anyhow::Error::from(BodyError::io(path, e)));
        let file = files::open(path)?;
        let before = fingerprint(&file)?;
        let read = read()?;
        let sha256 = if digest { files::sha256_of(file, path)? } else { String::new() };
        if fingerprint(&files::open(path)?)? != before {
            let problem = format!("{}: it was changed while it was read; start again", path.display());
            return Err(anyhow::Error::msg(problem).into());
        }
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        Ok((read, BodyFile { name, sha256 }))
    }
}

/// A [`WorkspaceMap`] as JSON.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Map {
    /// w x y z, body from device.
    pub rotation: [f64; 4],
    /// Body's way per device's way.
    pub scale: f64,
    /// Where the device's origin is in the body, m.
    pub offset_m: [f64; 3],
    /// Where the tool's tip is in the handle's frame, m.
    pub tip_in_handle_m: [f64; 3],
    /// w x y z, handle from tool.
    pub handle_from_tool: [f64; 4],
    /// The clutch's button.
    pub clutch: Option<u32>,
}

impl Default for Map {
    fn default() -> Self {
        WorkspaceMap::default().into()
    }
}

impl From<WorkspaceMap> for Map {
    fn from(map: WorkspaceMap) -> Self {
        let WorkspaceMap { rotation, scale, offset_m, tip_in_handle_m, handle_from_tool, clutch } = map;
        Map {
            rotation: components(rotation),
            scale,
            offset_m: offset_m.to_array(),
            tip_in_handle_m: tip_in_handle_m.to_array(),
            handle_from_tool: components(handle_from_tool),
            clutch,
        }
    }
}

impl From<Map> for WorkspaceMap {
    fn from(map: Map) -> Self {
        let Map { rotation, scale, offset_m, tip_in_handle_m, handle_from_tool, clutch } = map;
        WorkspaceMap {
            rotation: quaternion(rotation),
            scale,
            offset_m: DVec3::from_array(offset_m),
            tip_in_handle_m: DVec3::from_array(tip_in_handle_m),
            handle_from_tool: quaternion(handle_from_tool),
            clutch,
        }
    }
}

/// The header as it is in the file, with what the records look like.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Envelope {
    pub format: String,
    pub record_bytes: u32,
    pub fields: Vec<Field>,
    pub recording: Header,
}

/// Why a recording can't be begun.
#[derive(Debug, thiserror::Error)]
pub enum CreateError {
    /// A recording is never overwritten unless that is asked for.
    #[error("{0}: it is there already; name another file, or remove it first")]
    Exists(PathBuf),
    /// The system says no.
    #[error("{0}: can't be written ({1}); check that its folder exists, can be written and has room")]
    System(PathBuf, #[source] io::Error),
}

/// A recording that is being written. The file has its final name from the beginning: what has been flushed can be read
/// whatever becomes of the program.
#[derive(Debug)]
pub struct RecordingFile<W> {
    out: W,
}

impl RecordingFile<BufWriter<File>> {
    /// Begins a recording at `path`, which must be free unless `replace`.
    ///
    /// # Errors
    /// There is a file already; the system refuses.
    pub fn create(path: &Path, replace: bool, header: &Header) -> Result<Self, CreateError> {
        let complain = |error: io::Error| match error.kind() {
            io::ErrorKind::AlreadyExists => CreateError::Exists(path.into()),
            _ => CreateError::System(path.into(), error),
        };
        let mut options = File::options();
        options.write(true);
        let options = if replace { options.create(true).truncate(true) } else { options.create_new(true) };
        let file = options.open(path).map_err(complain)?;
        Self::begin(BufWriter::with_capacity(1 << 18, file), header).map_err(complain)
    }
}

impl<W: Write> RecordingFile<W> {
    /// Begins a recording in `out`: magic, version, length of the header, header, and its CRC-32.
    ///
    /// # Errors
    /// What `out` reports; a header that is too long.
    pub fn begin(mut out: W, header: &Header) -> io::Result<Self> {
        let envelope = Envelope {
            format: "palpate recording".into(),
            record_bytes: Record::BYTES as u32,
            fields: Record::fields(),
            recording: header.clone(),
        };
        let json = serde_json::to_vec(&envelope)?;
        let refused = |what| Err(io::Error::new(io::ErrorKind::InvalidInput, what));
        if json.len() > HEADER_MAX as usize {
            return refused("the recording's header is beyond 1 MiB");
        }
        // JSON has no word for a NaN or infinite value.
        if !serde_json::from_slice::<Envelope>(&json).is_ok_and(|back| back.recording == *header) {
            return refused("the recording's header holds a NaN or infinite value");
        }
        let crc = crc32fast::hash(&json);
        let parts: [&[u8]; 5] =
            [&MAGIC, &VERSION.to_le_bytes(), &(json.len() as u32).to_le_bytes(), &json, &crc.to_le_bytes()];
        out.write_all(&parts.concat())?;
        out.flush()?;
        Ok(RecordingFile { out })
    }

    /// Adds a record, with its CRC.
    ///
    /// # Errors
    /// What the file's writer reports.
    pub fn write(&mut self, record: &Record) -> io::Result<()> {
        self.out.write_all(bytes_of(&sealed(*record)))
    }

    /// Hands what was written to the system.
    ///
    /// # Errors
    /// What the file's writer reports.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// Ends the recording: why, how many records there are, and how many were dropped.
    ///
    /// # Errors
    /// What the file's writer reports.
    pub fn end(mut self, reason: &str, records: u64, dropped: u64) -> io::Result<W> {
        let mut block = Record { kind: Record::END, number: records, ..Record::zeroed() };
        let (from, room) = REASON;
        let length = (0..=reason.len().min(room)).rev().find(|&at| reason.is_char_boundary(at)).unwrap_or(0);
        // The block has a record's size and none of its meaning: number, dropped, length and text of the reason.
        let bytes = bytes_of_mut(&mut block);
        bytes[16..24].copy_from_slice(&dropped.to_le_bytes());
        bytes[24..32].copy_from_slice(&(length as u64).to_le_bytes());
        bytes[from..from + length].copy_from_slice(&reason.as_bytes()[..length]);
        self.write(&block)?;
        self.out.flush()?;
        Ok(self.out)
    }
}

/// A record with its checksum.
pub(super) fn sealed(mut record: Record) -> Record {
    record.crc = checksum(&record);
    record
}

pub(super) fn checksum(record: &Record) -> u32 {
    crc32fast::hash(&bytes_of(record)[..Record::BYTES - 4])
}
