//! What is in a body: sizes, ranges of its curves, and the stiffness that a device must be able to hold.

use crate::plot::{Line, LineChart};
use palpate_body::law::eigenvalues;
use palpate_body::stiffness::{StiffnessAt, principals, stiffness_max};
use palpate_body::{
    Body, CountErrors, CoupledLaw, Curve, DisplacementFields, NO_TWIN, PointErrors, Potential,
    PotentialErrors, Provenance, Response, SlipRule, StateErrors,
};
use palpate_build::validate::{median, percentile};
use serde::Serialize;
use std::collections::HashSet;

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
    /// Test points; of a coupled law potentials, also those made from other places'.
    pub test_points: usize,
    /// How the surface moves under the tool, where the body knows.
    pub displacement_fields: Option<FieldSummary>,
    /// `decoupled`, curves of normal and lateral force, or `coupled`, one potential of both.
    pub law: &'static str,
    /// Of a coupled law, over test points and depths.
    pub coupled: Option<CoupledRanges>,
    /// Slip rule.
    pub slip: SlipRule,
    /// Whether slip is kept from giving out energy.
    pub tank: bool,
    /// Whether contacts are two contact points side by side.
    pub partial_slip: bool,
    /// Whether the lateral response depends on the direction.
    pub anisotropic: bool,
    /// Least and greatest over the nodes: how many times as stiff laterally the stiffest direction is as the softest.
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
    /// The same of a coupled law's potentials.
    pub potential_fit: Option<PotentialFit>,
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

/// How far potentials are from what was simulated, over the places that were.
#[derive(Debug, Clone, Serialize)]
pub struct PotentialFit {
    /// Places that were simulated, and those of them that the tool was dragged at.
    pub places: [usize; 2],
    /// Of states that friction holds, |f_t| ≤ μ f_z.
    pub held: StateRanges,
    /// Of states with |f_t| ≤ f_z.
    pub within: StateRanges,
    /// Of all states.
    pub all: StateRanges,
    /// Median and 95th percentile: what a press's forces gain from state to state less what its stuck tangents say, in % of that.
    pub reciprocity_pressed_percent: [f64; 2],
    /// Median and 95th percentile: what potentials miss of the change that drags make to the normal force, in % of that.
    pub reciprocity_dragged_percent: [f64; 2],
}

/// Over places: the median of their medians, and the 95th percentile of theirs, in % of each state's force.
#[derive(Debug, Clone, Serialize)]
pub struct StateRanges {
    /// Of the normal force.
    pub normal_percent: [f64; 2],
    /// Of the lateral force.
    pub lateral_percent: [f64; 2],
}

