//! Many threads at once: contacts of their own, one contact together, handles that come and go.
#![allow(unsafe_code, reason = "it calls functions that take pointers, as a C program does")]

use palpate::body::shape::Shape;
use palpate::body::{Body, Response};
use palpate_c::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;

fn body() -> palpate_body {
    let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default()).unwrap();
    let bytes = Body::uniform(ball, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap())
        .unwrap()
        .to_bytes()
        .unwrap();
    let mut body = palpate_body::default();
    // SAFETY: as many bytes as said.
    let status =
        unsafe { palpate_body_from_memory(bytes.as_ptr(), bytes.len(), &mut body, std::ptr::null_mut()) };
    assert_eq!(status, PALPATE_STATUS_OK);
    body
}

fn contact(body: palpate_body) -> palpate_contact {
    let mut contact = palpate_contact::default();
    // SAFETY: a place for a handle.
    let status =
        unsafe { palpate_contact_create(body, std::ptr::null(), &mut contact, std::ptr::null_mut()) };
    assert_eq!(status, PALPATE_STATUS_OK);
    contact
}

/// Force at a depth, or why not.
fn press(contact: palpate_contact, z: f64) -> Result<f64, palpate_status> {
    let tool = palpate_tool_state {
        struct_size: size_of::<palpate_tool_state>() as u32,
        reserved: 0,
        position_m: [0.0, 0.0, z],
        orientation: [1.0, 0.0, 0.0, 0.0],
    };
    // SAFETY: numbers, for which all bits zero is zero.
    let mut output: palpate_output = unsafe { std::mem::zeroed() };
    output.struct_size = size_of::<palpate_output>() as u32;
    // SAFETY: a tool state and a place for an output.
    match unsafe { palpate_contact_step(contact, &tool, 1e-3, &mut output) } {
        PALPATE_STATUS_OK => Ok(output.force_n[2]),
        status => Err(status),
    }
}

#[test]
fn contacts_of_their_own_don_t_meet() {
    let body = body();
    let run = || {
        let contact = contact(body);
        let forces: Vec<f64> =
            (0..2000).map(|k| press(contact, 31e-3 - 2e-6 * f64::from(k)).unwrap()).collect();
        assert_eq!(palpate_contact_close(contact), PALPATE_STATUS_OK);
        forces
    };
    let alone = run();
    assert!(alone[1999] > 0.1);
    thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(run)).collect();
        threads.into_iter().for_each(|thread| assert_eq!(thread.join().unwrap(), alone));
    });
    assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
}

/// Whoever is in a contact is alone: no step is lost, and nobody waits.
#[test]
fn one_contact_takes_one_thread_at_a_time() {
    let body = body();
    let contact = contact(body);
    let done = AtomicU64::new(0);
    thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                for k in 0..3000 {
                    match press(contact, 31e-3 - 1e-6 * f64::from(k)) {
                        Ok(_) => drop(done.fetch_add(1, Relaxed)),
                        Err(status) => assert_eq!(status, PALPATE_STATUS_BUSY),
                    }
                }
            });
        }
    });
    // SAFETY: numbers, for which all bits zero is zero.
    let mut counters: palpate_counters = unsafe { std::mem::zeroed() };
    counters.struct_size = size_of::<palpate_counters>() as u32;
    // SAFETY: a place for counters.
    assert_eq!(unsafe { palpate_contact_counters(contact, &mut counters) }, PALPATE_STATUS_OK);
    assert_eq!(counters.steps, done.load(Relaxed));
    assert_eq!(palpate_contact_close(contact), PALPATE_STATUS_OK);
    assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
}

/// One thread closes what others use: they see it closed, and nothing else.
#[test]
fn what_is_closed_under_a_user_is_closed() {
    let body = body();
    for _ in 0..200 {
        let contact = contact(body);
        thread::scope(|scope| {
            scope.spawn(|| {
                loop {
                    match press(contact, 29e-3) {
                        Ok(_) | Err(PALPATE_STATUS_BUSY) => {}
                        Err(status) => break assert_eq!(status, PALPATE_STATUS_CLOSED),
                    }
                }
            });
            while palpate_contact_close(contact) == PALPATE_STATUS_BUSY {}
        });
    }
    assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
}

/// Two threads that know nothing of each other make, press, copy and close thousands of contacts on one body.
#[test]
fn thousands_of_contacts_come_and_go() {
    let body = body();
    let run = || {
        let mut sum = 0.0;
        for _ in 0..20 {
            let contacts: Vec<palpate_contact> = (0..100).map(|_| contact(body)).collect();
            for depth in 0..10 {
                for &contact in &contacts {
                    sum += press(contact, 30.5e-3 - 3e-4 * f64::from(depth)).unwrap();
                }
            }
            for &contact in &contacts {
                let mut copy = palpate_contact::default();
                // SAFETY: a place for a handle.
                assert_eq!(unsafe { palpate_contact_snapshot(contact, &mut copy) }, PALPATE_STATUS_OK);
                assert_eq!(palpate_contact_close(copy), PALPATE_STATUS_OK);
                assert_eq!(palpate_contact_close(contact), PALPATE_STATUS_OK);
                assert_eq!(palpate_contact_close(contact), PALPATE_STATUS_CLOSED);
            }
        }
        sum
    };
    let alone = run();
    assert!(alone > 100.0, "{alone}");
    thread::scope(|scope| {
        let threads: Vec<_> = (0..2).map(|_| scope.spawn(run)).collect();
        threads.into_iter().for_each(|thread| assert_eq!(thread.join().unwrap(), alone));
    });
    assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
}
