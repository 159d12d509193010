//! A body that stays in its file, for those that are larger than memory, and for all that are long to open.
//!
//! In memory are its outline and the tree over its elements: 7.5 bytes an element, where the body itself has 70 and more.
//! [`BodySource::take`] reads what a patch needs, and derives of it what [`Body::new`](crate::Body::new) derives of the whole, by the same
//! functions: the same bits come out.
//!
//! The file is read, not mapped: a file that is cut short while it is in use is an error like any other, and what it takes of
//! memory is the system's cache, which it gives up when memory is short.

use crate::body::{
    BlendWeights, Node, Provenance, SlipRule, Tool, border_nodes, check_mix, check_surface, check_tensors,
    check_test_points, creased, mixed_inward,
};
use crate::error::{BodyError, Result};
use crate::file::{CURVATURES, CURVES, CoupledHeader, File, Fingerprint, SharedKnots, mapped};
use crate::gradient::Gradients;
use crate::index_map::IndexMap;
use crate::model::{ContactModel, identity, sampled};
use crate::patch::Patch;
use crate::potential::{CoupledLaw, Potential, Potentials};
use crate::response::{Response, Responses};
use crate::search::{Search, point};
use crate::source::{BodySource, Extent, no_surface};
use crate::surface::{Columns, Element, Elements, FENCE};
use crate::tensor::{IDENTITY, Tensor};
use bytemuck::Pod;
use glam::DVec3;
use std::cell::RefCell;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Rows that are nearer to each other than this in the file are read in one go, bytes: about what a read costs besides.
const GAP: u64 = 4096;
/// No more than this is read in one go, bytes.
const MOST: u64 = 1 << 20;
/// Test points and nodes that are looked at in one go.
const BATCH: usize = 4096;

/// A body of which patches are read out of its file.
#[derive(Debug)]
pub struct StoredBody {
    path: PathBuf,
    file: fs::File,
    /// Of the file when it was checked.
    fingerprint: Fingerprint,
    tensors: Tensors,
    law: Law,
    model_header: ContactModel,
    search: Search,
    nodes: usize,
    test_points: usize,
    isotropic: bool,
    /// Whether patches get gradients.
    gradients: bool,
    extent: Extent,
}

/// Where tensors begin in the file, bytes.
#[derive(Debug)]
struct Tensors {
    positions: u64,
    inward: u64,
    weights: u64,
    lateral_tensors: u64,
    blended: u64,
    triangles: u64,
    twins: u64,
}

/// What test points answer by, and where their tensors begin in the file, bytes.
#[derive(Debug)]
enum Law {
    /// Of the [`CURVES`].
    Decoupled { knots: SharedKnots, curves: [u64; 3] },
    Coupled {
        header: CoupledHeader,
        tangents: u64,
        /// None in a file without.
        curvatures: Option<u64>,
        curves: u64,
    },
}

impl StoredBody {
    /// Checks the body at `path` as [`Body::open`](crate::Body::open) does, and leaves it there. `slip` is the rule that contacts will ask for, if
    /// it is another than the body's own.
    ///
    /// # Errors
    /// As [`Body::open`](crate::Body::open); tensors that are not aligned, as other programs may write them; with the rule `consistent`, a node
    /// that joins elements which no edge joins.
    pub fn open(path: &Path, slip: Option<SlipRule>) -> Result<Self> {
        let (file, bytes) = mapped(path)?;
        Self::check(path, file, &bytes, slip).map_err(|e| e.in_file(path))
    }

    /// How many elements the body at `path` has, by its header alone.
    ///
    /// # Errors
    /// The file can't be read, or its header is none.
    pub fn count_elements(path: &Path) -> Result<usize> {
        let (_, bytes) = mapped(path)?;
        let file = File::parse(&bytes).map_err(|e| e.in_file(path))?;
        Ok(file.bytes("triangles").len() / size_of::<[u32; 3]>())
    }

