//! Rigid tools, by their signed distance.
//!
//! In the tool's own frame the tip is at the origin and +z points the way it presses, out of the tool, whose body lies
//! at z ≤ 0. A [`Placement`] puts it where the body is.

use crate::path::tangents;
use crate::{Result, SimulateError};
use glam::{DMat3, DQuat, DVec3};
use std::{fmt::Debug, sync::Arc};

/// A flat punch's edge is rounded by this part of its radius, if nothing else is asked for: little enough that the
/// flat end keeps 96 % of its area, and enough that an element of a twentieth of the radius meets a smooth surface.
pub const EDGE_PER_RADIUS: f64 = 0.02;

/// The shape of a rigid tool, whose lengths are all positive.
#[derive(Debug, Clone)]
pub enum RigidTool {
    /// A ball.
    Sphere {
        /// m.
        radius_m: f64,
    },
    /// The flat end of a cylinder without other end. Its edge is rounded, since a sharp one has no normal and the
    /// pressure under it no bound: what is simulated is a punch whose flat part is smaller by `edge_m`.
    FlatPunch {
        /// Of the cylinder, m.
        radius_m: f64,
        /// Of the edge's rounding, at most `radius_m`, m.
        edge_m: f64,
    },
    /// A cone without other end, whose tip is a ball's cap.
    Cone {
        /// Between axis and flank, less than π/2, rad.
        half_angle_rad: f64,
        /// Of the ball at the tip, m.
        tip_radius_m: f64,
    },
    /// A ball drawn out along the axis.
    Capsule {
        /// m.
        radius_m: f64,
        /// Between the middles of its two ends, m.
        length_m: f64,
    },
    /// Any other shape, such as a closed mesh in the tool's frame.
    Other(Arc<dyn Shape>),
}

/// A shape that knows its distance.
pub trait Shape: Debug + Send + Sync {
    /// Signed distance of `point` from the surface, negative inside, m; and its gradient, a unit vector that points
    /// out of the shape.
    fn distance(&self, point: DVec3) -> (f64, DVec3);
}

/// A signed distance and its derivatives by the point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    /// Negative inside the tool, m.
    pub value: f64,
    /// Unit vector, out of the tool.
    pub gradient: DVec3,
    /// 1/m; it has the curvatures of the offset surface through the point. Zero under [`RigidTool::Other`], whose surface is
    /// taken as locally flat.
    pub hessian: DMat3,
}

impl RigidTool {
    /// A flat punch with the usual rounding, [`EDGE_PER_RADIUS`].
    pub fn flat_punch(radius_m: f64) -> Self {
        RigidTool::FlatPunch { radius_m, edge_m: EDGE_PER_RADIUS * radius_m }
    }

    /// Exact distance of a point in the tool's frame, inside and outside.
    ///
    /// The Hessian jumps where flat meets round. The gradient jumps only at points with several nearest ones, all of
    /// them inside: a ball's middle, the axis, and under a punch's edge deeper than its rounding. There it is one of
    /// the possible ones.
    pub fn distance(&self, point: DVec3) -> Distance {
        match *self {
            RigidTool::Sphere { radius_m } => from_point(point - radius_m * DVec3::NEG_Z, radius_m),
            RigidTool::Capsule { radius_m, length_m } => {
                let along = (-point.z - radius_m).clamp(0.0, length_m);
                let core = (radius_m + along) * DVec3::NEG_Z;
                if along > 0.0 && along < length_m {
                    from_axis(point, radius_m)
                } else {
                    from_point(point - core, radius_m)
                }
            }
            RigidTool::Cone { half_angle_rad, tip_radius_m } => {
                // The ball rolls in a sharp cone whose apex is the ball's middle.
                let (sin, cos) = (libm::sin(half_angle_rad), libm::cos(half_angle_rad));
                let (radius, from_apex) = (radius(point), point - tip_radius_m * DVec3::NEG_Z);
                if radius * sin - from_apex.z * cos > 0.0 {
                    let value = radius * cos + from_apex.z * sin - tip_radius_m;
                    turned(point, value, [cos, sin], 0.0)
                } else {
                    from_point(from_apex, tip_radius_m)
                }
            }
            RigidTool::FlatPunch { radius_m, edge_m } => {
                // A sharp punch, smaller by the edge's radius, grown by it.
                let (outwards, upwards) = (radius(point) - (radius_m - edge_m), point.z + edge_m);
                if outwards > 0.0 && upwards > 0.0 {
                    let length = libm::hypot(outwards, upwards);
                    let normal = [outwards / length, upwards / length];
                    turned(point, length - edge_m, normal, 1.0 / length)
                } else if outwards > upwards {
                    from_axis(point, radius_m)
                } else {
                    Distance { value: point.z, gradient: DVec3::Z, hessian: DMat3::ZERO }
                }
            }
            RigidTool::Other(ref shape) => {
                let (value, gradient) = shape.distance(point);
                Distance { value, gradient, hessian: DMat3::ZERO }
            }
        }
    }

