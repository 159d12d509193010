//! The `.paths` file: every load path that a run simulated, state by state. `docs/paths-file.md` describes it.
//!
//! A run keeps one such file for each finished point, and merges them when all are there; a shard is one with some of
//! the points. Each point carries a digest of its own, so that points move between files as they are.

mod field;

pub use field::LEVELS;

use anyhow::{Result, anyhow};
use glam::{DMat3, DVec3};
use palpate_body::TriangleMesh;
use palpate_files as files;
use palpate_simulate::{Drag, Path as LoadPath, PointPaths, PointPlan, State, Stop};
use safetensors::Dtype::{self, F64, U8, U32};
use safetensors::tensor::{Metadata, TensorInfo};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const SCHEMA: &str = "palpate-paths";
const VERSION: u32 = 2;
const UNITS: &str = "SI: m, N, N m";
/// Bytes of the header's length, which the file begins with.
const LENGTH: usize = size_of::<u64>();
/// Bytes a header may have; 5,000 points with four drags have 10 MB.
const MAX_HEADER: u64 = 90 << 20;
/// Columns of a point's states.
pub const COLUMNS: [&str; 14] = [
    "depth_m",
    "distance_m",
    "force_x_n",
    "force_y_n",
    "force_z_n",
    "torque_x_n_m",
    "torque_y_n_m",
    "torque_z_n_m",
    "patch_m2",
    "iterations",
    "pressed_n",
    "slipping",
    "indefinite",
    "displacement_unit_m",
];
/// Version 1 had none of the three before the last.
const COLUMNS_1: usize = 11;
/// Numbers of a stuck tangent.
const TANGENT: usize = 36;

/// What a run was asked. Runs of equal plans give equal records.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathsPlan {
    /// Name and version of the program.
    pub software: String,
    /// The spec's file name.
    pub spec_name: String,
    /// The spec's text.
    pub spec: String,
    /// SHA-256 of each file that the spec names, by the name it has there.
    pub inputs: BTreeMap<String, String>,
    /// The contact that was simulated; `None`: what the spec says or, where it says nothing, what was the default of files of
    /// version 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<String>,
    /// The kind of machine (see [`palpate_simulate::instruction_set`]); files of version 1 don't say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<String>,
}

impl PathsPlan {
    /// What differs in `other`, in words; `None` if nothing does.
    pub fn difference(&self, other: &PathsPlan) -> Option<String> {
        if self.spec != other.spec {
            let line = self.spec.lines().zip(other.spec.lines()).position(|(a, b)| a != b);
            let line = line.unwrap_or_else(|| self.spec.lines().count().min(other.spec.lines().count()));
            return Some(format!("the spec (line {})", line + 1));
        }
        let names: BTreeSet<_> = self.inputs.keys().chain(other.inputs.keys()).collect();
        if let Some(name) = names.into_iter().find(|n| self.inputs.get(*n) != other.inputs.get(*n)) {
            return Some(format!("the file {name}"));
        }
        if self.software != other.software {
            return Some(format!("the program ({}, now {})", self.software, other.software));
        }
        if self.machine != other.machine {
            let kind = |plan: &PathsPlan| plan.machine.clone().unwrap_or_else(|| "unknown".into());
            return Some(format!("the kind of machine ({}, now {})", kind(self), kind(other)));
        }
        if self.contact != other.contact {
            return Some("the default contact".into());
        }
        (self != other).then(|| format!("the spec's name ({}, now {})", self.spec_name, other.spec_name))
    }
}

/// What all points of a run share besides its plan.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// The surface that is touched, repaired, m.
    pub surface: TriangleMesh,
    /// Stiffness of the body at rest at each node that this surface gets (more than one where
    /// it is creased), N/m: what responses go with between test points.
    pub guide_n_per_m: Vec<f64>,
    /// The compliance at rest that it comes from, in the body's axes, m/N; empty if it was not found.
    pub compliance_m_per_n: Vec<DMat3>,
    /// Nodes of the simulated mesh's boundary at rest, m; displacement fields are theirs.
    pub boundary_m: Vec<DVec3>,
    /// Its faces: indices into `boundary_m`, three corners and the middles of the edges 01, 12, 20.
    pub faces: Vec<[u32; 6]>,
    /// What was repaired or assumed.
    pub notes: Vec<String>,
}

