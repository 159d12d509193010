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

/// What is known of a register.
#[derive(Clone, PartialEq)]
enum Held<'a> {
    /// A function's address.
    Function(&'a str),
    /// A jump table's address.
    Table(&'a str),
    /// An entry of it: how far its target is from the table.
    Entry(&'a str),
    /// The sum of both.
    Target(&'a str),
}

/// What is known of the registers.
type Registers<'a> = BTreeMap<&'a str, Held<'a>>;

/// The callees of a function. What is known at a label is what all ways to it agree on.
fn callees(body: &[&str]) -> BTreeSet<Option<String>> {
    let mut at_labels = BTreeMap::new();
    loop {
        let before = at_labels.clone();
        let found = walk(body, &mut at_labels);
        if at_labels == before {
            return found;
        }
    }
}

/// Once through the body; `at_labels` holds what is known at labels, and only ever loses some of it.
fn walk<'a>(body: &[&'a str], at_labels: &mut BTreeMap<&'a str, Registers<'a>>) -> BTreeSet<Option<String>> {
    let mut found = BTreeSet::new();
    // None where the line before does not go on.
    let mut held: Option<Registers> = Some(BTreeMap::new());
    fn meet<'a>(known: &mut BTreeMap<&'a str, Registers<'a>>, label: &'a str, way: &Registers<'a>) {
        match known.get_mut(label) {
            Some(known) => known.retain(|register, value| way.get(register) == Some(value)),
            None => drop(known.insert(label, way.clone())),
        }
    }
    for line in body {
        let mut words = line.split_whitespace();
        let Some(operation) = words.next() else { continue };
        if let Some(label) = operation.strip_suffix(':') {
            if let Some(held) = &held {
                meet(at_labels, label, held);
            }
            held = match at_labels.get(label) {
                Some(known) if label.starts_with(".LBB") => Some(known.clone()),
                // Reached from farther down alone: known the next time.
                None if is_target(body, label) => None,
                // Whatever else leads to a label, such as unwinding, knows nothing.
                _ => Some(BTreeMap::new()),
            };
        }
        if operation.ends_with(':') || operation.starts_with('.') {
            continue;
        }
        let Some(known) = &mut held else { continue };
        let operands: Vec<&str> = words.flat_map(|w| w.split_inclusive([')', ','])).collect();
        let (first, operands) = (operands.first().copied(), operands.concat());
        let jump = operation.starts_with('j');
        if !operation.starts_with("call") && !jump {
            follow(known, body, operation, &operands);
            if operation.starts_with("ret") || operation.starts_with("ud2") {
                held = None;
            }
            continue;
        }
        match operands.strip_prefix('*') {
            _ if operands.starts_with(".L") => {
                let label = first.and_then(|l| l.starts_with(".LBB").then_some(l));
                label.iter().for_each(|label| meet(at_labels, label, known));
            }
            None => {
                found.insert(Some(operands.trim_end_matches("@PLT").to_string()));
            }
            Some(slot) if slot.contains("@GOTPCREL") => {
                found.insert(slot.split('@').next().map(String::from));
            }
            Some(register) => match family(register).and_then(|r| known.get(r)) {
                Some(Held::Target(table)) if jump => {
                    own_table(body, table)
                        .iter()
                        .flat_map(|(_, labels)| labels)
                        .for_each(|l| meet(at_labels, l, known));
                }
                Some(Held::Function(name)) => {
                    found.insert(Some(name.to_string()));
                }
                _ => {
                    found.insert(None);
                }
            },
        }
        if !jump {
            known.retain(|register, _| PRESERVED.contains(register));
        } else if operation.starts_with("jmp") {
            held = None;
        }
    }
    found
}

/// Whether a jump or a jump table names it.
fn is_target(body: &[&str], label: &str) -> bool {
    let names = |line: &&str| {
        let mut words = line.split_whitespace();
        let (first, second) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        first.starts_with('j') && second == label
            || first == ".long" && second.split('-').next() == Some(label)
    };
    body.iter().any(names)
}

