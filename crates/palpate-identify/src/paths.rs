//! From simulated load paths to responses: at each test point the tool was pressed in and, from some depths, dragged.
//!
//! The normal curve is the force along u^z over depth. Of the lateral response the model keeps one curve and one
//! tensor (MODEL 7): f_t = (f_r(ρ)/ρ) A δ_t with ρ² = δ_t·A δ_t, whatever the depth. The simulation knows better, since
//! tissue stiffens laterally as it is pressed: curve and tensor are a weighted mean over the depths, and what that costs
//! is reported for each point.

use crate::error::FitError;
use crate::fit::{Fit, FitReport, PointReport, SAME_DEFLECTION, knot, rising_end, tidy};
use crate::spread::{follow, place, spread_everywhere};
use crate::test_points::check_prior;
use glam::{DMat3, DQuat, DVec2, DVec3};
use palpate_body::curve::{MAX_KNOTS, between_rows};
use palpate_body::{BlendWeights, Curve, Extension, Interpolation, PointErrors, Response, Surface};

/// What was simulated at one test point, as far as it went.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointRecord {
    /// The node it sits on.
    pub node: u32,
    /// Unit vector u^z into the body, along which the tool was pressed in.
    pub inward: DVec3,
    /// Depth (m, ascending, positive) and force on the body (N).
    pub press: Vec<(f64, DVec3)>,
    /// For each of these states the sum of pressures over the contact, whatever their directions, N; empty if not known.
    pub pressed_n: Vec<f64>,
    /// How much of the surface at rest touches in each of these states, m²; empty if not known.
    pub patch_m2: Vec<f64>,
    /// Depth (m) of pressed states, and how the force on the body changes there with a small motion of the tool that sticks,
    /// N/m: symmetric, in the body's axes.
    pub stiffness: Vec<(f64, DMat3)>,
    /// Drags from pressed states.
    pub drags: Vec<DragRecord>,
    /// Why a path ended early, if one did.
    pub stopped: Option<String>,
}

/// A drag at constant depth.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DragRecord {
    /// m.
    pub depth_m: f64,
    /// Unit vector, perpendicular to the point's `inward`.
    pub direction: DVec3,
    /// Distance (m, ascending, positive) and force on the body (N).
    pub rows: Vec<(f64, DVec3)>,
}

/// How paths become responses.
#[derive(Debug, Clone, PartialEq)]
pub struct PathOptions {
    /// Friction coefficient over depth (m), linear between the rows and constant beyond them.
    pub friction: Vec<(f64, f64)>,
    /// Whether the lateral stiffness may differ with the direction.
    pub anisotropic: bool,
    /// A positive number for each node that the normal force goes with, such as the stiffness of a linear body under
    /// a patch of load. Blends are bent so that the force at 60 % of the greatest depth is that of the points around,
    /// scaled as the prior's power that fits the test points best.
    pub compliance_prior: Option<Vec<f64>>,
}

impl Default for PathOptions {
    /// No friction, anisotropic, no compliance prior.
    fn default() -> Self {
        PathOptions { friction: vec![(0.0, 0.0)], anisotropic: true, compliance_prior: None }
    }
}

/// Responses from load paths.
#[derive(Debug, Clone, PartialEq)]
pub struct PathFit {
    /// What a body is made of; test points without any pressed state are left out.
    pub fit: Fit,
    /// For each node [xx, yy, zz, xy, xz, yz] of its tensor A in the body's frame: A u = u, and the mean of its
    /// eigenvalues in the tangent plane is 1.
    pub lateral_tensors: Vec<[f64; 6]>,
    /// One for each test point.
    pub errors: Vec<PointErrors>,
}

/// Stiffest to softest direction at most: beyond that a drag has slipped off, or snapped.
const MAX_RATIO: f64 = 10.0;

/// Slope of a lateral curve where samples level off or fall, as a share of its mean slope: the model asks for a force
/// that increases.
const LEAST_SLOPE: f64 = 0.01;

