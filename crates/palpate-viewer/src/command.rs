//! What the command `palpate view` asks for.

use crate::animation;
use crate::camera::CameraChoice;
use crate::gallery::Example;
use crate::offscreen::{DrawError, Offscreen, Picture};
use crate::scene::Section;
use crate::settings::Settings;
use crate::shown::Shown;
use crate::sound::{self, Loudness};
use crate::state::{Event, Viewer};
use crate::still::{self, StateChoice};
use crate::subject::Subject;
use crate::window;
use crate::work::{Done, Opened, Work};
use palpate::runtime::{Outcome, PreparedSession};
use std::path::{Path, PathBuf};

/// All that a command can say.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Request {
    /// A body's file, or one of the examples' names; without it, the window begins with the examples.
    pub body: Option<PathBuf>,
    /// A recording of it.
    pub recording: Option<PathBuf>,
    /// Which moment of the recording, s.
    pub time_s: Option<f64>,
    /// From where.
    pub camera: Option<CameraChoice>,
    /// Which state, where there is no recording.
    pub state: Option<StateChoice>,
    /// How it is shown and touched.
    pub settings: Settings,
    /// The depth that is coloured, m; half of what the curves reach without it.
    pub colour_depth_m: Option<f64>,
    /// A file that what the mouse does is recorded into: see [`Viewer::record`].
    pub record: Option<PathBuf>,
}

/// What a picture shows, and how large it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Whether the panels are in it, or the body alone.
    pub has_panels: bool,
    /// Pixels a point: letters get larger with it.
    pub scale: f32,
}

impl Default for Frame {
    fn default() -> Self {
        Frame { size: [1360, 860], has_panels: true, scale: 1.0 }
    }
}

/// Why a command could not be followed: one message that says what, where, and how to mend it.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// What was given.
    #[error("{0}")]
    Input(String),
    /// Drawing.
    #[error(transparent)]
    Draw(#[from] DrawError),
}

impl From<String> for ViewError {
    fn from(text: String) -> Self {
        ViewError::Input(text)
    }
}

/// Opens the window, and waits until it is closed or `ends`, which is asked before every picture, comes true.
///
/// # Errors
/// What was given can't be opened; there is no display or no adapter.
pub fn open(request: &Request, ends: window::Ends) -> Result<(), ViewError> {
    if request.state.is_some() {
        window::open(prepared(request)?, Vec::new(), ends)?;
        return Ok(());
    }
    // A session begins with its body: not before there is somewhere to show it and to stop it.
    window::display()?;
    let mut viewer = Viewer::with_settings(request.settings);
    viewer.record = request.record.clone();
    let mut first = Vec::new();
    if let Some(recording) = &request.recording {
        viewer.read_with_body(recording.clone());
    }
    if let Some(body) = &request.body {
        // Before a window comes up: what can't be opened is told where the command was given.
        viewer.show_body(opened(body)?);
        viewer.finish_work()?;
    }
    if let Some(depth) = request.colour_depth_m {
        viewer.update([Event::Change(Settings { colour_depth_m: depth, ..*viewer.settings() })]);
    }
    if let Some(camera) = &request.camera {
        viewer.point_camera(camera);
    }
    first.extend(request.time_s.map(Event::Scrub));
    window::open(viewer, first, ends)?;
    Ok(())
}

/// Opens the window on a session, which begins with the first picture, and waits as [`open`] does. What the session came to;
/// `None` where it could not begin. The calling thread and the window's keep off the haptic thread's core.
///
/// # Errors
/// There is no display or no adapter: the device is closed, and there was no force.
pub fn watch(
    opened: Opened,
    session: PreparedSession,
    ends: window::Ends,
) -> Result<Option<Outcome>, ViewError> {
    let mut viewer = Viewer::default();
    viewer.watch(opened, session);
    Ok(window::open(viewer, Vec::new(), ends)?)
}

/// A picture without a display.
///
/// # Errors
/// What was given can't be opened or is missing; there is no adapter; the file can't be written.
pub fn screenshot(request: &Request, frame: &Frame, file: &Path) -> Result<(), ViewError> {
    let mut viewer = prepared(request)?;
    let mut offscreen = Offscreen::new(false)?;
    picture(&mut viewer, &mut offscreen, frame, file)
}

