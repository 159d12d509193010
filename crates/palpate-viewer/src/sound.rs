//! What touch sounds like: how fast the force changes. A force that jumps is a click; a smooth one is not heard.
//!
//! ```text
//! recording thread ── (time, force), a ring ──→ Voice, in the loudspeaker's callback ──→ samples
//! a recording's periods ───────────────────────→ the same, into a WAV file
//! ```
//!
//! A sample is the length of the change of the force from one period to the next, over the period, N/s: changes in every direction
//! count alike, as the hand feels them. What is lower than a loudspeaker can play is filtered out.

use glam::DVec3;
use palpate::runtime::{LiveSession, Record};
use rtrb::{Consumer, RingBuffer};
use std::path::Path;

/// The loudest, N/s: as in the sounds of `palpate demo`, of whose clicks none is louder.
pub const FULL_SCALE_N_PER_S: f64 = 1250.0;
/// Below this nothing is played, Hz.
const LOWEST_HZ: f64 = 20.0;
/// Between periods that are farther apart than this nothing is heard, s: a pause, not a jump.
const GAP_S: f64 = 0.05;
/// Periods that wait before the sound begins: they come in bunches.
const AHEAD: usize = 20;
/// If so many wait, the sound has fallen behind, and leaves some out.
const BEHIND: usize = 120;
/// Periods that the ring holds.
const RING: usize = 2000;
/// Samples a second of a WAV file.
pub const WAV_HZ: u32 = 44_100;

/// The force of a period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heard {
    /// The loop's time, s.
    pub time_s: f64,
    /// The engine's force on the tool, N.
    pub force_n: DVec3,
}

impl Heard {
    /// Of a record.
    pub fn of(record: &Record) -> Self {
        Heard { time_s: record.time_s, force_n: DVec3::from_array(record.force_n) }
    }

    fn is_finite(&self) -> bool {
        self.time_s.is_finite() && self.force_n.is_finite()
    }
}

/// From periods to samples.
#[derive(Debug, Clone)]
struct Rate {
    sample_s: f64,
    /// The loop's time that was played last, s.
    played_s: f64,
    /// The two periods between which it is.
    between: Option<[Heard; 2]>,
    filter: HighPass,
}

impl Rate {
    fn new(hz: f64) -> Self {
        Rate { sample_s: 1.0 / hz, played_s: 0.0, between: None, filter: HighPass::new(hz) }
    }

    /// The next sample, from −1 to 1; `None` where `next` has no period that reaches so far.
    fn sample(&mut self, mut next: impl FnMut() -> Option<Heard>) -> Option<f64> {
        let mut to_s = self.played_s + self.sample_s;
        while self.between.is_none_or(|[_, after]| after.time_s < to_s) {
            let heard = next()?;
            if !heard.is_finite() {
                continue;
            }
            match self.between {
                Some([_, after]) if (0.0..=GAP_S).contains(&(heard.time_s - after.time_s)) => {
                    self.between = Some([after, heard]);
                }
                // It begins, or begins anew after a gap: with nothing before there is no jump.
                _ => (self.between, to_s) = (Some([heard; 2]), heard.time_s),
            }
        }
        self.played_s = to_s;
        let [before, after] = self.between?;
        let dt = after.time_s - before.time_s;
        let rate = if dt > 0.0 { after.force_n.distance(before.force_n) / dt } else { 0.0 };
        Some(self.filter.pass(rate / FULL_SCALE_N_PER_S).clamp(-1.0, 1.0))
    }
}

/// Of first order.
#[derive(Debug, Clone)]
struct HighPass {
    keeps: f64,
    before: f64,
    out: f64,
}

impl HighPass {
    fn new(hz: f64) -> Self {
        HighPass { keeps: 1.0 / (1.0 + std::f64::consts::TAU * LOWEST_HZ / hz), before: 0.0, out: 0.0 }
    }

    fn pass(&mut self, x: f64) -> f64 {
        self.out = self.keeps * (self.out + x - self.before);
        self.before = x;
        self.out
    }
}

/// What a loudspeaker plays of a running session.
#[derive(Debug)]
pub struct Voice {
    rate: Rate,
    periods: Consumer<Heard>,
    /// Whether it waits until enough periods are there.
    waits: bool,
}

