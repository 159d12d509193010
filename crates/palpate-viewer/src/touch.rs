//! The mouse as a tool: a session on a simulated device whose hand is led.
//!
//! The haptic thread knows nothing of the window. What is shown comes from the session's board, where the thread writes its
//! record whether somebody reads or not; where the mouse points goes to a [`Lead`], which the simulated hand follows. The hand is
//! a spring: the tool lags by the force over its stiffness, so that stiffness is seen.

use crate::settings::Settings;
use crate::speaker::Speaker;
use glam::DVec3;
use palpate::device::simulated::{Lead, figures};
use palpate::device::{Simulated, presets};
use palpate::runtime::{
    ClockChoice, Controls, History, LiveSession, Outcome, Patience, PreparedSession, RealTime, Record,
    Safety, SessionBody, SessionConfig, WorkspaceSettings,
};
use std::path::PathBuf;

/// Periods a second that panels get, and for how long, s.
pub const HISTORY: History = History { rate_hz: 200.0, seconds: 12.0 };
/// Nobody feels a simulated device: a machine that is late need not bring its force to zero before so long, s.
const SILENCE_S: f64 = 0.1;

/// A session that is watched, and perhaps led.
#[derive(Debug)]
pub struct Touch {
    session: LiveSession,
    /// Of a hand that the mouse leads; `None` where a device or a motion script moves the tool.
    pub lead: Option<Lead>,
    /// The hand's stiffness, N/m; 0 where it is not known.
    pub hand_n_per_m: f64,
    is_paused: bool,
    stopped: bool,
    /// Plays how fast the force changes.
    speaker: Option<Speaker>,
}

impl Touch {
    /// A session with the mouse as tool, on `body`, with the hand beginning at `at`, m in the body's frame; recorded into a file
    /// that is not there yet, or not.
    ///
    /// # Errors
    /// What the session refuses, in words.
    pub fn led(
        body: &SessionBody,
        settings: &Settings,
        at: DVec3,
        record: Option<PathBuf>,
    ) -> Result<Self, String> {
        let name = settings.device;
        let capabilities = presets::device(name)
            .ok_or_else(|| format!("{name}: give one of {}", presets::DEVICES.join(", ")))?;
        let (hand, _) = presets::hand(settings.hand)
            .ok_or_else(|| format!("hand {}: give one of {}", settings.hand, presets::HANDS.join(", ")))?;
        figures::check(&capabilities, &hand)
            .map_err(|e| format!("{} in this hand: {e}", capabilities.name))?;
        if hand.stiffness_n_per_m == 0.0 {
            return Err(format!("a hand that is {} can't be led; choose another hand", settings.hand));
        }
        let lead = Lead::new(at.to_array());
        let device = Simulated::new(capabilities, hand, Box::new(lead.motion()));
        let config = SessionConfig {
            slip: settings.slip,
            tank: settings.tank,
            partial_slip: settings.partial_slip,
            friction_scale: settings.friction_scale,
            ablation: settings.ablation(),
            clock: ClockChoice::Real,
            safety: Safety {
                force_max_n: Some(settings.force_max_n),
                silence_s: Some(SILENCE_S),
                soft_start_s: 0.2,
                ..Safety::default()
            },
            // The device's frame is the body's.
            workspace: WorkspaceSettings { offset_m: Some([0.0; 3]), ..WorkspaceSettings::default() },
            patience: Patience { late_s: 10.0, finder_s: 30.0, ..Patience::default() },
            // The window wants the machine too, and nobody feels a simulated device.
            real_time: RealTime { priority: None, core: None, lock_memory: false, spin_s: 0.0 },
            history: HISTORY,
            record,
            ..SessionConfig::default()
        };
        let prepared = PreparedSession::with_device(body.clone(), Box::new(device), config, None);
        let session = prepared.and_then(PreparedSession::start).map_err(|e| e.to_string())?;
        Ok(Touch {
            session,
            lead: Some(lead),
            hand_n_per_m: hand.stiffness_n_per_m,
            is_paused: false,
            stopped: false,
            speaker: None,
        })
    }

    /// A session that is watched only.
    ///
    /// # Errors
    /// What the session refuses when it is started, in words.
    pub fn watched(session: PreparedSession) -> Result<Self, String> {
        let session = session.start().map_err(|e| e.to_string())?;
        Ok(Touch { session, lead: None, hand_n_per_m: 0.0, is_paused: false, stopped: false, speaker: None })
    }

    /// The latest period.
    pub fn latest(&self) -> Option<Record> {
        self.session.latest()
    }

    /// The past, thinned out, the oldest first.
    pub fn history(&self) -> Vec<Record> {
        self.session.history()
    }

    /// Percentiles and counts so far.
    pub fn summary(&self) -> palpate::runtime::Summary {
        self.session.summary()
    }

    /// The session.
    pub fn session(&self) -> &LiveSession {
        &self.session
    }

    /// To steer it.
    pub fn controls(&self) -> &Controls {
        self.session.controls()
    }

    /// Changes what can be changed without another session; false where another one must be begun.
    ///
    /// # Errors
    /// What the session refuses, in words.
    pub fn steer(&mut self, before: &Settings, now: &Settings) -> Result<bool, String> {
        if before.session_wants_anew(now) {
            return Ok(false);
        }
        if now.friction_scale != before.friction_scale {
            self.session.controls().set_friction_scale(now.friction_scale).map_err(|e| e.to_string())?;
        }
        if now.slip != before.slip
            && let Some(rule) = now.slip
        {
            self.session.set_slip_rule(rule).map_err(|e| e.to_string())?;
        }
        Ok(true)
    }

    /// Lets its sound be heard, or not.
    ///
    /// # Errors
    /// There is no loudspeaker, in words.
    pub fn hear(&mut self, hears: bool) -> Result<(), String> {
        match (hears, &self.speaker) {
            (true, None) => self.speaker = Some(Speaker::of(&self.session)?),
            (false, Some(_)) => {
                self.session.listen(None);
                self.speaker = None;
            }
            _ => {}
        }
        Ok(())
    }

    /// Leads the hand, m in the body's frame.
    pub fn lead_to(&self, target_m: DVec3) {
        if let Some(lead) = &self.lead {
            lead.set(target_m.to_array());
        }
    }

    /// Asks for the end: zero force within two periods, and a closed device.
    pub fn stop(&mut self) {
        self.session.stopper().stop("stopped in the viewer");
        self.stopped = true;
    }

    /// Whether [`Touch::stop`] was called.
    pub fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// No force until it is called again with `false`.
    pub fn pause(&mut self, pause: bool) {
        if pause {
            self.controls().pause()
        } else {
            self.controls().resume()
        }
        self.is_paused = pause;
    }

    /// Whether it is paused.
    pub fn is_paused(&self) -> bool {
        self.is_paused
    }

    /// Whether the loop has ended, asked or not.
    pub fn is_over(&self) -> bool {
        self.session.is_over()
    }

    /// Stops, waits for the end, and tells it.
    pub fn end(self) -> Outcome {
        self.session.stopper().stop("the viewer was closed");
        self.session.join()
    }
}
