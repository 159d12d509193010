//! The body: everything the engine reads, immutable and checked once.

use crate::curve::Curve;
use crate::displacement::{DisplacementFields, StoredFields};
use crate::error::{BodyError, Result};
use crate::gradient::Gradients;
use crate::model::{ContactModel, identity, sampled};
use crate::parallel;
use crate::potential::{CoupledLaw, Potential, Potentials};
use crate::response::{Response, Responses};
use crate::search::Search;
use crate::surface::{
    Elements, MAX_ELEMENTS, NO_TWIN, Surface, check_area, check_fans, check_normals, check_position,
};
use crate::tensor::{self, IDENTITY, Tensor};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// A node: where it is, which way in, and whose responses it blends.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Node {
    /// At rest, m.
    pub position: DVec3,
    /// Unit vector u^z into the body.
    pub inward: DVec3,
    /// Weights of the test points, ≥ 0. Their sum is 1, or less towards a border where the response fades out.
    pub weights: [f64; 3],
    /// Test points.
    pub test_points: [u32; 3],
    padding: u32,
}

impl Node {
    pub(crate) fn new(position: DVec3, inward: DVec3, blend: &BlendWeights) -> Self {
        Node { position, inward, weights: blend.weights, test_points: blend.test_points, padding: 0 }
    }
}

/// Whose responses a node blends (MODEL 1: area interpolation between test points, the paper's Fig. 7).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlendWeights {
    /// Up to three test points; unused ones repeat another with weight 0.
    pub test_points: [u32; 3],
    /// Weights ≥ 0 with sum 1 (0 to 1 at a fading border).
    pub weights: [f64; 3],
}

impl BlendWeights {
    /// A node that is itself test point `t`.
    pub fn own(t: u32) -> Self {
        BlendWeights { test_points: [t; 3], weights: [1.0, 0.0, 0.0] }
    }
}

/// The slip rule a body asks for (MODEL 4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum SlipRule {
    /// The seed paper's section 3.2: slip while f_r exceeds the friction limit, along the projection of u_r.
    Paper,
    /// The default: the paper's rule with the energy's gradient along the surface (E3): as continuous as the paper's, and generates
    /// energy only of the second order in the size of the elements.
    #[default]
    Consistent,
    /// Down the energy's own slope (E2): generates none, and clicks where facets meet.
    Exact,
}

impl SlipRule {
    /// All there are.
    pub const ALL: [SlipRule; 3] = [SlipRule::Paper, SlipRule::Consistent, SlipRule::Exact];

    /// As files and options name it.
    pub fn name(self) -> &'static str {
        match self {
            SlipRule::Paper => "paper",
            SlipRule::Consistent => "consistent",
            SlipRule::Exact => "exact",
        }
    }
}

/// The tool that a body's responses were found for. Of a sphere a pose gives the centre, of all others the tip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ToolRecord", into = "ToolRecord")]
#[non_exhaustive]
pub enum Tool {
    /// A tip without extent.
    Point,
    /// A sphere.
    Sphere {
        /// Its radius, m.
        radius_m: f64,
    },
    /// A cylinder's flat end.
    FlatPunch,
    /// A cone.
    Cone,
    /// A capsule, by its end.
    Capsule,
    /// A shape of triangles.
    Mesh,
}

/// A [`Tool`] in a body's file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ToolRecord {
    shape: String,
    radius_m: f64,
}

impl From<Tool> for ToolRecord {
    fn from(tool: Tool) -> Self {
        ToolRecord { shape: tool.name().into(), radius_m: tool.radius_m() }
    }
}

impl TryFrom<ToolRecord> for Tool {
    type Error = String;

    fn try_from(record: ToolRecord) -> std::result::Result<Self, String> {
        // Bodies were once written with any name for a tool with a tip, and with a radius for a sphere alone.
        let named = Tool::TIPS.into_iter().find(|tool| tool.name() == record.shape);
        match (named, record.radius_m) {
            (Some(tool), 0.0) => Ok(tool),
            (None, radius_m) if record.shape == "sphere" => Ok(Tool::Sphere { radius_m }),
            (Some(tool), radius) => Err(format!("a {} has no radius, and {radius} m is given", tool.name())),
            (None, _) => Err(format!("`{}` is no tool", record.shape)),
        }
    }
}

