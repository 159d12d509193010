//! The lateral force: alike in all directions, or under the tensors of an anisotropic body (MODEL 2 and 7).
//!
//! The nodes' tensors mix like everything else, A = Σ n_l A_l. ρ = √(δ_t·A δ_t) takes the place of δr in the lateral
//! curve, and f_t = f_r(ρ)/ρ w with w = P_û A δ_t that of f_r u_r: the gradient of F_r(ρ), so that stick is
//! conservative. No tangent basis is needed, and nothing jumps where two of them would meet.
//!
//! A step is compiled once for each of the two, so that isotropic bodies pay nothing.

use crate::drive::Drive;
use crate::field::Field;
use glam::DVec3;
use palpate_body::{ContactModel, Sample, Tensor, tensor};
use std::array::from_fn;

/// Below this the lateral deflection is rounding, and its direction noise, m.
pub(crate) const NO_DIRECTION: f64 = 1e-12;

/// Bound on the iterates of [`Lateral::aim`]; mostly none are needed, else two or three.
const AIMS: u32 = 6;
/// How near the squared length of a way comes to the one wanted before they begin.
const NEAR: f64 = 2e-3;

/// How the lateral force follows from the lateral deflection; a value is what one evaluation knows of it besides its
/// [`Field`].
pub(crate) trait Lateral: Copy + Default {
    /// Whether f_t lies along δ_t.
    const ISOTROPIC: bool;
    /// What it reads of an element's nodes.
    type Nodes<'a>: Copy;

    /// Of an element.
    fn nodes(body: &ContactModel, element: u32) -> Self::Nodes<'_>;

