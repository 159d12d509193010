//! What a contact point's step leaves, and what it takes on a spent budget.

use super::*;
use crate::coupled::Coupled;
use crate::decoupled::Isotropic;
use crate::drive::{Consistent, Exact, Paper};
use crate::kernel::Ablation;
use crate::sensitivity::tests::{ball, coupled_ball, random};
use palpate_body::Body;

/// A moving tool's slip may end 10⁻⁴ of the limit beyond it. That is gone once the tool rests, without
/// c creeping.
#[test]
fn what_a_slip_left_is_gone_once_the_tool_rests() {
    let body = ball(1.0);
    left_at_rest::<Consistent>(&body, SlipRule::Consistent);
    left_at_rest::<Exact>(&body, SlipRule::Exact);
}

/// A contact point on a body prepared for the rule.
fn on(body: &Body, rule: SlipRule) -> PointContact {
    body.prepare(rule);
    PointContact::new(Setting::new(Ablation::None, body.tool().radius_m()), body.has_tank())
}

fn step<L: ForceLaw, R: Rule>(contact: &mut PointContact, body: &Body, tool_position: DVec3) -> Output {
    contact.step::<L, R>(body, tool_position, Flags::default(), &mut Effort::default())
}

fn left_at_rest<R: Rule>(body: &Body, rule: SlipRule) {
    let mut contact = on(body, rule);
    let at = |angle: f64, depth: f64| DVec3::new(libm::sin(angle), 0.0, libm::cos(angle)) * (0.032 - depth);
    step::<Isotropic, R>(&mut contact, body, at(0.0, -1e-3));
    let (mut left, mut last) = (0, DVec3::ZERO);
    for k in 0..2200 {
        let pose = at(5e-4 * f64::from(k), 1e-5 * f64::from(k.min(200)));
        let see = |contact: &mut PointContact| {
            let o = step::<Isotropic, R>(contact, body, pose);
            let at = contact.touching().unwrap();
            let mut kernel = ElementKernel::<Isotropic>::new(body, contact.setting, at.element);
            let evaluation = kernel.evaluate(at.n, pose);
            let drive = R::drive(&mut kernel, at.n, &evaluation);
            let excess = (drive.force - evaluation.limit) / evaluation.limit;
            (evaluation.c, slip::within(&drive, &evaluation), excess, o.flags)
        };
        if k < 200 {
            step::<Isotropic, R>(&mut contact, body, pose);
            continue;
        }
        let (c, within, excess, flags) = see(&mut contact);
        let stride = c.distance(last);
        last = c;
        if within || flags.has(Flags::BLOCKED) || k == 200 {
            continue;
        }
        left += 1;
        assert!(excess < 1.001 * slip::OF_LIMIT, "{rule:?} {k}: {excess} of the limit");
        let mut resting = contact.clone();
        see(&mut resting);
        let (rest, within, excess, _) = see(&mut resting);
        assert!(within, "{rule:?} {k}: {excess} of the limit is left");
        assert!(rest.distance(c) < 0.01 * stride, "{rule:?} {k}: c crept by {}", rest.distance(c));
    }
    assert!(left > 3, "{rule:?}: only {left} slips left anything");
}

/// What is read of the law after a budget was spent: no more than is kept for it, wherever a step is when that happens.
#[test]
fn a_spent_budget_is_closed_within_what_is_kept_for_it() {
    let bodies = [rough(ball(1.0), 0.15), rough(ball(1.0), 0.04), rough(ball(3.0), 0.1)];
    let mut most = 0;
    for (seed, body) in (1..).zip(&bodies) {
        most = most.max(closed::<Paper>(body, SlipRule::Paper, seed));
        most = most.max(closed::<Consistent>(body, SlipRule::Consistent, seed));
        most = most.max(closed::<Exact>(body, SlipRule::Exact, seed));
    }
    assert!(most <= Budget::CLOSING, "{most}");
    // Random leaps come to less than the worst of all.
    assert!(most > 4, "{most}");
}

/// The body with its nodes moved to and fro along their radius.
fn rough(body: Body, by: f64) -> Body {
    let mut unit = random(11);
    let mut parts = body.parts();
    let triangles = parts.surface.elements().iter().map(|e| e.nodes).collect();
    let positions =
        parts.surface.positions().iter().map(|p| *p * (1.0 + by * (2.0 * unit() - 1.0))).collect();
    let mesh = palpate_body::TriangleMesh { positions, triangles };
    parts.surface = palpate_body::Surface::build(&mesh, f64::INFINITY).unwrap();
    parts.lateral_tensors = None;
    Body::new(parts).unwrap()
}

