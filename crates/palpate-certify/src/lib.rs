//! Certificates of a whole body: the engine's bounds element by element, on all cores, and what they add up to.
//!
//! [`certify`] answers a [`Question`]: P (passive), S (free of snaps) and L (how fast the force can change), with a path that
//! shows what is broken ([`witness`]), and down to which depth a device's sampled loop is passive ([`device`]). [`floor`] raises a
//! body's friction until P holds. What is proved, and how, is in `docs/passivity.md`.

pub mod device;
pub mod floor;
mod question;
pub mod witness;

pub use question::{Certified, Question, certify, certify_on};

use palpate_body::stiffness::{StiffnessAt, stiffness_max};
use palpate_body::{Body, NO_TWIN, SlipRule};
use palpate_engine::certify::{
    Assumptions, Bounds, Criterion, Effort, ElementStates, ROUNDING, SHALLOWEST, frictions, least,
};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};

/// Evaluations of a bound for each element and criterion, more while it is undecided ([`Effort::evaluations`]): 1,280
/// elements with the rule `paper` then take 9 s of processor time. The drives with gradients take five to ten times as long
/// to bound, a coupled law fifty.
pub fn evaluations(body: &Body, rule: SlipRule) -> u32 {
    match rule {
        _ if body.is_coupled() => 200,
        SlipRule::Paper => 3000,
        _ => 600,
    }
}

/// P and S of one element; where slip is partial, of the contact point that has less of each.
#[derive(Debug, Clone)]
pub struct Element {
    /// g·t/(f_z + f_r).
    pub passive: Bounds,
    /// The friction that this is of, in parts of the body's.
    pub passive_friction: f64,
    /// η, N/m.
    pub snap_free: Bounds,
    /// The friction that this is of, in parts of the body's.
    pub snap_free_friction: f64,
    /// The Lipschitz constant, N/m; none where S is not proved.
    pub lipschitz: Option<Bounds>,
    /// Whether one of its edges is a crease: there the frames jump.
    pub creased: bool,
    /// Whether friction can hold farther laterally than is looked at.
    pub too_far: bool,
}

/// How an element stands with a criterion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// No state is below 0.
    Proved,
    /// One is.
    Fails,
    /// Neither was found out with the effort allowed.
    Undecided,
}

impl Verdict {
    fn of(bounds: &Bounds, covered: bool) -> Self {
        if bounds.found < -ROUNDING {
            Verdict::Fails
        } else if bounds.proved >= -ROUNDING && covered {
            Verdict::Proved
        } else {
            Verdict::Undecided
        }
    }
}

impl Element {
    /// P.
    pub fn passive(&self) -> Verdict {
        Verdict::of(&self.passive, !self.creased && !self.too_far)
    }

    /// S. At a crease the force jumps.
    pub fn snap_free(&self) -> Verdict {
        if self.creased { Verdict::Fails } else { Verdict::of(&self.snap_free, !self.too_far) }
    }

    /// Bounds of P, and the friction that they are of.
    fn passive_bounds(&self) -> (&Bounds, f64) {
        (&self.passive, self.passive_friction)
    }

    /// Bounds of S, and the friction that they are of.
    fn snap_free_bounds(&self) -> (&Bounds, f64) {
        (&self.snap_free, self.snap_free_friction)
    }

    fn of(body: &Body, element: u32, assumptions: &Assumptions, evaluations: u32, friction: f64) -> Self {
        let patch = ElementStates::new(body, element, &assumptions.with_friction(friction));
        let cells = patch.cells();
        let effort = |absolute| Effort { evaluations, absolute, relative: 0.1 };
        let snap_free = least(Criterion::SnapFree, &patch, &cells, effort(1.0));
        let too_far = patch.holds_too_far();
        Element {
            passive: least(Criterion::Passive, &patch, &cells, effort(0.01)),
            passive_friction: friction,
            lipschitz: (snap_free.proved > 0.0).then(|| {
                least(Criterion::Lipschitz, &patch.snap_free(snap_free.proved), &cells, effort(1.0))
            }),
            snap_free,
            snap_free_friction: friction,
            creased: is_creased(body, element),
            too_far,
        }
    }

