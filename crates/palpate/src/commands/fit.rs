//! `palpate fit`.

use super::Failure;
use crate::spec::{Friction, Geometry, Spec};
use crate::{console, files};
use anyhow::{Context, anyhow, bail};
use glam::DVec3;
use palpate_body::import::{self, LengthUnit};
use palpate_body::repair::{self, Options};
use palpate_body::shape::Shape;
use palpate_body::{
    BlendWeights, Body, BodyParts, Interpolation, Provenance, Response, SlipRule, Surface, Tool, TriangleMesh,
};
use palpate_identify::{FitOptions, FitReport, fit, read_samples};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Make a body from a surface and force-deflection curves
///
/// The surface is a mesh file (.stl .obj .ply .off .vtk .vtu .vtp) or a shape that the spec names. The curves are
/// samples that were measured or computed elsewhere (CSV: point,x_m,y_m,z_m,component,deflection_m,value), or a law
/// that the spec names. What was repaired or assumed is said on standard error, and kept in the body.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  palpate fit --mesh liver.stl --unit mm --samples liver.csv -o liver.body\n  \
                        palpate fit --spec cylinder.toml -o cylinder.body\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage."
)]
#[command(group = clap::ArgGroup::new("source").args(["mesh", "spec"]).required(true).multiple(true))]
pub struct Args {
    /// Surface mesh; goes before the spec's
    #[arg(long)]
    mesh: Option<PathBuf>,
    /// Unit of the mesh's coordinates: m, cm or mm
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Samples CSV; goes before the spec's law
    #[arg(long, value_name = "CSV")]
    samples: Option<PathBuf>,
    /// Body file to write
    #[arg(short, long, value_name = "BODY")]
    output: PathBuf,
    /// Spec
    #[arg(long, value_name = "SPEC.toml")]
    spec: Option<PathBuf>,
    /// Friction coefficient where the samples give none; goes before the spec's
    #[arg(long, value_name = "X")]
    friction: Option<f64>,
    /// How curves pass between samples
    #[arg(long, value_enum, default_value = "pchip")]
    interpolation: Between,
    /// Accept a surface with borders
    #[arg(long)]
    open: bool,
    /// Keep edges sharp whose faces turn by more than this, degrees
    #[arg(long, value_name = "X")]
    crease_angle_deg: Option<f64>,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Between {
    Pchip,
    Linear,
}

#[derive(Serialize)]
struct Report {
    nodes: usize,
    triangles: usize,
    test_points: usize,
    notes: Vec<String>,
    fit: Option<FitReport>,
}

/// Mixes, responses, the test points' nodes, and the report if they come from samples.
type Fitted = (Vec<BlendWeights>, Vec<Response>, Vec<u32>, Option<FitReport>);

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    if let Some(friction) = args.friction.filter(|f| !(0.0..=100.0).contains(f)) {
        return Err(anyhow!("--friction {friction}: give a coefficient between 0 and 100").into());
    }
    if let Some(angle) = args.crease_angle_deg.filter(|a| !(0.0..=180.0).contains(a)) {
        return Err(anyhow!("--crease-angle-deg {angle}: give an angle between 0 and 180").into());
    }
    let spec = args.spec.as_deref().map(Spec::read).transpose()?;
    let mesh = match (&args.mesh, spec.as_ref().and_then(|s| s.geometry.as_ref())) {
        (Some(mesh), _) | (None, Some(Geometry::Mesh(mesh))) => Some(mesh.as_path()),
        _ => None,
    };
    let inputs: Vec<&Path> =
        [args.spec.as_deref(), mesh, args.samples.as_deref()].into_iter().flatten().collect();
    files::refuse_overwrite(&[&args.output], &inputs)?;

