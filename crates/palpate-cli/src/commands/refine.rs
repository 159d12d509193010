//! `palpate refine`.

use super::Failure;
use crate::console;
use anyhow::anyhow;
use palpate_body::import::LengthUnit;
use palpate_body::refine::DEFAULT_SAGITTA_M;
use palpate_body::{Body, Fineness};
use palpate_build::refine::{Target, refine};
use palpate_files as files;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Give a body a finer surface over the same test points
///
/// Depth is measured from flat facets, so that a coarse mesh is felt as ridges; a step costs (nearly) the same on any mesh.
/// Triangles are divided until none is farther from the smooth surface through the nodes and their normals than
/// --sagitta-um, or none has a longer edge than --edge-length-mm. Creases and borders stay; where facets turn by more than
/// 40° the surface stays flat. With --mesh the surface is a finer mesh of one's own, in the same place.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  palpate refine liver.body -o smooth.body\n  \
                        palpate refine liver.body --sagitta-um 2 -o smooth.body\n  \
                        palpate refine liver.body --mesh fine.obj --unit mm -o smooth.body\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
#[command(group = clap::ArgGroup::new("how").args(["sagitta_um", "edge_length_mm", "mesh"]))]
pub struct Args {
    /// Body file
    body: PathBuf,
    /// Body file to write
    #[arg(short, long, value_name = "BODY")]
    output: PathBuf,
    /// How far facets may be from the smooth surface, µm [default: 10]
    #[arg(long, value_name = "X")]
    sagitta_um: Option<f64>,
    /// How long edges may be, mm
    #[arg(long, value_name = "X")]
    edge_length_mm: Option<f64>,
    /// A finer mesh of the same surface
    #[arg(long, value_name = "FILE", requires = "unit")]
    mesh: Option<PathBuf>,
    /// Unit of the mesh's coordinates: m, cm or mm
    #[arg(long, requires = "mesh")]
    unit: Option<LengthUnit>,
    /// Accept a mesh with borders
    #[arg(long, requires = "mesh")]
    open: bool,
    /// Keep edges of the mesh sharp whose faces turn by more than this, degrees
    #[arg(long, value_name = "X", requires = "mesh")]
    crease_angle_deg: Option<f64>,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    nodes: usize,
    triangles: usize,
    triangles_before: usize,
    test_points: usize,
    notes: Vec<String>,
    seconds: f64,
}

impl Args {
    fn target(&self) -> anyhow::Result<Target> {
        if let Some(path) = &self.mesh {
            let crease_angle = self.crease_angle_deg.unwrap_or(f64::INFINITY);
            if crease_angle < 0.0
                || (180.0 < crease_angle && crease_angle.is_finite())
                || crease_angle.is_nan()
            {
                return Err(anyhow!("--crease-angle-deg {crease_angle}: give an angle between 0 and 180"));
            }
            let (path, unit, open) = (path.clone(), self.unit, self.open);
            return Ok(Target::Mesh { path, unit, open, crease_angle: crease_angle.to_radians() });
        }
        let positive = |option: &str, length: f64| {
            if length.is_finite() && length > 0.0 {
                return Ok(length);
            }
            Err(anyhow!("{option} {length}: give a positive length"))
        };
        Ok(Target::Fineness(match (self.sagitta_um, self.edge_length_mm) {
            (_, Some(mm)) => Fineness::edge(positive("--edge-length-mm", mm)? * 1e-3),
            (Some(um), None) => Fineness::sagitta(positive("--sagitta-um", um)? * 1e-6),
            (None, None) => Fineness::sagitta(DEFAULT_SAGITTA_M),
        }))
    }
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let begun = Instant::now();
    let target = args.target()?;
    let inputs: Vec<&std::path::Path> =
        [Some(args.body.as_path()), args.mesh.as_deref()].into_iter().flatten().collect();
    files::refuse_overwrite(&[&args.output], &inputs)?;
    let body = Body::open(&args.body)?;
    let refined = refine(&body, &target).map_err(|e| e.context(args.body.display().to_string()))?;
    refined.save(&args.output)?;

    let notes = refined.provenance().notes[body.provenance().notes.len()..].to_vec();
    for note in &notes {
        console::note(note);
    }
    let (nodes, triangles) = (refined.nodes().len(), refined.elements().len());
    let report = Report {
        nodes,
        triangles,
        triangles_before: body.elements().len(),
        test_points: refined.test_point_nodes().len(),
        notes,
        seconds: begun.elapsed().as_secs_f64(),
    };
    if args.json {
        return Ok(console::json(&report)?);
    }
    if report.triangles == report.triangles_before && args.mesh.is_none() {
        console::note("it is that fine already: nothing was divided");
    }
    console::note(&format!(
        "{}: {nodes} nodes, {triangles} triangles, {} test points, in {:.1} s",
        args.output.display(),
        report.test_points,
        report.seconds
    ));
    Ok(())
}
