//! Measures the error on held-out paths: random paths that no test point has seen, simulated in full, against the body's answer.
//!
//! A path presses the tool in along û at a random point of the surface and drags it, sticking, in a random direction.
//! The simulation's force and the engine's are compared at each state, in N and in % of the largest force of the path,
//! for the component along û and for the vector at right angles to it. `docs/validate.md` says how to read it.
//!
//! Where the error comes from shows when the body's answer is replaced, step by step, by better ones: see [`Source`].

use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::{Body, BodyParts, Curve, Extension, Interpolation, SurfacePoint};
use palpate_engine::{Ablation, ToolState, Waypoint, rollout};
use palpate_identify::{DragRecord, PointFit, PointRecord, fit_point};
use palpate_simulate::{Drag, Path as LoadPath, PointPaths, PointPlan};
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;

mod report;

pub use report::Measure;

/// What paths to try.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// How many.
    pub paths: usize,
    /// The same seed gives the same paths, whatever their number.
    pub seed: u64,
    /// The greatest depth of a path, m; it is at least a tenth of that deep.
    pub normal_max_m: f64,
    /// The greatest distance of a drag, m; it is at least a quarter of that long.
    pub lateral_max_m: f64,
    /// States of each press and of each drag.
    pub steps: u32,
    /// Depths that the test points' drags began at, m.
    pub drag_depths_m: Vec<f64>,
    /// For each node of the body, whether the tool can come there.
    pub touchable: Vec<bool>,
}

/// Where an answer comes from. Each step takes one cause of error away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The body with its tensors replaced by the identity: the lateral response is alike in all directions.
    Isotropic,
    /// The body as it is.
    Body,
    /// Responses that the path's own press and a drag in its direction from the test points' depths give: no
    /// interpolation between test points, and none between directions.
    Own,
    /// The same with the drag from the path's depth: what is left is the form (4) itself, a normal force that knows
    /// nothing of the drag, and a lateral one that is 0 before it.
    OwnDepth,
}

impl Source {
    /// All, from the worst informed to the best.
    pub const ALL: [Source; 4] = [Source::Isotropic, Source::Body, Source::Own, Source::OwnDepth];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Source::Isotropic => "the body, alike in all directions",
            Source::Body => "the body",
            Source::Own => "the place's own responses, dragged from the test points' depths",
            Source::OwnDepth => "the place's own responses, dragged from the path's depth",
        }
    }
}

/// Differences over the states of a path.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Difference {
    /// Largest, N.
    pub largest_n: f64,
    /// The same in % of the path's largest force.
    pub largest_percent: f64,
    /// Root of the mean square, in % of the path's largest force.
    pub rms_percent: f64,
}

impl Difference {
    fn new(differences: impl Iterator<Item = f64>, force: f64) -> Self {
        let (mut largest, mut squares, mut count) = (0.0f64, 0.0, 0.0f64);
        for d in differences {
            largest = largest.max(d);
            squares += d * d;
            count += 1.0;
        }
        let percent = |x: f64| if force > 0.0 { 100.0 * x / force } else { 0.0 };
        Difference {
            largest_n: largest,
            largest_percent: percent(largest),
            rms_percent: percent((squares / count.max(1.0)).sqrt()),
        }
    }
}

/// How far one source's answers are from the simulation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Comparison {
    /// Which.
    pub source: Source,
    /// Along û.
    pub normal: Difference,
    /// At right angles to û, as a vector.
    pub lateral: Difference,
}

/// One state of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compared {
    /// m.
    pub depth_m: f64,
    /// m.
    pub distance_m: f64,
    /// On the body, N.
    pub simulated_n: DVec3,
    /// On the body, N; one for each [`Source::ALL`], where there is one.
    pub answers_n: [Option<DVec3>; 4],
}

