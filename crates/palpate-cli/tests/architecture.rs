//! The house's own rules: who may depend on whom, under which licences, what sources may not reach for, and that ARCHITECTURE.md
//! tells of every crate.

use cargo_metadata::{DependencyKind, Metadata, MetadataCommand};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn metadata() -> Metadata {
    MetadataCommand::new()
        .manifest_path(root().join("Cargo.toml"))
        .other_options(["--locked".into()])
        .exec()
        .unwrap()
}

/// Names of each workspace crate's direct normal and build dependencies: not those of its tests.
fn direct(metadata: &Metadata) -> BTreeMap<String, BTreeSet<String>> {
    let shipped = |p: &&cargo_metadata::Package| {
        let dependencies = p.dependencies.iter().filter(|d| d.kind != DependencyKind::Development);
        (p.name.to_string(), dependencies.map(|d| d.name.clone()).collect())
    };
    metadata.workspace_packages().iter().map(shipped).collect()
}

fn is_ours(name: &str) -> bool {
    name == "palpate" || name.starts_with("palpate-")
}

/// What each crate may use of ours. A crate that is not here may not exist yet.
const MAY_USE: &[(&str, &[&str])] = &[
    ("palpate-body", &[]),
    ("palpate-engine", &["palpate-body"]),
    ("palpate-identify", &["palpate-body"]),
    ("palpate-simulate", &["palpate-body"]),
    ("palpate-device", &[]),
    ("palpate-files", &[]),
    ("palpate-runtime", &["palpate-body", "palpate-engine", "palpate-device", "palpate-files"]),
    (
        "palpate-build",
        &["palpate-body", "palpate-engine", "palpate-files", "palpate-identify", "palpate-simulate"],
    ),
    ("palpate-certify", &["palpate-body", "palpate-device", "palpate-engine", "palpate-runtime"]),
    (
        "palpate",
        &[
            "palpate-body",
            "palpate-build",
            "palpate-certify",
            "palpate-device",
            "palpate-engine",
            "palpate-files",
            "palpate-identify",
            "palpate-runtime",
        ],
    ),
    ("palpate-viewer", &["palpate"]),
    ("palpate-c", &["palpate"]),
    ("palpate-python", &["palpate"]),
];

#[test]
fn dependencies_point_the_right_way() {
    let crates = direct(&metadata());
    for (name, dependencies) in crates.iter().filter(|(name, _)| *name != "palpate-cli") {
        let ours: BTreeSet<&str> = dependencies.iter().map(String::as_str).filter(|d| is_ours(d)).collect();
        let Some((_, allowed)) = MAY_USE.iter().find(|(n, _)| n == name) else {
            // Further bindings are thin: they may use what the command uses, but no window.
            assert!(!ours.contains("palpate-viewer"), "{name} must not use palpate-viewer");
            continue;
        };
        let extra: Vec<_> = ours.iter().filter(|d| !allowed.contains(d)).collect();
        assert!(extra.is_empty(), "{name} must not use {extra:?}");
    }
    assert!(crates.contains_key("palpate-engine") && crates.contains_key("palpate-body"));
}

/// A program that adds the library gets no command with it.
#[test]
fn the_library_brings_nothing_of_the_command() {
    let tree = |features: &str| {
        let mut cargo = std::process::Command::new(env!("CARGO"));
        cargo.args([
            "tree", "--locked", "-p", "palpate", "-e", "normal", "--prefix", "none", "--format", "{p}",
        ]);
        cargo.args(["--no-default-features", "--features", features]).current_dir(root());
        let output = cargo.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().filter_map(|line| line.split(' ').next().map(str::to_owned)).collect::<BTreeSet<_>>()
    };
    for features in ["", "devices", "simulate", "devices,simulate"] {
        let names = tree(features);
        assert!(names.contains("palpate-engine") && names.contains("palpate-runtime"), "{names:?}");
        for unwanted in ["clap", "clap_builder", "plotters", "ctrlc", "indicatif", "hound", "palpate-cli"] {
            assert!(!names.contains(unwanted), "{unwanted} with the features `{features}`");
        }
        for (name, feature) in [("palpate-simulate", "simulate"), ("libloading", "devices")] {
            assert_eq!(names.contains(name), features.contains(feature), "{name} with `{features}`");
        }
    }
    let prints = ["println!", "eprintln!", "print!(", "std::env::args", "std::process::exit", "dbg!"];
    for name in ["body", "engine", "files", "identify", "simulate", "device", "runtime", "build", "certify"] {
        assert_eq!(found(&format!("palpate-{name}"), &prints), Vec::<String>::new());
    }
}

#[test]
fn the_engine_is_alone_with_its_numbers() {
    let crates = direct(&metadata());
    for unwanted in ["rayon", "log", "serde", "tracing"] {
        assert!(!crates["palpate-engine"].contains(unwanted), "the engine must not use {unwanted}");
    }
    let unwanted = ["std::time", "std::thread", "std::fs", "std::io", "std::net", "println!", "eprintln!"];
    assert_eq!(found("palpate-engine", &unwanted), Vec::<String>::new());
}