impl Tool {
    /// Those whose reference point is their tip.
    const TIPS: [Tool; 5] = [Tool::Point, Tool::FlatPunch, Tool::Cone, Tool::Capsule, Tool::Mesh];

    /// As files and options name it.
    pub fn name(&self) -> &'static str {
        match self {
            Tool::Point => "point",
            Tool::Sphere { .. } => "sphere",
            Tool::FlatPunch => "flat-punch",
            Tool::Cone => "cone",
            Tool::Capsule => "capsule",
            Tool::Mesh => "mesh",
        }
    }

    /// Radius of the sphere whose centre is the reference point, m; 0 for a tool whose tip is the reference point.
    #[inline]
    pub fn radius_m(&self) -> f64 {
        match self {
            Tool::Sphere { radius_m } => *radius_m,
            _ => 0.0,
        }
    }

    pub(crate) fn check(&self) -> Result<()> {
        if (0.0..=1.0).contains(&self.radius_m()) {
            return Ok(());
        }
        let problem = format!("its radius is {} m", self.radius_m());
        Err(BodyError::invalid("tool", problem, "give a radius between 0 and 1 m"))
    }
}

/// How far a test point's responses are from the load paths they were made from: largest differences.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PointErrors {
    /// Of the paths, N.
    pub largest_force_n: f64,
    /// How deep the tool was pressed in, m.
    pub depth_reached_m: f64,
    /// Of the normal force while pressing, N.
    pub normal_n: f64,
    /// Of the normal force while dragging, N: responses know it by the depth only.
    pub normal_dragged_n: f64,
    /// Lateral force while pressing, N, of which responses know nothing.
    pub lateral_pressed_n: f64,
    /// Of the lateral force while dragging, N, with its direction.
    pub lateral_n: f64,
    /// The same with a response that is alike in all directions, N.
    pub lateral_isotropic_n: f64,
}

/// How far a test point's potential is from the states that it was made from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PotentialErrors {
    /// The node that was pressed at.
    pub node: u32,
    /// Of the states, N.
    pub largest_force_n: f64,
    /// How deep the tool was pressed in, m.
    pub depth_reached_m: f64,
    /// Whether the tool was dragged there; if not, the terms of third and fourth order are those of places around.
    pub dragged: bool,
    /// Of states that friction holds: |f_t| ≤ μ f_z.
    pub held: StateErrors,
    /// Of states with |f_t| ≤ f_z.
    pub within: StateErrors,
    /// Of all states.
    pub all: StateErrors,
    /// What the press's forces gain from state to state less what the stuck tangents say, in parts of the gain, root mean
    /// square: 0 if both are one potential's (Betti).
    pub reciprocity_pressed: f64,
    /// What the potential misses of the change that drags make to the normal force, in parts of that change, root mean square.
    pub reciprocity_dragged: f64,
}

/// Differences over some states, in % of each state's force and 5 % of the largest: median and 95th percentile.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct StateErrors {
    /// How many states there are; without any, all else is 0.
    pub states: u32,
    /// Of the normal force.
    pub normal_percent: [f64; 2],
    /// Of the lateral force, a vector.
    pub lateral_percent: [f64; 2],
}

impl StateErrors {
    /// Of each state's [normal, lateral] error, %.
    pub fn new(states: impl Iterator<Item = [f64; 2]>) -> Self {
        let all: Vec<[f64; 2]> = states.collect();
        let of = |which: usize| {
            let mut sorted: Vec<f64> = all.iter().map(|e| e[which]).collect();
            sorted.sort_by(f64::total_cmp);
            let last = sorted.len().saturating_sub(1);
            [0.5, 0.95].map(|part| sorted.get((part * last as f64).round() as usize).copied().unwrap_or(0.0))
        };
        StateErrors { states: all.len() as u32, normal_percent: of(0), lateral_percent: of(1) }
    }
}

