//! What a session is: everything that `palpate run` can be told, as data.

use crate::device_choice::{DeviceChoice, Drivers};
use crate::{Patience, RealTime, Safety, SafetyError};
use palpate_body::SlipRule;
use palpate_engine::Ablation;
use palpate_files::{Source, read_text};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use std::path::{Path, PathBuf};

/// A session's settings, in SI units. As TOML each has its name here; what is left out is as in the default, and a key
/// that does not exist is an error.
///
/// ```
/// # use palpate_runtime::SessionConfig;
/// let config: SessionConfig = toml::from_str(
///     r#"
///     device = "simulated:omega"
///     seconds = 2
///     [safety]
///     force_max_n = 1.5
///     "#,
/// )?;
/// assert_eq!(config.rate_hz, 1000.0);
/// # Ok::<(), toml::de::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SessionConfig {
    /// What is in the hand.
    pub device: DeviceChoice,
    /// Against which clock.
    pub clock: ClockChoice,
    /// Periods a second.
    pub rate_hz: f64,
    /// How long, s; `None` for as long as the motion script or the replay, and with a real device until it is stopped.
    pub seconds: Option<f64>,
    /// What a simulated hand does: a name of [`motion::NAMES`](crate::motion::NAMES) or a TOML file.
    pub motion: String,
    /// Whose hand holds a simulated device: a name of [`presets::HANDS`](palpate_device::presets::HANDS).
    pub hand: String,
    /// In place of the body's own slip rule.
    pub slip: Option<SlipRule>,
    /// Whether the body's tank, if it has one, keeps slip from giving out energy.
    pub tank: bool,
    /// Whether contacts are two contact points side by side, where the body wants partial slip.
    pub partial_slip: bool,
    /// By how much the body's friction coefficients are multiplied.
    pub friction_scale: f64,
    /// Interpolations taken away, as in the paper's section 5: none, coordinates, responses, or both.
    #[serde(with = "ablation")]
    pub ablation: Ablation,
    /// A virtual coupling of this stiffness, N/m.
    pub coupling_n_per_m: Option<f64>,
    /// And its rotational spring, N·m/rad.
    pub coupling_nm_per_rad: Option<f64>,
    /// Elements of the patch that the haptic thread works on.
    pub patch_elements: usize,
    /// A file to record into. It must not be there yet.
    pub record: Option<PathBuf>,
    /// Whether what could not be had (a watchdog, a calibration, locked memory, a priority) is an error, and not a note.
    pub strict: bool,
    /// Limits and output stages.
    #[serde(deserialize_with = "known_safety")]
    pub safety: Safety,
    /// Where the device works in the body's frame.
    pub workspace: WorkspaceSettings,
    /// When the watchdogs trip.
    pub patience: Patience,
    /// What the haptic thread asks of the system.
    pub real_time: RealTime,
    /// How vendors' devices are reached.
    pub drivers: Drivers,
    /// What is kept of the past for [`LiveSession::history`](crate::LiveSession::history).
    pub history: History,
}

/// Against which clock a loop runs; the stages and their limits are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClockChoice {
    /// The machine's: a haptic thread and a contact finder.
    #[default]
    Real,
    /// None: period after period as fast as the machine can, with a simulated device, the same bits every time.
    Virtual,
}

/// What of the map from the device's workspace to the body's frame is given.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WorkspaceSettings {
    /// Body's way per device's way; 1 if not given.
    pub scale: Option<f64>,
    /// Where the device's origin is in the body's frame, m; without it, the tool begins above the body's top.
    pub offset_m: Option<[f64; 3]>,
    /// How the device's frame is turned in the body's: a unit quaternion w x y z.
    pub rotation: Option<[f64; 4]>,
    /// Where the tool's tip is in the handle's frame, m: a force there is a torque at the handle. At the handle's reference point if
    /// not given.
    pub tip_in_handle_m: Option<[f64; 3]>,
    /// How the tool is turned in the handle's frame: a unit quaternion w x y z.
    pub handle_from_tool: Option<[f64; 4]>,
    /// Button that lifts the tool off while it is held, as a mouse is lifted.
    pub clutch_button: Option<u32>,
}

/// A past that is thinned out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct History {
    /// Periods kept a second.
    pub rate_hz: f64,
    /// How far back, s.
    pub seconds: f64,
}