/// Makes a response for each record and places it on the surface, as [`crate::fit()`] does with samples.
///
/// Knots are the depths and distances of all records. A press that ended early goes on along its end slope; a point
/// without drags has the lateral response of the points around. Every node's tensor is the mean of its test points' by
/// the blend's weights, each turned with the smallest rotation that takes the test point's u^z to the node's: the plain
/// mean, as the engine's own between nodes, which keeps trace and definiteness.
///
/// # Errors
/// Rows that don't ascend, numbers that are not finite, directions that are no unit vectors, two records on one node,
/// no record with pressed states, or none with drags, more than [`MAX_KNOTS`] knots, or a compliance prior that is
/// not one positive number for each node.
pub fn fit_paths(
    surface: &Surface,
    records: &[PointRecord],
    options: &PathOptions,
) -> Result<PathFit, FitError> {
    let mut notes = Vec::new();
    for (r, record) in records.iter().enumerate() {
        check(r, record, surface)?;
    }
    let kept: Vec<&PointRecord> = records.iter().filter(|r| !r.press.is_empty()).collect();
    let stopped: Vec<&PointRecord> = records.iter().filter(|r| r.stopped.is_some()).collect();
    if let Some((first, why)) = stopped.first().and_then(|r| Some((r.node, r.stopped.as_deref()?))) {
        notes.push(format!(
            "at {} of {} test points a path ended early, the first at node {first}: {why}",
            stopped.len(),
            records.len()
        ));
    }
    if kept.len() < records.len() {
        notes.push(format!(
            "{} of {} test points have no pressed state and are left out",
            records.len() - kept.len(),
            records.len()
        ));
    }
    if !kept.iter().any(|r| r.drags.iter().any(|d| !d.rows.is_empty())) {
        let problem = if kept.is_empty() { "none has a pressed state" } else { "none has a drag" };
        return Err(FitError::invalid(
            "test points",
            problem,
            "see why the simulation stopped, or give more points",
        ));
    }

    let depths = kept.iter().flat_map(|r| r.press.iter().map(|row| row.0));
    let bends = options.friction.iter().map(|row| row.0).filter(|_| options.friction.len() > 1);
    let depth_knots = knots(depths.chain(bends), "depths")?;
    let lateral_knots = knots(distances(&kept, options.anisotropic), "distances")?;
    let points = kept.iter().map(|record| fit_point(record, &lateral_knots, options.anisotropic));
    let points: Vec<PointFit> = points.collect::<Result<_, _>>()?;

    let nodes: Vec<u32> = kept.iter().map(|r| r.node).collect();
    let mut errors: Vec<PointErrors> = points.iter().map(|p| p.errors.clone()).collect();
    let friction = friction(&options.friction, &depth_knots)?;
    let lateral = fill(surface, &nodes, &points, &mut errors, &mut notes)?;
    let mut responses = Vec::with_capacity(points.len());
    for (point, (curve, _)) in points.iter().zip(&lateral) {
        // Rows of different points closer than what a deflection means stand on one knot.
        let snapped: Vec<f64> = point.normal.knots().iter().map(|&d| knot(&depth_knots, d)).collect();
        let own = Curve::from_ordinates(&snapped, point.normal.ordinates(), Extension::Linear)?;
        responses.push(Response {
            normal: tidy(&own.on_knots(&depth_knots)?)?,
            lateral: curve.clone(),
            friction: friction.clone(),
        });
    }
    let (mut blends, alone) = spread_everywhere(surface, &nodes)?;
    if alone > 0 {
        notes.push(format!(
            "{alone} nodes are on parts of the surface without a test point: theirs is the nearest one's response"
        ));
    }
    if let Some(compliance_prior) = &options.compliance_prior {
        check_prior(Some(compliance_prior), surface.positions().len())?;
        apply_prior(&mut blends, &responses, &nodes, compliance_prior, &mut notes);
    }
    let deviators: Vec<DMat3> = lateral.into_iter().map(|(_, deviator)| deviator).collect();
    let lateral_tensors = (blends.iter().zip(surface.inward_normals()))
        .map(|(blend, &u)| tensor(blended(blend, &deviators, &kept, u)))
        .collect();
    let report = FitReport {
        points: kept
            .iter()
            .map(|r| PointReport {
                point: r.node.to_string(),
                node: r.node,
                distance_m: 0.0,
                normal_samples: r.press.len(),
                lateral_samples: r.drags.iter().map(|d| d.rows.len()).sum(),
                friction_samples: 0,
            })
            .collect(),
        notes,
        largest_distance_m: 0.0,
    };
    let fit = Fit { blends, responses, test_point_nodes: nodes, report };
    Ok(PathFit { fit, lateral_tensors, errors })
}

