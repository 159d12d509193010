//! The deformed surface.
//!
//! A body that was simulated moves as its displacement fields say ([`Deformer`]). What others do around a tool is drawn as an elastic
//! half-space does it under a ball ([`Dimple`](palpate::body::Dimple)), with the depth and the lateral deflection of the contact. Both are pictures: no
//! force depends on them. No vertex stays inside the tool.

use crate::shown::Shown;
use crate::surface::DrawnSurface;
use glam::{DVec3, Vec3};
use palpate::Body;
use palpate::body::{ContactState, Deformer, SurfacePoint, Tool};

/// Displacements that can't be seen, m.
const SEEN: f32 = 1e-7;

/// The surface in a state, ready to be drawn. The same buffers serve from state to state.
#[derive(Debug, Clone, Default)]
pub struct Deformed {
    /// m from the surface's origin.
    pub positions: Vec<Vec3>,
    /// Unit vectors.
    pub normals: Vec<Vec3>,
    /// Whether anything differs from rest.
    pub is_deformed: bool,
    /// Vertices that are displaced,
    moved: Vec<bool>,
    /// and those whose normals turn.
    turns: Vec<bool>,
    /// Sums of changes and of areas, by [`DrawnSurface::shared`].
    turned: Vec<(Vec3, f32)>,
}

/// What a simulated body deforms by.
#[derive(Debug)]
pub struct Fields {
    deformer: Deformer,
    /// Of the body's nodes, m.
    positions: Vec<DVec3>,
}

impl Fields {
    /// A body's; none where it has none, or they can't be read.
    pub fn of(body: &Body) -> Option<Self> {
        let deformer = Deformer::new(body).ok().filter(Deformer::has_fields)?;
        Some(Fields { deformer, positions: Vec::new() })
    }

    fn displace(&mut self, body: &Body, state: &Shown) -> bool {
        let Some(contact) = contact_state(state) else { return false };
        self.deformer.displace(body, &contact, &mut self.positions);
        true
    }

    /// What a vertex of the drawn surface is displaced by, m.
    fn at(&self, body: &Body, surface: &DrawnSurface, vertex: usize) -> Vec3 {
        let numbers = body.element_node_numbers(surface.elements[vertex]);
        let moved = |n: u32| (self.positions[n as usize] - body.nodes()[n as usize].position).as_vec3();
        numbers.into_iter().zip(surface.area_coordinates[vertex]).map(|(n, share)| moved(n) * share).sum()
    }
}

fn contact_state(state: &Shown) -> Option<ContactState> {
    let contact = state.contact.as_ref()?;
    let at = SurfacePoint { element: contact.element, n: contact.n };
    Some(ContactState { at, tool_m: state.tool_m() })
}

/// Puts the vertices where they are in a state; at rest where nothing is touched. Positions and normals have the order of
/// [`DrawnSurface::positions`].
pub fn deform(
    body: &Body,
    surface: &DrawnSurface,
    state: Option<&Shown>,
    fields: Option<&mut Fields>,
    into: &mut Deformed,
) {
    let was_deformed = into.is_deformed || into.positions.len() != surface.positions.len();
    if was_deformed {
        into.positions.clone_from(&surface.positions);
        into.normals.clone_from(&surface.normals);
    }
    into.is_deformed = false;
    let contact = state.and_then(contact_state);
    let Some((contact, dimple)) = contact.and_then(|c| Some((c, c.dimple(body)?))) else { return };
    let ball = Ball::of(body, surface, &contact);
    into.is_deformed = true;
    into.moved.clear();
    into.moved.resize(surface.positions.len(), false);
    let fields =
        fields.zip(state).and_then(|(fields, state)| fields.displace(body, state).then_some(&*fields));
    for (v, (p, n)) in surface.positions.iter().zip(&surface.normals).enumerate() {
        let by = match &fields {
            Some(fields) => fields.at(body, surface, v),
            None => dimple.displacement(surface.origin + p.as_dvec3(), -n.as_dvec3()).as_vec3(),
        };
        let moved = ball.as_ref().map_or(*p + by, |ball| ball.out_of(*p + by));
        if moved.distance(*p) > SEEN {
            into.positions[v] = moved;
            into.moved[v] = true;
        }
    }
    turn_normals(surface, into);
}

