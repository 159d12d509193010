//! Bodies as `fit` and `precompute` make them, by the same functions: fewer test points than nodes, so that nodes blend up to
//! three and elements more (six are seen, nine could be); curves of several knots through samples; friction that varies with depth; a tensor that is
//! blended like the curves; a point or a sphere for a tool.
#![allow(dead_code, reason = "each test file uses its own part")]

use super::{Random, fibres};
use glam::DVec3;
use palpate_body::{
    BlendWeights, Body, BodyParts, Interpolation, Provenance, SlipRule, Surface, Tensor, Tool, TriangleMesh,
    tensor,
};
use palpate_identify::{Amount, Component, Fit, FitOptions, Sample, fit, test_points};

/// Of what kind.
#[derive(Clone, Copy, Debug)]
pub struct Making {
    /// Stiffnesses lie within so much of their mean, as a part of it.
    pub spread: f64,
    /// The largest coefficient of friction, about.
    pub friction: f64,
    /// Whether friction may be 0: at touch, at the deepest, or at some test points.
    pub bare: bool,
    /// So many times as stiff laterally in one direction as in the other.
    pub ratio: f64,
    /// The spherical tool's radius, m; 0 for a point.
    pub radius_m: f64,
    /// The slip rule.
    pub slip: SlipRule,
}

/// A body on `mesh`: most or some of its vertices are test points, or one in some twenty.
pub fn made_body(mesh: &TriangleMesh, random: &mut Random, making: &Making) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    let vertices = surface.positions().len();
    let share = if random.below(2) == 0 { random.range(1.2, 3.0) } else { random.range(10.0, 30.0) };
    let count = ((vertices as f64 / share) as usize).clamp(3, 300);
    let chosen = |count| test_points(&surface, &vec![true; vertices], Amount::Count(count), None).unwrap();
    // As `precompute` chooses them; or few of those, one in each part at least, and others wherever somebody measured.
    let points = if random.below(2) == 0 {
        chosen(count)
    } else {
        let mut points = chosen(3);
        let mut others: Vec<u32> = (0..vertices as u32).filter(|n| !points.contains(n)).collect();
        for i in 0..count - 3 {
            let left = others.len() - i;
            others.swap(i, i + random.below(left));
        }
        points.extend_from_slice(&others[..count - 3]);
        points
    };
    let interpolation = if random.below(4) == 0 { Interpolation::Linear } else { Interpolation::Pchip };
    let options = FitOptions { interpolation, default_friction: None };
    let samples = samples(&surface, &points, random, making);
    let Fit { blends, responses, test_point_nodes, .. } = fit(&surface, &samples, &options).unwrap();
    let lateral_tensors = (making.ratio != 1.0).then(|| {
        let along = fibres(random, making.ratio);
        let at = |n: u32| along(surface.positions()[n as usize], surface.inward_normals()[n as usize]);
        let own: Vec<Tensor> = test_point_nodes.iter().map(|&n| at(n)).collect();
        blends.iter().zip(surface.inward_normals()).map(|(mix, &u)| mixed(mix, &own, u)).collect()
    });
    let tool = if making.radius_m > 0.0 { Tool::Sphere { radius_m: making.radius_m } } else { Tool::Point };
    let (slip, provenance) = (making.slip, Provenance::default());
    Body::new(BodyParts {
        surface,
        blends,
        responses,
        test_point_nodes,
        coupled: None,
        lateral_tensors,
        tool,
        slip,
        tank: false,
        partial_slip: false,
        provenance,
    })
    .unwrap()
}

/// A node's tensor: the mean of its test points', in its own plane.
fn mixed(mix: &BlendWeights, own: &[Tensor], u: DVec3) -> Tensor {
    let part = |i: usize| (0..3).map(|j| mix.weights[j] * own[mix.test_points[j] as usize][i]).sum();
    tensor::from_stiffness(&[0, 1, 2, 3, 4, 5].map(part), u).unwrap()
}

/// Rows at shared deflections: forces like the paper's, bent, and friction with a profile over depth.
fn samples(surface: &Surface, points: &[u32], random: &mut Random, making: &Making) -> Vec<Sample> {
    let knots = |random: &mut Random, end: f64| -> Vec<f64> {
        let count = 3 + random.below(5);
        let even = |k: usize| (k as f64 + 0.3 * random.range(-1.0, 1.0)) / count as f64;
        let mut knots: Vec<f64> = (1..=count).map(even).collect();
        knots.iter_mut().for_each(|k| *k *= end);
        knots
    };
    let (deep, wide) = (knots(random, 8e-3), knots(random, 6e-3));
    let waves = [(); 4].map(|()| random.direction() * 60.0);
    let (kz, kr) = (random.range(300.0, 900.0), random.range(300.0, 900.0));
    // Stiffening, up to twice as much at the end; laterally also softening.
    let (bend, side) = (random.range(0.0, 1.0), random.range(-0.4, 1.0));
    let mut profile: Vec<f64> = deep.iter().map(|_| random.range(0.4, 1.0)).collect();
    let bare = if making.bare { random.below(4) } else { 0 };
    let count = profile.len();
    match bare {
        1 => profile[0] = 0.0,
        2 => profile[count - 1] = 0.0,
        _ => {}
    }
    let mut rows = Vec::new();
    for &node in points {
        let p = surface.positions()[node as usize];
        let wave = |i: usize| 1.0 + making.spread * libm::sin(p.dot(waves[i]));
        let slick = bare == 3 && libm::sin(p.dot(waves[3])) > 0.0;
        let mut row = |component, deflection_m: f64, value: f64| {
            rows.push(Sample {
                point: node.to_string(),
                position_m: p.to_array(),
                component,
                deflection_m,
                value,
                direction: None,
                weight: None,
                line: 1,
            });
        };
        for (&d, part) in deep.iter().zip(&profile) {
            row(Component::Normal, d, 100.0 * kz * wave(0) * d * d * (1.0 + bend * d / 8e-3));
            let friction = if slick { 0.0 } else { making.friction * part * wave(2) };
            row(Component::Friction, d, friction);
        }
        for &d in &wide {
            row(Component::Lateral, d, kr * wave(1) * d * (1.0 + side * d / 6e-3));
        }
    }
    rows
}
