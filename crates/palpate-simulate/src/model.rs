//! A body ready to be pressed: mesh, tissue, supports, and the factor of its stiffness at rest.

use crate::element::{Contribution, GaussPoint, POINTS, Tissue, gauss_points};
use crate::error::{Result, SimulateError};
use crate::factor::{Factor, Symbolic, dissect};
use crate::material::Material;
use crate::mesh::check::holds;
use crate::mesh::{Boundary, TetMesh};
use crate::stiffness::{Pattern, Stiffness};
use glam::DVec3;

/// A node that is held at its place at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fixed {
    /// The mesh's node.
    pub node: u32,
    /// Along x, y and z.
    pub axes: [bool; 3],
}

/// A body to be simulated. One model serves any number of threads.
///
/// Inside, free nodes come first, in the order in which the factorisation eliminates them.
#[derive(Debug)]
pub struct Model {
    mesh: TetMesh,
    boundary: Boundary,
    /// Inner number of each of the mesh's nodes.
    pub(crate) rank: Vec<u32>,
    /// Elements that have a free node, in inner numbers.
    pub(crate) elements: Vec<[u32; 10]>,
    pub(crate) points: Vec<[GaussPoint; POINTS]>,
    pub(crate) tissues: Vec<Tissue>,
    pub(crate) regions: Vec<u32>,
    pub(crate) pattern: Pattern,
    pub(crate) symbolic: Symbolic,
    /// For each unknown (3 × node + component), whether it is held.
    pub(crate) held: Vec<bool>,
    pub(crate) rest_stiffness: Stiffness,
    pub(crate) rest_factor: Factor,
    /// Positions at rest by inner number, m.
    pub(crate) rest: Vec<DVec3>,
    /// A force below which nothing is worth a step, N: a ten-millionth of the softest shear modulus times the size
    /// of the smallest element squared.
    pub(crate) least_force_n: f64,
}

/// `order[new] = old`: free nodes by nested dissection, then the others.
fn numbering(elements: &[[u32; 10]], free: &[bool]) -> Vec<u32> {
    let mut dense = vec![u32::MAX; free.len()];
    let mut order: Vec<u32> = (0..free.len() as u32).filter(|&n| free[n as usize]).collect();
    for (new, &old) in order.iter().enumerate() {
        dense[old as usize] = new as u32;
    }
    let cliques: Vec<Vec<u32>> = elements
        .iter()
        .map(|e| e.iter().map(|&n| dense[n as usize]).filter(|&n| n != u32::MAX).collect())
        .collect();
    order = dissect(order.len(), &cliques).into_iter().map(|n| order[n as usize]).collect();
    order.extend((0..free.len() as u32).filter(|&n| !free[n as usize]));
    order
}

