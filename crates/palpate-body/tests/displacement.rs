//! Displacement fields: kept small, read when asked for, and the deformed surface that they make.

use glam::{DMat3, DQuat, DVec3};
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{
    BlendWeights, Body, BodyParts, ContactState, Deformer, DisplacementFields, FieldSet, FieldSurface,
    Fineness, PlaceField, Provenance, Response, SlipRule, StoredBody, Surface, SurfacePoint, Tool,
};
use std::collections::BTreeMap;

const RADIUS: f64 = 5e-3;
const DEPTHS: [f64; 3] = [1e-3, 3e-3, 5e-3];

/// A field with a sharp middle: pressed, all points go inwards and a little apart; dragged, along.
fn field(x: DVec3, centre: DVec3, inward: DVec3, depth: f64, lateral: DVec3) -> DVec3 {
    let from = x - centre;
    let share = (-from.length_squared() / (RADIUS * RADIUS)).exp();
    inward * (depth * share)
        + from.reject_from_normalized(inward) * (0.1 * depth / RADIUS * share)
        + lateral * share
}

/// The surface's triangles as faces of six nodes, the middles on `bulge`.
fn faces(surface: &Surface, bulge: impl Fn(DVec3) -> DVec3) -> FieldSurface {
    let mut positions = surface.positions().to_vec();
    let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut faces = Vec::new();
    for element in surface.elements() {
        let [a, b, c] = element.nodes;
        let middle = [[a, b], [b, c], [c, a]].map(|edge| {
            let key = [edge[0].min(edge[1]), edge[0].max(edge[1])];
            *middles.entry(key).or_insert_with(|| {
                let [p, q] = key.map(|n| positions[n as usize]);
                positions.push(bulge((p + q) * 0.5));
                positions.len() as u32 - 1
            })
        });
        faces.push([a, b, c, middle[0], middle[1], middle[2]]);
    }
    FieldSurface::new(positions, faces).unwrap()
}

/// Fields of every `step`th node; test points are all nodes that are pressed, and the first blends all of the element's.
fn fields(on: &FieldSurface, body: &Body) -> DisplacementFields {
    let (mut press, mut lateral) = (FieldSet::default(), FieldSet::default());
    for &n in body.test_point_nodes() {
        let node = &body.nodes()[n as usize];
        let (point, inward) = (node.position, node.inward);
        let tangent = inward.any_orthonormal_vector();
        let along = [tangent, inward.cross(tangent)];
        let at = |depth: f64, lateral: DVec3| -> Vec<[f32; 3]> {
            let of = |x: &DVec3| field(*x, point, inward, depth, lateral).to_array().map(|c| c as f32);
            on.positions().iter().map(of).collect()
        };
        let pressed = DEPTHS.map(|d| at(d, DVec3::ZERO));
        let states = DEPTHS.iter().zip(&pressed).map(|(d, f)| (*d, vec![&f[..]])).collect();
        press.push(on, &PlaceField { point, inward, tangent, states }, false).unwrap();
        let dragged = along.map(|direction| at(0.0, direction));
        let states = vec![(3e-3, vec![&dragged[0][..], &dragged[1][..]])];
        lateral.push(on, &PlaceField { point, inward, tangent, states }, true).unwrap();
    }
    let own: Vec<BlendWeights> = (0..press.places() as u32).map(BlendWeights::own).collect();
    let count = own.len();
    DisplacementFields::new(on.clone(), press.with_blends(own.clone()), lateral.with_blends(own), count)
        .unwrap()
}

/// A ball (radius 30 mm) whose nodes are all test points.
fn ball(edge_mm: f64) -> Body {
    let resolution = Resolution { edge_length_mm: Some(edge_mm), ..Default::default() };
    of_surface(Shape::Sphere { radius_mm: 30.0 }.surface(resolution).unwrap())
}

