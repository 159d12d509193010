//! A state by command: where the tool presses, how deep, and how far it is dragged.

use crate::place;
use crate::settings::Settings;
use crate::shown::Shown;
use glam::DVec3;
use palpate::body::BodySource;
use palpate::{Body, Contact, ToolState};
use std::str::FromStr;

/// A press and a drag, as `--state` has them: `depth_mm=4 at_mm=0,0,30 drag_mm=5`, or `rest`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StateChoice {
    /// The surface point nearest to this is pressed, m; without it, the top.
    pub at_m: Option<DVec3>,
    /// How deep, m; nothing touches at 0. Infinite for half as deep as the body's curves go.
    pub depth_m: f64,
    /// How far it is dragged afterwards, m.
    pub drag_m: f64,
    /// Where to, in degrees about the normal, from the direction that lies flattest.
    pub drag_deg: f64,
}

impl StateChoice {
    /// At the top, half as deep as the body's curves go.
    pub const HALF_DEEP: StateChoice =
        StateChoice { at_m: None, depth_m: f64::INFINITY, drag_m: 0.0, drag_deg: 0.0 };
}

impl FromStr for StateChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut choice = StateChoice::default();
        if text.trim() == "rest" {
            return Ok(choice);
        }
        let refused = |word: &str| {
            format!(
                "`{word}` is no part of a state; give `rest`, or words such as depth_mm=4 at_mm=0,0,30 drag_mm=5 drag_deg=90"
            )
        };
        let number = |word: &str, value: &str, least: f64, most: f64| {
            let x = value.trim().parse::<f64>().ok().filter(|x| (least..=most).contains(x));
            x.ok_or_else(|| format!("{}: give numbers from {least} to {most}", refused(word)))
        };
        for word in text.split([' ', ';']).filter(|w| !w.is_empty()) {
            let (key, value) = word.split_once('=').ok_or_else(|| refused(word))?;
            match key {
                "depth_mm" => choice.depth_m = number(word, value, 0.0, 100.0)? * 1e-3,
                "drag_mm" => choice.drag_m = number(word, value, -500.0, 500.0)? * 1e-3,
                "drag_deg" => choice.drag_deg = number(word, value, -360.0, 360.0)?,
                "at_mm" => {
                    let parts: Vec<f64> =
                        value.split(',').map(|x| number(word, x, -1e5, 1e5)).collect::<Result<_, _>>()?;
                    let [x, y, z] = parts[..] else { return Err(refused(word)) };
                    choice.at_m = Some(DVec3::new(x, y, z) * 1e-3);
                }
                _ => return Err(refused(word)),
            }
        }
        Ok(choice)
    }
}

/// How far above the surface a press begins, m.
const ABOVE_M: f64 = 2e-3;
/// A step's way, m: what a hand at 0.1 m/s does in a millisecond.
const STEP_M: f64 = 1e-4;
/// Steps in all, at most.
const STEPS_MAX: f64 = 20_000.0;

/// The state, and the steps on the way to it. None at rest.
///
/// # Errors
/// The body has no surface there.
pub fn state(body: &Body, choice: &StateChoice, settings: &Settings) -> Result<Vec<Shown>, String> {
    if choice.depth_m <= 0.0 {
        return Ok(Vec::new());
    }
    let depth_m = if choice.depth_m.is_finite() { choice.depth_m } else { 0.5 * place::depth_range_m(body) };
    let near = match choice.at_m {
        Some(at) => at,
        None => palpate::runtime::motion::top(body).map_err(|e| palpate::files::message(&e))?,
    };
    let [point, into] = body.nearest(near).map_err(|e| e.to_string())?;
    let flat = |a: &DVec3| a.dot(into).abs();
    let axis = DVec3::AXES.into_iter().min_by(|a, b| flat(a).total_cmp(&flat(b))).unwrap_or(DVec3::X);
    let along = (axis - into * axis.dot(into)).normalize();
    let (sin, cos) = choice.drag_deg.to_radians().sin_cos();
    let along = along * cos + into.cross(along) * sin;
    let radius = body.tool().radius_m();
    let at = |depth: f64, way: f64| point + into * (depth - radius) + along * way;
    let corners = [at(-ABOVE_M, 0.0), at(depth_m, 0.0), at(depth_m, choice.drag_m)];
    let rule = settings.slip.unwrap_or(body.slip());
    let mut contact = Contact::with_slip(body, rule, settings.ablation())
        .with_tank(body.has_tank() && settings.tank)
        .with_partial_slip(body.has_partial_slip() && settings.partial_slip);
    contact.set_friction_scale(settings.friction_scale);
    let (mut states, mut time_s) = (Vec::new(), 0.0);
    for pair in corners.windows(2) {
        let steps = (pair[0].distance(pair[1]) / STEP_M).ceil().min(STEPS_MAX);
        for k in 0..=steps as u32 {
            let share = if steps > 0.0 { f64::from(k) / steps } else { 1.0 };
            let tool = ToolState::at(pair[0].lerp(pair[1], share).to_array());
            let output = contact.step(body, &tool, 1e-3);
            time_s += 1e-3;
            states.push(Shown::of_step(time_s, tool, &output, &contact));
        }
    }
    Ok(states)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gallery::Example;

    #[test]
    fn a_command_says_where_how_deep_and_how_far() {
        let read = |text: &str| text.parse::<StateChoice>();
        assert_eq!(read("rest"), Ok(StateChoice::default()));
        let choice = read("depth_mm=4 at_mm=0,-1.5,30; drag_mm=-5 drag_deg=90").unwrap();
        assert!((choice.depth_m - 4e-3).abs() < 1e-12 && (choice.drag_m + 5e-3).abs() < 1e-12);
        assert!(choice.at_m.unwrap().distance(DVec3::new(0.0, -1.5e-3, 30e-3)) < 1e-12);
        for wrong in
            ["deep", "depth_mm", "depth_mm=x", "depth_mm=-1", "at_mm=1,2", "depth_mm=nan", "colour=red"]
        {
            assert!(read(wrong).unwrap_err().contains("depth_mm=4"), "{wrong}");
        }
    }

    #[test]
    fn a_state_is_as_deep_as_it_says() {
        let body = Example::Pad.make().unwrap();
        let choice = StateChoice { depth_m: 4e-3, drag_m: 2e-3, ..StateChoice::default() };
        let states = state(&body, &choice, &Settings::default()).unwrap();
        let contact = states.last().unwrap().contact.unwrap();
        assert!((contact.delta_z_m - 4e-3).abs() < 3e-4, "{contact:?}");
        assert!(contact.delta_r_m > 5e-4 && states.len() > 50);
        assert_eq!(state(&body, &StateChoice::default(), &Settings::default()), Ok(Vec::new()));
    }
}
