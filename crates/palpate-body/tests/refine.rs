//! Refined bodies on shapes that users make: without gaps, on the smooth surface, over the same test points.

use glam::DVec3;
use palpate_body::refine::MAX_TRIANGLES;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{
    BlendWeights, Body, BodyParts, Fineness, NO_TWIN, Refined, Response, Surface, TriangleMesh, tensor,
};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

const SPHERE: Shape = Shape::Sphere { radius_mm: 30.0 };
const TORUS: Shape = Shape::Torus { radii_mm: [40.0, 15.0] };
const TUBE: Shape = Shape::Cylinder { radius_mm: 30.0, length_mm: 100.0, caps: false };
const CAPPED: Shape = Shape::Cylinder { radius_mm: 30.0, length_mm: 40.0, caps: true };
const BLOCK: Shape = Shape::Block { size_mm: [60.0, 40.0, 20.0] };

fn edges_of(mm: f64) -> Resolution {
    Resolution { edge_length_mm: Some(mm), ..Default::default() }
}

fn around(around: u32, along: u32) -> Resolution {
    Resolution { around: Some(around), along: Some(along), ..Default::default() }
}

/// Stiffness at a place.
fn stiffness(p: DVec3) -> f64 {
    600.0 * (1.0 + 6.0 * p.x + 4.0 * p.y * p.z / 0.03)
}

/// Every node a test point, whose stiffness varies.
fn varied(surface: Surface) -> Body {
    let own = 0..surface.positions().len() as u32;
    let responses = surface.positions().iter().map(|&p| {
        let k = stiffness(p);
        Response::paper(k, 0.8 * k, 0.3, 8e-3, 8e-3).unwrap()
    });
    let parts = BodyParts {
        blends: own.clone().map(BlendWeights::own).collect(),
        responses: responses.collect(),
        test_point_nodes: own.collect(),
        surface,
        ..Body::uniform(
            SPHERE.surface(edges_of(30.0)).unwrap(),
            Response::paper(1.0, 1.0, 0.1, 1e-2, 1e-2).unwrap(),
        )
        .unwrap()
        .parts()
    };
    Body::new(parts).unwrap()
}

/// The same body with every node a test point that answers what it did.
fn varied_as(body: &Body) -> Body {
    let own = 0..body.nodes().len() as u32;
    let responses = own.clone().map(|n| body.node_response(n as usize).unwrap());
    Body::new(BodyParts {
        blends: own.clone().map(BlendWeights::own).collect(),
        responses: responses.collect(),
        test_point_nodes: own.collect(),
        ..body.parts()
    })
    .unwrap()
}

fn shape(shape: Shape, resolution: Resolution, crease_deg: f64) -> Body {
    varied(Surface::build(&shape.mesh(resolution).unwrap(), crease_deg.to_radians()).unwrap())
}

/// A ball with bumps, whose mesh is uneven.
fn lumpy() -> Body {
    let mut mesh = SPHERE.mesh(edges_of(9.0)).unwrap();
    for (i, p) in mesh.positions.iter_mut().enumerate() {
        let u = p.normalize();
        let bump = 0.12 * (5.0 * u.x).sin() * (4.0 * u.y + 1.0).sin() + 0.05 * (9.0 * u.z).cos();
        *p *= 1.0 + bump + 0.01 * ((i * 2_654_435_761) % 1000) as f64 / 1000.0;
    }
    varied(Surface::build(&mesh, f64::INFINITY).unwrap())
}

/// All of them, with a name, and how fine they are made, m.
fn bodies() -> Vec<(&'static str, Body, Fineness)> {
    let fine = Fineness::sagitta(20e-6);
    vec![
        ("sphere", shape(SPHERE, edges_of(12.0), 180.0), fine),
        ("torus", shape(TORUS, around(20, 10), 180.0), fine),
        ("open tube", shape(TUBE, around(24, 11), 180.0), fine),
        ("capped tube", shape(CAPPED, edges_of(10.0), 40.0), fine),
        ("block", shape(BLOCK, edges_of(10.0), 40.0), fine),
        ("block without creases", shape(BLOCK, edges_of(10.0), 180.0), fine),
        ("block by edges", shape(BLOCK, edges_of(10.0), 40.0), Fineness::edge(3e-3)),
        ("torus by edges", shape(TORUS, around(20, 10), 180.0), Fineness::edge(2.5e-3)),
        ("lumpy ball", lumpy(), fine),
    ]
}