    let mut notes = Vec::new();
    if let (Some(spec), Some(path)) = (&spec, &args.spec) {
        let unused = spec.ignored.iter();
        notes.extend(
            unused.map(|key| format!("{}: {key} is for simulations; it is ignored here", path.display())),
        );
    }
    let surface = surface(args, spec.as_ref(), mesh, &mut notes)?;
    notes.extend(folds(&surface));
    let (blends, responses, test_point_nodes, fitted) = responses(args, spec.as_ref(), &surface)?;
    if let Some(report) = &fitted {
        notes.extend(report.notes.iter().cloned());
    }
    let provenance = Provenance {
        command: command_line(),
        software: concat!("palpate ", env!("CARGO_PKG_VERSION")).into(),
        spec: spec.as_ref().map(|s| s.text.clone()),
        inputs: digests(&inputs)?,
        notes: notes.clone(),
        point_errors: Vec::new(),
    };
    let body = Body::new(BodyParts {
        surface,
        blends,
        responses,
        test_point_nodes,
        coupled: None,
        lateral_tensors: None,
        tool: spec.as_ref().map_or(Tool::Point, |s| s.tool),
        slip: spec.as_ref().map_or_else(SlipRule::default, |s| s.slip),
        tank: spec.as_ref().is_none_or(|s| s.tank),
        provenance,
    })
    .map_err(|e| {
        inputs.first().map_or_else(|| anyhow!("{e}"), |input| anyhow!("{}: {e}", input.display()))
    })?;
    body.save(&args.output)?;

    for note in &notes {
        console::note(note);
    }
    let (nodes, triangles, test_points) =
        (body.nodes().len(), body.elements().len(), body.test_point_nodes().len());
    if args.json {
        console::json(&Report { nodes, triangles, test_points, notes, fit: fitted })?;
        return Ok(());
    }
    console::note(&format!(
        "{}: {nodes} nodes, {triangles} triangles, {test_points} test points",
        args.output.display()
    ));
    if let Some(fitted) = fitted {
        tell_points(&fitted);
    }
    Ok(())
}

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

/// The surface, repaired.
fn surface(
    args: &Args,
    spec: Option<&Spec>,
    mesh: Option<&Path>,
    notes: &mut Vec<String>,
) -> anyhow::Result<Surface> {
    let crease_angle = args.crease_angle_deg.map(f64::to_radians).or(spec.and_then(|s| s.crease_angle));
    let crease_angle = crease_angle.unwrap_or(f64::INFINITY);
    if let Some(path) = mesh {
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("msh")) {
            bail!("{}: .msh files are not read; convert it to .stl or .vtk, e.g. with Gmsh", path.display());
        }
        let triangles = import::read(path, args.unit.or(spec.and_then(|s| s.unit)))?;
        let options = Options { allow_open: args.open || spec.is_some_and(|s| s.open) };
        let (triangles, report) = repair::repair(triangles, options).map_err(|e| e.in_file(path))?;
        notes.extend(report.notes.iter().map(|note| format!("{}: {note}", path.display())));
        check_size(args, path, &triangles)?;
        return Ok(Surface::build(&triangles, crease_angle).map_err(|e| e.in_file(path))?);
    }
    let file = args.spec.as_deref().unwrap_or(Path::new("spec"));
    let Some(Geometry::Shape(shape, resolution)) = spec.and_then(|s| s.geometry.as_ref()) else {
        return Err(anyhow!(
            "{}: [body] names neither mesh nor shape; add one, or give --mesh",
            file.display()
        ));
    };
    let triangles = shape.mesh(*resolution).map_err(|e| e.in_file(file))?;
    check_size(args, file, &triangles)?;
    let surface = Surface::build(&triangles, crease_angle).map_err(|e| e.in_file(file))?;
    match shape {
        // The paper's cylinder: its normals are radial.
        Shape::Cylinder { caps: false, .. } => {
            let radial = surface.positions().iter().map(|p| -DVec3::new(p.x, p.y, 0.0).normalize_or_zero());
            let radial = radial.collect();
            Ok(surface.with_inward_normals(radial).map_err(|e| e.in_file(file))?)
        }
        _ => Ok(surface),
    }
}

/// Nodes that a law gives responses of their own to: 2 kB each.
const MAX_LAW_NODES: usize = 500_000;

