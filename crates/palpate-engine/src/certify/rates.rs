//! How drive, force and limit change over a cell, while the contact point or the tool moves: S and L of the rules whose
//! drive is more than the lateral force.

use super::criteria::{Frame, Slope};
use super::drive::Start;
use super::interval::{
    Interval, IntervalVector, applied, dot, flat, length, less, points, quadratic, rows, scaled, sum,
};
use super::law::{Forces, Reading};
use super::patch::{Cell, ElementStates, View};
use super::slopes::{Read, Slopes};
use super::states::{Piece, SHARES};
use super::turning::{Turning, turned};
use glam::{DMat3, DVec3};
use palpate_body::SlipRule;

/// What changes by how much while the contact point moves along the element, or the tool.
pub(super) struct Rate {
    pub drive: IntervalVector,
    pub force: IntervalVector,
    pub limit: Interval,
}

/// What slip does to the drive and the force, from their rates while c moves along x and y of the element
/// and, if asked for, the tool along x, y and z: along t, v = d/|d| the drive's direction. `own`
/// drives lie in the element, others at right angles to û;
/// `ways` are what P v's direction and t can be, and the most that they are apart (0: not at all).
pub(super) fn slope(
    along: &[Rate; 2],
    tool: Option<&[Rate; 3]>,
    u: IntervalVector,
    own: bool,
    (ways, turn): (impl Iterator<Item = [[Interval; 2]; 2]> + Clone, f64),
    frictionless: bool,
    stick: f64,
) -> Slope {
    // v = |P v| Σ t_i a_i with a_i = E_i − N û_i/û_z, where P v lies along t.
    let lean = [0, 1].map(|i| if own { Interval::ZERO } else { u[i].per(u[2]) });
    let fall = [0, 1].map(|i| [0, 1].map(|j: usize| lean[i] * along[j].drive[2] - along[j].drive[i]));
    // Both entries of the diagonal at their least: a quadratic form grows with them.
    let (mean, spread) = (0.5 * (fall[0][0].lo + fall[1][1].lo), 0.5 * (fall[0][0].lo - fall[1][1].lo));
    let skew = (fall[0][1] + fall[1][0]) * 0.5;
    // Whatever the direction: its least eigenvalue, and what is lost where v and t are apart.
    let eigenvalue = mean - spread.hypot(skew.magnitude());
    let (sin, cos) = turn.sin_cos();
    let across = ((fall[0][0] - fall[1][1]) * 0.5).magnitude().hypot(skew.magnitude())
        + ((fall[0][1] - fall[1][0]) * 0.5).magnitude();
    let least = if cos > 0.0 { eigenvalue.min(eigenvalue * cos) - across * sin } else { f64::NEG_INFINITY };
    let eta = |[v, t]: [[Interval; 2]; 2]| {
        let out = lean[0] * v[0] + lean[1] * v[1];
        let size = Interval::ONE.per((Interval::ONE + out.square()).sqrt());
        let falls = if turn == 0.0 {
            // With t = (cos φ, sin φ): mean + spread cos 2φ + skew sin 2φ.
            let cos2 = (t[0].square() - t[1].square()).clip(-1.0, 1.0);
            let sin2 = (t[0] * t[1] * 2.0).clip(-1.0, 1.0);
            mean + (cos2 * spread + skew * sin2).lo
        } else {
            let [x, y] = fall.map(|row| row[0] * t[0] + row[1] * t[1]);
            (v[0] * x + v[1] * y).lo
        };
        let falls = falls.max(least);
        let limit = (along[0].limit * t[0] + along[1].limit * t[1]).lo;
        let limit = limit.max(-along[0].limit.magnitude().hypot(along[1].limit.magnitude()));
        limit + falls * if falls < 0.0 { size.hi } else { size.lo }
    };
    let eta = ways.clone().map(eta).fold(f64::INFINITY, f64::min);
    let joined = ways.reduce(|a, b| [0, 1].map(|i| [0, 1].map(|j| a[i][j].join(b[i][j]))));
    let [v, t] = joined.unwrap_or([[Interval::ZERO; 2]; 2]);
    let out = lean[0] * v[0] + lean[1] * v[1];
    let size = Interval::ONE.per((Interval::ONE + out.square()).sqrt());
    let force = sum([scaled(along[0].force, t[0]), scaled(along[1].force, t[1])]);
    let v = [size * v[0], size * v[1], -(size * out)];
    let excess = |rate: &Rate| {
        if frictionless {
            length(rate.drive).hi + rate.limit.magnitude()
        } else {
            (dot(v, rate.drive) - rate.limit).magnitude()
        }
    };
    let excess: f64 = tool.into_iter().flatten().map(|rate| excess(rate).powi(2)).sum();
    Slope {
        eta,
        force: length(force).hi.min((length(along[0].force).hi).hypot(length(along[1].force).hi)),
        excess: excess.sqrt(),
        stick,
    }
}

