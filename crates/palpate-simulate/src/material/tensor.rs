//! What the laws need of a deformation gradient F, and the pieces their tangents are made of.

use super::Tensor;

/// Invariants of F less their values at rest, from H = F − 1: without the digits that I₁ − 3 or ln J, computed from F,
/// would lose at small strain.
#[derive(Clone, Copy)]
pub(super) struct Invariants {
    /// F : F − 3
    pub i1: f64,
    /// det F − 1
    pub j: f64,
}

impl Invariants {
    pub fn of(f: &Tensor) -> Self {
        let h = displacement_gradient(f);
        let trace = h[0] + h[4] + h[8];
        let mut norm = 0.0;
        for x in h {
            norm += x * x;
        }
        let minors = (h[0] * h[4] - h[1] * h[3]) + (h[4] * h[8] - h[5] * h[7]) + (h[0] * h[8] - h[2] * h[6]);
        Invariants { i1: 2.0 * trace + norm, j: trace + (minors + determinant(&h)) }
    }
}

/// H = F − 1
pub(super) fn displacement_gradient(f: &Tensor) -> Tensor {
    let mut h = *f;
    h[0] -= 1.0;
    h[4] -= 1.0;
    h[8] -= 1.0;
    h
}

/// cof F = ∂ det F / ∂F
pub(super) fn cofactor(f: &Tensor) -> Tensor {
    [
        f[4] * f[8] - f[5] * f[7],
        f[5] * f[6] - f[3] * f[8],
        f[3] * f[7] - f[4] * f[6],
        f[7] * f[2] - f[8] * f[1],
        f[8] * f[0] - f[6] * f[2],
        f[6] * f[1] - f[7] * f[0],
        f[1] * f[5] - f[2] * f[4],
        f[2] * f[3] - f[0] * f[5],
        f[0] * f[4] - f[1] * f[3],
    ]
}

pub(super) fn determinant(f: &Tensor) -> f64 {
    f[0] * (f[4] * f[8] - f[5] * f[7])
        + f[1] * (f[5] * f[6] - f[3] * f[8])
        + f[2] * (f[3] * f[7] - f[4] * f[6])
}

/// FᵀF
pub(super) fn right(f: &Tensor) -> Tensor {
    let dot = |a: usize, b: usize| f[a] * f[b] + f[3 + a] * f[3 + b] + f[6 + a] * f[6 + b];
    let (xy, yz, zx) = (dot(0, 1), dot(1, 2), dot(2, 0));
    [dot(0, 0), xy, zx, xy, dot(1, 1), yz, zx, yz, dot(2, 2)]
}

/// FFᵀ
pub(super) fn left(f: &Tensor) -> Tensor {
    let dot =
        |a: usize, b: usize| f[3 * a] * f[3 * b] + f[3 * a + 1] * f[3 * b + 1] + f[3 * a + 2] * f[3 * b + 2];
    let (xy, yz, zx) = (dot(0, 1), dot(1, 2), dot(2, 0));
    [dot(0, 0), xy, zx, xy, dot(1, 1), yz, zx, yz, dot(2, 2)]
}

/// A B
pub(super) fn product(a: &Tensor, b: &Tensor) -> Tensor {
    let mut c = [0.0; 9];
    for i in 0..3 {
        for j in 0..3 {
            c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
        }
    }
    c
}

/// E = ½ (FᵀF − 1) = ½ (H + Hᵀ + HᵀH)
pub(super) fn green_lagrange(f: &Tensor) -> Tensor {
    let h = displacement_gradient(f);
    let mut e = right(&h);
    for i in 0..3 {
        for j in 0..3 {
            e[3 * i + j] = 0.5 * (h[3 * i + j] + h[3 * j + i] + e[3 * i + j]);
        }
    }
    e
}

/// tangent = a ⊗ u
pub(super) fn set_product(tangent: &mut [f64; 81], a: &Tensor, u: &Tensor) {
    for r in 0..9 {
        for c in 0..9 {
            tangent[9 * r + c] = a[r] * u[c];
        }
    }
}

/// tangent = a ⊗ u + b ⊗ v
pub(super) fn set_two_products(tangent: &mut [f64; 81], a: &Tensor, u: &Tensor, b: &Tensor, v: &Tensor) {
    for r in 0..9 {
        for c in 0..9 {
            tangent[9 * r + c] = a[r] * u[c] + b[r] * v[c];
        }
    }
}

/// tangent += a ⊗ u + b ⊗ v
pub(super) fn add_two_products(tangent: &mut [f64; 81], a: &Tensor, u: &Tensor, b: &Tensor, v: &Tensor) {
    for r in 0..9 {
        for c in 0..9 {
            tangent[9 * r + c] += a[r] * u[c] + b[r] * v[c];
        }
    }
}

/// tangent += s 𝟙
pub(super) fn add_identity(tangent: &mut [f64; 81], s: f64) {
    for r in 0..9 {
        tangent[10 * r] += s;
    }
}

/// tangent += s ∂² det F / ∂F², whose entry (iJ, kL) is ε_ikm ε_JLN F_mN.
pub(super) fn add_curvature_of_determinant(tangent: &mut [f64; 81], f: &Tensor, s: f64) {
    for (i, k, m) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
        let [x, y, z] = [s * f[3 * m], s * f[3 * m + 1], s * f[3 * m + 2]];
        // Row iJ, columns k0 to k2; and, its negative, row kJ, columns i0 to i2.
        let (ik, ki) = (27 * i + 3 * k, 27 * k + 3 * i);
        tangent[ik + 1] += z;
        tangent[ik + 2] -= y;
        tangent[ik + 9] -= z;
        tangent[ik + 11] += x;
        tangent[ik + 18] += y;
        tangent[ik + 19] -= x;
        tangent[ki + 1] -= z;
        tangent[ki + 2] += y;
        tangent[ki + 9] += z;
        tangent[ki + 11] -= x;
        tangent[ki + 18] -= y;
        tangent[ki + 19] += x;
    }
}

/// tangent += s δ_ik S_JL + t (F_iL F_kJ + B_ik δ_JL), B = FFᵀ: what F S(FᵀF) differentiates to, by entry (iJ, kL).
pub(super) fn add_cubic(
    tangent: &mut [f64; 81],
    f: &Tensor,
    (s, symmetric): (f64, &Tensor),
    (t, left): (f64, &Tensor),
) {
    for i in 0..3 {
        for j in 0..3 {
            for k in 0..3 {
                for l in 0..3 {
                    tangent[9 * (3 * i + j) + 3 * k + l] += t * f[3 * i + l] * f[3 * k + j];
                }
                tangent[9 * (3 * i + j) + 3 * k + j] += t * left[3 * i + k];
            }
            for l in 0..3 {
                tangent[9 * (3 * i + j) + 3 * i + l] += s * symmetric[3 * j + l];
            }
        }
    }
}
