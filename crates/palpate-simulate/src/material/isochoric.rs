//! Laws W(Ī₁, Ī₂) of the invariants at unit volume, Ī₁ = J^(−2/3) I₁ and Ī₂ = J^(−4/3) I₂, all of them linear in Ī₂.
//!
//! With C = cof F, G = ∂I₂/∂F and F× = ∂²J/∂F²:
//!
//! ∂Ī₁ = 2 J^(−2/3) F − ⅔ Ī₁/J C,
//! ∂²Ī₁ = 2 J^(−2/3) 𝟙 − 4/3 J^(−5/3) (F⊗C + C⊗F) + 10/9 Ī₁/J² C⊗C − ⅔ Ī₁/J F×,
//! ∂Ī₂ = J^(−4/3) G − 4/3 Ī₂/J C,
//! ∂²Ī₂ = J^(−4/3) ∂²I₂ − 4/3 J^(−7/3) (G⊗C + C⊗G) + 28/9 Ī₂/J² C⊗C − 4/3 Ī₂/J F×.

use super::{
    Density, Tensor,
    tensor::{
        Invariants, add_cubic, add_curvature_of_determinant, add_identity, add_two_products, cofactor,
        green_lagrange, left, product, right, set_two_products,
    },
};

/// W and its derivatives by Ī₁ and Ī₂.
pub(super) struct Slopes {
    pub energy: f64,
    pub first: f64,
    pub first_twice: f64,
    pub second: f64,
}

/// A law of the two invariants.
pub(super) trait Law {
    /// Whether Ī₂ matters.
    const SECOND: bool;
    /// Of Ī₁ − 3 and Ī₂ − 3 (0 if it doesn't matter).
    fn slopes(&self, first: f64, second: f64) -> Slopes;
}

/// J^(−2/3), J, Ī₁ − 3 and Ī₂ − 3.
struct Reduced {
    power: f64,
    volume: f64,
    first: f64,
    second: f64,
}

impl Reduced {
    fn of<L: Law>(f: &Tensor) -> Self {
        let Invariants { i1, j } = Invariants::of(f);
        // J^(−2/3) − 1
        let shrink = libm::expm1(-2.0 / 3.0 * libm::log1p(j));
        let power = 1.0 + shrink;
        let second = if L::SECOND {
            // I₂ − 3 of FᵀF = 1 + 2E, whose trace is 3 + i1.
            let norm: f64 = green_lagrange(f).iter().map(|e| e * e).sum();
            let i2 = 2.0 * i1 + (0.5 * i1 * i1 - 2.0 * norm);
            3.0 * shrink * (2.0 + shrink) + power * power * i2
        } else {
            0.0
        };
        Reduced { power, volume: 1.0 + j, first: 3.0 * shrink + power * i1, second }
    }
}

pub(super) fn energy<L: Law>(law: &L, f: &Tensor) -> f64 {
    let reduced = Reduced::of::<L>(f);
    law.slopes(reduced.first, reduced.second).energy
}

pub(super) fn stress<L: Law>(law: &L, f: &Tensor) -> (f64, Tensor) {
    let cof = cofactor(f);
    let Reduced { power, volume, first, second } = Reduced::of::<L>(f);
    let slopes = law.slopes(first, second);
    let (on_f, mut on_cof) = (2.0 * power * slopes.first, -2.0 / 3.0 * (3.0 + first) / volume * slopes.first);
    let mut stress = [0.0; 9];
    if L::SECOND {
        on_cof -= 4.0 / 3.0 * (3.0 + second) / volume * slopes.second;
        let g = second_gradient(f, &right(f));
        let on_g = power * power * slopes.second;
        for r in 0..9 {
            stress[r] = on_f * f[r] + on_cof * cof[r] + on_g * g[r];
        }
    } else {
        for r in 0..9 {
            stress[r] = on_f * f[r] + on_cof * cof[r];
        }
    }
    (slopes.energy, stress)
}

