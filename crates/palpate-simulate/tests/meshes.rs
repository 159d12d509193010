//! Volume meshes: every format's variants, written by independent programs (see `meshes/README.md`), give the same
//! mesh; noise only ever ends in a message.

use glam::DVec3;
use palpate_body::import::LengthUnit;
use palpate_simulate::TetMesh;
use palpate_simulate::mesh::check::check;
use palpate_simulate::mesh::import::{Imported, read, read_any, read_bytes, read_tetgen};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/meshes").join(name)
}

/// The names of all fixtures that pass.
fn fixtures(wanted: impl Fn(&str) -> bool) -> Vec<String> {
    let files = std::fs::read_dir(fixture("")).unwrap();
    let mut names: Vec<_> = files.map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|n| wanted(n));
    names.sort();
    names
}

fn is_mesh(name: &str) -> bool {
    [".msh", ".vtk", ".vtu", ".ele"].iter().any(|e| name.ends_with(e))
}

fn load(name: &str) -> TetMesh {
    read(&fixture(name), LengthUnit::Metre).unwrap()
}

fn corners(mesh: &TetMesh, e: usize) -> [DVec3; 4] {
    std::array::from_fn(|i| mesh.positions[mesh.elements[e][i] as usize])
}

fn volume(mesh: &TetMesh) -> f64 {
    let each = (0..mesh.elements.len()).map(|e| corners(mesh, e));
    each.map(|[a, b, c, d]| (b - a).cross(c - a).dot(d - a) / 6.0).inspect(|v| assert!(*v > 0.0)).sum()
}

/// In halves of the unit, which is as fine as the fixtures' nodes lie.
fn grid(p: DVec3) -> [i32; 3] {
    (2.0 * p).to_array().map(|x| {
        assert_eq!(x, x.round());
        x as i32
    })
}

type Cells = BTreeSet<(Vec<[i32; 3]>, String)>;

/// The mesh without its numbering: elements by their corners, with their regions.
fn cells(mesh: &TetMesh) -> Cells {
    let cell = |e: usize| {
        let mut places = corners(mesh, e).map(grid).to_vec();
        places.sort();
        (places, mesh.region_names[mesh.regions[e] as usize].clone())
    };
    (0..mesh.elements.len()).map(cell).collect()
}

fn places(mesh: &TetMesh, nodes: &[u32]) -> BTreeSet<[i32; 3]> {
    nodes.iter().map(|&n| grid(mesh.positions[n as usize])).collect()
}

fn groups(mesh: &TetMesh) -> BTreeMap<String, BTreeSet<[i32; 3]>> {
    mesh.groups.iter().map(|(name, nodes)| (name.clone(), places(mesh, nodes))).collect()
}

/// Nodes on edges lie in the middle, each edge has one, and every node is used.
fn is_sound(mesh: &TetMesh) {
    let mut used = vec![false; mesh.positions.len()];
    for element in &mesh.elements {
        for (i, [a, b]) in palpate_simulate::mesh::EDGES.iter().enumerate() {
            let [a, b, m] = [element[*a], element[*b], element[4 + i]].map(|n| mesh.positions[n as usize]);
            assert_eq!((a + b) / 2.0, m);
        }
        element.iter().for_each(|&n| used[n as usize] = true);
    }
    assert!(used.iter().all(|u| *u));
    assert_eq!(mesh.positions.len(), 45);
    assert_eq!(mesh.regions.len(), 12);
}

