//! What goes to and fro.

use super::{HaplyForceKey, PLUG, error};
use crate::OpenError;
use crate::frame::Axes;
use serde::Deserialize;
use std::borrow::Cow;
use std::fmt::Write;

/// What the service sends, as far as it is of use here; both the inventory and the states after it.
#[derive(Debug, Deserialize)]
struct Message<'a> {
    #[serde(default, borrow)]
    inverse3: Vec<Inverse3<'a>>,
    #[serde(default)]
    verse_grip: Vec<Grip>,
    #[serde(default)]
    wireless_verse_grip: Vec<Grip>,
    #[serde(default)]
    custom_verse_grip: Vec<Grip>,
}

#[derive(Debug, Deserialize)]
struct Inverse3<'a> {
    #[serde(borrow)]
    device_id: Cow<'a, str>,
    #[serde(borrow)]
    config: Option<Config<'a>>,
    state: Option<State>,
    status: Option<Status>,
}

#[derive(Debug, Deserialize)]
struct Config<'a> {
    #[serde(borrow)]
    handedness: Option<Cow<'a, str>>,
}

#[derive(Debug, Deserialize)]
struct State {
    cursor_position: Option<Vector>,
    cursor_velocity: Option<Vector>,
}

#[derive(Debug, Deserialize)]
struct Status {
    ready: Option<bool>,
    calibrated: Option<bool>,
    in_use: Option<bool>,
    power_supply: Option<bool>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Debug, Deserialize)]
struct Grip {
    state: Option<GripState>,
}

#[derive(Debug, Deserialize)]
struct GripState {
    orientation: Option<Quaternion>,
    #[serde(alias = "button")]
    buttons: Option<Buttons>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct Quaternion {
    w: f64,
    x: f64,
    y: f64,
    z: f64,
}

/// One, or several by name; the names changed with the service.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Buttons {
    One(bool),
    Named(Names),
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct Names {
    #[serde(default, alias = "button_0")]
    a: bool,
    #[serde(default, alias = "button_1")]
    b: bool,
    #[serde(default, alias = "button_2")]
    c: bool,
    #[serde(default)]
    button_3: bool,
}

impl Buttons {
    fn mask(self) -> u32 {
        match self {
            Buttons::One(pressed) => u32::from(pressed),
            Buttons::Named(Names { a, b, c, button_3 }) => {
                [a, b, c, button_3].into_iter().rev().fold(0, |mask, pressed| mask << 1 | u32::from(pressed))
            }
        }
    }
}

impl Message<'_> {
    /// The grip that is held: a wireless one before one with a cable, and one of somebody's own last.
    fn grip(&self) -> Option<&GripState> {
        let grips = [&self.wireless_verse_grip, &self.verse_grip, &self.custom_verse_grip];
        grips.into_iter().flatten().find_map(|grip| grip.state.as_ref())
    }
}

/// What the inventory says of the device that was asked for.
#[derive(Debug, PartialEq)]
pub(super) struct Found {
    pub id: String,
    pub name: String,
    pub grip: bool,
    /// What it lacks.
    pub notes: Vec<String>,
}

/// Finds the device of this id, or the first.
///
/// # Errors
/// It is not there, nor any, or the inventory can't be read.
pub(super) fn find(inventory: &str, id: Option<&str>) -> Result<Found, OpenError> {
    let message: Message = serde_json::from_str(inventory).map_err(|e| {
        error(format!("its inventory can't be read: {e}"), "this may be another service than Haply's")
    })?;
    let ids = || message.inverse3.iter().map(|d| d.device_id.as_ref()).collect::<Vec<_>>().join(", ");
    let Some(device) = message.inverse3.iter().find(|d| id.is_none_or(|id| d.device_id == id)) else {
        return Err(match id {
            Some(id) if !message.inverse3.is_empty() => {
                error(format!("there is no Inverse3 `{id}`"), &format!("name one that there is: {}", ids()))
            }
            _ => error("the service sees no Inverse3".into(), PLUG),
        });
    };
    let handedness = device.config.as_ref().and_then(|c| c.handedness.as_ref());
    let hand = handedness.map(|h| format!(", {h}")).unwrap_or_default();
    let name = format!("Haply Inverse3 {}{hand}", device.device_id);
    let status = device.status.as_ref();
    let told = |what: fn(&Status) -> Option<bool>, bad: bool, words: &str| {
        (status.and_then(what) == Some(bad)).then(|| words.to_owned())
    };
    let notes = [
        told(
            |s| s.calibrated,
            false,
            "it is not calibrated, and its positions may be wrong: calibrate it in the Haply Hub",
        ),
        told(|s| s.in_use, true, "another program uses it too: close that"),
        told(|s| s.power_supply, false, "its power supply is missing: it renders nothing; plug it in"),
    ];
    let notes = notes.into_iter().flatten().collect();
    Ok(Found { id: device.device_id.to_string(), name, grip: message.grip().is_some(), notes })
}

