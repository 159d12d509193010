//! `palpate view`.

use super::Failure;
#[cfg(feature = "viewer")]
use anyhow::anyhow;
#[cfg(feature = "viewer")]
use palpate_viewer::command::{self, Frame, Pace, Request};
#[cfg(feature = "viewer")]
use palpate_viewer::still::StateChoice;
#[cfg(feature = "viewer")]
use palpate_viewer::{CameraChoice, Colouring};
#[cfg(feature = "viewer")]
use std::path::PathBuf;

/// How to get what a build without the window lacks.
#[cfg(not(feature = "viewer"))]
pub const HOW: &str = "this palpate was built without its window; get it with `cargo install --path crates/palpate-cli --features viewer`";

/// See a body, and touch it with the mouse
///
/// The mouse leads a simulated hand, whose spring lets the tool lag by the force over its stiffness. F1 shows keys and mouse; the
/// space bar always stops. Without a body the window begins with examples; a body, a recording, a spec or a mesh can be
/// dropped on it. --screenshot, --animation and --sequence draw without a display.
#[cfg(feature = "viewer")]
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("picture").args(["screenshot", "animation", "sequence"]))]
#[command(group = clap::ArgGroup::new("moving").args(["animation", "sequence"]))]
#[command(after_help = "Examples:\n  \
    palpate view liver.body\n  \
    palpate view liver.body --screenshot liver.png --state \"depth_mm=5 drag_mm=8\" --camera 30,20,2 --colour stiffness\n  \
    palpate view liver.body --animation press.png --state \"depth_mm=5 drag_mm=8\" --bare --size 720x480\n  \
    palpate view liver.body --recording first-touch.rec --sequence frames --fps 25\n\n\
    Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
pub struct Args {
    /// Body file, or an example: cylinder, lump, pad, ring, ball
    body: Option<PathBuf>,
    /// A recording of this body, with a bar to go through it
    #[arg(long, value_name = "FILE", requires = "body")]
    recording: Option<PathBuf>,
    /// Record what the mouse does, into a file that is not there yet; where a switch begins another session, into FILE-2 and on
    #[arg(long, value_name = "FILE", requires = "body", conflicts_with_all = ["recording", "state", "picture"])]
    record: Option<PathBuf>,
    /// Hear how fast the force changes: where it jumps, it clicks
    #[arg(long, conflicts_with_all = ["recording", "state", "picture"])]
    sound: bool,
    /// Write the recording's sound into this WAV file
    #[arg(long, value_name = "FILE", requires = "recording", conflicts_with = "picture")]
    wav: Option<PathBuf>,
    /// Draw a picture into this PNG, without a display
    #[arg(long, value_name = "FILE")]
    screenshot: Option<PathBuf>,
    /// Draw the recording, or the way from rest to --state, into this animated PNG
    #[arg(long, value_name = "FILE", requires = "body")]
    animation: Option<PathBuf>,
    /// Draw the recording into this folder: frame-00000.png and on
    #[arg(long, value_name = "DIR", requires = "recording")]
    sequence: Option<PathBuf>,
    /// Pictures a second
    #[arg(long, value_name = "N", default_value_t = 25.0, requires = "moving")]
    fps: f64,
    /// How long the animation of a --state takes; a recording takes its own time
    #[arg(
        long,
        value_name = "S",
        default_value_t = 3.0,
        requires = "animation",
        conflicts_with = "recording"
    )]
    seconds: f64,
    /// From where: oblique, front, back, left, right, top, bottom, or AZIMUTH_DEG,ELEVATION_DEG; a zoom after a comma
    #[arg(long, value_name = "VIEW", allow_hyphen_values = true)]
    camera: Option<CameraChoice>,
    /// The state that is shown: `rest`, or words such as "depth_mm=4 at_mm=0,0,30 drag_mm=5 drag_deg=90" [default of pictures:
    /// half as deep as the curves go]
    #[arg(long, value_name = "WORDS", requires = "body", conflicts_with = "recording")]
    state: Option<StateChoice>,
    /// The recording's time that is shown
    #[arg(long, value_name = "S", requires = "recording")]
    time_s: Option<f64>,
    /// Size of pictures
    #[arg(long, value_name = "WxH", default_value = "1360x860", value_parser = command::size, requires = "picture")]
    size: Size,
    /// Pixels a point: letters get larger with it
    #[arg(long, value_name = "X", default_value_t = 1.0, requires = "picture")]
    pixels_per_point: f32,
    /// Pictures of the body alone, without panels
    #[arg(long, requires = "picture")]
    bare: bool,
    /// What colours show: plain, stiffness, friction, test-points, interpolation, certificate, energy
    #[arg(long, visible_alias = "color", value_name = "WHAT", default_value = "plain")]
    colour: Colouring,
    /// At which depth [default: half as deep as the curves go]
    #[arg(long, value_name = "MM")]
    colour_depth_mm: Option<f64>,
    /// Cut the body: x, y or z, and a share of the way, such as y,0.5; -y keeps the other side
    #[arg(long, value_name = "PLANE", value_parser = command::section, allow_hyphen_values = true)]
    section: Option<palpate_viewer::scene::Section>,
    /// Draw the elements' edges
    #[arg(long)]
    edges: bool,
    /// Light letters on dark ground
    #[arg(long)]
    dark: bool,
    /// Slip rule; without it, the body's own
    #[arg(long, value_enum)]
    slip: Option<super::Slip>,
    /// Multiply the body's friction coefficients by this
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    friction_scale: f64,
}

