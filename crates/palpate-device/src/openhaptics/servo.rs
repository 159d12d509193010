//! What runs in the scheduler's thread.

use super::calls::{self, Calls, Handle};
use crate::frame::Axes;
use crate::latch::Latch;
use crate::latest::{Reader, Writer, exchange};
use crate::{EmergencyStop, Pose, Sample, Status};
use std::ffi::{c_uint, c_void};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const DONE: c_uint = 0;
const CONTINUE: c_uint = 1;
const MM: f64 = 1e-3;

/// Numbers of a pose under way: count, position (3, mm), the transform's rotation (9), velocity (3, mm/s), buttons, warm,
/// cut by the device, idle.
pub(super) const POSE: usize = 20;

/// One device's part of the scheduler's thread.
#[derive(Debug)]
pub(super) struct Servo {
    calls: Arc<Calls>,
    device: Handle,
    poses: Writer<POSE>,
    forces: Reader<3>,
    shared: Arc<Shared>,
    force: [f64; 3],
    /// Callbacks since the loop's last force, and how many are too many.
    quiet: u32,
    quiet_most: u32,
    latch: Latch,
    enabled: bool,
    calibration: Calibration,
    count: f64,
}

/// What is known of the calibration. It is made up for, if it has to be, before the first pose, and never with forces on.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Calibration {
    Unasked,
    Updated,
    Known,
}

/// What both threads see besides poses and forces.
#[derive(Debug, Default)]
pub(super) struct Shared {
    stop: AtomicBool,
    done: AtomicBool,
    /// The vendor's number of an error that matters, until a callback goes well; 0 for none.
    fault: AtomicU32,
    /// What the vendor says of the calibration; 0 if nothing.
    calibration: AtomicU32,
    /// An emergency stop.
    halted: AtomicBool,
}

impl EmergencyStop for Shared {
    fn stop(&self) {
        self.halted.store(true, Ordering::SeqCst);
    }
}

impl Shared {
    pub(super) fn fault(&self) -> Option<u32> {
        Some(self.fault.load(Ordering::Relaxed)).filter(|code| *code != 0)
    }

    /// As the vendor numbers it, if it says so.
    pub(super) fn calibration(&self) -> Option<u32> {
        Some(self.calibration.load(Ordering::Relaxed)).filter(|code| *code != 0)
    }

    /// Lets the callback render nothing and end; whether it did within `patience`.
    pub(super) fn end(&self, patience: Duration) -> bool {
        self.stop.store(true, Ordering::Release);
        let start = Instant::now();
        while !self.done.load(Ordering::Acquire) && start.elapsed() < patience {
            thread::sleep(Duration::from_micros(200));
        }
        self.done.load(Ordering::Acquire)
    }
}

/// What the vendor calls once a period.
///
/// # Safety
/// `servo` is a [`Servo`] that nobody else uses while this runs.
#[allow(unsafe_code, reason = "the vendor's thread hands back the pointer that it was given")]
pub(super) unsafe extern "C" fn callback(servo: *mut c_void) -> c_uint {
    // SAFETY: the caller's promise.
    unsafe { &mut *servo.cast::<Servo>() }.tick()
}

/// # Panics
/// Never. Must only be given what `Box::into_raw` gave, once, and when no callback can come any more.
#[allow(unsafe_code, reason = "it was the scheduler's, and comes back as a pointer")]
pub(super) fn free(servo: *mut Servo) {
    // SAFETY: from `Box::into_raw`, and the last callback has returned.
    drop(unsafe { Box::from_raw(servo) });
}

impl Servo {
    pub(super) fn new(
        calls: Arc<Calls>,
        device: Handle,
        quiet_most: u32,
    ) -> (Self, Reader<POSE>, Writer<3>, Arc<Shared>) {
        let (poses, poses_out) = exchange();
        let (forces_in, forces) = exchange();
        let shared = Arc::new(Shared::default());
        let (force, quiet) = ([0.0; 3], 0);
        let servo = Servo {
            calls,
            device,
            poses,
            forces,
            shared: shared.clone(),
            force,
            quiet,
            quiet_most,
            latch: Latch::default(),
            enabled: false,
            calibration: Calibration::Unasked,
            count: 0.0,
        };
        (servo, poses_out, forces_in, shared)
    }

