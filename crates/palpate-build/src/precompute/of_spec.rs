//! The body of a spec, for a program that wants nothing but that.

use super::{Options, Stopped, assemble, prepare, run};
use crate::Progress;
use crate::fit::FitInputs;
use crate::spec::Spec;
use palpate_body::Body;
use palpate_files as files;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Makes the body of a spec file, by its law or by simulation. What is simulated is kept in `folder`, so that the next call goes on
/// there; without one it is lost with the call.
///
/// # Errors
/// As [`FitInputs::body`] or [`run::run`], [`Stopped::Cancelled`] when `cancelled` came true among them.
pub fn body_of_spec(
    path: &Path,
    folder: Option<&Path>,
    jobs: usize,
    progress: &dyn Progress,
    cancelled: &AtomicBool,
) -> Result<Body, Stopped> {
    let spec = Spec::read(path)?;
    if spec.law.is_some() {
        let inputs = FitInputs { spec: Some((spec, path.to_path_buf())), ..FitInputs::default() };
        return Ok(inputs.body()?.body);
    }
    let temporary;
    let folder = match folder {
        Some(folder) => {
            files::make_folder(folder)?;
            folder
        }
        None => {
            temporary = tempfile::tempdir()?;
            temporary.path()
        }
    };
    let simulation = spec.simulation(path)?;
    let plan = prepare::plan(&spec, &simulation, path)?;
    let options = Options {
        record: folder.join("body.paths"),
        partial: folder.join("body.partial"),
        jobs,
        resume: true,
        shard: None,
    };
    let ready = || {
        let prepared = prepare::prepare(&spec, &simulation, path, cancelled)?;
        prepared.scene.notes.iter().for_each(|note| progress.note(note));
        Ok(prepared)
    };
    let (whole, workspace) = run::run(&plan, &options, ready, progress, cancelled)?;
    let assembled = assemble::body(&whole)?;
    workspace.finish(progress)?;
    Ok(assembled.body)
}
