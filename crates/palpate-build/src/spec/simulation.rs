//! Tables that only a simulation needs: what holds the body, what it is made of, where and how finely it is solved.

use super::material::{self, Material, RawMaterial};
use super::response::RawDeflection;
use super::tool::{self, Contact, RawTool, ToolShape};
use super::{Deflection, Friction, Geometry, Spec};
use anyhow::{Result, anyhow};
use glam::DVec3;
use palpate_files::{List, Source};
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// What a simulation asks of a spec besides the body's geometry, in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Wherever no region says otherwise.
    pub material: Material,
    /// Later ones go before earlier ones.
    pub regions: Vec<Region>,
    /// What holds the body.
    pub fixed: Vec<Fixed>,
    /// What touches it.
    pub tool: ToolShape,
    /// How it holds to the tool.
    pub contact: Contact,
    /// How far.
    pub deflection: Deflection,
    /// States of each press, ascending, m: steps, and the depths that drags begin at.
    pub depths_m: Vec<f64>,
    /// Which of them drags begin at.
    pub drag_from: Vec<usize>,
    /// Drags from each of those, evenly around.
    pub directions: u32,
    /// Where it is touched.
    pub test_points: TestPoints,
    /// The part of the surface that is touched at all; None: all of it.
    pub touched: Option<Place>,
    /// At so many of them it is dragged, too.
    pub drag_points: usize,
    /// What becomes of it.
    pub law: Law,
    /// How finely a body without a volume mesh is meshed.
    pub mesh: MeshSizes,
    /// The coefficient over depth; None: the spec does not say.
    pub friction: Option<Friction>,
}

/// A part of the body with its own material.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Where the spec says so.
    pub place: String,
    /// The elements whose centroids lie in it.
    pub selection: Selection,
    /// What they are made of.
    pub material: Material,
}

/// What holds the body.
#[derive(Debug, Clone, PartialEq)]
pub struct Fixed {
    /// Where the spec says so.
    pub place: String,
    /// The nodes.
    pub selection: Selection,
    /// Along which axes they can't move.
    pub axes: [bool; 3],
}

/// Nodes or elements of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub enum Selection {
    /// Those a place holds.
    Place(Place),
    /// Those of a named group of the mesh.
    Group(String),
    /// Those that a file names.
    Nodes(PathBuf),
}

/// A part of space, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// The side of a plane that `normal` points to, with the plane.
    HalfSpace {
        /// On the plane.
        point: DVec3,
        /// Unit vector.
        normal: DVec3,
    },
    /// Within two corners.
    Box {
        /// Least coordinates.
        low: DVec3,
        /// Greatest coordinates.
        high: DVec3,
    },
    /// Within half-axes along x, y, z.
    Ellipsoid {
        /// Middle.
        centre: DVec3,
        /// Half-axes.
        radii: DVec3,
    },
}

impl Place {
    /// Whether it holds `p`; `tolerance` (m) beyond its border counts as within.
    pub fn contains(&self, p: DVec3, tolerance: f64) -> bool {
        match *self {
            Place::HalfSpace { point, normal } => (p - point).dot(normal) >= -tolerance,
            Place::Box { low, high } => {
                (p - low).min_element() >= -tolerance && (high - p).min_element() >= -tolerance
            }
            Place::Ellipsoid { centre, radii } => {
                ((p - centre) / (radii + tolerance)).length_squared() <= 1.0
            }
        }
    }
}

/// Where a body is touched.
#[derive(Debug, Clone, PartialEq)]
pub enum TestPoints {
    /// As many as about three quarters of an hour on two cores have time for.
    Affordable,
    /// So many, spread evenly.
    Count(u32),
    /// About so far from each other, m.
    Spacing(f64),
    /// The surface's nodes next to these, m.
    At(Vec<DVec3>),
    /// Every node that the tool can come to.
    EveryNode,
    /// As many as it takes.
    Adaptive {
        /// The error at a point that the others predict, in % of the largest force there.
        tolerance_percent: f64,
        /// So many at most.
        most: u32,
    },
}

/// The law that a body gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// One potential W(δz, δ_t) at each place.
    Coupled,
    /// Curves of the normal and of the lateral force.
    Decoupled,
}

