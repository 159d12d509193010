//! What certificates promise, kept by random bodies on random paths: where P is proved no step generates energy, where S
//! is proved no step exceeds the certificate's Lipschitz bound.

mod common;

#[path = "common/coupled.rs"]
mod bodies;

use bodies::{RANGE_M, as_coupled, coupled, sparse};
use common::*;
use glam::DVec3;
use palpate_body::{Body, SlipRule, Tool, TriangleMesh};
use palpate_engine::certify::{
    Assumptions, Bounds, Criterion, Effort, ElementStates, ROUNDING, SHALLOWEST, least,
};
use palpate_engine::{Contact, Flags, Output};

/// The tool's longest step here.
const STEP: f64 = 3e-4;

fn assumptions(slip: SlipRule) -> Assumptions {
    Assumptions { step_m: STEP, depth_m: Some(5e-3), slip, ..Assumptions::default() }
}

fn bounds(criterion: Criterion, body: &Body, element: u32, evaluations: u32) -> Bounds {
    bounds_with(criterion, body, element, evaluations, 0.0)
}

/// Where η is at least this.
fn bounds_with(criterion: Criterion, body: &Body, element: u32, evaluations: u32, eta: f64) -> Bounds {
    let patch = ElementStates::new(body, element, &assumptions(body.slip())).snap_free(eta);
    let absolute = if criterion == Criterion::Passive { 0.02 } else { 20.0 };
    least(criterion, &patch, &patch.cells(), Effort { evaluations, absolute, relative: 0.2 })
}

/// What is proved of each element: P, S, and L where S is.
struct Proved {
    passive: Vec<bool>,
    snap_free: Vec<Option<f64>>,
}

impl Proved {
    fn of(body: &Body, evaluations: u32) -> Self {
        Self::around(body, evaluations, |_| true)
    }

    /// Of these elements alone.
    fn around(body: &Body, evaluations: u32, asked: impl Fn(u32) -> bool) -> Self {
        let elements = 0..body.elements().len() as u32;
        let passive = |e| asked(e) && bounds(Criterion::Passive, body, e, evaluations).proved >= -ROUNDING;
        let lipschitz = |e| {
            if !asked(e) {
                return None;
            }
            let eta = bounds(Criterion::SnapFree, body, e, evaluations).proved;
            let l = (eta > 0.0).then(|| bounds_with(Criterion::Lipschitz, body, e, evaluations / 2, eta));
            // An element on which nothing slips has the stiffness in stick for its bound.
            l.map(|l| if l.proved == f64::INFINITY { 2e3 } else { -l.proved }).filter(|l| l.is_finite())
        };
        Proved {
            passive: elements.clone().map(passive).collect(),
            snap_free: elements.map(lipschitz).collect(),
        }
    }
}

/// How often something was seen.
#[derive(Debug, Default, Clone, Copy)]
struct Seen {
    steps: usize,
    slips_proved_passive: usize,
    generated_elsewhere: usize,
    steps_proved_smooth: usize,
}

/// A path that presses, drags about within the certificate's depth and step, and comes back; every step is judged.
fn judge(body: &Body, proved: &Proved, random: &mut Random, steps: usize, seen: &mut Seen) {
    let element = random.below(body.elements().len()) as u32;
    judge_from(body, element, proved, random, steps, seen);
}