impl Voice {
    /// Of a session from now on, at so many samples a second.
    pub fn of(session: &LiveSession, hz: f64) -> Self {
        let (mut producer, periods) = RingBuffer::new(RING);
        // Where the ring is full nobody plays it.
        session.listen(Some(Box::new(move |record| {
            let _ = producer.push(Heard::of(record));
        })));
        Voice::new(periods, hz)
    }

    fn new(periods: Consumer<Heard>, hz: f64) -> Self {
        Voice { rate: Rate::new(hz), periods, waits: true }
    }

    /// The next sample, from −1 to 1. Where periods are missing it is silent, and waits for some.
    ///
    /// # Real-time
    /// Bounded; never allocates, locks or waits.
    pub fn sample(&mut self) -> f32 {
        let waiting = self.periods.slots();
        if waiting > BEHIND {
            // What is left out begins anew, without a click.
            for _ in AHEAD..waiting {
                let _ = self.periods.pop();
            }
            self.rate.between = None;
        }
        self.waits &= waiting < AHEAD;
        if self.waits {
            return 0.0;
        }
        let periods = &mut self.periods;
        let sample = self.rate.sample(|| periods.pop().ok());
        self.waits = sample.is_none();
        sample.unwrap_or(0.0) as f32
    }
}

/// What a WAV file holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loudness {
    /// How long it is, s.
    pub seconds: f64,
    /// The largest rate of the force, N/s.
    pub peak_n_per_s: f64,
}

/// Longer than anybody listens, s: a file of an hour and a half.
const SECONDS_MAX: f64 = 5400.0;

