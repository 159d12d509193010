//! What is shown of a recording is what `palpate trace` gives of it, at every period.

mod common;

use palpate::Contact;
use palpate::engine::Waypoint;
use palpate::runtime::trace::write_row;
use palpate::runtime::{Recording, Retrace};
use palpate_viewer::gallery::Example;
use palpate_viewer::panels::numbers::told;
use palpate_viewer::{Event, Shown, Viewer};

/// The columns of a row as `trace` writes it.
fn row(waypoint: &Waypoint, output: &palpate::Output) -> Vec<String> {
    let mut bytes = Vec::new();
    write_row(&mut bytes, waypoint, output).unwrap();
    String::from_utf8(bytes).unwrap().trim().split(',').map(String::from).collect()
}

#[test]
fn every_state_shown_has_the_digits_of_the_trace() {
    let folder = tempfile::tempdir().unwrap();
    let (path, opened) = common::saved(Example::Pad, folder.path());
    let file = folder.path().join("a.rec");
    common::record(&path, &file);

    let mut viewer = Viewer::default();
    viewer.touches = false;
    viewer.show_body(opened);
    viewer.update([Event::Open(file.clone())]);
    viewer.finish_work().unwrap();
    let body = viewer.subject().unwrap().body.clone();

    let mut retrace = Retrace::new(&*body, Contact::with_slip(&body, body.slip(), palpate::Ablation::None));
    let (mut touching, mut slipping, mut periods) = (0, 0, 0);
    for record in Recording::open(&file).unwrap() {
        let output = retrace.step(&record).unwrap();
        let (Some(output), Some(pose)) = (output, record.tool()) else { continue };
        viewer.update([Event::Scrub(record.time_s)]);
        viewer.tick(0.0);
        let shown = viewer.shown().unwrap();
        let waypoint = Waypoint { time_s: record.time_s, pose };
        // As numbers, to the last digit …
        let again = palpate::Output {
            force_n: shown.force_n.to_array(),
            torque_nm: shown.torque_nm.to_array(),
            contact: shown.contact,
            flags: shown.flags,
            energy: shown.energy,
        };
        let shown_pose = Waypoint { time_s: shown.time_s, pose: shown.tool };
        assert_eq!(row(&shown_pose, &again), row(&waypoint, &output), "period {}", record.number);
        // … and in the words of the panel.
        let traced = Shown::of_step(record.time_s, pose, &output, 1.0);
        assert_eq!(told(&shown), told(&traced));
        periods += 1;
        touching += u32::from(shown.contact.is_some());
        slipping += u32::from(shown.flags.has(palpate::engine::Flags::SLIPPING));
    }
    assert!(periods > 300 && touching > 100 && slipping > 10, "{periods} {touching} {slipping}");
}

#[test]
fn a_recording_of_another_body_is_refused_and_a_cut_one_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = common::saved(Example::Pad, folder.path());
    let (_, other) = common::saved(Example::Ring, folder.path());
    let file = folder.path().join("a.rec");
    common::record(&path, &file);
    let mut viewer = Viewer::default();
    viewer.touches = false;
    viewer.show_body(other);
    viewer.update([Event::Open(file.clone())]);
    let error = viewer.finish_work().unwrap_err();
    assert!(error.contains("pad.body") && error.contains("open that one first"), "{error}");

    viewer.update([Event::Open(path)]);
    viewer.finish_work().unwrap();
    let whole = std::fs::read(&file).unwrap();
    let cut = folder.path().join("cut.rec");
    std::fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    viewer.update([Event::Open(cut)]);
    viewer.finish_work().unwrap();
    assert!(viewer.playback().unwrap().ending.contains("cut off"));
    std::fs::write(folder.path().join("none.rec"), &whole[..60]).unwrap();
    viewer.update([Event::Open(folder.path().join("none.rec"))]);
    assert!(viewer.finish_work().is_err());
    // The one before stays.
    assert!(viewer.playback().is_some());
}
