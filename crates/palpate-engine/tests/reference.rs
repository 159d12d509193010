//! The fast step against the slow reference, on random bodies and paths.

#[path = "common/reference.rs"]
mod slow;

mod common;

#[path = "common/coupled.rs"]
mod bodies;

use bodies::{coupled, sparse};
use common::made::{Making, made_body};
use common::*;
use glam::DVec3;
use palpate_body::{Body, SlipRule, TriangleMesh};
use palpate_engine::{Contact, Flags};
use proptest::prelude::*;
use slow::Reference;

fn mesh(kind: usize) -> TriangleMesh {
    match kind {
        0 => ellipsoid(DVec3::splat(0.03), 2),
        1 => ellipsoid(DVec3::new(0.03, 0.04, 0.025), 2),
        2 => torus(0.04, 0.02, 20, 14),
        3 => cylinder(0.03, 0.1, 24, 11),
        _ => patch(0.08, 9),
    }
}

/// What a body's responses are: each node its own, as `fit` makes them, or coupled potentials, one a node or few.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sort {
    Plain,
    Made,
    Coupled,
    Sparse,
}

impl Sort {
    fn is_coupled(self) -> bool {
        matches!(self, Sort::Coupled | Sort::Sparse)
    }
}

fn sort() -> impl Strategy<Value = Sort> {
    (0usize..4).prop_map(|i| [Sort::Plain, Sort::Made, Sort::Coupled, Sort::Sparse][i])
}

/// A random body, for a point, or, unless it is plain, for a sphere with a radius up to `largest`, m.
fn body(sort: Sort, kind: usize, rng: &mut Random, making: Making, largest: f64) -> Body {
    let Making { spread, friction, ratio, slip, .. } = making;
    if sort == Sort::Plain {
        return ruled(&anisotropic(&mesh(kind), rng, spread, friction, ratio), slip);
    }
    let radius_m = if rng.below(2) == 0 { 0.0 } else { rng.range(0.1, 1.0) * largest };
    if sort == Sort::Made {
        return made_body(&mesh(kind), rng, &Making { radius_m, ..making });
    }
    let own = ruled(&coupled(&mesh(kind), rng, spread, friction, radius_m), slip);
    if sort == Sort::Coupled { own } else { sparse(&own, 2 + rng.below(8)) }
}

fn making(spread: f64, friction: f64, ratio: f64, slip: SlipRule) -> Making {
    Making { spread, friction, bare: true, ratio, radius_m: 0.0, slip }
}

/// From above a random element: in, about, and out again.
fn path(body: &Body, rng: &mut Random, steps: usize, spacing: f64) -> Vec<DVec3> {
    let (p, inward) = loop {
        let nodes = body.element_nodes(rng.below(body.elements().len()) as u32);
        let p = (nodes[0].position + nodes[1].position + nodes[2].position) / 3.0;
        if p.z.abs() < 0.03 && p.x.abs().max(p.y.abs()) < 0.06 {
            break (p, nodes[0].inward);
        }
    };
    let side = inward.cross(rng.direction()).normalize();
    let other = inward.cross(side);
    let (bend, deep) = (rng.range(-3.0, 3.0), rng.range(1e-3, 4e-3));
    let mut x = p - inward * (3.37e-4 + body.tool().radius_m());
    let mut path = vec![x];
    let down = (deep / spacing) as usize;
    for i in 0..steps {
        let a = bend * i as f64 / steps as f64;
        x += if i < down { inward } else { side * libm::cos(a) + other * libm::sin(a) } * spacing;
        path.push(x);
    }
    path
}

/// The largest difference of the two forces, relative to the largest force, or to 0.1 N: near the surface the friction
/// limit is far smaller than a step, and the direction of slip is the step size's. And how many steps slipped.
fn difference(body: &Body, path: &[DVec3]) -> (f64, u64) {
    // The slow step has no tank.
    let (mut fast, mut slow) = (Contact::new(body).with_tank(false), Reference::new(body, SlipRule::Paper));
    let (mut worst, mut largest) = (0.0f64, 0.0f64);
    for &x in path {
        let (output, expected) = (step(&mut fast, body, x), slow.step(x));
        if output.flags.has(Flags::BORDER) || output.flags.has(Flags::BLOCKED) {
            break;
        }
        worst = worst.max((force(&output) - expected).length());
        largest = largest.max(expected.length());
    }
    (worst / largest.max(0.1), fast.counters().slips)
}

/// They slip in other step sizes, so they agree better the finer the path is sampled. For points alone: the slow step's
/// onset knows no spheres.
#[test]
fn the_fast_step_follows_the_slow_one() {
    let judged = Judged::default();
    proptest!(cases(32), |(seed in any::<u64>(), kind in 0usize..5, made in any::<bool>(), ratio in ratio(4.0))| {
        let (mut rng, sort) = (Random::new(seed), if made { Sort::Made } else { Sort::Plain });
        let friction = rng.range(0.1, 0.5);
        let body = body(sort, kind, &mut rng, making(0.35, friction, ratio, SlipRule::Paper), 0.0);
        let coarse = path(&body, &mut rng, 120, 1e-4);
        let (error, slid) = difference(&body, &coarse);
        prop_assert!(error < 5e-2, "{error}");
        let fine: Vec<DVec3> = coarse
            .windows(2)
            .flat_map(|w| (0..8).map(move |i| w[0] + (w[1] - w[0]) * (i as f64 / 8.0)))
            .collect();
        let (finer, _) = difference(&body, &fine);
        prop_assert!(finer < (0.3 * error).max(3e-4), "{error} {finer}");
        judged.add(format!("{sort:?}"), slid);
    });
    judged.demand(2, 500);
}

