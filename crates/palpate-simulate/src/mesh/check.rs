//! What would spoil a simulation, found before the first solve and named; how good the elements are.

use super::{EDGES, FACES, TetMesh};
use crate::error::{Result, SimulateError};
use glam::{DMat3, DVec3};

/// Elements whose scaled volume is below are flat: their volume is rounding.
const FLAT: f64 = 1e-9;

/// Dihedral angles beyond these are reported, rad: such elements are stiff and converge badly, but they are valid.
const SLIVER_RAD: [f64; 2] = [2.0 / 180.0 * std::f64::consts::PI, 178.0 / 180.0 * std::f64::consts::PI];

/// Fixed nodes nearer to one line than this share of their extent don't keep a part from turning about it.
const COLLINEAR: f64 = 1e-6;

/// Figures of a mesh, of its straight tetrahedra.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quality {
    /// How many elements.
    pub elements: usize,
    /// How many nodes.
    pub nodes: usize,
    /// How many faces on the boundary.
    pub boundary_faces: usize,
    /// The sum of the elements', m³.
    pub volume_m3: f64,
    /// The smallest angle between two faces of an element, rad.
    pub smallest_dihedral_rad: f64,
    /// The largest one, rad.
    pub largest_dihedral_rad: f64,
    /// The smallest of the elements' volumes, each divided by that of the regular tetrahedron whose edges have the
    /// element's root-mean-square length: 1 at best, 0 if flat, negative if inverted.
    pub smallest_scaled_volume: f64,
    /// Of all edges, m; one that several elements share counts as often.
    pub mean_edge_m: f64,
    /// The shortest edge on the boundary, m.
    pub shortest_boundary_edge_m: f64,
    /// Of the edges on the boundary, m.
    pub mean_boundary_edge_m: f64,
    /// The longest edge on the boundary, m.
    pub longest_boundary_edge_m: f64,
}

impl Quality {
    /// Measures a mesh.
    pub fn of(mesh: &TetMesh) -> Self {
        let boundary = mesh.boundary();
        let mut quality = Quality {
            elements: mesh.elements.len(),
            nodes: mesh.positions.len(),
            boundary_faces: boundary.faces.len(),
            smallest_dihedral_rad: f64::INFINITY,
            smallest_scaled_volume: f64::INFINITY,
            shortest_boundary_edge_m: f64::INFINITY,
            ..Quality::default()
        };
        for element in &mesh.elements {
            let p = corners(mesh, element);
            quality.volume_m3 += volume(&p);
            quality.smallest_scaled_volume = quality.smallest_scaled_volume.min(scaled_volume(&p));
            quality.mean_edge_m += EDGES.map(|[a, b]| p[a].distance(p[b])).iter().sum::<f64>();
            for angle in dihedral_angles(&p) {
                quality.smallest_dihedral_rad = quality.smallest_dihedral_rad.min(angle);
                quality.largest_dihedral_rad = quality.largest_dihedral_rad.max(angle);
            }
        }
        quality.mean_edge_m /= 6.0 * mesh.elements.len() as f64;
        for face in &boundary.faces {
            let p: [DVec3; 3] = std::array::from_fn(|i| mesh.positions[face[i] as usize]);
            for i in 0..3 {
                let length = p[i].distance(p[(i + 1) % 3]);
                quality.mean_boundary_edge_m += length;
                quality.shortest_boundary_edge_m = quality.shortest_boundary_edge_m.min(length);
                quality.longest_boundary_edge_m = quality.longest_boundary_edge_m.max(length);
            }
        }
        quality.mean_boundary_edge_m /= 3.0 * boundary.faces.len() as f64;
        quality
    }
}

