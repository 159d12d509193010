//! Programs in C, C++ and C#, built with each compiler that is there and run: examples from a folder that holds no more than a tarball, one
//! path through Rust and each of them, and misuse under sanitizers. A compiler or tool that is missing is named on standard error.

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

/// The C# binding, its example and its tests as Mono compiles them, beside the library under the name that they look for; none without
/// Mono.
fn csharp() -> Option<&'static Path> {
    static FOLDER: OnceLock<Option<tempfile::TempDir>> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        if !is_there("mcs") || !is_there("mono") {
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let compile = |name: &str, sources: &str, references: &[&str]| {
            let files =
                std::fs::read_dir(here("../csharp").join(sources.split('/').next().unwrap())).unwrap();
            let wanted = sources.split('/').nth(1);
            let files = files
                .map(|file| file.unwrap().path())
                .filter(|p| p.extension().is_some_and(|e| e == "cs"))
                .filter(|p| wanted.is_none_or(|name| p.file_name().is_some_and(|n| n == name)));
            let mut command = Command::new("mcs");
            command.arg(if name.ends_with("dll") { "-target:library" } else { "-target:exe" });
            command.args(["-langversion:7", "-warnaserror"]).arg(format!("-out:{name}")).args(files);
            command.args(references.iter().map(|r| format!("-r:{r}"))).current_dir(folder.path());
            run(&mut command);
        };
        compile("Palpate.dll", "Palpate", &[]);
        compile("Example.exe", "Example", &["Palpate.dll"]);
        compile("UnityEngine.dll", "Tests/UnityStandIn.cs", &[]);
        compile("Palpate.Unity.dll", "Unity", &["Palpate.dll", "UnityEngine.dll"]);
        compile("Tests.exe", "Tests/Tests.cs", &["Palpate.dll", "UnityEngine.dll", "Palpate.Unity.dll"]);
        std::os::unix::fs::symlink(libraries().join("libpalpate_c.so"), folder.path().join("libpalpate.so"))
            .unwrap();
        Some(folder)
    });
    folder.as_ref().map(tempfile::TempDir::path)
}

fn mono(folder: &Path, program: &str, arguments: &[&std::ffi::OsStr]) -> String {
    let mut command = Command::new("mono");
    command.arg(folder.join(program)).args(arguments).env("LD_LIBRARY_PATH", folder);
    String::from_utf8(run(&mut command).stdout).unwrap()
}

#[test]
fn one_path_has_the_same_bits_in_csharp() {
    let Some(programs) = csharp() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (bodies, path, rows) = bodies_and_path(folder.path());
    for file in &bodies {
        let (expected, _) = bits_of(&Body::open(file).unwrap(), &rows);
        let output = mono(programs, "Example.exe", &[file.as_os_str(), path.as_os_str()]);
        for way in ["step", "rollout", "many"] {
            let found = output.lines().filter_map(|line| line.strip_prefix(way));
            assert!(found.eq(expected.lines()), "C#, {way}: other bits than Rust's");
        }
        assert_eq!(output.lines().count(), 3 * rows.len());
    }
    assert!(mono(programs, "Example.exe", &[]).contains("mm deep"));
}

/// The members of a C# struct have other names: `delta_z_m` is `DeltaZM`.
fn pascal(name: &str) -> String {
    let mut upper = true;
    let letters = name.chars().filter_map(|c| {
        let begins = std::mem::replace(&mut upper, c == '_');
        (c != '_').then(|| if begins { c.to_ascii_uppercase() } else { c })
    });
    letters.collect()
}

#[test]
fn csharps_structs_are_laid_out_as_cs() {
    let Some(programs) = csharp() else { return };
    let abi = std::fs::read_to_string(here("abi.txt")).unwrap();
    let layout = |line: &str| -> Option<(String, String)> {
        let (name, rest) = line.split_once(' ')?;
        let (bytes, members) = rest.split_once(" bytes: ")?;
        let members = members.split(", ").map(|m| {
            let (member, place) = m.split_once(' ').unwrap();
            format!("{} {place}", pascal(member))
        });
        let name = pascal(name.trim_start_matches("palpate_")).replace("Native", "");
        Some((name, format!("{bytes} {}", members.collect::<Vec<_>>().join(", "))))
    };
    let there: std::collections::BTreeMap<_, _> =
        abi.lines().filter_map(|line| layout(line.strip_prefix("layout ")?)).collect();
    let found = mono(programs, "Tests.exe", &["layouts".as_ref()]);
    let found: std::collections::BTreeMap<_, _> = found.lines().filter_map(layout).collect();
    for (name, layout) in &found {
        assert_eq!(there.get(name), Some(layout), "{name}");
    }
    // A device of the caller's would put C#'s garbage collector into the haptic thread; handles are no structs there.
    let absent = ["Body", "Capabilities", "Command", "Contact", "Device", "Sample", "Session"];
    let missing: Vec<&String> = there.keys().filter(|name| !found.contains_key(*name)).collect();
    assert_eq!(missing, absent);
    // And every function is there.
    let native = std::fs::read_to_string(here("../csharp/Palpate/Native.cs")).unwrap();
    for line in abi.lines().filter(|line| line.contains("(") && !line.starts_with("typedef")) {
        let name = line.split('(').next().unwrap().rsplit([' ', '*']).next().unwrap();
        let is_declared = native.contains(&format!(" {name}("));
        assert!(is_declared || name == "palpate_device_check", "{name} is not in Native.cs");
    }
}

#[test]
fn csharp_does_what_it_says() {
    let Some(programs) = csharp() else { return };
    let folder = tempfile::tempdir().unwrap();
    let said = mono(programs, "Tests.exe", &["all".as_ref(), folder.path().as_os_str()]);
    assert!(said.contains("all is well"), "{said}");
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
            // Of what the library's own threads agree upon a sanitizer that did not compile it knows half, and complains of the rest: it
            // looks at the C side. `.ci/thread-sanitizer` looks at the library.
            let only = options.contains(&"-fsanitize=thread").then_some("threads");
            let passed_over = folder.path().join("passed-over");
            std::fs::write(&passed_over, "called_from_lib:libpalpate\n").unwrap();
            let mut command = Command::new(&program);
            command.env("TSAN_OPTIONS", format!("suppressions={}", passed_over.display()));
            run(command.args(only).current_dir(folder.path()));
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
