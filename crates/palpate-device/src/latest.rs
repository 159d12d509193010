//! The newest value between two threads, without waiting on either side.
//!
//! The tests also run this very file under loom, which tries the orders in which two threads' accesses can be seen.

use crate::shared::{Arc, AtomicU8, AtomicU64, Ordering};

/// Set beside the middle slot's number while the reader has not seen it.
const FRESH: u8 = 4;

/// Three slots: one is the writer's, one the reader's, and the one in the middle changes hands.
#[derive(Debug)]
struct Slots<const N: usize> {
    words: [[AtomicU64; N]; 3],
    middle: AtomicU8,
}

/// The end that puts values in.
#[derive(Debug)]
pub(crate) struct Writer<const N: usize> {
    slots: Arc<Slots<N>>,
    mine: u8,
}

/// The end that takes the newest out.
#[derive(Debug)]
pub(crate) struct Reader<const N: usize> {
    slots: Arc<Slots<N>>,
    mine: u8,
}

/// An exchange of `N` numbers, with nothing in it yet.
pub(crate) fn exchange<const N: usize>() -> (Writer<N>, Reader<N>) {
    let words = std::array::from_fn(|_| std::array::from_fn(|_| AtomicU64::new(0)));
    let slots = Arc::new(Slots { words, middle: AtomicU8::new(1) });
    (Writer { slots: slots.clone(), mine: 0 }, Reader { slots, mine: 2 })
}

impl<const N: usize> Writer<N> {
    /// Replaces what is there, seen or not. Wait-free, allocates nothing.
    pub fn put(&mut self, values: &[f64; N]) {
        for (word, value) in self.slots.words[usize::from(self.mine)].iter().zip(values) {
            word.store(value.to_bits(), Ordering::Relaxed);
        }
        // Release: the words are there before the slot is; acquire: the reader has done with the one that comes back.
        let back = self.slots.middle.swap(self.mine | FRESH, Ordering::AcqRel);
        self.mine = back & !FRESH;
    }
}

impl<const N: usize> Reader<N> {
    /// The newest value, if it was not taken yet. Wait-free, allocates nothing.
    pub fn take(&mut self) -> Option<[f64; N]> {
        if self.slots.middle.load(Ordering::Relaxed) & FRESH == 0 {
            return None;
        }
        self.mine = self.slots.middle.swap(self.mine, Ordering::AcqRel) & !FRESH;
        let words = &self.slots.words[usize::from(self.mine)];
        Some(std::array::from_fn(|i| f64::from_bits(words[i].load(Ordering::Relaxed))))
    }
}
