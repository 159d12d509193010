//! `palpate export`.

use super::Failure;
use crate::{console, files, tables, vtu};
use palpate_body::Body;
use std::path::PathBuf;

/// Write a body for ParaView or spreadsheets
///
/// --vtu gives an unstructured grid with, at each node, inward_normal, stiffness 1 mm deep and at full depth and
/// lateral stiffness (N/m), the largest normal force (N), friction at depth 0, and the test points it mixes with
/// their weights. --csv gives nodes.csv, elements.csv and curves.csv; the last one holds the curves as samples, which
/// `palpate fit` reads.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  palpate export liver.body --vtu liver.vtu\n  \
                        palpate export liver.body --csv tables\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
#[command(group = clap::ArgGroup::new("format").args(["vtu", "csv"]).required(true).multiple(true))]
pub struct Args {
    /// Body file
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
    let in_folder = |name: &str| args.csv.as_ref().map(|folder| folder.join(name));
    let tables = ["nodes.csv", "elements.csv", "curves.csv"].map(in_folder);
    let outputs: Vec<_> = args.vtu.iter().chain(tables.iter().flatten()).collect();
    files::refuse_overwrite(&outputs, &[&args.body])?;
    let body = Body::open(&args.body)?;
    if let Some(path) = &args.vtu {
        files::replace(path, |out| vtu::write(&body, &[], out))?;
        console::note(&format!("wrote {}", path.display()));
    }
    if let (Some(folder), [Some(nodes), Some(elements), Some(curves)]) = (&args.csv, &tables) {
        files::make_folder(folder)?;
        files::replace(nodes, |out| tables::write_nodes(&body, out))?;
        files::replace(elements, |out| tables::write_elements(&body, out))?;
        files::replace(curves, |out| tables::write_curves(&body, out))?;
        console::note(&format!("wrote nodes.csv, elements.csv and curves.csv into {}", folder.display()));
    }
    Ok(())
}
