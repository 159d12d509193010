//! What tissue is made of: stored energy for each volume of the body at rest, stress, and tangent.
//!
//! A law is ψ(F) = ψ_d(F) + ½ K θ(F)², F the deformation gradient. [`Material`] gives ψ_d, the *distortion* part, with
//! its derivatives, and the modulus K; [`VolumeMeasure`] gives θ with its. An element may so take θ at each point, or
//! its mean over the element, against locking.
//!
//! At rest the stress is zero. Near rest, energies and θ are computed from F − 1, relatively accurate however small the
//! strain; a stress has an error of some 10⁻¹⁶ of the shear modulus, as F has of 1.

mod isochoric;
mod ogden;
mod tensor;
mod volume;

pub use volume::{Volume, VolumeMeasure};

use crate::{Result, SimulateError};
use isochoric::{FungDemiray, MooneyRivlin, NeoHookean, VerondaWestmann, Yeoh};
use tensor::{
    Invariants, add_cubic, add_curvature_of_determinant, add_identity, cofactor, displacement_gradient,
    green_lagrange, left, product, set_product,
};

/// A second-order tensor, row-major: entry 3 i + J is F_iJ = ∂x_i/∂X_J.
pub type Tensor = [f64; 9];

/// A hyperelastic law with its parameters. Ī₁ = J^(−2/3) I₁, Ī₂ = J^(−4/3) I₂, λ̄ = J^(−1/3) λ; J = det F.
///
/// The fields are public so that a law can be looked at; [`Material::validate`] says whether they make sense.
#[derive(Debug, Clone, PartialEq)]
pub enum Material {
    /// μ/2 (I₁ − 3) − μ ln J + λ/2 (ln J)²: θ = ln J, K = λ. The default law: it grows without bound towards J = 0 and
    /// stays well-posed for any compressibility.
    NeoHookean {
        /// Shear modulus μ, Pa.
        mu_pa: f64,
        /// Lamé's first parameter λ, Pa.
        lambda_pa: f64,
    },
    /// μ/2 (Ī₁ − 3) + K/2 (J − 1)².
    IsochoricNeoHookean {
        /// Shear modulus μ, Pa.
        mu_pa: f64,
        /// Bulk modulus K, Pa.
        bulk_pa: f64,
    },
    /// C₁₀ (Ī₁ − 3) + C₀₁ (Ī₂ − 3) + K/2 (J − 1)²; μ = 2 (C₁₀ + C₀₁).
    MooneyRivlin {
        /// C₁₀, Pa.
        c10_pa: f64,
        /// C₀₁, Pa.
        c01_pa: f64,
        /// Bulk modulus K, Pa.
        bulk_pa: f64,
    },
    /// Σ 2μ_p/α_p² (Σ_a λ̄_a^α_p − 3) + K/2 (J − 1)²; μ = Σ μ_p.
    Ogden {
        /// \[μ_p in Pa, α_p\] of each term.
        terms: Vec<[f64; 2]>,
        /// Bulk modulus K, Pa.
        bulk_pa: f64,
    },
    /// Σ c_i (Ī₁ − 3)^i + K/2 (J − 1)²; μ = 2 c₁.
    Yeoh {
        /// c₁, c₂, …, Pa.
        c_pa: Vec<f64>,
        /// Bulk modulus K, Pa.
        bulk_pa: f64,
    },
    /// μ/(2b) (e^{b (Ī₁ − 3)} − 1) + K/2 (J − 1)².
    FungDemiray {
        /// Shear modulus μ, Pa.
        mu_pa: f64,
        /// How fast it stiffens.
        b: f64,
        /// Bulk modulus K, Pa.
        bulk_pa: f64,
    },
    /// C₁ (e^{C₃ (Ī₁ − 3)} − 1) − C₁C₃/2 (Ī₂ − 3) + K/2 (J − 1)²; μ = C₁C₃.
    VerondaWestmann {
        /// C₁, Pa.
        c1_pa: f64,
        /// How fast it stiffens.
        c3: f64,
        /// Bulk modulus K, Pa.
        bulk_pa: f64,
    },
    /// μ E : E + λ/2 (tr E)², E the Green–Lagrange strain. Softens under compression, and to nothing: only for moderate
    /// strain.
    StVenantKirchhoff {
        /// Shear modulus μ, Pa.
        mu_pa: f64,
        /// Lamé's first parameter λ, Pa.
        lambda_pa: f64,
    },
    /// μ ε : ε + λ/2 (tr ε)², ε = sym(F − 1). Only for small strain and small rotation.
    Linear {
        /// Shear modulus μ, Pa.
        mu_pa: f64,
        /// Lamé's first parameter λ, Pa.
        lambda_pa: f64,
    },
}

