//! `palpate completions` and `palpate man`: what shells and readers of manual pages want, from the parser itself.

use super::Failure;
use crate::console;
use anyhow::Context;
use palpate_files as files;
use std::path::{Path, PathBuf};

/// Print a completion script for a shell
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  palpate completions bash > ~/.local/share/bash-completion/completions/palpate\n\n\
                        Exit status: 0 done, 2 wrong usage."
)]
pub struct CompletionsArgs {
    /// Which shell
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

/// Write the manual pages: one for the program and one for each command
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  palpate man -o ~/.local/share/man/man1 && man palpate-run\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
pub struct ManArgs {
    /// Folder for palpate.1 and the like
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
}

/// Prints the script.
///
/// # Errors
/// See [`Failure`].
pub fn completions(args: &CompletionsArgs, mut command: clap::Command) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "palpate", &mut script);
    Ok(console::text(&String::from_utf8_lossy(&script))?)
}

/// Writes the pages.
///
/// # Errors
/// See [`Failure`].
pub fn man(args: &ManArgs, command: clap::Command) -> Result<(), Failure> {
    files::make_folder(&args.output)?;
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let commands: Vec<_> = command.get_subcommands().cloned().collect();
    for sub in commands {
        let name = format!("palpate-{}", sub.get_name());
        let title = name.to_uppercase();
        page(&args.output.join(format!("{name}.1")), sub, &title)?;
    }
    Ok(page(&args.output.join("palpate.1"), command, "PALPATE")?)
}

fn page(path: &Path, command: clap::Command, title: &str) -> anyhow::Result<()> {
    files::replace(path, |out| {
        clap_mangen::Man::new(command).title(title).render(out).with_context(|| path.display().to_string())
    })
}
