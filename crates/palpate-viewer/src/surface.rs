//! The body's surface as it is drawn: elements cut finely enough that a dimple can be seen on them.

use glam::{DVec3, Vec3};
use palpate::Body;
use std::collections::HashMap;

/// A body of fewer triangles is cut up to about so many for drawing.
const TRIANGLES: usize = 40_000;
/// An element's edge is cut into no more than so many.
const CUTS_MAX: usize = 12;

/// Vertices and triangles of a body's surface at rest. Cutting changes no shape: elements stay as flat as the engine touches them.
#[derive(Debug, Clone)]
pub struct DrawnSurface {
    /// At rest, m from [`DrawnSurface::origin`].
    pub positions: Vec<Vec3>,
    /// Unit vectors out of the body: blends of the nodes' normals, as contacts see them.
    pub normals: Vec<Vec3>,
    /// The element that each vertex lies on.
    pub elements: Vec<u32>,
    /// Its area coordinates there.
    pub area_coordinates: Vec<[f32; 3]>,
    /// Three vertices a triangle, anticlockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Pairs of vertices along the elements' edges.
    pub edges: Vec<[u32; 2]>,
    /// Vertices at the same place with the same normal have the same number here.
    pub shared: Vec<u32>,
    /// How many different numbers there are in [`DrawnSurface::shared`].
    pub shared_count: usize,
    /// Middle of the body, m: drawing is in single precision, and bodies may lie far from their frame's origin.
    pub origin: DVec3,
    /// How far from there the farthest vertex is, m.
    pub radius: f64,
    /// Whether each element has vertices of its own, as colours by element need it.
    pub is_split: bool,
}

/// What tells vertices of one element from those that its neighbours have too.
#[derive(PartialEq, Eq, Hash)]
enum Key {
    Corner(u32),
    Edge(u32, u32, u16),
}

impl DrawnSurface {
    /// Of a body; `split` gives each element vertices of its own.
    pub fn new(body: &Body, split: bool) -> Self {
        let extent = palpate::body::BodySource::extent(body);
        let origin = extent.middle;
        let count = body.elements().len();
        let cuts = ((TRIANGLES as f64 / count.max(1) as f64).sqrt() as usize).clamp(1, CUTS_MAX);
        let mut drawn = DrawnSurface {
            positions: Vec::new(),
            normals: Vec::new(),
            elements: Vec::new(),
            area_coordinates: Vec::new(),
            triangles: Vec::with_capacity(count * cuts * cuts),
            edges: Vec::new(),
            shared: Vec::new(),
            shared_count: 0,
            origin,
            radius: extent.radius_m,
            is_split: split,
        };
        let mut known: HashMap<Key, u32> = HashMap::new();
        let mut local = vec![0u32; (cuts + 1) * (cuts + 1)];
        for element in 0..count as u32 {
            let numbers = body.element_node_numbers(element);
            let nodes = body.element_nodes(element);
            for i in 0..=cuts {
                for j in 0..=cuts - i {
                    let parts = [cuts - i - j, i, j];
                    let n = parts.map(|p| p as f64 / cuts as f64);
                    let key = key(numbers, parts);
                    let found = key.as_ref().and_then(|k| known.get(k).copied());
                    let vertex = match found {
                        Some(v) if !split => v,
                        _ => {
                            let p = (0..3).map(|c| nodes[c].position * n[c]).sum::<DVec3>() - origin;
                            let u = (0..3).map(|c| nodes[c].inward * n[c]).sum::<DVec3>();
                            let v = drawn.positions.len() as u32;
                            drawn.positions.push(p.as_vec3());
                            drawn.normals.push(-u.normalize_or_zero().as_vec3());
                            drawn.elements.push(element);
                            drawn.area_coordinates.push(n.map(|x| x as f32));
                            let shared =
                                found.map_or(drawn.shared_count as u32, |v| drawn.shared[v as usize]);
                            drawn.shared_count += usize::from(found.is_none());
                            drawn.shared.push(shared);
                            if let Some(key) = key {
                                known.entry(key).or_insert(v);
                            }
                            v
                        }
                    };
                    local[i * (cuts + 1) + j] = vertex;
                }
            }
            let at = |i: usize, j: usize| local[i * (cuts + 1) + j];
            for i in 0..cuts {
                for j in 0..cuts - i {
                    drawn.triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                    if j + 1 < cuts - i {
                        drawn.triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                    }
                }
            }
            // Each edge once: by the element that has the smaller number, or that has no neighbour there.
            for edge in 0..3 {
                if body.across(element, edge).is_none_or(|(other, _)| element < other) {
                    drawn.edges.extend((0..cuts).map(|s| {
                        [s, s + 1].map(|s| match edge {
                            0 => at(s, 0),
                            1 => at(cuts - s, s),
                            _ => at(0, cuts - s),
                        })
                    }));
                }
            }
        }
        drawn
    }

