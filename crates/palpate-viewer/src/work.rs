//! Work that takes time, on threads of its own: opening files, simulating, bounding. The window asks for what has come of it.

use crate::gallery::{BALL_SPEC, Example};
use crate::playback::Playback;
use palpate::Body;
use palpate::build::Progress;
use palpate::build::precompute::{Stopped, body_of_spec};
use palpate::engine::certify::{Assumptions, Bounds, Criterion, Effort, ElementStates, frictions, least};
use palpate::runtime::{BodyFile, SessionBody};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

/// What came of it.
#[derive(Debug)]
pub enum Done {
    /// A body to be shown.
    Body(Box<Opened>),
    /// A recording of the body that is shown.
    Recording(Box<Playback>),
    /// It did not work: one message that says what to do.
    Failed(String),
    /// It was cancelled; what is finished is kept where it says.
    Cancelled(String),
}

/// A body that was opened or made.
#[derive(Debug)]
pub struct Opened {
    /// It.
    pub body: Arc<Body>,
    /// What it is called.
    pub name: String,
    /// Its file, as recordings name it; empty for one that has none.
    pub file: BodyFile,
}

impl Opened {
    /// The body at `path`.
    ///
    /// # Errors
    /// It can't be read, or is no body, in words.
    pub fn read(path: &Path) -> Result<Self, String> {
        let open = || Body::open(path).map_err(anyhow::Error::from);
        let (body, file) = BodyFile::read_with(path, true, open).map_err(|e| palpate::files::message(&e))?;
        Ok(Opened { body: Arc::new(body), name: file.name.clone(), file })
    }

    /// As sessions want it.
    pub fn session_body(&self) -> SessionBody {
        SessionBody { source: self.body.clone(), file: self.file.clone() }
    }
}

/// How far a simulation is.
#[derive(Debug, Default)]
pub struct Meter {
    points: AtomicUsize,
    done: AtomicUsize,
    notes: Mutex<Vec<String>>,
}

impl Meter {
    /// (done, of), test points; of 0 as long as nobody knows.
    pub fn read(&self) -> (usize, usize) {
        (self.done.load(Ordering::Relaxed), self.points.load(Ordering::Relaxed))
    }

    /// What deserved to be said.
    pub fn notes(&self) -> Vec<String> {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Progress for Meter {
    fn begin(&self, points: usize, before: usize) {
        self.points.store(points, Ordering::Relaxed);
        self.done.store(before, Ordering::Relaxed);
    }

    fn done(&self, _paths: usize) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    fn note(&self, message: &str) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(message.into());
    }
}

/// What is done meanwhile.
#[derive(Debug)]
pub struct Work {
    /// In words: "Opening liver.body".
    pub title: String,
    /// Of a simulation.
    pub meter: Arc<Meter>,
    /// Whether it can be cancelled.
    pub can_cancel: bool,
    cancelled: Arc<AtomicBool>,
    done: Receiver<Done>,
}

impl Work {
    fn start(
        title: String,
        can_cancel: bool,
        work: impl FnOnce(&Meter, &AtomicBool) -> Done + Send + 'static,
    ) -> Self {
        let (sender, done) = channel();
        let (meter, cancelled) = (Arc::new(Meter::default()), Arc::new(AtomicBool::new(false)));
        let (its_meter, its_flag) = (meter.clone(), cancelled.clone());
        let failed = sender.clone();
        let started = thread::Builder::new().name("viewer-work".into()).spawn(move || {
            // Who asked may be gone by now.
            let _ = sender.send(work(&its_meter, &its_flag));
        });
        if let Err(e) = started {
            let _ = failed
                .send(Done::Failed(format!("{title}: the system gives no thread ({e}); close something")));
        }
        Work { title, meter, can_cancel, cancelled, done }
    }

    /// Opens a body's file.
    pub fn open_body(path: PathBuf) -> Self {
        Work::start(format!("Opening {}", name_of(&path)), false, move |_, _| match Opened::read(&path) {
            Ok(opened) => Done::Body(Box::new(opened)),
            Err(e) => Done::Failed(e),
        })
    }

    /// Reads a recording that must be of this body.
    pub fn read_recording(path: PathBuf, body: BodyFile) -> Self {
        Work::start(format!("Reading {}", name_of(&path)), false, move |_, _| match Playback::read(&path) {
            Err(e) => Done::Failed(e),
            Ok(playback) => match mismatch(&playback.header.body, &body) {
                Some(problem) => Done::Failed(format!("{}: {problem}", path.display())),
                None => Done::Recording(Box::new(playback)),
            },
        })
    }

    /// Makes an example.
    pub fn make_example(example: Example) -> Self {
        let title = format!("Making: {}", example.title());
        Work::start(title, example == Example::Ball, move |meter, cancelled| {
            let made = match example {
                Example::Ball => simulated_ball(meter, cancelled),
                _ => example.make().map_err(|e| Done::Failed(e.to_string())),
            };
            let opened = |body: Body| Opened {
                body: body.into(),
                name: example.title().into(),
                file: BodyFile::default(),
            };
            made.map_or_else(|done| done, |body| Done::Body(Box::new(opened(body))))
        })
    }