/// Energy for each volume at rest, and its derivatives by F.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Density {
    /// ψ_d, J/m³. Not finite where det F ≤ 0 under a law that [needs more](Material::needs_positive_volume), or where
    /// an exponential overflows; then the rest has no meaning.
    pub energy: f64,
    /// ∂ψ_d/∂F, first Piola–Kirchhoff, Pa.
    pub stress: Tensor,
    /// ∂²ψ_d/∂F², row-major 9 × 9, symmetric to rounding, Pa.
    pub tangent: [f64; 81],
}

impl Default for Density {
    fn default() -> Self {
        Density { energy: 0.0, stress: [0.0; 9], tangent: [0.0; 81] }
    }
}

/// Moduli at small strain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moduli {
    /// Shear modulus μ, Pa.
    pub shear_pa: f64,
    /// Bulk modulus λ + 2μ/3, Pa.
    pub bulk_pa: f64,
}

impl Moduli {
    /// Of Young's modulus (Pa) and Poisson's ratio.
    pub fn of_young(young_modulus_pa: f64, poisson_ratio: f64) -> Self {
        Moduli {
            shear_pa: young_modulus_pa / (2.0 * (1.0 + poisson_ratio)),
            bulk_pa: young_modulus_pa / (3.0 * (1.0 - 2.0 * poisson_ratio)),
        }
    }

    /// Young's modulus, Pa.
    pub fn young_pa(&self) -> f64 {
        9.0 * self.bulk_pa * self.shear_pa / (3.0 * self.bulk_pa + self.shear_pa)
    }

    /// Poisson's ratio.
    pub fn poisson_ratio(&self) -> f64 {
        (3.0 * self.bulk_pa - 2.0 * self.shear_pa) / (6.0 * self.bulk_pa + 2.0 * self.shear_pa)
    }

    /// Lamé's first parameter λ, Pa.
    pub fn lambda_pa(&self) -> f64 {
        self.bulk_pa - 2.0 / 3.0 * self.shear_pa
    }
}

impl Material {
    /// ψ_d, its stress and tangent at F. Real-time: no, but it doesn't allocate.
    #[inline(always)]
    pub fn distortion(&self, f: &Tensor, out: &mut Density) {
        match *self {
            Material::NeoHookean { mu_pa, .. } => neo_hookean(mu_pa, f, out),
            Material::IsochoricNeoHookean { mu_pa, .. } => isochoric::tangent(&NeoHookean { mu_pa }, f, out),
            Material::MooneyRivlin { c10_pa, c01_pa, .. } => {
                isochoric::tangent(&MooneyRivlin { c10_pa, c01_pa }, f, out);
            }
            Material::Ogden { ref terms, .. } => ogden::tangent(terms, f, out),
            Material::Yeoh { ref c_pa, .. } => isochoric::tangent(&Yeoh { c_pa }, f, out),
            Material::FungDemiray { mu_pa, b, .. } => isochoric::tangent(&FungDemiray { mu_pa, b }, f, out),
            Material::VerondaWestmann { c1_pa, c3, .. } => {
                isochoric::tangent(&VerondaWestmann { c1_pa, c3 }, f, out);
            }
            Material::StVenantKirchhoff { mu_pa, .. } => {
                let e = green_lagrange(f);
                (out.energy, out.stress) = saint_venant(mu_pa, f, &e);
                out.tangent = [0.0; 81];
                add_cubic(&mut out.tangent, f, (2.0 * mu_pa, &e), (mu_pa, &left(f)));
            }
            Material::Linear { mu_pa, .. } => {
                (out.energy, out.stress) = linear(mu_pa, f);
                out.tangent = [0.0; 81];
                for i in 0..3 {
                    for j in 0..3 {
                        out.tangent[10 * (3 * i + j)] += mu_pa;
                        out.tangent[9 * (3 * i + j) + 3 * j + i] += mu_pa;
                    }
                }
            }
        }
    }

