//! The threads' exchange under loom: every order in which two threads' accesses can be seen, within a bound of preemptions.

#[path = "../src/exchange.rs"]
#[allow(dead_code, reason = "the tests use what they test")]
mod exchange;

/// What `exchange.rs` uses in place of the standard library's.
mod atomic {
    pub use loom::sync::atomic::{AtomicPtr, AtomicU64, Ordering, fence};
}

use exchange::{Board, Mailbox};
use loom::sync::Arc;
use loom::thread;

fn explore(test: impl Fn() + Send + Sync + 'static) {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = Some(3);
    model.check(test);
}

/// Boxes go round as between the finder and the patch holder: none is lost or taken twice, the newest arrives, in order, and the
/// taker never has to give back two.
#[test]
fn boxes_go_round() {
    explore(|| {
        let both = Arc::new((Mailbox::default(), Mailbox::default()));
        let there = both.clone();
        let finder = thread::spawn(move || {
            let (fresh, used) = &*there;
            let mut hands: Vec<Box<u32>> = vec![Box::new(0), Box::new(0)];
            for serial in 1..=3 {
                hands.extend(used.take());
                let Some(mut message) = hands.pop() else { continue };
                *message = serial;
                hands.extend(fresh.post(message));
            }
            hands.len()
        });
        let (fresh, used) = &*both;
        let mut held = Box::new(0);
        for _ in 0..2 {
            if used.is_empty()
                && let Some(mut next) = fresh.take()
            {
                assert!(*next > *held, "{next} after {held}");
                std::mem::swap(&mut held, &mut next);
                assert!(used.post(next).is_none());
            }
            thread::yield_now();
        }
        let in_hands = finder.join().unwrap();
        let under_way = usize::from(fresh.take().is_some()) + usize::from(used.take().is_some());
        assert_eq!(in_hands + under_way, 2);
    });
}

/// What was written before a box was posted is seen by who takes it.
#[test]
fn a_box_arrives_with_its_contents() {
    explore(|| {
        let mailbox = Arc::new(Mailbox::default());
        let there = mailbox.clone();
        let poster = thread::spawn(move || {
            there.post(Box::new(loom::cell::Cell::new(7)));
        });
        if let Some(cell) = mailbox.take() {
            assert_eq!(cell.get(), 7);
        }
        poster.join().unwrap();
    });
}

/// So it is by who gets it back because nobody took it.
#[test]
fn a_box_comes_back_with_its_contents() {
    explore(|| {
        let mailbox = Arc::new(Mailbox::default());
        let there = mailbox.clone();
        let poster = thread::spawn(move || {
            there.post(Box::new(loom::cell::Cell::new(7)));
        });
        if let Some(cell) = mailbox.post(Box::new(loom::cell::Cell::new(8))) {
            assert_eq!(cell.get(), 7);
        }
        poster.join().unwrap();
    });
}

/// A reader sees all words of one writing, and writings in their order.
#[test]
fn a_board_is_never_torn() {
    explore(|| {
        let board = Arc::new(Board::<2>::default());
        let there = board.clone();
        let writer = thread::spawn(move || {
            for k in 1..=2 {
                there.write(&[k, 10 * k]);
            }
        });
        let mut last = 0;
        for _ in 0..2 {
            if let Some(([a, b], times)) = board.read() {
                assert!(b == 10 * a && times == a && times >= last, "{a} {b} {times}");
                last = times;
            }
        }
        writer.join().unwrap();
        assert_eq!(board.read(), Some(([2, 20], 2)));
    });
}
