//! The engine's side: the same tool motion, on the body and on bodies that lack one ingredient of it.

use super::place::Place;
use super::{History, Source, Trial};
use crate::precompute::assemble::point_record;
use anyhow::Result;
use glam::{DQuat, DVec3};
use palpate_body::curve::between_rows;
use palpate_body::law::{AtDepth, Reach, coupled};
use palpate_body::{
    Body, BodyParts, CoupledLaw, Curve, Extension, Interpolation, Potential, Response, SlipRule, SurfacePoint,
};
use palpate_engine::{Ablation, Output, ToolState, Waypoint, rollout};
use palpate_identify::{CoupledFit, CoupledOptions, fit_coupled};
use palpate_simulate::{PointPaths, PointPlan};
use std::sync::Arc;

/// Friction that nothing overcomes.
const ENDLESS: f64 = 1e9;

/// What a path is answered with, state by state.
pub struct Rendered {
    /// On the body, N.
    pub forces: Vec<DVec3>,
    /// û at each contact point; that of the path where nothing touches.
    pub normals: Vec<DVec3>,
    /// Where it touches.
    pub contacts: Vec<Option<SurfacePoint>>,
}

/// What renders a path.
#[derive(Clone)]
pub struct Variant {
    pub source: Source,
    body: Arc<Body>,
    rule: SlipRule,
    tank: bool,
    partial_slip: bool,
    /// The mean of contacts side by side, whose friction is so many times the body's.
    friction: Vec<f64>,
}

impl Variant {
    /// With its own slip rule, tank, partial slip and friction.
    fn new(source: Source, body: Arc<Body>) -> Self {
        let (rule, tank, partial_slip) = (body.slip(), body.has_tank(), body.has_partial_slip());
        Variant { source, body, rule, tank, partial_slip, friction: vec![1.0] }
    }

    /// The same with another friction, in parts of the body's.
    pub fn with_friction(&self, source: Source, scale: f64) -> Self {
        Variant { source, friction: vec![scale], ..self.clone() }
    }

    /// The answer with the tool at these offsets (m) from `start`, which is where it touches first. Of a coupled body a contact
    /// point can be `held`.
    pub fn forces(
        &self,
        start: DVec3,
        inward: DVec3,
        offsets: &[DVec3],
        held: Option<SurfacePoint>,
    ) -> Rendered {
        if let Some(at) = held.filter(|_| self.body.coupled_law().is_some()) {
            let forces = offsets.iter().map(|&offset| held_force(&self.body, at, start + offset));
            let count = offsets.len();
            return Rendered {
                forces: forces.collect(),
                normals: vec![inward; count],
                contacts: vec![Some(at); count],
            };
        }
        /// Between two steps of the engine, m: a hand at 20 mm/s and 1 kHz.
        const STRIDE: f64 = 20e-6;
        // Before the first touch, and so outside, whatever the first offset is.
        let begin = -inward * offsets.first().map_or(0.0, |o| -o.dot(inward)).max(1e-4);
        let mut way = vec![begin];
        // Where each state's last step is.
        let mut ends: Vec<usize> = Vec::with_capacity(offsets.len());
        let mut last = begin;
        for &offset in offsets {
            let steps = (last.distance(offset) / STRIDE).ceil().clamp(8.0, 1000.0);
            way.extend((1..steps as u32).map(|k| last.lerp(offset, f64::from(k) / steps)).chain([offset]));
            ends.push(way.len() - 1);
            last = offset;
        }
        let mut mean = vec![DVec3::ZERO; offsets.len()];
        let mut normals = vec![inward; offsets.len()];
        let mut contacts = vec![None; offsets.len()];
        for scale in &self.friction {
            let path = way.iter().enumerate().map(|(k, &offset)| Waypoint {
                time_s: k as f64 * 1e-3,
                pose: ToolState::at((start + offset).to_array()),
            });
            let contact = rollout(&self.body, path, self.rule, Ablation::None).with_friction_scale(*scale);
            let contact = contact.with_partial_slip(self.partial_slip);
            let contact = if self.tank { contact } else { contact.without_tank() };
            let outputs: Vec<Output> = contact.collect();
            for (i, output) in ends.iter().map(|end| &outputs[*end]).enumerate() {
                mean[i] -= DVec3::from_array(output.force_n) / self.friction.len() as f64;
                if let Some(c) = output.contact {
                    let at = SurfacePoint { element: c.element, n: c.n };
                    normals[i] = self.body.inward(at);
                    contacts[i] = Some(at);
                }
            }
        }
        Rendered { forces: mean, normals, contacts }
    }
}

