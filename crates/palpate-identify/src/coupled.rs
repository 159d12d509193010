//! From simulated sticking paths to a coupled law: one potential for each test point (LAW 2 and 5).
//!
//! A press that sticks from first touch, with the stuck tangent at each of its states, gives F, b and K. Where the tool was
//! dragged as well, drags give C and Q. At all other test points these are those of the dragged points around, turned with
//! the smallest rotation and scaled by the lateral stiffness at each depth.

use crate::between::{Prior, Simulated, Spread, round};
use crate::curvature::{Curvatures, capacity, clamped, scaled};
use crate::error::FitError;
use crate::fit::{FitReport, PointReport, SAME_DEFLECTION};
use crate::paths::{PointRecord, check, friction};
use crate::potential::{
    ContactSample, ContactStiffness, PotentialOptions, UP_TO_STIFFNESS, fit_stuck, knots, length,
};
use crate::spread::place;
use crate::test_points::check_prior;
use glam::{DMat3, DQuat, DVec3};
use palpate_body::curve::between_rows;
use palpate_body::law::QUANTITIES;
use palpate_body::{
    BlendWeights, BodyError, CoupledLaw, Curve, Extension, InterpolationErrors, Potential, PotentialErrors,
    StateErrors, Surface,
};
use rayon::prelude::*;

/// How sticking paths become a coupled law.
#[derive(Debug, Clone, PartialEq)]
pub struct CoupledOptions<'a> {
    /// Friction coefficient over depth (m), linear between the rows and constant beyond them.
    pub friction: Vec<(f64, f64)>,
    /// Up to which lateral deflection the law holds, m; that of the longest drag if none.
    pub range_m: Option<f64>,
    /// A positive number for each node that forces go with, N/m: the stiffness of the body at rest; empty if not known.
    pub stiffness: &'a [f64],
    /// For each node the compliance of the body at rest under a patch as wide as the tool, in the body's axes, m/N; empty if not
    /// known.
    pub compliance: &'a [DMat3],
    /// Radius of the spherical tool, m, or 0 of one whose reference point is its tip: friction becomes that of slip on a curved
    /// surface, μ (1 + (r − δz) κ). None leaves it as it is.
    pub tool_radius_m: Option<f64>,
    /// So many of the records were there before the others were added in rounds, as [`further_points`] chooses them.
    pub first: Option<usize>,
}

impl Default for CoupledOptions<'_> {
    fn default() -> Self {
        CoupledOptions {
            friction: vec![(0.0, 0.0)],
            range_m: None,
            stiffness: &[],
            compliance: &[],
            tool_radius_m: None,
            first: None,
        }
    }
}

/// A coupled law from sticking paths.
#[derive(Debug, Clone, PartialEq)]
pub struct CoupledFit {
    /// One potential for each test point: those of the records that were used, then those made for other nodes.
    pub law: CoupledLaw,
    /// The node that each of them sits on.
    pub test_point_nodes: Vec<u32>,
    /// One for each node.
    pub blends: Vec<BlendWeights>,
    /// One for each record that was used.
    pub errors: Vec<PotentialErrors>,
    /// What is lost between them; none where too few places were simulated to say.
    pub interpolation: Option<InterpolationErrors>,
    /// What was found on the way.
    pub report: FitReport,
}

/// What a state counts whose lateral force is more than friction holds, up to the whole normal force, and beyond that: a tool
/// gets there only where friction is greater than it was said to be, and then hardly ever.
const SELDOM: [f64; 2] = [0.5, 0.1];
/// Errors are in parts of a state's force, and of this part of the largest.
const FLOOR: f64 = 0.05;
/// How much of the terms of third and fourth order is carried over, the first of these with which lateral forces still grow.
const CARRIED: [f64; 4] = [1.0, 0.5, 0.25, 0.0];

/// A record in its own frame.
pub(crate) struct Local<'a> {
    pub record: &'a PointRecord,
    /// t₁ and t₂.
    pub tangents: [DVec3; 2],
    samples: Vec<ContactSample>,
    stiffness: Vec<ContactStiffness>,
}

