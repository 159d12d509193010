//! No force above the limit, no step above the slew limit, ever; after a stop zero within two periods: 1,000 random
//! loops in virtual time, on random bodies or patches of them, with stages on and off, while the device goes wrong at random.

mod common;

use common::faulty::{Faulty, Odds};
use common::{Random, patch, plane, shape, uniform, with_field};
use glam::{DQuat, DVec3};
use palpate_body::Body;
use palpate_body::shape::Shape;
use palpate_device::simulated::{Hand, Move, Script};
use palpate_device::{
    Capabilities, Command, Device, Fault, Figure, OpenError, Pose, Sample, Simulated, presets,
};
use palpate_engine::{Contact, Flags};
use palpate_runtime::{
    Coupling, GENTLE_N, HapticLoop, Period, Safety, StageCounts, StageFlags, WorkspaceMap, patch_holder,
};
use std::sync::Arc;

const RUNS: u64 = 1000;
const PERIODS: u32 = 250;

/// What the runs did in all, and the nearest that they came to the limits.
#[derive(Debug, Default)]
struct Tally {
    flags: StageCounts,
    touching: u64,
    force: f64,
    step: f64,
}

fn bodies(rng: &mut Random) -> Vec<Arc<Body>> {
    let mut stiffness = || rng.range(150.0, 8000.0);
    let [k, l, m] = [stiffness(), stiffness(), stiffness()];
    let sphere = shape(Shape::Sphere { radius_mm: 30.0 }, 5.0);
    [
        plane(k, l, 0.3),
        uniform(&sphere, l, m, rng.range(0.0, 1.0)),
        with_field(&patch(0.1, 8), m, k, 0.5, &|p| 1.0 + 8.0 * (p.x + p.y)),
    ]
    .map(Arc::new)
    .to_vec()
}

fn moves(rng: &mut Random) -> Vec<Move> {
    let mut moves = vec![Move::Press { depth_m: rng.range(1e-3, 12e-3), seconds: rng.range(0.005, 0.1) }];
    for _ in 0..4 {
        let seconds = rng.range(0.01, 0.2);
        moves.push(match rng.below(4) {
            0 => Move::Press { depth_m: rng.range(-1e-3, 15e-3), seconds },
            1 => Move::Drag { along_m: rng.range(-0.02, 0.02), across_m: rng.range(-0.02, 0.02), seconds },
            2 => Move::Tap { depth_m: rng.range(-8e-3, 8e-3), times: 1 + rng.below(5) as u32, seconds },
            _ => Move::Hold { tremor_m: rng.range(0.0, 1e-3), tremor_hz: rng.range(3.0, 30.0), seconds },
        });
    }
    moves
}

/// Settings that are valid for this device and rate, most of them off half of the time.
fn settings(rng: &mut Random, rate_hz: f64, mass: f64) -> Safety {
    let mut safety = Safety::default();
    let mut maybe = |low: f64, high: f64| (rng.unit() < 0.5).then(|| rng.range(low, high));
    safety.soft_start_s = maybe(0.001, 0.1).unwrap_or(0.0);
    // A period, the device's delay and lag, and the smoothing of the estimated velocity.
    let delay = 1.0 / rate_hz + 0.4e-3 + 3e-3;
    safety.damping_n_s_per_m = maybe(0.0, 0.5 * mass / delay).unwrap_or(0.0);
    safety.force_max_n = maybe(0.5, 10.0);
    safety.speed_max_m_per_s = maybe(2.0, 20.0).unwrap_or(1000.0);
    safety.passivity = maybe(0.0, 1.0).is_some();
    let most = safety.force_max_n.unwrap_or(GENTLE_N).min(3.3);
    safety.slew_n_per_s = maybe(0.5, 2.0).map(|part| part * most * rate_hz);
    safety
}

/// No command is larger than `most`, none farther from the one before than `step`, but for zero, which is always allowed.
fn check(taken: &[Command], most: f64, step: f64, tally: &mut Tally) {
    let force = |c: &Command| DVec3::from_array(c.force_n);
    let mut before = DVec3::ZERO;
    for (i, command) in taken.iter().enumerate() {
        let force = force(command);
        assert!(force.length() <= most, "command {i}: {} N of {most} N", force.length());
        let way = if force == DVec3::ZERO { 0.0 } else { force.distance(before) };
        // What is left to rounding is that of forming the sum and of this difference.
        assert!(way <= step + 1e-14 * most, "command {i}: a step of {way} N of {step} N");
        assert_eq!(command.torque_nm, [0.0; 3]);
        tally.force = tally.force.max(force.length() / most);
        tally.step = tally.step.max(way / step);
        before = force;
    }
}

