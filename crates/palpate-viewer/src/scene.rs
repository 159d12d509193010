//! What is drawn: the body's surface in a state, and what shows the contact.

use crate::camera::Camera;
use crate::colouring::Coloured;
use crate::deform::Deformed;
use crate::palette::{Colours, Theme};
use crate::place;
use crate::shown::Shown;
use crate::solid::{Solids, Vertex, bytes};
use crate::surface::DrawnSurface;
use crate::tool::DrawnTool;
use glam::{DVec3, Vec3};
use palpate::Body;
use palpate::build::spec::ToolShape;
use std::sync::Arc;

/// A plane that the body is cut by; what lies on the side of the normal is not drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// 0, 1 or 2: x, y or z.
    pub axis: usize,
    /// Where along the body, from 0 to 1.
    pub share: f64,
    /// Which side is left out: that of greater coordinates, or of smaller ones.
    pub keeps_lower: bool,
}

impl Default for Section {
    fn default() -> Self {
        Section { axis: 1, share: 0.5, keeps_lower: false }
    }
}

/// What is drawn besides body and tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Marks {
    /// The force on the tool.
    pub force: bool,
    /// Contact point, its triangle and its frame.
    pub contact: bool,
    /// Where the contact point has been.
    pub track: bool,
    /// Where the hand wants the tool to be, and the hand's spring between.
    pub target: bool,
    /// The elements' edges.
    pub edges: bool,
    /// The test points.
    pub test_points: bool,
}

impl Default for Marks {
    fn default() -> Self {
        Marks { force: true, contact: true, track: true, target: true, edges: false, test_points: false }
    }
}

/// The body's surface: changed as a whole, shared with who draws it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BodyMesh {
    /// In the order of the drawn surface's vertices.
    pub vertices: Vec<Vertex>,
}

/// Indices, which stay while the body does.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Indices {
    /// Three a triangle.
    pub triangles: Vec<u32>,
    /// Two an edge.
    pub edges: Vec<u32>,
}

/// One picture, ready for the renderer. Places are in m from the surface's origin.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Tells whether the body's buffers are those of the picture before: a number for the indices, and one for the vertices.
    pub generation: [u64; 2],
    /// The body.
    pub mesh: Arc<BodyMesh>,
    /// The body's.
    pub indices: Arc<Indices>,
    /// What hides and is hidden.
    pub solids: Vec<Vertex>,
    /// What shines through where something hides it.
    pub marks: Vec<Vertex>,
    /// Whether the elements' edges are drawn.
    pub has_edges: bool,
    /// A plane (n, d): what has n·p > d is not drawn; zero for none.
    pub section: [f32; 4],
    /// From where.
    pub camera: Camera,
    /// Origin of all places, m in the body's frame.
    pub origin: DVec3,
    /// Its colours.
    pub theme: Theme,
}

/// What a scene is made from besides the body.
#[derive(Debug, Clone, Copy)]
pub struct Sight<'a> {
    /// The state.
    pub state: Option<&'a Shown>,
    /// Contact points so far, the oldest first, m in the body's frame.
    pub track: &'a [DVec3],
    /// Where the hand wants the tool to be, m.
    pub target_m: Option<DVec3>,
    /// What is drawn besides.
    pub marks: Marks,
    /// Its colours.
    pub theme: Theme,
    /// m a newton.
    pub metres_per_newton: f64,
    /// The plane of a section, as in [`Scene::section`]: it cuts test points too.
    pub section: [f32; 4],
}

/// Indices of a surface.
pub fn indices(surface: &DrawnSurface) -> Indices {
    Indices {
        triangles: surface.triangles.iter().flatten().copied().collect(),
        edges: surface.edges.iter().flatten().copied().collect(),
    }
}

/// The body's vertices in a state.
pub fn mesh(deformed: &Deformed, coloured: &Coloured) -> BodyMesh {
    let vertices = deformed.positions.iter().zip(&deformed.normals).zip(&coloured.vertices);
    let vertex = |((p, n), colour): ((&Vec3, &Vec3), &_)| Vertex {
        position: p.to_array(),
        normal: n.to_array(),
        colour: bytes(*colour),
    };
    BodyMesh { vertices: vertices.map(vertex).collect() }
}

