//! The patch follows the tool, and a tool that has outrun it is caught up with.

mod common;

use common::{shape, with_field};
use palpate_body::shape::Shape;
use palpate_device::{Device, Pose, Replay, ReplaySample};
use palpate_engine::Contact;
use palpate_runtime::{HapticLoop, Limit, Stages, WorkspaceMap, footing};
use std::sync::Arc;

const RADIUS: f64 = 0.03;
/// Pressed in by a millimetre.
const DEEP: f64 = RADIUS - 1e-3;

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

/// Periods in which the contact point waited, in each tenth of a second, where the finder looks every `looks` periods and
/// not at all while it is stalled; and the patches that were refused.
fn waits(looks: usize, stalled: std::ops::Range<usize>) -> (Vec<usize>, u64) {
    let mesh = shape(Shape::Sphere { radius_mm: RADIUS * 1e3 }, 0.7);
    let body = Arc::new(with_field(&mesh, 600.0, 500.0, 0.1, &|_| 1.0));
    let mut device = Replay::new(around(1.5));
    device.open().unwrap();
    let stages = Stages { force: Limit::new(1e3, 1e3), ..Stages::default() };
    let mut haptics = HapticLoop::new(Contact::new(&body), WorkspaceMap::default(), stages);
    // It reaches 3.7 mm.
    let (mut footing, mut finder) = footing(body, [0.0, 0.0, RADIUS], 200).unwrap();
    let mut waits = vec![0; 15];
    for k in 0..1500 {
        if k % looks == 0 && !stalled.contains(&k) {
            finder.look().unwrap();
        }
        let time = k as f64 * 1e-3;
        footing.renew(haptics.contact_mut());
        let period = haptics.period(footing.patch(), &mut device, time);
        assert!(k < 110 || period.output.flags.in_contact, "{time}");
        footing.report(time, period.pose.position_m, haptics.contact(), period.output.flags.fenced);
        waits[k / 100] += usize::from(period.output.flags.fenced);
    }
    (waits, footing.refused())
}

#[test]
fn a_finder_in_time_is_never_waited_for() {
    for looks in [1, 10, 20] {
        assert_eq!(waits(looks, 0..0), (vec![0; 15], 0), "{looks}");
    }
}

#[test]
fn a_tool_that_has_outrun_its_patch_is_caught_up_with() {
    for looks in [1, 20] {
        let (waits, refused) = waits(looks, 300..500);
        // 3.7 mm of 20 the patch reaches. A patch that is laid where the contact point waits takes it on by as much, one that
        // is laid ahead of it by more.
        assert!(waits[4] == 100, "{looks}: {waits:?}");
        assert!(waits[..3].iter().chain(&waits[7..]).all(|&n| n == 0) && refused == 0, "{looks}: {waits:?}");
    }
}
