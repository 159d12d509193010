//! What is in a body: sizes, ranges of its curves, and the stiffness that a device must be able to hold.

use crate::plot::{Line, LineChart};
use crate::validate::{median, percentile};
use palpate_body::tensor::Principal;
use palpate_body::{Body, Curve, NO_TWIN, PointErrors, Provenance, Response, SlipRule};
use serde::Serialize;

/// What `palpate inspect --json` prints.
#[derive(Debug, Clone, Serialize)]
pub struct Inspection {
    /// Nodes.
    pub nodes: usize,
    /// Distinct vertices: nodes less those that creases doubled.
    pub vertices: usize,
    /// Elements.
    pub triangles: usize,
    /// Edges with one triangle only.
    pub border_edges: usize,
    /// Test points.
    pub test_points: usize,
    /// Slip rule.
    pub slip: SlipRule,
    /// Whether the lateral response depends on the direction.
    pub anisotropic: bool,
    /// Least and greatest over the nodes: how many times as stiff sideways the stiffest direction is as the softest.
    pub lateral_ratio: [f64; 2],
    /// Tools that responses are held for.
    pub tools: Vec<ToolEntry>,
    /// Least and greatest coordinates, m.
    pub bounding_box_m: [[f64; 3]; 2],
    /// Deflections of the depth knots, m.
    pub depth_knots_m: Vec<f64>,
    /// Deflections of the lateral knots, m.
    pub lateral_knots_m: Vec<f64>,
    /// Over the test points.
    pub ranges: Ranges,
    /// Stiffness of the contact in stick.
    pub stiffness_max_n_per_m: Vec<StiffnessAt>,
    /// How far the responses are from the load paths that they were made from; none for measured samples and laws.
    pub fit_errors: Option<FitErrors>,
    /// Where the body came from, with the errors of each test point.
    pub provenance: Provenance,
}

/// Largest differences at each test point between its responses and its load paths, over the test points.
#[derive(Debug, Clone, Serialize)]
pub struct FitErrors {
    /// Of the normal force while pressing.
    pub normal: Range,
    /// Of the normal force while dragging: responses know it by the depth only.
    pub normal_dragged: Range,
    /// Lateral force while pressing, of which responses know nothing.
    pub lateral_pressed: Range,
    /// Of the lateral force while dragging.
    pub lateral: Range,
    /// The same, were the responses alike in all directions.
    pub lateral_isotropic: Range,
}

/// Median, 95th percentile and worst over the test points.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Range {
    /// In % of the point's largest force.
    pub median_percent: f64,
    /// In % of the point's largest force.
    pub p95_percent: f64,
    /// In % of the point's largest force.
    pub worst_percent: f64,
    /// N.
    pub worst_n: f64,
}

fn fit_errors(points: &[PointErrors]) -> Option<FitErrors> {
    let range = |of: fn(&PointErrors) -> f64| {
        let pressed = points.iter().filter(|p| p.largest_force_n > 0.0);
        let mut percent: Vec<f64> = pressed.map(|p| 100.0 * of(p) / p.largest_force_n).collect();
        percent.sort_by(f64::total_cmp);
        Range {
            median_percent: median(&percent),
            p95_percent: percentile(&percent, 0.95),
            worst_percent: percentile(&percent, 1.0),
            worst_n: points.iter().map(of).fold(0.0, f64::max),
        }
    };
    (!points.is_empty()).then(|| FitErrors {
        normal: range(|p| p.normal_n),
        normal_dragged: range(|p| p.normal_dragged_n),
        lateral_pressed: range(|p| p.lateral_pressed_n),
        lateral: range(|p| p.lateral_n),
        lateral_isotropic: range(|p| p.lateral_isotropic_n),
    })
}

/// A tool.
#[derive(Debug, Clone, Serialize)]
pub struct ToolEntry {
    /// Its name.
    pub shape: String,
    /// m; 0 for a tip without extent.
    pub radius_m: f64,
}

/// Least and greatest of each over the test points.
#[derive(Debug, Clone, Serialize)]
pub struct Ranges {
    /// Normal force at the last knot, N.
    pub largest_normal_force_n: [f64; 2],
    /// Lateral force at the last knot, N.
    pub largest_lateral_force_n: [f64; 2],
    /// Slope of the normal force at the last knot, N/m.
    pub stiffness_at_full_depth_n_per_m: [f64; 2],
    /// Slope of the lateral force at 0, N/m.
    pub lateral_stiffness_n_per_m: [f64; 2],
    /// Friction coefficient at any knot.
    pub friction: [f64; 2],
}

/// K_max at a depth (MODEL 5): the greatest slope of any response up to there, f_z' or f_r'. Mixtures of responses
/// stay below it, and so does f_r/δr.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct StiffnessAt {
    /// δz, m.
    pub depth_m: f64,
    /// N/m.
    pub value: f64,
}

