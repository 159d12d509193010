//! Where energy comes from and goes (MODEL 5).

mod common;

use common::*;
use glam::DVec3;
use palpate_body::{Body, Surface, tensor};
use palpate_engine::{Contact, Flags};

/// Press where the body is soft, drag without friction to where it is stiff, release.
#[test]
fn a_frictionless_drag_from_soft_to_stiff_yields_the_difference() {
    for around in [24, 48, 96] {
        let mesh = cylinder(0.03, 0.1, around, 10);
        let stiffness = |p: DVec3| 600.0 * (1.0 + 0.5 * p.x / 0.03);
        let body = body_of(
            Surface::build(&mesh, f64::INFINITY).unwrap(),
            Material { kz: &stiffness, kr: &|_| 500.0, friction: &|_| 0.0, radius_m: 0.0 },
        );
        let depth = 8e-3;
        let at = |angle: f64, r: f64| DVec3::new(r * libm::cos(angle), r * libm::sin(angle), 0.0);
        let mut contact = Contact::new(&body);
        let pi = std::f64::consts::PI;
        for i in 0..=200 {
            step(&mut contact, &body, at(pi, 0.031 - (depth + 1e-3) * f64::from(i) / 200.0));
        }
        // A step of length h stretches the lateral spring and lets it go again: k_r h²/2 each, which is no part of the
        // law and vanishes with h.
        for i in 0..=400_000 {
            step(&mut contact, &body, at(pi * (1.0 - f64::from(i) / 4e5), 0.03 - depth));
        }
        let mut end = step(&mut contact, &body, at(0.0, 0.03 - depth));
        for i in 0..=200 {
            end = step(&mut contact, &body, at(0.0, 0.022 + (depth + 1e-3) * f64::from(i) / 200.0));
        }
        assert!(!end.flags.has(Flags::IN_CONTACT));
        let stored = |k: f64| 100.0 * k * depth.powi(3) / 3.0;
        let gain = stored(900.0) - stored(300.0);
        assert!((gain - 0.01024).abs() < 1e-8);
        let e = end.energy;
        assert!((-e.work_j - gain).abs() < 1e-3 * gain, "{around}: {} J handed out, not {gain}", -e.work_j);
        assert!((-e.dissipated_j - gain).abs() < 1e-3 * gain, "the ledger says so");
        assert!(e.generated_j >= gain * 0.999);
        assert!(imbalance(&end) < 1e-9);
    }
}

/// On a closed lap the stiffness gradient gives back what it took; friction only takes.
#[test]
fn friction_dissipates_and_generates_nothing_on_a_plane() {
    let material = Material { kz: &|_| 600.0, kr: &|_| 500.0, friction: &|_| 0.3, radius_m: 0.0 };
    for ratio in [1.0, 1.9, 10.0, 100.0] {
        let surface = Surface::build(&patch(0.1, 6), f64::INFINITY).unwrap();
        let axis = DVec3::new(0.6, 0.8, 0.0);
        wander_on_a_plane(&stretched(
            surface,
            material,
            Some(&|_, u| tensor::along(axis, ratio, u).unwrap()),
        ));
    }
}

fn wander_on_a_plane(body: &Body) {
    let mut contact = Contact::new(body);
    let mut random = Random::new(4);
    let mut x = DVec3::new(0.0, 0.0, 1e-3);
    let mut last = step(&mut contact, body, x);
    for i in 0..5000 {
        x += random.direction() * 2e-4;
        x = x.clamp(DVec3::new(-0.03, -0.03, -4e-3), DVec3::new(0.03, 0.03, 2e-3));
        if i < 10 {
            x.z -= 2e-4;
        }
        let o = step(&mut contact, body, x);
        assert!(o.energy.dissipated_j >= last.energy.dissipated_j - 1e-15);
        last = o;
    }
    assert_eq!(contact.counters().capped, 0);
    assert!(last.energy.generated_j < 1e-12 * last.energy.dissipated_j, "{:?}", last.energy);
    assert!(last.energy.dissipated_j > 1e-3);
}

