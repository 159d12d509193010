//! Bodies made through the C interface, and the same by the crate.

#![allow(unsafe_code, reason = "it calls functions that take pointers, as a C program does")]

use palpate::body::shape::Shape;
use palpate::{Contact, ToolState};
use palpate_c::*;
use std::ffi::{CStr, CString};

fn error() -> palpate_error {
    palpate_error { struct_size: size_of::<palpate_error>() as u32, status: 0, message: [0; _] }
}

fn words(error: &palpate_error) -> String {
    // SAFETY: a message ends in a zero.
    unsafe { CStr::from_ptr(error.message.as_ptr()) }.to_str().unwrap().to_owned()
}

#[test]
fn a_body_of_arrays_passes_through_its_samples() {
    let mesh = Shape::Sphere { radius_mm: 30.0 }.mesh(Default::default()).unwrap();
    let positions: Vec<f64> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
    let triangles: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    let row = |component, deflection_m, value| palpate_sample_row {
        point: 5,
        component,
        position_m: [0.0, 0.0, 30e-3],
        deflection_m,
        value,
    };
    let samples = [
        row(PALPATE_NORMAL, 2e-3, 0.4),
        row(PALPATE_NORMAL, 4e-3, 1.5),
        row(PALPATE_LATERAL, 2e-3, 0.8),
        row(PALPATE_LATERAL, 4e-3, 1.6),
    ];
    let arrays = palpate_body_arrays {
        struct_size: size_of::<palpate_body_arrays>() as u32,
        abi_version: PALPATE_ABI_VERSION,
        positions_m: positions.as_ptr(),
        vertex_count: mesh.positions.len(),
        triangles: triangles.as_ptr(),
        triangle_count: mesh.triangles.len(),
        samples: samples.as_ptr(),
        sample_count: samples.len(),
        sample_size: size_of::<palpate_sample_row>() as u32,
        is_open: 0,
        crease_angle_rad: 0.0,
        default_friction: 0.3,
        tool_radius_m: 1e-3,
        slip_rule: PALPATE_SLIP_EXACT,
        without_tank: 1,
        between: PALPATE_BETWEEN_LINEAR,
        reserved: 0,
    };
    let (mut body, mut told) = (palpate_body::default(), error());
    // SAFETY: arrays of the lengths that they are said to have, and places for results.
    unsafe {
        let status = palpate_body_from_arrays(&arrays, &mut body, &mut told);
        assert_eq!(status, PALPATE_STATUS_OK, "{}", words(&told));
        let mut info: palpate_body_info = std::mem::zeroed();
        info.struct_size = size_of::<palpate_body_info>() as u32;
        assert_eq!(palpate_body_inspect(body, &mut info), PALPATE_STATUS_OK);
        assert_eq!((info.elements, info.test_points), (mesh.triangles.len() as u64, 1));
        assert_eq!((info.has_tank, info.slip_rule, info.tool), (0, PALPATE_SLIP_EXACT, PALPATE_TOOL_SPHERE));
        assert_eq!((info.tool_radius_m, info.depth_max_m), (1e-3, 4e-3));
        // The steeper of the two normal pieces; the lateral slope is below.
        assert!((info.stiffness_max_n_per_m - 550.0).abs() < 1e-9, "{}", info.stiffness_max_n_per_m);
        assert!(info.high_m.iter().all(|x| (x - 30e-3).abs() < 1e-3), "{:?}", info.high_m);

        // In the file, and back: what Rust opens presses back as the samples say.
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("ball.body");
        let name = CString::new(file.to_str().unwrap()).unwrap();
        assert_eq!(palpate_body_save(body, name.as_ptr(), &mut told), PALPATE_STATUS_OK, "{}", words(&told));
        let opened = palpate::Body::open(&file).unwrap();
        let mut contact = Contact::new(&opened);
        contact.step(&opened, &ToolState::at([0.0, 0.0, 32e-3]), 1e-3);
        let output = contact.step(&opened, &ToolState::at([0.0, 0.0, 29e-3]), 1e-3);
        assert!(
            (output.contact.unwrap().delta_z_m - 2e-3).abs() < 1e-6 && (output.force_n[2] - 0.4).abs() < 1e-3
        );
    }
    assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
}

#[cfg(feature = "build")]
mod spec {
    use super::*;
    use std::ffi::c_void;
    use std::path::Path;

    fn example(name: &str) -> CString {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name);
        CString::new(path.to_str().unwrap()).unwrap()
    }

    /// What a caller hears: points done, points, calls; and when it has enough.
    #[derive(Debug, Default)]
    struct Heard {
        done: Vec<u64>,
        points: u64,
        enough: Option<u64>,
    }

    unsafe extern "C" fn hear(user: *mut c_void, progress: *const palpate_progress) -> i32 {
        // SAFETY: the test gives what it hears with, and the library how far it is, one call at a time.
        let (heard, progress) = unsafe { (&mut *user.cast::<Heard>(), &*progress) };
        if progress.message.is_null() {
            heard.done.push(progress.points_done);
            heard.points = progress.points;
        }
        heard.enough.is_some_and(|enough| progress.points_done >= enough && progress.points > 0).into()
    }

    fn build(
        spec: &CStr,
        folder: Option<&CStr>,
        heard: &mut Heard,
    ) -> (palpate_status, palpate_body, String) {
        let (mut body, mut told) = (palpate_body::default(), error());
        let folder = folder.map_or(std::ptr::null(), CStr::as_ptr);
        let user = std::ptr::from_mut(heard).cast();
        // SAFETY: strings that end in zeros, and places for results.
        let status = unsafe {
            palpate_body_from_spec(spec.as_ptr(), folder, 2, Some(hear), user, &mut body, &mut told)
        };
        (status, body, words(&told))
    }

    #[test]
    fn a_law_needs_no_simulation() {
        let (status, body, message) = build(&example("cylinder-law.toml"), None, &mut Heard::default());
        assert_eq!(status, PALPATE_STATUS_OK, "{message}");
        assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
        let nowhere = CString::new("no such spec.toml").unwrap();
        let (status, _, message) = build(&nowhere, None, &mut Heard::default());
        assert!(status == PALPATE_STATUS_BODY && message.contains("no such spec.toml"), "{message}");
    }

    #[test]
    fn a_simulation_is_cancelled_and_goes_on() {
        let work = tempfile::tempdir().unwrap();
        let folder = CString::new(work.path().to_str().unwrap()).unwrap();
        let mut heard = Heard { enough: Some(2), ..Heard::default() };
        let (status, body, message) = build(&example("ball.toml"), Some(&folder), &mut heard);
        assert_eq!((status, body.id), (PALPATE_STATUS_CANCELLED, 0), "{message}");
        let mut heard = Heard::default();
        let (status, body, message) = build(&example("ball.toml"), Some(&folder), &mut heard);
        assert_eq!(status, PALPATE_STATUS_OK, "{message}");
        // What was done before is not done again.
        assert!(heard.points == 6 && heard.done[0] >= 2 && heard.done.last() == Some(&6), "{heard:?}");
        assert_eq!(palpate_body_close(body), PALPATE_STATUS_OK);
    }
}
