//! Distances from tools: known points, brute force, differences, and what any distance must satisfy.

use glam::{DMat3, DQuat, DVec3, dvec3};
use palpate_simulate::tool::{Distance, Placement, RigidTool, Shape};
use std::{f64::consts::PI, sync::Arc};

const RADIUS: f64 = 0.01;

fn tools() -> Vec<RigidTool> {
    vec![
        RigidTool::Sphere { radius_m: RADIUS },
        RigidTool::flat_punch(RADIUS),
        RigidTool::FlatPunch { radius_m: RADIUS, edge_m: 0.004 },
        RigidTool::FlatPunch { radius_m: RADIUS, edge_m: RADIUS },
        RigidTool::Cone { half_angle_rad: 0.5, tip_radius_m: 0.002 },
        RigidTool::Cone { half_angle_rad: 1.2, tip_radius_m: 0.001 },
        RigidTool::Capsule { radius_m: 0.006, length_m: 0.01 },
    ]
}

/// Points about the tip, the same every time.
fn points(count: usize) -> Vec<DVec3> {
    let mut seed = 3u64;
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..count).map(|_| dvec3(0.02 * next(), 0.02 * next(), 0.025 * next() - 0.008)).collect()
}

/// Points of the tool's outline (distance from the axis, height), as the documentation draws it.
fn outline(tool: &RigidTool) -> Vec<[f64; 2]> {
    let mut all = Vec::new();
    let count = 20_000;
    let mut arc = |middle: [f64; 2], radius: f64, from: f64, to: f64| {
        // Angles from +z.
        for i in 0..=count {
            let angle = from + (to - from) * i as f64 / count as f64;
            all.push([middle[0] + radius * angle.sin(), middle[1] + radius * angle.cos()]);
        }
    };
    let mut line = Vec::new();
    let mut straight = |a: [f64; 2], b: [f64; 2]| {
        for i in 0..=count {
            let t = i as f64 / count as f64;
            line.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        }
    };
    match *tool {
        RigidTool::Sphere { radius_m } => arc([0.0, -radius_m], radius_m, 0.0, PI),
        RigidTool::Capsule { radius_m, length_m } => {
            arc([0.0, -radius_m], radius_m, 0.0, PI / 2.0);
            straight([radius_m, -radius_m], [radius_m, -radius_m - length_m]);
            arc([0.0, -radius_m - length_m], radius_m, PI / 2.0, PI);
        }
        RigidTool::FlatPunch { radius_m, edge_m } => {
            straight([0.0, 0.0], [radius_m - edge_m, 0.0]);
            arc([radius_m - edge_m, -edge_m], edge_m, 0.0, PI / 2.0);
            straight([radius_m, -edge_m], [radius_m, -0.1]);
        }
        RigidTool::Cone { half_angle_rad, tip_radius_m } => {
            arc([0.0, -tip_radius_m], tip_radius_m, 0.0, PI / 2.0 - half_angle_rad);
            let start =
                [tip_radius_m * half_angle_rad.cos(), tip_radius_m * half_angle_rad.sin() - tip_radius_m];
            let (sin, cos) = half_angle_rad.sin_cos();
            straight(start, [start[0] + 0.1 * sin, start[1] - 0.1 * cos]);
        }
        RigidTool::Other(_) => {}
    }
    all.append(&mut line);
    all
}

#[test]
fn the_nearest_point_of_the_outline_is_that_far() {
    for tool in tools() {
        let outline = outline(&tool);
        for p in points(60) {
            let r = p.x.hypot(p.y);
            let nearest =
                outline.iter().map(|[x, z]| (x - r).hypot(z - p.z)).fold(f64::INFINITY, |m, d| m.min(d));
            let found = tool.distance(p).value;
            // The outline is sampled at 5 µm at most.
            assert!((found.abs() - nearest).abs() < 2e-6, "{tool:?} at {p}: {found}, outline {nearest}");
        }
    }
}

