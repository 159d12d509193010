//! Bodies with a coupled law for the engine's tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use super::Random;
use glam::DVec3;
use palpate_body::{
    BlendWeights, Body, BodyParts, CoupledLaw, Curve, Extension, Potential, Provenance, SlipRule, Surface,
    Tool, TriangleMesh,
};

/// Up to which lateral deflection the potentials of these bodies are said to be found, m.
pub const RANGE_M: f64 = 2e-3;

/// Potentials that vary smoothly over the body by `spread` (0 to 1), with all their terms: pressed straight in the force leans
/// laterally by up to a third, and the stuck stiffness grows with the depth and differs by up to 1 : 3 between directions.
pub fn coupled(mesh: &TriangleMesh, random: &mut Random, spread: f64, friction: f64, radius_m: f64) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    let waves: [DVec3; 12] = std::array::from_fn(|_| random.direction() * 60.0);
    let (kz, kr) = (random.range(300.0, 900.0), random.range(300.0, 900.0));
    let size = [
        1.0,
        random.range(-0.25, 0.25),
        random.range(-0.25, 0.25),
        1.0,
        random.range(-0.3, 0.3),
        random.range(0.7, 1.5),
        random.range(-4e3, 4e3),
        random.range(-4e3, 4e3),
        random.range(-4e3, 4e3),
        random.range(-4e3, 4e3),
        random.range(0.5e7, 2e7),
        friction,
    ];
    let knots = [0.0, 5e-4, 2e-3, 5e-3, 8e-3];
    let potential = |(p, u): (&DVec3, &DVec3)| {
        let common = 1.0 + spread * libm::sin(p.dot(waves[0]));
        // Stiffer here than there as a whole, and a little in each term.
        let wave = |i: usize| common * if i == 0 { 1.0 } else { 1.0 + 0.2 * libm::sin(p.dot(waves[i])) };
        // From a share of itself at no depth to its full size, both ends level.
        let ramp = |i: usize, start: f64, unit: f64| {
            let full = size[i] * wave(i) * unit;
            let at = [0.0, 0.1, 0.4, 0.8, 1.0].map(|t| full * (start + (1.0 - start) * t));
            let slope = [0.0, 0.2, 0.18, 0.1, 0.0].map(|s| full * (1.0 - start) * s * 1e3);
            Curve::hermite(&knots, &at, &slope, Extension::Constant).unwrap()
        };
        let k = 100.0 * kz * wave(0);
        let (press, force) = (knots.map(|d| k * d * d * d / 3.0), knots.map(|d| k * d * d));
        let t1 = u.any_orthonormal_vector();
        let t1 = (t1 + u.cross(t1) * 0.3).normalize();
        Potential {
            tangents: [t1, u.cross(t1)],
            press: Curve::hermite(&knots, &press, &force, Extension::Quadratic).unwrap(),
            offset: [1, 2].map(|i| ramp(i, 0.0, kz * 8e-4)),
            stiffness: [ramp(3, 0.4, kr), ramp(4, 0.4, kr), ramp(5, 0.4, kr)],
            cubic: [6, 7, 8, 9].map(|i| ramp(i, 0.3, 1.0)),
            quartic: ramp(10, 0.5, 1.0),
            friction: Curve::hermite(
                &knots,
                &[friction; 5].map(|f| f * (1.0 + spread * libm::sin(p.dot(waves[11])))),
                &[0.0; 5],
                Extension::Constant,
            )
            .unwrap(),
            curvature: [25.0, 8.0, -15.0].map(|k| k * spread * (1.0 + libm::sin(p.dot(waves[0])))),
        }
    };
    let potentials = surface.positions().iter().zip(surface.inward_normals()).map(potential).collect();
    let count = surface.positions().len() as u32;
    Body::new(BodyParts {
        blends: (0..count).map(BlendWeights::own).collect(),
        surface,
        responses: Vec::new(),
        test_point_nodes: (0..count).collect(),
        coupled: Some(CoupledLaw { range_m: RANGE_M, potentials }),
        lateral_tensors: None,
        tool: if radius_m > 0.0 { Tool::Sphere { radius_m } } else { Tool::Point },
        slip: SlipRule::Consistent,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

#[allow(dead_code, reason = "each test file uses its own part")]
/// The same body over few of its test points: every node blends the three nearest of those by their distance, so that elements
/// blend three to nine.
pub fn sparse(body: &Body, every: usize) -> Body {
    let mut parts = body.parts();
    // Three at least.
    let every = every.min(parts.test_point_nodes.len() / 3).max(1);
    let kept: Vec<usize> = (0..parts.test_point_nodes.len()).step_by(every).collect();
    let at: Vec<DVec3> =
        kept.iter().map(|&t| body.nodes()[parts.test_point_nodes[t] as usize].position).collect();
    parts.blends = body
        .nodes()
        .iter()
        .map(|node| {
            let mut near: Vec<usize> = (0..kept.len()).collect();
            near.sort_by(|&a, &b| at[a].distance(node.position).total_cmp(&at[b].distance(node.position)));
            let [a, b, c] = [near[0], near[1], near[2]];
            let mut chosen = [a, b, c];
            chosen.sort_unstable();
            let weights = chosen.map(|t| 1.0 / (at[t].distance(node.position) + 1e-4));
            let sum: f64 = weights.iter().sum();
            BlendWeights { test_points: chosen.map(|t| t as u32), weights: weights.map(|w| w / sum) }
        })
        .collect();
    parts.test_point_nodes = kept.iter().map(|&t| parts.test_point_nodes[t]).collect();
    if let Some(law) = &mut parts.coupled {
        law.potentials = kept.iter().map(|&t| law.potentials[t].clone()).collect();
    }
    Body::new(parts).unwrap()
}

/// A decoupled law of the paper's form as a coupled one: F its normal curve's integral, K = k_r I, all else 0.
pub fn as_coupled(mesh: &TriangleMesh, [kz, kr, friction]: [f64; 3], slip: SlipRule) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    let knots = [0.0, 8e-3];
    let constant = |y: f64| Curve::hermite(&knots, &[y; 2], &[0.0; 2], Extension::Constant).unwrap();
    let potential = |u: &DVec3| {
        let t1 = u.any_orthonormal_vector();
        let (energy, force) =
            (knots.map(|d| 100.0 * kz * d * d * d / 3.0), knots.map(|d| 100.0 * kz * d * d));
        Potential {
            tangents: [t1, u.cross(t1)],
            press: Curve::hermite(&knots, &energy, &force, Extension::Quadratic).unwrap(),
            offset: [constant(0.0), constant(0.0)],
            stiffness: [constant(kr), constant(0.0), constant(kr)],
            cubic: [(); 4].map(|()| constant(0.0)),
            quartic: constant(0.0),
            friction: constant(friction),
            curvature: [0.0; 3],
        }
    };
    let potentials = surface.inward_normals().iter().map(potential).collect();
    let count = surface.positions().len() as u32;
    Body::new(BodyParts {
        blends: (0..count).map(BlendWeights::own).collect(),
        surface,
        responses: Vec::new(),
        test_point_nodes: (0..count).collect(),
        coupled: Some(CoupledLaw { range_m: RANGE_M, potentials }),
        lateral_tensors: None,
        tool: Tool::Point,
        slip,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}
