//! Potentials between test points (LAW 5): what varies most from place to place is known everywhere for little, the body's
//! compliance at rest. Potentials of places around are made those of a place with its compliance, and then blended.
//!
//! *Stiffness:* the potentials are scaled by a power of the stiffness at rest along the normal.
//!
//! *Compliance:* F and b go with a power of the stiffness at rest along the normal, K, C and Q with one of the stiffness across it,
//! and the lateral force of a press changes, in parts of the normal one, as that of the body at rest does. Powers and part are
//! those that fit the test points best.

use crate::coupled::{Local, carried_to, growing};
use crate::error::FitError;
use crate::paths::prior_power;
use crate::spread::{neighbours, place, spread_everywhere};
use glam::{DMat3, DQuat, DVec3};
use palpate_body::{BlendWeights, CountErrors, Curve, InterpolationErrors, LeftOut, Potential, Surface};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// How potentials of several places are made alike before they are blended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Normalisation {
    /// Not at all.
    None,
    /// Scaled by a power of the stiffness at rest along the normal.
    Stiffness,
    /// Scaled along three axes with the compliance at rest.
    Compliance,
    /// Scaled by the force of a press at the place itself, which would have to be simulated: what it would gain.
    DeepPress,
}

impl Normalisation {
    /// All there are.
    pub const ALL: [Normalisation; 4] =
        [Normalisation::None, Normalisation::Stiffness, Normalisation::Compliance, Normalisation::DeepPress];

    /// As reports name it.
    pub fn name(self) -> &'static str {
        match self {
            Normalisation::None => "none",
            Normalisation::Stiffness => "stiffness",
            Normalisation::Compliance => "compliance",
            Normalisation::DeepPress => "deep-press",
        }
    }
}

/// What is known at every node.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prior<'a> {
    pub surface: &'a Surface,
    /// Along the normal, N/m; empty if not known.
    pub stiffness: &'a [f64],
    /// In the body's axes, m/N; empty if not known.
    pub compliance: &'a [DMat3],
}

/// Places that were simulated, and how to get from them to others.
pub(crate) struct Simulated<'a> {
    pub prior: Prior<'a>,
    pub locals: &'a [Local<'a>],
    pub potentials: &'a [Potential],
    pub range_m: f64,
    /// Of the prior's stiffness, and between which ends of it.
    power: f64,
    ends: [f64; 2],
    powers: Option<Powers>,
}

/// How places' forces go with the body's at rest.
#[derive(Debug, Clone, Copy)]
struct Powers {
    normal: f64,
    lateral: f64,
    /// Of a change of lateral to normal force at rest, the part that comes with a change of place.
    coupling: f64,
    /// Between which ends of the stiffness at rest they hold, and up to which ratio of lateral to normal force.
    normal_ends: [f64; 2],
    lateral_ends: [f64; 2],
    most_coupling: f64,
}

/// How many times stiffer or softer at rest than any test point a place may be: what holds beyond nobody knows, and on supports
/// nothing gives way.
const MARGIN: f64 = 2.0;

/// The least and the greatest of test points' values, and so much beyond.
fn ends(values: &[f64]) -> [f64; 2] {
    let [low, high] =
        values.iter().fold([f64::INFINITY, 0.0], |[low, high], v: &f64| [low.min(*v), v.max(high)]);
    [low / MARGIN, high * MARGIN]
}

fn within(value: f64, [low, high]: [f64; 2]) -> f64 {
    value.max(low).min(high)
}

/// The stiffness at rest: along the normal and across it, N/m, and the lateral force in parts of the normal one.
struct Rest {
    normal: f64,
    lateral: f64,
    coupling: [f64; 2],
}

