//! The committed header against the sources it is made of, and the interface against its version.
//!
//! After a change: `PALPATE_BLESS=1 cargo test -p palpate-c --test header` writes `include/palpate.h`, `docs/c-reference.md` and `abi.txt`
//! anew, the last only where nothing that was there is gone or other, or `PALPATE_ABI_VERSION` is.

use palpate::runtime::Record;
use palpate_c::*;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::mem::offset_of;
use std::path::{Path, PathBuf};

fn here(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(file)
}

fn blessing() -> bool {
    std::env::var_os("PALPATE_BLESS").is_some()
}

fn generated() -> String {
    let config = cbindgen::Config::from_file(here("cbindgen.toml")).unwrap();
    // It follows the modules from there.
    let builder = cbindgen::Builder::new().with_config(config).with_src(here("src/lib.rs"));
    let mut text = Vec::new();
    builder.generate().unwrap().write(&mut text);
    String::from_utf8(text).unwrap()
}

#[test]
fn the_header_is_what_the_sources_say() {
    let (path, header) = (here("include/palpate.h"), generated());
    if blessing() {
        fs::write(&path, &header).unwrap();
    }
    let committed = fs::read_to_string(&path).unwrap();
    let differ = committed.lines().zip(header.lines()).position(|(a, b)| a != b);
    assert!(
        committed == header,
        "include/palpate.h differs from the sources, first in line {:?}: write it anew with PALPATE_BLESS=1",
        differ.map(|line| line + 1)
    );
}

/// A struct's name, size, and its members' places.
type Layout = (&'static str, usize, Vec<(&'static str, usize)>);

macro_rules! layouts {
    ($($name:ident: $($member:ident),+;)+) => {
        vec![$((stringify!($name), size_of::<$name>(), vec![$((stringify!($member), offset_of!($name, $member))),+])),+]
    };
}

/// As Rust lays them out.
fn layouts() -> Vec<Layout> {
    layouts! {
        palpate_error: struct_size, status, message;
        palpate_body: id;
        palpate_contact: id;
        palpate_session: id;
        palpate_body_info: struct_size, slip_rule, has_tank, is_coupled, is_isotropic, tool, tool_radius_m, nodes, vertices, elements, test_points, identity, low_m, high_m, depth_max_m, stiffness_max_n_per_m, stiffness_aside_n_per_m;
        palpate_loop_device: struct_size, reserved, damping_n_s_per_m, rate_hz, position_error_m, coulomb_n, delay_samples;
        palpate_certify_options: struct_size, slip_rule, evaluations, threads, step_m, depth_m, device;
        palpate_certificate: struct_size, slip_rule, passive_holds, snap_free_holds, passive_margin, passive_found, passive_proved_elements, passive_failing_elements, passive_undecided_elements, passive_worst_element, snap_free_worst_element, passive_worst_m, snap_free_margin_n_per_m, snap_free_found_n_per_m, snap_free_proved_elements, snap_free_failing_elements, snap_free_undecided_elements, snap_free_worst_m, lipschitz_n_per_m, lipschitz_found_n_per_m, stiffness_max_n_per_m, depth_m, step_m, lateral_m, passive_from_m, elements, border_edges, creased_elements, too_far_elements, device_stiffness_limit_n_per_m, device_depth_limit_m, device_force_limit_n, device_contact_way_ratio, device_whole_depth, reserved;
        palpate_tool_state: struct_size, reserved, position_m, orientation;
        palpate_ledger: struct_size, reserved, work_j, stored_j, dissipated_j, generated_j, tank_j, relaxed_j;
        palpate_output: struct_size, flags, force_n, torque_nm, element, reserved, area_coordinates, contact_position_m, delta_z_m, delta_r_m, energy;
        palpate_counters: struct_size, reserved, steps, onsets, slips, evaluations, crossings, queries, blocked, fenced, capped, held_back, invalid_poses, invalid_times, contained;
        palpate_contact_options: struct_size, abi_version, slip_rule, tank, ablation, reserved, friction_scale;
        palpate_path: struct_size, reserved, count, times_s, positions_m, orientations;
        palpate_trace: struct_size, reserved, forces_n, torques_nm, flags, energies, outputs;
        palpate_capabilities: struct_size, basis, name, source, max_force_n, max_torque_nm, max_stiffness_n_per_m, workspace_centre_m, workspace_half_extent_m, sensed_translations, sensed_rotations, driven_translations, driven_rotations, buttons, sets_pace, least_hz, usual_hz, most_hz, velocity_delay_s, mass_kg, damping_n_s_per_m, coulomb_n, resolution_m, delay_s, lag_s, slew_n_per_s;
        palpate_sample: struct_size, status, sequence, position_m, orientation, velocity_m_per_s, angular_velocity_rad_per_s, buttons, reserved;
        palpate_command: struct_size, reserved, force_n, torque_nm;
        palpate_device: struct_size, abi_version, user, open, read, write, close, emergency_stop, explain;
        palpate_record: struct_size, reserved, kind, stage_flags, number, time_s, started_ns, lateness_ns, period_ns, step_ns, read_ns, write_ns, fault, fault_code, device_sequence, device_position_m, device_orientation, device_velocity_m_per_s, device_buttons, device_status, tool_position_m, tool_orientation, force_n, torque_nm, area_coordinates, contact_position_m, delta_z_m, delta_r_m, element, engine_flags, work_j, stored_j, dissipated_j, generated_j, out_j, squares_m2, observed_j, command_force_n, command_torque_nm, patch_centre_m, patch_serial, patch_count, spare_half, patch_waits, minor_faults, major_faults, device_angular_velocity_rad_per_s, squares_rad2, friction_scale, tank_j, spare, slip_rule_code, crc;
        palpate_outcome: struct_size, end, is_well, is_recording_cut, periods, periods_in_contact, overruns, recorded, force_max_n, torque_max_nm, message;
        palpate_sample_row: point, component, position_m, deflection_m, value;
        palpate_body_arrays: struct_size, abi_version, positions_m, vertex_count, triangles, triangle_count, samples, sample_count, sample_size, is_open, crease_angle_rad, default_friction, tool_radius_m, slip_rule, without_tank, between, reserved;
        palpate_progress: struct_size, reserved, points_done, points, message;
    }
}