/// Over a border the contact ends, and what was stored is booked.
#[test]
fn at_a_border_the_contact_releases() {
    let body = uniform(&patch(0.04, 4), 600.0, 500.0, 0.1);
    let mut contact = Contact::new(&body);
    step(&mut contact, &body, DVec3::new(0.0, 0.003, 1e-3));
    let mut ended = 0;
    for i in 0..600 {
        let o = step(&mut contact, &body, DVec3::new(1e-4 * f64::from(i), 0.003, -2e-3));
        if o.flags.has(Flags::BORDER) {
            ended += 1;
            assert!(o.flags.has(Flags::RELEASED) && o.force_n == [0.0; 3]);
            assert!((1e-4 * f64::from(i) - 0.02).abs() < 2e-3, "at the border, not elsewhere");
        }
        assert!(imbalance(&o) < 1e-9);
        assert_eq!(o.flags.has(Flags::IN_CONTACT), ended == 0);
    }
    assert_eq!(ended, 1);
    // Around the edge, back above, and down again: touched anew.
    step(&mut contact, &body, DVec3::new(0.06, 0.003, 5e-3));
    step(&mut contact, &body, DVec3::new(0.0, 0.003, 5e-3));
    assert!(step(&mut contact, &body, DVec3::new(0.0, 0.003, -1e-3)).flags.has(Flags::ONSET));
}

/// Sharp on purpose: on a creased cube each face answers along its own normal, right up to the edge, where the contact
/// ends: beyond it the next face has no deflection.
///
/// What was looked for once was a contact that goes on around the edge; there is none, and nobody asked whether it came.
#[test]
fn creases_keep_faces_apart() {
    let surface = Surface::build(&block(DVec3::splat(0.02), 4), 0.5).unwrap();
    let body =
        body_of(surface, Material { kz: &|_| 600.0, kr: &|_| 500.0, friction: &|_| 0.3, radius_m: 0.0 });
    let normal = 6e4 * 4e-6;
    for face in 0..3 {
        // Faces and ways in turn: +z along x, +x along y, +y along z.
        let turned = |v: [f64; 3]| DVec3::from_array([0, 1, 2].map(|i: usize| v[(i + face) % 3]));
        let mut contact = Contact::new(&body);
        step(&mut contact, &body, turned([0.0, 0.001, 0.021]));
        let (mut farthest, mut touched, mut left) = (0.0f64, 0, None);
        for i in 0..900 {
            let way = 5e-5 * f64::from(i);
            let o = step(&mut contact, &body, turned([way, 0.001, 0.018]));
            assert!(imbalance(&o) < 1e-9 && !o.flags.has(Flags::CAPPED), "{o:?}");
            if o.flags.has(Flags::RELEASED) {
                assert!(left.replace(way).is_none() && !o.flags.has(Flags::IN_CONTACT), "{o:?}");
            }
            let Some(c) = o.contact else { continue };
            let along = |v: [f64; 3], axis: DVec3| DVec3::from_array(v).dot(turned(axis.to_array()));
            assert!(left.is_none() && (along(c.position_m, DVec3::Z) - 0.02).abs() < 1e-12);
            // f_z along the face's normal exactly, whatever the lateral part.
            assert!((along(o.force_n, DVec3::Z) - normal).abs() < 1e-9, "{:?}", o.force_n);
            farthest = farthest.max(along(c.position_m, DVec3::X));
            touched += 1;
        }
        // The contact point follows by L/k_r, and is at the edge when the tool is as much beyond it.
        let stop = 0.3 * normal / 500.0;
        assert!(touched > 400 && farthest > 0.02 - 1e-4 && farthest <= 0.02, "{touched} {farthest}");
        assert!((left.unwrap() - (0.02 + stop)).abs() < 1e-4, "{left:?}");
    }
}

/// A concave corner: leaving one wall while inside the other, the tool touches that one at once.
#[test]
fn a_tip_in_a_valley_finds_the_other_wall() {
    let mut mesh = patch(0.06, 8);
    for p in &mut mesh.positions {
        p.z = 0.8 * p.x.abs();
    }
    let surface = Surface::build(&mesh, 0.3).unwrap();
    let body =
        body_of(surface, Material { kz: &|_| 600.0, kr: &|_| 500.0, friction: &|_| 0.2, radius_m: 0.0 });
    let mut contact = Contact::new(&body);
    step(&mut contact, &body, DVec3::new(0.01, 0.001, 0.012));
    let mut both = [false; 2];
    for i in 0..400 {
        let o = step(&mut contact, &body, DVec3::new(0.01 - 5e-5 * f64::from(i), 0.001, 0.004));
        assert!(imbalance(&o) < 1e-9);
        if let Some(c) = o.contact {
            both[usize::from(c.position_m[0] < 0.0)] = true;
        }
    }
    assert!(both[0] && both[1], "{both:?}");
}
