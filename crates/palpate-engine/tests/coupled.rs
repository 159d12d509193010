//! The coupled law in the step: what holds of every law holds of it.

mod common;

#[path = "common/coupled.rs"]
mod bodies;

use bodies::{RANGE_M, as_coupled, coupled, sparse};
use common::*;
use glam::DVec3;
use palpate_body::{Body, Curve, Extension, Potential, SlipRule, Tool, TriangleMesh};
use palpate_engine::{Ablation, Contact, Flags};
use proptest::prelude::*;

fn mesh(kind: usize) -> TriangleMesh {
    match kind {
        0 => ellipsoid(DVec3::splat(0.03), 2),
        1 => ellipsoid(DVec3::new(0.03, 0.04, 0.025), 3),
        2 => torus(0.04, 0.02, 20, 14),
        3 => cylinder(0.03, 0.1, 24, 11),
        _ => patch(0.08, 9),
    }
}

/// One of them, each node its own test point or few test points for all.
fn body(random: &mut Random, kind: usize, friction: f64) -> Body {
    let radius_m = if random.unit() < 0.5 { 0.0 } else { random.range(2e-3, 5e-3) };
    let own = coupled(&mesh(kind), random, 0.25, friction, radius_m);
    if random.unit() < 0.5 { own } else { sparse(&own, 5) }
}

/// Above the middle of a random element that is away from borders, and the way in.
fn place(body: &Body, random: &mut Random) -> (DVec3, DVec3) {
    loop {
        let element = random.below(body.elements().len()) as u32;
        let [a, b, c] = body.element_nodes(element);
        let p = (a.position + b.position + c.position) / 3.0;
        let inward = (a.inward + b.inward + c.inward).normalize();
        if p.z.abs() < 0.035
            && p.x.abs().max(p.y.abs()) < 0.065
            && !(body.elements().len() == 162 && p.length() > 0.02)
        {
            return (p - inward * body.tool().radius_m(), inward);
        }
    }
}

