//! Which device: as an option or a configuration names it, and how it is reached.

use palpate_device::Device;
#[cfg(feature = "devices")]
use palpate_device::{Dhd, DhdOptions, Haply, HaplyForceKey, HaplyOptions, OpenHaptics, OpenHapticsOptions};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// A kind of device, and which one of its kind: `simulated[:PRESET]`, `dhd[:INDEX]`, `openhaptics[:NAME]`, `haply[:ID]`,
/// `replay:FILE`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum DeviceChoice {
    /// A simulated device in a simulated hand; by its name among [`presets::DEVICES`](palpate_device::presets::DEVICES).
    Simulated(Option<String>),
    /// Force Dimension's, counted from 0.
    Dhd(Option<u8>),
    /// 3D Systems', by its name in the vendor's configuration.
    OpenHaptics(Option<String>),
    /// Haply's Inverse3, by its number.
    Haply(Option<String>),
    /// Poses from a recording or a Path CSV.
    Replay(PathBuf),
}

impl Default for DeviceChoice {
    fn default() -> Self {
        DeviceChoice::Simulated(None)
    }
}

impl FromStr for DeviceChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, which) = text.split_once(':').map_or((text, None), |(k, w)| (k, Some(w)));
        let name = which.map(String::from);
        match (kind, which) {
            (_, Some("")) => Err(format!("nothing comes after {kind}:")),
            ("simulated", _) => Ok(DeviceChoice::Simulated(name)),
            ("openhaptics", _) => Ok(DeviceChoice::OpenHaptics(name)),
            ("haply", _) => Ok(DeviceChoice::Haply(name)),
            ("replay", Some(file)) => Ok(DeviceChoice::Replay(file.into())),
            ("replay", None) => Err("name the file: replay:FILE".into()),
            ("dhd", None) => Ok(DeviceChoice::Dhd(None)),
            ("dhd", Some(index)) => match index.parse() {
                Ok(index) => Ok(DeviceChoice::Dhd(Some(index))),
                Err(_) => Err(format!("{index} is no device's number; count from 0")),
            },
            _ => Err("give simulated, dhd, openhaptics, haply or replay:FILE".into()),
        }
    }
}

impl TryFrom<String> for DeviceChoice {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<DeviceChoice> for String {
    fn from(choice: DeviceChoice) -> Self {
        choice.to_string()
    }
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, which) = match self {
            DeviceChoice::Simulated(preset) => ("simulated", preset.clone()),
            DeviceChoice::Dhd(index) => ("dhd", index.map(|i| i.to_string())),
            DeviceChoice::OpenHaptics(name) => ("openhaptics", name.clone()),
            DeviceChoice::Haply(id) => ("haply", id.clone()),
            DeviceChoice::Replay(file) => ("replay", Some(file.display().to_string())),
        };
        write!(f, "{kind}{}", which.map_or_else(String::new, |which| format!(":{which}")))
    }
}

/// How vendors' devices are reached, where not in the usual way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Drivers {
    /// The vendor's library, where it is not found by its usual names.
    pub library: Option<PathBuf>,
    /// The address of Haply's service, where it is not the usual one.
    pub url: Option<String>,
    /// How Haply's service wants its forces: `vector`, or `values` before version 3.2.
    pub haply_force_key: ForceKey,
    /// Whether a Force Dimension device must have its own watchdog armed. Without it nothing takes the force off when the
    /// program hangs or is killed.
    pub watchdog_required: bool,
}

impl Default for Drivers {
    fn default() -> Self {
        Drivers { library: None, url: None, haply_force_key: ForceKey::default(), watchdog_required: true }
    }
}

/// The key of a force in a command to Haply's service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ForceKey {
    /// From version 3.2 on.
    #[default]
    Vector,
    /// Before.
    Values,
}

impl Drivers {
    /// The driver of a vendor's device, not yet opened; its largest force is `max_force_n`, or the device's own. `None` for what is no vendor's,
    /// and where the drivers were not built in.
    pub fn driver(&self, choice: &DeviceChoice, max_force_n: Option<f64>) -> Option<Box<dyn Device>> {
        #[cfg(feature = "devices")]
        {
            let library = self.library.clone();
            Some(match choice {
                DeviceChoice::Dhd(index) => Box::new(Dhd::new(DhdOptions {
                    library,
                    index: *index,
                    max_force_n,
                    watchdog_required: self.watchdog_required,
                    ..DhdOptions::default()
                })),
                DeviceChoice::OpenHaptics(name) => Box::new(OpenHaptics::new(OpenHapticsOptions {
                    library,
                    name: name.clone(),
                    max_force_n,
                    ..OpenHapticsOptions::default()
                })),
                DeviceChoice::Haply(id) => {
                    let default = HaplyOptions::default();
                    Box::new(Haply::new(HaplyOptions {
                        url: self.url.clone().unwrap_or(default.url.clone()),
                        device_id: id.clone(),
                        max_force_n,
                        force_key: match self.haply_force_key {
                            ForceKey::Vector => HaplyForceKey::Vector,
                            ForceKey::Values => HaplyForceKey::Values,
                        },
                        ..default
                    }))
                }
                DeviceChoice::Simulated(_) | DeviceChoice::Replay(_) => return None,
            })
        }
        #[cfg(not(feature = "devices"))]
        {
            let _ = (choice, max_force_n);
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_is_read_as_it_is_written() {
        for text in
            ["simulated", "simulated:omega", "dhd", "dhd:1", "openhaptics:Left", "haply:049D", "replay:a:b"]
        {
            assert_eq!(text.parse::<DeviceChoice>().unwrap().to_string(), text);
        }
        for text in ["", "mouse", "dhd:x", "replay", "haply:"] {
            assert!(text.parse::<DeviceChoice>().is_err(), "{text}");
        }
    }
}
