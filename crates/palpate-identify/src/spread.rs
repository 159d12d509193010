//! Which test points a node mixes: area interpolation from the mesh of test points (the paper's Fig. 7).
//!
//! That mesh is the dual of the test points' Voronoi cells on the surface: each vertex is labelled with the test
//! point that is nearest along the surface, and an element whose vertices have three labels joins these three. A node
//! is projected onto the dual triangles of its cell and of the cells around; where cells meet in pairs only (a strip,
//! a rod) or not at all, segments and single points take the triangles' place.

use crate::error::FitError;
use glam::DVec3;
use palpate_body::{NodeMix, Surface};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A mix for every node: a node that is a test point is its own, any other mixes up to three around it.
///
/// Weights are non-negative and sum to 1, test points ascend, and neighbouring nodes between the same three test
/// points name them alike. All nodes of a creased vertex have the same mix.
///
/// # Errors
/// No test point, one that is no node, two on one vertex, or a connected part of the surface without any.
pub fn spread(surface: &Surface, test_point_nodes: &[u32]) -> Result<Vec<NodeMix>, FitError> {
    let mixes = place(surface, test_point_nodes)?;
    surface
        .vertices()
        .iter()
        .enumerate()
        .map(|(n, &v)| {
            mixes[v as usize].ok_or_else(|| {
                let p = surface.positions()[n];
                FitError::invalid(
                    format!("node {n} at ({:.6}, {:.6}, {:.6}) m", p.x, p.y, p.z),
                    "no test point lies on its connected part of the surface",
                    "add a test point there, or remove that part of the mesh",
                )
            })
        })
        .collect()
}

/// A mix for every vertex; none where no test point can be reached along the surface.
pub(crate) fn place(surface: &Surface, test_point_nodes: &[u32]) -> Result<Vec<Option<NodeMix>>, FitError> {
    let vertices = surface.vertices();
    let count = vertices.iter().map(|&v| v as usize + 1).max().unwrap_or(0);
    let mut positions = vec![DVec3::ZERO; count];
    for (&v, &p) in vertices.iter().zip(surface.positions()) {
        positions[v as usize] = p;
    }
    let sources = sources(vertices, test_point_nodes)?;
    let labels = cells(surface, &positions, &sources);
    let dual = Dual::new(surface, &labels, sources.iter().map(|&v| positions[v as usize]).collect());

    let mut mixes = vec![None; count];
    for (t, &v) in sources.iter().enumerate() {
        mixes[v as usize] = Some(NodeMix::own(t as u32));
    }
    // Cell by cell, so that each cell's surroundings are gathered once.
    let labelled = labels.iter().enumerate().filter(|&(_, &t)| t != NONE).map(|(v, &t)| (t, v as u32));
    let members = Lists::new(sources.len(), labelled);
    let mut around = Vec::new();
    for t in 0..sources.len() as u32 {
        let cell = members.of(t);
        if cell.len() > 1 {
            dual.around(t, &mut around);
            for &v in cell.iter().filter(|&&v| v != sources[t as usize]) {
                mixes[v as usize] = Some(dual.mix(positions[v as usize], t, &around));
            }
        }
    }
    Ok(mixes)
}

/// No label: not reached.
const NONE: u32 = u32::MAX;

/// The vertex of each test point.
fn sources(vertices: &[u32], test_point_nodes: &[u32]) -> Result<Vec<u32>, FitError> {
    if test_point_nodes.is_empty() {
        return Err(FitError::invalid("test points", "there is none", "give at least one"));
    }
    let vertex = |(t, &n): (usize, &u32)| {
        vertices.get(n as usize).copied().ok_or_else(|| {
            let problem = format!("it sits on node {n}, but there are {}", vertices.len());
            FitError::invalid(format!("test point {t}"), problem, "choose a node of the surface")
        })
    };
    let sources: Vec<u32> = test_point_nodes.iter().enumerate().map(vertex).collect::<Result<_, _>>()?;
    let mut sorted: Vec<(u32, usize)> = sources.iter().enumerate().map(|(t, &v)| (v, t)).collect();
    sorted.sort_unstable();
    match sorted.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        None => Ok(sources),
        Some(pair) => {
            let problem = format!("it sits on the same vertex as test point {}", pair[0].1);
            Err(FitError::invalid(format!("test point {}", pair[1].1), problem, "remove one of the two"))
        }
    }
}

