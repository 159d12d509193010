//! Reading inputs and replacing outputs: digests, atomic writes, and the refusal to overwrite an input.

use anyhow::{Result, anyhow, bail};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::Path;

/// The text of a file.
///
/// # Errors
/// It can't be read, or is not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    let bytes = std::fs::read(path).map_err(|e| unreadable(path, &e))?;
    match String::from_utf8(bytes) {
        Ok(text) => Ok(text),
        Err(e) => {
            let line =
                1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|b| **b == b'\n').count();
            bail!("{}:{line}: it is not UTF-8 text; save it as plain text", path.display())
        }
    }
}

/// SHA-256 of a file, as hexadecimal digits.
///
/// # Errors
/// It can't be read.
pub fn sha256(path: &Path) -> Result<String> {
    let read = || -> std::io::Result<String> {
        let mut file = File::open(path)?;
        let mut hash = Sha256::new();
        let mut buffer = vec![0; 1 << 16];
        loop {
            let count = file.read(&mut buffer)?;
            if count == 0 {
                break;
            }
            hash.update(buffer.get(..count).unwrap_or_default());
        }
        let mut text = String::new();
        for byte in hash.finalize() {
            let _ = write!(text, "{byte:02x}");
        }
        Ok(text)
    };
    read().map_err(|e| unreadable(path, &e))
}

fn unreadable(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow!("{}: can't be read ({error}); check the path and its permissions", path.display())
}

fn unwritable(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow!("{}: can't be written ({error}); check that its folder exists and has room", path.display())
}

/// Writes `path` through a temporary file beside it: what was there survives any failure.
///
/// # Errors
/// The folder can't be written or is full, or `write` fails.
pub fn replace(path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let complain = |e: std::io::Error| unwritable(path, &e);
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if path.is_dir() {
        bail!("{}: it is a folder; name a file", path.display());
    }
    let mut builder = tempfile::Builder::new();
    // A temporary file is its owner's alone; an output is an ordinary file, as far as the umask allows.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut out = BufWriter::with_capacity(1 << 18, builder.tempfile_in(folder).map_err(complain)?);
    write(&mut out)?;
    let file = out.into_inner().map_err(|e| complain(e.into_error()))?;
    file.persist(path).map_err(|e| complain(e.error))?;
    Ok(())
}

/// Makes sure that `output` is none of `inputs`, also under another name.
///
/// # Errors
/// It is one.
pub fn refuse_overwrite(output: &Path, inputs: &[&Path]) -> Result<()> {
    match inputs.iter().find(|input| same_file(output, input)) {
        Some(input) => {
            bail!("{}: the output is the input {}; name another file", output.display(), input.display())
        }
        None => Ok(()),
    }
}

fn same_file(a: &Path, b: &Path) -> bool {
    if let (Ok(a), Ok(b)) = (std::fs::canonicalize(a), std::fs::canonicalize(b))
        && a == b
    {
        return true;
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let id = |p: &Path| std::fs::metadata(p).map(|m| (m.dev(), m.ino())).ok();
        id(a).is_some() && id(a) == id(b)
    }
    #[cfg(not(unix))]
    false
}

/// Makes a folder and those above it.
///
/// # Errors
/// It can't be made.
pub fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| unwritable(path, &e))
}
