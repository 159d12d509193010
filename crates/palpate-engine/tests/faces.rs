//! What a step takes and gives: tool states and times that can't be used, another body than the contact's, flags, ledger.

mod common;

use common::*;
use glam::DVec3;
use palpate_body::{Body, BodyParts, BodySource, Patch, Response, SlipRule, StoredBody};
use palpate_engine::{Contact, Flags, Output, ToolState};

fn pressed(body: &Body) -> (Contact, DVec3) {
    let mut contact = Contact::new(body);
    let x = DVec3::new(0.0, 0.0, 0.028);
    step(&mut contact, body, x + DVec3::Z * 4e-3);
    assert!(step(&mut contact, body, x).flags.has(Flags::IN_CONTACT));
    (contact, x)
}

fn ball() -> Body {
    heterogeneous(&ellipsoid(DVec3::splat(0.03), 3), &mut Random::new(1), 0.3, 0.3)
}

/// A quaternion of any length was taken for a rotation.
#[test]
fn an_orientation_that_is_no_rotation_is_refused() {
    let body = ball();
    let (contact, x) = pressed(&body);
    let with = |orientation: [f64; 4]| {
        let mut contact = contact.clone();
        let output = contact.step(&body, &ToolState { position_m: x.to_array(), orientation }, 1e-3);
        (output, *contact.counters())
    };
    let half = 0.5f64.sqrt();
    for good in
        [[1.0, 0.0, 0.0, 0.0], [0.0, half, 0.0, -half], [-0.5, 0.5, 0.5, 0.5], [1.0009, 0.0, 0.0, 0.0]]
    {
        let (output, counters) = with(good);
        assert!(!output.flags.has(Flags::INVALID_POSE) && counters.invalid_poses == 0, "{good:?}");
        assert!(force(&output).length() > 0.1);
    }
    let bad = [[0.0; 4], [1.0, 1.0, 0.0, 0.0], [0.998, 0.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0, 1.0], [1e200; 4]];
    for bad in bad {
        let (output, counters) = with(bad);
        assert!(output.flags.has(Flags::INVALID_POSE) && output.flags.has(Flags::IN_CONTACT), "{bad:?}");
        assert!(force(&output) == DVec3::ZERO && output.contact.is_none() && counters.invalid_poses == 1);
    }
}

#[test]
fn a_time_that_is_none_counts_as_no_time() {
    let body = ball();
    let (mut contact, x) = pressed(&body);
    let expected = step(&mut contact.clone(), &body, x);
    for (dt, valid) in [
        (0.0, true),
        (1e-3, true),
        (1e9, true),
        (-1e-9, false),
        (f64::NAN, false),
        (f64::INFINITY, false),
        (f64::NEG_INFINITY, false),
    ] {
        let output = contact.step(&body, &ToolState::at(x.to_array()), dt);
        assert_eq!(output.flags.has(Flags::INVALID_TIME), !valid, "{dt}");
        assert_eq!(output.force_n, expected.force_n);
    }
    assert_eq!(contact.counters().invalid_times, 4);
}

/// On another body a contact gave forces that meant nothing, and nothing said so.
#[test]
fn another_body_gives_no_force_and_says_so() {
    let body = ball();
    let (contact, x) = pressed(&body);
    let others = [
        heterogeneous(&ellipsoid(DVec3::splat(0.03), 3), &mut Random::new(2), 0.3, 0.3),
        heterogeneous(&ellipsoid(DVec3::new(0.03, 0.03, 0.031), 3), &mut Random::new(1), 0.3, 0.3),
        heterogeneous(&ellipsoid(DVec3::splat(0.03), 2), &mut Random::new(1), 0.3, 0.3),
        Body::new(BodyParts { tool: palpate_body::Tool::Sphere { radius_m: 2e-3 }, ..body.parts() }).unwrap(),
        Body::new(BodyParts {
            responses: body
                .curves()
                .iter()
                .map(|_| Response::paper(500.0, 500.0, 0.3, 8e-3, 8e-3).unwrap())
                .collect(),
            ..body.parts()
        })
        .unwrap(),
    ];
    for other in &others {
        let mut contact = contact.clone();
        let output = step(&mut contact, other, x);
        assert!(output.flags.has(Flags::OTHER_BODY) && output.flags.has(Flags::IN_CONTACT));
        assert!(force(&output) == DVec3::ZERO && output.contact.is_none());
        assert_eq!(contact.counters().other_bodies, 1);
        // Nothing is lost on its own.
        let (here, there) = (step(&mut contact, &body, x), step(&mut contact.clone(), &body, x));
        assert!(here == there && here.contact.is_some());
    }
}

#[test]
fn a_bodys_patches_and_files_are_the_same_body() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.body");
    let mut rng = Random::new(3);
    for body in [
        ball(),
        anisotropic(&patch(0.08, 7), &mut rng, 0.3, 0.2, 3.0),
        uniform(&block(DVec3::splat(0.02), 2), 1.0, 2.0, 0.1),
    ] {
        body.save(&path).unwrap();
        let opened = Body::open(&path).unwrap();
        let stored = StoredBody::open(&path, None).unwrap();
        let mut read = stored.patch();
        stored.take(&mut read, [0.0, 0.0, 0.03], 50, &|| ()).unwrap();
        let identities = [
            opened.identity(),
            ruled(&body, SlipRule::Exact).identity(),
            stored.model_header().identity(),
            read.model().identity(),
            Patch::new(&body, [0.0; 3], 20).model().identity(),
        ];
        assert!(identities.iter().all(|id| *id == body.identity()), "{identities:?}");
    }
}

/// The sums that a port's bookkeeping needs: what came in is stored, went in slip, or relaxed; nothing relaxes yet.
#[test]
fn the_ledger_has_three_verbs() {
    let body = ball();
    let (mut contact, _) = pressed(&body);
    for k in 0..300 {
        let x = DVec3::new(1e-4 * f64::from(k), 0.0, 0.028);
        let e = step(&mut contact, &body, x).energy;
        assert!((e.work_j - e.stored_j - e.dissipated_j - e.relaxed_j).abs() < 1e-15 && e.relaxed_j == 0.0);
    }
    assert_eq!(Output::default().torque_nm, [0.0; 3]);
}
