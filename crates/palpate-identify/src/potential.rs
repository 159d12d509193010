//! The coupled potential of a test point from its forces: linear least squares on the gradient of W (LAW 2).
//!
//! A potential is linear in the values and slopes that its quantities have at the knots; those that
//! [`Potential`] fixes (forces vanish with the depth, and are smooth past the last knot) are left out of the unknowns.
//! Where the samples say nothing, as between the few depths that are dragged from, quantities bend as little as they can.
//! What must be positive (the press's slope, K, the growth along rays) are linear inequalities on a grid; those that
//! a solution breaks are added to the next one's equations, and [`Potential::validate`] has the last word.

use crate::error::FitError;
use glam::DVec3;
use palpate_body::law::{AtDepth, QUANTITIES, coupled_alone};
use palpate_body::{Curve, Extension, Potential};

/// The force on the body at one deflection, in a test point's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactSample {
    /// δz, m.
    pub depth_m: f64,
    /// ξ, m: the lateral deflection in the test point's tangents.
    pub lateral_m: [f64; 2],
    /// f_z, f_t1, f_t2, N.
    pub force_n: [f64; 3],
    /// How much its relative error counts; 1 is usual, 0 leaves it out.
    pub weight: f64,
}

/// How the force on the body changes with a small motion of the tool, which is pressed straight in and sticks: the stuck
/// tangent, in a test point's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactStiffness {
    /// δz, m.
    pub depth_m: f64,
    /// |f| there, N: its error counts in parts of that.
    pub force_n: f64,
    /// Of f_z, f_t1, f_t2 by δz, ξ₁, ξ₂, N/m; symmetric.
    pub stiffness_n_per_m: [[f64; 3]; 3],
}

/// How samples become a potential.
#[derive(Debug, Clone, PartialEq)]
pub struct PotentialOptions {
    /// Depth knots from 0, m, the last of them beyond the deepest sample; those of the samples' depths if none.
    pub knots_m: Option<Vec<f64>>,
    /// Up to which |ξ| the law holds, m; that of the samples if none.
    pub range_m: Option<f64>,
    /// μ, at all depths.
    pub friction: f64,
    /// How little quantities may bend over the depth, 1 being usual.
    pub smoothness: f64,
}

impl Default for PotentialOptions {
    fn default() -> Self {
        PotentialOptions { knots_m: None, range_m: None, friction: 0.0, smoothness: 1.0 }
    }
}

/// A potential and how well it gives its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct PotentialFit {
    /// The potential.
    pub potential: Potential,
    /// Up to which |ξ| it holds, m.
    pub range_m: f64,
    /// One for each sample: the potential's force less the sample's, N.
    pub residuals_n: Vec<[f64; 3]>,
    /// Whether the samples are a potential's: what it misses of the change that lateral deflection makes to f_z, which W's
    /// symmetry ties to the lateral forces (Betti), root mean square in parts of that change. 0 without lateral deflection.
    pub reciprocity: f64,
}

/// Knots beyond the deepest sample, in parts of its depth: where b, K, C and Q come to rest.
const RUN_OUT: f64 = 1.15;
/// Depth knots that are chosen, at most.
const KNOTS: usize = 16;
/// Quantities with unknowns: all but μ.
const UNKNOWN: usize = QUANTITIES - 1;
/// F, b and K alone.
pub(crate) const UP_TO_STIFFNESS: usize = 6;
/// Powers of ξ that each is multiplied with.
const DEGREES: [i32; UNKNOWN] = [0, 1, 1, 2, 2, 2, 3, 3, 3, 3, 4];
/// What ∫ q''² costs of each quantity where all samples together weigh 1, by its degree in ξ and in units of the deepest sample and the largest force.
const BENDING: [f64; 5] = [1e-10, 1e-8, 1e-6, 1e-4, 1e-4];
/// What squares of the values cost, by degree: enough for those that no sample touches.
const RIDGE: [f64; 5] = [1e-12, 1e-12, 1e-11, 1e-8, 1e-8];
/// Forces below this part of the largest count as this.
const FLOOR: f64 = 0.05;
/// Attempts at keeping what must be positive: the margin, in parts of the median stiffness, and what a broken inequality
/// weighs, where all samples together weigh 1.
const ATTEMPTS: [[f64; 2]; 4] = [[0.01, 1e2], [0.03, 1e3], [0.1, 1e4], [0.3, 1e5]];

