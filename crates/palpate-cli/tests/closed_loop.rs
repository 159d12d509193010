//! `palpate run` from outside: presets, intents, records, JSON, complaints.

mod common;

use common::{TestDirectory, said};
use serde_json::Value;
use std::fs;
use std::process::Output;

fn simulated(args: &str) -> String {
    format!("run block.body --device simulated --virtual-time {args}")
}

impl TestDirectory {
    fn simulated(&self, args: &str) -> Output {
        self.run(&simulated(args))
    }

    fn json(&self, args: &str) -> Value {
        serde_json::from_slice(&self.done(&simulated(&format!("{args} --json"))).stdout).unwrap()
    }
}

/// Every built-in intent touches, keeps the books, and stays within the sampling bound; a run repeats to the byte.
#[test]
fn built_in_intents_touch_and_keep_the_books() {
    let directory = TestDirectory::new(10);
    for intent in ["press", "drag", "circle", "tap", "hold"] {
        let run = directory.json(&format!("--intent {intent} --record {intent}.csv"));
        let number = |path: &str| run.pointer(path).and_then(Value::as_f64).unwrap();
        assert!(number("/contacts") >= 1.0 && number("/largest_force_n") > 0.1, "{intent}: {run}");
        let ledger = number("/energy/work_j") - number("/energy/stored_j") - number("/energy/dissipated_j");
        assert!(ledger.abs() < 1e-12, "{intent}");
        let [gained, lost] = [
            number("/mechanics/motor_j") + number("/mechanics/hand_j"),
            number("/mechanics/viscous_j")
                + number("/mechanics/coulomb_j")
                + number("/mechanics/hand_damper_j"),
        ];
        assert!((gained - lost - number("/mechanics/held_j")).abs() < 1e-10, "{intent}: {gained} {lost}");
        // On a flat face slip never raises W.
        assert!(number("/out_j") + number("/energy/stored_j") <= number("/sampling_bound_j"), "{intent}");
        assert_eq!(run["limit_cycles"], Value::Array(Vec::new()), "{intent}");
        let first = fs::read(directory.path(&format!("{intent}.csv"))).unwrap();
        assert!(first.starts_with(b"time_s,x_m,") && first.len() > 100_000);
        directory.json(&format!("--intent {intent} --record again.csv"));
        assert!(first == fs::read(directory.path("again.csv")).unwrap(), "{intent} repeats");
    }
}

/// The bench tool without a hand, pushed by 1 N and 2 N: MODEL's quiet and cycling stiffness, from a file.
#[test]
fn a_file_of_pushes_cycles_or_not() {
    let directory = TestDirectory::new(10);
    let push = |force: f64| {
        let text = format!(
            "[start]\nclearance_mm = 0\n[[move]]\nkind = \"push\"\nforce_n = {force}\nseconds = 1\n\
             [[move]]\nkind = \"hold\"\nseconds = 40\n"
        );
        directory.write("push.toml", &text);
        directory.json("--preset bench --hand none --intent push.toml")
    };
    let (quiet, cycling) = (push(1.0), push(2.0));
    assert_eq!(quiet["limit_cycles"].as_array().unwrap().len(), 0, "{quiet}");
    let cycle = &cycling["limit_cycles"][0];
    assert!(cycle["amplitude_m"].as_f64().unwrap() > 1e-3, "{cycling}");
    assert_eq!(quiet["sampled_data"]["passive_up_to_n_per_m"].as_f64().unwrap().round(), 600.0);
    // Either stage repairs it.
    for stage in ["--passivity", "--coupling-n-per-m 1000"] {
        let repaired = directory.json(&format!("--preset bench --hand none --intent push.toml {stage}"));
        assert_eq!(repaired["limit_cycles"].as_array().unwrap().len(), 0, "{stage}: {repaired}");
    }
    assert!(
        said(&directory.simulated("--preset bench --hand none --intent push.toml")).contains("limit cycle")
    );
}

/// Through a virtual coupling the device meets less than the body's stiffness, and is warned of that.
#[test]
fn a_coupling_is_in_series() {
    let directory = TestDirectory::new(10);
    let text = "[start]\nclearance_mm = 0\n[[move]]\nkind = \"push\"\nforce_n = 2\nseconds = 1\n";
    directory.write("push.toml", text);
    let words = |more: &str| format!("--preset bench --hand none --intent push.toml {more}");
    let number = |run: &Value, key: &str| run["sampled_data"][key].as_f64().unwrap();
    let bare = directory.json(&words(""));
    assert!(number(&bare, "met_n_per_m") == number(&bare, "stiffness_max_n_per_m"), "{bare}");
    assert!(said(&directory.simulated(&words(""))).contains("keeps a loop of 1000 Hz passive up to 600"));
    let coupled = directory.json(&words("--coupling-n-per-m 1000"));
    let k = number(&coupled, "stiffness_max_n_per_m");
    assert!(k > 600.0, "{coupled}");
    assert!((number(&coupled, "met_n_per_m") - k * 1e3 / (k + 1e3)).abs() < 1e-9, "{coupled}");
    let told = said(&directory.simulated(&words("--coupling-n-per-m 1000")));
    assert!(!told.contains("passive up to"), "{told}");
}

