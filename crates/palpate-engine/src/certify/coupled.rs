//! Bodies with a coupled law over a cell: drive, forces and limit are read from [`palpate_body::law`] itself,
//! over [`Centred`] numbers, which bound what they stand for; and S and L from dual numbers of these, with
//! derivatives by the motions of contact point and tool.

use super::centred::Centred;
use super::criteria::{Criterion, below, lipschitz};
use super::drive::{NOISE, SINGLE};
use super::interval::{Interval, IntervalVector, direction, flat, length};
use super::patch::{Cell, ElementStates, View};
use super::rates::{Rate, slope};
use super::states::before;
use glam::{DMat3, DVec3};
use palpate_body::law::{
    CoupledRow, QUANTITIES, Reach, Symmetric, at_depth, coupled, eigenvalues, in_space, inverse, monomials,
    moved, tool_motion,
};
use palpate_body::{Body, Dual, Number, SlipRule};
use std::array::from_fn;
use std::f64::consts::FRAC_PI_2;

/// P is asked of states from this share of the greatest depth on: all forces vanish with the depth, and no
/// bound of their ratios is known there.
pub const SHALLOWEST: f64 = 0.02;

/// The coupled law of an element's nodes, in the element's basis.
#[derive(Debug, Clone)]
pub(super) struct Coupled {
    /// Of δz, m.
    knots: Vec<f64>,
    pub range_m: f64,
    points: Vec<Point>,
    sums: Vec<Summed>,
    /// The least and the greatest κ of the nodes, or 0, 1/m; none where the tool moves as the contact point does.
    curvatures: Option<[f64; 2]>,
    /// The nodes' ∇(u·b) as matrices that take b, 1/m; none but for `consistent`.
    turns: Option<[DMat3; 3]>,
}

/// A test point that the nodes blend, or whose energy is in their gradients.
#[derive(Debug, Clone)]
struct Point {
    test_point: u32,
    /// (knots)
    rows: Vec<CoupledRow>,
    tangents: [DVec3; 2],
    /// κ₁₁, κ₁₂, κ₂₂ in the tangents, 1/m.
    curvature: [f64; 3],
    /// Of the three nodes: weights, and what ∇W_l takes its energy times, 1/m.
    weights: [f64; 3],
    gradients: [DVec3; 3],
}

/// A node whose ∇W_l is summed beforehand: one row for each axis of the element, (knots × 3).
#[derive(Debug, Clone)]
struct Summed {
    node: usize,
    rows: Vec<[CoupledRow; 3]>,
    tangents: [DVec3; 2],
}

/// A contact point and a deflection.
struct Situation<T> {
    n: [T; 3],
    u: [T; 3],
    /// 1/|Σ n u|.
    per_length: T,
    depth: T,
    /// δ_t and its square.
    tangential: [T; 3],
    square: T,
}

/// What the law says of a node: f_z, μ, what δ_t is taken times in ∂W/∂δ_t, its rest, and W; and ∇W.
#[derive(Clone, Copy)]
struct NodeLaw<T> {
    quantities: [T; 7],
    gradient: [T; 3],
}

/// What bounds are made of, at a situation.
#[derive(Clone, Copy)]
struct State<T> {
    u: [T; 3],
    /// The slip rule's drive d, and what is taken off f_t for it, N.
    drive: [T; 3],
    reaction: [T; 3],
    /// W's own slope along the element less P d and f_z⁺ P û, g − P (d + f_z⁺ û), N.
    miss: [T; 2],
    /// f_z⁺ = max(f_z, 0), f and L, N, and μ.
    pushing: T,
    force: [T; 3],
    limit: T,
    friction: T,
    /// M⁻¹ d, what is brought within L, and M⁻² d, along which c goes; the same as d where the tool moves as the contact point does.
    by_tool: [T; 3],
    way: [T; 3],
}

impl<T: Copy> State<T> {
    fn map<V>(&self, of: impl Fn(T) -> V) -> State<V> {
        let of = &of;
        State {
            u: self.u.map(of),
            drive: self.drive.map(of),
            reaction: self.reaction.map(of),
            miss: self.miss.map(of),
            pushing: of(self.pushing),
            force: self.force.map(of),
            limit: of(self.limit),
            friction: of(self.friction),
            by_tool: self.by_tool.map(of),
            way: self.way.map(of),
        }
    }
}

