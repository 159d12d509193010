//! The force laws, written once over the [`Number`]: plain in the step, dual for derivatives, intervals for bounds
//! (MODEL 2; LAW 2).
//!
//! Each is a potential W(δz, δ_t); the force on the body is f = f_z û + P_û p with f_z = ∂W/∂δz and p = ∂W/∂δ_t.
//!
//! - **Decoupled**, the seed's (4): W = F^z(δz) + F^r(ρ), ρ the length of the lateral deflection or, where the body is
//!   anisotropic, √(δ_t·A δ_t).
//! - **Coupled**: W = F + b·ξ + ½ ξ·K ξ + C(ξ³) + Q |ξ|⁴, all of δz, ξ the deflection in the test point's tangents.
//!
//! A law is linear in its coefficients, so that test points blend by their weights.

use crate::number::Number;
use glam::DVec3;
use std::array::from_fn;

/// What the decoupled law says at one deflection.
#[derive(Debug, Clone, Copy)]
pub struct Decoupled<T> {
    /// W, J: of the normal and of the lateral deflection.
    pub energy: [T; 2],
    /// f_z and f_r, N.
    pub force: [T; 2],
    /// f_r', N/m.
    pub lateral_slope: T,
}

/// The decoupled law: `normal` and `lateral` are one interval of the curves f_z and f_r each, their integral up to its knot
/// and their powers of the distance from there; `t` are these distances.
#[inline(always)]
pub fn decoupled<T: Number>(normal: [T; 5], lateral: [T; 5], t: [T; 2]) -> Decoupled<T> {
    let [[j, a0, b0, c0, d0], [k, a1, b1, c1, d1]] = [normal, lateral];
    let (start, a, b, c, d) = ([j, k], [a0, a1], [b0, b1], [c0, c1], [d0, d1]);
    let pair =
        |i: usize| if i == 0 { (t[0], a[0], b[0], c[0], d[0]) } else { (t[1], a[1], b[1], c[1], d[1]) };
    // Both side by side: forces, then their integrals.
    let force = from_fn(|i| {
        let (t, a, b, c, d) = pair(i);
        a + t * (b + t * (c + t * d))
    });
    let integral: [T; 2] = from_fn(|i| {
        let (t, a, b, c, d) = pair(i);
        t * (a + t * (b * 0.5 + t * (c * (1.0 / 3.0) + t * (d * 0.25))))
    });
    let lateral_slope = b1 + t[1] * (c1 * 2.0 + t[1] * (d1 * 3.0));
    Decoupled { energy: [start[0] + integral[0], start[1] + integral[1]], force, lateral_slope }
}

/// Quantities of the coupled law at one depth: F, b (2), K (11, 12, 22), C (111, 112, 122, 222), Q; and μ.
pub const QUANTITIES: usize = 12;

/// The coupled law's quantities of a test point in one interval of δz: powers of the distance from its knot.
pub type CoupledRow = [[f64; QUANTITIES]; 4];

/// The quantities at a depth, and their slopes, 1/m.
#[derive(Debug, Clone, Copy)]
pub struct AtDepth<T> {
    /// F in J, b in N, K in N/m, C in N/m², Q in N/m³, μ.
    pub value: [T; QUANTITIES],
    /// Their derivatives by δz.
    pub slope: [T; QUANTITIES],
}

/// A row at the distance `t` from its knot, by Horner's scheme for value and slope.
#[inline(always)]
pub fn at_depth<T: Number>([a, b, c, d]: &CoupledRow, t: T) -> AtDepth<T> {
    let (mut value, mut slope) = ([T::constant(0.0); QUANTITIES], [T::constant(0.0); QUANTITIES]);
    for i in 0..QUANTITIES {
        let third = t * d[i];
        let second = third + c[i];
        let first = second * t + b[i];
        value[i] = first * t + a[i];
        slope[i] = (third + second) * t + first;
    }
    AtDepth { value, slope }
}

/// A symmetric tensor of space: xx, xy, xz, yy, yz, zz.
pub type Symmetric<T> = [T; 6];

