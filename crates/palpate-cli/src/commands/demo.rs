//! `palpate demo`.

use super::Failure;
use crate::console;
use crate::demo::{self, words};
use std::path::PathBuf;

/// Touch a soft cylinder with and without interpolation: the paper's experiment
///
/// A scripted tool presses, drags, circles and lets go at 1 kHz, in four settings: both interpolations, coordinates
/// off, responses off, both off. It writes report.md (start there), report.json, pictures, the force's rate as sound,
/// and the body and path to go on with.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  palpate demo --headless --out results\n\n\
                        Exit status: 0 passed, 1 wrong input, 2 wrong usage, 3 a bar was not reached.")]
pub struct Args {
    /// Run the scripted experiment without asking for a display
    #[arg(long)]
    headless: bool,
    /// Folder for the results; files of an earlier run are replaced
    #[arg(long, value_name = "DIR", default_value = "palpate-demo")]
    out: PathBuf,
    /// Print report.json instead of the table
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] where the folder can't be written, [`Failure::Check`] where a bar was not reached.
pub fn run(args: &Args) -> Result<(), Failure> {
    if !args.headless {
        console::note("this version has no viewer; running the scripted experiment");
    }
    let report = demo::run(&args.out)?;
    if args.json {
        console::json(&report)?;
    } else {
        let (table, folder) = (words::table(&report), args.out.display());
        console::text(&format!(
            "{table}\n{folder}: report.md explains it, with pictures and sound ({:.1} s)\n",
            report.seconds
        ))?;
    }
    if report.passed { Ok(()) } else { Err(Failure::Check(report.shortfalls.join("; "))) }
}