impl Model {
    /// Prepares a body. `materials` has one for each of the mesh's regions.
    ///
    /// # Errors
    /// An element that is folded, a region without a material, a material that is none, a support on a node that
    /// does not exist, or supports that do not hold the body.
    pub fn new(mesh: TetMesh, materials: Vec<Material>, fixed: &[Fixed]) -> Result<Self> {
        let invalid =
            |place: String, problem: String, hint: &str| Err(SimulateError::invalid(place, problem, hint));
        if mesh.elements.is_empty() {
            return invalid("mesh".into(), "it has no tetrahedra".into(), "export a volume mesh");
        }
        for (e, &region) in mesh.regions.iter().enumerate() {
            if region as usize >= materials.len() {
                let problem = format!("its region {region} has no material");
                return invalid(format!("element {e}"), problem, "give each region a material");
            }
        }
        let mut held_axes = vec![[false; 3]; mesh.positions.len()];
        for fixed in fixed {
            let Some(axes) = held_axes.get_mut(fixed.node as usize) else {
                let problem = format!("the mesh has {} nodes", mesh.positions.len());
                return invalid(format!("fixed node {}", fixed.node), problem, "number nodes from 0");
            };
            for (held, fixed) in axes.iter_mut().zip(fixed.axes) {
                *held |= fixed;
            }
        }
        if held_axes.iter().all(|axes| axes.iter().all(|held| *held)) {
            let hint = "leave a part of it free: make [[body.fixed]] smaller";
            return invalid("supports".into(), "they hold every node of the body".into(), hint);
        }
        if !holds(mesh.positions.iter().copied().zip(held_axes.iter().copied())) {
            let hint = "hold it with [[body.fixed]] so that it can neither move nor turn as a whole: \
                        three points that are not on one line, or planes of symmetry and one more support";
            return invalid("supports".into(), "they do not hold the body".into(), hint);
        }
        // Free nodes first, in the order of elimination; what is held on all sides has no part in it.
        let free: Vec<bool> = held_axes.iter().map(|axes| axes.contains(&false)).collect();
        let order = numbering(&mesh.elements, &free);
        let free_nodes = free.iter().filter(|free| **free).count();
        let mut rank = vec![0; order.len()];
        for (new, &old) in order.iter().enumerate() {
            rank[old as usize] = new as u32;
        }
        // An element whose nodes are all held stores no energy.
        let live = |e: &usize| mesh.elements[*e].iter().any(|&n| free[n as usize]);
        let live: Vec<usize> = (0..mesh.elements.len()).filter(live).collect();
        let elements: Vec<[u32; 10]> =
            live.iter().map(|&e| mesh.elements[e].map(|node| rank[node as usize])).collect();
        let rest: Vec<DVec3> = order.iter().map(|&old| mesh.positions[old as usize]).collect();
        let mut points = Vec::with_capacity(elements.len());
        for (e, element) in mesh.elements.iter().enumerate() {
            let nodes = element.map(|n| mesh.positions[n as usize]);
            let Some(element) = gauss_points(nodes) else {
                let place =
                    format!("element {e} near ({:.4}, {:.4}, {:.4}) m", nodes[0].x, nodes[0].y, nodes[0].z);
                return invalid(place, "it is folded or flat".into(), "repair the mesh there, or mesh anew");
            };
            points.push(element);
        }
        let smallest =
            points.iter().map(|p| p.iter().map(|q| q.volume).sum::<f64>()).fold(f64::INFINITY, f64::min);
        let points = live.iter().map(|&e| points[e]).collect();
        let held: Vec<bool> = order.iter().flat_map(|&old| held_axes[old as usize]).collect();
        let pattern = Pattern::new(free_nodes, &elements);
        let symbolic = Symbolic::new(&pattern);
        let tissues: Vec<Tissue> = materials.into_iter().map(Tissue::new).collect();
        let softest =
            tissues.iter().map(|t| t.material.small_strain().shear_pa).fold(f64::INFINITY, f64::min);
        let mut model = Model {
            boundary: mesh.boundary(),
            regions: live.iter().map(|&e| mesh.regions[e]).collect(),
            mesh,
            rank,
            elements,
            points,
            tissues,
            pattern,
            symbolic,
            held,
            rest_stiffness: Stiffness::default(),
            rest_factor: Factor::default(),
            rest,
            least_force_n: 1e-7 * softest * smallest.powf(2.0 / 3.0),
        };
        let zero = vec![0.0; model.held.len()];
        let mut stiffness = Stiffness::default();
        model.assemble(&zero, &mut vec![0.0; zero.len()], &mut stiffness);
        let Ok(factor) = model.symbolic.factor(&model.pattern, &stiffness, &model.held) else {
            let hint = "hold it with [[body.fixed]]: at three points at least that are not on one line";
            return invalid(
                "supports".into(),
                "they do not hold the body, or a part of it is free".into(),
                hint,
            );
        };
        model.rest_stiffness = stiffness;
        model.rest_factor = factor;
        Ok(model)
    }

    /// As it was given.
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// The mesh's surface.
    pub fn boundary(&self) -> &Boundary {
        &self.boundary
    }

    /// Whether a support holds one of the mesh's nodes, along one axis at least.
    pub fn is_held(&self, node: u32) -> bool {
        let first = 3 * self.rank[node as usize] as usize;
        self.held[first..first + 3].contains(&true)
    }

