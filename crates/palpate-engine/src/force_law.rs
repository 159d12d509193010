//! The interface between force law and step (MODEL 2 and 7; LAW 2). The step is compiled once for each kind of law; what comes
//! after the law asks for W, its gradient and its changes, and knows none of them.

use crate::drive::Drive;
use crate::kernel::{Change, Deflection, Drift, Evaluation, Reading};
use glam::DVec3;
use palpate_body::law::{Symmetric, inverse, moved};
use palpate_body::{ContactModel, Gradients, Node, PointEnergies};
use std::array::from_fn;

/// Below this the lateral deflection is rounding, and its direction noise, m.
pub(crate) const NO_DIRECTION: f64 = 1e-12;

/// Whose responses an element blends.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Blend {
    /// Each node is its own test point.
    Own,
    /// All nodes blend the same three test points.
    Shared,
    /// Up to nine test points: where the element lies across the triangles of test points.
    Wide,
}

impl Blend {
    #[inline]
    pub fn of([a, b, c]: [&Node; 3]) -> Self {
        if a.weights[0] == 1.0 && b.weights[0] == 1.0 && c.weights[0] == 1.0 {
            Blend::Own
        } else if a.test_points == b.test_points && a.test_points == c.test_points {
            Blend::Shared
        } else {
            Blend::Wide
        }
    }

    #[inline]
    pub fn points(self, nodes: [&Node; 3]) -> [u32; 3] {
        match self {
            Blend::Own => nodes.map(|n| n.test_points[0]),
            Blend::Shared | Blend::Wide => nodes[0].test_points,
        }
    }

    /// Goes over from the element with the nodes `before` to that with the nodes `now`; whether what was looked up for the first
    /// is the second's too.
    #[inline(always)]
    pub fn change_element(&mut self, before: [&Node; 3], now: [&Node; 3]) -> bool {
        let was = *self;
        *self = Blend::of(now);
        was == Blend::Shared && *self == Blend::Shared && was.points(before) == self.points(now)
    }

    /// Weights of the [`Blend::points`] at area coordinates `n`; linear in `n`.
    #[inline]
    pub fn weights(self, nodes: [&Node; 3], n: [f64; 3]) -> [f64; 3] {
        match self {
            Blend::Own => n,
            Blend::Shared | Blend::Wide => {
                let [a, b, c] = nodes.map(|n| n.weights);
                from_fn(|j| n[0] * a[j] + n[1] * b[j] + n[2] * c[j])
            }
        }
    }
}

/// A kind of force law; a value holds what one evaluation leaves besides its [`Evaluation`].
pub(crate) trait ForceLaw: Copy + Default {
    /// Whether f_t lies along δ_t.
    const ISOTROPIC: bool;
    /// Whether slip searches follow both directions of the plane from the first iterate on.
    const COUPLED: bool = false;
    /// The coefficients of an element's test points.
    type Element<'a>: Copy;
    /// Energies of single test points.
    type Energies<'a>: PointEnergies;

    /// Of an element. `intervals` of the knots are likely to hold the deflections: what is read of them need not wait for these.
    fn element<'a>(
        model: &'a ContactModel,
        element: u32,
        nodes: [&'a Node; 3],
        intervals: [u32; 2],
    ) -> Self::Element<'a>;

    /// The intervals that held the last deflections.
    fn intervals(coefficients: &Self::Element<'_>) -> [u32; 2];

    /// Of another one: `nodes` are those before and now.
    fn change_element<'a>(
        coefficients: &mut Self::Element<'a>,
        model: &'a ContactModel,
        element: u32,
        nodes: [[&'a Node; 3]; 2],
    );

    /// The law at a deflection; `n` blends the nodes.
    fn read<'a>(
        coefficients: &mut Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        n: [f64; 3],
        at: &Deflection,
    ) -> (Self, Reading);

    /// The lateral curve's argument, m: δr, or ρ on an anisotropic body.
    fn rho(&self, f: &Evaluation) -> f64;

    /// δ_t, m.
    fn deflection(&self, f: &Evaluation) -> DVec3;

    /// δ_t·v.
    fn along_deflection(&self, f: &Evaluation, v: DVec3) -> f64;

    /// û·p, N: the component of ∂W/∂δ_t along û.
    fn normal_coupling(&self, coefficients: &Self::Element<'_>, n: [f64; 3], f: &Evaluation) -> f64;

    /// ∂W/∂n_l at a held deflection, J: what the nodes' own coefficients make of W.
    fn node_energies(
        &self,
        coefficients: &Self::Element<'_>,
        model: &ContactModel,
        nodes: [&Node; 3],
        f: &Evaluation,
    ) -> [f64; 3];

    /// The energies of single test points.
    fn energies<'a>(
        &self,
        coefficients: &Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&Node; 3],
        f: &Evaluation,
    ) -> Self::Energies<'a>;

    /// The most that |Σ n_l ∇̄W_l|, of the nodes with these numbers, can be, N; not a number where there is no such bound.
    fn greatest_gradient(
        &self,
        coefficients: &Self::Element<'_>,
        gradients: &Gradients,
        nodes: [u32; 3],
        f: &Evaluation,
    ) -> f64;

    /// What ∂W/∂n_l has besides energies of test points: h d·A_l d, as (d, h); `None` if nothing.
    fn tensor_gradient(&self, f: &Evaluation) -> Option<(DVec3, f64)>;

    /// How f_t, f_z and the limit change; see [`Drift`].
    fn drift<'a>(
        &self,
        coefficients: &mut Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        f: &Evaluation,
        change: &Change,
    ) -> Drift;

    /// Direction that the implicit step takes for f_t, a unit vector.
    fn implicit_direction(&self, f: &Evaluation) -> DVec3;

    /// The same for another drive, of which f_t is the part that changes as c moves.
    fn implicit_drive_direction(
        coefficients: &Self::Element<'_>,
        n: [f64; 3],
        f: &Evaluation,
        drive: &Drive,
    ) -> DVec3;

    /// How much less f_t falls along `old` than along `new`, or more.
    fn slope_ratio(coefficients: &Self::Element<'_>, n: [f64; 3], old: DVec3, new: DVec3) -> f64;

    /// How the tool moves with a contact point that slips under it, as friction counts it, for drives at right angles to `normal`;
    /// `None`: as the contact point does. `above` is R − δz, m.
    #[inline(always)]
    fn tool_motion(
        _coefficients: &Self::Element<'_>,
        _model: &ContactModel,
        _nodes: [&Node; 3],
        _n: [f64; 3],
        _normal: DVec3,
        [_above, _radius]: [f64; 2],
    ) -> Option<ToolMotion> {
        None
    }
}

/// See [`palpate_body::law::tool_motion`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct ToolMotion {
    /// M.
    pub tensor: Symmetric<f64>,
    /// Between these lie its eigenvalues; the first is 1 at most, the second at least.
    pub bounds: [f64; 2],
}

impl ToolMotion {
    /// M v.
    #[inline(always)]
    pub fn moved(&self, v: DVec3) -> DVec3 {
        DVec3::from_array(moved(&self.tensor, v.to_array()))
    }

    /// Its direction.
    #[inline(always)]
    pub fn direction(&self, v: DVec3) -> DVec3 {
        self.moved(v).normalize_or_zero()
    }

    /// M⁻¹.
    #[inline(always)]
    pub fn inverse(&self) -> Self {
        let [least, most] = self.bounds;
        ToolMotion { tensor: inverse(self.tensor), bounds: [1.0 / most, 1.0 / least] }
    }
}
