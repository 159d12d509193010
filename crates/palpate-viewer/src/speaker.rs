//! A loudspeaker that plays a [`Voice`](crate::sound::Voice): with the feature `sound`, else one that says how to get it.

#[cfg(feature = "sound")]
use crate::sound::Voice;
use palpate::runtime::LiveSession;

/// How to hear something where there is no loudspeaker.
#[cfg(feature = "sound")]
const ELSE: &str = "plug one in, or hear a recording: `palpate view BODY --recording FILE --wav FILE`";

/// Plays, until it is dropped, how fast a session's force changes.
pub struct Speaker {
    #[cfg(feature = "sound")]
    _stream: cpal::Stream,
}

impl std::fmt::Debug for Speaker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Speaker")
    }
}

impl Speaker {
    /// On the system's own loudspeaker.
    ///
    /// # Errors
    /// There is none, or it takes no sound; built without the feature `sound`.
    #[cfg(not(feature = "sound"))]
    pub fn of(_session: &LiveSession) -> Result<Self, String> {
        Err("this palpate was built without a loudspeaker; build it with `--features sound`, or hear a recording: `palpate view \
             BODY --recording FILE --wav FILE`"
            .into())
    }

    /// On the system's own loudspeaker.
    ///
    /// # Errors
    /// There is none, or it takes no sound; built without the feature `sound`.
    #[cfg(feature = "sound")]
    pub fn of(session: &LiveSession) -> Result<Self, String> {
        use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};
        let device = cpal::default_host()
            .default_output_device()
            .ok_or_else(|| format!("there is no loudspeaker; {ELSE}"))?;
        let refused = |e: cpal::Error| format!("the loudspeaker takes no sound ({e}); {ELSE}");
        let config = device.default_output_config().map_err(refused)?;
        let voice = Voice::of(session, f64::from(config.sample_rate()));
        let play = match config.sample_format() {
            cpal::SampleFormat::F32 => play::<f32>,
            cpal::SampleFormat::I16 => play::<i16>,
            cpal::SampleFormat::I32 => play::<i32>,
            cpal::SampleFormat::U16 => play::<u16>,
            cpal::SampleFormat::U8 => play::<u8>,
            other => {
                return Err(format!(
                    "the loudspeaker wants samples of the kind {other}, which none is made for; {ELSE}"
                ));
            }
        };
        let stream = play(&device, config.into(), voice).map_err(refused)?;
        stream.play().map_err(refused)?;
        Ok(Speaker { _stream: stream })
    }
}

#[cfg(feature = "sound")]
fn play<T: cpal::SizedSample + cpal::FromSample<f32>>(
    device: &cpal::Device,
    config: cpal::StreamConfig,
    mut voice: Voice,
) -> Result<cpal::Stream, cpal::Error> {
    use cpal::traits::DeviceTrait;
    let channels = usize::from(config.channels).max(1);
    let fill = move |out: &mut [T], _: &cpal::OutputCallbackInfo| {
        for frame in out.chunks_mut(channels) {
            frame.fill(T::from_sample(voice.sample()));
        }
    };
    // A gap in the sound, or a loudspeaker that is gone, ends no session.
    device.build_output_stream(config, fill, |_| {}, None)
}
