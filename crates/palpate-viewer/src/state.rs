//! The viewer without a window: what it shows, and what events do to it.
//!
//! [`Viewer::update`] takes events, [`Viewer::tick`] lets time go on and looks at sessions and work. Drawing only reads. So every
//! way through the program can be tested without a display.

use crate::camera::{Camera, CameraChoice, StandardView};
use crate::drop::{Kind, MeshQuestion, kind_of};
use crate::gallery::Example;
use crate::playback::{Playback, track};
use crate::scene::{Scene, Sight};
use crate::settings::{Settings, Undo};
use crate::shown::Shown;
use crate::subject::Subject;
use crate::touch::Touch;
use crate::work::{Done, Work};
use glam::{DVec2, DVec3};
use palpate::runtime::{Outcome, PreparedSession, Record, Summary};
use std::path::{Path, PathBuf};

/// What can happen to a viewer.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The mouse points here, from −1 to 1 to the right and upwards; `None` outside of the view.
    Point(Option<DVec2>),
    /// The keyboard moves that place.
    Nudge(DVec2),
    /// The hand begins to press, or leaves off.
    Press(bool),
    /// It wants to press deeper by this factor.
    Deepen(f64),
    /// The camera turns, rad to the right and upwards.
    Orbit(DVec2),
    /// The camera moves, in parts of the view's height.
    Pan(DVec2),
    /// The camera comes nearer by this factor.
    Zoom(f64),
    /// All of the body is to be seen.
    Fit,
    /// From a standard direction.
    Look(StandardView),
    /// Other settings.
    Change(Settings),
    /// Back to the settings before.
    Undo,
    /// Forth again.
    Redo,
    /// No force, and the device closed.
    Stop,
    /// A session anew, with the mouse as tool.
    Start,
    /// No force, or force again.
    Pause,
    /// A file was dropped or chosen.
    Open(PathBuf),
    /// One of the examples.
    Example(Example),
    /// Back to the examples.
    Gallery,
    /// To this time of the recording, s.
    Scrub(f64),
    /// The recording goes on by itself, or stops.
    Play,
    /// So many periods on.
    Frames(i64),
    /// Back from the recording to touching.
    CloseRecording,
    /// Something else about the mesh.
    Ask(MeshQuestion),
    /// The mesh's question is answered: make the body.
    Make,
    /// Leave off what is under way.
    Cancel,
    /// Go on with what was cancelled.
    GoOn,
    /// Leave off the simulation that is under way, and do what was asked for instead.
    Instead,
    /// Help, or none.
    Help,
    /// Away with whatever lies over the window.
    Dismiss,
    /// The view has another width per height.
    Resize(f64),
}

/// What is touched by what.
#[derive(Debug)]
enum Activity {
    /// Nothing moves.
    Rest,
    /// One state, which a command asked for.
    Still(Box<Still>),
    /// A session.
    Touch(Box<Touch>),
    /// A recording.
    Playback(Box<Playback>),
}

/// One state, and the way to it.
#[derive(Debug, Clone, Default)]
pub struct Still {
    /// It, and what came before, in the order of time.
    pub states: Vec<Shown>,
    /// The same for panels.
    records: Vec<Record>,
}

impl From<Vec<Shown>> for Still {
    fn from(states: Vec<Shown>) -> Self {
        Still { records: states.iter().map(Shown::record).collect(), states }
    }
}

/// The hand that the mouse leads.
#[derive(Debug, Clone, Copy, Default)]
struct Hand {
    /// Where on the view it points.
    place: Option<DVec2>,
    is_pressing: bool,
    /// The surface point there, and the way in, m.
    aim: Option<[DVec3; 2]>,
}

/// Something that has to be said.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// In a few words.
    pub title: String,
    /// What is wrong, where, and how to mend it.
    pub text: String,
}

/// How far above the surface the hand hovers, m.
const HOVER_M: f64 = 4e-3;
/// How long the track and the panels reach back, s.
pub const PAST_S: f64 = 10.0;
/// How often panels get new numbers from a session, s.
const REFRESH_S: f64 = 0.05;

