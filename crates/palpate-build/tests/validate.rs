//! The measure measured: simulators whose law is known.

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{
    Body, BodyParts, ContactState, CoupledLaw, Curve, Deformer, Extension, Fineness, Interpolation,
    Potential, PotentialErrors, Provenance, Response, SlipRule, SurfacePoint, Tool, tensor,
};
use palpate_build::Progress;
use palpate_build::spec::Spec;
use palpate_build::validate::{
    Against, Errors, History, Kept, Measure, Phase, SimulatedSurface, Simulator, Source, Trial, Validation,
    held_force, sticking, validate, validate_against, validate_at_places_of,
};
use palpate_engine::{Ablation, Contact, Flags, Output, ToolState, Waypoint, rollout};
use palpate_identify::{Amount, spread, test_points};
use palpate_simulate::{FreePlan, Path, PointPaths, PointPlan, State, Stop};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

const NORMAL_MAX: f64 = 6e-3;
const LATERAL_MAX: f64 = 4e-3;
const KNOTS: [f64; 4] = [0.0, 2e-3, 4e-3, 6e-3];

/// A ball with 40 test points, stiffer towards +x.
fn body(radius_m: f64) -> Body {
    let resolution = Resolution { edge_length_mm: Some(4.0), ..Default::default() };
    let surface = Shape::Sphere { radius_mm: 30.0 }.surface(resolution).unwrap();
    let nodes =
        test_points(&surface, &vec![true; surface.positions().len()], Amount::Count(40), None).unwrap();
    let curve = |knots: [f64; 4], values: [f64; 4], extension| {
        Curve::through(&knots, &values, Interpolation::Pchip, extension).unwrap()
    };
    let responses = nodes.iter().map(|&n| {
        let k = stiffness(surface.positions()[n as usize]);
        Response {
            normal: curve(KNOTS, [0.0, 0.2, 0.7, 1.6].map(|f| k * f), Extension::Linear),
            lateral: curve([0.0, 1e-3, 2e-3, 4e-3], [0.0, 0.15, 0.25, 0.4].map(|f| k * f), Extension::Linear),
            friction: curve(KNOTS, [0.3; 4], Extension::Constant),
        }
    });
    Body::new(BodyParts {
        blends: spread(&surface, &nodes).unwrap(),
        responses: responses.collect(),
        surface,
        test_point_nodes: nodes,
        coupled: None,
        lateral_tensors: None,
        tool: if radius_m > 0.0 { Tool::Sphere { radius_m } } else { Tool::Point },
        slip: SlipRule::Consistent,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

/// Of the coupled ball, at the knots.
const FRICTION: [f64; 4] = [0.4, 0.3, 0.3, 0.25];

fn stiffness(at: DVec3) -> f64 {
    1.0 + at.x * 15.0
}

/// The same ball with a potential at each test point: pressed straight in it leans, and it is stiffer
/// laterally the deeper it is pressed. Friction varies with the depth.
fn coupled(radius_m: f64) -> Body {
    let plain = body(radius_m);
    let nodes = plain.test_point_nodes().iter().map(|&n| &plain.nodes()[n as usize]);
    let potentials = nodes.map(|node| {
        let k = stiffness(node.position);
        let t1 = node.inward.any_orthonormal_vector();
        let hermite = |values: [f64; 4], slopes: [f64; 4], extension| {
            Curve::hermite(&KNOTS, &values.map(|v| k * v), &slopes.map(|s| k * s), extension).unwrap()
        };
        let ramp = |start: f64, end: f64| {
            let at = [0.0, 0.3, 0.8, 1.0].map(|s| start + (end - start) * s);
            hermite(at, [0.0, 0.2e3, 0.15e3, 0.0].map(|s| (end - start) * s), Extension::Constant)
        };
        let press = KNOTS.map(|d| 4.5e4 * d * d * d / 3.0);
        Potential {
            tangents: [t1, node.inward.cross(t1)],
            press: hermite(press, KNOTS.map(|d| 4.5e4 * d * d), Extension::Quadratic),
            offset: [ramp(0.0, 0.3), ramp(0.0, -0.2)],
            stiffness: [ramp(60.0, 200.0), ramp(0.0, 30.0), ramp(60.0, 150.0)],
            cubic: [2e3, 0.0, -1e3, 0.0].map(|c| ramp(0.0, c)),
            quartic: ramp(1e5, 3e5),
            friction: Curve::through(&KNOTS, &FRICTION, Interpolation::Linear, Extension::Constant).unwrap(),
            curvature: [0.0; 3],
        }
    });
    let law = CoupledLaw { range_m: LATERAL_MAX, potentials: potentials.collect() };
    Body::new(BodyParts { coupled: Some(law), responses: Vec::new(), ..plain.parts() }).unwrap()
}

fn trial(body: &Body, history: History, paths: usize) -> Trial {
    Trial {
        history,
        paths,
        seed: 7,
        at_test_points: false,
        normal_max_m: NORMAL_MAX,
        lateral_max_m: LATERAL_MAX,
        steps: 8,
        drag_depths_m: vec![0.6 * NORMAL_MAX],
        friction: if body.coupled_law().is_some() {
            KNOTS.into_iter().zip(FRICTION).collect()
        } else {
            vec![(0.0, 0.3)]
        },
        touchable: body.nodes().iter().map(|n| n.position.z > -10e-3).collect(),
    }
}

/// Free paths on a body, by the engine's own law, in shorter steps than the measure's.
struct Engine<'b> {
    body: &'b Body,
    rule: SlipRule,
    /// Contacts side by side, with the body's friction times these.
    friction: Vec<f64>,
    /// What its pressures are said to be, in parts of f_z.
    pressures: f64,
}

impl<'b> Engine<'b> {
    fn of(body: &'b Body) -> Self {
        Engine { body, rule: body.slip(), friction: vec![1.0], pressures: 1.0 }
    }
}

impl Simulator for Engine<'_> {
    fn press(&self, _: &PointPlan, _: bool) -> Option<PointPaths> {
        unreachable!()
    }

    fn follow(&self, plan: &FreePlan) -> Option<Path> {
        const STRIDE: f64 = 7e-6;
        let radius = self.body.tool().radius_m();
        let outside = plan.point - plan.inward * (radius + 2e-3);
        let way = plan.inward * 2.001e-3;
        let touch = self.body.first_touch(outside, outside + way, radius).unwrap();
        let start = outside + way * touch.fraction;
        let (mut poses, mut ends) = (vec![start - plan.inward * 2e-3], Vec::new());
        for pose in &plan.poses {
            let (from, to) = (*poses.last().unwrap(), start + pose.offset);
            let steps = (from.distance(to) / STRIDE).ceil().max(1.0);
            poses.extend((1..=steps as u32).map(|k| from.lerp(to, f64::from(k) / steps)));
            ends.push(poses.len() - 1);
        }
        let run = |scale: f64| -> Vec<Output> {
            let scale = if plan.friction.is_empty() { 0.0 } else { scale };
            let way = poses
                .iter()
                .map(|p| Waypoint { time_s: 0.0, pose: ToolState::at(p.to_array()) })
                .collect::<Vec<_>>();
            let contact = rollout(self.body, way, self.rule, Ablation::None);
            contact.with_friction_scale(scale).collect()
        };
        let runs: Vec<Vec<Output>> = self.friction.iter().map(|s| run(*s)).collect();
        let states = plan.poses.iter().zip(ends).map(|(pose, end)| {
            let forces = runs.iter().map(|r| -DVec3::from_array(r[end].force_n));
            let force_n = forces.sum::<DVec3>() / runs.len() as f64;
            let slips = runs[0][end].flags.has(Flags::SLIPPING);
            State {
                depth_m: pose.offset.dot(plan.inward),
                force_n,
                pressed_n: self.pressures * force_n.dot(plan.inward),
                slipping: if slips { 1.0 } else { 0.0 },
                ..State::default()
            }
        });
        Some(Path { states: states.collect(), stopped: None, halved: None })
    }
}

/// Presses and drags by a law: force from a plan, the depth and the lateral displacement.
struct Law<F>(F);

impl<F: Fn(&PointPlan, f64, DVec3) -> DVec3 + Sync> Simulator for Law<F> {
    fn press(&self, plan: &PointPlan, _: bool) -> Option<PointPaths> {
        let state = |depth_m: f64, distance_m: f64, aside: DVec3| State {
            depth_m,
            distance_m,
            force_n: (self.0)(plan, depth_m, aside),
            ..State::default()
        };
        let press = plan.depths.iter().map(|&d| state(d, 0.0, DVec3::ZERO)).collect();
        let drag = |d: &palpate_simulate::Drag| {
            let depth = plan.depths[d.from];
            let states = d.distances.iter().map(|&s| state(depth, s, d.direction * s)).collect();
            Path { states, stopped: None, halved: None }
        };
        let drags = plan.drags.iter().map(drag).collect();
        Some(PointPaths { press: Path { states: press, stopped: None, halved: None }, drags })
    }

    fn follow(&self, _: &FreePlan) -> Option<Path> {
        unreachable!()
    }
}

/// Normal and lateral force of a body's own curves at a surface point.
fn curves(body: &Body, plan: &PointPlan, depth: f64, aside: DVec3) -> [DVec3; 2] {
    let at = body.nearest(plan.point, 1e-6).unwrap().at;
    let nodes = body.elements()[at.element as usize].nodes;
    let mixed = |value: &dyn Fn(&Response) -> f64| -> f64 {
        (0..3).map(|j| at.n[j] * value(&body.node_response(nodes[j] as usize).unwrap())).sum()
    };
    let tensors = body.element_tensors(at.element);
    let a: DVec3 = (0..3).map(|j| tensor::apply(tensors[j], aside) * at.n[j]).sum();
    let a = a.reject_from(plan.inward);
    let rho = aside.dot(a).sqrt();
    let lateral = if rho > 0.0 { a * (mixed(&|r| r.lateral.value(rho)) / rho) } else { DVec3::ZERO };
    [plan.inward * mixed(&|r| r.normal.value(depth)), lateral]
}

fn pressed(body: &Body, count: usize, scale: [f64; 2], growth: f64) -> Validation {
    let law = Law(|plan: &PointPlan, depth: f64, aside: DVec3| {
        let [n, t] = curves(body, plan, depth, aside);
        n * scale[0] + t * (scale[1] * (1.0 + growth * depth))
    });
    validate(body, &trial(body, History::FrictionlessPress, count), &law, &|| ()).unwrap()
}

fn free(body: &Body, engine: &Engine, count: usize) -> Validation {
    validate(body, &trial(body, History::Coulomb, count), engine, &|| ()).unwrap()
}

fn of(v: &Validation, source: Source) -> Errors {
    v.sources.iter().find(|s| s.source == source).unwrap().errors
}

fn worst(e: &Errors) -> [f64; 2] {
    [e.normal.of_largest.worst, e.lateral.of_largest.worst]
}

fn phase(v: &Validation, phase: Phase) -> Errors {
    v.phases.iter().find(|p| p.phase == phase).unwrap().errors
}

#[test]
fn a_free_path_on_the_body_itself_has_no_error() {
    for (name, body) in [
        ("curves", body(5e-3)),
        ("point", body(0.0)),
        ("coupled", coupled(5e-3)),
        ("coupled point", coupled(0.0)),
    ] {
        let v = free(&body, &Engine::of(&body), 20);
        assert_eq!((v.paths.len(), v.failed, v.cut_short), (20, 0, 0));
        let e = v.summary;
        // Slip in longer steps ends a little elsewhere.
        assert!(worst(&e).iter().all(|e| *e < 0.5), "{name}: {e:?}");
        assert!(e.angle_deg.worst < 1.0 && e.size.of_local.worst < 1.0, "{name}: {e:?}");
        let phases: Vec<Phase> = v.phases.iter().map(|p| p.phase).collect();
        assert_eq!(phases, Phase::ALL, "{name}");
        let count: usize = v.phases.iter().map(|p| p.errors.states).sum();
        assert_eq!(count, e.states, "{name}");
        // Neither side touches at the beginning and between the two touches.
        let states: usize = v.paths.iter().map(|p| p.states.len()).sum();
        assert!(count < states - 40, "{name}: {count} of {states}");
    }
}

#[test]
fn more_friction_in_the_simulation_shows_where_it_slides_and_hardly_where_it_sticks() {
    for body in [body(5e-3), coupled(5e-3)] {
        let rough = Engine { friction: vec![1.2], pressures: 1.2, ..Engine::of(&body) };
        let v = free(&body, &rough, 20);
        let sliding = v.sliding.unwrap();
        assert!(sliding.states > 40);
        let [held, simulated, rendered] =
            [sliding.pressures_hold, sliding.simulated, sliding.rendered].map(|p| p.median);
        assert!((held - 1.2).abs() < 0.05 && (simulated / rendered - 1.2).abs() < 0.05, "{sliding:?}");
        // The energy's slope along the surface is what slips: on a ball more than f_t, by about δz over its
        // radius.
        assert!(rendered < 1.0 && rendered > 0.8, "{sliding:?}");
        let [stick, slip] = [Phase::Stick, Phase::Slip].map(|p| phase(&v, p).lateral.of_local.median);
        assert!(slip > 2.0 && stick < 0.5 * slip, "{stick} {slip}");
        // With the pressures' own limit nothing is left.
        assert!(worst(&of(&v, Source::PressureFriction)).iter().all(|e| *e < 0.5));
        let without = free(&body, &Engine::of(&body), 20).sliding.unwrap();
        assert!((without.simulated.median / without.rendered.median - 1.0).abs() < 0.01, "{without:?}");
    }
}

/// A body whose slip is not that over a plane: by its friction, which differs from the simulation's coefficient, and by its curvature.
#[test]
fn what_curvature_makes_of_friction_has_a_row_of_its_own() {
    let body = coupled(5e-3);
    let friction: fn(&mut Potential) = |p| p.friction = Curve::blend(&[(7.0 / 6.0, &p.friction)]).unwrap();
    let curvature: fn(&mut Potential) = |p| p.curvature = [60.0, 20.0, 120.0];
    for (change, most) in [(friction, 0.6), (curvature, 1.2)] {
        let mut curved = body.parts();
        curved.coupled.iter_mut().flat_map(|law| &mut law.potentials).for_each(change);
        let curved = Body::new(curved).unwrap();
        let at = Trial {
            friction: trial(&body, History::Coulomb, 12).friction,
            ..trial(&curved, History::Coulomb, 12)
        };
        let v = validate(&curved, &at, &Engine::of(&curved), &|| ()).unwrap();
        let [own, flat] = [Source::Body, Source::FlatFriction].map(|s| worst(&of(&v, s)));
        assert!(flat[1] > 5.0 * most && own.iter().all(|e| *e < most), "{own:?} {flat:?}");
    }
    let v = free(&body, &Engine::of(&body), 4);
    assert!(v.sources.iter().all(|s| s.source != Source::FlatFriction));
}

#[test]
fn a_ball_that_slips_ring_by_ring_is_what_contacts_side_by_side_give() {
    let body = coupled(5e-3);
    // Contacts that slip at x carry the share that Mindlin's curve bends by there.
    let remaining = (0..24).map(|i| (f64::from(i) + 0.5) / 24.0);
    let friction = remaining.map(|q| 1.5 * (1.0 - q * q)).collect();
    let two = body.clone().with_partial_slip(true);
    let v = free(&two, &Engine { friction, ..Engine::of(&body) }, 12);
    let [two, one, eight] =
        [Source::Body, Source::OnePoint, Source::EightPoints].map(|s| of(&v, s).lateral.of_largest);
    assert!(one.p95 > 3.0 && two.p95 < 0.5 * one.p95 && eight.p95 < 0.5, "{one:?} {two:?} {eight:?}");
}

#[test]
fn rows_that_lack_an_ingredient_are_right_where_the_simulation_lacks_it() {
    let body = coupled(5e-3);
    let lacking = |change: fn(&mut Potential)| {
        let mut law = body.coupled_law().unwrap().clone();
        law.potentials.iter_mut().for_each(change);
        Body::new(BodyParts { coupled: Some(law), ..body.parts() }).unwrap()
    };
    type Change = fn(&mut Potential);
    let cases: [(Source, Change); 3] = [
        (Source::WithoutOffset, |p| {
            p.offset = p.offset.each_ref().map(|c| Curve::blend(&[(0.0, c)]).unwrap())
        }),
        (Source::WithoutHigherTerms, |p| {
            p.cubic = p.cubic.each_ref().map(|c| Curve::blend(&[(0.0, c)]).unwrap());
            p.quartic = Curve::blend(&[(0.0, &p.quartic)]).unwrap();
        }),
        (Source::Decoupled, |p| {
            let flat = |c: &Curve| {
                let v = c.value(0.6 * NORMAL_MAX);
                Curve::through(c.knots(), &[v; 4], Interpolation::Linear, Extension::Constant).unwrap()
            };
            p.stiffness = p.stiffness.each_ref().map(flat);
            for c in p.offset.iter_mut().chain(&mut p.cubic).chain([&mut p.quartic]) {
                *c = Curve::blend(&[(0.0, c)]).unwrap();
            }
        }),
    ];
    for (source, change) in cases {
        let other = lacking(change);
        let v = free(&body, &Engine::of(&other), 8);
        let [n, t] = worst(&of(&v, source));
        assert!(n < 0.5 && t < 0.5, "{source:?} {n} {t}");
        let [n, t] = worst(&v.summary);
        assert!(n.max(t) > 1.0, "{source:?} {n} {t}");
    }
    // Another slip rule.
    let v = free(&body, &Engine { rule: SlipRule::Paper, ..Engine::of(&body) }, 8);
    let [own, paper] = [Source::Body, Source::PaperSlip].map(|s| of(&v, s).lateral.of_largest.p95);
    assert!(own > 1.0 && paper < 0.5, "{own} {paper}");
}

#[test]
fn free_paths_stay_within_the_ranges_in_short_steps() {
    let body = body(5e-3);
    let v = free(&body, &Engine::of(&body), 60);
    let (mut most, mut farthest, mut leaning, mut turned) = (0, 0.0f64, 0.0f64, [false; 2]);
    for p in &v.paths {
        let u = DVec3::from_array(p.inward);
        let lateral = |o: DVec3| o.reject_from(u).length();
        let mut at = p.states[0].offset_m;
        assert!((at.dot(u) + 0.5e-3).abs() < 1e-12);
        leaning = leaning.max(at.distance(p.states[1].offset_m).recip() * lateral(at - p.states[1].offset_m));
        for s in &p.states {
            let o = s.offset_m;
            assert!(o.dot(u) <= p.depth_m + 1e-12 && p.depth_m <= NORMAL_MAX);
            assert!(lateral(o) <= LATERAL_MAX * (1.0 + 1e-9), "{:?} {}", s.leg, lateral(o));
            // Load steps are short; from touch to touch nothing is loaded.
            let apart = at.dot(u) < 0.0 && o.dot(u) < 0.0;
            assert!(apart || at.distance(o) <= NORMAL_MAX / 8.0 * (1.0 + 1e-6), "{:?}", s.leg);
            farthest = farthest.max(lateral(o));
            at = o;
        }
        most = most.max(p.states.len());
        // Twice the distance to slip, with a friction of 0.3, or as far as the range goes.
        let end = p.states.iter().rfind(|s| s.leg == palpate_build::validate::Leg::Drag).unwrap().offset_m;
        assert!(p.distance_m >= 2.0 * 0.3 * p.depth_m - 1e-9 || lateral(end) > LATERAL_MAX * (1.0 - 1e-9));
        turned[usize::from(p.states.last().unwrap().offset_m.dot(u) > 0.29 * p.depth_m)] = true;
    }
    assert!(most <= 52, "{most}");
    assert!(farthest > 0.95 * LATERAL_MAX && turned == [false, true]);
    assert!(leaning > 0.4 && leaning <= 0.5 + 1e-9, "{leaning}");
}

#[test]
fn paths_are_random_held_out_and_the_same_for_a_seed() {
    let body = body(0.0);
    for history in [History::FrictionlessPress, History::Coulomb] {
        let run = |count: usize| match history {
            History::Coulomb => free(&body, &Engine::of(&body), count),
            _ => pressed(&body, count, [1.0; 2], 0.0),
        };
        let v = run(40);
        assert_eq!(serde_json::to_string(&v).unwrap(), serde_json::to_string(&run(40)).unwrap());
        let fewer = run(10);
        assert_eq!(fewer.paths[..], v.paths[..10]);
        let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(single.install(|| run(10)).paths, fewer.paths);
        let (mut low, mut high) = (f64::INFINITY, 0.0f64);
        for p in &v.paths {
            let point = DVec3::from_array(p.point_m);
            for &n in body.test_point_nodes() {
                assert!(body.nodes()[n as usize].position.distance(point) > 1e-3);
            }
            let (u, d) = (DVec3::from_array(p.inward), DVec3::from_array(p.direction));
            assert!(point.z > -10e-3 && d.dot(u).abs() < 1e-9);
            let share = p.depth_m / NORMAL_MAX;
            (low, high) = (low.min(share), high.max(share));
        }
        assert!((0.1..0.2).contains(&low) && (0.9..=1.0).contains(&high), "{low} {high}");
    }
}

#[test]
fn paths_at_test_points_begin_there() {
    let body = coupled(0.0);
    let at = Trial { at_test_points: true, ..trial(&body, History::Stick, 30) };
    let law = body.coupled_law().unwrap();
    let simulated = Law(|plan: &PointPlan, depth: f64, aside: DVec3| {
        let on = |n: &u32| body.nodes()[*n as usize].position.distance(plan.point) < 1e-9;
        let p = &law.potentials[body.test_point_nodes().iter().position(on).unwrap()];
        let force = p.at(depth, p.tangents.map(|t| t.dot(aside)), law.range_m);
        plan.inward * force.normal + p.tangents[0] * force.lateral[0] + p.tangents[1] * force.lateral[1]
    });
    let v = validate(&body, &at, &simulated, &|| ()).unwrap();
    let [n, t] = worst(&v.summary);
    assert!(n < 1e-6 && t < 1e-6, "{n} {t}");
    assert!(v.phases.iter().all(|p| matches!(p.phase, Phase::Press | Phase::Stick)));
    // No farther than friction can hold one and a half times.
    assert!(v.paths.iter().all(|p| p.distance_m <= 1.5 * 0.4 * p.depth_m));
    let [n, t] = worst(&of(&v, Source::Decoupled));
    assert!(n > 5.0 && t > 5.0, "{n} {t}");
    let mut between = Trial { touchable: vec![false; body.nodes().len()], ..at };
    let apart = |n: &u32| !body.test_point_nodes().contains(n);
    let element = body.elements().iter().find(|e| e.nodes.iter().all(apart)).unwrap();
    element.nodes.iter().for_each(|&n| between.touchable[n as usize] = true);
    let error = validate(&body, &between, &simulated, &|| ()).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("no test point can be touched"));
}

