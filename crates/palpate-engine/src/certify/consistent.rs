//! P, S and L for the rules whose drive is more than the lateral force: `consistent`, and S and L of `exact` within an
//! element. With f = f_z + f_r and s = f_r/f everything is a mix of two parts, one for each force, that have a direction
//! also where both forces vanish.

use super::criteria::{BELOW, Criterion, Frame, Slope, lipschitz};
use super::interval::{Box3, Interval, applied, direction, dot, flat, length, scaled, sum};
use super::patch::{Cell, Patch, View};
use super::slopes::{Read, Slopes, join3};
use glam::{DMat3, DVec3};
use palpate_body::SlipRule;

/// Into how many parts the share s is cut at most.
const SHARES: usize = 4;
/// How much of the gradients, computed in single precision, may be rounding.
const SINGLE: f64 = 1e-6;
/// What the slip search takes for rounding of the drive, as a share of what is taken off the lateral force.
const NOISE: f64 = 6e-7;

/// The drive by the forces, g̃/f, and what it misses of g, (g − P g̃)/f: mixes of a part for each of the forces with the
/// share s of the lateral one, apart from what b's turning takes, which depends on both at once.
struct Drive {
    by: [Box3; 2],
    miss: [[Interval; 2]; 2],
    /// What the slip search takes for the drive's rounding.
    noise: [f64; 2],
    lever: Lever,
}

/// b/f and what turning takes of it.
struct Lever {
    /// ∇(u·b) as a matrix that takes b, by rows; nodes' means less the element's own.
    turn: [Box3; 3],
    miss: [Box3; 2],
    /// b/f = e ((1 − s) δr − s ζ) − s aside, before it is divided by |Σ n u|.
    e: Box3,
    deflection: Interval,
    depth: Interval,
    aside: Box3,
    per_length: Interval,
    u: Box3,
    /// For `exact`, along the element and not across û.
    own: bool,
}

impl Lever {
    /// At a share: what is taken off the drive, and what g has more.
    fn taken(&self, share: f64) -> (Box3, [Interval; 2]) {
        let along = self.deflection * (1.0 - share) - self.depth * share;
        let b = less(scaled(self.e, along), self.aside.map(|x| x * share));
        let b = scaled(b, self.per_length);
        let tilt = applied(&self.turn, b);
        if self.own {
            return (flat(tilt), [Interval::ZERO; 2]);
        }
        let through = dot(self.u, tilt);
        let miss = [0, 1].map(|i| dot(self.miss[i], b) - self.u[i] * through);
        (less(tilt, scaled(self.u, through)), miss)
    }
}

/// Rows of matrices along x, y and z, and what the two ways of reading them differ by.
type Change = ([[Box3; 3]; 3], [[Box3; 3]; 2]);

/// What nodes' gradients of frames and tensors are over a cell.
struct Turning {
    /// ∇(u·b) as a matrix that takes b, by rows; nodes' means less the element's own.
    turn: [Box3; 3],
    miss: [Box3; 2],
    /// ∇A along x, y and z; the same.
    change: Option<Change>,
    each: [DMat3; 3],
    changes: Option<[[DMat3; 3]; 3]>,
}

impl Turning {
    fn new(slopes: &Slopes, cell: &Cell, view: &View) -> Self {
        let [cos, sin] = view.turn;
        let r = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
        let each = slopes.turns(r);
        let turn = hull(cell, &each);
        let less = |row: Box3, own: DVec3| -> Box3 { std::array::from_fn(|i| row[i] - point(own[i])) };
        let miss = [0, 1].map(|i| less(turn[i], view.du[i]));
        let changes = slopes.changes(r);
        let change = changes.as_ref().zip(view.stretch.as_ref()).map(|(nodes, (_, own))| {
            let along = [0, 1, 2].map(|axis| hull(cell, &nodes.map(|n| n[axis])));
            let rows = |axis: usize| [0, 1, 2].map(|i| less(along[axis][i], own[axis].row(i)));
            (along, [rows(0), rows(1)])
        });
        Turning { turn, miss, change, each, changes }
    }
}

