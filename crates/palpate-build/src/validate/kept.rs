//! Simulated paths, kept in a file: a trial that was stopped goes on, and another body is judged by the same paths at no cost.
//!
//! One line of JSON for each path, written as soon as the path is done; a line that is not whole is passed over. A line's key is a
//! digest of all that the path depends on, so that no path of another spec, mesh or plan is taken for it.

use super::{SimulatedSurface, Simulator};
use anyhow::Result;
use glam::DVec3;
use palpate_files as files;
use palpate_simulate::{FreePlan, Path as LoadPath, PointPaths, PointPlan, State, Stop};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// A simulator that first looks into a file for what it is asked, and writes there what it had to simulate.
pub struct Kept<'a> {
    simulator: &'a dyn Simulator,
    /// Of the spec and its files.
    model: String,
    found: HashMap<String, Vec<Line>>,
    path: PathBuf,
    /// The file, and what could not be written.
    out: Mutex<(File, Option<std::io::Error>)>,
}

#[derive(Serialize, Deserialize)]
struct Entry {
    key: String,
    paths: Vec<Line>,
}

/// A load path without displacements.
#[derive(Serialize, Deserialize, Clone)]
struct Line {
    states: Vec<Row>,
    stopped: Option<(f64, String)>,
    halved: Option<f64>,
}

/// As [`State`] has them.
#[derive(Serialize, Deserialize, Clone)]
struct Row {
    depth_m: f64,
    distance_m: f64,
    force_n: [f64; 3],
    torque_n_m: [f64; 3],
    patch_m2: f64,
    pressed_n: f64,
    slipping: f64,
    indefinite: bool,
    iterations: u32,
}

impl<'a> Kept<'a> {
    /// Opens or makes the file, for paths of a spec with this text and these files that it names.
    ///
    /// # Errors
    /// A file that can't be read or written.
    pub fn open(simulator: &'a dyn Simulator, path: &Path, spec: &str, inputs: &[PathBuf]) -> Result<Self> {
        let mut hash = Sha256::new();
        hash.update(concat!(env!("CARGO_PKG_VERSION"), "\n"));
        hash.update(spec);
        for input in inputs {
            hash.update(files::sha256(input)?);
        }
        let unwritable = |e: std::io::Error| files::unwritable(path, &e);
        let mut file =
            OpenOptions::new().read(true).append(true).create(true).open(path).map_err(unwritable)?;
        let mut text = Vec::new();
        file.read_to_end(&mut text).map_err(|e| files::unreadable(path, &e))?;
        if text.last().is_some_and(|last| *last != b'\n') {
            // Stopped while it wrote: the next line begins on its own.
            file.seek(SeekFrom::End(0)).and_then(|_| file.write_all(b"\n")).map_err(unwritable)?;
        }
        let entries =
            text.split(|b| *b == b'\n').filter_map(|line| serde_json::from_slice::<Entry>(line).ok());
        Ok(Kept {
            simulator,
            model: files::hex(&hash.finalize()),
            found: entries.map(|e| (e.key, e.paths)).collect(),
            path: path.to_owned(),
            out: Mutex::new((file, None)),
        })
    }

    /// What could not be written, if anything: paths are then simulated anew the next time.
    ///
    /// # Errors
    /// That.
    pub fn finish(self) -> Result<()> {
        match self.out.into_inner().unwrap_or_else(PoisonError::into_inner).1 {
            Some(e) => Err(files::unwritable(&self.path, &e)),
            None => Ok(()),
        }
    }

    /// Debug's digits of a number are those that give the number back.
    fn key(&self, what: &str, plan: &dyn std::fmt::Debug) -> String {
        files::hex(&Sha256::digest(format!("{}\n{what}\n{plan:?}", self.model)))
    }

    fn keep(&self, key: String, paths: &[&LoadPath]) {
        let entry = Entry { key, paths: paths.iter().map(|p| Line::of(p)).collect() };
        let mut out = self.out.lock().unwrap_or_else(PoisonError::into_inner);
        let (file, failed) = &mut *out;
        let written = serde_json::to_vec(&entry).map_err(std::io::Error::from).and_then(|mut line| {
            // After what could not be written whole the next line begins anew.
            if failed.is_some() {
                line.insert(0, b'\n');
            }
            line.push(b'\n');
            file.write_all(&line)
        });
        if let Err(e) = written {
            failed.get_or_insert(e);
        }
    }
}

impl Simulator for Kept<'_> {
    fn press(&self, plan: &PointPlan, sticking: bool) -> Option<PointPaths> {
        let key = self.key(if sticking { "stick" } else { "press" }, plan);
        if let Some([press, drags @ ..]) = self.found.get(&key).map(Vec::as_slice) {
            return Some(PointPaths { press: press.path(), drags: drags.iter().map(Line::path).collect() });
        }
        let paths = self.simulator.press(plan, sticking)?;
        self.keep(key, &std::iter::once(&paths.press).chain(&paths.drags).collect::<Vec<_>>());
        Some(paths)
    }

    fn follow(&self, plan: &FreePlan) -> Option<LoadPath> {
        let key = self.key("free", plan);
        if let Some([path]) = self.found.get(&key).map(Vec::as_slice) {
            return Some(path.path());
        }
        let path = self.simulator.follow(plan)?;
        self.keep(key, &[&path]);
        Some(path)
    }

    fn surface(&self) -> SimulatedSurface {
        self.simulator.surface()
    }

    /// Its tangents are not kept, so the potential of a place is simulated anew.
    fn own_paths(&self, plan: &PointPlan) -> Option<PointPaths> {
        self.simulator.own_paths(plan)
    }

    fn own_plan(&self, point: DVec3, inward: DVec3) -> Option<PointPlan> {
        self.simulator.own_plan(point, inward)
    }
}

impl Line {
    fn of(path: &LoadPath) -> Self {
        let row = |s: &State| Row {
            depth_m: s.depth_m,
            distance_m: s.distance_m,
            force_n: s.force_n.to_array(),
            torque_n_m: s.torque_n_m.to_array(),
            patch_m2: s.patch_m2,
            pressed_n: s.pressed_n,
            slipping: s.slipping,
            indefinite: s.indefinite,
            iterations: s.iterations,
        };
        Line {
            states: path.states.iter().map(row).collect(),
            stopped: path.stopped.as_ref().map(|s| (s.at_m, s.why.clone())),
            halved: path.halved,
        }
    }

    fn path(&self) -> LoadPath {
        let state = |r: &Row| State {
            depth_m: r.depth_m,
            distance_m: r.distance_m,
            force_n: DVec3::from_array(r.force_n),
            torque_n_m: DVec3::from_array(r.torque_n_m),
            patch_m2: r.patch_m2,
            pressed_n: r.pressed_n,
            slipping: r.slipping,
            indefinite: r.indefinite,
            iterations: r.iterations,
            ..State::default()
        };
        LoadPath {
            states: self.states.iter().map(state).collect(),
            stopped: self.stopped.as_ref().map(|(at_m, why)| Stop { at_m: *at_m, why: why.clone() }),
            halved: self.halved,
        }
    }
}
