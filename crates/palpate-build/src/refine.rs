//! Finer surfaces for bodies that are made, and what is noted of them.

use crate::fit::read_surface;
use anyhow::Result;
use palpate_body::import::LengthUnit;
use palpate_body::{Body, BodyError, Fineness, Refined};
use palpate_files as files;
use std::path::PathBuf;

/// What a body becomes.
#[derive(Debug, Clone)]
pub enum Target {
    /// As fine as this.
    Fineness(Fineness),
    /// On a mesh of one's own.
    Mesh {
        /// Its file.
        path: PathBuf,
        /// Of its coordinates.
        unit: Option<LengthUnit>,
        /// Whether it may have borders.
        open: bool,
        /// Edges that turn by more stay sharp, rad.
        crease_angle: f64,
    },
}

/// `body` made finer, with notes in its provenance.
///
/// # Errors
/// As [`Body::refined`] and [`Body::on_surface`]; a mesh that can't be read.
pub fn refine(body: &Body, target: &Target) -> Result<Body> {
    let mut provenance = body.provenance().clone();
    let refined = match target {
        Target::Fineness(fineness) => body.refined(*fineness)?,
        Target::Mesh { path, unit, open, crease_angle } => {
            let (surface, notes) = read_surface(path, *unit, *open, *crease_angle)?;
            provenance.notes.extend(notes);
            provenance.inputs.insert(path.display().to_string(), files::sha256(path)?);
            body.on_surface(surface).map_err(|e| e.in_file(path))?
        }
    };
    provenance.notes.extend(notes(body, target, &refined));
    Ok(refined.body.with_provenance(provenance))
}

/// A body as a spec wants it: facets no farther than `sagitta_m` from the smooth surface, or as they are where that is 0.
pub(crate) fn to_sagitta(body: Body, sagitta_m: f64) -> palpate_body::Result<Body> {
    if sagitta_m == 0.0 {
        return Ok(body);
    }
    let target = Fineness::sagitta(sagitta_m);
    let refined = body.refined(target).map_err(|e| match e {
        BodyError::Invalid { file, problem, hint, .. } => {
            BodyError::Invalid { file, place: "[body] sagitta_um".into(), problem, hint }
        }
        other => other,
    })?;
    let mut provenance = body.provenance().clone();
    provenance.notes.extend(notes(&body, &Target::Fineness(target), &refined));
    Ok(refined.body.with_provenance(provenance))
}

fn notes(body: &Body, target: &Target, refined: &Refined) -> Vec<String> {
    let [before, after] = [body, &refined.body].map(|body| body.elements().len());
    let micrometres = |x: f64| format!("{:.1} µm", x * 1e6);
    let done = match target {
        Target::Fineness(_) if before == after => return Vec::new(),
        Target::Fineness(Fineness { sagitta_m, .. }) if sagitta_m.is_finite() => {
            format!("facets are within {} of the smooth surface", micrometres(*sagitta_m))
        }
        Target::Fineness(Fineness { edge_m, .. }) => {
            format!("edges are no longer than {:.4} mm", edge_m * 1e3)
        }
        Target::Mesh { path, .. } => format!("the surface is that of {}", path.display()),
    };
    let distance = micrometres(refined.distance_m);
    let mut notes = vec![format!("{done}: {before} triangles became {after}, moved by {distance} at most")];
    if refined.sharp_nodes > 0 {
        notes.push(format!(
            "at {} of {} nodes facets turn by more than 40°: the surface stays flat around them",
            refined.sharp_nodes,
            body.nodes().len()
        ));
    }
    if refined.reduced_nodes > 0 {
        notes.push(format!(
            "at {} of {} nodes more than three test points came together: the nearest three stand for them",
            refined.reduced_nodes,
            refined.body.nodes().len()
        ));
    }
    notes
}
