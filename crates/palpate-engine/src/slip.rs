//! Slip: at a fixed tip, the contact point moves until the drive is within the friction limit (paper, section 3.2;
//! MODEL 4). One search for all rules, compiled for each of them.

use crate::budget::Budget;
use crate::drive::{Drive, Rule};
use crate::field::{Field, Site};
use crate::lateral::Lateral;
use crate::walk::{Launch, Stop, launch, walk};
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
    /// At the edge of a patch, where it waits for the next.
    Fenced,
    /// The step's budget is spent.
    Capped,
}

/// How far the contact point ran for each newton of drive in the last slips of a contact, m/N; 0 where there was none.
///
/// From one step of a drag to the next this changes smoothly: drawn on through the last three values it nearly always
/// saves the search its derivative, and often an iterate. It is a first guess and no more.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pace([f64; 3]);

impl Pace {
    #[inline]
    fn guess(self) -> f64 {
        let [a, b, c] = self.0;
        let smooth = (a - b).abs() < 0.02 * a && (b - c).abs() < 0.02 * a;
        if smooth { 3.0 * (a - b) + c } else { a }
    }

    #[inline]
    fn learn(&mut self, ease: f64) {
        self.0 = [ease, self.0[0], self.0[1]];
    }
}

/// How c answers to the drive, ∂c/∂d, from the iterates of a Newton search: Broyden's second method.
///
/// Where friction is small, c goes to where the drive vanishes in both directions of the plane, and they are not equally
/// stiff on a curved surface: the scalar secant alone would zigzag.
struct Answer(DMat3);

impl Answer {
    #[inline(always)]
    fn new(ease: f64) -> Self {
        Answer(DMat3::from_diagonal(DVec3::splat(ease)))
    }

    /// The way that would take away a drive of this much.
    #[inline]
    fn way(&self, drive: DVec3) -> DVec3 {
        self.0 * drive
    }

    /// The way `gone` has taken away `drop`.
    #[inline]
    fn learn(&mut self, gone: DVec3, drop: DVec3) {
        let p = (gone - self.way(drop)) * (1.0 / drop.length_squared());
        self.0 += DMat3::from_cols(p * drop.x, p * drop.y, p * drop.z);
    }
}

/// The slip search: where the contact point is, what the law reads there, and what is left of the step's budget.
struct Search<'s, 'a, L: Lateral, R> {
    rule: PhantomData<R>,
    site: &'s mut Site<'a, L>,
    tip: DVec3,
    at: &'s mut SurfacePoint,
    field: &'s mut Field,
    /// As the rule reads it there.
    drive: Drive,
    pace: &'s mut Pace,
    budget: &'s mut Budget,
}

/// Lets the contact point run from `at`, where the law reads `field` and the rule `drive`. `site` is at's element. Returns
/// how it ended, and the drive there.
#[inline]
pub(crate) fn slip<L: Lateral, R: Rule>(
    site: &mut Site<L>,
    at: &mut SurfacePoint,
    field: &mut Field,
    drive: Drive,
    tip: DVec3,
    pace: &mut Pace,
    budget: &mut Budget,
) -> (End, Drive) {
    let mut search = Search { rule: PhantomData::<R>, site, tip, at, field, drive, pace, budget };
    (search.run(), search.drive)
}

impl<L: Lateral, R: Rule> Search<'_, '_, L, R> {
    fn run(&mut self) -> End {
        let mut stalled = 0;
        while !within(&self.drive, self.field) {
            if self.budget.is_spent() {
                return End::Capped;
            }
            let v = match self.launch() {
                Ok(v) => v,
                Err(end) => return end,
            };
            let start = *self.at;
            if self.newton(v, self.pace.guess()) {
                stalled = 0;
                continue;
            }
            self.back_to(start);
            let eta = self.eta(v);
            if self.newton(v, 1.0 / eta) {
                stalled = 0;
                continue;
            }
            self.back_to(start);
            // Two sides that send the point to each other make no way.
            stalled = if self.line(v) < CLOSED { stalled + 1 } else { 0 };
            if stalled > 2 {
                return End::Blocked;
            }
        }
        End::Settled
    }

