//! From samples to responses, in the exact form: every curve passes through its samples.

use crate::error::FitError;
use crate::samples::{Component, Sample};
use crate::spread::{place, spread};
use glam::DVec3;
use palpate_body::curve::MAX_KNOTS;
use palpate_body::{
    BlendWeights, Body, BodyError, BodyParts, Curve, Extension, Interpolation, Provenance, Response,
    SlipRule, Surface, Tool,
};
use std::collections::HashMap;

/// How samples become curves.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FitOptions {
    /// Between the samples.
    pub interpolation: Interpolation,
    /// Friction coefficient of every point if no row gives one.
    pub default_friction: Option<f64>,
}

/// Responses on a surface: what [`palpate_body::BodyParts`] asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// One for each node.
    pub blends: Vec<BlendWeights>,
    /// One for each test point, on shared knots.
    pub responses: Vec<Response>,
    /// The node each test point sits on.
    pub test_point_nodes: Vec<u32>,
    /// What became of the samples.
    pub report: FitReport,
}

/// What a fitted body has beside surface and responses.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyOptions {
    /// The tool that the responses hold for.
    pub tool: Tool,
    /// The rule that its contacts slip by.
    pub slip: SlipRule,
    /// Whether slip is kept from giving out more energy than it has dissipated before.
    pub tank: bool,
    /// Whether contacts are two contact points side by side.
    pub partial_slip: bool,
    /// Where it comes from; the fit's own notes are added.
    pub provenance: Provenance,
}

impl Fit {
    /// The body of the surface that it was fitted on, with curves that are alike in all directions.
    ///
    /// # Errors
    /// As [`Body::new`]: a value that is impossible, or a surface that the responses don't belong to.
    pub fn into_body(self, surface: Surface, options: BodyOptions) -> Result<Body, BodyError> {
        let BodyOptions { tool, slip, tank, partial_slip, mut provenance } = options;
        provenance.notes.extend(self.report.notes);
        Body::new(BodyParts {
            surface,
            blends: self.blends,
            responses: self.responses,
            test_point_nodes: self.test_point_nodes,
            coupled: None,
            lateral_tensors: None,
            tool,
            slip,
            tank,
            partial_slip,
            provenance,
        })
    }
}

/// What became of the samples.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct FitReport {
    /// One for each test point.
    pub points: Vec<PointReport>,
    /// What was assumed on the way.
    pub notes: Vec<String>,
    /// Of any point from its node, m.
    pub largest_distance_m: f64,
}

/// What became of one point's samples.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PointReport {
    /// The point's name.
    pub point: String,
    /// The node it was matched to.
    pub node: u32,
    /// How far the node is, m.
    pub distance_m: f64,
    /// Rows of normal force; with none the curve comes from the points around.
    pub normal_samples: usize,
    /// Rows of lateral force; with none the curve comes from the points around.
    pub lateral_samples: usize,
    /// Rows of friction; with none the curve comes from the points around, or from the default.
    pub friction_samples: usize,
}

/// Deflections closer than this (m) are taken for the same one: far below what a sensor resolves, and wide enough for
/// the slope of a curve between them to mean something.
pub(crate) const SAME_DEFLECTION: f64 = 1e-8;