/// All that the viewer is.
#[derive(Debug)]
pub struct Viewer {
    settings: Settings,
    undo: Undo,
    camera: Camera,
    subject: Option<Subject>,
    activity: Activity,
    hand: Hand,
    work: Option<Work>,
    /// What to do again where it was cancelled.
    unfinished: Option<[PathBuf; 2]>,
    question: Option<MeshQuestion>,
    /// What was asked for while a simulation is under way, which it would end.
    instead: Option<Event>,
    message: Option<Message>,
    is_help_shown: bool,
    aspect: f64,
    now_s: f64,
    refreshed_s: f64,
    records: Vec<Record>,
    summary: Option<Summary>,
    /// A session that is watched from the next tick on.
    to_watch: Option<PreparedSession>,
    /// A recording that is read as soon as the body is there.
    to_read: Option<PathBuf>,
    watched: Option<Outcome>,
    /// The latest period of a session, as of the last tick: all of a picture is of one moment.
    latest: Option<Record>,
    /// Whether a body that is opened is touched at once.
    pub touches: bool,
    /// What the mouse does is recorded into this file, by further sessions into `FILE-2` and on.
    pub record: Option<PathBuf>,
    /// Sessions that were recorded.
    recorded: u32,
}

impl Default for Viewer {
    fn default() -> Self {
        Viewer {
            settings: Settings::default(),
            undo: Undo::default(),
            camera: Camera::default(),
            subject: None,
            activity: Activity::Rest,
            hand: Hand::default(),
            work: None,
            unfinished: None,
            question: None,
            instead: None,
            message: None,
            is_help_shown: false,
            aspect: 1.0,
            now_s: 0.0,
            refreshed_s: f64::NEG_INFINITY,
            records: Vec::new(),
            summary: None,
            to_watch: None,
            to_read: None,
            watched: None,
            latest: None,
            touches: true,
            record: None,
            recorded: 0,
        }
    }
}

impl Viewer {
    /// With settings of its own.
    pub fn with_settings(settings: Settings) -> Self {
        let mut viewer = Viewer::default();
        viewer.settings = settings.checked();
        viewer
    }

    /// Shows this body, and watches a session on it that begins with the next [tick](Viewer::tick): not before there is
    /// somewhere to see it and to stop it.
    pub fn watch(&mut self, opened: crate::work::Opened, session: PreparedSession) {
        self.to_watch = Some(session);
        self.show_body(opened);
    }

    /// The session that is about to be watched.
    pub fn to_watch(&self) -> Option<&PreparedSession> {
        self.to_watch.as_ref()
    }

    /// Reads this recording once the body is there.
    pub fn read_with_body(&mut self, recording: PathBuf) {
        self.to_read = Some(recording);
    }

