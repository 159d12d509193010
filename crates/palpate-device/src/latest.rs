//! The newest value between two threads, without waiting on either side.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

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

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    #[test]
    fn the_newest_once() {
        let (mut writer, mut reader) = exchange();
        assert_eq!(reader.take(), None);
        writer.put(&[1.0]);
        writer.put(&[2.0]);
        assert_eq!((reader.take(), reader.take()), (Some([2.0]), None));
        writer.put(&[3.0]);
        assert_eq!(reader.take(), Some([3.0]));
    }

    /// Never torn, never older than what was seen, and the last one arrives.
    #[test]
    fn whole_and_in_order() {
        const LAST: u32 = 200_000;
        let (mut writer, mut reader) = exchange::<8>();
        let writing = thread::spawn(move || (1..=LAST).for_each(|k| writer.put(&[f64::from(k); 8])));
        let mut seen = 0.0;
        while seen < f64::from(LAST) {
            let Some(values) = reader.take() else {
                thread::yield_now();
                continue;
            };
            assert!(values.iter().all(|v| *v == values[0]), "torn: {values:?}");
            assert!(values[0] > seen, "{} after {seen}", values[0]);
            seen = values[0];
        }
        writing.join().unwrap();
    }
}
