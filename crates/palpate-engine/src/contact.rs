//! One contact: the step and its stages (MODEL 3).

use crate::coupled::Coupled;
use crate::decoupled::{Isotropic, Stretch};
use crate::drive::{Consistent, Exact, Paper, Rule};
use crate::field::{Ablation, Field, Law, Site};
use crate::lateral::Lateral;
use crate::output::{ContactPoint, Counters, Flags, Ledger, Output, ToolPose};
use crate::sensitivity;
use crate::slip::{self, End, Pace};
use glam::DVec3;
use palpate_body::{Body, ContactModel, Nearest, SlipRule, SurfacePoint};

/// Inside the surface by no more than this (m) counts as on it: a segment starting there still catches the surface.
const ON_SURFACE: f64 = 1e-9;

/// All that evolves while one tool touches one body: fixed in size, without a pointer to the body.
///
/// Every step must be given the body the contact was made for; with another, forces are meaningless but bounded. A contact
/// that slips by `consistent` on a body whose gradients nobody derived counts that ([`Counters::underived`]).
#[derive(Debug, Clone)]
pub struct Contact {
    law: Law,
    rule: SlipRule,
    state: State,
    pace: Pace,
    /// What the slip rule last took from f_t, N: a first guess of what it will take.
    taken: DVec3,
    energy: Ledger,
    counters: Counters,
}

/// Where the tool is.
#[derive(Debug, Clone, Copy)]
enum State {
    /// Before the first pose.
    Unknown,
    /// Outside at `tip`; at `asked_at` the surface was at least `clear` (m) away from touch, and `near` not far.
    Free { tip: DVec3, asked_at: DVec3, clear: f64, near: u32 },
    /// Inside without touching: it came there otherwise than through the surface.
    Inside { asked_at: DVec3, clear: f64 },
    /// Touching at `at` with the tool at `tip`.
    Touching { at: SurfacePoint, tip: DVec3 },
}

impl Contact {
    /// A contact on `body`, with the slip rule and the tool that the body names.
    ///
    /// Prepares the body for its rule, unless that was done before: see [`Body::prepare`].
    pub fn new(body: &Body) -> Self {
        Self::with_ablation(body, Ablation::None)
    }

    /// The same with interpolations taken away, as in the paper's section 5.
    pub fn with_ablation(body: &Body, ablation: Ablation) -> Self {
        Self::with_slip(body, body.slip(), ablation)
    }

    /// The same with another slip rule than the body's.
    pub fn with_slip(body: &Body, rule: SlipRule, ablation: Ablation) -> Self {
        body.prepare(rule);
        Self::on(body, rule, ablation)
    }

    /// A contact on a part of a body, such as a [`Patch`](palpate_body::Patch), which must be prepared for the slip rule.
    pub fn on(model: &ContactModel, rule: SlipRule, ablation: Ablation) -> Self {
        let law = Law { ablation, radius_m: model.tool().radius_m() };
        let (energy, counters) = (Ledger::default(), Counters::default());
        Contact {
            law,
            rule,
            state: State::Unknown,
            pace: Pace::default(),
            taken: DVec3::ZERO,
            energy,
            counters,
        }
    }

    /// The slip rule in force.
    pub fn slip_rule(&self) -> SlipRule {
        self.rule
    }

    /// How often things happened since the contact was made.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Energies since the contact was made.
    pub fn energy(&self) -> &Ledger {
        &self.energy
    }

    /// The surface point that the tool touches, if it does.
    pub fn touching(&self) -> Option<SurfacePoint> {
        match self.state {
            State::Touching { at, .. } => Some(at),
            _ => None,
        }
    }

    /// Where the tool was last seen, m: from there the next step looks for a touch. `None` before the first pose, and while
    /// the tool is inside without touching.
    pub fn last_tip_m(&self) -> Option<[f64; 3]> {
        match self.state {
            State::Touching { tip, .. } | State::Free { tip, .. } => Some(tip.to_array()),
            State::Inside { .. } | State::Unknown => None,
        }
    }