/// What came of one path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathResult {
    /// On the surface at rest, m.
    pub point_m: [f64; 3],
    /// û there.
    pub inward: [f64; 3],
    /// Unit vector of the drag.
    pub direction: [f64; 3],
    /// As planned, m.
    pub depth_m: f64,
    /// As planned, m.
    pub distance_m: f64,
    /// Largest difference of the normal force over the states, in % of the largest force.
    pub normal_error_percent: f64,
    /// Largest difference of the lateral force, a vector, over the states, in % of the largest force.
    pub lateral_error_percent: f64,
    /// Root of the mean square over the states, in % of the largest force.
    pub normal_rms_percent: f64,
    /// Root of the mean square over the states, in % of the largest force.
    pub lateral_rms_percent: f64,
    /// N.
    pub normal_error_n: f64,
    /// N.
    pub lateral_error_n: f64,
    /// Of the simulation, N.
    pub largest_force_n: f64,
    /// Where the simulation ended early, and why.
    pub stopped: Option<String>,
    /// Every source's.
    pub sources: Vec<Comparison>,
    /// State by state.
    #[serde(skip)]
    pub states: Vec<Compared>,
}

/// Over the states of all paths, in % of each path's largest force.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct StateSpread {
    /// Half of the states are no worse.
    pub median_percent: f64,
    /// No more than one state in twenty is worse.
    pub p95_percent: f64,
}

/// Over all paths.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Spread {
    /// Of the paths' largest differences.
    pub median_percent: f64,
    /// No more than one path in twenty is worse.
    pub p95_percent: f64,
    /// Of all.
    pub worst_percent: f64,
    /// Median of the paths' roots of mean squares.
    pub median_rms_percent: f64,
    /// Median of the paths' largest differences, N.
    pub median_n: f64,
    /// Of all, N.
    pub worst_n: f64,
    /// State by state, not by each path's worst one.
    pub states: StateSpread,
}

/// Over all paths, for one source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SourceSummary {
    /// Which.
    pub source: Source,
    /// Paths that have it.
    pub paths: usize,
    /// Along û.
    pub normal: Spread,
    /// At right angles to û.
    pub lateral: Spread,
}

/// What `palpate validate --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Validation {
    /// One for each path that was simulated.
    pub paths: Vec<PathResult>,
    /// The body's.
    pub summary: ErrorSummary,
    /// Every source's, from the worst informed to the best.
    pub sources: Vec<SourceSummary>,
    /// Paths without any state, which count nowhere.
    pub failed: usize,
    /// Paths that ended early, which count as far as they went.
    pub cut_short: usize,
    /// The paths' seed.
    pub seed: u64,
}

/// The body's errors over all paths.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ErrorSummary {
    /// Along û.
    pub normal: Spread,
    /// At right angles to û.
    pub lateral: Spread,
}

/// Random numbers (SplitMix64, Steele et al. 2014): each path has a stream of its own.
struct Random(u64);

impl Random {
    fn new(seed: u64, path: usize) -> Self {
        let mut first = Random(seed);
        Random(first.next() ^ (path as u64).wrapping_mul(0xD134_2543_DE82_EF95))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A path to try.
#[derive(Debug, Clone, PartialEq)]
struct Tried {
    point: DVec3,
    inward: DVec3,
    direction: DVec3,
    depth: f64,
    distance: f64,
    steps: u32,
    plan: PointPlan,
}

/// Elements that can be touched, with the sum of areas up to each.
struct Ground<'a> {
    body: &'a Body,
    elements: Vec<(u32, f64)>,
    area: f64,
    /// Nearer to a test point than this is no held-out point, m.
    apart: f64,
    test_points: Vec<DVec3>,
}

impl<'a> Ground<'a> {
    fn new(body: &'a Body, touchable: &[bool]) -> Result<Self> {
        if touchable.len() != body.nodes().len() {
            bail!(
                "{} nodes of the body, but {} that the spec gives; is it the body's spec?",
                body.nodes().len(),
                touchable.len()
            );
        }
        let mut area = 0.0;
        let open = body.elements().iter().enumerate();
        let open = open.filter(|(_, e)| e.nodes.iter().all(|&n| touchable[n as usize]));
        let elements: Vec<(u32, f64)> = open
            .map(|(e, _)| {
                let [a, b, c] = body.corners(e as u32);
                area += (b - a).cross(c - a).length() / 2.0;
                (e as u32, area)
            })
            .collect();
        if elements.is_empty() {
            bail!("no part of the surface can be touched; leave a part of it free of supports");
        }
        // Of a coupled law other nodes have potentials, too, made from those of the places that were simulated.
        let simulated = body.provenance().potential_errors.iter().map(|place| place.node);
        let mut nodes: Vec<u32> = simulated.filter(|&n| (n as usize) < body.nodes().len()).collect();
        if nodes.is_empty() {
            nodes = body.test_point_nodes().to_vec();
        }
        let test_points: Vec<DVec3> = nodes.iter().map(|&n| body.nodes()[n as usize].position).collect();
        let apart = 0.15 * (area / test_points.len() as f64).sqrt();
        Ok(Ground { body, elements, area, apart, test_points })
    }

