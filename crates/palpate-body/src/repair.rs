//! Repairs what can be repaired in a mesh without guessing, reports it, and refuses the rest with its place.

use crate::error::{BodyError, Result};
use crate::surface::{MAX_COORDINATE, MAX_ELEMENTS, NO_TWIN, TriangleMesh, check_area};
use glam::DVec3;
use std::collections::HashMap;

/// Closed components beyond this are not searched for cavities: the search compares each with each.
pub const MAX_NESTED: usize = 64;

/// What to accept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// Accept a surface with a border.
    pub allow_open: bool,
}

/// What was found and repaired.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Report {
    /// One line for each kind of change, for the user and the body's provenance.
    pub notes: Vec<String>,
    /// Vertices made one with an earlier one at exactly the same position.
    pub welded_vertices: usize,
    /// Vertices dropped because no triangle uses them.
    pub unused_vertices: usize,
    /// Triangles dropped because an earlier one has the same vertices.
    pub duplicate_triangles: usize,
    /// Triangles dropped because two of their vertices are one.
    pub collapsed_triangles: usize,
    /// Triangles turned over.
    pub flipped_triangles: usize,
    /// Parts of the surface that no edge joins.
    pub components: usize,
    /// Edges with a single triangle.
    pub border_edges: usize,
}

/// Checks and repairs a mesh, so that [`crate::Surface::build`] accepts it unless it is folded too sharply for its
/// crease angle. Vertices and triangles that are kept stay in their order; places in messages count the triangles
/// as they were given, from 0.
///
/// Closed components face outwards afterwards, cavities inwards (out of the material).
///
/// # Errors
/// No triangle, too many, a coordinate or index out of range; a triangle without area; an edge of three or more
/// triangles; a one-sided surface; a border that [`Options`] does not allow.
pub fn repair(mesh: TriangleMesh, options: Options) -> Result<(TriangleMesh, Report)> {
    check_indices(&mesh)?;
    let mut report = Report::default();
    let TriangleMesh { mut positions, mut triangles } = mesh;
    report.welded_vertices = weld(&mut positions, &mut triangles);
    let numbers = drop_triangles(&mut triangles, &mut report);
    if triangles.is_empty() {
        let hint = "give a triangulated surface, and check the unit and the exporter's precision";
        return Err(BodyError::invalid("mesh", "no triangle in it has three different vertices", hint));
    }
    report.unused_vertices = drop_unused(&mut positions, &mut triangles);
    let mut mesh = TriangleMesh { positions, triangles };
    let mut topology = Topology { mesh: &mesh, numbers: &numbers, twins: Vec::new() };
    topology.check_areas()?;
    topology.pair_edges()?;
    report.border_edges = topology.check_border(options)?;
    let (mut components, mut flipped) = topology.orient_alike()?;
    report.components = components.len();
    let trusted = topology.face_out(&mut components, &mut flipped);
    for (triangle, _) in mesh.triangles.iter_mut().zip(&flipped).filter(|(_, flip)| **flip) {
        triangle.swap(1, 2);
    }
    report.flipped_triangles = flipped.iter().filter(|flip| **flip).count();
    report.write_notes(trusted);
    Ok((mesh, report))
}

impl Report {
    fn write_notes(&mut self, trusted: Option<usize>) {
        let mut note = |count: usize, one: &str, many: &str| {
            if count > 0 {
                self.notes.push(format!("{count} {}", if count == 1 { one } else { many }));
            }
        };
        note(
            self.welded_vertices,
            "vertex at another's position welded to it",
            "vertices at others' positions welded to them",
        );
        note(
            self.collapsed_triangles,
            "triangle with a repeated vertex dropped",
            "triangles with a repeated vertex dropped",
        );
        note(self.duplicate_triangles, "duplicate triangle dropped", "duplicate triangles dropped");
        note(self.unused_vertices, "unused vertex dropped", "unused vertices dropped");
        note(
            self.flipped_triangles,
            "triangle turned over to face outwards",
            "triangles turned over to face outwards",
        );
        note(self.border_edges, "border edge: the surface is open", "border edges: the surface is open");
        if self.components > 1 {
            note(self.components, "", "separate components");
        }
        note(
            trusted.unwrap_or(0),
            "",
            "closed components: not searched for cavities, each faces as most of it did",
        );
    }
}

