//! The mouse as a tool: press, drag, slip, release, stop; without a window.

mod common;

use glam::{DVec2, DVec3};
use palpate::runtime::BodyFile;
use palpate_viewer::gallery::Example;
use palpate_viewer::work::Opened;
use palpate_viewer::{Event, Settings, Shown, StandardView, Viewer};
use std::time::{Duration, Instant};

/// Lets a viewer run against the clock until something holds of what is shown.
fn until(viewer: &mut Viewer, began: Instant, what: &str, holds: impl Fn(&Shown) -> bool) -> Shown {
    watch(viewer, began, what, &mut Vec::new(), holds)
}

/// The same, and keeps what was shown meanwhile.
fn watch(
    viewer: &mut Viewer,
    began: Instant,
    what: &str,
    seen: &mut Vec<Shown>,
    holds: impl Fn(&Shown) -> bool,
) -> Shown {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        viewer.tick(began.elapsed().as_secs_f64());
        seen.extend(viewer.shown());
        if let Some(shown) = viewer.shown().filter(&holds) {
            return shown;
        }
        assert!(Instant::now() < deadline, "{what}: {:?} {:?}", viewer.shown(), viewer.message());
        std::thread::sleep(Duration::from_millis(4));
    }
}

fn touching(example: Example) -> Viewer {
    let mut viewer = Viewer::default();
    viewer.show_body(Opened {
        body: example.make().unwrap().into(),
        name: "pad".into(),
        file: BodyFile::default(),
    });
    assert!(viewer.message().is_none(), "{:?}", viewer.message());
    viewer.update([Event::Look(StandardView::Top), Event::Resize(1.0)]);
    viewer
}

/// And whatever was shown meanwhile has the digits of `palpate trace`, as has every period of the recording.
#[test]
fn a_press_a_drag_and_a_release() {
    let folder = tempfile::tempdir().unwrap();
    let (path, opened) = common::saved(Example::Pad, folder.path());
    let recording = folder.path().join("mouse.rec");
    let began = Instant::now();
    let mut viewer = Viewer::default();
    viewer.record = Some(recording.clone());
    viewer.show_body(opened);
    assert!(viewer.message().is_none(), "{:?}", viewer.message());
    viewer.update([Event::Look(StandardView::Top), Event::Resize(1.0), Event::Point(Some(DVec2::ZERO))]);
    let mut seen = Vec::new();
    let shown = &mut seen;
    watch(&mut viewer, began, "hovers", shown, |s| s.contact.is_none() && s.tool_m().z > 0.02);

    viewer.update([Event::Press(true)]);
    let pressed = watch(&mut viewer, began, "presses", shown, |s| {
        s.contact.is_some_and(|c| c.delta_z_m > 2e-3)
            && s.force_n.z > 0.2
            && s.command_n.is_some_and(|f| f.z > 0.15)
    });
    // The tool lags behind the hand's target by the force over the hand's stiffness.
    let touch = viewer.touch().unwrap();
    let target = DVec3::from_array(touch.lead.as_ref().unwrap().position_m());
    assert!(pressed.tool_m().z > target.z, "{pressed:?} {target}");

    for k in 1..=40 {
        viewer.update([Event::Point(Some(DVec2::X * 0.012 * f64::from(k)))]);
        viewer.tick(began.elapsed().as_secs_f64());
        std::thread::sleep(Duration::from_millis(12));
    }
    let dragged = watch(&mut viewer, began, "drags", shown, |s| {
        s.energy.dissipated_j > 0.0 && s.contact.is_some_and(|c| c.position_m[0] > 5e-3)
    });
    assert!(dragged.force_n.x < 0.0, "{dragged:?}");
    let deadline = Instant::now() + Duration::from_secs(60);
    while viewer.track().len() <= 3 {
        assert!(Instant::now() < deadline, "{:?}", viewer.track());
        viewer.tick(began.elapsed().as_secs_f64());
        std::thread::sleep(Duration::from_millis(4));
    }

    viewer.update([Event::Press(false)]);
    watch(&mut viewer, began, "leaves", shown, |s| s.contact.is_none() && s.force_n == DVec3::ZERO);
    viewer.update([Event::Gallery]);

    let traced = common::trace(&path, &recording);
    let mut told = 0;
    for shown in &seen {
        // The engine is not asked before the first patch has come.
        let Some(period) = traced.get(&shown.time_s.to_bits()) else { continue };
        assert_eq!(&common::told(shown), period);
        told += usize::from(shown.contact.is_some());
    }
    let [periods, touching, slipping] = common::compare(&path, &recording);
    assert!(
        told > 0 && periods > touching && touching > slipping && slipping > 0,
        "{told} {periods} {touching} {slipping}"
    );
}

