//! Measured or given curves on a surface: the body that `palpate fit` makes.

use crate::refine::to_sagitta;
use crate::spec::{Friction, Geometry, Spec};
use anyhow::{Context, Result, anyhow, bail};
use glam::DVec3;
use palpate_body::import::{self, LengthUnit};
use palpate_body::repair::{self, Options};
use palpate_body::shape::Shape;
use palpate_body::{BlendWeights, Body, Interpolation, Provenance, SlipRule, Surface, Tool, TriangleMesh};
use palpate_files as files;
use palpate_identify::{BodyOptions, Fit, FitOptions, FitReport, fit, read_samples};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a body is made of: a mesh, or a shape in the spec; samples, or a law in the spec.
#[derive(Debug, Clone, Default)]
pub struct FitInputs {
    /// A surface mesh; goes before the spec's.
    pub mesh: Option<PathBuf>,
    /// Unit of the mesh's coordinates; goes before the spec's.
    pub unit: Option<LengthUnit>,
    /// A Samples CSV; goes before the spec's law.
    pub samples: Option<PathBuf>,
    /// A spec, and its file's name for messages.
    pub spec: Option<(Spec, PathBuf)>,
    /// Friction coefficient where the samples give none; goes before the spec's.
    pub friction: Option<f64>,
    /// How curves pass between samples.
    pub interpolation: Between,
    /// Whether the surface may have borders.
    pub open: bool,
    /// Edges that turn by more than this stay sharp, rad; goes before the spec's.
    pub crease_angle: Option<f64>,
    /// What made it, for the body's provenance.
    pub command: String,
}

/// How curves pass between samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Between {
    /// Monotone cubics.
    #[default]
    Pchip,
    /// Straight lines.
    Linear,
}

/// A body that was made of samples or a law.
#[derive(Debug)]
pub struct FittedBody {
    /// It.
    pub body: Body,
    /// What was repaired or assumed; the body's provenance has them too.
    pub notes: Vec<String>,
    /// Of the samples, if it comes from some.
    pub report: Option<FitReport>,
}

impl FitInputs {
    /// The files that are read.
    pub fn files(&self) -> Vec<&Path> {
        let spec = self.spec.as_ref().map(|(_, path)| path.as_path());
        [spec, self.mesh_file(), self.samples.as_deref()].into_iter().flatten().collect()
    }

    fn mesh_file(&self) -> Option<&Path> {
        match (&self.mesh, self.spec.as_ref().and_then(|(spec, _)| spec.geometry.as_ref())) {
            (Some(mesh), _) | (None, Some(Geometry::Mesh(mesh))) => Some(mesh),
            _ => None,
        }
    }

    fn spec(&self) -> Option<&Spec> {
        self.spec.as_ref().map(|(spec, _)| spec)
    }

    fn spec_file(&self) -> &Path {
        self.spec.as_ref().map_or(Path::new("spec"), |(_, path)| path)
    }

    /// Makes the body.
    ///
    /// # Errors
    /// A file can't be read, or something in it is wrong; a value that is impossible; nothing says where surface or curves come
    /// from. The message names file and place.
    pub fn body(&self) -> Result<FittedBody> {
        let mut notes = Vec::new();
        if let Some((spec, path)) = &self.spec {
            let unused = spec.ignored.iter();
            notes.extend(
                unused.map(|key| format!("{}: {key} is for simulations; it is ignored here", path.display())),
            );
        }
        let surface = self.surface(&mut notes)?;
        notes.extend(folds(&surface));
        let (fitted, is_measured) = self.responses(&surface)?;
        let report = is_measured.then(|| fitted.report.clone());
        let inputs = self.files();
        let spec = self.spec();
        let provenance = Provenance {
            command: self.command.clone(),
            software: concat!("palpate ", env!("CARGO_PKG_VERSION")).into(),
            spec: spec.map(|s| s.text.clone()),
            inputs: digests(&inputs)?,
            notes,
            ..Provenance::default()
        };
        let options = BodyOptions {
            tool: spec.map_or(Tool::Point, |s| s.tool),
            slip: spec.map_or_else(SlipRule::default, |s| s.slip),
            tank: spec.is_none_or(|s| s.tank),
            partial_slip: spec.and_then(|s| s.partial_slip).unwrap_or(false),
            provenance,
        };
        let body = fitted.into_body(surface, options);
        let named = |e: palpate_body::BodyError| {
            inputs.first().map_or_else(|| anyhow!("{e}"), |input| anyhow!("{}: {e}", input.display()))
        };
        let sagitta_m = spec.and_then(|s| s.sagitta_m).unwrap_or(0.0);
        let body = body.and_then(|body| to_sagitta(body, sagitta_m)).map_err(named)?;
        let notes = body.provenance().notes.clone();
        Ok(FittedBody { body, notes, report })
    }

