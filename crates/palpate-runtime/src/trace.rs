//! What a rollout adds up to, and its rows as a Trace CSV.

use anyhow::Result;
use glam::DVec3;
use palpate_body::ContactModel;
use palpate_engine::{Ablation, Contact, Counters, Flags, Ledger, Output, Waypoint};
use serde::Serialize;
use std::io::Write;

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
    write!(
        out,
        "{},{},{element},",
        u8::from(flags.has(Flags::IN_CONTACT)),
        u8::from(flags.has(Flags::SLIPPING))
    )?;
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
pub struct TraceSummary {
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
    /// Rows in which the contact point ran away, or has no stable place to be (docs/model.md).
    pub snap_steps: u64,
    /// Rows deeper or farther laterally than the curves' last knots.
    pub extrapolated_steps: u64,
    /// When the first snap was, s.
    #[serde(skip)]
    first_snap_s: f64,
    /// Rows inside from the path's beginning on, rather than since a contact ended at the border.
    #[serde(skip)]
    began_inside: u64,
    /// The row above.
    #[serde(skip)]
    before: Option<(Waypoint, Output)>,
}

/// [`Ledger`], as JSON.
#[derive(Debug, Clone, Default, Serialize)]
#[expect(missing_docs, reason = "the names are the ledger's, which documents them")]
pub struct Energies {
    pub work_j: f64,
    pub stored_j: f64,
    pub dissipated_j: f64,
    pub generated_j: f64,
    pub tank_j: f64,
    pub relaxed_j: f64,
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
    pub queries: u64,
    pub blocked: u64,
    pub fenced: u64,
    pub capped: u64,
    pub held_back: u64,
    pub invalid_poses: u64,
    pub invalid_times: u64,
    pub other_bodies: u64,
    pub contained: u64,
    pub without_gradients: u64,
}

/// How many rows had each of the engine's [`Flags`]; as JSON by their names.
#[derive(Debug, Clone, Default)]
pub struct FlagCounts([u64; Flags::NAMED.len()]);

impl FlagCounts {
    /// Rows with `flag`, a single one.
    pub fn of(&self, flag: Flags) -> u64 {
        self.0.get(flag.bits().trailing_zeros() as usize).copied().unwrap_or(0)
    }

    fn add(&mut self, flags: Flags) {
        for (count, (_, flag)) in self.0.iter_mut().zip(Flags::NAMED) {
            *count += u64::from(flags.has(flag));
        }
    }
}

impl Serialize for FlagCounts {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(Flags::NAMED.into_iter().zip(self.0).map(|((name, _), n)| (name, n)))
    }
}

impl TraceSummary {
    /// Counts one output of `contact`, which is as it was left by it.
    pub fn add(&mut self, body: &ContactModel, contact: &Contact, waypoint: &Waypoint, output: &Output) {
        self.steps += 1;
        self.largest_force_n = self.largest_force_n.max(DVec3::from_array(output.force_n).length());
        if let Some((_, before)) = &self.before {
            self.largest_step_n = self.largest_step_n.max(distance(output.force_n, before.force_n));
        }
        if let Some(c) = &output.contact {
            let [depth, lateral] = reach(body);
            // Wider than rounding.
            self.extrapolated_steps += u64::from(c.delta_z_m > depth + 1e-9 || c.delta_r_m > lateral + 1e-9);
            let ran_away = self.before.as_ref().is_some_and(|(from, before)| {
                let allowed = 10.0 * distance(waypoint.pose.position_m, from.pose.position_m) + 1e-4;
                before.contact.is_some_and(|b| distance(c.position_m, b.position_m) > allowed)
            });
            if ran_away || contact.lipschitz_n_per_m(body).is_none() {
                if self.snap_steps == 0 {
                    self.first_snap_s = waypoint.time_s;
                }
                self.snap_steps += 1;
            }
        }
        // Contacts end at the border before a tool can be inside again without a beginning.
        self.began_inside +=
            u64::from(output.flags.has(Flags::STARTED_INSIDE) && self.flags.of(Flags::BORDER) == 0);
        self.before = Some((*waypoint, *output));
        self.flags.add(output.flags);
    }

    /// Takes over what the contact itself counted.
    pub fn finish(&mut self, contact: &Contact) {
        let Counters {
            steps,
            onsets,
            slips,
            evaluations,
            crossings,
            queries,
            blocked,
            fenced,
            capped,
            held_back,
            invalid_poses,
            invalid_times,
            other_bodies,
            contained,
            without_gradients,
        } = *contact.counters();
        let Ledger { work_j, stored_j, dissipated_j, generated_j, tank_j, relaxed_j } = contact.energy();
        self.contacts = onsets;
        self.energy = Energies { work_j, stored_j, dissipated_j, generated_j, tank_j, relaxed_j };
        self.counters = Counts {
            steps,
            onsets,
            slips,
            evaluations,
            crossings,
            queries,
            blocked,
            fenced,
            capped,
            held_back,
            invalid_poses,
            invalid_times,
            other_bodies,
            contained,
            without_gradients,
        };
    }

