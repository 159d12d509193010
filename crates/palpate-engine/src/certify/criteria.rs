//! What is to be bounded: energy that slip takes out (P), the slope of the slip equation (S), the force's Lipschitz
//! constant (L). All formulas are those of docs/passivity.md, on intervals; a [`Cell`] without extent gives the value at
//! a state.

use super::interval::{Interval, IntervalVector, applied, dot, length, scaled, sum};
use super::law::Forces;
use super::patch::{Cell, ElementStates, View};
use crate::slip::OF_LIMIT;
use palpate_body::SlipRule;

/// A certificate's criterion: of each the least value over all slip states is sought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// P: the energy that a slip takes out for each metre of way, as a share of the forces: g·t/(f_z + f_r), without
    /// unit.
    Passive,
    /// S: how fast a slip takes the drive to its limit, η, N/m.
    SnapFree,
    /// L: the force's Lipschitz constant, negative, N/m.
    Lipschitz,
    /// How far the contact point goes for each metre of the tool's way while it slips, negative.
    Pace,
    /// E4: the friction with which P has 1 % to spare, negative: 0 where that is so as it is.
    Floor,
}

/// What P must have to spare with the friction that [`Criterion::Floor`] asks for: a floor without any could never be
/// proved to be one.
const SLACK: f64 = 0.01;

/// What part of the limit a drive has at least where the slip search ends, with some to spare.
pub(super) fn below(slip: SlipRule) -> f64 {
    1.0 - if slip == SlipRule::Paper { 2e-6 } else { 1.1 * OF_LIMIT }
}

/// A cell's frame, and where the lateral deflection leads.
pub(super) struct Frame {
    /// û.
    pub u: IntervalVector,
    /// A, by rows; none where the body is isotropic.
    pub tensor: Option<[IntervalVector; 3]>,
    /// 1/|Σ n u|.
    pub per_length: Interval,
    /// δ_t/δr, its projection's direction, and their cosine.
    pub e: IntervalVector,
    pub d: [Interval; 2],
    pub cosine: Interval,
    /// A e.
    pub stretched: IntervalVector,
    /// û·A e.
    pub along_u: Interval,
    /// P_û A e.
    pub w: IntervalVector,
    /// ρ/δr, and |P_û A e|/q.
    pub q: Interval,
    pub gain: Interval,
}

/// While the contact point moves by t.
struct Motion {
    /// t·û.
    dip: Interval,
    /// e·∂û and P_û A e·∂û, 1/m.
    kappa: Interval,
    bend: Interval,
    /// ∂û before projecting, 1/m.
    frame_gradient: IntervalVector,
    /// A e·t.
    way: Interval,
    /// ∂A e, 1/m, and e·∂A e.
    twist: IntervalVector,
    twisted: Interval,
}

impl Frame {
    pub fn new(patch: &ElementStates, view: &View) -> Self {
        let [a, b, c] = view.u;
        let sum = [0, 1, 2].map(|i| Interval::hull([a[i], b[i], c[i]]));
        // The length of a blend is at most the longest's.
        let longest = Interval::hull([a.length(), b.length(), c.length()]).hi;
        let length_u = Interval::new(length(sum).lo, longest);
        let per_length = Interval::ONE.per(length_u);
        let u = scaled(sum, per_length).map(|x| x.clip(-1.0, 1.0));
        let (cos, sin) = arc(view.half);
        let slope = (-(cos * sum[0] + sin * sum[1])).per(sum[2]);
        let cosine = Interval::ONE.per((Interval::ONE + slope.square()).sqrt());
        let e = [cos * cosine, sin * cosine, slope * cosine];
        let d = [cos, sin];
        let Some((tensor, _)) = &view.stretch else {
            let (one, zero) = (Interval::ONE, Interval::ZERO);
            return Frame {
                u,
                tensor: None,
                per_length,
                e,
                d,
                cosine,
                stretched: e,
                along_u: zero,
                w: e,
                q: one,
                gain: one,
            };
        };
        let stretched = tensor.map(|row| dot(row, e));
        let along_u = dot(u, stretched);
        let w = [0, 1, 2].map(|i| stretched[i] - u[i] * along_u);
        let [least, greatest] = patch.stretch().map(f64::sqrt);
        let q = dot(e, stretched).sqrt().clip(least, greatest);
        let gain = length(w).per(q).clip(least, greatest);
        Frame { u, tensor: Some(*tensor), per_length, e, d, cosine, stretched, along_u, w, q, gain }
    }