    /// Σ n A.
    fn mix(nodes: Self::Nodes<'_>, n: [f64; 3]) -> Tensor;

    /// From δ_t and its length: ρ, and the direction of f_t, zero where there is none. `project` is P_û.
    fn of(
        tensor: impl FnOnce() -> Tensor,
        tangential: DVec3,
        lateral: f64,
        project: impl Fn(DVec3) -> DVec3,
    ) -> (Self, f64, DVec3);

    /// |f_t| and how fast it falls when c moves along it, the rest held; from the curve's value and slope at ρ.
    fn pull(&self, value: f64, slope: f64) -> (f64, f64);

    /// ρ, m.
    fn rho(&self, f: &Field) -> f64;

    /// δ_t, m.
    fn deflection(&self, f: &Field) -> DVec3;

    /// g = f_r/ρ, N/m; 0 where there is no lateral deflection.
    fn gain(&self, f: &Field) -> f64;

    /// g û·A δ_t, N: what the tensor makes of the deflection along û.
    fn beside(&self, tensor: impl FnOnce() -> Tensor, f: &Field) -> f64;

    /// δ_t·A_l δ_t of each node.
    fn squares(nodes: Self::Nodes<'_>, deflection: DVec3) -> [f64; 3];

    /// δ_t·v.
    fn along_deflection(&self, f: &Field, v: DVec3) -> f64;

    /// Which way f_t leads, a unit vector.
    fn aim(&self, f: &Field) -> DVec3;

    /// Which way another drive leads, of which f_t is the part that changes as c moves.
    fn lead(tensor: impl FnOnce() -> Tensor, f: &Field, drive: &Drive) -> DVec3;

    /// How much less f_t falls along `old` than along `new`, or more.
    fn turned(tensor: impl FnOnce() -> Tensor, old: DVec3, new: DVec3) -> f64;

    /// How f_t changes; `tensors` are A and its rate.
    fn drift(
        &self,
        tensors: impl FnOnce() -> [Tensor; 2],
        f: &Field,
        v: DVec3,
        change: &Change,
    ) -> LateralDrift;
}

/// What changes while c moves, the tensor apart.
pub(crate) struct Change {
    /// û and its rate, 1/m.
    pub u: DVec3,
    pub du: DVec3,
    /// The rate of δ_t.
    pub d_tangential: DVec3,
    /// The lateral curve at ρ, and the rate at which it changes along the surface, N/m.
    pub curve: Sample,
    pub gradient: f64,
}

/// The part of [`Drift`](crate::field::Drift) that comes from f_t.
pub(crate) struct LateralDrift {
    /// Its rate, in two parts, N/m.
    pub force: [DVec3; 2],
    /// The rate of its component along the way, N/m.
    pub pull: f64,
    /// The greatest stiffness in stick, N/m.
    pub stiffness: f64,
    /// |∂|f_t|/∂x|, N/m.
    pub pull_gradient: f64,
}

/// f_t = f_r(δr) u_r.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Isotropic;

impl Lateral for Isotropic {
    const ISOTROPIC: bool = true;
    type Nodes<'a> = ();

    #[inline(always)]
    fn nodes(_: &ContactModel, _: u32) {}

    #[inline(always)]
    fn mix((): (), _: [f64; 3]) -> Tensor {
        tensor::IDENTITY
    }

    #[inline(always)]
    fn of(
        _: impl FnOnce() -> Tensor,
        tangential: DVec3,
        lateral: f64,
        _: impl Fn(DVec3) -> DVec3,
    ) -> (Self, f64, DVec3) {
        let u_t = if lateral > 0.0 { tangential * (1.0 / lateral) } else { DVec3::ZERO };
        (Isotropic, lateral, u_t)
    }

    #[inline(always)]
    fn pull(&self, value: f64, slope: f64) -> (f64, f64) {
        (value, slope)
    }

    #[inline(always)]
    fn rho(&self, f: &Field) -> f64 {
        f.lateral
    }

    #[inline(always)]
    fn deflection(&self, f: &Field) -> DVec3 {
        f.u_t * f.lateral
    }

    #[inline(always)]
    fn gain(&self, f: &Field) -> f64 {
        if f.lateral > 0.0 { f.pull / f.lateral } else { 0.0 }
    }

    #[inline(always)]
    fn beside(&self, _: impl FnOnce() -> Tensor, _: &Field) -> f64 {
        0.0
    }

    #[inline(always)]
    fn squares((): (), deflection: DVec3) -> [f64; 3] {
        [deflection.length_squared(); 3]
    }

    #[inline(always)]
    fn along_deflection(&self, f: &Field, v: DVec3) -> f64 {
        f.lateral * f.u_t.dot(v)
    }

    #[inline(always)]
    fn aim(&self, f: &Field) -> DVec3 {
        f.u_t
    }

    #[inline(always)]
    fn lead(_: impl FnOnce() -> Tensor, _: &Field, drive: &Drive) -> DVec3 {
        drive.along
    }

    #[inline(always)]
    fn turned(_: impl FnOnce() -> Tensor, _: DVec3, _: DVec3) -> f64 {
        1.0
    }

    #[inline(always)]
    fn drift(&self, _: impl FnOnce() -> [Tensor; 2], f: &Field, _: DVec3, change: &Change) -> LateralDrift {
        let d_lateral = f.u_t.dot(change.d_tangential);
        let du_t = if f.lateral > 0.0 {
            (change.d_tangential - f.u_t * d_lateral) * (1.0 / f.lateral)
        } else {
            DVec3::ZERO
        };
        let d_pull = f.pull_slope * d_lateral + change.gradient;
        let secant = if f.lateral < NO_DIRECTION { 0.0 } else { f.pull / f.lateral };
        LateralDrift {
            force: [f.u_t * d_pull, du_t * f.pull],
            pull: d_pull,
            stiffness: f.pull_slope.max(secant),
            pull_gradient: f.pull_slope,
        }
    }
}

/// f_t = f_r(ρ)/ρ P_û A δ_t, as one evaluation found it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Stretch {
    /// δ_t, m.
    deflection: DVec3,
    /// Its square, m².
    square: f64,
    /// ρ, m.
    rho: f64,
    /// |w|/ρ.
    gain: f64,
}

impl Lateral for Stretch {
    const ISOTROPIC: bool = false;
    type Nodes<'a> = [&'a Tensor; 3];

    #[inline(always)]
    fn nodes(body: &ContactModel, element: u32) -> [&Tensor; 3] {
        body.element_tensors(element)
    }

    #[inline(always)]
    fn mix([a, b, c]: [&Tensor; 3], n: [f64; 3]) -> Tensor {
        from_fn(|i| n[0] * a[i] + n[1] * b[i] + n[2] * c[i])
    }

