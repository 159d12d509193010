//! Devices and hands by name, for simulating them and for the sampled-data rule.
//!
//! Few figures here were measured. What a maker or another program states is named as such, and the rest is guessed:
//! good for seeing what a loop does, not for promising what a device will do. A user who knows better gives better ones.

use crate::simulated::Hand;
use crate::{Basis, Capabilities, Figure, Freedom, Mechanics, Pace, Rates, Workspace, Wrist};

/// The devices of [`device`].
pub const DEVICES: [&str; 9] =
    ["bench", "touch", "omni", "desktop", "omega", "delta", "sigma", "lambda", "falcon"];
/// The hands of [`hand`].
pub const HANDS: [&str; 3] = ["none", "fingers", "arm"];

/// One line of the table below.
struct Row {
    name: &'static str,
    max_force: f64,
    max_stiffness: f64,
    mass: Figure,
    damping: Figure,
    coulomb: Figure,
    resolution: Figure,
    /// Half extents, m.
    reach: [f64; 3],
    rotations: [u8; 2],
    most_hz: f64,
}

const CHAI3D: &str = "the settings of CHAI3D, another program";
const H3D: &str = "the Falcon's page in the wiki of H3DAPI, another program";
const SHEET: &str = "unverified: from memory of the maker's data sheet";
const DRIVES: &str = "the order of size for drives of this kind; not published";

/// A device by its name, or `None`.
///
/// `bench` is a tool on paper: 0.1 kg with 0.3 N·s/m and nothing else, the device that the sampled-data rule is shown
/// with.
pub fn device(name: &str) -> Option<Capabilities> {
    let guess = |value| Figure::guessed(value, DRIVES);
    let sheet = |value| Figure::guessed(value, SHEET);
    let touch = |name, max_stiffness| Row {
        name,
        max_force: 3.3,
        max_stiffness,
        mass: sheet(0.045),
        damping: guess(0.2),
        coulomb: sheet(0.26),
        resolution: sheet(0.055e-3),
        reach: [0.08, 0.035, 0.06],
        rotations: [3, 0],
        most_hz: 1000.0,
    };
    let parallel = |name, max_force, max_stiffness, mass, rotations| Row {
        name,
        max_force,
        max_stiffness,
        mass: guess(mass),
        damping: guess(1.0),
        coulomb: guess(0.3),
        resolution: sheet(0.01e-3),
        reach: [0.08, 0.055, 0.08],
        rotations,
        most_hz: 4000.0,
    };
    Some(match name {
        "bench" => bench(),
        "touch" => row(touch("3D Systems Touch", 400.0)),
        "omni" => row(touch("SensAble PHANToM Omni", 700.0)),
        "desktop" => row(Row {
            max_force: 7.9,
            damping: guess(0.1),
            coulomb: sheet(0.06),
            resolution: sheet(0.023e-3),
            reach: [0.08, 0.06, 0.06],
            ..touch("SensAble PHANToM Desktop", 1000.0)
        }),
        "omega" => row(parallel("Force Dimension omega", 12.0, 5000.0, 0.2, [0, 0])),
        "delta" => row(Row {
            reach: [0.2, 0.13, 0.2],
            damping: guess(2.0),
            ..parallel("Force Dimension delta.3", 20.0, 5000.0, 0.35, [0, 0])
        }),
        "sigma" => row(parallel("Force Dimension sigma.7", 12.0, 4000.0, 0.35, [3, 3])),
        "lambda" => row(parallel("Force Dimension lambda.7", 12.0, 8000.0, 0.35, [3, 3])),
        "falcon" => row(Row {
            resolution: Figure::stated(25.4e-3 / 400.0, H3D),
            coulomb: guess(0.5),
            reach: [0.05; 3],
            most_hz: 1000.0,
            ..parallel("Novint Falcon", 8.0, 3000.0, 0.25, [0, 0])
        }),
        _ => return None,
    })
}

