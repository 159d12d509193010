//! Responses of test points, laid out for the step: one look-up for each knot row, one blend, one evaluation.

use crate::curve::{Curve, Extension, Piece, check_knots};
use crate::error::{BodyError, Result};

/// What a test point answers: MODEL 1's three functions of deflection.
///
/// How the lateral response depends on the direction is a node's [`Tensor`](crate::Tensor). Room is left for responses
/// that depend on the tool's orientation and for torque curves: each would be a further field here and a further row
/// kind in [`Responses`].
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// f^z(δz), N: zero at zero, never decreasing.
    pub normal: Curve,
    /// f^r(δr), N: zero at zero, increasing.
    pub lateral: Curve,
    /// μ(δz) ≥ 0.
    pub friction: Curve,
}

/// Shared knots, and the interval of a deflection in O(1).
#[derive(Debug, Clone, PartialEq)]
pub struct Knots {
    knots: Vec<f64>,
    /// One from each knot on.
    intervals: Vec<Interval>,
    /// First interval of each of the equal bins that divide the knots' range.
    bins: Vec<u16>,
    bins_per_m: f64,
}

impl Knots {
    /// # Errors
    /// Knots that are not ascending from 0, or too many of them.
    pub fn new(knots: &[f64]) -> Result<Self> {
        check_knots(knots)?;
        let end = knots[knots.len() - 1];
        let narrowest = knots.windows(2).map(|k| k[1] - k[0]).fold(f64::INFINITY, f64::min);
        // With bins no wider than the narrowest interval a look-up passes at most one knot; the cap keeps the table
        // small, and then the pass is longer, never wrong.
        let count = (end / narrowest).ceil().clamp(1.0, 4096.0) as usize;
        let interval = |x: f64| knots.iter().skip(1).take_while(|&&k| x >= k).count();
        let bins =
            (0..=count).map(|b| interval(end * b as f64 / count as f64 * (1.0 - 1e-12)) as u16).collect();
        let intervals = knots.iter().enumerate().map(|(index, &knot)| Interval {
            index,
            knot,
            low: if index == 0 { f64::NEG_INFINITY } else { knot },
            high: knots.get(index + 1).copied().unwrap_or(f64::INFINITY),
        });
        let intervals = intervals.collect();
        Ok(Knots { knots: knots.to_vec(), intervals, bins, bins_per_m: count as f64 / end })
    }

    /// The knots, m.
    pub fn values(&self) -> &[f64] {
        &self.knots
    }

    /// The interval that holds `x`: the last is the extension, and the first holds what lies below zero.
    ///
    /// # Real-time
    /// O(1), never panics; not a number counts as 0.
    #[inline]
    pub fn interval(&self, x: f64) -> Interval {
        let bin = ((x * self.bins_per_m) as u32 as usize).min(self.bins.len().saturating_sub(1));
        let first = self.bins.get(bin).copied().unwrap_or(0) as usize;
        let mut found = Interval::none();
        for interval in self.intervals.get(first..).unwrap_or(&[]) {
            found = *interval;
            let beyond = x >= found.high;
            if !beyond {
                break;
            }
        }
        found
    }

    /// An interval by its number; for one that does not exist, one that holds nowhere.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn interval_at(&self, index: u32) -> Interval {
        self.intervals.get(index as usize).copied().unwrap_or(Interval::none())
    }
}

/// One of the knots' intervals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Which.
    pub index: usize,
    /// Its knot, m: where distances are counted from.
    pub knot: f64,
    /// From where to where it holds, m.
    low: f64,
    high: f64,
}

impl Interval {
    /// One that holds nowhere.
    #[inline(always)]
    pub fn none() -> Self {
        Interval { index: 0, knot: 0.0, low: f64::INFINITY, high: f64::INFINITY }
    }

    /// Whether a deflection lies in it.
    #[inline]
    pub fn holds(&self, x: f64) -> bool {
        self.low <= x && x < self.high
    }

    /// Distance of a deflection from the knot; none below zero.
    #[inline]
    pub fn distance(&self, x: f64) -> f64 {
        (x - self.knot).max(0.0)
    }
}

/// One interval of the curves of three test points: what (5) blends while the deflection stays in it.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a, const N: usize> {
    /// Which of the knots' intervals.
    pub(crate) interval: Interval,
    rows: [&'a [f64; N]; 3],
}

