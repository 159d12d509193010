//! Which figures can be simulated. Beyond these a piece of the motion would be so short that a second of it takes hours,
//! or so long for its time constants that its series doesn't end at rounding.

use super::{Hand, UNDER_WAY};
use crate::{Capabilities, Wrist};
use std::fmt;

/// What a figure can be: from `least` to `most`, and 0 where that means that there is none of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allowed {
    /// In the figure's unit.
    pub least: f64,
    /// In the figure's unit.
    pub most: f64,
    /// Whether 0 is allowed besides.
    pub none: bool,
}

impl Allowed {
    const fn none_or(least: f64, most: f64) -> Self {
        Allowed { least, most, none: true }
    }

    const fn up_to(most: f64) -> Self {
        Allowed { least: 0.0, most, none: true }
    }

    /// Whether `value` is; a number that is none isn't.
    pub fn holds(&self, value: f64) -> bool {
        (self.least..=self.most).contains(&value) || (self.none && value == 0.0)
    }

    /// The same in a unit of which one is `unit` of the figure's own.
    #[must_use]
    pub fn per(&self, unit: f64) -> Self {
        // Decimal units: what rounding adds is taken off again.
        let scaled = |x: f64| libm::rint(x / unit * 1e9) / 1e9;
        Allowed { least: scaled(self.least), most: scaled(self.most), none: self.none }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let none = if self.none && self.least > 0.0 { "0, or a number" } else { "a number" };
        match self.most {
            f64::INFINITY => write!(f, "{none} of {} or more", self.least),
            most => write!(f, "{none} from {} to {most}", self.least),
        }
    }
}

/// A mass that moves, kg.
pub const MASS_KG: Allowed = Allowed::none_or(1e-6, 1e3);
/// A damping, N·s/m.
pub const DAMPING_N_S_PER_M: Allowed = Allowed::up_to(1e5);
/// A hand's spring, N/m.
pub const STIFFNESS_N_PER_M: Allowed = Allowed::up_to(1e8);
/// Coulomb friction, N; and the largest force.
pub const FORCE_N: Allowed = Allowed::up_to(1e4);
/// An encoder's step, m.
pub const RESOLUTION_M: Allowed = Allowed::none_or(1e-12, 0.1);
/// From a command to its force, s. No more than [`PERIODS_UNDER_WAY`] of the loop besides.
pub const DELAY_S: Allowed = Allowed::up_to(1.0);
/// An amplifier's lag, s.
pub const LAG_S: Allowed = Allowed::none_or(1e-8, 1.0);
/// An amplifier's slew, N/s.
pub const SLEW_N_PER_S: Allowed = Allowed::up_to(f64::INFINITY);
/// A rotational inertia, kg·m².
pub const INERTIA_KG_M2: Allowed = Allowed::none_or(1e-9, 1e3);
/// A rotational damping, N·m·s/rad.
pub const DAMPING_NM_S_PER_RAD: Allowed = Allowed::up_to(1e5);
/// A hand's rotational spring, N·m/rad.
pub const STIFFNESS_NM_PER_RAD: Allowed = Allowed::up_to(1e8);
/// Coulomb friction of turning, N·m; and the largest torque.
pub const TORQUE_NM: Allowed = Allowed::up_to(1e4);
/// A rotational encoder's step, rad.
pub const RESOLUTION_RAD: Allowed = Allowed::none_or(1e-12, 1.0);
/// An amplifier's slew, N·m/s.
pub const SLEW_NM_PER_S: Allowed = Allowed::up_to(f64::INFINITY);

/// A delay of more periods than these can't be simulated: commands under way are kept in a ring of this size.
pub const PERIODS_UNDER_WAY: usize = UNDER_WAY;

/// The shortest time constant of tool and hand, s: 400 pieces for each millisecond.
const SHORTEST_S: f64 = 1e-5;

/// A figure that can't be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{figure} is {value}; give {hint}")]
pub struct FigureError {
    /// Its name, with its unit.
    pub figure: &'static str,
    /// What it is.
    pub value: f64,
    /// What can be.
    pub hint: String,
}

/// The wrist of a device whose simulated handle turns.
pub(super) fn turning(capabilities: &Capabilities) -> Option<&Wrist> {
    capabilities.mechanics.wrist.as_ref().filter(|_| capabilities.sensed.rotations > 0)
}

