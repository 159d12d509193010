//! Shapes: sizes, orientation, triangle counts, edge lengths, and the messages of a wrong `[body.shape]`.

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape, ShapeKind, ShapeSpec};
use palpate_body::{Surface, TriangleMesh};
use std::f64::consts::PI;

fn volume(mesh: &TriangleMesh) -> f64 {
    let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize]));
    corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

fn edges(mesh: &TriangleMesh) -> Vec<f64> {
    let ends = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    ends.map(|(a, b)| (mesh.positions[a as usize] - mesh.positions[b as usize]).length()).collect()
}

fn mean_edge_mm(mesh: &TriangleMesh) -> f64 {
    let edges = edges(mesh);
    edges.iter().sum::<f64>() / edges.len() as f64 * 1e3
}

fn edge(mm: f64) -> Resolution {
    Resolution { edge_length_mm: Some(mm), ..Default::default() }
}

fn border(mesh: &TriangleMesh) -> usize {
    Surface::build(mesh, f64::INFINITY).unwrap().border().count()
}

fn near(value: f64, expected: f64, relative: f64) {
    assert!((value / expected - 1.0).abs() < relative, "{value}, expected {expected}");
}

#[test]
fn the_papers_cylinder_has_528_triangles_in_rows() {
    let shape = Shape::Cylinder { radius_mm: 30.0, length_mm: 110.0, caps: false };
    let mesh = shape.mesh(Resolution { around: Some(24), along: Some(11), ..Default::default() }).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.positions.len(), border(&mesh)), (528, 24 * 12, 48));
    for row in 0..12 {
        for column in 0..24 {
            let p = mesh.positions[row * 24 + column];
            let angle = 2.0 * PI * column as f64 / 24.0;
            let expected = DVec3::new(0.03 * angle.cos(), 0.03 * angle.sin(), -0.055 + 0.01 * row as f64);
            assert!((p - expected).length() < 1e-16, "{p} {expected}");
        }
    }
    let outward = mesh.triangles.iter().all(|t| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        (b - a).cross(c - a).dot((a + b + c) * DVec3::new(1.0, 1.0, 0.0)) > 0.0
    });
    assert!(outward);
}

#[test]
fn caps_close_a_cylinder_with_triangles_of_the_same_size() {
    let shape = Shape::Cylinder { radius_mm: 20.0, length_mm: 30.0, caps: true };
    for (around, along) in [(3, 1), (4, 1), (7, 2), (24, 6), (60, 14)] {
        let mesh = shape
            .mesh(Resolution { around: Some(around), along: Some(along), ..Default::default() })
            .unwrap();
        assert_eq!(border(&mesh), 0);
        let n = f64::from(around);
        near(volume(&mesh), 0.02 * 0.02 * 0.03 * n / 2.0 * (2.0 * PI / n).sin(), 1e-12);
    }
    let mesh = shape.mesh(edge(2.0)).unwrap();
    let edges = edges(&mesh);
    let (least, most) = edges.iter().fold((1.0f64, 0.0f64), |(l, m), &e| (l.min(e), m.max(e)));
    assert!(least > 0.9e-3 && most < 3.2e-3, "{least} {most}");
}

#[test]
fn spheres_honour_radius_and_edge_length() {
    let shape = Shape::Sphere { radius_mm: 30.0 };
    for wanted in [1.0, 2.0, 3.7, 5.0, 9.0] {
        let mesh = shape.mesh(edge(wanted)).unwrap();
        near(mean_edge_mm(&mesh), wanted, 0.1);
        assert_eq!(border(&mesh), 0);
        assert!(mesh.positions.iter().all(|p| (p.length() - 0.03).abs() < 1e-16));
        let edges = edges(&mesh);
        let (least, most) = edges.iter().fold((1.0f64, 0.0f64), |(l, m), &e| (l.min(e), m.max(e)));
        assert!(most / least < 1.35, "{}", most / least);
    }
    near(volume(&shape.mesh(edge(1.0)).unwrap()), 4.0 / 3.0 * PI * 0.03f64.powi(3), 1e-3);
    let icosahedron = shape.mesh(edge(31.0)).unwrap();
    assert_eq!((icosahedron.positions.len(), icosahedron.triangles.len()), (12, 20));
    let mesh = shape.mesh(Resolution::default()).unwrap();
    near(mean_edge_mm(&mesh), 5.0, 0.1);
    assert_eq!(mesh.triangles.len() % 20, 0);
    assert_eq!(mesh.positions.len(), mesh.triangles.len() / 2 + 2);
}

