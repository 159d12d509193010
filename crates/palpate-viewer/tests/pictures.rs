//! Pictures of every panel, colouring, overlay and dialogue, drawn without a display and compared with those in `snapshots`.
//!
//! `UPDATE_SNAPSHOTS=1 cargo test -p palpate-viewer --test pictures` draws them anew: look at each that changed. Without an adapter
//! to draw with the tests say so and compare nothing.

mod common;

use eframe::egui::vec2;
use egui_kittest::wgpu::WgpuTestRenderer;
use egui_kittest::{Harness, SnapshotOptions, SnapshotResults};
use palpate::engine::certify::Bounds;
use palpate_viewer::drop::MeshQuestion;
use palpate_viewer::gallery::{BALL_SPEC, Example};
use palpate_viewer::offscreen::render_state;
use palpate_viewer::palette::Theme;
use palpate_viewer::scene::{Marks, Section};
use palpate_viewer::still::{self, StateChoice};
use palpate_viewer::{Colouring, Event, Settings, StandardView, Viewer, ui};

/// Letters and edges may be drawn a shade differently by another adapter.
const SHADE: f32 = 1.6;
/// Pixels that may differ by more: one in a hundred.
const DIFFERENT: usize = 6000;

fn harness<'a>(viewer: Viewer) -> Option<Harness<'a, Viewer>> {
    let state = match render_state(4, true) {
        Ok(state) => state,
        Err(e) => {
            eprintln!("skipped: {e}");
            return None;
        }
    };
    let show = |ui: &mut eframe::egui::Ui, viewer: &mut Viewer| {
        viewer.tick(0.0);
        let events = ui::show(viewer, ui);
        viewer.update(events);
    };
    Some(
        Harness::builder()
            .with_size(vec2(1000.0, 640.0))
            .with_max_steps(8)
            .with_context_setup(ui::set_up)
            .renderer(WgpuTestRenderer::from_render_state(state))
            .build_ui_state(show, viewer),
    )
}

fn options() -> SnapshotOptions {
    SnapshotOptions::new().threshold(SHADE).max_failed_pixels(DIFFERENT)
}

fn picture(results: &mut SnapshotResults, name: &str, viewer: Viewer) {
    let Some(mut harness) = harness(viewer) else { return };
    harness.run_steps(3);
    results.add(harness.try_snapshot_options(name, &options()));
}

fn pressed(example: Example, settings: Settings, state: &str) -> Viewer {
    let mut viewer = common::showing(example, settings);
    let body = viewer.subject().unwrap().body.clone();
    let choice: StateChoice = state.parse().unwrap();
    viewer.show(still::state(&body, &choice, viewer.settings()).unwrap());
    viewer.tick(0.0);
    viewer
}

const DRAGGED: &str = "depth_mm=5 drag_mm=9";

#[test]
fn the_start_page() {
    let mut results = SnapshotResults::new();
    picture(&mut results, "start", Viewer::default());
    picture(
        &mut results,
        "start-dark",
        Viewer::with_settings(Settings { theme: Theme::Dark, ..Settings::default() }),
    );
}

#[test]
fn bodies_that_are_pressed() {
    let mut results = SnapshotResults::new();
    for example in [Example::Cylinder, Example::Lump, Example::Pad, Example::Ring] {
        let viewer = pressed(example, Settings::default(), DRAGGED);
        picture(&mut results, &format!("pressed-{}", example.name()), viewer);
    }
    let dark = Settings { theme: Theme::Dark, ..Settings::default() };
    picture(&mut results, "pressed-dark", pressed(Example::Pad, dark, DRAGGED));
    let section = Some(Section { axis: 1, share: 0.5, keeps_lower: false });
    let marks = Marks { edges: true, test_points: true, ..Marks::default() };
    let cut = Settings { section, marks, ..Settings::default() };
    picture(&mut results, "cut-and-edges", pressed(Example::Pad, cut, "depth_mm=6"));
    let mut top = pressed(Example::Ring, Settings::default(), DRAGGED);
    top.update([Event::Look(StandardView::Top)]);
    picture(&mut results, "from-above", top);
}

