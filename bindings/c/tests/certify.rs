//! Certificates through the C interface are those of the crate, whose JSON the command prints.

#![allow(unsafe_code, reason = "it calls functions that take pointers, as a C program does")]

use palpate::Body;
use palpate::body::shape::{Resolution, Shape};
use palpate::body::{Response, SlipRule};
use palpate::certify::device::Device;
use palpate::certify::{Question, certify};
use palpate_c::*;
use serde_json::Value;
use std::ffi::{CStr, CString, c_void};
use std::sync::atomic::AtomicBool;

fn error() -> palpate_error {
    palpate_error { struct_size: size_of::<palpate_error>() as u32, status: 0, message: [0; _] }
}

fn words(error: &palpate_error) -> String {
    // SAFETY: a message ends in a zero.
    unsafe { CStr::from_ptr(error.message.as_ptr()) }.to_str().unwrap().to_owned()
}

fn ball(friction: f64) -> Body {
    let size = Resolution { edge_length_mm: Some(9.0), ..Resolution::default() };
    let surface = Shape::Sphere { radius_mm: 30.0 }.surface(size).unwrap();
    Body::uniform(surface, Response::paper(600.0, 500.0, friction, 8e-3, 4e-3).unwrap()).unwrap()
}

/// The same body behind a handle.
fn opened(body: &Body) -> palpate_body {
    let (bytes, mut handle) = (body.to_bytes().unwrap(), palpate_body::default());
    // SAFETY: bytes of that length, and a place for the handle.
    let status =
        unsafe { palpate_body_from_memory(bytes.as_ptr(), bytes.len(), &mut handle, std::ptr::null_mut()) };
    assert_eq!(status, PALPATE_STATUS_OK);
    handle
}

fn certificate() -> palpate_certificate {
    // SAFETY: numbers alone.
    let zero: palpate_certificate = unsafe { std::mem::zeroed() };
    palpate_certificate { struct_size: size_of::<palpate_certificate>() as u32, ..zero }
}

fn options(device: *const palpate_loop_device) -> palpate_certify_options {
    palpate_certify_options {
        struct_size: size_of::<palpate_certify_options>() as u32,
        slip_rule: PALPATE_SLIP_PAPER,
        evaluations: 400,
        threads: 2,
        step_m: 1e-3,
        depth_m: 6e-3,
        device,
    }
}

fn touch() -> palpate_loop_device {
    let mut device = palpate_loop_device {
        struct_size: size_of::<palpate_loop_device>() as u32,
        reserved: 0,
        damping_n_s_per_m: 0.0,
        rate_hz: 0.0,
        position_error_m: 0.0,
        coulomb_n: 0.0,
        delay_samples: 0.0,
    };
    let (name, mut told) = (CString::new("touch").unwrap(), error());
    // SAFETY: a string, and places for results.
    let status = unsafe { palpate_loop_device_of(name.as_ptr(), 1000.0, &mut device, &mut told) };
    assert_eq!(status, PALPATE_STATUS_OK, "{}", words(&told));
    device
}

/// NaN where JSON has null.
fn number(json: &Value, path: &str) -> f64 {
    json.pointer(path).unwrap_or_else(|| panic!("no {path}")).as_f64().unwrap_or(f64::NAN)
}