/// How a recording's or a state's time becomes pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Pictures a second.
    pub fps: f64,
    /// How long the way from rest to a state takes, s; a recording takes its own time.
    pub seconds: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Pace { fps: 25.0, seconds: 3.0 }
    }
}

/// More pictures than anybody waits for.
const PICTURES_MAX: f64 = 100_000.0;

impl Pace {
    /// How many pictures show so many seconds, the first and the last moment among them.
    fn count(&self, seconds: f64) -> Result<u32, ViewError> {
        let fps = self.fps;
        if !(0.1..=1000.0).contains(&fps) {
            return Err(ViewError::Input(format!("{fps} pictures a second; give from 0.1 to 1,000")));
        }
        let count = (seconds * fps).floor() + 1.0;
        if !(1.0..=PICTURES_MAX).contains(&count) {
            return Err(ViewError::Input(format!(
                "{seconds:.3} s at {fps} pictures a second are {count:.0} pictures; give fewer a second: at most {PICTURES_MAX} are drawn"
            )));
        }
        Ok(count as u32)
    }
}

/// Pictures of a recording, `fps` a second of its time, as `frame-00000.png` and on in a folder. How many.
///
/// # Errors
/// As [`screenshot`]; no recording; too many pictures.
pub fn sequence(request: &Request, frame: &Frame, folder: &Path, pace: &Pace) -> Result<u32, ViewError> {
    if request.recording.is_none() {
        return Err(ViewError::Input("a sequence is of a recording: give --recording FILE".into()));
    }
    let mut viewer = prepared(request)?;
    let moments = Moments::of(&viewer, pace)?;
    palpate::files::make_folder(folder).map_err(|e| palpate::files::message(&e))?;
    let mut offscreen = Offscreen::new(false)?;
    for k in 0..moments.count {
        moments.go_to(&mut viewer, k);
        picture(&mut viewer, &mut offscreen, frame, &folder.join(format!("frame-{k:05}.png")))?;
    }
    Ok(moments.count)
}

/// One animated picture: a recording in its own time, or the way from rest to a state. How many pictures are in it.
///
/// # Errors
/// As [`screenshot`]; nothing moves; too many pictures; a file that is not to be a PNG.
pub fn animation(request: &Request, frame: &Frame, file: &Path, pace: &Pace) -> Result<u32, ViewError> {
    animation::check_name(file)?;
    let mut viewer = prepared(request)?;
    let moments = Moments::of(&viewer, pace)?;
    let mut offscreen = Offscreen::new(false)?;
    let period_ms = (1e3 / pace.fps).round().clamp(1.0, 1e4) as u16;
    animation::save(file, moments.count, period_ms, |k| {
        moments.go_to(&mut viewer, k);
        Ok(drawn(&mut viewer, &mut offscreen, frame)?)
    })
    .map_err(|e| palpate::files::message(&e))?;
    Ok(moments.count)
}

/// A recording's sound as a WAV file.
///
/// # Errors
/// What was given can't be opened; no recording, or none that can be heard.
pub fn sound(request: &Request, file: &Path) -> Result<Loudness, ViewError> {
    let viewer = prepared(request)?;
    let Some(playback) = viewer.playback() else {
        return Err(ViewError::Input("a sound is of a recording: give --recording FILE".into()));
    };
    Ok(sound::save(file, &playback.records)?)
}

/// The moments that are drawn one after another.
struct Moments {
    count: u32,
    of: MomentsOf,
}

enum MomentsOf {
    /// From this time on, s, with so much between two.
    Recording { first_s: f64, period_s: f64 },
    /// The way to a state, from rest.
    Way(Vec<Shown>),
}

impl Moments {
    fn of(viewer: &Viewer, pace: &Pace) -> Result<Self, ViewError> {
        if let Some(playback) = viewer.playback() {
            let [first_s, last_s] = playback.span_s();
            let count = pace.count(last_s - first_s)?;
            return Ok(Moments { count, of: MomentsOf::Recording { first_s, period_s: 1.0 / pace.fps } });
        }
        let Some(still) = viewer.still().filter(|still| !still.states.is_empty()) else {
            let text = "nothing moves: give --recording FILE, or a --state that is pressed, such as \"depth_mm=4 drag_mm=6\"";
            return Err(ViewError::Input(text.into()));
        };
        if !(0.1..=600.0).contains(&pace.seconds) {
            return Err(ViewError::Input(format!(
                "an animation of {} s; give from 0.1 to 600",
                pace.seconds
            )));
        }
        Ok(Moments { count: pace.count(pace.seconds)?, of: MomentsOf::Way(still.states.clone()) })
    }

