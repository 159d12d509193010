//! A committed trace: the same bits on every x86-64 machine.
//!
//! Body and path are made with +, −, ×, ÷ and √ alone, so nothing but the engine can move a bit. After a change that is
//! meant to move some, run with `PALPATE_BLESS=1` and say why in the commit.

mod common;

use common::*;
use glam::DVec3;
use palpate_body::{Tensor, tensor};
use palpate_engine::{Ablation, Contact, Flags, Output};
use std::fmt::Write;

/// Press, drag over edges and vertices, jump, leave, return: 6,000 steps.
fn path() -> Vec<DVec3> {
    let mut path = Vec::new();
    let mut v = DVec3::new(1.0, 0.0, 0.0);
    for i in 0..6000u32 {
        let t = f64::from(i) / 6000.0;
        let depth = match i % 1500 {
            k @ 0..300 => 4e-3 * f64::from(k) / 300.0 - 1e-3,
            k @ 300..1200 => 3e-3 - 1e-3 * (f64::from(k) - 750.0).abs() / 450.0,
            k => 2e-3 - 1.2e-5 * f64::from(k - 1200) * f64::from(k - 1200) / 100.0,
        };
        // A turning direction without a sine: each step adds a little of a vector at right angles.
        v = (v + v.cross(DVec3::new(0.3, 0.2, 1.0 - t)) * 4e-3 + DVec3::new(0.0, 0.0, 1e-4)).normalize();
        let jump = if i % 997 == 0 { 1.5e-3 } else { 0.0 };
        path.push(v * (0.03 - depth) + DVec3::new(jump, -jump, 0.0));
    }
    path
}

fn trace(ablation: Ablation, radius_m: f64, friction: f64, ratio: f64) -> Vec<Output> {
    let mesh = ellipsoid(DVec3::new(0.03, 0.029, 0.031), 2);
    let surface = palpate_body::Surface::build(&mesh, f64::INFINITY).unwrap();
    let kz = |p: DVec3| 600.0 * (1.0 + 0.4 * p.x / 0.03 - 0.2 * p.y * p.z / 9e-4);
    let kr = |p: DVec3| 500.0 * (1.0 + 0.3 * p.z / 0.03);
    let feel = Feel { kz: &kz, kr: &kr, friction: &|_| friction, radius_m };
    let fibres = |p: DVec3, u: DVec3| tensor::along(DVec3::new(0.3, 0.2, 0.4) + p * 5.0, ratio, u).unwrap();
    let body = stretched(surface, feel, (ratio != 1.0).then_some(&fibres as &dyn Fn(DVec3, DVec3) -> Tensor));
    let mut contact = Contact::with_ablation(&body, ablation);
    path().into_iter().map(|p| step(&mut contact, &body, p * (1.0 + radius_m / 0.03))).collect()
}

fn digest(outputs: &[Output]) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let mut eat = |x: f64| {
        for byte in x.to_bits().to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for o in outputs {
        o.force_n.into_iter().for_each(&mut eat);
        if let Some(c) = o.contact {
            c.position_m
                .into_iter()
                .chain([c.delta_z_m, c.delta_r_m, f64::from(c.element)])
                .for_each(&mut eat);
        }
        let e = o.energy;
        [e.work_j, e.stored_j, e.dissipated_j, e.generated_j].into_iter().for_each(&mut eat);
    }
    hash
}

#[test]
fn the_golden_trace_is_the_same_to_the_bit() {
    let cases = [
        ("point", Ablation::None, 0.0, 0.3, 1.0),
        ("frictionless", Ablation::None, 0.0, 0.0, 1.0),
        ("sphere", Ablation::None, 3e-3, 0.3, 1.0),
        ("coordinates-off", Ablation::Coordinates, 0.0, 0.3, 1.0),
        ("responses-off", Ablation::Responses, 0.0, 0.3, 1.0),
        ("anisotropic", Ablation::None, 0.0, 0.3, 2.0),
        ("anisotropic-sphere", Ablation::None, 3e-3, 0.1, 4.0),
    ];
    let mut text = String::from(
        "# case,step,force bits (x, y, z), contact point bits (x, y, z); `all` is a digest of every output\n",
    );
    for (name, ablation, radius, friction, ratio) in cases {
        let outputs = trace(ablation, radius, friction, ratio);
        assert!(outputs.iter().filter(|o| o.flags.has(Flags::IN_CONTACT)).count() > 3000, "{name}");
        for (i, o) in outputs.iter().enumerate().step_by(250) {
            let c = o.contact.map_or([0.0; 3], |c| c.position_m);
            let _ = write!(text, "{name},{i}");
            for x in o.force_n.into_iter().chain(c) {
                let _ = write!(text, ",{:016x}", x.to_bits());
            }
            text.push('\n');
        }
        let _ = writeln!(text, "{name},all,{:016x}", digest(&outputs));
    }
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/trace.csv");
    if std::env::var_os("PALPATE_BLESS").is_some() {
        std::fs::write(file, &text).unwrap();
    }
    let golden = std::fs::read_to_string(file).unwrap();
    for (now, then) in text.lines().zip(golden.lines()) {
        assert_eq!(now, then, "the trace has moved");
    }
    assert_eq!(text.lines().count(), golden.lines().count());
}
