//! The greatest stiffness that a body answers with, which a device must be able to hold (MODEL 5).

use crate::tensor::Principal;
use crate::{Body, Curve, Potential, Response};
use serde::Serialize;

/// K_max at a depth (MODEL 5): the greatest slope of any response up to there, f_z' or f_r'. Mixtures of responses
/// stay below it, and so does f_r/δr. Of a coupled law a bound on the greatest eigenvalue of W's Hessian, within the lateral
/// range.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct StiffnessAt {
    /// δz, m.
    pub depth_m: f64,
    /// N/m.
    pub value: f64,
}

/// How each node's tensor acts laterally; none of an isotropic body's.
pub fn principals(body: &Body) -> impl Iterator<Item = Principal> + '_ {
    let tensors = body.lateral_tensors().unwrap_or_default();
    tensors.iter().zip(body.nodes()).map(|(a, node)| Principal::of(a, node.inward))
}

/// The greatest stiffnesses met so far.
#[derive(Debug, Default)]
pub struct Stiffest {
    /// Of the normal curves up to each depth knot, N/m; of a coupled law in all directions.
    normal: Vec<f64>,
    /// Of the lateral curves, N/m.
    lateral: f64,
    /// How many times that the stiffest direction has; 0 where there are no tensors.
    ratio: f64,
}

impl Stiffest {
    fn of(body: &Body) -> Self {
        let mut stiffest = Stiffest::default();
        body.curves().iter().for_each(|r| stiffest.meet(r));
        if let Some(law) = body.coupled_law() {
            law.potentials.iter().for_each(|p| stiffest.meet_coupled(p, law.range_m));
        }
        principals(body).for_each(|p| stiffest.turn(&p));
        stiffest
    }

    /// Adds a test point.
    pub fn meet(&mut self, response: &Response) {
        let slopes = greatest_slopes(&response.normal);
        self.normal.resize(slopes.len(), 0.0);
        self.normal.iter_mut().zip(slopes).for_each(|(most, slope)| *most = most.max(slope));
        self.lateral = greatest_slopes(&response.lateral).into_iter().fold(self.lateral, f64::max);
    }

    /// Adds a test point of a coupled law: bounds in all directions of the tool's motion at once.
    pub fn meet_coupled(&mut self, potential: &Potential, range_m: f64) {
        let bounds = potential.stiffness_bounds(range_m);
        self.normal.resize(bounds.len(), 0.0);
        self.normal.iter_mut().zip(bounds).for_each(|(most, bound)| *most = most.max(bound));
    }

    /// Adds a node's directions. A blend of tensors has no eigenvalue above all of theirs.
    pub fn turn(&mut self, principal: &Principal) {
        self.ratio = self.ratio.max(principal.values[0]);
    }

    /// In stick, along the surface.
    pub fn aside(&self) -> f64 {
        self.lateral * self.ratio.max(1.0)
    }

    /// In stick, at any depth.
    pub fn anywhere(&self) -> f64 {
        self.normal.last().copied().unwrap_or_default().max(self.aside())
    }
}

/// The greatest lateral stiffness in stick, N/m; 0 with a coupled law, which has none apart from the depth.
pub fn stiffness_aside(body: &Body) -> f64 {
    Stiffest::of(body).aside()
}

/// K_max at each depth knot.
pub fn stiffness_max(body: &Body) -> Vec<StiffnessAt> {
    let stiffest = Stiffest::of(body);
    let aside = stiffest.aside();
    let depths = body.responses().depth_knots().values().iter();
    depths.zip(stiffest.normal).map(|(&depth_m, k)| StiffnessAt { depth_m, value: k.max(aside) }).collect()
}

/// The greatest slope from 0 up to each knot, to its right included.
fn greatest_slopes(curve: &Curve) -> Vec<f64> {
    let mut so_far = f64::NEG_INFINITY;
    let mut slopes = Vec::with_capacity(curve.knots().len());
    for (b, k) in curve.ordinates().iter().zip(curve.knots().windows(2)) {
        // The slope is the quadratic with Bernstein ordinates 3Δb/h: greatest at an end or its vertex.
        let d = [b[1] - b[0], b[2] - b[1], b[3] - b[2]].map(|d| 3.0 * d / (k[1] - k[0]));
        slopes.push(so_far.max(d[0]));
        let bend = d[0] - 2.0 * d[1] + d[2];
        let t = if bend < 0.0 { ((d[0] - d[1]) / bend).clamp(0.0, 1.0) } else { 0.0 };
        let vertex = d[0] * (1.0 - t) * (1.0 - t) + 2.0 * d[1] * t * (1.0 - t) + d[2] * t * t;
        so_far = so_far.max(d[0]).max(d[2]).max(vertex);
    }
    slopes.push(so_far);
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Extension, Interpolation};

    #[test]
    fn greatest_slopes_are_those_of_a_fine_sampling() {
        let knots = [0.0, 1e-3, 2.5e-3, 4e-3];
        let curve =
            Curve::through(&knots, &[0.0, 0.1, 0.9, 1.0], Interpolation::Pchip, Extension::Linear).unwrap();
        for (knot, greatest) in knots.iter().zip(greatest_slopes(&curve)) {
            let sampled = (0..=100_000).map(|i| curve.slope(knot * f64::from(i) / 1e5)).fold(0.0, f64::max);
            assert!((greatest - sampled).abs() < 1e-4 * sampled.max(1.0), "{greatest} {sampled}");
        }
    }
}
