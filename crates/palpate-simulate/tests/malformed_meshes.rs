//! Malformed mesh files: each is refused with one line that names the place, the problem and the hint.

use palpate_body::import::LengthUnit;
use palpate_simulate::mesh::import::{read, read_bytes, read_tetgen};
use std::path::{Path, PathBuf};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/meshes").join(name)
}

/// Replaces the n-th occurrence (from 0), which must be there.
fn swap(bytes: &[u8], n: usize, from: &[u8], to: &[u8]) -> Vec<u8> {
    let mut found = (0..bytes.len()).filter(|&i| bytes[i..].starts_with(from));
    let at = found.nth(n).unwrap_or_else(|| panic!("no {n}-th `{}`", from.escape_ascii()));
    [&bytes[..at], to, &bytes[at + from.len()..]].concat()
}

/// What is said of it must hold all words; gives what is amiss.
fn amiss(file: &str, result: Result<(), String>, words: &[&str]) -> Option<String> {
    let Err(message) = result else { return Some(format!("{file} was read, not refused with {words:?}")) };
    // Place, problem and hint, on one line.
    let shape =
        !message.contains('\n') && message.len() < 500 && message.contains(": ") && message.contains("; ");
    let absent: Vec<_> = words.iter().filter(|w| !message.contains(**w)).collect();
    (!shape || !absent.is_empty()).then(|| format!("{file}: {absent:?} is not in: {message}"))
}

fn says(file: &str, result: Result<(), String>, words: &[&str]) {
    if let Some(amiss) = amiss(file, result, words) {
        panic!("{amiss}");
    }
}

fn read_as(name: &str, bytes: &[u8]) -> Result<(), String> {
    read_bytes(Path::new(name), bytes, LengthUnit::Millimetre).map(drop).map_err(|e| e.to_string())
}

/// Changes to a good file (the n-th of this becomes that), and what is said of them.
type Changes<'a> = &'a [(usize, &'a [u8], &'a [u8], &'a [&'a str])];

fn each_is_refused(fixture_name: &str, changes: Changes) -> usize {
    let good = std::fs::read(fixture(fixture_name)).unwrap();
    assert_eq!(read_as(fixture_name, &good), Ok(()));
    let refused = changes.iter().filter_map(|(n, from, to, words)| {
        let file = format!("{fixture_name} with {} for {}", to.escape_ascii(), from.escape_ascii());
        amiss(&file, read_as(fixture_name, &swap(&good, *n, from, to)), words)
    });
    let all: Vec<String> = refused.collect();
    assert!(all.is_empty(), "{}", all.join("\n"));
    changes.len()
}

