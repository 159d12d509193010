//! What once went wrong, each as a short story.

mod common;

use common::*;
use glam::DVec3;
use palpate_body::{
    BlendWeights, Body, BodyParts, Curve, Extension, Interpolation, Provenance, Response, SlipRule, Surface,
    Tool, TriangleMesh,
};
use palpate_engine::{Contact, Flags};

/// A tool that slides exactly along a mesh edge: rounding took the coordinate that stands at zero to −1e-16, and the
/// walk went on to the edge's far vertex.
#[test]
fn a_slide_along_an_edge_stops_where_friction_says() {
    let (kz, kr, mu, depth) = (600.0, 500.0, 0.3, 1e-3);
    let body = uniform(&patch(0.1, 6), kz, kr, mu);
    let stop = mu * 100.0 * kz * depth * depth / kr;
    let mut random = Random::new(8);
    for _ in 0..20_000 {
        let element = random.below(body.elements().len()) as u32;
        let (nodes, edge) = (body.element_nodes(element), random.below(3));
        if body.across(element, edge).is_none() {
            continue;
        }
        let (a, b) = (nodes[edge].position, nodes[(edge + 1) % 3].position);
        let along = (b - a).normalize();
        let start = a + (b - a) * random.range(0.1, 0.5);
        let end = start + along * random.range(5e-5, 4e-4);
        let mut contact = Contact::new(&body);
        step(&mut contact, &body, start + DVec3::Z * 1e-4);
        step(&mut contact, &body, start - DVec3::Z * depth);
        let o = step(&mut contact, &body, end - DVec3::Z * depth);
        let expected = end - along * stop.min((end - start).length());
        let c = DVec3::from_array(o.contact.unwrap().position_m);
        assert!((c - expected).length() < 1e-9, "{start} to {end}: {c}, not {expected}");
        assert!(contact.counters().evaluations <= 4, "{:?}", contact.counters());
    }
}

