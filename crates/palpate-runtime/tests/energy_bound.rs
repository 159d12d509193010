//! MODEL 9 j: E_out + W ≤ W₀ + ½ K_max Σ|Δx|² in closed loops, wherever slip never raises W.
//!
//! E_out is what the engine gives out at its port, W what it stores: sampling can let out no more than half of K_max
//! times the squares of the ways, whatever device and hand do.

mod common;

use common::{Random, patch, plane, shape, uniform, with_field};
use glam::DVec3;
use palpate_body::Body;
use palpate_body::shape::Shape;
use palpate_device::simulated::{Hand, Move, Script};
use palpate_device::{Capabilities, Device, Figure, Simulated, presets};
use palpate_engine::certify::{Assumptions, Criterion, Effort, ElementStates, ROUNDING, least};
use palpate_engine::{Contact, Flags};
use palpate_runtime::{HapticLoop, Stages, WorkspaceMap};

/// Steps of one run, at 1 kHz.
const STEPS: u64 = 2000;

/// What a number of runs came to.
#[derive(Debug, Default)]
struct Tally {
    steps: u64,
    touching: u64,
    slipping: u64,
    /// The greatest (E_out + W) / (½ K_max Σ|Δx|²) of any step.
    tightest: f64,
    /// Bodies, of four drawn each time, that are proved to be passive.
    bodies: usize,
    /// Runs whose device damps enough for its period.
    damped: u64,
}

/// The deepest that the runs go, and the longest step of the tool in them, m.
const DEPTH: f64 = 18e-3;
const STEP: f64 = 1.5e-3;

/// Bodies at random, on which slip is proved never to raise W.
fn passive_bodies(rng: &mut Random, tally: &mut Tally) -> Vec<(&'static str, Body)> {
    let (kz, kr) = (rng.range(300.0, 1500.0), rng.range(150.0, 1500.0));
    let sphere = shape(Shape::Sphere { radius_mm: 30.0 }, 10.0);
    let slope = DVec3::new(rng.range(-8.0, 8.0), rng.range(-8.0, 8.0), 0.0);
    let mut bodies = vec![
        ("plane without friction", plane(kz, kr, 0.0)),
        ("plane", plane(kz, kr, rng.range(0.02, 1.0))),
        ("sphere", uniform(&sphere, kz, kr, rng.range(0.1, 1.0))),
        (
            "plane with a gradient",
            with_field(&patch(0.1, 8), kz, kr, rng.range(0.1, 1.0), &|p| 1.0 + p.dot(slope)),
        ),
    ];
    bodies.retain(|(_, body)| is_passive(body));
    tally.bodies += bodies.len();
    bodies
}

/// P, on every element.
fn is_passive(body: &Body) -> bool {
    let assumptions =
        Assumptions { slip: body.slip(), depth_m: Some(DEPTH), step_m: STEP, ..Assumptions::default() };
    let effort = Effort { evaluations: 400, absolute: 0.0, relative: 0.5 };
    (0..body.elements().len() as u32).all(|element| {
        let patch = ElementStates::new(body, element, &assumptions);
        let passive = least(Criterion::Passive, &patch, &patch.cells(), effort);
        passive.proved >= -ROUNDING && !patch.holds_too_far()
    })
}

fn device(rng: &mut Random) -> Capabilities {
    let mut capabilities = presets::device("bench").unwrap();
    let m = &mut capabilities.mechanics;
    let mut any = |figure: &mut Figure, low: f64, high: f64| *figure = Figure::chosen(rng.range(low, high));
    any(&mut m.mass_kg, 0.02, 0.5);
    any(&mut m.damping_n_s_per_m, 0.0, 3.0);
    any(&mut m.coulomb_n, 0.0, 0.4);
    any(&mut m.resolution_m, 0.0, 1e-4);
    // Every other device is ideal between pose and force.
    if rng.unit() < 0.5 {
        let mut any = |figure: &mut Figure, high: f64| *figure = Figure::chosen(rng.range(0.0, high));
        any(&mut m.delay_s, 3e-3);
        any(&mut m.lag_s, 1e-3);
        m.slew_n_per_s = Figure::chosen(rng.range(500.0, 1e5));
        capabilities.max_force_n = Figure::chosen(rng.range(1.0, 20.0));
    } else {
        m.resolution_m = Figure::chosen(0.0);
    }
    capabilities
}

fn hand(rng: &mut Random) -> Hand {
    match rng.below(3) {
        0 => Hand::default(),
        1 => Hand {
            mass_kg: rng.range(0.0, 0.05),
            damping_n_s_per_m: rng.range(0.0, 5.0),
            stiffness_n_per_m: rng.range(50.0, 800.0),
            ..Hand::default()
        },
        _ => Hand { mass_kg: 0.5, damping_n_s_per_m: 6.0, stiffness_n_per_m: 150.0, ..Hand::default() },
    }
}

fn moves(rng: &mut Random) -> Vec<Move> {
    let mut moves = vec![Move::Press { depth_m: rng.range(1e-3, 9e-3), seconds: rng.range(0.05, 0.4) }];
    for _ in 0..6 {
        let seconds = rng.range(0.1, 0.6);
        moves.push(match rng.below(6) {
            0 => Move::Press { depth_m: rng.range(-1e-3, 9e-3), seconds },
            1 => Move::Drag { along_m: rng.range(-0.01, 0.01), across_m: rng.range(-0.01, 0.01), seconds },
            2 => Move::Circle { radius_m: rng.range(1e-3, 5e-3), turns: rng.range(-2.0, 2.0), seconds },
            3 => Move::Tap { depth_m: rng.range(-8e-3, 8e-3), times: 1 + rng.below(5) as u32, seconds },
            4 => Move::Hold { tremor_m: rng.range(0.0, 1e-3), tremor_hz: rng.range(3.0, 30.0), seconds },
            _ => Move::Push { force_n: rng.range(0.0, 3.0), seconds },
        });
    }
    moves
}

