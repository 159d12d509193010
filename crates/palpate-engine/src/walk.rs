//! Moving the contact point over the facets.

use crate::budget::Budget;
use crate::force_law::ToolMotion;
use glam::DVec3;
use palpate_body::{ContactModel, SurfacePoint};

/// Why a walk over the surface ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stop {
    /// The whole distance was covered.
    Reached,
    /// At an edge or vertex beyond which the drive points back.
    Edge,
    /// At the surface's border.
    Border,
    /// The budget is spent.
    Cap,
}

/// Where a contact point can start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum StartDirection {
    /// Over the element of the point (it may have changed sides), along the projection of the drive.
    Along(SurfacePoint),
    /// Along an edge, in this unit direction: both sides push back to it.
    Edge(SurfacePoint, DVec3),
    /// Out over the border.
    Border,
    /// Out over a patch's boundary.
    PatchBoundary,
    /// Nowhere: the drive has no component along any element or edge here.
    Held,
}

/// How the area coordinates change when the contact point moves with the projection of a vector on an element's
/// plane. Held undivided, so that a walk from edge to edge divides once an edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rates {
    /// Rates × `scale`.
    r: [f64; 3],
    /// Four times the squared area, m⁴.
    scale: f64,
}

impl Rates {
    #[inline]
    pub fn new(corners: [DVec3; 3], v: DVec3) -> Self {
        let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
        let (a, b, c) = (e1.length_squared(), e1.dot(e2), e2.length_squared());
        let (v1, v2) = (v.dot(e1), v.dot(e2));
        let (r1, r2) = (c * v1 - b * v2, a * v2 - b * v1);
        Rates { r: [-(r1 + r2), r1, r2], scale: a * c - b * b }
    }

    /// The rate of each coordinate, 1/m for a unit vector.
    #[inline]
    pub fn each(&self) -> [f64; 3] {
        let per = 1.0 / self.scale;
        self.r.map(|r| r * per)
    }

    /// Whether coordinate `i` falls.
    #[inline]
    fn falls(&self, i: usize) -> bool {
        pick(self.r, i) < 0.0
    }

    /// The coordinates after the distance `s`, if that does not leave the element.
    #[inline]
    pub fn inside(&self, n: [f64; 3], s: f64) -> Option<[f64; 3]> {
        let s = s * (1.0 / self.scale);
        let (n1, n2) = (n[1] + self.r[1] * s, n[2] + self.r[2] * s);
        let n0 = 1.0 - n1 - n2;
        (n0 >= 0.0 && n1 >= 0.0 && n2 >= 0.0).then_some([n0, n1, n2])
    }

    /// The coordinates after the distance `s`, with what rounding took below zero put back.
    #[cold]
    fn along_edge(&self, n: [f64; 3], s: f64) -> [f64; 3] {
        let r = self.each();
        let n = [0, 1, 2].map(|i| (pick(n, i) + pick(r, i) * s).max(0.0));
        let per = 1.0 / (n[0] + n[1] + n[2]);
        n.map(|n| n * per)
    }

    /// The coordinate that reaches zero first. One that stands at zero and moves by rounding alone stays.
    #[inline]
    fn exit(&self, n: [f64; 3]) -> Option<usize> {
        let still = 1e-12 * (self.r[0].abs() + self.r[1].abs() + self.r[2].abs());
        let mut exit: Option<(usize, f64, f64)> = None;
        for (i, (n, fall)) in n.into_iter().zip(self.r.map(|r| -r)).enumerate() {
            // n/fall is the least, compared crosswise.
            if fall > still && exit.is_none_or(|(_, least, at)| n * at < least * fall) {
                exit = Some((i, n, fall));
            }
        }
        exit.map(|(i, ..)| i)
    }
}

/// Moves `at` by the distance `s` with the projection of `v` on each element that it comes through. Returns where it
/// ended, how far that was, and why it ended. `rates` are those of `v` in the first element.
#[inline]
pub(crate) fn walk(
    body: &ContactModel,
    mut at: SurfacePoint,
    v: DVec3,
    s: f64,
    mut rates: Rates,
    budget: &mut Budget,
) -> (SurfacePoint, f64, Stop) {
    let mut left = s;
    let mut corners = body.corners(at.element);
    loop {
        if let Some(n) = rates.inside(at.n, left) {
            at.n = n;
            return (at, s, Stop::Reached);
        }
        // Where the way ends before the edge, only rounding took a coordinate below zero: the point runs along an edge.
        let exit = rates.exit(at.n).map(|i| (i, pick(at.n, i) / -pick(rates.r, i)));
        let Some((opposite, fall)) = exit.filter(|(_, fall)| fall * rates.scale < left) else {
            at.n = rates.along_edge(at.n, left);
            return (at, s, Stop::Reached);
        };
        left -= fall * rates.scale;
        let along = (pick(at.n, opposite + 1) + pick(rates.r, opposite + 1) * fall).clamp(0.0, 1.0);
        at.n = match opposite {
            0 => [0.0, along, 1.0 - along],
            1 => [1.0 - along, 0.0, along],
            _ => [along, 1.0 - along, 0.0],
        };
        if !budget.cross() {
            return (at, s - left, Stop::Cap);
        }
        let Some((beyond, apex)) = step_over(body, at, opposite) else {
            return (at, s - left, Stop::Border);
        };
        // Two corners are known; their order is turned round.
        let (start, end) = (pick(corners, opposite + 1), pick(corners, opposite + 2));
        let new = body.element_node(beyond.element, apex).position;
        corners = match apex {
            0 => [new, end, start],
            1 => [start, new, end],
            _ => [end, start, new],
        };
        rates = Rates::new(corners, v);
        if pick(rates.r, apex) <= 0.0 {
            return (at, s - left, Stop::Edge);
        }
        at = beyond;
    }
}

