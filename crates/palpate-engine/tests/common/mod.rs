//! Bodies, paths and chance for the engine's tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use glam::DVec3;
use palpate_body::{
    BlendWeights, Body, BodyParts, Provenance, Response, SlipRule, Surface, Tensor, Tool, TriangleMesh,
    tensor,
};
use palpate_engine::{Contact, Output, ToolState};
use proptest::strategy::Strategy;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Display;

pub mod made;

/// `count` cases, the same ones in every run; `PROPTEST_CASES` asks for more.
pub fn cases(count: u32) -> proptest::test_runner::Config {
    let more = std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok());
    proptest::test_runner::Config {
        cases: more.unwrap_or(count),
        rng_seed: proptest::test_runner::RngSeed::Fixed(2003),
        failure_persistence: None,
        max_global_rejects: 100_000,
        ..Default::default()
    }
}

/// How much a property was judged on, kind by kind: one that exempts everything must fail.
#[derive(Default)]
pub struct Judged(RefCell<BTreeMap<String, u64>>);

impl Judged {
    pub fn add(&self, kind: impl Display, count: u64) {
        *self.0.borrow_mut().entry(kind.to_string()).or_default() += count;
    }

    /// Exactly so many kinds, each judged at least so often.
    pub fn demand(&self, kinds: usize, least: u64) {
        let judged = self.0.borrow();
        println!("judged: {judged:?}");
        assert!(judged.len() == kinds && judged.values().all(|&n| n >= least), "judged: {judged:?}");
    }
}

/// xorshift64*: the same numbers everywhere.
#[derive(Clone)]
pub struct Random(pub u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03)
    }
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }
    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0), self.range(-1.0, 1.0));
            if v.length() > 0.1 && v.length() < 1.0 {
                return v.normalize();
            }
        }
    }
}

/// The side of a cylinder around z: `around` × `along` × 2 triangles.
pub fn cylinder(radius: f64, length: f64, around: usize, along: usize) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for row in 0..=along {
        for column in 0..around {
            let angle = column as f64 * std::f64::consts::TAU / around as f64;
            let z = length * (row as f64 / along as f64 - 0.5);
            mesh.positions.push(DVec3::new(radius * libm::cos(angle), radius * libm::sin(angle), z));
        }
    }
    for row in 0..along {
        for column in 0..around {
            let at = |r: usize, c: usize| (r * around + c % around) as u32;
            let [a, b, c, d] =
                [at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// A flat patch in z = 0, facing +z.
pub fn patch(size: f64, cells: usize) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for j in 0..=cells {
        for i in 0..=cells {
            let at = |k: usize| size * (k as f64 / cells as f64 - 0.5);
            mesh.positions.push(DVec3::new(at(i), at(j), 0.0));
        }
    }
    for j in 0..cells {
        for i in 0..cells {
            let at = |i: usize, j: usize| (j * (cells + 1) + i) as u32;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// A subdivided icosahedron, 20 · 4^levels triangles, on the ellipsoid with these radii.
pub fn ellipsoid(radii: DVec3, levels: usize) -> TriangleMesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let corners = [
        (-1.0, g, 0.0),
        (1.0, g, 0.0),
        (-1.0, -g, 0.0),
        (1.0, -g, 0.0),
        (0.0, -1.0, g),
        (0.0, 1.0, g),
        (0.0, -1.0, -g),
        (0.0, 1.0, -g),
        (g, 0.0, -1.0),
        (g, 0.0, 1.0),
        (-g, 0.0, -1.0),
        (-g, 0.0, 1.0),
    ];
    let mut positions: Vec<DVec3> =
        corners.iter().map(|&(x, y, z)| DVec3::new(x, y, z).normalize()).collect();
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut middle = |a: u32, b: u32, positions: &mut Vec<DVec3>| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push(((positions[a as usize] + positions[b as usize]) * 0.5).normalize());
                positions.len() as u32 - 1
            })
        };
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let [x, y, z] =
                [middle(a, b, &mut positions), middle(b, c, &mut positions), middle(c, a, &mut positions)];
            finer.extend([[a, x, z], [b, y, x], [c, z, y], [x, y, z]]);
        }
        triangles = finer;
    }
    TriangleMesh { positions: positions.into_iter().map(|p| p * radii).collect(), triangles }
}