/// What is lost between the places that were simulated. Errors are root mean squares over the states with |f_t| ≤ f_z of a place,
/// in % of its largest force: of the force that the others' potentials make there.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct InterpolationErrors {
    /// Of places left out one at a time, for each way to interpolate.
    pub left_out: Vec<LeftOut>,
    /// Of the places that are not among so many of them, ascending.
    pub by_count: Vec<CountErrors>,
}

/// Errors of places that were left out, one at a time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LeftOut {
    /// What was made alike before potentials were blended: `none`, `stiffness` or `compliance` at rest, or `deep-press`, what a
    /// press at the place itself would gain.
    pub normalisation: String,
    /// Whether the body's potentials are interpolated so.
    pub used: bool,
    /// Places that were left out.
    pub places: u32,
    /// Half of them err no more.
    pub median_percent: f64,
    /// One in twenty errs more.
    pub p95_percent: f64,
    /// Over them.
    pub mean_percent: f64,
}

/// Errors with so many test points.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CountErrors {
    /// How many.
    pub test_points: u32,
    /// Other places, whose states they predict.
    pub places: u32,
    /// Half of them err no more.
    pub median_percent: f64,
    /// One in twenty errs more.
    pub p95_percent: f64,
}

/// Where a body came from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Provenance {
    /// The command line.
    pub command: String,
    /// Name and version of the program.
    pub software: String,
    /// The spec's text, if there was one.
    pub spec: Option<String>,
    /// SHA-256 of each input file, by name.
    pub inputs: BTreeMap<String, String>,
    /// What was repaired or assumed on the way.
    pub notes: Vec<String>,
    /// One for each test point, where curves come from simulated load paths.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub point_errors: Vec<PointErrors>,
    /// One for each place that was simulated, where potentials come from simulated load paths.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub potential_errors: Vec<PotentialErrors>,
    /// Between them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interpolation: Option<InterpolationErrors>,
}

/// What a body is made of.
#[derive(Debug, Clone)]
pub struct BodyParts {
    /// Geometry and frames.
    pub surface: Surface,
    /// One for each node.
    pub blends: Vec<BlendWeights>,
    /// One for each test point, all on shared knots; none with a coupled law.
    pub responses: Vec<Response>,
    /// The node each test point sits on.
    pub test_point_nodes: Vec<u32>,
    /// In place of responses and lateral tensors: the coupled law, one potential for each test point.
    pub coupled: Option<CoupledLaw>,
    /// One for each node, as [`tensor::from_stiffness`] makes them; `None` where the lateral response is alike in all
    /// directions.
    pub lateral_tensors: Option<Vec<Tensor>>,
    /// The tool the responses hold for.
    pub tool: Tool,
    /// The slip rule.
    pub slip: SlipRule,
    /// Whether contacts have the tank that keeps slip from giving out energy.
    pub tank: bool,
    /// Whether contacts are two contact points side by side, one with more, one with less friction, as partial slip wants it.
    pub partial_slip: bool,
    /// Where it all came from.
    pub provenance: Provenance,
}

/// A deformable body at rest: its [`ContactModel`], which it stands for wherever one is asked for, and what only files,
/// figures and tools need besides. Immutable, shared by every contact on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    pub(crate) model: ContactModel,
    pub(crate) vertices: Vec<u32>,
    pub(crate) curves: Vec<Response>,
    pub(crate) coupled: Option<CoupledLaw>,
    pub(crate) test_point_nodes: Vec<u32>,
    pub(crate) provenance: Provenance,
    /// How the surface moves, which no step reads.
    pub(crate) displacements: Option<StoredFields>,
}

impl std::ops::Deref for Body {
    type Target = ContactModel;

    #[inline]
    fn deref(&self) -> &ContactModel {
        &self.model
    }
}