/// Two bodies of one surface are compared on the same paths, though their nodes and test points are not the same.
#[test]
fn a_body_is_tried_on_the_paths_of_another() {
    let body = coupled(0.0);
    let finer = body.refined(Fineness::edge(4e-3)).unwrap().body;
    assert!(finer.elements().len() > body.elements().len());
    let trial = trial(&body, History::Coulomb, 12);
    let own = validate(&body, &trial, &Engine::of(&body), &|| ()).unwrap();
    let lent = validate_at_places_of(&body, &finer, &trial, &Engine::of(&body), &|| ()).unwrap();
    for (one, other) in own.paths.iter().zip(&lent.paths) {
        assert_eq!((one.point_m, one.inward, one.depth_m), (other.point_m, other.inward, other.depth_m));
        assert_eq!(one.states[3].simulated_n, other.states[3].simulated_n);
    }
    assert!(own.summary.normal.of_largest.p95 < 1.0, "{:?}", own.summary);
    // The finer body is rounder, and else alike.
    let [normal, lateral] = [lent.summary.normal, lent.summary.lateral].map(|e| e.of_largest.median);
    assert!(normal < 5.0 && lateral < 5.0, "{normal} {lateral}");
    // Its own places are others.
    let touchable = finer.nodes().iter().map(|n| n.position.z > -10e-3).collect();
    let elsewhere = validate(&finer, &Trial { touchable, ..trial }, &Engine::of(&finer), &|| ()).unwrap();
    assert!(elsewhere.paths.iter().zip(&own.paths).all(|(a, b)| a.point_m != b.point_m));
}