#[test]
fn ellipsoids_blocks_and_tori_are_closed_and_face_out() {
    let shape = Shape::Ellipsoid { radii_mm: [40.0, 30.0, 20.0] };
    let mesh = shape.mesh(edge(2.0)).unwrap();
    assert_eq!(border(&mesh), 0);
    near(mean_edge_mm(&mesh), 2.0, 0.1);
    near(volume(&mesh), 4.0 / 3.0 * PI * 0.04 * 0.03 * 0.02, 5e-3);

    for size_mm in [[40.0; 3], [40.0, 30.0, 20.0], [4.0, 50.0, 11.0]] {
        let mesh = Shape::Block { size_mm }.mesh(edge(4.0)).unwrap();
        assert_eq!(border(&mesh), 0);
        near(volume(&mesh), size_mm.iter().product::<f64>() * 1e-9, 1e-12);
        assert_eq!(mesh.positions.len(), mesh.triangles.len() / 2 + 2);
    }
    assert_eq!(Shape::Block { size_mm: [40.0; 3] }.mesh(edge(40.0)).unwrap().triangles.len(), 12);

    let shape = Shape::Torus { radii_mm: [30.0, 10.0] };
    let mesh = shape.mesh(edge(1.0)).unwrap();
    assert_eq!(border(&mesh), 0);
    near(volume(&mesh), 2.0 * PI * PI * 0.03 * 0.01 * 0.01, 5e-3);
    let mesh = shape.mesh(Resolution { around: Some(12), along: Some(5), ..Default::default() }).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (60, 120));
}

#[test]
fn every_default_resolution_gives_a_surface() {
    let shapes = [
        Shape::Cylinder { radius_mm: 30.0, length_mm: 120.0, caps: true },
        Shape::Cylinder { radius_mm: 30.0, length_mm: 1.0, caps: true },
        Shape::Sphere { radius_mm: 0.01 },
        Shape::Block { size_mm: [10.0, 20.0, 30.0] },
        Shape::Ellipsoid { radii_mm: [10.0, 5.0, 50.0] },
        Shape::Torus { radii_mm: [50.0, 5.0] },
    ];
    for shape in shapes {
        let surface = shape.surface(Resolution::default()).unwrap();
        assert_eq!(surface.border().count(), 0);
        let count = surface.elements().len();
        assert!((100..10_000).contains(&count), "{shape:?}: {count}");
    }
}

#[test]
fn five_million_triangles_take_seconds() {
    let start = std::time::Instant::now();
    let mesh = Shape::Sphere { radius_mm: 30.0 }.mesh(edge(0.0723)).unwrap();
    near(mesh.triangles.len() as f64, 5e6, 0.01);
    let mesh = Shape::Cylinder { radius_mm: 30.0, length_mm: 100.0, caps: true }.mesh(edge(0.105)).unwrap();
    assert!(mesh.triangles.len() > 3_000_000);
    let mesh = Shape::Block { size_mm: [40.0; 3] }.mesh(edge(0.045)).unwrap();
    assert!(mesh.triangles.len() > 8_000_000);
    eprintln!("meshed in {:?}", start.elapsed());
    assert!(start.elapsed().as_secs() < 30);
}

fn spec(kind: ShapeKind) -> ShapeSpec {
    ShapeSpec {
        kind,
        radius_mm: None,
        length_mm: None,
        size_mm: None,
        radii_mm: None,
        edge_length_mm: None,
        around: None,
        along: None,
        caps: None,
    }
}