impl<const N: usize> Rows<'_, N> {
    /// Rows that hold nowhere: to be looked up before the first blend.
    #[inline(always)]
    pub fn none() -> Self {
        Rows { interval: Interval::none(), rows: [&[0.0; N]; 3] }
    }

    /// Which of the knots' intervals.
    #[inline]
    pub fn interval(&self) -> Interval {
        self.interval
    }

    /// Whether a deflection lies in this interval.
    #[inline]
    pub fn hold(&self, deflection: f64) -> bool {
        self.interval.holds(deflection)
    }

    /// Σ weight × row: the blended interval.
    #[inline]
    pub fn blend(&self, weights: [f64; 3]) -> [f64; N] {
        let ([a, b, c], [x, y, z]) = (self.rows, weights);
        std::array::from_fn(|i| x * a[i] + y * b[i] + z * c[i])
    }

    /// Distance of a deflection from the knot; none below zero.
    #[inline]
    pub fn distance(&self, deflection: f64) -> f64 {
        self.interval.distance(deflection)
    }
}

/// Value, slope and integral of a blended curve.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// N; without unit for friction.
    pub value: f64,
    /// Per m.
    pub slope: f64,
    /// J; of no use for friction.
    pub energy: f64,
}

/// A test point's f^z and μ in one interval of δz: ∫f^z to the knot, f^z's four powers, μ's four powers.
pub type DepthRow = [f64; 9];

/// A test point's f^r in one interval of δr: ∫f^r to the knot, then f^r's four powers.
pub type LateralRow = [f64; 5];

/// The responses of all test points, in power form over shared knots.
#[derive(Debug, Clone, PartialEq)]
pub struct Responses {
    depth: Knots,
    lateral: Knots,
    /// (test points × depth knots)
    depth_rows: Vec<DepthRow>,
    /// (test points × lateral knots)
    lateral_rows: Vec<LateralRow>,
}

impl Responses {
    /// Lays out `responses`, whose curves must share their knots.
    ///
    /// # Errors
    /// No test point; curves on different knots; a normal curve that starts elsewhere than 0 or decreases; a lateral
    /// one that does not increase; friction below 0. The place names the test point.
    pub fn new(responses: &[Response]) -> Result<Self> {
        let Some(first) = responses.first() else {
            return Err(BodyError::invalid("responses", "there is no test point", "give at least one"));
        };
        let depth = Knots::new(first.normal.knots())?;
        let lateral = Knots::new(first.lateral.knots())?;
        let mut depth_rows = Vec::with_capacity(responses.len() * depth.knots.len());
        let mut lateral_rows = Vec::with_capacity(responses.len() * lateral.knots.len());
        for (t, r) in responses.iter().enumerate() {
            r.check_at(t, depth.values(), lateral.values())?;
            let friction = r.friction.pieces();
            depth_rows.extend(r.normal.pieces().iter().zip(friction).map(|(n, f)| {
                let ([a, b, c, d], [e, f, g, h]) = (n.coefficients, f.coefficients);
                [n.integral, a, b, c, d, e, f, g, h]
            }));
            lateral_rows.extend(r.lateral.pieces().iter().map(|p| {
                let [a, b, c, d] = p.coefficients;
                [p.integral, a, b, c, d]
            }));
        }
        Ok(Responses { depth, lateral, depth_rows, lateral_rows })
    }

    /// Number of test points.
    pub fn len(&self) -> usize {
        self.lateral_rows.len() / self.lateral.knots.len()
    }

    /// Whether there are none: the body's law is a coupled one.
    pub fn is_empty(&self) -> bool {
        self.lateral_rows.is_empty()
    }

    /// Shared knots of δz, m.
    pub fn depth_knots(&self) -> &Knots {
        &self.depth
    }

    /// Shared knots of δr, m.
    pub fn lateral_knots(&self) -> &Knots {
        &self.lateral
    }

