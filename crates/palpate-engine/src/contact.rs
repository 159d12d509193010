//! One contact: its life, and the stages of a step (MODEL 3).
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
//! [`Found`] is a column, [`State::after`] what follows from it. δz is read where the contact point came to rest.
//! The contact point is that of the last step, or else the first touch on the tool's way. If there is no depth at its end, that contact
//! has ended, or come to nothing, and what else lies on the way is tried ([`Contact::leave`]): where the straight way from
//! there to the tool enters the surface, and then the nearest place at its end. A contact that comes to nothing leaves no
//! trace: not in the ledger, the counters or the next search's first guess.
//!
//! So no sheet is tunnelled through, at any speed, unless a step enters and leaves more than [`CROSSINGS`] before it. What
//! a sphere reaches over with its rim alone, and has passed by the end of the step, it does not touch.

use crate::budget::Budget;
use crate::coupled::Coupled;
use crate::decoupled::{Isotropic, Stretch};
use crate::drive::{Consistent, Drive, Exact, Paper, Rule};
use crate::field::{Ablation, Field, Law, Site};
use crate::flags::Flags;
use crate::lateral::Lateral;
use crate::output::{ContactPoint, Counters, Ledger, Output, ToolState};
use crate::sensitivity;
use crate::slip::{self, End, Pace};
use crate::walk::{Launch, Rates, launch, walk};
use glam::DVec3;
use palpate_body::{Body, ContactModel, Nearest, SlipRule, SurfacePoint, Touch};

/// Inside the surface by no more than this (m) counts as on it: a segment starting there still catches the surface.
const ON_SURFACE: f64 = 1e-9;
/// How many crossings of the surface are tried after a contact that has ended.
const CROSSINGS: u32 = 4;
/// How much farther than the tool a contact point may run that waited at a patch's boundary.
const CATCH_UP: f64 = 2.0;
/// Iterates to where W has risen by what the tank holds; the side where it has not is taken.
const HOLDS: u32 = 6;
/// A root is close enough at this part of what is stored.
const CLOSE: f64 = 1e-6;

/// All that evolves while one tool touches one body: fixed in size, without a pointer to the body.
///
/// Every step must be given the body that the contact was made for, or a patch of it ([`ContactModel::identity`]): on another
/// there is no force, and the step says so ([`Flags::OTHER_BODY`]). A contact that slips by `consistent` on a body whose
/// gradients nobody derived counts that ([`Counters::underived`]).
#[derive(Debug, Clone)]
pub struct Contact {
    /// Of the body it is for.
    body: u64,
    law: Law,
    rule: SlipRule,
    state: State,
    guess: Guess,
    energy: Ledger,
    counters: Counters,
    /// See [`Budget::STEP`].
    budget: u32,
    /// Whether slip may give out no more energy than the tank holds.
    tank: bool,
}

/// What the last slips tell the next search to try first.
#[derive(Debug, Clone, Copy, Default)]
struct Guess {
    pace: Pace,
    /// What the slip rule last took from f_t, N.
    taken: DVec3,
}

/// The life of a contact; see the table at the top of this file.
#[derive(Debug, Clone, Copy)]
enum State {
    Unknown,
    /// Last seen at `tip`; at `asked_at` the surface was at least `clear` (m) away from touch, and `near` not far.
    Free {
        tip: DVec3,
        asked_at: DVec3,
        clear: f64,
        near: u32,
    },
    Hovering {
        tip: DVec3,
        near: u32,
    },
    Touching {
        at: SurfacePoint,
        tip: DVec3,
    },
    Waiting {
        at: SurfacePoint,
        tip: DVec3,
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
    /// After a step that ended with the tool at `tip`.
    #[inline(always)]
    fn after(found: Found, tip: DVec3) -> Self {
        match found {
            Found::Clear { clear, near } => State::Free { tip, asked_at: tip, clear, near },
            Found::Near { near } => State::Hovering { tip, near },
            Found::Depth { at } => State::Touching { at, tip },
            Found::Boundary { at } => State::Waiting { at, tip },
            Found::Under { clear } => State::Inside { asked_at: tip, clear },
        }
    }
}

/// A step on its way.
struct Step<'b> {
    body: &'b ContactModel,
    /// Where the tool was the step before, or touched the surface first.
    from: DVec3,
    tip: DVec3,
    flags: Flags,
    budget: Budget,
    /// Questions to the surface so far.
    queries: u32,
}

