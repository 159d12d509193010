//! What the header calls real-time allocates nothing: the allocator ends the process if it does.
#![allow(unsafe_code, reason = "it calls functions that take pointers, as a C program does")]

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use palpate::body::shape::Shape;
use palpate::body::{Body, Response};
use palpate_c::*;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn a_step_and_what_goes_with_it_allocates_nothing() {
    let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default()).unwrap();
    let ball = Body::uniform(ball, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()).unwrap();
    let bytes = ball.to_bytes().unwrap();
    let (mut body, mut contact, mut snapshot) = Default::default();
    let (times, mut positions, mut forces) = ([0.0, 1e-3, 2e-3], [0.0; 9], [0.0; 9]);
    positions[2] = 31e-3;
    (positions[5], positions[8]) = (29e-3, 28e-3);
    let path = palpate_path {
        struct_size: size_of::<palpate_path>() as u32,
        reserved: 0,
        count: 3,
        times_s: times.as_ptr(),
        positions_m: positions.as_ptr(),
        orientations: std::ptr::null(),
    };
    let trace = palpate_trace {
        struct_size: size_of::<palpate_trace>() as u32,
        reserved: 0,
        forces_n: forces.as_mut_ptr(),
        torques_nm: std::ptr::null_mut(),
        flags: std::ptr::null_mut(),
        energies: std::ptr::null_mut(),
        outputs: std::ptr::null_mut(),
    };
    let mut tool = palpate_tool_state {
        struct_size: size_of::<palpate_tool_state>() as u32,
        reserved: 0,
        position_m: [0.0; 3],
        orientation: [1.0, 0.0, 0.0, 0.0],
    };
    let mut touching = 0;
    // SAFETY: pointers to what the functions ask for; structs of numbers, for which all bits zero is zero.
    unsafe {
        let (mut output, mut ledger, mut counters): (palpate_output, palpate_ledger, palpate_counters) =
            std::mem::zeroed();
        output.struct_size = size_of::<palpate_output>() as u32;
        ledger.struct_size = size_of::<palpate_ledger>() as u32;
        counters.struct_size = size_of::<palpate_counters>() as u32;
        let none = std::ptr::null_mut();
        assert_eq!(palpate_body_from_memory(bytes.as_ptr(), bytes.len(), &mut body, none), PALPATE_STATUS_OK);
        assert_eq!(palpate_contact_create(body, std::ptr::null(), &mut contact, none), PALPATE_STATUS_OK);
        assert_eq!(palpate_contact_snapshot(contact, &mut snapshot), PALPATE_STATUS_OK);
        assert_no_alloc(|| {
            for k in 0..2000 {
                let t = f64::from(k) * 1e-3;
                tool.position_m = [8e-3 * (3.0 * t).sin(), 0.0, 30e-3 + 3e-3 * (5.0 * t).cos()];
                if k == 700 {
                    tool.position_m[0] = f64::NAN;
                }
                assert_eq!(palpate_contact_step(contact, &tool, 1e-3, &mut output), PALPATE_STATUS_OK);
                touching += u32::from(output.flags & PALPATE_FLAG_IN_CONTACT != 0);
                // Refusals too.
                assert_eq!(
                    palpate_contact_step(contact, std::ptr::null(), 1e-3, &mut output),
                    PALPATE_STATUS_NULL
                );
                let closed = palpate_contact { id: 0 };
                assert_eq!(palpate_contact_step(closed, &tool, 1e-3, &mut output), PALPATE_STATUS_CLOSED);
            }
            assert_eq!(palpate_contact_ledger(contact, &mut ledger), PALPATE_STATUS_OK);
            assert_eq!(palpate_contact_counters(contact, &mut counters), PALPATE_STATUS_OK);
            assert_eq!(palpate_contact_set_friction_scale(contact, 0.5), PALPATE_STATUS_OK);
            assert_eq!(palpate_contact_set_tank(contact, 0), PALPATE_STATUS_OK);
            for partial_slip in [1, 0] {
                assert_eq!(palpate_contact_set_partial_slip(contact, partial_slip), PALPATE_STATUS_OK);
                assert_eq!(palpate_contact_step(contact, &tool, 1e-3, &mut output), PALPATE_STATUS_OK);
            }
            assert_eq!(palpate_contact_restore(contact, snapshot), PALPATE_STATUS_OK);
            assert_eq!(palpate_contact_rollout(contact, &path, &trace, none), PALPATE_STATUS_OK);
            assert_eq!(palpate_contact_forget(contact), PALPATE_STATUS_OK);
        });
        assert_eq!(counters.steps, 2000);
    }
    assert!(touching > 500 && has_pressed(&forces), "{touching}");
}

/// The rollout pressed.
fn has_pressed(forces: &[f64; 9]) -> bool {
    forces[2] == 0.0 && forces[5] > 0.05 && forces[8] > forces[5]
}