/// Nodes may have potentials that were made from test points' around: they are no place that was simulated.
#[test]
fn only_places_that_were_simulated_count_as_test_points() {
    let mut parts = coupled(0.0).parts();
    let simulated: Vec<u32> = parts.test_point_nodes[..5].to_vec();
    let errors = simulated.iter().map(|&node| PotentialErrors { node, ..PotentialErrors::default() });
    parts.provenance.potential_errors = errors.collect();
    let body = Body::new(parts).unwrap();
    let touchable = vec![true; body.nodes().len()];
    let trial = Trial { at_test_points: true, touchable, ..trial(&body, History::Coulomb, 30) };
    let v = validate(&body, &trial, &Engine::of(&body), &|| ()).unwrap();
    let at = |n: u32| body.nodes()[n as usize].position;
    for p in &v.paths {
        let point = DVec3::from_array(p.point_m);
        assert!(simulated.iter().any(|&n| at(n).distance(point) < 1e-9), "{point}");
    }
}

#[test]
fn the_places_own_potential_is_right_where_the_bodys_is_not() {
    /// Everywhere the potential of one test point.
    struct Uniform<'b>(&'b Body, &'b Potential);
    impl Simulator for Uniform<'_> {
        fn press(&self, plan: &PointPlan, sticking: bool) -> Option<PointPaths> {
            assert!(sticking);
            let law = Law(|plan: &PointPlan, depth: f64, aside: DVec3| {
                let t1 = plan.inward.any_orthonormal_vector();
                let t = [t1, plan.inward.cross(t1)];
                let force = self.1.at(depth, t.map(|t| t.dot(aside)), LATERAL_MAX);
                plan.inward * force.normal + t[0] * force.lateral[0] + t[1] * force.lateral[1]
            });
            law.press(plan, sticking)
        }
        fn follow(&self, plan: &FreePlan) -> Option<Path> {
            Engine::of(self.0).follow(plan)
        }
        fn own_plan(&self, point: DVec3, inward: DVec3) -> Option<PointPlan> {
            let (t1, t2) = inward.any_orthonormal_pair();
            let depths: Vec<f64> = (1..=10).map(|i| 0.6e-3 * f64::from(i)).collect();
            let drags = [3, 6, 9].into_iter().flat_map(|from| {
                [t1, t2, -t1, -t2, (t1 + t2).normalize(), (t1 - t2).normalize()].map(|direction| {
                    palpate_simulate::Drag { from, direction, distances: vec![1e-3, 2e-3, 3e-3, 4e-3] }
                })
            });
            Some(PointPlan { point, inward, drags: drags.collect(), depths })
        }
    }
    let body = coupled(0.0);
    let everywhere = &body.coupled_law().unwrap().potentials[3];
    let trial = trial(&body, History::Stick, 12);
    let v = validate(&body, &trial, &Uniform(&body, everywhere), &|| ()).unwrap();
    let [body, own] = [Source::Body, Source::OwnPotential].map(|s| of(&v, s));
    assert!(body.normal.of_largest.median > 2.0 && own.normal.of_largest.median < 1.0, "{own:?}");
    assert!(body.lateral.of_largest.median > 2.0 && own.lateral.of_largest.p95 < 3.0, "{own:?}");
}

