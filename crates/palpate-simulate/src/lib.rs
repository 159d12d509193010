//! What force a soft body answers a tool with: large deformations of hyperelastic bodies by finite elements.
//!
//! A [`TetMesh`] and a [`Material`] for each of its regions make a [`Model`]; [`Model::simulate`] presses a [`RigidTool`]
//! in at one point of the surface, drags it, and gives the forces as [`PointPaths`]. Nothing here knows how curves
//! are made from them, nor of the engine that plays them back.
//!
//! All is in m, N, Pa, J, rad. Results are the same bits for the same input on one machine, whatever runs beside.

#![warn(missing_docs)]

mod compliance_at;
mod contact;
mod displace;
mod element;
mod equilibrium;
mod error;
mod factor;
mod instruction_set;
mod load;
pub mod material;
pub mod mesh;
mod model;
mod near_field;
pub mod path;
mod simulate;
mod stiffness;
pub mod tool;

pub use displace::Deformed;
pub use equilibrium::{Counts, RESIDUAL_TOLERANCE};
pub use error::{Result, SimulateError};
pub use instruction_set::instruction_set;
pub use material::Material;
pub use mesh::TetMesh;
pub use model::{Fixed, Model};
pub use path::{Contact, Drag, FreePlan, FreePose, Path, PointPaths, PointPlan, State, Stop, StuckTangent};
pub use tool::RigidTool;