    /// Goes over to another copy of the same surface, such as another [`Patch`](palpate_body::Patch), in which the elements
    /// have the numbers that `renumber` gives. False, and nothing is changed, if the tool touches an element that has none.
    ///
    /// # Real-time
    /// As bounded as `renumber`.
    pub fn renumber(&mut self, renumber: impl Fn(u32) -> Option<u32>) -> bool {
        match &mut self.state {
            State::Touching { at, .. } => match renumber(at.element) {
                Some(element) => at.element = element,
                None => return false,
            },
            // What is free has to ask anew: the clearance was that of the other copy.
            State::Free { clear, near, .. } => (*clear, *near) = (0.0, renumber(*near).unwrap_or(0)),
            State::Inside { clear, .. } => *clear = 0.0,
            State::Unknown => {}
        }
        true
    }

    /// Forgets where the tool was: the next pose counts as the first one, and a tool that is then inside the body feels
    /// nothing until it has left it. What was stored is booked as dissipated.
    ///
    /// # Real-time
    /// O(1).
    pub fn forget(&mut self) {
        self.energy.slip(0.0);
        self.state = State::Unknown;
    }

    /// One sample: a tool pose in, the force on the tool out.
    ///
    /// # Real-time
    /// Bounded; never allocates, locks, logs, reads a clock or a file, or panics. In free space it costs a distance
    /// comparison until the tip has used up the clearance that the last query found.
    pub fn step(&mut self, body: &ContactModel, pose: &ToolPose) -> Output {
        if body.is_coupled() {
            return match self.rule {
                SlipRule::Consistent => self.step_as::<Coupled, Consistent>(body, pose),
                SlipRule::Exact => self.step_as::<Coupled, Exact>(body, pose),
                _ => self.step_as::<Coupled, Paper>(body, pose),
            };
        }
        match (self.rule, body.is_isotropic()) {
            (SlipRule::Consistent, true) => self.step_as::<Isotropic, Consistent>(body, pose),
            (SlipRule::Consistent, false) => self.step_as::<Stretch, Consistent>(body, pose),
            (SlipRule::Exact, true) => self.step_as::<Isotropic, Exact>(body, pose),
            (SlipRule::Exact, false) => self.step_as::<Stretch, Exact>(body, pose),
            (_, true) => self.step_as::<Isotropic, Paper>(body, pose),
            (_, false) => self.step_as::<Stretch, Paper>(body, pose),
        }
    }

    /// Apart from the choice between them, which is a jump.
    #[inline(never)]
    fn step_as<L: Lateral, R: Rule>(&mut self, body: &ContactModel, pose: &ToolPose) -> Output {
        self.counters.steps += 1;
        let mut flags = Flags::default();
        let Some(tip) = pose.accept() else {
            self.counters.invalid_poses += 1;
            flags.invalid_pose = true;
            flags.in_contact = matches!(self.state, State::Touching { .. });
            return Output { flags, energy: self.energy, ..Output::default() };
        };
        let before = self.energy;
        let Some(mut at) = self.touch::<L, R>(body, tip, &mut flags) else { return self.untouched(flags) };
        let mut site = Site::<L>::new(body, self.law, at.element);
        let mut field = self.stick(&mut site, at, tip);
        let end = self.slip::<L, R>(&mut site, &mut at, &mut field, tip, &mut flags);
        if field.depth > 0.0 && end != End::Border {
            return self.answer(at, tip, &field, end, flags);
        }
        if flags.onset && self.law.radius_m > 0.0 && end != End::Border {
            return self.hover(before, tip, at, flags);
        }
        match self.release::<L, R>(&mut site, at, &field, end, tip, &mut flags) {
            Some((at, field, end)) => self.answer(at, tip, &field, end, flags),
            None => self.untouched(flags),
        }
    }

    /// A sphere that the facets are within reach of but not the interpolated surface: nothing has happened yet.
    #[cold]
    fn hover(&mut self, before: Ledger, tip: DVec3, at: SurfacePoint, mut flags: Flags) -> Output {
        self.energy = before;
        self.counters.onsets = self.counters.onsets.saturating_sub(1);
        (flags.onset, flags.slipping) = (false, false);
        self.state = State::Free { tip, asked_at: tip, clear: 0.0, near: at.element };
        self.untouched(flags)
    }

    /// The Lipschitz bound of the force at the present contact, N/m: how far one step's |ΔF| may exceed nothing but
    /// |Δx| (MODEL 5, certificate L, at this one state). `None` in free space or where the slip equation has no
    /// stable root here, so that no bound exists.
    ///
    /// Not part of the step: a measuring instrument.
    pub fn lipschitz_n_per_m(&self, body: &ContactModel) -> Option<f64> {
        match self.state {
            State::Touching { at, tip } => sensitivity::lipschitz(body, self.law, self.rule, at, tip),
            _ => None,
        }
    }

