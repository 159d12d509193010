//! Bodies with a coupled law through the commands.

mod common;
#[path = "../../palpate-body/tests/support/coupled.rs"]
mod potentials;

use common::TestDirectory;
use palpate_body::{Body, BodyParts, CoupledLaw, Potential, PotentialErrors};

/// A block with a coupled law of 4 test points, `coupled.body`.
fn directory() -> TestDirectory {
    let directory = TestDirectory::new(10);
    let mut parts = Body::open(&directory.path("block.body")).unwrap().parts();
    let nodes = parts.surface.inward_normals().to_vec();
    let potential = |n: u32| {
        let u = nodes[n as usize];
        let t1 = u.any_orthonormal_vector();
        Potential { tangents: [t1, u.cross(t1)], ..potentials::potential(u64::from(n), 0.3) }
    };
    parts.test_point_nodes = vec![0, 5, 10, 15];
    let law = CoupledLaw {
        range_m: potentials::RANGE,
        potentials: parts.test_point_nodes.iter().map(|&n| potential(n)).collect(),
    };
    for (n, blend) in parts.blends.iter_mut().enumerate() {
        let first = n as u32 % 4;
        (blend.test_points, blend.weights) = ([first, (first + 1) % 4, first], [0.75, 0.25, 0.0]);
    }
    let body =
        Body::new(BodyParts { responses: Vec::new(), coupled: Some(law), partial_slip: true, ..parts })
            .unwrap();
    body.save(&directory.path("coupled.body")).unwrap();
    directory
}

/// Of a body from a simulation, the places that were simulated: the others' potentials are made from theirs.
#[test]
fn plots_are_of_what_was_simulated() {
    let mut parts = Body::open(&directory().path("coupled.body")).unwrap().parts();
    let titles = |parts: &BodyParts| {
        let charts = palpate_cli::inspect::charts(&Body::new(parts.clone()).unwrap());
        let (_, normal) = charts.into_iter().find(|(name, _)| name.starts_with("normal")).unwrap();
        (normal[0].title.clone(), normal[0].lines.iter().map(|l| l.name.clone()).collect::<Vec<_>>())
    };
    let (title, lines) = titles(&parts);
    assert!(title.ends_with("4 of 4 test points") && lines.len() == 4, "{title} {lines:?}");
    let errors = [0, 10].map(|node| PotentialErrors { node, ..PotentialErrors::default() });
    parts.provenance.potential_errors = errors.into();
    let (title, mut lines) = titles(&parts);
    lines.sort();
    assert!(title.ends_with("2 of 2 test points") && lines.len() == 2, "{title} {lines:?}");
    assert!(lines[0].starts_with("0 at") && lines[1].starts_with("2 at"), "{lines:?}");
}

#[test]
fn inspect_tells_the_law() {
    let directory = directory();
    let output = directory.done("inspect coupled.body --json --plots pictures");
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&found["law"], &found["test_points"]), (&"coupled".into(), &4.into()));
    assert_eq!(found["partial_slip"], true);
    let [low, high] = [0, 1].map(|i| found["coupled"]["stiffness_n_per_m"][i].as_f64().unwrap());
    assert!(low > 0.0 && high > low, "{low} {high}");
    assert_eq!(found["coupled"]["lateral_range_m"].as_f64(), Some(potentials::RANGE));
    let bounds = found["stiffness_max_n_per_m"].as_array().unwrap();
    assert_eq!(bounds.len(), potentials::KNOTS.len());
    assert!(bounds.iter().all(|b| b["value"].as_f64().unwrap() >= low));
    assert!(bounds.last().unwrap()["value"].as_f64().unwrap() > high);
    for key in
        ["largest_normal_force_n", "largest_lateral_force_n", "stiffness_at_full_depth_n_per_m", "friction"]
    {
        assert!(found["ranges"][key][0].as_f64().unwrap() > 0.0, "{key}: {}", found["ranges"]);
    }
    for picture in ["normal.png", "stiffness.png", "lateral.png"] {
        assert!(directory.path("pictures").join(picture).exists(), "{picture}");
    }
    let text = |args: &str| String::from_utf8(directory.done(args).stdout).unwrap();
    let (text, decoupled) = (text("inspect coupled.body"), text("inspect block.body"));
    assert!(["coupled", "K, its eigenvalues", "2 (partial slip)"].iter().all(|w| text.contains(w)), "{text}");
    assert!(decoupled.contains("decoupled") && !decoupled.contains("eigenvalues"), "{decoupled}");
}

