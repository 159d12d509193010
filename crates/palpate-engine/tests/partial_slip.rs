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
