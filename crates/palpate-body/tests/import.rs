//! Mesh files: each format's variants, what a defect's message says, what is repaired, and that noise only ever ends
//! in a message.
//!
//! The files in `meshes/` were written by VTK 9.7: a box of 10 x 20 x 30 with its middle at (1, 2, 3) and a sphere of
//! radius 30 (24 x 14), in every encoding its writers have.

use glam::DVec3;
use palpate_body::import::{LengthUnit, read, read_bytes};
use palpate_body::repair::{Options, Report, repair};
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{Result, Surface, TriangleMesh};
use std::path::{Path, PathBuf};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/meshes").join(name)
}

fn fixtures() -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(fixture("")).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    files
}

/// Reads bytes as a file of this name, in mm.
fn read_as(name: &str, bytes: impl AsRef<[u8]>) -> Result<TriangleMesh> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read(&path, Some(LengthUnit::Millimetre))
}

fn refusal(result: Result<impl std::fmt::Debug>) -> String {
    let message = result.unwrap_err().to_string();
    assert!(!message.contains('\n'), "{message}");
    message
}

fn refused(name: &str, bytes: impl AsRef<[u8]>, words: &[&str]) {
    let message = refusal(read_as(name, bytes));
    for word in words.iter().chain(&[name]) {
        assert!(message.contains(word), "`{word}` is not in: {message}");
    }
}

fn volume(mesh: &TriangleMesh) -> f64 {
    let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize]));
    corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

fn is_the_box(mesh: TriangleMesh) {
    let (mesh, report) = repair(mesh, Options::default()).unwrap();
    assert_eq!(report, Report { components: 1, ..Default::default() });
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (8, 12));
    let low = mesh.positions.iter().fold(DVec3::INFINITY, |a, &b| a.min(b));
    let high = mesh.positions.iter().fold(DVec3::NEG_INFINITY, |a, &b| a.max(b));
    assert_eq!((low, high), (DVec3::new(-0.004, -0.008, -0.012), DVec3::new(0.006, 0.012, 0.018)));
    assert!((volume(&mesh) - 6e-6).abs() < 1e-18);
    Surface::build(&mesh, f64::INFINITY).unwrap();
}

const CORNERS: [[i32; 3]; 8] = [
    [-4, -8, -12],
    [6, -8, -12],
    [-4, 12, -12],
    [6, 12, -12],
    [-4, -8, 18],
    [6, -8, 18],
    [-4, 12, 18],
    [6, 12, 18],
];
const QUADS: [[usize; 4]; 6] =
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

fn obj() -> String {
    let mut text = String::from("# a box\r\nmtllib box.mtl\r\no box\r\n\r\n");
    for [x, y, z] in CORNERS {
        text += &format!("v {x} {y}.0 {z}e0 1.0 # corner\r\n");
    }
    text += "vt 0 0\r\nvn 0 0 1\r\ns off\r\n";
    for (q, quad) in QUADS.iter().enumerate() {
        let [a, b, c, d] = quad.map(|v| v + 1);
        text += &match q {
            0 => format!("f {a}/1/1 {b}/1/1 {c}//1 {d}/1\r\n"),
            1 => format!("f {a} {b} \\\r\n  {c} {d}\r\n"),
            2 => format!("f -{} -{} -{} -{}\r\n", 9 - a, 9 - b, 9 - c, 9 - d),
            _ => format!("\tf  {a}//1 {b}//1 {c}//1 {d}//1 \r\n"),
        };
    }
    text
}

fn off() -> String {
    let mut text = String::from("COFF # colours\n# comment\n\n8 6 12\n");
    for [x, y, z] in CORNERS {
        text += &format!("{x} {y} {z} 255 0 0 255\n");
    }
    for [a, b, c, d] in QUADS {
        text += &format!("4 {a} {b} {c} {d} 0 255 0\n");
    }
    text
}

