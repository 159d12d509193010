//! The built-in shapes as solids, from their exact distances; sharp edges stay sharp.

use super::TetMesh;
use super::stuffing::{Domain, Expected, FillOptions, FillReport, Frame, Scale, fill_distance};
use crate::{Result, SimulateError};
use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use std::f64::consts::PI;

/// The stuffed lattice's cubes per edge asked, as for any surface.
const CELL_PER_EDGE_OF_CYLINDERS: f64 = 1.3;

/// A block's surface shows the lattice's cubes themselves, halved.
const CELL_PER_EDGE_OF_BLOCKS: f64 = 1.0;

/// Fills a shape with tetrahedra; a cylinder is solid whether it has caps or not.
///
/// Spheres, ellipsoids and tori are stuffed ([`super::stuffing`]) and keep their roundness in curved elements. A
/// block's elements are the lattice's own. A cylinder's lattice ends at the discs, and only its mantle is cut.
/// [`FillOptions::planes_z_m`] divide blocks and cylinders.
///
/// # Errors
/// A shape that [`Shape::mesh`] refuses, impossible options, planes outside the shape, too many elements, and
/// elements too large for the shape.
pub fn fill(shape: &Shape, options: &FillOptions) -> Result<(TetMesh, FillReport)> {
    // Its own check of the size.
    shape.mesh(Resolution::default())?;
    let whole = |volume: f64| Expected { volume, parts: 1 };
    match *shape {
        Shape::Sphere { radius_mm } => {
            let radius = radius_mm / 1e3;
            let distance = |p: DVec3| (p.length() - radius, p.normalize_or(DVec3::X));
            let reach = DVec3::splat(radius);
            fill_distance(&distance, (-reach, reach), whole(4.0 / 3.0 * PI * radius.powi(3)), options)
        }
        Shape::Ellipsoid { radii_mm } => {
            let radii = DVec3::from_array(radii_mm) / 1e3;
            let volume = 4.0 / 3.0 * PI * radii.element_product();
            fill_distance(&|p| ellipsoid(radii, p), (-radii, radii), whole(volume), options)
        }
        Shape::Torus { radii_mm } => {
            let [ring, tube] = radii_mm.map(|r| r / 1e3);
            let distance = |p: DVec3| {
                let outward = DVec3::new(p.x, p.y, 0.0).normalize_or(DVec3::X);
                let offset = p - outward * ring;
                (offset.length() - tube, offset.normalize_or(DVec3::Z))
            };
            let reach = DVec3::new(ring + tube, ring + tube, tube);
            let volume = 2.0 * PI * PI * ring * tube * tube;
            fill_distance(&distance, (-reach, reach), whole(volume), options)
        }
        Shape::Cylinder { radius_mm, length_mm, .. } => {
            let (radius, length) = (radius_mm / 1e3, length_mm / 1e3);
            options.check()?;
            let scale = Scale::new(options, CELL_PER_EDGE_OF_CYLINDERS, length.max(2.0 * radius));
            let distance = |p: DVec3| {
                let flat = DVec3::new(p.x, p.y, 0.0);
                (flat.length() - radius, flat.normalize_or(DVec3::X))
            };
            // The axis in the middle of the lattice.
            let root = scale.edge(scale.top);
            let count = (2.0 * (radius + 2.0 * scale.cell) / root).ceil();
            let across = vec![(0, -count * root / 2.0), (1, -count * root / 2.0 + scale.edge(0) / 2.0)];
            let extent = (count * f64::from(2 << scale.top)).min(1e9) as i32;
            let along = knots(length, &options.planes_z_m, &scale)?;
            let walls: Vec<i32> = along.iter().map(|k| k.0).collect();
            let domain = Domain {
                extent: [extent, extent, walls.last().copied().unwrap_or(0)],
                frame: Frame([across.clone(), across, along]),
                walls: [Vec::new(), Vec::new(), walls],
                distance: Some(&distance),
            };
            domain.fill(&scale, whole(PI * radius * radius * length), options)
        }
        Shape::Block { size_mm } => {
            let size = DVec3::from_array(size_mm) / 1e3;
            options.check()?;
            let scale = Scale::new(options, CELL_PER_EDGE_OF_BLOCKS, size.max_element());
            let frame = [
                knots(size.x, &[], &scale)?,
                knots(size.y, &[], &scale)?,
                knots(size.z, &options.planes_z_m, &scale)?,
            ];
            let walls: [Vec<i32>; 3] = [0, 1, 2].map(|a| frame[a].iter().map(|k| k.0).collect());
            let domain = Domain {
                extent: [0, 1, 2].map(|a| walls[a].last().copied().unwrap_or(0)),
                frame: Frame(frame),
                walls,
                distance: None::<&fn(DVec3) -> (f64, DVec3)>,
            };
            domain.fill(&scale, whole(size.element_product()), options)
        }
    }
}

