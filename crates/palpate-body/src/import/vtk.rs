//! Legacy VTK, text and binary (big-endian): polygonal data and unstructured grids; what of a grid is a surface.

use super::cursor::Scalar;
use super::{BodyError, Cursor, Grid, Result, Soup, quote, truncated};

fn add_polygon(soup: &mut Soup, cell: usize, corners: &[u32]) -> Result<()> {
    soup.polygon(corners, || format!("polygon {cell}"))
}

fn add_strip(soup: &mut Soup, cell: usize, corners: &[u32]) -> Result<()> {
    for (i, t) in corners.windows(3).enumerate() {
        let turned = if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
        soup.polygon(&turned, || format!("strip {cell}"))?;
    }
    Ok(())
}

/// A cell by its VTK type: surfaces are taken, points and lines passed over, solids refused.
fn add_cell(soup: &mut Soup, cell: usize, kind: u8, corners: &[u32]) -> Result<()> {
    match (kind, corners) {
        (0..=4 | 21, _) => Ok(()),
        (5 | 7 | 9, _) => add_polygon(soup, cell, corners),
        (6, _) => add_strip(soup, cell, corners),
        (8, &[a, b, c, d]) => add_polygon(soup, cell, &[a, b, d, c]),
        (10..=14 | 24..=27 | 71, _) => Err(BodyError::invalid(
            format!("cell {cell}"),
            "it is a solid (a tetrahedron or the like), but a surface is needed",
            "extract the surface (ParaView: Extract Surface), or give the file as a volume mesh to a simulation",
        )),
        _ => {
            let problem = format!("a cell of VTK type {kind} with {} vertices is not read", corners.len());
            Err(BodyError::invalid(format!("cell {cell}"), problem, "export the surface as triangles"))
        }
    }
}

/// The grid's surface; solid cells are refused.
pub(super) fn surface(grid: Grid) -> Result<Soup> {
    let mut soup = Soup { positions: grid.points, ..Soup::default() };
    for (c, corners) in grid.polygons.iter().enumerate() {
        add_polygon(&mut soup, c, corners)?;
    }
    for (c, corners) in grid.strips.iter().enumerate() {
        add_strip(&mut soup, c, corners)?;
    }
    for (c, (corners, kind)) in grid.cells.iter().zip(&grid.kinds).enumerate() {
        add_cell(&mut soup, c, *kind, corners)?;
    }
    Ok(soup)
}

pub(super) fn read(bytes: &[u8], wanted: &[&str]) -> Result<Grid> {
    let mut cursor = Cursor::new(bytes);
    if !cursor.next_line().is_some_and(|l| l.starts_with(b"# vtk DataFile")) {
        let problem = "the first line is not `# vtk DataFile Version ...`";
        return Err(BodyError::invalid(
            "line 1",
            problem,
            "save the mesh as legacy VTK, or with the right extension",
        ));
    }
    let _title = cursor.next_line();
    let place = cursor.place();
    let binary = match cursor.next_line().map(<[u8]>::trim_ascii) {
        Some(b"ASCII") => false,
        Some(b"BINARY") => true,
        other => {
            let problem = format!("{} is neither ASCII nor BINARY", quote(other.unwrap_or_default()));
            return Err(BodyError::invalid(place, problem, "save the mesh as legacy VTK"));
        }
    };
    File { cursor, binary, wanted, data: None }.read()
}

struct File<'a> {
    cursor: Cursor<'a>,
    binary: bool,
    wanted: &'a [&'a str],
    /// The best array on cells so far, after its rank among those wanted.
    data: Option<(usize, String, Vec<f64>)>,
}

/// As the file lists them, unchecked.
struct Listed {
    ends: Vec<f64>,
    vertices: Vec<f64>,
}

