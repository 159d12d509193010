//! Which test points a node blends: area interpolation from the mesh of test points (the paper's Fig. 7).
//!
//! That mesh is the dual of the test points' Voronoi cells on the surface: each vertex is labelled with the test
//! point that is nearest along the surface, and an element whose vertices have three labels joins these three. A node
//! is projected onto the dual triangles of its cell and of the cells around; where cells meet in pairs only (a strip,
//! a rod) or not at all, segments and single points take the triangles' place.

use crate::error::FitError;
use crate::geodesic::{Geodesic, Lists, NONE, vertex_positions};
use glam::DVec3;
use palpate_body::{BlendWeights, Surface};

/// A blend for every node: a node that is a test point is its own, any other blends up to three around it.
///
/// Weights are non-negative and sum to 1, test points ascend, and neighbouring nodes between the same three test
/// points name them alike. All nodes of a creased vertex have the same blend.
///
/// # Errors
/// No test point, one that is no node, two on one vertex, or a connected part of the surface without any.
pub fn spread(surface: &Surface, test_point_nodes: &[u32]) -> Result<Vec<BlendWeights>, FitError> {
    let blends = place(surface, test_point_nodes)?;
    surface
        .vertices()
        .iter()
        .enumerate()
        .map(|(n, &v)| {
            blends[v as usize].ok_or_else(|| {
                let p = surface.positions()[n];
                FitError::invalid(
                    format!("node {n} at ({:.6}, {:.6}, {:.6}) m", p.x, p.y, p.z),
                    "no test point lies on its connected part of the surface",
                    "add a test point there, or remove that part of the mesh",
                )
            })
        })
        .collect()
}

/// Bends a blend so that it makes `target` of its test points' values; all are positive.
///
/// Of the values v and the target t, gᵢ = vᵢ/t − 1: weights are wᵢ = nᵢ / (1 + θ gᵢ) with nᵢ those before, and θ such that
/// Σ wᵢ gᵢ = 0: of all that satisfy it, the nearest to nᵢ by Σ nᵢ ln(nᵢ/wᵢ) (empirical likelihood, Owen 1988). They sum
/// to 1 by themselves. Where the target is beyond all three values the blend is the nearest of them.
pub(crate) fn follow(blend: &mut BlendWeights, values: [f64; 3], target: f64) {
    blend.weights = bend(blend.weights, values.map(|value| value / target - 1.0));
}