/// Depth at which blends are bent to a compliance prior, as a share of the last knot: where most of a press's force is felt.
const GUIDED_DEPTH: f64 = 0.6;

/// Interpolates f/gᵖ instead of f, where g is the compliance prior: f varies many times over between a body's thin and thick parts,
/// and over far less than the distance of test points; the quotient hardly does.
fn apply_prior(
    blends: &mut [BlendWeights],
    responses: &[Response],
    nodes: &[u32],
    compliance_prior: &[f64],
    notes: &mut Vec<String>,
) {
    let end = responses[0].normal.knots().last().copied().unwrap_or_default();
    let forces: Vec<f64> = responses.iter().map(|r| r.normal.value(GUIDED_DEPTH * end)).collect();
    let own: Vec<f64> = nodes.iter().map(|&n| compliance_prior[n as usize]).collect();
    if forces.iter().any(|f| *f <= 0.0) {
        notes.push(
            "the compliance prior was not followed: some test points have no force at 60 % of the depth"
                .into(),
        );
        return;
    }
    let power = prior_power(&own, &forces);
    for (blend, &g) in blends.iter_mut().zip(compliance_prior) {
        let values = blend.test_points.map(|t| forces[t as usize]);
        let quotient: f64 = (0..3)
            .map(|j| blend.weights[j] * values[j] / libm::pow(own[blend.test_points[j] as usize], power))
            .sum();
        follow(blend, values, quotient * libm::pow(g, power));
    }
    notes.push(format!("blends follow the compliance prior: the normal force goes as its power {power:.2}"));
}

/// The power of a prior g that positive forces f go with: the slope of the line through (ln g, ln f); where g does not vary it
/// tells nothing.
pub(crate) fn prior_power(own: &[f64], forces: &[f64]) -> f64 {
    let logs: Vec<(f64, f64)> = own.iter().zip(forces).map(|(g, f)| (libm::log(*g), libm::log(*f))).collect();
    let n = logs.len() as f64;
    let (gm, fm) = logs.iter().fold((0.0, 0.0), |(a, b), l| (a + l.0 / n, b + l.1 / n));
    let (gg, gf) = logs
        .iter()
        .fold((0.0, 0.0), |(gg, gf), l| (gg + (l.0 - gm) * (l.0 - gm), gf + (l.0 - gm) * (l.1 - fm)));
    if gg > 1e-6 * n { (gf / gg).clamp(0.0, 2.0) } else { 0.0 }
}

pub(crate) fn check(r: usize, record: &PointRecord, surface: &Surface) -> Result<(), FitError> {
    let place = |of: &str| format!("record {r} (node {}){of}", record.node);
    let bad = |place: String, problem: String| {
        Err(FitError::invalid(place, problem, "this is a mistake of the simulation: report it"))
    };
    if record.node as usize >= surface.positions().len() {
        return bad(place(""), format!("there are {} nodes", surface.positions().len()));
    }
    let unit = |v: DVec3| (v.length() - 1.0).abs() < 1e-6;
    if !unit(record.inward) {
        return bad(place(""), format!("its inward vector {} has not unit length", record.inward));
    }
    for drag in &record.drags {
        if !unit(drag.direction) || drag.direction.dot(record.inward).abs() > 1e-6 {
            return bad(
                place(", drag"),
                format!("its direction {} is not a tangent unit vector", drag.direction),
            );
        }
        if !(drag.depth_m > 0.0 && drag.depth_m <= 10.0) {
            return bad(place(", drag"), format!("its depth is {} m", drag.depth_m));
        }
    }
    for rows in std::iter::once(&record.press).chain(record.drags.iter().map(|d| &d.rows)) {
        let mut last = 0.0;
        for (at, force) in rows {
            if !(*at > last + SAME_DEFLECTION && *at <= 10.0 && force.is_finite() && force.length() <= 1e12) {
                return bad(place(", rows"), format!("a row with {at} m and {force} N follows {last} m"));
            }
            last = *at;
        }
    }
    if let Some((at, k)) =
        record.stiffness.iter().find(|(at, k)| !(*at > 0.0 && *at <= 10.0 && k.is_finite()))
    {
        return bad(place(", stiffness"), format!("at {at} m it is {k} N/m"));
    }
    Ok(())
}

