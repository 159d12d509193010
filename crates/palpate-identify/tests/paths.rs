//! Responses from load paths of a known law.

use glam::{DMat3, DVec3};
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{Body, BodyParts, Provenance, SlipRule, Surface, Tool};
use palpate_identify::{Amount, DragRecord, PathOptions, PointRecord, fit_paths, fit_point, test_points};

const DEPTHS: [f64; 4] = [1e-3, 2e-3, 4e-3, 6e-3];
const DISTANCES: [f64; 4] = [0.5e-3, 1e-3, 2e-3, 4e-3];

fn ball() -> Surface {
    let resolution = Resolution { edge_length_mm: Some(4.0), ..Default::default() };
    Shape::Sphere { radius_mm: 30.0 }.surface(resolution).unwrap()
}

/// A place's law: f_z = n δz², f_t = (f_r(ρ)/ρ) A δ_t, ρ² = δ_t·A δ_t, f_r = k (ρ + 60 ρ²) (1 + g δz), and a force that
/// pressing gives laterally.
struct Law {
    normal: f64,
    lateral: f64,
    /// 1/m.
    growth: f64,
    tensor: DMat3,
    aside: DVec3,
}

impl Law {
    fn isotropic() -> Self {
        Law { normal: 5e4, lateral: 80.0, growth: 0.0, tensor: DMat3::IDENTITY, aside: DVec3::ZERO }
    }

    /// `ratio` times as stiff along `axis` as across.
    fn along(axis: DVec3, ratio: f64, u: DVec3) -> Self {
        let axis = axis.reject_from(u).normalize();
        let across = u.cross(axis);
        let outer = |a: DVec3| DMat3::from_cols(a * a.x, a * a.y, a * a.z);
        let d = (ratio - 1.0) / (ratio + 1.0);
        Law { tensor: DMat3::IDENTITY + outer(axis) * d - outer(across) * d, ..Law::isotropic() }
    }

    fn press(&self, depth: f64, u: DVec3) -> DVec3 {
        u * (self.normal * depth * depth) + self.aside * depth
    }

    fn drag(&self, depth: f64, t: DVec3) -> DVec3 {
        let rho = t.dot(self.tensor * t).sqrt();
        self.tensor * t * (self.lateral * (1.0 + 60.0 * rho) * (1.0 + self.growth * depth))
    }

    fn record(&self, node: u32, u: DVec3, from: &[f64], directions: u32) -> PointRecord {
        let (p, q) = u.any_orthonormal_pair();
        let drags = from.iter().flat_map(|&depth| {
            (0..directions).map(move |i| {
                let angle = f64::from(i) * std::f64::consts::TAU / f64::from(directions) + 0.3;
                let direction = p * angle.cos() + q * angle.sin();
                let rows = DISTANCES.map(|s| (s, self.press(depth, u) + self.drag(depth, direction * s)));
                DragRecord { depth_m: depth, direction, rows: rows.to_vec() }
            })
        });
        let press = DEPTHS.map(|d| (d, self.press(d, u))).to_vec();
        PointRecord { node, inward: u, press, drags: drags.collect(), ..PointRecord::default() }
    }
}

fn matrix(a: &[f64; 6]) -> DMat3 {
    DMat3::from_cols(DVec3::new(a[0], a[3], a[4]), DVec3::new(a[3], a[1], a[5]), DVec3::new(a[4], a[5], a[2]))
}

fn knots() -> Vec<f64> {
    [0.0].into_iter().chain(DISTANCES).collect()
}

