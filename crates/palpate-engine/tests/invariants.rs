//! The invariants of MODEL 9, on random meshes, responses and paths, slow and fast: on bodies whose nodes each have a curve
//! of the paper's form, on such as `fit` and `precompute` make, and on coupled ones, for a point and for spheres.

mod common;

#[path = "common/coupled.rs"]
mod bodies;

use bodies::{coupled, sparse};
use common::made::{Making, made_body};
use common::*;
use glam::{DMat3, DQuat, DVec3};
use palpate_body::{
    BlendWeights, Body, BodyParts, CoupledLaw, Potential, SlipRule, Surface, Tensor, TriangleMesh, tensor,
};
use palpate_engine::{Contact, Flags, Output};
use proptest::prelude::*;

/// Polyhedra, icospheres, ellipsoids, tori, open patches.
fn mesh(kind: usize, random: &mut Random) -> TriangleMesh {
    let size = random.range(0.02, 0.04);
    match kind {
        0 => ellipsoid(DVec3::splat(size), 1 + random.below(3)),
        1 => ellipsoid(DVec3::new(size, random.range(0.02, 0.04), random.range(0.02, 0.04)), 2),
        2 => torus(0.04, 0.4 * size, 24, 12),
        3 => cylinder(size, 0.1, 12 + random.below(24), 11),
        4 => block(DVec3::splat(size), 1 + random.below(4)),
        _ => patch(0.08, 2 + random.below(10)),
    }
}

const KINDS: usize = 6;

/// What a body's responses are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Make {
    /// Each node its own, of the paper's form.
    Plain,
    /// As `fit` makes them.
    Made,
    /// A coupled potential for each node.
    Coupled,
    /// Few coupled potentials, so that elements blend three to nine.
    Sparse,
}

impl Make {
    const ALL: [Make; 4] = [Make::Plain, Make::Made, Make::Coupled, Make::Sparse];
}

/// A random body on one of the meshes.
#[derive(Clone, Copy, Debug)]
struct Kind {
    make: Make,
    mesh: usize,
    rule: SlipRule,
    ratio: f64,
}

impl Kind {
    /// Without the tank: what it holds back may jump when it lets go.
    fn body(self, random: &mut Random, spread: f64, friction: f64) -> Body {
        let Kind { make, rule: slip, ratio, .. } = self;
        let mesh = mesh(self.mesh, random);
        if make == Make::Plain {
            return ruled(&anisotropic(&mesh, random, spread, friction, ratio), slip);
        }
        let radius_m = if random.below(2) == 0 { 0.0 } else { random.range(1e-3, 6e-3) };
        if make == Make::Made {
            let bare = friction < 1.0;
            return made_body(&mesh, random, &Making { spread, friction, bare, ratio, radius_m, slip });
        }
        let own = ruled(&coupled(&mesh, random, spread, friction, radius_m), slip);
        let body = if make == Make::Coupled { own } else { sparse(&own, 2 + random.below(8)) };
        body.with_tank(false).with_partial_slip(random.below(2) == 0)
    }

    fn is_coupled(self) -> bool {
        matches!(self.make, Make::Coupled | Make::Sparse)
    }

    /// What a property is judged for, each by itself.
    fn label(self) -> String {
        format!("{:?}, {:?}", self.rule, self.make)
    }
}

/// Any, with one of the first so many slip rules.
fn kinds(rules: usize, ratios: impl Strategy<Value = f64>) -> impl Strategy<Value = Kind> {
    (0..Make::ALL.len(), 0..KINDS, 0..rules, ratios).prop_map(|(make, mesh, rule, ratio)| Kind {
        make: Make::ALL[make],
        mesh,
        rule: SlipRule::ALL[rule],
        ratio,
    })
}

/// A path that wanders over a body.
fn wander(body: &Body, random: &mut Random, speed: f64, steps: usize) -> Vec<DVec3> {
    let (mut w, mut contact) = (Wander::new(body, random, speed), Contact::new(body));
    let mut path = vec![w.x];
    for _ in 0..steps {
        let output = step(&mut contact, body, w.x);
        path.push(w.next(&output, body, random));
    }
    path
}

fn rollout(body: &Body, path: &[DVec3]) -> Vec<Output> {
    let mut contact = Contact::new(body);
    path.iter().map(|&x| step(&mut contact, body, x)).collect()
}

