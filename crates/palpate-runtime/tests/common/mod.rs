//! Bodies and loops for the runtime's tests.
#![allow(dead_code, reason = "each test file uses its own part")]

use glam::DVec3;
use palpate_body::{Body, BodyParts, NodeMix, Provenance, Response, SlipRule, Surface, Tool, TriangleMesh};
use palpate_device::simulated::{Hand, Move, Script};
use palpate_device::{Capabilities, Device, Simulated, presets};
use palpate_engine::Contact;
use palpate_runtime::{Cycle, HapticLoop, Stages, WorkspaceMap};

/// A flat patch of 10 cm in z = 0, facing +z, of the paper's laws with these k^z, k^r and this friction.
pub fn plane(kz: f64, kr: f64, friction: f64) -> Body {
    let (size, cells) = (0.1, 8);
    let mut mesh = TriangleMesh::default();
    for j in 0..=cells {
        for i in 0..=cells {
            let at = |k: usize| size * (k as f64 / cells as f64 - 0.5);
            mesh.positions.push(DVec3::new(at(i), at(j), 0.0));
        }
    }
    for j in 0..cells {
        for i in 0..cells {
            let at = |i: usize, j: usize| (j * (cells + 1) + i) as u32;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    uniform(&mesh, kz, kr, friction)
}

/// The same response everywhere.
pub fn uniform(mesh: &TriangleMesh, kz: f64, kr: f64, friction: f64) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    Body::new(BodyParts {
        mixes: vec![NodeMix::own(0); surface.positions().len()],
        responses: vec![Response::paper(kz, kr, friction, 20e-3, 20e-3).unwrap()],
        surface,
        test_point_nodes: vec![0],
        lateral_tensors: None,
        tool: Tool::point(),
        slip: SlipRule::Paper,
        provenance: Provenance::default(),
    })
    .unwrap()
}

/// What became of a press by a constant force.
#[derive(Debug)]
pub struct Pressed {
    /// f_z' at the depth where the force is in balance, N/m.
    pub stiffness: f64,
    pub cycle: Option<Cycle>,
}

/// Pushes a preset's tool, changed by `change`, into a paper plane with `push` N for `seconds` at 1 kHz.
pub fn press(
    body: &Body,
    preset: &str,
    change: impl Fn(&mut Capabilities),
    push: f64,
    seconds: f64,
) -> Pressed {
    let mut capabilities = presets::device(preset).unwrap();
    change(&mut capabilities);
    let period = 1e-3;
    let moves =
        [Move::Push { force_n: push, seconds: 1.0 }, Move::Hold { tremor_m: 0.0, tremor_hz: 0.0, seconds }];
    let script = Script::new(DVec3::new(3e-3, 2e-3, 0.0), 0.0, -DVec3::Z, DVec3::X, &moves).unwrap();
    let mut device = Simulated::new(capabilities, Hand::default(), Box::new(script));
    device.open().unwrap();
    let mut closed = HapticLoop::new(Contact::new(body), WorkspaceMap::default(), Stages::default());
    let mut places = Vec::new();
    for k in 0..=((seconds + 1.0) / period) as u64 {
        closed.step(body, &mut device, k as f64 * period).unwrap();
        places.push(device.position_m());
    }
    let rest = &places[places.len() / 2..];
    let curve = &body.curves()[0].normal;
    // f = a δ², so f' = 2 √(a f).
    let a = curve.value(1e-3) / 1e-6;
    Pressed { stiffness: 2.0 * f64::sqrt(a * push), cycle: Cycle::find(rest, period, 1e-6) }
}
