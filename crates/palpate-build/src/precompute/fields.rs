//! A record's displacement fields, as a body keeps them: few depths of each place, and only what moves.

use crate::paths_file::{PathsRecord, Scene};
use anyhow::Result;
use glam::DVec3;
use palpate_body::{DisplacementFields, FieldSet, FieldSurface, PlaceField, Surface};
use palpate_identify::spread_everywhere;
use palpate_simulate::{Drag, Path, PointPaths};
use std::collections::{BTreeMap, HashSet};

/// Bodies keep their fields without being told to where they take no more than this, bytes.
pub const MOST_BY_DEFAULT: usize = 32 << 20;
/// The depths of a press that are kept, in parts of its greatest: with these, and linear in the depth's root between them,
/// a liver's field is off by 0.9 % of the depth near the tool (median, at 40 % of the greatest).
const KEPT: [f64; 4] = [0.07, 0.2, 0.6, 1.0];

/// The fields of a record for a body on `surface` whose test points sit on these nodes, of as many test points as `most_bytes` hold, spread
/// evenly; none where nothing was pressed, the record has no displacements, or they hold too few. And how many the record has.
///
/// # Errors
/// The record's displacements can't be read any more, or are none of its surface's.
pub fn displacement_fields(
    record: &PathsRecord,
    scene: &Scene,
    surface: &Surface,
    test_point_nodes: &[u32],
    most_bytes: usize,
) -> Result<(Option<DisplacementFields>, usize)> {
    /// Between fewer places a field is nobody's.
    const LEAST: usize = 4;
    if scene.faces.is_empty() {
        return Ok((None, 0));
    }
    let boundary = FieldSurface::new(scene.boundary_m.clone(), scene.faces.clone())?;
    let found = Found::of(record, &boundary, |_| true)?;
    let (sizes, count) = (found.sizes.clone(), found.sizes.len());
    let Some(all) = found.fields(&boundary, surface, test_point_nodes)? else { return Ok((None, 0)) };
    if all.bytes() <= most_bytes {
        return Ok((Some(all), count));
    }
    let shared = all.bytes() - sizes.values().sum::<usize>();
    let chosen = chosen(record, &sizes, most_bytes.saturating_sub(shared));
    if chosen.len() < LEAST {
        return Ok((None, count));
    }
    let some = Found::of(record, &boundary, |i| chosen.contains(&i))?;
    Ok((some.fields(&boundary, surface, test_point_nodes)?, count))
}

/// Places' fields.
#[derive(Default)]
struct Found {
    press: FieldSet,
    lateral: FieldSet,
    /// Nodes of the places that have them.
    pressed: Vec<u32>,
    dragged: Vec<u32>,
    /// Bytes, of the record's points.
    sizes: BTreeMap<u32, usize>,
}

impl Found {
    /// Of the record's points that are `wanted`.
    fn of(record: &PathsRecord, boundary: &FieldSurface, wanted: impl Fn(u32) -> bool) -> Result<Self> {
        let mut found = Found::default();
        for (&i, point) in record.points.iter().filter(|(i, _)| wanted(**i)) {
            let (place, paths) = (point.test_point(), point.paths_with_displacements()?);
            let moved = |path: &Path| path.states.first().is_some_and(|s| !s.displacement_m.is_empty());
            if !moved(&paths.press) {
                continue;
            }
            let before = found.bytes();
            let inward = place.plan.inward.normalize();
            let along =
                place.plan.drags.first().map_or(DVec3::ZERO, |d| d.direction.reject_from_normalized(inward));
            let tangent = along.normalize_or(inward.any_orthonormal_vector());
            let states = kept(&paths.press).map(|i| &paths.press.states[i]);
            let states = states.map(|s| (s.depth_m, vec![&s.displacement_m[..]]));
            let field = PlaceField { point: place.plan.point, inward, tangent, states: states.collect() };
            found.press.push(boundary, &field, false)?;
            found.pressed.push(place.node);
            let by_depth = lateral_fields(&paths, &place.plan.drags, [tangent, inward.cross(tangent)]);
            if !by_depth.is_empty() {
                let states = by_depth.iter().map(|(d, [a, b])| (*d, vec![&a[..], &b[..]])).collect();
                found.lateral.push(boundary, &PlaceField { states, ..field }, true)?;
                found.dragged.push(place.node);
            }
            found.sizes.insert(i, found.bytes() - before);
        }
        Ok(found)
    }

    fn bytes(&self) -> usize {
        self.press.bytes() + self.lateral.bytes()
    }