    /// The surface, repaired.
    fn surface(&self, notes: &mut Vec<String>) -> Result<Surface> {
        let spec = self.spec();
        let crease_angle = self.crease_angle.or(spec.and_then(|s| s.crease_angle));
        let crease_angle = crease_angle.unwrap_or(f64::INFINITY);
        if let Some(path) = self.mesh_file() {
            let (unit, open) =
                (self.unit.or(spec.and_then(|s| s.unit)), self.open || spec.is_some_and(|s| s.open));
            let triangles = read_mesh(path, unit, open, notes)?;
            self.check_size(path, &triangles)?;
            return Ok(Surface::build(&triangles, crease_angle).map_err(|e| e.in_file(path))?);
        }
        let file = self.spec_file();
        let Some(Geometry::Shape(shape, resolution)) = spec.and_then(|s| s.geometry.as_ref()) else {
            return Err(anyhow!(
                "{}: [body] names neither mesh nor shape; add one, or give a mesh",
                file.display()
            ));
        };
        let triangles = shape.mesh(*resolution).map_err(|e| e.in_file(file))?;
        self.check_size(file, &triangles)?;
        let surface = Surface::build(&triangles, crease_angle).map_err(|e| e.in_file(file))?;
        match shape {
            // The paper's cylinder: its normals are radial.
            Shape::Cylinder { caps: false, .. } => {
                let radial =
                    surface.positions().iter().map(|p| -DVec3::new(p.x, p.y, 0.0).normalize_or_zero());
                let radial = radial.collect();
                Ok(surface.with_inward_normals(radial).map_err(|e| e.in_file(file))?)
            }
            _ => Ok(surface),
        }
    }

    fn check_size(&self, file: &Path, mesh: &TriangleMesh) -> Result<()> {
        let count = mesh.positions.len();
        if self.samples.is_none() && count > MAX_LAW_NODES {
            bail!(
                "{}: a law gives each of the {count} vertices its own response, and {MAX_LAW_NODES} is the most; make the \
                 mesh coarser, or give samples at fewer points",
                file.display()
            );
        }
        Ok(())
    }

