//! Slip: at a fixed tool position, the contact point moves until the drive is within the friction limit (paper, section 3.2;
//! MODEL 4). One search for all rules, compiled for each of them.

use crate::budget::Budget;
use crate::drive::{Drive, Rule};
use crate::flags::Flags;
use crate::force_law::ForceLaw;
use crate::kernel::{ElementKernel, Evaluation};
use crate::walk::{Pull, StartDirection, Stop, start_direction, walk};
use glam::{DMat3, DVec3};
use palpate_body::SurfacePoint;
use std::marker::PhantomData;

/// A bracket of the search is closed at this length, m: far below touch, far above the rounding of coordinates.
const CLOSED: f64 = 1e-12;

/// How a slip ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// Within the limit.
    Settled,
    /// Held by an edge or vertex.
    Blocked,
    /// Over the border.
    Border,
    /// Where W had risen by as much as the tank held.
    HeldBack,
    /// At the edge of a patch, where the contact point waits for the next patch.
    PatchBoundary,
    /// The step's budget is spent.
    Capped,
}

impl End {
    /// What a step that ends so reports.
    #[inline(always)]
    pub(crate) fn flags(self) -> Flags {
        match self {
            End::Settled | End::Border => Flags::default(),
            End::Blocked => Flags::BLOCKED,
            End::HeldBack => Flags::HELD_BACK,
            End::PatchBoundary => Flags::PATCH_BOUNDARY,
            End::Capped => Flags::CAPPED,
        }
    }
}

/// The contact point's displacement for each newton of drive in the last slips of a contact, m/N; 0 where there was none.
///
/// From one step of a drag to the next this changes smoothly: extrapolated from the last three values it nearly always
/// saves the search its derivative, and often an iterate. It is a first guess and no more.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ComplianceEstimate([f64; 3]);

impl ComplianceEstimate {
    #[inline]
    fn guess(self) -> f64 {
        let [a, b, c] = self.0;
        let smooth = (a - b).abs() < 0.02 * a && (b - c).abs() < 0.02 * a;
        if smooth { 3.0 * (a - b) + c } else { a }
    }

    #[inline]
    fn learn(&mut self, compliance: f64) {
        self.0 = [compliance, self.0[0], self.0[1]];
    }
}

/// The contact point's displacement for a change of the drive, ∂c/∂d, from the iterates of a Newton search: Broyden's second method.
///
/// Where friction is small, c goes to where the drive vanishes in both directions of the plane, and they are not equally
/// stiff on a curved surface: the scalar secant alone would zigzag.
struct InverseJacobian(DMat3);

impl InverseJacobian {
    #[inline(always)]
    fn new(compliance: f64) -> Self {
        InverseJacobian(DMat3::from_diagonal(DVec3::splat(compliance)))
    }

    /// The displacement that would cancel this drive.
    #[inline]
    fn displacement(&self, drive: DVec3) -> DVec3 {
        self.0 * drive
    }

    /// The way `gone` has taken away `drop`.
    #[inline]
    fn learn(&mut self, gone: DVec3, drop: DVec3) {
        let p = (gone - self.displacement(drop)) * (1.0 / drop.length_squared());
        self.0 += DMat3::from_cols(p * drop.x, p * drop.y, p * drop.z);
    }
}

/// The slip search: the contact point, the law evaluated there, and what is left of the step's budget.
struct Search<'s, 'a, L: ForceLaw, R> {
    rule: PhantomData<R>,
    kernel: &'s mut ElementKernel<'a, L>,
    tool_position: DVec3,
    at: &'s mut SurfacePoint,
    evaluation: &'s mut Evaluation,
    /// The drive there.
    drive: Drive,
    /// How far beyond the limit the drive was at first, N.
    first_excess: f64,
    estimate: &'s mut ComplianceEstimate,
    budget: &'s mut Budget,
}

