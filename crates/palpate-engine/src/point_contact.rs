//! The contact of one contact point: its life, and the stages of a step (MODEL 3).
//!
//! | state | a step finds: nothing within reach | facets within reach, δz ≤ 0 | δz > 0 | c held at a patch's boundary | c over the border |
//! |---|---|---|---|---|---|
//! | `Unknown`: no pose so far | `Free` | `Hovering` | `Inside` | – | – |
//! | `Free`: outside | `Free` | `Hovering` | `Touching` (onset) | `Waiting` (onset) | `Free`, or `Inside` |
//! | `Hovering`: near, no force | `Free` | `Hovering` | `Touching` (onset) | `Waiting` (onset) | `Free`, or `Inside` |
//! | `Touching`: the force | `Free` (released) | `Hovering` (released) | `Touching` | `Waiting` | `Free`, or `Inside` (released) |
//! | `Waiting`: the force, cut to the friction limit | as `Touching` | as `Touching` | `Touching`, once c has caught up | `Waiting` | as `Touching` |
//! | `Inside`: not through the surface, no force | `Free` | `Hovering` | `Inside` | – | – |
//!
//! Of two contact points ([`Contact`](crate::Contact)) each has such a life, but for border and inside: there both go where one does.
//!
//! [`Found`] is a column, [`State::after`] what follows from it. δz is read where the contact point came to rest.
//! The contact point is that of the last step, or else the first touch on the tool's way. If there is no depth at its end, that contact
//! has ended, or come to nothing, and what else lies on the way is tried ([`PointContact::leave`]): where the straight way from
//! there to the tool enters the surface, and then the nearest place at its end. A contact that comes to nothing leaves no
//! trace: not in the ledger, the counters or the next search's first guess.
//!
//! So no sheet is tunnelled through, at any speed, unless a step enters and leaves more than [`CROSSINGS`] before it. What
//! a sphere reaches over with its rim alone, and has passed by the end of the step, it does not touch.

use crate::budget::Budget;
use crate::drive::{Drive, Rule};
use crate::flags::Flags;
use crate::force_law::ForceLaw;
use crate::kernel::{ElementKernel, Evaluation, Setting};
use crate::output::{ContactPoint, Ledger, Output};
use crate::sensitivity;
use crate::slip::{self, ComplianceEstimate, End};
use crate::walk::{Pull, Rates, StartDirection, start_direction, walk};
use glam::DVec3;
use palpate_body::{ContactModel, Nearest, SlipRule, SurfacePoint, Touch};

/// Inside the surface by no more than this (m) counts as on it: a segment starting there still meets the surface.
const ON_SURFACE: f64 = 1e-9;
/// How many crossings of the surface are tried after a contact that has ended.
const CROSSINGS: u32 = 4;
/// How much farther than the tool a contact point may run that waited at a patch's boundary.
const CATCH_UP: f64 = 2.0;
/// Iterates to where W has risen by what the tank holds; the side where it has not is taken.
const HOLDS: u32 = 6;
/// A root is close enough at this part of what is stored.
const CLOSE: f64 = 1e-6;

/// All that evolves of one contact point, without a pointer to the body.
#[derive(Debug, Clone)]
pub(crate) struct PointContact {
    setting: Setting,
    state: State,
    guess: Guess,
    /// The intervals of the knots that held the last deflections: the next step reads their rows before it knows its own. No
    /// force depends on it.
    intervals: [u32; 2],
    energy: Ledger,
    /// See [`Budget::STEP`].
    budget: u32,
    /// Whether slip may give out no more energy than the tank holds.
    tank: bool,
}

/// What a contact that comes to nothing leaves as it was.
pub(crate) type Kept = (Ledger, Guess);

/// The next slip search's first guess, from the last slips.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Guess {
    estimate: ComplianceEstimate,
    /// f_t less the drive in the last slip, N.
    last_reaction: DVec3,
}

/// The life of a contact; see the table at the top of this file.
#[derive(Debug, Clone, Copy)]
enum State {
    Unknown,
    /// Last seen at `tool_position`; at `asked_at` the surface was at least `clear` (m) away from touch, and `near` not far.
    Free {
        tool_position: DVec3,
        asked_at: DVec3,
        clear: f64,
        near: u32,
    },
    Hovering {
        tool_position: DVec3,
        near: u32,
    },
    Touching {
        at: SurfacePoint,
        tool_position: DVec3,
    },
    Waiting {
        at: SurfacePoint,
        tool_position: DVec3,
    },
    Inside {
        asked_at: DVec3,
        clear: f64,
    },
}

