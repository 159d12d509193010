//! The simulated tool against closed forms.

use glam::DVec3;
use palpate_device::simulated::{Hand, HandMotion, Move, Script, Target};
use palpate_device::{Capabilities, Command, Device, Fault, Figure, Freedom, Simulated, Wrist, presets};

/// A hand that wants the same all the time.
#[derive(Debug)]
struct Still(Target);

impl HandMotion for Still {
    fn target(&self, _: f64) -> Target {
        self.0
    }

    fn duration_s(&self) -> f64 {
        1.0
    }
}

/// The bench device with other mechanics: mass, damping, friction.
fn device(mass: f64, damping: f64, coulomb: f64, hand: Hand, target: Target) -> Simulated {
    let mut capabilities = presets::device("bench").unwrap();
    let m = &mut capabilities.mechanics;
    (m.mass_kg, m.damping_n_s_per_m) = (Figure::chosen(mass), Figure::chosen(damping));
    m.coulomb_n = Figure::chosen(coulomb);
    let mut device = Simulated::new(capabilities, hand, Box::new(Still(target)));
    device.open().unwrap();
    device
}

/// The bench device with a driven wrist of this inertia, damping and friction.
fn six_axes(inertia: f64, damping: f64, coulomb: f64) -> Capabilities {
    let mut capabilities = presets::device("bench").unwrap();
    capabilities.max_torque_nm = Some(Figure::chosen(0.5));
    (capabilities.sensed, capabilities.driven) =
        (Freedom { translations: 3, rotations: 3 }, Freedom { translations: 3, rotations: 3 });
    capabilities.mechanics.wrist = Some(Wrist {
        inertia_kg_m2: Figure::chosen(inertia),
        damping_nm_s_per_rad: Figure::chosen(damping),
        coulomb_nm: Figure::chosen(coulomb),
        resolution_rad: Figure::chosen(0.0),
        slew_nm_per_s: Figure::chosen(f64::INFINITY),
    });
    capabilities
}

fn turned_by(torque_nm: [f64; 3]) -> Command {
    Command { torque_nm, ..Command::default() }
}

fn along_x(force: f64) -> Command {
    Command { force_n: [force, 0.0, 0.0], ..Command::default() }
}

/// A push of a constant force on a damped mass: x = F/b (t − m/b (1 − exp(−bt/m))).
#[test]
fn a_step_of_force() {
    for period in [1e-4, 1e-3, 7e-3] {
        let mut device = device(0.1, 0.3, 0.0, Hand::default(), Target::default());
        device.write(&along_x(2.0)).unwrap();
        for k in 1..=100 {
            let t = f64::from(k) * period;
            device.read(t).unwrap();
            let fade = (-3.0 * t).exp();
            let (x, v) = (2.0 / 0.3 * (t - (1.0 - fade) / 3.0), 2.0 / 0.3 * (1.0 - fade));
            assert!((device.position_m().x - x).abs() < 1e-12 * (1.0 + x), "{period} {t}");
            assert!((device.velocity_m_per_s().x - v).abs() < 1e-12 * (1.0 + v), "{period} {t}");
        }
    }
}

/// Let go from 10 mm: x = A exp(−σt)(cos ωt + σ/ω sin ωt). The hand's aim is at 0; the push that held it away ends.
#[test]
fn a_free_decay() {
    #[derive(Debug)]
    struct LetGo;
    impl HandMotion for LetGo {
        fn target(&self, t: f64) -> Target {
            let push = if t < 0.0 { 3.0 } else { 0.0 };
            Target { push_n: DVec3::X * push, ..Target::default() }
        }
        fn duration_s(&self) -> f64 {
            1.0
        }
    }
    let hand = Hand { mass_kg: 0.02, damping_n_s_per_m: 0.7, stiffness_n_per_m: 300.0, ..Hand::default() };
    let mut device = Simulated::new(presets::device("bench").unwrap(), hand, Box::new(LetGo));
    device.open().unwrap();
    // Held still by the motor at F/k, then let go.
    device.write(&along_x(3.0)).unwrap();
    for k in 1..=5000 {
        device.read(f64::from(k) * 1e-3).unwrap();
    }
    assert!((device.position_m().x - 0.01).abs() < 1e-9);
    let start = (device.position_m().x, device.velocity_m_per_s().x);
    device.write(&along_x(0.0)).unwrap();
    let (sigma, square) = (1.0 / 0.24, 300.0 / 0.12);
    let omega = f64::sqrt(square - sigma * sigma);
    for k in 1..=500 {
        let t = f64::from(k) * 1e-3;
        device.read(5.0 + t).unwrap();
        let (sin, cos) = (omega * t).sin_cos();
        let x = (-sigma * t).exp() * (start.0 * cos + (start.1 + sigma * start.0) / omega * sin);
        assert!((device.position_m().x - x).abs() < 1e-12, "{t}: {} {x}", device.position_m().x);
    }
}