impl Body {
    /// Checks the parts against each other and lays them out for the step.
    ///
    /// # Errors
    /// Anything that [`Node`], [`Element`](crate::Element) or [`Response`] promise and a part does not keep; the place names it.
    pub fn new(parts: BodyParts) -> Result<Self> {
        let BodyParts {
            surface,
            blends,
            responses,
            test_point_nodes,
            coupled,
            lateral_tensors,
            tool,
            slip,
            tank,
            partial_slip,
            provenance,
        } = parts;
        let points = coupled.as_ref().map_or(responses.len(), CoupledLaw::len);
        let elements = surface.elements.as_slice();
        check_surface(&surface.positions, &surface.inward, &surface.vertices, elements)?;
        if blends.len() != surface.positions.len() {
            return Err(BodyError::invalid(
                "nodes",
                format!("{} blends for {} nodes", blends.len(), surface.positions.len()),
                "give one for each",
            ));
        }
        let fades = border_nodes(surface.positions.len(), elements);
        for (n, (blend, &fades)) in blends.iter().zip(&fades).enumerate() {
            check_mix(n, blend, points, fades)?;
        }
        check_test_points(&test_point_nodes, points, blends.len())?;
        tool.check()?;
        let lateral_tensors = checked_tensors(lateral_tensors, &surface.inward)?;
        let (table, potentials) = match &coupled {
            None => (Responses::new(&responses)?, Potentials::default()),
            Some(law) => {
                if !(responses.is_empty() && lateral_tensors.is_empty()) {
                    let problem = "there are responses or lateral tensors beside a coupled law";
                    return Err(BodyError::invalid("law", problem, "give one kind of law"));
                }
                let at: Vec<DVec3> = test_point_nodes.iter().map(|&n| surface.inward[n as usize]).collect();
                law.check(&at, tool.radius_m())?;
                let (knots, potentials) = Potentials::new(law)?;
                (Responses::knots_alone(knots, law.range_m)?, potentials)
            }
        };
        let node = |n: usize| Node::new(surface.positions[n], surface.inward[n], &blends[n]);
        let nodes = parallel::collect(blends.len(), node);
        let mut search = Search::build(&surface.positions, elements.len(), |e| elements[e].nodes);
        search.refine(|e| elements[e as usize].nodes.map(|n| surface.positions[n as usize]));
        let which = sampled(points);
        let chosen = which.iter().filter_map(|&t| responses.get(t as usize)).flat_map(Response::curves);
        let law = coupled.as_ref().map_or(&[][..], |law| &law.potentials);
        let potentials_chosen = which.iter().filter_map(|&t| law.get(t as usize)).flat_map(Potential::curves);
        let curves = chosen.chain(potentials_chosen);
        let sizes = [elements.len(), points];
        let curvatures = which.iter().filter_map(|&t| law.get(t as usize)).map(|p| p.curvature);
        let identity = identity(&surface.positions, &surface.inward, sizes, &tool, curves, curvatures);
        let model = ContactModel {
            nodes,
            elements: surface.elements,
            search,
            responses: table,
            potentials,
            creased: creased(&surface.vertices),
            lateral_tensors,
            tool,
            slip,
            tank,
            partial_slip,
            identity,
            gradients: OnceLock::new(),
        };
        Ok(Body {
            model,
            vertices: surface.vertices,
            curves: responses,
            coupled,
            test_point_nodes,
            provenance,
            displacements: None,
        })
    }

    /// The same with these displacement fields, or without any.
    ///
    /// # Errors
    /// Fields for another number of test points.
    pub fn with_displacement_fields(mut self, fields: Option<DisplacementFields>) -> Result<Self> {
        if let Some(fields) = &fields {
            fields.check_blends(self.test_point_nodes.len())?;
        }
        self.displacements = fields.map(StoredFields::in_memory);
        Ok(self)
    }

    /// The displacement fields, if it has any. Of a body that was opened they are read from its file at the first call.
    ///
    /// # Errors
    /// The file can't be read any more, or its fields are damaged.
    pub fn displacement_fields(&self) -> Result<Option<&DisplacementFields>> {
        self.displacements.as_ref().map(StoredFields::get).transpose()
    }

