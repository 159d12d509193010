//! Displacement fields of places that were pressed: quantised, and only where something moves.

use super::geometry::FieldSurface;
use crate::body::BlendWeights;
use crate::error::{BodyError, Result};
use glam::DVec3;
use safetensors::Dtype::{self, F64, I16, U32};

/// Displacements below this share of the depth are left out; between it and twice as much they fade.
const LEAST_SHARE: f64 = 0.005;
/// A middle that is nearer than this share of the depth to what its edge's ends make is left out.
const MIDDLE_SHARE: f64 = 0.003;
/// Steps from 0 to a state's largest component.
const LEVELS: f64 = 32767.0;

/// A place's fields, as a simulation found them.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaceField<'a> {
    /// That was pressed, m.
    pub point: DVec3,
    /// Unit vector u^z into the body.
    pub inward: DVec3,
    /// Unit vector at right angles to it: the first lateral direction; the second is `inward` × this.
    pub tangent: DVec3,
    /// Depths, ascending, m, and there for each component (one of a press, two of lateral motion) the vectors of all nodes of
    /// the [`FieldSurface`]: m, or m per m of lateral motion.
    pub states: Vec<(f64, Vec<&'a [[f32; 3]]>)>,
}

/// Fields of several places, and who blends them.
///
/// A place lists the nodes that move by more than half a per cent of the depth in one of its states; all others are at rest,
/// but for middles of edges: one that is not listed lies halfway between the edge's ends.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FieldSet {
    /// (places), m.
    pub(super) points: Vec<DVec3>,
    /// (places × 2): inward normal and tangent.
    pub(super) axes: Vec<[DVec3; 2]>,
    /// (test points): whose fields each blends.
    pub(super) blends: Vec<BlendWeights>,
    /// (states), m, place by place, ascending in each.
    pub(super) depths: Vec<f64>,
    /// (states): what a step is, m, or m per m.
    pub(super) units: Vec<f64>,
    /// (places): how many nodes and states each has.
    pub(super) node_counts: Vec<u32>,
    pub(super) state_counts: Vec<u32>,
    /// Nodes of the field surface, place by place.
    pub(super) nodes: Vec<u32>,
    /// Place by place, state by state, component by component: x, y, z of each listed node.
    pub(super) steps: Vec<[i16; 3]>,
    /// Where each place's nodes, states and steps begin.
    first: Vec<[usize; 3]>,
}

impl FieldSet {
    /// Adds a place, kept as small as that goes.
    ///
    /// # Errors
    /// No states, depths that do not ascend from above 0, fields of other lengths than the surface's, or what is not finite.
    pub fn push(&mut self, surface: &FieldSurface, place: &PlaceField<'_>, lateral: bool) -> Result<()> {
        let count = surface.positions().len();
        let components = if lateral { 2 } else { 1 };
        let bad = |problem: &str| {
            let at = format!("displacement field {}", self.points.len());
            Err(BodyError::invalid(at, problem, "make the body again"))
        };
        if place.states.is_empty()
            || place.states.iter().any(|(_, fields)| fields.len() != components)
            || place.states.iter().flat_map(|(_, fields)| fields).any(|field| field.len() != count)
        {
            return bad("it has no states, or not a vector for each node");
        }
        if !place.states.iter().flat_map(|(_, f)| f).flat_map(|f| f.iter().flatten()).all(|x| x.is_finite()) {
            return bad("a displacement is not finite");
        }
        let at = [self.nodes.len(), self.depths.len(), self.steps.len()];
        // What leaves a share out fades first, so that no step is left at the rim.
        let faded: Vec<(f64, Vec<Vec<DVec3>>)> = place
            .states
            .iter()
            .map(|(depth, fields)| {
                let whole = if lateral { 1.0 } else { *depth };
                let fade = |v: &[f32; 3]| {
                    let v = DVec3::from_array(v.map(f64::from));
                    v * smoothstep(v.length() / whole / LEAST_SHARE - 1.0)
                };
                (whole, fields.iter().map(|f| f.iter().map(fade).collect()).collect())
            })
            .collect();
        let any = |holds: &dyn Fn(&[DVec3], f64) -> bool| {
            faded.iter().any(|(whole, fields)| fields.iter().any(|field| holds(field, *whole)))
        };
        let ends = surface.ends();
        let mut listed: Vec<bool> = vec![false; count];
        for n in 0..count {
            listed[n] = ends[n][0] as usize == n && any(&|field, _| field[n] != DVec3::ZERO);
        }
        for n in 0..count {
            let [a, b] = ends[n].map(|n| n as usize);
            let middle = |field: &[DVec3]| (field[a] + field[b]) * 0.5;
            listed[n] |=
                a != n && any(&|field, whole| field[n].distance(middle(field)) > MIDDLE_SHARE * whole);
        }
        let nodes: Vec<u32> = (0..count as u32).filter(|&n| listed[n as usize]).collect();
        for ((depth, _), (_, fields)) in place.states.iter().zip(&faded) {
            let chosen = || fields.iter().flat_map(|field| nodes.iter().map(|&n| field[n as usize]));
            let largest = chosen().map(|v| v.abs().max_element()).fold(0.0, f64::max);
            let unit = largest / LEVELS;
            let step = |c: f64| if unit > 0.0 { (c / unit).round() as i16 } else { 0 };
            self.steps.extend(chosen().map(|v| v.to_array().map(step)));
            self.depths.push(*depth);
            self.units.push(unit);
        }
        self.points.push(place.point);
        self.axes.push([place.inward, place.tangent]);
        self.node_counts.push(nodes.len() as u32);
        self.state_counts.push(place.states.len() as u32);
        self.nodes.extend(nodes);
        self.index_place(at, count, lateral)?;
        Ok(())
    }

