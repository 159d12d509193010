//! How the surface moves under the tool: displacement fields of a simulation, and the deformed surface they make.
//!
//! Forces need none of this: no step reads it, and [`Body::open`](crate::Body::open) leaves the fields in the file until
//! [`Body::displacement_fields`](crate::Body::displacement_fields) asks for them. A [`Deformer`] gives the displaced
//! positions of a body's nodes for a [`ContactState`]; where a body has no fields it makes a dimple that fits tool and depth.
//!
//! Fields are those of *places* that were pressed. Two [`FieldSet`]s hold them: pressed straight in, and per metre of lateral
//! motion. Between places they are blended with the weights of the forces, each field moved along with the contact point
//! (`docs/body-file.md`, the deformed surface).

mod clearance;
mod deform;
mod dimple;
mod fields;
mod geometry;
mod lazy;

pub use deform::{ContactState, Deformer};
pub use dimple::Dimple;
pub use fields::{DisplacementFields, FieldSet, PlaceField};
pub(crate) use fields::{FieldSizes, field_layout};
pub use geometry::FieldSurface;
pub(crate) use lazy::StoredFields;