#[test]
fn every_writer_gives_the_same_mesh() {
    // Two unit cubes side by side, 6 tetrahedra each, of regions 7 and 9, or soft and hard.
    let reference = cells(&load("two.ele"));
    assert_eq!(reference.len(), 12);
    let left: BTreeSet<[i32; 3]> = (0..=2).flat_map(|y| (0..=2).map(move |z| [0, y, z])).collect();
    let names = fixtures(|n| is_mesh(n) && (n.starts_with("two") || n.starts_with("tags")));
    assert!(names.len() > 35, "{}", names.len());
    for name in names {
        println!("{name}");
        let mesh = load(&name);
        is_sound(&mesh);
        assert!((volume(&mesh) - 2.0).abs() < 1e-12);
        let named = name.starts_with("two") && name.ends_with(".msh");
        let [soft, hard, side] = match &name {
            _ if named => ["soft", "hard", "left side"],
            n if n.starts_with("tags") || n.ends_with(".ele") => ["7", "9", "1"],
            // VTK has numbers only, and the surface's is that of a volume.
            _ => ["7", "9", "7"],
        };
        assert_eq!(mesh.region_names, [soft, hard]);
        let renamed = |(places, region): &(Vec<[i32; 3]>, String)| {
            (places.clone(), if region == "7" { soft } else { hard }.to_string())
        };
        assert_eq!(cells(&mesh), reference.iter().map(renamed).collect());
        let groups = groups(&mesh);
        assert_eq!(groups[side], left);
        // A cube of three by three by three nodes.
        assert_eq!(groups[hard].len(), 27);
        if side != soft {
            assert_eq!(groups[soft].len(), 27);
        }
        if name.ends_with(".ele") {
            let boundary: BTreeSet<[i32; 3]> = places(&mesh, &mesh.boundary().nodes);
            assert!(boundary.is_superset(&groups["2"]) && groups["2"].len() > 20);
        }
    }
}

#[test]
fn either_file_of_tetgens_will_do_and_units_are_exact() {
    let mesh = load("two.ele");
    assert_eq!(mesh, load("two.node"));
    let millimetres = read(&fixture("two.node"), LengthUnit::Millimetre).unwrap();
    assert_eq!(millimetres.positions[11], DVec3::new(0.002, 0.001, 0.001));
    assert_eq!(mesh.positions[11], DVec3::new(2.0, 1.0, 1.0));
}

#[test]
fn curved_elements_keep_their_nodes() {
    let mesh = load("ball.msh");
    assert_eq!(mesh.region_names, [""]);
    assert!(mesh.groups.is_empty());
    let boundary = mesh.boundary();
    for &n in &boundary.nodes {
        assert!((mesh.positions[n as usize].length() - 10.0).abs() < 1e-9);
    }
    // Sound where it is curved, and every node in its place.
    let fixed: Vec<[bool; 3]> = mesh.positions.iter().map(|p| [p.z < 0.0; 3]).collect();
    assert_eq!(check(&mesh, &fixed).unwrap(), Vec::<String>::new());
}

#[test]
fn elements_inside_out_are_turned_back_if_all_are() {
    let nodes = std::fs::read(fixture("two-quadratic.node")).unwrap();
    let good = std::fs::read_to_string(fixture("two-quadratic.ele")).unwrap();
    // The first two corners change places, and so do the edges at them: 03 with 13, 12 with 02.
    let turned = |from: usize| {
        let mut text = String::from("12 10 1\n");
        for (e, line) in good.lines().skip(1).take(12).enumerate() {
            let mut words: Vec<&str> = line.split_whitespace().collect();
            if e >= from {
                [(1, 2), (6, 9), (8, 10)].iter().for_each(|&(a, b)| words.swap(a, b));
            }
            text += &(words.join(" ") + "\n");
        }
        read_tetgen(&nodes, text.as_bytes(), LengthUnit::Metre)
    };
    assert_eq!(turned(12).unwrap(), load("two-quadratic.ele"));
    let mesh = turned(0).unwrap();
    is_sound(&mesh);
    assert!((volume(&mesh) - 2.0).abs() < 1e-12);
    assert_eq!(cells(&mesh), cells(&load("two.ele")));
    let message = turned(9).unwrap_err().to_string();
    assert!(
        message.starts_with("element 9 (from 0) at (") && message.contains("as are 3 of 12; mesh it again"),
        "{message}"
    );
}

