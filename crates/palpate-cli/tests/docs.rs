//! The documents are true: their commands run, their links lead somewhere, their copies are copies.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Lines of the fenced blocks in a language.
fn blocks<'a>(text: &'a str, language: &str) -> Vec<Vec<&'a str>> {
    let mut blocks = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if let Some(fence) = line.strip_prefix("```") {
            let block: Vec<&str> = lines.by_ref().take_while(|l| *l != "```").collect();
            if fence == language {
                blocks.push(block);
            }
        }
    }
    blocks
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let (path, name) = entry.map(|e| (e.path(), e.file_name())).unwrap();
        if path.is_dir() {
            copy(&path, &to.join(name));
        } else {
            fs::copy(&path, to.join(name)).unwrap();
        }
    }
}

#[test]
fn every_command_runs() {
    let mut ran = 0;
    for name in ["README.md", "docs/commands.md", "docs/spec.md", "docs/tutorial.md"] {
        let directory = tempfile::tempdir().unwrap();
        copy(&root().join("examples"), &directory.path().join("examples"));
        for line in blocks(&read(name), "sh").into_iter().flatten() {
            let Some(args) = line.strip_prefix("palpate ") else { continue };
            let output = Command::new(env!("CARGO_BIN_EXE_palpate"))
                .args(args.split_whitespace())
                .current_dir(directory.path())
                .output()
                .unwrap();
            let complaint = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{name}: {line}\n{complaint}");
            ran += 1;
        }
    }
    assert!(ran > 12, "{ran}");
}

#[test]
fn the_specs_examples_are_the_files() {
    let (text, files) = (
        read("docs/spec.md"),
        ["examples/cylinder-law.toml", "examples/fit/lump.toml", "examples/ball.toml"],
    );
    let blocks = blocks(&text, "toml");
    assert_eq!(blocks.len(), files.len());
    for (block, file) in blocks.iter().zip(files) {
        assert_eq!(block.join("\n"), read(file).trim_end(), "{file}");
    }
}

/// The page of sessions has every setting, and no other: its block is read as a configuration.
#[test]
fn the_page_of_sessions_has_every_setting() {
    let text = read("docs/session.md");
    let block = blocks(&text, "text").into_iter().next().unwrap().join("\n");
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("session.toml");
    fs::write(&path, &block).unwrap();
    let config = palpate_runtime::SessionConfig::read(&path).unwrap_or_else(|e| panic!("{e}"));
    config.check().unwrap();
    let keys = |value: &serde_json::Value| -> Vec<String> {
        let mut keys = Vec::new();
        for (key, value) in value.as_object().unwrap() {
            keys.push(key.clone());
            keys.extend(value.as_object().into_iter().flatten().map(|(inner, _)| format!("{key}.{inner}")));
        }
        keys
    };
    let ours = keys(&serde_json::to_value(palpate_runtime::SessionConfig::default()).unwrap());
    let shown: toml::Table = toml::from_str(&block).unwrap();
    let shown = keys(&serde_json::to_value(shown).unwrap());
    assert_eq!(ours.iter().filter(|key| !shown.contains(key)).collect::<Vec<_>>(), Vec::<&String>::new());
}

#[test]
fn links_lead_somewhere() {
    let folders = ["docs", "docs/devices"].map(|folder| fs::read_dir(root().join(folder)).unwrap());
    let documents = folders.into_iter().flatten().map(|e| e.unwrap().path());
    let documents = documents.filter(|p| p.extension().is_some_and(|e| e == "md"));
    let top = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md"].map(|n| root().join(n));
    for document in documents.chain(top) {
        let text = fs::read_to_string(&document).unwrap();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let path = link.split('#').next().unwrap_or_default();
            if path.is_empty() || path.starts_with("http") {
                continue;
            }
            assert!(document.with_file_name(path).exists(), "{}: {link} leads nowhere", document.display());
        }
    }
}