/// As [`spread`], but a part of the surface without a test point, such as the wall of a hollow that no tool reaches,
/// has the response of the test point nearest in space. Also how many nodes are so.
///
/// # Errors
/// No test point, one that is no node, or two on one vertex.
pub fn spread_everywhere(
    surface: &Surface,
    test_point_nodes: &[u32],
) -> Result<(Vec<BlendWeights>, usize), FitError> {
    let placed = place(surface, test_point_nodes)?;
    let mut alone = 0;
    let nearest = |p: DVec3| {
        let distance = |t: &usize| surface.positions()[test_point_nodes[*t] as usize].distance_squared(p);
        (0..test_point_nodes.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    };
    let blends = (surface.vertices().iter().zip(surface.positions()))
        .map(|(&v, &p)| {
            placed[v as usize].unwrap_or_else(|| {
                alone += 1;
                BlendWeights::own(nearest(p) as u32)
            })
        })
        .collect();
    Ok((blends, alone))
}

/// Weights near `n` with Σ w d = 0.
fn bend(n: [f64; 3], d: [f64; 3]) -> [f64; 3] {
    let used = || (0..3).filter(|&i| n[i] > 0.0);
    let low = used().map(|i| d[i]).fold(f64::INFINITY, f64::min);
    let high = used().map(|i| d[i]).fold(f64::NEG_INFINITY, f64::max);
    if low >= 0.0 || high <= 0.0 {
        let nearest = if low >= 0.0 { low } else { high };
        let share = |i: usize| if d[i] == nearest { n[i] } else { 0.0 };
        let sum: f64 = (0..3).map(share).sum();
        return std::array::from_fn(|i| share(i) / sum);
    }
    // Σ n d / (1 + θ d) falls between the poles, from +∞ to −∞.
    let (mut least, mut most) = (-1.0 / high, -1.0 / low);
    for _ in 0..100 {
        let theta = (least + most) / 2.0;
        let sum: f64 = used().map(|i| n[i] * d[i] / (1.0 + theta * d[i])).sum();
        if sum > 0.0 { least = theta } else { most = theta }
    }
    let theta = (least + most) / 2.0;
    let w: [f64; 3] = std::array::from_fn(|i| if n[i] > 0.0 { n[i] / (1.0 + theta * d[i]) } else { 0.0 });
    let sum: f64 = w.iter().sum();
    w.map(|w| w / sum)
}

/// A blend for every vertex; none where no test point can be reached along the surface.
pub(crate) fn place(
    surface: &Surface,
    test_point_nodes: &[u32],
) -> Result<Vec<Option<BlendWeights>>, FitError> {
    let positions = vertex_positions(surface);
    let count = positions.len();
    let sources = sources(surface.vertices(), test_point_nodes)?;
    let length = |a: u32, b: u32| positions[a as usize].distance(positions[b as usize]);
    let labels = Geodesic::new(surface, &length).cells(&sources);
    let dual = Dual::new(surface, &labels, sources.iter().map(|&v| positions[v as usize]).collect());

    let mut blends = vec![None; count];
    for (t, &v) in sources.iter().enumerate() {
        blends[v as usize] = Some(BlendWeights::own(t as u32));
    }
    // Cell by cell, so that each cell's surroundings are gathered once.
    let labelled = labels.iter().enumerate().filter(|&(_, &t)| t != NONE).map(|(v, &t)| (t, v as u32));
    let members = Lists::new(sources.len(), labelled);
    let mut around = Vec::new();
    for t in 0..sources.len() as u32 {
        let cell = members.of(t);
        if cell.len() > 1 {
            dual.around(t, &mut around);
            for &v in cell.iter().filter(|&&v| v != sources[t as usize]) {
                blends[v as usize] = Some(dual.blend(positions[v as usize], t, &around));
            }
        }
    }
    Ok(blends)
}

/// The test points whose cells meet that of each.
pub(crate) fn neighbours(surface: &Surface, test_point_nodes: &[u32]) -> Result<Vec<Vec<u32>>, FitError> {
    let positions = vertex_positions(surface);
    let sources = sources(surface.vertices(), test_point_nodes)?;
    let length = |a: u32, b: u32| positions[a as usize].distance(positions[b as usize]);
    let labels = Geodesic::new(surface, &length).cells(&sources);
    let dual = Dual::new(surface, &labels, sources.iter().map(|&v| positions[v as usize]).collect());
    Ok((0..sources.len() as u32).map(|t| dual.neighbours.of(t).to_vec()).collect())
}

/// The vertex of each test point.
fn sources(vertices: &[u32], test_point_nodes: &[u32]) -> Result<Vec<u32>, FitError> {
    if test_point_nodes.is_empty() {
        return Err(FitError::invalid("test points", "there is none", "give at least one"));
    }
    let vertex = |(t, &n): (usize, &u32)| {
        vertices.get(n as usize).copied().ok_or_else(|| {
            let problem = format!("it sits on node {n}, but there are {}", vertices.len());
            FitError::invalid(format!("test point {t}"), problem, "choose a node of the surface")
        })
    };
    let sources: Vec<u32> = test_point_nodes.iter().enumerate().map(vertex).collect::<Result<_, _>>()?;
    let mut sorted: Vec<(u32, usize)> = sources.iter().enumerate().map(|(t, &v)| (v, t)).collect();
    sorted.sort_unstable();
    match sorted.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        None => Ok(sources),
        Some(pair) => {
            let problem = format!("it sits on the same vertex as test point {}", pair[0].1);
            Err(FitError::invalid(format!("test point {}", pair[1].1), problem, "remove one of the two"))
        }
    }
}

/// The mesh of test points.
struct Dual {
    positions: Vec<DVec3>,
    /// Test points, ascending: triangles, then segments [a, b, b] that no triangle has.
    simplices: Vec<[u32; 3]>,
    /// Middle and radius of a ball around each.
    balls: Vec<(DVec3, f64)>,
    /// Simplices of each test point.
    touching: Lists<u32>,
    /// Test points whose cells meet that of each.
    neighbours: Lists<u32>,
}

