//! Which nodes become test points: as far from each other as they can be, then each moved to the middle of its cell.
//!
//! Farthest points first (Gonzalez 1985), then Lloyd's iteration onto nodes, with distances along the surface. Edge
//! collapse would keep original vertices too, but it ends at a number of triangles, not of points, it thins out flat
//! parts, which are as soft as any, and the library at hand for it is C++.
//!
//! Lengths are those of the surface lifted by its normals and by the compliance prior: where the surface turns, or the compliance prior
//! changes, it is longer, and points are denser.

use crate::error::FitError;
use crate::geodesic::{Geodesic, NONE, vertex_positions};
use glam::DVec3;
use palpate_body::Surface;

/// How many test points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Amount {
    /// So many.
    Count(usize),
    /// As many as lie this far from each other, m.
    Spacing(f64),
}

/// Where a tool may come that needs `margin_m` around it: for each node, whether it is farther than that, along the
/// surface, from all nodes that are `held`. Nearer, the tool would press on what can't give way, and forces rise many
/// times over within a few millimetres: no interpolation follows that.
///
/// # Errors
/// A mask of another length than the nodes.
pub fn touchable(surface: &Surface, held: &[bool], margin_m: f64) -> Result<Vec<bool>, FitError> {
    let nodes = surface.positions().len();
    if held.len() != nodes {
        let problem = format!("{} entries for {nodes} nodes", held.len());
        return Err(FitError::invalid("what is held", problem, "give one for each node"));
    }
    let positions = vertex_positions(surface);
    let length = |a: u32, b: u32| positions[a as usize].distance(positions[b as usize]);
    let mut geodesic = Geodesic::new(surface, &length);
    let mut reached = geodesic.unreached();
    let mut sources: Vec<u32> =
        surface.vertices().iter().zip(held).filter(|(_, held)| **held).map(|(v, _)| *v).collect();
    sources.sort_unstable();
    sources.dedup();
    geodesic.spread(&mut reached, sources.into_iter().map(|v| (0, v)));
    Ok(surface.vertices().iter().map(|&v| reached[v as usize].distance > margin_m).collect())
}

/// Chooses test points among the nodes that `touchable` says can be touched: one entry for each node, which is true
/// where the tool may come. Some of them lie on its rim, so that little of it lies outside the points' mesh.
///
/// `compliance_prior`, if given, is a positive number for each node that the response is known to go with, such as the
/// stiffness of a linear body: points are denser where it changes.
///
/// The result ascends, has exactly the count asked for, one node for a vertex, and depends on nothing else.
///
/// # Errors
/// Masks or guides of another length than the nodes, guides that are not positive, a spacing that is not, nothing
/// that can be touched, or fewer vertices to touch than points.
pub fn test_points(
    surface: &Surface,
    touchable: &[bool],
    amount: Amount,
    compliance_prior: Option<&[f64]>,
) -> Result<Vec<u32>, FitError> {
    let nodes = surface.positions().len();
    if touchable.len() != nodes {
        let problem = format!("{} entries for {nodes} nodes", touchable.len());
        return Err(FitError::invalid("what can be touched", problem, "give one for each node"));
    }
    check_prior(compliance_prior, nodes)?;
    let vertices = Vertices::new(surface, touchable);
    let Vertices { open, .. } = &vertices;
    let available = open.iter().filter(|&&o| o).count();
    if available == 0 {
        let (problem, hint) = ("there is nothing", "leave a part of the surface free of supports");
        return Err(FitError::invalid("what can be touched", problem, hint));
    }
    let triangles = triangles(surface);
    let area = open_area(&triangles, &vertices);
    let count = match amount {
        Amount::Count(count) => count,
        Amount::Spacing(spacing) if spacing > 0.0 => {
            // Of a lattice of equilateral triangles; the vertices are enough for any spacing.
            (area * 2.0 / (3f64.sqrt() * spacing * spacing)).round().clamp(1.0, available as f64) as usize
        }
        Amount::Spacing(spacing) => {
            let problem = format!("the spacing is {spacing} m");
            return Err(FitError::invalid("test points", problem, "give one greater than 0"));
        }
    };
    if count == 0 || count > available {
        return Err(FitError::invalid(
            "test points",
            format!("{count} are asked for, where the part that can be touched has {available} vertices"),
            "give a count from 1 to that number, or refine the mesh",
        ));
    }

    Ok(choose(surface, &vertices, &triangles, open, count, area, compliance_prior))
}