    /// The drive's direction from here, if there is a way: the contact point may stand on an edge or a vertex.
    #[inline]
    fn launch(&mut self) -> Result<DVec3, End> {
        let drive = self.drive;
        if self.at.n[0] != 0.0 && self.at.n[1] != 0.0 && self.at.n[2] != 0.0 {
            return Ok(self.aim());
        }
        let (body, law, tip, budget) = (self.site.body, self.site.law, self.tip, &mut *self.budget);
        let way = if R::CONTINUOUS && law.is_continuous() && !body.has_creases() {
            launch(body, *self.at, |_| if budget.cross() { drive.along } else { DVec3::ZERO })
        } else {
            launch(body, *self.at, |there| {
                if budget.is_spent() {
                    return DVec3::ZERO;
                }
                budget.evaluate();
                let mut site = Site::<L>::new(body, law, there.element);
                let field = site.evaluate(there.n, tip);
                R::drive(&mut site, there.n, &field).along
            })
        };
        // Not all of the directions were tried.
        if self.budget.is_spent() {
            return Err(End::Capped);
        }
        let (there, v) = match way {
            Launch::Held => return Err(End::Blocked),
            Launch::Border => return Err(End::Border),
            Launch::Fence => return Err(End::Fenced),
            // On an edge only the component along it drives.
            Launch::Edge(_, along)
                if within(&Drive { force: drive.force * drive.along.dot(along), ..drive }, self.field) =>
            {
                return Err(End::Blocked);
            }
            Launch::Edge(there, along) => (there, Some(along)),
            Launch::Along(there) => (there, None),
        };
        if there.element != self.at.element {
            *self.at = there;
            self.evaluate_again();
        }
        Ok(v.unwrap_or(self.drive.along))
    }

    /// Which way the drive leads.
    #[inline(always)]
    fn aim(&self) -> DVec3 {
        if R::LATERAL {
            self.site.aim(self.field)
        } else {
            self.site.lead(self.at.n, self.field, &self.drive)
        }
    }

