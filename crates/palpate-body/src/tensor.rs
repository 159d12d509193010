//! The lateral tensor of a node: how stiffness laterally depends on the direction (MODEL 7, anisotropic lateral
//! response).
//!
//! A tensor A is symmetric, in the body's frame, as [xx, yy, zz, xy, xz, yz]. The lateral curve is asked at
//! ρ = √(δ_t·A δ_t) instead of δr, so that A's eigenvalues in the tangent plane are the directions' shares of the
//! lateral stiffness. Their mean is 1 (the stiffness itself is the curve's), and A u = u along the node's inward
//! normal: what A does there has no meaning, and the identity, an isotropic node, stays one. No basis of the tangent
//! plane is needed, so no seam comes about where bases of neighbours would differ.

use glam::{DMat3, DVec3};

/// A symmetric tensor in the body's frame: [xx, yy, zz, xy, xz, yz].
pub type Tensor = [f64; 6];

/// The tensor of an isotropic node.
pub const IDENTITY: Tensor = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0];

/// The stiffest direction may be this many times as stiff as the softest.
pub const MAX_RATIO: f64 = 100.0;

/// How far a [`Tensor`] may be from A u = u and a mean of 1: rounding, no more.
const EXACT: f64 = 1e-9;

/// A v.
///
/// # Real-time
/// O(1), never panics.
#[inline]
pub fn apply([xx, yy, zz, xy, xz, yz]: &Tensor, v: DVec3) -> DVec3 {
    DVec3::new(xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z, xz * v.x + yz * v.y + zz * v.z)
}

/// How a tensor acts in the tangent plane of a unit normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Principal {
    /// Eigenvalues, the greater first: how many times the mean stiffness each direction has.
    pub values: [f64; 2],
    /// Their directions, unit vectors at right angles to the normal and to each other.
    pub axes: [DVec3; 2],
}

impl Principal {
    /// Of the part of `tensor` in the plane at right angles to the unit vector `u`.
    pub fn of(tensor: &Tensor, u: DVec3) -> Self {
        let u = u.normalize();
        let (p, q) = u.any_orthonormal_pair();
        let (pp, qq, pq) = (p.dot(apply(tensor, p)), q.dot(apply(tensor, q)), p.dot(apply(tensor, q)));
        let (mean, half) = (0.5 * (pp + qq), 0.5 * (pp - qq));
        let spread = (half * half + pq * pq).sqrt();
        // The half angle of (half, pq), by the larger of its two forms.
        let (x, y) =
            if half >= 0.0 { (spread + half, pq) } else { (pq.abs(), (spread - half) * pq.signum()) };
        let first = (p * x + q * y).normalize_or(p);
        Principal { values: [mean + spread, mean - spread], axes: [first, u.cross(first)] }
    }

    /// How many times as stiff the stiffest direction is as the softest, ≥ 1.
    pub fn ratio(&self) -> f64 {
        self.values[0] / self.values[1]
    }

    /// The normalised [`Tensor`] that acts in the tangent plane like this, up to a factor.
    fn tensor(&self) -> Tensor {
        let [a, b] = self.axes;
        let per = 2.0 / (self.values[0] + self.values[1]);
        // 1 + Σ (λ − 1) a aᵀ: the identity to the bit where both are 1.
        let part = |axis: DVec3, value: f64| {
            let s = axis * (value * per - 1.0);
            DMat3::from_cols(s * axis.x, s * axis.y, s * axis.z)
        };
        let m = DMat3::IDENTITY + part(a, self.values[0]) + part(b, self.values[1]);
        [m.x_axis.x, m.y_axis.y, m.z_axis.z, m.y_axis.x, m.z_axis.x, m.z_axis.y]
    }
}

/// The tensor of a node with inward unit normal `u` whose lateral stiffnesses are in proportion to `stiffness`, a
/// symmetric matrix in the body's frame of any size (N/m, or without unit): its part in the tangent plane,
/// normalised. `None` if that is not positive definite, not finite, or beyond [`MAX_RATIO`].
pub fn from_stiffness(stiffness: &Tensor, u: DVec3) -> Option<Tensor> {
    let principal = Principal::of(stiffness, u);
    acceptable(&principal).then(|| principal.tensor())
}

/// The tensor of a node with inward unit normal `u` that is `ratio` (> 0) times as stiff along `axis`, as far as that
/// lies in the tangent plane, as across. `None` for an axis along the normal, or a ratio that no body may have.
pub fn along(axis: DVec3, ratio: f64, u: DVec3) -> Option<Tensor> {
    let u = u.normalize();
    let axis = (axis - u * axis.dot(u)).try_normalize()?;
    let principal = Principal { values: [ratio, 1.0], axes: [axis, u.cross(axis)] };
    acceptable(&principal).then(|| principal.tensor())
}

/// In either order.
fn acceptable(p: &Principal) -> bool {
    let [a, b] = p.values;
    let (low, high) = (a.min(b), a.max(b));
    a.is_finite() && b.is_finite() && low > 0.0 && high <= MAX_RATIO * (1.0 + EXACT) * low
}

