//! A recording, looked at again.

use glam::DVec3;
use palpate::runtime::{Ending, Header, Record, Recording};
use std::path::{Path, PathBuf};

/// Periods that are kept of a recording; of a longer one every second, third, … is.
const KEPT: usize = 600_000;

/// A recording and where in it one is.
#[derive(Debug, Clone)]
pub struct Playback {
    /// Its file.
    pub file: PathBuf,
    /// What it says of itself.
    pub header: Header,
    /// Its periods, one at least, in the order of time.
    pub records: Vec<Record>,
    /// How many periods of the recording there are for each that is kept.
    pub stride: usize,
    /// How it ended, in words.
    pub ending: String,
    /// The time that is shown, s.
    time_s: f64,
    /// Whether it goes on by itself.
    pub is_playing: bool,
    /// How fast: 1 as it was.
    pub speed: f64,
}

impl Playback {
    /// Reads a recording, as far as it is whole.
    ///
    /// # Errors
    /// It can't be read, or has no period.
    pub fn read(file: &Path) -> Result<Self, String> {
        let mut recording = Recording::open(file).map_err(|e| e.to_string())?;
        let header = recording.header().clone();
        let (mut records, mut stride, mut count) = (Vec::new(), 1, 0usize);
        for record in &mut recording {
            // What is no time or out of order can't be gone to.
            let follows = records.last().is_none_or(|last: &Record| record.time_s >= last.time_s);
            if !(record.time_s.is_finite() && follows) {
                continue;
            }
            if count.is_multiple_of(stride) {
                records.push(record);
            }
            count += 1;
            if records.len() > KEPT {
                let mut nth = 0;
                records.retain(|_| {
                    nth += 1;
                    nth % 2 == 1
                });
                stride *= 2;
            }
        }
        let ending = match recording.ending() {
            Some(Ending::Clean { reason, dropped: 0 }) => format!("ended: {reason}"),
            Some(Ending::Clean { reason, dropped }) => {
                format!("ended: {reason}; {dropped} periods were dropped")
            }
            Some(_) => "cut off: what came before is whole".into(),
            None => String::new(),
        };
        let Some(first) = records.first() else {
            return Err(format!("{}: it holds no period; record one first", file.display()));
        };
        let time_s = first.time_s;
        let file = file.to_path_buf();
        Ok(Playback { file, header, records, stride, ending, time_s, is_playing: false, speed: 1.0 })
    }

    /// From the first period to the last, s.
    pub fn span_s(&self) -> [f64; 2] {
        [self.records.first(), self.records.last()].map(|r| r.map_or(0.0, |r| r.time_s))
    }

    /// The number of the period that is shown.
    pub fn index(&self) -> usize {
        self.records.partition_point(|r| r.time_s <= self.time_s).saturating_sub(1)
    }

    /// The period that is shown.
    pub fn record(&self) -> Option<&Record> {
        self.records.get(self.index())
    }

    /// The time that is shown, s.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Goes to a time, s.
    pub fn go_to(&mut self, time_s: f64) {
        let [first, last] = self.span_s();
        if time_s.is_finite() {
            self.time_s = time_s.clamp(first, last);
        }
    }

    /// Goes on by so many periods.
    pub fn step(&mut self, periods: i64) {
        let last = self.records.len().saturating_sub(1) as i64;
        let index = (self.index() as i64).saturating_add(periods).clamp(0, last);
        self.is_playing = false;
        if let Some(record) = self.records.get(index as usize) {
            self.time_s = record.time_s;
        }
    }

    /// Time goes on by `dt_s` of whoever looks.
    pub fn advance(&mut self, dt_s: f64) {
        if self.is_playing {
            self.go_to(self.time_s + dt_s * self.speed);
            self.is_playing = self.time_s < self.span_s()[1];
        }
    }

    /// The periods of the last `seconds` up to the one that is shown.
    pub fn past(&self, seconds: f64) -> &[Record] {
        let to = self.index() + 1;
        let from = self.records.partition_point(|r| r.time_s < self.time_s - seconds);
        self.records.get(from.min(to)..to).unwrap_or(&[])
    }

    /// Contact points of the last `seconds`, m.
    pub fn track(&self, seconds: f64) -> Vec<DVec3> {
        track(self.past(seconds))
    }
}

/// A track's places are this far apart, m,
const APART_M: f64 = 0.4e-3;
/// and no more than so many, the last ones.
const PLACES: usize = 500;

/// Contact points of some periods, m: as many as a track needs.
pub fn track(records: &[Record]) -> Vec<DVec3> {
    let touching = records.iter().filter(|r| r.element != Record::NONE);
    thinned(touching.map(|r| DVec3::from_array(r.contact_position_m)))
}

/// Of places in their order those that a track needs.
pub fn thinned(places: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::new();
    let mut last = None;
    for place in places.filter(|p| p.is_finite()) {
        if kept.last().is_none_or(|k| k.distance_squared(place) >= APART_M * APART_M) {
            kept.push(place);
        }
        last = Some(place);
    }
    // It ends where the contact point is.
    kept.extend(last.filter(|place| kept.last() != Some(place)));
    kept.drain(..kept.len().saturating_sub(PLACES));
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_has_its_ends_and_no_more_places_than_it_needs() {
        let line = |n: u32, step: f64| (0..n).map(move |i| DVec3::X * f64::from(i) * step);
        let kept = thinned(line(1000, 1e-5));
        assert!(kept.len() < 30 && kept[0] == DVec3::ZERO && kept[kept.len() - 1] == DVec3::X * 999.0 * 1e-5);
        assert_eq!(thinned(line(2000, 1e-3)).len(), PLACES);
        assert_eq!(thinned([DVec3::NAN].into_iter()), []);
    }
}