/// The different values, ascending from 0.
fn knots(values: impl Iterator<Item = f64>, what: &str) -> Result<Vec<f64>, FitError> {
    let mut knots: Vec<f64> = values.chain([0.0]).collect();
    knots.sort_by(f64::total_cmp);
    knots.dedup_by(|next, kept| *next - *kept < SAME_DEFLECTION);
    if knots.len() > MAX_KNOTS {
        let problem = format!("they have {} different {what}, where {MAX_KNOTS} can be used", knots.len());
        return Err(FitError::invalid("paths", problem, "simulate all points at the same ones, or fewer"));
    }
    Ok(knots)
}

/// The distances of all drags, and how far ρ commonly goes beyond them in stiff directions (√2 at most, for the mean of
/// A's eigenvalues is 1).
fn distances<'a>(records: &'a [&PointRecord], anisotropic: bool) -> impl Iterator<Item = f64> + 'a {
    let rows = records.iter().flat_map(|r| r.drags.iter().flat_map(|d| d.rows.iter().map(|row| row.0)));
    let end = rows.clone().fold(0.0, f64::max);
    rows.chain((anisotropic && end > 0.0).then_some(1.2 * end))
}

pub(crate) fn friction(rows: &[(f64, f64)], knots: &[f64]) -> Result<Curve, FitError> {
    let bad = |problem: String| {
        Err(FitError::invalid(
            "friction",
            problem,
            "give depths that ascend and coefficients that are not negative",
        ))
    };
    if rows.is_empty() {
        return bad("there is no coefficient".into());
    }
    if !rows.iter().all(|r| r.0 >= 0.0 && r.0 <= 10.0 && (0.0..=1e12).contains(&r.1))
        || !rows.windows(2).all(|r| r[1].0 - r[0].0 >= SAME_DEFLECTION)
    {
        return bad(format!("it is {rows:?}"));
    }
    let values: Vec<f64> = knots.iter().filter_map(|&k| between_rows(rows, k)).collect();
    Ok(Curve::through(knots, &values, Interpolation::Linear, Extension::Constant)?)
}

/// The response at one point, from its own paths alone.
#[derive(Debug, Clone, PartialEq)]
pub struct PointFit {
    /// On the depths of its press.
    pub normal: Curve,
    /// On the knots that were given; none without drags.
    pub lateral: Option<Curve>,
    /// The tensor [xx, yy, zz, xy, xz, yz] of the point, in the body's frame.
    pub lateral_tensor: [f64; 6],
    /// How far it is from the paths.
    pub errors: PointErrors,
    /// A − 1 in the tangent plane.
    deviator: DMat3,
}

