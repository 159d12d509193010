//! What users write and get: text, tables of numbers, TOML, and files that are replaced without loss.
//!
//! Every complaint is one message that names the file, the place in it, and the mend.

mod csv_table;
mod files;
mod source;

pub use csv_table::{Row, Table};
pub use files::{
    check_target, hex, make_folder, message, open, read_text, refuse_overwrite, replace, replace_or_stream,
    sha256, sha256_of, unreadable, unwritable,
};
pub use source::{List, Source};
