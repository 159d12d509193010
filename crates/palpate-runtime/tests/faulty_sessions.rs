//! What the hand feels when everything goes wrong that vendors' devices do by themselves: 1,000 random sessions in virtual time,
//! on devices with watchdogs that act, firmware that switches forces off, and services that repeat a state. It is the motors'
//! force that is looked at, not the command: no force after a silence rises faster than the soft start, none is above limit or
//! slew, and it is zero within two periods of any fault.
//!
//! Half of them go through the Force Dimension driver to a stand-in whose firmware acts; the other half's device has no driver
//! that helps.

mod common;
#[path = "../../palpate-device/tests/stand_in/mod.rs"]
mod stand_in;

use common::{Random, plane};
use palpate_device::{
    Capabilities, Command, Device, Dhd, DhdOptions, Fault, OpenError, Pose, Sample, Status, presets,
};
use palpate_engine::{Contact, Flags};
use palpate_runtime::{HapticLoop, Safety, WorkspaceMap};
use stand_in::{Built, StandIn};
use std::collections::BTreeMap;

const SESSIONS: u64 = 1000;
const PERIODS: u32 = 400;
/// As long as a pose may stay the same, s.
const STALE: f64 = 0.02;

/// What goes wrong in a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Mishap {
    /// The loop comes so late that the watchdog has acted.
    Stall,
    /// The loop leaves a few periods out.
    Late,
    /// `read` fails.
    Unread,
    /// `write` fails.
    Unwritten,
    NoNumber,
    Jump,
    /// The same state again and again.
    Repeats,
    /// Forces are switched off, by a button or a grip that is let go.
    Off,
}

const MISHAPS: [Mishap; 8] = [
    Mishap::Stall,
    Mishap::Late,
    Mishap::Unread,
    Mishap::Unwritten,
    Mishap::NoNumber,
    Mishap::Jump,
    Mishap::Repeats,
    Mishap::Off,
];

/// A device, with all that can happen to it.
trait Plant {
    fn device(&mut self) -> &mut dyn Device;
    /// From now on.
    fn at(&mut self, now_s: f64, z: f64, mishap: Option<Mishap>);
    /// What the motors render, N.
    fn rendered(&mut self) -> f64;
    /// How long it waits for a command, s.
    fn watchdog_s(&self) -> f64;
}

/// A device whose service or firmware takes the force off after a while without a command, and tells nobody.
struct Bare {
    capabilities: Capabilities,
    mishap: Option<Mishap>,
    sample: Sample,
    now_s: f64,
    fed_s: f64,
    watchdog_s: f64,
    force: f64,
}

impl Device for Bare {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }
    fn open(&mut self) -> Result<(), OpenError> {
        Ok(())
    }
    fn read(&mut self, _: f64) -> Result<Sample, Fault> {
        if self.mishap == Some(Mishap::Unread) { Err(Fault::Garbled) } else { Ok(self.sample) }
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        if self.mishap == Some(Mishap::Unwritten) {
            return Err(Fault::TimedOut);
        }
        let off = self.mishap == Some(Mishap::Off);
        (self.force, self.fed_s) = (if off { 0.0 } else { command.force_n[2] }, self.now_s);
        Ok(())
    }
    fn close(&mut self) {}
}

impl Plant for Bare {
    fn device(&mut self) -> &mut dyn Device {
        self
    }
    fn at(&mut self, now_s: f64, z: f64, mishap: Option<Mishap>) {
        (self.now_s, self.mishap) = (now_s, mishap);
        if !matches!(mishap, Some(Mishap::Repeats | Mishap::Unread)) {
            self.sample.sequence += 1;
            self.sample.pose = Pose { position_m: [1e-3, 2e-3, z], ..Pose::default() };
        }
        self.sample.status = Status { idle: mishap == Some(Mishap::Off), ..Status::default() };
    }
    fn rendered(&mut self) -> f64 {
        if self.now_s - self.fed_s > self.watchdog_s || self.mishap == Some(Mishap::Off) {
            self.force = 0.0;
        }
        self.force
    }
    fn watchdog_s(&self) -> f64 {
        self.watchdog_s
    }
}

/// The Force Dimension driver and a stand-in for the vendor's library, with its firmware.
struct Firmware<'a>(Dhd, &'a StandIn);

impl Plant for Firmware<'_> {
    fn device(&mut self) -> &mut dyn Device {
        &mut self.0
    }
    fn at(&mut self, now_s: f64, z: f64, mishap: Option<Mishap>) {
        let is = |other| mishap == Some(other);
        self.1.set("now", now_s);
        if mishap != Some(Mishap::Repeats) {
            self.1.set("z", z);
        }
        // Below 0 an error, 1 for nothing new.
        let read = if is(Mishap::Unread) { -1.0 } else { f64::from(u8::from(is(Mishap::Repeats))) };
        self.1.set("position", read);
        self.1.set("force", if is(Mishap::Unwritten) { -1.0 } else { 0.0 });
        self.1.set("forces_on", if is(Mishap::Off) { 0.0 } else { 1.0 });
    }
    fn rendered(&mut self) -> f64 {
        self.1.rendered()[2]
    }
    fn watchdog_s(&self) -> f64 {
        0.02
    }
}

/// What happened in all, and the nearest that the forces came to what is allowed.
#[derive(Debug, Default)]
struct Tally {
    mishaps: BTreeMap<Mishap, u32>,
    touching: u32,
    at_limit: u32,
    /// After a silence, without a driver's help and with it.
    rises: [u32; 2],
    watchdog: u32,
}

