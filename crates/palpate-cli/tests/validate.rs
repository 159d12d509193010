//! `palpate validate` on a small body: simulated, rendered, reported.

mod common;

use common::TestDirectory;

/// A small soft ball with few test points, as in the examples but coarser in depth.
fn directory() -> TestDirectory {
    let directory = TestDirectory::new(20);
    directory.write("ball.toml", include_str!("../../../examples/ball.toml"));
    directory.done("precompute ball.toml -o ball.body");
    directory
}

fn json(directory: &TestDirectory, args: &str) -> serde_json::Value {
    serde_json::from_slice(&directory.done(args).stdout).unwrap()
}

#[test]
fn free_paths_are_simulated_rendered_and_reported() {
    let directory = directory();
    let found = json(&directory, "validate ball.body ball.toml --paths 2 --jobs 2 --json -o errors");
    let file = |name: &str| std::fs::read(directory.path("errors").join(name)).unwrap();
    assert!(file("validate.png").starts_with(b"\x89PNG"));
    let text = String::from_utf8(file("validate.md")).unwrap();
    for said in [
        "history coulomb",
        "the body",
        "slip rule paper",
        "one contact point",
        "eight contact points",
        "| reversal |",
        "sustained sliding",
    ] {
        assert!(text.contains(said), "{said}: {text}");
    }
    let states = String::from_utf8(file("states.csv")).unwrap();
    let column = |name: &str| states.lines().next().unwrap().split(',').position(|c| c == name).unwrap();
    let of = |name: &str| -> Vec<f64> {
        let c = column(name);
        states.lines().skip(1).map(|l| l.split(',').nth(c).unwrap().parse().unwrap()).collect()
    };
    assert!(of("slipping").contains(&1.0) && of("pressed_n").iter().any(|p| *p > 0.0));
    assert!(
        of("depth_m").iter().all(|d| *d <= 3e-3) && of("friction").iter().all(|m| (*m - 0.3).abs() < 1e-9)
    );

    assert_eq!(found["history"], "coulomb");
    let counted: u64 =
        found["phases"].as_array().unwrap().iter().map(|p| p["states"].as_u64().unwrap()).sum();
    assert_eq!(counted, found["summary"]["states"].as_u64().unwrap());
    // A third more than they are: a law, a fit or a slip rule that loses an ingredient shows here, too.
    let error = |row: &serde_json::Value, of: &str, part: &str| row[of]["of_largest"][part].as_f64().unwrap();
    for of in ["normal", "lateral", "size"] {
        let [median, p95] = ["median", "p95"].map(|part| error(&found["summary"], of, part));
        assert!(median > 0.0 && median < 4.5 && p95 < 12.5, "{of} {median} {p95}");
    }
    let row = |name: &str| found["sources"].as_array().unwrap().iter().find(|s| s["source"] == name).unwrap();
    let of_lateral = ["body", "flat-friction", "without-offset"].map(|s| error(row(s), "lateral", "p95"));
    assert!(of_lateral[1..].iter().all(|lacking| *lacking > 1.5 * of_lateral[0]), "{of_lateral:?}");
    let surface = |of: &str, part: &str| found[of]["rms_percent"][part].as_f64().unwrap();
    assert!(surface("surface", "median") > 0.0 && surface("surface", "median") < surface("dimple", "median"));
    assert!(found["surface"]["show_through_percent"]["worst"].as_f64().unwrap() < 2.0);
    assert!(text.contains("deformed surface"), "{text}");
    // On one thread: the same paths and errors.
    assert_eq!(found, json(&directory, "validate ball.body ball.toml --paths 2 --jobs 1 --json"));
}

#[test]
fn each_history_runs() {
    let directory = directory();
    for (history, phases) in [("frictionless", 1), ("stick", 2), ("frictionless-press", 2)] {
        let args = format!("validate ball.body ball.toml --paths 1 --history {history} --json");
        let found = json(&directory, &args);
        assert_eq!(found["history"], history);
        assert_eq!(found["phases"].as_array().unwrap().len(), phases, "{history}");
        assert!(found["sliding"].is_null());
    }
    let at =
        json(&directory, "validate ball.body ball.toml --paths 1 --history stick --at-test-points --json");
    assert_eq!(at["at_test_points"], true);
    let spec = include_str!("../../../examples/ball.toml")
        .replace("radius_mm = 5", "radius_mm = 5\ncontact = \"bonded\"\npatch_radius_mm = 3");
    directory.write("bonded.toml", &spec);
    directory.refused(
        "validate ball.body bonded.toml",
        1,
        &["bonded.toml", "contact", "history frictionless-press"],
    );
    directory.refused("validate ball.body ball.toml --history none", 2, &["coulomb", "stick"]);
}
