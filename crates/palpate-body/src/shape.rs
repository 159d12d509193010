//! Shapes that mesh themselves: centred at the origin, axes along z, facing out.

use crate::error::{BodyError, Result};
use crate::surface::{Surface, TriangleMesh};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::f64::consts::PI;

/// Meshes beyond this many triangles are refused.
pub const MAX_TRIANGLES: f64 = 50e6;

/// Lengths below a micrometre or beyond MAX_LENGTH_MM (mm) are taken for a mistake.
const MIN_LENGTH_MM: f64 = 1e-3;
const MAX_LENGTH_MM: f64 = 1e5;

/// A shape and its size, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A tube around z; vertex `row * around + column` of its wall lies at height row and angle 2π column/around.
    Cylinder {
        /// Radius, mm.
        radius_mm: f64,
        /// Length along z, mm.
        length_mm: f64,
        /// Whether discs close its ends.
        caps: bool,
    },
    /// A sphere.
    Sphere {
        /// Radius, mm.
        radius_mm: f64,
    },
    /// A box.
    Block {
        /// Whole edges along x, y, z, mm.
        size_mm: [f64; 3],
    },
    /// An ellipsoid.
    Ellipsoid {
        /// Half-axes along x, y, z, mm.
        radii_mm: [f64; 3],
    },
    /// A ring around z.
    Torus {
        /// Of the ring's middle line, and of its tube, mm.
        radii_mm: [f64; 2],
    },
}

/// How fine the mesh is. With nothing given, edges are a twelfth of the shape's size.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Resolution {
    /// Mean edge length, mm.
    pub edge_length_mm: Option<f64>,
    /// Divisions around z, of a cylinder or torus.
    pub around: Option<u32>,
    /// Divisions along a cylinder, or around a torus's tube.
    pub along: Option<u32>,
}

impl Shape {
    /// Triangulates the shape, m. Cylinder walls, tori and blocks are grids, spheres and ellipsoids divided
    /// icosahedra. The bits are the same on every machine.
    ///
    /// # Errors
    /// A size that is not positive or is absurd, a resolution that does not fit the shape, or more than 50 million
    /// triangles.
    pub fn mesh(&self, resolution: Resolution) -> Result<TriangleMesh> {
        let divisions = self.divisions(resolution)?;
        let mut mesh = match (*self, divisions) {
            (Shape::Cylinder { radius_mm, length_mm, caps }, Divisions::Grid { around, along }) => {
                cylinder(radius_mm, length_mm, caps, around, along)
            }
            (Shape::Torus { radii_mm }, Divisions::Grid { around, along }) => torus(radii_mm, around, along),
            (Shape::Block { size_mm }, Divisions::Block(counts)) => block(size_mm, counts),
            (Shape::Sphere { radius_mm }, Divisions::Icosahedron(n)) => icosphere(DVec3::splat(radius_mm), n),
            (Shape::Ellipsoid { radii_mm }, Divisions::Icosahedron(n)) => {
                icosphere(DVec3::from_array(radii_mm), n)
            }
            _ => TriangleMesh::default(),
        };
        for p in &mut mesh.positions {
            *p /= 1e3;
        }
        Ok(mesh)
    }

    /// The mesh as a surface without creases.
    ///
    /// # Errors
    /// As [`Shape::mesh`], and a resolution so uneven that triangles have no area.
    pub fn surface(&self, resolution: Resolution) -> Result<Surface> {
        Surface::build(&self.mesh(resolution)?, f64::INFINITY)
    }

    /// Whole extent along x, y, z, mm.
    fn extent(&self) -> DVec3 {
        match *self {
            Shape::Cylinder { radius_mm, length_mm, .. } => {
                DVec3::new(2.0 * radius_mm, 2.0 * radius_mm, length_mm)
            }
            Shape::Sphere { radius_mm } => DVec3::splat(2.0 * radius_mm),
            Shape::Block { size_mm } => DVec3::from_array(size_mm),
            Shape::Ellipsoid { radii_mm } => DVec3::from_array(radii_mm) * 2.0,
            Shape::Torus { radii_mm: [ring, tube] } => DVec3::new(ring + tube, ring + tube, tube) * 2.0,
        }
    }

