//! How energy, frames and tensors change along the surface, at the nodes: what the slip rule `consistent` reads
//! (MODEL 4, E3).
//!
//! Within an element a mix Σ n_j X_j has the gradient Σ X_j ∇n_j, another one in each element. Its area-weighted mean over
//! the elements around node l, ∇̄X_l, mixed like everything else as Σ n_l ∇̄X_l, is continuous over the edges. At a crease
//! the mean is over the elements that share the node, so that a sharp edge stays one.
//!
//! Energies are mixed of test points' curves: ∇̄W_l = Σ_t g_lt W_t. The coefficients g sum to zero, so that one test
//! point, the reference, needs none: ∇̄W_l = Σ_t g_lt (W_t − W_ref), and nothing is left of rounding on a uniform body.
//! On a mesh that is finer than its test points they are two vectors a node. A node with more than three of them, as
//! where every node is its own test point, has the sum as curves of its own: it takes a fifth of the time, and about as
//! much memory as the test point's responses.

use crate::body::Node;
use crate::response::{Known, POWERS, Responses, Strain};
use crate::surface::Element;
use crate::tensor::Tensor;
use glam::DVec3;

/// A test point that answers nothing: what a mix lacks to 1 where it fades towards a border.
const NOTHING: u32 = u32::MAX;

/// One test point's part of a node's energy gradient.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Term {
    /// g_lt, 1/m. Single precision: it moves a force by 10⁻⁷ of itself, and halves what a step reads.
    gradient: [f32; 3],
    test_point: u32,
}

/// Terms that a node has at most; with more it has curves.
const MAX_TERMS: usize = 3;

/// A node's energy gradient in one interval: the coefficients of [`Strain`]'s powers. One line of the cache.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Row {
    /// Along x and y.
    xy: [[f32; 2]; POWERS],
    /// Along z; the last is no power's.
    z: [f32; POWERS + 1],
}

/// Where a node's energy gradient is.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Place {
    /// The first of its terms, or which of the curves it has.
    start: u32,
    /// How many terms, or [`CURVES`].
    count: u32,
}

const CURVES: u32 = u32::MAX;

/// The nodal gradients of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradients {
    /// (nodes)
    places: Vec<Place>,
    terms: Vec<Term>,
    /// (nodes with curves × depth knots), and the same of the lateral curves.
    depth_rows: Vec<Row>,
    lateral_rows: Vec<Row>,
    /// ∇̄u_l: (nodes × 3 coordinates of u), each a gradient, 1/m.
    turns: Vec<[[f32; 3]; 3]>,
    /// ∇̄A_l: (nodes × 3 directions), 1/m; none where the lateral response is alike in all directions.
    tensors: Vec<[[f32; 6]; 3]>,
}

impl Gradients {
    /// Of the nodes of a checked body; `tensors` are none or one for each node.
    pub(crate) fn new(
        nodes: &[Node],
        elements: &[Element],
        tensors: &[Tensor],
        responses: &Responses,
    ) -> Self {
        let around = Around::new(nodes.len(), elements);
        let mut gradients = Gradients {
            places: Vec::with_capacity(nodes.len()),
            terms: Vec::new(),
            depth_rows: Vec::new(),
            lateral_rows: Vec::new(),
            turns: Vec::with_capacity(nodes.len()),
            tensors: Vec::with_capacity(tensors.len()),
        };
        let [depth_knots, lateral_knots] =
            [responses.depth_knots(), responses.lateral_knots()].map(|k| k.values().len());
        let mut sum: Vec<(u32, DVec3)> = Vec::new();
        for (l, node) in nodes.iter().enumerate() {
            sum.clear();
            let (mut area, mut turn, mut change) = (0.0, [DVec3::ZERO; 3], [DVec3::ZERO; 6]);
            for &m in around.of(l) {
                let corners = elements[m as usize].nodes.map(|n| n as usize);
                let [a, b, c] = corners.map(|n| nodes[n].position);
                let normal = (b - a).cross(c - a);
                area += normal.length();
                // Turned into the tangent plane of the node without losing length, as the least turn takes the element's
                // inward normal N to u: v − (u·v)(N + u)/(1 + N·u).
                let normal = normal.normalize_or_zero();
                let (u, between) = (node.inward, node.inward - normal);
                let per = 2.0 / between.length_squared().max(0.1);
                // 2A ∇n of each corner: its opposite edge, turned inwards.
                for (j, edge) in corners.into_iter().zip([c - b, a - c, b - a]) {
                    let slope = normal.cross(edge);
                    let slope = slope - between * (u.dot(slope) * per);
                    let mix = &nodes[j];
                    let rest = 1.0 - mix.weights.iter().sum::<f64>();
                    let parts = mix.test_points.into_iter().zip(mix.weights);
                    for (t, w) in parts.chain([(NOTHING, if rest > 1e-9 { rest } else { 0.0 })]) {
                        if w == 0.0 || t == node.test_points[0] {
                            continue;
                        }
                        match sum.iter_mut().find(|(known, _)| *known == t) {
                            Some((_, g)) => *g += slope * w,
                            None => sum.push((t, slope * w)),
                        }
                    }
                    // Frames turn within the element's plane, and are turned into the node's like the gradient.
                    let du = mix.inward - u;
                    let du = du - normal * normal.dot(du);
                    let du = du - between * (u.dot(du) * per);
                    turn.iter_mut().zip(du.to_array()).for_each(|(g, du)| *g += slope * du);
                    if let (Some(there), Some(here)) = (tensors.get(j), tensors.get(l)) {
                        let pairs = there.iter().zip(here);
                        change
                            .iter_mut()
                            .zip(pairs)
                            .for_each(|(g, (there, here))| *g += slope * (there - here));
                    }
                }
            }
            // A node that no element uses has no gradient.
            let per = if area > 0.0 { 1.0 / area } else { 0.0 };
            let single = |g: &DVec3| (*g * per).as_vec3().to_array();
            sum.retain(|(_, g)| single(g) != [0.0; 3]);
            if sum.len() > MAX_TERMS {
                sum.iter_mut().for_each(|(_, g)| *g *= per);
                let reference = node.test_points[0];
                let start = (gradients.depth_rows.len() / depth_knots) as u32;
                gradients.places.push(Place { start, count: CURVES });
                let depth = rows(&sum, reference, depth_knots, |t, i| responses.depth_row(t, i));
                gradients.depth_rows.extend(depth);
                let lateral = rows(&sum, reference, lateral_knots, |t, i| responses.lateral_row(t, i));
                gradients.lateral_rows.extend(lateral);
            } else {
                gradients.places.push(Place { start: gradients.terms.len() as u32, count: sum.len() as u32 });
                gradients.terms.extend(sum.iter().map(|(t, g)| Term { gradient: single(g), test_point: *t }));
            }
            gradients.turns.push([0, 1, 2].map(|i| single(&turn[i])));
            if !tensors.is_empty() {
                let change = change.map(|g| single(&g));
                gradients.tensors.push([0, 1, 2].map(|axis| change.map(|g| g[axis])));
            }
        }
        gradients
    }

