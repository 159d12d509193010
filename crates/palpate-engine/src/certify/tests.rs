//! The formulas against finite differences of the engine's own energy and drive, and bounds against states.

use super::*;
use crate::Flags;
use crate::coupled::Coupled;
use crate::decoupled::{Anisotropic, Isotropic};
use crate::drive::{Consistent, Exact, Paper, Rule};
use crate::force_law::ForceLaw;
use crate::kernel::{Ablation, ElementKernel, Setting};
use crate::sensitivity;
use crate::sensitivity::tests::{ball, coupled_ball, random};
use glam::DVec3;
use palpate_body::{BlendWeights, Body, SlipRule, SurfacePoint};

fn anywhere(unit: &mut impl FnMut() -> f64) -> [f64; 3] {
    let (a, b) = (unit(), unit());
    let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
    [a, b, 1.0 - a - b]
}

/// Straight along the drive, from any overshoot.
const EXACT: Assumptions =
    Assumptions { step_m: 1.0, depth_m: None, aside_rad: 0.0, friction_factor: 1.0, slip: SlipRule::Paper };

#[test]
fn formulas_are_those_of_finite_differences() {
    compare::<Isotropic>(&[1.0].map(ball));
    compare::<Anisotropic>(&[3.0, 60.0].map(ball));
}

fn compare<L: ForceLaw>(bodies: &[Body]) {
    let mut unit = random(11);
    let mut compared = 0;
    for case in 0..3000 {
        let body = &bodies[case % bodies.len()];
        let element = (unit() * body.elements().len() as f64) as u32;
        let patch = ElementStates::new(body, element, &EXACT);
        let n = anywhere(&mut unit).map(|n| 0.02 + 0.94 * n);
        let (depth, azimuth, reach) = (1e-4 + 7e-3 * unit(), 6.0 * unit(), 3e-4 + 6e-3 * unit());
        let state = Cell { corners: [n; 3], depth_m: [depth; 2], azimuth: [azimuth; 2], reach_m: [reach; 2] };
        let at = patch.state(&state);
        let (tool_position, d) = (at.tool_position, at.along);
        let setting = Setting::new(Ablation::None, body.tool().radius_m());
        let mut kernel = ElementKernel::<L>::new(body, setting, element);
        let f = kernel.evaluate(n, tool_position);
        assert!((f.depth - depth).abs() < 1e-12 && (kernel.stretch.rho(&f) - reach).abs() < 1e-12);
        if f.lateral_force < f.limit {
            assert_eq!(Criterion::Passive.bound(&patch, &state), f64::INFINITY);
            continue;
        }
        compared += 1;

        let forces = f.normal + patch.law.lateral_at(n, reach);
        // g·t by differences of W at a fixed tool position.
        let inward = -body.outward(element);
        let project = |v: DVec3| (v - inward * v.dot(inward)).normalize();
        let h = 2e-8;
        let mut energy = |t: DVec3, s: f64| {
            let rates = kernel.rates(t).each();
            kernel.evaluate([0, 1, 2].map(|i| n[i] + s * rates[i]), tool_position).energy
        };
        let mut out = |t: DVec3| (energy(t, -h) - energy(t, h)) / (2.0 * h) / forces;
        let expected = if L::ISOTROPIC { out(d) } else { out(d).min(out(project(f.u_t))) };
        let got = Criterion::Passive.bound(&patch, &state);
        assert!((got - expected).abs() < 1e-6, "case {case}: {got} {expected}");

        // η of the slip search itself, for each metre of way.
        let f = kernel.evaluate(n, tool_position);
        let drift = kernel.drift(n, &f, f.u_t);
        let speed = (f.u_t - inward * f.u_t.dot(inward)).length();
        let (got, expected) = (Criterion::SnapFree.bound(&patch, &state), drift.eta / speed);
        let scale = drift.force.length() + f.lateral_slope + f.lateral_force / f.lateral;
        assert!((got - expected).abs() < 1e-9 * scale, "case {case}: {got} {expected}");

        let at = SurfacePoint { element, n };
        if let Some(expected) =
            sensitivity::lipschitz(body, setting, SlipRule::Paper, at, tool_position).filter(|l| *l < 1e5)
        {
            let got = -Criterion::Lipschitz.bound(&patch, &state);
            let worst = if L::ISOTROPIC { 3.0 } else { 100.0 };
            assert!(got > expected * (1.0 - 1e-6) && got < expected * worst, "case {case}: {got} {expected}");
        }
    }
    assert!(compared > 500, "{compared}");
}

/// The ball, and one whose nodes blend three test points' curves.
fn bodies(ratio: f64) -> [Body; 2] {
    own_and_mixed(ball(ratio))
}

