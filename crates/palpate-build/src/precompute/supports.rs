//! What holds the body: nodes of its volume mesh, and of a surface of its own.

use crate::spec::{Fixed, Selection};
use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::Surface;
use palpate_files as files;
use palpate_files::Table;
use palpate_simulate::TetMesh;
use std::path::Path;

/// A mesh's nodes that a support holds.
pub fn held_nodes(support: &Fixed, mesh: &TetMesh, tolerance_m: f64) -> Result<Vec<u32>> {
    let place = &support.place;
    let nodes: Vec<u32> = match &support.selection {
        Selection::Place(region) => (0..mesh.positions.len() as u32)
            .filter(|n| region.contains(mesh.positions[*n as usize], tolerance_m))
            .collect(),
        Selection::Group(name) => {
            mesh.groups.get(name).cloned().ok_or_else(|| no_group(place, name, mesh))?
        }
        Selection::Nodes(file) => listed(file)?
            .iter()
            .map(|p| nearest(p.at, mesh.positions.iter().copied(), tolerance_m).ok_or_else(|| p.far()))
            .collect::<Result<_>>()?,
    };
    if nodes.is_empty() {
        let (low, high) = extent(mesh.positions.iter());
        bail!(
            "{place}: it holds no node of the mesh; the mesh reaches from {low} to {high} mm: move it there"
        );
    }
    Ok(nodes)
}

/// Marks the nodes of a surface of its own that a support holds.
pub fn hold_surface(support: &Fixed, surface: &Surface, tolerance_m: f64, held: &mut [bool]) -> Result<()> {
    match &support.selection {
        Selection::Place(region) => {
            for (held, p) in held.iter_mut().zip(surface.positions()) {
                *held |= region.contains(*p, tolerance_m);
            }
        }
        // Surfaces have no groups.
        Selection::Group(_) => {}
        Selection::Nodes(file) => {
            for p in listed(file)? {
                if let Some(n) = nearest(p.at, surface.positions().iter().copied(), tolerance_m) {
                    held[n as usize] = true;
                }
            }
        }
    }
    Ok(())
}

pub fn no_group(place: &str, name: &str, mesh: &TetMesh) -> anyhow::Error {
    let mut names: Vec<&str> = mesh.groups.keys().map(String::as_str).collect();
    names.extend(mesh.region_names.iter().map(String::as_str).filter(|n| !n.is_empty()));
    names.sort_unstable();
    names.dedup();
    let hint = match names.len() {
        0 => "it has none: give half_space or box_mm".to_string(),
        _ => format!("it has {}", names.join(", ")),
    };
    anyhow!("{place}: the mesh has no group `{}`; {hint}", name.escape_debug())
}

/// A point in a list of nodes.
struct Listed {
    at: DVec3,
    place: String,
}

impl Listed {
    fn far(&self) -> anyhow::Error {
        let p = self.at * 1e3;
        let place = &self.place;
        anyhow!(
            "{place}: no node is at ({:.4}, {:.4}, {:.4}) mm; give nodes of this mesh, in m",
            p.x,
            p.y,
            p.z
        )
    }
}

fn listed(file: &Path) -> Result<Vec<Listed>> {
    let text = files::read_text(file)?;
    let table = Table::parse(file, &text, &["x_m", "y_m", "z_m"], &[])?;
    let row = |row: &palpate_files::Row| Listed {
        at: DVec3::new(row.values[0], row.values[1], row.values[2]),
        place: format!("{}:{}", file.display(), row.line),
    };
    Ok(table.rows.iter().map(row).collect())
}

pub fn nearest(at: DVec3, positions: impl Iterator<Item = DVec3>, within_m: f64) -> Option<u32> {
    let distances = positions.map(|p| p.distance_squared(at)).enumerate();
    let (n, d) = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (d <= within_m * within_m).then_some(n as u32)
}

/// Least and greatest coordinates, as text in mm.
pub fn extent<'a>(positions: impl Iterator<Item = &'a DVec3>) -> (String, String) {
    let (low, high) =
        positions.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
    let text = |p: DVec3| format!("({:.2}, {:.2}, {:.2})", p.x * 1e3, p.y * 1e3, p.z * 1e3);
    (text(low), text(high))
}