/// Coulomb friction alone: a tool that slides at v₀ stops after m v₀/c, at m v₀²/2c, and stays.
#[test]
fn a_coulomb_stop() {
    let (mass, coulomb, force, pushed) = (0.2, 0.5, 1.5, 0.05);
    let mut device = device(mass, 0.0, coulomb, Hand::default(), Target::default());
    device.write(&along_x(force)).unwrap();
    device.read(pushed).unwrap();
    let speed = (force - coulomb) / mass * pushed;
    assert!((device.velocity_m_per_s().x - speed).abs() < 1e-13);
    device.write(&along_x(0.0)).unwrap();
    // One read jumps over the stop, which no multiple of a millisecond hits.
    device.read(1.0).unwrap();
    let way = 0.5 * speed * pushed + 0.5 * mass * speed * speed / coulomb;
    assert!((device.position_m().x - way).abs() < 1e-12, "{} {way}", device.position_m().x);
    assert_eq!(device.velocity_m_per_s(), DVec3::ZERO);
    assert!((device.energies().coulomb_j - coulomb * way).abs() < 1e-13);
    // Below the friction nothing moves, above it does.
    device.write(&along_x(0.499)).unwrap();
    device.read(1.9).unwrap();
    assert_eq!(device.velocity_m_per_s().x, 0.0);
    device.write(&along_x(0.51)).unwrap();
    device.read(2.0).unwrap();
    assert!((device.velocity_m_per_s().x - 0.01 / mass * 0.1).abs() < 1e-12);
}

/// A spring with Coulomb friction: each half swing loses 2c/k, exactly, until it sticks.
#[test]
fn each_half_swing_loses_the_same() {
    let hand = Hand { mass_kg: 0.0, damping_n_s_per_m: 0.0, stiffness_n_per_m: 200.0, ..Hand::default() };
    let mut device = device(0.1, 0.0, 0.05, hand, Target::default());
    device.write(&along_x(2.0)).unwrap();
    let mut t = 0.0;
    let mut next = |device: &mut Simulated| {
        t += 1e-4;
        device.read(t).unwrap();
    };
    // Pulled out by hand and let go at the turning point: 2F/k less the friction.
    while device.velocity_m_per_s().x >= 0.0 {
        next(&mut device);
    }
    device.write(&along_x(0.0)).unwrap();
    let mut turns = Vec::new();
    let mut before = (device.position_m().x, device.velocity_m_per_s().x);
    for _ in 0..60_000 {
        next(&mut device);
        let now = (device.position_m().x, device.velocity_m_per_s().x);
        if before.1 * now.1 < 0.0 {
            turns.push(before.0.abs().max(now.0.abs()));
        }
        before = now;
    }
    assert!(turns.len() > 10);
    for pair in turns.windows(2).take(10) {
        // The turning point falls between two samples: its height is known to half an acceleration times its square.
        assert!((pair[0] - pair[1] - 2.0 * 0.05 / 200.0).abs() < 2e-7, "{pair:?}");
    }
    assert_eq!(before.1, 0.0);
    assert!(device.position_m().x.abs() <= 0.05 / 200.0);
}