    /// The same, blended so by the body's test points.
    pub fn with_blends(self, blends: Vec<BlendWeights>) -> Self {
        FieldSet { blends, ..self }
    }

    /// How many places there are.
    pub fn places(&self) -> usize {
        self.points.len()
    }

    /// Where they are, m.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// The greatest depth of a place's fields, m; 0 for one that is not there.
    pub fn deepest_m(&self, place: usize) -> f64 {
        self.states(place).map_or(0.0, |range| self.depths[range.end - 1])
    }

    /// The least depth of a place's fields, m; infinite for one that is not there.
    pub(super) fn least_m(&self, place: usize) -> f64 {
        self.states(place).map_or(f64::INFINITY, |range| self.depths[range.start])
    }

    /// What it takes, bytes.
    pub fn bytes(&self) -> usize {
        let blends = self.blends.len() * 36;
        self.points.len() * 80 + blends + self.depths.len() * 16 + self.nodes.len() * 4 + self.steps.len() * 6
    }

    fn states(&self, place: usize) -> Option<std::ops::Range<usize>> {
        let [_, first, _] = *self.first.get(place)?;
        Some(first..first + self.state_counts[place] as usize)
    }

    /// Checks all, and finds where each place begins.
    fn index(&mut self, surface_nodes: usize, lateral: bool) -> Result<()> {
        let places = self.points.len();
        let bad = |problem: &str| {
            Err(BodyError::invalid(format!("displacement field {places}"), problem, "make the body again"))
        };
        if [self.axes.len(), self.node_counts.len(), self.state_counts.len()] != [places; 3]
            || self.units.len() != self.depths.len()
        {
            return bad("places and their counts do not match");
        }
        self.first.clear();
        let mut at = [0; 3];
        for _ in 0..places {
            at = self.index_place(at, surface_nodes, lateral)?;
        }
        if at != [self.nodes.len(), self.depths.len(), self.steps.len()] {
            return bad("there are nodes, states or steps of no place");
        }
        Ok(())
    }

