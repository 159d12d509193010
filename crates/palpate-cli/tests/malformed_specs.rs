//! Specs that can't be simulated: each ends with status 1 and one message that names file, place and hint.

use palpate_build::precompute::prepare;
use palpate_build::spec::Spec;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

/// Sound; each case changes it in one place.
const SPEC: &str = r#"[body]
mesh = "ball.obj"
unit = "mm"

[[body.fixed]]
half_space = { point_mm = [0, 0, -8], normal = [0, 0, -1] }

[material]
model = "neo-hookean"
young_modulus_pa = 10e3
poisson_ratio = 0.45

[[material.region]]
sphere = { centre_mm = [0, 0, 0], radius_mm = 8 }
model = "ogden"
terms = [[3e3, 4], [1e3, -2]]
bulk_modulus_pa = 1e5

[tool]
shape = "sphere"
radius_mm = 3
contact = "frictionless"

[friction]
coefficient = 0.3

[deflection]
normal_max_mm = 2
lateral_max_mm = 1
steps = 4
lateral_depths_mm = [1, 2]
directions = 4

[test_points]
count = 5

[mesh]
element_size_mm = 3
interior_size_mm = 4

[slip]
rule = "paper"
"#;

/// What is replaced by what; the words that the complaint must have, the first of them its place.
const CASES: &[(&str, &str, &[&str])] = &[
    // TOML.
    ("[body]\n", "[body\n", &["spec.toml:1:"]),
    ("[tool]\n", "[tool]\n[tool]\n", &["spec.toml:"]),
    ("radius_mm = 3", "radius_mm = ", &["spec.toml:21:"]),
    ("radius_mm = 3", "radius_mm = 3\nradius_mm = 4", &["spec.toml:22:"]),
    ("unit = \"mm\"", "unit = mm", &["spec.toml:3:"]),
    // Unknown tables and keys.
    ("[slip]", "[slide]", &["spec.toml:", "slide"]),
    ("[friction]", "[frictoin]", &["spec.toml:", "frictoin"]),
    ("unit = \"mm\"", "units = \"mm\"", &["spec.toml:3:", "units"]),
    ("[[body.fixed]]", "[[body.fix]]", &["spec.toml:", "fix"]),
    ("point_mm", "point", &["spec.toml:6:", "point"]),
    ("point_mm = [0, 0, -8], ", "", &["spec.toml:6:", "point_mm"]),
    (", normal = [0, 0, -1]", "", &["spec.toml:6:", "normal"]),
    ("young_modulus_pa", "young_modulus", &["spec.toml:10:", "young_modulus"]),
    ("young_modulus_pa = 10e3", "young_modulus_kpa = 10", &["spec.toml:10:", "young_modulus_kpa"]),
    ("radius_mm = 8", "radius = 8", &["spec.toml:14:", "radius"]),
    ("centre_mm", "center_mm", &["spec.toml:14:", "center_mm"]),
    ("radius_mm = 3", "radius = 3", &["spec.toml:21:", "radius"]),
    ("radius_mm = 3", "radius_m = 0.003", &["spec.toml:21:", "radius_m"]),
    ("normal_max_mm = 2", "normal_max = 2", &["spec.toml:", "normal_max"]),
    ("count = 5", "number = 5", &["spec.toml:", "number"]),
    ("element_size_mm = 3", "element_size = 2", &["spec.toml:", "element_size"]),
    ("coefficient = 0.3", "mu = 0.3", &["spec.toml:", "mu"]),
    // What is missing.
    ("mesh = \"ball.obj\"\nunit = \"mm\"\n", "", &["spec.toml", "mesh", "add"]),
    ("unit = \"mm\"\n", "", &["spec.toml:2:", "unit", "add"]),
    (
        "[[body.fixed]]\nhalf_space = { point_mm = [0, 0, -8], normal = [0, 0, -1] }\n",
        "",
        &["spec.toml", "[[body.fixed]]", "half_space"],
    ),
    (
        "half_space = { point_mm = [0, 0, -8], normal = [0, 0, -1] }\n",
        "",
        &["spec.toml:5:", "[[body.fixed]]", "add"],
    ),
    ("model = \"neo-hookean\"\n", "", &["spec.toml:8:", "model", "add"]),
    ("model = \"ogden\"\n", "", &["spec.toml:13:", "model", "add"]),
    ("young_modulus_pa = 10e3\n", "", &["spec.toml:9:", "young_modulus_pa", "add"]),
    ("poisson_ratio = 0.45\n", "", &["spec.toml:9:", "poisson_ratio", "add"]),
    ("terms = [[3e3, 4], [1e3, -2]]\n", "", &["spec.toml:15:", "terms", "add"]),
    ("bulk_modulus_pa = 1e5\n", "", &["spec.toml:15:", "bulk_modulus_pa", "add"]),
    ("sphere = { centre_mm = [0, 0, 0], radius_mm = 8 }\n", "", &["spec.toml:13:", "where", "add"]),
    ("centre_mm = [0, 0, 0], ", "", &["spec.toml:14:", "centre_mm"]),
    ("shape = \"sphere\"\n", "", &["spec.toml:19:", "shape"]),
    ("radius_mm = 3\n", "", &["spec.toml:19:", "radius_mm", "add"]),
    ("normal_max_mm = 2\n", "", &["spec.toml:", "normal_max_mm", "add"]),
    ("lateral_max_mm = 1\n", "", &["spec.toml:", "lateral_max_mm", "add"]),
    ("count = 5", "", &["spec.toml:", "[test_points]", "add"]),
    ("coefficient = 0.3", "", &["spec.toml:", "[friction]", "give"]),
    ("rule = \"paper\"", "tank = \"yes\"", &["spec.toml:42:", "boolean"]),
    ("rule = \"paper\"", "partial = 2", &["spec.toml:42:", "boolean"]),
    // Kinds of values.
    ("unit = \"mm\"", "unit = \"inch\"", &["spec.toml:3:", "inch"]),
    ("unit = \"mm\"", "unit = 1e-3", &["spec.toml:3:"]),
    ("\"ball.obj\"", "7", &["spec.toml:2:"]),
    ("[0, 0, -8]", "[0, 0]", &["spec.toml:6:"]),
    ("[0, 0, -8]", "-8", &["spec.toml:6:"]),
    ("10e3", "\"10 kPa\"", &["spec.toml:10:"]),
    ("[[3e3, 4], [1e3, -2]]", "[3e3, 4]", &["spec.toml:16:"]),
    ("[[3e3, 4], [1e3, -2]]", "[[3e3], [4]]", &["spec.toml:16:"]),
    ("[[3e3, 4], [1e3, -2]]", "[[3e3, 4, 5]]", &["spec.toml:16:"]),
    ("radius_mm = 3", "radius_mm = \"3 mm\"", &["spec.toml:21:"]),
    ("count = 5", "count = 5.5", &["spec.toml:"]),
    ("count = 5", "count = \"many\"", &["spec.toml:"]),
    ("steps = 4", "steps = 4.5", &["spec.toml:"]),
    ("lateral_depths_mm = [1, 2]", "lateral_depths_mm = 1", &["spec.toml:"]),
    // Impossible values.
    ("normal = [0, 0, -1]", "normal = [0, 0, 0]", &["spec.toml:6:", "direction", "give"]),
    ("normal = [0, 0, -1]", "normal = [0, nan, 1]", &["spec.toml:6:", "normal", "finite"]),
    ("[0, 0, -8]", "[0, 0, inf]", &["spec.toml:6:", "point_mm", "finite"]),
    ("[0, 0, -8]", "[0, 0, 1e9]", &["spec.toml:6:", "point_mm"]),
    ("10e3", "0", &["spec.toml:10:", "young_modulus_pa is 0", "between"]),
    ("10e3", "-10e3", &["spec.toml:10:", "young_modulus_pa is -10000"]),
    ("10e3", "nan", &["spec.toml:10:", "NaN"]),
    ("10e3", "inf", &["spec.toml:10:", "inf"]),
    ("0.45", "0.5", &["spec.toml:11:", "poisson_ratio is 0.5", "volume", "give 0.4999"]),
    ("0.45", "0.7", &["spec.toml:11:", "poisson_ratio is 0.7", "between"]),
    ("0.45", "-1.5", &["spec.toml:11:", "poisson_ratio is -1.5"]),
    (
        "poisson_ratio = 0.45",
        "poisson_ratio = 0.45\nbulk_modulus_pa = 1e5",
        &["spec.toml:12:", "say the same", "keep one"],
    ),
    ("poisson_ratio = 0.45", "bulk_modulus_pa = 10", &["spec.toml:11:", "bulk modulus", "Poisson ratio"]),
    ("poisson_ratio = 0.45", "bulk_modulus_pa = -5", &["spec.toml:11:", "bulk_modulus_pa is -5"]),
    (
        "poisson_ratio = 0.45",
        "poisson_ratio = 0.45\nform = \"round\"",
        &["spec.toml:12:", "form `round`", "isochoric"],
    ),
    ("\"neo-hookean\"", "\"neo-hook\"", &["spec.toml:9:", "no model `neo-hook`", "mooney-rivlin"]),
    ("\"neo-hookean\"", "\"yeoh\"", &["spec.toml:10:", "yeoh has no young_modulus_pa", "c_pa"]),
    (
        "young_modulus_pa = 10e3",
        "young_modulus_pa = 10e3\nc10_pa = 1",
        &["spec.toml:11:", "no c10_pa", "remove"],
    ),
    (
        "\"neo-hookean\"\nyoung_modulus_pa = 10e3",
        "\"mooney-rivlin\"\nc10_pa = 1e3",
        &["spec.toml:9:", "c01_pa", "add"],
    ),
    (
        "\"neo-hookean\"\nyoung_modulus_pa = 10e3",
        "\"mooney-rivlin\"\nc10_pa = 1e3\nc01_pa = -2e3",
        &["spec.toml:9:", "shear modulus", "positive"],
    ),
    ("\"neo-hookean\"\nyoung_modulus_pa = 10e3", "\"yeoh\"\nc_pa = []", &["spec.toml:10:", "c_pa", "give"]),
    (
        "\"neo-hookean\"\nyoung_modulus_pa = 10e3",
        "\"yeoh\"\nc_pa = [-1e3, 1e3]",
        &["spec.toml:9:", "shear modulus"],
    ),
    ("\"neo-hookean\"\nyoung_modulus_pa = 10e3", "\"yeoh\"\nc_pa = [1e3, nan]", &["spec.toml:10:", "finite"]),
    (
        "\"neo-hookean\"\nyoung_modulus_pa = 10e3",
        "\"fung-demiray\"\nmu_pa = 1e3\nb = -1",
        &["spec.toml:11:", "b is -1"],
    ),
    (
        "\"neo-hookean\"\nyoung_modulus_pa = 10e3",
        "\"veronda-westmann\"\nc1_pa = 0\nc3 = 1",
        &["spec.toml:10:", "c1_pa is 0"],
    ),
    ("[[3e3, 4], [1e3, -2]]", "[]", &["spec.toml:16:", "0 rows", "give"]),
    ("[[3e3, 4], [1e3, -2]]", "[[3e3, 0]]", &["spec.toml:16:", "alpha"]),
    ("[[3e3, 4], [1e3, -2]]", "[[-3e3, 4]]", &["spec.toml:", "shear modulus -3000 Pa", "give"]),
    ("radius_mm = 8", "radius_mm = -8", &["spec.toml:14:", "radius_mm is -8"]),
    ("radius_mm = 8", "radius_mm = nan", &["spec.toml:14:", "radius_mm"]),
    ("sphere = {", "box_mm = [[0, 0, 0], [1, 1, 1]]\nsphere = {", &["spec.toml:13:", "2 times", "keep one"]),
    (
        "sphere = { centre_mm = [0, 0, 0], radius_mm = 8 }",
        "box_mm = [[0, 0, 1], [1, 1, 0]]",
        &["spec.toml:14:", "box_mm", "least"],
    ),
    (
        "sphere = { centre_mm = [0, 0, 0], radius_mm = 8 }",
        "ellipsoid = { centre_mm = [0, 0, 0], radii_mm = [1, 0, 1] }",
        &["spec.toml:14:", "radii_mm"],
    ),
    ("sphere = { centre_mm = [0, 0, 0], radius_mm = 8 }", "group = \" \"", &["spec.toml:14:", "group"]),
    (
        "[material]\n",
        "[material]\nsphere = { centre_mm = [0, 0, 0], radius_mm = 8 }\n",
        &["spec.toml:9:", "[material] has sphere", "move it"],
    ),
    ("half_space = {", "group = \"base\"\nhalf_space = {", &["spec.toml:5:", "2 times", "keep one"]),
    ("[[body.fixed]]\n", "[[body.fixed]]\naxes = [\"w\"]\n", &["spec.toml:6:", "`w`", "\"x\""]),
    ("[[body.fixed]]\n", "[[body.fixed]]\naxes = []\n", &["spec.toml:6:", "axes is empty"]),
    ("[[body.fixed]]\n", "[[body.fixed]]\naxes = [\"x\", \"x\"]\n", &["spec.toml:6:", "once"]),
    ("shape = \"sphere\"\nradius_mm = 3", "shape = \"needle\"", &["spec.toml:20:", "`needle`", "flat-punch"]),
    ("shape = \"sphere\"\nradius_mm = 3", "shape = \"point\"", &["spec.toml:20:", "point", "bonded"]),
    ("shape = \"sphere\"", "shape = \"capsule\"", &["spec.toml:19:", "length_mm", "add"]),
    (
        "shape = \"sphere\"\nradius_mm = 3",
        "shape = \"cone\"\nhalf_angle_deg = 90\ntip_radius_mm = 1",
        &["spec.toml:21:", "half_angle_deg is 90"],
    ),
    ("shape = \"sphere\"", "shape = \"cone\"", &["spec.toml:", "cone"]),
    (
        "shape = \"sphere\"\nradius_mm = 3",
        "shape = \"mesh\"\nfile = \"tool.stl\"",
        &["spec.toml:19:", "unit", "add"],
    ),
    (
        "shape = \"sphere\"\nradius_mm = 3",
        "shape = \"mesh\"\nfile = \"tool.stl\"\nunit = \"mm\"",
        &["tool.stl", "can't be read", "check"],
    ),
    ("radius_mm = 3", "radius_mm = 0", &["spec.toml:21:", "radius_mm is 0"]),
    ("radius_mm = 3", "radius_mm = 3\nlength_mm = 4", &["spec.toml:22:", "no length_mm", "remove"]),
    (
        "\"frictionless\"",
        "\"sticky\"",
        &["spec.toml:22:", "`sticky`", "\"sticking\", \"frictionless\" or \"bonded\""],
    ),
    ("\"frictionless\"", "\"bonded\"", &["spec.toml:22:", "radius is missing", "patch_radius_mm"]),
    ("\"frictionless\"", "\"frictionless\"\npatch_radius_mm = 3", &["spec.toml:23:", "patch", "remove"]),
    ("\"frictionless\"", "\"sticking\"\npatch_radius_mm = 3", &["spec.toml:23:", "sticking", "remove"]),
    ("\"frictionless\"", "\"bonded\"\npatch_radius_mm = -3", &["spec.toml:23:", "patch_radius_mm is -3"]),
    ("coefficient = 0.3", "coefficient = -0.3", &["spec.toml:", "-0.3", "between"]),
    ("normal_max_mm = 2", "normal_max_mm = 0", &["spec.toml:", "normal_max_mm is 0"]),
    ("normal_max_mm = 2", "normal_max_mm = -2", &["spec.toml:", "normal_max_mm is -2"]),
    ("lateral_max_mm = 1", "lateral_max_mm = 1e9", &["spec.toml:", "lateral_max_mm"]),
    ("steps = 4", "steps = 0", &["spec.toml:", "steps is 0"]),
    ("steps = 4", "steps = 100000", &["spec.toml:", "steps is 100000"]),
    ("[1, 2]", "[2, 1]", &["spec.toml:", "lateral_depths_mm", "ascending"]),
    ("[1, 2]", "[1, 3]", &["spec.toml:", "lateral_depths_mm", "at most"]),
    ("[1, 2]", "[]", &["spec.toml:", "lateral_depths_mm", "give"]),
    ("[1, 2]", "[0, 1]", &["spec.toml:", "lateral_depths_mm", "above 0"]),
    ("directions = 4", "directions = 3", &["spec.toml:", "directions is 3", "between 4"]),
    ("count = 5", "count = 0", &["spec.toml:", "count is 0"]),
    ("count = 5", "count = -5", &["spec.toml:", "count is -5"]),
    ("count = 5", "count = 5\nspacing_mm = 3", &["spec.toml:", "2 times", "keep one"]),
    ("count = 5", "spacing_mm = -1", &["spec.toml:", "spacing_mm is -1"]),
    ("count = 5", "count = 5\ntolerance_percent = 5", &["spec.toml:36:", "tolerance_percent", "sticking"]),
    ("count = 5", "every_node = true\ncount = 5", &["spec.toml:", "2 times", "keep one"]),
    ("count = 5", "every_node = \"yes\"", &["spec.toml:35:"]),
    ("count = 5", "count = 5\ndrags = 0", &["spec.toml:36:", "drags is 0"]),
    ("[slip]", "[fit]\nlaw = \"linear\"\n[slip]", &["spec.toml:42:", "no law `linear`", "decoupled"]),
    ("[slip]", "[fit]\nlaws = \"coupled\"\n[slip]", &["spec.toml:42:", "laws"]),
    ("count = 5", "at_mm = []", &["spec.toml:", "at_mm has 0", "give"]),
    ("count = 5", "at_mm = [[0, 0, nan]]", &["spec.toml:", "at_mm", "finite"]),
    ("count = 5", "at_mm = [[0, 0, 500]]", &["spec.toml", "point 0", "far from the surface", "move"]),
    ("count = 5", "at_mm = [[0, 0, -10]]", &["spec.toml", "point 0", "fixed there", "move"]),
    ("count = 5", "at_mm = [[0, 0, 10], [0, 0, 10.01]]", &["spec.toml", "point 1", "point 0", "remove"]),
    ("count = 5", "box_mm = [[0, 0, 0], [0, 5, 5]]", &["spec.toml:35:", "box_mm", "second corner"]),
    ("count = 5", "box_mm = [[40, 40, 40], [50, 50, 50]]", &["spec.toml", "[test_points] box_mm", "move or"]),
    ("element_size_mm = 3", "element_size_mm = 0", &["spec.toml:", "element_size_mm is 0"]),
    ("interior_size_mm = 4", "interior_size_mm = 1", &["spec.toml:", "interior_size_mm", "as long"]),
    ("element_size_mm = 3", "element_size_mm = 0.01", &["spec.toml", "element_size_mm 0.01", "larger"]),
    ("rule = \"paper\"", "rule = \"smooth\"", &["spec.toml:", "smooth", "paper"]),
    // What a simulation can't have.
    ("unit = \"mm\"", "unit = \"mm\"\nopen = true", &["spec.toml:4:", "open", "close"]),
    (
        "[slip]",
        "[response]\nlaw = \"uniform\"\nstiffness_n_per_m = 1\nlateral_stiffness_n_per_m = 1\n[slip]",
        &["spec.toml:", "[response]", "remove"],
    ),
    (
        "unit = \"mm\"",
        "unit = \"mm\"\nshape = { kind = \"sphere\", radius_mm = 10 }",
        &["spec.toml:4:", "mesh and a shape", "keep one"],
    ),
    (
        "mesh = \"ball.obj\"\nunit = \"mm\"",
        "shape = { kind = \"sphere\", radius_mm = -1 }",
        &["spec.toml:2:", "radius_mm"],
    ),
    (
        "mesh = \"ball.obj\"\nunit = \"mm\"",
        "shape = { kind = \"pear\", radius_mm = 1 }",
        &["spec.toml:2:", "pear"],
    ),
    // What the mesh does not have.
    ("ball.obj", "pall.obj", &["pall.obj", "can't be read", "check"]),
    ("ball.obj", "spec.toml", &["spec.toml"]),
    (
        "[0, 0, -8], normal = [0, 0, -1]",
        "[0, 0, -80], normal = [0, 0, -1]",
        &["spec.toml:5:", "no node", "move"],
    ),
    (
        "half_space = { point_mm = [0, 0, -8], normal = [0, 0, -1] }",
        "group = \"base\"",
        &["spec.toml:5:", "no group `base`", "half_space"],
    ),
    (
        "half_space = { point_mm = [0, 0, -8], normal = [0, 0, -1] }",
        "box_mm = [[90, 0, 0], [99, 1, 1]]",
        &["spec.toml:5:", "no node", "move"],
    ),
    (
        "half_space = { point_mm = [0, 0, -8], normal = [0, 0, -1] }",
        "nodes = \"none.csv\"",
        &["none.csv", "can't be read", "check"],
    ),
    (
        "half_space = { point_mm = [0, 0, -8], normal = [0, 0, -1] }",
        "nodes = \"nodes.csv\"",
        &["nodes.csv:2:", "no node", "give"],
    ),
    (
        "half_space = { point_mm = [0, 0, -8], normal = [0, 0, -1] }",
        "nodes = \"empty.csv\"",
        &["empty.csv", "give"],
    ),
    (
        "[0, 0, -8], normal = [0, 0, -1]",
        "[0, 0, -80], normal = [0, 0, 1]",
        &["spec.toml", "supports", "free"],
    ),
    (
        "centre_mm = [0, 0, 0], radius_mm = 8",
        "centre_mm = [50, 0, 0], radius_mm = 8",
        &["spec.toml:13:", "no element", "move"],
    ),
    (
        "sphere = { centre_mm = [0, 0, 0], radius_mm = 8 }",
        "group = \"tumour\"",
        &["spec.toml:13:", "no group `tumour`"],
    ),
];

