//! A patch of the liver whose 14 nodes were each simulated with the surface sticking to the tool, as a body with a coupled
//! law; and the simulations with Coulomb friction and without any that it is judged by.
#![allow(dead_code, reason = "each test file uses its own part")]

use glam::DVec3;
use palpate_body::{
    BlendWeights, Body, BodyParts, CoupledLaw, Provenance, SlipRule, Surface, Tool, TriangleMesh,
};
use palpate_identify::{ContactSample, PotentialFit, PotentialOptions, fit_potential};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Of the sphere, m.
pub const RADIUS: f64 = 5e-3;

/// One state of a simulation.
#[derive(Debug, Clone)]
pub struct State {
    pub path: String,
    /// Of the sphere's centre, m.
    pub centre: DVec3,
    /// On the body, N.
    pub force: DVec3,
}

/// A node that simulations pressed at.
#[derive(Debug, Clone)]
pub struct Place {
    pub position: DVec3,
    pub inward: DVec3,
    pub states: Vec<State>,
}

impl Place {
    /// Any two tangents.
    pub fn tangents(&self) -> [DVec3; 2] {
        let t1 = self.inward.any_orthonormal_vector();
        [t1, self.inward.cross(t1)]
    }

    /// Its states in its own frame.
    pub fn samples(&self) -> Vec<ContactSample> {
        let (u, [t1, t2]) = (self.inward, self.tangents());
        let of = |state: &State| {
            // Sticking, the contact point stays at the node.
            let deflection = state.centre + u * RADIUS - self.position;
            ContactSample {
                depth_m: deflection.dot(u),
                lateral_m: [t1.dot(deflection), t2.dot(deflection)],
                force_n: [u, t1, t2].map(|axis| axis.dot(state.force)),
                weight: 1.0,
            }
        };
        self.states.iter().map(of).collect()
    }
}

/// The nodes of one of the simulations' files; `None`, and why, where it is not there.
pub fn places(file: &str) -> Option<Vec<Place>> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/references/frictional");
    let path = PathBuf::from(folder).join(file);
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: {} is not there", path.display());
        return None;
    };
    let mut lines = text.lines();
    // "# node at [x, y, z] m, inward [x, y, z]; …", where the rows don't say it.
    let mut vectors = lines.next()?.split('[').skip(1).map(|part| {
        let numbers: Vec<f64> =
            part.split(']').next()?.split(',').map_while(|x| x.trim().parse().ok()).collect();
        DVec3::from_slice(&numbers).into()
    });
    let own: Option<[DVec3; 2]> = vectors.next().flatten().zip(vectors.next().flatten()).map(|(p, u)| [p, u]);
    let columns: Vec<&str> = lines.next()?.split(',').collect();
    let mut places: Vec<Place> = Vec::new();
    for line in lines {
        let row: BTreeMap<&str, &str> = columns.iter().copied().zip(line.split(',')).collect();
        let vector = |names: [&str; 3]| {
            let [x, y, z] = names.map(|name| row[name].parse::<f64>().unwrap());
            DVec3::new(x, y, z)
        };
        let [position, inward] = own.unwrap_or_else(|| {
            [vector(["node_x_m", "node_y_m", "node_z_m"]), vector(["ux", "uy", "uz"]).normalize()]
        });
        if places.last().is_none_or(|last| last.position != position) {
            places.push(Place { position, inward, states: Vec::new() });
        }
        places.last_mut()?.states.push(State {
            path: row["path"].to_string(),
            centre: vector(["x_m", "y_m", "z_m"]),
            force: vector(["fx_n", "fy_n", "fz_n"]),
        });
    }
    Some(places)
}

/// The potential of each place, all on the same knots and up to the same lateral deflection.
pub fn potentials(places: &[Place], friction: f64) -> Vec<PotentialFit> {
    let samples: Vec<_> = places.iter().map(Place::samples).collect();
    let all = samples.iter().flatten();
    let range = all.map(|s| s.lateral_m[0].hypot(s.lateral_m[1])).fold(0.0, f64::max);
    let first = &samples[0];
    let mut knots: Vec<f64> = vec![0.0];
    knots.extend(
        first.iter().zip(&places[0].states).filter(|(_, s)| s.path == "press").map(|(s, _)| s.depth_m),
    );
    knots.push(1.15 * knots[knots.len() - 1]);
    let options =
        PotentialOptions { knots_m: Some(knots), range_m: Some(range), friction, ..Default::default() };
    places.iter().zip(&samples).map(|(p, s)| fit_potential(s, p.tangents(), &options).unwrap()).collect()
}

/// The patch; its first node is the one that the other files press at.
pub fn liver_patch_body(friction: f64, slip: SlipRule) -> Option<Body> {
    let places = places("liver_patch_sticking.csv")?;
    let positions: Vec<DVec3> = places.iter().map(|p| p.position).collect();
    let mesh = TriangleMesh { triangles: delaunay(&positions, places[0].inward), positions };
    let surface = Surface::build(&mesh, f64::INFINITY).unwrap();
    let surface = surface.with_inward_normals(places.iter().map(|p| p.inward).collect()).unwrap();
    let fits = potentials(&places, friction);
    let range_m = fits[0].range_m;
    let body = Body::new(BodyParts {
        surface,
        blends: (0..places.len() as u32).map(BlendWeights::own).collect(),
        responses: Vec::new(),
        test_point_nodes: (0..places.len() as u32).collect(),
        coupled: Some(CoupledLaw {
            range_m,
            potentials: fits.into_iter().map(|fit| fit.potential).collect(),
        }),
        lateral_tensors: None,
        tool: Tool::Sphere { radius_m: RADIUS },
        slip,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    });
    Some(body.unwrap())
}

/// Triangles whose circles hold no other point, as seen along `inward`, outer side out. Those that are nearly lines, at the
/// hull, are left out.
fn delaunay(points: &[DVec3], inward: DVec3) -> Vec<[u32; 3]> {
    let x = inward.any_orthonormal_vector();
    // Right-handed as seen from outside.
    let y = x.cross(inward);
    let flat: Vec<[f64; 2]> = points.iter().map(|p| [p.dot(x), p.dot(y)]).collect();
    let cross =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let mut triangles = Vec::new();
    let n = flat.len();
    for (i, j, k) in (0..n).flat_map(|i| (i + 1..n).flat_map(move |j| (j + 1..n).map(move |k| (i, j, k)))) {
        let (j, k) = if cross(flat[i], flat[j], flat[k]) > 0.0 { (j, k) } else { (k, j) };
        let [a, b, c] = [flat[i], flat[j], flat[k]];
        let within = |d: [f64; 2]| {
            let [p, q, r] = [a, b, c].map(|p| [p[0] - d[0], p[1] - d[1]]);
            let [pp, qq, rr] = [p, q, r].map(|p| p[0] * p[0] + p[1] * p[1]);
            p[0] * (q[1] * rr - qq * r[1]) - p[1] * (q[0] * rr - qq * r[0]) + pp * (q[0] * r[1] - q[1] * r[0])
                > 0.0
        };
        let empty = (0..n).all(|d| [i, j, k].contains(&d) || !within(flat[d]));
        let longest = [(a, b), (b, c), (c, a)]
            .map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]))
            .into_iter()
            .fold(0.0, f64::max);
        if empty && cross(a, b, c) > 0.3 * longest * longest {
            triangles.push([i as u32, j as u32, k as u32]);
        }
    }
    triangles
}
