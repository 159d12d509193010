//! Light touch: press, lift off by a hair, press again; and what a fast tool meets on the rest of its way.

mod common;

use common::*;
use glam::DVec3;
use palpate_body::{Body, SlipRule, Surface, TriangleMesh};
use palpate_engine::{Contact, Flags, Output};
use proptest::prelude::*;

/// A square patch of 50 mm over z = sag(x, y), facing +z.
fn draped(cells: usize, sag: impl Fn(f64, f64) -> f64) -> TriangleMesh {
    let mut mesh = patch(0.05, cells);
    mesh.positions.iter_mut().for_each(|p| p.z = sag(p.x, p.y));
    mesh
}

/// A ball, a bowl, a dome, a saddle; from 2.5 to 12 mm an edge.
fn mesh(kind: usize, fineness: usize, random: &mut Random) -> TriangleMesh {
    let radius = random.range(0.025, 0.05);
    let cells = 4 << fineness;
    let cap = move |x: f64, y: f64| (radius * radius * 2.5 - x * x - y * y).sqrt() - radius * 2.5f64.sqrt();
    match kind {
        0 => ellipsoid(DVec3::splat(0.03), 1 + fineness),
        1 => draped(cells, move |x, y| -cap(x, y)),
        2 => draped(cells, cap),
        _ => draped(cells, move |x, y| (x * x - y * y) / (4.0 * radius)),
    }
}

/// The interpolated depth of a tool at `x`: where x − c is along c's own frame, the greatest δz; −∞ where there is no such
/// place. Found by Newton's method in every element within `around` of the tool, with nothing of the engine.
fn depth(body: &Body, x: DVec3, around: f64) -> f64 {
    let radius = body.tool().radius_m();
    let mut deepest = f64::NEG_INFINITY;
    for element in 0..body.elements().len() as u32 {
        let nodes = body.element_nodes(element);
        let [p, q, r] = body.corners(element);
        if ((p + q + r) / 3.0).distance(x) > around {
            continue;
        }
        let read = |b: f64, c: f64| {
            let u = nodes[0].inward * (1.0 - b - c) + nodes[1].inward * b + nodes[2].inward * c;
            let (u, offset) = (u.normalize(), x - (p + (q - p) * b + (r - p) * c));
            (offset - u * offset.dot(u), offset.dot(u) + radius)
        };
        let (mut b, mut c) = (1.0 / 3.0, 1.0 / 3.0);
        for _ in 0..30 {
            let (s, t) = ((q - p).normalize(), (r - p).normalize());
            let see = |b, c| {
                let (aside, _) = read(b, c);
                [aside.dot(s), aside.dot(t)]
            };
            let ([f, g], h) = (see(b, c), 1e-6);
            let [[fb, gb], [fc, gc]] = [(h, 0.0), (0.0, h)]
                .map(|(i, j)| [0, 1].map(|k| (see(b + i, c + j)[k] - see(b - i, c - j)[k]) / (2.0 * h)));
            let determinant = fb * gc - fc * gb;
            (b, c) = (b - (f * gc - fc * g) / determinant, c - (fb * g - f * gb) / determinant);
        }
        let (aside, depth) = read(b, c);
        if b >= -1e-7 && c >= -1e-7 && b + c <= 1.0 + 1e-7 && aside.length() < 1e-9 {
            deepest = deepest.max(depth);
        }
    }
    deepest
}

fn soft(mesh: &TriangleMesh, radius_m: f64, friction: f64, rule: SlipRule) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    let body =
        body_of(surface, Material { kz: &|_| 600.0, kr: &|_| 500.0, friction: &|_| friction, radius_m });
    ruled(&body, rule)
}

/// Below this (m) a depth may as well be none: the search's tolerance, and places beside the contact point's.
const UNSURE: f64 = 2e-7;