fn point(x: f64) -> Interval {
    Interval::point(x)
}

fn points(v: DVec3) -> Box3 {
    v.to_array().map(point)
}

/// Σ n m over a cell, by rows.
fn hull(cell: &Cell, m: &[DMat3; 3]) -> [Box3; 3] {
    let at = cell.corners.map(|n| m[0] * n[0] + m[1] * n[1] + m[2] * n[2]);
    std::array::from_fn(|i| std::array::from_fn(|j| Interval::hull(at.map(|m| m.col(j)[i]))))
}

/// The area coordinates.
fn coordinates(cell: &Cell) -> [Interval; 3] {
    [0, 1, 2].map(|l| Interval::hull(cell.corners.map(|n| n[l])))
}

/// Σ n_l u_l ((û − u_l)·X_l)/2: what turning vectors from the nodes' planes takes off their mix. A node's X_l has no part
/// along u_l.
fn turned(n: [Interval; 3], view: &View, u: Box3, x: &[Box3; 3]) -> Box3 {
    sum([0, 1, 2].map(|l| {
        let own = view.frames[l];
        let between = std::array::from_fn(|i| u[i] - point(own[i]));
        scaled(points(own), n[l] * dot(between, x[l]) * 0.5)
    }))
}

/// a − b.
fn less(a: Box3, b: Box3) -> Box3 {
    std::array::from_fn(|i| a[i] - b[i])
}

/// v − û (û·v).
fn across(u: Box3, v: Box3) -> Box3 {
    less(v, scaled(u, dot(u, v)))
}

fn quadratic(m: &[Box3; 3], e: Box3) -> Interval {
    dot(e, applied(m, e))
}

/// What the drive and its rate of change begin with.
struct Start {
    turning: Turning,
    n: [Interval; 3],
    depth: Interval,
    deflection: Interval,
    per_q: Interval,
    /// w/ρ.
    w: Box3,
}

