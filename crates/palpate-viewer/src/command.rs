//! What the command `palpate view` asks for.

use crate::camera::CameraChoice;
use crate::gallery::Example;
use crate::offscreen::{DrawError, Offscreen};
use crate::playback::Playback;
use crate::scene::Section;
use crate::settings::Settings;
use crate::state::{Event, Viewer};
use crate::still::{self, StateChoice};
use crate::window;
use crate::work::{Done, Opened, Work};
use palpate::runtime::{Outcome, SessionConfig};
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
    /// A session to be watched, in place of the mouse as tool.
    pub session: Option<SessionConfig>,
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

/// Opens the window, and waits until it is closed or `is_asked` comes true. What a watched session came to, if one was.
///
/// # Errors
/// What was given can't be opened; there is no display or no adapter.
pub fn open(request: &Request, is_asked: Box<dyn Fn() -> bool>) -> Result<Option<Outcome>, ViewError> {
    if request.state.is_some() && request.session.is_none() {
        return Ok(window::open(prepared(request)?, Vec::new(), is_asked)?);
    }
    // A session begins with its body: not before there is somewhere to show it and to stop it.
    window::display()?;
    let mut viewer = Viewer::with_settings(request.settings);
    let mut first = Vec::new();
    if let Some(config) = &request.session {
        viewer.watch(config.clone());
    }
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
    Ok(window::open(viewer, first, is_asked)?)
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

/// Pictures of a recording, `fps` a second of its time, as `frame-00000.png` and on in a folder. How many.
///
/// # Errors
/// As [`screenshot`]; no recording.
pub fn sequence(request: &Request, frame: &Frame, folder: &Path, fps: f64) -> Result<usize, ViewError> {
    if request.recording.is_none() {
        return Err(ViewError::Input("a sequence is of a recording: give --recording FILE".into()));
    }
    if !(0.1..=1000.0).contains(&fps) {
        return Err(ViewError::Input(format!("{fps} pictures a second; give from 0.1 to 1,000")));
    }
    let mut viewer = prepared(request)?;
    let [first, last] = viewer.playback().map_or([0.0; 2], Playback::span_s);
    palpate::files::make_folder(folder).map_err(|e| palpate::files::message(&e))?;
    let mut offscreen = Offscreen::new(false)?;
    let count = ((last - first) * fps).floor() as usize + 1;
    for k in 0..count {
        viewer.update([Event::Scrub(first + k as f64 / fps)]);
        viewer.tick(0.0);
        picture(&mut viewer, &mut offscreen, frame, &folder.join(format!("frame-{k:05}.png")))?;
    }
    Ok(count)
}

fn picture(
    viewer: &mut Viewer,
    offscreen: &mut Offscreen,
    frame: &Frame,
    file: &Path,
) -> Result<(), ViewError> {
    let picture = if frame.has_panels {
        offscreen.window(viewer, frame.size, frame.scale)?
    } else {
        let scene =
            viewer.scene().ok_or_else(|| ViewError::Input("there is no body to draw; name one".into()))?;
        offscreen.scene(&scene, frame.size)?
    };
    Ok(picture.save(file)?)
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
    viewer.tick(0.0);
    viewer.touches = true;
    // Bounds are shown when they are all there.
    let unknown = |viewer: &Viewer| {
        viewer.subject().is_some_and(|s| s.certificate().is_some_and(|c| c.len() < s.body.elements().len()))
    };
    if unknown(&viewer) {
        while unknown(&viewer) {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        viewer.tick(0.0);
    }
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
    fn what_is_not_there_is_said() {
        let request = Request { body: Some("no-such.body".into()), ..Request::default() };
        let error = prepared(&request).unwrap_err().to_string();
        assert!(error.contains("no-such.body"), "{error}");
        let request = Request { recording: Some("a.rec".into()), ..Request::default() };
        assert!(prepared(&request).unwrap_err().to_string().contains("which body"));
    }
}
