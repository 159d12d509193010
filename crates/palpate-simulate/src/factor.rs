//! Sparse Cholesky factors, in single precision: they precondition, and half the numbers are half the time.

use crate::stiffness::{Pattern, Stiffness};
use faer::Par;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use feral_metis::CscPattern;

/// An order of the nodes in which elimination fills in little: nested dissection. `order[new] = old`. Nodes of one
/// clique are all coupled.
pub(crate) fn dissect(nodes: usize, cliques: &[Vec<u32>]) -> Vec<u32> {
    let mut neighbours: Vec<Vec<i32>> = vec![Vec::new(); nodes];
    for clique in cliques {
        for &i in clique {
            neighbours[i as usize].extend(clique.iter().filter(|&&j| j != i).map(|&j| j as i32));
        }
    }
    let (mut starts, mut rows) = (vec![0i32], Vec::new());
    for column in &mut neighbours {
        column.sort_unstable();
        column.dedup();
        rows.extend_from_slice(column);
        starts.push(rows.len() as i32);
    }
    let pattern = CscPattern::new(nodes, &starts, &rows);
    match pattern.map(|p| feral_metis::metis_order(&p)) {
        Some(Ok(order)) if order.len() == nodes => order.into_iter().map(|n| n as u32).collect(),
        // An order is a matter of speed: any will do.
        _ => (0..nodes as u32).collect(),
    }
}

/// What a factorisation of matrices on one pattern needs beforehand.
#[derive(Debug)]
pub(crate) struct Symbolic {
    columns: Vec<u32>,
    rows: Vec<u32>,
    cholesky: SymbolicCholesky<u32>,
    /// The matrix's unknown at each place of the factor's order; empty where they are the same.
    order: Vec<u32>,
    /// The first place of the nodes that are eliminated last; the number of unknowns where none was asked for.
    split: usize,
    /// What a factorisation costs, in solves with the factor: fixed by the pattern, not by a clock.
    pub factor_in_solves: f64,
    /// Entries of a factor.
    pub entries: f64,
}

/// L of L Lᵀ.
#[derive(Debug, Clone, Default)]
pub(crate) struct Factor {
    values: Vec<f32>,
}

/// The matrix is not positive definite.
#[derive(Debug)]
pub(crate) struct Indefinite;

impl Symbolic {
    /// In the pattern's own order.
    pub fn new(pattern: &Pattern) -> Self {
        Self::with_last(pattern, &[])
    }

    /// In the pattern's order, but for the nodes `last` (ascending), which are eliminated last: the factor's lower right corner is
    /// then that of what the matrix leaves on them when all others follow (Schur's complement).
    pub fn with_last(pattern: &Pattern, last: &[u32]) -> Self {
        let n = 3 * pattern.nodes();
        let (mut columns, mut rows) = (vec![0u32], Vec::new());
        for j in 0..pattern.nodes() {
            let blocks = pattern.starts[j] as usize..pattern.starts[j + 1] as usize;
            for k in 0..3 {
                rows.extend((k..3).map(|r| 3 * j as u32 + r));
                for &i in &pattern.rows[blocks.start + 1..blocks.end] {
                    rows.extend([3 * i, 3 * i + 1, 3 * i + 2]);
                }
                columns.push(rows.len() as u32);
            }
        }
        let matrix = SymbolicSparseColMatRef::new_checked(n, n, &columns, None, &rows);
        let parameters = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let others = (0..pattern.nodes() as u32).filter(|node| last.binary_search(node).is_err());
        let order: Vec<u32> = others
            .chain(last.iter().copied())
            .flat_map(|node| [3 * node, 3 * node + 1, 3 * node + 2])
            .collect();
        let mut places = vec![0; n];
        for (place, &unknown) in order.iter().enumerate() {
            places[unknown as usize] = place as u32;
        }
        // Where nothing is last the nodes are in their order already. (faer's own `Identity` takes the other triangle.)
        let ordering = SymmetricOrdering::Custom(PermRef::new_checked(&order, &places, n));
        let cholesky = factorize_symbolic_cholesky(matrix, faer::Side::Lower, ordering, parameters)
            .expect("the pattern fits into memory");
        let SymbolicCholeskyRaw::Supernodal(supernodal) = cholesky.raw() else {
            unreachable!("supernodes were asked for");
        };
        let (mut flops, mut entries) = (0.0, 0.0);
        for (s, (begin, end)) in
            supernodal.supernode_begin().iter().zip(supernodal.supernode_end()).enumerate()
        {
            let width = f64::from(end - begin);
            let height = supernodal.supernode(s).pattern().len() as f64 + width;
            flops += width * height * height;
            entries += width * height;
        }
        // A factorisation does about fourteen times as many operations a second as a solve, which waits for memory.
        let factor_in_solves = flops / (4.0 * entries) / 14.0;
        let split = n - 3 * last.len();
        let order = if last.is_empty() { Vec::new() } else { order };
        Symbolic { columns, rows, cholesky, order, split, factor_in_solves, entries }
    }

