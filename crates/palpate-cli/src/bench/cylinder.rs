//! The bodies that are timed.

use anyhow::Result;
use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{
    BlendWeights, Body, BodyParts, CoupledLaw, Curve, Extension, Potential, Provenance, SlipRule, Tool,
    tensor,
};
use palpate_build::law::{AnalyticLaw, Variation};
use palpate_build::spec::{Deflection, Friction};

/// m
pub const RADIUS: f64 = 0.03;
/// m
pub const LENGTH: f64 = 0.1;
/// The paper's mesh of about 500 patches: where the test points are.
const AROUND: usize = 24;
const ALONG: usize = 11;

/// The paper's law at the mean.
const LAW: AnalyticLaw = AnalyticLaw {
    normal_n_per_m: 600.0,
    lateral_n_per_m: 500.0,
    variation: Variation { around: 0.5, along: 0.2 },
};

/// A tube of about this many triangles with the responses of the coarse one's 288 nodes: at 528 triangles every node
/// is its own test point, elsewhere a node blends the three of the coarse triangle that it lies in, in (θ, z). Laterally
/// it is `ratio` times as stiff along the axis as around it.
///
/// # Errors
/// So many triangles that a body can't have them.
pub fn cylinder(triangles: usize, ratio: f64) -> Result<Body> {
    let scale = (triangles as f64 / (2 * AROUND * ALONG) as f64).sqrt();
    let around = (AROUND as f64 * scale).round().max(3.0) as usize;
    let along = (triangles as f64 / (2 * around) as f64).round().max(1.0) as usize;
    let shape = Shape::Cylinder { radius_mm: RADIUS * 1e3, length_mm: LENGTH * 1e3, caps: false };
    let grid = |around: usize, along: usize| Resolution {
        edge_length_mm: None,
        around: Some(around as u32),
        along: Some(along as u32),
    };
    let coarse = shape.mesh(grid(AROUND, ALONG))?;
    let deflection = Deflection { normal_max_m: 8e-3, lateral_max_m: 8e-3, steps: 8 };
    let responses = LAW.responses(&coarse.positions, &Friction::Constant(0.3), deflection)?;
    let surface = shape.surface(grid(around, along))?;
    let radial = surface.positions().iter().map(|p| -DVec3::new(p.x, p.y, 0.0).normalize_or_zero()).collect();
    let surface = surface.with_inward_normals(radial)?;
    let tensor = |u: &DVec3| tensor::along(DVec3::Z, ratio, *u).unwrap_or(tensor::IDENTITY);
    let tensors = surface.inward_normals().iter().map(tensor).collect();
    let blends = (0..=along).flat_map(|row| (0..around).map(move |column| (row, column)));
    let blends = blends.map(|(row, column)| {
        blend(column as f64 / around as f64 * AROUND as f64, row as f64 / along as f64 * ALONG as f64)
    });
    let test_point_nodes = (0..=ALONG).flat_map(|row| (0..AROUND).map(move |column| (row, column)));
    let nearest = |i: usize, of: usize, to: usize| (i * to + of / 2) / of;
    let test_point_nodes = test_point_nodes.map(|(row, column)| {
        (nearest(row, ALONG, along) * around + nearest(column, AROUND, around) % around) as u32
    });
    Ok(Body::new(BodyParts {
        blends: blends.collect(),
        test_point_nodes: test_point_nodes.collect(),
        surface,
        responses,
        coupled: None,
        lateral_tensors: Some(tensors),
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })?)
}

