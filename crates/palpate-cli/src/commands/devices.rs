//! `palpate devices`.

use super::Failure;
use crate::console;
use palpate_device::{Basis, Capabilities, Figure, presets};
use palpate_runtime::{Attached, Drivers, attached};
use serde::Serialize;
use std::path::PathBuf;

/// Say what is attached, what it can do, and what of that nobody has verified
///
/// Each device is opened and closed again; no force is commanded but zero. Where none answers, what to install or start is
/// said. A figure that is not the device's own word or somebody's measurement is named as unverified.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  palpate devices\n  palpate devices --json\n\n\
                        Exit status: 0 done, whether there are any or not; 1 wrong input, 2 wrong usage.")]
pub struct Args {
    /// The vendor's library, where it is not found by its usual names
    #[arg(long, value_name = "FILE")]
    device_library: Option<PathBuf>,
    /// Haply's service, where it is not at its usual address
    #[arg(long, value_name = "URL")]
    device_url: Option<String>,
    /// Print JSON instead of the table
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    devices: Vec<Device>,
    unreached: Vec<Unreached>,
    /// Names of devices that can be simulated.
    simulated: [&'static str; 9],
}

#[derive(Serialize)]
struct Device {
    /// As `palpate run --device` takes it.
    device: String,
    name: String,
    max_force_n: f64,
    max_torque_nm: Option<f64>,
    max_stiffness_n_per_m: f64,
    half_extent_m: [f64; 3],
    sensed_rotations: u8,
    driven_rotations: u8,
    buttons: u32,
    usual_hz: f64,
    /// What could not be had.
    notes: Vec<String>,
    unverified: Vec<Unverified>,
}

/// A figure that rests on nobody's measurement of this device.
#[derive(Serialize)]
struct Unverified {
    figure: &'static str,
    because: String,
}

#[derive(Serialize)]
struct Unreached {
    device: String,
    reason: String,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let drivers = Drivers {
        library: args.device_library.clone(),
        url: args.device_url.clone(),
        // Nothing is rendered here.
        watchdog_required: false,
        ..Drivers::default()
    };
    let (found, unreached) = attached(&drivers);
    let unreached =
        unreached.into_iter().map(|u| Unreached { device: u.choice.to_string(), reason: u.reason });
    let report = Report {
        devices: found.iter().map(device).collect(),
        unreached: unreached.collect(),
        simulated: presets::DEVICES,
    };
    if args.json {
        console::json(&report)?;
    } else {
        console::text(&words(&report))?;
    }
    Ok(())
}

fn device(attached: &Attached) -> Device {
    let c = &attached.capabilities;
    Device {
        device: attached.choice.to_string(),
        name: c.name.to_string(),
        max_force_n: c.max_force_n.value,
        max_torque_nm: c.max_torque_nm.as_ref().map(|t| t.value),
        max_stiffness_n_per_m: c.max_stiffness_n_per_m.value,
        half_extent_m: c.workspace.half_extent_m,
        sensed_rotations: c.sensed.rotations,
        driven_rotations: c.driven.rotations,
        buttons: c.buttons,
        usual_hz: c.rates.usual_hz,
        notes: attached.notes.clone(),
        unverified: unverified(c),
    }
}

fn unverified(c: &Capabilities) -> Vec<Unverified> {
    let m = &c.mechanics;
    let figures: [(&'static str, Option<&Figure>); 10] = [
        ("max_force_n", Some(&c.max_force_n)),
        ("max_torque_nm", c.max_torque_nm.as_ref()),
        ("max_stiffness_n_per_m", Some(&c.max_stiffness_n_per_m)),
        ("velocity_delay_s", c.velocity_delay_s.as_ref()),
        ("mass_kg", Some(&m.mass_kg)),
        ("damping_n_s_per_m", Some(&m.damping_n_s_per_m)),
        ("coulomb_n", Some(&m.coulomb_n)),
        ("resolution_m", Some(&m.resolution_m)),
        ("delay_s", Some(&m.delay_s)),
        ("slew_n_per_s", Some(&m.slew_n_per_s)),
    ];
    let bases = figures.into_iter().filter_map(|(name, figure)| Some((name, &figure?.basis)));
    let bases = bases.chain([("half_extent_m", &c.workspace.basis)]);
    let unverified = bases.filter_map(|(figure, basis)| match basis {
        Basis::Measured(_) | Basis::Chosen => None,
        Basis::Stated(source) => Some(Unverified { figure, because: format!("stated by {source}") }),
        Basis::Guessed(reason) => Some(Unverified { figure, because: format!("guessed: {reason}") }),
    });
    unverified.collect()
}

fn words(report: &Report) -> String {
    let mut out = String::new();
    for d in &report.devices {
        let torque = d.max_torque_nm.map_or_else(|| "none".into(), |t| format!("{t} N·m"));
        let [x, y, z] = d.half_extent_m.map(|m| 2e3 * m);
        let mut rows = vec![
            ("device", d.device.clone()),
            ("name", d.name.clone()),
            ("largest force", format!("{} N", d.max_force_n)),
            ("largest torque", torque),
            ("stiffest wall", format!("{} N/m", d.max_stiffness_n_per_m)),
            ("workspace", format!("{x:.0} x {y:.0} x {z:.0} mm")),
            ("rotations sensed, driven", format!("{}, {}", d.sensed_rotations, d.driven_rotations)),
            ("buttons", d.buttons.to_string()),
            ("rate", format!("{} Hz", d.usual_hz)),
        ];
        rows.extend(d.notes.iter().map(|note| ("note", note.clone())));
        rows.extend(d.unverified.iter().map(|u| ("unverified", format!("{}, {}", u.figure, u.because))));
        for (name, value) in rows {
            out += &format!("{name:<26}{value}\n");
        }
        out.push('\n');
    }
    if report.devices.is_empty() {
        out += "no device answers:\n";
    }
    for u in &report.unreached {
        out += &format!("{:<26}{}\n", u.device, u.reason);
    }
    out + &format!("{:<26}simulated:NAME with one of {}\n", "always there", report.simulated.join(", "))
}
