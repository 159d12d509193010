//! Six axes in a closed loop: a rotational spring in the body's place, on a simulated device whose handle
//! turns. Energy balances, limits and the passivity controller act on torque as on force, and a recording
//! plays again to the bit.

mod common;

use common::faulty::{Faulty, Odds};
use common::{Random, plane};
use glam::{DQuat, DVec3};
use palpate_body::{Body, ContactModel};
use palpate_device::simulated::{Hand, Move, Script};
use palpate_device::{
    Capabilities, Command, Device, Figure, Freedom, Replay, ReplaySample, Simulated, Wrist, presets,
};
use palpate_engine::{Contact, Output, ToolState};
use palpate_runtime::{
    Coupling, Ground, HapticLoop, Header, Limit, PassivityController, Period, Record, Recording,
    RecordingFile, Safety, StageFlags, Stages, WorkspaceMap,
};
use std::path::Path;

const PERIOD: f64 = 1e-3;

/// Pulls the tool back to where nothing is turned, and its tip to the origin: −k θ, −k x.
struct Springs {
    body: Body,
    n_per_m: f64,
    nm_per_rad: f64,
}

impl Springs {
    fn new(n_per_m: f64, nm_per_rad: f64) -> Self {
        Springs { body: plane(600.0, 500.0, 0.3), n_per_m, nm_per_rad }
    }

    fn energy(&self, pose: &ToolState) -> f64 {
        let position = DVec3::from_array(pose.position_m);
        0.5 * self.n_per_m * position.length_squared()
            + 0.5 * self.nm_per_rad * rotation_vector(pose.orientation).length_squared()
    }
}

impl Ground for Springs {
    fn model(&self) -> &ContactModel {
        &self.body
    }
    fn knows(&self, _: [f64; 3], _: f64) -> bool {
        true
    }
    fn step(&self, _: &mut Contact, pose: &ToolState, _: f64) -> Option<Output> {
        Some(Output {
            force_n: pose.position_m.map(|x| -self.n_per_m * x),
            torque_nm: (-self.nm_per_rad * rotation_vector(pose.orientation)).to_array(),
            ..Output::default()
        })
    }
}

fn rotation_vector([w, x, y, z]: [f64; 4]) -> DVec3 {
    let q = DQuat::from_xyzw(x, y, z, w) * w.signum();
    let sine = q.xyz().length();
    if sine == 0.0 { DVec3::ZERO } else { q.xyz() * (2.0 * libm::atan2(sine, q.w) / sine) }
}

/// The bench device with a wrist: 10⁻⁴ kg·m², so much damping (N·m·s/rad), nothing else.
fn six_axes(damping: f64) -> Capabilities {
    let mut capabilities = presets::device("bench").unwrap();
    capabilities.max_torque_nm = Some(Figure::chosen(10.0));
    let all = Freedom { translations: 3, rotations: 3 };
    (capabilities.sensed, capabilities.driven) = (all, all);
    let zero = || Figure::chosen(0.0);
    capabilities.mechanics.wrist = Some(Wrist {
        inertia_kg_m2: Figure::chosen(1e-4),
        damping_nm_s_per_rad: Figure::chosen(damping),
        coulomb_nm: zero(),
        resolution_rad: zero(),
        slew_nm_per_s: Figure::chosen(f64::INFINITY),
    });
    capabilities
}

fn hand() -> Hand {
    let (fingers, _) = presets::hand("fingers").unwrap();
    Hand { inertia_kg_m2: 2e-5, damping_nm_s_per_rad: 2e-3, stiffness_nm_per_rad: 0.3, ..fingers }
}

fn turn(x: f64, y: f64, z: f64, seconds: f64) -> Move {
    Move::Turn { angles_rad: DVec3::new(x, y, z), seconds }
}

fn open(capabilities: &Capabilities, hand: Hand, moves: &[Move]) -> Simulated {
    let script = Script::new(DVec3::new(2e-3, 1e-3, 0.0), 1e-3, -DVec3::Z, DVec3::X, moves).unwrap();
    let mut device = Simulated::new(capabilities.clone(), hand, Box::new(script));
    device.open().unwrap();
    device
}

