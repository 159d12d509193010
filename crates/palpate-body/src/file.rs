//! The body file: safetensors with a schema and a version in its metadata. `docs/body-file.md` describes it.
//!
//! Everything is checked on the way in: dtypes and shapes against each other before anything is allocated, then the
//! contents by [`Curve::from_ordinates`] and [`Body::new`], as for any other body. A tensor that the file's version does
//! not know is refused, since a response that is left out would render wrong forces.

use crate::body::{BlendWeights, Body, BodyParts, Provenance, SlipRule};
use crate::curve::{Curve, Extension, check_knots};
use crate::displacement::{DisplacementFields, FieldSizes, StoredFields, field_layout};
use crate::error::{BodyError, Result};
use crate::law::QUANTITIES;
use crate::potential::{CoupledLaw, EXTENSIONS, Potential, QUANTITY_NAMES, check_range};
use crate::response::Response;
use crate::surface::{Element, Surface};
use bytemuck::{Pod, bytes_of, cast_slice, pod_collect_to_vec};
use glam::DVec3;
use safetensors::Dtype::{self, F64, U32};
use safetensors::tensor::{Metadata, TensorInfo};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

// Tensors are little endian and are copied as they are.
const _: () =
    assert!(cfg!(target_endian = "little"), "body files are read and written on little-endian machines");

const SCHEMA: &str = "palpate-body";
/// What this program reads up to. A body is written in the least version that holds all of it.
const VERSION: u32 = 7;
const UNITS: &str = "SI: m, N, J";

/// Bytes of the header's length, which the file begins with.
const LENGTH: usize = size_of::<u64>();

/// Bytes a header may have: parsing takes several times as much. A spec's text is the longest thing in it.
const MAX_HEADER: usize = 4 << 20;

/// κ₁₁, κ₁₂, κ₂₂ of each test point: a coupled law's, optional.
pub(crate) const CURVATURES: &str = "coupled_curvatures_per_m";

/// How many there are of everything.
struct Sizes {
    nodes: usize,
    elements: usize,
    test_points: usize,
    depth_knots: usize,
    lateral_knots: usize,
    /// Whether nodes have lateral tensors: version 2.
    anisotropic: bool,
    /// Whether the slip rule is another than the paper's: version 3.
    other_slip: bool,
    /// Whether the law is a coupled potential: version 4.
    coupled: bool,
    /// Whether slip is kept from giving out energy: version 4, too.
    tank: bool,
    /// How the surface moves: version 5.
    fields: Option<FieldSizes>,
    /// Whether contacts are two contact points side by side: version 6.
    partial_slip: bool,
    /// Whether friction counts the tool's way: version 7.
    curved: bool,
}

impl Sizes {
    /// The least version that holds it.
    fn version(&self) -> u32 {
        if self.curved {
            7
        } else if self.partial_slip {
            6
        } else if self.fields.is_some() {
            5
        } else if self.coupled || self.tank {
            4
        } else if self.other_slip {
            3
        } else if self.anisotropic {
            2
        } else {
            1
        }
    }
}

