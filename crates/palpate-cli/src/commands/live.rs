//! `palpate run` against the clock.

use super::Failure;
use super::run::{Args, DeviceName};
use crate::console;
use crate::live::{self, BodyIn, Hold, LivePlan, Place};
use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::BodySource;
use palpate_device::{
    Dhd, DhdOptions, Haply, HaplyForceKey, HaplyOptions, OpenHaptics, OpenHapticsOptions, presets,
};
use palpate_engine::Ablation;
use palpate_files as files;
use palpate_runtime::motion::MotionScript;
use palpate_runtime::{BodyFile, GENTLE_N, Safety, Settings};
use std::path::{Path, PathBuf};

/// Half of the time after which drivers and devices take the force off, ms.
const SILENCE_MAX_MS: f64 = 10.0;

/// Options of a loop against the clock.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Against the clock")]
pub struct LiveArgs {
    /// Never a larger force than this, N; the device's own limit where that is lower [default: 3]
    #[arg(long, value_name = "N")]
    force_max_n: Option<f64>,
    /// Never a faster change of the force; at least half of the largest force a period, the default
    #[arg(long, value_name = "N/S")]
    slew_n_per_s: Option<f64>,
    /// How long the force takes to ramp up, s [default: 0.5]
    #[arg(long, value_name = "S")]
    soft_start_s: Option<f64>,
    /// Damping besides the device's own, N·s/m
    #[arg(long, value_name = "B")]
    damping_n_s_per_m: Option<f64>,
    /// How much longer a way is in the body than at the device [default: 1]
    #[arg(long, value_name = "X")]
    scale: Option<f64>,
    /// Where the device's origin is in the body's frame, mm; without it, the tool begins 20 mm above the body's top
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    offset_mm: Option<[f64; 3]>,
    /// How the device's frame is turned in the body's: a unit quaternion
    #[arg(long, value_name = "W,X,Y,Z", value_parser = numbers::<4>, allow_hyphen_values = true)]
    rotation: Option<[f64; 4]>,
    /// Button that lifts the tool off while it is held, as a mouse is lifted; counted from 0
    #[arg(long, value_name = "N")]
    clutch_button: Option<u32>,
    /// Priority of the haptic thread (SCHED_FIFO), 1 to 98; 0 asks for nothing
    #[arg(long, value_name = "N", default_value_t = 80)]
    priority: u8,
    /// How much of the way to each deadline is busy-waited, µs: less jitter, more of a core [default: 200, and at most two
    /// fifths of a period]
    #[arg(long, value_name = "US")]
    spin_us: Option<f64>,
    /// How late a period may come before the loop ends, ms: up to then the last force is held
    #[arg(long, value_name = "MS", default_value_t = 100.0)]
    late_ms: f64,
    /// How long the device may say nothing new before the loop ends, ms; after 20 ms there is no force
    #[arg(long, value_name = "MS", default_value_t = 100.0)]
    stale_ms: f64,
    /// How long the device may go without a command before the force begins anew, at zero, ms, up to 10: drivers and devices
    /// take the force off by themselves after 20 [default: as soon as a period is left out]
    #[arg(long, value_name = "MS")]
    silence_ms: Option<f64>,
    /// Use a Force Dimension device whose own watchdog can't be armed. It gives up the only thing that takes the force off when
    /// this program hangs or is killed: the device then renders its last force until it is switched off
    #[arg(long)]
    without_device_watchdog: bool,
    /// End with an error, before the first force, where anything could not be had: the device's watchdog or calibration, memory
    /// that stays, the priority, the core
    #[arg(long)]
    strict: bool,
    /// Elements of the patch that the haptic thread works on
    #[arg(long, value_name = "N", default_value_t = palpate_runtime::PATCH_ELEMENTS)]
    patch_elements: usize,
    /// Where the body is: all of it in memory, or in its file, of which patches are read [default: in its file from 1,048,576
    /// triangles on]
    #[arg(long, value_enum, value_name = "WHERE")]
    body_in: Option<BodyIn>,
    /// The vendor's library, where it is not found by its usual names
    #[arg(long, value_name = "FILE")]
    device_library: Option<PathBuf>,
    /// Haply's service, where it is not at its usual address
    #[arg(long, value_name = "URL")]
    device_url: Option<String>,
    /// How the service wants its forces: those of version 3.1 want `values`
    #[arg(long, value_name = "KEY", default_value = "vector", value_parser = ["vector", "values"])]
    haply_force_key: String,
}

/// As many numbers as an option wants.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values = text.split(',').map(|word| word.trim().parse()).collect::<Result<Vec<f64>, _>>();
    values
        .ok()
        .and_then(|v| v.try_into().ok())
        .ok_or_else(|| format!("give {N} numbers with commas between them"))
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let inputs = args.device.iter().filter_map(|d| match d {
        DeviceName::Replay(file) => Some(file.as_path()),
        _ => None,
    });
    let inputs: Vec<&Path> = inputs.chain([args.body.as_path()]).collect();
    files::refuse_overwrite(&args.record.iter().collect::<Vec<_>>(), &inputs)?;
    let mut plan = plan(args)?;
    let (body, file) = live::open_body(&args.body, plan.slip, args.live.body_in, !args.record.is_empty())?;
    plan.body = file;
    let holds = args.device.iter().map(|device| hold(args, device, &*body)).collect::<Result<Vec<_>>>()?;
    let told = live::run(&body, holds, &plan)?;
    for (told, _) in &told {
        if args.json {
            console::text(&format!("{}\n", serde_json::to_string(told)?))?;
        } else {
            console::text(&told.table())?;
        }
    }
    match told.iter().find(|(told, _)| !told.well) {
        Some((told, _)) => Err(anyhow!("{}: {}", told.device, told.end).into()),
        None => Ok(()),
    }
}