    /// How far, roughly, its surface bends within the contact when it is pressed so deep, m; without bound where the shape doesn't
    /// tell.
    pub(crate) fn size_m(&self, depth_m: f64) -> f64 {
        match *self {
            RigidTool::Sphere { radius_m } | RigidTool::Capsule { radius_m, .. } => radius_m,
            RigidTool::FlatPunch { radius_m, .. } => radius_m,
            RigidTool::Cone { half_angle_rad, tip_radius_m } => {
                tip_radius_m.max(depth_m * libm::tan(half_angle_rad).min(1.0))
            }
            RigidTool::Other(_) => f64::INFINITY,
        }
    }

    /// Checks the lengths and the angle.
    ///
    /// # Errors
    /// Names the parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<()> {
        let positive = |key: &str, value: f64| {
            if value.is_finite() && value > 0.0 {
                return Ok(());
            }
            let problem = format!("expected a positive length, found {value} m");
            Err(SimulateError::invalid(key, problem, "give a positive length"))
        };
        match *self {
            RigidTool::Sphere { radius_m } => positive("radius", radius_m),
            RigidTool::Capsule { radius_m, length_m } => {
                positive("radius", radius_m)?;
                positive("length", length_m)
            }
            RigidTool::Cone { half_angle_rad, tip_radius_m } => {
                if !(half_angle_rad > 0.0 && half_angle_rad < std::f64::consts::FRAC_PI_2) {
                    let problem = format!("expected 0 to 90°, found {}°", half_angle_rad.to_degrees());
                    return Err(SimulateError::invalid(
                        "half_angle",
                        problem,
                        "give the angle between axis and flank",
                    ));
                }
                positive("tip_radius", tip_radius_m)
            }
            RigidTool::FlatPunch { radius_m, edge_m } => {
                positive("radius", radius_m)?;
                positive("edge", edge_m)?;
                if edge_m > radius_m {
                    let problem =
                        format!("the edge's rounding, {edge_m} m, exceeds the radius, {radius_m} m");
                    return Err(SimulateError::invalid("edge", problem, "round the edge less"));
                }
                Ok(())
            }
            RigidTool::Other(_) => Ok(()),
        }
    }
}

/// From the axis.
fn radius(point: DVec3) -> f64 {
    libm::hypot(point.x, point.y)
}

/// n nᵀ
pub(crate) fn outer(n: DVec3) -> DMat3 {
    DMat3::from_cols(n.x * n, n.y * n, n.z * n)
}

/// Distance from a ball, of a point relative to its middle.
fn from_point(offset: DVec3, radius_m: f64) -> Distance {
    let length = offset.length();
    if length == 0.0 {
        return Distance { value: -radius_m, gradient: DVec3::Z, hessian: DMat3::ZERO };
    }
    let normal = offset / length;
    let hessian = (DMat3::IDENTITY - outer(normal)) * (1.0 / length);
    Distance { value: length - radius_m, gradient: normal, hessian }
}

/// Distance from a cylinder about the axis.
fn from_axis(point: DVec3, radius_m: f64) -> Distance {
    turned(point, radius(point) - radius_m, [1.0, 0.0], 0.0)
}

/// A distance whose gradient is `normal` outwards and along the axis, from a surface turned about the axis whose
/// outline's offset through the point has that `curvature`.
fn turned(point: DVec3, value: f64, [outwards, upwards]: [f64; 2], curvature: f64) -> Distance {
    let radius = radius(point);
    if radius == 0.0 {
        let gradient = DVec3::new(outwards, 0.0, upwards);
        return Distance { value, gradient, hessian: DMat3::ZERO };
    }
    let ray = DVec3::new(point.x / radius, point.y / radius, 0.0);
    let (around, along) = (DVec3::new(-ray.y, ray.x, 0.0), upwards * ray - outwards * DVec3::Z);
    Distance {
        value,
        gradient: outwards * ray + upwards * DVec3::Z,
        hessian: outer(along) * curvature + outer(around) * (outwards / radius),
    }
}

/// Where a tool is, in the frame of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// The tool's tip, m.
    pub tip: DVec3,
    /// Turns vectors of the tool's frame into the body's.
    pub rotation: DMat3,
}

impl Placement {
    /// With the tip there, pressing that way (unit vector). The tool's x and y point along [`tangents`].
    pub fn pressing(tip: DVec3, inward: DVec3) -> Self {
        let (x, y) = tangents(inward);
        Placement { tip, rotation: DMat3::from_cols(x, y, inward) }
    }

    /// Moved by `offset` (m) and turned about the tip.
    pub fn moved(&self, offset: DVec3, rotation: DQuat) -> Self {
        Placement { tip: self.tip + offset, rotation: DMat3::from_quat(rotation) * self.rotation }
    }

    /// Distance of a point of the body's frame from the tool, gradient and Hessian in that frame too.
    pub fn distance_at(&self, tool: &RigidTool, point: DVec3) -> Distance {
        let turn = self.rotation;
        let back = turn.transpose();
        let Distance { value, gradient, hessian } = tool.distance(back * (point - self.tip));
        Distance { value, gradient: turn * gradient, hessian: turn * hessian * back }
    }
}