    fn tick(&mut self) -> c_uint {
        let calls = &self.calls;
        let halted = self.shared.halted.load(Ordering::SeqCst);
        let stop = self.shared.stop.load(Ordering::Acquire);
        calls.make_current(self.device);
        let off = self.enabled && calls.forces_are_off();
        if off {
            self.latch.close();
        }
        match self.forces.take() {
            Some(force) => (self.force, self.quiet) = (self.latch.pass(force), 0),
            None => self.quiet = self.quiet.saturating_add(1),
        }
        if self.quiet > self.quiet_most && self.enabled {
            self.latch.close();
        }
        if stop || halted || self.latch.is_closed() {
            self.force = [0.0; 3];
        }
        // The loop sends its first force after its first good pose; and zero, before what the device switched off is on again.
        let rearm = off && !self.latch.is_closed();
        if (!self.enabled || rearm) && self.quiet == 0 && !stop && !halted {
            calls.enable_forces();
            self.enabled = true;
        }
        calls.begin(self.device);
        let mut pose = self.measure();
        let calibration = (self.calibration != Calibration::Known).then(|| calls.calibration());
        if self.enabled || stop {
            calls.set_force(self.force);
        }
        calls.end(self.device);
        let (mut warm, mut cut, mut fault) = (false, false, 0);
        for code in calls.errors() {
            warm |= code == calls::WARM;
            cut |= calls::harmless(code) && code != calls::WARM;
            if !calls::harmless(code) {
                fault = code;
            }
        }
        self.shared.fault.store(fault, Ordering::Relaxed);
        let idle = off || self.latch.is_closed();
        if let Some(told) = calibration {
            self.calibrate(told);
        }
        if fault == 0 && self.calibration == Calibration::Known {
            self.count += 1.0;
            pose[0] = self.count;
            pose[17..].copy_from_slice(&[warm, cut, idle].map(|is| f64::from(u8::from(is))));
            self.poses.put(&pose);
        }
        if stop {
            self.shared.done.store(true, Ordering::Release);
            return DONE;
        }
        CONTINUE
    }

    /// Outside of a frame: makes up for a calibration that only has to be taken over, once.
    fn calibrate(&mut self, told: Option<u32>) {
        if told == Some(calls::CALIBRATION_NEEDS_UPDATE) && self.calibration == Calibration::Unasked {
            self.calls.calibrate();
            // What it could not do is seen by asking again.
            self.calls.errors().for_each(drop);
            self.calibration = Calibration::Updated;
        } else {
            self.shared.calibration.store(told.unwrap_or_default(), Ordering::Relaxed);
            self.calibration = Calibration::Known;
        }
    }

    /// Inside a frame.
    fn measure(&self) -> [f64; POSE] {
        let mut pose = [0.0; POSE];
        let transform = self.calls.doubles::<16>(calls::TRANSFORM);
        pose[1..4].copy_from_slice(&self.calls.doubles::<3>(calls::POSITION));
        for column in 0..3 {
            pose[4 + 3 * column..7 + 3 * column].copy_from_slice(&transform[4 * column..4 * column + 3]);
        }
        pose[13..16].copy_from_slice(&self.calls.doubles::<3>(calls::VELOCITY));
        pose[16] = f64::from(self.calls.buttons());
        pose
    }
}

/// A pose as the loop sees it: m, m/s, the crate's axes. `None` where it holds NaN or infinity or no rotation.
pub(super) fn sample(pose: &[f64; POSE]) -> Option<Sample> {
    let three = |at: usize| [pose[at], pose[at + 1], pose[at + 2]];
    let position_m = Axes::Y_UP.ours(three(1).map(|mm| mm * MM));
    let orientation = Axes::Y_UP.orientation([three(4), three(7), three(10)])?;
    let velocity = Axes::Y_UP.ours(three(13).map(|mm| mm * MM));
    let status = Status { warm: pose[17] > 0.0, saturated: pose[18] > 0.0, idle: pose[19] > 0.0 };
    position_m.iter().all(|x| x.is_finite()).then(|| Sample {
        sequence: pose[0] as u64,
        pose: Pose { position_m, orientation },
        velocity_m_per_s: Some(velocity).filter(|v| v.iter().all(|x| x.is_finite())),
        angular_velocity_rad_per_s: None,
        buttons: pose[16] as u32,
        status,
    })
}