    fn check_size(&self) -> Result<()> {
        let (key, lengths): (_, &[f64]) = match self {
            Shape::Cylinder { radius_mm, length_mm, .. } => {
                check_length("length_mm", *length_mm)?;
                ("radius_mm", &[*radius_mm])
            }
            Shape::Sphere { radius_mm } => ("radius_mm", &[*radius_mm]),
            Shape::Block { size_mm } => ("size_mm", size_mm),
            Shape::Ellipsoid { radii_mm } => ("radii_mm", radii_mm),
            Shape::Torus { radii_mm } => ("radii_mm", radii_mm),
        };
        lengths.iter().try_for_each(|&length| check_length(key, length))?;
        match self {
            Shape::Torus { radii_mm: [ring, tube] } if tube >= ring => Err(invalid(
                "radii_mm",
                format!("the tube's radius {tube} mm is not smaller than the ring's, {ring} mm"),
                "give the ring's radius first, and a thinner tube",
            )),
            _ => Ok(()),
        }
    }

    /// How often each direction is divided, checked.
    fn divisions(&self, resolution: Resolution) -> Result<Divisions> {
        self.check_size()?;
        let Resolution { edge_length_mm, around, along } = resolution;
        let is_grid = matches!(self, Shape::Cylinder { .. } | Shape::Torus { .. });
        let keys = [("around", around), ("along", along)];
        for (key, least) in keys.into_iter().filter_map(|(key, count)| Some((key, count?))) {
            if !is_grid {
                return Err(invalid(key, "only cylinders and tori have it", "give edge_length_mm instead"));
            }
            let needed = if key == "along" && matches!(self, Shape::Cylinder { .. }) { 1 } else { 3 };
            if least < needed {
                return Err(invalid(key, format!("it is {least}"), format!("give {needed} at least")));
            }
        }
        let extent = self.extent();
        if let Some(edge) = edge_length_mm {
            check_length("edge_length_mm", edge)?;
            if around.is_some() && along.is_some() {
                let problem = "around and along say all of it already";
                return Err(invalid("edge_length_mm", problem, "leave out one or the other"));
            }
            if edge > extent.max_element() {
                let problem =
                    format!("{edge} mm is longer than the whole shape, {} mm", extent.max_element());
                return Err(invalid("edge_length_mm", problem, "give a shorter one"));
            }
        }
        let typical = libm::cbrt(extent.x * extent.y * extent.z) / 12.0;
        let edge = |round: f64| edge_length_mm.or(around.map(|n| round / f64::from(n))).unwrap_or(typical);
        let (divisions, triangles) = match *self {
            Shape::Cylinder { radius_mm, length_mm, caps } => {
                let round = 2.0 * PI * radius_mm;
                let (n, m) =
                    (count(around, round / edge(round), 3.0), count(along, length_mm / edge(round), 1.0));
                // Discs of such edges: their area over an equilateral triangle's.
                let discs = if caps { n * n / (PI * 0.433) } else { 0.0 };
                (Divisions::Grid { around: n as u32, along: m as u32 }, 2.0 * n * m + discs)
            }
            Shape::Torus { radii_mm: [ring, tube] } => {
                let round = 2.0 * PI * ring;
                let (n, m) = (
                    count(around, round / edge(round), 3.0),
                    count(along, 2.0 * PI * tube / edge(round), 3.0),
                );
                (Divisions::Grid { around: n as u32, along: m as u32 }, 2.0 * n * m)
            }
            Shape::Block { size_mm } => {
                let [x, y, z] = size_mm.map(|size| count(None, size / edge(0.0), 1.0));
                (Divisions::Block([x, y, z].map(|n| n as u32)), 4.0 * (x * y + y * z + z * x))
            }
            Shape::Sphere { .. } | Shape::Ellipsoid { .. } => {
                // The area over that of 20 n² equilateral triangles.
                let area = ellipsoid_area(extent / 2.0);
                let n = count(None, (area / (5.0 * 3f64.sqrt())).sqrt() / edge(0.0), 1.0);
                (Divisions::Icosahedron(n as u32), 20.0 * n * n)
            }
        };
        if triangles > MAX_TRIANGLES {
            let key = if edge_length_mm.is_some() || !is_grid { "edge_length_mm" } else { "around" };
            let problem = format!("it asks for {triangles:.0} triangles, more than {MAX_TRIANGLES:.0}");
            return Err(invalid(key, problem, "make the mesh coarser"));
        }
        Ok(divisions)
    }
}