fn session(plant: &mut dyn Plant, start_s: f64, rng: &mut Random, tally: &mut Tally, kind: usize) -> f64 {
    let body = plane(rng.range(600.0, 6000.0), 500.0, 0.3);
    let rate_hz = rng.range(500.0, 2000.0);
    let safety = Safety {
        soft_start_s: rng.range(0.02, 0.2),
        force_max_n: Some(rng.range(0.5, 3.0)),
        ..Safety::default()
    };
    let (period_s, grows) = (1.0 / rate_hz, 1.0 / (rate_hz * safety.soft_start_s));
    let stages = safety.stages(plant.device().capabilities(), rate_hz).unwrap();
    let (most, slew) = (stages.force.most(), stages.force.step());
    let mut haptics = HapticLoop::new(Contact::new(&body), WorkspaceMap::default(), stages);
    let frequency = rng.range(1.0, 8.0);
    let mut now = start_s;
    let (mut mishap, mut left) = (None, 0);
    // The share that the soft start may let through, and for how many periods there was a reason for silence.
    let (mut share, mut silent) = (0.0_f64, 0);
    // When the last new pose came, and the force before.
    let (mut came, mut last) = (now, 0.0);
    let mut lost = false;
    for k in 0..PERIODS {
        if left == 0 {
            mishap = (k > 30 && rng.unit() < 0.06).then(|| MISHAPS[rng.below(MISHAPS.len())]);
            left = match mishap {
                // Until it is noticed that forces are off: the status is asked for in every sixteenth read.
                Some(Mishap::Off) => 20 + rng.below(20),
                Some(Mishap::Repeats) => 1 + rng.below(60),
                Some(Mishap::Late | Mishap::Stall) | None => 1,
                _ => 1 + rng.below(8),
            };
            mishap.into_iter().for_each(|m| *tally.mishaps.entry(m).or_default() += 1);
        }
        left -= 1;
        let passed = match mishap {
            Some(Mishap::Late) => rng.range(2.0, 8.0) * period_s,
            Some(Mishap::Stall) => rng.range(0.02, 0.06),
            _ => period_s,
        };
        now += passed;
        // Down from above, and then in the body all the time: without a fault there is always a force.
        let t = now - start_s;
        let held = -5e-3 - 3e-3 * libm::sin(t * frequency * std::f64::consts::TAU);
        let mut z = (1e-3 - 0.3 * t).max(held);
        match mishap {
            Some(Mishap::NoNumber) => z = f64::NAN,
            Some(Mishap::Jump) => z -= 5.0,
            _ => {}
        }
        plant.at(now, z, mishap);
        // What the watchdog has made of the last command.
        let held = plant.rendered();
        if held == 0.0 && last > 0.0 && passed > plant.watchdog_s() {
            tally.watchdog += 1;
        }
        last = f64::min(last, held);
        let period = haptics.period(&body, plant.device(), now);
        if !matches!(mishap, Some(Mishap::Repeats | Mishap::Unread)) {
            came = now;
        }
        let stale = now - came > STALE;
        let bad = !matches!(mishap, None | Some(Mishap::Repeats | Mishap::Unwritten));
        let cause = bad || stale || lost;
        lost = mishap == Some(Mishap::Unwritten);
        let rendered = plant.rendered();
        let told = format!("{mishap:?} in period {k} at {now:.4}: {last} N, then {rendered} N; {period:?}");
        tally.touching += u32::from(period.output.flags.has(Flags::IN_CONTACT));
        tally.at_limit += u32::from(rendered > 0.999 * most);
        tally.rises[kind] += u32::from(!cause && silent > 0 && rendered > 0.0);
        // No force above the limit, or farther from the last than the slew, but for zero.
        assert!((0.0..=most).contains(&rendered), "{told}");
        assert!(rendered == 0.0 || (rendered - last).abs() <= slew * (1.0 + 1e-9), "{told}");
        // Zero within two periods of any fault.
        silent = if cause { silent + 1 } else { 0 };
        assert!(silent < 2 || lost || rendered == 0.0, "{told}");
        // And no more afterwards than the soft start lets through.
        share = if cause { 0.0 } else { f64::min(share + grows, 1.0) };
        assert!(cause || rendered <= share * most * (1.0 + 1e-9), "{share} of {most} N: {told}");
        assert!(!cause || rendered <= last, "{told}");
        last = rendered;
    }
    now
}

#[test]
fn no_force_after_a_silence_rises_faster_than_the_soft_start() {
    let built = Built::new("dhd");
    let library = built.copy();
    let mut tally = Tally::default();
    let mut now = 1.0;
    for seed in 0..SESSIONS {
        let mut rng = Random::new(seed);
        if seed % 2 == 0 {
            let mut plant = Bare {
                capabilities: presets::device("touch").unwrap(),
                mishap: None,
                sample: Sample::default(),
                now_s: now,
                fed_s: now,
                watchdog_s: [5e-3, 0.02][rng.below(2)],
                force: 0.0,
            };
            now = session(&mut plant, now, &mut rng, &mut tally, 0);
        } else {
            let options = DhdOptions { library: Some(library.file.clone()), ..DhdOptions::default() };
            library.set("now", now);
            let mut device = Dhd::new(options);
            device.open().unwrap();
            now = session(&mut Firmware(device, &library), now, &mut rng, &mut tally, 1);
            for call in ["position", "force"] {
                library.set(call, 0.0);
            }
            library.set("forces_on", 1.0);
            library.take_log();
        }
    }
    println!("{tally:?}");
    assert!(MISHAPS.iter().all(|m| tally.mishaps[m] > 1000), "{tally:?}");
    assert!(tally.touching > 200_000 && tally.at_limit > 5_000, "{tally:?}");
    assert!(tally.watchdog > 500 && tally.rises.iter().all(|&rises| rises > 2_000), "{tally:?}");
}