    /// ψ_d and its stress at F, as [`Material::distortion`] but without the tangent's cost.
    pub fn distortion_stress(&self, f: &Tensor) -> (f64, Tensor) {
        match *self {
            Material::NeoHookean { mu_pa, .. } => {
                let (energy, inverse) = logarithmic(mu_pa, f);
                let mut stress = cofactor(f);
                for r in 0..9 {
                    stress[r] = mu_pa * (f[r] - inverse * stress[r]);
                }
                (energy, stress)
            }
            Material::IsochoricNeoHookean { mu_pa, .. } => isochoric::stress(&NeoHookean { mu_pa }, f),
            Material::MooneyRivlin { c10_pa, c01_pa, .. } => {
                isochoric::stress(&MooneyRivlin { c10_pa, c01_pa }, f)
            }
            Material::Ogden { ref terms, .. } => ogden::stress(terms, f),
            Material::Yeoh { ref c_pa, .. } => isochoric::stress(&Yeoh { c_pa }, f),
            Material::FungDemiray { mu_pa, b, .. } => isochoric::stress(&FungDemiray { mu_pa, b }, f),
            Material::VerondaWestmann { c1_pa, c3, .. } => {
                isochoric::stress(&VerondaWestmann { c1_pa, c3 }, f)
            }
            Material::StVenantKirchhoff { mu_pa, .. } => saint_venant(mu_pa, f, &green_lagrange(f)),
            Material::Linear { mu_pa, .. } => linear(mu_pa, f),
        }
    }

    /// ψ_d at F, J/m³.
    pub fn distortion_energy(&self, f: &Tensor) -> f64 {
        match *self {
            Material::NeoHookean { mu_pa, .. } => logarithmic(mu_pa, f).0,
            Material::IsochoricNeoHookean { mu_pa, .. } => isochoric::energy(&NeoHookean { mu_pa }, f),
            Material::MooneyRivlin { c10_pa, c01_pa, .. } => {
                isochoric::energy(&MooneyRivlin { c10_pa, c01_pa }, f)
            }
            Material::Ogden { ref terms, .. } => ogden::energy(terms, f),
            Material::Yeoh { ref c_pa, .. } => isochoric::energy(&Yeoh { c_pa }, f),
            Material::FungDemiray { mu_pa, b, .. } => isochoric::energy(&FungDemiray { mu_pa, b }, f),
            Material::VerondaWestmann { c1_pa, c3, .. } => {
                isochoric::energy(&VerondaWestmann { c1_pa, c3 }, f)
            }
            Material::StVenantKirchhoff { mu_pa, .. } => saint_venant(mu_pa, f, &green_lagrange(f)).0,
            Material::Linear { mu_pa, .. } => linear(mu_pa, f).0,
        }
    }

    /// K of ½ K θ², Pa.
    pub fn bulk_pa(&self) -> f64 {
        match *self {
            Material::NeoHookean { lambda_pa, .. }
            | Material::StVenantKirchhoff { lambda_pa, .. }
            | Material::Linear { lambda_pa, .. } => lambda_pa,
            Material::IsochoricNeoHookean { bulk_pa, .. }
            | Material::MooneyRivlin { bulk_pa, .. }
            | Material::Ogden { bulk_pa, .. }
            | Material::Yeoh { bulk_pa, .. }
            | Material::FungDemiray { bulk_pa, .. }
            | Material::VerondaWestmann { bulk_pa, .. } => bulk_pa,
        }
    }

