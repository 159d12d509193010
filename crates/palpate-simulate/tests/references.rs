//! The cylinder with a bonded patch against forces that two other programs, FElupe 11.3 and CalculiX 2.20, computed on
//! the very same meshes with the same laws; all forces are four times the quarter's.

mod support;

use glam::DVec3;
use palpate_simulate::{Fixed, Material, Path, Stop, TetMesh};
use std::collections::HashMap;
use support::{hold, moved, numbers};

/// E = 10 kPa, ν = 0.45.
const MU: f64 = 1e4 / 2.9;
const LAMBDA: f64 = 9e4 / 2.9;
const LOGARITHMIC: Material = Material::NeoHookean { mu_pa: MU, lambda_pa: LAMBDA };
const ISOCHORIC: Material = Material::IsochoricNeoHookean { mu_pa: MU, bulk_pa: 1e5 / 3.0 };

struct Cylinder {
    mesh: TetMesh,
    patch: Vec<u32>,
}

impl Cylinder {
    fn read([nodes, elements, patch]: [&str; 3]) -> Self {
        let positions = numbers(nodes).iter().map(|r| DVec3::new(r[0], r[1], r[2])).collect();
        let elements: Vec<[u32; 10]> =
            numbers(elements).iter().map(|r| std::array::from_fn(|i| r[i] as u32)).collect();
        let regions = vec![0; elements.len()];
        let region_names = vec![String::new()];
        let mesh = TetMesh { positions, elements, regions, region_names, groups: Default::default() };
        Cylinder { mesh, patch: numbers(patch).iter().map(|r| r[0] as u32).collect() }
    }

    fn coarse() -> Self {
        Self::read([
            include_str!("c1_m1/nodes.csv"),
            include_str!("c1_m1/tet10.csv"),
            include_str!("c1_m1/patch.csv"),
        ])
    }

    /// The finer mesh is too large to keep here.
    fn fine() -> Option<Self> {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/references/meshes");
        let read = |what| std::fs::read_to_string(format!("{folder}/c1_m3_{what}.csv"));
        let found = read("nodes").and_then(|n| Ok([n, read("tet10")?, read("patch")?]));
        found.ok().map(|[n, e, p]| Self::read([&n, &e, &p]))
    }

    /// Both z-halves.
    fn doubled(mut self) -> Self {
        let mut twin: HashMap<u32, u32> = HashMap::new();
        for node in 0..self.mesh.positions.len() as u32 {
            let p = self.mesh.positions[node as usize];
            twin.insert(node, if p.z.abs() < 1e-12 { node } else { self.mesh.positions.len() as u32 });
            if p.z.abs() >= 1e-12 {
                self.mesh.positions.push(DVec3::new(p.x, p.y, -p.z));
            }
        }
        for e in 0..self.mesh.elements.len() {
            let [a, b, c, d, ab, bc, ca, ad, bd, cd] = self.mesh.elements[e].map(|n| twin[&n]);
            // The mirror inverts it; c and d change places, and their edges with them.
            self.mesh.elements.push([a, b, d, c, ab, bd, ad, ca, bc, cd]);
            self.mesh.regions.push(0);
        }
        let twins: Vec<u32> =
            self.patch.iter().map(|n| twin[n]).filter(|n| !self.patch.contains(n)).collect();
        self.patch.extend(twins);
        self
    }

    /// Moves the patch along `way` (mm); `whole` has both z-halves.
    fn path(&self, material: &Material, way: &[[f64; 2]], whole: bool) -> Path {
        let ends = 0.1 - 1e-9;
        let fixed = hold(&self.mesh, |p| {
            let end = p.z.abs() > ends;
            [end || p.x.abs() < 1e-9, end, end || (!whole && p.z.abs() < 1e-9)]
        });
        let patch: Vec<Fixed> = self.patch.iter().map(|&node| Fixed { node, axes: [true; 3] }).collect();
        let way: Vec<DVec3> = way.iter().map(|[y, z]| DVec3::new(0.0, -y, *z) * 1e-3).collect();
        moved(&self.mesh, material, &fixed, &patch, &way).0
    }

    /// Presses to depths (mm) and compares with forces (N).
    fn check(&self, material: &Material, expected: &[(f64, f64)], tolerance: f64) {
        let way: Vec<[f64; 2]> = expected.iter().map(|(depth, _)| [*depth, 0.0]).collect();
        let path = self.path(material, &way, false);
        assert_eq!(path.stopped, None, "{material:?}");
        for (state, (depth, expected)) in path.states.iter().zip(expected) {
            let found = -4.0 * state.force_n.y;
            let error = found / expected - 1.0;
            println!("{depth:4} mm: {found:.7} N, reference {expected}, {error:+.1e}");
            assert!(error.abs() < tolerance, "{material:?} at {depth} mm: {found} N, not {expected}");
        }
    }
}