    /// Of two contact points side by side: force and energies are their means, and so no bound is worse than the worse of both.
    fn worse(self, other: Element) -> Element {
        let first = |one: &Bounds, other: &Bounds| one.found <= other.found;
        let friction = |one: f64, other: f64, first: bool| if first { one } else { other };
        let passive_first = first(&self.passive, &other.passive);
        let snap_free_first = first(&self.snap_free, &other.snap_free);
        Element {
            passive: self.passive.worse(other.passive),
            passive_friction: friction(self.passive_friction, other.passive_friction, passive_first),
            snap_free: self.snap_free.worse(other.snap_free),
            snap_free_friction: friction(self.snap_free_friction, other.snap_free_friction, snap_free_first),
            lipschitz: self.lipschitz.zip(other.lipschitz).map(|(one, other)| one.worse(other)),
            creased: self.creased,
            too_far: self.too_far || other.too_far,
        }
    }
}

/// Bounds of every element of a body, in their order; none once `cancelled` is true. `done` is called after each.
pub fn elements(
    body: &Body,
    assumptions: &Assumptions,
    evaluations: u32,
    done: &(dyn Fn() + Sync),
    cancelled: &AtomicBool,
) -> Option<Vec<Element>> {
    (0..body.elements().len() as u32)
        .into_par_iter()
        .map(|element| {
            if cancelled.load(Ordering::Relaxed) {
                return None;
            }
            let each = frictions(body).iter();
            let each = each.map(|&friction| Element::of(body, element, assumptions, evaluations, friction));
            let found = each.reduce(Element::worse);
            done();
            found
        })
        .collect()
}

/// Whether a neighbour sees other nodes along a shared edge.
fn is_creased(body: &Body, element: u32) -> bool {
    body.has_creases()
        && (0..3).any(|edge| {
            let Some((other, back)) = body.across(element, edge) else { return false };
            let (here, there) =
                (body.elements()[element as usize].nodes, body.elements()[other as usize].nodes);
            here[edge] != there[(back + 1) % 3] || here[(edge + 1) % 3] != there[back]
        })
}

/// One certificate of a body.
#[derive(Debug, Clone, Serialize)]
pub struct Holds {
    /// Proved on every element.
    pub holds: bool,
    /// Proved: no slip state has less. Null if there is no bound, or nothing slips.
    pub margin: Option<f64>,
    /// The least that was found.
    pub found: Option<f64>,
    /// Elements on which it is proved,
    pub proved_elements: usize,
    /// on which a state was found that breaks it (S: or a crease),
    pub failing_elements: usize,
    /// and those where neither was found out.
    pub undecided_elements: usize,
    /// Where the least was found.
    pub worst: Option<Place>,
    /// A path that shows it, if it was broken and a path does.
    pub witness: Option<witness::Shown>,
}

/// A slip state, for people.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Place {
    /// Element.
    pub element: u32,
    /// Contact point, m.
    pub contact_m: [f64; 3],
    /// δz, m.
    pub depth_m: f64,
    /// δr, m.
    pub lateral_m: f64,
    /// The way of the slip, a unit vector.
    pub direction: [f64; 3],
    /// The friction that it is of, in parts of the body's: 1, or that of one of two contact points, times what was assumed.
    pub friction_factor: f64,
}

impl Place {
    fn of(body: &Body, assumptions: &Assumptions, element: u32, bounds: &Bounds) -> Option<Self> {
        let cell = bounds.at?;
        let state = ElementStates::new(body, element, assumptions).state(&cell);
        Some(Place {
            element,
            contact_m: state.contact.to_array(),
            depth_m: cell.depth_m[0],
            lateral_m: state.lateral.length(),
            direction: state.along.to_array(),
            friction_factor: assumptions.friction_factor,
        })
    }
}