/// What the motors and the hand put in is held or dissipated, whatever the device does, to rounding.
#[test]
fn energies_add_up() {
    let moves = [
        Move::Press { depth_m: 4e-3, seconds: 0.2 },
        Move::Drag { along_m: 0.03, across_m: -0.01, seconds: 0.4 },
        Move::Hold { tremor_m: 3e-4, tremor_hz: 9.0, seconds: 0.3 },
        Move::Tap { depth_m: 3e-3, times: 3, seconds: 0.3 },
        Move::Push { force_n: 1.5, seconds: 0.1 },
        Move::Circle { radius_m: 8e-3, turns: 1.5, seconds: 0.5 },
    ];
    for name in presets::DEVICES {
        for hand in presets::HANDS {
            let script = Script::new(DVec3::ZERO, 0.0, -DVec3::Z, DVec3::X, &moves).unwrap();
            let (hand, _) = presets::hand(hand).unwrap();
            let mut device = Simulated::new(presets::device(name).unwrap(), hand, Box::new(script));
            device.open().unwrap();
            for k in 1..=1800 {
                let sample = device.read(f64::from(k) * 1e-3).unwrap();
                // Springs and some chatter, past the force limit at times.
                let wave = f64::from(k % 7) - 3.0;
                let force = sample.pose.position_m.map(|x| -300.0 * x + wave);
                device.write(&Command { force_n: force, ..Command::default() }).unwrap();
            }
            let e = device.energies();
            let [gained, lost] = [e.motor_j + e.hand_j, e.viscous_j + e.coulomb_j + e.hand_damper_j];
            let moved = e.motor_j.abs() + e.hand_j.abs() + lost + device.held_j();
            assert!((gained - lost - device.held_j()).abs() < 1e-11 * moved, "{name} {hand:?} {e:?}");
            assert!(e.viscous_j >= 0.0 && e.coulomb_j >= 0.0 && e.hand_damper_j >= 0.0);
        }
    }
}

/// A constant torque on a damped hinge: φ = τ/b (t − I/b (1 − exp(−bt/I))), and the handle is turned by φ
/// about that axis.
#[test]
fn a_step_of_torque() {
    let (inertia, damping, torque) = (1e-4, 5e-4, 1e-3);
    for hinge in 0..3 {
        let still = Box::new(Still(Target::default()));
        let mut device = Simulated::new(six_axes(inertia, damping, 0.0), Hand::default(), still);
        device.open().unwrap();
        let mut torque_nm = [0.0; 3];
        torque_nm[hinge] = torque;
        device.write(&turned_by(torque_nm)).unwrap();
        for k in 1..=100 {
            let t = f64::from(k) * 7e-3;
            let [w, x, y, z] = device.read(t).unwrap().pose.orientation;
            let fade = (-damping / inertia * t).exp();
            let phi = torque / damping * (t - inertia / damping * (1.0 - fade));
            assert!((device.angles_rad()[hinge] - phi).abs() < 1e-12 * (1.0 + phi), "{hinge} {t}");
            let mut expected = DVec3::ZERO;
            expected[hinge] = (0.5 * phi).sin();
            assert!(DVec3::new(x, y, z).distance(expected) < 1e-12 && (w - (0.5 * phi).cos()).abs() < 1e-12);
        }
        assert_eq!(device.position_m(), DVec3::ZERO);
    }
}

/// Three translations and three rotations at once, hand, friction, lag and delay, cut torques, in any
/// direction: what goes in is held or dissipated, to rounding.
#[test]
fn the_energies_of_six_axes_add_up() {
    let moves = [
        Move::Press { depth_m: 4e-3, seconds: 0.2 },
        Move::Turn { angles_rad: DVec3::new(0.5, -0.7, 1.0), seconds: 0.4 },
        Move::Drag { along_m: 0.03, across_m: -0.01, seconds: 0.4 },
        Move::Turn { angles_rad: DVec3::new(-0.4, 0.9, -2.0), seconds: 0.5 },
    ];
    let hand = Hand {
        inertia_kg_m2: 2e-5,
        damping_nm_s_per_rad: 2e-3,
        stiffness_nm_per_rad: 0.3,
        ..presets::hand("fingers").unwrap().0
    };
    let mut capabilities = six_axes(1e-4, 5e-4, 2e-3);
    capabilities.max_torque_nm = Some(Figure::chosen(0.15));
    let m = &mut capabilities.mechanics;
    (m.delay_s, m.lag_s) = (Figure::chosen(0.4e-3), Figure::chosen(0.3e-3));
    m.wrist.as_mut().unwrap().slew_nm_per_s = Figure::chosen(300.0);
    let script = Script::new(DVec3::ZERO, 0.0, -DVec3::Z, DVec3::X, &moves).unwrap();
    let mut device = Simulated::new(capabilities, hand, Box::new(script));
    device.open().unwrap();
    let mut turned = 0.0f64;
    for k in 1..=1800 {
        let [w, x, y, z] = device.read(f64::from(k) * 1e-3).unwrap().pose.orientation;
        let wave = f64::from(k % 7) - 3.0;
        let torque = DVec3::new(x, y, z) * (-0.8 * w.signum()) + DVec3::new(0.02, -0.03, 0.01) * wave;
        let force_n = device.position_m().to_array().map(|x| -300.0 * x + wave);
        device.write(&Command { force_n, torque_nm: torque.to_array() }).unwrap();
        let e = device.energies();
        let [gained, lost] = [e.motor_j + e.hand_j, e.viscous_j + e.coulomb_j + e.hand_damper_j];
        let moved = e.motor_j.abs() + e.hand_j.abs() + lost + device.held_j();
        assert!((gained - lost - device.held_j()).abs() < 1e-11 * moved, "{k}: {e:?}");
        turned = turned.max(device.angles_rad().abs().max_element());
    }
    assert!(turned > 0.5 && device.saturations() > 0, "{turned} {}", device.saturations());
}

