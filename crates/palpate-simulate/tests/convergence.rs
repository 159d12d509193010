//! Order of convergence against an exact solution: a Kelvin solution (a point force in an infinite linear body: Love
//! 1944, § 130) whose point lies outside a cube. The surface is moved as the solution says, the inside must follow.

mod support;

use glam::DVec3;
use palpate_simulate::{Fixed, Material, Model};
use std::sync::atomic::AtomicBool;
use support::{cube, fine_rule, hold, shape};

/// Displacement and its gradient: u_i = A (F_i (3 − 4ν)/r + x_i (F·x)/r³), whatever A is.
fn point_force(at: DVec3, poisson: f64) -> (DVec3, [[f64; 3]; 3]) {
    let source = DVec3::new(-0.4, 1.5, 0.2);
    let force = DVec3::new(0.02, -0.01, 0.03);
    let x = at - source;
    let (r, along, k) = (x.length(), force.dot(x), 3.0 - 4.0 * poisson);
    let u = force * (k / r) + x * (along / r.powi(3));
    let gradient = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let delta = if i == j { 1.0 } else { 0.0 };
            -k * force[i] * x[j] / r.powi(3) + (delta * along + x[i] * force[j]) / r.powi(3)
                - 3.0 * x[i] * along * x[j] / r.powi(5)
        })
    });
    (u, gradient)
}

/// The same less a linear field, so that three corners of the cube stay where they are: supports that hold it.
fn kelvin(at: DVec3, poisson: f64) -> (DVec3, [[f64; 3]; 3]) {
    let corner = |p| point_force(p, poisson).0;
    let origin = corner(DVec3::ZERO);
    let columns = [corner(DVec3::X) - origin, corner(DVec3::Y) - origin, DVec3::ZERO];
    let (u, gradient) = point_force(at, poisson);
    let u = u - origin - columns[0] * at.x - columns[1] * at.y;
    (u, std::array::from_fn(|i| std::array::from_fn(|j| gradient[i][j] - columns[j][i])))
}

/// Relative errors: of the displacement and the strain in L2, and of the strain in the energy's norm.
fn errors(n: usize, poisson: f64) -> [f64; 3] {
    let mesh = cube(n);
    let material = Material::linear(1e4, poisson).unwrap();
    let moduli = material.small_strain();
    let exact: Vec<DVec3> = mesh.positions.iter().map(|p| kelvin(*p, poisson).0).collect();
    let surface = mesh.boundary().nodes;
    let held: Vec<Fixed> = surface.iter().map(|&node| Fixed { node, axes: [true; 3] }).collect();
    let supports = hold(&mesh, |p| [[DVec3::ZERO, DVec3::X, DVec3::Y].contains(&p); 3]);
    let model = Model::new(mesh.clone(), vec![material], &supports).unwrap();
    let driven: Vec<(Fixed, DVec3)> = held.iter().map(|f| (*f, exact[f.node as usize])).collect();
    let found = model.displace(&driven, 1, &AtomicBool::new(false)).unwrap().unwrap().displacement_m;
    let mut sums = [[0.0; 2]; 3];
    for element in &mesh.elements {
        let p = element.map(|n| mesh.positions[n as usize]);
        for (at, weight) in fine_rule() {
            let (values, slopes) = shape(at);
            let place: DVec3 = p.iter().zip(values).map(|(p, n)| *p * n).sum();
            let mut jacobian = glam::DMat3::ZERO;
            for (p, s) in p.iter().zip(&slopes) {
                jacobian.x_axis += *p * s[0];
                jacobian.y_axis += *p * s[1];
                jacobian.z_axis += *p * s[2];
            }
            let weight = weight * jacobian.determinant() / 6.0;
            let inverse = jacobian.inverse().transpose();
            let (u, gradient) = kelvin(place, poisson);
            let mut difference = u;
            let mut strain = gradient;
            for ((&node, n), s) in element.iter().zip(values).zip(&slopes) {
                let g = inverse * DVec3::from_array(*s);
                let own = found[node as usize];
                difference -= own * n;
                for i in 0..3 {
                    for j in 0..3 {
                        strain[i][j] -= own[i] * g[j];
                    }
                }
            }
            let norms = |h: &[[f64; 3]; 3]| {
                let trace = h[0][0] + h[1][1] + h[2][2];
                let mut shear = 0.0;
                for (i, row) in h.iter().enumerate() {
                    for (j, value) in row.iter().enumerate() {
                        shear += (0.5 * (value + h[j][i])).powi(2);
                    }
                }
                [shear, moduli.shear_pa * shear + 0.5 * moduli.lambda_pa() * trace * trace]
            };
            sums[0][0] += weight * difference.length_squared();
            sums[0][1] += weight * u.length_squared();
            for (k, h) in [strain, gradient].iter().enumerate() {
                for (sum, norm) in sums[1..].iter_mut().zip(norms(h)) {
                    sum[k] += weight * norm;
                }
            }
        }
    }
    sums.map(|[error, whole]| (error / whole).sqrt())
}

/// Prints the table, and gives the orders of the last refinement.
fn orders(poisson: f64, cells: &[usize]) -> [f64; 3] {
    println!("| ν | cells | displacement, L2 | order | strain, L2 | order | energy norm | order |");
    let (mut last, mut orders): (Option<[f64; 3]>, _) = (None, [f64::NAN; 3]);
    for &n in cells {
        let found = errors(n, poisson);
        if let Some(last) = last {
            orders = [0, 1, 2].map(|i| (last[i] / found[i]).log2());
        }
        print!("| {poisson} | {n} |");
        for (error, order) in found.iter().zip(orders) {
            print!(" {error:.1e} | {order:.2} |");
        }
        println!();
        last = Some(found);
    }
    orders
}

/// Third order in the displacement, second in the strain. From ν = 0.45 on part of the volumetric energy acts on the
/// element's mean, one value for each: the more it is, the nearer it comes to second and first order.
#[test]
fn orders_of_convergence() {
    for (poisson, least) in
        [(0.3, [2.7, 1.8, 1.8]), (0.45, [2.7, 1.8, 1.8]), (0.49, [2.7, 1.8, 1.7]), (0.499, [2.5, 1.6, 1.6])]
    {
        let found = orders(poisson, &[4, 8]);
        assert!(found.iter().zip(least).all(|(f, l)| *f > l), "ν = {poisson}: orders {found:?}");
    }
}

#[test]
#[ignore = "a table; half a minute"]
fn table_of_convergence() {
    for poisson in [0.3, 0.45, 0.49, 0.499] {
        orders(poisson, &[3, 6, 12]);
    }
}