#[test]
fn surfaces_are_told_from_volumes() {
    let Imported::Surface(surface) = read_any(&fixture("surface.msh"), LengthUnit::Centimetre).unwrap()
    else {
        panic!("a volume");
    };
    let (surface, _) = palpate_body::repair::repair(surface, Default::default()).unwrap();
    let corners = surface.triangles.iter().map(|t| t.map(|v| surface.positions[v as usize]));
    let volume: f64 = corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum();
    assert!((volume - 1e-6).abs() < 1e-15);
    let message = read(&fixture("surface.msh"), LengthUnit::Metre).unwrap_err().to_string();
    assert!(message.contains("surface.msh: mesh: there is no tetrahedron in it"), "{message}");
    assert!(matches!(read_any(&fixture("two-meshio.vtu"), LengthUnit::Metre), Ok(Imported::Volume(_))));
    // A surface's data are nobody's business, a volume's are.
    let odd = |kind: u8, corners: &str| {
        let count = corners.split(' ').count();
        let text = format!(
            "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\n\
             CELLS 1 {}\n{count} {corners}\nCELL_TYPES 1\n{kind}\nCELL_DATA 1\nODDITIES 1\n",
            count + 1
        );
        read_bytes(Path::new("a.vtk"), text.as_bytes(), LengthUnit::Metre)
    };
    assert!(matches!(odd(5, "0 1 2"), Ok(Imported::Surface(_))));
    let message = odd(10, "0 1 2 3").unwrap_err().to_string();
    assert!(message.contains("`ODDITIES` is no data that is read; save the mesh without it"), "{message}");
}

#[test]
fn a_file_without_groups_is_one_region() {
    let mesh = load("bare-meshio-4.1.msh");
    is_sound(&mesh);
    assert_eq!((mesh.region_names, mesh.groups), (vec![String::new()], BTreeMap::new()));
}

#[test]
fn what_cannot_be_read_is_refused_with_its_hint() {
    for (name, words) in [
        ("hexahedra.msh", ["a solid of 8 corners is no tetrahedron", "mesh with tetrahedra alone"]),
        ("partitioned.msh", ["line 16: the mesh is partitioned", "-format msh22"]),
    ] {
        let message = read(&fixture(name), LengthUnit::Metre).unwrap_err().to_string();
        assert!(message.contains(name) && words.iter().all(|w| message.contains(w)), "{message}");
    }
}

#[test]
fn the_liver_is_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/sofa/liver.msh");
    if !path.exists() {
        return eprintln!("skipped: {} is not there", path.display());
    }
    let mesh = read(&path, LengthUnit::Centimetre).unwrap();
    assert_eq!((mesh.elements.len(), mesh.region_names.as_slice()), (7509, &["liver".to_string()][..]));
    assert_eq!(mesh.groups["liver"].len(), mesh.positions.len());
    assert_eq!(mesh.groups["surface"], mesh.boundary().nodes);
    println!("{} nodes, {} m3", mesh.positions.len(), volume(&mesh));
    let old = path.with_file_name("liver-msh1.msh");
    let message = read(&old, LengthUnit::Centimetre).unwrap_err().to_string();
    assert!(message.contains("line 1: `$NOD`") && message.contains("gmsh OLD.msh -save"), "{message}");
}

/// Cubes in six tetrahedra each, as MSH 2.2 and 4.1.
fn large(n: usize) -> [String; 2] {
    use std::fmt::Write;
    let at = |x: usize, y: usize, z: usize| (x * (n + 1) + y) * (n + 1) + z + 1;
    let (mut tags, mut points, mut elements) = (String::new(), String::new(), [const { String::new() }; 2]);
    let mut nodes = String::new();
    let mut e = 0;
    for (x, y, z) in (0..=n).flat_map(|x| (0..=n).flat_map(move |y| (0..=n).map(move |z| (x, y, z)))) {
        let p = [x, y, z].map(|i| i as f64 / n as f64);
        writeln!(nodes, "{} {} {} {}", at(x, y, z), p[0], p[1], p[2]).unwrap();
        writeln!(tags, "{}", at(x, y, z)).unwrap();
        writeln!(points, "{} {} {}", p[0], p[1], p[2]).unwrap();
        if x < n && y < n && z < n {
            let c = |i: usize| at(x + (i & 1), y + (i >> 1 & 1), z + (i >> 2));
            for [a, b] in [[1, 3], [3, 2], [2, 6], [6, 4], [4, 5], [5, 1]] {
                e += 1;
                writeln!(elements[0], "{e} 4 2 1 1 {} {} {} {}", c(0), c(a), c(b), c(7)).unwrap();
                writeln!(elements[1], "{e} {} {} {} {}", c(0), c(a), c(b), c(7)).unwrap();
            }
        }
    }
    let count = (n + 1).pow(3);
    [
        format!(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{count}\n{nodes}$EndNodes\n$Elements\n{e}\n{}$EndElements\n",
            elements[0]
        ),
        format!(
            "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\n1 0 0 0 1 1 1 1 1 0\n$EndEntities\n\
             $Nodes\n1 {count} 1 {count}\n3 1 0 {count}\n{tags}{points}$EndNodes\n\
             $Elements\n1 {e} 1 {e}\n3 1 4 {e}\n{}$EndElements\n",
            elements[1]
        ),
    ]
}

