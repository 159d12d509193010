//! `palpate fit`.

use super::Failure;
use crate::console;
use anyhow::anyhow;
use palpate_body::import::LengthUnit;
use palpate_build::fit::{self, FitInputs, FittedBody};
use palpate_build::spec::Spec;
use palpate_files as files;
use palpate_identify::FitReport;
use serde::Serialize;
use std::path::PathBuf;

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
    let spec = args.spec.as_deref().map(|path| Ok::<_, anyhow::Error>((Spec::read(path)?, path.into())));
    let inputs = FitInputs {
        mesh: args.mesh.clone(),
        unit: args.unit,
        samples: args.samples.clone(),
        spec: spec.transpose()?,
        friction: args.friction,
        interpolation: match args.interpolation {
            Between::Pchip => fit::Between::Pchip,
            Between::Linear => fit::Between::Linear,
        },
        open: args.open,
        crease_angle: args.crease_angle_deg.map(f64::to_radians),
        command: command_line(),
    };
    files::refuse_overwrite(&[&args.output], &inputs.files())?;
    let FittedBody { body, notes, report } = inputs.body()?;
    body.save(&args.output)?;

    for note in &notes {
        console::note(note);
    }
    let (nodes, triangles, test_points) =
        (body.nodes().len(), body.elements().len(), body.test_point_nodes().len());
    if args.json {
        console::json(&Report { nodes, triangles, test_points, notes, fit: report })?;
        return Ok(());
    }
    console::note(&format!(
        "{}: {nodes} nodes, {triangles} triangles, {test_points} test points",
        args.output.display()
    ));
    if let Some(fitted) = report {
        tell_points(&fitted);
    }
    Ok(())
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
