//! Partial slip: two contact points side by side, with 11/8 and 5/8 of the friction (MODEL 4).

mod common;

#[path = "common/coupled.rs"]
mod bodies;

use bodies::{as_coupled, coupled};
use common::*;
use glam::DVec3;
use palpate_body::{Body, SlipRule};
use palpate_engine::{Ablation, Contact, Flags, Output, PARTIAL_SLIP};

/// A tool that wanders over a body: presses, drags, lets go.
fn wander(body: &Body, seed: u64, steps: usize, mut see: impl FnMut(DVec3) -> Output) {
    let mut random = Random::new(seed);
    let mut hand = Wander::new(body, &mut random, 0.05);
    let mut last = Output::default();
    for _ in 0..steps {
        let x = hand.next(&last, body, &mut random);
        last = see(x);
    }
}

fn lump(seed: u64) -> Body {
    let mut random = Random::new(seed);
    let mesh = ellipsoid(DVec3::new(0.03, 0.025, 0.035), 2);
    coupled(&mesh, &mut random, 0.3, 0.3, 4e-3)
}

/// Force, energies and what happened are those of two contacts with other frictions, to the bit.
#[test]
fn force_and_energies_are_the_means_of_two_contacts() {
    for (seed, rule) in (1..).zip(SlipRule::ALL) {
        let body = lump(seed);
        let contact = || Contact::with_slip(&body, rule, Ablation::None);
        let mut partial = contact().with_partial_slip(true);
        let mut apart = PARTIAL_SLIP.map(|share| {
            let mut contact = contact();
            contact.set_friction_scale(share);
            contact
        });
        let (mut slipped, mut differ, mut onsets, mut touches) = (0, 0.0f64, 0, false);
        wander(&body, 10 + seed, 4000, |x| {
            let output = step(&mut partial, &body, x);
            let both = [0, 1].map(|i: usize| step(&mut apart[i], &body, x));
            let mean = (force(&both[0]) + force(&both[1])) * 0.5;
            assert_eq!(force(&output), mean);
            assert_eq!(output.energy.work_j, 0.5 * (both[0].energy.work_j + both[1].energy.work_j));
            assert_eq!(output.energy.tank_j, 0.5 * (both[0].energy.tank_j + both[1].energy.tank_j));
            assert_eq!(output.contact, both[0].contact.or(both[1].contact));
            assert_eq!(partial.touching(), apart[0].touching().or(apart[1].touching()));
            assert_eq!(partial.energy(), output.energy);
            assert!(imbalance(&output) < 1e-9, "{}", imbalance(&output));
            let now = both.iter().any(|o| o.flags.has(Flags::IN_CONTACT));
            assert_eq!(output.flags.has(Flags::IN_CONTACT), now);
            assert!(!output.flags.has(Flags::ONSET) || !touches, "a contact began in touch");
            assert!(!output.flags.has(Flags::RELEASED | Flags::BORDER) || !now, "a contact ended in touch");
            touches = now;
            slipped += u32::from(output.flags.has(Flags::SLIPPING));
            onsets += u64::from(output.flags.has(Flags::ONSET));
            differ = differ.max(force(&both[0]).distance(force(&both[1])));
            output
        });
        assert!(slipped > 200 && differ > 0.01, "{rule:?}: {slipped} slips, {differ} N apart");
        assert_eq!((partial.counters().onsets, partial.counters().steps), (onsets, 4000));
        assert!(onsets > 0);
    }
}

