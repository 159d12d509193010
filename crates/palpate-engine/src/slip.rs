//! Slip: at a fixed tip, the contact point moves until the drive is within the friction limit (paper, section 3.2;
//! MODEL 4, rule `paper`).

use crate::field::{Field, Law};
use crate::walk::{Launch, Stop, launch, rates, walk};
use glam::DVec3;
use palpate_body::{Body, SurfacePoint};

/// Bound on evaluations of the force law a step.
pub(crate) const MAX_EVALUATIONS: u32 = 64;
/// Bound on edges crossed a step.
pub(crate) const MAX_CROSSINGS: u32 = 64;

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
    /// Out of evaluations or crossings.
    Capped,
}

/// Where the contact point came to rest.
pub(crate) struct Slipped {
    pub at: SurfacePoint,
    pub field: Field,
    pub moved: bool,
    pub end: End,
    pub evaluations: u32,
    pub crossings: u32,
}

/// The slip search's view of the world, and what is left of its bounds.
struct Search<'a> {
    body: &'a Body,
    law: &'a Law,
    tip: DVec3,
    evaluations: u32,
    crossings: u32,
}

/// Lets the contact point run from `at`, where the law reads `field`.
#[inline]
pub(crate) fn slip(body: &Body, law: &Law, at: SurfacePoint, field: Field, tip: DVec3) -> Slipped {
    let mut search = Search { body, law, tip, evaluations: MAX_EVALUATIONS, crossings: MAX_CROSSINGS };
    let (start, mut at, mut field) = (at, at, field);
    let end = search.run(&mut at, &mut field);
    let (evaluations, crossings) = (MAX_EVALUATIONS - search.evaluations, MAX_CROSSINGS - search.crossings);
    Slipped { at, field, moved: at != start, end, evaluations, crossings }
}

impl Search<'_> {
    fn run(&mut self, at: &mut SurfacePoint, field: &mut Field) -> End {
        let mut stalled = 0;
        while !within(field.pull.value, field) {
            if self.evaluations == 0 || self.crossings == 0 {
                return End::Capped;
            }
            let before = *at;
            let u_r = field.u_r;
            let way = if self.law.is_continuous() && !self.on_crease(*at) {
                launch(self.body, *at, |_| u_r)
            } else {
                launch(self.body, *at, |there| self.law.evaluate(self.body, there, self.tip).u_r)
            };
            let v = match way {
                Launch::Held => return End::Blocked,
                Launch::Border => return End::Border,
                Launch::Edge(there, along) => {
                    // On an edge only the component along it drives.
                    if within(field.pull.value * u_r.dot(along), field) {
                        return End::Blocked;
                    }
                    *at = there;
                    along
                }
                Launch::Along(there) => {
                    *at = there;
                    u_r
                }
            };
            if at.element != before.element {
                *field = self.evaluate(*at);
            }
            let travelled = self.line(at, field, v);
            // Two sides that send the point to each other make no way.
            stalled = if travelled < CLOSED { stalled + 1 } else { 0 };
            if stalled > 2 {
                return End::Blocked;
            }
        }
        End::Settled
    }

    /// Walks along the projection of `v` to where the drive's component along v meets the limit, or as far as the
    /// surface lets it. Returns how far it went.
    ///
    /// The root is sought on the **signed** component f_r (u_r·v) − L: |δ_t| never falls below zero, so that the
    /// root would be missed wherever L ≈ 0, as at every onset.
    fn line(&mut self, at: &mut SurfacePoint, field: &mut Field, v: DVec3) -> f64 {
        let drive = |f: &Field| f.pull.value * f.u_r.dot(v) - f.limit;
        let (mut s, mut g) = (0.0, drive(field));
        if g <= 0.0 {
            return 0.0;
        }
        // Largest s with g > 0, and the least with g < 0 with what is there.
        let mut low = 0.0;
        let mut high: Option<(f64, SurfacePoint, Field)> = None;
        let mut target = g / self.decline(*at, field, v);
        let mut tries = 0;
        while self.evaluations > 0 {
            let (direction, way) = if target >= s { (v, target - s) } else { (-v, s - target) };
            let (there, walked, stop) = walk(self.body, *at, direction, way, &mut self.crossings);
            let (s_before, g_before) = (s, g);
            s += if target >= s { walked } else { -walked };
            *at = there;
            *field = self.evaluate(there);
            g = drive(field);
            tries += 1;
            if g.abs() <= tolerance(field) {
                return s;
            }
            if g > 0.0 {
                low = s;
                if stop != Stop::Reached {
                    return s;
                }
            } else {
                high = Some((s, there, *field));
            }
            let secant = s - g * (s - s_before) / (g - g_before);
            target = match high {
                Some((end, there, f)) => {
                    if end - low <= CLOSED {
                        // A jump of the frame or the response: rest on its far side, within the limit.
                        (*at, *field) = (there, f);
                        return end;
                    }
                    let inside = secant > low && secant < end;
                    if inside && tries < 6 { secant } else { 0.5 * (low + end) }
                }
                None if secant > s && secant < s + 8.0 * way => secant,
                None => s + 2.0 * way,
            };
        }
        s
    }

    /// −d/ds of the signed drive along the walk: the certificate's η with the responses' own gradient left out.
    #[inline]
    fn decline(&self, at: SurfacePoint, f: &Field, v: DVec3) -> f64 {
        let nodes = self.body.element_nodes(at.element);
        let corners = nodes.map(|n| n.position);
        let r = rates(corners, v);
        let t = (corners[1] - corners[0]) * r[1] + (corners[2] - corners[0]) * r[2];
        let bend = if self.law.is_continuous() {
            let turn = nodes[0].inward * r[0] + nodes[1].inward * r[1] + nodes[2].inward * r[2];
            // u_r is at right angles to û: the part of the turn along û drops out.
            v.dot(turn - f.u * f.u.dot(turn)) / f.u_length
        } else {
            0.0
        };
        let direct = f.pull.slope * t.dot(v);
        let eta = f.pull.slope * (t.dot(v) + (f.depth - self.law.radius_m) * bend)
            + f.limit_slope() * (f.lateral * bend - f.u.dot(t));
        if eta > 0.2 * direct && direct > 0.0 { eta } else { direct.max(0.1 * f.pull.slope).max(1e-9) }
    }

    fn evaluate(&mut self, at: SurfacePoint) -> Field {
        self.evaluations = self.evaluations.saturating_sub(1);
        self.law.evaluate(self.body, at, self.tip)
    }

    /// Whether a point on an edge stands where the two sides keep their own nodes.
    fn on_crease(&self, at: SurfacePoint) -> bool {
        // Creases double nodes; without any, every node is its vertex.
        self.body.has_creases() && at.n.iter().any(|&n| n == 0.0)
    }
}

/// Whether a force is within the limit, up to [`tolerance`].
#[inline]
fn within(force: f64, field: &Field) -> bool {
    force - field.limit <= tolerance(field)
}

/// 10⁻⁹ of the limit and 10⁻¹² m of lateral deflection, N: what rounding leaves of coordinates of a metre.
#[inline]
fn tolerance(field: &Field) -> f64 {
    1e-9 * field.limit + 1e-12 * field.pull.slope
}
