//! What a force law answers to the step (MODEL 2 and 7; LAW 2). The step is compiled once for each kind of law; what comes
//! after the law asks for W, its gradient and its changes, and knows none of them.

use crate::drive::Drive;
use crate::field::{Change, Deflection, Drift, Field, Reading};
use glam::DVec3;
use palpate_body::{ContactModel, Gradients, Node, PointEnergies};
use std::array::from_fn;

/// Below this the lateral deflection is rounding, and its direction noise, m.
pub(crate) const NO_DIRECTION: f64 = 1e-12;

/// Whose responses an element mixes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mix {
    /// Each node is its own test point.
    Own,
    /// All nodes mix the same three test points.
    Shared,
    /// Up to nine test points: where the element lies across the triangles of test points.
    Wide,
}

impl Mix {
    #[inline]
    pub fn of([a, b, c]: [&Node; 3]) -> Self {
        if a.weights[0] == 1.0 && b.weights[0] == 1.0 && c.weights[0] == 1.0 {
            Mix::Own
        } else if a.test_points == b.test_points && a.test_points == c.test_points {
            Mix::Shared
        } else {
            Mix::Wide
        }
    }

    #[inline]
    pub fn points(self, nodes: [&Node; 3]) -> [u32; 3] {
        match self {
            Mix::Own => nodes.map(|n| n.test_points[0]),
            Mix::Shared | Mix::Wide => nodes[0].test_points,
        }
    }

    /// Weights of the [`Mix::points`] at area coordinates `n`; linear in `n`.
    #[inline]
    pub fn weights(self, nodes: [&Node; 3], n: [f64; 3]) -> [f64; 3] {
        match self {
            Mix::Own => n,
            Mix::Shared | Mix::Wide => {
                let [a, b, c] = nodes.map(|n| n.weights);
                from_fn(|j| n[0] * a[j] + n[1] * b[j] + n[2] * c[j])
            }
        }
    }
}

/// A kind of force law; a value is what one evaluation knows of it besides its [`Field`].
pub(crate) trait Lateral: Copy + Default {
    /// Whether f_t lies along δ_t.
    const ISOTROPIC: bool;
    /// Whether slip searches follow both directions of the plane from the first iterate on.
    const COUPLED: bool = false;
    /// The coefficients of an element's test points.
    type Element<'a>: Copy;
    /// Energies of single test points.
    type Energies<'a>: PointEnergies;

    /// Of an element.
    fn element<'a>(model: &'a ContactModel, element: u32, nodes: [&'a Node; 3]) -> Self::Element<'a>;

    /// Of another one: `nodes` are those before and now.
    fn go_over<'a>(
        coefficients: &mut Self::Element<'a>,
        model: &'a ContactModel,
        element: u32,
        nodes: [[&'a Node; 3]; 2],
    );

    /// The law at a deflection; `n` mixes the nodes.
    fn read<'a>(
        coefficients: &mut Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        n: [f64; 3],
        at: &Deflection,
    ) -> (Self, Reading);

    /// What the lateral response is asked at, m: δr, or ρ on an anisotropic body.
    fn rho(&self, f: &Field) -> f64;

    /// δ_t, m.
    fn deflection(&self, f: &Field) -> DVec3;

    /// δ_t·v.
    fn along_deflection(&self, f: &Field, v: DVec3) -> f64;

    /// û·p, N: what ∂W/∂δ_t has along û.
    fn beside(&self, coefficients: &Self::Element<'_>, n: [f64; 3], f: &Field) -> f64;

    /// ∂W/∂n_l at a held deflection, J: what the nodes' own coefficients make of W.
    fn node_energies(
        &self,
        coefficients: &Self::Element<'_>,
        model: &ContactModel,
        nodes: [&Node; 3],
        f: &Field,
    ) -> [f64; 3];

    /// The energies of single test points.
    fn energies<'a>(
        &self,
        coefficients: &Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&Node; 3],
        f: &Field,
    ) -> Self::Energies<'a>;

    /// The most that |Σ n_l ∇̄W_l|, of the nodes with these numbers, can be, N; not a number where there is no such bound.
    fn greatest_gradient(
        &self,
        coefficients: &Self::Element<'_>,
        gradients: &Gradients,
        nodes: [u32; 3],
        f: &Field,
    ) -> f64;

    /// What ∂W/∂n_l has besides energies of test points: h d·A_l d, as (d, h); `None` if nothing.
    fn tensor_gradient(&self, f: &Field) -> Option<(DVec3, f64)>;

    /// How f_t, f_z and the limit change; see [`Drift`].
    fn drift<'a>(
        &self,
        coefficients: &mut Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        f: &Field,
        change: &Change,
    ) -> Drift;

    /// Which way f_t leads, a unit vector.
    fn aim(&self, f: &Field) -> DVec3;

    /// Which way another drive leads, of which f_t is the part that changes as c moves.
    fn lead(coefficients: &Self::Element<'_>, n: [f64; 3], f: &Field, drive: &Drive) -> DVec3;

    /// How much less f_t falls along `old` than along `new`, or more.
    fn turned(coefficients: &Self::Element<'_>, n: [f64; 3], old: DVec3, new: DVec3) -> f64;
}
