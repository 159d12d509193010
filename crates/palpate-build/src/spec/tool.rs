//! `[tool]`: its shape, and how the body holds to it in a simulation.

use anyhow::Result;
use palpate_body::Tool;
use palpate_body::import::LengthUnit;
use palpate_files::Source;
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// A rigid tool.
#[derive(Debug, Clone, PartialEq)]
pub enum ToolShape {
    /// A tip without extent.
    Point,
    /// A ball.
    Sphere {
        /// m.
        radius_m: f64,
    },
    /// A cylinder's flat end.
    FlatPunch {
        /// m.
        radius_m: f64,
    },
    /// A cone whose tip is rounded.
    Cone {
        /// Between axis and flank, rad.
        half_angle_rad: f64,
        /// Of the ball that rounds the tip, m.
        tip_radius_m: f64,
    },
    /// A ball drawn out along a line.
    Capsule {
        /// m.
        radius_m: f64,
        /// Between the middles of its ends, m.
        length_m: f64,
    },
    /// A closed surface.
    Mesh {
        /// Its file.
        file: PathBuf,
        /// Of the file's coordinates.
        unit: LengthUnit,
    },
}

/// How the body holds to the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Contact {
    /// What touches is caught, from first touch on: friction without limit.
    Sticking,
    /// Pressed, it slides along the tool and may leave it.
    Frictionless,
    /// A patch of the surface moves with the tool.
    Bonded {
        /// Geodesic, m.
        patch_radius_m: f64,
    },
}