    /// The interval of three test points' normal and friction curves that holds δz.
    ///
    /// # Real-time
    /// O(1), no allocation, never panics: a test point that does not exist answers nothing.
    #[inline]
    pub fn depth_rows(&self, points: [u32; 3], depth: f64) -> Rows<'_, 9> {
        self.depth_rows_in(points, self.depth.interval(depth))
    }

    /// The same in an interval of the depth's knots.
    ///
    /// # Real-time
    /// As [`Responses::depth_rows`].
    #[inline]
    pub fn depth_rows_in(&self, points: [u32; 3], interval: Interval) -> Rows<'_, 9> {
        rows(&self.depth, &self.depth_rows, points, interval)
    }

    /// The interval of three test points' lateral curves that holds δr.
    ///
    /// # Real-time
    /// As [`Responses::depth_rows`].
    #[inline]
    pub fn lateral_rows(&self, points: [u32; 3], deflection: f64) -> Rows<'_, 5> {
        self.lateral_rows_in(points, self.lateral.interval(deflection))
    }

    /// The same in an interval of the lateral deflection's knots.
    ///
    /// # Real-time
    /// As [`Responses::depth_rows`].
    #[inline]
    pub fn lateral_rows_in(&self, points: [u32; 3], interval: Interval) -> Rows<'_, 5> {
        rows(&self.lateral, &self.lateral_rows, points, interval)
    }

    /// Where the energies of test points at a depth and a lateral deflection are found: in the intervals of rows that
    /// hold them.
    ///
    /// # Real-time
    /// O(1), no allocation, never panics.
    #[inline]
    pub fn basis(&self, [depth, lateral]: [f64; 2], rows: (&Rows<'_, 9>, &Rows<'_, 5>)) -> BasisValues<'_> {
        let powers = |t: f64| {
            let t2 = t * t;
            [1.0, t, t2 * 0.5, t2 * t * (1.0 / 3.0), t2 * t2 * 0.25]
        };
        let (depth_powers, lateral_powers) =
            (powers(rows.0.distance(depth)), powers(rows.1.distance(lateral)));
        BasisValues {
            responses: self,
            depth_interval: rows.0.interval.index,
            lateral_interval: rows.1.interval.index,
            depth_powers,
            lateral_powers,
            single: [depth_powers, lateral_powers].map(|powers| powers.map(|p| p as f32)),
        }
    }

    /// The knots of a coupled law, and no curves: lateral deflections are known up to `range_m`.
    pub(crate) fn knots_alone(depth: Knots, range_m: f64) -> Result<Self> {
        let lateral = Knots::new(&[0.0, range_m])?;
        Ok(Responses { depth, lateral, depth_rows: Vec::new(), lateral_rows: Vec::new() })
    }

    /// The knots alone.
    pub(crate) fn without_points(&self) -> Self {
        let (depth, lateral) = (self.depth.clone(), self.lateral.clone());
        Responses { depth, lateral, depth_rows: Vec::new(), lateral_rows: Vec::new() }
    }

    /// Becomes a copy of these test points of `from`, whose knots it has.
    pub(crate) fn copy(&mut self, from: &Responses, points: &[u32]) {
        self.depth_rows.clear();
        self.lateral_rows.clear();
        if from.is_empty() {
            return;
        }
        for &point in points {
            let rows = |columns: usize| point as usize * columns..(point as usize + 1) * columns;
            self.depth_rows.extend_from_slice(&from.depth_rows[rows(from.depth.knots.len())]);
            self.lateral_rows.extend_from_slice(&from.lateral_rows[rows(from.lateral.knots.len())]);
        }
    }

    /// The energy's coefficients of a test point's normal curve in one interval; none where there is no such point.
    pub(crate) fn depth_row(&self, point: u32, interval: usize) -> [f64; POWERS] {
        let row = self.depth_rows.get(point as usize * self.depth.knots.len() + interval);
        row.map_or([0.0; POWERS], |[i, a, b, c, d, ..]| [*i, *a, *b, *c, *d])
    }

    /// The same of its lateral curve.
    pub(crate) fn lateral_row(&self, point: u32, interval: usize) -> [f64; POWERS] {
        let row = self.lateral_rows.get(point as usize * self.lateral.knots.len() + interval);
        row.copied().unwrap_or([0.0; POWERS])
    }

    /// Bytes that a step may read.
    pub(crate) fn memory(&self) -> [&[u8]; 2] {
        [bytemuck::cast_slice(&self.depth_rows), bytemuck::cast_slice(&self.lateral_rows)]
    }
}

/// A depth and a lateral deflection, as [`Responses::basis`] looked them up.
#[derive(Debug, Clone, Copy)]
pub struct BasisValues<'a> {
    responses: &'a Responses,
    depth_interval: usize,
    lateral_interval: usize,
    /// 1, t, t²/2, t³/3, t⁴/4 of the distances from the intervals' knots: what a row's integral and powers are multiplied
    /// with to give the energy.
    depth_powers: [f64; POWERS],
    lateral_powers: [f64; POWERS],
    /// Both in single precision.
    pub(crate) single: [[f32; POWERS]; 2],
}

/// Coefficients of a test point's energy in one interval.
pub const POWERS: usize = 5;

