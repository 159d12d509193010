//! The force's rate as sound.

use super::experiment::{Rate, Rollout};
use super::path::tip;
use super::pictures::frame;
use anyhow::Result;
use glam::DVec3;
use std::path::Path;

/// Samples a second of the WAV files.
pub const HZ: u32 = 44_100;
/// The loudest a file can be, N/s: no click of the experiment is louder, so that none is cut.
pub const FULL_SCALE: f64 = 1250.0;
/// The rate is the mean over this time, s: a jump becomes a pulse of this width, a crisp tick.
pub const WINDOW: f64 = 0.5e-3;

/// What one WAV file holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loudness {
    /// Largest rate, N/s.
    pub peak: f64,
    /// Samples that were cut to full scale.
    pub cut: usize,
}

/// Writes the rate of `rollout`, which must have kept its samples, as 16-bit mono.
///
/// The force has three components and the loudspeaker one: it plays the direction halfway between outward and
/// around, which changes of the normal force and of the frame both show in.
///
/// # Errors
/// No samples, or a file that can't be written.
pub fn save(path: &Path, rate: &Rate, rollout: &Rollout) -> Result<Loudness> {
    let heard: Vec<f64> = rollout
        .samples
        .iter()
        .enumerate()
        .map(|(i, o)| {
            let [out, around, _] = frame(tip(i as f64 / rate.hz));
            DVec3::from_array(o.force_n).dot(out + around) * std::f64::consts::FRAC_1_SQRT_2
        })
        .collect();
    anyhow::ensure!(!heard.is_empty(), "there is no sample to hear");
    let force = |t: f64| {
        let x = (t * rate.hz).clamp(0.0, (heard.len() - 1) as f64);
        let i = x as usize;
        let next = heard.get(i + 1).unwrap_or(&heard[i]);
        heard[i] + (next - heard[i]) * (x - i as f64)
    };
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: HZ,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    let mut wav = hound::WavWriter::create(path, spec)?;
    let mut loudness = Loudness { peak: 0.0, cut: 0 };
    for i in 0..(super::path::DURATION * f64::from(HZ)) as usize {
        let t = i as f64 / f64::from(HZ);
        let rate = (force(t + WINDOW / 2.0) - force(t - WINDOW / 2.0)) / WINDOW;
        loudness.peak = loudness.peak.max(rate.abs());
        loudness.cut += usize::from(rate.abs() > FULL_SCALE);
        wav.write_sample(((rate / FULL_SCALE).clamp(-1.0, 1.0) * f64::from(i16::MAX)).round() as i16)?;
    }
    wav.finalize()?;
    Ok(loudness)
}
