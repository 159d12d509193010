//! How energy, frames and tensors change along the surface, at the nodes: what the slip rule `consistent` reads
//! (MODEL 4, E3).
//!
//! Within an element a blend Σ n_j X_j has the gradient Σ X_j ∇n_j, another one in each element. Its area-weighted mean over
//! the elements around node l, ∇̄X_l, blended like everything else as Σ n_l ∇̄X_l, is continuous over the edges. At a crease
//! the mean is over the elements that share the node, so that a sharp edge stays one.
//!
//! Energies are blended of test points' curves: ∇̄W_l = Σ_t g_lt W_t. The coefficients g sum to zero, so that one test
//! point, the reference, needs none: ∇̄W_l = Σ_t g_lt (W_t − W_ref), and nothing is left of rounding on a uniform body.
//! On a mesh that is finer than its test points they are two vectors a node. A node with more than three of them, as
//! where every node is its own test point, has the sum as curves of its own: it takes a fifth of the time, and 160 bytes an
//! interval of the knots, where the test point's responses take 112.
//!
//! All in single precision, four numbers at a time: it moves a gradient by some 10⁻⁷ of itself.

use crate::body::Node;
use crate::curve::Curve;
use crate::law::{CoupledRow, QUANTITIES, Reach, monomials};
use crate::model::ContactModel;
use crate::parallel;
use crate::potential::{PotentialAt, Potentials};
use crate::response::{BasisValues, POWERS, Response, Responses};
use crate::surface::Element;
use crate::tensor::Tensor;
use glam::{DVec3, Vec3A, Vec4};
use std::collections::HashMap;

/// A test point that answers nothing: what a blend lacks to 1 where it fades towards a border.
const NOTHING: u32 = u32::MAX;

/// One test point's part of a node's energy gradient.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Term {
    /// g_lt, 1/m.
    gradient: [f32; 3],
    test_point: u32,
}

/// Terms that a node has at most; with more it has curves.
const MAX_TERMS: usize = 3;

/// A gradient in powers of a distance: of t⁰ to t⁴.
pub type Coefficients = [DVec3; POWERS];

/// A node's energy gradient in one interval: the coefficients of [`BasisValues`]'s powers.
type Row = [Vec4; POWERS];

/// The same of a coupled law, in powers of the depth: the coefficients of the monomials in the tangents of the node's first
/// test point.
type CoupledGradient = [[Vec4; TERMS]; 4];

/// Quantities of a potential that have a gradient: all but μ.
const TERMS: usize = QUANTITIES - 1;

/// The test points' energies at one deflection, as a law finds them: what a node's gradient sums.
pub trait PointEnergies {
    /// W_t, J; of a test point that does not exist 0.
    ///
    /// # Real-time
    /// O(1), never panics.
    fn energy(&self, test_point: u32) -> f64;

    /// The gradient of a node whose curves begin at `start` in the tables of `gradients`, N.
    ///
    /// # Real-time
    /// O(1), never panics.
    fn gradient(&self, gradients: &Gradients, start: usize, reference: u32) -> Vec3A;
}

/// Energies of test points that were found before.
#[derive(Debug, Clone, Copy)]
pub struct EnergyCache {
    /// Test points.
    pub points: [u32; 3],
    /// Their energies, J.
    pub energies: [f64; 3],
}

impl EnergyCache {
    /// None.
    pub const NONE: Self = EnergyCache { points: [u32::MAX; 3], energies: [0.0; 3] };

    #[inline(always)]
    fn energy(&self, point: u32, find: impl FnOnce() -> f64) -> f64 {
        let ([a, b, c], [x, y, z]) = (self.points, self.energies);
        if point == a {
            x
        } else if point == b {
            y
        } else if point == c {
            z
        } else {
            find()
        }
    }
}

/// Energies of a decoupled law.
#[derive(Debug, Clone, Copy)]
pub struct DecoupledEnergies<'a> {
    /// The deflections.
    pub basis: BasisValues<'a>,
    /// What is known already.
    pub cache: EnergyCache,
}

impl PointEnergies for DecoupledEnergies<'_> {
    #[inline(always)]
    fn energy(&self, test_point: u32) -> f64 {
        self.cache.energy(test_point, || self.basis.energy(test_point))
    }

    #[inline(always)]
    fn gradient(&self, gradients: &Gradients, start: usize, _: u32) -> Vec3A {
        let (i, j) = self.basis.rows(start);
        let [p, q] = &self.basis.single;
        match (gradients.depth_rows.get(i), gradients.lateral_rows.get(j)) {
            (Some(depth), Some(lateral)) => Vec3A::from_vec4(value(depth, p) + value(lateral, q)),
            _ => Vec3A::ZERO,
        }
    }
}

/// Energies of a coupled law.
#[derive(Debug, Clone, Copy)]
pub struct CoupledEnergies<'a> {
    /// The test points.
    pub potentials: &'a Potentials,
    /// The interval of δz, and the distance from its knot, m.
    pub depth: (usize, f64),
    /// δ_t, m, and its reach.
    pub tangential: DVec3,
    /// See there.
    pub reach: Reach<f64>,
    /// What is known already.
    pub cache: EnergyCache,
}