/// The same from above an element.
fn judge_from(
    body: &Body,
    element: u32,
    proved: &Proved,
    random: &mut Random,
    steps: usize,
    seen: &mut Seen,
) {
    let nodes = body.element_nodes(element);
    let centre = (nodes[0].position + nodes[1].position + nodes[2].position) / 3.0;
    let radius = body.tool().radius_m();
    let (mut x, mut v) = (centre - nodes[0].inward * (1e-3 + radius), nodes[0].inward);
    let speed = STEP * random.range(0.02, 0.99);
    let mut contact = Contact::new(body);
    let mut last: Option<(DVec3, Output)> = None;
    for _ in 0..steps {
        let o = step(&mut contact, body, x);
        seen.steps += 1;
        if let Some((x0, o0)) = &last {
            judge_step(body, proved, (*x0, o0), (x, &o), seen);
        }
        last = Some((x, o));
        // Home when it is too deep, or has left.
        let nearest = body.nearest(x, f64::INFINITY).unwrap();
        let home = (body.point(nearest.at) - x).normalize_or_zero();
        let pull = match o.contact {
            Some(c) if c.delta_z_m > 3.5e-3 => home,
            None if nearest.distance > 5e-4 + radius => home,
            _ => DVec3::ZERO,
        };
        v = (v + random.direction() * 0.3 + pull * 0.6).normalize();
        x += v * speed;
    }
}

fn judge_step(body: &Body, proved: &Proved, from: (DVec3, &Output), to: (DVec3, &Output), seen: &mut Seen) {
    let ((x0, o0), (x, o)) = (from, to);
    let Some(c) = o.contact else { return };
    let special = |o: &Output| {
        o.flags.has(Flags::BLOCKED)
            || o.flags.has(Flags::CAPPED)
            || o.flags.has(Flags::REANCHORED)
            || o.flags.has(Flags::RELEASED)
    };
    if special(o) || special(o0) || c.delta_z_m > 5e-3 {
        return;
    }
    if body.is_coupled() {
        // Of coupled bodies it is said within their range.
        let covered = |o: &Output| o.contact.is_none_or(|c| c.delta_r_m < RANGE_M - STEP);
        if !(covered(o) && covered(o0)) {
            return;
        }
    }
    // The elements that the slip came through: the two ends', and none between if they are neighbours.
    let start = o0.contact.filter(|_| !o.flags.has(Flags::ONSET)).unwrap_or(c);
    if start.delta_z_m > 5e-3 {
        return;
    }
    let neighbours =
        |a: u32, b: u32| a == b || (0..3).any(|e| body.across(a, e).is_some_and(|(n, _)| n == b));
    if !neighbours(start.element, c.element) {
        return;
    }
    let ends = [start.element as usize, c.element as usize];
    // Where the tool came in is not told: on a neighbour, perhaps.
    let around = (0..3).filter_map(|e| body.across(c.element, e)).map(|(n, _)| n as usize);
    let touched: Vec<usize> = around.filter(|_| o.flags.has(Flags::ONSET)).chain(ends).collect();
    let generated = o.energy.generated_j - o0.energy.generated_j;
    let moved = (o.energy.work_j - o0.energy.work_j).abs()
        + (o.energy.dissipated_j - o0.energy.dissipated_j).abs()
        + o.energy.stored_j;
    let gained = generated > 1e-12 * moved;
    // Both forces vanish with the depth: P is not asked there of coupled bodies.
    let shallow = body.is_coupled() && c.delta_z_m.min(start.delta_z_m) < SHALLOWEST * 5e-3;
    if touched.iter().all(|&e| proved.passive[e]) && !shallow {
        seen.slips_proved_passive += usize::from(o.flags.has(Flags::SLIPPING));
        assert!(!gained, "{generated} J of {moved} J generated, {ends:?}, {c:?}, {start:?}");
    } else {
        seen.generated_elsewhere += usize::from(gained);
    }
    if let [Some(a), Some(b)] = ends.map(|e| proved.snap_free[e]) {
        seen.steps_proved_smooth += 1;
        let change = (force(o) - force(o0)).length();
        let allowed = a.max(b) * (x - x0).length() + 1e-3;
        assert!(change <= allowed, "{change} N, {allowed} N allowed, {ends:?}, {c:?}, {start:?}");
    }
}

