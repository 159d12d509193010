//! Instructions a step takes, counted by callgrind: the same number on every run, whatever else the machine does.
//!
//! Each count is that of 100 steps. See CONTRIBUTING.md for the runner that `cargo bench` needs, and
//! docs/performance.md for the figures.

#![expect(missing_docs, reason = "the macros make public items without docs")]

use glam::DVec3;
use gungraun::{library_benchmark, library_benchmark_group, main};
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{BlendWeights, Body, BodyParts, Provenance, Response, SlipRule, Tool, tensor};
use palpate_engine::{Ablation, Contact, Flags, ToolState};
use std::f64::consts::TAU;
use std::hint::black_box;

/// Steps in a count.
const STEPS: u32 = 100;
/// Radius and length of the tube, m.
const RADIUS: f64 = 0.03;
const LENGTH: f64 = 0.1;
/// The grid of test points: the paper's mesh of 528 triangles.
const AROUND: u32 = 24;
const ALONG: u32 = 11;
/// How much finer the big tube is: 52,800 triangles.
const BIG: u32 = 10;
/// Of an anisotropic tube: what simulations of such cylinders show.
const RATIO: f64 = 1.9;
/// Of 0.1 m/s at 1 kHz, m.
const STRIDE: f64 = 1e-4;

/// The paper's tube, `finer` times as fine in each direction, with the responses of the coarse one's 288 nodes. Laterally
/// it is up to `ratio` times as stiff along the axis as around it.
fn tube(finer: u32, ratio: f64) -> Body {
    let shape = Shape::Cylinder { radius_mm: RADIUS * 1e3, length_mm: LENGTH * 1e3, caps: false };
    let grid = |finer: u32| Resolution {
        around: Some(AROUND * finer),
        along: Some(ALONG * finer),
        ..Default::default()
    };
    let response = |p: &DVec3| {
        let stiffness = (1.0 + 0.5 * p.x / RADIUS) * (1.0 + 0.2 * libm::sin(TAU * p.z / LENGTH));
        Response::paper(600.0 * stiffness, 500.0 * stiffness, 0.3, 8e-3, 8e-3).unwrap()
    };
    let responses = shape.mesh(grid(1)).unwrap().positions.iter().map(response).collect();
    let surface = shape.surface(grid(finer)).unwrap();
    let radial = surface.positions().iter().map(|p| -DVec3::new(p.x, p.y, 0.0).normalize()).collect();
    let surface = surface.with_inward_normals(radial).unwrap();
    let along = |(p, u): (&DVec3, &DVec3)| {
        let here = 1.0 + (ratio - 1.0) * (0.75 + 0.25 * libm::sin(TAU * p.z / LENGTH));
        tensor::along(DVec3::Z, here, *u).unwrap()
    };
    let tensors = surface.positions().iter().zip(surface.inward_normals()).map(along).collect();
    let places = |around: u32, along: u32, step: u32| {
        (0..=along).flat_map(move |row| (0..around).map(move |column| (row * step, column * step)))
    };
    let test_point_nodes = places(AROUND, ALONG, finer).map(|(row, column)| row * AROUND * finer + column);
    Body::new(BodyParts {
        surface,
        blends: places(AROUND * finer, ALONG * finer, 1)
            .map(|(row, column)| mix(row, column, finer))
            .collect(),
        responses,
        test_point_nodes: test_point_nodes.collect(),
        coupled: None,
        lateral_tensors: Some(tensors),
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

/// Area coordinates of a node in the coarse triangle that it lies in.
fn mix(row: u32, column: u32, finer: u32) -> BlendWeights {
    let node = |row: u32, column: u32| row * AROUND + column % AROUND;
    let (i, j) = ((row / finer).min(ALONG - 1), column / finer);
    let share = |n: u32, cell: u32| f64::from(n - cell * finer) / f64::from(finer);
    let (u, v) = (share(column, j), share(row, i));
    let (near, far) = (node(i, j), node(i + 1, j + 1));
    let (test_points, weights) = if u >= v {
        ([near, node(i, j + 1), far], [1.0 - u, u - v, v])
    } else {
        ([near, far, node(i + 1, j)], [1.0 - v, u, v - u])
    };
    match weights.iter().position(|w| *w == 1.0) {
        Some(own) => BlendWeights::own(test_points[own]),
        None => BlendWeights { test_points, weights },
    }
}

/// At an angle (rad), height (m) and depth below the surface (m).
fn at(angle: f64, z: f64, depth: f64) -> ToolState {
    let r = RADIUS - depth;
    ToolState::at([r * libm::cos(angle), r * libm::sin(angle), z])
}

/// A body, a contact for each run of poses, and the poses.
type Scene = (Body, Vec<(Contact, Vec<ToolState>)>);

/// A contact that `before` has led to where the counting begins.
fn warm(body: Body, rule: SlipRule, before: &[ToolState], counted: Vec<ToolState>) -> Scene {
    let mut contact = Contact::with_slip(&body, rule, Ablation::None);
    for pose in before.iter().chain(&counted) {
        contact.step(&body, pose, 1e-3);
    }
    (body, vec![(contact, counted)])
}

/// Small circles 3 mm deep, within the friction limit.
fn stick(finer: u32, ratio: f64, rule: SlipRule) -> Scene {
    let circle = |i: u32| {
        let turn = TAU * f64::from(i) / f64::from(STEPS);
        at(0.4 + 2e-3 * libm::cos(turn), 2e-3 + 5e-5 * libm::sin(turn), 3e-3)
    };
    let press = [at(0.4, 2e-3, -1e-3), at(0.4, 2e-3, 3e-3)];
    let scene = warm(tube(finer, ratio), rule, &press, (0..STEPS).map(circle).collect());
    let (contact, _) = &scene.1[0];
    assert!(contact.counters().slips <= 1, "only the press may slip: {:?}", contact.counters());
    scene
}

/// A helical drag 3 mm deep, at 0.1 m/s and 1 kHz; there once before to warm up.
fn slide(finer: u32, ratio: f64, rule: SlipRule) -> Scene {
    let helix = |i: u32| at(0.4 + STRIDE / RADIUS * f64::from(i), 2e-3 + 2e-5 * f64::from(i), 3e-3);
    let mut before = vec![at(0.4 - 0.1, 0.0, -1e-3), at(0.4 - 0.1, 0.0, 3e-3)];
    before.extend((0..STEPS).map(helix));
    before.extend((0..STEPS).rev().map(helix));
    let mut scene = warm(tube(finer, ratio), rule, &before, Vec::new());
    scene.1[0].1 = (STEPS..2 * STEPS).map(helix).collect();
    scene
}

/// 10 mm above the surface, at 1 m/s and 1 kHz: ten times a hand's speed, so that every few steps the clearance is used
/// up and the surface is asked.
fn free(finer: u32) -> Scene {
    let flight = |i: u32| at(0.4 + 1e-3 / 0.04 * f64::from(i), 2e-3, -10e-3);
    warm(tube(finer, 1.0), SlipRule::Paper, &[], (0..STEPS).map(flight).collect())
}

/// The steps in which a tool comes from 0.5 mm above the surface to 0.5 mm below, at 100 places. (The facets' middles lie
/// 0.26 mm below the true cylinder.)
fn onset(finer: u32) -> Scene {
    let body = tube(finer, 1.0);
    let place = |i: u32| (f64::from(i) * 2.399, 0.04 * libm::sin(f64::from(i)));
    let contacts = (0..STEPS).map(place).map(|(angle, z)| {
        let mut contact = Contact::new(&body);
        contact.step(&body, &at(angle, z, -5e-4), 1e-3);
        let deep = at(angle, z, 5e-4);
        assert!(contact.clone().step(&body, &deep, 1e-3).flags.has(Flags::ONSET));
        (contact, vec![deep])
    });
    let contacts = contacts.collect();
    (body, contacts)
}

#[library_benchmark]
#[bench::stick_528(args = (1, 1.0, SlipRule::Paper), setup = stick)]
#[bench::stick_52800(args = (BIG, 1.0, SlipRule::Paper), setup = stick)]
#[bench::stick_anisotropic_528(args = (1, RATIO, SlipRule::Paper), setup = stick)]
#[bench::stick_anisotropic_52800(args = (BIG, RATIO, SlipRule::Paper), setup = stick)]
#[bench::slide_528(args = (1, 1.0, SlipRule::Paper), setup = slide)]
#[bench::slide_52800(args = (BIG, 1.0, SlipRule::Paper), setup = slide)]
#[bench::slide_anisotropic_528(args = (1, RATIO, SlipRule::Paper), setup = slide)]
#[bench::slide_anisotropic_52800(args = (BIG, RATIO, SlipRule::Paper), setup = slide)]
#[bench::stick_consistent_528(args = (1, 1.0, SlipRule::Consistent), setup = stick)]
#[bench::stick_consistent_52800(args = (BIG, 1.0, SlipRule::Consistent), setup = stick)]
#[bench::stick_consistent_anisotropic_528(args = (1, RATIO, SlipRule::Consistent), setup = stick)]
#[bench::stick_consistent_anisotropic_52800(args = (BIG, RATIO, SlipRule::Consistent), setup = stick)]
#[bench::slide_consistent_528(args = (1, 1.0, SlipRule::Consistent), setup = slide)]
#[bench::slide_consistent_52800(args = (BIG, 1.0, SlipRule::Consistent), setup = slide)]
#[bench::slide_consistent_anisotropic_528(args = (1, RATIO, SlipRule::Consistent), setup = slide)]
#[bench::slide_consistent_anisotropic_52800(args = (BIG, RATIO, SlipRule::Consistent), setup = slide)]
#[bench::slide_exact_528(args = (1, 1.0, SlipRule::Exact), setup = slide)]
#[bench::slide_exact_52800(args = (BIG, 1.0, SlipRule::Exact), setup = slide)]
#[bench::free_528(args = (1), setup = free)]
#[bench::free_52800(args = (BIG), setup = free)]
#[bench::onset_528(args = (1), setup = onset)]
#[bench::onset_52800(args = (BIG), setup = onset)]
fn hundred_steps((body, mut contacts): Scene) -> Scene {
    for (contact, poses) in &mut contacts {
        for pose in poses.iter() {
            black_box(contact.step(&body, black_box(pose), 1e-3));
        }
    }
    // Given back, so that dropping it is not counted.
    (body, contacts)
}

library_benchmark_group!(name = steps, benchmarks = hundred_steps);
main!(library_benchmark_groups = steps);