fn own_and_mixed(own: Body) -> [Body; 2] {
    let mut mixed = own.parts();
    let count = mixed.test_point_nodes.len() as u32;
    for (n, mix) in (0..).zip(&mut mixed.blends) {
        *mix = match n % 3 {
            0 => BlendWeights { test_points: [0, 7, 19], weights: [0.2, 0.5, 0.3] },
            1 => BlendWeights { test_points: [0, 7, 19], weights: [0.7, 0.0, 0.3] },
            _ => BlendWeights {
                test_points: [n, (n + 5) % count, (n + 9) % count],
                weights: [0.25, 0.25, 0.5],
            },
        };
    }
    [own, Body::new(mixed).unwrap()]
}

#[test]
fn drives_are_those_of_the_engine() {
    drives::<Isotropic, Consistent>(&bodies(1.0), SlipRule::Consistent);
    drives::<Anisotropic, Consistent>(&[bodies(2.0), bodies(20.0)].concat(), SlipRule::Consistent);
    drives::<Isotropic, Exact>(&bodies(1.0), SlipRule::Exact);
    drives::<Anisotropic, Exact>(&bodies(3.0), SlipRule::Exact);
    let coupled = own_and_mixed(coupled_ball());
    drives::<Coupled, Paper>(&coupled, SlipRule::Paper);
    for coupled in [coupled, own_and_mixed(as_curved_as_may_be())] {
        drives::<Coupled, Consistent>(&coupled, SlipRule::Consistent);
        drives::<Coupled, Exact>(&coupled, SlipRule::Exact);
    }
}

/// Under its tool of 2 mm, where κ lies between −250 and 500 /m.
fn as_curved_as_may_be() -> Body {
    let mut parts = coupled_ball().parts();
    let potentials = parts.coupled.iter_mut().flat_map(|law| &mut law.potentials).enumerate();
    potentials.for_each(|(i, p)| p.curvature = [[490.0, 30.0, -240.0], [-240.0, 60.0, 460.0]][i % 2]);
    Body::new(parts).unwrap()
}

fn drives<L: ForceLaw, R: Rule>(bodies: &[Body], slip: SlipRule) {
    let mut unit = random(11);
    let mut compared = 0;
    for case in 0..1500 {
        let body = &bodies[case % bodies.len()];
        body.prepared_gradients();
        let element = (unit() * body.elements().len() as f64) as u32;
        let patch = ElementStates::new(body, element, &Assumptions { slip, ..EXACT });
        let n = anywhere(&mut unit).map(|n| 0.02 + 0.94 * n);
        let (depth, azimuth, reach) = (1e-4 + 7e-3 * unit(), 6.0 * unit(), 3e-4 + 6e-3 * unit());
        // Of coupled bodies within their range.
        let reach = if L::COUPLED { 0.3 * reach } else { reach };
        let state = Cell { corners: [n; 3], depth_m: [depth; 2], azimuth: [azimuth; 2], reach_m: [reach; 2] };
        let tool_position = patch.state(&state).tool_position;
        let setting = Setting::new(Ablation::None, body.tool().radius_m());
        let mut kernel = ElementKernel::<L>::new(body, setting, element);
        let f = kernel.evaluate(n, tool_position);
        let drive = R::drive(&mut kernel, n, &f);
        if drive.force < 1.000_01 * f.limit {
            continue;
        }
        compared += 1;
        let by_contact_point = match R::motion(&kernel, n, &f) {
            Some(motion) => motion.moved(drive.along * drive.force).length(),
            None => drive.force,
        };
        let lateral_force = if L::COUPLED { by_contact_point } else { patch.law.lateral_at(n, reach) };
        let forces = f.normal.max(0.0) + lateral_force;
        let inward = -body.outward(element);
        let project = |v: DVec3| v - inward * v.dot(inward);
        let v = drive.along;
        let t = project(drive.way).normalize();
        // g·t.
        let g = crate::drive::exact(&mut kernel, n, &f);
        let led = project(kernel.implicit_drive_direction(n, &f, &drive)).normalize();
        let (straight, aside) = (g.dot(t) / forces, g.dot(led) / forces);
        let got = Criterion::Passive.bound(&patch, &state);
        let one_way = L::ISOTROPIC || L::COUPLED;
        let asked = !L::COUPLED || depth > 1.01 * SHALLOWEST * 8e-3;
        if slip != SlipRule::Exact && asked {
            let (least, most) = (straight.min(aside), straight);
            let rounding = 1e-5;
            assert!(got < most + rounding && (!one_way || (got - least).abs() < rounding), "{got} {least}");
            assert!(got < aside + rounding, "case {case}: {got} {aside}");
        }
        // η, and the rate of the force, by differences; in single precision. At knots a coupled law's
        // stiffness jumps.
        let h = 5e-6;
        let knots = body.responses().depth_knots().values();
        if L::COUPLED && knots.iter().any(|k| (depth - k).abs() < 2.0 * h) {
            continue;
        }
        let rates = kernel.rates(t).each();
        let mut read = |n: [f64; 3], tool_position: DVec3| {
            let f = kernel.evaluate(n, tool_position);
            let drive = R::drive(&mut kernel, n, &f);
            (f.limit - drive.along.dot(v) * drive.force, f.force())
        };
        let [up, down] = [h, -h].map(|s| read([0, 1, 2].map(|i| n[i] + s * rates[i]), tool_position));
        let (eta, force) = ((up.0 - down.0) / (2.0 * h), (up.1 - down.1).length() / (2.0 * h));
        let got = Criterion::SnapFree.bound(&patch, &state);
        let scale = force + f.lateral_slope + eta.abs();
        assert!((got - eta).abs() < 3e-4 * scale, "case {case}: {got} {eta} {scale}");
        let excess: f64 = DVec3::AXES
            .map(|a| (read(n, tool_position + a * h).0 - read(n, tool_position - a * h).0) / (2.0 * h))
            .iter()
            .map(|x| x * x)
            .sum();
        if eta > 0.1 * f.lateral_slope {
            let got = -Criterion::Pace.bound(&patch, &state);
            let expected = excess.sqrt() / eta;
            // Where nothing holds the contact point follows in both directions, and by M⁻¹ not alike.
            let unheld = if R::motion(&kernel, n, &f).is_some() { 3.0 } else { 2.0 };
            let most = if f.limit > 0.0 { expected } else { unheld * expected };
            assert!(got > expected - 3e-3 * got && got < most + 3e-3 * got, "case {case}: {got} {expected}");
            let got = -Criterion::Lipschitz.bound(&patch, &state);
            let expected =
                sensitivity::lipschitz(body, setting, slip, SurfacePoint { element, n }, tool_position);
            let expected = expected.unwrap();
            let worst = if one_way && f.limit > 0.0 { 1.5 } else { 100.0 };
            assert!(got > expected * 0.99 && got < expected * worst, "case {case}: {got} {expected}");
        }
    }
    assert!(compared > 400, "{compared}");
}