/// Where a step ended.
enum Found {
    /// Nothing to touch within `clear` (m).
    Clear { clear: f64, near: u32 },
    /// Facets within reach, but no depth.
    Near { near: u32 },
    /// Depth.
    Depth { at: SurfacePoint },
    /// Depth, and the contact point held at a patch's boundary.
    Boundary { at: SurfacePoint },
    /// In or under the surface, where no contact may begin; the surface is `clear` (m) away.
    Under { clear: f64 },
}

impl State {
    /// After a step that ended with the tool at `tool_position`.
    #[inline(always)]
    fn after(found: Found, tool_position: DVec3) -> Self {
        match found {
            Found::Clear { clear, near } => {
                State::Free { tool_position, asked_at: tool_position, clear, near }
            }
            Found::Near { near } => State::Hovering { tool_position, near },
            Found::Depth { at } => State::Touching { at, tool_position },
            Found::Boundary { at } => State::Waiting { at, tool_position },
            Found::Under { clear } => State::Inside { asked_at: tool_position, clear },
        }
    }
}

/// What a step took.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Effort {
    pub evaluations: u32,
    pub crossings: u32,
    /// Queries of the surface.
    pub queries: u32,
}

/// A step in progress.
struct Step<'b> {
    body: &'b ContactModel,
    /// Where the tool was the step before, or touched the surface first.
    from: DVec3,
    tool_position: DVec3,
    flags: Flags,
    budget: Budget,
    /// Queries of the surface so far.
    queries: u32,
    /// See [`cut`]; only where the last slip could not go on.
    cut: DVec3,
}

impl Step<'_> {
    /// The law with the contact point elsewhere.
    #[cold]
    #[inline(never)]
    fn read<L: ForceLaw>(&mut self, kernel: &mut ElementKernel<L>, at: SurfacePoint) -> Evaluation {
        kernel.move_to(at.element);
        self.budget.evaluate();
        kernel.evaluate(at.n, self.tool_position)
    }

    fn first_touch(&mut self, from: DVec3, radius: f64) -> Option<Touch> {
        self.queries += 1;
        self.body.first_touch(from, self.tool_position, radius)
    }

    /// Of the tool.
    fn nearest(&mut self) -> Option<Nearest> {
        self.queries += 1;
        self.body.nearest(self.tool_position, f64::INFINITY)
    }

    /// Of the tool; `near` is an element that may be.
    fn clearance(&mut self, near: u32) -> (f64, u32) {
        self.queries += 1;
        self.body.clearance(self.tool_position, near)
    }
}

impl PointContact {
    pub(crate) fn new(setting: Setting, tank: bool) -> Self {
        PointContact {
            setting,
            state: State::Unknown,
            guess: Guess::default(),
            intervals: [0; 2],
            energy: Ledger::default(),
            budget: Budget::STEP,
            tank,
        }
    }

    pub(crate) fn has_tank(&self) -> bool {
        self.tank
    }

    pub(crate) fn set_tank(&mut self, tank: bool) {
        self.tank = tank;
    }

    /// The last slips were another rule's.
    pub(crate) fn change_rule(&mut self) {
        self.guess = Guess::default();
    }

    /// Multiplies the body's friction coefficients, from the next step on.
    pub(crate) fn set_friction_scale(&mut self, scale: f64) {
        self.setting.friction_scale = scale;
    }

    pub(crate) fn energy(&self) -> &Ledger {
        &self.energy
    }

    /// The surface point that the tool touches, if it does.
    pub(crate) fn touching(&self) -> Option<SurfacePoint> {
        match self.state {
            State::Touching { at, .. } | State::Waiting { at, .. } => Some(at),
            _ => None,
        }
    }

    /// Where the tool was last seen, m: see [`Contact::last_position_m`](crate::Contact::last_position_m).
    pub(crate) fn last_position(&self) -> Option<DVec3> {
        match self.state {
            State::Touching { tool_position, .. }
            | State::Waiting { tool_position, .. }
            | State::Hovering { tool_position, .. }
            | State::Free { tool_position, .. } => Some(tool_position),
            State::Inside { .. } | State::Unknown => None,
        }
    }