/// All that every path of a trial is rendered by; the body itself first.
pub fn variants(body: &Body, trial: &Trial) -> Result<Vec<Variant>> {
    let own = Arc::new(match trial.history {
        History::FrictionlessPress | History::Stick => sticking(body, trial.normal_max_m)?,
        History::Coulomb | History::Frictionless => body.clone(),
    });
    let as_it_is = Variant::new(Source::Body, own.clone());
    let mut all = vec![as_it_is.clone()];
    let rules = SlipRule::ALL.into_iter().filter(|rule| *rule != body.slip());
    if matches!(trial.history, History::Coulomb | History::Frictionless) {
        all.extend(rules.map(|rule| Variant { source: slip(rule), rule, ..as_it_is.clone() }));
    }
    if trial.history == History::Coulomb {
        if body.has_tank() {
            all.push(Variant { source: Source::WithoutTank, tank: false, ..as_it_is.clone() });
        }
        let one = Variant { source: Source::OnePoint, partial_slip: false, ..as_it_is.clone() };
        all.push(Variant { source: Source::EightPoints, friction: partial_slip(), ..one.clone() });
        if body.has_partial_slip() {
            all.push(one);
        }
    }
    if let Some(law) = own.coupled_law() {
        let depth = trial.drag_depths_m.first().copied().unwrap_or(0.6 * trial.normal_max_m);
        for (source, lacks) in lacking(depth, &trial.friction) {
            let potentials: Vec<Potential> =
                law.potentials.iter().map(&lacks).collect::<palpate_body::Result<_>>()?;
            // Only free paths slip; and where nothing is lacking nothing is told.
            let told = source != Source::FlatFriction
                || (trial.history == History::Coulomb && potentials != law.potentials);
            if !told {
                continue;
            }
            let coupled = Some(CoupledLaw { potentials, ..law.clone() });
            all.push(Variant::new(source, Arc::new(Body::new(BodyParts { coupled, ..own.parts() })?)));
        }
    }
    if !own.is_isotropic() {
        let alike = Body::new(BodyParts { lateral_tensors: None, ..own.parts() })?;
        all.push(Variant::new(Source::Isotropic, Arc::new(alike)));
    }
    if trial.history == History::Frictionless {
        all.iter_mut().for_each(|v| v.friction = vec![0.0]);
    }
    Ok(all)
}

/// The potential that these paths at a place give, everywhere on the body; none if they give none.
pub fn own_potential(
    body: &Body,
    trial: &Trial,
    place: &Place,
    plan: &PointPlan,
    paths: &PointPaths,
    variants: &[Variant],
) -> Option<Variant> {
    let parts = body.parts();
    let nearest = (0..3).max_by(|&i, &j| place.at.n[i].total_cmp(&place.at.n[j]))?;
    let node = body.element_node_numbers(place.at.element)[nearest];
    let record = point_record(node, paths, plan);
    let options = CoupledOptions {
        friction: if trial.friction.is_empty() { vec![(0.0, 0.0)] } else { trial.friction.clone() },
        range_m: Some(trial.lateral_max_m),
        tool_radius_m: Some(body.tool().radius_m()),
        ..CoupledOptions::default()
    };
    let CoupledFit { mut law, test_point_nodes, blends, .. } =
        fit_coupled(&parts.surface, &[record], &options).ok()?;
    // From the tangent plane of the place into that of the node which a body wants it at.
    for (p, &node) in law.potentials.iter_mut().zip(&test_point_nodes) {
        let [t1, t2] = p.tangents;
        let turn = DQuat::from_rotation_arc(t1.cross(t2), body.nodes()[node as usize].inward);
        p.tangents = [turn * t1, turn * t2];
    }
    let coupled = Some(law);
    let (responses, lateral_tensors) = (Vec::new(), None);
    let own = BodyParts { coupled, responses, lateral_tensors, blends, test_point_nodes, ..parts };
    let own = Body::new(own).ok()?;
    Some(Variant { source: Source::OwnPotential, body: Arc::new(own), ..variants.first()?.clone() })
}

