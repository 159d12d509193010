//! Contacts led along paths, without a clock: one, or many on all cores.

use crate::contact::{OpenContact, alone, palpate_ledger, palpate_output};
use crate::handles::{Alone, palpate_contact};
use crate::status::{
    Failure, PALPATE_STATUS_CLOSED, PALPATE_STATUS_WRONG_SIZE, array, given, guarded, palpate_error,
    palpate_status, room, sized,
};
use palpate::ToolState;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// A tool's path in the body's frame.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_path {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// How many poses.
    pub count: usize,
    /// Their times, s, never decreasing (count). The first pose has a time step of 0.
    pub times_s: *const f64,
    /// The tool's reference point, m (count x 3).
    pub positions_m: *const f64,
    /// Unit quaternions w x y z, body from tool (count x 4); null for the identity.
    pub orientations: *const f64,
}

/// Where a path's results go. Each array has room for the path's count, or is null.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_trace {
    /// Size of this struct, bytes.
    pub struct_size: u32,
    /// 0.
    pub reserved: u32,
    /// Force on the tool, N (count x 3).
    pub forces_n: *mut f64,
    /// Torque on the tool, N m (count x 3).
    pub torques_nm: *mut f64,
    /// What happened: sums of `PALPATE_FLAG_...` (count).
    pub flags: *mut u32,
    /// Energies after each step, with their sizes (count).
    pub energies: *mut palpate_ledger,
    /// All of it, with its size (count): for who wants more than the arrays above.
    pub outputs: *mut palpate_output,
}

sized!(palpate_path, palpate_trace);

/// A path and a trace whose arrays were looked at.
struct Ride<'a> {
    times_s: &'a [f64],
    positions_m: &'a [f64],
    orientations: &'a [f64],
    forces_n: &'a mut [f64],
    torques_nm: &'a mut [f64],
    flags: &'a mut [u32],
    energies: &'a mut [palpate_ledger],
    outputs: &'a mut [palpate_output],
}

impl<'a> Ride<'a> {
    unsafe fn new(path: &palpate_path, trace: &palpate_trace) -> Result<Self, palpate_status> {
        let n = path.count;
        let there = |is_null: bool| if is_null { 0 } else { n };
        let triple =
            |count: usize, width: usize| count.checked_mul(width).ok_or(crate::PALPATE_STATUS_INVALID);
        // SAFETY: the caller keeps the header's promises.
        unsafe {
            Ok(Ride {
                times_s: array(path.times_s, n)?,
                positions_m: array(path.positions_m, triple(n, 3)?)?,
                orientations: array(path.orientations, triple(there(path.orientations.is_null()), 4)?)?,
                forces_n: room(trace.forces_n, triple(there(trace.forces_n.is_null()), 3)?)?,
                torques_nm: room(trace.torques_nm, triple(there(trace.torques_nm.is_null()), 3)?)?,
                flags: room(trace.flags, there(trace.flags.is_null()))?,
                energies: room(trace.energies, there(trace.energies.is_null()))?,
                outputs: room(trace.outputs, there(trace.outputs.is_null()))?,
            })
        }
    }

    /// Leads the contact along all of it.
    fn run(&mut self, open: &mut OpenContact) {
        let OpenContact { contact, body } = open;
        let mut last_s = self.times_s.first().copied().unwrap_or_default();
        let poses = self.times_s.iter().zip(self.positions_m.as_chunks::<3>().0);
        let orientations = self.orientations.as_chunks::<4>().0;
        let forces = self.forces_n.as_chunks_mut::<3>().0;
        let torques = self.torques_nm.as_chunks_mut::<3>().0;
        for (k, (&time_s, &position_m)) in poses.enumerate() {
            let mut tool = ToolState::at(position_m);
            orientations.get(k).into_iter().for_each(|q| tool.orientation = *q);
            let output = contact.step(body, &tool, time_s - last_s);
            last_s = time_s;
            forces.get_mut(k).into_iter().for_each(|to| *to = output.force_n);
            torques.get_mut(k).into_iter().for_each(|to| *to = output.torque_nm);
            self.flags.get_mut(k).into_iter().for_each(|to| *to = output.flags.bits());
            self.energies.get_mut(k).into_iter().for_each(|to| *to = (&output.energy).into());
            self.outputs.get_mut(k).into_iter().for_each(|to| *to = (&output).into());
        }
    }
}

/// Leads a contact along a path, from the state that it is in, and writes what it answers at each pose: the same bits as
/// `palpate_contact_step` pose by pose. The sizes of `energies` and `outputs` need not be set beforehand.
/// Not real-time: as long as the path; it allocates nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_rollout(
    contact: palpate_contact,
    path: *const palpate_path,
    trace: *const palpate_trace,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let mut ride = Ride::new(given(path)?, given(trace)?)?;
            ride.run(&mut *alone(contact)?);
            Ok(())
        })
    }
}

/// Leads `count` contacts along a path each, on up to `threads` threads (0: one for each core): the same bits as one after the other.
/// `contacts`, `paths` and `traces` are arrays of `count`; no two contacts are the same, and no two traces share an array. Before anything
/// runs all contacts are entered: `PALPATE_STATUS_BUSY` if one is in use, or named twice.
/// Not real-time: starts threads, and returns when all have ended.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_rollout_many(
    contacts: *const palpate_contact,
    paths: *const palpate_path,
    traces: *const palpate_trace,
    count: usize,
    threads: usize,
    error: *mut palpate_error,
) -> palpate_status {
    // SAFETY: the caller keeps the header's promises.
    unsafe {
        guarded(error, || {
            let contacts = array(contacts, count)?;
            let (paths, traces) = (array(paths, count)?, array(traces, count)?);
            let mut rides = Vec::with_capacity(count);
            for (k, &contact) in contacts.iter().enumerate() {
                if paths[k].struct_size as usize != size_of::<palpate_path>()
                    || traces[k].struct_size as usize != size_of::<palpate_trace>()
                {
                    return Err(Failure::new(
                        PALPATE_STATUS_WRONG_SIZE,
                        format!(
                            "path or trace {k}: struct_size is not this version's; begin with the INIT macro"
                        ),
                    ));
                }
                let named = |status: palpate_status| match status {
                    PALPATE_STATUS_CLOSED => {
                        Failure::new(status, format!("contact {k} is not open; make it before the rollout"))
                    }
                    other => other.into(),
                };
                let open = alone(contact).map_err(named)?;
                rides.push(Mutex::new((Ride::new(&paths[k], &traces[k])?, open)));
            }
            run_all(&rides, threads);
            Ok(())
        })
    }
}

/// All of them, each by the thread that is free next.
fn run_all(rides: &[Mutex<(Ride<'_>, Alone<'static, OpenContact>)>], threads: usize) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = if threads == 0 { cores } else { threads }.min(rides.len());
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(ride) = rides.get(next.fetch_add(1, Ordering::Relaxed)) {
            let (ride, open) = &mut *ride.lock().unwrap_or_else(PoisonError::into_inner);
            ride.run(open);
        }
    };
    std::thread::scope(|scope| {
        // Where the system gives no more threads, those that there are do all of it.
        let _ =
            (1..threads).try_for_each(|_| std::thread::Builder::new().spawn_scoped(scope, work).map(drop));
        work();
    });
}