/// The tensors in their order in the file, wider numbers first, so that all are aligned.
///
/// Responses that depend on orientation and torque curves would be further tensors of a later version.
fn layout(s: &Sizes) -> Vec<(&'static str, Dtype, Vec<usize>)> {
    let (depth, lateral) = (s.depth_knots.saturating_sub(1), s.lateral_knots.saturating_sub(1));
    let lateral_tensors = s.anisotropic.then(|| ("lateral_tensors", F64, vec![s.nodes, 6]));
    let geometry = [
        ("positions", F64, vec![s.nodes, 3]),
        ("inward_normals", F64, vec![s.nodes, 3]),
        ("node_weights", F64, vec![s.nodes, 3]),
        ("depth_knots_m", F64, vec![s.depth_knots]),
    ];
    let law = if s.coupled {
        let curvatures = s.curved.then(|| (CURVATURES, F64, vec![s.test_points, 3]));
        let potentials = [
            ("lateral_range_m", F64, vec![1]),
            ("coupled_tangents", F64, vec![s.test_points, 2, 3]),
            ("coupled_curves", F64, vec![s.test_points, QUANTITIES, depth, 4]),
        ];
        potentials.into_iter().chain(curvatures).collect()
    } else {
        vec![
            ("lateral_knots_m", F64, vec![s.lateral_knots]),
            ("normal_curves_n", F64, vec![s.test_points, depth, 4]),
            ("friction_curves", F64, vec![s.test_points, depth, 4]),
            ("lateral_curves_n", F64, vec![s.test_points, lateral, 4]),
        ]
    };
    let numbers = [
        ("vertices", U32, vec![s.nodes]),
        ("node_test_points", U32, vec![s.nodes, 3]),
        ("triangles", U32, vec![s.elements, 3]),
        ("twins", U32, vec![s.elements, 3]),
        ("test_point_nodes", U32, vec![s.test_points]),
    ];
    let [wide, field_numbers, narrow] = s.fields.as_ref().map(field_layout).unwrap_or_default();
    let doubles = lateral_tensors.into_iter().chain(geometry).chain(law).chain(wide);
    doubles.chain(numbers).chain(field_numbers).chain(narrow).collect()
}

/// A tensor of curves.
pub(crate) struct CurveKind {
    pub tensor: &'static str,
    over_depth: bool,
    extension: Extension,
}

/// A response's curves, in the order normal, lateral, friction.
pub(crate) const CURVES: [CurveKind; 3] = [
    CurveKind { tensor: "normal_curves_n", over_depth: true, extension: Extension::Linear },
    CurveKind { tensor: "lateral_curves_n", over_depth: false, extension: Extension::Linear },
    CurveKind { tensor: "friction_curves", over_depth: true, extension: Extension::Constant },
];

/// The knots of all curves, m.
#[derive(Debug)]
pub(crate) struct SharedKnots {
    pub depth: Vec<f64>,
    pub lateral: Vec<f64>,
}

impl SharedKnots {
    fn of(&self, kind: &CurveKind) -> &[f64] {
        if kind.over_depth { &self.depth } else { &self.lateral }
    }

    /// How many intervals a kind's curves have.
    pub fn intervals(&self, kind: &CurveKind) -> usize {
        self.of(kind).len() - 1
    }

    /// The response of test point `t` from row `row` of the [`CURVES`]' ordinates.
    pub fn response(&self, t: usize, row: usize, ordinates: [&[[f64; 4]]; 3]) -> Result<Response> {
        let curve = |i: usize| {
            let (kind, count): (&CurveKind, usize) = (&CURVES[i], self.intervals(&CURVES[i]));
            let ordinates = ordinates[i].get(row * count..(row + 1) * count).unwrap_or(&[]);
            Curve::from_ordinates(self.of(kind), ordinates, kind.extension)
                .map_err(|e| within(format!("{}, test point {t}", tensor(kind.tensor)), e))
        };
        Ok(Response { normal: curve(0)?, lateral: curve(1)?, friction: curve(2)? })
    }
}

/// A coupled law's depth knots and lateral range, m.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CoupledHeader {
    pub depth: Vec<f64>,
    pub range_m: f64,
}

impl CoupledHeader {
    /// Ordinates of a test point.
    pub fn width(&self) -> usize {
        QUANTITIES * (self.depth.len() - 1)
    }

    /// The potential of test point `t` from its tangents, the surface's curvature in them, and its ordinates, one quantity after the other.
    pub fn potential(
        &self,
        t: usize,
        (tangents, curvature): ([DVec3; 2], [f64; 3]),
        ordinates: &[[f64; 4]],
    ) -> Result<Potential> {
        let intervals = self.depth.len() - 1;
        let curve = |i: usize| {
            let ordinates = ordinates.get(i * intervals..(i + 1) * intervals).unwrap_or(&[]);
            Curve::from_ordinates(&self.depth, ordinates, EXTENSIONS[i]).map_err(|e| {
                within(format!("{}, test point {t}, {}", tensor("coupled_curves"), QUANTITY_NAMES[i]), e)
            })
        };
        Ok(Potential {
            tangents,
            press: curve(0)?,
            offset: [curve(1)?, curve(2)?],
            stiffness: [curve(3)?, curve(4)?, curve(5)?],
            cubic: [curve(6)?, curve(7)?, curve(8)?, curve(9)?],
            quartic: curve(10)?,
            friction: curve(11)?,
            curvature,
        })
    }
}