/// Over all elements.
pub fn holds(
    body: &Body,
    assumptions: &Assumptions,
    elements: &[Element],
    bounds: fn(&Element) -> (&Bounds, f64),
    verdict: fn(&Element) -> Verdict,
) -> Holds {
    let (bounds, friction) = (|e| bounds(e).0, |e| bounds(e).1);
    let count = |v: Verdict| elements.iter().filter(|e| verdict(e) == v).count();
    let proved = elements.iter().map(|e| bounds(e).proved).fold(f64::INFINITY, f64::min);
    let worst = elements.iter().enumerate().min_by(|a, b| bounds(a.1).found.total_cmp(&bounds(b.1).found));
    let found = worst.map_or(f64::INFINITY, |(_, e)| bounds(e).found);
    let finite = |x: f64| x.is_finite().then_some(x);
    Holds {
        holds: count(Verdict::Proved) == elements.len(),
        margin: finite(proved),
        found: finite(found),
        proved_elements: count(Verdict::Proved),
        failing_elements: count(Verdict::Fails),
        undecided_elements: count(Verdict::Undecided),
        worst: worst
            .and_then(|(i, e)| Place::of(body, &assumptions.with_friction(friction(e)), i as u32, bounds(e))),
        witness: None,
    }
}

/// P and S, as a search finds them, with all friction multiplied by a factor.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct WindowRow {
    /// What the friction was multiplied by.
    pub friction_factor: f64,
    /// Elements with a state that breaks P,
    pub passive_failing_elements: usize,
    /// and S.
    pub snap_failing_elements: usize,
    /// Least value found of P,
    pub passive_found: Option<f64>,
    /// and of S, N/m.
    pub snap_free_found_n_per_m: Option<f64>,
}

/// P wants friction high, S wants it low: how both fare over a range of it. By search, not by proof; none once `cancelled` is true.
pub fn window(body: &Body, assumptions: &Assumptions, cancelled: &AtomicBool) -> Option<Vec<WindowRow>> {
    let effort = Effort { evaluations: 0, absolute: 0.0, relative: 0.0 };
    let row = |factor: f64| {
        let assumptions = assumptions.with_friction(factor);
        let found: Option<Vec<[f64; 2]>> = (0..body.elements().len() as u32)
            .into_par_iter()
            .map(|element| {
                if cancelled.load(Ordering::Relaxed) {
                    return None;
                }
                let each = frictions(body).iter().map(|&friction| {
                    let patch = ElementStates::new(body, element, &assumptions.with_friction(friction));
                    let cells = patch.cells();
                    [Criterion::Passive, Criterion::SnapFree].map(|c| least(c, &patch, &cells, effort).found)
                });
                each.reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1])])
            })
            .collect();
        let found = found?;
        let failing = |i: usize| found.iter().filter(|f| f[i] < -ROUNDING).count();
        let least = |i: usize| found.iter().map(|f| f[i]).fold(f64::INFINITY, f64::min);
        let finite = |x: f64| x.is_finite().then_some(x);
        Some(WindowRow {
            friction_factor: factor,
            passive_failing_elements: failing(0),
            snap_failing_elements: failing(1),
            passive_found: finite(least(0)),
            snap_free_found_n_per_m: finite(least(1)),
        })
    };
    [0.0, 0.5, 1.0, 1.5, 2.0, 3.0].into_iter().map(row).collect()
}

/// What `palpate certify --json` prints.
#[derive(Debug, Clone, Serialize)]
pub struct Certificate {
    /// P: no slip takes energy out of nothing.
    pub passive: Holds,
    /// S: no slip runs away; margins are η, N/m.
    pub snap_free: Holds,
    /// L: no force changes faster with the tool's position, proved; null where S is not.
    pub lipschitz_n_per_m: Option<f64>,
    /// The greatest that was found on the elements where S is proved.
    pub lipschitz_found_n_per_m: Option<f64>,
    /// K_max down to each depth.
    pub stiffness_max_n_per_m: Vec<StiffnessAt>,
    /// Of the sampled loop, if a device was given.
    pub device: Option<device::Limits>,
    /// Both against friction, if asked for.
    pub window: Vec<WindowRow>,
    /// The slip rule that it speaks of.
    pub slip: SlipRule,
    /// What of it is not by bounds and search: how P follows from the rule.
    pub remarks: Vec<String>,
    /// For which motions it holds.
    pub scope: Scope,
    /// Elements.
    pub elements: usize,
    /// Edges over which a contact ends with the force it has.
    pub border_edges: usize,
    /// Elements along creases, where the force jumps and P is not looked into.
    pub creased_elements: usize,
    /// Elements on which friction can hold beyond ten times the lateral curves.
    pub too_far_elements: usize,
}

