//! The spec: what a body is made from, in TOML, with the unit of every length in its key.

mod source;

use crate::files;
use crate::law::{Law, Variation};
use anyhow::{Result, anyhow};
use palpate_body::import::LengthUnit;
use palpate_body::shape::{Resolution, Shape, ShapeSpec};
use palpate_body::{BodyError, SlipRule, Tool};
use serde::Deserialize;
use source::Source;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// A checked spec, in SI units.
#[derive(Debug, Clone)]
pub struct Spec {
    /// As it was read.
    pub text: String,
    /// Where the surface comes from.
    pub geometry: Option<Geometry>,
    /// Of a mesh's coordinates.
    pub unit: Option<LengthUnit>,
    /// Whether borders are allowed.
    pub open: bool,
    /// Edges that turn by more are creases, rad.
    pub crease_angle: Option<f64>,
    /// Coefficients over depth.
    pub friction: Option<Friction>,
    /// How far the responses reach.
    pub deflection: Option<Deflection>,
    /// The tool the responses hold for.
    pub tool: Tool,
    /// How the contact point slips.
    pub slip: SlipRule,
    /// Responses by a formula.
    pub law: Option<Law>,
    /// Tables and keys that this version reads but does not use.
    pub ignored: Vec<&'static str>,
}

/// Where the surface comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Geometry {
    /// A mesh file.
    Mesh(PathBuf),
    /// A shape that meshes itself.
    Shape(Shape, Resolution),
}

/// The friction coefficient over depth.
#[derive(Debug, Clone, PartialEq)]
pub enum Friction {
    /// The same everywhere.
    Constant(f64),
    /// Straight lines between depths (m), the first of them 0.
    Table(Vec<(f64, f64)>),
}

