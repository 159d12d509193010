//! Surface meshes from files: OBJ, STL, PLY, OFF, and VTK (legacy, VTU, VTP).
//!
//! All readers are the crate's own, over one bounded cursor: a file may come from anywhere, and a bad one must
//! end in a message that names its line. The published readers were read for this and fall short of it: tobj
//! multiplies unchecked counts and names no line; stl_io takes a binary file whose header starts with `solid` for
//! text; ply-rs-bw loops over a header's count whatever the file holds, and rounds text to 32 bits; vtkio slices
//! and allocates by sizes found in the file. They serve the tests, as independent writers.

pub mod cursor;
mod grid;
mod obj;
mod off;
mod ply;
mod stl;
mod vtk;
mod vtk_xml;

use crate::error::{BodyError, Result};
use crate::repair::check_positions;
use crate::surface::{MAX_ELEMENTS, TriangleMesh};
use cursor::{Cursor, number, quote, short, truncated};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::Path;

pub use grid::{Cells, Grid};

/// Files beyond this are refused, bytes.
pub const MAX_FILE_BYTES: u64 = 4 << 30;

/// The unit of a mesh's coordinates. No format states it, and it is never guessed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum LengthUnit {
    /// `m`
    #[serde(rename = "m")]
    Metre,
    /// `cm`
    #[serde(rename = "cm")]
    Centimetre,
    /// `mm`
    #[serde(rename = "mm")]
    Millimetre,
}

impl LengthUnit {
    /// One unit in m.
    pub fn metres(self) -> f64 {
        match self {
            LengthUnit::Metre => 1.0,
            LengthUnit::Centimetre => 1e-2,
            LengthUnit::Millimetre => 1e-3,
        }
    }

    /// Units in one metre: dividing by a whole number rounds once, multiplying by 0.001 twice.
    pub fn per_metre(self) -> f64 {
        match self {
            LengthUnit::Metre => 1.0,
            LengthUnit::Centimetre => 100.0,
            LengthUnit::Millimetre => 1000.0,
        }
    }
}

impl std::str::FromStr for LengthUnit {
    type Err = BodyError;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "m" => Ok(LengthUnit::Metre),
            "cm" => Ok(LengthUnit::Centimetre),
            "mm" => Ok(LengthUnit::Millimetre),
            _ => Err(BodyError::invalid(
                "unit",
                format!("`{}` is no unit", text.escape_debug()),
                "give m, cm or mm",
            )),
        }
    }
}

/// Reads a surface mesh by its file's extension (in any case), in m. Polygons become fans of triangles.
///
/// Nothing is repaired here: see [`crate::repair`].
///
/// # Errors
/// No unit; a file that cannot be read, is empty, too large, or of another format; a number that is none or not
/// finite; an index out of range; counts that the file does not hold; solid cells; no triangle at all.
pub fn read(path: &Path, unit: Option<LengthUnit>) -> Result<TriangleMesh> {
    let read = || {
        // The cheap refusals before the file is loaded.
        needs_unit(unit)?;
        Format::of(path)?;
        read_bytes(path, &load(path)?, unit)
    };
    read().map_err(|e| e.in_file(path))
}

/// The same from memory; `name` tells the format by its extension.
///
/// # Errors
/// As [`read`], without the file's name.
pub fn read_bytes(name: &Path, bytes: &[u8], unit: Option<LengthUnit>) -> Result<TriangleMesh> {
    let (unit, format) = (needs_unit(unit)?, Format::of(name)?);
    if bytes.is_empty() {
        return Err(BodyError::invalid("file", "it is empty", "export the mesh again"));
    }
    parse(bytes, format, unit)
}

fn needs_unit(unit: Option<LengthUnit>) -> Result<LengthUnit> {
    unit.ok_or_else(|| {
        let hint = "say it with `--unit m|cm|mm`, or with `[body] unit = \"mm\"` in the spec";
        BodyError::invalid("coordinates", "no unit given", hint)
    })
}