impl<'a> Local<'a> {
    fn new(record: &'a PointRecord, mu: impl Fn(f64) -> f64) -> Self {
        let u = record.inward.normalize();
        let (t1, t2) = u.any_orthonormal_pair();
        let axes = [u, t1, t2];
        let sample = |depth_m: f64, lateral: DVec3, force: DVec3| {
            let force_n = axes.map(|axis| axis.dot(force));
            let [z, x, y] = force_n;
            let weight = match x.hypot(y) {
                held if held <= mu(depth_m) * z => 1.0,
                within if within <= z => SELDOM[0],
                _ => SELDOM[1],
            };
            ContactSample { depth_m, lateral_m: [t1.dot(lateral), t2.dot(lateral)], force_n, weight }
        };
        let press = record.press.iter().map(|&(depth, force)| sample(depth, DVec3::ZERO, force));
        let drags = record.drags.iter().flat_map(|drag| {
            drag.rows.iter().map(move |&(distance, force)| (drag.depth_m, drag.direction * distance, force))
        });
        let drags = drags.map(|(depth, lateral, force)| sample(depth, lateral, force));
        let samples: Vec<ContactSample> = press.chain(drags).collect();
        let pressed = &samples[..record.press.len()];
        let stiffness = record.stiffness.iter().filter_map(|(depth_m, k)| {
            let at = pressed.iter().find(|s| (s.depth_m - depth_m).abs() < SAME_DEFLECTION)?;
            // What is not symmetric has no potential: the mean of both.
            let entry = |a: DVec3, b: DVec3| 0.5 * (a.dot(*k * b) + b.dot(*k * a));
            let stiffness_n_per_m = axes.map(|a| axes.map(|b| entry(a, b)));
            let force_n = length(at.force_n);
            Some(ContactStiffness { depth_m: *depth_m, force_n, stiffness_n_per_m })
        });
        let stiffness = stiffness.collect();
        Local { record, tangents: [t1, t2], samples, stiffness }
    }

    /// Whether it was dragged.
    fn dragged(&self) -> bool {
        self.samples.len() > self.record.press.len()
    }

    /// Root mean square over the states with |f_t| ≤ f_z of a potential's error, in % of the largest force.
    pub fn off_percent(&self, potential: &Potential, range_m: f64) -> f64 {
        let (mut squares, mut count, mut largest) = (0.0, 0.0f64, 0.0f64);
        for s in &self.samples {
            largest = largest.max(length(s.force_n));
            let [z, x, y] = s.force_n;
            if x.hypot(y) <= z {
                let law = potential.at(s.depth_m, s.lateral_m, range_m);
                let off = length([law.normal - z, law.lateral[0] - x, law.lateral[1] - y]);
                squares += off * off;
                count += 1.0;
            }
        }
        if count > 0.0 { 100.0 * (squares / count).sqrt() / largest } else { 0.0 }
    }

    fn errors(&self, potential: &Potential, range_m: f64, reciprocity: f64) -> PotentialErrors {
        let largest = self.samples.iter().map(|s| length(s.force_n)).fold(0.0, f64::max);
        let off = |s: &ContactSample| {
            let law = potential.at(s.depth_m, s.lateral_m, range_m);
            let [z, x, y] = s.force_n;
            let per = 100.0 / (length(s.force_n) + FLOOR * largest);
            [(law.normal - z).abs() * per, (law.lateral[0] - x).hypot(law.lateral[1] - y) * per]
        };
        let mu = |s: &ContactSample| potential.friction.value(s.depth_m);
        let of = |most: &dyn Fn(&ContactSample) -> f64| {
            let kept = |s: &&ContactSample| s.force_n[1].hypot(s.force_n[2]) <= most(s) * s.force_n[0];
            StateErrors::new(self.samples.iter().filter(kept).map(off))
        };
        PotentialErrors {
            node: self.record.node,
            largest_force_n: largest,
            depth_reached_m: self.record.press.last().map_or(0.0, |row| row.0),
            dragged: self.dragged(),
            held: of(&mu),
            within: of(&|_| 1.0),
            all: StateErrors::new(self.samples.iter().map(off)),
            reciprocity_pressed: reciprocity_pressed(self.record),
            reciprocity_dragged: reciprocity,
        }
    }
}