/// Makes a response for each point that `samples` name, in the order of their first rows, matches each to the surface
/// node nearest to it, and gives every other node a blend of the points around it (see [`spread`]).
///
/// Force curves begin at (0, 0) and pass through the point's samples; friction is held at its first value down to
/// depth 0. Lateral samples of different directions at one deflection are averaged. A component that some points lack
/// is taken from the points around that have it. Rows of weight 0 are left out.
///
/// # Errors
/// Numbers out of range, two positions of one point, two points on one node, two values of one deflection, a normal
/// force that decreases, a lateral one that does not increase, a component without any row, or more than
/// [`MAX_KNOTS`] different deflections. The place names the line and point.
pub fn fit(surface: &Surface, samples: &[Sample], options: &FitOptions) -> Result<Fit, FitError> {
    let mut notes = Vec::new();
    let points = points(samples, &mut notes)?;
    let (nodes, distances) = match_nodes(surface, &points, &mut notes)?;
    let curves = Curves { points: &points, surface, nodes: &nodes, options };
    let depth = knots(&points, &[Component::Normal, Component::Friction])?;
    let lateral_knots = knots(&points, &[Component::Lateral])?;
    let normal = curves.fit(Component::Normal, &depth, &mut notes)?;
    let lateral = curves.fit(Component::Lateral, &lateral_knots, &mut notes)?;
    let friction = curves.fit(Component::Friction, &depth, &mut notes)?;
    let responses = normal.into_iter().zip(lateral).zip(friction);
    let responses = responses.map(|((normal, lateral), friction)| Response { normal, lateral, friction });
    let blends = spread(surface, &nodes)?;

    let report = FitReport {
        points: (points.iter().zip(&nodes).zip(&distances))
            .map(|((point, &node), &distance_m)| PointReport {
                point: point.name.to_string(),
                node,
                distance_m,
                normal_samples: point.rows(Component::Normal).len(),
                lateral_samples: point.rows(Component::Lateral).len(),
                friction_samples: point.rows(Component::Friction).len(),
            })
            .collect(),
        notes,
        largest_distance_m: distances.into_iter().fold(0.0, f64::max),
    };
    Ok(Fit { blends, responses: responses.collect(), test_point_nodes: nodes, report })
}

/// A point and its rows of each component, by deflection.
struct Point<'a> {
    name: &'a str,
    position: DVec3,
    line: u64,
    rows: [Vec<&'a Sample>; 3],
}

impl<'a> Point<'a> {
    fn rows(&self, component: Component) -> &[&'a Sample] {
        &self.rows[component as usize]
    }
}

fn place_of(row: &Sample) -> String {
    format!("line {} (point `{}`)", row.line, row.point)
}

fn points<'a>(samples: &'a [Sample], notes: &mut Vec<String>) -> Result<Vec<Point<'a>>, FitError> {
    let mut points: Vec<Point> = Vec::new();
    let mut index: HashMap<&str, usize> = HashMap::new();
    for row in samples {
        check(row)?;
        let position = DVec3::from_array(row.position_m);
        let i = *index.entry(&row.point).or_insert(points.len());
        if i == points.len() {
            points.push(Point { name: &row.point, position, line: row.line, rows: Default::default() });
        }
        let point = &mut points[i];
        if position.distance(point.position) > 1e-9 {
            let [p, q] = [position, point.position];
            return Err(FitError::invalid(
                place_of(row),
                format!(
                    "it is at ({}, {}, {}) m here, at ({}, {}, {}) m in line {}",
                    p.x, p.y, p.z, q.x, q.y, q.z, point.line
                ),
                "give a point one position, or each place a name of its own",
            ));
        }
        if row.weight != Some(0.0) {
            point.rows[row.component as usize].push(row);
        }
    }
    points.retain(|point| point.rows.iter().any(|rows| !rows.is_empty()));
    if points.is_empty() {
        return Err(FitError::invalid(
            "samples",
            "there is none",
            "give at least one point with normal and lateral rows",
        ));
    }
    for rows in points.iter_mut().flat_map(|point| &mut point.rows) {
        rows.sort_by(|a, b| a.deflection_m.total_cmp(&b.deflection_m));
    }
    if samples.iter().any(|row| row.weight.is_some_and(|w| w != 0.0 && w != 1.0)) {
        notes.push("weights between the rows were not used: curves pass through every sample".into());
    }
    Ok(points)
}

fn check(row: &Sample) -> Result<(), FitError> {
    let bad = |problem: String, hint: &str| Err(FitError::invalid(place_of(row), problem, hint));
    if row.position_m.iter().any(|x| !x.is_finite()) {
        return bad(format!("its position is {:?} m", row.position_m), "give finite coordinates");
    }
    if !(0.0..=10.0).contains(&row.deflection_m) {
        return bad(
            format!("the deflection is {} m", row.deflection_m),
            "give deflections from 0 to 10 m, into the body",
        );
    }
    if !(0.0..=1e12).contains(&row.value) {
        return bad(
            format!("the {} value is {}", row.component, row.value),
            "give the force on the body in N or the friction coefficient: neither is negative",
        );
    }
    if row.component == Component::Friction && row.value > 100.0 {
        return bad(
            format!("the friction coefficient is {}", row.value),
            "give a coefficient between 0 and 100",
        );
    }
    if row.weight.is_some_and(|w| !(0.0..).contains(&w)) {
        return bad("its weight is negative".into(), "give a weight of 0 or more");
    }
    Ok(())
}