/// A test point: where it is, and what is done there.
#[derive(Debug, Clone, PartialEq)]
pub struct TestPoint {
    /// Node of the surface.
    pub node: u32,
    /// What is done there.
    pub plan: PointPlan,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    index: u32,
    node: u32,
    point_m: [f64; 3],
    inward: [f64; 3],
    depths_m: Vec<f64>,
    drags: Vec<DragEntry>,
    press: PathEntry,
    dragged: Vec<PathEntry>,
    boundary_nodes: u32,
    /// Which of the press's states have a stuck tangent.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    tangents: Vec<u32>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DragEntry {
    from: u32,
    direction: [f64; 3],
    distances_m: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PathEntry {
    states: u32,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    stopped: Option<StopEntry>,
    /// See [`LoadPath::halved`].
    #[serde(skip_serializing_if = "Option::is_none", default)]
    halved: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StopEntry {
    at_m: f64,
    why: String,
}

impl PathEntry {
    fn of(path: &LoadPath) -> Self {
        let stopped = path.stopped.as_ref().map(|s| StopEntry { at_m: s.at_m, why: s.why.clone() });
        PathEntry { states: path.states.len() as u32, stopped, halved: path.halved }
    }
}

/// A point's record as it stands in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    entry: Entry,
    states: Vec<u8>,
    tangents: Vec<u8>,
    fields: Fields,
    digest: String,
}

/// Where the bytes of a point's displacement fields are: they may be many.
#[derive(Debug, Clone, PartialEq)]
enum Fields {
    Here(Vec<u8>),
    In { file: PathBuf, start: u64, length: u64 },
}

impl Fields {
    fn len(&self) -> u64 {
        match self {
            Fields::Here(bytes) => bytes.len() as u64,
            Fields::In { length, .. } => *length,
        }
    }

    fn bytes(&self) -> Result<Vec<u8>> {
        match self {
            Fields::Here(bytes) => Ok(bytes.clone()),
            Fields::In { file, start, length } => {
                let read = || {
                    let mut source = File::open(file)?;
                    source.seek(SeekFrom::Start(*start))?;
                    let mut bytes = Vec::new();
                    source.take(*length).read_to_end(&mut bytes)?;
                    Ok(bytes)
                };
                read().map_err(|e| files::unreadable(file, &e))
            }
        }
    }
}

impl Point {
    /// The record of what came of test point `index`. Every state has a displacement for each of `nodes`, or none.
    pub fn new(index: u32, point: &TestPoint, paths: &PointPaths, nodes: usize) -> Self {
        let TestPoint { node, plan } = point;
        let drag = |d: &Drag| DragEntry {
            from: d.from as u32,
            direction: d.direction.to_array(),
            distances_m: d.distances.clone(),
        };
        let all: Vec<&State> =
            std::iter::once(&paths.press).chain(&paths.drags).flat_map(|path| &path.states).collect();
        let press = || paths.press.states.iter().enumerate();
        let with_tangent = || press().filter_map(|(i, s)| Some((i, s.tangent.as_ref()?)));
        // Fields are kept for all states or for none.
        let nodes = if all.iter().all(|s| s.displacement_m.len() == nodes) { nodes } else { 0 };
        let entry = Entry {
            index,
            node: *node,
            point_m: plan.point.to_array(),
            inward: plan.inward.to_array(),
            depths_m: plan.depths.clone(),
            drags: plan.drags.iter().map(drag).collect(),
            press: PathEntry::of(&paths.press),
            dragged: paths.drags.iter().map(PathEntry::of).collect(),
            boundary_nodes: nodes as u32,
            tangents: with_tangent().map(|(i, _)| i as u32).collect(),
        };
        let row = |s: &&State| {
            let (f, t) = (s.force_n, s.torque_n_m);
            let unit = if nodes > 0 { field::unit_m(&s.displacement_m) } else { 0.0 };
            let iterations = f64::from(s.iterations);
            let indefinite = f64::from(u8::from(s.indefinite));
            [
                [s.depth_m, s.distance_m, f.x, f.y, f.z, t.x, t.y].as_slice(),
                &[t.z, s.patch_m2, iterations, s.pressed_n, s.slipping, indefinite, unit],
            ]
            .concat()
        };
        let states: Vec<u8> = all.iter().flat_map(row).flat_map(f64::to_le_bytes).collect();
        let tangents = with_tangent().flat_map(|(_, t)| t.as_flattened().iter().copied());
        let tangents: Vec<u8> = tangents.flat_map(f64::to_le_bytes).collect();
        let fields = if nodes > 0 { field::compress(&all, nodes) } else { Vec::new() };
        let digest = digest(&entry, [&states, &tangents, &fields]);
        Point { entry, states, tangents, fields: Fields::Here(fields), digest }
    }

