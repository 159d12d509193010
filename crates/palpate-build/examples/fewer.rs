//! A body of fewer of a record's test points, and of fewer that are dragged: how much each is worth is then a matter of
//! `palpate validate --paths-of`, without a further simulation.
//!
//!     cargo run --release -p palpate-build --example fewer -- liver.body.paths few.body 60 8

use anyhow::{Context, Result, bail};
use glam::DVec3;
use palpate_build::paths_file::{PathsRecord, Point, TestPoint};
use palpate_build::precompute::assemble;
use palpate_simulate::PointPaths;
use std::path::Path;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [record, body, points, dragged] = &arguments[..] else {
        bail!(
            "give a .paths file, the body to write, how many test points, and how many of them are dragged"
        );
    };
    let mut record = PathsRecord::open(Path::new(record))?;
    let count = |text: &str| text.parse::<usize>().with_context(|| format!("{text} is no number"));
    let kept = spread(&record, |_| true, count(points)?);
    record.points.retain(|i, _| kept.contains(i));
    let dragged = spread(&record, |point| !point.test_point().plan.drags.is_empty(), count(dragged)?);
    for (&i, point) in &mut record.points {
        if !dragged.contains(&i) {
            *point = pressed(i, point);
        }
    }
    let made = assemble::body(&record)?.body.with_displacement_fields(None)?;
    made.save(Path::new(body))?;
    println!("{}: {} test points, {} of them dragged", body, kept.len(), dragged.len());
    Ok(())
}

/// So many of the points that are `wanted`, each the farthest from those before; all if there are no more.
fn spread(record: &PathsRecord, wanted: impl Fn(&Point) -> bool, count: usize) -> Vec<u32> {
    let places = record.points.iter().filter(|(_, point)| wanted(point));
    let mut left: Vec<(u32, DVec3, f64)> =
        places.map(|(&i, point)| (i, point.test_point().plan.point, f64::INFINITY)).collect();
    let mut chosen = Vec::new();
    while chosen.len() < count && !left.is_empty() {
        let farthest = (0..left.len()).max_by(|&a, &b| left[a].2.total_cmp(&left[b].2)).unwrap_or(0);
        let (i, at, _) = left.swap_remove(farthest);
        chosen.push(i);
        left.iter_mut().for_each(|(_, p, distance)| *distance = distance.min(p.distance(at)));
    }
    chosen
}

/// The same point without its drags.
fn pressed(index: u32, point: &Point) -> Point {
    let TestPoint { node, mut plan } = point.test_point();
    plan.drags.clear();
    let paths = PointPaths { press: point.paths().press, drags: Vec::new() };
    Point::new(index, &TestPoint { node, plan }, &paths, 0)
}