/// A tensor [11, 12, 22] of the plane of these tangents in space.
#[inline(always)]
pub fn in_space([k1, k2, k3]: [f64; 3], [s, t]: [DVec3; 2]) -> Symmetric<f64> {
    let (a, b) = (s * k1 + t * k2, s * k2 + t * k3);
    let row = |i: usize| a * s[i] + b * t[i];
    let [x, y, z] = [row(0), row(1), row(2)];
    [x.x, x.y, x.z, y.y, y.z, z.z]
}

/// How the tool moves with a contact point that slips under it, M = 1 + (R − δz) P κ P, P the projection along the unit vector
/// `normal` (MODEL 4): `curvature` is κ in space, 1/m, and `above` R − δz, m, which counts as −R/2 at least and R at most, so that M
/// lies between ½ and 2 where [`curvature_bounds`] hold.
#[inline(always)]
pub fn tool_motion<T: Number>(
    curvature: Symmetric<T>,
    normal: [T; 3],
    above: T,
    radius: f64,
) -> Symmetric<T> {
    let above = -(-above.at_least(-0.5 * radius)).at_least(-radius);
    let [x, y, z] = normal;
    let [p, q, r] = moved(&curvature, normal);
    let half = (p * x + q * y + r * z) * 0.5;
    // κ − û kᵀ − k ûᵀ + (û·k) û ûᵀ with k = κ û.
    let (p, q, r) = (p - x * half, q - y * half, r - z * half);
    let [xx, xy, xz, yy, yz, zz] = curvature;
    let across =
        [xx - x * p * 2.0, xy - x * q - y * p, xz - x * r - z * p, yy - y * q * 2.0, yz - y * r - z * q];
    let [xx, xy, xz, yy, yz] = across.map(|k| k * above);
    [xx + 1.0, xy, xz, yy + 1.0, yz, (zz - z * r * 2.0) * above + 1.0]
}

/// The least and the greatest curvature, 1/m, that counts under a ball of this radius (m): what is curved more, an edge that is sharp
/// against the tool or a hollow as narrow as it, has no one curvature. Under a point all count: it moves as the contact point does.
pub fn curvature_bounds(radius: f64) -> [f64; 2] {
    if radius > 0.0 { [-0.5 / radius, 1.0 / radius] } else { [f64::NEG_INFINITY, f64::INFINITY] }
}

/// The eigenvalues of a symmetric matrix [11, 12, 22], the smaller first.
#[inline(always)]
pub fn eigenvalues([a, b, c]: [f64; 3]) -> [f64; 2] {
    let (mean, off) = (0.5 * (a + c), (0.25 * (a - c) * (a - c) + b * b).sqrt());
    [mean - off, mean + off]
}

/// M v.
#[inline(always)]
pub fn moved<T: Number>([xx, xy, xz, yy, yz, zz]: &Symmetric<T>, [x, y, z]: [T; 3]) -> [T; 3] {
    [*xx * x + *xy * y + *xz * z, *xy * x + *yy * y + *yz * z, *xz * x + *yz * y + *zz * z]
}

/// M⁻¹ of a symmetric tensor that has one.
#[inline(always)]
pub fn inverse<T: Number>([xx, xy, xz, yy, yz, zz]: Symmetric<T>) -> Symmetric<T> {
    let (a, b, c) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
    let per = (xx * a + xy * b + xz * c).recip();
    [a, b, c, xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy].map(|x| x * per)
}

/// What the coupled law says at one deflection.
#[derive(Debug, Clone, Copy)]
pub struct Coupled<T> {
    /// W, J.
    pub energy: T,
    /// f_z = ∂W/∂δz, N.
    pub normal: T,
    /// ∂W/∂δ_t, N, is this in the test point's tangents …
    pub lateral: [T; 2],
    /// … and this times δ_t, N/m.
    pub radial: T,
}

/// How the terms of third and fourth order go on beyond the range R up to which a law was found; the same for all test points.
///
/// Beyond its range a potential goes on along each ray by its second-order expansion at the rim, which is conservative, C2, and
/// as convex along the ray as at the rim. Linear and quadratic terms are their own expansions; with r = |δ_t| and
/// k = min(1, R/r) the cubic ones are to be taken times s = 1 − (1 − k)³, and r⁴ goes over to q = r⁴ k² (6 − 8k + 3k²).
#[derive(Debug, Clone, Copy, Default)]
pub struct Reach<T> {
    /// s, and s'/r.
    pub(crate) s: T,
    ds: T,
    /// q, and q'/r.
    pub(crate) q: T,
    dq: T,
}

