//! The paper's experiment (section 5): a scripted touch of a cylinder, with and without either interpolation.
//!
//! [`run`] does all of it: rolls the path out in the four settings at three sampling rates, judges them, and writes
//! report, pictures and sound.

pub mod canvas;
pub mod cylinder;
pub mod experiment;
pub mod loops;
pub mod path;
pub mod pictures;
pub mod report;
pub mod ridges;
pub mod rules;
pub mod sound;
pub mod view;
pub mod words;

use anyhow::{Context, Result, anyhow};
use experiment::{Rate, SETTINGS, roll_out};
use palpate_body::{Body, BodyError};
use palpate_files as files;
use report::Report;
use std::path::Path;
use std::time::Instant;

/// Runs the experiment and writes its files into `folder`, which is made if need be. Files of an earlier run are
/// replaced, each as a whole; others stay.
///
/// # Errors
/// A folder that can't be written.
pub fn run(folder: &Path) -> Result<Report> {
    let started = Instant::now();
    let unwritable =
        || format!("{}: can't write the results; check that the folder can be written", folder.display());
    std::fs::create_dir_all(folder).with_context(unwritable)?;
    // Inside the folder: where these files have room, so have those that replace the old ones.
    let unfinished = tempfile::Builder::new()
        .prefix(".unfinished-")
        .tempdir_in(folder)
        .map_err(|e| anyhow!("{} ({})", unwritable(), e.kind()))?;

    let body = cylinder::body()?;
    let rates = [(1e3, true), (1e4, true), (1e5, false)].map(|(hz, keep)| roll_out(&body, hz, keep));
    let mut report = Report::new(&body, &rates);
    report.add_loops(loops::run(&body)?);
    let files =
        write(unfinished.path(), folder, &body, &rates, &mut report, started).with_context(unwritable)?;
    for file in files {
        let bytes = std::fs::read(unfinished.path().join(&file)).with_context(unwritable)?;
        files::replace(&folder.join(&file), |out| Ok(out.write_all(&bytes)?))?;
    }
    Ok(report)
}

/// Writes all files into `into` and returns their names.
fn write(
    into: &Path,
    folder: &Path,
    body: &Body,
    rates: &[Rate; 3],
    report: &mut Report,
    started: Instant,
) -> Result<Vec<String>> {
    let [coarse, finer, _] = rates;
    loops::picture(&into.join("loops.png"), &report.closed_loop)?;
    pictures::force(&into.join("force.png"), coarse)?;
    pictures::clicks(&into.join("clicks.png"), coarse)?;
    pictures::curves(&into.join("curves.png"), body)?;
    report.add_rules(rules::run()?);
    report.add_ridges(ridges::run()?);
    ridges::picture(&into.join("ridges.png"), &report.ridges)?;
    rules::picture(&into.join("rules.png"), &report.slip_rules)?;
    view::body(&into.join("body.png"), body, coarse)?;
    for (((name, _), rollout), setting) in SETTINGS.iter().zip(&finer.settings).zip(&mut report.settings) {
        let loudness = sound::save(&into.join(format!("force-rate-{name}.wav")), finer, rollout)?;
        setting.sound_peak_n_per_s = loudness.peak;
        report.sound.cut_samples += loudness.cut;
    }
    body.save(&into.join("cylinder.body")).map_err(|e| match e {
        // The file it names is an unfinished one.
        BodyError::Io { source, .. } => source.into(),
        other => anyhow!(other),
    })?;
    save_path(&into.join("path.csv"), coarse.hz)?;
    report.seconds = started.elapsed().as_secs_f64();
    std::fs::write(into.join("report.json"), serde_json::to_string_pretty(report)? + "\n")?;
    std::fs::write(into.join("report.md"), words::markdown(report, &folder.display().to_string()))?;
    let names = std::fs::read_dir(into)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    names.collect()
}

/// The path as `palpate trace` reads it: the very numbers of the experiment.
fn save_path(file: &Path, hz: f64) -> Result<()> {
    let mut csv = csv::Writer::from_path(file)?;
    csv.write_record(["time_s", "x_m", "y_m", "z_m"])?;
    for sample in 0..=experiment::last_sample(hz) {
        let t = sample as f64 / hz;
        let [x, y, z] = path::tip(t).to_array();
        csv.write_record([t, x, y, z].map(|v| v.to_string()))?;
    }
    Ok(csv.flush()?)
}