    /// The responses, and whether they come from samples; else from the spec's law.
    fn responses(&self, surface: &Surface) -> Result<(Fit, bool)> {
        let spec = self.spec();
        let friction = self.friction.map(Friction::Constant).or_else(|| spec?.friction.clone());
        if let Some(path) = &self.samples {
            let default_friction = match friction {
                Some(Friction::Constant(mu)) => Some(mu),
                Some(Friction::Table(_)) => {
                    return Err(anyhow!(
                        "{}: a table of friction goes with a law; beside samples give [friction] coefficient, or friction \
                         rows in the samples",
                        self.spec_file().display()
                    ));
                }
                None => None,
            };
            let interpolation = match self.interpolation {
                Between::Pchip => Interpolation::Pchip,
                Between::Linear => Interpolation::Linear,
            };
            let samples = read_samples(path)?;
            let options = FitOptions { interpolation, default_friction };
            let fitted = fit(surface, &samples, &options).map_err(|e| e.in_file(path))?;
            return Ok((fitted, true));
        }
        let Some((spec, path)) = &self.spec else {
            return Err(anyhow!("no curves given; give --samples, or a --spec with [response]"));
        };
        let missing = |what: &str, hint: &str| anyhow!("{}: {what} is missing; {hint}", path.display());
        let law = spec.law.ok_or_else(|| missing("[response]", "name a law there, or give --samples"))?;
        let deflection = spec.deflection.ok_or_else(|| {
            missing("[deflection]", "say how far the law reaches: normal_max_mm and lateral_max_mm")
        })?;
        let friction =
            friction.ok_or_else(|| missing("[friction]", "give its coefficient, or --friction"))?;
        let responses = law
            .responses(surface.positions(), &friction, deflection)
            .with_context(|| path.display().to_string())?;
        let nodes: Vec<u32> = (0..responses.len() as u32).collect();
        let blends = nodes.iter().map(|&n| BlendWeights::own(n)).collect();
        Ok((Fit { blends, responses, test_point_nodes: nodes, report: FitReport::default() }, false))
    }
}

/// A surface mesh, repaired; what was repaired goes to `notes`.
fn read_mesh(
    path: &Path,
    unit: Option<LengthUnit>,
    allow_open: bool,
    notes: &mut Vec<String>,
) -> Result<TriangleMesh> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("msh")) {
        bail!("{}: .msh files are not read; convert it to .stl or .vtk, e.g. with Gmsh", path.display());
    }
    let triangles = import::read(path, unit)?;
    let (triangles, report) =
        repair::repair(triangles, Options { allow_open }).map_err(|e| e.in_file(path))?;
    notes.extend(report.notes.iter().map(|note| format!("{}: {note}", path.display())));
    Ok(triangles)
}

/// The surface of a mesh file, and what was repaired in it.
pub(crate) fn read_surface(
    path: &Path,
    unit: Option<LengthUnit>,
    open: bool,
    crease_angle: f64,
) -> Result<(Surface, Vec<String>)> {
    let mut notes = Vec::new();
    let triangles = read_mesh(path, unit, open, &mut notes)?;
    let surface = Surface::build(&triangles, crease_angle).map_err(|e| e.in_file(path))?;
    notes.extend(folds(&surface));
    Ok((surface, notes))
}

/// Nodes that a law gives responses of their own to: 2 kB each.
const MAX_LAW_NODES: usize = 500_000;

/// What the surface's folds do to a contact.
fn folds(surface: &Surface) -> Vec<String> {
    let (positions, inward) = (surface.positions(), surface.inward_normals());
    let is_folded = |e: &palpate_body::Element| {
        let [a, b, c] = e.nodes.map(|n| positions[n as usize]);
        let outward = (b - a).cross(c - a);
        e.nodes.iter().any(|&n| inward[n as usize].dot(outward) > 0.0)
    };
    let folded = surface.elements().iter().enumerate().filter(|(_, e)| is_folded(e));
    let folded: Vec<(usize, DVec3)> =
        folded.map(|(t, e)| (t, positions[e.nodes[0] as usize] * 1e3)).collect();
    let mut notes = Vec::new();
    if let Some((t, p)) = folded.first() {
        notes.push(format!(
            "{} folded back, first triangle {t} at ({:.3}, {:.3}, {:.3}) mm: contact there will not be smooth; untangle \
             it in a mesh editor",
            if folded.len() == 1 { "1 triangle is".into() } else { format!("{} triangles are", folded.len()) },
            p.x,
            p.y,
            p.z
        ));
    }
    if surface.smoothed_normals() > 0 {
        notes.push(format!(
            "nodes in folds whose normals were taken from those around: {}; untangle the mesh there",
            surface.smoothed_normals()
        ));
    }
    notes
}

fn digests(inputs: &[&Path]) -> Result<BTreeMap<String, String>> {
    inputs.iter().map(|path| Ok((path.display().to_string(), files::sha256(path)?))).collect()
}