    /// Events, in their order.
    pub fn update(&mut self, events: impl IntoIterator<Item = Event>) {
        events.into_iter().for_each(|event| self.take(event));
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Point(place) => {
                self.hand.place = place.filter(|p| p.is_finite());
                self.lead();
            }
            Event::Nudge(by) => {
                if by.is_finite() {
                    let place = self.hand.place.unwrap_or(DVec2::ZERO) + by;
                    self.hand.place = Some(place.clamp(DVec2::NEG_ONE, DVec2::ONE));
                    self.lead();
                }
            }
            Event::Press(press) => {
                self.hand.is_pressing = press;
                self.lead();
            }
            Event::Deepen(factor) => {
                let depth = self.settings.press_depth_m * factor;
                self.change(Settings { press_depth_m: depth, ..self.settings });
                self.lead();
            }
            Event::Orbit(by) => self.camera.orbit(by),
            Event::Pan(by) => self.camera.pan(by),
            Event::Zoom(factor) => self.camera.zoom(factor),
            Event::Fit => self.camera.fit(self.subject.as_ref().map_or(DVec3::ZERO, |s| s.surface.origin)),
            Event::Look(view) => self.camera.look_from(view),
            Event::Change(settings) => self.change(settings),
            Event::Undo => {
                if let Some(settings) = self.undo.undo(self.settings) {
                    self.apply(settings);
                }
            }
            Event::Redo => {
                if let Some(settings) = self.undo.redo(self.settings) {
                    self.apply(settings);
                }
            }
            Event::Stop => {
                self.hand.is_pressing = false;
                if let Activity::Touch(touch) = &mut self.activity {
                    touch.stop();
                }
            }
            Event::Start => self.start(),
            Event::Pause => {
                if let Activity::Touch(touch) = &mut self.activity {
                    touch.pause(!touch.is_paused());
                }
            }
            Event::Open(path) => self.open(path),
            Event::Example(_) if self.is_simulating() => self.instead = Some(event),
            Event::Example(example) => self.begin(Work::make_example(example)),
            Event::Gallery => {
                self.end_activity();
                self.subject = None;
                (self.records, self.summary) = (Vec::new(), None);
            }
            Event::Scrub(time_s) => self.with_playback(|p| {
                p.is_playing = false;
                p.go_to(time_s);
            }),
            Event::Play => self.with_playback(|p| {
                p.is_playing = !p.is_playing;
                if p.is_playing && p.time_s() >= p.span_s()[1] {
                    p.go_to(p.span_s()[0]);
                }
            }),
            Event::Frames(count) => self.with_playback(|p| p.step(count)),
            Event::CloseRecording => {
                if matches!(self.activity, Activity::Playback(_)) {
                    self.end_activity();
                    self.start();
                }
            }
            Event::Ask(question) => {
                if self.question.is_some() {
                    self.question = Some(question);
                }
            }
            Event::Make if self.is_simulating() => self.instead = Some(event),
            Event::Make => self.make(),
            Event::Cancel => {
                if let Some(work) = self.work.as_ref().filter(|w| w.can_cancel) {
                    work.cancel();
                }
            }
            Event::GoOn => self.go_on(),
            Event::Instead => {
                if let Some(event) = self.instead.take() {
                    self.work = None;
                    self.take(event);
                }
            }
            Event::Help => self.is_help_shown = !self.is_help_shown,
            Event::Dismiss => {
                if self.message.take().is_none()
                    && self.instead.take().is_none()
                    && !std::mem::take(&mut self.is_help_shown)
                {
                    self.question = None;
                }
            }
            Event::Resize(aspect) => {
                if aspect.is_finite() && aspect > 0.0 {
                    self.aspect = aspect.clamp(1e-3, 1e3);
                }
            }
        }
    }

    fn with_playback(&mut self, act: impl FnOnce(&mut Playback)) {
        if let Activity::Playback(playback) = &mut self.activity {
            act(playback);
        }
    }

    fn change(&mut self, settings: Settings) {
        let settings = settings.checked();
        if settings != self.settings {
            self.undo.changed(self.now_s, self.settings, settings);
            self.apply(settings);
        }
    }

    fn apply(&mut self, settings: Settings) {
        let before = std::mem::replace(&mut self.settings, settings);
        let mut wants_anew = false;
        if let Activity::Touch(touch) = &mut self.activity
            && touch.lead.is_some()
            && !touch.is_stopped()
        {
            match touch.steer(&before, &settings) {
                Ok(steered) => wants_anew = !steered,
                Err(e) => self.message = Some(Message { title: "The session refused it".into(), text: e }),
            }
        }
        if wants_anew {
            self.start();
        }
        self.hear();
        self.lead();
    }

    /// The session is heard, or not, as is wished; where it can't be, it is said once.
    fn hear(&mut self) {
        if let Activity::Touch(touch) = &mut self.activity
            && let Err(text) = touch.hear(self.settings.sound)
        {
            self.settings.sound = false;
            self.message = Some(Message { title: "There is no sound".into(), text });
        }
    }

    /// A session with the mouse as tool, in place of whatever there was.
    fn start(&mut self) {
        self.end_activity();
        let Some(subject) = &self.subject else { return };
        // A tool that begins inside of the body feels nothing until it has left it: it begins above where it is to press.
        let at = self.target(false).unwrap_or_else(|| {
            let top = palpate::runtime::motion::top(&*subject.body).unwrap_or(subject.surface.origin);
            let place = palpate::body::BodySource::nearest(&*subject.body, top);
            let [point, into] = place.unwrap_or([top, DVec3::NEG_Z]);
            point - into * (HOVER_M + subject.body.tool().radius_m())
        });
        let record = self.record.as_ref().map(|file| numbered(file, self.recorded + 1));
        let led = Touch::led(&subject.session_body(), &self.settings, at, record);
        self.recorded += u32::from(led.is_ok());
        self.begin_touch(led);
        self.lead();
    }

    fn begin_touch(&mut self, touch: Result<Touch, String>) {
        match touch {
            Ok(touch) => self.activity = Activity::Touch(Box::new(touch)),
            Err(text) => self.message = Some(Message { title: "The session can't begin".into(), text }),
        }
        (self.records, self.summary, self.refreshed_s) = (Vec::new(), None, f64::NEG_INFINITY);
        self.latest = None;
        self.hear();
    }

    fn end_activity(&mut self) {
        if let Activity::Touch(touch) = std::mem::replace(&mut self.activity, Activity::Rest) {
            let is_watched = touch.lead.is_none();
            let outcome = touch.end();
            if is_watched {
                self.watched = Some(outcome);
            }
        }
    }

    /// Where the hand wants the tool's reference point, m, while it presses or hovers.
    fn target(&self, presses: bool) -> Option<DVec3> {
        let [point, into] = self.hand.aim?;
        let radius = self.subject.as_ref()?.body.tool().radius_m();
        let depth = if presses { self.settings.press_depth_m } else { -HOVER_M };
        Some(point + into * (depth - radius))
    }

    fn lead(&mut self) {
        let Activity::Touch(touch) = &self.activity else { return };
        if touch.lead.is_none() {
            return;
        }
        if let (Some(place), Some(subject)) = (self.hand.place, &self.subject) {
            // Beside the body the hand stays where it was last over it.
            self.hand.aim = subject.aim(self.camera.ray(place, self.aspect)).or(self.hand.aim);
        }
        if let Some(target) = self.target(self.hand.is_pressing) {
            touch.lead_to(target);
        }
    }

    fn open(&mut self, path: PathBuf) {
        match kind_of(&path) {
            Err(text) => self.message = Some(Message { title: "This can't be opened".into(), text }),
            Ok(Kind::Mesh) => self.question = Some(MeshQuestion::new(path)),
            Ok(_) if self.is_simulating() => self.instead = Some(Event::Open(path)),
            Ok(Kind::Body) => self.begin(Work::open_body(path)),
            Ok(Kind::Recording) => match &self.subject {
                Some(subject) => {
                    let work = Work::read_recording(path, subject.file.clone());
                    self.begin(work);
                }
                None => {
                    let name = path.display();
                    let text = format!(
                        "{name}: a recording is of a body; open the body first, then drop the recording"
                    );
                    self.message = Some(Message { title: "Which body?".into(), text });
                }
            },
            Ok(Kind::Spec) => {
                let absolute = std::path::absolute(&path).unwrap_or(path);
                let own = format!("{}-palpate", crate::work::stem_of(&absolute));
                // A spec that the window wrote lies in its folder.
                let folder = match absolute.parent() {
                    Some(parent)
                        if parent.file_name().is_some_and(|n| n.to_string_lossy().starts_with(&own)) =>
                    {
                        parent.to_owned()
                    }
                    _ => absolute.with_file_name(own),
                };
                self.simulate([absolute, folder]);
            }
        }
    }

    fn make(&mut self) {
        let Some(question) = &self.question else { return };
        match question.write_spec() {
            Ok(files) => {
                self.question = None;
                self.simulate(files);
            }
            Err(text) => self.message = Some(Message { title: "The body can't be made".into(), text }),
        }
    }

    fn simulate(&mut self, [spec, folder]: [PathBuf; 2]) {
        self.begin(Work::make_of_spec(spec.clone(), folder.clone()));
        self.unfinished = Some([spec, folder]);
    }

    /// Whether something is under way that took time, and would be lost.
    fn is_simulating(&self) -> bool {
        self.work.as_ref().is_some_and(|w| w.can_cancel && !w.is_cancelled())
    }

    /// Whatever was under way is left off.
    fn begin(&mut self, work: Work) {
        self.unfinished = None;
        self.work = Some(work);
    }

    /// Lets time go on to `now_s`, and looks at what has come of sessions and work.
    pub fn tick(&mut self, now_s: f64) {
        let dt = (now_s - self.now_s).clamp(0.0, 1.0);
        self.now_s = if now_s.is_finite() { now_s.max(self.now_s) } else { self.now_s };
        if let Some(done) = self.work.as_ref().and_then(Work::take) {
            self.work = None;
            self.came(done);
        }
        // Once: what comes after it is led by the mouse.
        if let Some(session) = self.to_watch.take() {
            self.end_activity();
            self.begin_touch(Touch::watched(session));
        }
        match &mut self.activity {
            Activity::Playback(playback) => playback.advance(if dt.is_finite() { dt } else { 0.0 }),
            Activity::Touch(touch) => {
                self.latest = touch.latest();
                if let Some(text) = touch.session().recording_trouble() {
                    self.message = Some(Message { title: "The recording has ended early".into(), text });
                }
                if self.now_s - self.refreshed_s >= REFRESH_S {
                    self.refreshed_s = self.now_s;
                    self.records = touch.history();
                    self.summary = Some(touch.summary());
                }
            }
            Activity::Rest | Activity::Still(..) => {}
        }
        let shown = self.shown();
        if let Some(subject) = &mut self.subject {
            subject.colour(&self.settings);
            subject.draw(shown.as_ref());
        }
    }

    fn came(&mut self, done: Done) {
        // There is nothing left to ask about.
        self.instead = None;
        match done {
            Done::Body(opened) => {
                self.end_activity();
                self.unfinished = None;
                self.hand = Hand::default();
                // What was chosen for one body is not undone on another.
                self.undo = Undo::default();
                let subject = Subject::new(*opened, &self.settings);
                self.camera = subject.camera();
                let depth = crate::place::depth_range_m(&subject.body);
                self.settings.press_depth_m = 0.7 * depth;
                self.settings.colour_depth_m = 0.5 * depth;
                self.settings = self.settings.checked();
                self.subject = Some(subject);
                if let Some(recording) = self.to_read.take() {
                    self.open(recording);
                } else if self.touches && self.to_watch.is_none() {
                    self.start();
                }
            }
            Done::Recording(playback) => {
                self.end_activity();
                self.activity = Activity::Playback(playback);
            }
            Done::Failed(text) => {
                self.unfinished = None;
                self.message = Some(Message { title: "It did not work".into(), text });
            }
            Done::Cancelled(text) => self.message = Some(Message { title: "Cancelled".into(), text }),
        }
    }

    /// Waits for what is under way: for commands, which have nothing else to do.
    ///
    /// # Errors
    /// What had to be said.
    pub fn finish_work(&mut self) -> Result<(), String> {
        while let Some(work) = self.work.take() {
            let done = work.wait();
            self.came(done);
        }
        self.message.take().map_or(Ok(()), |m| Err(m.text))
    }

    fn go_on(&mut self) {
        if let Some(files) = self.unfinished.clone().filter(|_| self.work.is_none()) {
            self.message = None;
            self.simulate(files);
        }
    }

    /// Shows the last of these states, with what came before as its past, in place of a session.
    pub fn show(&mut self, states: impl Into<Still>) {
        self.end_activity();
        self.activity = Activity::Still(Box::new(states.into()));
    }

    /// Shows a body at once.
    pub fn show_body(&mut self, opened: crate::work::Opened) {
        self.came(Done::Body(Box::new(opened)));
    }

    /// Points the camera as a command says.
    pub fn point_camera(&mut self, choice: &CameraChoice) {
        choice.apply(&mut self.camera);
    }

    /// Ends whatever runs; what a watched session came to, if one was.
    pub fn end(&mut self) -> Option<Outcome> {
        self.end_activity();
        self.watched.take()
    }

    /// The state that is shown now.
    pub fn shown(&self) -> Option<Shown> {
        match &self.activity {
            Activity::Rest => None,
            Activity::Still(still) => still.states.last().copied(),
            Activity::Touch(_) => self.latest.as_ref().map(Shown::of_record),
            Activity::Playback(playback) => playback.record().map(Shown::of_record),
        }
    }

    /// Periods of the last [`PAST_S`] seconds, for panels.
    pub fn past(&self) -> &[Record] {
        match &self.activity {
            Activity::Touch(_) => {
                let last_s = self.records.last().map_or(0.0, |r| r.time_s);
                let from = self.records.partition_point(|r| r.time_s < last_s - PAST_S);
                self.records.get(from..).unwrap_or(&[])
            }
            Activity::Playback(playback) => playback.past(PAST_S),
            Activity::Still(still) => &still.records,
            Activity::Rest => &[],
        }
    }

    /// Where the contact point has been, m.
    pub fn track(&self) -> Vec<DVec3> {
        match &self.activity {
            Activity::Rest => Vec::new(),
            _ => track(self.past()),
        }
    }

    /// The picture of now.
    pub fn scene(&self) -> Option<Scene> {
        let subject = self.subject.as_ref()?;
        let (state, track) = (self.shown(), self.track());
        let led = match &self.activity {
            Activity::Touch(touch) if !touch.is_over() => touch.lead.as_ref(),
            _ => None,
        };
        let sight = Sight {
            state: state.as_ref(),
            track: &track,
            target_m: led.map(|lead| DVec3::from_array(lead.position_m())),
            marks: self.settings.marks,
            theme: self.settings.theme,
            metres_per_newton: subject.metres_per_newton,
            section: crate::scene::section_plane(&subject.surface, self.settings.section.as_ref()),
        };
        Some(subject.scene(&sight, &self.settings, self.camera))
    }

    /// What was chosen.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether there is something to undo, and to redo.
    pub fn can_undo(&self) -> [bool; 2] {
        self.undo.can()
    }

    /// From where it is looked at.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The body on show.
    pub fn subject(&self) -> Option<&Subject> {
        self.subject.as_ref()
    }

    /// The session.
    pub fn touch(&self) -> Option<&Touch> {
        match &self.activity {
            Activity::Touch(touch) => Some(touch),
            _ => None,
        }
    }

    /// The recording.
    pub fn playback(&self) -> Option<&Playback> {
        match &self.activity {
            Activity::Playback(playback) => Some(playback),
            _ => None,
        }
    }

    /// The state that a command asked for.
    pub fn still(&self) -> Option<&Still> {
        match &self.activity {
            Activity::Still(still) => Some(still),
            _ => None,
        }
    }

    /// Percentiles and counts of the session.
    pub fn summary(&self) -> Option<&Summary> {
        self.summary.as_ref()
    }

    /// Whether the hand presses.
    pub fn is_pressing(&self) -> bool {
        self.hand.is_pressing
    }

    /// What takes time.
    pub fn work(&self) -> Option<&Work> {
        self.work.as_ref()
    }

    /// Whether something was cancelled and can go on.
    pub fn is_unfinished(&self) -> bool {
        self.unfinished.is_some() && self.work.is_none()
    }

    /// What is asked of a mesh.
    pub fn question(&self) -> Option<&MeshQuestion> {
        self.question.as_ref()
    }

    /// What was asked for while a simulation is under way: it would end that.
    pub fn instead(&self) -> Option<&Event> {
        self.instead.as_ref()
    }

    /// What has to be said.
    pub fn message(&self) -> Option<&Message> {
        self.message.as_ref()
    }

    /// Whether help lies over the window.
    pub fn is_help_shown(&self) -> bool {
        self.is_help_shown
    }

    /// Whether the picture changes by itself.
    pub fn is_moving(&self) -> bool {
        let moves = match &self.activity {
            Activity::Touch(touch) => !touch.is_over(),
            Activity::Playback(playback) => playback.is_playing,
            Activity::Rest | Activity::Still(..) => false,
        };
        let bounds = self.subject.as_ref().is_some_and(Subject::is_bounding);
        moves || bounds || self.work.is_some()
    }
}

/// The file itself for the first session; a name with a number before its extension for others.
fn numbered(file: &Path, session: u32) -> PathBuf {
    if session <= 1 {
        return file.to_path_buf();
    }
    let extension = file.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    file.with_file_name(format!("{}-{session}{extension}", crate::work::stem_of(file)))
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.end_activity();
    }
}
