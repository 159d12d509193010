//! Elements divided until they are fine enough, without gaps.
//!
//! Whether an edge is halved depends on that edge alone, so that the triangles on both of its sides agree, and every triangle
//! is divided by itself: by one, two or three of its edges, and its parts again. Nodes lie at multiples of 2⁻²⁰ in the area
//! coordinates of their coarse element, exactly.

use super::smooth::{Edge, SmoothSurface};
use super::{Fineness, MAX_TRIANGLES};
use crate::body::Body;
use crate::error::{BodyError, Result};
use crate::search::SurfacePoint;
use crate::surface::{Element, NO_TWIN, Surface, twins};
use glam::DVec3;
use std::collections::HashMap;

/// An edge is halved this often at most.
const LEVELS: u32 = 20;
/// Of which area coordinates are multiples.
const WHOLE: u32 = 1 << LEVELS;

/// Area coordinates in parts of [`WHOLE`].
type Place = [u32; 3];

/// Corners of an element.
const CORNERS: [Place; 3] = [[WHOLE, 0, 0], [0, WHOLE, 0], [0, 0, WHOLE]];

/// Marks the number of a node that shares its vertex with an earlier one, until the number of vertices is known.
const SECOND: u32 = 1 << 31;

/// The finer surface of a body.
pub(super) struct Division<N> {
    pub surface: Surface,
    /// Of each of its nodes the place on the coarse surface.
    pub origins: Vec<SurfacePoint>,
    /// The fine number of a coarse node.
    pub node_of: N,
}

impl Division<()> {
    /// Divides the elements of `body`.
    ///
    /// # Errors
    /// Too many triangles, or vertices that are numbered otherwise than [`Surface::build`] does.
    pub fn new(
        body: &Body,
        smooth: &SmoothSurface,
        fineness: Fineness,
    ) -> Result<Division<impl Fn(u32) -> u32 + use<>>> {
        let vertices = body.vertex_count();
        if !body.vertices.iter().take(vertices).enumerate().all(|(n, &v)| v as usize == n) {
            let problem = "they do not begin with one node for each vertex";
            return Err(BodyError::invalid("nodes", problem, "make the body again"));
        }
        let mut divider = Divider::new(body, smooth, fineness, vertices)?;
        for element in 0..body.elements.len() as u32 {
            divider.interior.clear();
            divider.divide(element, CORNERS)?;
        }
        let Divider { triangles, firsts, seconds, .. } = divider;
        let count = firsts.len() as u32;
        let number = move |n: u32| if n & SECOND == 0 { n } else { count + (n & !SECOND) };

        let positions = firsts.iter().map(|first| first.position);
        let positions: Vec<DVec3> = positions.collect();
        let second_positions: Vec<DVec3> = seconds.iter().map(|s| positions[s.vertex as usize]).collect();
        let numbers: Vec<u32> = (0..count).chain(seconds.iter().map(|s| s.vertex)).collect();
        let nodes: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(number)).collect();
        let by_vertex: Vec<[u32; 3]> = nodes.iter().map(|t| t.map(|n| numbers[n as usize])).collect();
        let elements = nodes.into_iter().zip(twins(&by_vertex)?);
        let elements = elements.map(|(nodes, twins)| Element { nodes, twins }).collect();
        let origins: Vec<SurfacePoint> =
            firsts.iter().map(|f| f.at).chain(seconds.iter().map(|s| s.at)).collect();
        let inward = origins.iter().map(|at| body.inward_at(at)).collect();
        let positions = positions.into_iter().chain(second_positions).collect();
        let surface = Surface { positions, inward, elements, vertices: numbers, smoothed: 0 };
        let node_of = move |n: u32| number(coarse_number(n, vertices));
        Ok(Division { surface, origins, node_of })
    }
}

/// The first node of a vertex.
struct First {
    at: SurfacePoint,
    /// m.
    position: DVec3,
}