#[test]
fn without_friction_both_sides_slide() {
    let body = coupled(5e-3);
    let v = validate(&body, &trial(&body, History::Frictionless, 12), &Engine::of(&body), &|| ()).unwrap();
    assert!(worst(&v.summary).iter().all(|e| *e < 1.5), "{:?}", v.summary);
    assert!(v.sliding.is_none() && v.paths.iter().all(|p| p.depth_m == NORMAL_MAX));
    // It leans where it is pressed straight in, and friction would hold it there.
    let leaning = |p: &palpate_build::validate::PathResult| {
        let (u, s) = (DVec3::from_array(p.inward), p.states.last().unwrap().simulated_n);
        s.reject_from(u).length() / s.dot(u)
    };
    assert!(v.paths.iter().any(|p| leaning(p) > 0.02));
    let e = v.summary.lateral_of_normal;
    assert!(e.median < 0.5 && e.p95 < 2.0, "{e:?}");
    // A simulation that does not lean is off by all of it.
    let plain = pressed_straight(&body);
    let v = validate(&body, &trial(&body, History::Frictionless, 12), &plain, &|| ()).unwrap();
    assert!(v.summary.lateral_of_normal.median > 0.5);
}

/// A simulator of straight presses whose force has no lateral part.
fn pressed_straight<'b>(body: &'b Body) -> impl Simulator + 'b {
    struct Straight<'b>(Engine<'b>);
    impl Simulator for Straight<'_> {
        fn press(&self, _: &PointPlan, _: bool) -> Option<PointPaths> {
            None
        }
        fn follow(&self, plan: &FreePlan) -> Option<Path> {
            let mut path = self.0.follow(plan)?;
            path.states.iter_mut().for_each(|s| s.force_n = s.force_n.project_onto(plan.inward));
            Some(path)
        }
    }
    Straight(Engine::of(body))
}

