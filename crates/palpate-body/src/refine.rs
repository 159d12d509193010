//! A finer body over the same test points: facets that follow the smooth surface within a tolerance (LAW 6).
//!
//! Depth is measured from flat facets, so a coarse mesh is felt as ridges. The [smooth surface](smooth) of a body keeps its
//! nodes; its elements are divided until no facet is farther from it than the [`Fineness`] says, and each new node blends what
//! its place in the coarse element blends.
//!
//! A node has three test points at most. Where more come together, which they do only in elements across which the three
//! change, the three heaviest stay, each less the weight of the fourth: that is continuous along the surface, and changes
//! nothing where three are enough. Where every coarse node is a test point of its own the blend is exact.

mod division;
mod smooth;

use crate::body::{BlendWeights, Body, BodyParts, Node};
use crate::error::{BodyError, Result};
use crate::potential::CoupledLaw;
use crate::search::{MeshSearch, SurfacePoint};
use crate::surface::{Surface, TriangleMesh};
use crate::tensor::{self, Tensor};
use division::Division;
use glam::DVec3;
use smooth::SmoothSurface;

/// Triangles that a refined body may have: about 6 GB of memory, and as much as a shape may have.
pub const MAX_TRIANGLES: usize = crate::shape::MAX_TRIANGLES as usize;

/// Ridges of 10 µm are forces of 1 mN at 100 N/m, below what a fingertip feels on a soft body.
pub const DEFAULT_SAGITTA_M: f64 = 10e-6;

/// How fine facets become; what does not matter is infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fineness {
    /// Largest distance of a facet from the smooth surface, m.
    pub sagitta_m: f64,
    /// Longest edge, m.
    pub edge_m: f64,
}

impl Fineness {
    /// By the distance from the smooth surface, m.
    pub fn sagitta(sagitta_m: f64) -> Self {
        Fineness { sagitta_m, edge_m: f64::INFINITY }
    }

    /// By the length of edges, m.
    pub fn edge(edge_m: f64) -> Self {
        Fineness { sagitta_m: f64::INFINITY, edge_m }
    }

    fn check(&self) -> Result<()> {
        let lengths = [("sagitta", self.sagitta_m), ("edge length", self.edge_m)];
        match lengths.into_iter().find(|(_, length)| length.is_nan() || *length <= 0.0) {
            None => Ok(()),
            Some((name, length)) => {
                Err(BodyError::invalid(name, format!("it is {length} m"), "give a positive length"))
            }
        }
    }
}

/// A body on another surface, and what became of it.
#[derive(Debug, Clone)]
pub struct Refined {
    /// It.
    pub body: Body,
    /// Nodes of the old body where facets turn too sharply to be read as a smooth surface: it stays flat there.
    pub sharp_nodes: usize,
    /// Largest part of a node's weights that moved because more than three test points came together, 0 to 1.
    pub moved_weight: f64,
    /// How far nodes lie from the old surface at most, m.
    pub distance_m: f64,
}

impl Body {
    /// The body on a finer surface. Nodes at vertices keep their numbers, and all that they have; at creases further nodes
    /// follow after them. The same body gives the same bits.
    ///
    /// # Errors
    /// A fineness that is not positive, or needs more than [`MAX_TRIANGLES`]; a response that fades towards a border.
    pub fn refined(&self, fineness: Fineness) -> Result<Refined> {
        fineness.check()?;
        let smooth = SmoothSurface::of(self);
        let Division { surface, origins, node_of } = Division::new(self, &smooth, fineness)?;
        let distance = |(p, at): (&DVec3, &SurfacePoint)| p.distance(self.point(*at));
        let distance_m = surface.positions.iter().zip(&origins).map(distance).fold(0.0, f64::max);
        let test_point_nodes = self.test_point_nodes.iter().map(|&n| node_of(n)).collect();
        let (body, moved_weight) = self.carried(surface, &origins, test_point_nodes)?;
        Ok(Refined { body, sharp_nodes: smooth.sharp_nodes(), moved_weight, distance_m })
    }