#[test]
fn colourings() {
    let mut results = SnapshotResults::new();
    for colouring in Colouring::ALL.into_iter().filter(|c| *c != Colouring::Certificate) {
        let settings = Settings { colouring, ..Settings::default() };
        let name = format!("colouring-{}", colouring.name());
        picture(&mut results, &name, pressed(Example::Lump, settings, "depth_mm=4"));
    }
    // Bounds that have no need of time: of the coarse cylinder, all there.
    let settings = Settings { colouring: Colouring::Certificate, ..Settings::default() };
    let mut viewer = common::showing(Example::Cylinder, settings);
    let all = viewer.subject().unwrap().body.elements().len();
    while viewer.subject().unwrap().certificate().map_or(0, |b: Vec<Bounds>| b.len()) < all {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    viewer.tick(0.0);
    picture(&mut results, "colouring-certificate", viewer);
}

#[test]
fn a_recording_with_its_bar_and_panels() {
    let mut results = SnapshotResults::new();
    let folder = tempfile::tempdir().unwrap();
    let (path, opened) = common::saved(Example::Pad, folder.path());
    // Against the clock no two recordings are alike: this one is made in steps, and written as a session writes.
    let file = folder.path().join("press.rec");
    common::write_recording(&path, &file);
    let mut viewer = Viewer::default();
    viewer.touches = false;
    viewer.show_body(opened);
    viewer.update([Event::Open(file)]);
    viewer.finish_work().unwrap();
    viewer.update([Event::Scrub(1.2)]);
    viewer.tick(0.0);
    picture(&mut results, "recording", viewer);
}

#[test]
fn what_lies_over_the_window() {
    let mut results = SnapshotResults::new();
    let mut help = common::showing(Example::Pad, Settings::default());
    help.update([Event::Help]);
    picture(&mut results, "help", help);

    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("organ.obj");
    std::fs::write(&mesh, "v 0 0 0\nv 40 0 0\nv 0 40 0\nv 0 0 40\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
        .unwrap();
    let mut question = Viewer::default();
    question.update([Event::Open(mesh.clone())]);
    picture(&mut results, "mesh-question", question);
    let mut answered = Viewer::default();
    answered.update([
        Event::Open(mesh.clone()),
        Event::Ask(MeshQuestion {
            unit: Some(palpate::body::import::LengthUnit::Millimetre),
            ..MeshQuestion::new(mesh)
        }),
    ]);
    picture(&mut results, "mesh-answered", answered);

    // Who opens a pipe waits until somebody writes into it: so the simulation is under way for as long as the picture wants.
    #[cfg(unix)]
    {
        let [spec, pipe] = ["organ.toml", "pipe.obj"].map(|name| folder.path().join(name));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let shape = "[body.shape]\nkind = \"sphere\"\nradius_mm = 15";
        assert!(BALL_SPEC.contains(shape));
        let piped = BALL_SPEC.replace(shape, "[body]\nmesh = \"pipe.obj\"\nunit = \"mm\"");
        std::fs::write(&spec, piped).unwrap();
        let mut simulating = common::showing(Example::Pad, Settings::default());
        simulating.update([Event::Open(spec), Event::Example(Example::Ring)]);
        assert_eq!(simulating.instead(), Some(&Event::Example(Example::Ring)));
        picture(&mut results, "instead", simulating);
    }

    let mut error = common::showing(Example::Pad, Settings::default());
    error.update([Event::Open("holiday.jpg".into())]);
    picture(&mut results, "error", error);
    let mut no_body = Viewer::default();
    let recording = folder.path().join("a.rec");
    let (path, _) = common::saved(Example::Pad, folder.path());
    common::write_recording(&path, &recording);
    no_body.update([Event::Open(recording)]);
    assert!(no_body.message().is_some());
    picture(&mut results, "error-on-the-start-page", no_body);
}

/// What ends a session that is watched is said, and what comes after it is led by the mouse.
#[test]
fn a_watched_session_begins_with_the_first_picture_and_says_why_it_ended() {
    use egui_kittest::kittest::Queryable as _;
    use palpate::runtime::{PreparedSession, RealTime, SessionConfig};
    let opened = palpate_viewer::work::Opened {
        body: Example::Pad.make().unwrap().into(),
        name: "pad".into(),
        file: Default::default(),
    };
    let real_time = RealTime { priority: None, core: None, lock_memory: false, spin_s: 0.0 };
    let mut config = SessionConfig { seconds: Some(0.05), real_time, ..SessionConfig::default() };
    config.patience.late_s = 10.0;
    let session = PreparedSession::new(opened.session_body(), config, None).unwrap();
    let mut viewer = Viewer::default();
    viewer.watch(opened, session);
    assert!(viewer.touch().is_none() && viewer.to_watch().is_some());
    viewer.tick(0.0);
    assert!(viewer.touch().is_some_and(|t| t.lead.is_none()) && viewer.to_watch().is_none());
    while !viewer.touch().unwrap().is_over() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let Some(mut harness) = harness(viewer) else { return };
    harness.run_steps(2);
    harness.get_by_label("It has ended: the time is over. The device is closed.");
    harness.get_by_label("Start again").click();
    harness.run_steps(2);
    assert!(harness.state().touch().is_some_and(|t| t.lead.is_some()));
    let outcome = harness.state_mut().end();
    assert_eq!(outcome.map(|o| o.report.end.to_string()).as_deref(), Some("the time is over"));
}

/// With a session the numbers change: its window is drawn, found not to be empty, and the stop is pressed by its label.
#[test]
fn a_session_is_stopped_by_its_button() {
    use egui_kittest::kittest::Queryable as _;
    let mut viewer = Viewer::default();
    let body = Example::Pad.make().unwrap();
    viewer.show_body(palpate_viewer::work::Opened {
        body: body.into(),
        name: "pad".into(),
        file: Default::default(),
    });
    let Some(mut harness) = harness(viewer) else { return };
    harness.run_steps(3);
    let image = harness.render().unwrap();
    let mut shades: Vec<[u8; 4]> = image.pixels().map(|p| p.0).collect();
    shades.sort_unstable();
    shades.dedup();
    assert!(shades.len() > 500, "{} shades", shades.len());
    harness.get_by_label("STOP   (space bar)").click();
    harness.run_steps(2);
    assert!(harness.state().touch().is_some_and(|t| t.is_stopped()));
    harness.get_by_label("Start again").click();
    harness.run_steps(2);
    assert!(harness.state().touch().is_some_and(|t| !t.is_stopped()));
}