    /// From a file of an older version, whose states have no column between the iterations and the displacements' unit.
    fn upgraded(self) -> Result<Self> {
        let mut states = Vec::with_capacity(self.states.len() / COLUMNS_1 * COLUMNS.len());
        for row in self.states.chunks_exact(8 * COLUMNS_1) {
            let (known, unit) = row.split_at(8 * (COLUMNS_1 - 1));
            states.extend_from_slice(known);
            states.extend([0; 8 * (COLUMNS.len() - COLUMNS_1)]);
            states.extend_from_slice(unit);
        }
        let digest = digest(&self.entry, [&states, &self.tangents, &self.fields.bytes()?]);
        Ok(Point { states, digest, ..self })
    }

    /// Which test point.
    pub fn index(&self) -> u32 {
        self.entry.index
    }

    /// Where it is, and what was to be done there.
    pub fn test_point(&self) -> TestPoint {
        let e = &self.entry;
        let drag = |d: &DragEntry| Drag {
            from: d.from as usize,
            direction: DVec3::from_array(d.direction),
            distances: d.distances_m.clone(),
        };
        let plan = PointPlan {
            point: DVec3::from_array(e.point_m),
            inward: DVec3::from_array(e.inward),
            depths: e.depths_m.clone(),
            drags: e.drags.iter().map(drag).collect(),
        };
        TestPoint { node: e.node, plan }
    }

    /// What came of it, without displacements.
    pub fn paths(&self) -> PointPaths {
        let mut rows = self.states.chunks_exact(8 * COLUMNS.len()).map(|row| {
            let number = |c: usize| {
                let bytes = row.get(8 * c..).and_then(|b| b.first_chunk());
                bytes.map_or(0.0, |b| f64::from_le_bytes(*b))
            };
            State {
                depth_m: number(0),
                distance_m: number(1),
                force_n: DVec3::new(number(2), number(3), number(4)),
                torque_n_m: DVec3::new(number(5), number(6), number(7)),
                patch_m2: number(8),
                iterations: number(9) as u32,
                pressed_n: number(10),
                slipping: number(11),
                indefinite: number(12) != 0.0,
                tangent: None,
                displacement_m: Vec::new(),
            }
        });
        let mut path = |entry: &PathEntry| LoadPath {
            states: rows.by_ref().take(entry.states as usize).collect(),
            stopped: entry.stopped.as_ref().map(|s| Stop { at_m: s.at_m, why: s.why.clone() }),
            halved: entry.halved,
        };
        let mut paths = PointPaths {
            press: path(&self.entry.press),
            drags: self.entry.dragged.iter().map(path).collect(),
        };
        for (&i, tangent) in self.entry.tangents.iter().zip(numbers(&self.tangents).as_chunks::<TANGENT>().0)
        {
            if let Some(state) = paths.press.states.get_mut(i as usize) {
                let row = |r: usize| std::array::from_fn(|c| tangent[6 * r + c]);
                state.tangent = Some(Box::new(std::array::from_fn(row)));
            }
        }
        paths
    }

    /// What came of it, with displacements, each of them within half of 1/[`LEVELS`] of its state's largest.
    ///
    /// # Errors
    /// The file that they are in can't be read or was changed.
    pub fn paths_with_displacements(&self) -> Result<PointPaths> {
        let units: Vec<f64> = self.units_m(COLUMNS.len());
        let bytes = self.fields.bytes()?;
        let fields = if self.entry.boundary_nodes == 0 {
            vec![Vec::new(); units.len()]
        } else {
            let damaged =
                || anyhow!("point {}: its displacements are damaged; run it again", self.entry.index);
            field::expand(&bytes, &units, self.entry.boundary_nodes as usize).ok_or_else(damaged)?
        };
        let mut paths = self.paths();
        let states = std::iter::once(&mut paths.press).chain(&mut paths.drags).flat_map(|p| &mut p.states);
        states.zip(fields).for_each(|(state, field)| state.displacement_m = field);
        Ok(paths)
    }

