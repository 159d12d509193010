//! A folder with a body in it that the command runs in, for the tests of `palpate run`.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

/// A block, flat where it is touched, with edges of this length.
pub fn spec(edge_mm: u32) -> String {
    format!(
        r#"
[body.shape]
kind = "block"
size_mm = [80, 80, 40]
edge_length_mm = {edge_mm}
[friction]
coefficient = 0.3
[deflection]
normal_max_mm = 8
lateral_max_mm = 8
[response]
law = "uniform"
stiffness_n_per_m = 600
lateral_stiffness_n_per_m = 500
"#
    )
}

/// The folder, with `block.body`.
pub struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    pub fn new(edge_mm: u32) -> Self {
        let directory = TestDirectory(tempfile::tempdir().unwrap());
        directory.write("spec.toml", &spec(edge_mm));
        directory.done("fit --spec spec.toml -o block.body");
        directory
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    pub fn command(&self, args: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command.args(args.split_whitespace()).current_dir(self.0.path());
        command
    }

    pub fn run(&self, args: &str) -> Output {
        self.command(args).output().unwrap()
    }

    pub fn done(&self, args: &str) -> Output {
        let output = self.run(args);
        assert_eq!(output.status.code(), Some(0), "{args}: {}", said(&output));
        output
    }

    /// Exit status 1 and one line with these words, or 2 with them.
    pub fn refused(&self, args: &str, code: i32, words: &[&str]) {
        let output = self.run(args);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(code), "{args}: {said}");
        assert!(output.stdout.is_empty(), "{args}");
        assert!(code != 1 || said.trim_end().lines().count() == 1, "{args}: {said}");
        for word in words {
            assert!(said.contains(word), "{args}: {said} has no `{word}`");
        }
    }
}

pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