fn ply(format: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment a box\nelement vertex 8\nproperty double x\nproperty float y\n\
         property uchar red\nproperty short z\nelement extra 1\nproperty list uchar float values\nelement face 6\n\
         property list uchar uint vertex_indices\nproperty char flag\nend_header\n"
    )
    .into_bytes();
    if format == "ascii" {
        for [x, y, z] in CORNERS {
            bytes.extend(format!("{x} {y} 255 {z}\n").bytes());
        }
        bytes.extend(b"2 0.5 1.5\n");
        for [a, b, c, d] in QUADS {
            bytes.extend(format!("4 {a} {b} {c} {d} -1\n").bytes());
        }
        return bytes;
    }
    let big = format == "binary_big_endian";
    let mut push = |mut value: Vec<u8>| {
        if big {
            value.reverse();
        }
        bytes.extend(value);
    };
    for [x, y, z] in CORNERS {
        push(f64::from(x).to_le_bytes().into());
        push((y as f32).to_le_bytes().into());
        push(vec![255]);
        push((z as i16).to_le_bytes().into());
    }
    push(vec![2]);
    push(0.5f32.to_le_bytes().into());
    push(1.5f32.to_le_bytes().into());
    for quad in QUADS {
        push(vec![4]);
        quad.iter().for_each(|&v| push((v as u32).to_le_bytes().into()));
        push(vec![255]);
    }
    bytes
}

fn box_mesh() -> TriangleMesh {
    read_as("box.obj", obj()).unwrap()
}

fn stl_triangles(mesh: &TriangleMesh) -> Vec<[[f32; 3]; 3]> {
    let corner = |v: u32| (mesh.positions[v as usize] * 1e3).to_array().map(|x| x.round() as f32);
    mesh.triangles.iter().map(|t| t.map(corner)).collect()
}

