//! Passive by construction: over any motion a contact gives back at most what was put in. Slip may raise the stored energy
//! only as far as earlier slip and releases have paid for it, so that what it has dissipated since the contact was made is
//! never below 0: `dissipated_j` of the ledger, re-anchoring included.
//!
//! The short run is part of every test run. The long one, 10⁶ steps a rule:
//!
//! ```text
//! cargo test -p palpate-engine --test tank -- --ignored --nocapture
//! ```

mod common;

#[path = "common/coupled.rs"]
mod coupled;

use common::made::{Making, made_body};
use common::*;
use glam::DVec3;
use palpate_body::{Body, SlipRule, TriangleMesh};
use palpate_engine::{Ablation, Contact, Flags, Output};

/// What a sum of so many energies may be off by, J.
const ROUNDING_J: f64 = 1e-12;

/// Steps on one body.
const STEPS: usize = 1000;

/// Coarse, so that facets are far from the surface they stand for.
fn mesh(random: &mut Random) -> TriangleMesh {
    let size = random.range(0.02, 0.04);
    match random.below(7) {
        0 => ellipsoid(
            DVec3::new(size, random.range(0.02, 0.04), random.range(0.02, 0.04)),
            1 + random.below(2),
        ),
        1 => cylinder(size, 0.1, 8 + random.below(16), 5),
        2 => torus(0.04, 0.4 * size, 16, 8),
        3 => block(DVec3::splat(size), 1 + random.below(3)),
        4 => patch(0.08, 2 + random.below(6)),
        // What a tool that leaves finds itself in again: a valley's other wall, the next sheet.
        5 => {
            let mut valley = patch(0.06, 4 + random.below(6));
            valley.positions.iter_mut().for_each(|p| p.z = 0.8 * p.x.abs());
            valley
        }
        _ => {
            let mut sheets = block(DVec3::new(0.03, 0.03, 5e-4), 1 + random.below(4));
            let (count, upper) = (sheets.positions.len() as u32, sheets.clone());
            sheets.positions.extend(upper.positions.iter().map(|p| *p + DVec3::Z * 4e-3));
            sheets.triangles.extend(upper.triangles.iter().map(|t| t.map(|v| v + count)));
            sheets
        }
    }
}

/// Up to 50 times as stiff in some places as in others, without friction in half of the bodies, and in parts of many; with partial slip
/// in half of them.
fn body(random: &mut Random, slip: SlipRule, law: Law) -> Body {
    let mesh = mesh(random);
    let graded = random.range(1.0, 50.0);
    let friction = if random.below(2) == 0 { 0.0 } else { random.range(0.02, 0.5) };
    let ratio = if random.below(3) == 0 { random.range(1.0, 10.0) } else { 1.0 };
    let radius_m = if random.below(3) == 0 { random.range(1e-3, 6e-3) } else { 0.0 };
    let spread = (graded - 1.0) / (graded + 1.0);
    let partial = random.below(2) == 0;
    if law == Law::Coupled {
        let own = coupled::coupled(&mesh, random, spread.min(0.9), friction, radius_m);
        let body = if random.below(2) == 0 { own } else { coupled::sparse(&own, 4) };
        return body.with_partial_slip(partial);
    }
    let making = Making { spread, friction, bare: true, ratio, radius_m, slip };
    made_body(&mesh, random, &making).with_partial_slip(partial)
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Law {
    Decoupled,
    Coupled,
}

/// What a rule did in all of its steps.
#[derive(Debug, Default)]
struct Done {
    /// The most that any contact had given out at any time, J.
    given_j: f64,
    /// The same without what re-anchoring gave out, which is flagged.
    given_unflagged_j: f64,
    /// Of all contacts, J.
    moved_j: f64,
    touched: u64,
    slips: u64,
    onsets: u64,
    reanchored: u64,
    leaps: u64,
}

/// Wanders over random bodies at any speed, trembles and leaps.
fn lead(slip: SlipRule, law: Law, tank: bool, bodies: usize) -> Done {
    let mut random = Random::new(41);
    let mut done = Done::default();
    for _ in 0..bodies {
        let body = body(&mut random, slip, law);
        let mut contact = Contact::with_slip(&body, slip, Ablation::None).with_tank(tank);
        let mut way = Wander::new(&body, &mut random, 0.05);
        let (mut tremor, mut last, mut flagged) = (0.0, Output::default(), 0.0f64);
        for i in 0..STEPS {
            if i % 100 == 0 {
                way.speed = libm::exp(random.range(libm::log(2e-3), libm::log(2.0)));
                tremor = if random.below(2) == 0 { 0.0 } else { 1e-4 * random.unit() };
            }
            if random.below(60) == 0 {
                way.x += random.direction() * random.range(1e-3, 1e-2);
                done.leaps += 1;
            }
            let o = step(&mut contact, &body, way.x + random.direction() * (tremor * random.unit()));
            if o.flags.has(Flags::REANCHORED) {
                flagged += (last.energy.dissipated_j - o.energy.dissipated_j).max(0.0);
            }
            done.given_j = done.given_j.max(-o.energy.dissipated_j);
            done.given_unflagged_j = done.given_unflagged_j.max(-o.energy.dissipated_j - flagged);
            done.moved_j += (o.energy.work_j - last.energy.work_j).abs();
            done.touched += u64::from(o.flags.has(Flags::IN_CONTACT));
            done.reanchored += u64::from(o.flags.has(Flags::REANCHORED));
            way.next(&o, &body, &mut random);
            last = o;
        }
        done.slips += contact.counters().slips;
        done.onsets += contact.counters().onsets;
    }
    done
}

fn judge(bodies: usize) {
    let steps = (bodies * STEPS) as u64;
    let laws = [Law::Decoupled, Law::Coupled];
    for (slip, law) in SlipRule::ALL.into_iter().flat_map(|slip| laws.map(|law| (slip, law))) {
        let done = lead(slip, law, true, bodies);
        println!("{slip:?}, {law:?}, {steps} steps: {done:?}");
        assert!(done.touched > steps / 4 && done.slips > steps / 10 && done.leaps > steps / 100, "{done:?}");
        assert!(done.onsets > bodies as u64 && done.reanchored > 0, "{done:?}");
        let given = done.given_unflagged_j;
        assert!(given <= ROUNDING_J, "{slip:?}, {law:?} gives out {given} J");
        // Without the tank the very same motions take energy out.
        if slip != SlipRule::Exact {
            let given = lead(slip, law, false, bodies).given_unflagged_j;
            assert!(given > 1e-3, "{slip:?}, {law:?} without the tank gives out {given} J only");
        }
    }
}

#[test]
fn no_motion_takes_out_more_than_it_put_in() {
    judge(30);
}

#[test]
#[ignore = "10⁶ steps a rule"]
fn no_motion_of_a_million_steps_takes_out_more_than_it_put_in() {
    judge(1000);
}