#[test]
fn inside_is_negative_and_the_tip_is_the_origin() {
    for tool in tools() {
        for (height, sign) in [(1e-5, 1.0), (-1e-5, -1.0), (-5e-3, -1.0), (1.0, 1.0)] {
            let found = tool.distance(height * DVec3::Z).value;
            assert_eq!(found.signum(), sign, "{tool:?} at {height}");
        }
        let tip = tool.distance(DVec3::ZERO);
        assert!(tip.value.abs() < 1e-17 && tip.gradient == DVec3::Z, "{tool:?}: {tip:?}");
    }
}

#[test]
fn known_points() {
    let close =
        |found: f64, expected: f64| assert!((found - expected).abs() < 1e-15, "{found}, not {expected}");
    let punch = RigidTool::FlatPunch { radius_m: 0.01, edge_m: 0.001 };
    close(punch.distance(dvec3(0.004, 0.003, 0.002)).value, 0.002);
    close(punch.distance(dvec3(0.0, 0.03, -0.05)).value, 0.02);
    // Over the middle of the edge's arc, 3-4-5.
    close(punch.distance(dvec3(0.009 + 0.003, 0.0, 0.003)).value, 0.004);
    close(punch.distance(dvec3(0.0, 0.0, -0.004)).value, -0.004);
    close(punch.distance(dvec3(0.0, -0.008, -0.004)).value, -0.002);

    let capsule = RigidTool::Capsule { radius_m: 0.002, length_m: 0.01 };
    close(capsule.distance(dvec3(0.003, 0.004, -0.007)).value, 0.003);
    close(capsule.distance(dvec3(0.003, 0.0, -0.016)).value, 0.003);
    close(capsule.distance(dvec3(0.0, 0.0, -0.014)).value, 0.0);

    let angle = 0.6f64.asin();
    let cone = RigidTool::Cone { half_angle_rad: angle, tip_radius_m: 0.002 };
    // On the flank, and 5 mm out from it along its normal.
    let (sin, cos) = (0.6, 0.8);
    let on = dvec3(0.002 * cos + 0.01 * sin, 0.0, -0.002 + 0.002 * sin - 0.01 * cos);
    close(cone.distance(on).value, 0.0);
    close(cone.distance(on + 0.005 * dvec3(cos, 0.0, sin)).value, 0.005);

    // The curvature of a ball seen from outside.
    let hessian = RigidTool::Sphere { radius_m: RADIUS }.distance(dvec3(0.0, 0.0, 0.01)).hessian;
    assert!(hessian.abs_diff_eq(DMat3::from_diagonal(dvec3(50.0, 50.0, 0.0)), 1e-12), "{hessian}");
}

#[test]
fn derivatives_are_those_of_the_value() {
    for tool in tools() {
        let mut checked = 0;
        for p in points(300) {
            let Distance { gradient, hessian, .. } = tool.distance(p);
            assert!((gradient.length() - 1.0).abs() < 1e-14, "{tool:?} at {p}: |∇d| = {}", gradient.length());
            // Along the gradient the distance grows evenly.
            assert!(
                (hessian * gradient).length() < 1e-11 * (1.0 + hessian.x_axis.length() * 1e2),
                "{tool:?}"
            );
            assert!(hessian.abs_diff_eq(hessian.transpose(), 1e-9), "{tool:?}: {hessian}");
            let step = 1e-7;
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let (ahead, behind) = (tool.distance(p + step * axis), tool.distance(p - step * axis));
                // Not where the surface's piece changes in between, nor too near the axis or a middle.
                let turned = (ahead.gradient - behind.gradient) / (2.0 * step);
                let change = (ahead.hessian - behind.hessian) * axis;
                if change.length() > 1.0 || p.x.hypot(p.y) < 1e-3 {
                    continue;
                }
                let slope = (ahead.value - behind.value) / (2.0 * step);
                assert!((slope - gradient.dot(axis)).abs() < 1e-6, "{tool:?} at {p}: {slope}, {gradient}");
                let expected = hessian * axis;
                assert!(
                    (turned - expected).length() < 1e-3,
                    "{tool:?} at {p}: {turned}, expected {expected}"
                );
                checked += 1;
            }
        }
        assert!(checked > 500, "{tool:?}: only {checked} points were smooth");
    }
}