impl Coupled {
    /// Of an element, with friction times `factor`; `axes` and `gradients` are the element's basis and ∇n in
    /// it.
    pub fn new(body: &Body, element: u32, rule: SlipRule, axes: [DVec3; 3], factor: f64) -> Self {
        let (nodes, numbers) = (body.element_nodes(element), body.element_node_numbers(element));
        let (potentials, knots) = (body.potentials(), body.responses().depth_knots().values());
        let basis = DMat3::from_cols(axes[0], axes[1], axes[2]);
        let local = |v: DVec3| basis.transpose() * v;
        let mut law = Coupled {
            knots: knots.to_vec(),
            range_m: potentials.range_m(),
            points: Vec::new(),
            sums: Vec::new(),
            curvatures: None,
            turns: None,
        };
        for (l, node) in nodes.iter().enumerate() {
            for (t, w) in node.test_points.into_iter().zip(node.weights).filter(|(_, w)| *w != 0.0) {
                law.point(body, t, local, factor).weights[l] += w;
            }
        }
        let curved = law.points.iter().map(|point| point.curvature).filter(|k| *k != [0.0; 3]);
        if rule != SlipRule::Paper {
            let each = curved.map(eigenvalues);
            law.curvatures = each.fold(None, |all, [low, high]| {
                let [least, most] = all.unwrap_or_default();
                Some([low.min(least), high.max(most)])
            });
        }
        if rule == SlipRule::Consistent {
            let derived = body.prepared_gradients();
            law.turns = Some(numbers.map(|node| {
                let columns = DVec3::AXES.map(|b| derived.frame_gradient(node, b.as_vec3a()).as_dvec3());
                basis.transpose() * DMat3::from_cols(columns[0], columns[1], columns[2]) * basis
            }));
            for (l, (node, number)) in nodes.into_iter().zip(numbers).enumerate() {
                let first = node.test_points[0];
                for (t, g) in derived.terms(number) {
                    law.point(body, t, local, factor).gradients[l] += local(g);
                    law.point(body, first, local, factor).gradients[l] -= local(g);
                }
                let rows = (0..knots.len()).map_while(|i| derived.coupled_rows(number, i));
                let rows: Vec<_> = rows.map(|rows| turned(&rows, basis)).collect();
                if !rows.is_empty() {
                    let tangents = potentials.at(first, 0).tangents.map(local);
                    law.sums.push(Summed { node: l, rows, tangents });
                }
            }
        }
        law
    }

    /// A test point among the element's; a new one if it is none yet.
    fn point(&mut self, body: &Body, t: u32, local: impl Fn(DVec3) -> DVec3, factor: f64) -> &mut Point {
        let known = self.points.iter().position(|p| p.test_point == t);
        let i = known.unwrap_or_else(|| {
            let row = |i: usize| {
                let mut row = *body.potentials().at(t, i).row;
                row.iter_mut().for_each(|power| power[QUANTITIES - 1] *= factor);
                row
            };
            self.points.push(Point {
                test_point: t,
                rows: (0..self.knots.len()).map(row).collect(),
                tangents: body.potentials().at(t, 0).tangents.map(local),
                curvature: body.potentials().at(t, 0).plane_curvature(),
                weights: [0.0; 3],
                gradients: [DVec3::ZERO; 3],
            });
            self.points.len() - 1
        });
        &mut self.points[i]
    }

    /// The parts of a range of depths between knots.
    fn pieces(&self, [low, high]: [f64; 2]) -> impl Iterator<Item = (usize, [f64; 2])> + '_ {
        let first = self.knots.iter().skip(1).take_while(|&&k| k <= low).count();
        (first..self.knots.len()).map_while(move |i| {
            let next = self.knots.get(i + 1).copied().unwrap_or(f64::INFINITY);
            (i == first || self.knots[i] < high).then(|| (i, [low.max(self.knots[i]), high.min(next)]))
        })
    }
}

/// Rows of the body's axes as rows of the basis'.
fn turned(rows: &[CoupledRow; 3], basis: DMat3) -> [CoupledRow; 3] {
    let mut out = *rows;
    for power in 0..4 {
        for q in 0..QUANTITIES {
            let v = basis.transpose() * DVec3::new(rows[0][power][q], rows[1][power][q], rows[2][power][q]);
            (out[0][power][q], out[1][power][q], out[2][power][q]) = (v.x, v.y, v.z);
        }
    }
    out
}