    /// θ of ½ K θ².
    pub fn measure(&self) -> VolumeMeasure {
        match self {
            Material::NeoHookean { .. } => VolumeMeasure::LnJ,
            Material::StVenantKirchhoff { .. } => VolumeMeasure::TraceE,
            Material::Linear { .. } => VolumeMeasure::TraceEps,
            _ => VolumeMeasure::JMinusOne,
        }
    }

    /// Whether the energy is infinite or undefined where det F ≤ 0.
    pub fn needs_positive_volume(&self) -> bool {
        !matches!(self, Material::StVenantKirchhoff { .. } | Material::Linear { .. })
    }

    /// Shear and bulk modulus at rest.
    pub fn small_strain(&self) -> Moduli {
        let shear_pa = match self {
            Material::NeoHookean { mu_pa, .. }
            | Material::IsochoricNeoHookean { mu_pa, .. }
            | Material::FungDemiray { mu_pa, .. }
            | Material::StVenantKirchhoff { mu_pa, .. }
            | Material::Linear { mu_pa, .. } => *mu_pa,
            Material::MooneyRivlin { c10_pa, c01_pa, .. } => 2.0 * (c10_pa + c01_pa),
            Material::Ogden { terms, .. } => terms.iter().map(|[mu_pa, _]| mu_pa).sum(),
            Material::Yeoh { c_pa, .. } => 2.0 * c_pa.first().copied().unwrap_or(0.0),
            Material::VerondaWestmann { c1_pa, c3, .. } => c1_pa * c3,
        };
        let bulk_pa = match self.measure() {
            VolumeMeasure::JMinusOne => self.bulk_pa(),
            _ => self.bulk_pa() + 2.0 / 3.0 * shear_pa,
        };
        Moduli { shear_pa, bulk_pa }
    }
}

/// μ/2 (I₁ − 3) − μ ln J, and 1/J.
fn logarithmic(mu_pa: f64, f: &Tensor) -> (f64, f64) {
    let Invariants { i1, j } = Invariants::of(f);
    (0.5 * mu_pa * i1 - mu_pa * libm::log1p(j), 1.0 / (1.0 + j))
}

/// With C = cof F: stress μ F − μ/J C, tangent μ 𝟙 + μ/J² C⊗C − μ/J F×.
fn neo_hookean(mu_pa: f64, f: &Tensor, out: &mut Density) {
    let (energy, inverse) = logarithmic(mu_pa, f);
    let cof = cofactor(f).map(|c| inverse * c);
    let scaled = cof.map(|c| mu_pa * c);
    out.energy = energy;
    for r in 0..9 {
        out.stress[r] = mu_pa * f[r] - scaled[r];
    }
    set_product(&mut out.tangent, &cof, &scaled);
    add_curvature_of_determinant(&mut out.tangent, f, -mu_pa * inverse);
    add_identity(&mut out.tangent, mu_pa);
}

/// μ E : E, and 2μ F E.
fn saint_venant(mu_pa: f64, f: &Tensor, e: &Tensor) -> (f64, Tensor) {
    (mu_pa * e.iter().map(|x| x * x).sum::<f64>(), product(f, e).map(|x| 2.0 * mu_pa * x))
}

/// μ ε : ε, and 2μ ε.
fn linear(mu_pa: f64, f: &Tensor) -> (f64, Tensor) {
    let h = displacement_gradient(f);
    let mut stress = [0.0; 9];
    let mut energy = 0.0;
    for i in 0..3 {
        for j in 0..3 {
            let strain = 0.5 * (h[3 * i + j] + h[3 * j + i]);
            energy += mu_pa * strain * strain;
            stress[3 * i + j] = 2.0 * mu_pa * strain;
        }
    }
    (energy, stress)
}