/// Moves the contact point from `at`, where the law reads `evaluation` and the rule `drive`, beyond the limit. `kernel` is at's element. Returns
/// how it ended, and the drive there.
#[inline]
pub(crate) fn slip<L: ForceLaw, R: Rule>(
    kernel: &mut ElementKernel<L>,
    at: &mut SurfacePoint,
    evaluation: &mut Evaluation,
    drive: Drive,
    tool_position: DVec3,
    estimate: &mut ComplianceEstimate,
    budget: &mut Budget,
) -> (End, Drive) {
    let first_excess = drive.force - evaluation.limit;
    let mut search = Search {
        rule: PhantomData::<R>,
        kernel,
        tool_position,
        at,
        evaluation,
        drive,
        first_excess,
        estimate,
        budget,
    };
    (search.run(), search.drive)
}

impl<L: ForceLaw, R: Rule> Search<'_, '_, L, R> {
    /// From a drive that is beyond the limit.
    fn run(&mut self) -> End {
        let mut stalled = 0;
        loop {
            if self.budget.is_spent() {
                return End::Capped;
            }
            let v = match self.start_direction() {
                Ok(v) => v,
                Err(end) => return end,
            };
            let start = *self.at;
            if self.newton(v, self.estimate.guess()) || self.newton_anew(start, v) {
                stalled = 0;
            } else {
                self.back_to(start);
                // Two sides that send the point back to each other make no progress.
                stalled = if self.line(v) < CLOSED { stalled + 1 } else { 0 };
                if stalled > 2 {
                    return End::Blocked;
                }
            }
            let excess = self.drive.force - self.evaluation.limit;
            if excess <= self.tolerance() || self.drive.step_bound <= NO_DEFLECTION {
                return End::Settled;
            }
        }
    }

    /// How near the limit the search may end, N: [`tolerance`], or what is small against both the limit
    /// and the excess that the slip began with. On a fine mesh the first iterate mostly comes that near.
    ///
    /// The next step begins with what is left: nothing adds up, and a tool at rest is soon within
    /// [`tolerance`]. With the paper's rule it always is.
    #[inline(always)]
    fn tolerance(&self) -> f64 {
        let least = tolerance(&self.drive, self.evaluation);
        if R::LATERAL {
            return least;
        }
        least.max((OF_EXCESS * self.first_excess).min(OF_LIMIT * self.evaluation.limit))
    }

    /// With the slope of the law itself, where the guess led nowhere.
    #[cold]
    #[inline(never)]
    fn newton_anew(&mut self, start: SurfacePoint, v: DVec3) -> bool {
        self.back_to(start);
        let eta = self.eta(v);
        self.newton(v, 1.0 / eta)
    }

    /// The drive's direction from here, if it can move: the contact point may lie on an edge or a vertex.
    #[inline]
    fn start_direction(&mut self) -> Result<DVec3, End> {
        let drive = self.drive;
        if self.at.n[0] != 0.0 && self.at.n[1] != 0.0 && self.at.n[2] != 0.0 {
            return Ok(self.implicit_direction());
        }
        let (body, setting, tool_position, budget) =
            (self.kernel.body, self.kernel.setting, self.tool_position, &mut *self.budget);
        let start =
            if R::CONTINUOUS && setting.is_continuous() && !body.has_creases() {
                let pull = drive.pull(R::motion(self.kernel, self.at.n, self.evaluation));
                start_direction(body, *self.at, |_| {
                    if budget.cross() { pull } else { Pull::straight(DVec3::ZERO) }
                })
            } else {
                start_direction(body, *self.at, |there| {
                    if budget.is_spent() {
                        return Pull::straight(DVec3::ZERO);
                    }
                    budget.evaluate();
                    let mut kernel = ElementKernel::<L>::new(body, setting, there.element);
                    let evaluation = kernel.evaluate(there.n, tool_position);
                    let drive = R::drive(&mut kernel, there.n, &evaluation);
                    drive.pull(R::motion(&kernel, there.n, &evaluation))
                })
            };
        // Not all of the directions were tried.
        if self.budget.is_spent() {
            return Err(End::Capped);
        }
        let (there, v) = match start {
            StartDirection::Held => return Err(End::Blocked),
            StartDirection::Border => return Err(End::Border),
            StartDirection::PatchBoundary => return Err(End::PatchBoundary),
            // On an edge only the component along it drives.
            StartDirection::Edge(_, along)
                if within(&Drive { force: self.component(along), ..drive }, self.evaluation) =>
            {
                return Err(End::Blocked);
            }
            StartDirection::Edge(there, along) => (there, Some(along)),
            StartDirection::Along(there) => (there, None),
        };
        if there.element != self.at.element {
            *self.at = there;
            self.evaluate_again();
        }
        Ok(v.unwrap_or(self.drive.way))
    }