fn stl_binary(header: &[u8], mesh: &TriangleMesh) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in stl_triangles(mesh) {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flatten().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn stl_ascii(mesh: &TriangleMesh) -> String {
    let mut text = String::from("solid a box\r\n");
    for triangle in stl_triangles(mesh) {
        text += " facet normal 0 0 0\r\n  outer loop\r\n";
        for [x, y, z] in triangle {
            text += &format!("   vertex {x:e} {y} {z}\r\n");
        }
        text += "  endloop\r\n endfacet\r\n";
    }
    text + "endsolid a box\r\n"
}

#[test]
fn text_formats_are_read_with_quads_comments_and_any_line_end() {
    is_the_box(box_mesh());
    is_the_box(read_as("box.OBJ", obj().replace("\r\n", "\n")).unwrap());
    is_the_box(read_as("box.obj", obj().replace("\r\n", "\r")).unwrap());
    is_the_box(read_as("box.off", off()).unwrap());
    is_the_box(
        read_as("box.Off", off().replace('\n', "\r\n").replace("COFF # colours\r\n", "COFF ")).unwrap(),
    );
    is_the_box(read_as("box.stl", stl_ascii(&box_mesh())).unwrap());
    is_the_box(read_as("box.ply", ply("ascii")).unwrap());
    let crlf = String::from_utf8(ply("ascii")).unwrap().replace('\n', "\r\n");
    is_the_box(read_as("box.ply", crlf).unwrap());
}

#[test]
fn binary_formats_are_read() {
    is_the_box(read_as("box.ply", ply("binary_little_endian")).unwrap());
    is_the_box(read_as("box.ply", ply("binary_big_endian")).unwrap());
    is_the_box(read_as("box.stl", stl_binary(b"made by hand", &box_mesh())).unwrap());
    is_the_box(read_as("box.STL", stl_binary(b"solid as many exporters write", &box_mesh())).unwrap());
    let mut padded = stl_binary(b"", &box_mesh());
    padded.extend([0; 7]);
    is_the_box(read_as("box.stl", padded).unwrap());
}

#[test]
fn files_of_other_writers_are_read() {
    let mesh = box_mesh();
    let triangles = stl_triangles(&mesh).into_iter().map(|t| stl_io::Triangle {
        normal: stl_io::Normal::new([0.0; 3]),
        vertices: t.map(stl_io::Vertex::new),
    });
    let mut bytes = Vec::new();
    stl_io::write_stl(&mut bytes, triangles.collect::<Vec<_>>().iter()).unwrap();
    is_the_box(read_as("box.stl", bytes).unwrap());

    let mut boxes = 0;
    for path in fixtures() {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let mesh = read(&path, Some(LengthUnit::Millimetre));
        if name.starts_with("cube") {
            is_the_box(mesh.unwrap_or_else(|e| panic!("{e}")));
            boxes += 1;
        } else if name.starts_with("sphere") {
            let (mesh, report) = repair(mesh.unwrap(), Options::default()).unwrap();
            assert_eq!(
                (mesh.positions.len(), mesh.triangles.len(), report.flipped_triangles),
                (290, 576, 0),
                "{name}"
            );
            assert!(mesh.positions.iter().all(|p| (p.length() - 0.03).abs() < 1e-8));
        } else {
            let message = refusal(mesh);
            assert!(
                message.contains("cell 0: it is a solid") && message.contains("Extract Surface"),
                "{message}"
            );
        }
    }
    assert_eq!(boxes, 11);
}

#[test]
fn units_are_required_and_exact() {
    let path = fixture("cube-text.vtp");
    let message = refusal(read(&path, None));
    for words in ["cube-text.vtp", "no unit given", "--unit m|cm|mm", "[body] unit = \"mm\""] {
        assert!(message.contains(words), "{message}");
    }
    for (text, unit, metres) in [
        ("m", LengthUnit::Metre, 1.0),
        ("cm", LengthUnit::Centimetre, 0.01),
        ("mm", LengthUnit::Millimetre, 0.001),
    ] {
        assert_eq!(text.parse::<LengthUnit>().unwrap(), unit);
        assert_eq!(serde_json::to_string(&unit).unwrap(), format!("\"{text}\""));
        assert_eq!(unit.metres(), metres);
        let high = read(&path, Some(unit)).unwrap().positions.iter().fold(DVec3::ZERO, |a, &b| a.max(b));
        assert_eq!(high.z, 18.0 / (1.0 / metres));
    }
    assert!(refusal("inch".parse::<LengthUnit>()).contains("m, cm or mm"));
    // Text keeps 64 bits.
    let text = "v 0.1234567890123456 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n";
    assert_eq!(read_as("t.obj", text).unwrap().positions[0].x, 0.1234567890123456 / 1000.0);
}

#[test]
fn the_liver_is_read_and_closed() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/sofa/liver-smooth.obj");
    if !path.exists() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
    let (mesh, report) =
        repair(read(&path, Some(LengthUnit::Centimetre)).unwrap(), Options::default()).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len(), report.border_edges), (2194, 4384, 0));
    assert!(volume(&mesh) > 0.0, "{}", volume(&mesh));
    eprintln!("{} ml; {report:?}", volume(&mesh) * 1e6);
    // Its thin rim folds back on itself: smooth normals need a crease there.
    Surface::build(&mesh, 90f64.to_radians()).unwrap();
}

