//! Certificates: what is proved of a body, and what a device's sampled loop adds.

use crate::body::{open_body, slip_number, slip_rule};
use crate::handles::palpate_body;
use crate::make::{palpate_progress, palpate_progress_function};
use crate::status::{
    Failure, PALPATE_STATUS_CANCELLED, PALPATE_STATUS_INVALID, changed, given, guarded, palpate_error,
    palpate_status, sized, text,
};
use palpate::certify::device::Device;
use palpate::certify::{Certificate, Holds, Question};
use palpate::device::presets;
use palpate::files;
use std::ffi::{c_char, c_void};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// A device in a sampled loop, as certificates ask for it. `PALPATE_LOOP_DEVICE_INIT` has a loop of 1 kHz and zeros;
/// `palpate_loop_device_of` fills it for a device by name.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_loop_device {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Viscous damping that is always there, N s/m.
    pub damping_n_s_per_m: f64,
    /// Rate of the loop, Hz.
    pub rate_hz: f64,
    /// Greatest error of a measured position, m: 0.87 steps of the encoder at the tool, half a step along each axis.
    pub position_error_m: f64,
    /// Coulomb friction, N.
    pub coulomb_n: f64,
    /// Samples by which a force comes late, or parts of one.
    pub delay_samples: f64,
}

/// For which motions a body is certified, and with how much effort. `PALPATE_CERTIFY_OPTIONS_INIT` is what `palpate certify` takes.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_certify_options {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// `PALPATE_SLIP_...`; 0 for the body's own.
    pub slip_rule: u32,
    /// Bounds computed for each element and certificate, at most; 0 for the rule's usual number.
    pub evaluations: u32,
    /// Threads; 0 for one on each core.
    pub threads: u32,
    /// Longest way of the tool from one step to the next, m.
    pub step_m: f64,
    /// Deepest that the tool goes, m; 0 for the end of the body's responses.
    pub depth_m: f64,
    /// The device whose loop is judged, too; null for none.
    pub device: *const palpate_loop_device,
}

/// What is proved of a body, in numbers. A margin is the least over the whole body, a bound and not a sample: 0 or more is proved. NaN stands
/// for what is not known, or not there.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_certificate {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// The slip rule that it speaks of: `PALPATE_SLIP_...`.
    pub slip_rule: u32,
    /// 1 if it is proved on every element that no slip makes energy out of nothing. A body with the tank gives out no more than it
    /// took even where this is 0.
    pub passive_holds: u32,
    /// 1 if it is proved on every element that no slip runs away, so that the force does not jump.
    pub snap_free_holds: u32,
    /// The energy that a slip takes out, as a share of the forces: proved.
    pub passive_margin: f64,
    /// The least that was found of it.
    pub passive_found: f64,
    /// Elements on which it is proved.
    pub passive_proved_elements: u64,
    /// Elements on which a state was found that breaks it.
    pub passive_failing_elements: u64,
    /// Elements on which neither was found out.
    pub passive_undecided_elements: u64,
    /// The element where the least was found; `PALPATE_NO_ELEMENT` if nothing slips.
    pub passive_worst_element: u32,
    /// The element where the least of `snap_free_found_n_per_m` was found, or `PALPATE_NO_ELEMENT`.
    pub snap_free_worst_element: u32,
    /// The contact point there, m.
    pub passive_worst_m: [f64; 3],
    /// The slope with which a slip comes to rest, N/m: proved.
    pub snap_free_margin_n_per_m: f64,
    /// The least that was found of it, N/m.
    pub snap_free_found_n_per_m: f64,
    /// Elements on which it is proved.
    pub snap_free_proved_elements: u64,
    /// Elements on which a state was found that breaks it, or along a crease.
    pub snap_free_failing_elements: u64,
    /// Elements on which neither was found out.
    pub snap_free_undecided_elements: u64,
    /// The contact point where the least was found, m.
    pub snap_free_worst_m: [f64; 3],
    /// No force changes faster with the tool's position, N/m: proved; NaN where `snap_free_holds` is 0.
    pub lipschitz_n_per_m: f64,
    /// The greatest that was found of it, N/m.
    pub lipschitz_found_n_per_m: f64,
    /// The greatest stiffness, N/m.
    pub stiffness_max_n_per_m: f64,
    /// To this depth it holds, m.
    pub depth_m: f64,
    /// For tools that go no farther from step to step, m.
    pub step_m: f64,
    /// Of a coupled law: to this lateral deflection, m; NaN with curves.
    pub lateral_m: f64,
    /// From this depth on passivity is looked into, m; 0 with curves.
    pub passive_from_m: f64,
    /// Elements.
    pub elements: u64,
    /// Edges over which a contact ends with the force it has.
    pub border_edges: u64,
    /// Elements along creases, where the force jumps and passivity is not looked into.
    pub creased_elements: u64,
    /// Elements on which friction can hold beyond ten times the lateral curves: not followed so far.
    pub too_far_elements: u64,
    /// The greatest stiffness that the device can hold, N/m. NaN, like the three below, without a device, and where its delay or error of
    /// position makes it a matter of what is not proved.
    pub device_stiffness_limit_n_per_m: f64,
    /// The depth down to which no place of the body is stiffer, m; 0 if it is too stiff laterally at any depth.
    pub device_depth_limit_m: f64,
    /// The normal force up to which no place is as deep, N; NaN with a coupled law.
    pub device_force_limit_n: f64,
    /// The contact point's way by the tool's, at most; NaN where it was not asked for or is not bounded.
    pub device_contact_way_ratio: f64,
    /// 1 if the depth limit is all the depth that the responses know.
    pub device_whole_depth: u32,
    /// 0.
    pub reserved: u32,
}