    /// The implicit step's direction.
    #[inline(always)]
    fn implicit_direction(&self) -> DVec3 {
        if R::LATERAL {
            self.kernel.implicit_direction(self.evaluation)
        } else {
            self.kernel.implicit_drive_direction(self.at.n, self.evaluation, &self.drive)
        }
    }

    /// Newton's method on f_r − L, each time along the current drive; the first time with the reciprocal slope
    /// `compliance`, m/N, then with the secant's. Two or three evaluations where the body is smooth. False if it does not
    /// close in, and a slower search has to do.
    ///
    /// Its first iterate with the slope f_r' would be the paper's |δr − δs|.
    #[inline(always)]
    fn newton(&mut self, v: DVec3, compliance: f64) -> bool {
        // Slopes between a tenth and ten times f_r' are accepted; and c never has to run much farther than δr.
        let (stiffness, farthest) = (self.evaluation.lateral_slope, 1.5 * self.drive.step_bound);
        let believable = |compliance: f64| compliance * stiffness < 10.0 && compliance * stiffness > 0.1;
        let (mut v, mut compliance, mut travelled) = (v, compliance, 0.0);
        let first = self.component(v) - self.evaluation.limit;
        let energy = self.evaluation.energy;
        let mut excess = first;
        // The paper's rule has the scalar secant alone.
        let bent = L::COUPLED || (L::ISOTROPIC && !R::LATERAL);
        // From the second iterate on: mostly there is none.
        let mut answer = None;
        let mut residual = self.drive.along * first;
        while !self.budget.is_spent() && believable(compliance) && excess * compliance <= farthest {
            let displacement = excess * compliance;
            let rates = self.kernel.rates(v * displacement.signum());
            let mut stop = Stop::Reached;
            match rates.inside(self.at.n, displacement.abs()) {
                Some(n) => self.at.n = n,
                None => {
                    let v = v * displacement.signum();
                    (*self.at, _, stop) =
                        walk(self.kernel.body, *self.at, v, displacement.abs(), rates, self.budget);
                }
            }
            self.evaluate();
            travelled += displacement;
            // Projected on the old drive: past the root it has changed sides where L is nearly 0.
            let seen = self.drive.force * self.drive.along.dot(v) - self.evaluation.limit;
            let now = self.drive.force - self.evaluation.limit;
            if R::PASSIVE && raised(self.evaluation, energy) {
                return false;
            }
            // Past the tool, |f_r| = L has a second root: there friction would push.
            if self.drive.along.dot(v) < 0.0
                && self.evaluation.limit > tolerance(&self.drive, self.evaluation)
            {
                return false;
            }
            if now.abs() <= self.tolerance() {
                // What is left would be closed by one more iterate: learn as if it had been.
                if now.abs() < 0.1 * first {
                    self.estimate.learn((travelled + now * compliance) / first);
                }
                return true;
            }
            if stop != Stop::Reached {
                // A guess that ran into an edge from which the drive is within the limit has gone too far.
                return now > 0.0;
            }
            if now.abs() > if bent { 2.0 } else { 0.5 } * excess.abs() {
                return false;
            }
            if bent {
                let left = self.drive.along * now;
                let answer = answer.get_or_insert_with(|| InverseJacobian::new(compliance));
                answer.learn(v * displacement, residual - left);
                let next = answer.displacement(left);
                let length = next.length();
                if !(length > 0.0 && length.is_finite()) {
                    return false;
                }
                (residual, excess, compliance) = (left, now, length / now.abs());
                v = next * (now.signum() / length);
                continue;
            }
            compliance = displacement / (excess - seen);
            (v, excess) = if L::ISOTROPIC {
                (self.drive.along, now)
            } else {
                let implicit_direction = self.implicit_direction();
                compliance *= self.kernel.slope_ratio(self.at.n, v, implicit_direction);
                (
                    implicit_direction,
                    self.drive.force * self.drive.along.dot(implicit_direction) - self.evaluation.limit,
                )
            };
        }
        false
    }

