//! Contacts: the step, snapshots, ledger, counters.

use crate::PALPATE_ABI_VERSION;
use crate::body::{open_body, slip_rule};
use crate::handles::{Alone, Table, palpate_body, palpate_contact};
use crate::status::{
    Failure, PALPATE_STATUS_OTHER_BODY, PALPATE_STATUS_WRONG_VERSION, changed, given, guarded, palpate_error,
    palpate_status, place, quick, sized,
};
use palpate::engine::{Counters, Ledger};
use palpate::{Ablation, Body, Contact, Output, ToolState};
use std::sync::Arc;

/// The tool touches the body after this step.
pub const PALPATE_FLAG_IN_CONTACT: u32 = 1;
/// The contact point moved over the surface.
pub const PALPATE_FLAG_SLIPPING: u32 = 2;
/// A contact began in this step.
pub const PALPATE_FLAG_ONSET: u32 = 4;
/// A contact ended in this step.
pub const PALPATE_FLAG_RELEASED: u32 = 8;
/// After a contact that ended, the tool touches elsewhere in the same step.
pub const PALPATE_FLAG_REANCHORED: u32 = 16;
/// The contact ended because the contact point reached the surface's border.
pub const PALPATE_FLAG_BORDER: u32 = 32;
/// An edge or vertex holds the contact point: the lateral force may exceed the friction limit.
pub const PALPATE_FLAG_BLOCKED: u32 = 64;
/// The step's budget was spent before the contact point had come to rest: the force was cut to the limit.
pub const PALPATE_FLAG_CAPPED: u32 = 128;
/// The tool state can't be used (not finite, beyond 10^4 m, no rotation): no force, and the contact is kept as it was.
pub const PALPATE_FLAG_INVALID_POSE: u32 = 256;
/// The force was not finite and was replaced by zero.
pub const PALPATE_FLAG_CONTAINED: u32 = 512;
/// The tool is inside the body without having come through the surface: no force until it has left.
pub const PALPATE_FLAG_STARTED_INSIDE: u32 = 1024;
/// The contact point waits at the boundary of a session's patch of the body.
pub const PALPATE_FLAG_PATCH_BOUNDARY: u32 = 2048;
/// The time step was negative or not finite, and counted as 0.
pub const PALPATE_FLAG_INVALID_TIME: u32 = 4096;
/// The body is not the contact's; no call of this interface lets that happen.
pub const PALPATE_FLAG_OTHER_BODY: u32 = 8192;
/// Slip waited since it would have given out more energy than the tank held.
pub const PALPATE_FLAG_HELD_BACK: u32 = 16384;
/// The normal force pulls the tool in; only a coupled law does that.
pub const PALPATE_FLAG_PULLING: u32 = 32768;

/// `palpate_output.element`: there is no contact.
pub const PALPATE_NO_ELEMENT: u32 = 4294967295;

/// Where the tool is, in the body's frame. `PALPATE_TOOL_STATE_INIT` has the identity for an orientation.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_tool_state {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// The tool's reference point: the tip; for a spherical tool its centre, m.
    pub position_m: [f64; 3],
    /// Unit quaternion w x y z, body from tool. Responses do not depend on it yet.
    pub orientation: [f64; 4],
}

/// Energies since the contact was made, J: work = stored + dissipated + relaxed.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct palpate_ledger {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Work of the tool on the body, J.
    pub work_j: f64,
    /// Energy stored now, J.
    pub stored_j: f64,
    /// What slip and release took out of it, J, signed.
    pub dissipated_j: f64,
    /// The part of that by which the energy rose, as a positive sum: what slip generated, J.
    pub generated_j: f64,
    /// The tank: what slips have dissipated and later ones may give out again, J.
    pub tank_j: f64,
    /// What internal variables took out, J; 0 as long as no response has any.
    pub relaxed_j: f64,
}

