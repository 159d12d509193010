//! A step on a patch is the step on its whole body, and at the patch's edge the contact point waits.

mod common;

#[path = "common/coupled.rs"]
mod coupled;

use common::*;
use glam::DVec3;
use palpate_body::{BlendWeights, Body, BodyParts, BodySource, Patch, SlipRule, StoredBody, Surface, Tool};

use palpate_engine::{Ablation, Contact, Flags, Output, ToolState};
use std::collections::BTreeSet;

/// A block without a lid: creases, a border that runs over them, test points between nodes whose weights fade towards it, and
/// tensors.
fn lidless(rng: &mut Random) -> Body {
    let mut mesh = block(DVec3::splat(0.03), 12);
    mesh.triangles.truncate(mesh.triangles.len() * 4 / 5);
    let used: BTreeSet<u32> = mesh.triangles.iter().flatten().copied().collect();
    let used: Vec<u32> = used.into_iter().collect();
    mesh.positions = used.iter().map(|&v| mesh.positions[v as usize]).collect();
    mesh.triangles.iter_mut().for_each(|t| *t = t.map(|v| used.binary_search(&v).unwrap() as u32));

    let surface = Surface::build(&mesh, 0.5).unwrap();
    let mut fades = vec![false; surface.positions().len()];
    for (e, edge) in surface.border() {
        let nodes = surface.elements()[e].nodes;
        [edge, (edge + 1) % 3].iter().for_each(|&i| fades[nodes[i] as usize] = true);
    }
    let plain = heterogeneous(&mesh, rng, 0.3, 0.2);
    let responses: Vec<_> = plain.curves().iter().step_by(7).cloned().collect();
    let mix = |fades: &bool| {
        let test_points = [(); 3].map(|()| rng.below(responses.len()) as u32);
        let (a, b, left) = (rng.unit(), rng.unit(), if *fades { 0.6 * rng.unit() } else { 1.0 });
        BlendWeights { test_points, weights: [a, b * (1.0 - a), (1.0 - a) * (1.0 - b)].map(|w| w * left) }
    };
    let blends: Vec<BlendWeights> = fades.iter().map(mix).collect();
    let along = fibres(rng, 1.7);
    let frames = surface.positions().iter().zip(surface.inward_normals());
    let body = Body::new(BodyParts {
        coupled: None,
        lateral_tensors: Some(frames.map(|(p, u)| along(*p, *u)).collect()),
        test_point_nodes: vec![0; responses.len()],
        blends,
        responses,
        surface,
        ..plain.parts()
    });
    let body = body.unwrap();
    assert!(body.has_creases() && !body.is_isotropic());
    body
}

/// Bodies of every kind that differs in what a step reads: test points at nodes and between them, tensors, creases, a
/// border, a sphere for a tool.
fn bodies() -> Vec<Body> {
    let mut rng = Random::new(50);
    let round_of = |levels| ellipsoid(DVec3::new(0.03, 0.04, 0.025), levels);
    let round = round_of(4);
    let plain = heterogeneous(&round, &mut rng, 0.35, 0.2);
    let few: Vec<u32> = (0..24).map(|_| rng.below(plain.nodes().len()) as u32).collect();
    let mixed = BodyParts {
        blends: plain
            .nodes()
            .iter()
            .map(|n| {
                let t = |axis: usize| (((n.position[axis] + 0.04) / 0.08 * 23.0) as u32).min(23);
                BlendWeights { test_points: [t(0), t(1), t(2)], weights: [0.5, 0.3, 0.2] }
            })
            .collect(),
        responses: few.iter().map(|&n| plain.curves()[n as usize].clone()).collect(),
        test_point_nodes: few,
        ..plain.parts()
    };
    let ball = BodyParts { tool: Tool::Sphere { radius_m: 2e-3 }, ..plain.parts() };
    vec![
        lidless(&mut rng),
        Body::new(mixed).unwrap(),
        Body::new(ball).unwrap(),
        anisotropic(&torus(0.04, 0.015, 96, 40), &mut rng, 0.3, 0.3, 1.8),
        uniform(&block(DVec3::splat(0.03), 20), 500.0, 400.0, 0.1),
        heterogeneous(&patch(0.08, 50), &mut rng, 0.3, 0.2),
        coupled::sparse(&coupled::coupled(&round_of(3), &mut rng, 0.3, 0.3, 2e-3), 5),
        coupled::coupled(&round_of(3), &mut rng, 0.3, 0.3, 0.0),
        coupled::coupled(&round_of(3), &mut rng, 0.3, 0.3, 0.0).with_partial_slip(true),
        plain.clone().with_partial_slip(true),
        plain,
    ]
}