/// A plane with one lateral curve.
fn plane(mesh: &TriangleMesh, lateral: Curve, friction: f64) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    let response = Response { lateral, ..Response::paper(600.0, 500.0, friction, 8e-3, 8e-3).unwrap() };
    Body::new(BodyParts {
        blends: vec![BlendWeights::own(0); surface.positions().len()],
        surface,
        responses: vec![response],
        test_point_nodes: vec![0],
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

/// Lateral curves that soften, or end flat: a Newton iterate shot past the tool and settled at the second root of
/// |f_r| = L, where friction pushes; or it bolted, and c was left far away.
#[test]
fn friction_never_pushes_on_softening_curves() {
    let knots = [0.0, 0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3];
    let soft =
        Curve::through(&knots, &[0.0, 0.4, 0.65, 0.85, 0.95, 1.0], Interpolation::Pchip, Extension::Linear);
    let flat = Curve::hermite(&[0.0, 2e-3], &[0.0, 1.0], &[1000.0, 0.0], Extension::Linear);
    let two_slopes =
        Curve::through(&[0.0, 1e-4, 8e-3], &[0.0, 0.3, 1.0], Interpolation::Linear, Extension::Linear);
    for lateral in [soft.unwrap(), flat.unwrap(), two_slopes.unwrap()] {
        for speed in [0.05, 0.2, 1.0, 5.0] {
            let body = plane(&patch(0.2, 20), lateral.clone(), 0.3);
            let mut random = Random::new(12);
            let mut contact = Contact::new(&body);
            let mut x = DVec3::new(0.001, 0.002, 1e-4);
            step(&mut contact, &body, x);
            let mut c = x.with_z(0.0);
            for i in 0..1500 {
                let way = (random.direction() * speed * 1e-3).with_z(if i < 5 { -2e-4 } else { 0.0 });
                x = (x + way).clamp(DVec3::new(-0.05, -0.05, -1.0), DVec3::new(0.05, 0.05, 1.0));
                let o = step(&mut contact, &body, x);
                let Some(at) = o.contact else { continue };
                // The analytic stop: c on the line from the tool to where it was.
                let lead = x.with_z(0.0) - c;
                let limit = 0.3 * 6e4 * x.z * x.z;
                let (mut low, mut high) = (0.0, lead.length());
                for _ in 0..100 {
                    let middle = 0.5 * (low + high);
                    if lateral.value(middle) > limit { high = middle } else { low = middle }
                }
                let expected = if i == 0 {
                    DVec3::from_array(at.position_m)
                } else {
                    x.with_z(0.0) - lead.normalize_or_zero() * low
                };
                let found = DVec3::from_array(at.position_m);
                // On a flat stretch the deflection hangs on the last digit of the limit: the force does not.
                let pull = |c: DVec3| lateral.value((x.with_z(0.0) - c).length());
                assert!(
                    (pull(found) - pull(expected)).abs() < 1e-5,
                    "step {i} at {speed} m/s: {found}, not {expected}"
                );
                assert!((x.with_z(0.0) - found).dot(lead) >= -1e-12, "friction pushes");
                assert!(!o.flags.has(Flags::CAPPED) && imbalance(&o) < 1e-9);
                c = found;
            }
        }
    }
}

/// Rounding may leave a tool a hair inside; a grazing way then meets the surface's plane far behind its start.
#[test]
fn a_start_a_hair_inside_is_caught_at_any_angle() {
    let body = uniform(&patch(0.08, 4), 600.0, 500.0, 0.3);
    for depth in [0.0, 1e-15, 1e-12, 1e-10, 9e-10] {
        let mut contact = Contact::new(&body);
        step(&mut contact, &body, DVec3::new(0.001, 0.002, -depth));
        let o = step(&mut contact, &body, DVec3::new(0.002, 0.002, -1e-4));
        assert!(o.flags.has(Flags::IN_CONTACT), "{depth}");
    }
}

/// Out of one thin plate and into the next within a step.
#[test]
fn a_fast_tip_that_leaves_one_plate_finds_the_next() {
    let mut mesh = block(DVec3::new(0.03, 0.03, 5e-5), 4);
    let upper = block(DVec3::new(0.03, 0.03, 5e-5), 4);
    let count = mesh.positions.len() as u32;
    mesh.positions.extend(upper.positions.iter().map(|p| *p + DVec3::Z * 4e-3));
    mesh.triangles.extend(upper.triangles.iter().map(|t| t.map(|v| v + count)));
    let body = uniform(&mesh, 600.0, 500.0, 0.3);
    let mut contact = Contact::new(&body);
    let at = |z: f64| DVec3::new(0.001, 0.002, z);
    step(&mut contact, &body, at(1e-3));
    assert!(step(&mut contact, &body, at(-1e-3)).flags.has(Flags::IN_CONTACT));
    let o = step(&mut contact, &body, at(6e-3));
    assert!(
        o.flags.has(Flags::RELEASED) && o.flags.has(Flags::REANCHORED) && o.flags.has(Flags::IN_CONTACT),
        "{:?}",
        o.flags
    );
    assert!(o.force_n[2] < 0.0, "pushed back down");
    assert!(imbalance(&o) < 1e-9);
    // And slowly out of the lower one into the gap: nothing there.
    let mut contact = Contact::new(&body);
    step(&mut contact, &body, at(1e-3));
    step(&mut contact, &body, at(-1e-3));
    assert!(!step(&mut contact, &body, at(1e-3)).flags.has(Flags::IN_CONTACT));
}

/// Spheres: edges and vertices of an open sheet were touched from behind, at twice the radius deep; starts that just
/// touch were taken for inside; and a sphere that hovered booked work.
#[test]
fn a_sphere_touches_only_what_is_in_front_of_it() {
    let radius = 4e-3;
    let ball = |mesh: &TriangleMesh| {
        let surface = Surface::build(mesh, f64::INFINITY).unwrap();
        body_of(surface, Material { kz: &|_| 600.0, kr: &|_| 500.0, friction: &|_| 0.3, radius_m: radius })
    };
    let sheet = ball(&patch(0.08, 4));
    let mut contact = Contact::new(&sheet);
    for i in 0..200 {
        let o = step(&mut contact, &sheet, DVec3::new(0.0013, 0.0017, -0.02 + 1.5e-4 * f64::from(i)));
        assert!(!o.flags.has(Flags::IN_CONTACT) && o.energy.work_j == 0.0, "{i}: {o:?}");
    }
    let body = ball(&ellipsoid(DVec3::new(0.03, 0.04, 0.025), 2));
    for element in 0..body.elements().len() as u32 {
        let [a, b, c] = body.corners(element);
        let (p, out) = ((a + b + c) / 3.0, body.outward(element));
        let mut contact = Contact::new(&body);
        let first = step(&mut contact, &body, p + out * radius);
        assert!(!first.flags.has(Flags::STARTED_INSIDE) && first.energy.work_j == 0.0);
        assert!(
            step(&mut contact, &body, p + out * (radius - 3e-3)).flags.has(Flags::IN_CONTACT),
            "{element}"
        );
    }
}
