//! `palpate demo`.

use super::Failure;
use crate::demo::{self, words};
use std::path::PathBuf;

/// The paper's experiment: a soft cylinder touched with and without interpolation; report, pictures and sound.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Run the scripted experiment without asking for a display.
    #[arg(long)]
    headless: bool,
    /// Folder for the results; it is made if need be.
    #[arg(long, value_name = "DIR", default_value = "palpate-demo")]
    out: PathBuf,
    /// Print report.json instead of the table.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// [`Failure::Input`] where the folder can't be written, [`Failure::Check`] where a bar was not reached.
pub fn run(args: &Args) -> Result<(), Failure> {
    if !args.headless {
        eprintln!("palpate: this version has no viewer yet; running the scripted experiment");
    }
    let report = demo::run(&args.out)?;
    if args.json {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        println!("{}", words::table(&report));
        println!(
            "{}: report.md explains it, with pictures and sound ({:.1} s)",
            args.out.display(),
            report.seconds
        );
    }
    if report.passed { Ok(()) } else { Err(Failure::Check(report.shortfalls.join("; "))) }
}
