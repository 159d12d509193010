//! What a loop with a person at its end is allowed to do: settings, checked against the device before anything moves.

use crate::{Damping, Limit, PassivityController, PoseGuard, SoftStart, Stages};
use palpate_device::Capabilities;
use serde::{Deserialize, Serialize};

/// Settings of the output stages. The default is for a device in somebody's hand; what isn't given comes from the
/// device's capability record.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Safety {
    /// A pose that the handle could reach only faster than this is rejected, m/s. A hand throws at about 10 m/s.
    pub speed_max_m_per_s: f64,
    /// The same for turning, rad/s. A wrist or an arm turns at up to about 50 rad/s.
    pub turn_max_rad_per_s: f64,
    /// Of a damping besides the device's own, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Of a damping of turning besides, N·m·s/rad, where rotations are driven.
    pub damping_nm_s_per_rad: f64,
    /// Whether the passivity controller may act.
    pub passivity: bool,
    /// How long the force takes to ramp up at the beginning, and after anything that went wrong, s.
    pub soft_start_s: f64,
    /// A pose that stays the same by the device's own counter for longer than this is not felt, s.
    pub stale_s: f64,
    /// After longer than this without a command the force begins anew, at zero, s; by default as soon as a period was left out.
    /// Drivers and devices take the force off after 20 ms: more than half of that is no longer safe.
    pub silence_s: Option<f64>,
    /// The largest force, N, by default [`GENTLE_N`]; the device's own limit where that is lower.
    pub force_max_n: Option<f64>,
    /// The largest torque, N·m, by default [`GENTLE_NM`]; the device's own limit where that is lower.
    pub torque_max_nm: Option<f64>,
    /// How fast the force may change, N/s. The default is the slowest that lets a stop end within two periods: half of
    /// the largest force a period.
    pub slew_n_per_s: Option<f64>,
    /// How fast the torque may change, N·m/s; the default likewise.
    pub torque_slew_nm_per_s: Option<f64>,
}

/// The largest force where none is given, N: below the largest of every device in the table, and what fingers that hold a pen
/// lightly resist. A maker's largest force (12 to 20 N) throws a handle of 0.2 kg that nobody holds firmly.
pub const GENTLE_N: f64 = 3.0;
/// The largest torque where none is given, N·m: [`GENTLE_N`] at a lever of 3 cm, that of fingers on a pen.
pub const GENTLE_NM: f64 = 0.1;
/// How long a pose may stay the same, s: as long as drivers and devices wait for a command.
const STALE: f64 = 0.02;
/// Periods without a command that are one too many: one was left out, and clocks round.
const LEFT_OUT: f64 = 1.5;

impl Default for Safety {
    fn default() -> Self {
        Safety {
            speed_max_m_per_s: 10.0,
            turn_max_rad_per_s: 100.0,
            damping_n_s_per_m: 0.0,
            damping_nm_s_per_rad: 0.0,
            passivity: false,
            soft_start_s: 0.5,
            stale_s: STALE,
            silence_s: None,
            force_max_n: None,
            torque_max_nm: None,
            slew_n_per_s: None,
            torque_slew_nm_per_s: None,
        }
    }
}

/// A setting that can't be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{setting}: {problem}; {hint}")]
pub struct SafetyError {
    /// Its name.
    pub setting: &'static str,
    /// What is wrong with it.
    pub problem: String,
    /// What to do.
    pub hint: String,
}

