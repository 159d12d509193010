//! Each law against automatic differentiation of its energy, written a second time below, against differences, and
//! against closed forms.

mod support;

use num_dual::{DualNum, HyperDual64};
use palpate_simulate::material::{Bulk, Density, Material, Tensor, VolumeMeasure};
use support::named;

/// A number that carries its first and second derivative.
type D = HyperDual64;
type Matrix = [[D; 3]; 3];

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j])
    })
}

fn transposed(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn trace(a: &Matrix) -> D {
    a[0][0] + a[1][1] + a[2][2]
}

fn determinant(a: &Matrix) -> D {
    a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) - a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0])
        + a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0])
}

/// tr C^s by the binomial series about c 𝟙, which has no trouble with equal eigenvalues.
fn trace_of_power(right: &Matrix, s: f64) -> D {
    let c = 0.6 * (right[0][0] + right[1][1] + right[2][2]).re;
    let x: Matrix =
        std::array::from_fn(|i| std::array::from_fn(|j| right[i][j] / c - if i == j { 1.0 } else { 0.0 }));
    let mut power: Matrix =
        std::array::from_fn(|i| std::array::from_fn(|j| D::from(if i == j { 1.0 } else { 0.0 })));
    let (mut sum, mut binomial) = (D::from(0.0), 1.0);
    for k in 0..1500 {
        let term = trace(&power) * binomial;
        if [term.re, term.eps1, term.eps2, term.eps1eps2].iter().all(|t| t.abs() < 1e-18) && k > 20 {
            break;
        }
        sum += term;
        power = times(&power, &x);
        binomial *= (s - k as f64) / (k as f64 + 1.0);
    }
    sum * c.powf(s)
}

/// ψ_d as the material's documentation has it.
fn energy(material: &Material, f: &[D; 9]) -> D {
    let f: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| f[3 * i + j]));
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
            let e: Matrix = std::array::from_fn(|i| {
                std::array::from_fn(|j| (right[i][j] - if i == j { 1.0 } else { 0.0 }) * 0.5)
            });
            trace(&times(&e, &e)) * *mu_pa
        }
        Material::Linear { mu_pa, .. } => {
            let e: Matrix = std::array::from_fn(|i| {
                std::array::from_fn(|j| (f[i][j] + f[j][i]) * 0.5 - if i == j { 1.0 } else { 0.0 })
            });
            trace(&times(&e, &e)) * *mu_pa
        }
    }
}

/// θ as the measure's documentation has it.
fn volume(measure: VolumeMeasure, f: &[D; 9]) -> D {
    let m: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| f[3 * i + j]));
    match measure {
        VolumeMeasure::LnJ => determinant(&m).ln(),
        VolumeMeasure::JMinusOne => determinant(&m) - 1.0,
        VolumeMeasure::TraceE => (trace(&times(&transposed(&m), &m)) - 3.0) * 0.5,
        VolumeMeasure::TraceEps => trace(&m) - 3.0,
    }
}

