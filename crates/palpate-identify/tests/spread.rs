//! The blends of nodes between test points.

use glam::DVec3;
use palpate_body::{BlendWeights, Surface, TriangleMesh};
use palpate_identify::spread;

/// An open plane of `n` × `n` squares of 1 mm.
fn plane(n: u32) -> Surface {
    let at = |i: u32, j: u32| i + (n + 1) * j;
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| DVec3::new(i as f64, j as f64, 0.0) * 1e-3));
    let squares = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    let triangles = squares.flat_map(|(i, j)| {
        [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    });
    let mesh = TriangleMesh { positions: positions.collect(), triangles: triangles.collect() };
    Surface::build(&mesh, f64::INFINITY).unwrap()
}

/// A cube's faces, each `n` × `n`, blown up into a ball of 30 mm if `round`.
fn ball(n: i32, round: bool, crease_angle: f64) -> Surface {
    let mut index = std::collections::HashMap::new();
    let mut mesh = TriangleMesh::default();
    for (axis, side) in [(0, -n), (0, n), (1, -n), (1, n), (2, -n), (2, n)] {
        for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (2 * a - n, 2 * b - n))) {
            let mut corner = |a: i32, b: i32| {
                let mut key = [0; 3];
                (key[axis], key[(axis + 1) % 3], key[(axis + 2) % 3]) = (side, a, b);
                *index.entry(key).or_insert_with(|| {
                    let p = DVec3::from_array(key.map(f64::from)) / n as f64;
                    mesh.positions.push(if round { p.normalize() * 0.03 } else { p * 0.02 });
                    mesh.positions.len() as u32 - 1
                })
            };
            let mut q = [corner(a, b), corner(a + 2, b), corner(a + 2, b + 2), corner(a, b + 2)];
            if side < 0 {
                q.reverse();
            }
            mesh.triangles.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
        }
    }
    Surface::build(&mesh, crease_angle).unwrap()
}

fn check(surface: &Surface, points: &[u32], blends: &[BlendWeights]) {
    assert_eq!(blends.len(), surface.positions().len());
    for (n, blend) in blends.iter().enumerate() {
        assert!(blend.weights.iter().all(|&w| w == 0.0 || w >= 1e-12), "node {n}: {blend:?}");
        assert!((blend.weights.iter().sum::<f64>() - 1.0).abs() < 1e-15, "node {n}: {blend:?}");
        assert!(
            blend.test_points.is_sorted() && blend.test_points.iter().all(|&t| (t as usize) < points.len())
        );
    }
    for (t, &n) in points.iter().enumerate() {
        for (m, &v) in surface.vertices().iter().enumerate() {
            if v == surface.vertices()[n as usize] {
                assert_eq!(blends[m], BlendWeights::own(t as u32));
            }
        }
    }
}

/// The blend of a value that each test point has.
fn value(blend: &BlendWeights, of: impl Fn(u32) -> f64) -> f64 {
    (0..3).map(|j| blend.weights[j] * of(blend.test_points[j])).sum()
}

/// xorshift64*
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) % n as u64) as usize
    }

    /// Up to `count` different nodes on different vertices.
    fn nodes(&mut self, surface: &Surface, count: usize) -> Vec<u32> {
        let mut taken = std::collections::HashSet::new();
        let nodes = (0..count).map(|_| self.below(surface.positions().len()) as u32);
        nodes.filter(|&n| taken.insert(surface.vertices()[n as usize])).collect()
    }
}

#[test]
fn a_linear_field_stays_linear() {
    let surface = plane(24);
    let points: Vec<u32> =
        (0..=24).step_by(4).flat_map(|j| (0..=24).step_by(4).map(move |i| i + 25 * j)).collect();
    let blends = spread(&surface, &points).unwrap();
    check(&surface, &points, &blends);
    let stiffness = |p: DVec3| 300.0 + 2e4 * p.x - 7e3 * p.y;
    for (blend, &p) in blends.iter().zip(surface.positions()) {
        let blended = value(blend, |t| stiffness(surface.positions()[points[t as usize] as usize]));
        assert!((blended - stiffness(p)).abs() < 1e-9, "{blended} at {p}");
    }
}

#[test]
fn scattered_points_keep_a_linear_field_between_them() {
    let surface = plane(40);
    let mut random = Random(7);
    let corners = [0, 40, 41 * 40, 41 * 41 - 1];
    let mut points = random.nodes(&surface, 60);
    points.retain(|n| !corners.contains(n));
    points.extend(corners);
    let blends = spread(&surface, &points).unwrap();
    check(&surface, &points, &blends);
    let field = |p: DVec3| 1.0 + p.x * 100.0 + p.y * 30.0;
    // Near the border there may be no test points on the far side of a node.
    for n in (12..29).flat_map(|j| (12..29).map(move |i| i + 41 * j)) {
        let blended = value(&blends[n], |t| field(surface.positions()[points[t as usize] as usize]));
        assert!((blended - field(surface.positions()[n])).abs() < 1e-9, "node {n}");
    }
}

