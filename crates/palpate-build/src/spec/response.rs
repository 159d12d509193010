//! Tables that say what a contact answers with: friction, how far, slip, and laws instead of simulation.

use super::{Deflection, Friction};
use crate::law::{AnalyticLaw, Variation};
use anyhow::Result;
use palpate_body::SlipRule;
use palpate_files::Source;
use serde::Deserialize;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawFriction {
    coefficient: Option<Spanned<f64>>,
    depth_mm: Option<Spanned<Vec<f64>>>,
    coefficients: Option<Spanned<Vec<f64>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawDeflection {
    pub normal_max_mm: Spanned<f64>,
    pub lateral_max_mm: Spanned<f64>,
    pub steps: Option<Spanned<i64>>,
    pub lateral_depths_mm: Option<Spanned<Vec<f64>>>,
    pub directions: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawSlip {
    rule: Option<Spanned<String>>,
    tank: Option<bool>,
    pub partial: Option<bool>,
}

impl RawSlip {
    /// Whether slip is kept from giving out energy; of what a spec makes it is.
    pub fn tank(&self) -> bool {
        self.tank.unwrap_or(true)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawResponse {
    law: Spanned<String>,
    stiffness_n_per_m: Spanned<f64>,
    lateral_stiffness_n_per_m: Spanned<f64>,
    around: Option<Spanned<f64>>,
    along: Option<Spanned<f64>>,
}

/// Intervals between knots when the spec does not say: a quadratic law needs one, but K_max is reported at knots.
const STEPS: u32 = 8;

pub fn friction(source: &Source, raw: &Spanned<RawFriction>) -> Result<Friction> {
    let table = raw.get_ref();
    let coefficient = |value: f64, span| match value {
        v if (0.0..=100.0).contains(&v) => Ok(v),
        v => {
            Err(source.error(span, &format!("the friction coefficient is {v}"), "give one between 0 and 100"))
        }
    };
    match (&table.coefficient, &table.depth_mm, &table.coefficients) {
        (Some(c), None, None) => Ok(Friction::Constant(coefficient(*c.get_ref(), c.span())?)),
        (None, Some(depths), Some(values)) => {
            let (d, v) = (depths.get_ref(), values.get_ref());
            if d.len() != v.len() || d.len() < 2 || d.len() > 100 {
                let problem = format!("depth_mm has {} values and coefficients has {}", d.len(), v.len());
                return Err(source.error(values.span(), &problem, "give 2 to 100, as many of each"));
            }
            let ascends = d[0] == 0.0 && d.windows(2).all(|d| d[1] - d[0] >= 1e-6 && d[1] <= 1e4);
            if !ascends {
                let problem = format!("depth_mm is {d:?}");
                return Err(source.error(depths.span(), &problem, "let it begin at 0 and ascend, in mm"));
            }
            let rows = d.iter().zip(v).map(|(d, v)| Ok((d / 1e3, coefficient(*v, values.span())?)));
            Ok(Friction::Table(rows.collect::<Result<_>>()?))
        }
        _ => Err(source.error(
            raw.span(),
            "[friction] is incomplete or says it twice",
            "give coefficient, or depth_mm and coefficients",
        )),
    }
}

pub fn deflection(source: &Source, raw: &RawDeflection) -> Result<Deflection> {
    let length = |value, key| source.within(value, key, 1e-3..=1e3).map(|mm| mm / 1e3);
    let steps = match &raw.steps {
        Some(steps) => match u32::try_from(*steps.get_ref()) {
            Ok(n @ 1..=200) => n,
            _ => {
                let problem = format!("steps is {}", steps.get_ref());
                return Err(source.error(steps.span(), &problem, "give a number between 1 and 200"));
            }
        },
        None => STEPS,
    };
    Ok(Deflection {
        normal_max_m: length(&raw.normal_max_mm, "normal_max_mm")?,
        lateral_max_m: length(&raw.lateral_max_mm, "lateral_max_mm")?,
        steps,
    })
}

pub fn slip(source: &Source, raw: &RawSlip) -> Result<SlipRule> {
    let Some(rule) = &raw.rule else { return Ok(SlipRule::default()) };
    SlipRule::ALL.into_iter().find(|r| r.name() == rule.get_ref()).ok_or_else(|| {
        source.error(
            rule.span(),
            &format!("there is no slip rule `{}`", rule.get_ref().escape_debug()),
            "give rule = \"consistent\", \"paper\" or \"exact\"",
        )
    })
}

pub fn law(source: &Source, raw: &RawResponse) -> Result<AnalyticLaw> {
    let stiffness = |value, key| source.within(value, key, 1e-3..=1e9);
    // 1 itself would make the stiffness vanish somewhere.
    let share = |value: &Option<Spanned<f64>>, key| {
        value.as_ref().map_or(Ok(0.0), |v| source.within(v, key, 0.0..=0.999))
    };
    let variation = match raw.law.get_ref().as_str() {
        "paper-cylinder" => {
            Variation { around: share(&raw.around, "around")?, along: share(&raw.along, "along")? }
        }
        "uniform" => {
            if let Some(extra) = raw.around.as_ref().or(raw.along.as_ref()) {
                let hint = "remove it, or say law = \"paper-cylinder\"";
                return Err(source.error(extra.span(), "the uniform law does not vary", hint));
            }
            Variation::default()
        }
        other => {
            let problem = format!("there is no law `{}`", other.escape_debug());
            return Err(source.error(raw.law.span(), &problem, "give \"paper-cylinder\" or \"uniform\""));
        }
    };
    Ok(AnalyticLaw {
        normal_n_per_m: stiffness(&raw.stiffness_n_per_m, "stiffness_n_per_m")?,
        lateral_n_per_m: stiffness(&raw.lateral_stiffness_n_per_m, "lateral_stiffness_n_per_m")?,
        variation,
    })
}