    /// See [`Contact::renumber`](crate::Contact::renumber).
    pub(crate) fn renumber(&mut self, renumber: impl Fn(u32) -> Option<u32>) -> bool {
        match &mut self.state {
            State::Touching { at, .. } | State::Waiting { at, .. } => match renumber(at.element) {
                Some(element) => at.element = element,
                None => return false,
            },
            // What is free has to ask anew: the clearance was that of the other copy.
            State::Free { clear, near, .. } => (*clear, *near) = (0.0, renumber(*near).unwrap_or(0)),
            State::Hovering { near, .. } => *near = renumber(*near).unwrap_or(0),
            State::Inside { clear, .. } => *clear = 0.0,
            State::Unknown => {}
        }
        true
    }

    /// The next pose counts as the first one. What was stored is booked as dissipated.
    pub(crate) fn forget(&mut self) {
        self.energy.slip(0.0);
        self.state = State::Unknown;
    }

    /// What a contact that begins in the next step would leave as it was, should it come to nothing; `None` in touch.
    #[inline(always)]
    pub(crate) fn kept_if_free(&self) -> Option<Kept> {
        self.touching().is_none().then(|| self.kept())
    }

    /// Goes where another contact point of the same contact is after a step that ended the contact: over the border, or inside. What
    /// touched before has ended; what is `new` has come to nothing, and what was before it is put back.
    pub(crate) fn end_with(&mut self, other: &PointContact, new: Option<Kept>) {
        match new {
            Some(kept) => self.restore(kept),
            None => self.energy.slip(0.0),
        }
        self.state = other.state;
    }

    /// One sample, with the tool at an accepted position. Its searches and their effort are added to `effort`.
    #[inline(always)]
    pub(crate) fn step<L: ForceLaw, R: Rule>(
        &mut self,
        body: &ContactModel,
        tool_position: DVec3,
        flags: Flags,
        effort: &mut Effort,
    ) -> Output {
        let budget = Budget::new(self.budget);
        let mut step =
            Step { body, from: tool_position, tool_position, flags, budget, queries: 0, cut: DVec3::ZERO };
        let output = self.stages::<L, R>(&mut step);
        effort.evaluations += step.budget.evaluations;
        effort.crossings += step.budget.crossings;
        effort.queries += step.queries;
        output
    }

    /// See [`Contact::lipschitz_n_per_m`](crate::Contact::lipschitz_n_per_m).
    pub(crate) fn lipschitz(&self, body: &ContactModel, rule: SlipRule) -> Option<f64> {
        match self.state {
            State::Touching { at, tool_position } | State::Waiting { at, tool_position } => {
                sensitivity::lipschitz(body, self.setting, rule, at, tool_position)
            }
            _ => None,
        }
    }

    #[inline(always)]
    fn stages<L: ForceLaw, R: Rule>(&mut self, step: &mut Step) -> Output {
        let (mut at, new) = match self.state {
            State::Touching { at, tool_position } | State::Waiting { at, tool_position } => {
                step.from = tool_position;
                (at, None)
            }
            State::Free { asked_at, clear, near, .. } if step.tool_position.distance(asked_at) < clear => {
                self.state = State::Free { tool_position: step.tool_position, asked_at, clear, near };
                return self.untouched(step.flags);
            }
            State::Free { tool_position, near, .. } => {
                match self.onset::<L, R>(step, tool_position, near, false) {
                    Some(at) => (at, Some(self.guess)),
                    None => return self.untouched(step.flags),
                }
            }
            State::Hovering { tool_position, near } => {
                match self.onset::<L, R>(step, tool_position, near, true) {
                    Some(at) => (at, Some(self.guess)),
                    None => return self.untouched(step.flags),
                }
            }
            State::Inside { asked_at, clear } if step.tool_position.distance(asked_at) < clear => {
                step.flags.set(Flags::STARTED_INSIDE, true);
                return self.untouched(step.flags);
            }
            State::Inside { .. } | State::Unknown => {
                let inside = self.look_around::<L, R>(step);
                step.flags.set(Flags::STARTED_INSIDE, inside);
                return self.untouched(step.flags);
            }
        };
        let waiting = matches!(self.state, State::Waiting { .. });
        let before = (waiting || new.is_some()).then_some((at, self.energy));
        let mut kernel = ElementKernel::<L>::expecting(step.body, self.setting, at.element, self.intervals);
        let mut evaluation = self.stick(&mut kernel, at, step.tool_position);
        let mut end = self.slip::<L, R>(&mut kernel, &mut at, &mut evaluation, step);
        if let Some(from) = before.filter(|_| waiting && end != End::PatchBoundary && end != End::Border) {
            end = self.catch_up::<L, R>(from, &mut kernel, &mut at, &mut evaluation, end, step);
        }
        self.intervals = kernel.intervals();
        if evaluation.depth > 0.0 && end != End::Border {
            step.flags.set(Flags::ONSET, new.is_some());
            return self.answer(at, &evaluation, end, step);
        }
        let new = new.zip(before).map(|(guess, (_, energy))| (energy, guess));
        self.leave::<L, R>(step, at, &evaluation, end, new)
    }

