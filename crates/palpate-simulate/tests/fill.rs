//! Meshes of shapes and surfaces: closed, conforming, of good elements, and of the right volume.

use glam::DVec3;
use palpate_body::TriangleMesh;
use palpate_body::shape::{Resolution, Shape};
use palpate_simulate::mesh::distance::SignedDistance;
use palpate_simulate::mesh::shape::fill as fill_shape;
use palpate_simulate::mesh::stuffing::{Expected, FillOptions, FillReport, Finer, fill, fill_distance};
use palpate_simulate::mesh::{EDGES, FACES, TetMesh};
use std::collections::HashMap;
use std::path::Path;

const SPHERE: Shape = Shape::Sphere { radius_mm: 50.0 };
const TORUS: Shape = Shape::Torus { radii_mm: [50.0, 20.0] };
const ELLIPSOID: Shape = Shape::Ellipsoid { radii_mm: [50.0, 30.0, 20.0] };
const CYLINDER: Shape = Shape::Cylinder { radius_mm: 50.0, length_mm: 200.0, caps: false };
const BLOCK: Shape = Shape::Block { size_mm: [100.0, 80.0, 50.0] };

fn options(edge_mm: f64) -> FillOptions {
    FillOptions::new(edge_mm / 1e3)
}

/// Every face in one or two elements, every boundary edge in two faces, every node in an element, all corners right
/// side out, and the Euler number as it should be.
fn check(mesh: &TetMesh, report: &FillReport, euler: i64) {
    let mut faces: HashMap<[u32; 3], u32> = HashMap::new();
    let mut used = vec![false; mesh.positions.len()];
    for element in &mesh.elements {
        element.iter().for_each(|n| used[*n as usize] = true);
        let p = element.map(|n| mesh.positions[n as usize]);
        assert!((p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) > 0.0);
        for face in FACES {
            let mut key = face.map(|c| element[c]);
            key.sort_unstable();
            *faces.entry(key).or_default() += 1;
        }
    }
    assert!(used.iter().all(|u| *u), "a node is in no element");
    assert!(faces.values().all(|n| *n <= 2), "a face is shared by three elements");
    let boundary = mesh.boundary();
    let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
    for face in &boundary.faces {
        for i in 0..3 {
            let (a, b) = (face[i], face[(i + 1) % 3]);
            *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            *edges.entry([u32::MAX - a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    for (key, n) in &edges {
        assert_eq!(*n, if key[0] > u32::MAX / 2 { 2 } else { 0 }, "the boundary is not a closed manifold");
    }
    assert_eq!(report.pinched_edges, 0);
    assert_eq!(report.euler, euler);
    assert!(report.least_jacobian > 0.0);
    assert_eq!((report.nodes, report.elements), (mesh.positions.len(), mesh.elements.len()));
    assert_eq!(report.angles.iter().sum::<u32>() as usize, 6 * mesh.elements.len());
}

/// The paper's bounds, a little rounded.
fn check_angles(report: &FillReport) {
    assert!(report.least_angle_deg > 10.0, "{}", report.least_angle_deg);
    assert!(report.largest_angle_deg < 165.5, "{}", report.largest_angle_deg);
}

fn print(name: &str, report: &FillReport) {
    let off = |volume: f64| volume / report.surface_volume_m3 - 1.0;
    println!(
        "{name}: {} nodes, {} elements, angles {:.1} to {:.1}, edge {:.2} mm, volume {:+.1e} straight {:+.1e} \
         curved, Jacobian {:.2}, {} curved, {} straight; {:?}",
        report.nodes,
        report.elements,
        report.least_angle_deg,
        report.largest_angle_deg,
        report.surface_edge_m * 1e3,
        off(report.straight_volume_m3),
        off(report.volume_m3),
        report.least_jacobian,
        report.curved_edges,
        report.straight_edges,
        report.angles,
    );
}

#[test]
fn round_shapes_are_stuffed_within_the_papers_angles() {
    for (name, shape, euler) in [("sphere", SPHERE, 2), ("torus", TORUS, 0), ("ellipsoid", ELLIPSOID, 2)] {
        let mut errors = Vec::new();
        for edge_mm in [8.0, 4.0] {
            let (mesh, report) = fill_shape(&shape, &options(edge_mm)).unwrap();
            print(&format!("{name} {edge_mm} mm"), &report);
            check(&mesh, &report, euler);
            check_angles(&report);
            assert!((0.85..1.15).contains(&(report.surface_edge_m / edge_mm * 1e3)), "edges as asked");
            let off = |volume: f64| (volume / report.surface_volume_m3 - 1.0).abs();
            errors.push((off(report.straight_volume_m3), off(report.volume_m3)));
        }
        // Second order with straight edges; far better with curved ones.
        let ratio = errors[0].0 / errors[1].0;
        assert!((3.2..5.0).contains(&ratio), "{name}: {ratio}");
        assert!(errors.iter().all(|(straight, curved)| *curved < 0.1 * straight), "{name}: {errors:?}");
    }
}

#[test]
fn elements_grow_inwards_as_far_as_asked() {
    let longest = |interior_edge_m: f64| {
        let (mesh, report) = fill_shape(&BLOCK, &FillOptions { interior_edge_m, ..options(4.0) }).unwrap();
        check(&mesh, &report, 2);
        let edges = mesh.elements.iter().flat_map(|e| EDGES.map(|[a, b]| [e[a], e[b]]));
        edges
            .map(|[a, b]| mesh.positions[a as usize].distance(mesh.positions[b as usize]))
            .fold(0.0, f64::max)
    };
    let [same, twice, any] = [4e-3, 8e-3, 1.0].map(longest);
    assert!(same < 6.5e-3 && (7e-3..13e-3).contains(&twice) && any > 15e-3, "{same} {twice} {any}");
}

/// Balls a few cells across, joined with sharp creases, where all kinds of cuts occur: the paper's bounds but for a
/// degree.
#[test]
fn angles_are_bounded_on_rough_surfaces() {
    let (mut least, mut largest, mut filled) = (180.0f64, 0.0f64, 0);
    let points = scatter(DVec3::ZERO, DVec3::ONE, 4000);
    for trial in points.chunks_exact(8) {
        let balls: Vec<(DVec3, f64)> =
            (0..4).map(|i| (trial[i] * 3.0, 1.0 + 1.5 * trial[i + 4].x.abs())).collect();
        let union = |p: DVec3| {
            let ball = |(c, r): &(DVec3, f64)| (p.distance(*c) - r, (p - *c).normalize_or(DVec3::X));
            balls.iter().map(ball).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
        };
        let reach = DVec3::splat(3.0);
        let bounds = balls.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (c, _)| {
            (low.min(*c - reach), high.max(*c + reach))
        });
        let any = FillOptions { volume_tolerance: f64::INFINITY, curved: false, ..FillOptions::new(1.0) };
        // Some fall apart.
        if let Ok((_, report)) = fill_distance(&union, bounds, Expected { volume: 1.0, parts: 1 }, &any) {
            filled += 1;
            least = least.min(report.least_angle_deg);
            largest = largest.max(report.largest_angle_deg);
        }
    }
    println!("{filled} rough surfaces: angles {least:.2} to {largest:.2}");
    assert!(filled > 300);
    assert!(least > 9.5 && largest < 164.8, "{least} to {largest}");
}

#[test]
fn nodes_lie_on_the_surface() {
    let (mesh, report) = fill_shape(&SPHERE, &options(10.0)).unwrap();
    assert_eq!(report.straight_edges, 0);
    for n in mesh.boundary().nodes {
        assert!((mesh.positions[n as usize].length() - 0.05).abs() < 1e-14);
    }
    let straight = FillOptions { curved: false, ..options(10.0) };
    let (mesh, report) = fill_shape(&SPHERE, &straight).unwrap();
    assert_eq!(report.curved_edges, 0);
    assert_eq!(report.volume_m3, report.straight_volume_m3);
    assert!((report.least_jacobian - 1.0).abs() < 1e-9);
    for element in &mesh.elements {
        for (i, [a, b]) in EDGES.iter().enumerate() {
            let [a, b, m] = [*a, *b, 4 + i].map(|c| mesh.positions[element[c] as usize]);
            assert!(((a + b) / 2.0).distance(m) < 1e-15);
        }
    }
}

#[test]
fn a_block_keeps_its_edges_and_follows_planes() {
    let planes = vec![0.015, 0.019, -0.025, 0.025];
    let (mesh, report) = fill_shape(&BLOCK, &FillOptions { planes_z_m: planes, ..options(8.0) }).unwrap();
    print("layered block 8 mm", &report);
    check(&mesh, &report, 2);
    assert!((report.volume_m3 / report.surface_volume_m3 - 1.0).abs() < 1e-12);
    let corner = DVec3::new(0.05, 0.04, 0.025);
    assert!(mesh.positions.contains(&corner) && mesh.positions.contains(&-corner));
    for element in &mesh.elements {
        let z = element.map(|n| mesh.positions[n as usize].z);
        for plane in [0.015, 0.019] {
            assert!(z.iter().all(|z| *z <= plane) || z.iter().all(|z| *z >= plane));
        }
    }
    let (mesh, report) = fill_shape(&BLOCK, &options(8.0)).unwrap();
    print("block 8 mm", &report);
    check(&mesh, &report, 2);
    assert!(report.least_angle_deg > 35.0 && report.largest_angle_deg < 130.0);

    let outside = FillOptions { planes_z_m: vec![0.03], ..options(8.0) };
    assert!(fill_shape(&BLOCK, &outside).unwrap_err().to_string().contains("z = 30 mm"));
    let sphere = FillOptions { planes_z_m: vec![0.0], ..options(8.0) };
    assert!(fill_shape(&SPHERE, &sphere).unwrap_err().to_string().contains("blocks and cylinders"));
}

#[test]
fn a_cylinder_is_round_between_flat_ends() {
    for planes in [vec![], vec![0.06]] {
        let asked = FillOptions { planes_z_m: planes.clone(), ..options(8.0) };
        let (mesh, report) = fill_shape(&CYLINDER, &asked).unwrap();
        print("cylinder 8 mm", &report);
        check(&mesh, &report, 2);
        assert!((report.volume_m3 / report.surface_volume_m3 - 1.0).abs() < 1e-4);
        for n in mesh.boundary().nodes {
            let p = mesh.positions[n as usize];
            let off_mantle = (p.truncate().length() - 0.05).abs();
            assert!(p.z.abs() == 0.1 || off_mantle < 1e-14, "{p}");
            assert!(p.z.abs() <= 0.1 && p.truncate().length() <= 0.05 + 1e-14);
        }
        let rim =
            mesh.positions.iter().filter(|p| p.z == 0.1 && (p.truncate().length() - 0.05).abs() < 1e-14);
        assert!(rim.count() > 60);
        for element in &mesh.elements {
            let z = element.map(|n| mesh.positions[n as usize].z);
            assert!(planes.iter().all(|p| z.iter().all(|z| z <= p) || z.iter().all(|z| z >= p)));
        }
    }
}

#[test]
fn elements_are_finer_where_asked() {
    let tip = DVec3::new(0.0, 0.0, 0.025);
    let finer = vec![Finer::around(tip, 0.006, 0.001)];
    let (mesh, report) = fill_shape(&BLOCK, &FillOptions { finer: finer.clone(), ..options(8.0) }).unwrap();
    print("block 8 mm, finer", &report);
    check(&mesh, &report, 2);
    let near = |mesh: &TetMesh, tip: DVec3| {
        let touching = mesh.elements.iter().map(|e| e.map(|n| mesh.positions[n as usize]));
        let longest = touching
            .filter(|p| p[..4].iter().any(|p| p.distance(tip) < 0.005))
            .flat_map(|p| EDGES.map(|[a, b]| p[a].distance(p[b])));
        longest.fold(0.0, f64::max)
    };
    assert!(near(&mesh, tip) < 0.0016, "{}", near(&mesh, tip));

    for (name, shape, tip) in
        [("sphere", SPHERE, DVec3::new(0.0, 0.05, 0.0)), ("cylinder", CYLINDER, DVec3::new(0.0, 0.05, 0.0))]
    {
        let finer = vec![Finer::around(tip, 0.006, 0.002)];
        let (mesh, report) = fill_shape(&shape, &FillOptions { finer, ..options(10.0) }).unwrap();
        print(&format!("{name} 10 mm, finer"), &report);
        check(&mesh, &report, 2);
        assert!(near(&mesh, tip) < 0.005, "{}", near(&mesh, tip));
        assert!(report.least_angle_deg > 2.0, "{}", report.least_angle_deg);
    }
}

/// All of a block's top has small elements where a box says so, and little else has.
#[test]
fn elements_are_finer_around_a_box() {
    let top = Finer {
        low: DVec3::new(-0.02, -0.02, 0.025),
        high: DVec3::new(0.02, 0.02, 0.025),
        within_m: 0.004,
        edge_m: 0.003,
    };
    let finer = |finer| fill_shape(&BLOCK, &FillOptions { finer, ..options(12.0) }).unwrap();
    let (mesh, report) = finer(vec![top]);
    print("block 12 mm, finer under its top", &report);
    check(&mesh, &report, 2);
    let mut found = [0, 0];
    for element in &mesh.elements {
        let p: [DVec3; 4] = std::array::from_fn(|i| mesh.positions[element[i] as usize]);
        let middle = p.iter().sum::<DVec3>() / 4.0;
        let longest = EDGES.map(|[a, b]| p[a].distance(p[b])).into_iter().fold(0.0, f64::max);
        if middle.truncate().abs().max_element() < 0.02 && middle.z > 0.021 {
            assert!(longest < 0.0048, "{longest} at {middle}");
            found[0] += 1;
        } else if middle.z < 0.0 {
            found[1] += 1;
        }
    }
    assert!(found[0] > 1000 && found[0] > found[1], "{found:?}");
    let everywhere = FillOptions { finer: Vec::new(), ..options(3.0) };
    let (_, all) = fill_shape(&BLOCK, &everywhere).unwrap();
    assert!(2 * report.nodes < all.nodes, "{} of {}", report.nodes, all.nodes);
}

#[test]
fn meshes_do_not_depend_on_threads() {
    let surface = TORUS.mesh(Resolution { edge_length_mm: Some(4.0), ..Default::default() }).unwrap();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fill(&surface, &options(8.0)).unwrap())
    };
    assert!(on(1) == on(3));
}

#[test]
fn sharp_edges_of_a_surface_are_rounded_but_sound() {
    let surface = BLOCK.mesh(Resolution { edge_length_mm: Some(20.0), ..Default::default() }).unwrap();
    let (mesh, report) = fill(&surface, &options(6.0)).unwrap();
    print("block as a surface 6 mm", &report);
    check(&mesh, &report, 2);
    assert!(report.least_angle_deg > 10.0 && report.largest_angle_deg < 165.5);
    let distance = SignedDistance::new(&surface).unwrap();
    let corners: Vec<u32> = mesh.boundary().faces.iter().flat_map(|f| f[..3].to_vec()).collect();
    for n in corners {
        assert!(distance.distance(mesh.positions[n as usize]).0.abs() < 1e-12);
    }
}

#[test]
fn what_is_too_thin_is_refused() {
    let refused = |surface: &TriangleMesh, edge_mm: f64, word: &str| {
        let message = fill(surface, &options(edge_mm)).unwrap_err().to_string();
        assert!(message.contains(word) && message.contains("element_size_mm"), "{message}");
    };
    let plate = Shape::Block { size_mm: [100.0, 100.0, 2.0] };
    refused(&plate.mesh(Resolution { edge_length_mm: Some(10.0), ..Default::default() }).unwrap(), 20.0, "");
    let thin = Shape::Torus { radii_mm: [50.0, 4.0] };
    let thin = thin.mesh(Resolution { edge_length_mm: Some(2.0), ..Default::default() }).unwrap();
    refused(&thin, 15.0, "");
    assert!(fill(&thin, &options(3.0)).is_ok());

    // Two balls, one of which is lost.
    let ball = |radius_mm: f64, at: DVec3| {
        let mut mesh = Shape::Sphere { radius_mm }.mesh(Resolution::default()).unwrap();
        mesh.positions.iter_mut().for_each(|p| *p += at);
        mesh
    };
    let (mut both, small) = (ball(20.0, DVec3::ZERO), ball(5.0, DVec3::X * 0.04));
    let first = both.positions.len() as u32;
    both.positions.extend(&small.positions);
    both.triangles.extend(small.triangles.iter().map(|t| t.map(|v| v + first)));
    let (mesh, report) = fill(&both, &options(2.5)).unwrap();
    check(&mesh, &report, 4);
    refused(&both, 12.0, "parts");
}

/// Two balls that overlap, as one surface that crosses itself.
#[test]
fn a_surface_may_cross_itself() {
    let ball = Shape::Sphere { radius_mm: 20.0 }.mesh(Resolution::default()).unwrap();
    let mut both = ball.clone();
    both.positions.extend(ball.positions.iter().map(|p| *p + DVec3::X * 0.02));
    both.triangles.extend(ball.triangles.iter().map(|t| t.map(|v| v + ball.positions.len() as u32)));
    let distance = SignedDistance::new(&both).unwrap();
    for p in scatter(distance.bounds().0, distance.bounds().1, 1000) {
        let inside = SignedDistance::new(&ball).unwrap();
        let inside = inside.distance(p).0 < 0.0 || inside.distance(p - DVec3::X * 0.02).0 < 0.0;
        assert_eq!(distance.distance_by_winding(p).0 < 0.0, inside, "{p}");
    }
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let refused = |options: FillOptions, word: &str| {
        let message = fill_shape(&SPHERE, &options).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    refused(options(0.0), "element_size_mm");
    refused(options(f64::NAN), "element_size_mm");
    refused(options(1e-3), "give a larger size");
    refused(FillOptions { interior_edge_m: 0.001, ..options(8.0) }, "interior_size_mm");
    let refused_place = |place| refused(FillOptions { finer: vec![place], ..options(8.0) }, "finer");
    refused_place(Finer::around(DVec3::NAN, 0.01, 0.001));
    refused_place(Finer::around(DVec3::ZERO, 0.01, 1e-9));
    refused_place(Finer { high: DVec3::NEG_X, ..Finer::around(DVec3::ZERO, 0.01, 0.001) });
}

/// The smoothed liver of SOFA, in cm, if it is there.
fn liver() -> Option<TriangleMesh> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/sofa/liver-smooth.obj");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: {} is not there", path.display());
        return None;
    };
    let mut mesh = TriangleMesh::default();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let p: Vec<f64> = words.map(|w| w.parse().unwrap()).collect();
                mesh.positions.push(DVec3::new(p[0], p[1], p[2]) / 100.0);
            }
            Some("f") => {
                let v: Vec<u32> =
                    words.map(|w| w.split('/').next().unwrap().parse::<u32>().unwrap() - 1).collect();
                mesh.triangles.push([v[0], v[1], v[2]]);
            }
            _ => {}
        }
    }
    Some(mesh)
}