fn borders(body: &Body) -> usize {
    body.elements().iter().flat_map(|e| e.twins).filter(|&t| t == NO_TWIN).count()
}

/// Vertices less edges plus triangles.
fn euler(body: &Body) -> i64 {
    let half_edges = 3 * body.elements().len();
    let edges = (half_edges + borders(body)) / 2;
    body.vertex_count() as i64 - edges as i64 + body.elements().len() as i64
}

/// Enclosed by the surface, m³.
fn volume(body: &Body) -> f64 {
    let part = |e: usize| {
        let [a, b, c] = body.corners(e as u32);
        a.dot(b.cross(c)) / 6.0
    };
    (0..body.elements().len()).map(part).sum()
}

fn area(body: &Body) -> f64 {
    let part = |e: usize| {
        let [a, b, c] = body.corners(e as u32);
        (b - a).cross(c - a).length() / 2.0
    };
    (0..body.elements().len()).map(part).sum()
}

#[test]
fn refining_opens_no_gap_and_keeps_borders_creases_and_nodes() {
    for (name, body, fineness) in bodies() {
        let fine = body.refined(fineness).unwrap().body;
        println!("{name}: {} → {}", body.elements().len(), fine.elements().len());
        assert_eq!(euler(&body), euler(&fine), "{name}");
        assert_eq!(borders(&body) == 0, borders(&fine) == 0, "{name}");
        assert_eq!(body.has_creases(), fine.has_creases(), "{name}");
        // A vertex's nodes, as many and with the same normals.
        for (n, node) in body.nodes().iter().enumerate().take(body.vertex_count()) {
            assert_eq!(fine.nodes()[n], *node, "{name}");
        }
        let normals = |body: &Body| {
            let mut at: BTreeMap<[u64; 3], Vec<[u64; 3]>> = BTreeMap::new();
            for n in body.nodes() {
                let key = n.position.to_array().map(f64::to_bits);
                at.entry(key).or_default().push(n.inward.to_array().map(f64::to_bits));
            }
            at.values_mut().for_each(|normals| normals.sort_unstable());
            at
        };
        let (coarse, refined) = (normals(&body), normals(&fine));
        assert!(coarse.iter().all(|(p, normals)| refined.get(p) == Some(normals)), "{name}");
        // Test points stay where they are, too.
        for (t, (&old, &new)) in body.test_point_nodes().iter().zip(fine.test_point_nodes()).enumerate() {
            assert_eq!(
                body.nodes()[old as usize].position,
                fine.nodes()[new as usize].position,
                "{name} {t}"
            );
        }
        assert_eq!(body.curves(), fine.curves(), "{name}");
    }
}

/// The borders of a tube stay circles at its ends; and no facet of it is farther off than was asked, but for what the smooth
/// surface itself is off a true circle, to fourth order in the angle.
#[test]
fn facets_are_within_the_tolerance_of_the_true_cylinder() {
    let tube = shape(TUBE, around(24, 11), 180.0);
    let radial = tube.nodes().iter().map(|n| -DVec3::new(n.position.x, n.position.y, 0.0).normalize());
    let parts = tube.parts();
    let surface = parts.surface.clone().with_inward_normals(radial.collect()).unwrap();
    let tube = Body::new(BodyParts { surface, ..parts }).unwrap();
    let off = |body: &Body| {
        let middle = |e: usize| {
            let [a, b, c] = body.corners(e as u32);
            [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0, (a + b + c) / 3.0]
        };
        let radius = |p: DVec3| p.x.hypot(p.y);
        (0..body.elements().len()).flat_map(middle).map(|p| 30e-3 - radius(p)).fold(0.0f64, f64::max)
    };
    assert!((256e-6..257e-6).contains(&off(&tube)), "{}", off(&tube));
    for sagitta in [50e-6, 10e-6, 1e-6, 0.1e-6] {
        let fine = tube.refined(Fineness::sagitta(sagitta)).unwrap().body;
        assert!(off(&fine) < 3.31e-6 + sagitta, "{sagitta}: {}", off(&fine));
        for e in fine.elements() {
            for i in (0..3).filter(|&i| e.twins[i] == NO_TWIN) {
                let p = fine.nodes()[e.nodes[i] as usize].position;
                assert_eq!(p.z.abs(), 50e-3);
            }
        }
    }
}

