//! The body that a record makes, from nothing but the record.

use super::stops;
use crate::paths_file::PathsRecord;
use crate::refine::to_sagitta;
use crate::spec::{Friction, Geometry, Spec};
use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use palpate_body::refine::DEFAULT_SAGITTA_M;
use palpate_body::shape::Shape;
use palpate_body::{Body, BodyParts, Provenance, Surface, TriangleMesh};
use palpate_identify::{DragRecord, FitReport, PathOptions, PointRecord, fit_paths};
use palpate_simulate::PointPaths;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::Path;

/// Friction can't be simulated; where the spec says nothing it is this, as of a moist glove on tissue.
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
    let simulation = spec.simulation(name)?;
    let in_spec = |e: palpate_body::BodyError| e.in_file(name);
    let Some(scene) = &record.scene else { bail!("the record has no surface; give that of a whole run") };
    let surface = surface(&spec, &scene.surface).map_err(in_spec)?;

    let mut told = Vec::new();
    let mut records = Vec::with_capacity(record.points.len());
    for (index, point) in &record.points {
        let (test_point, paths) = (point.test_point(), point.paths());
        told.extend(stops(*index, &test_point, &paths));
        records.push(point_record(test_point.node, test_point.plan.inward, &paths, point));
    }
    if records.iter().all(|r| r.press.is_empty()) {
        let first = told.first().map_or("", String::as_str);
        bail!(
            "no test point could be pressed in: {first}; see whether the supports and the tool's size are right"
        );
    }
    let mut notes = scene.notes.clone();
    let friction = match &simulation.friction {
        Some(Friction::Constant(mu)) => vec![(0.0, *mu)],
        Some(Friction::Table(rows)) => rows.clone(),
        None => {
            notes.push(format!("[friction] is not given: its coefficient is {FRICTION}"));
            vec![(0.0, FRICTION)]
        }
    };
    let compliance_prior = Some(scene.guide_n_per_m.clone());
    let options = PathOptions { friction, compliance_prior, ..PathOptions::default() };
    let fitted = fit_paths(&surface, &records, &options).map_err(|e| anyhow!("{}: {e}", name.display()))?;
    notes.extend(told.iter().take(TOLD).cloned());
    if told.len() > TOLD {
        notes.push(format!("{} further paths ended early", told.len() - TOLD));
    }
    notes.extend(fitted.fit.report.notes.iter().cloned());
    let body = Body::new(BodyParts {
        surface,
        blends: fitted.fit.blends,
        responses: fitted.fit.responses,
        test_point_nodes: fitted.fit.test_point_nodes,
        coupled: None,
        lateral_tensors: Some(fitted.lateral_tensors),
        tool: simulation.tool.of_body(),
        slip: spec.slip,
        tank: spec.tank,
        provenance: Provenance { point_errors: fitted.errors, ..provenance(record, notes) },
    })
    .and_then(|body| to_sagitta(body, spec.sagitta_m.unwrap_or(DEFAULT_SAGITTA_M)))
    .map_err(in_spec)?;
    Ok(Assembled { body, report: fitted.fit.report, stops: told })
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
        point_errors: Vec::new(),
    }
}

fn point_record(
    node: u32,
    inward: DVec3,
    paths: &PointPaths,
    point: &crate::paths_file::Point,
) -> PointRecord {
    let plan = point.test_point().plan;
    let drags = plan.drags.iter().zip(&paths.drags).filter_map(|(drag, path)| {
        // Where the press did not come so deep there was no drag.
        let depth_m = paths.press.states.get(drag.from)?.depth_m;
        let rows = path.states.iter().map(|s| (s.distance_m, s.force_n)).collect();
        Some(DragRecord { depth_m, direction: drag.direction, rows })
    });
    let all = std::iter::once(&paths.press).chain(&paths.drags);
    PointRecord {
        node,
        inward,
        press: paths.press.states.iter().map(|s| (s.depth_m, s.force_n)).collect(),
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
    stopped: Vec<String>,
    notes: Vec<String>,
    fit: FitReport,
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
            test_points: body.test_point_nodes().len(),
            paths,
            states,
            newton_steps,
            stopped: stops,
            notes: body.provenance().notes.clone(),
            fit: report,
        }
    }
}
