//! `[material]`: a stored energy and its parameters.

use anyhow::Result;
use palpate_files::{List, Source};
use palpate_simulate::material::POISSON_RATIO_MAX;
use serde::Deserialize;
use std::ops::Range;
use toml::Spanned;

/// What tissue is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// How it resists a change of shape.
    pub law: MaterialLaw,
    /// How it resists a change of volume.
    pub volume: Volume,
}

/// The stored energy; I₁, I₂, λᵢ are those of the deformation without its change of volume, but for
/// [`MaterialLaw::NeoHookean`], [`MaterialLaw::StVenantKirchhoff`] and [`MaterialLaw::Linear`].
#[derive(Debug, Clone, PartialEq)]
pub enum MaterialLaw {
    /// μ/2 (I₁ − 3) − μ ln J + λ/2 (ln J)².
    NeoHookean {
        /// E, Pa.
        young_modulus_pa: f64,
    },
    /// μ/2 (I₁ − 3) + K/2 (J − 1)².
    NeoHookeanIsochoric {
        /// E, Pa.
        young_modulus_pa: f64,
    },
    /// c₁₀ (I₁ − 3) + c₀₁ (I₂ − 3).
    MooneyRivlin {
        /// Pa.
        c10_pa: f64,
        /// Pa.
        c01_pa: f64,
    },
    /// Σ 2μᵢ/αᵢ² (λ₁^αᵢ + λ₂^αᵢ + λ₃^αᵢ − 3), so that Σ μᵢ is the shear modulus at rest.
    Ogden {
        /// μᵢ in Pa, and αᵢ.
        terms: Vec<[f64; 2]>,
    },
    /// Σ cᵢ (I₁ − 3)ⁱ.
    Yeoh {
        /// c₁, c₂, …, Pa.
        c_pa: Vec<f64>,
    },
    /// μ/2b (exp(b (I₁ − 3)) − 1).
    FungDemiray {
        /// Pa.
        mu_pa: f64,
        /// –
        b: f64,
    },
    /// c₁ (exp(c₃ (I₁ − 3)) − 1) − c₁c₃/2 (I₂ − 3).
    VerondaWestmann {
        /// Pa.
        c1_pa: f64,
        /// –
        c3: f64,
    },
    /// λ/2 (tr E)² + μ E:E, with Green's strain.
    StVenantKirchhoff {
        /// E, Pa.
        young_modulus_pa: f64,
    },
    /// Small strains: forces in proportion to displacements.
    Linear {
        /// E, Pa.
        young_modulus_pa: f64,
    },
}

/// How a material resists a change of volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Volume {
    /// K, Pa.
    BulkModulus(f64),
    /// ν at rest.
    PoissonRatio(f64),
}

impl Material {
    /// μ at rest, Pa.
    pub fn shear_modulus_pa(&self) -> f64 {
        match &self.law {
            MaterialLaw::NeoHookean { young_modulus_pa: e }
            | MaterialLaw::NeoHookeanIsochoric { young_modulus_pa: e }
            | MaterialLaw::StVenantKirchhoff { young_modulus_pa: e }
            | MaterialLaw::Linear { young_modulus_pa: e } => match self.volume {
                Volume::PoissonRatio(nu) => e / (2.0 * (1.0 + nu)),
                Volume::BulkModulus(k) => 3.0 * k * e / (9.0 * k - e),
            },
            MaterialLaw::MooneyRivlin { c10_pa, c01_pa } => 2.0 * (c10_pa + c01_pa),
            MaterialLaw::Ogden { terms } => terms.iter().map(|[mu, _]| mu).sum(),
            MaterialLaw::Yeoh { c_pa } => 2.0 * c_pa.first().copied().unwrap_or_default(),
            MaterialLaw::FungDemiray { mu_pa, .. } => *mu_pa,
            MaterialLaw::VerondaWestmann { c1_pa, c3 } => c1_pa * c3,
        }
    }

    /// K at rest, Pa.
    pub fn bulk_modulus_pa(&self) -> f64 {
        match self.volume {
            Volume::BulkModulus(k) => k,
            Volume::PoissonRatio(nu) => 2.0 * self.shear_modulus_pa() * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu)),
        }
    }
}