/// Without comments, and with what a backslash continues in one line.
fn bare(header: &str) -> String {
    let (mut text, mut rest) = (String::new(), header);
    while let Some((before, comment)) = rest.split_once("/*") {
        text.push_str(before);
        rest = comment.split_once("*/").unwrap().1;
    }
    text.push_str(rest);
    let is_code = |line: &&str| !line.trim_start().starts_with("//");
    text.replace("\\\n", " ").lines().filter(is_code).collect::<Vec<_>>().join("\n")
}

fn words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace("( ", "(").replace(" )", ")")
}

/// Constants, types and functions of a header, each in one line. What only begins structs (`..._INIT`) and the version are not among
/// them.
fn declarations(header: &str) -> BTreeSet<String> {
    let text = bare(header);
    let (directives, code): (Vec<&str>, Vec<&str>) =
        text.lines().partition(|line| line.trim_start().starts_with('#'));
    let constants = directives.into_iter().filter(|d| {
        d.starts_with("#define PALPATE_")
            && !d.contains("_INIT")
            && !d.ends_with("PALPATE_H")
            && !d.contains("PALPATE_ABI_VERSION")
    });
    let mut found: BTreeSet<String> = constants.map(words).collect();
    let code = code.join(" ").replace("extern \"C\" {", " ").replace("}  // extern \"C\"", " ");
    let (mut depth, mut one) = (0, String::new());
    for c in code.chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ';' && depth == 0 {
            assert!(found.insert(words(&one)), "twice in the header: {one}");
            one.clear();
        } else {
            one.push(c);
        }
    }
    assert_eq!(words(&one), "", "what ends the header is no declaration");
    found
}