/// Twice as many divisions: a 16th of the error in area and volume, where flat facets have a quarter.
#[test]
fn area_and_volume_converge_with_fourth_order() {
    let sphere = |n: f64| {
        let surface = SPHERE.surface(edges_of(n)).unwrap();
        let exact = surface.positions().iter().map(|p| -p.normalize()).collect();
        surface.with_inward_normals(exact).unwrap()
    };
    let torus = |n: u32| {
        let surface = TORUS.surface(around(2 * n, n)).unwrap();
        let exact = surface.positions().iter().map(|p| {
            let ring = DVec3::new(p.x, p.y, 0.0).normalize() * 40e-3;
            (ring - *p).normalize()
        });
        let exact = exact.collect();
        surface.with_inward_normals(exact).unwrap()
    };
    let r = 30e-3;
    let ball = [4.0 * PI * r * r, 4.0 / 3.0 * PI * r * r * r];
    let ring = [TAU * 40e-3 * TAU * 15e-3, TAU * 40e-3 * PI * 15e-3 * 15e-3];
    for (name, [coarse, finer], [true_area, true_volume]) in
        [("sphere", [sphere(12.0), sphere(6.0)], ball), ("torus", [torus(12), torus(24)], ring)]
    {
        let errors = [coarse, finer].map(|surface| {
            let body = varied(surface).refined(Fineness::sagitta(0.5e-6)).unwrap().body;
            [area(&body) / true_area - 1.0, volume(&body) / true_volume - 1.0]
        });
        let [[a, v], [a2, v2]] = errors;
        println!("{name}: area {a:.2e} → {a2:.2e}, volume {v:.2e} → {v2:.2e}");
        assert!(a.abs() > 11.0 * a2.abs() && v.abs() > 11.0 * v2.abs(), "{name} {errors:?}");
        assert!(a2.abs() < 1e-3 && v2.abs() < 1e-3, "{name} {errors:?}");
    }
}

/// A capped tube's rim becomes a circle on both of its sides, and its caps stay flat.
#[test]
fn a_crease_bulges_alike_on_both_sides() {
    let body = shape(CAPPED, edges_of(10.0), 40.0);
    let fine = body.refined(Fineness::sagitta(2e-6)).unwrap().body;
    let mut rim = 0;
    for n in fine.nodes() {
        let p = n.position;
        if n.inward.z.abs() > 0.9 {
            assert!((p.z.abs() - 20e-3).abs() < 1e-15 && (n.inward.z.abs() - 1.0).abs() < 1e-12, "{p}");
        } else {
            assert!((p.x.hypot(p.y) - 30e-3).abs() < 20e-6, "{p}");
            rim += usize::from((p.z.abs() - 20e-3).abs() < 1e-12);
        }
    }
    assert!(rim > 150, "{rim}");
    let exact = PI * 30e-3 * 30e-3 * 40e-3;
    assert!((volume(&fine) / exact - 1.0).abs() < 1e-3, "{}", volume(&fine) / exact);
}

/// Interpolated normals of a block without creases turn at its edges; its faces stay flat, nevertheless.
#[test]
fn the_faces_of_a_block_stay_flat() {
    for crease in [40.0, 180.0] {
        let body = shape(BLOCK, edges_of(10.0), crease);
        let Refined { body: fine, sharp_nodes, distance_m, .. } = body.refined(Fineness::edge(2e-3)).unwrap();
        assert!(fine.elements().len() > 8 * body.elements().len());
        assert!((volume(&fine) / 48e-6 - 1.0).abs() < 1e-12);
        assert!(distance_m < 1e-15, "{distance_m}");
        assert_eq!(sharp_nodes > 0, crease > 90.0);
    }
}

