//! `palpate bench --simulate` from outside, on a block of a few tetrahedra.

use glam::DVec3;
use palpate_simulate::TetMesh;
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::process::{Command, Output};

/// A folder with the quarter of a block: `n.csv`, `t.csv`, `p.csv`.
struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    fn new() -> Self {
        let size = [3, 2, 4];
        let number = |x: usize, y: usize, z: usize| (x + (size[0] + 1) * (y + (size[1] + 1) * z)) as u32;
        let (mut positions, mut tetrahedra) = (Vec::new(), Vec::new());
        for z in 0..=size[2] {
            for y in 0..=size[1] {
                for x in 0..=size[0] {
                    positions.push(DVec3::new(x as f64, y as f64, z as f64) * 0.01);
                    if x == size[0] || y == size[1] || z == size[2] {
                        continue;
                    }
                    for [a, b] in [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]] {
                        let mut at = [x, y, z];
                        let mut corners = [number(x, y, z); 4];
                        for (corner, axis) in corners[1..].iter_mut().zip([a, b, 3 - a - b]) {
                            at[axis] += 1;
                            *corner = number(at[0], at[1], at[2]);
                        }
                        tetrahedra.push(corners);
                    }
                }
            }
        }
        let mesh = TetMesh::from_corners(positions, &tetrahedra);
        let (mut nodes, mut patch) = ("# a block\nx_m,y_m,z_m\n".to_owned(), "node\n".to_owned());
        for (node, p) in mesh.positions.iter().enumerate() {
            writeln!(nodes, "{},{},{}", p.x, p.y, p.z).unwrap();
            if p.y > 0.0199 && p.x < 0.0101 && p.z < 0.0101 {
                writeln!(patch, "{node}").unwrap();
            }
        }
        let mut table = "n0,n1,n2,n3,n4,n5,n6,n7,n8,n9\n".to_owned();
        for element in &mesh.elements {
            writeln!(table, "{}", element.map(|n| n.to_string()).join(",")).unwrap();
        }
        TestDirectory(tempfile::tempdir().unwrap())
            .write("n.csv", &nodes)
            .write("t.csv", &table)
            .write("p.csv", &patch)
    }

    fn write(self, name: &str, text: &str) -> Self {
        fs::write(self.0.path().join(name), text).unwrap();
        self
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.0.path().join(name)).unwrap()
    }

    fn run(&self, args: &str) -> Output {
        Command::new(env!("CARGO_BIN_EXE_palpate"))
            .arg("bench")
            .args(args.split_whitespace())
            .current_dir(self.0.path())
            .output()
            .unwrap()
    }

    fn done(&self, args: &str) -> String {
        let output = self.run(args);
        assert!(output.status.success(), "{args}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    fn json(&self, args: &str) -> Value {
        let mut document: Value = serde_json::from_str(&self.done(&format!("{args} --json"))).unwrap();
        document["simulate"].take()
    }

    fn refused(&self, args: &str, words: &[&str]) {
        let Output { status, stdout, stderr } = self.run(args);
        let stderr = String::from_utf8(stderr).unwrap();
        assert_eq!((status.code(), stdout.len()), (Some(1), 0), "{args}: {stderr}");
        let told: Vec<&str> = stderr.lines().filter(|l| !l.contains("debug build")).collect();
        assert_eq!(told.len(), 1, "{args}: {stderr}");
        for word in words {
            assert!(told[0].contains(word), "{args}: `{word}` is not in: {stderr}");
        }
    }
}

const FILES: &str = "--simulate n.csv t.csv p.csv";

fn forces(run: &Value) -> Vec<[f64; 4]> {
    let state = |s: &Value| {
        ["depth_m", "distance_m", "force_n", "tangential_force_n"].map(|key| s[key].as_f64().unwrap())
    };
    run["states"].as_array().unwrap().iter().map(state).collect()
}