/// The members of each struct of a header.
fn members(header: &str) -> BTreeMap<String, Vec<String>> {
    let structs = declarations(header).into_iter().filter_map(|d| {
        let (head, rest) = d.strip_prefix("typedef struct ")?.split_once(" {")?;
        let body = rest.rsplit_once('}')?.0;
        // A member's name comes last, before its count; a pointer to a function has it behind the star.
        let name = |m: &str| {
            let m = m.trim();
            let name = match m.split_once("(*") {
                Some((_, function)) => function.split_once(')').unwrap().0,
                None => m.split('[').next().unwrap().rsplit([' ', '*']).next().unwrap(),
            };
            name.to_owned()
        };
        Some((head.to_owned(), body.split(';').filter(|m| !m.trim().is_empty()).map(name).collect()))
    });
    structs.collect()
}

#[test]
fn every_struct_of_the_header_is_looked_at() {
    let header = generated();
    let there = members(&header);
    let known: BTreeMap<String, Vec<String>> = layouts()
        .into_iter()
        .map(|(name, _, members)| (name.to_owned(), members.iter().map(|m| m.0.to_owned()).collect()))
        .collect();
    assert_eq!(there, known);
    for (name, members) in there.iter().filter(|(_, members)| members[0] != "id") {
        // A row's size is in the struct that leads to it.
        assert!(
            members[0] == "struct_size" || name == "palpate_sample_row",
            "{name} does not begin with its size"
        );
    }
}

/// `abi.txt` of these sources.
fn interface() -> String {
    let header = generated();
    let mut text = format!("abi_version {PALPATE_ABI_VERSION}\n");
    for (name, bytes, members) in layouts() {
        let places: Vec<String> = members.iter().map(|(member, at)| format!("{member} {at}")).collect();
        text.push_str(&format!("layout {name} {bytes} bytes: {}\n", places.join(", ")));
    }
    declarations(&header).iter().for_each(|d| text.push_str(&format!("{d}\n")));
    text
}

/// What of the old interface a program compiled with it would miss; nothing where the version is another.
fn missing<'a>(old: &'a str, new: &str) -> Vec<&'a str> {
    if old.lines().next() != new.lines().next() {
        return Vec::new();
    }
    let there: BTreeSet<&str> = new.lines().collect();
    old.lines().filter(|line| !there.contains(line)).collect()
}

/// Places are those of 64-bit machines.
#[cfg(target_pointer_width = "64")]
#[test]
fn the_interface_changes_with_its_version() {
    let (path, now) = (here("abi.txt"), interface());
    let old = fs::read_to_string(&path).unwrap_or_default();
    let gone = missing(&old, &now);
    assert!(gone.is_empty(), "raise PALPATE_ABI_VERSION, or take the change back: {gone:#?}");
    if blessing() {
        fs::write(&path, &now).unwrap();
    }
    assert!(
        now == fs::read_to_string(&path).unwrap(),
        "abi.txt does not have all of the interface: write it anew with PALPATE_BLESS=1"
    );
}

/// That the check above sees a change of a layout, a constant, and a signature, and lets additions pass.
#[test]
fn a_change_without_a_version_is_seen() {
    let old = interface();
    assert!(missing(&old, &format!("{old}palpate_status palpate_new(void)\n")).is_empty());
    for (from, to) in [
        ("delta_z_m 112", "delta_z_m 120"),
        ("#define PALPATE_STATUS_BUSY 5", "#define PALPATE_STATUS_BUSY 6"),
        ("double dt_s", "float dt_s"),
    ] {
        let new = old.replace(from, to);
        assert!(new != old && !missing(&old, &new).is_empty(), "{from}");
        assert!(missing(&old, &new.replacen("abi_version 2", "abi_version 3", 1)).is_empty());
    }
}

/// A session's record is copied as it lies in memory.
#[test]
fn a_record_has_the_members_of_the_runtimes() {
    let layouts = layouts();
    let (_, _, members) = layouts.iter().find(|(name, ..)| *name == "palpate_record").unwrap();
    let fields = Record::fields();
    assert_eq!(members.len(), 2 + fields.len());
    for ((member, at), field) in members[2..].iter().zip(&fields) {
        assert_eq!((*member, *at), (field.name.as_str(), 8 + field.offset as usize));
    }
}