    /// Blended for test points on these nodes; none without a place.
    fn fields(
        self,
        boundary: &FieldSurface,
        surface: &Surface,
        test_point_nodes: &[u32],
    ) -> Result<Option<DisplacementFields>> {
        if self.pressed.is_empty() {
            return Ok(None);
        }
        let blended = |set: FieldSet, nodes: &[u32]| -> Result<FieldSet> {
            if nodes.is_empty() {
                return Ok(set);
            }
            let (blends, _) = spread_everywhere(surface, nodes)?;
            Ok(set.with_blends(test_point_nodes.iter().map(|&n| blends[n as usize]).collect()))
        };
        let (press, lateral) = (blended(self.press, &self.pressed)?, blended(self.lateral, &self.dragged)?);
        Ok(Some(DisplacementFields::new(boundary.clone(), press, lateral, test_point_nodes.len())?))
    }
}

/// As many of the points with these sizes as so many bytes hold: first those that were dragged, then the others, each the farthest from those
/// before.
fn chosen(record: &PathsRecord, sizes: &BTreeMap<u32, usize>, most_bytes: usize) -> HashSet<u32> {
    let mut left: Vec<(u32, DVec3, bool, f64)> = sizes
        .keys()
        .map(|i| {
            let plan = record.points[i].test_point().plan;
            (*i, plan.point, !plan.drags.is_empty(), f64::INFINITY)
        })
        .collect();
    let (mut chosen, mut room) = (HashSet::new(), most_bytes);
    while !left.is_empty() {
        let rank = |&(_, _, dragged, distance): &(u32, DVec3, bool, f64)| (dragged, distance);
        let next = (0..left.len()).max_by(|&a, &b| {
            let [a, b] = [a, b].map(|i| rank(&left[i]));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let (i, at, ..) = left.swap_remove(next.unwrap_or(0));
        let Some(rest) = room.checked_sub(sizes[&i]) else { break };
        room = rest;
        chosen.insert(i);
        left.iter_mut().for_each(|(_, p, _, distance)| *distance = distance.min(p.distance(at)));
    }
    chosen
}

/// The states of a press that are kept, ascending.
fn kept(press: &Path) -> impl Iterator<Item = usize> + use<> {
    let depths: Vec<f64> = press.states.iter().map(|s| s.depth_m).collect();
    let deepest = depths.last().copied().unwrap_or_default();
    let nearest = |part: f64| {
        let off = |i: &usize| (depths[*i] - part * deepest).abs();
        (0..depths.len()).filter(|&i| depths[i] > 0.0).min_by(|a, b| off(a).total_cmp(&off(b)))
    };
    let mut states: Vec<usize> = KEPT.into_iter().filter_map(nearest).collect();
    states.dedup();
    states.into_iter()
}

/// A depth, m, and there the displacement per metre of lateral motion along two directions.
type Lateral = (f64, [Vec<[f32; 3]>; 2]);

/// Of the drags from each depth the displacement per metre along these two directions: the least squares of all drags' first
/// states.
fn lateral_fields(paths: &PointPaths, drags: &[Drag], directions: [DVec3; 2]) -> Vec<Lateral> {
    let mut from: Vec<usize> = drags.iter().map(|d| d.from).collect();
    from.sort_unstable();
    from.dedup();
    let at = |from: usize| {
        let start = paths.press.states.get(from)?;
        let mut normal = [[0.0; 2]; 2];
        let mut sums = [0, 1].map(|_| vec![DVec3::ZERO; start.displacement_m.len()]);
        for (drag, path) in drags.iter().zip(&paths.drags).filter(|(d, _)| d.from == from) {
            let Some(state) = path.states.first() else { continue };
            if state.displacement_m.len() != start.displacement_m.len() {
                continue;
            }
            let by = directions.map(|d| d.dot(drag.direction) * state.distance_m);
            for (i, sum) in sums.iter_mut().enumerate() {
                (0..2).for_each(|j| normal[i][j] += by[i] * by[j]);
                let change = state.displacement_m.iter().zip(&start.displacement_m);
                for (sum, (after, before)) in sum.iter_mut().zip(change) {
                    *sum +=
                        DVec3::from_array(std::array::from_fn(|c| f64::from(after[c] - before[c]))) * by[i];
                }
            }
        }
        let [[a, b], [_, d]] = normal;
        let determinant = a * d - b * b;
        // All drags in a line say nothing of the direction across it.
        if determinant <= 1e-3 * (a + d) * (a + d) {
            return None;
        }
        let inverse = [[d, -b], [-b, a]].map(|row| row.map(|x| x / determinant));
        let field = |i: usize| {
            let [first, second] = &sums;
            let of = |(p, q): (&DVec3, &DVec3)| *p * inverse[i][0] + *q * inverse[i][1];
            first.iter().zip(second).map(of).map(|v| v.to_array().map(|c| c as f32)).collect()
        };
        Some((start.depth_m, [field(0), field(1)]))
    };
    from.into_iter().filter_map(at).collect()
}
