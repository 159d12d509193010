//! The body that a record makes, from nothing but the record.

use super::fields::{MOST_BY_DEFAULT, displacement_fields};
use super::stops;
use crate::paths_file::{PathsRecord, Point, TestPoint};
use crate::refine::to_sagitta;
use crate::spec::{Friction, Geometry, Law, Simulation, Spec, TestPoints};
use anyhow::{Result, anyhow, bail};
use glam::{DMat3, DVec3};
use palpate_body::refine::DEFAULT_SAGITTA_M;
use palpate_body::shape::Shape;
use palpate_body::{
    BlendWeights, Body, BodyParts, CoupledLaw, DisplacementFields, InterpolationErrors, PotentialErrors,
    Provenance, Response, Surface, Tensor, TriangleMesh,
};
use palpate_identify::{
    CoupledOptions, DragRecord, FitReport, PathOptions, PointRecord, fit_coupled, fit_paths,
};
use palpate_simulate::{PointPaths, PointPlan};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::Path;

/// Test points are simulated without the spec's friction; where it says nothing it is this, as of a moist glove on tissue.
const FRICTION: f64 = 0.3;
/// Stops that a body's provenance tells one by one.
const TOLD: usize = 200;

/// A body and how it came about.
#[derive(Debug)]
pub struct Assembled {
    /// The body.
    pub body: Body,
    /// Of the fit.
    pub report: FitReport,
    /// Paths that ended early.
    pub stops: Vec<String>,
}

/// The surface of a triangle mesh with the spec's frames and creases.
///
/// # Errors
/// The mesh is none that can be touched.
pub fn surface(spec: &Spec, mesh: &TriangleMesh) -> palpate_body::Result<Surface> {
    let surface = Surface::build(mesh, spec.crease_angle.unwrap_or(f64::INFINITY))?;
    match spec.geometry {
        // The paper's cylinder: its normals are radial.
        Some(Geometry::Shape(Shape::Cylinder { caps: false, .. }, _)) => {
            let radial = surface.positions().iter().map(|p| -DVec3::new(p.x, p.y, 0.0).normalize_or_zero());
            let radial = radial.collect();
            surface.with_inward_normals(radial)
        }
        _ => Ok(surface),
    }
}

