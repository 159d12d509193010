//! Programs in C and C++, built with each compiler that is there and run: examples from a folder that holds no more than a tarball, one
//! path through Rust, C and C++, and misuse under sanitizers. A compiler or tool that is missing is named on standard error.

#![cfg(target_os = "linux")]

use palpate::body::shape::Shape;
use palpate::body::{Response, SlipRule, Tool};
use palpate::{Body, Contact, ToolState};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

fn here(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(file)
}

/// Where cargo puts the shared and the static library when it builds these tests.
fn libraries() -> PathBuf {
    let folder = std::env::current_exe().unwrap().parent().unwrap().to_path_buf();
    for name in ["libpalpate_c.a", "libpalpate_c.so"] {
        assert!(folder.join(name).is_file(), "{} is not there", folder.join(name).display());
    }
    folder
}

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    assert!(
        output.status.success(),
        "{command:?}: {}\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

fn is_there(program: &str) -> bool {
    let there = Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    if !there {
        eprintln!("skipped: {program} is not there");
    }
    there
}

/// A C and a C++ compiler of the same make.
fn compilers() -> &'static [[&'static str; 2]] {
    static THERE: OnceLock<Vec<[&str; 2]>> = OnceLock::new();
    THERE.get_or_init(|| {
        let pairs = [["gcc", "g++"], ["clang", "clang++"]];
        pairs.into_iter().filter(|pair| pair.iter().all(|name| is_there(name))).collect()
    })
}

/// Compiles one file with the shared library.
fn build(compiler: &str, source: &str, options: &[&str], program: &Path) {
    let standard = if source.ends_with(".cpp") { "-std=c++17" } else { "-std=c11" };
    let mut command = Command::new(compiler);
    command.args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-g"]).args(options);
    command.arg("-I").arg(here("include")).arg("-I").arg(here("cpp"));
    // That one, or the one in an unpacked tarball.
    let (folder, name) = match std::env::var_os("PALPATE_PACKAGE") {
        Some(package) => (Path::new(&package).join("lib"), "-lpalpate"),
        None => (libraries(), "-lpalpate_c"),
    };
    command.arg(here(source)).arg("-o").arg(program).arg("-L").arg(&folder).arg(name);
    command.arg(format!("-Wl,-rpath,{}", folder.display())).args(["-lpthread", "-lm"]);
    run(&mut command);
}

/// Two bodies, one with a spherical tool and the rule that is not the usual one, and a path that presses, drags, leaves and comes again.
fn bodies_and_path(folder: &Path) -> (Vec<PathBuf>, PathBuf, Vec<[f64; 7]>) {
    let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default()).unwrap();
    let body = Body::uniform(ball, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()).unwrap();
    let mut parts = body.parts();
    (parts.tool, parts.slip) = (Tool::Sphere { radius_m: 2e-3 }, SlipRule::Paper);
    let bodies = [body, Body::new(parts).unwrap()];
    let files = bodies.iter().enumerate().map(|(k, body)| {
        let file = folder.join(format!("{k}.body"));
        body.save(&file).unwrap();
        file
    });
    let rows: Vec<[f64; 7]> = (0..5000)
        .map(|k| {
            let t = f64::from(k) * 1e-3;
            let (x, y) = (4e-3 * (3.0 * t).sin() + 1e-3 * t, 3e-3 * (2.0 * t).cos());
            [t, x, y, 30e-3 + 2e-3 * (4.0 * t).cos(), 1.0, 0.0, 0.0]
        })
        .collect();
    let path = folder.join("path");
    let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_ne_bytes()).collect();
    std::fs::write(&path, bytes).unwrap();
    (files.collect(), path, rows)
}

/// What the programs print, from Rust.
fn bits_of(body: &Body, rows: &[[f64; 7]]) -> (String, u32) {
    let (mut contact, mut last_s, mut touching) = (Contact::new(body), rows[0][0], 0);
    let mut lines = String::new();
    for &[time_s, x, y, z, ..] in rows {
        let output = contact.step(body, &ToolState::at([x, y, z]), time_s - last_s);
        last_s = time_s;
        touching += u32::from(output.contact.is_some());
        for x in output.force_n.into_iter().chain(output.torque_nm) {
            write!(lines, " {:016x}", x.to_bits()).unwrap();
        }
        lines.push('\n');
    }
    (lines, touching)
}