fn row(row: Row) -> Capabilities {
    let [sensed, driven] = row.rotations;
    Capabilities {
        name: row.name.into(),
        max_force_n: Figure::stated(row.max_force, CHAI3D),
        max_torque_nm: (driven > 0).then(|| Figure::guessed(0.1, DRIVES)),
        max_stiffness_n_per_m: Figure::stated(row.max_stiffness, CHAI3D),
        workspace: Workspace {
            centre_m: [0.0; 3],
            half_extent_m: row.reach,
            basis: Basis::Guessed(SHEET.into()),
        },
        sensed: Freedom { translations: 3, rotations: sensed },
        driven: Freedom { translations: 3, rotations: driven },
        buttons: 1,
        rates: Rates { least_hz: 0.0, usual_hz: 1000.0, most_hz: row.most_hz },
        pace: Pace::Loop,
        velocity_delay_s: None,
        mechanics: Mechanics {
            mass_kg: row.mass,
            damping_n_s_per_m: row.damping,
            coulomb_n: row.coulomb,
            resolution_m: row.resolution,
            delay_s: Figure::guessed(
                0.2e-3,
                "a force's way over USB within its frame of 1 ms; not published",
            ),
            lag_s: Figure::guessed(0.2e-3, "current loops of some kHz; not published"),
            slew_n_per_s: Figure::guessed(f64::INFINITY, "no limit is published"),
            wrist: (driven > 0).then(|| Wrist {
                // A handle of 0.1 kg with its masses 3 cm from the middle.
                inertia_kg_m2: Figure::guessed(1e-4, DRIVES),
                damping_nm_s_per_rad: Figure::guessed(5e-4, DRIVES),
                coulomb_nm: Figure::guessed(2e-3, DRIVES),
                resolution_rad: Figure::guessed(2e-4, DRIVES),
                slew_nm_per_s: Figure::guessed(f64::INFINITY, "no limit is published"),
            }),
        },
    }
}

fn bench() -> Capabilities {
    let zero = || Figure::chosen(0.0);
    Capabilities {
        name: "bench".into(),
        max_force_n: Figure::chosen(100.0),
        max_torque_nm: None,
        // 2b/T at 1 kHz.
        max_stiffness_n_per_m: Figure::chosen(600.0),
        workspace: Workspace { centre_m: [0.0; 3], half_extent_m: [0.1; 3], basis: Basis::Chosen },
        sensed: Freedom { translations: 3, rotations: 0 },
        driven: Freedom { translations: 3, rotations: 0 },
        buttons: 0,
        rates: Rates { least_hz: 0.0, usual_hz: 1000.0, most_hz: f64::INFINITY },
        pace: Pace::Loop,
        velocity_delay_s: None,
        mechanics: Mechanics {
            mass_kg: Figure::chosen(0.1),
            damping_n_s_per_m: Figure::chosen(0.3),
            coulomb_n: zero(),
            resolution_m: zero(),
            delay_s: zero(),
            lag_s: zero(),
            slew_n_per_s: Figure::chosen(f64::INFINITY),
            wrist: None,
        },
    }
}

/// A hand by its name, and what its figures rest on, or `None`.
pub fn hand(name: &str) -> Option<(Hand, Basis)> {
    let hand = |mass_kg, damping_n_s_per_m, stiffness_n_per_m| Hand {
        mass_kg,
        damping_n_s_per_m,
        stiffness_n_per_m,
        ..Hand::default()
    };
    Some(match name {
        "none" => (Hand::default(), Basis::Chosen),
        "fingers" => (
            hand(0.01, 2.0, 300.0),
            Basis::Guessed(
                "a pen held lightly: about 10 g move with it; spring and damper of a soft grip".into(),
            ),
        ),
        "arm" => (
            hand(0.554, 6.45, 135.0),
            Basis::Measured(
                "one trial of one person on a HapticMaster (Scientific Reports 5, 18004, figure 3)".into(),
            ),
        ),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_known() {
        for name in DEVICES {
            let device = device(name).unwrap();
            assert!(device.max_force_n.value > 0.0 && device.mechanics.mass_kg.value > 0.0, "{name}");
        }
        assert!(HANDS.iter().all(|name| hand(name).is_some()));
        assert!(device("pencil").is_none() && hand("tail").is_none());
    }

    /// Only what somebody measured may say so.
    #[test]
    fn no_device_is_called_measured() {
        for name in DEVICES {
            let Capabilities { max_force_n, mechanics: m, .. } = device(name).unwrap();
            for figure in [max_force_n, m.mass_kg, m.damping_n_s_per_m, m.coulomb_n, m.resolution_m, m.lag_s]
            {
                assert!(!matches!(figure.basis, Basis::Measured(_)), "{name}");
            }
        }
    }
}
