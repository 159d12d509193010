//! The measure measured: simulators whose law is known.

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{
    Body, BodyParts, Curve, Extension, Interpolation, Provenance, Response, SlipRule, Tool, tensor,
};
use palpate_build::validate::{Measure, Source, Trial, Validation, sticking, validate};
use palpate_engine::{Contact, ToolState};
use palpate_identify::{Amount, spread, test_points};
use palpate_simulate::{Path, PointPaths, PointPlan, State, Stop};
use std::sync::atomic::{AtomicUsize, Ordering};

const NORMAL_MAX: f64 = 6e-3;
const LATERAL_MAX: f64 = 4e-3;

/// A ball with 40 test points, stiffer towards +x.
fn body(radius_m: f64) -> Body {
    let resolution = Resolution { edge_length_mm: Some(4.0), ..Default::default() };
    let surface = Shape::Sphere { radius_mm: 30.0 }.surface(resolution).unwrap();
    let nodes =
        test_points(&surface, &vec![true; surface.positions().len()], Amount::Count(40), None).unwrap();
    let curve = |knots: [f64; 4], values: [f64; 4], extension| {
        Curve::through(&knots, &values, Interpolation::Pchip, extension).unwrap()
    };
    let responses = nodes.iter().map(|&n| {
        let k = 1.0 + surface.positions()[n as usize].x * 15.0;
        Response {
            normal: curve([0.0, 2e-3, 4e-3, 6e-3], [0.0, 0.2, 0.7, 1.6].map(|f| k * f), Extension::Linear),
            lateral: curve([0.0, 1e-3, 2e-3, 4e-3], [0.0, 0.15, 0.25, 0.4].map(|f| k * f), Extension::Linear),
            friction: curve([0.0, 2e-3, 4e-3, 6e-3], [0.3; 4], Extension::Constant),
        }
    });
    Body::new(BodyParts {
        blends: spread(&surface, &nodes).unwrap(),
        responses: responses.collect(),
        surface,
        test_point_nodes: nodes,
        coupled: None,
        lateral_tensors: None,
        tool: if radius_m > 0.0 { Tool::Sphere { radius_m } } else { Tool::Point },
        slip: SlipRule::Paper,
        tank: true,
        provenance: Provenance::default(),
    })
    .unwrap()
}

fn trial(body: &Body, paths: usize) -> Trial {
    Trial {
        paths,
        seed: 7,
        normal_max_m: NORMAL_MAX,
        lateral_max_m: LATERAL_MAX,
        steps: 8,
        drag_depths_m: vec![0.6 * NORMAL_MAX],
        touchable: body.nodes().iter().map(|n| n.position.z > -10e-3).collect(),
    }
}

/// Normal and lateral force of the body's own curves at a surface point.
fn law(body: &Body, plan: &PointPlan, depth: f64, aside: DVec3) -> [DVec3; 2] {
    let at = body.nearest(plan.point, 1e-6).unwrap().at;
    let nodes = body.elements()[at.element as usize].nodes;
    let mixed = |value: &dyn Fn(&Response) -> f64| -> f64 {
        (0..3).map(|j| at.n[j] * value(&body.node_response(nodes[j] as usize).unwrap())).sum()
    };
    let tensors = body.element_tensors(at.element);
    let a: DVec3 = (0..3).map(|j| tensor::apply(tensors[j], aside) * at.n[j]).sum();
    let a = a.reject_from(plan.inward);
    let rho = aside.dot(a).sqrt();
    let lateral = if rho > 0.0 { a * (mixed(&|r| r.lateral.value(rho)) / rho) } else { DVec3::ZERO };
    [plan.inward * mixed(&|r| r.normal.value(depth)), lateral]
}

/// A simulator of a law: force from depth and lateral displacement.
fn paths(plan: &PointPlan, force: impl Fn(f64, DVec3) -> DVec3) -> PointPaths {
    let state = |depth_m: f64, distance_m: f64, aside: DVec3| State {
        depth_m,
        distance_m,
        force_n: force(depth_m, aside),
        ..State::default()
    };
    let press = plan.depths.iter().map(|&d| state(d, 0.0, DVec3::ZERO)).collect();
    let drag = |d: &palpate_simulate::Drag| {
        let depth = plan.depths[d.from];
        Path {
            states: d.distances.iter().map(|&s| state(depth, s, d.direction * s)).collect(),
            stopped: None,
        }
    };
    PointPaths { press: Path { states: press, stopped: None }, drags: plan.drags.iter().map(drag).collect() }
}

fn of(v: &Validation, source: Source) -> [f64; 2] {
    let s = v.sources.iter().find(|s| s.source == source).unwrap();
    [s.normal.worst_percent, s.lateral.worst_percent]
}

