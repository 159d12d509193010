//! A rigid tool against the deformable surface.
//!
//! The surface is asked at six points of each face (Dunavant 1985, degree 4) how deep it lies in the tool, and pushed
//! out by a pressure in proportion: energy ½ε⟨−φ⟩² for each unit of surface at rest, φ the signed distance from the
//! tool. The penalty ε is 50 contact moduli over a face's size, so that the surface enters the tool by 2 % of what it
//! is indented locally over one face, and the energy stays smooth enough for Newton's method. Sticking adds a spring
//! of the same stiffness, along the tool's surface, between a point and the place on the tool where it was caught. Under
//! Coulomb friction the spring yields at μ times the pressure: with the limit taken from the last solution, forces and
//! stiffness are those of an energy still (½ε s² up to the limit, straight on beyond it), and solving anew with the pressures
//! found ends where both agree.

use crate::material::Moduli;
use crate::model::Model;
use crate::path::StuckTangent;
use crate::stiffness::Stiffness;
use crate::tool::{Placement, RigidTool, outer};
use glam::{DMat3, DVec3};

/// Penalty in contact moduli E/(1 − ν²) over the face's size.
const PENALTY: f64 = 50.0;

/// How much of the Hessian's softening along a slip is taken, between the secant's stiffness (0) and Newton's (1): under a sphere
/// on a half space presses with partial slip took 53 steps, with 0 and 1 they took 116 and 74.
const TOWARDS_NEWTON: f64 = 0.7;

/// Points of a face.
const POINTS: usize = 6;

/// Area coordinates and weights of a face's points, and the six shape functions there.
pub(crate) fn rule() -> [(f64, [f64; 6]); POINTS] {
    const A: (f64, f64) = (0.445_948_490_915_965, 0.223_381_589_678_011);
    const B: (f64, f64) = (0.091_576_213_509_771, 0.109_951_743_655_322);
    std::array::from_fn(|q| {
        let (near, weight) = if q < 3 { A } else { B };
        let mut l = [near; 3];
        l[q % 3] = 1.0 - 2.0 * near;
        let shape = [
            l[0] * (2.0 * l[0] - 1.0),
            l[1] * (2.0 * l[1] - 1.0),
            l[2] * (2.0 * l[2] - 1.0),
            4.0 * l[0] * l[1],
            4.0 * l[1] * l[2],
            4.0 * l[2] * l[0],
        ];
        (weight, shape)
    })
}

/// Where on the tool a point of the surface was caught, in the tool's axes.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    /// From the tip, m.
    place: DVec3,
    /// The tool's outward normal there.
    normal: DVec3,
    /// How far the point can be from the place along the tool before it slips, with the penalties unscaled, m; infinite where it sticks.
    limit: f64,
}

/// The points that are caught, for each face.
#[derive(Clone)]
pub(crate) struct Anchors(Vec<[Option<Anchor>; POINTS]>);

/// Force and more of a contact.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Resultant {
    pub force_n: DVec3,
    /// About the tip.
    pub torque_n_m: DVec3,
    /// Of the surface at rest.
    pub patch_m2: f64,
    /// Pressures, whatever their directions, N.
    pub pressed_n: f64,
    /// Those of points that slip, N.
    pub slipping_n: f64,
}

/// A placed tool against the whole surface of a model.
pub(crate) struct ToolContact<'t> {
    tool: &'t RigidTool,
    pub placement: Placement,
    faces: Vec<Face>,
    rule: [(f64, [f64; 6]); POINTS],
    /// For each face's point; empty while nothing is caught.
    anchors: Vec<[Option<Anchor>; POINTS]>,
    /// The only faces that are looked at, while there are such.
    watched: Option<Vec<u32>>,
    /// What the penalties are multiplied with: 1, but on the way to a solution. Friction holds the same forces.
    pub penalty_scale: f64,
}

struct Face {
    /// Inner numbers.
    nodes: [u32; 6],
    /// At rest, m².
    area: f64,
    /// N/m³.
    penalty: f64,
    /// Of a ball around the face's middle that holds it at rest, m.
    radius: f64,
}

/// What of the contact's stiffness is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Tangent {
    Full,
    /// Without what the tool's curvature takes from it: never negative.
    Convex,
}