#[test]
fn gmsh_2_text() {
    let count = each_is_refused(
        "two-2.2-ascii.msh",
        &[
            (
                0,
                b"$MeshFormat",
                b"$Mesh",
                &["line 1: `$Mesh` where `$MeshFormat` is expected", "save the mesh as .msh"],
            ),
            (0, b"2.2 0 8", b"2.2 0", &["line 2: version, kind and size are expected", "export"]),
            (0, b"2.2 0 8", b"1.0 0 8", &["line 2: MSH version 1 is not read", "-format msh41"]),
            (0, b"2.2 0 8", b"3.0 0 8", &["line 2: MSH version 3 is not read", "-format msh41"]),
            (0, b"2.2 0 8", b"2.2 7 8", &["line 2: kind 7 and size 8", "export"]),
            (0, b"2.2 0 8", b"2.2 0 8\n9", &["line 3: `9` where `$EndMeshFormat` is expected", "export"]),
            (0, b"2.2 0 8", b"abc 0 8", &["line 2: `abc` is not a number", "correct it"]),
            (
                0,
                b"3 7 \"soft\"",
                b"3 7 soft",
                &["line 7: `3 7 soft` is no dimension, number, and name in quotes", "correct the line"],
            ),
            (0, b"3 7 \"soft\"", b"3 \"soft\"", &["line 7", "name in quotes", "correct the line"]),
            (
                0,
                b"3 7 \"soft\"",
                b"3 7 \"so\xff\"",
                &["line 7: the name `so\\xff` is no plain text in UTF-8", "rename the group"],
            ),
            (0, b"$PhysicalNames\n3", b"$PhysicalNames\n4", &["line 9", "name in quotes", "correct"]),
            (
                0,
                b"$Nodes\n12\n",
                b"$Nodes\n13\n",
                &["`$EndNodes` where a node's number and coordinates", "export"],
            ),
            (0, b"$Nodes\n12\n", b"$Nodes\n11\n", &["`12` where `$EndNodes` is expected", "export"]),
            (0, b"$Nodes\n12\n", b"$Nodes\n-1\n", &["line 11: -1 is no number of nodes", "export"]),
            (0, b"$Nodes\n12\n", b"$Nodes\n1.5\n", &["line 11: 1.5 is no number of nodes", "export"]),
            (
                0,
                b"$Nodes\n12\n",
                b"$Nodes\n99999999999\n",
                &["line 11: the file ends before the last of 99999999999 nodes", "cut short"],
            ),
            (
                0,
                b"$Nodes\n12\n",
                b"$Nodes\n12 12\n",
                &["line 11: 2 numbers where the number of nodes", "export"],
            ),
            (
                0,
                b"$Nodes\n12\n",
                b"$Nodes\n\n",
                &["line 12", "4 numbers where the number of nodes", "export"],
            ),
            (0, b"\n3 2 0 0", b"\n3 2 0", &["line 14: 3 numbers, but 4 are expected", "correct the line"]),
            (
                0,
                b"\n3 2 0 0",
                b"\n3 2 0 0 0",
                &["line 14: 5 numbers, but 4 are expected", "correct the line"],
            ),
            (0, b"\n3 2 0 0", b"\n3 2 o 0", &["line 14: `o` is not a number", "correct it"]),
            (0, b"\n3 2 0 0", b"\n3 nan 0 0", &["line 14: a coordinate is NaN", "correct the coordinate"]),
            (0, b"\n3 2 0 0", b"\n3 inf 0 0", &["line 14: a coordinate is inf", "correct the coordinate"]),
            (0, b"\n3 2 0 0", b"\n2 2 0 0", &["line 14: node 2 is there twice", "remove one of the two"]),
            (0, b"\n3 2 0 0", b"\n-3 2 0 0", &["line 14: -3 is no node number", "export"]),
            (0, b"\n3 2 0 0", b"\n3.5 2 0 0", &["line 14: 3.5 is no node number", "export"]),
            (
                0,
                b"\n3 2 0 0",
                b"\n3 2e9 0 0",
                &["node 2 (from 0): a coordinate is 2000000 m", "check the mesh's unit"],
            ),
            (0, b"\n3 2 0 0", b"\n30 2 0 0", &["there is no node 3", "correct the node"]),
            (
                0,
                b"$Elements\n14\n",
                b"$Elements\n15\n",
                &["`$EndElements` where the last of the elements", "export"],
            ),
            (0, b"$Elements\n14\n", b"$Elements\n13\n", &["`14` where `$EndElements` is expected", "export"]),
            (
                0,
                b"\n3 4 2 7 1",
                b"\n3 5 2 7 1",
                &["line 29: 9 numbers, but 13 are expected", "correct the line"],
            ),
            (
                0,
                b"\n3 4 2 7 1",
                b"\n3 4 9 7 1",
                &["line 29", "an element with its tags and nodes", "correct the line"],
            ),
            (0, b"\n3 4 2 7 1", b"\n3 4 -2 7 1", &["line 29: 9 numbers", "correct the line"]),
            (
                0,
                b"\n3 4 2 7 1",
                b"\n3 77 2 7 1",
                &["line 29: element type 77 is not read", "tetrahedra of order 1 or 2"],
            ),
            (0, b"\n3 4 2 7 1", b"\n3 4.5 2 7 1", &["line 29: element type 4.5 is not read", "tetrahedra"]),
            (0, b"\n3 4 2 7 1", b"\n3 4", &["line 29: 6 numbers", "correct the line"]),
            (
                0,
                b"\n3 4 2 7 1 ",
                b"\n3 4 2 7 1 99 ",
                &["line 29: 10 numbers, but 9 are expected", "correct the line"],
            ),
            (0, b"\n3 4 2 7 1 1 ", b"\n3 4 2 7 1 99 ", &["line 29: there is no node 99", "correct the node"]),
            (
                0,
                b"\n3 4 2 7 1 1 ",
                b"\n3 4 2 7 1 1.5 ",
                &["line 29: there is no node 1.5", "correct the node"],
            ),
            (
                0,
                b"\n3 4 2 7 1 1 4",
                b"\n3 4 2 7 1 1 1",
                &["line 29: a tetrahedron has one node twice", "remove the element"],
            ),
            (
                0,
                b"\n3 4 2 7 1 1 4",
                b"\n3 5 2 7 1 1 4 2 3 5 6 ",
                &["a solid of 8 corners is no tetrahedron", "mesh with tetrahedra alone"],
            ),
            (
                0,
                b"\n3 4 2 7 1 1 4",
                b"\n3 11 2 7 1 1 4 2 3 6 7 8 9 ",
                &["tetrahedra with 4 nodes and with 10 are mixed", "Gmsh: SetOrder 2"],
            ),
            (0, b"$EndElements", b"$EndNodes", &["`$EndNodes` where `$EndElements` is expected", "export"]),
            (
                0,
                b"$EndElements",
                b"$EndElements\n$Elements\n0\n$EndElements",
                &["a second section `$Elements`", "export"],
            ),
            (
                0,
                b"$EndElements",
                b"$EndElements\njunk",
                &["line 42: `junk` where a section is expected", "export"],
            ),
            (
                0,
                b"$EndElements",
                b"$EndElements\n$NodeData\n1",
                &["the file ends before `$EndNodeData`", "cut short"],
            ),
        ],
    );
    assert_eq!(count, 46);
}

