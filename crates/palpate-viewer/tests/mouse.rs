//! The mouse as a tool: press, drag, slip, release, stop; without a window.

use glam::{DVec2, DVec3};
use palpate::engine::Flags;
use palpate::runtime::BodyFile;
use palpate_viewer::gallery::Example;
use palpate_viewer::work::Opened;
use palpate_viewer::{Event, Settings, Shown, StandardView, Viewer};
use std::time::{Duration, Instant};

/// Lets a viewer run against the clock until something holds of what is shown.
fn until(viewer: &mut Viewer, began: Instant, what: &str, holds: impl Fn(&Shown) -> bool) -> Shown {
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        viewer.tick(began.elapsed().as_secs_f64());
        if let Some(shown) = viewer.shown().filter(&holds) {
            return shown;
        }
        assert!(Instant::now() < deadline, "{what}: {:?} {:?}", viewer.shown(), viewer.message());
        std::thread::sleep(Duration::from_millis(4));
    }
}

fn touching(example: Example) -> Viewer {
    let mut viewer = Viewer::default();
    viewer.show_body(Opened { body: example.make().unwrap(), name: "pad".into(), file: BodyFile::default() });
    assert!(viewer.message().is_none(), "{:?}", viewer.message());
    viewer.update([Event::Look(StandardView::Top), Event::Resize(1.0)]);
    viewer
}

#[test]
fn a_press_a_drag_and_a_release() {
    let began = Instant::now();
    let mut viewer = touching(Example::Pad);
    viewer.update([Event::Point(Some(DVec2::ZERO))]);
    until(&mut viewer, began, "hovers", |s| s.contact.is_none() && s.tool_m().z > 0.02);

    viewer.update([Event::Press(true)]);
    let pressed = until(&mut viewer, began, "presses", |s| {
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
    let dragged = until(&mut viewer, began, "drags", |s| s.contact.is_some_and(|c| c.position_m[0] > 5e-3));
    assert!(dragged.force_n.x < 0.0 && dragged.energy.dissipated_j > 0.0, "{dragged:?}");
    let slipped = viewer.past().iter().any(|r| r.engine().has(Flags::SLIPPING));
    assert!(slipped && viewer.track().len() > 3, "{:?}", viewer.track());

    viewer.update([Event::Press(false)]);
    until(&mut viewer, began, "leaves", |s| s.contact.is_none() && s.force_n == DVec3::ZERO);
}

#[test]
fn a_stop_takes_the_force_off_and_a_start_begins_anew() {
    let began = Instant::now();
    let mut viewer = touching(Example::Pad);
    viewer.update([Event::Point(Some(DVec2::ZERO)), Event::Press(true)]);
    until(&mut viewer, began, "presses", |s| s.command_n.is_some_and(|f| f.length() > 0.1));
    viewer.update([Event::Stop]);
    let stopped = until(&mut viewer, began, "stops", |s| s.command_n == Some(DVec3::ZERO));
    assert!(stopped.stages.has(palpate::runtime::StageFlags::STOPPED), "{stopped:?}");
    let deadline = Instant::now() + Duration::from_secs(10);
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