/// How a law's bulk modulus is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bulk {
    /// K, Pa.
    ModulusPa(f64),
    /// ν of the body at small strain: K = 2μ (1 + ν)/(3 (1 − 2ν)), μ the law's shear modulus at rest.
    PoissonRatio(f64),
}

/// The largest Poisson's ratio: K is then 5000 times μ. Beyond, pressures lose digits and a body of any use doesn't
/// change.
pub const POISSON_RATIO_MAX: f64 = 0.4999;

/// # Constructors
///
/// All check what they are given, see [`Material::validate`].
impl Material {
    /// The default law, [`Material::NeoHookean`].
    ///
    /// # Errors
    /// Young's modulus is not positive, or Poisson's ratio is not in 0 to [`POISSON_RATIO_MAX`].
    pub fn neo_hookean(young_modulus_pa: f64, poisson_ratio: f64) -> Result<Self> {
        let moduli = from_young(young_modulus_pa, poisson_ratio)?;
        Material::NeoHookean { mu_pa: moduli.shear_pa, lambda_pa: moduli.lambda_pa() }.checked()
    }

    /// [`Material::IsochoricNeoHookean`].
    ///
    /// # Errors
    /// As [`Material::neo_hookean`].
    pub fn isochoric_neo_hookean(young_modulus_pa: f64, poisson_ratio: f64) -> Result<Self> {
        let Moduli { shear_pa, bulk_pa } = from_young(young_modulus_pa, poisson_ratio)?;
        Material::IsochoricNeoHookean { mu_pa: shear_pa, bulk_pa }.checked()
    }

    /// [`Material::StVenantKirchhoff`].
    ///
    /// # Errors
    /// As [`Material::neo_hookean`].
    pub fn st_venant_kirchhoff(young_modulus_pa: f64, poisson_ratio: f64) -> Result<Self> {
        let moduli = from_young(young_modulus_pa, poisson_ratio)?;
        Material::StVenantKirchhoff { mu_pa: moduli.shear_pa, lambda_pa: moduli.lambda_pa() }.checked()
    }

    /// [`Material::Linear`].
    ///
    /// # Errors
    /// As [`Material::neo_hookean`].
    pub fn linear(young_modulus_pa: f64, poisson_ratio: f64) -> Result<Self> {
        let moduli = from_young(young_modulus_pa, poisson_ratio)?;
        Material::Linear { mu_pa: moduli.shear_pa, lambda_pa: moduli.lambda_pa() }.checked()
    }

    /// [`Material::MooneyRivlin`].
    ///
    /// # Errors
    /// C₁₀ + C₀₁ is not positive, or the bulk modulus or Poisson's ratio is out of range.
    pub fn mooney_rivlin(c10_pa: f64, c01_pa: f64, bulk: Bulk) -> Result<Self> {
        Material::MooneyRivlin { c10_pa, c01_pa, bulk_pa: 0.0 }.with_bulk(bulk)
    }

    /// [`Material::Ogden`], of \[μ_p in Pa, α_p\].
    ///
    /// # Errors
    /// There are no terms, the sum of μ_p is not positive, an α_p is 0, or the bulk modulus or Poisson's ratio is out of
    /// range.
    pub fn ogden(terms: Vec<[f64; 2]>, bulk: Bulk) -> Result<Self> {
        Material::Ogden { terms, bulk_pa: 0.0 }.with_bulk(bulk)
    }

    /// [`Material::Yeoh`].
    ///
    /// # Errors
    /// c₁ is missing or not positive, or the bulk modulus or Poisson's ratio is out of range.
    pub fn yeoh(c_pa: Vec<f64>, bulk: Bulk) -> Result<Self> {
        Material::Yeoh { c_pa, bulk_pa: 0.0 }.with_bulk(bulk)
    }