fn check_indices(mesh: &TriangleMesh) -> Result<()> {
    if mesh.triangles.is_empty() {
        return Err(BodyError::invalid("mesh", "there is no triangle in it", "give a triangulated surface"));
    }
    if mesh.triangles.len() > MAX_ELEMENTS || mesh.positions.len() > MAX_ELEMENTS {
        return Err(BodyError::invalid("mesh", "more than 1.4 billion triangles or vertices", "decimate it"));
    }
    check_positions(&mesh.positions)?;
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        if let Some(v) = triangle.iter().find(|&&v| v as usize >= mesh.positions.len()) {
            let problem = format!("it names vertex {v}, but there are {}", mesh.positions.len());
            return Err(BodyError::invalid(format!("triangle {t}"), problem, "correct the mesh's indices"));
        }
    }
    Ok(())
}

/// Every coordinate must be finite and of a size that the unit can explain.
pub(crate) fn check_positions(positions: &[DVec3]) -> Result<()> {
    let wrong = |p: &DVec3| !p.is_finite() || p.abs().max_element() > MAX_COORDINATE;
    let Some(v) = positions.iter().position(wrong) else { return Ok(()) };
    Err(BodyError::invalid(
        format!("vertex {v} at {}", in_mm(positions[v])),
        format!("a coordinate is not finite or beyond {MAX_COORDINATE} m"),
        "correct the coordinate or the mesh's unit",
    ))
}

/// Makes vertices at exactly the same position one, the first; returns how many went.
pub(crate) fn weld(positions: &mut Vec<DVec3>, triangles: &mut [[u32; 3]]) -> usize {
    let mut first = HashMap::with_capacity(positions.len());
    let mut kept = Vec::with_capacity(positions.len());
    let number: Vec<u32> = positions
        .iter()
        .map(|&p| {
            // Adding 0 makes -0 and 0 one.
            let key = (p + DVec3::ZERO).to_array().map(f64::to_bits);
            *first.entry(key).or_insert_with(|| {
                kept.push(p);
                kept.len() as u32 - 1
            })
        })
        .collect();
    for v in triangles.iter_mut().flatten() {
        *v = number[*v as usize];
    }
    let welded = positions.len() - kept.len();
    *positions = kept;
    welded
}

/// Drops collapsed and duplicate triangles; returns the given number of each that is left.
fn drop_triangles(triangles: &mut Vec<[u32; 3]>, report: &mut Report) -> Vec<u32> {
    let mut keys: Vec<([u32; 3], u32)> = Vec::with_capacity(triangles.len());
    for (t, triangle) in triangles.iter().enumerate() {
        let mut key = *triangle;
        key.sort_unstable();
        if key[0] != key[1] && key[1] != key[2] {
            keys.push((key, t as u32));
        }
    }
    report.collapsed_triangles = triangles.len() - keys.len();
    keys.sort_unstable();
    let different = keys.len();
    keys.dedup_by_key(|(key, _)| *key);
    report.duplicate_triangles = different - keys.len();
    let mut numbers: Vec<u32> = keys.into_iter().map(|(_, t)| t).collect();
    numbers.sort_unstable();
    *triangles = numbers.iter().map(|&t| triangles[t as usize]).collect();
    numbers
}

fn drop_unused(positions: &mut Vec<DVec3>, triangles: &mut [[u32; 3]]) -> usize {
    let mut used = vec![false; positions.len()];
    for &v in triangles.iter().flatten() {
        used[v as usize] = true;
    }
    let before = |count: &mut u32, &used: &bool| {
        let number = *count;
        *count += u32::from(used);
        Some(number)
    };
    let number: Vec<u32> = used.iter().scan(0, before).collect();
    for v in triangles.iter_mut().flatten() {
        *v = number[*v as usize];
    }
    let given = positions.len();
    let mut used = used.into_iter();
    positions.retain(|_| used.next() == Some(true));
    given - positions.len()
}