fn slip(rule: SlipRule) -> Source {
    match rule {
        SlipRule::Exact => Source::ExactSlip,
        SlipRule::Consistent => Source::ConsistentSlip,
        _ => Source::PaperSlip,
    }
}

/// Frictions of contacts side by side that give together what a ball's partial slip gives (Mindlin): f_t/L =
/// 1 − (1 − x)^1.5 at x = k_t δ/(1.5 L). Of contacts that slip at x, −d²(f_t/L)/dx² ∝ (1 − x)^−½ is the
/// density; the share of those up to x is 1 − (1 − x)^½, and one that slips there holds 1.5 x times what it
/// would alone.
fn partial_slip() -> Vec<f64> {
    /// The force is then off by less than 0.002 L.
    const CONTACTS: u32 = 8;
    let remaining = (0..CONTACTS).map(|i| 1.0 - (f64::from(i) + 0.5) / f64::from(CONTACTS));
    remaining.map(|q| 1.5 * (1.0 - q * q)).collect()
}

/// What takes an ingredient from a potential.
type Lacking = Box<dyn Fn(&Potential) -> palpate_body::Result<Potential>>;

fn lacking(depth: f64, rows: &[(f64, f64)]) -> [(Source, Lacking); 4] {
    let rows = rows.to_vec();
    let flat = move |p: &Potential| -> palpate_body::Result<Potential> {
        let knots = p.friction.knots();
        let values: Vec<f64> = knots.iter().map(|&k| between_rows(&rows, k).unwrap_or(0.0)).collect();
        let friction = Curve::through(knots, &values, Interpolation::Linear, Extension::Constant)?;
        Ok(Potential { friction, curvature: [0.0; 3], ..p.clone() })
    };
    let none = |c: &Curve| Curve::blend(&[(0.0, c)]);
    let straight = move |p: &Potential| -> palpate_body::Result<Potential> {
        Ok(Potential { offset: [none(&p.offset[0])?, none(&p.offset[1])?], ..p.clone() })
    };
    let quadratic = move |p: &Potential| -> palpate_body::Result<Potential> {
        let [a, b, c, d] = p.cubic.each_ref().map(none);
        Ok(Potential { cubic: [a?, b?, c?, d?], quartic: none(&p.quartic)?, ..p.clone() })
    };
    let decoupled = move |p: &Potential| -> palpate_body::Result<Potential> {
        let p = quadratic(&straight(p)?)?;
        let alike = |c: &Curve| constant(c, c.value(depth));
        let [a, b, c] = p.stiffness.each_ref().map(alike);
        Ok(Potential { stiffness: [a?, b?, c?], ..p })
    };
    [
        (Source::FlatFriction, Box::new(flat)),
        (Source::WithoutOffset, Box::new(straight)),
        (Source::WithoutHigherTerms, Box::new(quadratic)),
        (Source::Decoupled, Box::new(decoupled)),
    ]
}

/// A curve that is `value` everywhere, on the knots of another.
fn constant(like: &Curve, value: f64) -> palpate_body::Result<Curve> {
    Curve::through(like.knots(), &vec![value; like.knots().len()], Interpolation::Linear, Extension::Constant)
}