sized!(palpate_loop_device, palpate_certify_options, palpate_certificate);

/// What is known, or guessed, of a device by its name, in a loop of `rate_hz`: "bench", "touch", "omni", "desktop", "omega", "delta",
/// "sigma", "lambda" or "falcon" (docs/closed-loop.md says what is guessed).
/// Fails with `PALPATE_STATUS_INVALID`: no such name, or no such rate. Not real-time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_loop_device_of(
    name: *const c_char,
    rate_hz: f64,
    device: *mut palpate_loop_device,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let (name, to) = (text(name, "the name")?, changed(device)?);
            if !(rate_hz > 0.0 && rate_hz.is_finite()) {
                return Err(Failure::invalid(format!("rate_hz is {rate_hz}; give a number above 0")));
            }
            let known = presets::device(name).ok_or_else(|| {
                let names = presets::DEVICES.join(", ");
                Failure::invalid(format!("there is no device {name:?}; give one of {names}"))
            })?;
            let found = Device::of(&known.mechanics, rate_hz);
            *to = palpate_loop_device {
                struct_size: to.struct_size,
                reserved: 0,
                damping_n_s_per_m: found.damping_n_s_per_m,
                rate_hz: found.rate_hz,
                position_error_m: found.position_error_m,
                coulomb_n: found.coulomb_n,
                delay_samples: found.delay_samples,
            };
            Ok(())
        })
    }
}

/// Proves that a body is passive and free of snaps, or shows where it is not: for every element, all depths and all directions of slip, by
/// bounds up to rounding (docs/passivity.md). With a device, down to where its sampled loop is passive. `options` may be null.
/// `progress` (may be null) hears of elements, and is given `user`.
/// Fails with `PALPATE_STATUS_INVALID` (a value) or `PALPATE_STATUS_CANCELLED` (`progress` said so).
/// Not real-time: seconds to hours, on threads of its own, which end with the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_body_certify(
    body: palpate_body,
    options: *const palpate_certify_options,
    progress: palpate_progress_function,
    user: *mut c_void,
    certificate: *mut palpate_certificate,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let to = changed(certificate)?;
            let (body, _) = open_body(body)?;
            let mut question = Question::of(&body);
            let mut threads = 0;
            if !options.is_null() {
                let options = given(options)?;
                threads = options.threads as usize;
                if options.slip_rule != 0 {
                    question.assumptions.slip = slip_rule(options.slip_rule)?;
                }
                question.evaluations = (options.evaluations > 0).then_some(options.evaluations);
                question.assumptions.step_m = options.step_m;
                question.assumptions.depth_m = (options.depth_m != 0.0).then_some(options.depth_m);
                if !options.device.is_null() {
                    let device = given(options.device)?;
                    question.device = Some(Device {
                        damping_n_s_per_m: device.damping_n_s_per_m,
                        rate_hz: device.rate_hz,
                        position_error_m: device.position_error_m,
                        coulomb_n: device.coulomb_n,
                        delay_samples: device.delay_samples,
                    });
                }
            }
            let cancelled = AtomicBool::new(false);
            let listener = Listener {
                told: progress,
                state: Mutex::new((user, 0)),
                elements: body.elements().len() as u64,
                cancelled: &cancelled,
            };
            let found =
                palpate::certify::certify_on(threads, &body, &question, &|| listener.done(), &cancelled)
                    .map_err(|e| Failure::new(PALPATE_STATUS_INVALID, files::message(&e)))?
                    .ok_or_else(|| Failure::from(PALPATE_STATUS_CANCELLED))?;
            *to = numbers(&found.certificate);
            Ok(())
        })
    }
}