    /// A v.
    pub fn stretch(&self, v: IntervalVector) -> IntervalVector {
        self.tensor.as_ref().map_or(v, |a| applied(a, v))
    }

    fn motion(&self, view: &View, t: [Interval; 2], way: Interval) -> Motion {
        let [x, y] = view.du.map(|v| v.to_array());
        let frame_gradient = [0, 1, 2].map(|i| (t[0] * x[i] + t[1] * y[i]) * self.per_length);
        let twist = view.stretch.as_ref().map_or([Interval::ZERO; 3], |(_, [ax, ay])| {
            [0, 1, 2].map(|i| {
                let row = [0, 1, 2].map(|j| t[0] * ax.col(j)[i] + t[1] * ay.col(j)[i]);
                dot(row, self.e)
            })
        });
        let kappa = dot(self.e, frame_gradient);
        let isotropic = view.stretch.is_none();
        Motion {
            dip: t[0] * self.u[0] + t[1] * self.u[1],
            kappa,
            bend: if isotropic { kappa } else { dot(self.w, frame_gradient) },
            frame_gradient,
            way,
            twisted: dot(self.e, twist),
            twist,
        }
    }

    /// A e·t.
    fn way(&self, t: [Interval; 2]) -> Interval {
        self.stretched[0] * t[0] + self.stretched[1] * t[1]
    }

    /// The direction of the force's projection.
    fn forced(&self) -> [Interval; 2] {
        let [x, y, _] = self.w;
        let per = Interval::ONE.per((x.square() + y.square()).sqrt());
        [x, y].map(|c| (c * per).clip(-1.0, 1.0))
    }

    /// Ways of unit length along the deflection, and where it differs along the force, up to `aside` to either side.
    fn ways(&self, view: &View, aside: f64) -> [Option<([Interval; 2], Interval)>; 2] {
        let (cos, sin) = arc(view.half + aside);
        let along = [cos, sin];
        if view.stretch.is_none() {
            return [Some((along, self.cosine * arc(aside).0)), None];
        }
        let ([x, y], (cos, sin)) = (self.forced(), arc(aside));
        let forced = [x * cos + y * sin, y * cos + x * sin].map(|c| c.clip(-1.0, 1.0));
        [along, forced].map(|t| Some((t, self.way(t))))
    }
}

/// Cosines and sines of the angles up to `half` (< π/2) to either side of 0.
pub(super) fn arc(half: f64) -> (Interval, Interval) {
    let (sin, cos) = half.sin_cos();
    (Interval::new(cos, 1.0), Interval::around_zero(sin))
}

/// The deflection ρ with which a state's lateral force is at its limit, m.
pub(super) fn limit_reach(patch: &ElementStates, state: &Cell) -> f64 {
    if !patch.drives_by_curve() {
        return super::states::limit_reach(patch, state);
    }
    let frame = Frame::new(patch, &patch.view(state));
    patch.law.limit_reach(state.corners[0], state.depth_m[0], frame.gain.lo, patch.reach_m)
}

/// f_r/f_z of the states in a cell that slip. `None` where none do.
fn slipping(patch: &ElementStates, cell: &Cell, frame: &Frame) -> Option<Interval> {
    let (n, step, below) = (&cell.corners, patch.step_m, below(patch.slip));
    let Forces { normal, lateral, friction } = patch.law.forces(cell);
    if normal.hi <= 0.0 || lateral.hi * frame.gain.hi < friction.lo * normal.lo * below {
        return None;
    }
    // The tool came from a state within the limit, no farther than a step away.
    let [shallow, deep] = cell.depth_m;
    let around = [(shallow - step).max(0.0), deep + step];
    let held = patch.law.held(n, around);
    let before = (cell.reach_m[0] - step * patch.stretch()[1].sqrt()).max(0.0);
    if patch.law.least_lateral(n, before) * frame.gain.lo * below > held {
        return None;
    }
    let quotient = |a: f64, b: f64| if a == 0.0 { 0.0 } else { a / b };
    let low = quotient(lateral.lo, normal.hi).max(friction.lo.max(0.0) * below / frame.gain.hi);
    let high = quotient(lateral.hi, normal.lo);
    Some(Interval::new(low, high.max(low)))
}