/// What stands before the tensors, sorted, so that the same body has the same bytes.
#[derive(Serialize)]
struct Header {
    __metadata__: BTreeMap<&'static str, String>,
    #[serde(flatten)]
    tensors: BTreeMap<&'static str, TensorInfo>,
}

impl Body {
    /// Writes the body to `path`: to a temporary file beside it first, so that a file that is there already survives
    /// any failure. A link is followed, and a file that is there already keeps its permissions. The same body always
    /// gives the same bytes.
    ///
    /// # Errors
    /// `path` leads to something other than an ordinary file, the folder is missing, full or not writable, or the
    /// provenance is too long for a header.
    pub fn save(&self, path: &Path) -> Result<()> {
        let header = self.header().map_err(|e| e.in_file(path))?;
        let old = std::fs::metadata(path).ok();
        if old.as_ref().is_some_and(std::fs::Metadata::is_dir) {
            return Err(BodyError::io(path, io::ErrorKind::IsADirectory.into()));
        }
        if old.as_ref().is_some_and(|old| !old.is_file()) || (old.is_none() && path.is_symlink()) {
            let (problem, hint) = ("it is no ordinary file", "give a file's name");
            return Err(BodyError::invalid("output", problem, hint).in_file(path));
        }
        let write = || {
            let target = if old.is_some() { std::fs::canonicalize(path)? } else { path.to_path_buf() };
            let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let mut builder = tempfile::Builder::new();
            // A temporary file is its owner's alone; a body is an ordinary file, as far as the umask allows.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            let mut out = io::BufWriter::with_capacity(1 << 20, builder.tempfile_in(folder)?);
            self.write(&header, &mut out)?;
            let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
            if let Some(old) = &old {
                file.as_file().set_permissions(old.permissions())?;
            }
            file.as_file().sync_all()?;
            file.persist(&target).map_err(|e| e.error)?;
            // The new name is on disk once the folder is.
            #[cfg(unix)]
            std::fs::File::open(folder)?.sync_all()?;
            Ok(())
        };
        write().map_err(|e: io::Error| {
            // A temporary file's error names that file, which means nothing to the user.
            let cause = e.to_string();
            let cause = cause.split(" at path ").next().unwrap_or_default();
            BodyError::io(path, io::Error::new(e.kind(), cause))
        })
    }

    /// Reads and checks the body at `path`, which must not be rewritten meanwhile: it is mapped into memory.
    ///
    /// # Errors
    /// The file can't be read, is no body file, is damaged, or was made by a newer version.
    pub fn open(path: &Path) -> Result<Self> {
        let (source, bytes) = mapped(path)?;
        let open = || {
            let file = File::parse(&bytes)?;
            let mut body = Self::from_file(&file)?;
            // They stay where they are until somebody asks for them.
            let test_points = body.test_point_nodes.len();
            let fields = |tensors| StoredFields::in_file(path.to_path_buf(), source, tensors, test_points);
            body.displacements = file.field_places().map(fields).transpose()?;
            Ok(body)
        };
        open().map_err(|e: BodyError| e.in_file(path))
    }