/// A row in powers of the distance from `t`.
fn expanded([a, b, c, d]: &CoupledRow, t: f64) -> CoupledRow {
    let each = |of: &dyn Fn(usize) -> f64| from_fn(of);
    [
        each(&|q| a[q] + t * (b[q] + t * (c[q] + t * d[q]))),
        each(&|q| b[q] + t * (2.0 * c[q] + t * (3.0 * d[q]))),
        each(&|q| c[q] + t * (3.0 * d[q])),
        *d,
    ]
}

fn dot<T: Number>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn along<T: Number>(a: [T; 3], v: DVec3) -> T {
    a[0] * v.x + a[1] * v.y + a[2] * v.z
}

/// v − û (û·v).
fn across<T: Number>(u: [T; 3], v: [T; 3]) -> [T; 3] {
    let through = dot(u, v);
    from_fn(|i| v[i] - u[i] * through)
}

/// A cell of one interval of the depth, in a basis turned to its middle direction.
struct Place<'a> {
    patch: &'a ElementStates,
    law: &'a Coupled,
    view: &'a View,
    interval: usize,
    depth_m: [f64; 2],
    /// The depth in the middle of the cell, m: rows are expanded there, so that intervals of the depth stay
    /// narrow.
    middle: f64,
    /// The azimuth about z.
    turn: DMat3,
}

impl<'a> Place<'a> {
    fn new(
        patch: &'a ElementStates,
        law: &'a Coupled,
        view: &'a View,
        (interval, [low, high]): (usize, [f64; 2]),
    ) -> Self {
        let [cos, sin] = view.azimuth;
        let turn = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
        Place { patch, law, view, interval, depth_m: [low, high], middle: 0.5 * (low + high), turn }
    }

    /// A contact point and a deflection in a direction of the element.
    fn situation<T: Number>(&self, n: [T; 3], [cos, sin]: [T; 2], depth: T, reach: T) -> Situation<T> {
        let (sum, u, per_length) = self.frame(n);
        let slope = -(cos * sum[0] + sin * sum[1]) * sum[2].recip();
        let cosine = (slope * slope + 1.0).sqrt().recip();
        let tangential = [cos, sin, slope].map(|x| x * cosine * reach);
        Situation { n, u, per_length, depth, tangential, square: reach * reach }
    }

    /// Σ n u, û and 1/|Σ n u|.
    fn frame<T: Number>(&self, n: [T; 3]) -> ([T; 3], [T; 3], T) {
        let frames = self.view.frames.map(|u| u.to_array());
        let sum: [T; 3] = from_fn(|i| T::blend(n, frames.map(|u| T::constant(u[i]))));
        let per_length = dot(sum, sum).sqrt().recip();
        (sum, sum.map(|x| x * per_length), per_length)
    }

    /// The same while the contact point moves along x and y, and then, for `M` = 5, the tool along x, y and
    /// z.
    fn moving<T: Number, const M: usize>(&self, s: &Situation<T>) -> Situation<Dual<T, M>> {
        let zero = T::constant(0.0);
        let n: [Dual<T, M>; 3] = from_fn(|l| {
            let by = [self.view.gx[l], self.view.gy[l]];
            Dual { value: s.n[l], partials: from_fn(|k| T::constant(by.get(k).copied().unwrap_or(0.0))) }
        });
        let (_, u, per_length) = self.frame(n);
        let lever = s.depth + -self.patch.radius_m;
        // δ = x − c, δz = δ·û + R, δ_t = δ − (δ·û) û.
        let motions: [[T; 5]; M] = from_fn(|k| {
            let (axis, sign) = if k < 2 { (k, -1.0) } else { (k - 2, 1.0) };
            let delta: [T; 3] = from_fn(|i| T::constant(if i == axis { sign } else { 0.0 }));
            let du = u.map(|u| u.partials[k]);
            let d_depth = s.u[axis] * sign + dot(s.tangential, du);
            let [x, y, z] = from_fn(|i| delta[i] - s.u[i] * d_depth - du[i] * lever);
            let half = s.tangential[axis] * sign - lever * dot(s.tangential, du);
            [d_depth, x, y, z, half * 2.0]
        });
        let of = |value: T, i: usize| Dual { value, partials: motions.map(|m| *m.get(i).unwrap_or(&zero)) };
        Situation {
            n,
            u: from_fn(|i| Dual { value: s.u[i], partials: u[i].partials }),
            per_length,
            depth: of(s.depth, 0),
            tangential: from_fn(|i| of(s.tangential[i], i + 1)),
            square: of(s.square, 4),
        }
    }