impl Safety {
    /// The stages for this device in a loop of `rate_hz`, without a coupling.
    ///
    /// # Errors
    /// A setting that is NaN or infinite, or out of its range; a damping that the device's mass would not bear at this rate and
    /// with a velocity as old as it is; a slew limit at which a stop would take more than two periods.
    pub fn stages(&self, device: &Capabilities, rate_hz: f64) -> Result<Stages, SafetyError> {
        within("rate_hz", rate_hz, 1.0, 1e6)?;
        let period = 1.0 / rate_hz;
        let speed = within("speed_max_m_per_s", self.speed_max_m_per_s, 0.1, 1e3)?;
        let turn = within("turn_max_rad_per_s", self.turn_max_rad_per_s, 1.0, 1e5)?;
        let seconds = within("soft_start_s", self.soft_start_s, 0.0, 60.0)?;
        // A slow loop can't know sooner.
        let stale = if self.stale_s == STALE { STALE.max(2.0 * period) } else { self.stale_s };
        let stale = within("stale_s", stale, period, 1e9)?;
        let silence = within("silence_s", self.silence_s.unwrap_or(LEFT_OUT * period), period, 1e9)?;
        let mass = device.mechanics.mass_kg.value;
        Ok(Stages {
            guard: PoseGuard::new(speed, stale).with_turn_max(turn),
            coupling: None,
            damping: self.damping(device, period)?,
            passivity: self.passivity.then(|| {
                PassivityController::new(period, mass).with_inertia(driven_inertia(device).unwrap_or(0.0))
            }),
            soft_start: SoftStart::new(seconds, period),
            force: FORCE.limit(
                device.max_force_n.value,
                Some(self.force_max_n.unwrap_or(GENTLE_N)),
                self.slew_n_per_s,
                period,
            )?,
            torque: match &device.max_torque_nm {
                // Where no rotation is driven no torque is rendered.
                None => Limit::new(0.0, 0.0),
                Some(most) => {
                    let user = self.torque_max_nm.unwrap_or(GENTLE_NM);
                    TORQUE.limit(most.value, Some(user), self.torque_slew_nm_per_s, period)?
                }
            },
            silence_s: Some(silence),
        })
    }

    fn damping(&self, device: &Capabilities, period: f64) -> Result<Option<Damping>, SafetyError> {
        let mass = device.mechanics.mass_kg.value;
        LINEAR.check(self.damping_n_s_per_m, mass, Damping::delay_s(device, period))?;
        let [linear, angular] = [self.damping_n_s_per_m, self.damping_nm_s_per_rad];
        if angular != 0.0 {
            let Some(inertia) = driven_inertia(device) else {
                return Err(SafetyError {
                    setting: ANGULAR.setting,
                    problem: format!("{} drives no rotation, or its inertia is not known", device.name),
                    hint: "give 0".into(),
                });
            };
            ANGULAR.check(angular, inertia, Damping::angular_delay_s(device, period))?;
        }
        let damping = Damping::new(linear).with_angular(angular);
        Ok((linear > 0.0 || angular > 0.0).then_some(damping))
    }
}

/// The rotational inertia, kg·m², of a device that drives rotations.
fn driven_inertia(device: &Capabilities) -> Option<f64> {
    let wrist = device.mechanics.wrist.as_ref().filter(|_| device.driven.rotations > 0)?;
    Some(wrist.inertia_kg_m2.value)
}

/// A damping's setting, its unit, and that of what it damps.
struct Damped {
    setting: &'static str,
    unit: &'static str,
    inertia_unit: &'static str,
}

const LINEAR: Damped = Damped { setting: "damping_n_s_per_m", unit: "N·s/m", inertia_unit: "kg" };
const ANGULAR: Damped =
    Damped { setting: "damping_nm_s_per_rad", unit: "N·m·s/rad", inertia_unit: "kg·m²" };

impl Damped {
    /// A sampled damping of more than half of the inertia over the delay overturns the motion that it should
    /// calm.
    fn check(&self, damping: f64, inertia: f64, delay: f64) -> Result<(), SafetyError> {
        let Damped { setting, unit, inertia_unit } = *self;
        let most = 0.5 * inertia / delay;
        if (0.0..=most).contains(&damping) {
            return Ok(());
        }
        // Rounded down, so that what is proposed is allowed.
        let digits = 10f64.powf(3.0 - most.max(1e-9).log10().ceil());
        let proposed = (most * digits).floor() / digits;
        Err(SafetyError {
            setting,
            problem: format!(
                "{damping} is not between 0 and {proposed} {unit}, half of the device's {inertia} {inertia_unit} over the \
                 {:.1} ms from a motion to the force that damps it",
                delay * 1e3
            ),
            hint: format!("give at most {proposed}, or a higher rate"),
        })
    }
}

/// The names that a limit's settings have.
struct Named {
    most: &'static str,
    slew: &'static str,
    unit: &'static str,
}