#[test]
fn specs_resolve() {
    let cylinder = ShapeSpec {
        radius_mm: Some(30.0),
        length_mm: Some(110.0),
        around: Some(24),
        ..spec(ShapeKind::Cylinder)
    };
    let (shape, resolution) = cylinder.resolve().unwrap();
    assert_eq!(shape, Shape::Cylinder { radius_mm: 30.0, length_mm: 110.0, caps: false });
    assert_eq!(resolution, Resolution { around: Some(24), ..Default::default() });
    let torus = ShapeSpec { radii_mm: Some(vec![30.0, 10.0]), ..spec(ShapeKind::Torus) };
    assert_eq!(torus.resolve().unwrap().0, Shape::Torus { radii_mm: [30.0, 10.0] });
    let json = r#"{"kind":"block","size_mm":[1,2,3],"edge_length_mm":0.5}"#;
    let block: ShapeSpec = serde_json::from_str(json).unwrap();
    assert_eq!(block.resolve().unwrap().0, Shape::Block { size_mm: [1.0, 2.0, 3.0] });
    let unknown = r#"{"kind":"block","size_mm":[1,2,3],"edge":0.5}"#;
    assert!(serde_json::from_str::<ShapeSpec>(unknown).unwrap_err().to_string().contains("edge"));
}

#[test]
fn wrong_specs_name_their_key() {
    let sphere = || ShapeSpec { radius_mm: Some(30.0), ..spec(ShapeKind::Sphere) };
    let cylinder =
        || ShapeSpec { radius_mm: Some(30.0), length_mm: Some(110.0), ..spec(ShapeKind::Cylinder) };
    let ellipsoid =
        |radii: &[f64]| ShapeSpec { radii_mm: Some(radii.to_vec()), ..spec(ShapeKind::Ellipsoid) };
    let wrong = [
        (spec(ShapeKind::Sphere), "radius_mm", "missing"),
        (ShapeSpec { length_mm: Some(1.0), ..sphere() }, "length_mm", "no such size"),
        (ShapeSpec { caps: Some(true), ..sphere() }, "caps", "no such size"),
        (ShapeSpec { radius_mm: Some(0.0), ..sphere() }, "radius_mm", "0 mm"),
        (ShapeSpec { radius_mm: Some(f64::NAN), ..sphere() }, "radius_mm", "NaN"),
        (ShapeSpec { radius_mm: Some(1e9), ..sphere() }, "radius_mm", "sensible"),
        (ShapeSpec { edge_length_mm: Some(-1.0), ..sphere() }, "edge_length_mm", "-1"),
        (ShapeSpec { edge_length_mm: Some(61.0), ..sphere() }, "edge_length_mm", "longer"),
        (ShapeSpec { edge_length_mm: Some(0.01), ..sphere() }, "edge_length_mm", "triangles"),
        (ShapeSpec { around: Some(24), ..sphere() }, "around", "edge_length_mm"),
        (ShapeSpec { around: Some(2), ..cylinder() }, "around", "3 at least"),
        (ShapeSpec { along: Some(0), ..cylinder() }, "along", "1 at least"),
        (ShapeSpec { around: Some(u32::MAX), along: Some(u32::MAX), ..cylinder() }, "around", "triangles"),
        (
            ShapeSpec { around: Some(24), along: Some(11), edge_length_mm: Some(1.0), ..cylinder() },
            "edge_length_mm",
            "leave out",
        ),
        (ellipsoid(&[1.0, 2.0]), "radii_mm", "three radii"),
        (ShapeSpec { kind: ShapeKind::Torus, ..ellipsoid(&[10.0, 10.0]) }, "radii_mm", "not smaller"),
    ];
    for (spec, key, words) in wrong {
        let message = spec.resolve().unwrap_err().to_string();
        assert!(
            message.starts_with(&format!("[body.shape] {key}: ")) && message.contains(words),
            "{message}"
        );
        assert!(!message.contains('\n'));
    }
}