/// A torus around z.
pub fn torus(ring: f64, tube: f64, around: usize, along: usize) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for i in 0..around {
        for j in 0..along {
            let (a, b) = (
                i as f64 * std::f64::consts::TAU / around as f64,
                j as f64 * std::f64::consts::TAU / along as f64,
            );
            let r = ring + tube * libm::cos(b);
            mesh.positions.push(DVec3::new(r * libm::cos(a), r * libm::sin(a), tube * libm::sin(b)));
        }
    }
    for i in 0..around {
        for j in 0..along {
            let at = |i: usize, j: usize| ((i % around) * along + j % along) as u32;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// A box with corners ±half, each face cut into `cells`² quads.
pub fn block(half: DVec3, cells: usize) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let mut ids = std::collections::HashMap::new();
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let mut at = |i: usize, j: usize| {
                let mut p = [0.0; 3];
                p[axis] = side;
                p[(axis + 1) % 3] = 2.0 * i as f64 / cells as f64 - 1.0;
                p[(axis + 2) % 3] = 2.0 * j as f64 / cells as f64 - 1.0;
                let key = p.map(|x| (x * 1e6).round() as i64);
                *ids.entry(key).or_insert_with(|| {
                    mesh.positions.push(DVec3::from_array(p) * half);
                    mesh.positions.len() as u32 - 1
                })
            };
            let mut triangles = Vec::new();
            for i in 0..cells {
                for j in 0..cells {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    if side > 0.0 {
                        triangles.extend([[a, b, c], [a, c, d]]);
                    } else {
                        triangles.extend([[a, c, b], [a, d, c]]);
                    }
                }
            }
            mesh.triangles.extend(triangles);
        }
    }
    mesh
}

/// Responses of the paper's form with these stiffness fields.
#[derive(Clone, Copy)]
pub struct Material<'a> {
    pub kz: &'a dyn Fn(DVec3) -> f64,
    pub kr: &'a dyn Fn(DVec3) -> f64,
    pub friction: &'a dyn Fn(DVec3) -> f64,
    pub radius_m: f64,
}

pub fn body_of(surface: Surface, material: Material) -> Body {
    stretched(surface, material, None)
}

/// The same with a lateral tensor at each node, of its position and inward normal. Without the tank: these are for a slip rule
/// by itself.
pub fn stretched(
    surface: Surface,
    material: Material,
    tensor: Option<&dyn Fn(DVec3, DVec3) -> Tensor>,
) -> Body {
    let nodes = || surface.positions().iter().zip(surface.inward_normals());
    let lateral_tensors = tensor.map(|t| nodes().map(|(&p, &u)| t(p, u)).collect());
    let responses: Vec<Response> = surface
        .positions()
        .iter()
        .map(|&p| {
            Response::paper((material.kz)(p), (material.kr)(p), (material.friction)(p), 8e-3, 8e-3).unwrap()
        })
        .collect();
    let count = surface.positions().len() as u32;
    Body::new(BodyParts {
        blends: (0..count).map(BlendWeights::own).collect(),
        surface,
        responses,
        test_point_nodes: (0..count).collect(),
        coupled: None,
        lateral_tensors,
        tool: if material.radius_m > 0.0 {
            Tool::Sphere { radius_m: material.radius_m }
        } else {
            Tool::Point
        },
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
    .with_tank(false)
}

/// The same body with another slip rule.
pub fn ruled(body: &Body, rule: SlipRule) -> Body {
    Body::new(BodyParts { slip: rule, ..body.parts() }).unwrap()
}

pub fn uniform(mesh: &TriangleMesh, kz: f64, kr: f64, friction: f64) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    body_of(surface, Material { kz: &|_| kz, kr: &|_| kr, friction: &|_| friction, radius_m: 0.0 })
}

/// Each node its own stiffness, within ±`spread` of the mean.
pub fn heterogeneous(mesh: &TriangleMesh, rng: &mut Random, spread: f64, friction: f64) -> Body {
    anisotropic(mesh, rng, spread, friction, 1.0)
}

/// The same, up to `ratio` times as stiff laterally in one direction as in the other.
pub fn anisotropic(mesh: &TriangleMesh, rng: &mut Random, spread: f64, friction: f64, ratio: f64) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    let (a, b) = (rng.direction() * 60.0, rng.direction() * 60.0);
    let (kz, kr) = (rng.range(300.0, 900.0), rng.range(300.0, 900.0));
    let wave = move |p: DVec3, d: DVec3| 1.0 + spread * libm::sin(p.dot(d));
    let material = Material {
        kz: &|p| kz * wave(p, a),
        kr: &|p| kr * wave(p, b),
        friction: &|p| friction * wave(p, a - b),
        radius_m: 0.0,
    };
    if ratio == 1.0 {
        return body_of(surface, material);
    }
    let fibres = fibres(rng, ratio);
    stretched(surface, material, Some(&fibres))
}