    /// Stage 1 of a tool that did not touch: the contact point of the first touch on its way, if there is one.
    #[inline(never)]
    fn onset<L: ForceLaw, R: Rule>(
        &mut self,
        step: &mut Step,
        from: DVec3,
        near: u32,
        hovering: bool,
    ) -> Option<SurfacePoint> {
        let (tool_position, radius) = (step.tool_position, self.setting.radius_m);
        if let Some(touch) = step.first_touch(from, radius) {
            step.from = from + (tool_position - from) * touch.fraction;
            return Some(self.settle::<L, R>(step, touch.at));
        }
        if !hovering {
            let (clear, near) = step.clearance(near);
            self.state = State::after(Found::Clear { clear: self.clear(clear), near }, tool_position);
            return None;
        }
        step.from = from;
        let nearest = step.nearest()?;
        if self.is_clear(step, &nearest) { None } else { Some(nearest.at) }
    }

    /// How far from touch a tool is whose distance from the surface is at least this.
    fn clear(&self, distance: f64) -> f64 {
        // A little less: rounding must not skip a touch.
        (distance - self.setting.radius_m) * (1.0 - 1e-9) - ON_SURFACE
    }

    /// Finds out on which side of the surface a tool is that did not come from outside. True if it is inside.
    #[cold]
    #[inline(never)]
    fn look_around<L: ForceLaw, R: Rule>(&mut self, step: &mut Step) -> bool {
        let Some(nearest) = step.nearest() else { return false };
        if self.is_clear(step, &nearest) {
            return false;
        }
        let near = nearest.at.element;
        let (mut kernel, mut at) = (ElementKernel::<L>::new(step.body, self.setting, near), nearest.at);
        step.budget.evaluate();
        let mut evaluation = kernel.evaluate(at.n, step.tool_position);
        let (kept, flags) = (self.kept(), step.flags);
        let end = self.slip::<L, R>(&mut kernel, &mut at, &mut evaluation, step);
        self.restore(kept);
        step.flags = flags;
        let inside = evaluation.depth > 0.0 || end == End::Border;
        // Inside stays inside until the tool has been as far as the surface.
        let clear = (self.setting.radius_m - signed(&nearest)).abs();
        let found = if inside { Found::Under { clear } } else { Found::Near { near } };
        self.state = State::after(found, step.tool_position);
        inside
    }

    /// Whether the tool is outside and nothing is within its reach, as its nearest surface point tells: it is free then.
    fn is_clear(&mut self, step: &Step, nearest: &Nearest) -> bool {
        let near = nearest.at.element;
        if signed(nearest) - self.setting.radius_m < -ON_SURFACE {
            return false;
        }
        let clear = self.clear(nearest.distance);
        self.state = State::after(Found::Clear { clear, near }, step.tool_position);
        if let State::Free { tool_position, .. } = &mut self.state
            && !nearest.outside
        {
            // On the surface up to rounding: from a hair above it, so that the next segment crosses it whole.
            *tool_position += step.body.outward(near) * (2.0 * ON_SURFACE);
        }
        true
    }

    /// A sphere's first touch is where the nearest point is at its radius, but the frame there is the interpolated
    /// one: the contact point slips to the friction limit, nearly 0 there, before anything counts. Where the frames
    /// lead it farther away than the tool reaches, it stays.
    fn settle<L: ForceLaw, R: Rule>(&self, step: &mut Step, at: SurfacePoint) -> SurfacePoint {
        if self.setting.radius_m == 0.0 {
            return at;
        }
        let mut kernel = ElementKernel::<L>::new(step.body, self.setting, at.element);
        step.budget.evaluate();
        let (mut settled, mut evaluation) = (at, kernel.evaluate(at.n, step.from));
        let (start, tool_position, budget, mut estimate) =
            (evaluation.c, step.from, &mut step.budget, ComplianceEstimate::default());
        let drive = R::drive(&mut kernel, settled.n, &evaluation);
        if slip::within(&drive, &evaluation) {
            return at;
        }
        let (end, _) = slip::slip::<L, R>(
            &mut kernel,
            &mut settled,
            &mut evaluation,
            drive,
            tool_position,
            &mut estimate,
            budget,
        );
        if end == End::Settled && evaluation.c.distance(start) <= self.setting.radius_m {
            settled
        } else {
            at
        }
    }