enum Divisions {
    Grid { around: u32, along: u32 },
    Block([u32; 3]),
    Icosahedron(u32),
}

fn count(given: Option<u32>, derived: f64, least: f64) -> f64 {
    given.map_or(derived.round().max(least), f64::from)
}

fn invalid(key: &str, problem: impl Into<String>, hint: impl Into<String>) -> BodyError {
    BodyError::invalid(format!("[body.shape] {key}"), problem, hint)
}

fn check_length(key: &str, length: f64) -> Result<()> {
    if (MIN_LENGTH_MM..=MAX_LENGTH_MM).contains(&length) {
        return Ok(());
    }
    let problem = format!("{length} mm is no sensible length");
    Err(invalid(key, problem, format!("give one between {MIN_LENGTH_MM} and {MAX_LENGTH_MM} mm")))
}

/// Thomsen's formula, right to 1.1 %.
fn ellipsoid_area(radii: DVec3) -> f64 {
    let [a, b, c] = radii.to_array().map(|r| libm::pow(r, 1.6075));
    4.0 * PI * libm::pow((a * b + a * c + b * c) / 3.0, 1.0 / 1.6075)
}

/// Unit vectors at equal angles around z, the first along x.
fn circle(n: u32) -> impl Iterator<Item = DVec3> {
    (0..n).map(move |j| {
        let angle = 2.0 * PI * f64::from(j) / f64::from(n);
        DVec3::new(libm::cos(angle), libm::sin(angle), 0.0)
    })
}

/// Two triangles for each cell between rows of a ring, all diagonals alike.
fn ring_cells(around: u32, row: u32, next_row: u32) -> impl Iterator<Item = [u32; 3]> {
    (0..around).flat_map(move |j| {
        let k = (j + 1) % around;
        let (a, b) = (row * around + j, row * around + k);
        let (c, d) = (next_row * around + k, next_row * around + j);
        [[a, b, c], [a, c, d]]
    })
}

fn cylinder(radius: f64, length: f64, caps: bool, around: u32, along: u32) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for row in 0..=along {
        let z = length * (f64::from(row) / f64::from(along) - 0.5);
        mesh.positions.extend(circle(around).map(|u| u * radius + DVec3::Z * z));
    }
    mesh.triangles.extend((0..along).flat_map(|row| ring_cells(around, row, row + 1)));
    if caps {
        disc(&mut mesh, radius, around, 0, true);
        disc(&mut mesh, radius, around, along * around, false);
    }
    mesh
}

/// Closes the rim that starts at vertex `rim` with rings whose edges are about the rim's.
fn disc(mesh: &mut TriangleMesh, radius: f64, around: u32, rim: u32, faces_down: bool) {
    let z = DVec3::Z * mesh.positions[rim as usize].z;
    // Rings stand apart by the height of an equilateral triangle.
    let rings = (f64::from(around) / (PI * 3f64.sqrt())).round().max(1.0);
    let first_new = mesh.triangles.len();
    let (mut outer, mut outer_count) = (rim, around);
    let mut ring = rings - 1.0;
    while ring > 0.0 {
        let inner = mesh.positions.len() as u32;
        let inner_count = (f64::from(around) * ring / rings).round().max(3.0) as u32;
        mesh.positions.extend(circle(inner_count).map(|u| u * (radius * ring / rings) + z));
        zip(&mut mesh.triangles, (outer, outer_count), (inner, inner_count));
        (outer, outer_count) = (inner, inner_count);
        ring -= 1.0;
    }
    let centre = mesh.positions.len() as u32;
    mesh.positions.push(z);
    mesh.triangles.extend((0..outer_count).map(|j| [outer + j, outer + (j + 1) % outer_count, centre]));
    if faces_down {
        mesh.triangles[first_new..].iter_mut().for_each(|t| t.swap(1, 2));
    }
}