/// For which motions a certificate holds.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Scope {
    /// Deepest δz, m.
    pub depth_m: f64,
    /// Longest way of the tool from step to step, m.
    pub step_m: f64,
    /// How far off the drive a slip may run, rad.
    pub aside_rad: f64,
    /// Of a coupled law: the greatest lateral deflection, m, its range.
    pub lateral_m: Option<f64>,
    /// The least δz that P is asked of, m; 0 with curves.
    pub passive_from_m: f64,
}

/// What keeps a body passive of which P is not proved.
const TANK: &str = "with the tank, which the body has, no motion gets back more than it put in, whatever of P is proved, but for a \
                    contact that begins anew (reanchored): where P fails slip waits";

/// What of `exact` is no matter of bounds.
const EXACT: &str = "exact slips down the energy's own slope and never up, whatever the body: passive by construction. Its drive \
                     jumps where facets meet, so that the force clicks there: S is of each element for itself, and there is \
                     no L of the whole body";

/// Adds up what was found on the elements.
pub fn certificate(body: &Body, assumptions: &Assumptions, elements: &[Element]) -> Certificate {
    let snap_free = holds(body, assumptions, elements, Element::snap_free_bounds, Element::snap_free);
    // Bounds are of the negative.
    let lipschitz = |of: fn(&Bounds) -> f64| {
        let each = elements.iter().filter_map(|e| e.lipschitz.as_ref());
        each.map(|b| -of(b)).filter(|l| l.is_finite()).fold(0.0, f64::max)
    };
    // From one element to the next the force of `exact` may jump.
    let exact = assumptions.slip == SlipRule::Exact;
    let everywhere =
        !exact && elements.iter().all(|e| e.lipschitz.as_ref().is_some_and(|b| b.proved > f64::NEG_INFINITY));
    let end = body.responses().depth_knots().values().last().copied().unwrap_or_default();
    let stiffness = stiffness_max(body);
    // Where nothing slips the stiffness in stick is all there is.
    let stick = stiffness.last().map_or(0.0, |s| s.value);
    let mut passive = holds(body, assumptions, elements, Element::passive_bounds, Element::passive);
    let mut remarks = Vec::new();
    if exact {
        (passive.holds, passive.margin, passive.found) = (true, Some(0.0), None);
        (passive.proved_elements, passive.undecided_elements) = (elements.len(), 0);
        remarks.push(EXACT.to_owned());
    }
    if !passive.holds && body.has_tank() {
        remarks.push(TANK.to_owned());
    }
    let depth_m = assumptions.depth_m.unwrap_or(end);
    Certificate {
        passive,
        lipschitz_n_per_m: (snap_free.holds && everywhere).then(|| lipschitz(|b| b.proved).max(stick)),
        lipschitz_found_n_per_m: elements
            .iter()
            .any(|e| e.lipschitz.is_some())
            .then(|| lipschitz(|b| b.found)),
        snap_free,
        stiffness_max_n_per_m: stiffness,
        device: None,
        window: Vec::new(),
        slip: assumptions.slip,
        remarks,
        scope: Scope {
            depth_m,
            step_m: assumptions.step_m,
            aside_rad: assumptions.aside_rad,
            lateral_m: body.coupled_law().map(|law| law.range_m),
            passive_from_m: if body.is_coupled() { SHALLOWEST * depth_m } else { 0.0 },
        },
        elements: elements.len(),
        border_edges: body.elements().iter().flat_map(|e| e.twins).filter(|t| *t == NO_TWIN).count(),
        creased_elements: elements.iter().filter(|e| e.creased).count(),
        too_far_elements: elements.iter().filter(|e| e.too_far).count(),
    }
}
