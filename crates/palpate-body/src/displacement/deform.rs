//! The deformed surface of a body for a state of the contact.

use super::clearance::Clearance;
use super::dimple::Dimple;
use super::fields::{DisplacementFields, FieldSet, smoothstep};
use super::geometry::{Binding, Facets};
use super::lazy::StoredFields;
use crate::error::Result;
use crate::search::SurfacePoint;
use crate::{Body, ContactModel};
use glam::{DQuat, DVec3};

/// Where a body is touched, and where the tool is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactState {
    /// The contact point.
    pub at: SurfacePoint,
    /// The tool's reference point, in the body's frame: a ball's centre, otherwise the tip, m.
    pub tool_m: DVec3,
}

impl ContactState {
    /// The tool pressed straight in at a point of the surface, m deep.
    pub fn pressed(body: &ContactModel, at: SurfacePoint, depth_m: f64) -> Self {
        let inward = body.inward(at);
        ContactState { at, tool_m: body.point(at) + inward * (depth_m - body.tool().radius_m()) }
    }

    /// How the surface moves if nothing else is known of it; `None` where the tool does not reach in.
    pub fn dimple(&self, body: &ContactModel) -> Option<Dimple> {
        let contact = self.kinematics(body);
        contact.reaches_in().then(|| contact.dimple(body.tool().radius_m()))
    }

    fn kinematics(&self, body: &ContactModel) -> Kinematics {
        let (point, inward) = (body.point(self.at), body.inward(self.at));
        let offset = self.tool_m - point;
        let along = offset.dot(inward);
        Kinematics { point, inward, depth: along + body.tool().radius_m(), lateral: offset - inward * along }
    }
}

/// Contact point, frame and deflection, m.
#[derive(Debug, Clone, Copy)]
struct Kinematics {
    point: DVec3,
    inward: DVec3,
    depth: f64,
    lateral: DVec3,
}

impl Kinematics {
    fn reaches_in(&self) -> bool {
        self.depth > 0.0 && self.depth.is_finite() && self.lateral.is_finite()
    }

    fn dimple(&self, radius: f64) -> Dimple {
        let motion = self.inward * self.depth + self.lateral;
        Dimple::new(self.point, self.inward, motion, self.depth, radius)
    }
}

/// Gives the displaced positions of a body's nodes: from its displacement fields or, where it has none, as a dimple that
/// fits depth and tool.
///
/// ```
/// # use palpate_body::{Body, ContactState, Deformer, Response, SurfacePoint, shape::Shape};
/// # let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default())?;
/// # let body = Body::uniform(ball, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3)?)?;
/// let mut deformer = Deformer::new(&body)?;
/// let at = SurfacePoint { element: 0, n: [1.0, 0.0, 0.0] };
/// let mut positions = Vec::new(); // reused from picture to picture
/// deformer.displace(&body, &ContactState::pressed(&body, at, 2e-3), &mut positions);
/// let deepest = body.nodes().iter().zip(&positions).map(|(n, p)| p.distance(n.position)).fold(0.0, f64::max);
/// assert!((deepest - 2e-3).abs() < 1e-6);
/// # Ok::<(), palpate_body::BodyError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Deformer {
    body: (u64, usize),
    fields: Option<Prepared>,
    clearance: Clearance,
    /// Of a place, and of all of them, at the field surface's nodes, m.
    field: Vec<DVec3>,
    sum: Vec<DVec3>,
    aside: Vec<DVec3>,
    blend: Vec<(u32, f64)>,
}

/// A body's fields, and where its nodes lie on what they are given on.
#[derive(Debug, Clone)]
struct Prepared {
    fields: StoredFields,
    facets: Facets,
    bindings: Vec<Binding>,
    /// How wide fields' sharp parts are, m.
    width: f64,
}