    /// What deserves to be said aloud of a path on `body`.
    pub fn warnings(&self, body: &ContactModel, path: &[Waypoint], ablation: Ablation) -> Vec<String> {
        let n = &self.flags;
        let said = [
            (self.began_inside, "began inside the body and felt no force until it had left"),
            (
                n.of(Flags::CAPPED),
                "ran into the bound of the slip search; the lateral force was cut to the friction limit",
            ),
            (
                n.of(Flags::HELD_BACK),
                "had slip held back, since it would have given out energy; it lets go later, and the force may jump",
            ),
            (
                n.of(Flags::PULLING),
                "had a normal force that pulls the tool in: far aside the law's f_z is below 0",
            ),
            (n.of(Flags::BLOCKED), "had the contact point held by an edge or vertex"),
            (
                n.of(Flags::REANCHORED),
                "took up contact anew at the nearest surface point after a release inside the body",
            ),
            (n.of(Flags::INVALID_POSE), "had a pose that can't be used"),
            (n.of(Flags::CONTAINED), "had a force that was not finite and became 0"),
        ];
        let mut warnings: Vec<String> = said
            .into_iter()
            .filter(|(n, _)| *n > 0)
            .map(|(n, what)| format!("{n} of {} steps {what}", self.steps))
            .collect();
        if n.of(Flags::BORDER) > 0 {
            let ended = count(n.of(Flags::BORDER), "contact");
            let without_force = match n.of(Flags::STARTED_INSIDE) - self.began_inside {
                0 => String::new(),
                steps => format!("; {} behind the surface after that had no force", count(steps, "step")),
            };
            warnings.push(format!("{ended} ended at the surface's border{without_force}"));
        }
        if self.snap_steps > 0 {
            let cause = match ablation {
                Ablation::Coordinates | Ablation::Both => "coordinates are not interpolated",
                _ => "a snap: depth near the surface's radius of curvature, see docs/model.md",
            };
            let steps = count(self.snap_steps, "step");
            warnings.push(format!(
                "{steps} in which the contact point ran away or could ({cause}), first at t = {} s",
                self.first_snap_s
            ));
        }
        if self.extrapolated_steps > 0 {
            let [depth, lateral] = reach(body).map(|m| (m * 1e6).round() / 1e3);
            warnings.push(format!(
                "{} beyond the curves' {depth} mm in depth or {lateral} mm laterally: forces extrapolated",
                count(self.extrapolated_steps, "step")
            ));
        }
        if self.contacts == 0 && n.of(Flags::STARTED_INSIDE) == 0 {
            let tips = path.iter().map(|w| DVec3::from_array(w.pose.position_m));
            let closest = tips.fold(f64::INFINITY, |closest, tip| {
                body.nearest(tip, closest).map_or(closest, |nearest| nearest.distance.min(closest))
            });
            warnings.push(format!(
                "nothing was touched: the tool came no closer than {:.3} mm; check the path's unit (m) and frame (the \
                 body's)",
                (closest - body.tool().radius_m()).max(0.0) * 1e3
            ));
        }
        warnings
    }
}

/// How deep and how far laterally the curves go, m.
fn reach(body: &ContactModel) -> [f64; 2] {
    let responses = body.responses();
    [responses.depth_knots(), responses.lateral_knots()]
        .map(|k| k.values().last().copied().unwrap_or_default())
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    DVec3::from_array(a).distance(DVec3::from_array(b))
}

/// `1 step`, `2 steps`.
pub fn count(n: u64, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Programs read these by their names.
    #[test]
    fn columns_and_counts_keep_their_names() {
        assert!(
            COLUMNS.starts_with("time_s,x_m,y_m,z_m,in_contact,slipping,element,cx_m,cy_m,cz_m,delta_z_m,")
        );
        assert!(COLUMNS.ends_with(",tx_nm,ty_nm,tz_nm,work_j,stored_j,dissipated_j,generated_j"));
        let mut counts = FlagCounts::default();
        counts.add(Flags::IN_CONTACT | Flags::PATCH_BOUNDARY);
        counts.add(Flags::PATCH_BOUNDARY);
        let json = serde_json::to_string(&counts).unwrap();
        let expected =
            r#"{"in_contact":1,"slipping":0,"onset":0,"released":0,"reanchored":0,"border":0,"blocked":0,"#;
        let rest = r#""capped":0,"invalid_pose":0,"contained":0,"started_inside":0,"fenced":2,"#;
        let newer = r#""invalid_time":0,"other_body":0,"held_back":0,"pulling":0}"#;
        assert_eq!(json, format!("{expected}{rest}{newer}"));
        let json = serde_json::to_string(&TraceSummary::default()).unwrap();
        for name in ["queries", "invalid_times", "other_bodies", "without_gradients", "tank_j", "relaxed_j"] {
            assert!(json.contains(&format!("\"{name}\":0")), "{name}: {json}");
        }
    }
}