    /// ∇̄W of a node whose first test point is `reference`, N. `known` are energies that were found before.
    ///
    /// # Real-time
    /// Two look-ups, or three terms; no allocation, never panics: zero for a node that does not exist.
    #[inline]
    pub fn energy(&self, node: u32, reference: u32, strain: &Strain, known: &Known) -> DVec3 {
        let Some(&Place { start, count }) = self.places.get(node as usize) else { return DVec3::ZERO };
        let start = start as usize;
        if count == CURVES {
            let (i, j) = strain.rows(start);
            return match (self.depth_rows.get(i), self.lateral_rows.get(j)) {
                (Some(depth), Some(lateral)) => {
                    depth.value(&strain.depth_powers) + lateral.value(&strain.lateral_powers)
                }
                _ => DVec3::ZERO,
            };
        }
        let mut sum = DVec3::ZERO;
        if count > 0 {
            let base = known.energy(strain, reference);
            for term in self.terms.get(start..start + count as usize).unwrap_or(&[]) {
                sum += double(&term.gradient) * (known.energy(strain, term.test_point) - base);
            }
        }
        sum
    }

    /// ∇̄(u·b) of a node, 1/m times b: how its frame turns towards `b` along the surface.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn turn(&self, node: u32, b: DVec3) -> DVec3 {
        let [x, y, z] = self.turns.get(node as usize).unwrap_or(&[[0.0; 3]; 3]);
        double(x) * b.x + double(y) * b.y + double(z) * b.z
    }

    /// ∇̄(d·A d) of a node: how its tensor changes along the surface, seen by `d`.
    ///
    /// # Real-time
    /// O(1), never panics.
    #[inline]
    pub fn tensor(&self, node: u32, d: DVec3) -> DVec3 {
        let Some(changes) = self.tensors.get(node as usize) else { return DVec3::ZERO };
        let square = |[xx, yy, zz, xy, xz, yz]: [f32; 6]| {
            f64::from(xx) * d.x * d.x
                + f64::from(yy) * d.y * d.y
                + f64::from(zz) * d.z * d.z
                + 2.0 * (f64::from(xy) * d.x * d.y + f64::from(xz) * d.x * d.z + f64::from(yz) * d.y * d.z)
        };
        DVec3::from_array(changes.map(square))
    }

    /// Bytes that a step may read.
    pub(crate) fn memory(&self) -> [&[u8]; 6] {
        [
            bytemuck::cast_slice(&self.places),
            bytemuck::cast_slice(&self.terms),
            bytemuck::cast_slice(&self.depth_rows),
            bytemuck::cast_slice(&self.lateral_rows),
            bytemuck::cast_slice(&self.turns),
            bytemuck::cast_slice(&self.tensors),
        ]
    }
}

impl Row {
    #[inline(always)]
    fn value(&self, &[p, q, r, s, t]: &[f64; POWERS]) -> DVec3 {
        let [a, b, c, d, e] = self.xy.map(|xy| xy.map(f64::from));
        let [x, y] = [0, 1].map(|i: usize| a[i] * p + b[i] * q + (c[i] * r + d[i] * s) + e[i] * t);
        let [a, b, c, d, e, _] = self.z.map(f64::from);
        DVec3::new(x, y, a * p + b * q + (c * r + d * s) + e * t)
    }
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
        let mut row = Row { xy: [[0.0; 2]; POWERS], z: [0.0; POWERS + 1] };
        for (k, sum) in sum.iter().enumerate() {
            let [x, y, z] = sum.as_vec3().to_array();
            (row.xy[k], row.z[k]) = ([x, y], z);
        }
        row
    })
}

#[inline]
fn double([x, y, z]: &[f32; 3]) -> DVec3 {
    DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z))
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
