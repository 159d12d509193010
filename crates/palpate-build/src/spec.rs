//! The spec: what a body is made from, in TOML, with the unit of every length in its key.

mod material;
mod response;
mod simulation;
mod tool;

pub use material::{Material, MaterialLaw, Volume};
pub use simulation::{COUNT, Fixed, Law, MeshSizes, Place, Region, Selection, Simulation, TestPoints};
pub use tool::{Contact, ToolShape};

use crate::law::AnalyticLaw;
use anyhow::{Result, anyhow};
use palpate_body::import::LengthUnit;
use palpate_body::shape::{Resolution, Shape, ShapeSpec};
use palpate_body::{BodyError, SlipRule, Tool};
use palpate_files as files;
use palpate_files::Source;
use response::{RawDeflection, RawFriction, RawResponse, RawSlip, deflection, friction, law, slip};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use toml::Spanned;
use tool::{RawTool, tool};

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
    /// How far facets may be from the smooth surface, m; 0: as they are. `None`: the spec does not say.
    pub sagitta_m: Option<f64>,
    /// Whether a simulated body keeps its displacement fields. `None`: the spec does not say.
    pub displacements: Option<bool>,
    /// Coefficients over depth.
    pub friction: Option<Friction>,
    /// How far the responses reach.
    pub deflection: Option<Deflection>,
    /// The tool the responses hold for.
    pub tool: Tool,
    /// How the contact point slips.
    pub slip: SlipRule,
    /// Whether slip is kept from giving out energy.
    pub tank: bool,
    /// Whether contacts are two contact points side by side; where nothing is said, those of coupled laws are.
    pub partial_slip: Option<bool>,
    /// Responses by a formula.
    pub law: Option<AnalyticLaw>,
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
    /// Equal intervals between knots; of a simulation, states along a path.
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
    fit: Option<toml::Value>,
    mesh: Option<toml::Value>,
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
    sagitta_um: Option<Spanned<f64>>,
    displacements: Option<bool>,
    shape: Option<Spanned<ShapeSpec>>,
    fixed: Option<toml::Value>,
}

impl Spec {
    /// What paths that are simulated depend on, as text: the spec without how it is fitted and slips, and of its test points only their
    /// places, by which the mesh is finer in parts.
    pub fn without_fit(&self) -> String {
        let Ok(mut tables) = self.text.parse::<toml::Table>() else { return self.text.clone() };
        tables.remove("fit");
        tables.remove("slip");
        if let Some(points) = tables.get_mut("test_points").and_then(toml::Value::as_table_mut) {
            points.retain(|key, _| ["at_mm", "box_mm"].contains(&key));
            if points.is_empty() {
                tables.remove("test_points");
            }
        }
        tables.to_string()
    }

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
            ("[mesh]", raw.mesh.is_some()),
            ("[fit]", raw.fit.is_some()),
            ("[[body.fixed]]", body.is_some_and(|b| b.fixed.is_some())),
            ("[body] displacements", body.is_some_and(|b| b.displacements.is_some())),
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
        let sagitta = body
            .and_then(|b| b.sagitta_um.as_ref())
            .map(|sagitta| source.within(sagitta, "sagitta_um", 0.0..=1e6).map(|um| um * 1e-6));
        let law = raw.response.as_ref().map(|r| law(&source, r)).transpose()?;
        Ok(Spec {
            geometry,
            unit: body.and_then(|b| b.unit),
            open: body.is_some_and(|b| b.open),
            crease_angle: crease_angle.transpose()?,
            sagitta_m: sagitta.transpose()?,
            displacements: body.and_then(|b| b.displacements),
            friction: raw.friction.as_ref().map(|f| friction(&source, f)).transpose()?,
            deflection: raw.deflection.as_ref().map(|d| deflection(&source, d)).transpose()?,
            tool: raw.tool.as_ref().map_or(Ok(ToolShape::Point), |t| tool(&source, t))?.of_body(),
            slip: raw.slip.as_ref().map_or(Ok(SlipRule::default()), |s| slip(&source, s))?,
            tank: raw.slip.as_ref().is_none_or(RawSlip::tank),
            partial_slip: raw.slip.as_ref().and_then(|s| s.partial),
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
        (Some(mesh), None) => Ok(Some(Geometry::Mesh(source.beside(mesh.get_ref())))),
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