impl CoupledEnergies<'_> {
    #[inline(always)]
    fn at(&self, test_point: u32) -> PotentialAt<'_> {
        self.potentials.at(test_point, self.depth.0)
    }
}

impl PointEnergies for CoupledEnergies<'_> {
    #[inline]
    fn energy(&self, test_point: u32) -> f64 {
        self.cache
            .energy(test_point, || self.at(test_point).energy(self.depth.1, self.tangential, &self.reach))
    }

    #[inline(always)]
    fn gradient(&self, gradients: &Gradients, start: usize, reference: u32) -> Vec3A {
        let (interval, t) = self.depth;
        let Some([a, b, c, d]) = gradients.coupled_rows.get(self.potentials.row(start, interval)) else {
            return Vec3A::ZERO;
        };
        let monomials = monomials(self.at(reference).xi(self.tangential), &self.reach).map(|m| m as f32);
        let t = t as f32;
        let mut sum = Vec4::ZERO;
        for ((((a, b), c), d), m) in a.iter().zip(b).zip(c).zip(d).zip(monomials) {
            sum += (*a + (*b + (*c + *d * t) * t) * t) * m;
        }
        Vec3A::from_vec4(sum)
    }
}

/// What a step reads of a node, in one line of the cache.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
struct NodeGradients {
    /// ∇̄u_l: of each coordinate of u a gradient, 1/m.
    frame: [Vec4; 3],
    /// The first of the terms of its energy gradient, or which of the curves it has.
    start: u32,
    /// How many terms, or [`CURVES`].
    count: u32,
    /// See [`GradientBound`].
    energy_bound: f32,
    frame_bound: f32,
}

impl NodeGradients {
    /// Of a node where nothing changes.
    const NONE: Self =
        NodeGradients { frame: [Vec4::ZERO; 3], start: 0, count: 0, energy_bound: 0.0, frame_bound: 0.0 };
}

/// How a node's tensor changes.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct TensorGradient {
    /// ∇̄A_l along x, y and z, 1/m.
    axes: [[f32; 6]; 3],
    /// See [`GradientBound`].
    bound: f32,
}

const CURVES: u32 = u32::MAX;

/// The nodal gradients of a body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gradients {
    /// (nodes)
    nodes: Vec<NodeGradients>,
    terms: Vec<Term>,
    /// (nodes with curves × depth knots), and the same of the lateral curves.
    depth_rows: Vec<Row>,
    lateral_rows: Vec<Row>,
    /// (nodes with curves × depth knots), of a coupled law in place of the two.
    coupled_rows: Vec<CoupledGradient>,
    /// (nodes), or none where the lateral response is alike in all directions.
    tensors: Vec<TensorGradient>,
    /// (nodes × depth knots), of a coupled law.
    coupled_bounds: Vec<CoupledBound>,
    /// Depth knots.
    columns: usize,
}

/// How large the energy gradient of a node can be in an interval of the depth, with a coupled law: by the degree of its terms in
/// the lateral deflection, N/mⁿ.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct CoupledBound([f32; 5]);

impl CoupledBound {
    /// Of terms with these coefficients in powers of the distance from a knot, up to the distance `h` (m): the ordinates of a
    /// vector polynomial in Bernstein's form bound it. None past the last knot.
    fn new(rows: &[[DVec3; TERMS]; 4], h: Option<f64>) -> Self {
        let Some(h) = h else { return CoupledBound([f32::INFINITY; 5]) };
        let mut sums = [0.0f64; 5];
        // ½ξ₁², ξ₁ξ₂ and ½ξ₂² are at most half the square.
        let share = [(0, 1.0), (1, 1.0), (1, 1.0), (2, 0.5), (2, 0.5), (2, 0.5)];
        let share = share.into_iter().chain([(3, 1.0); 4]).chain([(4, 1.0)]);
        for (q, (degree, share)) in share.enumerate() {
            let [a, b, c, d] = [rows[0][q], rows[1][q] * h, rows[2][q] * (h * h), rows[3][q] * (h * h * h)];
            let ordinates = [a, a + b / 3.0, a + b * (2.0 / 3.0) + c / 3.0, a + b + c + d];
            sums[degree] += share * ordinates.iter().map(|o| o.length()).fold(0.0, f64::max);
        }
        CoupledBound(sums.map(above))
    }

    /// At the lateral deflection `r` (m) and its reach, N.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline(always)]
    pub fn at(&self, r: f64, reach: &Reach<f64>) -> f64 {
        let [a, b, c, d, e] = self.0.map(f64::from);
        a + r * (b + r * (c + r * (d * reach.s))) + e * reach.q
    }
}

/// How large a node's gradients can be, whatever the deflection: a step need not look at those that can't matter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GradientBound {
    /// |∇̄W| is at most this times W, 1/m; infinite where a curve vanishes and its neighbours' do not.
    pub energy: f32,
    /// |∇̄(u·b)| is at most this times |b|, 1/m.
    pub frame_gradient: f32,
    /// |∇̄(d·A d)| is at most this times |d|², 1/m.
    pub tensor: f32,
}

/// In single precision, and no less.
fn above(x: f64) -> f32 {
    (x * (1.0 + 1e-6)) as f32
}