    fn check(path: &Path, file: fs::File, bytes: &[u8], slip: Option<SlipRule>) -> Result<Self> {
        let fingerprint = Fingerprint::of(&file).map_err(|e| BodyError::io(path, e))?;
        let parsed = File::parse(bytes)?;
        let positions: &[DVec3] = column(&parsed, "positions")?;
        let inward: &[DVec3] = column(&parsed, "inward_normals")?;
        let vertices: &[u32] = column(&parsed, "vertices")?;
        let elements = Columns { nodes: column(&parsed, "triangles")?, twins: column(&parsed, "twins")? };
        check_surface(positions, inward, vertices, elements)?;

        let at: &[u32] = column(&parsed, "test_point_nodes")?;
        let blended: &[[u32; 3]] = column(&parsed, "node_test_points")?;
        let weights: &[[f64; 3]] = column(&parsed, "node_weights")?;
        let fades = border_nodes(positions.len(), elements);
        for (n, ((&test_points, &weights), &fades)) in blended.iter().zip(weights).zip(&fades).enumerate() {
            check_mix(n, &BlendWeights { test_points, weights }, at.len(), fades)?;
        }
        check_test_points(at, at.len(), positions.len())?;
        let tool: Tool = parsed.json("tool", serde_json::from_str)?;
        tool.check()?;

        let tensors: &[Tensor] = column(&parsed, "lateral_tensors")?;
        let isotropic = tensors.iter().all(|a| *a == IDENTITY);
        check_tensors(tensors, inward)?;

        let (law, model_header) = match parsed.coupled()? {
            None => Self::check_responses(&parsed, at)?,
            Some(header) => Self::check_potentials(&parsed, header, at, inward, tool.radius_m())?,
        };

        parsed.json("provenance", serde_json::from_str::<Provenance>)?;
        let own = parsed.slip()?;
        let gradients = slip.unwrap_or(own) == SlipRule::Consistent;
        if gradients {
            check_fans_whole(positions.len(), elements)?;
        }
        let search = Search::build(positions, elements.count(), |e| elements.nodes[e]);
        let mut body = StoredBody {
            path: path.to_path_buf(),
            file,
            fingerprint,
            tensors: Tensors {
                positions: parsed.place("positions"),
                inward: parsed.place("inward_normals"),
                weights: parsed.place("node_weights"),
                lateral_tensors: parsed.place("lateral_tensors"),
                blended: parsed.place("node_test_points"),
                triangles: parsed.place("triangles"),
                twins: parsed.place("twins"),
            },
            law,
            model_header: ContactModel::without_surface(
                model_header,
                creased(vertices),
                tool,
                (own, parsed.tank()?, parsed.partial_slip()?),
                0,
            ),
            search,
            nodes: positions.len(),
            test_points: at.len(),
            isotropic,
            gradients,
            extent: Extent::of(positions.iter().copied()),
        };
        let which = sampled(at.len());
        let (responses, law) = (body.reading().responses(&which)?, body.reading().potentials(&which)?);
        let potentials = law.iter().flat_map(|law| &law.potentials).flat_map(Potential::curves);
        let curves = responses.iter().flat_map(Response::curves).chain(potentials);
        let curvatures = law.iter().flat_map(|law| &law.potentials).map(|p| p.curvature);
        let sizes = [elements.count(), at.len()];
        body.model_header.identity = identity(positions, inward, sizes, &tool, curves, curvatures);
        Ok(body)
    }

    /// Every test point's response, on its own; with what an outline holds of all.
    fn check_responses(parsed: &File, at: &[u32]) -> Result<(Law, (Responses, Potentials))> {
        let knots = parsed.knots()?;
        let curves = [
            column(parsed, CURVES[0].tensor)?,
            column(parsed, CURVES[1].tensor)?,
            column(parsed, CURVES[2].tensor)?,
        ];
        for t in 0..at.len() {
            knots.response(t, t, curves)?.check_at(t, &knots.depth, &knots.lateral)?;
        }
        // One has all the knots.
        let first = (0..at.len().min(1)).map(|t| knots.response(t, t, curves)).collect::<Result<Vec<_>>>()?;
        let responses = Responses::new(&first)?.without_points();
        let curves = [0, 1, 2].map(|i| parsed.place(CURVES[i].tensor));
        Ok((Law::Decoupled { knots, curves }, (responses, Potentials::default())))
    }