fn of_surface(surface: Surface) -> Body {
    let nodes = surface.positions().len() as u32;
    let response = Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap();
    Body::new(BodyParts {
        blends: (0..nodes).map(BlendWeights::own).collect(),
        surface,
        responses: vec![response; nodes as usize],
        test_point_nodes: (0..nodes).collect(),
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Sphere { radius_m: RADIUS },
        slip: SlipRule::Paper,
        tank: false,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

fn with_fields(edge_mm: f64) -> (Body, FieldSurface) {
    fields_on(ball(edge_mm))
}

/// The same for a tip, which nothing is moved out of.
fn for_a_tip(edge_mm: f64) -> (Body, FieldSurface) {
    fields_on(Body::new(BodyParts { tool: Tool::Point, ..ball(edge_mm).parts() }).unwrap())
}

fn fields_on(body: Body) -> (Body, FieldSurface) {
    let on = faces(&body.parts().surface, |p| p.normalize() * 30e-3);
    let found = fields(&on, &body);
    (body.with_displacement_fields(Some(found)).unwrap(), on)
}

fn state(body: &Body, element: u32, n: [f64; 3], depth: f64, lateral: DVec3) -> ContactState {
    let pressed = ContactState::pressed(body, SurfacePoint { element, n }, depth);
    let lateral = lateral.reject_from_normalized(body.inward(pressed.at));
    ContactState { tool_m: pressed.tool_m + lateral, ..pressed }
}

/// How far a ball reaches through the facets, in parts of the depth; all facets are looked at, at many points of each.
fn show_through(body: &Body, positions: &[DVec3], state: &ContactState, depth: f64) -> f64 {
    const PARTS: u32 = 12;
    let mut least = f64::INFINITY;
    for element in body.elements() {
        let [a, b, c] = element.nodes.map(|n| positions[n as usize]);
        for i in 0..=PARTS {
            for j in 0..=PARTS - i {
                let [v, w] = [i, j].map(|x| f64::from(x) / f64::from(PARTS));
                least = least.min((a + (b - a) * v + (c - a) * w).distance(state.tool_m));
            }
        }
    }
    (RADIUS - least) / depth
}

#[test]
fn a_body_keeps_its_fields_and_reads_them_when_asked() {
    let (body, _) = with_fields(8.0);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    body.save(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert!(String::from_utf8_lossy(&bytes[..4000]).contains(r#""version":"5""#));
    let opened = Body::open(&path).unwrap();
    assert_eq!(opened, body);
    assert_eq!(opened.displacement_fields().unwrap(), body.displacement_fields().unwrap());
    assert_eq!(Body::from_bytes(&bytes).unwrap(), body);
    assert_eq!(opened.to_bytes().unwrap(), bytes);
    StoredBody::open(&path, None).unwrap();
    // What replaces the file leaves an open body as it was.
    let (opened, plain) = (Body::open(&path).unwrap(), body.clone().with_displacement_fields(None).unwrap());
    plain.save(&path).unwrap();
    assert!(opened.displacement_fields().unwrap().is_some());
    assert!(Body::open(&path).unwrap().displacement_fields().unwrap().is_none());
    assert!(!String::from_utf8_lossy(&plain.to_bytes().unwrap()[..4000]).contains(r#""version":"5""#));
}

#[test]
fn damaged_fields_are_told_when_asked_for() {
    let (body, _) = with_fields(8.0);
    let bytes = body.to_bytes().unwrap();
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    let mut complaints = 0;
    for (name, damage) in [
        ("press_field_nodes", 0xFF),
        ("press_field_node_counts", 0x7F),
        ("lateral_field_state_counts", 1),
        ("press_field_depths_m", 0xFF),
        ("press_field_places", 0xFF),
        ("press_field_weights", 0xFF),
        ("field_faces", 0xFF),
        ("field_positions", 0xFF),
        ("lateral_field_axes", 0x41),
    ] {
        let at = header[name]["data_offsets"].as_array().unwrap();
        let [start, end] = [0, 1].map(|i| 8 + length + at[i].as_u64().unwrap() as usize);
        let mut damaged = bytes.clone();
        damaged[start..end.min(start + 8)].fill(damage);
        std::fs::write(&path, &damaged).unwrap();
        // No force needs fields: the body itself opens.
        let opened = Body::open(&path).unwrap();
        let told =
            opened.displacement_fields().err().unwrap_or_else(|| panic!("{name} was taken")).to_string();
        assert!(told.contains("x.body") && told.contains("make the body again"), "{name}: {told}");
        assert!(Deformer::new(&opened).is_err() && opened.to_bytes().is_err());
        assert!(Body::from_bytes(&damaged).is_err());
        complaints += 1;
    }
    assert_eq!(complaints, 9);
    // A file of version 4 has no such tensors.
    let older = String::from_utf8_lossy(&bytes[..8 + length]).replace(r#""version":"5""#, r#""version":"4""#);
    let older = [older.as_bytes(), &bytes[8 + length..]].concat();
    let told = Body::from_bytes(&older).unwrap_err().to_string();
    assert!(told.contains("version 4 has no such tensor"), "{told}");
}

#[test]
fn foreign_fields_are_refused() {
    let (body, on) = with_fields(8.0);
    let found = body.displacement_fields().unwrap().unwrap().clone();
    let told = ball(6.0).with_displacement_fields(Some(found.clone())).unwrap_err().to_string();
    assert!(told.contains("test points"), "{told}");
    let none = FieldSet::default();
    assert!(DisplacementFields::new(on.clone(), none.clone(), none.clone(), 0).is_err());
    assert!(FieldSurface::new(on.positions().to_vec(), vec![[u32::MAX; 6]]).is_err());
    let short = [[0.0f32; 3]; 3];
    let place = |states| PlaceField { point: DVec3::ZERO, inward: DVec3::Z, tangent: DVec3::X, states };
    assert!(FieldSet::default().push(&on, &place(vec![(1e-3, vec![&short[..]])]), false).is_err());
    let mut infinite = vec![[0.0f32; 3]; on.positions().len()];
    infinite[5][1] = f32::NAN;
    assert!(FieldSet::default().push(&on, &place(vec![(1e-3, vec![&infinite[..]])]), false).is_err());
}

#[test]
fn at_a_test_point_the_surface_is_the_simulations() {
    let (body, on) = for_a_tip(5.0);
    let mut deformer = Deformer::new(&body).unwrap();
    assert!(deformer.has_fields());
    let mut positions = Vec::new();
    for element in [0, 57, 200] {
        let node = body.element_nodes(element)[0];
        for (depth, lateral) in
            [(1e-3, DVec3::ZERO), (5e-3, DVec3::ZERO), (3e-3, DVec3::new(1e-3, 5e-4, -8e-4))]
        {
            let state = state(&body, element, [1.0, 0.0, 0.0], depth, lateral);
            let lateral = lateral.reject_from_normalized(node.inward);
            deformer.displace(&body, &state, &mut positions);
            for (n, p) in body.nodes().iter().zip(&positions) {
                let there = n.position + field(n.position, node.position, node.inward, depth, lateral);
                let off = p.distance(there) / (depth + lateral.length());
                assert!(off < 0.012, "{element} {depth}: {off} of the depth at {:?}", n.position);
            }
        }
    }
    // What hardly moves is left out.
    let bytes = body.displacement_fields().unwrap().unwrap().bytes();
    let whole = body.nodes().len() * on.positions().len() * 6 * (DEPTHS.len() + 2);
    assert!(bytes < whole / 5, "{bytes} of {whole}");
}

#[test]
fn between_test_points_fields_move_with_the_contact_point() {
    let (body, _) = for_a_tip(4.0);
    let mut deformer = Deformer::new(&body).unwrap();
    let found = body.displacement_fields().unwrap().unwrap();
    assert_eq!(found.lateral().places(), body.nodes().len());
    let mut positions = Vec::new();
    let (mut moved, mut fixed, mut area) = (0.0, 0.0, 0.0);
    let (depth, lateral) = (3e-3, DVec3::new(4e-4, -3e-4, 7e-4));
    for element in (0..body.elements().len() as u32).step_by(37) {
        let n = [0.3, 0.4, 0.3];
        let state = state(&body, element, n, depth, lateral);
        let (c, u) = (body.point(state.at), body.inward(state.at));
        let lateral = lateral.reject_from_normalized(u);
        deformer.displace(&body, &state, &mut positions);
        for (node, p) in body.nodes().iter().zip(&positions) {
            let x = node.position;
            let there = x + field(x, c, u, depth, lateral);
            if x.distance(c) > 3.0 * RADIUS {
                continue;
            }
            let blended: DVec3 = (0..3)
                .map(|i| {
                    let corner = body.element_nodes(element)[i];
                    let turned = DQuat::from_rotation_arc(u, corner.inward) * lateral;
                    field(x, corner.position, corner.inward, depth, turned) * n[i]
                })
                .sum();
            moved += p.distance_squared(there);
            fixed += (x + blended).distance_squared(there);
            area += 1.0;
        }
    }
    let [moved, fixed] = [moved, fixed].map(|squares: f64| (squares / area).sqrt() / depth);
    // About what a field at other nodes, 4 mm apart with middles between, can say of one that changes within 5 mm.
    assert!(moved < 0.02, "{moved} of the depth");
    assert!(fixed > 1.5 * moved, "{fixed} {moved}");
}

#[test]
fn the_surface_neither_tears_nor_jumps() {
    let (body, _) = with_fields(6.0);
    let mut deformer = Deformer::new(&body).unwrap();
    let (mut before, mut after) = (Vec::new(), Vec::new());
    let mut last: Option<ContactState> = None;
    // Over a hundred elements, round the ball.
    const STEPS: u32 = 2000;
    let mut greatest = 0.0f64;
    for i in 0..STEPS {
        let turn = f64::from(i) * 0.5 / f64::from(STEPS) * std::f64::consts::TAU;
        let x = DMat3::from_rotation_y(turn) * DVec3::new(0.0, 3e-3, 29.85e-3);
        let at = body.nearest(x, 1e-2).unwrap().at;
        let now = state(&body, at.element, at.n, 3e-3, DVec3::new(0.0, 5e-4, 0.0));
        deformer.displace(&body, &now, &mut after);
        if let Some(last) = last {
            let step = now.tool_m.distance(last.tool_m);
            let jump =
                before.iter().zip(&after).map(|(p, q): (&DVec3, &DVec3)| p.distance(*q)).fold(0.0, f64::max);
            greatest = greatest.max(jump / step);
        }
        last = Some(now);
        std::mem::swap(&mut before, &mut after);
    }
    assert!(greatest < 10.0, "the surface moved {greatest} times as far as the tool");
    // Nothing is left of it at the surface.
    let (body, _) = for_a_tip(6.0);
    let mut deformer = Deformer::new(&body).unwrap();
    let rest: Vec<DVec3> = body.nodes().iter().map(|n| n.position).collect();
    let light = state(&body, 9, [0.2, 0.5, 0.3], 1e-7, DVec3::ZERO);
    deformer.displace(&body, &light, &mut after);
    assert!(rest.iter().zip(&after).all(|(p, q)| p.distance(*q) < 1e-6));
    let outside = state(&body, 9, [0.2, 0.5, 0.3], -1e-3, DVec3::ZERO);
    deformer.displace(&body, &outside, &mut after);
    assert_eq!(rest, after);
}

#[test]
fn the_tool_never_shows_through() {
    let (fine, _) = with_fields(4.0);
    let bodies = [
        // Facets as large as the tool, and a dimple in place of fields.
        ball(8.0),
        fine.clone().with_displacement_fields(None).unwrap(),
        // Fields that do not fit: of a far softer middle than the ball makes.
        fine,
    ];
    let mut worst = 0.0f64;
    for (which, body) in bodies.iter().enumerate() {
        let mut deformer = Deformer::new(body).unwrap();
        let mut positions = Vec::new();
        for i in 0..60u32 {
            let element = i * 131 % body.elements().len() as u32;
            let n = [0.1 + 0.01 * f64::from(i), 0.2, 0.7 - 0.01 * f64::from(i)];
            let depth = 0.2e-3 + 1e-4 * f64::from(i);
            let lateral = DVec3::new(0.3, -0.2, 0.1) * depth;
            let state = state(body, element, n, depth, lateral);
            deformer.displace(body, &state, &mut positions);
            let through = show_through(body, &positions, &state, depth);
            worst = worst.max(through);
            assert!(through < 0.02, "body {which}, state {i}, {depth} m deep: {through} of the depth");
        }
    }
    println!("at most {worst} of the depth");
}

#[test]
fn creases_stay_closed_and_the_same_state_gives_the_same_surface() {
    let shape = Shape::Cylinder { radius_mm: 12.0, length_mm: 20.0, caps: true };
    let mesh = shape.surface(Resolution { edge_length_mm: Some(3.0), ..Default::default() }).unwrap();
    let triangles = mesh.elements().iter().map(|e| e.nodes).collect();
    let mesh = palpate_body::TriangleMesh { positions: mesh.positions().to_vec(), triangles };
    let body = of_surface(Surface::build(&mesh, 0.5).unwrap());
    assert!(body.has_creases());
    let mut deformer = Deformer::new(&body).unwrap();
    assert!(!deformer.has_fields());
    let (mut positions, mut again) = (Vec::new(), Vec::new());
    for element in 0..body.elements().len() as u32 {
        let state = state(&body, element, [0.6, 0.2, 0.2], 2e-3, DVec3::new(0.0, 3e-4, 3e-4));
        deformer.displace(&body, &state, &mut positions);
        let mut at: BTreeMap<[u64; 3], DVec3> = BTreeMap::new();
        for (node, p) in body.nodes().iter().zip(&positions) {
            let first = *at.entry(node.position.to_array().map(f64::to_bits)).or_insert(*p);
            assert_eq!(first, *p, "element {element}");
        }
    }
    let state = state(&body, 0, [0.6, 0.2, 0.2], 2e-3, DVec3::ZERO);
    deformer.displace(&body, &state, &mut positions);
    Deformer::new(&body).unwrap().displace(&body, &state, &mut again);
    assert_eq!(positions, again);
    // Another body's deformer does nothing.
    let other = ball(8.0);
    deformer.displace(&other, &state, &mut positions);
    assert!(other.nodes().iter().zip(&positions).all(|(n, p)| n.position == *p));
}

#[test]
fn finer_surfaces_keep_the_fields() {
    let (body, _) = for_a_tip(6.0);
    let finer = body.refined(Fineness::edge(1.5e-3)).unwrap().body;
    assert_eq!(finer.displacement_fields().unwrap(), body.displacement_fields().unwrap());
    let mut positions = Vec::new();
    let node = body.element_nodes(11)[1].position;
    let at = |body: &Body| body.nearest(node, 1e-3).unwrap().at;
    let (coarse_state, fine_state) =
        (ContactState::pressed(&body, at(&body), 3e-3), ContactState::pressed(&finer, at(&finer), 3e-3));
    let mut coarse = Vec::new();
    Deformer::new(&body).unwrap().displace(&body, &coarse_state, &mut coarse);
    Deformer::new(&finer).unwrap().displace(&finer, &fine_state, &mut positions);
    // Old nodes go where they went.
    let off = coarse.iter().zip(&positions).map(|(p, q)| p.distance(*q));
    assert!(off.fold(0.0, f64::max) < 0.03 * 3e-3);
    assert!(positions.len() > 4 * coarse.len());
}

/// What a picture costs: `cargo test --release -p palpate-body --test displacement -- --ignored --nocapture`.
#[test]
#[ignore = "it prints times, which mean something in a release build alone"]
fn a_surface_of_100_000_triangles() {
    let (coarse, on) = with_fields(3.0);
    let body = coarse.refined(Fineness::edge(0.62e-3)).unwrap().body;
    let begin = std::time::Instant::now();
    let mut deformer = Deformer::new(&body).unwrap();
    println!(
        "{} triangles, {} nodes of the simulation's surface, {} test points: prepared in {:.0} ms",
        body.elements().len(),
        on.positions().len(),
        body.test_point_nodes().len(),
        begin.elapsed().as_secs_f64() * 1e3
    );
    assert!(body.elements().len() >= 100_000);
    let mut positions = Vec::new();
    let mut times = Vec::new();
    for element in (0..body.elements().len() as u32).step_by(997) {
        let state = state(&body, element, [0.3, 0.3, 0.4], 4e-3, DVec3::new(4e-4, -3e-4, 7e-4));
        let begin = std::time::Instant::now();
        deformer.displace(&body, &state, &mut positions);
        times.push(begin.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    println!(
        "displaced in {:.1} ms (median), {:.1} ms at most",
        times[times.len() / 2],
        times[times.len() - 1]
    );
}
