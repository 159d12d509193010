//! From a mesh to a body in the window: asked, simulated, cancelled, and gone on with from where it was.

use palpate::body::import::LengthUnit;
use palpate::body::shape::{Resolution, Shape};
use palpate_viewer::drop::MeshQuestion;
use palpate_viewer::gallery::Example;
use palpate_viewer::{Event, Viewer};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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
    let answer = MeshQuestion { unit, test_points: 5, ..MeshQuestion::new(mesh.to_path_buf()) };
    viewer.update([Event::Ask(answer), Event::Make]);
    assert!(viewer.work().is_some(), "{:?}", viewer.message());
}

/// Lets time go on until something holds.
fn until(viewer: &mut Viewer, what: &str, holds: impl Fn(&Viewer) -> bool) {
    let deadline = Instant::now() + Duration::from_secs(300);
    while !holds(viewer) {
        assert!(Instant::now() < deadline, "{what}: {:?} {:?}", viewer.work(), viewer.message());
        std::thread::sleep(Duration::from_millis(5));
        viewer.tick(0.0);
    }
}

/// What is cancelled says how many test points are kept.
fn cancel(viewer: &mut Viewer) -> usize {
    viewer.update([Event::Cancel]);
    until(viewer, "cancelled", |v| v.work().is_none());
    let text = viewer.message().unwrap().text.clone();
    let told: Vec<&str> = text.split(' ').collect();
    assert_eq!(told[1..6], ["of", "5", "test", "points", "are"], "{text}");
    assert!(text.contains("goes on from there") && viewer.is_unfinished(), "{text}");
    told[0].parse().unwrap()
}

fn done(viewer: &Viewer) -> usize {
    viewer.work().map_or(0, |w| w.meter.read().0)
}

#[test]
fn a_mesh_is_simulated_cancelled_and_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = mesh(folder.path());
    let mut viewer = Viewer::default();
    viewer.touches = false;

    drop_and_answer(&mut viewer, &mesh);
    until(&mut viewer, "a point", |v| done(v) >= 1);
    let kept = cancel(&mut viewer);
    assert!((1..5).contains(&kept), "{kept}");

    // The same mesh dropped again, with the same answers: what was finished is there before anything is simulated.
    viewer.update([Event::Dismiss]);
    drop_and_answer(&mut viewer, &mesh);
    until(&mut viewer, "the points that are there", |v| v.work().is_none_or(|w| w.meter.read().1 == 5));
    assert!(done(&viewer) >= kept, "{:?}", viewer.work());
    let notes = viewer.work().unwrap().meter.notes();
    assert!(notes.iter().any(|n| n.contains(&format!("{kept} of 5 points are there already"))), "{notes:?}");
    let kept_again = cancel(&mut viewer);
    assert!(kept_again >= kept && kept_again < 5, "{kept} {kept_again}");

    // The button of the message.
    viewer.update([Event::GoOn]);
    viewer.finish_work().unwrap();
    let subject = viewer.subject().unwrap();
    assert_eq!((subject.name.as_str(), subject.body.test_point_nodes().len()), ("organ.body", 5));
    assert!(!viewer.is_unfinished() && !subject.file.sha256.is_empty());
    assert!(folder.path().join("organ-palpate").join("organ.body").exists());

    // Made already: dropped once more there is nothing left to simulate.
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
