//! Deterministic rollout of a tool path: one output for each pose, no clock.

use crate::path::Waypoint;
use anyhow::Result;
use palpate_body::Body;
use palpate_engine::{Ablation, Contact, Counters, Ledger, Output, ToolPose};
use serde::Serialize;
use std::io::Write;

/// A contact that is led along poses: an iterator over its outputs.
#[derive(Debug)]
pub struct Rollout<'b, I> {
    body: &'b Body,
    contact: Contact,
    poses: I,
}

/// Leads a new contact on `body` along `poses`.
pub fn rollout<I>(body: &Body, poses: I, ablation: Ablation) -> Rollout<'_, I::IntoIter>
where
    I: IntoIterator<Item = ToolPose>,
{
    Rollout { body, contact: Contact::with_ablation(body, ablation), poses: poses.into_iter() }
}

impl<I> Rollout<'_, I> {
    /// The contact as it is now.
    pub fn contact(&self) -> &Contact {
        &self.contact
    }
}

impl<I: Iterator<Item = ToolPose>> Iterator for Rollout<'_, I> {
    type Item = Output;

    fn next(&mut self) -> Option<Output> {
        Some(self.contact.step(self.body, &self.poses.next()?))
    }
}

/// Columns of a Trace CSV. Without contact `element` is −1 and the contact's columns are 0; forces and torques are
/// those on the tool; energies are sums since the first row.
pub const COLUMNS: &str = "time_s,x_m,y_m,z_m,in_contact,slipping,element,cx_m,cy_m,cz_m,delta_z_m,delta_r_m,\
                           fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm,work_j,stored_j,dissipated_j,generated_j";

/// Writes one row. Every number reads back to the same bits.
///
/// # Errors
/// `out` can't be written.
pub fn write_row(out: &mut dyn Write, waypoint: &Waypoint, output: &Output) -> Result<()> {
    let Output { force_n: f, torque_nm: t, contact, flags, energy } = output;
    let (element, c, depth, lateral) = contact
        .map_or((-1, [0.0; 3], 0.0, 0.0), |c| (i64::from(c.element), c.position_m, c.delta_z_m, c.delta_r_m));
    let [x, y, z] = waypoint.pose.position_m;
    write!(out, "{:?},{x:?},{y:?},{z:?},", waypoint.time_s)?;
    write!(out, "{},{},{element},", u8::from(flags.in_contact), u8::from(flags.slipping))?;
    write!(out, "{:?},{:?},{:?},{depth:?},{lateral:?},", c[0], c[1], c[2])?;
    write!(out, "{:?},{:?},{:?},{:?},{:?},{:?},", f[0], f[1], f[2], t[0], t[1], t[2])?;
    writeln!(
        out,
        "{:?},{:?},{:?},{:?}",
        energy.work_j, energy.stored_j, energy.dissipated_j, energy.generated_j
    )?;
    Ok(())
}

/// What a trace adds up to.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Summary {
    /// Rows.
    pub steps: u64,
    /// Contacts begun.
    pub contacts: u64,
    /// N.
    pub largest_force_n: f64,
    /// Largest change of the force from one row to the next, N.
    pub largest_step_n: f64,
    /// At the end.
    pub energy: Energies,
    /// Over all rows.
    pub counters: Counts,
    /// Rows with each flag.
    pub flags: FlagCounts,
}

/// [`Ledger`], as JSON.
#[derive(Debug, Clone, Default, Serialize)]
#[expect(missing_docs, reason = "the names are the ledger's, which documents them")]
pub struct Energies {
    pub work_j: f64,
    pub stored_j: f64,
    pub dissipated_j: f64,
    pub generated_j: f64,
}

/// [`Counters`], as JSON.
#[derive(Debug, Clone, Default, Serialize)]
#[expect(missing_docs, reason = "the names are the counters', which documents them")]
pub struct Counts {
    pub steps: u64,
    pub onsets: u64,
    pub slips: u64,
    pub evaluations: u64,
    pub crossings: u64,
    pub blocked: u64,
    pub capped: u64,
    pub invalid_poses: u64,
    pub contained: u64,
}

/// How many rows had each of the [`palpate_engine::Flags`].
#[derive(Debug, Clone, Default, Serialize)]
#[expect(missing_docs, reason = "the names are the flags', which documents them")]
pub struct FlagCounts {
    pub in_contact: u64,
    pub slipping: u64,
    pub onset: u64,
    pub released: u64,
    pub reanchored: u64,
    pub border: u64,
    pub blocked: u64,
    pub capped: u64,
    pub invalid_pose: u64,
    pub contained: u64,
    pub started_inside: u64,
}

impl Summary {
    /// Counts one output; `before` is the force of the row above.
    pub fn add(&mut self, output: &Output, before: Option<[f64; 3]>) {
        let length = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        let force = output.force_n;
        self.steps += 1;
        self.largest_force_n = self.largest_force_n.max(length(force));
        if let Some(before) = before {
            let step = [force[0] - before[0], force[1] - before[1], force[2] - before[2]];
            self.largest_step_n = self.largest_step_n.max(length(step));
        }
        let (f, n) = (&output.flags, &mut self.flags);
        for (flag, count) in [
            (f.in_contact, &mut n.in_contact),
            (f.slipping, &mut n.slipping),
            (f.onset, &mut n.onset),
            (f.released, &mut n.released),
            (f.reanchored, &mut n.reanchored),
            (f.border, &mut n.border),
            (f.blocked, &mut n.blocked),
            (f.capped, &mut n.capped),
            (f.invalid_pose, &mut n.invalid_pose),
            (f.contained, &mut n.contained),
            (f.started_inside, &mut n.started_inside),
        ] {
            *count += u64::from(flag);
        }
    }

    /// Takes over what the contact itself counted.
    pub fn finish(&mut self, contact: &Contact) {
        let Counters {
            steps,
            onsets,
            slips,
            evaluations,
            crossings,
            blocked,
            capped,
            invalid_poses,
            contained,
        } = *contact.counters();
        let Ledger { work_j, stored_j, dissipated_j, generated_j } = *contact.energy();
        self.contacts = onsets;
        self.energy = Energies { work_j, stored_j, dissipated_j, generated_j };
        self.counters = Counts {
            steps,
            onsets,
            slips,
            evaluations,
            crossings,
            blocked,
            capped,
            invalid_poses,
            contained,
        };
    }

    /// What deserves to be said aloud.
    pub fn warnings(&self) -> Vec<String> {
        let n = &self.flags;
        let said = [
            (n.started_inside, "began inside the body and felt no force until it had left"),
            (
                n.capped,
                "ran into the bound of the slip search; the lateral force was cut to the friction limit",
            ),
            (n.blocked, "had the contact point held by an edge or vertex"),
            (n.border, "ended a contact at the surface's border"),
            (
                n.reanchored,
                "took up contact anew at the nearest surface point after a release inside the body",
            ),
            (n.invalid_pose, "had a pose that can't be used"),
            (n.contained, "had a force that was not finite and became 0"),
        ];
        said.into_iter()
            .filter(|(n, _)| *n > 0)
            .map(|(n, what)| format!("{n} of {} steps {what}", self.steps))
            .collect()
    }
}
