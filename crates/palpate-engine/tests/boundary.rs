//! A drag over a patch's boundary: bounded, and without a click, there and when the next patch comes.

mod common;

use common::*;
use glam::DVec3;
use palpate_body::{Patch, SlipRule};
use palpate_engine::{Ablation, Contact, Flags};
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(60))]

    /// The lateral force grew without limit while the contact point waited, and fell back in one step when the next patch
    /// came. (The drive of `exact` jumps at every edge that the contact point comes over.)
    #[test]
    fn a_drag_over_the_boundary_has_no_excess_step(
        seed in any::<u64>(), rule in 0usize..3, radius in prop_oneof![Just(0.0), Just(3e-3)], late in 1u32..60,
    ) {
        let (mut random, rule) = (Random::new(seed), SlipRule::ALL[rule]);
        let plain = heterogeneous(&ellipsoid(DVec3::splat(0.03), 4), &mut random, 0.1, 0.2);
        let tool = palpate_body::Tool::Sphere { radius_m: radius };
        let tool = if radius > 0.0 { tool } else { palpate_body::Tool::Point };
        let body = palpate_body::Body::new(palpate_body::BodyParts { tool, slip: rule, ..plain.parts() }).unwrap().with_tank(false);
        let mut contact = Contact::with_slip(&body, rule, Ablation::None);
        let (along, stride) = (random.range(0.0, 6.0), random.range(2e-5, 3e-4));
        let at = |k: u32| {
            // Down by 2 mm in 200 steps, then over the ball.
            let height = 0.03 + radius - 2e-3 * f64::from(k.min(200)) / 200.0 + 1e-6;
            let angle = stride / 0.03 * f64::from(k.max(200) - 200);
            let side = DVec3::new(libm::cos(along), libm::sin(along), 0.0) * libm::sin(angle);
            (side + DVec3::Z * libm::cos(angle)) * height
        };
        let mut patch = Patch::new(&body, [0.0, 0.0, 0.03], 120);
        let (mut waited, mut since, mut judged, mut last) = (0, 0, 0, None::<(DVec3, f64)>);
        for k in 0..2000 {
            let o = step(&mut contact, patch.model(), at(k));
            let c = o.contact;
            prop_assert!(!o.flags.has(Flags::BORDER) && !o.flags.has(Flags::CAPPED) && (k < 5 || c.is_some()), "{k}: {:?}", o.flags);
            prop_assert!(imbalance(&o) < 1e-9);
            if o.flags.has(Flags::PATCH_BOUNDARY) {
                waited += 1;
                // Friction, and for two of the rules what W's change along the surface takes.
                let u = patch.model().inward(contact.touching().unwrap());
                let normal = force(&o).dot(-u);
                let lateral = (force(&o) + u * normal).length();
                let most = if rule == SlipRule::Paper { 0.23 } else { 1.23 };
                prop_assert!(lateral <= most * normal + 1e-9, "{k}: {lateral} of {normal} N");
                since += 1;
            }
            let bound = contact.lipschitz_n_per_m(patch.model());
            if let (Some((last, l)), Some(m)) = (last, bound) {
                // The bound is that of a tool that moves; behind a boundary the contact point moves too, up to twice as far.
                let excess = (force(&o) - last).length() - 3.0 * m.max(l) * at(k).distance(at(k - 1));
                let mere = if rule == SlipRule::Exact { 5e-3 } else { 1e-4 };
                prop_assert!(excess < mere, "{k}: {excess} N, {:?}", o.flags);
                judged += u32::from(o.flags.has(Flags::PATCH_BOUNDARY));
            }
            last = bound.map(|l| (force(&o), l));
            if since >= late {
                let element = contact.touching().unwrap();
                let next = Patch::new(&body, patch.model().point(element).to_array(), 800);
                prop_assert!(contact.renumber(|e| next.local(patch.global(e))));
                (patch, since) = (next, 0);
                // What is behind now catches up; the next boundary is far.
                if patch.model().elements().len() < 800 { break; }
            }
        }
        prop_assert!(waited >= late, "{waited}");
        prop_assert!(judged > waited / 2, "{judged} of {waited}");
    }
}