#[test]
fn weights_keep_their_promises_everywhere() {
    let mut random = Random(99);
    for surface in [plane(9), ball(5, true, f64::INFINITY), ball(4, false, 0.5), ball(1, false, 0.5)] {
        for count in [1, 2, 3, 4, 5, 8, 13, 30, 100, 1000] {
            for _ in 0..20 {
                let points = random.nodes(&surface, count);
                let blends = spread(&surface, &points).unwrap();
                check(&surface, &points, &blends);
                assert_eq!(blends, spread(&surface, &points).unwrap());
            }
        }
    }
}

#[test]
fn neighbours_differ_little() {
    // On a ball the projection to the test points' triangles is continuous, so a value blended from them is too.
    let surface = ball(40, true, f64::INFINITY);
    let points = Random(5).nodes(&surface, 60);
    let blends = spread(&surface, &points).unwrap();
    check(&surface, &points, &blends);
    let field = |p: DVec3| p.x + 0.5 * p.y - 0.3 * p.z;
    let blended =
        |n: u32| value(&blends[n as usize], |t| field(surface.positions()[points[t as usize] as usize]));
    for element in surface.elements() {
        for i in 0..3 {
            let (a, b) = (element.nodes[i], element.nodes[(i + 1) % 3]);
            let length = surface.positions()[a as usize].distance(surface.positions()[b as usize]);
            assert!((blended(a) - blended(b)).abs() < 5.0 * length, "nodes {a} and {b}");
        }
    }
}

#[test]
fn few_points_mix_along_segments() {
    let surface = plane(10);
    let [left, right] = [5 * 11, 5 * 11 + 10];
    for blend in spread(&surface, &[left]).unwrap() {
        assert_eq!(blend, BlendWeights::own(0));
    }
    let blends = spread(&surface, &[left, right]).unwrap();
    for (blend, p) in blends.iter().zip(surface.positions()) {
        assert!((value(blend, |t| t as f64) - p.x * 100.0).abs() < 1e-12);
    }
    // Three in a row span no triangle.
    let blends = spread(&surface, &[left, left + 4, right]).unwrap();
    for (blend, p) in blends.iter().zip(surface.positions()) {
        assert!((value(blend, |t| [0.0, 0.4, 1.0][t as usize]) - p.x * 100.0).abs() < 1e-12);
    }
}

#[test]
fn creases_do_not_part_the_mix() {
    let (smooth, sharp) = (ball(6, false, f64::INFINITY), ball(6, false, 0.5));
    let points: Vec<u32> = (0..20).map(|i| i * 9).collect();
    let blends = spread(&smooth, &points).unwrap();
    let creased = spread(&sharp, &points).unwrap();
    for (blend, &v) in creased.iter().zip(sharp.vertices()) {
        assert_eq!(*blend, blends[v as usize]);
    }
}

#[test]
fn messages_name_the_place_and_the_hint() {
    let surface = plane(3);
    let refused = |surface: &Surface, points: &[u32], words: &[&str]| {
        let message = spread(surface, points).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    };
    refused(&surface, &[], &["test points", "at least one"]);
    refused(&surface, &[3, 16], &["test point 1", "node 16", "16"]);
    refused(&surface, &[3, 5, 3], &["test point 2", "test point 0", "remove"]);
    let apart = TriangleMesh {
        positions: (0..6)
            .map(|i| DVec3::new((i % 3 % 2) as f64, (i % 3 / 2) as f64, (i / 3) as f64))
            .collect(),
        triangles: vec![[0, 1, 2], [3, 4, 5]],
    };
    let apart = Surface::build(&apart, f64::INFINITY).unwrap();
    refused(
        &apart,
        &[1],
        &["node 3 at (0.000000, 0.000000, 1.000000) m", "connected part", "add a test point"],
    );
    assert!(spread(&apart, &[1, 4]).is_ok());
}

/// Run with `--ignored --nocapture`.
#[test]
#[ignore = "takes gigabytes"]
fn millions_of_nodes() {
    for count in [300, 10_000] {
        let surface = ball(640, true, f64::INFINITY);
        let points = Random(1).nodes(&surface, count);
        let clock = std::time::Instant::now();
        let blends = spread(&surface, &points).unwrap();
        println!("{} nodes, {} test points: {:?}", blends.len(), points.len(), clock.elapsed());
    }
}