    /// Walks along the projection of `v` to where the drive's component along v meets the limit, or as far as the
    /// surface lets it. Returns how far it went.
    ///
    /// The root is sought on the **signed** component f_r (u_t·v) − L: |δ_t| never falls below zero, so that the
    /// root would be missed wherever L ≈ 0, as at every onset.
    #[cold]
    #[inline(never)]
    fn line(&mut self, v: DVec3) -> f64 {
        let energy = self.evaluation.energy;
        let excess = |component: f64, d: &Drive, f: &Evaluation| {
            let excess = component - f.limit;
            // Beyond an energy maximum, into another minimum: too far, whatever the drive says there.
            if R::PASSIVE && raised(f, energy) { -excess.abs() - 2.0 * tolerance(d, f) } else { excess }
        };
        let (mut s, mut g) = (0.0, excess(self.component(v), &self.drive, self.evaluation));
        if g <= 0.0 {
            return 0.0;
        }
        // Largest s with g > 0 and the least with g < 0, and where they are.
        let mut low = (0.0, *self.at);
        let mut high: Option<(f64, SurfacePoint)> = None;
        let eta = self.eta(v);
        let slope =
            if eta > 0.1 * self.evaluation.lateral_slope { eta } else { self.evaluation.lateral_slope };
        // On a curve that has gone flat the slope leads far away; the root lies within about δr.
        let mut target = (g / slope).min(self.drive.step_bound);
        let mut tries = 0;
        while !self.budget.is_spent() {
            let displacement = target - s;
            let along = v * displacement.signum();
            let rates = self.kernel.rates(along);
            let (at, walked, stop) =
                walk(self.kernel.body, *self.at, along, displacement.abs(), rates, self.budget);
            *self.at = at;
            self.evaluate_again();
            let (s_before, g_before) = (s, g);
            s += walked * displacement.signum();
            g = excess(self.component(v), &self.drive, self.evaluation);
            tries += 1;
            if g.abs() <= tolerance(&self.drive, self.evaluation) {
                return s;
            }
            if g > 0.0 {
                low = (s, *self.at);
                if stop != Stop::Reached && displacement > 0.0 {
                    return s;
                }
            } else {
                high = Some((s, *self.at));
                if self.budget.is_spent() {
                    // No way left to close in: rather too little than too far.
                    break;
                }
            }
            let secant = s - g * (s - s_before) / (g - g_before);
            target = match high {
                Some((end, there)) if end - low.0 <= CLOSED => {
                    // A jump of the frame or the response: rest on its far side, within the limit.
                    *self.at = if R::CONTINUOUS { there } else { on_edge(there, self.kernel.corners()) };
                    self.evaluate_again();
                    return end;
                }
                Some((end, _)) if secant > low.0 && secant < end && tries < 6 => secant,
                Some((end, _)) => 0.5 * (low.0 + end),
                None if secant > s && secant < s + 8.0 * displacement => secant,
                None => s + 2.0 * displacement.abs(),
            };
        }
        *self.at = low.1;
        self.evaluate_again();
        low.0
    }

    /// The drive while the contact point goes along `v`, N.
    #[inline(always)]
    fn component(&self, v: DVec3) -> f64 {
        // Known without M.
        if v == self.drive.way && v != self.drive.along {
            return self.drive.force;
        }
        self.drive.force * self.drive.pull(R::motion(self.kernel, self.at.n, self.evaluation)).along(v)
    }