/// In and out of the surface, and over it.
fn tour(body: &Body, rng: &mut Random, steps: usize) -> Vec<DVec3> {
    let nodes = body.element_nodes(rng.below(body.elements().len()) as u32);
    let (home, down) = (nodes[0].position, nodes[0].inward);
    let along = down.any_orthonormal_vector();
    let bob = |t: f64| -2e-3 + 5e-3 * libm::sin(11.0 * t);
    (0..steps)
        .map(|k| {
            let t = k as f64 * 1e-3;
            home + along * (8e-3 * libm::sin(3.0 * t)) + down * (bob(t) - body.tool().radius_m())
        })
        .collect()
}

#[test]
fn a_step_on_a_patch_is_the_step_on_the_whole_body() {
    let mut rng = Random::new(51);
    let (mut steps, mut taken, mut touched, mut free) = (0, 0, 0, 0);
    for body in bodies() {
        for rule in SlipRule::ALL {
            let mut whole = Contact::with_slip(&body, rule, Ablation::None);
            let mut part = whole.clone();
            let radius = body.tool().radius_m();
            let mut local = Patch::new(&body, [0.0; 3], 1);
            let mut first = true;
            for tip in tour(&body, &mut rng, 900) {
                let (pose, p) = (ToolState::at(tip.to_array()), tip.to_array());
                let away = |at: Option<[f64; 3]>| !at.is_none_or(|at| local.knows(at, radius));
                let points = 1 + usize::from(part.has_partial_slip());
                let touching = part.contact_points().count();
                let lost = touching < points && (away(Some(p)) || away(part.last_position_m()));
                // Anew where it must be, and now and then where it need not.
                if first || lost || rng.below(50) == 0 {
                    let from = |e: u32| local.global(e);
                    let centre = part.touching().map_or(tip, |at| local.model().point(at));
                    // What is free must be known beside what touches.
                    let centre = if touching < points { centre.midpoint(tip) } else { centre };
                    let mut next = Patch::new(&body, centre.to_array(), 400);
                    assert!(first || part.renumber(|e| next.local(from(e))));
                    std::mem::swap(&mut local, &mut next);
                    // Memory that was used before makes no difference.
                    next.take(&body, centre.to_array(), 400);
                    assert_eq!(next.model(), local.model());
                    assert!(local.model().elements().len() < 410 && local.radius_m().is_finite());
                    (first, taken) = (false, taken + 1);
                }
                let expected = step_pose(&mut whole, &body, &pose);
                let step = part.step_where(local.model(), &pose, 1e-3, |at| local.knows(at, radius));
                let mut got = step.expect("known ground");
                if let Some(c) = &mut got.contact {
                    c.element = local.global(c.element);
                }
                assert_eq!(got, expected, "{rule:?} at {tip}");
                steps += 1;
                touched += usize::from(got.flags.has(Flags::IN_CONTACT));
                free += usize::from(!got.flags.has(Flags::IN_CONTACT));
            }
        }
    }
    assert!(
        touched > steps / 4 && free > steps / 4 && taken > steps / 100,
        "{steps} {taken} {touched} {free}"
    );
}

