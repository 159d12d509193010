//! The order of the elements: along a Hilbert curve, so that what is near in space is near in memory.

use crate::parallel;
use std::ops::Range;

/// Bits of an axis of the curve's cells, and those of them that tell which bucket a cell is in.
pub(super) const CELL_BITS: u32 = 16;
const BUCKET_BITS: u32 = 5;

/// The numbers below `count` in the order in which their cells lie along the curve: bucket by bucket, since beside a body that
/// hardly fits into memory there is no room for all keys.
pub(super) fn along_curve(count: u32, cell: impl Fn(u32) -> [u32; 3] + Sync) -> Vec<u32> {
    const BUCKETS: usize = 1 << (3 * BUCKET_BITS);
    let bucket = |i: usize| hilbert(cell(i as u32).map(|x| x >> (CELL_BITS - BUCKET_BITS)), BUCKET_BITS);
    let buckets: Vec<u16> = parallel::collect(count as usize, |i| bucket(i) as u16);
    let mut ends = vec![0u32; BUCKETS + 1];
    buckets.iter().for_each(|&b| ends[usize::from(b) + 1] += 1);
    for b in 0..BUCKETS {
        ends[b + 1] += ends[b];
    }
    let starts = ends.clone();
    let mut order = vec![0; count as usize];
    for (i, &b) in buckets.iter().enumerate() {
        let end = &mut ends[usize::from(b)];
        order[*end as usize] = i as u32;
        *end += 1;
    }
    drop(buckets);
    // Those of the buckets that begin in a range.
    let sorted = |range: Range<usize>| {
        let at = |number: usize| starts[..BUCKETS].partition_point(|&s| (s as usize) < number);
        let (mut keyed, mut sorted) = (Vec::new(), Vec::with_capacity(range.len()));
        for bounds in starts[at(range.start)..=at(range.end)].windows(2) {
            let numbers = &order[bounds[0] as usize..bounds[1] as usize];
            keyed.clear();
            keyed.extend(numbers.iter().map(|&i| (hilbert(cell(i), CELL_BITS), i)));
            keyed.sort_unstable();
            sorted.extend(keyed.iter().map(|(_, i)| *i));
        }
        sorted
    };
    parallel::in_parts(count as usize, sorted).concat()
}

/// Position along a 3-D Hilbert curve of `bits` bits an axis, at most 21 (Skilling 2004). Its first digits are those of the
/// curve of fewer bits.
fn hilbert(mut x: [u32; 3], bits: u32) -> u64 {
    let mut q = 1 << (bits - 1);
    while q > 1 {
        let p = q - 1;
        for i in 0..3 {
            // Without a branch, which nobody could predict.
            let set = 0u32.wrapping_sub(u32::from(x[i] & q != 0));
            let t = (x[0] ^ x[i]) & p & !set;
            x[0] ^= t | (p & set);
            x[i] ^= t;
        }
        q >>= 1;
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    // Bit k of t: whether an odd number of the bits above it are set.
    let mut t = x[2];
    [1, 2, 4, 8, 16].iter().for_each(|shift| t ^= t >> shift);
    let [a, b, c] = x.map(|v| spread(v ^ t >> 1));
    a << 2 | b << 1 | c
}

/// Two zeros behind each of 21 bits.
fn spread(v: u32) -> u64 {
    let mut v = u64::from(v);
    v = (v | v << 32) & 0x001f_0000_0000_ffff;
    v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_goes_from_cell_to_neighbouring_cell_and_is_the_coarser_ones() {
        let cells = || (0..16u32).flat_map(|x| (0..16).flat_map(move |y| (0..16).map(move |z| [x, y, z])));
        let mut along: Vec<_> = cells().map(|cell| (hilbert(cell, 4), cell)).collect();
        along.sort_unstable();
        assert!(along.iter().enumerate().all(|(i, (key, _))| *key == i as u64));
        for pair in along.windows(2) {
            let apart: u32 = (0..3).map(|axis| pair[0].1[axis].abs_diff(pair[1].1[axis])).sum();
            assert_eq!(apart, 1, "{pair:?}");
        }
        let fine = |cell: [u32; 3]| cell.map(|x| x << 16 | (x.wrapping_mul(0x9E37) & 0xffff));
        assert!(cells().all(|cell| hilbert(fine(cell), 20) >> 48 == hilbert(cell, 4)));
    }

    #[test]
    fn the_order_is_that_of_all_keys() {
        let cell = |i: u32| {
            [7919, 104_729, 1_299_709].map(|p: u32| i.wrapping_mul(p).wrapping_mul(i) >> (32 - CELL_BITS))
        };
        let mut keyed: Vec<_> = (0..5000).map(|i| (hilbert(cell(i), CELL_BITS), i)).collect();
        keyed.sort_unstable();
        assert!(keyed.iter().map(|(_, i)| *i).eq(along_curve(5000, cell)));
        assert!(along_curve(0, cell).is_empty());
    }
}