    /// Stage 1: the contact point of the last step, or that of an onset in this one.
    fn touch<L: Lateral, R: Rule>(
        &mut self,
        body: &ContactModel,
        tip: DVec3,
        flags: &mut Flags,
    ) -> Option<SurfacePoint> {
        match self.state {
            State::Touching { at, .. } => Some(at),
            State::Free { asked_at, clear, near, .. } if tip.distance(asked_at) < clear => {
                self.state = State::Free { tip, asked_at, clear, near };
                None
            }
            State::Free { tip: from, near, .. } => {
                let Some(touch) = body.first_touch(from, tip, self.law.radius_m) else {
                    // A little less than the clearance: rounding must not skip a touch.
                    let (clear, near) = body.clearance(tip, near);
                    let clear = (clear - self.law.radius_m) * (1.0 - 1e-9) - ON_SURFACE;
                    self.state = State::Free { tip, asked_at: tip, clear, near };
                    return None;
                };
                flags.onset = true;
                self.counters.onsets += 1;
                Some(self.settle::<L, R>(body, touch.at, from + (tip - from) * touch.fraction))
            }
            State::Inside { asked_at, clear } if tip.distance(asked_at) < clear => {
                self.state = State::Inside { asked_at, clear };
                flags.started_inside = true;
                None
            }
            State::Inside { .. } | State::Unknown => {
                self.look_around(body, tip, flags);
                None
            }
        }
    }

    /// Finds out on which side of the surface a tip is that did not come from outside.
    #[cold]
    #[inline(never)]
    fn look_around(&mut self, body: &ContactModel, tip: DVec3, flags: &mut Flags) {
        let Some(nearest) = body.nearest(tip, f64::INFINITY) else { return };
        let gap = if nearest.outside { nearest.distance } else { -nearest.distance } - self.law.radius_m;
        self.state = if gap >= -ON_SURFACE {
            self.free(body, tip, nearest)
        } else {
            flags.started_inside = true;
            // Inside stays inside until the tip has been as far as the surface.
            State::Inside { asked_at: tip, clear: gap.abs() }
        };
    }

    /// Free at a tip that is outside, or on the surface up to rounding: then from a hair above it, so that the next
    /// segment crosses it whole.
    fn free(&self, body: &ContactModel, tip: DVec3, nearest: Nearest) -> State {
        let from =
            if nearest.outside { tip } else { tip + body.outward(nearest.at.element) * (2.0 * ON_SURFACE) };
        State::Free { tip: from, asked_at: tip, clear: 0.0, near: nearest.at.element }
    }

    /// A sphere's first touch is where the nearest point is at its radius, but the frame there is the interpolated
    /// one: the contact point slips to the friction limit, nearly 0 there, before anything counts. Where the frames
    /// lead it farther away than the tool reaches, it stays.
    fn settle<L: Lateral, R: Rule>(&self, body: &ContactModel, at: SurfacePoint, tip: DVec3) -> SurfacePoint {
        if self.law.radius_m == 0.0 {
            return at;
        }
        let mut site = Site::<L>::new(body, self.law, at.element);
        let (mut settled, mut field) = (at, site.evaluate(at.n, tip));
        let start = field.c;
        let drive = R::drive(&mut site, settled.n, &field);
        let end =
            slip::slip::<L, R>(&mut site, &mut settled, &mut field, drive, tip, &mut Pace::default()).end;
        if end == End::Settled && field.c.distance(start) <= self.law.radius_m { settled } else { at }
    }

    /// Stage 2: the tool moves with the contact point held.
    #[inline(always)]
    fn stick<L: Lateral>(&mut self, site: &mut Site<L>, at: SurfacePoint, tip: DVec3) -> Field {
        let field = site.evaluate(at.n, tip);
        self.energy.stick(field.energy);
        field
    }

