//! One tool on one body: a contact point, or two side by side where slip is partial.

use crate::coupled::Coupled;
use crate::decoupled::{Anisotropic, Isotropic};
use crate::drive::{Consistent, Exact, Paper, Rule};
use crate::flags::Flags;
use crate::force_law::ForceLaw;
use crate::kernel::{Ablation, Setting};
use crate::output::{Counters, Ledger, Output, ToolState};
use crate::point_contact::{Effort, Kept, PointContact};
use palpate_body::{Body, ContactModel, SlipRule, SurfacePoint};

/// The friction of two contact points side by side, in parts of the body's, each with half of the force: together they follow Mindlin's partial
/// slip of a ball, f_t/L = 1 − (1 − x)^1.5 at x = k_t δ/(1.5 L), by two straight lines for each of stick and slip's one.
///
/// Of what slips at x, −d²(f_t/L)/dx² ∝ (1 − x)^−½ is the density. A share q of it slips at x = 1 − q² or later, and slips there alone
/// at 1.5 x times its part of the limit: in the mean over q < ½ this is 11/8, over q > ½ 5/8.
pub const PARTIAL_SLIP: [f64; 2] = [11.0 / 8.0, 5.0 / 8.0];

/// What one of two contact points does not do alone.
const AS_A_WHOLE: Flags = Flags::of_two(Flags::BORDER, Flags::STARTED_INSIDE);

/// All that evolves while one tool touches one body: fixed in size, without a pointer to the body.
///
/// Every step must be given the body that the contact was made for, or a patch of it ([`ContactModel::identity`]): on another
/// there is no force, and the step says so ([`Flags::OTHER_BODY`]). A contact that slips by `consistent` on a body whose
/// gradients nobody has prepared counts that ([`Counters::without_gradients`]).
///
/// # Partial slip
/// Under a ball friction gives way ring by ring, from the rim inwards (Mindlin 1949). Where the body asks for it, the contact
/// is two contact points side by side that hold half of the force each, one by 11/8, one by 5/8 of the friction: the force is
/// their mean, and so are the energies. Either is a contact of its own, with a tank of its own, so that all that holds for
/// one holds for the mean. But the surface's border ends both in the step in which it ends one, and as long as the tool counts as
/// inside for one it does for both. [`Output::contact`] and [`Contact::touching`] tell the one that holds longer, as the middle of the
/// ball does, or else the one that touches.
#[derive(Debug, Clone)]
pub struct Contact {
    /// Of the body it is for.
    body: u64,
    rule: SlipRule,
    friction_scale: f64,
    counters: Counters,
    partial_slip: bool,
    /// The second counts where slip is partial.
    points: [PointContact; 2],
}

impl Contact {
    /// A contact on `body`, with the slip rule and the tool that the body names.
    ///
    /// Prepares the body for its rule, unless that was done before: see [`Body::prepare`].
    pub fn new(body: &Body) -> Self {
        Self::with_ablation(body, Ablation::None)
    }