/// The nearest test point of each vertex along the surface, by Dijkstra's method from all at once, where a way may
/// also cross an element (Kimmel and Sethian 1998): on a plane distances are true ones. Ties go to the lower number.
fn cells(surface: &Surface, positions: &[DVec3], sources: &[u32]) -> Vec<u32> {
    let vertices = surface.vertices();
    // Around each vertex the other two of every element.
    let fans = surface.elements().iter().flat_map(|element| {
        let [a, b, c] = element.nodes.map(|n| vertices[n as usize]);
        [(a, [b, c]), (b, [c, a]), (c, [a, b])]
    });
    let fans = Lists::new(positions.len(), fans);
    let mut reached = vec![Reached { distance: f64::INFINITY, label: NONE, done: false }; positions.len()];
    let ways = surface.elements().iter().map(|e| {
        let [a, b] = [e.nodes[0], e.nodes[1]].map(|n| surface.positions()[n as usize]);
        a.distance(b)
    });
    let mut queue = Queue::new(ways.sum::<f64>() / surface.elements().len() as f64);
    for (t, &v) in sources.iter().enumerate() {
        reached[v as usize] = Reached { distance: 0.0, label: t as u32, done: false };
        queue.push(0.0, t as u32, v);
    }
    while let Some((from_v, label, v)) = queue.pop() {
        if std::mem::replace(&mut reached[v as usize].done, true) {
            continue;
        }
        for &[b, c] in fans.of(v) {
            for (next, third) in [(b, c), (c, b)] {
                let known = reached[next as usize];
                if known.done {
                    continue;
                }
                let [p, q, r] = [v, third, next].map(|v| positions[v as usize]);
                let mut distance = from_v + p.distance(r);
                let third = reached[third as usize];
                if third.done && third.label == label {
                    distance = distance.min(across([p, q], [from_v, third.distance], r));
                }
                if (distance, label) < (known.distance, known.label) {
                    reached[next as usize] = Reached { distance, label, done: false };
                    queue.push(distance, label, next);
                }
            }
        }
    }
    reached.into_iter().map(|r| r.label).collect()
}

/// How far a vertex is from its nearest test point, as far as is known.
#[derive(Clone, Copy)]
struct Reached {
    distance: f64,
    label: u32,
    done: bool,
}

/// Vertices by distance, then label: a heap of the nearest, which stays small, and buckets of those further out.
struct Queue {
    width: f64,
    nearest: BinaryHeap<Reverse<(u64, u32, u32)>>,
    /// Of the nearest; every earlier one is empty.
    bucket: usize,
    buckets: Vec<Vec<(u64, u32, u32)>>,
}

impl Queue {
    /// Buckets, so that a mesh with a few huge elements does not ask for too many: the last one has no end.
    const MOST: usize = 1 << 20;

    fn new(width: f64) -> Self {
        Queue { width, nearest: BinaryHeap::new(), bucket: 0, buckets: Vec::new() }
    }

    fn push(&mut self, distance: f64, label: u32, vertex: u32) {
        // Bits of non-negative numbers are ordered as the numbers are.
        let item = (distance.to_bits(), label, vertex);
        let bucket = ((distance / self.width) as usize).min(Self::MOST);
        if bucket <= self.bucket {
            self.nearest.push(Reverse(item));
            return;
        }
        if bucket >= self.buckets.len() {
            self.buckets.resize_with(bucket + 1, Vec::new);
        }
        self.buckets[bucket].push(item);
    }

    fn pop(&mut self) -> Option<(f64, u32, u32)> {
        while self.nearest.is_empty() && self.bucket + 1 < self.buckets.len() {
            self.bucket += 1;
            self.nearest.extend(std::mem::take(&mut self.buckets[self.bucket]).into_iter().map(Reverse));
        }
        let Reverse((bits, label, vertex)) = self.nearest.pop()?;
        Some((f64::from_bits(bits), label, vertex))
    }
}

/// The distance of `r` from a source that is at the given distances from the ends of `edge`, on a straight way across
/// that edge in the plane of the triangle; infinite if there is none.
fn across([p, q]: [DVec3; 2], [from_p, from_q]: [f64; 2], r: DVec3) -> f64 {
    let length = p.distance(q);
    // The source lies at (x, -y), r at (u, w), the edge along the first axis.
    let x = (from_p * from_p - from_q * from_q + length * length) / (2.0 * length);
    let y = (from_p * from_p - x * x).max(0.0).sqrt();
    let u = (r - p).dot(q - p) / length;
    let w = (r.distance_squared(p) - u * u).max(0.0).sqrt();
    let crossing = x + (u - x) * y / (y + w);
    if (0.0..=length).contains(&crossing) {
        ((u - x) * (u - x) + (w + y) * (w + y)).sqrt()
    } else {
        f64::INFINITY
    }
}

/// The mesh of test points.
struct Dual {
    positions: Vec<DVec3>,
    /// Test points, ascending: triangles, then segments [a, b, b] that no triangle has.
    simplices: Vec<[u32; 3]>,
    /// Middle and radius of a ball around each.
    balls: Vec<(DVec3, f64)>,
    /// Simplices of each test point.
    touching: Lists<u32>,
    /// Test points whose cells meet that of each.
    neighbours: Lists<u32>,
}

