//! The options of `palpate run` as a configuration of its sessions.

use super::run::{Args, Where};
use anyhow::{Result, bail};
use palpate_runtime::{ClockChoice, DeviceChoice, ForceKey, SessionConfig};
use std::path::PathBuf;

/// Half of the time after which drivers and devices take the force off, ms.
const SILENCE_MAX_MS: f64 = 10.0;

/// Options of a loop against the clock.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Against the clock")]
pub struct LiveArgs {
    /// Never a larger force than this, N; the device's own limit where that is lower [default: 3]
    #[arg(long, value_name = "N")]
    force_max_n: Option<f64>,
    /// Never a larger torque than this, N·m; the device's own limit where that is lower [default: 0.1]
    #[arg(long, value_name = "NM")]
    torque_max_nm: Option<f64>,
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
    /// Where the tool's tip is in the handle's frame, mm: a force there is a torque at the handle
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    tip_mm: Option<[f64; 3]>,
    /// Button that lifts the tool off while it is held, as a mouse is lifted; counted from 0
    #[arg(long, value_name = "N")]
    clutch_button: Option<u32>,
    /// Priority of the haptic thread (SCHED_FIFO), 1 to 98; 0 asks for nothing [default: 80]
    #[arg(long, value_name = "N")]
    priority: Option<u8>,
    /// How much of the way to each deadline is busy-waited, µs: less jitter, more of a core [default: 200, and at most two
    /// fifths of a period]
    #[arg(long, value_name = "US")]
    spin_us: Option<f64>,
    /// How late a period may come before the loop ends, ms: up to then the last force is held
    /// [default: 100]
    #[arg(long, value_name = "MS")]
    late_ms: Option<f64>,
    /// How long the device may say nothing new before the loop ends, ms; after 20 ms there is no force
    /// [default: 100]
    #[arg(long, value_name = "MS")]
    stale_ms: Option<f64>,
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
    /// Elements of the patch that the haptic thread works on [default: 8192]
    #[arg(long, value_name = "N")]
    patch_elements: Option<usize>,
    /// Where the body is: all of it in memory, or in its file, of which patches are read [default: in its file from 1,048,576
    /// triangles on]
    #[arg(long, value_enum, value_name = "WHERE")]
    pub(super) body_in: Option<Where>,
    /// The vendor's library, where it is not found by its usual names
    #[arg(long, value_name = "FILE")]
    device_library: Option<PathBuf>,
    /// Haply's service, where it is not at its usual address
    #[arg(long, value_name = "URL")]
    device_url: Option<String>,
    /// How the service wants its forces: those of version 3.1 want `values` [default: vector]
    #[arg(long, value_name = "KEY", value_parser = ["vector", "values"])]
    haply_force_key: Option<String>,
}

/// As many numbers as an option wants.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values = text.split(',').map(|word| word.trim().parse()).collect::<Result<Vec<f64>, _>>();
    values
        .ok()
        .and_then(|v| v.try_into().ok())
        .ok_or_else(|| format!("give {N} numbers with commas between them"))
}

/// A configuration for each device: what the file says, and the options before it.
///
/// # Errors
/// The file can't be read; a value that can't be; an option that does not apply.
pub(super) fn configs(args: &Args) -> Result<Vec<SessionConfig>> {
    let mut config =
        args.config.as_deref().map_or_else(|| Ok(SessionConfig::default()), SessionConfig::read)?;
    let devices = match &args.device[..] {
        [] => vec![config.device.clone()],
        given => given.to_vec(),
    };
    common(args, &mut config)?;
    live(args, &mut config)?;
    let is_virtual = config.clock == ClockChoice::Virtual;
    if is_virtual && (!matches!(devices[..], [DeviceChoice::Simulated(_)]) || args.record.len() > 1) {
        bail!("--virtual-time: give one simulated device, and at most one file to record");
    }
    applies(args, &devices, is_virtual)?;
    if devices.len() > 1 && config.record.is_some() && args.record.is_empty() {
        bail!(
            "record: the file names one recording, and there are several devices; give as many --record as devices"
        );
    }
    if !args.record.is_empty() && args.record.len() != devices.len() {
        bail!("--record: give as many files as devices, or none");
    }
    let mut configs = Vec::new();
    for (i, device) in devices.into_iter().enumerate() {
        let mut one = SessionConfig { device, ..config.clone() };
        if let (DeviceChoice::Simulated(preset), Some(given)) = (&mut one.device, &args.preset)
            && (preset.is_none() || args.device.is_empty())
        {
            *preset = Some(given.clone());
        }
        one.record = args.record.get(i).cloned().or(one.record);
        // A core for each haptic thread.
        one.real_time.core = one.real_time.core.map(|core| core.saturating_add(i as u32));
        one.check()?;
        configs.push(one);
    }
    Ok(configs)
}