    /// Stage 2: the tool moves with the contact point held.
    #[inline(always)]
    fn stick<L: ForceLaw>(
        &mut self,
        kernel: &mut ElementKernel<L>,
        at: SurfacePoint,
        tool_position: DVec3,
    ) -> Evaluation {
        let evaluation = kernel.evaluate(at.n, tool_position);
        self.energy.stick(evaluation.energy);
        evaluation
    }

    /// Stage 3: the contact point moves with the tool held, until the lateral force is within the friction limit. Returns
    /// how that ended.
    #[inline(always)]
    fn slip<L: ForceLaw, R: Rule>(
        &mut self,
        kernel: &mut ElementKernel<L>,
        at: &mut SurfacePoint,
        evaluation: &mut Evaluation,
        step: &mut Step,
    ) -> End {
        let drive = R::first(kernel, at.n, evaluation, self.guess.last_reaction);
        if slip::within(&drive, evaluation) {
            return End::Settled;
        }
        self.slide::<L, R>(kernel, at, evaluation, drive, step)
    }

    /// Stage 3 where the drive is beyond the limit.
    #[inline]
    fn slide<L: ForceLaw, R: Rule>(
        &mut self,
        kernel: &mut ElementKernel<L>,
        at: &mut SurfacePoint,
        evaluation: &mut Evaluation,
        drive: Drive,
        step: &mut Step,
    ) -> End {
        let start = *at;
        let (estimate, budget) = (&mut self.guess.estimate, &mut step.budget);
        let (end, drive) =
            slip::slip::<L, R>(kernel, at, evaluation, drive, step.tool_position, estimate, budget);
        if !R::LATERAL {
            self.guess.last_reaction = evaluation.u_t * evaluation.lateral_force - drive.along * drive.force;
        }
        let end = if self.tank && evaluation.energy > self.allowed() && end != End::Border {
            self.hold_back::<L, R>(kernel, start, at, evaluation, step);
            End::HeldBack
        } else {
            end
        };
        if matches!(end, End::Capped | End::PatchBoundary) {
            step.cut = cut(evaluation, end, &drive);
        }
        self.energy.slip(evaluation.energy);
        step.flags.set(Flags::SLIPPING, *at != start);
        end
    }

    /// What a slip may raise W to, J: what is stored, and what the tank holds (LAW 3).
    #[inline(always)]
    fn allowed(&self) -> f64 {
        self.energy.stored_j + self.energy.tank_j.max(0.0)
    }

    /// A slip that led from `start` to `at`, where W is more than allowed, goes only as far as W allows: straight over the
    /// surface towards `at`, to the root of what W exceeds it by.
    #[cold]
    #[inline(never)]
    fn hold_back<L: ForceLaw, R: Rule>(
        &self,
        kernel: &mut ElementKernel<L>,
        start: SurfacePoint,
        at: &mut SurfacePoint,
        evaluation: &mut Evaluation,
        step: &mut Step,
    ) {
        let (body, allowed) = (step.body, self.allowed());
        let way = evaluation.c - body.point(start);
        let v = way.normalize_or_zero();
        // How far W is allowed for sure, by how much it stays below there, and where it is too much.
        let (mut low, mut below) = ((0.0, start), allowed - self.energy.stored_j);
        let (mut high, mut above) = (way.length(), evaluation.energy - allowed);
        let from = match start_direction(body, start, |_| {
            Pull::straight(if step.budget.cross() { v } else { DVec3::ZERO })
        }) {
            StartDirection::Along(there) => Some(there),
            _ => None,
        };
        for _ in 0..HOLDS {
            let Some(from) = from.filter(|_| below > 0.0 && !step.budget.is_spent()) else { break };
            // The Illinois secant; W is nearly a parabola along a slip.
            let far = low.0 + (high - low.0) * (below / (below + above));
            let rates = Rates::new(body.corners(from.element), v);
            let there = walk(body, from, v, far, rates, &mut step.budget).0;
            *evaluation = step.read(kernel, there);
            let left = allowed - evaluation.energy;
            if left >= 0.0 {
                (low, below, above) = ((far, there), left, 0.5 * above);
                if left <= CLOSE * self.energy.stored_j.abs() {
                    break;
                }
            } else {
                (high, above, below) = (far, -left, 0.5 * below);
            }
        }
        *at = low.1;
        *evaluation = step.read(kernel, *at);
    }