impl Deformer {
    /// Reads the body's fields and finds where its nodes lie on them: about a microsecond a node.
    ///
    /// # Errors
    /// Fields that can't be read, or are damaged.
    pub fn new(body: &Body) -> Result<Self> {
        let prepare = |fields: &StoredFields| {
            let found = fields.get()?;
            let facets = Facets::new(found.surface());
            let bindings = facets.bind(found.surface(), body.nodes().iter().map(|n| n.position));
            let press = found.press();
            let deepest = (0..press.places()).map(|p| press.deepest_m(p)).fold(0.0, f64::max);
            let width = deepest.max(body.tool().radius_m());
            Ok(Prepared { fields: fields.clone(), facets, bindings, width })
        };
        Ok(Deformer {
            body: (body.identity(), body.nodes().len()),
            fields: body.displacements.as_ref().map(prepare).transpose()?,
            clearance: Clearance::default(),
            field: Vec::new(),
            sum: Vec::new(),
            aside: Vec::new(),
            blend: Vec::new(),
        })
    }

    /// Whether fields of a simulation are used, not a dimple.
    pub fn has_fields(&self) -> bool {
        self.fields.is_some()
    }

    /// The displaced positions (m) of the body's nodes, in their order: those at rest where the tool does not reach in, or where
    /// `body` is not the one that this was made for. They depend on body and state alone, and nodes of one vertex stay
    /// together. A ball does not show through: what fields leave inside it is moved out.
    pub fn displace(&mut self, body: &Body, state: &ContactState, positions: &mut Vec<DVec3>) {
        positions.clear();
        positions.extend(body.nodes().iter().map(|n| n.position));
        let contact = state.kinematics(body);
        if !contact.reaches_in() || self.body != (body.identity(), body.nodes().len()) {
            return;
        }
        let radius = body.tool().radius_m();
        let Deformer { fields, clearance, field, sum, aside, blend, .. } = self;
        match fields {
            Some(prepared) => match prepared.fields.get() {
                Ok(found) => {
                    let mut blending = Blending { prepared, found, contact, field, aside };
                    blending.displace(body, state.at, blend, sum);
                    let moves = prepared.bindings.iter().map(|b| b.of(found.surface(), sum));
                    positions.iter_mut().zip(moves).for_each(|(p, u)| *p += u);
                }
                // They were read when this was made.
                Err(_) => return,
            },
            None => make_dimple(body, &contact.dimple(radius), positions),
        }
        if radius > 0.0 {
            clearance.push_out(body, state.tool_m, radius, contact.depth, positions);
        }
    }
}

/// Without fields.
fn make_dimple(body: &Body, dimple: &Dimple, positions: &mut [DVec3]) {
    // By vertices: nodes on the two sides of a crease must move alike.
    let mut inward = vec![DVec3::ZERO; body.nodes().len()];
    for (node, &vertex) in body.nodes().iter().zip(&body.vertices) {
        inward[vertex as usize] += node.inward;
    }
    for ((node, &vertex), p) in body.nodes().iter().zip(&body.vertices).zip(positions) {
        *p += dimple.displacement(node.position, inward[vertex as usize].normalize_or(node.inward));
    }
}

/// What fields are blended from, and room for it.
struct Blending<'a> {
    prepared: &'a Prepared,
    found: &'a DisplacementFields,
    contact: Kinematics,
    field: &'a mut Vec<DVec3>,
    aside: &'a mut Vec<DVec3>,
}

