//! How long a device's read and write take.

use palpate_device::{Capabilities, Command, Device, EmergencyStop, Fault, OpenError, Sample};
use std::sync::Arc;

/// A device with a watch beside it: `clock` tells ns since whenever.
#[derive(Debug)]
pub struct Timed<D, C> {
    /// The device.
    pub device: D,
    /// What the last read took, ns.
    pub read_ns: u64,
    /// What the last write took, ns.
    pub write_ns: u64,
    clock: C,
}

impl<D, C> Timed<D, C> {
    /// Puts the watch beside `device`.
    pub fn new(device: D, clock: C) -> Self {
        Timed { device, read_ns: 0, write_ns: 0, clock }
    }
}

impl<D: Device, C: Fn() -> u64 + Send> Device for Timed<D, C> {
    fn capabilities(&self) -> &Capabilities {
        self.device.capabilities()
    }

    fn open(&mut self) -> Result<(), OpenError> {
        self.device.open()
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        let before = (self.clock)();
        let sample = self.device.read(now_s);
        self.read_ns = (self.clock)().saturating_sub(before);
        sample
    }

    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        let before = (self.clock)();
        let written = self.device.write(command);
        self.write_ns = (self.clock)().saturating_sub(before);
        written
    }

    fn close(&mut self) {
        self.device.close();
    }

    fn notes(&self) -> &[String] {
        self.device.notes()
    }

    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        self.device.emergency_stop()
    }

    fn explain(&self, fault: Fault) -> String {
        self.device.explain(fault)
    }
}