    /// The body in the bytes of a body file, which may be unaligned.
    ///
    /// # Errors
    /// As [`Body::open`]; the place names the tensor or metadata key.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let file = File::parse(bytes)?;
        let body = Self::from_file(&file)?;
        let test_points = body.test_point_nodes.len();
        let read = |name: &'static str| Ok(file.bytes(name).to_vec());
        let fields = file.field_places().map(|_| DisplacementFields::from_tensors(test_points, read));
        body.with_displacement_fields(fields.transpose()?)
    }

    /// All but displacement fields.
    fn from_file(file: &File<'_>) -> Result<Self> {
        let test_point_nodes: Vec<u32> = pod_collect_to_vec(file.bytes("test_point_nodes"));
        let (mut responses, mut coupled) = (Vec::new(), None);
        if let Some(header) = file.coupled()? {
            let ordinates: Vec<[f64; 4]> = pod_collect_to_vec(file.bytes("coupled_curves"));
            let places = file.rows("coupled_tangents").zip(file.curvatures(test_point_nodes.len()));
            let rows = places.zip(ordinates.chunks_exact(header.width()));
            let potentials = rows.enumerate().map(|(t, (place, row))| header.potential(t, place, row));
            coupled =
                Some(CoupledLaw { range_m: header.range_m, potentials: potentials.collect::<Result<_>>()? });
        } else {
            let knots = file.knots()?;
            let curves = CURVES.map(|kind| pod_collect_to_vec::<u8, [f64; 4]>(file.bytes(kind.tensor)));
            let curves = curves.each_ref().map(Vec::as_slice);
            let all = (0..test_point_nodes.len()).map(|t| knots.response(t, t, curves));
            responses = all.collect::<Result<_>>()?;
        }
        let elements = file.rows("triangles").zip(file.rows("twins"));
        let blends = file.rows("node_test_points").zip(file.rows("node_weights"));
        Body::new(BodyParts {
            surface: Surface {
                smoothed: 0,
                positions: pod_collect_to_vec(file.bytes("positions")),
                inward: pod_collect_to_vec(file.bytes("inward_normals")),
                elements: elements.map(|(nodes, twins)| Element { nodes, twins }).collect(),
                vertices: pod_collect_to_vec(file.bytes("vertices")),
            },
            blends: blends.map(|(test_points, weights)| BlendWeights { test_points, weights }).collect(),
            responses,
            test_point_nodes,
            coupled,
            lateral_tensors: Some(pod_collect_to_vec(file.bytes("lateral_tensors"))),
            tool: file.json("tool", serde_json::from_str)?,
            slip: file.slip()?,
            tank: file.tank()?,
            partial_slip: file.partial_slip()?,
            provenance: file.json("provenance", serde_json::from_str::<Provenance>)?,
        })
    }

    /// The bytes that [`Body::save`] writes.
    ///
    /// # Errors
    /// The provenance is too long for a header.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let header = self.header()?;
        let mut bytes = Vec::new();
        self.write(&header, &mut bytes).map_err(|e| BodyError::io(Path::new("memory"), e))?;
        Ok(bytes)
    }

    fn sizes(&self) -> Result<Sizes> {
        Ok(Sizes {
            fields: self.displacement_fields()?.map(DisplacementFields::sizes),
            nodes: self.nodes.len(),
            elements: self.elements.len(),
            test_points: self.test_point_nodes.len(),
            depth_knots: self.responses.depth_knots().values().len(),
            lateral_knots: self.responses.lateral_knots().values().len(),
            anisotropic: !self.is_isotropic(),
            other_slip: self.slip != SlipRule::Paper,
            coupled: self.coupled.is_some(),
            tank: self.has_tank(),
            partial_slip: self.has_partial_slip(),
            curved: self.potential_list().iter().any(|p| p.curvature != [0.0; 3]),
        })
    }

    /// The header behind its length, padded so that the tensors begin at a multiple of 8.
    fn header(&self) -> Result<Vec<u8>> {
        // Nothing is written that reading would refuse.
        let responses = self.curves.iter().map(|r| vec![&r.normal, &r.lateral, &r.friction]);
        let potentials = self.potential_list().iter().map(|p| p.curves().to_vec());
        for (t, curves) in responses.chain(potentials).enumerate() {
            for curve in curves {
                Curve::from_ordinates(curve.knots(), curve.ordinates(), curve.extension())
                    .map_err(|e| within(format!("test point {t}"), e))?;
            }
        }
        let mut tensors = BTreeMap::new();
        let mut end = 0;
        let sizes = self.sizes()?;
        for (name, dtype, shape) in layout(&sizes) {
            let start = end;
            end += shape.iter().product::<usize>() * (dtype.bitsize() / 8);
            tensors.insert(name, TensorInfo { dtype, shape, data_offsets: (start, end) });
        }
        let encode = || {
            let mut __metadata__ = BTreeMap::from([
                ("schema", SCHEMA.to_string()),
                ("version", sizes.version().to_string()),
                ("units", UNITS.to_string()),
                ("tool", serde_json::to_string(&self.tool)?),
                ("slip", self.slip.name().to_string()),
                ("provenance", serde_json::to_string(&self.provenance)?),
            ]);
            if sizes.tank {
                __metadata__.insert("tank", "on".into());
            }
            if sizes.partial_slip {
                __metadata__.insert("partial_slip", "on".into());
            }
            let mut header = vec![0; LENGTH];
            serde_json::to_writer(&mut header, &Header { __metadata__, tensors })?;
            Ok::<_, serde_json::Error>(header)
        };
        let mut header =
            encode().map_err(|e| BodyError::invalid("metadata", e.to_string(), "correct the provenance"))?;
        header.resize(header.len().next_multiple_of(8), b' ');
        let length = header.len() - LENGTH;
        if length > MAX_HEADER {
            return Err(BodyError::invalid(
                "metadata `provenance`",
                format!("with it the header has {length} bytes, where {MAX_HEADER} are allowed"),
                "shorten the spec or the notes",
            ));
        }
        header[..LENGTH].copy_from_slice(&(length as u64).to_le_bytes());
        Ok(header)
    }

    fn write(&self, header: &[u8], out: &mut dyn Write) -> io::Result<()> {
        out.write_all(header)?;
        let sizes = self.sizes().map_err(io::Error::other)?;
        layout(&sizes).iter().try_for_each(|(name, ..)| self.write_tensor(name, out))
    }

    fn write_tensor(&self, name: &str, out: &mut dyn Write) -> io::Result<()> {
        let mut put = |bytes: &[u8]| out.write_all(bytes);
        let Body { model: crate::ContactModel { nodes, elements, .. }, curves, .. } = self;
        match name {
            "positions" => nodes.iter().try_for_each(|n| put(bytes_of(&n.position))),
            "inward_normals" => nodes.iter().try_for_each(|n| put(bytes_of(&n.inward))),
            "node_weights" => nodes.iter().try_for_each(|n| put(bytes_of(&n.weights))),
            "lateral_tensors" => put(cast_slice(&self.lateral_tensors)),
            "depth_knots_m" => put(cast_slice(self.responses.depth_knots().values())),
            "lateral_knots_m" => put(cast_slice(self.responses.lateral_knots().values())),
            "normal_curves_n" => curves.iter().try_for_each(|r| put(cast_slice(r.normal.ordinates()))),
            "friction_curves" => curves.iter().try_for_each(|r| put(cast_slice(r.friction.ordinates()))),
            "lateral_curves_n" => curves.iter().try_for_each(|r| put(cast_slice(r.lateral.ordinates()))),
            "lateral_range_m" => put(bytes_of(&self.model.potentials.range_m())),
            CURVATURES => self.potential_list().iter().try_for_each(|p| put(bytes_of(&p.curvature))),
            "coupled_tangents" => self.potential_list().iter().try_for_each(|p| put(bytes_of(&p.tangents))),
            "coupled_curves" => {
                let mut curves = self.potential_list().iter().flat_map(Potential::curves);
                curves.try_for_each(|c| put(cast_slice(c.ordinates())))
            }
            "vertices" => put(cast_slice(&self.vertices)),
            "node_test_points" => nodes.iter().try_for_each(|n| put(bytes_of(&n.test_points))),
            "triangles" => elements.iter().try_for_each(|e| put(bytes_of(&e.nodes))),
            "twins" => elements.iter().try_for_each(|e| put(bytes_of(&e.twins))),
            "test_point_nodes" => put(cast_slice(&self.test_point_nodes)),
            other => {
                match self.displacement_fields().map_err(io::Error::other)?.and_then(|f| f.tensor(other)) {
                    Some(bytes) => put(&bytes),
                    None => Err(io::Error::other(format!("no tensor is called {other}"))),
                }
            }
        }
    }
}