/// Mindlin's partial slip, on the way there and, at twice its scale (Masing), on the way back: nearer than one contact point is.
#[test]
fn a_drag_and_its_way_back_follow_mindlin() {
    let body = as_coupled(&block(DVec3::splat(0.08), 4), [600.0, 500.0, 0.3], SlipRule::Consistent);
    let depth = 3e-3;
    let at = |x: f64| DVec3::new(x, 0.0, 0.08 - depth);
    // f_t at x m aside, on the way to `far` and back.
    let drag = |partial: bool, far: f64, count: u32| -> [Vec<f64>; 2] {
        let mut contact = Contact::new(&body).with_partial_slip(partial);
        step(&mut contact, &body, DVec3::new(0.0, 0.0, 0.081));
        step(&mut contact, &body, at(0.0));
        let mut led = |x: f64| force(&step(&mut contact, &body, at(x))).x;
        let there = (0..=count).map(|k| -led(far * f64::from(k) / f64::from(count))).collect();
        let back = (0..=count).map(|k| -led(far * (1.0 - 2.0 * f64::from(k) / f64::from(count)))).collect();
        [there, back]
    };
    let limit = drag(false, 3e-3, 10)[0][10];
    let lateral = drag(false, 1e-6, 1)[0][1] / 1e-6;
    let far = 3.0 * limit / lateral;
    let mindlin = |x: f64| 1.0 - (1.0 - (x / 1.5).min(1.0)).powf(1.5);
    let error = |partial: bool| {
        let count = 300;
        let [there, back] = drag(partial, far, count);
        let mut most = 0.0f64;
        for k in 0..=count as usize {
            // In parts of what one contact point needs to slip.
            let way = 3.0 * k as f64 / f64::from(count);
            most = most.max((there[k] / limit - mindlin(way)).abs());
            most = most.max((back[k] / limit - (1.0 - 2.0 * mindlin(way))).abs() / 2.0);
        }
        most
    };
    let [one, two] = [error(false), error(true)];
    assert!((0.18..0.21).contains(&one) && two < 0.08, "{one} {two}");
}

/// Two contact points begin where the one was, so that nothing jumps; of two the one that holds longer stays.
#[test]
fn partial_slip_is_switched_in_touch() {
    let body = lump(5);
    let mut contact = Contact::with_slip(&body, SlipRule::Consistent, Ablation::None);
    let mut random = Random::new(3);
    let mut hand = Wander::new(&body, &mut random, 0.05);
    let mut output = Output::default();
    let (mut switches, mut x) = (0, hand.x);
    for _ in 0..4000 {
        if output.flags.has(Flags::IN_CONTACT)
            && !output.flags.has(Flags::SLIPPING)
            && !contact.has_partial_slip()
        {
            let before = contact.touching();
            contact = contact.with_partial_slip(true);
            assert_eq!(contact.touching(), before);
            let mut still = contact.clone();
            still.set_friction_scale(1e9);
            let felt = force(&step(&mut still, &body, x));
            assert!(felt.distance(force(&output)) < 1e-12);
            switches += 1;
        } else if contact.has_partial_slip() && random.below(20) == 0 {
            let at = contact.touching();
            contact = contact.with_partial_slip(false);
            assert_eq!(contact.touching(), at);
        }
        x = hand.next(&output, &body, &mut random);
        output = step(&mut contact, &body, x);
        assert!(force(&output).is_finite());
    }
    assert!(switches > 10, "{switches}");
}

/// A renumbering that knows the element of one contact point alone changes neither.
#[test]
fn renumbering_takes_both_contact_points_or_none() {
    let body = lump(7);
    let (mut contact, mut seen) = (Contact::new(&body).with_partial_slip(true), 0);
    let mut second = Contact::new(&body);
    second.set_friction_scale(PARTIAL_SLIP[1]);
    wander(&body, 8, 6000, |x| {
        let output = step(&mut contact, &body, x);
        step(&mut second, &body, x);
        if let (Some(a), Some(b)) = (contact.touching(), second.touching())
            && a.element != b.element
        {
            seen += 1;
            for known in [a.element, b.element] {
                let mut moved = contact.clone();
                assert!(!moved.renumber(|e| (e == known).then_some(e + 1)));
                assert_eq!(moved.touching(), Some(a));
                assert_eq!(force(&step(&mut moved, &body, x)), force(&step(&mut contact.clone(), &body, x)));
            }
            assert!(contact.clone().renumber(Some));
        }
        output
    });
    assert!(seen > 20, "{seen}");
}

