//! `palpate export`.

use super::Failure;
use crate::{console, glb, tables, vtu};
use anyhow::anyhow;
use palpate_body::Body;
use palpate_files as files;
use palpate_runtime::Recording;
use std::path::{Path, PathBuf};

/// Write a body for ParaView, Blender, Unity or spreadsheets, or a recording for spreadsheets
///
/// --vtu gives an unstructured grid with, at each node, inward_normal, stiffness 1 mm deep and at full depth and
/// lateral stiffness (N/m), the largest normal force (N), friction at depth 0, and the test points it blends with
/// their weights. --csv gives nodes.csv, elements.csv and curves.csv; the last one holds the curves as samples, which
/// `palpate fit` reads. Of a body with a coupled law it is potentials.csv in its place, and the grid has the eigenvalues of K
/// 1 mm deep and at full depth.
///
/// --glb gives binary glTF 2.0: the surface in metres, y up (the body's z), coloured by its stiffness at full depth, with a morph
/// target of the surface pressed straight in at each of --targets test points, the farthest from each other: as the simulation
/// found it where the body has displacement fields, else a dimple.
///
/// A recording of `palpate run` goes with --csv alone, which gives recording.json (what it is of) and periods.csv (all
/// that the loop saw and did, a row a period).
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  palpate export liver.body --vtu liver.vtu\n  \
                        palpate export liver.body --glb liver.glb --targets 20\n  \
                        palpate export liver.body --csv tables\n  \
                        palpate export first-touch.rec --csv tables\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
#[command(group = clap::ArgGroup::new("format").args(["vtu", "glb", "csv"]).required(true).multiple(true))]
pub struct Args {
    /// Body file or recording
    body: PathBuf,
    /// VTK file to write
    #[arg(long, value_name = "FILE")]
    vtu: Option<PathBuf>,
    /// Binary glTF file to write
    #[arg(long, value_name = "FILE")]
    glb: Option<PathBuf>,
    /// Morph targets in it: so many test points
    #[arg(long, value_name = "N", default_value_t = 12, requires = "glb", value_parser = clap::value_parser!(u32).range(0..=1000))]
    targets: u32,
    /// How deep they are pressed [default: as deep as responses were found]
    #[arg(long, value_name = "X", requires = "glb", value_parser = depth)]
    depth_mm: Option<f64>,
    /// Folder to write tables into
    #[arg(long, value_name = "DIR")]
    csv: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    if palpate_runtime::is_recording(&args.body)? {
        return recording(args);
    }
    let body = Body::open(&args.body)?;
    let in_folder = |name: &str| args.csv.as_ref().map(|folder| folder.join(name));
    let law = if body.is_coupled() { "potentials.csv" } else { "curves.csv" };
    let tables = ["nodes.csv", "elements.csv", law].map(in_folder);
    let outputs: Vec<_> = args.vtu.iter().chain(&args.glb).chain(tables.iter().flatten()).collect();
    files::refuse_overwrite(&outputs, &[&args.body])?;
    if let Some(path) = &args.vtu {
        files::replace(path, |out| vtu::write(&body, &[], out))?;
        console::note(&format!("wrote {}", path.display()));
    }
    if let Some(path) = &args.glb {
        let targets = glb::targets(&body, args.targets as usize, args.depth_mm.map(|mm| mm * 1e-3))?;
        let name = args.body.file_stem().unwrap_or_default().to_string_lossy();
        files::replace(path, |out| glb::write(&body, &name, &targets, out))?;
        let kind = if body.displacement_fields()?.is_some() { "displacement fields" } else { "a dimple" };
        console::note(&format!("wrote {}, with {} morph targets of {kind}", path.display(), targets.len()));
    }
    if let (Some(folder), [Some(nodes), Some(elements), Some(curves)]) = (&args.csv, &tables) {
        files::make_folder(folder)?;
        files::replace(nodes, |out| tables::write_nodes(&body, out))?;
        files::replace(elements, |out| tables::write_elements(&body, out))?;
        files::replace(curves, |out| match body.coupled_law() {
            Some(law) => tables::write_potentials(&body, law, out),
            None => tables::write_curves(&body, out),
        })?;
        console::note(&format!("wrote nodes.csv, elements.csv and {law} into {}", folder.display()));
    }
    Ok(())
}

/// A depth in mm.
fn depth(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(depth) if depth > 0.0 && depth <= 1000.0 => Ok(depth),
        _ => Err("give a depth above 0 and up to 1000 mm".into()),
    }
}

fn recording(args: &Args) -> Result<(), Failure> {
    let (Some(folder), None, None) = (&args.csv, &args.vtu, &args.glb) else {
        return Err(anyhow!("{}: a recording goes with --csv alone", args.body.display()).into());
    };
    let [about, periods] = ["recording.json", "periods.csv"].map(|name| folder.join(name));
    files::refuse_overwrite(&[&about, &periods], &[Path::new(&args.body)])?;
    let mut recording = Recording::open(&args.body)?;
    files::make_folder(folder)?;
    files::replace(&about, |out| Ok(serde_json::to_writer_pretty(out, recording.header())?))?;
    files::replace(&periods, |out| tables::write_periods(&mut recording, out))?;
    if let Some(ending) = recording.ending() {
        console::note(&format!("{}: {ending}", args.body.display()));
    }
    console::note(&format!("wrote recording.json and periods.csv into {}", folder.display()));
    Ok(())
}
