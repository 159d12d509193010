//! The sampled-data rule (MODEL 5): a loop cycles where K_max exceeds what damping and period allow, and not below.

mod common;

use common::{plane, press};

/// MODEL 5's figure: 0.1 kg with 0.3 N·s/m on f = 100 · 600 δ² at 1 kHz is quiet at 490 N/m and cycles at 693: the
/// border is 2b/T = 600 N/m.
#[test]
fn quiet_at_490_and_cycling_at_693() {
    let body = plane(600.0, 500.0, 0.3);
    let [quiet, cycling] = [1.0, 2.0].map(|push| press(&body, "bench", |_| {}, push, 60.0));
    assert!((quiet.stiffness - 489.9).abs() < 0.5, "{quiet:?}");
    assert!((cycling.stiffness - 692.8).abs() < 0.5, "{cycling:?}");
    assert!(quiet.cycle.is_none(), "{quiet:?}");
    let cycle = cycling.cycle.expect("a cycle");
    println!("{quiet:?}\n{cycling:?}");
    assert!(cycle.amplitude_m > 1e-4, "{cycle:?}");
}