#[test]
fn an_organ_is_filled() {
    let Some(surface) = liver() else { return };
    for edge_mm in [4.0, 2.5] {
        let before = std::time::Instant::now();
        let (mesh, report) = fill(&surface, &options(edge_mm)).unwrap();
        println!("{:?}", before.elapsed());
        print(&format!("liver {edge_mm} mm"), &report);
        check(&mesh, &report, SignedDistance::new(&surface).unwrap().euler());
        check_angles(&report);
    }
}

/// Points in and around a box, always the same.
fn scatter(low: DVec3, high: DVec3, count: usize) -> Vec<DVec3> {
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..count)
        .map(|_| low + (high - low) * (DVec3::new(random(), random(), random()) * 1.4 - DVec3::splat(0.2)))
        .collect()
}

/// By looking at all triangles: the distance to each, and the solid angle they subtend (van Oosterom and Strackee).
fn by_all_triangles(mesh: &TriangleMesh, p: DVec3) -> f64 {
    let (mut nearest, mut solid_angle) = (f64::INFINITY, 0.0);
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize] - p);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        solid_angle += 2.0 * a.dot(b.cross(c)).atan2(below);
        let normal = (b - a).cross(c - a).normalize();
        let foot = normal * normal.dot(a);
        let within = |u: DVec3, v: DVec3| (v - u).cross(foot - u).dot(normal) >= 0.0;
        if within(a, b) && within(b, c) && within(c, a) {
            nearest = nearest.min(foot.length());
        }
        for (u, v) in [(a, b), (b, c), (c, a)] {
            let s = (-u.dot(v - u) / (v - u).length_squared()).clamp(0.0, 1.0);
            nearest = nearest.min((u + (v - u) * s).length());
        }
    }
    if solid_angle.abs() > 2.0 * std::f64::consts::PI { -nearest } else { nearest }
}

