//! One force-deflection or friction curve: a piecewise cubic in Bernstein form.
//!
//! Curves are built, refined and drawn here; the running engine reads them blended, from
//! [`Responses`](crate::Responses).

use crate::error::{BodyError, Result};

/// How a curve passes between its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Monotone piecewise cubic Hermite (Fritsch and Butland 1984): smooth, and monotone where the data is.
    #[default]
    Pchip,
    /// Straight lines.
    Linear,
}

/// How a curve goes on past its last knot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extension {
    /// Along its end slope: forces.
    Linear,
    /// At its last value: friction coefficients, which must not run below zero.
    Constant,
    /// Along its end's parabola: energies, whose slope is a force that goes on linearly.
    Quadratic,
}

/// A piecewise cubic y(δ) on 0 = knots\[0\] < knots\[1\] < …, constant at `y(0)` for δ < 0.
///
/// Force curves have y(0) = 0, so that "constant" means zero there.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Deflections in m, ascending, the first one 0; (n + 1).
    knots: Vec<f64>,
    /// Bernstein ordinates of each interval, (n × 4); in N for forces, without unit for friction.
    ordinates: Vec<[f64; 4]>,
    extension: Extension,
}

impl Curve {
    /// The curve through `(knots, values)`.
    ///
    /// # Errors
    /// Fewer than two knots, a first knot other than 0, knots that do not ascend, or a non-finite number.
    pub fn through(
        knots: &[f64],
        values: &[f64],
        interpolation: Interpolation,
        extension: Extension,
    ) -> Result<Self> {
        check_knots(knots)?;
        if values.len() != knots.len() {
            return Err(BodyError::invalid(
                "curve",
                format!("{} values for {} deflections", values.len(), knots.len()),
                "give one value for each deflection",
            ));
        }
        match interpolation {
            Interpolation::Pchip => Self::hermite(knots, values, &pchip_slopes(knots, values), extension),
            Interpolation::Linear => {
                check_finite(values)?;
                let ordinates = values
                    .windows(2)
                    .map(|v| [v[0], v[0] + (v[1] - v[0]) / 3.0, v[0] + (v[1] - v[0]) * (2.0 / 3.0), v[1]])
                    .collect();
                Ok(Curve { knots: knots.to_vec(), ordinates, extension })
            }
        }
    }

    /// The cubic Hermite curve with these values and slopes: exact for a law that is a cubic between the knots,
    /// as the paper's (6) and (7) are.
    ///
    /// # Errors
    /// As [`Curve::through`].
    pub fn hermite(knots: &[f64], values: &[f64], slopes: &[f64], extension: Extension) -> Result<Self> {
        check_knots(knots)?;
        check_finite(values)?;
        check_finite(slopes)?;
        let ordinates = (0..knots.len() - 1)
            .map(|i| {
                let third = (knots[i + 1] - knots[i]) / 3.0;
                [
                    values[i],
                    values[i] + slopes[i] * third,
                    values[i + 1] - slopes[i + 1] * third,
                    values[i + 1],
                ]
            })
            .collect();
        Ok(Curve { knots: knots.to_vec(), ordinates, extension })
    }

    /// The curve with these Bernstein ordinates, as a body file holds them.
    ///
    /// # Errors
    /// As [`Curve::through`], or a value that jumps at a knot.
    pub fn from_ordinates(knots: &[f64], ordinates: &[[f64; 4]], extension: Extension) -> Result<Self> {
        check_knots(knots)?;
        check_finite(ordinates.as_flattened())?;
        if ordinates.len() + 1 != knots.len() {
            return Err(BodyError::invalid(
                "curve",
                "ordinates do not match the knots",
                "give 4 for each interval",
            ));
        }
        let scale = ordinates.as_flattened().iter().fold(0.0f64, |m, y| m.max(y.abs()));
        for (i, pair) in ordinates.windows(2).enumerate() {
            if (pair[0][3] - pair[1][0]).abs() > 1e-9 * scale {
                return Err(BodyError::invalid(
                    format!("curve, knot {}", i + 1),
                    format!("the value jumps from {} to {}", pair[0][3], pair[1][0]),
                    "a response must be continuous",
                ));
            }
        }
        Ok(Curve { knots: knots.to_vec(), ordinates: ordinates.to_vec(), extension })
    }