fn run(body: &Arc<Body>, seed: u64, rng: &mut Random, tally: &mut Tally) {
    let mut capabilities = presets::device("touch").unwrap();
    let mass = capabilities.mechanics.mass_kg.value;
    // The loop's limit must hold by itself: these motors would render more.
    let rate_hz = rng.range(500.0, 4000.0);
    let safety = settings(rng, rate_hz, mass);
    let mut stages = safety.stages(&capabilities, rate_hz).unwrap();
    capabilities.max_force_n = Figure::chosen(100.0);
    if rng.unit() < 0.3 {
        stages.coupling = Some(Coupling::new(rng.range(200.0, 3000.0), 5000.0));
    }
    let (most, step) = (stages.force.most(), stages.force.step());
    let map = WorkspaceMap {
        rotation: DQuat::from_euler(Default::default(), rng.range(0.0, 6.0), rng.range(0.0, 3.0), 1.0),
        scale: if rng.unit() < 0.5 { 1.0 } else { rng.range(0.5, 3.0) },
        offset_m: DVec3::Z * rng.range(-1e-3, 0.0),
        clutch: (rng.unit() < 0.3).then_some(0),
        ..WorkspaceMap::default()
    };
    // Over the top of the body, as the device sees it.
    let above = DVec3::new(rng.range(-4e-3, 4e-3), rng.range(-4e-3, 4e-3), 0.1);
    let touch = body.first_touch(above, above - DVec3::Z * 0.15, 0.0).unwrap();
    let from_body = |v: DVec3| map.rotation.conjugate() * v;
    let start = from_body(body.point(touch.at) - map.offset_m) / map.scale;
    let hand = Hand {
        mass_kg: 0.01,
        damping_n_s_per_m: 2.0,
        stiffness_n_per_m: rng.range(100.0, 2000.0),
        ..Hand::default()
    };
    let script = Script::new(start, 1e-3, from_body(-DVec3::Z), from_body(DVec3::X), &moves(rng)).unwrap();
    let mut odds = Odds::default();
    for odds in
        [&mut odds.no_number, &mut odds.frozen, &mut odds.jump, &mut odds.read_error, &mut odds.write_error]
    {
        *odds = if rng.unit() < 0.4 { rng.range(0.0, 0.03) } else { 0.0 };
    }
    let simulated = Simulated::new(capabilities, hand, Box::new(script));
    let mut device = Faulty::new(simulated, odds, seed);
    device.open().unwrap();
    let mut closed = HapticLoop::new(Contact::new(body), map, stages);
    let stop_at = rng.below(PERIODS as usize - 30) as u32;
    let (late, mut now) = (rng.unit() < 0.3, 0.0);
    // So few elements, and so seldom renewed, that the tool leaves them.
    let mut patches =
        (rng.unit() < 0.4).then(|| patch_holder(body.clone(), body.point(touch.at).to_array(), 16).unwrap());
    // Periods since the stop.
    let mut told = 0;
    for k in 0..PERIODS {
        if k == stop_at {
            closed.stop();
        }
        if k == stop_at + 20 {
            closed.resume();
        }
        now += if late && rng.unit() < 0.02 { rng.range(0.0, 0.3) } else { 1.0 / rate_hz };
        let period = match &mut patches {
            None => closed.period(&**body, &mut device, now),
            Some((patch_holder, finder)) => {
                if rng.unit() < 0.1 {
                    finder.look().unwrap();
                }
                patch_holder.renew(closed.contact_mut());
                let period = closed.period(patch_holder.patch(), &mut device, now);
                let waits =
                    period.flags.has(StageFlags::WAITED) || period.output.flags.has(Flags::PATCH_BOUNDARY);
                patch_holder.report(now, period.pose.position_m, closed.contact(), waits);
                period
            }
        };
        tally.flags.add(period.flags);
        tally.touching += u64::from(period.output.flags.has(Flags::IN_CONTACT));
        assert!(!period.output.flags.has(Flags::INVALID_POSE), "the engine was given {:?}", period.pose);
        if period.flags.has(StageFlags::STOPPED) {
            told += 1;
            let silent = period.command == Command::default();
            assert!(told < 2 || silent, "{told} periods after the stop: {:?}", period.command);
        }
    }
    // The end without reading: two commands.
    device.odds = Odds::default();
    for _ in 0..2 {
        let _ = closed.fade(&mut device, now);
    }
    assert!(closed.is_silent() && device.taken.last() == Some(&Command::default()));
    // Whichever failed writes reached the motors.
    check(&device.taken, most, step, tally);
}

#[test]
fn no_force_and_no_step_above_the_limits_whatever_goes_wrong() {
    let mut tally = Tally::default();
    for group in 0..RUNS / 20 {
        let mut rng = Random::new(group);
        let bodies = bodies(&mut rng);
        for i in 0..20 {
            run(&bodies[i % bodies.len()], 20 * group + i as u64, &mut rng, &mut tally);
        }
    }
    println!("{tally:?}");
    // No device here is idle, none is asked for a torque, nobody changes a setting, and one flag is of older recordings.
    let others = [StageFlags::REPEATED, StageFlags::IDLE, StageFlags::TORQUE_DROPPED, StageFlags::CHANGING];
    for (name, flag) in StageFlags::NAMED.into_iter().filter(|(_, flag)| !others.contains(flag)) {
        println!("{name}: {}", tally.flags.of(flag));
        assert!(tally.flags.of(flag) > 100, "{name} hardly ever happened");
    }
    assert!(tally.touching > 20_000, "{tally:?}");
    assert!(tally.force > 0.999 && tally.step > 0.999, "nothing came near the limits: {tally:?}");
}