/// The most that steps of random leaps took beyond small budgets, on the body and on a patch of it.
fn closed<R: Rule>(body: &Body, rule: SlipRule, seed: u64) -> u32 {
    let mut contact = on(body, rule);
    let patch = palpate_body::Patch::new(body, [0.0, 0.0, 0.03], 40);
    let (mut unit, mut most) = (random(seed), 0);
    for ground in [body, patch.model()] {
        contact.forget();
        let mut x = DVec3::Z * 0.04;
        for k in 0..20_000 {
            let way = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5) * 2.0;
            x = (x + way * if unit() < 0.5 { 2e-2 } else { 1e-3 }).clamp_length_max(0.045);
            if k % 50 == 0 {
                x = DVec3::Z * 0.04;
                contact.forget();
            }
            let left = (unit() * unit() * 60.0) as u32;
            contact.budget = Budget::CLOSING + left;
            let mut effort = Effort::default();
            contact.step::<Isotropic, R>(ground, x, Flags::default(), &mut effort);
            most = most.max((effort.evaluations + effort.crossings).saturating_sub(left));
        }
    }
    most
}

/// On a spent budget the lateral force was cut to the limit even where the rule bounds another drive: off by all that
/// W's slope along the surface takes from it, in one step.
#[test]
fn a_spent_budget_changes_the_force_by_no_more_than_the_step_could() {
    for ratio in [1.0, 3.0] {
        let body = ball(ratio);
        spent::<Isotropic, Paper>(&body, SlipRule::Paper);
        spent::<Isotropic, Consistent>(&body, SlipRule::Consistent);
        spent::<Isotropic, Exact>(&body, SlipRule::Exact);
    }
    // Where the tool goes farther than the contact point, and less far.
    for curved in [20.0, -20.0] {
        let mut parts = coupled_ball().parts();
        let potentials = parts.coupled.iter_mut().flat_map(|law| &mut law.potentials);
        potentials.for_each(|p| p.curvature = [curved, 0.3 * curved, 0.5 * curved]);
        parts.tool = palpate_body::Tool::Sphere { radius_m: 8e-3 };
        let body = Body::new(parts).unwrap();
        spent::<Coupled, Consistent>(&body, SlipRule::Consistent);
        spent::<Coupled, Exact>(&body, SlipRule::Exact);
    }
}

fn spent<L: ForceLaw, R: Rule>(body: &Body, rule: SlipRule) {
    let above = 0.03 + body.tool().radius_m();
    let mut contact = on(body, rule);
    let at = |angle: f64, depth: f64| {
        let p = DVec3::new(libm::sin(angle), 0.3 * libm::sin(angle), libm::cos(angle)).normalize();
        p * (above - depth)
    };
    step::<L, R>(&mut contact, body, at(0.0, -1e-3));
    for k in 0..400 {
        step::<L, R>(&mut contact, body, at(1e-3 * f64::from(k), 1e-5 * f64::from(k.min(200))));
    }
    // So far that a search takes more than its first guess.
    let stride = if L::COUPLED { 1e-4 } else { 3e-6 };
    let (mut cut_short, mut differ) = (0, 0.0f64);
    for k in 0..300 {
        let pose = at(0.399 + stride * f64::from(k + 1), 2e-3);
        let mut short = contact.clone();
        short.budget = Budget::CLOSING + k % 12;
        let [a, b] =
            [step::<L, R>(&mut short, body, pose), step::<L, R>(&mut contact, body, pose)].map(|o| {
                assert!(o.flags.has(Flags::IN_CONTACT) && !o.flags.has(Flags::BLOCKED));
                (DVec3::from_array(o.force_n), o.flags.has(Flags::CAPPED))
            });
        assert!((a.0 - b.0).length() < 130.0 * stride, "{rule:?} {k}: {} {}", a.0, b.0);
        cut_short += u32::from(a.1);
        let evaluation = short.touching().map(|at| {
            let mut kernel = ElementKernel::<L>::new(body, short.setting, at.element);
            kernel.evaluate(at.n, pose)
        });
        // In a hollow f_t rests below the limit.
        let beyond = evaluation.map_or(0.0, |f| f.lateral_force - f.limit);
        differ = differ.max(if L::COUPLED { beyond.abs() } else { beyond });
    }
    assert!(cut_short > 20, "{rule:?}: {cut_short}");
    // Cut to the limit, f_t itself would have been far off.
    assert!(rule != SlipRule::Consistent || differ > 1e-3, "{differ}");
}