/// What tells one file, or one state of it, from another.
#[derive(Debug, Clone, PartialEq)]
pub struct Fingerprint {
    bytes: u64,
    modified: Option<std::time::SystemTime>,
    /// Of the file on its disk, where files have one.
    number: Option<u64>,
}

impl Fingerprint {
    /// Of an open file.
    ///
    /// # Errors
    /// The system tells nothing of it.
    pub fn of(file: &std::fs::File) -> io::Result<Self> {
        let metadata = file.metadata()?;
        #[cfg(unix)]
        let number = Some(std::os::unix::fs::MetadataExt::ino(&metadata));
        #[cfg(not(unix))]
        let number = None;
        Ok(Fingerprint { bytes: metadata.len(), modified: metadata.modified().ok(), number })
    }

    /// How long the file is.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// The file at `path`, and its bytes as they lie on the disk.
pub(crate) fn mapped(path: &Path) -> Result<(std::fs::File, memmap2::Mmap)> {
    let io = |e| BodyError::io(path, e);
    if !std::fs::metadata(path).map_err(io)?.is_file() {
        return Err(BodyError::invalid("path", "it is no ordinary file", "name a body file").in_file(path));
    }
    let file = std::fs::File::open(path).map_err(io)?;
    // SAFETY: the map is private to this crate, which only reads it, and lets go of it once it has checked or copied what is
    // there. A process that rewrites the file in place could change bytes under it: they are plain numbers, valid whatever
    // their bits. One that cuts the file short ends this process with a bus error, as with any map. `save` does neither: it
    // replaces the file.
    #[allow(unsafe_code, reason = "a map spares the copy of a file that may have gigabytes")]
    let bytes = unsafe { memmap2::Mmap::map(&file) }.map_err(io)?;
    Ok((file, bytes))
}

/// A parsed header, whose tensors have the dtypes and shapes of [`layout`] and lie within the data.
pub(crate) struct File<'a> {
    header: Metadata,
    data: &'a [u8],
    version: u32,
    header_length: usize,
}