/// A point of the surface that the tool pushes or holds, body's axes.
struct Touch<'a> {
    face: &'a Face,
    shape: &'a [f64; 6],
    weight: f64,
    at: DVec3,
    /// Signed distance with gradient and Hessian; a point outside counts as on the tool's surface.
    distance: f64,
    normal: DVec3,
    curvature: DMat3,
    grip: Option<Grip>,
}

/// What holds a point along the tool.
#[derive(Clone, Copy)]
struct Grip {
    anchor: Anchor,
    /// From where it was caught, along the tool, m.
    stretch: DVec3,
    /// The tool's normal where it was caught.
    normal: DVec3,
}

impl<'t> ToolContact<'t> {
    pub fn new(model: &Model, tool: &'t RigidTool, placement: Placement) -> Self {
        let boundary = model.boundary();
        let faces = boundary.faces.iter().zip(&boundary.elements).map(|(face, &element)| {
            let p = face.map(|n| model.mesh().positions[n as usize]);
            let area = 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).length();
            let tissue = &model.tissues[model.mesh().regions[element as usize] as usize];
            let Moduli { shear_pa: mu, bulk_pa: bulk } = tissue.material.small_strain();
            // E/(1 − ν²)
            let modulus = 4.0 * mu * (3.0 * bulk + mu) / (3.0 * bulk + 4.0 * mu);
            let middle = (p[0] + p[1] + p[2]) / 3.0;
            Face {
                nodes: face.map(|n| model.rank[n as usize]),
                area,
                penalty: PENALTY * modulus / area.sqrt().max(1e-12),
                radius: p.iter().map(|p| p.distance(middle)).fold(0.0, f64::max),
            }
        });
        ToolContact {
            tool,
            placement,
            faces: faces.collect(),
            rule: rule(),
            anchors: Vec::new(),
            watched: None,
            penalty_scale: 1.0,
        }
    }

    pub fn tool(&self) -> &RigidTool {
        self.tool
    }

    fn distance(&self, at: DVec3) -> f64 {
        self.placement.distance_at(self.tool, at).value
    }

    /// Calls `visit` for every point of the surface that is in the tool, or sticks to it.
    fn each_touch(&self, model: &Model, u: &[f64], mut visit: impl FnMut(usize, usize, Touch)) {
        let looked_at = self.watched.as_ref().map_or(self.faces.len(), Vec::len);
        for f in 0..looked_at {
            let f = self.watched.as_ref().map_or(f, |watched| watched[f] as usize);
            let face = &self.faces[f];
            let p = face.nodes.map(|node| model.place(node, u));
            let middle = (p[0] + p[1] + p[2]) / 3.0;
            let radius = p.iter().map(|p| p.distance(middle)).fold(face.radius, f64::max);
            let anchors = self.anchors.get(f).unwrap_or(&[None; POINTS]);
            if self.distance(middle) > 1.5 * radius && anchors.iter().all(Option::is_none) {
                continue;
            }
            for (q, (weight, shape)) in self.rule.iter().enumerate() {
                let at: DVec3 = shape.iter().zip(&p).map(|(n, p)| *p * *n).sum();
                let distance = self.placement.distance_at(self.tool, at);
                // A point that sticks is held along the tool even where it lifts off: letting go in the midst of a
                // solve would make the energy jump.
                if distance.value >= 0.0 && anchors[q].is_none() {
                    continue;
                }
                let grip = anchors[q].map(|mut anchor| {
                    anchor.limit /= self.penalty_scale;
                    let normal = self.placement.rotation * anchor.normal;
                    let moved = at - self.placement.tip - self.placement.rotation * anchor.place;
                    Grip { anchor, stretch: moved - normal * moved.dot(normal), normal }
                });
                let touch = Touch {
                    face,
                    shape,
                    weight: weight * face.area * self.penalty_scale,
                    at,
                    distance: distance.value.min(0.0),
                    normal: distance.gradient,
                    curvature: distance.hessian,
                    grip,
                };
                visit(f, q, touch);
            }
        }
    }

    pub fn energy(&self, model: &Model, u: &[f64]) -> f64 {
        let mut energy = 0.0;
        self.each_touch(model, u, |_, _, touch| energy += touch.energy());
        energy
    }

    pub fn assemble(&self, model: &Model, u: &[f64], gradient: &mut [f64], stiffness: &mut Stiffness) -> f64 {
        self.assemble_into(
            model,
            u,
            Tangent::Full,
            |node, force| {
                for (g, f) in gradient[3 * node as usize..].iter_mut().zip(force.to_array()) {
                    *g -= f;
                }
            },
            // Symmetric: rows and columns are the same.
            |i, j, block| stiffness.add_block(&model.pattern, i, j, &block.to_cols_array()),
        )
    }

    /// Calls `push` with each force on a node, and `stiffen` with each block of ∂²energy/∂u² between two of a face's nodes (each
    /// pair once); returns the energy.
    pub fn assemble_into(
        &self,
        model: &Model,
        u: &[f64],
        tangent: Tangent,
        mut push: impl FnMut(u32, DVec3),
        mut stiffen: impl FnMut(u32, u32, &DMat3),
    ) -> f64 {
        let mut energy = 0.0;
        self.each_touch(model, u, |_, _, touch| {
            energy += touch.energy();
            let (force, tangent) = (touch.force(), touch.tangent(tangent));
            for (a, &i) in touch.face.nodes.iter().enumerate() {
                let n = touch.shape[a];
                push(i, force * n);
                for (b, &j) in touch.face.nodes[..=a].iter().enumerate() {
                    stiffen(i, j, &(tangent * (n * touch.shape[b])));
                }
            }
        });
        energy
    }

    /// Nodes (inner numbers, ascending) of faces that hold on to the tool or are nearer to it than `reach` of their own radii.
    pub fn nodes_within(&self, model: &Model, u: &[f64], reach: f64) -> Vec<u32> {
        let mut nodes = Vec::new();
        for (f, face) in self.faces.iter().enumerate() {
            let p = face.nodes.map(|node| model.place(node, u));
            let middle = (p[0] + p[1] + p[2]) / 3.0;
            let radius = p.iter().map(|p| p.distance(middle)).fold(face.radius, f64::max);
            let caught = self.anchors.get(f).is_some_and(|anchors| anchors.iter().any(Option::is_some));
            if caught || self.distance(middle) <= reach * radius {
                nodes.extend_from_slice(&face.nodes);
            }
        }
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Looks only at faces with a node that has an index, until it is told otherwise.
    pub fn watch(&mut self, index: Option<&[u32]>) {
        let known = |face: &Face, index: &[u32]| face.nodes.iter().any(|&n| index[n as usize] != u32::MAX);
        self.watched = index.map(|index| {
            (0..self.faces.len() as u32).filter(|&f| known(&self.faces[f as usize], index)).collect()
        });
    }

    /// Adds the change of ∂energy/∂u for a small move of the tool.
    pub fn pull(&self, model: &Model, u: &[f64], move_by: DVec3, forces: &mut [f64]) {
        self.each_touch(model, u, |_, _, touch| {
            let force = touch.tangent(Tangent::Full) * move_by;
            for (&i, n) in touch.face.nodes.iter().zip(touch.shape) {
                for (sum, f) in forces[3 * i as usize..].iter_mut().zip(force.to_array()) {
                    *sum -= n * f;
                }
            }
        });
    }

    pub fn resultant(&self, model: &Model, u: &[f64]) -> Resultant {
        let mut sum = Resultant::default();
        self.each_touch(model, u, |_, _, touch| {
            let force = touch.force();
            sum.force_n += force;
            sum.torque_n_m += (touch.at - self.placement.tip).cross(force);
            if touch.distance < 0.0 {
                let pressed = -touch.distance * touch.weight * touch.face.penalty;
                sum.patch_m2 += touch.weight;
                sum.pressed_n += pressed;
                sum.slipping_n += if touch.slips() { pressed } else { 0.0 };
            }
        });
        sum
    }

    /// What the energy of contact and body together says of a small motion q of the tool, translation and rotation about the
    /// tip: ∂²E/∂q², and for each component ∂²E/∂u∂q, which is added to `forces`.
    pub fn motion(&self, model: &Model, u: &[f64], forces: &mut [Vec<f64>; 6]) -> StuckTangent {
        let mut own = StuckTangent::default();
        self.each_touch(model, u, |_, _, touch| {
            let arm = touch.at - self.placement.tip;
            let (tangent, gradient) = (touch.tangent(Tangent::Full), -touch.force());
            let translations = DVec3::AXES.map(|axis| -(tangent * axis));
            let rotations = DVec3::AXES.map(|axis| axis.cross(gradient) - tangent * axis.cross(arm));
            for (forces, pull) in forces.iter_mut().zip(translations.iter().chain(&rotations)) {
                for (&i, n) in touch.face.nodes.iter().zip(touch.shape) {
                    for (sum, f) in forces[3 * i as usize..].iter_mut().zip(pull.to_array()) {
                        *sum += n * f;
                    }
                }
            }
            for (i, a) in DVec3::AXES.into_iter().enumerate() {
                for (j, b) in DVec3::AXES.into_iter().enumerate() {
                    own[i][j] += a.dot(tangent * b);
                    let mixed = -a.dot(rotations[j]);
                    own[i][3 + j] += mixed;
                    own[3 + j][i] += mixed;
                    let turned = a.cross(arm).dot(tangent * b.cross(arm));
                    let both = 0.5 * (gradient[i] * arm[j] + gradient[j] * arm[i]);
                    own[3 + i][3 + j] += turned + both - gradient.dot(arm) * a.dot(b);
                }
            }
        });
        own
    }

    /// The penetration of the deepest point of the surface, m.
    pub fn overlap(&self, model: &Model, u: &[f64]) -> f64 {
        let mut deepest = 0.0f64;
        self.each_touch(model, u, |_, _, touch| deepest = deepest.max(-touch.distance));
        deepest
    }

    /// What is caught, to go back to.
    pub fn anchors(&self) -> Anchors {
        Anchors(self.anchors.clone())
    }

    /// Goes back.
    pub fn restore(&mut self, anchors: &Anchors) {
        self.anchors.clone_from(&anchors.0);
    }

    /// Nothing is caught any more.
    pub fn unstick(&mut self) {
        self.anchors.clear();
    }

    /// Catches what touches and is free, on the tool where it touched first: on the way from `before`, a place of the tool
    /// and displacements, if it did not touch then. Returns the force along the tool that this brings, N.
    pub fn catch(
        &mut self,
        model: &Model,
        u: &[f64],
        before: Option<(&Placement, &[f64])>,
        friction: Friction,
    ) -> f64 {
        let mut caught = Vec::new();
        let back = self.placement.rotation.transpose();
        self.each_touch(model, u, |f, q, touch| {
            if touch.distance >= 0.0 || touch.grip.is_some() {
                return;
            }
            let now = back * (touch.at - self.placement.tip);
            let mut place = now;
            if let Some((placement, u)) = before {
                let at: DVec3 =
                    touch.shape.iter().zip(touch.face.nodes).map(|(n, i)| model.place(i, u) * *n).sum();
                let then = placement.rotation.transpose() * (at - placement.tip);
                let gap = self.tool.distance(then).value;
                if gap > 0.0 {
                    place = then.lerp(now, gap / (gap - touch.distance));
                }
            }
            let normal = self.tool.distance(place).gradient;
            let moved = now - place;
            let stretch = (moved - normal * moved.dot(normal)).length();
            let limit = friction.limit(-touch.distance);
            caught.push((
                f,
                q,
                Anchor { place, normal, limit: limit * self.penalty_scale },
                touch.weight * touch.face.penalty * stretch.min(limit),
            ));
        });
        if !caught.is_empty() {
            self.anchors.resize(self.faces.len(), [None; POINTS]);
        }
        let mut force = 0.0;
        for (f, q, anchor, brought) in caught {
            self.anchors[f][q] = Some(anchor);
            force += brought;
        }
        force
    }

    /// Lets go what has left the tool. Returns the force along the tool that was let go, N.
    pub fn release(&mut self, model: &Model, u: &[f64]) -> f64 {
        let (mut left, mut let_go) = (Vec::new(), 0.0);
        self.each_touch(model, u, |f, q, touch| {
            if touch.distance >= 0.0 {
                let_go += touch.force().length();
                left.push((f, q));
            }
        });
        for (f, q) in left {
            self.anchors[f][q] = None;
        }
        let_go
    }

    /// Takes the friction limits from the pressures at hand. Returns by how much forces along the tool change with that, N.
    pub fn limit(&mut self, model: &Model, u: &[f64], friction: Friction) -> f64 {
        let (mut limits, mut changed) = (Vec::new(), 0.0);
        self.each_touch(model, u, |f, q, touch| {
            let Some(grip) = touch.grip else { return };
            let (old, new) = (grip.anchor.limit, friction.limit(-touch.distance));
            let stretch = grip.stretch.length();
            changed += touch.weight * touch.face.penalty * (stretch.min(old) - stretch.min(new)).abs();
            limits.push((f, q, new * self.penalty_scale));
        });
        for (f, q, limit) in limits {
            if let Some(anchor) = &mut self.anchors[f][q] {
                anchor.limit = limit;
            }
        }
        changed
    }

    /// What has slipped holds on where it is now: as far behind as the limit lets it.
    pub fn slip(&mut self, model: &Model, u: &[f64]) {
        let mut slipped = Vec::new();
        let back = self.placement.rotation.transpose();
        self.each_touch(model, u, |f, q, touch| {
            let Some(grip) = touch.grip.filter(|_| touch.slips()) else { return };
            let normal = touch.normal;
            let along = grip.stretch - normal * grip.stretch.dot(normal);
            let behind = along.normalize_or_zero() * grip.anchor.limit;
            let place = back * (touch.at - self.placement.tip - behind);
            let limit = grip.anchor.limit * self.penalty_scale;
            slipped.push((f, q, Anchor { place, normal: back * normal, limit }));
        });
        for (f, q, anchor) in slipped {
            self.anchors[f][q] = Some(anchor);
        }
    }
}

