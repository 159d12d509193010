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
    #[cfg(not(feature = "viewer"))]
    if !args.headless {
        console::note(super::view::HOW);
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
    // On a display, the body that was touched, for the mouse.
    #[cfg(feature = "viewer")]
    if !args.headless && palpate_viewer::window::has_display() {
        let request = palpate_viewer::command::Request {
            body: Some(args.out.join("cylinder.body")),
            ..Default::default()
        };
        let is_asked = crate::live::signals()?;
        palpate_viewer::command::open(&request, Box::new(move |_| is_asked()))
            .map_err(|e| anyhow::anyhow!("{e}"))?;
    }
    if report.passed { Ok(()) } else { Err(Failure::Check(report.shortfalls.join("; "))) }
}
