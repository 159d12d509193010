//! The nodal gradients against a field whose gradient is known.

use glam::DVec3;
use palpate_body::body::share_knots;
use palpate_body::{
    Body, BodyParts, DecoupledEnergies, Known, NodeMix, Provenance, Response, SlipRule, Surface, Tool,
    TriangleMesh,
};

/// A right triangle of 3 cm, each side cut into `cells`, tilted in space.
fn triangle(cells: usize) -> (TriangleMesh, Vec<[f64; 3]>) {
    let (mut mesh, mut mixes) = (TriangleMesh::default(), Vec::new());
    let (e1, e2) = (DVec3::new(0.02, 0.01, -0.02), DVec3::new(-0.01, 0.02, 0.005));
    let number = |i: usize, j: usize| (0..j).map(|j| cells + 1 - j).sum::<usize>() + i;
    for j in 0..=cells {
        for i in 0..=cells - j {
            let (u, v) = (i as f64 / cells as f64, j as f64 / cells as f64);
            mesh.positions.push(e1 * u + e2 * v);
            mixes.push([(1.0 - u - v).max(0.0), u, v]);
            if i + j < cells {
                mesh.triangles.push([number(i, j), number(i + 1, j), number(i, j + 1)].map(|n| n as u32));
            }
            if i + j + 1 < cells {
                let upper = [number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
                mesh.triangles.push(upper.map(|n| n as u32));
            }
        }
    }
    (mesh, mixes)
}

fn body(mesh: &TriangleMesh, mixes: Vec<NodeMix>, responses: Vec<Response>) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    Body::new(BodyParts {
        test_point_nodes: (0..responses.len() as u32).collect(),
        surface,
        mixes,
        responses: share_knots(responses).unwrap(),
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip: SlipRule::Consistent,
        provenance: Provenance::default(),
    })
    .unwrap()
}

/// Over a plane whose responses are mixed of three, the energy is linear, and every node's gradient is its gradient: from
/// three test points as from nodes that are all test points of their own.
#[test]
fn a_linear_field_has_its_gradient_everywhere() {
    let response = |k: f64| Response::paper(k, 1.5 * k, 0.2, 6e-3, 4e-3).unwrap();
    let corners = [400.0, 700.0, 1000.0];
    let (mesh, mixes) = triangle(6);
    let stiffness = |w: &[f64; 3]| w[0] * corners[0] + w[1] * corners[1] + w[2] * corners[2];
    let shared = mixes.iter().map(|&weights| NodeMix { test_points: [0, 1, 2], weights }).collect();
    let shared = body(&mesh, shared, corners.map(response).to_vec());
    let own = (0..mixes.len() as u32).map(NodeMix::own).collect();
    let own = body(&mesh, own, mixes.iter().map(|w| response(stiffness(w))).collect());

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
            let strain = responses.strain([depth, lateral], rows);
            for (n, node) in body.nodes().iter().enumerate() {
                // Here the gradient has the same share of the energy at every deflection: the bound is no more than that.
                let share = exact.length() / energy(stiffness(&mixes[n]));
                let most = f64::from(body.prepared_gradients().most(n as u32).energy);
                assert!((1.0..1.0 + 1e-5).contains(&(most / share)), "node {n}: {most} {share}");
                for known in [Known::NONE, strain.known(node.test_points)] {
                    let energies = DecoupledEnergies { strain, known };
                    let gradient = body.prepared_gradients().energy(n as u32, node.test_points[0], &energies);
                    let error = (gradient.as_dvec3() - exact).length();
                    assert!(error < 2e-6 * exact.length(), "node {n}: {gradient} {exact}");
                }
            }
        }
    }
    let beyond = shared.prepared_gradients().turn(u32::MAX, glam::Vec3A::X);
    assert_eq!(beyond, glam::Vec3A::ZERO);
}
