//! What a device can do, each figure with where it comes from.

use std::borrow::Cow;

/// A figure and what it rests on.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// In the unit that the field's name tells.
    pub value: f64,
    /// Where it comes from.
    pub basis: Basis,
}

/// What a figure rests on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Basis {
    /// Somebody measured it, or the device itself reports it: who.
    Measured(Cow<'static, str>),
    /// A data sheet or another program states it: which.
    Stated(Cow<'static, str>),
    /// Nobody did; why it is a fair guess.
    Guessed(Cow<'static, str>),
    /// It is so by definition: a simulated device's own setting.
    Chosen,
}

impl Figure {
    /// Measured by, or reported by, `source`.
    pub fn measured(value: f64, source: impl Into<Cow<'static, str>>) -> Self {
        Figure { value, basis: Basis::Measured(source.into()) }
    }

    /// Stated by `source`.
    pub fn stated(value: f64, source: impl Into<Cow<'static, str>>) -> Self {
        Figure { value, basis: Basis::Stated(source.into()) }
    }

    /// Guessed because of `reason`.
    pub fn guessed(value: f64, reason: impl Into<Cow<'static, str>>) -> Self {
        Figure { value, basis: Basis::Guessed(reason.into()) }
    }

    /// A simulated device's own setting.
    pub fn chosen(value: f64) -> Self {
        Figure { value, basis: Basis::Chosen }
    }
}

/// What a device can do.
#[derive(Debug, Clone, PartialEq)]
pub struct Capabilities {
    /// Maker and model.
    pub name: Cow<'static, str>,
    /// The force that it renders in any direction, N.
    pub max_force_n: Figure,
    /// The torque that it renders about any axis, N·m, where rotations are driven.
    pub max_torque_nm: Option<Figure>,
    /// The stiffest wall that it holds, N/m.
    pub max_stiffness_n_per_m: Figure,
    /// Where the handle can be.
    pub workspace: Workspace,
    /// Axes whose position is sensed.
    pub sensed: Freedom,
    /// Axes whose force or torque is driven.
    pub driven: Freedom,
    /// How many buttons.
    pub buttons: u32,
    /// How often it can be asked.
    pub rates: Rates,
    /// Who sets the pace.
    pub pace: Pace,
    /// How old the velocity is that it reports, s: half of the time that it is averaged over. `None` if it reports none.
    pub velocity_delay_s: Option<Figure>,
    /// Its mechanics at the handle, for the sampled-data rule and for simulating it.
    pub mechanics: Mechanics,
}

/// The box, aligned with the device's frame, in which the handle can be.
#[derive(Debug, Clone, PartialEq)]
pub struct Workspace {
    /// Its middle, m.
    pub centre_m: [f64; 3],
    /// Half its extent along each axis, m.
    pub half_extent_m: [f64; 3],
    /// Where it comes from.
    pub basis: Basis,
}

/// How many of three translations and of three rotations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Freedom {
    /// 0 to 3.
    pub translations: u8,
    /// 0 to 3.
    pub rotations: u8,
}

/// Periods a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Slower than this the device stops or complains, Hz; 0 where it doesn't.
    pub least_hz: f64,
    /// What it is made for, Hz.
    pub usual_hz: f64,
    /// Faster than this brings nothing, Hz.
    pub most_hz: f64,
}

/// Who sets the pace of a loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// The loop keeps the period; `read` returns at once.
    Loop,
    /// The device does; `read` waits for its next pose.
    Device,
}

/// The mechanics that the operator's hand and the loop feel, at the handle, alike in all directions.
#[derive(Debug, Clone, PartialEq)]
pub struct Mechanics {
    /// Moving mass, kg.
    pub mass_kg: Figure,
    /// Viscous damping b, N·s/m.
    pub damping_n_s_per_m: Figure,
    /// Coulomb friction c_f, N.
    pub coulomb_n: Figure,
    /// Smallest step of the position that it reports, m.
    pub resolution_m: Figure,
    /// From the pose's sampling to the moment when the force that answers it acts, s, beyond the loop's own
    /// zero-order hold.
    pub delay_s: Figure,
    /// Time constant of the amplifier and motor's first-order lag, s; 0 for none.
    pub lag_s: Figure,
    /// How fast the force can change, N/s; infinite where nothing limits it.
    pub slew_n_per_s: Figure,
    /// The same for turning the handle; `None` where it is not known, and a simulated handle does not turn.
    pub wrist: Option<Wrist>,
}

/// The mechanics of turning the handle, alike about all axes. Delay and lag are those of [`Mechanics`].
#[derive(Debug, Clone, PartialEq)]
pub struct Wrist {
    /// Rotational inertia, kg·m².
    pub inertia_kg_m2: Figure,
    /// Viscous damping, N·m·s/rad.
    pub damping_nm_s_per_rad: Figure,
    /// Coulomb friction, N·m.
    pub coulomb_nm: Figure,
    /// Smallest step of the angle that it reports, rad.
    pub resolution_rad: Figure,
    /// How fast the torque can change, N·m/s; infinite where nothing limits it.
    pub slew_nm_per_s: Figure,
}
