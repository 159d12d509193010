//! A question to a body, and all that is found out about it.

use crate::device::{self, Device};
use crate::witness::{self, Shown};
use crate::{Certificate, Element, certificate, elements, evaluations, window};
use anyhow::{Result, anyhow, ensure};
use palpate_body::Body;
use palpate_engine::certify::{
    Assumptions, Bounds, Cell, Criterion, Effort, ElementStates, frictions, least,
};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Elements with the worst margins whose states are tried as witnesses.
const WITNESSES_TRIED: usize = 40;

/// What is asked of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct Question {
    /// For which motions.
    pub assumptions: Assumptions,
    /// Bounds computed for each element and certificate, at most; [`evaluations`] where there is none.
    pub evaluations: Option<u32>,
    /// The device whose sampled loop is judged, too.
    pub device: Option<Device>,
    /// Whether to search how P and S fare with less and more friction.
    pub window: bool,
}

impl Question {
    /// Of the body's own rule, and no device.
    pub fn of(body: &Body) -> Self {
        Question {
            assumptions: Assumptions { slip: body.slip(), ..Assumptions::default() },
            evaluations: None,
            device: None,
            window: false,
        }
    }

    fn check(&self) -> Result<()> {
        let positive = |name: &str, x: f64| {
            ensure!(x > 0.0 && x.is_finite(), "{name} is {x}; give a number above 0");
            Ok(())
        };
        let not_negative = |name: &str, x: f64| {
            ensure!(x >= 0.0 && x.is_finite(), "{name} is {x}; give 0 or more");
            Ok(())
        };
        positive("step_m", self.assumptions.step_m)?;
        positive("depth_m", self.assumptions.depth_m.unwrap_or(1.0))?;
        let Some(device) = &self.device else { return Ok(()) };
        positive("rate_hz", device.rate_hz)?;
        not_negative("damping_n_s_per_m", device.damping_n_s_per_m)?;
        not_negative("position_error_m", device.position_error_m)?;
        not_negative("coulomb_n", device.coulomb_n)?;
        not_negative("delay_samples", device.delay_samples)
    }
}

/// What was found out.
#[derive(Debug, Clone)]
pub struct Certified {
    /// Of the whole body.
    pub certificate: Certificate,
    /// Of each element.
    pub elements: Vec<Element>,
}

/// Answers a question on the threads of rayon's pool that it is called in. `done` is called after each element; nothing is
/// answered once `cancelled` is true.
///
/// # Errors
/// A number that can't be, by its name.
pub fn certify(
    body: &Body,
    question: &Question,
    done: &(dyn Fn() + Sync),
    cancelled: &AtomicBool,
) -> Result<Option<Certified>> {
    question.check()?;
    let assumptions = &question.assumptions;
    let evaluations = question.evaluations.unwrap_or_else(|| evaluations(body, assumptions.slip));
    let Some(elements) = elements(body, assumptions, evaluations, done, cancelled) else { return Ok(None) };
    let mut found = certificate(body, assumptions, &elements);
    if question.window {
        let Some(rows) = window(body, assumptions, cancelled) else { return Ok(None) };
        found.window = rows;
    }
    if let Some(device) = question.device {
        let asked = device.position_error_m > 0.0 && found.snap_free.holds;
        let pace = if asked { pace(body, assumptions, &elements, evaluations, cancelled) } else { None };
        found.device = Some(device::limits(body, device, found.lipschitz_n_per_m, pace));
    }
    let tried = |bounds: BoundsOf, of: WitnessOf| {
        worst(&elements, bounds)
            .take_while(|_| !cancelled.load(Ordering::Relaxed))
            .find_map(|(e, (b, friction))| of(body, &assumptions.with_friction(friction), e, &b.at?))
    };
    found.passive.witness = tried(Element::passive_bounds, witness::of_energy);
    found.snap_free.witness = tried(Element::snap_free_bounds, witness::of_snap);
    // What was cut short is no answer.
    let answer = Certified { certificate: found, elements };
    Ok((!cancelled.load(Ordering::Relaxed)).then_some(answer))
}

/// The same on threads of its own, which end with the call: so many, or one for each core with 0.
///
/// # Errors
/// As [`certify`], or the system gives no threads.
pub fn certify_on(
    threads: usize,
    body: &Body,
    question: &Question,
    done: &(dyn Fn() + Sync),
    cancelled: &AtomicBool,
) -> Result<Option<Certified>> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.min(1024))
        .build()
        .map_err(|e| anyhow!("threads can't be started ({e}); give fewer"))?;
    pool.install(|| certify(body, question, done, cancelled))
}

type BoundsOf = fn(&Element) -> (&Bounds, f64);