#[test]
fn gmsh_4_text() {
    let count = each_is_refused(
        "two-4.1-ascii.msh",
        &[
            (0, b"4.1 0 8", b"4.0 0 8", &["line 2: MSH version 4 is not read", "-format msh41"]),
            (0, b"0 0 1 2\n", b"0 0 1 3\n", &["`$EndEntities` is not a number", "correct it"]),
            (0, b"0 0 1 2\n", b"0 0 1 -2\n", &["line 11: -2 is no number of entities", "export"]),
            (0, b"1 1 1 7 0 \n1", b"1 1 1.5 7 0 \n1", &["1.5 is no number of physical groups", "export"]),
            (
                1,
                b"1 1 1 7 0 ",
                b"1 1 2 7 9 0 ",
                &[
                    "line 13: a volume belongs to 2 physical groups: `soft`, `hard`",
                    "each element has one material",
                ],
            ),
            (
                0,
                b"$Entities",
                b"$PartitionedEntities",
                &["line 10: the mesh is partitioned", "-format msh22"],
            ),
            (
                0,
                b"$Nodes\n3 12",
                b"$Nodes\n3 13",
                &["line 17: 13 nodes are announced, and 12 follow", "export"],
            ),
            (
                0,
                b"$Nodes\n3 12",
                b"$Nodes\n4 12",
                &["`$EndNodes` where a block's heading is expected", "export"],
            ),
            (
                0,
                b"$Nodes\n3 12 5",
                b"$Nodes\n3 12",
                &["line 17: 3 numbers, but 4 are expected: the nodes' heading", "correct"],
            ),
            (0, b"\n2 1 0 6\n", b"\n7 1 0 6\n", &["line 18: dimension 7", "export"]),
            (0, b"\n2 1 0 6\n", b"\n2 1 0 7\n", &["line", "expected", "correct"]),
            (
                0,
                b"\n2 1 0 6\n",
                b"\n2 1 1 6\n",
                &["line 25: 3 numbers, but 5 are expected: a node's coordinates", "correct"],
            ),
            (
                0,
                b"\n2 1 0 6\n",
                b"\n2 1 0 6000\n",
                &["line 18: the file ends before the last of 6000 nodes", "cut short"],
            ),
            (0, b"\n25\n", b"\n15\n", &["node 15 is there twice", "remove one"]),
        ],
    );
    assert_eq!(count, 14);
    let good = std::fs::read_to_string(fixture("two-4.1-ascii.msh")).unwrap();
    let (nodes, elements) = (good.find("$Nodes").unwrap(), good.find("$Elements").unwrap());
    let turned = [&good[..nodes], &good[elements..], &good[nodes..elements]].concat();
    says(
        "turned",
        read_as("a.msh", turned.as_bytes()),
        &["line 16: the elements stand before the nodes", "put `$Nodes` first"],
    );
    says(
        "no nodes",
        read_as("a.msh", &good.as_bytes()[..nodes]),
        &["line 16: the file ends before `$Nodes` begins", "cut short"],
    );
    says(
        "no elements",
        read_as("a.msh", &good.as_bytes()[..elements]),
        &["the file ends before `$Elements` begins", "cut short"],
    );
    let block = good[elements..].lines().nth(2).unwrap();
    for (to, words) in [
        ("3 1 2 2", &["dimension 3 doesn't go with what the block holds", "export"][..]),
        ("2 1 29 2", &["dimension 2 doesn't go", "export"]),
        ("2 1 2 3", &["there is no node 1", "correct the node"]),
        ("2 1 2 1", &["element type 65 is not read", "tetrahedra of order"]),
    ] {
        let start = good[elements..].find(block).unwrap() + elements;
        let bad = [&good[..start], to, &good[start + block.len()..]].concat();
        says(to, read_as("a.msh", bad.as_bytes()), words);
    }
    let empty = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n0 0 0 0\n$EndNodes\n$Elements\n0 0 0 0\n$EndElements\n";
    says(
        "empty",
        read_as("a.msh", empty.as_bytes()),
        &["mesh: there is neither a tetrahedron nor a triangle", "gmsh -3"],
    );
}