#[test]
fn a_path_is_simulated_and_timed() {
    let directory = TestDirectory::new();
    let run = directory.json(&format!("{FILES} --depth-mm 2 --steps 4"));
    let pressed = forces(&run);
    assert_eq!(pressed.iter().map(|s| s[0]).collect::<Vec<_>>(), [0.5e-3, 1e-3, 1.5e-3, 2e-3]);
    assert!(pressed.windows(2).all(|pair| pair[1][2] > pair[0][2] && pair[0][2] > 0.0), "{pressed:?}");
    assert!(pressed.iter().all(|s| s[1] == 0.0 && s[3] == 0.0), "{pressed:?}");
    assert!(run["states"].as_array().unwrap().iter().all(|s| s["newton_steps"].as_u64().unwrap() > 0));
    assert_eq!((run["force_factor"].as_f64(), run["stopped"].is_null()), (Some(4.0), true));
    // 4 × 3 × 5 corners, and the nodes on their edges.
    assert_eq!(run["unknowns"], 3 * 7 * 5 * 9);
    for time in ["cpu_s", "wall_s"] {
        let seconds = |key: &str| run[time][key].as_f64().unwrap();
        let parts = ["read", "model", "path"].map(seconds);
        assert!(parts.iter().all(|s| *s > 0.0), "{run}");
        assert!((parts.iter().sum::<f64>() - seconds("total")).abs() < 1e-9, "{run}");
        assert!(run["further_point"][time].as_f64().unwrap() > 0.0);
    }
    for counts in [&run["counts"], &run["further_point"]["counts"]] {
        for key in ["newton", "conjugate", "factorisations", "assemblies"] {
            assert!(counts[key].as_u64().unwrap() > 0, "{counts}");
        }
    }

    // Dragged, the body is mirrored, and pressing gives the same.
    for (direction, mirrored) in [("axial", [false, false, true]), ("around", [true, false, false])] {
        let drag = format!("--drag-mm 1 --drag-steps 2 --drag-direction {direction}");
        let run = directory.json(&format!("{FILES} --depth-mm 2 --steps 4 {drag}"));
        assert_eq!(run["mirrored"], serde_json::json!(mirrored));
        assert_eq!(run["force_factor"], 2.0);
        let states = forces(&run);
        assert_eq!(states.len(), 6);
        for (state, expected) in states.iter().zip(&pressed) {
            assert!((state[2] / expected[2] - 1.0).abs() < 1e-5, "{state:?} {expected:?}");
        }
        assert_eq!((states[4][1], states[5][1]), (0.5e-3, 1e-3));
        let [half, full] = [states[4][3], states[5][3]];
        assert!(half > 0.0 && (1.9..2.1).contains(&(full / half)), "{states:?}");
    }

    let text = directory.done(&format!("{FILES} --depth-mm 2 --steps 4 --drag-mm 1"));
    for word in ["half of a body", "mirrored about z = 0", "forces × 2", "isochoric", "1e-6", "further point"]
    {
        assert!(text.contains(word), "`{word}` is not in:\n{text}");
    }
}

#[test]
fn laws_differ_and_agree_at_small_strain() {
    let directory = TestDirectory::new();
    let force = |law: &str, depth: f64| {
        forces(&directory.json(&format!("{FILES} --depth-mm {depth} --steps 2 {law}")))[1][2]
    };
    let laws = ["--model linear", "--model st-venant-kirchhoff", "--form compressible", "--form isochoric"];
    let [small, large] = [0.001, 4.0].map(|depth| laws.map(|law| force(law, depth) / depth));
    for (i, (a, b)) in small.iter().zip(&large).enumerate() {
        assert!((a / small[0] - 1.0).abs() < 1e-3, "{small:?}");
        assert!(i == 0 || (b / large[0] - 1.0).abs() > 1e-3, "{large:?}");
    }
    assert!((large[0] / small[0] - 1.0).abs() < 1e-5, "{small:?} {large:?}");
    // Stiffness goes with Young's modulus.
    let stiffer = force("--model linear --young-modulus-pa 20000", 4.0) / 4.0;
    assert!((stiffer / large[0] - 2.0).abs() < 1e-5);
    assert!(force("--model linear --poisson-ratio 0.3", 4.0) / 4.0 < large[0]);
}