impl BasisValues<'_> {
    /// W_t = F^z(δz) + F^r(ρ) of a test point, J.
    ///
    /// # Real-time
    /// O(1), never panics: a test point that does not exist answers nothing.
    #[inline]
    pub fn energy(&self, test_point: u32) -> f64 {
        let Responses { depth_rows, lateral_rows, .. } = self.responses;
        let (i, j) = self.rows(test_point as usize);
        let z = depth_rows.get(i).unwrap_or(&[0.0; 9]);
        let r = lateral_rows.get(j).unwrap_or(&[0.0; 5]);
        let (p, q) = (&self.depth_powers, &self.lateral_powers);
        // Both side by side, in pairs.
        let [a, b]: [f64; 2] = std::array::from_fn(|i| {
            z[i + 1] * p[i + 1] + r[i + 1] * q[i + 1] + (z[i + 3] * p[i + 3] + r[i + 3] * q[i + 3])
        });
        z[0] + r[0] + (a + b)
    }

    /// The energies of three test points, not to be found again.
    ///
    /// # Real-time
    /// As [`BasisValues::energy`].
    #[inline]
    pub fn cache(&self, points: [u32; 3]) -> crate::gradient::EnergyCache {
        crate::gradient::EnergyCache { points, energies: points.map(|t| self.energy(t)) }
    }

    /// Where the rows of these intervals are in tables of the same knots.
    #[inline]
    pub(crate) fn rows(&self, point: usize) -> (usize, usize) {
        let Responses { depth, lateral, .. } = self.responses;
        (point * depth.knots.len() + self.depth_interval, point * lateral.knots.len() + self.lateral_interval)
    }
}

#[inline]
fn rows<'a, const N: usize>(
    knots: &Knots,
    table: &'a [[f64; N]],
    points: [u32; 3],
    interval: Interval,
) -> Rows<'a, N> {
    let columns = knots.knots.len();
    let row = |point: u32| table.get(point as usize * columns + interval.index).unwrap_or(&[0.0; N]);
    Rows { interval, rows: points.map(row) }
}

impl Sample {
    /// The curve with these powers at distance t from its knot, and `integral` up to there.
    #[inline]
    pub fn at(integral: f64, powers: [f64; 4], t: f64) -> Self {
        let [value, slope, energy] = Piece { integral, coefficients: powers }.eval(t);
        Sample { value, slope, energy }
    }
}

impl Response {
    /// Its curves.
    pub fn curves(&self) -> [&Curve; 3] {
        [&self.normal, &self.lateral, &self.friction]
    }

    /// The paper's example (6), (7): f^z = 100 k_z δz², f^r = k_r δr, constant μ; exact up to the given deflections.
    ///
    /// `normal_stiffness` k_z and `lateral_stiffness` k_r in N/m; deflections in m.
    ///
    /// # Errors
    /// A stiffness that is not positive, a negative μ, or deflections that a knot can't be.
    pub fn paper(
        normal_stiffness: f64,
        lateral_stiffness: f64,
        friction: f64,
        depth_max_m: f64,
        lateral_max_m: f64,
    ) -> Result<Self> {
        let law = |knots: &[f64], value: &dyn Fn(f64) -> f64, slope: &dyn Fn(f64) -> f64| {
            let values: Vec<f64> = knots.iter().map(|&d| value(d)).collect();
            let slopes: Vec<f64> = knots.iter().map(|&d| slope(d)).collect();
            Curve::hermite(knots, &values, &slopes, Extension::Linear)
        };
        let (kz, kr) = (normal_stiffness, lateral_stiffness);
        if !(kz > 0.0 && kr > 0.0 && friction >= 0.0) {
            return Err(BodyError::invalid(
                "response",
                format!("stiffnesses {kz} and {kr} N/m, friction {friction}"),
                "give positive stiffnesses and a friction coefficient of 0 or more",
            ));
        }
        Ok(Response {
            normal: law(&[0.0, depth_max_m], &|d| 100.0 * kz * d * d, &|d| 200.0 * kz * d)?,
            lateral: law(&[0.0, lateral_max_m], &|d| kr * d, &|_| kr)?,
            friction: Curve::through(
                &[0.0, depth_max_m],
                &[friction; 2],
                crate::Interpolation::Linear,
                Extension::Constant,
            )?,
        })
    }

    /// What test point `t` promises of its response on these knots.
    pub(crate) fn check_at(&self, t: usize, depth: &[f64], lateral: &[f64]) -> Result<()> {
        self.check(depth, lateral)
            .map_err(|(problem, hint)| BodyError::invalid(format!("test point {t}"), problem, hint))
    }

