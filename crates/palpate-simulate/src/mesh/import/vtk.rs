//! The volume in a VTK file: its cells as `palpate-body` reads them, by their kind.

use super::content::{Content, NO_REGION};
use crate::error::{Result, SimulateError};
use palpate_body::import::Grid;
use std::path::Path;

/// Arrays on cells that number regions, the most telling first.
const REGIONS: &[&str] = &[
    "region",
    "regions",
    "region_id",
    "regionid",
    "gmsh:physical",
    "physical",
    "material",
    "materials",
    "material_id",
    "materialid",
    "materialids",
    "medit:ref",
    "cell_tags",
    "subdomain",
    "domain",
    "label",
];

/// None if there is no solid cell.
pub(super) fn parse(name: &Path, bytes: &[u8]) -> Result<Option<Content>> {
    let hollow = |grid: &Grid| grid.kinds.iter().all(|&k| dimension(k).is_none_or(|d| d < 3));
    let grid = match Grid::read(name, bytes, REGIONS) {
        // A surface may have whatever data on it: nobody asks.
        Err(_) if Grid::read(name, bytes, &[]).is_ok_and(|grid| hollow(&grid)) => return Ok(None),
        grid => grid?,
    };
    if hollow(&grid) {
        return Ok(None);
    }
    let mut content = Content { positions: grid.points, ..Content::default() };
    let (array, numbers) = grid.data.unwrap_or_default();
    for (c, (nodes, &kind)) in grid.cells.iter().zip(&grid.kinds).enumerate() {
        let place = || format!("cell {c}");
        let number = match numbers.get(c) {
            None => NO_REGION,
            Some(x) if !x.is_finite() => {
                let problem = format!("its `{array}` is {x}, not a finite number");
                let hint = "correct the array, or save the mesh without it";
                return Err(SimulateError::invalid(place(), problem, hint));
            }
            // Adding 0 makes -0 and 0 one.
            Some(x) => x + 0.0,
        };
        // Gmsh's groups count from 1; 0 is none.
        let number = if number == 0.0 && array.to_ascii_lowercase().ends_with("physical") {
            NO_REGION
        } else {
            number
        };
        match (kind, nodes.len(), dimension(kind)) {
            (10 | 71, 4, _) | (24 | 71, 10, _) => content.tetrahedron(nodes, number, place)?,
            (10 | 24 | 71, count, _) => {
                let problem = format!("a tetrahedron of VTK type {kind} with {count} nodes is not read");
                return Err(SimulateError::invalid(
                    place(),
                    problem,
                    "mesh it with 4 or 10 nodes to a tetrahedron",
                ));
            }
            (.., Some(3)) => {
                let problem = format!("a solid of VTK type {kind} is no tetrahedron");
                return Err(SimulateError::invalid(
                    place(),
                    problem,
                    "mesh it with tetrahedra alone, or split the cells (ParaView: Tetrahedralize)",
                ));
            }
            (.., None) => {
                let problem = format!("a cell of VTK type {kind} is not read");
                return Err(SimulateError::invalid(place(), problem, "save the tetrahedra alone"));
            }
            _ if number == NO_REGION => {}
            (4, ..) => nodes.windows(2).for_each(|line| content.cell(&content.name(3, number), line)),
            (.., Some(0)) => nodes.iter().for_each(|n| content.cell(&content.name(3, number), &[*n])),
            _ => content.cell(&content.name(3, number), corners(kind, nodes)),
        }
    }
    Ok(Some(content))
}

/// Of a kind of cell, if it is known (vtkCellType.h).
fn dimension(kind: u8) -> Option<u8> {
    Some(match kind {
        0..=2 => 0,
        3 | 4 | 21 | 35 | 68 | 75 => 1,
        5..=9 | 22 | 23 | 28 | 30 | 34 | 36 | 69 | 70 | 76 | 77 => 2,
        10..=14 | 24..=27 | 29 | 31..=33 | 37 | 41 | 42 | 71..=74 | 78..=81 => 3,
        _ => return None,
    })
}

/// The corners of a line or surface cell.
fn corners(kind: u8, nodes: &[u32]) -> &[u32] {
    let count = match kind {
        21 | 35 | 68 | 75 => 2,
        22 | 34 | 69 | 76 => 3,
        23 | 28 | 30 | 70 | 77 => 4,
        _ => nodes.len(),
    };
    &nodes[..count.min(nodes.len())]
}