fn closed(springs: &Springs, map: WorkspaceMap, stages: Stages) -> HapticLoop {
    HapticLoop::new(Contact::new(&springs.body), map, stages)
}

/// Energy that was put into or taken out of anything, J.
fn moved(device: &Simulated) -> f64 {
    let e = device.energies();
    e.motor_j.abs() + e.hand_j.abs() + e.viscous_j + e.coulomb_j + e.hand_damper_j + device.held_j()
}

/// Of the device: motor + hand = held + dissipated.
fn unbalanced(device: &Simulated) -> f64 {
    let e = device.energies();
    (e.motor_j + e.hand_j - e.viscous_j - e.coulomb_j - e.hand_damper_j - device.held_j()).abs()
}

/// About each hinge, with all three translations: what the springs give out at the engine's port is what the
/// motors do, and what they gave out and hold is what the hold alone lets out, ½ k Σ|θ|². To 10⁻⁹ of what is
/// moved.
#[test]
fn the_energies_of_a_loop_on_a_rotational_spring_balance() {
    let springs = Springs::new(150.0, 0.2);
    for (x, y, z) in [(0.9, 0.0, 0.0), (0.0, -1.2, 0.0), (0.0, 0.0, 2.5)] {
        let moves = [
            turn(x, y, z, 0.4),
            Move::Drag { along_m: 0.02, across_m: 0.01, seconds: 0.3 },
            turn(-x, -y, 0.0, 0.3),
        ];
        let mut device = open(&six_axes(5e-4), hand(), &moves);
        let mut haptics = closed(&springs, WorkspaceMap::default(), Stages::default());
        let mut start = None;
        for k in 0..1000 {
            let period = haptics.step(&springs, &mut device, f64::from(k) * PERIOD).unwrap();
            let stored = springs.energy(&period.pose);
            let start = *start.get_or_insert(stored);
            let (port, moved) = (haptics.port(), moved(&device) + stored);
            assert!(unbalanced(&device) < 1e-9 * moved, "{k}: the device");
            assert!((port.out_j - device.energies().motor_j).abs() < 1e-9 * moved, "{k}: port and motors");
            let let_out =
                0.5 * springs.n_per_m * port.squares_m2 + 0.5 * springs.nm_per_rad * port.squares_rad2;
            assert!((port.out_j + stored - start - let_out).abs() < 1e-9 * moved, "{k}: the springs");
        }
        assert!(haptics.port().squares_rad2 > 1e-3 && device.energies().motor_j.abs() > 1e-4);
    }
}

/// About axes that change, the device still balances to rounding; the port's rotation vectors and the hinges'
/// torques, both held for a period, differ by what halves with the period.
#[test]
fn about_changing_axes_the_port_nears_the_motors_with_the_period() {
    let springs = Springs::new(150.0, 0.2);
    let moves = [turn(0.5, -0.7, 1.0, 0.4), turn(-0.4, 0.9, -1.5, 0.6)];
    let apart = |hz: u32| {
        let mut device = open(&six_axes(5e-4), hand(), &moves);
        let mut haptics = closed(&springs, WorkspaceMap::default(), Stages::default());
        let mut apart = 0.0f64;
        for k in 0..hz {
            haptics.step(&springs, &mut device, f64::from(k) / f64::from(hz)).unwrap();
            assert!(unbalanced(&device) <= 1e-9 * moved(&device));
            apart = apart.max((haptics.port().out_j - device.energies().motor_j).abs());
        }
        apart / moved(&device)
    };
    let [coarse, fine] = [1000, 4000].map(apart);
    println!("{coarse:e} {fine:e}");
    assert!(coarse < 1e-3 && (3.0..5.0).contains(&(coarse / fine)), "{coarse:e} {fine:e}");
}

