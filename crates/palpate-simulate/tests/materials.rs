//! Each law against automatic differentiation of its energy, written a second time below, against differences, and
//! against closed forms.

use num_dual::{DualNum, HyperDual64};
use palpate_simulate::material::{Bulk, Density, Material, Tensor, VolumeMeasure};

/// 3 × 3, of numbers or duals.
type Matrix<D> = [[D; 3]; 3];

fn times<D: DualNum<f64> + Copy>(a: &Matrix<D>, b: &Matrix<D>) -> Matrix<D> {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j])
    })
}

fn transposed<D: Copy>(a: &Matrix<D>) -> Matrix<D> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn trace<D: DualNum<f64> + Copy>(a: &Matrix<D>) -> D {
    a[0][0] + a[1][1] + a[2][2]
}

fn determinant<D: DualNum<f64> + Copy>(a: &Matrix<D>) -> D {
    a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) - a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0])
        + a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0])
}

/// tr C^s by the binomial series about c 𝟙, which has no trouble with equal eigenvalues.
fn trace_of_power<D: DualNum<f64> + Copy>(right: &Matrix<D>, s: f64) -> D {
    let c = 0.6 * (right[0][0] + right[1][1] + right[2][2]).re();
    let x: Matrix<D> =
        std::array::from_fn(|i| std::array::from_fn(|j| right[i][j] / c - if i == j { 1.0 } else { 0.0 }));
    let mut power: Matrix<D> =
        std::array::from_fn(|i| std::array::from_fn(|j| D::from(if i == j { 1.0 } else { 0.0 })));
    let (mut sum, mut binomial) = (D::from(0.0), 1.0);
    for k in 0..1500 {
        sum += trace(&power) * binomial;
        power = times(&power, &x);
        binomial *= (s - k as f64) / (k as f64 + 1.0);
    }
    sum * c.powf(s)
}

/// ψ_d as the material's documentation has it.
fn energy<D: DualNum<f64> + Copy>(material: &Material, f: &[D; 9]) -> D {
    let f: Matrix<D> = std::array::from_fn(|i| std::array::from_fn(|j| f[3 * i + j]));
    let right = times(&transposed(&f), &f);
    let j = determinant(&f);
    let i1 = trace(&right);
    let i2 = (i1 * i1 - trace(&times(&right, &right))) * 0.5;
    let (i1_bar, i2_bar) = (i1 * j.powf(-2.0 / 3.0), i2 * j.powf(-4.0 / 3.0));
    match material {
        Material::NeoHookean { mu_pa, .. } => (i1 - 3.0) * (0.5 * mu_pa) - j.ln() * *mu_pa,
        Material::IsochoricNeoHookean { mu_pa, .. } => (i1_bar - 3.0) * (0.5 * mu_pa),
        Material::MooneyRivlin { c10_pa, c01_pa, .. } => (i1_bar - 3.0) * *c10_pa + (i2_bar - 3.0) * *c01_pa,
        Material::Yeoh { c_pa, .. } => {
            c_pa.iter().enumerate().fold(D::from(0.0), |w, (i, c)| w + (i1_bar - 3.0).powi(i as i32 + 1) * *c)
        }
        Material::FungDemiray { mu_pa, b, .. } => (((i1_bar - 3.0) * *b).exp() - 1.0) * (0.5 * mu_pa / b),
        Material::VerondaWestmann { c1_pa, c3, .. } => {
            (((i1_bar - 3.0) * *c3).exp() - 1.0) * *c1_pa - (i2_bar - 3.0) * (0.5 * c1_pa * c3)
        }
        Material::Ogden { terms, .. } => terms.iter().fold(D::from(0.0), |w, [mu, alpha]| {
            let sum = trace_of_power(&right, 0.5 * alpha) * j.powf(-alpha / 3.0);
            w + (sum - 3.0) * (2.0 * mu / (alpha * alpha))
        }),
        Material::StVenantKirchhoff { mu_pa, .. } => {
            let e: Matrix<D> = std::array::from_fn(|i| {
                std::array::from_fn(|j| (right[i][j] - if i == j { 1.0 } else { 0.0 }) * 0.5)
            });
            trace(&times(&e, &e)) * *mu_pa
        }
        Material::Linear { mu_pa, .. } => {
            let e: Matrix<D> = std::array::from_fn(|i| {
                std::array::from_fn(|j| (f[i][j] + f[j][i]) * 0.5 - if i == j { 1.0 } else { 0.0 })
            });
            trace(&times(&e, &e)) * *mu_pa
        }
    }
}

/// θ as the measure's documentation has it.
fn volume<D: DualNum<f64> + Copy>(measure: VolumeMeasure, f: &[D; 9]) -> D {
    let m: Matrix<D> = std::array::from_fn(|i| std::array::from_fn(|j| f[3 * i + j]));
    match measure {
        VolumeMeasure::LnJ => determinant(&m).ln(),
        VolumeMeasure::JMinusOne => determinant(&m) - 1.0,
        VolumeMeasure::TraceE => (trace(&times(&transposed(&m), &m)) - 3.0) * 0.5,
        VolumeMeasure::TraceEps => trace(&m) - 3.0,
    }
}

/// Value, gradient and Hessian of a function of F, by hyper-dual numbers.
fn differentiate(f: &Tensor, function: impl Fn(&[HyperDual64; 9]) -> HyperDual64) -> Density {
    let mut out = Density::default();
    for r in 0..9 {
        for c in 0..9 {
            let x: [HyperDual64; 9] = std::array::from_fn(|k| {
                HyperDual64::new(f[k], f64::from(u8::from(k == r)), f64::from(u8::from(k == c)), 0.0)
            });
            let y = function(&x);
            out.energy = y.re;
            out.stress[r] = y.eps1;
            out.tangent[9 * r + c] = y.eps1eps2;
        }
    }
    out
}

