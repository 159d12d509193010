//! What is found before the first solve, in words that name it; figures of quality against known ones.

use glam::DVec3;
use palpate_simulate::TetMesh;
use palpate_simulate::mesh::check::{Quality, check};
use std::f64::consts::PI;

/// A bar of cubes of side 1 along x, 6 tetrahedra each.
fn bar(cubes: u32, gap: f64) -> TetMesh {
    let (mut positions, mut tetrahedra) = (Vec::new(), Vec::new());
    for x in 0..=cubes {
        for yz in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            positions.push(DVec3::new(f64::from(x) * (1.0 + gap), yz[0], yz[1]));
        }
    }
    for x in 0..cubes {
        let n = |i: u32| 4 * x + i;
        // Around the diagonal from 0 to 6.
        for [a, b] in [[1, 2], [2, 3], [3, 7], [7, 4], [4, 5], [5, 1]] {
            tetrahedra.push([n(0), n(a), n(b), n(6)]);
        }
    }
    TetMesh::from_corners(positions, &tetrahedra)
}

/// Held on all sides where `held` says so.
fn fixed(mesh: &TetMesh, held: impl Fn(DVec3) -> bool) -> Vec<[bool; 3]> {
    mesh.positions.iter().map(|&p| [held(p); 3]).collect()
}

/// Held at x = 0.
fn checked(mesh: &TetMesh) -> Result<Vec<String>, String> {
    check(mesh, &fixed(mesh, |p| p.x == 0.0)).map_err(|e| e.to_string())
}

fn refused(mesh: &TetMesh, words: &[&str]) {
    let message = checked(mesh).unwrap_err();
    assert!(!message.contains('\n') && message.contains("; "), "{message}");
    for word in words {
        assert!(message.contains(word), "`{word}` is not in: {message}");
    }
}

/// A mesh of several, not joined.
fn together(meshes: &[TetMesh]) -> TetMesh {
    let mut all = TetMesh::default();
    for (m, mesh) in meshes.iter().enumerate() {
        let first = all.positions.len() as u32;
        all.positions.extend(&mesh.positions);
        all.elements.extend(mesh.elements.iter().map(|e| e.map(|n| n + first)));
        all.regions.extend(mesh.regions.iter().map(|_| m as u32));
        all.region_names.push(format!("part {m}"));
    }
    all
}

fn moved(mut mesh: TetMesh, by: DVec3) -> TetMesh {
    mesh.positions.iter_mut().for_each(|p| *p += by);
    mesh
}

#[test]
fn a_sound_body_passes_without_a_word() {
    let mesh = bar(3, 0.0);
    assert_eq!(mesh.elements.len(), 18);
    assert_eq!(checked(&mesh), Ok(vec![]));
}

