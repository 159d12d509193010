//! What a simulated operator does: built in, or from a TOML file with the unit in every key.

use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::{BodySource, ContactModel, Extent};
use palpate_device::simulated::figures::{self, Allowed};
use palpate_device::simulated::{Hand, Move, Script};
use palpate_device::{Capabilities, Figure, Wrist};
use palpate_files::{List, Source, read_text};
use serde::Deserialize;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;

/// The names of the built-in motion scripts.
pub const NAMES: [&str; 5] = ["press", "drag", "circle", "tap", "hold"];

/// How far above the surface an operator begins if nothing else is said, m.
const CLEARANCE: f64 = 2e-3;

/// Moves and where they begin; and what of device and hand is other than the presets.
#[derive(Debug, Clone, Default)]
pub struct MotionScript {
    /// The surface point that is nearest to this is touched, m in the body's frame; without it, the top.
    pub at_m: Option<DVec3>,
    /// Drags go this way.
    pub along: Option<DVec3>,
    /// How far above the surface it begins, m.
    pub clearance_m: f64,
    /// One after the other.
    pub moves: Vec<Move>,
    /// Of the hand.
    pub hand: Option<Hand>,
    device: RawDevice,
    /// The file and line of its start, if it is from a file.
    start_place: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    start: Option<Spanned<RawStart>>,
    hand: Option<Spanned<RawHand>>,
    device: Option<Spanned<RawDevice>>,
    #[serde(rename = "move")]
    moves: Vec<Spanned<RawMove>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RawStart {
    at_mm: Option<List<3>>,
    along: Option<List<3>>,
    clearance_mm: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawHand {
    mass_kg: f64,
    damping_n_s_per_m: f64,
    stiffness_n_per_m: f64,
    #[serde(default)]
    inertia_kg_m2: f64,
    #[serde(default)]
    damping_nm_s_per_rad: f64,
    #[serde(default)]
    stiffness_nm_per_rad: f64,
}

/// Figures that replace a preset's.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawDevice {
    mass_kg: Option<f64>,
    damping_n_s_per_m: Option<f64>,
    coulomb_n: Option<f64>,
    resolution_mm: Option<f64>,
    delay_ms: Option<f64>,
    lag_ms: Option<f64>,
    slew_n_per_s: Option<f64>,
    max_force_n: Option<f64>,
    inertia_kg_m2: Option<f64>,
    damping_nm_s_per_rad: Option<f64>,
    coulomb_nm: Option<f64>,
    resolution_mrad: Option<f64>,
    slew_nm_per_s: Option<f64>,
    max_torque_nm: Option<f64>,
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum RawMove {
    Press {
        depth_mm: f64,
        seconds: f64,
    },
    Drag {
        along_mm: f64,
        #[serde(default)]
        across_mm: f64,
        seconds: f64,
    },
    Circle {
        radius_mm: f64,
        #[serde(default = "one")]
        turns: f64,
        seconds: f64,
    },
    Tap {
        depth_mm: f64,
        #[serde(default = "once")]
        times: u32,
        seconds: f64,
    },
    Hold {
        #[serde(default)]
        tremor_mm: f64,
        #[serde(default = "nine")]
        tremor_hz: f64,
        seconds: f64,
    },
    Push {
        force_n: f64,
        seconds: f64,
    },
    Turn {
        angles_deg: List<3>,
        seconds: f64,
    },
}

fn one() -> f64 {
    1.0
}

fn once() -> u32 {
    1
}

/// In the middle of what hands tremble with.
fn nine() -> f64 {
    9.0
}

/// Lengths that an operator can mean, mm: 10 m.
const LENGTH_MM: f64 = 1e4;
/// Angles that an operator can mean, degrees: ten turns.
const ANGLE_DEG: f64 = 3600.0;
/// The hand's aim is followed in stretches of a millisecond: this many Hz take four of them a turn.
const FREQUENCY_HZ: f64 = 250.0;

/// From −`most` to `most`.
fn within(most: f64) -> Allowed {
    Allowed { least: -most, most, none: true }
}

fn up_to(most: f64) -> Allowed {
    Allowed { least: 0.0, most, none: true }
}

impl RawMove {
    /// Each key, its value, and what it can be.
    fn figures(&self) -> Vec<(&'static str, f64, Allowed)> {
        let length = within(LENGTH_MM);
        let seconds = self.si().seconds();
        let turns = within(FREQUENCY_HZ * seconds);
        // First, since others depend on it.
        let mut figures = vec![("seconds", seconds, Allowed { least: 1e-3, most: 1e4, none: false })];
        figures.extend(match *self {
            RawMove::Press { depth_mm, .. } => vec![("depth_mm", depth_mm, length)],
            RawMove::Drag { along_mm, across_mm, .. } => {
                vec![("along_mm", along_mm, length), ("across_mm", across_mm, length)]
            }
            RawMove::Circle { radius_mm, turns: n, .. } => {
                vec![("radius_mm", radius_mm, length), ("turns", n, turns)]
            }
            RawMove::Tap { depth_mm, times, .. } => {
                vec![("depth_mm", depth_mm, length), ("times", f64::from(times), turns)]
            }
            RawMove::Hold { tremor_mm, tremor_hz, .. } => {
                vec![("tremor_mm", tremor_mm, length), ("tremor_hz", tremor_hz, up_to(FREQUENCY_HZ))]
            }
            RawMove::Push { force_n, .. } => vec![("force_n", force_n, within(figures::FORCE_N.most))],
            RawMove::Turn { angles_deg: List(degrees), .. } => {
                degrees.map(|angle| ("angles_deg", angle, within(ANGLE_DEG))).to_vec()
            }
        });
        figures
    }

    fn si(&self) -> Move {
        let m = |mm: f64| mm * 1e-3;
        match *self {
            RawMove::Press { depth_mm, seconds } => Move::Press { depth_m: m(depth_mm), seconds },
            RawMove::Drag { along_mm, across_mm, seconds } => {
                Move::Drag { along_m: m(along_mm), across_m: m(across_mm), seconds }
            }
            RawMove::Circle { radius_mm, turns, seconds } => {
                Move::Circle { radius_m: m(radius_mm), turns, seconds }
            }
            RawMove::Tap { depth_mm, times, seconds } => Move::Tap { depth_m: m(depth_mm), times, seconds },
            RawMove::Hold { tremor_mm, tremor_hz, seconds } => {
                Move::Hold { tremor_m: m(tremor_mm), tremor_hz, seconds }
            }
            RawMove::Push { force_n, seconds } => Move::Push { force_n, seconds },
            RawMove::Turn { angles_deg: List(degrees), seconds } => {
                Move::Turn { angles_rad: DVec3::from_array(degrees.map(f64::to_radians)), seconds }
            }
        }
    }
}

impl MotionScript {
    /// These moves, begun on the surface at the body's top.
    pub fn of(moves: Vec<Move>) -> Self {
        MotionScript { moves, ..MotionScript::default() }
    }

    /// A built-in intent by its name, sized by how deep the body's curves go; or else the file of that name.
    ///
    /// # Errors
    /// As [`MotionScript::read`]; and a name that is neither.
    pub fn find(name: &str, body: &ContactModel) -> Result<Self> {
        let depth = body.responses().depth_knots().values().last().copied().unwrap_or_default();
        if let Some(moves) = built_in(name, 0.6 * depth) {
            return Ok(MotionScript { clearance_m: CLEARANCE, ..MotionScript::of(moves) });
        }
        let path = Path::new(name);
        if !path.exists() && path.extension().is_none() {
            bail!("--intent {name}: no such intent; give one of {}, or a TOML file", NAMES.join(", "));
        }
        Self::read(path)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// It can't be read; an unknown or missing key; a value that is impossible. The message names the line.
    pub fn read(path: &Path) -> Result<Self> {
        let text = read_text(path)?;
        let source = Source { path, text: &text };
        let raw: Raw = toml::from_str(&text).map_err(|e| source.syntax(&e))?;
        let check = |table: Range<usize>, figures: &[(&str, f64, Allowed)]| {
            figures.iter().try_for_each(|(key, value, allowed)| {
                if allowed.holds(*value) {
                    return Ok(());
                }
                let place = source.find_key(table.clone(), key);
                Err(source.error(place, &format!("{key} is {value}"), &format!("give {allowed}")))
            })
        };
        if let Some(start) = &raw.start {
            check(start.span(), &start.get_ref().figures())?;
        }
        if let Some(hand) = &raw.hand {
            check(hand.span(), &hand.get_ref().figures())?;
        }
        if let Some(device) = &raw.device {
            check(device.span(), &device.get_ref().figures())?;
        }
        if raw.moves.is_empty() {
            return Err(anyhow!("{}: there is no move; add a [[move]]", path.display()));
        }
        for the_move in &raw.moves {
            check(the_move.span(), &the_move.get_ref().figures())?;
        }
        let start_place = Some(match &raw.start {
            Some(start) => source.place(source.find_key(start.span(), "along")),
            None => path.display().to_string(),
        });
        let start = raw.start.map(Spanned::into_inner).unwrap_or_default();
        Ok(MotionScript {
            at_m: start.at_mm.map(|List(mm)| DVec3::from_array(mm) * 1e-3),
            along: start.along.map(|List(v)| DVec3::from_array(v)),
            clearance_m: start.clearance_mm.map_or(CLEARANCE, |mm| mm * 1e-3),
            moves: raw.moves.iter().map(|m| m.get_ref().si()).collect(),
            hand: raw.hand.map(|h| {
                let h = h.into_inner();
                Hand {
                    mass_kg: h.mass_kg,
                    damping_n_s_per_m: h.damping_n_s_per_m,
                    stiffness_n_per_m: h.stiffness_n_per_m,
                    inertia_kg_m2: h.inertia_kg_m2,
                    damping_nm_s_per_rad: h.damping_nm_s_per_rad,
                    stiffness_nm_per_rad: h.stiffness_nm_per_rad,
                }
            }),
            device: raw.device.map(Spanned::into_inner).unwrap_or_default(),
            start_place,
        })
    }

    /// Puts the file's figures in the place of a preset's.
    pub fn adjust(&self, capabilities: &mut Capabilities) {
        let m = &mut capabilities.mechanics;
        let d = &self.device;
        for (figure, value) in [
            (&mut m.mass_kg, d.mass_kg),
            (&mut m.damping_n_s_per_m, d.damping_n_s_per_m),
            (&mut m.coulomb_n, d.coulomb_n),
            (&mut m.resolution_m, d.resolution_mm.map(|mm| mm * 1e-3)),
            (&mut m.delay_s, d.delay_ms.map(|ms| ms * 1e-3)),
            (&mut m.lag_s, d.lag_ms.map(|ms| ms * 1e-3)),
            (&mut m.slew_n_per_s, d.slew_n_per_s),
            (&mut capabilities.max_force_n, d.max_force_n),
        ] {
            if let Some(value) = value {
                *figure = Figure::chosen(value);
            }
        }
        self.adjust_wrist(capabilities);
    }

    /// A device whose rotational inertia is told has a handle that turns; one whose largest torque is told
    /// drives it.
    fn adjust_wrist(&self, capabilities: &mut Capabilities) {
        let d = &self.device;
        if d.inertia_kg_m2.is_some() {
            capabilities.sensed.rotations = 3;
        }
        if let Some(most) = d.max_torque_nm {
            capabilities.max_torque_nm = Some(Figure::chosen(most));
            capabilities.driven.rotations = 3;
        }
        let figures =
            [d.inertia_kg_m2, d.damping_nm_s_per_rad, d.coulomb_nm, d.resolution_mrad, d.slew_nm_per_s];
        if figures.iter().all(Option::is_none) {
            return;
        }
        let wrist = capabilities.mechanics.wrist.get_or_insert_with(|| {
            let [inertia_kg_m2, damping_nm_s_per_rad, coulomb_nm, resolution_rad] =
                std::array::from_fn(|_| Figure::chosen(0.0));
            let slew_nm_per_s = Figure::chosen(f64::INFINITY);
            Wrist { inertia_kg_m2, damping_nm_s_per_rad, coulomb_nm, resolution_rad, slew_nm_per_s }
        });
        for (figure, value) in [
            (&mut wrist.inertia_kg_m2, d.inertia_kg_m2),
            (&mut wrist.damping_nm_s_per_rad, d.damping_nm_s_per_rad),
            (&mut wrist.coulomb_nm, d.coulomb_nm),
            (&mut wrist.resolution_rad, d.resolution_mrad.map(|mrad| mrad * 1e-3)),
            (&mut wrist.slew_nm_per_s, d.slew_nm_per_s),
        ] {
            if let Some(value) = value {
                *figure = Figure::chosen(value);
            }
        }
    }

    /// Where on `body` it begins: the surface point, m, and the direction into the body there.
    ///
    /// # Errors
    /// The body has no surface to touch, which no body has; its file can't be read.
    pub fn place(&self, body: &dyn BodySource) -> Result<[DVec3; 2]> {
        let near = self.at_m.map_or_else(|| top(body), Ok)?;
        Ok(body.nearest(near)?)
    }

    /// The moves at this place, seen from it.
    ///
    /// # Errors
    /// Moves that don't go: the message says which.
    pub fn script(&self, into: DVec3, radius_m: f64) -> Result<Script> {
        let along = self.along.unwrap_or_else(|| {
            // The axis that lies flattest, so that a built-in drag goes along a cylinder's or a block's axes.
            let flat = |a: &DVec3| a.dot(into).abs();
            DVec3::AXES.into_iter().min_by(|a, b| flat(a).total_cmp(&flat(b))).unwrap_or(DVec3::X)
        });
        // A sphere's reference point is its centre.
        let place = into * -radius_m;
        let place_in_file = self.start_place.as_deref().unwrap_or("the motion script");
        Script::new(place, self.clearance_m, into, along, &self.moves)
            .map_err(|e| anyhow!("{place_in_file}: {e}"))
    }
}

impl RawStart {
    fn figures(&self) -> Vec<(&'static str, f64, Allowed)> {
        let row = |key, row: Option<List<3>>, most: f64| {
            row.into_iter().flat_map(move |List(v)| v.map(|x| (key, x, within(most))))
        };
        let clearance = self.clearance_mm.map(|mm| ("clearance_mm", mm, within(LENGTH_MM)));
        row("at_mm", self.at_mm, 1e6).chain(row("along", self.along, 1e6)).chain(clearance).collect()
    }
}

impl RawHand {
    fn figures(&self) -> [(&'static str, f64, Allowed); 6] {
        [
            ("mass_kg", self.mass_kg, figures::MASS_KG),
            ("damping_n_s_per_m", self.damping_n_s_per_m, figures::DAMPING_N_S_PER_M),
            ("stiffness_n_per_m", self.stiffness_n_per_m, figures::STIFFNESS_N_PER_M),
            ("inertia_kg_m2", self.inertia_kg_m2, figures::INERTIA_KG_M2),
            ("damping_nm_s_per_rad", self.damping_nm_s_per_rad, figures::DAMPING_NM_S_PER_RAD),
            ("stiffness_nm_per_rad", self.stiffness_nm_per_rad, figures::STIFFNESS_NM_PER_RAD),
        ]
    }
}

impl RawDevice {
    /// Those that are given.
    fn figures(&self) -> Vec<(&'static str, f64, Allowed)> {
        // Without a mass of its own a device can't be integrated in an empty hand.
        let mass = Allowed { none: false, ..figures::MASS_KG };
        let inertia = Allowed { none: false, ..figures::INERTIA_KG_M2 };
        let (mm, ms, mrad) = (1e-3, 1e-3, 1e-3);
        [
            ("mass_kg", self.mass_kg, mass),
            ("damping_n_s_per_m", self.damping_n_s_per_m, figures::DAMPING_N_S_PER_M),
            ("coulomb_n", self.coulomb_n, figures::FORCE_N),
            ("resolution_mm", self.resolution_mm, figures::RESOLUTION_M.per(mm)),
            ("delay_ms", self.delay_ms, figures::DELAY_S.per(ms)),
            ("lag_ms", self.lag_ms, figures::LAG_S.per(ms)),
            ("slew_n_per_s", self.slew_n_per_s, figures::SLEW_N_PER_S),
            ("max_force_n", self.max_force_n, figures::FORCE_N),
            ("inertia_kg_m2", self.inertia_kg_m2, inertia),
            ("damping_nm_s_per_rad", self.damping_nm_s_per_rad, figures::DAMPING_NM_S_PER_RAD),
            ("coulomb_nm", self.coulomb_nm, figures::TORQUE_NM),
            ("resolution_mrad", self.resolution_mrad, figures::RESOLUTION_RAD.per(mrad)),
            ("slew_nm_per_s", self.slew_nm_per_s, figures::SLEW_NM_PER_S),
            ("max_torque_nm", self.max_torque_nm, figures::TORQUE_NM),
        ]
        .into_iter()
        .filter_map(|(key, value, allowed)| Some((key, value?, allowed)))
        .collect()
    }
}

/// The moves of a built-in intent that wants to be this deep, m.
fn built_in(name: &str, depth_m: f64) -> Option<Vec<Move>> {
    let down = Move::Press { depth_m, seconds: 0.5 };
    let up = Move::Press { depth_m: -CLEARANCE, seconds: 0.5 };
    let hold = |tremor_m, seconds| Move::Hold { tremor_m, tremor_hz: nine(), seconds };
    Some(match name {
        "press" => vec![down, hold(0.0, 1.5), up],
        "drag" => vec![down, Move::Drag { along_m: 5.0 * depth_m, across_m: 0.0, seconds: 2.0 }, up],
        "circle" => vec![down, Move::Circle { radius_m: 1.5 * depth_m, turns: 1.0, seconds: 2.0 }, up],
        "tap" => vec![Move::Tap { depth_m: CLEARANCE + depth_m, times: 3, seconds: 2.0 }],
        // A fifth of a millimetre: a calm hand's tremor is seen in tenths of a millimetre.
        "hold" => vec![down, hold(0.2e-3, 2.0), up],
        _ => return None,
    })
}

/// What lies first on the way down through the body's middle; where it is open there, on a way in from the side.
pub fn top(body: &dyn BodySource) -> Result<DVec3> {
    let Extent { middle, radius_m, highest } = body.extent();
    let far = radius_m + 1e-3;
    for from in [DVec3::Z, DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y] {
        if let Some(touched) = body.first_touch(middle + from * far, middle - from * far)? {
            return Ok(touched);
        }
    }
    Ok(highest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_device::presets;

    fn read(text: &str) -> Result<MotionScript> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.toml");
        std::fs::write(&path, text)?;
        MotionScript::read(&path)
    }

    const TURN: &str = "[[move]]\nkind = \"turn\"\nangles_deg = [0, 90, -30]\nseconds = 1.0\n";

    #[test]
    fn a_file_turns_the_handle_and_gives_it_a_wrist() {
        let device = "[device]\ninertia_kg_m2 = 1e-4\nresolution_mrad = 0.2\nmax_torque_nm = 0.3\n";
        let hand = "[hand]\nmass_kg = 0.01\ndamping_n_s_per_m = 2\nstiffness_n_per_m = 300\nstiffness_nm_per_rad = 0.3\n";
        let script = read(&[device, hand, TURN].concat()).unwrap();
        let Move::Turn { angles_rad, .. } = script.moves[0] else { panic!("{:?}", script.moves) };
        assert!(angles_rad.distance(DVec3::new(0.0, 90f64.to_radians(), -30f64.to_radians())) < 1e-12);
        let hand = script.hand.unwrap();
        assert_eq!((hand.stiffness_nm_per_rad, hand.inertia_kg_m2), (0.3, 0.0));
        let mut bench = presets::device("bench").unwrap();
        script.adjust(&mut bench);
        assert_eq!((bench.sensed.rotations, bench.driven.rotations), (3, 3));
        assert_eq!(bench.max_torque_nm.as_ref().unwrap().value, 0.3);
        let wrist = bench.mechanics.wrist.as_ref().unwrap();
        assert_eq!((wrist.inertia_kg_m2.value, wrist.resolution_rad.value), (1e-4, 0.2e-3));
        assert!(figures::check(&bench, &hand).is_ok());
        // Without figures of a wrist a device stays as it is.
        let mut touch = presets::device("touch").unwrap();
        read(TURN).unwrap().adjust(&mut touch);
        assert_eq!(touch, presets::device("touch").unwrap());
    }

    #[test]
    fn what_no_wrist_is_or_does_is_refused_with_its_line() {
        for (wrong, says) in [
            ("[device]\ninertia_kg_m2 = 0\n", "a.toml:2: inertia_kg_m2 is 0"),
            ("[device]\ncoulomb_nm = -1\n", "a.toml:2: coulomb_nm is -1"),
            (
                "[hand]\nmass_kg = 0\ndamping_n_s_per_m = 0\nstiffness_n_per_m = 0\ninertia_kg_m2 = nan\n",
                "inertia_kg_m2 is NaN",
            ),
            ("[[move]]\nkind = \"turn\"\nangles_deg = [0, 0, 4000]\nseconds = 1\n", "angles_deg is 4000"),
        ] {
            let error = read(&[wrong, TURN].concat()).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
