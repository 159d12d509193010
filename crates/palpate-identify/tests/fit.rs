//! From samples to a body.

use glam::DVec3;
use palpate_body::{
    Body, BodyParts, Extension, Interpolation, Provenance, Response, SlipRule, Surface, Tool, TriangleMesh,
};
use palpate_identify::{Component, Fit, FitError, FitOptions, Sample, fit, read_samples};

/// An open plane of 20 × 20 squares of 1 mm.
fn plane() -> Surface {
    let at = |i: u32, j: u32| i + 21 * j;
    let positions = (0..21).flat_map(|j| (0..21).map(move |i| DVec3::new(i as f64, j as f64, 0.0) * 1e-3));
    let squares = (0..20).flat_map(|j| (0..20).map(move |i| (i, j)));
    let triangles = squares.flat_map(|(i, j)| {
        [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    });
    let mesh = TriangleMesh { positions: positions.collect(), triangles: triangles.collect() };
    Surface::build(&mesh, f64::INFINITY).unwrap()
}

/// Rows of one component at one point; lines count on from those that are there.
fn add(rows: &mut Vec<Sample>, point: &str, at_mm: [f64; 2], component: Component, samples: &[(f64, f64)]) {
    for &(deflection_m, value) in samples {
        rows.push(Sample {
            point: point.into(),
            position_m: [at_mm[0] * 1e-3, at_mm[1] * 1e-3, 0.0],
            component,
            deflection_m,
            value,
            direction: None,
            weight: None,
            line: rows.len() as u64 + 2,
        });
    }
}

const NORMAL: [(f64, f64); 4] = [(0.0, 0.0), (1e-3, 0.05), (3e-3, 0.4), (7e-3, 3.0)];
const LATERAL: [(f64, f64); 3] = [(1e-3, 0.5), (2e-3, 0.9), (4e-3, 1.5)];
const FRICTION: [(f64, f64); 2] = [(1e-3, 0.4), (5e-3, 0.2)];

/// Three points with all components, the later ones stiffer and sampled elsewhere.
fn three() -> Vec<Sample> {
    let mut rows = Vec::new();
    for (k, (point, at)) in
        [("a", [2.0, 2.0]), ("b", [18.0, 3.0]), ("c", [9.0, 17.0])].into_iter().enumerate()
    {
        let k = k as f64;
        let scaled = |s: &[(f64, f64)]| {
            s.iter().map(|&(d, y)| (d * (1.0 - 0.1 * k), y * (1.0 + k))).collect::<Vec<_>>()
        };
        add(&mut rows, point, at, Component::Normal, &scaled(&NORMAL));
        add(&mut rows, point, at, Component::Lateral, &scaled(&LATERAL));
        add(&mut rows, point, at, Component::Friction, &scaled(&FRICTION));
    }
    rows
}

fn body(surface: &Surface, fit: &Fit) -> Body {
    Body::new(BodyParts {
        surface: surface.clone(),
        blends: fit.blends.clone(),
        responses: fit.responses.clone(),
        test_point_nodes: fit.test_point_nodes.clone(),
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

fn curve(response: &Response, component: Component) -> &palpate_body::Curve {
    match component {
        Component::Normal => &response.normal,
        Component::Lateral => &response.lateral,
        Component::Friction => &response.friction,
    }
}

#[test]
fn curves_pass_through_their_samples() {
    let surface = plane();
    let rows = three();
    for interpolation in [Interpolation::Pchip, Interpolation::Linear] {
        let fitted = fit(&surface, &rows, &FitOptions { interpolation, ..Default::default() }).unwrap();
        assert_eq!(fitted.test_point_nodes, [2 + 21 * 2, 18 + 21 * 3, 9 + 21 * 17]);
        let body = body(&surface, &fitted);
        for row in &rows {
            let t = ["a", "b", "c"].iter().position(|p| *p == row.point).unwrap();
            let response = body.node_response(fitted.test_point_nodes[t] as usize).unwrap();
            let value = curve(&response, row.component).value(row.deflection_m);
            assert!((value - row.value).abs() <= 1e-12 * (1.0 + row.value), "{row:?}: {value}");
        }
        let friction = &body.node_response(44).unwrap().friction;
        assert_eq!((friction.value(0.0), friction.value(1.0)), (0.4, 0.2), "held at both ends");
        assert_eq!(Body::from_bytes(&body.to_bytes().unwrap()).unwrap(), body);
    }
}

#[test]
fn own_curves_keep_their_shape_on_shared_knots() {
    let surface = plane();
    let rows = three();
    let fitted = fit(&surface, &rows, &FitOptions::default()).unwrap();
    let alone: Vec<Sample> = rows.iter().filter(|row| row.point == "b").cloned().collect();
    let alone = fit(&surface, &alone, &FitOptions::default()).unwrap();
    for i in 0..=1000 {
        let d = i as f64 * 1e-5;
        for component in [Component::Normal, Component::Lateral, Component::Friction] {
            let (a, b) = (curve(&fitted.responses[1], component), curve(&alone.responses[0], component));
            assert!((a.value(d) - b.value(d)).abs() < 1e-12, "{component} at {d} m");
        }
    }
    assert!(alone.blends.iter().all(|blend| blend.test_points == [0; 3]));
}

#[test]
fn the_report_counts_and_measures() {
    let surface = plane();
    let mut rows = three();
    for row in rows.iter_mut().filter(|row| row.point == "b") {
        row.position_m[2] = 3e-4;
    }
    rows[0].weight = Some(0.5);
    let wrong = Sample { value: 99.0, weight: Some(0.0), ..rows[1].clone() };
    rows.push(wrong);
    let report = fit(&surface, &rows, &FitOptions::default()).unwrap().report;
    assert!((report.largest_distance_m - 3e-4).abs() < 1e-15);
    let b = &report.points[1];
    assert_eq!((b.point.as_str(), b.node), ("b", 18 + 21 * 3));
    assert_eq!((b.normal_samples, b.lateral_samples, b.friction_samples), (4, 3, 2));
    assert_eq!(report.points[0].normal_samples, 4, "a row of weight 0 is left out");
    let noted = |words: &str| report.notes.iter().any(|note| note.contains(words));
    assert!(noted("weights between the rows were not used"), "{:?}", report.notes);
    assert!(noted("normal samples of point `c` end at 5.600 mm, others at 7.000 mm"), "{:?}", report.notes);

    let placed = |place: &dyn Fn([f64; 3]) -> [f64; 3]| -> Vec<Sample> {
        rows.iter().map(|row| Sample { position_m: place(row.position_m), ..row.clone() }).collect()
    };
    let refused = |rows: &[Sample], words: &str| {
        let message = fit(&surface, rows, &FitOptions::default()).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    };
    refused(&placed(&|p| p.map(|x| x * 1e3)), "m from the mesh");
    refused(&placed(&|p| p.map(|x| x * 1e-6)), "nearest to it and to point");
    let above = placed(&|[x, y, _]| [x, y, 0.01]);
    let far = fit(&surface, &above[..9], &FitOptions::default()).unwrap().report;
    assert!(
        far.notes.iter().any(|note| note.contains("point `a` lies") && note.contains("both in m?")),
        "{far:?}"
    );
}

#[test]
fn what_a_point_lacks_comes_from_those_around() {
    let surface = plane();
    let mut rows = three();
    // `d` lies on the segment from a to b, a quarter of the way, and has only normal rows.
    add(&mut rows, "d", [6.0, 2.0], Component::Normal, &NORMAL);
    rows.retain(|row| row.point != "c");
    for row in rows.iter_mut().filter(|row| row.point == "b") {
        row.position_m[1] = 2e-3;
    }
    let fitted = fit(&surface, &rows, &FitOptions::default()).unwrap();
    let body = body(&surface, &fitted);
    let [a, b, d] = [0, 1, 2].map(|t| body.node_response(fitted.test_point_nodes[t] as usize).unwrap());
    for i in 0..=100 {
        let at = i as f64 * 1e-4;
        let blended = |f: fn(&Response, f64) -> f64| 0.75 * f(&a, at) + 0.25 * f(&b, at) - f(&d, at);
        assert!(blended(|r, at| r.lateral.value(at)).abs() < 1e-12);
        assert!(blended(|r, at| r.friction.value(at)).abs() < 1e-12);
        assert!((a.normal.value(at) - d.normal.value(at)).abs() < 1e-12, "its own rows");
    }
    for component in ["lateral", "friction"] {
        let note = format!("1 of 3 points have no {component} rows");
        assert!(fitted.report.notes.iter().any(|n| n.contains(&note)), "{:?}", fitted.report.notes);
    }
}

#[test]
fn friction_may_be_given_for_all() {
    let surface = plane();
    let mut rows = three();
    rows.retain(|row| row.component != Component::Friction);
    let fitted =
        fit(&surface, &rows, &FitOptions { default_friction: Some(0.3), ..Default::default() }).unwrap();
    let body = body(&surface, &fitted);
    let friction = body.node_response(200).unwrap().friction;
    assert_eq!(friction.extension(), Extension::Constant);
    assert!([0.0, 2e-3, 1.0].iter().all(|&d| (friction.value(d) - 0.3).abs() < 1e-15));
    // Friction rows go before the default; a single one holds everywhere.
    add(&mut rows, "a", [2.0, 2.0], Component::Friction, &[(0.0, 0.7)]);
    let fitted =
        fit(&surface, &rows, &FitOptions { default_friction: Some(0.3), ..Default::default() }).unwrap();
    assert!(fitted.responses.iter().all(|r| r.friction.value(0.0) == 0.7 && r.friction.value(1.0) == 0.7));
}

#[test]
fn directions_are_averaged() {
    let surface = plane();
    let mut rows = three();
    for row in rows.iter_mut().filter(|row| row.component == Component::Lateral) {
        row.direction = Some([1.0, 0.0, 0.0]);
    }
    let across: Vec<Sample> = rows
        .iter()
        .filter(|row| row.component == Component::Lateral && row.point == "a")
        .map(|row| Sample { direction: Some([0.0, 2.0, 0.0]), value: row.value * 1.2, ..row.clone() })
        .collect();
    rows.extend(across);
    // The same row twice is no contradiction.
    rows.push(rows[5].clone());
    let fitted = fit(&surface, &rows, &FitOptions::default()).unwrap();
    for (d, y) in LATERAL {
        assert!((fitted.responses[0].lateral.value(d) - 1.1 * y).abs() < 1e-12);
    }
    let note = fitted.report.notes.iter().find(|note| note.contains("averaged at 3 deflections")).unwrap();
    assert!(note.contains("0.3000 N in line 8 (point `a`)") && note.contains("isotropic"), "{note}");
}

#[test]
fn a_curve_that_levels_off_still_makes_a_body() {
    let surface = plane();
    let mut rows = three();
    // PCHIP ends these with slope 0, and others go on to 4 mm.
    add(&mut rows, "d", [10.0, 9.0], Component::Lateral, &[(1e-3, 1.0), (2e-3, 1.9), (2.1e-3, 1.9001)]);
    add(&mut rows, "d", [10.0, 9.0], Component::Normal, &[(1e-3, 1.0), (2e-3, 1.0)]);
    add(&mut rows, "d", [10.0, 9.0], Component::Friction, &[(0.0, 0.5), (2e-3, 0.0), (7e-3, 0.0)]);
    let fitted = fit(&surface, &rows, &FitOptions::default()).unwrap();
    let body = body(&surface, &fitted);
    let d = &body.curves()[3];
    assert!((d.lateral.value(2.1e-3) - 1.9001).abs() < 1e-12 && d.lateral.slope(1.0) > 0.0);
    assert_eq!((d.normal.slope(1.0), d.friction.value(1.0)), (0.0, 0.0));
    assert_eq!(Body::from_bytes(&body.to_bytes().unwrap()).unwrap(), body);
}

#[test]
fn random_samples_make_bodies() {
    let surface = plane();
    let mut state = 42u64;
    let mut random = move || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    };
    for _ in 0..300 {
        let mut rows = Vec::new();
        let count = 1 + (random() * 8.0) as usize;
        let mut places = std::collections::HashSet::new();
        for p in 0..count {
            let at = [(random() * 21.0).floor(), (random() * 21.0).floor()];
            if !places.insert(at.map(|x| x as u32)) {
                continue;
            }
            let name = p.to_string();
            for component in [Component::Normal, Component::Lateral, Component::Friction] {
                if p > 0 && random() < 0.3 {
                    continue;
                }
                let (mut d, mut y) = (0.0, 0.0);
                let samples: Vec<(f64, f64)> = (0..1 + (random() * 7.0) as usize)
                    .map(|_| {
                        d += 1e-5 + random() * random() * 3e-3;
                        y += match component {
                            Component::Normal => (random() - 0.3).max(0.0),
                            _ => 1e-6 + random().powi(4),
                        };
                        (d, if component == Component::Friction { (random() - 0.3).max(0.0) } else { y })
                    })
                    .collect();
                add(&mut rows, &name, at, component, &samples);
            }
        }
        let interpolation = if random() < 0.5 { Interpolation::Pchip } else { Interpolation::Linear };
        let fitted = fit(&surface, &rows, &FitOptions { interpolation, default_friction: None }).unwrap();
        let body = body(&surface, &fitted);
        for row in &rows {
            let t = fitted.report.points.iter().position(|p| p.point == row.point).unwrap();
            let value = curve(&body.curves()[t], row.component).value(row.deflection_m);
            assert!((value - row.value).abs() <= 1e-9 * (1.0 + row.value), "{row:?}: {value}");
        }
        assert_eq!(Body::from_bytes(&body.to_bytes().unwrap()).unwrap(), body);
        assert_eq!(
            fit(&surface, &rows, &FitOptions { interpolation, default_friction: None }).unwrap(),
            fitted
        );
    }
}

#[test]
fn messages_name_the_line_the_point_and_the_hint() {
    let surface = plane();
    let refused = |change: &dyn Fn(&mut Vec<Sample>), options: FitOptions, words: &[&str]| {
        let mut rows = three();
        change(&mut rows);
        let message = fit(&surface, &rows, &options).unwrap_err().in_file("rows.csv".as_ref()).to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
        assert!(message.starts_with("rows.csv: ") && !message.contains('\n'), "{message}");
    };
    let at = |i: usize, change: &dyn Fn(&mut Sample), words: &[&str]| {
        refused(&|rows| change(&mut rows[i]), FitOptions::default(), words);
    };
    // Lines 2 to 5 are the normal rows of `a`, 6 to 8 the lateral ones, 9 and 10 friction.
    at(2, &|r| r.deflection_m = -1e-3, &["line 4 (point `a`)", "-0.001 m", "into the body"]);
    at(2, &|r| r.deflection_m = f64::NAN, &["line 4", "NaN"]);
    at(2, &|r| r.deflection_m = 11.0, &["line 4", "11 m"]);
    at(2, &|r| r.value = f64::NAN, &["line 4", "normal value is NaN"]);
    at(8, &|r| r.value = -0.1, &["line 10", "friction value is -0.1", "negative"]);
    at(2, &|r| r.weight = Some(f64::NAN), &["line 4", "weight"]);
    at(2, &|r| r.position_m[1] = f64::INFINITY, &["line 4", "position"]);
    at(2, &|r| r.position_m[1] = 0.0, &["line 4 (point `a`)", "in line 2", "one position"]);
    at(0, &|r| r.value = 0.01, &["line 2", "normal force at zero deflection is 0.01 N", "subtract"]);
    at(2, &|r| r.value = 0.04, &["line 4 (point `a`)", "0.04 N after 0.05 N", "smooth the samples first"]);
    at(5, &|r| r.value = 0.5, &["line 7", "lateral force is 0.5 N after 0.5 N", "must increase", "smooth"]);
    at(
        2,
        &|r| r.deflection_m = 1e-3,
        &["line 4", "normal value at 0.001 m is 0.4, but 0.05 in line 3", "mean"],
    );
    at(5, &|r| r.deflection_m = 1e-3, &["line 7", "lateral value", "line 6"]);

    let without =
        |component: Component| move |rows: &mut Vec<Sample>| rows.retain(|r| r.component != component);
    refused(&without(Component::Normal), FitOptions::default(), &["no normal row", "one point at least"]);
    refused(&without(Component::Lateral), FitOptions::default(), &["no lateral row"]);
    let words = ["no friction row", "friction rows", "--friction", "[friction] coefficient"];
    refused(&without(Component::Friction), FitOptions::default(), &words);
    let negative = FitOptions { default_friction: Some(-0.1), ..Default::default() };
    refused(&without(Component::Friction), negative, &["friction coefficient", "-0.1"]);
    refused(&|rows| rows.clear(), FitOptions::default(), &["samples", "there is none"]);
    refused(
        &|rows| rows.truncate(1),
        FitOptions::default(),
        &["line 2", "only normal row", "larger deflections"],
    );
    let twin = |rows: &mut Vec<Sample>| add(rows, "d", [2.2, 1.9], Component::Normal, &NORMAL);
    refused(
        &twin,
        FitOptions::default(),
        &["line 29 (point `d`)", "node 44", "point `a` (line 2)", "remove"],
    );
    let many = |rows: &mut Vec<Sample>| {
        let samples: Vec<_> = (1..600).map(|i| (i as f64 * 1e-5, i as f64)).collect();
        add(rows, "d", [10.0, 10.0], Component::Normal, &samples);
    };
    refused(&many, FitOptions::default(), &["different normal deflections", "512", "same deflections"]);
}

#[test]
fn parts_without_rows_are_named() {
    let mut mesh = TriangleMesh::default();
    for z in [0.0, 1.0] {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([DVec3::new(0.0, 0.0, z), DVec3::new(1.0, 0.0, z), DVec3::new(0.0, 1.0, z)]);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    let surface = Surface::build(&mesh, f64::INFINITY).unwrap();
    let mut rows = Vec::new();
    add(&mut rows, "low", [0.0, 0.0], Component::Normal, &NORMAL);
    add(&mut rows, "low", [0.0, 0.0], Component::Lateral, &LATERAL);
    add(&mut rows, "high", [0.0, 0.0], Component::Normal, &NORMAL);
    rows.iter_mut().filter(|row| row.point == "high").for_each(|row| row.position_m[2] = 1.0);
    let options = FitOptions { default_friction: Some(0.2), ..Default::default() };
    let message = fit(&surface, &rows, &options).unwrap_err().to_string();
    assert!(message.contains("(point `high`)") && message.contains("add lateral rows"), "{message}");
    rows.retain(|row| row.point == "low");
    assert!(
        matches!(fit(&surface, &rows, &options), Err(FitError::Invalid { place, .. }) if place.contains("node 3"))
    );
}

#[test]
fn a_file_becomes_a_body() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rows.csv");
    let mut text = String::from("# three points\npoint,x_m,y_m,z_m,component,deflection_m,value\n");
    for r in three() {
        let [x, y, z] = r.position_m;
        text += &format!("{},{x},{y},{z},{},{},{}\n", r.point, r.component, r.deflection_m, r.value);
    }
    std::fs::write(&path, text).unwrap();
    let (surface, options) = (plane(), FitOptions::default());
    let read = read_samples(&path).unwrap();
    assert_eq!(fit(&surface, &read, &options).unwrap(), fit(&surface, &three(), &options).unwrap());
}

/// Run with `--ignored --nocapture`.
#[test]
#[ignore = "a figure, not a check"]
fn a_thousand_points_on_a_million_nodes() {
    let n = 1000;
    let at = |i: u32, j: u32| i + (n + 1) * j;
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| DVec3::new(i as f64, j as f64, 0.0) * 1e-4));
    let squares = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    let triangles = squares.flat_map(|(i, j)| {
        [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    });
    let mesh = TriangleMesh { positions: positions.collect(), triangles: triangles.collect() };
    let surface = Surface::build(&mesh, f64::INFINITY).unwrap();
    let mut rows = Vec::new();
    for p in 0..1000 {
        let at = [(p * 37 % 1000) as f64 * 0.1, (p * 91 % 997) as f64 * 0.1];
        for (component, samples) in [
            (Component::Normal, &NORMAL[..]),
            (Component::Lateral, &LATERAL),
            (Component::Friction, &FRICTION),
        ] {
            add(&mut rows, &p.to_string(), at, component, samples);
        }
    }
    let clock = std::time::Instant::now();
    let fitted = fit(&surface, &rows, &FitOptions::default()).unwrap();
    println!("{} nodes, {} points: {:?}", fitted.blends.len(), fitted.responses.len(), clock.elapsed());
}