/// Looks through a body.
pub fn inspect(body: &Body) -> Inspection {
    let start = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    let bounding_box_m = body.nodes().iter().fold(start, |[mut low, mut high], node| {
        for (i, x) in node.position.to_array().into_iter().enumerate() {
            low[i] = low[i].min(x);
            high[i] = high[i].max(x);
        }
        [low, high]
    });
    let end = |c: &Curve| c.knots().last().copied().unwrap_or_default();
    let range = |value: &dyn Fn(&Response) -> [f64; 2]| {
        body.curves()
            .iter()
            .map(value)
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [a, b]| [low.min(a), high.max(b)])
    };
    let one =
        |value: fn(&Response, f64, f64) -> f64| range(&|r| [value(r, end(&r.normal), end(&r.lateral)); 2]);
    let tool = body.tool();
    Inspection {
        nodes: body.nodes().len(),
        vertices: body.vertex_count(),
        triangles: body.elements().len(),
        border_edges: body.elements().iter().flat_map(|e| e.twins).filter(|t| *t == NO_TWIN).count(),
        test_points: body.curves().len(),
        slip: body.slip(),
        anisotropic: !body.is_isotropic(),
        lateral_ratio: principals(body)
            .map(|p| p.ratio())
            .fold(None, |range: Option<[f64; 2]>, r| {
                Some(range.map_or([r; 2], |[low, high]| [low.min(r), high.max(r)]))
            })
            .unwrap_or([1.0; 2]),
        tools: vec![ToolEntry { shape: tool.name().into(), radius_m: tool.radius_m() }],
        bounding_box_m,
        depth_knots_m: body.responses().depth_knots().values().to_vec(),
        lateral_knots_m: body.responses().lateral_knots().values().to_vec(),
        ranges: Ranges {
            largest_normal_force_n: one(|r, depth, _| r.normal.value(depth)),
            largest_lateral_force_n: one(|r, _, lateral| r.lateral.value(lateral)),
            stiffness_at_full_depth_n_per_m: one(|r, depth, _| r.normal.slope(depth)),
            lateral_stiffness_n_per_m: one(|r, _, _| r.lateral.slope(0.0)),
            friction: range(&|r| {
                let values = r.friction.knots().iter().map(|k| r.friction.value(*k));
                values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
            }),
        },
        stiffness_max_n_per_m: stiffness_max(body),
        fit_errors: fit_errors(&body.provenance().point_errors),
        provenance: body.provenance().clone(),
    }
}

/// How each node's tensor acts sideways; none of an isotropic body's.
pub fn principals(body: &Body) -> impl Iterator<Item = Principal> + '_ {
    let tensors = body.lateral_tensors().unwrap_or_default();
    tensors.iter().zip(body.nodes()).map(|(a, node)| Principal::of(a, node.inward))
}

/// The greatest stiffnesses met so far.
#[derive(Debug, Default)]
pub struct Stiffest {
    /// Of the normal curves up to each depth knot, N/m.
    normal: Vec<f64>,
    /// Of the lateral curves, N/m.
    lateral: f64,
    /// How many times that the stiffest direction has; 0 where there are no tensors.
    ratio: f64,
}

impl Stiffest {
    fn of(body: &Body) -> Self {
        let mut stiffest = Stiffest::default();
        body.curves().iter().for_each(|r| stiffest.meet(r));
        principals(body).for_each(|p| stiffest.turn(&p));
        stiffest
    }

    /// Adds a test point.
    pub fn meet(&mut self, response: &Response) {
        let slopes = greatest_slopes(&response.normal);
        self.normal.resize(slopes.len(), 0.0);
        self.normal.iter_mut().zip(slopes).for_each(|(most, slope)| *most = most.max(slope));
        self.lateral = greatest_slopes(&response.lateral).into_iter().fold(self.lateral, f64::max);
    }

    /// Adds a node's directions. A mix of tensors has no eigenvalue above all of theirs.
    pub fn turn(&mut self, principal: &Principal) {
        self.ratio = self.ratio.max(principal.values[0]);
    }

    /// In stick, along the surface.
    pub fn aside(&self) -> f64 {
        self.lateral * self.ratio.max(1.0)
    }

    /// In stick, at any depth.
    pub fn anywhere(&self) -> f64 {
        self.normal.last().copied().unwrap_or_default().max(self.aside())
    }
}

/// The greatest lateral stiffness in stick, N/m.
pub fn stiffness_aside(body: &Body) -> f64 {
    Stiffest::of(body).aside()
}

