//! Frames a second while a tool is dragged over a body of so many triangles, without a display: deformation, drawing, and reading
//! the picture back.
//!
//! `cargo run --release -p palpate-viewer --example frames -- 100000`

use palpate::Body;
use palpate::body::Response;
use palpate::body::shape::{Resolution, Shape};
use palpate::runtime::BodyFile;
use palpate_viewer::still::{self, StateChoice};
use palpate_viewer::work::Opened;
use palpate_viewer::{Offscreen, Settings, Viewer};
use std::time::Instant;

/// How many frames are timed.
const FRAMES: u32 = 60;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let wanted: f64 = std::env::args().nth(1).map_or(Ok(100_000.0), |word| word.parse())?;
    // Equilateral triangles of an area that so many make a sphere of.
    let area = 4.0 * std::f64::consts::PI * 30.0f64.powi(2) / wanted;
    let edge_length_mm = Some((area * 4.0 / 3f64.sqrt()).sqrt());
    let surface =
        Shape::Sphere { radius_mm: 30.0 }.surface(Resolution { edge_length_mm, ..Default::default() })?;
    let body = Body::uniform(surface, Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3)?)?;
    let triangles = body.elements().len();
    let mut viewer = Viewer::default();
    viewer.touches = false;
    viewer.show_body(Opened { body: body.into(), name: "ball".into(), file: BodyFile::default() });
    let body = viewer.subject().ok_or("no body")?.body.clone();
    let states = (0..8).map(|k| {
        let choice = StateChoice { depth_m: 5e-3, drag_m: 1e-3 * f64::from(k), ..StateChoice::default() };
        still::state(&body, &choice, &Settings::default())
    });
    let states: Vec<_> = states.collect::<Result<Vec<_>, _>>()?;

    for (samples, size, has_panels) in
        [(1, [1024, 768], false), (4, [1024, 768], false), (1, [1360, 860], true)]
    {
        let mut offscreen = Offscreen::with_samples(false, samples)?;
        let mut frame = |k: u32| -> Result<(), Box<dyn std::error::Error>> {
            viewer.show(states[k as usize % states.len()].clone());
            viewer.tick(0.0);
            if has_panels {
                offscreen.frame(&mut viewer, size, 1.0)?;
            } else {
                let scene = viewer.scene().ok_or("no scene")?;
                offscreen.scene(&scene, size)?;
            }
            Ok(())
        };
        (0..4).try_for_each(&mut frame)?;
        let began = Instant::now();
        (0..FRAMES).try_for_each(&mut frame)?;
        let seconds = began.elapsed().as_secs_f64();
        println!(
            "{triangles} triangles, {} x {} pixels, {samples} samples, {}: {:.1} frames a second on {}",
            size[0],
            size[1],
            if has_panels { "with panels" } else { "the body alone" },
            f64::from(FRAMES) / seconds,
            offscreen.adapter()
        );
    }
    Ok(())
}