#[cfg(feature = "viewer")]
type Size = [u32; 2];

/// See a body, and touch it with the mouse (not in this build: --features viewer)
///
/// This palpate was built without its window. `cargo install --path crates/palpate-cli --features viewer` builds one that has it.
#[cfg(not(feature = "viewer"))]
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Whatever the command takes where it is there
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    _any: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
#[cfg(not(feature = "viewer"))]
pub fn run(_args: &Args) -> Result<(), Failure> {
    Err(anyhow::anyhow!(HOW).into())
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
#[cfg(feature = "viewer")]
pub fn run(args: &Args) -> Result<(), Failure> {
    let mut settings = palpate_viewer::Settings {
        colouring: args.colour,
        section: args.section,
        slip: args.slip.map(super::Slip::rule),
        friction_scale: args.friction_scale,
        sound: args.sound,
        theme: if args.dark { palpate_viewer::palette::Theme::Dark } else { Default::default() },
        ..Default::default()
    };
    settings.marks.edges = args.edges;
    if !(0.0..=100.0).contains(&args.friction_scale) {
        return Err(anyhow!("--friction-scale {}: give a number from 0 to 100", args.friction_scale).into());
    }
    if args.colour_depth_mm.is_some_and(|mm| !(0.0..=50.0).contains(&mm)) {
        return Err(anyhow!("--colour-depth-mm: give a depth from 0 to 50 mm").into());
    }
    if !(0.5..=4.0).contains(&args.pixels_per_point) {
        return Err(
            anyhow!("--pixels-per-point {}: give a number from 0.5 to 4", args.pixels_per_point).into()
        );
    }
    let draws = args.screenshot.is_some() || args.animation.is_some() || args.sequence.is_some();
    let request = Request {
        body: args.body.clone(),
        recording: args.recording.clone(),
        time_s: args.time_s,
        camera: args.camera,
        state: args.state.or((draws && args.body.is_some()).then_some(StateChoice::HALF_DEEP)),
        settings,
        colour_depth_m: args.colour_depth_mm.map(|mm| mm * 1e-3),
        record: args.record.clone(),
    };
    let read: Vec<&std::path::Path> =
        request.body.iter().chain(&request.recording).map(PathBuf::as_path).collect();
    let written = args.screenshot.as_ref().or(args.animation.as_ref()).or(args.wav.as_ref());
    palpate_files::refuse_overwrite(written.as_slice(), &read)?;
    let frame = Frame { size: args.size, has_panels: !args.bare, scale: args.pixels_per_point };
    let told = |e: palpate_viewer::command::ViewError| anyhow!("{e}");
    if let Some(file) = &args.wav {
        let heard = command::sound(&request, file).map_err(told)?;
        crate::console::note(&format!(
            "{}: {:.1} s, the force changes by at most {:.0} N/s",
            file.display(),
            heard.seconds,
            heard.peak_n_per_s
        ));
        return Ok(());
    }
    let pace = Pace { fps: args.fps, seconds: args.seconds };
    if let Some(file) = &args.animation {
        let count = command::animation(&request, &frame, file, &pace).map_err(told)?;
        crate::console::note(&format!("{}: {count} pictures", file.display()));
        return Ok(());
    }
    if let Some(folder) = &args.sequence {
        let count = command::sequence(&request, &frame, folder, &pace).map_err(told)?;
        crate::console::note(&format!("{}: {count} pictures", folder.display()));
        return Ok(());
    }
    if let Some(file) = &args.screenshot {
        return Ok(command::screenshot(&request, &frame, file).map_err(told)?);
    }
    let is_asked = crate::live::signals()?;
    command::open(&request, Box::new(move |_| is_asked())).map_err(told)?;
    Ok(())
}