/// Of a stuck tangent, the motion at which its error counts: half of what gives the whole force. That is what friction holds.
const HELD: f64 = 0.5;

/// Fits the potential of a test point with these tangents.
///
/// A sample's error counts in parts of its own force (plus 5 % of the largest).
///
/// # Errors
/// No sample at depth, numbers that are not finite or out of range, knots that don't suit, or samples that no potential with
/// a stiffness above 0 fits.
pub fn fit_potential(
    samples: &[ContactSample],
    tangents: [DVec3; 2],
    options: &PotentialOptions,
) -> Result<PotentialFit, FitError> {
    fit_stuck(samples, &[], tangents, options, UNKNOWN)
}

/// [`fit_potential`] with stuck tangents as well, and only the first so many quantities: all, or with [`UP_TO_STIFFNESS`] F, b
/// and K, the others 0.
pub(crate) fn fit_stuck(
    samples: &[ContactSample],
    stiffness: &[ContactStiffness],
    tangents: [DVec3; 2],
    options: &PotentialOptions,
    quantities: usize,
) -> Result<PotentialFit, FitError> {
    check(samples, !stiffness.is_empty(), options)?;
    let deepest = samples.iter().map(|s| s.depth_m).fold(0.0, f64::max);
    let largest = samples.iter().map(|s| length(s.force_n)).fold(0.0, f64::max);
    let widest = samples.iter().map(|s| s.lateral_m[0].hypot(s.lateral_m[1])).fold(0.0, f64::max);
    let range_m = options.range_m.unwrap_or(if widest > 0.0 { widest } else { deepest });
    let knots_m =
        options.knots_m.clone().unwrap_or_else(|| knots(samples.iter().map(|s| s.depth_m), deepest));
    let problem = Problem {
        knots: knots_m.iter().map(|k| k / deepest).collect(),
        unknowns: Unknowns::new(knots_m.len(), quantities),
        quantities,
        range: range_m / deepest,
    };
    let mut equations = Equations::new(problem.unknowns.count);
    let weight = |s: &ContactSample| s.weight / (length(s.force_n) / largest + FLOOR);
    let tangent = |t: &ContactStiffness| {
        let [_, [_, a, _], [_, _, b]] = t.stiffness_n_per_m;
        let motion = (HELD * t.force_n / (0.5 * (a + b)).max(1e-9)).min(range_m) / deepest;
        (motion, 1.0 / (t.force_n / largest + FLOOR))
    };
    let total: f64 = samples.iter().map(|s| weight(s) * weight(s)).sum::<f64>()
        + stiffness.iter().map(|t| tangent(t).1 * tangent(t).1).sum::<f64>();
    for s in samples.iter().filter(|s| s.weight > 0.0) {
        let rows = problem.gradient(s.depth_m / deepest, s.lateral_m.map(|x| x / deepest));
        for (row, force) in rows.iter().zip(s.force_n) {
            equations.add(row, force / largest, weight(s) * weight(s) / total);
        }
    }
    for t in stiffness {
        let (motion, weight) = tangent(t);
        for (row, stiffness) in problem.stiffness(t.depth_m / deepest).iter().zip(entries(t)) {
            let weight = weight * motion;
            equations.add(row, stiffness * deepest / largest, weight * weight / total);
        }
    }
    problem.smooth(&mut equations, options.smoothness);

    // The checks are bounds, which lie between the grid's places.
    let mut last = None;
    for [margin, weight] in ATTEMPTS {
        let solution = problem.solve(&equations, margin, weight).ok_or_else(|| {
            FitError::invalid("samples", "the equations have no solution", "give samples at more depths")
        })?;
        let potential =
            problem.potential(&solution, &knots_m, deepest, largest, tangents, options.friction)?;
        match potential.validate(tangents[0].cross(tangents[1]), range_m) {
            Ok(()) => {
                let (residuals_n, reciprocity) = residuals(&potential, samples, range_m);
                return Ok(PotentialFit { potential, range_m, residuals_n, reciprocity });
            }
            Err(error) => last = Some(error),
        }
    }
    let problem = last.map(|e| e.to_string()).unwrap_or_default();
    Err(FitError::invalid("samples", problem, "check the forces' signs and frame, and raise the smoothness"))
}