    fn check(&self, depth: &[f64], lateral: &[f64]) -> std::result::Result<(), (String, &'static str)> {
        let fail = |problem: String, hint| Err((problem, hint));
        if self.normal.knots() != depth || self.friction.knots() != depth || self.lateral.knots() != lateral {
            return fail("its curves are on other knots".into(), "bring all curves onto shared knots");
        }
        if self.friction.extension() != Extension::Constant
            || self.normal.extension() != Extension::Linear
            || self.lateral.extension() != Extension::Linear
        {
            return fail(
                "its curves go on wrongly past their end".into(),
                "forces go on linearly, friction stays constant",
            );
        }
        for (name, curve, knots) in [("normal", &self.normal, depth), ("lateral", &self.lateral, lateral)] {
            let scale = curve.value(knots[knots.len() - 1]).abs();
            if curve.value(0.0) != 0.0 {
                return fail(
                    format!("its {name} force at zero deflection is {} N", curve.value(0.0)),
                    "it must be 0",
                );
            }
            let least = curve.least_slope();
            if least < -1e-9 * scale / knots[knots.len() - 1] {
                return fail(
                    format!("its {name} force decreases ({least:.3} N/m)"),
                    "forces must not decrease with deflection: smooth the samples",
                );
            }
        }
        if !(self.lateral.ordinates().iter().all(|b| b[3] > b[0])) {
            return fail(
                "its lateral force does not increase".into(),
                "the lateral force must grow with deflection",
            );
        }
        let least = self.friction.least_value();
        if least < 0.0 {
            return fail(format!("its friction coefficient falls to {least:.3}"), "it must not be negative");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Interpolation;
    use proptest::prelude::*;

    pub(crate) fn response(k: f64, mu: f64) -> Response {
        let knots = [0.0, 1e-3, 2.5e-3, 7e-3];
        let normal = Curve::through(
            &knots,
            &knots.map(|d| 100.0 * k * d * d),
            Interpolation::Pchip,
            Extension::Linear,
        );
        let lateral =
            Curve::through(&[0.0, 5e-3], &[0.0, k * 5e-3], Interpolation::Linear, Extension::Linear);
        let friction =
            Curve::through(&knots, &[mu, mu, mu * 1.5, mu], Interpolation::Pchip, Extension::Constant);
        Response { normal: normal.unwrap(), lateral: lateral.unwrap(), friction: friction.unwrap() }
    }

    #[test]
    fn a_mix_is_the_weighted_sum_of_the_curves() {
        let points = [response(400.0, 0.2), response(700.0, 0.4), response(550.0, 0.3)];
        let table = Responses::new(&points).unwrap();
        let n = [0.2, 0.5, 0.3];
        for i in -1..200 {
            let d = i as f64 * 5e-5;
            let rows = table.depth_rows([0, 1, 2], d);
            assert!(rows.hold(d));
            let [integral, a, b, c, e, rest @ ..] = rows.blend(n);
            let (normal, friction) = (
                Sample::at(integral, [a, b, c, e], rows.distance(d)),
                Sample::at(0.0, rest, rows.distance(d)),
            );
            let rows = table.lateral_rows([0, 1, 2], d);
            let [integral, a, b, c, e] = rows.blend(n);
            let lateral = Sample::at(integral, [a, b, c, e], rows.distance(d));
            let sum = |f: &dyn Fn(&Response) -> f64| -> f64 { (0..3).map(|l| n[l] * f(&points[l])).sum() };
            assert!((normal.value - sum(&|r| r.normal.value(d))).abs() < 1e-12);
            assert!((normal.energy - sum(&|r| r.normal.integral(d))).abs() < 1e-15);
            assert!(d < 0.0 || (normal.slope - sum(&|r| r.normal.slope(d))).abs() < 1e-9);
            assert!((friction.value - sum(&|r| r.friction.value(d))).abs() < 1e-12);
            assert!((lateral.value - sum(&|r| r.lateral.value(d))).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn locate_finds_the_interval(steps in prop::collection::vec(1e-6f64..1e-2, 1..40), at in 0.0f64..1.0) {
            let mut knots = vec![0.0];
            for h in steps { knots.push(knots[knots.len() - 1] + h); }
            let table = Knots::new(&knots).unwrap();
            for x in knots.iter().copied().chain([at * knots[knots.len() - 1], 1e9, -1.0, f64::NAN, f64::INFINITY]) {
                let i = table.interval(x).index;
                let want = knots.iter().skip(1).take_while(|&&k| x >= k).count();
                prop_assert_eq!(i, want);
            }
        }
    }
}
