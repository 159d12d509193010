//! From a mesh to a body in the window: asked, simulated, cancelled, and gone on with from where it was.

use palpate::body::import::LengthUnit;
use palpate::body::shape::{Resolution, Shape};
use palpate_viewer::drop::MeshQuestion;
use palpate_viewer::gallery::Example;
use palpate_viewer::{Event, Viewer};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Places that are pressed.
const POINTS: u32 = 12;

/// A coarse ball as a mesh in millimetres.
fn mesh(folder: &Path) -> PathBuf {
    let resolution = Resolution { edge_length_mm: Some(14.0), ..Default::default() };
    let surface = Shape::Sphere { radius_mm: 20.0 }.surface(resolution).unwrap();
    let mut text = String::new();
    for p in surface.positions() {
        writeln!(text, "v {} {} {}", p.x * 1e3, p.y * 1e3, p.z * 1e3).unwrap();
    }
    for element in surface.elements() {
        let [a, b, c] = element.nodes.map(|n| n + 1);
        writeln!(text, "f {a} {b} {c}").unwrap();
    }
    let path = folder.join("organ.obj");
    std::fs::write(&path, text).unwrap();
    path
}

/// Drops the mesh, answers, and lets it be simulated.
fn drop_and_answer(viewer: &mut Viewer, mesh: &Path) {
    viewer.update([Event::Open(mesh.to_path_buf())]);
    assert_eq!(viewer.question().map(|q| q.unit), Some(None), "{:?}", viewer.message());
    let unit = Some(LengthUnit::Millimetre);
    let answer = MeshQuestion { unit, test_points: POINTS, ..MeshQuestion::new(mesh.to_path_buf()) };
    viewer.update([Event::Ask(answer), Event::Make]);
    assert!(viewer.work().is_some(), "{:?}", viewer.message());
}

/// A mesh in a folder of its own, whose simulation was cancelled when some of its points were done and others not; and how many are
/// kept. A machine may be so busy elsewhere that all are done before the cancel comes: then again.
fn cancelled(viewer: &mut Viewer, folder: &Path) -> (PathBuf, usize) {
    for attempt in 0..50 {
        let own = folder.join(attempt.to_string());
        std::fs::create_dir_all(&own).unwrap();
        let mesh = mesh(&own);
        drop_and_answer(viewer, &mesh);
        let deadline = Instant::now() + Duration::from_secs(300);
        while viewer.work().is_some() {
            assert!(Instant::now() < deadline, "{:?}", viewer.work());
            if viewer.work().is_some_and(|w| w.meter.read().0 > 0) {
                viewer.update([Event::Cancel]);
            }
            std::thread::sleep(Duration::from_millis(2));
            viewer.tick(0.0);
        }
        let Some(message) = viewer.message() else { continue };
        let told: Vec<&str> = message.text.split(' ').collect();
        assert_eq!(told[1..4].join(" "), format!("of {POINTS} test"), "{message:?}");
        assert!(message.text.contains("goes on from there") && viewer.is_unfinished(), "{message:?}");
        let kept = told[0].parse().unwrap();
        assert!((1..=POINTS as usize).contains(&kept), "{message:?}");
        return (mesh, kept);
    }
    panic!("no cancel came before the end");
}

/// Waits for the body, and finds that what was kept was not simulated again.
fn finish(viewer: &mut Viewer, mesh: &Path, kept: usize) {
    let meter = viewer.work().unwrap().meter.clone();
    viewer.finish_work().unwrap();
    let notes = meter.notes();
    let told = format!("{kept} of {POINTS} points are there already");
    assert!(notes.contains(&told), "{told}: {notes:?}");
    let subject = viewer.subject().unwrap();
    assert!(subject.name == "organ.body" && !subject.file.sha256.is_empty() && !viewer.is_unfinished());
    assert!(mesh.with_file_name("organ-palpate").join("organ.body").exists());
}

#[test]
fn a_mesh_is_simulated_cancelled_and_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = Viewer::default();
    viewer.touches = false;
    // By the button of the message,
    let (mesh, kept) = cancelled(&mut viewer, &folder.path().join("button"));
    viewer.update([Event::GoOn]);
    finish(&mut viewer, &mesh, kept);
    // or by the same mesh once more, with the same answers;
    let (mesh, kept) = cancelled(&mut viewer, &folder.path().join("dropped"));
    viewer.update([Event::Dismiss]);
    drop_and_answer(&mut viewer, &mesh);
    finish(&mut viewer, &mesh, kept);
    // whose body is there by now.
    drop_and_answer(&mut viewer, &mesh);
    viewer.finish_work().unwrap();
    assert_eq!(viewer.subject().map(|s| s.name.as_str()), Some("organ.body"));
}

/// A file that is dropped meanwhile ends no simulation unasked.
#[test]
fn a_simulation_is_not_left_off_without_asking() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("pad.body");
    Example::Pad.make().unwrap().save(&other).unwrap();
    let mut viewer = Viewer::default();
    viewer.touches = false;
    drop_and_answer(&mut viewer, &mesh(folder.path()));
    for asked in [Event::Open(other.clone()), Event::Example(Example::Ring)] {
        viewer.update([asked.clone()]);
        assert_eq!(viewer.instead(), Some(&asked));
        assert!(viewer.work().is_some_and(|w| w.title.contains("organ.toml") && !w.is_cancelled()));
        viewer.update([Event::Dismiss]);
        assert!(viewer.instead().is_none() && viewer.work().is_some());
    }
    viewer.update([Event::Open(other), Event::Instead]);
    viewer.finish_work().unwrap();
    assert_eq!(viewer.subject().map(|s| s.name.as_str()), Some("pad.body"));
    assert!(viewer.instead().is_none());
}