    /// Stage 3: the contact point moves with the tool held, until the lateral force is within the friction limit.
    #[inline]
    fn slip<L: Lateral, R: Rule>(
        &mut self,
        site: &mut Site<L>,
        at: &mut SurfacePoint,
        field: &mut Field,
        tip: DVec3,
        flags: &mut Flags,
    ) -> End {
        let drive = R::first(site, at.n, field, self.taken);
        self.counters.underived += u64::from(!R::is_ready(site.body));
        if slip::within(&drive, field) {
            return End::Settled;
        }
        let start = *at;
        let slipped = slip::slip::<L, R>(site, at, field, drive, tip, &mut self.pace);
        if !R::LATERAL {
            self.taken = field.u_t * field.pull - slipped.drive.along * slipped.drive.force;
        }
        self.energy.slip(field.energy);
        let moved = *at != start;
        flags.slipping |= moved;
        self.counters.slips += u64::from(moved);
        self.counters.evaluations += u64::from(slipped.evaluations);
        self.counters.crossings += u64::from(slipped.crossings);
        slipped.end
    }

    /// Stage 4: the contact ends, at δz ≤ 0 or over the border. A tip that is then still inside, in a concave facet or
    /// another sheet, touches anew at its nearest surface point, and one that ran into something else on its way, there.
    #[cold]
    fn release<L: Lateral, R: Rule>(
        &mut self,
        site: &mut Site<L>,
        at: SurfacePoint,
        field: &Field,
        end: End,
        tip: DVec3,
        flags: &mut Flags,
    ) -> Option<(SurfacePoint, Field, End)> {
        let body = site.body;
        self.energy.slip(0.0);
        flags.released = true;
        if end == End::Border {
            flags.border = true;
            // Beyond the border the tip may hang under the sheet: only seen from outside may it touch again.
            self.look_around(body, tip, flags);
            flags.started_inside = false;
            return None;
        }
        let nearest = body.nearest(tip, f64::INFINITY)?;
        let again = if !nearest.outside && nearest.distance > ON_SURFACE {
            Some(nearest.at)
        } else {
            self.beyond(body, at, field, tip)
        };
        self.state = self.free(body, tip, nearest);
        let mut at = self.settle::<L, R>(body, again?, tip);
        *site = Site::new(body, self.law, at.element);
        let mut field = site.evaluate(at.n, tip);
        // Stored energy appears at a fixed tip: the ledger books it as generated.
        self.energy.slip(field.energy);
        let end = self.slip::<L, R>(site, &mut at, &mut field, tip, flags);
        if field.depth > 0.0 && end != End::Border {
            flags.reanchored = true;
            return Some((at, field, end));
        }
        self.energy.slip(0.0);
        self.look_around(body, tip, flags);
        None
    }

    /// What the rest of the way runs into, from where the tip came out over the contact point's plane: a fast tip may
    /// leave one sheet and enter another in the same step.
    fn beyond(
        &self,
        body: &ContactModel,
        at: SurfacePoint,
        field: &Field,
        tip: DVec3,
    ) -> Option<SurfacePoint> {
        let State::Touching { tip: from, .. } = self.state else { return None };
        let before = (from - field.c).dot(field.u()) + self.law.radius_m;
        let fraction = before / (before - field.depth);
        let out =
            from + (tip - from) * fraction.clamp(0.0, 1.0) + body.outward(at.element) * (2.0 * ON_SURFACE);
        body.first_touch(out, tip, self.law.radius_m).map(|t| t.at)
    }

    /// Stage 5: the state for the next step, and the force.
    #[inline(always)]
    fn answer(&mut self, at: SurfacePoint, tip: DVec3, field: &Field, end: End, mut flags: Flags) -> Output {
        self.state = State::Touching { at, tip };
        let mut force = -field.force();
        match end {
            End::Blocked => {
                flags.blocked = true;
                self.counters.blocked += 1;
            }
            End::Capped => {
                flags.capped = true;
                self.counters.capped += 1;
                force += field.u_t * (field.pull - field.limit).max(0.0);
            }
            End::Fenced => {
                flags.fenced = true;
                self.counters.fenced += 1;
            }
            End::Settled | End::Border => {}
        }
        flags.in_contact = true;
        if !force.is_finite() {
            // The output choke point: nothing that is not a number leaves.
            flags.contained = true;
            self.counters.contained += 1;
            force = DVec3::ZERO;
        }
        let contact = ContactPoint {
            element: at.element,
            n: at.n,
            position_m: field.c.to_array(),
            delta_z_m: field.depth,
            delta_r_m: field.lateral,
        };
        Output {
            force_n: force.to_array(),
            torque_nm: [0.0; 3],
            contact: Some(contact),
            flags,
            energy: self.energy,
        }
    }

    fn untouched(&self, flags: Flags) -> Output {
        Output { flags, energy: self.energy, ..Output::default() }
    }
}