/// Finds what can't be simulated; `fixed` says of every node whether it is held. The result is notes: what can be
/// simulated, but deserves a word.
///
/// `fixed` has for each node the axes along which it is held. Two parts are one if a face joins them. Each part must be held
/// so that it can neither move nor turn, be it by supports or by nodes that it shares with a part that is held: by three
/// that aren't on one line, or along axes that together stop its six motions.
///
/// # Errors
/// Elements without volume or inverted, curved ones that are so at a corner, a middle of an edge or a quadrature
/// point; the same element twice, faces of more than two elements, elements that overlap at a face, edges with two
/// middle nodes; parts that nothing holds.
///
/// # Panics
/// If `fixed` has not one entry for each node.
pub fn check(mesh: &TetMesh, fixed: &[[bool; 3]]) -> Result<Vec<String>> {
    assert_eq!(fixed.len(), mesh.positions.len());
    if mesh.elements.is_empty() {
        return Err(SimulateError::invalid("mesh", "there is no tetrahedron in it", "mesh the volume"));
    }
    let mut notes = Vec::new();
    notes.extend(elements_are_sound(mesh)?);
    edges_have_one_middle(mesh)?;
    let neighbours = faces_are_sound(mesh)?;
    notes.extend(nodes_at_one_place(mesh));
    parts_are_held(mesh, fixed, &neighbours)?;
    Ok(notes)
}

fn corners(mesh: &TetMesh, element: &[u32; 10]) -> [DVec3; 4] {
    std::array::from_fn(|i| mesh.positions[element[i] as usize])
}

fn volume(p: &[DVec3; 4]) -> f64 {
    (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) / 6.0
}

/// A regular tetrahedron of edge l has the volume l³ / (6 √2).
fn scaled_volume(p: &[DVec3; 4]) -> f64 {
    let mean_square = EDGES.map(|[a, b]| p[a].distance_squared(p[b])).iter().sum::<f64>() / 6.0;
    if mean_square > 0.0 { 6.0 * 2f64.sqrt() * volume(p) / (mean_square * mean_square.sqrt()) } else { 0.0 }
}

/// Angles between the faces that meet at each edge.
fn dihedral_angles(p: &[DVec3; 4]) -> [f64; 6] {
    EDGES.map(|[a, b]| {
        let mut others = (0..4).filter(|&i| i != a && i != b);
        let (Some(c), Some(d)) = (others.next(), others.next()) else { return 0.0 };
        let along = p[b] - p[a];
        let (u, v) = (along.cross(p[c] - p[a]), along.cross(p[d] - p[a]));
        libm::atan2(u.cross(v).length(), u.dot(v))
    })
}

/// An element's number and place.
fn named(mesh: &TetMesh, e: usize) -> String {
    let middle = corners(mesh, &mesh.elements[e]).iter().sum::<DVec3>() / 4.0;
    format!("element {e} (from 0) at {}", in_mm(middle))
}

fn in_mm(p: DVec3) -> String {
    let p = p * 1e3;
    format!("({:.3}, {:.3}, {:.3}) mm", p.x, p.y, p.z)
}

fn elements_are_sound(mesh: &TetMesh) -> Result<Option<String>> {
    let mut slivers = 0;
    let mut worst = (0, 0.0, 0.0);
    for (e, element) in mesh.elements.iter().enumerate() {
        let p = corners(mesh, element);
        let scaled = scaled_volume(&p);
        if scaled.is_nan() || scaled <= FLAT {
            let problem = if scaled < -FLAT { "it is inverted" } else { "it is flat: it has no volume" };
            let hint = "mesh it again, and optimise (gmsh -optimize)";
            return Err(SimulateError::invalid(named(mesh, e), problem, hint));
        }
        is_sound_where_curved(mesh, e)?;
        let angles = dihedral_angles(&p);
        let (smallest, largest) =
            angles.iter().fold((f64::INFINITY, 0.0f64), |(s, l), &a| (s.min(a), l.max(a)));
        let distance = smallest.min(std::f64::consts::PI - largest);
        if smallest < SLIVER_RAD[0] || largest > SLIVER_RAD[1] {
            if slivers == 0 || distance < worst.1 {
                worst = (e, distance, if smallest == distance { smallest } else { largest });
            }
            slivers += 1;
        }
    }
    Ok((slivers > 0).then(|| {
        format!(
            "{slivers} of {} elements are slivers; the worst has an angle of {:.2}°: {}; it will slow the solver \
             down, better mesh it again and optimise (gmsh -optimize)",
            mesh.elements.len(),
            worst.2.to_degrees(),
            named(mesh, worst.0)
        )
    }))
}