/// F'', b', K.
fn entries(t: &ContactStiffness) -> [f64; 6] {
    let [[zz, z1, z2], [_, k11, k12], [_, _, k22]] = t.stiffness_n_per_m;
    [zz, z1, z2, k11, k12, k22]
}

pub(crate) fn length([a, b, c]: [f64; 3]) -> f64 {
    (a * a + b * b + c * c).sqrt()
}

fn check(samples: &[ContactSample], stuck: bool, options: &PotentialOptions) -> Result<(), FitError> {
    for (i, s) in samples.iter().enumerate() {
        let [x, y] = s.lateral_m;
        if !(s.depth_m >= 0.0 && s.depth_m < 10.0 && x.abs() < 10.0 && y.abs() < 10.0) {
            let problem = format!("its deflection is {} m deep and ({x}, {y}) m laterally", s.depth_m);
            return Err(FitError::invalid(format!("sample {i}"), problem, "give depths of 0 or more, in m"));
        }
        if !(s.force_n.iter().all(|f| f.abs() < 1e12) && s.weight >= 0.0 && s.weight < 1e12) {
            let problem = format!("its force is {:?} N, its weight {}", s.force_n, s.weight);
            return Err(FitError::invalid(format!("sample {i}"), problem, "give finite numbers"));
        }
    }
    if !samples.iter().any(|s| s.depth_m > 1e-6 && s.weight > 0.0 && length(s.force_n) > 0.0) {
        return Err(FitError::invalid(
            "samples",
            "none has depth, force and weight",
            "give those of a press",
        ));
    }
    if !stuck && !samples.iter().any(|s| s.depth_m > 1e-6 && s.weight > 0.0 && s.lateral_m != [0.0; 2]) {
        let problem = "none is deflected laterally, so that nothing says how stiff the point is laterally";
        return Err(FitError::invalid(
            "samples",
            problem,
            "give those of a drag, or the stuck tangents' forces",
        ));
    }
    if !(options.friction >= 0.0 && options.friction <= 100.0) {
        let problem = format!("it is {}", options.friction);
        return Err(FitError::invalid("friction coefficient", problem, "give a number between 0 and 100"));
    }
    if !(options.smoothness > 0.0 && options.smoothness < 1e12) {
        let problem = format!("it is {}", options.smoothness);
        return Err(FitError::invalid("smoothness", problem, "give a number above 0"));
    }
    let push: f64 = samples.iter().map(|s| s.weight * s.force_n[0]).sum();
    if push <= 0.0 {
        let problem = "their normal forces pull the tool in";
        return Err(FitError::invalid(
            "samples",
            problem,
            "give the force on the body, along the normal into it",
        ));
    }
    if let Some(range) = options.range_m.filter(|&range| !(range > 1e-6 && range < 1.0)) {
        let problem = format!("it is {range} m");
        return Err(FitError::invalid("lateral range", problem, "give a length between 1e-6 and 1 m"));
    }
    if let Some(knots) = &options.knots_m {
        let deepest = samples.iter().map(|s| s.depth_m).fold(0.0, f64::max);
        if knots.len() < 3 || knots.last().is_none_or(|&end| end <= deepest) {
            let problem = format!("the samples reach down to {deepest} m");
            return Err(FitError::invalid("knots", problem, "give at least 3, the last beyond all samples"));
        }
    }
    Ok(())
}