impl Rest {
    fn new(compliance: &DMat3, axes: [DVec3; 3]) -> Option<Self> {
        let local = DMat3::from_cols_array_2d(&axes.map(|a| axes.map(|b| a.dot(*compliance * b))));
        if local.determinant() <= 0.0 {
            return None;
        }
        let k = local.inverse();
        let rest = Rest {
            normal: k.x_axis.x,
            lateral: 0.5 * (k.y_axis.y + k.z_axis.z),
            coupling: [k.x_axis.y / k.x_axis.x, k.x_axis.z / k.x_axis.x],
        };
        (rest.normal > 0.0 && rest.lateral > 0.0).then_some(rest)
    }
}

/// A place to predict the potential of.
struct Place {
    node: usize,
    /// Inward normal and tangents.
    axes: [DVec3; 3],
    /// Force of a press of its own at [`DEEP`], if there was one.
    deep_n: Option<f64>,
}

/// Where places' forces are compared, as a share of the greatest depth.
const DEEP: f64 = 0.6;

impl<'a> Simulated<'a> {
    pub fn new(prior: Prior<'a>, locals: &'a [Local<'a>], potentials: &'a [Potential], range_m: f64) -> Self {
        let mut all =
            Simulated { prior, locals, potentials, range_m, power: 0.0, ends: [0.0; 2], powers: None };
        all.powers = all.found_powers();
        if !prior.stiffness.is_empty() {
            let own: Vec<f64> = locals.iter().map(|l| prior.stiffness[l.record.node as usize]).collect();
            let forces: Vec<f64> = (0..locals.len()).map(|i| all.deep_force(i)).collect();
            if forces.iter().all(|f| *f > 0.0) {
                (all.power, all.ends) = (prior_power(&own, &forces), ends(&own));
            }
        }
        all
    }

    fn found_powers(&self) -> Option<Powers> {
        let (mut rest, mut normal, mut lateral) = (Vec::new(), Vec::new(), Vec::new());
        let (mut both, mut square) = (0.0, 0.0);
        for (i, (local, potential)) in self.locals.iter().zip(self.potentials).enumerate() {
            let [t1, t2] = local.tangents;
            let axes = [local.record.inward.normalize(), t1, t2];
            let at = Rest::new(self.prior.compliance.get(local.record.node as usize)?, axes)?;
            let deep = DEEP * potential.press.knots().last()?;
            normal.push(self.deep_force(i));
            lateral.push(0.5 * (potential.stiffness[0].value(deep) + potential.stiffness[2].value(deep)));
            for (b, c) in potential.offset.iter().zip(at.coupling) {
                both += b.value(deep) / self.deep_force(i).max(1e-9) * c;
                square += c * c;
            }
            rest.push(at);
        }
        if normal.iter().any(|f| *f <= 0.0) {
            return None;
        }
        let of = |of: fn(&Rest) -> f64| rest.iter().map(of).collect::<Vec<f64>>();
        let (normals, laterals) = (of(|r| r.normal), of(|r| r.lateral));
        Some(Powers {
            normal: prior_power(&normals, &normal),
            lateral: prior_power(&laterals, &lateral),
            coupling: if square > 0.0 { both / square } else { 0.0 },
            normal_ends: ends(&normals),
            lateral_ends: ends(&laterals),
            most_coupling: of(|r| r.coupling[0].hypot(r.coupling[1])).into_iter().fold(0.0, f64::max),
        })
    }

    /// Made those of a place with its compliance.
    fn with_compliance(&self, at: &Place, parts: &[(usize, f64, Potential)]) -> Option<Potential> {
        let powers = self.powers?;
        let [u, ..] = at.axes;
        let rest = Rest::new(self.prior.compliance.get(at.node)?, at.axes)?;
        let [x, y] = rest.coupling;
        let less = (powers.most_coupling / x.hypot(y).max(f64::MIN_POSITIVE)).min(1.0);
        let here = Rest {
            normal: within(rest.normal, powers.normal_ends),
            lateral: within(rest.lateral, powers.lateral_ends),
            coupling: [less * x, less * y],
        };
        let knots = parts.first()?.2.press.knots();
        let mut scaled = Vec::new();
        for (t, weight, potential) in parts {
            let record = self.locals[*t].record;
            let back = DQuat::from_rotation_arc(u.normalize(), record.inward.normalize());
            let there =
                Rest::new(self.prior.compliance.get(record.node as usize)?, at.axes.map(|a| back * a))?;
            let z = libm::pow(here.normal / there.normal, powers.normal);
            let k = libm::pow(here.lateral / there.lateral, powers.lateral);
            let mut curves = potential.curves().map(Clone::clone);
            let count = curves.len() - 1;
            for (q, curve) in curves.iter_mut().enumerate().take(count) {
                // F and b, then all else but μ.
                *curve = Curve::blend(&[(if q < 3 { z } else { k }, &*curve)]).ok()?;
            }
            for (i, (h, t)) in here.coupling.into_iter().zip(there.coupling).enumerate() {
                let more = powers.coupling * (h - t);
                let values: Vec<f64> = knots.iter().map(|&d| more * curves[0].slope(d)).collect();
                let mut slopes: Vec<f64> = knots.iter().map(|&d| more * curves[0].bend(d)).collect();
                let last = slopes.len() - 1;
                (slopes[0], slopes[last]) = (0.0, 0.0);
                let more = Curve::hermite(knots, &values, &slopes, curves[1 + i].extension()).ok()?;
                curves[1 + i] = Curve::blend(&[(1.0, &curves[1 + i]), (1.0, &more)]).ok()?;
            }
            scaled.push((*t, *weight, Potential::from_curves(potential.tangents, curves)));
        }
        blended(&scaled, |_| 1.0).ok()
    }

    fn deep_force(&self, i: usize) -> f64 {
        let press = &self.potentials[i].press;
        press.slope(DEEP * press.knots().last().copied().unwrap_or_default())
    }

    /// Whether all that it needs is known.
    pub fn knows(&self, how: Normalisation) -> bool {
        match how {
            Normalisation::None | Normalisation::DeepPress => true,
            Normalisation::Stiffness => !self.prior.stiffness.is_empty() && self.power > 0.0,
            Normalisation::Compliance => self.powers.is_some(),
        }
    }

    /// The potential at a node, from a blend of the places. The plain blend where the normalisation makes none.
    pub fn at(&self, node: usize, blend: &BlendWeights, how: Normalisation) -> Result<Potential, FitError> {
        let u = self.prior.surface.inward_normals()[node];
        let (t1, t2) = u.any_orthonormal_pair();
        self.predicted(&Place { node, axes: [u, t1, t2], deep_n: None }, blend, how)
    }

    fn predicted(&self, at: &Place, blend: &BlendWeights, how: Normalisation) -> Result<Potential, FitError> {
        let [u, t1, t2] = at.axes;
        let parts = blend.test_points.iter().zip(blend.weights).filter(|(_, w)| *w > 0.0);
        let parts = parts.map(|(&t, w)| {
            let from = self.locals[t as usize].record.inward;
            Ok((t as usize, w, carried_to(&self.potentials[t as usize], from, u, [t1, t2])?))
        });
        let parts: Vec<(usize, f64, Potential)> = parts.collect::<Result<_, FitError>>()?;
        let made = match how {
            Normalisation::None => None,
            Normalisation::Stiffness => {
                let stiffness = |n: usize| self.prior.stiffness[n];
                let here = within(stiffness(at.node), self.ends);
                let scale =
                    |t: usize| libm::pow(here / stiffness(self.locals[t].record.node as usize), self.power);
                blended(&parts, scale).ok()
            }
            Normalisation::DeepPress => {
                at.deep_n.and_then(|force| blended(&parts, |t| force / self.deep_force(t).max(1e-9)).ok())
            }
            Normalisation::Compliance => self.with_compliance(at, &parts),
        };
        if let Some(potential) = made.filter(|potential| potential.validate(u, self.range_m).is_ok()) {
            return Ok(potential);
        }
        // A blend of laws that grow grows, but the check of it is a bound.
        if let Some((potential, _)) = growing(&blended(&parts, |_| 1.0)?, u, self.range_m)? {
            return Ok(potential);
        }
        let nearest = parts.iter().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))).map_or(0, |p| p.0);
        let own = &self.potentials[nearest];
        let turn = DQuat::from_rotation_arc(self.locals[nearest].record.inward.normalize(), u.normalize());
        Ok(Potential { tangents: own.tangents.map(|t| turn * t), ..own.clone() })
    }

    /// What each of `places` errs by when it is predicted from all others of the first `count`, %.
    pub fn left_out(&self, count: usize, places: &[usize], how: Normalisation) -> Result<Vec<f64>, FitError> {
        let without = |&i: &usize| {
            let others: Vec<usize> = (0..count).filter(|&j| j != i).collect();
            let placed = self.placed(&others)?;
            self.error(i, &others, &placed, how)
        };
        let all: Vec<Result<f64, FitError>> = places.par_iter().map(without).collect();
        all.into_iter().collect()
    }

    /// What each of `places` errs by when it is predicted from these others, %.
    pub fn predicted_from(
        &self,
        others: &[usize],
        places: &[usize],
        how: Normalisation,
    ) -> Result<Vec<f64>, FitError> {
        let placed = self.placed(others)?;
        let all: Vec<Result<f64, FitError>> =
            places.par_iter().map(|&i| self.error(i, others, &placed, how)).collect();
        all.into_iter().collect()
    }

    /// A blend of these places for every vertex.
    fn placed(&self, others: &[usize]) -> Result<Vec<Option<BlendWeights>>, FitError> {
        let nodes: Vec<u32> = others.iter().map(|&j| self.locals[j].record.node).collect();
        place(self.prior.surface, &nodes)
    }

    fn error(
        &self,
        i: usize,
        others: &[usize],
        placed: &[Option<BlendWeights>],
        how: Normalisation,
    ) -> Result<f64, FitError> {
        let local = &self.locals[i];
        let node = local.record.node as usize;
        // Alone on its part of the surface: nothing says what it is.
        let Some(blend) = placed[self.prior.surface.vertices()[node] as usize] else { return Ok(100.0) };
        let blend =
            BlendWeights { test_points: blend.test_points.map(|t| others[t as usize] as u32), ..blend };
        let [t1, t2] = local.tangents;
        let axes = [local.record.inward.normalize(), t1, t2];
        let at = Place { node, axes, deep_n: Some(self.deep_force(i)) };
        Ok(local.off_percent(&self.predicted(&at, &blend, how)?, self.range_m))
    }
}