/// What a node's tensor must be; problem and hint where it is not.
pub(crate) fn check(tensor: &Tensor, u: DVec3) -> Result<(), (String, &'static str)> {
    const AGAIN: &str = "make it with `tensor::from_stiffness`, or the body again";
    if !tensor.iter().all(|x| x.abs() <= 2.0 * MAX_RATIO) {
        return Err((format!("its lateral tensor {tensor:?} is not finite, or far too large"), AGAIN));
    }
    let u = u.normalize();
    let off = (apply(tensor, u) - u).length();
    if off > EXACT {
        return Err((format!("its lateral tensor acts on the normal: A u is {off:.1e} away from u"), AGAIN));
    }
    let principal = Principal::of(tensor, u);
    let [high, low] = principal.values;
    if !acceptable(&principal) {
        let problem = format!(
            "its lateral tensor has the eigenvalues {high} and {low} in the tangent plane, where positive ones within \
             a factor of {MAX_RATIO} belong"
        );
        return Err((problem, AGAIN));
    }
    if (0.5 * (high + low) - 1.0).abs() > EXACT {
        return Err((
            format!("the eigenvalues {high} and {low} of its lateral tensor have not the mean 1"),
            AGAIN,
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tensors_are_what_they_were_made_from() {
        let mut x = 1u64;
        let mut unit = || {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (x >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        for _ in 0..2000 {
            let u = DVec3::new(unit(), unit(), unit()).normalize();
            let axis = DVec3::new(unit(), unit(), unit());
            let ratio = 10f64.powf(3.9 * unit());
            let a = along(axis, ratio, u).unwrap();
            check(&a, u).unwrap();
            let t = (axis - u * axis.dot(u)).normalize();
            let stiffness = |v: DVec3| v.dot(apply(&a, v));
            assert!((stiffness(t) / stiffness(u.cross(t)) / ratio - 1.0).abs() < 1e-11);
            let principal = Principal::of(&a, u);
            assert!((principal.ratio() / ratio.max(1.0 / ratio) - 1.0).abs() < 1e-11);
            for (value, axis) in principal.values.into_iter().zip(principal.axes) {
                assert!((apply(&a, axis) - axis * value).length() < 1e-13);
            }
            // Whatever it does to the normal, and however large it is.
            let (k, w) = (700.0, DVec3::new(unit(), unit(), unit()));
            let outer = |a: DVec3, b: DVec3| {
                [2.0 * a.x * b.x, 2.0 * a.y * b.y, 2.0 * a.z * b.z, a.x * b.y + a.y * b.x]
                    .into_iter()
                    .chain([a.x * b.z + a.z * b.x, a.y * b.z + a.z * b.y])
                    .collect::<Vec<_>>()
            };
            let disturbed: Vec<f64> = a.iter().zip(outer(u, w)).map(|(a, o)| k * (a + o)).collect();
            let again = from_stiffness(&disturbed.try_into().unwrap(), u).unwrap();
            assert!(a.iter().zip(again).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {again:?}");
        }
    }

    #[test]
    fn the_identity_stays_the_identity() {
        for u in [DVec3::X, DVec3::NEG_Z, DVec3::new(0.48, 0.6, 0.64)] {
            assert_eq!(along(DVec3::new(1.0, 2.0, -0.5), 1.0, u), Some(IDENTITY));
            check(&IDENTITY, u).unwrap();
            assert_eq!(Principal::of(&IDENTITY, DVec3::Z).values, [1.0; 2]);
        }
    }

    #[test]
    fn what_is_no_stiffness_is_refused() {
        let u = DVec3::Z;
        assert_eq!(along(u, 2.0, u), None);
        for ratio in [0.0, -1.0, 101.0, 1e-3, f64::NAN, f64::INFINITY] {
            assert_eq!(along(DVec3::X, ratio, u), None, "{ratio}");
        }
        assert_eq!(from_stiffness(&[1.0, 1.0, 1.0, 1.5, 0.0, 0.0], u), None);
        assert_eq!(from_stiffness(&[0.0; 6], u), None);
        let refused = |a: Tensor, words: &str| {
            let (problem, _) = check(&a, u).unwrap_err();
            assert!(problem.contains(words), "{problem}");
        };
        refused([1.0, f64::NAN, 1.0, 0.0, 0.0, 0.0], "not finite");
        refused([1.0, 1.0, 1.1, 0.0, 0.0, 0.0], "acts on the normal");
        refused([1.0, 1.0, 1.0, 0.0, 1e-6, 0.0], "acts on the normal");
        refused([1.0, 1.0, 1.0, 1.0, 0.0, 0.0], "positive");
        refused([1.995, 0.005, 1.0, 0.0, 0.0, 0.0], "factor of 100");
        refused([1.5, 1.5, 1.0, 0.0, 0.0, 0.0], "mean 1");
    }
}