type WitnessOf = fn(&Body, &Assumptions, u32, &Cell) -> Option<Shown>;

/// Elements that break a certificate, the worst first.
fn worst(elements: &[Element], bounds: BoundsOf) -> impl Iterator<Item = (u32, (&Bounds, f64))> + use<'_> {
    let mut order: Vec<(u32, (&Bounds, f64))> = (0..).zip(elements.iter().map(bounds)).collect();
    order.retain(|(_, (b, _))| b.found < 0.0);
    order.sort_by(|a, b| a.1.0.found.total_cmp(&b.1.0.found));
    order.into_iter().take(WITNESSES_TRIED)
}

/// The bound of |Δc|/|Δx|.
fn pace(
    body: &Body,
    assumptions: &Assumptions,
    elements: &[Element],
    evaluations: u32,
    cancelled: &AtomicBool,
) -> Option<f64> {
    let effort = Effort { evaluations, absolute: 0.01, relative: 0.1 };
    let of = |(element, proved): (usize, &Element)| {
        if cancelled.load(Ordering::Relaxed) {
            return f64::NEG_INFINITY;
        }
        let each = frictions(body).iter().map(|&friction| {
            let patch = ElementStates::new(body, element as u32, &assumptions.with_friction(friction))
                .snap_free(proved.snap_free.proved);
            least(Criterion::Pace, &patch, &patch.cells(), effort).proved
        });
        each.fold(f64::INFINITY, f64::min)
    };
    let least = elements.par_iter().enumerate().map(of).reduce(|| 0.0, f64::min);
    (least > f64::NEG_INFINITY).then_some(-least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_body::Response;
    use palpate_body::shape::{Resolution, Shape};
    use palpate_engine::PARTIAL_SLIP;
    use std::sync::atomic::AtomicUsize;

    /// Of two contact points the worse, with its friction; and a path that shows what it breaks.
    #[test]
    fn partial_slip_is_bounded_for_both_frictions() {
        let surface = Shape::Cylinder { radius_mm: 30.0, length_mm: 60.0, caps: false }
            .surface(Resolution { edge_length_mm: Some(15.0), ..Default::default() })
            .unwrap();
        let body = Body::uniform(surface, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()).unwrap();
        let partial = body.clone().with_partial_slip(true);
        let question = Question { evaluations: Some(200), ..Question::of(&partial) };
        let never = AtomicBool::new(false);
        let found = certify(&partial, &question, &|| (), &never).unwrap().unwrap().elements;
        let both = PARTIAL_SLIP.map(|friction| {
            let assumptions = question.assumptions.with_friction(friction);
            certify(&body, &Question { assumptions, ..question.clone() }, &|| (), &never)
                .unwrap()
                .unwrap()
                .elements
        });
        let mut frictions = [0; 2];
        for (i, element) in found.iter().enumerate() {
            let [a, b] = [&both[0][i], &both[1][i]];
            assert_eq!(element.passive.proved, a.passive.proved.min(b.passive.proved));
            assert_eq!(element.snap_free.proved, a.snap_free.proved.min(b.snap_free.proved));
            assert_eq!(element.snap_free.found, a.snap_free.found.min(b.snap_free.found));
            let least = if a.passive.found <= b.passive.found { 0 } else { 1 };
            assert_eq!(element.passive.found, [a, b][least].passive.found);
            assert_eq!(element.passive_friction, PARTIAL_SLIP[least]);
            assert_eq!(element.lipschitz.is_some(), a.lipschitz.is_some() && b.lipschitz.is_some());
            frictions[least] += 1;
        }
        // P is worst where friction is least.
        assert!(frictions[1] > frictions[0], "{frictions:?}");
    }

    /// The search over frictions takes longer than all the bounds before it.
    #[test]
    fn the_search_over_frictions_is_cancelled_too() {
        let surface = Shape::Sphere { radius_mm: 30.0 }
            .surface(Resolution { edge_length_mm: Some(20.0), ..Default::default() })
            .unwrap();
        let body = Body::uniform(surface, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()).unwrap();
        let question = Question { evaluations: Some(10), window: true, ..Question::of(&body) };
        let never = AtomicBool::new(false);
        let rows = window(&body, &question.assumptions, &never).unwrap();
        assert_eq!(rows.len(), 6);
        assert!(window(&body, &question.assumptions, &AtomicBool::new(true)).is_none());
        // Cancelled with the last element, when only the search is left.
        let (cancelled, left) = (AtomicBool::new(false), AtomicUsize::new(body.elements().len()));
        let done = || {
            if left.fetch_sub(1, Ordering::Relaxed) == 1 {
                cancelled.store(true, Ordering::Relaxed);
            }
        };
        assert!(certify(&body, &question, &done, &cancelled).unwrap().is_none());
    }
}