/// What an instruction that neither calls nor jumps makes of the registers.
fn follow<'a>(held: &mut BTreeMap<&'a str, Held<'a>>, body: &[&'a str], operation: &str, operands: &str) {
    let product = ["mul", "div", "imul", "idiv"]
        .iter()
        .any(|o| operation.strip_prefix(o).is_some_and(|size| ["b", "w", "l", "q"].contains(&size)));
    if product && !operands.contains(',') {
        held.retain(|register, _| !["ax", "dx"].contains(register));
        return;
    }
    // Those that write more than their last operand.
    let hidden = ["xchg", "xadd", "cmpxchg", "rep", "lock", "cpuid"];
    let several = hidden.iter().any(|o| operation.starts_with(o));
    let Some(written) = operands.rsplit(',').next().filter(|o| !o.is_empty() && !several) else {
        held.clear();
        return;
    };
    let Some(register) = family(written) else { return };
    let source = operands[..operands.len() - written.len()].trim_end_matches(',');
    // Names that live as long as the body.
    let name = |mark: &str| body.iter().find_map(|l| l.split([' ', '\t', '*']).find(|w| w.starts_with(mark)));
    let value = match operation {
        "movq" if source.starts_with('%') => family(source).and_then(|s| held.get(s)).cloned(),
        "movq" => source
            .split_once("@GOTPCREL")
            .and_then(|(symbol, _)| name(&format!("{symbol}@")))
            .and_then(|word| word.split('@').next())
            .map(Held::Function),
        "leaq" => source
            .strip_suffix("(%rip)")
            .and_then(|table| own_table(body, table))
            .map(|(table, _)| Held::Table(table)),
        "movslq" => (source.strip_prefix('(').and_then(|s| s.strip_suffix(",4)")))
            .and_then(|s| family(s.split(',').next()?))
            .and_then(|base| match held.get(base) {
                Some(Held::Table(table)) => Some(Held::Entry(table)),
                _ => None,
            }),
        "addq" => match (family(source).and_then(|s| held.get(s)), held.get(register)) {
            (Some(Held::Table(a)), Some(Held::Entry(b))) if a == b => Some(Held::Target(a)),
            (Some(Held::Entry(a)), Some(Held::Table(b))) if a == b => Some(Held::Target(a)),
            _ => None,
        },
        _ => None,
    };
    match value {
        Some(value) => held.insert(register, value),
        None => held.remove(register),
    };
}

/// The table's label and entries, if it stands in this function and leads to nothing but labels in it.
fn own_table<'a>(body: &[&'a str], table: &str) -> Option<(&'a str, Vec<&'a str>)> {
    let start = body.iter().position(|l| l.strip_suffix(':') == Some(table))?;
    let label = body[start].strip_suffix(':').filter(|l| l.starts_with(".LJTI"))?;
    let entries = body[start + 1..].iter().map_while(|l| l.trim().strip_prefix(".long"));
    let local = |entry: &'a str| {
        let target = entry.trim().strip_suffix(&format!("-{label}"))?;
        body.iter().any(|l| l.strip_suffix(':') == Some(target)).then_some(target)
    };
    let targets: Vec<&str> = entries.map(local).collect::<Option<_>>()?;
    (!targets.is_empty()).then_some((label, targets))
}

/// Registers that a call preserves.
const PRESERVED: [&str; 6] = ["bx", "bp", "12", "13", "14", "15"];

/// The register that an operand is, or is a part of.
fn family(operand: &str) -> Option<&'static str> {
    const NAMES: [&str; 16] =
        ["ax", "bx", "cx", "dx", "si", "di", "bp", "sp", "8", "9", "10", "11", "12", "13", "14", "15"];
    let name = operand.strip_prefix('%')?;
    let number = name.strip_prefix('r').map(|n| n.trim_end_matches(['d', 'w', 'b']));
    NAMES.into_iter().find(|&n| match n.parse::<u8>() {
        Ok(_) => number == Some(n),
        // rax, eax, ax, al, ah; rsi, esi, si, sil.
        Err(_) => {
            name.trim_start_matches(['r', 'e']) == n
                || name.strip_suffix(['l', 'h']).is_some_and(|s| s == n || s == n.trim_end_matches('x'))
        }
    })
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
    let each = reached.iter().filter(|f| f.contains("Contact7step_as17h")).count();
    assert_eq!(each, 3 * 3, "isotropic, anisotropic and coupled bodies, three slip rules: {reached:?}");

    // That the check can fail: making a body allocates.
    let new = find("palpate_body4body4Body3new").unwrap();
    assert!(reachable(&all, &new).is_err());
}

