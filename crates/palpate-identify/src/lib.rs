//! Samples of force against deflection become a body's responses.
//!
//! [`read_samples`] reads measured rows (CSV), [`fit`] makes one curve of each kind for every point and places the
//! points on a surface, and [`spread`] gives every other node a blend of the test points around it. Together with the
//! surface they are what [`palpate_body::Body::new`] asks for.
//!
//! Curves pass through every sample: what is noisy must be smoothed first.
//!
//! Where samples come from a simulation, [`test_points()`] chooses where to simulate; [`fit_coupled`] makes potentials of
//! sticking load paths, and [`fit_paths`] curves and lateral tensors, with their errors.
//!
//! ```no_run
//! use palpate_body::{Body, BodyParts, Provenance, SlipRule, Tool, shape::Shape};
//! use palpate_identify::{Fit, FitOptions, fit, read_samples};
//!
//! let surface = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default())?;
//! let samples = read_samples("ball.csv".as_ref())?;
//! let Fit { blends, responses, test_point_nodes, report } = fit(&surface, &samples, &FitOptions::default())?;
//! println!("the points lie within {} m of their nodes", report.largest_distance_m);
//! let (tool, slip, provenance) = (Tool::Point, SlipRule::Paper, Provenance::default());
//! let lateral_tensors = None; // alike in all directions
//! let body = Body::new(BodyParts {
//!     surface, blends, responses, test_point_nodes, coupled: None, lateral_tensors, tool, slip, tank: true, partial_slip: false, provenance,
//! })?;
//! body.save("ball.body".as_ref())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod between;
mod coupled;
mod curvature;
mod error;
mod fit;
mod geodesic;
mod paths;
mod potential;
mod samples;
mod spread;
mod test_points;

pub use coupled::{CoupledFit, CoupledOptions, fit_coupled, further_points};
pub use error::FitError;
pub use fit::{BodyOptions, Fit, FitOptions, FitReport, PointReport, fit};
pub use paths::{DragRecord, PathFit, PathOptions, PointFit, PointRecord, fit_paths, fit_point};
pub use potential::{ContactSample, ContactStiffness, PotentialFit, PotentialOptions, fit_potential};
pub use samples::{Component, Sample, read_samples};
pub use spread::{spread, spread_everywhere};
pub use test_points::{Amount, spread_among, test_points, touchable};