/// A recording's header may know of settings that this version does not; a configuration may not.
fn known_safety<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Safety, D::Error> {
    let given = serde_json::Map::deserialize(deserializer)?;
    let known = serde_json::to_value(Safety::default()).map_err(D::Error::custom)?;
    let is_none = |value: &serde_json::Value| value.is_null();
    if let Some(key) = given.keys().find(|key| given.get(key.as_str()).is_some_and(is_none)) {
        return Err(D::Error::custom(format!(
            "{key} in safety is no finite number; give one, or leave it out"
        )));
    }
    if let Some(key) = given.keys().find(|key| known.get(key.as_str()).is_none()) {
        return Err(D::Error::custom(format!("unknown field `{key}` in safety")));
    }
    serde_json::from_value(given.into()).map_err(D::Error::custom)
}

/// The engine knows nothing of serde.
mod ablation {
    use crate::live_session::ablation_name;
    use palpate_engine::Ablation;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    const ALL: [Ablation; 4] = [Ablation::None, Ablation::Coordinates, Ablation::Responses, Ablation::Both];

    pub fn serialize<S: Serializer>(ablation: &Ablation, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(ablation_name(*ablation))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Ablation, D::Error> {
        let name = String::deserialize(deserializer)?;
        let found = ALL.into_iter().find(|a| ablation_name(*a) == name);
        found.ok_or_else(|| D::Error::unknown_variant(&name, &["none", "coordinates", "responses", "both"]))
    }
}

impl Default for History {
    fn default() -> Self {
        History { rate_hz: 100.0, seconds: 30.0 }
    }
}

impl Default for SessionConfig {
    fn default() -> Self {
        SessionConfig {
            device: DeviceChoice::default(),
            clock: ClockChoice::default(),
            rate_hz: 1000.0,
            seconds: None,
            motion: "drag".into(),
            hand: "fingers".into(),
            slip: None,
            tank: true,
            partial_slip: true,
            friction_scale: 1.0,
            ablation: Ablation::None,
            coupling_n_per_m: None,
            coupling_nm_per_rad: None,
            patch_elements: crate::PATCH_ELEMENTS,
            record: None,
            strict: false,
            safety: Safety::default(),
            workspace: WorkspaceSettings::default(),
            patience: Patience::default(),
            real_time: RealTime::default(),
            drivers: Drivers::default(),
            history: History::default(),
        }
    }
}

impl SessionConfig {
    /// Reads a TOML file.
    ///
    /// # Errors
    /// It can't be read; an unknown key, a value of another kind. The message names the line.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let text = read_text(path)?;
        toml::from_str(&text).map_err(|e| Source { path, text: &text }.syntax(&e))
    }

