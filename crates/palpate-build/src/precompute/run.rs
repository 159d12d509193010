//! The run: every test point once, whatever happens meanwhile.
//!
//! A finished point is a file of its own in `OUTPUT.partial/`, renamed into place when it is whole. So a run that was
//! killed loses the points in flight, no more; and since a point's paths depend on nothing but the plan, the merged
//! record has the same bytes however often the run was broken, and on however many threads or machines it was done.

use super::stops;
use super::workspace::Workspace;
use crate::Progress;
use crate::paths_file::{PathsPlan, PathsRecord, Point, Scene, TestPoint};
use anyhow::{Result, anyhow, bail};
use palpate_simulate::PointPaths;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// What finds a test point's load paths.
pub trait PointSolver: Sync {
    /// The same for the same point, whatever runs beside; `None` if `cancelled` came true meanwhile.
    fn simulate(&self, point: &TestPoint, cancelled: &AtomicBool) -> Option<PointPaths>;
}

/// All that a run needs.
pub struct Prepared<S> {
    /// What the points share.
    pub scene: Scene,
    /// All test points of the plan, or those to begin with.
    pub points: Vec<TestPoint>,
    /// What finds their paths.
    pub solver: S,
    /// Where test points are added in rounds.
    pub rounds: Option<Rounds>,
}

/// How test points are added to those that are done.
pub struct Rounds {
    /// So many in all, at most.
    pub most: usize,
    /// The next ones, from the paths of all so far and from nothing else; none when they are enough.
    pub next: Box<NextPoints>,
}

/// From the points that are done, by index, to the next ones.
pub type NextPoints = dyn Fn(&BTreeMap<u32, Point>) -> Result<Vec<TestPoint>> + Sync;

/// A share of the test points: those whose index is `number` − 1, modulo `of`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 1.
    pub number: u32,
    /// How many shards there are.
    pub of: u32,
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((number, of)) if number >= 1 && number <= of => Ok(Shard { number, of }),
            _ => Err("give I/N with I from 1 to N, e.g. 1/4".into()),
        }
    }
}

/// How to run.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The record to write.
    pub record: PathBuf,
    /// The folder that finished points are kept in meanwhile.
    pub partial: PathBuf,
    /// Threads.
    pub jobs: usize,
    /// Whether to go on with what is there.
    pub resume: bool,
    /// Which points; all without.
    pub shard: Option<Shard>,
}

/// Why there is no record yet.
#[derive(Debug)]
pub enum Stopped {
    /// Cancelled; finished points are kept.
    Cancelled {
        /// So many.
        done: usize,
        /// Of so many.
        of: usize,
    },
    /// Something is wrong.
    Error(anyhow::Error),
}

impl<E: Into<anyhow::Error>> From<E> for Stopped {
    fn from(error: E) -> Self {
        Stopped::Error(error.into())
    }
}

/// Runs what is left of `plan`, tells `progress`, and writes the whole record. The folder of finished points stays until
/// [`Workspace::finish`].
///
/// # Errors
/// See [`Stopped`]. Whatever was finished is kept.
pub fn run<S: PointSolver>(
    plan: &PathsPlan,
    options: &Options,
    prepare: impl FnOnce() -> Result<Prepared<S>>,
    progress: &dyn Progress,
    cancelled: &AtomicBool,
) -> Result<(PathsRecord, Workspace), Stopped> {
    let workspace = Workspace::open(plan, options)?;
    let mut prepared = prepare()?;
    if prepared.rounds.is_some() && options.shard.is_some() {
        return Err(anyhow!(
            "where each test point belongs follows from those before it (tolerance_percent): they can't be divided into shards; \
             run without --shard, or give count alone"
        )
        .into());
    }
    let mut points = BTreeMap::new();
    loop {
        let some = round(plan, options, &workspace, &prepared, points, progress, cancelled)?;
        let of = mine(&prepared, options).len();
        if some.len() < of {
            return Err(Stopped::Cancelled { done: some.len(), of });
        }
        points = some;
        let next = prepared.rounds.as_ref().map_or(Ok(Vec::new()), |rounds| (rounds.next)(&points))?;
        if next.is_empty() {
            break;
        }
        prepared.points.extend(next);
    }
    let total = prepared.points.len() as u32;
    let record = PathsRecord { plan: plan.clone(), total, scene: Some(prepared.scene), points };
    record.save(&options.record)?;
    Ok((record, workspace))
}

/// The points that this run is to find, as far as they are known.
fn mine<S>(prepared: &Prepared<S>, options: &Options) -> Vec<u32> {
    let total = prepared.points.len() as u32;
    match options.shard {
        Some(Shard { number, of }) => (0..total).filter(|i| i % of == number - 1).collect(),
        None => (0..total).collect(),
    }
}