impl Step<'_> {
    /// The law with the contact point elsewhere.
    #[cold]
    #[inline(never)]
    fn read<L: Lateral>(&mut self, site: &mut Site<L>, at: SurfacePoint) -> Field {
        site.move_to(at.element);
        self.budget.evaluate();
        site.evaluate(at.n, self.tip)
    }

    fn first_touch(&mut self, from: DVec3, radius: f64) -> Option<Touch> {
        self.queries += 1;
        self.body.first_touch(from, self.tip, radius)
    }

    /// Of the tool.
    fn nearest(&mut self) -> Option<Nearest> {
        self.queries += 1;
        self.body.nearest(self.tip, f64::INFINITY)
    }

    /// Of the tool; `near` is an element that may be.
    fn clearance(&mut self, near: u32) -> (f64, u32) {
        self.queries += 1;
        self.body.clearance(self.tip, near)
    }
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
            body: model.identity(),
            law,
            rule,
            state: State::Unknown,
            guess: Guess::default(),
            energy,
            counters,
            budget: Budget::STEP,
            tank: model.has_tank(),
        }
    }

    /// The same with the tank that keeps slip from giving out energy, or without: see [`Ledger::tank_j`].
    pub fn with_tank(mut self, tank: bool) -> Self {
        self.tank = tank;
        self
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
            State::Touching { at, .. } | State::Waiting { at, .. } => Some(at),
            _ => None,
        }
    }

    /// Where the tool was last seen, m: from there the next step looks for a touch. `None` before the first pose, and while
    /// the tool is inside without touching.
    pub fn last_tip_m(&self) -> Option<[f64; 3]> {
        match self.state {
            State::Touching { tip, .. }
            | State::Waiting { tip, .. }
            | State::Hovering { tip, .. }
            | State::Free { tip, .. } => Some(tip.to_array()),
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

    /// Forgets where the tool was: the next pose counts as the first one, and a tool that is then inside the body feels
    /// nothing until it has left it. What was stored is booked as dissipated.
    ///
    /// # Real-time
    /// O(1).
    pub fn forget(&mut self) {
        self.energy.slip(0.0);
        self.state = State::Unknown;
    }

    /// One sample: where the tool is and how long after the last one (s, finite and not negative), and out comes the force
    /// on it. Nothing depends on the time yet.
    ///
    /// # Real-time
    /// Bounded ([`Counters::evaluations`]); never allocates, locks, logs, reads a clock or a file, or panics. In free space it
    /// costs a distance comparison until the tip has used up the clearance that the last query found.
    pub fn step(&mut self, body: &ContactModel, tool: &ToolState, dt_s: f64) -> Output {
        if body.is_coupled() {
            return match self.rule {
                SlipRule::Consistent => self.step_as::<Coupled, Consistent>(body, tool, dt_s),
                SlipRule::Exact => self.step_as::<Coupled, Exact>(body, tool, dt_s),
                _ => self.step_as::<Coupled, Paper>(body, tool, dt_s),
            };
        }
        match (self.rule, body.is_isotropic()) {
            (SlipRule::Consistent, true) => self.step_as::<Isotropic, Consistent>(body, tool, dt_s),
            (SlipRule::Consistent, false) => self.step_as::<Stretch, Consistent>(body, tool, dt_s),
            (SlipRule::Exact, true) => self.step_as::<Isotropic, Exact>(body, tool, dt_s),
            (SlipRule::Exact, false) => self.step_as::<Stretch, Exact>(body, tool, dt_s),
            (_, true) => self.step_as::<Isotropic, Paper>(body, tool, dt_s),
            (_, false) => self.step_as::<Stretch, Paper>(body, tool, dt_s),
        }
    }

    /// Apart from the choice between them, which is a jump.
    #[inline(never)]
    fn step_as<L: Lateral, R: Rule>(&mut self, body: &ContactModel, tool: &ToolState, dt_s: f64) -> Output {
        self.counters.steps += 1;
        let mut flags = Flags::default();
        flags.set(Flags::INVALID_TIME, !(0.0..f64::INFINITY).contains(&dt_s));
        let Some(tip) = tool.accept().filter(|_| body.identity() == self.body) else {
            flags.set(Flags::INVALID_POSE, tool.accept().is_none());
            flags.set(Flags::OTHER_BODY, body.identity() != self.body);
            flags.set(Flags::IN_CONTACT, self.touching().is_some());
            self.counters.count(flags);
            return self.untouched(flags);
        };
        let budget = Budget::new(self.budget);
        let mut step = Step { body, from: tip, tip, flags, budget, queries: 0 };
        let output = self.stages::<L, R>(&mut step);
        self.counters.count(output.flags);
        self.counters.evaluations += u64::from(step.budget.evaluations);
        self.counters.crossings += u64::from(step.budget.crossings);
        self.counters.queries += u64::from(step.queries);
        self.counters.underived += u64::from(output.flags.has(Flags::IN_CONTACT) && !R::is_ready(body));
        output
    }

    #[inline(always)]
    fn stages<L: Lateral, R: Rule>(&mut self, step: &mut Step) -> Output {
        let (mut at, new) = match self.state {
            State::Touching { at, tip } | State::Waiting { at, tip } => {
                step.from = tip;
                (at, None)
            }
            State::Free { asked_at, clear, near, .. } if step.tip.distance(asked_at) < clear => {
                self.state = State::Free { tip: step.tip, asked_at, clear, near };
                return self.untouched(step.flags);
            }
            State::Free { tip, near, .. } => match self.onset::<L, R>(step, tip, near, false) {
                Some(at) => (at, Some(self.guess)),
                None => return self.untouched(step.flags),
            },
            State::Hovering { tip, near } => match self.onset::<L, R>(step, tip, near, true) {
                Some(at) => (at, Some(self.guess)),
                None => return self.untouched(step.flags),
            },
            State::Inside { asked_at, clear } if step.tip.distance(asked_at) < clear => {
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
        let mut site = Site::<L>::new(step.body, self.law, at.element);
        let mut field = self.stick(&mut site, at, step.tip);
        let (mut end, mut drive) = self.slip::<L, R>(&mut site, &mut at, &mut field, step);
        if let Some(from) = before.filter(|_| waiting && end != End::Fenced && end != End::Border) {
            (end, drive) = self.catch_up::<L, R>(from, &mut site, &mut at, &mut field, (end, drive), step);
        }
        if field.depth > 0.0 && end != End::Border {
            step.flags.set(Flags::ONSET, new.is_some());
            return self.answer(at, &field, end, &drive, step);
        }
        let new = new.zip(before).map(|(guess, (_, energy))| (energy, guess));
        self.leave::<L, R>(step, at, &field, end, new)
    }

    /// The Lipschitz bound of the force at the present contact, N/m: how far one step's |ΔF| may exceed nothing but
    /// |Δx| (MODEL 5, certificate L, at this one state). `None` in free space or where the slip equation has no
    /// stable root here, so that no bound exists.
    ///
    /// Not part of the step: a measuring instrument.
    pub fn lipschitz_n_per_m(&self, body: &ContactModel) -> Option<f64> {
        match self.state {
            State::Touching { at, tip } | State::Waiting { at, tip } => {
                sensitivity::lipschitz(body, self.law, self.rule, at, tip)
            }
            _ => None,
        }
    }

    /// Stage 1 of a tool that did not touch: the contact point of the first touch on its way, if there is one.
    #[inline(never)]
    fn onset<L: Lateral, R: Rule>(
        &mut self,
        step: &mut Step,
        from: DVec3,
        near: u32,
        hovering: bool,
    ) -> Option<SurfacePoint> {
        let (tip, radius) = (step.tip, self.law.radius_m);
        if let Some(touch) = step.first_touch(from, radius) {
            step.from = from + (tip - from) * touch.fraction;
            return Some(self.settle::<L, R>(step, touch.at));
        }
        if !hovering {
            let (clear, near) = step.clearance(near);
            self.state = State::after(Found::Clear { clear: self.clear(clear), near }, tip);
            return None;
        }
        step.from = from;
        let nearest = step.nearest()?;
        if self.is_clear(step, &nearest) { None } else { Some(nearest.at) }
    }

    /// How far from touch a tool is whose distance from the surface is at least this.
    fn clear(&self, distance: f64) -> f64 {
        // A little less: rounding must not skip a touch.
        (distance - self.law.radius_m) * (1.0 - 1e-9) - ON_SURFACE
    }

    /// Finds out on which side of the surface a tip is that did not come from outside. True if it is inside.
    #[cold]
    #[inline(never)]
    fn look_around<L: Lateral, R: Rule>(&mut self, step: &mut Step) -> bool {
        let Some(nearest) = step.nearest() else { return false };
        if self.is_clear(step, &nearest) {
            return false;
        }
        let near = nearest.at.element;
        let (mut site, mut at) = (Site::<L>::new(step.body, self.law, near), nearest.at);
        step.budget.evaluate();
        let mut field = site.evaluate(at.n, step.tip);
        let (kept, flags) = (self.kept(), step.flags);
        let (end, _) = self.slip::<L, R>(&mut site, &mut at, &mut field, step);
        self.restore(kept);
        step.flags = flags;
        let inside = field.depth > 0.0 || end == End::Border;
        // Inside stays inside until the tip has been as far as the surface.
        let clear = (self.law.radius_m - signed(&nearest)).abs();
        let found = if inside { Found::Under { clear } } else { Found::Near { near } };
        self.state = State::after(found, step.tip);
        inside
    }

    /// Whether the tool is outside and nothing is within its reach, as its nearest surface point tells: it is free then.
    fn is_clear(&mut self, step: &Step, nearest: &Nearest) -> bool {
        let near = nearest.at.element;
        if signed(nearest) - self.law.radius_m < -ON_SURFACE {
            return false;
        }
        let clear = self.clear(nearest.distance);
        self.state = State::after(Found::Clear { clear, near }, step.tip);
        if let State::Free { tip, .. } = &mut self.state
            && !nearest.outside
        {
            // On the surface up to rounding: from a hair above it, so that the next segment crosses it whole.
            *tip += step.body.outward(near) * (2.0 * ON_SURFACE);
        }
        true
    }

    /// A sphere's first touch is where the nearest point is at its radius, but the frame there is the interpolated
    /// one: the contact point slips to the friction limit, nearly 0 there, before anything counts. Where the frames
    /// lead it farther away than the tool reaches, it stays.
    fn settle<L: Lateral, R: Rule>(&self, step: &mut Step, at: SurfacePoint) -> SurfacePoint {
        if self.law.radius_m == 0.0 {
            return at;
        }
        let mut site = Site::<L>::new(step.body, self.law, at.element);
        step.budget.evaluate();
        let (mut settled, mut field) = (at, site.evaluate(at.n, step.from));
        let (start, tip, budget, mut pace) = (field.c, step.from, &mut step.budget, Pace::default());
        let drive = R::drive(&mut site, settled.n, &field);
        let (end, _) = slip::slip::<L, R>(&mut site, &mut settled, &mut field, drive, tip, &mut pace, budget);
        if end == End::Settled && field.c.distance(start) <= self.law.radius_m { settled } else { at }
    }

    /// Stage 2: the tool moves with the contact point held.
    #[inline(always)]
    fn stick<L: Lateral>(&mut self, site: &mut Site<L>, at: SurfacePoint, tip: DVec3) -> Field {
        let field = site.evaluate(at.n, tip);
        self.energy.stick(field.energy);
        field
    }

    /// Stage 3: the contact point moves with the tool held, until the lateral force is within the friction limit. Returns
    /// how that ended, and the drive there.
    #[inline(always)]
    fn slip<L: Lateral, R: Rule>(
        &mut self,
        site: &mut Site<L>,
        at: &mut SurfacePoint,
        field: &mut Field,
        step: &mut Step,
    ) -> (End, Drive) {
        let drive = R::first(site, at.n, field, self.guess.taken);
        if slip::within(&drive, field) {
            return (End::Settled, drive);
        }
        self.slide::<L, R>(site, at, field, drive, step)
    }

    /// Stage 3 where the drive is beyond the limit.
    #[inline]
    fn slide<L: Lateral, R: Rule>(
        &mut self,
        site: &mut Site<L>,
        at: &mut SurfacePoint,
        field: &mut Field,
        drive: Drive,
        step: &mut Step,
    ) -> (End, Drive) {
        let start = *at;
        let (pace, budget) = (&mut self.guess.pace, &mut step.budget);
        let (end, drive) = slip::slip::<L, R>(site, at, field, drive, step.tip, pace, budget);
        if !R::LATERAL {
            self.guess.taken = field.u_t * field.pull - drive.along * drive.force;
        }
        let (end, drive) = if self.tank && field.energy > self.allowed() && end != End::Border {
            (End::HeldBack, self.hold_back::<L, R>(site, start, at, field, step))
        } else {
            (end, drive)
        };
        self.energy.slip(field.energy);
        step.flags.set(Flags::SLIPPING, *at != start);
        (end, drive)
    }

    /// What a slip may raise W to, J: what is stored, and what the tank holds (LAW 3).
    #[inline(always)]
    fn allowed(&self) -> f64 {
        self.energy.stored_j + self.energy.tank_j.max(0.0)
    }

    /// A slip that led from `start` to `at`, where W is more than allowed, goes only as far as W allows: straight over the
    /// surface towards `at`, to the root of what W exceeds it by. Returns the drive there.
    #[cold]
    #[inline(never)]
    fn hold_back<L: Lateral, R: Rule>(
        &self,
        site: &mut Site<L>,
        start: SurfacePoint,
        at: &mut SurfacePoint,
        field: &mut Field,
        step: &mut Step,
    ) -> Drive {
        let (body, allowed) = (step.body, self.allowed());
        let way = field.c - body.point(start);
        let v = way.normalize_or_zero();
        // How far W is allowed for sure, by how much it stays below there, and where it is too much.
        let (mut low, mut below) = ((0.0, start), allowed - self.energy.stored_j);
        let (mut high, mut above) = (way.length(), field.energy - allowed);
        let from = match launch(body, start, |_| if step.budget.cross() { v } else { DVec3::ZERO }) {
            Launch::Along(there) => Some(there),
            _ => None,
        };
        for _ in 0..HOLDS {
            let Some(from) = from.filter(|_| below > 0.0 && !step.budget.is_spent()) else { break };
            // The Illinois secant; W is nearly a parabola along a slip.
            let far = low.0 + (high - low.0) * (below / (below + above));
            let rates = Rates::new(body.corners(from.element), v);
            let there = walk(body, from, v, far, rates, &mut step.budget).0;
            *field = step.read(site, there);
            let left = allowed - field.energy;
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
        *field = step.read(site, *at);
        R::drive(site, at.n, field)
    }

    /// After a wait at a patch's boundary: the contact point runs after the tool by no more than [`CATCH_UP`] times as far
    /// as the tool moves, so that the force does not jump by what it fell behind. `from` is where it was, and the ledger then.
    #[cold]
    #[inline(never)]
    fn catch_up<L: Lateral, R: Rule>(
        &mut self,
        (held, before): (SurfacePoint, Ledger),
        site: &mut Site<L>,
        at: &mut SurfacePoint,
        field: &mut Field,
        slipped: (End, Drive),
        step: &mut Step,
    ) -> (End, Drive) {
        let body = step.body;
        let (way, most) = (field.c - body.point(held), CATCH_UP * step.tip.distance(step.from));
        let v = way.normalize_or_zero();
        if way.length() <= most {
            return slipped;
        }
        *at = match launch(body, held, |_| v) {
            Launch::Along(there) => {
                let rates = Rates::new(body.corners(there.element), v);
                walk(body, there, v, most, rates, &mut step.budget).0
            }
            _ => held,
        };
        self.energy = before;
        self.energy.stick(step.read(site, held).energy);
        *field = step.read(site, *at);
        let drive = if self.tank && field.energy > self.allowed() {
            self.hold_back::<L, R>(site, held, at, field, step)
        } else {
            R::drive(site, at.n, field)
        };
        self.energy.slip(field.energy);
        (End::Fenced, drive)
    }

    /// Stage 4: no depth, or over the border. The contact has ended; or, if it is `new` in this step, it comes to nothing
    /// and what was before it is put back. What else lies on the way, or is within reach at its end, is tried.
    #[cold]
    #[inline(never)]
    fn leave<L: Lateral, R: Rule>(
        &mut self,
        step: &mut Step,
        at: SurfacePoint,
        field: &Field,
        end: End,
        new: Option<(Ledger, Guess)>,
    ) -> Output {
        let (body, tip) = (step.body, step.tip);
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
        let mut start = self.resting(body, at, field);
        for _ in 0..CROSSINGS {
            if nearest.outside && nearest.distance > tip.distance(start) {
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
        self.state = State::after(Found::Near { near: nearest.at.element }, tip);
        self.untouched(step.flags)
    }

    /// A contact at this place, if it has depth there. Else everything stays as it was, and the tool would have come to
    /// rest where it says.
    fn try_at<L: Lateral, R: Rule>(
        &mut self,
        step: &mut Step,
        mut at: SurfacePoint,
    ) -> Result<Output, DVec3> {
        let (kept, flags) = (self.kept(), step.flags);
        let mut site = Site::<L>::new(step.body, self.law, at.element);
        step.budget.evaluate();
        let mut field = site.evaluate(at.n, step.tip);
        let from_outside = (step.from - field.c).dot(field.u()) + self.law.radius_m <= 0.0;
        if from_outside {
            self.energy.stick(field.energy);
        } else {
            // The tool was this deep before: no work leads here, and the ledger says that the energy was generated.
            self.energy.slip(field.energy);
        }
        let (end, drive) = self.slip::<L, R>(&mut site, &mut at, &mut field, step);
        if field.depth > 0.0 && end != End::Border {
            let released = flags.has(Flags::RELEASED);
            step.flags.set(Flags::REANCHORED, released || !from_outside);
            step.flags.set(Flags::ONSET, !released);
            return Ok(self.answer(at, &field, end, &drive, step));
        }
        self.restore(kept);
        step.flags = flags;
        Err(self.resting(step.body, at, &field))
    }

    /// The tool's place where it just touches the contact point, a hair above.
    fn resting(&self, body: &ContactModel, at: SurfacePoint, field: &Field) -> DVec3 {
        field.c - field.u() * self.law.radius_m + body.outward(at.element) * (2.0 * ON_SURFACE)
    }

    fn kept(&self) -> (Ledger, Guess) {
        (self.energy, self.guess)
    }

    fn restore(&mut self, kept: (Ledger, Guess)) {
        (self.energy, self.guess) = kept;
    }

    /// Stage 5: the state for the next step, and the force.
    #[inline(always)]
    fn answer(
        &mut self,
        at: SurfacePoint,
        field: &Field,
        end: End,
        drive: &Drive,
        step: &mut Step,
    ) -> Output {
        let found = if end == End::Fenced { Found::Boundary { at } } else { Found::Depth { at } };
        self.state = State::after(found, step.tip);
        let flags = &mut step.flags;
        flags.set(Flags::IN_CONTACT, true);
        flags.set(Flags::BLOCKED, end == End::Blocked);
        flags.set(Flags::CAPPED, end == End::Capped);
        flags.set(Flags::FENCED, end == End::Fenced);
        flags.set(Flags::HELD_BACK, end == End::HeldBack);
        let cut = if matches!(end, End::Capped | End::Fenced) { cut(field, end, drive) } else { DVec3::ZERO };
        let mut force = cut - field.force();
        if !force.is_finite() {
            // The output choke point: nothing that is not a number leaves.
            flags.set(Flags::CONTAINED, true);
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
            flags: *flags,
            energy: self.energy,
        }
    }

    fn untouched(&self, flags: Flags) -> Output {
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
fn cut(field: &Field, end: End, drive: &Drive) -> DVec3 {
    let cut = drive.along * (drive.force - field.limit).max(0.0);
    if end != End::Fenced {
        return cut;
    }
    let (u, pull) = (field.u(), field.u_t * field.pull);
    let lateral = pull - (cut - u * cut.dot(u));
    pull - lateral * ((field.limit + field.normal) / lateral.length()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensitivity::tests::ball;

    /// On a spent budget the lateral force was cut to the limit even where the rule bounds another drive: off by all that
    /// W's slope along the surface takes from it, in one step.
    #[test]
    fn a_spent_budget_changes_the_force_by_no_more_than_the_step_could() {
        for (ratio, rule) in [1.0, 3.0].into_iter().flat_map(|ratio| SlipRule::ALL.map(|rule| (ratio, rule)))
        {
            let body = ball(ratio);
            let mut contact = Contact::with_slip(&body, rule, Ablation::None);
            let at = |angle: f64, depth: f64| {
                let p = DVec3::new(libm::sin(angle), 0.3 * libm::sin(angle), libm::cos(angle)).normalize();
                ToolState::at((p * (0.032 - depth)).to_array())
            };
            contact.step(&body, &at(0.0, -1e-3), 1e-3);
            for k in 0..400 {
                contact.step(&body, &at(1e-3 * f64::from(k), 1e-5 * f64::from(k.min(200))), 1e-3);
            }
            let (mut cut_short, mut differ) = (0, 0.0f64);
            for k in 0..300 {
                let pose = at(0.399 + 3e-6 * f64::from(k + 1), 2e-3);
                let mut short = contact.clone();
                short.budget = 8 + k % 12;
                let [a, b] = [short.step(&body, &pose, 1e-3), contact.step(&body, &pose, 1e-3)].map(|o| {
                    assert!(o.flags.has(Flags::IN_CONTACT) && !o.flags.has(Flags::BLOCKED));
                    (DVec3::from_array(o.force_n), o.flags.has(Flags::CAPPED))
                });
                assert!((a.0 - b.0).length() < 4e-4, "{rule:?} {k}: {} {}", a.0, b.0);
                cut_short += u32::from(a.1);
                let field = short.touching().map(|at| {
                    let mut site = Site::<Isotropic>::new(&body, short.law, at.element);
                    site.evaluate(at.n, DVec3::from_array(pose.position_m))
                });
                differ = differ.max(field.map_or(0.0, |f| f.pull - f.limit));
            }
            assert!(cut_short > 20, "{rule:?}: {cut_short}");
            // Cut to the limit, f_t itself would have been far off.
            assert!(rule != SlipRule::Consistent || differ > 1e-3, "{differ}");
        }
    }
}