/// A contact on `body`, and two with one contact point each and the frictions of its two.
fn beside(body: &Body, rule: SlipRule) -> (Contact, [Contact; 2]) {
    let contact = || Contact::with_slip(body, rule, Ablation::None).with_partial_slip(false);
    let apart = PARTIAL_SLIP.map(|share| {
        let mut contact = contact();
        contact.set_friction_scale(share);
        contact
    });
    (contact().with_partial_slip(true), apart)
}

/// Where a tool is that is so far along a surface (m) and so deep (m).
type Way = fn(f64, f64) -> DVec3;

/// A tube and a sheet that end 20 mm from the middle, with the tool's position so far along and so deep.
fn open_bodies() -> [(Body, Way); 2] {
    let side = |s: f64, depth: f64| DVec3::new(0.995, 0.1, 0.0) * (0.0299 - depth) + DVec3::Z * s;
    [
        (uniform(&cylinder(0.03, 0.04, 48, 20), 600.0, 200.0, 0.5), side),
        (uniform(&patch(0.04, 20), 600.0, 200.0, 0.5), |s, depth| DVec3::new(s, 1e-3, -depth)),
    ]
}

/// One contact point alone went over the border: the other one held on, with half the force and without a flag, for as long as it
/// touched, and pressed deeper.
#[test]
fn over_a_border_goes_the_whole_contact() {
    for (body, at) in open_bodies() {
        for rule in SlipRule::ALL {
            let (mut contact, mut apart) = beside(&body, rule);
            let lead = |contact: &mut Contact, [s, depth]: [f64; 2]| step(contact, &body, at(s, depth));
            let press = |k: u32| [10e-3, -1e-3 + 1e-4 * f64::from(k)];
            for k in 0..=40 {
                lead(&mut contact, press(k));
                for contact in &mut apart {
                    lead(contact, press(k));
                }
            }
            assert_eq!(contact.contact_points().count(), 2, "{rule:?}");
            let (mut ended, mut before) = (None, contact.energy());
            for k in 0..400 {
                let pose = [10e-3 + 5e-5 * f64::from(k), 3e-3];
                let output = lead(&mut contact, pose);
                let over = apart.each_mut().map(|c| lead(c, pose).flags.has(Flags::BORDER));
                assert!(imbalance(&output) < 1e-9);
                if over == [false; 2] {
                    assert_eq!(contact.contact_points().count(), 2, "{rule:?} {k}");
                    before = output.energy;
                    continue;
                }
                assert!(over != [true; 2], "{rule:?}: both at once");
                ended = Some((k, output));
                break;
            }
            let (k, output) = ended.expect("the border");
            let told = [Flags::BORDER, Flags::RELEASED, Flags::IN_CONTACT].map(|f| output.flags.has(f));
            assert_eq!(told, [true, true, false], "{rule:?} {k}: {:?}", output.flags);
            assert_eq!((force(&output), output.contact), (DVec3::ZERO, None), "{rule:?}");
            assert_eq!(contact.contact_points().count(), 0);
            // What was stored is gone, and nobody got it.
            assert_eq!(output.energy.stored_j, 0.0);
            assert!(output.energy.dissipated_j > before.dissipated_j + 0.9 * before.stored_j, "{rule:?}");
            assert!(imbalance(&output) < 1e-9 && contact.energy() == output.energy);
            // Back, and deeper: nothing until the tool has left.
            for k in 0..400 {
                let t = f64::from(k) / 400.0;
                let output = lead(&mut contact, [20e-3 * (1.0 - t), 3e-3 + 3e-3 * t]);
                assert_eq!(force(&output), DVec3::ZERO, "{rule:?} {k}: {:?}", output.flags);
                assert!(!output.flags.has(Flags::IN_CONTACT | Flags::ONSET), "{:?}", output.flags);
            }
            lead(&mut contact, [0.0, -2e-3]);
            let again = lead(&mut contact, [0.0, 3e-3]);
            let mut new = beside(&body, rule).0;
            lead(&mut new, [0.0, -2e-3]);
            assert_eq!(contact.contact_points().count(), 2);
            assert!(again.flags.has(Flags::ONSET) && force(&again) == force(&lead(&mut new, [0.0, 3e-3])));
        }
    }
}