/// Lattice coordinates and heights of a length's ends and of the planes between: whole cells of about the surface's
/// size in each.
fn knots(length: f64, planes: &[f64], scale: &Scale) -> Result<Vec<(i32, f64)>> {
    let mut heights = vec![-length / 2.0, length / 2.0];
    for plane in planes {
        if !plane.is_finite() || plane.abs() > length / 2.0 * (1.0 + 1e-9) {
            return Err(SimulateError::invalid(
                "layers",
                format!("z = {} mm lies outside the shape", plane * 1e3),
                format!("give heights between {} and {} mm", -length * 500.0, length * 500.0),
            ));
        }
        heights.push(*plane);
    }
    heights.sort_by(f64::total_cmp);
    // Planes that are the same but for rounding, or the ends.
    let mut apart = vec![heights[0]];
    for height in &heights[1..] {
        if height - apart[apart.len() - 1] > 1e-9 * length {
            apart.push(*height);
        } else if *height == length / 2.0 {
            apart.pop();
            apart.push(*height);
        }
    }
    let mut knots = vec![(0, apart[0])];
    for pair in apart.windows(2) {
        // An even number lets the cells grow from both sides alike.
        let cells = (pair[1] - pair[0]) / scale.cell;
        let cells = if cells < 1.5 { 1.0 } else { 2.0 * (cells / 2.0).round().max(1.0) };
        let last: i32 = knots[knots.len() - 1].0;
        let cells = cells.min(1e6) as i32;
        knots.push((last.saturating_add(cells.saturating_mul(2 << scale.surface)), pair[1]));
    }
    Ok(knots)
}

/// Distance to an ellipsoid about the origin, and its gradient: the nearest point x has x_i = a_i² p_i / (t + a_i²),
/// with t the largest root of Σ (a_i p_i / (t + a_i²))² = 1 (Eberly 2013, Distance from a point to an ellipsoid).
fn ellipsoid(radii: DVec3, p: DVec3) -> (f64, DVec3) {
    let least = radii.min_element();
    // On a plane of symmetry the root may hide behind a pole: a step aside that no distance shows.
    let y = p.abs().max(DVec3::splat(1e-14 * least));
    let square = radii * radii;
    // s = t + least², above zero.
    let beyond = square - DVec3::splat(least * least);
    let weighted = radii * y;
    let above = |s: f64| (weighted / (beyond + s)).length_squared() > 1.0;
    let (mut low, mut high) = (0.0, weighted.length());
    for _ in 0..200 {
        let middle = (low + high) / 2.0;
        if middle <= low || middle >= high {
            break;
        }
        if above(middle) { low = middle } else { high = middle }
    }
    let nearest = square * y / (beyond + high);
    let normal = (nearest / square).normalize();
    let distance = (y - nearest).dot(normal);
    let sign = |x: f64, of: f64| if of < 0.0 { -x } else { x };
    (distance, DVec3::new(sign(normal.x, p.x), sign(normal.y, p.y), sign(normal.z, p.z)))
}