fn try_with(body: &Body, count: usize, scale: [f64; 2], growth: f64) -> Validation {
    let simulate = |plan: &PointPlan| {
        Some(paths(plan, |depth, aside| {
            let [n, t] = law(body, plan, depth, aside);
            n * scale[0] + t * (scale[1] * (1.0 + growth * depth))
        }))
    };
    validate(body, &trial(body, count), &simulate, &|| ()).unwrap()
}

#[test]
fn the_bodys_own_law_has_no_error() {
    for radius in [0.0, 5e-3] {
        let body = body(radius);
        let v = try_with(&body, 40, [1.0; 2], 0.0);
        assert_eq!((v.paths.len(), v.failed, v.cut_short), (40, 0, 0));
        let [n, t] = of(&v, Source::Body);
        assert!(n < 0.01 && t < 0.01, "radius {radius}: {n} % {t} %");
        let [n, t] = of(&v, Source::OwnDepth);
        assert!(n < 1e-6 && t < 1e-6, "{n} {t}");
        assert_eq!(v.summary.normal, v.sources[1].normal);
    }
}

#[test]
fn known_differences_are_found() {
    let body = body(0.0);
    // The simulation is a tenth stiffer than the body: of a force F the body lacks F/11.
    let v = try_with(&body, 30, [1.1, 1.1], 0.0);
    for p in &v.paths {
        let share = |of: fn(&DVec3, DVec3) -> f64| {
            let u = DVec3::from_array(p.inward);
            p.states.iter().map(|c| of(&c.simulated_n, u)).fold(0.0, f64::max) / p.largest_force_n
        };
        let normal = share(|f, u| f.dot(u)) * 100.0 / 11.0;
        let lateral = share(|f, u| f.reject_from(u).length()) * 100.0 / 11.0;
        assert!((p.normal_error_percent - normal).abs() < 0.01, "{} {normal}", p.normal_error_percent);
        assert!((p.lateral_error_percent - lateral).abs() < 0.01, "{} {lateral}", p.lateral_error_percent);
        assert!(p.normal_rms_percent < p.normal_error_percent && p.normal_rms_percent > 0.0);
        assert!((p.normal_error_n - p.normal_error_percent / 100.0 * p.largest_force_n).abs() < 1e-12);
    }
    // State by state: pressing, the normal force grows from 0 to what it is all along the drag.
    let normal = v.summary.normal;
    let mut all: Vec<f64> = Vec::new();
    for p in &v.paths {
        let u = DVec3::from_array(p.inward);
        all.extend(p.states.iter().map(|c| c.simulated_n.dot(u) / p.largest_force_n * 100.0 / 11.0));
    }
    all.sort_by(f64::total_cmp);
    let middle = (all[(all.len() - 1) / 2] + all[all.len() / 2]) / 2.0;
    assert!((normal.states.median_percent - middle).abs() < 0.01, "{normal:?} {middle}");
    assert!(normal.states.p95_percent <= normal.worst_percent);
    assert!(normal.states.median_percent < normal.median_percent);
    // The place's own responses know of it.
    assert!(of(&v, Source::Own).iter().all(|e| *e < 0.5), "{:?}", of(&v, Source::Own));

    // Stiffer laterally with depth: dragged from their own depth the responses are right, from another not.
    let v = try_with(&body, 30, [1.0, 1.0], 150.0);
    let ([n, own], [_, depth]) = (of(&v, Source::Own), of(&v, Source::OwnDepth));
    assert!(n < 1e-6 && own > 5.0 && depth < 1e-6, "{n} {own} {depth}");
}

#[test]
fn paths_are_random_held_out_and_the_same_for_a_seed() {
    let body = body(0.0);
    let v = try_with(&body, 60, [1.0; 2], 0.0);
    let again = try_with(&body, 60, [1.0; 2], 0.0);
    assert_eq!(serde_json::to_string(&v).unwrap(), serde_json::to_string(&again).unwrap());
    let fewer = try_with(&body, 10, [1.0; 2], 0.0);
    assert_eq!(fewer.paths[..], v.paths[..10]);
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(single.install(|| try_with(&body, 10, [1.0; 2], 0.0)).paths, fewer.paths);
    let (mut low, mut high) = ([f64::INFINITY; 2], [0.0f64; 2]);
    for p in &v.paths {
        let point = DVec3::from_array(p.point_m);
        for &n in body.test_point_nodes() {
            assert!(body.nodes()[n as usize].position.distance(point) > 1e-3);
        }
        assert!(
            point.z > -10e-3 && DVec3::from_array(p.direction).dot(DVec3::from_array(p.inward)).abs() < 1e-9
        );
        for (i, share) in [p.depth_m / NORMAL_MAX, p.distance_m / LATERAL_MAX].into_iter().enumerate() {
            (low[i], high[i]) = (low[i].min(share), high[i].max(share));
        }
    }
    assert!(low[0] >= 0.1 && low[0] < 0.2 && high[0] > 0.9 && high[0] <= 1.0, "{low:?} {high:?}");
    assert!(low[1] >= 0.25 && low[1] < 0.35 && high[1] > 0.9 && high[1] <= 1.0, "{low:?} {high:?}");
}