proptest! {
    #![proptest_config(cases(24))]

    /// Stick loops do no work, at any lateral deflection within and beyond the range.
    #[test]
    fn a_loop_in_stick_does_no_work(seed in any::<u64>(), kind in 0usize..5, far in 0.2f64..6.0) {
        let mut random = Random::new(seed);
        let body = body(&mut random, kind, 1e6);
        let (p, inward) = place(&body, &mut random);
        let mut contact = Contact::new(&body);
        let start = p + inward * 4e-3;
        step(&mut contact, &body, p - inward * 1e-3);
        let begin = step(&mut contact, &body, start);
        prop_assume!(begin.flags.has(Flags::IN_CONTACT));
        let (a, b) = (random.direction(), random.direction());
        let [a, b] = [a - inward * a.dot(inward), b - inward * b.dot(inward) * 0.8].map(|v| v * (far * RANGE_M));
        let (mut moved, mut before, mut farthest) = (0.0, begin.energy.work_j, 0.0f64);
        for i in 1..=2000 {
            let t = f64::from(i) * std::f64::consts::TAU / 2000.0;
            let o = step(&mut contact, &body, start + a * libm::sin(t) + b * (libm::sin(2.0 * t) * libm::sin(t)));
            prop_assume!(!o.flags.has(Flags::SLIPPING) && o.flags.has(Flags::IN_CONTACT));
            moved += (o.energy.work_j - before).abs();
            before = o.energy.work_j;
            farthest = farthest.max(o.contact.unwrap().delta_r_m);
        }
        let end = step(&mut contact, &body, start);
        let work = end.energy.work_j - begin.energy.work_j;
        prop_assert!(work.abs() <= 1e-12 * moved, "{work} of {moved}");
        prop_assert!(far < 2.0 || farthest > RANGE_M, "{farthest}");
    }

    /// The force is the energy's gradient in stick: W's difference over a small step.
    #[test]
    fn in_stick_the_force_is_the_energys_gradient(seed in any::<u64>(), kind in 0usize..5) {
        let mut random = Random::new(seed);
        let body = body(&mut random, kind, 1e6);
        let (p, inward) = place(&body, &mut random);
        let mut contact = Contact::new(&body);
        let mut x = p - inward * 1e-3;
        step(&mut contact, &body, x);
        x = p + inward * 3e-3 + random.direction() * 1e-3;
        let begin = step(&mut contact, &body, x);
        prop_assume!(begin.flags.has(Flags::IN_CONTACT));
        for _ in 0..50 {
            let h = random.direction() * 1e-7;
            let (mut up, mut down) = (contact.clone(), contact.clone());
            let (a, b) = (step(&mut up, &body, x + h), step(&mut down, &body, x - h));
            let slope = (a.energy.stored_j - b.energy.stored_j) / (2.0 * h.length());
            let here = step(&mut contact, &body, x);
            prop_assert!((slope + force(&here).dot(h.normalize())).abs() < 1e-5 * (0.01 + force(&here).length()));
            x += random.direction() * 1e-4;
        }
    }

    /// A slow press, drag and release: onset, release and slip are continuous, the ledger closes, the limit holds, and slip
    /// is found in few evaluations.
    #[test]
    fn press_drag_and_release_are_continuous(seed in any::<u64>(), kind in 0usize..5, rule in 0usize..2, mu in 0.05f64..0.6) {
        let mut random = Random::new(seed);
        let body = body(&mut random, kind, mu);
        let rule = [SlipRule::Paper, SlipRule::Consistent][rule];
        let (p, inward) = place(&body, &mut random);
        let mut contact = Contact::with_slip(&body, rule, Ablation::None).with_tank(false);
        let side = inward.cross(random.direction()).normalize();
        let mut path = vec![];
        for i in 0..=400 { path.push(p + inward * (-3e-4 + 1e-5 * f64::from(i))); }
        for i in 0..=600 { path.push(p + inward * 3.7e-3 + side * (1e-5 * f64::from(i))); }
        for i in 0..=400 { path.push(p + inward * (3.7e-3 - 1.5e-5 * f64::from(i)) + side * 6e-3); }
        let (mut last, mut bound) = (DVec3::ZERO, 0.0f64);
        for (i, &x) in path.iter().enumerate() {
            let o = step(&mut contact, &body, x);
            prop_assert!(!o.flags.has(Flags::CAPPED), "{:?}", o);
            prop_assume!(!o.flags.has(Flags::BORDER) && !o.flags.has(Flags::BLOCKED));
            prop_assert!(imbalance(&o) < 1e-9);
            let held = o.flags.has(Flags::IN_CONTACT);
            let now = if held { contact.lipschitz_n_per_m(&body).unwrap_or(f64::INFINITY) } else { 0.0 };
            prop_assume!(now < 8e3);
            let way = if i > 0 { (x - path[i - 1]).length() } else { 0.0 };
            let excess = (force(&o) - last).length() - 1.05 * bound.max(now) * way;
            prop_assert!(excess < 1e-5, "step {i}: {excess} N {} {:?}", bound.max(now), o);
            (last, bound) = (force(&o), now);
        }
        prop_assert_eq!(last, DVec3::ZERO);
        let c = contact.counters();
        prop_assert!(c.evaluations <= 4 * c.slips + 50, "{:?}", c);
    }
}

/// A contact that is let go in stick, with friction that holds whatever is dragged: f → 0 with δz all the same.
#[test]
fn a_stuck_contact_releases_continuously() {
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let body = body(&mut random, seed as usize % 5, 0.8);
        let (p, inward) = place(&body, &mut random);
        let mut contact = Contact::new(&body);
        let side = inward.cross(random.direction()).normalize() * 1.5e-3;
        step(&mut contact, &body, p - inward * 1e-3);
        step(&mut contact, &body, p + inward * 2e-3);
        let mut last = force(&step(&mut contact, &body, p + inward * 2e-3 + side));
        for i in 0..6000 {
            let o = step(&mut contact, &body, p + inward * (2e-3 - 5e-7 * f64::from(i)) + side);
            let jump = (force(&o) - last).length();
            assert!(jump < 5e-3, "{seed}: {jump} N at step {i}: {o:?}");
            last = force(&o);
        }
        assert_eq!(last, DVec3::ZERO);
    }
}

