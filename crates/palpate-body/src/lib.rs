//! The deformable body: surface, nodal frames, force-deflection responses, and their file.
//!
//! A [`Surface`] (nodes with inward normals, elements with neighbours) and the [`Response`]s of its test points
//! (normal and lateral force and friction against deflection, each a [`Curve`]) make a [`Body`]: immutable, checked
//! once, shared by every contact. The engine reads its [`ContactModel`]: element nodes, neighbours, the first touch, the
//! nearest point and the blended [`Responses`]; none of these questions allocates, locks or panics.
//!
//! Meshes come from files ([`import`]) or from [`shape`]s, in metres from here on. Bodies are kept in safetensors
//! files ([`Body::save`], [`Body::open`]).
//!
//! ```
//! use palpate_body::{Body, BodyParts, Curve, Extension, Interpolation, BlendWeights, Provenance, Response, SlipRule, Tool};
//! use palpate_body::shape::Shape;
//!
//! let surface = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default())?;
//! let knots = [0.0, 4e-3, 8e-3]; // m
//! let normal = Curve::through(&knots, &[0.0, 0.5, 2.0], Interpolation::Pchip, Extension::Linear)?; // N
//! let lateral = Curve::through(&knots, &[0.0, 2.0, 4.0], Interpolation::Linear, Extension::Linear)?; // N
//! let friction = Curve::through(&knots, &[0.3; 3], Interpolation::Linear, Extension::Constant)?;
//! let body = Body::new(BodyParts {
//!     blends: vec![BlendWeights::own(0); surface.positions().len()],
//!     surface,
//!     responses: vec![Response { normal, lateral, friction }],
//!     test_point_nodes: vec![0],
//!     coupled: None,
//!     lateral_tensors: None, // alike in all directions
//!     tool: Tool::Point,
//!     slip: SlipRule::Paper,
//!     tank: true,
//!     partial_slip: false,
//!     provenance: Provenance::default(),
//! })?;
//! assert_eq!(body.curves().len(), 1);
//! # Ok::<(), palpate_body::BodyError>(())
//! ```

pub mod body;
pub mod curve;
pub mod displacement;
pub mod error;
pub mod file;
pub mod gradient;
mod growth;
pub mod import;
mod index_map;
pub mod law;
pub mod model;
pub mod number;
mod parallel;
pub mod patch;
pub mod potential;
pub mod refine;
pub mod repair;
pub mod response;
pub mod search;
pub mod shape;
pub mod source;
pub mod stiffness;
pub mod stored;
pub mod surface;
pub mod tensor;

pub use body::{
    BlendWeights, Body, BodyParts, CountErrors, InterpolationErrors, LeftOut, Node, PointErrors,
    PotentialErrors, Provenance, SlipRule, StateErrors, Tool,
};
pub use curve::{Curve, Extension, Interpolation};
pub use displacement::{
    ContactState, Deformer, Dimple, DisplacementFields, FieldSet, FieldSurface, PlaceField,
};
pub use error::{BodyError, Result};
pub use gradient::{
    Coefficients, CoupledEnergies, DecoupledEnergies, EnergyCache, GradientBound, Gradients, PointEnergies,
};
pub use model::ContactModel;
pub use number::{Dual, Number};
pub use patch::Patch;
pub use potential::{CoupledLaw, Potential, PotentialAt, Potentials};
pub use refine::{Fineness, Refined};
pub use response::{BasisValues, Interval, Knots, Response, Responses, Rows, Sample};
pub use search::{MeshSearch, Nearest, SurfacePoint, Touch};
pub use source::{BodySource, Extent};
pub use stored::StoredBody;
pub use surface::{Element, NO_TWIN, Surface, TriangleMesh};
pub use tensor::Tensor;