/// Where the Jacobian of a curved element is looked at, as barycentric coordinates: corners, middles of edges, centre,
/// and the quadrature points of degree 2 (Hammer, Marlowe and Stroud, 1956).
fn samples() -> impl Iterator<Item = [f64; 4]> {
    let unit = |i: usize| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
    let middle = |[a, b]: [usize; 2]| std::array::from_fn(|j| if j == a || j == b { 0.5 } else { 0.0 });
    let inner = |i: usize| {
        std::array::from_fn(|j| if i == j { 0.585_410_196_624_968_5 } else { 0.138_196_601_125_010_5 })
    };
    (0..4).map(unit).chain(EDGES.map(middle)).chain((0..4).map(inner)).chain([[0.25; 4]])
}

/// The derivative of the position by barycentric coordinates 1 to 3, at `l`: the shape functions are Lᵢ (2 Lᵢ − 1) at
/// corners and 4 Lₐ Lᵦ on edges.
fn jacobian(p: &[DVec3; 10], l: [f64; 4]) -> f64 {
    let mut by = [DVec3::ZERO; 4];
    for i in 0..4 {
        by[i] += (4.0 * l[i] - 1.0) * p[i];
    }
    for (i, [a, b]) in EDGES.into_iter().enumerate() {
        by[a] += 4.0 * l[b] * p[4 + i];
        by[b] += 4.0 * l[a] * p[4 + i];
    }
    DMat3::from_cols(by[1] - by[0], by[2] - by[0], by[3] - by[0]).determinant()
}

fn is_sound_where_curved(mesh: &TetMesh, e: usize) -> Result<()> {
    let p = mesh.elements[e].map(|n| mesh.positions[n as usize]);
    let straight = EDGES.iter().enumerate().all(|(i, &[a, b])| {
        p[4 + i].distance_squared((p[a] + p[b]) / 2.0) <= 1e-20 * p[a].distance_squared(p[b])
    });
    if straight {
        return Ok(());
    }
    // Against the straight element's, which is positive.
    let least = samples().map(|l| jacobian(&p, l)).fold(f64::INFINITY, f64::min);
    let rest = 6.0 * volume(&[p[0], p[1], p[2], p[3]]);
    if least > FLAT * rest {
        return Ok(());
    }
    let nearest = |i: usize| {
        let to = |&[a, b]: &[usize; 2]| p[4 + i].distance_squared((p[a] + p[b]) / 2.0);
        (0..6).min_by(|&j, &k| to(&EDGES[j]).total_cmp(&to(&EDGES[k])))
    };
    // One to one, but not each to its own: no bend does that.
    let order: [Option<usize>; 6] = std::array::from_fn(nearest);
    if order != std::array::from_fn(Some) && (0..6).all(|i| order.contains(&Some(i))) {
        let problem = "its nodes on edges stand in another order: each lies nearest to another's edge";
        let hint = "save the mesh with the program that made it, or as linear (Gmsh: SetOrder 1)";
        return Err(SimulateError::invalid(named(mesh, e), problem, hint));
    }
    let problem = format!(
        "it is curved so much that it folds (Jacobian {:.3} of the straight element's)",
        least / rest
    );
    let hint = "mesh it finer, optimise it (gmsh -optimize_ho), or make it linear (Gmsh: SetOrder 1)";
    Err(SimulateError::invalid(named(mesh, e), problem, hint))
}