    /// Checks the first place that is not indexed yet, which begins at `at`, and gives where it ends.
    fn index_place(&mut self, at: [usize; 3], surface_nodes: usize, lateral: bool) -> Result<[usize; 3]> {
        let place = self.first.len();
        let components = if lateral { 2 } else { 1 };
        let bad = |problem: &str| {
            Err(BodyError::invalid(format!("displacement field {place}"), problem, "make the body again"))
        };
        let (nodes, states) = (self.node_counts[place] as usize, self.state_counts[place] as usize);
        let end = [
            at[0].saturating_add(nodes),
            at[1].saturating_add(states),
            at[2].saturating_add(nodes.saturating_mul(states).saturating_mul(components)),
        ];
        if end[0] > self.nodes.len() || end[1] > self.depths.len() || end[2] > self.steps.len() {
            return bad("its nodes, states or steps are missing");
        }
        let (depths, nodes) = (&self.depths[at[1]..end[1]], &self.nodes[at[0]..end[0]]);
        if !depths.first().is_some_and(|d| *d > 0.0) || !depths.windows(2).all(|d| d[0] < d[1]) {
            return bad("its depths do not ascend from above 0");
        }
        let are_lengths = self.units[at[1]..end[1]].iter().chain(depths).all(|d| (0.0..=1.0).contains(d));
        if !are_lengths {
            return bad("a depth or a unit is not finite, negative, or above 1 m");
        }
        if !nodes.windows(2).all(|n| n[0] < n[1])
            || nodes.last().is_some_and(|&n| n as usize >= surface_nodes)
        {
            return bad("its nodes do not ascend, or one does not exist");
        }
        let [u, t] = self.axes[place];
        let is_unit = |v: DVec3| (v.length() - 1.0).abs() < 1e-6;
        if !(is_unit(u) && is_unit(t) && u.dot(t).abs() < 1e-6 && self.points[place].is_finite()) {
            return bad("its axes are no unit vectors at right angles, or its point is not finite");
        }
        self.first.push(at);
        Ok(end)
    }

    /// Each test point blends places that are there, or there is no place at all.
    fn check_blends(&self, test_points: usize) -> Result<()> {
        let expected = if self.points.is_empty() { 0 } else { test_points };
        let is_blend = |b: &BlendWeights| {
            let sum: f64 = b.weights.iter().sum();
            b.test_points.iter().all(|&t| (t as usize) < self.points.len())
                && b.weights.iter().all(|&w| w >= 0.0)
                && (sum - 1.0).abs() <= 1e-9
        };
        if self.blends.len() == expected && self.blends.iter().all(is_blend) {
            return Ok(());
        }
        let problem = "test points do not each blend places that are there";
        Err(BodyError::invalid("displacement fields", problem, "make the body again"))
    }

    /// The field of `place` at `depth` (m), of all nodes of the surface into `field`: m. Of lateral fields that of a lateral motion
    /// by `lateral` (m) along the tangent and across it.
    ///
    /// Presses are interpolated as displacement over depth, linear in the depth's root: under a ball it is constant, far away it
    /// goes with the patch's radius, √(R δ).
    pub(super) fn expand(
        &self,
        surface: &FieldSurface,
        place: usize,
        depth: f64,
        lateral: Option<[f64; 2]>,
        field: &mut Vec<DVec3>,
    ) {
        field.clear();
        field.resize(surface.positions().len(), DVec3::ZERO);
        let (Some(states), Some([first_node, _, first_step])) = (self.states(place), self.first.get(place))
        else {
            return;
        };
        let depths = &self.depths[states.clone()];
        let upper = depths.partition_point(|d| *d <= depth).min(depths.len() - 1);
        let lower = upper.saturating_sub(1);
        let (low, high) = (depths[lower].sqrt(), depths[upper].sqrt());
        let t = if high > low { ((depth.max(0.0).sqrt() - low) / (high - low)).clamp(0.0, 1.0) } else { 1.0 };
        let count = self.node_counts[place] as usize;
        let nodes = &self.nodes[*first_node..first_node + count];
        let components = if lateral.is_some() { 2 } else { 1 };
        for (state, share) in [(lower, 1.0 - t), (upper, t)] {
            if share == 0.0 {
                continue;
            }
            let unit = self.units[states.start + state] * share;
            let scales = match lateral {
                None => [unit * depth / depths[state], 0.0],
                Some(by) => by.map(|by| by * unit),
            };
            for (component, scale) in scales.into_iter().take(components).enumerate() {
                let start = first_step + (state * components + component) * count;
                for (&n, step) in nodes.iter().zip(&self.steps[start..start + count]) {
                    field[n as usize] += DVec3::from_array(step.map(f64::from)) * scale;
                }
            }
        }
        // Middles that are not listed.
        let mut listed = nodes.iter().copied().peekable();
        for (n, &[a, b]) in surface.ends().iter().enumerate() {
            if listed.next_if_eq(&(n as u32)).is_none() && a as usize != n {
                field[n] = (field[a as usize] + field[b as usize]) * 0.5;
            }
        }
    }
}