    /// What the law and the slip rule say there.
    fn state<T: Number>(&self, s: &Situation<T>) -> State<T> {
        let Place { patch, law, view, interval, .. } = *self;
        let local = |v: DVec3| self.turn.transpose() * v;
        let zero = T::constant(0.0);
        let t = s.depth + -self.middle;
        let row = |row: &CoupledRow| expanded(row, self.middle - law.knots[interval]);
        let reach = Reach::new(s.square, law.range_m);
        let mut each = [NodeLaw { quantities: [zero; 7], gradient: [zero; 3] }; 3];
        for point in &law.points {
            let tangents = point.tangents.map(local);
            let xi = tangents.map(|t| along(s.tangential, t));
            let quantities = at_depth(&row(&point.rows[interval]), t);
            let at = coupled(&quantities, xi, &reach);
            let [t1, t2] = tangents.map(|t| t.to_array());
            let [x, y, z]: [T; 3] = from_fn(|i| at.lateral[0] * t1[i] + at.lateral[1] * t2[i]);
            let all = [at.normal, quantities.value[QUANTITIES - 1], at.radial, x, y, z, at.energy];
            for ((node, w), g) in each.iter_mut().zip(point.weights).zip(point.gradients) {
                if w != 0.0 {
                    node.quantities = from_fn(|i| node.quantities[i] + all[i] * w);
                }
                if g != DVec3::ZERO {
                    let g = local(g).to_array();
                    node.gradient = from_fn(|i| node.gradient[i] + at.energy * g[i]);
                }
            }
        }
        for Summed { node, rows, tangents } in &law.sums {
            let monomials = monomials(tangents.map(|t| along(s.tangential, local(t))), &reach);
            let sums = rows[interval].each_ref().map(|of| {
                let quantities = at_depth(&row(of), t).value;
                monomials.into_iter().zip(quantities).fold(zero, |sum, (m, q)| sum + q * m)
            });
            let turn = [self.turn.x_axis, self.turn.y_axis, DVec3::Z];
            each[*node].gradient = turn.map(|axis| along(sums, axis));
        }
        let blended: [T; 7] = from_fn(|i| T::blend(s.n, each.map(|node| node.quantities[i])));
        let [normal, friction, radial, gradient @ .., _] = blended;
        let nodes = each.map(|node| node.gradient);
        let p: [T; 3] = from_fn(|i| gradient[i] + s.tangential[i] * radial);
        let (lateral, lever) = (across(s.u, p), s.depth + -patch.radius_m);
        let force = from_fn(|i| s.u[i] * normal + lateral[i]);
        // b/|Σ n u|.
        let pressing = normal - dot(s.u, p);
        let couple: [T; 3] = from_fn(|i| (s.tangential[i] * pressing - lateral[i] * lever) * s.per_length);
        // Σ (W_l + b·u_l/|Σ n u|) ∇n_l; the ∇n_l have no sum.
        let [w0, w1, w2] = each.map(|node| node.quantities[6]);
        let own: [T; 2] = [view.gx, view.gy].map(|[_, g1, g2]| (w1 - w0) * g1 + (w2 - w0) * g2);
        let own: [T; 2] = from_fn(|i| own[i] + along(couple, view.du[i]));
        // Where f_z pulls it is no part of what the slip resists.
        let pushing = normal.at_least(0.0);
        let pulling = normal - pushing;
        let (drive, reaction, miss) = match (patch.slip, &law.turns) {
            (SlipRule::Exact, _) => {
                let reaction = [own[0], own[1], zero];
                let drive = [force[0] - own[0], force[1] - own[1], zero];
                (drive, reaction, [zero; 2])
            }
            (SlipRule::Consistent, Some(turns)) => {
                let whole = [0, 1, 2].map(|l| {
                    let turns = self.turn.transpose() * turns[l] * self.turn;
                    // Turned from the node's plane into c's; ∇W_l has no part along u_l.
                    let frame = view.frames[l].to_array();
                    let through = dot(from_fn(|i| s.u[i] + -frame[i]), nodes[l]) * 0.5;
                    from_fn(|i| nodes[l][i] - through * frame[i] + along(couple, turns.row(i)))
                });
                let whole: [T; 3] = from_fn(|i| T::blend(s.n, whole.map(|at: [T; 3]| at[i])));
                let reaction = across(s.u, whole);
                let miss = from_fn(|i| reaction[i] - own[i] + s.u[i] * pulling);
                (from_fn(|i| lateral[i] - reaction[i]), reaction, miss)
            }
            _ => (lateral, [zero; 3], from_fn(|i| s.u[i] * pulling - own[i])),
        };
        let (by_tool, way) = match self.tool_motion(s) {
            None => (drive, drive),
            Some(tensor) => {
                let inverse = inverse(tensor);
                let by_tool = moved(&inverse, drive);
                (by_tool, moved(&inverse, by_tool))
            }
        };
        let limit = friction * pushing;
        State { u: s.u, drive, reaction, miss, pushing, force, limit, friction, by_tool, way }
    }

