//! Scripts of moves: press, drag, circle, tap, hold, push, turn, release.

use super::{HandMotion, Target};
use glam::DVec3;
use std::f64::consts::TAU;

/// One move of a script. It begins where the one before ended. Ways are as seen from the script's place on the surface:
/// into the body, along, and across; each is travelled from rest to rest with the least jerk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Move {
    /// To this depth below the place, negative above it, m.
    Press {
        /// m.
        depth_m: f64,
        /// How long it takes, s.
        seconds: f64,
    },
    /// Straight on at constant depth.
    Drag {
        /// m.
        along_m: f64,
        /// m.
        across_m: f64,
        /// How long it takes, s.
        seconds: f64,
    },
    /// Around a circle that begins along, and ends where it began.
    Circle {
        /// m.
        radius_m: f64,
        /// Whole turns or parts of one.
        turns: f64,
        /// How long it takes, s.
        seconds: f64,
    },
    /// Down by `depth_m` and up again, `times` times.
    Tap {
        /// m, from where the move begins.
        depth_m: f64,
        /// How often.
        times: u32,
        /// How long all of them take, s.
        seconds: f64,
    },
    /// Stays, with the tremor that a hand has.
    Hold {
        /// Amplitude of the tremor, m; 0 for none.
        tremor_m: f64,
        /// Its frequency, Hz.
        tremor_hz: f64,
        /// How long, s.
        seconds: f64,
    },
    /// Changes the force that the hand exerts into the body, besides its spring, to this, N.
    Push {
        /// N.
        force_n: f64,
        /// How long the change takes, s.
        seconds: f64,
    },
    /// Turns the handle to these angles of the wrist's hinges about the device's x, y and z.
    Turn {
        /// rad.
        angles_rad: DVec3,
        /// How long it takes, s.
        seconds: f64,
    },
}

impl Move {
    /// How long it takes, s.
    pub fn seconds(&self) -> f64 {
        match *self {
            Move::Press { seconds, .. }
            | Move::Drag { seconds, .. }
            | Move::Circle { seconds, .. }
            | Move::Tap { seconds, .. }
            | Move::Hold { seconds, .. }
            | Move::Push { seconds, .. }
            | Move::Turn { seconds, .. } => seconds,
        }
    }

    /// (along, across, depth) from the move's beginning, and their rates, after the share `done` of it; `rate` is 1/s.
    fn way(&self, depth: f64, done: f64, rate: f64) -> (DVec3, DVec3) {
        let (s, ds) = least_jerk(done);
        let ds = ds * rate;
        match *self {
            Move::Press { depth_m, .. } => {
                let way = DVec3::Z * (depth_m - depth);
                (way * s, way * ds)
            }
            Move::Drag { along_m, across_m, .. } => {
                let way = DVec3::new(along_m, across_m, 0.0);
                (way * s, way * ds)
            }
            Move::Circle { radius_m, turns, .. } => {
                let (sin, cos) = libm::sincos(TAU * turns * s);
                let speed = radius_m * TAU * turns * ds;
                (DVec3::new(sin, 1.0 - cos, 0.0) * radius_m, DVec3::new(cos, sin, 0.0) * speed)
            }
            Move::Tap { depth_m, times, .. } => {
                let (sin, cos) = libm::sincos(TAU * f64::from(times) * s);
                let speed = 0.5 * depth_m * TAU * f64::from(times) * ds;
                (DVec3::Z * (0.5 * depth_m * (1.0 - cos)), DVec3::Z * (speed * sin))
            }
            Move::Hold { tremor_m, tremor_hz, seconds } => {
                // In all three directions, with amplitudes and frequencies that don't repeat soon; fades in and out.
                let (fade, dfade) = hump(done);
                let (t, rates) = (done * seconds, [1.0, 1.13, 0.89].map(|r| TAU * tremor_hz * r));
                let wave = rates.map(|w| libm::sin(w * t));
                let slope =
                    [0, 1, 2].map(|i| fade * rates[i] * libm::cos(rates[i] * t) + dfade * rate * wave[i]);
                (DVec3::from_array(wave) * (fade * tremor_m), DVec3::from_array(slope) * tremor_m)
            }
            Move::Push { .. } | Move::Turn { .. } => (DVec3::ZERO, DVec3::ZERO),
        }
    }
}

/// Why a script was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{place}: {problem}; {hint}")]
pub struct ScriptError {
    /// Which move, counted from 1, or the place.
    pub place: String,
    /// What is wrong there.
    pub problem: String,
    /// What to do.
    pub hint: String,
}

/// Moves one after the other at a place, in the device's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Script {
    place: DVec3,
    /// Columns: along, across, into.
    axes: [DVec3; 3],
    moves: Vec<Begun>,
}

/// A move and how things stand when it begins.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Begun {
    the_move: Move,
    at_s: f64,
    /// Along, across, depth, m.
    from: DVec3,
    /// N.
    push: f64,
    /// rad.
    angles: DVec3,
}