#[test]
fn a_press_and_drag_of_the_bodys_own_curves_has_no_error() {
    for radius in [0.0, 5e-3] {
        let body = body(radius);
        let v = pressed(&body, 40, [1.0; 2], 0.0);
        assert_eq!((v.paths.len(), v.failed, v.cut_short), (40, 0, 0));
        let [n, t] = worst(&v.summary);
        // A ball touches a facet before it is above the point, by its curve over the angle to û.
        let most = if radius > 0.0 { 1.0 } else { 0.01 };
        assert!(n < most && t < 0.01, "radius {radius}: {n} % {t} %");
        let [n, t] = worst(&of(&v, Source::OwnCurvesAtDepth));
        assert!(n < 1e-6 && t < 1e-6, "{n} {t}");
        assert_eq!(v.summary, v.sources[0].errors);
    }
}

#[test]
fn known_differences_are_found() {
    let body = body(0.0);
    // The simulation is a tenth stiffer than the body: of a force F the body lacks F/11.
    let v = pressed(&body, 30, [1.1, 1.1], 0.0);
    let mut all: Vec<f64> = Vec::new();
    for p in &v.paths {
        let u = DVec3::from_array(p.inward);
        let shares = |of: fn(&DVec3, DVec3) -> f64| {
            p.states.iter().map(move |c| of(&c.simulated_n, u) / p.largest_force_n * 100.0 / 11.0)
        };
        let largest = |errors: &mut dyn Iterator<Item = f64>| errors.fold(0.0, f64::max);
        let normal = largest(&mut shares(|f, u| f.dot(u)));
        let lateral = largest(&mut shares(|f, u| f.reject_from(u).length()));
        let found = p.answer(Source::Body).unwrap();
        assert!((found.normal.largest_percent - normal).abs() < 0.01, "{:?} {normal}", found.normal);
        assert!((found.lateral.largest_percent - lateral).abs() < 0.01, "{:?} {lateral}", found.lateral);
        assert!(found.normal.rms_percent < found.normal.largest_percent && found.normal.rms_percent > 0.0);
        let newtons = found.normal.largest_percent / 100.0 * p.largest_force_n;
        assert!((found.normal.largest_n - newtons).abs() < 1e-12);
        // Pressing, the normal force grows from 0 to what it is all along the drag.
        all.extend(shares(|f, u| f.dot(u)));
    }
    all.sort_by(f64::total_cmp);
    let middle = (all[(all.len() - 1) / 2] + all[all.len() / 2]) / 2.0;
    let e = v.summary;
    assert!((e.normal.of_largest.median - middle).abs() < 0.01, "{e:?} {middle}");
    assert!(e.normal.of_largest.median < e.normal.of_paths.median);
    // Of the force at hand the size is off by as much everywhere, and the direction not at all.
    assert!(e.local_states < e.states);
    assert!(
        (e.size.of_local.median - 100.0 / 11.0).abs() < 0.01
            && (e.size.of_local.worst - 100.0 / 11.0).abs() < 0.1
    );
    assert!(e.angle_deg.worst < 0.1, "{e:?}");
    // The place's own curves know of it.
    assert!(worst(&of(&v, Source::OwnCurves)).iter().all(|e| *e < 0.5));

    // Stiffer laterally with depth: dragged from their own depth the curves are right, from another not.
    let v = pressed(&body, 30, [1.0, 1.0], 150.0);
    let ([n, own], [_, depth]) =
        (worst(&of(&v, Source::OwnCurves)), worst(&of(&v, Source::OwnCurvesAtDepth)));
    assert!(n < 1e-6 && own > 5.0 && depth < 1e-6, "{n} {own} {depth}");
}