    /// The same with the tank that keeps slip from giving out energy, or without.
    pub fn with_tank(mut self, tank: bool) -> Self {
        self.model.tank = tank;
        self
    }

    /// The same with two contact points side by side, or with one: see [`BodyParts::partial_slip`].
    pub fn with_partial_slip(mut self, partial_slip: bool) -> Self {
        self.model.partial_slip = partial_slip;
        self
    }

    /// The same with another account of where it came from.
    pub fn with_provenance(mut self, provenance: Provenance) -> Self {
        self.provenance = provenance;
        self
    }

    /// A body that answers alike everywhere, to a point, with the default slip rule: to begin with, and for tests.
    ///
    /// ```
    /// # use palpate_body::{Body, Response, shape::Shape};
    /// let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default())?;
    /// // 100·600 N/m² times the depth's square, a lateral stiffness that grows alike, friction 0.3, up to 8 mm.
    /// let body = Body::uniform(ball, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3)?)?;
    /// assert_eq!(body.test_point_nodes().len(), 1);
    /// # Ok::<(), palpate_body::BodyError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Body::new`].
    pub fn uniform(surface: Surface, response: Response) -> Result<Self> {
        Body::new(BodyParts {
            blends: vec![BlendWeights::own(0); surface.positions().len()],
            surface,
            responses: vec![response],
            test_point_nodes: vec![0],
            coupled: None,
            lateral_tensors: None,
            tool: Tool::Point,
            slip: SlipRule::default(),
            tank: true,
            partial_slip: false,
            provenance: Provenance::default(),
        })
    }

    /// Derives what contacts with this slip rule read besides, unless that was done before: for
    /// [`SlipRule::Consistent`] the nodal gradients ([`ContactModel::gradients`]). It takes memory, and about a second for
    /// 5 million triangles.
    ///
    /// A contact made on a body calls it; call it yourself where that would come at the wrong time.
    pub fn prepare(&self, rule: SlipRule) {
        if rule == SlipRule::Consistent {
            self.prepared_gradients();
        }
    }

    /// [`ContactModel::gradients`], derived if they were not yet.
    pub fn prepared_gradients(&self) -> &Gradients {
        self.model.gradients.get_or_init(|| Gradients::new(&self.model, &self.curves))
    }

    /// What it is made of, as [`Body::new`] takes it: to make another body that differs in some of it. Displacement fields are not
    /// among it ([`Body::with_displacement_fields`]).
    pub fn parts(&self) -> BodyParts {
        BodyParts {
            surface: Surface {
                positions: self.nodes.iter().map(|n| n.position).collect(),
                inward: self.nodes.iter().map(|n| n.inward).collect(),
                elements: self.elements.clone(),
                vertices: self.vertices.clone(),
                smoothed: 0,
            },
            blends: self
                .nodes
                .iter()
                .map(|n| BlendWeights { test_points: n.test_points, weights: n.weights })
                .collect(),
            responses: self.curves.clone(),
            test_point_nodes: self.test_point_nodes.clone(),
            coupled: self.coupled.clone(),
            lateral_tensors: self.lateral_tensors().map(<[Tensor]>::to_vec),
            tool: self.tool,
            slip: self.slip,
            tank: self.tank,
            partial_slip: self.partial_slip,
            provenance: self.provenance.clone(),
        }
    }

    /// The coupled law, if that is the body's.
    pub fn coupled_law(&self) -> Option<&CoupledLaw> {
        self.coupled.as_ref()
    }

    /// The potentials of its test points; none with a decoupled law.
    pub(crate) fn potential_list(&self) -> &[Potential] {
        self.coupled.as_ref().map_or(&[], |law| &law.potentials)
    }

    /// Curves of each test point; none with a coupled law.
    pub fn curves(&self) -> &[Response] {
        &self.curves
    }

    /// The node each test point sits on.
    pub fn test_point_nodes(&self) -> &[u32] {
        &self.test_point_nodes
    }