#[test]
fn coarse_mesh() {
    let cylinder = Cylinder::coarse();
    let linear = Material::Linear { mu_pa: MU, lambda_pa: LAMBDA };
    cylinder.check(&linear, &[(2.0, 0.32002012)], 2e-8);
    let saint_venant = Material::StVenantKirchhoff { mu_pa: MU, lambda_pa: LAMBDA };
    cylinder.check(&saint_venant, &[(1.0, 0.15074599), (2.0, 0.27891411)], 5e-7);
    let logarithmic = [(2.0, 0.31704525), (4.0, 0.62685055), (6.0, 0.9297137), (8.0, 1.2254425)];
    cylinder.check(&LOGARITHMIC, &logarithmic, 5e-7);
    let isochoric = [(2.0, 0.31789258), (4.0, 0.62987461), (6.0, 0.93549444), (8.0, 1.2343052)];
    cylinder.check(&ISOCHORIC, &isochoric, 5e-7);
}

#[test]
#[ignore = "half a minute; needs the reference meshes beside the repository"]
fn fine_mesh() {
    let Some(cylinder) = Cylinder::fine() else {
        println!("skipped: the mesh of 53,010 unknowns is not here");
        return;
    };
    cylinder.check(&LOGARITHMIC, &[(2.0, 0.31311241), (4.0, 0.61790498), (6.0, 0.91482611)], 5e-7);
    let isochoric = [(1.0, 0.1577715), (2.0, 0.31394907), (3.0, 0.46827933), (4.0, 0.62075831)];
    cylinder.check(&ISOCHORIC, &isochoric, 5e-7);
}

/// From 5 mm deep along the axis. Reference: FElupe.
#[test]
fn drag_along_the_axis() {
    let cylinder = Cylinder::coarse().doubled();
    let path = cylinder.path(&LOGARITHMIC, &[[2.5, 0.0], [5.0, 0.0], [5.0, 1.0], [5.0, 2.0]], true);
    assert_eq!(path.stopped, None);
    // Tangential and normal, N.
    for (i, expected) in
        [(1, [0.0, 0.77911398]), (2, [0.15062001, 0.77992608]), (3, [0.30109698, 0.78246447])]
    {
        let force = path.states[i].force_n;
        let found = [2.0 * force.z, -2.0 * force.y];
        println!("{i}: {found:?}, reference {expected:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 2e-6 * expected.max(0.02), "{found} N, not {expected}");
        }
    }
}

/// Beyond 8 mm the surface buckles at the patch's edge and there are several equilibria: forces of two programs
/// differ by some per cent. What is asked is that all goes on.
#[test]
#[ignore = "half a minute"]
fn to_twenty_millimetres() {
    let way: Vec<[f64; 2]> = (1..=20).map(|depth| [f64::from(depth), 0.0]).collect();
    let start = std::time::Instant::now();
    let path = Cylinder::coarse().path(&LOGARITHMIC, &way, false);
    for state in &path.states {
        let force = -4.0 * state.force_n.y;
        println!("{:4.1} mm: {force:.5} N, {} Newton steps", 1e3 * state.depth_m, state.iterations);
    }
    println!("{:?}", path.stopped);
    assert_eq!(path.stopped, None);
    assert!(start.elapsed().as_secs() < 300);
    for (depth, expected, most) in [(18, 2.5508, 1e-4), (20, 2.7306, 2e-3)] {
        let force = -4.0 * path.states[depth - 1].force_n.y;
        assert!((force / expected - 1.0).abs() < most, "{depth} mm: {force} N, FElupe {expected} N");
    }
}

/// St. Venant–Kirchhoff's law collapses between 2 and 3 mm: the path keeps the states before, ends, says where and why, and soon.
#[test]
fn a_collapse_ends_the_path() {
    let material = Material::StVenantKirchhoff { mu_pa: MU, lambda_pa: LAMBDA };
    let way: Vec<[f64; 2]> = (1..=4).map(|depth| [f64::from(depth), 0.0]).collect();
    let path = Cylinder::coarse().path(&material, &way, false);
    println!("{} states; {:?}", path.states.len(), path.stopped);
    let depths: Vec<f64> = path.states.iter().map(|state| state.depth_m).collect();
    assert_eq!(depths, [1e-3, 2e-3]);
    let why = "elements would be inverted, however small the load step";
    assert_eq!(path.stopped, Some(Stop { at_m: 3e-3, why: why.into() }));
    // Bounded in Newton steps, not by a clock.
    assert!(path.states.iter().all(|state| state.iterations < 60));
}