    /// Deflections of the knots, m.
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// Bernstein ordinates, (intervals × 4).
    pub fn ordinates(&self) -> &[[f64; 4]] {
        &self.ordinates
    }

    /// Past-the-end behaviour.
    pub fn extension(&self) -> Extension {
        self.extension
    }

    /// Value at deflection `delta`.
    pub fn value(&self, delta: f64) -> f64 {
        self.eval(delta)[0]
    }

    /// Slope at `delta`, the right-hand one at a knot.
    pub fn slope(&self, delta: f64) -> f64 {
        self.eval(delta)[1]
    }

    /// Slope of the slope at `delta`, the right-hand one at a knot.
    pub fn bend(&self, delta: f64) -> f64 {
        if delta < 0.0 {
            return 0.0;
        }
        let i = self.knots.iter().skip(1).take_while(|&&k| delta >= k).count();
        let [_, _, c, d] = self.pieces()[i].coefficients;
        2.0 * c + 6.0 * d * (delta - self.knots[i])
    }

    /// Integral from 0 to `delta`: for a force the stored energy, J.
    pub fn integral(&self, delta: f64) -> f64 {
        self.eval(delta)[2]
    }

    fn eval(&self, delta: f64) -> [f64; 3] {
        if delta < 0.0 {
            let y = self.ordinates[0][0];
            return [y, 0.0, y * delta];
        }
        let pieces = self.pieces();
        let i = self.knots.iter().skip(1).take_while(|&&k| delta >= k).count();
        pieces[i].eval(delta - self.knots[i])
    }

    /// The intervals' polynomials, and the extension's as the last: one for each knot.
    pub(crate) fn pieces(&self) -> Vec<Piece> {
        let mut before = 0.0;
        let mut pieces: Vec<Piece> = Vec::with_capacity(self.knots.len());
        for (b, k) in self.ordinates.iter().zip(self.knots.windows(2)) {
            let h = k[1] - k[0];
            pieces.push(Piece {
                integral: before,
                coefficients: [
                    b[0],
                    3.0 * (b[1] - b[0]) / h,
                    3.0 * (b[0] - 2.0 * b[1] + b[2]) / (h * h),
                    (b[3] - b[0] - 3.0 * (b[2] - b[1])) / (h * h * h),
                ],
            });
            // A Bernstein cubic's mean is the mean of its ordinates.
            before += h * (b[0] + b[1] + b[2] + b[3]) / 4.0;
        }
        let (b, h) = (self.ordinates[self.ordinates.len() - 1], self.last_width());
        let slope = if self.extension == Extension::Constant { 0.0 } else { 3.0 * (b[3] - b[2]) / h };
        let bend = match self.extension {
            Extension::Quadratic => 3.0 * (b[3] - 2.0 * b[2] + b[1]) / (h * h),
            Extension::Linear | Extension::Constant => 0.0,
        };
        pieces.push(Piece { integral: before, coefficients: [b[3], slope, bend, 0.0] });
        pieces
    }

    fn last_width(&self) -> f64 {
        let n = self.knots.len();
        self.knots[n - 1] - self.knots[n - 2]
    }