fn finer(path: &[DVec3], times: usize) -> Vec<DVec3> {
    let between = |w: &[DVec3]| {
        (0..times).map(|i| w[0] + (w[1] - w[0]) * (i as f64 / times as f64)).collect::<Vec<_>>()
    };
    path.windows(2).flat_map(between).collect()
}

/// Steps in which the force may jump or be held: where the contact is held by an edge, ends at a border, starts anew,
/// or has no stable slip (certificate S fails there: a real pop).
fn exempt(o: &Output) -> bool {
    o.flags.has(Flags::BLOCKED)
        || o.flags.has(Flags::CAPPED)
        || o.flags.has(Flags::BORDER)
        || o.flags.has(Flags::REANCHORED)
}

/// Whether the contact point is about to run away, or nearly: a real pop, in which rounding grows without bound (a
/// cube with interpolated normals is full of them).
fn snaps(contact: &Contact, body: &Body, o: &Output) -> bool {
    o.flags.has(Flags::IN_CONTACT) && contact.lipschitz_n_per_m(body).is_none_or(|l| l > 8e3)
}

/// (d) and the ledger: no force without contact, no contact without depth, and energy balances, at any speed.
#[test]
fn the_ledger_balances() {
    let judged = Judged::default();
    proptest!(cases(160), |(seed in any::<u64>(), kind in kinds(3, ratio(100.0)), speed in 0.002f64..2.0)| {
        let mut random = Random::new(seed);
        let friction = random.range(0.0, 0.6);
        let tank = random.below(2) == 0;
        let body = kind.body(&mut random, 0.6, friction).with_tank(tank);
        let path = wander(&body, &mut random, speed, 600);
        for o in &rollout(&body, &path) {
            prop_assert_eq!(o.flags.has(Flags::IN_CONTACT), o.contact.is_some());
            prop_assert_eq!(force(o) != DVec3::ZERO, o.flags.has(Flags::IN_CONTACT));
            if let Some(c) = o.contact {
                prop_assert!(c.delta_z_m > 0.0);
                prop_assert!(c.n.iter().all(|&n| (0.0..=1.0).contains(&n)) && (c.n.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                judged.add(kind.label(), 1);
            }
            prop_assert!(imbalance(o) < 1e-9, "{:?}", o.energy);
            prop_assert!(o.energy.generated_j >= 0.0 && o.energy.stored_j >= 0.0);
        }
    });
    judged.demand(12, 1000);
}

/// (a): from step to step the force changes by no more than the local Lipschitz bound allows.
#[test]
fn the_force_is_lipschitz() {
    let judged = Judged::default();
    proptest!(cases(160), |(seed in any::<u64>(), kind in kinds(2, ratio(4.0)), speed in 0.002f64..0.02)| {
        let mut random = Random::new(seed);
        let friction = random.range(0.05, 0.5);
        let body = kind.body(&mut random, 0.35, friction);
        let path = wander(&body, &mut random, speed, 500);
        // The rule by itself.
        let mut contact = Contact::new(&body).with_tank(false);
        let mut last: Option<(DVec3, Output, f64)> = None;
        for &x in &path {
            let o = step(&mut contact, &body, x);
            let bound = contact.lipschitz_n_per_m(&body);
            if let (Some((x0, o0, l0)), Some(l)) = (&last, bound)
                && !exempt(&o) && !exempt(o0)
            {
                let change = (force(&o) - force(o0)).length();
                // The bound is that of the two ends; in between it may be a little larger.
                let allowed = 1.5 * l.max(*l0) * (x - x0).length() + 1e-6;
                prop_assert!(change <= allowed, "{change} N in {} m, {l} {l0} N/m", (x - x0).length());
                judged.add(kind.label(), 1);
            }
            last = bound.map(|l| (x, o, l));
        }
    });
    judged.demand(8, 1000);
}

/// (b): the largest force step shrinks in proportion when the path is sampled finer.
#[test]
fn finer_sampling_shrinks_the_steps() {
    let judged = Judged::default();
    proptest!(cases(120), |(seed in any::<u64>(), kind in kinds(2, ratio(4.0)))| {
        let mut random = Random::new(seed);
        let friction = random.range(0.1, 0.5);
        let body = kind.body(&mut random, 0.35, friction);
        let path = wander(&body, &mut random, 0.03, 250);
        // The largest step, and whether the path met anything that is no smooth contact.
        let largest = |path: &[DVec3]| {
            let mut contact = Contact::new(&body).with_tank(false);
            let (mut last, mut largest, mut odd) = (DVec3::ZERO, 0.0f64, false);
            for &x in path {
                let o = step(&mut contact, &body, x);
                largest = largest.max((force(&o) - last).length());
                last = force(&o);
                odd |= exempt(&o) || snaps(&contact, &body, &o);
            }
            (largest, odd)
        };
        let (fine, odd) = largest(&finer(&path, 10));
        prop_assume!(!odd && fine > 1e-3);
        let (finest, odd) = largest(&finer(&path, 100));
        prop_assume!(!odd);
        prop_assert!(finest <= 0.15 * fine, "{fine} {finest}");
        judged.add(kind.label(), 1);
    });
    judged.demand(8, 5);
}

/// (e): rigid motions, and renumbering of nodes and triangles, change nothing.
#[test]
fn only_the_shape_counts() {
    let judged = Judged::default();
    proptest!(cases(160), |(seed in any::<u64>(), kind in kinds(3, ratio(4.0)))| {
        let mut random = Random::new(seed);
        // Not the block: it snaps, and a snap turns rounding into another contact point.
        let body = Kind { mesh: if kind.mesh == 4 { 5 } else { kind.mesh }, ..kind }.body(&mut random, 0.35, 0.3);
        let axis = random.direction();
        let turn = DMat3::from_quat(DQuat::from_axis_angle(axis, random.range(0.0, 3.0)));
        let shift = random.direction() * 0.1;
        let moved = |p: DVec3| turn * p + shift;
        let other = renumbered(&body, &mut random, turn, moved);
        let path = wander(&body, &mut random, 0.05, 200);
        let mut largest = 0.0f64;
        let (mut here, mut there) = (Contact::new(&body), Contact::new(&other));
        for &x in &path {
            let (a, b) = (step(&mut here, &body, x), step(&mut there, &other, moved(x)));
            if exempt(&a) || exempt(&b) || snaps(&here, &body, &a) {
                break;
            }
            largest = largest.max(force(&a).length());
            let error = (turn * force(&a) - force(&b)).length();
            // Just after onset, where a step is far longer than friction holds, a coupled slip's last iterates choose its side.
            let least = if kind.is_coupled() { 1.0 } else { 0.1 };
            prop_assert!(error <= 1e-5 * (largest + least), "{error}");
            prop_assert!((a.energy.work_j - b.energy.work_j).abs() < 1e-6 * (1e-3 + a.energy.work_j.abs()));
            judged.add(kind.label(), u64::from(a.flags.has(Flags::IN_CONTACT)));
        }
    });
    judged.demand(12, 200);
}

/// The same body moved, with its nodes, triangles, triangles' corners and test points in other orders.
fn renumbered(body: &Body, random: &mut Random, turn: DMat3, moved: impl Fn(DVec3) -> DVec3) -> Body {
    let parts = body.parts();
    let mut shuffled = |count: usize| {
        let mut order: Vec<usize> = (0..count).collect();
        (1..count).rev().for_each(|i| order.swap(i, random.below(i + 1)));
        let mut new_of = vec![0u32; count];
        order.iter().enumerate().for_each(|(new, &old)| new_of[old] = new as u32);
        (order, new_of)
    };
    let (order, new_of) = shuffled(body.nodes().len());
    let (points, new_point) = shuffled(parts.test_point_nodes.len());
    let positions = order.iter().map(|&old| moved(body.nodes()[old].position)).collect();
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for element in body.elements() {
        let first = random.below(3);
        triangles.push([0, 1, 2].map(|i| new_of[element.nodes[(i + first) % 3] as usize]));
    }
    triangles.rotate_left(body.elements().len() / 3);
    let turned = |a: &Tensor| {
        let column = |v: DVec3| turn * tensor::apply(a, turn.transpose() * v);
        let (x, y, z) = (column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
        [x.x, y.y, z.z, x.y, x.z, y.z]
    };
    let tensors = parts.lateral_tensors.map(|t| order.iter().map(|&old| turned(&t[old])).collect());
    let mix = |&old: &usize| {
        let BlendWeights { test_points, weights } = parts.blends[old];
        BlendWeights { test_points: test_points.map(|t| new_point[t as usize]), weights }
    };
    Body::new(BodyParts {
        surface: Surface::build(&TriangleMesh { positions, triangles }, f64::INFINITY).unwrap(),
        blends: order.iter().map(mix).collect(),
        responses: points.iter().filter_map(|&old| parts.responses.get(old).cloned()).collect(),
        coupled: parts.coupled.map(|law| CoupledLaw {
            potentials: points.iter().map(|&old| turned_potential(&law.potentials[old], turn)).collect(),
            ..law
        }),
        test_point_nodes: points.iter().map(|&old| new_of[parts.test_point_nodes[old] as usize]).collect(),
        lateral_tensors: tensors,
        ..body.parts()
    })
    .unwrap()
    .with_tank(body.has_tank())
}

fn turned_potential(potential: &Potential, turn: DMat3) -> Potential {
    Potential { tangents: potential.tangents.map(|t| turn * t), ..potential.clone() }
}

/// (f): a closed loop in stick does no work.
#[test]
fn a_loop_in_stick_does_no_work() {
    let judged = Judged::default();
    proptest!(cases(120), |(seed in any::<u64>(), kind in kinds(3, ratio(20.0)))| {
        let mut random = Random::new(seed);
        // As much friction as a body may be given.
        let body = kind.body(&mut random, 0.6, if kind.make == Make::Made { 60.0 } else { 1e4 });
        let nodes = body.element_nodes(random.below(body.elements().len()) as u32);
        let inward = (nodes[0].inward + nodes[1].inward + nodes[2].inward).normalize();
        let p = (nodes[0].position + nodes[1].position + nodes[2].position) / 3.0 - inward * body.tool().radius_m();
        let mut contact = Contact::new(&body);
        let start = p + inward * 3e-3;
        step(&mut contact, &body, p - inward * 1e-3);
        let begin = step(&mut contact, &body, start);
        prop_assume!(begin.flags.has(Flags::IN_CONTACT));
        let (a, b) = (random.direction() * 2e-3, random.direction() * 2e-3);
        let mut moved = 0.0;
        let mut before = begin.energy.work_j;
        for i in 1..=2000 {
            let t = f64::from(i) * std::f64::consts::TAU / 2000.0;
            let o = step(&mut contact, &body, start + a * libm::sin(t) + b * libm::sin(2.0 * t) * libm::sin(t));
            prop_assume!(!o.flags.has(Flags::SLIPPING) && o.flags.has(Flags::IN_CONTACT));
            moved += (o.energy.work_j - before).abs();
            before = o.energy.work_j;
        }
        let end = step(&mut contact, &body, start);
        let work = end.energy.work_j - begin.energy.work_j;
        let most = if kind.is_coupled() { 1e-12 } else { 1e-10 };
        prop_assert!(work.abs() <= most * moved, "{work} of {moved}");
        judged.add(kind.label(), 1);
    });
    judged.demand(12, 4);
}

/// The generator makes what it is for.
#[test]
fn made_bodies_have_what_people_make() {
    let mut random = Random::new(31);
    let (mut narrow, mut wide, mut widest, mut mixed, mut nodes, mut spheres) = (0, 0, 0, 0, 0, 0);
    for i in 0..60 {
        let kind =
            Kind { make: Make::Made, mesh: i % KINDS, rule: SlipRule::Paper, ratio: [1.0, 3.0][i % 2] };
        let body = kind.body(&mut random, 0.35, 0.3);
        assert_eq!(body.is_isotropic(), i % 2 == 0);
        for node in body.nodes() {
            nodes += 1;
            mixed += usize::from(node.weights.iter().filter(|&&w| w > 0.0).count() == 3);
        }
        for element in 0..body.elements().len() as u32 {
            let of = |n: &palpate_body::Node| {
                (0..3).filter(|&i| n.weights[i] > 0.0).map(|i| n.test_points[i]).collect::<Vec<_>>()
            };
            let mut all: Vec<u32> = body.element_nodes(element).into_iter().flat_map(of).collect();
            all.sort_unstable();
            all.dedup();
            narrow += usize::from(all.len() == 3);
            wide += usize::from(all.len() > 3);
            widest = widest.max(all.len());
        }
        spheres += usize::from(body.tool().radius_m() > 0.0);
        let response = body.node_response(0).unwrap();
        assert!(response.normal.knots().len() > 3 && response.lateral.knots().len() > 3);
        let friction: Vec<f64> =
            response.normal.knots().iter().map(|&d| response.friction.value(d)).collect();
        assert!(friction.iter().any(|&mu| mu != friction[0]) || friction[0] == 0.0, "{friction:?}");
    }
    println!("{narrow} {wide} {widest} {mixed} of {nodes} {spheres}");
    assert!(narrow > 1000 && wide > 1000 && widest > 5 && mixed > nodes / 4 && (20..40).contains(&spheres));
}

proptest! {
    #![proptest_config(cases(40))]

    /// (h): on a uniform plane a tool drags an elastic–Coulomb element: c = x − min(δr, L/k_r) u_r.
    #[test]
    fn on_a_plane_the_stop_is_exact(seed in any::<u64>(), cells in 1usize..9) {
        let mut random = Random::new(seed);
        let (kz, kr, mu) = (random.range(200.0, 900.0), random.range(200.0, 900.0), random.range(0.0, 0.6));
        let body = uniform(&patch(0.2, cells), kz, kr, mu);
        let mut contact = Contact::new(&body);
        let mut x = DVec3::new(random.range(-0.01, 0.01), random.range(-0.01, 0.01), 1e-4);
        let mut c: Option<DVec3> = None;
        step(&mut contact, &body, x);
        for i in 0..400 {
            let from = x;
            x += random.direction() * random.range(1e-6, 1e-3);
            x.z = if i < 3 { -1e-4 * f64::from(i + 1) } else { x.z.clamp(-6e-3, -1e-4) };
            let depth = -x.z;
            let start = c.unwrap_or(from + (x - from) * (from.z / (from.z - x.z)));
            let lateral = (x - start).with_z(0.0);
            let stop = mu * 100.0 * kz * depth * depth / kr;
            let end = x.with_z(0.0) - lateral.clamp_length_max(stop);
            let o = step(&mut contact, &body, x);
            let expected = DVec3::Z * (100.0 * kz * depth * depth) - (x.with_z(0.0) - end) * kr;
            prop_assert!((force(&o) - expected).length() < 1e-8 * (1.0 + expected.length()), "{:?} {expected}", force(&o));
            c = Some(end);
        }
    }

    /// (h) along a principal axis of an anisotropic plane, whose stiffness is λ k_r: the same stop.
    #[test]
    fn along_a_principal_axis_the_stop_is_exact(seed in any::<u64>(), cells in 1usize..9, ratio in 0.02f64..50.0) {
        let mut random = Random::new(seed);
        let (kz, kr, mu) = (random.range(200.0, 900.0), random.range(200.0, 900.0), random.range(0.0, 0.6));
        let axis = random.direction().with_z(0.0).normalize();
        let body = anisotropic_plane(cells, [kz, kr, mu], axis, ratio);
        let stiffness = kr * 2.0 * ratio / (1.0 + ratio);
        let mut contact = Contact::new(&body);
        let mut x = DVec3::new(random.range(-0.01, 0.01), random.range(-0.01, 0.01), 1e-4);
        step(&mut contact, &body, x);
        let mut c = x.with_z(0.0);
        for i in 0..400 {
            x += axis * random.range(-1e-3, 1e-3) * f64::from(u8::from(i > 0));
            x.z = if i < 3 { -1e-4 * f64::from(i + 1) } else { random.range(-6e-3, -1e-4) };
            let stop = mu * 100.0 * kz * x.z * x.z / stiffness;
            let lateral = (x - c).with_z(0.0).clamp_length_max(stop);
            c = x.with_z(0.0) - lateral;
            let o = step(&mut contact, &body, x);
            let expected = DVec3::Z * (100.0 * kz * x.z * x.z) - lateral * stiffness;
            prop_assert!((force(&o) - expected).length() < 1e-8 * (1.0 + expected.length()), "{:?} {expected}", force(&o));
        }
    }
}

/// At any angle to the axes: in stick the force is −k_r A δ_t; a long drag is opposed along its own direction by L;
/// and without friction the contact point is straight under the tool after every step.
#[test]
fn an_oblique_drag_is_exact() {
    let judged = Judged::default();
    proptest!(cases(40), |(seed in any::<u64>(), cells in 1usize..9, ratio in 0.02f64..50.0, mu in 0.05f64..0.6)| {
        let mut random = Random::new(seed);
        let (kz, kr) = (random.range(200.0, 900.0), random.range(200.0, 900.0));
        let axis = random.direction().with_z(0.0).normalize();
        let (high, low) = (2.0 * ratio / (1.0 + ratio), 2.0 / (1.0 + ratio));
        let stretched = |d: DVec3| axis * (high * d.dot(axis)) + (d - axis * d.dot(axis)) * low;
        let way = random.direction().with_z(0.0).normalize();
        let depth = random.range(1e-3, 4e-3);
        let (normal, start) = (100.0 * kz * depth * depth, DVec3::new(0.0013, 0.0007, -depth));

        let sticky = anisotropic_plane(cells, [kz, kr, 1e3], axis, ratio);
        let mut contact = Contact::new(&sticky);
        step(&mut contact, &sticky, start.with_z(1e-4));
        for i in 0..100 {
            let d = way * (5e-5 * f64::from(i));
            let o = step(&mut contact, &sticky, start + d);
            let expected = DVec3::Z * normal - stretched(d) * kr;
            prop_assert!((force(&o) - expected).length() < 1e-9 * expected.length() && !o.flags.has(Flags::SLIPPING));
        }

        let rough = anisotropic_plane(cells, [kz, kr, mu], axis, ratio);
        let mut contact = Contact::new(&rough);
        step(&mut contact, &rough, start.with_z(1e-4));
        // The contact point follows until the force points along the way: over several times the deflection.
        let reach = mu * normal / (kr * high.min(low));
        let stride = reach.min(0.04) / 100.0;
        let steps = if reach < 0.004 { 1000 } else { 0 };
        let mut o = step(&mut contact, &rough, start);
        for i in 1..=steps {
            o = step(&mut contact, &rough, start + way * (stride * f64::from(i)));
        }
        let expected = DVec3::Z * normal - way * (mu * normal);
        prop_assert!(steps == 0 || (force(&o) - expected).length() < 3e-3 * mu * normal, "{:?} {expected}", force(&o));
        prop_assert_eq!(contact.counters().capped, 0);

        let slick = anisotropic_plane(cells, [kz, kr, 0.0], axis, ratio);
        let mut contact = Contact::new(&slick);
        step(&mut contact, &slick, start.with_z(1e-4));
        for i in 0..200 {
            let x = start + (way * 1e-4 + random.direction().with_z(0.0) * 5e-5) * f64::from(i);
            let o = step(&mut contact, &slick, x);
            prop_assert!((force(&o) - DVec3::Z * normal).length() < 1e-8);
        }
        prop_assert!(contact.counters().evaluations <= 4 * contact.counters().slips, "{:?}", contact.counters());
        judged.add("long drags", u64::from(steps > 0));
    });
    judged.demand(1, 10);
}

/// (i): subdividing without changing the field changes nothing on a plane.
#[test]
fn a_finer_plane_is_the_same_plane() {
    let judged = Judged::default();
    proptest!(cases(40), |(seed in any::<u64>(), times in 2usize..6, isotropic in any::<bool>())| {
        let mut random = Random::new(seed);
        let slope = DVec3::new(random.range(-4.0, 4.0), random.range(-4.0, 4.0), 0.0);
        let k = move |p: DVec3| 500.0 * (1.0 + slope.dot(p));
        let build = |cells| {
            let surface = Surface::build(&patch(0.08, cells), f64::INFINITY).unwrap();
            let material = Material { kz: &k, kr: &k, friction: &|_| 0.3, radius_m: 0.0 };
            // Linear in the place, so that both meshes have the same.
            let tensor = |p: DVec3, _| {
                let (s, t) = (0.2 + slope.dot(p), 0.3 - slope.x * p.y);
                [1.0 + s, 1.0 - s, 1.0, t, 0.0, 0.0]
            };
            stretched(surface, material, (!isotropic).then_some(&tensor as &dyn Fn(DVec3, DVec3) -> Tensor))
        };
        let (coarse, fine) = (build(3), build(3 * times));
        let mut path = vec![DVec3::new(0.001, 0.002, 5e-4)];
        for i in 0..300 {
            let mut x = path[i] + random.direction() * 2e-4;
            x.z = if i < 10 { x.z.min(4e-4 - 2e-4 * i as f64) } else { x.z.clamp(-4e-3, -2e-4) };
            path.push(x);
        }
        for (a, b) in rollout(&coarse, &path).iter().zip(rollout(&fine, &path)) {
            prop_assert!((force(a) - force(&b)).length() < 1e-7 * (0.1 + force(a).length()));
            judged.add(isotropic, u64::from(a.flags.has(Flags::SLIPPING)));
        }
    });
    judged.demand(2, 1000);
}

/// Stiffnesses and friction [k_z, k_r, μ], `ratio` times as stiff along an axis as across.
fn anisotropic_plane(cells: usize, [kz, kr, mu]: [f64; 3], axis: DVec3, ratio: f64) -> Body {
    let surface = Surface::build(&patch(0.2, cells), f64::INFINITY).unwrap();
    let material = Material { kz: &|_| kz, kr: &|_| kr, friction: &|_| mu, radius_m: 0.0 };
    stretched(surface, material, Some(&|_, u| tensor::along(axis, ratio, u).unwrap()))
}

/// Where every tensor is the identity, every bit is that of a body without.
#[test]
fn identities_change_no_bit() {
    let mesh = ellipsoid(DVec3::new(0.03, 0.04, 0.025), 2);
    let mut random = Random::new(21);
    let far = mesh.positions.iter().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
    let (a, b) = (random.direction() * 60.0, random.direction() * 60.0);
    let build = |tensors: Option<&dyn Fn(DVec3, DVec3) -> Tensor>| {
        let surface = Surface::build(&mesh, f64::INFINITY).unwrap();
        let (kz, kr) =
            (|p: DVec3| 600.0 + 200.0 * libm::sin(p.dot(a)), |p: DVec3| 500.0 + 100.0 * libm::sin(p.dot(b)));
        stretched(surface, Material { kz: &kz, kr: &kr, friction: &|_| 0.3, radius_m: 0.0 }, tensors)
    };
    let one = |p: DVec3, u: DVec3| {
        if p.x == far { tensor::along(DVec3::Y, 2.0, u).unwrap() } else { tensor::IDENTITY }
    };
    let (plain, same, other) = (build(None), build(Some(&|_, _| tensor::IDENTITY)), build(Some(&one)));
    assert!(same.is_isotropic() && !other.is_isotropic());
    let path = wander(&plain, &mut random, 0.05, 3000);
    let (here, there, elsewhere) = (rollout(&plain, &path), rollout(&same, &path), rollout(&other, &path));
    assert!(here == there, "to the bit");
    // Where only one node far away is not isotropic, the forces here are the same up to rounding.
    let mut near = 0;
    for (i, (x, y)) in here.iter().zip(&elsewhere).enumerate() {
        if path[i].x > 0.4 * far {
            break;
        }
        near += usize::from(x.flags.has(Flags::IN_CONTACT));
        assert!((force(x) - force(y)).length() < 1e-6 * (0.1 + force(x).length()), "{i}");
    }
    assert!(near > 100, "{near}");
}

#[test]
fn the_livers_contacts_keep_the_ledger() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/sofa/liver-smooth.obj");
    let path = std::path::Path::new(path);
    if !path.exists() {
        eprintln!("skipped: the liver mesh is not here");
        return;
    }
    let mesh = palpate_body::import::read(path, Some(palpate_body::import::LengthUnit::Centimetre)).unwrap();
    let (mesh, _) = palpate_body::repair::repair(mesh, Default::default()).unwrap();
    let mut random = Random::new(11);
    let body = heterogeneous(&mesh, &mut random, 0.35, 0.3);
    let mut touched = 0;
    for i in 0..40 {
        let path = wander(&body, &mut random, 0.01 * 1.15f64.powi(i), 400);
        for o in rollout(&body, &path) {
            assert!(imbalance(&o) < 1e-9, "{:?}", o.energy);
            assert!(
                !o.flags.has(Flags::CONTAINED)
                    && (force(&o) == DVec3::ZERO) != o.flags.has(Flags::IN_CONTACT)
            );
            touched += usize::from(o.flags.has(Flags::IN_CONTACT));
        }
    }
    assert!(touched > 4000, "{touched}");
}