#[test]
fn wrong_files_are_refused_with_their_place() {
    for name in ["e.obj", "e.stl", "e.ply", "e.off", "e.vtk", "e.vtu", "e.vtp"] {
        refused(name, "", &["it is empty"]);
        refused(name, "hello\nworld\n", &[]);
    }
    refused("mesh.step", "x", &[".step", ".obj"]);
    assert!(refusal(read(&fixture("absent.obj"), Some(LengthUnit::Metre))).contains("absent.obj"));
    assert!(refusal(read(&fixture("cube.vtu").join("x.obj"), None)).contains("no unit"));

    let start = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    refused("a.obj", start, &["no triangle"]);
    refused("a.obj", format!("{start}l 1 2 3\np 1\n"), &["only points or lines"]);
    refused("a.obj", format!("{start}f 1 2\n"), &["line 4", "a face of 2 vertices"]);
    refused("a.obj", format!("{start}f 1 2 9\n"), &["line 4", "`9`", "there are 3"]);
    refused("a.obj", format!("{start}f 0 1 2\n"), &["line 4", "`0`"]);
    refused("a.obj", format!("{start}f 1 2 -4\n"), &["line 4", "`-4`"]);
    refused("a.obj", format!("{start}f 1 2 -9223372036854775808\n"), &["line 4"]);
    refused("a.obj", "v 0 nan 0\n", &["line 1", "NaN", "finite"]);
    refused("a.obj", "v 0 1e999 0\n", &["line 1", "inf"]);
    refused("a.obj", "v 0 1\n", &["line 1", "three coordinates"]);
    refused("a.obj", "v 0 1 z,z\n", &["line 1", "`z,z` is not a number"]);
    refused("a.obj", format!("v 0 0 1e9\n{start}f 1 2 3\n"), &["vertex 0", "mm", "unit"]);
    // Faces may come before their vertices.
    assert!(read_as("a.obj", format!("f 1 2 3\n{start}")).is_ok());

    refused("a.off", "OFF\n99999999999 1 0\n", &["line 2", "more than the file can hold"]);
    refused("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", &["line 6", "vertex 3"]);
    refused("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", &["line 6", "4 vertices"]);
    refused("a.off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", &["ends before its last face"]);
    refused("a.off", "4OFF\n3 1 0\n", &["line 1", "`4OFF`"]);
    refused("a.off", "OFF BINARY\n3 1 0\n", &["line 1", "text OFF"]);

    let head = "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n";
    refused("a.stl", format!("{head}endloop\n"), &["line 6", "a face of 2 vertices"]);
    refused("a.stl", head, &["cut short"]);
    refused("a.stl", format!("{head}vertex 0 x 0\n"), &["line 6", "`x`"]);
    refused("a.stl", format!("{head}vortex 0 0 0\n"), &["line 6", "`vortex`"]);
    let mut long = stl_binary(b"", &box_mesh());
    long[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    refused("a.stl", &long, &["4294967295 triangles"]);
    let mut inf = stl_binary(b"", &box_mesh());
    inf[84 + 50 + 12..84 + 50 + 16].copy_from_slice(&f32::INFINITY.to_le_bytes());
    refused("a.stl", &inf, &["triangle 1", "inf"]);

    let text = String::from_utf8(ply("ascii")).unwrap();
    refused("a.ply", text.replace("vertex 8", "vertex 18446744073709551615"), &["header", "vertex"]);
    refused("a.ply", text.replace("face 6", "face 7"), &["ends before"]);
    refused("a.ply", text.replace("4 0 2 3 1", "4 0 2 8 1"), &["face 0", "line 24", "vertex 8"]);
    refused("a.ply", text.replace("4 0 2 3 1", "900 0 2 3 1"), &["900"]);
    refused("a.ply", text.replace("double x", "double u"), &["`x`"]);
    refused("a.ply", text.replace("vertex_indices", "corners"), &["vertex_indices"]);
    refused("a.ply", text.replace("property short z", "property quad z"), &["line 8", "property"]);
    refused("a.ply", text.replace("element face 6", "element tristrips 6"), &["triangle strips"]);
    refused("a.ply", "ply\nformat ascii 1.0\nelement nothing 99999999999999\nend_header\n", &["no triangle"]);

    let text = std::fs::read_to_string(fixture("cube-text-5.vtk")).unwrap();
    refused("a.vtk", text.replace("POINTS 8", "POINTS 4000000000"), &["line 5", "4000000000"]);
    refused("a.vtk", text.replace("0 1 2 3 4 5 6 7 0", "0 1 2 3 4 5 6 8 0"), &["polygon 1", "vertex 8"]);
    refused("a.vtk", text.replace("0 4 8 12", "0 9 8 12"), &["polygon 1", "ends at 8"]);
    refused("a.vtk", text.replace("POLYDATA", "STRUCTURED_POINTS"), &["line 4", "STRUCTURED_POINTS"]);
    refused("a.vtk", text.replace("ASCII", "EBCDIC"), &["line 3", "EBCDIC"]);

    let text = std::fs::read_to_string(fixture("cube-text.vtp")).unwrap();
    refused("a.vtp", text.replace("\"PolyData\"", "\"ImageData\""), &["ImageData"]);
    refused("a.vtp", text.replace("0 1 2 3 4 5", "0 1 2 3 4 -5"), &["polygon 1", "vertex -5"]);
    let zlib = std::fs::read_to_string(fixture("cube-base64-zlib.vtp")).unwrap();
    refused(
        "a.vtp",
        zlib.replace("vtkZLibDataCompressor", "vtkLZ4DataCompressor"),
        &["line 2", "vtkLZ4DataCompressor"],
    );
    refused("a.vtp", zlib.replace("==eF5", "==eF6"), &["line 32", "damaged"]);
    refused("a.vtp", zlib.replace("eF5VzL", "eF5VzM"), &["line 69", "damaged"]);
}

/// The box with some change, repaired.
fn repaired(options: Options, change: impl FnOnce(&mut TriangleMesh)) -> Result<(TriangleMesh, Report)> {
    let mut mesh = box_mesh();
    change(&mut mesh);
    let given = mesh.clone();
    let (mesh, report) = repair(mesh, options)?;
    Surface::build(&mesh, f64::INFINITY).unwrap();
    assert!(given == mesh || !report.notes.is_empty(), "no change goes unsaid: {report:?}");
    Ok((mesh, report))
}

fn add(mesh: &mut TriangleMesh, other: &TriangleMesh, place: impl Fn(DVec3) -> DVec3) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(other.positions.iter().map(|&p| place(p)));
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
}

