//! Bodies and loops for the runtime's tests.
#![allow(dead_code, reason = "each test file uses its own part")]

pub mod faulty;

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{
    BlendWeights, Body, BodyParts, Provenance, Response, SlipRule, Surface, Tool, TriangleMesh,
};
use palpate_device::simulated::{Hand, Move, Script};
use palpate_device::{Capabilities, Device, Figure, Simulated, presets};
use palpate_engine::Contact;
use palpate_runtime::{Cycle, HapticLoop, Stages, WorkspaceMap};

/// xorshift64*: the same numbers everywhere.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03)
    }
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }
    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// A flat patch in z = 0, facing +z.
pub fn patch(size: f64, cells: usize) -> TriangleMesh {
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
    mesh
}

/// A shape's mesh with edges of about this length.
pub fn shape(shape: Shape, edge_mm: f64) -> TriangleMesh {
    shape.mesh(Resolution { edge_length_mm: Some(edge_mm), ..Default::default() }).unwrap()
}

/// A flat patch of 10 cm of the paper's laws with these k^z, k^r and this friction.
pub fn plane(kz: f64, kr: f64, friction: f64) -> Body {
    uniform(&patch(0.1, 8), kz, kr, friction)
}

/// The same response everywhere.
pub fn uniform(mesh: &TriangleMesh, kz: f64, kr: f64, friction: f64) -> Body {
    with_field(mesh, kz, kr, friction, &|_| 1.0)
}

/// Both stiffnesses times `field` at each node.
pub fn with_field(
    mesh: &TriangleMesh,
    kz: f64,
    kr: f64,
    friction: f64,
    field: &dyn Fn(DVec3) -> f64,
) -> Body {
    let surface = Surface::build(mesh, f64::INFINITY).unwrap();
    let count = surface.positions().len() as u32;
    let response = |&p: &DVec3| {
        let g = field(p);
        Response::paper(kz * g, kr * g, friction, 20e-3, 20e-3).unwrap()
    };
    Body::new(BodyParts {
        blends: (0..count).map(BlendWeights::own).collect(),
        responses: surface.positions().iter().map(response).collect(),
        surface,
        test_point_nodes: (0..count).collect(),
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
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
    /// Mean of what the body would answer at the device's place, and of what was rendered, over the second half, N.
    pub asked_n: f64,
    pub rendered_n: f64,
    /// Root mean square of the rendered less what the engine's force was, N.
    pub added_n: f64,
    pub stages: Stages,
}

/// Pushes a tool into a paper plane with `push` N for `seconds` at 1 kHz.
pub fn press(body: &Body, capabilities: &Capabilities, stages: Stages, push: f64, seconds: f64) -> Pressed {
    let period = 1e-3;
    let push_to = |force_n, seconds| Move::Push { force_n, seconds };
    // Ends with a small jerk: something to die down or to grow.
    let moves = [
        push_to(0.98 * push, 1.0),
        push_to(push, 0.02),
        Move::Hold { tremor_m: 0.0, tremor_hz: 0.0, seconds },
    ];
    let script = Script::new(DVec3::new(3e-3, 2e-3, 0.0), 0.0, -DVec3::Z, DVec3::X, &moves).unwrap();
    let mut device = Simulated::new(capabilities.clone(), Hand::default(), Box::new(script));
    device.open().unwrap();
    let mut closed = HapticLoop::new(Contact::new(body), WorkspaceMap::default(), stages);
    let curve = &body.curves()[0].normal;
    let steps = ((seconds + 1.02) / period) as u64;
    let mut places = Vec::new();
    let [mut asked, mut rendered, mut added] = [0.0; 3];
    for k in 0..=steps {
        let step = closed.step(body, &mut device, k as f64 * period).unwrap();
        if k < steps / 2 {
            continue;
        }
        places.push(device.position_m());
        let [engine, command] = [step.output.force_n[2], step.command.force_n[2]];
        asked += curve.value(-step.sample.pose.position_m[2]);
        rendered += command;
        added += (command - engine) * (command - engine);
    }
    let count = places.len() as f64;
    // f = a δ², so f' = 2 √(a f).
    let a = curve.value(1e-3) / 1e-6;
    Pressed {
        stiffness: 2.0 * f64::sqrt(a * push),
        cycle: Cycle::find(&places, period, 1e-9),
        asked_n: asked / count,
        rendered_n: rendered / count,
        added_n: f64::sqrt(added / count),
        stages: *closed.stages(),
    }
}

/// The bench device with this damping (N·s/m), delay (s), friction (N) and encoder step (m).
pub fn bench(damping: f64, delay: f64, coulomb: f64, resolution: f64) -> Capabilities {
    let mut capabilities = presets::device("bench").unwrap();
    let m = &mut capabilities.mechanics;
    for (figure, value) in [
        (&mut m.damping_n_s_per_m, damping),
        (&mut m.delay_s, delay),
        (&mut m.coulomb_n, coulomb),
        (&mut m.resolution_m, resolution),
    ] {
        *figure = Figure::chosen(value);
    }
    capabilities
}