#[test]
fn directions_matter_where_the_body_says_so() {
    let plain = body(0.0);
    let tensors =
        plain.nodes().iter().map(|n| tensor::along(DVec3::Z, 1.9, n.inward).unwrap_or(tensor::IDENTITY));
    let body = Body::new(BodyParts { lateral_tensors: Some(tensors.collect()), ..plain.parts() }).unwrap();
    let v = pressed(&body, 40, [1.0; 2], 0.0);
    let ([_, with], [_, without]) = (worst(&v.summary), worst(&of(&v, Source::Isotropic)));
    assert!(with < 0.1 && without > 5.0, "{with} {without}");
}

#[test]
fn a_path_that_ends_early_counts_as_far_as_it_went() {
    let body = body(0.0);
    struct Snapping<'b> {
        engine: Engine<'b>,
        calls: AtomicUsize,
    }
    impl Simulator for Snapping<'_> {
        fn press(&self, plan: &PointPlan, _: bool) -> Option<PointPaths> {
            self.calls.fetch_add(1, Ordering::Relaxed);
            let law = Law(|plan: &PointPlan, depth: f64, aside: DVec3| {
                curves(self.engine.body, plan, depth, aside).into_iter().sum()
            });
            let mut p = law.press(plan, false)?;
            let stop = Some(Stop { at_m: 1e-3, why: "it snapped".into() });
            if plan.point.y > 0.0 {
                p.press.states.truncate(2);
                p.press.stopped = stop;
                p.drags.iter_mut().for_each(|d| d.states.clear());
            } else if plan.point.y < -20e-3 {
                p = PointPaths { press: Path { stopped: stop, ..Path::default() }, drags: Vec::new() };
            }
            Some(p)
        }
        fn follow(&self, plan: &FreePlan) -> Option<Path> {
            self.calls.fetch_add(1, Ordering::Relaxed);
            let mut path = self.engine.follow(plan)?;
            let stop = Some(Stop { at_m: 1e-3, why: "it snapped".into() });
            if plan.point.y > 0.0 {
                path.states.truncate(4);
                path.stopped = stop;
            } else if plan.point.y < -20e-3 {
                path = Path { stopped: stop, ..Path::default() };
            }
            Some(path)
        }
    }
    for (history, states, said) in [
        (History::FrictionlessPress, 2, "the press at 1.000 mm: it snapped"),
        (History::Coulomb, 4, "mm off: it snapped"),
    ] {
        let simulator = Snapping { engine: Engine::of(&body), calls: AtomicUsize::new(0) };
        let v = validate(&body, &trial(&body, history, 40), &simulator, &|| ()).unwrap();
        assert_eq!(simulator.calls.load(Ordering::Relaxed), 40);
        assert!(
            v.failed > 0 && v.cut_short > 5 && v.paths.len() + v.failed == 40,
            "{} {}",
            v.failed,
            v.cut_short
        );
        let cut = v.paths.iter().find(|p| p.stopped.is_some()).unwrap();
        assert!(
            cut.states.len() == states && cut.stopped.as_ref().unwrap().contains(said),
            "{:?}",
            cut.stopped
        );
        assert!(worst(&v.summary).iter().all(|e| *e < 0.5));
    }
    let free = trial(&body, History::Coulomb, 4);
    struct Fixed(Option<Path>);
    impl Simulator for Fixed {
        fn press(&self, _: &PointPlan, _: bool) -> Option<PointPaths> {
            None
        }
        fn follow(&self, _: &FreePlan) -> Option<Path> {
            self.0.clone()
        }
    }
    let error = |trial: &Trial, path| validate(&body, trial, &Fixed(path), &|| ()).unwrap_err().to_string();
    assert!(error(&free, None).contains("stopped before"));
    assert!(error(&free, Some(Path::default())).contains("no state on any path"));
    let mut none = free.clone();
    none.touchable.fill(false);
    assert!(error(&none, None).contains("can be touched"));
    none.touchable.pop();
    assert!(error(&none, None).contains("the body's spec"));
    assert!(error(&Trial { steps: 0, ..free }, None).contains("--steps"));
}

