//! The nodal gradients against a field whose gradient is known, and their bound.

use glam::DVec3;
use palpate_body::body::share_knots;
use palpate_body::{
    BlendWeights, Body, BodyParts, Curve, DecoupledEnergies, EnergyCache, Extension, Interpolation,
    Provenance, Response, SlipRule, Surface, Tool, TriangleMesh,
};

/// A right triangle of 3 cm, each side cut into `cells`, tilted in space.
fn triangle(cells: usize) -> (TriangleMesh, Vec<[f64; 3]>) {
    let (mut mesh, mut blends) = (TriangleMesh::default(), Vec::new());
    let (e1, e2) = (DVec3::new(0.02, 0.01, -0.02), DVec3::new(-0.01, 0.02, 0.005));
    let number = |i: usize, j: usize| (0..j).map(|j| cells + 1 - j).sum::<usize>() + i;
    for j in 0..=cells {
        for i in 0..=cells - j {
            let (u, v) = (i as f64 / cells as f64, j as f64 / cells as f64);
            mesh.positions.push(e1 * u + e2 * v);
            blends.push([(1.0 - u - v).max(0.0), u, v]);
            if i + j < cells {
                mesh.triangles.push([number(i, j), number(i + 1, j), number(i, j + 1)].map(|n| n as u32));
            }
            if i + j + 1 < cells {
                let upper = [number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
                mesh.triangles.push(upper.map(|n| n as u32));
            }
        }
    }
    (mesh, blends)
}

fn body(mesh: &TriangleMesh, blends: Vec<BlendWeights>, responses: Vec<Response>) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    Body::new(BodyParts {
        test_point_nodes: (0..responses.len() as u32).collect(),
        surface,
        blends,
        responses: share_knots(responses).unwrap(),
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip: SlipRule::Consistent,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

/// Over a plane whose responses are blended of three, the energy is linear, and every node's gradient is its gradient: from
/// three test points as from nodes that are all test points of their own.
#[test]
fn a_linear_field_has_its_gradient_everywhere() {
    let response = |k: f64| Response::paper(k, 1.5 * k, 0.2, 6e-3, 4e-3).unwrap();
    let corners = [400.0, 700.0, 1000.0];
    let (mesh, blends) = triangle(6);
    let stiffness = |w: &[f64; 3]| w[0] * corners[0] + w[1] * corners[1] + w[2] * corners[2];
    let shared = blends.iter().map(|&weights| BlendWeights { test_points: [0, 1, 2], weights }).collect();
    let shared = body(&mesh, shared, corners.map(response).to_vec());
    let own = (0..blends.len() as u32).map(BlendWeights::own).collect();
    let own = body(&mesh, own, blends.iter().map(|w| response(stiffness(w))).collect());

    for (depth, lateral) in [(2e-3, 1e-3), (5e-3, 0.0), (9e-3, 6e-3), (-1e-3, 2e-3)] {
        let energy = |k: f64| {
            let r = response(k);
            r.normal.integral(depth).max(0.0) + r.lateral.integral(lateral)
        };
        // W = W₀ + s u + t v over the plane's coordinates u and v.
        let [w0, w1, w2] = corners.map(energy);
        let (e1, e2) = (DVec3::new(0.02, 0.01, -0.02), DVec3::new(-0.01, 0.02, 0.005));
        let (a, b, c) = (e1.length_squared(), e1.dot(e2), e2.length_squared());
        let (s, t) = (w1 - w0, w2 - w0);
        let exact = (e1 * (c * s - b * t) + e2 * (a * t - b * s)) / (a * c - b * b);
        for body in [&shared, &own] {
            let responses = body.responses();
            let rows = (&responses.depth_rows([0; 3], depth), &responses.lateral_rows([0; 3], lateral));
            let basis = responses.basis([depth, lateral], rows);
            for (n, node) in body.nodes().iter().enumerate() {
                // Here the gradient has the same share of the energy at every deflection: the bound is no more than that.
                let share = exact.length() / energy(stiffness(&blends[n]));
                let most = f64::from(body.prepared_gradients().bound(n as u32).energy);
                assert!((1.0..1.0 + 1e-5).contains(&(most / share)), "node {n}: {most} {share}");
                for cache in [EnergyCache::NONE, basis.cache(node.test_points)] {
                    let energies = DecoupledEnergies { basis, cache };
                    let gradient = body.prepared_gradients().energy(n as u32, node.test_points[0], &energies);
                    let error = (gradient.as_dvec3() - exact).length();
                    assert!(error < 2e-6 * exact.length(), "node {n}: {gradient} {exact}");
                }
            }
        }
    }
    let beyond = shared.prepared_gradients().frame_gradient(u32::MAX, glam::Vec3A::X);
    assert_eq!(beyond, glam::Vec3A::ZERO);
}

/// A curve that never falls, by the Bernstein ordinates (d0, d1, d2) of its slope: d1² ≤ d0 d2 where d1 is below 0, so that
/// the curve's own ordinates may be below 0.
fn rising(chance: &mut impl FnMut() -> f64, knots: &[f64], flat: bool) -> Curve {
    let (mut y, mut ordinates) = (0.0, Vec::new());
    for i in 1..knots.len() {
        let d0 = if flat && i == 1 { 0.0 } else { chance() };
        let d2 = (1.0 + 5.0 * chance()) * chance();
        let d1 = if chance() < 0.5 { -0.999 * (d0 * d2).sqrt() * chance().sqrt() } else { chance() };
        let third = (knots[i] - knots[i - 1]) * 500.0 / 3.0;
        ordinates.push([y, y + d0 * third, y + (d0 + d1) * third, y + (d0 + d1 + d2 + 1e-3) * third]);
        y = ordinates[i - 1][3];
    }
    Curve::from_ordinates(knots, &ordinates, Extension::Linear).unwrap()
}

/// The bound squared the ordinates of the node's own force, which may be below 0 though the force is not: then it was no
/// bound, and the rule `consistent` could take a state for one within the limit that was not.
#[test]
fn the_bound_holds_at_all_deflections() {
    let mut seed = 11u64;
    let mut chance = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    let (mesh, blends) = triangle(2);
    let (mut compared, mut infinite, mut below_zero, mut nearest) = (0, 0, 0, 0.0f64);
    for case in 0..400 {
        let depth: Vec<f64> = [0.0, 0.5e-3, 2e-3, 6e-3][..2 + case % 3].to_vec();
        let count = if case % 2 == 0 { 3 } else { blends.len() };
        let responses: Vec<Response> = (0..count)
            .map(|_| {
                let mut force = 0.0;
                let steps = depth.iter().zip([&0.0].into_iter().chain(&depth)).map(|(to, from)| to - from);
                let values: Vec<f64> = steps
                    .map(|step| {
                        force += step * (300.0 + 900.0 * chance());
                        force
                    })
                    .collect();
                let pchip =
                    |y: &[f64]| Curve::through(&depth, y, Interpolation::Pchip, Extension::Linear).unwrap();
                // With a flat start where the samples bend that much.
                let bent: Vec<f64> = depth.iter().zip(&values).map(|(d, v)| v * d * d * 1e5).collect();
                let friction = vec![0.2; depth.len()];
                let curve = |chance: &mut _| match case / 3 % 4 {
                    0 => pchip(&bent),
                    1 => pchip(&values),
                    k => rising(chance, &depth, k == 2),
                };
                Response {
                    normal: curve(&mut chance),
                    lateral: rising(&mut chance, &depth, false),
                    friction: Curve::through(&depth, &friction, Interpolation::Linear, Extension::Constant)
                        .unwrap(),
                }
            })
            .collect();
        let negative = |r: &Response| {
            r.normal.ordinates().iter().chain(r.lateral.ordinates()).flatten().any(|b| *b < 0.0)
        };
        below_zero += usize::from(responses.iter().any(negative));
        let blends: Vec<BlendWeights> = match count {
            3 => blends.iter().map(|&weights| BlendWeights { test_points: [0, 1, 2], weights }).collect(),
            _ => (0..count as u32).map(BlendWeights::own).collect(),
        };
        let body = body(&mesh, blends, responses);
        let responses = body.responses();
        for i in 0..=60 {
            for (d, r) in [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let at = 8e-3 * (f64::from(i) / 60.0).powi(2);
                let (d, r) = (d * at, r * at);
                let rows = (&responses.depth_rows([0; 3], d), &responses.lateral_rows([0; 3], r));
                let basis = responses.basis([d, r], rows);
                for (n, node) in body.nodes().iter().enumerate() {
                    let gradients = body.prepared_gradients();
                    let most = f64::from(gradients.bound(n as u32).energy);
                    let energies = node.test_points.map(|t| basis.energy(t));
                    let energy: f64 = (0..3).map(|k| node.weights[k] * energies[k]).sum();
                    let gradient = gradients.energy(
                        n as u32,
                        node.test_points[0],
                        &DecoupledEnergies { basis, cache: EnergyCache::NONE },
                    );
                    if most == f64::INFINITY {
                        infinite += 1;
                        continue;
                    }
                    compared += 1;
                    // In single precision; its terms may cancel.
                    let largest =
                        (0..body.curves().len() as u32).map(|t| basis.energy(t)).fold(0.0, f64::max);
                    let (size, rounding) = (f64::from(gradient.length()), 1e-6 * largest / 5e-3);
                    assert!(
                        size <= most * energy + rounding,
                        "case {case}, node {n}, {at} m: {size} {}",
                        most * energy
                    );
                    if size > 1e2 * rounding {
                        nearest = nearest.max(size / (most * energy));
                    }
                }
            }
        }
    }
    // Infinite only where it has to be: a flat start beside one that is none. Elsewhere it is near what is reached.
    assert!(
        compared > 4 * infinite && below_zero > 50 && nearest > 0.9,
        "{compared} {infinite} {below_zero} {nearest}"
    );
}
