//! A committed trace: the same bits on every x86-64 machine.
//!
//! Body and path are made with +, −, ×, ÷ and √ alone, so nothing but the engine can move a bit. After a change that is
//! meant to move some, run with `PALPATE_BLESS=1` and say why in the commit.

mod common;

#[path = "common/coupled.rs"]
mod coupled;

use common::*;
use glam::DVec3;
use palpate_body::{Body, BodyParts, Curve, Extension, Interpolation, Response, SlipRule, Tensor, tensor};
use palpate_engine::{Ablation, Contact, Flags, Output};
use palpate_identify::spread;
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

/// What a trace is made with.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    slip: SlipRule,
    ablation: Ablation,
    radius_m: f64,
    friction: f64,
    /// So many times as stiff laterally in one direction as in the other.
    ratio: f64,
    /// A test point at one vertex in so many.
    share: usize,
    /// Whether slip is kept from giving out energy.
    tank: bool,
    /// Whether the law is a coupled potential.
    coupled: bool,
    /// Whether friction counts the tool's way.
    curved: bool,
}

/// The paper's experiment.
const POINT: Case = Case {
    name: "point",
    slip: SlipRule::Paper,
    ablation: Ablation::None,
    radius_m: 0.0,
    friction: 0.3,
    ratio: 1.0,
    share: 1,
    tank: false,
    coupled: false,
    curved: false,
};

/// Every rule for a point and a sphere, for isotropic and anisotropic bodies, on curves of several knots with blends that
/// neighbours share or that go far.
const CASES: [Case; 28] = [
    POINT,
    Case { name: "frictionless", friction: 0.0, ..POINT },
    Case { name: "sphere", radius_m: 3e-3, ..POINT },
    Case { name: "coordinates-off", ablation: Ablation::Coordinates, ..POINT },
    Case { name: "responses-off", ablation: Ablation::Responses, ..POINT },
    Case { name: "anisotropic", ratio: 2.0, ..POINT },
    Case { name: "anisotropic-sphere", radius_m: 3e-3, friction: 0.1, ratio: 4.0, ..POINT },
    Case { name: "consistent", ..CONSISTENT },
    Case { name: "consistent-sphere", radius_m: 3e-3, ..CONSISTENT },
    Case { name: "consistent-anisotropic", ratio: 2.0, ..CONSISTENT },
    Case { name: "consistent-anisotropic-sphere", radius_m: 3e-3, ratio: 4.0, ..CONSISTENT },
    Case { name: "exact", ..EXACT },
    Case { name: "exact-sphere", radius_m: 3e-3, ..EXACT },
    Case { name: "exact-anisotropic", ratio: 2.0, ..EXACT },
    Case { name: "exact-anisotropic-sphere", radius_m: 3e-3, ratio: 4.0, ..EXACT },
    Case { name: "paper-mixed", share: 20, ..POINT },
    Case { name: "consistent-mixed", share: 20, ..CONSISTENT },
    Case { name: "consistent-mixed-wide", share: 2, radius_m: 3e-3, ratio: 2.0, ..CONSISTENT },
    Case { name: "exact-mixed", share: 20, ..EXACT },
    Case { name: "paper-tank", friction: 0.0, tank: true, ..POINT },
    Case { name: "consistent-tank", friction: 0.0, tank: true, ..CONSISTENT },
    Case { name: "paper-coupled", coupled: true, ..POINT },
    Case { name: "consistent-coupled", coupled: true, tank: true, ..CONSISTENT },
    Case { name: "exact-coupled", coupled: true, radius_m: 3e-3, ..EXACT },
    Case { name: "consistent-coupled-mixed", coupled: true, share: 5, radius_m: 3e-3, ..CONSISTENT },
    Case { name: "consistent-curved", coupled: true, curved: true, radius_m: 3e-3, ..CONSISTENT },
    Case { name: "consistent-curved-mixed", coupled: true, curved: true, share: 5, ..CONSISTENT },
    Case { name: "exact-curved", coupled: true, curved: true, radius_m: 3e-3, ..EXACT },
];
const CONSISTENT: Case = Case { slip: SlipRule::Consistent, ..POINT };
const EXACT: Case = Case { slip: SlipRule::Exact, ..POINT };

impl Case {
    fn body(&self) -> Body {
        let mesh = ellipsoid(DVec3::new(0.03, 0.029, 0.031), 2);
        if self.coupled {
            let body = coupled::coupled(&mesh, &mut Random::new(11), 0.25, self.friction, self.radius_m);
            let mut parts = if self.share == 1 { body } else { coupled::sparse(&body, self.share) }.parts();
            if !self.curved {
                let potentials = parts.coupled.iter_mut().flat_map(|law| &mut law.potentials);
                potentials.for_each(|p| p.curvature = [0.0; 3]);
            }
            return Body::new(parts).unwrap();
        }
        let surface = palpate_body::Surface::build(&mesh, f64::INFINITY).unwrap();
        let kz = |p: DVec3| 600.0 * (1.0 + 0.4 * p.x / 0.03 - 0.2 * p.y * p.z / 9e-4);
        let kr = |p: DVec3| 500.0 * (1.0 + 0.3 * p.z / 0.03);
        let material = Material { kz: &kz, kr: &kr, friction: &|_| self.friction, radius_m: self.radius_m };
        let fibres =
            |p: DVec3, u: DVec3| tensor::along(DVec3::new(0.3, 0.2, 0.4) + p * 5.0, self.ratio, u).unwrap();
        let fibres = (self.ratio != 1.0).then_some(&fibres as &dyn Fn(DVec3, DVec3) -> Tensor);
        let body = stretched(surface, material, fibres);
        if self.share == 1 { body } else { self.mixed(body) }
    }

    /// The same with fewer test points, each with a curve of three knots, and friction that grows with depth.
    fn mixed(&self, body: Body) -> Body {
        let parts = body.parts();
        let points: Vec<u32> = (0..body.nodes().len() as u32).step_by(self.share).collect();
        let knots = [0.0, 1e-3, 2.5e-3, 6e-3];
        let bend = |node: &u32| {
            let Response { normal, lateral, .. } = &body.curves()[*node as usize];
            let through = |value: &dyn Fn(f64) -> f64, extension| {
                Curve::through(&knots, &knots.map(value), Interpolation::Pchip, extension).unwrap()
            };
            Response {
                normal: through(&|d| normal.value(d), Extension::Linear),
                lateral: through(&|d| lateral.value(d) * (1.0 - 20.0 * d), Extension::Linear),
                friction: through(&|d| self.friction * (0.5 + 100.0 * d), Extension::Constant),
            }
        };
        let responses = points.iter().map(bend).collect();
        let blends = spread(&parts.surface, &points).unwrap();
        Body::new(BodyParts { blends, responses, test_point_nodes: points, ..parts }).unwrap()
    }

    fn trace(&self) -> Vec<Output> {
        let body = self.body();
        let mut contact = Contact::with_slip(&body, self.slip, self.ablation).with_tank(self.tank);
        path().into_iter().map(|p| step(&mut contact, &body, p * (1.0 + self.radius_m / 0.03))).collect()
    }
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
    let mut text = String::from(
        "# case,step,force bits (x, y, z), contact point bits (x, y, z); `all` is a digest of every output\n",
    );
    for case in CASES {
        let (name, outputs) = (case.name, case.trace());
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
