//! A body ready to be pressed: mesh, tissue, supports, and the factor of its stiffness at rest.

use crate::element::{Contribution, GaussPoint, POINTS, Tissue, gauss_points};
use crate::error::{Result, SimulateError};
use crate::factor::{Factor, Symbolic, dissect};
use crate::material::Material;
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
/// Inside, nodes are numbered in the order in which the factorisation eliminates them.
#[derive(Debug)]
pub struct Model {
    mesh: TetMesh,
    boundary: Boundary,
    /// Inner number of each of the mesh's nodes.
    pub(crate) rank: Vec<u32>,
    /// Inner numbers.
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

impl Model {
    /// Prepares a body. `materials` has one for each of the mesh's regions.
    ///
    /// # Errors
    /// An element that is folded, a region without a material, a material that is none, a support on a node that
    /// does not exist, or supports that do not hold the body.
    pub fn new(mesh: TetMesh, materials: Vec<Material>, fixed: &[Fixed]) -> Result<Self> {
        let invalid =
            |place: String, problem: String, mend: &str| Err(SimulateError::invalid(place, problem, mend));
        if mesh.elements.is_empty() {
            return invalid("mesh".into(), "it has no tetrahedra".into(), "export a volume mesh");
        }
        for (e, &region) in mesh.regions.iter().enumerate() {
            if region as usize >= materials.len() {
                let problem = format!("its region {region} has no material");
                return invalid(format!("element {e}"), problem, "give each region a material");
            }
        }
        let order = dissect(mesh.positions.len(), &mesh.elements);
        let mut rank = vec![0; order.len()];
        for (new, &old) in order.iter().enumerate() {
            rank[old as usize] = new as u32;
        }
        let elements: Vec<[u32; 10]> =
            mesh.elements.iter().map(|e| e.map(|node| rank[node as usize])).collect();
        let rest: Vec<DVec3> = order.iter().map(|&old| mesh.positions[old as usize]).collect();
        let mut points = Vec::with_capacity(elements.len());
        for (e, element) in mesh.elements.iter().enumerate() {
            let nodes = element.map(|n| mesh.positions[n as usize]);
            let Some(element) = gauss_points(nodes) else {
                let place =
                    format!("element {e} near ({:.4}, {:.4}, {:.4}) m", nodes[0].x, nodes[0].y, nodes[0].z);
                return invalid(place, "it is folded or flat".into(), "mend the mesh there, or mesh anew");
            };
            points.push(element);
        }
        let mut held = vec![false; 3 * rest.len()];
        for fixed in fixed {
            let Some(&inner) = rank.get(fixed.node as usize) else {
                let problem = format!("the mesh has {} nodes", rest.len());
                return invalid(format!("fixed node {}", fixed.node), problem, "number nodes from 0");
            };
            for (axis, &fixed) in fixed.axes.iter().enumerate() {
                held[3 * inner as usize + axis] |= fixed;
            }
        }
        let pattern = Pattern::new(rest.len(), &elements);
        let symbolic = Symbolic::new(&pattern);
        let tissues: Vec<Tissue> = materials.into_iter().map(Tissue::new).collect();
        let softest =
            tissues.iter().map(|t| t.material.small_strain().shear_pa).fold(f64::INFINITY, f64::min);
        let smallest =
            points.iter().map(|p| p.iter().map(|q| q.volume).sum::<f64>()).fold(f64::INFINITY, f64::min);
        let mut model = Model {
            boundary: mesh.boundary(),
            regions: mesh.regions.clone(),
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
            let mend = "hold it with [[body.fixed]]: at three points at least that are not on one line";
            return invalid(
                "supports".into(),
                "they do not hold the body, or a part of it is free".into(),
                mend,
            );
        };
        model.rest_stiffness = stiffness;
        model.rest_factor = factor;
        Ok(model)
    }

    /// Scratch.
    pub fn timing(&self) {
        let cpu = || { let s = std::fs::read_to_string("/proc/self/stat").unwrap(); let f: Vec<&str> = s.split(' ').collect(); f[13].parse::<f64>().unwrap() / 100.0 };
        let zero = vec![0.0; self.held.len()];
        let (mut g, mut k) = (zero.clone(), Stiffness::default());
        let t = cpu(); for _ in 0..10 { self.assemble(&zero, &mut g, &mut k); } println!("assemble {:.4}", (cpu() - t) / 10.0);
        let t = cpu(); for _ in 0..10 { self.energy(&zero); } println!("energy {:.4}", (cpu() - t) / 10.0);
        let t = cpu(); for _ in 0..3 { let _ = self.symbolic.factor(&self.pattern, &k, &self.held); } println!("factor {:.4}", (cpu() - t) / 3.0);
        let mut x = vec![1.0f32; zero.len()]; let mut s = Vec::new();
        let t = cpu(); for _ in 0..20 { self.symbolic.solve(&self.rest_factor, &mut x, &mut s); } println!("solve {:.4}", (cpu() - t) / 20.0);
        let y = vec![1.0; zero.len()]; let mut z = zero.clone();
        let t = cpu(); for _ in 0..20 { k.multiply(&self.pattern, &y, &mut z); } println!("multiply {:.4}", (cpu() - t) / 20.0);
        println!("factor in solves {}", self.symbolic.factor_in_solves);
    }

    /// As it was given.
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// The mesh's surface.
    pub fn boundary(&self) -> &Boundary {
        &self.boundary
    }

    /// Unknowns, the held ones among them.
    pub fn unknowns(&self) -> usize {
        self.held.len()
    }

    #[inline]
    fn gather(&self, element: &[u32; 10], u: &[f64]) -> [f64; 30] {
        let mut local = [0.0; 30];
        for (local, &node) in local.chunks_exact_mut(3).zip(element) {
            local.copy_from_slice(&u[3 * node as usize..][..3]);
        }
        local
    }

    /// Stored energy of the displacements `u` (inner numbers), J; infinite if an element is turned inside out.
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
