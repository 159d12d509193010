//! A finer body over the same test points: facets that follow the smooth surface within a tolerance (LAW 6).
//!
//! Depth is measured from flat facets, so a coarse mesh is felt as ridges. The smooth surface of a body keeps its
//! nodes; its elements are divided until no facet is farther from it than the [`Fineness`] says, and each new node blends what
//! its place in the coarse element blends.
//!
//! A node has three test points at most. Where more come together, which they do only in elements across which the three
//! change, it takes the three nearest between which their mean place lies: what varies linearly over the test points stays
//! what it was. Where every coarse node is a test point of its own the blend is exact.

mod division;
mod smooth;

use crate::body::{BlendWeights, Body, BodyParts, Node};
use crate::error::{BodyError, Result};
use crate::potential::CoupledLaw;
use crate::search::{MeshSearch, SurfacePoint};
use crate::surface::{Surface, TriangleMesh};
use crate::tensor::{self, Tensor};
use division::Division;
use glam::{DVec2, DVec3};
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
    /// Nodes at which more than three test points came together, for which the nearest three stand.
    pub reduced_nodes: usize,
    /// How far nodes lie from the old surface at most, m.
    pub distance_m: f64,
}

impl Surface {
    /// The points of the smooth surface at these points of its facets, m: what a refined body's nodes lie on.
    pub fn smooth_points(&self, at: &[SurfacePoint]) -> Vec<DVec3> {
        let smooth = SmoothSurface::of(self);
        at.iter().map(|at| smooth.point(self, at.element, at.n)).collect()
    }
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
        let (body, reduced_nodes) = self.carried(surface, &origins, test_point_nodes)?;
        Ok(Refined { body, sharp_nodes: smooth.sharp_nodes(), reduced_nodes, distance_m })
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
        let (body, reduced_nodes) = self.carried(surface, &origins, test_point_nodes)?;
        Ok(Refined { body, sharp_nodes: 0, reduced_nodes, distance_m })
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

    /// The body on `surface`, whose nodes come from these points of the old one; and how many blends were reduced to three test points.
    fn carried(
        &self,
        surface: Surface,
        origins: &[SurfacePoint],
        test_point_nodes: Vec<u32>,
    ) -> Result<(Body, usize)> {
        if let Some(n) = self.nodes.iter().position(|n| n.weights.iter().sum::<f64>() < 1.0 - 1e-9) {
            let problem = "its response fades out towards a border, which only a border's own nodes may do";
            return Err(BodyError::invalid(format!("node {n}"), problem, "let it fade after refining"));
        }
        let mut reduced = 0;
        let blend = |at: &SurfacePoint| {
            if let Some(node) = self.node_at(at) {
                let Node { test_points, weights, .. } = self.nodes[node];
                return BlendWeights { test_points, weights };
            }
            let (p, q) = self.inward(*at).any_orthonormal_pair();
            let place = |t: u32| {
                let x = self.nodes[self.test_point_nodes[t as usize] as usize].position;
                DVec2::new(x.dot(p), x.dot(q))
            };
            let (blend, is_reduced) = blend(self.element_nodes(at.element), at.n, place);
            reduced += usize::from(is_reduced);
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
        let mut body = Body::new(BodyParts {
            surface,
            blends,
            responses: self.curves.clone(),
            test_point_nodes,
            coupled,
            lateral_tensors: lateral_tensors.transpose()?,
            tool: self.tool,
            slip: self.slip,
            tank: self.tank,
            partial_slip: self.partial_slip,
            provenance: self.provenance.clone(),
        })?;
        // They are given on a surface of their own, for the same test points.
        body.displacements = self.displacements.clone();
        Ok((body, reduced))
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

/// What a point of an element blends, and whether more than three test points came together; `place` is that of a test point seen from the
/// point's tangent plane, m.
fn blend(corners: [&Node; 3], n: [f64; 3], place: impl Fn(u32) -> DVec2) -> (BlendWeights, bool) {
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
    let used = terms.iter().filter(|t| t.1 > 0.0).count();
    let mut three = [0, 1, 2].map(|i| terms.get(i).copied().unwrap_or((terms[count - 1].0, 0.0)));
    if used > 3 {
        // By number, so that where four lie on a circle all elements choose alike.
        terms[..used].sort_unstable_by_key(|t| t.0);
        three = nearest_three(&terms[..used], place).unwrap_or_else(|| {
            let sum: f64 = three.iter().map(|t| t.1).sum();
            three.map(|(t, w)| (t, w / sum))
        });
    }
    // In ascending order, so that neighbours between the same three name them alike.
    three.sort_unstable_by_key(|t| t.0);
    (BlendWeights { test_points: three.map(|t| t.0), weights: three.map(|t| t.1) }, used > 3)
}

/// Of all blends of three that keep the mean place, the one with the least mean square distance from it: that of the Delaunay
/// triangle around it. None where all lie in a line.
fn nearest_three(terms: &[(u32, f64)], place: impl Fn(u32) -> DVec2) -> Option<[(u32, f64); 3]> {
    let mean: DVec2 = terms.iter().map(|&(t, w)| place(t) * w).sum();
    let mut at = [DVec2::ZERO; 9];
    at.iter_mut().zip(terms).for_each(|(at, &(t, _))| *at = place(t) - mean);
    let mut nearest: Option<(f64, [(u32, f64); 3])> = None;
    for i in 0..terms.len() {
        for j in 0..i {
            for k in 0..j {
                let [a, b, c] = [at[i], at[j], at[k]];
                let whole = (b - a).perp_dot(c - a);
                if whole.abs() <= 1e-6 * (b - a).length_squared().max((c - a).length_squared()) {
                    continue;
                }
                let weights = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)].map(|part| part / whole);
                let far: f64 = weights.iter().zip([a, b, c]).map(|(w, x)| w * x.length_squared()).sum();
                if weights.iter().all(|w| *w >= -1e-9)
                    && nearest.is_none_or(|(least, _)| far < least * (1.0 - 1e-6))
                {
                    let weights = weights.map(|w| w.max(0.0));
                    let sum: f64 = weights.iter().sum();
                    let [a, b, c] = weights.map(|w| w / sum);
                    nearest = Some((far, [(terms[i].0, a), (terms[j].0, b), (terms[k].0, c)]));
                }
            }
        }
    }
    nearest.map(|(_, three)| three)
}