/// Chooses `count` of these `candidates`, nodes of different vertices, spread over what can be touched as [`test_points`]
/// spreads its own; all of them if there are no more.
///
/// # Errors
/// As [`test_points`], and a candidate that is no node.
pub fn spread_among(
    surface: &Surface,
    touchable: &[bool],
    candidates: &[u32],
    count: usize,
    compliance_prior: Option<&[f64]>,
) -> Result<Vec<u32>, FitError> {
    let nodes = surface.positions().len();
    if touchable.len() != nodes || candidates.iter().any(|&n| n as usize >= nodes) || count == 0 {
        let problem = format!("{count} of {} candidates, for {nodes} nodes", candidates.len());
        return Err(FitError::invalid("candidates", problem, "choose some of the surface's nodes"));
    }
    check_prior(compliance_prior, nodes)?;
    let mut all = candidates.to_vec();
    all.sort_unstable();
    if all.len() <= count {
        return Ok(all);
    }
    let mut vertices = Vertices::new(surface, touchable);
    let mut candidate = vec![false; vertices.positions.len()];
    for &n in &all {
        let v = surface.vertices()[n as usize] as usize;
        candidate[v] = true;
        vertices.first[v] = n;
    }
    let triangles = triangles(surface);
    let area = open_area(&triangles, &vertices);
    Ok(choose(surface, &vertices, &triangles, &candidate, count, area, compliance_prior))
}

/// The vertices of a surface.
struct Vertices {
    positions: Vec<DVec3>,
    /// The node that speaks for each.
    first: Vec<u32>,
    /// Whether any of its nodes can be touched.
    open: Vec<bool>,
}

impl Vertices {
    fn new(surface: &Surface, touchable: &[bool]) -> Self {
        let positions = vertex_positions(surface);
        let mut first = vec![NONE; positions.len()];
        let mut open = vec![false; positions.len()];
        for (n, &v) in surface.vertices().iter().enumerate() {
            let v = v as usize;
            open[v] |= touchable[n];
            if first[v] == NONE {
                first[v] = n as u32;
            }
        }
        Vertices { positions, first, open }
    }
}

fn triangles(surface: &Surface) -> Vec<[u32; 3]> {
    surface.elements().iter().map(|e| e.nodes.map(|n| surface.vertices()[n as usize])).collect()
}

/// Of the triangles that can be touched, m².
fn open_area(triangles: &[[u32; 3]], Vertices { positions, open, .. }: &Vertices) -> f64 {
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        (b - a).cross(c - a).length() / 2.0
    };
    triangles.iter().filter(|t| t.iter().all(|&v| open[v as usize])).map(area).sum()
}

/// Spreads `count` points over the vertices that can be touched, each on a `candidate`.
fn choose(
    surface: &Surface,
    Vertices { positions, first, open }: &Vertices,
    triangles: &[[u32; 3]],
    candidate: &[bool],
    count: usize,
    area: f64,
    compliance_prior: Option<&[f64]>,
) -> Vec<u32> {
    let lifted = lift(surface, positions, first, compliance_prior, (area / count as f64).sqrt());
    let length = |a: u32, b: u32| distance(&lifted[a as usize], &lifted[b as usize]);
    let mut weights = vec![0.0; positions.len()];
    for t in triangles {
        let [a, b, c] = [length(t[0], t[1]), length(t[1], t[2]), length(t[2], t[0])];
        // Heron; rounding may take a sliver's area below 0.
        let s = (a + b + c) / 2.0;
        let area = (s * (s - a) * (s - b) * (s - c)).max(0.0).sqrt();
        t.iter().for_each(|&v| weights[v as usize] += area / 3.0);
    }
    let mut rim = vec![false; positions.len()];
    for t in triangles.iter().filter(|t| t.iter().any(|&v| !open[v as usize])) {
        t.iter().for_each(|&v| rim[v as usize] = open[v as usize]);
    }
    for (e, i) in surface.border() {
        for v in [triangles[e][i], triangles[e][(i + 1) % 3]] {
            rim[v as usize] = open[v as usize];
        }
    }
    let mut geodesic = Geodesic::new(surface, &length);
    let mut sources = farthest(&mut geodesic, &lifted, candidate, &weights, count);
    relax(&mut geodesic, &lifted, candidate, &rim, &weights, &mut sources);
    let mut chosen: Vec<u32> = sources.into_iter().map(|v| first[v as usize]).collect();
    chosen.sort_unstable();
    chosen
}