    /// How fast slip along `v` takes the drive to its limit, N/m.
    #[inline]
    fn eta(&mut self, v: DVec3) -> f64 {
        self.budget.evaluate();
        self.kernel.drift(self.at.n, self.evaluation, v).eta
    }

    #[inline(always)]
    fn evaluate(&mut self) {
        self.budget.evaluate();
        if self.kernel.element != self.at.element {
            self.kernel.move_to(self.at.element);
        }
        *self.evaluation = self.kernel.evaluate(self.at.n, self.tool_position);
        self.drive = R::drive(self.kernel, self.at.n, self.evaluation);
    }

    /// The same off the fast path.
    #[cold]
    #[inline(never)]
    fn evaluate_again(&mut self) {
        self.evaluate();
    }

    #[cold]
    #[inline(never)]
    fn back_to(&mut self, at: SurfacePoint) {
        if *self.at != at {
            *self.at = at;
            self.evaluate();
        }
    }
}

/// The same point, put on the edge that it is no farther from than a closed bracket, so that its search goes on along
/// the edge. Anything farther away than that may lie higher in the energy.
#[cold]
fn on_edge(at: SurfacePoint, [p, q, r]: [DVec3; 3]) -> SurfacePoint {
    let twice_area = (q - p).cross(r - p).length();
    let edges = [r - q, p - r, q - p].map(DVec3::length);
    // n times the height over the edge is the distance from it.
    let mut n = at.n;
    for (n, edge) in n.iter_mut().zip(edges) {
        if *n * twice_area <= 2.0 * CLOSED * edge {
            *n = 0.0;
        }
    }
    let per = 1.0 / (n[0] + n[1] + n[2]);
    SurfacePoint { n: n.map(|n| n * per), ..at }
}

/// Whether the energy has risen above `energy` by more than rounding.
#[inline]
fn raised(evaluation: &Evaluation, energy: f64) -> bool {
    evaluation.energy > energy + energy.abs() * 1e-14
}

/// Whether a drive is within the limit, up to [`tolerance`].
#[inline]
pub(crate) fn within(drive: &Drive, evaluation: &Evaluation) -> bool {
    drive.force - evaluation.limit <= tolerance(drive, evaluation) || drive.step_bound <= NO_DEFLECTION
}

/// A displacement below this is rounding, m.
const NO_DEFLECTION: f64 = 1e-12;

/// The part of a slip's first excess that may be left: the force's error falls with the tool's stride.
const OF_EXCESS: f64 = 1e-3;

/// The part of the limit that may be left, whatever the stride. The certificates' slip states reach as far.
pub(crate) const OF_LIMIT: f64 = 1e-4;

/// 10⁻⁶ of the limit, a micronewton of a newton, [`NO_DEFLECTION`], and the drive's rounding, N.
#[inline]
fn tolerance(drive: &Drive, evaluation: &Evaluation) -> f64 {
    1e-6 * evaluation.limit + NO_DEFLECTION * evaluation.lateral_slope + drive.noise
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the element's size: what the bracket closed on is the edge, and nothing else is.
    #[test]
    fn a_point_is_put_on_an_edge_that_its_bracket_closed_on() {
        for size in [1e-6, 5e-3, 1.0] {
            let corners = [DVec3::ZERO, DVec3::X * size, DVec3::new(0.3, 0.8, 0.0) * size];
            // Over the edge from corner 0 to corner 1, in the height of corner 2.
            let off = |distance: f64| {
                let n = distance / (0.8 * size);
                on_edge(SurfacePoint { element: 0, n: [0.4 - n, 0.6, n] }, corners).n
            };
            assert_eq!(off(CLOSED)[2], 0.0, "{size}");
            assert!(off(4.0 * CLOSED)[2] > 0.0, "{size}");
            assert!((off(CLOSED).iter().sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }
}