/// How the deflections change.
struct Motion {
    /// ∇n along the axis that c moves along, 1/m; none where the tool moves.
    g: Option<[f64; 3]>,
    /// δ.
    delta: IntervalVector,
    /// û before projecting, and the part of that along û; û itself, 1/m.
    frame_gradient: IntervalVector,
    stretching: Interval,
    du: IntervalVector,
    /// δz, δ_t and ρ.
    depth: Interval,
    tangential: IntervalVector,
    rho: Interval,
    /// A e, 1/m.
    twist: IntervalVector,
}

/// How the forces change, N/m.
struct Forcing {
    /// Along the surface, with the deflections held.
    along: Forces,
    /// ρ g'.
    secant: Interval,
    /// A δ_t, its projection w, and g û·A δ_t.
    stretched: IntervalVector,
    dw: IntervalVector,
    beside: Interval,
    /// f_t, f and L.
    lateral: IntervalVector,
    force: IntervalVector,
    limit: Interval,
}

/// Forces and gradients over a cell.
pub(super) struct Rates<'a> {
    patch: &'a ElementStates,
    slopes: &'a Slopes,
    cell: &'a Cell,
    view: &'a View,
    frame: &'a Frame,
    turning: Turning,
    n: [Interval; 3],
    depth: Interval,
    deflection: Interval,
    per_q: Interval,
    /// w/ρ.
    w: IntervalVector,
    law: Reading,
    /// f_z − g (δz − R) − g û·A δ_t, N: what stands by δ_t in b.
    straight: Interval,
    /// P_û A e − e.
    stretch_rest: IntervalVector,
    /// b/|Σ n u|, N.
    couple: IntervalVector,
    /// The nodes' ∇(W_l + ½ g δ_t·A δ_t), N, and the sum of all that is taken off f_t.
    nodes: [IntervalVector; 3],
    whole: IntervalVector,
    /// ∂W/∂δz and ∂W/∂ρ of the nodes' gradients, N/m.
    rates: [Read; 2],
}

impl<'a> Rates<'a> {
    pub fn new(
        patch: &'a ElementStates,
        slopes: &'a Slopes,
        cell: &'a Cell,
        view: &'a View,
        frame: &'a Frame,
    ) -> Self {
        let Start { turning, n, depth, deflection, per_q, w } = Start::new(patch, slopes, cell, view, frame);
        let law = patch.law.reading(cell);
        let (lateral, secant) = (law.at.lateral, law.secant);
        // b = (f_z − g (δz − R) − g û·A δ_t) δ_t − g (δz − R) (P_û A − 1) δ_t.
        let beside = lateral * frame.along_u * per_q;
        let straight = patch.law.normal_less(cell, secant, patch.radius_m) - beside;
        let stretch_rest = if patch.is_stretched() { less(frame.w, frame.e) } else { [Interval::ZERO; 3] };
        let couple =
            less(scaled(frame.e, deflection * straight), scaled(stretch_rest, secant * deflection * depth));
        let couple = scaled(couple, frame.per_length);
        let [a, b] = slopes.values(&patch.law, cell, view.azimuth);
        let mut mean = sum([a.sum, b.sum]);
        let mut nodes = [0, 1, 2].map(|l: usize| sum([a.nodes[l], b.nodes[l]]));
        let half = lateral * deflection * per_q * 0.5;
        if let (Some((along, _)), Some(changes)) = (&turning.change, &turning.changes) {
            for axis in 0..3 {
                mean[axis] = mean[axis] + quadratic(&along[axis], frame.e) * half;
                for (node, change) in nodes.iter_mut().zip(changes) {
                    node[axis] = node[axis] + quadratic(&rows(change[axis]), frame.e) * half;
                }
            }
        }
        let mut whole = sum([mean, applied(&turning.frame_gradient, couple)]);
        if patch.slip != SlipRule::Exact {
            whole = less(whole, turned(n, view, frame.u, &nodes));
        }
        Rates {
            patch,
            slopes,
            cell,
            view,
            frame,
            turning,
            n,
            depth,
            deflection,
            per_q,
            w,
            law,
            straight,
            stretch_rest,
            couple,
            nodes,
            whole,
            rates: slopes.rates(&patch.law, cell, view.azimuth),
        }
    }

