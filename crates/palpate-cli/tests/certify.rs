//! `palpate certify` from outside, and its promises: witnesses reproduce, a raised body is passive.

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{BlendWeights, Body, BodyParts, Provenance, Response, SlipRule, Tool};
use palpate_certify::device::Device;
use palpate_certify::{Question, certificate, certify, elements, floor};
use palpate_engine::certify::Assumptions;
use palpate_engine::{Ablation, Contact, Flags, ToolState};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::AtomicBool;

fn palpate(folder: &Path, args: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(args.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap()
}

/// A body by a law, in a folder.
fn fitted(shape: &str, friction: f64) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let spec = format!(
        "[body.shape]\n{shape}\n[friction]\ncoefficient = {friction:?}\n[deflection]\nnormal_max_mm = 8\nlateral_max_mm = 4\n\
         steps = 4\n[slip]\nrule = \"paper\"\n[response]\nlaw = \"paper-cylinder\"\nstiffness_n_per_m = 600\n\
         lateral_stiffness_n_per_m = 500\naround = 0.0\nalong = 0.0\n"
    );
    std::fs::write(folder.path().join("spec.toml"), spec).unwrap();
    let fit = palpate(folder.path(), "fit --spec spec.toml -o a.body");
    assert!(fit.status.success(), "{}", String::from_utf8_lossy(&fit.stderr));
    let path = folder.path().to_path_buf();
    (folder, path)
}

/// The document, and the exit status.
fn certified(folder: &Path, options: &str) -> (Value, i32) {
    let out = palpate(folder, &format!("certify a.body --json {options}"));
    let text = String::from_utf8_lossy(&out.stdout);
    let json = serde_json::from_str(&text)
        .unwrap_or_else(|e| panic!("{e}: {text} {}", String::from_utf8_lossy(&out.stderr)));
    (json, out.status.code().unwrap())
}

const BALL: &str = "kind = \"sphere\"\nradius_mm = 30\nedge_length_mm = 8";
const CUBE: &str = "kind = \"block\"\nsize_mm = [40, 40, 40]\nedge_length_mm = 10";

#[test]
fn a_ball_with_friction_holds_and_says_what_a_device_may_do() {
    let (_kept, folder) = fitted(BALL, 0.4);
    let options = "--evaluations 1500 --vtu m.vtu --damping-n-s-per-m 0.3 --rate-hz 1000";
    let (json, code) = certified(&folder, options);
    assert_eq!(code, 0, "{json}");
    assert!(json["passive"]["holds"] == true && json["snap_free"]["holds"] == true, "{json}");
    assert!(json["passive"]["margin"].as_f64().unwrap() > 0.0);
    assert!(json["passive"]["found"].as_f64() >= json["passive"]["margin"].as_f64());
    assert!(json["lipschitz_n_per_m"].as_f64() >= json["lipschitz_found_n_per_m"].as_f64());
    // 2 b/T = 600 N/m = 200 k δz: 5 mm deep, where every place gives 100 k δz² = 1.5 N.
    let device = &json["device"];
    assert!((device["depth_limit_m"].as_f64().unwrap() - 5e-3).abs() < 1e-9, "{device}");
    assert!((device["force_limit_n"].as_f64().unwrap() - 1.5).abs() < 1e-9, "{device}");
    assert_eq!(json["stiffness_max_n_per_m"].as_array().unwrap().len(), 5);
    // What programs have by the crate.
    let body = Body::open(&folder.join("a.body")).unwrap();
    let mut question = Question::of(&body);
    question.evaluations = Some(1500);
    question.device = Some(Device {
        damping_n_s_per_m: 0.3,
        rate_hz: 1000.0,
        position_error_m: 0.0,
        coulomb_n: 0.0,
        delay_samples: 0.0,
    });
    let found = certify(&body, &question, &|| (), &AtomicBool::new(false)).unwrap().unwrap();
    assert_eq!(serde_json::to_value(&found.certificate).unwrap(), json);
    let vtu = std::fs::read(folder.join("m.vtu")).unwrap();
    let head = String::from_utf8_lossy(&vtu[..vtu.len().min(4000)]).into_owned();
    assert!(head.contains("<CellData>") && head.contains("passive_margin"), "{head}");
}

#[test]
fn the_default_rule_is_certified_too() {
    let (_kept, folder) = fitted(BALL, 0.4);
    let (json, _) = certified(&folder, "--slip consistent --evaluations 200");
    assert_eq!(json["slip"], "consistent");
    let of = |name: &str, key: &str| json[name][key].as_u64().unwrap();
    assert!(of("passive", "proved_elements") > 100 && of("passive", "failing_elements") == 0, "{json}");
    assert!(of("snap_free", "failing_elements") == 0, "{json}");
    // A device with a delay needs L: without it nothing is known of it, and null is not 0.
    let (json, _) =
        certified(&folder, "--slip exact --evaluations 50 --damping-n-s-per-m 0.3 --delay-samples 1");
    assert!(json["passive"]["holds"] == true && json["lipschitz_n_per_m"].is_null(), "{json}");
    assert!(json["device"]["stiffness_limit_n_per_m"].is_null(), "{json}");
}