impl Gradients {
    /// Of the nodes of a checked model; `curves` are its test points' responses, none with a coupled law.
    pub(crate) fn new(model: &ContactModel, curves: &[Response]) -> Self {
        let ContactModel { nodes, elements, responses, .. } = model;
        let around = Around::new(nodes.len(), elements);
        let columns = responses.depth_knots().values().len();
        let parts = parallel::in_parts(nodes.len(), |range| {
            let mut part =
                Gradients { columns, nodes: Vec::with_capacity(range.len()), ..Gradients::default() };
            let (mut sums, mut hulls) = (NodeSums::default(), HullCache::default());
            for l in range {
                sums.of_node(model, around.of(l), l);
                part.add(model, curves, &nodes[l], &sums, &mut hulls);
            }
            part
        });
        let mut parts = parts.into_iter();
        let mut gradients = parts.next().unwrap_or_default();
        parts.for_each(|part| gradients.append(part));
        gradients
    }

    /// Those of further nodes after these.
    fn append(&mut self, further: Gradients) {
        let Gradients {
            nodes,
            terms,
            depth_rows,
            lateral_rows,
            coupled_rows,
            tensors,
            coupled_bounds,
            columns,
        } = further;
        let (terms_before, rows_before) =
            (self.terms.len(), self.depth_rows.len().max(self.coupled_rows.len()));
        let before = |curves: bool| if curves { rows_before / columns } else { terms_before };
        self.nodes.extend(nodes.into_iter().map(|node| {
            let start = node.start + before(node.count == CURVES) as u32;
            NodeGradients { start, ..node }
        }));
        self.terms.extend(terms);
        self.depth_rows.extend(depth_rows);
        self.lateral_rows.extend(lateral_rows);
        self.coupled_rows.extend(coupled_rows);
        self.tensors.extend(tensors);
        self.coupled_bounds.extend(coupled_bounds);
    }

    /// One more node, with these sums.
    fn add(
        &mut self,
        model: &ContactModel,
        curves: &[Response],
        node: &Node,
        sums: &NodeSums,
        hulls: &mut HullCache,
    ) {
        let ContactModel { lateral_tensors: tensors, responses, potentials, .. } = model;
        let NodeSums { terms, frame_gradient, change, .. } = sums;
        let (reference, single) = (node.test_points[0], |g: &DVec3| g.as_vec3().to_array());
        let norm = |of: &[DVec3]| (of.iter().map(|g| g.length_squared()).sum::<f64>()).sqrt();
        // None with the decoupled law.
        let columns = if model.is_coupled() { self.columns } else { 0 };
        let coupled: Vec<_> = coupled_terms(terms, reference, columns, potentials).collect();
        let (start, count) = if terms.len() <= MAX_TERMS {
            let start = self.terms.len() as u32;
            self.terms.extend(terms.iter().map(|(t, g)| Term { gradient: single(g), test_point: *t }));
            (start, terms.len() as u32)
        } else {
            let rows_before = self.depth_rows.len().max(self.coupled_rows.len());
            if model.is_coupled() {
                let single = |sum: DVec3| sum.as_vec3().extend(0.0);
                self.coupled_rows.extend(coupled.iter().map(|rows| rows.map(|q| q.map(single))));
            } else {
                let lateral_knots = responses.lateral_knots().values().len();
                self.depth_rows
                    .extend(rows(terms, reference, self.columns, |t, i| responses.depth_row(t, i)));
                self.lateral_rows
                    .extend(rows(terms, reference, lateral_knots, |t, i| responses.lateral_row(t, i)));
            }
            ((rows_before / self.columns) as u32, CURVES)
        };
        self.nodes.push(NodeGradients {
            frame: frame_gradient.map(|g| g.as_vec3().extend(0.0)),
            start,
            count,
            energy_bound: above(
                hulls.steepest(terms, node, curves).unwrap_or_else(|| steepest(terms, node, curves)),
            ),
            frame_bound: above(norm(frame_gradient)),
        });
        let knots = responses.depth_knots().values();
        let width = |i: usize| knots.get(i + 1).map(|next| next - knots[i]);
        let bounds = coupled.iter().enumerate().map(|(i, rows)| CoupledBound::new(rows, width(i)));
        self.coupled_bounds.extend(bounds);
        if !tensors.is_empty() {
            // Six components stand for nine: those off the diagonal count twice.
            let bound = above(norm(change).hypot(norm(&change[3..])));
            let change = change.map(|g| single(&g));
            self.tensors.push(TensorGradient { axes: [0, 1, 2].map(|axis| change.map(|g| g[axis])), bound });
        }
    }

    /// The test points that a node's terms name.
    pub(crate) fn term_points(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        self.terms(node).map(|(t, _)| t).filter(|&t| t != NOTHING)
    }

