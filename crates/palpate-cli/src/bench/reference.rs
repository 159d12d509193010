//! A reference path of the offline simulation, timed: a patch of a finite-element mesh pressed in along −y, and dragged.
//!
//! The mesh comes as tables of nodes, ten-node tetrahedra and the patch's nodes. It may be the half or the quarter of a
//! body: where it begins at x = 0 or z = 0, that plane is one of symmetry. A drag breaks the symmetry of its own
//! direction; the mesh is mirrored there first.

use super::timing::{Spent, Stopwatch};
use anyhow::{Result, anyhow};
use glam::DVec3;
use palpate_files::Table;
use palpate_files::read_text;
use palpate_simulate::mesh::EDGES;
use palpate_simulate::{Counts, Fixed, Material, Model, TetMesh};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Of the body's size: nodes nearer to a plane lie on it.
const ON_PLANE: f64 = 1e-8;

/// A direction along the cylinder that the mesh stands for: z is its axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Direction {
    /// z.
    Axial,
    /// x, which at the top of a cylinder leads around it.
    Around,
}

impl Direction {
    fn axis(self) -> usize {
        match self {
            Direction::Axial => 2,
            Direction::Around => 0,
        }
    }
}

/// What is done with the patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferencePlan {
    /// How far it is pressed along −y, m.
    pub depth_m: f64,
    /// In so many steps.
    pub steps: usize,
    /// How far it is dragged from there, m; 0 for not at all.
    pub drag_m: f64,
    /// In so many steps.
    pub drag_steps: usize,
    /// Where to.
    pub direction: Direction,
}

/// A mesh and its patch.
#[derive(Debug, Clone)]
pub struct Part {
    /// The tetrahedra, of one region.
    pub mesh: TetMesh,
    /// Nodes that are moved, ascending.
    pub patch: Vec<u32>,
    /// Whether the planes x = 0, y = 0 and z = 0 are of symmetry (y never is).
    pub symmetric: [bool; 3],
    /// Along which axes it was mirrored.
    pub mirrored: [bool; 3],
}

impl Part {
    /// Reads the tables `x_m,y_m,z_m`, `n0` to `n9` and `node`. Nodes are numbered from 0.
    ///
    /// # Errors
    /// A table can't be read, or names a node that does not exist, or one twice.
    pub fn read(nodes: &Path, tetrahedra: &Path, patch: &Path) -> Result<Self> {
        let text = read_text(nodes)?;
        let table = Table::parse(nodes, &text, &["x_m", "y_m", "z_m"], &[])?;
        let positions: Vec<DVec3> = table.rows.iter().map(|row| DVec3::from_slice(&row.values)).collect();
        let count = positions.len();

        let text = read_text(tetrahedra)?;
        let names = ["n0", "n1", "n2", "n3", "n4", "n5", "n6", "n7", "n8", "n9"];
        let table = Table::parse(tetrahedra, &text, &names, &[])?;
        let mut elements = Vec::with_capacity(table.rows.len());
        let mut used = vec![false; count];
        for row in &table.rows {
            let mut element = [0; 10];
            for ((name, node), &value) in names.iter().zip(&mut element).zip(&row.values) {
                *node = index(value, count).map_err(|e| table.error(row, &format!("{name} is {e}")))?;
            }
            for (i, node) in element.iter().enumerate() {
                if element[..i].contains(node) {
                    let problem = format!("node {node} is there twice; give ten different nodes");
                    return Err(table.error(row, &problem));
                }
                used[*node as usize] = true;
            }
            for (i, [a, b]) in EDGES.into_iter().enumerate() {
                let [a_m, b_m, middle] = [a, b, 4 + i].map(|n| positions[element[n] as usize]);
                if middle.distance((a_m + b_m) / 2.0) > 0.25 * a_m.distance(b_m) {
                    let node = 4 + i;
                    let problem = format!(
                        "n{node} is not between n{a} and n{b}; give the nodes on edges in the order 01, 12, 20, 03, 13, 23"
                    );
                    return Err(table.error(row, &problem));
                }
            }
            elements.push(element);
        }
        if let Some(node) = used.iter().position(|used| !used) {
            return Err(anyhow!(
                "{}: node {node} of {} is in no tetrahedron; take it out, or add what is missing",
                tetrahedra.display(),
                nodes.display()
            ));
        }

        let text = read_text(patch)?;
        let table = Table::parse(patch, &text, &["node"], &[])?;
        let mut moved = Vec::with_capacity(table.rows.len());
        for row in &table.rows {
            for &value in &row.values {
                moved.push(index(value, count).map_err(|e| table.error(row, &format!("node is {e}")))?);
            }
        }
        moved.sort_unstable();
        moved.dedup();

        let regions = vec![0; elements.len()];
        let region_names = vec![String::new()];
        let mesh = TetMesh { positions, elements, regions, region_names, groups: BTreeMap::new() };
        let symmetric = [0, 1, 2].map(|axis| axis != 1 && extent(&mesh, axis).0.abs() <= tolerance(&mesh));
        Ok(Part { mesh, patch: moved, symmetric, mirrored: [false; 3] })
    }