/// Fits one point's paths; `lateral_knots` begin at 0 and ascend, m.
///
/// *Normal:* monotone (pool adjacent violators; equal weights), then PCHIP.
///
/// *Lateral:* forces are counted from the pressed state's. Along a drag in direction d from depth z, with
/// a² = d·A d, the model says f_t·d = a f_r(s a): so (s a, ΔF·d/a) are samples of f_r, joined by PCHIP for each
/// drag. The curve is their mean at the knots, made increasing; A follows from ΔF = c_z (f_r(ρ)/ρ) s A d by least
/// squares with a factor c_z for each depth, and both in turn until they agree. A drag weighs as much as the range of
/// depths it stands for, divided by the square of the largest force on the drags from its depth: least squares of the
/// error as a share of the force that is felt.
///
/// # Errors
/// A record without pressed states, or knots that can't be used.
pub fn fit_point(
    record: &PointRecord,
    lateral_knots: &[f64],
    anisotropic: bool,
) -> Result<PointFit, FitError> {
    let u = record.inward;
    let (depths, forces): (Vec<f64>, Vec<f64>) =
        record.press.iter().map(|(d, f)| (*d, f.dot(u).max(0.0))).unzip();
    if depths.is_empty() {
        let place = format!("node {}", record.node);
        return Err(FitError::invalid(place, "there is no pressed state", "leave the point out"));
    }
    let depths: Vec<f64> = std::iter::once(0.0).chain(depths).collect();
    let values: Vec<f64> = std::iter::once(0.0).chain(monotone(&forces)).collect();
    let normal = Curve::through(&depths, &values, Interpolation::Pchip, Extension::Linear)?;

    let drags = Drags::new(record);
    let isotropic = drags.fit(lateral_knots, false)?;
    let best = if anisotropic { drags.fit(lateral_knots, true)? } else { isotropic.clone() };
    let errors = drags.errors(record, &normal, &isotropic, &best);
    let [p, q] = drags.plane;
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    let [a, b] = best.deviator.to_array();
    let deviator = (outer(p, p) - outer(q, q)) * a + (outer(p, q) + outer(q, p)) * b;
    Ok(PointFit { normal, lateral: best.curve, lateral_tensor: tensor(deviator), errors, deviator })
}

/// The non-decreasing numbers nearest to `values` by least squares (pool adjacent violators, Barlow et al. 1972).
fn monotone(values: &[f64]) -> Vec<f64> {
    let mut blocks: Vec<(f64, usize)> = Vec::new();
    for &value in values {
        let mut block = (value, 1);
        while let Some(&(before, n)) = blocks.last().filter(|last| last.0 > block.0) {
            block = ((before * n as f64 + block.0 * block.1 as f64) / (n + block.1) as f64, n + block.1);
            blocks.pop();
        }
        blocks.push(block);
    }
    blocks.into_iter().flat_map(|(value, n)| std::iter::repeat_n(value, n)).collect()
}

/// A point's drags in its tangent plane.
struct Drags {
    /// Basis of the plane.
    plane: [DVec3; 2],
    /// Those with rows.
    drags: Vec<PlaneDrag>,
    /// Different depths.
    depths: usize,
}

struct PlaneDrag {
    direction: DVec2,
    /// Distance, and force less the pressed state's, N.
    rows: Vec<(f64, DVec2)>,
    /// Force of the pressed state, N.
    start: DVec2,
    weight: f64,
    /// Which of the depths.
    depth: usize,
}

/// A curve and a deviator (a, b): A = [1 + a, b; b, 1 − a].
#[derive(Clone)]
struct Lateral {
    curve: Option<Curve>,
    deviator: DVec2,
}

/// A − 1 times a vector of the plane.
fn deviate(deviator: DVec2, v: DVec2) -> DVec2 {
    DVec2::new(deviator.x * v.x + deviator.y * v.y, deviator.y * v.x - deviator.x * v.y)
}

impl Lateral {
    /// √(v·A v) and A v.
    fn apply(&self, v: DVec2) -> (f64, DVec2) {
        let av = v + deviate(self.deviator, v);
        (v.dot(av).max(0.0).sqrt(), av)
    }

    /// f_t at δ_t = v, N.
    fn force(&self, v: DVec2) -> DVec2 {
        let (rho, av) = self.apply(v);
        match &self.curve {
            Some(curve) if rho > 0.0 => av * (curve.value(rho) / rho),
            _ => DVec2::ZERO,
        }
    }
}