/// 0, the samples' depths, or as many of them as there may be, and the end.
pub(crate) fn knots(depths: impl Iterator<Item = f64>, deepest: f64) -> Vec<f64> {
    let mut depths: Vec<f64> = depths.collect();
    depths.sort_by(f64::total_cmp);
    depths.dedup_by(|b, a| *b - *a < 0.02 * deepest);
    depths.retain(|&d| d > 0.02 * deepest && d < 0.98 * deepest);
    let keep = (KNOTS - 3).min(depths.len());
    let inner = (0..keep).map(|i| depths[(2 * i + 1) * depths.len() / (2 * keep)]);
    [0.0].into_iter().chain(inner).chain([deepest, RUN_OUT * deepest]).collect()
}

fn residuals(potential: &Potential, samples: &[ContactSample], range_m: f64) -> (Vec<[f64; 3]>, f64) {
    let (mut missed, mut changed) = (0.0, 0.0);
    let mut all = Vec::with_capacity(samples.len());
    for s in samples {
        let law = potential.at(s.depth_m, s.lateral_m, range_m);
        let [x, y] = law.lateral;
        let off = [law.normal - s.force_n[0], x - s.force_n[1], y - s.force_n[2]];
        if s.lateral_m != [0.0; 2] {
            let straight = potential.at(s.depth_m, [0.0; 2], range_m).normal;
            missed += s.weight * off[0] * off[0];
            changed += s.weight * (s.force_n[0] - straight) * (s.force_n[0] - straight);
        }
        all.push(off);
    }
    (all, if changed > 0.0 { f64::sqrt(missed / changed) } else { 0.0 })
}

/// Which number in the vector of unknowns a value or slope at a knot is; none where it is fixed at 0.
struct Unknowns {
    /// (quantities × knots × value, slope)
    at: Vec<[Option<usize>; 2]>,
    knots: usize,
    count: usize,
}

impl Unknowns {
    fn new(knots: usize, quantities: usize) -> Self {
        let mut count = 0;
        let mut next = |free: bool| {
            count += usize::from(free);
            free.then(|| count - 1)
        };
        let at = (0..quantities * knots).map(|i| {
            let (quantity, knot) = (i / knots, i % knots);
            let value = next(knot > 0 || DEGREES[quantity] > 1);
            [value, next(knot > 0 && (knot + 1 < knots || quantity == 0))]
        });
        Unknowns { at: at.collect(), knots, count }
    }
}

/// A linear form in the unknowns.
type Row = Vec<(usize, f64)>;

/// All in units of the deepest sample and the largest force.
struct Problem {
    knots: Vec<f64>,
    unknowns: Unknowns,
    /// How many of the law's quantities have unknowns.
    quantities: usize,
    range: f64,
}

impl Problem {
    /// A quantity's value, slope and second derivative, as forms, in an interval at u from 0 to 1.
    fn quantity(&self, quantity: usize, interval: usize, u: f64) -> [Row; 3] {
        let h = self.knots[interval + 1] - self.knots[interval];
        let (u2, u3) = (u * u, u * u * u);
        let basis = [
            [1.0 - 3.0 * u2 + 2.0 * u3, (6.0 * u2 - 6.0 * u) / h, (12.0 * u - 6.0) / (h * h)],
            [h * (u - 2.0 * u2 + u3), 1.0 - 4.0 * u + 3.0 * u2, (6.0 * u - 4.0) / h],
            [3.0 * u2 - 2.0 * u3, (6.0 * u - 6.0 * u2) / h, (6.0 - 12.0 * u) / (h * h)],
            [h * (u3 - u2), 3.0 * u2 - 2.0 * u, (6.0 * u - 2.0) / h],
        ];
        let first = quantity * self.unknowns.knots + interval;
        let [left, right] = [self.unknowns.at[first], self.unknowns.at[first + 1]];
        let mut forms: [Row; 3] = Default::default();
        for (unknown, basis) in left.into_iter().chain(right).zip(basis) {
            if let Some(unknown) = unknown {
                forms.iter_mut().zip(basis).for_each(|(form, b)| form.push((unknown, b)));
            }
        }
        forms
    }