impl Dual {
    fn new(surface: &Surface, labels: &[u32], positions: Vec<DVec3>) -> Self {
        let vertices = surface.vertices();
        let mut simplices = Vec::new();
        let mut edges = Vec::new();
        for element in surface.elements() {
            let mut l = element.nodes.map(|n| labels[vertices[n as usize] as usize]);
            l.sort_unstable();
            let [a, b, c] = l;
            if a == c {
                continue;
            }
            edges.extend([(a, b), (b, c), (a, c)].into_iter().filter(|(a, b)| a != b));
            let [p, q, r] = l.map(|t| positions.get(t as usize).copied().unwrap_or_default());
            let longest =
                (q - p).length_squared().max((r - q).length_squared()).max((p - r).length_squared());
            // Test points in a row span no triangle, only segments.
            if a != b && b != c && (q - p).cross(r - p).length() > 1e-9 * longest {
                simplices.push(l);
            }
        }
        simplices.sort_unstable();
        simplices.dedup();
        edges.sort_unstable();
        edges.dedup();
        let mut spanned: Vec<(u32, u32)> =
            simplices.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (a, c)]).collect();
        spanned.sort_unstable();
        let lone = edges.iter().filter(|edge| spanned.binary_search(edge).is_err());
        simplices.extend(lone.map(|&(a, b)| [a, b, b]));

        let corners = simplices.iter().enumerate().flat_map(|(s, &[a, b, c])| {
            [a, b, c].into_iter().take(if b == c { 2 } else { 3 }).map(move |t| (t, s as u32))
        });
        let touching = Lists::new(positions.len(), corners);
        let neighbours = Lists::new(positions.len(), edges.iter().flat_map(|&(a, b)| [(a, b), (b, a)]));
        let balls = simplices.iter().map(|s| {
            let corners = s.map(|t| positions[t as usize]);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            (middle, corners.iter().map(|c| c.distance(middle)).fold(0.0, f64::max))
        });
        let balls = balls.collect();
        Dual { positions, simplices, balls, touching, neighbours }
    }

    /// Gathers the simplices of test point `t` and of its neighbours.
    fn around(&self, t: u32, around: &mut Vec<u32>) {
        around.clear();
        around.extend(self.touching.of(t));
        around.extend(self.neighbours.of(t).iter().flat_map(|&next| self.touching.of(next)));
        around.sort_unstable();
        around.dedup();
    }

    /// The blend at `p`, in the cell of `t`: the nearest point of the simplices around, by area coordinates.
    fn blend(&self, p: DVec3, t: u32, around: &[u32]) -> BlendWeights {
        let mut nearest = (f64::INFINITY, BlendWeights::own(t));
        for &s in around {
            let (middle, radius) = self.balls[s as usize];
            if p.distance(middle) > nearest.0 + radius {
                continue;
            }
            let test_points = self.simplices[s as usize];
            let corners = test_points.map(|t| self.positions[t as usize]);
            let weights = if test_points[1] == test_points[2] {
                let n = on_segment(p, corners[0], corners[1]);
                [1.0 - n, n, 0.0]
            } else {
                on_triangle(p, corners)
            };
            let at = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
            let distance = p.distance(at);
            if distance < nearest.0 {
                nearest = (distance, BlendWeights { test_points, weights });
            }
        }
        let mut blend = nearest.1;
        // Rounding of no meaning would keep a third curve in every look-up.
        blend.weights = blend.weights.map(|w| if w < 1e-12 { 0.0 } else { w });
        let sum: f64 = blend.weights.iter().sum();
        blend.weights = blend.weights.map(|w| w / sum);
        blend
    }
}

/// Position along a segment of the point nearest to `p`, in [0, 1].
fn on_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0)
}

/// Area coordinates of the point of a triangle nearest to `p` (Ericson 2005, 5.1.5).
fn on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let n = on_segment(p, a, b);
        return [1.0 - n, n, 0.0];
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let n = on_segment(p, a, c);
        return [1.0 - n, 0.0, n];
    }
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let n = on_segment(p, b, c);
        return [0.0, 1.0 - n, n];
    }
    // Inside; where rounding contradicts itself the nearest corner is off by no more than that.
    let [va, vb, vc] = [va.max(0.0), vb.max(0.0), vc.max(0.0)];
    let sum = va + vb + vc;
    if sum > 0.0 { [va / sum, vb / sum, vc / sum] } else { [1.0, 0.0, 0.0] }
}