/// A decoupled law written as a coupled one gives the same forces: on a plane to rounding, on a ball to the second order of
/// the angle between its nodes' tangent planes and the contact's.
#[test]
fn a_decoupled_law_is_a_special_case() {
    for rule in SlipRule::ALL {
        for (mesh, most) in [(patch(0.08, 9), 1e-9), (ellipsoid(DVec3::splat(0.03), 3), 1e-3)] {
            let plain = ruled(&uniform(&mesh, 500.0, 400.0, 0.3), rule);
            let other = as_coupled(&mesh, [500.0, 400.0, 0.3], rule);
            let mut contacts =
                [&plain, &other].map(|b| Contact::with_slip(b, rule, Ablation::None).with_tank(false));
            let top = if mesh.positions.len() == 100 { DVec3::ZERO } else { DVec3::Z * 0.03 };
            let (mut slid, mut worst, mut largest) = (0, 0.0f64, 0.0f64);
            for i in 0..1200 {
                let t = f64::from(i) * 1e-3;
                let down = 2.5e-3 * libm::sin(9.0 * t) + 5e-4;
                let x = top + DVec3::new(5e-3 * libm::sin(7.0 * t) + 3e-4, 4e-3 * libm::sin(11.0 * t), -down);
                let a = step(&mut contacts[0], &plain, x);
                let b = step(&mut contacts[1], &other, x);
                assert_eq!(a.flags.has(Flags::IN_CONTACT), b.flags.has(Flags::IN_CONTACT), "{rule:?} {i}");
                worst = worst.max((force(&a) - force(&b)).length());
                largest = largest.max(force(&a).length());
                slid += usize::from(a.flags.has(Flags::SLIPPING) && b.flags.has(Flags::SLIPPING));
            }
            println!("{rule:?}: {worst:.2e} of {largest:.2} N, {slid} slips");
            assert!(
                worst <= most * largest && slid > 200 && largest > 0.2,
                "{rule:?}: {worst} of {largest} N, {slid}"
            );
        }
    }
}

/// A stuck stiffness that falls with depth takes f_z to 0 far laterally, at a positive depth. The limit is 0 there: the contact
/// point follows, no force jumps, and the contact goes on.
#[test]
fn where_the_normal_force_vanishes_the_contact_goes_on() {
    let mut parts = as_coupled(&patch(0.08, 9), [300.0, 400.0, 1e4], SlipRule::Paper).parts();
    for potential in &mut parts.coupled.as_mut().unwrap().potentials {
        let softer =
            |k: f64| Curve::hermite(&[0.0, 8e-3], &[k, 0.2 * k], &[0.0; 2], Extension::Constant).unwrap();
        potential.stiffness = [softer(600.0), softer(0.0), softer(600.0)];
    }
    let body = Body::new(parts).unwrap();
    for (rule, tank) in SlipRule::ALL.into_iter().flat_map(|rule| [(rule, false), (rule, true)]) {
        let mut steepest = [0.0f64; 2];
        let (mut least, mut slid) = (f64::INFINITY, 0);
        for (fine, steepest) in steepest.iter_mut().enumerate() {
            let spacing = [1e-5, 1e-6][fine];
            let mut contact = Contact::with_slip(&body, rule, Ablation::None).with_tank(tank);
            step(&mut contact, &body, DVec3::new(-1e-2, 1e-3, 1e-3));
            let mut last = force(&step(&mut contact, &body, DVec3::new(-1e-2, 1e-3, -2e-3)));
            for i in 1..=(1.5e-2 / spacing) as u32 {
                let o = step(&mut contact, &body, DVec3::new(-1e-2 + spacing * f64::from(i), 1e-3, -2e-3));
                assert!(o.flags.has(Flags::IN_CONTACT) && imbalance(&o) < 1e-9, "{rule:?} {i} {o:?}");
                *steepest = steepest.max((force(&o) - last).length());
                last = force(&o);
                least = least.min(last.z);
                slid += usize::from(o.flags.has(Flags::SLIPPING));
            }
        }
        println!("{rule:?} {tank}: steps {steepest:?} N, least f_z {least:.2e} N, {slid} slips");
        assert!(slid > 100 && least < 1e-3, "{rule:?} {tank}: {slid} {least}");
        assert!(steepest[1] < 0.15 * steepest[0], "{rule:?} {tank}: {steepest:?}");
    }
}

