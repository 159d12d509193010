//! From the engine's wrench to the device's command: the output stages, in their order.

use crate::wrench::Wrench;
use crate::{Coupling, Damping, Limit, PassivityController, PoseGuard, SoftStart, StageFlags};
use glam::DVec3;
use palpate_device::{Command, Sample};

/// What lies between the engine and the device, in the order in which it acts. The default lets everything pass but what
/// is NaN or infinite; [`Safety::stages`](crate::Safety::stages) makes those for a device that somebody holds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stages {
    /// Which poses are accepted.
    pub guard: PoseGuard,
    /// A spring between the device and a virtual tool that touches the body in its place.
    pub coupling: Option<Coupling>,
    /// Takes energy out of the hand's motion.
    pub damping: Option<Damping>,
    /// Takes back energy that the loop would give out.
    pub passivity: Option<PassivityController>,
    /// Lets the force ramp up.
    pub soft_start: SoftStart,
    /// Cuts the force and its steps.
    pub force: Limit,
    /// Cuts the torque and its steps.
    pub torque: Limit,
    /// A device that has had no command for longer than this, s, may have taken its force off by itself; `None` for one
    /// that never does.
    pub silence_s: Option<f64>,
}

impl Stages {
    /// The command for the wrench `wanted` at the handle, in the device's frame. `silence` asks for none:
    /// what is rendered goes to zero within the slew limit, and ramps up anew afterwards.
    pub(crate) fn command(
        &mut self,
        now: f64,
        sample: &Sample,
        wanted: Wrench,
        silence: bool,
        flags: &mut StageFlags,
    ) -> Command {
        let mut wrench =
            Wrench { force: contain(wanted.force, flags), torque: contain(wanted.torque, flags) };
        // The handle is where the last pose that was accepted has it; with none, nothing moves.
        let placement = self.guard.placement().unwrap_or_default();
        if let Some(damping) = &mut self.damping {
            let against = damping.wrench(now, placement, sample);
            wrench.force += against.force;
            wrench.torque += against.torque;
        }
        if let Some(controller) = &mut self.passivity {
            let before = controller.active();
            wrench = controller.pass(placement, wrench);
            flags.set(StageFlags::PASSIVITY, controller.active() > before);
        }
        let factor = self.soft_start.factor(silence);
        flags.set(StageFlags::STARTING, factor < 1.0);
        let rendered = Wrench {
            force: self.force.pass(wrench.force, factor, flags),
            torque: self.torque.pass(wrench.torque, factor, flags),
        };
        if let Some(controller) = &mut self.passivity {
            controller.rendered(rendered);
        }
        Command { force_n: rendered.force.to_array(), torque_nm: rendered.torque.to_array() }
    }

    /// What the device renders is not known, or nothing: zero follows at once, and then the soft start.
    pub(crate) fn reset(&mut self) {
        self.force.reset();
        self.torque.reset();
    }
}

/// A NaN or infinite value becomes zero.
fn contain(wanted: DVec3, flags: &mut StageFlags) -> DVec3 {
    flags.set(StageFlags::CONTAINED, !wanted.is_finite());
    if wanted.is_finite() { wanted } else { DVec3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrench(force: DVec3, torque: DVec3) -> Wrench {
        Wrench { force, torque }
    }

    fn at(x: f64) -> Sample {
        let mut sample = Sample::default();
        sample.pose.position_m = [x, 0.0, 0.0];
        sample
    }

    #[test]
    fn what_is_no_number_never_leaves() {
        for stages in [Stages::default(), Stages { force: Limit::new(3.0, 1.5), ..Stages::default() }] {
            for wrong in [f64::NAN, f64::INFINITY] {
                let (mut stages, mut flags) = (stages, StageFlags::default());
                let wanted = wrench(DVec3::new(1.0, wrong, 0.0), DVec3::X);
                let command = stages.command(0.0, &at(0.0), wanted, false, &mut flags);
                assert_eq!((command.force_n, command.torque_nm), ([0.0; 3], [1.0, 0.0, 0.0]));
                assert!(flags.has(StageFlags::CONTAINED));
            }
        }
    }

    /// A velocity that the device reports may be anything.
    #[test]
    fn what_damping_makes_of_no_number_is_contained() {
        let mut stages = Stages { damping: Some(Damping::new(1.0)), ..Stages::default() };
        let (mut sample, mut flags) = (at(0.0), StageFlags::default());
        sample.velocity_m_per_s = Some([f64::NAN; 3]);
        let command = stages.command(0.0, &sample, wrench(DVec3::X, DVec3::ZERO), false, &mut flags);
        assert!(command.force_n == [0.0; 3] && flags.has(StageFlags::CONTAINED));
    }

    /// The controller's books are of what was rendered, not of what it asked for.
    #[test]
    fn the_passivity_controller_knows_what_the_limit_made_of_it() {
        let controller = PassivityController::new(1e-3, 0.1);
        let mut stages =
            Stages { passivity: Some(controller), force: Limit::new(2.0, 2.0), ..Stages::default() };
        let mut flags = StageFlags::default();
        stages.guard.accept(&at(0.0), 0.0);
        stages.command(0.0, &at(0.0), wrench(DVec3::X * 50.0, DVec3::ZERO), false, &mut flags);
        stages.guard.accept(&Sample { sequence: 1, ..at(-1e-3) }, 1e-3);
        stages.command(1e-3, &at(-1e-3), Wrench::default(), false, &mut flags);
        let observed = stages.passivity.unwrap().observed_j();
        assert!((observed - 2e-3).abs() < 1e-12, "{observed}");
    }

    #[test]
    fn silence_is_two_periods_away_and_the_force_grows_in_again() {
        let mut stages = Stages {
            soft_start: SoftStart::new(4e-3, 1e-3),
            force: Limit::new(2.0, 1.0),
            ..Stages::default()
        };
        let mut flags = StageFlags::default();
        let mut x = |silence| {
            let wanted = wrench(DVec3::X * 2.0, DVec3::ZERO);
            stages.command(0.0, &at(0.0), wanted, silence, &mut flags).force_n[0]
        };
        let heights: Vec<f64> = [false, false, false, false, true, true, false].map(&mut x).to_vec();
        let expected = [0.5, 1.0, 1.5, 2.0, 1.0, 0.0, 0.5];
        assert!(heights.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{heights:?}");
    }
}