fn plan(args: &Args) -> Result<LivePlan> {
    let live = &args.live;
    super::run::check(args)?;
    if !(args.rate_hz >= 10.0 && args.rate_hz <= 2e4) {
        bail!("--rate-hz {}: give a rate from 10 to 20,000 Hz", args.rate_hz);
    }
    if !args.record.is_empty() && args.record.len() != args.device.len() {
        bail!("--record: give as many files as devices, or none");
    }
    if let Some(csv) =
        args.record.iter().find(|f| f.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")))
    {
        bail!(
            "--record {}: a recording is no CSV; name it otherwise, and make tables of it with `palpate export`",
            csv.display()
        );
    }
    if !(64..=1 << 18).contains(&live.patch_elements) {
        bail!("--patch-elements {}: give a number from 64 to 262,144", live.patch_elements);
    }
    if live.priority > 98 {
        bail!("--priority {}: give one from 0 to 98", live.priority);
    }
    if let Some(spin) = live.spin_us.filter(|us| !(0.0..=1e5).contains(us)) {
        bail!("--spin-us {spin}: give a time from 0 to 100,000 µs");
    }
    for (option, ms) in [("late", live.late_ms), ("stale", live.stale_ms)] {
        if !(1.0..=1e4).contains(&ms) {
            bail!("--{option}-ms {ms}: give a time from 1 to 10,000 ms");
        }
    }
    let period_ms = 1e3 / args.rate_hz;
    if let Some(ms) = live.silence_ms.filter(|ms| !(period_ms..=SILENCE_MAX_MS).contains(ms)) {
        bail!("--silence-ms {ms}: give a time from a period, {period_ms} ms, to {SILENCE_MAX_MS} ms");
    }
    let mut settings = Settings::new(args.rate_hz);
    (settings.patience.late_s, settings.patience.pose_s) = (live.late_ms * 1e-3, live.stale_ms * 1e-3);
    settings.real_time.spin_s = live.spin_us.map_or(settings.real_time.spin_s, |us| us * 1e-6);
    settings.seconds = args.seconds;
    settings.patch_elements = live.patch_elements;
    settings.real_time.priority = (live.priority > 0).then_some(live.priority);
    settings.real_time.own_core = live.priority > 0;
    let default = Safety::default();
    let safety = Safety {
        damping_n_s_per_m: live.damping_n_s_per_m.unwrap_or(0.0),
        passivity: args.passivity,
        soft_start_s: live.soft_start_s.unwrap_or(default.soft_start_s),
        silence_s: live.silence_ms.map(|ms| ms * 1e-3),
        force_max_n: live.force_max_n,
        slew_n_per_s: live.slew_n_per_s,
        ..default
    };
    let place = Place {
        scale: live.scale,
        offset_m: live.offset_mm.map(|mm| DVec3::from_array(mm) * 1e-3),
        rotation: live.rotation,
        clutch: live.clutch_button,
    };
    Ok(LivePlan {
        body: BodyFile::default(),
        settings,
        safety,
        slip: args.slip.map(super::Slip::rule),
        no_tank: args.no_tank,
        ablation: args.ablate.map_or(Ablation::None, super::Ablate::ablation),
        coupling_n_per_m: args.coupling_n_per_m,
        place,
        record: args.record.clone(),
        strict: live.strict,
        json: args.json,
    })
}

fn hold(args: &Args, device: &DeviceName, body: &dyn BodySource) -> Result<Hold> {
    let live = &args.live;
    let library = live.device_library.clone();
    // The driver and the vendor's library hold it too.
    let max_force_n = Some(live.force_max_n.unwrap_or(GENTLE_N));
    let real = |device| Hold { device, map: None, seconds: None, is_replay: false };
    Ok(match device {
        DeviceName::Simulated(preset) => {
            let preset = preset.as_deref().unwrap_or(&args.preset);
            let capabilities = presets::device(preset).ok_or_else(|| {
                anyhow!("--device simulated:{preset}: give one of {}", presets::DEVICES.join(", "))
            })?;
            let (hand, _) = presets::hand(&args.hand)
                .ok_or_else(|| anyhow!("--hand {}: give one of {}", args.hand, presets::HANDS.join(", ")))?;
            live::simulated(
                body,
                capabilities,
                hand,
                &MotionScript::find(&args.intent, body.model_header())?,
            )?
        }
        DeviceName::Replay(file) => live::replay(file, args.rate_hz)?,
        DeviceName::Dhd(index) => {
            let watchdog_required = !live.without_device_watchdog;
            let index = *index;
            let options =
                DhdOptions { library, index, max_force_n, watchdog_required, ..DhdOptions::default() };
            real(Box::new(Dhd::new(options)))
        }
        DeviceName::OpenHaptics(name) => {
            let name = name.clone();
            real(Box::new(OpenHaptics::new(OpenHapticsOptions {
                library,
                name,
                max_force_n,
                ..OpenHapticsOptions::default()
            })))
        }
        DeviceName::Haply(id) => {
            let default = HaplyOptions::default();
            let options = HaplyOptions {
                url: live.device_url.clone().unwrap_or(default.url.clone()),
                device_id: id.clone(),
                max_force_n,
                force_key: match live.haply_force_key.as_str() {
                    "values" => HaplyForceKey::Values,
                    _ => HaplyForceKey::Vector,
                },
                ..default
            };
            real(Box::new(Haply::new(options)))
        }
    })
}
