//! The ten-node tetrahedron: energy, forces and stiffness at large deformations.
//!
//! Four Gauss points, as CalculiX's C3D10. Nearly incompressible tissue would lock: with four points each, pressures
//! ask more of the displacements than they can give. So of the volumetric energy ½Kθ² only as much is taken point by
//! point as a body of ν = 0.45 has; the rest acts on the element's mean θ (mean dilatation: Nagtegaal, Parks & Rice
//! 1974; Simo, Taylor & Pister 1985), which takes one condition from each element and locks nothing. Up to ν = 0.45
//! the element is the plain one.

use crate::material::{Density, Material, Tensor, VolumeMeasure};
use glam::DVec3;

/// Shares of the corners' area coordinates at a Gauss point (Keast 1986, degree 2): 3/20 + √5/20·… each once.
const NEAR: f64 = 0.585_410_196_624_968_5;
const FAR: f64 = 0.138_196_601_125_010_5;

/// Gauss points of an element.
pub(crate) const POINTS: usize = 4;

/// Pairs of nodes (a, b), b ≤ a, of an element.
pub(crate) const PAIRS: usize = 55;

/// The bulk modulus, in shear moduli, that is taken point by point: that of ν = 0.45 (K = 9.7 μ, λ = 9 μ).
const POINTWISE_BULK: f64 = 10.0;

/// Gradients of the ten shape functions at one Gauss point, 1/m, and the volume that the point stands for, m³.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct GaussPoint {
    pub gradients: [[f64; 3]; 10],
    pub volume: f64,
}

/// What an element adds to the whole.
pub(crate) struct Contribution {
    /// J.
    pub energy: f64,
    /// ∂energy/∂u, N: 3 × node + component.
    pub force: [f64; 30],
    /// ∂²energy/∂u², N/m: the block of pair (a, b) at a(a+1)/2 + b, row-major.
    pub stiffness: [[f64; 9]; PAIRS],
}

impl Default for Contribution {
    fn default() -> Self {
        Contribution { energy: 0.0, force: [0.0; 30], stiffness: [[0.0; 9]; PAIRS] }
    }
}