fn check_size(args: &Args, file: &Path, mesh: &TriangleMesh) -> anyhow::Result<()> {
    let count = mesh.positions.len();
    if args.samples.is_none() && count > MAX_LAW_NODES {
        bail!(
            "{}: a law gives each of the {count} vertices its own response, and {MAX_LAW_NODES} is the most; make the \
             mesh coarser, or give --samples at fewer points",
            file.display()
        );
    }
    Ok(())
}

/// The responses: from the samples, else from the spec's law.
fn responses(args: &Args, spec: Option<&Spec>, surface: &Surface) -> anyhow::Result<Fitted> {
    let friction = args.friction.map(Friction::Constant).or_else(|| spec?.friction.clone());
    if let Some(path) = &args.samples {
        let default_friction = match friction {
            Some(Friction::Constant(mu)) => Some(mu),
            Some(Friction::Table(_)) => {
                return Err(anyhow!(
                    "{}: a table of friction goes with a law; beside samples give [friction] coefficient, or friction \
                     rows in the samples",
                    args.spec.as_deref().unwrap_or(Path::new("spec")).display()
                ));
            }
            None => None,
        };
        let interpolation = match args.interpolation {
            Between::Pchip => Interpolation::Pchip,
            Between::Linear => Interpolation::Linear,
        };
        let samples = read_samples(path)?;
        let options = FitOptions { interpolation, default_friction };
        let fitted = fit(surface, &samples, &options).map_err(|e| e.in_file(path))?;
        return Ok((fitted.blends, fitted.responses, fitted.test_point_nodes, Some(fitted.report)));
    }
    let Some((spec, path)) = spec.zip(args.spec.as_deref()) else {
        return Err(anyhow!("no curves given; give --samples, or a --spec with [response]"));
    };
    let missing = |what: &str, hint: &str| anyhow!("{}: {what} is missing; {hint}", path.display());
    let law = spec.law.ok_or_else(|| missing("[response]", "name a law there, or give --samples"))?;
    let deflection = spec.deflection.ok_or_else(|| {
        missing("[deflection]", "say how far the law reaches: normal_max_mm and lateral_max_mm")
    })?;
    let friction = friction.ok_or_else(|| missing("[friction]", "give its coefficient, or --friction"))?;
    let responses = law
        .responses(surface.positions(), &friction, deflection)
        .with_context(|| path.display().to_string())?;
    let nodes: Vec<u32> = (0..responses.len() as u32).collect();
    Ok((nodes.iter().map(|&n| BlendWeights::own(n)).collect(), responses, nodes, None))
}

fn digests(inputs: &[&Path]) -> anyhow::Result<BTreeMap<String, String>> {
    inputs.iter().map(|path| Ok((path.display().to_string(), files::sha256(path)?))).collect()
}

/// The command line as it can be given to a shell again.
fn command_line() -> String {
    let quoted = |arg: String| {
        let plain = |c: char| c.is_alphanumeric() || "-_./=,:+%@".contains(c);
        if !arg.is_empty() && arg.chars().all(plain) {
            arg
        } else {
            format!("'{}'", arg.replace('\'', r"'\''"))
        }
    };
    let args = std::env::args_os().skip(1).map(|arg| quoted(arg.to_string_lossy().into_owned()));
    std::iter::once("palpate".to_owned()).chain(args).collect::<Vec<_>>().join(" ")
}

fn tell_points(report: &FitReport) {
    let head = ["point", "node", "distance (mm)", "normal", "lateral", "friction (rows)"];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    // Of many points the farthest tell enough.
    let mut points: Vec<_> = report.points.iter().collect();
    if points.len() > 24 {
        if report.largest_distance_m <= 1e-6 {
            return;
        }
        points.sort_by(|a, b| b.distance_m.total_cmp(&a.distance_m));
        points.truncate(12);
        console::note("the 12 points farthest from their nodes:");
    }
    rows.extend(points.iter().map(|p| {
        let counts = [p.normal_samples, p.lateral_samples, p.friction_samples].map(|n| n.to_string());
        let mut row = vec![p.point.clone(), p.node.to_string(), format!("{:.3}", p.distance_m * 1e3)];
        row.extend(counts);
        row
    }));
    for line in console::table(&rows).lines() {
        console::note(line);
    }
}