impl<T: Number> Reach<T> {
    /// Of |δ_t|², m², with a range in m.
    #[inline(always)]
    pub fn new(r2: T, range: f64) -> Self {
        // r, or R where that is greater.
        let per = r2.at_least(range * range).sqrt().recip();
        let k = per * range;
        let (short, k2) = (-k + 1.0, k * k);
        let short2 = short * short;
        // r² k² is r² within the range and R² beyond.
        let inner = r2 * k2;
        Reach {
            s: -(short * short2) + 1.0,
            ds: short2 * k * (per * per) * -3.0,
            q: r2 * inner * (k2 * 3.0 - k * 8.0 + 6.0),
            dq: inner * (-(k * 8.0) + 12.0),
        }
    }
}

/// The monomials of ξ that a potential's quantities are multiplied with, all but μ.
#[inline(always)]
pub fn monomials<T: Number>([x, y]: [T; 2], reach: &Reach<T>) -> [T; QUANTITIES - 1] {
    let (xx, xy, yy) = (x * x, x * y, y * y);
    let (sx, sy) = (reach.s * x, reach.s * y);
    let one = T::constant(1.0);
    [one, x, y, xx * 0.5, xy, yy * 0.5, xx * sx, xx * sy, yy * sx, yy * sy, reach.q]
}

#[inline(always)]
fn sum<T: Number>(quantities: &[T; QUANTITIES], m: &[T; QUANTITIES - 1]) -> T {
    // Pairs side by side.
    let mut parts = [quantities[0], quantities[1] * m[1]];
    for i in (2..QUANTITIES - 1).step_by(2) {
        parts[0] = parts[0] + quantities[i] * m[i];
        if i + 1 < QUANTITIES - 1 {
            parts[1] = parts[1] + quantities[i + 1] * m[i + 1];
        }
    }
    parts[0] + parts[1]
}

/// The coupled law with these quantities at ξ = (t₁·δ_t, t₂·δ_t); `reach` is that of δ_t.
#[inline(always)]
pub fn coupled<T: Number>(at: &AtDepth<T>, [x, y]: [T; 2], reach: &Reach<T>) -> Coupled<T> {
    let [_, b1, b2, k1, k2, k3, c1, c2, c3, c4, q, _] = at.value;
    let m = monomials([x, y], reach);
    // ∂(s C)/∂δ_t = s ∂C/∂ξ + C s'/r δ_t, with C homogeneous of the third degree: 3 C = ξ·∂C/∂ξ.
    let cx = (c1 * x + c2 * y * (2.0 / 3.0)) * x * 3.0 + c3 * (y * y);
    let cy = (c4 * y + c3 * x * (2.0 / 3.0)) * y * 3.0 + c2 * (x * x);
    let c = (cx * x + cy * y) * (1.0 / 3.0);
    Coupled {
        energy: sum(&at.value, &m),
        normal: sum(&at.slope, &m),
        lateral: [b1 + (k1 * x + k2 * y) + cx * reach.s, b2 + (k2 * x + k3 * y) + cy * reach.s],
        radial: c * reach.ds + q * reach.dq,
    }
}

