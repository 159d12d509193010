//! The paper's body: a cylinder of 528 triangles whose stiffness varies over the surface.

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{BlendWeights, Body, BodyParts, Provenance, Response, Result, SlipRule, Surface, Tool};
use std::f64::consts::TAU;

/// Radius, m.
pub const RADIUS: f64 = 30e-3;
/// Length along z, m.
pub const LENGTH: f64 = 100e-3;
/// Elements around.
pub const AROUND: u32 = 24;
/// Elements along.
pub const ALONG: u32 = 11;

/// Mean k^z of the paper's (6), N/m.
pub const NORMAL_STIFFNESS: f64 = 600.0;
/// Mean k^r of the paper's (7), N/m.
pub const LATERAL_STIFFNESS: f64 = 500.0;
/// Friction coefficient, the same everywhere.
pub const FRICTION: f64 = 0.3;
/// Up to this deflection the curves are exact, m; the path stays below.
pub const DEFLECTION_MAX: f64 = 8e-3;

/// The angle from the x axis at which the body is stiffest, rad.
const STIFFEST: f64 = 3.1;

/// The body: every node is a test point, with the laws (6) and (7) and radial frames.
///
/// # Errors
/// None that the constants above allow.
pub fn body() -> Result<Body> {
    let response = |p: DVec3| {
        let g = stiffness(p);
        let (normal, lateral) = (NORMAL_STIFFNESS * g, LATERAL_STIFFNESS * g);
        Response::paper(normal, lateral, FRICTION, DEFLECTION_MAX, DEFLECTION_MAX)
    };
    let provenance = Provenance {
        command: "palpate demo".into(),
        software: concat!("palpate ", env!("CARGO_PKG_VERSION")).into(),
        ..Provenance::default()
    };
    // The paper had no tank.
    Body::new(BodyParts { provenance, ..parts(surface()?, response, SlipRule::Paper)? })
}

/// A body on this surface whose every node is a test point with the response of its place, touched with a point.
///
/// # Errors
/// What `response` reports.
pub(super) fn parts(
    surface: Surface,
    response: impl Fn(DVec3) -> Result<Response>,
    slip: SlipRule,
) -> Result<BodyParts> {
    let nodes = 0..surface.positions().len() as u32;
    Ok(BodyParts {
        blends: nodes.clone().map(BlendWeights::own).collect(),
        test_point_nodes: nodes.collect(),
        responses: surface.positions().iter().map(|p| response(*p)).collect::<Result<_>>()?,
        surface,
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip,
        tank: false,
        partial_slip: false,
        provenance: Provenance::default(),
    })
}

/// How stiff the body is at a surface point, as a multiple of its mean: ±50 % around, ±15 % along.
pub fn stiffness(p: DVec3) -> f64 {
    let around = (p.x * libm::cos(STIFFEST) + p.y * libm::sin(STIFFEST)) / RADIUS;
    1.0 + 0.5 * around + 0.15 * libm::sin(TAU * p.z / LENGTH)
}

/// The tube, open at both ends.
pub(super) const SHAPE: Shape =
    Shape::Cylinder { radius_mm: RADIUS * 1e3, length_mm: LENGTH * 1e3, caps: false };

/// So many elements around and along.
pub(super) fn resolution(around: u32, along: u32) -> Resolution {
    Resolution { around: Some(around), along: Some(along), ..Default::default() }
}

/// The tube's mesh; the paper's frames are radial, at the open ends too.
fn surface() -> Result<Surface> {
    let surface = SHAPE.surface(resolution(AROUND, ALONG))?;
    let radial = surface.positions().iter().map(|p| -DVec3::new(p.x, p.y, 0.0).normalize()).collect();
    surface.with_inward_normals(radial)
}
