//! Numbers out of a large range, and which of them is which.

/// A table of what lies between the least and the greatest number pays up to so many entries a value.
const SPARSE: usize = 8;

/// No rank.
const NONE: u32 = u32::MAX;

/// A set of numbers, ascending. Filled again and again, it keeps its memory.
#[derive(Debug, Default)]
pub(crate) struct IndexMap {
    list: Vec<u32>,
    /// Ranks from the least number on; empty where the numbers lie far apart.
    table: Vec<u32>,
}

impl IndexMap {
    /// Of these values, each once.
    pub fn of(values: impl Iterator<Item = u32>) -> Self {
        let mut map = IndexMap::default();
        map.fill(values);
        map
    }

    /// Becomes the set of these values, each once.
    pub fn fill(&mut self, values: impl Iterator<Item = u32>) {
        let IndexMap { list, table } = self;
        list.clear();
        table.clear();
        list.extend(values);
        let (Some(&low), Some(&high)) = (list.iter().min(), list.iter().max()) else { return };
        if (high - low) as usize / SPARSE > list.len() {
            list.sort_unstable();
            list.dedup();
            return;
        }
        table.resize((high - low) as usize + 1, NONE);
        list.iter().for_each(|v| table[(v - low) as usize] = 0);
        list.clear();
        for (slot, number) in table.iter_mut().zip(low..=high).filter(|(slot, _)| **slot != NONE) {
            *slot = list.len() as u32;
            list.push(number);
        }
    }

    /// Bytes that finding a rank may read.
    pub fn memory(&self) -> impl Iterator<Item = &[u8]> {
        [&self.list, &self.table].into_iter().map(|part| bytemuck::cast_slice(part))
    }

    /// The numbers, ascending.
    pub fn list(&self) -> &[u32] {
        &self.list
    }

    /// How many of them are less than `number`, if it is one of them.
    ///
    /// # Real-time
    /// Logarithmic, never panics.
    #[inline]
    pub fn index_of(&self, number: u32) -> Option<u32> {
        if self.table.is_empty() {
            return self.list.binary_search(&number).ok().map(|rank| rank as u32);
        }
        let at = number.checked_sub(*self.list.first()?)?;
        self.table.get(at as usize).copied().filter(|rank| *rank != NONE)
    }

    /// The same; what is none of them stays itself.
    pub fn renumber(&self, number: u32) -> u32 {
        self.index_of(number).unwrap_or(number)
    }

    /// A half-edge with its element renumbered; `otherwise` where that is none of them.
    pub fn renumber_twin(&self, twin: u32, otherwise: u32) -> u32 {
        self.index_of(twin / 3).map_or(otherwise, |element| 3 * element + twin % 3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn near_or_far_apart_they_are_ranked(values in prop::collection::vec(0u32..500, 0..60), factor in 1u32..8_000_000, first in 0u32..9) {
            let values: Vec<u32> = values.iter().map(|v| first + v * factor).collect();
            let map = IndexMap::of(values.iter().copied());
            let sorted: std::collections::BTreeSet<u32> = values.iter().copied().collect();
            prop_assert!(map.list().iter().eq(&sorted));
            prop_assert_eq!(map.table.is_empty(), sorted.is_empty() || sorted.last().unwrap() - sorted.first().unwrap() >= 8 * (values.len() as u32 + 1));
            for (rank, value) in sorted.iter().enumerate() {
                prop_assert_eq!(map.index_of(*value), Some(rank as u32));
            }
            for other in (0..4000).chain([u32::MAX, u32::MAX - 1]).filter(|v| !sorted.contains(v)) {
                prop_assert_eq!(map.index_of(other), None);
            }
        }
    }
}