    /// Becomes a copy of these nodes' gradients of `from`, with test points numbered by `renumber`.
    pub(crate) fn copy(
        &mut self,
        from: &Gradients,
        nodes: &[u32],
        responses: &Responses,
        renumber: impl Fn(u32) -> u32,
    ) {
        let Gradients {
            nodes: to,
            terms,
            depth_rows,
            lateral_rows,
            coupled_rows,
            tensors,
            coupled_bounds,
            columns,
        } = self;
        to.clear();
        terms.clear();
        depth_rows.clear();
        lateral_rows.clear();
        coupled_rows.clear();
        tensors.clear();
        coupled_bounds.clear();
        *columns = from.columns;
        let [depth, lateral] = [responses.depth_knots(), responses.lateral_knots()].map(|k| k.values().len());
        for n in nodes.iter().map(|&n| n as usize) {
            let node = from.nodes[n];
            let (at, count) = (node.start as usize, node.count);
            let start = if count == CURVES {
                let rows_before = depth_rows.len().max(coupled_rows.len());
                if from.coupled_rows.is_empty() {
                    depth_rows.extend_from_slice(&from.depth_rows[at * depth..][..depth]);
                    lateral_rows.extend_from_slice(&from.lateral_rows[at * lateral..][..lateral]);
                } else {
                    coupled_rows.extend_from_slice(&from.coupled_rows[at * depth..][..depth]);
                }
                rows_before / depth
            } else {
                let terms_before = terms.len();
                let named = from.terms[at..][..count as usize].iter();
                terms.extend(named.map(|t| Term { test_point: renumber(t.test_point), ..*t }));
                terms_before
            };
            to.push(NodeGradients { start: start as u32, ..node });
            tensors.extend(from.tensors.get(n));
            if !from.coupled_bounds.is_empty() {
                coupled_bounds.extend_from_slice(&from.coupled_bounds[n * depth..][..depth]);
            }
        }
    }

    /// How large the energy gradient of a node can be in an interval of the depth, with a coupled law.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn coupled_bound(&self, node: u32, interval: usize) -> CoupledBound {
        self.coupled_bounds.get(node as usize * self.columns + interval).copied().unwrap_or_default()
    }

    /// How large those of a node can be.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn bound(&self, node: u32) -> GradientBound {
        let (node, tensor) = (self.node(node), self.tensors.get(node as usize));
        GradientBound {
            energy: node.energy_bound,
            frame_gradient: node.frame_bound,
            tensor: tensor.map_or(0.0, |t| t.bound),
        }
    }

    #[inline(always)]
    fn node(&self, node: u32) -> &NodeGradients {
        self.nodes.get(node as usize).unwrap_or(&NodeGradients::NONE)
    }

    /// ∇̄W of a node whose first test point is `reference`, N.
    ///
    /// # Real-time
    /// Two look-ups, or three terms; no allocation, never panics: zero for a node that does not exist.
    #[inline(always)]
    pub fn energy(&self, node: u32, reference: u32, energies: &impl PointEnergies) -> Vec3A {
        let &NodeGradients { start, count, .. } = self.node(node);
        let start = start as usize;
        if count == CURVES {
            return energies.gradient(self, start, reference);
        }
        let mut sum = Vec3A::ZERO;
        if count > 0 {
            let base = energies.energy(reference);
            for term in self.terms.get(start..start + count as usize).unwrap_or(&[]) {
                let difference = energies.energy(term.test_point) - base;
                sum += Vec3A::from_array(term.gradient) * difference as f32;
            }
        }
        sum
    }

    /// ∇̄(u·b) of a node, 1/m times b: how its frame turns towards `b` along the surface.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline(always)]
    pub fn frame_gradient(&self, node: u32, b: Vec3A) -> Vec3A {
        let [x, y, z] = &self.node(node).frame;
        Vec3A::from_vec4(*x * b.x + *y * b.y + *z * b.z)
    }

    /// ∇̄(d·A d) of a node: how its tensor changes along the surface, seen by `d`.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn tensor(&self, node: u32, d: DVec3) -> Vec3A {
        let Some(changes) = self.tensors.get(node as usize) else { return Vec3A::ZERO };
        let square = |[xx, yy, zz, xy, xz, yz]: [f32; 6]| {
            f64::from(xx) * d.x * d.x
                + f64::from(yy) * d.y * d.y
                + f64::from(zz) * d.z * d.z
                + 2.0 * (f64::from(xy) * d.x * d.y + f64::from(xz) * d.x * d.z + f64::from(yz) * d.y * d.z)
        };
        DVec3::from_array(changes.axes.map(square)).as_vec3a()
    }

    /// ∇̄W of a node in one interval of the depths, and in one of the lateral deflections, as [`Gradients::energy`] reads it:
    /// powers of the distance from the interval's knot, N. For bounds; not for the step.
    pub fn coefficients(
        &self,
        node: u32,
        reference: u32,
        responses: &Responses,
        interval: usize,
    ) -> [Coefficients; 2] {
        let &NodeGradients { start, count, .. } = self.node(node);
        let start = start as usize;
        let (depths, laterals) =
            (responses.depth_knots().values().len(), responses.lateral_knots().values().len());
        let sums: [[DVec3; POWERS]; 2] = if count == CURVES {
            let of = |rows: &[Row], knots: usize| {
                let row = rows.get(start * knots + interval).filter(|_| interval < knots);
                row.map_or([DVec3::ZERO; POWERS], |row| row.map(|v| v.truncate().as_dvec3()))
            };
            [of(&self.depth_rows, depths), of(&self.lateral_rows, laterals)]
        } else {
            let mut sums = [[DVec3::ZERO; POWERS]; 2];
            for term in self.terms.get(start..start + count as usize).unwrap_or(&[]) {
                let g = DVec3::from_array(term.gradient.map(f64::from));
                let mut add = |which: usize, row: &dyn Fn(u32) -> [f64; POWERS]| {
                    let pairs = row(term.test_point).into_iter().zip(row(reference));
                    sums[which].iter_mut().zip(pairs).for_each(|(sum, (a, b))| *sum += g * (a - b));
                };
                if interval < depths {
                    add(0, &|t| responses.depth_row(t, interval));
                }
                if interval < laterals {
                    add(1, &|t| responses.lateral_row(t, interval));
                }
            }
            sums
        };
        sums.map(|[a, b, c, d, e]| [a, b, c * 0.5, d * (1.0 / 3.0), e * 0.25])
    }

    /// What ∇̄W of a node sums: of each test point t but the node's first, the gradient g (1/m) that W_t −
    /// W_first is taken times. None where a node has its sum beforehand ([`Gradients::coupled_rows`]). For
    /// bounds; not for the step.
    pub fn terms(&self, node: u32) -> impl Iterator<Item = (u32, DVec3)> + '_ {
        let NodeGradients { start, count, .. } =
            self.nodes.get(node as usize).copied().unwrap_or(NodeGradients::NONE);
        let count = if count == CURVES { 0 } else { count as usize };
        let terms = self.terms.get(start as usize..start as usize + count).unwrap_or(&[]);
        terms.iter().map(|term| (term.test_point, DVec3::from_array(term.gradient.map(f64::from))))
    }

    /// ∇̄W of a node of a coupled body that has its sum beforehand: of each of the body's axes the quantities
    /// in an interval of the depth, to be taken times the monomials of δ_t in the tangents of the node's
    /// first test point. For bounds; not for the step.
    pub fn coupled_rows(&self, node: u32, interval: usize) -> Option<[CoupledRow; 3]> {
        let node = self.nodes.get(node as usize).filter(|node| node.count == CURVES)?;
        let rows = self.coupled_rows.get(node.start as usize * self.columns + interval)?;
        let axis = |axis: usize| {
            rows.map(|power| {
                let mut row = [0.0; QUANTITIES];
                row.iter_mut().zip(power).for_each(|(to, g)| *to = f64::from(g.to_array()[axis]));
                row
            })
        };
        Some([axis(0), axis(1), axis(2)])
    }

    /// ∇̄A of a node, its derivatives along x, y and z, 1/m; none where the lateral response is alike in all directions.
    pub fn tensor_changes(&self, node: u32) -> Option<[Tensor; 3]> {
        self.tensors.get(node as usize).map(|changes| changes.axes.map(|a| a.map(f64::from)))
    }

    /// Bytes that a step may read.
    pub(crate) fn memory(&self) -> [&[u8]; 7] {
        [
            bytemuck::cast_slice(&self.nodes),
            bytemuck::cast_slice(&self.terms),
            bytemuck::cast_slice(&self.depth_rows),
            bytemuck::cast_slice(&self.lateral_rows),
            bytemuck::cast_slice(&self.coupled_rows),
            bytemuck::cast_slice(&self.coupled_bounds),
            bytemuck::cast_slice(&self.tensors),
        ]
    }
}

