//! Examples that are made on the spot: what the window begins with where nothing is opened.

use glam::DVec3;
use palpate::body::shape::{Resolution, Shape};
use palpate::body::{BlendWeights, BodyParts, Provenance, Response, SlipRule, Surface, Tool};
use palpate::{Body, BodyError};
use std::f64::consts::TAU;

/// A body that needs no file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Example {
    /// The paper's cylinder of 528 triangles.
    Cylinder,
    /// A flat block with a stiff lump under its skin.
    Lump,
    /// A soft ellipsoid, touched by a ball.
    Pad,
    /// A ring of a firm and a soft half.
    Ring,
    /// A ball on a table, simulated by finite elements while one waits.
    Ball,
}

/// The spec of [`Example::Ball`].
pub const BALL_SPEC: &str = include_str!("../../../examples/ball.toml");

impl Example {
    /// In the order in which they are shown.
    pub const ALL: [Example; 5] =
        [Example::Cylinder, Example::Lump, Example::Pad, Example::Ring, Example::Ball];

    /// As a title.
    pub fn title(self) -> &'static str {
        match self {
            Example::Cylinder => "Cylinder",
            Example::Lump => "Lump under the skin",
            Example::Pad => "Soft pad",
            Example::Ring => "Ring",
            Example::Ball => "Simulated ball",
        }
    }

    /// As a command names it.
    pub fn name(self) -> &'static str {
        match self {
            Example::Cylinder => "cylinder",
            Example::Lump => "lump",
            Example::Pad => "pad",
            Example::Ring => "ring",
            Example::Ball => "ball",
        }
    }

    /// In a sentence.
    pub fn about(self) -> &'static str {
        match self {
            Example::Cylinder => {
                "The paper's body: 528 coarse triangles, stiffness that varies over the surface, a point as tool."
            }
            Example::Lump => "A block that is three times as stiff over a lump: find it by touch.",
            Example::Pad => "An ellipsoid touched by a ball of 12 mm across, with friction.",
            Example::Ring => "A torus, firm on one side and soft on the other.",
            Example::Ball => {
                "A neo-Hookean ball on a table, pressed by finite elements: about half a minute."
            }
        }
    }

    /// Makes it; of what is simulated nothing is made here.
    ///
    /// # Errors
    /// None that the numbers here allow; [`Example::Ball`] is made by `palpate::build` from [`BALL_SPEC`].
    pub fn make(self) -> Result<Body, BodyError> {
        match self {
            Example::Cylinder | Example::Ball => cylinder(),
            Example::Lump => {
                let shape = Shape::Block { size_mm: [70.0, 70.0, 30.0] };
                let lump = DVec3::new(12e-3, -8e-3, 15e-3);
                let firm =
                    move |p: DVec3| 1.0 + 2.0 * (-(p - lump).length_squared() / 11e-3f64.powi(2)).exp();
                made(self, shape, 4.0, Tool::Sphere { radius_m: 6e-3 }, 0.25, move |p| 180.0 * firm(p))
            }
            Example::Pad => {
                let shape = Shape::Ellipsoid { radii_mm: [45.0, 32.0, 20.0] };
                let firm = |p: DVec3| 1.0 + 0.35 * (p.x / 45e-3);
                made(self, shape, 4.0, Tool::Sphere { radius_m: 6e-3 }, 0.4, move |p| 220.0 * firm(p))
            }
            Example::Ring => {
                let shape = Shape::Torus { radii_mm: [32.0, 13.0] };
                let firm = |p: DVec3| 1.0 + 0.6 * (p.x / 45e-3);
                made(self, shape, 4.0, Tool::Sphere { radius_m: 4e-3 }, 0.3, move |p| 300.0 * firm(p))
            }
        }
    }
}

/// How far the examples' curves go, m.
const DEFLECTION_MAX: f64 = 8e-3;

/// A body whose every node is a test point of the stiffness of its place, N/m.
fn made(
    example: Example,
    shape: Shape,
    edge_mm: f64,
    tool: Tool,
    friction: f64,
    stiffness: impl Fn(DVec3) -> f64,
) -> Result<Body, BodyError> {
    let surface = shape.surface(Resolution { edge_length_mm: Some(edge_mm), ..Default::default() })?;
    let response = |p: DVec3| {
        let k = stiffness(p);
        Response::paper(k, 0.8 * k, friction, DEFLECTION_MAX, DEFLECTION_MAX)
    };
    body(example, surface, response, tool, SlipRule::Consistent, true)
}

fn body(
    example: Example,
    surface: Surface,
    response: impl Fn(DVec3) -> Result<Response, BodyError>,
    tool: Tool,
    slip: SlipRule,
    tank: bool,
) -> Result<Body, BodyError> {
    let nodes = 0..surface.positions().len() as u32;
    Body::new(BodyParts {
        blends: nodes.clone().map(BlendWeights::own).collect(),
        test_point_nodes: nodes.collect(),
        responses: surface.positions().iter().map(|p| response(*p)).collect::<Result<_, _>>()?,
        surface,
        coupled: None,
        lateral_tensors: None,
        tool,
        slip,
        tank,
        partial_slip: false,
        provenance: Provenance {
            command: format!("palpate view, example {}", example.name()),
            software: concat!("palpate ", env!("CARGO_PKG_VERSION")).into(),
            ..Provenance::default()
        },
    })
}

/// Section 5 of the paper: radius 30 mm, 100 mm long, 24 × 11 × 2 triangles, laws (6) and (7), no tank.
fn cylinder() -> Result<Body, BodyError> {
    let shape = Shape::Cylinder { radius_mm: 30.0, length_mm: 100.0, caps: false };
    let resolution = Resolution { around: Some(24), along: Some(11), ..Default::default() };
    let surface = shape.surface(resolution)?;
    let radial = surface.positions().iter().map(|p| -DVec3::new(p.x, p.y, 0.0).normalize()).collect();
    let surface = surface.with_inward_normals(radial)?;
    let response = |p: DVec3| {
        let around = (p.x * 3.1f64.cos() + p.y * 3.1f64.sin()) / 30e-3;
        let g = 1.0 + 0.5 * around + 0.15 * (TAU * p.z / 0.1).sin();
        Response::paper(600.0 * g, 500.0 * g, 0.3, DEFLECTION_MAX, DEFLECTION_MAX)
    };
    body(Example::Cylinder, surface, response, Tool::Point, SlipRule::Paper, false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate::{Contact, ToolState};

    #[test]
    fn every_example_can_be_touched() {
        for example in Example::ALL.into_iter().filter(|e| *e != Example::Ball) {
            let body = example.make().unwrap();
            let [top, into] =
                palpate::body::BodySource::nearest(&body, palpate::runtime::motion::top(&body).unwrap())
                    .unwrap();
            let mut contact = Contact::new(&body);
            let at = |depth: f64| ToolState::at((top + into * (depth - body.tool().radius_m())).to_array());
            contact.step(&body, &at(-2e-3), 1e-3);
            let force = DVec3::from_array(contact.step(&body, &at(4e-3), 1e-3).force_n);
            assert!(force.dot(-into) > 0.1 && force.length() < 3.0, "{example:?}: {force}");
        }
    }
}
