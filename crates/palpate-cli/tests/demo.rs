//! The demo reaches its bars, and its files are what they promise to be.

use palpate_body::Body;
use palpate_cli::demo::experiment::{SETTINGS, roll_out};
use palpate_cli::demo::report::Report;
use palpate_cli::demo::{cylinder, path, run};
use palpate_engine::Contact;
use std::path::Path;

#[test]
fn the_demo_passes_and_writes_everything() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("results");
    let report = run(&out).unwrap();
    bars(&report);
    closed_loops(&report);
    ridges(&report);
    json(&out);
    pictures(&out);
    assert!(std::fs::read(out.join("loops.png")).unwrap().starts_with(b"\x89PNG"));
    sound(&out);
    let words = std::fs::read_to_string(out.join("report.md")).unwrap();
    for name in files(&out) {
        assert!(!name.starts_with('.'), "{name} is left over");
    }
    assert!(words.contains("passed") && words.contains("palpate trace"));
    let csv = std::fs::read_to_string(out.join("path.csv")).unwrap();
    assert!(csv.starts_with("time_s,x_m,y_m,z_m\n"));
    assert_eq!(csv.lines().count(), 4702);

    going_on(&out, &report);

    // Again, into the same folder: the same files.
    let before = files(&out);
    run(&out).unwrap();
    assert_eq!(files(&out), before);
}

fn bars(report: &Report) {
    assert!(report.passed, "{:?}", report.shortfalls);
    let [both, coordinates, responses, _] = report.settings.as_slice() else { panic!("four settings") };
    assert!(both.excess_step_n <= 1e-3 && both.refinement[1] <= 0.12 && both.refinement[2] <= 0.013);
    for ablated in [coordinates, responses] {
        assert!(ablated.excess_finer_n.iter().all(|&e| e >= 50e-3), "{}", ablated.name);
        assert!(ablated.refinement.iter().all(|&r| r > 0.9), "{}", ablated.name);
    }
    for setting in &report.settings {
        assert!(setting.ledger_error_j.abs() < 1e-12);
        assert!(setting.stored_j == 0.0 && setting.onsets == 1 && setting.capped == 0);
    }
    assert_eq!((report.body.triangles, report.body.nodes), (528, 288));
    for (cycle, most) in report.slip_rules.iter().zip([10.3, 0.85, -10.0, 10.3, 0.06, -2.0]) {
        assert!(cycle.handed_out_j * 1e3 < most, "{cycle:?}");
        assert_eq!(cycle.excess_step_n > 1e-3, cycle.slip == "exact", "{cycle:?}");
        assert!(cycle.slip != "paper" || cycle.handed_out_j > 10.2e-3);
    }
    assert_eq!(report.slip_rules.len(), 6);
}

/// Sliding with the loop closed: next to no texture with both, twenty times as much or more without either; and resting
/// inside, cycles without coordinates only.
fn closed_loops(report: &Report) {
    let textures: Vec<f64> = report.closed_loop.sliding.iter().map(|s| s.texture_n).collect();
    let [both, ablated @ ..] = textures.as_slice() else { panic!("four slides") };
    assert!(*both < 0.5e-3 && ablated.iter().all(|t| *t > 2e-3), "{textures:?}");
    let cycling: Vec<u32> = report.closed_loop.resting.iter().map(|r| r.cycling).collect();
    assert!(cycling[0] == 0 && cycling[1] > 0 && cycling[3] > 0, "{cycling:?}");
}

/// Flat facets jump, the paper's interpolation ripples; on a refined surface neither is left.
fn ridges(report: &Report) {
    let [flat, smooth, refined] = report.ridges.as_slice() else { panic!("three surfaces") };
    assert!(refined.ripple_percent < 0.2 && refined.ripple_n < 3e-3, "{refined:?}");
    assert!((9.0..13.0).contains(&smooth.ripple_percent), "{smooth:?}");
    assert!((24.0..40.0).contains(&flat.largest_step_percent), "{flat:?}");
    assert!(
        smooth.largest_step_percent < 1.5 && refined.largest_step_percent < 0.5,
        "{smooth:?} {refined:?}"
    );
    assert!(refined.triangles > 10 * smooth.triangles && smooth.triangles == 528);
}