/// Triangles between two rings (first vertex, count), each step on the ring that lags behind in angle.
fn zip(triangles: &mut Vec<[u32; 3]>, (outer, n): (u32, u32), (inner, m): (u32, u32)) {
    let (mut i, mut j) = (0, 0);
    while i < n || j < m {
        let (a, b) = (outer + i % n, inner + j % m);
        let outer_lags = u64::from(2 * i + 1) * u64::from(m) <= u64::from(2 * j + 1) * u64::from(n);
        if j == m || i < n && outer_lags {
            i += 1;
            triangles.push([a, outer + i % n, b]);
        } else {
            j += 1;
            triangles.push([a, inner + j % m, b]);
        }
    }
}

fn torus([ring, tube]: [f64; 2], around: u32, along: u32) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for u in circle(along) {
        let (reach, height) = (ring + tube * u.x, tube * u.y);
        mesh.positions.extend(circle(around).map(|v| v * reach + DVec3::Z * height));
    }
    mesh.triangles.extend((0..along).flat_map(|row| ring_cells(around, row, (row + 1) % along)));
    mesh
}

/// A grid on each face of the box, diagonals crossing (union jack), vertices by layers of z.
fn block(size: [f64; 3], n: [u32; 3]) -> TriangleMesh {
    let lattice = BlockLattice(n);
    let mut mesh = TriangleMesh::default();
    let at = |[i, j, k]: [u32; 3]| {
        DVec3::from_array([0, 1, 2].map(|a| size[a] * (f64::from([i, j, k][a]) / f64::from(n[a]) - 0.5)))
    };
    for k in 0..=n[2] {
        if k == 0 || k == n[2] {
            mesh.positions.extend((0..=n[1]).flat_map(|j| (0..=n[0]).map(move |i| [i, j, k])).map(at));
            continue;
        }
        let front = (0..=n[0]).map(|i| [i, 0, k]);
        let right = (1..=n[1]).map(|j| [n[0], j, k]);
        let back = (0..n[0]).rev().map(|i| [i, n[1], k]);
        let left = (1..n[1]).rev().map(|j| [0, j, k]);
        mesh.positions.extend(front.chain(right).chain(back).chain(left).map(at));
    }
    for axis in 0..3 {
        // u × v is the axis.
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (level, outward) in [(0, false), (n[axis], true)] {
            for (a, b) in (0..n[v]).flat_map(|b| (0..n[u]).map(move |a| (a, b))) {
                let corner = |du: u32, dv: u32| {
                    let mut place = [level; 3];
                    (place[u], place[v]) = (a + du, b + dv);
                    lattice.vertex(place)
                };
                let q = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                let pair = if (a + b) % 2 == 0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 1, 3], [1, 2, 3]] };
                for [x, y, z] in pair {
                    mesh.triangles.push(if outward { [q[x], q[y], q[z]] } else { [q[x], q[z], q[y]] });
                }
            }
        }
    }
    mesh
}

/// Numbers the lattice points on the outside of a box: whole layers below and above, rims between.
struct BlockLattice([u32; 3]);

impl BlockLattice {
    fn vertex(&self, [i, j, k]: [u32; 3]) -> u32 {
        let [nx, ny, nz] = self.0;
        let (layer, rim) = ((nx + 1) * (ny + 1), 2 * (nx + ny));
        let start = if k == 0 { 0 } else { layer + (k - 1) * rim };
        if k == 0 || k == nz {
            start + j * (nx + 1) + i
        } else if j == 0 {
            start + i
        } else if i == nx {
            start + nx + j
        } else if j == ny {
            start + nx + ny + (nx - i)
        } else {
            start + 2 * nx + ny + (ny - j)
        }
    }
}

