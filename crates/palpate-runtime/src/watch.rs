//! The watchdogs: what ends a loop before its time.

use palpate_device::Fault;
use serde::{Deserialize, Serialize};
use std::fmt;

/// How long what is wrong may last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Patience {
    /// Without a new pose from the device, s.
    pub pose_s: f64,
    /// By which a period may be late, s.
    pub late_s: f64,
    /// Without a look of the contact finder, s.
    pub finder_s: f64,
    /// Periods in a row in which the device does not answer, or not sensibly.
    pub faults: u32,
}

impl Default for Patience {
    fn default() -> Self {
        Patience { pose_s: 0.1, late_s: 0.1, finder_s: 0.5, faults: 10 }
    }
}

/// Why a loop ended.
#[derive(Debug, Clone, PartialEq)]
pub enum End {
    /// Its time was over.
    Done,
    /// The device had no more poses: a replay's end.
    Ended,
    /// Somebody asked for it.
    Asked(&'static str),
    /// An emergency stop: why.
    Emergency(&'static str),
    /// The device: in its words.
    Device(String),
    /// The device's pose stayed the same for this long, s, by its own counter.
    Stale(f64),
    /// A period was late by this much, s.
    Late(f64),
    /// The contact finder has not looked for this long, s.
    FinderSilent(f64),
    /// The body's file gives no more patches: why.
    Body(String),
    /// The contact finder ended.
    FinderDead,
    /// The haptic thread panicked: with this.
    Panic(String),
}

impl End {
    /// A word for it that stays the same, whatever the message says.
    pub fn kind(&self) -> &'static str {
        match self {
            End::Done => "done",
            End::Ended => "ended",
            End::Asked(_) => "asked",
            End::Emergency(_) => "emergency",
            End::Device(_) => "device",
            End::Stale(_) => "stale",
            End::Late(_) => "late",
            End::FinderSilent(_) => "finder-silent",
            End::Body(_) => "body",
            End::FinderDead => "finder-dead",
            End::Panic(_) => "panic",
        }
    }

    /// Whether it went as it should.
    pub fn is_well(&self) -> bool {
        matches!(self, End::Done | End::Ended | End::Asked(_))
    }
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            End::Done => write!(f, "the time is over"),
            End::Ended => write!(f, "the device's poses are at their end"),
            End::Asked(by) | End::Emergency(by) => write!(f, "{by}"),
            End::Device(words) => write!(f, "{words}"),
            End::Stale(s) => write!(f, "the device has had no new pose for {s:.3} s"),
            End::Late(s) => {
                write!(f, "a period came {:.1} ms late: the machine is too busy for this loop", s * 1e3)
            }
            End::FinderSilent(s) => write!(f, "the contact finder has been silent for {s:.3} s"),
            End::Body(words) => write!(f, "{words}"),
            End::FinderDead => write!(f, "the contact finder's thread is gone"),
            End::Panic(words) => write!(f, "the haptic thread panicked: {words}"),
        }
    }
}

/// What ended it, as the haptic thread knows it: plain data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Alarm {
    Fault(Fault),
    Stale(f64),
    Late(f64),
    FinderSilent(f64),
}

/// What is watched from period to period.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Watch {
    patience: Patience,
    /// The device's counter, and since when it is the same, s.
    pose: Option<(u64, f64)>,
    beats: (u64, f64),
    faults: u32,
}

impl Watch {
    pub fn new(patience: Patience) -> Self {
        Watch { patience, pose: None, beats: (0, 0.0), faults: 0 }
    }

    /// At the beginning of a period, `late_s` after its due time.
    pub fn begin(&mut self, now_s: f64, late_s: f64, beats: u64) -> Option<Alarm> {
        if beats != self.beats.0 {
            self.beats = (beats, now_s);
        }
        let silent = now_s - self.beats.1;
        if late_s > self.patience.late_s {
            Some(Alarm::Late(late_s))
        } else {
            (silent > self.patience.finder_s).then_some(Alarm::FinderSilent(silent))
        }
    }

    /// At its end: what the device said.
    pub fn end(&mut self, now_s: f64, sequence: u64, fault: Option<Fault>) -> Option<Alarm> {
        if let Some(fault) = fault {
            self.faults += 1;
            let passing = matches!(fault, Fault::TimedOut | Fault::Garbled);
            return (!passing || self.faults >= self.patience.faults).then_some(Alarm::Fault(fault));
        }
        self.faults = 0;
        match self.pose {
            Some((same, since)) if same == sequence => {
                let stale = now_s - since;
                (stale > self.patience.pose_s).then_some(Alarm::Stale(stale))
            }
            _ => {
                self.pose = Some((sequence, now_s));
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_alarm_goes_off_when_its_patience_ends_and_not_before() {
        let patience = Patience { pose_s: 0.01, late_s: 0.005, finder_s: 0.02, faults: 3 };
        let mut watch = Watch::new(patience);
        assert_eq!(watch.begin(0.0, 0.0049, 1), None);
        assert_eq!(watch.begin(0.001, 0.0051, 1), Some(Alarm::Late(0.0051)));
        assert_eq!(watch.begin(0.019, 0.0, 1), None);
        assert!(matches!(watch.begin(0.021, 0.0, 1), Some(Alarm::FinderSilent(_))));
        assert_eq!(watch.begin(0.022, 0.0, 2), None);
        assert_eq!(watch.end(0.0, 7, None), None);
        assert_eq!(watch.end(0.0095, 7, None), None);
        assert_eq!(watch.end(0.0096, 8, None), None);
        assert!(matches!(watch.end(0.02, 8, None), Some(Alarm::Stale(_))));
        // Long after the clock's zero as well.
        let mut late = Watch::new(patience);
        assert_eq!(late.end(5.0, 7, None), None);
        assert_eq!(late.end(5.0099, 7, None), None);
        assert!(matches!(late.end(5.0101, 7, None), Some(Alarm::Stale(s)) if s < 0.011));
        for fault in [Fault::TimedOut, Fault::Garbled] {
            assert_eq!(watch.end(0.1, 9, Some(fault)), None);
            assert_eq!(watch.end(0.1, 9, Some(fault)), None);
            assert_eq!(watch.end(0.1, 9, Some(fault)), Some(Alarm::Fault(fault)));
            assert_eq!(watch.end(0.1, 9 + watch.faults as u64, None), None);
        }
        assert_eq!(watch.end(0.1, 9, Some(Fault::Disconnected)), Some(Alarm::Fault(Fault::Disconnected)));
    }
}