    /// The same of potentials.
    fn check_potentials(
        parsed: &File,
        header: CoupledHeader,
        at: &[u32],
        inward: &[DVec3],
        radius_m: f64,
    ) -> Result<(Law, (Responses, Potentials))> {
        let tangents: &[[DVec3; 2]] = column(parsed, "coupled_tangents")?;
        let ordinates: &[[f64; 4]] = column(parsed, "coupled_curves")?;
        let mut first = Vec::new();
        let places = tangents.iter().copied().zip(parsed.curvatures(at.len()));
        for (t, (place, row)) in places.zip(ordinates.chunks_exact(header.width())).enumerate() {
            let potential = header.potential(t, place, row)?;
            potential.check_at(t, inward[at[t] as usize], header.range_m, radius_m)?;
            if t == 0 {
                first.push(potential);
            }
        }
        let (knots, table) = Potentials::new(&CoupledLaw { range_m: header.range_m, potentials: first })?;
        let model_header = (Responses::knots_alone(knots, header.range_m)?, table.without_points());
        let (tangents, curves) = (parsed.place("coupled_tangents"), parsed.place("coupled_curves"));
        let curvatures = parsed.has_curvatures().then(|| parsed.place(CURVATURES));
        Ok((Law::Coupled { header, tangents, curvatures, curves }, model_header))
    }

    /// An error unless the file is as it was when it was checked, as far as its length and time tell.
    fn check_unchanged(&self) -> Result<()> {
        let now = Fingerprint::of(&self.file).map_err(|e| BodyError::io(&self.path, e))?;
        if now == self.fingerprint {
            return Ok(());
        }
        let how = if now.bytes() < self.fingerprint.bytes() { "cut short" } else { "changed" };
        let problem = format!("it was {how} while it was in use");
        let hint = "leave it alone while a loop runs on it, and start again";
        Err(BodyError::invalid("body file", problem, hint).in_file(&self.path))
    }

    /// Where nobody watches.
    fn reading(&self) -> Reading<'_> {
        Reading { of: self, beat: &|| () }
    }

    /// Corners of an element, and the inward normals there, m.
    fn corners(&self, element: u32) -> Result<[[DVec3; 3]; 2]> {
        let of = |tensor: u64, n: u32| {
            let mut bytes = [0; size_of::<DVec3>()];
            self.reading().read(tensor + u64::from(n) * bytes.len() as u64, &mut bytes)?;
            Ok::<DVec3, BodyError>(bytemuck::pod_read_unaligned(&bytes))
        };
        let mut bytes = [0; size_of::<[u32; 3]>()];
        self.reading().read(self.tensors.triangles + u64::from(element) * bytes.len() as u64, &mut bytes)?;
        let [a, b, c]: [u32; 3] = bytemuck::pod_read_unaligned(&bytes);
        let Tensors { positions: p, inward: u, .. } = self.tensors;
        Ok([[of(p, a)?, of(p, b)?, of(p, c)?], [of(u, a)?, of(u, b)?, of(u, c)?]])
    }

    /// What `ask` finds among elements whose corners it is given.
    fn query<T>(&self, ask: impl FnOnce(&dyn Fn(u32) -> [DVec3; 3]) -> T) -> Result<T> {
        let failed = RefCell::new(None);
        let answer = ask(&|element| {
            self.corners(element).map_or_else(
                |error| {
                    failed.borrow_mut().get_or_insert(error);
                    [DVec3::NAN; 3]
                },
                |[positions, _]| positions,
            )
        });
        failed.into_inner().map_or(Ok(answer), Err)
    }
}

/// Reads of a stored body, each of which is followed by a beat.
struct Reading<'a> {
    of: &'a StoredBody,
    beat: &'a dyn Fn(),
}