#[inline(always)]
fn value([a, b, c, d, e]: &Row, [p, q, r, s, t]: &[f32; POWERS]) -> Vec4 {
    *a * *p + *b * *q + (*c * *r + *d * *s) + *e * *t
}

/// The most that |Σ g (f_t − f_ref)| can be over the node's own f, of normal and lateral curves alike, the slopes past the
/// end included. What holds of the forces holds of their integrals.
fn steepest(terms: &[(u32, DVec3)], node: &Node, curves: &[Response]) -> f64 {
    // A test point that answers nothing.
    const ZEROS: &[[f64; 4]] = &[];
    if terms.is_empty() {
        return 0.0;
    }
    let curve_kinds: [fn(&Response) -> &Curve; 2] = [|r| &r.normal, |r| &r.lateral];
    let mut most = 0.0f64;
    for kind in curve_kinds {
        let of = |t: u32| curves.get(t as usize).map_or(ZEROS, |r| kind(r).ordinates());
        let reference = of(node.test_points[0]);
        let own = node.test_points.map(of);
        let intervals = reference.len();
        // Past the end it is the slope that counts.
        let row = |ordinates: &[[f64; 4]], i: usize| match ordinates.get(i) {
            Some(row) => *row,
            None => ordinates.last().map_or([0.0; 4], |[.., c, d]| [d - c, 0.0, 0.0, 0.0]),
        };
        for i in 0..=intervals {
            let base = row(reference, i);
            let mut force = [0.0; 4];
            for (ordinates, w) in own.into_iter().zip(node.weights) {
                let b = row(ordinates, i);
                (0..4).for_each(|k| force[k] += w * b[k]);
            }
            let mut slope = [DVec3::ZERO; 4];
            for (t, g) in terms {
                let b = row(of(*t), i);
                (0..4).for_each(|k| slope[k] += *g * (b[k] - base[k]));
            }
            most = most.max(quotient(slope, force, SPLITS));
        }
    }
    most
}