#[test]
fn gmsh_binary() {
    for name in ["two-2.2-binary.msh", "two-4.1-binary.msh", "two-quadratic-4.1-binary.msh"] {
        let good = std::fs::read(fixture(name)).unwrap();
        let format = if name.contains("2.2") { &b"2.2 1 8"[..] } else { b"4.1 1 8" };
        let text = if name.contains("2.2") { &b"2.2 0 8"[..] } else { b"4.1 0 8" };
        says(name, read_as(name, &swap(&good, 0, format, text)), &["line 3", "export"]);
        let order = [format, b"\n\x01\0\0\0"].concat();
        let text_mode = [format, b"\r\n\x02\0\0\0"].concat();
        says(
            name,
            read_as(name, &swap(&good, 0, &order, &text_mode)),
            &["byte 25: the bytes [2, 0, 0, 0] are no 1", "binary mode"],
        );
        // Read with the other order of bytes, nothing fits.
        let turned = [format, b"\n\0\0\0\x01"].concat();
        says(name, read_as(name, &swap(&good, 0, &order, &turned)), &["byte", ";"]);
        for cut in [good.len() / 3, good.len() / 2, good.len() - 30] {
            says(name, read_as(name, &good[..cut]), &["the file ends before", "cut short or damaged"]);
        }
        // A carriage return put in by a transfer as text.
        let at = good.windows(7).position(|w| w == b"$Nodes\n").unwrap() + 40;
        let bad = [&good[..at], b"\r", &good[at..]].concat();
        says(name, read_as(name, &bad), &["byte", ";"]);
    }
}