pub(super) fn tangent<L: Law>(law: &L, f: &Tensor, out: &mut Density) {
    let cof = cofactor(f);
    let Reduced { power, volume, first, second } = Reduced::of::<L>(f);
    let slopes = law.slopes(first, second);
    let inverse = 1.0 / volume;

    // ∂Ī₁ = x F + y C
    let (x, y) = (2.0 * power, -2.0 / 3.0 * (3.0 + first) * inverse);
    let (on_f, mut on_cof) = (x * slopes.first, y * slopes.first);
    let mut ff = slopes.first_twice * x * x;
    let fc = slopes.first_twice * x * y - 2.0 / 3.0 * x * inverse * slopes.first;
    let mut cc = slopes.first_twice * y * y - 5.0 / 3.0 * y * inverse * slopes.first;
    let mut one = x * slopes.first;

    let q = power * power * slopes.second;
    let z = -4.0 / 3.0 * (3.0 + second) * inverse * slopes.second;
    if L::SECOND {
        ff += 4.0 * q;
        cc -= 7.0 / 3.0 * z * inverse;
        on_cof += z;
    }
    let (mut u, mut v) = ([0.0; 9], [0.0; 9]);
    for r in 0..9 {
        out.stress[r] = on_f * f[r] + on_cof * cof[r];
        u[r] = ff * f[r] + fc * cof[r];
        v[r] = fc * f[r] + cc * cof[r];
    }
    set_two_products(&mut out.tangent, f, &u, &cof, &v);
    if L::SECOND {
        let right = right(f);
        let g = second_gradient(f, &right);
        let gc = -4.0 / 3.0 * inverse * q;
        let (mut u, mut v) = ([0.0; 9], [0.0; 9]);
        for r in 0..9 {
            out.stress[r] += q * g[r];
            u[r] = gc * cof[r];
            v[r] = gc * g[r];
        }
        add_two_products(&mut out.tangent, &g, &u, &cof, &v);
        add_cubic(&mut out.tangent, f, (-2.0 * q, &right), (-2.0 * q, &left(f)));
        one += 2.0 * q * (right[0] + right[4] + right[8]);
    }
    add_curvature_of_determinant(&mut out.tangent, f, on_cof);
    add_identity(&mut out.tangent, one);
    out.energy = slopes.energy;
}

/// G = ∂I₂/∂F = 2 (I₁ F − F FᵀF)
fn second_gradient(f: &Tensor, right: &Tensor) -> Tensor {
    let i1 = right[0] + right[4] + right[8];
    let mut g = product(f, right);
    for r in 0..9 {
        g[r] = 2.0 * (i1 * f[r] - g[r]);
    }
    g
}

/// μ/2 (Ī₁ − 3)
pub(super) struct NeoHookean {
    pub mu_pa: f64,
}

impl Law for NeoHookean {
    const SECOND: bool = false;
    fn slopes(&self, first: f64, _: f64) -> Slopes {
        let half = 0.5 * self.mu_pa;
        Slopes { energy: half * first, first: half, first_twice: 0.0, second: 0.0 }
    }
}

/// C₁₀ (Ī₁ − 3) + C₀₁ (Ī₂ − 3)
pub(super) struct MooneyRivlin {
    pub c10_pa: f64,
    pub c01_pa: f64,
}

impl Law for MooneyRivlin {
    const SECOND: bool = true;
    fn slopes(&self, first: f64, second: f64) -> Slopes {
        Slopes {
            energy: self.c10_pa * first + self.c01_pa * second,
            first: self.c10_pa,
            first_twice: 0.0,
            second: self.c01_pa,
        }
    }
}

/// Σ c_i (Ī₁ − 3)^i, i from 1.
pub(super) struct Yeoh<'a> {
    pub c_pa: &'a [f64],
}

impl Law for Yeoh<'_> {
    const SECOND: bool = false;
    fn slopes(&self, first: f64, _: f64) -> Slopes {
        // Horner's scheme for a polynomial and its derivatives.
        let (mut w, mut slope, mut half_curvature) = (0.0, 0.0, 0.0);
        for c in self.c_pa.iter().rev().chain(&[0.0]) {
            half_curvature = half_curvature * first + slope;
            slope = slope * first + w;
            w = w * first + c;
        }
        Slopes { energy: w, first: slope, first_twice: 2.0 * half_curvature, second: 0.0 }
    }
}

/// μ/(2b) (e^{b (Ī₁ − 3)} − 1)
pub(super) struct FungDemiray {
    pub mu_pa: f64,
    pub b: f64,
}

impl Law for FungDemiray {
    const SECOND: bool = false;
    fn slopes(&self, first: f64, _: f64) -> Slopes {
        let grown = libm::expm1(self.b * first);
        let slope = 0.5 * self.mu_pa * (1.0 + grown);
        Slopes {
            energy: 0.5 * self.mu_pa / self.b * grown,
            first: slope,
            first_twice: self.b * slope,
            second: 0.0,
        }
    }
}

/// C₁ (e^{C₃ (Ī₁ − 3)} − 1) − C₁C₃/2 (Ī₂ − 3)
pub(super) struct VerondaWestmann {
    pub c1_pa: f64,
    pub c3: f64,
}

impl Law for VerondaWestmann {
    const SECOND: bool = true;
    fn slopes(&self, first: f64, second: f64) -> Slopes {
        let grown = libm::expm1(self.c3 * first);
        let scale = self.c1_pa * self.c3;
        Slopes {
            energy: self.c1_pa * grown - 0.5 * scale * second,
            first: scale * (1.0 + grown),
            first_twice: self.c3 * scale * (1.0 + grown),
            second: -0.5 * scale,
        }
    }
}