/// Value, gradient and Hessian of a function of F, by hyper-dual numbers.
fn differentiate(f: &Tensor, function: impl Fn(&[D; 9]) -> D) -> Density {
    let mut out = Density::default();
    for r in 0..9 {
        for c in 0..9 {
            let x: [D; 9] = std::array::from_fn(|k| {
                D::new(f[k], f64::from(u8::from(k == r)), f64::from(u8::from(k == c)), 0.0)
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
    glam::DMat3::from_cols_array(f).determinant()
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

/// ψ, P and tangent of the whole law, without averaging.
fn whole(material: &Material, f: &Tensor) -> Density {
    let mut out = Density::default();
    material.distortion(f, &mut out);
    let volume = material.measure().evaluate(f);
    let k = material.bulk_pa();
    out.energy += 0.5 * k * volume.value * volume.value;
    for r in 0..9 {
        out.stress[r] += k * volume.value * volume.gradient[r];
        for c in 0..9 {
            out.tangent[9 * r + c] +=
                k * (volume.gradient[r] * volume.gradient[c] + volume.value * volume.hessian[9 * r + c]);
        }
    }
    out
}

#[test]
fn differences_agree() {
    for material in laws() {
        for f in deformations() {
            let density = whole(&material, &f);
            let scale = largest(&density.tangent);
            for c in 0..9 {
                let step = 1e-5;
                let at = |x: f64| {
                    let mut moved = f;
                    moved[c] += x;
                    whole(&material, &moved)
                };
                let (ahead, behind) = (at(step), at(-step));
                let what = format!("{material:?} at {f:?}, column {c}");
                let slope = (ahead.energy - behind.energy) / (2.0 * step);
                close(&what, &[density.stress[c]], &[slope], 1e-7 * scale);
                for r in 0..9 {
                    let slope = (ahead.stress[r] - behind.stress[r]) / (2.0 * step);
                    close(&what, &[density.tangent[9 * r + c]], &[slope], 1e-7 * scale);
                }
            }
        }
    }
}

#[test]
fn a_turned_body_stores_the_same() {
    let noise = &mut Noise(11);
    for material in laws() {
        for f in deformations() {
            let (turn, before) = (noise.rotation(), whole(&material, &f));
            let turned = whole(&material, &multiply(&turn, &f));
            let what = format!("{material:?} at {f:?}");
            let scale = largest(&before.tangent);
            let drift = (turned.energy - before.energy).abs();
            if matches!(material, Material::Linear { .. }) {
                continue;
            }
            assert!(drift <= 1e-13 * scale, "{what}: energy moved by {drift}");
            close(&what, &turned.stress, &multiply(&turn, &before.stress), 1e-12 * scale);
            // Isotropic: turning it before it is deformed changes nothing either.
            let turned = whole(&material, &multiply(&f, &turn));
            assert!((turned.energy - before.energy).abs() <= 1e-13 * scale, "{what}");
        }
    }
}

#[test]
fn at_rest_it_is_linear_elasticity() {
    let (identity, noise) = (deformations()[0], &mut Noise(13));
    for material in laws() {
        let moduli = material.small_strain();
        let rest = whole(&material, &identity);
        assert_eq!(rest.energy, 0.0, "{material:?}");
        close("stress at rest", &rest.stress, &[0.0; 9], 1e-12);
        for _ in 0..4 {
            let m: Tensor = std::array::from_fn(|_| noise.next());
            let trace = m[0] + m[4] + m[8];
            let expected: Tensor = std::array::from_fn(|n| {
                let diagonal = if n % 4 == 0 { moduli.lambda_pa() * trace } else { 0.0 };
                moduli.shear_pa * (m[n] + m[n % 3 * 3 + n / 3]) + diagonal
            });
            let found: Tensor = std::array::from_fn(|r| (0..9).map(|c| rest.tangent[9 * r + c] * m[c]).sum());
            close(&format!("{material:?}"), &found, &expected, 1e-12 * moduli.bulk_pa);

            // A strain of a millionth: stress and energy keep their digits. The mean of both signs has no error of
            // second order.
            let small = 2f64.powi(-20);
            let at = |s: f64| {
                let f: Tensor = std::array::from_fn(|n| identity[n] + s * m[n]);
                let h: Tensor = std::array::from_fn(|n| (f[n] - identity[n]) / s);
                (whole(&material, &f), h)
            };
            let ((ahead, h), (behind, _)) = (at(small), at(-small));
            let stress: Tensor =
                std::array::from_fn(|r| (ahead.stress[r] - behind.stress[r]) / (2.0 * small));
            close(&format!("{material:?}"), &stress, &expected, 1e-9 * largest(&expected));
            let energy: f64 = (0..9).map(|n| 0.5 * small * small * h[n] * found[n]).sum();
            let mean = 0.5 * (ahead.energy + behind.energy);
            assert!((mean / energy - 1.0).abs() < 1e-9, "{material:?}: {mean}, expected {energy}");
        }
    }
}

#[test]
fn what_cannot_be_is_not_finite() {
    let mirrored = [-0.7, 0.1, 0.0, 0.0, 1.0, 0.2, 0.0, 0.0, 1.1];
    let flat = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
    let huge = [200.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let mut out = Density::default();
    for material in laws() {
        for f in [mirrored, flat] {
            material.distortion(&f, &mut out);
            for energy in [out.energy, material.distortion_energy(&f), material.distortion_stress(&f).0] {
                assert_eq!(
                    !energy.is_finite(),
                    material.needs_positive_volume(),
                    "{material:?}: {energy} at {f:?}"
                );
            }
        }
        material.distortion(&huge, &mut out);
        let overflows = matches!(material, Material::FungDemiray { .. } | Material::VerondaWestmann { .. });
        for energy in [out.energy, material.distortion_energy(&huge), material.distortion_stress(&huge).0] {
            assert_eq!(!energy.is_finite(), overflows, "{material:?}: {energy}");
        }
        // No panic and no endless loop, whatever comes.
        for f in [[f64::NAN; 9], [f64::INFINITY; 9], [0.0; 9], [1e200; 9]] {
            material.distortion(&f, &mut out);
            material.measure().evaluate(&f);
        }
    }
}

/// Rows of a table by its column names; empty fields are None.
fn table(text: &str) -> Vec<impl Fn(&str) -> Option<String>> {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let header = reader.headers().unwrap().clone();
    let rows: Vec<_> = reader.records().map(|row| row.unwrap()).collect();
    rows.into_iter()
        .map(|row| {
            let header = header.clone();
            move |column: &str| {
                let at = header.iter().position(|name| name == column).expect("a column of the table");
                Some(row[at].to_string()).filter(|field| !field.is_empty())
            }
        })
        .collect()
}

fn diagonal(a: f64, b: f64, c: f64) -> Tensor {
    [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c]
}

#[track_caller]
fn same(what: &str, found: f64, expected: &str, tolerance: f64) {
    let expected: f64 = expected.parse().unwrap();
    assert!((found - expected).abs() <= tolerance * expected.abs(), "{what}: {found}, expected {expected}");
}

#[test]
fn incompressible_closed_forms() {
    let mut checked = 0;
    for row in table(include_str!("data/incompressible.csv")) {
        let (model, value) = (row("model").unwrap(), row("value").unwrap().parse::<f64>().unwrap());
        let material = named(&model);
        // Volume is kept, so the pressure is what the free direction, the third, needs.
        let pulled = |f: Tensor| {
            let (_, stress) = material.distortion_stress(&f);
            stress[0] - stress[8] * f[8] / f[0]
        };
        let modes = [
            ("uniaxial", diagonal(value, 1.0 / value.sqrt(), 1.0 / value.sqrt())),
            ("equibiaxial", diagonal(value, value, 1.0 / (value * value))),
            ("planar", diagonal(value, 1.0, 1.0 / value)),
        ];
        for (mode, f) in modes {
            if let Some(expected) = row(mode) {
                same(&format!("{model}, {mode} {value}"), pulled(f), &expected, 1e-9);
                checked += 1;
            }
        }
        if let Some(expected) = row("simple_shear") {
            let f = [1.0, value, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
            let (_, stress) = material.distortion_stress(&f);
            same(&format!("{model}, shear {value}"), stress[1], &expected, 1e-9);
            checked += 1;
        }
    }
    assert_eq!(checked, 6 * (3 * 13 + 7));
}

#[test]
fn compressible_figures() {
    let mut checked = 0;
    for row in table(include_str!("data/compressible.csv")) {
        let (model, value) = (row("model").unwrap(), row("value").unwrap().parse::<f64>().unwrap());
        let (material, what) = (named(&model), format!("{model}, {:?} {value}", row("mode")));
        match row("mode").unwrap().as_str() {
            "uniaxial" => {
                // The lateral stretch that lets the sides free.
                let (mut low, mut high) = (0.5, 2.0);
                for _ in 0..200 {
                    let middle = 0.5 * (low + high);
                    let free = whole(&material, &diagonal(value, middle, middle)).stress[4] < 0.0;
                    *(if free { &mut low } else { &mut high }) = middle;
                }
                same(&what, low, &row("lateral_stretch").unwrap(), 1e-9);
                let stress = whole(&material, &diagonal(value, low, low)).stress[0];
                same(&what, stress, &row("nominal_stress").unwrap(), 1e-9);
            }
            "simple_shear" => {
                let f = [1.0, value, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
                let stress = whole(&material, &f).stress;
                same(&what, stress[1], &row("shear_stress").unwrap(), 1e-9);
                // σ = P Fᵀ, det F = 1. The program's Ogden has six digits, and a zero is a zero.
                for (i, column) in ["cauchy_11", "cauchy_22", "cauchy_33"].into_iter().enumerate() {
                    let found: f64 = (0..3).map(|j| stress[3 * i + j] * f[3 * i + j]).sum();
                    let expected: f64 = row(column).unwrap().parse().unwrap();
                    let tolerance = if model == "ogden1" { 5e-4 } else { 1e-9 * expected.abs() + 1e-9 };
                    assert!(
                        (found - expected).abs() <= tolerance,
                        "{what}: {column} {found}, not {expected}"
                    );
                }
            }
            other => panic!("the table has a mode {other} that this test does not know"),
        }
        checked += 1;
    }
    assert_eq!(checked, 7 * 10);
}

#[test]
fn parameters_are_checked() {
    let (bulk, nu) = (Bulk::ModulusPa(1e5), Bulk::PoissonRatio(0.45));
    let refused = |material: palpate_simulate::Result<Material>, place: &str| {
        let message = material.unwrap_err().to_string();
        assert!(message.starts_with(&format!("{place}: ")), "{message}");
    };
    refused(Material::neo_hookean(0.0, 0.3), "young_modulus_pa");
    refused(Material::neo_hookean(f64::NAN, 0.3), "young_modulus_pa");
    refused(Material::linear(1e4, 0.5), "poisson_ratio");
    refused(Material::st_venant_kirchhoff(1e4, -0.1), "poisson_ratio");
    refused(Material::mooney_rivlin(100.0, -100.0, nu), "c10_pa");
    refused(Material::mooney_rivlin(100.0, f64::INFINITY, bulk), "c01_pa");
    refused(Material::mooney_rivlin(100.0, 1.0, Bulk::ModulusPa(0.0)), "bulk_modulus_pa");
    refused(Material::ogden(vec![], nu), "terms");
    refused(Material::ogden(vec![[100.0, 2.0], [-100.0, 3.0]], nu), "terms");
    refused(Material::ogden(vec![[100.0, 2.0], [1.0, 0.0]], nu), "terms[1]");
    refused(Material::yeoh(vec![], nu), "c_pa");
    refused(Material::yeoh(vec![-1.0, 3.0], nu), "c_pa");
    refused(Material::yeoh(vec![1.0, f64::NAN], nu), "c_pa[1]");
    refused(Material::fung_demiray(10.0, 0.0, nu), "b");
    refused(Material::fung_demiray(-10.0, 1.0, nu), "mu_pa");
    refused(Material::veronda_westmann(-10.0, -1.0, nu), "c1_pa");
    refused(Material::veronda_westmann(10.0, 1.0, Bulk::PoissonRatio(0.4999999)), "poisson_ratio");
    for material in laws() {
        material.validate().unwrap();
        let moduli = material.small_strain();
        let again = palpate_simulate::material::Moduli::of_young(moduli.young_pa(), moduli.poisson_ratio());
        assert!((again.shear_pa / moduli.shear_pa - 1.0).abs() < 1e-13, "{material:?}");
        assert!((again.bulk_pa / moduli.bulk_pa - 1.0).abs() < 1e-13, "{material:?}");
    }
    let with_ratio = Material::mooney_rivlin(1000.0, 700.0, nu).unwrap().small_strain();
    assert!((with_ratio.poisson_ratio() - 0.45).abs() < 1e-12);
}

/// Prints what an evaluation costs: `cargo test --release -p palpate-simulate --test materials -- --ignored --nocapture`.
#[test]
#[ignore = "prints figures, judges nothing"]
fn cost() {
    let noise = &mut Noise(17);
    let deformations: Vec<Tensor> = (0..256).map(|_| noise.near_one(0.25)).collect();
    let mut out = Density::default();
    for material in laws() {
        let mut best = [f64::INFINITY; 3];
        for _ in 0..200 {
            let mut time = |n: usize, run: &mut dyn FnMut(&Tensor)| {
                let start = std::time::Instant::now();
                deformations.iter().for_each(&mut *run);
                best[n] = best[n].min(start.elapsed().as_nanos() as f64 / 256.0);
            };
            time(0, &mut |f| material.distortion(f, std::hint::black_box(&mut out)));
            time(1, &mut |f| _ = std::hint::black_box(material.distortion_stress(f)));
            time(2, &mut |f| _ = std::hint::black_box(material.distortion_energy(f)));
        }
        println!(
            "{:4.0} ns with tangent, {:4.0} stress, {:4.0} energy: {material:?}",
            best[0], best[1], best[2]
        );
    }
}