/// The keys of `[material]`, and of each `[[material.region]]` those that say where it is.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawMaterial {
    model: Option<Spanned<String>>,
    form: Option<Spanned<String>>,
    young_modulus_pa: Option<Spanned<f64>>,
    poisson_ratio: Option<Spanned<f64>>,
    bulk_modulus_pa: Option<Spanned<f64>>,
    c10_pa: Option<Spanned<f64>>,
    c01_pa: Option<Spanned<f64>>,
    terms: Option<Spanned<Vec<List<2>>>>,
    c_pa: Option<Spanned<Vec<f64>>>,
    mu_pa: Option<Spanned<f64>>,
    b: Option<Spanned<f64>>,
    c1_pa: Option<Spanned<f64>>,
    c3: Option<Spanned<f64>>,
    pub group: Option<Spanned<String>>,
    pub sphere: Option<Spanned<RawSphere>>,
    pub ellipsoid: Option<Spanned<RawEllipsoid>>,
    pub box_mm: Option<Spanned<List<2, List<3>>>>,
    pub region: Option<Vec<Spanned<RawMaterial>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawSphere {
    pub centre_mm: Spanned<List<3>>,
    pub radius_mm: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawEllipsoid {
    pub centre_mm: Spanned<List<3>>,
    pub radii_mm: Spanned<List<3>>,
}

impl RawMaterial {
    fn given(&self) -> [(&'static str, Option<Range<usize>>); 12] {
        let span = |value: &Option<Spanned<f64>>| value.as_ref().map(Spanned::span);
        [
            ("form", self.form.as_ref().map(Spanned::span)),
            ("young_modulus_pa", span(&self.young_modulus_pa)),
            ("poisson_ratio", span(&self.poisson_ratio)),
            ("bulk_modulus_pa", span(&self.bulk_modulus_pa)),
            ("c10_pa", span(&self.c10_pa)),
            ("c01_pa", span(&self.c01_pa)),
            ("terms", self.terms.as_ref().map(Spanned::span)),
            ("c_pa", self.c_pa.as_ref().map(Spanned::span)),
            ("mu_pa", span(&self.mu_pa)),
            ("b", span(&self.b)),
            ("c1_pa", span(&self.c1_pa)),
            ("c3", span(&self.c3)),
        ]
    }
}

/// Poisson's ratio: elements that are nearly incompressible are solved, fully incompressible ones are not.
const POISSON: std::ops::RangeInclusive<f64> = 0.0..=POISSON_RATIO_MAX;
/// Moduli, Pa.
const MODULI: std::ops::RangeInclusive<f64> = 1e-3..=1e12;

const MODELS: &str = "give \"neo-hookean\", \"mooney-rivlin\", \"ogden\", \"yeoh\", \"fung-demiray\", \
                      \"veronda-westmann\", \"st-venant-kirchhoff\" or \"linear\"";

/// Reads the model and its parameters; `table` is its name in messages.
pub fn material(source: &Source, table: &str, raw: &Spanned<RawMaterial>) -> Result<Material> {
    let m = raw.get_ref();
    let Some(model) = &m.model else {
        let problem = format!("{table} names no model");
        return Err(source.error(raw.span(), &problem, &format!("add model: {}", &MODELS["give ".len()..])));
    };
    let name = model.get_ref().as_str();
    // What it needs; all others but one of the last two are refused.
    let needs: &[&str] = match name {
        "neo-hookean" | "st-venant-kirchhoff" | "linear" => &["young_modulus_pa"],
        "mooney-rivlin" => &["c10_pa", "c01_pa"],
        "ogden" => &["terms"],
        "yeoh" => &["c_pa"],
        "fung-demiray" => &["mu_pa", "b"],
        "veronda-westmann" => &["c1_pa", "c3"],
        other => {
            let problem = format!("there is no model `{}`", other.escape_debug());
            return Err(source.error(model.span(), &problem, MODELS));
        }
    };
    for (key, span) in m.given() {
        let volume = ["poisson_ratio", "bulk_modulus_pa"].contains(&key);
        let fits = needs.contains(&key) || volume || (key == "form" && name == "neo-hookean");
        match span {
            Some(span) if !fits => {
                let problem = format!("{name} has no {key}");
                let hint = format!("remove it; {name} takes {}", needs.join(", "));
                return Err(source.error(span, &problem, &hint));
            }
            None if needs.contains(&key) => {
                let problem = format!("{key} is missing: {name} needs it");
                return Err(source.error(model.span(), &problem, &format!("add {key} to {table}")));
            }
            _ => {}
        }
    }
    let volume = match (&m.poisson_ratio, &m.bulk_modulus_pa) {
        (Some(nu), None) => {
            if *nu.get_ref() > *POISSON.end() && *nu.get_ref() <= 0.5 {
                let problem =
                    format!("poisson_ratio is {}: the material can't change its volume", nu.get_ref());
                return Err(source.error(nu.span(), &problem, &format!("give {POISSON_RATIO_MAX} at most")));
            }
            Volume::PoissonRatio(source.within(nu, "poisson_ratio", POISSON)?)
        }
        (None, Some(k)) => Volume::BulkModulus(source.within(k, "bulk_modulus_pa", MODULI)?),
        (Some(_), Some(k)) => {
            let problem = "poisson_ratio and bulk_modulus_pa say the same";
            return Err(source.error(k.span(), problem, "keep one of them"));
        }
        (None, None) => {
            let problem = format!("{table} does not say how {name} resists a change of volume");
            return Err(source.error(model.span(), &problem, "add poisson_ratio or bulk_modulus_pa"));
        }
    };
    let number = |value: &Option<Spanned<f64>>, key, range| {
        value.as_ref().map_or(Ok(0.0), |v| source.within(v, key, range))
    };
    let young = || number(&m.young_modulus_pa, "young_modulus_pa", MODULI);
    let law = match name {
        "neo-hookean" => {
            let form = m.form.as_ref().map_or("compressible", |f| f.get_ref().as_str());
            match (form, &m.form) {
                ("isochoric", _) => MaterialLaw::NeoHookeanIsochoric { young_modulus_pa: young()? },
                (other, Some(form)) if other != "compressible" => {
                    let problem = format!("neo-hookean has no form `{}`", other.escape_debug());
                    let hint = "give form = \"compressible\" or \"isochoric\"";
                    return Err(source.error(form.span(), &problem, hint));
                }
                _ => MaterialLaw::NeoHookean { young_modulus_pa: young()? },
            }
        }
        "st-venant-kirchhoff" => MaterialLaw::StVenantKirchhoff { young_modulus_pa: young()? },
        "linear" => MaterialLaw::Linear { young_modulus_pa: young()? },
        "mooney-rivlin" => MaterialLaw::MooneyRivlin {
            c10_pa: number(&m.c10_pa, "c10_pa", -1e12..=1e12)?,
            c01_pa: number(&m.c01_pa, "c01_pa", -1e12..=1e12)?,
        },
        "fung-demiray" => MaterialLaw::FungDemiray {
            mu_pa: number(&m.mu_pa, "mu_pa", MODULI)?,
            b: number(&m.b, "b", 1e-6..=1e3)?,
        },
        "veronda-westmann" => MaterialLaw::VerondaWestmann {
            c1_pa: number(&m.c1_pa, "c1_pa", MODULI)?,
            c3: number(&m.c3, "c3", 1e-6..=1e3)?,
        },
        "ogden" => ogden(source, m)?,
        _ => yeoh(source, m)?,
    };
    let material = Material { law, volume };
    check_rest(source, name, model.span(), m, &material)?;
    Ok(material)
}

fn ogden(source: &Source, m: &RawMaterial) -> Result<MaterialLaw> {
    let Some(terms) = &m.terms else { return Ok(MaterialLaw::Ogden { terms: Vec::new() }) };
    let rows = terms.get_ref();
    if rows.is_empty() || rows.len() > 8 {
        let problem = format!("terms has {} rows", rows.len());
        return Err(source.error(terms.span(), &problem, "give 1 to 8 rows [mu_pa, alpha]"));
    }
    for List([mu, alpha]) in rows {
        if !(mu.abs() <= 1e12 && alpha.abs() >= 1e-3 && alpha.abs() <= 100.0) {
            let problem = format!("terms has the row [{mu}, {alpha}]");
            return Err(source.error(
                terms.span(),
                &problem,
                "give finite mu_pa, and alpha between 0.001 and 100 or −100 and −0.001",
            ));
        }
    }
    Ok(MaterialLaw::Ogden { terms: rows.iter().map(|row| row.0).collect() })
}

fn yeoh(source: &Source, m: &RawMaterial) -> Result<MaterialLaw> {
    let Some(c) = &m.c_pa else { return Ok(MaterialLaw::Yeoh { c_pa: Vec::new() }) };
    let values = c.get_ref();
    if values.is_empty() || values.len() > 6 || values.iter().any(|c| c.is_nan() || c.abs() > 1e12) {
        let problem = format!("c_pa is {values:?}");
        return Err(source.error(c.span(), &problem, "give 1 to 6 finite numbers"));
    }
    Ok(MaterialLaw::Yeoh { c_pa: values.clone() })
}

/// At rest a body must resist every change, and its Poisson ratio must be one that is solved.
fn check_rest(
    source: &Source,
    name: &str,
    span: Range<usize>,
    m: &RawMaterial,
    material: &Material,
) -> Result<()> {
    let (mu, k) = (material.shear_modulus_pa(), material.bulk_modulus_pa());
    if !MODULI.contains(&mu) && !matches!(material.volume, Volume::BulkModulus(_)) {
        let problem = format!("at rest {name}'s shear modulus is {mu} Pa with these parameters");
        return Err(source.error(span, &problem, "correct them so that it is positive"));
    }
    if let (Volume::BulkModulus(_), Some(key)) = (material.volume, &m.bulk_modulus_pa) {
        let nu = (3.0 * k - 2.0 * mu) / (2.0 * (3.0 * k + mu));
        if !(mu > 0.0 && POISSON.contains(&nu)) {
            let problem = format!(
                "with shear modulus {mu} Pa the bulk modulus {k} Pa means a Poisson ratio of {nu:.4}"
            );
            return Err(source.error(
                key.span(),
                &problem,
                &format!("give one that means 0 to {POISSON_RATIO_MAX}, or poisson_ratio"),
            ));
        }
    }
    Ok(())
}