    /// Makes the body of a spec; `folder` keeps what is finished and gets the body.
    pub fn make_of_spec(spec: PathBuf, folder: PathBuf) -> Self {
        let title = format!("Simulating {}", name_of(&spec));
        Work::start(title, true, move |meter, cancelled| {
            let body = match body_of_spec(&spec, Some(&folder), cores(), meter, cancelled) {
                Ok(body) => body,
                Err(stopped) => return told(stopped, &folder),
            };
            let file = folder.join(format!("{}.body", stem_of(&spec)));
            match body.save(&file).map_err(|e| e.to_string()).and_then(|()| Opened::read(&file)) {
                Ok(opened) => Done::Body(Box::new(opened)),
                Err(e) => Done::Failed(e),
            }
        })
    }

    /// Asks for the end.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether that was asked for.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// What came of it, if it is over.
    pub fn take(&self) -> Option<Done> {
        self.done.try_recv().ok()
    }

    /// Waits for what comes of it.
    pub fn wait(&self) -> Done {
        self.done.recv().unwrap_or_else(|_| Done::Failed(format!("{}: it ended without a word", self.title)))
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        self.cancel();
    }
}

fn told(stopped: Stopped, folder: &Path) -> Done {
    match stopped {
        Stopped::Error(e) => Done::Failed(palpate::files::message(&e)),
        Stopped::Cancelled { done, of } => Done::Cancelled(format!(
            "{done} of {of} test points are kept in {}: make it again, and it goes on from there",
            folder.display()
        )),
    }
}

/// In a folder that goes with it: it takes half a minute, and begins anew where it was cancelled.
fn simulated_ball(meter: &Meter, cancelled: &AtomicBool) -> Result<Body, Done> {
    let failed = |e: io::Error| Done::Failed(format!("a folder for temporary files: {e}; set TMPDIR"));
    let folder = tempfile::tempdir().map_err(failed)?;
    let spec = folder.path().join("ball.toml");
    std::fs::write(&spec, BALL_SPEC).map_err(failed)?;
    body_of_spec(&spec, Some(folder.path()), cores(), meter, cancelled).map_err(|stopped| match stopped {
        Stopped::Error(e) => Done::Failed(palpate::files::message(&e)),
        Stopped::Cancelled { .. } => Done::Cancelled("The ball is made anew when it is chosen again.".into()),
    })
}

fn cores() -> usize {
    // One is left to the window.
    thread::available_parallelism().map_or(1, |n| n.get().saturating_sub(1).max(1))
}

/// Why a recording of one body can't be shown on another.
fn mismatch(recorded: &BodyFile, shown: &BodyFile) -> Option<String> {
    // Examples, and bodies that were made in memory, have no digest, and no recording that has one is of them.
    (recorded.sha256 != shown.sha256).then(|| {
        format!(
            "it was recorded on another body, `{}`: open that one first, then the recording",
            recorded.name
        )
    })
}

/// A file's name without its folder.
pub fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// A file's name without folder and extension.
pub fn stem_of(path: &Path) -> String {
    path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Bounds of the certificate of passivity, element by element, as they come.
#[derive(Debug)]
pub struct Certificate {
    bounds: Arc<Mutex<Vec<Bounds>>>,
    cancelled: Arc<AtomicBool>,
    /// Where the system gave one.
    thread: io::Result<JoinHandle<()>>,
    /// For which settings.
    pub assumptions: Assumptions,
}

/// Evaluations of a bound for each element: enough for a picture; `palpate certify` takes longer and decides more.
const EVALUATIONS: u32 = 400;

impl Certificate {
    /// Begins to bound a body's elements.
    pub fn start(body: Arc<Body>, assumptions: Assumptions) -> Self {
        let bounds = Arc::new(Mutex::new(Vec::new()));
        let cancelled = Arc::new(AtomicBool::new(false));
        let (its_bounds, its_flag) = (bounds.clone(), cancelled.clone());
        let thread = thread::Builder::new().name("viewer-certificate".into()).spawn(move || {
            for element in 0..body.elements().len() as u32 {
                if its_flag.load(Ordering::Relaxed) {
                    return;
                }
                let effort = Effort { evaluations: EVALUATIONS, absolute: 0.01, relative: 0.1 };
                let each = frictions(&body).iter().map(|&friction| {
                    let states = ElementStates::new(&body, element, &assumptions.with_friction(friction));
                    least(Criterion::Passive, &states, &states.cells(), effort)
                });
                let bound = each.reduce(Bounds::worse);
                its_bounds.lock().unwrap_or_else(PoisonError::into_inner).extend(bound);
            }
        });
        Certificate { bounds, cancelled, thread, assumptions }
    }

    /// Of the first elements, as far as they are known.
    pub fn bounds(&self) -> Vec<Bounds> {
        self.bounds.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// How many are known.
    pub fn len(&self) -> usize {
        self.bounds.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether no more will come.
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().map_or(true, JoinHandle::is_finished)
    }

    /// Why none will come, if it can't be begun.
    pub fn trouble(&self) -> Option<String> {
        let e = self.thread.as_ref().err()?;
        Some(format!(
            "Not bounded: the system gives no thread ({e}); close something, and choose the colouring again."
        ))
    }
}

impl Drop for Certificate {
    fn drop(&mut self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }
}