/// The same on coupled bodies: few and short motions, since the slow step takes differences of their
/// energies.
#[test]
fn the_fast_step_follows_the_slow_one_on_coupled_bodies() {
    let mut slid = 0;
    for kind in 0..5 {
        let mut rng = Random::new(70 + kind as u64);
        let own = ruled(&coupled(&mesh(kind), &mut rng, 0.25, 0.3, 0.0), SlipRule::Paper);
        let body = if kind == 1 { sparse(&own, 5) } else { own };
        let coarse = path(&body, &mut rng, 50, 1.5e-4);
        let (error, slips) = difference(&body, &coarse);
        assert!(error < 0.1, "{kind}: {error}");
        let fine: Vec<DVec3> = coarse
            .windows(2)
            .flat_map(|w| (0..4).map(move |i| w[0] + (w[1] - w[0]) * (f64::from(i) / 4.0)))
            .collect();
        let (finer, _) = difference(&body, &fine);
        assert!(finer < 0.4 * error, "{kind}: {error} {finer}");
        slid += slips;
    }
    assert!(slid > 100, "{slid}");
}

/// At the contact point that the fast step found, the force is the law's, and within the friction limit.
#[test]
fn force_and_limit_are_the_laws() {
    let judged = Judged::default();
    proptest!(cases(64), |(seed in any::<u64>(), kind in 0usize..5, sort in sort(), ratio in ratio(20.0))| {
        let mut rng = Random::new(seed);
        let body = body(sort, kind, &mut rng, making(0.5, 0.3, ratio, SlipRule::Paper), 6e-3);
        let spacing = rng.range(1e-5, 2e-3);
        let path = path(&body, &mut rng, 300, spacing);
        let slow = Reference::new(&body, SlipRule::Paper);
        let mut contact = Contact::new(&body).with_tank(false);
        for &x in &path {
            let output = step(&mut contact, &body, x);
            let Some(at) = output.contact else {
                prop_assert_eq!(output.force_n, [0.0; 3]);
                continue;
            };
            let reading = slow.read(at.element as usize, DVec3::from_array(at.position_m), x);
            prop_assert!((at.delta_z_m - reading.depth).abs() < 1e-12);
            prop_assert!((at.delta_r_m - reading.lateral).abs() < 1e-11);
            if output.flags.has(Flags::CAPPED) || output.flags.has(Flags::BLOCKED) {
                continue;
            }
            let error = (force(&output) - reading.force_on_tool()).length();
            // Differences of a coupled law's energies are no better.
            let (relative, absolute) = if sort.is_coupled() { (1e-8, 1e-8) } else { (1e-9, 1e-8) };
            prop_assert!(error < relative * (1.0 + reading.fz), "{error}");
            let excess = reading.fr - reading.limit;
            prop_assert!(excess <= 1.1e-6 * reading.limit + absolute, "{excess} over {}", reading.limit);
            if output.flags.has(Flags::SLIPPING) && reading.limit > 1e-6 {
                prop_assert!(excess >= -1.1e-6 * reading.limit - absolute, "slipped too far: {excess}");
                judged.add(format!("{sort:?}"), 1);
            }
        }
        prop_assert!(imbalance(&step(&mut contact, &body, path[0])) < 1e-9);
    });
    judged.demand(4, 150);
}

/// Where the rule `consistent` or `exact` has slipped, the drive of the slow step is at the limit; and elsewhere within
/// it. Its energies are differenced, so that no formula is shared.
#[test]
fn drive_and_limit_are_the_rules() {
    let judged = Judged::default();
    proptest!(cases(64), |(
        seed in any::<u64>(), kind in 0usize..5, sort in sort(), exact in any::<bool>(), ratio in ratio(10.0),
    )| {
        let mut rng = Random::new(seed);
        let rule = if exact { SlipRule::Exact } else { SlipRule::Consistent };
        let body = body(sort, kind, &mut rng, making(0.35, 0.3, ratio, rule), 6e-3);
        let path = path(&body, &mut rng, 60, 2e-4);
        let slow = Reference::new(&body, rule);
        let mut contact = Contact::new(&body).with_tank(false);
        for &x in &path {
            let slipping = step(&mut contact, &body, x).flags.has(Flags::SLIPPING);
            // A moving tool's slip may end 10⁻⁴ of the limit beyond or below it; at rest it is beyond no more.
            let output = step(&mut contact, &body, x);
            let Some(at) = output.contact else { continue };
            // On an edge the exact drive has two values.
            if output.flags.has(Flags::CAPPED) || output.flags.has(Flags::BLOCKED) || at.n.contains(&0.0) {
                continue;
            }
            let (element, c) = (at.element as usize, DVec3::from_array(at.position_m));
            let reading = slow.read(element, c, x);
            let excess = slow.drive(&reading, element, c, x).length() - reading.limit;
            // A node that blends many potentials sums their gradients as if their tangent planes were its own.
            let tolerance = if sort.is_coupled() && !exact { 5e-3 } else { 2e-6 } * (reading.limit + reading.fr);
            prop_assert!(excess <= tolerance + 1e-6, "{excess} over {}", reading.limit);
            // The exact rule may stop earlier, at an edge where the drive turns round.
            if slipping && reading.limit > 1e-6 && !exact {
                let least = -tolerance - 1e-4 * reading.limit - 1e-6;
                prop_assert!(excess >= least, "slipped too far: {excess}");
            }
            judged.add(format!("{rule:?}, {sort:?}"), u64::from(slipping));
        }
    });
    judged.demand(8, 50);
}
