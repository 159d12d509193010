//! The tool's shape, as it is drawn.
//!
//! A body knows the kind of its tool, and a ball's radius. The rest stands in the spec that a simulated body keeps.

use glam::Vec3;
use palpate::Body;
use palpate::body::{Tool, import};
use palpate::build::spec::{Spec, ToolShape};
use std::path::Path;

/// A tool and, of one that is a mesh, its triangles, m from its tip.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnTool {
    /// Its shape.
    pub shape: ToolShape,
    /// Of a mesh, where its file is still there.
    pub triangles: Vec<[Vec3; 3]>,
}

impl DrawnTool {
    /// The tool that a body was made for.
    pub fn of(body: &Body) -> Self {
        let shape = match body.tool() {
            Tool::Sphere { radius_m } => ToolShape::Sphere { radius_m: *radius_m },
            Tool::Point => ToolShape::Point,
            _ => of_spec(body).unwrap_or(ToolShape::Point),
        };
        let triangles = match &shape {
            ToolShape::Mesh { file, unit } => import::read(file, Some(*unit)).map_or_else(
                |_| Vec::new(),
                |mesh| {
                    let corner = |v: u32| mesh.positions.get(v as usize).map_or(Vec3::ZERO, |p| p.as_vec3());
                    mesh.triangles.iter().map(|t| t.map(corner)).collect()
                },
            ),
            _ => Vec::new(),
        };
        DrawnTool { shape, triangles }
    }
}

/// From the spec in the body's provenance; `None` where there is none, or it is of another version.
fn of_spec(body: &Body) -> Option<ToolShape> {
    let text = body.provenance().spec.clone()?;
    let path = Path::new("spec.toml");
    let simulation = Spec::parse(path, text).ok()?.simulation(path).ok()?;
    Some(simulation.tool)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gallery::{BALL_SPEC, Example};
    use palpate::body::{BodyParts, Provenance};

    #[test]
    fn a_punch_s_radius_is_that_of_the_spec() {
        let body = Example::Pad.make().unwrap();
        assert_eq!(DrawnTool::of(&body).shape, ToolShape::Sphere { radius_m: 6e-3 });
        let text = BALL_SPEC
            .replace("shape = \"sphere\"\nradius_mm = 5\n", "shape = \"flat-punch\"\nradius_mm = 3\n");
        assert!(text.contains("flat-punch"));
        let provenance = Provenance { spec: Some(text), ..Provenance::default() };
        let parts = BodyParts { tool: Tool::FlatPunch, provenance, ..body.parts() };
        let punch = Body::new(parts).unwrap();
        assert_eq!(DrawnTool::of(&punch).shape, ToolShape::FlatPunch { radius_m: 3e-3 });
        let bare = Body::new(BodyParts { provenance: Provenance::default(), ..punch.parts() }).unwrap();
        assert_eq!(DrawnTool::of(&bare).shape, ToolShape::Point);
    }
}
