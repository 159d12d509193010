//! The part of the surface that is touched, and the test points on it.

use super::assemble;
use super::supports::{extent, nearest};
use crate::spec::{COUNT, Simulation, Spec, TestPoints};
use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::{Surface, SurfacePoint, TriangleMesh};
use palpate_identify::{Amount, test_points, touchable};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// In parts of the tool's radius: test points nearer to each other than that are told the same.
const NEEDLESS: f64 = 0.3;

/// The surface that is touched, as it is divided for test points.
pub struct TouchedSurface {
    /// As they are simulated.
    pub triangles: TriangleMesh,
    /// With frames.
    pub surface: Surface,
    /// For each node whether a support holds it.
    pub held: Vec<bool>,
    /// For each node whether the tool can come there.
    pub open: Vec<bool>,
}

impl TouchedSurface {
    /// # Errors
    /// The spec's box holds nothing that can be touched; as [`can_be_touched`].
    pub fn new(
        simulation: &Simulation,
        triangles: TriangleMesh,
        surface: Surface,
        held: Vec<bool>,
        path: &Path,
    ) -> Result<Self> {
        let open = can_be_touched(simulation, &surface, &held)?;
        if simulation.touched.is_some() && !open.contains(&true) {
            let (low, high) = extent(surface.positions().iter());
            bail!(
                "{}: [test_points] box_mm holds no node that can be touched; the surface reaches from {low} to {high} mm, and \
                 near a support it is not touched: move or enlarge the box",
                path.display()
            );
        }
        Ok(TouchedSurface { triangles, surface, held, open })
    }

    /// How many can be touched.
    pub fn vertices(&self) -> usize {
        one_for_each_vertex(&self.surface, &self.open).len()
    }

    /// Divided as often as it takes to have `count` vertices that can be touched, but not to edges of less than 0.3 of the tool's
    /// radius: test points nearer to each other than that are told the same.
    ///
    /// # Errors
    /// A surface that can't be, or whatever `hold` refuses, which marks the nodes that a support holds.
    pub fn with_vertices(
        mut self,
        count: usize,
        radius_m: f64,
        spec: &Spec,
        simulation: &Simulation,
        path: &Path,
        hold: impl Fn(&Surface, &mut [bool]) -> Result<()>,
    ) -> Result<Self> {
        while self.vertices() < count && self.edge_m() > NEEDLESS * radius_m {
            self = self.divided(spec, simulation, path, &hold)?;
        }
        Ok(self)
    }

    /// The mean edge of triangles that can be touched, m; 0 if there are none.
    fn edge_m(&self) -> f64 {
        let open = self.triangles.triangles.iter().filter(|t| t.iter().all(|&n| self.open[n as usize]));
        let at = |n: u32| self.triangles.positions[n as usize];
        let lengths =
            open.map(|&[a, b, c]| at(a).distance(at(b)) + at(b).distance(at(c)) + at(c).distance(at(a)));
        let (sum, count) = lengths.fold((0.0, 0.0f64), |(sum, count), length| (sum + length, count + 3.0));
        sum / count.max(1.0)
    }