#[derive(Clone, Copy)]
enum Format {
    Obj,
    Stl,
    Ply,
    Off,
    Vtk,
    VtkXml,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "obj" => Ok(Format::Obj),
            "stl" => Ok(Format::Stl),
            "ply" => Ok(Format::Ply),
            "off" => Ok(Format::Off),
            "vtk" => Ok(Format::Vtk),
            "vtu" | "vtp" => Ok(Format::VtkXml),
            other => Err(BodyError::invalid(
                "file name",
                format!("`.{}` is no surface mesh that can be read", other.escape_debug()),
                "give .obj, .stl, .ply, .off, .vtk, .vtu or .vtp",
            )),
        }
    }
}

/// A file's bytes.
///
/// # Errors
/// It cannot be read, or is larger than [`MAX_FILE_BYTES`].
pub fn load(path: &Path) -> Result<Vec<u8>> {
    let io = |e| BodyError::io(path, e);
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    if length <= MAX_FILE_BYTES {
        bytes.reserve_exact(length as usize);
        file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
    }
    if length.max(bytes.len() as u64) > MAX_FILE_BYTES {
        return Err(BodyError::invalid("file", "it is larger than 4 GiB", "decimate the mesh"));
    }
    Ok(bytes)
}

fn parse(bytes: &[u8], format: Format, unit: LengthUnit) -> Result<TriangleMesh> {
    let Soup { mut positions, triangles } = match format {
        Format::Obj => obj::parse(bytes),
        Format::Stl => stl::parse(bytes),
        Format::Ply => ply::parse(bytes),
        Format::Off => off::parse(bytes),
        Format::Vtk => vtk::read(bytes, &[]).and_then(vtk::surface),
        Format::VtkXml => vtk_xml::read(bytes, &[]).and_then(vtk::surface),
    }?;
    if triangles.is_empty() {
        let problem = "there is no triangle in it, only points or lines at most";
        return Err(BodyError::invalid("mesh", problem, "give a triangulated surface"));
    }
    for p in &mut positions {
        *p /= unit.per_metre();
    }
    check_positions(&positions)?;
    Ok(TriangleMesh { positions, triangles })
}

/// What the readers fill: positions in the file's unit, and triangles.
#[derive(Default)]
struct Soup {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    /// Adds a vertex; `place` says where it was read.
    fn vertex(&mut self, p: [f64; 3], place: impl Fn() -> String) -> Result<()> {
        add_vertex(&mut self.positions, p, place)
    }

    /// Adds a polygon of checked corners as a fan.
    fn polygon(&mut self, corners: &[u32], place: impl Fn() -> String) -> Result<()> {
        let [first, rest @ ..] = corners else { return Err(few_corners(place(), 0)) };
        if rest.len() < 2 {
            return Err(few_corners(place(), corners.len()));
        }
        if self.triangles.len() + rest.len() > MAX_ELEMENTS {
            return Err(BodyError::invalid(place(), "more than 1.4 billion triangles", "decimate the mesh"));
        }
        self.triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        Ok(())
    }
}

fn add_vertex(positions: &mut Vec<DVec3>, p: [f64; 3], place: impl Fn() -> String) -> Result<()> {
    if let Some(x) = p.iter().find(|x| !x.is_finite()) {
        let (vertex, hint) = (positions.len(), "correct the coordinate, or export the mesh again");
        let problem = format!("a coordinate of vertex {vertex} is {x}, not a finite number");
        return Err(BodyError::invalid(place(), problem, hint));
    }
    if positions.len() >= MAX_ELEMENTS {
        return Err(BodyError::invalid(place(), "more than 1.4 billion vertices", "decimate the mesh"));
    }
    positions.push(DVec3::from_array(p));
    Ok(())
}

fn few_corners(place: String, corners: usize) -> BodyError {
    BodyError::invalid(place, format!("a face of {corners} vertices"), "remove it, or give it at least three")
}

/// An index as it was read, if it is one of `count`.
fn index(value: f64, count: usize, place: impl Fn() -> String) -> Result<u32> {
    if value >= 0.0 && value < count as f64 && value == value.trunc() {
        return Ok(value as u32);
    }
    let problem = format!("it names vertex {}, but there are {count} (counted from 0)", short(value));
    Err(BodyError::invalid(place(), problem, "correct the index, or export the mesh again"))
}