fn potential_fit(places: &[PotentialErrors]) -> Option<PotentialFit> {
    let quantiles = |values: &mut dyn Iterator<Item = [f64; 2]>| {
        let [mut medians, mut p95s]: [Vec<f64>; 2] = values.map(|[a, b]| (a, b)).unzip().into();
        medians.sort_by(f64::total_cmp);
        p95s.sort_by(f64::total_cmp);
        [median(&medians), percentile(&p95s, 0.95)]
    };
    let ranges = |of: fn(&PotentialErrors) -> &StateErrors| {
        let some = || places.iter().map(of).filter(|e| e.states > 0);
        StateRanges {
            normal_percent: quantiles(&mut some().map(|e| e.normal_percent)),
            lateral_percent: quantiles(&mut some().map(|e| e.lateral_percent)),
        }
    };
    let dragged = || places.iter().filter(|p| p.dragged);
    (!places.is_empty()).then(|| PotentialFit {
        places: [places.len(), dragged().count()],
        held: ranges(|p| &p.held),
        within: ranges(|p| &p.within),
        all: ranges(|p| &p.all),
        reciprocity_pressed_percent: quantiles(
            &mut places.iter().map(|p| [100.0 * p.reciprocity_pressed; 2]),
        ),
        reciprocity_dragged_percent: quantiles(&mut dragged().map(|p| [100.0 * p.reciprocity_dragged; 2])),
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

/// Least and greatest of a coupled law's quantities over the test points and the depth knots.
#[derive(Debug, Clone, Serialize)]
pub struct CoupledRanges {
    /// The lateral deflection up to which the potentials were found, m.
    pub lateral_range_m: f64,
    /// Eigenvalues of K, N/m.
    pub stiffness_n_per_m: [f64; 2],
    /// |b|, N: the lateral force of a press straight in.
    pub offset_n: [f64; 2],
    /// The length of C's coefficients, N/m².
    pub cubic_n_per_m2: [f64; 2],
    /// Q, N/m³.
    pub quartic_n_per_m3: [f64; 2],
    /// Eigenvalues of κ, 1/m: how curved the surface is, as friction counts it.
    pub curvature_per_m: [f64; 2],
}

fn coupled_ranges(law: &CoupledLaw) -> CoupledRanges {
    let range = |values: &dyn Fn(&Potential, f64) -> [f64; 2]| {
        let of = |p| depth_knots(p).iter().map(move |&d| (p, d));
        let all = law.potentials.iter().flat_map(of).map(|(p, d)| values(p, d));
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [a, b]| [low.min(a), high.max(b)])
    };
    let length = |curves: &[Curve], d| curves.iter().map(|c: &Curve| c.value(d).powi(2)).sum::<f64>().sqrt();
    CoupledRanges {
        lateral_range_m: law.range_m,
        stiffness_n_per_m: range(&|p, d| p.principal_stiffness(d)),
        offset_n: range(&|p, d| [length(&p.offset, d); 2]),
        cubic_n_per_m2: range(&|p, d| [length(&p.cubic, d); 2]),
        quartic_n_per_m3: range(&|p, d| [p.quartic.value(d); 2]),
        curvature_per_m: range(&|p, _| eigenvalues(p.curvature)),
    }
}

fn depth_knots(potential: &Potential) -> &[f64] {
    potential.press.knots()
}

/// Directions in which a lateral force is looked at.
const DIRECTIONS: u32 = 24;

/// The least and the greatest lateral force, over the directions, of a potential deflected as far as its range.
fn lateral_forces(potential: &Potential, range_m: f64, depth: f64) -> [f64; 2] {
    let force = |i: u32| {
        let angle = f64::from(i) * (std::f64::consts::TAU / f64::from(DIRECTIONS));
        let xi = [range_m * libm::cos(angle), range_m * libm::sin(angle)];
        let [x, y] = potential.at(depth, xi, range_m).lateral;
        x.hypot(y)
    };
    (0..DIRECTIONS).map(force).fold([f64::INFINITY, 0.0], |[low, high], f| [low.min(f), high.max(f)])
}

/// What [`Ranges`] are of a coupled law: forces of a press straight in; lateral ones at the range; stiffness at depth 0.
fn coupled_force_ranges(law: &CoupledLaw) -> Ranges {
    let range = |values: &dyn Fn(&Potential, f64) -> [f64; 2]| {
        let all =
            law.potentials.iter().map(|p| values(p, depth_knots(p).last().copied().unwrap_or_default()));
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [a, b]| [low.min(a), high.max(b)])
    };
    Ranges {
        largest_normal_force_n: range(&|p, end| [p.press.slope(end); 2]),
        largest_lateral_force_n: range(&|p, end| lateral_forces(p, law.range_m, end)),
        stiffness_at_full_depth_n_per_m: range(&|p, end| [p.press.bend(end); 2]),
        lateral_stiffness_n_per_m: range(&|p, _| p.principal_stiffness(0.0)),
        friction: range(&|p, _| {
            let values = p.friction.knots().iter().map(|k| p.friction.value(*k));
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
        }),
    }
}

/// What there is of displacement fields.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct FieldSummary {
    /// Places that the tool was pressed at.
    pub pressed: usize,
    /// Places that it was dragged at.
    pub dragged: usize,
    /// What they take, bytes.
    pub bytes: usize,
}