fn ball() -> String {
    use palpate_body::shape::{Resolution, Shape};
    let resolution = Resolution { edge_length_mm: Some(3.0), ..Resolution::default() };
    let mesh = Shape::Sphere { radius_mm: 10.0 }.mesh(resolution).unwrap();
    let mut obj = String::new();
    for p in &mesh.positions {
        obj += &format!("v {} {} {}\n", p.x * 1e3, p.y * 1e3, p.z * 1e3);
    }
    for t in &mesh.triangles {
        obj += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
    }
    obj
}

fn run(folder: &Path, spec: &[u8]) -> (Option<i32>, String) {
    fs::write(folder.join("spec.toml"), spec).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["precompute", "spec.toml", "-o", "ball.body"])
        .current_dir(folder)
        .output()
        .unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout), "");
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

/// Whether everything would be ready for the first solve.
fn sound(folder: &Path, text: &str) -> bool {
    let path = folder.join("spec.toml");
    let ready = || {
        let spec = Spec::parse(&path, text.into())?;
        let simulation = spec.simulation(&path)?;
        prepare::plan(&spec, &simulation, &path)?;
        prepare::prepare(&spec, &simulation, &path, &AtomicBool::new(false))
    };
    ready().is_ok()
}

#[test]
fn each_is_refused_with_place_and_hint() {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(directory.path().join(name), text).unwrap();
    write("ball.obj", &ball());
    write("nodes.csv", "x_m,y_m,z_m\n0,0,1\n");
    write("empty.csv", "");
    let files = || {
        let mut names: Vec<_> =
            fs::read_dir(directory.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let (code, stderr) = run(
        directory.path(),
        SPEC.replace("count = 5", "count = 1").replace("steps = 4", "steps = 1").as_bytes(),
    );
    assert_eq!(code, Some(0), "{stderr}");
    for name in ["ball.body", "ball.body.paths"] {
        fs::remove_file(directory.path().join(name)).unwrap();
    }
    let before = files();

    let mut wrong = Vec::new();
    for (i, (old, new, words)) in CASES.iter().enumerate() {
        assert!(SPEC.contains(old), "case {i}: `{old}` is not in the spec");
        let spec = SPEC.replacen(old, new, 1);
        if sound(directory.path(), &spec) {
            // It would be simulated, at length.
            wrong.push(format!("case {i}, `{old}` → `{new}`: it is not refused"));
            continue;
        }
        let (code, stderr) = run(directory.path(), spec.as_bytes());
        let lines: Vec<&str> = stderr.lines().collect();
        let told = words.iter().all(|w| stderr.contains(w));
        // Place; problem; hint.
        if code != Some(1)
            || lines.len() != 1
            || !told
            || !stderr.contains("; ")
            || stderr.contains("panicked")
        {
            wrong.push(format!("case {i}, `{old}` → `{new}`: {code:?}, wanted {words:?}\n    {stderr}"));
        }
        assert_eq!(files(), before, "case {i}: something was left behind");
    }
    assert!(wrong.is_empty(), "{} of {} cases:\n{}", wrong.len(), CASES.len(), wrong.join("\n"));
    assert!(CASES.len() >= 110, "{}", CASES.len());
}

/// Cut off anywhere, or with bytes replaced at random, a spec ends in a message or runs.
#[test]
fn noise_ends_in_a_message() {
    let mut random = 88_172_645_463_325_252_u64;
    let mut next = |below: usize| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        (random % below as u64) as usize
    };
    for _ in 0..20_000 {
        let mut text = SPEC.as_bytes().to_vec();
        for _ in 0..=next(3) {
            if text.is_empty() {
                break;
            }
            let at = next(text.len());
            match next(4) {
                0 => text.truncate(at.max(1)),
                1 => text[at] = b"0123456789.-e[]{}\"=#\n,"[next(22)],
                2 => {
                    let from = next(SPEC.len() - 40);
                    text.splice(at..at, SPEC.as_bytes()[from..from + 40].to_vec());
                }
                _ => {
                    text.remove(at);
                }
            }
        }
        let Ok(text) = String::from_utf8(text) else { continue };
        let path = Path::new("spec.toml");
        let read =
            palpate_build::spec::Spec::parse(path, text.clone()).and_then(|spec| spec.simulation(path));
        if let Err(e) = read {
            let e = e.to_string();
            assert!(e.starts_with("spec.toml") && e.contains("; "), "{e}\n{text}");
        }
    }
}