/// Smooth normals turn as the triangles around them do: by the change of their triangles' normals.
fn turn_normals(surface: &DrawnSurface, into: &mut Deformed) {
    let Deformed { positions, normals, moved, turns, turned, .. } = into;
    let normal = |p: &[Vec3], [a, b, c]: [usize; 3]| (p[b] - p[a]).cross(p[c] - p[a]);
    let triangles = || surface.triangles.iter().map(|t| t.map(|v| v as usize));
    turned.clear();
    turned.resize(surface.shared_count, (Vec3::ZERO, 0.0));
    turns.clone_from(moved);
    for corners in triangles().filter(|corners| corners.iter().any(|&v| moved[v])) {
        let rest = normal(&surface.positions, corners);
        // Weighted by the area at rest.
        let change = normal(positions, corners).normalize_or_zero() * rest.length() - rest;
        for v in corners {
            turned[surface.shared[v] as usize].0 += change;
            turns[v] = true;
        }
    }
    // And divided by the area of all triangles around.
    for corners in triangles().filter(|corners| corners.iter().any(|&v| turns[v])) {
        let area = normal(&surface.positions, corners).length();
        corners.iter().for_each(|&v| turned[surface.shared[v] as usize].1 += area);
    }
    for (v, n) in normals.iter_mut().enumerate().filter(|(v, _)| turns[*v]) {
        let (change, area) = turned[surface.shared[v] as usize];
        let now = surface.normals[v] + change / area.max(f32::MIN_POSITIVE);
        *n = now.try_normalize().unwrap_or(surface.normals[v]);
    }
}

/// A tool that is a ball, m from the surface's origin.
struct Ball {
    centre: Vec3,
    radius: f32,
    /// Unit vector into the body at the contact point.
    inward: Vec3,
}

impl Ball {
    fn of(body: &Body, surface: &DrawnSurface, contact: &ContactState) -> Option<Self> {
        let Tool::Sphere { radius_m } = body.tool() else { return None };
        Some(Ball {
            centre: (contact.tool_m - surface.origin).as_vec3(),
            radius: *radius_m as f32,
            inward: body.inward(contact.at).as_vec3(),
        })
    }