    /// Least slope over all deflections ≥ 0, extension included, in N/m.
    pub fn least_slope(&self) -> f64 {
        let end = self.pieces().last().map_or(0.0, |p| p.coefficients[1]);
        self.ordinates.iter().zip(self.knots.windows(2)).fold(end, |least, (b, k)| {
            // The slope is the quadratic with Bernstein ordinates 3Δb/h: its least value is at an end or its vertex.
            let d = [b[1] - b[0], b[2] - b[1], b[3] - b[2]].map(|d| 3.0 * d / (k[1] - k[0]));
            let bend = d[0] - 2.0 * d[1] + d[2];
            let vertex = if bend > 0.0 { ((d[0] - d[1]) / bend).clamp(0.0, 1.0) } else { 0.0 };
            let at = |t: f64| d[0] * (1.0 - t) * (1.0 - t) + 2.0 * d[1] * t * (1.0 - t) + d[2] * t * t;
            least.min(d[0]).min(d[2]).min(at(vertex))
        })
    }

    /// Least value over all deflections ≥ 0. Below zero by less than 10⁻¹² of the largest ordinate is rounding, and 0.
    pub fn least_value(&self) -> f64 {
        if self.pieces().last().is_some_and(|end| end.coefficients[1] < 0.0) {
            return f64::NEG_INFINITY;
        }
        let least = self.ordinates.iter().map(least_of).fold(f64::INFINITY, f64::min);
        let largest = self.ordinates.as_flattened().iter().fold(0.0f64, |most, b| most.max(b.abs()));
        if least < 0.0 && least > -1e-12 * largest { 0.0 } else { least }
    }

    /// The same curve on more knots: `knots` must hold all of this curve's, and may go on past its end.
    ///
    /// # Errors
    /// As [`Curve::through`], or a knot of this curve that is missing.
    pub fn on_knots(&self, knots: &[f64]) -> Result<Self> {
        check_knots(knots)?;
        if let Some(missing) = self.knots.iter().find(|k| !knots.contains(k)) {
            return Err(BodyError::invalid(
                "curve",
                format!("knot {missing} m is missing"),
                "keep every knot",
            ));
        }
        let pieces = self.pieces();
        let mut ordinates = knots
            .windows(2)
            .map(|k| {
                let i = self.knots.iter().rposition(|&own| own <= k[0]).unwrap_or(0);
                pieces[i].ordinates(k[0] - self.knots[i], k[1] - k[0])
            })
            .collect::<Vec<[f64; 4]>>();
        // Rounding must not make the curve jump, nor friction fall below zero where it was zero.
        let starts: Vec<f64> = ordinates.iter().skip(1).map(|b| b[0]).collect();
        for (piece, start) in ordinates.iter_mut().zip(starts) {
            piece[3] = start;
        }
        Ok(Curve { knots: knots.to_vec(), ordinates, extension: self.extension })
    }

    /// Σ wᵢ curveᵢ of curves on the same knots. The order of the terms is the order of the sum.
    ///
    /// # Errors
    /// No curve, or curves on other knots.
    pub fn blend(terms: &[(f64, &Curve)]) -> Result<Self> {
        let Some((_, first)) = terms.first() else {
            return Err(BodyError::invalid("curve", "no curve to blend", "give at least one"));
        };
        if terms.iter().any(|(_, c)| c.knots != first.knots) {
            return Err(BodyError::invalid(
                "curve",
                "curves on different knots",
                "bring them onto shared knots",
            ));
        }
        let ordinates = (0..first.ordinates.len())
            .map(|i| std::array::from_fn(|j| terms.iter().map(|(w, c)| w * c.ordinates[i][j]).sum()))
            .collect();
        Ok(Curve { knots: first.knots.clone(), ordinates, extension: first.extension })
    }
}

/// A cubic in powers of the distance t from its knot, with the integral up to that knot.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Piece {
    /// ∫ from 0 to the knot.
    pub integral: f64,
    /// Of t⁰, t¹, t², t³.
    pub coefficients: [f64; 4],
}

