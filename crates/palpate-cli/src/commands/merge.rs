//! `palpate merge`.

use super::Failure;
use super::precompute::{beside, tell};
use crate::console;
use palpate_build::precompute::assemble::{self, Report};
use palpate_build::precompute::merge;
use palpate_files as files;
use std::path::{Path, PathBuf};

/// Join the shards of a simulation into a body
///
/// The body, and BODY.paths beside it, have the same bytes as from one run.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  palpate merge liver-1.paths liver-2.paths -o liver.body\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
pub struct Args {
    /// The outputs of `palpate precompute --shard`: all of them, in any order
    #[arg(value_name = "SHARD", required = true)]
    shards: Vec<PathBuf>,
    /// Body file to write
    #[arg(short, long, value_name = "BODY")]
    output: PathBuf,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let record = beside(&args.output, ".paths");
    let inputs: Vec<&Path> = args.shards.iter().map(PathBuf::as_path).collect();
    files::refuse_overwrite(&[&args.output, &record], &inputs)?;
    files::check_target(&args.output)?;
    let whole = merge(&args.shards)?;
    let assembled = assemble::body(&whole)?;
    whole.save(&record)?;
    assembled.body.save(&args.output)?;
    tell(&args.output, &record, &assembled);
    if args.json {
        console::json(&Report::new(&whole, assembled))?;
    }
    Ok(())
}