/// Makes the body of a record that has all points. The same record gives the same bytes.
///
/// # Errors
/// No point could be pressed in, or what was simulated makes no body.
pub fn body(record: &PathsRecord) -> Result<Assembled> {
    let name = Path::new(&record.plan.spec_name);
    let spec = Spec::parse(name, record.plan.spec.clone())?;
    // Files of version 1 are from a time when the surface slid along the tool where a spec said nothing.
    let contact = record.plan.contact.as_deref().unwrap_or("frictionless");
    let simulation = spec.simulation_by_default(name, contact)?;
    let in_spec = |e: palpate_body::BodyError| e.in_file(name);
    let Some(scene) = &record.scene else { bail!("the record has no surface; give that of a whole run") };
    let surface = surface(&spec, &scene.surface).map_err(in_spec)?;

    let told = record.points.iter().flat_map(|(i, point)| stops(*i, &point.test_point(), &point.paths()));
    let told: Vec<String> = told.collect();
    let records = records(&record.points);
    if records.iter().all(|r| r.press.is_empty()) {
        let first = told.first().map_or("", String::as_str);
        bail!(
            "no test point could be pressed in: {first}; see whether the supports and the tool's size are right"
        );
    }
    let mut notes = scene.notes.clone();
    if simulation.friction.is_none() {
        notes.push(format!("[friction] is not given: its coefficient is {FRICTION}"));
    }
    let in_fit = |e: palpate_identify::FitError| anyhow!("{}: {e}", name.display());
    notes.extend(told.iter().take(TOLD).cloned());
    if told.len() > TOLD {
        notes.push(format!("{} further paths ended early", told.len() - TOLD));
    }
    let every = record.points.values().map(Point::paths);
    let halved = every.flat_map(|p| std::iter::once(p.press).chain(p.drags)).map(|path| path.halved);
    notes.extend(steps_told(halved));
    let mut provenance = provenance(record, notes);
    let (fitted, report) = match simulation.law {
        Law::Coupled => {
            let options = coupled_options(&simulation, &scene.guide_n_per_m, &scene.compliance_m_per_n);
            let fitted = fit_coupled(&surface, &records, &options).map_err(in_fit)?;
            provenance.potential_errors = fitted.errors;
            provenance.interpolation = fitted.interpolation;
            let law = Fitted {
                blends: fitted.blends,
                responses: Vec::new(),
                test_point_nodes: fitted.test_point_nodes,
                coupled: Some(fitted.law),
                lateral_tensors: None,
            };
            (law, fitted.report)
        }
        Law::Decoupled => {
            let compliance_prior = Some(scene.guide_n_per_m.clone());
            let options =
                PathOptions { friction: friction(&simulation), compliance_prior, ..PathOptions::default() };
            let fitted = fit_paths(&surface, &records, &options).map_err(in_fit)?;
            provenance.point_errors = fitted.errors;
            let law = Fitted {
                blends: fitted.fit.blends,
                responses: fitted.fit.responses,
                test_point_nodes: fitted.fit.test_point_nodes,
                coupled: None,
                lateral_tensors: Some(fitted.lateral_tensors),
            };
            (law, fitted.fit.report)
        }
    };
    provenance.notes.extend(report.notes.iter().cloned());
    let Fitted { blends, responses, test_point_nodes, coupled, lateral_tensors } = fitted;
    // Records of version 1, which name no contact, are of times when nothing was refined: they make the same body still.
    let by_default = if record.plan.contact.is_some() { DEFAULT_SAGITTA_M } else { 0.0 };
    let sagitta_m = spec.sagitta_m.unwrap_or(by_default);
    let mut fields = None;
    // Nor had bodies of records of version 1 fields.
    if spec.displacements.unwrap_or(record.plan.contact.is_some()) {
        let most = if spec.displacements.is_some() { usize::MAX } else { MOST_BY_DEFAULT };
        let (found, all) = displacement_fields(record, scene, &surface, &test_point_nodes, most)?;
        let kept = found.as_ref().map_or(0, |f| f.press().places());
        if kept < all {
            provenance.notes.push(format!(
                "it has displacement fields of {kept} of {all} test points, as many as {} MiB hold; [body] displacements = true keeps all",
                MOST_BY_DEFAULT >> 20
            ));
        }
        fields = found;
    }
    // A ball that sticks slips from the rim inwards; bodies with curves stay the paper's.
    let partial_slip = spec.partial_slip.unwrap_or(coupled.is_some());
    let body = Body::new(BodyParts {
        surface,
        blends,
        responses,
        test_point_nodes,
        coupled,
        lateral_tensors,
        tool: simulation.tool.of_body(),
        slip: spec.slip,
        tank: spec.tank,
        partial_slip,
        provenance,
    })
    .and_then(|body| body.with_displacement_fields(fields))
    .and_then(|body| to_sagitta(body, sagitta_m))
    .map_err(in_spec)?;
    Ok(Assembled { body, report, stops: told })
}

/// A law of either kind.
struct Fitted {
    blends: Vec<BlendWeights>,
    responses: Vec<Response>,
    test_point_nodes: Vec<u32>,
    coupled: Option<CoupledLaw>,
    lateral_tensors: Option<Vec<Tensor>>,
}

/// What is the same however the run was divided: no outputs, jobs, shards.
fn provenance(record: &PathsRecord, notes: Vec<String>) -> Provenance {
    let plan = &record.plan;
    let digest: String = Sha256::digest(plan.spec.as_bytes()).iter().map(|b| format!("{b:02x}")).collect();
    let mut inputs: BTreeMap<String, String> = plan.inputs.clone();
    inputs.insert(plan.spec_name.clone(), digest);
    Provenance {
        command: format!("palpate precompute {}", plan.spec_name),
        software: plan.software.clone(),
        spec: Some(plan.spec.clone()),
        inputs,
        notes,
        ..Provenance::default()
    }
}

/// The coefficient of friction over depth, m, that a spec gives, or stands for.
pub fn friction(simulation: &Simulation) -> Vec<(f64, f64)> {
    match &simulation.friction {
        Some(Friction::Constant(mu)) => vec![(0.0, *mu)],
        Some(Friction::Table(rows)) => rows.clone(),
        None => vec![(0.0, FRICTION)],
    }
}

/// How the sticking paths of this spec become a coupled law.
pub fn coupled_options<'a>(
    simulation: &Simulation,
    stiffness: &'a [f64],
    compliance: &'a [DMat3],
) -> CoupledOptions<'a> {
    CoupledOptions {
        friction: friction(simulation),
        range_m: Some(simulation.deflection.lateral_max_m),
        stiffness,
        compliance,
        tool_radius_m: Some(simulation.tool.of_body().radius_m()),
        first: match simulation.test_points {
            TestPoints::Adaptive { most, .. } => Some(first_round(most)),
            _ => None,
        },
    }
}

/// Parts of a force that the load steps may change without a word.
const STEPS_MATTER: f64 = 5e-3;