/// Subdividing a plane changes nothing where the potentials are linear in the place, so that both meshes have
/// the same.
#[test]
fn a_finer_coupled_plane_is_the_same_plane() {
    let mut slid = 0;
    for seed in 0..12 {
        let mut random = Random::new(seed);
        let base = coupled(&patch(0.08, 2), &mut random, 0.0, 0.3, 0.0).parts().coupled.unwrap();
        let slope = DVec3::new(random.range(-4.0, 4.0), random.range(-4.0, 4.0), 0.0);
        let rule = SlipRule::ALL[seed as usize % 2];
        let build = |cells| {
            let mut parts = as_coupled(&patch(0.08, cells), [500.0, 400.0, 0.3], rule).parts();
            let places = parts.surface.positions().to_vec();
            for (potential, p) in parts.coupled.as_mut().unwrap().potentials.iter_mut().zip(places) {
                *potential = scaled(&base.potentials[0], 1.0 + slope.dot(p));
            }
            Body::new(parts).unwrap()
        };
        let (coarse, fine) = (build(3), build(3 * (2 + seed as usize % 4)));
        let mut contacts = [&coarse, &fine].map(Contact::new);
        let mut x = DVec3::new(0.001, 0.002, 5e-4);
        for i in 0..300 {
            x += random.direction() * 2e-4;
            x.z = if i < 10 { x.z.min(4e-4 - 2e-4 * f64::from(i)) } else { x.z.clamp(-4e-3, -2e-4) };
            let [a, b] = [(0, &coarse), (1, &fine)].map(|(i, body)| step(&mut contacts[i], body, x));
            let apart = (force(&a) - force(&b)).length();
            assert!(apart < 1e-6 * (0.1 + force(&a).length()), "{seed} {rule:?} {i}: {apart} N");
            slid += usize::from(a.flags.has(Flags::SLIPPING));
        }
    }
    assert!(slid > 1000, "{slid}");
}

/// A potential with all of its energies times a factor.
fn scaled(potential: &Potential, factor: f64) -> Potential {
    let curve = |c: &Curve| {
        let ordinates: Vec<_> = c.ordinates().iter().map(|b| b.map(|y| y * factor)).collect();
        Curve::from_ordinates(c.knots(), &ordinates, c.extension()).unwrap()
    };
    Potential {
        tangents: potential.tangents,
        press: curve(&potential.press),
        offset: potential.offset.each_ref().map(curve),
        stiffness: potential.stiffness.each_ref().map(curve),
        cubic: potential.cubic.each_ref().map(curve),
        quartic: curve(&potential.quartic),
        friction: potential.friction.clone(),
        curvature: potential.curvature,
    }
}