/// Where three test points' forces can bound a gradient: ordinates of all three, and the slopes past the end. In the shares
/// (a, b, c) that they have in their sum, |g_b (b − a) + g_c (c − a)| / (w_a a + w_b b + w_c c) has convex level sets, so that
/// those on the convex hull are enough, and they are few.
#[derive(Debug, Default)]
struct HullCache {
    last: Option<([u32; 3], usize)>,
    known: HashMap<[u32; 3], usize>,
    hulls: Vec<Option<Vec<[f64; 3]>>>,
}

impl HullCache {
    /// [`steepest`], in a fraction of the time. None where it has to look at more.
    fn steepest(&mut self, terms: &[(u32, DVec3)], node: &Node, curves: &[Response]) -> Option<f64> {
        let points = node.test_points;
        let [_, second, third] = points;
        let [mut g2, mut g3] = [DVec3::ZERO; 2];
        for (t, g) in terms {
            match *t {
                t if t == second => g2 = *g,
                t if t == third => g3 = *g,
                _ => return None,
            }
        }
        // Mostly those of the last node.
        let at = match self.last {
            Some((last, at)) if last == points => at,
            _ => *self.known.entry(points).or_insert_with(|| {
                self.hulls.push(hull(points, curves));
                self.hulls.len() - 1
            }),
        };
        self.last = Some((points, at));
        let both = |[a, b, c]: &[f64; 3]| {
            let slope = g2 * (b - a) + g3 * (c - a);
            (slope, node.weights[0] * a + node.weights[1] * b + node.weights[2] * c)
        };
        // Compared by squares, without a root or a quotient.
        let (mut most, mut square, mut below) = (&[0.0; 3], 0.0, 1.0);
        for point in self.hulls[at].as_ref()? {
            let (slope, force) = both(point);
            if slope.length_squared() * below > square * (force * force) {
                (most, square, below) = (point, slope.length_squared(), force * force);
            }
        }
        let (slope, force) = both(most);
        Some(if square == 0.0 { 0.0 } else { slope.length() / force })
    }
}

/// None where an ordinate is below 0, or a test point answers nothing.
fn hull(points: [u32; 3], curves: &[Response]) -> Option<Vec<[f64; 3]>> {
    let [a, b, c] = points.map(|t| curves.get(t as usize));
    let responses = [a?, b?, c?];
    let curve_kinds: [fn(&Response) -> &Curve; 2] = [|r| &r.normal, |r| &r.lateral];
    let mut all: Vec<([f64; 2], [f64; 3])> = Vec::new();
    for kind in curve_kinds {
        let ordinates = responses.map(|r| kind(r).ordinates());
        let past = ordinates.map(|o| o.last().map_or(0.0, |[.., c, d]| d - c));
        let rows = (0..ordinates[0].len()).map(|i| ordinates.map(|o| o.get(i).copied().unwrap_or([0.0; 4])));
        for [a, b, c] in rows.chain([past.map(|slope| [slope, 0.0, 0.0, 0.0])]) {
            let forces = [0, 1, 2, 3].map(|k| [a[k], b[k], c[k]]);
            let sums = forces.map(|f| f.iter().sum::<f64>());
            let rounding = sums.iter().fold(0.0f64, |m, s| m.max(*s)) * 1e-14;
            for (force, sum) in forces.into_iter().zip(sums) {
                if force.iter().any(|f| *f < 0.0) {
                    return None;
                }
                if sum > rounding {
                    all.push(([force[1] / sum, force[2] / sum], force));
                }
            }
        }
    }
    all.sort_by(|(p, _), (q, _)| p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])));
    let near = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).abs().max((p[1] - q[1]).abs()) < 1e-12;
    all.dedup_by(|(p, _), (q, _)| near(*p, *q));
    // Andrew's monotone chain: the lower half, then the upper one; what is nearly on it stays.
    let half = |points: &mut dyn Iterator<Item = &([f64; 2], [f64; 3])>| {
        let mut chain: Vec<([f64; 2], [f64; 3])> = Vec::new();
        for &(p, force) in points {
            while let [.., (o, _), (q, _)] = chain[..]
                && (q[0] - o[0]) * (p[1] - o[1]) - (q[1] - o[1]) * (p[0] - o[0]) < -1e-15
            {
                chain.pop();
            }
            chain.push((p, force));
        }
        chain
    };
    let chains = half(&mut all.iter()).into_iter().chain(half(&mut all.iter().rev()));
    Some(chains.map(|(_, force)| force).collect())
}

/// How often an interval is halved whose force has ordinates below 0, though it is nowhere below 0 itself.
const SPLITS: u32 = 12;