#[test]
fn large_meshes_are_read_in_seconds() {
    let n = 40;
    let [two, four] = large(n).map(|text| {
        let start = std::time::Instant::now();
        let Imported::Volume(mesh) =
            read_bytes(Path::new("a.msh"), text.as_bytes(), LengthUnit::Metre).unwrap()
        else {
            panic!("a surface");
        };
        println!("{} elements, {} bytes in {:?}", mesh.elements.len(), text.len(), start.elapsed());
        assert!(start.elapsed().as_secs() < 20);
        assert_eq!(mesh.elements.len(), 6 * n.pow(3));
        mesh
    });
    assert!((volume(&two) - 1.0).abs() < 1e-9);
    assert_eq!(two, four);
}

/// Numbers that look random, the same on every run.
struct Noise(u64);

impl Noise {
    fn next(&mut self, below: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % below.max(1)
    }

    fn mutate(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..1 + self.next(3) {
            let at = self.next(bytes.len());
            match self.next(7) {
                0 => bytes[at] = self.next(256) as u8,
                1 => bytes[at] ^= 1 << self.next(8),
                2 => bytes.truncate(at + 1),
                3 => drop(bytes.drain(at..(at + self.next(30)).min(bytes.len() - 1))),
                4 => {
                    let from = self.next(bytes.len());
                    let piece = bytes[from..(from + self.next(40)).min(bytes.len())].to_vec();
                    bytes.splice(at..at, piece);
                }
                5 => {
                    let words: [&[u8]; 8] =
                        [b"-1", b"nan", b"1e300", b"99999999999999999999", b"$", b" ", b"\n", b"4294967295"];
                    bytes.splice(at..at, words[self.next(8)].iter().copied());
                }
                // Digits matter most: tags, kinds, counts.
                _ => {
                    let digit =
                        (0..bytes.len()).map(|i| (at + i) % bytes.len()).find(|&i| bytes[i].is_ascii_digit());
                    if let Some(digit) = digit {
                        bytes[digit] = b'0' + self.next(10) as u8;
                    }
                }
            }
        }
    }
}

#[test]
fn noise_ends_in_a_message() {
    let mut noise = Noise(0x9e37_79b9_7f4a_7c15);
    let (mut good, mut bad) = (0, 0);
    let mut judge = |result: Result<TetMesh, palpate_simulate::SimulateError>| match result {
        Ok(mesh) => {
            good += 1;
            assert!(mesh.positions.iter().all(|p| p.is_finite()));
            assert!(mesh.elements.iter().flatten().all(|&n| (n as usize) < mesh.positions.len()));
            assert!(mesh.regions.iter().all(|&r| (r as usize) < mesh.region_names.len()));
            assert!(mesh.groups.values().flatten().all(|&n| (n as usize) < mesh.positions.len()));
        }
        Err(e) => {
            bad += 1;
            let message = e.to_string();
            assert!(!message.contains('\n') && message.contains("; ") && message.len() < 400, "{message}");
        }
    };
    for name in fixtures(is_mesh) {
        let bytes = std::fs::read(fixture(&name)).unwrap();
        let nodes = std::fs::read(fixture(&name).with_extension("node"));
        for round in 0..400 {
            let mut bytes = bytes.clone();
            if let Ok(nodes) = &nodes {
                let mut nodes = nodes.clone();
                noise.mutate(if round % 2 == 0 { &mut bytes } else { &mut nodes });
                judge(read_tetgen(&nodes, &bytes, LengthUnit::Millimetre));
                continue;
            }
            noise.mutate(&mut bytes);
            if let Ok(Imported::Volume(mesh)) = {
                let result = read_bytes(Path::new(&name), &bytes, LengthUnit::Millimetre);
                if let Err(e) = result {
                    judge(Err(e));
                    continue;
                }
                result
            } {
                judge(Ok(mesh));
            }
        }
    }
    println!("{good} read, {bad} refused");
    assert!(good > 500 && bad > 3000, "{good} {bad}");
}