impl<'a> File<'a> {
    pub fn parse(bytes: &'a [u8]) -> Result<Self> {
        let broken =
            |problem: String| BodyError::invalid("header", problem, "this is no body file, or a damaged one");
        let (length, rest) =
            bytes.split_first_chunk().ok_or_else(|| broken("the file is too short".into()))?;
        let length = u64::from_le_bytes(*length);
        if length > rest.len().min(MAX_HEADER) as u64 {
            return Err(broken(format!("its length is {length} bytes, in a file of {} bytes", bytes.len())));
        }
        let (header, data) = rest.split_at(length as usize);
        // Parsing also checks that tensors follow each other without gaps and that each has its shape's length.
        let header: Metadata = serde_json::from_slice(header).map_err(|e| broken(e.to_string()))?;
        let mut file = File { header, data, version: 0, header_length: length as usize };

        // Whose file it is comes first: the rest means something only then.
        let schema = file.metadata("schema")?;
        if schema != SCHEMA {
            let problem = format!("it is `{schema}`, where `{SCHEMA}` belongs");
            return Err(BodyError::invalid("metadata `schema`", problem, "this is no body file"));
        }
        let version = file.metadata("version")?;
        let version = match version.parse::<u32>() {
            Ok(known @ 1..=VERSION) => known,
            Ok(newer) if newer > VERSION => {
                let problem = format!("the file has version {newer}, this program reads up to {VERSION}");
                return Err(BodyError::invalid(
                    "metadata `version`",
                    problem,
                    "a newer palpate made it: update",
                ));
            }
            _ => {
                let problem = format!("`{version}` is no version");
                return Err(BodyError::invalid("metadata `version`", problem, "make the body again"));
            }
        };
        let units = file.metadata("units")?;
        if units != UNITS {
            let problem = format!("they are `{units}`, where `{UNITS}` belongs");
            return Err(BodyError::invalid("metadata `units`", problem, "make the body again"));
        }
        if file.header.data_len() != data.len() {
            let problem =
                format!("the tensors have {} bytes, the file {}", file.header.data_len(), data.len());
            return Err(BodyError::invalid(
                "tensors",
                problem,
                "the file is incomplete: copy or make it again",
            ));
        }
        file.check_layout(version)?;
        file.version = version;
        Ok(file)
    }