#[test]
fn potentials_are_exported() {
    let directory = directory();
    directory.done("export coupled.body --csv tables --vtu coupled.vtu");
    let text = std::fs::read_to_string(directory.path("tables").join("potentials.csv")).unwrap();
    let mut rows = text.lines().map(|row| row.split(',').collect::<Vec<_>>());
    let columns = rows.next().unwrap();
    let column = |name: &str| columns.iter().position(|c| *c == name).unwrap();
    let body = Body::open(&directory.path("coupled.body")).unwrap();
    let law = body.coupled_law().unwrap();
    let mut count = 0;
    for row in rows {
        assert_eq!(row.len(), columns.len());
        let number = |name| row[column(name)].parse::<f64>().unwrap();
        let potential = &law.potentials[number("point") as usize];
        let d = number("depth_m");
        assert_eq!(number("F_j"), potential.press.value(d));
        assert_eq!(number("K12_n_per_m"), potential.stiffness[1].value(d));
        assert_eq!(number("Q_slope_per_m").to_bits(), potential.quartic.slope(d).to_bits());
        assert_eq!(number("mu"), potential.friction.value(d));
        assert_eq!(number("t2_y"), potential.tangents[1].y);
        count += 1;
    }
    assert_eq!(count, 4 * (8 * (potentials::KNOTS.len() - 1) + 1));
    assert!(!directory.path("tables").join("curves.csv").exists());
    let grid = std::fs::read(directory.path("coupled.vtu")).unwrap();
    let head = String::from_utf8_lossy(&grid[..8000.min(grid.len())]).into_owned();
    assert!(head.contains("k_greatest_at_full_depth_n_per_m"), "{head}");
    let nodes = std::fs::read_to_string(directory.path("tables").join("nodes.csv")).unwrap();
    assert_eq!(nodes.lines().count(), body.nodes().len() + 1);
}

/// Bounds of P and S beside what a search finds, K_max, and what a device holds; and the tank, where P is not proved.
#[test]
fn coupled_bodies_are_certified() {
    let directory = directory();
    let out =
        directory.run("certify coupled.body --evaluations 10 --depth-mm 2 --damping-n-s-per-m 0.5 --json");
    assert_eq!(out.status.code(), Some(3), "{}", String::from_utf8_lossy(&out.stderr));
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    for name in ["passive", "snap_free"] {
        let count = |key: &str| json[name][key].as_u64().unwrap();
        let all = count("proved_elements") + count("failing_elements") + count("undecided_elements");
        assert_eq!(Some(all), json["elements"].as_u64());
        let [margin, found] = ["margin", "found"].map(|key| json[name][key].as_f64());
        assert!(
            found.is_some() && margin.is_none_or(|margin| margin <= found.unwrap()),
            "{name}: {margin:?} {found:?}"
        );
    }
    let scope = &json["scope"];
    assert_eq!(scope["lateral_m"].as_f64(), Some(potentials::RANGE));
    assert!((scope["passive_from_m"].as_f64().unwrap() - 4e-5).abs() < 1e-12, "{scope}");
    assert!(json["remarks"].to_string().contains("tank"), "{}", json["remarks"]);
    // 2 b/T = 1,000 N/m: no deeper than where K_max exceeds that.
    let device = &json["device"];
    let depth = device["depth_limit_m"].as_f64().unwrap();
    assert_eq!(device["stiffness_limit_n_per_m"].as_f64(), Some(1000.0));
    let within = |row: &&serde_json::Value| row["depth_m"].as_f64().unwrap() <= depth;
    let table = json["stiffness_max_n_per_m"].as_array().unwrap();
    assert!(table.iter().filter(within).all(|row| depth == 0.0 || row["value"].as_f64().unwrap() <= 1000.0));
    assert!(device["force_limit_n"].is_null(), "it depends on the lateral deflection");
    directory.refused(
        "certify coupled.body --raise-friction -o b.body --slip paper",
        1,
        &["coupled potential", "tank"],
    );
}