    /// The part and its mirror image about the plane where `axis` (0 or 2) is 0, if that plane is of symmetry. Nodes on
    /// the plane are shared, and what was there keeps its numbers.
    pub fn mirror(&mut self, axis: usize) {
        if !self.symmetric[axis] {
            return;
        }
        // A reflection inverts an element; with corners 1 and 2 exchanged, and the nodes on edges accordingly, it
        // is back.
        const TURNED: [usize; 10] = [0, 2, 1, 3, 6, 5, 4, 7, 9, 8];
        let near = tolerance(&self.mesh);
        let TetMesh { positions, elements, regions, .. } = &mut self.mesh;
        let image: Vec<u32> = (0..positions.len())
            .map(|node| {
                let mut at = positions[node];
                if at[axis].abs() <= near {
                    return node as u32;
                }
                at[axis] = -at[axis];
                positions.push(at);
                positions.len() as u32 - 1
            })
            .collect();
        for e in 0..elements.len() {
            let element = elements[e];
            elements.push(TURNED.map(|i| image[element[i] as usize]));
            regions.push(regions[e]);
        }
        self.patch.extend(self.patch.clone().iter().map(|&node| image[node as usize]));
        self.patch.sort_unstable();
        self.patch.dedup();
        self.symmetric[axis] = false;
        self.mirrored[axis] = true;
    }

    /// How many times the whole body's force is the part's.
    pub fn factor(&self) -> f64 {
        self.symmetric.iter().filter(|s| **s).fold(1.0, |factor, _| 2.0 * factor)
    }

    /// Nodes on planes of symmetry, held across; and at the ends in z, held.
    fn supports(&self) -> Vec<Fixed> {
        let near = tolerance(&self.mesh);
        let (low, high) = extent(&self.mesh, 2);
        let support = |(node, at): (usize, &DVec3)| {
            let end = at.z >= high - near || (!self.symmetric[2] && at.z <= low + near);
            let axes = [0, 1, 2].map(|axis| end || (self.symmetric[axis] && at[axis].abs() <= near));
            axes.contains(&true).then_some(Fixed { node: node as u32, axes })
        };
        self.mesh.positions.iter().enumerate().filter_map(support).collect()
    }

    /// The patch's middle on the surface and its radius, m, for a cylinder about z.
    fn middle(&self) -> (DVec3, f64) {
        let positions = &self.mesh.positions;
        let at = |&node: &u32| positions[node as usize];
        let mut middle = self.patch.iter().map(at).sum::<DVec3>() / self.patch.len() as f64;
        for axis in (0..3).filter(|&axis| self.symmetric[axis]) {
            middle[axis] = 0.0;
        }
        let nearest = self
            .patch
            .iter()
            .map(at)
            .min_by(|a, b| a.distance_squared(middle).total_cmp(&b.distance_squared(middle)));
        let middle = nearest.unwrap_or_default();
        let curvature = middle.truncate().length();
        let radius = self.patch.iter().map(at).map(|p| {
            let turn = (middle.x * p.y - middle.y * p.x).atan2(middle.x * p.x + middle.y * p.y);
            (curvature * turn).hypot(p.z - middle.z)
        });
        (middle, radius.fold(0.0, f64::max))
    }
}

/// A node's number.
fn index(value: f64, count: usize) -> Result<u32, String> {
    if value.fract() != 0.0 {
        return Err(format!("{value}; give whole numbers"));
    }
    if !(0.0..count as f64).contains(&value) {
        return Err(format!("{value}, and there are {count} nodes; number them from 0"));
    }
    Ok(value as u32)
}

/// Least and greatest coordinate along an axis.
fn extent(mesh: &TetMesh, axis: usize) -> (f64, f64) {
    let values = mesh.positions.iter().map(|p| p[axis]);
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

fn tolerance(mesh: &TetMesh) -> f64 {
    ON_PLANE * (0..3).map(|axis| extent(mesh, axis)).fold(0.0, |size: f64, (low, high)| size.max(high - low))
}

/// One equilibrium on the path. Forces are of the whole body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ReferenceState {
    /// How far the patch is pressed in, m.
    pub depth_m: f64,
    /// How far it is dragged, m.
    pub distance_m: f64,
    /// Along −y, on the body, N.
    pub force_n: f64,
    /// Along the drag, on the body, N; 0 by symmetry without a drag.
    pub tangential_force_n: f64,
    /// Newton steps that it took.
    pub newton_steps: u32,
}