/// One sample of what a device renders, in the body's frame. Of two contact points (partial slip) forces and energies are the mean,
/// and what is said of the contact point and its deflections is of the one that holds longer, or else of the one that touches.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_output {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// What happened: a sum of `PALPATE_FLAG_...`.
    pub flags: u32,
    /// Force on the tool, N.
    pub force_n: [f64; 3],
    /// Torque on the tool about its position, N m; zero for the tools there are so far.
    pub torque_nm: [f64; 3],
    /// Triangle that is touched; `PALPATE_NO_ELEMENT` without contact, and all below but the energies is 0 then.
    pub element: u32,
    /// 0.
    pub reserved: u32,
    /// Area coordinates of the contact point in it.
    pub area_coordinates: [f64; 3],
    /// The contact point at rest, m.
    pub contact_position_m: [f64; 3],
    /// Normal deflection: how deep the tool is, m.
    pub delta_z_m: f64,
    /// Lateral deflection, m.
    pub delta_r_m: f64,
    /// Energies.
    pub energy: palpate_ledger,
}

/// How often things happened since the contact was made.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_counters {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Steps taken.
    pub steps: u64,
    /// Contacts begun.
    pub onsets: u64,
    /// Steps with slip.
    pub slips: u64,
    /// Evaluations of the force law beyond the first of a step; with the crossings at most 512 a step and contact point, of which
    /// partial slip has two.
    pub evaluations: u64,
    /// Edges crossed.
    pub crossings: u64,
    /// Searches of the surface.
    pub queries: u64,
    /// Steps in which an edge or vertex held the contact point.
    pub blocked: u64,
    /// Steps at a patch's boundary.
    pub fenced: u64,
    /// Steps that spent their budget.
    pub capped: u64,
    /// Steps in which slip waited for the tank.
    pub held_back: u64,
    /// Tool states refused.
    pub invalid_poses: u64,
    /// Time steps that counted as 0.
    pub invalid_times: u64,
    /// Forces replaced by zero.
    pub contained: u64,
}

/// How a contact is to be. `PALPATE_CONTACT_OPTIONS_INIT` is what the body asks for.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_contact_options {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// `PALPATE_ABI_VERSION`.
    pub abi_version: u32,
    /// `PALPATE_SLIP_...`; 0 for the body's own.
    pub slip_rule: u32,
    /// 1 keeps slip from giving out energy, 2 lets it; 0 for what the body asks.
    pub tank: u32,
    /// Interpolations taken away, as in the paper's section 5: 1 coordinates, 2 responses, 3 both; 0 for none.
    pub ablation: u32,
    /// 0.
    pub reserved: u32,
    /// What multiplies the body's friction coefficients, 0 to 100.
    pub friction_scale: f64,
}

sized!(palpate_tool_state, palpate_ledger, palpate_output, palpate_counters, palpate_contact_options);

/// What is open as a contact: with the body that it is for, so that no step can be given another.
#[derive(Debug)]
pub(crate) struct OpenContact {
    pub contact: Contact,
    pub body: Arc<Body>,
}

static CONTACTS: Table<OpenContact> = Table::new(2);

/// A contact, for this thread alone.
#[inline]
pub(crate) fn alone(contact: palpate_contact) -> Result<Alone<'static, OpenContact>, palpate_status> {
    CONTACTS.alone(contact.id)
}

impl From<&Ledger> for palpate_ledger {
    #[inline]
    fn from(ledger: &Ledger) -> Self {
        palpate_ledger {
            struct_size: size_of::<palpate_ledger>() as u32,
            reserved: 0,
            work_j: ledger.work_j,
            stored_j: ledger.stored_j,
            dissipated_j: ledger.dissipated_j,
            generated_j: ledger.generated_j,
            tank_j: ledger.tank_j,
            relaxed_j: ledger.relaxed_j,
        }
    }
}

impl From<&Output> for palpate_output {
    #[inline]
    fn from(output: &Output) -> Self {
        let contact = output.contact.as_ref();
        palpate_output {
            struct_size: size_of::<palpate_output>() as u32,
            flags: output.flags.bits(),
            force_n: output.force_n,
            torque_nm: output.torque_nm,
            element: contact.map_or(PALPATE_NO_ELEMENT, |c| c.element),
            reserved: 0,
            area_coordinates: contact.map_or([0.0; 3], |c| c.n),
            contact_position_m: contact.map_or([0.0; 3], |c| c.position_m),
            delta_z_m: contact.map_or(0.0, |c| c.delta_z_m),
            delta_r_m: contact.map_or(0.0, |c| c.delta_r_m),
            energy: (&output.energy).into(),
        }
    }
}