    /// Newton's method on f_r − L, each time along the drive of the moment; the first time with the reciprocal slope
    /// `ease`, m/N, then with the secant's. Two or three evaluations where the body is smooth. False if it does not
    /// close in, and a slower search has to do.
    ///
    /// Its first iterate with the slope f_r' would be the paper's |δr − δs|.
    #[inline]
    fn newton(&mut self, v: DVec3, ease: f64) -> bool {
        // Slopes between a tenth and ten times f_r' are believed; and c never has to run much farther than δr.
        let (stiffness, farthest) = (self.field.pull_slope, 1.5 * self.drive.reach);
        let believable = |ease: f64| ease * stiffness < 10.0 && ease * stiffness > 0.1;
        let (mut v, mut ease, mut travelled) = (v, ease, 0.0);
        let first = self.drive.force * self.drive.along.dot(v) - self.field.limit;
        let energy = self.field.energy;
        let mut excess = first;
        // The paper's rule has the scalar secant alone.
        let (bent, mut answer) = (L::COUPLED || (L::ISOTROPIC && !R::LATERAL), Answer::new(ease));
        let mut residual = self.drive.along * first;
        while !self.budget.is_spent() && believable(ease) && excess * ease <= farthest {
            let way = excess * ease;
            let rates = self.site.rates(v * way.signum());
            let mut stop = Stop::Reached;
            match rates.inside(self.at.n, way.abs()) {
                Some(n) => self.at.n = n,
                None => {
                    let v = v * way.signum();
                    (*self.at, _, stop) = walk(self.site.body, *self.at, v, way.abs(), rates, self.budget);
                }
            }
            self.evaluate();
            travelled += way;
            // Seen along the old drive: past the root it has changed sides where L is nearly 0.
            let seen = self.drive.force * self.drive.along.dot(v) - self.field.limit;
            let now = self.drive.force - self.field.limit;
            if R::PASSIVE && raised(self.field, energy) {
                return false;
            }
            // Past the tip, |f_r| = L has a second root: there friction would push.
            if self.drive.along.dot(v) < 0.0 && self.field.limit > tolerance(&self.drive, self.field) {
                return false;
            }
            if now.abs() <= tolerance(&self.drive, self.field) {
                // What is left would be closed by one more iterate: learn as if it had been.
                if now.abs() < 0.1 * first {
                    self.pace.learn((travelled + now * ease) / first);
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
                answer.learn(v * way, residual - left);
                let next = answer.way(left);
                let length = next.length();
                if !(length > 0.0 && length.is_finite()) {
                    return false;
                }
                (residual, excess, ease) = (left, now, length / now.abs());
                v = next * (now.signum() / length);
                continue;
            }
            ease = way / (excess - seen);
            (v, excess) = if L::ISOTROPIC {
                (self.drive.along, now)
            } else {
                let aim = self.aim();
                ease *= self.site.turned(self.at.n, v, aim);
                (aim, self.drive.force * self.drive.along.dot(aim) - self.field.limit)
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
        let energy = self.field.energy;
        let excess = |d: &Drive, f: &Field| {
            let excess = d.force * d.along.dot(v) - f.limit;
            // Over a hump into another valley of the energy: too far, whatever the drive says there.
            if R::PASSIVE && raised(f, energy) { -excess.abs() - 2.0 * tolerance(d, f) } else { excess }
        };
        let (mut s, mut g) = (0.0, excess(&self.drive, self.field));
        if g <= 0.0 {
            return 0.0;
        }
        // Largest s with g > 0 and the least with g < 0, and where they are.
        let mut low = (0.0, *self.at);
        let mut high: Option<(f64, SurfacePoint)> = None;
        let eta = self.eta(v);
        let slope = if eta > 0.1 * self.field.pull_slope { eta } else { self.field.pull_slope };
        // On a curve that has gone flat the slope leads far away; the root lies within about δr.
        let mut target = (g / slope).min(self.drive.reach);
        let mut tries = 0;
        while !self.budget.is_spent() {
            let way = target - s;
            let along = v * way.signum();
            let rates = self.site.rates(along);
            let (at, walked, stop) = walk(self.site.body, *self.at, along, way.abs(), rates, self.budget);
            *self.at = at;
            self.evaluate_again();
            let (s_before, g_before) = (s, g);
            s += walked * way.signum();
            g = excess(&self.drive, self.field);
            tries += 1;
            if g.abs() <= tolerance(&self.drive, self.field) {
                return s;
            }
            if g > 0.0 {
                low = (s, *self.at);
                if stop != Stop::Reached && way > 0.0 {
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
                    *self.at = if R::CONTINUOUS { there } else { on_edge(there, self.site.corners()) };
                    self.evaluate_again();
                    return end;
                }
                Some((end, _)) if secant > low.0 && secant < end && tries < 6 => secant,
                Some((end, _)) => 0.5 * (low.0 + end),
                None if secant > s && secant < s + 8.0 * way => secant,
                None => s + 2.0 * way.abs(),
            };
        }
        *self.at = low.1;
        self.evaluate_again();
        low.0
    }

    /// How fast slip along `v` takes the drive to its limit, N/m.
    #[inline]
    fn eta(&mut self, v: DVec3) -> f64 {
        self.budget.evaluate();
        self.site.drift(self.at.n, self.field, v).eta
    }

    #[inline(always)]
    fn evaluate(&mut self) {
        self.budget.evaluate();
        if self.site.element != self.at.element {
            self.site.move_to(self.at.element);
        }
        *self.field = self.site.evaluate(self.at.n, self.tip);
        self.drive = R::drive(self.site, self.at.n, self.field);
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
fn raised(field: &Field, energy: f64) -> bool {
    field.energy > energy + energy.abs() * 1e-14
}

/// Whether a drive is within the limit, up to [`tolerance`].
#[inline]
pub(crate) fn within(drive: &Drive, field: &Field) -> bool {
    drive.force - field.limit <= tolerance(drive, field) || drive.reach <= NO_DEFLECTION
}

/// A way below this is rounding, m.
const NO_DEFLECTION: f64 = 1e-12;

/// 10⁻⁶ of the limit, a micronewton of a newton, [`NO_DEFLECTION`], and the drive's rounding, N.
#[inline]
fn tolerance(drive: &Drive, field: &Field) -> f64 {
    1e-6 * field.limit + NO_DEFLECTION * field.pull_slope + drive.noise
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
