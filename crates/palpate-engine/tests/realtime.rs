//! What a real-time loop relies on: no allocation, and no input that the contact does not survive.

mod common;

#[path = "common/coupled.rs"]
mod bodies;

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use bodies::{coupled, sparse};
use common::*;
use glam::DVec3;
use palpate_body::SlipRule;
use palpate_engine::{Ablation, Contact, Flags, ToolState};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn no_step_allocates() {
    let mut rng = Random::new(5);
    // Isotropic, anisotropic, coupled, and coupled with few test points.
    for (kind, law) in (0..4).flat_map(|kind| (0..4).map(move |law| (kind, law))) {
        let mesh = match kind {
            0 => ellipsoid(DVec3::splat(0.03), 3),
            1 => cylinder(0.03, 0.1, 24, 11),
            2 => block(DVec3::splat(0.02), 3),
            _ => patch(0.06, 8),
        };
        let body = match law {
            0 => anisotropic(&mesh, &mut rng, 0.4, 0.3, 1.0),
            1 => anisotropic(&mesh, &mut rng, 0.4, 0.3, 5.0),
            2 => coupled(&mesh, &mut rng, 0.4, 0.3, 2e-3),
            _ => sparse(&coupled(&mesh, &mut rng, 0.4, 0.3, 0.0), 4),
        };
        let ablations = [Ablation::None, Ablation::Coordinates, Ablation::Responses, Ablation::Both];
        for (ablation, rule) in ablations.into_iter().flat_map(|a| SlipRule::ALL.map(|rule| (a, rule))) {
            let mut contact = Contact::with_slip(&body, rule, ablation);
            let mut way = Wander::new(&body, &mut rng, 0.1);
            for _ in 0..2000 {
                // Smooth, jumping, far, and not a number.
                let x = match rng.below(100) {
                    leap @ (0 | 2) => {
                        way = Wander::new(&body, &mut rng, 0.1);
                        rng.direction() * if leap == 0 { 0.05 } else { 1e3 }
                    }
                    1 => DVec3::new(f64::NAN, 0.0, 1.0),
                    _ => way.x,
                };
                let output = assert_no_alloc(|| step(&mut contact, &body, x));
                way.next(&output, &body, &mut rng);
            }
            // Once the tool sank to the body's middle and stayed there: 22 of 2000 steps slipped.
            let c = contact.counters();
            assert!(c.onsets > 10 && c.slips > 500 && c.invalid_poses > 5, "{kind} {law}: {c:?}");
        }
    }
}

#[test]
fn a_contact_survives_poses_that_are_no_numbers() {
    let body = uniform(&ellipsoid(DVec3::splat(0.03), 3), 600.0, 500.0, 0.3);
    let (mut clean, mut dirty) = (Contact::new(&body), Contact::new(&body));
    for i in 0..500 {
        let x = DVec3::new(1e-5 * f64::from(i), 0.0, 0.031 - 1e-4 * f64::from(i.min(40)));
        let expected = step(&mut clean, &body, x);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e7] {
            let pose = ToolState { position_m: [0.0, bad, 0.0], orientation: [1.0, 0.0, 0.0, 0.0] };
            let output = step_pose(&mut dirty, &body, &pose);
            assert!(
                output.flags.has(Flags::INVALID_POSE)
                    && output.force_n == [0.0; 3]
                    && output.contact.is_none()
            );
        }
        let pose = ToolState { position_m: x.to_array(), orientation: [f64::NAN, 0.0, 0.0, 0.0] };
        assert!(step_pose(&mut dirty, &body, &pose).flags.has(Flags::INVALID_POSE));
        assert_eq!(step(&mut dirty, &body, x), expected, "as if nothing had been");
    }
    assert_eq!(dirty.counters().invalid_poses, 3000);
}

#[test]
fn every_force_is_finite_whatever_the_tip_does() {
    let mut rng = Random::new(9);
    for i in 0..40 {
        let mesh = ellipsoid(DVec3::new(0.03, 0.02, 0.04), 2);
        let body = match i / 3 % 5 {
            3 => coupled(&mesh, &mut rng, 0.9, 0.3, 0.0),
            4 => sparse(&coupled(&mesh, &mut rng, 0.9, 0.3, 3e-3), 6),
            law => anisotropic(&mesh, &mut rng, 0.9, 0.3, [1.0, 3.0, 100.0][law]),
        };
        let mut contact = Contact::with_slip(&body, SlipRule::ALL[i % 3], Ablation::None);
        let mut touched = 0;
        for _ in 0..2000 {
            let scale = 10f64.powf(rng.range(-12.0, 3.9));
            let output = step(&mut contact, &body, rng.direction() * scale);
            assert!(force(&output).is_finite() && !output.flags.has(Flags::CONTAINED));
            assert_eq!(force(&output) == DVec3::ZERO, !output.flags.has(Flags::IN_CONTACT));
            touched += usize::from(output.flags.has(Flags::IN_CONTACT));
            let c = contact.counters();
            assert!(c.evaluations <= 64 * 3 * c.steps && c.crossings <= 64 * 3 * c.steps);
        }
        assert!(touched > 50, "{i}: {touched}");
    }
}