#[test]
fn legacy_vtk() {
    let count = each_is_refused(
        "two-vtk-42-ascii.vtk",
        &[
            (
                0,
                b"# vtk DataFile",
                b"# DataFile",
                &["line 1: the first line is not `# vtk DataFile", "save the mesh as legacy VTK"],
            ),
            (0, b"ASCII", b"TEXT", &["line 3: `TEXT` is neither ASCII nor BINARY", "save"]),
            (
                0,
                b"UNSTRUCTURED_GRID",
                b"STRUCTURED_GRID",
                &["line 4: a data set of kind `STRUCTURED_GRID`", "save"],
            ),
            (
                0,
                b"POINTS 12 double",
                b"POINTS 12 triple",
                &["line 5: `triple` is not a number format", "save"],
            ),
            (
                0,
                b"POINTS 12 double",
                b"POINTS 13 double",
                &["line 11: `CELLS` is not a number", "correct it"],
            ),
            (0, b"POINTS 12 double", b"POINTS 11 double", &["is not a part of", "save"]),
            (
                0,
                b"POINTS 12 double",
                b"POINTS 1e12 double",
                &["line 5: the file ends before the last of 1000000000000 entries", "cut short"],
            ),
            (
                0,
                b"\n0 0 0 1",
                b"\n0 0 nan 1",
                &["line 5: a coordinate of vertex 0 is NaN", "correct the coordinate"],
            ),
            (
                0,
                b"\n0 0 0 1",
                b"\n0 0 2e6 1",
                &["node 0 (from 0): a coordinate is 2000 m", "check the mesh's unit"],
            ),
            (
                0,
                b"\n4 0 3 10 4",
                b"\n4 0 3 99 4",
                &["cell 2: it names vertex 99, but there are 12", "correct the index"],
            ),
            (0, b"\n4 0 3 10 4", b"\n4 0 3 -1 4", &["cell 2: it names vertex -1", "correct the index"]),
            (
                0,
                b"\n4 0 3 10 4",
                b"\n4 0 3 0 4",
                &["cell 2: a tetrahedron has one node twice", "remove the element"],
            ),
            (
                0,
                b"CELLS 14 68",
                b"CELLS 15 68",
                &["line 11: 15 cells are announced, and 14 follow", "export"],
            ),
            (0, b"CELL_TYPES 14", b"CELL_TYPES 13", &["line", "`10`", ";"]),
            (
                0,
                b"CELL_TYPES 14\n5\n5\n10",
                b"CELL_TYPES 14\n5\n5\n12",
                &["cell 2: a solid of VTK type 12 is no tetrahedron", "ParaView: Tetrahedralize"],
            ),
            (
                0,
                b"CELL_TYPES 14\n5\n5\n10",
                b"CELL_TYPES 14\n5\n5\n24",
                &["cell 2: a tetrahedron of VTK type 24 with 4 nodes", "4 or 10 nodes"],
            ),
            (
                0,
                b"CELL_TYPES 14\n5\n5\n10",
                b"CELL_TYPES 14\n5\n5\n99",
                &["cell 2: a cell of VTK type 99 is not read", "save the tetrahedra alone"],
            ),
            (0, b"LOOKUP_TABLE default\n", b"", &["have no LOOKUP_TABLE", "save the mesh again"]),
            (
                0,
                b"7 7 7 7 7 7 7 7 9",
                b"7 7 7 nan 7 7 7 7 9",
                &["cell 3: its `region` is NaN", "correct the array"],
            ),
            (
                0,
                b"7 7 7 7 7 7 7 7 9",
                b"7 7 7 nan 7 7 7 9",
                &["line 48: `FIELD` is not a number", "correct it"],
            ),
            (0, b"CELL_DATA 14", b"CELL_DATA 13", &["line", ";"]),
            (
                0,
                b"SCALARS region",
                b"SCALERS region",
                &["`SCALERS` is no data that is read", "save the mesh without it"],
            ),
        ],
    );
    assert_eq!(count, 22);
    let short = b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n";
    says(
        "no points",
        read_as("a.vtk", short),
        &["mesh: there is no triangle in it", "give a triangulated surface"],
    );
    let binary = std::fs::read(fixture("two-vtk-51-binary.vtk")).unwrap();
    says("cut", read_as("a.vtk", &binary[..300]), &["the file ends before", "cut short"]);
}