    fn units_m(&self, columns: usize) -> Vec<f64> {
        let unit = |row: &[u8]| row.last_chunk().map_or(0.0, |b| f64::from_le_bytes(*b));
        self.states.chunks_exact(8 * columns).map(unit).collect()
    }

    /// Everything that a damaged or foreign record with this many columns could get wrong.
    fn check(&self, columns: usize) -> std::result::Result<(), String> {
        let e = &self.entry;
        let bad = |problem: &str| Err(format!("point {}: {problem}", e.index));
        let fields = self.fields.bytes().map_err(|e| e.to_string())?;
        if digest(e, [&self.states, &self.tangents, &fields]) != self.digest {
            return bad("its digest is another");
        }
        let rows: usize = std::iter::once(&e.press).chain(&e.dragged).map(|p| p.states as usize).sum();
        if self.states.len() != rows * 8 * columns {
            return bad("its states are too few or too many");
        }
        let ascend = e.tangents.windows(2).all(|i| i[0] < i[1]);
        if !ascend
            || e.tangents.last().is_some_and(|i| *i >= e.press.states)
            || self.tangents.len() != e.tangents.len() * 8 * TANGENT
        {
            return bad("its tangents are not those of its states");
        }
        if e.press.states as usize > e.depths_m.len() || e.dragged.len() != e.drags.len() {
            return bad("its paths are not those of its plan");
        }
        for (drag, path) in e.drags.iter().zip(&e.dragged) {
            let reached = (drag.from as usize) < e.press.states as usize;
            if path.states as usize > drag.distances_m.len() || (path.states > 0 && !reached) {
                return bad("a drag has more states than its plan");
            }
        }
        let numbers = [&self.states, &self.tangents].into_iter().flat_map(|bytes| numbers(bytes));
        let planned = e.point_m.iter().chain(&e.inward).chain(&e.depths_m);
        let planned = planned.chain(e.drags.iter().flat_map(|d| d.direction.iter().chain(&d.distances_m)));
        if !numbers.chain(planned.copied()).all(f64::is_finite) {
            return bad("a number of it is not finite");
        }
        if e.boundary_nodes > 0
            && field::expand(&fields, &self.units_m(columns), e.boundary_nodes as usize).is_none()
        {
            return bad("its displacements are damaged");
        }
        Ok(())
    }

    fn tensors(&self) -> [(String, Dtype, Vec<usize>); 3] {
        let i = self.entry.index;
        let rows = self.states.len() / (8 * COLUMNS.len());
        [
            (format!("states_{i}"), F64, vec![rows, COLUMNS.len()]),
            (format!("tangents_{i}"), F64, vec![self.entry.tangents.len(), 6, 6]),
            (format!("fields_{i}"), U8, vec![self.fields.len() as usize]),
        ]
    }
}

fn digest(entry: &Entry, tensors: [&[u8]; 3]) -> String {
    let mut hash = Sha256::new();
    // An entry that can't be written has an empty text, and so its own digest.
    hash.update(serde_json::to_vec(entry).unwrap_or_default());
    tensors.into_iter().for_each(|bytes| hash.update(bytes));
    files::hex(&hash.finalize())
}

/// A record: points of one plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PathsRecord {
    /// What was asked.
    pub plan: PathsPlan,
    /// How many test points the plan has.
    pub total: u32,
    /// What the points share; a running run's records of single points are without.
    pub scene: Option<Scene>,
    /// By index.
    pub points: BTreeMap<u32, Point>,
}

#[derive(Serialize, Deserialize)]
struct Listed {
    #[serde(flatten)]
    entry: serde_json::Value,
    sha256: String,
}

#[derive(Serialize)]
struct PathsHeader {
    __metadata__: BTreeMap<&'static str, String>,
    #[serde(flatten)]
    tensors: BTreeMap<String, TensorInfo>,
}

const SURFACE_POSITIONS: &str = "surface_positions_m";
const SURFACE_TRIANGLES: &str = "surface_triangles";
const GUIDE: &str = "guide_n_per_m";
const COMPLIANCE: &str = "rest_compliance_m_per_n";
const BOUNDARY_POSITIONS: &str = "boundary_positions_m";
const BOUNDARY_FACES: &str = "boundary_faces";