/// How far the responses reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deflection {
    /// m.
    pub normal_max_m: f64,
    /// m.
    pub lateral_max_m: f64,
    /// Equal intervals between knots.
    pub steps: u32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    body: Option<RawBody>,
    material: Option<toml::Value>,
    tool: Option<Spanned<RawTool>>,
    friction: Option<Spanned<RawFriction>>,
    deflection: Option<RawDeflection>,
    test_points: Option<toml::Value>,
    slip: Option<RawSlip>,
    response: Option<RawResponse>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawBody {
    mesh: Option<Spanned<PathBuf>>,
    unit: Option<LengthUnit>,
    #[serde(default)]
    open: bool,
    crease_angle_deg: Option<Spanned<f64>>,
    shape: Option<Spanned<ShapeSpec>>,
    fixed: Option<toml::Value>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTool {
    shape: Spanned<String>,
    radius_mm: Option<Spanned<f64>>,
    contact: Option<toml::Value>,
    patch_radius_mm: Option<toml::Value>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFriction {
    coefficient: Option<Spanned<f64>>,
    depth_mm: Option<Spanned<Vec<f64>>>,
    coefficients: Option<Spanned<Vec<f64>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawDeflection {
    normal_max_mm: Spanned<f64>,
    lateral_max_mm: Spanned<f64>,
    steps: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSlip {
    rule: Spanned<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawResponse {
    law: Spanned<String>,
    stiffness_n_per_m: Spanned<f64>,
    lateral_stiffness_n_per_m: Spanned<f64>,
    around: Option<Spanned<f64>>,
    along: Option<Spanned<f64>>,
}

/// Intervals between knots when the spec does not say: a quadratic law needs one, but K_max is reported at knots.
const STEPS: u32 = 8;

impl Spec {
    /// Reads and checks a spec.
    ///
    /// # Errors
    /// The file can't be read; an unknown or missing key; a value that is impossible. The message names the line.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(path, files::read_text(path)?)
    }

    /// Checks a spec's `text`; `path` is its name in messages, and mesh paths are relative to its folder.
    ///
    /// # Errors
    /// As [`Spec::read`].
    pub fn parse(path: &Path, text: String) -> Result<Self> {
        let source = Source { path, text: &text };
        let raw: Raw = toml::from_str(&text).map_err(|e| source.syntax(&e))?;
        let mut ignored = Vec::new();
        let body = raw.body.as_ref();
        let given = [
            ("[material]", raw.material.is_some()),
            ("[test_points]", raw.test_points.is_some()),
            ("[[body.fixed]]", body.is_some_and(|b| b.fixed.is_some())),
            (
                "[tool] contact",
                raw.tool
                    .as_ref()
                    .is_some_and(|t| t.get_ref().contact.is_some() || t.get_ref().patch_radius_mm.is_some()),
            ),
        ];
        ignored.extend(given.into_iter().filter(|(_, given)| *given).map(|(name, _)| name));
        let geometry = body.map(|b| geometry(&source, b)).transpose()?.flatten();
        let crease_angle = body
            .and_then(|b| b.crease_angle_deg.as_ref())
            .map(|angle| source.within(angle, "crease_angle_deg", 0.0..=180.0).map(f64::to_radians));
        let law = raw.response.as_ref().map(|r| law(&source, r)).transpose()?;
        Ok(Spec {
            geometry,
            unit: body.and_then(|b| b.unit),
            open: body.is_some_and(|b| b.open),
            crease_angle: crease_angle.transpose()?,
            friction: raw.friction.as_ref().map(|f| friction(&source, f)).transpose()?,
            deflection: raw.deflection.as_ref().map(|d| deflection(&source, d)).transpose()?,
            tool: raw.tool.as_ref().map_or(Ok(Tool::point()), |t| tool(&source, t))?,
            slip: raw.slip.as_ref().map_or(Ok(SlipRule::Paper), |s| slip(&source, s))?,
            law,
            ignored,
            text,
        })
    }
}

fn geometry(source: &Source, body: &RawBody) -> Result<Option<Geometry>> {
    match (&body.mesh, &body.shape) {
        (Some(_), Some(shape)) => {
            Err(source.error(shape.span(), "[body] has a mesh and a shape", "keep one of them"))
        }
        (Some(mesh), None) => {
            let folder = source.path.parent().unwrap_or(Path::new(""));
            Ok(Some(Geometry::Mesh(folder.join(mesh.get_ref()))))
        }
        (None, Some(shape)) => {
            let (shape, resolution) = shape.get_ref().resolve().map_err(|e| {
                // The complaint's place is the key's name.
                let key = match &e {
                    BodyError::Invalid { place, .. } => place.rsplit(' ').next().unwrap_or_default(),
                    BodyError::Io { .. } => "",
                };
                anyhow!("{}: {e}", source.place(source.find_key(shape.span(), key)))
            })?;
            Ok(Some(Geometry::Shape(shape, resolution)))
        }
        (None, None) => Ok(None),
    }
}

fn friction(source: &Source, raw: &Spanned<RawFriction>) -> Result<Friction> {
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

fn deflection(source: &Source, raw: &RawDeflection) -> Result<Deflection> {
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

fn tool(source: &Source, raw: &Spanned<RawTool>) -> Result<Tool> {
    let tool = raw.get_ref();
    match (tool.shape.get_ref().as_str(), &tool.radius_mm) {
        ("point", None) => Ok(Tool::point()),
        ("point", Some(radius)) => Err(source.error(
            radius.span(),
            "a point has no radius",
            "remove radius_mm, or say shape = \"sphere\"",
        )),
        ("sphere", Some(radius)) => Ok(Tool::sphere(source.within(radius, "radius_mm", 1e-3..=1e3)? / 1e3)),
        ("sphere", None) => Err(source.error(raw.span(), "the sphere's radius is missing", "add radius_mm")),
        (other, _) => Err(source.error(
            tool.shape.span(),
            &format!("this version has no tool `{}`", other.escape_debug()),
            "give shape = \"point\" or \"sphere\"",
        )),
    }
}

fn slip(source: &Source, raw: &RawSlip) -> Result<SlipRule> {
    match raw.rule.get_ref().as_str() {
        "paper" => Ok(SlipRule::Paper),
        "consistent" | "exact" => Err(source.error(
            raw.rule.span(),
            &format!("this version does not have the slip rule `{}` yet", raw.rule.get_ref()),
            "give rule = \"paper\"",
        )),
        other => Err(source.error(
            raw.rule.span(),
            &format!("there is no slip rule `{}`", other.escape_debug()),
            "give rule = \"paper\"",
        )),
    }
}

fn law(source: &Source, raw: &RawResponse) -> Result<Law> {
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
                let mend = "remove it, or say law = \"paper-cylinder\"";
                return Err(source.error(extra.span(), "the uniform law does not vary", mend));
            }
            Variation::default()
        }
        other => {
            let problem = format!("there is no law `{}`", other.escape_debug());
            return Err(source.error(raw.law.span(), &problem, "give \"paper-cylinder\" or \"uniform\""));
        }
    };
    Ok(Law {
        normal_n_per_m: stiffness(&raw.stiffness_n_per_m, "stiffness_n_per_m")?,
        lateral_n_per_m: stiffness(&raw.lateral_stiffness_n_per_m, "lateral_stiffness_n_per_m")?,
        variation,
    })
}
