//! Ogden's law, Σ_p 2μ_p/α_p² (Σ_a λ̄_a^α_p − 3), in principal stretches.
//!
//! With F = Σ λ_a n_a ⊗ N_a, the stress is Σ τ_a/λ_a n_a ⊗ N_a, and the tangent is known in the basis n_a ⊗ N_b: the
//! three stretches are coupled by ∂²ψ/∂λ_a∂λ_b, and in each plane ab symmetric changes meet (ψ_a − ψ_b)/(λ_a − λ_b),
//! antisymmetric ones (ψ_a + ψ_b)/(λ_a + λ_b) (Smith, De Goes and Kim, "Analytic eigensystems for isotropic distortion
//! energies", ACM Trans. Graph. 38, 2019).

use super::{
    Density, Tensor,
    tensor::{determinant, green_lagrange, product},
};

/// Principal stretches of F.
struct Principal {
    /// λ_a
    stretch: [f64; 3],
    /// ln λ_a less their mean, ln J/3.
    log: [f64; 3],
    /// N_a, as columns.
    right: Tensor,
}

impl Principal {
    fn of(f: &Tensor) -> Self {
        // The stretches come from E, so that small ones keep their digits.
        let (strain, right) = eigen(green_lagrange(f));
        // FᵀF doesn't tell a body from its mirror image.
        let sound = if determinant(f) > 0.0 { 1.0 } else { f64::NAN };
        let log = strain.map(|e| sound * 0.5 * libm::log1p(2.0 * e));
        let mean = (log[0] + log[1] + log[2]) / 3.0;
        Principal { stretch: strain.map(|e| (1.0 + 2.0 * e).sqrt()), log: log.map(|l| l - mean), right }
    }
}

/// Eigenvalues of a symmetric tensor, and its eigenvectors as columns: Jacobi's rotations, which give orthogonal vectors
/// however close the values.
fn eigen(mut a: Tensor) -> ([f64; 3], Tensor) {
    let mut v = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    // Converges quadratically; 4 or 5 sweeps do.
    for _ in 0..12 {
        let off = a[1] * a[1] + a[2] * a[2] + a[5] * a[5];
        let scale = a[0] * a[0] + a[4] * a[4] + a[8] * a[8];
        if off <= 1e-36 * scale {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let r = 3 - p - q;
            let apq = a[3 * p + q];
            if apq == 0.0 {
                continue;
            }
            let theta = 0.5 * (a[4 * q] - a[4 * p]) / apq;
            let t = f64::copysign(1.0, theta) / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            a[4 * p] -= t * apq;
            a[4 * q] += t * apq;
            let (apr, aqr) = (a[3 * p + r], a[3 * q + r]);
            let (new_pr, new_qr) = (c * apr - s * aqr, s * apr + c * aqr);
            (a[3 * p + q], a[3 * q + p]) = (0.0, 0.0);
            (a[3 * p + r], a[3 * r + p]) = (new_pr, new_pr);
            (a[3 * q + r], a[3 * r + q]) = (new_qr, new_qr);
            for i in 0..3 {
                let (vp, vq) = (v[3 * i + p], v[3 * i + q]);
                v[3 * i + p] = c * vp - s * vq;
                v[3 * i + q] = s * vp + c * vq;
            }
        }
    }
    ([a[0], a[4], a[8]], v)
}

pub(super) fn energy(terms: &[[f64; 2]], f: &Tensor) -> f64 {
    let Principal { log, .. } = Principal::of(f);
    let mut energy = 0.0;
    for [mu, alpha] in terms {
        let grown = log.map(|l| libm::expm1(alpha * l));
        energy += 2.0 * mu / (alpha * alpha) * (grown[0] + grown[1] + grown[2]);
    }
    energy
}

/// Energy and τ_a = λ_a ∂ψ/∂λ_a.
fn kirchhoff(terms: &[[f64; 2]], log: &[f64; 3]) -> (f64, [f64; 3]) {
    let (mut energy, mut tau) = (0.0, [0.0; 3]);
    for [mu, alpha] in terms {
        let grown = log.map(|l| libm::expm1(alpha * l));
        let sum = grown[0] + grown[1] + grown[2];
        energy += 2.0 * mu / (alpha * alpha) * sum;
        for a in 0..3 {
            tau[a] += 2.0 * mu / alpha * (grown[a] - sum / 3.0);
        }
    }
    (energy, tau)
}