impl PathsRecord {
    /// Writes the record as a whole or not at all. The same record gives the same bytes.
    ///
    /// # Errors
    /// `path` can't be written, or a point's displacements can't be read any more.
    pub fn save(&self, path: &Path) -> Result<()> {
        let header = self.header().map_err(|e| anyhow!("{}: {e}; use fewer test points", path.display()))?;
        files::replace(path, |out| {
            out.write_all(&header)?;
            self.write_tensors(out)
        })
    }

    /// Tensors in their order in the file, wider numbers first, so that all are aligned.
    fn layout(&self) -> Vec<(String, Dtype, Vec<usize>)> {
        let mut layout = Vec::new();
        let (states, fields): (Vec<_>, Vec<_>) =
            self.points.values().map(|p| p.tensors()).map(|[s, t, f]: [_; 3]| ([s, t], f)).unzip();
        let scene = self.scene.as_ref();
        if let Some(scene) = scene {
            layout.push((SURFACE_POSITIONS.into(), F64, vec![scene.surface.positions.len(), 3]));
            layout.push((GUIDE.into(), F64, vec![scene.guide_n_per_m.len(), 1]));
            layout.push((COMPLIANCE.into(), F64, vec![scene.compliance_m_per_n.len(), 6]));
            layout.push((BOUNDARY_POSITIONS.into(), F64, vec![scene.boundary_m.len(), 3]));
        }
        layout.extend(states.into_iter().flatten());
        if let Some(scene) = scene {
            layout.push((SURFACE_TRIANGLES.into(), U32, vec![scene.surface.triangles.len(), 3]));
            layout.push((BOUNDARY_FACES.into(), U32, vec![scene.faces.len(), 6]));
        }
        layout.extend(fields);
        layout
    }

    fn header(&self) -> Result<Vec<u8>> {
        let mut tensors = BTreeMap::new();
        let mut end = 0;
        for (name, dtype, shape) in self.layout() {
            let start = end;
            end += shape.iter().product::<usize>() * (dtype.bitsize() / 8);
            tensors.insert(name, TensorInfo { dtype, shape, data_offsets: (start, end) });
        }
        let listed =
            |p: &Point| Ok(Listed { entry: serde_json::to_value(&p.entry)?, sha256: p.digest.clone() });
        let points: Vec<Listed> = self.points.values().map(listed).collect::<serde_json::Result<_>>()?;
        let mut metadata = BTreeMap::from([
            ("schema", SCHEMA.to_string()),
            ("version", VERSION.to_string()),
            ("units", UNITS.to_string()),
            ("columns", COLUMNS.join(",")),
            ("plan", serde_json::to_string(&self.plan)?),
            ("test_points", self.total.to_string()),
            ("points", serde_json::to_string(&points)?),
        ]);
        if let Some(scene) = &self.scene {
            metadata.insert("notes", serde_json::to_string(&scene.notes)?);
        }
        let mut header = vec![0; LENGTH];
        serde_json::to_writer(&mut header, &PathsHeader { __metadata__: metadata, tensors })?;
        header.resize(header.len().next_multiple_of(8), b' ');
        let length = (header.len() - LENGTH) as u64;
        anyhow::ensure!(
            length <= MAX_HEADER,
            "its header would have {length} bytes, where {MAX_HEADER} are allowed"
        );
        header[..LENGTH].copy_from_slice(&length.to_le_bytes());
        Ok(header)
    }