/// Whether a press is a potential's history: what its force gains from state to state, less the integral of the stuck tangents'
/// column along the press (Betti), root mean square in parts of the gain. Not over the first step, where tangents grow as the
/// root of the depth. 0 with fewer than three tangents.
fn reciprocity_pressed(record: &PointRecord) -> f64 {
    let states: Vec<(f64, DVec3, DVec3)> = record
        .stiffness
        .iter()
        .filter_map(|(depth, k)| {
            let force = record.press.iter().find(|row| (row.0 - depth).abs() < SAME_DEFLECTION)?.1;
            Some((*depth, force, *k * record.inward))
        })
        .collect();
    if states.len() < 3 {
        return 0.0;
    }
    let last = states.len() - 1;
    // Of the parabola through three neighbours.
    let slope = |i: usize| {
        let [a, b, c] = [0, 1, 2].map(|j| states[i.clamp(1, last - 1) - 1 + j]);
        let z = states[i].0;
        let part = |p: f64, q: f64, r: f64| ((z - q) + (z - r)) / ((p - q) * (p - r));
        a.2 * part(a.0, b.0, c.0) + b.2 * part(b.0, a.0, c.0) + c.2 * part(c.0, a.0, b.0)
    };
    let (mut missed, mut gained) = (0.0, 0.0);
    for i in 0..last {
        let (from, to) = (states[i], states[i + 1]);
        let h = to.0 - from.0;
        // The trapezium rule with its correction.
        let told = (from.2 + to.2) * (0.5 * h) - (slope(i + 1) - slope(i)) * (h * h / 12.0);
        missed += (to.1 - from.1 - told).length_squared();
        gained += (to.1 - from.1).length_squared();
    }
    if gained > 0.0 { f64::sqrt(missed / gained) } else { 0.0 }
}

/// Makes a potential for each record and spreads them over the surface.
///
/// All potentials are on the same knots: 0, the depths of the presses, and an end beyond them. A press that ended early goes
/// on as smoothly as it can. Between the records' places potentials are interpolated in the way that predicts places best that
/// are left out one at a time.
///
/// # Errors
/// Records that [`crate::fit_paths`] would refuse, none with pressed states that say how stiff the place is laterally, or none
/// that a potential fits.
pub fn fit_coupled(
    surface: &Surface,
    records: &[PointRecord],
    options: &CoupledOptions<'_>,
) -> Result<CoupledFit, FitError> {
    let Places { locals, potentials, reciprocity, range_m, mut notes } = places(surface, records, options)?;
    let errors = locals.iter().zip(&potentials).zip(&reciprocity);
    let errors = errors.map(|((local, potential), r)| local.errors(potential, range_m, *r)).collect();
    let prior = Prior { surface, stiffness: options.stiffness, compliance: options.compliance };
    let simulated = Simulated::new(prior, &locals, &potentials, range_m);
    let (normalisation, interpolation) = simulated.judged(options.first)?;
    let Spread { mut potentials, test_point_nodes, blends } = simulated.spread(normalisation, &mut notes)?;
    if let Some(radius) = options.tool_radius_m {
        // As wide as the contact gets, at most.
        let deepest = potentials.iter().filter_map(|p| p.press.knots().last().copied()).fold(0.0, f64::max);
        let scale = radius.max(deepest);
        let curvatures = Curvatures::new(surface, scale);
        let mut alone = 0;
        for (potential, &node) in potentials.iter_mut().zip(&test_point_nodes) {
            let found = curvatures.at(node, potential.tangents);
            alone += usize::from(found.is_none());
            potential.curvature = clamped(found.unwrap_or_default(), radius);
        }
        if alone > 0 {
            notes.push(format!(
                "{alone} test points have no other node of the surface within {:.1} mm on the same side: friction does not count there how curved it is",
                scale * 1e3
            ));
        }
    }
    let points = locals.iter().map(|local| PointReport {
        point: local.record.node.to_string(),
        node: local.record.node,
        distance_m: 0.0,
        normal_samples: local.record.press.len(),
        lateral_samples: local.samples.len() - local.record.press.len(),
        friction_samples: 0,
    });
    let report = FitReport { points: points.collect(), notes, largest_distance_m: 0.0 };
    let law = CoupledLaw { range_m, potentials };
    Ok(CoupledFit { law, test_point_nodes, blends, errors, interpolation, report })
}