/// A wrist's encoder rounds, its motors cut, and what is not driven or not sensed does not turn.
#[test]
fn the_wrists_encoder_and_limits() {
    let mut capabilities = six_axes(1e-4, 5e-4, 0.0);
    capabilities.mechanics.wrist.as_mut().unwrap().resolution_rad = Figure::chosen(0.01);
    let still = || Box::new(Still(Target { angles_rad: DVec3::new(0.0, 0.0, 0.026), ..Target::default() }));
    let open = |capabilities: &Capabilities| {
        let mut device = Simulated::new(capabilities.clone(), Hand::default(), still());
        device.open().unwrap();
        device
    };
    let mut device = open(&capabilities);
    let [w, _, _, z] = device.read(0.0).unwrap().pose.orientation;
    assert!((2.0 * libm::atan2(z, w) - 0.03).abs() < 1e-12);
    device.write(&turned_by([0.0, 3.0, 4.0])).unwrap();
    assert!(device.read(1e-3).unwrap().status.saturated && device.saturations() == 1);
    assert!((device.hinge_torques_nm().z - 0.4).abs() < 1e-12);
    device.write(&turned_by([f64::NAN, 0.0, 1.0])).unwrap();
    device.read(2e-3).unwrap();
    assert_eq!(device.hinge_torques_nm(), DVec3::ZERO);

    capabilities.driven.rotations = 0;
    let mut undriven = open(&capabilities);
    undriven.write(&turned_by([0.1; 3])).unwrap();
    undriven.read(0.1).unwrap();
    assert_eq!(undriven.angles_rad(), DVec3::new(0.0, 0.0, 0.026));
    capabilities.sensed.rotations = 0;
    let mut fixed = open(&capabilities);
    assert_eq!(fixed.read(0.1).unwrap().pose.orientation, [1.0, 0.0, 0.0, 0.0]);
}

/// Force and torque never meet: the same forces give the same motion to the bit, wrist or none.
#[test]
fn a_wrist_costs_the_translations_nothing() {
    let moves = [
        Move::Press { depth_m: 4e-3, seconds: 0.2 },
        Move::Hold { tremor_m: 1e-4, tremor_hz: 9.0, seconds: 0.3 },
    ];
    let run = |capabilities| {
        let script = Script::new(DVec3::ZERO, 0.0, -DVec3::Z, DVec3::X, &moves).unwrap();
        let mut device = Simulated::new(capabilities, presets::hand("fingers").unwrap().0, Box::new(script));
        device.open().unwrap();
        for k in 1..=500 {
            device.read(f64::from(k) * 1e-3).unwrap();
            device.write(&along_x(f64::from(k % 5) - 2.0)).unwrap();
        }
        (device.position_m(), device.energies(), device.held_j())
    };
    assert_eq!(run(presets::device("bench").unwrap()), run(six_axes(1e-4, 5e-4, 1e-3)));
}