#[test]
fn bounds_are_below_every_state() {
    for slip in SlipRule::ALL {
        below(slip);
    }
}

fn below(slip: SlipRule) {
    below_on(slip, [1.0, 2.0, 60.0].into_iter().flat_map(bodies));
    below_on(slip, own_and_mixed(coupled_ball()));
    below_on(slip, own_and_mixed(as_curved_as_may_be()));
}

fn below_on(slip: SlipRule, several: impl IntoIterator<Item = Body>) {
    let mut unit = random(5);
    let mut compared = 0;
    for body in several {
        for _ in 0..400 {
            let assumptions = Assumptions { aside_rad: 0.1 * unit(), slip, ..EXACT };
            let patch =
                ElementStates::new(&body, (unit() * body.elements().len() as f64) as u32, &assumptions);
            let mut span = |end: f64, widest: f64| {
                let (from, width) = (unit() * end, widest * unit() * unit());
                [from, (from + width).min(end)]
            };
            let (depth_m, azimuth, reach_m) = (span(8e-3, 8e-3), span(6.3, 1.5), span(9e-3, 9e-3));
            let middle = anywhere(&mut unit);
            let size = unit();
            let corners = [0, 1, 2].map(|_| {
                let n = anywhere(&mut unit);
                [0, 1, 2].map(|i| middle[i] + size * (n[i] - middle[i]))
            });
            let cell = Cell { corners, depth_m, azimuth, reach_m };
            let bounds = [Criterion::Passive, Criterion::SnapFree, Criterion::Lipschitz, Criterion::Floor]
                .map(|c| (c, c.bound(&patch, &cell)));
            for _ in 0..20 {
                let m = anywhere(&mut unit);
                let n = [0, 1, 2].map(|i| (0..3).map(|k| m[k] * corners[k][i]).sum());
                let mut within = |[a, b]: [f64; 2]| [a + (b - a) * unit(); 2];
                let state = Cell {
                    corners: [n; 3],
                    depth_m: within(depth_m),
                    azimuth: within(azimuth),
                    reach_m: within(reach_m),
                };
                for (criterion, bound) in bounds {
                    let value = criterion.bound(&patch, &state);
                    if value < f64::INFINITY && value > f64::NEG_INFINITY {
                        compared += 1;
                        let rounding = 1e-9 * (1.0 + value.abs());
                        assert!(
                            bound <= value + rounding,
                            "{criterion:?}: {bound} {value} {cell:?} {state:?}"
                        );
                    }
                }
            }
        }
    }
    assert!(compared > 10_000, "{compared}");
}