/// Where two elements have one edge but two nodes on it, the body would gape.
fn edges_have_one_middle(mesh: &TetMesh) -> Result<()> {
    let mut edges: Vec<([u32; 2], u32, u32)> = Vec::with_capacity(6 * mesh.elements.len());
    for (e, element) in mesh.elements.iter().enumerate() {
        edges.extend(EDGES.iter().enumerate().map(|(i, &[a, b])| {
            let (a, b) = (element[a], element[b]);
            ([a.min(b), a.max(b)], element[4 + i], e as u32)
        }));
    }
    edges.sort_unstable();
    let Some(pair) = edges.windows(2).find(|pair| pair[0].0 == pair[1].0 && pair[0].1 != pair[1].1) else {
        return Ok(());
    };
    let problem = format!("it and element {} have different nodes on the edge that they share", pair[1].2);
    let hint = "join nodes at one place (Gmsh: Coherence Mesh), or mesh it again";
    Err(SimulateError::invalid(named(mesh, pair[0].2 as usize), problem, hint))
}

/// Pairs of elements that a face joins.
fn faces_are_sound(mesh: &TetMesh) -> Result<Vec<[u32; 2]>> {
    // Sorted corners, whether sorting turned the face round, and the element.
    let mut faces: Vec<([u32; 3], bool, u32)> = Vec::with_capacity(4 * mesh.elements.len());
    for (e, element) in mesh.elements.iter().enumerate() {
        for face in FACES {
            let mut key = face.map(|c| element[c]);
            let mut odd = false;
            for (i, j) in [(0, 1), (1, 2), (0, 1)] {
                if key[i] > key[j] {
                    key.swap(i, j);
                    odd = !odd;
                }
            }
            faces.push((key, odd, e as u32));
        }
    }
    faces.sort_unstable();
    let mut pairs = Vec::with_capacity(faces.len() / 2);
    let mut overlap = None;
    for run in faces.chunk_by(|a, b| a.0 == b.0) {
        let place = || named(mesh, run[0].2 as usize);
        let same = |a: u32, b: u32| {
            let sorted = |e: u32| {
                let mut c = mesh.elements[e as usize];
                c[..4].sort_unstable();
                [c[0], c[1], c[2], c[3]]
            };
            sorted(a) == sorted(b)
        };
        // Two elements on different sides of a face are no doubles.
        let suspect = run.len() > 2 || matches!(run, [a, b] if a.1 == b.1);
        for (i, (_, _, a)) in run.iter().enumerate().filter(|_| suspect) {
            if let Some((_, _, b)) = run[i + 1..].iter().find(|(_, _, b)| same(*a, *b)) {
                return Err(SimulateError::invalid(
                    named(mesh, *a as usize),
                    format!("element {b} has the same four corners"),
                    "remove one; MSH 2.2 writes an element once for each of its physical volumes, of which it may have one",
                ));
            }
        }
        match run {
            [_] => {}
            [(_, odd, a), (_, other, b)] => {
                if odd == other && overlap.is_none() {
                    let problem =
                        format!("it and element {b} lie on the same side of the face that they share");
                    overlap = Some(SimulateError::invalid(
                        place(),
                        problem,
                        "mesh it again: elements must not overlap",
                    ));
                }
                pairs.push([*a, *b]);
            }
            more => {
                let numbers: Vec<String> = more.iter().map(|(_, _, e)| e.to_string()).take(5).collect();
                let problem =
                    format!("one of its faces belongs to {} elements: {}", more.len(), numbers.join(", "));
                return Err(SimulateError::invalid(
                    place(),
                    problem,
                    "remove those that overlap, or mesh it again",
                ));
            }
        }
    }
    // Last, since doubles overlap too, and that says less.
    overlap.map_or(Ok(pairs), Err)
}