impl Blending<'_> {
    /// The displacement of the field surface's nodes into `sum`, m.
    fn displace(&mut self, body: &Body, at: SurfacePoint, blend: &mut Vec<(u32, f64)>, sum: &mut Vec<DVec3>) {
        let (press, lateral) = (self.found.press(), self.found.lateral());
        let Kinematics { inward, depth, lateral: motion, .. } = self.contact;
        let count = self.found.surface().positions().len();
        let clear = |field: &mut Vec<DVec3>| {
            field.clear();
            field.resize(count, DVec3::ZERO);
        };
        clear(sum);
        blend_at(body, at, press, blend);
        for &(place, weight) in blend.iter() {
            self.add(press, place as usize, [depth, weight], None, sum);
        }
        if lateral.places() == 0 {
            // Nothing was dragged: laterally a node follows the tool about as much as it does inwards.
            for u in sum.iter_mut() {
                let share = (u.dot(inward) / depth).clamp(0.0, 1.0);
                *u += motion * libm::pow(share, 1.3);
            }
            return;
        }
        let mut aside = std::mem::take(self.aside);
        clear(&mut aside);
        blend_at(body, at, lateral, blend);
        let least =
            blend.iter().map(|&(place, _)| lateral.least_m(place as usize)).fold(f64::INFINITY, f64::min);
        for &(place, weight) in blend.iter() {
            self.add(lateral, place as usize, [depth, weight], Some(motion), &mut aside);
        }
        if depth < least {
            // Less deep than any drag the patch is smaller: what moves falls as it does from one press to the other.
            let mut deeper = Vec::new();
            clear(&mut deeper);
            blend_at(body, at, press, blend);
            for &(place, weight) in blend.iter() {
                self.add(press, place as usize, [least, weight], None, &mut deeper);
            }
            for ((v, u), deeper) in aside.iter_mut().zip(sum.iter()).zip(&deeper) {
                let [share, whole] = [u.length() / depth, deeper.length() / least];
                *v *= if whole > share { share / whole } else { 1.0 };
            }
        }
        sum.iter_mut().zip(&aside).for_each(|(u, v)| *u += *v);
        *self.aside = aside;
    }

    /// Adds a place's field at a depth (m), times a weight, moved along: near the contact point the field is that around the place,
    /// turned from its frame into the contact point's; far away it stays where it is, as supports do.
    fn add(
        &mut self,
        set: &FieldSet,
        place: usize,
        [depth, weight]: [f64; 2],
        lateral: Option<DVec3>,
        sum: &mut [DVec3],
    ) {
        let Kinematics { point, inward, .. } = self.contact;
        let [place_inward, tangent] = set.axes[place];
        let centre = set.points[place];
        let turn = DQuat::from_rotation_arc(inward, place_inward);
        let by = lateral.map(|motion| {
            let motion = turn * motion;
            [motion.dot(tangent), motion.dot(place_inward.cross(tangent))]
        });
        let surface = self.found.surface();
        set.expand(surface, place, depth, by, self.field);
        let back = turn.inverse();
        let width = self.prepared.width;
        let (inner, outer) = (2.0 * width, 5.0 * width);
        for (n, (&x, sum)) in surface.positions().iter().zip(sum).enumerate() {
            let from = x - point;
            let distance = from.length();
            if distance >= outer {
                *sum += self.field[n] * weight;
                continue;
            }
            let near = 1.0 - smoothstep((distance - inner) / (outer - inner));
            let moved = x + (centre + turn * from - x) * near;
            let u = if moved.distance_squared(x) < 1e-18 {
                self.field[n]
            } else {
                self.prepared.facets.sample(surface, n, moved, self.field)
            };
            *sum += u.lerp(back * u, near) * weight;
        }
    }
}

/// Which places' fields a point of the body blends, and how much each counts: the forces' weights.
fn blend_at(body: &ContactModel, at: SurfacePoint, set: &FieldSet, blend: &mut Vec<(u32, f64)>) {
    blend.clear();
    for (node, n) in body.element_nodes(at.element).into_iter().zip(at.n) {
        for (&test_point, &w) in node.test_points.iter().zip(&node.weights) {
            let Some(places) = set.blends.get(test_point as usize) else { continue };
            for (&place, &share) in places.test_points.iter().zip(&places.weights) {
                let weight = n * w * share;
                if weight <= 0.0 {
                    continue;
                }
                match blend.iter_mut().find(|(known, _)| *known == place) {
                    Some((_, sum)) => *sum += weight,
                    None => blend.push((place, weight)),
                }
            }
        }
    }
    let sum: f64 = blend.iter().map(|b| b.1).sum();
    if sum > 0.0 {
        blend.iter_mut().for_each(|b| b.1 /= sum);
    }
}