pub(crate) fn check_prior(compliance_prior: Option<&[f64]>, nodes: usize) -> Result<(), FitError> {
    let Some(compliance_prior) = compliance_prior else { return Ok(()) };
    let bad = |place: String, problem: String, hint: &str| Err(FitError::invalid(place, problem, hint));
    if compliance_prior.len() != nodes {
        return bad(
            "compliance prior".into(),
            format!("{} values for {nodes} nodes", compliance_prior.len()),
            "give one for each",
        );
    }
    match compliance_prior.iter().position(|g| !(*g > 0.0 && g.is_finite())) {
        Some(n) => bad(
            format!("compliance prior, node {n}"),
            format!("it is {}", compliance_prior[n]),
            "give positive numbers",
        ),
        None => Ok(()),
    }
}

/// A point in space, with its normal and prior as further coordinates.
type Lifted = [f64; 7];

fn distance(a: &Lifted, b: &Lifted) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// Vertices, lifted: a turn of 1 rad counts as one spacing, and so does a third of an e-fold change of the compliance prior.
/// Interpolation between points that far apart would be off by more than the goal of a few percent.
fn lift(
    surface: &Surface,
    positions: &[DVec3],
    first: &[u32],
    compliance_prior: Option<&[f64]>,
    spacing: f64,
) -> Vec<Lifted> {
    let lift = |(p, &n): (&DVec3, &u32)| {
        let u = surface.inward_normals()[n as usize] * spacing;
        let g = compliance_prior.map_or(0.0, |g| 3.0 * spacing * libm::log(g[n as usize]));
        [p.x, p.y, p.z, u.x, u.y, u.z, g]
    };
    positions.iter().zip(first).map(lift).collect()
}

/// The weighted mean of some vertices.
fn middle(vertices: impl Iterator<Item = u32>, lifted: &[Lifted], weights: &[f64]) -> Lifted {
    let (mut sum, mut total) = ([0.0; 7], 0.0);
    for v in vertices {
        let w = weights[v as usize];
        sum.iter_mut().zip(lifted[v as usize]).for_each(|(s, x)| *s += w * x);
        total += w;
    }
    sum.map(|s| s / total)
}

/// Each the farthest of all from those before; the first from the middle of them all. A part that none can reach is
/// infinitely far.
fn farthest<L: Fn(u32, u32) -> f64>(
    geodesic: &mut Geodesic<'_, L>,
    lifted: &[Lifted],
    open: &[bool],
    weights: &[f64],
    count: usize,
) -> Vec<u32> {
    let candidates = || (0..open.len() as u32).filter(|&v| open[v as usize]);
    let middle = middle(candidates(), lifted, weights);
    let mut reached = geodesic.unreached();
    let mut sources = Vec::with_capacity(count);
    for t in 0..count {
        let far = |v: u32| {
            let to_middle = distance(&lifted[v as usize], &middle);
            (if t == 0 { to_middle } else { reached[v as usize].distance }, to_middle)
        };
        let mut best = ((-1.0, -1.0), 0);
        for v in candidates() {
            let found = far(v);
            if found > best.0 {
                best = (found, v);
            }
        }
        sources.push(best.1);
        geodesic.spread(&mut reached, std::iter::once((t as u32, best.1)));
    }
    sources
}

/// Moves each point to the vertex nearest to its cell's middle, until none moves or it has been enough. A point on the
/// rim stays on it, and none other comes there.
fn relax<L: Fn(u32, u32) -> f64>(
    geodesic: &mut Geodesic<'_, L>,
    lifted: &[Lifted],
    open: &[bool],
    rim: &[bool],
    weights: &[f64],
    sources: &mut [u32],
) {
    /// Points creep by less than a vertex after that.
    const ROUNDS: usize = 30;
    for _ in 0..ROUNDS {
        let labels = geodesic.cells(sources);
        let mut cells = vec![Vec::new(); sources.len()];
        for (v, &t) in labels.iter().enumerate().filter(|&(v, &t)| t != NONE && open[v]) {
            cells[t as usize].push(v as u32);
        }
        let mut moved = false;
        for (source, cell) in sources.iter_mut().zip(&cells) {
            let on_rim = rim[*source as usize];
            let alike = || cell.iter().copied().filter(|&v| rim[v as usize] == on_rim);
            let middle = if on_rim {
                middle(alike(), lifted, weights)
            } else {
                middle(cell.iter().copied(), lifted, weights)
            };
            let mut best = (distance(&lifted[*source as usize], &middle), *source);
            for v in alike() {
                let d = distance(&lifted[v as usize], &middle);
                if d < best.0 {
                    best = (d, v);
                }
            }
            moved |= std::mem::replace(source, best.1) != best.1;
        }
        if !moved {
            break;
        }
    }
}