impl File<'_> {
    fn read(mut self) -> Result<Grid> {
        let mut grid = Grid::default();
        let (mut polygons, mut strips, mut cells, mut kinds) = (None, None, None, Vec::new());
        while let Some(word) = self.cursor.word() {
            let place = self.cursor.place();
            match word.to_ascii_uppercase().as_slice() {
                b"DATASET" => self.data_set()?,
                b"POINTS" => {
                    let count = self.count()?;
                    let scalar = self.scalar()?;
                    let values = self.numbers(count.saturating_mul(3), scalar)?;
                    for p in values.chunks_exact(3) {
                        grid.point([p[0], p[1], p[2]], || place.clone())?;
                    }
                }
                b"POLYGONS" => polygons = Some(self.cells()?),
                b"TRIANGLE_STRIPS" => strips = Some(self.cells()?),
                b"CELLS" => cells = Some(self.cells()?),
                b"VERTICES" | b"LINES" => drop(self.cells()?),
                b"CELL_TYPES" => {
                    let count = self.count()?;
                    kinds = self.numbers(count, Scalar::I32)?;
                }
                b"METADATA" => {
                    // To the next empty line.
                    self.cursor.next_line();
                    while self.cursor.next_line().is_some_and(|l| !l.trim_ascii().is_empty()) {}
                }
                b"FIELD" => self.fields(false)?,
                // Attributes come after all geometry.
                b"POINT_DATA" | b"CELL_DATA" if self.wanted.is_empty() => break,
                b"POINT_DATA" | b"CELL_DATA" => {
                    self.attributes(word.eq_ignore_ascii_case(b"CELL_DATA"))?;
                    break;
                }
                _ => {
                    let problem = format!("{} is not a part of a surface", quote(word));
                    return Err(BodyError::invalid(place, problem, "save the surface alone, as POLYDATA"));
                }
            }
        }
        let count = grid.points.len();
        if let Some(list) = polygons {
            grid.polygons.add("polygon", &list.ends, &list.vertices, 0, count)?;
        }
        if let Some(list) = strips {
            grid.strips.add("strip", &list.ends, &list.vertices, 0, count)?;
        }
        if let Some(list) = cells {
            if list.ends.len() != kinds.len() {
                let problem = format!("{} cells have {} types", list.ends.len(), kinds.len());
                return Err(BodyError::invalid("CELL_TYPES", problem, "export the mesh again"));
            }
            grid.cells.add("cell", &list.ends, &list.vertices, 0, count)?;
        }
        // A number that is no kind becomes one that isn't read.
        grid.kinds = kinds.into_iter().map(|k| k as u8).collect();
        if let Some((_, name, values)) = self.data.take_if(|_| !grid.cells.is_empty()) {
            if values.len() != grid.cells.len() {
                let problem = format!("{} numbers for {} cells", values.len(), grid.cells.len());
                return Err(BodyError::invalid(
                    format!("cell data {}", quote(name.as_bytes())),
                    problem,
                    "export the mesh again",
                ));
            }
            grid.data = Some((name, values));
        }
        Ok(grid)
    }

    fn data_set(&mut self) -> Result<()> {
        let place = self.cursor.place();
        match self.cursor.word().unwrap_or_default().to_ascii_uppercase().as_slice() {
            b"POLYDATA" | b"UNSTRUCTURED_GRID" => Ok(()),
            other => {
                let problem = format!("a data set of kind {} is no surface", quote(other));
                Err(BodyError::invalid(place, problem, "save the surface as POLYDATA"))
            }
        }
    }

    fn count(&mut self) -> Result<usize> {
        let value = self.cursor.number("the count")?;
        // Every number takes a byte at least.
        if value >= 0.0 && value == value.trunc() && value <= self.cursor.rest().len() as f64 {
            return Ok(value as usize);
        }
        Err(truncated(self.cursor.place(), &format!("the last of {value} entries")))
    }

    fn scalar(&mut self) -> Result<Scalar> {
        let word = self.cursor.word().unwrap_or_default().to_ascii_lowercase();
        Ok(match word.as_slice() {
            b"char" | b"signed_char" | b"vtktypeint8" => Scalar::I8,
            b"unsigned_char" | b"vtktypeuint8" => Scalar::U8,
            b"short" | b"vtktypeint16" => Scalar::I16,
            b"unsigned_short" | b"vtktypeuint16" => Scalar::U16,
            b"int" | b"vtkidtype" | b"vtktypeint32" => Scalar::I32,
            b"unsigned_int" | b"vtktypeuint32" => Scalar::U32,
            b"long" | b"vtktypeint64" => Scalar::I64,
            b"unsigned_long" | b"vtktypeuint64" => Scalar::U64,
            b"float" => Scalar::F32,
            b"double" => Scalar::F64,
            other => {
                let problem = format!("{} is not a number format that is read", quote(other));
                return Err(BodyError::invalid(
                    self.cursor.place(),
                    problem,
                    "save the surface without data arrays",
                ));
            }
        })
    }

    /// Numbers after a heading; binary ones begin with the line after it.
    fn numbers(&mut self, count: usize, scalar: Scalar) -> Result<Vec<f64>> {
        if !self.binary {
            return (0..count).map(|_| self.cursor.number("the last of the numbers announced")).collect();
        }
        self.cursor.next_line();
        let bytes = count.saturating_mul(scalar.size());
        let bytes = self.cursor.take(bytes, "the last of the numbers announced")?;
        Ok(bytes.chunks_exact(scalar.size()).map(|b| scalar.value(b, true)).collect())
    }

    fn cells(&mut self) -> Result<Listed> {
        let (count, size) = (self.count()?, self.count()?);
        let mut ahead = self.cursor.clone();
        if ahead.word().is_some_and(|w| w.eq_ignore_ascii_case(b"OFFSETS")) {
            self.cursor = ahead;
            let scalar = self.scalar()?;
            let offsets = self.numbers(count, scalar)?;
            if !self.cursor.word().is_some_and(|w| w.eq_ignore_ascii_case(b"CONNECTIVITY")) {
                return Err(truncated(self.cursor.place(), "the list CONNECTIVITY begins"));
            }
            let scalar = self.scalar()?;
            let vertices = self.numbers(size, scalar)?;
            return Ok(Listed { ends: offsets.into_iter().skip(1).collect(), vertices });
        }
        let place = self.cursor.place();
        let list = self.numbers(size, Scalar::I32)?;
        let mut cells = Listed { ends: Vec::new(), vertices: Vec::new() };
        let mut rest = list.as_slice();
        while let [length, after @ ..] = rest {
            if !(*length >= 0.0 && *length <= after.len() as f64) {
                return Err(truncated(
                    place,
                    &format!("cell {} has its {length} vertices", cells.ends.len()),
                ));
            }
            let (corners, next) = after.split_at(*length as usize);
            cells.vertices.extend_from_slice(corners);
            cells.ends.push(cells.vertices.len() as f64);
            rest = next;
        }
        if cells.ends.len() != count {
            let problem = format!("{count} cells are announced, and {} follow", cells.ends.len());
            return Err(BodyError::invalid(place, problem, "export the mesh again"));
        }
        Ok(cells)
    }

    /// The arrays of a field.
    fn fields(&mut self, on_cells: bool) -> Result<()> {
        let _name = self.cursor.word();
        for _ in 0..self.count()? {
            let name = self.cursor.word().unwrap_or_default();
            let (components, tuples) = (self.count()?, self.count()?);
            let scalar = self.scalar()?;
            let values = self.numbers(components.saturating_mul(tuples), scalar)?;
            if on_cells {
                self.keep(name, values);
            }
            self.metadata();
        }
        Ok(())
    }

    fn keep(&mut self, name: &[u8], values: Vec<f64>) {
        let rank = self.wanted.iter().position(|w| name.eq_ignore_ascii_case(w.as_bytes()));
        let Some(rank) = rank else { return };
        if self.data.as_ref().is_none_or(|(best, ..)| rank < *best) {
            self.data = Some((rank, String::from_utf8_lossy(name).into_owned(), values));
        }
    }

    /// Passes over what VTK 5 writes behind an array: to the next empty line.
    fn metadata(&mut self) {
        let mut ahead = self.cursor.clone();
        if ahead.word().is_some_and(|w| w.eq_ignore_ascii_case(b"METADATA")) {
            ahead.next_line();
            while ahead.next_line().is_some_and(|l| !l.trim_ascii().is_empty()) {}
            self.cursor = ahead;
        }
    }

    /// All data on points and cells, from behind the first of their headings to the end.
    fn attributes(&mut self, mut on_cells: bool) -> Result<()> {
        let mut count = self.count()?;
        while let Some(word) = self.cursor.word() {
            let place = self.cursor.place();
            let heading = word.to_ascii_uppercase();
            let components = match heading.as_slice() {
                b"POINT_DATA" | b"CELL_DATA" => {
                    on_cells = heading == b"CELL_DATA";
                    count = self.count()?;
                    continue;
                }
                b"FIELD" => {
                    self.fields(on_cells)?;
                    continue;
                }
                b"METADATA" => {
                    self.cursor.next_line();
                    while self.cursor.next_line().is_some_and(|l| !l.trim_ascii().is_empty()) {}
                    continue;
                }
                b"LOOKUP_TABLE" => {
                    let (_name, colours) = (self.cursor.word(), self.count()?);
                    self.numbers(colours.saturating_mul(4), Scalar::U8)?;
                    continue;
                }
                b"SCALARS" | b"GLOBAL_IDS" | b"PEDIGREE_IDS" => 1,
                b"VECTORS" | b"NORMALS" => 3,
                b"TENSORS" => 9,
                b"TENSORS6" => 6,
                b"TEXTURE_COORDINATES" | b"COLOR_SCALARS" => 0,
                _ => {
                    let problem = format!("{} is no data that is read", quote(word));
                    return Err(BodyError::invalid(place, problem, "save the mesh without it"));
                }
            };
            let name = self.cursor.word().unwrap_or_default();
            let (mut components, mut scalar) = (components, Scalar::U8);
            if components == 0 {
                components = self.count()?;
            }
            if heading != b"COLOR_SCALARS" {
                scalar = self.scalar()?;
            }
            if heading == b"SCALARS" {
                let mut ahead = self.cursor.clone();
                // The number of components may stand behind the format.
                if ahead.word().is_some_and(|w| w.iter().all(u8::is_ascii_digit)) {
                    components = self.count()?;
                }
                if !self.cursor.word().is_some_and(|w| w.eq_ignore_ascii_case(b"LOOKUP_TABLE")) {
                    let problem = format!("the scalars {} have no LOOKUP_TABLE", quote(name));
                    return Err(BodyError::invalid(
                        place,
                        problem,
                        "save the mesh again with ParaView or meshio",
                    ));
                }
                let _table = self.cursor.word();
            }
            let values = self.numbers(components.saturating_mul(count), scalar)?;
            if on_cells {
                self.keep(name, values);
            }
        }
        Ok(())
    }
}