#[test]
fn directions_matter_where_the_body_says_so() {
    let plain = body(0.0);
    let tensors =
        plain.nodes().iter().map(|n| tensor::along(DVec3::Z, 1.9, n.inward).unwrap_or(tensor::IDENTITY));
    let body = Body::new(BodyParts { lateral_tensors: Some(tensors.collect()), ..plain.parts() }).unwrap();
    let v = try_with(&body, 40, [1.0; 2], 0.0);
    let ([_, with], [_, without]) = (of(&v, Source::Body), of(&v, Source::Isotropic));
    assert!(with < 0.1 && without > 5.0, "{with} {without}");
}

#[test]
fn a_path_that_ends_early_counts_as_far_as_it_went() {
    let body = body(0.0);
    let calls = AtomicUsize::new(0);
    let simulate = |plan: &PointPlan| {
        calls.fetch_add(1, Ordering::Relaxed);
        let mut p = paths(plan, |depth, aside| law(&body, plan, depth, aside).into_iter().sum());
        let stop = Some(Stop { at_m: 1e-3, why: "it snapped".into() });
        if plan.point.y > 0.0 {
            p.press.states.truncate(2);
            p.press.stopped = stop;
            p.drags.iter_mut().for_each(|d| d.states.clear());
        } else if plan.point.y < -20e-3 {
            p = PointPaths { press: Path { states: Vec::new(), stopped: stop }, drags: Vec::new() };
        }
        Some(p)
    };
    let v = validate(&body, &trial(&body, 40), &simulate, &|| ()).unwrap();
    assert_eq!(calls.load(Ordering::Relaxed), 40);
    assert!(
        v.failed > 0 && v.cut_short > 5 && v.paths.len() + v.failed == 40,
        "{} {}",
        v.failed,
        v.cut_short
    );
    let cut = v.paths.iter().find(|p| p.stopped.is_some()).unwrap();
    assert!(
        cut.states.len() == 2 && cut.stopped.as_ref().unwrap().contains("the press at 1.000 mm: it snapped")
    );
    assert!(of(&v, Source::Body).iter().all(|e| *e < 0.01));

    let stopped = validate(&body, &trial(&body, 4), &|_| None, &|| ()).unwrap_err().to_string();
    assert!(stopped.contains("stopped before"), "{stopped}");
    let nothing = validate(&body, &trial(&body, 4), &|_| Some(PointPaths::default()), &|| ()).unwrap_err();
    assert!(nothing.to_string().contains("no state on any path"), "{nothing}");
    let mut none = trial(&body, 4);
    none.touchable.fill(false);
    let nowhere = validate(&body, &none, &|_| None, &|| ()).unwrap_err().to_string();
    assert!(nowhere.contains("can be touched"), "{nowhere}");
    none.touchable.pop();
    assert!(validate(&body, &none, &|_| None, &|| ()).unwrap_err().to_string().contains("the body's spec"));
}

#[test]
fn a_sticking_body_answers_as_before_and_sticks() {
    let body = body(0.0);
    let rough = sticking(&body, NORMAL_MAX).unwrap();
    for (a, b) in body.curves().iter().zip(rough.curves()) {
        for i in 0..80 {
            let d = f64::from(i) * 1e-4;
            assert!((a.normal.value(d) - b.normal.value(d)).abs() < 1e-12);
            assert!((a.lateral.value(d) - b.lateral.value(d)).abs() < 1e-12);
        }
    }
    let mut contact = Contact::new(&rough);
    contact.step(&rough, &ToolState::at([0.0, 0.0, 31e-3]), 1e-3);
    let pressed = contact.step(&rough, &ToolState::at([0.0, 0.0, 29e-3]), 1e-3);
    let c = pressed.contact.unwrap().position_m;
    let dragged = contact.step(&rough, &ToolState::at([9e-3, 0.0, 29e-3]), 1e-3);
    assert_eq!(dragged.contact.unwrap().position_m, c);
    assert!(dragged.force_n[0] < -0.4);
    let v = try_with(&body, 8, [1.1, 0.9], 0.0);
    for measure in Measure::ALL {
        let table = v.markdown(measure);
        assert!(table.lines().count() == 6 && table.contains("| the body | "));
    }
    let folder = tempfile::tempdir().unwrap();
    palpate_cli::plot::save(&folder.path().join("a.png"), &palpate_cli::charts(&v)).unwrap();
    let mut csv = Vec::new();
    v.csv(&mut csv).unwrap();
    assert_eq!(String::from_utf8(csv).unwrap().lines().count(), 1 + 8 * 16);
}
