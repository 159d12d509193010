//! Fast tools: nothing is missed, and the contact begins on the surface.

mod common;

use common::*;
use glam::DVec3;
use palpate_body::{Body, Surface, Tensor, TriangleMesh};
use palpate_engine::{Contact, Flags};

/// Friction so high that the contact point stays where the tool came in.
fn sticky(mesh: &TriangleMesh) -> Body {
    uniform(mesh, 600.0, 500.0, 1e3)
}

/// Distance of a point from the surface, by every element.
fn distance(body: &Body, p: DVec3) -> f64 {
    body.nearest(p, 1.0).map_or(f64::INFINITY, |n| n.distance)
}

#[test]
fn ten_thousand_fast_passes_are_all_caught() {
    let bodies = [
        ellipsoid(DVec3::splat(0.03), 2),
        ellipsoid(DVec3::new(0.03, 0.05, 0.02), 3),
        torus(0.04, 0.015, 24, 12),
        block(DVec3::new(0.02, 0.02, 0.02), 3),
        // Plates of 0.1 mm.
        block(DVec3::new(0.03, 0.03, 5e-5), 4),
        block(DVec3::new(5e-5, 0.02, 0.03), 1),
    ]
    .map(|m| sticky(&m));
    let mut rng = Random::new(1);
    let (mut caught, mut passed) = ([0; 3], 0);
    for pass in 0..10_000 {
        let body = &bodies[pass % bodies.len()];
        // A target on a face, an edge or a vertex, seen from outside all the faces that meet there.
        let element = rng.below(body.elements().len()) as u32;
        let [a, b, c] = body.corners(element);
        let (kind, target) = match pass % 3 {
            0 => {
                let (u, v) = (rng.unit(), rng.unit());
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                (0, a + (b - a) * u + (c - a) * v)
            }
            1 => (1, a + (b - a) * if pass % 2 == 0 { 0.5 } else { rng.unit() }),
            _ => (2, a),
        };
        let mut outward = vec![(b - a).cross(c - a).normalize()];
        let add = |outward: &mut Vec<DVec3>, e: u32| {
            let [a, b, c] = body.corners(e);
            outward.push((b - a).cross(c - a).normalize());
        };
        match kind {
            1 => add(&mut outward, body.across(element, 0).unwrap().0),
            2 => {
                body.around(element, 0, |e, _| add(&mut outward, e));
            }
            _ => {}
        }
        let way = loop {
            let axis = DVec3::AXES[rng.below(3)] * if rng.unit() < 0.5 { 1.0 } else { -1.0 };
            let d = if pass % 5 == 0 { axis } else { rng.direction() };
            if outward.iter().all(|n| d.dot(*n) < -0.05) {
                break d;
            }
            if pass % 5 == 0 && outward.iter().all(|n| (d - n).dot(*n) < -0.05) {
                break (d - outward[0]).normalize();
            }
        };
        // One millisecond at 0.1 to 20 m/s, the target somewhere on the way.
        let length = rng.range(1e-4, 2e-2);
        let before = rng.range(1e-6, 0.95) * length;
        let (from, to) = (target - way * before, target + way * (length - before));
        // Something else may lie before the target: then that is what must be hit.
        let mut contact = Contact::new(body);
        let first = step(&mut contact, body, from);
        if first.flags.has(Flags::STARTED_INSIDE) {
            continue;
        }
        let output = step(&mut contact, body, to);
        if !output.flags.has(Flags::ONSET) {
            // In at one side of an edge and out at the other, or to where the frame at the crossing has no depth; no way is
            // longer than the bodies that are no plates.
            let half = body.nodes().iter().fold(DVec3::ZERO, |half, n| half.max(n.position.abs()));
            let through = pass % bodies.len() > 2
                && (0..3).any(|axis| {
                    let at = |side: f64| from + way * ((side - from[axis]) / way[axis]);
                    let crosses = |p: DVec3| (0..3).all(|i| i == axis || p[i].abs() <= half[i]);
                    let beyond = from[axis].abs() > half[axis] && to[axis].abs() > half[axis];
                    beyond
                        && from[axis] * to[axis] < 0.0
                        && crosses(at(half[axis]))
                        && crosses(at(-half[axis]))
                });
            let depth = (to - target).dot(body.inward(body.nearest(target, 1e-3).unwrap().at));
            assert!(
                !(through && depth > 0.0) && body.nearest(to, 1.0).unwrap().outside,
                "pass {pass}: missed {target} from {from} to {to}"
            );
            passed += 1;
            continue;
        }
        caught[kind] += 1;
        if let Some(at) = output.contact.filter(|_| !output.flags.has(Flags::SLIPPING)) {
            let c = DVec3::from_array(at.position_m);
            assert!(distance(body, c) < 1e-9, "pass {pass}");
            let t = (c - from).dot(way).clamp(0.0, length);
            assert!((from + way * t - c).length() < 1e-9, "pass {pass}: {c} is not on the way");
        }
    }
    assert!(caught.iter().all(|&n| n > 2500) && passed < 500, "{caught:?} {passed}");
}