#[test]
fn one_path_has_the_same_bits_in_rust_c_and_cpp() {
    let folder = tempfile::tempdir().unwrap();
    let (bodies, path, rows) = bodies_and_path(folder.path());
    for file in &bodies {
        let (expected, touching) = bits_of(&Body::open(file).unwrap(), &rows);
        assert!(touching > 1000 && touching < 4900, "{touching}");
        for (compiler, source) in compilers()
            .iter()
            .flat_map(|[c, cpp]| [(c, "tests/programs/same_path.c"), (cpp, "tests/programs/same_path.cpp")])
        {
            let program = folder.path().join("program");
            build(compiler, source, &[], &program);
            let output = run(Command::new(&program).arg(file).arg(&path));
            let output = String::from_utf8(output.stdout).unwrap();
            for way in ["step", "rollout", "many"] {
                let found = output.lines().filter_map(|line| line.strip_prefix(way));
                assert!(found.eq(expected.lines()), "{compiler}, {source}, {way}: other bits than Rust's");
            }
            assert_eq!(output.lines().count(), 3 * rows.len());
        }
    }
}

const EXAMPLES: [&str; 4] = [
    "examples/own_loop.c",
    "examples/instead_of_a_proxy.c",
    "examples/own_device.c",
    "examples/own_loop.cpp",
];

#[test]
fn misuse_is_a_status_and_it_and_the_examples_are_clean_under_sanitizers() {
    let folder = tempfile::tempdir().unwrap();
    for [c, cpp] in compilers() {
        let compiler = c;
        let sanitizers = [
            ("no sanitizer", vec![]),
            (
                "addresses and undefined behaviour",
                vec!["-fsanitize=address,undefined", "-fno-sanitize-recover=all"],
            ),
            ("threads", vec!["-fsanitize=thread"]),
        ];
        for (name, options) in sanitizers {
            // A compiler may come without its sanitizers' libraries.
            let probe = folder.path().join("probe.c");
            std::fs::write(&probe, "int main(void) { return 0; }").unwrap();
            let mut command = Command::new(compiler);
            command.args(&options).arg(&probe).arg("-o").arg(folder.path().join("probe"));
            let built = command.output().unwrap().status.success();
            if !built || !Command::new(folder.path().join("probe")).status().is_ok_and(|s| s.success()) {
                eprintln!("skipped: {compiler} has no sanitizer of {name} here");
                continue;
            }
            let program = folder.path().join("misuse");
            build(compiler, "tests/programs/misuse.c", &options, &program);
            // Of the library's own threads a sanitizer that did not compile it knows half, and complains of the rest.
            let only = options.contains(&"-fsanitize=thread").then_some("threads");
            run(Command::new(&program).args(only).current_dir(folder.path()));
            eprintln!("{compiler}: misuse ran under: {name}");
            if only.is_none() && !options.is_empty() {
                for (compiler, example) in
                    EXAMPLES.map(|file| (if file.ends_with("cpp") { cpp } else { c }, file))
                {
                    build(compiler, example, &options, &program);
                    run(Command::new(&program).current_dir(folder.path()));
                    eprintln!("{compiler}: {example} ran under: {name}");
                }
            }
        }
    }
}

/// A tarball's folder, for all tests of it.
fn package() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new(here("package"));
        run(command.arg(folder.path()).arg("--libraries").arg(libraries()));
        folder
    });
    folder.path()
}