#[test]
fn a_sticking_body_answers_as_before_and_sticks() {
    let plain = body(0.0);
    let rough = sticking(&plain, NORMAL_MAX).unwrap();
    for (a, b) in plain.curves().iter().zip(rough.curves()) {
        for i in 0..80 {
            let d = f64::from(i) * 1e-4;
            assert!((a.normal.value(d) - b.normal.value(d)).abs() < 1e-12);
            assert!((a.lateral.value(d) - b.lateral.value(d)).abs() < 1e-12);
        }
    }
    for body in [&plain, &coupled(0.0)] {
        let rough = sticking(body, NORMAL_MAX).unwrap();
        let mut contact = Contact::new(&rough);
        contact.step(&rough, &ToolState::at([0.0, 0.0, 31e-3]), 1e-3);
        let pressed = contact.step(&rough, &ToolState::at([0.0, 0.0, 29e-3]), 1e-3);
        let c = pressed.contact.unwrap().position_m;
        let dragged = contact.step(&rough, &ToolState::at([9e-3, 0.0, 29e-3]), 1e-3);
        let stuck = dragged.contact.unwrap();
        assert_eq!(stuck.position_m, c);
        assert!(dragged.force_n[0] < -0.4);
        if body.coupled_law().is_some() {
            let at = SurfacePoint { element: stuck.element, n: stuck.n };
            let held = held_force(&rough, at, DVec3::new(9e-3, 0.0, 29e-3));
            assert!(
                (held + DVec3::from_array(dragged.force_n)).length() < 1e-12,
                "{held} {:?} {:?}",
                dragged.force_n,
                stuck
            );
        }
    }
}

#[test]
fn tables_and_csv_hold_every_source_phase_and_state() {
    let body = coupled(5e-3);
    let v = free(&body, &Engine::of(&body), 6);
    let rows = v.table(Measure::Largest);
    assert_eq!(rows.len(), 1 + v.sources.len());
    assert!(rows[1][0] == "the body" && rows.iter().all(|r| r.len() == rows[0].len()));
    let text = v.markdown();
    for said in ["slip rule paper", "law without b", "| reversal |", "sustained sliding", "angle (°)"] {
        assert!(text.contains(said), "{said}");
    }
    let mut csv = Vec::new();
    v.csv(&mut csv).unwrap();
    let csv = String::from_utf8(csv).unwrap();
    let states: usize = v.paths.iter().map(|p| p.states.len()).sum();
    assert_eq!(csv.lines().count(), 1 + states);
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().all(|l| l.split(',').count() == columns));
    let [normal, lateral] = v.state_errors(Measure::Local);
    assert!(normal.len() == v.summary.local_states && lateral.is_sorted());
}

/// What is kept is what was simulated, to the bit; a line that was cut off and a path of another spec are simulated.
#[test]
fn kept_paths_are_not_simulated_again() {
    struct Counted<'b>(Engine<'b>, AtomicUsize);
    impl Simulator for Counted<'_> {
        fn press(&self, plan: &PointPlan, sticking: bool) -> Option<PointPaths> {
            self.0.press(plan, sticking)
        }
        fn follow(&self, plan: &FreePlan) -> Option<Path> {
            self.1.fetch_add(1, Ordering::Relaxed);
            self.0.follow(plan)
        }
    }
    const PATHS: usize = 3;
    let body = body(0.0);
    let trial = trial(&body, History::Coulomb, PATHS);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("simulated.jsonl");
    let run = |spec: &str| {
        let engine = Counted(Engine::of(&body), AtomicUsize::new(0));
        let kept = Kept::open(&engine, &file, spec, &[]).unwrap();
        let result = validate(&body, &trial, &kept, &|| {}).unwrap();
        kept.finish().unwrap();
        (result, engine.1.into_inner())
    };
    let (simulated, count) = run("a");
    assert_eq!(count, PATHS);
    let (again, count) = run("a");
    assert_eq!((&again, count), (&simulated, 0));
    let text = std::fs::read(&file).unwrap();
    std::fs::write(&file, &text[..text.len() - 100]).unwrap();
    let (again, count) = run("a");
    assert_eq!((&again, count), (&simulated, 1));
    assert_eq!(run("a").1, 0, "the line after the one that was cut off can't be read");
    assert_eq!(run("b").1, PATHS);
}

/// A body with other test points or another fit is judged by the paths that are there; another tissue or mesh is not.
#[test]
fn kept_paths_do_not_depend_on_how_a_body_is_fitted() {
    let told = |from: &str, to: &str| {
        assert!(SPEC.contains(from));
        Spec::parse("ball.toml".as_ref(), SPEC.replacen(from, to, 1)).unwrap().without_fit()
    };
    let plain = told("", "");
    for (from, to) in [
        ("count = 4", "every_node = true"),
        ("[mesh]", "# a comment\n[fit]\nlaw = \"decoupled\"\n[mesh]"),
        ("[mesh]", "[slip]\nrule = \"exact\"\n[mesh]"),
    ] {
        assert_eq!(told(from, to), plain, "{to}");
    }
    for (from, to) in [
        ("count = 4", "at_mm = [[0, 0, 30]]"),
        ("count = 4", "box_mm = [[-9, -9, 0], [9, 9, 99]]\ncount = 4"),
        ("size_mm = 12", "size_mm = 11"),
        ("20e3", "9e3"),
    ] {
        assert_ne!(told(from, to), plain, "{to}");
    }
}

/// A simulator whose surface moves `scale` times as much as the body's own.
struct Moving<'b> {
    body: &'b Body,
    scale: f64,
    /// The body's nodes, and the middles of its edges behind them.
    faces: Vec<[u32; 6]>,
    middles: Vec<[u32; 2]>,
}

