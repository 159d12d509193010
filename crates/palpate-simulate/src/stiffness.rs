//! The sparse symmetric stiffness matrix, in blocks of 3 × 3.

use crate::element::{Contribution, PAIRS};

/// The place of a block that couples a held node.
const NOWHERE: u32 = u32::MAX;

/// Which nodes are coupled: the lower triangle by columns, and where each element's blocks go.
#[derive(Debug)]
pub(crate) struct Pattern {
    /// Blocks of column j are `starts[j]..starts[j + 1]` (n + 1).
    pub starts: Vec<u32>,
    /// Row of each block, ascending from the diagonal in each column.
    pub rows: Vec<u32>,
    /// For each element and pair: the block, and in the lowest bit whether it goes there transposed.
    places: Vec<[u32; PAIRS]>,
}

impl Pattern {
    /// Of the first `nodes` nodes: the others are held.
    pub fn new(nodes: usize, elements: &[[u32; 10]]) -> Self {
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); nodes];
        for element in elements {
            for (a, &i) in element.iter().enumerate() {
                for &j in &element[..=a] {
                    if (i.max(j) as usize) < nodes {
                        neighbours[i.min(j) as usize].push(i.max(j));
                    }
                }
            }
        }
        let (mut starts, mut rows) = (vec![0], Vec::new());
        for (node, column) in neighbours.iter_mut().enumerate() {
            column.push(node as u32);
            column.sort_unstable();
            column.dedup();
            rows.extend_from_slice(column);
            starts.push(rows.len() as u32);
        }
        drop(neighbours);
        let mut pattern = Pattern { starts, rows, places: Vec::new() };
        pattern.places = elements
            .iter()
            .map(|element| {
                let mut places = [0; PAIRS];
                let mut pair = 0;
                for (a, &i) in element.iter().enumerate() {
                    for &j in &element[..=a] {
                        // The block of (a, b) has a's components as rows.
                        places[pair] = pattern.block(i, j).map_or(NOWHERE, |b| 2 * b + u32::from(i < j));
                        pair += 1;
                    }
                }
                places
            })
            .collect();
        pattern
    }

    /// The block that couples two nodes of one element; `None` if one of them is held.
    pub fn block(&self, i: u32, j: u32) -> Option<u32> {
        let (row, column) = (i.max(j), i.min(j) as usize);
        if row as usize >= self.nodes() {
            return None;
        }
        let range = self.starts[column] as usize..self.starts[column + 1] as usize;
        let place = self.rows[range.clone()].binary_search(&row).expect("the nodes share an element");
        Some((range.start + place) as u32)
    }

    pub fn nodes(&self) -> usize {
        self.starts.len() - 1
    }
}

/// Values on a pattern, N/m.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stiffness {
    pub blocks: Vec<[f64; 9]>,
    /// Blocks that [`Stiffness::add_block`] has changed, and what they were.
    before: Vec<(u32, [f64; 9])>,
}

impl Stiffness {
    pub fn clear(&mut self, pattern: &Pattern) {
        self.before.clear();
        self.blocks.clear();
        self.blocks.resize(pattern.rows.len(), [0.0; 9]);
    }

    pub fn add(&mut self, pattern: &Pattern, element: usize, contribution: &Contribution) {
        for (&place, block) in pattern.places[element].iter().zip(&contribution.stiffness) {
            let Some(target) = self.blocks.get_mut((place / 2) as usize) else { continue };
            if place % 2 == 0 {
                for (t, b) in target.iter_mut().zip(block) {
                    *t += b;
                }
            } else {
                for i in 0..3 {
                    for k in 0..3 {
                        target[3 * k + i] += block[3 * i + k];
                    }
                }
            }
        }
    }

    /// Takes back what [`Stiffness::add_block`] has added.
    pub fn without_added(&mut self) {
        while let Some((block, value)) = self.before.pop() {
            self.blocks[block as usize] = value;
        }
    }

    /// Adds a symmetric block between two nodes: `value` for (i, j), and by symmetry for (j, i).
    pub fn add_block(&mut self, pattern: &Pattern, i: u32, j: u32, value: &[f64; 9]) {
        let Some(block) = pattern.block(i, j) else { return };
        let target = &mut self.blocks[block as usize];
        self.before.push((block, *target));
        for r in 0..3 {
            for c in 0..3 {
                target[3 * r + c] += if i >= j { value[3 * r + c] } else { value[3 * c + r] };
            }
        }
    }

    /// y = K x in the free nodes' unknowns; 0 in the others'.
    pub fn multiply(&self, pattern: &Pattern, x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for j in 0..pattern.nodes() {
            let first = pattern.starts[j] as usize;
            let xj = [x[3 * j], x[3 * j + 1], x[3 * j + 2]];
            let d = &self.blocks[first];
            let mut yj = [0.0; 3];
            for (r, y) in yj.iter_mut().enumerate() {
                *y = d[3 * r] * xj[0] + d[3 * r + 1] * xj[1] + d[3 * r + 2] * xj[2];
            }
            for p in first + 1..pattern.starts[j + 1] as usize {
                let (i, b) = (3 * pattern.rows[p] as usize, &self.blocks[p]);
                let xi = [x[i], x[i + 1], x[i + 2]];
                for r in 0..3 {
                    y[i + r] += b[3 * r] * xj[0] + b[3 * r + 1] * xj[1] + b[3 * r + 2] * xj[2];
                    yj[r] += b[r] * xi[0] + b[3 + r] * xi[1] + b[6 + r] * xi[2];
                }
            }
            for r in 0..3 {
                y[3 * j + r] += yj[r];
            }
        }
    }
}