/// A further node of one.
struct Second {
    at: SurfacePoint,
    vertex: u32,
}

/// A coarse edge's nodes.
struct Halving {
    /// How often it is halved.
    levels: u32,
    /// The first of its inner nodes, which follow each other along its half-edge.
    first: u32,
    /// The same on the other side.
    other: u32,
}

struct Divider<'a> {
    body: &'a Body,
    smooth: &'a SmoothSurface,
    fineness: Fineness,
    /// Of the coarse body.
    vertices: usize,
    /// (edges)
    halvings: Vec<Halving>,
    triangles: Vec<[u32; 3]>,
    firsts: Vec<First>,
    seconds: Vec<Second>,
    /// Nodes within the element that is being divided.
    interior: HashMap<Place, u32>,
}

impl<'a> Divider<'a> {
    /// With the nodes that are there, and those on edges.
    fn new(body: &'a Body, smooth: &'a SmoothSurface, fineness: Fineness, vertices: usize) -> Result<Self> {
        let mut corners = vec![SurfacePoint { element: 0, n: [0.0; 3] }; body.nodes.len()];
        for (e, element) in body.elements.iter().enumerate() {
            for (i, &n) in element.nodes.iter().enumerate() {
                let mut at = SurfacePoint { element: e as u32, n: [0.0; 3] };
                at.n[i] = 1.0;
                corners[n as usize] = at;
            }
        }
        let nodes = corners.into_iter().zip(&body.nodes).enumerate();
        let (mut firsts, mut seconds) = (Vec::new(), Vec::new());
        for (n, (at, node)) in nodes {
            if n < vertices {
                firsts.push(First { at, position: node.position });
            } else {
                seconds.push(Second { at, vertex: body.vertices[n] });
            }
        }
        let halvings = Vec::with_capacity(smooth.edges.len());
        let mut divider = Divider {
            body,
            smooth,
            fineness,
            vertices,
            halvings,
            triangles: Vec::new(),
            firsts,
            seconds,
            interior: HashMap::new(),
        };
        let levels = smooth.edges.iter().map(|edge| divider.levels(edge)).collect::<Result<Vec<_>>>()?;
        let mut count = 0;
        for edges in &smooth.edge_of {
            count += divider.least_count(edges.map(|e| levels[e as usize]));
            divider.check_count(count)?;
        }
        for (edge, levels) in smooth.edges.iter().zip(levels) {
            divider.add_edge(edge, levels);
        }
        Ok(divider)
    }

    /// How many triangles an element becomes at least: as long as all three edges are halved, four of each; and then no fewer
    /// than there are nodes on the border of each.
    fn least_count(&self, levels: [u32; 3]) -> usize {
        // Inner edges may be short enough a level earlier.
        let sure = levels.map(|l| l.saturating_sub(u32::from(self.fineness.edge_m.is_finite())));
        let all = sure.into_iter().min().unwrap_or(0);
        let rest: usize = sure.into_iter().map(|l| (1 << (l - all)) - 1).sum();
        (1 + rest) << (2 * all)
    }

    fn check_count(&self, triangles: usize) -> Result<()> {
        if triangles <= MAX_TRIANGLES {
            return Ok(());
        }
        let Fineness { sagitta_m, edge_m } = self.fineness;
        let (place, problem) = if sagitta_m.is_finite() {
            ("sagitta", format!("{} µm needs more than {MAX_TRIANGLES} triangles", decimal(sagitta_m * 1e6)))
        } else {
            ("edge length", format!("{} mm needs more than {MAX_TRIANGLES} triangles", decimal(edge_m * 1e3)))
        };
        Err(BodyError::invalid(place, problem, "give a larger one"))
    }