/// Of two contact points one may be free where the other touches. It looked for a touch in what is at hand of the body, also where
/// that is not all: it waits instead, and goes on from where it was.
#[test]
fn a_free_contact_point_waits_where_the_ground_is_not_known() {
    let mesh = ellipsoid(DVec3::new(0.03, 0.025, 0.035), 2);
    let body = coupled::coupled(&mesh, &mut Random::new(20), 0.3, 0.3, 4e-3);
    let mut rng = Random::new(54);
    let mut alone = 0;
    for rule in SlipRule::ALL {
        let one = Contact::with_slip(&body, rule, Ablation::None).with_partial_slip(false);
        let mut partial = one.clone().with_partial_slip(true);
        let mut apart = palpate_engine::PARTIAL_SLIP.map(|share| {
            let mut contact = one.clone();
            contact.set_friction_scale(share);
            contact
        });
        let mut x = DVec3::Z * 0.05;
        for _ in 0..6000 {
            let far = if rng.below(3) == 0 { 2e-2 } else { 3e-3 };
            x = (x + rng.direction() * rng.range(1e-4, far)).clamp_length_max(0.05);
            if rng.below(3) == 0 {
                let at = palpate_body::ContactModel::nearest(&body, x, f64::INFINITY).unwrap().at;
                x = body.point(at) + body.outward(at.element) * rng.range(-1e-3, 5e-4);
            }
            let pose = ToolState::at(x.to_array());
            let touching = partial.contact_points().count();
            if touching == 1 && rng.below(2) == 0 {
                alone += 1;
                let touches = usize::from(apart[0].touching().is_none());
                let output = partial.step_where(&body, &pose, 1e-3, |_| false).expect("one touches");
                let expected = step(&mut apart[touches], &body, x);
                assert_eq!(force(&output), force(&expected) * 0.5);
                assert_eq!(output.contact, expected.contact);
                let energies = apart.each_ref().map(|c| c.energy().work_j);
                assert_eq!(output.energy.work_j, 0.5 * (energies[0] + energies[1]));
                continue;
            }
            if touching == 0 {
                assert!(partial.clone().step_where(&body, &pose, 1e-3, |_| false).is_none());
            }
            let output = partial.step_where(&body, &pose, 1e-3, |_| true).expect("known ground");
            let both = apart.each_mut().map(|c| force(&step(c, &body, x)));
            assert_eq!(force(&output), (both[0] + both[1]) * 0.5);
        }
    }
    assert!(alone > 4, "{alone}");
}

#[test]
fn a_patch_out_of_the_file_is_that_of_the_body_in_memory() {
    let mut rng = Random::new(52);
    let folder = tempfile::tempdir().unwrap();
    let mut touches = 0;
    let path = folder.path().join("x.body");
    for body in bodies() {
        for rule in SlipRule::ALL {
            body.save(&path).unwrap();
            // As it is opened: gradients are there only if they were asked for.
            let whole = Body::open(&path).unwrap();
            let _ = Contact::with_slip(&whole, rule, Ablation::None);
            let stored = StoredBody::open(&path, Some(rule)).unwrap();
            assert_eq!(stored.element_count(), whole.elements().len());
            assert_eq!(stored.extent(), whole.extent());
            let (mut read, mut copied) = (stored.patch(), whole.patch());
            for _ in 0..20 {
                let p = DVec3::from_array([(); 3].map(|()| 0.06 * (rng.unit() - 0.5)));
                let to = p + DVec3::from_array([(); 3].map(|()| 0.2 * (rng.unit() - 0.5)));
                let touch = BodySource::first_touch(&whole, p, to).unwrap();
                touches += usize::from(touch.is_some());
                assert_eq!(BodySource::first_touch(&stored, p, to).unwrap(), touch);
                let at = BodySource::nearest(&stored, p).unwrap();
                assert_eq!(at, BodySource::nearest(&whole, p).unwrap());

                let count = 1 + rng.below(whole.elements().len() / 2);
                stored.take(&mut read, at[0].to_array(), count, &|| ()).unwrap();
                copied.take(&whole, at[0].to_array(), count);
                let [a, b] = [&read, &copied].map(|p| p.model().clone());
                assert_eq!(a, b);
                assert_eq!(a.gradients(), b.gradients());
                assert_eq!(a.gradients().is_some(), rule == SlipRule::Consistent);
                assert_eq!(read.radius_m(), copied.radius_m());
                let numbers = |patch: &Patch| {
                    (0..patch.model().elements().len() as u32).map(|e| patch.global(e)).collect::<Vec<_>>()
                };
                assert_eq!(numbers(&read), numbers(&copied));
            }
        }
    }
    assert!(touches > 50, "{touches}");
}