/// A contact of which one contact point runs over the border in the step in which it begins comes to nothing, and leaves no trace.
#[test]
fn a_contact_that_begins_over_a_border_comes_to_nothing_as_a_whole() {
    for (body, at) in open_bodies() {
        let (mut one, mut both) = (0, 0);
        for rule in SlipRule::ALL {
            for k in 0..200 {
                let (mut contact, mut apart) = beside(&body, rule);
                let leap = [at(19e-3, -1e-3), at(19e-3 + 5e-5 * f64::from(k), 3e-3)];
                let mut last = Output::default();
                let mut over = [false; 2];
                for x in leap {
                    last = step(&mut contact, &body, x);
                    over = apart.each_mut().map(|c| step(c, &body, x).flags.has(Flags::BORDER));
                }
                one += u32::from(over[0] != over[1]);
                both += u32::from(over == [true; 2]);
                if over == [false; 2] {
                    continue;
                }
                let not = Flags::ONSET | Flags::IN_CONTACT | Flags::RELEASED | Flags::SLIPPING;
                assert!(last.flags.has(Flags::BORDER) && !last.flags.has(not), "{:?}", last.flags);
                assert_eq!((force(&last), contact.energy()), (DVec3::ZERO, Default::default()));
                assert_eq!((contact.counters().onsets, contact.contact_points().count()), (0, 0));
            }
        }
        assert!(one > 20 && both > 20, "{one} {both}");
    }
}

/// Out of one thin plate and into the next within a step: both contact points are released, and both begin anew. The release was not
/// told.
#[test]
fn a_contact_that_ends_and_begins_anew_in_one_step_says_both() {
    let plate = |z: f64| {
        let mesh = block(DVec3::new(0.03, 0.03, 5e-5), 4);
        (mesh.positions.into_iter().map(move |p| p + DVec3::Z * z), mesh.triangles)
    };
    let ((lower, mut triangles), (upper, above)) = (plate(0.0), plate(4e-3));
    let mut positions: Vec<DVec3> = lower.collect();
    let count = positions.len() as u32;
    positions.extend(upper);
    triangles.extend(above.iter().map(|t| t.map(|v| v + count)));
    let body = uniform(&palpate_body::TriangleMesh { positions, triangles }, 600.0, 500.0, 0.3);
    for rule in SlipRule::ALL {
        let (mut contact, _) = beside(&body, rule);
        let at = |z: f64| DVec3::new(0.001, 0.002, z);
        step(&mut contact, &body, at(1e-3));
        let begun = step(&mut contact, &body, at(-1e-3));
        assert!(begun.flags.has(Flags::ONSET) && contact.contact_points().count() == 2);
        let anew = step(&mut contact, &body, at(6e-3));
        let told = [Flags::RELEASED, Flags::REANCHORED, Flags::IN_CONTACT].map(|f| anew.flags.has(f));
        assert_eq!((told, contact.contact_points().count()), ([true; 3], 2), "{rule:?}: {:?}", anew.flags);
    }
}