    /// The same with interpolations switched off, as in the paper's section 5.
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
        let setting = Setting::new(ablation, model.tool().radius_m());
        let point = PointContact::new(setting, model.has_tank());
        let contact = Contact {
            body: model.identity(),
            rule,
            friction_scale: 1.0,
            counters: Counters::default(),
            partial_slip: false,
            points: [point.clone(), point],
        };
        contact.with_partial_slip(model.has_partial_slip())
    }

    /// The same with the tank that keeps slip from giving out energy, or without: see [`Ledger::tank_j`].
    pub fn with_tank(mut self, tank: bool) -> Self {
        self.points.iter_mut().for_each(|point| point.set_tank(tank));
        self
    }

    /// Whether slip is kept from giving out energy: see [`Ledger::tank_j`].
    pub fn has_tank(&self) -> bool {
        let [first, _] = &self.points;
        first.has_tank()
    }

    /// The same with two contact points side by side, or with one. Switch it in free space: in touch, both begin where the one is, and of
    /// two the one that holds longer stays, or else the one that touches; force and energies may step to those of the one that
    /// stays, since it was half of the contact.
    pub fn with_partial_slip(mut self, partial_slip: bool) -> Self {
        let [first, second] = &mut self.points;
        if partial_slip && !self.partial_slip {
            second.clone_from(first);
        } else if self.partial_slip
            && !partial_slip
            && first.touching().is_none()
            && second.touching().is_some()
        {
            first.clone_from(second);
        }
        self.partial_slip = partial_slip;
        self.set_friction_scale(self.friction_scale);
        self
    }

    /// Whether there are two contact points side by side.
    pub fn has_partial_slip(&self) -> bool {
        self.partial_slip
    }

    /// Goes over to another slip rule, which the body must have been prepared for.
    pub fn set_slip_rule(&mut self, rule: SlipRule) {
        if rule != self.rule {
            self.rule = rule;
            self.points.iter_mut().for_each(PointContact::change_rule);
        }
    }

    /// Multiplies the body's friction coefficients, from the next step on; 1 at first. Negative and what is no number count as 0.
    pub fn set_friction_scale(&mut self, scale: f64) {
        self.friction_scale = if scale > 0.0 && scale.is_finite() { scale } else { 0.0 };
        let shares = if self.partial_slip { PARTIAL_SLIP } else { [1.0; 2] };
        for (point, share) in self.points.iter_mut().zip(shares) {
            point.set_friction_scale(share * self.friction_scale);
        }
    }

    /// What the body's friction coefficients are multiplied by.
    pub fn friction_scale(&self) -> f64 {
        self.friction_scale
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
    pub fn energy(&self) -> Ledger {
        let [first, second] = &self.points;
        if self.partial_slip { first.energy().mean(second.energy()) } else { *first.energy() }
    }

    /// The surface point that the tool touches, if it does.
    pub fn touching(&self) -> Option<SurfacePoint> {
        self.contact_points().next()
    }

    /// The surface points that the tool touches: of partial slip there may be two, and the first is that of [`Contact::touching`].
    pub fn contact_points(&self) -> impl Iterator<Item = SurfacePoint> {
        self.points().iter().filter_map(PointContact::touching)
    }

    /// Where the tool was last seen, m: from there the next step looks for a touch. `None` before the first pose, and while
    /// the tool is inside without touching.
    pub fn last_position_m(&self) -> Option<[f64; 3]> {
        self.points().iter().find_map(PointContact::last_position).map(|p| p.to_array())
    }

    /// Goes over to another copy of the same surface, such as another [`Patch`](palpate_body::Patch), in which the elements
    /// have the numbers that `renumber` gives. False, and nothing is changed, if the tool touches an element that has none.
    ///
    /// # Real-time
    /// As bounded as `renumber`.
    pub fn renumber(&mut self, renumber: impl Fn(u32) -> Option<u32>) -> bool {
        let mut points = self.points.clone();
        let count = 1 + usize::from(self.partial_slip);
        let known = points.iter_mut().take(count).all(|point| point.renumber(&renumber));
        if known {
            self.points = points;
        }
        known
    }

    /// Forgets where the tool was: the next pose counts as the first one, and a tool that is then inside the body feels
    /// nothing until it has left it. What was stored is booked as dissipated.
    ///
    /// # Real-time
    /// O(1).
    pub fn forget(&mut self) {
        self.points.iter_mut().for_each(PointContact::forget);
    }

    /// One sample: where the tool is and how long after the last one (s, finite and not negative), and out comes the force
    /// on it. Nothing depends on the time yet.
    ///
    /// # Real-time
    /// Bounded ([`Counters::evaluations`]); never allocates, locks, logs, reads a clock or a file, or panics. In free space it
    /// costs a distance comparison until the tool has used up the clearance that the last query found.
    pub fn step(&mut self, body: &ContactModel, tool: &ToolState, dt_s: f64) -> Output {
        self.step_of(body, tool, dt_s, true)
    }

    /// The same on a part of a body that knows all that a tool at a place that it `knows` may touch. What touches takes its step
    /// anywhere: at the part's end the contact point waits. What is free must be where the body is known, and must have been there the
    /// step before: the way between is then known too. What came from elsewhere is forgotten, and inside the body feels nothing
    /// until it has left it. Of two contact points the free one waits beside the one that touches; `None` where both, or the only
    /// one, must.
    ///
    /// # Real-time
    /// As [`Contact::step`], and up to three times `knows`.
    pub fn step_where(
        &mut self,
        body: &ContactModel,
        tool: &ToolState,
        dt_s: f64,
        knows: impl Fn([f64; 3]) -> bool,
    ) -> Option<Output> {
        if self.points().iter().all(|point| point.touching().is_some()) {
            return Some(self.step(body, tool, dt_s));
        }
        // NaN and infinity are the step's to refuse.
        if !knows(tool.position_m) && tool.position_m.iter().all(|x| x.is_finite()) {
            return self.touching().is_some().then(|| self.step_in_touch(body, tool, dt_s));
        }
        let count = self.points().len();
        for point in self.points.iter_mut().take(count).filter(|point| point.touching().is_none()) {
            if point.last_position().is_some_and(|from| !knows(from.to_array())) {
                point.forget();
            }
        }
        Some(self.step(body, tool, dt_s))
    }

    /// A step of what touches alone.
    #[cold]
    #[inline(never)]
    fn step_in_touch(&mut self, body: &ContactModel, tool: &ToolState, dt_s: f64) -> Output {
        self.step_of(body, tool, dt_s, false)
    }

    /// A step, of contact points that don't touch only if the `free` ones take one.
    #[inline(always)]
    fn step_of(&mut self, body: &ContactModel, tool: &ToolState, dt_s: f64, free: bool) -> Output {
        if body.is_coupled() {
            return match self.rule {
                SlipRule::Consistent => self.step_as::<Coupled, Consistent>(body, tool, dt_s, free),
                SlipRule::Exact => self.step_as::<Coupled, Exact>(body, tool, dt_s, free),
                _ => self.step_as::<Coupled, Paper>(body, tool, dt_s, free),
            };
        }
        match (self.rule, body.is_isotropic()) {
            (SlipRule::Consistent, true) => self.step_as::<Isotropic, Consistent>(body, tool, dt_s, free),
            (SlipRule::Consistent, false) => self.step_as::<Anisotropic, Consistent>(body, tool, dt_s, free),
            (SlipRule::Exact, true) => self.step_as::<Isotropic, Exact>(body, tool, dt_s, free),
            (SlipRule::Exact, false) => self.step_as::<Anisotropic, Exact>(body, tool, dt_s, free),
            (_, true) => self.step_as::<Isotropic, Paper>(body, tool, dt_s, free),
            (_, false) => self.step_as::<Anisotropic, Paper>(body, tool, dt_s, free),
        }
    }

    /// Apart from the choice between them, which is a jump.
    #[inline(never)]
    fn step_as<L: ForceLaw, R: Rule>(
        &mut self,
        body: &ContactModel,
        tool: &ToolState,
        dt_s: f64,
        free: bool,
    ) -> Output {
        self.counters.steps += 1;
        let mut flags = Flags::default();
        if !(0.0..f64::INFINITY).contains(&dt_s) {
            flags.set(Flags::INVALID_TIME, true);
        }
        let Some(tool_position) = tool.accept().filter(|_| body.identity() == self.body) else {
            flags.set(Flags::INVALID_POSE, tool.accept().is_none());
            flags.set(Flags::OTHER_BODY, body.identity() != self.body);
            flags.set(Flags::IN_CONTACT, self.touching().is_some());
            self.counters.count(flags);
            return Output { flags, energy: self.energy(), ..Output::default() };
        };
        let mut effort = Effort::default();
        let [first, second] = &mut self.points;
        let output = if self.partial_slip {
            let mut step = |point: &mut PointContact| {
                if free || point.touching().is_some() {
                    point.step::<L, R>(body, tool_position, flags, &mut effort)
                } else {
                    point.untouched(flags)
                }
            };
            let before = [first.kept_if_free(), second.kept_if_free()];
            let (one, other) = (step(first), step(second));
            let touched = before.map(|kept| kept.is_none());
            if (one.flags | other.flags).has(AS_A_WHOLE) {
                self.end_as_a_whole(before, [one, other])
            } else {
                one.mean(&other, touched)
            }
        } else {
            first.step::<L, R>(body, tool_position, flags, &mut effort)
        };
        self.counters.count(output.flags);
        self.counters.take(effort);
        if !R::is_ready(body) {
            self.counters.without_gradients += u64::from(output.flags.has(Flags::IN_CONTACT));
        }
        output
    }

    /// One of two contact points went over the border, or is inside, in a step that ended with these `outputs`: the other one goes
    /// with it, whatever it found. `before` is what it was like if it did not touch.
    #[cold]
    #[inline(never)]
    fn end_as_a_whole(&mut self, before: [Option<Kept>; 2], outputs: [Output; 2]) -> Output {
        let [first, second] = &mut self.points;
        let [kept_first, kept_second] = before;
        let [one, other] = outputs;
        let Output { mut flags, .. } = if one.flags.has(AS_A_WHOLE) {
            second.end_with(first, kept_second);
            one
        } else {
            first.end_with(second, kept_first);
            other
        };
        let touched = kept_first.is_none() || kept_second.is_none();
        flags.set(Flags::RELEASED, touched);
        Output { flags, energy: first.energy().mean(second.energy()), ..Output::default() }
    }

    /// The Lipschitz bound of the force at the present contact, N/m: how far one step's |ΔF| may exceed nothing but
    /// |Δx| (MODEL 5, certificate L, at this one state). `None` in free space or where the slip equation has no
    /// stable root here, so that no bound exists.
    ///
    /// Not part of the step: a measuring instrument.
    pub fn lipschitz_n_per_m(&self, body: &ContactModel) -> Option<f64> {
        self.touching()?;
        let points = self.points();
        // What does not touch has no force.
        let bounds = points.iter().map(|point| match point.touching() {
            Some(_) => point.lipschitz(body, self.rule),
            None => Some(0.0),
        });
        bounds.sum::<Option<f64>>().map(|sum| sum / points.len() as f64)
    }

    /// Those that count.
    fn points(&self) -> &[PointContact] {
        let [first, _] = &self.points;
        if self.partial_slip { &self.points } else { std::slice::from_ref(first) }
    }
}