/// An icosahedron whose edges are divided n times, on the ellipsoid of these radii.
fn icosphere(radii: DVec3, n: u32) -> TriangleMesh {
    let (corners, faces) = icosahedron();
    let mut mesh = TriangleMesh { positions: corners.to_vec(), triangles: Vec::new() };
    let mut edges = HashMap::new();
    for face in faces {
        // Rows from corner 0 to the edge 1-2; the points of an edge are made once.
        let mut edge = |a: u32, b: u32| -> Vec<u32> {
            let start = *edges.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let start = mesh.positions.len() as u32;
                let ends = [corners[a.min(b) as usize], corners[a.max(b) as usize]];
                mesh.positions.extend((1..n).map(|i| between(&ends, &[n - i, i], n)));
                start
            });
            let middle = (start..start + n - 1).collect::<Vec<_>>();
            let ordered: Box<dyn Iterator<Item = u32>> =
                if a < b { Box::new(middle.into_iter()) } else { Box::new(middle.into_iter().rev()) };
            std::iter::once(a).chain(ordered).chain([b]).collect()
        };
        let (left, right, last) = (edge(face[0], face[1]), edge(face[0], face[2]), edge(face[1], face[2]));
        let ends = face.map(|v| corners[v as usize]);
        let mut above = vec![face[0]];
        for row in 1..=n {
            let mut points = vec![left[row as usize]];
            if row == n {
                points = last.clone();
            } else {
                for i in 1..row {
                    points.push(mesh.positions.len() as u32);
                    mesh.positions.push(between(&ends, &[n - row, row - i, i], n));
                }
                points.push(right[row as usize]);
            }
            for i in 0..row as usize {
                mesh.triangles.push([above[i], points[i], points[i + 1]]);
                if i + 1 < row as usize {
                    mesh.triangles.push([above[i], points[i + 1], above[i + 1]]);
                }
            }
            above = points;
        }
    }
    for p in &mut mesh.positions {
        *p *= radii;
    }
    mesh
}

/// The unit vector with these parts of n; sines of the parts keep edges more alike than the parts themselves.
fn between(ends: &[DVec3], parts: &[u32], n: u32) -> DVec3 {
    // The angle of an icosahedron's edge: atan 2.
    let angle = libm::atan(2.0);
    let sum: DVec3 =
        ends.iter().zip(parts).map(|(p, &part)| *p * libm::sin(angle * f64::from(part) / f64::from(n))).sum();
    sum / sum.length()
}

/// Twelve unit vectors, two of them on z, and twenty faces.
fn icosahedron() -> ([DVec3; 12], [[u32; 3]; 20]) {
    let (height, reach) = (1.0 / 5f64.sqrt(), 2.0 / 5f64.sqrt());
    let mut corners = [DVec3::Z; 12];
    let mut faces = [[0; 3]; 20];
    for k in 0..5 {
        let at = |turn: f64, height: f64| {
            let angle = 2.0 * PI * turn / 5.0;
            DVec3::new(reach * libm::cos(angle), reach * libm::sin(angle), height)
        };
        corners[1 + k] = at(k as f64, height);
        corners[6 + k] = at(k as f64 + 0.5, -height);
        let (a, b) = (1 + k as u32, 1 + (k as u32 + 1) % 5);
        let (c, d) = (a + 5, b + 5);
        (faces[k], faces[5 + k], faces[10 + k], faces[15 + k]) =
            ([0, a, b], [a, c, b], [b, c, d], [c, 11, d]);
    }
    corners[11] = DVec3::NEG_Z;
    (corners, faces)
}

/// Kinds of [`ShapeSpec`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ShapeKind {
    /// `radius_mm`, `length_mm`, and perhaps `caps`.
    Cylinder,
    /// `radius_mm`.
    Sphere,
    /// `size_mm`.
    Block,
    /// `radii_mm`, three.
    Ellipsoid,
    /// `radii_mm`, two: the ring's and the tube's.
    Torus,
}