#[test]
fn an_isotropic_law_comes_back() {
    let u = DVec3::new(0.48, -0.6, 0.64);
    let fit = fit_point(&Law::isotropic().record(0, u, &[4e-3], 4), &knots(), true).unwrap();
    let lateral = fit.lateral.unwrap();
    for d in DEPTHS {
        assert!((fit.normal.value(d) - 5e4 * d * d).abs() < 1e-12);
    }
    for s in DISTANCES {
        assert!((lateral.value(s) - 80.0 * s * (1.0 + 60.0 * s)).abs() < 1e-12);
    }
    assert_eq!(fit.lateral_tensor, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    let e = fit.errors;
    assert!(e.normal_n < 1e-12 && e.lateral_n < 1e-9 && e.lateral_isotropic_n < 1e-9, "{e:?}");
    assert!((e.largest_force_n - 1.8).abs() < 1e-12 && e.depth_reached_m == 6e-3);
}

#[test]
fn a_tensor_comes_back_from_a_curved_law() {
    let u = DVec3::new(0.48, -0.6, 0.64);
    for (ratio, directions) in [(1.9, 4), (1.9, 8), (5.0, 4), (1.0 / 3.0, 6), (1.9, 3)] {
        let law = Law::along(DVec3::X, ratio, u);
        let fit = fit_point(&law.record(0, u, &[4e-3], directions), &knots(), true).unwrap();
        let off = (matrix(&fit.lateral_tensor) - law.tensor).abs();
        let off = off.x_axis.max_element().max(off.y_axis.max_element()).max(off.z_axis.max_element());
        // Samples lie between the knots: PCHIP's own error is left.
        assert!(off < 0.01, "{ratio} {directions}: {off}");
        let e = &fit.errors;
        let largest = law.drag(4e-3, DVec3::X.reject_from(u).normalize() * 4e-3).length();
        assert!(e.lateral_n < 0.03 * largest && e.lateral_isotropic_n > 8.0 * e.lateral_n, "{ratio}: {e:?}");
    }
    // One direction tells nothing of others.
    let law = Law::along(DVec3::X, 3.0, u);
    let fit = fit_point(&law.record(0, u, &[4e-3], 1), &knots(), true).unwrap();
    assert_eq!(fit.lateral_tensor, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    assert!(fit.errors.lateral_isotropic_n == fit.errors.lateral_n);
}

#[test]
fn stiffening_with_depth_is_averaged_and_its_cost_is_told() {
    let u = DVec3::Z;
    let law = Law { growth: 200.0, normal: 1e-9, ..Law::along(DVec3::X, 1.9, u) };
    let record = law.record(0, u, &[2e-3, 6e-3], 4);
    let fit = fit_point(&record, &knots(), true).unwrap();
    assert!((matrix(&fit.lateral_tensor) - law.tensor).abs_diff_eq(DMat3::ZERO, 0.01));
    // 1.4 and 2.2 times as stiff as at depth 0. Where the lateral force is all there is, a share e of it is missed at
    // one depth and another at the other; equal ranges: least squares of both.
    let (a, b) = (1.4, 2.2);
    let factor = (4.0 / a + 2.0 / b) / (4.0 / (a * a) + 2.0 / (b * b));
    let s = 2e-3;
    let got = fit.lateral.unwrap().value(s) / (80.0 * s * (1.0 + 60.0 * s));
    assert!((got / factor - 1.0).abs() < 0.01, "{got} {factor}");
    let missed = law.drag(6e-3, DVec3::X.reject_from(u) * 4e-3).length() * (1.0 - factor / b);
    assert!((fit.errors.lateral_n / missed - 1.0).abs() < 0.05, "{} {missed}", fit.errors.lateral_n);
}

#[test]
fn a_snap_and_a_force_aside_are_reported() {
    let u = DVec3::Z;
    let law = Law { aside: DVec3::new(3.0, 4.0, 0.0), ..Law::isotropic() };
    let mut record = law.record(0, u, &[4e-3], 4);
    record.press[2].1 = u * 0.1; // 0.2, then 0.1 N
    record.drags[1].rows[3].1 = record.drags[1].rows[1].1;
    let fit = fit_point(&record, &knots(), true).unwrap();
    assert!(fit.normal.least_slope() >= -1e-9 && fit.lateral.as_ref().unwrap().least_slope() > 0.0);
    assert!((fit.normal.value(4e-3) - 0.15).abs() < 1e-12);
    assert!((fit.errors.normal_n - 0.05).abs() < 1e-12, "{:?}", fit.errors);
    assert!((fit.errors.lateral_pressed_n - 5.0 * 6e-3).abs() < 1e-12);
    assert!(fit.errors.lateral_n > 0.02);

    // A lateral force that only falls still gives an increasing curve.
    for drag in &mut record.drags {
        drag.rows.iter_mut().for_each(|(s, f)| *f -= drag.direction * (1e3 * *s));
    }
    assert!(fit_point(&record, &knots(), true).unwrap().lateral.unwrap().least_slope() > 0.0);
}

/// A body from records at test points of a ball that is stiffer along z everywhere.
fn whole(change: impl Fn(usize, &mut PointRecord)) -> (Surface, palpate_identify::PathFit, Vec<u32>) {
    let surface = ball();
    let nodes =
        test_points(&surface, &vec![true; surface.positions().len()], Amount::Count(40), None).unwrap();
    let records: Vec<PointRecord> = (nodes.iter().enumerate())
        .map(|(i, &n)| {
            let u = surface.inward_normals()[n as usize];
            let mut record = Law::along(DVec3::Z, 1.9, u).record(n, u, &[2e-3, 6e-3], 4);
            change(i, &mut record);
            record
        })
        .collect();
    let options = PathOptions { friction: vec![(0.0, 0.2), (5e-3, 0.3)], ..Default::default() };
    let fit = fit_paths(&surface, &records, &options).unwrap();
    (surface, fit, nodes)
}

#[test]
fn nodes_between_mix_turned_tensors_and_make_a_body() {
    let (surface, fit, nodes) = whole(|_, _| ());
    assert_eq!((fit.fit.test_point_nodes.as_slice(), fit.errors.len()), (nodes.as_slice(), 40));
    let (mut worst, mut sum) = (0.0f64, 0.0);
    for (a, &u) in fit.lateral_tensors.iter().zip(surface.inward_normals()) {
        let a = matrix(a);
        assert!((a * u - u).length() < 1e-12);
        assert!((a.x_axis.x + a.y_axis.y + a.z_axis.z - 3.0).abs() < 1e-12);
        if u.z.abs() < 0.8 {
            let exact = Law::along(DVec3::Z, 1.9, u).tensor;
            let along = DVec3::Z.reject_from(u).normalize();
            worst = worst.max((along.dot(a * along) / along.dot(exact * along) - 1.0).abs());
            sum += 1.0;
        }
    }
    assert!(sum > 100.0 && worst < 0.12, "{worst}");
    let friction = &fit.fit.responses[0].friction;
    assert!((friction.value(2.5e-3) - 0.25).abs() < 1e-12 && friction.value(9e-3) == 0.3);
    let body = Body::new(BodyParts {
        surface,
        blends: fit.fit.blends,
        responses: fit.fit.responses,
        test_point_nodes: fit.fit.test_point_nodes,
        coupled: None,
        lateral_tensors: Some(fit.lateral_tensors),
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance { point_errors: fit.errors.clone(), ..Default::default() },
    })
    .unwrap();
    assert!(!body.is_isotropic());
    let again = Body::from_bytes(&body.to_bytes().unwrap()).unwrap();
    assert_eq!(again.provenance().point_errors, fit.errors);
}

#[test]
fn what_was_cut_short_does_what_it_can() {
    let (_, full, _) = whole(|_, _| ());
    let (_, fit, nodes) = whole(|i, record| match i {
        3 => {
            record.press.clear();
            record.drags.clear();
            record.stopped = Some("the first state was not found".into());
        }
        7 => {
            record.press.truncate(2);
            record.drags.truncate(4);
        }
        9 => record.drags.clear(),
        11 => record.drags[2].rows.truncate(1),
        _ => {}
    });
    assert_eq!(fit.fit.test_point_nodes.len(), 39);
    assert!(!fit.fit.test_point_nodes.contains(&nodes[3]));
    let notes = fit.fit.report.notes.join("\n");
    for words in [
        "1 of 40 test points have no pressed",
        "the first state was not found",
        "1 of 39 test points have no drag",
    ] {
        assert!(notes.contains(words), "{notes}");
    }
    // On along its end slope: below the parabola.
    let at = |t: usize, d: f64| fit.fit.responses[t].normal.value(d);
    assert!((at(6, 2e-3) - 0.2).abs() < 1e-9 && at(6, 6e-3) > 0.6 && at(6, 6e-3) < 1.8);
    assert_eq!(fit.errors[6].depth_reached_m, 2e-3);
    // From the points around: all alike here.
    let lateral = |f: &palpate_identify::PathFit, t: usize| f.fit.responses[t].lateral.value(2e-3);
    assert!((lateral(&fit, 8) / lateral(&full, 9) - 1.0).abs() < 0.01);
    assert!((lateral(&fit, 10) / lateral(&full, 11) - 1.0).abs() < 0.1);
}

#[test]
fn mixes_follow_a_guide_that_the_force_goes_with() {
    let surface = ball();
    let nodes =
        test_points(&surface, &vec![true; surface.positions().len()], Amount::Count(40), None).unwrap();
    let compliance_prior: Vec<f64> =
        surface.positions().iter().map(|p| 20.0 * (1.2 + (p.x * 90.0).sin() * (p.y * 70.0).cos())).collect();
    // The force goes as the compliance prior to the power 1.3, and changes slowly besides.
    let stiffness = |n: u32| {
        1e3 * compliance_prior[n as usize].powf(1.3) * (1.0 + 5.0 * surface.positions()[n as usize].z)
    };
    let records: Vec<PointRecord> = (nodes.iter())
        .map(|&n| {
            Law { normal: stiffness(n), ..Law::isotropic() }.record(
                n,
                surface.inward_normals()[n as usize],
                &[2e-3],
                4,
            )
        })
        .collect();
    let errors = |compliance_prior: Option<Vec<f64>>| {
        let fit = fit_paths(&surface, &records, &PathOptions { compliance_prior, ..Default::default() })
            .unwrap()
            .fit;
        let force = |n: usize| -> f64 {
            let blend = &fit.blends[n];
            (0..3)
                .map(|j| blend.weights[j] * fit.responses[blend.test_points[j] as usize].normal.value(4e-3))
                .sum()
        };
        let off = |n: usize| (force(n) / (stiffness(n as u32) * 16e-6) - 1.0).abs();
        let mut errors: Vec<f64> = (0..surface.positions().len()).map(off).collect();
        errors.sort_by(f64::total_cmp);
        (errors[errors.len() / 2], errors[errors.len() * 9 / 10], fit.report.notes)
    };
    let (plain, plain_90, _) = errors(None);
    let (median, p90, notes) = errors(Some(compliance_prior.clone()));
    assert!(
        median < 0.02 && median < plain / 5.0 && p90 < plain_90 / 1.5,
        "{median} {p90}, without {plain} {plain_90}"
    );
    assert!(notes.iter().any(|n| n.contains("its power 1.3") || n.contains("its power 1.2")), "{notes:?}");
    let options =
        PathOptions { compliance_prior: Some(vec![-1.0; compliance_prior.len()]), ..Default::default() };
    assert!(
        fit_paths(&surface, &records, &options).map(|_| ()).unwrap_err().to_string().contains("positive")
    );
}

#[test]
fn a_hollow_has_the_nearest_response() {
    // A small ball within the ball.
    let resolution = Resolution { edge_length_mm: Some(4.0), ..Default::default() };
    let mut mesh = Shape::Sphere { radius_mm: 30.0 }.mesh(resolution).unwrap();
    let inner = Shape::Sphere { radius_mm: 8.0 }.mesh(resolution).unwrap();
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(&inner.positions);
    mesh.triangles.extend(inner.triangles.iter().map(|&[a, b, c]| [first + a, first + c, first + b]));
    let surface = Surface::build(&mesh, f64::INFINITY).unwrap();
    let outside: Vec<bool> = (0..surface.positions().len()).map(|n| n < first as usize).collect();
    let nodes = test_points(&surface, &outside, Amount::Count(12), None).unwrap();
    let records: Vec<PointRecord> = (nodes.iter())
        .map(|&n| Law::isotropic().record(n, surface.inward_normals()[n as usize], &[2e-3], 4))
        .collect();
    let fit = fit_paths(&surface, &records, &PathOptions::default()).unwrap().fit;
    assert!(
        fit.report.notes[0].contains("nodes are on parts of the surface without"),
        "{:?}",
        fit.report.notes
    );
    let lone = fit.blends[first as usize];
    assert_eq!(lone.weights, [1.0, 0.0, 0.0]);
    let p = surface.positions()[first as usize];
    let from = |n: u32| surface.positions()[n as usize].distance(p);
    assert!(nodes.iter().all(|&n| from(n) >= from(nodes[lone.test_points[0] as usize])));
}

#[test]
fn messages_name_the_place_and_the_hint() {
    let surface = ball();
    let u = surface.inward_normals()[5];
    let good = Law::isotropic().record(5, u, &[2e-3], 4);
    let says = |change: &dyn Fn(&mut PointRecord), words: &str| {
        let mut record = good.clone();
        change(&mut record);
        let message =
            fit_paths(&surface, &[record], &PathOptions::default()).map(|_| words).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    };
    says(&|r| r.node = 1 << 20, "nodes");
    says(&|r| r.inward *= 2.0, "unit length");
    says(&|r| r.drags[0].direction = u, "tangent");
    says(&|r| r.press.swap(0, 1), "follows");
    says(&|r| r.press[0].1.x = f64::NAN, "NaN");
    says(&|r| r.drags[1].rows[0].0 = 0.0, "follows");
    says(&|r| r.press.clear(), "none has a pressed state");
    says(&|r| r.drags.clear(), "none has a drag");
    let options = PathOptions { friction: vec![(0.0, -1.0)], ..Default::default() };
    assert!(
        fit_paths(&surface, std::slice::from_ref(&good), &options)
            .unwrap_err()
            .to_string()
            .contains("friction")
    );
    let twice = fit_paths(&surface, &[good.clone(), good], &PathOptions::default())
        .map(|_| ())
        .unwrap_err()
        .to_string();
    assert!(twice.contains("same vertex"), "{twice}");
}
