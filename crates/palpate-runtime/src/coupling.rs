//! Virtual coupling: a spring between the device and a virtual tool without mass, which is what touches the body.
//!
//! The device then feels no more than the spring's stiffness in series with the body's, K k_c/(K + k_c), however stiff
//! the body (Colgate, Stanley and Brown 1995). What it costs: the virtual tool stays behind the device by F/k_c, so that
//! the body feels as much softer.

use glam::DVec3;

/// The spring and the virtual tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// k_c, N/m.
    stiffness: f64,
    /// K̂, N/m.
    body_stiffness: f64,
    last: Option<Last>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Last {
    device: DVec3,
    tool: DVec3,
    /// On the virtual tool from the body, N.
    force: DVec3,
}

impl Coupling {
    /// A spring of this stiffness (N/m) to a body that is nowhere stiffer than `body_stiffness_max_n_per_m`. Where the
    /// body is softer than that, the virtual tool is damped by the difference times the loop's period.
    pub fn new(stiffness_n_per_m: f64, body_stiffness_max_n_per_m: f64) -> Self {
        Coupling { stiffness: stiffness_n_per_m, body_stiffness: body_stiffness_max_n_per_m, last: None }
    }

    /// Where the virtual tool is when the device is at `device`, m. One Newton step a period on the balance of spring
    /// and body, k_c (x_d − x) + f(x) = 0, with −K̂ for the body's slope while it is touched:
    ///
    /// ```text
    /// x' = x + (k_c (x_d − x) + f(x)) / (k_c + K̂)
    /// ```
    ///
    /// A step that took f(x) as it was, without K̂, would give out K T |v|² of energy.
    pub(crate) fn tool(&mut self, device: DVec3) -> DVec3 {
        let tool = self.last.map_or(device, |Last { tool, force, .. }| {
            let slope = if force == DVec3::ZERO { 0.0 } else { self.body_stiffness };
            tool + (self.stiffness * (device - tool) + force) / (self.stiffness + slope)
        });
        self.last = Some(Last { device, tool, force: DVec3::ZERO });
        tool
    }

    /// The spring's force on the device, N, where the body's on the virtual tool is `force`.
    pub(crate) fn force(&mut self, force: DVec3) -> DVec3 {
        let Some(last) = &mut self.last else { return DVec3::ZERO };
        last.force = force;
        self.stiffness * (last.tool - last.device)
    }
}
