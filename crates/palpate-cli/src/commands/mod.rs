//! One module a subcommand: its arguments, and what it does with them.

pub mod bench;
pub mod certify;
pub mod demo;
pub mod devices;
pub mod export;
pub mod fit;
pub mod inspect;
pub mod merge;
pub mod precompute;
pub mod refine;
pub mod run;
mod run_options;
pub mod shell;
pub mod trace;
pub mod validate;
pub mod view;

use palpate_build::precompute::prepare::Interrupted;

/// A slip rule, as options name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Slip {
    /// The seed paper's: can generate energy, never clicks
    Paper,
    /// The paper's with the energy's gradient: generates next to none, never clicks
    Consistent,
    /// Down the energy's own slope: generates none, clicks where facets meet
    Exact,
}

impl Slip {
    /// The same in a body.
    pub fn rule(self) -> palpate_body::SlipRule {
        match self {
            Slip::Paper => palpate_body::SlipRule::Paper,
            Slip::Consistent => palpate_body::SlipRule::Consistent,
            Slip::Exact => palpate_body::SlipRule::Exact,
        }
    }
}

/// An interpolation to take away, as options name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Ablate {
    /// The elements' own frames
    Coordinates,
    /// The elements' mean responses
    Responses,
    /// Both of these
    Both,
}

impl Ablate {
    /// The same for a contact.
    pub fn ablation(self) -> palpate_engine::Ablation {
        match self {
            Ablate::Coordinates => palpate_engine::Ablation::Coordinates,
            Ablate::Responses => palpate_engine::Ablation::Responses,
            Ablate::Both => palpate_engine::Ablation::Both,
        }
    }
}

/// Why a command did not end with 0.
#[derive(Debug)]
pub enum Failure {
    /// The input was wrong: exit status 1, one message that says what, where, and how to correct it.
    Input(anyhow::Error),
    /// A check fell short: exit status 3.
    Check(String),
    /// A loop ended badly, a device or a watchdog: exit status 4.
    Loop(String),
    /// A signal stopped it, and what is done is kept: exit status 130.
    Interrupted(String),
}

impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        let error = error.into();
        match error.downcast_ref::<Interrupted>() {
            Some(interrupted) => Failure::Interrupted(interrupted.to_string()),
            None => Failure::Input(error),
        }
    }
}