    /// About what a sticking press with its stuck tangents takes of one core, s: from the elements and the factor's size, fitted to
    /// presses that were timed. The same on every machine, to plan by; a machine may be twice as fast.
    pub fn press_estimate_s(&self) -> f64 {
        /// Of a factor's entry in a substitution; of an element's stiffness and forces; and of its forces alone, s.
        const EACH: [f64; 3] = [6.7e-10, 1.9e-6, 0.6e-6];
        /// Substitutions, factorisations and assemblies of a press; and what its dense near field takes, s.
        const COUNTS: [f64; 4] = [100.0, 10.0, 16.0, 103.0];
        const NEAR_FIELD: f64 = 0.3;
        let [solves, factors, assemblies, forces] = COUNTS;
        let elements = assemblies * EACH[1] + forces * EACH[2];
        let solves = (solves + factors * self.symbolic.factor_in_solves) * self.symbolic.entries;
        solves * EACH[0] + elements * self.elements.len() as f64 + NEAR_FIELD
    }

    /// Unknowns, the held ones among them.
    pub fn unknowns(&self) -> usize {
        self.held.len()
    }

    /// Where a node (inner number) is, displaced by `u`, m.
    #[inline]
    pub(crate) fn place(&self, node: u32, u: &[f64]) -> DVec3 {
        self.rest[node as usize] + DVec3::from_slice(&u[3 * node as usize..])
    }

    #[inline]
    fn gather(&self, element: &[u32; 10], u: &[f64]) -> [f64; 30] {
        let mut local = [0.0; 30];
        for (local, &node) in local.chunks_exact_mut(3).zip(element) {
            local.copy_from_slice(&u[3 * node as usize..][..3]);
        }
        local
    }

    /// Stored energy of the displacements `u` (inner numbers), J; infinite if an element is inverted.
    pub(crate) fn energy(&self, u: &[f64]) -> f64 {
        let mut energy = 0.0;
        for (e, element) in self.elements.iter().enumerate() {
            let local = self.gather(element, u);
            energy += self.tissues[self.regions[e] as usize].energy(&self.points[e], &local);
            if energy == f64::INFINITY {
                break;
            }
        }
        energy
    }

    /// ∂energy/∂u of the displacements `u`, N; whether no element is inverted: else it means nothing.
    pub(crate) fn forces(&self, u: &[f64], gradient: &mut [f64]) -> bool {
        gradient.fill(0.0);
        let mut forces = [0.0; 30];
        let arch = pulp::Arch::new();
        for (e, element) in self.elements.iter().enumerate() {
            let local = self.gather(element, u);
            let tissue = &self.tissues[self.regions[e] as usize];
            if !arch.dispatch(|| tissue.forces(&self.points[e], &local, &mut forces)) {
                return false;
            }
            for (force, &node) in forces.chunks_exact(3).zip(element) {
                for (g, f) in gradient[3 * node as usize..].iter_mut().zip(force) {
                    *g += f;
                }
            }
        }
        true
    }

    /// The same with its gradient (N) and stiffness (N/m), which mean nothing if the energy is infinite.
    pub(crate) fn assemble(&self, u: &[f64], gradient: &mut [f64], stiffness: &mut Stiffness) -> f64 {
        gradient.fill(0.0);
        stiffness.clear(&self.pattern);
        let mut energy = 0.0;
        let mut contribution = Contribution::default();
        // Compiled for wide vector registers too, and dispatched at run time.
        let arch = pulp::Arch::new();
        for (e, element) in self.elements.iter().enumerate() {
            let local = self.gather(element, u);
            let tissue = &self.tissues[self.regions[e] as usize];
            arch.dispatch(|| tissue.contribute(&self.points[e], &local, &mut contribution));
            energy += contribution.energy;
            if energy == f64::INFINITY {
                break;
            }
            for (force, &node) in contribution.force.chunks_exact(3).zip(element) {
                for (g, f) in gradient[3 * node as usize..].iter_mut().zip(force) {
                    *g += f;
                }
            }
            stiffness.add(&self.pattern, e, &contribution);
        }
        energy
    }
}