impl Reading<'_> {
    /// The bytes from `start` on.
    fn read(&self, start: u64, bytes: &mut [u8]) -> Result<()> {
        read_at(&self.of.file, bytes, start).map_err(|e| BodyError::io(&self.of.path, e))?;
        (self.beat)();
        Ok(())
    }

    /// Rows `which`, ascending, of a tensor that begins at `start`, `width` bytes each.
    fn bytes_of_rows(&self, start: u64, width: usize, which: &[u32]) -> Result<Vec<u8>> {
        let mut rows = vec![0; width * which.len()];
        let (mut buffer, mut slots) = (Vec::new(), rows.chunks_exact_mut(width));
        let from = |row: u32| start + u64::from(row) * width as u64;
        let mut rest = which;
        while let Some(&first) = rest.first() {
            let joins = |pair: &&[u32]| {
                from(pair[1]) - from(pair[0]) <= width as u64 + GAP && from(pair[1]) - from(first) < MOST
            };
            let (part, after) = rest.split_at(1 + rest.windows(2).take_while(joins).count());
            buffer.resize((from(part[part.len() - 1]) - from(first)) as usize + width, 0);
            self.read(from(first), &mut buffer)?;
            for (&row, slot) in part.iter().zip(&mut slots) {
                let at = (from(row) - from(first)) as usize;
                slot.copy_from_slice(&buffer[at..at + width]);
            }
            rest = after;
        }
        Ok(rows)
    }

    fn rows<T: Pod>(&self, start: u64, which: &[u32]) -> Result<Vec<T>> {
        Ok(bytemuck::pod_collect_to_vec(&self.bytes_of_rows(start, size_of::<T>(), which)?))
    }

    fn elements(&self, which: &[u32]) -> Result<Vec<Element>> {
        let (nodes, twins) =
            (self.rows(self.of.tensors.triangles, which)?, self.rows(self.of.tensors.twins, which)?);
        Ok(nodes.into_iter().zip(twins).map(|(nodes, twins)| Element { nodes, twins }).collect())
    }

    /// Responses of test points; none with a coupled law.
    fn responses(&self, which: &[u32]) -> Result<Vec<Response>> {
        let Law::Decoupled { knots, curves } = &self.of.law else { return Ok(Vec::new()) };
        let ordinates = |i: usize| {
            let width = knots.intervals(&CURVES[i]) * size_of::<[f64; 4]>();
            let bytes = self.bytes_of_rows(curves[i], width, which)?;
            Ok(bytemuck::pod_collect_to_vec::<u8, [f64; 4]>(&bytes))
        };
        let (normal, lateral, friction) = (ordinates(0)?, ordinates(1)?, ordinates(2)?);
        let row = |(row, &t): (usize, &u32)| knots.response(t as usize, row, [&normal, &lateral, &friction]);
        which.iter().enumerate().map(row).collect()
    }

    /// The potentials of test points; none with a decoupled law.
    fn potentials(&self, which: &[u32]) -> Result<Option<CoupledLaw>> {
        let Law::Coupled { header, tangents, curvatures, curves } = &self.of.law else { return Ok(None) };
        let width = header.width() * size_of::<[f64; 4]>();
        let ordinates = bytemuck::pod_collect_to_vec(&self.bytes_of_rows(*curves, width, which)?);
        let curvatures = match curvatures {
            Some(tensor) => self.rows(*tensor, which)?,
            None => vec![[0.0; 3]; which.len()],
        };
        let places = self.rows(*tangents, which)?.into_iter().zip(curvatures);
        let rows = places.zip(ordinates.chunks_exact(header.width())).zip(which);
        let potentials = rows.map(|((place, row), &t)| header.potential(t as usize, place, row));
        Ok(Some(CoupledLaw { range_m: header.range_m, potentials: potentials.collect::<Result<_>>()? }))
    }

    /// The other elements around the nodes of these, and their numbers.
    fn around(&self, known: &IndexMap, elements: &[Element]) -> Result<(Vec<u32>, Vec<Element>)> {
        let nodes = IndexMap::of(elements.iter().flat_map(|e| e.nodes));
        let (mut numbers, mut around): (Vec<u32>, Vec<Element>) = (Vec::new(), Vec::new());
        let mut seen = 0;
        loop {
            let last = if numbers.is_empty() { elements } else { &around[seen..] };
            let mut wanted = Vec::new();
            for element in last {
                for (edge, twin) in element.twins.into_iter().enumerate() {
                    let is_known = || known.index_of(twin / 3).is_some() || numbers.contains(&(twin / 3));
                    let joins =
                        || [edge, (edge + 1) % 3].iter().any(|&i| nodes.index_of(element.nodes[i]).is_some());
                    wanted.extend((twin < FENCE && !is_known() && joins()).then_some(twin / 3));
                }
            }
            if wanted.is_empty() {
                return Ok((numbers, around));
            }
            wanted.sort_unstable();
            wanted.dedup();
            seen = around.len();
            around.extend(self.elements(&wanted)?);
            numbers.extend(wanted);
        }
    }

    /// A model of these elements and what their gradients need, and which of its elements they are. It has no tree.
    fn submesh(&self, chosen: &[u32]) -> Result<(ContactModel, IndexMap)> {
        let mut elements = self.elements(chosen)?;
        let mut numbers = IndexMap::of(chosen.iter().copied());
        if self.of.gradients {
            let (others, around) = self.around(&numbers, &elements)?;
            let all = chosen.iter().copied().zip(elements).chain(others.into_iter().zip(around));
            let mut all: Vec<_> = all.collect();
            all.sort_unstable_by_key(|(e, _)| *e);
            numbers = IndexMap::of(all.iter().map(|(e, _)| *e));
            elements = all.into_iter().map(|(_, element)| element).collect();
        }
        let nodes = IndexMap::of(elements.iter().flat_map(|e| e.nodes));
        let which = nodes.list();
        let blended: Vec<[u32; 3]> = self.rows(self.of.tensors.blended, which)?;
        let points = IndexMap::of(blended.iter().flatten().copied());
        let responses = self.responses(points.list())?;

        let mut model = self.of.model_header.model_header();
        match self.potentials(points.list())? {
            None => model.responses = Responses::new(&responses)?,
            Some(law) => model.potentials = Potentials::new(&law)?.1,
        }
        let positions = self.rows(self.of.tensors.positions, which)?.into_iter();
        let inward = self.rows(self.of.tensors.inward, which)?;
        let blends = blended.into_iter().zip(self.rows(self.of.tensors.weights, which)?);
        let blends =
            blends.map(|(t, weights)| BlendWeights { test_points: t.map(|t| points.renumber(t)), weights });
        let rest = positions.zip(inward).zip(blends);
        model.nodes = rest.map(|((position, inward), blend)| Node::new(position, inward, &blend)).collect();
        let local = |e: Element| Element {
            nodes: e.nodes.map(|n| nodes.renumber(n)),
            // At a border it is no element's, and stays what it is.
            twins: e.twins.map(|twin| numbers.renumber_twin(twin, twin.max(FENCE))),
        };
        model.elements = elements.into_iter().map(local).collect();
        if !self.of.isotropic {
            model.lateral_tensors = self.rows(self.of.tensors.lateral_tensors, which)?;
        }
        if self.of.gradients {
            model.gradients = Gradients::new(&model, &responses).into();
        }
        Ok((model, IndexMap::of(chosen.iter().map(|&e| numbers.renumber(e)))))
    }
}

