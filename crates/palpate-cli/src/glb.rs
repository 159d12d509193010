//! A body as binary glTF 2.0, for Blender, Unity and viewers: its surface, coloured by stiffness, and morph targets of the surface
//! pressed in at some test points.

use crate::tables::Figures;
use anyhow::{Result, anyhow};
use glam::DVec3;
use palpate_body::{Body, ContactState, Deformer, SurfacePoint};
use serde_json::{Value, json};
use std::io::Write;

/// What the format's numbers mean.
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const MAGIC: u32 = 0x4654_6C67;
const JSON_CHUNK: u32 = 0x4E4F_534A;
const BINARY_CHUNK: u32 = 0x004E_4942;

/// A morph target: the body pressed straight in at a test point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MorphTarget {
    /// Which.
    pub test_point: usize,
    /// How deep, m.
    pub depth_m: f64,
}

/// So many test points, as far from each other as they can be one after another, each pressed to `depth_m` or, without, as deep as the
/// body's responses were found.
///
/// # Errors
/// Displacement fields that can't be read.
pub fn targets(body: &Body, count: usize, depth_m: Option<f64>) -> Result<Vec<MorphTarget>> {
    let fields = body.displacement_fields()?;
    let knots = body.responses().depth_knots().values();
    // A coupled law's last knot is an end beyond what was pressed.
    let last = knots.len().saturating_sub(if body.is_coupled() { 2 } else { 1 });
    let known = knots.get(last).copied().unwrap_or_default();
    let places: Vec<DVec3> =
        body.test_point_nodes().iter().map(|&n| body.nodes()[n as usize].position).collect();
    let centre = places.iter().sum::<DVec3>() / places.len().max(1) as f64;
    // Squared distance to the nearest that was chosen; the first is the one farthest from the middle of all.
    let mut far: Vec<f64> = places.iter().map(|p| p.distance_squared(centre)).collect();
    let mut chosen = Vec::new();
    while chosen.len() < count.min(places.len()) {
        let Some(next) = (0..places.len()).max_by(|&a, &b| far[a].total_cmp(&far[b]).then(b.cmp(&a))) else {
            break;
        };
        let deepest = fields.map_or(known, |f| f.deepest_m(next));
        chosen.push(MorphTarget { test_point: next, depth_m: depth_m.unwrap_or(deepest) });
        for (far, p) in far.iter_mut().zip(&places) {
            let distance = p.distance_squared(places[next]);
            *far = if chosen.len() == 1 { distance } else { far.min(distance) };
        }
    }
    Ok(chosen)
}

/// Writes the body: metres, and y up as glTF has it, the body's (x, y, z) being (x, z, −y) there, so that its z is up.
///
/// # Errors
/// Displacement fields that can't be read, more than 4 GiB, or `out` can't be written.
pub fn write(body: &Body, name: &str, targets: &[MorphTarget], out: &mut dyn Write) -> Result<()> {
    let mut file = Buffers::default();
    let rest: Vec<DVec3> = body.nodes().iter().map(|n| n.position).collect();
    let normals_at_rest = normals(body, &rest);
    let outward: Vec<DVec3> = body.nodes().iter().map(|n| -n.inward).collect();
    let position = file.vectors(&rest, true);
    let normal = file.vectors(&outward, false);
    let colours = colours(body);
    let colour = file.array(
        &colours.concat(),
        colours.len(),
        UNSIGNED_BYTE,
        "VEC4",
        ARRAY_BUFFER,
        json!({"normalized": true}),
    );
    let corners: Vec<u8> = body.elements().iter().flat_map(|e| e.nodes).flat_map(u32::to_le_bytes).collect();
    let indices = file.array(
        &corners,
        3 * body.elements().len(),
        UNSIGNED_INT,
        "SCALAR",
        ELEMENT_ARRAY_BUFFER,
        json!({}),
    );

    let mut deformer = Deformer::new(body)?;
    let (mut moved, mut morphs, mut names, mut about) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for target in targets {
        let node = body.test_point_nodes()[target.test_point];
        let Some(at) = corner(body, node) else { continue };
        deformer.displace(body, &ContactState::pressed(body, at, target.depth_m), &mut moved);
        let by: Vec<DVec3> = moved.iter().zip(&rest).map(|(p, q)| *p - *q).collect();
        let turned: Vec<DVec3> =
            normals(body, &moved).iter().zip(&normals_at_rest).map(|(n, m)| *n - *m).collect();
        let (position, normal) = (file.vectors(&by, true), file.vectors(&turned, false));
        morphs.push(json!({"POSITION": position, "NORMAL": normal}));
        names.push(format!("test point {}, {:.2} mm", target.test_point, target.depth_m * 1e3));
        let p = rest[node as usize];
        about.push(json!({
            "test_point": target.test_point,
            "node": node,
            "position_m": y_up(p).map(f64::from),
            "depth_m": target.depth_m,
        }));
    }
    let mut primitive = json!({
        "attributes": {"POSITION": position, "NORMAL": normal, "COLOR_0": colour},
        "indices": indices,
        "material": 0,
        "mode": 4,
    });
    let mut mesh = json!({"name": name});
    if !morphs.is_empty() {
        mesh["weights"] = json!(vec![0.0; morphs.len()]);
        // Blender, Unity's importers and three.js take names from here.
        mesh["extras"] = json!({"targetNames": names, "targets": about});
        primitive["targets"] = Value::Array(morphs);
    }
    mesh["primitives"] = json!([primitive]);
    let open = body.elements().iter().any(|e| e.twins.contains(&palpate_body::NO_TWIN));
    let document = json!({
        "asset": {"version": "2.0", "generator": format!("palpate {}", env!("CARGO_PKG_VERSION"))},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [mesh],
        "materials": [{
            "name": "tissue",
            "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.5},
            "doubleSided": open,
        }],
        "accessors": file.accessors,
        "bufferViews": file.views,
        "buffers": [{"byteLength": file.bytes.len()}],
    });
    let mut text = serde_json::to_vec(&document)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = file.bytes;
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let whole = 12 + 8 + text.len() + 8 + bytes.len();
    let length = |bytes: usize| {
        u32::try_from(bytes).map_err(|_| {
            anyhow!("it would have {whole} bytes, where glTF allows 4 GiB; give fewer --targets")
        })
    };
    for word in [MAGIC, 2, length(whole)?, length(text.len())?, JSON_CHUNK] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&text)?;
    for word in [length(bytes.len())?, BINARY_CHUNK] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&bytes)?;
    Ok(())
}