/// Potentials for a whole surface.
pub(crate) struct Spread {
    pub potentials: Vec<Potential>,
    /// The node that each of them sits on.
    pub test_point_nodes: Vec<u32>,
    /// One for each node.
    pub blends: Vec<BlendWeights>,
}

/// Places that are left out to judge an interpolation, at most; evenly chosen.
const LEFT_OUT: usize = 120;
/// Fewer places tell nothing of what lies between them.
const LEAST: usize = 5;
/// How many times as many test points the next figure of a curve is for.
const MORE: f64 = 1.6;
/// Potentials of nodes' own at most: 70 MB with ten depth knots.
const OWN: usize = 20_000;

impl Simulated<'_> {
    /// The normalisation with which places that are left out err least, and what all of them err by. `first`, if any, is the
    /// number of places that the others were added to.
    pub fn judged(
        &self,
        first: Option<usize>,
    ) -> Result<(Normalisation, Option<InterpolationErrors>), FitError> {
        let count = self.locals.len();
        if count < LEAST {
            return Ok((Normalisation::None, None));
        }
        let places = evenly(count, LEFT_OUT);
        let mut best = (f64::INFINITY, Normalisation::None);
        let mut left_out = Vec::new();
        for how in Normalisation::ALL.into_iter().filter(|how| self.knows(*how)) {
            let mut errors = self.left_out(count, &places, how)?;
            let mean_percent = errors.iter().sum::<f64>() / errors.len() as f64;
            if how != Normalisation::DeepPress && mean_percent < best.0 {
                best = (mean_percent, how);
            }
            let [median_percent, p95_percent] = quantiles(&mut errors);
            let (normalisation, places) = (how.name().into(), places.len() as u32);
            left_out.push(LeftOut {
                normalisation,
                used: false,
                places,
                median_percent,
                p95_percent,
                mean_percent,
            });
        }
        left_out.iter_mut().for_each(|l| l.used = l.normalisation == best.1.name());
        let by_count = match first {
            Some(first) => self.by_round(first, best.1)?,
            None => self.by_count(best.1)?,
        };
        Ok((best.1, Some(InterpolationErrors { left_out, by_count })))
    }

    /// Errors against the number of test points, spread evenly, of places that are not among them.
    fn by_count(&self, how: Normalisation) -> Result<Vec<CountErrors>, FitError> {
        let count = self.locals.len();
        let mut by_count = Vec::new();
        let mut some = LEAST as f64;
        while some * 1.2 < count as f64 {
            let chosen = self.spread_over(some as usize);
            let rest: Vec<usize> = (0..count).filter(|i| !chosen.contains(i)).collect();
            let rest: Vec<usize> = evenly(rest.len(), LEFT_OUT).into_iter().map(|i| rest[i]).collect();
            let errors = self.predicted_from(&chosen, &rest, how)?;
            by_count.push(count_errors(chosen.len(), errors));
            some *= MORE;
        }
        Ok(by_count)
    }

    /// Errors after each round of adding places to those that were there, of each of them when it is left out.
    fn by_round(&self, first: usize, how: Normalisation) -> Result<Vec<CountErrors>, FitError> {
        let (mut by_round, mut count) = (Vec::new(), first.clamp(LEAST, self.locals.len()));
        loop {
            by_round.push(count_errors(count, self.left_out(count, &evenly(count, LEFT_OUT), how)?));
            if count == self.locals.len() {
                return Ok(by_round);
            }
            count = (count + round(count)).min(self.locals.len());
        }
    }

    /// Nodes halfway between the places that err most and their neighbours; see [`crate::further_points`].
    pub fn further(
        &self,
        touchable: &[bool],
        tolerance_percent: f64,
        room: usize,
    ) -> Result<Vec<u32>, FitError> {
        let (surface, count) = (self.prior.surface, self.locals.len());
        let (how, _) = self.judged(None)?;
        let places: Vec<usize> = (0..count).collect();
        let errors = self.left_out(count, &places, how)?;
        let [_, p95] = quantiles(&mut errors.clone());
        if p95 <= tolerance_percent {
            return Ok(Vec::new());
        }
        let mut worst = places;
        worst.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
        let nodes: Vec<u32> = self.locals.iter().map(|l| l.record.node).collect();
        let mut neighbours = neighbours(surface, &nodes)?;
        for list in &mut neighbours {
            list.sort_by(|&a, &b| errors[b as usize].total_cmp(&errors[a as usize]).then(a.cmp(&b)));
        }
        // One node for each vertex.
        let mut taken = marked(surface, &nodes);
        let position = |n: u32| surface.positions()[n as usize];
        let mut further: Vec<u32> = Vec::new();
        let mut added = true;
        while added && further.len() < room {
            added = false;
            for &i in &worst {
                if further.len() == room {
                    break;
                }
                let (own, u) = (position(nodes[i]), self.locals[i].record.inward);
                let found = neighbours[i].iter().find_map(|&j| {
                    let other = position(nodes[j as usize]);
                    let (middle, apart) = ((own + other) * 0.5, own.distance(other));
                    let near = |n: &u32| position(*n).distance_squared(middle);
                    let candidates = (0..touchable.len() as u32).filter(|&n| {
                        let p = position(n);
                        touchable[n as usize]
                            && !taken[surface.vertices()[n as usize] as usize]
                            && surface.inward_normals()[n as usize].dot(u) > 0.0
                            && p.distance(own).min(p.distance(other)) >= 0.2 * apart
                            && p.distance(middle) < 0.5 * apart
                    });
                    let nearest = candidates.min_by(|a, b| near(a).total_cmp(&near(b)).then(a.cmp(b)))?;
                    // Not beside one that was just added.
                    let free = further.iter().all(|&n| position(n).distance(position(nearest)) > 0.3 * apart);
                    free.then_some(nearest)
                });
                if let Some(n) = found {
                    taken[surface.vertices()[n as usize] as usize] = true;
                    further.push(n);
                    added = true;
                }
            }
        }
        Ok(further)
    }

    /// So many of the places, each the farthest from those before.
    fn spread_over(&self, count: usize) -> Vec<usize> {
        let at = |i: usize| self.prior.surface.positions()[self.locals[i].record.node as usize];
        let mut chosen = vec![0];
        let mut distance = vec![f64::INFINITY; self.locals.len()];
        while chosen.len() < count.min(self.locals.len()) {
            let last = at(chosen[chosen.len() - 1]);
            distance.iter_mut().enumerate().for_each(|(i, d)| *d = d.min(at(i).distance(last)));
            let farthest =
                (0..distance.len()).max_by(|&a, &b| distance[a].total_cmp(&distance[b]).then(b.cmp(&a)));
            chosen.push(farthest.unwrap_or_default());
        }
        chosen
    }

    /// Potentials for every node: with a normalisation each has its own, of a very fine surface as many as there may be.
    pub fn spread(&self, how: Normalisation, notes: &mut Vec<String>) -> Result<Spread, FitError> {
        let surface = self.prior.surface;
        let mut nodes: Vec<u32> = self.locals.iter().map(|l| l.record.node).collect();
        let (blends, alone) = spread_everywhere(surface, &nodes)?;
        if alone > 0 {
            notes.push(format!(
                "{alone} nodes are on parts of the surface without a test point: theirs is the nearest one's potential"
            ));
        }
        let mut potentials = self.potentials.to_vec();
        if how == Normalisation::None {
            return Ok(Spread { potentials, test_point_nodes: nodes, blends });
        }
        let simulated = marked(surface, &nodes);
        let others =
            (0..blends.len() as u32).filter(|&n| !simulated[surface.vertices()[n as usize] as usize]);
        let others: Vec<u32> = others.collect();
        let all = others.len() <= OWN;
        let chosen = if all { others } else { sparse(surface, &others, OWN) };
        let made: Vec<Result<Potential, FitError>> =
            chosen.par_iter().map(|&n| self.at(n as usize, &blends[n as usize], how)).collect();
        for (n, potential) in chosen.into_iter().zip(made) {
            potentials.push(potential?);
            nodes.push(n);
        }
        let blends = if all {
            let mut own = blends;
            nodes.iter().enumerate().skip(self.locals.len()).for_each(|(t, &n)| {
                own[n as usize] = BlendWeights::own(t as u32);
            });
            own
        } else {
            spread_everywhere(surface, &nodes)?.0
        };
        Ok(Spread { potentials, test_point_nodes: nodes, blends })
    }
}

