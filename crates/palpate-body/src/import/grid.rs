//! What a VTK file holds, whatever the dimension of its cells.

use super::{BodyError, Result, add_vertex, index, vtk, vtk_xml};
use glam::DVec3;
use std::path::Path;

/// Points, cells, and numbers on cells, as a VTK file gives them.
#[derive(Debug, Clone, Default)]
pub struct Grid {
    /// In the file's unit; finite.
    pub points: Vec<DVec3>,
    /// Polygons of polygonal data.
    pub polygons: Cells,
    /// Triangle strips of polygonal data.
    pub strips: Cells,
    /// Cells of an unstructured grid.
    pub cells: Cells,
    /// VTK's number for the kind of each of `cells`.
    pub kinds: Vec<u8>,
    /// The name of the array on `cells` that was asked for, and one number for each cell.
    pub data: Option<(String, Vec<f64>)>,
}

impl Grid {
    /// Reads .vtk, .vtu or .vtp from memory; `name` tells the format by its extension. Of the cells' data the array
    /// is kept whose name comes first in `wanted`, upper and lower case being the same.
    ///
    /// # Errors
    /// Another extension; whatever is wrong with the file, as in [`super::read`], but solid cells are none of it.
    pub fn read(name: &Path, bytes: &[u8], wanted: &[&str]) -> Result<Self> {
        match super::Format::of(name)? {
            super::Format::Vtk => vtk::read(bytes, wanted),
            super::Format::VtkXml => vtk_xml::read(bytes, wanted),
            _ => Err(BodyError::invalid("file name", "it is no VTK file", "give .vtk, .vtu or .vtp")),
        }
    }

    pub(super) fn point(&mut self, p: [f64; 3], place: impl Fn() -> String) -> Result<()> {
        add_vertex(&mut self.points, p, place)
    }
}

/// Lists of vertices, each checked to be one of the grid's points.
#[derive(Debug, Clone, Default)]
pub struct Cells {
    ends: Vec<usize>,
    vertices: Vec<u32>,
}

impl Cells {
    /// The vertices of each cell.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        self.ends.iter().enumerate().map(|(c, &end)| {
            let start = if c == 0 { 0 } else { self.ends[c - 1] };
            &self.vertices[start..end]
        })
    }

    /// How many cells there are.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Adds cells as VTK's newer files keep them, by where each ends in a list of vertices; these are the `count`
    /// that follow vertex `first`.
    pub(super) fn add(
        &mut self,
        what: &str,
        ends: &[f64],
        vertices: &[f64],
        first: usize,
        count: usize,
    ) -> Result<()> {
        let mut start = 0;
        for &end in ends {
            let place = || format!("{what} {}", self.ends.len());
            if !(end >= start as f64 && end <= vertices.len() as f64) {
                let problem = format!("it ends at {end} of {} vertex numbers", vertices.len());
                return Err(BodyError::invalid(place(), problem, "export the mesh again"));
            }
            for &v in &vertices[start..end as usize] {
                let vertex = first as u32 + index(v, count, place)?;
                self.vertices.push(vertex);
            }
            start = end as usize;
            self.ends.push(self.vertices.len());
        }
        Ok(())
    }
}
