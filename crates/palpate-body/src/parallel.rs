//! Work on many things at the same time, while a large body is opened: the results, and their bits, are those of one thread.

use bytemuck::{Zeroable, allocation::zeroed_vec};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};
use std::thread;

/// Fewer things than this are not worth a thread.
const LEAST: usize = 1 << 16;

/// What `work` makes of ranges that follow each other and cover 0 to `count`, in their order.
pub(crate) fn in_parts<T: Send>(count: usize, work: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    let most = if count < LEAST { 1 } else { thread::available_parallelism().map_or(1, usize::from) };
    let end = |part: usize| count * part / most;
    let (work, first) = (&work, end(1));
    thread::scope(|scope| {
        let spawn = |part: usize| {
            let range = end(part)..end(part + 1);
            (range.clone(), thread::Builder::new().spawn_scoped(scope, move || work(range)))
        };
        let others: Vec<_> = (1..most).map(spawn).collect();
        let mut results = vec![work(0..first)];
        results.extend(others.into_iter().map(|(range, thread)| match thread {
            Ok(thread) => thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
            // The system has no thread to spare.
            Err(_) => work(range),
        }));
        results
    })
}

/// `of` each number below `count`, in their order.
pub(crate) fn collect<T: Zeroable + Send>(count: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    if count < LEAST {
        return (0..count).map(of).collect();
    }
    // In place: a copy of each part would cost as much as many an `of`.
    let mut all: Vec<T> = zeroed_vec(count);
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let size = count.div_ceil(4 * threads);
    let parts = Mutex::new(all.chunks_mut(size).enumerate());
    let next = || parts.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work = || {
        while let Some((part, items)) = next() {
            items.iter_mut().enumerate().for_each(|(i, item)| *item = of(part * size + i));
        }
    };
    thread::scope(|scope| {
        // Where the system has no thread to spare, the others do its part.
        let _others: Vec<_> =
            (1..threads).map(|_| thread::Builder::new().spawn_scoped(scope, work)).collect();
        work();
    });
    all
}

/// The first complaint about the numbers below `count` in their order, if there is one.
pub(crate) fn check<E: Send>(count: usize, of: impl Fn(usize) -> Result<(), E> + Sync) -> Result<(), E> {
    in_parts(count, |mut range| range.try_for_each(&of)).into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_follow_each_other_and_leave_nothing_out() {
        for count in [0, 1, 1000, LEAST - 1, LEAST, 3 * LEAST + 7] {
            assert!(collect(count, |i| i * i).into_iter().eq((0..count).map(|i| i * i)), "{count}");
            let first = |least: usize| check(count, |i| if i < least { Ok(()) } else { Err(i) });
            assert_eq!(first(count), Ok(()));
            assert!(count == 0 || first(count / 3) == Err(count / 3));
            let ranges = in_parts(count, |range| range);
            assert_eq!((ranges[0].start, ranges[ranges.len() - 1].end), (0, count));
            assert!(ranges.windows(2).all(|r| r[0].end == r[1].start));
        }
    }
}
