//! Distances along the surface, by Dijkstra's method, where a way may also cross an element (Kimmel and Sethian
//! 1998): on a plane they are true ones.

use glam::DVec3;
use palpate_body::Surface;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// No label: not reached.
pub(crate) const NONE: u32 = u32::MAX;

/// Where each vertex is, m.
pub(crate) fn vertex_positions(surface: &Surface) -> Vec<DVec3> {
    let vertices = surface.vertices();
    let count = vertices.iter().map(|&v| v as usize + 1).max().unwrap_or(0);
    let mut positions = vec![DVec3::ZERO; count];
    for (&v, &p) in vertices.iter().zip(surface.positions()) {
        positions[v as usize] = p;
    }
    positions
}

/// How far a vertex is from the nearest source, as far as is known, and which that is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reached {
    pub distance: f64,
    pub label: u32,
    /// The last wave that went through it for good.
    wave: u32,
}

/// The ways along a surface whose edges have the lengths that `length` says.
pub(crate) struct Geodesic<'a, L> {
    length: &'a L,
    /// Around each vertex the other two of every element.
    fans: Lists<[u32; 2]>,
    /// Mean length of the elements' first edges.
    width: f64,
    waves: u32,
}

impl<'a, L: Fn(u32, u32) -> f64> Geodesic<'a, L> {
    pub fn new(surface: &Surface, length: &'a L) -> Self {
        let vertices = surface.vertices();
        let count = vertices.iter().map(|&v| v as usize + 1).max().unwrap_or(0);
        let corners = |e: &palpate_body::Element| e.nodes.map(|n| vertices[n as usize]);
        let fans = surface.elements().iter().flat_map(|element| {
            let [a, b, c] = corners(element);
            [(a, [b, c]), (b, [c, a]), (c, [a, b])]
        });
        let fans = Lists::new(count, fans);
        let ways = surface.elements().iter().map(|e| {
            let [a, b, _] = corners(e);
            length(a, b)
        });
        let width = ways.sum::<f64>() / surface.elements().len() as f64;
        Geodesic { length, fans, width, waves: 0 }
    }

    /// No vertex reached.
    pub fn unreached(&self) -> Vec<Reached> {
        vec![Reached { distance: f64::INFINITY, label: NONE, wave: 0 }; self.fans.len()]
    }

    /// The nearest source of each vertex. Ties go to the lower number.
    pub fn cells(&mut self, sources: &[u32]) -> Vec<u32> {
        let mut reached = self.unreached();
        self.spread(&mut reached, sources.iter().enumerate().map(|(t, &v)| (t as u32, v)));
        reached.into_iter().map(|r| r.label).collect()
    }

    /// Lets a wave run from these (label, vertex) through all vertices that it reaches first.
    pub fn spread(&mut self, reached: &mut [Reached], sources: impl Iterator<Item = (u32, u32)>) {
        self.waves += 1;
        let mut queue = Queue::new(self.width);
        for (label, v) in sources {
            reached[v as usize] = Reached { distance: 0.0, label, wave: 0 };
            queue.push(0.0, label, v);
        }
        while let Some((from_v, label, v)) = queue.pop() {
            if std::mem::replace(&mut reached[v as usize].wave, self.waves) == self.waves {
                continue;
            }
            for &[b, c] in self.fans.of(v) {
                for (next, third) in [(b, c), (c, b)] {
                    let known = reached[next as usize];
                    if known.wave == self.waves {
                        continue;
                    }
                    let way = (self.length)(v, next);
                    let mut distance = from_v + way;
                    let far = reached[third as usize];
                    if far.wave == self.waves && far.label == label {
                        let sides = [(self.length)(v, third), way, (self.length)(third, next)];
                        distance = distance.min(across(sides, [from_v, far.distance]));
                    }
                    if (distance, label) < (known.distance, known.label) {
                        reached[next as usize] = Reached { distance, label, wave: known.wave };
                        queue.push(distance, label, next);
                    }
                }
            }
        }
    }
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

/// The distance of r from a source that is at the given distances from the ends of edge pq, on a straight way across
/// that edge in the plane of the triangle with these sides pq, pr, qr; infinite if there is none.
fn across([pq, pr, qr]: [f64; 3], [from_p, from_q]: [f64; 2]) -> f64 {
    // The source lies at (x, -y), r at (u, w), the edge along the first axis.
    let x = (from_p * from_p - from_q * from_q + pq * pq) / (2.0 * pq);
    let y = (from_p * from_p - x * x).max(0.0).sqrt();
    let u = (pr * pr - qr * qr + pq * pq) / (2.0 * pq);
    let w = (pr * pr - u * u).max(0.0).sqrt();
    let crossing = x + (u - x) * y / (y + w);
    if (0.0..=pq).contains(&crossing) {
        ((u - x) * (u - x) + (w + y) * (w + y)).sqrt()
    } else {
        f64::INFINITY
    }
}

/// Many short lists in one piece.
pub(crate) struct Lists<T> {
    starts: Vec<usize>,
    items: Vec<T>,
}

impl<T: Copy + Default> Lists<T> {
    /// Sorts (list, item) pairs by list; within one they keep their order.
    pub fn new(count: usize, pairs: impl Iterator<Item = (u32, T)> + Clone) -> Self {
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

    pub fn of(&self, list: u32) -> &[T] {
        &self.items[self.starts[list as usize]..self.starts[list as usize + 1]]
    }

    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }
}