/// 2b/T = 1 N·m/rad for 5·10⁻⁴ N·m·s/rad: on both sides of it, a spring is quiet and cycles; the controller
/// stops the cycle by torque alone, and without an inertia it can't.
#[test]
fn the_passivity_controller_stops_a_cycle_of_the_wrist() {
    let moves = [turn(0.0, 0.0, 0.3, 0.2), Move::Hold { tremor_m: 0.0, tremor_hz: 0.0, seconds: 4.8 }];
    let soft = Hand { stiffness_nm_per_rad: 0.05, ..Hand::default() };
    let swing = |nm_per_rad, passivity| {
        let springs = Springs::new(0.0, nm_per_rad);
        let mut device = open(&six_axes(5e-4), soft, &moves);
        let mut haptics =
            closed(&springs, WorkspaceMap::default(), Stages { passivity, ..Stages::default() });
        let mut angles = Vec::new();
        for k in 0..5000 {
            let period = haptics.step(&springs, &mut device, f64::from(k) * PERIOD).unwrap();
            assert_eq!(period.command.force_n, [0.0; 3]);
            angles.push(device.angles_rad().z);
        }
        let last = &angles[4500..];
        let swing =
            last.iter().copied().fold(f64::MIN, f64::max) - last.iter().copied().fold(f64::MAX, f64::min);
        (swing, haptics.stages().passivity.map_or(0, |p| p.active()))
    };
    let controller = PassivityController::new(PERIOD, 0.1);
    let (quiet, cycling) = (swing(0.7, None).0, swing(1.8, None).0);
    let stopped = swing(1.8, Some(controller.with_inertia(1e-4)));
    let helpless = swing(1.8, Some(controller)).0;
    println!("{quiet:e} {cycling:e} {stopped:?} {helpless:e}");
    assert!(quiet < 1e-4 && cycling > 0.1 && helpless > 0.1);
    assert!(stopped.0 < 5e-3 && stopped.1 > 0);
    // Where nothing is given out nothing is done.
    assert_eq!(swing(0.7, Some(controller.with_inertia(1e-4))), (quiet, 0));
}

/// No torque above the limit, none that changes faster than the slew, a soft start, and zero within two
/// periods of a stop.
#[test]
fn the_limits_act_on_torque_as_on_force() {
    let mut capabilities = six_axes(5e-4);
    capabilities.max_force_n = Figure::chosen(5.0);
    let safety = Safety { torque_max_nm: Some(0.05), soft_start_s: 0.1, ..Safety::default() };
    let stages = safety.stages(&capabilities, 1000.0).unwrap();
    let springs = Springs::new(3000.0, 0.5);
    let mut device = open(&capabilities, hand(), &[turn(0.6, -0.5, 0.4, 0.3)]);
    let mut haptics = closed(&springs, WorkspaceMap::default(), stages);
    let mut before = DVec3::ZERO;
    let mut largest = 0.0f64;
    for k in 0..500 {
        if k == 400 {
            haptics.stop();
        }
        let period = haptics.step(&springs, &mut device, f64::from(k) * PERIOD).unwrap();
        let torque = DVec3::from_array(period.command.torque_nm);
        assert!(torque.length() <= 0.05 && torque.distance(before) <= 0.025 * (1.0 + 1e-12), "{k}: {torque}");
        if k < 100 {
            assert!(torque.length() <= 0.05 * f64::from(k + 1) / 100.0 + 1e-12, "{k}: {torque}");
        }
        if k >= 401 {
            assert_eq!(torque, DVec3::ZERO, "{k}");
        }
        largest = largest.max(torque.length());
        before = torque;
    }
    assert!(largest > 0.0499 && haptics.counts().of(StageFlags::SATURATED) > 100, "{largest}");
    assert!(haptics.is_silent());
}