/// The caller's function, how far it is, and whether it said that it ends.
struct Listener<'a> {
    told: palpate_progress_function,
    state: Mutex<(*mut c_void, u64)>,
    elements: u64,
    cancelled: &'a AtomicBool,
}

// SAFETY: the caller's pointer is not followed, and given to his function alone, under the lock.
unsafe impl Sync for Listener<'_> {}

impl Listener<'_> {
    fn done(&self) {
        let Some(told) = self.told else { return };
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.1 += 1;
        let progress = palpate_progress {
            struct_size: size_of::<palpate_progress>() as u32,
            reserved: 0,
            points_done: state.1,
            points: self.elements,
            message: std::ptr::null(),
        };
        // SAFETY: the caller's function with the caller's pointer; what it is shown lives until it returns.
        if !self.cancelled.load(Ordering::Relaxed) && unsafe { told(state.0, &progress) } != 0 {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }
}

fn numbers(found: &Certificate) -> palpate_certificate {
    let known = |x: Option<f64>| x.unwrap_or(f64::NAN);
    let element = |h: &Holds| h.worst.map_or(crate::PALPATE_NO_ELEMENT, |w| w.element);
    let place = |h: &Holds| h.worst.map_or([f64::NAN; 3], |w| w.contact_m);
    let (passive, snap_free, device) = (&found.passive, &found.snap_free, found.device.as_ref());
    palpate_certificate {
        struct_size: size_of::<palpate_certificate>() as u32,
        slip_rule: slip_number(found.slip),
        passive_holds: passive.holds.into(),
        snap_free_holds: snap_free.holds.into(),
        passive_margin: known(passive.margin),
        passive_found: known(passive.found),
        passive_proved_elements: passive.proved_elements as u64,
        passive_failing_elements: passive.failing_elements as u64,
        passive_undecided_elements: passive.undecided_elements as u64,
        passive_worst_element: element(passive),
        snap_free_worst_element: element(snap_free),
        passive_worst_m: place(passive),
        snap_free_margin_n_per_m: known(snap_free.margin),
        snap_free_found_n_per_m: known(snap_free.found),
        snap_free_proved_elements: snap_free.proved_elements as u64,
        snap_free_failing_elements: snap_free.failing_elements as u64,
        snap_free_undecided_elements: snap_free.undecided_elements as u64,
        snap_free_worst_m: place(snap_free),
        lipschitz_n_per_m: known(found.lipschitz_n_per_m),
        lipschitz_found_n_per_m: known(found.lipschitz_found_n_per_m),
        stiffness_max_n_per_m: found.stiffness_max_n_per_m.last().map_or(0.0, |k| k.value),
        depth_m: found.scope.depth_m,
        step_m: found.scope.step_m,
        lateral_m: known(found.scope.lateral_m),
        passive_from_m: found.scope.passive_from_m,
        elements: found.elements as u64,
        border_edges: found.border_edges as u64,
        creased_elements: found.creased_elements as u64,
        too_far_elements: found.too_far_elements as u64,
        device_stiffness_limit_n_per_m: known(device.and_then(|d| d.stiffness_limit_n_per_m)),
        device_depth_limit_m: known(device.and_then(|d| d.depth_limit_m)),
        device_force_limit_n: known(device.and_then(|d| d.force_limit_n)),
        device_contact_way_ratio: known(device.and_then(|d| d.contact_way_ratio)),
        device_whole_depth: device.is_some_and(|d| d.whole_depth).into(),
        reserved: 0,
    }
}