    fn check_layout(&self, version: u32) -> Result<()> {
        let rows = |name: &str| self.header.info(name).and_then(|t| t.shape.first().copied());
        let count = |name| rows(name).unwrap_or(0);
        let layout = layout(&Sizes {
            nodes: count("positions"),
            elements: count("triangles"),
            test_points: count("test_point_nodes"),
            depth_knots: count("depth_knots_m"),
            lateral_knots: count("lateral_knots_m"),
            coupled: version >= 4 && self.header.info("coupled_curves").is_some(),
            anisotropic: version >= 2 && self.header.info("lateral_tensors").is_some(),
            other_slip: version >= 3,
            tank: version >= 4,
            fields: if version >= 5 { FieldSizes::of(rows) } else { None },
            partial_slip: version >= 6,
            curved: version >= 7 && self.has_curvatures(),
        });
        for (name, dtype, shape) in &layout {
            let problem = match self.header.info(name) {
                Some(t) if t.dtype == *dtype && t.shape == *shape => continue,
                Some(t) => format!("it is {} {:?}, where {dtype} {shape:?} belongs", t.dtype, t.shape),
                None => "it is missing".into(),
            };
            return Err(BodyError::invalid(tensor(name), problem, "make the body again"));
        }
        match self.header.offset_keys().iter().find(|key| !layout.iter().any(|(name, ..)| name == key)) {
            None => Ok(()),
            Some(unknown) => {
                let problem = format!("version {version} has no such tensor");
                Err(BodyError::invalid(tensor(unknown), problem, "remove it, or make the body again"))
            }
        }
    }

    fn metadata(&self, key: &str) -> Result<&str> {
        let text = self.header.metadata().as_ref().and_then(|m| m.get(key));
        text.map(String::as_str).ok_or_else(|| {
            BodyError::invalid(
                format!("metadata `{key}`"),
                "it is missing",
                "this is no body file, or a damaged one",
            )
        })
    }

    pub fn json<'t, T: DeserializeOwned>(
        &'t self,
        key: &str,
        read: impl Fn(&'t str) -> serde_json::Result<T>,
    ) -> Result<T> {
        read(self.metadata(key)?).map_err(|e| {
            BodyError::invalid(format!("metadata `{key}`"), e.to_string(), "make the body again")
        })
    }

    /// Rules other than the paper's came with version 3: a program of an older one would refuse the file, or slip otherwise.
    pub fn slip(&self) -> Result<SlipRule> {
        let rule = self.json("slip", |text| serde_json::from_value::<SlipRule>(text.into()))?;
        if rule != SlipRule::Paper && self.version < 3 {
            let problem =
                format!("it is `{}`, which files of version {} don't know", rule.name(), self.version);
            let hint = "make the body again, or write `paper` if it was made for that";
            return Err(BodyError::invalid("metadata `slip`", problem, hint));
        }
        Ok(rule)
    }

    /// Whether slip is kept from giving out energy.
    pub fn tank(&self) -> Result<bool> {
        self.switch("tank", 4)
    }

    /// Whether contacts are two contact points side by side.
    pub fn partial_slip(&self) -> Result<bool> {
        self.switch("partial_slip", 6)
    }

    /// What is on or off, and off in files before `version`, which knew no such thing.
    fn switch(&self, key: &str, version: u32) -> Result<bool> {
        let value = self.header.metadata().as_ref().and_then(|m| m.get(key));
        match value.filter(|_| self.version >= version).map(String::as_str) {
            None | Some("off") => Ok(false),
            Some("on") => Ok(true),
            Some(other) => {
                let problem = format!("it is `{other}`, where `on` or `off` belongs");
                Err(BodyError::invalid(format!("metadata `{key}`"), problem, "make the body again"))
            }
        }
    }