/// What the solves of a path took.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Solves {
    /// Newton steps.
    pub newton: u32,
    /// Iterations of conjugate gradients.
    pub conjugate: u32,
    /// Numerical factorisations.
    pub factorisations: u32,
    /// Assemblies of forces and stiffness.
    pub assemblies: u32,
    /// Of the body's forces alone.
    pub forces: u32,
    /// Newton steps of the contact alone, on the near field.
    pub contact: u32,
}

impl From<Counts> for Solves {
    fn from(counts: Counts) -> Self {
        let Counts {
            newton,
            cg_iterations: conjugate,
            factorisations,
            assemblies,
            forces,
            contact_steps: contact,
        } = counts;
        Solves { newton, conjugate, factorisations, assemblies, forces, contact }
    }
}

/// A path and its price.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// As far as it went.
    pub states: Vec<ReferenceState>,
    /// Why it ended early.
    pub stopped: Option<String>,
    /// What its solves took.
    pub counts: Solves,
    /// How long it took.
    pub spent: Spent,
}

/// A body that is ready to be pressed.
#[derive(Debug)]
pub struct Reference {
    part: Part,
    model: Model,
}

impl Reference {
    /// Prepares the model: numbering, symbolic factorisation, stiffness at rest and its factor.
    ///
    /// # Errors
    /// As [`Model::new`].
    pub fn new(part: Part, material: Material) -> Result<Self> {
        let model = Model::new(part.mesh.clone(), vec![material], &part.supports())?;
        Ok(Reference { part, model })
    }

    /// The body, as it was given.
    pub fn part(&self) -> &Part {
        &self.part
    }

    /// Unknowns, the held ones among them.
    pub fn unknowns(&self) -> usize {
        self.model.unknowns()
    }

    /// Moves the patch as planned.
    pub fn run(&self, plan: &ReferencePlan) -> Outcome {
        self.move_patch(&self.part.patch, plan)
    }

    /// Presses a further patch of the same radius, half a radius around the cylinder from the first.
    pub fn run_further(&self, plan: &ReferencePlan) -> Outcome {
        let (middle, radius) = self.part.middle();
        let turn = -0.5 * radius / middle.truncate().length().max(f64::MIN_POSITIVE);
        let at = glam::DMat3::from_rotation_z(turn) * middle;
        self.move_patch(&self.model.patch(at, radius), &ReferencePlan { drag_m: 0.0, ..*plan })
    }