/// The table `[body.shape]` of a spec.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShapeSpec {
    /// Which shape.
    pub kind: ShapeKind,
    /// Radius of a cylinder or sphere, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
    /// Length of a cylinder, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_mm: Option<f64>,
    /// Whole edges of a block, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size_mm: Option<[f64; 3]>,
    /// Half-axes of an ellipsoid; ring and tube radius of a torus, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radii_mm: Option<Vec<f64>>,
    /// See [`Resolution`], mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edge_length_mm: Option<f64>,
    /// See [`Resolution`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub around: Option<u32>,
    /// See [`Resolution`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub along: Option<u32>,
    /// Whether discs close a cylinder; they do not by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub caps: Option<bool>,
}

impl ShapeSpec {
    /// The shape and its resolution, checked: [`Shape::mesh`] accepts them.
    ///
    /// # Errors
    /// A key missing, or one that does not belong to this kind; else as [`Shape::mesh`].
    pub fn resolve(&self) -> Result<(Shape, Resolution)> {
        let (name, keys): (_, &[&str]) = match self.kind {
            ShapeKind::Cylinder => ("cylinder", &["radius_mm", "length_mm", "caps"]),
            ShapeKind::Sphere => ("sphere", &["radius_mm"]),
            ShapeKind::Block => ("block", &["size_mm"]),
            ShapeKind::Ellipsoid => ("ellipsoid", &["radii_mm"]),
            ShapeKind::Torus => ("torus", &["radii_mm"]),
        };
        let given = [
            ("radius_mm", self.radius_mm.is_some()),
            ("length_mm", self.length_mm.is_some()),
            ("size_mm", self.size_mm.is_some()),
            ("radii_mm", self.radii_mm.is_some()),
            ("caps", self.caps.is_some()),
        ];
        for (key, given) in given {
            if given && !keys.contains(&key) {
                let hint = format!("remove it; a {name} has {}", keys.join(", "));
                return Err(invalid(key, format!("a {name} has no such size"), hint));
            }
        }
        let missing =
            |key: &str| invalid(key, format!("it is missing, and a {name} needs it"), "add it, in mm");
        let radius = || self.radius_mm.ok_or_else(|| missing("radius_mm"));
        let radii = || self.radii_mm.as_deref().ok_or_else(|| missing("radii_mm"));
        let miscounted = |count: usize, needed: &str| {
            invalid(
                "radii_mm",
                format!("a {name} has {needed}, but {count} are given"),
                format!("give {needed}"),
            )
        };
        let shape = match self.kind {
            ShapeKind::Cylinder => Shape::Cylinder {
                radius_mm: radius()?,
                length_mm: self.length_mm.ok_or_else(|| missing("length_mm"))?,
                caps: self.caps.unwrap_or(false),
            },
            ShapeKind::Sphere => Shape::Sphere { radius_mm: radius()? },
            ShapeKind::Block => Shape::Block { size_mm: self.size_mm.ok_or_else(|| missing("size_mm"))? },
            ShapeKind::Ellipsoid => {
                let needed = "three radii: along x, y and z";
                let radii_mm = radii()?
                    .try_into()
                    .map_err(|_| miscounted(self.radii_mm.iter().flatten().count(), needed))?;
                Shape::Ellipsoid { radii_mm }
            }
            ShapeKind::Torus => {
                let needed = "two radii: the ring's and the tube's";
                let radii_mm = radii()?
                    .try_into()
                    .map_err(|_| miscounted(self.radii_mm.iter().flatten().count(), needed))?;
                Shape::Torus { radii_mm }
            }
        };
        let &ShapeSpec { edge_length_mm, around, along, .. } = self;
        let resolution = Resolution { edge_length_mm, around, along };
        shape.divisions(resolution)?;
        Ok((shape, resolution))
    }
}