#[test]
fn wrong_tables_are_refused_with_their_place() {
    let directory = TestDirectory::new();
    let [nodes, tetrahedra, patch] = ["n.csv", "t.csv", "p.csv"].map(|name| directory.read(name));
    let first = tetrahedra.lines().nth(1).unwrap();
    let cells: Vec<&str> = first.split(',').collect();
    let replaced = |cell: usize, by: &str| {
        let mut cells = cells.clone();
        cells[cell] = by;
        tetrahedra.replacen(first, &cells.join(","), 1)
    };
    let turned = [1, 0, 2, 3, 4, 6, 5, 8, 7, 9].map(|i| cells[i]);
    let gmsh = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8].map(|i| cells[i]);
    let cases: &[(&str, String, &[&str])] = &[
        ("n.csv", nodes.replace("x_m", "x_mm"), &["n.csv:2", "x_m is missing"]),
        ("n.csv", nodes.replacen("0,0,0", "0,0,zero", 1), &["n.csv:3", "z_m is `zero`"]),
        ("n.csv", format!("{nodes}1,1,1\n"), &["t.csv", "node 315 of n.csv is in no tetrahedron"]),
        ("n.csv", String::new(), &["n.csv", "empty"]),
        ("t.csv", replaced(4, "315"), &["t.csv:2", "n4 is 315", "315 nodes", "from 0"]),
        ("t.csv", replaced(4, "-1"), &["t.csv:2", "n4 is -1"]),
        ("t.csv", replaced(4, "1.5"), &["t.csv:2", "n4 is 1.5", "whole numbers"]),
        ("t.csv", replaced(4, cells[0]), &["t.csv:2", "is there twice"]),
        (
            "t.csv",
            tetrahedra.replacen(first, &gmsh.join(","), 1),
            &["t.csv:2", "n8 is not between n1 and n3", "01, 12, 20, 03, 13, 23"],
        ),
        ("t.csv", tetrahedra.replacen(first, &turned.join(","), 1), &["t.csv", "element 0", "folded"]),
        ("t.csv", tetrahedra.replacen(first, "1,2,3", 1), &["t.csv:2", "3 values for 10 columns"]),
        ("p.csv", "node\n".into(), &["p.csv", "no row"]),
        ("p.csv", "node\n0\n315\n".into(), &["p.csv:3", "node is 315"]),
        ("p.csv", patch.replace("node", "id"), &["p.csv:1", "node is missing"]),
    ];
    for (name, text, words) in cases {
        let directory = TestDirectory::new().write(name, text);
        directory.refused(FILES, words);
    }
    directory.refused("--simulate n.csv t.csv none.csv", &["none.csv", "can't be read"]);
    directory.refused(&format!("{FILES} --model linear --form compressible"), &["--form"]);
    directory.refused(&format!("{FILES} --poisson-ratio 0.5"), &["--poisson-ratio:"]);
    directory.refused(&format!("{FILES} --young-modulus-pa 0"), &["--young-modulus-pa:"]);
    directory.refused(&format!("{FILES} --depth-mm 0"), &["--depth-mm"]);
    directory.refused(&format!("{FILES} --steps 0"), &["--steps"]);
    directory.refused(&format!("{FILES} --drag-mm nan"), &["--drag-mm"]);
    for usage in ["--simulate n.csv t.csv", "--depth-mm 1", &format!("{FILES} --anisotropic")] {
        assert_eq!(directory.run(usage).status.code(), Some(2), "{usage}");
    }
}
