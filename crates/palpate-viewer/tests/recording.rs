//! What is shown of a recording is what `palpate trace` gives of it, at every period.

mod common;

use palpate_viewer::gallery::Example;
use palpate_viewer::{Event, Viewer};

#[test]
fn every_state_shown_has_the_digits_of_the_trace() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = common::saved(Example::Pad, folder.path());
    let file = folder.path().join("a.rec");
    common::write_recording(&path, &file);
    let [periods, touching, slipping] = common::compare(&path, &file);
    assert!(periods == 3000 && touching > 1000 && slipping > 100, "{periods} {touching} {slipping}");
}

#[test]
fn a_recording_of_another_body_is_refused_and_a_cut_one_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = common::saved(Example::Pad, folder.path());
    let (_, other) = common::saved(Example::Ring, folder.path());
    let file = folder.path().join("a.rec");
    common::write_recording(&path, &file);
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