fn friction_scale(scale: f64) -> Result<f64, Failure> {
    if (0.0..=100.0).contains(&scale) {
        return Ok(scale);
    }
    Err(Failure::invalid(format!("friction_scale is {scale}; give a number from 0 to 100")))
}

/// Makes a contact on `body`, as `options` say (null for what the body asks for), and writes a handle to `*contact`. It keeps the body
/// for as long as it is open. The first step's pose counts as where the tool comes from.
/// Not real-time: allocates, and prepares the body for its slip rule if that was not done before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_create(
    body: palpate_body,
    options: *const palpate_contact_options,
    contact: *mut palpate_contact,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let to = place(contact)?;
            let (body, _) = open_body(body)?;
            let made = if options.is_null() {
                Contact::new(&body)
            } else {
                let options = given(options)?;
                if options.abi_version != PALPATE_ABI_VERSION {
                    return Err(PALPATE_STATUS_WRONG_VERSION.into());
                }
                let rule = match options.slip_rule {
                    0 => body.slip(),
                    number => slip_rule(number)?,
                };
                let ablation = match options.ablation {
                    0 => Ablation::None,
                    1 => Ablation::Coordinates,
                    2 => Ablation::Responses,
                    3 => Ablation::Both,
                    other => return Err(Failure::invalid(format!("ablation is {other}; give 0 to 3"))),
                };
                let tank = match options.tank {
                    0 => body.has_tank(),
                    1 => true,
                    2 => false,
                    other => return Err(Failure::invalid(format!("tank is {other}; give 0, 1 or 2"))),
                };
                let scale = friction_scale(options.friction_scale)?;
                let mut made = Contact::with_slip(&body, rule, ablation).with_tank(tank);
                made.set_friction_scale(scale);
                made
            };
            to.id = CONTACTS.open(OpenContact { contact: made, body });
            Ok(())
        })
    }
}

/// One sample: where the tool is (body's frame, m) and how long after the last one (s, finite and not negative), and out comes the
/// wrench on it (N, N m). Write a size into `output` once; all else of it is written anew. What is wrong with a pose is no status
/// but a flag, and there is no force then.
/// Real-time: bounded; never waits, allocates, locks, logs, or reads a clock or a file. A contact that another thread is in gives
/// `PALPATE_STATUS_BUSY` at once, and `output` stays as it was.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_step(
    contact: palpate_contact,
    tool: *const palpate_tool_state,
    dt_s: f64,
    output: *mut palpate_output,
) -> palpate_status {
    quick(|| {
        // SAFETY: the caller keeps the header's promises.
        let (tool, to) = unsafe { (given(tool)?, changed(output)?) };
        let state = ToolState { position_m: tool.position_m, orientation: tool.orientation };
        let mut open = CONTACTS.alone(contact.id)?;
        let OpenContact { contact, body } = &mut *open;
        *to = (&contact.step(body, &state, dt_s)).into();
        Ok(())
    })
}

/// A snapshot: another contact of the same body, in the state that this one is in. It can be stepped on its own, and be restored
/// from. Close it as any contact. Not real-time: allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_snapshot(
    contact: palpate_contact,
    snapshot: *mut palpate_contact,
) -> palpate_status {
    quick(|| {
        // SAFETY: the caller keeps the header's promises.
        let to = unsafe { place(snapshot) }?;
        let copy = {
            let open = CONTACTS.alone(contact.id)?;
            OpenContact { contact: open.contact.clone(), body: open.body.clone() }
        };
        to.id = CONTACTS.open(copy);
        Ok(())
    })
}

/// Brings `contact` into the state that `snapshot` is in, ledger, counters and settings too; the other way round it takes a snapshot
/// into one that is there. `PALPATE_STATUS_OTHER_BODY` if they are of different bodies, and nothing is changed then.
/// Real-time: O(1), as `palpate_contact_step`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_contact_restore(
    contact: palpate_contact,
    snapshot: palpate_contact,
) -> palpate_status {
    quick(|| {
        let mut to = CONTACTS.alone(contact.id)?;
        if contact == snapshot {
            return Ok(());
        }
        let from = CONTACTS.alone(snapshot.id)?;
        if from.body.identity() != to.body.identity() {
            return Err(PALPATE_STATUS_OTHER_BODY);
        }
        to.contact.clone_from(&from.contact);
        Ok(())
    })
}