/// For each vertex, whether it has one of these nodes.
fn marked(surface: &Surface, nodes: &[u32]) -> Vec<bool> {
    let mut marked = vec![false; surface.vertices().iter().map(|&v| v as usize + 1).max().unwrap_or(0)];
    nodes.iter().for_each(|&n| marked[surface.vertices()[n as usize] as usize] = true);
    marked
}

/// Of these nodes at most so many, of different vertices: the first in each cell of a lattice.
fn sparse(surface: &Surface, nodes: &[u32], most: usize) -> Vec<u32> {
    let positions = surface.positions();
    let at = |n: u32| positions[n as usize];
    let low = nodes.iter().fold(DVec3::INFINITY, |low, &n| low.min(at(n)));
    let high = nodes.iter().fold(DVec3::NEG_INFINITY, |high, &n| high.max(at(n)));
    let mut cell = (high - low).length() / (most as f64).sqrt();
    loop {
        let mut cells: BTreeMap<[i64; 3], u32> = BTreeMap::new();
        for &n in nodes {
            let key = ((at(n) - low) / cell).floor().to_array().map(|c| c as i64);
            cells.entry(key).or_insert(n);
        }
        if cells.len() <= most {
            return cells.into_values().collect();
        }
        cell *= 1.1;
    }
}