#[test]
fn soups_are_welded_and_leftovers_dropped() {
    let (mesh, report) = repaired(Options::default(), |mesh| {
        let corners: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
        mesh.positions = corners.iter().map(|&v| mesh.positions[v as usize]).collect();
        mesh.triangles = (0..12).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        mesh.positions.push(DVec3::ONE);
        mesh.triangles.insert(3, [0, 1, 0]);
        mesh.triangles.insert(5, [2, 1, 0]);
    })
    .unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (8, 12));
    assert_eq!(mesh.positions[0], box_mesh().positions[0]);
    assert_eq!(mesh.triangles[0], [0, 1, 2]);
    let expected = (28, 1, 1, 1, 0);
    let Report {
        welded_vertices,
        unused_vertices,
        duplicate_triangles,
        collapsed_triangles,
        flipped_triangles,
        ..
    } = report;
    assert_eq!(
        (welded_vertices, unused_vertices, duplicate_triangles, collapsed_triangles, flipped_triangles),
        expected
    );
    assert_eq!(report.notes.len(), 4);
    assert!(report.notes[0].starts_with("28 vertices"), "{:?}", report.notes);
}

#[test]
fn signed_zeros_are_one_position() {
    let mut mesh = TriangleMesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(-0.0, 0.0, -0.0), DVec3::NEG_X, DVec3::Y],
        triangles: vec![[0, 1, 2], [3, 5, 4]],
    };
    mesh.positions.iter_mut().for_each(|p| *p *= 0.01);
    let (mesh, report) = repair(mesh, Options { allow_open: true }).unwrap();
    assert_eq!(
        (mesh.positions.len(), report.welded_vertices, report.border_edges, report.components),
        (4, 2, 4, 1)
    );
}

#[test]
fn orientation_is_made_one_and_outward() {
    for turned in [vec![0], vec![3, 4, 7], (0..12).collect(), (1..12).collect()] {
        let (mesh, report) = repaired(Options::default(), |mesh| {
            turned.iter().for_each(|&t: &usize| mesh.triangles[t].swap(1, 2));
        })
        .unwrap();
        assert!((volume(&mesh) - 6e-6).abs() < 1e-15);
        assert_eq!(report.flipped_triangles, turned.len());
        assert!(report.notes[0].contains("turned over"), "{:?}", report.notes);
    }
}

#[test]
fn an_open_surface_needs_consent_and_keeps_its_majority() {
    let open = |mesh: &mut TriangleMesh| {
        mesh.triangles.truncate(10);
        mesh.triangles[4].swap(1, 2);
    };
    let message = refusal(repaired(Options::default(), open));
    for words in ["4 edges", "an edge of triangle", ") mm", "--open", "[body] open = true"] {
        assert!(message.contains(words), "{message}");
    }
    let (mesh, report) = repaired(Options { allow_open: true }, open).unwrap();
    assert_eq!((report.border_edges, report.flipped_triangles), (4, 1));
    assert_eq!(mesh.triangles, box_mesh().triangles[..10]);
    // Inside out, an open surface stays so: nothing says which side is out.
    let inside_out = |mesh: &mut TriangleMesh| {
        mesh.triangles.truncate(10);
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    };
    assert_eq!(repaired(Options { allow_open: true }, inside_out).unwrap().1.flipped_triangles, 0);
}

