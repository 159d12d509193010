//! Legacy VTK, text and binary (big-endian): polygonal data and the surface cells of an unstructured grid.

use super::cursor::Scalar;
use super::{BodyError, Cursor, Result, Soup, index, quote, truncated};

/// Cells as VTK's newer files keep them: where each ends in a list of vertices.
pub(super) struct Cells {
    pub ends: Vec<f64>,
    pub vertices: Vec<f64>,
}

impl Cells {
    /// The vertices of each cell, checked to lie within the `count` that follow vertex `first`.
    pub fn each(
        &self,
        place: &str,
        first: usize,
        count: usize,
        mut visit: impl FnMut(usize, &[u32]) -> Result<()>,
    ) -> Result<()> {
        let (mut start, mut corners) = (0, Vec::new());
        for (c, &end) in self.ends.iter().enumerate() {
            let place = || format!("{place} {c}");
            if !(end >= start as f64 && end <= self.vertices.len() as f64) {
                let problem = format!("it ends at {end} of {} vertex numbers", self.vertices.len());
                return Err(BodyError::invalid(place(), problem, "export the mesh again"));
            }
            corners.clear();
            for &v in &self.vertices[start..end as usize] {
                corners.push(first as u32 + index(v, count, place)?);
            }
            visit(c, &corners)?;
            start = end as usize;
        }
        Ok(())
    }
}

pub(super) fn add_polygon(soup: &mut Soup, cell: usize, corners: &[u32]) -> Result<()> {
    soup.polygon(corners, || format!("polygon {cell}"))
}

pub(super) fn add_strip(soup: &mut Soup, cell: usize, corners: &[u32]) -> Result<()> {
    for (i, t) in corners.windows(3).enumerate() {
        let turned = if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
        soup.polygon(&turned, || format!("strip {cell}"))?;
    }
    Ok(())
}

/// A cell by its VTK type: surfaces are taken, points and lines passed over, solids refused.
pub(super) fn add_cell(soup: &mut Soup, cell: usize, kind: f64, corners: &[u32]) -> Result<()> {
    match (kind as u32, corners) {
        (0..=4 | 21, _) => Ok(()),
        (5 | 7 | 9, _) => add_polygon(soup, cell, corners),
        (6, _) => add_strip(soup, cell, corners),
        (8, &[a, b, c, d]) => add_polygon(soup, cell, &[a, b, d, c]),
        (10..=14, _) => Err(BodyError::invalid(
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

pub(super) fn parse(bytes: &[u8]) -> Result<Soup> {
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
    File { cursor, binary }.read()
}

struct File<'a> {
    cursor: Cursor<'a>,
    binary: bool,
}

impl File<'_> {
    fn read(mut self) -> Result<Soup> {
        let mut soup = Soup::default();
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
                        soup.vertex([p[0], p[1], p[2]], || place.clone())?;
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
                b"FIELD" => self.skip_fields()?,
                // Attributes come after all geometry.
                b"POINT_DATA" | b"CELL_DATA" => break,
                _ => {
                    let problem = format!("{} is not a part of a surface", quote(word));
                    return Err(BodyError::invalid(place, problem, "save the surface alone, as POLYDATA"));
                }
            }
        }
        let count = soup.positions.len();
        if let Some(cells) = polygons {
            cells.each("polygon", 0, count, |c, corners| add_polygon(&mut soup, c, corners))?;
        }
        if let Some(cells) = strips {
            cells.each("strip", 0, count, |c, corners| add_strip(&mut soup, c, corners))?;
        }
        if let Some(cells) = cells {
            if cells.ends.len() != kinds.len() {
                let problem = format!("{} cells have {} types", cells.ends.len(), kinds.len());
                return Err(BodyError::invalid("CELL_TYPES", problem, "export the mesh again"));
            }
            cells.each("cell", 0, count, |c, corners| add_cell(&mut soup, c, kinds[c], corners))?;
        }
        Ok(soup)
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

    fn cells(&mut self) -> Result<Cells> {
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
            return Ok(Cells { ends: offsets.into_iter().skip(1).collect(), vertices });
        }
        let place = self.cursor.place();
        let list = self.numbers(size, Scalar::I32)?;
        let mut cells = Cells { ends: Vec::new(), vertices: Vec::new() };
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

    fn skip_fields(&mut self) -> Result<()> {
        let _name = self.cursor.word();
        for _ in 0..self.count()? {
            let _name = self.cursor.word();
            let (components, tuples) = (self.count()?, self.count()?);
            let scalar = self.scalar()?;
            self.numbers(components.saturating_mul(tuples), scalar)?;
        }
        Ok(())
    }
}
