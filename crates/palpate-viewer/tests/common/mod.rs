//! What tests share: bodies, recordings.
#![allow(dead_code, reason = "each test takes what it needs")]

use palpate::body::SlipRule;
use palpate::engine::{Flags, Waypoint};
use palpate::runtime::trace::write_row;
use palpate::runtime::{BodyFile, Recording, Retrace};
use palpate::{Ablation, Body, Contact};
use palpate_viewer::gallery::Example;
use palpate_viewer::panels::numbers;
use palpate_viewer::work::Opened;
use palpate_viewer::{Event, Settings, Shown, Viewer};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// An example in a file, opened.
pub fn saved(example: Example, folder: &Path) -> (PathBuf, Opened) {
    let path = folder.join(format!("{}.body", example.name()));
    example.make().unwrap().save(&path).unwrap();
    let opened = Opened {
        body: Body::open(&path).unwrap().into(),
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
    viewer.show_body(Opened { body: body.into(), name: example.title().into(), file: BodyFile::default() });
    viewer.tick(0.0);
    viewer
}

/// A period as `palpate trace` gives it: its row to the printed digits, the panel's words of the same numbers, and the tank's level.
pub type Traced = (String, Vec<(&'static str, String)>);

/// What is shown, in the same form.
pub fn told(shown: &Shown) -> Traced {
    let output = palpate::Output {
        force_n: shown.force_n.to_array(),
        torque_nm: shown.torque_nm.to_array(),
        contact: shown.contact,
        flags: shown.flags,
        energy: shown.energy,
    };
    let mut row = Vec::new();
    write_row(&mut row, &Waypoint { time_s: shown.time_s, pose: shown.tool }, &output).unwrap();
    let tank = ("tank", format!("{:?}", shown.tank_j));
    (String::from_utf8(row).unwrap(), numbers::told(shown).into_iter().chain([tank]).collect())
}

/// What `palpate trace` gives of a recording, by the bits of the period's time.
pub fn trace(body: &Path, recording: &Path) -> BTreeMap<u64, Traced> {
    let recording = Recording::open(recording).unwrap();
    let header = recording.header().clone();
    assert_eq!(header.body.sha256, palpate::files::sha256(body).unwrap());
    let body = Body::open(body).unwrap();
    let rule = SlipRule::ALL.into_iter().find(|r| r.name() == header.slip).unwrap();
    let contact = Contact::with_slip(&body, rule, Ablation::None)
        .with_tank(header.tank)
        .with_partial_slip(header.partial_slip);
    let mut retrace = Retrace::new(&body, contact);
    let mut traced = BTreeMap::new();
    for record in recording {
        let (Some(output), Some(pose)) = (retrace.step(&record).unwrap(), record.tool()) else { continue };
        let shown = Shown::of_step(record.time_s, pose, &output, retrace.contact());
        traced.insert(record.time_s.to_bits(), told(&shown));
    }
    traced
}

/// Goes through a recording period by period, and finds in the window what `palpate trace` gives of each. Gives how many periods there
/// were, how many of them in contact, and how many slipping.
pub fn compare(body: &Path, recording: &Path) -> [usize; 3] {
    let traced = trace(body, recording);
    let mut viewer = Viewer::default();
    viewer.touches = false;
    viewer.update([Event::Open(body.to_path_buf())]);
    viewer.finish_work().unwrap();
    viewer.update([Event::Open(recording.to_path_buf())]);
    viewer.finish_work().unwrap();
    let (mut touching, mut slipping) = (0, 0);
    for (time, period) in &traced {
        viewer.update([Event::Scrub(f64::from_bits(*time))]);
        let shown = viewer.shown().unwrap();
        assert_eq!(&told(&shown), period);
        touching += usize::from(shown.contact.is_some());
        slipping += usize::from(shown.flags.has(Flags::SLIPPING));
    }
    [traced.len(), touching, slipping]
}

/// A recording without a clock, the same bits every time: a simulated hand presses and drags for three seconds.
pub fn write_recording(body: &Path, file: &Path) {
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