impl Criterion {
    /// A lower bound over the states of `cell` that slip; infinite where none do.
    pub fn bound(self, patch: &ElementStates, cell: &Cell) -> f64 {
        let view = patch.view(cell);
        let frame = Frame::new(patch, &view);
        if view.u.iter().any(|u| u.z <= 0.0) {
            // The frames are folded against the element: no direction is what it seems.
            return f64::NEG_INFINITY;
        }
        if let Some(law) = &patch.coupled {
            return super::coupled::bound(self, patch, law, cell, &view);
        }
        if patch.slopes.is_some() {
            return super::consistent::bound(self, patch, cell, &view, &frame);
        }
        let Some(ratio) = slipping(patch, cell, &frame) else { return f64::INFINITY };
        match self {
            Criterion::Passive => passive(patch, cell, &view, &frame)
                .map(|(b, c)| gain(ratio, b, c))
                .fold(f64::INFINITY, f64::min),
            Criterion::Floor => {
                let needs = |(b, c): (Interval, Interval)| {
                    if gain(ratio, b, c) >= SLACK {
                        return 0.0;
                    }
                    // y B + C = SLACK (1 + y) is enough; or y is nowhere so large in the cell.
                    let rest = b.lo - SLACK;
                    let enough = if rest > 0.0 { (SLACK - c.lo) / rest } else { f64::INFINITY };
                    enough.min(ratio.hi) * frame.gain.hi
                };
                -passive(patch, cell, &view, &frame).map(needs).fold(0.0, f64::max)
            }
            Criterion::SnapFree | Criterion::Lipschitz | Criterion::Pace => {
                lipschitz(self, patch, &slope(patch, cell, &view, &frame))
            }
        }
    }
}

/// The least of (y B + C)/(1 + y), which lies at an end of y.
fn gain(y: Interval, b: Interval, c: Interval) -> f64 {
    let at = |y: f64| {
        let share = if y < f64::INFINITY { y / (1.0 + y) } else { 1.0 };
        let rest = 1.0 - share;
        // Nothing of the normal force is left, however it may change.
        b.lo * share + if rest == 0.0 { 0.0 } else { c.lo * rest }
    };
    at(y.lo).min(at(y.hi))
}

/// g·t/f_z = (f_r/f_z) B + C, for each way that slip can take: of each B and C.
fn passive(
    patch: &ElementStates,
    cell: &Cell,
    view: &View,
    frame: &Frame,
) -> impl Iterator<Item = (Interval, Interval)> {
    let [energy_z, energy_r] = patch.law.energies_by_force(cell, [view.gx, view.gy]);
    let depth = Interval::new(cell.depth_m[0] - patch.radius_m, cell.depth_m[1] - patch.radius_m);
    let per_q = Interval::ONE.per(frame.q);
    let deflection = Interval::new(cell.reach_m[0], cell.reach_m[1]) * per_q;
    let ways = frame.ways(view, patch.aside);
    let terms = ways.map(|way| {
        let (t, way) = way?;
        let m = frame.motion(view, t, way);
        let sinking = deflection * m.kappa - m.dip;
        let b = (m.way + sinking * frame.along_u + depth * m.bend - deflection * m.twisted * 0.5) * per_q
            - (t[0] * energy_r[0] + t[1] * energy_r[1]);
        let c = m.dip - deflection * m.kappa - (t[0] * energy_z[0] + t[1] * energy_z[1]);
        Some((b, c))
    });
    terms.into_iter().flatten()
}

/// The bound of S, L or the pace, from what slip does.
pub(super) fn lipschitz(criterion: Criterion, patch: &ElementStates, s: &Slope) -> f64 {
    let eta = s.eta.max(patch.least_eta);
    match criterion {
        Criterion::SnapFree => s.eta,
        _ if eta <= 0.0 => f64::NEG_INFINITY,
        Criterion::Pace => -s.excess / eta,
        _ => -(s.stick + s.force * s.excess / eta),
    }
}

/// What slip does to the drive and the force.
pub(super) struct Slope {
    /// η = d(L − |f_t|)/ds, N/m, at least.
    pub eta: f64,
    /// |∂_s f|, N/m, at most.
    pub force: f64,
    /// |∂_x(|f_t| − L)|, N/m, at most.
    pub excess: f64,
    /// Greatest stiffness in stick, N/m.
    pub stick: f64,
}