/// Where further test points belong: nodes to add to those of `records`, a quarter of them at a time; none once nineteen in twenty
/// of them, each left out in turn, are predicted by the others within `tolerance_percent` of their largest force, or there are
/// `most` of them.
///
/// They lie halfway between the places that err most and their neighbours.
///
/// # Errors
/// As [`fit_coupled`].
pub fn further_points(
    surface: &Surface,
    touchable: &[bool],
    records: &[PointRecord],
    options: &CoupledOptions<'_>,
    tolerance_percent: f64,
    most: usize,
) -> Result<Vec<u32>, FitError> {
    let room = round(records.len()).min(most.saturating_sub(records.len()));
    if room == 0 {
        return Ok(Vec::new());
    }
    if touchable.len() != surface.positions().len() {
        let problem = format!("{} entries for {} nodes", touchable.len(), surface.positions().len());
        return Err(FitError::invalid("what can be touched", problem, "give one for each node"));
    }
    let Places { locals, potentials, range_m, .. } = places(surface, records, options)?;
    let prior = Prior { surface, stiffness: options.stiffness, compliance: options.compliance };
    Simulated::new(prior, &locals, &potentials, range_m).further(touchable, tolerance_percent, room)
}

/// The records that have a potential.
struct Places<'a> {
    locals: Vec<Local<'a>>,
    potentials: Vec<Potential>,
    /// Of the drags.
    reciprocity: Vec<f64>,
    range_m: f64,
    notes: Vec<String>,
}

