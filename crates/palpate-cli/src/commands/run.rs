//! `palpate run`.

use super::Failure;
use crate::closed_loop::{self, LoopSummary, Setup};
use crate::console;
use anyhow::{anyhow, bail};
use palpate_body::Body;
use palpate_device::presets;
use palpate_engine::Ablation;
use palpate_files as files;
use palpate_runtime::motion::{MotionScript, NAMES};
use palpate_runtime::trace::{COLUMNS, count, write_row};
use std::path::{Path, PathBuf};

/// Close the loop: a device, a hand and a body
///
/// Against the clock, with one device or several on one body, until the time is over or a signal comes (Ctrl-C): a
/// real-time thread renders the force on a patch of the body, another keeps that patch under the tool. Any fault
/// brings the force to zero within two periods and closes the device. The summary tells lateness, step times,
/// overruns, page faults, waits for a patch and energies; with --json, a line a second and a last one. --record writes
/// all that the loop saw and did, which `palpate trace` repeats to the bit and `palpate export` makes tables of.
///
/// A simulated device is a tool of mass, damping and friction in a hand that presses, drags, circles or taps. With
/// --virtual-time it runs deterministic and much faster than the clock; then the summary tells energies (of the
/// engine's port, the ledger, the device, the hand), limit cycles while the hand rests, and the largest step of the
/// force, and --record writes a Trace CSV.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    palpate run liver.body --device dhd --force-max-n 2 --record first-touch.rec\n  \
    palpate run liver.body --device simulated --seconds 10\n  \
    palpate run liver.body --device simulated --virtual-time --preset touch --intent drag --record drag.csv\n\n\
    Exit status: 0 done, 1 wrong input or a device that failed, 2 wrong usage.")]
pub struct Args {
    /// Body file
    pub(super) body: PathBuf,
    /// What is in the hand: simulated[:PRESET], dhd[:INDEX], openhaptics[:NAME], haply[:ID] or replay:FILE (a recording or
    /// a Path CSV); may be given again for another hand
    #[arg(long, value_name = "KIND", required = true, value_parser = DeviceName::parse)]
    pub(super) device: Vec<DeviceName>,
    /// A simulated device without a clock, as fast as the machine can
    #[arg(long)]
    virtual_time: bool,
    /// Which device is simulated
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(presets::DEVICES),
          default_value = "touch")]
    pub(super) preset: String,
    /// Whose hand holds it
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(presets::HANDS),
          default_value = "fingers")]
    pub(super) hand: String,
    /// What the hand does: press, drag, circle, tap, hold, or a TOML file
    #[arg(long, value_name = "FILE|NAME", default_value = "drag")]
    pub(super) intent: String,
    /// Periods a second
    #[arg(long, value_name = "N", default_value_t = 1000.0)]
    pub(super) rate_hz: f64,
    /// How long; without it, as long as the motion script or replay, and with a real device until a signal comes
    #[arg(long, value_name = "S")]
    pub(super) seconds: Option<f64>,
    /// Interpolation to take away, as in the paper's section 5
    #[arg(long, value_enum)]
    pub(super) ablate: Option<super::Ablate>,
    /// Slip rule; without it, the body's own
    #[arg(long, value_enum)]
    pub(super) slip: Option<super::Slip>,
    /// Let slip give out energy, where the body's tank would hold it back
    #[arg(long)]
    pub(super) no_tank: bool,
    /// Touch the body through a virtual coupling of this stiffness
    #[arg(long, value_name = "K")]
    pub(super) coupling_n_per_m: Option<f64>,
    /// Let a passivity controller take back energy that the loop gives out
    #[arg(long)]
    pub(super) passivity: bool,
    /// Recording to write, one for each device; in virtual time a Trace CSV, as `palpate trace` writes it
    #[arg(long, value_name = "FILE")]
    pub(super) record: Vec<PathBuf>,
    /// Print the output as JSON
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) live: super::live::LiveArgs,
}

/// A device as `--device` names it, and which one of its kind.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum DeviceName {
    Simulated(Option<String>),
    Dhd(Option<u8>),
    OpenHaptics(Option<String>),
    Haply(Option<String>),
    Replay(PathBuf),
}

impl DeviceName {
    fn parse(text: &str) -> Result<Self, String> {
        let (kind, which) = text.split_once(':').map_or((text, None), |(k, w)| (k, Some(w)));
        let name = which.map(String::from);
        match (kind, which) {
            (_, Some("")) => Err(format!("nothing comes after {kind}:")),
            ("simulated", _) => Ok(DeviceName::Simulated(name)),
            ("openhaptics", _) => Ok(DeviceName::OpenHaptics(name)),
            ("haply", _) => Ok(DeviceName::Haply(name)),
            ("replay", Some(file)) => Ok(DeviceName::Replay(file.into())),
            ("replay", None) => Err("name the file: replay:FILE".into()),
            ("dhd", None) => Ok(DeviceName::Dhd(None)),
            ("dhd", Some(index)) => match index.parse() {
                Ok(index) => Ok(DeviceName::Dhd(Some(index))),
                Err(_) => Err(format!("{index} is no device's number; count from 0")),
            },
            _ => Err("give simulated, dhd, openhaptics, haply or replay:FILE".into()),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    if !args.virtual_time {
        return super::live::run(args);
    }
    if !matches!(args.device.as_slice(), [DeviceName::Simulated(_)]) || args.record.len() > 1 {
        return Err(
            anyhow!("--virtual-time: give one simulated device, and at most one file to record").into()
        );
    }
    let mut inputs = vec![args.body.as_path()];
    // A built-in intent's name is no file's.
    if !NAMES.contains(&args.intent.as_str()) {
        inputs.push(Path::new(&args.intent));
    }
    files::refuse_overwrite(&args.record.iter().collect::<Vec<_>>(), &inputs)?;
    let body = Body::open(&args.body)?;
    let setup = setup(args, &body)?;
    let ablation = setup.ablation;
    let summary = match args.record.first() {
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

/// What goes for both clocks.
pub(super) fn check(args: &Args) -> anyhow::Result<()> {
    if args.seconds.is_some_and(|s| !(s > 0.0 && s <= 1e5)) {
        bail!("--seconds {}: give a time above 0, up to 100,000 s", args.seconds.unwrap_or_default());
    }
    if args.coupling_n_per_m.is_some_and(|k| !(k > 0.0 && k <= 1e7)) {
        bail!("--coupling-n-per-m: give a stiffness above 0, up to 10,000,000 N/m");
    }
    Ok(())
}

fn setup(args: &Args, body: &Body) -> anyhow::Result<Setup> {
    if !(args.rate_hz >= 10.0 && args.rate_hz <= 1e6) {
        bail!("--rate-hz {}: give a rate from 10 to 1,000,000 Hz", args.rate_hz);
    }
    check(args)?;
    let intent = MotionScript::find(&args.intent, body)?;
    let preset = match args.device.first() {
        Some(DeviceName::Simulated(Some(preset))) => preset,
        _ => &args.preset,
    };
    let mut capabilities = presets::device(preset)
        .ok_or_else(|| anyhow!("--device simulated:{preset}: give one of {}", presets::DEVICES.join(", ")))?;
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
        no_tank: args.no_tank,
        ablation: args.ablate.map_or(Ablation::None, super::Ablate::ablation),
        coupling_n_per_m: args.coupling_n_per_m,
        passivity: args.passivity,
    })
}

/// The summary in words.
fn told(s: &LoopSummary) -> String {
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