#[test]
fn distances_are_those_of_all_triangles() {
    let fine = Resolution { edge_length_mm: Some(6.0), ..Default::default() };
    let block = Shape::Block { size_mm: [40.0, 30.0, 20.0] };
    let mut meshes: Vec<TriangleMesh> =
        [TORUS, ELLIPSOID, block].iter().map(|s| s.mesh(fine).unwrap()).collect();
    meshes.extend(liver());
    for mesh in meshes {
        let distance = SignedDistance::new(&mesh).unwrap();
        let (low, high) = distance.bounds();
        let mut points = scatter(low, high, 400);
        // Nearest to vertices and edges too.
        points.extend(mesh.positions.iter().step_by(17).map(|p| *p + (*p - (low + high) / 2.0) * 0.05));
        for p in points {
            let (d, gradient) = distance.distance(p);
            let exact = by_all_triangles(&mesh, p);
            assert!((d - exact).abs() < 1e-12, "{p}: {d} for {exact}");
            assert_eq!(distance.distance_by_winding(p).0.abs(), d.abs());
            assert!((distance.distance_by_winding(p).0 - exact).abs() < 1e-12);
            assert!(gradient.is_normalized());
            assert_eq!(distance.distance_within(p, d.abs() * 0.999), None);
            assert_eq!(distance.distance_within(p, d.abs() * 1.001), Some((d, gradient)));
            // The nearest point is on the surface.
            assert!(distance.distance(p - gradient * d).0.abs() < 1e-12);
        }
        let points = scatter(low, high, 20_000);
        let before = std::time::Instant::now();
        let sum: f64 = points.iter().map(|p| distance.distance(*p).0).sum();
        println!("{} triangles: {:?} a query ({sum:.3})", mesh.triangles.len(), before.elapsed() / 20_000);
        let before = std::time::Instant::now();
        let near: Vec<DVec3> = mesh.positions.iter().map(|p| *p * 1.02).collect();
        let sum: f64 = (0..10).flat_map(|_| &near).map(|p| distance.distance(*p).0).sum();
        println!("   near: {:?} a query ({sum:.3})", before.elapsed() / near.len() as u32 / 10);
    }
}