#[test]
fn vtu() {
    let count = each_is_refused(
        "two-vtk-ascii.vtu",
        &[
            (0, b"VTKFile", b"File", &["line 1: there is no tag `VTKFile`", "save the mesh as VTP or VTU"]),
            (0, b"UnstructuredGrid", b"ImageData", &["a data set of kind `ImageData`", "save it again"]),
            (
                0,
                b"format=\"ascii\"",
                b"format=\"zip\"",
                &["line 7: an array in format `zip`", "save it again"],
            ),
            (
                0,
                b"type=\"Int64\" Name=\"connectivity\"",
                b"type=\"Int65\" Name=\"connectivity\"",
                &["`type` is none that is read", "save it again"],
            ),
            (0, b"Name=\"types\"", b"Name=\"kinds\"", &["14 cells have 0 types", "save it again"]),
            (
                0,
                b"Name=\"connectivity\"",
                b"Name=\"list\"",
                &["cell 0: it ends at 3 of 0 vertex numbers", "export"],
            ),
            (
                0,
                b"7 7 7",
                b"7 7",
                &["piece 0, CellData: `region` has 13 numbers for 14 cells", "save it again"],
            ),
            (0, b"7 7 7", b"7 x 7", &["line 7: `x` is not a number", "correct it"]),
        ],
    );
    assert_eq!(count, 8);
    for (name, at_end) in
        [("two-vtk-binary.vtu", 600), ("two-vtk-appended.vtu", 400), ("two-vtk-appended-zlib.vtu", 60)]
    {
        let good = std::fs::read(fixture(name)).unwrap();
        says(name, read_as(name, &good[..good.len() - at_end]), &["line", ";"]);
    }
    let good = std::fs::read(fixture("two-vtk-appended.vtu")).unwrap();
    let far = swap(&good, 0, b"offset=\"0", b"offset=\"99999999990");
    says("offset", read_as("a.vtu", &far), &["line", "the file ends before the array's offset", "cut short"]);
}