/// A jump through a register was accepted wherever the function had a jump table at all.
#[test]
fn only_a_functions_own_table_may_be_jumped_through() {
    let refused = |function: &str| {
        let table = "\t.section\t.rodata\n.LJTI0_0:\n\t.long\t.LBB0_1-.LJTI0_0\n\t.long\t.LBB0_2-.LJTI0_0\n";
        let other = "\t.type\tg,@function\ng:\n.LBB1_1:\n\tretq\n.LJTI1_0:\n\t.long\t.LBB1_1-.LJTI1_0\n";
        let text =
            format!("\t.type\tf,@function\nf:\n{function}.LBB0_1:\n\tretq\n.LBB0_2:\n\tretq\n{table}{other}");
        reachable(&calls(&text), "f").is_err()
    };
    let lines = |lines: &[&str]| lines.iter().map(|l| format!("\t{l}\n")).collect::<String>();
    let load = ["leaq\t.LJTI0_0(%rip), %rcx", "movslq\t(%rcx,%rax,4), %rdx", "addq\t%rcx, %rdx"];
    let with = |after: &[&str]| lines(&[&load[..], after].concat());

    assert!(!refused(&with(&["jmpq\t*%rdx"])));
    assert!(!refused(&with(&["movq\t%rax, (%rdx)", "xorl\t%ecx, %ecx", "jmpq\t*%rdx"])));
    // A jump to anywhere, beside a table.
    assert!(refused(&with(&["jmpq\t*%rax"])));
    assert!(refused(&lines(&["jmpq\t*%rax"])));
    // What was loaded is changed, or may be what another way to the label left there.
    assert!(refused(&with(&["movl\t%esi, %edx", "jmpq\t*%rdx"])));
    assert!(refused(&with(&["mulq\t%rsi", "jmpq\t*%rdx"])));
    assert!(refused(&with(&["callq\tg", "jmpq\t*%rdx"])));
    let after_label = |way: &str| format!("{way}{}.LBB0_3:\n\tjmpq\t*%rdx\n", with(&[]));
    assert!(!refused(&after_label("")));
    assert!(refused(&after_label("\tje\t.LBB0_3\n")));
    assert!(refused(&after_label("").replace("BB0_3", "tmp3")), "unwinding may lead there");
    // Also a way from below.
    let below = format!("\tje\t.LBB0_4\n{}.LBB0_4:\n\tmovl\t%esi, %edx\n\tjmp\t.LBB0_3\n", after_label(""));
    assert!(refused(&below));
    assert!(!refused(&below.replace("movl\t%esi, %edx", "jmp\t.LBB0_2")));
    // Half of it, and another function's table.
    assert!(refused(&lines(&[load[0], load[1], "jmpq\t*%rdx"])));
    assert!(refused(&lines(&[load[0], "jmpq\t*%rcx"])));
    assert!(refused(&with(&["jmpq\t*%rdx"]).replace("LJTI0_0", "LJTI1_0")));
    // Through a table nothing is called; through the global offset table what it names is.
    assert!(refused(&with(&["callq\t*%rdx"])));
    assert!(!refused(&lines(&["movq\tg@GOTPCREL(%rip), %r14", "callq\t*%r14", "callq\t*%r14"])));
    assert!(refused(&lines(&["movq\th@GOTPCREL(%rip), %r14", "callq\t*%r14"])));
    assert!(refused(&lines(&["movq\tg@GOTPCREL(%rip), %r14", "popq\t%r14", "callq\t*%r14"])));
    // From register to register.
    let moved = ["movq\tg@GOTPCREL(%rip), %r14", "movq\t%r14, %r12", "xorl\t%r14d, %r14d", "callq\t*%r12"];
    assert!(!refused(&lines(&moved)));
    assert!(refused(&lines(&[moved[0], moved[1], moved[2], "callq\t*%r14"])));
}