#[test]
fn a_witness_of_energy_reproduces_when_traced() {
    let (_kept, folder) = fitted(BALL, 0.02);
    let (json, code) = certified(&folder, "--evaluations 600 --witness w");
    assert_eq!(code, 3);
    assert!(json["passive"]["holds"] == false && json["passive"]["margin"].as_f64().unwrap() < 0.0);
    let claimed = json["passive"]["witness"]["generated_j"].as_f64().unwrap();
    assert!(claimed > 1e-9, "{json}");
    let trace = palpate(&folder, "trace a.body --no-tank --path w/passive.csv -o t.csv --json");
    let traced: Value = serde_json::from_slice(&trace.stdout).unwrap();
    let generated = traced["energy"]["generated_j"].as_f64().unwrap();
    assert!((generated - claimed).abs() < 1e-12 * claimed, "{generated} {claimed}");
    assert_eq!(traced["extrapolated_steps"], 0);
}

/// Traced with the tank the witness of energy gives out nothing, and the trace says that slip waited; --no-tank lets it, and so
/// does a body that was made without a tank.
#[test]
fn the_tank_holds_back_what_a_witness_shows() {
    let (_kept, folder) = fitted(BALL, 0.02);
    certified(&folder, "--evaluations 600 --witness w");
    let trace = |args: &str| {
        let out = palpate(&folder, &format!("trace {args} --path w/passive.csv -o t.csv --json"));
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        let json: Value = serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{e}: {said}"));
        let number = |key: &str| json.pointer(key).and_then(Value::as_f64).unwrap();
        (number("/energy/generated_j"), number("/counters/held_back"), said.contains("had slip held back"))
    };
    let (generated, held_back, said) = trace("a.body");
    let (free, free_held_back, free_said) = trace("a.body --no-tank");
    assert!(held_back > 0.0 && said, "{held_back} {said}");
    assert!(
        free_held_back == 0.0 && !free_said && free > 1e-9 && generated < 0.5 * free,
        "{generated} {free}"
    );

    let spec = std::fs::read_to_string(folder.join("spec.toml")).unwrap();
    std::fs::write(folder.join("free.toml"), spec.replace("[slip]", "[slip]\ntank = false")).unwrap();
    assert!(palpate(&folder, "fit --spec free.toml -o free.body").status.success());
    let inspect = palpate(&folder, "inspect free.body --json");
    let inspect: Value = serde_json::from_slice(&inspect.stdout).unwrap();
    assert_eq!(inspect["tank"], false);
    assert_eq!(trace("free.body"), (free, 0.0, false));
}

/// A simulated loop on a ball without friction, which the paper's rule slips over from soft to stiff.
#[test]
fn a_run_without_the_tank_lets_slip_give_out_energy() {
    let (_kept, folder) = fitted(BALL, 0.0);
    let spec = std::fs::read_to_string(folder.join("spec.toml")).unwrap();
    let graded = spec.replace("around = 0.0", "around = 0.9").replace("along = 0.0", "along = 0.9");
    std::fs::write(folder.join("graded.toml"), graded).unwrap();
    assert!(palpate(&folder, "fit --spec graded.toml -o graded.body").status.success());
    let run = |args: &str| -> Value {
        let out = palpate(
            &folder,
            &format!(
                "run graded.body --device simulated --virtual-time --intent circle --json {args} --record r.csv"
            ),
        );
        serde_json::from_slice(&out.stdout)
            .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&out.stderr)))
    };
    let table = || std::fs::read_to_string(folder.join("r.csv")).unwrap();
    let generated = |run: &Value| run.pointer("/energy/generated_j").and_then(Value::as_f64).unwrap();
    let (with, with_table) = (run(""), table());
    let (without, without_table) = (run("--no-tank"), table());
    assert!(generated(&without) > generated(&with), "{with} {without}");
    assert!(with_table != without_table);
}