/// Where every node is a test point, a refined body blends on each facet what the coarse one does.
#[test]
fn responses_are_those_of_the_coarse_body() {
    for (name, body, fineness) in bodies() {
        let Refined { body: fine, reduced_nodes, .. } = body.refined(fineness).unwrap();
        assert_eq!(reduced_nodes, 0, "{name}");
        let scale = |body: &Body, n: u32| body.node_response(n as usize).unwrap().normal.value(5e-3);
        // Along every coarse edge that a node of the fine body halves, force is the mean of its ends'.
        let middles: BTreeMap<[i64; 3], u32> = (0..fine.nodes().len() as u32)
            .map(|n| (fine.nodes()[n as usize].position.to_array().map(|x| (x * 1e9).round() as i64), n))
            .collect();
        let mut found = 0;
        for e in body.elements() {
            for i in 0..3 {
                let [a, b] = [e.nodes[i], e.nodes[(i + 1) % 3]];
                let [p, q] = [a, b].map(|n| body.nodes()[n as usize].position);
                let key = ((p + q) / 2.0).to_array().map(|x| (x * 1e9).round() as i64);
                if let Some(&n) = middles.get(&key) {
                    let mean = (scale(&body, a) + scale(&body, b)) / 2.0;
                    assert!((scale(&fine, n) / mean - 1.0).abs() < 1e-9, "{name}");
                    found += 1;
                }
            }
        }
        assert!(found > 0 || !name.contains("block by"), "{name}");
    }
}

/// A body whose test points are some of its nodes: what a fourth test point costs is bounded.
#[test]
fn three_test_points_stay_where_more_come_together() {
    let tube = shape(TUBE, around(48, 22), 180.0);
    let parts = tube.parts();
    // Test points at every fourth node around and every second along, blended bilinearly down to three.
    let number = |row: u32, column: u32| row * 12 + column % 12;
    let blends =
        (0..23u32).flat_map(|row| (0..48u32).map(move |column| (row, column))).map(|(row, column)| {
            let (r, c) = ((row / 2).min(10), column / 4);
            let (v, u) = (f64::from(row - 2 * r) / 2.0, f64::from(column % 4) / 4.0);
            let (test_points, weights) = if u >= v {
                ([number(r, c), number(r, c + 1), number(r + 1, c + 1)], [1.0 - u, u - v, v])
            } else {
                ([number(r, c), number(r + 1, c + 1), number(r + 1, c)], [1.0 - v, u, v - u])
            };
            BlendWeights { test_points, weights }
        });
    let test_point_nodes: Vec<u32> =
        (0..12u32).flat_map(|r| (0..12u32).map(move |c| (2 * r).min(22) * 48 + 4 * c)).collect();
    let responses = test_point_nodes.iter().map(|&n| parts.responses[n as usize].clone()).collect();
    let body =
        Body::new(BodyParts { blends: blends.collect(), test_point_nodes, responses, ..parts }).unwrap();
    let Refined { body: fine, reduced_nodes, .. } = body.refined(Fineness::edge(0.6e-3)).unwrap();
    assert!(reduced_nodes > 0);
    // Against the same mesh whose coarse nodes are all test points: what the coarse body blends on its facets.
    let own = varied_as(&body).refined(Fineness::edge(0.6e-3)).unwrap().body;
    let force = |body: &Body, n: usize| body.node_response(n).unwrap().normal.value(5e-3);
    let off = (0..fine.nodes().len()).map(|n| (force(&fine, n) / force(&own, n) - 1.0).abs());
    let off = off.fold(0.0f64, f64::max);
    println!("{reduced_nodes} of {} nodes reduced, off by {off:.4} at most", fine.nodes().len());
    assert!(off < 0.02, "{off}");
    // Where elements choose other triples than their neighbours the force steps by part of that 1 %: no cliff.
    let steepest = |body: &Body| {
        let force: Vec<f64> =
            (0..body.nodes().len()).map(|n| body.node_response(n).unwrap().normal.value(5e-3)).collect();
        let slope = |e: &palpate_body::Element, i: usize| {
            let [a, b] = [e.nodes[i] as usize, e.nodes[(i + 1) % 3] as usize];
            (force[a] - force[b]).abs() / body.nodes()[a].position.distance(body.nodes()[b].position)
        };
        let slopes = body.elements().iter().flat_map(|e| (0..3).map(move |i| slope(e, i)));
        slopes.fold(0.0f64, f64::max)
    };
    let (coarse, refined) = (steepest(&body), steepest(&fine));
    println!("steepest {coarse:.3} → {refined:.3} N/m");
    assert!(refined < 4.0 * coarse, "{coarse} {refined}");
}

