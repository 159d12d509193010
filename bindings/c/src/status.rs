//! Statuses, messages, and the border between C and Rust.

use palpate::BodyError;
use palpate::runtime::{ControlError, SessionError};
use std::any::Any;
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What every call returns: one of `PALPATE_STATUS_...`.
pub type palpate_status = i32;

/// Done.
pub const PALPATE_STATUS_OK: palpate_status = 0;
/// A pointer that must not be null is null, or not aligned.
pub const PALPATE_STATUS_NULL: palpate_status = 1;
/// A struct's `struct_size` is not the one of this version: set it to the struct's size, as the `..._INIT` macros do.
pub const PALPATE_STATUS_WRONG_SIZE: palpate_status = 2;
/// An `abi_version` is not the library's: program and library come from different versions.
pub const PALPATE_STATUS_WRONG_VERSION: palpate_status = 3;
/// The handle is of nothing that is open: it was closed, never opened, or is of another kind.
pub const PALPATE_STATUS_CLOSED: palpate_status = 4;
/// Another thread is in a call with this handle. Nothing was done; the call may be repeated.
pub const PALPATE_STATUS_BUSY: palpate_status = 5;
/// The two contacts are of different bodies.
pub const PALPATE_STATUS_OTHER_BODY: palpate_status = 6;
/// A value that can't be; the message says which.
pub const PALPATE_STATUS_INVALID: palpate_status = 7;
/// A body, its file, or what it is made from was refused; the message names file and place.
pub const PALPATE_STATUS_BODY: palpate_status = 8;
/// A session, its device or a change of it was refused; the message says what to do.
pub const PALPATE_STATUS_SESSION: palpate_status = 9;
/// The caller's buffer is too small; what was asked for was cut, and the length it needs is told.
pub const PALPATE_STATUS_TOO_SMALL: palpate_status = 10;
/// The caller's progress function asked for the end.
pub const PALPATE_STATUS_CANCELLED: palpate_status = 11;
/// The library was built without this (`palpate_features`).
pub const PALPATE_STATUS_UNSUPPORTED: palpate_status = 12;
/// No record yet, or no contact: there is nothing to give.
pub const PALPATE_STATUS_NOTHING: palpate_status = 13;
/// A defect of the library: a panic was stopped at its border. The handle it was called with may be half changed: close it.
pub const PALPATE_STATUS_PANIC: palpate_status = 14;

/// Each status in words.
const WORDS: [(palpate_status, &str); 15] = [
    (PALPATE_STATUS_OK, "done\0"),
    (PALPATE_STATUS_NULL, "a pointer is null or not aligned; give one to what the header says\0"),
    (PALPATE_STATUS_WRONG_SIZE, "struct_size is not this version's; begin with the struct's INIT macro\0"),
    (
        PALPATE_STATUS_WRONG_VERSION,
        "header and library are of different versions; compile with this library's header\0",
    ),
    (PALPATE_STATUS_CLOSED, "the handle is not open; use it before it is closed, and with its own kind\0"),
    (
        PALPATE_STATUS_BUSY,
        "another thread is using the handle; repeat the call, or give each thread its own\0",
    ),
    (PALPATE_STATUS_OTHER_BODY, "the contacts are of different bodies; use contacts of one body\0"),
    (PALPATE_STATUS_INVALID, "a value can't be; see the message\0"),
    (PALPATE_STATUS_BODY, "the body was refused; see the message\0"),
    (PALPATE_STATUS_SESSION, "the session was refused; see the message\0"),
    (PALPATE_STATUS_TOO_SMALL, "the buffer is too small; give one of the length that was told\0"),
    (PALPATE_STATUS_CANCELLED, "ended because the progress function said so\0"),
    (PALPATE_STATUS_UNSUPPORTED, "the library was built without it; build it with the feature\0"),
    (PALPATE_STATUS_NOTHING, "there is nothing to give yet\0"),
    (PALPATE_STATUS_PANIC, "a defect of the library; close the handle, and report it\0"),
];

fn words(status: palpate_status) -> &'static str {
    WORDS.iter().find(|(s, _)| *s == status).map_or("no status of this version\0", |(_, words)| words)
}

/// A status in words: a string that lives as long as the library. Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_status_text(status: palpate_status) -> *const c_char {
    words(status).as_ptr().cast()
}

/// Bytes of a message, its final zero included.
pub const PALPATE_MESSAGE_BYTES: usize = 1016;

