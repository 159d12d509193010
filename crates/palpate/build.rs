//! What `palpate::VERSION` says: version, commit, features.
//!
//! `PALPATE_COMMIT` says the commit where a packager knows; else git does, if this folder is the checkout of a repository; else nobody
//! does, as in an unpacked archive. Builds for development don't ask, so that a commit compiles nothing anew there.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=PALPATE_COMMIT");
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let is_release = set("PROFILE").is_some_and(|p| p == "release");
    let is_plain = |c: &String| c.len() <= 64 && c.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
    let commit = set("PALPATE_COMMIT").or_else(|| if is_release { of_the_checkout() } else { None });
    let built = match commit.filter(is_plain) {
        Some(commit) => format!("commit {commit}"),
        None if is_release => "commit unknown".into(),
        None => "development build".into(),
    };
    let is_on = |name: &&&str| std::env::var_os(format!("CARGO_FEATURE_{}", name.to_uppercase())).is_some();
    let features: Vec<&str> = ["devices", "simulate"].iter().filter(is_on).copied().collect();
    let features = if features.is_empty() { "none".into() } else { features.join(", ") };
    let version = set("CARGO_PKG_VERSION").unwrap_or_default();
    println!("cargo::rustc-env=PALPATE_BUILT_VERSION={version} ({built}; features: {features})");
}

/// The commit that is checked out here, in twelve digits.
fn of_the_checkout() -> Option<String> {
    // Somebody else's repository may hold an unpacked archive of this one.
    git(&["ls-files", "--error-unmatch", "build.rs"])?;
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    // What changes when another commit is checked out or made. A file that is not there would start this anew in every build.
    for name in ["HEAD", "logs/HEAD", "packed-refs"] {
        let path = git(&["rev-parse", "--git-path", name])?;
        if Path::new(&path).exists() {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    Some(commit)
}

/// What git says; none where there is no git, or it says no.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