    /// How often an edge is halved.
    fn levels(&self, edge: &Edge) -> Result<u32> {
        let [a, b] = self.ends(edge).map(|n| self.body.nodes[n as usize].position);
        // |dp/ds| is nowhere more than this along the edge, m.
        let length = a.distance(b) + edge.bend.length();
        let mut bend = edge.bend;
        for level in 0..=LEVELS {
            let part = 1.0 / f64::from(1u32 << level);
            if !self.bulges(bend) && length * part <= self.fineness.edge_m {
                return Ok(level);
            }
            bend *= 0.25;
        }
        self.check_count(usize::MAX)?;
        Ok(LEVELS)
    }

    fn ends(&self, edge: &Edge) -> [u32; 2] {
        let (element, i) = (edge.half / 3, edge.half as usize % 3);
        let nodes = self.body.elements[element as usize].nodes;
        [nodes[i], nodes[(i + 1) % 3]]
    }

    /// Whether facets whose edges bulge like this can be too far off: Σ n_i n_j d_ij is no more than a third of the largest d.
    fn bulges(&self, bend: DVec3) -> bool {
        bend.length() > 3.0 * self.fineness.sagitta_m
    }

    /// The inner nodes of an edge, on both of its sides.
    fn add_edge(&mut self, edge: &Edge, levels: u32) {
        let (element, i) = (edge.half / 3, edge.half as usize % 3);
        let twin = self.body.elements[element as usize].twins[i];
        let first = self.firsts.len() as u32;
        let other = if edge.creased { SECOND | self.seconds.len() as u32 } else { first };
        let parts = 1u32 << levels;
        for part in 1..parts {
            let s = f64::from(part) / f64::from(parts);
            let on = |half: u32, s: f64| {
                let mut at = SurfacePoint { element: half / 3, n: [0.0; 3] };
                at.n[half as usize % 3] = 1.0 - s;
                at.n[(half as usize + 1) % 3] = s;
                at
            };
            let at = on(edge.half, s);
            let vertex = self.firsts.len() as u32;
            self.firsts.push(First { at, position: self.smooth.point(self.body, element, at.n) });
            if edge.creased && twin != NO_TWIN {
                self.seconds.push(Second { at: on(twin, 1.0 - s), vertex });
            }
        }
        self.halvings.push(Halving { levels, first, other });
    }

    /// Divides a triangle of `element` as far as need be.
    fn divide(&mut self, element: u32, t: [Place; 3]) -> Result<()> {
        let split = [0, 1, 2].map(|i| self.splits(element, t[i], t[(i + 1) % 3]));
        let middle = |i: usize| middle(t[i % 3], t[(i + 1) % 3]);
        let parts: &[[Place; 3]] = match split {
            [false, false, false] => {
                let nodes = t.map(|place| self.node(element, place));
                self.triangles.push(nodes);
                return self.check_count(self.triangles.len());
            }
            [true, true, true] => {
                let [ab, bc, ca] = [0, 1, 2].map(middle);
                &[[t[0], ab, ca], [ab, t[1], bc], [ca, bc, t[2]], [ab, bc, ca]]
            }
            _ if split.iter().filter(|&&s| s).count() == 1 => {
                let i = split.iter().position(|&s| s).unwrap_or(0);
                let [a, b, c] = [t[i], t[(i + 1) % 3], t[(i + 2) % 3]];
                &[[a, middle(i), c], [middle(i), b, c]]
            }
            _ => {
                // The two that are halved meet in a.
                let i = (split.iter().position(|&s| !s).unwrap_or(0) + 2) % 3;
                let [a, b, c] = [t[i], t[(i + 1) % 3], t[(i + 2) % 3]];
                let (ab, ca) = (middle(i), middle(i + 2));
                self.divide(element, [a, ab, ca])?;
                return self.divide_strip(element, [ab, b, c, ca]);
            }
        };
        parts.iter().try_for_each(|part| self.divide(element, *part))
    }