impl Start {
    fn new(patch: &Patch, slopes: &Slopes, cell: &Cell, view: &View, frame: &Frame) -> Self {
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
    fn new(patch: &Patch, slopes: &Slopes, cell: &Cell, view: &View, frame: &Frame) -> Self {
        let (c, z, r) = (&cell.corners, cell.depth_m, cell.reach_m);
        let Start { turning, n, depth, deflection, per_q, w } = Start::new(patch, slopes, cell, view, frame);
        let beside = deflection * frame.along_u * per_q;
        let lever = Lever {
            e: frame.e,
            deflection,
            depth: depth + beside,
            aside: if patch.is_stretched() {
                less(scaled(w, depth), scaled(frame.e, depth))
            } else {
                [Interval::ZERO; 3]
            },
            per_length: frame.per_length,
            u: frame.u,
            own: patch.slip == SlipRule::Exact,
            turn: turning.turn,
            miss: turning.miss,
        };
        let energies = [
            slopes.normal.by_force(&patch.normal, c, z, view.turn),
            slopes.lateral.by_force(&patch.lateral, c, r, view.turn),
        ];
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
            if lever.own {
                return (flat(less(forces[k], mean)), [Interval::ZERO; 2], 0.0);
            }
            let bent = turned(n, view, frame.u, &nodes);
            let tilt = lever.taken(k as f64).0.iter().map(|x| x.magnitude()).sum::<f64>();
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
        Drive { by: [a, d], miss: [b, e], noise: [c, f], lever }
    }
}

fn rows(m: DMat3) -> [Box3; 3] {
    [0, 1, 2].map(|i| points(m.row(i)))
}

/// Slip states of a cell with a part of the shares s.
struct Piece {
    share: Interval,
    /// |P g̃|/f, at least.
    least: f64,
    /// g̃/f, (g − P g̃)/f, and P g̃'s direction.
    vector: Box3,
    miss: [Interval; 2],
    way: [Interval; 2],
}

/// Normal and lateral force and friction over a cell, and the shares there can be; none without a normal force.
fn shares(patch: &Patch, cell: &Cell) -> Option<(Interval, Interval, [Interval; SHARES], usize)> {
    let normal = patch.normal.rising(&cell.corners, cell.depth_m);
    let lateral = patch.lateral.rising(&cell.corners, cell.reach_m);
    if normal.hi <= 0.0 {
        return None;
    }
    let friction = patch.friction.hull(&cell.corners, cell.depth_m);
    let share = |a: f64, b: f64| if a > 0.0 { a / (a + b) } else { 0.0 };
    let (low, high) = (share(lateral.lo, normal.hi), share(lateral.hi, normal.lo.max(0.0)));
    let count = (((high - low) * SHARES as f64).ceil() as usize).clamp(1, SHARES);
    let at = |i: usize| low + (high - low) * (i as f64 / count as f64);
    Some((normal, friction, std::array::from_fn(|i| Interval::new(at(i), at(i + 1))), count))
}

/// g̃/f and (g − P g̃)/f over a range of shares: linear in them, so that the ends bound it.
fn pull(drive: &Drive, share: Interval) -> (Box3, [Interval; 2]) {
    let at = |s: f64| {
        let (taken, more) = drive.lever.taken(s);
        let mix = |a: Interval, b: Interval| a * (1.0 - s) + b * s;
        let vector: Box3 = std::array::from_fn(|i| mix(drive.by[0][i], drive.by[1][i]) - taken[i]);
        (vector, [0, 1].map(|i| mix(drive.miss[0][i], drive.miss[1][i]) + more[i]))
    };
    let ((a, m), (b, n)) = (at(share.lo), at(share.hi));
    (join3(a, b), [m[0].join(n[0]), m[1].join(n[1])])
}

/// What the slip search takes for rounding of [`pull`], at most.
fn noise(drive: &Drive, share: Interval) -> f64 {
    drive.noise[0] * (1.0 - share.lo) + drive.noise[1] * share.hi
}

/// The slip states of a cell; none where there are none.
fn slips(
    patch: &Patch,
    cell: &Cell,
    view: &View,
    frame: &Frame,
    drive: &Drive,
) -> Option<([Option<Piece>; SHARES], Interval)> {
    let (normal, friction, shares, count) = shares(patch, cell)?;
    let flatness = if patch.slip == SlipRule::Exact { 1.0 } else { frame.u[2].lo };
    let mut rests = false;
    let pieces = std::array::from_fn(|i| {
        let share = *shares.get(i).filter(|_| i < count)?;
        let (vector, miss) = pull(drive, share);
        let (size, noise) = (length(vector), noise(drive, share));
        let limit = (friction.lo.max(0.0) * (1.0 - share.hi) * BELOW - noise).max(0.0);
        if size.hi < limit {
            return None;
        }
        rests |= can_rest(size, noise, friction, share);
        let along = [vector[0], vector[1]];
        let least = length(flat(vector)).lo.max(limit * flatness);
        Some(Piece { share, least, vector, miss, way: direction(along) })
    });
    let any = pieces.iter().any(Option::is_some);
    (any && (rests || came_from_rest(patch, cell, view, frame))).then_some((pieces, normal))
}

/// Whether a drive of this size, by the forces, can be within the limit.
fn can_rest(size: Interval, noise: f64, friction: Interval, share: Interval) -> bool {
    size.lo * BELOW - noise <= friction.hi * (1.0 - share.lo)
}

/// Whether a step before a state could have been within the limit.
fn came_from_rest(patch: &Patch, cell: &Cell, view: &View, frame: &Frame) -> bool {
    let Some(slopes) = &patch.slopes else { return true };
    let [least, greatest] = patch.stretch().map(f64::sqrt);
    let way = patch.step_m * greatest;
    if cell.reach_m[0] <= way {
        return true;
    }
    // δ_t turns by no more than this, and its projection a little more.
    let turn = (patch.step_m * greatest / cell.reach_m[0]).min(1.0).asin() / frame.u[2].lo.max(0.1);
    if view.half + turn > 1.4 || least <= 0.0 {
        return true;
    }
    let before = Cell {
        depth_m: [(cell.depth_m[0] - patch.step_m).max(0.0), cell.depth_m[1] + patch.step_m],
        turn: [cell.turn[0] - turn, cell.turn[1] + turn],
        reach_m: [cell.reach_m[0] - way, cell.reach_m[1] + way],
        ..*cell
    };
    let view = patch.view(&before);
    let frame = Frame::new(patch, &view);
    let drive = Drive::new(patch, slopes, &before, &view, &frame);
    let Some((_, friction, shares, count)) = shares(patch, &before) else { return false };
    let rests =
        |&share: &Interval| can_rest(length(pull(&drive, share).0), noise(&drive, share), friction, share);
    shares.iter().take(count).any(rests)
}

/// As [`Criterion::bound`].
pub(super) fn bound(criterion: Criterion, patch: &Patch, cell: &Cell, view: &View, frame: &Frame) -> f64 {
    let Some(slopes) = &patch.slopes else { return f64::NEG_INFINITY };
    let drive = Drive::new(patch, slopes, cell, view, frame);
    let Some((pieces, normal)) = slips(patch, cell, view, frame, &drive) else { return f64::INFINITY };
    match criterion {
        Criterion::Passive if patch.slip == SlipRule::Exact => 0.0,
        Criterion::Passive => passive(patch, cell, frame, &pieces),
        // The floor is the paper's rule's.
        Criterion::Floor => f64::NEG_INFINITY,
        Criterion::SnapFree | Criterion::Lipschitz | Criterion::Pace => {
            let site = Site::new(patch, slopes, cell, view, frame, normal);
            lipschitz(criterion, &site.slope(&pieces, criterion != Criterion::SnapFree))
        }
    }
}

/// The least g·t/f = |P g̃|/f + (g − P g̃)·t/f, t along P g̃ or aside of it.
fn passive(patch: &Patch, cell: &Cell, frame: &Frame, pieces: &[Option<Piece>; SHARES]) -> f64 {
    let (sin, cos) = patch.aside.sin_cos();
    let friction = patch.friction.hull(&cell.corners, cell.depth_m);
    let of = |p: &Piece| {
        let rest = Interval::new(1.0 - p.share.hi, 1.0 - p.share.lo);
        let miss = p.miss;
        let size = (miss[0].square() + miss[1].square()).sqrt().hi;
        let along = |t: [Interval; 2], own: f64| {
            let helps = (t[0] * miss[0] + t[1] * miss[1]).lo;
            own * if own > 0.0 { cos } else { 1.0 } + (helps.min(helps * cos) - size * sin).max(-size)
        };
        let straight = along(p.way, p.least);
        if !patch.is_stretched() {
            return straight;
        }
        // The search leads aside of it (`Lateral::lead`).
        let pull = p.vector;
        let (force, stretched) = (length(pull), across(frame.u, frame.stretch(pull)));
        let limit = friction * rest;
        let way = (force - limit).clip(0.0, f64::INFINITY);
        let part = dot(pull, stretched).per(force.square()).clip(0.0, f64::INFINITY);
        let led = less(scaled(pull, limit * part + way * 2.0), scaled(stretched, way));
        let t = direction([led[0], led[1]]);
        // In û's plane the two are no farther apart than (2 − A) can turn a vector, and the element's is tilted.
        let [least, greatest] = patch.stretch().map(|a| (2.0 - a).max(0.0));
        let turned = 2.0 * (least * greatest).sqrt() / (least + greatest) - (1.0 - frame.u[2].lo.powi(2));
        let own = (t[0] * p.vector[0] + t[1] * p.vector[1]).lo;
        straight.min(along(t, if turned > 0.0 { own.max(p.least * turned) } else { own }))
    };
    pieces.iter().flatten().map(of).fold(f64::INFINITY, f64::min)
}

/// What changes by how much while the contact point moves along the element, or the tip.
struct Rate {
    drive: Box3,
    force: Box3,
    limit: Interval,
}

/// Forces and gradients over a cell.
struct Site<'a> {
    patch: &'a Patch,
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
    w: Box3,
    normal: Interval,
    normal_slope: Interval,
    friction: Interval,
    friction_slope: Interval,
    lateral_slope: Interval,
    secant: Interval,
    /// f_r' − f_r/ρ.
    bend: Interval,
    /// f_z − g (δz − R) − g û·A δ_t, N: what stands by δ_t in b.
    straight: Interval,
    /// P_û A e − e.
    aside: Box3,
    /// b/|Σ n u|, N.
    lever: Box3,
    /// The nodes' ∇(W_l + ½ g δ_t·A δ_t), N, and the sum of all that is taken off f_t.
    nodes: [Box3; 3],
    whole: Box3,
    /// ∂W/∂δz and ∂W/∂ρ of the nodes' gradients, N/m.
    rates: [Read; 2],
}

