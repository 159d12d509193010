//! A rigid tool against the deformable surface.
//!
//! The surface is asked at six points of each face (Dunavant 1985, degree 4) how deep it lies in the tool, and pushed
//! out by a pressure in proportion: energy ½ε⟨−φ⟩² for each unit of surface at rest, φ the signed distance from the
//! tool. The penalty ε is 50 contact moduli over a face's size, so that the surface enters the tool by 2 % of what it
//! is indented locally over one face, and the energy stays smooth enough for Newton's method. Sticking adds a spring
//! of the same stiffness, along the tool's surface, between a point and the place on the tool where it was caught.

use crate::material::Moduli;
use crate::model::Model;
use crate::stiffness::Stiffness;
use crate::tool::{Placement, RigidTool, outer};
use glam::{DMat3, DVec3};

/// Penalty in contact moduli E/(1 − ν²) over the face's size.
const PENALTY: f64 = 50.0;

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

/// Where on the tool a point of the surface was caught.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    /// From the tip, body's axes, m.
    place: DVec3,
    /// The tool's outward normal there.
    normal: DVec3,
}

/// The points that stick, for each face.
pub(crate) struct Anchors(Vec<[Option<Anchor>; POINTS]>);

/// Force and more of a contact.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Resultant {
    pub force_n: DVec3,
    /// About the tip.
    pub torque_n_m: DVec3,
    /// Of the surface at rest.
    pub patch_m2: f64,
}

/// A placed tool against the whole surface of a model.
pub(crate) struct ToolContact<'t> {
    tool: &'t RigidTool,
    pub placement: Placement,
    faces: Vec<Face>,
    rule: [(f64, [f64; 6]); POINTS],
    /// For each face's point; empty while nothing sticks.
    anchors: Vec<[Option<Anchor>; POINTS]>,
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

/// A point of the surface that the tool pushes: its face, shape functions, share of area, and place.
struct Touch<'a> {
    face: &'a Face,
    shape: &'a [f64; 6],
    weight: f64,
    at: DVec3,
    /// Signed distance with gradient and Hessian, body's axes; a point outside counts as on the tool's surface.
    distance: f64,
    normal: DVec3,
    curvature: DMat3,
    anchor: Option<Anchor>,
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
        ToolContact { tool, placement, faces: faces.collect(), rule: rule(), anchors: Vec::new() }
    }

    fn distance(&self, at: DVec3) -> f64 {
        self.placement.distance_at(self.tool, at).value
    }

    /// Calls `visit` for every point of the surface that is in the tool, or sticks to it.
    fn each_touch(&self, model: &Model, u: &[f64], mut visit: impl FnMut(usize, usize, Touch)) {
        for (f, face) in self.faces.iter().enumerate() {
            let place = |node: u32| {
                let n = node as usize;
                model.rest[n] + DVec3::new(u[3 * n], u[3 * n + 1], u[3 * n + 2])
            };
            let p = face.nodes.map(place);
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
                let touch = Touch {
                    face,
                    shape,
                    weight: weight * face.area,
                    at,
                    distance: distance.value.min(0.0),
                    normal: distance.gradient,
                    curvature: distance.hessian,
                    anchor: anchors[q],
                };
                visit(f, q, touch);
            }
        }
    }

    pub fn energy(&self, model: &Model, u: &[f64]) -> f64 {
        let mut energy = 0.0;
        self.each_touch(model, u, |_, _, touch| energy += touch.energy(self.placement.tip));
        energy
    }

    pub fn assemble(&self, model: &Model, u: &[f64], gradient: &mut [f64], stiffness: &mut Stiffness) -> f64 {
        let mut energy = 0.0;
        self.each_touch(model, u, |_, _, touch| {
            energy += touch.energy(self.placement.tip);
            let force = touch.force(self.placement.tip);
            let tangent = touch.tangent();
            for (a, &i) in touch.face.nodes.iter().enumerate() {
                let n = touch.shape[a];
                for (g, f) in gradient[3 * i as usize..].iter_mut().zip(force.to_array()) {
                    *g -= n * f;
                }
                for (b, &j) in touch.face.nodes[..=a].iter().enumerate() {
                    let scaled = tangent * (n * touch.shape[b]);
                    // The tangent is symmetric: rows and columns are the same.
                    stiffness.add_block(&model.pattern, i, j, &scaled.to_cols_array());
                }
            }
        });
        energy
    }

    /// Adds the change of ∂energy/∂u for a small move of the tool.
    pub fn pull(&self, model: &Model, u: &[f64], move_by: DVec3, forces: &mut [f64]) {
        self.each_touch(model, u, |_, _, touch| {
            let force = touch.tangent() * move_by;
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
            let force = touch.force(self.placement.tip);
            sum.force_n += force;
            sum.torque_n_m += (touch.at - self.placement.tip).cross(force);
            sum.patch_m2 += if touch.distance < 0.0 { touch.weight } else { 0.0 };
        });
        sum
    }

    /// Which points stick, to go back to.
    pub fn anchors(&self) -> Anchors {
        Anchors(self.anchors.clone())
    }

    /// Goes back.
    pub fn restore(&mut self, anchors: Anchors) {
        self.anchors = anchors.0;
    }

    /// Nothing sticks any more.
    pub fn unstick(&mut self) {
        self.anchors.clear();
    }

    /// What touches now sticks where it touches; what sticks already stays; what has left is free again. Returns the
    /// force along the tool that was let go, N: if it is not small, the equilibrium is another.
    pub fn update_sticking(&mut self, model: &Model, u: &[f64]) -> f64 {
        let mut anchors = vec![[None; POINTS]; self.faces.len()];
        let mut let_go = 0.0;
        self.each_touch(model, u, |f, q, touch| {
            if touch.distance < 0.0 {
                let fresh = Anchor { place: touch.at - self.placement.tip, normal: touch.normal };
                anchors[f][q] = Some(touch.anchor.unwrap_or(fresh));
            } else {
                let_go += touch.force(self.placement.tip).length();
            }
        });
        self.anchors = anchors;
        let_go
    }
}

impl Touch<'_> {
    /// From the anchor, along the tool's surface, m.
    fn stretch(&self, tip: DVec3) -> DVec3 {
        self.anchor.map_or(DVec3::ZERO, |anchor| {
            let moved = self.at - tip - anchor.place;
            moved - anchor.normal * moved.dot(anchor.normal)
        })
    }

    fn energy(&self, tip: DVec3) -> f64 {
        let squares = self.distance * self.distance + self.stretch(tip).length_squared();
        0.5 * self.weight * self.face.penalty * squares
    }

    /// On the body.
    fn force(&self, tip: DVec3) -> DVec3 {
        (self.normal * -self.distance - self.stretch(tip)) * (self.weight * self.face.penalty)
    }

    fn tangent(&self) -> DMat3 {
        let mut tangent = DMat3::ZERO;
        if self.distance < 0.0 {
            tangent += outer(self.normal) + self.curvature * self.distance;
        }
        if let Some(anchor) = self.anchor {
            tangent += DMat3::IDENTITY - outer(anchor.normal);
        }
        tangent * (self.weight * self.face.penalty)
    }
}