/// A handle that is pressed 6.5 mm into a plane and does what a test says.
struct Handle {
    capabilities: Capabilities,
    cause: Option<Cause>,
    moved: f64,
    sequence: u64,
}

/// What asks for silence.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cause {
    NoNumber,
    Jump,
    Unread,
    Clutch,
    Stop,
    /// The loop leaves a period out.
    Late,
    /// Of the device's own.
    Idle,
    /// A write fails.
    Unwritten,
}

impl Device for Handle {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }
    fn open(&mut self) -> Result<(), OpenError> {
        Ok(())
    }
    fn read(&mut self, _: f64) -> Result<Sample, Fault> {
        let z = match self.cause {
            Some(Cause::NoNumber) => f64::NAN,
            Some(Cause::Jump) => 0.1,
            Some(Cause::Unread) => return Err(Fault::TimedOut),
            _ => -6.5e-3,
        };
        let pose = Pose { position_m: [1e-3 + self.moved, 2e-3, z], ..Pose::default() };
        self.sequence += 1;
        let mut sample = Sample { sequence: self.sequence, pose, ..Sample::default() };
        sample.buttons = u32::from(self.cause == Some(Cause::Clutch));
        sample.status.idle = self.cause == Some(Cause::Idle);
        Ok(sample)
    }
    fn write(&mut self, _: &Command) -> Result<(), Fault> {
        if self.cause == Some(Cause::Unwritten) { Err(Fault::TimedOut) } else { Ok(()) }
    }
    fn close(&mut self) {}
}

/// Every cause of silence is silent within two periods; afterwards the force ramps up over the soft start to what it was.
#[test]
fn each_cause_is_silent_in_time_and_the_force_grows_in_again() {
    let body = plane(600.0, 500.0, 0.3);
    for cause in [
        Cause::NoNumber,
        Cause::Jump,
        Cause::Unread,
        Cause::Clutch,
        Cause::Stop,
        Cause::Late,
        Cause::Idle,
        Cause::Unwritten,
    ] {
        let capabilities = presets::device("touch").unwrap();
        // Where a failed write is not also a command that was left out.
        let silence_s = (cause == Cause::Unwritten).then_some(1.0);
        let safety = Safety { soft_start_s: 0.05, silence_s, ..Safety::default() };
        let stages = safety.stages(&capabilities, 1000.0).unwrap();
        let map = WorkspaceMap { clutch: Some(0), ..WorkspaceMap::default() };
        let mut handle = Handle { capabilities, cause: None, moved: 0.0, sequence: 0 };
        let mut haptics = HapticLoop::new(Contact::new(&body), map, stages);
        let mut now = 0.0;
        let mut period = |haptics: &mut HapticLoop, handle: &mut Handle| {
            now += if handle.cause == Some(Cause::Late) { 2e-3 } else { 1e-3 };
            haptics.period(&body, handle, now)
        };
        // Comes from outside.
        handle.cause = Some(Cause::Jump);
        period(&mut haptics, &mut handle);
        handle.cause = None;
        let force = |p: Period| DVec3::from_array(p.command.force_n).length();
        let before: Vec<Period> = (0..100).map(|_| period(&mut haptics, &mut handle)).collect();
        let full = force(before[99]);
        assert!(full > 2.4, "{cause:?}: {full}");
        let pose = before[99].pose;
        handle.cause = Some(cause);
        if cause == Cause::Stop {
            haptics.stop();
        }
        for k in 0..8 {
            if cause == Cause::Clutch && k > 0 {
                handle.moved += 1e-3;
            }
            let silent = period(&mut haptics, &mut handle);
            // From above half of the limit it takes two periods; where nobody knows what the device renders, none.
            let at_once = matches!(cause, Cause::Late | Cause::Idle);
            let silence = silent.command == Command::default();
            assert_eq!(silence, k > 0 || at_once, "{cause:?}, {k}: {:?}", silent.command);
            assert_eq!(silent.pose, pose, "{cause:?}");
        }
        handle.cause = None;
        haptics.resume();
        let after: Vec<Period> = (0..60).map(|_| period(&mut haptics, &mut handle)).collect();
        // What failed to be written is not known to have been zero.
        let skipped = usize::from(cause == Cause::Unwritten);
        assert!(skipped == 0 || after[0].command == Command::default());
        for (k, &after) in after[skipped..].iter().enumerate() {
            let most = full * (0.02 * (k + 1) as f64).min(1.0);
            assert!(force(after) <= most + 1e-9, "{cause:?}, {k}: {} of {most}", force(after));
        }
        assert!((force(after[59]) - full).abs() < 1e-9, "{cause:?}");
    }
}
