//! Draws the window's six pictures and the animation of README.md and docs/viewer.md anew, into a folder. Needs no display.
//!
//! `cargo run --release -p palpate-viewer --example pictures -- docs/images`

use palpate_viewer::command::{Frame, Pace, Request, animation, screenshot, section};
use palpate_viewer::palette::Theme;
use palpate_viewer::{Colouring, Settings};
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "docs/images".into()));
    let plain = Settings::default();
    let of = |colouring| Settings { colouring, ..Settings::default() };
    let mut edges = plain;
    edges.marks.edges = true;
    let cut = Settings { section: Some(section("y,0.25")?), ..plain };
    let dark = Settings { theme: Theme::Dark, ..of(Colouring::Energy) };
    draw(&folder, "start", None, plain, "", "oblique", true)?;
    draw(
        &folder,
        "pad",
        Some("pad"),
        plain,
        "depth_mm=6 at_mm=-8,0,20 drag_mm=14 drag_deg=-90",
        "-60,24,1.1",
        true,
    )?;
    draw(
        &folder,
        "lump",
        Some("lump"),
        of(Colouring::Stiffness),
        "depth_mm=5 at_mm=12,-8,15",
        "-60,36,1.05",
        true,
    )?;
    draw(
        &folder,
        "cylinder",
        Some("cylinder"),
        edges,
        "depth_mm=5 at_mm=0,-30,-20 drag_mm=22",
        "-70,18,1.15",
        true,
    )?;
    draw(&folder, "section", Some("pad"), cut, "depth_mm=7 at_mm=0,0,20", "-72,16,1.5", false)?;
    draw(&folder, "dark", Some("ring"), dark, "depth_mm=6 at_mm=30,-20,13 drag_mm=6", "-50,38,1.15", true)?;
    moving(&folder)
}

/// A press, and a drag over the lump: the force grows there, and the surface and the contact's track follow the tool.
fn moving(folder: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let settings = Settings { colouring: Colouring::Stiffness, ..Settings::default() };
    let request = Request {
        body: Some("lump".into()),
        state: Some("depth_mm=5 at_mm=-20,-8,15 drag_mm=46".parse()?),
        camera: Some("-72,38,1.12".parse()?),
        settings,
        ..Request::default()
    };
    let frame = Frame { size: [600, 380], has_panels: false, scale: 1.0 };
    let file = folder.join("view-drag.png");
    let count = animation(&request, &frame, &file, &Pace { fps: 16.0, seconds: 3.0 })?;
    println!("{}: {count} pictures", file.display());
    Ok(())
}

fn draw(
    folder: &Path,
    name: &str,
    body: Option<&str>,
    settings: Settings,
    state: &str,
    camera: &str,
    has_panels: bool,
) -> Result<(), Box<dyn std::error::Error>> {
    let request = Request {
        body: body.map(PathBuf::from),
        state: body.map(|_| state.parse()).transpose()?,
        camera: Some(camera.parse()?),
        settings,
        ..Request::default()
    };
    let size = if has_panels { [1280, 800] } else { [900, 600] };
    let file = folder.join(format!("view-{name}.png"));
    screenshot(&request, &Frame { size, has_panels, scale: 1.0 }, &file)?;
    println!("{}", file.display());
    Ok(())
}
