//! The patch follows the tool, and a tool that has outrun it is caught up with.

mod common;

use common::{patch, shape, uniform, with_field};
use palpate_body::Body;
use palpate_body::shape::Shape;
use palpate_device::{Device, Pose, Replay, ReplaySample};
use palpate_engine::{Contact, Flags, ToolState};
use palpate_runtime::{HapticLoop, Limit, Stages, WorkspaceMap, patch_holder};
use std::sync::Arc;

const RADIUS: f64 = 0.03;
/// Pressed in by a millimetre.
const DEEP: f64 = RADIUS - 1e-3;

/// They reach 4 mm.
const ELEMENTS: usize = 1100;

/// Down onto a ball in 0.1 s and then around it at 0.1 m/s, ms by ms.
fn around(seconds: f64) -> Vec<ReplaySample> {
    let sample = |k: usize| {
        let t = k as f64 * 1e-3;
        let (radius, angle) = (RADIUS + 1e-3 - 2e-3 * (t / 0.1).min(1.0), (t - 0.1).max(0.0) * 0.1 / DEEP);
        let position_m = [radius * libm::sin(angle), 0.0, radius * libm::cos(angle)];
        ReplaySample { time_s: t, pose: Pose { position_m, ..Pose::default() }, buttons: 0 }
    };
    (0..=(seconds * 1e3) as usize).map(sample).collect()
}

/// Onto a plane, a millimetre deep, and then to and fro by 10 mm.
fn to_and_fro(seconds: f64) -> Vec<ReplaySample> {
    let sample = |k: usize| {
        let t = k as f64 * 1e-3;
        let aside = 10e-3 * libm::sin(15.0 * (t - 0.1).max(0.0));
        let position_m = [aside, 0.0, 1e-3 - 2e-3 * (t / 0.1).min(1.0)];
        ReplaySample { time_s: t, pose: Pose { position_m, ..Pose::default() }, buttons: 0 }
    };
    (0..=(seconds * 1e3) as usize).map(sample).collect()
}

fn ball() -> Arc<Body> {
    let mesh = shape(Shape::Sphere { radius_mm: RADIUS * 1e3 }, 0.3);
    Arc::new(with_field(&mesh, 600.0, 500.0, 0.1, &|_| 1.0))
}

/// What came of a path.
#[derive(Debug, PartialEq)]
struct Seen {
    /// Periods in which the contact point waited, in each tenth of a second,
    waits: Vec<usize>,
    /// patches that were refused,
    refused: u64,
    /// and how far two contact points were apart at most, m.
    apart_m: f64,
}

/// What comes of a path of 1.5 s where making a patch of all elements takes `whole` periods, and the finder is stalled for some.
fn led(body: &Arc<Body>, path: Vec<ReplaySample>, whole: usize, stalled: std::ops::Range<usize>) -> Seen {
    let start = path[0].pose.position_m;
    let mut device = Replay::new(path);
    device.open().unwrap();
    let stages = Stages { force: Limit::new(1e3, 1e3), ..Stages::default() };
    let mut haptics = HapticLoop::new(Contact::new(body), WorkspaceMap::default(), stages);
    let (mut patch_holder, mut finder) = patch_holder(body.clone(), start, ELEMENTS).unwrap();
    let (mut waits, mut apart_m) = (vec![0; 15], 0.0f64);
    let (mut serial, mut busy_until) = (1, 0);
    for k in 0..1500 {
        if k >= busy_until && !stalled.contains(&k) {
            finder.look().unwrap();
        }
        let time = k as f64 * 1e-3;
        patch_holder.renew(haptics.contact_mut());
        let (newest, elements) = patch_holder.asked();
        if std::mem::replace(&mut serial, newest) != newest {
            busy_until = k + whole * elements / ELEMENTS;
        }
        let period = haptics.period(patch_holder.patch(), &mut device, time);
        assert!(k < 110 || period.output.flags.has(Flags::IN_CONTACT), "{time}");
        patch_holder.report(
            time,
            period.pose.position_m,
            haptics.contact(),
            period.output.flags.has(Flags::PATCH_BOUNDARY),
        );
        waits[k / 100] += usize::from(period.output.flags.has(Flags::PATCH_BOUNDARY));
        let mut points = haptics.contact().contact_points().map(|at| patch_holder.patch().model().point(at));
        if let (Some(one), Some(other)) = (points.next(), points.next()) {
            apart_m = apart_m.max(one.distance(other));
        }
    }
    Seen { waits, refused: patch_holder.refused(), apart_m }
}