    /// While δ changes by `delta`: as c moves along the element's `axis`, or the tool with c held.
    fn rate(&self, delta: DVec3, axis: Option<usize>) -> Rate {
        let moving = self.motion(delta, axis);
        let pulling = self.forces(&moving);
        let reaction = self.reaction(&moving, &pulling);
        let Rates { patch, frame: Frame { u, .. }, .. } = self;
        let (force, limit) = (pulling.force, pulling.limit);
        if patch.slip == SlipRule::Exact {
            return Rate { drive: flat(less(force, reaction)), force, limit };
        }
        // P_û turns with û.
        let inside = dot(*u, self.whole);
        let drive = if axis.is_some() {
            // All that is along û is left out: the drive's direction is at right angles to it.
            let bare: IntervalVector = if patch.is_stretched() {
                let along = self.deflection * self.frame.along_u;
                std::array::from_fn(|i| pulling.stretched[i] - moving.frame_gradient[i] * along)
            } else {
                std::array::from_fn(|i| moving.delta[i] - moving.frame_gradient[i] * self.depth)
            };
            let lateral_force = sum([scaled(self.w, pulling.secant), scaled(bare, self.law.secant)]);
            sum([less(lateral_force, reaction), scaled(moving.frame_gradient, inside)])
        } else {
            let through = dot(*u, reaction) + dot(moving.du, self.whole);
            sum([less(pulling.lateral, reaction), scaled(*u, through), scaled(moving.du, inside)])
        };
        Rate { drive, force, limit }
    }

    /// û, δz, δ_t and ρ.
    fn motion(&self, delta: DVec3, axis: Option<usize>) -> Motion {
        let Rates { view, frame, .. } = self;
        let (u, e, zero) = (frame.u, frame.e, Interval::ZERO);
        let delta = points(delta);
        let frame_gradient = axis.map_or([zero; 3], |k| scaled(points(view.du[k]), frame.per_length));
        let stretching = dot(u, frame_gradient);
        let du = less(frame_gradient, scaled(u, stretching));
        let depth = self.deflection * dot(e, frame_gradient) + dot(u, delta);
        let tangential = std::array::from_fn(|i| delta[i] - u[i] * depth - du[i] * self.depth);
        let twist = match (axis, &view.stretch) {
            (Some(k), Some((_, own))) => applied(&rows(own[k]), e),
            _ => [zero; 3],
        };
        // δ_t'·A e, with du·A e = turn·w.
        let rho =
            (dot(delta, frame.stretched) - depth * frame.along_u - self.depth * dot(frame_gradient, frame.w)
                + self.deflection * dot(e, twist) * 0.5)
                * self.per_q;
        let g = axis.map(|k| if k == 0 { view.gx } else { view.gy });
        Motion { g, delta, frame_gradient, stretching, du, depth, tangential, twist, rho }
    }

    /// The forces and the limit.
    fn forces(&self, m: &Motion) -> Forcing {
        let Rates { patch, frame, law, .. } = self;
        let (u, zero) = (frame.u, Interval::ZERO);
        let nothing = Forces { normal: zero, lateral: zero, friction: zero };
        let along = m.g.map_or(nothing, |g| patch.law.gradient(self.cell, g));
        // ρ d(f_r/ρ), and f_t = f_r/ρ w.
        let secant = law.bend * m.rho + along.lateral;
        let stretched = sum([scaled(m.twist, self.deflection), frame.stretch(m.tangential)]);
        let (mut dw, mut beside) = (m.tangential, zero);
        if patch.is_stretched() {
            let through = dot(u, stretched) + self.deflection * dot(m.du, frame.stretched);
            let along = self.deflection * frame.along_u;
            dw = std::array::from_fn(|i| stretched[i] - u[i] * through - m.du[i] * along);
            beside = secant * frame.along_u * self.per_q + law.secant * through;
        }
        let lateral = sum([scaled(self.w, secant), scaled(dw, law.secant)]);
        let normal = law.slope.normal * m.depth + along.normal;
        Forcing {
            along,
            secant,
            stretched,
            dw,
            beside,
            lateral,
            force: sum([scaled(u, normal), scaled(m.du, law.at.normal), lateral]),
            limit: law.limit_rate(m.depth, &along),
        }
    }