    fn move_patch(&self, patch: &[u32], plan: &ReferencePlan) -> Outcome {
        let start = Stopwatch::start();
        let moved: Vec<Fixed> = patch.iter().map(|&node| Fixed { node, axes: [true; 3] }).collect();
        let mut along = DVec3::ZERO;
        along[plan.direction.axis()] = 1.0;
        let share = |i: usize, n: usize| i as f64 / n as f64;
        let mut way: Vec<[f64; 2]> =
            (1..=plan.steps).map(|i| [plan.depth_m * share(i, plan.steps), 0.0]).collect();
        if plan.drag_m != 0.0 {
            way.extend(
                (1..=plan.drag_steps).map(|i| [plan.depth_m, plan.drag_m * share(i, plan.drag_steps)]),
            );
        }
        let displacements: Vec<DVec3> =
            way.iter().map(|[depth, distance]| -DVec3::Y * *depth + along * *distance).collect();
        let (path, counts) = self
            .model
            .move_nodes(&moved, &displacements, &AtomicBool::new(false))
            .expect("nothing cancels it");
        let factor = self.part.factor();
        // A part's own force across its plane of symmetry is balanced by the other's.
        let tangential = if self.part.symmetric[plan.direction.axis()] { 0.0 } else { factor };
        let states = path.states.iter().zip(&way).map(|(state, &[depth_m, distance_m])| ReferenceState {
            depth_m,
            distance_m,
            force_n: -factor * state.force_n.y,
            tangential_force_n: tangential * state.force_n.dot(along),
            newton_steps: state.iterations,
        });
        let states: Vec<ReferenceState> = states.collect();
        let stopped = path.stopped.map(|stop| {
            let [depth, distance] = way[states.len()];
            format!("no equilibrium at {:.3} mm, {:.3} mm along: {}", depth * 1e3, distance * 1e3, stop.why)
        });
        Outcome { states, stopped, counts: counts.into(), spent: start.stop() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block of cubes, each of six tetrahedra, that begins at x = 0 and z = 0.
    fn quarter() -> Part {
        let size = [3, 2, 4];
        let number = |x: usize, y: usize, z: usize| (x + (size[0] + 1) * (y + (size[1] + 1) * z)) as u32;
        let mut positions = Vec::new();
        let mut tetrahedra = Vec::new();
        for z in 0..=size[2] {
            for y in 0..=size[1] {
                for x in 0..=size[0] {
                    positions.push(DVec3::new(x as f64, y as f64, z as f64) * 0.01);
                    if x == size[0] || y == size[1] || z == size[2] {
                        continue;
                    }
                    // Along the edges from (0, 0, 0) to (1, 1, 1), one for each order of the axes.
                    for [a, b] in [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] {
                        let mut at = [x, y, z];
                        let mut corners = [number(x, y, z); 4];
                        for (corner, axis) in corners[1..].iter_mut().zip([a, b, 3 - a - b]) {
                            at[axis] += 1;
                            *corner = number(at[0], at[1], at[2]);
                        }
                        tetrahedra.push(corners);
                    }
                }
            }
        }
        let mesh = TetMesh::from_corners(positions, &tetrahedra);
        let pressed = |p: &DVec3| p.y > 0.0199 && p.x < 0.0101 && p.z < 0.0101;
        let patch = mesh.positions.iter().enumerate().filter(|(_, p)| pressed(p));
        let patch = patch.map(|(node, _)| node as u32).collect();
        Part { mesh, patch, symmetric: [true, false, true], mirrored: [false; 3] }
    }

    const PLAN: ReferencePlan =
        ReferencePlan { depth_m: 2e-3, steps: 2, drag_m: 0.0, drag_steps: 2, direction: Direction::Axial };

    fn run(part: Part, plan: &ReferencePlan) -> Vec<ReferenceState> {
        let material = Material::isochoric_neo_hookean(1e4, 0.45).unwrap();
        let outcome = Reference::new(part, material).unwrap().run(plan);
        assert_eq!(outcome.stopped, None);
        outcome.states
    }

    #[test]
    fn parts_and_whole_have_the_same_forces() {
        let quarter = quarter();
        let [mut axial, mut around] = [quarter.clone(), quarter.clone()];
        axial.mirror(2);
        around.mirror(0);
        let mut whole = axial.clone();
        whole.mirror(0);
        whole.mirror(0); // not twice
        assert_eq!(
            [&quarter, &axial, &around, &whole].map(|p| (p.mesh.elements.len(), p.factor())),
            [(144, 4.0), (288, 2.0), (288, 2.0), (576, 1.0)]
        );
        let expected = run(quarter, &PLAN);
        assert!(expected[0].force_n > 0.0 && expected[1].force_n > 1.9 * expected[0].force_n);
        for part in [axial.clone(), around.clone(), whole.clone()] {
            for (state, expected) in run(part, &PLAN).iter().zip(&expected) {
                assert!((state.force_n / expected.force_n - 1.0).abs() < 1e-5, "{state:?} {expected:?}");
                assert!(state.tangential_force_n.abs() < 1e-6, "{state:?}");
            }
        }
        // A drag on the half is one on the whole, and the other way is its mirror image.
        for (half, direction) in [(axial, Direction::Axial), (around, Direction::Around)] {
            let plan = ReferencePlan { drag_m: 1e-3, direction, ..PLAN };
            let back = ReferencePlan { drag_m: -1e-3, ..plan };
            let expected = run(whole.clone(), &plan);
            assert_eq!(expected.len(), 4);
            let [here, there] = [run(half.clone(), &plan), run(half, &back)];
            for ((here, there), expected) in here.iter().zip(&there).zip(&expected) {
                let tangential = expected.tangential_force_n;
                assert!(expected.distance_m == 0.0 || tangential > 0.01, "{expected:?}");
                assert!((here.force_n / expected.force_n - 1.0).abs() < 1e-5, "{here:?} {expected:?}");
                assert!((here.tangential_force_n - tangential).abs() < 1e-5 * expected.force_n, "{here:?}");
                assert!((there.tangential_force_n + tangential).abs() < 1e-5 * expected.force_n, "{there:?}");
            }
        }
    }

    #[test]
    fn a_further_patch_is_as_large() {
        let part = quarter();
        let (middle, radius) = part.middle();
        assert!((middle - DVec3::new(0.0, 0.02, 0.0)).length() < 1e-12);
        let expected = (0.02 * 0.5f64.atan()).hypot(0.01);
        assert!((radius - expected).abs() < 1e-12, "{radius} {expected}");
        let material = Material::isochoric_neo_hookean(1e4, 0.45).unwrap();
        let reference = Reference::new(part, material).unwrap();
        let further = reference.run_further(&PLAN);
        assert_eq!((further.states.len(), further.stopped), (2, None));
        assert!(further.states[1].force_n > 0.0);
    }
}
