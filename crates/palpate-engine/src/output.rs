//! A step's input and output: plain data.

use crate::flags::Flags;
use crate::point_contact::Effort;
use glam::DVec3;

/// Coordinates beyond this (m) are treated as a device's fault, like a non-finite one.
const FARTHEST: f64 = 1e4;

/// How far from 1 the length of an orientation's quaternion may be.
const NEARLY_UNIT: f64 = 1e-3;

/// Where the tool is, in the body's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolState {
    /// The tool's reference point: the tip; for a spherical tool its centre, m.
    pub position_m: [f64; 3],
    /// Unit quaternion (w, x, y, z), body from tool. Responses do not depend on it yet.
    pub orientation: [f64; 4],
}

impl ToolState {
    /// Without rotation.
    pub fn at(position_m: [f64; 3]) -> Self {
        ToolState { position_m, orientation: [1.0, 0.0, 0.0, 0.0] }
    }

    /// The position, if all of the state can be used: the step's input check.
    pub(crate) fn accept(&self) -> Option<DVec3> {
        let [w, x, y, z] = self.orientation;
        let square = w * w + x * x + y * y + z * z;
        // False of a NaN too.
        let usable =
            self.position_m.iter().all(|x| x.abs() <= FARTHEST) && (square - 1.0).abs() <= 2.0 * NEARLY_UNIT;
        usable.then_some(DVec3::from_array(self.position_m))
    }
}

/// Where the body is touched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    /// Element of the surface.
    pub element: u32,
    /// Area coordinates (3).
    pub n: [f64; 3],
    /// c at rest, m.
    pub position_m: [f64; 3],
    /// Normal deflection δz, m.
    pub delta_z_m: f64,
    /// Lateral deflection δr, m.
    pub delta_r_m: f64,
}

/// Energies since the contact was made, J: work = stored + dissipated + relaxed.
///
/// W changes in three ways, and each has its total: the tool moves while all else is held, the contact point moves (or goes),
/// and what the body remembers relaxes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ledger {
    /// Work of the tool on the body: Σ W(c_k, x_k+1) − W(c_k, x_k), the stick force along its way, exactly.
    pub work_j: f64,
    /// W(c, δ) now.
    pub stored_j: f64,
    /// What slip and release took out of W at a fixed tool position: Σ W(c_k, x_k+1) − W(c_k+1, x_k+1), signed.
    pub dissipated_j: f64,
    /// The part of it where W rose, as a positive sum: energy that the slip rule generated.
    pub generated_j: f64,
    /// The tank: what slips have dissipated and later ones may give out again, at most a quarter of what is stored. Below
    /// zero after a step that gave out more, as a re-anchoring may.
    pub tank_j: f64,
    /// What internal variables took out of W at a fixed tool position and contact point; 0 as long as no response has any.
    pub relaxed_j: f64,
}

/// The most that the tank holds, in parts of the stored energy: enough for the ripple of coarse facets (a 24-sided cylinder
/// pressed in by a quarter of its radius raises W by a tenth from a facet's middle to its edge), too little for a burst. It is
/// empty whenever a contact begins.
pub const TANK: f64 = 0.25;

impl Ledger {
    /// The most that the tank can hold now, J: a quarter of what is stored.
    pub fn tank_limit_j(&self) -> f64 {
        TANK * self.stored_j.max(0.0)
    }

    /// Of two contact points side by side, half of the force each.
    pub(crate) fn mean(&self, other: &Ledger) -> Ledger {
        let mean = |one: f64, other: f64| 0.5 * (one + other);
        Ledger {
            work_j: mean(self.work_j, other.work_j),
            stored_j: mean(self.stored_j, other.stored_j),
            dissipated_j: mean(self.dissipated_j, other.dissipated_j),
            generated_j: mean(self.generated_j, other.generated_j),
            tank_j: mean(self.tank_j, other.tank_j),
            relaxed_j: mean(self.relaxed_j, other.relaxed_j),
        }
    }

    /// The tool moves, c stays.
    pub(crate) fn stick(&mut self, stored_j: f64) {
        self.work_j += stored_j - self.stored_j;
        self.stored_j = stored_j;
    }

    /// c moves, or goes, and the tool stays.
    pub(crate) fn slip(&mut self, stored_j: f64) {
        self.dissipated_j += self.stored_j - stored_j;
        self.generated_j += (stored_j - self.stored_j).max(0.0);
        self.tank_j += self.stored_j - stored_j;
        self.stored_j = stored_j;
        self.tank_j = self.tank_j.min(self.tank_limit_j());
    }

    /// Internal variables move, c and the tool stay.
    #[allow(dead_code, reason = "no response has internal variables yet")]
    pub(crate) fn relax(&mut self, stored_j: f64) {
        self.relaxed_j += self.stored_j - stored_j;
        self.stored_j = stored_j;
    }
}

