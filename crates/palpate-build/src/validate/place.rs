//! Where paths are tried: random points that no test point is near, or test points.

use anyhow::{Result, bail};
use glam::DVec3;
use palpate_body::{Body, SurfacePoint};

/// Random numbers (SplitMix64, Steele et al. 2014): each path has a stream of its own.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64, path: usize) -> Self {
        let mut first = Random(seed);
        Random(first.next() ^ (path as u64).wrapping_mul(0xD134_2543_DE82_EF95))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    pub at: SurfacePoint,
    /// m.
    pub point: DVec3,
    /// û there.
    pub inward: DVec3,
}

/// Elements that can be touched, with the sum of areas up to each.
pub struct Ground<'a> {
    body: &'a Body,
    /// The body that is tried, if places are chosen on another.
    tried: Option<&'a Body>,
    elements: Vec<(u32, f64)>,
    area: f64,
    /// Nearer to a test point than this is no held-out point, m.
    apart: f64,
    test_points: Vec<DVec3>,
    /// The test points that can be touched, if paths are to begin there.
    chosen: Option<Vec<SurfacePoint>>,
}

impl<'a> Ground<'a> {
    pub fn new(body: &'a Body, touchable: &[bool], at_test_points: bool) -> Result<Self> {
        if touchable.len() != body.nodes().len() {
            bail!(
                "{} nodes of the body, but {} that the spec gives; is it the body's spec?",
                body.nodes().len(),
                touchable.len()
            );
        }
        let mut area = 0.0;
        let open = body.elements().iter().enumerate();
        let open = open.filter(|(_, e)| e.nodes.iter().all(|&n| touchable[n as usize]));
        let elements: Vec<(u32, f64)> = open
            .map(|(e, _)| {
                let [a, b, c] = body.corners(e as u32);
                area += (b - a).cross(c - a).length() / 2.0;
                (e as u32, area)
            })
            .collect();
        if elements.is_empty() {
            bail!("no part of the surface can be touched; leave a part of it free of supports");
        }
        let nodes = simulated(body);
        let chosen = at_test_points.then(|| corners_at(body, &nodes, touchable));
        if chosen.as_ref().is_some_and(Vec::is_empty) {
            bail!("no test point can be touched; leave out --at-test-points");
        }
        let test_points: Vec<DVec3> =
            nodes.iter().filter_map(|&n| Some(body.nodes().get(n as usize)?.position)).collect();
        let apart = 0.15 * (area / test_points.len() as f64).sqrt();
        Ok(Ground { body, tried: None, elements, area, apart, test_points, chosen })
    }

    /// The same places for another body of the same surface.
    pub fn of(self, tried: &'a Body) -> Self {
        let tried = Some(tried).filter(|tried| !std::ptr::eq(*tried, self.body));
        Ground { tried, ..self }
    }

    /// Uniform over the area, or over the test points.
    pub fn place(&self, random: &mut Random) -> Place {
        /// A few tries do: less than a tenth of the surface is near a test point.
        const TRIES: usize = 100;
        if let Some(chosen) = &self.chosen {
            let i = (random.unit() * chosen.len() as f64) as usize;
            return self.at(chosen[i.min(chosen.len() - 1)]);
        }
        let mut draw = || {
            let share = random.unit() * self.area;
            let i = self.elements.partition_point(|e| e.1 <= share).min(self.elements.len() - 1);
            let (r, s) = (random.unit().sqrt(), random.unit());
            self.at(SurfacePoint { element: self.elements[i].0, n: [1.0 - r, r * (1.0 - s), r * s] })
        };
        let mut place = draw();
        for _ in 1..TRIES {
            if self.test_points.iter().all(|t| t.distance(place.point) >= self.apart) {
                break;
            }
            place = draw();
        }
        place
    }

    fn at(&self, at: SurfacePoint) -> Place {
        let nodes = self.body.element_nodes(at.element);
        let u: DVec3 = (0..3).map(|j| nodes[j].inward * at.n[j]).sum();
        let point = self.body.point(at);
        let there = self.tried.and_then(|tried| tried.nearest(point, f64::INFINITY));
        Place { at: there.map_or(at, |found| found.at), point, inward: u.normalize() }
    }
}

/// The nodes of test points that were simulated: other nodes may have potentials that were made from theirs.
fn simulated(body: &Body) -> Vec<u32> {
    match body.provenance().potential_errors.as_slice() {
        [] => body.test_point_nodes().to_vec(),
        points => points.iter().map(|p| p.node).collect(),
    }
}

/// Those of `nodes` that are touchable, as corners of elements.
fn corners_at(body: &Body, nodes: &[u32], touchable: &[bool]) -> Vec<SurfacePoint> {
    let mut corner = vec![None; body.nodes().len()];
    for (e, element) in body.elements().iter().enumerate() {
        for (i, &n) in element.nodes.iter().enumerate() {
            let mut at = [0.0; 3];
            at[i] = 1.0;
            corner[n as usize].get_or_insert(SurfacePoint { element: e as u32, n: at });
        }
    }
    let at = |&n: &u32| corner.get(n as usize).copied().flatten().filter(|_| touchable[n as usize]);
    nodes.iter().filter_map(at).collect()
}

/// Where a tool's reference point is when it first touches, coming along û through the point, m: there
/// offsets begin.
pub fn first_touch(body: &Body, place: &Place) -> DVec3 {
    let radius = body.tool().radius_m();
    let on = |gap: f64| place.point - place.inward * (radius + gap);
    // From outside, but not from beyond another part of the body; and a little past the point itself.
    let (from, to) = (on(radius.max(1e-3)), on(-1e-6));
    match body.first_touch(from, to, radius) {
        Some(touch) if touch.fraction > 0.0 => from.lerp(to, touch.fraction),
        _ => on(0.0),
    }
}