fn places<'a>(
    surface: &Surface,
    records: &'a [PointRecord],
    options: &CoupledOptions<'_>,
) -> Result<Places<'a>, FitError> {
    let nodes = surface.positions().len();
    check_prior(Some(options.stiffness).filter(|s| !s.is_empty()), nodes)?;
    if !(options.compliance.is_empty() || options.compliance.len() == nodes) {
        let problem = format!("{} tensors for {nodes} nodes", options.compliance.len());
        return Err(FitError::invalid("compliance at rest", problem, "give one for each"));
    }
    for (r, record) in records.iter().enumerate() {
        check(r, record, surface)?;
    }
    let mut notes = Vec::new();
    let kept: Vec<&PointRecord> = records.iter().filter(|r| tells_stiffness(r)).collect();
    if kept.len() < records.len() {
        notes.push(format!(
            "{} of {} test points have no pressed state, or neither a stuck tangent nor a drag, and are left out",
            records.len() - kept.len(),
            records.len()
        ));
    }
    let depths = || kept.iter().flat_map(|r| r.press.iter().map(|row| row.0));
    let deepest = depths().fold(0.0, f64::max);
    if kept.is_empty() {
        let problem = "none has a pressed state with a stuck tangent or a drag";
        return Err(FitError::invalid(
            "test points",
            problem,
            "see why the simulation stopped, or give more points",
        ));
    }
    let bends = options.friction.iter().map(|row| row.0).filter(|d| *d < deepest);
    let knots_m = knots(depths().chain(bends), deepest);
    let longest = kept.iter().flat_map(|r| r.drags.iter().flat_map(|d| d.rows.iter().map(|row| row.0)));
    let longest = longest.fold(0.0, f64::max);
    let range_m = options.range_m.unwrap_or(if longest > 0.0 { longest } else { deepest });
    let mu = friction(&options.friction, &knots_m)?;
    let locals: Vec<Local> = kept.iter().map(|r| Local::new(r, |depth| mu.value(depth))).collect();

    let fit_options =
        PotentialOptions { knots_m: Some(knots_m), range_m: Some(range_m), ..PotentialOptions::default() };
    let fits = locals.par_iter().map(|local| {
        let quantities = if local.dragged() { QUANTITIES - 1 } else { UP_TO_STIFFNESS };
        let fit = fit_stuck(&local.samples, &local.stiffness, local.tangents, &fit_options, quantities)?;
        let held = capacity(local.record, options.tool_radius_m.unwrap_or(0.0));
        let friction = scaled(&mu, |depth| between_rows(&held, depth).unwrap_or(1.0))?;
        Ok((Potential { friction, ..fit.potential }, fit.reciprocity))
    });
    let fits: Vec<Result<(Potential, f64), FitError>> = fits.collect();
    let mut failed =
        fits.iter().zip(&locals).filter_map(|(fit, local)| Some((fit.as_ref().err()?, local.record)));
    if let Some((error, record)) = failed.next() {
        let count = 1 + failed.count();
        if count == fits.len() {
            return Err(FitError::invalid(
                format!("node {}", record.node),
                error.to_string(),
                "see whether the simulation's forces are sound: press and drag less far",
            ));
        }
        notes.push(format!(
            "{count} of {} test points have forces that no potential gives and are left out, the first at node {}: {error}",
            fits.len(),
            record.node
        ));
    }
    let (locals, fits): (Vec<Local>, Vec<(Potential, f64)>) =
        locals.into_iter().zip(fits).filter_map(|(local, fit)| Some((local, fit.ok()?))).unzip();
    let (mut potentials, reciprocity): (Vec<Potential>, Vec<f64>) = fits.into_iter().unzip();
    carry(surface, &locals, &mut potentials, range_m, &mut notes)?;

    Ok(Places { locals, potentials, reciprocity, range_m, notes })
}

fn tells_stiffness(record: &PointRecord) -> bool {
    !record.press.is_empty()
        && (!record.stiffness.is_empty() || record.drags.iter().any(|d| !d.rows.is_empty()))
}