/// One run; panics where the bound doesn't hold.
fn run(name: &str, body: &Body, rng: &mut Random, tally: &mut Tally) {
    let (capabilities, hand) = (device(rng), hand(rng));
    let (damping, period) = (capabilities.mechanics.damping_n_s_per_m.value, 1e-3);
    let m = &capabilities.mechanics;
    let ideal = [m.delay_s.value, m.lag_s.value, m.resolution_m.value] == [0.0; 3];
    // Over the top of the body, off its axes and nodes.
    let above = DVec3::new(rng.range(-4e-3, 4e-3), rng.range(-4e-3, 4e-3), 0.1);
    let touch = body.first_touch(above, above - DVec3::Z * 0.15, 0.0).unwrap();
    let place = body.point(touch.at);
    let script = Script::new(place, 1e-3, -DVec3::Z, DVec3::X, &moves(rng)).unwrap();
    let mut device = Simulated::new(capabilities, hand, Box::new(script));
    device.open().unwrap();
    let mut closed = HapticLoop::new(Contact::new(body), WorkspaceMap::default(), Stages::default());
    let (mut deepest, mut moved) = (0.0f64, 0.0f64);
    let mut stiffness = 0.0;
    let normal = |depth: f64| body.curves().iter().map(|r| r.normal.slope(depth)).fold(0.0, f64::max);
    let lateral = body.curves().iter().map(|r| r.lateral.slope(0.0)).fold(0.0, f64::max);
    for k in 0..=STEPS {
        let step = closed.step(body, &mut device, k as f64 * period).unwrap();
        let energy = step.output.energy;
        if let Some(c) = step.output.contact {
            tally.touching += 1;
            assert!(c.delta_z_m < DEPTH, "{name}: deeper than what is proved");
            if c.delta_z_m > deepest {
                deepest = c.delta_z_m;
                stiffness = normal(deepest).max(lateral);
            }
        }
        tally.slipping += u64::from(step.output.flags.has(Flags::SLIPPING));
        moved = moved.max(energy.work_j.abs() + energy.dissipated_j.abs());
        let given = closed.port().out_j + energy.stored_j;
        let bound = 0.5 * stiffness * closed.port().squares_m2;
        assert!(energy.generated_j <= 1e-12 * moved, "{name}: slip raised W by {} J", energy.generated_j);
        assert!(given <= bound + 1e-12 * moved, "{name}, step {k}: {given} J given, {bound} J allowed");
        if bound > 1e-12 {
            tally.tightest = tally.tightest.max(given / bound);
        }
        // With b ≥ K_max T/2 the damping takes all that sampling lets out: |Δx|² ≤ T ∫v².
        if ideal && damping >= 0.5 * stiffness * period {
            let net = device.energies().motor_j - device.energies().viscous_j;
            // The motor's work is the port's, one period later.
            assert!(net <= 1e-12 * moved, "{name}, step {k}: {net} J beyond the damping");
        }
    }
    tally.steps += STEPS + 1;
    tally.damped += u64::from(ideal && damping >= 0.5 * stiffness * period);
}

fn runs(count: u64) -> Tally {
    let mut tally = Tally::default();
    for seed in 0..count {
        let mut rng = Random::new(seed);
        for (name, body) in passive_bodies(&mut rng, &mut tally) {
            run(name, &body, &mut rng, &mut tally);
        }
    }
    tally
}

#[test]
fn sampling_lets_out_no_more_than_its_bound() {
    let tally = runs(10);
    println!("{tally:?}");
    // The loops do what they are for.
    assert!(tally.touching > tally.steps / 4 && tally.slipping > 1000, "{tally:?}");
    assert!(tally.tightest > 0.3 && tally.damped > 0 && tally.bodies >= 25, "{tally:?}");
}

/// The same in a million steps: `cargo test --release -p palpate-runtime -- --ignored a_million --nocapture`.
#[test]
#[ignore = "a million steps"]
fn a_million_closed_loop_steps_stay_within_the_bound() {
    let tally = runs(130);
    println!("{tally:?}");
    assert!(tally.steps > 1_000_000);
}

/// What ties the port to the motors: with an ideal device the force that is held does the work that the port books.
#[test]
fn the_port_is_the_motors() {
    let body = plane(600.0, 500.0, 0.3);
    let capabilities = presets::device("bench").unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let moves = [
        Move::Press { depth_m: 5e-3, seconds: 0.3 },
        Move::Drag { along_m: 0.02, across_m: 0.0, seconds: 0.5 },
    ];
    let script = Script::new(DVec3::new(1e-3, 2e-3, 0.0), 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
    let mut device = Simulated::new(capabilities, hand, Box::new(script));
    device.open().unwrap();
    let mut closed = HapticLoop::new(Contact::new(&body), WorkspaceMap::default(), Stages::default());
    for k in 0..900 {
        closed.step(&body, &mut device, f64::from(k) * 1e-3).unwrap();
        let (port, motor) = (closed.port().out_j, device.energies().motor_j);
        assert!((port - motor).abs() < 1e-12 * (1e-3 + motor.abs()), "{k}: {port} {motor}");
    }
    assert!(device.energies().motor_j < -1e-3);
}