#[test]
fn at_a_patchs_edge_the_contact_point_waits_and_goes_on() {
    let body = heterogeneous(&ellipsoid(DVec3::splat(0.03), 4), &mut Random::new(52), 0.3, 0.1);
    for rule in SlipRule::ALL {
        let top = DVec3::new(0.0, 0.0, 0.03);
        let small = Patch::new(&body, top.to_array(), 60);
        let mut contact = Contact::with_slip(&body, rule, Ablation::None);
        // Down by 2 mm, then over the ball.
        let path = (0..200).map(|k| {
            let (radius, angle) = (0.031 - 3e-5 * f64::from(k.min(100)), 5e-3 * f64::from(k.max(100) - 100));
            DVec3::new(libm::sin(angle), 0.0, libm::cos(angle)) * radius
        });
        let mut last = Output::default();
        let mut waited = 0;
        for tip in path {
            last = step(&mut contact, small.model(), tip);
            assert!(!last.flags.has(Flags::BORDER) && imbalance(&last) < 1e-9, "{:?}", last.flags);
            waited += usize::from(last.flags.has(Flags::PATCH_BOUNDARY));
        }
        assert!(
            waited > 20 && last.flags.has(Flags::IN_CONTACT) && contact.counters().fenced == waited as u64,
            "{rule:?}"
        );
        let held = last.contact.unwrap();
        // The next patch reaches farther: the contact point runs on to within the limit.
        let next = Patch::new(&body, held.position_m, 2000);
        assert!(contact.renumber(|e| next.local(small.global(e))));
        let mut freed = last;
        for k in 0..200 {
            let angle = 5e-3 * f64::from(100 + k);
            freed =
                step(&mut contact, next.model(), DVec3::new(libm::sin(angle), 0.0, libm::cos(angle)) * 0.028);
            if !freed.flags.has(Flags::PATCH_BOUNDARY) {
                break;
            }
        }
        let moved = DVec3::from_array(freed.contact.unwrap().position_m).distance(held.position_m.into());
        assert!(
            !freed.flags.has(Flags::PATCH_BOUNDARY) && freed.flags.has(Flags::SLIPPING) && moved > 1e-3,
            "{rule:?} {moved}"
        );
        assert!(freed.contact.unwrap().delta_r_m < held.delta_r_m);
        assert!(freed.energy.generated_j <= last.energy.generated_j + 1e-9);
        // A patch without the contact point's element is refused, and nothing is changed.
        let elsewhere = Patch::new(&body, [0.0, 0.0, -0.03], 60);
        assert!(!contact.renumber(|e| elsewhere.local(next.global(e))));
        assert!(contact.touching().is_some());
    }
}

#[test]
fn all_of_a_small_body_is_its_patch() {
    let body = uniform(&cylinder(0.03, 0.1, 24, 11), 500.0, 400.0, 0.1);
    let patch = Patch::new(&body, [1.0, 0.0, 0.0], 4096);
    assert_eq!(patch.radius_m(), f64::INFINITY);
    assert!(patch.model().nodes() == body.nodes() && patch.model().elements() == body.elements());
}