#[test]
fn a_sphere_is_caught_where_it_first_touches() {
    let mesh = ellipsoid(DVec3::splat(0.03), 4);
    let radius = 4e-3;
    let material = Material { kz: &|_| 600.0, kr: &|_| 500.0, friction: &|_| 1e3, radius_m: radius };
    let mut rng = Random::new(2);
    let fibres = fibres(&mut rng, 10.0);
    let bodies = [None, Some(&fibres as &dyn Fn(DVec3, DVec3) -> Tensor)]
        .map(|tensor| stretched(Surface::build(&mesh, f64::INFINITY).unwrap(), material, tensor));
    for i in 0..1000 {
        let body = &bodies[i % 2];
        let d = rng.direction();
        let mut contact = Contact::new(body);
        let free = step(&mut contact, body, d * (0.03 + radius + 1e-5));
        assert!(!free.flags.has(Flags::IN_CONTACT));
        let depth = rng.range(5e-4, 5e-3);
        let output = step(&mut contact, body, d * (0.03 + radius - depth));
        let at = output.contact.unwrap();
        assert!((at.delta_z_m - depth).abs() < 1.5e-4, "{} {depth}", at.delta_z_m);
        assert!(distance(body, DVec3::from_array(at.position_m)) < 1e-9);
        let expected = 100.0 * 600.0 * at.delta_z_m * at.delta_z_m;
        assert!((force(&output).dot(d) - expected).abs() < 1e-3 * expected + 1e-4);
        let out = step(&mut contact, body, d * (0.03 + radius + 1e-4));
        assert!(!out.flags.has(Flags::IN_CONTACT) && out.flags.has(Flags::RELEASED), "{out:?}");
        assert!(imbalance(&out) < 1e-9, "{out:?}");
    }
}

#[test]
fn a_sphere_passing_fast_is_not_missed() {
    let radius = 2e-3;
    let body = body_of(
        Surface::build(&block(DVec3::new(0.03, 0.03, 5e-5), 4), f64::INFINITY).unwrap(),
        Material { kz: &|_| 600.0, kr: &|_| 500.0, friction: &|_| 1e3, radius_m: radius },
    );
    let mut rng = Random::new(3);
    for _ in 0..2000 {
        let (x, y) = (rng.range(-0.025, 0.025), rng.range(-0.025, 0.025));
        let mut contact = Contact::new(&body);
        let above = rng.range(2.1e-3, 9e-3);
        step(&mut contact, &body, DVec3::new(x, y, above));
        let to = DVec3::new(
            x + rng.range(-2e-3, 2e-3),
            y + rng.range(-2e-3, 2e-3),
            above - rng.range(0.009, 0.02),
        );
        let output = step(&mut contact, &body, to);
        assert!(
            output.flags.has(Flags::ONSET) && output.flags.has(Flags::IN_CONTACT),
            "{x} {y} {above} {to}"
        );
    }
}

#[test]
fn a_tip_that_starts_inside_is_left_alone_until_it_has_left() {
    let body = uniform(&ellipsoid(DVec3::splat(0.03), 3), 600.0, 500.0, 0.3);
    let mut contact = Contact::new(&body);
    for i in 0..300 {
        let output = step(&mut contact, &body, DVec3::X * (i as f64 * 1.5e-4));
        assert!(!output.flags.has(Flags::IN_CONTACT));
        let inside = i as f64 * 1.5e-4 < 0.0298;
        assert!(!inside || output.flags.has(Flags::STARTED_INSIDE), "{i}");
    }
    assert!(step(&mut contact, &body, DVec3::X * 0.028).flags.has(Flags::IN_CONTACT));
}

#[test]
fn free_space_asks_the_surface_only_when_the_clearance_is_used_up() {
    let body = uniform(&ellipsoid(DVec3::splat(0.03), 3), 600.0, 500.0, 0.3);
    let mut contact = Contact::new(&body);
    let queries = |contact: &Contact| contact.counters().queries;
    // The clearance at 50 mm is 20 mm; walking around within it asks nothing.
    step(&mut contact, &body, DVec3::new(0.0, 0.0, 0.05));
    let before = queries(&contact);
    assert_eq!(before, 1);
    for i in 0..1000 {
        let a = f64::from(i) * 0.05;
        let p = DVec3::new(0.009 * libm::cos(a), 0.009 * libm::sin(a), 0.052);
        assert_eq!(step(&mut contact, &body, p).force_n, [0.0; 3]);
    }
    assert_eq!(queries(&contact), before);
    // Beyond it, again and again: two a time, and far fewer times than there are steps.
    for i in 0..4990 {
        step(&mut contact, &body, DVec3::new(0.0, 0.0, 0.08 - 1e-5 * f64::from(i)));
    }
    let asked = queries(&contact) - before;
    assert!((8..30).contains(&asked), "{asked}");
    // In contact nothing is asked.
    assert!(step(&mut contact, &body, DVec3::new(0.0, 0.0, 0.029)).flags.has(Flags::ONSET));
    let before = queries(&contact);
    for i in 0..100 {
        assert!(
            step(&mut contact, &body, DVec3::new(2e-5 * f64::from(i), 0.0, 0.029))
                .flags
                .has(Flags::IN_CONTACT)
        );
    }
    assert_eq!(queries(&contact), before);
}