fn slope(patch: &ElementStates, cell: &Cell, view: &View, frame: &Frame) -> Slope {
    // Along the force: v = w/|w|, t along P v.
    let isotropic = view.stretch.is_none();
    let per_w = Interval::ONE.per(length(frame.w));
    let v = if isotropic { frame.e } else { scaled(frame.w, per_w).map(|x| x.clip(-1.0, 1.0)) };
    let t = if isotropic { frame.d } else { frame.forced() };
    let way = if isotropic { frame.cosine } else { frame.way(t) };
    let m = frame.motion(view, t, way);

    let (z, r) = (cell.depth_m, cell.reach_m);
    let law = patch.law.reading(cell);
    let along = {
        let [x, y] = [view.gx, view.gy].map(|g| patch.law.gradient(cell, g));
        let blend = |x: Interval, y: Interval| t[0] * x + t[1] * y;
        Forces {
            normal: blend(x.normal, y.normal),
            lateral: blend(x.lateral, y.lateral),
            friction: blend(x.friction, y.friction),
        }
    };

    let depth = Interval::new(z[0] - patch.radius_m, z[1] - patch.radius_m);
    let per_q = Interval::ONE.per(frame.q);
    let deflection = Interval::new(r[0], r[1]) * per_q;
    let sinking = deflection * m.kappa - m.dip;
    let limit = law.limit_rate(sinking, &along);

    // ∂û = turn − û (û·turn).
    let turn_u = dot(frame.u, m.frame_gradient);
    let du = [0, 1, 2].map(|i| m.frame_gradient[i] - frame.u[i] * turn_u);
    // δ_t' = −t − û ∂δz − (δz − R) ∂û.
    let t3 = [t[0], t[1], Interval::ZERO];
    let d_tangential = sum([t3, scaled(frame.u, sinking), scaled(du, depth)]).map(|x| -x);
    let d_rho = (deflection * m.twisted * 0.5 - (m.way + sinking * frame.along_u + depth * m.bend)) * per_q;
    let d_lateral = law.slope.lateral * d_rho + along.lateral;
    let vu = dot(v, m.frame_gradient);
    // ∂f_t along v, and the parts of it across.
    let (lateral_force, force_t) = if isotropic {
        // ∂(f_r e) = e d f_r + f_r/δr (δ_t' − e (e·δ_t')); e·δ_t' = ∂δr.
        let across = [0, 1, 2].map(|i| d_tangential[i] - frame.e[i] * d_rho);
        (d_lateral, [0, 1, 2].map(|i| frame.e[i] * d_lateral + across[i] * law.secant))
    } else {
        let Some((tensor, _)) = &view.stretch else { unreachable!("an isotropic body has no tensor") };
        let stretched_d = tensor.map(|row| dot(row, d_tangential));
        let stretched_v = [0, 1, 2].map(|i| dot([tensor[0][i], tensor[1][i], tensor[2][i]], v));
        let dw_v =
            deflection * dot(v, m.twist) + dot(stretched_v, d_tangential) - vu * frame.along_u * deflection;
        // With g = f_r/ρ: ∂g w = (∂f_r − g ∂ρ) w/ρ, and w/ρ = P A e/q.
        let dg = d_lateral - law.secant * d_rho;
        let a = scaled(m.twist, deflection);
        let b = [0, 1, 2].map(|i| a[i] + stretched_d[i]);
        let (bu, ue) = (dot(frame.u, b), frame.along_u * deflection);
        let du_w = dot(du, frame.stretched) * deflection;
        let dw = [0, 1, 2].map(|i| b[i] - frame.u[i] * (bu + du_w) - du[i] * ue);
        let force = [0, 1, 2].map(|i| frame.w[i] * per_q * dg + dw[i] * law.secant);
        (frame.gain * dg + law.secant * dw_v, force)
    };
    let d_normal = law.slope.normal * sinking + along.normal;
    let force = sum([scaled(frame.u, d_normal), scaled(du, law.at.normal), force_t]);
    let [_, stretch] = patch.stretch();
    Slope {
        eta: (limit - lateral_force).lo,
        force: length(force).hi,
        excess: law.lateral_stiffness(stretch).hypot(law.limit_slope().magnitude()),
        stick: law.stiffness(stretch),
    }
}
