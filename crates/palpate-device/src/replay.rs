//! A device that moves as it once did.

use crate::{Capabilities, Command, Device, Fault, Figure, OpenError, Pose, Sample, presets};

/// Where the handle was, and when.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReplaySample {
    /// s, on the loop's clock, never decreasing from one sample to the next.
    pub time_s: f64,
    /// Where.
    pub pose: Pose,
    /// Bit i is button i, 1 while pressed.
    pub buttons: u32,
}

/// Gives recorded poses at their times, and renders nothing, whatever force is commanded.
///
/// `read` gives the newest sample that is not after the loop's time; before the first one, the first. When the last one
/// was given and is past, `read` says [`Fault::Ended`].
#[derive(Debug)]
pub struct Replay {
    capabilities: Capabilities,
    samples: Vec<ReplaySample>,
    /// The sample that was given last, from 1; `None` while closed.
    given: Option<usize>,
}

impl Replay {
    /// A replay of these samples, with a workspace just as large as they need.
    pub fn new(samples: Vec<ReplaySample>) -> Self {
        let mut capabilities = presets::device("bench").expect("a preset by its own name");
        capabilities.name = "replay".into();
        capabilities.max_force_n = Figure::chosen(f64::INFINITY);
        capabilities.max_stiffness_n_per_m = Figure::chosen(f64::INFINITY);
        (capabilities.sensed.rotations, capabilities.buttons) = (3, u32::BITS);
        for axis in 0..3 {
            let along = || samples.iter().map(|s| s.pose.position_m[axis]).filter(|x| x.is_finite());
            let (least, most) =
                (along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max));
            if least <= most {
                capabilities.workspace.centre_m[axis] = 0.5 * (least + most);
                capabilities.workspace.half_extent_m[axis] = 0.5 * (most - least);
            }
        }
        Replay { capabilities, samples, given: None }
    }

    /// The same, as a device that can do this: the one that was recorded.
    pub fn with_capabilities(self, capabilities: Capabilities) -> Self {
        Replay { capabilities, ..self }
    }

    /// When it ends, s.
    pub fn duration_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |s| s.time_s)
    }
}

impl Device for Replay {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }

    /// # Errors
    /// There is no sample, or a time is NaN or infinite, or before the one ahead of it.
    fn open(&mut self) -> Result<(), OpenError> {
        let wrong =
            |problem, hint: &str| Err(OpenError { device: "replay".into(), problem, hint: hint.into() });
        if self.samples.is_empty() {
            return wrong("there is no sample in it".into(), "give one at least");
        }
        let mut before = f64::NEG_INFINITY;
        for (k, sample) in self.samples.iter().enumerate() {
            if !(sample.time_s >= before && sample.time_s.is_finite()) {
                let problem = format!("sample {} is at {} s, after one at {before} s", k + 1, sample.time_s);
                return wrong(problem, "order the samples by time, with a finite time for each");
            }
            before = sample.time_s;
        }
        self.given = Some(0);
        Ok(())
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        let given = self.given.ok_or(Fault::NotOpen)?;
        if given == self.samples.len() && now_s > self.duration_s() {
            return Err(Fault::Ended);
        }
        let ahead = &self.samples[given..];
        let newest = (given + ahead.partition_point(|s| s.time_s <= now_s)).max(1);
        self.given = Some(newest);
        let ReplaySample { pose, buttons, .. } = self.samples[newest - 1];
        if !pose.position_m.iter().chain(&pose.orientation).all(|x| x.is_finite()) {
            return Err(Fault::Garbled);
        }
        Ok(Sample { sequence: newest as u64, pose, buttons, ..Sample::default() })
    }

    fn write(&mut self, _: &Command) -> Result<(), Fault> {
        self.given.map(|_| ()).ok_or(Fault::NotOpen)
    }

    fn close(&mut self) {
        self.given = None;
    }
}

#[cfg(doctest)]
#[doc = include_str!("../../../docs/devices/replay.md")]
struct Page;
