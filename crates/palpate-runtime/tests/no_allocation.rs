//! A period of the loop allocates nothing, with all stages on, on a body and on patches of it: a forbidden allocation aborts
//! the test.

mod common;

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use common::{plane, shape, with_field};
use glam::DVec3;
use palpate_body::shape::Shape;
use palpate_device::simulated::{Hand, Move, Script};
use palpate_device::{Device, Fault, Simulated, presets};
use palpate_engine::{Contact, Flags};
use palpate_runtime::{
    Coupling, Damping, HapticLoop, Limit, PassivityController, Record, Stages, Statistics, WorkspaceMap,
    patch_holder, ring,
};
use std::sync::Arc;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn a_period_allocates_nothing() {
    let body = plane(600.0, 500.0, 0.3);
    let moves = [
        Move::Press { depth_m: 5e-3, seconds: 0.2 },
        Move::Drag { along_m: 0.02, across_m: 5e-3, seconds: 0.4 },
        Move::Turn { angles_rad: DVec3::new(0.1, 0.2, 0.3), seconds: 0.2 },
        Move::Tap { depth_m: -8e-3, times: 3, seconds: 0.4 },
        Move::Hold { tremor_m: 3e-4, tremor_hz: 9.0, seconds: 0.3 },
    ];
    // The handle is above its tip.
    let script = Script::new(DVec3::new(1e-3, 2e-3, 0.05), 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let hand = Hand { stiffness_nm_per_rad: 0.3, damping_nm_s_per_rad: 2e-3, ..hand };
    let mut device = Simulated::new(presets::device("sigma").unwrap(), hand, Box::new(script));
    device.open().unwrap();
    let map = WorkspaceMap { tip_in_handle_m: DVec3::Z * -0.05, ..WorkspaceMap::default() };
    let stages = Stages {
        coupling: Some(Coupling::new(800.0, 4000.0).with_angular(0.5, 1.0)),
        passivity: Some(PassivityController::new(1e-3, 0.055).with_inertia(1e-4)),
        damping: Some(Damping::new(0.5).with_angular(1e-3)),
        torque: Limit::new(0.1, 0.05),
        force: Limit::new(3.3, 1.65),
        ..Stages::default()
    };
    let mut closed = HapticLoop::new(Contact::new(&body), map, stages);
    let (mut recorder, _records) = ring(1000);
    let mut statistics = Statistics::new(1000.0);
    let (mut touched, mut twisted) = (0, 0);
    for k in 0..1300u32 {
        let step = assert_no_alloc(|| {
            let step = closed.step(&body, &mut device, f64::from(k) * 1e-3)?;
            // The ring runs full on the way: that costs nothing either.
            let record = Record::new(k.into(), &closed, &step);
            recorder.push(&record);
            statistics.add(&record);
            Ok::<_, Fault>(step)
        })
        .unwrap();
        touched += u32::from(step.output.flags.has(Flags::IN_CONTACT));
        twisted += u32::from(step.command.torque_nm != [0.0; 3]);
        assert!(DVec3::from_array(step.command.force_n).length() <= 3.3);
    }
    assert!(touched > 300 && twisted > 300 && recorder.dropped() == 300, "{touched} {twisted}");
}

/// What the haptic thread does in a period, with the contact finder's looks in between, which may allocate.
#[test]
fn a_period_on_patches_allocates_nothing_while_they_are_renewed() {
    let mesh = shape(Shape::Sphere { radius_mm: 30.0 }, 0.7);
    let body = Arc::new(with_field(&mesh, 600.0, 500.0, 0.1, &|p| 1.0 + 0.3 * libm::sin(p.x * 90.0)));
    let moves = [
        Move::Press { depth_m: 5e-3, seconds: 0.2 },
        Move::Drag { along_m: 0.03, across_m: 5e-3, seconds: 0.6 },
        Move::Tap { depth_m: -8e-3, times: 3, seconds: 0.4 },
    ];
    let top = DVec3::Z * 0.03;
    let script = Script::new(top, 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let mut device = Simulated::new(presets::device("touch").unwrap(), hand, Box::new(script));
    device.open().unwrap();
    let stages = Stages { force: Limit::new(3.3, 1.65), ..Stages::default() };
    let mut haptics = HapticLoop::new(Contact::new(&body), WorkspaceMap::default(), stages);
    let (mut patch_holder, mut finder) = patch_holder(body, top.to_array(), 200).unwrap();
    let (mut recorder, _records) = ring(2000);
    let (mut touched, mut patches, mut waited) = (0, 0, 0);
    for k in 0..1200u32 {
        // It skips looks now and then, so that the loop meets the patch's boundary.
        if k % 100 < 30 {
            finder.look().unwrap();
        }
        let time = f64::from(k) * 1e-3;
        let (period, renewed) = assert_no_alloc(|| {
            let before = patch_holder.asked().0;
            patch_holder.renew(haptics.contact_mut());
            haptics.rehearse(patch_holder.patch());
            let period = haptics.period(patch_holder.patch(), &mut device, time);
            let waits = period.output.flags.has(Flags::PATCH_BOUNDARY);
            patch_holder.report(time, period.pose.position_m, haptics.contact(), waits);
            assert!(recorder.push(&Record::new(k.into(), &haptics, &period)));
            (period, patch_holder.asked().0 != before)
        });
        assert_eq!(period.fault, None);
        touched += u32::from(period.output.flags.has(Flags::IN_CONTACT));
        patches += u32::from(renewed);
        waited += u32::from(period.output.flags.has(Flags::PATCH_BOUNDARY));
    }
    println!("{touched} in contact, {patches} patches, {waited} at the patch's boundary");
    assert!(touched > 300 && patches > 10 && waited > 0, "{touched} {patches} {waited}");
    assert_eq!(patch_holder.refused(), 0);
    let _ = haptics.fade(&mut device, 1.2);
}