/// Where a call writes what was wrong. It belongs to the caller; a null pointer in its place forgoes the message.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct palpate_error {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// What the call returned.
    pub status: palpate_status,
    /// UTF-8 that ends in a zero: what was wrong, where, and how to mend it. Empty after `PALPATE_STATUS_OK`. A message that is too
    /// long is cut.
    pub message: [c_char; PALPATE_MESSAGE_BYTES],
}

/// Why a call failed.
#[derive(Debug)]
pub(crate) struct Failure {
    status: palpate_status,
    message: String,
}

impl Failure {
    pub fn new(status: palpate_status, message: impl Into<String>) -> Self {
        Failure { status, message: message.into() }
    }

    pub fn invalid(message: impl Into<String>) -> Self {
        Failure::new(PALPATE_STATUS_INVALID, message)
    }
}

impl From<palpate_status> for Failure {
    fn from(status: palpate_status) -> Self {
        Failure::new(status, words(status).trim_end_matches('\0'))
    }
}

impl From<BodyError> for Failure {
    fn from(error: BodyError) -> Self {
        Failure::new(PALPATE_STATUS_BODY, error.to_string())
    }
}

impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        Failure::new(PALPATE_STATUS_SESSION, error.to_string())
    }
}

impl From<ControlError> for Failure {
    fn from(error: ControlError) -> Self {
        Failure::new(PALPATE_STATUS_SESSION, error.to_string())
    }
}

/// Text that fits, ending in a zero and not within a character.
pub(crate) fn write_text(text: &str, to: &mut [c_char]) {
    let Some(room) = to.len().checked_sub(1) else { return };
    let mut end = text.len().min(room);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    for (to, byte) in to.iter_mut().zip(text.bytes().take(end).chain([0])) {
        *to = byte as c_char;
    }
}

/// What a panic said.
fn said(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("it gave no message")
}

/// Runs a call that may fail with a message. No panic crosses.
pub(crate) unsafe fn guarded(
    error: *mut palpate_error,
    call: impl FnOnce() -> Result<(), Failure>,
) -> palpate_status {
    let told = if error.is_null() {
        None
    } else {
        // SAFETY: the caller gives null or a pointer to an error struct.
        match unsafe { changed(error) } {
            Ok(error) => Some(error),
            Err(status) => return status,
        }
    };
    // What a panic leaves is looked at through a handle alone, and the status says that it may be half changed.
    let result = catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| {
        Err(Failure::new(PALPATE_STATUS_PANIC, format!("a defect of the library: {}", said(&*panic))))
    });
    let status = result.as_ref().map_or_else(|e| e.status, |()| PALPATE_STATUS_OK);
    if let Some(told) = told {
        told.status = status;
        write_text(result.as_ref().map_or_else(|e| &*e.message, |()| ""), &mut told.message);
    }
    status
}

/// Runs a call that tells no more than a status: it allocates nothing unless it panics.
#[inline]
pub(crate) fn quick(call: impl FnOnce() -> Result<(), palpate_status>) -> palpate_status {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(())) => PALPATE_STATUS_OK,
        Ok(Err(status)) => status,
        Err(_) => PALPATE_STATUS_PANIC,
    }
}

/// A struct of the interface whose first member is its size.
///
/// # Safety
/// `#[repr(C)]`, with a `u32` first.
pub(crate) unsafe trait Sized32: Copy {}

macro_rules! sized {
    ($($name:ty),+ $(,)?) => {
        $(
            // SAFETY: it is `repr(C)` and begins with `struct_size: u32`; a test compares it with the header.
            unsafe impl $crate::status::Sized32 for $name {}
        )+
    };
}
pub(crate) use sized;

sized!(palpate_error);

/// Whether a pointer can be followed as far as that can be seen.
#[inline]
fn usable<T>(pointer: *const T) -> Result<(), palpate_status> {
    if pointer.is_null() || !pointer.is_aligned() { Err(PALPATE_STATUS_NULL) } else { Ok(()) }
}

/// A caller's struct, if it has this version's size.
#[inline]
pub(crate) unsafe fn given<'a, T: Sized32>(pointer: *const T) -> Result<&'a T, palpate_status> {
    usable(pointer)?;
    // SAFETY: not null and aligned; the caller's struct begins with its size, which is looked at alone before the rest.
    if unsafe { pointer.cast::<u32>().read() } as usize != size_of::<T>() {
        return Err(PALPATE_STATUS_WRONG_SIZE);
    }
    // SAFETY: the caller says that so many bytes are there.
    Ok(unsafe { &*pointer })
}