/// The nearest node of each point, and its distance.
fn match_nodes(
    surface: &Surface,
    points: &[Point],
    notes: &mut Vec<String>,
) -> Result<(Vec<u32>, Vec<f64>), FitError> {
    // Nodes along x: a search outwards from the point ends where x alone is further than the nearest so far.
    let positions = surface.positions();
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_by(|&a, &b| positions[a as usize].x.total_cmp(&positions[b as usize].x));
    let nearest = |p: DVec3| {
        let mut best = (f64::INFINITY, u32::MAX);
        let middle = order.partition_point(|&n| positions[n as usize].x < p.x);
        let (below, above) = order.split_at(middle);
        let mut visit = |n: u32| {
            let q = positions[n as usize];
            // Of the nodes of a crease the first.
            let found = (p.distance_squared(q), n);
            if found < best {
                best = found;
            }
            (q.x - p.x) * (q.x - p.x) <= best.0
        };
        let _ = above.iter().all(|&n| visit(n));
        let _ = below.iter().rev().all(|&n| visit(n));
        (best.1, best.0.sqrt())
    };
    let (nodes, distances): (Vec<u32>, Vec<f64>) = points.iter().map(|point| nearest(point.position)).unzip();

    let (low, high) =
        positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), &p| (l.min(p), h.max(p)));
    let size = high.distance(low);
    if let Some((point, distance)) = points.iter().zip(&distances).find(|(_, d)| **d > size) {
        return Err(FitError::invalid(
            format!("line {} (point `{}`)", point.line, point.name),
            format!("it is {distance:.3} m from the mesh, which is {size:.3} m across"),
            "check the unit and the frame of samples and mesh",
        ));
    }
    let mut owner: HashMap<u32, &Point> = HashMap::new();
    for (point, &node) in points.iter().zip(&nodes) {
        if let Some(other) = owner.insert(node, point) {
            return Err(FitError::invalid(
                format!("line {} (point `{}`)", point.line, point.name),
                format!(
                    "node {node} is the nearest to it and to point `{}` (line {})",
                    other.name, other.line
                ),
                "refine the mesh there, or remove one of the two points",
            ));
        }
    }
    let far = 0.05 * size;
    if let Some((point, distance)) = points.iter().zip(&distances).find(|(_, d)| **d > far) {
        notes.push(format!(
            "point `{}` lies {:.3} mm from the nearest node: are samples and mesh in the same frame, and both in m?",
            point.name,
            distance * 1e3
        ));
    }
    Ok((nodes, distances))
}

/// The different deflections of all points' rows, and 0.
fn knots(points: &[Point], components: &[Component]) -> Result<Vec<f64>, FitError> {
    let rows = points.iter().flat_map(|point| components.iter().flat_map(|&c| point.rows(c)));
    let mut knots: Vec<f64> = rows.map(|row| row.deflection_m).chain([0.0]).collect();
    knots.sort_by(f64::total_cmp);
    knots.dedup_by(|next, kept| *next - *kept < SAME_DEFLECTION);
    if knots.len() > MAX_KNOTS {
        return Err(FitError::invalid(
            "samples",
            format!(
                "they have {} different {} deflections, where {MAX_KNOTS} can be used",
                knots.len(),
                components[0]
            ),
            "sample all points at the same deflections, or fewer",
        ));
    }
    Ok(knots)
}

/// The knot that stands for a deflection.
pub(crate) fn knot(knots: &[f64], deflection: f64) -> f64 {
    knots[knots.partition_point(|&k| k <= deflection).saturating_sub(1)]
}

struct Curves<'a> {
    points: &'a [Point<'a>],
    surface: &'a Surface,
    nodes: &'a [u32],
    options: &'a FitOptions,
}