    /// How the tool moves with the contact point, M; `None`: as it does.
    fn tool_motion<T: Number>(&self, s: &Situation<T>) -> Option<Symmetric<T>> {
        self.law.curvatures?;
        let mut nodes = [[0.0; 6]; 3];
        for point in &self.law.points {
            let curvature = in_space(point.curvature, point.tangents.map(|t| self.turn.transpose() * t));
            for (node, w) in nodes.iter_mut().zip(point.weights) {
                node.iter_mut().zip(curvature).for_each(|(sum, k)| *sum += w * k);
            }
        }
        let curvature = from_fn(|i| T::blend(s.n, nodes.map(|node| T::constant(node[i]))));
        let radius = self.patch.radius_m;
        // The plane that drives lie in.
        let up = [0.0, 0.0, 1.0].map(T::constant);
        let normal = if self.patch.slip == SlipRule::Exact { up } else { s.u };
        Some(tool_motion(curvature, normal, -s.depth + radius, radius))
    }

    /// Between these lie M's eigenvalues over the cell, and 1.
    fn motion_bounds(&self) -> [f64; 2] {
        let Some(curvatures) = self.law.curvatures else { return [1.0; 2] };
        let radius = self.patch.radius_m;
        let each = self.depth_m.into_iter().flat_map(|depth| {
            curvatures.map(|k| tool_motion([k, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 3], radius - depth, radius)[0])
        });
        each.fold([1.0f64; 2], |[least, most], m| [least.min(m), most.max(m)])
    }
}

/// A cell of one interval of the depth.
struct Over<'a> {
    place: &'a Place<'a>,
    cell: Cell,
    /// Whether it is a single state.
    single: bool,
}

impl<'a> Over<'a> {
    fn new(place: &'a Place<'a>, cell: &Cell) -> Self {
        Over { place, cell: *cell, single: *cell == cell.middle() }
    }

    /// The state in its middle.
    fn middle(&self) -> Situation<f64> {
        let state = self.cell.middle();
        self.place.situation(state.corners[0], [1.0, 0.0], state.depth_m[0], state.reach_m[0])
    }

    /// All of its states.
    fn spread(&self) -> Situation<Centred> {
        let Cell { corners, depth_m, azimuth, reach_m } = self.cell;
        let n = [0, 1, 2].map(|l| Centred::at_corners(corners.map(|n| n[l])));
        let half = 0.5 * (azimuth[1] - azimuth[0]);
        let (cos, sin) = super::criteria::arc(half);
        let direction =
            [Centred::turning(1.0, cos, 3, -sin * half), Centred::turning(0.0, sin, 3, cos * half)];
        self.place.situation(n, direction, Centred::variable(depth_m, 2), Centred::variable(reach_m, 4))
    }

    fn state(&self) -> State<Interval> {
        if self.single {
            return self.place.state(&self.middle()).map(Interval::point);
        }
        self.place.state(&self.spread()).map(|x| x.value)
    }

    /// How it changes while the contact point and the tool move: see [`Place::moving`].
    fn rates<const M: usize>(&self) -> State<[Interval; M]> {
        let place = self.place;
        if self.single {
            let rates = place.state(&place.moving::<_, M>(&self.middle()));
            return rates.map(|x| x.partials.map(Interval::point));
        }
        place.state(&place.moving::<_, M>(&self.spread())).map(|x| x.partials.map(|d| d.value))
    }
}

/// The drive over a cell, as the slip search sees it.
struct Slip {
    state: State<Interval>,
    /// |d| by the tool's way, N.
    size: Interval,
    /// What the search takes for rounding of the drive, N.
    noise: f64,
    /// |d| in slip, at least, N, and as a part of the limit.
    least: f64,
    below: f64,
}

