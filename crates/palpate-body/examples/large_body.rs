//! How long a refined body of 5 million triangles takes to open, ready for contacts of the default slip rule, and how
//! much memory:
//!
//! ```text
//! cargo run --release -p palpate-body --example large_body -- make large.body
//! cargo run --release -p palpate-body --example large_body -- open large.body
//! ```

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{
    BlendWeights, Body, BodyParts, Curve, Extension, Fineness, Interpolation, Response, SlipRule,
};
use std::path::Path;
use std::time::Instant;

fn main() -> palpate_body::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["make", file] => make(Path::new(file)),
        ["open", file] => open(Path::new(file)),
        _ => {
            eprintln!("give `make FILE` or `open FILE`");
            std::process::exit(2);
        }
    }
}

/// A tube whose every node is a test point, with edges of 0.08 to 0.12 mm.
fn make(file: &Path) -> palpate_body::Result<()> {
    let tube = Shape::Cylinder { radius_mm: 30.0, length_mm: 100.0, caps: false };
    let resolution = Resolution { around: Some(36), along: Some(17), ..Default::default() };
    let surface = tube.surface(resolution)?;
    let knots: Vec<f64> = (0..=24).map(|i| f64::from(i) * 8e-3 / 24.0).collect();
    // Curves of 24 intervals, whose shapes differ from place to place.
    let curve = |scale: f64, power: f64| {
        let values: Vec<f64> = knots.iter().map(|d| scale * (d / 8e-3).powf(power)).collect();
        Curve::through(&knots, &values, Interpolation::Pchip, Extension::Linear)
    };
    let friction = Curve::through(&knots, &[0.3; 25], Interpolation::Linear, Extension::Constant)?;
    let response = |p: &DVec3| {
        let [x, y] = [p.x / 0.03, p.y / 0.03];
        let (normal, lateral) = (curve(3.0 + x, 1.5 + 0.3 * y)?, curve(2.0 + y, 1.2 + 0.1 * x)?);
        Ok(Response { normal, lateral, friction: friction.clone() })
    };
    let own = 0..surface.positions().len() as u32;
    let responses = surface.positions().iter().map(response).collect::<palpate_body::Result<Vec<_>>>()?;
    let uniform = Body::uniform(surface, responses[0].clone())?;
    let body = Body::new(BodyParts {
        blends: own.clone().map(BlendWeights::own).collect(),
        test_point_nodes: own.collect(),
        responses,
        ..uniform.parts()
    })?;
    let begun = Instant::now();
    let refined = body.refined(Fineness::edge(0.125e-3))?.body;
    println!("{} triangles, refined in {:.2} s", refined.elements().len(), begun.elapsed().as_secs_f64());
    refined.save(file)
}

fn open(file: &Path) -> palpate_body::Result<()> {
    let begun = Instant::now();
    let body = Body::open(file)?;
    let opened = begun.elapsed().as_secs_f64();
    body.prepare(SlipRule::Consistent);
    let prepared = begun.elapsed().as_secs_f64();
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or(" unknown").trim();
    println!(
        "{} triangles: opened in {opened:.2} s, ready after {prepared:.2} s, at most {peak} of memory",
        body.elements().len()
    );
    Ok(())
}