#[test]
fn figures_are_those_of_known_solids() {
    let regular =
        [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(DVec3::from_array);
    let quality = Quality::of(&TetMesh::from_corners(regular.to_vec(), &[[0, 1, 2, 3]]));
    let third = libm::acos(1.0 / 3.0);
    assert!((quality.smallest_dihedral_rad - third).abs() < 1e-14);
    assert!((quality.largest_dihedral_rad - third).abs() < 1e-14);
    assert!((quality.smallest_scaled_volume - 1.0).abs() < 1e-14);
    assert!((quality.volume_m3 - 8.0 / 3.0).abs() < 1e-14);
    for length in [quality.mean_edge_m, quality.shortest_boundary_edge_m, quality.longest_boundary_edge_m] {
        assert!((length - 8f64.sqrt()).abs() < 1e-14);
    }
    let quality = Quality::of(&bar(1, 0.0));
    assert_eq!((quality.elements, quality.nodes, quality.boundary_faces), (6, 27, 12));
    assert!((quality.volume_m3 - 1.0).abs() < 1e-14);
    // Six equal tetrahedra around a cube's diagonal.
    assert!((quality.smallest_dihedral_rad - PI / 4.0).abs() < 1e-14);
    assert!((quality.largest_dihedral_rad - PI / 2.0).abs() < 1e-14);
    assert!((quality.longest_boundary_edge_m - 2f64.sqrt()).abs() < 1e-14);
    assert!((quality.mean_boundary_edge_m - (2.0 + 2f64.sqrt()) / 3.0).abs() < 1e-14);
}

#[test]
fn bad_elements_are_named() {
    let cube = bar(1, 0.0);
    let corners: Vec<[u32; 4]> = cube.elements.iter().map(|e| [e[0], e[1], e[2], e[3]]).collect();
    let mut positions = cube.positions[..8].to_vec();
    positions[5] = positions[1] / 2.0;
    let flat = TetMesh::from_corners(positions, &corners);
    refused(&flat, &["element 5 (from 0) at (", "flat: it has no volume", "gmsh -optimize"]);
    let mut inside_out = bar(1, 0.0);
    inside_out.elements[3].swap(2, 3);
    refused(&inside_out, &["element 3 (from 0) at (", "it is inverted"]);
}

#[test]
fn curved_elements_are_judged_by_their_jacobian() {
    let bent = |by: f64| {
        let mut mesh = bar(1, 0.0);
        // The middle of the cube's edge from (1, 0, 0) to (1, 1, 0), which belongs to one element.
        let middle = mesh.positions.iter().position(|&p| p == DVec3::new(1.0, 0.5, 0.0)).unwrap();
        mesh.positions[middle].x += by;
        mesh
    };
    assert_eq!(checked(&bent(0.1)), Ok(vec![]));
    assert_eq!(checked(&bent(-0.2)), Ok(vec![]));
    refused(&bent(-0.45), &["(from 0) at (", "curved so much that it folds", "Gmsh: SetOrder 1"]);
    let mut other_order = bar(1, 0.0);
    for element in &mut other_order.elements {
        element.swap(8, 9);
    }
    refused(
        &other_order,
        &["element 0", "nodes on edges stand in another order", "with the program that made it"],
    );
}

#[test]
fn slivers_are_noted() {
    let sliver = |height| {
        let positions = vec![DVec3::ZERO, DVec3::Y, DVec3::Z, DVec3::new(height, 0.3, 0.3)];
        checked(&TetMesh::from_corners(positions, &[[0, 1, 2, 3]])).unwrap()
    };
    let notes = sliver(0.005);
    // The angle at an edge of the base: its tangent is 0.005 / 0.3; at the opposite ones it is larger.
    let said = "1 of 1 elements are slivers; the worst has an angle of 0.95°: element 0";
    assert!(notes.len() == 1 && notes[0].starts_with(said), "{notes:?}");
    assert!(sliver(0.02).is_empty());
}

#[test]
fn a_mesh_that_is_no_manifold_is_named() {
    let mut twice = bar(2, 0.0);
    twice.elements.push(twice.elements[7]);
    twice.regions.push(0);
    refused(&twice, &["element 7 (from 0)", "element 12 has the same four corners", "MSH 2.2"]);

    // A third one on a face inside, with its top elsewhere.
    let mut fan = bar(1, 0.0);
    let face = [fan.elements[0][0], fan.elements[0][2], fan.elements[0][3]];
    fan.positions.truncate(8);
    let mut corners: Vec<[u32; 4]> = fan.elements.iter().map(|e| [e[0], e[1], e[2], e[3]]).collect();
    fan.positions.push(DVec3::new(5.0, 6.0, -7.0));
    corners.push([face[0], face[1], face[2], 8]);
    refused(&TetMesh::from_corners(fan.positions.clone(), &corners), &["belongs to 3 elements: "]);

    // The same on the boundary, towards the inside.
    corners.pop();
    let outer = corners[0];
    corners.push([outer[0], outer[1], outer[2], 8]);
    fan.positions[8] = DVec3::new(0.4, 0.5, 0.45);
    refused(
        &TetMesh::from_corners(fan.positions, &corners),
        &["lie on the same side of the face", "must not overlap"],
    );

    let mut gaping = bar(1, 0.0);
    let middle = gaping.positions[gaping.elements[2][4] as usize];
    gaping.elements[2][4] = gaping.positions.len() as u32;
    gaping.positions.push(middle);
    refused(&gaping, &["different nodes on the edge that they share", "Coherence Mesh"]);
}

#[test]
fn a_body_that_nothing_holds_is_refused() {
    let mesh = bar(2, 0.0);
    let message = |held: &dyn Fn(DVec3) -> bool| check(&mesh, &fixed(&mesh, held)).unwrap_err().to_string();
    assert!(
        message(&|_| false)
            .contains("nothing holds the body: no node is fixed; hold it with `[[body.fixed]]`")
    );
    assert!(message(&|p| p == DVec3::ZERO).contains("it is held at one place only"));
    let line = message(&|p| p.x == 0.0 && p.y == 0.0);
    assert!(line.contains(
        "part of 12 elements, 2000.000 x 1000.000 x 1000.000 mm around (1000.000, 500.000, 500.000) mm"
    ));
    assert!(line.contains("one line only, about which it can turn; hold it at three nodes"), "{line}");
}

#[test]
fn free_parts_are_named_and_noted_where_they_touch() {
    let [first, second] = [bar(1, 0.0), moved(bar(2, 0.0), DVec3::X)];
    let touching = together(&[first.clone(), second]);
    refused(
        &touching,
        &[
            "part of 12 elements of region `part 1`",
            "nothing holds it",
            "join it to its neighbours face to face",
        ],
    );
    // Held each, they are accepted with a note: nodes of 3 x 3 lie on each other.
    let notes = check(&touching, &fixed(&touching, |p| p.x == 0.0 || p.x == 3.0)).unwrap();
    assert!(
        notes.len() == 1 && notes[0].starts_with("9 nodes lie exactly where another one does"),
        "{notes:?}"
    );
    let three =
        together(&[first.clone(), moved(first.clone(), DVec3::X * 5.0), moved(first, DVec3::X * 9.0)]);
    refused(&three, &["of region `part 1`", ", and 1 more: nothing holds it"]);
}

/// Planes of symmetry hold a body along some axes each; every part of it has to be held so.
#[test]
fn parts_that_can_slide_are_named() {
    let cube = bar(1, 0.0);
    let two = together(&[cube.clone(), moved(cube.clone(), DVec3::X * 3.0)]);
    // The first stands in a corner of three planes; the second on the floor alone, or in none.
    let first = |p: DVec3| p.x < 2.0;
    let corner = |p: DVec3| [p.x == 0.0, p.y == 0.0, p.z == 0.0];
    let message = |axes: &dyn Fn(DVec3) -> [bool; 3]| {
        let axes: Vec<_> = two.positions.iter().map(|&p| axes(p)).collect();
        check(&two, &axes).map_err(|e| e.to_string())
    };
    let slides = message(&corner).unwrap_err();
    assert!(slides.contains("part of 6 elements of region `part 1`"), "{slides}");
    assert!(
        slides.contains("it can slide or turn: what holds it does so along some of the axes only"),
        "{slides}"
    );
    let loose = message(&|p| if first(p) { corner(p) } else { [false; 3] }).unwrap_err();
    assert!(loose.contains("nothing holds it"), "{loose}");
    // Three nodes in a line.
    let line = message(&|p| [first(p) && p.y == 0.0 && p.z == 0.0; 3]).unwrap_err();
    assert!(line.contains("`part 0`") && line.contains("one line only"), "{line}");
    let line = message(&|p| if first(p) { corner(p) } else { [p.y == 0.0 && p.z == 0.0; 3] }).unwrap_err();
    assert!(line.contains("`part 1`") && line.contains("one line only"), "{line}");
    // A line on all sides, and others along one axis, hold it.
    let held = |p: DVec3| match (first(p), p.y == 0.0 && p.z == 0.0) {
        (true, _) => corner(p),
        (_, true) => [true; 3],
        (_, false) => [false, false, p.z == 0.0],
    };
    assert_eq!(message(&held), Ok(vec![]));
    assert_eq!(
        message(&|p| if first(p) { corner(p) } else { [p.x == 3.0, p.y == 0.0, p.z == 0.0] }),
        Ok(vec![])
    );
}

#[test]
fn parts_hold_each_other_by_three_nodes_but_not_by_two() {
    let cube = bar(1, 0.0);
    let with = |corners: [u32; 4], top: DVec3| {
        let mut all: Vec<[u32; 4]> = cube.elements.iter().map(|e| [e[0], e[1], e[2], e[3]]).collect();
        all.push(corners);
        let mut positions = cube.positions[..8].to_vec();
        positions.extend([top, top + DVec3::X]);
        TetMesh::from_corners(positions, &all)
    };
    // On three corners of the cube that are no face of its tetrahedra.
    let mesh = with([1, 3, 4, 8], DVec3::splat(-1.0));
    check(&mesh, &fixed(&mesh, |p| p.x == 1.0)).unwrap();
    let hinged = with([4, 5, 8, 9], DVec3::new(2.0, 0.5, -1.0));
    refused(&hinged, &["part of 1 elements", "one line only, about which it can turn", "face to face"]);
}

#[test]
fn large_meshes_are_checked_in_seconds() {
    let n = 40u32;
    let at = |x: u32, y: u32, z: u32| (x * (n + 1) + y) * (n + 1) + z;
    let (mut positions, mut tetrahedra) = (Vec::new(), Vec::new());
    for x in 0..=n {
        for y in 0..=n {
            for z in 0..=n {
                positions.push(DVec3::new(f64::from(x), f64::from(y), f64::from(z)));
                if x < n && y < n && z < n {
                    let c = |i: u32| at(x + (i & 1), y + (i >> 1 & 1), z + (i >> 2));
                    for [a, b] in [[1, 3], [3, 2], [2, 6], [6, 4], [4, 5], [5, 1]] {
                        tetrahedra.push([c(0), c(a), c(b), c(7)]);
                    }
                }
            }
        }
    }
    let mesh = TetMesh::from_corners(positions, &tetrahedra);
    let start = std::time::Instant::now();
    assert_eq!(checked(&mesh), Ok(vec![]));
    println!("{} elements in {:?}", mesh.elements.len(), start.elapsed());
    assert!(start.elapsed().as_secs() < 20);
}