impl Slip {
    /// None where no state of the cell slips.
    fn new(place: &Place, over: &Over, cell: &Cell) -> Option<Self> {
        let slip = Slip::of(over);
        if slip.size.hi < slip.least {
            return None;
        }
        (slip.rests() || came_from_rest(place, cell, slip.state.u[2].lo)).then_some(slip)
    }

    fn of(over: &Over) -> Self {
        let mut state = over.state();
        let taken = state.reaction.iter().map(|x| x.magnitude()).sum::<f64>();
        let (mut noise, mut rounding) = (0.0, 0.0);
        if over.place.patch.slip == SlipRule::Consistent {
            (noise, rounding) = (NOISE * taken, SINGLE * taken);
        }
        let rounding = Interval::around_zero(rounding);
        state.drive = state.drive.map(|x| x + rounding);
        // M⁻¹ makes a vector no more than twice as long, and one of these has √3 of them.
        let [once, twice] = if over.place.law.curvatures.is_some() { [4.0, 8.0] } else { [1.0; 2] };
        state.by_tool = state.by_tool.map(|x| x + rounding * once);
        state.way = state.way.map(|x| x + rounding * twice);
        noise /= over.place.motion_bounds()[0];
        state.miss = state.miss.map(|x| x + rounding);
        let below = below(over.place.patch.slip);
        let least = (state.limit.lo * below - noise).max(0.0);
        Slip { size: length(state.by_tool), state, noise, least, below }
    }

    /// Whether a state of the cell can be within the limit.
    fn rests(&self) -> bool {
        self.size.lo * self.below - self.noise <= self.state.limit.hi
    }
}

/// Whether a step before a state could have been within the limit.
fn came_from_rest(place: &Place, cell: &Cell, lean: f64) -> bool {
    let Place { patch, law, view, .. } = *place;
    let Some(before) = before(patch, cell, view, lean) else { return true };
    let view = patch.view(&before);
    law.pieces(before.depth_m).any(|(interval, depth_m)| {
        let place = Place::new(patch, law, &view, (interval, depth_m));
        Slip::of(&Over::new(&place, &Cell { depth_m, ..before })).rests()
    })
}

/// |d| − L at a state, N.
pub(super) fn excess(patch: &ElementStates, law: &Coupled, state: &Cell) -> Option<f64> {
    let view = patch.view(state);
    let place = Place::new(patch, law, &view, law.pieces(state.depth_m).next()?);
    let state = place.state(&Over::new(&place, state).middle());
    Some(dot(state.by_tool, state.by_tool).sqrt() - state.limit)
}

/// As [`Criterion::bound`].
pub(super) fn bound(
    criterion: Criterion,
    patch: &ElementStates,
    law: &Coupled,
    cell: &Cell,
    view: &View,
) -> f64 {
    let mut depths = cell.depth_m;
    if criterion == Criterion::Passive {
        if patch.slip == SlipRule::Exact {
            return 0.0;
        }
        let shallowest = SHALLOWEST * patch.depth_end_m;
        if depths[1] < shallowest {
            return f64::INFINITY;
        }
        depths[0] = depths[0].max(shallowest);
    }
    let each = law.pieces(depths).map(|(interval, depth_m)| {
        let place = Place::new(patch, law, view, (interval, depth_m));
        let cell = Cell { depth_m, ..*cell };
        let over = Over::new(&place, &cell);
        let Some(slip) = Slip::new(&place, &over, &cell) else { return f64::INFINITY };
        match criterion {
            Criterion::Passive => passive(patch, &slip, place.motion_bounds()),
            // The floor is the decoupled law's.
            Criterion::Floor => f64::NEG_INFINITY,
            Criterion::SnapFree => lipschitz(criterion, patch, &slopes::<2>(&over, &slip, patch)),
            Criterion::Lipschitz | Criterion::Pace => {
                lipschitz(criterion, patch, &slopes::<5>(&over, &slip, patch))
            }
        }
    });
    each.fold(f64::INFINITY, f64::min)
}

