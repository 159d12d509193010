//! The drive of `consistent` and `exact` over a cell, by the forces: with f = f_z + f_r and s = f_r/f it is a blend of a part
//! for each of the two, which have a direction also where both forces vanish.

use super::criteria::Frame;
use super::interval::{Interval, IntervalVector, applied, dot, flat, less, quadratic, rows, scaled};
use super::patch::{Cell, ElementStates, View};
use super::slopes::{Read, Slopes, join3};
use super::turning::{Turning, coordinates, turned};
use palpate_body::SlipRule;

/// How much of the gradients, computed in single precision, may be rounding.
pub(super) const SINGLE: f64 = 1e-6;
/// What the slip search takes for rounding of the drive, as a share of what is taken off the lateral force.
pub(super) const NOISE: f64 = 6e-7;

/// The drive by the forces, g̃/f, and what it misses of g, (g − P g̃)/f: blends of a part for each of the forces with the
/// share s of the lateral one, apart from what b's turning takes, which depends on both at once.
pub(super) struct Drive {
    by: [IntervalVector; 2],
    miss: [[Interval; 2]; 2],
    /// What the slip search takes for the drive's rounding.
    noise: [f64; 2],
    couple: Couple,
}

/// b/f and what turning takes of it.
struct Couple {
    /// ∇(u·b) as a matrix that takes b, by rows; nodes' means less the element's own.
    frame_gradient: [IntervalVector; 3],
    miss: [IntervalVector; 2],
    /// b/f = e ((1 − s) δr − s ζ) − s rest, before it is divided by |Σ n u|.
    e: IntervalVector,
    deflection: Interval,
    depth: Interval,
    rest: IntervalVector,
    per_length: Interval,
    u: IntervalVector,
    /// For `exact`, along the element and not across û.
    own: bool,
}

impl Couple {
    /// At a share: what is taken off the drive, and what g has more.
    fn reaction(&self, share: f64) -> (IntervalVector, [Interval; 2]) {
        let along = self.deflection * (1.0 - share) - self.depth * share;
        let b = less(scaled(self.e, along), self.rest.map(|x| x * share));
        let b = scaled(b, self.per_length);
        let tilt = applied(&self.frame_gradient, b);
        if self.own {
            return (flat(tilt), [Interval::ZERO; 2]);
        }
        let through = dot(self.u, tilt);
        let miss = [0, 1].map(|i| dot(self.miss[i], b) - self.u[i] * through);
        (less(tilt, scaled(self.u, through)), miss)
    }
}

/// What the drive and its rate of change begin with.
pub(super) struct Start {
    pub turning: Turning,
    pub n: [Interval; 3],
    pub depth: Interval,
    pub deflection: Interval,
    pub per_q: Interval,
    /// w/ρ.
    pub w: IntervalVector,
}

impl Start {
    pub fn new(patch: &ElementStates, slopes: &Slopes, cell: &Cell, view: &View, frame: &Frame) -> Self {
        let (z, r) = (cell.depth_m, cell.reach_m);
        let per_q = Interval::ONE.per(frame.q);
        Start {
            turning: Turning::new(slopes, cell, view),
            n: coordinates(cell),
            depth: Interval::new(z[0] - patch.radius_m, z[1] - patch.radius_m),
            deflection: Interval::new(r[0], r[1]) * per_q,
            per_q,
            w: scaled(frame.w, per_q),
        }
    }
}

impl Drive {
    pub fn new(patch: &ElementStates, slopes: &Slopes, cell: &Cell, view: &View, frame: &Frame) -> Self {
        let Start { turning, n, depth, deflection, per_q, w } = Start::new(patch, slopes, cell, view, frame);
        let beside = deflection * frame.along_u * per_q;
        let couple = Couple {
            e: frame.e,
            deflection,
            depth: depth + beside,
            rest: if patch.is_stretched() {
                less(scaled(w, depth), scaled(frame.e, depth))
            } else {
                [Interval::ZERO; 3]
            },
            per_length: frame.per_length,
            u: frame.u,
            own: patch.slip == SlipRule::Exact,
            frame_gradient: turning.frame_gradient,
            miss: turning.miss,
        };
        let energies = slopes.by_force(&patch.law, cell, view.azimuth);
        let half = deflection * per_q * 0.5;
        let forces = [frame.u, w];
        let parts = [0, 1].map(|k| {
            let Read { sum: mut mean, mut miss, mut nodes } = energies[k];
            if let (1, Some((along, own)), Some(changes)) = (k, &turning.change, &turning.changes) {
                for axis in 0..3 {
                    mean[axis] = mean[axis] + quadratic(&along[axis], frame.e) * half;
                    for (node, change) in nodes.iter_mut().zip(changes) {
                        node[axis] = node[axis] + quadratic(&rows(change[axis]), frame.e) * half;
                    }
                }
                for axis in 0..2 {
                    miss[axis] = miss[axis] + quadratic(&own[axis], frame.e) * half;
                }
            }
            if couple.own {
                return (flat(less(forces[k], mean)), [Interval::ZERO; 2], 0.0);
            }
            let bent = turned(n, view, frame.u, &nodes);
            let tilt = couple.reaction(k as f64).0.iter().map(|x| x.magnitude()).sum::<f64>();
            let rounding =
                SINGLE * (nodes.iter().flatten().map(|x| x.magnitude()).fold(0.0, f64::max) + tilt);
            let whole = less(mean, bent);
            let along_u = dot(frame.u, whole);
            let reaction = less(whole, scaled(frame.u, along_u)).map(|x| x + Interval::around_zero(rounding));
            let by = if k == 0 { reaction.map(|x| -x) } else { less(w, reaction) };
            let own = |i: usize| {
                let dip = if k == 0 { frame.u[i] } else { Interval::ZERO };
                dip + miss[i] - bent[i] - frame.u[i] * along_u + Interval::around_zero(rounding)
            };
            let noise = NOISE * (reaction.iter().map(|x| x.magnitude()).sum::<f64>() + tilt);
            (by, [own(0), own(1)], noise)
        });
        let [(a, b, c), (d, e, f)] = parts;
        Drive { by: [a, d], miss: [b, e], noise: [c, f], couple }
    }

    /// g̃/f and (g − P g̃)/f over a range of shares: linear in them, so that the ends bound it.
    pub fn at(&self, share: Interval) -> (IntervalVector, [Interval; 2]) {
        let at = |s: f64| {
            let (reaction, more) = self.couple.reaction(s);
            let blend = |a: Interval, b: Interval| a * (1.0 - s) + b * s;
            let vector: IntervalVector =
                std::array::from_fn(|i| blend(self.by[0][i], self.by[1][i]) - reaction[i]);
            (vector, [0, 1].map(|i| blend(self.miss[0][i], self.miss[1][i]) + more[i]))
        };
        let ((a, m), (b, n)) = (at(share.lo), at(share.hi));
        (join3(a, b), [m[0].join(n[0]), m[1].join(n[1])])
    }

    /// What the slip search takes for rounding of it, at most.
    pub fn noise_at(&self, share: Interval) -> f64 {
        self.noise[0] * (1.0 - share.lo) + self.noise[1] * share.hi
    }
}