/// What holds the surface to the tool while they touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Friction {
    /// Nothing.
    None,
    /// All that touches sticks.
    Sticking,
    /// Coulomb's, with this coefficient.
    Coulomb(f64),
}

impl Friction {
    /// How far a point with this penetration can be stretched along the tool, m: spring and penalty are equally stiff.
    fn limit(self, penetration: f64) -> f64 {
        match self {
            Friction::None => 0.0,
            Friction::Sticking => f64::INFINITY,
            Friction::Coulomb(coefficient) => coefficient * penetration.max(0.0),
        }
    }
}

impl Touch<'_> {
    fn slips(&self) -> bool {
        self.grip.is_none_or(|grip| grip.stretch.length_squared() > grip.anchor.limit * grip.anchor.limit)
    }

    /// ½ ε s², and straight on from the limit.
    fn energy(&self) -> f64 {
        let along = self.grip.map_or(0.0, |grip| {
            let (s, limit) = (grip.stretch.length(), grip.anchor.limit);
            if s <= limit { 0.5 * s * s } else { limit * (s - 0.5 * limit) }
        });
        self.weight * self.face.penalty * (0.5 * self.distance * self.distance + along)
    }

    /// On the body.
    fn force(&self) -> DVec3 {
        let along = self.grip.map_or(DVec3::ZERO, |grip| grip.stretch.clamp_length_max(grip.anchor.limit));
        (self.normal * -self.distance - along) * (self.weight * self.face.penalty)
    }

    fn tangent(&self, kind: Tangent) -> DMat3 {
        let mut tangent = DMat3::ZERO;
        if self.distance < 0.0 {
            tangent += outer(self.normal);
            if kind == Tangent::Full {
                tangent += self.curvature * self.distance;
            }
        }
        if let Some(grip) = self.grip {
            // Beyond the limit the energy goes on straight and has no stiffness along the slip: Newton's steps overshoot, and
            // points flip between stick and slip. The secant's stiffness never does, but converges slowly.
            let (s, limit) = (grip.stretch.length(), grip.anchor.limit);
            let plane = DMat3::IDENTITY - outer(grip.normal);
            tangent += if s > limit {
                (plane - outer(grip.stretch / s) * TOWARDS_NEWTON) * (limit / s)
            } else {
                plane
            };
        }
        tangent * (self.weight * self.face.penalty)
    }
}
