//! The body's stiffness at rest, all over its surface: what responses go with between test points.

use glam::{DMat3, DVec3};
use palpate_body::Surface;
use palpate_simulate::Model;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;

/// So few test points, named by the spec, need no compliance prior between them.
const UNGUIDED: usize = 3;

/// Places at which the stiffness at rest is found; between them it is interpolated.
const GUIDED: usize = 600;

/// The body's compliance at rest under a patch as wide as the tool, m/N in its axes, at each of the surface's nodes: what its
/// responses go with from place to place, and known everywhere for one substitution each. None for few named test points.
///
/// Of no use once `cancelled` is true.
pub fn rest_compliance(
    model: &Model,
    surface: &Surface,
    points: usize,
    radius_m: f64,
    cancelled: &AtomicBool,
) -> Vec<DMat3> {
    let positions = surface.positions();
    if points <= UNGUIDED {
        return Vec::new();
    }
    let (places, of) = sparse(positions, surface.inward_normals());
    let at = |&n: &u32| {
        let n = n as usize;
        if cancelled.load(Relaxed) {
            return DMat3::IDENTITY;
        }
        model.compliance_at(positions[n], surface.inward_normals()[n], radius_m)
    };
    let found: Vec<DMat3> = places.par_iter().map(at).collect();
    let mean = |shares: &Vec<(u32, f64)>| {
        let parts = shares.iter().map(|(place, share)| found[*place as usize] * *share);
        parts.fold(DMat3::ZERO, |sum, part| sum + part)
    };
    of.iter().map(mean).collect()
}

/// The stiffness at rest along each node's normal, N/m; 1 where no compliance is known.
pub fn compliance_prior(surface: &Surface, compliance: &[DMat3]) -> Vec<f64> {
    if compliance.is_empty() {
        return vec![1.0; surface.positions().len()];
    }
    let along = compliance.iter().zip(surface.inward_normals()).map(|(s, u)| u.dot(*s * *u));
    let mut found: Vec<f64> = along.map(|s| if s > 0.0 { 1.0 / s } else { f64::INFINITY }).collect();
    // What supports carry alone is no stiffer than a hundred times the usual.
    let mut sorted: Vec<f64> = found.iter().copied().filter(|k| k.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let most = sorted.get(sorted.len() / 4).map_or(1.0, |k| 100.0 * k);
    found.iter_mut().for_each(|k| *k = k.min(most));
    found
}

/// At most [`GUIDED`] nodes spread over the surface, and for each node the shares of those around it.
fn sparse(positions: &[DVec3], normals: &[DVec3]) -> (Vec<u32>, Vec<Vec<(u32, f64)>>) {
    let all = positions.len();
    if all <= GUIDED {
        return ((0..all as u32).collect(), (0..all as u32).map(|n| vec![(n, 1.0)]).collect());
    }
    let low = positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = positions.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    let mut cell = (high - low).length() / (GUIDED as f64).sqrt();
    let key = |p: DVec3, cell: f64| ((p - low) / cell).floor().to_array().map(|c| c as i64);
    let places = loop {
        // The first node of each cell.
        let mut cells: BTreeMap<[i64; 3], u32> = BTreeMap::new();
        for (n, p) in positions.iter().enumerate() {
            cells.entry(key(*p, cell)).or_insert(n as u32);
        }
        if cells.len() <= GUIDED {
            break cells;
        }
        cell *= 1.1;
    };
    let listed: Vec<u32> = places.values().copied().collect();
    let index: HashMap<[i64; 3], u32> = places.keys().copied().zip(0..).collect();
    let shares = positions.iter().zip(normals).map(|(p, normal)| {
        let [x, y, z] = key(*p, cell);
        let mut near: Vec<(u32, f64)> = Vec::new();
        for (dx, dy, dz) in
            (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| (x, y, z))))
        {
            let Some(&place) = index.get(&[x + dx, y + dy, z + dz]) else { continue };
            let other = listed[place as usize] as usize;
            // Not what lies on the other side of a thin part.
            if normals[other].dot(*normal) > 0.0 {
                near.push((place, 1.0 / (p.distance_squared(positions[other]) + 1e-3 * cell * cell)));
            }
        }
        if near.is_empty() {
            near.push((index[&[x, y, z]], 1.0));
        }
        let total: f64 = near.iter().map(|(_, w)| w).sum();
        near.iter_mut().for_each(|(_, w)| *w /= total);
        near
    });
    let shares = shares.collect();
    (listed, shares)
}