/// The shape functions' gradients by the area coordinates ξ₁, ξ₂, ξ₃ of corners 1, 2, 3, at `at` (four coordinates).
fn local_gradients(at: [f64; 4]) -> [[f64; 3]; 10] {
    // ∂L_i/∂ξ
    const L: [[f64; 3]; 4] = [[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut gradients = [[0.0; 3]; 10];
    for (i, gradient) in gradients.iter_mut().enumerate() {
        for (k, g) in gradient.iter_mut().enumerate() {
            *g = if i < 4 {
                (4.0 * at[i] - 1.0) * L[i][k]
            } else {
                let [a, b] = crate::mesh::EDGES[i - 4];
                4.0 * (at[a] * L[b][k] + at[b] * L[a][k])
            };
        }
    }
    gradients
}

/// An element's Gauss points, from its nodes at rest; `None` if it is folded at one of them.
pub(crate) fn gauss_points(nodes: [DVec3; 10]) -> Option<[GaussPoint; POINTS]> {
    let mut points = [GaussPoint::default(); POINTS];
    for (q, point) in points.iter_mut().enumerate() {
        let mut at = [FAR; 4];
        at[q] = NEAR;
        let local = local_gradients(at);
        let mut jacobian = glam::DMat3::ZERO;
        for (node, g) in nodes.iter().zip(&local) {
            jacobian.x_axis += *node * g[0];
            jacobian.y_axis += *node * g[1];
            jacobian.z_axis += *node * g[2];
        }
        let determinant = jacobian.determinant();
        if !(determinant.is_finite() && determinant > 0.0) {
            return None;
        }
        // ∂N/∂X = J⁻ᵀ ∂N/∂ξ
        let inverse = jacobian.inverse().transpose();
        for (gradient, local) in point.gradients.iter_mut().zip(&local) {
            *gradient = (inverse * DVec3::from_array(*local)).to_array();
        }
        point.volume = determinant / 24.0;
    }
    Some(points)
}

/// F at a Gauss point, row-major, for nodal displacements `u` (3 × node + component).
#[inline(always)]
fn deformation(point: &GaussPoint, u: &[f64; 30]) -> Tensor {
    let mut f = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    for (a, g) in point.gradients.iter().enumerate() {
        for i in 0..3 {
            for j in 0..3 {
                f[3 * i + j] += u[3 * a + i] * g[j];
            }
        }
    }
    f
}

/// Whether F inverts volumes, or is none.
#[inline(always)]
fn folded(f: &Tensor) -> bool {
    let determinant = f[0] * (f[4] * f[8] - f[5] * f[7]) - f[1] * (f[3] * f[8] - f[5] * f[6])
        + f[2] * (f[3] * f[7] - f[4] * f[6]);
    determinant <= 0.0 || determinant.is_nan()
}

/// A material as the element sees it: its bulk modulus in the part taken point by point and the part on the mean.
#[derive(Debug, Clone)]
pub(crate) struct Tissue {
    pub material: Material,
    pointwise_pa: f64,
    mean_pa: f64,
    positive: bool,
}

impl Tissue {
    pub fn new(material: Material) -> Self {
        let shear = material.small_strain().shear_pa;
        let pointwise_pa = material.bulk_pa().min(POINTWISE_BULK * shear);
        let mean_pa = material.bulk_pa() - pointwise_pa;
        // St. Venant–Kirchhoff's energy would let it happen; only the linear law knows no inside and outside.
        let positive = material.measure() != VolumeMeasure::TraceEps;
        Tissue { pointwise_pa, mean_pa, positive, material }
    }

    /// Stored energy, J; infinite where the element is inverted.
    pub fn energy(&self, points: &[GaussPoint; POINTS], u: &[f64; 30]) -> f64 {
        let (mut energy, mut volume, mut mean) = (0.0, 0.0, 0.0);
        for point in points {
            let f = deformation(point, u);
            if self.positive && folded(&f) {
                return f64::INFINITY;
            }
            let theta = self.material.measure().value(&f);
            let density = self.material.distortion_energy(&f) + 0.5 * self.pointwise_pa * theta * theta;
            energy += point.volume * density;
            volume += point.volume;
            mean += point.volume * theta;
        }
        energy += 0.5 * self.mean_pa * mean * mean / volume;
        if energy.is_finite() { energy } else { f64::INFINITY }
    }

    /// ∂energy/∂u, added to nothing; whether the element is not turned inside out: else forces mean nothing.
    #[inline(always)]
    pub fn forces(&self, points: &[GaussPoint; POINTS], u: &[f64; 30], out: &mut [f64; 30]) -> bool {
        *out = [0.0; 30];
        let measure = self.material.measure();
        let mut deformations = [[0.0; 9]; POINTS];
        let (mut volume, mut mean) = (0.0, 0.0);
        for (point, f) in points.iter().zip(&mut deformations) {
            *f = deformation(point, u);
            if self.positive && folded(f) {
                return false;
            }
            volume += point.volume;
            if self.mean_pa > 0.0 {
                mean += point.volume * measure.value(f);
            }
        }
        let mean_pressure = self.mean_pa * mean / volume;
        for (point, f) in points.iter().zip(&deformations) {
            let (_, mut stress) = self.material.distortion_stress(f);
            let (theta, gradient) = measure.gradient(f);
            let total = self.pointwise_pa * theta + mean_pressure;
            for (stress, gradient) in stress.iter_mut().zip(&gradient) {
                *stress = (*stress + total * gradient) * point.volume;
            }
            add_forces(point, &stress, out);
        }
        out.iter().all(|f| f.is_finite())
    }

    /// Energy, forces and stiffness. Energy is infinite, and the rest means nothing, where the element is turned
    /// inside out.
    #[inline(always)]
    pub fn contribute(&self, points: &[GaussPoint; POINTS], u: &[f64; 30], out: &mut Contribution) {
        out.force = [0.0; 30];
        let measure = self.material.measure();
        // The element's mean θ comes first: its pressure enters every point.
        let mut deformations = [[0.0; 9]; POINTS];
        let (mut volume, mut mean) = (0.0, 0.0);
        for (point, f) in points.iter().zip(&mut deformations) {
            *f = deformation(point, u);
            if self.positive && folded(f) {
                out.energy = f64::INFINITY;
                return;
            }
            volume += point.volume;
            if self.mean_pa > 0.0 {
                mean += point.volume * measure.value(f);
            }
        }
        let mean_pressure = self.mean_pa * mean / volume;
        out.energy = 0.5 * mean_pressure * mean;
        let mut mean_gradient = [0.0; 30];
        let mut density = Density::default();
        let mut rows: Rows = [[[0.0; 12]; 9]; 10];
        for (point, f) in points.iter().zip(&deformations) {
            self.material.distortion(f, &mut density);
            let theta = measure.evaluate(f);
            let pressure = self.pointwise_pa * theta.value;
            let total = pressure + mean_pressure;
            out.energy += point.volume * (density.energy + 0.5 * pressure * theta.value);
            let mut stress = density.stress;
            for (stress, gradient) in stress.iter_mut().zip(&theta.gradient) {
                *stress = (*stress + total * gradient) * point.volume;
            }
            let mut tangent = density.tangent;
            for i in 0..9 {
                let scaled = self.pointwise_pa * theta.gradient[i];
                for j in 0..9 {
                    let more = scaled * theta.gradient[j] + total * theta.hessian[9 * i + j];
                    tangent[9 * i + j] = (tangent[9 * i + j] + more) * point.volume;
                }
            }
            add_forces(point, &stress, &mut out.force);
            add_stiffness(point, &tangent, &mut rows);
            if self.mean_pa > 0.0 {
                let weighted = theta.gradient.map(|g| g * point.volume);
                add_forces(point, &weighted, &mut mean_gradient);
            }
        }
        let scale = self.mean_pa / volume;
        let mut pair = 0;
        for (a, rows) in rows.iter().enumerate() {
            for b in 0..=a {
                let block = &mut out.stiffness[pair];
                for i in 0..3 {
                    for k in 0..3 {
                        let mean = mean_gradient[3 * a + i] * mean_gradient[3 * b + k];
                        block[3 * i + k] = rows[3 * i + k][b] + scale * mean;
                    }
                }
                pair += 1;
            }
        }
        if !out.energy.is_finite() {
            out.energy = f64::INFINITY;
        }
    }
}

#[inline(always)]
fn add_forces(point: &GaussPoint, stress: &Tensor, force: &mut [f64; 30]) {
    for (a, g) in point.gradients.iter().enumerate() {
        for i in 0..3 {
            force[3 * a + i] += stress[3 * i] * g[0] + stress[3 * i + 1] * g[1] + stress[3 * i + 2] * g[2];
        }
    }
}

/// Stiffness of an element while its points are summed: for each node a and components i, k, all nodes b in a row (up
/// to the next multiple of four: the rest of a row is not kept up).
type Rows = [[[f64; 12]; 9]; 10];

/// K_ab[i][k] += Σ_JL g_a[J] A[iJ][kL] g_b[L].
#[inline(always)]
fn add_stiffness(point: &GaussPoint, tangent: &[f64; 81], rows: &mut Rows) {
    let mut gradients = [[0.0; 12]; 3];
    for (b, g) in point.gradients.iter().enumerate() {
        for (row, g) in gradients.iter_mut().zip(g) {
            row[b] = *g;
        }
    }
    // Half of it for all nodes b: half[iJ][k][b].
    let mut half = [[[0.0; 12]; 3]; 9];
    for (row, half) in half.iter_mut().enumerate() {
        for (k, half) in half.iter_mut().enumerate() {
            let a = [tangent[9 * row + 3 * k], tangent[9 * row + 3 * k + 1], tangent[9 * row + 3 * k + 2]];
            for b in 0..12 {
                half[b] = a[0] * gradients[0][b] + a[1] * gradients[1][b] + a[2] * gradients[2][b];
            }
        }
    }
    for (a, rows) in rows.iter_mut().enumerate() {
        let g = &point.gradients[a];
        match a / 4 {
            0 => add_rows::<4>(g, &half, rows),
            1 => add_rows::<8>(g, &half, rows),
            _ => add_rows::<12>(g, &half, rows),
        }
    }
}

#[inline(always)]
fn add_rows<const N: usize>(g: &[f64; 3], half: &[[[f64; 12]; 3]; 9], rows: &mut [[f64; 12]; 9]) {
    for i in 0..3 {
        for k in 0..3 {
            let [h0, h1, h2] = [&half[3 * i][k], &half[3 * i + 1][k], &half[3 * i + 2][k]];
            let row = &mut rows[3 * i + k];
            for b in 0..N {
                row[b] += g[0] * h0[b] + g[1] * h1[b] + g[2] * h2[b];
            }
        }
    }
}

#[cfg(test)]
mod tests;