/// A caller's struct that is written to, if it has this version's size.
#[inline]
pub(crate) unsafe fn changed<'a, T: Sized32>(pointer: *mut T) -> Result<&'a mut T, palpate_status> {
    // SAFETY: as the caller's.
    unsafe { given(pointer.cast_const()) }?;
    // SAFETY: looked at above; the caller lets nobody else read or write it during the call.
    Ok(unsafe { &mut *pointer })
}

/// A place for a result without a size of its own: a handle, a number.
pub(crate) unsafe fn place<'a, T: Copy>(pointer: *mut T) -> Result<&'a mut T, palpate_status> {
    usable(pointer)?;
    // SAFETY: not null and aligned; the caller gives a place for one.
    Ok(unsafe { &mut *pointer })
}

/// A caller's array; of none, any pointer will do.
pub(crate) unsafe fn array<'a, T: Copy>(pointer: *const T, count: usize) -> Result<&'a [T], palpate_status> {
    if count == 0 {
        return Ok(&[]);
    }
    usable(pointer)?;
    if count > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(PALPATE_STATUS_INVALID);
    }
    // SAFETY: not null and aligned, no longer than memory can be; the caller says that so many are there.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// A caller's array that is written to.
pub(crate) unsafe fn room<'a, T: Copy>(pointer: *mut T, count: usize) -> Result<&'a mut [T], palpate_status> {
    if count == 0 {
        return Ok(&mut []);
    }
    usable(pointer)?;
    if count > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(PALPATE_STATUS_INVALID);
    }
    // SAFETY: as in `array`; the caller lets nobody else read or write it during the call.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, count) })
}

/// A caller's string.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, what: &str) -> Result<&'a str, Failure> {
    usable(pointer)?;
    // SAFETY: not null; the caller's string ends in a zero.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| Failure::invalid(format!("{what} is no UTF-8; give it in UTF-8")))
}

/// Text into a caller's buffer, and the room that it needs, its final zero included.
pub(crate) unsafe fn give_text(
    text: &str,
    buffer: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> Result<(), palpate_status> {
    if !needed.is_null() {
        // SAFETY: not null; the caller gives a place for one.
        *unsafe { place(needed) }? = text.len() + 1;
    }
    // SAFETY: as the caller's.
    write_text(text, unsafe { room(buffer, capacity) }?);
    if capacity > text.len() { Ok(()) } else { Err(PALPATE_STATUS_TOO_SMALL) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error() -> palpate_error {
        palpate_error { struct_size: size_of::<palpate_error>() as u32, status: -1, message: [1; _] }
    }

    fn message(error: &palpate_error) -> String {
        let bytes: Vec<u8> = error.message.iter().take_while(|c| **c != 0).map(|c| *c as u8).collect();
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn no_panic_crosses_the_border() {
        let mut told = error();
        // SAFETY: `told` is an error struct.
        let status = unsafe { guarded(&mut told, || panic!("seven of {}", 9)) };
        assert_eq!((status, told.status), (PALPATE_STATUS_PANIC, PALPATE_STATUS_PANIC));
        assert_eq!(message(&told), "a defect of the library: seven of 9");
        assert_eq!(quick(|| panic!("alone")), PALPATE_STATUS_PANIC);
        // SAFETY: `told` is an error struct.
        assert_eq!(unsafe { guarded(&mut told, || Ok(())) }, PALPATE_STATUS_OK);
        assert_eq!(message(&told), "");
    }

    #[test]
    fn a_long_message_is_cut_between_characters() {
        let mut told = error();
        let long = "ü".repeat(600);
        // SAFETY: `told` is an error struct.
        unsafe { guarded(&mut told, || Err(Failure::invalid(long.clone()))) };
        let kept = message(&told);
        assert!(long.starts_with(&kept) && kept.len() == 1014, "{}", kept.len());
    }

    #[test]
    fn every_status_has_words() {
        for (k, (status, words)) in WORDS.into_iter().enumerate() {
            assert_eq!(status, k as i32);
            assert!(words.ends_with('\0') && words.matches('\0').count() == 1, "{words}");
        }
    }
}