    /// A vertex inside of the tool comes out of it on the side that the tool is pressed towards.
    fn out_of(&self, p: Vec3) -> Vec3 {
        let from = p - self.centre;
        if from.length_squared() >= self.radius * self.radius {
            return p;
        }
        let aside = from - self.inward * from.dot(self.inward);
        let out = (self.radius * self.radius - aside.length_squared()).max(0.0).sqrt();
        self.centre + aside + self.inward * out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::place;
    use glam::DVec3;
    use palpate::body::shape::{Resolution, Shape};
    use palpate::body::{
        BlendWeights, BodyParts, DisplacementFields, FieldSet, FieldSurface, PlaceField, Response,
    };
    use palpate::{Contact, ToolState};

    fn ball(tool: Tool) -> Body {
        let shape = Shape::Sphere { radius_mm: 30.0 };
        let surface = shape.surface(Resolution { edge_length_mm: Some(6.0), ..Default::default() }).unwrap();
        let body = Body::uniform(surface, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()).unwrap();
        Body::new(BodyParts { tool, ..body.parts() }).unwrap()
    }

    fn pressed(body: &Body, depth: f64, along: f64) -> Shown {
        let mut contact = Contact::new(body);
        let radius = body.tool().radius_m();
        let mut shown = None;
        for k in 0..=100 {
            let s = f64::from(k) / 100.0;
            let tool = ToolState::at([along * s, 0.0, 0.032 + radius - (0.002 + depth) * s]);
            let output = contact.step(body, &tool, 1e-3);
            shown = Some(Shown::of_step(s, tool, &output, &contact));
        }
        shown.unwrap()
    }

    /// The tool's tip lies on the surface, no vertex inside of the tool by 2 % of the depth, and no triangle is turned over.
    #[test]
    fn the_surface_meets_the_tool_and_does_not_tear() {
        for tool in [Tool::Sphere { radius_m: 5e-3 }, Tool::Point] {
            let body = ball(tool);
            let surface = DrawnSurface::new(&body, false);
            for (depth, along) in [(1e-3, 0.0), (6e-3, 0.0), (6e-3, 3e-3)] {
                let shown = pressed(&body, depth, along);
                let contact = shown.contact.unwrap();
                let mut deformed = Deformed::default();
                deform(&body, &surface, Some(&shown), None, &mut deformed);
                assert!(deformed.is_deformed);
                let tip = (place::tip_m(&body, &contact, shown.tool_m()) - surface.origin).as_vec3();
                let nearest =
                    deformed.positions.iter().map(|p| p.distance(tip)).fold(f32::INFINITY, f32::min);
                assert!(nearest < 1.2e-3, "{tool:?} {depth}: {nearest}");
                if let Tool::Sphere { radius_m } = tool {
                    let centre = (shown.tool_m() - surface.origin).as_vec3();
                    let least =
                        deformed.positions.iter().map(|p| p.distance(centre)).fold(f32::INFINITY, f32::min);
                    let inside = radius_m as f32 - least;
                    assert!(inside <= 0.02 * contact.delta_z_m as f32, "{depth}: {inside}");
                }
                assert!(deformed.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
                let far = surface.positions.iter().zip(&deformed.positions).filter(|(p, _)| p.z < -0.02);
                assert!(far.clone().count() > 100 && far.into_iter().all(|(p, q)| p == q));
            }
        }
    }

    #[test]
    fn without_a_contact_it_is_at_rest_again() {
        let body = ball(Tool::Sphere { radius_m: 5e-3 });
        let surface = DrawnSurface::new(&body, false);
        let mut deformed = Deformed::default();
        deform(&body, &surface, Some(&pressed(&body, 4e-3, 0.0)), None, &mut deformed);
        assert_ne!(deformed.positions, surface.positions);
        deform(&body, &surface, None, None, &mut deformed);
        assert!(!deformed.is_deformed);
        assert_eq!(deformed.positions, surface.positions);
        assert_eq!(deformed.normals, surface.normals);
        let nan = ToolState::at([f64::NAN; 3]);
        let shown = Shown { tool: nan, ..pressed(&body, 4e-3, 0.0) };
        deform(&body, &surface, Some(&shown), None, &mut deformed);
        assert!(deformed.positions.iter().all(|p| p.is_finite()));
        assert_eq!(shown.tool_m(), DVec3::ZERO);
    }

    /// A body with fields moves by them: between the nodes as its elements do, and otherwise than the dimple.
    #[test]
    fn a_simulated_body_moves_by_its_fields() {
        let body = ball(Tool::Sphere { radius_m: 5e-3 });
        let surface = &body.parts().surface;
        let (mut positions, mut faces) = (surface.positions().to_vec(), Vec::new());
        for element in surface.elements() {
            let [a, b, c] = element.nodes;
            let first = positions.len() as u32;
            for [p, q] in [[a, b], [b, c], [c, a]].map(|e| e.map(|n| positions[n as usize])) {
                positions.push((p + q) * 0.5);
            }
            faces.push([a, b, c, first, first + 1, first + 2]);
        }
        // All of the upper half goes along, as on a foot that gives way.
        let moved = |p: &DVec3| [0.0, 0.0, if p.z > 0.0 { -4e-3 } else { 0.0 }];
        let field: Vec<[f32; 3]> = positions.iter().map(|p| moved(p).map(|c| c as f32)).collect();
        let on = FieldSurface::new(positions, faces).unwrap();
        let place = PlaceField {
            point: DVec3::Z * 30e-3,
            inward: DVec3::NEG_Z,
            tangent: DVec3::X,
            states: vec![(4e-3, vec![&field[..]])],
        };
        let mut press = FieldSet::default();
        press.push(&on, &place, false).unwrap();
        let test_points = body.test_point_nodes().len();
        let blends = vec![BlendWeights::own(0); test_points];
        let fields =
            DisplacementFields::new(on, press.with_blends(blends), FieldSet::default(), test_points).unwrap();
        let body = body.with_displacement_fields(Some(fields)).unwrap();

        let drawn = DrawnSurface::new(&body, false);
        let (mut by_fields, mut dimple) = (Deformed::default(), Deformed::default());
        let shown = pressed(&body, 4e-3, 0.0);
        deform(&body, &drawn, Some(&shown), Fields::of(&body).as_mut(), &mut by_fields);
        deform(&body, &drawn, Some(&shown), None, &mut dimple);
        let down = |of: &Deformed, v: usize| drawn.positions[v].z - of.positions[v].z;
        let far = |v: &usize| drawn.positions[*v].z > 0.01 && drawn.positions[*v].z < 0.02;
        let seen: Vec<usize> = (0..drawn.positions.len()).filter(far).collect();
        assert!(seen.len() > 100);
        for v in seen {
            assert!((down(&by_fields, v) - 4e-3).abs() < 2e-4, "{}", down(&by_fields, v));
            assert!(down(&dimple, v) < 2e-3, "{}", down(&dimple, v));
        }
    }
}