    /// [`Material::FungDemiray`].
    ///
    /// # Errors
    /// μ or b is not positive, or the bulk modulus or Poisson's ratio is out of range.
    pub fn fung_demiray(mu_pa: f64, b: f64, bulk: Bulk) -> Result<Self> {
        Material::FungDemiray { mu_pa, b, bulk_pa: 0.0 }.with_bulk(bulk)
    }

    /// [`Material::VerondaWestmann`].
    ///
    /// # Errors
    /// C₁ or C₃ is not positive, or the bulk modulus or Poisson's ratio is out of range.
    pub fn veronda_westmann(c1_pa: f64, c3: f64, bulk: Bulk) -> Result<Self> {
        Material::VerondaWestmann { c1_pa, c3, bulk_pa: 0.0 }.with_bulk(bulk)
    }

    fn with_bulk(mut self, bulk: Bulk) -> Result<Self> {
        let shear_pa = self.small_strain().shear_pa;
        let value = match bulk {
            Bulk::ModulusPa(k) => k,
            Bulk::PoissonRatio(nu) => {
                check_poisson_ratio(nu)?;
                2.0 * shear_pa * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
            }
        };
        match &mut self {
            Material::NeoHookean { lambda_pa, .. }
            | Material::StVenantKirchhoff { lambda_pa, .. }
            | Material::Linear { lambda_pa, .. } => *lambda_pa = value - 2.0 / 3.0 * shear_pa,
            Material::IsochoricNeoHookean { bulk_pa, .. }
            | Material::MooneyRivlin { bulk_pa, .. }
            | Material::Ogden { bulk_pa, .. }
            | Material::Yeoh { bulk_pa, .. }
            | Material::FungDemiray { bulk_pa, .. }
            | Material::VerondaWestmann { bulk_pa, .. } => *bulk_pa = value,
        }
        self.checked()
    }

    fn checked(self) -> Result<Self> {
        self.validate()?;
        Ok(self)
    }

    /// Whether the law resists small changes of shape and of volume, which every law of use does. It says nothing of
    /// large strain: Mooney–Rivlin with a negative constant, Yeoh with a negative coefficient, St. Venant–Kirchhoff
    /// under compression may all lose stability, and a simulation then stops early.
    ///
    /// # Errors
    /// Names the first parameter, by its key in a spec, that is not finite or out of range.
    pub fn validate(&self) -> Result<()> {
        let invalid =
            |key: &str, problem: String, hint: &str| Err(SimulateError::invalid(key, problem, hint));
        for (key, value) in self.parameters() {
            if !value.is_finite() {
                return invalid(&key, format!("expected a number, found {value}"), "give a finite number");
            }
        }
        let positive: &[&str] = match self {
            Material::Ogden { terms, .. } => {
                if terms.is_empty() {
                    return invalid("terms", "there are none".into(), "give one [mu_pa, alpha] or more");
                }
                if let Some(i) = terms.iter().position(|[_, alpha]| alpha.abs() < 1e-3) {
                    let problem = format!("the exponent {} is too near 0", terms[i][1]);
                    return invalid(
                        &format!("terms[{i}]"),
                        problem,
                        "give an exponent of at least 0.001 in size",
                    );
                }
                &[]
            }
            Material::Yeoh { c_pa, .. } if c_pa.is_empty() => {
                return invalid("c_pa", "there are no coefficients".into(), "give one or more");
            }
            Material::FungDemiray { .. } => &["b"],
            Material::VerondaWestmann { .. } => &["c1_pa", "c3"],
            _ => &[],
        };
        for (key, value) in self.parameters() {
            if positive.contains(&key.as_str()) && value <= 0.0 {
                return invalid(
                    &key,
                    format!("expected more than 0, found {value}"),
                    "give a positive number",
                );
            }
        }
        let Moduli { shear_pa, bulk_pa } = self.small_strain();
        if shear_pa <= 0.0 {
            let (key, what) = match self {
                Material::MooneyRivlin { .. } => ("c10_pa", "2 (c10_pa + c01_pa)"),
                Material::Ogden { .. } => ("terms", "the sum of mu_pa"),
                Material::Yeoh { .. } => ("c_pa", "twice the first coefficient"),
                Material::VerondaWestmann { .. } => ("c1_pa", "c1_pa c3"),
                _ => ("mu_pa", "mu_pa"),
            };
            let problem = format!("the shear modulus at rest, {what}, is {shear_pa} Pa");
            return invalid(key, problem, "choose parameters that make it positive");
        }
        // K of ½ K θ² must not be negative either: mean dilatation takes it for an energy.
        let (key, value) = match self.measure() {
            VolumeMeasure::JMinusOne => ("bulk_modulus_pa", bulk_pa),
            _ => ("lambda_pa", self.bulk_pa()),
        };
        if value < 0.0 || bulk_pa <= 0.0 {
            return invalid(
                key,
                format!("the modulus against change of volume is {value} Pa"),
                "give a positive one",
            );
        }
        Ok(())
    }