    fn write_tensors(&self, out: &mut dyn Write) -> Result<()> {
        let mut doubles = |numbers: &mut dyn Iterator<Item = f64>| {
            numbers.map(f64::to_le_bytes).try_for_each(|bytes| out.write_all(&bytes))
        };
        if let Some(scene) = &self.scene {
            doubles(&mut scene.surface.positions.iter().flat_map(|v| v.to_array()))?;
            doubles(&mut scene.guide_n_per_m.iter().copied())?;
            doubles(&mut scene.compliance_m_per_n.iter().flat_map(six))?;
            doubles(&mut scene.boundary_m.iter().flat_map(|v| v.to_array()))?;
        }
        for point in self.points.values() {
            out.write_all(&point.states)?;
            out.write_all(&point.tangents)?;
        }
        if let Some(scene) = &self.scene {
            let numbers = scene.surface.triangles.iter().flatten().chain(scene.faces.iter().flatten());
            numbers.map(|n| n.to_le_bytes()).try_for_each(|bytes| out.write_all(&bytes))?;
        }
        for point in self.points.values() {
            let fields = point.fields.bytes()?;
            // The file that it comes from may have been changed since it was read.
            anyhow::ensure!(
                digest(&point.entry, [&point.states, &point.tangents, &fields]) == point.digest,
                "point {}: its record was changed while it was read; run the command again",
                point.entry.index
            );
            out.write_all(&fields)?;
        }
        Ok(())
    }

    /// Reads and checks a record. Displacements stay in the file, which must not be changed meanwhile.
    ///
    /// # Errors
    /// The file can't be read, is no record, is damaged, or was made by a newer version.
    pub fn open(path: &Path) -> Result<Self> {
        let mut file = File::open(path).map_err(|e| files::unreadable(path, &e))?;
        let size = file.metadata().map_err(|e| files::unreadable(path, &e))?;
        if !size.is_file() {
            return Err(anyhow!("{}: it is no ordinary file; name a .paths file", path.display()));
        }
        let bad = |problem: String| {
            anyhow!("{}: {problem}; it is no .paths file, or a damaged one: make it again", path.display())
        };
        let mut bytes = |length: u64| {
            let mut bytes = Vec::new();
            match (&mut file).take(length).read_to_end(&mut bytes) {
                Ok(count) if count as u64 == length => Ok(bytes),
                Ok(_) => Err(bad("it ends too early".into())),
                Err(e) => Err(files::unreadable(path, &e)),
            }
        };
        let length = bytes(LENGTH as u64)?;
        let length = length.first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
        if length > size.len().min(MAX_HEADER) {
            return Err(bad(format!("its header's length is {length} bytes")));
        }
        let header = bytes(length)?;
        // Parsing also checks that tensors follow each other without gaps and that each has its shape's length.
        let header: Metadata = serde_json::from_slice(&header).map_err(|e| bad(format!("header: {e}")))?;
        let head = Head { header: &header, bad: &bad };
        if head.text("schema")? != SCHEMA {
            return Err(bad(format!("its schema is `{}`", head.text("schema")?.escape_debug())));
        }
        let version = head.text("version")?.parse::<u32>().unwrap_or(0);
        if version > VERSION {
            return Err(anyhow!("{}: a newer palpate made it; update", path.display()));
        }
        if version == 0 || head.text("units")? != UNITS {
            return Err(bad("its version or units are unknown".into()));
        }
        let columns = if version == 1 { COLUMNS_1 } else { COLUMNS.len() };
        let begin = LENGTH as u64 + length;
        if begin + header.data_len() as u64 != size.len() {
            return Err(bad(format!("it has {} bytes, not those its header tells", size.len())));
        }
        let plan: PathsPlan = head.json("plan")?;
        let total = head.json("test_points")?;
        let listed: Vec<Listed> = head.json("points")?;
        let tensor = |name: &str, dtype: Dtype, columns: &[usize]| match header.info(name) {
            Some(t) if t.dtype == dtype && t.shape.get(1..) == Some(columns) => Ok(t.data_offsets),
            _ => Err(bad(format!("tensor {name} is missing or of another kind"))),
        };
        let mut source = File::open(path).map_err(|e| files::unreadable(path, &e))?;
        let mut read = |(start, end): (usize, usize)| {
            let mut bytes = Vec::new();
            source.seek(SeekFrom::Start(begin + start as u64)).map_err(|e| files::unreadable(path, &e))?;
            match (&mut source).take((end - start) as u64).read_to_end(&mut bytes) {
                Ok(count) if count == end - start => Ok(bytes),
                Ok(_) => Err(bad("it ends too early".into())),
                Err(e) => Err(files::unreadable(path, &e)),
            }
        };
        let scene = match header.info(SURFACE_POSITIONS) {
            None => None,
            Some(_) => {
                let scene = Scene {
                    surface: TriangleMesh {
                        positions: vectors(&read(tensor(SURFACE_POSITIONS, F64, &[3])?)?),
                        triangles: indices(&read(tensor(SURFACE_TRIANGLES, U32, &[3])?)?),
                    },
                    guide_n_per_m: numbers(&read(tensor(GUIDE, F64, &[1])?)?),
                    compliance_m_per_n: match version {
                        1 => Vec::new(),
                        _ => symmetric(&read(tensor(COMPLIANCE, F64, &[6])?)?),
                    },
                    boundary_m: vectors(&read(tensor(BOUNDARY_POSITIONS, F64, &[3])?)?),
                    faces: indices(&read(tensor(BOUNDARY_FACES, U32, &[6])?)?),
                    notes: head.json("notes")?,
                };
                let within = |n: &u32, count: usize| (*n as usize) < count;
                let (nodes, boundary) = (scene.surface.positions.len(), scene.boundary_m.len());
                if !scene.surface.triangles.iter().flatten().all(|n| within(n, nodes))
                    || !scene.faces.iter().flatten().all(|n| within(n, boundary))
                    || !scene.compliance_m_per_n.iter().all(|s| s.is_finite())
                    || !scene.guide_n_per_m.iter().all(|g| *g > 0.0 && g.is_finite())
                    || !scene.surface.positions.iter().chain(&scene.boundary_m).all(|p| p.is_finite())
                {
                    return Err(bad("its surface is damaged".into()));
                }
                Some(scene)
            }
        };
        let mut points = BTreeMap::new();
        for Listed { entry, sha256 } in listed {
            let entry: Entry = serde_json::from_value(entry).map_err(|e| bad(format!("points: {e}")))?;
            let index = entry.index;
            let states = read(tensor(&format!("states_{index}"), F64, &[columns])?)?;
            let tangents = match version {
                1 => Vec::new(),
                _ => read(tensor(&format!("tangents_{index}"), F64, &[6, 6])?)?,
            };
            let (start, end) = tensor(&format!("fields_{index}"), U8, &[])?;
            let (start, length) = (begin + start as u64, (end - start) as u64);
            let fields = Fields::In { file: path.to_path_buf(), start, length };
            let mut point = Point { entry, states, tangents, fields, digest: sha256 };
            point.check(columns).map_err(bad)?;
            if version == 1 {
                point = point.upgraded()?;
            }
            let nodes = scene.as_ref().map_or(u64::from(u32::MAX), |s| s.surface.positions.len() as u64);
            let foreign = index >= total || u64::from(point.entry.node) >= nodes;
            if foreign || points.insert(index, point).is_some() {
                return Err(bad(format!("point {index} is there twice, or is none of the plan's")));
            }
        }
        Ok(PathsRecord { plan, total, scene, points })
    }
}

