//! The deformed surface against the simulated one.

use super::errors::{Percentiles, percent};
use glam::DVec3;
use palpate_body::search::{MeshSearch, SurfacePoint};
use palpate_body::{Body, ContactState, Deformer, TriangleMesh};
use serde::Serialize;

/// Nodes that move by less than this share of the depth on both sides count nowhere: they would be right for nothing.
const MOVED: f64 = 0.01;
/// States that are less deep than this share of the path's depth are no measure in parts of their own.
const DEEP: f64 = 0.1;

/// The simulated mesh's boundary at rest.
#[derive(Debug, Clone, Default)]
pub struct SimulatedSurface {
    /// Nodes that states' displacements are of, m.
    pub positions: Vec<DVec3>,
    /// Three corners and the middles of the edges 01, 12, 20.
    pub faces: Vec<[u32; 6]>,
}

/// How far a state's deformed surface is from the simulated one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SurfaceError {
    /// How deep the tool is, m, and the deepest of its path.
    pub depth_m: f64,
    /// Of the path.
    pub deepest_m: f64,
    /// Root of the mean square over the area that moves, m.
    pub rms_m: f64,
    /// The same over what is within two tool radii (or the depth) of the contact point, m.
    pub near_rms_m: f64,
    /// How far the tool shows through, m.
    pub show_through_m: f64,
}

/// Over all states.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SurfaceErrors {
    /// How many are at least a tenth as deep as their path.
    pub states: usize,
    /// Root mean square of each, in % of its depth.
    pub rms_percent: Percentiles,
    /// The same near the contact point.
    pub near_rms_percent: Percentiles,
    /// How far the tool shows through, in % of the depth.
    pub show_through_percent: Percentiles,
    /// Root mean square of every state, in % of the greatest depth of its path.
    pub rms_of_deepest_percent: Percentiles,
}

impl SurfaceErrors {
    /// None without states.
    pub fn new(all: &[SurfaceError]) -> Option<Self> {
        let deep = || all.iter().filter(|e| e.depth_m >= DEEP * e.deepest_m);
        let of =
            |part: fn(&SurfaceError) -> f64| Percentiles::of(deep().map(|e| percent(part(e), e.depth_m)));
        (deep().count() > 0).then(|| SurfaceErrors {
            states: deep().count(),
            rms_percent: of(|e| e.rms_m),
            near_rms_percent: of(|e| e.near_rms_m),
            show_through_percent: of(|e| e.show_through_m),
            rms_of_deepest_percent: Percentiles::of(all.iter().map(|e| percent(e.rms_m, e.deepest_m))),
        })
    }
}

/// Compares surfaces: where the simulation's nodes lie on the body's.
pub struct SurfaceTrial<'a> {
    body: &'a Body,
    boundary: &'a SimulatedSurface,
    /// Of each node.
    at: Vec<SurfacePoint>,
    /// m².
    areas: Vec<f64>,
    deformer: Deformer,
}

impl<'a> SurfaceTrial<'a> {
    /// None where the simulator has no boundary.
    ///
    /// # Errors
    /// Displacement fields that can't be read.
    pub fn new(body: &'a Body, boundary: &'a SimulatedSurface) -> palpate_body::Result<Option<Self>> {
        if boundary.faces.is_empty() {
            return Ok(None);
        }
        let mesh = TriangleMesh {
            positions: body.nodes().iter().map(|n| n.position).collect(),
            triangles: body.elements().iter().map(|e| e.nodes).collect(),
        };
        let search = MeshSearch::new(&mesh);
        let first = SurfacePoint { element: 0, n: [1.0, 0.0, 0.0] };
        let nearest = |p: &DVec3| search.nearest(*p, f64::INFINITY).map_or(first, |(at, _)| at);
        let mut areas = vec![0.0; boundary.positions.len()];
        for face in &boundary.faces {
            for part in [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]] {
                let [a, b, c] = part.map(|i| boundary.positions[face[i] as usize]);
                let third = (b - a).cross(c - a).length() / 6.0;
                part.iter().for_each(|&i| areas[face[i] as usize] += third);
            }
        }
        let at = boundary.positions.iter().map(nearest).collect();
        Ok(Some(SurfaceTrial { body, boundary, at, areas, deformer: Deformer::new(body)? }))
    }

    /// A path's states: contact points (where it touches), tool positions (m), depths (m) and simulated displacements.
    pub fn compare<'s>(
        &self,
        states: impl Iterator<Item = (Option<SurfacePoint>, DVec3, f64, &'s [[f32; 3]])> + Clone,
    ) -> Vec<SurfaceError> {
        let mut deformer = self.deformer.clone();
        let mut positions = Vec::new();
        let deepest_m = states.clone().map(|s| s.2).fold(0.0, f64::max);
        let radius = self.body.tool().radius_m();
        let mut errors = Vec::new();
        for (at, tool_m, depth_m, simulated) in states {
            let Some(at) = at.filter(|_| simulated.len() == self.at.len() && depth_m > 0.0) else { continue };
            deformer.displace(self.body, &ContactState { at, tool_m }, &mut positions);
            let contact = self.body.point(at);
            let near = (2.0 * radius).max(depth_m);
            let (mut whole, mut around) = ([0.0; 2], [0.0; 2]);
            for (n, (point, u)) in self.at.iter().zip(simulated).enumerate() {
                let nodes = self.body.element_node_numbers(point.element);
                let moved: DVec3 = nodes
                    .into_iter()
                    .zip(point.n)
                    .map(|(node, share)| {
                        (positions[node as usize] - self.body.nodes()[node as usize].position) * share
                    })
                    .sum();
                let u = DVec3::from_array(u.map(f64::from));
                if u.length().max(moved.length()) < MOVED * depth_m {
                    continue;
                }
                let square = moved.distance_squared(u) * self.areas[n];
                let is_near = self.boundary.positions[n].distance(contact) < near;
                for sum in [Some(&mut whole), is_near.then_some(&mut around)].into_iter().flatten() {
                    sum[0] += square;
                    sum[1] += self.areas[n];
                }
            }
            let rms = |[squares, area]: [f64; 2]| if area > 0.0 { (squares / area).sqrt() } else { 0.0 };
            errors.push(SurfaceError {
                depth_m,
                deepest_m,
                rms_m: rms(whole),
                near_rms_m: rms(around),
                show_through_m: show_through(self.body, &positions, tool_m, radius),
            });
        }
        errors
    }
}

/// How far a ball reaches through the facets that are displaced to `positions`, m: what is left between it and the nearest facet.
fn show_through(body: &Body, positions: &[DVec3], centre: DVec3, radius: f64) -> f64 {
    let nodes = body.elements().iter().map(|e| e.nodes);
    let near = nodes.filter(|nodes| {
        let [a, b, c] = nodes.map(|n| positions[n as usize]);
        a.distance(centre) < radius + a.distance(b).max(a.distance(c))
    });
    let mesh = TriangleMesh { positions: positions.to_vec(), triangles: near.collect() };
    if radius <= 0.0 || mesh.triangles.is_empty() {
        return 0.0;
    }
    let nearest = MeshSearch::new(&mesh).nearest(centre, radius);
    nearest.map_or(0.0, |(_, p)| radius - p.distance(centre))
}