/// A contact in the certificates' coordinates; none without a direction.
fn cell<L: ForceLaw>(body: &Body, at: SurfacePoint, tool_position: DVec3) -> Option<(Cell, f64)> {
    let setting = Setting::new(Ablation::None, body.tool().radius_m());
    let mut kernel = ElementKernel::<L>::new(body, setting, at.element);
    let f = kernel.evaluate(at.n, tool_position);
    let reach = kernel.stretch.rho(&f);
    let [p, q, _] = body.corners(at.element);
    let (x, z) = ((q - p).normalize(), -body.outward(at.element));
    let lateral = kernel.stretch.deflection(&f);
    let azimuth = lateral.dot(z.cross(x)).atan2(lateral.dot(x));
    let state =
        Cell { corners: [at.n; 3], depth_m: [f.depth; 2], azimuth: [azimuth; 2], reach_m: [reach; 2] };
    (f.depth > 0.0 && reach > 1e-9).then_some((state, 1e-12 * f.lateral_slope / f.limit))
}

/// The search ends where the drive is within a small part of the limit, on either side: the certificates left out those
/// below it, through which energy is counted like through the others.
#[test]
fn every_slip_of_the_engine_is_through_slip_states() {
    let mut seen = 0;
    // `exact` may rest on an edge, between two drives; P holds for it by construction.
    for slip in [SlipRule::Paper, SlipRule::Consistent] {
        seen += through::<Isotropic>(&bodies(1.0), slip) + through::<Anisotropic>(&bodies(2.0), slip);
        let coupled = through::<Coupled>(&own_and_mixed(coupled_ball()), slip);
        assert!(coupled > 500, "{coupled}");
    }
    assert!(seen > 2000, "{seen}");
}

fn through<L: ForceLaw>(bodies: &[Body], slip: SlipRule) -> usize {
    let (mut unit, mut seen) = (random(23), 0);
    for case in 0..10 {
        let mut parts = bodies[case % bodies.len()].parts();
        parts.slip = slip;
        let body = Body::new(parts).unwrap();
        let step = 2e-4 * unit();
        let assumptions = Assumptions { step_m: step * (1.0 + 1e-9), slip, ..Assumptions::default() };
        let mut direction = || DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5).normalize();
        let out = direction();
        let (mut tool_position, mut v) = (out * 0.035, -out);
        let mut contact = crate::Contact::new(&body);
        let mut last = crate::Output::default();
        for _ in 0..400 {
            let o = contact.step(&body, &crate::ToolState::at(tool_position.to_array()), 1e-3);
            let odd = |o: &crate::Output| {
                o.flags.has(Flags::ONSET)
                    || o.flags.has(Flags::BLOCKED)
                    || o.flags.has(Flags::CAPPED)
                    || o.flags.has(Flags::RELEASED)
            };
            if let (Some(a), Some(b), false, true) =
                (last.contact, o.contact, odd(&o), o.flags.has(Flags::SLIPPING))
            {
                let (start, end) = (
                    SurfacePoint { element: a.element, n: a.n },
                    SurfacePoint { element: b.element, n: b.n },
                );
                let middle = SurfacePoint { n: [0, 1, 2].map(|i| 0.5 * (a.n[i] + b.n[i])), ..start };
                let within = (start.element == end.element).then_some(middle);
                for at in [start, end].into_iter().chain(within) {
                    let Some((state, rounding)) =
                        cell::<L>(&body, at, tool_position).filter(|(_, r)| *r < 1e-7)
                    else {
                        continue;
                    };
                    let patch = ElementStates::new(&body, at.element, &assumptions);
                    seen += 1;
                    let bound = Criterion::Passive.bound(&patch, &state);
                    assert!(
                        bound < f64::INFINITY,
                        "{slip:?}, case {case}: {state:?}, {rounding}, {} {}",
                        at == start,
                        at == end
                    );
                }
            }
            last = o;
            let home = -tool_position.normalize();
            let depth = last.contact.map_or(-1e-3, |c| c.delta_z_m);
            let lateral_force = if depth < 1e-3 {
                0.5
            } else if depth > 4e-3 {
                -0.5
            } else {
                0.0
            };
            v = (v + direction() * 0.3 + home * lateral_force).normalize();
            tool_position += v * step;
        }
    }
    seen
}
