//! Reading inputs and replacing outputs: digests, atomic writes, and the refusal to overwrite an input.

use anyhow::{Result, anyhow, bail};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

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
    sha256_of(open(path)?, path)
}

/// The same of an open file, from where it stands.
///
/// # Errors
/// As [`sha256`].
pub fn sha256_of(mut file: File, path: &Path) -> Result<String> {
    let mut read = || -> io::Result<String> {
        let mut hash = Sha256::new();
        let mut buffer = vec![0; 1 << 16];
        loop {
            let count = file.read(&mut buffer)?;
            if count == 0 {
                break;
            }
            hash.update(buffer.get(..count).unwrap_or_default());
        }
        Ok(hex(&hash.finalize()))
    };
    read().map_err(|e| unreadable(path, &e))
}

/// Two lower-case digits for each byte.
pub fn hex(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(2 * bytes.len());
    for byte in bytes {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

/// Opens it to be read.
///
/// # Errors
/// It can't be read.
pub fn open(path: &Path) -> Result<File> {
    File::open(path).map_err(|e| unreadable(path, &e))
}

/// The complaint about a file that can't be read.
pub fn unreadable(path: &Path, error: &io::Error) -> anyhow::Error {
    anyhow!("{}: can't be read ({error}); check the path and its permissions", path.display())
}

/// The complaint about a file that can't be written.
pub fn unwritable(path: &Path, error: &io::Error) -> anyhow::Error {
    // A temporary file's error names that file, which means nothing to the user.
    let cause = error.to_string();
    let cause = cause.split(" at path ").next().unwrap_or_default();
    anyhow!(
        "{}: can't be written ({cause}); check that its folder exists, can be written and has room",
        path.display()
    )
}

/// Writes the file at `path` through a temporary one beside it: what was there survives any failure. A link is
/// followed, and a file that is there already keeps its permissions.
///
/// # Errors
/// `path` leads to something other than an ordinary file, the folder can't be written or is full, or `write` fails.
pub fn replace(path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let complain = |e: io::Error| unwritable(path, &e);
    let (target, old) = target(path)?;
    let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    // A temporary file is its owner's alone; an output is an ordinary file, as far as the umask allows.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut out = BufWriter::with_capacity(1 << 18, builder.tempfile_in(folder).map_err(complain)?);
    write(&mut out).map_err(|e| named(path, e))?;
    let file = out.into_inner().map_err(|e| complain(e.into_error()))?;
    if let Some(old) = old {
        file.as_file().set_permissions(old.permissions()).map_err(complain)?;
    }
    file.as_file().sync_all().map_err(complain)?;
    file.persist(target).map_err(|e| complain(e.error))?;
    Ok(())
}

/// Whether [`replace`] could write `path`, as far as can be told before: its folder is there, and nothing but an
/// ordinary file would be replaced.
///
/// # Errors
/// It could not.
pub fn check_target(path: &Path) -> Result<()> {
    let (target, _) = target(path)?;
    let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::read_dir(folder).map_err(|e| unwritable(path, &e))?;
    Ok(())
}

/// The file that a link leads to, and what is there already.
fn target(path: &Path) -> Result<(PathBuf, Option<std::fs::Metadata>)> {
    let complain = |e: io::Error| unwritable(path, &e);
    Ok(match std::fs::metadata(path) {
        Ok(old) if old.is_file() => (std::fs::canonicalize(path).map_err(complain)?, Some(old)),
        Ok(old) if old.is_dir() => bail!("{}: it is a folder; name a file", path.display()),
        Ok(_) => bail!("{}: it is no ordinary file; give a file's name", path.display()),
        Err(_) if path.is_symlink() => {
            bail!("{}: it is a link that leads nowhere; give a file's name", path.display())
        }
        Err(_) => (path.to_path_buf(), None),
    })
}

/// As [`replace`], but what takes a stream of bytes (a named pipe, `/dev/null`) is written straight.
///
/// # Errors
/// As [`replace`].
pub fn replace_or_stream(path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    if !takes_a_stream(path) {
        return replace(path, write);
    }
    let complain = |e: io::Error| unwritable(path, &e);
    let file = File::options().write(true).open(path).map_err(complain)?;
    let mut out = BufWriter::with_capacity(1 << 18, file);
    write(&mut out).map_err(|e| named(path, e))?;
    out.flush().map_err(complain)
}

#[cfg(unix)]
fn takes_a_stream(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|m| m.file_type().is_char_device() || m.file_type().is_fifo())
}

#[cfg(not(unix))]
fn takes_a_stream(_: &Path) -> bool {
    false
}

/// The operating system's errors with the file's name; others tell enough.
fn named(path: &Path, error: anyhow::Error) -> anyhow::Error {
    match error.chain().find_map(|cause| cause.downcast_ref::<io::Error>()) {
        Some(cause) => unwritable(path, cause),
        None => error,
    }
}

/// Makes sure that no output is an input or another output, also under another name.
///
/// # Errors
/// One is.
pub fn refuse_overwrite<P: AsRef<Path>>(outputs: &[P], inputs: &[&Path]) -> Result<()> {
    for (i, output) in outputs.iter().map(AsRef::as_ref).enumerate() {
        if let Some(input) = inputs.iter().find(|input| same_file(output, input)) {
            bail!("{}: the output is the input {}; name another file", output.display(), input.display());
        }
        if let Some(other) = outputs[..i].iter().map(AsRef::as_ref).find(|other| same_file(output, other)) {
            bail!("{}: it is also the output {}; name another file", output.display(), other.display());
        }
    }
    Ok(())
}

fn same_file(a: &Path, b: &Path) -> bool {
    if place(a) == place(b) {
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

/// Where a path leads, as far as it exists.
fn place(path: &Path) -> PathBuf {
    if let Ok(found) = std::fs::canonicalize(path) {
        return found;
    }
    match (path.parent(), path.file_name()) {
        (Some(folder), Some(name)) if folder.as_os_str().is_empty() => place(Path::new(".")).join(name),
        (Some(folder), Some(name)) => place(folder).join(name),
        _ => path.to_path_buf(),
    }
}

/// Makes a folder and those above it.
///
/// # Errors
/// It can't be made.
pub fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| unwritable(path, &e))
}

/// An error with its causes, but for those that an outer message tells already.
pub fn message(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |told, cause| match told.as_str() {
        "" => cause,
        _ if told.contains(&cause) => told,
        _ => format!("{told}: {cause}"),
    })
}