proptest! {
    #![proptest_config(cases(60))]

    /// A sphere that barely lifts off was lost: contact ends where the *interpolated* depth does, and there facets may
    /// still lie within the sphere's radius. It was taken for one that had started inside, and sank in without any force.
    #[test]
    fn press_retract_press(
        seed in any::<u64>(), kind in 0usize..4, fineness in 0usize..3, rule in 0usize..3,
        tool in 0usize..4, friction in prop_oneof![Just(0.0), 0.02f64..0.6],
    ) {
        let mut random = Random::new(seed);
        let radius = [0.0, 2e-3, 5e-3, 8e-3][tool];
        let body = soft(&mesh(kind, fineness, &mut random), radius, friction, SlipRule::ALL[rule]);
        // Over a place in the middle of the patch, along its normal.
        let middle: Vec<u32> = (0..body.elements().len() as u32)
            .filter(|&e| body.corners(e).iter().all(|p| kind == 0 || p.truncate().length() < 0.014))
            .collect();
        let element = middle[random.below(middle.len())];
        let [p, q, r] = body.corners(element);
        let (b, c) = (0.6 * random.unit(), 0.4 * random.unit());
        let place = p + (q - p) * b + (r - p) * c;
        let out = body.outward(element);
        let aside = out.any_orthonormal_vector();
        let at = |height: f64, sideways: f64| place + out * (radius + height) + aside * sideways;

        let (stride, tremor) = (random.range(1e-6, 5e-5), random.range(0.0, 2e-5));
        let mut contact = Contact::new(&body);
        let (mut height, mut sideways) = (2e-3, 0.0);
        prop_assert!(!step(&mut contact, &body, at(height, sideways)).flags.has(Flags::IN_CONTACT));
        let (mut touched, mut lifted, mut again) = (0, 0, 0);
        let mut down = true;
        height = 2e-5;
        for i in 0..400 {
            sideways += tremor * random.range(-1.0, 1.0);
            height += if down { -stride } else { stride };
            let x = at(height, sideways);
            let o = step(&mut contact, &body, x);
            prop_assert!(!o.flags.has(Flags::STARTED_INSIDE), "{i}: {:?}", o.flags);
            prop_assert!(!o.flags.has(Flags::BORDER) && imbalance(&o) < 1e-9);
            let depth = depth(&body, x, radius + 0.02);
            if depth > UNSURE {
                prop_assert!(o.flags.has(Flags::IN_CONTACT) && force(&o).dot(out) > 0.0, "{i}: no force {depth} m deep, {:?}", o.flags);
                (touched, again) = (touched + 1, again + u32::from(lifted > 0));
            } else if depth < -UNSURE {
                prop_assert!(!o.flags.has(Flags::IN_CONTACT) && force(&o) == DVec3::ZERO, "{i}: {depth} m, {:?}", o.flags);
                lifted += u32::from(touched > 0);
            }
            // Turn where the step releases, or a few after; and at some depth.
            if down && depth > random.range(0.0, 20.0) * stride + 1e-6 {
                down = false;
            } else if !down && depth < -stride * random.range(0.0, 3.0) {
                down = true;
            }
        }
        prop_assert!(touched > 20 && again > 10, "{touched} {lifted} {again}");
    }
}

/// A hovering sphere books no energy, counts no contact, and leaves the next search's first guess as it was.
#[test]
fn a_hovering_sphere_leaves_no_trace() {
    let body = soft(&ellipsoid(DVec3::splat(0.03), 1), 5e-3, 0.3, SlipRule::Paper);
    let nodes = body.element_nodes(7);
    let inward = (nodes[0].inward + nodes[1].inward + nodes[2].inward).normalize();
    // A little outside the interpolated surface, within reach of the facets.
    let reaches = |x: DVec3| depth(&body, x, 0.03) < -1e-6 && body.nearest(x, 1.0).unwrap().distance < 5e-3;
    let vertex = nodes[0].position + (nodes[1].position - nodes[0].position) * 0.2;
    let over = |height: f64| vertex - inward * (5e-3 + height);
    let heights: Vec<f64> = (-400..400).map(|i| f64::from(i) * 2e-6).filter(|h| reaches(over(*h))).collect();
    assert!(heights.len() > 10, "{}", heights.len());
    let mut contact = Contact::new(&body);
    step(&mut contact, &body, over(1e-3));
    for i in 0..1000 {
        let o = step(&mut contact, &body, over(heights[i * 7 % heights.len()]));
        assert_eq!(o, Output::default());
    }
    let counters = contact.counters();
    assert_eq!((counters.onsets, counters.slips), (0, 0));
}

/// Several meshes as one.
fn together(meshes: &[TriangleMesh]) -> TriangleMesh {
    let mut all = TriangleMesh::default();
    for mesh in meshes {
        let count = all.positions.len() as u32;
        all.positions.extend(&mesh.positions);
        all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + count)));
    }
    all
}

