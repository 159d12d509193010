//! What tests share: bodies, recordings.
#![allow(dead_code, reason = "each test takes what it needs")]

use palpate::Body;
use palpate::runtime::{BodyFile, LiveSession, SessionBody, SessionConfig};
use palpate_viewer::gallery::Example;
use palpate_viewer::work::Opened;
use palpate_viewer::{Settings, Viewer};
use std::path::{Path, PathBuf};

/// An example in a file, opened.
pub fn saved(example: Example, folder: &Path) -> (PathBuf, Opened) {
    let path = folder.join(format!("{}.body", example.name()));
    example.make().unwrap().save(&path).unwrap();
    let opened = Opened {
        body: Body::open(&path).unwrap(),
        name: format!("{}.body", example.name()),
        file: BodyFile {
            name: format!("{}.body", example.name()),
            sha256: palpate::files::sha256(&path).unwrap(),
        },
    };
    (path, opened)
}

/// A viewer that shows an example, without a session.
pub fn showing(example: Example, settings: Settings) -> Viewer {
    let mut viewer = Viewer::with_settings(settings);
    viewer.touches = false;
    let body = example.make().unwrap();
    viewer.show_body(Opened { body, name: example.title().into(), file: BodyFile::default() });
    viewer.tick(0.0);
    viewer
}

/// Half a second and a bit of a hand that presses and drags, recorded against the clock.
pub fn record(body: &Path, file: &Path) {
    let config = SessionConfig {
        device: "simulated:omega".parse().unwrap(),
        motion: "drag".into(),
        seconds: Some(1.4),
        record: Some(file.to_path_buf()),
        safety: palpate::runtime::Safety { silence_s: Some(0.5), soft_start_s: 0.05, ..Default::default() },
        patience: palpate::runtime::Patience { late_s: 10.0, finder_s: 30.0, ..Default::default() },
        real_time: palpate::runtime::RealTime { priority: None, core: None, lock_memory: false, spin_s: 0.0 },
        ..SessionConfig::default()
    };
    let body = SessionBody::open(body, None, None, true).unwrap();
    let outcome = LiveSession::start(body, config).unwrap().join();
    assert_eq!(outcome.finished.trouble, None);
}

/// A recording without a clock, the same bits every time: a simulated hand presses and drags for three seconds.
pub fn write_recording(body: &Path, file: &Path) {
    use palpate::Contact;
    use palpate::device::{Device, presets};
    use palpate::runtime::motion::MotionScript;
    use palpate::runtime::{HapticLoop, Header, HeldDevice, Record, RecordingFile, Safety};

    let sha256 = palpate::files::sha256(body).unwrap();
    let body = Body::open(body).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let motion = MotionScript::find("drag", &body).unwrap();
    let held = HeldDevice::new(&body, presets::device("omega").unwrap(), hand, &motion).unwrap();
    let mut device = held.device;
    let safety = Safety { soft_start_s: 0.1, ..Safety::default() };
    let stages = safety.stages(device.capabilities(), 1000.0).unwrap();
    let mut haptics = HapticLoop::new(Contact::new(&body), held.map, stages);
    let header = Header {
        program: "palpate".into(),
        rate_hz: 1000.0,
        body: BodyFile { name: "pad.body".into(), sha256 },
        slip: body.slip().name().into(),
        tank: body.has_tank(),
        ablation: "none".into(),
        device: "omega".into(),
        ..Header::default()
    };
    let mut recording = RecordingFile::create(file, true, &header).unwrap();
    device.open().unwrap();
    let periods = 3000u64;
    for number in 0..periods {
        let period = haptics.period(&body, &mut device, number as f64 * 1e-3);
        let record =
            Record { step_ns: 700 + (number % 7) as u32 * 150, ..Record::new(number, &haptics, &period) };
        recording.write(&record).unwrap();
    }
    device.close();
    recording.end("the motion was over", periods, 0).unwrap();
}