#[test]
fn distances_never_jump() {
    let points = points(200);
    for tool in tools() {
        for a in &points {
            for b in &points {
                let difference = (tool.distance(*a).value - tool.distance(*b).value).abs();
                assert!(difference <= a.distance(*b) * (1.0 + 1e-12) + 1e-17, "{tool:?}: {a} to {b}");
            }
        }
        // Outside, and inside up to a punch's rounding, the gradient doesn't jump either.
        for p in &points {
            let here = tool.distance(*p);
            let limit = if let RigidTool::FlatPunch { edge_m, .. } = tool { -0.9 * edge_m } else { -5e-4 };
            if here.value > limit {
                let shift = 1e-9 * dvec3(0.6, -0.48, 0.64);
                let there = tool.distance(*p + shift);
                assert!((here.gradient - there.gradient).length() < 1e-4, "{tool:?} at {p}");
            }
        }
    }
}

#[test]
fn a_placed_tool_is_the_tool_moved() {
    for tool in tools() {
        for (n, p) in points(40).into_iter().enumerate() {
            let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.3 * n as f64, 1.1, -0.2 * n as f64);
            let turn = DMat3::from_quat(rotation);
            let placement = Placement { tip: dvec3(0.1, -0.2, 0.05), rotation: turn };
            let own = tool.distance(p);
            let found = placement.distance_at(&tool, placement.tip + rotation * p);
            assert!((found.value - own.value).abs() < 1e-15);
            assert!((found.gradient - rotation * own.gradient).length() < 1e-9, "{tool:?} at {p}");
            let expected = turn * own.hessian * turn.transpose();
            let size = 1.0 + own.hessian.x_axis.length() + own.hessian.y_axis.length();
            assert!(found.hessian.abs_diff_eq(expected, 1e-8 * size), "{tool:?} at {p}");
        }
        for inward in [DVec3::Z, DVec3::NEG_Z, DVec3::X, dvec3(0.6, 0.0, -0.8)] {
            let placement = Placement::pressing(DVec3::ONE, inward);
            let ahead = placement.distance_at(&tool, DVec3::ONE + 0.003 * inward);
            assert!(
                (ahead.value - 0.003).abs() < 1e-15 && (ahead.gradient - inward).length() < 1e-12,
                "{ahead:?}"
            );
        }
    }
}

/// Everything below a plane.
#[derive(Debug)]
struct Below;

impl Shape for Below {
    fn distance(&self, point: DVec3) -> (f64, DVec3) {
        (point.z, DVec3::Z)
    }
}

#[test]
fn other_shapes_join() {
    let tool = RigidTool::Other(Arc::new(Below));
    let found = Placement::pressing(DVec3::ZERO, DVec3::X).distance_at(&tool, dvec3(0.25, 4.0, 0.0));
    assert!((found.value - 0.25).abs() < 1e-15 && found.hessian == DMat3::ZERO);
}

#[test]
fn lengths_are_checked() {
    let refused = |tool: RigidTool, place: &str| {
        let message = tool.validate().unwrap_err().to_string();
        assert!(message.starts_with(&format!("{place}: ")), "{message}");
    };
    refused(RigidTool::Sphere { radius_m: 0.0 }, "radius");
    refused(RigidTool::Sphere { radius_m: f64::NAN }, "radius");
    refused(RigidTool::flat_punch(-0.01), "radius");
    refused(RigidTool::FlatPunch { radius_m: 0.01, edge_m: 0.0 }, "edge");
    refused(RigidTool::FlatPunch { radius_m: 0.01, edge_m: 0.011 }, "edge");
    refused(RigidTool::Cone { half_angle_rad: 1.6, tip_radius_m: 0.01 }, "half_angle");
    refused(RigidTool::Cone { half_angle_rad: 0.5, tip_radius_m: 0.0 }, "tip_radius");
    refused(RigidTool::Capsule { radius_m: 0.01, length_m: f64::INFINITY }, "length");
    for tool in tools() {
        tool.validate().unwrap();
    }
}