/// 200 random loops with a device that goes wrong: no torque above its limit, no step above the slew but to
/// zero, silence two periods after a stop.
#[test]
fn no_torque_above_the_limits_whatever_goes_wrong() {
    let (mut touched, mut nearest) = (0, [0.0f64; 2]);
    for seed in 0..200 {
        let mut rng = Random::new(seed);
        let mut capabilities = six_axes(rng.range(0.0, 1e-3));
        let safety = Safety {
            torque_max_nm: Some(rng.range(0.01, 0.3)),
            soft_start_s: rng.range(0.0, 0.05),
            passivity: rng.unit() < 0.5,
            damping_nm_s_per_rad: rng.range(0.0, 5e-3),
            ..Safety::default()
        };
        let mut stages = safety.stages(&capabilities, 1000.0).unwrap();
        if rng.unit() < 0.3 {
            stages.coupling = Some(Coupling::new(500.0, 3000.0).with_angular(0.5, 1.0));
        }
        let (most, step) = (stages.torque.most(), stages.torque.step());
        // The loop's limit must hold by itself.
        capabilities.max_torque_nm = Some(Figure::chosen(100.0));
        let odds = Odds { no_number: 0.01, frozen: 0.005, jump: 0.005, read_error: 0.01, write_error: 0.01 };
        let turns =
            [0; 3].map(|_| turn(rng.range(-1.5, 1.5), rng.range(-1.5, 1.5), rng.range(-3.0, 3.0), 0.1));
        let mut device = Faulty::new(open(&capabilities, hand(), &turns), odds, seed);
        let map = WorkspaceMap {
            scale: rng.range(0.5, 3.0),
            tip_in_handle_m: DVec3::new(0.0, 0.02, -0.05) * rng.unit(),
            ..WorkspaceMap::default()
        };
        let springs = Springs::new(rng.range(0.0, 3000.0), rng.range(0.1, 2.0));
        let mut haptics = closed(&springs, map, stages);
        let stop_at = rng.below(220) as u64;
        for k in 0..250 {
            if k == stop_at {
                haptics.stop();
            }
            if k == stop_at + 20 {
                haptics.resume();
            }
            let period = haptics.period(&springs, &mut device, k as f64 * PERIOD);
            if k > stop_at && k < stop_at + 20 {
                assert_eq!(period.command, Command::default(), "{seed} {k}");
            }
            touched += u32::from(period.command.torque_nm != [0.0; 3]);
        }
        let mut before = DVec3::ZERO;
        for command in &device.taken {
            let torque = DVec3::from_array(command.torque_nm);
            let way = if torque == DVec3::ZERO { 0.0 } else { torque.distance(before) };
            assert!(
                torque.length() <= most && way <= step * (1.0 + 1e-12),
                "{seed}: {torque} after {before}"
            );
            nearest = [nearest[0].max(torque.length() / most), nearest[1].max(way / step)];
            before = torque;
        }
    }
    println!("{touched} {nearest:?}");
    assert!(touched > 20_000 && nearest.iter().all(|n| *n > 0.999), "{touched} {nearest:?}");
}

/// A force at a tip 5 cm below the handle turns the handle. Where no rotation is driven the torque is left
/// out and counted, and the controller's book is of what is rendered.
#[test]
fn a_force_at_the_tip_is_a_torque_at_the_handle() {
    let map = WorkspaceMap { tip_in_handle_m: DVec3::new(0.0, 0.0, -0.05), ..WorkspaceMap::default() };
    let springs = Springs::new(150.0, 0.0);
    let moves = [turn(0.0, 0.4, 0.3, 0.3), Move::Drag { along_m: 0.02, across_m: 0.01, seconds: 0.3 }];
    let passivity = Some(PassivityController::new(PERIOD, 0.1));
    let go = |capabilities: &Capabilities| {
        let mut device = open(capabilities, hand(), &moves);
        let mut haptics = closed(&springs, map, Stages { passivity, ..Stages::default() });
        let mut book = 0.0;
        let mut last: Option<Period> = None;
        for k in 0..600 {
            let period = haptics.step(&springs, &mut device, f64::from(k) * PERIOD).unwrap();
            if let Some(last) = last {
                let vectors = [last.command.force_n, last.command.torque_nm].map(DVec3::from_array);
                let [from, to] = [last, period].map(|p| p.sample.pose);
                let way = DVec3::from_array(to.position_m) - DVec3::from_array(from.position_m);
                let q = |[w, x, y, z]: [f64; 4]| DQuat::from_xyzw(x, y, z, w);
                let turned = q(to.orientation) * q(from.orientation).conjugate();
                let turned = rotation_vector([turned.w, turned.x, turned.y, turned.z]);
                book -= vectors[0].dot(way) + vectors[1].dot(turned);
            }
            if !period.flags.has(StageFlags::PASSIVITY) {
                let [w, x, y, z] = period.sample.pose.orientation;
                let lever = DQuat::from_xyzw(x, y, z, w) * map.tip_in_handle_m;
                let expected = lever.cross(DVec3::from_array(period.output.force_n));
                let driven = capabilities.driven.rotations > 0;
                let expected = if driven { expected } else { DVec3::ZERO };
                assert!(DVec3::from_array(period.command.torque_nm).distance(expected) < 1e-15, "{k}");
            }
            last = Some(period);
        }
        let observed = haptics.stages().passivity.unwrap().observed_j();
        assert!((observed - book).abs() < 1e-12, "{observed} {book}");
        haptics.counts().of(StageFlags::TORQUE_DROPPED)
    };
    let mut capabilities = six_axes(5e-4);
    assert_eq!(go(&capabilities), 0);
    capabilities.driven.rotations = 0;
    assert!(go(&capabilities) > 590);
}

