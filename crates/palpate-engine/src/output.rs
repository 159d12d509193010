//! What goes into a step and what comes out: plain data.

use glam::DVec3;

/// Coordinates beyond this (m) are treated as a device's fault, like a non-finite one.
const FARTHEST: f64 = 1e4;

/// A pose of the tool's reference point in the body's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolPose {
    /// The tip; for a spherical tool its centre, m.
    pub position_m: [f64; 3],
    /// Unit quaternion (w, x, y, z), body from tool. Responses do not depend on it yet.
    pub orientation: [f64; 4],
}

impl ToolPose {
    /// A pose without rotation.
    pub fn at(position_m: [f64; 3]) -> Self {
        ToolPose { position_m, orientation: [1.0, 0.0, 0.0, 0.0] }
    }

    /// The position, if every number of the pose can be used: the step's input choke point.
    pub(crate) fn accept(&self) -> Option<DVec3> {
        let finite = self.position_m.iter().all(|x| x.abs() <= FARTHEST)
            && self.orientation.iter().all(|q| q.is_finite());
        finite.then_some(DVec3::from_array(self.position_m))
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

/// What happened in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Flags {
    /// The tool touches the body after this step.
    pub in_contact: bool,
    /// The contact point moved over the surface.
    pub slipping: bool,
    /// A contact began in this step.
    pub onset: bool,
    /// A contact ended in this step.
    pub released: bool,
    /// The tip was still inside after a release, and touches at its nearest surface point.
    pub reanchored: bool,
    /// The contact ended because the contact point reached the surface's border.
    pub border: bool,
    /// The contact point is held by an edge or vertex that it can't leave: f_r may exceed the limit.
    pub blocked: bool,
    /// The contact point waits at the edge of a patch ([`palpate_body::Patch`]) that its body goes on beyond, or has not
    /// caught up since: what the slip rule bounds was cut to the limit.
    pub fenced: bool,
    /// The step's budget was spent before the contact point had come to rest: what the slip rule bounds was cut to the limit.
    pub capped: bool,
    /// Slip waited, wholly or in part, since it would have given out more energy than the tank held: f_r may exceed the limit.
    pub held_back: bool,
    /// The pose held a number that is not finite or beyond 10⁴ m: no force, and the contact is kept as it was.
    pub invalid_pose: bool,
    /// The force was not finite and was replaced by zero.
    pub contained: bool,
    /// The tool is inside the body (or nearer than its radius) without having come through the surface: the first pose
    /// lay there, or it came under an open sheet around its border. No force until it has left.
    pub started_inside: bool,
}

/// Energies since the contact was made, J: work = stored + dissipated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ledger {
    /// Work of the tool on the body: Σ W(c_k, x_k+1) − W(c_k, x_k), the stick force along its way, exactly.
    pub work_j: f64,
    /// W(c, δ) now.
    pub stored_j: f64,
    /// What slip and release took out of W at a fixed tip: Σ W(c_k, x_k+1) − W(c_k+1, x_k+1), signed.
    pub dissipated_j: f64,
    /// The part of it where W rose, as a positive sum: energy that the slip rule generated.
    pub generated_j: f64,
    /// The tank: what slips have dissipated and later ones may give out again, at most [`TANK`] times what is stored. Below
    /// zero after a step that gave out more, as a re-anchoring may.
    pub tank_j: f64,
}

/// The most that the tank holds, in parts of the stored energy: enough for the ripple of coarse facets (a 24-sided cylinder
/// pressed in by a quarter of its radius raises W by a tenth from a facet's middle to its edge), too little for a burst. It is
/// empty whenever a contact begins.
pub const TANK: f64 = 0.25;

impl Ledger {
    /// The tool moves, c stays.
    pub(crate) fn stick(&mut self, stored_j: f64) {
        self.work_j += stored_j - self.stored_j;
        self.stored_j = stored_j;
    }

    /// c moves, or goes, and the tool stays.
    pub(crate) fn slip(&mut self, stored_j: f64) {
        self.dissipated_j += self.stored_j - stored_j;
        self.generated_j += (stored_j - self.stored_j).max(0.0);
        self.tank_j = (self.tank_j + (self.stored_j - stored_j)).min(TANK * stored_j.max(0.0));
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
    /// crossings at most 512 a step.
    pub evaluations: u64,
    /// Edges crossed, and elements looked at around a vertex or across an edge for a start direction.
    pub crossings: u64,
    /// Searches of the surface for a first touch, a clearance or a nearest point; in free space most steps need none.
    pub queries: u64,
    /// Steps in which an edge or vertex held the contact point.
    pub blocked: u64,
    /// Steps in which the contact point waited at the edge of a patch, or had not caught up since.
    pub fenced: u64,
    /// Steps that spent their budget.
    pub capped: u64,
    /// Steps in which slip waited for the tank.
    pub held_back: u64,
    /// Poses refused.
    pub invalid_poses: u64,
    /// Forces replaced by zero.
    pub contained: u64,
    /// Steps in contact in which the rule `consistent` found no gradients in the body and slipped as `paper` does: the
    /// body is not the one that the contact was made for.
    pub underived: u64,
}

impl Counters {
    /// A step that ended with these flags.
    #[inline]
    pub(crate) fn count(&mut self, flags: &Flags) {
        for (count, happened) in [
            (&mut self.onsets, flags.onset),
            (&mut self.slips, flags.slipping),
            (&mut self.blocked, flags.blocked),
            (&mut self.fenced, flags.fenced),
            (&mut self.capped, flags.capped),
            (&mut self.held_back, flags.held_back),
            (&mut self.invalid_poses, flags.invalid_pose),
            (&mut self.contained, flags.contained),
        ] {
            *count += u64::from(happened);
        }
    }
}

/// One sample of what a device renders.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Output {
    /// Force on the tool, −f_c, N.
    pub force_n: [f64; 3],
    /// Torque on the tool about its tip, N·m: zero for the tools there are so far.
    pub torque_nm: [f64; 3],
    /// Where the body is touched, if it is.
    pub contact: Option<ContactPoint>,
    /// What happened.
    pub flags: Flags,
    /// Energies.
    pub energy: Ledger,
}