#[test]
fn cavities_face_inwards_and_islands_outwards() {
    let inner = box_mesh();
    let middle = DVec3::new(0.001, 0.002, 0.003);
    let scaled = |k: f64| move |p: DVec3| (p - middle) * k + middle;
    // A shell, its cavity, an island within, and a box beside; all facing out, or all in.
    for inside_out in [false, true] {
        let (mesh, report) = repaired(Options::default(), |mesh| {
            add(mesh, &inner, scaled(0.5));
            add(mesh, &inner, scaled(0.25));
            add(mesh, &inner, |p| p + DVec3::X * 0.1);
            if inside_out {
                mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            }
        })
        .unwrap();
        assert_eq!((report.components, report.flipped_triangles), (4, if inside_out { 36 } else { 12 }));
        let expected = 6e-6 * (1.0 - 0.125 + 0.125f64.powi(2) + 1.0);
        assert!((volume(&mesh) - expected).abs() < 1e-15, "{} {expected}", volume(&mesh));
        assert!(report.notes.iter().any(|n| n.contains("4 separate components")), "{:?}", report.notes);
    }
}

#[test]
fn beyond_64_components_orientation_is_trusted() {
    let (_, report) = repaired(Options::default(), |mesh| {
        let one = mesh.clone();
        (1..70).for_each(|i| add(mesh, &one, |p| p + DVec3::X * 0.1 * f64::from(i)));
        mesh.triangles[12..24].iter_mut().for_each(|t| t.swap(1, 2));
    })
    .unwrap();
    assert_eq!((report.components, report.flipped_triangles), (70, 0));
    assert!(report.notes.iter().any(|n| n.starts_with("70 closed components")), "{:?}", report.notes);
}

#[test]
fn bow_ties_are_fine() {
    let other = box_mesh();
    let (mesh, report) = repaired(Options::default(), |mesh| {
        add(mesh, &other, |p| p + (other.positions[7] - other.positions[0]));
    })
    .unwrap();
    assert_eq!((mesh.positions.len(), report.welded_vertices, report.components), (15, 1, 2));
    assert!((volume(&mesh) - 12e-6).abs() < 1e-15);
}