    /// The matrix's unknown at a place of the factor's order.
    #[inline]
    pub fn unknown(&self, place: usize) -> usize {
        self.order.get(place).map_or(place, |&unknown| unknown as usize)
    }

    /// The place of the first unknown of the nodes that are eliminated last.
    pub fn split(&self) -> usize {
        self.split
    }

    /// Calls `entry` with the row, the column and the value of each entry of the factor in the rows and columns of the nodes that
    /// are eliminated last, counted from the first of them.
    pub fn each_last(&self, factor: &Factor, mut entry: impl FnMut(usize, usize, f32)) {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = self.cholesky.raw() else { return };
        for s in (0..symbolic.n_supernodes()).rev() {
            let Supernode { start, width, height, pattern, values } = Supernode::new(symbolic, factor, s);
            if start + width <= self.split {
                return;
            }
            for (j, column) in values.chunks_exact(height).enumerate().skip(self.split.saturating_sub(start))
            {
                for (i, value) in column.iter().enumerate().skip(j) {
                    let row = if i < width { start + i } else { pattern[i - width] as usize };
                    entry(row - self.split, start + j - self.split, *value);
                }
            }
        }
    }

    /// The factor of `matrix` with the rows and columns of `held` unknowns replaced by the identity's.
    pub fn factor(&self, pattern: &Pattern, matrix: &Stiffness, held: &[bool]) -> Result<Factor, Indefinite> {
        let n = 3 * pattern.nodes();
        let typical = matrix.blocks.iter().fold(0.0, |m: f64, b| m.max(b[0])) as f32;
        let mut values = Vec::with_capacity(self.rows.len());
        for j in 0..pattern.nodes() {
            let blocks = pattern.starts[j] as usize..pattern.starts[j + 1] as usize;
            for k in 0..3 {
                let fixed = held[3 * j + k];
                let entry = |row: usize, value: f64| match (fixed || held[row], row == 3 * j + k) {
                    (false, _) => value as f32,
                    (true, true) => typical,
                    (true, false) => 0.0,
                };
                values.extend((k..3).map(|r| entry(3 * j + r, matrix.blocks[blocks.start][3 * r + k])));
                for p in blocks.start + 1..blocks.end {
                    let i = 3 * pattern.rows[p] as usize;
                    values.extend((0..3).map(|r| entry(i + r, matrix.blocks[p][3 * r + k])));
                }
            }
        }
        let symbolic = SymbolicSparseColMatRef::new_checked(n, n, &self.columns, None, &self.rows);
        let matrix = SparseColMatRef::new(symbolic, &values);
        let mut factor = vec![0.0f32; self.cholesky.len_val()];
        let scratch = self.cholesky.factorize_numeric_llt_scratch::<f32>(Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        let result = self.cholesky.factorize_numeric_llt(
            &mut factor,
            matrix,
            faer::Side::Lower,
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        let done = result.is_ok();
        if done && factor.iter().all(|v| v.is_finite()) {
            Ok(Factor { values: factor })
        } else {
            Err(Indefinite)
        }
    }

    /// Replaces `x`, in the factor's order, by (L Lᵀ)⁻¹ x; `scratch` grows as needed.
    pub fn solve(&self, factor: &Factor, x: &mut [f32], scratch: &mut Vec<f32>) {
        pulp::Arch::new().dispatch(|| {
            self.forward(factor, x, scratch, usize::MAX);
            self.backward(factor, x, scratch, usize::MAX);
        });
    }

    /// The first half of a solve, as far as the nodes that are eliminated last: what is left there of `x` is the load that the
    /// others hand on to them.
    pub fn condense(&self, factor: &Factor, x: &mut [f32], scratch: &mut Vec<f32>) {
        pulp::Arch::new().dispatch(|| self.forward(factor, x, scratch, self.split));
    }

    /// The second half: `x` comes from [`Symbolic::condense`], with the solution put in at the nodes that are eliminated last.
    pub fn expand(&self, factor: &Factor, x: &mut [f32], scratch: &mut Vec<f32>) {
        pulp::Arch::new().dispatch(|| self.backward(factor, x, scratch, self.split));
    }

    /// L⁻¹ x, by the columns before `end`.
    #[inline(always)]
    fn forward(&self, factor: &Factor, x: &mut [f32], scratch: &mut Vec<f32>, end: usize) {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = self.cholesky.raw() else { return };
        for s in 0..symbolic.n_supernodes() {
            let Supernode { start, width, height, pattern, values } = Supernode::new(symbolic, factor, s);
            if start >= end {
                return;
            }
            let values = &values[..height * width.min(end - start)];
            scratch.clear();
            scratch.resize(pattern.len(), 0.0);
            let top = &mut x[start..start + width];
            for (j, column) in values.chunks_exact(height).enumerate() {
                let xj = top[j] / column[j];
                top[j] = xj;
                for (t, l) in top[j + 1..].iter_mut().zip(&column[j + 1..width]) {
                    *t -= l * xj;
                }
            }
            // Four columns at a time, so that sums are loaded and stored less often.
            let mut columns = values.chunks_exact(4 * height);
            let mut j = 0;
            for four in &mut columns {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| &four[i * height + width..(i + 1) * height]);
                let [xa, xb, xc, xd] = [top[j], top[j + 1], top[j + 2], top[j + 3]];
                for ((((s, a), b), c), d) in scratch.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                    *s += a * xa + b * xb + c * xc + d * xd;
                }
                j += 4;
            }
            for column in columns.remainder().chunks_exact(height) {
                for (s, l) in scratch.iter_mut().zip(&column[width..]) {
                    *s += l * top[j];
                }
                j += 1;
            }
            for (&row, s) in pattern.iter().zip(&*scratch) {
                x[row as usize] -= s;
            }
        }
    }