#[test]
fn tetgen() {
    let (node, ele) =
        (std::fs::read(fixture("two.node")).unwrap(), std::fs::read(fixture("two.ele")).unwrap());
    let both = |node: &[u8], ele: &[u8]| {
        read_tetgen(node, ele, LengthUnit::Millimetre).map(drop).map_err(|e| e.to_string())
    };
    assert_eq!(both(&node, &ele), Ok(()));
    let in_nodes: Changes = &[
        (0, b"12  3  1  1", b"12  2  1  1", &["line 1: nodes of dimension 2", "not of Triangle's"]),
        (0, b"12  3  1  1", b"13  3  1  1", &["the file ends before a node", "cut short"]),
        (0, b"12  3  1  1", b"-2  3  1  1", &["line 1: -2 nodes are announced", "correct the heading"]),
        (
            0,
            b"12  3  1  1",
            b"1e15  3  1  1",
            &["line 1: 1e15 nodes are announced, which the file can't hold", "correct"],
        ),
        (0, b"12  3  1  1", b"12  3  2  1", &["line 2: 6 numbers, but a node has 7", "correct the line"]),
        (0, b"12  3  1  1", b"x  3  1  1", &["line 1: `x` is not a number", "correct it"]),
        (
            0,
            b"   0    0  0  0",
            b"   7    0  0  0",
            &["line 2: the first node has the number 7, but 0 or 1", "run TetGen again"],
        ),
        (
            0,
            b"   2    2  0  0",
            b"   3    2  0  0",
            &["line 4: node 3 stands where node 2 is expected", "put them in order"],
        ),
        (
            0,
            b"   2    2  0  0",
            b"   2    inf  0  0",
            &["line 4: a coordinate is inf", "correct the coordinate"],
        ),
        (
            0,
            b"   2    2  0  0",
            b"   2    2  0  # 0",
            &["line 4: 3 numbers, but a node has 6", "correct the line"],
        ),
    ];
    for (n, from, to, words) in in_nodes {
        says(&to.escape_ascii().to_string(), both(&swap(&node, *n, from, to), &ele), words);
    }
    let in_elements: Changes = &[
        (0, b"12  4  1", b"12  5  1", &["line 1: elements of 5 nodes, but 4 or 10 are read", "-o2"]),
        (0, b"12  4  1", b"12  10  1", &["line 2: 6 numbers, but an element has 12", "correct the line"]),
        (0, b"12  4  1", b"20  4  1", &["the file ends before an element", "cut short"]),
        (0, b"12  4  1", b"0  4  1", &["there is no tetrahedron in it", "mesh the volume"]),
        (
            0,
            b"10     4    7",
            b"12     4    7",
            &["line 2: there is no node 12; they run from 0 to 11", "of the same run"],
        ),
        (0, b"10     4    7", b"-1     4    7", &["line 2: there is no node -1", "of the same run"]),
        (0, b"10     4    7", b"1.5     4    7", &["line 2: there is no node 1.5", "of the same run"]),
        (
            0,
            b"10     4    7",
            b"10    10    7",
            &["line 2: a tetrahedron has one node twice", "remove the element"],
        ),
        (0, b"10     4    7", b"10     4    nan", &["line 2: the region is NaN", "correct it"]),
        (
            0,
            b"    2 ",
            b"    4 ",
            &["line 4: element 4 stands where element 2 is expected", "put them in order"],
        ),
    ];
    for (n, from, to, words) in in_elements {
        says(&to.escape_ascii().to_string(), both(&node, &swap(&ele, *n, from, to)), words);
    }
}

#[test]
fn files_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| {
        let path = directory.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        move || read(&path, LengthUnit::Millimetre).map(drop).map_err(|e| e.to_string())
    };
    says("empty", put("empty.msh", b"")(), &["empty.msh: file: it is empty", "export"]);
    says(
        "step",
        put("part.step", b"ISO-10303-21;")(),
        &["part.step: file name: `.step` is no mesh", "give a volume as .msh"],
    );
    says("noise", put("noise.msh", &[0xff; 300])(), &["noise.msh: line 1: ", "save the mesh as .msh"]);
    says(
        "alone",
        put("alone.node", b"1 3\n1 0 0 0\n")(),
        &["alone.node: file: there is no ", "alone.ele beside it", "side by side"],
    );
    says(
        "alone",
        put("lonely.ele", b"0 4\n")(),
        &["lonely.ele: file: there is no ", "lonely.node beside it"],
    );
    put("pair.node", b"1 3\n1 0 0 x\n")().unwrap_err();
    says("pair", put("pair.ele", b"0 4\n")(), &["pair.node: line 2: `x` is not a number", "correct it"]);
    put("two.node", &std::fs::read(fixture("two.node")).unwrap())().unwrap_err();
    says(
        "pair",
        put("two.ele", b"1 4\n1 0 1 2 12\n")(),
        &["two.ele: line 2: there is no node 12", "same run"],
    );
    says(
        "none",
        read(&directory.path().join("none.msh"), LengthUnit::Metre).map(drop).map_err(|e| e.to_string()),
        &["none.msh", "check that the path exists"],
    );
}
