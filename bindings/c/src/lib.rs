//! palpate's C interface: the functions and structs of `include/palpate.h`, which is generated from this crate and checked
//! against it by a test.
//!
//! | file | what of the header |
//! |---|---|
//! | `status.rs` | statuses, the error struct, and the border that no panic crosses |
//! | `handles.rs` | the tables that handles point into: what is closed, or in use elsewhere, is a status |
//! | `body.rs`, `make.rs` | bodies: opened, inspected; made of arrays, or from a spec |
//! | `certify.rs` | certificates: what is proved of a body, and what a device's loop can hold |
//! | `contact.rs`, `rollout.rs` | the step, snapshots, ledger; paths, one or many on all cores |
//! | `session.rs`, `device.rs` | sessions; a device of the caller's |
//!
//! Functions are `unsafe` in Rust since they take pointers: the header's first page says what a pointer must be. Nothing here
//! computes: every function checks what it is given and calls the crate `palpate`.

#![allow(
    unsafe_code,
    reason = "a C interface takes pointers and exports symbols; what they must be is in the header"
)]
#![allow(non_camel_case_types, reason = "types have the names that C sees")]
#![allow(clippy::missing_safety_doc, reason = "the header's first page says it once for all functions")]

mod body;
mod certify;
mod contact;
mod device;
mod handles;
mod make;
mod rollout;
mod session;
mod status;

pub use body::*;
pub use certify::*;
pub use contact::*;
pub use device::*;
pub use handles::{palpate_body, palpate_contact, palpate_session};
pub use make::*;
pub use rollout::*;
pub use session::*;
pub use status::*;

use std::ffi::c_char;

/// The interface's version. It is raised whenever a struct, a constant or a function's parameters change; functions and constants
/// that are only added leave it. Structs that live longer than a call carry it (`abi_version`).
pub const PALPATE_ABI_VERSION: u32 = 2;

/// `palpate_features`: the drivers of vendors' devices are built in.
pub const PALPATE_FEATURE_DEVICES: u32 = 1;
/// `palpate_features`: bodies are made from specs (`palpate_body_from_spec`).
pub const PALPATE_FEATURE_BUILD: u32 = 2;

/// The library's version of the interface, to be compared with the header's `PALPATE_ABI_VERSION`.
/// Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_abi_version() -> u32 {
    PALPATE_ABI_VERSION
}

/// `PALPATE_STATUS_OK` if the library serves programs that were compiled with a header of version `abi_version`, else
/// `PALPATE_STATUS_WRONG_VERSION`. Call it first, as `palpate_check_abi(PALPATE_ABI_VERSION)`.
/// Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_check_abi(abi_version: u32) -> palpate_status {
    if abi_version == PALPATE_ABI_VERSION { PALPATE_STATUS_OK } else { PALPATE_STATUS_WRONG_VERSION }
}

/// The library's version, commit and features, such as "0.1.0 (commit 0123456789ab; features: devices, simulate)": a string that
/// lives as long as the library. Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_version() -> *const c_char {
    VERSION.as_ptr().cast()
}

/// With the zero that ends a string in C.
static VERSION: [u8; palpate::VERSION.len() + 1] = {
    let (mut text, mut k) = ([0; _], 0);
    while k < palpate::VERSION.len() {
        text[k] = palpate::VERSION.as_bytes()[k];
        k += 1;
    }
    text
};

/// What is built in: a sum of `PALPATE_FEATURE_...`. Real-time: O(1).
#[unsafe(no_mangle)]
pub extern "C" fn palpate_features() -> u32 {
    let devices = if cfg!(feature = "devices") { PALPATE_FEATURE_DEVICES } else { 0 };
    let build = if cfg!(feature = "build") { PALPATE_FEATURE_BUILD } else { 0 };
    devices | build
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_version_ends_in_a_zero() {
        // SAFETY: what this test shows.
        let text = unsafe { std::ffi::CStr::from_ptr(super::palpate_version()) };
        assert_eq!(text.to_str().unwrap(), palpate::VERSION);
    }
}