struct Head<'a> {
    header: &'a Metadata,
    bad: &'a dyn Fn(String) -> anyhow::Error,
}

impl Head<'_> {
    fn text(&self, key: &str) -> Result<&str> {
        let text = self.header.metadata().as_ref().and_then(|m| m.get(key));
        text.map(String::as_str).ok_or_else(|| (self.bad)(format!("its metadata has no `{key}`")))
    }

    fn json<T: serde::de::DeserializeOwned>(&self, key: &str) -> Result<T> {
        serde_json::from_str(self.text(key)?).map_err(|e| (self.bad)(format!("metadata `{key}`: {e}")))
    }
}

fn numbers(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect()
}

/// xx, yy, zz, xy, xz, yz.
fn six(m: &DMat3) -> [f64; 6] {
    [m.x_axis.x, m.y_axis.y, m.z_axis.z, m.x_axis.y, m.x_axis.z, m.y_axis.z]
}

fn symmetric(bytes: &[u8]) -> Vec<DMat3> {
    let rows = numbers(bytes);
    let matrix = |&[xx, yy, zz, xy, xz, yz]: &[f64; 6]| {
        DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
    };
    rows.as_chunks::<6>().0.iter().map(matrix).collect()
}

fn vectors(bytes: &[u8]) -> Vec<DVec3> {
    numbers(bytes).as_chunks::<3>().0.iter().map(|v| DVec3::from_array(*v)).collect()
}

fn indices<const N: usize>(bytes: &[u8]) -> Vec<[u32; N]> {
    let numbers: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
    numbers.as_chunks::<N>().0.to_vec()
}