impl Contact {
    /// As specs name it.
    pub fn name(self) -> &'static str {
        match self {
            Contact::Sticking => "sticking",
            Contact::Frictionless => "frictionless",
            Contact::Bonded { .. } => "bonded",
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawTool {
    shape: Spanned<String>,
    radius_mm: Option<Spanned<f64>>,
    half_angle_deg: Option<Spanned<f64>>,
    tip_radius_mm: Option<Spanned<f64>>,
    length_mm: Option<Spanned<f64>>,
    file: Option<Spanned<PathBuf>>,
    unit: Option<Spanned<LengthUnit>>,
    pub contact: Option<Spanned<String>>,
    pub patch_radius_mm: Option<Spanned<f64>>,
}

impl RawTool {
    /// The keys that describe the shape, and where those that were given stand.
    fn given(&self) -> [(&'static str, Option<Range<usize>>); 6] {
        [
            ("radius_mm", self.radius_mm.as_ref().map(Spanned::span)),
            ("half_angle_deg", self.half_angle_deg.as_ref().map(Spanned::span)),
            ("tip_radius_mm", self.tip_radius_mm.as_ref().map(Spanned::span)),
            ("length_mm", self.length_mm.as_ref().map(Spanned::span)),
            ("file", self.file.as_ref().map(Spanned::span)),
            ("unit", self.unit.as_ref().map(Spanned::span)),
        ]
    }
}

impl ToolShape {
    /// As a body's file names it: a pose gives a ball's middle, and the tip of all others.
    pub fn of_body(&self) -> Tool {
        match self {
            ToolShape::Point => Tool::Point,
            ToolShape::Sphere { radius_m } => Tool::Sphere { radius_m: *radius_m },
            ToolShape::FlatPunch { .. } => Tool::FlatPunch,
            ToolShape::Cone { .. } => Tool::Cone,
            ToolShape::Capsule { .. } => Tool::Capsule,
            ToolShape::Mesh { .. } => Tool::Mesh,
        }
    }
}

/// Lengths of a tool, mm.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-3..=1e3;

pub fn tool(source: &Source, raw: &Spanned<RawTool>) -> Result<ToolShape> {
    let tool = raw.get_ref();
    let shape = tool.shape.get_ref().as_str();
    let needs: &[&str] = match shape {
        "point" => &[],
        "sphere" | "flat-punch" => &["radius_mm"],
        "cone" => &["half_angle_deg", "tip_radius_mm"],
        "capsule" => &["radius_mm", "length_mm"],
        "mesh" => &["file", "unit"],
        other => {
            let problem = format!("this version has no tool `{}`", other.escape_debug());
            let hint =
                "give shape = \"point\", \"sphere\", \"flat-punch\", \"cone\", \"capsule\" or \"mesh\"";
            return Err(source.error(tool.shape.span(), &problem, hint));
        }
    };
    for (key, span) in tool.given() {
        match span {
            None if needs.contains(&key) => {
                let problem = format!("the tool's {key} is missing: a {shape} needs it");
                return Err(source.error(raw.span(), &problem, &format!("add {key}")));
            }
            Some(span) if !needs.contains(&key) => {
                let problem = format!("a {shape} has no {key}");
                return Err(source.error(span, &problem, "remove it, or name another shape"));
            }
            _ => {}
        }
    }
    // Whatever the shape needs is there by now.
    let length = |value: &Option<Spanned<f64>>, key| {
        value.as_ref().map_or(Ok(0.0), |v| source.within(v, key, LENGTHS)).map(|mm| mm / 1e3)
    };
    let radius_m = length(&tool.radius_mm, "radius_mm")?;
    Ok(match shape {
        "sphere" => ToolShape::Sphere { radius_m },
        "flat-punch" => ToolShape::FlatPunch { radius_m },
        "cone" => {
            let angle = tool.half_angle_deg.as_ref();
            let angle = angle.map_or(Ok(0.0), |a| source.within(a, "half_angle_deg", 5.0..=85.0))?;
            let tip_radius_m = length(&tool.tip_radius_mm, "tip_radius_mm")?;
            ToolShape::Cone { half_angle_rad: angle.to_radians(), tip_radius_m }
        }
        "capsule" => ToolShape::Capsule { radius_m, length_m: length(&tool.length_mm, "length_mm")? },
        "mesh" => {
            let file = tool.file.as_ref().map(|f| f.get_ref().as_path()).unwrap_or(Path::new(""));
            let unit = tool.unit.as_ref().map_or(LengthUnit::Millimetre, |u| *u.get_ref());
            ToolShape::Mesh { file: source.beside(file), unit }
        }
        _ => ToolShape::Point,
    })
}

/// The contact; `default` where the spec says nothing.
pub fn contact(source: &Source, raw: &Spanned<RawTool>, shape: &ToolShape, default: &str) -> Result<Contact> {
    let tool = raw.get_ref();
    let patch = &tool.patch_radius_mm;
    let given = tool.contact.as_ref();
    let contact = match given.map_or(default, |c| c.get_ref().as_str()) {
        "sticking" => Contact::Sticking,
        "frictionless" => Contact::Frictionless,
        "bonded" => match patch {
            Some(patch) => {
                let patch_radius_m = source.within(patch, "patch_radius_mm", LENGTHS)? / 1e3;
                return Ok(Contact::Bonded { patch_radius_m });
            }
            None => {
                let problem = "the bonded patch's radius is missing";
                let place = given.map_or(raw.span(), Spanned::span);
                return Err(source.error(place, problem, "add patch_radius_mm"));
            }
        },
        other => {
            return Err(source.error(
                given.map_or(raw.span(), Spanned::span),
                &format!("there is no contact `{}`", other.escape_debug()),
                "give contact = \"sticking\", \"frictionless\" or \"bonded\"",
            ));
        }
    };
    if let Some(patch) = patch {
        let problem = format!("a {} contact finds its patch itself", contact.name());
        let hint = "remove patch_radius_mm, or say contact = \"bonded\"";
        return Err(source.error(patch.span(), &problem, hint));
    }
    if *shape == ToolShape::Point {
        let problem = "a point's force on a body is not defined: it has no extent to press with";
        let hint =
            "give the tool an extent (shape = \"sphere\"), or contact = \"bonded\" with patch_radius_mm";
        return Err(source.error(tool.shape.span(), problem, hint));
    }
    Ok(contact)
}