/// 0 up to 0, 1 from 1 on, with slope 0 at both.
pub(super) fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The displacement fields of a body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DisplacementFields {
    surface: FieldSurface,
    press: FieldSet,
    lateral: FieldSet,
}

impl DisplacementFields {
    /// Of straight presses and of lateral motion, for a body with so many test points. `lateral` may be empty.
    ///
    /// # Errors
    /// No press, or blends that are not those of the test points.
    pub fn new(
        surface: FieldSurface,
        press: FieldSet,
        lateral: FieldSet,
        test_points: usize,
    ) -> Result<Self> {
        if press.places() == 0 {
            let problem = "there is no place that was pressed";
            return Err(BodyError::invalid("displacement fields", problem, "leave them out"));
        }
        let fields = DisplacementFields { surface, press, lateral };
        fields.check_blends(test_points)?;
        Ok(fields)
    }

    /// The greatest depth that a test point's fields were found at, m: the least of those places' whose it blends.
    pub fn deepest_m(&self, test_point: usize) -> f64 {
        let Some(blend) = self.press.blends.get(test_point) else { return 0.0 };
        let used = blend.test_points.iter().zip(blend.weights).filter(|(_, w)| *w > 0.0);
        used.map(|(&place, _)| self.press.deepest_m(place as usize)).fold(f64::INFINITY, f64::min)
    }

    /// Whether they are those of so many test points.
    pub(crate) fn check_blends(&self, test_points: usize) -> Result<()> {
        self.press.check_blends(test_points)?;
        self.lateral.check_blends(test_points)
    }

    /// What they are given on.
    pub fn surface(&self) -> &FieldSurface {
        &self.surface
    }

    /// Of straight presses, m.
    pub fn press(&self) -> &FieldSet {
        &self.press
    }

    /// Of lateral motion at a depth, per metre of it; perhaps of no place.
    pub fn lateral(&self) -> &FieldSet {
        &self.lateral
    }

    /// What they take in a file, bytes.
    pub fn bytes(&self) -> usize {
        let surface = self.surface.positions().len() * 24 + self.surface.faces().len() * 24;
        surface + self.press.bytes() + self.lateral.bytes()
    }

    /// How many there are of everything.
    pub(crate) fn sizes(&self) -> FieldSizes {
        let set = |s: &FieldSet| SetSizes {
            places: s.points.len(),
            blends: s.blends.len(),
            states: s.depths.len(),
            nodes: s.nodes.len(),
            steps: s.steps.len(),
        };
        FieldSizes {
            positions: self.surface.positions().len(),
            faces: self.surface.faces().len(),
            sets: [set(&self.press), set(&self.lateral)],
        }
    }