impl FieldSummary {
    fn of(fields: &DisplacementFields) -> Self {
        let (pressed, dragged) = (fields.press().places(), fields.lateral().places());
        FieldSummary { pressed, dragged, bytes: fields.bytes() }
    }
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
        test_points: body.test_point_nodes().len(),
        displacement_fields: body.displacement_fields().ok().flatten().map(FieldSummary::of),
        law: if body.is_coupled() { "coupled" } else { "decoupled" },
        coupled: body.coupled_law().map(coupled_ranges),
        slip: body.slip(),
        tank: body.has_tank(),
        partial_slip: body.has_partial_slip(),
        anisotropic: !body.is_isotropic() || body.is_coupled(),
        lateral_ratio: principals(body)
            .map(|p| p.ratio())
            .chain(body.coupled_law().into_iter().flat_map(|law| &law.potentials).flat_map(ratios))
            .fold(None, |range: Option<[f64; 2]>, r| {
                Some(range.map_or([r; 2], |[low, high]| [low.min(r), high.max(r)]))
            })
            .unwrap_or([1.0; 2]),
        tools: vec![ToolEntry { shape: tool.name().into(), radius_m: tool.radius_m() }],
        bounding_box_m,
        depth_knots_m: body.responses().depth_knots().values().to_vec(),
        lateral_knots_m: body.responses().lateral_knots().values().to_vec(),
        ranges: body.coupled_law().map(coupled_force_ranges).unwrap_or_else(|| Ranges {
            largest_normal_force_n: one(|r, depth, _| r.normal.value(depth)),
            largest_lateral_force_n: one(|r, _, lateral| r.lateral.value(lateral)),
            stiffness_at_full_depth_n_per_m: one(|r, depth, _| r.normal.slope(depth)),
            lateral_stiffness_n_per_m: one(|r, _, _| r.lateral.slope(0.0)),
            friction: range(&|r| {
                let values = r.friction.knots().iter().map(|k| r.friction.value(*k));
                values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
            }),
        }),
        stiffness_max_n_per_m: stiffness_max(body),
        fit_errors: fit_errors(&body.provenance().point_errors),
        potential_fit: potential_fit(&body.provenance().potential_errors),
        provenance: body.provenance().clone(),
    }
}

/// Stiffest to softest direction of a potential's K, at each depth knot.
fn ratios(potential: &Potential) -> impl Iterator<Item = f64> + '_ {
    depth_knots(potential).iter().map(|&d| {
        let [low, high] = potential.principal_stiffness(d);
        high / low
    })
}

/// Lines in a picture that can still be told apart.
const LINES: usize = 12;

/// Charts of up to twelve test points, spread over the stiffness range, each with a name for its file: of the normal, lateral and
/// friction curves, or of what a coupled law says.
pub fn charts(body: &Body) -> Vec<(&'static str, Vec<LineChart>)> {
    match body.coupled_law() {
        Some(law) => coupled_charts(body, law).into_iter().chain(interpolation_chart(body)).collect(),
        None => decoupled_charts(body).map(|(name, chart)| (name, vec![chart])).into(),
    }
}

/// `count` of the numbers below `all`, in even steps from the first to the last.
fn spread(all: usize, count: usize) -> impl Iterator<Item = usize> {
    let (count, last) = (count.min(all), all.saturating_sub(1));
    (0..count).map(move |i| i * last / count.saturating_sub(1).max(1))
}

/// Lines from points of a depth, which is drawn in mm.
fn over_depth(end: f64, name: String, value: impl Fn(f64) -> f64) -> Line {
    let points = (0..=200).map(|i| end * f64::from(i) / 200.0).map(|d| (d * 1e3, value(d)));
    Line { name, points: points.collect(), ..Line::default() }
}