    /// A value for each vertex from one for each node, blended as responses are.
    pub fn blend(&self, body: &Body, of_nodes: &[f64]) -> Vec<f64> {
        let value = |v: usize| {
            let numbers = body.element_node_numbers(self.elements[v]);
            let n = self.area_coordinates[v];
            (0..3)
                .map(|c| f64::from(n[c]) * of_nodes.get(numbers[c] as usize).copied().unwrap_or(f64::NAN))
                .sum()
        };
        (0..self.positions.len()).map(value).collect()
    }
}

/// `None` for a vertex inside of its element.
fn key(nodes: [u32; 3], parts: [usize; 3]) -> Option<Key> {
    let zeros = parts.iter().filter(|p| **p == 0).count();
    if zeros == 2 {
        return (0..3).find(|&c| parts[c] > 0).map(|c| Key::Corner(nodes[c]));
    }
    let opposite = parts.iter().position(|p| *p == 0)?;
    let (a, b) = ((opposite + 1) % 3, (opposite + 2) % 3);
    let ((a, from_a), (b, _)) = ((nodes[a], parts[a]), (nodes[b], parts[b]));
    // Counted from the node with the smaller number, so that both elements count alike.
    let whole = parts.iter().sum::<usize>();
    let (low, high, part) = if a < b { (a, b, from_a) } else { (b, a, whole - from_a) };
    Some(Key::Edge(low, high, part as u16))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate::body::Response;
    use palpate::body::shape::{Resolution, Shape};

    fn ball() -> Body {
        let shape = Shape::Sphere { radius_mm: 30.0 };
        let surface = shape.surface(Resolution { edge_length_mm: Some(12.0), ..Default::default() }).unwrap();
        Body::uniform(surface, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()).unwrap()
    }

    /// Closed, with as many vertices as Euler's formula wants: V − E + F = 2.
    #[test]
    fn cuts_leave_no_gap() {
        let body = ball();
        let drawn = DrawnSurface::new(&body, false);
        let (v, f) = (drawn.positions.len(), drawn.triangles.len());
        assert!(f > 4 * body.elements().len());
        assert_eq!(v + f - f * 3 / 2, 2);
        assert_eq!((drawn.shared_count, drawn.shared.len()), (v, v));
        let split = DrawnSurface::new(&body, true);
        assert_eq!((split.triangles.len(), split.shared_count), (f, v));
        assert!(split.positions.len() > v);
        // All look outwards, and none is turned over.
        for [a, b, c] in drawn.triangles.iter().map(|t| t.map(|v| drawn.positions[v as usize])) {
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0);
        }
        assert_eq!(drawn.edges.len() % (body.elements().len() * 3 / 2), 0);
    }

    #[test]
    fn values_are_blended_as_responses_are() {
        let body = ball();
        let drawn = DrawnSurface::new(&body, false);
        let heights: Vec<f64> = body.nodes().iter().map(|n| n.position.z).collect();
        for (value, p) in drawn.blend(&body, &heights).iter().zip(&drawn.positions) {
            assert!((value - (f64::from(p.z) + drawn.origin.z)).abs() < 1e-8);
        }
    }
}