    /// A point and û there, uniform over the area.
    fn point(&self, random: &mut Random) -> (DVec3, DVec3) {
        /// A few tries do: less than a tenth of the surface is near a test point.
        const TRIES: usize = 100;
        let mut found = (DVec3::ZERO, DVec3::Z);
        for _ in 0..TRIES {
            let share = random.unit() * self.area;
            let i = self.elements.partition_point(|e| e.1 <= share).min(self.elements.len() - 1);
            let (r, s) = (random.unit().sqrt(), random.unit());
            let at = SurfacePoint { element: self.elements[i].0, n: [1.0 - r, r * (1.0 - s), r * s] };
            let nodes = self.body.element_nodes(at.element);
            let u: DVec3 = (0..3).map(|j| nodes[j].inward * at.n[j]).sum();
            found = (self.body.point(at), u.normalize());
            if self.test_points.iter().all(|t| t.distance(found.0) >= self.apart) {
                break;
            }
        }
        found
    }
}

impl Tried {
    fn new(trial: &Trial, ground: &Ground, path: usize) -> Self {
        let mut random = Random::new(trial.seed, path);
        let depth = random.between(0.1, 1.0) * trial.normal_max_m;
        let distance = random.between(0.25, 1.0) * trial.lateral_max_m;
        let angle = random.between(0.0, TAU);
        let (point, inward) = ground.point(&mut random);
        let (p, q) = inward.any_orthonormal_pair();
        let direction = p * libm::cos(angle) + q * libm::sin(angle);
        let along = |end: f64| (1..=trial.steps).map(move |k| end * f64::from(k) / f64::from(trial.steps));
        let mut depths: Vec<f64> = along(depth).chain(trial.drag_depths_m.iter().copied()).collect();
        depths.sort_by(f64::total_cmp);
        // The path's own depth stays as it is.
        depths.dedup_by(|next, kept| {
            let same = *next - *kept < 1e-6;
            if same && *next == depth {
                *kept = depth;
            }
            same
        });
        let nearest = |d: f64| {
            let off = |i: &usize| (depths[*i] - d).abs();
            (0..depths.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
        };
        let drag = |from: f64| Drag { from: nearest(from), direction, distances: along(distance).collect() };
        let drags = std::iter::once(depth).chain(trial.drag_depths_m.iter().copied()).map(drag).collect();
        let plan = PointPlan { point, inward, depths: depths.clone(), drags };
        Tried { point, inward, direction, depth, distance, steps: trial.steps, plan }
    }

    /// Depths, distances and simulated forces of the path's own states.
    fn states(&self, paths: &PointPaths) -> Vec<(f64, f64, DVec3)> {
        // Not those that only the drags from the test points' depths are for.
        let step = self.depth / f64::from(self.steps);
        let whole = |depth: f64| (depth / step - (depth / step).round()).abs() * step < 1e-6;
        let press = paths.press.states.iter();
        let press = press.filter(|s| s.depth_m <= self.depth * (1.0 + 1e-9) && whole(s.depth_m));
        let mut states: Vec<_> = press.map(|s| (s.depth_m, 0.0, s.force_n)).collect();
        if let Some(drag) = paths.drags.first() {
            states.extend(drag.states.iter().map(|s| (self.depth, s.distance_m, s.force_n)));
        }
        states
    }

    fn stopped(&self, paths: &PointPaths) -> Option<String> {
        let own = |path: &LoadPath, what: &str| {
            path.stopped.as_ref().map(|s| format!("{what} at {:.3} mm: {}", s.at_m * 1e3, s.why))
        };
        let short = paths.press.states.last().is_none_or(|s| s.depth_m < self.depth * (1.0 - 1e-9));
        match own(&paths.press, "the press").filter(|_| short) {
            Some(stop) => Some(stop),
            None => paths.drags.first().and_then(|d| own(d, "the drag")),
        }
    }

    /// The response at this place, from its own press and the drags that `which` chooses.
    fn own(&self, paths: &PointPaths, which: std::ops::Range<usize>) -> Option<PointFit> {
        let rows = |path: &LoadPath, at: fn(&palpate_simulate::State) -> f64| {
            path.states.iter().map(|s| (at(s), s.force_n)).collect::<Vec<_>>()
        };
        let drags = paths.drags.iter().zip(&self.plan.drags).collect::<Vec<_>>();
        let drags = drags.get(which)?.iter().filter(|(path, _)| !path.states.is_empty());
        let drags: Vec<DragRecord> = drags
            .map(|(path, drag)| DragRecord {
                depth_m: self.plan.depths[drag.from],
                direction: drag.direction,
                rows: rows(path, |s| s.distance_m),
            })
            .collect();
        let press = rows(&paths.press, |s| s.depth_m);
        let record = PointRecord { inward: self.inward, press, drags, ..PointRecord::default() };
        let distances = self.plan.drags.first()?.distances.iter().copied();
        let knots: Vec<f64> = std::iter::once(0.0).chain(distances).collect();
        fit_point(&record, &knots, false).ok().filter(|fit| fit.lateral.is_some())
    }

    /// The engine's force on the body at each state, where it touches.
    fn engine(&self, body: &Body, states: &[(f64, f64, DVec3)]) -> Vec<DVec3> {
        /// Steps from one state to the next; the first of all must end inside.
        const BETWEEN: u32 = 8;
        let radius = body.tool().radius_m();
        // In a hollow the tool would begin inside, and feel nothing.
        let gap = radius.max(1e-4);
        let pose = |depth: f64, distance: f64| {
            let tip = self.point + self.inward * (depth - radius) + self.direction * distance;
            ToolState::at(tip.to_array())
        };
        let mut poses = vec![pose(-gap, 0.0)];
        let mut last = (-gap, 0.0);
        for &(depth, distance, _) in states {
            for k in 1..=BETWEEN {
                let t = f64::from(k) / f64::from(BETWEEN);
                let part = |from: f64, to: f64| if k == BETWEEN { to } else { from + (to - from) * t };
                poses.push(pose(part(last.0, depth), part(last.1, distance)));
            }
            last = (depth, distance);
        }
        let path = poses.into_iter().enumerate().map(|(k, pose)| Waypoint { time_s: k as f64 * 1e-3, pose });
        let outputs = rollout(body, path, body.slip(), Ablation::None);
        let forces = outputs.map(|o| -DVec3::from_array(o.force_n));
        forces.skip(BETWEEN as usize).step_by(BETWEEN as usize).collect()
    }
}

/// The body without friction until the contact has settled, and with more than can be overcome from then on: it sticks.
///
/// # Errors
/// The responses can't be brought onto the further knots.
pub fn sticking(body: &Body, normal_max_m: f64) -> Result<Body> {
    /// Shares of the greatest depth between which friction comes.
    const ONSET: [f64; 2] = [0.01, 0.02];
    const ENDLESS: f64 = 1e9;
    let mut parts = body.parts();
    let onset = ONSET.map(|share| share * normal_max_m);
    for response in &mut parts.responses {
        let mut knots = response.normal.knots().to_vec();
        // A knot of the curve that lies there already takes the place of ours.
        let add: Vec<f64> =
            onset.into_iter().filter(|o| knots.iter().all(|k| (k - o).abs() > 1e-7)).collect();
        knots.extend(add);
        knots.sort_by(f64::total_cmp);
        response.normal = exact(&response.normal.on_knots(&knots)?)?;
        let values: Vec<f64> =
            knots.iter().map(|&k| if k > onset[0] + 1e-7 { ENDLESS } else { 0.0 }).collect();
        response.friction = Curve::through(&knots, &values, Interpolation::Linear, Extension::Constant)?;
    }
    Ok(Body::new(parts)?)
}

/// Without the decrease below 0 that rounding may give.
fn exact(curve: &Curve) -> Result<Curve> {
    let mut ordinates = curve.ordinates().to_vec();
    for i in 0..ordinates.len() {
        for j in 0..4 {
            let before = if j > 0 {
                ordinates[i][j - 1]
            } else if i > 0 {
                ordinates[i - 1][3]
            } else {
                0.0
            };
            let rounding = 1e-9 * before.abs();
            if ordinates[i][j] < before && before - ordinates[i][j] <= rounding {
                ordinates[i][j] = before;
            }
        }
    }
    Ok(Curve::from_ordinates(curve.knots(), &ordinates, curve.extension())?)
}

/// For each node of the body whether the tool can come there: whether the nearest of the simulated surface's nodes, given
/// as (position, held), is free, and what is held farther away than `margin_m`, as for test points.
///
/// # Errors
/// As [`palpate_identify::touchable`].
pub fn touchable(
    body: &Body,
    surface: impl Iterator<Item = (DVec3, bool)>,
    margin_m: f64,
) -> Result<Vec<bool>> {
    let mut nodes: Vec<(DVec3, bool)> = surface.collect();
    nodes.sort_by(|a, b| a.0.x.total_cmp(&b.0.x));
    let is_held = |p: DVec3| {
        let mut best = (f64::INFINITY, false);
        // Outwards along x, until x alone is farther than the nearest so far.
        let mut visit = |&(q, held): &(DVec3, bool)| {
            let distance = p.distance_squared(q);
            if distance < best.0 {
                best = (distance, held);
            }
            (q.x - p.x) * (q.x - p.x) <= best.0
        };
        let (below, above) = nodes.split_at(nodes.partition_point(|n| n.0.x < p.x));
        let _ = above.iter().all(&mut visit);
        let _ = below.iter().rev().all(&mut visit);
        best.1
    };
    let held: Vec<bool> = body.nodes().iter().map(|n| is_held(n.position)).collect();
    Ok(palpate_identify::touchable(&body.parts().surface, &held, margin_m)?)
}

/// Tries paths on `body`. `simulate` gives what a point's plan comes to, or nothing when it was told to stop;
/// `progress` hears of each path that is done. Paths run beside each other on the threads of rayon's present pool, and
/// the result does not depend on their number.
///
/// # Errors
/// The trial does not fit the body, no path gave a state, or it was stopped.
pub fn validate(
    body: &Body,
    trial: &Trial,
    simulate: &(dyn Fn(&PointPlan) -> Option<PointPaths> + Sync),
    progress: &(dyn Fn() + Sync),
) -> Result<Validation> {
    if trial.paths == 0 || trial.steps == 0 {
        bail!("there is no path to try; give --paths 1 or more");
    }
    let ground = Ground::new(body, &trial.touchable)?;
    let rough = sticking(body, trial.normal_max_m)?;
    let alike = isotropic(&rough)?;
    let results: Option<Vec<Option<PathResult>>> = (0..trial.paths)
        .into_par_iter()
        .map(|path| {
            let tried = Tried::new(trial, &ground, path);
            let paths = simulate(&tried.plan)?;
            progress();
            Some(compare(&tried, &paths, &rough, alike.as_ref()))
        })
        .collect();
    let results = results.ok_or_else(|| anyhow!("stopped before all paths were simulated"))?;
    let paths: Vec<PathResult> = results.into_iter().flatten().collect();
    if paths.is_empty() {
        bail!("the simulation found no state on any path; look at the mesh and the material");
    }
    let sources: Vec<SourceSummary> = Source::ALL.into_iter().map(|s| summary(s, &paths)).collect();
    let own = sources.iter().find(|s| s.source == Source::Body);
    let summary =
        own.map_or_else(ErrorSummary::default, |s| ErrorSummary { normal: s.normal, lateral: s.lateral });
    Ok(Validation {
        failed: trial.paths - paths.len(),
        cut_short: paths.iter().filter(|p| p.stopped.is_some()).count(),
        seed: trial.seed,
        summary,
        sources,
        paths,
    })
}

/// The same body with a lateral response that is alike in all directions; none if it is so already.
fn isotropic(body: &Body) -> Result<Option<Body>> {
    let alike = || Body::new(BodyParts { lateral_tensors: None, ..body.parts() });
    Ok((!body.is_isotropic()).then(alike).transpose()?)
}

fn compare(tried: &Tried, paths: &PointPaths, body: &Body, alike: Option<&Body>) -> Option<PathResult> {
    let states = tried.states(paths);
    let force = states.iter().map(|s| s.2.length()).fold(0.0, f64::max);
    if states.is_empty() || force == 0.0 {
        return None;
    }
    let u = tried.inward;
    let of_body = tried.engine(body, &states);
    let of_alike = alike.map_or_else(|| of_body.clone(), |alike| tried.engine(alike, &states));
    let of_own = |which| {
        let fit = tried.own(paths, which)?;
        let lateral = fit.lateral.as_ref()?.clone();
        Some(move |depth: f64, distance: f64| {
            u * fit.normal.value(depth) + tried.direction * lateral.value(distance)
        })
    };
    let (own, own_depth) = (of_own(1..tried.plan.drags.len()), of_own(0..1));
    let compared: Vec<Compared> = (states.iter().enumerate())
        .map(|(i, &(depth_m, distance_m, simulated_n))| Compared {
            depth_m,
            distance_m,
            simulated_n,
            answers_n: [
                of_alike.get(i).copied(),
                of_body.get(i).copied(),
                own.as_ref().map(|f| f(depth_m, distance_m)),
                own_depth.as_ref().map(|f| f(depth_m, distance_m)),
            ],
        })
        .collect();
    let sources: Vec<Comparison> = (Source::ALL.into_iter().enumerate())
        .filter(|&(i, _)| compared.iter().all(|c| c.answers_n[i].is_some()))
        .map(|(i, source)| {
            let differences = || compared.iter().filter_map(|c| Some(c.answers_n[i]? - c.simulated_n));
            Comparison {
                source,
                normal: Difference::new(differences().map(|d| normal_part(d, u)), force),
                lateral: Difference::new(differences().map(|d| lateral_part(d, u)), force),
            }
        })
        .collect();
    let Comparison { normal, lateral, .. } = *sources.iter().find(|c| c.source == Source::Body)?;
    Some(PathResult {
        point_m: tried.point.to_array(),
        inward: u.to_array(),
        direction: tried.direction.to_array(),
        depth_m: tried.depth,
        distance_m: tried.distance,
        normal_error_percent: normal.largest_percent,
        lateral_error_percent: lateral.largest_percent,
        normal_rms_percent: normal.rms_percent,
        lateral_rms_percent: lateral.rms_percent,
        normal_error_n: normal.largest_n,
        lateral_error_n: lateral.largest_n,
        largest_force_n: force,
        stopped: tried.stopped(paths),
        sources,
        states: compared,
    })
}

fn summary(source: Source, paths: &[PathResult]) -> SourceSummary {
    let all: Vec<(&PathResult, &Comparison)> =
        paths.iter().filter_map(|p| Some((p, p.sources.iter().find(|c| c.source == source)?))).collect();
    let spread = |of: fn(&Comparison) -> &Difference, part: fn(DVec3, DVec3) -> f64| {
        let sorted = |value: fn(&Difference) -> f64| ascending(all.iter().map(|(_, c)| value(of(c))));
        let (percent, rms, newtons) =
            (sorted(|d| d.largest_percent), sorted(|d| d.rms_percent), sorted(|d| d.largest_n));
        let states = ascending(all.iter().flat_map(|(p, _)| {
            let off = p.states.iter().filter_map(|s| Some(s.answers_n[source as usize]? - s.simulated_n));
            off.map(|d| 100.0 * part(d, DVec3::from_array(p.inward)) / p.largest_force_n)
        }));
        Spread {
            median_percent: median(&percent),
            p95_percent: percentile(&percent, 0.95),
            worst_percent: percentile(&percent, 1.0),
            median_rms_percent: median(&rms),
            median_n: median(&newtons),
            worst_n: percentile(&newtons, 1.0),
            states: StateSpread { median_percent: median(&states), p95_percent: percentile(&states, 0.95) },
        }
    };
    SourceSummary {
        source,
        paths: all.len(),
        normal: spread(|c| &c.normal, normal_part),
        lateral: spread(|c| &c.lateral, lateral_part),
    }
}

/// Length along the unit vector `u`.
fn normal_part(v: DVec3, u: DVec3) -> f64 {
    v.dot(u).abs()
}

/// Length at right angles to the unit vector `u`.
fn lateral_part(v: DVec3, u: DVec3) -> f64 {
    v.reject_from(u).length()
}

fn ascending(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The middle one of ascending numbers, or the mean of the two in the middle.
pub fn median(sorted: &[f64]) -> f64 {
    match sorted.len() {
        0 => 0.0,
        n => (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0,
    }
}

/// The least of ascending numbers that this share of them does not exceed.
pub fn percentile(sorted: &[f64], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.clamp(1, sorted.len().max(1)) - 1).copied().unwrap_or(0.0)
}
