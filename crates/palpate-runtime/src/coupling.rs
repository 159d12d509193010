//! Virtual coupling: a spring and a damper between the device and a small virtual tool, which is what touches the body.
//!
//! The device then feels no more stiffness than the spring's, whatever the body's (Colgate, Stanley and Brown 1995;
//! Adams and Hannaford 1999). What it costs: the virtual tool is behind the device by F/k_c, so that the body feels as
//! much softer.

use glam::DVec3;

/// The virtual tool and what ties it to the device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// k_c, N/m.
    stiffness: f64,
    /// b_c, N·s/m.
    damping: f64,
    /// The virtual tool's mass, kg.
    mass: f64,
    /// The loop's period, s.
    period: f64,
    state: Option<State>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct State {
    device: DVec3,
    tool: DVec3,
    velocity: DVec3,
    /// On the virtual tool from the body, N.
    force: DVec3,
}

impl Coupling {
    /// A coupling of this stiffness (N/m) in a loop of this period (s), at which it is as well damped as its spring
    /// allows: b_c = k_c T/2, the most that a damper of backward differences can do at that stiffness, and a mass that
    /// is critically damped by it and twice as much again from the spring's implicit step: m = k_c T².
    pub fn new(stiffness_n_per_m: f64, period_s: f64) -> Self {
        let (k, t) = (stiffness_n_per_m, period_s);
        Coupling { stiffness: k, damping: 0.5 * k * t, mass: k * t * t, period: t, state: None }
    }

    /// Where the virtual tool is when the device is at `device` (m), moved one period on under the force (N) that the
    /// body had for its last place: implicit in spring and damper.
    ///
    /// ```text
    /// m (v' − v)/T = k_c (x_d − x − T v') + b_c (v_d − v') + f
    /// ```
    pub(crate) fn tool(&mut self, device: DVec3) -> DVec3 {
        let t = self.period;
        let state = match self.state {
            None => State { device, tool: device, velocity: DVec3::ZERO, force: DVec3::ZERO },
            Some(State { device: before, tool, velocity, force }) => {
                let pull = self.mass / t * velocity
                    + self.stiffness * (device - tool)
                    + self.damping * (device - before) / t
                    + force;
                let velocity = pull / (self.mass / t + self.stiffness * t + self.damping);
                State { device, tool: tool + velocity * t, velocity, force }
            }
        };
        self.state = Some(state);
        state.tool
    }

    /// The force on the device, N, where the body's on the virtual tool is `force`: the spring's.
    pub(crate) fn force(&mut self, force: DVec3) -> DVec3 {
        let Some(state) = &mut self.state else { return DVec3::ZERO };
        state.force = force;
        self.stiffness * (state.tool - state.device)
    }
}