/// Whether a device with these capabilities can be simulated in this hand.
///
/// # Errors
/// A figure outside of what is [`Allowed`]; nothing that moves, or turns where there is a wrist; a mass, or
/// an inertia, so small for damping and spring that the motion's time constant 1/((b + b_h)/m + √(k/m)) is
/// below 10 µs.
pub fn check(capabilities: &Capabilities, hand: &Hand) -> Result<(), FigureError> {
    let m = &capabilities.mechanics;
    all(&[
        ("mass_kg", m.mass_kg.value, MASS_KG),
        ("damping_n_s_per_m", m.damping_n_s_per_m.value, DAMPING_N_S_PER_M),
        ("coulomb_n", m.coulomb_n.value, FORCE_N),
        ("resolution_m", m.resolution_m.value, RESOLUTION_M),
        ("delay_s", m.delay_s.value, DELAY_S),
        ("lag_s", m.lag_s.value, LAG_S),
        ("slew_n_per_s", m.slew_n_per_s.value, SLEW_N_PER_S),
        ("max_force_n", capabilities.max_force_n.value, FORCE_N),
        ("the hand's mass_kg", hand.mass_kg, MASS_KG),
        ("the hand's damping_n_s_per_m", hand.damping_n_s_per_m, DAMPING_N_S_PER_M),
        ("the hand's stiffness_n_per_m", hand.stiffness_n_per_m, STIFFNESS_N_PER_M),
        ("the hand's inertia_kg_m2", hand.inertia_kg_m2, INERTIA_KG_M2),
        ("the hand's damping_nm_s_per_rad", hand.damping_nm_s_per_rad, DAMPING_NM_S_PER_RAD),
        ("the hand's stiffness_nm_per_rad", hand.stiffness_nm_per_rad, STIFFNESS_NM_PER_RAD),
    ])?;
    let resistance = m.damping_n_s_per_m.value + hand.damping_n_s_per_m;
    not_too_fast(MASS, m.mass_kg.value + hand.mass_kg, resistance, hand.stiffness_n_per_m)?;
    let Some(wrist) = turning(capabilities) else { return Ok(()) };
    all(&[
        ("inertia_kg_m2", wrist.inertia_kg_m2.value, INERTIA_KG_M2),
        ("damping_nm_s_per_rad", wrist.damping_nm_s_per_rad.value, DAMPING_NM_S_PER_RAD),
        ("coulomb_nm", wrist.coulomb_nm.value, TORQUE_NM),
        ("resolution_rad", wrist.resolution_rad.value, RESOLUTION_RAD),
        ("slew_nm_per_s", wrist.slew_nm_per_s.value, SLEW_NM_PER_S),
        ("max_torque_nm", capabilities.max_torque_nm.as_ref().map_or(0.0, |most| most.value), TORQUE_NM),
    ])?;
    let resistance = wrist.damping_nm_s_per_rad.value + hand.damping_nm_s_per_rad;
    not_too_fast(
        INERTIA,
        wrist.inertia_kg_m2.value + hand.inertia_kg_m2,
        resistance,
        hand.stiffness_nm_per_rad,
    )
}

fn all(figures: &[(&'static str, f64, Allowed)]) -> Result<(), FigureError> {
    match figures.iter().find(|(_, value, allowed)| !allowed.holds(*value)) {
        Some(&(figure, value, allowed)) => Err(FigureError { figure, value, hint: allowed.to_string() }),
        None => Ok(()),
    }
}

/// Names of what moves: as a whole, with its unit, and in a sentence.
const MASS: [&str; 3] = ["the moving mass", "the moving mass_kg", "mass"];
const INERTIA: [&str; 3] = ["the turning inertia", "the turning inertia_kg_m2", "inertia"];

fn not_too_fast(
    [name, figure, noun]: [&'static str; 3],
    mass: f64,
    resistance: f64,
    stiffness: f64,
) -> Result<(), FigureError> {
    if mass == 0.0 {
        let an = if noun == "mass" { "a" } else { "an" };
        let hint = format!("the device or the hand {an} {noun}: without one it can't be integrated");
        return Err(FigureError { figure: name, value: mass, hint });
    }
    let fastest = resistance / mass + (stiffness / mass).sqrt();
    if fastest * SHORTEST_S > 1.0 {
        let hint = format!(
            "more {noun}, less damping or a softer hand: with these the tool's motion has a time constant of {:.1e} s, and \
             {SHORTEST_S:.0e} s is the shortest that can be simulated",
            1.0 / fastest
        );
        return Err(FigureError { figure, value: mass, hint });
    }
    Ok(())
}