    /// Each triangle as four, with nodes in the middles of edges on the smooth surface after the others. Those are held that lie between two
    /// that are, or where a support is.
    fn divided(
        self,
        spec: &Spec,
        simulation: &Simulation,
        path: &Path,
        hold: impl Fn(&Surface, &mut [bool]) -> Result<()>,
    ) -> Result<Self> {
        let TouchedSurface {
            triangles: TriangleMesh { mut positions, triangles }, surface, mut held, ..
        } = self;
        // A vertex's first node has its number.
        held.truncate(positions.len());
        let (mut middles, mut at) = (HashMap::new(), Vec::new());
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for (element, [a, b, c]) in (0..).zip(triangles) {
            let edges = [([b, c], [0.0, 0.5, 0.5]), ([c, a], [0.5, 0.0, 0.5]), ([a, b], [0.5, 0.5, 0.0])];
            let [bc, ca, ab] = edges.map(|([p, q], n)| {
                *middles.entry([p.min(q), p.max(q)]).or_insert_with(|| {
                    at.push(SurfacePoint { element, n });
                    held.push(held[p as usize] && held[q as usize]);
                    held.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        positions.extend(surface.smooth_points(&at));
        let triangles = TriangleMesh { positions, triangles: finer };
        let surface = assemble::surface(spec, &triangles).map_err(|e| e.in_file(path))?;
        let mut held: Vec<bool> = surface.vertices().iter().map(|&v| held[v as usize]).collect();
        hold(&surface, &mut held)?;
        let open = can_be_touched(simulation, &surface, &held)?;
        Ok(TouchedSurface { triangles, surface, held, open })
    }
}

/// For each node of a surface whether the tool can come there: it is in the part that the spec says is touched, and what is `held` farther
/// away, along the surface, than the tool's radius and the longest drag, so that the tool comes over nothing that can't give way.
///
/// # Errors
/// The tool's size is not known; as [`touchable`].
pub fn can_be_touched(simulation: &Simulation, surface: &Surface, held: &[bool]) -> Result<Vec<bool>> {
    /// m: of a flat side, within a box that ends on it.
    const ROUNDING: f64 = 1e-6;
    let margin_m = super::volume::tool_radius(simulation)? + simulation.deflection.lateral_max_m;
    let mut open = touchable(surface, held, margin_m)?;
    if let Some(touched) = &simulation.touched {
        for (open, p) in open.iter_mut().zip(surface.positions()) {
            *open &= touched.contains(*p, ROUNDING);
        }
    }
    Ok(open)
}

/// The first node of each vertex that can be touched.
pub fn one_for_each_vertex(surface: &Surface, touchable: &[bool]) -> Vec<u32> {
    let mut free: BTreeMap<u32, u32> = BTreeMap::new();
    for (n, (&v, _)) in surface.vertices().iter().zip(touchable).enumerate().filter(|(_, (_, open))| **open) {
        free.entry(v).or_insert(n as u32);
    }
    let mut nodes: Vec<u32> = free.into_values().collect();
    nodes.sort_unstable();
    nodes
}

/// How many test points three quarters of an hour on two cores are about enough for, and how many of these are dragged, if a press takes so long (s):
/// a third of the time goes to drags, at `most` of them. Not fewer points than a decoupled law has.
pub fn affordable(press_s: f64, most: usize) -> [usize; 2] {
    const CORE_S: f64 = 5400.0;
    /// What the drags from a pressed point take, in presses.
    const DRAGS: f64 = 9.0;
    /// Terms of third and fourth order want to be known at a few.
    const LEAST: f64 = 8.0;
    let presses = CORE_S / press_s;
    // A float beyond all integers becomes the largest one.
    let dragged = most.min((presses / (3.0 * DRAGS)).max(LEAST) as usize);
    [(presses - DRAGS * dragged as f64).clamp(f64::from(COUNT), 1e6) as usize, dragged]
}

/// The test points' nodes, ascending; or in the spec's order, where it names them.
pub fn choose(
    points: &TestPoints,
    surface: &Surface,
    held: &[bool],
    touchable: &[bool],
    compliance_prior: &[f64],
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<u32>> {
    let free = one_for_each_vertex(surface, touchable);
    let amount = match points {
        TestPoints::Count(_) | TestPoints::Adaptive { .. } => {
            let count = match *points {
                TestPoints::Adaptive { most, .. } => assemble::first_round(most),
                TestPoints::Count(count) => count as usize,
                _ => 0,
            };
            if free.len() < count && !free.is_empty() {
                notes.push(format!("the surface has {} vertices to touch: each is a test point", free.len()));
            }
            Amount::Count(count.min(free.len().max(1)))
        }
        // What is affordable is a count by now.
        TestPoints::EveryNode | TestPoints::Affordable => Amount::Count(free.len().max(1)),
        TestPoints::Spacing(spacing) => Amount::Spacing(*spacing),
        TestPoints::At(points) => return named_points(points, surface, held, path, notes),
    };
    if amount == Amount::Count(free.len()) {
        return Ok(free);
    }
    test_points(surface, touchable, amount, Some(compliance_prior))
        .map_err(|e| anyhow!("{}: [test_points]: {e}", path.display()))
}

fn named_points(
    points: &[DVec3],
    surface: &Surface,
    held: &[bool],
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<u32>> {
    let (low, high) = surface
        .positions()
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
    let file = path.display();
    let mut nodes: Vec<u32> = Vec::new();
    let mut farthest: f64 = 0.0;
    for (i, p) in points.iter().enumerate() {
        let q = *p * 1e3;
        let place =
            format!("{file}: [test_points] at_mm, point {i} at ({:.2}, {:.2}, {:.2}) mm", q.x, q.y, q.z);
        let Some(node) = nearest(*p, surface.positions().iter().copied(), (high - low).length() / 10.0)
        else {
            let (low, high) = extent(surface.positions().iter());
            bail!(
                "{place}: it is far from the surface, which reaches from {low} to {high} mm; move it there"
            );
        };
        if let Some(other) = nodes.iter().position(|n| *n == node) {
            bail!("{place}: the surface's nearest node is that of point {other}; remove one of them");
        }
        if held[node as usize] {
            bail!("{place}: the surface is fixed there; move it, or the support");
        }
        farthest = farthest.max(surface.positions()[node as usize].distance(*p));
        nodes.push(node);
    }
    if farthest > 1e-6 {
        notes.push(format!(
            "test points were moved to the surface's nearest nodes, by up to {:.3} mm",
            farthest * 1e3
        ));
    }
    Ok(nodes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::precompute::prepare::prepare;
    use crate::spec::Geometry;
    use std::sync::atomic::AtomicBool;

    fn spec(text: &str) -> (Spec, Simulation) {
        let path = Path::new("ball.toml");
        let spec = Spec::parse(path, text.into()).unwrap();
        let simulation = spec.simulation(path).unwrap();
        (spec, simulation)
    }

    const BALL: &str = "body.shape = { kind = \"sphere\", radius_mm = 30, edge_length_mm = 16 }\n\
         [[body.fixed]]\nhalf_space = { point_mm = [0, 0, -15], normal = [0, 0, -1] }\n\
         [material]\nmodel = \"neo-hookean\"\nyoung_modulus_pa = 10e3\npoisson_ratio = 0.45\n\
         [tool]\nshape = \"sphere\"\nradius_mm = 6\n\
         [deflection]\nnormal_max_mm = 3\nlateral_max_mm = 2\nsteps = 3\n\
         [mesh]\nelement_size_mm = 12\n[test_points]\n";

    fn prepared(
        test_points: &str,
    ) -> Result<crate::precompute::Prepared<crate::precompute::elements::Elements>> {
        let (spec, simulation) = spec(&format!("{BALL}{test_points}\n"));
        prepare(&spec, &simulation, Path::new("ball.toml"), &AtomicBool::new(false))
    }

    /// Whichever way they are asked for, and between the nodes, too.
    #[test]
    fn test_points_lie_in_the_box_that_is_touched() {
        let on_top = "box_mm = [[-30, -30, 10], [30, 30, 31]]";
        for (how, least) in
            [("count = 5", 5), ("count = 60", 60), ("every_node = true", 5), ("spacing_mm = 8", 4)]
        {
            let prepared = prepared(&format!("{on_top}\n{how}")).unwrap();
            assert!(prepared.points.len() >= least, "{how}: {}", prepared.points.len());
            for point in &prepared.points {
                assert!(point.plan.point.z > 10e-3 - 1e-6, "{how}: {}", point.plan.point);
            }
        }
        let beside = prepared("box_mm = [[40, 40, 40], [50, 50, 50]]").err().unwrap().to_string();
        assert!(beside.contains("ball.toml: [test_points] box_mm") && beside.contains("30.00"), "{beside}");
        // There, but by the support.
        let below =
            prepared("box_mm = [[-30, -30, -31], [30, 30, -15]]\ncount = 5").err().unwrap().to_string();
        assert!(below.contains("near a support"), "{below}");
    }

    /// More test points than nodes lie between them, on the round surface, and nowhere on what is held.
    #[test]
    fn test_points_beyond_the_nodes_lie_between_them() {
        let [few, many] = [6, 90].map(|count| prepared(&format!("count = {count}")).unwrap());
        let [coarse, fine] = [&few.scene.surface, &many.scene.surface];
        assert_eq!((few.points.len(), many.points.len()), (6, 90));
        assert_eq!(fine.triangles.len(), 4 * coarse.triangles.len());
        assert_eq!(fine.positions.len(), coarse.positions.len() + coarse.triangles.len() * 3 / 2);
        assert_eq!(fine.positions[..coarse.positions.len()], coarse.positions[..]);
        assert!(
            many.scene.notes.iter().any(|n| n.contains("divided"))
                && few.scene.notes.iter().all(|n| !n.contains("divided"))
        );
        for p in &fine.positions {
            // An edge's middle is 1 mm inside.
            assert!((p.length() - 30e-3).abs() < 0.2e-3, "{p}");
        }
        let mut nodes: Vec<u32> = many.points.iter().map(|p| p.node).collect();
        nodes.sort_unstable();
        nodes.dedup();
        assert_eq!(nodes.len(), 90);
        assert!(nodes.iter().any(|&n| n as usize >= coarse.positions.len()));
        for point in &many.points {
            assert_eq!(point.plan.point, fine.positions[point.node as usize]);
            assert!(point.plan.point.z > -15e-3 + 5e-3, "{}", point.plan.point);
        }
    }

    /// Where a crease passes through a vertex it has nodes on both sides, and all of them are held or none.
    #[test]
    fn creases_and_supports_are_divided_too() {
        let (spec, simulation) = spec(
            "[body]\ncrease_angle_deg = 40\nshape = { kind = \"block\", size_mm = [20, 20, 20], edge_length_mm = 10 }\n\
             [[body.fixed]]\nhalf_space = { point_mm = [0, 0, -10], normal = [0, 0, -1] }\n\
             [material]\nmodel = \"neo-hookean\"\nyoung_modulus_pa = 10e3\npoisson_ratio = 0.45\n\
             [tool]\nshape = \"sphere\"\nradius_mm = 6\n[deflection]\nnormal_max_mm = 3\nlateral_max_mm = 2\nsteps = 3\n",
        );
        let triangles = match &spec.geometry {
            Some(Geometry::Shape(shape, resolution)) => shape.mesh(*resolution).unwrap(),
            _ => unreachable!(),
        };
        let surface = assemble::surface(&spec, &triangles).unwrap();
        assert!(surface.positions().len() > triangles.positions.len());
        let is_held = |p: &DVec3| p.z < -10e-3 + 1e-9;
        let held: Vec<bool> = surface.positions().iter().map(is_held).collect();
        let count = triangles.triangles.len();
        let path = Path::new("block.toml");
        let before = TouchedSurface::new(&simulation, triangles, surface, held, path).unwrap();
        let (edge, vertices) = (before.edge_m(), before.vertices());
        let after = before.divided(&spec, &simulation, path, |_, _| Ok(())).unwrap();
        assert_eq!(after.triangles.triangles.len(), 4 * count);
        assert!(after.vertices() > 3 * vertices, "{} {vertices}", after.vertices());
        assert!((after.edge_m() / edge - 0.5).abs() < 0.02, "{} {edge}", after.edge_m());
        assert_eq!(after.held.len(), after.surface.positions().len());
        for ((p, held), open) in after.surface.positions().iter().zip(&after.held).zip(&after.open) {
            assert_eq!(*held, is_held(p), "{p}");
            assert!(p.abs().max_element() < 10e-3 + 1e-9, "flat faces stay flat: {p}");
            // The tool's radius and the longest drag above what is held.
            assert_eq!(*open, p.z > -2e-3, "{p}");
        }
    }
}