    /// The interval of a depth and where in it, 0 to 1.
    fn locate(&self, depth: f64) -> (usize, f64) {
        let i = self.knots.partition_point(|&k| k <= depth).clamp(1, self.knots.len() - 1) - 1;
        (i, (depth - self.knots[i]) / (self.knots[i + 1] - self.knots[i]))
    }

    /// F'', b' and K as forms.
    fn stiffness(&self, depth: f64) -> [Row; 6] {
        let (interval, u) = self.locate(depth);
        std::array::from_fn(|q| {
            let [value, slope, bend] = self.quantity(q, interval, u);
            [bend, slope, value][DEGREES[q] as usize].clone()
        })
    }

    /// f_z and ∂W/∂ξ as forms.
    fn gradient(&self, depth: f64, xi: [f64; 2]) -> [Row; 3] {
        let (interval, u) = self.locate(depth);
        let mut rows: [Row; 3] = Default::default();
        for quantity in 0..self.quantities {
            let [value, slope, _] = self.quantity(quantity, interval, u);
            let one = |q: usize| std::array::from_fn(|i| if i == q { 1.0 } else { 0.0 });
            let law = coupled_alone(&AtDepth { value: one(quantity), slope: one(quantity) }, xi, self.range);
            rows[0].extend(slope.iter().map(|(i, x)| (*i, x * law.normal)));
            for (row, force) in rows[1..].iter_mut().zip(law.lateral) {
                row.extend(value.iter().map(|(i, x)| (*i, x * force)));
            }
        }
        rows
    }

    /// Adds what bending and size cost. The press goes on as a parabola: its third derivative costs in place of the second, and
    /// the second's jumps.
    fn smooth(&self, equations: &mut Equations, smoothness: f64) {
        let bend = |quantity: usize, interval: usize, u: f64| self.quantity(quantity, interval, u)[2].clone();
        let sum = |a: &Row, sign: f64, b: &Row| -> Row {
            a.iter().copied().chain(b.iter().map(|(i, x)| (*i, sign * x))).collect()
        };
        for quantity in 0..self.quantities {
            let cost = smoothness * BENDING[DEGREES[quantity] as usize];
            for interval in 0..self.knots.len() - 1 {
                let h = self.knots[interval + 1] - self.knots[interval];
                let [a, b] = [bend(quantity, interval, 0.0), bend(quantity, interval, 1.0)];
                if quantity > 0 {
                    // ∫ of a linear function's square: its mean's and its slope's.
                    equations.add(&sum(&a, 1.0, &b), 0.0, cost * h / 4.0);
                    equations.add(&sum(&a, -1.0, &b), 0.0, cost * h / 12.0);
                } else {
                    equations.add(&sum(&a, -1.0, &b), 0.0, cost / h);
                    if interval > 0 {
                        equations.add(&sum(&a, -1.0, &bend(quantity, interval - 1, 1.0)), 0.0, cost / h);
                    }
                }
            }
        }
        for (i, at) in self.unknowns.at.iter().enumerate() {
            let ridge = RIDGE[DEGREES[i / self.unknowns.knots] as usize];
            at.iter().flatten().for_each(|unknown| equations.add(&[(*unknown, 1.0)], 0.0, ridge));
        }
    }

