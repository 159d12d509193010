//! What can be chosen, and undone.

use crate::colouring::Colouring;
use crate::palette::Theme;
use crate::scene::{Marks, Section};
use palpate::Ablation;
use palpate::body::SlipRule;

/// All that undo brings back: how the body is shown, and how it is touched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// What colours show.
    pub colouring: Colouring,
    /// At which depth, m.
    pub colour_depth_m: f64,
    /// Cuts the body.
    pub section: Option<Section>,
    /// What is drawn besides.
    pub marks: Marks,
    /// Light or dark.
    pub theme: Theme,
    /// In place of the body's slip rule.
    pub slip: Option<SlipRule>,
    /// Whether the elements' frames are interpolated.
    pub coordinates: bool,
    /// Whether the elements' responses are interpolated.
    pub responses: bool,
    /// Whether slip is kept from giving out energy, if the body wants it.
    pub tank: bool,
    /// Whether there are two contact points side by side, if the body wants them.
    pub partial_slip: bool,
    /// Multiplies the friction coefficients.
    pub friction_scale: f64,
    /// Which device is simulated: one of `presets::DEVICES`.
    pub device: &'static str,
    /// Whose hand holds it: one of `presets::HANDS`.
    pub hand: &'static str,
    /// How deep the hand wants to press, m.
    pub press_depth_m: f64,
    /// The largest force, N.
    pub force_max_n: f64,
    /// Whether one hears how fast the force changes.
    pub sound: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            colouring: Colouring::default(),
            colour_depth_m: 4e-3,
            section: None,
            marks: Marks::default(),
            theme: Theme::default(),
            slip: None,
            coordinates: true,
            responses: true,
            tank: true,
            partial_slip: true,
            friction_scale: 1.0,
            device: "omega",
            hand: "fingers",
            press_depth_m: 5e-3,
            force_max_n: palpate::runtime::GENTLE_N,
            sound: false,
        }
    }
}

/// How deep a hand may want to press, m.
pub const DEPTHS_M: [f64; 2] = [0.5e-3, 50e-3];
/// What the largest force may be, N.
pub const FORCES_MAX_N: [f64; 2] = [0.1, 20.0];

impl Settings {
    /// Interpolations taken away.
    pub fn ablation(&self) -> Ablation {
        match (self.coordinates, self.responses) {
            (true, true) => Ablation::None,
            (false, true) => Ablation::Coordinates,
            (true, false) => Ablation::Responses,
            (false, false) => Ablation::Both,
        }
    }

    /// Whether a running session can't go over from these settings to others.
    pub fn session_wants_anew(&self, other: &Settings) -> bool {
        self.ablation() != other.ablation()
            || self.tank != other.tank
            || self.partial_slip != other.partial_slip
            || self.device != other.device
            || self.hand != other.hand
            || self.force_max_n != other.force_max_n
            || (other.slip.is_none() && self.slip.is_some())
    }

    /// With every number in its range.
    #[must_use]
    pub fn checked(mut self) -> Self {
        let within = |x: f64, [least, most]: [f64; 2], otherwise: f64| {
            if x.is_finite() { x.clamp(least, most) } else { otherwise }
        };
        let default = Settings::default();
        self.press_depth_m = within(self.press_depth_m, DEPTHS_M, default.press_depth_m);
        self.colour_depth_m = within(self.colour_depth_m, [0.0, DEPTHS_M[1]], default.colour_depth_m);
        self.friction_scale = within(self.friction_scale, [0.0, 100.0], 1.0);
        self.force_max_n = within(self.force_max_n, FORCES_MAX_N, default.force_max_n);
        if let Some(section) = &mut self.section {
            section.axis = section.axis.min(2);
            section.share = within(section.share, [0.0, 1.0], 0.5);
        }
        self
    }
}

/// What was chosen before, and what was undone.
#[derive(Debug, Clone, Default)]
pub struct Undo {
    before: Vec<Settings>,
    after: Vec<Settings>,
    /// When the last step was made, s, and what it changed: a slider that is dragged is one step.
    last: Option<(f64, Settings)>,
}

/// Steps that are remembered.
const STEPS: usize = 200;
/// Changes that follow each other within this are one step, s.
const ONE_STEP_S: f64 = 0.6;

impl Undo {
    /// Remembers a change from `before` to `now`.
    pub fn changed(&mut self, time_s: f64, before: Settings, now: Settings) {
        let goes_on = self.last.is_some_and(|(t, result)| time_s - t < ONE_STEP_S && result == before);
        if !(goes_on && is_slide(&before, &now)) {
            self.before.push(before);
            if self.before.len() > STEPS {
                self.before.remove(0);
            }
        }
        self.after.clear();
        self.last = is_slide(&before, &now).then_some((time_s, now));
    }

    /// What to go back to from `now`.
    pub fn undo(&mut self, now: Settings) -> Option<Settings> {
        let back = self.before.pop()?;
        self.after.push(now);
        self.last = None;
        Some(back)
    }

    /// What was undone last.
    pub fn redo(&mut self, now: Settings) -> Option<Settings> {
        let forth = self.after.pop()?;
        self.before.push(now);
        self.last = None;
        Some(forth)
    }

    /// Whether there is something to go back to, and something to go forth to.
    pub fn can(&self) -> [bool; 2] {
        [!self.before.is_empty(), !self.after.is_empty()]
    }
}

/// Whether only numbers differ, as while a slider is dragged.
fn is_slide(a: &Settings, b: &Settings) -> bool {
    let numbers = |s: &Settings| Settings {
        colour_depth_m: 0.0,
        section: s.section.map(|section| Section { share: 0.0, ..section }),
        friction_scale: 0.0,
        press_depth_m: 0.0,
        force_max_n: 0.0,
        ..*s
    };
    numbers(a) == numbers(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undo_goes_back_step_by_step_and_a_drag_is_one_step() {
        let mut undo = Undo::default();
        let first = Settings::default();
        let mut now = first;
        for (t, scale) in [(0.0, 1.1), (0.1, 1.2), (0.2, 1.3)] {
            let next = Settings { friction_scale: scale, ..now };
            undo.changed(t, now, next);
            now = next;
        }
        let dark = Settings { theme: Theme::Dark, ..now };
        undo.changed(0.3, now, dark);
        assert_eq!(undo.undo(dark), Some(now));
        assert_eq!(undo.undo(now), Some(first));
        assert_eq!((undo.undo(first), undo.can()), (None, [false, true]));
        assert_eq!(undo.redo(first), Some(now));
        assert_eq!(undo.redo(now), Some(dark));
        // A new change forgets what was undone.
        undo.undo(dark);
        undo.changed(9.0, now, first);
        assert_eq!(undo.redo(first), None);
    }

    #[test]
    fn numbers_stay_in_their_range() {
        let wild = Settings {
            press_depth_m: f64::NAN,
            friction_scale: -3.0,
            force_max_n: 1e9,
            section: Some(Section { axis: 9, share: 7.0, keeps_lower: false }),
            ..Settings::default()
        };
        let tame = wild.checked();
        assert_eq!((tame.press_depth_m, tame.friction_scale, tame.force_max_n), (5e-3, 0.0, 20.0));
        assert_eq!(tame.section.map(|s| (s.axis, s.share)), Some((2, 1.0)));
    }
}