/// Smooth shapes and rough ones.
fn mesh(kind: usize, random: &mut Random) -> TriangleMesh {
    let size = random.range(0.025, 0.04);
    match kind {
        0 => ellipsoid(DVec3::splat(size), 2),
        1 => ellipsoid(DVec3::new(size, random.range(0.025, 0.04), random.range(0.025, 0.04)), 2),
        2 => torus(0.05, 0.018, 30, 14),
        3 => cylinder(size, 0.1, 12 + random.below(24), 8),
        4 => block(DVec3::splat(size), 1 + random.below(3)),
        _ => patch(0.08, 2 + random.below(6)),
    }
}

fn promises(rule: SlipRule, bodies: usize, steps: usize, evaluations: u32) -> Seen {
    let mut seen = Seen::default();
    for case in 0..bodies {
        let mut random = Random::new(400 + case as u64);
        let mesh = mesh(case % 6, &mut random);
        let friction = [0.5, 0.25, 0.1, 0.0][case / 6 % 4];
        let ratio = if case % 3 == 1 { 1.8 } else { 1.0 };
        let spread = random.range(0.0, 0.3);
        let body = ruled(&anisotropic(&mesh, &mut random, spread, friction, ratio), rule);
        let proved = Proved::of(&body, evaluations);
        for _ in 0..10 {
            judge(&body, &proved, &mut random, steps / 10 / bodies, &mut seen);
        }
    }
    seen
}

#[test]
fn no_step_breaks_what_is_proved() {
    let seen = promises(SlipRule::Paper, 12, 60_000, 1200);
    // It was put to the test, and what is not proved does happen.
    assert!(seen.slips_proved_passive > 2_000 && seen.steps_proved_smooth > 4_000, "{seen:?}");
    assert!(seen.generated_elsewhere > 20, "{seen:?}");
}

#[test]
fn no_step_of_the_consistent_rule_breaks_what_is_proved() {
    let seen = promises(SlipRule::Consistent, 6, 30_000, 300);
    assert!(seen.slips_proved_passive > 1_000 && seen.steps_proved_smooth > 2_000, "{seen:?}");
    assert!(seen.generated_elsewhere > 20, "{seen:?}");
}

/// `cargo test --release -p palpate-engine --test certificates -- --ignored --nocapture`: some minutes.
#[test]
#[ignore = "a million steps of each rule"]
fn no_step_of_a_million_breaks_what_is_proved() {
    for (rule, bodies, evaluations) in [(SlipRule::Consistent, 12, 300), (SlipRule::Paper, 48, 1200)] {
        let seen = promises(rule, bodies, 1_200_000, evaluations);
        println!("{}: {seen:?}", rule.name());
        assert!(seen.steps >= 1_000_000 && seen.slips_proved_passive > 50_000, "{seen:?}");
    }
}

/// The same everywhere on a ball, under a spherical tool whose way friction counts.
fn curved(mesh: &TriangleMesh, curvature: [f64; 3], radius_m: f64) -> Body {
    let mut parts = as_coupled(mesh, [600.0, 500.0, 0.3], SlipRule::Consistent).parts();
    parts.tool = Tool::Sphere { radius_m };
    let potentials = parts.coupled.iter_mut().flat_map(|law| &mut law.potentials);
    potentials.for_each(|p| p.curvature = curvature);
    Body::new(parts).unwrap()
}

