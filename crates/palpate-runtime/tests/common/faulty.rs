//! A device that goes wrong: what drivers, cables and clocks do, at random.

use super::Random;
use palpate_device::{Capabilities, Command, Device, Fault, OpenError, Sample};

/// How often each fault begins, per period.
#[derive(Debug, Clone, Copy, Default)]
pub struct Odds {
    pub no_number: f64,
    pub frozen: f64,
    pub jump: f64,
    pub read_error: f64,
    pub write_error: f64,
}

/// A device with faults between it and the loop.
pub struct Faulty<D> {
    pub device: D,
    pub odds: Odds,
    rng: Random,
    last: Sample,
    /// Periods for which the pose stays frozen, and is off by 10 cm.
    frozen: u32,
    off: u32,
    /// What the device took, in order.
    pub taken: Vec<Command>,
    /// Whether the last write was reported as failed.
    pub failed: bool,
}

impl<D: Device> Faulty<D> {
    pub fn new(device: D, odds: Odds, seed: u64) -> Self {
        Faulty {
            device,
            odds,
            rng: Random::new(seed),
            last: Sample::default(),
            frozen: 0,
            off: 0,
            taken: Vec::new(),
            failed: false,
        }
    }

    fn happens(&mut self, odds: f64) -> bool {
        self.rng.unit() < odds
    }

    fn error(&mut self) -> Fault {
        [Fault::TimedOut, Fault::Disconnected, Fault::Garbled, Fault::Code(-3)][self.rng.below(4)]
    }
}

impl<D: Device> Device for Faulty<D> {
    fn capabilities(&self) -> &Capabilities {
        self.device.capabilities()
    }
    fn open(&mut self) -> Result<(), OpenError> {
        self.device.open()
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        let mut sample = self.device.read(now_s)?;
        if self.happens(self.odds.read_error) {
            return Err(self.error());
        }
        if self.happens(self.odds.frozen) {
            self.frozen = self.rng.below(40) as u32;
        }
        if self.happens(self.odds.jump) {
            self.off = 1 + self.rng.below(30) as u32;
        }
        if self.frozen > 0 {
            self.frozen -= 1;
            return Ok(self.last);
        }
        self.last = sample;
        if self.off > 0 {
            self.off -= 1;
            sample.pose.position_m[2] -= 0.1;
        }
        if self.happens(self.odds.no_number) {
            let wrong = [f64::NAN, f64::INFINITY, -f64::MAX][self.rng.below(3)];
            match self.rng.below(3) {
                0 => sample.pose.position_m[self.rng.below(3)] = wrong,
                1 => sample.pose.orientation[self.rng.below(4)] = f64::NAN,
                _ => {
                    sample.velocity_m_per_s = Some([wrong; 3]);
                    sample.angular_velocity_rad_per_s = Some([wrong; 3]);
                }
            }
        }
        // Buttons come and go.
        sample.buttons = u32::from((now_s * 3.0).fract() < 0.1);
        Ok(sample)
    }
    /// A write that fails may or may not have reached the motors.
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        self.failed = self.happens(self.odds.write_error);
        if !self.failed || self.rng.unit() < 0.5 {
            self.taken.push(*command);
            self.device.write(command)?;
        }
        if self.failed { Err(self.error()) } else { Ok(()) }
    }
    fn close(&mut self) {
        self.device.close();
    }
}
