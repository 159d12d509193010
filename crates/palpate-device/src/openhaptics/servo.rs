//! What runs in the scheduler's thread.

use super::calls::{self, Calls, Handle};
use crate::frame::Axes;
use crate::latest::{Reader, Writer, exchange};
use crate::{Pose, Sample, Status};
use std::ffi::{c_uint, c_void};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const DONE: c_uint = 0;
const CONTINUE: c_uint = 1;
const MM: f64 = 1e-3;

/// Numbers of a pose under way: count, position (3, mm), the transform's rotation (9), velocity (3, mm/s), buttons, warm,
/// cut by the device.
pub(super) const POSE: usize = 19;

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
    enabled: bool,
    count: f64,
}

/// What both threads see besides poses and forces.
#[derive(Debug, Default)]
pub(super) struct Shared {
    stop: AtomicBool,
    done: AtomicBool,
    /// The vendor's number of an error that matters, until a callback goes well; 0 for none.
    fault: AtomicU32,
}

impl Shared {
    pub(super) fn fault(&self) -> Option<u32> {
        Some(self.fault.load(Ordering::Relaxed)).filter(|code| *code != 0)
    }

    /// Lets the callback render nothing and end; whether it did within `patience`.
    pub(super) fn stop(&self, patience: Duration) -> bool {
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
            enabled: false,
            count: 0.0,
        };
        (servo, poses_out, forces_in, shared)
    }

    fn tick(&mut self) -> c_uint {
        let calls = &self.calls;
        let stop = self.shared.stop.load(Ordering::Acquire);
        calls.make_current(self.device);
        match self.forces.take() {
            Some(force) => (self.force, self.quiet) = (force, 0),
            None => self.quiet = self.quiet.saturating_add(1),
        }
        if stop || self.quiet > self.quiet_most {
            self.force = [0.0; 3];
        }
        // The loop sends its first force after its first good pose.
        if !self.enabled && self.quiet == 0 && !stop {
            calls.enable_forces();
            self.enabled = true;
        }
        calls.begin(self.device);
        let mut pose = self.measure();
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
        if fault == 0 {
            self.count += 1.0;
            (pose[0], pose[17], pose[18]) = (self.count, f64::from(u8::from(warm)), f64::from(u8::from(cut)));
            self.poses.put(&pose);
        }
        if stop {
            self.shared.done.store(true, Ordering::Release);
            return DONE;
        }
        CONTINUE
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
    let status = Status { idle: false, warm: pose[17] > 0.0, saturated: pose[18] > 0.0 };
    position_m.iter().all(|x| x.is_finite()).then(|| Sample {
        sequence: pose[0] as u64,
        pose: Pose { position_m, orientation },
        velocity_m_per_s: Some(velocity).filter(|v| v.iter().all(|x| x.is_finite())),
        buttons: pose[16] as u32,
        status,
    })
}