#[test]
fn a_cube_snaps_and_the_witness_jumps() {
    let (_kept, folder) = fitted(CUBE, 0.3);
    let (json, code) = certified(&folder, "--evaluations 400 --witness w");
    assert_eq!(code, 3);
    assert!(json["snap_free"]["holds"] == false && json["lipschitz_n_per_m"].is_null());
    let claimed = json["snap_free"]["witness"]["largest_step_n"].as_f64().unwrap();
    assert!(claimed > 0.1, "{json}");
    let trace = palpate(&folder, "trace a.body --no-tank --path w/snap-free.csv -o t.csv --json");
    let traced: Value = serde_json::from_slice(&trace.stdout).unwrap();
    assert!(traced["snap_steps"].as_u64().unwrap() > 0, "{traced}");
    assert!(traced["largest_step_n"].as_f64().unwrap() > 0.99 * claimed, "{traced}");
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let (_kept, folder) = fitted(BALL, 0.3);
    for (options, code, words) in [
        ("--step-mm 0", 1, "--step-mm 0: give a number above 0"),
        ("--raise-friction", 2, "--output"),
        ("--coulomb-n 1", 2, "--damping-n-s-per-m"),
        ("--vtu a.body", 1, "a.body"),
    ] {
        let out = palpate(&folder, &format!("certify a.body {options}"));
        let complaint = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{options}: {complaint}");
        assert!(complaint.contains(words), "{options}: {complaint}");
    }
}

/// A body of the paper's law whose stiffness varies.
fn body(shape: Shape, edge_length_mm: f64, friction: f64) -> Body {
    let edge = Resolution { edge_length_mm: Some(edge_length_mm), ..Resolution::default() };
    let surface = shape.surface(edge).unwrap();
    let respond = |p: &DVec3| {
        let k = 1.0 + 0.2 * p.x / 0.03;
        Response::paper(600.0 * k, 500.0 * k, friction, 6e-3, 6e-3).unwrap()
    };
    let count = surface.positions().len() as u32;
    Body::new(BodyParts {
        blends: (0..count).map(BlendWeights::own).collect(),
        responses: surface.positions().iter().map(respond).collect(),
        test_point_nodes: (0..count).collect(),
        coupled: None,
        lateral_tensors: None,
        surface,
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

/// Steps that generated energy, of all, along random drags within the certificate's depth and step.
fn violations(body: &Body, steps: usize, seed: u64) -> usize {
    let mut state = seed;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut contact = Contact::with_slip(body, SlipRule::Paper, Ablation::None).with_tank(false);
    let [a, b, c] = body.corners(seed as u32 % body.elements().len() as u32);
    let (mut x, mut v) =
        ((a + b + c) / 3.0 + body.outward(seed as u32 % body.elements().len() as u32) * 1e-3, DVec3::X);
    let (mut count, mut before) = (0, contact.energy());
    for _ in 0..steps {
        let output = contact.step(body, &ToolState::at(x.to_array()), 1e-3);
        let energy = output.energy;
        let gained = energy.generated_j - before.generated_j;
        let moved = (energy.work_j - before.work_j).abs() + energy.stored_j + before.stored_j;
        let flags = output.flags;
        let covered = !flags.has(Flags::REANCHORED) && output.contact.is_none_or(|c| c.delta_z_m < 6e-3);
        count += usize::from(covered && gained > 1e-12 * moved);
        before = energy;
        let nearest = body.nearest(x, f64::INFINITY).unwrap();
        let deep = output.contact.map_or(0.0, |c| c.delta_z_m);
        let home = if deep > 4e-3 || nearest.outside && nearest.distance > 5e-4 {
            (body.point(nearest.at) - x).normalize_or_zero()
        } else {
            DVec3::ZERO
        };
        v = (v + DVec3::new(unit(), unit(), unit()) + home * 0.6).normalize();
        x += v * 2e-4;
    }
    count
}

fn raised_bodies_are_passive(steps: usize) {
    let assumptions = Assumptions { step_m: 3e-4, slip: SlipRule::Paper, ..Assumptions::default() };
    let ball = body(Shape::Sphere { radius_mm: 30.0 }, 10.0, 0.02);
    let egg = body(Shape::Ellipsoid { radii_mm: [30.0, 25.0, 35.0] }, 10.0, 0.0);
    for (i, body) in [ball, egg].iter().enumerate() {
        // Before, it does generate.
        assert!(violations(body, 4_000, 5) > 0);
        let (raised, report) = floor::raise(body, &assumptions, 600).unwrap();
        assert!(report.largest_friction > 0.05 && report.largest_friction < 1.0, "{report:?}");
        let certificate = {
            let all = elements(&raised, &assumptions, 2500, &|| (), &AtomicBool::new(false));
            certificate(&raised, &assumptions, &all.unwrap())
        };
        assert_eq!(certificate.passive.failing_elements, 0);
        assert!(certificate.passive.holds, "{:?}", certificate.passive);
        for round in 0..4 {
            assert_eq!(violations(&raised, steps / 8, 77 + 10 * round + i as u64), 0);
        }
    }
}

#[test]
fn with_raised_friction_no_step_generates_energy() {
    raised_bodies_are_passive(40_000);
}

/// `cargo test --release -p palpate-cli --test certify -- --ignored`: about a minute.
#[test]
#[ignore = "a million steps"]
fn with_raised_friction_no_step_of_a_million_generates_energy() {
    raised_bodies_are_passive(1_000_000);
}