    /// After a wait at a patch's boundary: the contact point runs after the tool by no more than [`CATCH_UP`] times as far
    /// as the tool moves, so that the force does not jump by what it fell behind. `from` is where it was, and the ledger then.
    #[cold]
    #[inline(never)]
    fn catch_up<L: ForceLaw, R: Rule>(
        &mut self,
        (held, before): (SurfacePoint, Ledger),
        kernel: &mut ElementKernel<L>,
        at: &mut SurfacePoint,
        evaluation: &mut Evaluation,
        slipped: End,
        step: &mut Step,
    ) -> End {
        let body = step.body;
        let (way, most) =
            (evaluation.c - body.point(held), CATCH_UP * step.tool_position.distance(step.from));
        let v = way.normalize_or_zero();
        if way.length() <= most {
            return slipped;
        }
        *at = match start_direction(body, held, |_| {
            Pull::straight(if step.budget.cross() { v } else { DVec3::ZERO })
        }) {
            StartDirection::Along(there) => {
                let rates = Rates::new(body.corners(there.element), v);
                walk(body, there, v, most, rates, &mut step.budget).0
            }
            _ => held,
        };
        self.energy = before;
        self.energy.stick(step.read(kernel, held).energy);
        *evaluation = step.read(kernel, *at);
        if self.tank && evaluation.energy > self.allowed() {
            self.hold_back::<L, R>(kernel, held, at, evaluation, step);
        }
        step.cut = cut(evaluation, End::PatchBoundary, &R::drive(kernel, at.n, evaluation));
        self.energy.slip(evaluation.energy);
        End::PatchBoundary
    }

    /// Stage 4: no depth, or over the border. The contact has ended; or, if it is `new` in this step, it comes to nothing
    /// and what was before it is put back. What else lies on the way, or is within reach at its end, is tried.
    #[cold]
    #[inline(never)]
    fn leave<L: ForceLaw, R: Rule>(
        &mut self,
        step: &mut Step,
        at: SurfacePoint,
        evaluation: &Evaluation,
        end: End,
        new: Option<Kept>,
    ) -> Output {
        let (body, tool_position) = (step.body, step.tool_position);
        match new {
            Some(kept) => {
                self.restore(kept);
                step.flags.unset(Flags::SLIPPING);
            }
            None => {
                self.energy.slip(0.0);
                step.flags.set(Flags::RELEASED, true);
            }
        }
        if end == End::Border {
            step.flags.set(Flags::BORDER, true);
            // Beyond the border the tool may hang under the sheet: only seen from outside may it touch again.
            self.look_around::<L, R>(step);
            return self.untouched(step.flags);
        }
        let Some(nearest) = step.nearest() else { return self.untouched(step.flags) };
        // From the surface's outer side at the contact point to the tool: what is entered on the way, of what may be near
        // enough.
        let mut start = self.resting(body, at, evaluation);
        for _ in 0..CROSSINGS {
            if nearest.outside && nearest.distance > tool_position.distance(start) {
                break;
            }
            let Some(touch) = step.first_touch(start, 0.0) else { break };
            match self.try_at::<L, R>(step, touch.at) {
                Ok(output) => return output,
                Err(rest) => start = rest,
            }
        }
        if self.is_clear(step, &nearest) {
            return self.untouched(step.flags);
        }
        if let Ok(output) = self.try_at::<L, R>(step, nearest.at) {
            return output;
        }
        self.state = State::after(Found::Near { near: nearest.at.element }, tool_position);
        self.untouched(step.flags)
    }