#[test]
fn a_stop_takes_the_force_off_and_a_start_begins_anew() {
    let began = Instant::now();
    let mut viewer = touching(Example::Pad);
    viewer.update([Event::Point(Some(DVec2::ZERO)), Event::Press(true)]);
    until(&mut viewer, began, "presses", |s| s.command_n.is_some_and(|f| f.length() > 0.1));
    viewer.update([Event::Stop]);
    let is_stopped = |s: &Shown| s.stages.has(palpate::runtime::StageFlags::STOPPED);
    let stopped = until(&mut viewer, began, "stops", is_stopped);
    assert_eq!(stopped.command_n, Some(DVec3::ZERO), "{stopped:?}");
    let deadline = Instant::now() + Duration::from_secs(60);
    while !viewer.touch().unwrap().is_over() {
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(5));
    }
    // Pointing and pressing wake nothing.
    viewer.update([Event::Press(true), Event::Point(Some(DVec2::splat(0.1))), Event::Undo]);
    assert!(viewer.touch().unwrap().is_over());
    viewer.update([Event::Start, Event::Press(true)]);
    until(&mut viewer, began, "again", |s| s.command_n.is_some_and(|f| f.length() > 0.1));
}

/// Friction and slip rule go over while it runs; an interpolation taken away begins another session, at the same place.
#[test]
fn switches_reach_the_session() {
    let began = Instant::now();
    let mut viewer = touching(Example::Ring);
    viewer.update([Event::Point(Some(DVec2::new(0.55, 0.0))), Event::Press(true)]);
    until(&mut viewer, began, "presses", |s| s.contact.is_some());
    let settings = *viewer.settings();
    viewer.update([Event::Change(Settings { friction_scale: 2.0, ..settings })]);
    until(&mut viewer, began, "friction", |s| s.friction_scale == 2.0);
    let settings = *viewer.settings();
    viewer.update([Event::Change(Settings { coordinates: false, ..settings })]);
    assert!(viewer.touch().unwrap().lead.is_some());
    let anew = until(&mut viewer, began, "another session", |s| s.contact.is_some());
    assert_eq!(anew.friction_scale, 2.0);
    viewer.update([Event::Undo]);
    assert!(viewer.settings().coordinates);
    until(&mut viewer, began, "back", |s| s.contact.is_some());
    viewer.update([Event::Pause]);
    until(&mut viewer, began, "pauses", |s| s.command_n == Some(DVec3::ZERO));
    viewer.update([Event::Pause]);
    until(&mut viewer, began, "goes on", |s| s.command_n.is_some_and(|f| f.length() > 0.02));
}

/// With a loudspeaker it plays; without one, or in a build without sound, one message says what to do. The session goes on in any
/// case.
#[test]
fn sound_is_heard_or_it_is_said_why_not() {
    let began = Instant::now();
    let mut viewer = touching(Example::Pad);
    let settings = *viewer.settings();
    viewer.update([Event::Change(Settings { sound: true, ..settings })]);
    match viewer.message() {
        None => assert!(viewer.settings().sound),
        Some(message) => {
            assert!(message.text.contains("--wav FILE") && !viewer.settings().sound, "{message:?}");
            println!("{}", message.text);
        }
    }
    viewer.update([Event::Point(Some(DVec2::ZERO)), Event::Press(true)]);
    until(&mut viewer, began, "presses", |s| s.command_n.is_some_and(|f| f.length() > 0.1));
    viewer.update([Event::Change(Settings { sound: false, ..*viewer.settings() })]);
    until(&mut viewer, began, "still presses", |s| s.contact.is_some_and(|c| c.delta_z_m > 2e-3));
}