    /// Looks at what depends on neither device nor body.
    ///
    /// # Errors
    /// A setting that is out of its range, or that does not go with another.
    pub fn check(&self) -> Result<(), SafetyError> {
        let error =
            |setting, problem: String, hint: &str| SafetyError { setting, problem, hint: hint.into() };
        let within = |setting, value: f64, least: f64, most: f64| {
            let fits = (least..=most).contains(&value);
            let hint = format!("give a number from {least} to {most}");
            fits.then_some(()).ok_or_else(|| error(setting, format!("it is {value}"), &hint))
        };
        let is_virtual = self.clock == ClockChoice::Virtual;
        within("rate_hz", self.rate_hz, 10.0, if is_virtual { 1e6 } else { 2e4 })?;
        self.seconds.map_or(Ok(()), |s| within("seconds", s, 1e-6, 1e5))?;
        self.coupling_n_per_m.map_or(Ok(()), |k| within("coupling_n_per_m", k, 1e-6, 1e7))?;
        self.coupling_nm_per_rad.map_or(Ok(()), |k| within("coupling_nm_per_rad", k, 1e-6, 1e4))?;
        if self.coupling_nm_per_rad.is_some() && self.coupling_n_per_m.is_none() {
            let problem = "a coupling that turns needs one that moves".into();
            return Err(error("coupling_nm_per_rad", problem, "give coupling_n_per_m, too"));
        }
        within("friction_scale", self.friction_scale, 0.0, 100.0)?;
        within("patch_elements", self.patch_elements as f64, 64.0, f64::from(1 << 18))?;
        within("patience.late_s", self.patience.late_s, 1e-3, 10.0)?;
        within("patience.pose_s", self.patience.pose_s, 1e-3, 1e9)?;
        within("patience.finder_s", self.patience.finder_s, 1e-3, 1e9)?;
        within("patience.faults", f64::from(self.patience.faults), 1.0, 1e6)?;
        within("real_time.core", self.real_time.core.map_or(0.0, f64::from), 0.0, 1023.0)?;
        within("real_time.spin_s", self.real_time.spin_s, 0.0, 0.1)?;
        within("history.rate_hz", self.history.rate_hz, 1e-3, 2e4)?;
        within("history.seconds", self.history.seconds, 0.0, 3600.0)?;
        within("history.rate_hz times seconds", self.history.rate_hz * self.history.seconds, 0.0, 1e5)?;
        if self.real_time.priority.is_some_and(|p| !(1..=98).contains(&p)) {
            return Err(error(
                "real_time.priority",
                "it is not from 1 to 98".into(),
                "give one; 0 in a file asks for none",
            ));
        }
        // Half of the time after which the device, or its driver, takes the force off by itself.
        let silence = match self.device {
            DeviceChoice::Dhd(_) | DeviceChoice::OpenHaptics(_) => Some(10e-3),
            DeviceChoice::Haply(_) => Some(2.5e-3),
            DeviceChoice::Simulated(_) | DeviceChoice::Replay(_) => None,
        };
        if let Some(silence) = silence {
            within("rate_hz", self.rate_hz, 1.0 / silence, 2e4)?;
            self.safety
                .silence_s
                .map_or(Ok(()), |s| within("safety.silence_s", s, 1.0 / self.rate_hz, 10e-3))?;
        }
        if is_virtual && !matches!(self.device, DeviceChoice::Simulated(_)) {
            let problem = format!("{} goes by the clock", self.device);
            return Err(error(
                "clock",
                problem,
                "virtual time is for a simulated device: give that, or the real clock",
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_written_and_read_again() {
        let config = SessionConfig::default();
        assert_eq!(config.check(), Ok(()));
        let text = toml::to_string(&config).unwrap();
        assert_eq!(toml::from_str::<SessionConfig>(&text).unwrap(), config, "{text}");
        // What asks for nothing can be said.
        let real_time = RealTime { priority: None, core: None, lock_memory: false, spin_s: 0.0 };
        let modest = SessionConfig { real_time, ..SessionConfig::default() };
        let text = toml::to_string(&modest).unwrap();
        assert_eq!(toml::from_str::<SessionConfig>(&text).unwrap(), modest, "{text}");
        assert!(toml::from_str::<SessionConfig>("[safety]\nforce_max_n = nan").is_err());
        assert!(toml::from_str::<SessionConfig>("rate = 1000").is_err());
        assert!(toml::from_str::<SessionConfig>("[safety]\nforce_max = 1").is_err());
    }

    #[test]
    fn what_cannot_be_is_refused_by_its_name() {
        let config = SessionConfig::default;
        let real_time = |priority| RealTime { priority, ..RealTime::default() };
        let patience = |finder_s| Patience { finder_s, ..Patience::default() };
        for (config, setting) in [
            (SessionConfig { patience: patience(f64::NAN), ..config() }, "patience.finder_s"),
            (SessionConfig { device: DeviceChoice::Dhd(None), rate_hz: 50.0, ..config() }, "rate_hz"),
            (SessionConfig { device: DeviceChoice::Haply(None), rate_hz: 200.0, ..config() }, "rate_hz"),
            (SessionConfig { rate_hz: f64::NAN, ..config() }, "rate_hz"),
            (SessionConfig { seconds: Some(0.0), ..config() }, "seconds"),
            (SessionConfig { friction_scale: -1.0, ..config() }, "friction_scale"),
            (SessionConfig { patch_elements: 1, ..config() }, "patch_elements"),
            (SessionConfig { real_time: real_time(Some(99)), ..config() }, "real_time.priority"),
            (
                SessionConfig { device: DeviceChoice::Dhd(None), clock: ClockChoice::Virtual, ..config() },
                "clock",
            ),
        ] {
            assert_eq!(config.check().unwrap_err().setting, setting);
        }
    }
}
