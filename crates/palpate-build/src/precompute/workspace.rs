//! The folder of a run that is under way: finished points, the plan they belong to, and a lock.

use super::run::Options;
use crate::Progress;
use crate::paths_file::{PathsPlan, PathsRecord, Point, TestPoint};
use anyhow::{Result, anyhow, bail};
use palpate_files as files;
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

const PLAN: &str = "plan.json";
const LOCK: &str = "lock";

/// The folder, locked against other runs.
#[derive(Debug)]
pub struct Workspace {
    folder: PathBuf,
    // Closing it unlocks.
    _lock: File,
}

impl Workspace {
    /// Makes the folder, or goes on with it.
    ///
    /// # Errors
    /// It can't be made, another run is at work on it, or what is in it is of another plan or not asked for.
    pub fn open(plan: &PathsPlan, options: &Options) -> Result<Self> {
        let folder = &options.partial;
        files::check_target(&options.record)?;
        match std::fs::create_dir(folder) {
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(files::unwritable(folder, &e)),
            _ if !folder.is_dir() => {
                bail!("{}: it is no folder; remove it, or name another output", folder.display())
            }
            _ => {}
        }
        let workspace = Workspace { _lock: lock(folder)?, folder: folder.clone() };
        workspace.sweep();
        if workspace.records()?.is_empty() {
            // Nothing can be lost.
            workspace.write_plan(plan)?;
            return Ok(workspace);
        }
        if !options.resume {
            bail!(
                "{}: a run was begun there; go on with it by --resume, or delete the folder to begin anew",
                folder.display()
            );
        }
        let place = folder.join(PLAN);
        let old: PathsPlan = files::read_text(&place).and_then(|text| {
            serde_json::from_str(&text).map_err(|e| {
                anyhow!("{}: it is damaged ({e}); delete {} to begin anew", place.display(), folder.display())
            })
        })?;
        if let Some(what) = old.difference(plan) {
            let moved = PathsPlan { machine: plan.machine.clone(), ..old } == *plan;
            bail!(
                "{}: {what} is another than when this run was begun; {}, or delete the folder to begin anew",
                folder.display(),
                if moved { "go on with it on a machine of that kind" } else { "put it back to go on" }
            );
        }
        Ok(workspace)
    }

    /// Removes what a killed run was just writing.
    fn sweep(&self) {
        let entries = std::fs::read_dir(&self.folder).into_iter().flatten().flatten();
        for entry in entries.filter(|e| e.file_name().to_string_lossy().starts_with(".tmp")) {
            let _ = std::fs::remove_file(entry.path());
        }
    }

    fn write_plan(&self, plan: &PathsPlan) -> Result<()> {
        files::replace(&self.folder.join(PLAN), |out| {
            serde_json::to_writer_pretty(&mut *out, plan)?;
            Ok(out.write_all(b"\n")?)
        })
    }

    /// The files of finished points.
    fn records(&self) -> Result<Vec<PathBuf>> {
        let list = || -> io::Result<Vec<PathBuf>> {
            let entries = std::fs::read_dir(&self.folder)?;
            let paths = entries.map(|e| e.map(|e| e.path())).collect::<io::Result<Vec<_>>>()?;
            Ok(paths.into_iter().filter(|p| p.extension().is_some_and(|e| e == "paths")).collect())
        };
        let mut paths = list().map_err(|e| files::unreadable(&self.folder, &e))?;
        paths.sort();
        Ok(paths)
    }

    /// Keeps a finished point; its displacements stay on disk.
    ///
    /// # Errors
    /// The folder can't be written, or has no room.
    pub fn keep(&self, plan: &PathsPlan, total: u32, point: Point) -> Result<Point> {
        let (index, path) = (point.index(), self.folder.join(format!("{:06}.paths", point.index())));
        let record = PathsRecord { plan: plan.clone(), total, scene: None, points: [(index, point)].into() };
        record.save(&path)?;
        // What can't be read back is not finished.
        let mut record = PathsRecord::open(&path)?;
        record.points.remove(&index).ok_or_else(|| anyhow!("{}: it can't be read back", path.display()))
    }