/// The most that |slope| can be over force on an interval, by their Bernstein ordinates: where |slope_k| ≤ m force_k for
/// all k, |slope| ≤ m force. Ordinates below 0 bound nothing, however large: halves have ordinates nearer to the curve.
/// Infinite where no halving helps.
fn quotient(slope: [DVec3; 4], force: [f64; 4], splits: u32) -> f64 {
    // Up to rounding of the interval's largest ordinates.
    let scale = |of: [f64; 4]| of.iter().fold(0.0f64, |m, x| m.max(x.abs())) * 1e-14;
    let (sizes, flat) = (slope.map(DVec3::length), scale(force));
    let steep = scale(sizes);
    let of = |k: usize| match (sizes[k], force[k]) {
        (s, f) if s <= steep && f >= -flat => 0.0,
        (s, f) if f > 0.0 => s / f,
        _ => f64::INFINITY,
    };
    let most = (0..4).map(of).fold(0.0, f64::max);
    if most < f64::INFINITY || splits == 0 || force.iter().all(|f| *f >= 0.0) {
        return most;
    }
    let ([a, b], [c, d]) = (halves(slope), halves(force));
    quotient(a, c, splits - 1).max(quotient(b, d, splits - 1))
}

/// De Casteljau's: the ordinates of the two halves.
fn halves<T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f64, Output = T>>(
    [a, b, c, d]: [T; 4],
) -> [[T; 4]; 2] {
    let middle = |x: T, y: T| (x + y) * 0.5;
    let (p, q, r) = (middle(a, b), middle(b, c), middle(c, d));
    let (s, t) = (middle(p, q), middle(q, r));
    let m = middle(s, t);
    [[a, p, s, m], [m, t, r, d]]
}

/// Σ g (row − row of the reference), in each interval.
fn rows(
    terms: &[(u32, DVec3)],
    reference: u32,
    intervals: usize,
    row: impl Fn(u32, usize) -> [f64; POWERS],
) -> impl Iterator<Item = Row> {
    (0..intervals).map(move |interval| {
        let (base, mut sum) = (row(reference, interval), [DVec3::ZERO; POWERS]);
        for (t, g) in terms {
            let differences = row(*t, interval).into_iter().zip(base);
            sum.iter_mut().zip(differences).for_each(|(sum, (value, base))| *sum += *g * (value - base));
        }
        sum.map(|sum| sum.as_vec3().extend(0.0))
    })
}

/// Area-weighted means over the elements around a node, of the gradients of what its neighbours have.
#[derive(Debug, Default)]
struct NodeSums {
    /// Σ ∇n of each corner of these elements times its area.
    slopes: Vec<(u32, [f64; 4])>,
    /// Those of the test points that the corners blend.
    blended: Vec<(u32, [f64; 4])>,
    /// g_lt of each test point but the node's first, 1/m.
    terms: Vec<(u32, DVec3)>,
    /// Of the three coordinates of the frame, 1/m.
    frame_gradient: [DVec3; 3],
    /// Of the six components of the tensor, 1/m.
    change: [DVec3; 6],
}

impl NodeSums {
    /// Of node `l`, in these elements.
    fn of_node(&mut self, model: &ContactModel, around: &[u32], l: usize) {
        let NodeSums { slopes, .. } = self;
        slopes.clear();
        let mut frame_gradient = [[0.0; 4]; 3];
        let (node, mut area) = (&model.nodes[l], 0.0);
        for &m in around {
            let corners = model.elements[m as usize].nodes;
            let [a, b, c] = corners.map(|n| model.nodes[n as usize].position);
            let normal = (b - a).cross(c - a);
            area += normal.length();
            // Turned into the tangent plane of the node without losing length, as the least turn takes the element's
            // inward normal N to u: v − (u·v)(N + u)/(1 + N·u).
            let normal = normal.normalize_or_zero();
            let (u, between) = (node.inward, node.inward - normal);
            let per = 2.0 / between.length_squared().max(0.1);
            let turned = |v: DVec3| v - between * (u.dot(v) * per);
            // 2A ∇n of each corner: its opposite edge, turned inwards. The three sum to 0.
            let [second, third] = [a - c, b - a].map(|edge| turned(normal.cross(edge)));
            for (j, DVec3 { x, y, z }) in corners.into_iter().zip([-(second + third), second, third]) {
                let slope = [x, y, z, 0.0];
                add(sum_of(slopes, j), slope, 1.0);
                if j as usize != l {
                    // Frames turn within the element's plane, and are turned into the node's like the gradient.
                    let du = model.nodes[j as usize].inward - u;
                    let du = turned(du - normal * normal.dot(du));
                    frame_gradient.iter_mut().zip(du.to_array()).for_each(|(sum, du)| add(sum, slope, du));
                }
            }
        }
        // A node that no element uses has no gradient.
        let per = if area > 0.0 { 1.0 / area } else { 0.0 };
        self.frame_gradient = frame_gradient.map(|sum| vector(sum) * per);
        self.blend(model, l, per);
    }

    /// What the corners' slopes make of what they blend, and of their tensors.
    fn blend(&mut self, model: &ContactModel, l: usize, per: f64) {
        let NodeSums { slopes, blended, terms, change, .. } = self;
        let reference = model.nodes[l].test_points[0];
        blended.clear();
        *change = Default::default();
        for &(j, slope) in &*slopes {
            let corner = &model.nodes[j as usize];
            // What it lacks to 1.
            let rest = 1.0 - corner.weights.iter().sum::<f64>();
            let rest = if rest > 1e-9 { rest } else { 0.0 };
            let parts = corner.test_points.into_iter().zip(corner.weights);
            for (t, w) in parts.chain([(NOTHING, rest)]) {
                if w != 0.0 && t != reference {
                    add(sum_of(blended, t), slope, w);
                }
            }
            let tensors = &model.lateral_tensors;
            if let (Some(there), Some(here)) = (tensors.get(j as usize), tensors.get(l)) {
                let changes = change.iter_mut().zip(there.iter().zip(here));
                changes.for_each(|(g, (there, here))| *g += vector(slope) * (there - here));
            }
        }
        terms.clear();
        let means = blended.iter().map(|(t, sum)| (*t, vector(*sum) * per));
        terms.extend(means.filter(|(_, g)| g.as_vec3() != glam::Vec3::ZERO));
        *change = change.map(|g| g * per);
    }
}