/// K_max at each depth knot.
pub fn stiffness_max(body: &Body) -> Vec<StiffnessAt> {
    let stiffest = Stiffest::of(body);
    let aside = stiffest.aside();
    let depths = body.responses().depth_knots().values().iter();
    depths.zip(stiffest.normal).map(|(&depth_m, k)| StiffnessAt { depth_m, value: k.max(aside) }).collect()
}

/// The greatest slope from 0 up to each knot, to its right included.
fn greatest_slopes(curve: &Curve) -> Vec<f64> {
    let mut so_far = f64::NEG_INFINITY;
    let mut slopes = Vec::with_capacity(curve.knots().len());
    for (b, k) in curve.ordinates().iter().zip(curve.knots().windows(2)) {
        // The slope is the quadratic with Bernstein ordinates 3Δb/h: greatest at an end or its vertex.
        let d = [b[1] - b[0], b[2] - b[1], b[3] - b[2]].map(|d| 3.0 * d / (k[1] - k[0]));
        slopes.push(so_far.max(d[0]));
        let bend = d[0] - 2.0 * d[1] + d[2];
        let t = if bend < 0.0 { ((d[0] - d[1]) / bend).clamp(0.0, 1.0) } else { 0.0 };
        let vertex = d[0] * (1.0 - t) * (1.0 - t) + 2.0 * d[1] * t * (1.0 - t) + d[2] * t * t;
        so_far = so_far.max(d[0]).max(d[2]).max(vertex);
    }
    slopes.push(so_far);
    slopes
}

/// Lines in a picture that can still be told apart.
const LINES: usize = 12;

/// Charts of the normal, lateral and friction curves of up to twelve test points, spread over the stiffness range,
/// each with a name for its file.
pub fn charts(body: &Body) -> [(&'static str, LineChart); 3] {
    let reach = |c: &Curve| c.knots().last().copied().unwrap_or_default();
    let mut order: Vec<usize> = (0..body.curves().len()).collect();
    let force = |t: &usize| body.curves().get(*t).map_or(0.0, |r| r.normal.value(reach(&r.normal)));
    order.sort_by(|a, b| force(b).total_cmp(&force(a)));
    let last = order.len().saturating_sub(1);
    let count = order.len().min(LINES);
    let shown = (0..count).filter_map(|i| order.get(i * last / count.saturating_sub(1).max(1)));
    let shown: Vec<usize> = shown.copied().collect();
    let chart = |title: &str, x_label: &str, y_label: &str, curve: fn(&Response) -> &Curve| {
        let all_alike = body.curves().windows(2).all(|r| curve(&r[0]) == curve(&r[1]));
        let shown = if all_alike { shown.get(..1).unwrap_or_default() } else { &shown };
        let line = |&t: &usize| {
            let curve = curve(body.curves().get(t)?);
            let node = body.nodes().get(*body.test_point_nodes().get(t)? as usize)?;
            let [x, y, z] = (node.position * 1e3).to_array();
            let samples = (0..=200).map(|i| reach(curve) * f64::from(i) / 200.0);
            let name = if all_alike {
                format!("all {} test points", body.curves().len())
            } else {
                format!("{t} at ({x:.1}, {y:.1}, {z:.1}) mm")
            };
            Some(Line { name, points: samples.map(|d| (d * 1e3, curve.value(d))).collect() })
        };
        let title = if !all_alike && shown.len() < body.curves().len() {
            format!("{title}: {} of {} test points", shown.len(), body.curves().len())
        } else {
            title.to_owned()
        };
        LineChart {
            title,
            x_label: x_label.into(),
            y_label: y_label.into(),
            lines: shown.iter().filter_map(line).collect(),
            from_zero: true,
        }
    };
    let depth = "normal deflection (mm)";
    [
        ("normal.png", chart("Normal force", depth, "normal force (N)", |r| &r.normal)),
        (
            "lateral.png",
            chart("Lateral force", "lateral deflection (mm)", "lateral force (N)", |r| &r.lateral),
        ),
        ("friction.png", chart("Friction", depth, "friction coefficient", |r| &r.friction)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_body::{Extension, Interpolation};

    #[test]
    fn greatest_slopes_are_those_of_a_fine_sampling() {
        let knots = [0.0, 1e-3, 2.5e-3, 4e-3];
        let curve =
            Curve::through(&knots, &[0.0, 0.1, 0.9, 1.0], Interpolation::Pchip, Extension::Linear).unwrap();
        for (knot, greatest) in knots.iter().zip(greatest_slopes(&curve)) {
            let sampled = (0..=100_000).map(|i| curve.slope(knot * f64::from(i) / 1e5)).fold(0.0, f64::max);
            assert!((greatest - sampled).abs() < 1e-4 * sampled.max(1.0), "{greatest} {sampled}");
        }
    }
}