const FORCE: Named = Named { most: "force_max_n", slew: "slew_n_per_s", unit: "N" };
const TORQUE: Named = Named { most: "torque_max_nm", slew: "torque_slew_nm_per_s", unit: "N·m" };

impl Named {
    fn limit(
        &self,
        device: f64,
        user: Option<f64>,
        slew: Option<f64>,
        period: f64,
    ) -> Result<Limit, SafetyError> {
        let Named { most: name, unit, .. } = self;
        let device = Some(device).filter(|most| *most > 0.0 && most.is_finite());
        let user = user.map(|most| within(name, most, 1e-6, 1e4)).transpose()?;
        let Some(most) = device.into_iter().chain(user).reduce(f64::min) else {
            return Err(SafetyError {
                setting: self.most,
                problem: "the device names none".into(),
                hint: format!("give one, in {unit}"),
            });
        };
        // Two steps must bring the largest force to zero.
        let least = 0.5 * most / period;
        let slew = slew.unwrap_or(least);
        // The least slew as somebody would write it down, rounded, is meant to be enough.
        if !(slew >= least * (1.0 - 1e-9) && slew < f64::INFINITY) {
            return Err(SafetyError {
                setting: self.slew,
                problem: format!(
                    "at {slew} {unit}/s a stop would not bring {most} {unit} to zero within two periods"
                ),
                // Rounded up: a message is no place for 1649.9999999999998.
                hint: format!("give at least {} {unit}/s, or a lower {name}", (least * 1e3).ceil() * 1e-3),
            });
        }
        Ok(Limit::new(most, slew * period))
    }
}