    #[inline(always)]
    fn of(
        tensor: impl FnOnce() -> Tensor,
        tangential: DVec3,
        lateral: f64,
        project: impl Fn(DVec3) -> DVec3,
    ) -> (Self, f64, DVec3) {
        let tensor = tensor();
        let stretched = tensor::apply(&tensor, tangential);
        let w = project(stretched);
        let (rho2, w2) = (tangential.dot(stretched), w.length_squared());
        let (mut rho, mut gain, mut u_t) = (0.0, 1.0, DVec3::ZERO);
        if rho2 > 0.0 && w2 > 0.0 {
            let length = w2.sqrt();
            rho = rho2.sqrt();
            gain = length / rho;
            u_t = w * (1.0 / length);
        }
        (Stretch { deflection: tangential, square: lateral * lateral, rho, gain }, rho, u_t)
    }

    /// |f_t| = f_r |w|/ρ. Of ∂f_t/∂δ_t = f_r/ρ P A P + (f_r' − f_r/ρ) w wᵀ/ρ² the slope takes w wᵀ/ρ² for P A P, which are
    /// the same along a principal axis; elsewhere it is too low, for a ratio κ by a factor down to 4 κ/(1 + κ)².
    #[inline(always)]
    fn pull(&self, value: f64, slope: f64) -> (f64, f64) {
        (value * self.gain, slope * (self.gain * self.gain))
    }

    #[inline(always)]
    fn rho(&self, _: &Field) -> f64 {
        self.rho
    }

    #[inline(always)]
    fn deflection(&self, _: &Field) -> DVec3 {
        self.deflection
    }

    #[inline(always)]
    fn gain(&self, f: &Field) -> f64 {
        if self.rho > 0.0 { f.pull / (self.gain * self.rho) } else { 0.0 }
    }

    #[inline(always)]
    fn beside(&self, tensor: impl FnOnce() -> Tensor, f: &Field) -> f64 {
        f.u().dot(tensor::apply(&tensor(), self.deflection)) * Lateral::gain(self, f)
    }

    #[inline(always)]
    fn squares(nodes: [&Tensor; 3], deflection: DVec3) -> [f64; 3] {
        nodes.map(|a| deflection.dot(tensor::apply(a, deflection)))
    }

    #[inline(always)]
    fn along_deflection(&self, _: &Field, v: DVec3) -> f64 {
        self.deflection.dot(v)
    }

    /// As in an implicit step, along f_t where the contact point will come to rest, not where it starts: on a uniform
    /// plane one iterate is then nearly enough, with and without friction.
    ///
    /// While c moves by λ v, f_t = g A δ_t goes to g A (δ_t − λ v), and that is L v if (λ A + ℓ I) v = w, with w = A δ_t
    /// and ℓ = L/g. In the plane (tr(A) I − A) A = det(A) I, so that v ∝ ℓ w + λ det(A) δ_t: along the force where little
    /// is left to go, straight under the tip where there is no friction. λ makes v's length 1.
    #[inline(always)]
    fn aim(&self, f: &Field) -> DVec3 {
        // With |w| as the unit u_t·δ_t = ρ²/|w|² = 1/gain², and u_t·A u_t = tr(A) − det(A)/gain². A's trace in the plane is
        // 2 where û is the nodes' own, and never far from it.
        let gain2 = self.gain * self.gain;
        let part = (self.rho * self.rho * (2.0 - gain2) / (self.square * gain2)).max(0.0);
        let (determinant, square) = (part * gain2, part * (2.0 - gain2));
        let straight = self.deflection * (determinant / (self.gain * self.rho));
        // v along a u_t + b det(A) δ_t with a : b = ℓ : λ; λ from where the force alone would lead, (1 − ℓ)/(u_t·A u_t), is
        // mostly near enough. In whatever unit a and b are, no quotient has to be waited for.
        let (mut a, mut b) = (f.limit * (2.0 - part), f.pull - f.limit);
        let length2 = |a: f64, b: f64| a * (a + 2.0 * b * part) + b * b * square;
        let mut v2 = length2(a, b);
        let d = (b * (b * determinant + 2.0 * a) + a * a) / (f.pull * (2.0 - part));
        if (d * d - v2).abs() >= NEAR * v2 {
            (a, b) = share(f.limit / f.pull, part, determinant, square);
            v2 = length2(a, b);
        }
        let per = 1.0 / v2.sqrt();
        let v = (f.u_t * a + straight * b) * per;
        // A direction that has lost the force, or is none, leads nowhere.
        if f.pull * (a + b * part) * per > f.limit && v.is_finite() { v } else { f.u_t }
    }