    /// Divides a quadrilateral. Where only its first and third side are halved, it stays a strip until both are done: a tube is
    /// divided around, not along.
    fn divide_strip(&mut self, element: u32, t: [Place; 4]) -> Result<()> {
        let [p, q, r, s] = t;
        let splits = [0, 1, 2, 3].map(|i| self.splits(element, t[i], t[(i + 1) % 4]));
        if splits == [true, false, true, false] {
            let [pq, rs] = [middle(p, q), middle(r, s)];
            self.divide_strip(element, [p, pq, rs, s])?;
            return self.divide_strip(element, [pq, q, r, rs]);
        }
        // Of the diagonals the one that bulges less.
        let measure = |p: Place, q: Place| {
            let length = self.point(element, p).distance(self.point(element, q));
            (self.bend(element, p, q).length(), length)
        };
        let halves =
            if measure(p, r) <= measure(q, s) { [[p, q, r], [p, r, s]] } else { [[p, q, s], [q, r, s]] };
        halves.into_iter().try_for_each(|half| self.divide(element, half))
    }

    /// Whether the edge from p to q is halved.
    fn splits(&self, element: u32, p: Place, q: Place) -> bool {
        let on_edge = (0..3).find(|&i| p[(i + 2) % 3] == 0 && q[(i + 2) % 3] == 0);
        match on_edge {
            Some(i) => {
                let edge = self.smooth.edge_of[element as usize][i];
                p[i].abs_diff(q[i]) > WHOLE >> self.halvings[edge as usize].levels
            }
            None if (0..3).any(|i| p[i].abs_diff(q[i]) % 2 == 1) => false,
            None => {
                let long = || self.point(element, p).distance(self.point(element, q)) > self.fineness.edge_m;
                self.bulges(self.bend(element, p, q)) || long()
            }
        }
    }

    /// d of the line from p to q.
    fn bend(&self, element: u32, p: Place, q: Place) -> DVec3 {
        let [a, b, c] = [0, 1, 2].map(|i| (f64::from(q[i]) - f64::from(p[i])) / f64::from(WHOLE));
        let [ab, bc, ca] = self.smooth.bends(element);
        ab * (a * b) + bc * (b * c) + ca * (c * a)
    }

    fn point(&self, element: u32, place: Place) -> DVec3 {
        self.smooth.point(self.body, element, coordinates(place))
    }

    /// The node there.
    fn node(&mut self, element: u32, place: Place) -> u32 {
        let nodes = self.body.elements[element as usize].nodes;
        if let Some(corner) = place.iter().position(|&n| n == WHOLE) {
            return coarse_number(nodes[corner], self.vertices);
        }
        let Some(i) = (0..3).find(|&i| place[(i + 2) % 3] == 0) else {
            let position = self.point(element, place);
            return *self.interior.entry(place).or_insert_with(|| {
                self.firsts.push(First { at: SurfacePoint { element, n: coordinates(place) }, position });
                self.firsts.len() as u32 - 1
            });
        };
        let edge = self.smooth.edge_of[element as usize][i] as usize;
        let Halving { levels, first, other } = self.halvings[edge];
        let part = |along: u32| (along >> (LEVELS - levels)) - 1;
        if self.smooth.edges[edge].half == 3 * element + i as u32 {
            first + part(place[(i + 1) % 3])
        } else {
            other + part(place[i])
        }
    }
}

/// The fine number of a coarse node, [`SECOND`] not resolved.
fn coarse_number(node: u32, vertices: usize) -> u32 {
    if (node as usize) < vertices { node } else { SECOND | (node - vertices as u32) }
}

fn middle(p: Place, q: Place) -> Place {
    [0, 1, 2].map(|i| p[i].midpoint(q[i]))
}

fn coordinates(place: Place) -> [f64; 3] {
    place.map(|n| f64::from(n) / f64::from(WHOLE))
}

/// Without what rounding left behind it.
fn decimal(x: f64) -> f64 {
    format!("{x:.6e}").parse().unwrap_or(x)
}