/// What goes for both clocks.
fn common(args: &Args, config: &mut SessionConfig) -> Result<()> {
    if args.is_virtual() {
        config.clock = ClockChoice::Virtual;
    }
    if let Some(s) = args.seconds.filter(|s| !(*s > 0.0 && *s <= 1e5)) {
        bail!("--seconds {s}: give a time above 0, up to 100,000 s");
    }
    if args.coupling_n_per_m.is_some_and(|k| !(k > 0.0 && k <= 1e7)) {
        bail!("--coupling-n-per-m: give a stiffness above 0, up to 10,000,000 N/m");
    }
    let most = if config.clock == ClockChoice::Virtual { 1e6 } else { 2e4 };
    if let Some(hz) = args.rate_hz.filter(|hz| !(10.0..=most).contains(hz)) {
        bail!("--rate-hz {hz}: give a rate from 10 to {most} Hz");
    }
    if let Some(scale) = args.friction_scale.filter(|x| !(0.0..=100.0).contains(x)) {
        bail!("--friction-scale {scale}: give a number from 0 to 100");
    }
    config.rate_hz = args.rate_hz.unwrap_or(config.rate_hz);
    config.seconds = args.seconds.or(config.seconds);
    config.hand = args.hand.clone().unwrap_or(std::mem::take(&mut config.hand));
    config.motion = args.intent.clone().unwrap_or(std::mem::take(&mut config.motion));
    config.slip = args.slip.map(super::Slip::rule).or(config.slip);
    config.ablation = args.ablate.map_or(config.ablation, super::Ablate::ablation);
    config.tank &= !args.no_tank;
    config.partial_slip &= !args.no_partial_slip;
    config.friction_scale = args.friction_scale.unwrap_or(config.friction_scale);
    config.coupling_n_per_m = args.coupling_n_per_m.or(config.coupling_n_per_m);
    config.safety.passivity |= args.passivity;
    Ok(())
}

/// What goes with devices, limits, and the clock.
fn live(args: &Args, config: &mut SessionConfig) -> Result<()> {
    let live = &args.live;
    if let Some(n) = live.patch_elements.filter(|n| !(64..=1 << 18).contains(n)) {
        bail!("--patch-elements {n}: give a number from 64 to 262,144");
    }
    if let Some(priority) = live.priority.filter(|p| *p > 98) {
        bail!("--priority {priority}: give one from 0 to 98");
    }
    if let Some(spin) = live.spin_us.filter(|us| !(0.0..=1e5).contains(us)) {
        bail!("--spin-us {spin}: give a time from 0 to 100,000 µs");
    }
    for (option, ms) in [("late", live.late_ms), ("stale", live.stale_ms)] {
        if let Some(ms) = ms.filter(|ms| !(1.0..=1e4).contains(ms)) {
            bail!("--{option}-ms {ms}: give a time from 1 to 10,000 ms");
        }
    }
    let period_ms = 1e3 / config.rate_hz;
    if let Some(ms) = live.silence_ms.filter(|ms| !(period_ms..=SILENCE_MAX_MS).contains(ms)) {
        bail!("--silence-ms {ms}: give a time from a period, {period_ms} ms, to {SILENCE_MAX_MS} ms");
    }
    let milli = |ms: f64| ms * 1e-3;
    let safety = &mut config.safety;
    safety.damping_n_s_per_m = live.damping_n_s_per_m.unwrap_or(safety.damping_n_s_per_m);
    safety.soft_start_s = live.soft_start_s.unwrap_or(safety.soft_start_s);
    safety.silence_s = live.silence_ms.map(milli).or(safety.silence_s);
    safety.force_max_n = live.force_max_n.or(safety.force_max_n);
    safety.torque_max_nm = live.torque_max_nm.or(safety.torque_max_nm);
    safety.slew_n_per_s = live.slew_n_per_s.or(safety.slew_n_per_s);
    let place = &mut config.workspace;
    place.scale = live.scale.or(place.scale);
    place.offset_m = live.offset_mm.map(|mm| mm.map(milli)).or(place.offset_m);
    place.tip_in_handle_m = live.tip_mm.map(|mm| mm.map(milli)).or(place.tip_in_handle_m);
    place.rotation = live.rotation.or(place.rotation);
    place.clutch_button = live.clutch_button.or(place.clutch_button);
    let patience = &mut config.patience;
    patience.late_s = live.late_ms.map_or(patience.late_s, milli);
    patience.pose_s = live.stale_ms.map_or(patience.pose_s, milli);
    let real_time = &mut config.real_time;
    real_time.spin_s = live.spin_us.map_or(real_time.spin_s, |us| us * 1e-6);
    if let Some(priority) = live.priority {
        real_time.priority = (priority > 0).then_some(priority);
        real_time.core = (priority > 0).then_some(real_time.core.unwrap_or_default());
    }
    config.patch_elements = live.patch_elements.unwrap_or(config.patch_elements);
    config.strict |= live.strict;
    let drivers = &mut config.drivers;
    drivers.library = live.device_library.clone().or(drivers.library.take());
    drivers.url = live.device_url.clone().or(drivers.url.take());
    drivers.watchdog_required &= !live.without_device_watchdog;
    match live.haply_force_key.as_deref() {
        Some("values") => drivers.haply_force_key = ForceKey::Values,
        Some(_) => drivers.haply_force_key = ForceKey::Vector,
        None => {}
    }
    Ok(())
}