proptest! {
    #![proptest_config(cases(60))]

    /// A contact that ended, or came to nothing, within a step never saw the rest of its way: what leaves one plate, or
    /// hovers before it, and enters the next within the same step went through it. Plates of 0.1 mm, up to 20 m/s.
    #[test]
    fn nothing_is_tunnelled_through(
        seed in any::<u64>(), rule in 0usize..3, tool in 0usize..4, friction in prop_oneof![Just(0.0), 0.02f64..2.0],
    ) {
        let mut random = Random::new(seed);
        let radius = [0.0, 0.0, 1e-3, 3e-3][tool];
        // Room to hover between any two.
        let pitch = 2.0 * radius + random.range(5e-4, 6e-3);
        let plate = block(DVec3::new(0.03, 0.03, 5e-5), 2 + random.below(6));
        let plates: Vec<TriangleMesh> = (0..3)
            .map(|k| TriangleMesh {
                positions: plate.positions.iter().map(|p| *p + DVec3::Z * (f64::from(k) * pitch)).collect(),
                ..plate.clone()
            })
            .collect();
        let surface = Surface::build(&together(&plates), 0.5).unwrap();
        let material = Material { kz: &|_| 600.0, kr: &|_| 500.0, friction: &|_| friction, radius_m: radius };
        let body = ruled(&body_of(surface, material), SlipRule::ALL[rule]);
        // Which room a height is in, and which one a touched element belongs to: its plate's upper side, or its lower.
        let room = |z: f64| (z / pitch).ceil().clamp(0.0, 3.0) as usize;
        let side = |element: u32| element as usize / plate.triangles.len() + usize::from(body.outward(element).z > 0.0);
        let mut contact = Contact::new(&body);
        let mut x = DVec3::new(0.0, 0.0, pitch * (f64::from(random.below(4) as u32) - 0.5));
        let mut here = room(x.z);
        step(&mut contact, &body, x);
        let (mut touched, mut between) = (0, 0);
        for i in 0..300 {
            // Slow, fast, or to where it just touches.
            let leap = [1e-5, 2e-4, 3e-3, 2e-2][random.below(4)];
            x += DVec3::new(random.range(-0.3, 0.3), random.range(-0.3, 0.3), random.range(-1.0, 1.0)) * leap;
            x = x.clamp(DVec3::new(-4e-3, -4e-3, -0.02), DVec3::new(4e-3, 4e-3, 2.0 * pitch + 0.02));
            if random.below(4) == 0 {
                x.z = pitch * f64::from(random.below(3) as u32) + random.range(-1.0, 1.0).signum() * (5e-5 + radius);
                x.z += random.range(-1e-5, 1e-5);
            }
            let o = step(&mut contact, &body, x);
            prop_assert!(!o.flags.has(Flags::STARTED_INSIDE) && !o.flags.has(Flags::BORDER) && !o.flags.has(Flags::CAPPED), "{i}: {:?}", o.flags);
            let now = o.contact.map_or(room(x.z), |c| side(c.element));
            prop_assert_eq!(now, here, "{}: from room {} to {} at {}, {:?}", i, here, now, x, o.flags);
            prop_assert!((o.energy.work_j - o.energy.stored_j - o.energy.dissipated_j).abs() < 1e-14);
            touched += usize::from(o.flags.has(Flags::IN_CONTACT));
            between += usize::from(o.flags.has(Flags::REANCHORED));
            here = now;
        }
        prop_assert!(touched > 50 && touched < 300, "{touched} {between}");
    }

    /// The same through a coarse shell of 0.2 mm, from outside and from its cavity.
    #[test]
    fn no_shell_is_tunnelled_through(
        seed in any::<u64>(), rule in 0usize..3, levels in 0usize..3, radius in prop_oneof![Just(0.0), 1e-3f64..8e-3],
    ) {
        let mut random = Random::new(seed);
        let outer = ellipsoid(DVec3::splat(0.03), levels);
        let mut inner = outer.clone();
        // 0.2 mm from facet to facet, whatever their size.
        let [p, q, r] = outer.triangles[0].map(|v| outer.positions[v as usize]);
        let height = (q - p).cross(r - p).normalize().dot(p).abs();
        inner.positions.iter_mut().for_each(|p| *p *= 1.0 - 2e-4 / height);
        inner.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        let count = outer.triangles.len() as u32;
        let body = soft(&together(&[outer, inner]), radius, 0.2, SlipRule::ALL[rule]);
        let mut contact = Contact::new(&body);
        let outside = random.below(2) == 0;
        let mut x = if outside { random.direction() * 0.045 } else { DVec3::ZERO };
        step(&mut contact, &body, x);
        let mut touched = 0;
        for i in 0..200 {
            let leap = [2e-5, 5e-4, 4e-3, 2e-2][random.below(4)];
            x = (x + random.direction() * leap).clamp_length_max(0.045);
            if random.below(3) == 0 {
                let nearest = body.nearest(x, 1.0).unwrap().at;
                let side = if outside { 1.0 } else { -1.0 };
                x = body.point(nearest) + x.normalize() * side * (radius + random.range(-2e-4, 5e-4));
            }
            let o = step(&mut contact, &body, x);
            prop_assert!(!o.flags.has(Flags::STARTED_INSIDE), "{i}: {:?}", o.flags);
            let element = o.contact.map_or_else(|| body.nearest(x, 1.0).unwrap().at.element, |c| c.element);
            prop_assert_eq!(element < count, outside, "{} at {}, {:?}", i, x.length(), o.flags);
            touched += usize::from(o.flags.has(Flags::IN_CONTACT));
        }
        prop_assert!(touched > 20, "{touched}");
    }
}
