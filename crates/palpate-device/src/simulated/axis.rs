//! One axis of the simulated handle, a slide or a hinge of its wrist, integrated exactly between events.
//!
//! ```text
//! m ẍ = F(t) + k (x_h − x) + b_h (ẋ_h − ẋ) + p(t) − b ẋ − c_f sign ẋ
//! ```
//!
//! with F the motor's force, x_h the hand's aim and p its push; for a hinge they are angle, inertia, and
//! torques. Between events (a command that arrives, an amplifier that stops slewing, a velocity that becomes
//! 0, a stop that breaks) the right side is linear in x and ẋ with a smooth drive, so that x(t) is the power
//! series whose coefficients follow one another:
//!
//! ```text
//! m (n+2)(n+1) a_(n+2) = u_n − (b + b_h)(n+1) a_(n+1) − k a_n
//! ```
//!
//! A piece is short enough for the series to end at rounding; there is no step size to choose and no numerical damping.

use super::Energies;

/// Highest power kept. Pieces are so short that the next term is below 10⁻¹⁶ of the first.
const ORDER: usize = 14;
/// Coefficients of 1, t, t², …
type Series = [f64; ORDER + 1];
/// No piece is shorter (s), so that their number is bounded.
const SHORTEST: f64 = 1e-9;
/// A piece's length as a share of the fastest time constant: 0.25¹⁵/15! is 10⁻²¹.
const SHARE: f64 = 0.25;
/// A motor as near to its command is there, relative.
const ARRIVED: f64 = 1e-15;

/// What moves and what drives it; the same for three axes. Units are those of a slide; a hinge has rad for m,
/// N·m for N and kg·m² for kg.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plant {
    /// Device and hand, kg.
    pub mass: f64,
    /// The device's b, N·s/m.
    pub damping: f64,
    /// c_f, N.
    pub coulomb: f64,
    /// The hand's damper, N·s/m.
    pub hand_damping: f64,
    /// The hand's spring, N/m.
    pub stiffness: f64,
    /// Amplifier's time constant, s.
    pub lag: f64,
    /// Amplifier's slew limit, N/s.
    pub slew: f64,
}

impl Plant {
    /// The longest piece, s.
    fn longest(&self) -> f64 {
        let fastest = (self.damping + self.hand_damping) / self.mass + (self.stiffness / self.mass).sqrt();
        (SHARE / fastest).max(SHORTEST)
    }

    /// The motor's force from `force` towards `command`, and for how long this form of it holds, s.
    fn motor(&self, force: f64, command: f64, span: f64) -> (Series, f64) {
        let mut f = [0.0; ORDER + 1];
        let way = command - force;
        f[0] = force;
        // Rounding keeps what decays towards a command from ever being there.
        if way.abs() <= ARRIVED * command.abs().max(1e-3) || (self.lag == 0.0 && self.slew == f64::INFINITY) {
            f[0] = command;
            return (f, span);
        }
        let slews = way.abs() - self.slew * self.lag;
        if slews > 0.0 {
            f[1] = self.slew.copysign(way);
            return (f, span.min((slews / self.slew).max(SHORTEST)));
        }
        // Exactly at the slew limit's end without a lag, the command is there.
        if self.lag == 0.0 {
            f[0] = command;
            return (f, span);
        }
        // command − way exp(−t/lag).
        let mut term = way;
        for (n, f) in f.iter_mut().enumerate().skip(1) {
            term /= -self.lag * n as f64;
            *f = -term;
        }
        (f, span.min((SHARE * self.lag).max(SHORTEST)))
    }
}

/// The hand's aim over a stretch of time, along one axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Aim {
    /// x_h as a cubic, m.
    cubic: [f64; 4],
    /// The push p and its rate, N, N/s.
    push: [f64; 2],
}

impl Aim {
    /// From (x_h, ẋ_h, p) at both ends of `span` s: the cubic through positions and velocities, the push straight.
    pub(super) fn between([x0, v0, p0]: [f64; 3], [x1, v1, p1]: [f64; 3], span: f64) -> Self {
        let way = (x1 - x0) / span;
        let cubic = [x0, v0, (3.0 * way - 2.0 * v0 - v1) / span, (v0 + v1 - 2.0 * way) / (span * span)];
        Aim { cubic, push: [p0, (p1 - p0) / span] }
    }

    /// The same seen from `t` s later on.
    fn from(&self, t: f64) -> Self {
        let [a, b, c, d] = self.cubic;
        let cubic = [a + t * (b + t * (c + t * d)), b + t * (2.0 * c + t * 3.0 * d), c + 3.0 * t * d, d];
        Aim { cubic, push: [self.push[0] + t * self.push[1], self.push[1]] }
    }

    /// The hand's force but for what the tool's own motion takes off: k x_h + b_h ẋ_h + p.
    fn drive(&self, plant: &Plant) -> [f64; 4] {
        let (k, b) = (plant.stiffness, plant.hand_damping);
        let [x0, x1, x2, x3] = self.cubic;
        [k * x0 + b * x1 + self.push[0], k * x1 + 2.0 * b * x2 + self.push[1], k * x2 + 3.0 * b * x3, k * x3]
    }
}