    /// As [`Lateral::aim`], with the deflection that would make this drive: (λ A + ℓ I) v = w', hence
    /// v ∝ (ℓ + 2 λ) w' − λ P A w' (A's trace in the plane is 2), and λ from where the drive alone would lead.
    #[inline(always)]
    fn lead(tensor: impl FnOnce() -> Tensor, f: &Field, drive: &Drive) -> DVec3 {
        let (u, stretched) = (f.u(), tensor::apply(&tensor(), drive.along));
        let stretched = stretched - u * u.dot(stretched);
        let (rest, part) = (f.limit, drive.along.dot(stretched));
        // Times the part, so that there is no quotient.
        let way = drive.force - rest;
        let v = drive.along * (rest * part + 2.0 * way) - stretched * way;
        let v = v * (1.0 / v.length());
        // A direction that has lost the drive, or is none, leads nowhere.
        if drive.force * drive.along.dot(v) > rest && v.is_finite() { v } else { drive.along }
    }

    #[inline(always)]
    fn turned(tensor: impl FnOnce() -> Tensor, old: DVec3, new: DVec3) -> f64 {
        let a = tensor();
        old.dot(tensor::apply(&a, old)) / new.dot(tensor::apply(&a, new))
    }

    #[inline(always)]
    fn drift(
        &self,
        tensors: impl FnOnce() -> [Tensor; 2],
        f: &Field,
        v: DVec3,
        change: &Change,
    ) -> LateralDrift {
        let Change { u, du, d_tangential, curve, gradient } = *change;
        let ([a, da], deflection) = (tensors(), self.deflection);
        let project = |v: DVec3| v - u * u.dot(v);
        let stretched = tensor::apply(&a, deflection);
        let turned = tensor::apply(&da, deflection);
        let w = project(stretched);
        let dw =
            project(turned + tensor::apply(&a, d_tangential)) - u * du.dot(stretched) - du * u.dot(stretched);
        // f_t = g w with g = f_r/ρ.
        let (g, dg, bend) = if self.rho > 0.0 {
            let per = 1.0 / self.rho;
            let d_rho = (d_tangential.dot(stretched) + 0.5 * deflection.dot(turned)) * per;
            let g = curve.value * per;
            (g, ((curve.slope - g) * d_rho + gradient) * per, (curve.slope - g) * per * per)
        } else {
            (curve.slope, 0.0, 0.0)
        };
        let force = w * dg + dw * g;
        // ∂f_t/∂x u_t, and the norm of ∂f_t/∂x = B^½ (g I + (f_r' − g) ŝ ŝᵀ) B^½ with B = P A P.
        let along = project(tensor::apply(&a, f.u_t)) * g + w * (bend * w.dot(f.u_t));
        LateralDrift {
            force: [force, DVec3::ZERO],
            pull: force.dot(v),
            stiffness: greatest_eigenvalue(&a, u) * g.max(curve.slope),
            pull_gradient: along.length(),
        }
    }
}

/// ℓ and λ in units of |w|: v = ℓ u_t + λ det(A) δ_t has the length det(λ A + ℓ I), by Newton's method on the quotient of
/// the two, which is nearly linear in λ.
#[cold]
fn share(rest: f64, part: f64, determinant: f64, square: f64) -> (f64, f64) {
    let mut way = (1.0 - rest) / (2.0 - part);
    for _ in 0..AIMS {
        let (forced, straight) = (rest + way * part, rest * part + way * square);
        let v2 = rest * forced + way * straight;
        let d = way * (way * determinant + 2.0 * rest) + rest * rest;
        let miss = d - v2.sqrt();
        way -= miss * v2 / (2.0 * (way * determinant + rest) * v2 - d * straight);
        // Newton squares it.
        if miss.abs() < NEAR * d {
            break;
        }
    }
    (rest, way)
}

/// Of a tensor in the plane at right angles to the unit vector `u`.
fn greatest_eigenvalue(a: &Tensor, u: DVec3) -> f64 {
    let [xx, yy, zz, xy, xz, yz] = *a;
    let [x, y, z] = [DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz)];
    let half = 0.5 * (xx + yy + zz - u.dot(tensor::apply(a, u)));
    // u·adj(A) u is the determinant there.
    let determinant = u.dot(y.cross(z) * u.x + z.cross(x) * u.y + x.cross(y) * u.z);
    half + (half * half - determinant).max(0.0).sqrt()
}
