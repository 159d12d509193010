//! The solver of a run: finite elements.

use super::prepare::Physics;
use super::run::PointSolver;
use crate::paths_file::TestPoint;
use crate::spec::{self, Simulation, ToolShape};
use anyhow::{Result, anyhow};
use glam::DVec3;
use palpate_body::import::{self, LengthUnit};
use palpate_body::repair::{self, Options};
use palpate_simulate::mesh::distance::SignedDistance;
use palpate_simulate::tool::Shape;
use palpate_simulate::{Contact, Fixed, Model, PointPaths, RigidTool};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A body, what touches it, and how.
#[derive(Debug)]
pub struct Elements {
    model: Model,
    tool: RigidTool,
    contact: Contact,
}

impl Elements {
    /// Factors the body's stiffness at rest.
    ///
    /// # Errors
    /// Supports that don't hold the body, or a tool's mesh that can't be read; `path` is the spec's name.
    pub fn new(physics: Physics, simulation: &Simulation, path: &Path) -> Result<Self> {
        let Physics { mesh, materials, fixed } = physics;
        let fixed: Vec<Fixed> = fixed.into_iter().map(|(node, axes)| Fixed { node, axes }).collect();
        let model = Model::new(mesh, materials, &fixed).map_err(|e| anyhow!("{}: {e}", path.display()))?;
        Ok(Elements { model, tool: tool(simulation)?, contact: contact(simulation) })
    }

    /// The body.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// What touches it.
    pub fn tool(&self) -> &RigidTool {
        &self.tool
    }
}

impl PointSolver for Elements {
    fn simulate(&self, point: &TestPoint, cancelled: &AtomicBool) -> Option<PointPaths> {
        self.model.simulate(&self.tool, self.contact, &point.plan, cancelled)
    }
}

/// How the body holds to the tool.
pub fn contact(simulation: &Simulation) -> Contact {
    match simulation.contact {
        spec::Contact::Sticking => Contact::Sticking,
        spec::Contact::Frictionless => Contact::Frictionless,
        spec::Contact::Bonded { patch_radius_m } => Contact::Bonded { patch_radius_m },
    }
}

/// The solver's tool.
///
/// # Errors
/// Its mesh can't be read or repaired.
pub fn tool(simulation: &Simulation) -> Result<RigidTool> {
    Ok(match &simulation.tool {
        // Only bonded, where the patch moves whatever the tool is like.
        ToolShape::Point => RigidTool::Sphere { radius_m: simulation.deflection.normal_max_m },
        ToolShape::Sphere { radius_m } => RigidTool::Sphere { radius_m: *radius_m },
        ToolShape::FlatPunch { radius_m } => RigidTool::flat_punch(*radius_m),
        ToolShape::Cone { half_angle_rad, tip_radius_m } => {
            RigidTool::Cone { half_angle_rad: *half_angle_rad, tip_radius_m: *tip_radius_m }
        }
        ToolShape::Capsule { radius_m, length_m } => {
            RigidTool::Capsule { radius_m: *radius_m, length_m: *length_m }
        }
        ToolShape::Mesh { file, unit } => RigidTool::Other(Arc::new(MeshTool::read(file, *unit)?)),
    })
}

/// A closed mesh as a tool, which presses towards +z.
#[derive(Debug)]
struct MeshTool {
    distance: SignedDistance,
    /// The farthest it reaches towards +z, m: the tip is there, on the z axis.
    tip_z: f64,
}

impl MeshTool {
    fn read(file: &Path, unit: LengthUnit) -> Result<Self> {
        let mesh = import::read(file, Some(unit))?;
        let (mesh, _) = repair::repair(mesh, Options { allow_open: false }).map_err(|e| e.in_file(file))?;
        let tip_z = mesh.positions.iter().map(|p| p.z).fold(f64::NEG_INFINITY, f64::max);
        let distance = SignedDistance::new(&mesh).map_err(|e| e.in_file(file))?;
        Ok(MeshTool { distance, tip_z })
    }
}

impl Shape for MeshTool {
    fn distance(&self, point: DVec3) -> (f64, DVec3) {
        self.distance.distance(point + DVec3::new(0.0, 0.0, self.tip_z))
    }
}
