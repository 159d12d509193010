//! Virtual coupling: a spring between the device and a virtual tool without mass, which is what touches the body.
//!
//! The device then feels no more than the spring's stiffness in series with the body's, K k_c/(K + k_c),
//! however stiff the body (Colgate, Stanley and Brown 1995). What it costs: the virtual tool stays behind the
//! device by F/k_c, so that the body feels as much softer. Turning has a spring of its own, if it is asked
//! for: the torque k_c θ along the rotation vector θ from the tool to the device, the slope of ½ k_c |θ|².

use crate::wrench::{Placement, Wrench, rotation_between, turned};
use glam::DVec3;

/// The springs and the virtual tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    linear: Spring,
    /// `None`: the virtual tool is turned as the device is.
    angular: Option<Spring>,
    last: Option<Last>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Spring {
    /// k_c, N/m or N·m/rad.
    stiffness: f64,
    /// K̂, the same.
    body_stiffness: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Last {
    device: Placement,
    tool: Placement,
    /// On the virtual tool from the body.
    wrench: Wrench,
}

impl Spring {
    /// One Newton step on the balance of spring and body from a tool that is `behind` the device, where the
    /// body's answer is `answer`.
    fn step(&self, behind: DVec3, answer: DVec3) -> DVec3 {
        let slope = if answer == DVec3::ZERO { 0.0 } else { self.body_stiffness };
        (self.stiffness * behind + answer) / (self.stiffness + slope)
    }
}

impl Coupling {
    /// A spring of this stiffness (N/m) to a body that is nowhere stiffer than `body_stiffness_max_n_per_m`. Where the
    /// body is softer than that, the virtual tool is damped by the difference times the loop's period.
    pub fn new(stiffness_n_per_m: f64, body_stiffness_max_n_per_m: f64) -> Self {
        let linear = Spring { stiffness: stiffness_n_per_m, body_stiffness: body_stiffness_max_n_per_m };
        Coupling { linear, angular: None, last: None }
    }

    /// With a rotational spring (N·m/rad) besides, to a body that is nowhere stiffer against turning than
    /// `body_stiffness_max_nm_per_rad`.
    #[must_use]
    pub fn with_angular(self, stiffness_nm_per_rad: f64, body_stiffness_max_nm_per_rad: f64) -> Self {
        let spring =
            Spring { stiffness: stiffness_nm_per_rad, body_stiffness: body_stiffness_max_nm_per_rad };
        Coupling { angular: Some(spring), ..self }
    }

    /// Where the virtual tool is when the device is at `device`. One Newton step a period on the balance of
    /// spring and body, k_c (x_d − x) + f(x) = 0, with −K̂ for the body's slope while it is touched:
    ///
    /// ```text
    /// x' = x + (k_c (x_d − x) + f(x)) / (k_c + K̂)
    /// ```
    ///
    /// A step that took f(x) as it was, without K̂, would give out K T |v|² of energy. The same for turning.
    pub(crate) fn tool(&mut self, device: Placement) -> Placement {
        let tool = self.last.map_or(device, |Last { tool, wrench, .. }| Placement {
            position: tool.position + self.linear.step(device.position - tool.position, wrench.force),
            orientation: self.angular.map_or(device.orientation, |spring| {
                let behind = rotation_between(tool.orientation, device.orientation);
                turned(tool.orientation, spring.step(behind, wrench.torque))
            }),
        });
        self.last = Some(Last { device, tool, wrench: Wrench::default() });
        tool
    }

    /// The springs' wrench on the device where the body's on the virtual tool is `body`: of the tool's
    /// reference point, as the device holds it.
    pub(crate) fn wrench(&mut self, body: Wrench) -> Wrench {
        let Some(last) = &mut self.last else { return Wrench::default() };
        last.wrench = body;
        let behind = last.device.displacement_to(&last.tool);
        let torque = self.angular.map_or(body.torque, |spring| spring.stiffness * behind.rotation);
        Wrench { force: self.linear.stiffness * behind.translation, torque }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Held still, turned by 0.3 rad, on a rotational spring of 0.2 N·m/rad: two springs in series.
    #[test]
    fn a_device_feels_its_spring_and_the_bodys_in_series() {
        let mut coupling = Coupling::new(1000.0, 4000.0).with_angular(0.5, 0.6);
        let device =
            Placement { orientation: turned([1.0, 0.0, 0.0, 0.0], DVec3::Y * 0.3), ..Placement::default() };
        let mut torque = DVec3::ZERO;
        for _ in 0..200 {
            let tool = coupling.tool(device);
            let turned = rotation_between([1.0, 0.0, 0.0, 0.0], tool.orientation);
            torque = coupling.wrench(Wrench { torque: -0.2 * turned, ..Wrench::default() }).torque;
        }
        assert!(torque.distance(DVec3::Y * (-0.3 * 0.2 * 0.5 / 0.7)) < 1e-12, "{torque}");
    }

    /// There and back by any path, round axes that change: the spring gives out nothing, as the period goes
    /// to zero.
    #[test]
    fn the_rotational_spring_is_a_potential() {
        let work = |steps: u32| {
            let coupling = Coupling::new(1000.0, 0.0).with_angular(0.5, 0.0);
            let tool = Placement::default();
            let at = |k: u32| {
                let angle = f64::from(k) / f64::from(steps) * std::f64::consts::TAU;
                let (sin, cos) = libm::sincos(angle);
                let by = DVec3::new(1.0 - cos, sin, libm::sin(2.0 * angle));
                Placement { orientation: turned(tool.orientation, by), ..tool }
            };
            let wrench = |device| {
                let mut held =
                    Coupling { last: Some(Last { device, tool, wrench: Wrench::default() }), ..coupling };
                held.wrench(Wrench::default())
            };
            (0..steps).map(|k| wrench(at(k)).work(&at(k).displacement_to(&at(k + 1)))).sum::<f64>()
        };
        // What is left is what the hold lets out: it halves with the step.
        let [coarse, fine] = [500, 1000].map(work);
        assert!(coarse > 0.0 && (coarse / fine - 2.0).abs() < 0.01 && fine < 0.03, "{coarse} {fine}");
    }
}