    /// L⁻ᵀ x, by the columns before `end`.
    #[inline(always)]
    fn backward(&self, factor: &Factor, x: &mut [f32], scratch: &mut Vec<f32>, end: usize) {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = self.cholesky.raw() else { return };
        for s in (0..symbolic.n_supernodes()).rev() {
            let Supernode { start, width, height, pattern, values } = Supernode::new(symbolic, factor, s);
            if start >= end {
                continue;
            }
            let values = &values[..height * width.min(end - start)];
            scratch.clear();
            scratch.extend(pattern.iter().map(|&row| x[row as usize]));
            let top = &mut x[start..start + width];
            for (j, column) in values.chunks_exact(height).enumerate().rev() {
                let below = dot(&column[width..], scratch) + dot(&column[j + 1..width], &top[j + 1..]);
                top[j] = (top[j] - below) / column[j];
            }
        }
    }
}

/// Columns of a factor that have the same rows below their triangle.
struct Supernode<'a> {
    /// The first column, and how many there are.
    start: usize,
    width: usize,
    /// Rows of each column, those of the triangle among them.
    height: usize,
    /// The rows below it.
    pattern: &'a [u32],
    /// Column by column.
    values: &'a [f32],
}

impl<'a> Supernode<'a> {
    #[inline(always)]
    fn new(symbolic: &'a SymbolicSupernodalCholesky<u32>, factor: &'a Factor, s: usize) -> Self {
        let node = symbolic.supernode(s);
        let (start, pattern) = (node.start(), node.pattern());
        let width = symbolic.supernode_end()[s] as usize - start;
        let height = width + pattern.len();
        let first = symbolic.col_ptr_for_val()[s] as usize;
        Supernode { start, width, height, pattern, values: &factor.values[first..][..width * height] }
    }
}

/// Right-hand sides that are solved for together: the factor is read once for all of them.
pub(crate) const LANES: usize = 8;

impl Symbolic {
    /// Replaces every lane of `x`, in the factor's order, by (L Lᵀ)⁻¹ x.
    pub fn solve_several(&self, factor: &Factor, x: &mut [[f32; LANES]]) {
        pulp::Arch::new().dispatch(|| self.substitute_several(factor, x));
    }

    #[inline(always)]
    fn substitute_several(&self, factor: &Factor, x: &mut [[f32; LANES]]) {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = self.cholesky.raw() else { return };
        let take = |sum: &mut [f32; LANES], l: f32, x: &[f32; LANES]| {
            for (s, x) in sum.iter_mut().zip(x) {
                *s += l * x;
            }
        };
        let mut scratch: Vec<[f32; LANES]> = Vec::new();
        for s in 0..symbolic.n_supernodes() {
            let Supernode { start, width, height, pattern, values } = Supernode::new(symbolic, factor, s);
            scratch.clear();
            scratch.resize(pattern.len(), [0.0; LANES]);
            for (j, column) in values.chunks_exact(height).enumerate() {
                let xj = x[start + j].map(|v| v / column[j]);
                x[start + j] = xj;
                for (t, l) in x[start + j + 1..start + width].iter_mut().zip(&column[j + 1..width]) {
                    take(t, -l, &xj);
                }
                for (s, l) in scratch.iter_mut().zip(&column[width..]) {
                    take(s, *l, &xj);
                }
            }
            for (&row, s) in pattern.iter().zip(&scratch) {
                take(&mut x[row as usize], -1.0, s);
            }
        }
        for s in (0..symbolic.n_supernodes()).rev() {
            let Supernode { start, width, height, pattern, values } = Supernode::new(symbolic, factor, s);
            scratch.clear();
            scratch.extend(pattern.iter().map(|&row| x[row as usize]));
            for (j, column) in values.chunks_exact(height).enumerate().rev() {
                let mut below = [0.0f32; LANES];
                for (l, x) in column[width..].iter().zip(&scratch) {
                    take(&mut below, *l, x);
                }
                for (l, x) in column[j + 1..width].iter().zip(&x[start + j + 1..start + width]) {
                    take(&mut below, *l, x);
                }
                for (x, below) in x[start + j].iter_mut().zip(below) {
                    *x = (*x - below) / column[j];
                }
            }
        }
    }
}

/// Eight partial sums, which the compiler keeps in vector registers.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f32 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a8.zip(b8) {
        for (s, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *s += a * b;
        }
    }
    sums.iter().sum::<f32>() + rest
}