#[test]
fn lateral_tensors_are_carried() {
    let tube = shape(TUBE, around(24, 11), 180.0);
    let along = |u: &DVec3| tensor::along(DVec3::Z, 1.9, *u).unwrap();
    let tensors: Vec<_> = tube.nodes().iter().map(|n| along(&n.inward)).collect();
    let body = Body::new(BodyParts { lateral_tensors: Some(tensors.clone()), ..tube.parts() }).unwrap();
    let fine = body.refined(Fineness::sagitta(10e-6)).unwrap().body;
    let got = fine.lateral_tensors().unwrap();
    assert_eq!(got[..tensors.len()], tensors);
    for (n, a) in fine.nodes().iter().zip(got) {
        let stiffness = |v: DVec3| v.dot(tensor::apply(a, v));
        let (z, around) = (DVec3::Z, n.inward.cross(DVec3::Z).normalize());
        assert!(
            (stiffness(z) / stiffness(around) / 1.9 - 1.0).abs() < 1e-2,
            "{}",
            stiffness(z) / stiffness(around)
        );
    }
}

#[test]
fn the_users_own_finer_mesh_blends_what_lies_beneath() {
    let body = shape(SPHERE, edges_of(10.0), 180.0);
    let mesh = SPHERE.mesh(edges_of(2.5)).unwrap();
    let own = Surface::build(&mesh, f64::INFINITY).unwrap();
    let Refined { body: fine, distance_m, .. } = body.on_surface(own.clone()).unwrap();
    assert_eq!(fine.elements().len(), mesh.triangles.len());
    assert!(distance_m < 0.5e-3);
    for (n, node) in fine.nodes().iter().enumerate() {
        let force = fine.node_response(n).unwrap().normal.value(5e-3);
        let expected = Response::paper(stiffness(node.position), 1.0, 0.3, 8e-3, 8e-3).unwrap();
        assert!((force / expected.normal.value(5e-3) - 1.0).abs() < 0.03);
    }
    let refused = |surface: TriangleMesh, words: &str| {
        let error =
            body.on_surface(Surface::build(&surface, f64::INFINITY).unwrap()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    let mut large = mesh.clone();
    large.positions.iter_mut().for_each(|p| *p *= 10.0);
    refused(large, "unit");
    refused(SPHERE.mesh(edges_of(30.0)).unwrap(), "finer");
}

#[test]
fn what_asks_too_much_is_one_clear_error() {
    let body = shape(SPHERE, edges_of(10.0), 180.0);
    let refused = |fineness: Fineness, words: &[&str]| {
        let error = body.refined(fineness).unwrap_err().to_string();
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
    };
    let many = MAX_TRIANGLES.to_string();
    refused(Fineness::sagitta(1e-12), &["sagitta", "0.000001 µm", &many, "larger"]);
    refused(Fineness::edge(1e-7), &["edge length", "0.0001 mm", &many, "larger"]);
    refused(Fineness::sagitta(0.0), &["sagitta", "positive"]);
    refused(Fineness::edge(f64::NAN), &["edge length", "positive"]);
    let nodes = body.nodes().len();
    let coarse = body.refined(Fineness::sagitta(1.0)).unwrap().body;
    assert_eq!((coarse.nodes().len(), &coarse), (nodes, &body), "nothing to do");
}