    /// Number of distinct vertices: nodes less those that creases doubled.
    pub fn vertex_count(&self) -> usize {
        self.vertices.iter().map(|&v| v as usize + 1).max().unwrap_or(0)
    }

    /// Where the body came from.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// The curves of one node: the blend of its test points'.
    ///
    /// # Errors
    /// No such node, or a coupled law.
    pub fn node_response(&self, node: usize) -> Result<Response> {
        let Some(n) = self.nodes.get(node) else {
            return Err(BodyError::invalid(
                format!("node {node}"),
                "there is no such node",
                "choose one in range",
            ));
        };
        if self.coupled.is_some() {
            let problem =
                "the body's law is a coupled potential, which has no curves of its own for each direction";
            return Err(BodyError::invalid(format!("node {node}"), problem, "ask for its coupled law"));
        }
        let blend = |curve: fn(&Response) -> &Curve| {
            let terms: Vec<_> = n
                .weights
                .iter()
                .zip(n.test_points)
                .map(|(&w, t)| (w, curve(&self.curves[t as usize])))
                .collect();
            Curve::blend(&terms)
        };
        Ok(Response {
            normal: blend(|r| &r.normal)?,
            lateral: blend(|r| &r.lateral)?,
            friction: blend(|r| &r.friction)?,
        })
    }
}

/// The blend of three nodes' inward normals, of unit length.
#[inline]
pub(crate) fn mixed_inward(inward: [DVec3; 3], n: [f64; 3]) -> DVec3 {
    inward.into_iter().zip(n).map(|(u, n)| u * n).sum::<DVec3>().normalize_or_zero()
}

/// Elements around a vertex that are looked at; real meshes have 3 to 20.
pub const MAX_FAN: usize = 256;

pub(crate) const NO_NODE: Node =
    Node { position: DVec3::ZERO, inward: DVec3::Z, weights: [0.0; 3], test_points: [0; 3], padding: 0 };

/// Whether creases doubled any node: nodes are vertices without them.
pub(crate) fn creased(vertices: &[u32]) -> bool {
    vertices.iter().enumerate().any(|(n, &v)| n != v as usize)
}

/// What [`Surface::build`] promises, checked again for surfaces that come from a file.
pub(crate) fn check_surface(
    positions: &[DVec3],
    inward: &[DVec3],
    vertices: &[u32],
    elements: impl Elements,
) -> Result<()> {
    let bad = |place: String, problem: &str| Err(BodyError::invalid(place, problem, "make the body again"));
    let count = elements.count();
    if count == 0 || count > MAX_ELEMENTS || vertices.len() != positions.len() {
        return bad("surface".into(), "it has no elements, too many, or nodes without a vertex");
    }
    if let Some(n) = vertices.iter().position(|&v| v as usize >= positions.len()) {
        return bad(format!("node {n}"), "it names a vertex that does not exist");
    }
    parallel::check(positions.len(), |n| check_position("node", n, positions[n]))?;
    parallel::check(count, |t| {
        let element = elements.element(t);
        if element.nodes.iter().any(|&n| n as usize >= positions.len()) {
            return bad(format!("element {t}"), "it names a node that does not exist");
        }
        check_area(t, element.nodes.map(|n| positions[n as usize]))
    })?;
    parallel::check(count, |t| {
        let element = elements.element(t);
        for i in 0..3 {
            let twin = element.twins[i];
            if twin == NO_TWIN {
                continue;
            }
            let (other, j) = (twin as usize / 3, twin as usize % 3);
            if other >= count {
                return bad(format!("element {t}"), "it names a neighbour that does not exist");
            }
            let neighbour = elements.element(other);
            let here = |k: usize| positions[element.nodes[(i + k) % 3] as usize];
            let there = |k: usize| positions[neighbour.nodes[(j + k) % 3] as usize];
            if neighbour.twins[j] as usize != 3 * t + i
                || here(0) != there(1)
                || here(1) != there(0)
                || other == t
            {
                return bad(format!("element {t}"), "it and its neighbour do not agree on their shared edge");
            }
        }
        Ok(())
    })?;
    // By vertices: at a crease several nodes share a fan.
    check_fans(positions, elements.all().map(|e| e.nodes.map(|n| vertices[n as usize])))?;
    check_normals(inward, positions, elements)
}