/// Switched to one contact point the contact vanished, untold, where only the second touched: on a ball, after a drag and its way
/// back to where the first one stayed, a tool that leaves there is still under the second one's tangent plane.
#[test]
fn of_two_contact_points_the_one_that_touches_stays() {
    let body = uniform(&ellipsoid(DVec3::splat(0.03), 4), 600.0, 100.0, 1.0);
    let mut alone = 0;
    for (rule, friction) in SlipRule::ALL.into_iter().flat_map(|rule| [0.3, 0.6, 1.0, 1.5].map(|f| (rule, f)))
    {
        let (mut contact, mut apart) = beside(&body, rule);
        let at = |angle: f64, depth: f64| {
            DVec3::new(libm::sin(angle), 0.02, libm::cos(angle)).normalize() * (0.03 - depth)
        };
        let mut poses = vec![at(0.0, -1e-3)];
        poses.extend((0..=20).map(|k| at(0.0, 1e-4 * f64::from(k))));
        poses.extend((0..=100).map(|k| at(2.5e-3 * f64::from(k), 2e-3)));
        let scale = |contact: &mut Contact, apart: &mut [Contact; 2], scale: f64| {
            contact.set_friction_scale(scale);
            for (contact, share) in apart.iter_mut().zip(PARTIAL_SLIP) {
                contact.set_friction_scale(share * scale);
            }
        };
        scale(&mut contact, &mut apart, friction);
        for x in poses {
            step(&mut contact, &body, x);
            for contact in &mut apart {
                step(contact, &body, x);
            }
        }
        // Held where they are, the tool goes back over the first and leaves.
        scale(&mut contact, &mut apart, 1e3);
        let first = body.point(contact.touching().unwrap());
        let angle = libm::atan2(first.x, first.z);
        for k in 0..400 {
            let x = at(angle, 2e-3 - 6e-6 * f64::from(k));
            let output = step(&mut contact, &body, x);
            let both = apart.each_mut().map(|contact| step(contact, &body, x));
            if !output.flags.has(Flags::IN_CONTACT) {
                break;
            }
            let stays = usize::from(!both[0].flags.has(Flags::IN_CONTACT));
            let mut one = contact.clone().with_partial_slip(false);
            assert_eq!(one.touching(), apart[stays].touching());
            assert_eq!(one.energy(), both[stays].energy);
            let mut alike = apart[stays].clone();
            alike.set_friction_scale(1e3);
            assert_eq!(step(&mut one, &body, x), step(&mut alike, &body, x));
            alone += stays;
        }
    }
    assert!(alone > 20, "{alone}");
}

/// What one contact point alone does is no beginning and no end of the contact.
#[test]
fn leaps_are_told_of_the_whole_contact() {
    let mut alone = 0;
    for (seed, rule) in (20..).zip(SlipRule::ALL) {
        let body = lump(seed);
        let (mut contact, mut apart) = beside(&body, rule);
        let mut random = Random::new(seed);
        let (mut x, mut touched) = (DVec3::Z * 0.05, [false; 2]);
        for _ in 0..6000 {
            x = match random.below(3) {
                0 => (x + random.direction() * random.range(1e-4, 2e-2)).clamp_length_max(0.05),
                1 => (x + random.direction() * 1e-3).clamp_length_max(0.05),
                // Along the surface, now a little above it, now a little below.
                _ => {
                    let at = body.nearest(x + random.direction() * 6e-3, f64::INFINITY).unwrap().at;
                    body.point(at) + body.outward(at.element) * random.range(-2e-3, 5e-4)
                }
            };
            let output = step(&mut contact, &body, x);
            let both = [0, 1].map(|i: usize| step(&mut apart[i], &body, x));
            let [touches, released] =
                [Flags::IN_CONTACT, Flags::RELEASED].map(|f| both.map(|o| o.flags.has(f)));
            let held = (0..2).any(|i| touched[i] && !released[i]);
            assert_eq!(output.flags.has(Flags::RELEASED), released != [false; 2] && !held);
            assert_eq!(output.flags.has(Flags::IN_CONTACT), touches != [false; 2]);
            let begun = touched == [false; 2] && touches != [false; 2];
            assert_eq!(output.flags.has(Flags::ONSET), begun);
            alone += u32::from(touches[0] != touches[1]);
            touched = touches;
        }
    }
    assert!(alone > 0, "{alone}");
}