/// An option that does not apply is an error: who gives it believes that it does something.
fn applies(args: &Args, devices: &[DeviceChoice], is_virtual: bool) -> Result<()> {
    let live = &args.live;
    let has = |what: fn(&DeviceChoice) -> bool| devices.iter().any(what);
    let simulated = has(|d| matches!(d, DeviceChoice::Simulated(_)));
    let haply = has(|d| matches!(d, DeviceChoice::Haply(_)));
    let dhd = has(|d| matches!(d, DeviceChoice::Dhd(_)));
    let library = dhd || has(|d| matches!(d, DeviceChoice::OpenHaptics(_)));
    let felt = has(|d| !matches!(d, DeviceChoice::Replay(_)));
    let unnamed = has(|d| matches!(d, DeviceChoice::Simulated(None))) || args.device.is_empty() && simulated;
    let rules = [
        (
            "--preset",
            args.preset.is_some(),
            unnamed,
            "it is for --device simulated without a name of its own",
        ),
        ("--hand", args.hand.is_some(), simulated, "it is for a simulated device"),
        ("--intent", args.intent.is_some(), simulated, "it is for a simulated device"),
        ("--device-url", live.device_url.is_some(), haply, "it is for --device haply"),
        ("--haply-force-key", live.haply_force_key.is_some(), haply, "it is for --device haply"),
        (
            "--device-library",
            live.device_library.is_some(),
            library,
            "it is for --device dhd and openhaptics",
        ),
        ("--without-device-watchdog", live.without_device_watchdog, dhd, "it is for --device dhd"),
        ("--soft-start-s", live.soft_start_s.is_some(), felt, "nobody feels a replay"),
        ("--silence-ms", live.silence_ms.is_some(), felt, "nobody feels a replay"),
        ("--stale-ms", live.stale_ms.is_some(), felt, "the poses of a replay may stand still"),
        ("--priority", live.priority.is_some(), !is_virtual, "virtual time has no thread of its own"),
        ("--spin-us", live.spin_us.is_some(), !is_virtual, "virtual time waits for no clock"),
        ("--late-ms", live.late_ms.is_some(), !is_virtual, "nothing is late in virtual time"),
        ("--stale-ms", live.stale_ms.is_some(), !is_virtual, "no pose is stale in virtual time"),
        ("--strict", live.strict, !is_virtual, "virtual time asks nothing of device or system"),
        (
            "--patch-elements",
            live.patch_elements.is_some(),
            !is_virtual,
            "virtual time steps on the whole body",
        ),
        ("--body-in", live.body_in.is_some(), !is_virtual, "virtual time steps on the whole body"),
    ];
    match rules.into_iter().find(|(_, given, applies, _)| *given && !applies) {
        Some((option, _, _, why)) => bail!("{option}: {why}; leave it out"),
        None => Ok(()),
    }
}