#[test]
fn complaints_say_where() {
    let directory = TestDirectory::new(10);
    let refused = |args: &str, code, words: &[&str]| directory.refused(&simulated(args), code, words);
    refused("--intent wave", 1, &["--intent wave", "press, drag"]);
    refused("--intent none.toml", 1, &["none.toml"]);
    refused("--preset pencil", 2, &["pencil"]);
    refused("--rate-hz 0", 1, &["--rate-hz 0"]);
    refused("--seconds -1", 2, &["-1"]);
    refused("--coupling-n-per-m 0", 1, &["--coupling-n-per-m"]);
    refused("--record block.body", 1, &["block.body", "input"]);
    // A built-in intent is no file, so that its name is free for one.
    assert!(directory.simulated("--intent drag --seconds 0.01 --record drag").status.success());
    let wrong = [
        ("[[move]]\nkind = \"press\"\nseconds = 1\n", "depth_mm"),
        ("[[move]]\nkind = \"wave\"\nseconds = 1\n", "wave"),
        ("[[move]]\nkind = \"press\"\ndepth_mm = 1\nseconds = 0\n", "wrong.toml:4: seconds"),
        ("[device]\nmass_kg = 0\n[[move]]\nkind = \"hold\"\nseconds = 1\n", "wrong.toml:2: mass_kg"),
        (
            "[hand]\nmass_kg = 0\ndamping_n_s_per_m = -1\nstiffness_n_per_m = 0\n[[move]]\nkind = \"hold\"\nseconds = 1\n",
            "wrong.toml:3: damping",
        ),
        ("[start]\nalong = [0, 0, 1]\n[[move]]\nkind = \"hold\"\nseconds = 1\n", "wrong.toml:2: place"),
        ("move = []\n", "wrong.toml: there is no move"),
        (
            "[[move]]\nkind = \"hold\"\nseconds = 1\n\n[[move]]\nkind = \"press\"\nseconds = 1\ndepth_mm = nan\n",
            "wrong.toml:8: depth_mm is NaN",
        ),
        ("[[move]]\nkind = \"push\"\nseconds = 1\nforce_n = 1e300\n", "wrong.toml:4: force_n"),
        ("[[move]]\nkind = \"tap\"\nseconds = 1\ndepth_mm = 1\ntimes = 4000000000\n", "wrong.toml:5: times"),
        ("[[move]]\nkind = \"hold\"\nseconds = 1\ntremor_hz = 1e9\n", "wrong.toml:4: tremor_hz"),
        (
            "[start]\nclearance_mm = 1e300\n[[move]]\nkind = \"hold\"\nseconds = 1\n",
            "wrong.toml:2: clearance_mm",
        ),
    ];
    for (text, word) in wrong {
        directory.write("wrong.toml", text);
        refused("--intent wrong.toml", 1, &[word]);
    }
    // What would never end, or sum to infinity, in the simulated tool.
    for (key, value) in [
        ("mass_kg", "1e-300"),
        ("mass_kg", "1.7e308"),
        ("damping_n_s_per_m", "1e9"),
        ("resolution_mm", "5e-324"),
        ("delay_ms", "1e12"),
        ("lag_ms", "1e-9"),
        ("lag_ms", "inf"),
        ("max_force_n", "nan"),
    ] {
        let text = format!("[device]\n{key} = {value}\n[[move]]\nkind = \"hold\"\nseconds = 1\n");
        directory.write("wrong.toml", &text);
        refused("--intent wrong.toml", 1, &[&format!("wrong.toml:2: {key} is"), "; give"]);
    }
    // Each is a number, but not together.
    directory.write("wrong.toml", "[device]\nmass_kg = 1e-6\n[[move]]\nkind = \"hold\"\nseconds = 1\n");
    refused("--intent wrong.toml --hand none --preset omega", 1, &["moving mass", "more mass"]);
    directory.write("wrong.toml", "[device]\ndelay_ms = 100\n[[move]]\nkind = \"hold\"\nseconds = 1\n");
    refused("--intent wrong.toml", 1, &["64 periods", "rate_hz"]);
    assert_eq!(directory.run("run block.body --device nonsense").status.code(), Some(2));
    let help = directory.run("run --help");
    assert!(String::from_utf8_lossy(&help.stdout).contains("Examples:"));
}