    /// The parameters by their keys in a spec.
    fn parameters(&self) -> Vec<(String, f64)> {
        let named =
            |list: &[(&str, f64)]| list.iter().map(|(key, value)| (key.to_string(), *value)).collect();
        let bulk = ("bulk_modulus_pa", self.bulk_pa());
        match *self {
            Material::NeoHookean { mu_pa, lambda_pa }
            | Material::StVenantKirchhoff { mu_pa, lambda_pa }
            | Material::Linear { mu_pa, lambda_pa } => named(&[("mu_pa", mu_pa), ("lambda_pa", lambda_pa)]),
            Material::IsochoricNeoHookean { mu_pa, .. } => named(&[("mu_pa", mu_pa), bulk]),
            Material::MooneyRivlin { c10_pa, c01_pa, .. } => {
                named(&[("c10_pa", c10_pa), ("c01_pa", c01_pa), bulk])
            }
            Material::FungDemiray { mu_pa, b, .. } => named(&[("mu_pa", mu_pa), ("b", b), bulk]),
            Material::VerondaWestmann { c1_pa, c3, .. } => named(&[("c1_pa", c1_pa), ("c3", c3), bulk]),
            Material::Ogden { ref terms, .. } => {
                let mut all: Vec<_> = named(&[bulk]);
                for (i, [mu_pa, alpha]) in terms.iter().enumerate() {
                    all.extend([(format!("terms[{i}]"), *mu_pa), (format!("terms[{i}]"), *alpha)]);
                }
                all
            }
            Material::Yeoh { ref c_pa, .. } => {
                let mut all: Vec<_> = named(&[bulk]);
                all.extend(c_pa.iter().enumerate().map(|(i, c)| (format!("c_pa[{i}]"), *c)));
                all
            }
        }
    }
}

fn from_young(young_modulus_pa: f64, poisson_ratio: f64) -> Result<Moduli> {
    if !(young_modulus_pa.is_finite() && young_modulus_pa > 0.0) {
        let problem = format!("expected more than 0 Pa, found {young_modulus_pa}");
        return Err(SimulateError::invalid("young_modulus_pa", problem, "give a positive stiffness in Pa"));
    }
    check_poisson_ratio(poisson_ratio)?;
    Ok(Moduli::of_young(young_modulus_pa, poisson_ratio))
}

fn check_poisson_ratio(poisson_ratio: f64) -> Result<()> {
    if (0.0..=POISSON_RATIO_MAX).contains(&poisson_ratio) {
        return Ok(());
    }
    let problem = format!("expected 0 to {POISSON_RATIO_MAX}, found {poisson_ratio}");
    let hint = "soft tissue has 0.45 to 0.499; what can't change its volume is well served by 0.495";
    Err(SimulateError::invalid("poisson_ratio", problem, hint))
}