#[test]
fn a_finder_in_time_is_never_waited_for() {
    let body = ball();
    for whole in [1, 10, 20] {
        let never = Seen { waits: vec![0; 15], refused: 0, apart_m: 0.0 };
        assert_eq!(led(&body, around(1.5), whole, 0..0), never, "{whole}");
    }
}

/// Two contact points are apart where a drag turns back, by nearly half of what a patch reaches: it holds both.
#[test]
fn a_patch_holds_both_contact_points_of_partial_slip() {
    let plane = uniform(&patch(0.1, 300), 600.0, 60.0, 6.0);
    let body = Arc::new(plane.with_partial_slip(true));
    for whole in [1, 5] {
        let Seen { waits, refused, apart_m } = led(&body, to_and_fro(1.5), whole, 0..0);
        assert!(apart_m > 1.5e-3, "{apart_m}");
        assert!(waits.iter().all(|&n| n == 0) && refused == 0, "{whole}: {waits:?} {refused}");
    }
}

/// One contact point waits at the patch's boundary, the other one sticks in its middle. A patch of a quarter of the elements around the
/// middle of both held neither, was refused, and nothing else was made for as long as they stayed there.
#[test]
fn two_contact_points_far_apart_get_a_patch_that_holds_both() {
    let body = Arc::new(uniform(&patch(0.1, 300), 600.0, 60.0, 20.0).with_partial_slip(true));
    let (mut patch_holder, mut finder) = patch_holder(body.clone(), [0.0; 3], ELEMENTS).unwrap();
    let mut contact = Contact::new(&body);
    let at = |x: f64, depth: f64| ToolState::at([x, 1e-4, -depth]);
    contact.step(patch_holder.patch().model(), &at(0.0, -1e-3), 1e-3);
    // The finder is stalled.
    let (mut x, mut waits) = (0.0, 0);
    while waits < 10 {
        let output = contact.step(patch_holder.patch().model(), &at(x, 1e-3), 1e-3);
        waits += usize::from(output.flags.has(Flags::PATCH_BOUNDARY));
        x += 5e-5;
        assert!(x < 0.03, "nothing waits");
    }
    let places = contact.contact_points().map(|at| patch_holder.patch().model().point(at));
    let places: Vec<_> = places.collect();
    let half = 0.5 * places[0].distance(places[1]);
    assert!(half > 0.45 * patch_holder.patch().radius_m(), "{half}");
    for k in 0..200 {
        finder.look().unwrap();
        patch_holder.renew(&mut contact);
        // Hardly at rest: what waited goes on by no more than twice as far as the tool moves.
        x += 5e-6;
        let output = contact.step(patch_holder.patch().model(), &at(x, 1e-3), 1e-3);
        let waits = output.flags.has(Flags::PATCH_BOUNDARY);
        patch_holder.report(f64::from(k) * 1e-3, at(x, 1e-3).position_m, &contact, waits);
        if !waits {
            assert!(patch_holder.asked().0 > 1 && patch_holder.refused() == 0);
            return;
        }
    }
    panic!("they wait for ever: {} patches were refused", patch_holder.refused());
}

#[test]
fn a_tool_that_has_outrun_its_patch_is_caught_up_with() {
    let body = ball();
    for whole in [1, 20] {
        let Seen { waits, refused, .. } = led(&body, around(1.5), whole, 300..500);
        // The patch reaches a fifth of the 20 mm. One that is laid where the contact point waits takes it on by that, one that is
        // laid ahead of it by more.
        assert!(waits[4] == 100, "{whole}: {waits:?}");
        assert!(waits[..3].iter().chain(&waits[7..]).all(|&n| n == 0) && refused == 0, "{whole}: {waits:?}");
    }
}