/// Motion, motor and energies of one axis.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Axis {
    /// m.
    pub x: f64,
    /// m/s.
    pub v: f64,
    /// The motor's force now, N.
    pub force: f64,
    /// The force that it goes to, N.
    pub command: f64,
    /// Sums since the beginning.
    pub energy: Energies,
}

impl Axis {
    /// Moves on by `span` s under `aim`.
    pub(super) fn advance(&mut self, plant: &Plant, span: f64, aim: &Aim) {
        let longest = plant.longest();
        let mut t = 0.0;
        while span - t > SHORTEST {
            let (motor, until) = plant.motor(self.force, self.command, longest.min(span - t));
            t += self.piece(plant, &motor, &aim.from(t), until);
        }
    }

    /// One piece of at most `span` s, to the next event; returns how long it was.
    fn piece(&mut self, plant: &Plant, motor: &Series, aim: &Aim, span: f64) -> f64 {
        let Plant { mass, damping, coulomb, hand_damping, stiffness, .. } = plant;
        let mut drive = *motor;
        for (u, h) in drive.iter_mut().zip(aim.drive(plant)) {
            *u += h;
        }
        // What would move a tool at rest.
        let net = |t: f64| value(&drive, t) - stiffness * self.x;
        let direction = if self.v != 0.0 {
            self.v.signum()
        } else if net(0.0).abs() > *coulomb {
            net(0.0).signum()
        } else {
            // Stuck until the friction is overcome.
            let breaks = first(span, |t| net(t).abs() > *coulomb);
            return self.book(plant, motor, aim, &constant(self.x), breaks.unwrap_or(span));
        };
        let resistance = damping + hand_damping;
        let mut x = constant(self.x);
        x[1] = self.v;
        for n in 0..ORDER - 1 {
            let u = if n == 0 { drive[0] - coulomb * direction } else { drive[n] };
            let m = n as f64;
            x[n + 2] =
                (u - resistance * (m + 1.0) * x[n + 1] - stiffness * x[n]) / (mass * (m + 2.0) * (m + 1.0));
        }
        if *coulomb == 0.0 {
            return self.book(plant, motor, aim, &x, span);
        }
        let speed = derivative(&x);
        let stop = first(span, |t| value(&speed, t) * direction < 0.0);
        let span = self.book(plant, motor, aim, &x, stop.unwrap_or(span));
        if stop.is_some() {
            self.v = 0.0;
        }
        span
    }

    /// Goes `span` s along the series x(t), and books its energies.
    fn book(&mut self, plant: &Plant, motor: &Series, aim: &Aim, x: &Series, span: f64) -> f64 {
        let Plant { damping, coulomb, hand_damping, stiffness, .. } = plant;
        let speed = derivative(x);
        let e = &mut self.energy;
        // Gauss's five points: exact to the ninth power.
        for (place, weight) in NODES {
            let (t, dt) = (0.5 * span * (1.0 + place), 0.5 * span * weight);
            let v = value(&speed, t);
            let now = aim.from(t);
            let slip = now.cubic[1] - v;
            let spring = stiffness * (now.cubic[0] - value(x, t));
            e.motor_j += dt * value(motor, t) * v;
            e.hand_j += dt * ((spring + hand_damping * slip) * now.cubic[1] + now.push[0] * v);
            e.viscous_j += dt * damping * v * v;
            e.hand_damper_j += dt * hand_damping * slip * slip;
        }
        let end = value(x, span);
        e.coulomb_j += coulomb * (end - self.x).abs();
        (self.x, self.v) = (end, value(&speed, span));
        self.force = value(motor, span);
        span
    }
}

/// Places and weights of Gauss's quadrature on [−1, 1].
const NODES: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// When `happened` begins to hold in (0, span], if it does at the end; not before the shortest piece is over.
fn first(span: f64, happened: impl Fn(f64) -> bool) -> Option<f64> {
    let (mut before, mut after) = (0.0, span);
    if !happened(after) {
        return None;
    }
    while after - before > SHORTEST * 1e-3 {
        let middle = 0.5 * (before + after);
        if happened(middle) { after = middle } else { before = middle }
    }
    Some(after.max(SHORTEST.min(span)))
}

fn constant(value: f64) -> Series {
    let mut series = [0.0; ORDER + 1];
    series[0] = value;
    series
}

fn value(series: &Series, t: f64) -> f64 {
    series.iter().rev().fold(0.0, |sum, a| sum * t + a)
}

fn derivative(series: &Series) -> Series {
    let mut slope = [0.0; ORDER + 1];
    for (n, (s, a)) in slope.iter_mut().zip(&series[1..]).enumerate() {
        *s = (n + 1) as f64 * a;
    }
    slope
}
