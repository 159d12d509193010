//! The exchange of the newest value under loom: every order in which two threads' accesses can be seen, within a bound of
//! preemptions.

#[path = "../src/latest.rs"]
#[allow(dead_code, reason = "the tests use what they test")]
mod latest;

/// What `latest.rs` uses in place of the standard library's.
mod shared {
    pub use loom::sync::Arc;
    pub use loom::sync::atomic::{AtomicU8, AtomicU64, Ordering};
}

use latest::exchange;
use loom::thread;

fn explore(test: impl Fn() + Send + Sync + 'static) {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = Some(3);
    model.check(test);
}

#[test]
fn the_newest_once() {
    explore(|| {
        let (mut writer, mut reader) = exchange();
        assert_eq!(reader.take(), None);
        writer.put(&[1.0]);
        writer.put(&[2.0]);
        assert_eq!((reader.take(), reader.take()), (Some([2.0]), None));
        writer.put(&[3.0]);
        assert_eq!(reader.take(), Some([3.0]));
    });
}

/// Never torn, never older than what was seen, and the last one arrives.
#[test]
fn whole_and_in_order() {
    explore(|| {
        let (mut writer, mut reader) = exchange();
        let writing = thread::spawn(move || (1..=4).for_each(|k| writer.put(&[f64::from(k); 2])));
        let mut seen = 0.0;
        let mut look = |reader: &mut latest::Reader<2>| {
            if let Some([a, b]) = reader.take() {
                assert_eq!(a, b, "torn");
                assert!(a > seen, "{a} after {seen}");
                seen = a;
            }
            seen
        };
        for _ in 0..3 {
            look(&mut reader);
        }
        writing.join().unwrap();
        assert_eq!(look(&mut reader), 4.0);
    });
}