impl Drags {
    fn new(record: &PointRecord) -> Self {
        let (p, q) = record.inward.any_orthonormal_pair();
        let flat = |v: DVec3| DVec2::new(v.dot(p), v.dot(q));
        let mut depths: Vec<f64> =
            record.drags.iter().filter(|d| !d.rows.is_empty()).map(|d| d.depth_m).collect();
        depths.sort_by(f64::total_cmp);
        depths.dedup_by(|next, kept| *next - *kept < SAME_DEFLECTION);
        let depth_of = |d: f64| depths.partition_point(|&k| k <= d).saturating_sub(1);
        let mut drags: Vec<PlaneDrag> = Vec::new();
        let mut largest = vec![0.0f64; depths.len()];
        for drag in record.drags.iter().filter(|d| !d.rows.is_empty()) {
            let start = flat(pressed(&record.press, drag.depth_m));
            let depth = depth_of(drag.depth_m);
            largest[depth] = drag.rows.iter().map(|r| r.1.length()).fold(largest[depth], f64::max);
            drags.push(PlaneDrag {
                direction: flat(drag.direction),
                rows: drag.rows.iter().map(|&(s, f)| (s, flat(f) - start)).collect(),
                start,
                weight: 0.0,
                depth,
            });
        }
        // From halfway to the next shallower depth to halfway to the next deeper one; the deepest ends the range.
        let end = record.press.last().map_or(0.0, |row| row.0).max(depths.last().copied().unwrap_or(0.0));
        let share = |i: usize| {
            let low = if i == 0 { 0.0 } else { (depths[i - 1] + depths[i]) / 2.0 };
            let high = if i + 1 == depths.len() { end } else { (depths[i] + depths[i + 1]) / 2.0 };
            (high - low).max(SAME_DEFLECTION)
        };
        for (i, force) in largest.iter().enumerate() {
            let count = drags.iter().filter(|d| d.depth == i).count() as f64;
            let force = force.max(1e-12);
            let weight = share(i) / (count * force * force);
            drags.iter_mut().filter(|d| d.depth == i).for_each(|d| d.weight = weight);
        }
        Drags { plane: [p, q], drags, depths: depths.len() }
    }

    fn fit(&self, knots: &[f64], anisotropic: bool) -> Result<Lateral, FitError> {
        let mut lateral = Lateral { curve: None, deviator: DVec2::ZERO };
        if self.drags.is_empty() {
            return Ok(lateral);
        }
        lateral.curve = Some(self.curve(&lateral, knots)?);
        let spans = self.drags.iter().any(|d| d.direction.perp_dot(self.drags[0].direction).abs() > 0.1);
        if !anisotropic || !spans {
            return Ok(lateral);
        }
        for _ in 0..50 {
            let deviator = self.deviator(&lateral);
            let change = (deviator - lateral.deviator).length();
            lateral.deviator = deviator;
            lateral.curve = Some(self.curve(&lateral, knots)?);
            if change < 1e-9 {
                break;
            }
        }
        // Rounding is no direction: an isotropic body is one to the bit.
        if lateral.deviator.length() < 1e-6 {
            lateral.deviator = DVec2::ZERO;
        }
        Ok(lateral)
    }

    /// The mean of the drags' curves.
    fn curve(&self, lateral: &Lateral, knots: &[f64]) -> Result<Curve, FitError> {
        let mut sums = vec![0.0; knots.len() - 1];
        let mut total = 0.0;
        for drag in &self.drags {
            let (a, _) = lateral.apply(drag.direction);
            let samples = drag.rows.iter().map(|&(s, f)| (s * a, f.dot(drag.direction) / a));
            let (at, values): (Vec<f64>, Vec<f64>) = std::iter::once((0.0, 0.0)).chain(samples).unzip();
            let own = Curve::through(&at, &values, Interpolation::Pchip, Extension::Linear)?;
            sums.iter_mut().zip(&knots[1..]).for_each(|(sum, &k)| *sum += drag.weight * own.value(k));
            total += drag.weight;
        }
        let means: Vec<f64> = sums.iter().map(|s| s / total).collect();
        let rising = monotone(&means);
        let end = knots[knots.len() - 1];
        let slope = LEAST_SLOPE * rising[rising.len() - 1].max(1e-9) / end;
        let mut values = vec![0.0];
        for (i, value) in rising.into_iter().enumerate() {
            values.push(value.max(values[i] + slope * (knots[i + 1] - knots[i])));
        }
        let curve = Curve::through(knots, &values, Interpolation::Pchip, Extension::Linear)?;
        rising_end(&curve)
    }

