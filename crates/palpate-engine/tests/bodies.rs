//! What holds on the bodies that other tests make holds on bodies that users make: the ledger, the tank, and within the ranges that
//! the law was found on the force's Lipschitz bound, but for one step in ten thousand: where a rim is narrower than the tool, slip
//! has places without a stable end, and a tool in a hurry passes them within a step.
//!
//! ```text
//! PALPATE_BODIES=liver.body:cylinder.body cargo test --release -p palpate-engine --test bodies -- --ignored --nocapture
//! ```

mod common;

use common::*;
use glam::DVec3;
use palpate_body::{Body, SlipRule};
use palpate_engine::{Ablation, Contact, Flags, Output};

/// Of each body by each rule.
const STEPS: usize = 50_000;
/// How much more than the bound of a step's two ends the force may change: in between it may be larger.
const BETWEEN: f64 = 1.5;
/// What a sum of so many energies may be off by, J.
const ROUNDING_J: f64 = 1e-12;

/// What was seen.
#[derive(Debug, Default)]
struct Seen {
    touched: u64,
    slips: u64,
    held_back: u64,
    reanchored: u64,
    pulling: u64,
    capped: u64,
    blocked: u64,
    /// Steps without a bound: no stable slip there.
    unbounded: u64,
    /// The largest change of the force in parts of what the bound allows, where it was judged, and how often it was more.
    of_bound: f64,
    beyond: u64,
    judged: u64,
    /// The most that slip had given out at any time, re-anchoring apart, J.
    given_j: f64,
    moved_j: f64,
    imbalance: f64,
}

fn lead(body: &Body, rule: SlipRule) -> Seen {
    let mut random = Random::new(5);
    let mut contact = Contact::with_slip(body, rule, Ablation::None);
    let mut way = Wander::new(body, &mut random, 0.02);
    let (mut seen, mut last, mut flagged) = (Seen::default(), Output::default(), 0.0);
    // As deep and as far aside as the simulation went.
    let range = body.coupled_law().map_or([f64::INFINITY; 2], |law| {
        [law.potentials[0].press.knots().last().copied().unwrap_or_default(), law.range_m]
    });
    let (mut bound, mut from): (Option<f64>, DVec3) = (None, way.x);
    for i in 0..STEPS {
        if i % 500 == 0 {
            way.speed = libm::exp(random.range(libm::log(2e-3), libm::log(0.2)));
        }
        if i % 5000 == 4999 {
            // Elsewhere.
            way = Wander::new(body, &mut random, way.speed);
        }
        let x = way.x;
        let o = step(&mut contact, body, x);
        assert!(!o.flags.has(Flags::CONTAINED) && force(&o).is_finite(), "{i}: {o:?}");
        assert_eq!(o.flags.has(Flags::IN_CONTACT), o.contact.is_some(), "{i}");
        if o.flags.has(Flags::REANCHORED) {
            flagged += (last.energy.dissipated_j - o.energy.dissipated_j).max(0.0);
        }
        let here = contact.lipschitz_n_per_m(body);
        let odd = |o: &Output| {
            [Flags::BLOCKED, Flags::CAPPED, Flags::BORDER, Flags::REANCHORED, Flags::HELD_BACK]
                .iter()
                .any(|f| o.flags.has(*f))
        };
        let within =
            |o: &Output| o.contact.is_some_and(|c| c.delta_z_m <= range[0] && c.delta_r_m <= range[1]);
        if let (Some(a), Some(b)) = (bound, here)
            && ![&o, &last].into_iter().any(odd)
            && [&o, &last].into_iter().all(within)
        {
            let allowed = BETWEEN * a.max(b) * x.distance(from) + 1e-6;
            let part = (force(&o) - force(&last)).length() / allowed;
            seen.of_bound = seen.of_bound.max(part);
            seen.beyond += u64::from(part > 1.0);
            seen.judged += 1;
        }
        seen.unbounded += u64::from(here.is_none() && o.flags.has(Flags::IN_CONTACT));
        (bound, from) = (here, x);
        seen.given_j = seen.given_j.max(-o.energy.dissipated_j - flagged);
        seen.imbalance = seen.imbalance.max(imbalance(&o));
        seen.moved_j += (o.energy.work_j - last.energy.work_j).abs();
        for (count, flag) in [
            (&mut seen.touched, Flags::IN_CONTACT),
            (&mut seen.held_back, Flags::HELD_BACK),
            (&mut seen.reanchored, Flags::REANCHORED),
            (&mut seen.pulling, Flags::PULLING),
            (&mut seen.capped, Flags::CAPPED),
            (&mut seen.blocked, Flags::BLOCKED),
        ] {
            *count += u64::from(o.flags.has(flag));
        }
        way.next(&o, body, &mut random);
        last = o;
    }
    seen.slips = contact.counters().slips;
    seen
}

#[test]
#[ignore = "needs bodies: PALPATE_BODIES"]
fn bodies_of_users_keep_the_invariants() {
    let Ok(files) = std::env::var("PALPATE_BODIES") else {
        eprintln!("skipped: PALPATE_BODIES names no body");
        return;
    };
    for file in std::env::split_paths(&files) {
        let body = Body::open(&file).unwrap();
        for rule in SlipRule::ALL {
            let seen = lead(&body, rule);
            println!("{}, {rule:?}: {seen:?}", file.file_name().unwrap_or_default().display());
            assert!(seen.touched > STEPS as u64 / 10 && seen.slips > 100, "{seen:?}");
            assert!(seen.imbalance < 1e-9, "{seen:?}");
            assert!(!body.has_tank() || seen.given_j <= ROUNDING_J, "{seen:?}");
            // Of the exact rule, whose drive jumps at edges, nothing is claimed.
            assert!(rule == SlipRule::Exact || seen.beyond * 10_000 <= seen.judged, "{seen:?}");
        }
    }
}