impl Curves<'_> {
    /// One curve of `component` for each point, on `knots`.
    fn fit(
        &self,
        component: Component,
        knots: &[f64],
        notes: &mut Vec<String>,
    ) -> Result<Vec<Curve>, FitError> {
        if self.points.iter().all(|point| point.rows(component).is_empty()) {
            return self.without_rows(component, knots);
        }
        let mut averages = Averages::default();
        let mut shortest: Option<(f64, &str)> = None;
        let mut curves = Vec::with_capacity(self.points.len());
        for point in self.points {
            let rows = point.rows(component);
            if rows.is_empty() {
                curves.push(None);
                continue;
            }
            let own = self.own_curve(rows, component, knots, &mut averages)?;
            let end = own.knots()[own.knots().len() - 1];
            if shortest.is_none_or(|(least, _)| end < least) {
                shortest = Some((end, point.name));
            }
            curves.push(Some(tidy(&own.on_knots(knots)?)?));
        }
        averages.note(notes);
        let end = knots[knots.len() - 1];
        if let Some((least, name)) = shortest.filter(|s| component != Component::Friction && s.0 < end) {
            notes.push(format!(
                "{component} samples of point `{name}` end at {:.3} mm, others at {:.3} mm: shorter curves go on along their end slope",
                least * 1e3,
                end * 1e3
            ));
        }
        self.fill(component, curves, notes)
    }

    fn without_rows(&self, component: Component, knots: &[f64]) -> Result<Vec<Curve>, FitError> {
        let missing =
            |hint: &str| Err(FitError::invalid("samples", format!("there is no {component} row"), hint));
        if component != Component::Friction {
            return missing("give each component at one point at least");
        }
        let Some(coefficient) = self.options.default_friction else {
            return missing(
                "add friction rows, or give --friction or, in the spec, `[friction] coefficient`",
            );
        };
        if !(0.0..=1e12).contains(&coefficient) {
            let problem = format!("it is {coefficient}");
            return Err(FitError::invalid(
                "friction coefficient",
                problem,
                "give a number that is not negative",
            ));
        }
        let values = vec![coefficient; knots.len()];
        let curve = Curve::through(knots, &values, Interpolation::Linear, Extension::Constant)?;
        Ok(vec![curve; self.points.len()])
    }

    /// The curve through one point's rows, on its own knots.
    fn own_curve(
        &self,
        rows: &[&Sample],
        component: Component,
        shared: &[f64],
        averages: &mut Averages,
    ) -> Result<Curve, FitError> {
        let same = |a: &&Sample, b: &&Sample| knot(shared, a.deflection_m) == knot(shared, b.deflection_m);
        let mut knots = Vec::new();
        let mut values: Vec<f64> = Vec::new();
        for group in rows.chunk_by(same) {
            let (row, value) = (group[0], averages.value(group, component)?);
            let last = values.last().copied().unwrap_or(0.0);
            let at = knot(shared, row.deflection_m);
            if component != Component::Friction && at == 0.0 && value != 0.0 {
                return Err(FitError::invalid(
                    place_of(row),
                    format!("the {component} force at zero deflection is {value} N"),
                    "it must be 0: subtract what the sensor shows at rest",
                ));
            }
            let falls = match component {
                Component::Normal => value < last,
                Component::Lateral => value <= last && at > 0.0,
                Component::Friction => false,
            };
            if falls {
                let rule = if component == Component::Normal { "must not decrease" } else { "must increase" };
                return Err(FitError::invalid(
                    place_of(row),
                    format!(
                        "the {component} force is {value} N after {last} N, but it {rule} with deflection"
                    ),
                    "smooth the samples first",
                ));
            }
            if knots.is_empty() && at > 0.0 {
                knots.push(0.0);
                values.push(if component == Component::Friction { value } else { 0.0 });
            }
            knots.push(at);
            values.push(value);
        }
        if knots.len() == 1 {
            if component != Component::Friction {
                let problem = format!("it is the point's only {component} row, at zero deflection");
                return Err(FitError::invalid(place_of(rows[0]), problem, "add rows at larger deflections"));
            }
            knots.push(shared.last().copied().filter(|&end| end > 0.0).unwrap_or(1e-3));
            values.push(values[0]);
        }
        let extension =
            if component == Component::Friction { Extension::Constant } else { Extension::Linear };
        let curve = Curve::through(&knots, &values, self.options.interpolation, extension)?;
        if component == Component::Lateral { rising_end(&curve) } else { Ok(curve) }
    }

    /// Gives the points without a curve the blend of the points around that have one.
    fn fill(
        &self,
        component: Component,
        curves: Vec<Option<Curve>>,
        notes: &mut Vec<String>,
    ) -> Result<Vec<Curve>, FitError> {
        let having: Vec<usize> = (0..curves.len()).filter(|&i| curves[i].is_some()).collect();
        if having.len() == curves.len() {
            return Ok(curves.into_iter().flatten().collect());
        }
        notes.push(format!(
            "{} of {} points have no {component} rows: theirs come from the points around",
            curves.len() - having.len(),
            curves.len()
        ));
        let blends = place(self.surface, &having.iter().map(|&i| self.nodes[i]).collect::<Vec<_>>())?;
        let known: Vec<&Curve> = curves.iter().flatten().collect();
        let filled = curves.iter().enumerate().map(|(i, own)| {
            if let Some(own) = own {
                return Ok(own.clone());
            }
            let Some(blend) = blends[self.surface.vertices()[self.nodes[i] as usize] as usize] else {
                return Err(FitError::invalid(
                    format!("line {} (point `{}`)", self.points[i].line, self.points[i].name),
                    format!("no point on its connected part of the surface has {component} rows"),
                    format!("add {component} rows to a point there"),
                ));
            };
            let terms =
                std::array::from_fn::<_, 3, _>(|j| (blend.weights[j], known[blend.test_points[j] as usize]));
            Ok(Curve::blend(&terms)?)
        });
        filled.collect()
    }
}