impl BodySource for StoredBody {
    fn model_header(&self) -> &ContactModel {
        &self.model_header
    }

    fn element_count(&self) -> usize {
        self.search.count()
    }

    fn serves(&self, rule: SlipRule) -> Result<()> {
        if rule != SlipRule::Consistent || self.gradients {
            return Ok(());
        }
        let problem = "it was opened for contacts with another slip rule than `consistent`";
        let hint = "name the rule to StoredBody::open";
        Err(BodyError::invalid("slip rule", problem, hint).in_file(&self.path))
    }

    fn take(&self, patch: &mut Patch, centre: [f64; 3], count: usize, beat: &dyn Fn()) -> Result<()> {
        let chosen = patch.choose(&self.search, centre, count);
        let submesh = Reading { of: self, beat }.submesh(chosen);
        // What was read is what was checked; if not, that is the reason for any other error.
        self.check_unchanged()?;
        let (submesh, elements) = submesh.map_err(|e| e.in_file(&self.path))?;
        patch.copy(&submesh, &elements);
        Ok(())
    }

    fn extent(&self) -> Extent {
        self.extent
    }

    fn first_touch(&self, from: DVec3, to: DVec3) -> Result<Option<DVec3>> {
        self.query(|corners| {
            let at = self.search.first_touch(from, to, 0.0, corners)?.at;
            Some(point(corners(at.element), at.n))
        })
    }