/// A ball that slides over a cylinder goes farther than its contact point around it, and as far along it: where the test points say how
/// the surface is curved, the hand works against μ f_z for each metre of its own way, in every direction.
#[test]
fn friction_counts_the_tools_way() {
    const ROUND: f64 = 0.03;
    const BALL: f64 = 8e-3;
    const DEPTH: f64 = 3e-3;
    const MU: f64 = 0.3;
    // Around it, along it, and both at once.
    for (kind, [round, along]) in [("around", [1.0, 0.0]), ("along", [0.0, 1.0]), ("aslant", [0.8, 0.6])] {
        for rule in [SlipRule::Consistent, SlipRule::Exact] {
            let found = [0.0, 1.0 / ROUND].map(|curved| {
                let mesh = cylinder(ROUND, 0.1, 120, 51);
                let mut parts = as_coupled(&mesh, [500.0, 700.0, MU], rule).parts();
                parts.tool = Tool::Sphere { radius_m: BALL };
                let normals = parts.surface.inward_normals().to_vec();
                for (p, u) in parts.coupled.iter_mut().flat_map(|law| &mut law.potentials).zip(normals) {
                    let [x, y] = p.tangents.map(|t| t.dot(DVec3::Z.cross(u)));
                    p.curvature = [x * x, x * y, y * y].map(|k| k * curved);
                }
                let body = Body::new(parts).unwrap();
                let mut contact = Contact::new(&body);
                let above = ROUND + BALL;
                let at = |angle: f64, z: f64, depth: f64| {
                    let (sin, cos) = libm::sincos(angle);
                    DVec3::new((above - depth) * cos, (above - depth) * sin, z)
                };
                let mut x = at(0.01, -0.02, -1e-4);
                step(&mut contact, &body, x);
                for i in 0..=50 {
                    x = at(0.01, -0.02, DEPTH * f64::from(i) / 50.0);
                    step(&mut contact, &body, x);
                }
                // Of the hand's way once all slips, and of μ f_z along it; and the lateral force's.
                let (mut work, mut held, mut lateral) = (0.0, 0.0, 0.0);
                for i in 0..2000 {
                    let s = 2e-5 * f64::from(i);
                    let next = at(0.01 + s * round / (above - DEPTH), -0.02 + s * along, DEPTH);
                    let output = step(&mut contact, &body, next);
                    if i > 1000 {
                        let c = output.contact.unwrap();
                        work -= force(&output).dot(next - x);
                        let (f, u) = (force(&output), DVec3::new(next.x, next.y, 0.0).normalize());
                        held += MU * 100.0 * 500.0 * c.delta_z_m.powi(2) * (next - x).length();
                        lateral += (f - u * u.dot(f)).length() * (next - x).length();
                    }
                    x = next;
                }
                [work / held, lateral / held]
            });
            let stretched = round / (1.0 + (BALL - DEPTH) / ROUND);
            assert!((found[0][0] - stretched.hypot(along)).abs() < 0.02, "{kind}, {rule:?}: {found:?}");
            // Straight against the hand: the force is no larger than what works.
            assert!(found[1].iter().all(|f| (f - 1.0).abs() < 0.005), "{kind}, {rule:?}: {found:?}");
            assert!(found[1][1] - found[1][0] < 2e-3, "{kind}, {rule:?}: {found:?}");
        }
    }
}

/// Pressed straight in, a body that leans aside by more than its press pushes would pull the tool in once its
/// contact point has gone where W is least: the step says so, and of one that pushes never.
#[test]
fn a_normal_force_that_pulls_is_flagged() {
    for (lean, pulls) in [(2.0, true), (0.05, false)] {
        let mut parts = as_coupled(&patch(0.08, 9), [300.0, 500.0, 0.1], SlipRule::Consistent).parts();
        for potential in &mut parts.coupled.as_mut().unwrap().potentials {
            potential.offset[0] =
                Curve::hermite(&[0.0, 8e-3], &[0.0, lean], &[0.0; 2], Extension::Constant).unwrap();
        }
        let body = Body::new(parts).unwrap();
        let mut contact = Contact::new(&body);
        let mut pulled = 0;
        for i in 0..400 {
            let o = step(&mut contact, &body, DVec3::new(1e-3, 2e-3, 1e-3 - 1e-5 * f64::from(i)));
            // The plane's outside is up.
            assert_eq!(o.flags.has(Flags::PULLING), force(&o).z < 0.0, "{lean} {i}: {o:?}");
            pulled += usize::from(o.flags.has(Flags::PULLING));
        }
        assert_eq!(pulled > 0, pulls, "{lean}: {pulled}");
    }
}
