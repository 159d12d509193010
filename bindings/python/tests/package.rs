//! The wheel in a fresh virtual environment: built, installed, and its tests run. Skips, and says so, where there is no Python or no
//! network for its packages.
//!
//! With `PALPATE_PYTHON=…/bin/python`, an interpreter that has palpate and pytest already, nothing is built.

use palpate::body::{Interpolation, Provenance, SlipRule, Surface, Tool, import, repair};
use palpate::engine::rollout;
use palpate::identify::{BodyOptions, FitOptions, fit, read_samples};
use palpate::runtime::path;
use palpate::{Ablation, Body};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn here() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn examples() -> PathBuf {
    here().join("../../examples/fit")
}

/// The lump of examples/fit.
fn lump() -> Body {
    let mesh = import::read(&examples().join("lump.obj"), Some(import::LengthUnit::Millimetre)).unwrap();
    let (mesh, _) = repair::repair(mesh, repair::Options { allow_open: false }).unwrap();
    let surface = Surface::build(&mesh, f64::INFINITY).unwrap();
    let samples = read_samples(&examples().join("samples.csv")).unwrap();
    let options = FitOptions { interpolation: Interpolation::Pchip, default_friction: None };
    let fitted = fit(&surface, &samples, &options).unwrap();
    let provenance = Provenance::default();
    let options = BodyOptions {
        tool: Tool::Point,
        slip: SlipRule::default(),
        tank: true,
        partial_slip: false,
        provenance,
    };
    fitted.into_body(surface, options).unwrap()
}

/// What Rust makes of a path by each rule: the body, and force, torque and energies of each step as bytes of 64-bit numbers.
fn write_reference(folder: &Path) {
    let body = lump();
    body.save(&folder.join("lump.body")).unwrap();
    let waypoints = path::resample(&path::read(&examples().join("drag.csv")).unwrap(), 1000.0).unwrap();
    for rule in SlipRule::ALL {
        let mut bytes = Vec::new();
        let mut touched = 0;
        for output in rollout(&body, waypoints.iter().copied(), rule, Ablation::None) {
            let energy = output.energy;
            let energies =
                [energy.work_j, energy.stored_j, energy.dissipated_j, energy.generated_j, energy.tank_j];
            let numbers = output.force_n.into_iter().chain(output.torque_nm).chain(energies);
            numbers.for_each(|x| bytes.extend(x.to_le_bytes()));
            touched += usize::from(output.contact.is_some());
        }
        assert!(touched > 100, "{rule:?}: {touched} steps in contact");
        std::fs::write(folder.join(format!("{}.trace", rule.name())), bytes).unwrap();
    }
}

fn run(program: impl AsRef<OsStr>, arguments: &[&OsStr]) -> std::io::Result<Output> {
    Command::new(program).args(arguments).current_dir(here()).output()
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// An interpreter with the package and what its tests need, in a new virtual environment; or why there is none.
fn installed(folder: &Path) -> Result<PathBuf, String> {
    let new_enough = "import sys, venv; sys.exit(sys.version_info < (3, 11))";
    match run("python3", &["-c".as_ref(), new_enough.as_ref()]) {
        Ok(output) if output.status.success() => {}
        Ok(output) => {
            return Err(format!("python3 is older than 3.11, or has no module venv {}", text(&output)));
        }
        Err(e) => return Err(format!("python3 can't be run: {e}")),
    }
    let environment = folder.join("venv");
    let made = run("python3", &["-m".as_ref(), "venv".as_ref(), environment.as_ref()]).unwrap();
    if !made.status.success() {
        return Err(format!("no virtual environment can be made: {}", text(&made)));
    }
    let python = environment.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    let fetched = [&pip[..], &["maturin>=1.9,<2", "numpy", "pytest", "matplotlib"]].concat();
    let fetched: Vec<&OsStr> = fetched.into_iter().map(OsStr::new).collect();
    let fetched = run(&python, &fetched).unwrap();
    if !fetched.status.success() {
        return Err(format!("pip can't install maturin, numpy, pytest and matplotlib: {}", text(&fetched)));
    }
    let wheels = folder.join("wheels");
    let build = ["-m", "maturin", "build", "--profile", "dev", "--out"].map(OsStr::new);
    let built = run(&python, &[&build[..], &[wheels.as_ref()]].concat()).unwrap();
    assert!(built.status.success(), "the wheel can't be built:\n{}", text(&built));
    let wheel = std::fs::read_dir(&wheels).unwrap().next().unwrap().unwrap().path();
    let name = wheel.file_name().unwrap().to_string_lossy().into_owned();
    assert!(name.contains("-cp311-abi3-"), "{name} is not for all Pythons from 3.11 on");
    let install: Vec<&OsStr> = pip.iter().map(OsStr::new).chain([wheel.as_os_str()]).collect();
    let done = run(&python, &install).unwrap();
    assert!(done.status.success(), "the wheel can't be installed:\n{}", text(&done));
    Ok(python)
}

#[test]
fn the_wheel_does_what_rust_does() {
    let folder = tempfile::tempdir().unwrap();
    write_reference(folder.path());
    let python = match std::env::var_os("PALPATE_PYTHON") {
        Some(python) => python.into(),
        None => match installed(folder.path()) {
            Ok(python) => python,
            Err(why) => {
                eprintln!("skipped: the Python package was not tested: {why}");
                return;
            }
        },
    };
    let output = Command::new(python)
        .args(["-m", "pytest", "-q", "-p", "no:cacheprovider"])
        .arg(here().join("tests"))
        .current_dir(folder.path())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("PALPATE_REFERENCE", folder.path())
        .env("MPLBACKEND", "agg")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output));
    eprintln!("{}", text(&output));
}