fn coupled_charts(body: &Body, law: &CoupledLaw) -> [(&'static str, Vec<LineChart>); 3] {
    let end = body.responses().depth_knots().values().last().copied().unwrap_or_default();
    // The others' potentials are made from those of the places that were simulated, where it is known which they are.
    let simulated: HashSet<u32> = body.provenance().potential_errors.iter().map(|p| p.node).collect();
    let counts = |&t: &usize| {
        simulated.is_empty() || body.test_point_nodes().get(t).is_some_and(|n| simulated.contains(n))
    };
    let mut order: Vec<usize> = (0..law.potentials.len()).filter(counts).collect();
    let force = |t: usize| law.potentials[t].press.slope(end);
    order.sort_by(|&a, &b| force(b).total_cmp(&force(a)));
    let shown: Vec<usize> = spread(order.len(), LINES).map(|i| order[i]).collect();
    let name = |t: usize| {
        let at = body.test_point_nodes().get(t).and_then(|&n| body.nodes().get(n as usize));
        let [x, y, z] = at.map_or([0.0; 3], |node| (node.position * 1e3).to_array());
        format!("{t} at ({x:.1}, {y:.1}, {z:.1}) mm")
    };
    let of = format!("{} of {} test points", shown.len(), order.len());
    let depth = "normal deflection (mm)";
    let chart = |what: &str, y: &str, values: &dyn Fn(&Potential, f64) -> f64| {
        let line = |t: usize| over_depth(end, name(t), |d| values(&law.potentials[t], d));
        let mut lines: Vec<Line> = shown.iter().map(|&t| line(t)).collect();
        let all_alike = lines.windows(2).all(|l| l[0].points == l[1].points);
        lines.truncate(if all_alike { 1 } else { lines.len() });
        if let (true, [line]) = (all_alike, &mut lines[..]) {
            line.name = of.clone();
        }
        let title = if all_alike { what.to_owned() } else { format!("{what}: {of}") };
        LineChart { title, x_label: depth.into(), y_label: y.into(), lines, from_zero: true }
    };
    // A test point in the middle of the range, in some directions at some depths.
    let along = |&t: &usize| {
        let potential = &law.potentials[t];
        let lines = [0.5, 1.0].into_iter().flat_map(|part| (0..4).map(move |i| (part * end, i)));
        let lines = lines.map(|(d, i)| {
            let angle = f64::from(i) * std::f64::consts::FRAC_PI_4;
            let (c, s) = (libm::cos(angle), libm::sin(angle));
            let points = (-60..=60).map(|k| 1.25 * law.range_m * f64::from(k) / 60.0);
            let points = points.map(|r| {
                let [x, y] = potential.at(d, [r * c, r * s], law.range_m).lateral;
                (r * 1e3, x * c + y * s)
            });
            let name = format!("{:.1} mm deep, {}°", d * 1e3, 45 * i);
            Line { name, points: points.collect(), ..Line::default() }
        });
        LineChart {
            title: format!(
                "Lateral force along rays (found up to {:.2} mm): test point {}",
                law.range_m * 1e3,
                name(t)
            ),
            x_label: "lateral deflection along the ray (mm)".into(),
            y_label: "lateral force along it (N)".into(),
            lines: lines.collect(),
            from_zero: false,
        }
    };
    let middle = shown.get(shown.len() / 2).map(along);
    [
        (
            "normal.png",
            vec![
                chart("Normal force of a press straight in", "normal force (N)", &|p, d| p.press.slope(d)),
                chart("Friction", "friction coefficient", &|p, d| p.friction.value(d)),
            ],
        ),
        (
            "stiffness.png",
            vec![
                chart("Lateral stiffness, softest direction", "stiffness (N/m)", &|p, d| {
                    p.principal_stiffness(d)[0]
                }),
                chart("Lateral stiffness, stiffest direction", "stiffness (N/m)", &|p, d| {
                    p.principal_stiffness(d)[1]
                }),
            ],
        ),
        (
            "lateral.png",
            [
                Some(chart("Lateral force of a press straight in, |b|", "lateral force (N)", &|p, d| {
                    p.offset[0].value(d).hypot(p.offset[1].value(d))
                })),
                middle,
            ]
            .into_iter()
            .flatten()
            .collect(),
        ),
    ]
}

/// Error against the number of test points.
fn interpolation_chart(body: &Body) -> Option<(&'static str, Vec<LineChart>)> {
    let by_count = &body.provenance().interpolation.as_ref()?.by_count;
    let line = |name: &str, of: fn(&CountErrors) -> f64| Line {
        name: name.into(),
        points: by_count.iter().map(|c| (f64::from(c.test_points), of(c))).collect(),
        ..Line::default()
    };
    let chart = LineChart {
        title: "Error at places that the test points predict".into(),
        x_label: "test points".into(),
        y_label: "error (% of the largest force)".into(),
        lines: vec![line("95th percentile", |c| c.p95_percent), line("median", |c| c.median_percent)],
        from_zero: true,
    };
    (by_count.len() > 1).then(|| ("test-points.png", vec![chart]))
}

fn decoupled_charts(body: &Body) -> [(&'static str, LineChart); 3] {
    let reach = |c: &Curve| c.knots().last().copied().unwrap_or_default();
    let mut order: Vec<usize> = (0..body.curves().len()).collect();
    let force = |t: &usize| body.curves().get(*t).map_or(0.0, |r| r.normal.value(reach(&r.normal)));
    order.sort_by(|a, b| force(b).total_cmp(&force(a)));
    let shown: Vec<usize> = spread(order.len(), LINES).filter_map(|i| order.get(i).copied()).collect();
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
            let points = samples.map(|d| (d * 1e3, curve.value(d))).collect();
            Some(Line { name, points, ..Line::default() })
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
