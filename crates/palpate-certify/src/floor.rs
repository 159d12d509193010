//! The friction floor (MODEL 5, E4): the least friction, at each test point and depth, with which P holds.

use anyhow::{Result, bail};
use palpate_body::{Body, BodyParts, Curve, Extension, SlipRule};
use palpate_engine::certify::{Assumptions, Cell, Criterion, Effort, ElementStates, least};
use rayon::prelude::*;
use serde::Serialize;

/// More friction than this is none: skin on dry glass has 3.
const MOST: f64 = 10.0;
/// Raising friction lets states slip that stuck, which may need more; it settles in a few rounds or never.
const ROUNDS: u32 = 60;
/// A need this much above the friction that is there is met.
const MET: f64 = 1e-6;

/// What was raised.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Raised {
    /// Test points whose friction is higher now.
    pub test_points: usize,
    /// The largest rise of a coefficient at a knot.
    pub largest_rise: f64,
    /// The largest coefficient now.
    pub largest_friction: f64,
    /// How often all elements were looked at.
    pub rounds: u32,
}

/// The body with its friction raised to the floor, and the rule `paper` and one contact point, whose floor it is. Curves that have enough stay as they are.
///
/// # Errors
/// An element that no friction makes passive, with its place.
pub fn raise(body: &Body, assumptions: &Assumptions, evaluations: u32) -> Result<(Body, Raised)> {
    let assumptions = &Assumptions { slip: SlipRule::Paper, ..*assumptions };
    let knots = body.responses().depth_knots().values().to_vec();
    let intervals = knots.len() - 1;
    let mut body_now = Body::new(body.parts())?;
    let mut dirty: Vec<bool> = vec![true; body.curves().len()];
    for round in 1..=ROUNDS {
        let elements: Vec<u32> = (0..body.elements().len() as u32)
            .filter(|&e| {
                body.element_nodes(e)
                    .iter()
                    .any(|n| n.test_points.iter().zip(n.weights).any(|(&t, w)| w > 0.0 && dirty[t as usize]))
            })
            .collect();
        let needs: Vec<Vec<f64>> =
            elements.par_iter().map(|&e| needs(&body_now, e, assumptions, &knots, evaluations)).collect();
        let mut floor = vec![vec![0.0f64; intervals]; body.curves().len()];
        for (&element, needs) in elements.iter().zip(&needs) {
            for node in body.element_nodes(element) {
                let sum: f64 = node.weights.iter().sum();
                for (&point, _) in node.test_points.iter().zip(node.weights).filter(|(_, w)| *w > 0.0) {
                    for (floor, need) in floor[point as usize].iter_mut().zip(needs) {
                        *floor = floor.max(need / sum);
                    }
                }
            }
            if let Some(i) = needs.iter().position(|need| *need > MOST) {
                return Err(endless(body, element, knots[i]));
            }
        }
        let mut parts = body_now.parts();
        let mut changed = 0;
        for (t, response) in parts.responses.iter_mut().enumerate() {
            let raised = raised(&response.friction, &floor[t])?;
            dirty[t] = raised.is_some();
            changed += usize::from(raised.is_some());
            if let Some(curve) = raised {
                response.friction = curve;
            }
        }
        if changed == 0 {
            let report = report(body, &body_now, round);
            return Ok((Body::new(noted(body_now.parts(), &report))?, report));
        }
        body_now = Body::new(parts)?;
    }
    bail!(
        "friction does not settle: raising it lets more of the surface slip that then needs more; refine the mesh or raise \
         the lateral stiffness k_r"
    )
}

/// The friction that an element needs in each interval between knots: 0 where it has enough.
fn needs(body: &Body, element: u32, assumptions: &Assumptions, knots: &[f64], evaluations: u32) -> Vec<f64> {
    let patch = ElementStates::new(body, element, assumptions);
    let effort = Effort { evaluations, absolute: 3e-3, relative: 0.02 };
    let deepest = assumptions.depth_m.unwrap_or(f64::INFINITY);
    let need = |k: &[f64]| {
        if k[0] >= deepest {
            return 0.0;
        }
        let depth_m = [k[0], k[1].min(deepest)];
        let cells: Vec<Cell> = patch.cells().into_iter().map(|c| Cell { depth_m, ..c }).collect();
        let bounds = least(Criterion::Floor, &patch, &cells, effort);
        if bounds.proved == f64::INFINITY { 0.0 } else { -bounds.proved }
    };
    knots.windows(2).map(need).collect()
}

/// A curve that is nowhere below the old one nor the floor; none if the old one is enough.
fn raised(friction: &Curve, floor: &[f64]) -> Result<Option<Curve>> {
    let enough = |(b, floor): (&[f64; 4], &f64)| b.iter().all(|b| *b >= floor - MET);
    if friction.ordinates().iter().zip(floor).all(enough) {
        return Ok(None);
    }
    // Straight lines between knots, at each the larger need of its two intervals.
    let at = |knot: usize| {
        let left = knot.checked_sub(1).and_then(|i| floor.get(i)).copied().unwrap_or(0.0);
        left.max(floor.get(knot).copied().unwrap_or(0.0))
    };
    // The larger Bernstein ordinates bound both curves from above.
    let ordinates: Vec<[f64; 4]> = friction
        .ordinates()
        .iter()
        .enumerate()
        .map(|(i, b)| {
            let (start, end) = (at(i), at(i + 1));
            std::array::from_fn(|j| b[j].max(start + (end - start) * j as f64 / 3.0))
        })
        .collect();
    Ok(Some(Curve::from_ordinates(friction.knots(), &ordinates, Extension::Constant)?))
}

fn endless(body: &Body, element: u32, depth_m: f64) -> anyhow::Error {
    let [a, b, c] = body.corners(element);
    let [x, y, z] = ((a + b + c) * (1e3 / 3.0)).to_array();
    anyhow::anyhow!(
        "element {element} at ({x:.1}, {y:.1}, {z:.1}) mm: no friction makes it passive from {:.2} mm depth on; refine the \
         mesh there or raise the lateral stiffness k_r",
        depth_m * 1e3
    )
}

fn report(old: &Body, new: &Body, rounds: u32) -> Raised {
    let pairs = || old.curves().iter().zip(new.curves()).map(|(a, b)| (&a.friction, &b.friction));
    let rise =
        |(a, b): (&Curve, &Curve)| a.knots().iter().map(|k| b.value(*k) - a.value(*k)).fold(0.0, f64::max);
    let most = |(_, b): (&Curve, &Curve)| b.knots().iter().map(|k| b.value(*k)).fold(0.0, f64::max);
    Raised {
        test_points: pairs().filter(|(a, b)| a != b).count(),
        largest_rise: pairs().map(rise).fold(0.0, f64::max),
        largest_friction: pairs().map(most).fold(0.0, f64::max),
        rounds,
    }
}

fn noted(mut parts: BodyParts, raised: &Raised) -> BodyParts {
    let note = format!(
        "friction raised to the floor of passivity at {} test points, by {:.3} at most",
        raised.test_points, raised.largest_rise
    );
    parts.provenance.notes.push(note);
    // It is the floor of this rule, of a contact that slips as a whole: two contact points would each need the floor for a friction of
    // its own, the second at 5/8 of the body's, and what is raised for that lets the first slip at states that need more.
    if parts.partial_slip {
        let note = "partial slip was switched off: the floor of passivity is that of one contact point";
        parts.provenance.notes.push(note.to_owned());
    }
    (parts.slip, parts.partial_slip) = (SlipRule::Paper, false);
    parts
}