impl Piece {
    /// Value, slope and integral at t.
    #[inline]
    pub fn eval(&self, t: f64) -> [f64; 3] {
        let [a, b, c, d] = self.coefficients;
        [
            a + t * (b + t * (c + t * d)),
            b + t * (2.0 * c + t * (3.0 * d)),
            self.integral + t * (a + t * (b * 0.5 + t * (c * (1.0 / 3.0) + t * (d * 0.25)))),
        ]
    }

    /// Bernstein ordinates over [t, t + h] of the cubic and its derivatives.
    pub fn derivatives(&self, t: f64, h: f64) -> Derivatives {
        let [_, b, c, d] = self.coefficients;
        let slope = |t: f64| b + t * (2.0 * c + t * (3.0 * d));
        let bend = [t, t + h].map(|t| 2.0 * c + 6.0 * d * t);
        let value = self.ordinates(t, h);
        Derivatives { value, slope: [slope(t), slope(t) + 0.5 * h * bend[0], slope(t + h)], bend }
    }

    /// Bernstein ordinates over [t, t + h].
    fn ordinates(&self, t: f64, h: f64) -> [f64; 4] {
        let ([y0, s0, _], [y1, s1, _]) = (self.eval(t), self.eval(t + h));
        [y0, y0 + s0 * h / 3.0, y1 - s1 * h / 3.0, y1]
    }
}

/// Least value of the cubic with these Bernstein ordinates: at an end, or where its derivative vanishes.
fn least_of(b: &[f64; 4]) -> f64 {
    let [c, m, e] = [b[1] - b[0], b[2] - b[1], b[3] - b[2]];
    // The derivative by thirds: c (1−t)² + 2 m t (1−t) + e t² = c + 2 h t + q t².
    let (h, q) = (m - c, c - 2.0 * m + e);
    let root = (h * h - q * c).max(0.0).sqrt();
    // Without cancellation: one root is z/q, the other c/z.
    let z = -(h + root.copysign(h));
    let at = |t: f64| {
        let t = if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 };
        let u = 1.0 - t;
        u * u * (u * b[0] + 3.0 * t * b[1]) + t * t * (3.0 * u * b[2] + t * b[3])
    };
    [b[0], b[3], at(z / q), at(c / z)].into_iter().fold(f64::INFINITY, f64::min)
}

/// Ordinates of a cubic and of its first two derivatives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Derivatives {
    pub value: [f64; 4],
    pub slope: [f64; 3],
    pub bend: [f64; 2],
}

pub(crate) fn check_knots(knots: &[f64]) -> Result<()> {
    let bad = |place: String, problem: String| {
        Err(BodyError::invalid(place, problem, "give ascending deflections in m that start at 0"))
    };
    if knots.len() < 2 || knots.len() > MAX_KNOTS {
        return bad(
            "deflections".into(),
            format!("{} knots, where 2 to {MAX_KNOTS} can be used", knots.len()),
        );
    }
    if knots[0] != 0.0 {
        return bad("deflection 0".into(), format!("the first is {} m", knots[0]));
    }
    for (i, pair) in knots.windows(2).enumerate() {
        // 1e-9 m is far below what a deflection means; it keeps the divided differences finite.
        if !pair[1].is_finite() || pair[1] - pair[0] < 1e-9 || pair[1] > 10.0 {
            return bad(format!("deflection {}", i + 1), format!("{} m after {} m", pair[1], pair[0]));
        }
    }
    Ok(())
}

/// Knots a body may share: more than any response needs, and few enough that a lookup table stays in cache.
pub const MAX_KNOTS: usize = 512;

fn check_finite(values: &[f64]) -> Result<()> {
    match values.iter().position(|v| !v.is_finite() || v.abs() > 1e12) {
        Some(i) => Err(BodyError::invalid(
            format!("value {i}"),
            format!("{} is no usable number", values[i]),
            "give finite values in SI units",
        )),
        None => Ok(()),
    }
}

