//! `palpate export`.

use super::Failure;
use crate::{console, tables, vtu};
use anyhow::anyhow;
use palpate_body::Body;
use palpate_files as files;
use palpate_runtime::Recording;
use std::path::{Path, PathBuf};

/// Write a body for ParaView or spreadsheets, or a recording for spreadsheets
///
/// --vtu gives an unstructured grid with, at each node, inward_normal, stiffness 1 mm deep and at full depth and
/// lateral stiffness (N/m), the largest normal force (N), friction at depth 0, and the test points it blends with
/// their weights. --csv gives nodes.csv, elements.csv and curves.csv; the last one holds the curves as samples, which
/// `palpate fit` reads. Of a body with a coupled law it is potentials.csv in its place, and the grid has the eigenvalues of K
/// 1 mm deep and at full depth.
///
/// A recording of `palpate run` goes with --csv alone, which gives recording.json (what it is of) and periods.csv (all
/// that the loop saw and did, a row a period).
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  palpate export liver.body --vtu liver.vtu\n  \
                        palpate export liver.body --csv tables\n  \
                        palpate export first-touch.rec --csv tables\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
#[command(group = clap::ArgGroup::new("format").args(["vtu", "csv"]).required(true).multiple(true))]
pub struct Args {
    /// Body file or recording
    body: PathBuf,
    /// VTK file to write
    #[arg(long, value_name = "FILE")]
    vtu: Option<PathBuf>,
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
    let outputs: Vec<_> = args.vtu.iter().chain(tables.iter().flatten()).collect();
    files::refuse_overwrite(&outputs, &[&args.body])?;
    if let Some(path) = &args.vtu {
        files::replace(path, |out| vtu::write(&body, &[], out))?;
        console::note(&format!("wrote {}", path.display()));
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

fn recording(args: &Args) -> Result<(), Failure> {
    let (Some(folder), None) = (&args.csv, &args.vtu) else {
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