/// At most `most` of the numbers below `count`, evenly.
fn evenly(count: usize, most: usize) -> Vec<usize> {
    let some = count.min(most);
    (0..some).map(|i| i * count / some).collect()
}

/// How many places a round adds to so many.
pub(crate) fn round(count: usize) -> usize {
    (count / 4).max(1)
}

fn count_errors(test_points: usize, mut errors: Vec<f64>) -> CountErrors {
    let [median_percent, p95_percent] = quantiles(&mut errors);
    CountErrors { test_points: test_points as u32, places: errors.len() as u32, median_percent, p95_percent }
}

/// Median and 95th percentile.
fn quantiles(values: &mut [f64]) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    [0.5, 0.95].map(|part| values.get((part * last as f64).round() as usize).copied().unwrap_or(0.0))
}

/// Σ w s Wⱼ.
fn blended(parts: &[(usize, f64, Potential)], scale: impl Fn(usize) -> f64) -> Result<Potential, FitError> {
    let (first, tangents) = match parts {
        [(_, _, first), ..] => (first, first.tangents),
        [] => {
            return Err(FitError::invalid(
                "blend",
                "it has no test point",
                "this is a mistake of the program",
            ));
        }
    };
    let curves = parts.iter().map(|(t, w, p)| (w * scale(*t), p.curves())).collect::<Vec<_>>();
    let mut made = first.curves().map(Clone::clone);
    let friction = made.len() - 1;
    for (q, curve) in made.iter_mut().enumerate().take(friction) {
        let terms: Vec<(f64, &Curve)> = curves.iter().map(|(w, c)| (*w, c[q])).collect();
        *curve = Curve::blend(&terms)?;
    }
    let frictions: Vec<(f64, &Curve)> = parts.iter().map(|(_, w, p)| (*w, &p.friction)).collect();
    made[friction] = Curve::blend(&frictions)?;
    Ok(Potential::from_curves(tangents, made))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_body::Extension;

    /// Of a law whose lateral force falls on the far side, half of the terms that make it fall are left.
    #[test]
    fn a_law_keeps_as_much_of_its_higher_terms_as_grows() {
        let knots = [0.0, 2e-3, 4e-3];
        let curve = |values: [f64; 3], slopes: [f64; 3], extension| {
            Curve::hermite(&knots, &values, &slopes, extension).unwrap()
        };
        let level = |value: f64| curve([value; 3], [0.0; 3], Extension::Constant);
        let law = |stiffness: f64, cubic: f64| Potential {
            tangents: [DVec3::X, DVec3::Y],
            press: curve([0.0, 1e-4, 4e-4], [0.0, 0.1, 0.2], Extension::Quadratic),
            offset: [level(0.0), level(0.0)],
            stiffness: [level(stiffness), level(0.0), level(stiffness)],
            cubic: [level(cubic), level(0.0), level(0.0), level(0.0)],
            quartic: level(0.0),
            friction: level(0.3),
            curvature: [0.0; 3],
        };
        let kept = |law: Potential| growing(&law, DVec3::Z, 4e-3).unwrap().map(|(potential, _)| potential);
        // Along t₁ the slope is K + 6 r C: here from −44 to 244 N/m.
        let found = kept(law(100.0, 6e3)).unwrap();
        assert_eq!(found.cubic[0].value(1e-3), 3e3);
        assert_eq!(found.stiffness, law(100.0, 6e3).stiffness);
        assert_eq!(kept(law(100.0, 3e3)), Some(law(100.0, 3e3)));
        assert_eq!(kept(law(100.0, 1e6)).unwrap().cubic[0].value(1e-3), 0.0);
        assert_eq!(kept(law(-100.0, 0.0)), None);
    }
}
