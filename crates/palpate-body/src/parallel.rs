//! Work on many things at the same time, while a large body is opened: the results, and their bits, are those of one thread.

use std::ops::Range;
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

/// Appends `of` each number below `count`.
pub(crate) fn extend<T: Send>(to: &mut Vec<T>, count: usize, of: impl Fn(usize) -> T + Sync) {
    if count < LEAST {
        to.extend((0..count).map(of));
        return;
    }
    to.reserve_exact(count);
    in_parts(count, |range| range.map(&of).collect::<Vec<T>>()).into_iter().for_each(|part| to.extend(part));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_follow_each_other_and_leave_nothing_out() {
        for count in [0, 1, 1000, LEAST - 1, LEAST, 3 * LEAST + 7] {
            let mut all = vec![usize::MAX];
            extend(&mut all, count, |i| i * i);
            assert!(all[1..].iter().copied().eq((0..count).map(|i| i * i)), "{count}");
            let ranges = in_parts(count, |range| range);
            assert_eq!((ranges[0].start, ranges[ranges.len() - 1].end), (0, count));
            assert!(ranges.windows(2).all(|r| r[0].end == r[1].start));
        }
    }
}