/// The plane of a section, in m from the surface's origin.
pub fn section_plane(surface: &DrawnSurface, section: Option<&Section>) -> [f32; 4] {
    let Some(section) = section else { return [0.0; 4] };
    let along = |p: &Vec3| p[section.axis.min(2)];
    let ends = surface.positions.iter().map(along);
    let [least, most] = ends.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
    let at = least + (most - least) * section.share.clamp(0.0, 1.0) as f32;
    let sign = if section.keeps_lower { 1.0 } else { -1.0 };
    let mut plane = [0.0; 4];
    plane[section.axis.min(2)] = sign;
    plane[3] = sign * at;
    plane
}

/// Solids and marks of a state: (what hides and is hidden, what shines through).
pub fn contact_marks(
    body: &Body,
    shape: &DrawnTool,
    surface: &DrawnSurface,
    coloured: &Coloured,
    sight: &Sight,
) -> (Solids, Solids) {
    let (mut solids, mut marks) = (Solids::default(), Solids::default());
    let colours = sight.theme.colours();
    let size = surface.radius.max(1e-6) as f32;
    let local = |p: DVec3| (p - surface.origin).as_vec3();
    let thin = 0.0045 * size;
    if sight.marks.test_points || !coloured.marks.is_empty() {
        let all = if coloured.marks.is_empty() {
            crate::colouring::test_points(body)
        } else {
            coloured.marks.clone()
        };
        // A body whose every node is a test point would be hidden by its marks.
        let radius = size * if all.len() > 300 { 0.006 } else { 0.016 };
        let [x, y, z, d] = sight.section;
        let plane = Vec3::new(x, y, z);
        let seen = all.into_iter().map(local).filter(|p| plane == Vec3::ZERO || plane.dot(*p) <= d);
        seen.for_each(|p| solids.dot(p, radius, colours.contact));
    }
    if sight.marks.track {
        let places: Vec<Vec3> = sight.track.iter().map(|p| local(*p)).collect();
        marks.line(&places, 0.8 * thin, colours.track);
    }
    let Some(state) = sight.state else { return (solids, marks) };
    tool(&mut solids, body, shape, state, &colours, &local, size);
    let tool_m = state.tool_m();
    if let Some(target) = sight.target_m.filter(|t| sight.marks.target && t.is_finite()) {
        let from = local(tool_m);
        let to = local(target.clamp(DVec3::splat(-1e3), DVec3::splat(1e3)));
        spring(&mut marks, from, to, thin, colours.target);
        marks.ball(to, 2.6 * thin, colours.target);
    }
    let Some(contact) = &state.contact else { return (solids, marks) };
    let (at_rest, inward) = (local(contact.position_m.into()), place::inward(body, contact).as_vec3());
    let tip = local(place::tip_m(body, contact, tool_m));
    if sight.marks.contact {
        let corners = body.corners(contact.element).map(local);
        let [a, b, c] = corners;
        marks.line(&[a, b, c, a], 0.7 * thin, colours.contact);
        marks.ball(at_rest, 2.2 * thin, colours.contact);
        let aside = (tip - at_rest) - inward * (tip - at_rest).dot(inward);
        let u = aside.try_normalize().unwrap_or_else(|| inward.any_orthonormal_vector());
        let long = 0.16 * size;
        for (axis, colour) in [u, inward.cross(u), -inward].into_iter().zip(colours.frame) {
            marks.arrow(at_rest, at_rest + axis * long, 0.8 * thin, colour);
        }
        // The deflection: from the contact point at rest to the tool's tip.
        marks.tube(at_rest, tip, 0.6 * thin, colours.contact);
    }
    if sight.marks.force {
        let force = (state.force_n * sight.metres_per_newton).as_vec3();
        if force.is_finite() && force.length() > 1e-4 * size {
            let force = force.clamp_length_max(3.0 * size);
            marks.arrow(tip, tip + force, 2.2 * thin, colours.force);
        }
        let torque = (state.torque_nm * sight.metres_per_newton / (0.02 + 0.2 * surface.radius)).as_vec3();
        if torque.is_finite() && torque.length() > 1e-4 * size {
            marks.arrow(tip, tip + torque.clamp_length_max(3.0 * size), 1.6 * thin, colours.torque);
        }
    }
    (solids, marks)
}

/// Where a handle leans to.
const SLANT: DVec3 = DVec3::new(0.55, 0.45, 0.7);