#[test]
fn the_encoder_the_delay_and_the_limits() {
    let mut capabilities = presets::device("bench").unwrap();
    capabilities.max_force_n = Figure::chosen(2.0);
    let m = &mut capabilities.mechanics;
    (m.resolution_m, m.delay_s) = (Figure::chosen(1e-4), Figure::chosen(2.5e-3));
    m.slew_n_per_s = Figure::chosen(1000.0);
    let still = Target { position_m: DVec3::new(1.26e-3, 0.0, 0.0), ..Target::default() };
    let mut device = Simulated::new(capabilities, Hand::default(), Box::new(Still(still)));
    device.open().unwrap();
    assert!((device.read(0.0).unwrap().pose.position_m[0] - 1.3e-3).abs() < 1e-15);
    device.write(&Command { force_n: [0.0, 30.0, 40.0], ..Command::default() }).unwrap();
    assert_eq!(device.saturations(), 1);
    assert!(device.read(1e-3).unwrap().status.saturated);
    for (t, force) in [(2.5e-3, 0.0), (3.5e-3, 1.0 / 1.0), (4.1e-3, 1.6), (9e-3, 1.6)] {
        device.read(t).unwrap();
        // 1,000 N/s along z, up to 2 N × 40/50.
        assert!((device.force_n().z - force).abs() < 1e-9, "{t}: {}", device.force_n());
    }
    // A lag of 1 ms, exactly.
    let mut capabilities = presets::device("bench").unwrap();
    capabilities.mechanics.lag_s = Figure::chosen(1e-3);
    let mut device = Simulated::new(capabilities, Hand::default(), Box::new(Still(Target::default())));
    device.open().unwrap();
    device.write(&along_x(1.0)).unwrap();
    device.read(2.2e-3).unwrap();
    assert!((device.force_n().x - (1.0 - (-2.2f64).exp())).abs() < 1e-14);
}

#[test]
fn the_order_of_calls_is_kept() {
    let still = Still(Target::default());
    let mut device = Simulated::new(presets::device("touch").unwrap(), Hand::default(), Box::new(still));
    assert_eq!(device.read(0.0), Err(Fault::NotOpen));
    assert_eq!(device.write(&Command::default()), Err(Fault::NotOpen));
    device.open().unwrap();
    let first = device.read(0.0).unwrap().sequence;
    assert_eq!(device.read(1e-3).unwrap().sequence, first + 1);
    device.close();
    device.close();
    assert_eq!(device.read(0.0), Err(Fault::NotOpen));
    device.open().unwrap();
    assert!(device.read(0.0).is_ok());
}

/// Targets move without jumps, and their velocities are their positions' slopes.
#[test]
fn scripts_are_smooth() {
    let moves = [
        Move::Press { depth_m: 4e-3, seconds: 0.3 },
        Move::Drag { along_m: 0.03, across_m: -0.01, seconds: 0.4 },
        Move::Circle { radius_m: 8e-3, turns: 1.25, seconds: 0.5 },
        Move::Hold { tremor_m: 3e-4, tremor_hz: 9.0, seconds: 0.3 },
        Move::Tap { depth_m: 3e-3, times: 3, seconds: 0.6 },
        Move::Push { force_n: 1.5, seconds: 0.1 },
        Move::Turn { angles_rad: DVec3::new(0.3, -0.5, 1.2), seconds: 0.3 },
        Move::Press { depth_m: -2e-3, seconds: 0.2 },
    ];
    let script = Script::new(DVec3::X, 0.0, -DVec3::Z, DVec3::new(1.0, 0.0, 0.5), &moves).unwrap();
    assert!((script.duration_s() - 2.7).abs() < 1e-12);
    assert_eq!(script.target(0.0).position_m, DVec3::X);
    let end = script.target(9.0);
    assert!((end.position_m.z - 2e-3).abs() < 1e-12 && end.push_n == DVec3::NEG_Z * 1.5);
    assert!(end.angles_rad == DVec3::new(0.3, -0.5, 1.2) && end.rates_rad_per_s == DVec3::ZERO);
    assert_eq!(end.velocity_m_per_s, DVec3::ZERO);
    let h = 1e-6;
    for i in 1..2700 {
        let t = f64::from(i) * 1e-3;
        let [before, now, after] = [t - h, t, t + h].map(|t| script.target(t));
        let slope = (after.position_m - before.position_m) / (2.0 * h);
        assert!(slope.distance(now.velocity_m_per_s) < 2e-5, "{t}: {slope} {}", now.velocity_m_per_s);
        assert!((after.push_n - before.push_n).length() < 1e-4);
        let slope = (after.angles_rad - before.angles_rad) / (2.0 * h);
        assert!(slope.distance(now.rates_rad_per_s) < 1e-3, "{t}: {slope} {}", now.rates_rad_per_s);
    }
    for bad in [
        &[][..],
        &[Move::Press { depth_m: f64::NAN, seconds: 1.0 }],
        &[Move::Push { force_n: 1.0, seconds: 0.0 }],
        &[Move::Turn { angles_rad: DVec3::NAN, seconds: 1.0 }],
    ] {
        assert!(Script::new(DVec3::ZERO, 0.0, DVec3::Z, DVec3::X, bad).is_err());
    }
    assert!(Script::new(DVec3::ZERO, 0.0, DVec3::Z, DVec3::Z, &moves).is_err());
}