    /// From a file's tensors.
    ///
    /// # Errors
    /// What is wrong with them.
    pub(crate) fn from_tensors(
        test_points: usize,
        mut bytes: impl FnMut(&'static str) -> Result<Vec<u8>>,
    ) -> Result<Self> {
        fn rows<T: bytemuck::Pod>(bytes: &[u8]) -> Vec<T> {
            bytemuck::pod_collect_to_vec(bytes)
        }
        let surface = FieldSurface::new(rows(&bytes(POSITIONS)?), rows(&bytes(FACES)?))?;
        let mut set = |names: &[&'static str; 10], lateral: bool| -> Result<FieldSet> {
            let [points, axes, weights, depths, units, blended, node_counts, state_counts, nodes, steps] =
                names.map(&mut bytes);
            let weights = rows::<[f64; 3]>(&weights?);
            let blended = rows::<[u32; 3]>(&blended?);
            let blend = |(test_points, weights)| BlendWeights { test_points, weights };
            let mut set = FieldSet {
                points: rows(&points?),
                axes: rows::<[[f64; 3]; 2]>(&axes?).into_iter().map(|a| a.map(DVec3::from_array)).collect(),
                blends: blended.into_iter().zip(weights).map(blend).collect(),
                depths: rows(&depths?),
                units: rows(&units?),
                node_counts: rows(&node_counts?),
                state_counts: rows(&state_counts?),
                nodes: rows(&nodes?),
                steps: rows(&steps?),
                first: Vec::new(),
            };
            set.index(surface.positions().len(), lateral)?;
            Ok(set)
        };
        let (press, lateral) = (set(&SETS[0], false)?, set(&SETS[1], true)?);
        DisplacementFields::new(surface, press, lateral, test_points)
    }

    /// The bytes of a tensor of [`field_layout`].
    pub(crate) fn tensor(&self, name: &str) -> Option<Vec<u8>> {
        use bytemuck::cast_slice;
        match name {
            POSITIONS => return Some(cast_slice(self.surface.positions()).to_vec()),
            FACES => return Some(cast_slice(self.surface.faces()).to_vec()),
            _ => {}
        }
        let (names, set) = SETS.iter().zip([&self.press, &self.lateral]).find(|(n, _)| n.contains(&name))?;
        let which = names.iter().position(|n| *n == name)?;
        Some(match which {
            0 => cast_slice(&set.points).to_vec(),
            1 => set.axes.iter().flatten().flat_map(|v| bytemuck::bytes_of(v).to_vec()).collect(),
            2 => set.blends.iter().flat_map(|b| bytemuck::bytes_of(&b.weights).to_vec()).collect(),
            3 => cast_slice(&set.depths).to_vec(),
            4 => cast_slice(&set.units).to_vec(),
            5 => set.blends.iter().flat_map(|b| bytemuck::bytes_of(&b.test_points).to_vec()).collect(),
            6 => cast_slice(&set.node_counts).to_vec(),
            7 => cast_slice(&set.state_counts).to_vec(),
            8 => cast_slice(&set.nodes).to_vec(),
            _ => cast_slice(&set.steps).to_vec(),
        })
    }
}

const POSITIONS: &str = "field_positions";
const FACES: &str = "field_faces";

/// Tensors of the two sets.
const SETS: [[&str; 10]; 2] = [
    [
        "press_field_points",
        "press_field_axes",
        "press_field_weights",
        "press_field_depths_m",
        "press_field_units_m",
        "press_field_places",
        "press_field_node_counts",
        "press_field_state_counts",
        "press_field_nodes",
        "press_field_steps",
    ],
    [
        "lateral_field_points",
        "lateral_field_axes",
        "lateral_field_weights",
        "lateral_field_depths_m",
        "lateral_field_units",
        "lateral_field_places",
        "lateral_field_node_counts",
        "lateral_field_state_counts",
        "lateral_field_nodes",
        "lateral_field_steps",
    ],
];

/// How many there are of a set's things.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct SetSizes {
    places: usize,
    blends: usize,
    states: usize,
    nodes: usize,
    steps: usize,
}

/// How many there are of everything in fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct FieldSizes {
    positions: usize,
    faces: usize,
    sets: [SetSizes; 2],
}

impl FieldSizes {
    /// As a file's header has them: `count` gives a tensor's rows, if it is there.
    pub fn of(count: impl Fn(&str) -> Option<usize>) -> Option<Self> {
        let rows = |name: &str| count(name).unwrap_or(0);
        let set = |names: &[&str; 10]| SetSizes {
            places: rows(names[0]),
            blends: rows(names[2]),
            states: rows(names[3]),
            nodes: rows(names[8]),
            steps: rows(names[9]),
        };
        Some(FieldSizes {
            positions: count(POSITIONS)?,
            faces: rows(FACES),
            sets: [set(&SETS[0]), set(&SETS[1])],
        })
    }
}

/// The fields' tensors: doubles, 32-bit and 16-bit numbers.
pub(crate) fn field_layout(sizes: &FieldSizes) -> [Vec<(&'static str, Dtype, Vec<usize>)>; 3] {
    let mut wide = vec![(POSITIONS, F64, vec![sizes.positions, 3])];
    let mut numbers = vec![(FACES, U32, vec![sizes.faces, 6])];
    let mut narrow = Vec::new();
    for (names, s) in SETS.iter().zip(sizes.sets) {
        wide.extend([
            (names[0], F64, vec![s.places, 3]),
            (names[1], F64, vec![s.places, 2, 3]),
            (names[2], F64, vec![s.blends, 3]),
            (names[3], F64, vec![s.states]),
            (names[4], F64, vec![s.states]),
        ]);
        numbers.extend([
            (names[5], U32, vec![s.blends, 3]),
            (names[6], U32, vec![s.places]),
            (names[7], U32, vec![s.places]),
            (names[8], U32, vec![s.nodes]),
        ]);
        narrow.push((names[9], I16, vec![s.steps, 3]));
    }
    [wide, numbers, narrow]
}