    /// Forms that must not be negative: F'' at the knots, and the growth along rays on a grid.
    fn inequalities(&self) -> (Vec<Row>, Vec<Row>) {
        let (mut press, mut growth) = (Vec::new(), Vec::new());
        for interval in 0..self.knots.len() - 1 {
            press.extend([0.0, 1.0].map(|u| self.quantity(0, interval, u)[2].clone()));
            for u in [0.0, 0.25, 0.5, 0.75, 1.0] {
                let values: Vec<Row> =
                    (3..self.quantities).map(|q| self.quantity(q, interval, u)[0].clone()).collect();
                for angle in 0..24 {
                    let (c, s) = {
                        let angle = f64::from(angle) * (std::f64::consts::TAU / 24.0);
                        (libm::cos(angle), libm::sin(angle))
                    };
                    let parts: &[f64] =
                        if self.quantities > UP_TO_STIFFNESS { &[0.0, 0.25, 0.5, 0.75, 1.0] } else { &[0.0] };
                    for r in parts.iter().map(|part| part * self.range) {
                        let of = |i: usize| match i {
                            0 => c * c,
                            1 => 2.0 * c * s,
                            2 => s * s,
                            3 => 6.0 * r * c * c * c,
                            4 => 6.0 * r * c * c * s,
                            5 => 6.0 * r * c * s * s,
                            6 => 6.0 * r * s * s * s,
                            _ => 12.0 * r * r,
                        };
                        let row = values.iter().enumerate();
                        growth.push(
                            row.flat_map(|(q, row)| row.iter().map(move |(i, x)| (*i, x * of(q)))).collect(),
                        );
                    }
                }
            }
        }
        (press, growth)
    }

    /// The least squares' solution that keeps the inequalities, with margins in parts of the median stiffness: Newton's
    /// method on the squares of what is missing to them.
    fn solve(&self, equations: &Equations, margin: f64, weight: f64) -> Option<Vec<f64>> {
        let (press, growth) = self.inequalities();
        let mut x = equations.clone().solve()?;
        let median = |rows: &[Row]| {
            let mut sizes: Vec<f64> = rows.iter().map(|row| dot(row, &x).abs()).collect();
            sizes.sort_by(f64::total_cmp);
            sizes[sizes.len() / 2]
        };
        let least = [margin * median(&press), margin * median(&growth)];
        // Each in parts of its own length.
        let rows: Vec<(Row, f64)> = [press.iter(), growth.iter()]
            .into_iter()
            .zip(least)
            .flat_map(|(rows, least)| {
                rows.map(move |row| {
                    let length = row.iter().map(|(_, x)| x * x).sum::<f64>().sqrt();
                    (row.iter().map(|(i, x)| (*i, x / length)).collect(), least / length)
                })
            })
            .collect();
        let broken =
            |x: &[f64]| -> Vec<bool> { rows.iter().map(|(row, least)| dot(row, x) < *least).collect() };
        let cost = |x: &[f64]| {
            let missing = rows.iter().map(|(row, least)| (least - dot(row, x)).max(0.0));
            equations.cost(x) + weight * missing.map(|m| m * m).sum::<f64>()
        };
        let mut active = broken(&x);
        for _ in 0..100 {
            let mut enforced = equations.clone();
            for ((row, least), _) in rows.iter().zip(&active).filter(|(_, active)| **active) {
                enforced.add(row, *least, weight);
            }
            let target = enforced.solve()?;
            // The cost is convex: some part of the way goes down.
            let (mut part, before) = (1.0, cost(&x));
            let along =
                |part: f64| -> Vec<f64> { x.iter().zip(&target).map(|(x, t)| x + part * (t - x)).collect() };
            while part > 1e-6 && cost(&along(part)) > before {
                part *= 0.5;
            }
            x = along(part);
            let now = broken(&x);
            if now == active || part <= 1e-6 {
                break;
            }
            active = now;
        }
        Some(x)
    }