/// The flags and rules that the header numbers are the engine's.
#[test]
fn flags_are_the_engines() {
    let header = generated();
    for (name, flag) in palpate::engine::Flags::NAMED {
        let name = if name == "fenced" { "patch_boundary" } else { name };
        let line = format!("#define PALPATE_FLAG_{} {}\n", name.to_uppercase(), flag.bits());
        assert!(header.contains(&line), "{line}");
    }
}

/// `docs/c-reference.md` of a header: constants, structs and functions with what is said of them, in the header's order.
fn reference(header: &str) -> String {
    let code = header.split_once("#include <stdint.h>").unwrap().1.replace("\\\n", " ");
    let (mut constants, mut structs, mut functions) = (String::new(), String::new(), String::new());
    let (mut about, mut lines) = (String::new(), code.lines());
    while let Some(line) = lines.next() {
        if let Some(words) = line.strip_prefix("//") {
            about = words_of(about, words);
            continue;
        }
        let said = std::mem::take(&mut about);
        if let Some(define) = line.strip_prefix("#define PALPATE_").filter(|d| !d.contains("_INIT")) {
            let (name, value) = define.split_once(' ').unwrap();
            constants.push_str(&format!("| `PALPATE_{name}` | {value} | {said} |\n"));
        } else if let Some(name) = line.strip_prefix("typedef struct ").and_then(|l| l.strip_suffix(" {")) {
            structs.push_str(&format!("### `{name}`\n\n{said}\n\n| member | |\n|---|---|\n"));
            let (mut about, mut member) = (String::new(), String::new());
            for line in lines.by_ref().take_while(|line| !line.starts_with('}')).map(str::trim) {
                match line.strip_prefix("//") {
                    Some(more) => about = words_of(about, more),
                    None => member = format!("{member} {line}"),
                }
                if line.ends_with(';') && !line.starts_with("//") {
                    let declared = words(member.trim_end_matches(';')).replace("struct ", "");
                    structs.push_str(&format!("| `{declared}` | {about} |\n"));
                    (about, member) = Default::default();
                }
            }
            structs.push('\n');
        } else if line.starts_with("typedef ") || line.contains("palpate_") && !line.starts_with('#') {
            let mut declared = line.to_owned();
            while !declared.ends_with(';') {
                declared.push(' ');
                declared.push_str(lines.next().unwrap().trim());
            }
            let declared = words(&declared).replace("struct ", "");
            let to = if declared.starts_with("typedef") { &mut structs } else { &mut functions };
            let name =
                declared.split('(').next().unwrap().rsplit([' ', '*']).next().unwrap().trim_end_matches(';');
            let title = if declared.starts_with("typedef") {
                declared.split("(*").nth(1).map_or(name, |rest| rest.split(')').next().unwrap())
            } else {
                name
            };
            to.push_str(&format!("### `{title}`\n\n```c\n{declared}\n```\n\n{said}\n\n"));
        }
    }
    format!(
        "# The C interface, function by function\n\nMade of `bindings/c/include/palpate.h`, whose first page says what holds for all of it: \
         units and frames, statuses, handles, sizes, pointers. [c.md](c.md) says where to begin.\n\n\
         ## Functions\n\n{functions}## Structs and types\n\n{structs}## Constants\n\n| name | value | |\n|---|---|---|\n{constants}"
    )
}

fn words_of(before: String, more: &str) -> String {
    let more = more.trim().replace('|', "\\|");
    if before.is_empty() { more } else { format!("{before} {more}") }
}

#[test]
fn the_reference_is_the_headers() {
    let (path, reference) = (here("../../docs/c-reference.md"), reference(&generated()));
    if blessing() {
        fs::write(&path, &reference).unwrap();
    }
    assert!(
        fs::read_to_string(&path).unwrap_or_default() == reference,
        "docs/c-reference.md is not the header's: write it anew with PALPATE_BLESS=1"
    );
    let functions =
        declarations(&generated()).into_iter().filter(|d| d.contains('(') && !d.starts_with("typedef"));
    for function in functions {
        let name = function.split('(').next().unwrap().rsplit([' ', '*']).next().unwrap();
        assert!(reference.contains(&format!("### `{name}`\n")), "{name}");
    }
}