/// Writes what some periods sound like as a WAV file: 16 bits, one channel.
///
/// # Errors
/// There is nothing to hear, or too much; the file can't be written.
pub fn save(path: &Path, records: &[Record]) -> Result<Loudness, String> {
    let span_s = match records {
        [first, .., last] => last.time_s - first.time_s,
        _ => 0.0,
    };
    let name = path.display();
    if span_s <= 0.0 {
        return Err(format!(
            "{name}: there is no sound of a recording of less than two periods; give a longer one"
        ));
    }
    if span_s > SECONDS_MAX {
        return Err(format!("{name}: {span_s:.0} s of sound; give a recording of at most {SECONDS_MAX} s"));
    }
    let mut rate = Rate::new(f64::from(WAV_HZ));
    let mut periods = records.iter().map(Heard::of);
    let samples: Vec<i16> = std::iter::from_fn(|| rate.sample(|| periods.next()))
        .map(|x| (x * f64::from(i16::MAX)).round() as i16)
        .collect();
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: WAV_HZ,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut write = || -> Result<(), hound::Error> {
        let mut wav = hound::WavWriter::new(&mut bytes, spec)?;
        samples.iter().try_for_each(|s| wav.write_sample(*s))?;
        wav.finalize()
    };
    write().map_err(|e| format!("{name}: {e}"))?;
    palpate::files::replace(path, |out| Ok(out.write_all(bytes.get_ref())?))
        .map_err(|e| palpate::files::message(&e))?;
    let steps = records.windows(2).map(|w| [Heard::of(&w[0]), Heard::of(&w[1])]);
    let rates = steps.filter(|[a, b]| (1e-9..=GAP_S).contains(&(b.time_s - a.time_s)));
    let peak = rates.map(|[a, b]| a.force_n.distance(b.force_n) / (b.time_s - a.time_s)).fold(0.0, f64::max);
    Ok(Loudness { seconds: samples.len() as f64 / f64::from(WAV_HZ), peak_n_per_s: peak })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Periods of 1 ms: a force that grows smoothly, and from the middle on is another.
    fn periods(jump_n: f64) -> Vec<Heard> {
        let force = |k: u32| {
            let jumped = if k >= 500 { jump_n } else { 0.0 };
            DVec3::new(0.0, jumped, 1.0 + 1e-3 * f64::from(k))
        };
        (0..1000).map(|k| Heard { time_s: 5.0 + f64::from(k) * 1e-3, force_n: force(k) }).collect()
    }

    fn played(periods: &[Heard], hz: f64) -> Vec<f64> {
        let mut rate = Rate::new(hz);
        let mut left = periods.iter().copied();
        std::iter::from_fn(|| rate.sample(|| left.next())).collect()
    }

    #[test]
    fn a_jump_is_a_click_and_a_smooth_force_is_not_heard() {
        for hz in [44_100.0, 48_000.0, 8_000.0] {
            let smooth = played(&periods(0.0), hz);
            assert!((smooth.len() as f64 / hz - 0.999).abs() < 2e-3, "{}", smooth.len());
            // 1 N/s: a thousandth of the loudest, and filtered out.
            assert!(smooth.iter().all(|x| x.abs() < 1e-3));
            let click = played(&periods(0.5), hz);
            let loud: Vec<usize> = (0..click.len()).filter(|&i| click[i] > 0.3).collect();
            // 0.5 N in a millisecond, at 0.499 s after the beginning.
            let (first, last) = (loud[0] as f64 / hz, loud[loud.len() - 1] as f64 / hz);
            assert!((first - 0.499).abs() < 1e-3 && last - first < 1.1e-3, "{first} {last}");
            assert!((click[loud[0]] - 500.0 / FULL_SCALE_N_PER_S).abs() < 0.02);
        }
        // More than the loudest is the loudest.
        assert_eq!(played(&periods(50.0), 44_100.0).iter().copied().fold(0.0, f64::max), 1.0);
    }

    #[test]
    fn gaps_and_what_is_no_number_are_no_clicks() {
        let mut broken = periods(0.0);
        broken[300].force_n = DVec3::NAN;
        broken[400].time_s = f64::NAN;
        broken.iter_mut().skip(600).for_each(|h| (h.time_s, h.force_n) = (h.time_s + 2.0, h.force_n * 7.0));
        broken.iter_mut().skip(800).for_each(|h| (h.time_s, h.force_n) = (h.time_s - 9.0, h.force_n * 7.0));
        let heard = played(&broken, 44_100.0);
        assert!(heard.len() > 30_000 && heard.iter().all(|x| x.abs() < 0.1), "{}", heard.len());
    }

    /// The callback's side of the ring: silent until some periods wait, then all of them in time; silent again, without a
    /// repetition, when they stop; and not ever farther behind.
    #[test]
    fn a_voice_waits_plays_and_catches_up() {
        let (mut producer, consumer) = RingBuffer::new(RING);
        let mut voice = Voice::new(consumer, 10_000.0);
        let all = periods(0.5);
        let (mut left, mut out) = (all.iter(), Vec::new());
        // Bunches of five every 5 ms, as the recording thread gives them.
        while left.len() > 0 {
            left.by_ref().take(5).for_each(|h| producer.push(*h).unwrap());
            out.extend((0..50).map(|_| voice.sample()));
        }
        let clicks: Vec<usize> = (0..out.len()).filter(|&i| out[i] > 0.3).collect();
        // 499 ms, and the 15 to 20 ms for which it waited: ten samples in one click.
        assert!((5140..5200).contains(&clicks[0]) && clicks.len() <= 11, "{clicks:?}");
        out.clear();
        out.extend((0..1000).map(|_| voice.sample()));
        assert_eq!(out[500..], [0.0; 500]);
        // A callback that was away for a second does not stay a second behind.
        let later = |k: usize| Heard { time_s: 9.0 + 1e-3 * k as f64, force_n: DVec3::Z };
        (0..1000).for_each(|k| producer.push(later(k)).unwrap());
        voice.sample();
        assert!(voice.periods.slots() <= AHEAD);
    }

    #[test]
    fn a_recording_becomes_a_wav_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.wav");
        let record = |h: &Heard| Record {
            time_s: h.time_s,
            force_n: h.force_n.to_array(),
            ..bytemuck::Zeroable::zeroed()
        };
        let records: Vec<Record> = periods(0.5).iter().map(record).collect();
        let loudness = save(&file, &records).unwrap();
        assert!((loudness.peak_n_per_s - 500.0).abs() < 2.0 && (loudness.seconds - 0.999).abs() < 2e-3);
        let mut wav = hound::WavReader::open(&file).unwrap();
        assert_eq!((wav.spec().sample_rate, wav.spec().channels), (WAV_HZ, 1));
        let loudest = wav.samples::<i16>().map(|s| s.unwrap()).max().unwrap();
        assert!((f64::from(loudest) / 32767.0 - 0.4).abs() < 0.02, "{loudest}");
        assert!(save(&file, &records[..1]).unwrap_err().contains("longer"));
        let mut long = records[..2].to_vec();
        long[1].time_s = 1e300;
        assert!(save(&file, &long).unwrap_err().contains("at most"));
    }
}