impl<'a> Site<'a> {
    fn new(
        patch: &'a Patch,
        slopes: &'a Slopes,
        cell: &'a Cell,
        view: &'a View,
        frame: &'a Frame,
        normal: Interval,
    ) -> Self {
        let (c, z, r) = (&cell.corners, cell.depth_m, cell.reach_m);
        let Start { turning, n, depth, deflection, per_q, w } = Start::new(patch, slopes, cell, view, frame);
        let lateral = patch.lateral.rising(c, r);
        let secant = patch.lateral.secant(c, r);
        // b = (f_z − g (δz − R) − g û·A δ_t) δ_t − g (δz − R) (P_û A − 1) δ_t.
        let beside = lateral * frame.along_u * per_q;
        let straight = patch.normal.above_line(c, z, secant, patch.radius_m) - beside;
        let aside = if patch.is_stretched() { less(frame.w, frame.e) } else { [Interval::ZERO; 3] };
        let lever = less(scaled(frame.e, deflection * straight), scaled(aside, secant * deflection * depth));
        let lever = scaled(lever, frame.per_length);
        let [a, b] = [
            slopes.normal.value(&patch.normal, c, z, view.turn),
            slopes.lateral.value(&patch.lateral, c, r, view.turn),
        ];
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
        let mut whole = sum([mean, applied(&turning.turn, lever)]);
        if patch.slip != SlipRule::Exact {
            whole = less(whole, turned(n, view, frame.u, &nodes));
        }
        Site {
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
            normal,
            normal_slope: patch.normal.slope(c, z),
            friction: patch.friction.hull(c, z),
            friction_slope: patch.friction.slope(c, z),
            lateral_slope: patch.lateral.slope(c, r),
            secant,
            bend: patch.lateral.bend(c, r),
            straight,
            aside,
            lever,
            nodes,
            whole,
            rates: [
                slopes.normal.rate(&patch.normal, c, z, view.turn),
                slopes.lateral.rate(&patch.lateral, c, r, view.turn),
            ],
        }
    }

