//! Certificates of a body.

use crate::body::slip_rule;
use crate::errors::{CancelledError, argument};
use crate::interrupt::interruptible;
use crate::progress::{Progress, hearer};
use palpate::certify::device::Device;
use palpate::certify::{Question, certify_on};
use palpate::device::presets;
use palpate::{Body, files};
use pyo3::prelude::*;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Sender;
use std::sync::{Mutex, PoisonError};

/// What `Body.certify` was given of a device.
pub struct Loop<'a> {
    pub device: Option<&'a str>,
    pub rate_hz: Option<f64>,
    pub damping_n_s_per_m: Option<f64>,
    pub position_error_m: Option<f64>,
    pub coulomb_n: Option<f64>,
    pub delay_samples: Option<f64>,
}

impl Loop<'_> {
    /// A named device's figures, with those in their place that are given.
    fn device(&self) -> PyResult<Option<Device>> {
        let rate_hz = self.rate_hz.unwrap_or(1000.0);
        let named = match (self.device, self.damping_n_s_per_m) {
            (Some(name), _) => {
                let known = presets::device(name).ok_or_else(|| {
                    argument(format!("device is {name:?}; give one of {}", presets::DEVICES.join(", ")))
                })?;
                Device::of(&known.mechanics, rate_hz)
            }
            (None, Some(damping_n_s_per_m)) => Device {
                damping_n_s_per_m,
                rate_hz,
                position_error_m: 0.0,
                coulomb_n: 0.0,
                delay_samples: 0.0,
            },
            (None, None) => {
                let lone = [self.rate_hz, self.position_error_m, self.coulomb_n, self.delay_samples];
                if lone.iter().any(Option::is_some) {
                    return Err(argument(
                        "rate_hz, position_error_m, coulomb_n and delay_samples are of a device; give device or \
                         damping_n_s_per_m, too",
                    ));
                }
                return Ok(None);
            }
        };
        Ok(Some(Device {
            damping_n_s_per_m: self.damping_n_s_per_m.unwrap_or(named.damping_n_s_per_m),
            position_error_m: self.position_error_m.unwrap_or(named.position_error_m),
            coulomb_n: self.coulomb_n.unwrap_or(named.coulomb_n),
            delay_samples: self.delay_samples.unwrap_or(named.delay_samples),
            ..named
        }))
    }
}

/// For which motions, and with how much effort.
pub struct Asked<'a> {
    pub slip_rule: Option<&'a str>,
    pub step_m: f64,
    pub depth_m: Option<f64>,
    pub evaluations: Option<u32>,
    pub window: bool,
    pub device: Loop<'a>,
    pub threads: usize,
}

pub fn certify<'py>(
    py: Python<'py>,
    body: &Body,
    asked: &Asked<'_>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut question = Question::of(body);
    question.assumptions.slip = slip_rule(asked.slip_rule, body)?;
    question.assumptions.step_m = asked.step_m;
    question.assumptions.depth_m = asked.depth_m;
    question.evaluations = asked.evaluations;
    question.window = asked.window;
    question.device = asked.device.device()?;
    let (threads, total, done) = (asked.threads, body.elements().len(), Mutex::new(0));
    let work = |sender: Sender<Progress>, cancelled: &AtomicBool| {
        let count = || {
            // Under the lock, so that what is heard only grows.
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            // Whoever does not listen any more has ended the work.
            let _ = sender.send(Progress { done: *done, total, message: None });
        };
        certify_on(threads, body, &question, &count, cancelled)
    };
    let found = interruptible(py, work, hearer(progress))?.map_err(|e| argument(files::message(&e)))?;
    let found = found.ok_or_else(|| CancelledError::new_err("ended before all elements were looked at"))?;
    crate::python_of(py, &found.certificate)
}