/// Fritsch–Butland slopes with three-point ends, as in the PCHIP routine of SLATEC.
fn pchip_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let d: Vec<f64> = y.windows(2).zip(&h).map(|(w, h)| (w[1] - w[0]) / h).collect();
    if n == 2 {
        return vec![d[0]; 2];
    }
    let end = |h0: f64, h1: f64, d0: f64, d1: f64| {
        let s = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
        if s * d0 <= 0.0 {
            0.0
        } else if d0 * d1 <= 0.0 && s.abs() > 3.0 * d0.abs() {
            3.0 * d0
        } else {
            s
        }
    };
    let mut slopes = vec![0.0; n];
    slopes[0] = end(h[0], h[1], d[0], d[1]);
    slopes[n - 1] = end(h[n - 2], h[n - 3], d[n - 2], d[n - 3]);
    for i in 1..n - 1 {
        if d[i - 1] * d[i] > 0.0 {
            let (w1, w2) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
            slopes[i] = (w1 + w2) / (w1 / d[i - 1] + w2 / d[i]);
        }
    }
    slopes
}

/// The value at `at` of the straight lines between rows (place, value) whose places ascend, constant beyond them; none without rows.
pub fn between_rows(rows: &[(f64, f64)], at: f64) -> Option<f64> {
    let i = rows.partition_point(|r| r.0 <= at);
    match (i.checked_sub(1).and_then(|i| rows.get(i)), rows.get(i)) {
        (Some((x0, y0)), Some((x1, y1))) => Some(y0 + (y1 - y0) * (at - x0) / (x1 - x0)),
        (Some((_, y)), None) | (None, Some((_, y))) => Some(*y),
        (None, None) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn quadratic(k: f64) -> Curve {
        let knots: Vec<f64> = (0..=8).map(|i| i as f64 * 1e-3).collect();
        let values: Vec<f64> = knots.iter().map(|d| 100.0 * k * d * d).collect();
        let slopes: Vec<f64> = knots.iter().map(|d| 200.0 * k * d).collect();
        Curve::hermite(&knots, &values, &slopes, Extension::Linear).unwrap()
    }

    #[test]
    fn the_papers_law_is_exact() {
        let c = quadratic(437.0);
        for i in 1..=8000 {
            let d = i as f64 * 1e-6;
            let exact = [43700.0 * d * d, 87400.0 * d, 43700.0 * d * d * d / 3.0];
            for (got, want) in c.eval(d).iter().zip(exact) {
                assert!((got - want).abs() <= 1e-12 * want, "{d}: {got} {want}");
            }
        }
        assert_eq!(c.eval(-1e-3), [0.0, 0.0, -0.0]);
        let past = c.value(0.010) - c.value(0.008);
        assert!((past - 0.002 * 87400.0 * 0.008).abs() < 1e-12);
    }

    #[test]
    fn pchip_agrees_with_the_published_routine() {
        // Values of scipy.interpolate.PchipInterpolator([0, 1, 3, 4], [0, 2, 3, 7]) at 0.5, 2 and 3.5.
        let c = Curve::through(
            &[0.0, 1.0, 3.0, 4.0],
            &[0.0, 2.0, 3.0, 7.0],
            Interpolation::Pchip,
            Extension::Linear,
        );
        let c = c.unwrap();
        for (x, want) in [(0.5, REFERENCE[0]), (2.0, REFERENCE[1]), (3.5, REFERENCE[2])] {
            assert!((c.value(x) - want).abs() < 1e-12, "{x}: {}", c.value(x));
        }
    }
    /// Sampled 16 times an interval, a dip between two samples passed, and a body with friction below zero was taken.
    #[test]
    fn a_dip_below_zero_is_seen_however_narrow() {
        let knots = [0.0, 1e-3];
        for middle in [1.5 / 16.0, 8.5 / 16.0, 14.5 / 16.0] {
            // (t − m)² − 10⁻⁴: below zero for a hundredth to either side of m.
            let (y, s) = (|t: f64| (t - middle).powi(2) - 1e-4, |t: f64| 2e3 * (t - middle));
            let dip =
                Curve::hermite(&knots, &[y(0.0), y(1.0)], &[s(0.0), s(1.0)], Extension::Constant).unwrap();
            assert!((dip.least_value() + 1e-4).abs() < 1e-12, "{middle}: {}", dip.least_value());
        }
        let flat = Curve::hermite(&knots, &[1.0, 0.0], &[-2e3, 0.0], Extension::Constant).unwrap();
        assert_eq!(flat.least_value(), 0.0);
        let falling = Curve::hermite(&knots, &[1.0, 0.5], &[0.0, -1e3], Extension::Linear).unwrap();
        assert_eq!(falling.least_value(), f64::NEG_INFINITY);
    }

    const REFERENCE: [f64; 3] = [1.2053571428571428, 2.471042471042471, 4.475788288288288];

    proptest! {
        #[test]
        fn monotone_data_stays_monotone(steps in prop::collection::vec((0.01f64..1.0, 0.0f64..5.0), 2..12)) {
            let (mut knots, mut values) = (vec![0.0], vec![0.0]);
            for (h, dy) in steps {
                knots.push(knots[knots.len() - 1] + h);
                values.push(values[values.len() - 1] + dy);
            }
            for kind in [Interpolation::Pchip, Interpolation::Linear] {
                let c = Curve::through(&knots, &values, kind, Extension::Linear).unwrap();
                prop_assert!(c.least_slope() >= -1e-9);
                let end = knots[knots.len() - 1];
                let mut last = 0.0;
                for i in 0..=1000 {
                    let y = c.value(end * 1.2 * i as f64 / 1000.0);
                    prop_assert!(y >= last - 1e-9);
                    last = y;
                }
            }
        }

        #[test]
        fn the_least_value_is_the_curves_own(b in prop::array::uniform4(-1.0f64..1.0)) {
            let c = Curve::from_ordinates(&[0.0, 1.0], &[b], Extension::Constant).unwrap();
            let sampled = (0..=4000).map(|i| c.value(i as f64 / 4000.0)).fold(f64::INFINITY, f64::min);
            let least = c.least_value();
            // Between two samples a cubic of this size dips by no more than its bend there.
            prop_assert!(least <= sampled + 1e-12 && least > sampled - 1e-6, "{} {}", least, sampled);
            prop_assert!(least >= 0.0 || b.iter().any(|b| *b < 0.0));
        }

        #[test]
        fn more_knots_change_nothing(extra in prop::collection::vec(0.0f64..0.012, 1..9), at in 0.0f64..0.02) {
            let c = quadratic(437.0);
            let mut knots = c.knots().to_vec();
            knots.extend(extra);
            knots.sort_by(f64::total_cmp);
            knots.dedup_by(|b, a| *b - *a < 1e-6);
            prop_assume!(c.knots().iter().all(|k| knots.contains(k)));
            let finer = c.on_knots(&knots).unwrap();
            for (a, b) in finer.eval(at).iter().zip(c.eval(at)) {
                prop_assert!((a - b).abs() <= 1e-9 * (1.0 + b.abs()));
            }
        }

        #[test]
        fn slope_and_integral_belong_to_the_value(at in 0.0f64..0.012) {
            let c = Curve::through(&[0.0, 1e-3, 2e-3, 5e-3, 8e-3], &[0.0, 0.1, 0.15, 0.9, 3.0],
                Interpolation::Pchip, Extension::Linear).unwrap();
            let h = 1e-7;
            let slope = (c.integral(at + h) - c.integral(at)) / h;
            prop_assert!((slope - c.value(at + h / 2.0)).abs() < 1e-6);
            let [a, b] = [c.value(at), c.value(at + h)];
            prop_assert!((b - a - h * c.slope(at + h / 2.0)).abs() < 1e-9);
        }
    }
}
