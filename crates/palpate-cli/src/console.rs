//! What goes to standard output and standard error. A reader that went away is no error.

use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// Prints one JSON document on standard output.
///
/// # Errors
/// Standard output can't be written, for another reason than that its reader is gone.
pub fn json(document: &impl Serialize) -> anyhow::Result<()> {
    text(&format!("{}\n", serde_json::to_string_pretty(document)?))
}

/// Prints text on standard output.
///
/// # Errors
/// As [`json`].
pub fn text(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(anyhow::Error::new(e).context("standard output can't be written; check where it goes to"))
        }
        _ => Ok(()),
    }
}

/// Says something on standard error.
pub fn note(message: &str) {
    // Nowhere is left to complain to.
    let _ = writeln!(std::io::stderr(), "palpate: {message}");
}

/// Says why the command failed, in one line.
pub fn complain(message: &str) {
    let lines = message.split(['\n', '\r']).map(str::trim).filter(|part| !part.is_empty());
    note(&lines.collect::<Vec<_>>().join("; "));
}

/// A table in columns: the first aligned left, the others right.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let cell = |row: &[String], c: usize| row.get(c).cloned().unwrap_or_default();
    let width = |c: usize| rows.iter().map(|r| cell(r, c).chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut out = String::new();
    for row in rows {
        let mut line = String::new();
        for (c, &w) in widths.iter().enumerate() {
            let text = cell(row, c);
            line += &if c == 0 { format!("{text:<w$}") } else { format!("  {text:>w$}") };
        }
        out += line.trim_end();
        out.push('\n');
    }
    out
}

/// Sets `cancelled` at the first signal to stop; the second ends the program at once, with status 130. Files are
/// renamed into place, so nothing is left half.
///
/// # Errors
/// Signals can't be handled.
pub fn stop_on_signals(cancelled: &'static AtomicBool) -> anyhow::Result<()> {
    let stop = move || {
        if cancelled.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(stop).map_err(|e| anyhow::anyhow!("signals can't be handled ({e})"))
}
