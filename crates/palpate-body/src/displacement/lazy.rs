//! Fields that stay in their file until somebody asks for them.

use super::fields::DisplacementFields;
use crate::error::{BodyError, Result};
use crate::file::Fingerprint;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A body's fields: in memory, or where they are in its file. Copies share them.
#[derive(Debug, Clone)]
pub(crate) struct StoredFields(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    /// Once they were asked for.
    found: OnceLock<DisplacementFields>,
    place: Option<Place>,
}

/// Where tensors are in a file.
#[derive(Debug)]
struct Place {
    path: PathBuf,
    /// Held open: whoever replaces the file by another leaves this one as it is.
    file: Mutex<File>,
    /// Of the file when its header was read.
    fingerprint: Fingerprint,
    /// Where each tensor begins, and how long it is, bytes.
    tensors: BTreeMap<&'static str, (u64, u64)>,
    test_points: usize,
}

impl StoredFields {
    pub fn in_memory(fields: DisplacementFields) -> Self {
        let found = OnceLock::new();
        let _ = found.set(fields);
        StoredFields(Arc::new(Inner { found, place: None }))
    }

    pub fn in_file(
        path: PathBuf,
        file: File,
        tensors: BTreeMap<&'static str, (u64, u64)>,
        test_points: usize,
    ) -> Result<Self> {
        let fingerprint = Fingerprint::of(&file).map_err(|e| BodyError::io(&path, e))?;
        let place = Place { path, file: Mutex::new(file), fingerprint, tensors, test_points };
        Ok(StoredFields(Arc::new(Inner { found: OnceLock::new(), place: Some(place) })))
    }

    /// The fields, read at the first call.
    pub fn get(&self) -> Result<&DisplacementFields> {
        if let Some(found) = self.0.found.get() {
            return Ok(found);
        }
        let read = match &self.0.place {
            Some(place) => place.read().map_err(|e| e.in_file(&place.path))?,
            None => DisplacementFields::default(),
        };
        Ok(self.0.found.get_or_init(|| read))
    }
}

impl Place {
    fn read(&self) -> Result<DisplacementFields> {
        let io = |e: io::Error| BodyError::io(&self.path, e);
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        if Fingerprint::of(&file).map_err(io)? != self.fingerprint {
            let problem = "the file was changed since it was opened";
            return Err(BodyError::invalid("displacement fields", problem, "open the body again"));
        }
        DisplacementFields::from_tensors(self.test_points, |name| {
            let &(start, length) = self.tensors.get(name).unwrap_or(&(0, 0));
            let mut bytes = Vec::new();
            file.seek(SeekFrom::Start(start)).map_err(io)?;
            let count = (&mut *file).take(length).read_to_end(&mut bytes).map_err(io)?;
            if count as u64 == length {
                return Ok(bytes);
            }
            let problem = "the file ends too early";
            Err(BodyError::invalid(format!("tensor `{name}`"), problem, "copy or make it again"))
        })
    }
}

/// By what they hold, where that can be read.
impl PartialEq for StoredFields {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || matches!((self.get(), other.get()), (Ok(a), Ok(b)) if a == b)
    }
}