/// A state of one device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    pub position_m: [f64; 3],
    pub velocity_m_per_s: Option<[f64; 3]>,
    pub orientation: [f64; 4],
    pub buttons: u32,
    pub ready: bool,
}

impl Seen {
    /// Whether it was measured after `last`: what moves is not twice at the same place to the bit. What rests may be.
    pub fn is_new(&self, last: &Seen) -> bool {
        let moves = self.velocity_m_per_s.is_some_and(|v| v != [0.0; 3]);
        !moves || (self.position_m, self.velocity_m_per_s) != (last.position_m, last.velocity_m_per_s)
    }
}

/// Why a message holds no state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unseen {
    /// It can't be understood.
    Garbled,
    /// The device is not in it.
    Gone,
}

/// The state of the device `id`.
pub(super) fn state(text: &str, id: &str) -> Result<Seen, Unseen> {
    let message: Message = serde_json::from_str(text).map_err(|_| Unseen::Garbled)?;
    let device = message.inverse3.iter().find(|d| d.device_id == id).ok_or(Unseen::Gone)?;
    let state = device.state.as_ref().ok_or(Unseen::Garbled)?;
    let vector = |v: Vector| Axes::SAME.ours([v.x, v.y, v.z]);
    let position_m = vector(state.cursor_position.ok_or(Unseen::Garbled)?);
    let grip = message.grip();
    // A grip that sleeps sends no unit quaternion: that is no reason to stop.
    let turned =
        grip.and_then(|g| g.orientation).and_then(|q| Axes::SAME.orientation_of([q.w, q.x, q.y, q.z]));
    Ok(Seen {
        position_m,
        velocity_m_per_s: state.cursor_velocity.map(vector),
        orientation: turned.unwrap_or([1.0, 0.0, 0.0, 0.0]),
        buttons: grip.and_then(|g| g.buttons).map_or(0, Buttons::mask),
        ready: device.status.as_ref().and_then(|s| s.ready).unwrap_or(true),
    })
}

/// Writes the command into `to`: a force, N, or only the wish to know where it is.
pub(super) fn command(to: &mut String, id: &str, key: HaplyForceKey, force_n: Option<[f64; 3]>) {
    to.clear();
    let id = serde_json::Value::from(id);
    let key = match key {
        HaplyForceKey::Vector => "vector",
        HaplyForceKey::Values => "values",
    };
    let written = match force_n {
        None => write!(to, r#"{{"inverse3":[{{"device_id":{id},"commands":{{"probe_position":{{}}}}}}]}}"#),
        Some([x, y, z]) => write!(
            to,
            r#"{{"inverse3":[{{"device_id":{id},"commands":{{"set_cursor_force":{{"{key}":{{"x":{x},"y":{y},"z":{z}}}}}}}}}]}}"#
        ),
    };
    debug_assert!(written.is_ok(), "a string takes all");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_as_the_service_wants_them() {
        let mut text = String::new();
        command(&mut text, "049D", HaplyForceKey::Vector, Some([0.0, -0.5, 1e-7]));
        let expected = r#"{"inverse3":[{"device_id":"049D","commands":{"set_cursor_force":{"vector":{"x":0,"y":-0.5,"z":0.0000001}}}}]}"#;
        assert_eq!(text, expected);
        command(&mut text, "049D", HaplyForceKey::Values, Some([0.0; 3]));
        assert_eq!(text, expected.replace("vector", "values").replace("-0.5", "0").replace("0.0000001", "0"));
        command(&mut text, r#"a"b"#, HaplyForceKey::Vector, None);
        assert_eq!(text, r#"{"inverse3":[{"device_id":"a\"b","commands":{"probe_position":{}}}]}"#);
    }

    #[test]
    fn buttons_by_either_name() {
        let state = |grips: &str| {
            let device = r#"{"device_id":"1","state":{"cursor_position":{"x":0,"y":0,"z":0}}}"#;
            state(&format!(r#"{{"inverse3":[{device}],{grips}}}"#), "1").unwrap()
        };
        let old = r#""wireless_verse_grip":[{"state":{"buttons":{"a":true,"b":false,"c":true}}}]"#;
        assert_eq!(state(old).buttons, 0b101);
        let new = r#""wireless_verse_grip":[{"state":{"buttons":{"button_1":true,"button_3":true}}}]"#;
        assert_eq!(state(new).buttons, 0b1010);
        let one = r#""verse_grip":[{"state":{"orientation":{"w":0,"x":0,"y":0,"z":1},"button":true}}]"#;
        assert_eq!((state(one).buttons, state(one).orientation), (1, [0.0, 0.0, 0.0, 1.0]));
        let asleep = r#""verse_grip":[{"state":{"orientation":{"w":0,"x":0,"y":0,"z":0}}}]"#;
        assert_eq!(state(asleep).orientation, [1.0, 0.0, 0.0, 0.0]);
    }
}