fn within(setting: &'static str, value: f64, least: f64, most: f64) -> Result<f64, SafetyError> {
    if (least..=most).contains(&value) {
        return Ok(value);
    }
    Err(SafetyError {
        setting,
        problem: format!("{value} is not between {least} and {most}"),
        hint: "give a number in between".into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_device::{Figure, presets};

    fn touch() -> Capabilities {
        presets::device("touch").unwrap()
    }

    #[test]
    fn the_lower_limit_wins_and_the_slew_is_half_of_it_a_period() {
        for (asked, most) in [(None, GENTLE_N), (Some(2.0), 2.0), (Some(50.0), 3.3)] {
            for rate in [500.0, 1000.0, 4000.0] {
                let safety = Safety { force_max_n: asked, ..Safety::default() };
                let stages = safety.stages(&touch(), rate).unwrap();
                assert_eq!((stages.force.most(), stages.torque.most()), (most, 0.0));
                assert!((stages.force.step() - 0.5 * most).abs() < 1e-12);
            }
        }
        let sigma = presets::device("sigma").unwrap();
        let stages = Safety::default().stages(&sigma, 1000.0).unwrap();
        assert_eq!((stages.torque.most(), stages.torque.step()), (0.1, 0.05));
    }

    #[test]
    fn a_setting_that_cant_be_is_refused_with_its_name_and_the_hint() {
        let safety = Safety::default();
        let wrong = [
            (Safety { slew_n_per_s: Some(1499.0), ..safety }, "slew_n_per_s"),
            (Safety { slew_n_per_s: Some(f64::NAN), ..safety }, "slew_n_per_s"),
            (Safety { slew_n_per_s: Some(f64::INFINITY), ..safety }, "slew_n_per_s"),
            (Safety { force_max_n: Some(0.0), ..safety }, "force_max_n"),
            (Safety { force_max_n: Some(f64::NAN), ..safety }, "force_max_n"),
            (Safety { stale_s: f64::NAN, ..safety }, "stale_s"),
            (Safety { silence_s: Some(0.0), ..safety }, "silence_s"),
            (Safety { soft_start_s: -1.0, ..safety }, "soft_start_s"),
            (Safety { damping_n_s_per_m: 30.0, ..safety }, "damping_n_s_per_m"),
            (Safety { damping_n_s_per_m: f64::NAN, ..safety }, "damping_n_s_per_m"),
            (Safety { damping_nm_s_per_rad: 1e-6, ..safety }, "damping_nm_s_per_rad"),
            (Safety { speed_max_m_per_s: 0.0, ..safety }, "speed_max_m_per_s"),
            (Safety { turn_max_rad_per_s: 0.0, ..safety }, "turn_max_rad_per_s"),
        ];
        for (safety, setting) in wrong {
            let error = safety.stages(&touch(), 1000.0).unwrap_err();
            assert!(error.setting == setting && error.to_string().contains("give"), "{error}");
        }
        assert_eq!(safety.stages(&touch(), f64::NAN).unwrap_err().setting, "rate_hz");
        let enough = Safety { slew_n_per_s: Some(1500.0), ..safety };
        assert!(enough.stages(&touch(), 1000.0).is_ok());
        let message = Safety { slew_n_per_s: Some(100.0), ..safety }.stages(&touch(), 1000.0).unwrap_err();
        assert_eq!(
            message.to_string(),
            "slew_n_per_s: at 100 N/s a stop would not bring 3 N to zero within two periods; give at least 1500 N/s, \
             or a lower force_max_n"
        );
    }

    /// A maker's 20 N are not what a first touch renders: somebody has to ask for them.
    #[test]
    fn the_largest_force_is_a_gentle_one_until_another_is_given() {
        let mut device = presets::device("delta").unwrap();
        let most = |device: &Capabilities, force_max_n| {
            Safety { force_max_n, ..Safety::default() }.stages(device, 1000.0).unwrap().force.most()
        };
        assert_eq!((most(&device, None), most(&device, Some(20.0))), (GENTLE_N, 20.0));
        assert!(presets::DEVICES.iter().all(|d| presets::device(d).unwrap().max_force_n.value > GENTLE_N));
        device.max_force_n = Figure::chosen(f64::INFINITY);
        assert_eq!(most(&device, None), GENTLE_N);
    }

    /// Torque has a gentle default, a damping within half of inertia/delay, and a share of the passivity
    /// controller's.
    #[test]
    fn a_driven_wrist_has_limits_of_its_own() {
        let mut sigma = presets::device("sigma").unwrap();
        sigma.max_torque_nm = Some(Figure::chosen(0.4));
        let most = |torque_max_nm| {
            let safety = Safety { torque_max_nm, ..Safety::default() };
            safety.stages(&sigma, 1000.0).unwrap().torque.most()
        };
        assert_eq!([most(None), most(Some(0.3)), most(Some(5.0))], [GENTLE_NM, 0.3, 0.4]);
        let stages = Safety { passivity: true, ..Safety::default() }.stages(&sigma, 1000.0).unwrap();
        assert_eq!(stages.guard, PoseGuard::new(10.0, STALE).with_turn_max(100.0));
        assert_eq!(stages.passivity, Some(PassivityController::new(1e-3, 0.35).with_inertia(1e-4)));
        // 1e-4 kg·m² over 1 ms, twice 0.2 ms and the smoothing's 3 ms.
        let allowed = |damping_nm_s_per_rad| {
            Safety { damping_nm_s_per_rad, ..Safety::default() }.stages(&sigma, 1000.0).map(|s| s.damping)
        };
        let error = allowed(0.0115).unwrap_err().to_string();
        assert!(error.contains("0.0113 N·m·s/rad") && error.contains("give at most 0.0113"), "{error}");
        assert!(allowed(f64::NAN).is_err() && allowed(-1e-3).is_err());
        assert!(allowed(0.0113).unwrap().is_some() && allowed(0.0).unwrap().is_none());
    }

    /// A library that averages over 20 ms tells of a velocity 10 ms ago: ten times less damping than a period's delay would bear.
    #[test]
    fn the_damping_that_is_allowed_knows_how_old_the_velocity_is() {
        let mut device = presets::device("omega").unwrap();
        let allowed = |device: &Capabilities, damping_n_s_per_m| {
            Safety { damping_n_s_per_m, ..Safety::default() }.stages(device, 1000.0).is_ok()
        };
        device.velocity_delay_s = Some(Figure::chosen(0.0));
        assert!(allowed(&device, 50.0));
        device.velocity_delay_s = Some(Figure::chosen(0.01));
        assert!(!allowed(&device, 50.0) && allowed(&device, 8.0) && !allowed(&device, 10.0));
        device.velocity_delay_s = None;
        assert!(allowed(&device, 20.0) && !allowed(&device, 30.0));
    }
}