    /// The body on a finer surface of one's own: each node has what the nearest point of the old surface has.
    ///
    /// # Errors
    /// A surface that is farther from the old one than a tenth of its size; one on which two test points fall on one node; a
    /// response that fades towards a border.
    pub fn on_surface(&self, surface: Surface) -> Result<Refined> {
        let size = self.extent_m();
        let mut distance_m = 0.0f64;
        let at = |(n, &p): (usize, &DVec3)| {
            let found = self.nearest(p, 0.1 * size).ok_or_else(|| {
                let place = format!("node {n} at ({:.6}, {:.6}, {:.6}) m", p.x, p.y, p.z);
                let problem = format!("it is more than {:.3} mm away from the body's surface", 100.0 * size);
                BodyError::invalid(
                    place,
                    problem,
                    "give a mesh of the same surface, in its place, and its unit",
                )
            })?;
            distance_m = distance_m.max(found.distance);
            Ok(found.at)
        };
        let origins = surface.positions.iter().enumerate().map(at).collect::<Result<Vec<_>>>()?;
        let test_point_nodes = self.test_points_on(&surface)?;
        let (body, moved_weight) = self.carried(surface, &origins, test_point_nodes)?;
        Ok(Refined { body, sharp_nodes: 0, moved_weight, distance_m })
    }

    /// The node at a point, if one is there.
    fn node_at(&self, at: &SurfacePoint) -> Option<usize> {
        let corner = at.n.iter().position(|&n| n == 1.0)?;
        Some(self.element_node_numbers(at.element)[corner] as usize)
    }

    /// The inward normal at a point, a node's own to the bit.
    fn inward_at(&self, at: &SurfacePoint) -> DVec3 {
        self.node_at(at).map_or_else(|| self.inward(*at), |node| self.nodes[node].inward)
    }

    /// Diagonal of the box around the nodes, m.
    fn extent_m(&self) -> f64 {
        let far = DVec3::splat(f64::INFINITY);
        let around = |(low, high): (DVec3, DVec3), n: &Node| (low.min(n.position), high.max(n.position));
        let (low, high) = self.nodes.iter().fold((far, -far), around);
        low.distance(high)
    }

    /// The nodes of another surface that are nearest to the test points.
    fn test_points_on(&self, surface: &Surface) -> Result<Vec<u32>> {
        let triangles: Vec<[u32; 3]> = surface.elements.iter().map(|e| e.nodes).collect();
        let mesh = TriangleMesh { positions: surface.positions.clone(), triangles };
        let search = MeshSearch::new(&mesh);
        let node = |&n: &u32| {
            let p = self.nodes[n as usize].position;
            let (at, _) = search.nearest(p, f64::INFINITY)?;
            let corners = mesh.triangles[at.element as usize];
            let far = |n: u32| mesh.positions[n as usize].distance_squared(p);
            corners.into_iter().min_by(|a, b| far(*a).total_cmp(&far(*b)))
        };
        let nodes: Vec<u32> = self.test_point_nodes.iter().map(|n| node(n).unwrap_or(0)).collect();
        let mut sorted: Vec<(u32, usize)> = nodes.iter().enumerate().map(|(t, &n)| (n, t)).collect();
        sorted.sort_unstable();
        match sorted.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            None => Ok(nodes),
            Some(pair) => {
                let place = format!("test points {} and {}", pair[0].1, pair[1].1);
                let problem = format!("the mesh has the same node {} nearest to both", pair[0].0);
                Err(BodyError::invalid(place, problem, "give a mesh that is finer there"))
            }
        }
    }

    /// The body on `surface`, whose nodes come from these points of the old one; and how much weight moved at most.
    fn carried(
        &self,
        surface: Surface,
        origins: &[SurfacePoint],
        test_point_nodes: Vec<u32>,
    ) -> Result<(Body, f64)> {
        if let Some(n) = self.nodes.iter().position(|n| n.weights.iter().sum::<f64>() < 1.0 - 1e-9) {
            let problem = "its response fades out towards a border, which only a border's own nodes may do";
            return Err(BodyError::invalid(format!("node {n}"), problem, "let it fade after refining"));
        }
        let mut moved = 0.0f64;
        let blend = |at: &SurfacePoint| {
            if let Some(node) = self.node_at(at) {
                let Node { test_points, weights, .. } = self.nodes[node];
                return BlendWeights { test_points, weights };
            }
            let (blend, lost) = blend(self.element_nodes(at.element), at.n);
            moved = moved.max(lost);
            blend
        };
        let blends = origins.iter().map(blend).collect();
        let lateral_tensors = self.lateral_tensors().map(|_| self.tensors_at(origins, &surface.inward));
        let coupled = self.coupled.clone().map(|law| {
            let at = |(potential, &node): (&mut crate::Potential, &u32)| {
                potential.tangents = turned(potential.tangents, surface.inward[node as usize]);
            };
            let mut potentials = law.potentials;
            potentials.iter_mut().zip(&test_point_nodes).for_each(at);
            CoupledLaw { potentials, ..law }
        });
        let body = Body::new(BodyParts {
            surface,
            blends,
            responses: self.curves.clone(),
            test_point_nodes,
            coupled,
            lateral_tensors: lateral_tensors.transpose()?,
            tool: self.tool,
            slip: self.slip,
            tank: self.tank,
            provenance: self.provenance.clone(),
        })?;
        Ok((body, moved))
    }

    /// The tensors blended at these points, each made one of its new normal.
    fn tensors_at(&self, origins: &[SurfacePoint], inward: &[DVec3]) -> Result<Vec<Tensor>> {
        let at = |(n, (at, u)): (usize, (&SurfacePoint, &DVec3))| {
            if let Some(node) = self.node_at(at)
                && self.nodes[node].inward == *u
            {
                return Ok(self.lateral_tensors[node]);
            }
            let tensors = self.element_tensors(at.element);
            let sum = std::array::from_fn(|i| (0..3).map(|corner| tensors[corner][i] * at.n[corner]).sum());
            tensor::from_stiffness(&sum, *u).ok_or_else(|| {
                let problem = "the lateral tensors around it have no blend in its tangent plane";
                BodyError::invalid(format!("node {n}"), problem, "smooth the lateral stiffness there")
            })
        };
        origins.iter().zip(inward).enumerate().map(at).collect()
    }
}