/// The same of a test point alone, whose tangents δ_t lies in.
#[inline]
pub fn coupled_alone<T: Number>(at: &AtDepth<T>, [x, y]: [T; 2], range: f64) -> Coupled<T> {
    let law = coupled(at, [x, y], &Reach::new(x * x + y * y, range));
    let [p, q] = law.lateral;
    Coupled { lateral: [p + law.radial * x, q + law.radial * y], ..law }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::number::Dual;

    fn unit(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
    }

    fn row(seed: &mut u64) -> CoupledRow {
        // Of like size at 1 mm and 1 mm.
        let size = [1e-4, 0.1, 0.1, 1e2, 1e2, 1e2, 1e5, 1e5, 1e5, 1e5, 1e8, 0.3];
        from_fn(|k| size.map(|s| s * unit(seed) * 1e3f64.powi(k as i32)))
    }

    /// Within and beyond the range, and on its rim.
    fn places(seed: &mut u64) -> impl Iterator<Item = (f64, [f64; 2])> {
        let states: Vec<_> = (0..400)
            .map(|i| {
                let (x, y) = (unit(seed), unit(seed));
                let r = x.hypot(y);
                let far = if i % 5 == 0 { 2e-3 } else { 8e-3 * unit(seed).abs() };
                (1e-3 * unit(seed), [x / r * far, y / r * far])
            })
            .collect();
        states.into_iter()
    }

    #[test]
    fn forces_are_the_energys_gradient() {
        let mut seed = 3;
        for _ in 0..20 {
            let row = row(&mut seed);
            for (t, xi) in places(&mut seed) {
                let energy = |t: f64, xi: [f64; 2]| coupled_alone(&at_depth(&row, t), xi, 2e-3).energy;
                let law = coupled_alone(&at_depth(&row, t), xi, 2e-3);
                let h = 1e-7;
                let slope = |f: &dyn Fn(f64) -> f64| (f(h) - f(-h)) / (2.0 * h);
                let want = [
                    slope(&|h| energy(t + h, xi)),
                    slope(&|h| energy(t, [xi[0] + h, xi[1]])),
                    slope(&|h| energy(t, [xi[0], xi[1] + h])),
                ];
                for (got, want) in [law.normal, law.lateral[0], law.lateral[1]].into_iter().zip(want) {
                    assert!((got - want).abs() < 1e-6 * (1.0 + want.abs()), "{got} {want} at {t} {xi:?}");
                }
            }
        }
    }

    #[test]
    fn the_hessian_is_symmetric_and_that_of_differences() {
        let mut seed = 5;
        for _ in 0..20 {
            let row = row(&mut seed);
            for (t, [x, y]) in places(&mut seed) {
                let forces = |t: f64, xi| {
                    let law = coupled_alone(&at_depth(&row, t), xi, 2e-3);
                    [law.normal, law.lateral[0], law.lateral[1]]
                };
                let var = Dual::<f64, 3>::variable;
                let law = coupled_alone(&at_depth(&row, var(t, 0)), [var(x, 1), var(y, 2)], 2e-3);
                let hessian = [law.normal, law.lateral[0], law.lateral[1]].map(|d| d.partials);
                let h = 1e-8;
                let [a, b] =
                    [h, -h].map(|h| [forces(t + h, [x, y]), forces(t, [x + h, y]), forces(t, [x, y + h])]);
                for i in 0..3 {
                    for j in 0..3 {
                        let scale = 1.0 + hessian[i][j].abs();
                        assert!((hessian[i][j] - hessian[j][i]).abs() < 1e-9 * scale);
                        let slope = (a[j][i] - b[j][i]) / (2.0 * h);
                        // On the rim the third derivative jumps.
                        assert!(
                            (slope - hessian[i][j]).abs() < 1e-4 * (1e3 + scale),
                            "{slope} {}",
                            hessian[i][j]
                        );
                    }
                }
            }
        }
    }

    /// As LAW 2 says it: the second-order expansion at the rim.
    #[test]
    fn beyond_the_range_a_ray_goes_on_as_a_parabola() {
        let mut seed = 7;
        let row = row(&mut seed);
        let at = at_depth(&row, 4e-4);
        for i in 0..100 {
            let (c, s) = (libm::cos(f64::from(i)), libm::sin(f64::from(i)));
            let along = |r: f64| coupled_alone(&at, [c * r, s * r], 2e-3);
            let rim = along(2e-3);
            let force = rim.lateral[0] * c + rim.lateral[1] * s;
            let r = Dual::<f64, 1>::variable(2e-3 * (1.0 - 1e-12), 0);
            let quantities = at.value.map(Dual::constant);
            let at_rim = AtDepth { value: quantities, slope: quantities };
            let [x, y] = coupled_alone(&at_rim, [r * c, r * s], 2e-3).lateral;
            let stiffness = x.partials[0] * c + y.partials[0] * s;
            for far in [3e-3, 6e-3, 0.05] {
                let d = far - 2e-3;
                let want = rim.energy + force * d + 0.5 * stiffness * d * d;
                let scale = rim.energy.abs() + force.abs() * d + stiffness.abs() * d * d;
                assert!((along(far).energy - want).abs() < 1e-9 * scale, "{far}");
            }
        }
    }
}