/// The examples alone, in a folder of their own.
fn examples(to: &Path) {
    for entry in std::fs::read_dir(package().join("examples")).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

#[test]
fn a_fresh_folder_builds_and_runs_the_examples_with_pkg_config() {
    if !is_there("make") || !is_there("pkg-config") {
        return;
    }
    for [c, cpp] in compilers() {
        let folder = tempfile::tempdir().unwrap();
        examples(folder.path());
        let mut make = Command::new("make");
        make.arg("check").arg(format!("CC={c}")).arg(format!("CXX={cpp}")).current_dir(folder.path());
        make.args(["CFLAGS=-O1 -Wall -Wextra -Werror", "CXXFLAGS=-O1 -Wall -Wextra -Werror"]);
        let output = run(make.env("PKG_CONFIG_PATH", package().join("lib/pkgconfig")));
        let text = String::from_utf8(output.stdout).unwrap();
        for words in ["in contact, slipping", "palpate:", "the device's poses are at their end", "100 paths"]
        {
            assert!(text.contains(words), "{words} is not in: {text}");
        }
        eprintln!("{c}, {cpp}: the examples ran");
    }
}

#[test]
fn a_fresh_folder_builds_and_runs_the_examples_with_cmake() {
    if !is_there("cmake") || !is_there("make") {
        return;
    }
    for [c, cpp] in compilers() {
        let folder = tempfile::tempdir().unwrap();
        examples(folder.path());
        let at = |name: &str| folder.path().join(name);
        let mut configure = Command::new("cmake");
        configure.arg("-S").arg(folder.path()).arg("-B").arg(at("build"));
        configure.args(["-G", "Unix Makefiles"]).arg(format!("-DCMAKE_C_COMPILER={c}"));
        configure.arg(format!("-DCMAKE_CXX_COMPILER={cpp}"));
        run(configure.arg(format!("-DCMAKE_PREFIX_PATH={}", package().display())));
        run(Command::new("cmake").arg("--build").arg(at("build")));
        for name in ["own_loop", "instead_of_a_proxy", "own_device", "own_loop_cpp", "own_loop_static"] {
            run(&mut Command::new(at("build").join(name)));
        }
        eprintln!("{c}, {cpp}: the examples ran, built with cmake");
    }
}

/// What the border costs: a step through C less a step of a rollout, which is the same loop in Rust behind one call, on paths in free space,
/// sticking and sliding. It is judged with the library as it is shipped: CONTRIBUTING.md has the commands.
#[test]
#[ignore = "it times"]
fn a_step_through_c_costs_20_ns_more_at_most() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default()).unwrap();
    let body = Body::uniform(ball, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()).unwrap();
    let file = folder.path().join("0.body");
    body.save(&file).unwrap();
    let program = folder.path().join("overhead");
    build(compilers()[0][0], "tests/programs/overhead.c", &["-O2"], &program);
    let mut most = 0.0f64;
    for (name, motion) in [("in free space", 0), ("sticking", 1), ("sliding", 2)] {
        let rows: Vec<[f64; 7]> = (0..20_000)
            .map(|k| {
                let t = f64::from(k) * 1e-3;
                let down = (t / 0.5).min(1.0);
                let x = if motion == 2 { 6e-3 * (2.0 * t).sin() } else { 1e-5 * (9.0 * t).sin() };
                let z = if motion == 0 { 40e-3 + 1e-3 * t.sin() } else { 31e-3 - 4e-3 * down };
                [t, x, 0.0, z, 1.0, 0.0, 0.0]
            })
            .collect();
        let path = folder.path().join("path");
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_ne_bytes()).collect();
        std::fs::write(&path, bytes).unwrap();
        let output = run(Command::new(&program).arg(&file).arg(&path).arg("100"));
        let text = String::from_utf8(output.stdout).unwrap();
        let times: Vec<f64> = text.split_whitespace().map(|x| x.parse().unwrap()).collect();
        let more = times[0] - times[1];
        println!("{name}: {:.1} ns a step, of a rollout {:.1} ns, {more:.1} ns more", times[0], times[1]);
        most = most.max(more);
    }
    assert!(most <= 20.0, "{most:.1} ns");
}

/// The C++ header, whole, with and without exceptions, in C++17 and in C++20 with its spans.
#[test]
fn the_cpp_header_serves_with_and_without_exceptions() {
    let folder = tempfile::tempdir().unwrap();
    for [_, cpp] in compilers() {
        for options in [&[][..], &["-fno-exceptions"], &["-std=c++20"]] {
            let program = folder.path().join("faces");
            build(cpp, "tests/programs/faces.cpp", options, &program);
            run(Command::new(&program).current_dir(folder.path()));
        }
    }
}

/// The programs of docs/c.md, compiled.
#[test]
fn the_pages_programs_compile() {
    let page = std::fs::read_to_string(here("../../docs/c.md")).unwrap();
    // One after the other, as one program.
    let block = |language: &str| -> String {
        let fence = format!("```{language}\n");
        page.split(&fence).skip(1).map(|from| from.split_once("```").unwrap().0).collect()
    };
    let (c, cpp) = (block("c"), block("cpp"));
    let around = [
        (
            "page.c",
            format!(
                "#include <palpate.h>\n#include <stdio.h>\nvoid read_the_device(double *);\nvoid render(const double *);\n\
             int main(void)\n{{\n{c}}}\n"
            ),
        ),
        ("page.cpp", format!("#include <palpate.hpp>\nint main() {{\n{cpp}}}\n")),
    ];
    let folder = tempfile::tempdir().unwrap();
    for [c, cpp] in compilers() {
        for ((name, text), compiler) in around.iter().zip([c, cpp]) {
            let file = folder.path().join(name);
            std::fs::write(&file, text).unwrap();
            let mut command = Command::new(compiler);
            let standard = if name.ends_with("cpp") { "-std=c++17" } else { "-std=c11" };
            command
                .args([standard, "-fsyntax-only"])
                .arg("-I")
                .arg(here("include"))
                .arg("-I")
                .arg(here("cpp"))
                .arg(&file);
            run(&mut command);
        }
    }
}