    /// A's deviator by least squares, with the curve held.
    fn deviator(&self, lateral: &Lateral) -> DVec2 {
        // c_z: how much stiffer each depth is than the curve.
        let mut factors = vec![(0.0, 0.0); self.depths];
        let rows = || self.drags.iter().flat_map(|d| d.rows.iter().map(move |&(s, f)| (d, s, f)));
        for (drag, s, f) in rows() {
            let model = lateral.force(drag.direction * s);
            let factor = &mut factors[drag.depth];
            factor.0 += f.dot(model);
            factor.1 += model.length_squared();
        }
        let (mut right, mut left) = (DVec2::ZERO, 0.0);
        for (drag, s, f) in rows() {
            let d = drag.direction;
            let (rho, _) = lateral.apply(d * s);
            let value = lateral.curve.as_ref().map_or(0.0, |c| c.value(rho));
            let (top, bottom) = factors[drag.depth];
            let g = if bottom > 0.0 { (top / bottom).max(0.0) * value / rho * s } else { 0.0 };
            // f − g d = g (a (dx, −dy) + b (dy, dx)), two unit vectors at right angles.
            let rest = f - d * g;
            right += DVec2::new(rest.x * d.x - rest.y * d.y, rest.x * d.y + rest.y * d.x) * (drag.weight * g);
            left += drag.weight * g * g;
        }
        let most = (MAX_RATIO - 1.0) / (MAX_RATIO + 1.0);
        if left > 0.0 { (right / left).clamp_length_max(most) } else { DVec2::ZERO }
    }

    fn errors(
        &self,
        record: &PointRecord,
        normal: &Curve,
        isotropic: &Lateral,
        best: &Lateral,
    ) -> PointErrors {
        let u = record.inward;
        let all = record.press.iter().chain(record.drags.iter().flat_map(|d| &d.rows));
        let off = |depth: f64, f: DVec3| (normal.value(depth) - f.dot(u)).abs();
        let dragged = record.drags.iter().flat_map(|d| d.rows.iter().map(|r| off(d.depth_m, r.1)));
        let lateral = |model: &Lateral| {
            let rows = self.drags.iter().flat_map(|d| d.rows.iter().map(move |r| (d, r)));
            let errors = rows.map(|(d, &(s, f))| (model.force(d.direction * s) - f - d.start).length());
            errors.fold(0.0, f64::max)
        };
        PointErrors {
            largest_force_n: all.map(|r| r.1.length()).fold(0.0, f64::max),
            depth_reached_m: record.press.last().map_or(0.0, |r| r.0),
            normal_n: record.press.iter().map(|r| off(r.0, r.1)).fold(0.0, f64::max),
            normal_dragged_n: dragged.fold(0.0, f64::max),
            lateral_pressed_n: record.press.iter().map(|r| r.1.reject_from(u).length()).fold(0.0, f64::max),
            lateral_n: lateral(best),
            lateral_isotropic_n: lateral(isotropic),
        }
    }
}

/// The force at a depth of the press; linear between its rows.
fn pressed(press: &[(f64, DVec3)], depth: f64) -> DVec3 {
    let next = press.partition_point(|r| r.0 < depth - SAME_DEFLECTION).min(press.len().saturating_sub(1));
    let Some(&(d1, f1)) = press.get(next) else { return DVec3::ZERO };
    let (d0, f0) = next.checked_sub(1).map_or((0.0, DVec3::ZERO), |i| press[i]);
    if (d1 - depth).abs() < SAME_DEFLECTION { f1 } else { f0 + (f1 - f0) * ((depth - d0) / (d1 - d0)) }
}