/// A spring of 1.8 N·m/rad, on which the bare wrist oscillates, is met through one of 0.5 as 0.39, which is
/// quiet: the torque is that of both in series, and the body's tool stays behind the handle.
#[test]
fn the_couplings_rotational_spring_stands_in_for_the_body() {
    let moves = [turn(0.0, 0.0, 0.3, 0.2), Move::Hold { tremor_m: 0.0, tremor_hz: 0.0, seconds: 4.8 }];
    let springs = Springs::new(0.0, 1.8);
    let coupling = Some(Coupling::new(1000.0, 0.0).with_angular(0.5, 1.8));
    let mut device = open(&six_axes(5e-4), hand(), &moves);
    let mut haptics = closed(&springs, WorkspaceMap::default(), Stages { coupling, ..Stages::default() });
    let mut last = None;
    for k in 0..3000 {
        last = Some(haptics.step(&springs, &mut device, f64::from(k) * PERIOD).unwrap());
    }
    let (period, handle) = (last.unwrap(), device.angles_rad());
    let expected = DVec3::Z * (-handle.z * 0.5 * 1.8 / 2.3);
    assert!(handle.z > 0.05 && DVec3::from_array(period.command.torque_nm).distance(expected) < 1e-9);
    let tool = rotation_vector(period.pose.orientation);
    assert!(tool.distance(handle * 0.5 / 2.3) < 1e-9, "{tool} {handle}");
}