    /// Those of the points, of which there may be `total`, that need not be simulated again. Damaged ones are reported, and left out.
    ///
    /// # Errors
    /// The folder can't be read.
    pub fn finished(
        &self,
        plan: &PathsPlan,
        points: &[TestPoint],
        total: u32,
        options: &Options,
        progress: &dyn Progress,
    ) -> Result<BTreeMap<u32, Point>> {
        let mut finished = BTreeMap::new();
        if !options.resume {
            return Ok(finished);
        }
        // The whole record is there if the run was broken at its very end.
        let whole = options.record.is_file().then(|| PathsRecord::open(&options.record).ok()).flatten();
        let whole = whole.filter(|r| r.plan == *plan);
        let records = self.records()?.into_iter().filter_map(|path| {
            let again = match PathsRecord::open(&path) {
                Ok(record) if record.plan == *plan => return Some(record),
                Ok(_) => format!("{}: it belongs to another run", path.display()),
                Err(e) => e.to_string(),
            };
            progress.note(&format!("{again}; its point is simulated again"));
            None
        });
        for record in whole.into_iter().chain(records) {
            // A whole record has as many as there were in the end.
            let fits = record.total == total || record.scene.is_some();
            for (index, point) in record.points {
                let expected = points.get(index as usize);
                if fits && expected.is_some_and(|p| *p == point.test_point()) {
                    finished.insert(index, point);
                }
            }
        }
        Ok(finished)
    }

    /// Removes the folder, now that all is in the record.
    ///
    /// # Errors
    /// A file can't be removed.
    pub fn finish(self, progress: &dyn Progress) -> Result<()> {
        let mut files = self.records()?;
        files.extend([PLAN, LOCK].map(|name| self.folder.join(name)));
        for file in files {
            std::fs::remove_file(&file).map_err(|e| files::unwritable(&file, &e))?;
        }
        // Whatever else is in it is not ours.
        if let Err(e) = std::fs::remove_dir(&self.folder) {
            progress.note(&format!("{}: it is done with, but can't be removed ({e})", self.folder.display()));
        }
        Ok(())
    }
}

impl Drop for Workspace {
    /// A folder without any finished point is of no use.
    fn drop(&mut self) {
        if self.folder.is_dir() && self.records().is_ok_and(|records| records.is_empty()) {
            for name in [PLAN, LOCK] {
                let _ = std::fs::remove_file(self.folder.join(name));
            }
            let _ = std::fs::remove_dir(&self.folder);
        }
    }
}

/// How long a run that was killed may take until the system has cleared it away and its lock with it.
const DYING: Duration = Duration::from_secs(2);

/// Locks a folder. The system unlocks it when the process ends, however it does.
fn lock(folder: &Path) -> Result<File> {
    let path = folder.join(LOCK);
    let busy = || {
        anyhow!(
            "{}: another run is at work on it; wait for its end, or name another output",
            folder.display()
        )
    };
    let file = File::options().create(true).truncate(false).write(true).open(&path);
    let file = file.map_err(|e| files::unwritable(&path, &e))?;
    let patient = Instant::now() + DYING;
    loop {
        match file.try_lock() {
            Ok(()) => break,
            Err(TryLockError::WouldBlock) if Instant::now() < patient => sleep(DYING / 50),
            Err(TryLockError::WouldBlock) => return Err(busy()),
            Err(TryLockError::Error(e)) => return Err(files::unwritable(&path, &e)),
        }
    }
    // The run that had it may have ended, and removed it, between the two calls.
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let ids = file.metadata().ok().zip(std::fs::metadata(&path).ok());
        if ids.is_none_or(|(a, b)| a.ino() != b.ino()) {
            return Err(busy());
        }
    }
    Ok(file)
}
