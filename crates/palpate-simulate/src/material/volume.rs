//! Measures θ of the change of volume, by which the energy ½ K θ² resists it.

use super::{
    Tensor,
    tensor::{
        Invariants, add_curvature_of_determinant, add_identity, cofactor, displacement_gradient, set_product,
    },
};

/// What a law's volumetric energy ½ K θ² is quadratic in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VolumeMeasure {
    /// ln det F
    LnJ,
    /// det F − 1
    JMinusOne,
    /// Trace of the Green–Lagrange strain ½ (FᵀF − 1).
    TraceE,
    /// Trace of F − 1.
    TraceEps,
}

/// θ and its derivatives by F.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Volume {
    /// θ
    pub value: f64,
    /// ∂θ/∂F
    pub gradient: Tensor,
    /// ∂²θ/∂F², row-major 9 × 9, symmetric.
    pub hessian: [f64; 81],
}

impl VolumeMeasure {
    /// θ; not finite where ln det F is not.
    pub fn value(self, f: &Tensor) -> f64 {
        match self {
            VolumeMeasure::LnJ => libm::log1p(Invariants::of(f).j),
            VolumeMeasure::JMinusOne => Invariants::of(f).j,
            VolumeMeasure::TraceE => 0.5 * Invariants::of(f).i1,
            VolumeMeasure::TraceEps => {
                let h = displacement_gradient(f);
                h[0] + h[4] + h[8]
            }
        }
    }

    /// θ and ∂θ/∂F.
    pub fn gradient(self, f: &Tensor) -> (f64, Tensor) {
        match self {
            VolumeMeasure::LnJ => {
                let j = Invariants::of(f).j;
                let inverse = 1.0 / (1.0 + j);
                (libm::log1p(j), cofactor(f).map(|c| inverse * c))
            }
            VolumeMeasure::JMinusOne => (self.value(f), cofactor(f)),
            VolumeMeasure::TraceE => (self.value(f), *f),
            VolumeMeasure::TraceEps => (self.value(f), IDENTITY),
        }
    }

    /// θ, ∂θ/∂F and ∂²θ/∂F².
    pub fn evaluate(self, f: &Tensor) -> Volume {
        let (value, gradient) = self.gradient(f);
        let mut volume = Volume { value, gradient, hessian: [0.0; 81] };
        match self {
            VolumeMeasure::LnJ => {
                set_product(&mut volume.hessian, &gradient, &gradient.map(|g| -g));
                let inverse = 1.0 / (1.0 + Invariants::of(f).j);
                add_curvature_of_determinant(&mut volume.hessian, f, inverse);
            }
            VolumeMeasure::JMinusOne => add_curvature_of_determinant(&mut volume.hessian, f, 1.0),
            VolumeMeasure::TraceE => add_identity(&mut volume.hessian, 1.0),
            VolumeMeasure::TraceEps => {}
        }
        volume
    }
}

const IDENTITY: Tensor = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
