//! The `palpate` command.

use clap::{CommandFactory as _, Parser};
use palpate_cli::commands::{self, Failure};
use std::process::ExitCode;

/// Touch soft, nonlinear bodies: force-deflection curves at the nodes, a force that is continuous everywhere.
#[derive(Parser)]
#[command(name = "palpate", version = palpate::VERSION, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Demo(commands::demo::Args),
    Fit(commands::fit::Args),
    Precompute(commands::precompute::Args),
    Merge(commands::merge::Args),
    Refine(commands::refine::Args),
    Inspect(commands::inspect::Args),
    Validate(commands::validate::Args),
    Certify(commands::certify::Args),
    Trace(commands::trace::Args),
    Run(Box<commands::run::Args>),
    View(Box<commands::view::Args>),
    Devices(commands::devices::Args),
    Export(commands::export::Args),
    Bench(commands::bench::Args),
    Completions(commands::shell::CompletionsArgs),
    Man(commands::shell::ManArgs),
}

fn main() -> ExitCode {
    // clap exits with 2 on a usage error by itself.
    let result = match Cli::parse().command {
        Command::Demo(args) => commands::demo::run(&args),
        Command::Fit(args) => commands::fit::run(&args),
        Command::Precompute(args) => commands::precompute::run(&args),
        Command::Merge(args) => commands::merge::run(&args),
        Command::Refine(args) => commands::refine::run(&args),
        Command::Inspect(args) => commands::inspect::run(&args),
        Command::Validate(args) => commands::validate::run(&args),
        Command::Certify(args) => commands::certify::run(&args),
        Command::Trace(args) => commands::trace::run(&args),
        Command::Run(args) => commands::run::run(&args),
        Command::View(args) => commands::view::run(&args),
        Command::Devices(args) => commands::devices::run(&args),
        Command::Export(args) => commands::export::run(&args),
        Command::Bench(args) => commands::bench::run(&args),
        Command::Completions(args) => commands::shell::completions(&args, Cli::command()),
        Command::Man(args) => commands::shell::man(&args, Cli::command()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Input(error)) => {
            palpate_cli::console::complain(&palpate_files::message(&error));
            ExitCode::from(1)
        }
        Err(Failure::Check(message)) => {
            palpate_cli::console::complain(&message);
            ExitCode::from(3)
        }
        Err(Failure::Loop(message)) => {
            palpate_cli::console::complain(&message);
            ExitCode::from(4)
        }
        Err(Failure::Interrupted(message)) => {
            palpate_cli::console::complain(&message);
            ExitCode::from(130)
        }
    }
}