/// Test points to begin with, where there may be so many.
pub fn first_round(most: u32) -> usize {
    /// Fewer say nothing of what lies between them.
    const LEAST: u32 = 6;
    (most / 3).max(LEAST).min(most) as usize
}

/// What is to be said of load steps, where halving them changes more than 0.5 % of a force: of each path how much it
/// changes, where that was checked.
pub fn steps_told(halved: impl Iterator<Item = Option<f64>>) -> Option<String> {
    let checked: Vec<f64> = halved.flatten().collect();
    let beyond = checked.iter().filter(|h| **h > STEPS_MATTER).count();
    let most = checked.iter().copied().fold(0.0, f64::max);
    (beyond > 0).then(|| {
        format!(
            "halving the load steps changes the force by more than {} % on {beyond} of {} paths that were checked, by {:.1} % at \
             most",
            100.0 * STEPS_MATTER,
            checked.len(),
            100.0 * most
        )
    })
}

/// What was simulated, by index.
pub fn records(points: &BTreeMap<u32, Point>) -> Vec<PointRecord> {
    let record = |point: &Point| {
        let TestPoint { node, plan } = point.test_point();
        point_record(node, &point.paths(), &plan)
    };
    points.values().map(record).collect()
}

/// A point's paths, as fits take them.
pub fn point_record(node: u32, paths: &PointPaths, plan: &PointPlan) -> PointRecord {
    let drags = plan.drags.iter().zip(&paths.drags).filter_map(|(drag, path)| {
        // Where the press did not come so deep there was no drag.
        let depth_m = paths.press.states.get(drag.from)?.depth_m;
        let rows = path.states.iter().map(|s| (s.distance_m, s.force_n)).collect();
        Some(DragRecord { depth_m, direction: drag.direction, rows })
    });
    let all = std::iter::once(&paths.press).chain(&paths.drags);
    let stiffness = paths.press.states.iter().filter_map(|s| {
        let rows = s.tangent.as_ref()?;
        // Forces by translations.
        let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
        Some((s.depth_m, DMat3::from_cols(column(0), column(1), column(2))))
    });
    PointRecord {
        node,
        inward: plan.inward,
        press: paths.press.states.iter().map(|s| (s.depth_m, s.force_n)).collect(),
        pressed_n: paths.press.states.iter().map(|s| s.pressed_n).collect(),
        patch_m2: paths.press.states.iter().map(|s| s.patch_m2).collect(),
        stiffness: stiffness.collect(),
        drags: drags.collect(),
        stopped: all.into_iter().find_map(|p| p.stopped.as_ref()).map(|s| s.why.clone()),
    }
}

/// The JSON report at the end of a run or a merge.
#[derive(Debug, serde::Serialize)]
pub struct Report {
    nodes: usize,
    triangles: usize,
    test_points: usize,
    paths: usize,
    states: usize,
    newton_steps: u64,
    /// Of the displacement fields in the body, bytes.
    displacement_bytes: usize,
    stopped: Vec<String>,
    notes: Vec<String>,
    fit: FitReport,
    /// Of a coupled law.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    potential_errors: Vec<PotentialErrors>,
    #[serde(skip_serializing_if = "Option::is_none")]
    interpolation: Option<InterpolationErrors>,
}

impl Report {
    /// Of a record and its body.
    pub fn new(record: &PathsRecord, assembled: Assembled) -> Self {
        let Assembled { body, report, stops } = assembled;
        let (mut paths, mut states, mut newton_steps) = (0, 0, 0);
        for point in record.points.values().map(crate::paths_file::Point::paths) {
            for path in std::iter::once(&point.press).chain(&point.drags) {
                paths += 1;
                states += path.states.len();
                newton_steps += path.states.iter().map(|s| u64::from(s.iterations)).sum::<u64>();
            }
        }
        Report {
            nodes: body.nodes().len(),
            triangles: body.elements().len(),
            test_points: report.points.len(),
            paths,
            states,
            newton_steps,
            displacement_bytes: body
                .displacement_fields()
                .ok()
                .flatten()
                .map_or(0, DisplacementFields::bytes),
            stopped: stops,
            notes: body.provenance().notes.clone(),
            fit: report,
            potential_errors: body.provenance().potential_errors.clone(),
            interpolation: body.provenance().interpolation.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn load_steps_are_told_of_where_they_matter() {
        assert_eq!(steps_told([None, Some(1e-3), Some(5e-3)].into_iter()), None);
        let told = steps_told([None, Some(1e-3), Some(0.021)].into_iter()).unwrap();
        assert!(told.contains("0.5 % on 1 of 2 paths") && told.contains("2.1 %"), "{told}");
    }
}
