//! The .paths file: what was written comes back, of this version and of those before.

use glam::DVec3;
use palpate_body::TriangleMesh;
use palpate_build::paths_file::{PathsPlan, PathsRecord, Point, Scene, TestPoint};
use palpate_build::precompute::{assemble, merge};
use palpate_simulate::{Drag, Path as LoadPath, PointPaths, PointPlan, State};
use std::fs;
use std::path::PathBuf;

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/files").join(name)
}

/// A file that was written before there were tangents and other columns makes the same body, to the byte, although contact now
/// sticks where a spec says nothing.
#[test]
fn a_file_of_version_1_makes_the_body_it_made() {
    let record = merge(&[file("version-1.paths")]).unwrap();
    assert_eq!((record.points.len(), record.plan.contact.as_deref()), (3, None));
    let paths = record.points[&1].paths_with_displacements().unwrap();
    assert_eq!((paths.press.states.len(), paths.drags.len()), (3, 4));
    let state = &paths.press.states[2];
    assert!((state.depth_m - 3e-3).abs() < 1e-12);
    assert!(state.force_n.length() > 0.01 && state.patch_m2 > 0.0 && state.iterations > 0, "{state:?}");
    assert!(state.displacement_m.iter().flatten().any(|d| d.abs() > 1e-3));
    assert_eq!((state.pressed_n, state.tangent.is_none(), state.indefinite), (0.0, true, false));

    let body = fs::read(file("version-1.body")).unwrap();
    assert!(assemble::body(&record).unwrap().body.to_bytes().unwrap() == body);
    // Written again it has this version.
    let folder = tempfile::tempdir().unwrap();
    let again = folder.path().join("again.paths");
    record.save(&again).unwrap();
    let again = PathsRecord::open(&again).unwrap();
    assert_eq!((again.points[&1].paths(), &again.scene), (record.points[&1].paths(), &record.scene));
    assert!(assemble::body(&again).unwrap().body.to_bytes().unwrap() == body);
}

fn record(index: u32) -> (PathsRecord, PointPaths) {
    let plan = PointPlan {
        point: DVec3::X,
        inward: -DVec3::X,
        depths: vec![1e-3, 2e-3, 3e-3],
        drags: vec![Drag { from: 1, direction: DVec3::Y, distances: vec![1e-3] }],
    };
    let state = |depth: f64, distance: f64| State {
        depth_m: depth,
        distance_m: distance,
        force_n: DVec3::new(-depth, distance, 0.1),
        torque_n_m: DVec3::splat(0.3),
        patch_m2: 1e-5,
        pressed_n: 2.0 * depth,
        slipping: 0.25,
        tangent: (depth != 2e-3)
            .then(|| Box::new(std::array::from_fn(|r| std::array::from_fn(|c| depth + (r * c) as f64)))),
        indefinite: depth == 2e-3,
        displacement_m: Vec::new(),
        iterations: 7,
    };
    let press = LoadPath {
        states: plan.depths.iter().map(|&d| state(d, 0.0)).collect(),
        stopped: None,
        halved: None,
    };
    let drag =
        LoadPath { states: vec![State { tangent: None, ..state(2e-3, 1e-3) }], stopped: None, halved: None };
    let paths = PointPaths { press, drags: vec![drag] };
    let surface =
        TriangleMesh { positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]] };
    let scene = Scene { boundary_m: surface.positions.clone(), surface, ..Scene::default() };
    let point = Point::new(index, &TestPoint { node: 1, plan }, &paths, 3);
    let record = PathsRecord {
        plan: PathsPlan::default(),
        total: 2,
        scene: Some(scene),
        points: [(index, point)].into(),
    };
    (record, paths)
}

#[test]
fn states_come_back_with_their_tangents() {
    let (record, paths) = record(0);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one.paths");
    record.save(&path).unwrap();
    let back = PathsRecord::open(&path).unwrap();
    assert_eq!(back.points[&0].paths(), paths);

    // Each byte of the tangents counts.
    let bytes = fs::read(&path).unwrap();
    let tangent = 3e-3f64 + 25.0;
    let at = bytes.windows(8).position(|w| w == tangent.to_le_bytes()).unwrap();
    let mut damaged = bytes.clone();
    damaged[at + 6] ^= 1;
    fs::write(&path, damaged).unwrap();
    let error = PathsRecord::open(&path).unwrap_err().to_string();
    assert!(error.contains("digest"), "{error}");
}

#[test]
fn shards_of_different_machines_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let shards = [(0, "x86-64-v3"), (1, "x86-64-v3 with AVX-512")].map(|(index, machine)| {
        let (mut record, _) = record(index);
        record.plan.machine = Some(machine.into());
        let path = folder.path().join(format!("{machine}.paths"));
        record.save(&path).unwrap();
        path
    });
    let error = merge(&shards).unwrap_err().to_string();
    let words = ["kind of machine", "x86-64-v3, now x86-64-v3 with AVX-512", "x86-64-v3.paths"];
    assert!(words.iter().all(|w| error.contains(w)), "{error}");
}