    fn nearest(&self, p: DVec3) -> Result<[DVec3; 2]> {
        let found = self.query(|corners| self.search.nearest(p, f64::INFINITY, corners))?;
        let (at, _) = found.ok_or_else(no_surface)?;
        let [corners, inward] = self.corners(at.element)?;
        Ok([point(corners, at.n), mixed_inward(inward, at.n)])
    }

    fn each_response(&self, visit: &mut dyn FnMut(&Response)) -> Result<()> {
        batches(self.test_points, |which| {
            self.reading().responses(which)?.iter().for_each(&mut *visit);
            Ok(())
        })
    }

    fn each_potential(&self, visit: &mut dyn FnMut(&Potential)) -> Result<()> {
        batches(self.test_points, |which| {
            self.reading().potentials(which)?.iter().flat_map(|law| &law.potentials).for_each(&mut *visit);
            Ok(())
        })
    }

    fn each_tensor(&self, visit: &mut dyn FnMut(&Tensor, DVec3)) -> Result<()> {
        batches(if self.isotropic { 0 } else { self.nodes }, |which| {
            let tensors: Vec<Tensor> = self.reading().rows(self.tensors.lateral_tensors, which)?;
            let inward: Vec<DVec3> = self.reading().rows(self.tensors.inward, which)?;
            tensors.iter().zip(inward).for_each(|(a, u)| visit(a, u));
            Ok(())
        })
    }

    fn unlock_memory(&self) -> io::Result<()> {
        self.search.memory().try_for_each(crate::file::unlock)
    }
}

/// The numbers below `count`, some at a time.
fn batches(count: usize, mut each: impl FnMut(&[u32]) -> Result<()>) -> Result<()> {
    let starts = (0..count).step_by(BATCH);
    starts
        .map(|start| (start as u32..(start + BATCH).min(count) as u32).collect::<Vec<_>>())
        .try_for_each(|which| each(&which))
}

/// A tensor as numbers.
fn column<'a, T: Pod>(file: &File<'a>, name: &str) -> Result<&'a [T]> {
    bytemuck::try_cast_slice(file.bytes(name)).map_err(|_| {
        let problem = "its numbers are not aligned in the file: it was written by another program";
        let hint = "open it in memory, or write it again with Body::save";
        BodyError::invalid(format!("tensor `{name}`"), problem, hint)
    })
}

/// A patch finds the elements around a node by their edges: there must be no others.
fn check_fans_whole(nodes: usize, elements: impl Elements) -> Result<()> {
    let (mut counts, mut first) = (vec![0u16; nodes], vec![u32::MAX; nodes]);
    for (e, element) in elements.all().enumerate() {
        for n in element.nodes.map(|n| n as usize) {
            counts[n] += 1;
            first[n] = first[n].min(e as u32);
        }
    }
    for (n, (&count, &start)) in counts.iter().zip(&first).enumerate() {
        if count == 0 {
            continue;
        }
        let of = |e: u32| elements.element(e as usize);
        let corner = |e: u32| of(e).nodes.iter().position(|&m| m as usize == n);
        // Once round, or to an end of the fan each way.
        let mut met = 0;
        'ways: for way in [2, 0] {
            let mut at = start;
            while let Some(c) = corner(at).filter(|_| met <= count) {
                met += u16::from(at != start || way == 2);
                let twin = of(at).twins[(c + way) % 3];
                at = if twin < FENCE { twin / 3 } else { continue 'ways };
                if at == start {
                    break 'ways;
                }
            }
        }
        if met != count {
            let problem = "it joins elements that no edge joins, which a body in its file can't have with this slip rule";
            return Err(BodyError::invalid(format!("node {n}"), problem, "open it in memory"));
        }
    }
    Ok(())
}

#[cfg(unix)]
fn read_at(file: &fs::File, bytes: &mut [u8], start: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, start)
}

#[cfg(windows)]
fn read_at(file: &fs::File, mut bytes: &mut [u8], mut start: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, bytes, start)?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        (bytes, start) = (&mut bytes[read..], start + read as u64);
    }
    Ok(())
}
