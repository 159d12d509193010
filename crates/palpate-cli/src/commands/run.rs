//! `palpate run`.

use super::Failure;
use super::run_options::{self, LiveArgs};
use crate::console;
use crate::live::{self, Told};
use anyhow::anyhow;
use palpate_body::Body;
use palpate_device::presets;
use palpate_files as files;
use palpate_runtime::motion::NAMES;
use palpate_runtime::trace::{COLUMNS, count, write_row};
use palpate_runtime::{
    BodyIn, ClockChoice, DeviceChoice, LoopSummary, MemoryLock, PreparedSession, SessionBody, SessionConfig,
    SessionError, run_virtual,
};
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
/// --virtual-time it runs deterministic and much faster than the clock, with the same limits; then the summary tells
/// energies (of the engine's port, the ledger, the device, the hand), limit cycles while the hand rests, and the largest
/// step of the force, and --record writes a Trace CSV.
///
/// All of it can stand in a file, --config run.toml; options go before what is there.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    palpate run liver.body --device dhd --force-max-n 2 --record first-touch.rec\n  \
    palpate run liver.body --device simulated --seconds 10\n  \
    palpate run liver.body --config bench.toml --json --stream-hz 60\n  \
    palpate run liver.body --device simulated --virtual-time --preset touch --intent drag --record drag.csv\n\n\
    Exit status: 0 done, 1 wrong input, 2 wrong usage, 3 --strict and something could not be had, 4 a loop ended badly: a \
    device that failed, a watchdog that tripped.")]
pub struct Args {
    /// Body file
    pub(super) body: PathBuf,
    /// What is in the hand: simulated[:PRESET], dhd[:INDEX], openhaptics[:NAME], haply[:ID] or replay:FILE (a recording or
    /// a Path CSV); may be given again for another hand
    #[arg(long, value_name = "KIND", required_unless_present = "config")]
    pub(super) device: Vec<DeviceChoice>,
    /// Settings from a TOML file: docs/session.md
    #[arg(long, value_name = "FILE")]
    pub(super) config: Option<PathBuf>,
    /// A simulated device without a clock, as fast as the machine can
    #[arg(long)]
    virtual_time: bool,
    /// Which device is simulated [default: touch]
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(presets::DEVICES))]
    pub(super) preset: Option<String>,
    /// Whose hand holds it [default: fingers]
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(presets::HANDS))]
    pub(super) hand: Option<String>,
    /// What the hand does: press, drag, circle, tap, hold, or a TOML file [default: drag]
    #[arg(long, value_name = "FILE|NAME")]
    pub(super) intent: Option<String>,
    /// Periods a second [default: 1000]
    #[arg(long, value_name = "N")]
    pub(super) rate_hz: Option<f64>,
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
    /// Let the contact slip as a whole, where the body has two contact points side by side
    #[arg(long)]
    pub(super) no_partial_slip: bool,
    /// Multiply the body's friction coefficients by this
    #[arg(long, value_name = "X")]
    pub(super) friction_scale: Option<f64>,
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
    /// With --json, a line with poses and forces this many times a second
    #[arg(long, value_name = "N", requires = "json")]
    stream_hz: Option<f64>,
    /// See it in a window while it runs
    #[arg(long, conflicts_with_all = ["virtual_time", "json"])]
    view: bool,
    #[command(flatten)]
    pub(super) live: LiveArgs,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let configs = run_options::configs(args)?;
    match &configs[..] {
        [config] if config.clock == ClockChoice::Virtual && args.view => {
            Err(anyhow!("--view: virtual time passes in no time; leave out one of both").into())
        }
        [config] if config.clock == ClockChoice::Virtual => virtual_time(args, config),
        configs => against_the_clock(args, configs),
    }
}

impl Args {
    /// Whether virtual time was asked for by option.
    pub(super) fn is_virtual(&self) -> bool {
        self.virtual_time
    }

    /// The files that are read.
    fn inputs<'a>(&'a self, configs: &'a [SessionConfig]) -> Vec<&'a Path> {
        let mut inputs: Vec<&Path> = vec![&self.body];
        inputs.extend(self.config.as_deref());
        for config in configs {
            match &config.device {
                DeviceChoice::Replay(file) => inputs.push(file),
                // A built-in intent's name is no file's.
                DeviceChoice::Simulated(_) if !NAMES.contains(&config.motion.as_str()) => {
                    inputs.push(Path::new(&config.motion));
                }
                _ => {}
            }
        }
        inputs
    }
}