impl Dual {
    fn new(surface: &Surface, labels: &[u32], positions: Vec<DVec3>) -> Self {
        let vertices = surface.vertices();
        let mut simplices = Vec::new();
        let mut edges = Vec::new();
        for element in surface.elements() {
            let mut l = element.nodes.map(|n| labels[vertices[n as usize] as usize]);
            l.sort_unstable();
            let [a, b, c] = l;
            if a == c {
                continue;
            }
            edges.extend([(a, b), (b, c), (a, c)].into_iter().filter(|(a, b)| a != b));
            let [p, q, r] = l.map(|t| positions.get(t as usize).copied().unwrap_or_default());
            let longest =
                (q - p).length_squared().max((r - q).length_squared()).max((p - r).length_squared());
            // Test points in a row span no triangle, only segments.
            if a != b && b != c && (q - p).cross(r - p).length() > 1e-9 * longest {
                simplices.push(l);
            }
        }
        simplices.sort_unstable();
        simplices.dedup();
        edges.sort_unstable();
        edges.dedup();
        let mut spanned: Vec<(u32, u32)> =
            simplices.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (a, c)]).collect();
        spanned.sort_unstable();
        let lone = edges.iter().filter(|edge| spanned.binary_search(edge).is_err());
        simplices.extend(lone.map(|&(a, b)| [a, b, b]));

        let corners = simplices.iter().enumerate().flat_map(|(s, &[a, b, c])| {
            [a, b, c].into_iter().take(if b == c { 2 } else { 3 }).map(move |t| (t, s as u32))
        });
        let touching = Lists::new(positions.len(), corners);
        let neighbours = Lists::new(positions.len(), edges.iter().flat_map(|&(a, b)| [(a, b), (b, a)]));
        let balls = simplices.iter().map(|s| {
            let corners = s.map(|t| positions[t as usize]);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            (middle, corners.iter().map(|c| c.distance(middle)).fold(0.0, f64::max))
        });
        let balls = balls.collect();
        Dual { positions, simplices, balls, touching, neighbours }
    }

    /// Gathers the simplices of test point `t` and of its neighbours.
    fn around(&self, t: u32, around: &mut Vec<u32>) {
        around.clear();
        around.extend(self.touching.of(t));
        around.extend(self.neighbours.of(t).iter().flat_map(|&next| self.touching.of(next)));
        around.sort_unstable();
        around.dedup();
    }

    /// The mix at `p`, in the cell of `t`: the nearest point of the simplices around, by area coordinates.
    fn mix(&self, p: DVec3, t: u32, around: &[u32]) -> NodeMix {
        let mut nearest = (f64::INFINITY, NodeMix::own(t));
        for &s in around {
            let (middle, radius) = self.balls[s as usize];
            if p.distance(middle) > nearest.0 + radius {
                continue;
            }
            let test_points = self.simplices[s as usize];
            let corners = test_points.map(|t| self.positions[t as usize]);
            let weights = if test_points[1] == test_points[2] {
                let n = on_segment(p, corners[0], corners[1]);
                [1.0 - n, n, 0.0]
            } else {
                on_triangle(p, corners)
            };
            let at = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
            let distance = p.distance(at);
            if distance < nearest.0 {
                nearest = (distance, NodeMix { test_points, weights });
            }
        }
        let mut mix = nearest.1;
        // Rounding of no meaning would keep a third curve in every look-up.
        mix.weights = mix.weights.map(|w| if w < 1e-12 { 0.0 } else { w });
        let sum: f64 = mix.weights.iter().sum();
        mix.weights = mix.weights.map(|w| w / sum);
        mix
    }
}

/// Position along a segment of the point nearest to `p`, in [0, 1].
fn on_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0)
}

/// Area coordinates of the point of a triangle nearest to `p` (Ericson 2005, 5.1.5).
fn on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let n = on_segment(p, a, b);
        return [1.0 - n, n, 0.0];
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let n = on_segment(p, a, c);
        return [1.0 - n, 0.0, n];
    }
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let n = on_segment(p, b, c);
        return [0.0, 1.0 - n, n];
    }
    // Inside; where rounding contradicts itself the nearest corner is off by no more than that.
    let [va, vb, vc] = [va.max(0.0), vb.max(0.0), vc.max(0.0)];
    let sum = va + vb + vc;
    if sum > 0.0 { [va / sum, vb / sum, vc / sum] } else { [1.0, 0.0, 0.0] }
}

/// Many short lists in one piece.
struct Lists<T> {
    starts: Vec<usize>,
    items: Vec<T>,
}

impl<T: Copy + Default> Lists<T> {
    /// Sorts (list, item) pairs by list; within one they keep their order.
    fn new(count: usize, pairs: impl Iterator<Item = (u32, T)> + Clone) -> Self {
        let mut starts = vec![0usize; count + 1];
        for (list, _) in pairs.clone() {
            starts[list as usize + 1] += 1;
        }
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut items = vec![T::default(); starts[count]];
        for (list, item) in pairs {
            items[next[list as usize]] = item;
            next[list as usize] += 1;
        }
        Lists { starts, items }
    }

    fn of(&self, list: u32) -> &[T] {
        &self.items[self.starts[list as usize]..self.starts[list as usize + 1]]
    }
}