/// On two elements of a ball; of the third body nothing is proved with this effort. Without friction P does not hold, and slips do generate energy.
#[test]
fn no_step_on_a_coupled_body_breaks_what_is_proved() {
    let (mut all, mut frictionless) = ([Seen::default(); 4], Seen::default());
    let ball = ellipsoid(DVec3::splat(0.03), 3);
    for (case, seen) in all.iter_mut().enumerate() {
        let mut random = Random::new(40 + case as u64);
        let (graded, evaluations) =
            (coupled(&ball, &mut random, 0.05, 0.3, 0.0), if case == 0 { 9000 } else { 2400 });
        let (body, none, rule) = match case {
            // Curved twice as far as it is along one direction, half as far into the other.
            0 => (curved(&ball, [60.0, 0.0, -15.0], 4e-3), 0.05, SlipRule::Consistent),
            1 => (graded, 0.05, SlipRule::Paper),
            2 => (sparse(&graded, 20), 0.05, SlipRule::Consistent),
            _ => (as_coupled(&ball, [600.0, 500.0, 0.3], SlipRule::Paper), 0.0, SlipRule::Paper),
        };
        let body = ruled(&body, rule);
        let none = ruled(&coupled(&ball, &mut random, none, 0.0, 0.0), rule);
        let element = random.below(body.elements().len()) as u32;
        let beside = body.across(element, 0).unwrap().0;
        let proved = Proved::around(&body, evaluations, |e| e == element || e == beside);
        if case == 3 {
            let tight = |l: &f64| *l < 5e3;
            assert_eq!(proved.snap_free.iter().flatten().filter(|l| tight(l)).count(), 2);
        }
        let nothing = Proved::around(&none, 0, |_| false);
        for _ in 0..300 {
            judge_from(&body, element, &proved, &mut random, 60, seen);
            judge_from(&none, element, &nothing, &mut random, 20, &mut frictionless);
        }
    }
    assert!([&all[0], &all[1], &all[3]].iter().all(|seen| seen.steps_proved_smooth > 600), "{all:?}");
    assert!([&all[0], &all[3]].iter().all(|seen| seen.slips_proved_passive > 300), "{all:?}");
    assert!(frictionless.generated_elsewhere > 20, "{frictionless:?}");
}

#[test]
fn a_uniform_plane_is_passive_and_free_of_snaps_with_any_friction() {
    for friction in [0.0, 0.05, 0.3, 2.0] {
        let body = uniform(&patch(0.08, 2), 600.0, 500.0, friction);
        let proved = Proved::of(&body, 600);
        assert!(
            proved.passive.iter().all(|p| *p) && proved.snap_free.iter().all(Option::is_some),
            "{friction}"
        );
    }
}

#[test]
fn a_smooth_ball_is_proved_and_the_gap_is_small() {
    let body = uniform(&ellipsoid(DVec3::splat(0.03), 2), 600.0, 500.0, 0.3);
    for element in 0..20 {
        let passive = bounds(Criterion::Passive, &body, element, 3000);
        assert!(passive.proved > 0.0 && passive.found - passive.proved < 0.1, "{passive:?}");
        let snap_free = bounds(Criterion::SnapFree, &body, element, 3000);
        assert!(snap_free.proved > 0.75 * snap_free.found && snap_free.proved > 0.0, "{snap_free:?}");
        let lipschitz = bounds(Criterion::Lipschitz, &body, element, 3000);
        assert!(lipschitz.proved > 1.4 * lipschitz.found, "{lipschitz:?}");
    }
}

/// Interpolated normals turn so fast along a cube's edges that 8 mm below them slip has no stable place.
#[test]
fn a_cube_snaps_and_a_frictionless_ball_is_not_passive() {
    let cube = uniform(&block(DVec3::splat(0.02), 4), 600.0, 500.0, 0.3);
    let deep = Assumptions { depth_m: None, ..assumptions(SlipRule::Paper) };
    let effort = Effort { evaluations: 500, absolute: 1.0, relative: 0.1 };
    let snap = |e| {
        let patch = ElementStates::new(&cube, e, &deep);
        least(Criterion::SnapFree, &patch, &patch.cells(), effort).found < -ROUNDING
    };
    assert!((0..cube.elements().len() as u32).filter(|&e| snap(e)).count() > 20);
    let ball = uniform(&ellipsoid(DVec3::splat(0.03), 2), 600.0, 500.0, 0.0);
    let passive = bounds(Criterion::Passive, &ball, 7, 500);
    assert!(passive.found < -0.02 && passive.proved <= passive.found, "{passive:?}");
}