    /// While δ changes by `delta`: as c moves along the element's `axis`, or the tip with c held.
    fn rate(&self, delta: DVec3, axis: Option<usize>) -> Rate {
        let Site { patch, cell, view, frame, .. } = self;
        let (u, e, zero) = (frame.u, frame.e, Interval::ZERO);
        let g = axis.map_or([0.0; 3], |k| if k == 0 { view.gx } else { view.gy });
        let delta = points(delta);

        // û, δz, δ_t, ρ.
        let turn = axis.map_or([zero; 3], |k| scaled(points(view.du[k]), frame.per_length));
        let stretching = dot(u, turn);
        let du = less(turn, scaled(u, stretching));
        let d_depth = self.deflection * dot(e, turn) + dot(u, delta);
        let d_tangential: Box3 = std::array::from_fn(|i| delta[i] - u[i] * d_depth - du[i] * self.depth);
        let twist = match (axis, &view.stretch) {
            (Some(k), Some((_, own))) => applied(&rows(own[k]), e),
            _ => [zero; 3],
        };
        // δ_t'·A e, with du·A e = turn·w.
        let d_rho = (dot(delta, frame.stretched) - d_depth * frame.along_u - self.depth * dot(turn, frame.w)
            + self.deflection * dot(e, twist) * 0.5)
            * self.per_q;

        // Forces.
        let gradient = |curves: &super::curves::Curves, span| {
            if axis.is_some() { curves.gradient(g, span) } else { zero }
        };
        let (z, r) = (cell.depth_m, cell.reach_m);
        let normal_gradient = gradient(&patch.normal, z);
        let d_normal = self.normal_slope * d_depth + normal_gradient;
        let limit = (self.friction_slope * self.normal + self.friction * self.normal_slope) * d_depth
            + gradient(&patch.friction, z) * self.normal
            + self.friction * normal_gradient;
        // ρ d(f_r/ρ), and f_t = f_r/ρ w.
        let d_secant = self.bend * d_rho + gradient(&patch.lateral, r);
        let d_stretched = sum([scaled(twist, self.deflection), frame.stretch(d_tangential)]);
        let along = self.deflection * frame.along_u;
        let bent = self.deflection * dot(du, frame.stretched);
        let dw = if patch.is_stretched() {
            let through = dot(u, d_stretched) + bent;
            std::array::from_fn(|i| d_stretched[i] - u[i] * through - du[i] * along)
        } else {
            d_tangential
        };
        let d_lateral = sum([scaled(self.w, d_secant), scaled(dw, self.secant)]);
        let force = sum([scaled(u, d_normal), scaled(du, self.normal), d_lateral]);

        // b, and what is taken off f_t.
        let d_beside = if patch.is_stretched() {
            d_secant * frame.along_u * self.per_q + self.secant * (bent + dot(u, d_stretched))
        } else {
            zero
        };
        // Both forces' slopes together, and what is left of A apart.
        let along_e = self.deflection
            * ((self.normal_slope - self.secant) * d_depth + normal_gradient - d_beside)
            - self.depth * d_secant;
        let d_lever: Box3 = std::array::from_fn(|i| {
            let rest = if patch.is_stretched() {
                (self.w[i] - e[i]) * (d_secant * self.depth)
                    + (dw[i] - d_tangential[i]) * (self.secant * self.depth)
                    + self.aside[i] * (self.secant * self.deflection * d_depth)
            } else {
                zero
            };
            d_tangential[i] * self.straight + e[i] * along_e - rest
        });
        let basis = view.turn;
        let mut taken = sum([
            scaled(self.rates[0].sum, d_depth),
            scaled(self.rates[1].sum, d_rho),
            applied(&self.turning.turn, scaled(d_lever, frame.per_length)),
        ]);
        let own = patch.slip == SlipRule::Exact;
        if axis.is_some() {
            let lengthen = scaled(applied(&self.turning.turn, self.lever), stretching);
            taken = less(taken, lengthen);
            if !own {
                let mixed = (0..3).fold(DMat3::ZERO, |sum, l| sum + self.turning.each[l] * g[l]);
                taken = sum([
                    taken,
                    self.slopes.normal.second(&patch.normal, g, z, basis),
                    self.slopes.lateral.second(&patch.lateral, g, r, basis),
                    applied(&rows(mixed), self.lever),
                ]);
            }
        }
        let mut d_nodes: [Box3; 3] = [0, 1, 2].map(|l: usize| {
            sum([scaled(self.rates[0].nodes[l], d_depth), scaled(self.rates[1].nodes[l], d_rho)])
        });
        if let (Some((along, _)), Some(changes)) = (&self.turning.change, &self.turning.changes) {
            // d(½ g δ_t·K δ_t) = ½ (ρ dg) (δr/q) e·K e + g δr e·K dδ_t.
            let (grown, by) = (d_secant * self.deflection * self.per_q * 0.5, self.secant * self.deflection);
            let square = self.secant * self.deflection.square() * 0.5;
            let of = |k: &[Box3; 3]| quadratic(k, e) * grown + dot(applied(k, e), d_tangential) * by;
            for axis in 0..3 {
                taken[axis] = taken[axis] + of(&along[axis]);
                for (node, change) in d_nodes.iter_mut().zip(changes) {
                    node[axis] = node[axis] + of(&rows(change[axis]));
                }
                if !own {
                    let mixed = (0..3).fold(DMat3::ZERO, |sum, l| sum + changes[l][axis] * g[l]);
                    taken[axis] = taken[axis] + quadratic(&rows(mixed), e) * square;
                }
            }
        }
        if own {
            return Rate { drive: flat(less(force, taken)), force, limit };
        }
        taken = less(taken, turned(self.n, view, u, &d_nodes));
        for (l, (node, share)) in view.frames.iter().zip(g).enumerate() {
            // The nodes' parts of the mix, and û, change too.
            let between = std::array::from_fn(|i| u[i] - point(node[i]));
            let part = dot(between, self.nodes[l]) * (0.5 * share) + self.n[l] * dot(du, self.nodes[l]) * 0.5;
            taken = less(taken, scaled(points(*node), part));
        }
        // P_û turns with û.
        let inside = dot(u, self.whole);
        if axis.is_some() {
            // All that is along û is left out: the drive's direction is at right angles to it.
            let bare: Box3 = std::array::from_fn(|i| delta[i] - turn[i] * self.depth);
            let bare = if patch.is_stretched() {
                std::array::from_fn(|i| d_stretched[i] - turn[i] * along)
            } else {
                bare
            };
            let drive = std::array::from_fn(|i| {
                self.w[i] * d_secant + bare[i] * self.secant - taken[i] + turn[i] * inside
            });
            return Rate { drive, force, limit };
        }
        let through = dot(u, taken) + dot(du, self.whole);
        let reaction: Box3 = std::array::from_fn(|i| taken[i] - u[i] * through - du[i] * inside);
        Rate { drive: less(d_lateral, reaction), force, limit }
    }