    fn potential(
        &self,
        solution: &[f64],
        knots_m: &[f64],
        deepest: f64,
        largest: f64,
        tangents: [DVec3; 2],
        friction: f64,
    ) -> Result<Potential, FitError> {
        let curve = |quantity: usize| {
            let unit = largest * deepest.powi(1 - DEGREES[quantity]);
            let of = |k: usize, which: usize| {
                let at = self.unknowns.at.get(quantity * knots_m.len() + k);
                at.and_then(|at| at[which]).map_or(0.0, |i| solution[i])
            };
            let values: Vec<f64> = (0..knots_m.len()).map(|k| of(k, 0) * unit).collect();
            let slopes: Vec<f64> = (0..knots_m.len()).map(|k| of(k, 1) * unit / deepest).collect();
            let extension = if quantity == 0 { Extension::Quadratic } else { Extension::Constant };
            Curve::hermite(knots_m, &values, &slopes, extension)
        };
        let mu = vec![friction; knots_m.len()];
        let flat = vec![0.0; knots_m.len()];
        Ok(Potential {
            tangents,
            press: curve(0)?,
            offset: [curve(1)?, curve(2)?],
            stiffness: [curve(3)?, curve(4)?, curve(5)?],
            cubic: [curve(6)?, curve(7)?, curve(8)?, curve(9)?],
            quartic: curve(10)?,
            friction: Curve::hermite(knots_m, &mu, &flat, Extension::Constant)?,
            curvature: [0.0; 3],
        })
    }
}

fn dot(row: &[(usize, f64)], x: &[f64]) -> f64 {
    row.iter().map(|(i, a)| a * x[*i]).sum()
}

/// Weighted linear equations, as their normal equations.
#[derive(Clone)]
struct Equations {
    count: usize,
    /// The lower triangle, row by row.
    matrix: Vec<f64>,
    right: Vec<f64>,
}

impl Equations {
    fn new(count: usize) -> Self {
        Equations { count, matrix: vec![0.0; count * count], right: vec![0.0; count] }
    }

    /// Adds weight (row · x − right)².
    fn add(&mut self, row: &[(usize, f64)], right: f64, weight: f64) {
        for &(i, a) in row {
            self.right[i] += weight * a * right;
            for &(j, b) in row {
                if j <= i {
                    self.matrix[i * self.count + j] += weight * a * b;
                }
            }
        }
    }

    /// Σ weight (row · x − right)², but for a constant.
    fn cost(&self, x: &[f64]) -> f64 {
        let row = |i: usize| {
            let [before, own] =
                [&self.matrix[i * self.count..][..i], &self.matrix[i * self.count + i..][..1]];
            let sum: f64 = before.iter().zip(x).map(|(a, x)| a * x).sum();
            x[i] * (own[0] * x[i] + 2.0 * sum - 2.0 * self.right[i])
        };
        (0..self.count).map(row).sum()
    }

    /// By Cholesky's factors; none if the matrix is not positive definite.
    fn solve(mut self) -> Option<Vec<f64>> {
        let n = self.count;
        for i in 0..n {
            for j in 0..=i {
                let (above, row) = self.matrix.split_at_mut(i * n);
                let other = if j < i { &above[j * n..j * n + j] } else { &[] };
                if j < i {
                    let sum: f64 = other.iter().zip(&row[..j]).map(|(a, b)| a * b).sum();
                    row[j] = (row[j] - sum) / above[j * n + j];
                } else {
                    let square = row[i] - row[..i].iter().map(|a| a * a).sum::<f64>();
                    if square.is_nan() || square <= 0.0 {
                        return None;
                    }
                    row[i] = square.sqrt();
                }
            }
        }
        let mut x = self.right;
        for i in 0..n {
            let sum: f64 = self.matrix[i * n..i * n + i].iter().zip(&x).map(|(a, x)| a * x).sum();
            x[i] = (x[i] - sum) / self.matrix[i * n + i];
        }
        for i in (0..n).rev() {
            x[i] /= self.matrix[i * n + i];
            let (before, [xi, ..]) = x.split_at_mut(i) else { continue };
            before.iter_mut().zip(&self.matrix[i * n..]).for_each(|(x, a)| *x -= a * *xi);
        }
        Some(x)
    }
}