/// The same tube with a coupled law at its test points: F of the same normal force, a lateral stiffness that grows with the
/// depth and differs by `ratio` between the directions, and every further term of a size that organs show.
///
/// # Errors
/// As [`cylinder`].
pub fn coupled_cylinder(triangles: usize, ratio: f64) -> Result<Body> {
    let body = cylinder(triangles, 1.0)?;
    let knots = [0.0, 1e-3, 2e-3, 4e-3, 6e-3, 8e-3];
    let potential = |(&node, response): (&u32, &palpate_body::Response)| {
        let u = body.nodes()[node as usize].inward;
        let [kz, kr] = [response.normal.value(8e-3) / 64e-4, response.lateral.slope(0.0)];
        // From a share of itself at no depth to its full size, both ends level.
        let ramp = |full: f64, start: f64| {
            let values = [0.0, 0.2, 0.4, 0.7, 0.9, 1.0].map(|t| full * (start + (1.0 - start) * t));
            let slopes = [0.0, 200.0, 180.0, 125.0, 75.0, 0.0].map(|s| full * (1.0 - start) * s);
            Curve::hermite(&knots, &values, &slopes, Extension::Constant)
        };
        let press = knots.map(|d| 100.0 * kz * d * d * d / 3.0);
        let force = knots.map(|d| 100.0 * kz * d * d);
        let stiff = kr * 2.0 / (1.0 + ratio);
        Ok(Potential {
            tangents: [DVec3::Z, u.cross(DVec3::Z)],
            press: Curve::hermite(&knots, &press, &force, Extension::Quadratic)?,
            offset: [ramp(0.02 * kz * 6.4e-3, 0.0)?, ramp(-0.012 * kz * 6.4e-3, 0.0)?],
            stiffness: [ramp(stiff * ratio, 0.5)?, ramp(0.05 * kr, 0.5)?, ramp(stiff, 0.5)?],
            cubic: [ramp(2e3, 0.5)?, ramp(-1e3, 0.5)?, ramp(1e3, 0.5)?, ramp(-2e3, 0.5)?],
            quartic: ramp(2e6, 0.5)?,
            friction: Curve::hermite(
                &knots,
                &[response.friction.value(0.0); 6],
                &[0.0; 6],
                Extension::Constant,
            )?,
            curvature: [0.0, 0.0, 1.0 / RADIUS],
        })
    };
    let potentials = body.test_point_nodes().iter().zip(body.curves()).map(potential);
    let potentials = potentials.collect::<Result<_, palpate_body::BodyError>>()?;
    let parts = BodyParts { responses: Vec::new(), lateral_tensors: None, ..body.parts() };
    Ok(Body::new(BodyParts { coupled: Some(CoupledLaw { range_m: 4e-3, potentials }), ..parts })?)
}

/// The blend at (u, v) in cells of the coarse grid: area coordinates in the half of the cell's square that holds it.
fn blend(u: f64, v: f64) -> BlendWeights {
    let (j, row) = ((u as usize).min(AROUND - 1), (v as usize).min(ALONG - 1));
    let (u, v) = (u - j as f64, v - row as f64);
    let node = |row: usize, column: usize| (row * AROUND + column % AROUND) as u32;
    let (near, far) = (node(row, j), node(row + 1, j + 1));
    let (test_points, weights) = if u >= v {
        ([near, node(row, j + 1), far], [1.0 - u, u - v, v])
    } else {
        ([near, far, node(row + 1, j)], [1.0 - v, u, v - u])
    };
    // A node of the coarse grid itself is found to the last digit or so.
    match weights.iter().position(|w| *w > 1.0 - 1e-12) {
        Some(own) => BlendWeights::own(test_points[own]),
        None => BlendWeights { test_points, weights },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_coupled_tube_is_a_body() {
        for triangles in [528, 528 * 16] {
            assert!(coupled_cylinder(triangles, 1.9).unwrap().is_coupled());
        }
    }

    #[test]
    fn finer_meshes_have_the_same_responses() {
        let coarse = cylinder(528, 1.0).unwrap();
        assert_eq!((coarse.elements().len(), coarse.nodes().len()), (528, 288));
        assert!(coarse.nodes().iter().enumerate().all(|(i, n)| n.test_points == [i as u32; 3]));
        let fine = cylinder(528 * 16, 1.9).unwrap();
        assert_eq!(fine.elements().len(), 528 * 16);
        assert!(coarse.is_isotropic() && !fine.is_isotropic());
        for (test_point, &node) in fine.test_point_nodes().iter().enumerate() {
            let node = fine.nodes()[node as usize];
            assert!((node.position - coarse.nodes()[test_point].position).length() < 1e-12);
            assert_eq!(node.test_points, [test_point as u32; 3]);
        }
        for node in fine.nodes() {
            assert!(node.weights.iter().all(|w| *w >= 0.0));
            assert!((node.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        assert!((3000..3600).contains(&cylinder(3300, 1.0).unwrap().elements().len()));
    }
}