    /// The bytes of a tensor of [`layout`], at any alignment.
    pub fn bytes(&self, name: &str) -> &'a [u8] {
        let (start, end) = self.header.info(name).map_or((0, 0), |t| t.data_offsets);
        self.data.get(start..end).unwrap_or(&[])
    }

    fn rows<T: Pod>(&self, name: &str) -> impl Iterator<Item = T> + use<'a, T> {
        self.bytes(name).chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned)
    }

    /// Whether friction counts the tool's way.
    pub fn has_curvatures(&self) -> bool {
        self.header.info(CURVATURES).is_some()
    }

    /// The surface's curvature at each test point, 1/m; 0 in a file without.
    pub fn curvatures(&self, test_points: usize) -> Vec<[f64; 3]> {
        if self.has_curvatures() { self.rows(CURVATURES).collect() } else { vec![[0.0; 3]; test_points] }
    }

    /// What a coupled law's test points share, if the body has one.
    pub fn coupled(&self) -> Result<Option<CoupledHeader>> {
        let Some(&range_m) = pod_collect_to_vec::<u8, f64>(self.bytes("lateral_range_m")).first() else {
            return Ok(None);
        };
        let depth: Vec<f64> = pod_collect_to_vec(self.bytes("depth_knots_m"));
        check_knots(&depth).map_err(|e| within(tensor("depth_knots_m"), e))?;
        check_range(range_m).map_err(|e| within(tensor("lateral_range_m"), e))?;
        Ok(Some(CoupledHeader { depth, range_m }))
    }

    /// What all curves of a decoupled law share.
    pub fn knots(&self) -> Result<SharedKnots> {
        let knots = |name| {
            let knots: Vec<f64> = pod_collect_to_vec(self.bytes(name));
            check_knots(&knots).map_err(|e| within(tensor(name), e))?;
            Ok(knots)
        };
        Ok(SharedKnots { depth: knots("depth_knots_m")?, lateral: knots("lateral_knots_m")? })
    }

    /// Where displacement fields' tensors begin in the file, and how long they are, bytes; none where there are no fields.
    fn field_places(&self) -> Option<BTreeMap<&'static str, (u64, u64)>> {
        let sizes = FieldSizes::of(|name| self.header.info(name).and_then(|t| t.shape.first().copied()))?;
        let tensors = field_layout(&sizes).into_iter().flatten();
        Some(tensors.map(|(name, ..)| (name, (self.place(name), self.bytes(name).len() as u64))).collect())
    }

    /// Where the data begin in the file, and a tensor in them, bytes.
    pub fn place(&self, name: &str) -> u64 {
        let start = self.header.info(name).map_or(0, |t| t.data_offsets.0);
        (LENGTH + self.header_length + start) as u64
    }
}

fn tensor(name: &str) -> String {
    format!("tensor `{name}`")
}

/// The same error with a wider place before its own.
fn within(wider: String, error: BodyError) -> BodyError {
    match error {
        BodyError::Invalid { file, place, problem, hint } => {
            BodyError::Invalid { file, place: format!("{wider}, {place}"), problem, hint }
        }
        other => other,
    }
}

/// Locks `bytes` into RAM.
///
/// # Errors
/// The operating system's limit on locked memory is too low.
pub(crate) fn lock(bytes: &[u8]) -> io::Result<()> {
    #[cfg(unix)]
    paged(bytes, rustix::mm::mlock)?;
    Ok(())
}

/// Gives the pages of `bytes` back to the system's paging.
///
/// # Errors
/// The system refuses.
pub(crate) fn unlock(bytes: &[u8]) -> io::Result<()> {
    #[cfg(unix)]
    paged(bytes, rustix::mm::munlock)?;
    Ok(())
}

/// Tells the system by `call`, which must be mlock or munlock, what to do with the pages of `bytes`.
#[cfg(unix)]
fn paged(
    bytes: &[u8],
    call: unsafe fn(*mut core::ffi::c_void, usize) -> rustix::io::Result<()>,
) -> io::Result<()> {
    if bytes.is_empty() {
        return Ok(());
    }
    // SAFETY: the range is that of a live slice, and neither call changes its contents or its validity: once a locked slice
    // is freed, its pages may stay in RAM, no more.
    #[allow(unsafe_code, reason = "what stays in memory is the operating system's")]
    unsafe {
        call(bytes.as_ptr().cast_mut().cast(), bytes.len())?;
    }
    Ok(())
}