/// The tensors, each checked against its node's normal; none where all are exactly the identity, so that such a body
/// is the same as one without.
fn checked_tensors(tensors: Option<Vec<Tensor>>, inward: &[DVec3]) -> Result<Vec<Tensor>> {
    let tensors = tensors.unwrap_or_default();
    if tensors.iter().all(|a| *a == IDENTITY) && (tensors.is_empty() || tensors.len() == inward.len()) {
        return Ok(Vec::new());
    }
    if tensors.len() != inward.len() {
        let problem = format!("{} of them for {} nodes", tensors.len(), inward.len());
        return Err(BodyError::invalid("lateral tensors", problem, "give one for each node, or none at all"));
    }
    check_tensors(&tensors, inward)?;
    Ok(tensors)
}

/// What the nodes promise of their tensors.
pub(crate) fn check_tensors(tensors: &[Tensor], inward: &[DVec3]) -> Result<()> {
    for (n, (a, u)) in tensors.iter().zip(inward).enumerate() {
        tensor::check(a, *u)
            .map_err(|(problem, hint)| BodyError::invalid(format!("node {n}"), problem, hint))?;
    }
    Ok(())
}

/// What node `n` promises of its blend of so many test points; less than all of them only where it `fades` at a border.
pub(crate) fn check_mix(n: usize, blend: &BlendWeights, test_points: usize, fades: bool) -> Result<()> {
    let bad = |problem: String| Err(BodyError::invalid(format!("node {n}"), problem, "make the body again"));
    if blend.test_points.iter().any(|&t| t as usize >= test_points) {
        return bad("it names a test point that does not exist".into());
    }
    let sum: f64 = blend.weights.iter().sum();
    let least = if fades { 0.0 } else { 1.0 - 1e-9 };
    if !(blend.weights.iter().all(|&w| w >= 0.0) && sum >= least && sum <= 1.0 + 1e-9) {
        return bad(format!("its weights {:?} are negative or do not sum to 1", blend.weights));
    }
    Ok(())
}

/// Each test point sits on a node.
pub(crate) fn check_test_points(at: &[u32], test_points: usize, nodes: usize) -> Result<()> {
    if at.len() == test_points && at.iter().all(|&n| (n as usize) < nodes) {
        return Ok(());
    }
    let problem = "they do not match the responses and nodes";
    Err(BodyError::invalid("test points", problem, "make the body again"))
}

/// Whether each node lies on a border.
pub(crate) fn border_nodes(nodes: usize, elements: impl Elements) -> Vec<bool> {
    let mut border = vec![false; nodes];
    for (e, i) in elements.border() {
        let nodes = elements.element(e).nodes;
        border[nodes[i] as usize] = true;
        border[nodes[(i + 1) % 3] as usize] = true;
    }
    border
}

/// Brings curves onto the union of their knots, exactly: what [`Responses`] asks for.
///
/// # Errors
/// More than [`crate::curve::MAX_KNOTS`] different deflections.
pub fn share_knots(responses: Vec<Response>) -> Result<Vec<Response>> {
    let union = |curves: &mut dyn Iterator<Item = &Curve>| {
        let mut knots: Vec<f64> = curves.flat_map(|c| c.knots().iter().copied()).collect();
        knots.sort_by(f64::total_cmp);
        knots.dedup();
        knots
    };
    let depth = union(&mut responses.iter().flat_map(|r| [&r.normal, &r.friction]));
    let lateral = union(&mut responses.iter().map(|r| &r.lateral));
    responses
        .into_iter()
        .map(|r| {
            Ok(Response {
                normal: r.normal.on_knots(&depth)?,
                friction: r.friction.on_knots(&depth)?,
                lateral: r.lateral.on_knots(&lateral)?,
            })
        })
        .collect()
}