/// The least g·t/(|d| + f_z⁺), t along P M⁻² d or up to `aside` off it. With f = |d| + f_z⁺ and the share s =
/// |d|/f that is s t·d/|d| + (1 − s) û·t, whatever the forces' size, and what else g misses.
fn passive(patch: &ElementStates, slip: &Slip, motion: [f64; 2]) -> f64 {
    let Slip { state, least, below, .. } = slip;
    let t = direction([state.way[0], state.way[1]]);
    let (sin, cos) = patch.aside.sin_cos();
    let normal = state.pushing;
    // In slip |M⁻¹ d|/f_z is at least μ, nearly, and |d| no less than that by M's least eigenvalue.
    let size = length(state.drive);
    let size = Interval::new(size.lo.max(*least * motion[0]), size.hi);
    let ratio = |d: f64, normal: f64| if d > 0.0 { d / (d + normal) } else { 0.0 };
    let held = (state.friction.lo.max(0.0) * below - slip.noise / normal.lo.max(1e-300)).max(0.0);
    let held = held * motion[0];
    let low = ratio(size.lo, normal.hi).max(held / (1.0 + held));
    let high = ratio(size.hi, normal.lo).max(low);
    let dip = t[0] * state.u[0] + t[1] * state.u[1];
    let lean = length(flat(state.u)).hi;
    let dip = (dip.lo.min(dip.lo * cos) - lean * sin).max(-lean);
    // |P d|/|d|, and what t is off P d's direction: by M⁻² and by `aside`.
    let long = (length(flat(state.drive)).lo / size.hi).max(state.u[2].lo);
    let (v, turn) = (direction([state.drive[0], state.drive[1]]), turn(motion, 1.0, state.u));
    let together = (v[0] * t[0] + v[1] * t[1]).lo.max(turn.cos());
    let beside = (v[0] * t[1] - v[1] * t[0]).magnitude().min(turn.min(FRAC_PI_2).sin());
    let cosine = if turn == 0.0 { cos } else { together * cos - beside * sin };
    let along = if cosine < 0.0 { cosine } else { long * cosine };
    let at = |share: f64| share * along + (1.0 - share) * dip;
    let missing = length([state.miss[0], state.miss[1], Interval::ZERO]).hi;
    let helps = (t[0] * state.miss[0] + t[1] * state.miss[1]).lo;
    let helps = (helps.min(helps * cos) - missing * sin).max(-missing);
    let forces = size + normal;
    let rest = if helps == 0.0 { 0.0 } else { helps / if helps < 0.0 { forces.lo } else { forces.hi } };
    at(low).min(at(high)) + rest
}

/// How far a vector at right angles to û and what M⁻ᵏ makes of it are apart at most, seen in the element, up to π: with M's eigenvalues
/// between these the tangent of half their angle is (s − 1)/(s + 1), s the quotient's power (Kantorovich's inequality), and P, which shortens
/// one direction by û_z, makes it 1/û_z of that where they lie to both sides of it.
fn turn([least, most]: [f64; 2], k: f64, u: IntervalVector) -> f64 {
    let spread = (most / least).powf(k);
    2.0 * ((spread - 1.0) / ((spread + 1.0) * u[2].lo)).atan()
}

/// What slip does to drive and force, and with `M` = 5 what the tool's motion does.
fn slopes<const M: usize>(over: &Over, slip: &Slip, patch: &ElementStates) -> super::criteria::Slope {
    let rates = over.rates::<M>();
    let of = |k: usize| {
        let at = |v: [[Interval; M]; 3]| v.map(|x| *x.get(k).unwrap_or(&Interval::ZERO));
        Rate {
            drive: at(rates.by_tool),
            force: at(rates.force),
            limit: *rates.limit.get(k).unwrap_or(&Interval::ZERO),
        }
    };
    let tool = (M == 5).then(|| [of(2), of(3), of(4)]);
    // The stiffness in stick is symmetric: no eigenvalue is beyond a row's sum.
    let row = |i: usize| tool.iter().flatten().map(|rate| rate.force[i].magnitude()).sum::<f64>();
    let stick = (0..3).map(row).fold(0.0, f64::max);
    let state: &State<Interval> = &slip.state;
    let own = patch.slip == SlipRule::Exact;
    let turn = turn(
        over.place.motion_bounds(),
        0.5,
        if own { [Interval::ZERO, Interval::ZERO, Interval::ONE] } else { state.u },
    );
    let flat = |v: IntervalVector| direction([v[0], v[1]]);
    slope(
        &[of(0), of(1)],
        tool.as_ref(),
        state.u,
        own,
        (std::iter::once([flat(state.by_tool), flat(state.way)]), turn),
        state.limit.lo <= 0.0,
        stick,
    )
}