pub(super) fn stress(terms: &[[f64; 2]], f: &Tensor) -> (f64, Tensor) {
    let principal = Principal::of(f);
    let (energy, tau) = kirchhoff(terms, &principal.log);
    // P = F Σ τ_a/λ_a² N_a ⊗ N_a
    let n = &principal.right;
    let mut second = [0.0; 9];
    for a in 0..3 {
        let s = tau[a] / (principal.stretch[a] * principal.stretch[a]);
        for i in 0..3 {
            for j in 0..3 {
                second[3 * i + j] += s * n[3 * i + a] * n[3 * j + a];
            }
        }
    }
    (energy, product(f, &second))
}

pub(super) fn tangent(terms: &[[f64; 2]], f: &Tensor, out: &mut Density) {
    let Principal { stretch, log, right } = Principal::of(f);
    let mut left = product(f, &right);
    for i in 0..3 {
        for a in 0..3 {
            left[3 * i + a] /= stretch[a];
        }
    }

    let (mut energy, mut tau) = (0.0, [0.0; 3]);
    // ∂τ_a/∂ ln λ_b, and (τ_a − τ_b)/(λ_a − λ_b) in the planes 01, 12, 20.
    let (mut stiffness, mut divided) = ([[0.0; 3]; 3], [0.0; 3]);
    for [mu, alpha] in terms {
        let grown = log.map(|l| libm::expm1(alpha * l));
        let sum = grown[0] + grown[1] + grown[2];
        energy += 2.0 * mu / (alpha * alpha) * sum;
        for a in 0..3 {
            let b = (a + 1) % 3;
            tau[a] += 2.0 * mu / alpha * (grown[a] - sum / 3.0);
            for c in 0..3 {
                stiffness[a][c] += 2.0 / 3.0 * mu * (sum / 3.0 - grown[a] - grown[c] - 1.0);
            }
            stiffness[a][a] += 2.0 * mu * (1.0 + grown[a]);
            // λ̄_a^α − λ̄_b^α over λ_a − λ_b, with λ_a = λ_b e^x.
            let x = log[a] - log[b];
            let ratio = if x == 0.0 { *alpha } else { libm::expm1(alpha * x) / libm::expm1(x) };
            divided[a] += 2.0 * mu / alpha * (1.0 + grown[b]) * ratio / stretch[b];
        }
    }
    out.energy = energy;

    // M_ab = n_a ⊗ N_b, and the tangent applied to each.
    let mut basis = [[[0.0; 9]; 3]; 3];
    for a in 0..3 {
        for b in 0..3 {
            for i in 0..3 {
                for j in 0..3 {
                    basis[a][b][3 * i + j] = left[3 * i + a] * right[3 * j + b];
                }
            }
        }
    }
    out.stress = [0.0; 9];
    out.tangent = [0.0; 81];
    for a in 0..3 {
        let mut image = [0.0; 9];
        for b in 0..3 {
            let mut s = stiffness[a][b];
            if a == b {
                s -= tau[a];
            }
            s /= stretch[a] * stretch[b];
            for r in 0..9 {
                image[r] += s * basis[b][b][r];
            }
        }
        for (stress, m) in out.stress.iter_mut().zip(&basis[a][a]) {
            *stress += tau[a] / stretch[a] * m;
        }
        add_product(&mut out.tangent, &basis[a][a], &image);

        let b = (a + 1) % 3;
        let (la, lb) = (stretch[a], stretch[b]);
        let sum = la + lb;
        let symmetric = 0.5 * (sum * divided[a] - (tau[a] + tau[b])) / (la * lb);
        let antisymmetric = (tau[a] / la + tau[b] / lb) / sum;
        let (direct, across) = (0.5 * (symmetric + antisymmetric), 0.5 * (symmetric - antisymmetric));
        let (ab, ba) = (&basis[a][b], &basis[b][a]);
        let (mut u, mut v) = ([0.0; 9], [0.0; 9]);
        for r in 0..9 {
            u[r] = direct * ab[r] + across * ba[r];
            v[r] = across * ab[r] + direct * ba[r];
        }
        add_product(&mut out.tangent, ab, &u);
        add_product(&mut out.tangent, ba, &v);
    }
}

/// tangent += a ⊗ u
fn add_product(tangent: &mut [f64; 81], a: &Tensor, u: &Tensor) {
    for r in 0..9 {
        for c in 0..9 {
            tangent[9 * r + c] += a[r] * u[c];
        }
    }
}