/// The tool in its true shape, with a shaft towards the hand.
fn tool(
    solids: &mut Solids,
    body: &Body,
    shape: &DrawnTool,
    state: &Shown,
    colours: &Colours,
    local: &impl Fn(DVec3) -> Vec3,
    size: f32,
) {
    let at = local(state.tool_m());
    // Away from the body where it is touched, or else where it is near; turned with the handle.
    let touched = state.contact.as_ref().map(|c| -place::inward(body, c));
    let nearest = || body.nearest(state.tool_m(), 4.0 * f64::from(size)).map(|n| -body.inward(n.at));
    let away = touched.or_else(nearest).unwrap_or(DVec3::Z);
    let away = away.normalize_or(DVec3::Z);
    // What is round is held at a slant, as a pen is: the force would be hidden in its handle.
    let slanted = match &shape.shape {
        ToolShape::Sphere { .. } | ToolShape::Point => away + 0.7 * (SLANT - away * SLANT.dot(away)),
        _ => away,
    };
    let shaft = (state.tool_rotation() * slanted.normalize_or(DVec3::Z)).as_vec3();
    let (long, colour) = (0.9 * size, colours.tool);
    // From a round end to a handle that one can hold.
    let handle = |solids: &mut Solids, from: Vec3, radius: f32| {
        let slim = radius.min(0.05 * size).max(0.012 * size);
        solids.tube(from, from + shaft * long, slim, colour);
    };
    match &shape.shape {
        ToolShape::Sphere { radius_m } => {
            let radius = *radius_m as f32;
            solids.ball(at, radius, colour);
            handle(solids, at + shaft * (0.9 * radius), 0.3 * radius);
        }
        ToolShape::FlatPunch { radius_m } => {
            let radius = *radius_m as f32;
            let neck = at + shaft * (2.0 * radius).max(0.1 * size);
            solids.tube(at, neck, radius, colour);
            handle(solids, neck, 0.5 * radius);
        }
        ToolShape::Capsule { radius_m, length_m } => {
            let (radius, length) = (*radius_m as f32, *length_m as f32);
            let [low, high] = [radius, radius + length].map(|way| at + shaft * way);
            solids.ball(low, radius, colour);
            solids.tube(low, high, radius, colour);
            solids.ball(high, radius, colour);
            handle(solids, high, 0.4 * radius);
        }
        ToolShape::Cone { half_angle_rad, tip_radius_m } => {
            let (sin, cos) = (*half_angle_rad as f32).sin_cos();
            let radius = *tip_radius_m as f32;
            // The flank touches the ball of the tip all around.
            let middle = at + shaft * radius;
            let (from, thick) = (middle - shaft * (radius * sin), radius * cos);
            let height = (0.12 * size * cos / sin.max(0.05)).min(0.6 * size);
            let neck = from + shaft * height;
            solids.ball(middle, radius, colour);
            solids.frustum(from, neck, [thick, thick + height * sin / cos.max(0.05)], colour);
            handle(solids, neck, 0.04 * size);
        }
        ToolShape::Mesh { .. } if !shape.triangles.is_empty() => {
            let turn = glam::Quat::from_rotation_arc(Vec3::Z, shaft);
            for corners in &shape.triangles {
                solids.flat(corners.map(|p| at + turn * p), colour);
            }
        }
        // A tip without extent: a slender cone, as of a pencil.
        ToolShape::Point | ToolShape::Mesh { .. } => {
            let neck = at + shaft * (0.32 * size);
            solids.frustum(at, neck, [0.0, 0.045 * size], colour);
            solids.tube(neck, neck + shaft * long, 0.045 * size, colour);
        }
    }
}

/// The hand's spring: a zigzag that gets longer with the force.
fn spring(marks: &mut Solids, from: Vec3, to: Vec3, thin: f32, colour: crate::palette::Rgb) {
    let Some(axis) = (to - from).try_normalize().filter(|_| from.distance(to) > 4.0 * thin) else { return };
    let aside = axis.any_orthonormal_vector() * 2.5 * thin;
    let turns = 10u32;
    let place = |k: u32| {
        let straight = from + (to - from) * (k as f32 / turns as f32);
        if k == 0 || k == turns {
            straight
        } else {
            straight + if k.is_multiple_of(2) { aside } else { -aside }
        }
    };
    let places: Vec<Vec3> = (0..=turns).map(place).collect();
    marks.line(&places, 0.5 * thin, colour);
}