impl<'b> Moving<'b> {
    fn new(body: &'b Body, scale: f64) -> Self {
        let (mut faces, mut middles) = (Vec::new(), Vec::new());
        for element in body.elements() {
            let [a, b, c] = element.nodes;
            let first = (body.nodes().len() + middles.len()) as u32;
            middles.extend([[a, b], [b, c], [c, a]]);
            faces.push([a, b, c, first, first + 1, first + 2]);
        }
        Moving { body, scale, faces, middles }
    }

    fn with_middles(&self, mut nodes: Vec<DVec3>) -> Vec<DVec3> {
        let middles = self.middles.iter().map(|e| (nodes[e[0] as usize] + nodes[e[1] as usize]) * 0.5);
        let middles: Vec<DVec3> = middles.collect();
        nodes.extend(middles);
        nodes
    }
}

impl Simulator for Moving<'_> {
    fn press(&self, plan: &PointPlan, _: bool) -> Option<PointPaths> {
        let at = self.body.nearest(plan.point, 1e-6).unwrap().at;
        let radius = self.body.tool().radius_m();
        let outside = plan.point - plan.inward * (2.0 * radius);
        let way = plan.inward * (radius + 1e-6);
        let start = outside + way * self.body.first_touch(outside, outside + way, radius).unwrap().fraction;
        let mut deformer = Deformer::new(self.body).unwrap();
        let mut state = |depth_m: f64, distance_m: f64, aside: DVec3| {
            let mut positions = Vec::new();
            let tool_m = start + plan.inward * depth_m + aside;
            deformer.displace(self.body, &ContactState { at, tool_m }, &mut positions);
            let moved = positions.iter().zip(self.body.nodes()).map(|(p, n)| (*p - n.position) * self.scale);
            let moved = self.with_middles(moved.collect());
            State {
                depth_m,
                distance_m,
                force_n: held_force(self.body, at, tool_m),
                displacement_m: moved.iter().map(|u| u.to_array().map(|c| c as f32)).collect(),
                ..State::default()
            }
        };
        let press = plan.depths.iter().map(|&d| state(d, 0.0, DVec3::ZERO)).collect();
        let drags = plan.drags.iter().map(|d| {
            let states =
                d.distances.iter().map(|&s| state(plan.depths[d.from], s, d.direction * s)).collect();
            Path { states, stopped: None, halved: None }
        });
        let drags = drags.collect();
        Some(PointPaths { press: Path { states: press, stopped: None, halved: None }, drags })
    }

    fn follow(&self, _: &FreePlan) -> Option<Path> {
        unreachable!()
    }

    fn surface(&self) -> SimulatedSurface {
        let rest = self.body.nodes().iter().map(|n| n.position).collect();
        SimulatedSurface { positions: self.with_middles(rest), faces: self.faces.clone() }
    }
}

#[test]
fn the_deformed_surface_is_compared_node_by_node() {
    let body = coupled(5e-3);
    let measured = |scale: f64| {
        let trial = trial(&body, History::Stick, 8);
        validate(&body, &trial, &Moving::new(&body, scale), &|| ()).unwrap()
    };
    let own = measured(1.0);
    let errors = own.surface.unwrap();
    assert!(errors.states > 50 && errors.rms_percent.worst < 0.01, "{errors:?}");
    assert!(errors.show_through_percent.worst < 2.0, "{errors:?}");
    // There are no fields that a dimple could stand for.
    assert!(own.dimple.is_none());
    assert!(own.tables().iter().any(|(title, _)| title.contains("deformed surface")));
    let [tenth, fifth] = [1.1, 1.2].map(|scale| measured(scale).surface.unwrap());
    assert!(tenth.rms_percent.median > 1.0 && tenth.rms_percent.worst < 12.0, "{tenth:?}");
    assert!(tenth.near_rms_percent.median > tenth.rms_percent.median, "{tenth:?}");
    let ratio = fifth.rms_percent.median / tenth.rms_percent.median;
    assert!((1.9..2.1).contains(&ratio), "{ratio}");
    // Who gives no displacements is not asked.
    assert!(free(&body, &Engine::of(&body), 2).surface.is_none());
}

/// A ball on a table, as coarse as it can be.
const SPEC: &str = r#"
[body.shape]
kind = "sphere"
radius_mm = 30
[[body.fixed]]
half_space = { point_mm = [0, 0, -22], normal = [0, 0, -1] }
[material]
model = "neo-hookean"
young_modulus_pa = 20e3
poisson_ratio = 0.45
[tool]
shape = "sphere"
radius_mm = 5
[friction]
coefficient = 0.3
[deflection]
normal_max_mm = 3
lateral_max_mm = 2
steps = 1
[test_points]
count = 4
[mesh]
element_size_mm = 12
"#;

/// What begins also ends: whatever can fail is behind it by then, or a bar would be left behind on somebody's screen.
#[test]
fn progress_begins_when_nothing_can_fail_any_more() {
    #[derive(Default)]
    struct Heard([AtomicUsize; 2]);
    impl Progress for Heard {
        fn begin(&self, _: usize, _: usize) {
            self.0[0].fetch_add(1, Ordering::Relaxed);
        }
        fn end(&self) {
            self.0[1].fetch_add(1, Ordering::Relaxed);
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.toml");
    let spec = Spec::parse(&path, SPEC.into()).unwrap();
    let simulation = spec.simulation(&path).unwrap();
    let against = |kept: std::path::PathBuf| Against {
        history: History::FrictionlessPress,
        paths: 1,
        seed: 1,
        at_test_points: false,
        own: false,
        steps: Some(1),
        jobs: 1,
        places_of: None,
        kept: Some(kept),
    };
    let tried = |asked: &Against| {
        let heard = Heard::default();
        let asked = validate_against(
            &body(5e-3),
            (&spec, &simulation, path.as_path()),
            asked,
            &heard,
            &AtomicBool::new(false),
        );
        (asked.map(|v| v.is_some()).map_err(|e| e.to_string()), heard.0.map(AtomicUsize::into_inner))
    };
    // A folder can't be written as a file.
    let (failed, heard) = tried(&against(folder.path().to_owned()));
    assert!(failed.is_err_and(|e| e.contains(&folder.path().display().to_string())));
    assert_eq!(heard, [0, 0]);
    let (done, heard) = tried(&against(folder.path().join("simulated.jsonl")));
    assert_eq!((done, heard), (Ok(true), [1, 1]));
}
