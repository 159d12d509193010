//! Meshes from files: Gmsh's .msh (2.2 and 4.1), VTK (.vtk, .vtu), TetGen (.node and .ele).
//!
//! Like the surface readers of [`palpate_body::import`], these never trust a count, and say line (or byte) and hint of
//! whatever is wrong. Linear tetrahedra get nodes at the middles of their edges; elements that are inverted
//! are turned back; nodes that no element uses are dropped, the others keep their order.

mod content;
mod gmsh;
mod tetgen;
mod vtk;

use super::TetMesh;
use crate::error::{Result, SimulateError};
use palpate_body::TriangleMesh;
use palpate_body::import::{self as surface, LengthUnit};
use std::path::Path;

/// What a mesh file turned out to hold, in m.
#[derive(Debug, Clone, PartialEq)]
pub enum Imported {
    /// Tetrahedra.
    Volume(TetMesh),
    /// No solid cell: triangles, not yet repaired (see [`palpate_body::repair`]).
    Surface(TriangleMesh),
}

/// Reads a volume mesh by its file's extension (in any case), in m.
///
/// Regions are Gmsh's physical volumes, TetGen's region attribute, or numbers on VTK's cells (an array `region`,
/// `gmsh:physical`, `material` or the like); one without a name is called by its number. Groups are the nodes of every
/// named or numbered physical group of any dimension, TetGen's boundary markers, and VTK's numbered cells; where a
/// volume and a group of lower dimension share a name, it means the latter's nodes.
///
/// # Errors
/// A file that can't be read, is of another format or version, or holds a surface only; a number that is none or not
/// finite; a node that isn't there; counts that the file doesn't hold; solids other than tetrahedra with 4 or 10 nodes,
/// or both kinds mixed; an element in several regions; curved elements that are inverted, but not all.
pub fn read(path: &Path, unit: LengthUnit) -> Result<TetMesh> {
    match read_any(path, unit)? {
        Imported::Volume(mesh) => Ok(mesh),
        Imported::Surface(_) => Err(no_solid().in_file(path)),
    }
}

/// Reads a mesh of either kind by its file's extension; surfaces in every format of [`palpate_body::import`] too.
///
/// # Errors
/// As [`read`] and [`palpate_body::import::read`].
pub fn read_any(path: &Path, unit: LengthUnit) -> Result<Imported> {
    if Format::of(path).map_err(|e| e.in_file(path))? == Format::TetGen {
        return read_tetgen_files(path, unit).map(Imported::Volume);
    }
    let bytes = surface::load(path)?;
    read_bytes(path, &bytes, unit).map_err(|e| e.in_file(path))
}

/// The same from memory; `name` tells the format by its extension.
///
/// # Errors
/// As [`read_any`], without the file's name; TetGen's files, which go through [`read_tetgen`].
pub fn read_bytes(name: &Path, bytes: &[u8], unit: LengthUnit) -> Result<Imported> {
    let format = Format::of(name)?;
    if bytes.is_empty() {
        return Err(SimulateError::invalid("file", "it is empty", "export the mesh again"));
    }
    match format {
        Format::Gmsh => gmsh::parse(bytes)?.build(unit),
        Format::Vtk => match vtk::parse(name, bytes)? {
            Some(content) => content.build(unit),
            None => Ok(Imported::Surface(surface::read_bytes(name, bytes, Some(unit))?)),
        },
        Format::Surface => Ok(Imported::Surface(surface::read_bytes(name, bytes, Some(unit))?)),
        Format::TetGen => Err(two_files("it is one of two")),
    }
}

/// Reads TetGen's two files from memory: nodes (.node) and elements (.ele).
///
/// # Errors
/// As [`read`], without the file's name.
pub fn read_tetgen(nodes: &[u8], elements: &[u8], unit: LengthUnit) -> Result<TetMesh> {
    tetgen::elements(elements, tetgen::nodes(nodes)?)?.volume(unit)
}

/// `path` is either of the two.
fn read_tetgen_files(path: &Path, unit: LengthUnit) -> Result<TetMesh> {
    let (mut node, mut ele) = (path.to_path_buf(), path.to_path_buf());
    let is_node = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("node"));
    let other = if is_node { &mut ele } else { &mut node };
    other.set_extension(if is_node { "ele" } else { "node" });
    if path.exists() && !other.exists() {
        let problem = format!("there is no {} beside it", other.display());
        return Err(two_files(&problem).in_file(path));
    }
    let nodes = tetgen::nodes(&surface::load(&node)?).map_err(|e| e.in_file(&node))?;
    let read = || tetgen::elements(&surface::load(&ele)?, nodes)?.volume(unit);
    read().map_err(|e| e.in_file(&ele))
}

fn two_files(problem: &str) -> SimulateError {
    let hint = "a mesh of TetGen's is two files, .node and .ele: keep them side by side";
    SimulateError::invalid("file", problem, hint)
}

fn no_solid() -> SimulateError {
    let hint = "mesh the volume (gmsh -3), or give the file where a surface is wanted";
    SimulateError::invalid("mesh", "there is no tetrahedron in it, a surface at most", hint)
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Gmsh,
    Vtk,
    TetGen,
    Surface,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "msh" => Ok(Format::Gmsh),
            "vtk" | "vtu" => Ok(Format::Vtk),
            "node" | "ele" => Ok(Format::TetGen),
            "obj" | "stl" | "ply" | "off" | "vtp" => Ok(Format::Surface),
            other => Err(SimulateError::invalid(
                "file name",
                format!("`.{}` is no mesh that can be read", other.escape_debug()),
                "give a volume as .msh, .vtk, .vtu, .node or .ele, a surface as .stl, .obj, .ply, .off or .vtp",
            )),
        }
    }
}