/// How often things happened since the contact was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Steps taken.
    pub steps: u64,
    /// Contacts begun.
    pub onsets: u64,
    /// Steps with slip.
    pub slips: u64,
    /// Evaluations of the force law, derivatives too, beyond the one with which every step in contact begins. With the
    /// crossings at most 512 a step and contact point.
    pub evaluations: u64,
    /// Edges crossed, and elements looked at around a vertex or across an edge for a start direction.
    pub crossings: u64,
    /// Searches of the surface for a first touch, a clearance or a nearest point; in free space most steps need none.
    pub queries: u64,
    /// Steps in which an edge or vertex held the contact point.
    pub blocked: u64,
    /// Steps in which the contact point waited at a patch's boundary, or had not caught up since.
    pub fenced: u64,
    /// Steps that spent their budget.
    pub capped: u64,
    /// Steps in which slip waited for the tank.
    pub held_back: u64,
    /// Tool states refused.
    pub invalid_poses: u64,
    /// Time steps that counted as 0.
    pub invalid_times: u64,
    /// Steps that were given another body than the contact's.
    pub other_bodies: u64,
    /// Forces replaced by zero.
    pub contained: u64,
    /// Steps in contact in which the rule `consistent` found no gradients in the body and slipped as `paper` does: the
    /// body is not the one that the contact was made for.
    pub without_gradients: u64,
}

impl Counters {
    /// A step that ended with these flags.
    #[inline(always)]
    pub(crate) fn count(&mut self, flags: Flags) {
        self.slips += u64::from(flags.has(Flags::SLIPPING));
        if flags.has(RARE) {
            self.count_rare(flags);
        }
    }

    /// What a step took.
    #[inline(always)]
    pub(crate) fn take(&mut self, effort: Effort) {
        let Effort { evaluations, crossings, queries } = effort;
        // Nothing in a step that sticks.
        if evaluations | crossings | queries != 0 {
            self.evaluations += u64::from(evaluations);
            self.crossings += u64::from(crossings);
            self.queries += u64::from(queries);
        }
    }

    #[cold]
    #[inline(never)]
    fn count_rare(&mut self, flags: Flags) {
        for (count, flag) in [
            (&mut self.onsets, Flags::ONSET),
            (&mut self.blocked, Flags::BLOCKED),
            (&mut self.fenced, Flags::PATCH_BOUNDARY),
            (&mut self.capped, Flags::CAPPED),
            (&mut self.held_back, Flags::HELD_BACK),
            (&mut self.invalid_poses, Flags::INVALID_POSE),
            (&mut self.invalid_times, Flags::INVALID_TIME),
            (&mut self.other_bodies, Flags::OTHER_BODY),
            (&mut self.contained, Flags::CONTAINED),
        ] {
            *count += u64::from(flags.has(flag));
        }
    }
}

/// What a step that only sticks or slides does not have.
const RARE: Flags = Flags::all_but(Flags::IN_CONTACT, Flags::SLIPPING);

/// One sample of what a device renders.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Output {
    /// Force on the tool, −f_c, N.
    pub force_n: [f64; 3],
    /// Torque on the tool about its position, N·m: zero for the tools there are so far.
    pub torque_nm: [f64; 3],
    /// Where the body is touched, if it is.
    pub contact: Option<ContactPoint>,
    /// What happened.
    pub flags: Flags,
    /// Energies.
    pub energy: Ledger,
}

impl Output {
    /// Of two contact points side by side, half of the force each; the contact is told by the first. `touched` says which
    /// of them were in touch before the step.
    #[inline]
    pub(crate) fn mean(&self, other: &Output, touched: [bool; 2]) -> Output {
        let mean = |one: [f64; 3], other: [f64; 3]| {
            ((DVec3::from_array(one) + DVec3::from_array(other)) * 0.5).to_array()
        };
        let mut flags = self.flags | other.flags;
        // The contact as a whole begins with the first touch, and ends with the last.
        if touched != [false; 2] {
            flags.unset(Flags::ONSET);
        }
        if flags.has(Flags::RELEASED) {
            let [one, second] = touched;
            let held =
                (one && !self.flags.has(Flags::RELEASED)) || (second && !other.flags.has(Flags::RELEASED));
            if held {
                flags.unset(Flags::RELEASED);
            }
            // One ended, and the other one began.
            flags.set(Flags::REANCHORED, !held && flags.has(Flags::IN_CONTACT));
        }
        Output {
            force_n: mean(self.force_n, other.force_n),
            torque_nm: mean(self.torque_nm, other.torque_nm),
            contact: self.contact.or(other.contact),
            flags,
            energy: self.energy.mean(&other.energy),
        }
    }
}