/// Lengths of elements; None: chosen for the tool.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeshSizes {
    /// At the surface, m.
    pub element_size_m: Option<f64>,
    /// Deep inside, m.
    pub interior_size_m: Option<f64>,
}

#[derive(Deserialize)]
struct Raw {
    body: Option<Spanned<RawBody>>,
    material: Option<Spanned<RawMaterial>>,
    tool: Option<Spanned<RawTool>>,
    deflection: Option<Spanned<RawDeflection>>,
    test_points: Option<Spanned<RawTestPoints>>,
    mesh: Option<Spanned<RawMesh>>,
    fit: Option<Spanned<RawFit>>,
    response: Option<Spanned<toml::Value>>,
}

#[derive(Deserialize)]
struct RawBody {
    fixed: Option<Vec<Spanned<RawFixed>>>,
    open: Option<Spanned<bool>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFixed {
    half_space: Option<Spanned<RawHalfSpace>>,
    box_mm: Option<Spanned<List<2, List<3>>>>,
    group: Option<Spanned<String>>,
    nodes: Option<Spanned<PathBuf>>,
    axes: Option<Spanned<Vec<String>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawHalfSpace {
    point_mm: Spanned<List<3>>,
    normal: Spanned<List<3>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTestPoints {
    count: Option<Spanned<i64>>,
    spacing_mm: Option<Spanned<f64>>,
    at_mm: Option<Spanned<Vec<List<3>>>>,
    every_node: Option<Spanned<bool>>,
    tolerance_percent: Option<Spanned<f64>>,
    drags: Option<Spanned<i64>>,
    box_mm: Option<Spanned<List<2, List<3>>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFit {
    law: Option<Spanned<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawMesh {
    element_size_mm: Option<Spanned<f64>>,
    interior_size_mm: Option<Spanned<f64>>,
}

/// Test points of a decoupled law when the spec does not say, and of a coupled one at least.
pub const COUNT: u32 = 60;
/// More would take weeks.
const MAX_COUNT: u32 = 100_000;
/// Test points that are dragged, when the spec does not say: terms of third and fourth order vary little, and are carried over.
const DRAG_POINTS: usize = 60;
/// What is simulated when the spec does not say.
const CONTACT: &str = "sticking";

impl Law {
    /// What the history of forces suits.
    fn of(contact: Contact) -> Law {
        match contact {
            Contact::Sticking => Law::Coupled,
            Contact::Frictionless | Contact::Bonded { .. } => Law::Decoupled,
        }
    }

    /// Where drags begin, as shares of the greatest depth. One lateral curve errs least from about the mean of the depths at
    /// which a hand drags; quartic terms of a potential change with the depth.
    fn drag_depths(self) -> &'static [f64] {
        match self {
            Law::Coupled => &[0.5, 1.0],
            Law::Decoupled => &[0.6],
        }
    }

    /// Directions of drags. Four show the anisotropy, both ways along two axes; six show cubic terms twice over.
    fn directions(self) -> u32 {
        match self {
            Law::Coupled => 6,
            Law::Decoupled => 4,
        }
    }

    /// Further states of a press, as shares of its first step: stuck stiffness grows as the root of the depth.
    fn first_depths(self) -> &'static [f64] {
        match self {
            Law::Coupled => &[1.0 / 3.0],
            Law::Decoupled => &[],
        }
    }
}

impl Spec {
    /// The tables of a simulation; `path` is the spec's name in messages.
    ///
    /// # Errors
    /// A table or key is missing, unknown or impossible. The message names the line.
    pub fn simulation(&self, path: &Path) -> Result<Simulation> {
        self.simulation_by_default(path, CONTACT)
    }

    /// The same, where a spec that names no contact means this one.
    ///
    /// # Errors
    /// As [`Spec::simulation`].
    pub fn simulation_by_default(&self, path: &Path, contact: &str) -> Result<Simulation> {
        let source = Source { path, text: &self.text };
        let raw: Raw = toml::from_str(&self.text).map_err(|e| source.syntax(&e))?;
        let missing = |what: &str, hint: &str| anyhow!("{}: {what} is missing; {hint}", path.display());
        if let Some(response) = &raw.response {
            let problem = "[response] is a law instead of a simulation";
            return Err(source.error(response.span(), problem, "remove it, or use `palpate fit`"));
        }
        if self.geometry.is_none() {
            return Err(missing("[body]'s geometry", "add mesh and unit, or [body.shape]"));
        }
        if let (Some(Geometry::Mesh(_)), None, Some(body)) = (&self.geometry, self.unit, &raw.body) {
            let span = source.find_key(body.span(), "mesh");
            return Err(source.error(
                span,
                "the mesh's unit is missing",
                "add unit = \"m\", \"cm\" or \"mm\"",
            ));
        }
        if let Some(open) = raw.body.as_ref().and_then(|b| b.get_ref().open.as_ref()).filter(|o| *o.get_ref())
        {
            let problem = "a surface with borders encloses nothing that could be simulated";
            return Err(source.error(open.span(), problem, "remove `open`, and close the surface"));
        }
        let material_table =
            raw.material.as_ref().ok_or_else(|| missing("[material]", "add it: model and parameters"))?;
        let tool_table = raw.tool.as_ref().ok_or_else(|| missing("[tool]", "add it: shape and radius_mm"))?;
        let deflection_table = raw
            .deflection
            .as_ref()
            .ok_or_else(|| missing("[deflection]", "add it: normal_max_mm and lateral_max_mm"))?;
        let deflection = super::response::deflection(&source, deflection_table.get_ref())?;
        let fixed = raw.body.as_ref().and_then(|b| b.get_ref().fixed.as_deref()).unwrap_or_default();
        if fixed.is_empty() {
            return Err(missing(
                "[[body.fixed]]",
                "say what holds the body: half_space, box_mm, group or nodes",
            ));
        }
        let tool = tool::tool(&source, tool_table)?;
        let contact = tool::contact(&source, tool_table, &tool, contact)?;
        let law = law(&source, raw.fit.as_ref().and_then(|f| f.get_ref().law.as_ref()), contact)?;
        let (depths_m, drag_from) = depths(&source, deflection_table.get_ref(), deflection, law)?;
        let points = raw.test_points.as_ref();
        let test_points = points.map_or_else(|| Ok(by_default(law)), |t| test_points(&source, t, law))?;
        let touched = points.and_then(|t| t.get_ref().box_mm.as_ref());
        let touched = touched.map(|corners| box_of(&source, corners)).transpose()?;
        Ok(Simulation {
            material: base(&source, material_table)?,
            regions: regions(&source, material_table.get_ref())?,
            fixed: fixed.iter().map(|f| self::fixed(&source, f)).collect::<Result<_>>()?,
            contact,
            tool,
            deflection,
            depths_m,
            drag_from,
            directions: directions(&source, deflection_table.get_ref(), law)?,
            drag_points: drag_points(&source, points, law, &test_points)?,
            test_points,
            touched,
            law,
            mesh: raw.mesh.as_ref().map_or(Ok(MeshSizes::default()), |m| mesh(&source, m.get_ref()))?,
            friction: self.friction.clone(),
        })
    }
}

/// A place or coordinate beyond this is taken for a mistake, mm.
const MAX_COORDINATE_MM: f64 = 1e6;

fn vector(source: &Source, span: Range<usize>, key: &str, v: [f64; 3]) -> Result<DVec3> {
    if v.iter().all(|x| x.abs() <= MAX_COORDINATE_MM) {
        return Ok(DVec3::from_array(v) / 1e3);
    }
    let hint = format!("give finite numbers, {MAX_COORDINATE_MM} at most");
    Err(source.error(span, &format!("{key} is {v:?}"), &hint))
}

fn box_of(source: &Source, corners: &Spanned<List<2, List<3>>>) -> Result<Place> {
    let [low, high] = corners.get_ref().0.map(|row| row.0);
    let place = |v| vector(source, corners.span(), "box_mm", v);
    let (low, high) = (place(low)?, place(high)?);
    if (high - low).min_element() > 0.0 {
        return Ok(Place::Box { low, high });
    }
    let problem = format!(
        "box_mm is {:?}: its second corner is not beyond its first along each axis",
        [low, high].map(|v| (v * 1e3).to_array())
    );
    Err(source.error(corners.span(), &problem, "give the least x, y, z, then the greatest"))
}

fn ellipsoid(
    source: &Source,
    centre: &Spanned<List<3>>,
    radii: [f64; 3],
    span: Range<usize>,
    key: &str,
) -> Result<Place> {
    let centre = vector(source, centre.span(), "centre_mm", centre.get_ref().0)?;
    if !radii.iter().all(|r| (1e-3..=MAX_COORDINATE_MM).contains(r)) {
        let problem = match radii {
            [r, ..] if key == "radius_mm" => format!("{key} is {r}"),
            _ => format!("{key} is {radii:?}"),
        };
        return Err(source.error(span, &problem, "give lengths of 0.001 at least"));
    }
    Ok(Place::Ellipsoid { centre, radii: DVec3::from_array(radii) / 1e3 })
}

/// The one of several ways to say it, or a complaint.
fn one_of<T>(source: &Source, span: Range<usize>, table: &str, keys: &str, given: Vec<T>) -> Result<T> {
    let count = given.len();
    let mut given = given.into_iter();
    match (given.next(), count) {
        (Some(one), 1) => Ok(one),
        (None, _) => {
            Err(source.error(span, &format!("{table} does not say where"), &format!("add one of {keys}")))
        }
        _ => Err(source.error(
            span,
            &format!("{table} says where {count} times"),
            &format!("keep one of {keys}"),
        )),
    }
}

fn named(source: &Source, group: &Spanned<String>) -> Result<Selection> {
    if group.get_ref().trim().is_empty() {
        return Err(source.error(group.span(), "group has no name", "name a group of the mesh"));
    }
    Ok(Selection::Group(group.get_ref().clone()))
}

fn fixed(source: &Source, raw: &Spanned<RawFixed>) -> Result<Fixed> {
    let f = raw.get_ref();
    let mut given = Vec::new();
    if let Some(half) = &f.half_space {
        let (point, normal) = (&half.get_ref().point_mm, &half.get_ref().normal);
        let point = vector(source, point.span(), "point_mm", point.get_ref().0)?;
        let direction = vector(source, normal.span(), "normal", normal.get_ref().0)?.try_normalize();
        let Some(normal) = direction else {
            let problem = "the half space's normal has no direction";
            return Err(source.error(normal.span(), problem, "give one that is not zero, e.g. [0, 0, 1]"));
        };
        given.push(Selection::Place(Place::HalfSpace { point, normal }));
    }
    if let Some(corners) = &f.box_mm {
        given.push(Selection::Place(box_of(source, corners)?));
    }
    if let Some(group) = &f.group {
        given.push(named(source, group)?);
    }
    if let Some(nodes) = &f.nodes {
        given.push(Selection::Nodes(source.beside(nodes.get_ref())));
    }
    let keys = "half_space, box_mm, group, nodes";
    let selection = one_of(source, raw.span(), "[[body.fixed]]", keys, given)?;
    let axes = match &f.axes {
        None => [true; 3],
        Some(axes) => {
            let mut held = [false; 3];
            for axis in axes.get_ref() {
                let Some(i) = ["x", "y", "z"].iter().position(|name| name == axis).filter(|&i| !held[i])
                else {
                    let problem = format!("axes has `{}`", axis.escape_debug());
                    return Err(source.error(
                        axes.span(),
                        &problem,
                        "give \"x\", \"y\", \"z\", each once at most",
                    ));
                };
                held[i] = true;
            }
            if held == [false; 3] {
                return Err(source.error(axes.span(), "axes is empty", "name an axis, or remove the key"));
            }
            held
        }
    };
    Ok(Fixed { place: source.place(raw.span()), selection, axes })
}

fn base(source: &Source, raw: &Spanned<RawMaterial>) -> Result<Material> {
    let m = raw.get_ref();
    let places = [
        ("group", m.group.as_ref().map(Spanned::span)),
        ("sphere", m.sphere.as_ref().map(Spanned::span)),
        ("ellipsoid", m.ellipsoid.as_ref().map(Spanned::span)),
        ("box_mm", m.box_mm.as_ref().map(Spanned::span)),
    ];
    if let Some((key, span)) = places.into_iter().find_map(|(key, span)| Some((key, span?))) {
        let problem = format!("[material] has {key}: it holds wherever no region says otherwise");
        return Err(source.error(span, &problem, "move it to a [[material.region]]"));
    }
    material::material(source, "[material]", raw)
}

fn regions(source: &Source, base: &RawMaterial) -> Result<Vec<Region>> {
    let regions = base.region.as_deref().unwrap_or_default();
    let region = |raw: &Spanned<RawMaterial>| {
        let (m, table) = (raw.get_ref(), "[[material.region]]");
        if m.region.is_some() {
            return Err(source.error(raw.span(), "a region has no regions", "write them side by side"));
        }
        let mut given = Vec::new();
        if let Some(group) = &m.group {
            given.push(named(source, group)?);
        }
        if let Some(sphere) = &m.sphere {
            let (centre, r) = (&sphere.get_ref().centre_mm, &sphere.get_ref().radius_mm);
            let place = ellipsoid(source, centre, [*r.get_ref(); 3], r.span(), "radius_mm")?;
            given.push(Selection::Place(place));
        }
        if let Some(e) = &m.ellipsoid {
            let (centre, r) = (&e.get_ref().centre_mm, &e.get_ref().radii_mm);
            given.push(Selection::Place(ellipsoid(source, centre, r.get_ref().0, r.span(), "radii_mm")?));
        }
        if let Some(corners) = &m.box_mm {
            given.push(Selection::Place(box_of(source, corners)?));
        }
        let selection = one_of(source, raw.span(), table, "group, sphere, ellipsoid, box_mm", given)?;
        Ok(Region {
            place: source.place(raw.span()),
            selection,
            material: material::material(source, table, raw)?,
        })
    };
    regions.iter().map(region).collect()
}

/// The states of a press, and where drags begin.
fn depths(
    source: &Source,
    raw: &RawDeflection,
    deflection: Deflection,
    law: Law,
) -> Result<(Vec<f64>, Vec<usize>)> {
    let (end, steps) = (deflection.normal_max_m, deflection.steps);
    let step = |i: f64| end * i / f64::from(steps);
    let first = law.first_depths();
    let mut depths: Vec<f64> = first.iter().copied().chain((1..=steps).map(f64::from)).map(step).collect();
    let Some(given) = &raw.lateral_depths_mm else {
        // The steps nearest to them; of two, the deeper.
        let nearest = |part: &f64| first.len() + (part * f64::from(steps)).round().max(1.0) as usize - 1;
        let mut from: Vec<usize> = law.drag_depths().iter().map(nearest).collect();
        from.dedup();
        return Ok((depths, from));
    };
    let list: Vec<f64> = given.get_ref().iter().map(|mm| mm / 1e3).collect();
    let ascend = list.windows(2).all(|d| d[1] - d[0] >= 1e-6);
    let within = list.iter().all(|d| *d >= 1e-6 && *d <= end * (1.0 + 1e-12));
    if list.is_empty() || list.len() > 32 || !ascend || !within {
        let problem = format!("lateral_depths_mm is {:?}", given.get_ref());
        let hint =
            format!("give up to 32 depths, ascending, above 0 and at most normal_max_mm ({})", end * 1e3);
        return Err(source.error(given.span(), &problem, &hint));
    }
    // A depth that is a step already, or all but one, is that step.
    let near = |depths: &[f64], d: f64| depths.iter().position(|s| (s - d).abs() <= 1e-3 * end);
    for &d in &list {
        if near(&depths, d).is_none() {
            depths.push(d);
        }
    }
    depths.sort_by(f64::total_cmp);
    let mut from: Vec<usize> = list.iter().filter_map(|&d| near(&depths, d)).collect();
    from.dedup();
    Ok((depths, from))
}

fn law(source: &Source, given: Option<&Spanned<String>>, contact: Contact) -> Result<Law> {
    match given.map(|l| (l, l.get_ref().as_str())) {
        None => Ok(Law::of(contact)),
        Some((_, "coupled")) => Ok(Law::Coupled),
        Some((_, "decoupled")) => Ok(Law::Decoupled),
        Some((given, other)) => {
            let problem = format!("there is no law `{}`", other.escape_debug());
            Err(source.error(given.span(), &problem, "give law = \"coupled\" or \"decoupled\""))
        }
    }
}

fn directions(source: &Source, raw: &RawDeflection, law: Law) -> Result<u32> {
    let Some(given) = &raw.directions else { return Ok(law.directions()) };
    match u32::try_from(*given.get_ref()) {
        Ok(n @ 4..=64) => Ok(n),
        _ => {
            let problem = format!("directions is {}", given.get_ref());
            Err(source.error(given.span(), &problem, "give a number between 4 and 64"))
        }
    }
}

/// A whole number of test points.
fn number(source: &Source, given: &Spanned<i64>, key: &str) -> Result<u32> {
    match u32::try_from(*given.get_ref()) {
        Ok(n) if (1..=MAX_COUNT).contains(&n) => Ok(n),
        _ => {
            let problem = format!("{key} is {}", given.get_ref());
            let hint = format!("give a number between 1 and {MAX_COUNT}");
            Err(source.error(given.span(), &problem, &hint))
        }
    }
}

/// A press with its stuck tangents is quick, and what is left of the error lies between test points; for a decoupled law each is dragged,
/// which is not.
fn by_default(law: Law) -> TestPoints {
    match law {
        Law::Coupled => TestPoints::Affordable,
        Law::Decoupled => TestPoints::Count(COUNT),
    }
}

fn test_points(source: &Source, raw: &Spanned<RawTestPoints>, law: Law) -> Result<TestPoints> {
    let t = raw.get_ref();
    let count = t.count.as_ref().map(|count| number(source, count, "count")).transpose()?;
    let mut given = Vec::new();
    match (&t.tolerance_percent, count) {
        (Some(tolerance), _) => {
            if law == Law::Decoupled {
                let problem = "tolerance_percent is for the coupled law";
                let hint = "remove it, or give contact = \"sticking\"";
                return Err(source.error(tolerance.span(), problem, hint));
            }
            let tolerance_percent = source.within(tolerance, "tolerance_percent", 0.01..=100.0)?;
            let Some(most) = count else {
                let problem =
                    "tolerance_percent says when to stop, but nothing how many test points there may be";
                return Err(source.error(tolerance.span(), problem, "add count, the most"));
            };
            given.push(TestPoints::Adaptive { tolerance_percent, most });
        }
        (None, Some(count)) => given.push(TestPoints::Count(count)),
        (None, None) => {}
    }
    if let Some(spacing) = &t.spacing_mm {
        given.push(TestPoints::Spacing(source.within(spacing, "spacing_mm", 1e-2..=1e4)? / 1e3));
    }
    if let Some(at) = &t.at_mm {
        if at.get_ref().is_empty() || at.get_ref().len() > MAX_COUNT as usize {
            let hint = format!("give 1 to {MAX_COUNT} points [x, y, z]");
            return Err(source.error(at.span(), &format!("at_mm has {} points", at.get_ref().len()), &hint));
        }
        let points = at.get_ref().iter().map(|p| vector(source, at.span(), "a point of at_mm", p.0));
        given.push(TestPoints::At(points.collect::<Result<_>>()?));
    }
    if t.every_node.as_ref().is_some_and(|every| *every.get_ref()) {
        given.push(TestPoints::EveryNode);
    }
    if given.is_empty() && (t.drags.is_some() || t.box_mm.is_some()) {
        given.push(by_default(law));
    }
    one_of(source, raw.span(), "[test_points]", "count, spacing_mm, at_mm, every_node", given)
}

/// How many test points are dragged.
fn drag_points(
    source: &Source,
    raw: Option<&Spanned<RawTestPoints>>,
    law: Law,
    points: &TestPoints,
) -> Result<usize> {
    match raw.and_then(|t| t.get_ref().drags.as_ref()) {
        Some(drags) => Ok(number(source, drags, "drags")? as usize),
        // Without a potential nothing is carried over.
        None if law == Law::Decoupled && *points != TestPoints::EveryNode => Ok(usize::MAX),
        None => Ok(DRAG_POINTS),
    }
}

fn mesh(source: &Source, raw: &RawMesh) -> Result<MeshSizes> {
    let size = |value: &Option<Spanned<f64>>, key| {
        value.as_ref().map(|v| source.within(v, key, 1e-2..=1e3).map(|mm| mm / 1e3)).transpose()
    };
    let (surface, interior) =
        (size(&raw.element_size_mm, "element_size_mm")?, size(&raw.interior_size_mm, "interior_size_mm")?);
    if let (Some(s), Some(i), Some(key)) = (surface, interior, &raw.interior_size_mm)
        && i < s
    {
        let problem = format!("interior_size_mm {} is less than element_size_mm {}", i * 1e3, s * 1e3);
        return Err(source.error(key.span(), &problem, "make it as long at least"));
    }
    Ok(MeshSizes { element_size_m: surface, interior_size_m: interior })
}