    /// A contact at this place, if it has depth there. Else everything stays as it was, and the tool would have come to
    /// rest where it says.
    fn try_at<L: ForceLaw, R: Rule>(
        &mut self,
        step: &mut Step,
        mut at: SurfacePoint,
    ) -> Result<Output, DVec3> {
        let (kept, flags) = (self.kept(), step.flags);
        let mut kernel = ElementKernel::<L>::new(step.body, self.setting, at.element);
        step.budget.evaluate();
        let mut evaluation = kernel.evaluate(at.n, step.tool_position);
        let from_outside = (step.from - evaluation.c).dot(evaluation.u()) + self.setting.radius_m <= 0.0;
        if from_outside {
            self.energy.stick(evaluation.energy);
        } else {
            // The tool was this deep before: no work leads here, and the ledger says that the energy was generated.
            self.energy.slip(evaluation.energy);
        }
        let end = self.slip::<L, R>(&mut kernel, &mut at, &mut evaluation, step);
        // On the surface up to rounding the tool has not been taken up anew.
        if evaluation.depth > ON_SURFACE && end != End::Border {
            let released = flags.has(Flags::RELEASED);
            step.flags.set(Flags::REANCHORED, released || !from_outside);
            step.flags.set(Flags::ONSET, !released);
            return Ok(self.answer(at, &evaluation, end, step));
        }
        self.restore(kept);
        step.flags = flags;
        Err(self.resting(step.body, at, &evaluation))
    }

    /// The tool's place where it just touches the contact point, a hair above.
    fn resting(&self, body: &ContactModel, at: SurfacePoint, evaluation: &Evaluation) -> DVec3 {
        evaluation.c - evaluation.u() * self.setting.radius_m + body.outward(at.element) * (2.0 * ON_SURFACE)
    }

    fn kept(&self) -> Kept {
        (self.energy, self.guess)
    }

    fn restore(&mut self, kept: Kept) {
        (self.energy, self.guess) = kept;
    }

    /// Stage 5: the state for the next step, and the force.
    #[inline(always)]
    fn answer(&mut self, at: SurfacePoint, evaluation: &Evaluation, end: End, step: &mut Step) -> Output {
        let flags = &mut step.flags;
        flags.set(Flags::IN_CONTACT, true);
        flags.set(Flags::PULLING, evaluation.normal < 0.0);
        let mut force = DVec3::ZERO - evaluation.force();
        if end == End::Settled {
            self.state = State::after(Found::Depth { at }, step.tool_position);
        } else {
            flags.set(end.flags(), true);
            let at_boundary = end == End::PatchBoundary;
            let found = if at_boundary { Found::Boundary { at } } else { Found::Depth { at } };
            self.state = State::after(found, step.tool_position);
            if at_boundary || end == End::Capped {
                force += step.cut;
            }
        }
        // A sum that overflows is as good as one that does.
        if !force.abs().element_sum().is_finite() {
            // The output check: no NaN or infinity leaves.
            flags.set(Flags::CONTAINED, true);
            force = DVec3::ZERO;
        }
        let contact = ContactPoint {
            element: at.element,
            n: at.n,
            position_m: evaluation.c.to_array(),
            delta_z_m: evaluation.depth,
            delta_r_m: evaluation.lateral,
        };
        Output {
            force_n: force.to_array(),
            torque_nm: [0.0; 3],
            contact: Some(contact),
            flags: *flags,
            energy: self.energy,
        }
    }

    /// A step that ends without touch, or is not taken.
    pub(crate) fn untouched(&self, flags: Flags) -> Output {
        Output { flags, energy: self.energy, ..Output::default() }
    }
}

/// How far outside the surface, m; negative inside.
fn signed(nearest: &Nearest) -> f64 {
    if nearest.outside { nearest.distance } else { -nearest.distance }
}

/// What is taken from the force where the contact point could not go on, N: what the slip rule bounds is cut to the limit,
/// as it is where the contact point comes to rest.
///
/// At a patch's boundary W's slope along the surface is left, which grows with the distance from there: the lateral force is
/// also cut to what a surface at 45° would give.
#[cold]
#[inline(never)]
fn cut(evaluation: &Evaluation, end: End, drive: &Drive) -> DVec3 {
    // Not turned round: what the drive has beside f_t would change with it.
    let cut = drive.along * (drive.force - evaluation.limit).max(0.0).min(evaluation.lateral_force);
    if end != End::PatchBoundary {
        return cut;
    }
    let (u, lateral_force) = (evaluation.u(), evaluation.u_t * evaluation.lateral_force);
    let lateral = lateral_force - (cut - u * cut.dot(u));
    lateral_force - lateral * ((evaluation.limit + evaluation.normal) / lateral.length()).min(1.0)
}

#[cfg(test)]
mod tests;