#[test]
fn a_certificate_is_the_commands() {
    for friction in [0.4, 0.02] {
        let body = ball(friction);
        let (handle, mut told) = (opened(&body), error());
        let mut device = touch();
        (device.damping_n_s_per_m, device.position_error_m) = (8.0, 1e-5);
        let (options, mut found) = (options(&device), certificate());
        // SAFETY: structs of this version, and a body that is open.
        let status = unsafe {
            palpate_body_certify(handle, &options, None, std::ptr::null_mut(), &mut found, &mut told)
        };
        assert_eq!(status, PALPATE_STATUS_OK, "{}", words(&told));

        let mut question = Question::of(&body);
        question.assumptions.slip = SlipRule::Paper;
        question.assumptions.depth_m = Some(6e-3);
        question.evaluations = Some(400);
        question.device = Some(Device {
            damping_n_s_per_m: device.damping_n_s_per_m,
            rate_hz: device.rate_hz,
            position_error_m: device.position_error_m,
            coulomb_n: device.coulomb_n,
            delay_samples: device.delay_samples,
        });
        let certified = certify(&body, &question, &|| (), &AtomicBool::new(false)).unwrap().unwrap();
        let json = serde_json::to_value(&certified.certificate).unwrap();
        let same = |found: f64, path: &str| {
            let expected = number(&json, path);
            assert!(found == expected || found.is_nan() && expected.is_nan(), "{path}: {found} {expected}");
        };
        for (name, holds, margin, least, counts, worst, at) in [
            (
                "passive",
                found.passive_holds,
                found.passive_margin,
                found.passive_found,
                [
                    found.passive_proved_elements,
                    found.passive_failing_elements,
                    found.passive_undecided_elements,
                ],
                found.passive_worst_element,
                found.passive_worst_m,
            ),
            (
                "snap_free",
                found.snap_free_holds,
                found.snap_free_margin_n_per_m,
                found.snap_free_found_n_per_m,
                [
                    found.snap_free_proved_elements,
                    found.snap_free_failing_elements,
                    found.snap_free_undecided_elements,
                ],
                found.snap_free_worst_element,
                found.snap_free_worst_m,
            ),
        ] {
            assert_eq!(json[name]["holds"], holds == 1, "{name}");
            same(margin, &format!("/{name}/margin"));
            same(least, &format!("/{name}/found"));
            for (count, key) in counts.iter().zip(["proved", "failing", "undecided"]) {
                same(*count as f64, &format!("/{name}/{key}_elements"));
            }
            assert_eq!(counts.iter().sum::<u64>(), found.elements);
            same(worst.into(), &format!("/{name}/worst/element"));
            (0..3).for_each(|k| same(at[k], &format!("/{name}/worst/contact_m/{k}")));
        }
        for (value, path) in [
            (found.lipschitz_n_per_m, "/lipschitz_n_per_m"),
            (found.lipschitz_found_n_per_m, "/lipschitz_found_n_per_m"),
            (found.depth_m, "/scope/depth_m"),
            (found.step_m, "/scope/step_m"),
            (found.lateral_m, "/scope/lateral_m"),
            (found.passive_from_m, "/scope/passive_from_m"),
            (found.elements as f64, "/elements"),
            (found.border_edges as f64, "/border_edges"),
            (found.creased_elements as f64, "/creased_elements"),
            (found.too_far_elements as f64, "/too_far_elements"),
            (found.device_stiffness_limit_n_per_m, "/device/stiffness_limit_n_per_m"),
            (found.device_depth_limit_m, "/device/depth_limit_m"),
            (found.device_force_limit_n, "/device/force_limit_n"),
            (found.device_contact_way_ratio, "/device/contact_way_ratio"),
        ] {
            same(value, path);
        }
        let most = json["stiffness_max_n_per_m"].as_array().unwrap().last().unwrap().clone();
        assert_eq!(most["value"].as_f64(), Some(found.stiffness_max_n_per_m));
        assert_eq!(json["device"]["whole_depth"], found.device_whole_depth == 1);
        assert_eq!(found.slip_rule, PALPATE_SLIP_PAPER);
        // With friction it holds, and the device's limit is a number; nearly without it does not.
        assert_eq!(found.passive_holds == 1, friction > 0.1, "{found:?}");
        assert_eq!(found.passive_failing_elements > 0, friction < 0.1);
        assert!(found.snap_free_holds == 0 || found.device_depth_limit_m > 0.0, "{found:?}");
        assert_eq!(palpate_body_close(handle), PALPATE_STATUS_OK);
    }
}

unsafe extern "C" fn stop_after_ten(user: *mut c_void, progress: *const palpate_progress) -> i32 {
    // SAFETY: the counter of the test, one call at a time; the library's struct lives as long as the call.
    let (most, progress) = unsafe { (&mut *user.cast::<u64>(), &*progress) };
    *most = progress.points_done;
    i32::from(progress.points_done >= 10 || progress.points == 0)
}

#[test]
fn it_can_be_ended_and_misused() {
    let handle = opened(&ball(0.4));
    let (mut found, mut told, mut most) = (certificate(), error(), 0u64);
    let device = touch();
    let fine = options(&device);
    let ask = |body, options: *const _, told: &mut _, found: &mut palpate_certificate| {
        // SAFETY: structs that begin with a size, and a body's handle.
        unsafe { palpate_body_certify(body, options, None, std::ptr::null_mut(), found, told) }
    };
    // SAFETY: the counter outlives the call.
    let status = unsafe {
        let user = std::ptr::from_mut(&mut most).cast();
        palpate_body_certify(handle, &fine, Some(stop_after_ten), user, &mut found, &mut told)
    };
    assert_eq!(status, PALPATE_STATUS_CANCELLED);
    assert_eq!((most, found.elements), (10, 0));
    for (wrong, words_of_it) in [
        (palpate_certify_options { step_m: 0.0, ..fine }, "step_m"),
        (palpate_certify_options { depth_m: -1.0, ..fine }, "depth_m"),
        (palpate_certify_options { slip_rule: 9, ..fine }, "slip rule"),
    ] {
        assert_eq!(ask(handle, &wrong, &mut told, &mut found), PALPATE_STATUS_INVALID);
        assert!(words(&told).contains(words_of_it), "{}", words(&told));
    }
    let endless = palpate_loop_device { rate_hz: 0.0, ..device };
    assert_eq!(ask(handle, &options(&endless), &mut told, &mut found), PALPATE_STATUS_INVALID);
    let small = palpate_loop_device { struct_size: 8, ..device };
    assert_eq!(ask(handle, &options(&small), &mut told, &mut found), PALPATE_STATUS_WRONG_SIZE);
    let name = CString::new("wand").unwrap();
    let mut device = device;
    // SAFETY: a string, and places for results.
    let status = unsafe { palpate_loop_device_of(name.as_ptr(), 1e3, &mut device, &mut told) };
    assert_eq!(status, PALPATE_STATUS_INVALID);
    assert!(words(&told).contains("falcon"), "{}", words(&told));
    found.struct_size = 8;
    assert_eq!(ask(handle, &fine, &mut told, &mut found), PALPATE_STATUS_WRONG_SIZE);
    found.struct_size = size_of::<palpate_certificate>() as u32;
    assert_eq!(palpate_body_close(handle), PALPATE_STATUS_OK);
    assert_eq!(ask(handle, &fine, &mut told, &mut found), PALPATE_STATUS_CLOSED);
    // Nothing was written but the size.
    assert_eq!(found.elements, 0);
}