/// Forgets where the tool was: the next pose counts as the first one. What was stored is booked as dissipated.
/// Real-time: O(1), as `palpate_contact_step`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_contact_forget(contact: palpate_contact) -> palpate_status {
    quick(|| {
        CONTACTS.alone(contact.id)?.contact.forget();
        Ok(())
    })
}

/// Multiplies the body's friction coefficients, from the next step on: 0 to 100, else `PALPATE_STATUS_INVALID`.
/// Real-time: O(1), as `palpate_contact_step`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_contact_set_friction_scale(contact: palpate_contact, scale: f64) -> palpate_status {
    quick(|| {
        let mut open = CONTACTS.alone(contact.id)?;
        if !(0.0..=100.0).contains(&scale) {
            return Err(crate::PALPATE_STATUS_INVALID);
        }
        open.contact.set_friction_scale(scale);
        Ok(())
    })
}

/// Goes over to another slip rule, `PALPATE_SLIP_...`.
/// Not real-time the first time: it prepares the body for the rule, which allocates.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_contact_set_slip_rule(contact: palpate_contact, rule: u32) -> palpate_status {
    quick(|| {
        let rule = slip_rule(rule).map_err(|_| crate::PALPATE_STATUS_INVALID)?;
        let mut open = CONTACTS.alone(contact.id)?;
        open.body.prepare(rule);
        open.contact.set_slip_rule(rule);
        Ok(())
    })
}

/// Keeps slip from giving out more energy than it has dissipated (`tank` 1), or lets it (0).
/// Real-time: O(1), as `palpate_contact_step`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_contact_set_tank(contact: palpate_contact, tank: u32) -> palpate_status {
    quick(|| {
        let mut open = CONTACTS.alone(contact.id)?;
        open.contact = open.contact.clone().with_tank(tank != 0);
        Ok(())
    })
}

/// Two contact points side by side (`partial_slip` 1), as partial slip wants them, or one (0). Switch it in free space: in touch, of
/// two the one that holds longer stays, or else the one that touches, and force and ledger may step to its own.
/// Real-time: O(1), as `palpate_contact_step`.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_contact_set_partial_slip(
    contact: palpate_contact,
    partial_slip: u32,
) -> palpate_status {
    quick(|| {
        let mut open = CONTACTS.alone(contact.id)?;
        open.contact = open.contact.clone().with_partial_slip(partial_slip != 0);
        Ok(())
    })
}

/// Energies since the contact was made, J. Real-time: O(1), as `palpate_contact_step`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_ledger(
    contact: palpate_contact,
    ledger: *mut palpate_ledger,
) -> palpate_status {
    quick(|| {
        // SAFETY: the caller keeps the header's promises.
        let to = unsafe { changed(ledger) }?;
        *to = (&CONTACTS.alone(contact.id)?.contact.energy()).into();
        Ok(())
    })
}

/// How often things happened since the contact was made. Real-time: O(1), as `palpate_contact_step`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_counters(
    contact: palpate_contact,
    counters: *mut palpate_counters,
) -> palpate_status {
    quick(|| {
        // SAFETY: the caller keeps the header's promises.
        let to = unsafe { changed(counters) }?;
        let open = CONTACTS.alone(contact.id)?;
        let c: &Counters = open.contact.counters();
        *to = palpate_counters {
            struct_size: to.struct_size,
            reserved: 0,
            steps: c.steps,
            onsets: c.onsets,
            slips: c.slips,
            evaluations: c.evaluations,
            crossings: c.crossings,
            queries: c.queries,
            blocked: c.blocked,
            fenced: c.fenced,
            capped: c.capped,
            held_back: c.held_back,
            invalid_poses: c.invalid_poses,
            invalid_times: c.invalid_times,
            contained: c.contained,
        };
        Ok(())
    })
}

/// Closes a contact. `PALPATE_STATUS_BUSY` while another thread is in it, `PALPATE_STATUS_CLOSED` if it was closed before.
/// Not real-time: it may free memory.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_contact_close(contact: palpate_contact) -> palpate_status {
    quick(|| CONTACTS.close(contact.id).map(drop))
}