/// All of the points that are known, as far as it gets; `points` are there already.
fn round<S: PointSolver>(
    plan: &PathsPlan,
    options: &Options,
    workspace: &Workspace,
    prepared: &Prepared<S>,
    mut points: BTreeMap<u32, Point>,
    progress: &dyn Progress,
    cancelled: &AtomicBool,
) -> Result<BTreeMap<u32, Point>, Stopped> {
    let (total, mine) = (prepared.total(), mine(prepared, options));
    if mine.is_empty() {
        return Err(anyhow!("this shard has none of {total} test points; make fewer shards").into());
    }
    let before = points.len();
    let finished = workspace.finished(plan, &prepared.points, total, options, progress)?;
    points.extend(finished.into_iter().filter(|(i, _)| mine.binary_search(i).is_ok()));
    let todo: Vec<u32> = mine.iter().copied().filter(|i| !points.contains_key(i)).collect();
    if points.len() > before {
        progress.note(&format!("{} of {} points are there already", points.len(), mine.len()));
    }
    let crew = Crew { plan, workspace, prepared, jobs: options.jobs, progress, cancelled };
    let before = points.len();
    points.extend(crew.simulate(&todo, before)?);
    Ok(points)
}

impl<S> Prepared<S> {
    /// How many points there may be, which every record of a point says.
    fn total(&self) -> u32 {
        self.rounds.as_ref().map_or(self.points.len(), |rounds| rounds.most) as u32
    }
}

/// Who does it.
struct Crew<'a, S> {
    plan: &'a PathsPlan,
    workspace: &'a Workspace,
    prepared: &'a Prepared<S>,
    jobs: usize,
    progress: &'a dyn Progress,
    cancelled: &'a AtomicBool,
}

impl<S: PointSolver> Crew<'_, S> {
    /// Finds the paths of `todo`, as far as it gets, and keeps each point's record.
    fn simulate(&self, todo: &[u32], before: usize) -> Result<BTreeMap<u32, Point>> {
        let jobs = self.jobs.clamp(1, todo.len().max(1));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build();
        let pool = pool.map_err(|e| anyhow!("{jobs} threads can't be started ({e}); give fewer --jobs"))?;
        self.progress.begin(before + todo.len(), before);
        let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
        let results = Mutex::new((BTreeMap::new(), None));
        pool.broadcast(|_| {
            while !self.cancelled.load(Ordering::Relaxed) && !failed.load(Ordering::Relaxed) {
                // In their order, so that the estimate is fair and the end comes evenly.
                let Some(&index) = todo.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
                let Some(kept) = self.point(index) else { return };
                let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
                match kept {
                    Ok(point) => {
                        results.0.insert(index, point);
                    }
                    Err(e) => {
                        failed.store(true, Ordering::Relaxed);
                        results.1.get_or_insert(e);
                    }
                }
            }
        });
        self.progress.end();
        match results.into_inner().unwrap_or_else(PoisonError::into_inner) {
            (_, Some(e)) => {
                bail!("{}; what is finished is kept: go on with --resume then", palpate_files::message(&e))
            }
            (done, None) => Ok(done),
        }
    }

    /// One point, from its plan to its file; `None` if cancelled.
    fn point(&self, index: u32) -> Option<Result<Point>> {
        let Prepared { scene, points, solver, .. } = self.prepared;
        let point = points.get(index as usize)?;
        let paths = solver.simulate(point, self.cancelled)?;
        let record = Point::new(index, point, &paths, scene.boundary_m.len());
        let kept = self.workspace.keep(self.plan, self.prepared.total(), record);
        if kept.is_ok() {
            stops(index, point, &paths).iter().for_each(|told| self.progress.note(told));
            self.progress.done(1 + paths.drags.len());
        }
        Some(kept)
    }
}

/// Joins the records of shards, which must be of one plan and leave no point out.
///
/// # Errors
/// A file can't be read; shards of different plans; a point missing, or in two of them.
pub fn merge(shards: &[PathBuf]) -> Result<PathsRecord> {
    let mut whole: Option<(PathsRecord, &Path)> = None;
    let mut origin: BTreeMap<u32, &Path> = BTreeMap::new();
    for path in shards {
        let record = PathsRecord::open(path)?;
        if record.scene.is_none() {
            bail!("{}: it is one point of a run under way; give the shards' outputs", path.display());
        }
        for &index in record.points.keys() {
            if let Some(other) = origin.insert(index, path) {
                bail!(
                    "{}: its test point {index} is also in {}; give each shard once",
                    path.display(),
                    other.display()
                );
            }
        }
        let Some((joined, first)) = &mut whole else {
            whole = Some((record, path));
            continue;
        };
        if let Some(what) = joined.plan.difference(&record.plan) {
            bail!(
                "{}: {what} is another than in {}; make all shards from the same spec and files, on machines of one kind",
                path.display(),
                first.display()
            );
        }
        if joined.total != record.total || joined.scene != record.scene {
            bail!(
                "{}: its surface is another than in {}; make all shards on machines of one kind",
                path.display(),
                first.display()
            );
        }
        joined.points.extend(record.points);
    }
    let Some((whole, first)) = whole else { bail!("there is nothing to merge; give the shards' files") };
    let missing: Vec<u32> = (0..whole.total).filter(|i| !whole.points.contains_key(i)).collect();
    if let Some(index) = missing.first() {
        bail!(
            "{}: with the other files {} of {} test points are missing, the first is {index}; give all shards",
            first.display(),
            missing.len(),
            whole.total
        );
    }
    Ok(whole)
}