/// A part of the surface that edges join.
struct Component {
    triangles: Vec<u32>,
    closed: bool,
}

/// Who neighbours whom, whichever way each faces.
struct Topology<'a> {
    mesh: &'a TriangleMesh,
    /// The triangles' numbers as they were given.
    numbers: &'a [u32],
    /// The other half-edge of each edge (triangle × 3 + edge).
    twins: Vec<u32>,
}

impl Topology<'_> {
    fn corners(&self, t: usize) -> [DVec3; 3] {
        self.mesh.triangles[t].map(|v| self.mesh.positions[v as usize])
    }

    /// From and to of half-edge h, as the triangle was given.
    fn edge(&self, h: u32) -> [u32; 2] {
        let (triangle, i) = (self.mesh.triangles[h as usize / 3], h as usize % 3);
        [triangle[i], triangle[(i + 1) % 3]]
    }

    fn edge_place(&self, h: u32) -> String {
        let [a, b] = self.edge(h).map(|v| self.mesh.positions[v as usize]);
        format!("an edge of triangle {} at {}", self.numbers[h as usize / 3], in_mm((a + b) / 2.0))
    }

    fn check_areas(&self) -> Result<()> {
        for t in 0..self.mesh.triangles.len() {
            let corners = self.corners(t);
            if check_area(t, corners).is_err() {
                return Err(BodyError::invalid(
                    format!("triangle {} at {}", self.numbers[t], in_mm(corners[0])),
                    "it has no area: its vertices differ, but lie on a line",
                    "remove or collapse degenerate triangles in a mesh editor",
                ));
            }
        }
        Ok(())
    }

    fn pair_edges(&mut self) -> Result<()> {
        let mut edges: Vec<(u64, u32)> = (0..3 * self.mesh.triangles.len() as u32)
            .map(|h| {
                let [a, b] = self.edge(h);
                (u64::from(a.min(b)) << 32 | u64::from(a.max(b)), h)
            })
            .collect();
        edges.sort_unstable();
        self.twins = vec![NO_TWIN; edges.len()];
        let mut worst: Option<&[(u64, u32)]> = None;
        for run in edges.chunk_by(|a, b| a.0 == b.0) {
            match *run {
                [_] => {}
                [(_, g), (_, h)] => (self.twins[g as usize], self.twins[h as usize]) = (h, g),
                _ if worst.is_none_or(|w| run[0].1 < w[0].1) => worst = Some(run),
                _ => {}
            }
        }
        let Some(run) = worst else { return Ok(()) };
        Err(BodyError::invalid(
            self.edge_place(run[0].1),
            format!("{} triangles share it: the surface is not manifold", run.len()),
            "separate or remove the extra sheets in a mesh editor",
        ))
    }

    fn check_border(&self, options: Options) -> Result<usize> {
        let mut border = (0..).zip(&self.twins).filter(|(_, twin)| **twin == NO_TWIN).map(|(h, _)| h);
        let Some(first) = border.next() else { return Ok(0) };
        let count = 1 + border.count();
        if options.allow_open {
            return Ok(count);
        }
        let edges = if count == 1 { "edge belongs" } else { "edges belong" };
        Err(BodyError::invalid(
            self.edge_place(first),
            format!("the surface is open: {count} {edges} to one triangle only, the first here"),
            "close the holes in a mesh editor, or accept them with `--open` or `[body] open = true`",
        ))
    }

    /// Components, and the triangles to turn over so that each component is of one mind, the majority's.
    fn orient_alike(&self) -> Result<(Vec<Component>, Vec<bool>)> {
        let count = self.mesh.triangles.len();
        let (mut seen, mut flipped, mut components) = (vec![false; count], vec![false; count], Vec::new());
        for start in 0..count {
            if std::mem::replace(&mut seen[start], true) {
                continue;
            }
            let mut component = Component { triangles: vec![start as u32], closed: true };
            let mut next = 0;
            while let Some(&t) = component.triangles.get(next) {
                next += 1;
                for h in 3 * t..3 * t + 3 {
                    let twin = self.twins[h as usize];
                    if twin == NO_TWIN {
                        component.closed = false;
                        continue;
                    }
                    // Neighbours that face alike run along their edge opposite ways.
                    let opposed = self.edge(h)[0] == self.edge(twin)[0];
                    let (other, wanted) = (twin as usize / 3, flipped[t as usize] ^ opposed);
                    if !std::mem::replace(&mut seen[other], true) {
                        flipped[other] = wanted;
                        component.triangles.push(twin / 3);
                    } else if flipped[other] != wanted {
                        return Err(BodyError::invalid(
                            self.edge_place(h),
                            "the surface has one side only (as a Moebius strip): no orientation suits it",
                            "cut or remove the twisted part in a mesh editor",
                        ));
                    }
                }
            }
            let turned = component.triangles.iter().filter(|&&t| flipped[t as usize]).count();
            if 2 * turned > component.triangles.len() {
                component.flip(&mut flipped);
            }
            components.push(component);
        }
        Ok((components, flipped))
    }

    /// Turns closed components outwards, cavities inwards; returns their number if there are too many to search.
    fn face_out(&self, components: &mut Vec<Component>, flipped: &mut [bool]) -> Option<usize> {
        components.retain(|c| c.closed);
        if components.len() > MAX_NESTED {
            return Some(components.len());
        }
        let boxes: Vec<[DVec3; 2]> = components.iter().map(|c| self.bounds(c)).collect();
        for component in components.iter() {
            let [a, b, c] = self.corners(component.triangles[0] as usize);
            // The middle of a triangle: a corner might be shared with the other component.
            let x = (a + b + c) / 3.0;
            let around = components.iter().zip(&boxes).filter(|(other, [low, high])| {
                !std::ptr::eq(*other, component)
                    && x.cmpge(*low).all()
                    && x.cmple(*high).all()
                    && self.winding(other, flipped, x).abs() > 0.5
            });
            let cavity = around.count() % 2 == 1;
            if (self.volume(component, flipped) < 0.0) != cavity {
                component.flip(flipped);
            }
        }
        None
    }

    fn oriented(&self, t: u32, flipped: &[bool]) -> [DVec3; 3] {
        let [a, b, c] = self.corners(t as usize);
        if flipped[t as usize] { [a, c, b] } else { [a, b, c] }
    }

    fn bounds(&self, component: &Component) -> [DVec3; 2] {
        let corners = component.triangles.iter().flat_map(|&t| self.corners(t as usize));
        corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
    }

    /// Six times the signed volume, about a point of the component so that distance from the origin costs no digits.
    fn volume(&self, component: &Component, flipped: &[bool]) -> f64 {
        let origin = self.corners(component.triangles[0] as usize)[0];
        let volume = |&t: &u32| {
            let [a, b, c] = self.oriented(t, flipped).map(|p| p - origin);
            a.dot(b.cross(c))
        };
        component.triangles.iter().map(volume).sum()
    }

    /// How often the component winds around x, by solid angles (Van Oosterom and Strackee 1983).
    fn winding(&self, component: &Component, flipped: &[bool], x: DVec3) -> f64 {
        let half_angle = |&t: &u32| {
            let [a, b, c] = self.oriented(t, flipped).map(|p| p - x);
            let (la, lb, lc) = (a.length(), b.length(), c.length());
            libm::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
        };
        component.triangles.iter().map(half_angle).sum::<f64>() / (2.0 * std::f64::consts::PI)
    }
}

impl Component {
    fn flip(&self, flipped: &mut [bool]) {
        for &t in &self.triangles {
            flipped[t as usize] ^= true;
        }
    }
}

fn in_mm(p: DVec3) -> String {
    let p = p * 1e3;
    format!("({:.3}, {:.3}, {:.3}) mm", p.x, p.y, p.z)
}