/// Unit vectors at right angles to `u` and to each other, the nearest to `tangents`: these to the bit where they are so already.
fn turned(tangents: [DVec3; 2], u: DVec3) -> [DVec3; 2] {
    let [t1, t2] = tangents;
    if t1.dot(u).abs().max(t2.dot(u).abs()) < 1e-12 {
        return tangents;
    }
    let first = (t1 - u * t1.dot(u)).normalize_or(u.any_orthonormal_vector());
    let second = u.cross(first);
    [first, second * second.dot(t2).signum()]
}

/// What a point of an element blends, and the part of its weights that moved.
fn blend(corners: [&Node; 3], n: [f64; 3]) -> (BlendWeights, f64) {
    let mut terms = [(0u32, 0.0f64); 9];
    let mut count = 0;
    for (corner, n) in corners.into_iter().zip(n) {
        for (&t, &w) in corner.test_points.iter().zip(&corner.weights) {
            match terms[..count].iter_mut().find(|(known, _)| *known == t) {
                Some((_, sum)) => *sum += n * w,
                None => {
                    terms[count] = (t, n * w);
                    count += 1;
                }
            }
        }
    }
    let terms = &mut terms[..count];
    terms.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let fourth = terms.get(3).map_or(0.0, |t| t.1);
    let mut moved = 0.0;
    if fourth > 0.0 {
        let before = [0, 1, 2].map(|i| terms[i].1);
        let less = before.map(|w| w - fourth);
        // Four alike: nothing tells which three.
        let kept = if less[0] > 0.0 { less } else { before };
        let per = terms.iter().map(|t| t.1).sum::<f64>() / kept.iter().sum::<f64>();
        let stays: f64 = before.into_iter().zip(kept).map(|(before, kept)| before.min(kept * per)).sum();
        moved = 1.0 - stays;
        (0..3).for_each(|i| terms[i].1 = kept[i] * per);
    }
    // In ascending order, so that neighbours between the same three name them alike.
    let count = count.min(3);
    let terms = &mut terms[..count];
    terms.sort_unstable_by_key(|t| t.0);
    let at = |i: usize| terms[i.min(count - 1)].0;
    let weight = |i: usize| terms.get(i).map_or(0.0, |t| t.1);
    (BlendWeights { test_points: [0, 1, 2].map(at), weights: [0, 1, 2].map(weight) }, moved)
}
