//! `palpate run`.

use super::Failure;
use crate::closed_loop::{self, Setup, Summary};
use crate::intent::{Intent, NAMES};
use crate::trace::{COLUMNS, count, write_row};
use crate::{console, files};
use anyhow::{anyhow, bail};
use palpate_body::Body;
use palpate_device::presets;
use palpate_engine::Ablation;
use std::path::{Path, PathBuf};

/// Close the loop: a device, a hand and a body
///
/// In this version the device is simulated and the time virtual: a tool of mass, damping and friction, held by a hand
/// that presses, drags, circles or taps, with the device's encoder, delay, amplifier and force limit between it and
/// the engine. Deterministic, and much faster than real time.
///
/// The summary tells energies (of the engine's port, the ledger, the device's damping and friction, the hand), limit
/// cycles while the hand rests, the largest step of the force, and how often the motors were at their limit.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  \
    palpate run liver.body --device simulated --virtual-time --preset touch --intent drag --record drag.csv\n\n\
    Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
pub struct Args {
    /// Body file
    body: PathBuf,
    /// What is in the hand
    #[arg(long, value_enum)]
    device: DeviceName,
    /// Without a clock, as fast as the machine can: the only way in this version
    #[arg(long, required = true)]
    virtual_time: bool,
    /// Which device is simulated
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(presets::DEVICES),
          default_value = "touch")]
    preset: String,
    /// Whose hand holds it
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(presets::HANDS),
          default_value = "fingers")]
    hand: String,
    /// What the hand does: press, drag, circle, tap, hold, or a TOML file
    #[arg(long, value_name = "FILE|NAME", default_value = "drag")]
    intent: String,
    /// Periods a second
    #[arg(long, value_name = "N", default_value_t = 1000.0)]
    rate_hz: f64,
    /// How long; without it, as long as the intent
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Interpolation to take away, as in the paper's section 5
    #[arg(long, value_enum)]
    ablate: Option<super::Ablate>,
    /// Slip rule; without it, the body's own
    #[arg(long, value_enum)]
    slip: Option<super::Slip>,
    /// Touch the body through a virtual coupling of this stiffness
    #[arg(long, value_name = "K")]
    coupling_n_per_m: Option<f64>,
    /// Let a passivity controller take back energy that the loop gives out
    #[arg(long)]
    passivity: bool,
    /// Trace CSV to write, as `palpate trace` does
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum DeviceName {
    Simulated,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let DeviceName::Simulated = args.device;
    let mut inputs = vec![args.body.as_path()];
    // A built-in intent's name is no file's.
    if !NAMES.contains(&args.intent.as_str()) {
        inputs.push(Path::new(&args.intent));
    }
    files::refuse_overwrite(&args.record.iter().collect::<Vec<_>>(), &inputs)?;
    let body = Body::open(&args.body)?;
    let setup = setup(args, &body)?;
    let ablation = setup.ablation;
    let summary = match &args.record {
        None => closed_loop::run(&body, setup, |_, _| Ok(()))?,
        Some(path) => {
            let mut summary = None;
            files::replace_or_stream(path, |out| {
                writeln!(out, "{COLUMNS}")?;
                summary = Some(closed_loop::run(&body, setup, |waypoint, output| {
                    write_row(out, waypoint, output)
                })?);
                Ok(())
            })?;
            summary.unwrap_or_default()
        }
    };
    for warning in summary.warnings(&body, ablation) {
        console::note(&warning);
    }
    if args.json {
        console::json(&summary)?
    } else {
        console::text(&told(&summary))?
    }
    Ok(())
}

fn setup(args: &Args, body: &Body) -> anyhow::Result<Setup> {
    if !(args.rate_hz >= 10.0 && args.rate_hz <= 1e6) {
        bail!("--rate-hz {}: give a rate from 10 to 1,000,000 Hz", args.rate_hz);
    }
    if args.seconds.is_some_and(|s| !(s > 0.0 && s <= 1e5)) {
        bail!("--seconds {}: give a time above 0, up to 100,000 s", args.seconds.unwrap_or_default());
    }
    if args.coupling_n_per_m.is_some_and(|k| !(k > 0.0 && k <= 1e7)) {
        bail!("--coupling-n-per-m: give a stiffness above 0, up to 10,000,000 N/m");
    }
    let intent = Intent::find(&args.intent, body)?;
    let mut capabilities = presets::device(&args.preset)
        .ok_or_else(|| anyhow!("--preset {}: give one of {}", args.preset, presets::DEVICES.join(", ")))?;
    intent.adjust(&mut capabilities);
    let (hand, _) = presets::hand(&args.hand)
        .ok_or_else(|| anyhow!("--hand {}: give one of {}", args.hand, presets::HANDS.join(", ")))?;
    Ok(Setup {
        capabilities,
        hand: intent.hand.unwrap_or(hand),
        intent,
        rate_hz: args.rate_hz,
        seconds: args.seconds,
        slip: args.slip.map(super::Slip::rule),
        ablation: args.ablate.map_or(Ablation::None, super::Ablate::ablation),
        coupling_n_per_m: args.coupling_n_per_m,
        passivity: args.passivity,
    })
}

/// The summary in words.
fn told(s: &Summary) -> String {
    let t = &s.trace;
    let mj = |j: f64| format!("{:.4} mJ", j * 1e3);
    let mut rows = vec![
        ("device".into(), s.device.clone()),
        ("time".into(), format!("{} s at {} Hz", s.seconds, s.rate_hz)),
        ("contacts".into(), count(t.contacts, "contact")),
        ("largest force".into(), format!("{:.3} N", t.largest_force_n)),
        ("largest step".into(), format!("{:.2} mN", t.largest_step_n * 1e3)),
        ("given out by the engine".into(), mj(s.out_j)),
        ("stored at the end".into(), mj(t.energy.stored_j)),
        ("sampling lets out at most".into(), mj(s.sampling_bound_j)),
        ("generated by slip".into(), mj(t.energy.generated_j)),
        ("dissipated by slip".into(), mj(t.energy.dissipated_j)),
        ("by the device's damping".into(), mj(s.mechanics.viscous_j)),
        ("by the device's friction".into(), mj(s.mechanics.coulomb_j)),
        ("by the hand".into(), mj(s.mechanics.hand_damper_j)),
        ("work of the hand".into(), mj(s.mechanics.hand_j)),
        ("limit cycles".into(), s.limit_cycles.len().to_string()),
        ("commands at the force limit".into(), s.saturations.to_string()),
    ];
    if let Some(p) = &s.passivity {
        rows.push(("passivity controller acted in".into(), count(p.active, "period")));
    }
    let rows: Vec<Vec<String>> =
        rows.into_iter().map(|(name, value): (String, String)| vec![name, value]).collect();
    console::table(&rows)
}