/// What pulls a contact point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pull {
    /// Where to, a unit vector, or zero.
    pub way: DVec3,
    /// The drive's direction, likewise.
    pub drive: DVec3,
    /// How the tool moves with the contact point; `None`: as it does.
    pub motion: Option<ToolMotion>,
}

impl Pull {
    /// Straight along `v`.
    pub fn straight(v: DVec3) -> Self {
        Pull { way: v, drive: v, motion: None }
    }

    /// What of it pulls along a unit vector.
    pub fn along(&self, edge: DVec3) -> f64 {
        self.drive.dot(self.motion.map_or(edge, |motion| motion.direction(edge)))
    }
}

/// Where the drive can take a contact point that may stand on an edge or a vertex. `drive` gives what pulls as seen
/// from an element, which differs between the sides where the frame does.
#[inline]
pub(crate) fn start_direction(
    body: &ContactModel,
    at: SurfacePoint,
    drive: impl FnMut(SurfacePoint) -> Pull,
) -> StartDirection {
    let on_edge = |i: usize| at.n.get(i).is_some_and(|&n| n == 0.0);
    let zeros = u8::from(on_edge(0)) + u8::from(on_edge(1)) + u8::from(on_edge(2));
    if zeros == 0 {
        return StartDirection::Along(at);
    }
    if zeros == 1 {
        let opposite = if on_edge(0) {
            0
        } else if on_edge(1) {
            1
        } else {
            2
        };
        return from_edge(body, at, opposite, drive);
    }
    let vertex = if !on_edge(0) {
        0
    } else if !on_edge(1) {
        1
    } else {
        2
    };
    from_vertex(body, at, vertex, drive)
}

#[inline]
fn pick<T: Copy>(of: [T; 3], i: usize) -> T {
    match i % 3 {
        0 => of[0],
        1 => of[1],
        _ => of[2],
    }
}

fn from_edge(
    body: &ContactModel,
    at: SurfacePoint,
    opposite: usize,
    mut drive: impl FnMut(SurfacePoint) -> Pull,
) -> StartDirection {
    let corners = body.corners(at.element);
    let pull = drive(at);
    if !Rates::new(corners, pull.way).falls(opposite) {
        return StartDirection::Along(at);
    }
    let Some((beyond, apex)) = step_over(body, at, opposite) else {
        let fenced = body.is_patch_boundary(at.element, (opposite + 1) % 3);
        return if fenced { StartDirection::PatchBoundary } else { StartDirection::Border };
    };
    let seen_from_there = drive(beyond);
    if !Rates::new(body.corners(beyond.element), seen_from_there.way).falls(apex) {
        return StartDirection::Along(beyond);
    }
    let edge = (pick(corners, opposite + 2) - pick(corners, opposite + 1)).normalize_or_zero();
    let along = pull.along(edge) + seen_from_there.along(edge);
    if along == 0.0 { StartDirection::Held } else { StartDirection::Edge(at, edge * along.signum()) }
}

fn from_vertex(
    body: &ContactModel,
    at: SurfacePoint,
    vertex: usize,
    mut drive: impl FnMut(SurfacePoint) -> Pull,
) -> StartDirection {
    // The steepest way up: a sector that holds the projected drive, else an edge.
    let mut best = (0.0, StartDirection::Held);
    let mut fenced = false;
    let closed = body.around(at.element, vertex, |element, corner| {
        let mut n = [0.0; 3];
        if let Some(n) = n.get_mut(corner) {
            *n = 1.0;
        }
        let here = SurfacePoint { element, n };
        fenced |=
            body.is_patch_boundary(element, corner) || body.is_patch_boundary(element, (corner + 2) % 3);
        let pull = drive(here);
        let corners = body.corners(element);
        let rates = Rates::new(corners, pull.way);
        let [a, b, c] = [0, 1, 2].map(|i| pick(corners, corner + i));
        if !rates.falls(corner + 1) && !rates.falls(corner + 2) {
            let r = rates.each();
            let velocity = (b - a) * pick(r, corner + 1) + (c - a) * pick(r, corner + 2);
            let ascent = velocity.dot(pull.way).max(0.0).sqrt();
            if ascent > best.0 {
                best = (ascent, StartDirection::Along(here));
            }
        }
        let edge = (b - a).normalize_or_zero();
        let ascent = pull.along(edge);
        // An edge counts only where no sector does: a hair's handicap keeps equal sectors before it.
        if ascent > best.0 * (1.0 + 1e-9) {
            best = (ascent, StartDirection::Edge(here, edge));
        }
    });
    match best {
        (_, StartDirection::Along(_)) => best.1,
        _ if fenced => StartDirection::PatchBoundary,
        _ if !closed => StartDirection::Border,
        (ascent, _) if ascent <= 1e-12 => StartDirection::Held,
        _ => best.1,
    }
}

/// The same point seen from the element across the edge opposite corner `opposite`, and that element's own corner
/// opposite the edge.
#[inline]
fn step_over(body: &ContactModel, at: SurfacePoint, opposite: usize) -> Option<(SurfacePoint, usize)> {
    let edge = (opposite + 1) % 3;
    let (element, j) = body.across(at.element, edge)?;
    // Their edge j runs against ours: it starts at our edge's end.
    let (start, end) = (pick(at.n, edge), pick(at.n, edge + 1));
    let n = match j {
        0 => [end, start, 0.0],
        1 => [0.0, end, start],
        _ => [start, 0.0, end],
    };
    Some((SurfacePoint { element, n }, (j + 2) % 3))
}