/// One of each law, and several of Ogden's, all of 1 kPa shear modulus or so.
fn laws() -> Vec<Material> {
    let bulk = Bulk::ModulusPa(2e4);
    vec![
        Material::neo_hookean(1e4, 0.45).unwrap(),
        Material::isochoric_neo_hookean(1e4, 0.45).unwrap(),
        Material::mooney_rivlin(1000.0, 700.0, bulk).unwrap(),
        Material::mooney_rivlin(-200.0, 900.0, bulk).unwrap(),
        Material::ogden(vec![[1000.0, 2.0]], bulk).unwrap(),
        Material::ogden(vec![[1000.0, 4.7]], bulk).unwrap(),
        Material::ogden(vec![[800.0, -3.3], [500.0, 1.4], [-20.0, 0.5]], bulk).unwrap(),
        Material::yeoh(vec![1200.0], bulk).unwrap(),
        Material::yeoh(vec![1200.0, -90.0, 31.0, 4.0], bulk).unwrap(),
        Material::fung_demiray(1000.0, 1.3, bulk).unwrap(),
        Material::veronda_westmann(900.0, 1.1, bulk).unwrap(),
        Material::st_venant_kirchhoff(1e4, 0.4).unwrap(),
        Material::linear(1e4, 0.4).unwrap(),
    ]
}

/// Numbers from −1 to 1, the same every time.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn rotation(&mut self) -> Tensor {
        let q = glam::DQuat::from_xyzw(self.next(), self.next(), self.next(), self.next()).normalize();
        glam::DMat3::from_quat(q).transpose().to_cols_array()
    }

    /// 𝟙 plus noise of that size, positive volume.
    fn near_one(&mut self, size: f64) -> Tensor {
        loop {
            let mut f: Tensor = std::array::from_fn(|_| size * self.next());
            (f[0], f[4], f[8]) = (1.0 + f[0], 1.0 + f[4], 1.0 + f[8]);
            if det(&f) > 0.2 {
                return f;
            }
        }
    }
}

fn det(f: &Tensor) -> f64 {
    determinant(&[[f[0], f[1], f[2]], [f[3], f[4], f[5]], [f[6], f[7], f[8]]])
}

fn multiply(a: &Tensor, b: &Tensor) -> Tensor {
    std::array::from_fn(|n| (0..3).map(|k| a[n / 3 * 3 + k] * b[3 * k + n % 3]).sum())
}

/// Deformations of every kind: random, near rest, and with two or three equal stretches, turned or not.
fn deformations() -> Vec<Tensor> {
    let noise = &mut Noise(7);
    let mut all = vec![[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]];
    for size in [0.7, 0.5, 0.2, 1e-2, 1e-4, 1e-8] {
        for _ in 0..4 {
            all.push(noise.near_one(size));
        }
    }
    for stretches in
        [[1.3; 3], [0.8; 3], [1.4, 1.4, 0.6], [0.7, 0.7, 1.2], [0.9, 1.3, 1.3 + 1e-9], [0.5, 1.0, 1.6]]
    {
        let [a, b, c] = stretches;
        let straight = [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c];
        all.push(straight);
        all.push(multiply(&multiply(&noise.rotation(), &straight), &noise.rotation()));
    }
    all
}

fn largest(list: &[f64]) -> f64 {
    list.iter().fold(0.0, |m, x| m.max(x.abs()))
}

#[track_caller]
fn close(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance, "{what}: entry {i} is {a}, expected {b}");
    }
}

#[test]
fn stress_and_tangent_are_the_energys_derivatives() {
    for material in laws() {
        for f in deformations() {
            let expected = differentiate(&f, |x| energy(&material, x));
            let mut found = Density::default();
            material.distortion(&f, &mut found);
            let what = format!("{material:?} at {f:?}");
            let scale = largest(&expected.tangent);
            close(&what, &[found.energy], &[expected.energy], 2e-14 * scale);
            close(&what, &found.stress, &expected.stress, 1e-13 * scale);
            close(&what, &found.tangent, &expected.tangent, 1e-12 * scale);
            for r in 0..9 {
                for c in 0..r {
                    let (a, b) = (found.tangent[9 * r + c], found.tangent[9 * c + r]);
                    assert!((a - b).abs() <= 1e-14 * scale, "{what}: {a} at ({r}, {c}), {b} across");
                }
            }
            // The cheap forms say the same.
            let (energy, stress) = material.distortion_stress(&f);
            close(&what, &[energy, material.distortion_energy(&f)], &[found.energy; 2], 1e-15 * scale);
            close(&what, &stress, &found.stress, 1e-14 * scale);
        }
    }
}

#[test]
fn volume_measures_are_differentiated_right() {
    use VolumeMeasure::*;
    for measure in [LnJ, JMinusOne, TraceE, TraceEps] {
        for f in deformations() {
            let expected = differentiate(&f, |x| volume(measure, x));
            let found = measure.evaluate(&f);
            let what = format!("{measure:?} at {f:?}");
            close(&what, &[found.value, measure.value(&f)], &[expected.energy; 2], 3e-15);
            close(&what, &found.gradient, &expected.stress, 1e-13 * largest(&expected.stress));
            close(&what, &found.hessian, &expected.tangent, 1e-13 * largest(&expected.tangent));
            assert_eq!(measure.gradient(&f), (found.value, found.gradient));
        }
    }
}
