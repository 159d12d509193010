//! Responses by a formula: the paper's (6) and (7), with a stiffness that varies over the surface.

use crate::spec::{Deflection, Friction};
use anyhow::Result;
use glam::DVec3;
use palpate_body::{Curve, Extension, Interpolation, Response};
use std::f64::consts::PI;

/// f^z = 100 k_z δz² and f^r = k_r δr.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnalyticLaw {
    /// k_z at the mean, N/m.
    pub normal_n_per_m: f64,
    /// k_r at the mean, N/m.
    pub lateral_n_per_m: f64,
    /// Of both.
    pub variation: Variation,
}

/// How the stiffness varies: by the factor (1 + around cos θ)(1 + along sin(2π z/length)), where θ is the angle about
/// the z axis, and z counts from the middle of the surface's extent along z, the length.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Variation {
    /// 0 to 1.
    pub around: f64,
    /// 0 to 1.
    pub along: f64,
}

impl Variation {
    /// The factor at each of `positions` (m).
    pub fn factors(&self, positions: &[DVec3]) -> Vec<f64> {
        let (low, high) = positions
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.z), high.max(p.z)));
        let (middle, length) = ((low + high) / 2.0, high - low);
        let factor = |p: &DVec3| {
            let reach = (p.x * p.x + p.y * p.y).sqrt();
            // On the axis there is no angle, in a flat body no length.
            let cosine = if reach > 0.0 { p.x / reach } else { 0.0 };
            let turn = if length > 0.0 { (p.z - middle) / length } else { 0.0 };
            (1.0 + self.around * cosine) * (1.0 + self.along * libm::sin(2.0 * PI * turn))
        };
        positions.iter().map(factor).collect()
    }
}

impl AnalyticLaw {
    /// One response for each of `positions` (m), all on the same knots.
    ///
    /// # Errors
    /// Deflections or coefficients that a curve can't have.
    pub fn responses(
        &self,
        positions: &[DVec3],
        friction: &Friction,
        deflection: Deflection,
    ) -> Result<Vec<Response>> {
        let Deflection { normal_max_m, lateral_max_m, steps } = deflection;
        let even =
            |end: f64| (0..=steps).map(move |i| end * f64::from(i) / f64::from(steps)).collect::<Vec<_>>();
        let mut depths = even(normal_max_m);
        let table: Vec<(f64, f64)> = match friction {
            Friction::Constant(mu) => vec![(0.0, *mu), (normal_max_m, *mu)],
            Friction::Table(rows) => rows.clone(),
        };
        // The friction's bends are knots as well, unless one is there already or all but there.
        depths.extend(table.iter().map(|(depth, _)| *depth));
        depths.sort_by(f64::total_cmp);
        depths.dedup_by(|b, a| *b - *a <= 1e-8);
        let values: Vec<f64> = depths.iter().map(|d| between(&table, *d)).collect();
        let friction = Curve::through(&depths, &values, Interpolation::Linear, Extension::Constant)?;
        let laterals = even(lateral_max_m);
        self.variation
            .factors(positions)
            .iter()
            .map(|factor| {
                let (kz, kr) = (self.normal_n_per_m * factor, self.lateral_n_per_m * factor);
                let end = |knots: &[f64]| knots.last().copied().unwrap_or_default();
                let exact = Response::paper(kz, kr, 0.0, end(&depths), end(&laterals))?;
                Ok(Response {
                    normal: exact.normal.on_knots(&depths)?,
                    lateral: exact.lateral.on_knots(&laterals)?,
                    friction: friction.clone(),
                })
            })
            .collect()
    }
}

/// The value at `x` on straight lines between the rows, constant beyond them.
fn between(rows: &[(f64, f64)], x: f64) -> f64 {
    let Some(i) = rows.iter().position(|(at, _)| *at >= x) else { return rows.last().map_or(0.0, |r| r.1) };
    let Some(((x0, y0), (x1, y1))) = i.checked_sub(1).and_then(|h| Some((*rows.get(h)?, *rows.get(i)?)))
    else {
        return rows[i].1;
    };
    y0 + (y1 - y0) * ((x - x0) / (x1 - x0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_is_exact_between_the_knots() {
        let law = AnalyticLaw {
            normal_n_per_m: 600.0,
            lateral_n_per_m: 500.0,
            variation: Variation { around: 0.5, along: 0.2 },
        };
        let positions =
            [DVec3::new(0.03, 0.0, -0.05), DVec3::new(-0.03, 0.0, 0.05), DVec3::new(0.0, 0.03, 0.025)];
        let friction = Friction::Table(vec![(0.0, 0.4), (3e-3, 0.2), (20e-3, 0.1)]);
        let deflection = Deflection { normal_max_m: 8e-3, lateral_max_m: 4e-3, steps: 12 };
        let responses = law.responses(&positions, &friction, deflection).unwrap();
        for (response, factor) in responses.iter().zip([1.5, 0.5, 1.2]) {
            for i in 0..100 {
                let d = f64::from(i) * 7e-5;
                assert!((response.normal.value(d) - 100.0 * 600.0 * factor * d * d).abs() < 1e-12);
                assert!((response.lateral.value(d) - 500.0 * factor * d).abs() < 1e-12);
            }
            assert!((response.friction.value(1.5e-3) - 0.3).abs() < 1e-12);
            assert!((response.friction.value(1.0) - 0.1).abs() < 1e-12);
        }
    }
}