#[test]
fn distances_on_vertices_are_zero_with_a_normal() {
    let block = Shape::Block { size_mm: [40.0, 30.0, 20.0] };
    let mesh = block.mesh(Resolution::default()).unwrap();
    let distance = SignedDistance::new(&mesh).unwrap();
    let (d, gradient) = distance.distance(DVec3::new(0.02, 0.015, 0.01));
    assert_eq!(d, 0.0);
    assert!((gradient - DVec3::splat(1.0 / 3f64.sqrt())).length() < 1e-12);
    assert!((distance.volume() - 24e-6).abs() < 1e-18);
    assert_eq!((distance.euler(), distance.shells().len()), (2, 1));
}

#[test]
fn surfaces_without_an_inside_are_refused() {
    let refused = |change: &dyn Fn(&mut TriangleMesh), word: &str| {
        let mut mesh = SPHERE.mesh(Resolution::default()).unwrap();
        change(&mut mesh);
        let message = SignedDistance::new(&mesh).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    refused(&|m| m.triangles.clear(), "no triangle");
    refused(&|m| m.triangles.truncate(m.triangles.len() - 1), "hole");
    refused(&|m| m.triangles[3].swap(0, 1), "opposite ways");
    refused(&|m| m.triangles.iter_mut().for_each(|t| t.swap(0, 1)), "faces inwards");
    refused(&|m| m.triangles[0][0] = 999_999, "triangle 0");
    refused(&|m| m.positions[5].x = f64::NAN, "vertex 5");
    refused(&|m| m.triangles.push(m.triangles[0]), "3 triangles share it");
}