    fn go_to(&self, viewer: &mut Viewer, k: u32) {
        match &self.of {
            MomentsOf::Recording { first_s, period_s } => {
                viewer.update([Event::Scrub(first_s + f64::from(k) * period_s)]);
            }
            MomentsOf::Way(states) => {
                let share = f64::from(k) / f64::from(self.count.saturating_sub(1).max(1));
                let last = (share * (states.len() - 1) as f64).round() as usize;
                viewer.show(states[..=last].to_vec());
            }
        }
        viewer.tick(0.0);
    }
}

fn picture(
    viewer: &mut Viewer,
    offscreen: &mut Offscreen,
    frame: &Frame,
    file: &Path,
) -> Result<(), ViewError> {
    Ok(drawn(viewer, offscreen, frame)?.save(file)?)
}

fn drawn(viewer: &mut Viewer, offscreen: &mut Offscreen, frame: &Frame) -> Result<Picture, ViewError> {
    if frame.has_panels {
        return Ok(offscreen.window(viewer, frame.size, frame.scale)?);
    }
    let scene =
        viewer.scene().ok_or_else(|| ViewError::Input("there is no body to draw; name one".into()))?;
    Ok(offscreen.scene(&scene, frame.size)?)
}

/// A viewer that shows what was asked for, and nothing that moves.
///
/// # Errors
/// What was given can't be opened.
pub fn prepared(request: &Request) -> Result<Viewer, ViewError> {
    let mut viewer = Viewer::with_settings(request.settings);
    viewer.touches = false;
    let Some(path) = &request.body else {
        if request.recording.is_some() || request.state.is_some() {
            return Err(ViewError::Input("of which body? Give its file, too".into()));
        }
        return Ok(viewer);
    };
    if let Some(recording) = &request.recording {
        viewer.read_with_body(recording.clone());
    }
    viewer.show_body(opened(path)?);
    viewer.finish_work()?;
    if let Some(depth) = request.colour_depth_m {
        viewer.update([Event::Change(Settings { colour_depth_m: depth, ..*viewer.settings() })]);
    }
    if let Some(camera) = &request.camera {
        viewer.point_camera(camera);
    }
    if let (Some(choice), Some(subject), None) = (&request.state, viewer.subject(), &request.recording) {
        let body = subject.body.clone();
        let states = still::state(&body, choice, viewer.settings())?;
        if !states.is_empty() {
            viewer.show(states);
        }
    }
    viewer.update(request.time_s.map(Event::Scrub));
    viewer.touches = true;
    // Bounds are shown when they are all there.
    while viewer.subject().is_some_and(Subject::is_bounding) {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    viewer.tick(0.0);
    Ok(viewer)
}

/// A file, or one of the examples by its name.
fn opened(path: &Path) -> Result<Opened, ViewError> {
    let example = Example::ALL.into_iter().find(|e| Path::new(e.name()) == path);
    let work = match example {
        Some(example) if !path.exists() => Work::make_example(example),
        _ => Work::open_body(path.to_path_buf()),
    };
    match work.wait() {
        Done::Body(opened) => Ok(*opened),
        Done::Failed(text) | Done::Cancelled(text) => Err(ViewError::Input(text)),
        Done::Recording(_) => Err(ViewError::Input(format!("{}: it is no body", path.display()))),
    }
}

/// A plane as an option names it: `x`, `y` or `z`, with a share after a comma: `y,0.5`; a `-` before it keeps the other side.
///
/// # Errors
/// It is none.
pub fn section(text: &str) -> Result<Section, String> {
    let refused =
        || format!("`{text}` is no cut; give x, y or z, and a share of the way after a comma, such as y,0.5");
    let (name, share) = text.split_once(',').map_or((text, None), |(n, s)| (n, Some(s)));
    let (name, keeps_lower) = name.strip_prefix('-').map_or((name, false), |n| (n, true));
    let axis = ["x", "y", "z"].iter().position(|a| *a == name.trim()).ok_or_else(refused)?;
    let share = share.map_or(Some(0.5), |s| s.trim().parse::<f64>().ok());
    let share = share.filter(|s| (0.0..=1.0).contains(s)).ok_or_else(refused)?;
    Ok(Section { axis, share, keeps_lower })
}

/// Pixels as an option names them: `1360x860`.
///
/// # Errors
/// They are none, or too few or many.
pub fn size(text: &str) -> Result<[u32; 2], String> {
    let refused = || {
        format!("`{text}` is no size; give WIDTHxHEIGHT in pixels, from 64 to 8,192 each, such as 1360x860")
    };
    let (width, height) = text.split_once(['x', '×']).ok_or_else(refused)?;
    let number =
        |word: &str| word.trim().parse().ok().filter(|n| (64..=8192).contains(n)).ok_or_else(refused);
    Ok([number(width)?, number(height)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_or_refused_with_what_can_be_given() {
        assert_eq!(section("y"), Ok(Section { axis: 1, share: 0.5, keeps_lower: false }));
        assert_eq!(section("-z,0.25"), Ok(Section { axis: 2, share: 0.25, keeps_lower: true }));
        for wrong in ["", "w", "x,2", "x,nan", "x,"] {
            assert!(section(wrong).unwrap_err().contains("y,0.5"), "{wrong}");
        }
        assert_eq!(size("640x480"), Ok([640, 480]));
        for wrong in ["640", "0x10", "1x1", "99999x100", "ax b"] {
            assert!(size(wrong).unwrap_err().contains("1360x860"), "{wrong}");
        }
    }

    #[test]
    fn pictures_are_counted_before_any_is_drawn() {
        let pace = |fps| Pace { fps, ..Pace::default() };
        assert_eq!(pace(25.0).count(2.0).unwrap(), 51);
        assert_eq!(pace(25.0).count(0.0).unwrap(), 1);
        for (fps, seconds) in [(1000.0, 1e300), (25.0, 4001.0), (25.0, f64::NAN), (25.0, f64::INFINITY)] {
            let error = pace(fps).count(seconds).unwrap_err().to_string();
            assert!(error.contains("give fewer a second"), "{error}");
        }
        assert!(pace(0.0).count(1.0).unwrap_err().to_string().contains("give from 0.1"));
    }

    #[test]
    fn an_animation_goes_from_rest_to_the_state_or_says_that_nothing_moves() {
        let request = |state: &str| Request {
            body: Some("ring".into()),
            state: Some(state.parse().unwrap()),
            ..Request::default()
        };
        let mut viewer = prepared(&request("depth_mm=4 drag_mm=3")).unwrap();
        let end = viewer.shown();
        let moments = Moments::of(&viewer, &Pace { fps: 10.0, seconds: 1.0 }).unwrap();
        assert_eq!(moments.count, 11);
        moments.go_to(&mut viewer, 0);
        assert!(viewer.shown().is_some_and(|s| s.contact.is_none()));
        let mut depths = Vec::new();
        for k in 0..moments.count {
            moments.go_to(&mut viewer, k);
            depths.push(viewer.shown().and_then(|s| s.contact).map_or(0.0, |c| c.delta_z_m));
        }
        assert!(depths.iter().filter(|d| **d > 3e-3).count() > 2, "{depths:?}");
        assert_eq!(viewer.shown(), end);

        let viewer = prepared(&request("rest")).unwrap();
        let error = Moments::of(&viewer, &Pace::default()).err().unwrap().to_string();
        assert!(error.contains("nothing moves"), "{error}");
        let long = Pace { seconds: 1e9, ..Pace::default() };
        let viewer = prepared(&request("depth_mm=4")).unwrap();
        assert!(Moments::of(&viewer, &long).err().unwrap().to_string().contains("600"));
    }

    #[test]
    fn what_is_not_there_is_said() {
        let request = Request { body: Some("no-such.body".into()), ..Request::default() };
        let error = prepared(&request).unwrap_err().to_string();
        assert!(error.contains("no-such.body"), "{error}");
        let request = Request { recording: Some("a.rec".into()), ..Request::default() };
        assert!(prepared(&request).unwrap_err().to_string().contains("which body"));
    }
}