fn against_the_clock(args: &Args, configs: &[SessionConfig]) -> Result<(), Failure> {
    let records: Vec<&PathBuf> = configs.iter().filter_map(|c| c.record.as_ref()).collect();
    files::refuse_overwrite(&records, &args.inputs(configs))?;
    if let Some(csv) = records.iter().find(|f| f.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"))) {
        return Err(anyhow!(
            "--record {}: a recording is no CSV; name it otherwise, and make tables of it with `palpate export`",
            csv.display()
        )
        .into());
    }
    if let Some(hz) = args.stream_hz.filter(|hz| !(0.01..=1000.0).contains(hz)) {
        return Err(anyhow!("--stream-hz {hz}: give a rate from 0.01 to 1,000 Hz").into());
    }
    if args.view {
        return view(args, configs);
    }
    let slip = configs.first().and_then(|c| c.slip);
    let body = SessionBody::open(&args.body, slip, args.live.body_in.map(Into::into), !records.is_empty())?;
    // One for all: the end of one session's own would unlock the others.
    let memory = configs.iter().any(|c| c.real_time.lock_memory).then(MemoryLock::new);
    let is_asked = live::signals()?;
    let mut sessions = Vec::new();
    for config in configs {
        if !is_asked() {
            sessions.push(prepared(&body, config.clone(), memory.clone())?);
        }
    }
    if is_asked() {
        console::note("a signal asked for the end before it began");
        return Ok(());
    }
    let told = live::run(sessions, &is_asked, args.json, args.stream_hz)?;
    for told in &told {
        if args.json {
            console::text(&format!("{}\n", serde_json::to_string(told)?))?;
        } else {
            console::text(&told.table())?;
        }
    }
    told.iter().try_for_each(ended_well)
}

fn prepared(
    body: &SessionBody,
    config: SessionConfig,
    memory: Option<Result<MemoryLock, String>>,
) -> Result<PreparedSession, Failure> {
    match PreparedSession::new(body.clone(), config, memory) {
        Err(error @ SessionError::Strict { .. }) => Err(Failure::Check(format!("--strict: {error}"))),
        prepared => Ok(prepared?),
    }
}

fn ended_well(told: &Told) -> Result<(), Failure> {
    if told.well { Ok(()) } else { Err(Failure::Loop(format!("{}: {}", told.device, told.end))) }
}

/// In a window; the table at the end is that of any other run.
#[cfg(feature = "viewer")]
fn view(args: &Args, configs: &[SessionConfig]) -> Result<(), Failure> {
    let [config] = configs else {
        return Err(anyhow!("--view: a window shows one device; give one --device").into());
    };
    if args.live.body_in.is_some() {
        return Err(anyhow!("--view: a window has the whole body in memory; leave out --body-in").into());
    }
    // Before a device is opened.
    palpate_viewer::window::display().map_err(anyhow::Error::msg)?;
    let opened = palpate_viewer::work::Opened::read(&args.body).map_err(anyhow::Error::msg)?;
    let config = SessionConfig { history: palpate_viewer::touch::HISTORY, ..config.clone() };
    let is_asked = live::signals()?;
    let session = prepared(&opened.session_body(), config, None)?;
    let ends = is_asked.clone();
    let told = live::show(session, &is_asked, |session| {
        palpate_viewer::command::watch(opened, session, Box::new(move |_| ends())).map_err(|e| anyhow!("{e}"))
    });
    let Some(told) = told? else {
        return Err(Failure::Loop("the session did not begin".into()));
    };
    console::text(&told.table())?;
    ended_well(&told)
}

#[cfg(not(feature = "viewer"))]
fn view(_args: &Args, _configs: &[SessionConfig]) -> Result<(), Failure> {
    Err(anyhow!("--view: {}", super::view::HOW).into())
}

fn virtual_time(args: &Args, config: &SessionConfig) -> Result<(), Failure> {
    if args.stream_hz.is_some() {
        return Err(
            anyhow!("--stream-hz: virtual time has no rate to watch at; --record has every period").into()
        );
    }
    files::refuse_overwrite(
        &config.record.iter().collect::<Vec<_>>(),
        &args.inputs(std::slice::from_ref(config)),
    )?;
    // An option is meant for this clock; a file's recording may be one that was made against the other.
    if let Some(path) = config.record.as_ref().filter(|path| args.record.is_empty() && path.exists()) {
        return Err(
            anyhow!("record: {} is there already; name a Trace CSV with --record", path.display()).into()
        );
    }
    let body = Body::open(&args.body)?;
    let summary = match &config.record {
        None => run_virtual(&body, config, |_, _| Ok(()))?,
        Some(path) => {
            let mut summary = None;
            files::replace_or_stream(path, |out| {
                writeln!(out, "{COLUMNS}")?;
                summary =
                    Some(run_virtual(&body, config, |waypoint, output| write_row(out, waypoint, output))?);
                Ok(())
            })?;
            summary.unwrap_or_default()
        }
    };
    for warning in summary.warnings(&body, config.ablation) {
        console::note(&warning);
    }
    if args.json {
        console::json(&summary)?
    } else {
        console::text(&told(&summary))?
    }
    Ok(())
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
        ("largest force allowed".into(), format!("{} N", s.limits.force_max_n)),
        ("commands at that limit".into(), s.stages.get("saturated").copied().unwrap_or_default().to_string()),
        ("at the device's own".into(), s.saturations.to_string()),
    ];
    if let Some(p) = &s.passivity {
        rows.push(("passivity controller acted in".into(), count(p.active, "period")));
    }
    let rows: Vec<Vec<String>> =
        rows.into_iter().map(|(name, value): (String, String)| vec![name, value]).collect();
    console::table(&rows)
}

/// Where a body is while loops run on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Where {
    /// All of it in memory.
    Memory,
    /// In its file, of which patches are read.
    File,
}

impl From<Where> for BodyIn {
    fn from(place: Where) -> Self {
        match place {
            Where::Memory => BodyIn::Memory,
            Where::File => BodyIn::File,
        }
    }
}