/// Gives each potential whose place was not dragged the terms of third and fourth order of those around that were.
fn carry(
    surface: &Surface,
    locals: &[Local],
    potentials: &mut [Potential],
    range_m: f64,
    notes: &mut Vec<String>,
) -> Result<(), FitError> {
    let dragged: Vec<usize> = (0..locals.len()).filter(|&i| locals[i].dragged()).collect();
    if dragged.len() == locals.len() {
        return Ok(());
    }
    if dragged.is_empty() {
        notes.push("no test point was dragged: lateral forces grow straight with the deflection".into());
        return Ok(());
    }
    let sources: Vec<u32> = dragged.iter().map(|&i| locals[i].record.node).collect();
    let placed = place(surface, &sources)?;
    let given: Vec<Potential> = dragged.iter().map(|&i| potentials[i].clone()).collect();
    let todo: Vec<usize> = (0..locals.len()).filter(|&i| !locals[i].dragged()).collect();
    let made: Vec<Result<(usize, Potential, f64), BodyError>> = todo
        .into_par_iter()
        .map(|i| {
            let (local, own) = (&locals[i], &potentials[i]);
            let blend =
                placed[surface.vertices()[local.record.node as usize] as usize].unwrap_or_else(|| {
                    let at = |n: u32| surface.positions()[n as usize];
                    let distance = |&t: &usize| at(sources[t]).distance_squared(at(local.record.node));
                    let nearest = (0..sources.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
                    BlendWeights::own(nearest.unwrap_or_default() as u32)
                });
            let parts = blend.test_points.iter().zip(blend.weights).filter(|(_, w)| *w > 0.0);
            let parts = parts.map(|(&t, w)| {
                let from = locals[dragged[t as usize]].record.inward;
                Ok((w, carried_to(&given[t as usize], from, local.record.inward, local.tangents)?))
            });
            let parts: Vec<(f64, Potential)> = parts.collect::<Result<_, BodyError>>()?;
            let (potential, share) =
                with_higher_terms(own, &parts, local.record.inward.normalize(), range_m)?;
            Ok((i, potential, share))
        })
        .collect();
    let mut less = 0;
    for made in made {
        let (i, potential, share) = made?;
        less += usize::from(share < 1.0);
        potentials[i] = potential;
    }
    notes.push(format!(
        "{} of {} test points were dragged: terms of third and fourth order are carried over to the others{}",
        dragged.len(),
        locals.len(),
        if less > 0 {
            format!(", at {less} of them in part, so that lateral forces grow")
        } else {
            String::new()
        }
    ));
    Ok(())
}

/// A potential of a place with the inward normal `from`, turned with the smallest rotation to one with `to`, in tangents there.
pub(crate) fn carried_to(
    potential: &Potential,
    from: DVec3,
    to: DVec3,
    tangents: [DVec3; 2],
) -> Result<Potential, BodyError> {
    let turn = DQuat::from_rotation_arc(from.normalize(), to.normalize());
    Potential { tangents: potential.tangents.map(|t| turn * t), ..potential.clone() }.seen_in(tangents)
}

/// `own` with the blend of `parts`' terms of third and fourth order, in parts of the lateral stiffness; and how much of them.
fn with_higher_terms(
    own: &Potential,
    parts: &[(f64, Potential)],
    inward: DVec3,
    range_m: f64,
) -> Result<(Potential, f64), BodyError> {
    let knots = own.press.knots();
    // K̄ and its slope.
    let mean = |p: &Potential, z: f64| {
        let [a, _, b] = &p.stiffness;
        (0.5 * (a.value(z) + b.value(z)), 0.5 * (a.slope(z) + b.slope(z)))
    };
    let curve = |of: &dyn Fn(&Potential) -> &Curve| {
        let at = |&z: &f64| {
            let (here, here_slope) = mean(own, z);
            let mut sum = [0.0; 2];
            for (w, part) in parts {
                let (there, there_slope) = mean(part, z);
                let ratio = here / there;
                let ratio_slope = (here_slope - ratio * there_slope) / there;
                let (value, slope) = (of(part).value(z), of(part).slope(z));
                sum[0] += w * value * ratio;
                sum[1] += w * (slope * ratio + value * ratio_slope);
            }
            sum
        };
        let all: Vec<[f64; 2]> = knots.iter().map(at).collect();
        let values: Vec<f64> = all.iter().map(|v| v[0]).collect();
        let mut slopes: Vec<f64> = all.iter().map(|v| v[1]).collect();
        // What rests at both ends stays so to the bit.
        let last = slopes.len() - 1;
        (slopes[0], slopes[last]) = (0.0, 0.0);
        Curve::hermite(knots, &values, &slopes, Extension::Constant)
    };
    let cubic = |i: usize| curve(&move |p: &Potential| &p.cubic[i]);
    let with = Potential {
        cubic: [cubic(0)?, cubic(1)?, cubic(2)?, cubic(3)?],
        quartic: curve(&|p| &p.quartic)?,
        ..own.clone()
    };
    Ok(growing(&with, inward, range_m)?.unwrap_or_else(|| (own.clone(), 0.0)))
}

/// A potential with as much of its terms of third and fourth order as lateral forces still grow with, and how much; none if they don't
/// without.
pub(crate) fn growing(
    potential: &Potential,
    inward: DVec3,
    range_m: f64,
) -> Result<Option<(Potential, f64)>, BodyError> {
    for share in CARRIED {
        let mut curves = potential.curves().map(Clone::clone);
        for curve in &mut curves[UP_TO_STIFFNESS..QUANTITIES - 1] {
            *curve = Curve::blend(&[(share, &*curve)])?;
        }
        let potential = Potential::from_curves(potential.tangents, curves);
        if potential.validate(inward, range_m).is_ok() {
            return Ok(Some((potential, share)));
        }
    }
    Ok(None)
}