/// Lateral curve and deviator of each point; where there were no drags those of the points around.
fn fill(
    surface: &Surface,
    nodes: &[u32],
    points: &[PointFit],
    errors: &mut [PointErrors],
    notes: &mut Vec<String>,
) -> Result<Vec<(Curve, DMat3)>, FitError> {
    let having: Vec<usize> = (0..points.len()).filter(|&i| points[i].lateral.is_some()).collect();
    if having.len() < points.len() {
        notes.push(format!(
            "{} of {} test points have no drag: their lateral response comes from the points around",
            points.len() - having.len(),
            points.len()
        ));
    }
    let known: Vec<(&Curve, &DMat3)> =
        points.iter().filter_map(|p| Some((p.lateral.as_ref()?, &p.deviator))).collect();
    let sources: Vec<u32> = having.iter().map(|&i| nodes[i]).collect();
    let blends = if having.len() < points.len() { place(surface, &sources)? } else { Vec::new() };
    let inward = |n: u32| surface.inward_normals()[n as usize];
    let filled = points.iter().enumerate().map(|(i, point)| {
        if let Some(curve) = &point.lateral {
            return Ok((curve.clone(), point.deviator));
        }
        let blend = blends[surface.vertices()[nodes[i] as usize] as usize].unwrap_or_else(|| {
            // None on its part of the surface: the nearest in space, rather than no body after a long run.
            let at = |n: u32| surface.positions()[n as usize];
            let distance = |&t: &usize| at(sources[t]).distance_squared(at(nodes[i]));
            let nearest = (0..sources.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            BlendWeights::own(nearest.unwrap_or_default() as u32)
        });
        let parts = (0..3).map(|j| (blend.weights[j], blend.test_points[j] as usize));
        let terms: Vec<(f64, &Curve)> = parts.clone().map(|(w, t)| (w, known[t].0)).collect();
        let deviator = parts.map(|(w, t)| turned(known[t].1, inward(sources[t]), inward(nodes[i])) * w);
        errors[i].lateral_n = 0.0;
        Ok((Curve::blend(&terms)?, deviator.fold(DMat3::ZERO, |sum, d| sum + d)))
    });
    filled.collect()
}

/// A tangent tensor of a place with normal `from`, carried to one with normal `to` by the smallest rotation.
fn turned(deviator: &DMat3, from: DVec3, to: DVec3) -> DMat3 {
    if *deviator == DMat3::ZERO {
        return DMat3::ZERO;
    }
    let turn = DMat3::from_quat(DQuat::from_rotation_arc(from.normalize(), to.normalize()));
    turn * *deviator * turn.transpose()
}

fn blended(blend: &BlendWeights, deviators: &[DMat3], records: &[&PointRecord], u: DVec3) -> DMat3 {
    let parts = blend.test_points.iter().zip(blend.weights).filter(|(_, w)| *w > 0.0);
    let sum = parts.map(|(&t, w)| turned(&deviators[t as usize], records[t as usize].inward, u) * w);
    let sum = sum.fold(DMat3::ZERO, |sum, d| sum + d);
    if sum == DMat3::ZERO {
        return sum;
    }
    // Rounding must not tilt it out of the plane, nor change the mean.
    let u = u.normalize();
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    let plane = DMat3::IDENTITY - outer(u, u);
    let flat = plane * sum * plane;
    flat - plane * ((flat.x_axis.x + flat.y_axis.y + flat.z_axis.z) / 2.0)
}

/// 1 + D as six numbers.
fn tensor(d: DMat3) -> [f64; 6] {
    let a = DMat3::IDENTITY + d;
    let mean = |x: f64, y: f64| (x + y) / 2.0;
    [
        a.x_axis.x,
        a.y_axis.y,
        a.z_axis.z,
        mean(a.x_axis.y, a.y_axis.x),
        mean(a.x_axis.z, a.z_axis.x),
        mean(a.y_axis.z, a.z_axis.y),
    ]
}
