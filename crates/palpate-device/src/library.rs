//! A vendor's library, found and opened at run time: palpate builds and ships without any SDK.

use crate::OpenError;
use libloading::Library;
use std::ffi::{CStr, c_char};
use std::path::Path;

/// Opens the library at `path`, or else the first of `names` that the system's loader finds.
///
/// # Errors
/// None of them opens. The problem says what was tried and why each failed, the correct is `hint`.
pub(crate) fn open(
    device: &str,
    path: Option<&Path>,
    names: &[&str],
    hint: &str,
) -> Result<Library, OpenError> {
    let mut tried = Vec::new();
    let candidates: Vec<&Path> = path.map_or_else(|| names.iter().map(Path::new).collect(), |p| vec![p]);
    for candidate in candidates {
        #[allow(unsafe_code, reason = "a vendor's library can only be opened at run time")]
        // SAFETY: opening runs the library's own initialisers. That it is what its name says is the user's word.
        match unsafe { Library::new(candidate) } {
            Ok(library) => return Ok(library),
            Err(error) => tried.push(reason(candidate, &error)),
        }
    }
    let place = if path.is_some() { String::new() } else { format!(" where the loader looks ({SEARCHED})") };
    let problem = format!("its library doesn't open{place}: {}", tried.join("; "));
    Err(OpenError { device: device.into(), problem, hint: hint.into() })
}

/// Where the loader looks for a bare name.
const SEARCHED: &str = if cfg!(windows) {
    "the program's folder and PATH"
} else if cfg!(target_os = "macos") {
    "DYLD_LIBRARY_PATH and the system's folders"
} else {
    "LD_LIBRARY_PATH and ldconfig's folders"
};

/// The loader's own words, led by the name where they don't tell it.
fn reason(candidate: &Path, error: &libloading::Error) -> String {
    let mut text = error.to_string();
    let mut source = std::error::Error::source(error);
    while let Some(inner) = source {
        text = inner.to_string();
        source = inner.source();
    }
    let name = candidate.display().to_string();
    if text.contains(&name) { text } else { format!("{name}: {text}") }
}

/// The function `name` of `library`, of the type that the caller's prototype says.
///
/// # Errors
/// The library has no such symbol: its name.
///
/// # Safety
/// `T` must be a function pointer of the symbol's real type, called no longer than the library is open.
#[allow(unsafe_code, reason = "a symbol's type is only known from its prototype")]
pub(crate) unsafe fn symbol<T: Copy>(library: &Library, name: &'static str) -> Result<T, &'static str> {
    // SAFETY: the caller's promise.
    unsafe { library.get::<T>(name) }.map(|symbol| *symbol).map_err(|_| name)
}

/// Declares a struct of a vendor's functions: own prototypes, by the vendor's names, and the library that holds them.
/// Those that are `plain` take and give numbers and handles, and become safe methods; those that are `raw` write to or
/// keep what they are pointed to, and are called where it is seen what that is.
macro_rules! prototypes {
    (
        $(#[$doc:meta])* $seen:vis $name:ident
        plain { $($plain:ident = $plain_symbol:ident($($argument:ident: $type:ty),*) $(-> $result:ty)?;)* }
        raw { $($raw:ident = $raw_symbol:ident($($raw_type:ty),*) $(-> $raw_result:ty)?;)* }
        optional { $($may:ident = $may_symbol:ident($($may_type:ty),*) $(-> $may_result:ty)?;)* }
    ) => {
        $(#[$doc])*
        #[derive(Debug)]
        $seen struct $name {
            $($plain: unsafe extern "C" fn($($type),*) $(-> $result)?,)*
            $($raw: unsafe extern "C" fn($($raw_type),*) $(-> $raw_result)?,)*
            $($may: Option<unsafe extern "C" fn($($may_type),*) $(-> $may_result)?>,)*
            /// The functions live as long as it is open. It stays so until the program ends: a thread of the vendor's may
            /// still run in it, also when all that is known of has been stopped.
            _library: std::mem::ManuallyDrop<libloading::Library>,
        }

        #[allow(unsafe_code, reason = "a symbol's type is only known from its prototype")]
        #[allow(clippy::too_many_arguments, reason = "the vendor's function has so many")]
        impl $name {
            /// Looks all names up; the error is the name that is missing.
            $seen fn of(library: libloading::Library) -> Result<Self, &'static str> {
                // SAFETY: the prototypes are the vendor's, and the library stays open beside them.
                unsafe {
                    Ok($name {
                        $($plain: crate::library::symbol(&library, stringify!($plain_symbol))?,)*
                        $($raw: crate::library::symbol(&library, stringify!($raw_symbol))?,)*
                        $($may: crate::library::symbol(&library, stringify!($may_symbol)).ok(),)*
                        _library: std::mem::ManuallyDrop::new(library),
                    })
                }
            }

            $($seen fn $plain(&self $(, $argument: $type)*) $(-> $result)? {
                // SAFETY: the prototype is the vendor's, the library is open, and nothing is pointed to.
                unsafe { (self.$plain)($($argument),*) }
            })*
        }
    };
}
pub(crate) use prototypes;

/// A vendor's string, or a word in the place of none.
pub(crate) fn text(from: *const c_char) -> String {
    if from.is_null() {
        return "no reason given".into();
    }
    #[allow(unsafe_code, reason = "the vendor's text is a C string")]
    // SAFETY: the vendor gives a string that ends in 0.
    unsafe { CStr::from_ptr(from) }.to_string_lossy().into_owned()
}