/// Parts that were meshed apart look joined, but aren't.
fn nodes_at_one_place(mesh: &TetMesh) -> Option<String> {
    // Adding 0 makes -0 and 0 one.
    let mut places: Vec<[u64; 3]> =
        mesh.positions.iter().map(|&p| (p + DVec3::ZERO).to_array().map(f64::to_bits)).collect();
    places.sort_unstable();
    let mut doubles = places.windows(2).filter(|pair| pair[0] == pair[1]);
    let first = DVec3::from_array(doubles.next()?[0].map(f64::from_bits));
    Some(format!(
        "{} nodes lie exactly where another one does, the first at {}: the elements there touch, but aren't joined; \
         if they should be, join the nodes (Gmsh: Coherence Mesh)",
        1 + doubles.count(),
        in_mm(first)
    ))
}

/// Which part each element belongs to, and how many there are.
fn parts(elements: usize, pairs: &[[u32; 2]]) -> (Vec<u32>, usize) {
    let mut parent: Vec<u32> = (0..elements as u32).collect();
    fn root(parent: &mut [u32], mut e: u32) -> u32 {
        while parent[e as usize] != e {
            parent[e as usize] = parent[parent[e as usize] as usize];
            e = parent[e as usize];
        }
        e
    }
    for &[a, b] in pairs {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        // The smallest element is the root: parts are numbered in the order of the elements.
        parent[a.max(b) as usize] = a.min(b);
    }
    let mut count = 0;
    let mut part = vec![0; elements];
    for e in 0..elements as u32 {
        let root = root(&mut parent, e);
        part[e as usize] = if root == e {
            count += 1;
            count - 1
        } else {
            part[root as usize]
        };
    }
    (part, count as usize)
}

fn parts_are_held(mesh: &TetMesh, fixed: &[[bool; 3]], pairs: &[[u32; 2]]) -> Result<()> {
    let hint = "hold it with `[[body.fixed]]`";
    if !fixed.iter().flatten().any(|held| *held) {
        return Err(SimulateError::invalid("mesh", "nothing holds the body: no node is fixed", hint));
    }
    let (part, count) = parts(mesh.elements.len(), pairs);
    let mut nodes: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (element, &part) in mesh.elements.iter().zip(&part) {
        nodes[part as usize].extend(element);
    }
    for nodes in &mut nodes {
        nodes.sort_unstable();
        nodes.dedup();
    }
    // What a held part shares with another holds that one on all sides.
    let mut held = fixed.to_vec();
    let mut free: Vec<usize> = (0..count).collect();
    loop {
        let before = free.len();
        free.retain(|&part| {
            let firm = hold(&mesh.positions, &held, &nodes[part]) == Hold::Firm;
            if firm {
                nodes[part].iter().for_each(|&n| held[n as usize] = [true; 3]);
            }
            !firm
        });
        if free.len() == before {
            break;
        }
    }
    let Some(&first) = free.first() else { return Ok(()) };
    let elements: Vec<usize> = (0..part.len()).filter(|&e| part[e] as usize == first).collect();
    let p = || nodes[first].iter().map(|&n| mesh.positions[n as usize]);
    let (low, high) = (p().fold(DVec3::INFINITY, DVec3::min), p().fold(DVec3::NEG_INFINITY, DVec3::max));
    let region = &mesh.region_names[mesh.regions[elements[0]] as usize];
    let region = if region.is_empty() { String::new() } else { format!(" of region `{region}`") };
    let size = (high - low) * 1e3;
    let mut place = format!(
        "part of {} elements{region}, {:.3} x {:.3} x {:.3} mm around {}",
        elements.len(),
        size.x,
        size.y,
        size.z,
        in_mm((low + high) / 2.0)
    );
    if free.len() > 1 {
        place += &format!(", and {} more", free.len() - 1);
    }
    let problem = match hold(&mesh.positions, &held, &nodes[first]) {
        Hold::Nothing => "nothing holds it: none of its nodes is fixed or shared with a part that is held",
        Hold::Point => "it is held at one place only, about which it can turn",
        Hold::Line => "it is held along one line only, about which it can turn",
        Hold::Axes | Hold::Firm => "it can slide or turn: what holds it does so along some of the axes only",
    };
    let hint = if count == 1 {
        "hold it at three nodes at least with `[[body.fixed]]`"
    } else {
        "hold it with `[[body.fixed]]`, join it to its neighbours face to face, or remove it"
    };
    Err(SimulateError::invalid(place, problem, hint))
}