/// Written, read, and played again on a loop of its own: poses, forces, torques and books to the bit; and
/// what the springs answer to the recorded poses.
#[test]
fn a_recording_with_torques_plays_again_to_the_bit() {
    let springs = Springs::new(150.0, 0.4);
    let capabilities = six_axes(5e-4);
    let map = WorkspaceMap {
        rotation: DQuat::from_rotation_x(0.3),
        scale: 1.5,
        offset_m: DVec3::new(1e-3, 0.0, 2e-3),
        tip_in_handle_m: DVec3::new(0.0, 5e-3, -0.05),
        handle_from_tool: DQuat::from_rotation_z(0.2),
        clutch: None,
    };
    let safety = Safety {
        soft_start_s: 0.05,
        passivity: true,
        damping_n_s_per_m: 1.0,
        damping_nm_s_per_rad: 1e-3,
        ..Safety::default()
    };
    let mut stages = safety.stages(&capabilities, 1000.0).unwrap();
    stages.coupling = Some(Coupling::new(500.0, 150.0).with_angular(0.8, 0.4));
    let moves =
        [turn(0.5, -0.7, 1.0, 0.3), Move::Press { depth_m: 4e-3, seconds: 0.2 }, turn(0.0, 0.3, -0.5, 0.3)];
    let record = |device: &mut dyn Device| -> Vec<Record> {
        let mut haptics = closed(&springs, map, stages);
        let period = |k: u64| {
            let period = haptics.step(&springs, device, k as f64 * PERIOD).unwrap();
            Record::new(k, &haptics, &period)
        };
        (0..800).map(period).collect()
    };
    let records = record(&mut open(&capabilities, hand(), &moves));
    let header = Header { map: map.into(), safety: Some(safety), ..Header::default() };
    let mut file = RecordingFile::begin(Vec::new(), &header).unwrap();
    records.iter().for_each(|r| file.write(r).unwrap());
    let bytes = file.end("the end", records.len() as u64, 0).unwrap();
    let mut recording = Recording::read(&bytes[..], Path::new("six.rec")).unwrap();
    assert_eq!(WorkspaceMap::from(recording.header().map), map);
    let read: Vec<Record> = recording.by_ref().collect();
    let bits = |v: &[f64]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    for record in &read {
        let output = springs.step(&mut Contact::new(&springs.body), &record.tool().unwrap(), PERIOD).unwrap();
        assert_eq!(bits(&output.torque_nm), bits(&record.torque_nm));
        assert_eq!(bits(&output.force_n), bits(&record.force_n));
    }

    let sample =
        |r: &Record| ReplaySample { time_s: r.time_s, pose: r.sample().pose, buttons: r.device_buttons };
    let mut replay = Replay::new(read.iter().map(sample).collect()).with_capabilities(capabilities);
    replay.open().unwrap();
    for (a, b) in record(&mut replay).iter().zip(&records) {
        for (a, b) in [(a.command_force_n, b.command_force_n), (a.command_torque_nm, b.command_torque_nm)] {
            assert_eq!(bits(&a), bits(&b));
        }
        assert_eq!(bits(&a.tool_orientation), bits(&b.tool_orientation));
        let books = |r: &Record| bits(&[r.out_j, r.squares_m2, r.squares_rad2, r.observed_j]);
        assert_eq!((books(a), a.stage_flags), (books(b), b.stage_flags));
    }
    let largest = read.iter().map(|r| DVec3::from_array(r.command_torque_nm).length()).fold(0.0, f64::max);
    assert!(largest > 0.05 && read[799].squares_rad2 > 1e-3, "{largest}");
}

/// A law without torque renders none, whatever the wrist does; the forces are those of a device without a
/// wrist, to the bit.
#[test]
fn without_torque_a_wrist_changes_nothing() {
    let body = plane(600.0, 500.0, 0.3);
    let moves = |turns| {
        let press = Move::Press { depth_m: 5e-3, seconds: 0.2 };
        let drag = Move::Drag { along_m: 0.02, across_m: 0.0, seconds: 0.3 };
        if turns {
            vec![press, drag, turn(0.3, 0.2, 0.1, 0.2)]
        } else {
            vec![press, drag, Move::Hold { tremor_m: 0.0, tremor_hz: 0.0, seconds: 0.2 }]
        }
    };
    let run = |capabilities: &Capabilities, turns| -> Vec<Record> {
        let mut device = open(capabilities, hand(), &moves(turns));
        let controller = PassivityController::new(PERIOD, 0.1).with_inertia(1e-4);
        let stages = Stages { force: Limit::new(3.0, 1.5), passivity: Some(controller), ..Stages::default() };
        let mut haptics = HapticLoop::new(Contact::new(&body), WorkspaceMap::default(), stages);
        let period = |k: u64| {
            let period = haptics.step(&body, &mut device, k as f64 * PERIOD).unwrap();
            assert_eq!(period.command.torque_nm, [0.0; 3]);
            Record::new(k, &haptics, &period)
        };
        (0..700).map(period).collect()
    };
    let bench = presets::device("bench").unwrap();
    assert_eq!(run(&bench, false), run(&six_axes(5e-4), false));
    for (a, b) in run(&bench, true).iter().zip(&run(&six_axes(5e-4), true)) {
        assert_eq!((a.command_force_n, a.out_j, a.observed_j), (b.command_force_n, b.out_j, b.observed_j));
    }
}