    /// What slip does to the drive and the force: along t, P v's direction, v = g̃/|g̃|.
    fn slope(&self, pieces: &[Option<Piece>; SHARES], tips: bool) -> Slope {
        let Site { patch, frame, .. } = self;
        let own = patch.slip == SlipRule::Exact;
        let [x, y] = [DVec3::X, DVec3::Y];
        let along = [self.rate(-x, Some(0)), self.rate(-y, Some(1))];
        // v = |P v| Σ t_i a_i with a_i = E_i − N û_i/û_z.
        let lean = [0, 1].map(|i| if own { Interval::ZERO } else { frame.u[i].per(frame.u[2]) });
        let fall = [0, 1].map(|i| [0, 1].map(|j: usize| lean[i] * along[j].drive[2] - along[j].drive[i]));
        // Both entries of the diagonal at their least: a quadratic form grows with them.
        let (mean, spread) = (0.5 * (fall[0][0].lo + fall[1][1].lo), 0.5 * (fall[0][0].lo - fall[1][1].lo));
        let skew = (fall[0][1] + fall[1][0]) * 0.5;
        // Whatever the direction: its least eigenvalue.
        let eigenvalue = mean - spread.hypot(skew.magnitude());
        let eta = |t: [Interval; 2]| {
            let out = lean[0] * t[0] + lean[1] * t[1];
            let size = Interval::ONE.per((Interval::ONE + out.square()).sqrt());
            // With t = (cos φ, sin φ): mean + spread cos 2φ + skew sin 2φ.
            let cos2 = (t[0].square() - t[1].square()).clip(-1.0, 1.0);
            let sin2 = (t[0] * t[1] * 2.0).clip(-1.0, 1.0);
            let falls = mean + (cos2 * spread + skew * sin2).lo;
            let falls = falls.max(eigenvalue);
            let limit = (along[0].limit * t[0] + along[1].limit * t[1]).lo;
            let limit = limit.max(-along[0].limit.magnitude().hypot(along[1].limit.magnitude()));
            limit + falls * if falls < 0.0 { size.hi } else { size.lo }
        };
        let ways = pieces.iter().flatten().map(|p| p.way);
        let eta = ways.clone().map(eta).fold(f64::INFINITY, f64::min);
        let t = ways.reduce(|a, b| [a[0].join(b[0]), a[1].join(b[1])]).unwrap_or([Interval::ZERO; 2]);
        let out = lean[0] * t[0] + lean[1] * t[1];
        let size = Interval::ONE.per((Interval::ONE + out.square()).sqrt());
        let force = sum([scaled(along[0].force, t[0]), scaled(along[1].force, t[1])]);

        let v = [size * t[0], size * t[1], -(size * out)];
        let frictionless = self.friction.lo <= 0.0;
        let tip = |axis: DVec3| {
            let rate = self.rate(axis, None);
            let pull = if frictionless { length(rate.drive).hi } else { dot(v, rate.drive).magnitude() };
            let limit = rate.limit.magnitude();
            if frictionless { pull + limit } else { (dot(v, rate.drive) - rate.limit).magnitude() }
        };
        let excess: f64 = if tips { DVec3::AXES.map(tip).iter().map(|x| x * x).sum() } else { 0.0 };
        let steepest = patch.stretch()[1] * self.lateral_slope.hi.max(self.secant.hi);
        Slope {
            eta,
            force: length(force).hi.min((length(along[0].force).hi).hypot(length(along[1].force).hi)),
            excess: excess.sqrt(),
            stick: self.normal_slope.hi.max(steepest),
        }
    }
}