    /// b/|Σ n u| with |Σ n u| held, N.
    fn couple(&self, m: &Motion, f: &Forcing) -> IntervalVector {
        let Rates { law, frame: Frame { e, per_length, .. }, .. } = self;
        // Both forces' slopes together, and what is left of A apart.
        let along_e = self.deflection
            * ((law.slope.normal - law.secant) * m.depth + f.along.normal - f.beside)
            - self.depth * f.secant;
        let couple: IntervalVector =
            std::array::from_fn(|i| m.tangential[i] * self.straight + e[i] * along_e);
        if !self.patch.is_stretched() {
            return scaled(couple, *per_length);
        }
        let rest: IntervalVector = std::array::from_fn(|i| {
            (self.w[i] - e[i]) * (f.secant * self.depth)
                + (f.dw[i] - m.tangential[i]) * (law.secant * self.depth)
                + self.stretch_rest[i] * (law.secant * self.deflection * m.depth)
        });
        scaled(less(couple, rest), *per_length)
    }

    /// What is taken off f_t, before P_û.
    fn reaction(&self, m: &Motion, f: &Forcing) -> IntervalVector {
        let Rates { patch, view, frame: Frame { u, e, .. }, law, turning, .. } = self;
        let (own, g) = (patch.slip == SlipRule::Exact, m.g.unwrap_or([0.0; 3]));
        let mut reaction = sum([
            scaled(self.rates[0].sum, m.depth),
            scaled(self.rates[1].sum, m.rho),
            applied(&turning.frame_gradient, less(self.couple(m, f), scaled(self.couple, m.stretching))),
        ]);
        let blended = |each: [DMat3; 3]| rows(each[0] * g[0] + each[1] * g[1] + each[2] * g[2]);
        if m.g.is_some() && !own {
            let second = self.slopes.second(&patch.law, self.cell, g, view.azimuth);
            reaction = sum([reaction, second, applied(&blended(turning.each), self.couple)]);
        }
        let mut nodes: [IntervalVector; 3] = std::array::from_fn(|l| {
            sum([scaled(self.rates[0].nodes[l], m.depth), scaled(self.rates[1].nodes[l], m.rho)])
        });
        if let (Some((along, _)), Some(changes)) = (&turning.change, &turning.changes) {
            // d(½ g δ_t·K δ_t) = ½ (ρ dg) (δr/q) e·K e + g δr e·K dδ_t.
            let (grown, by) = (f.secant * self.deflection * self.per_q * 0.5, law.secant * self.deflection);
            let square = law.secant * self.deflection.square() * 0.5;
            let of =
                |k: &[IntervalVector; 3]| quadratic(k, *e) * grown + dot(applied(k, *e), m.tangential) * by;
            for axis in 0..3 {
                reaction[axis] = reaction[axis] + of(&along[axis]);
                for (node, change) in nodes.iter_mut().zip(changes) {
                    node[axis] = node[axis] + of(&rows(change[axis]));
                }
                if !own {
                    let across = blended([0, 1, 2].map(|l: usize| changes[l][axis]));
                    reaction[axis] = reaction[axis] + quadratic(&across, *e) * square;
                }
            }
        }
        if own {
            return reaction;
        }
        reaction = less(reaction, turned(self.n, view, *u, &nodes));
        for (l, (node, share)) in view.frames.iter().zip(g).enumerate() {
            // The nodes' parts of the blend, and û, change too.
            let part = dot(less(*u, points(*node)), self.nodes[l]) * (0.5 * share)
                + self.n[l] * dot(m.du, self.nodes[l]) * 0.5;
            reaction = less(reaction, scaled(points(*node), part));
        }
        reaction
    }

    /// What slip does to the drive and the force: along t, P v's direction, v = g̃/|g̃|.
    pub fn slope(&self, pieces: &[Option<Piece>; SHARES], tips: bool) -> Slope {
        let along = [self.rate(-DVec3::X, Some(0)), self.rate(-DVec3::Y, Some(1))];
        let tool = tips.then(|| DVec3::AXES.map(|axis| self.rate(axis, None)));
        slope(
            &along,
            tool.as_ref(),
            self.frame.u,
            self.patch.slip == SlipRule::Exact,
            (pieces.iter().flatten().map(|p| [p.way; 2]), 0.0),
            self.law.at.friction.lo <= 0.0,
            self.law.stiffness(self.patch.stretch()[1]),
        )
    }
}