/// The body and path that are written give the experiment again, to the bit.
fn going_on(out: &Path, report: &Report) {
    let body = Body::open(&out.join("cylinder.body")).unwrap();
    let waypoints = palpate_runtime::path::read(&out.join("path.csv")).unwrap();
    for (setting, (_, ablation)) in report.settings.iter().zip(SETTINGS) {
        let mut contact = Contact::with_ablation(&body, ablation);
        for waypoint in &waypoints {
            contact.step(&body, &waypoint.pose, 1e-3);
        }
        assert_eq!(contact.energy().work_j, setting.work_j, "{}", setting.name);
    }
}

fn json(out: &Path) {
    let text = std::fs::read_to_string(out.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["passed"], true);
    for (setting, (name, _)) in report["settings"].as_array().unwrap().iter().zip(SETTINGS) {
        assert_eq!(setting["name"], name);
        for key in ["largest_step_n", "excess_step_n", "generated_j"] {
            assert!(setting[key].is_f64(), "{name}: {key}");
        }
        assert_eq!(setting["refinement"].as_array().unwrap().len(), 3);
        assert_eq!(setting["refinement"][0], 1.0);
    }
}

fn pictures(out: &Path) {
    for name in ["force.png", "clicks.png", "curves.png", "body.png", "rules.png", "ridges.png"] {
        let bytes = std::fs::read(out.join(name)).unwrap();
        assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 10_000, "{name}");
    }
}

/// The ablated settings tick; the smooth one is silent beside them, with the same gain.
fn sound(out: &Path) {
    let peak = |name: &str| {
        let mut wav = hound::WavReader::open(out.join(format!("force-rate-{name}.wav"))).unwrap();
        assert_eq!(
            (wav.spec().channels, wav.spec().sample_rate, wav.spec().bits_per_sample),
            (1, 44_100, 16)
        );
        assert!((f64::from(wav.duration()) / 44_100.0 - path::DURATION).abs() < 1e-3);
        wav.samples::<i16>().map(|s| s.unwrap().unsigned_abs()).max().unwrap()
    };
    let [smooth, ablated @ ..] = SETTINGS.map(|(name, _)| peak(name));
    assert!(ablated.iter().all(|&p| p > 20 * smooth && p < i16::MAX as u16), "{smooth} {ablated:?}");
}

fn files(out: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(out).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// What makes a click is an edge: without one between two samples, even an ablated force is smooth.
#[test]
fn clicks_happen_at_edges() {
    let body = cylinder::body().unwrap();
    for rollout in &roll_out(&body, 1e3, true).settings {
        for &(sample, excess) in &rollout.clicks {
            let [before, after] = [sample - 1, sample].map(|i| rollout.samples[i].contact.unwrap());
            let on_edge = |n: [f64; 3]| n.contains(&0.0);
            let moved = before.element != after.element || on_edge(before.n) || on_edge(after.n);
            assert!(moved, "{excess} N at {sample} inside element {}", after.element);
        }
    }
}

/// A smooth setting whose steps do not shrink, and an ablated one that does not click, are both told.
#[test]
fn what_falls_short_is_named() {
    let body = cylinder::body().unwrap();
    let mut rate = roll_out(&body, 1e3, false);
    rate.settings[2] = rate.settings[0].clone();
    let report = Report::new(&body, &[rate.clone(), rate.clone(), rate]);
    assert!(!report.passed);
    let told = report.shortfalls.join("\n");
    assert!(told.contains("both: sampled 10 times finer") && told.contains("100 times finer"), "{told}");
    assert!(told.contains("responses-off: the largest excess is only 0.0 mN"), "{told}");
    assert_eq!(report.shortfalls.len(), 3);
}

#[test]
fn a_folder_that_is_a_file_is_refused() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let message = format!("{:#}", run(file.path()).unwrap_err());
    assert!(message.contains("check that the folder can be written"), "{message}");
}