/// Where a state's drive comes to its limit as the deflection grows, m; its own where it does not.
pub(super) fn limit_reach(patch: &Patch, state: &Cell) -> f64 {
    let reach = state.reach_m[0];
    crossing(patch, state, [0.0, patch.reach_m], 16).unwrap_or(reach)
}

/// The largest ρ in a range beyond which the drive is over its limit, m, or where it is least over it: to a third of the range
/// by look, and from there in so many steps.
pub(super) fn crossing(patch: &Patch, state: &Cell, [least, most]: [f64; 2], steps: u32) -> Option<f64> {
    let excess = |reach: f64| {
        let state = Cell { reach_m: [reach; 2], ..*state };
        over(patch, &state)
    };
    let at = |i: u32| least + (most - least) * f64::from(i) / 3.0;
    let (mut high, mut beyond) = (most, excess(most)?);
    let mut nearest = (beyond, most);
    for i in (0..3).rev() {
        let (low, within) = (at(i), excess(at(i))?);
        if beyond >= 0.0 && within < 0.0 {
            let (mut a, mut b, mut fa, mut fb) = (low, high, within, beyond);
            for _ in 0..steps {
                // The false position, with the end that stays halved (Illinois); what is kept is beyond the limit.
                let c = (b - fb * (b - a) / (fb - fa)).clamp(a, b);
                let f = excess(c)?;
                if f >= 0.0 {
                    (b, fb) = (c, f);
                    fa *= 0.5;
                } else {
                    (a, fa) = (c, f);
                    fb *= 0.5;
                }
                if b - a < 1e-9 * most {
                    break;
                }
            }
            return Some(b);
        }
        (high, beyond) = (low, within);
        if within.abs() < nearest.0.abs() {
            nearest = (within, low);
        }
    }
    Some(nearest.1).filter(|_| nearest.0 >= 0.0)
}

/// |g̃|/f − μ f_z/f at a state.
fn over(patch: &Patch, state: &Cell) -> Option<f64> {
    let slopes = patch.slopes.as_ref()?;
    let view = patch.view(state);
    let frame = Frame::new(patch, &view);
    let drive = Drive::new(patch, slopes, state, &view, &frame);
    let (_, friction, shares, _) = shares(patch, state)?;
    let share = shares[0];
    Some(length(pull(&drive, share).0).hi - friction.hi * (1.0 - share.lo))
}
