//! Builds a stand-in for a vendor's library, and lets a test talk to its own copy of it.

#![allow(dead_code, reason = "each test file uses its own part")]

use libloading::Library;
use std::ffi::{CStr, CString, OsString, c_char, c_void};
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// Where the built libraries of this test program lie.
pub struct Built {
    folder: TempDir,
    file: PathBuf,
}

/// The compiler beside the cargo that runs the test, or the one on the path.
fn rustc() -> OsString {
    let cargo = std::env::var_os("CARGO").map(PathBuf::from).unwrap_or_default();
    let beside = cargo.with_file_name(format!("rustc{}", std::env::consts::EXE_SUFFIX));
    if beside.is_file() { beside.into() } else { "rustc".into() }
}

impl Built {
    /// Compiles `tests/stand_ins/NAME.rs`.
    pub fn new(name: &str) -> Self {
        let folder = TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join(format!("../palpate-device/tests/stand_ins/{name}.rs"));
        let file = folder.path().join(libloading::library_filename(name));
        let built = Command::new(rustc())
            .args(["--crate-type", "cdylib", "--edition", "2024", "--crate-name", name, "-A", "warnings"])
            .args([source.as_os_str(), "-o".as_ref(), file.as_os_str()])
            .output()
            .expect("rustc runs");
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        Built { folder, file }
    }

    /// The library itself, which nobody has opened.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// A copy of its own, with its own log and settings.
    pub fn copy(&self) -> StandIn {
        let folder = TempDir::new_in(self.folder.path()).unwrap();
        let file = folder.path().join(self.file.file_name().unwrap());
        std::fs::copy(&self.file, &file).unwrap();
        #[allow(unsafe_code, reason = "a library can only be opened at run time")]
        // SAFETY: it is the one that was just built.
        let library = unsafe { Library::new(&file) }.unwrap();
        StandIn { library, file, _folder: folder }
    }
}

/// A library that stays open while the test looks at it, also after the driver has closed its own handle.
pub struct StandIn {
    library: Library,
    pub file: PathBuf,
    _folder: TempDir,
}

#[allow(unsafe_code, reason = "calls into the stand-in")]
impl StandIn {
    /// Tells it how to behave from now on.
    pub fn set(&self, name: &str, value: f64) {
        let name = CString::new(name).unwrap();
        // SAFETY: the type is that of record.rs.
        let set =
            unsafe { self.library.get::<unsafe extern "C" fn(*const c_char, f64)>("stand_in_set") }.unwrap();
        // SAFETY: a C string.
        unsafe { set(name.as_ptr(), value) }
    }

    /// The force that the stand-in's motors render at its time `now`, N in the vendor's axes.
    pub fn rendered(&self) -> [f64; 3] {
        // SAFETY: the type is that of dhd.rs.
        let ask = unsafe { self.library.get::<unsafe extern "C" fn(*mut f64)>("stand_in_rendered") }.unwrap();
        let mut force = [0.0; 3];
        // SAFETY: it writes three numbers.
        unsafe { ask(force.as_mut_ptr()) };
        force
    }

    /// The calls since the last time, in order.
    pub fn take_log(&self) -> Vec<String> {
        type Sink = extern "C" fn(*const c_char, *mut c_void);
        extern "C" fn push(call: *const c_char, to: *mut c_void) {
            // SAFETY: the stand-in hands back what it was given below, and a C string.
            let (to, call) = unsafe { (&mut *to.cast::<Vec<String>>(), CStr::from_ptr(call)) };
            to.push(call.to_str().unwrap().to_owned());
        }
        let mut calls = Vec::new();
        // SAFETY: the type is that of record.rs.
        let take =
            unsafe { self.library.get::<extern "C" fn(Sink, *mut c_void)>("stand_in_take_log") }.unwrap();
        take(push, (&raw mut calls).cast());
        calls
    }
}