/// A vector with y up.
fn y_up(v: DVec3) -> [f32; 3] {
    [v.x as f32, v.z as f32, -v.y as f32]
}

/// The file's bytes, and what says what they are.
#[derive(Default)]
struct Buffers {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffers {
    /// Adds an array; its accessor's number.
    fn array(
        &mut self,
        bytes: &[u8],
        count: usize,
        component: u32,
        kind: &str,
        target: u32,
        more: Value,
    ) -> usize {
        // Four bytes is what every component here is aligned at.
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": self.bytes.len(),
            "byteLength": bytes.len(),
            "target": target,
        }));
        self.bytes.extend_from_slice(bytes);
        let mut accessor = json!({"bufferView": self.views.len() - 1, "componentType": component, "count": count, "type": kind});
        for (key, value) in more.as_object().into_iter().flatten() {
            accessor[key] = value.clone();
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Vectors with y up, with the least and greatest components where these are asked for.
    fn vectors(&mut self, vectors: &[DVec3], bounded: bool) -> usize {
        let rows: Vec<[f32; 3]> = vectors.iter().map(|v| y_up(*v)).collect();
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
        let mut more = json!({});
        if bounded {
            let fold = |start: f32, of: fn(f32, f32) -> f32| {
                rows.iter().fold([start; 3], |all, row| std::array::from_fn(|i| of(all[i], row[i])))
            };
            more = json!({"min": fold(f32::INFINITY, f32::min), "max": fold(f32::NEG_INFINITY, f32::max)});
        }
        self.array(&bytes, rows.len(), FLOAT, "VEC3", ARRAY_BUFFER, more)
    }
}

/// A point of the surface at a node.
fn corner(body: &Body, node: u32) -> Option<SurfacePoint> {
    body.elements().iter().enumerate().find_map(|(e, element)| {
        let i = element.nodes.iter().position(|&n| n == node)?;
        let mut n = [0.0; 3];
        n[i] = 1.0;
        Some(SurfacePoint { element: e as u32, n })
    })
}

/// Outward unit normals of the nodes, their facets' weighted by area.
fn normals(body: &Body, positions: &[DVec3]) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for element in body.elements() {
        let [a, b, c] = element.nodes.map(|n| positions[n as usize]);
        let twice = (b - a).cross(c - a);
        element.nodes.iter().for_each(|&n| sums[n as usize] += twice);
    }
    sums.iter().zip(body.nodes()).map(|(sum, node)| sum.normalize_or(-node.inward)).collect()
}

/// Each node's colour from viridis (linear, and no transparency): its normal stiffness at full depth, between the body's 2nd and 98th
/// percentile.
fn colours(body: &Body) -> Vec<[u8; 4]> {
    let stiffness: Vec<f64> =
        Figures::of_nodes(body).iter().map(|f| f.stiffness_at_full_depth_n_per_m).collect();
    let mut sorted = stiffness.clone();
    sorted.sort_by(f64::total_cmp);
    let at = |part: f64| sorted[((sorted.len() - 1) as f64 * part).round() as usize];
    let (low, high) = (at(0.02), at(0.98));
    let linear = |c: f64| {
        let c = if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) };
        (c * 255.0).round() as u8
    };
    let colour = |k: f64| {
        let x = if high > low { ((k - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 };
        let [r, g, b] = palpate::colours::viridis(x).map(linear);
        [r, g, b, 255]
    };
    stiffness.into_iter().map(colour).collect()
}