#[test]
fn defects_are_refused_with_triangle_and_place() {
    let refused = |words: &[&str], change: &dyn Fn(&mut TriangleMesh)| {
        let message = refusal(repaired(Options { allow_open: true }, change));
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    };
    refused(&["vertex 3", "mm", "finite"], &|m| m.positions[3].x = f64::NAN);
    refused(&["vertex 3", "2000000.000", "unit"], &|m| m.positions[3].x = 2e3);
    refused(&["triangle 5", "vertex 99", "there are 8"], &|m| m.triangles[5][1] = 99);
    refused(&["no triangle"], &|m| m.triangles.clear());
    refused(&["three different vertices"], &|m| m.triangles = vec![[0, 1, 1]]);
    refused(&["triangle 12 at (-4.000, -8.000, -12.000) mm", "no area"], &|m| {
        m.positions.push((m.positions[0] + m.positions[1]) / 2.0);
        m.triangles.push([0, 8, 1]);
    });
    refused(
        &["an edge of triangle 0 at (1.000, 2.000, -12.000) mm", "3 triangles share it", "manifold"],
        &|m| {
            m.positions.push(DVec3::new(0.0, 0.0, 1.0));
            m.triangles.push([0, 3, 8]);
        },
    );
    // A Moebius strip of five triangles.
    let moebius = |m: &mut TriangleMesh| {
        m.positions = (0..5)
            .map(|i| {
                let angle = f64::from(i) * 2.0 * std::f64::consts::PI / 5.0;
                DVec3::new(angle.cos(), angle.sin(), 0.3 * (2.0 * angle).sin()) * 0.02
            })
            .collect();
        m.triangles = (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect();
    };
    refused(&["an edge of triangle", "mm", "one side only"], &moebius);
}

#[test]
fn the_users_order_is_kept() {
    let mesh = Shape::Torus { radii_mm: [30.0, 8.0] }.mesh(Resolution::default()).unwrap();
    let (same, report) = repair(mesh.clone(), Options::default()).unwrap();
    assert_eq!(same, mesh);
    assert_eq!(report, Report { components: 1, ..Default::default() });
}

#[test]
fn a_million_triangles_are_repaired_in_seconds() {
    let shape = Shape::Sphere { radius_mm: 30.0 };
    let mut mesh = shape.mesh(Resolution { edge_length_mm: Some(0.1615), ..Default::default() }).unwrap();
    assert!(mesh.triangles.len() > 1_000_000 - 20_000);
    let inner = mesh.clone();
    add(&mut mesh, &inner, |p| p * 0.5);
    let start = std::time::Instant::now();
    let (_, report) = repair(mesh, Options::default()).unwrap();
    eprintln!("repaired in {:?}", start.elapsed());
    assert_eq!(report.flipped_triangles, inner.triangles.len());
    assert!(start.elapsed().as_secs() < 20);
}

/// xorshift64.
struct Noise(u64);

impl Noise {
    fn next(&mut self, below: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % below
    }

    /// Changes, removes, repeats or inserts a few bytes, now and then a word that means something.
    fn mutate(&mut self, bytes: &mut Vec<u8>) {
        const WORDS: [&[u8]; 12] = [
            b"-1",
            b"0",
            b"99999999999",
            b"4294967295",
            b"nan",
            b"1e308",
            b"\n",
            b"\r",
            b" ",
            b"\0",
            b"\xff\xff\xff\xff",
            b"end_header\n",
        ];
        for _ in 0..1 + self.next(4) {
            let at = self.next(bytes.len());
            let end = (at + 1 + self.next(8)).min(bytes.len());
            match self.next(6) {
                0 => bytes[at] = self.next(256) as u8,
                1 => bytes[at] ^= 1 << self.next(8),
                2 => drop(bytes.drain(at..end)),
                3 => bytes.extend_from_within(at..end),
                4 => drop(bytes.splice(at..end, WORDS[self.next(WORDS.len())].iter().copied())),
                _ => bytes.truncate(if self.next(4) == 0 { at.max(1) } else { bytes.len() }),
            }
            if bytes.is_empty() {
                bytes.push(0);
            }
        }
    }
}

#[test]
fn noise_ends_in_a_message() {
    let mut seeds = vec![
        ("obj", obj().into_bytes()),
        ("off", off().into_bytes()),
        ("ply", ply("ascii")),
        ("ply", ply("binary_little_endian")),
        ("ply", ply("binary_big_endian")),
        ("stl", stl_ascii(&box_mesh()).into_bytes()),
        ("stl", stl_binary(b"", &box_mesh())),
    ];
    for path in fixtures() {
        let extension = path.extension().unwrap().to_string_lossy().into_owned();
        let known = ["vtk", "vtp", "vtu"].into_iter().find(|e| *e == extension).unwrap();
        seeds.push((known, std::fs::read(path).unwrap()));
    }
    let (mut read_well, mut repaired_well, mut total) = (0, 0, 0);
    for (s, (extension, seed)) in seeds.iter().enumerate() {
        let name = format!("mutant.{extension}");
        let mut noise = Noise(0x9e37_79b9_7f4a_7c15 ^ (s as u64 + 1));
        for _ in 0..2000 {
            let mut bytes = seed.clone();
            noise.mutate(&mut bytes);
            total += 1;
            match read_bytes(Path::new(&name), &bytes, Some(LengthUnit::Millimetre)) {
                Err(error) => assert!(!error.to_string().contains('\n'), "{error:?}"),
                Ok(mesh) => {
                    read_well += 1;
                    if let Ok((mesh, _)) = repair(mesh, Options { allow_open: true }) {
                        repaired_well += 1;
                        // Only a sharp fold may still be refused.
                        if let Err(error) = Surface::build(&mesh, f64::INFINITY) {
                            assert!(error.to_string().contains("folded"), "{error}");
                        }
                    }
                }
            }
        }
    }
    eprintln!("{total} mutants: {read_well} read, {repaired_well} repaired");
    assert!(read_well > total / 10, "{read_well} of {total}");
}