/// A machine's clock that is set, or steps by itself, must neither hurry the loop nor hold it: no deadline and no watchdog
/// goes by it.
#[test]
fn loop_and_drivers_know_only_the_clock_that_nobody_sets() {
    let clocks = ["SystemTime", "UNIX_EPOCH", "REALTIME", "gettimeofday", "CLOCK_TAI"];
    for name in ["palpate-runtime", "palpate-device"] {
        let mut known = found(name, &clocks);
        // When a recording began.
        known.retain(|line| !line.contains("wall_clock.rs"));
        assert_eq!(known, Vec::<String>::new());
        let others = found(name, &["ClockId::"]);
        let others: Vec<_> = others.iter().filter(|line| !line.contains("ClockId::Monotonic")).collect();
        assert!(others.is_empty(), "{others:?}");
    }
    assert!(!found("palpate-runtime", &["ClockId::Monotonic"]).is_empty());
}

/// The lines of a crate's sources, but for comments, that hold one of these words, with their places.
fn found(name: &str, words: &[&str]) -> Vec<String> {
    let mut found = Vec::new();
    let files = sources(&root().join("crates").join(name).join("src"));
    for (file, text) in files.into_iter().filter(|(file, _)| !file.ends_with("tests.rs")) {
        let code = text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//"));
        for (i, line) in code.filter(|(_, line)| words.iter().any(|word| line.contains(word))) {
            found.push(format!("{}:{}: {}", file.display(), i + 1, line.trim()));
        }
    }
    found
}

/// Rust files under a folder, with their text.
fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push((path.clone(), fs::read_to_string(&path).unwrap()));
        }
    }
    assert!(!files.is_empty(), "{}: no source", folder.display());
    files
}

/// What a dependency's licence may come down to.
const LICENCES: &[&str] = &[
    "MIT",
    "Apache-2.0",
    "BSD-1-Clause",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "MPL-2.0",
    "Zlib",
    "ISC",
    // Only beside another one, for tables derived from Unicode's data; asks for its notice, as MIT does.
    "Unicode-3.0",
];

#[test]
fn licences_go_with_ours() {
    let shipped = shipped();
    assert!(shipped.len() > 20);
    for (package, licence) in shipped {
        assert!(satisfiable(&licence), "{package} is under `{licence}`");
    }
}

/// Every package that ends up in a binary, on whatever system, with its licence. From `cargo tree`: the metadata's graph also has
/// what only a feature that is off would bring.
fn shipped() -> BTreeSet<(String, String)> {
    let mut cargo = std::process::Command::new(env!("CARGO"));
    cargo.args(["tree", "--locked", "--workspace", "--target", "all", "-e", "normal", "--prefix", "none"]);
    let output = cargo.args(["--format", "{p}|{l}"]).current_dir(root()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let of = |line: &str| line.trim_end_matches(" (*)").split_once('|').map(|(p, l)| (p.into(), l.into()));
    text.lines().filter_map(of).collect()
}

/// Whether an SPDX expression can be met with [`LICENCES`]. `WITH` exceptions only add permissions: they are ignored.
fn satisfiable(expression: &str) -> bool {
    let spaced = expression.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut rest = &words[..];
    either(&mut rest) == Some(true) && rest.is_empty()
}

/// `None`: not an expression.
fn either(rest: &mut &[&str]) -> Option<bool> {
    let mut met = both(rest)?;
    while let ["OR", tail @ ..] = rest {
        *rest = tail;
        met |= both(rest)?;
    }
    Some(met)
}

fn both(rest: &mut &[&str]) -> Option<bool> {
    let mut met = one(rest)?;
    while let ["AND", tail @ ..] = rest {
        *rest = tail;
        met &= one(rest)?;
    }
    Some(met)
}

fn one(rest: &mut &[&str]) -> Option<bool> {
    match *rest {
        ["(", tail @ ..] => {
            *rest = tail;
            let met = either(rest)?;
            *rest = rest.strip_prefix(&[")"])?;
            Some(met)
        }
        [name, "WITH", _, tail @ ..] | [name, tail @ ..] => {
            *rest = tail;
            Some(LICENCES.contains(name))
        }
        [] => None,
    }
}

#[test]
fn expressions_are_read() {
    for good in [
        "MIT",
        "Unlicense OR MIT",
        "Unlicense/MIT",
        "(MIT OR GPL-3.0) AND Unicode-3.0",
        "Apache-2.0 WITH LLVM-exception",
    ] {
        assert!(satisfiable(good), "{good}");
    }
    for bad in
        ["", "GPL-3.0", "MIT AND GPL-3.0", "MIT OR", "(MIT", "MIT)", "GPL-2.0 WITH Classpath-exception-2.0"]
    {
        assert!(!satisfiable(bad), "{bad}");
    }
}

#[test]
fn the_architecture_text_names_every_crate() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md is missing");
    let metadata = metadata();
    let crates: BTreeSet<String> = metadata.workspace_packages().iter().map(|p| p.name.to_string()).collect();
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let words: BTreeSet<&str> = text.split(|c| !is_part(c)).map(|w| w.trim_matches('-')).collect();
    for name in &crates {
        assert!(words.contains(name.as_str()), "ARCHITECTURE.md does not name {name}");
    }
    for word in words.iter().filter(|w| w.starts_with("palpate-")) {
        assert!(crates.contains(*word), "ARCHITECTURE.md names {word}, which does not exist");
    }
    assert!(text.lines().count() <= 280, "ARCHITECTURE.md is longer than 280 lines");
}