/// How much lateral forces of different directions differed.
#[derive(Default)]
struct Averages {
    count: usize,
    /// Largest difference, N, and its place.
    largest: (f64, String),
}

impl Averages {
    /// The one value of rows at one deflection.
    fn value(&mut self, group: &[&Sample], component: Component) -> Result<f64, FitError> {
        let same = |a: &Sample, b: &Sample| {
            let unit = |row: &Sample| row.direction.map(|d| DVec3::from_array(d).normalize_or_zero());
            component != Component::Lateral
                || unit(a).zip(unit(b)).map_or(a.direction == b.direction, |(a, b)| a.distance(b) < 1e-6)
        };
        let mut distinct: Vec<&Sample> = Vec::new();
        for &row in group {
            match distinct.iter().find(|other| same(other, row)) {
                Some(other) if other.value != row.value => {
                    return Err(FitError::invalid(
                        place_of(row),
                        format!(
                            "its {component} value at {} m is {}, but {} in line {}",
                            row.deflection_m, row.value, other.value, other.line
                        ),
                        "give one value for each deflection, such as the mean",
                    ));
                }
                Some(_) => {}
                None => distinct.push(row),
            }
        }
        if distinct.len() > 1 {
            self.count += 1;
            let values = || distinct.iter().map(|row| row.value);
            let difference = values().fold(0.0, f64::max) - values().fold(f64::INFINITY, f64::min);
            if difference >= self.largest.0 {
                self.largest = (difference, place_of(distinct[0]));
            }
        }
        Ok(distinct.iter().map(|row| row.value).sum::<f64>() / distinct.len() as f64)
    }

    fn note(self, notes: &mut Vec<String>) {
        if self.count > 0 {
            let (difference, place) = self.largest;
            notes.push(format!(
                "lateral forces of different directions were averaged at {} deflections, the largest difference was \
                 {difference:.4} N in {place}: lateral responses are isotropic",
                self.count
            ));
        }
    }
}

/// Bringing a curve onto more knots evaluates its powers, and rounding may leave neighbouring intervals an ulp apart
/// or a friction coefficient as far below 0. A knot's right-hand ordinate is a sample where it is one at all.
pub(crate) fn tidy(curve: &Curve) -> Result<Curve, FitError> {
    let mut ordinates = curve.ordinates().to_vec();
    for i in 1..ordinates.len() {
        ordinates[i - 1][3] = ordinates[i][0];
    }
    for b in ordinates.as_flattened_mut() {
        *b = b.max(0.0);
    }
    Ok(Curve::from_ordinates(curve.knots(), &ordinates, curve.extension())?)
}

/// A lateral curve that goes on rising past its end: where the samples level off, PCHIP may end with slope 0. At least
/// 1 % of the last interval's mean slope keeps the curve monotone and through its samples.
pub(crate) fn rising_end(curve: &Curve) -> Result<Curve, FitError> {
    let mut ordinates = curve.ordinates().to_vec();
    if let Some([start, .., before, end]) = ordinates.last_mut() {
        *before = before.min(*end - (*end - *start) / 300.0);
    }
    Ok(Curve::from_ordinates(curve.knots(), &ordinates, curve.extension())?)
}