impl Script {
    /// `moves` at `place` (m) with the body in the direction `into`, beginning `clearance` (m) above it; `along` says
    /// where drags go, as far as it is perpendicular to `into`.
    ///
    /// # Errors
    /// A direction of no length or `along` parallel to `into`; a move that takes no time or holds a number that is not
    /// finite; no move.
    pub fn new(
        place: DVec3,
        clearance: f64,
        into: DVec3,
        along: DVec3,
        moves: &[Move],
    ) -> Result<Self, ScriptError> {
        let error = |place: &str, problem: &str, hint: &str| ScriptError {
            place: place.into(),
            problem: problem.into(),
            hint: hint.into(),
        };
        let directions = into.try_normalize().and_then(|into| {
            let along = along.try_normalize()?;
            let flat = along - into * along.dot(into);
            (flat.length() > 1e-6).then(|| (into, flat.normalize()))
        });
        let Some((into, along)) = directions.filter(|_| place.is_finite() && clearance.is_finite()) else {
            let problem = "the directions into the body and along it must have a length and differ";
            return Err(error("place", problem, "give other vectors"));
        };
        if moves.is_empty() {
            return Err(error("moves", "there is none", "give one at least"));
        }
        let mut begun = Vec::with_capacity(moves.len());
        let (mut at_s, mut from, mut push, mut angles) = (0.0, DVec3::Z * -clearance, 0.0, DVec3::ZERO);
        for (i, &the_move) in moves.iter().enumerate() {
            let number = format!("move {}", i + 1);
            let seconds = the_move.seconds();
            if !(seconds > 0.0 && seconds <= 1e6) {
                return Err(error(&number, "its seconds are not above 0 or beyond a million", "give a time"));
            }
            begun.push(Begun { the_move, at_s, from, push, angles });
            let end = from + the_move.way(from.z, 1.0, 0.0).0;
            match the_move {
                Move::Push { force_n, .. } => push = force_n,
                Move::Turn { angles_rad, .. } => angles = angles_rad,
                _ => {}
            }
            (at_s, from) = (at_s + seconds, end);
            if !(end.is_finite()
                && push.is_finite()
                && angles.is_finite()
                && the_move.way(0.0, 0.3, 1.0).1.is_finite())
            {
                return Err(error(&number, "it holds a number that is not finite", "give numbers"));
            }
        }
        Ok(Script { place, axes: [along, into.cross(along), into], moves: begun })
    }

    fn world(&self, local: DVec3) -> DVec3 {
        self.axes[0] * local.x + self.axes[1] * local.y + self.axes[2] * local.z
    }
}

impl HandMotion for Script {
    fn target(&self, time_s: f64) -> Target {
        let next = self.moves.partition_point(|m| m.at_s <= time_s).max(1);
        let Some(Begun { the_move, at_s, from, push, angles }) = self.moves.get(next - 1) else {
            return Target::default();
        };
        let seconds = the_move.seconds();
        let done = ((time_s - at_s) / seconds).clamp(0.0, 1.0);
        let (way, rate) = the_move.way(from.z, done, 1.0 / seconds);
        let push = match *the_move {
            Move::Push { force_n, .. } => push + (force_n - push) * least_jerk(done).0,
            _ => *push,
        };
        // From rest to rest, also once the move is over.
        let (angles_rad, rates_rad_per_s) = match *the_move {
            Move::Turn { angles_rad, .. } => {
                let ((s, ds), way) = (least_jerk(done), angles_rad - *angles);
                (*angles + way * s, way * (ds / seconds))
            }
            _ => (*angles, DVec3::ZERO),
        };
        Target {
            position_m: self.place + self.world(*from + way),
            velocity_m_per_s: if time_s > at_s + seconds { DVec3::ZERO } else { self.world(rate) },
            push_n: self.axes[2] * push,
            angles_rad,
            rates_rad_per_s,
            torque_nm: DVec3::ZERO,
        }
    }

    fn duration_s(&self) -> f64 {
        self.moves.last().map_or(0.0, |m| m.at_s + m.the_move.seconds())
    }

    fn rests(&self) -> Vec<(f64, f64)> {
        let still = |m: &&Begun| matches!(m.the_move, Move::Hold { tremor_m, .. } if tremor_m == 0.0);
        self.moves.iter().filter(still).map(|m| (m.at_s, m.at_s + m.the_move.seconds())).collect()
    }
}

/// From 0 to 1 with the least jerk, and its derivative: 10 τ³ − 15 τ⁴ + 6 τ⁵ (Flash and Hogan 1985).
fn least_jerk(tau: f64) -> (f64, f64) {
    let square = tau * tau;
    let left = 1.0 - tau;
    (square * tau * (10.0 + tau * (6.0 * tau - 15.0)), 30.0 * square * left * left)
}

/// From 0 up to 1 in the first tenth, and down again in the last; and its derivative.
fn hump(tau: f64) -> (f64, f64) {
    let edge = (tau.min(1.0 - tau) * 10.0).clamp(0.0, 1.0);
    let (s, ds) = least_jerk(edge);
    (s, if tau < 0.5 { 10.0 * ds } else { -10.0 * ds })
}
