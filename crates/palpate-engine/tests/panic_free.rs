//! The step cannot panic, allocate, lock, log, read a clock or a file: a proof over the machine code of the release
//! build.
//!
//! The assembly of the engine and of the crates it calls is written out, and the calls that can be reached from
//! `Contact::step` are followed. Every one must lead to a function in that same assembly, or to the C library's
//! memory moves; a call through a pointer is refused, since it could lead anywhere. What is not called is not done.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

const HARMLESS: [&str; 5] = ["memcpy", "memmove", "memset", "memcmp", "bcmp"];

/// Crates whose code a step may run, leaves first; `glam` is all inlined.
const CRATES: [&str; 3] = ["libm", "palpate-body", "palpate-engine"];

fn assembly(crate_name: &str, target: &Path) -> String {
    let status = Command::new(env!("CARGO"))
        .args(["rustc", "--release", "--lib", "--quiet", "-p", crate_name, "--target-dir"])
        .arg(target)
        .args(["--", "--emit", "asm", "-C", "codegen-units=1", "-C", "debuginfo=0"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        // A test run's own flags (coverage, sanitizers) would end up in the code that is looked at.
        .env_remove("RUSTFLAGS")
        .status()
        .unwrap();
    assert!(status.success(), "cargo rustc -p {crate_name}");
    let prefix = format!("{}-", crate_name.replace('-', "_"));
    let files = std::fs::read_dir(target.join("release/deps")).unwrap().map(|f| f.unwrap().path());
    let newest = files
        .filter(|f| f.extension().is_some_and(|e| e == "s"))
        .filter(|f| f.file_name().is_some_and(|n| n.to_string_lossy().starts_with(&prefix)))
        .max_by_key(|f| f.metadata().and_then(|m| m.modified()).unwrap());
    std::fs::read_to_string(newest.unwrap()).unwrap()
}

/// Callees of each function; `None` stands for a call through a pointer.
type Calls = BTreeMap<String, BTreeSet<Option<String>>>;

fn calls(assembly: &str) -> Calls {
    let functions: BTreeSet<&str> = assembly
        .lines()
        .filter_map(|l| l.trim().strip_prefix(".type")?.trim().strip_suffix(",@function"))
        .collect();
    let mut bodies: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    let mut current: Option<&str> = None;
    for line in assembly.lines() {
        if let Some(label) = line.strip_suffix(':').filter(|l| functions.contains(l)) {
            current = Some(label);
        }
        if let Some(function) = current {
            bodies.entry(function).or_default().push(line);
        }
    }
    bodies.into_iter().map(|(function, body)| (function.to_string(), callees(&body))).collect()
}

fn callees(body: &[&str]) -> BTreeSet<Option<String>> {
    let mut found = BTreeSet::new();
    // Function addresses in the registers that a call preserves, along a stretch without labels.
    let mut held: BTreeMap<&str, String> = BTreeMap::new();
    for line in body {
        let mut words = line.split_whitespace();
        let Some(operation) = words.next() else { continue };
        if operation.ends_with(':') {
            held.clear();
        }
        let Some(operand) = words.next() else { continue };
        let jump = operation.starts_with('j');
        if !operation.starts_with("call") && !jump {
            let written = line.rsplit([',', ' ', '\t']).next().unwrap_or("");
            held.retain(|register, _| !same_register(register, written));
            let load = operand.split_once("@GOTPCREL").filter(|_| operation == "movq");
            if let (Some((symbol, _)), Some(register)) = (load, PRESERVED.iter().find(|r| **r == written)) {
                held.insert(register, symbol.to_string());
            }
            continue;
        }
        match operand.strip_prefix('*') {
            // Jumps within the function go to local labels, or through a table of them.
            _ if operand.starts_with(".L") => {}
            None => {
                found.insert(Some(operand.trim_end_matches("@PLT").to_string()));
            }
            Some(slot) if slot.contains("@GOTPCREL") => {
                found.insert(slot.split('@').next().map(String::from));
            }
            Some(_) if jump && body.iter().any(|l| l.contains(".LJTI")) => {}
            Some(register) => {
                found.insert(held.get(register).cloned());
            }
        }
    }
    found
}

const PRESERVED: [&str; 6] = ["%rbx", "%rbp", "%r12", "%r13", "%r14", "%r15"];

/// Whether an operand is the register or a part of it.
fn same_register(register: &str, operand: &str) -> bool {
    let number = &register[2..];
    operand
        .strip_prefix('%')
        .is_some_and(|o| o.contains(&number[..number.len().min(2)]) || o.starts_with(&number[..1]))
}

fn reachable(calls: &Calls, from: &str) -> Result<BTreeSet<String>, String> {
    let (mut seen, mut waiting) = (BTreeSet::from([from.to_string()]), vec![from.to_string()]);
    while let Some(function) = waiting.pop() {
        for callee in calls.get(&function).ok_or_else(|| format!("{function} is not in the assembly"))? {
            match callee {
                None => return Err(format!("{function} calls through a pointer")),
                Some(name) if HARMLESS.contains(&name.as_str()) => {}
                Some(name) if calls.contains_key(name) => {
                    if seen.insert(name.clone()) {
                        waiting.push(name.clone());
                    }
                }
                Some(name) => return Err(format!("{function} calls {name}")),
            }
        }
    }
    Ok(seen)
}

#[test]
#[cfg(target_arch = "x86_64")]
fn nothing_that_a_step_calls_can_panic_allocate_lock_or_wait() {
    let target: PathBuf = Path::new(env!("CARGO_TARGET_TMPDIR")).join("panic-free");
    let mut all = Calls::new();
    for name in CRATES {
        all.extend(calls(&assembly(name, &target)));
    }
    let find = |part: &str| all.keys().find(|f| f.contains(part)).cloned();
    let step = find("palpate_engine7contact7Contact4step").unwrap();
    let reached = reachable(&all, &step).unwrap_or_else(|e| panic!("{e}"));
    assert!(reached.iter().any(|f| f.contains("slip")), "the slip search is part of it: {reached:?}");
    let each = reached.iter().filter(|f| f.contains("Contact7step_as")).count();
    assert_eq!(each, 2 * 3, "isotropic and anisotropic bodies, three slip rules: {reached:?}");

    // That the check can fail: making a body allocates.
    let new = find("palpate_body4body4Body3new").unwrap();
    assert!(reachable(&all, &new).is_err());
}