/// The sum of a number, begun if it has none.
#[inline(always)]
fn sum_of(sums: &mut Vec<(u32, [f64; 4])>, number: u32) -> &mut [f64; 4] {
    let at = sums.iter().position(|(known, _)| *known == number).unwrap_or_else(|| {
        sums.push((number, [0.0; 4]));
        sums.len() - 1
    });
    &mut sums[at].1
}

fn vector([x, y, z, _]: [f64; 4]) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A vector times a number to a sum, with a fourth place: stored in two parts, as it is loaded again.
#[inline(always)]
fn add(sum: &mut [f64; 4], vector: [f64; 4], times: f64) {
    sum.iter_mut().zip(vector).for_each(|(sum, x)| *sum += x * times);
}

/// Σ g (potential − that of the reference) in the reference's tangents, in each interval.
///
/// A test point sees δ_t in its own tangents, which are turned a little against the reference's: what is lost by looking at it
/// in these is of the second order in the angle between their normals.
fn coupled_terms(
    terms: &[(u32, DVec3)],
    reference: u32,
    intervals: usize,
    potentials: &Potentials,
) -> impl Iterator<Item = [[DVec3; TERMS]; 4]> {
    (0..intervals).map(move |interval| {
        let base = potentials.at(reference, interval);
        let mut sum = [[DVec3::ZERO; TERMS]; 4];
        for (t, g) in terms {
            let seen: CoupledRow = potentials.at(*t, interval).seen_from(base.tangents);
            for (sum, (seen, base)) in sum.iter_mut().zip(seen.iter().zip(base.row)) {
                sum.iter_mut()
                    .zip(seen.iter().zip(base))
                    .for_each(|(sum, (seen, base))| *sum += *g * (seen - base));
            }
        }
        sum
    })
}

/// The elements that use each node.
struct Around {
    starts: Vec<u32>,
    elements: Vec<u32>,
}

impl Around {
    fn new(nodes: usize, elements: &[Element]) -> Self {
        let mut starts = vec![0u32; nodes + 1];
        elements.iter().flat_map(|e| e.nodes).for_each(|n| starts[n as usize + 1] += 1);
        for n in 0..nodes {
            starts[n + 1] += starts[n];
        }
        let mut next = starts.clone();
        let mut list = vec![0u32; elements.len() * 3];
        for (m, element) in elements.iter().enumerate() {
            for n in element.nodes {
                list[next[n as usize] as usize] = m as u32;
                next[n as usize] += 1;
            }
        }
        Around { starts, elements: list }
    }

    fn of(&self, node: usize) -> &[u32] {
        &self.elements[self.starts[node] as usize..self.starts[node + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::BlendWeights;
    use crate::curve::{Extension, Interpolation};

    /// Opening 5 million triangles took 20 s, 18 of them in the bounds of the gradients.
    #[test]
    fn the_hull_of_three_test_points_bounds_as_all_their_intervals_do() {
        let mut seed = 5u64;
        let mut chance = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        let knots: Vec<f64> = (0..9).map(|i| f64::from(i) * 1e-3).collect();
        for case in 0..200 {
            let mut curve = |power: i32| {
                let mut force = 0.0;
                let values = knots.iter().map(|d| {
                    force += 1e3 * d.powi(power) * (0.2 + chance());
                    force
                });
                let values: Vec<f64> = values.collect();
                Curve::through(&knots, &values, Interpolation::Pchip, Extension::Linear).unwrap()
            };
            let curves: Vec<Response> = (0..3)
                .map(|_| Response { normal: curve(1 + case % 2), lateral: curve(1), friction: curve(1) })
                .collect();
            let mut vector = || DVec3::new(chance(), chance(), chance()) - 0.5;
            let terms = [(1, vector()), (2, vector())];
            let [a, b] = [chance(), chance()].map(|x| x / 2.0);
            let blend = BlendWeights { test_points: [0, 1, 2], weights: [1.0 - a - b, a, b] };
            let node = Node::new(DVec3::ZERO, DVec3::Z, &blend);
            let fast = HullCache::default().steepest(&terms, &node, &curves);
            assert!(hull([0, 1, 2], &curves).unwrap().len() < 32, "few of 66 are on it");
            let slow = steepest(&terms, &node, &curves);
            assert!((fast.unwrap() / slow - 1.0).abs() < 1e-12, "{fast:?} {slow}");
        }
        let elsewhere = [(7, DVec3::X)];
        let node = Node::new(DVec3::ZERO, DVec3::Z, &BlendWeights::own(0));
        assert_eq!(HullCache::default().steepest(&elsewhere, &node, &[]), None);
    }
}