#[derive(PartialEq)]
enum Hold {
    Nothing,
    Point,
    Line,
    /// Held along some axes, but not so that it could neither move nor turn.
    Axes,
    Firm,
}

/// What the held of a part's nodes leave free.
fn hold(positions: &[DVec3], held: &[[bool; 3]], nodes: &[u32]) -> Hold {
    let axes = |n: &u32| held[*n as usize];
    let on_all_sides = |n: &&u32| axes(n) == [true; 3];
    let fully = hold_fully(positions, nodes.iter().filter(on_all_sides));
    let partly = nodes.iter().any(|n| axes(n).contains(&true) && axes(n).contains(&false));
    if fully == Hold::Firm || !partly {
        return fully;
    }
    let all = nodes.iter().map(|n| (positions[*n as usize], axes(n)));
    if holds(all) { Hold::Firm } else { Hold::Axes }
}

/// What nodes that can't move along any axis leave free.
fn hold_fully<'a>(positions: &[DVec3], nodes: impl Iterator<Item = &'a u32> + Clone) -> Hold {
    let places = nodes.map(|&n| positions[n as usize]);
    let Some(first) = places.clone().next() else { return Hold::Nothing };
    let farthest = |to: &dyn Fn(DVec3) -> f64| {
        places
            .clone()
            .map(|p| (to(p), p))
            .fold((0.0, first), |best, next| if next.0 > best.0 { next } else { best })
    };
    let (length, end) = farthest(&|p| p.distance(first));
    if length == 0.0 {
        return Hold::Point;
    }
    let along = (end - first) / length;
    let (off, _) = farthest(&|p| (p - first).cross(along).length());
    if off > COLLINEAR * length { Hold::Firm } else { Hold::Line }
}

/// Whether supports stop all six motions of a rigid body, whose nodes are given with the axes along which each is held:
/// the rank of those motions in the held components.
pub(crate) fn holds(nodes: impl Iterator<Item = (DVec3, [bool; 3])> + Clone) -> bool {
    let (count, sum) = nodes.clone().fold((0.0, DVec3::ZERO), |(n, sum), (p, _)| (n + 1.0, sum + p));
    let middle = sum / count;
    let size = nodes.clone().map(|(p, _)| p.distance(middle)).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let mut gram = [[0.0; 6]; 6];
    for (p, axes) in nodes {
        let arm = (p - middle) / size;
        for axis in (0..3).filter(|&axis| axes[axis]) {
            let along = DVec3::AXES[axis];
            let turn = arm.cross(along);
            let row = [along.x, along.y, along.z, turn.x, turn.y, turn.z];
            for (sums, a) in gram.iter_mut().zip(row) {
                for (sum, b) in sums.iter_mut().zip(row) {
                    *sum += a * b;
                }
            }
        }
    }
    // Gauss with the largest pivot; relative to the count of held components, which is the trace's order.
    let enough = 1e-9 * (0..6).map(|i| gram[i][i]).fold(0.0, f64::max);
    for step in 0..6 {
        let Some(pivot) = (step..6).max_by(|&i, &j| gram[i][i].total_cmp(&gram[j][j])) else { return false };
        if gram[pivot][pivot] <= enough {
            return false;
        }
        gram.swap(step, pivot);
        gram.iter_mut().for_each(|row| row.swap(step, pivot));
        let head = gram[step];
        for row in &mut gram[step + 1..] {
            let factor = row[step] / head[step];
            for (value, head) in row.iter_mut().zip(head) {
                *value -= factor * head;
            }
        }
    }
    true
}
