//! What is asked of a simulation at one point of the surface, and what comes of it.

use glam::{DQuat, DVec3};

/// How the tool holds the body while it presses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Contact {
    /// What comes into contact is caught on the tool where it touches, from first touch on: friction without limit. The
    /// forces of such a history have a potential.
    Sticking,
    /// Pressing, the surface slides freely along the tool and may leave it. Dragging, what is pressed to the tool
    /// sticks.
    Frictionless,
    /// The surface within a geodesic radius of the point moves with the tool, whatever its shape.
    Bonded {
        /// m.
        patch_radius_m: f64,
    },
}

/// The load paths at one point: pressed in along `inward` to each depth in turn; from some of them, dragged.
#[derive(Debug, Clone, PartialEq)]
pub struct PointPlan {
    /// On the surface at rest, m. The tip starts where the tool touches the mesh on the line through it.
    pub point: DVec3,
    /// Unit vector u^z into the body.
    pub inward: DVec3,
    /// Ascending, positive, m. Each is a state of the result.
    pub depths: Vec<f64>,
    /// Each starts anew from the pressed state.
    pub drags: Vec<Drag>,
}

/// A drag at constant depth, sticking.
#[derive(Debug, Clone, PartialEq)]
pub struct Drag {
    /// From this one of the depths.
    pub from: usize,
    /// Unit vector, perpendicular to `inward`.
    pub direction: DVec3,
    /// Ascending, positive, m. Each is a state of the result.
    pub distances: Vec<f64>,
}

/// What came of a point's load paths.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointPaths {
    /// Pressing: a state for each depth that was reached.
    pub press: Path,
    /// One for each drag of the plan; empty where the press did not reach its depth.
    pub drags: Vec<Path>,
}

/// One load path.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Path {
    /// As far as it went.
    pub states: Vec<State>,
    /// Why it ended early.
    pub stopped: Option<Stop>,
    /// By how much a force differs from that of twice as many load steps on the way from the state before, in parts of it: the most
    /// of the states that were checked. None where none was.
    pub halved: Option<f64>,
}

/// An equilibrium.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct State {
    /// How far the tool is pressed in, m.
    pub depth_m: f64,
    /// How far it is dragged, m.
    pub distance_m: f64,
    /// On the body, N.
    pub force_n: DVec3,
    /// Of that force about the tool's tip, N m.
    pub torque_n_m: DVec3,
    /// Of the surface at rest that touches, m².
    pub patch_m2: f64,
    /// Pressures over the patch, whatever their directions, N: times μ what friction can hold.
    pub pressed_n: f64,
    /// The share of that whose points slip, 0 to 1.
    pub slipping: f64,
    /// Of pressed states: what the wrench gains when the tool moves a little with the contact frozen.
    pub tangent: Option<Box<StuckTangent>>,
    /// Whether the energy curves downwards somewhere: an equilibrium, but no minimum. Where a stuck tangent was asked for the stiffness
    /// was factored to know; elsewhere `false` says only that no solve met such a direction.
    pub indefinite: bool,
    /// Displacement of each node of the mesh's boundary, in the order of [`crate::mesh::Boundary::nodes`], m.
    pub displacement_m: Vec<[f32; 3]>,
    /// Newton steps spent on it.
    pub iterations: u32,
}

/// Rows: force (x, y, z) and torque about the tip, on the body. Columns: translation, and rotation about the tip (its
/// vector in radians). In the body's axes; N/m, N, N m. Symmetric, as the Hessian of an energy is: what the torque τ about fixed axes
/// gains for a turn about the axis e has ½ e × τ besides, as a rotation vector's axes turn along by half.
pub type StuckTangent = [[f64; 6]; 6];

/// Any path of the tool, touching or not, with Coulomb friction.
#[derive(Debug, Clone, PartialEq)]
pub struct FreePlan {
    /// On the surface at rest, m.
    pub point: DVec3,
    /// Unit vector u^z into the body, along which the tool points at first.
    pub inward: DVec3,
    /// Each is a state of the result.
    pub poses: Vec<FreePose>,
    /// Coefficient over depth (m), linear between the rows and constant beyond them; none is no friction. Depth is that of
    /// the pose, along `inward` from first touch, not the body's local one; its coefficient holds on all of the way to it from the
    /// pose before.
    pub friction: Vec<(f64, f64)>,
}

/// Where the tool goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreePose {
    /// Of the tip, from where the tool first touches when it comes along `inward` through the point in the first pose's orientation, m.
    pub offset: DVec3,
    /// From the orientation in which it points along `inward`.
    pub rotation: DQuat,
}

/// Why a path ended before its last state.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// The depth or distance that could not be reached, m.
    pub at_m: f64,
    /// In words.
    pub why: String,
}

/// Two unit vectors across `inward`, and with it a right-handed frame: first the one of the body's axes that lies
/// flattest on the surface, so that neighbouring points turn alike. The tool's x and y point along them.
pub fn tangents(inward: DVec3) -> (DVec3, DVec3) {
    let steepness = |axis: &DVec3| axis.dot(inward).abs();
    let flattest = DVec3::AXES.into_iter().rev().min_by(|a, b| steepness(a).total_cmp(&steepness(b)));
    let first = flattest.unwrap_or(DVec3::X).reject_from_normalized(inward).normalize();
    (first, inward.cross(first))
}