/// A coupled body's law at a contact point that is held, with the tool at `tool` (m): the force on the body, N.
///
/// A ball first touches where a facet is nearest, up to half a millimetre beside the place whose frame points to it. Held there it would
/// lean from the start, which friction does not let it; here it is held where it was aimed at.
pub fn held_force(body: &Body, at: SurfacePoint, tool: DVec3) -> DVec3 {
    let Some(law) = body.coupled_law() else { return DVec3::ZERO };
    let (u, offset) = (body.inward(at), tool - body.point(at));
    let depth = offset.dot(u) + body.tool().radius_m();
    if depth <= 0.0 {
        return DVec3::ZERO;
    }
    let lateral = offset.reject_from_normalized(u);
    let reach = Reach::new(lateral.length_squared(), law.range_m);
    let mut force = DVec3::ZERO;
    for (node, n) in body.element_nodes(at.element).into_iter().zip(at.n) {
        for (weight, t) in node.weights.into_iter().zip(node.test_points).filter(|(w, _)| *w > 0.0) {
            let potential = &law.potentials[t as usize];
            let [t1, t2] = potential.tangents;
            let curves = potential.curves();
            let at = AtDepth { value: curves.map(|c| c.value(depth)), slope: curves.map(|c| c.slope(depth)) };
            let f = coupled(&at, [t1.dot(lateral), t2.dot(lateral)], &reach);
            let p = t1 * f.lateral[0] + t2 * f.lateral[1] + lateral * f.radial;
            force += (u * f.normal + p.reject_from_normalized(u)) * (weight * n);
        }
    }
    force
}

/// The body without friction down to a hundredth of the greatest depth (m), where the contact settles, and with more friction than can be
/// overcome from two hundredths on.
///
/// # Errors
/// The responses can't be brought onto the further knots.
pub fn sticking(body: &Body, normal_max_m: f64) -> Result<Body> {
    /// Shares of the greatest depth between which friction comes.
    const ONSET: [f64; 2] = [0.01, 0.02];
    let onset = ONSET.map(|share| share * normal_max_m);
    // Knots with the onset's, unless there is one at that depth already, and friction on them.
    let friction = |like: &Curve| -> Result<Curve> {
        let mut knots = like.knots().to_vec();
        let new = |o: &f64| like.knots().iter().all(|k| (k - o).abs() > 1e-7);
        knots.extend(onset.iter().copied().filter(new));
        knots.sort_by(f64::total_cmp);
        let endless = |k: &f64| *k > onset[0] + 1e-7;
        let values: Vec<f64> = knots.iter().map(|k| if endless(k) { ENDLESS } else { 0.0 }).collect();
        Ok(Curve::through(&knots, &values, Interpolation::Linear, Extension::Constant)?)
    };
    let mut parts = body.parts();
    for response in &mut parts.responses {
        let friction = friction(&response.normal)?;
        let normal = exact(&response.normal.on_knots(friction.knots())?)?;
        *response = Response { normal, friction, lateral: response.lateral.clone() };
    }
    for p in parts.coupled.iter_mut().flat_map(|law| &mut law.potentials) {
        let friction = friction(&p.press)?;
        let on = |c: &Curve| c.on_knots(friction.knots());
        let ([b1, b2], [k1, k2, k3]) = (p.offset.each_ref().map(on), p.stiffness.each_ref().map(on));
        let [c1, c2, c3, c4] = p.cubic.each_ref().map(on);
        *p = Potential {
            tangents: p.tangents,
            press: on(&p.press)?,
            offset: [b1?, b2?],
            stiffness: [k1?, k2?, k3?],
            cubic: [c1?, c2?, c3?, c4?],
            quartic: on(&p.quartic)?,
            friction,
            curvature: p.curvature,
        };
    }
    Ok(Body::new(parts)?)
}

/// Without the decrease below 0 that rounding may give.
fn exact(curve: &Curve) -> Result<Curve> {
    let mut ordinates = curve.ordinates().to_vec();
    for i in 0..ordinates.len() {
        for j in 0..4 {
            let before = if j > 0 {
                ordinates[i][j - 1]
            } else if i > 0 {
                ordinates[i - 1][3]
            } else {
                0.0
            };
            let rounding = 1e-9 * before.abs();
            if ordinates[i][j] < before && before - ordinates[i][j] <= rounding {
                ordinates[i][j] = before;
            }
        }
    }
    Ok(Curve::from_ordinates(curve.knots(), &ordinates, curve.extension())?)
}
