//! The command from outside: files in, files out, exit statuses, one-line complaints.

use palpate_body::shape::{Resolution, Shape};
use palpate_body::{Body, SlipRule};
use palpate_engine::Waypoint;
use palpate_engine::{Ablation, Output, ToolState};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

struct Ran {
    code: i32,
    stdout: String,
    stderr: String,
}

/// A folder that commands run in.
struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    fn new() -> Self {
        TestDirectory(tempfile::tempdir().unwrap())
    }

    fn with_body() -> Self {
        let directory = TestDirectory::new();
        directory.write("spec.toml", SPEC).write("path.csv", PATH);
        directory.done("fit --spec spec.toml -o c.body");
        directory
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) -> &Self {
        fs::write(self.path(name), text).unwrap();
        self
    }

    fn run(&self, args: &str) -> Ran {
        let output = Command::new(env!("CARGO_BIN_EXE_palpate"))
            .args(args.split_whitespace())
            .current_dir(self.0.path())
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        Ran { code: output.status.code().unwrap(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    fn done(&self, args: &str) -> Ran {
        let ran = self.run(args);
        assert_eq!(ran.code, 0, "{args}: {}", ran.stderr);
        ran
    }

    fn json(&self, args: &str) -> Value {
        serde_json::from_str(&self.done(args).stdout).unwrap()
    }

    /// Runs a command that must refuse its input: status 1, one line that holds every one of `words`.
    fn refused(&self, args: &str, words: &[&str]) {
        let Ran { code, stdout, stderr } = self.run(args);
        assert_eq!(code, 1, "{args}: {stderr}");
        assert_eq!(stdout, "", "{args}");
        assert_eq!(stderr.trim_end().lines().count(), 1, "{args}: {stderr}");
        assert!(!stderr.contains("panicked"), "{args}: {stderr}");
        for word in words {
            assert!(stderr.contains(word), "{args}: `{word}` is not in: {stderr}");
        }
    }
}

#[test]
fn the_version_says_commit_and_features() {
    let said = TestDirectory::new().done("--version").stdout;
    assert_eq!(said, format!("palpate {}\n", palpate::VERSION));
    assert!(
        said.contains(env!("CARGO_PKG_VERSION")) && said.contains("features: devices, simulate"),
        "{said}"
    );
}

/// Body, friction, deflection and law of the paper's cylinder.
const SPEC: &str = r#"
[body.shape]
kind = "cylinder"
radius_mm = 30
length_mm = 100
around = 24
along = 11

[friction]
coefficient = 0.3

[deflection]
normal_max_mm = 8
lateral_max_mm = 4
steps = 12

[slip]
rule = "paper"
tank = false

[response]
law = "paper-cylinder"
stiffness_n_per_m = 600
lateral_stiffness_n_per_m = 500
around = 0.5
along = 0.2
"#;

/// Down, along, up.
const PATH: &str = "# a drag\nz_m,time_s,x_m,comment,y_m\n0.001,0,0,down,0.032\n0.001,0.05,0,,0.027\n\
                    0.02,0.3,0.004,along,0.027\n0.02,0.4,0.004,up,0.035\n";

/// A sphere's mesh as an OBJ file in mm, and samples at its poles.
fn mesh_and_samples(directory: &TestDirectory) {
    let mesh = Shape::Sphere { radius_mm: 20.0 }.mesh(Resolution::default()).unwrap();
    let mut obj = String::new();
    for p in &mesh.positions {
        let [x, y, z] = (*p * 1e3).to_array();
        writeln!(obj, "v {x} {y} {z}").unwrap();
    }
    for t in &mesh.triangles {
        writeln!(obj, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap();
    }
    let mut samples = String::from("point,x_m,y_m,z_m,component,deflection_m,value\n");
    for (name, z, stiffness) in [("north", 0.0201, 1.0), ("south", -0.02, 2.0)] {
        for (depth, force) in [(1e-3, 0.1), (2e-3, 0.3), (4e-3, 1.0)] {
            writeln!(samples, "{name},0,0,{z},normal,{depth},{}", force * stiffness).unwrap();
            writeln!(samples, "{name},0,0,{z},lateral,{depth},{}", 300.0 * stiffness * depth).unwrap();
        }
    }
    directory.write("sphere.obj", obj).write("samples.csv", samples);
}

#[test]
fn a_body_is_refined_over_the_same_test_points() {
    let directory = TestDirectory::with_body();
    mesh_and_samples(&directory);
    let report = directory.json("refine c.body -o fine.body --json");
    let fine = directory.json("inspect fine.body --json");
    assert_eq!((&report["triangles"], &report["triangles_before"]), (&fine["triangles"], &528.into()));
    assert!(fine["triangles"].as_u64() > Some(5000) && fine["test_points"] == 288, "{report}");
    assert!(fine["border_edges"].as_u64() > Some(300));
    let notes = fine["provenance"]["notes"].to_string();
    assert!(notes.contains("10.0 µm") && notes.contains("528 triangles"), "{notes}");
    let finer = directory.json("refine c.body --sagitta-um 1 -o finer.body --json");
    assert!(finer["triangles"].as_u64() > report["triangles"].as_u64());
    let even = directory.json("refine c.body --edge-length-mm 4 -o even.body --json");
    assert!(even["triangles"].as_u64() > Some(528 * 4), "{even}");
    // A spec asks for the same, which `fit` does only where it is asked.
    directory.write("fine.toml", format!("[body]\nsagitta_um = 10\n{SPEC}"));
    directory.done("fit --spec fine.toml -o asked.body");
    assert_eq!(directory.json("inspect asked.body --json")["triangles"], report["triangles"]);
    // The same path, the same work, but for the ridges.
    let work = |body: &str| {
        directory.done(&format!("trace {body} --path path.csv -o t.csv"));
        fs::read_to_string(directory.path("t.csv")).unwrap().lines().count()
    };
    assert_eq!(work("c.body"), work("fine.body"));
    assert!(directory.done("refine fine.body -o again.body").stderr.contains("nothing was divided"));

    directory.done("fit --mesh sphere.obj --unit mm --samples samples.csv --friction 0.3 -o s.body");
    let own = Shape::Sphere { radius_mm: 20.0 };
    let mesh = own.mesh(Resolution { edge_length_mm: Some(1.5), ..Default::default() }).unwrap();
    let mut obj = String::new();
    for p in &mesh.positions {
        writeln!(obj, "v {} {} {}", p.x * 1e3, p.y * 1e3, p.z * 1e3).unwrap();
    }
    for t in &mesh.triangles {
        writeln!(obj, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap();
    }
    directory.write("own.obj", obj);
    let report = directory.json("refine s.body --mesh own.obj --unit mm -o own.body --json");
    assert_eq!((&report["triangles"], &report["test_points"]), (&mesh.triangles.len().into(), &2.into()));

    directory.refused("refine c.body --sagitta-um 0 -o x.body", &["--sagitta-um", "positive"]);
    directory.refused("refine c.body --edge-length-mm nan -o x.body", &["--edge-length-mm", "positive"]);
    directory.refused("refine c.body --sagitta-um 1e-7 -o x.body", &["c.body", "0.0000001 µm", "larger"]);
    directory.refused("refine c.body -o c.body", &["c.body"]);
    directory.refused("refine s.body --mesh own.obj --unit m -o x.body", &["own.obj", "unit"]);
    assert_eq!(directory.run("refine c.body --mesh own.obj -o x.body").code, 2);
    assert_eq!(directory.run("refine c.body --sagitta-um 1 --edge-length-mm 1 -o x.body").code, 2);
}

#[test]
fn a_law_becomes_a_body_a_trace_and_tables() {
    let directory = TestDirectory::with_body();
    let inspection = directory.json("inspect c.body --json --plots pictures");
    assert_eq!(inspection["nodes"], 288);
    assert_eq!(inspection["triangles"], 528);
    assert_eq!(inspection["test_points"], 288);
    assert_eq!(inspection["border_edges"], 48);
    assert_eq!(inspection["anisotropic"], false);
    assert_eq!(inspection["lateral_ratio"], serde_json::json!([1.0, 1.0]));
    assert_eq!(inspection["slip"], "paper");
    assert_eq!((&inspection["tank"], &inspection["partial_slip"]), (&false.into(), &false.into()));
    directory.write("two.toml", SPEC.replace("tank = false", "partial = true"));
    directory.done("fit --spec two.toml -o two.body");
    let two = directory.json("inspect two.body --json");
    assert_eq!((&two["tank"], &two["partial_slip"]), (&true.into(), &true.into()));
    assert_eq!(inspection["tools"][0]["shape"], "point");
    let provenance = &inspection["provenance"];
    assert_eq!(provenance["spec"], SPEC);
    assert_eq!(provenance["command"], "palpate fit --spec spec.toml -o c.body");
    assert_eq!(provenance["inputs"]["spec.toml"].as_str().unwrap().len(), 64);
    let stiffness = inspection["stiffness_max_n_per_m"].as_array().unwrap();
    assert_eq!(stiffness.len(), 13);
    // The stiffest node's quadratic at full depth: 200 k δ, with k a little below 600 · 1.5 · 1.2.
    assert_eq!(stiffness[12]["depth_m"], 8e-3);
    assert!((1700.0..1728.0).contains(&stiffness[12]["value"].as_f64().unwrap()));
    for picture in ["normal.png", "lateral.png", "friction.png"] {
        assert!(fs::read(directory.path("pictures").join(picture)).unwrap().starts_with(b"\x89PNG"));
    }
    assert!(directory.done("inspect c.body").stdout.contains("mm"));

    let summary = directory.json("trace c.body --path path.csv --rate-hz 1000 -o trace.csv --json");
    assert_eq!(summary["steps"], 401);
    assert_eq!(summary["contacts"], 1);
    assert!(summary["largest_force_n"].as_f64().unwrap() > 0.5);

    directory.done("export c.body --vtu c.vtu --csv tables");
    let vtu = fs::read(directory.path("c.vtu")).unwrap();
    let header = String::from_utf8_lossy(&vtu[..2000]).into_owned();
    assert!(header.contains(r#"NumberOfPoints="288" NumberOfCells="528""#), "{header}");
    let rows = |name: &str| fs::read_to_string(directory.path("tables").join(name)).unwrap().lines().count();
    assert_eq!((rows("nodes.csv"), rows("elements.csv")), (289, 529));

    // The exported curves are samples: fitted again they are the same body's.
    let refit =
        "fit --spec spec.toml --samples tables/curves.csv --interpolation linear -o again.body --json";
    let again = directory.json(refit);
    assert_eq!(again["test_points"], 288);
    assert_eq!(again["fit"]["largest_distance_m"], 0.0);
    let [first, again] = ["c.body", "again.body"].map(|name| Body::open(&directory.path(name)).unwrap());
    let ends = |body: &Body| body.curves().iter().map(|r| r.normal.value(8e-3)).collect::<Vec<_>>();
    assert!(ends(&first).iter().zip(ends(&again)).all(|(a, b)| (a - b).abs() < 1e-9));
}

#[test]
fn an_anisotropic_body_says_so() {
    let directory = TestDirectory::new();
    palpate_cli::bench::cylinder(528, 1.9).unwrap().save(&directory.path("a.body")).unwrap();
    palpate_cli::bench::cylinder(528, 1.0).unwrap().save(&directory.path("i.body")).unwrap();
    let [stretched, plain] = ["a", "i"].map(|body| directory.json(&format!("inspect {body}.body --json")));
    assert_eq!((&stretched["anisotropic"], &plain["anisotropic"]), (&true.into(), &false.into()));
    for end in stretched["lateral_ratio"].as_array().unwrap() {
        assert!((end.as_f64().unwrap() - 1.9).abs() < 1e-9);
    }
    // At depth 0 only the lateral stiffness counts: 2 · 1.9/2.9 times the mean along the stiff axis.
    let at_0 = |i: &serde_json::Value| i["stiffness_max_n_per_m"][0]["value"].as_f64().unwrap();
    assert!((at_0(&stretched) / at_0(&plain) - 3.8 / 2.9).abs() < 1e-9);
    assert!(directory.done("inspect a.body").stdout.contains("1.9"));

    directory.done("export a.body --vtu a.vtu --csv tables");
    let vtu = fs::read(directory.path("a.vtu")).unwrap();
    let header = String::from_utf8_lossy(&vtu[..3000]).into_owned();
    for array in ["lateral_tensor_xx_yy_zz_xy_yz_xz", "lateral_ratio", "lateral_axis"] {
        assert!(header.contains(array), "{header}");
    }
    let nodes = fs::read_to_string(directory.path("tables/nodes.csv")).unwrap();
    assert!(
        nodes
            .lines()
            .next()
            .unwrap()
            .ends_with("lateral_xx,lateral_yy,lateral_zz,lateral_xy,lateral_xz,lateral_yz")
    );
    let columns = |line: &str| line.split(',').count();
    assert!(nodes.lines().all(|line| columns(line) == 24), "{nodes}");
}

#[test]
fn samples_become_a_body() {
    let directory = TestDirectory::new();
    mesh_and_samples(&directory);
    let fit = "fit --mesh sphere.obj --samples samples.csv --friction 0.4 -o s.body";
    directory.refused(fit, &["sphere.obj", "unit"]);
    let report = directory.json(&format!("{fit} --unit mm --json"));
    assert_eq!(report["test_points"], 2);
    assert!((report["fit"]["largest_distance_m"].as_f64().unwrap() - 1e-4).abs() < 1e-9);
    let ran = directory.done(&format!("{fit} --unit mm"));
    assert!(ran.stdout.is_empty() && ran.stderr.contains("north"), "{}", ran.stderr);
    let body = Body::open(&directory.path("s.body")).unwrap();
    assert!((body.curves()[1].normal.value(2e-3) - 0.6).abs() < 1e-12);
    assert!((body.curves()[0].friction.value(1e-3) - 0.4).abs() < 1e-12);
    assert!(
        body.nodes().iter().any(|n| n.weights.iter().all(|w| *w < 0.999)),
        "between the poles nodes blend"
    );
}

/// Rows of a trace.
fn rows(path: &Path) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    assert_eq!(
        lines.next().unwrap(),
        "time_s,x_m,y_m,z_m,in_contact,slipping,element,cx_m,cy_m,cz_m,delta_z_m,delta_r_m,fx_n,fy_n,fz_n,tx_nm,\
         ty_nm,tz_nm,work_j,stored_j,dissipated_j,generated_j"
    );
    lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
}

#[test]
fn a_trace_reads_back_to_the_same_bits() {
    let directory = TestDirectory::with_body();
    let body = Body::open(&directory.path("c.body")).unwrap();
    for (flag, ablation) in [
        ("", Ablation::None),
        ("--ablate coordinates", Ablation::Coordinates),
        ("--ablate responses", Ablation::Responses),
        ("--ablate both", Ablation::Both),
    ] {
        directory
            .done(&format!("trace c.body --path path.csv --rate-hz 500 -o trace.csv --slip paper {flag}"));
        let rows = rows(&directory.path("trace.csv"));
        let path = rows.iter().map(|r| Waypoint { time_s: r[0], pose: ToolState::at([r[1], r[2], r[3]]) });
        let outputs: Vec<Output> = palpate_engine::rollout(&body, path, SlipRule::Paper, ablation).collect();
        assert_eq!(rows.len(), 201);
        assert!(rows.iter().any(|r| r[4] == 1.0) && rows.iter().any(|r| r[4] == 0.0 && r[6] == -1.0));
        for (row, output) in rows.iter().zip(&outputs) {
            assert_eq!(row[12..15], output.force_n);
            assert_eq!(row[18], output.energy.work_j);
            assert_eq!(row[4] == 1.0, output.contact.is_some());
            if let Some(c) = output.contact {
                assert_eq!((row[6], row[10], row[11]), (f64::from(c.element), c.delta_z_m, c.delta_r_m));
                assert_eq!(row[7..10], c.position_m);
            }
        }
    }
    let first = fs::read(directory.path("trace.csv")).unwrap();
    directory.done("trace c.body --path path.csv --rate-hz 500 -o trace.csv --ablate both");
    assert!(first == fs::read(directory.path("trace.csv")).unwrap(), "a trace is deterministic");
}

#[test]
fn a_start_inside_is_told() {
    let directory = TestDirectory::with_body();
    directory.write("inside.csv", "time_s,x_m,y_m,z_m\n0,0,0.028,0\n1,0,0.027,0\n");
    assert!(directory.done("trace c.body --path inside.csv -o t.csv").stderr.contains("began inside"));
}

#[test]
fn a_refused_output_leaves_the_old_one() {
    let directory = TestDirectory::with_body();
    let before = fs::read(directory.path("c.body")).unwrap();
    directory.write("bad.toml", "[body]\nmesh = 3\n");
    directory.refused("fit --spec bad.toml -o c.body", &["bad.toml:2"]);
    assert!(before == fs::read(directory.path("c.body")).unwrap());
    directory.done("fit --spec spec.toml -o c.body");
    assert!(before == fs::read(directory.path("c.body")).unwrap(), "the same spec gives the same bytes");
}

#[test]
fn parts_for_the_simulator_are_ignored_aloud() {
    let directory = TestDirectory::new();
    let more = "[material]\nmodel = \"neo-hookean\"\n[test_points]\ncount = 60\n\
                [[body.fixed]]\nhalf_space = { point_mm = [0, 0, 99], normal = [0, 0, 1] }\n";
    directory.write("spec.toml", format!("{SPEC}{more}"));
    let ran = directory.done("fit --spec spec.toml -o c.body");
    for part in ["[material]", "[test_points]", "[[body.fixed]]"] {
        assert!(ran.stderr.contains(part), "{}", ran.stderr);
    }
}

#[test]
fn wrong_usage_exits_with_2() {
    let directory = TestDirectory::new();
    for args in [
        "",
        "fit",
        "fly",
        "trace a.body",
        "export a.body",
        "fit --mesh a.stl --unit inch -o b",
        "trace a --slip exact",
    ] {
        let ran = directory.run(args);
        assert_eq!(ran.code, 2, "{args}: {}", ran.stderr);
    }
    for command in ["fit", "inspect", "trace", "export", "bench"] {
        let help = directory.done(&format!("{command} --help")).stdout;
        assert!(help.contains("Example") && help.contains("Exit status"), "{command}: {help}");
    }
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let directory = TestDirectory::with_body();
    let mut child = Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["inspect", "c.body", "--json"])
        .current_dir(directory.0.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    assert!(output.status.success());
}

#[test]
fn bench_gives_every_regime() {
    let directory = TestDirectory::new();
    let plain = directory.json("bench --triangles 528,2000 --steps 10000 --json");
    let stretched = directory
        .json("bench --triangles 528 --steps 10000 --slip paper,consistent,exact --anisotropic --partial-slip --json");
    let [plain, stretched] = [&plain, &stretched].map(|d| d["results"].as_array().unwrap());
    assert_eq!((plain.len(), stretched.len()), (60, 60));
    for (i, row) in plain.iter().enumerate() {
        assert_eq!(row["law"], ["decoupled", "coupled"][i / 15 % 2]);
        assert_eq!(row["slip"], ["paper", "consistent", "exact"][i / 5 % 3]);
    }
    for (i, row) in stretched.iter().enumerate() {
        assert_eq!(row["slip"], ["paper", "consistent", "exact"][i / 5 % 3]);
        assert_eq!(row["partial_slip"], i / 15 % 2 == 1);
    }
    assert!(plain.iter().all(|row| row["partial_slip"] == false));
    assert!(stretched.iter().all(|row| row["anisotropic"] == true));
    for row in plain.iter().chain(stretched) {
        let number = |key: &str| row[key].as_f64().unwrap();
        assert!(
            number("median_ns") > 0.0 && number("p99_ns") >= 0.0 && number("p999_ns") >= number("p99_ns")
        );
        assert_eq!(row["capped"], 0, "{row}");
        let (touching, slipping) = match row["regime"].as_str().unwrap() {
            "free" => (0.0..=0.0, 0.0..=0.0),
            "stick" => (1.0..=1.0, 0.0..=0.0),
            "slide" | "slide-cold" => (1.0..=1.0, 0.98..=1.0),
            _ => (1.0..=1.0, 0.0..=1.0),
        };
        assert!(touching.contains(&number("in_contact")), "{row}");
        assert!(slipping.contains(&number("slipping")), "{row}");
    }
}

/// The spec with one piece of it replaced.
fn spec(piece: &str, replacement: &str) -> String {
    assert!(SPEC.contains(piece), "{piece}");
    SPEC.replacen(piece, replacement, 1)
}

#[test]
fn wrong_specs_are_refused_with_their_line() {
    let directory = TestDirectory::new();
    let cases: &[(String, &[&str])] = &[
        (String::new(), &["bad.toml", "mesh nor shape"]),
        ("[body\n".into(), &["bad.toml:1"]),
        (spec("radius_mm = 30", "radius = 30"), &["bad.toml:4", "unknown field `radius`"]),
        (spec("radius_mm = 30", "radius_mm = -30"), &["bad.toml:4", "radius_mm"]),
        (spec("radius_mm = 30", "radius_mm = nan"), &["bad.toml:4", "radius_mm"]),
        (spec("radius_mm = 30\n", ""), &["bad.toml:2", "radius_mm"]),
        (spec("kind = \"cylinder\"", "kind = \"teapot\""), &["bad.toml:3", "teapot"]),
        (spec("around = 24", "around = 2"), &["bad.toml:6", "around"]),
        (spec("around = 24", "around = 1000000000"), &["bad.toml:6", "triangles"]),
        (spec("around = 24", "around = 100000"), &["bad.toml", "coarser"]),
        (spec("coefficient = 0.3", "coefficient = -0.3"), &["bad.toml:10", "-0.3"]),
        (spec("coefficient = 0.3", "coefficient = \"much\""), &["bad.toml:10", "invalid type"]),
        (spec("coefficient = 0.3", "depth_mm = [0, 1]"), &["bad.toml:9", "coefficients"]),
        (
            spec("coefficient = 0.3", "depth_mm = [0, 2, 1]\ncoefficients = [1, 1, 1]"),
            &["bad.toml:10", "ascend"],
        ),
        (spec("coefficient = 0.3", "depth_mm = [0, 2]\ncoefficients = [1]"), &["bad.toml:11", "as many"]),
        (spec("[friction]\ncoefficient = 0.3", ""), &["bad.toml", "[friction]", "missing"]),
        (spec("normal_max_mm = 8", "normal_max_mm = 0"), &["bad.toml:13", "normal_max_mm"]),
        (spec("lateral_max_mm = 4\n", ""), &["bad.toml:12", "lateral_max_mm"]),
        (spec("steps = 12", "steps = 0"), &["bad.toml:15", "steps"]),
        (spec("steps = 12", "steps = 12\nsteps = 13"), &["bad.toml:16", "duplicate"]),
        (spec("rule = \"paper\"", "rule = \"sticky\""), &["bad.toml:18", "sticky", "consistent"]),
        (spec("law = \"paper-cylinder\"", "law = \"hooke\""), &["bad.toml:22", "hooke"]),
        (spec("law = \"paper-cylinder\"", "law = \"uniform\""), &["bad.toml:25", "does not vary"]),
        (spec("stiffness_n_per_m = 600", "stiffness_n_per_m = inf"), &["bad.toml:23", "stiffness_n_per_m"]),
        (spec("stiffness_n_per_m = 600\n", ""), &["bad.toml:21", "stiffness_n_per_m"]),
        (spec("around = 0.5", "around = 1.5"), &["bad.toml:25", "around"]),
        (format!("{SPEC}[extra]\n"), &["bad.toml:27", "unknown field `extra`"]),
        (format!("{SPEC}[tool]\nshape = \"spoon\"\n"), &["bad.toml:28", "spoon"]),
        (format!("{SPEC}[tool]\nshape = \"sphere\"\n"), &["bad.toml:27", "radius_mm"]),
        (format!("{SPEC}[tool]\nshape = \"point\"\nradius_mm = 3\n"), &["bad.toml:29", "no radius"]),
        (format!("[body]\nmesh = \"a.stl\"\n{SPEC}"), &["bad.toml:4", "a mesh and a shape"]),
        (format!("[body]\nsagitta_um = -1\n{SPEC}"), &["bad.toml:2", "sagitta_um"]),
        (format!("[body]\nsagitta_um = 1e-9\n{SPEC}"), &["bad.toml", "sagitta_um", "50000000", "larger"]),
        (format!("[body]\ncrease_angle_deg = 200\n{SPEC}"), &["bad.toml:2", "crease_angle_deg"]),
        (format!("[body]\nunit = \"inch\"\n{SPEC}"), &["bad.toml:2", "inch"]),
    ];
    for (text, words) in cases {
        directory.write("bad.toml", text);
        directory.refused("fit --spec bad.toml -o out.body", words);
        assert!(!directory.path("out.body").exists());
    }
    directory.write("bad.toml", b"[body]\n\xff\xfe");
    directory.refused("fit --spec bad.toml -o out.body", &["bad.toml:2", "UTF-8"]);
    directory.refused("fit --spec none.toml -o out.body", &["none.toml"]);
}

#[test]
fn wrong_paths_are_refused_with_their_line() {
    let directory = TestDirectory::with_body();
    let head = "time_s,x_m,y_m,z_m\n";
    let cases: &[(String, &str)] = &[
        (String::new(), "bad.csv: it is empty"),
        ("# only a comment\n".into(), "bad.csv: it is empty"),
        (head.into(), "no row"),
        ("time_s,x_m,y_m\n0,0,0\n".into(), "bad.csv:1: column z_m"),
        (format!("{head}0,0,0,nan\n"), "bad.csv:2: z_m"),
        (format!("{head}0,0,0,0\n1,inf,0,0\n"), "bad.csv:3: x_m"),
        (format!("{head}0,0,0,0\n1,,0,0\n"), "bad.csv:3: x_m"),
        (format!("{head}0,0,0,0\n#\n1,0,0\n"), "bad.csv:4: 3 values"),
        (format!("{head}0,0,0,0\n1,0,0,0,0\n"), "bad.csv:3: 5 values"),
        (format!("{head}1,0,0,0\n1,0,0,0\n"), "bad.csv:3: time_s"),
        (format!("{head}1,0,0,0\n0,0,0,0\n"), "bad.csv:3: time_s"),
        (format!("{head}0,0,0,3000\n"), "bad.csv:2: a coordinate"),
        ("time_s,x_m,y_m,z_m,qw\n0,0,0,0,1\n".into(), "bad.csv:1: column qx"),
        ("time_s,x_m,y_m,z_m,qw,qx,qy,qz\n0,0,0,0,1,0.1,0,0\n".into(), "bad.csv:2: the quaternion"),
    ];
    for (text, words) in cases {
        directory.write("bad.csv", text);
        directory.refused("trace c.body --path bad.csv -o out.csv", &[words]);
        assert!(!directory.path("out.csv").exists());
    }
    directory.refused("trace c.body --path path.csv --rate-hz 0 -o out.csv", &["--rate-hz 0"]);
    directory.refused("trace c.body --path path.csv -o path.csv", &["path.csv", "input"]);
    directory.refused("trace c.body --path path.csv -o ./c.body", &["c.body", "input"]);
    directory.refused("trace c.body --path path.csv -o no/such/folder.csv", &["no/such/folder.csv"]);
    directory.refused("trace c.body --path missing.csv -o out.csv", &["missing.csv"]);
}

#[test]
fn wrong_samples_meshes_and_bodies_are_refused() {
    let directory = TestDirectory::with_body();
    mesh_and_samples(&directory);
    let head = "point,x_m,y_m,z_m,component,deflection_m,value\n";
    let fit = "fit --mesh sphere.obj --unit mm --samples bad.csv -o out.body";
    for text in [
        String::new(),
        head.into(),
        "point,x_m\n".into(),
        format!("{head}a,0,0,0.02,sideways,0.001,1\n"),
        format!("{head}a,0,0,0.02,normal,0.001,nan\n"),
        format!("{head}a,0,0,0.02,normal,0.001\n"),
        format!("{head}a,0,0,0.02,normal,0.001,1\na,0,0,0.02,normal,0.002,0.5\na,0,0,0.02,lateral,0.001,1\n"),
        format!("{head}a,0,0,0.02,normal,0.001,1\n"),
    ] {
        directory.write("bad.csv", text);
        directory.refused(fit, &["bad.csv"]);
    }
    for (name, text) in [
        ("bad.obj", "v 0 0 0\nf 1 2 3\n"),
        ("bad.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        ("bad.stl", "solid x\n facet"),
        ("bad.xyz", "?"),
        ("bad.ply", ""),
    ] {
        directory.write(name, text);
        directory.refused(&format!("fit --mesh {name} --unit mm --samples samples.csv -o out.body"), &[name]);
    }
    let good = fs::read(directory.path("c.body")).unwrap();
    let mut twisted = good.clone();
    let middle = twisted.len() / 2;
    twisted[middle..middle + 4000].fill(0xff);
    for bytes in [&b""[..], b"not a body", &good[..good.len() / 2], &twisted] {
        directory.write("bad.body", bytes);
        directory.refused("inspect bad.body", &["bad.body"]);
        directory.refused("export bad.body --vtu out.vtu", &["bad.body"]);
        directory.refused("trace bad.body --path path.csv -o out.csv", &["bad.body"]);
    }
    directory.refused("inspect .", &["."]);
    directory.refused("fit --mesh sphere.obj --unit mm -o out.body", &["--samples"]);
    directory.refused(
        "fit --mesh sphere.obj --unit mm --samples samples.csv -o sphere.obj",
        &["sphere.obj", "input"],
    );
    directory.refused("fit --spec spec.toml --friction 1000 -o out.body", &["--friction"]);
    directory.refused("bench --triangles 1", &["--triangles"]);
}

#[cfg(unix)]
#[test]
fn an_output_is_a_file_or_refused() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let directory = TestDirectory::with_body();
    // Through a link, the file behind it is replaced and keeps its mode.
    directory.write("real.csv", "old").write("real.body", "old");
    for (link, real) in [("link.csv", "real.csv"), ("link.body", "real.body")] {
        symlink(real, directory.path(link)).unwrap();
        fs::set_permissions(directory.path(real), fs::Permissions::from_mode(0o640)).unwrap();
    }
    directory.done("trace c.body --path path.csv -o link.csv");
    directory.done("fit --spec spec.toml -o link.body");
    for (link, real) in [("link.csv", "real.csv"), ("link.body", "real.body")] {
        assert!(directory.path(link).is_symlink());
        assert_eq!(fs::metadata(directory.path(real)).unwrap().permissions().mode() & 0o777, 0o640);
    }
    assert_eq!(rows(&directory.path("real.csv")).len(), 4);
    assert_eq!(Body::open(&directory.path("real.body")).unwrap().nodes().len(), 288);

    // Devices and pipes take a trace; nothing else replaces them.
    directory.done("trace c.body --path path.csv -o /dev/null");
    directory
        .refused("export c.body --vtu /dev/null", &["/dev/null", "no ordinary file", "give a file's name"]);
    directory.refused("fit --spec spec.toml -o /dev/null", &["/dev/null", "no ordinary file"]);
    assert!(Command::new("mkfifo").arg(directory.path("pipe")).status().unwrap().success());
    let reader = std::thread::spawn({
        let pipe = directory.path("pipe");
        move || fs::read(pipe).unwrap()
    });
    directory.done("trace c.body --path path.csv -o pipe");
    assert!(reader.join().unwrap() == fs::read(directory.path("real.csv")).unwrap());
    symlink("nowhere", directory.path("dangling")).unwrap();
    directory.refused("trace c.body --path path.csv -o dangling", &["dangling", "leads nowhere"]);

    // Complaints name the output, not the temporary file.
    for args in ["trace c.body --path path.csv -o no/t.csv", "fit --spec spec.toml -o no/t.body"] {
        directory.refused(args, &["no/t."]);
        assert!(!directory.run(args).stderr.contains(".tmp"), "{}", directory.run(args).stderr);
    }
    if Path::new("/dev/full").exists() {
        directory.refused("trace c.body --path path.csv -o /dev/full", &["/dev/full: can't be written"]);
    }
    fs::create_dir_all(directory.path("plots/normal.png")).unwrap();
    directory.refused("inspect c.body --plots plots", &["normal.png", "folder"]);
}

#[test]
fn outputs_are_no_inputs_and_not_each_other() {
    let directory = TestDirectory::with_body();
    let body = fs::read(directory.path("c.body")).unwrap();
    fs::create_dir(directory.path("d")).unwrap();
    for name in ["nodes.csv", "elements.csv", "curves.csv"] {
        directory.write(&format!("d/{name}"), &body);
        directory.refused(&format!("export d/{name} --csv d"), &[name, "input"]);
    }
    directory.write("d/friction.png", &body);
    directory.refused("inspect d/friction.png --plots d", &["friction.png", "input"]);
    directory.refused("export c.body --vtu new/curves.csv --csv new", &["curves.csv", "also the output"]);
    directory.refused("export c.body --vtu ./new/../c.body", &["c.body"]);
    assert!(!directory.path("new").exists());
    for file in ["c.body", "d/nodes.csv", "d/friction.png"] {
        assert!(body == fs::read(directory.path(file)).unwrap(), "{file}");
    }
}

#[test]
fn a_resampled_path_keeps_its_end() {
    let directory = TestDirectory::with_body();
    directory.write("short.csv", "time_s,x_m,y_m,z_m\n0,0,0.04,0\n0.0105,0,0.035,0\n");
    directory.done("trace c.body --path short.csv --rate-hz 1000 -o t.csv");
    let rows = rows(&directory.path("t.csv"));
    assert_eq!(rows.len(), 12);
    assert_eq!(rows[11][..4], [0.0105, 0.0, 0.035, 0.0]);
    for rate in ["nan", "inf", "0", "-5"] {
        let args = format!("trace c.body --path short.csv --rate-hz={rate} -o t.csv");
        directory.refused(&args, &[&format!("--rate-hz {}", rate.replace("nan", "NaN")), "above 0 Hz"]);
    }
}

#[test]
fn a_trace_tells_of_snaps_and_extrapolation() {
    let directory = TestDirectory::with_body();
    // Deep: past the axis the surface's curvature leaves the contact point no stable place.
    directory.write(
        "deep.csv",
        "time_s,x_m,y_m,z_m\n0,0.0005,0.032,0.001\n1,0.0005,0.027,0.001\n2,0.004,-0.01,0.001\n",
    );
    let trace = "trace c.body --path deep.csv --rate-hz 100 -o t.csv";
    let summary = directory.json(&format!("{trace} --json"));
    assert!(summary["snap_steps"].as_u64().unwrap() > 0, "{summary}");
    assert!(summary["extrapolated_steps"].as_u64().unwrap() > 0, "{summary}");
    let told = directory.done(trace).stderr;
    for words in ["a snap", "docs/model.md), first at t = ", "8 mm", "extrapolated", "1 contact,"] {
        assert!(told.contains(words), "`{words}` is not in: {told}");
    }

    let summary = directory.json("trace c.body --path path.csv --rate-hz 1000 -o t.csv --json");
    assert_eq!((&summary["snap_steps"], &summary["extrapolated_steps"]), (&0.into(), &0.into()));
    let told = directory.done("trace c.body --path path.csv --rate-hz 1000 -o t.csv").stderr;
    assert!(
        !told.contains("snap") && !told.contains("extrapolated") && told.contains("1 contact,"),
        "{told}"
    );

    directory.write("far.csv", "time_s,x_m,y_m,z_m\n0,0.001,0.04,0.001\n1,0.001,0.5,0.001\n");
    let told = directory.done("trace c.body --path far.csv -o t.csv").stderr;
    assert!(
        told.contains("nothing was touched") && told.contains("closer than 10.") && told.contains("unit"),
        "{told}"
    );
}

#[test]
fn a_contact_that_ends_at_the_border_did_not_begin_inside() {
    let directory = TestDirectory::with_body();
    let path =
        "time_s,x_m,y_m,z_m\n0,0.001,0.032,0.04\n1,0.001,0.026,0.04\n2,0.001,0.026,0.07\n3,0.001,0.026,0\n";
    directory.write("over.csv", path);
    let told = directory.done("trace c.body --path over.csv --rate-hz 1000 -o t.csv").stderr;
    assert!(told.contains("1 contact ended at the surface's border"), "{told}");
    assert!(!told.contains("began inside"), "{told}");
}

#[test]
fn fit_tells_of_folds_and_refuses_what_cannot_be() {
    let directory = TestDirectory::new();
    mesh_and_samples(&directory);
    let fit = "fit --mesh sphere.obj --unit mm --samples samples.csv --friction 0.3 -o s.body";
    assert!(!directory.done(fit).stderr.contains("folded"));
    // One vertex pushed past its neighbours along the surface.
    let obj = fs::read_to_string(directory.path("sphere.obj")).unwrap();
    let mut positions: Vec<[f64; 3]> = Vec::new();
    for line in obj.lines().filter_map(|l| l.strip_prefix("v ")) {
        let v: Vec<f64> = line.split(' ').map(|x| x.parse().unwrap()).collect();
        positions.push([v[0], v[1], v[2]]);
    }
    let start = positions.iter().position(|p| p[0] > 15.0).unwrap();
    let [x, y, z] = positions[start];
    let aside = [x * 0.9, y + 6.0, z + 1.0];
    let length = aside.iter().map(|c| c * c).sum::<f64>().sqrt();
    positions[start] = aside.map(|c| 20.0 * c / length);
    let vertices = positions.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let faces = obj.lines().filter(|l| l.starts_with("f ")).map(|l| format!("{l}\n"));
    directory.write("sphere.obj", vertices.chain(faces).collect::<String>());
    let told = directory.done(fit).stderr;
    assert!(told.contains("folded back, first triangle ") && told.contains("mesh editor"), "{told}");

    let samples = fs::read_to_string(directory.path("samples.csv")).unwrap();
    directory.write("bad.csv", format!("{samples}north,0,0,0.0201,friction,0.001,101\n"));
    let bad = fit.replace("samples.csv", "bad.csv");
    directory.refused(&bad, &["bad.csv: line 14", "101", "between 0 and 100"]);
    directory.write("bad.csv", samples.replace("0,0,0.0201,", "0,0,34.6,"));
    directory.refused(
        &bad,
        &["bad.csv: line 2 (point `north`)", "34.580 m from the mesh", "the unit and the frame"],
    );
    directory.write("bad.csv", samples.replace(',', ";"));
    directory.refused(&bad, &["bad.csv", "not semicolons"]);
    directory.write("bad.csv", [samples.as_bytes(), b"\xff\n"].concat());
    directory.refused(&bad, &["bad.csv: line 14", "UTF-8"]);
    directory
        .refused("fit --mesh tissue.msh --unit mm --samples samples.csv -o s.body", &["tissue.msh", "Gmsh"]);
}