/// Fibres that wind through the body, along which it is `ratio` times as stiff as across.
pub fn fibres(rng: &mut Random, ratio: f64) -> impl Fn(DVec3, DVec3) -> Tensor + use<> {
    let (d, e, wave) = (rng.direction(), rng.direction(), rng.direction() * 60.0);
    move |p, u| {
        let f = (d + e * (0.5 * libm::sin(p.dot(wave)))).normalize();
        let (s, off) = ((ratio - 1.0) * f, DVec3::new(f.x * f.y, f.x * f.z, f.y * f.z) * (ratio - 1.0));
        let stiffness = [1.0 + s.x * f.x, 1.0 + s.y * f.y, 1.0 + s.z * f.z, off.x, off.y, off.z];
        tensor::from_stiffness(&stiffness, u).unwrap()
    }
}

/// No ratio, as often as one up to `most`.
pub fn ratio(most: f64) -> impl proptest::strategy::Strategy<Value = f64> {
    (proptest::bool::ANY, 1.0..most).prop_map(|(isotropic, ratio)| if isotropic { 1.0 } else { ratio })
}

/// A smooth random walk at `speed` m/s and 1 kHz that keeps coming back to the surface.
pub struct Wander {
    pub x: DVec3,
    v: DVec3,
    pub speed: f64,
}

impl Wander {
    pub fn new(body: &Body, random: &mut Random, speed: f64) -> Self {
        let nodes = body.element_nodes(random.below(body.elements().len()) as u32);
        let centre = (nodes[0].position + nodes[1].position + nodes[2].position) / 3.0;
        let away = 1e-3 + body.tool().radius_m();
        Wander { x: centre - nodes[0].inward * away, v: nodes[0].inward * speed, speed }
    }

    /// The next sample; `output` is what the last one gave.
    pub fn next(&mut self, output: &Output, body: &Body, random: &mut Random) -> DVec3 {
        let nearest = body.nearest(self.x, f64::INFINITY).unwrap();
        let home = body.point(nearest.at);
        let deep = output.contact.map_or(0.0, |c| c.delta_z_m);
        let pull = if deep > 5e-3 {
            (home - self.x).normalize_or_zero() * 0.4
        } else if nearest.outside && nearest.distance > 1e-3 + body.tool().radius_m() {
            (home - self.x).normalize_or_zero() * 0.3
        } else {
            DVec3::ZERO
        };
        self.v = (self.v + (random.direction() * 0.25 + pull) * self.speed).normalize() * self.speed;
        self.x += self.v * 1e-3;
        self.x
    }
}

pub fn step(contact: &mut Contact, body: &palpate_body::ContactModel, p: DVec3) -> Output {
    step_pose(contact, body, &ToolState::at(p.to_array()))
}

/// Every step of these tests: at 1 kHz.
pub fn step_pose(contact: &mut Contact, body: &palpate_body::ContactModel, pose: &ToolState) -> Output {
    contact.step(body, pose, 1e-3)
}

pub fn force(output: &Output) -> DVec3 {
    DVec3::from_array(output.force_n)
}

/// |work − stored − dissipated| over the energy moved.
pub fn imbalance(output: &Output) -> f64 {
    let e = output.energy;
    let moved = e.work_j.abs() + e.stored_j + e.dissipated_j.abs() + e.generated_j;
    (e.work_j - e.stored_j - e.dissipated_j).abs() / moved.max(1e-9)
}
