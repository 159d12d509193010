//! A session that a program owns: a body, a device, a configuration; read and steered while it runs.

use crate::config::{ClockChoice, SessionConfig, WorkspaceSettings};
use crate::controls::{BodyChange, Change, ControlError, Controls, controls};
use crate::device_choice::DeviceChoice;
use crate::motion::{MotionScript, top};
use crate::real_time::MemoryLock;
use crate::sampled_data::{in_series, passive_up_to};
use crate::wall_clock::unix_now_s;
use crate::{
    BodyFile, Coupling, CreateError, End, Finished, GENTLE_N, HapticLoop, Header, Listener, Opened, Prepared,
    RealTime, Record, RecorderThread, Recording, RecordingFile, Records, Report, Safety, SafetyError,
    Session, Settings, StartError, Stopper, Summary, WorkspaceMap, patch_holder, path, ring,
};
use anyhow::{Context, anyhow, bail};
use glam::DVec3;
use palpate_body::stiffness::Stiffest;
use palpate_body::tensor::Principal;
use palpate_body::{Body, BodyError, BodySource, ContactModel, SlipRule, StoredBody};
use palpate_device::simulated::{Hand, HandMotion as _, Script, figures};
use palpate_device::{Capabilities, Device, OpenError, Replay, ReplaySample, Simulated, presets};
use palpate_engine::{Ablation, Contact};
use palpate_files as files;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How far above the body's top the tool is put where nothing else is said, m.
const ABOVE: f64 = 20e-3;
/// Seconds of records that the ring holds.
const RING_S: f64 = 2.0;
/// For as long as it likes, s.
const AT_LEISURE: f64 = 1e9;
/// From so many elements on a body stays in its file unless something else is said: opened into memory it would take seconds,
/// and some 200 MB a million.
const STORED_FROM: usize = 1 << 20;

/// Why a session could not be prepared or started; one message, which says what to do.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// A setting.
    #[error(transparent)]
    Setting(#[from] SafetyError),
    /// The body.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// The device can't be opened.
    #[error(transparent)]
    Device(#[from] OpenError),
    /// The threads.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The recording.
    #[error(transparent)]
    Recording(#[from] CreateError),
    /// What could not be had, where [`SessionConfig::strict`] wants all.
    #[error("{device}: {}", .refused.join("; "))]
    Strict {
        /// The device's name.
        device: String,
        /// What was refused, a line each.
        refused: Vec<String>,
    },
    /// A file, a motion script, or a device that says nothing sensible.
    #[error("{}", files::message(.0))]
    Input(#[from] anyhow::Error),
}

/// Where a body is while loops run on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyIn {
    /// All of it in memory.
    Memory,
    /// In its file, of which patches are read.
    File,
}

/// A body that sessions run on, and its file as a recording names it.
#[derive(Debug, Clone)]
pub struct SessionBody {
    /// The body.
    pub source: Arc<dyn BodySource>,
    /// Its file; empty for a body that was made in memory.
    pub file: BodyFile,
}

impl From<Body> for SessionBody {
    fn from(body: Body) -> Self {
        SessionBody { source: Arc::new(body), file: BodyFile::default() }
    }
}

impl SessionBody {
    /// The body at `path`, for contacts that slip by this rule or else the body's own. `place` is where it stays; by default
    /// in its file from a million elements on. With `digest`, the file's SHA-256 is found, as recordings want it.
    ///
    /// # Errors
    /// As [`Body::open`]; the file is changed or replaced meanwhile.
    pub fn open(
        path: &Path,
        slip: Option<SlipRule>,
        place: Option<BodyIn>,
        digest: bool,
    ) -> Result<Self, SessionError> {
        let is_large = || StoredBody::count_elements(path).is_ok_and(|count| count >= STORED_FROM);
        let open = || -> Result<Arc<dyn BodySource>, SessionError> {
            Ok(match place {
                Some(BodyIn::File) => Arc::new(StoredBody::open(path, slip)?),
                Some(BodyIn::Memory) => Arc::new(Body::open(path)?),
                // Of the few that can't stay in their files, memory may have room for some.
                None => match is_large().then(|| StoredBody::open(path, slip)) {
                    Some(Ok(stored)) => Arc::new(stored),
                    _ => Arc::new(Body::open(path)?),
                },
            })
        };
        let (source, file) = BodyFile::read_with(path, digest, open)?;
        Ok(SessionBody { source, file })
    }
}

/// A device that is to be opened, and how it goes with the body.
struct Source {
    device: Box<dyn Device>,
    /// Where it works in the body's frame; `None` puts its first pose above the body's top.
    map: Option<WorkspaceMap>,
    /// How long, s, if its poses end of themselves.
    seconds: Option<f64>,
    /// Whether its poses come from a list: they may stand still, and nothing feels the force.
    is_replay: bool,
}

/// A simulated device in a hand that does as a motion script says.
#[derive(Debug)]
pub struct HeldDevice {
    /// It.
    pub device: Simulated,
    /// What the hand does.
    pub script: Script,
    /// Where it works in the body's frame.
    pub map: WorkspaceMap,
}

impl HeldDevice {
    /// This device in this hand, at the place on `body` where the motion begins. What the motion script says of device and
    /// hand goes before both.
    ///
    /// # Errors
    /// The motion script does not go on this body; a device or hand that can't be simulated.
    pub fn new(
        body: &dyn BodySource,
        mut capabilities: Capabilities,
        hand: Hand,
        motion: &MotionScript,
    ) -> anyhow::Result<Self> {
        motion.adjust(&mut capabilities);
        let hand = motion.hand.unwrap_or(hand);
        figures::check(&capabilities, &hand)
            .map_err(|e| anyhow!("{} in this hand: {e}", capabilities.name))?;
        let [place, into] = motion.place(body)?;
        let script = motion.script(into, body.model_header().tool().radius_m())?;
        let map = WorkspaceMap { offset_m: place, ..WorkspaceMap::default() };
        let device = Simulated::new(capabilities, hand, Box::new(script.clone()));
        Ok(HeldDevice { device, script, map })
    }

    /// The one that `config` names.
    pub(crate) fn chosen(
        body: &dyn BodySource,
        preset: Option<&str>,
        config: &SessionConfig,
    ) -> anyhow::Result<Self> {
        let preset = preset.unwrap_or("touch");
        let capabilities = presets::device(preset)
            .ok_or_else(|| anyhow!("simulated:{preset}: give one of {}", presets::DEVICES.join(", ")))?;
        let (hand, _) = presets::hand(&config.hand)
            .ok_or_else(|| anyhow!("hand {}: give one of {}", config.hand, presets::HANDS.join(", ")))?;
        HeldDevice::new(body, capabilities, hand, &MotionScript::find(&config.motion, body.model_header())?)
    }
}

/// A recording's device, or a Path CSV's tool in the body's frame, at `rate_hz`.
fn replay(file: &Path, rate_hz: f64) -> anyhow::Result<Source> {
    let (samples, map): (Vec<_>, _) = if is_recording(file)? {
        let recording = Recording::open(file)?;
        let map = recording.header().map.into();
        let samples = recording.map(|r| ReplaySample {
            time_s: r.time_s,
            pose: r.sample().pose,
            buttons: r.device_buttons,
        });
        (samples.collect(), map)
    } else {
        let waypoints = path::resample(&path::read(file)?, rate_hz)?;
        let start = waypoints.first().map_or(0.0, |w| w.time_s);
        let sample = |w: &palpate_engine::Waypoint| ReplaySample {
            time_s: w.time_s - start,
            pose: palpate_device::Pose { position_m: w.pose.position_m, orientation: w.pose.orientation },
            buttons: 0,
        };
        (waypoints.iter().map(sample).collect(), WorkspaceMap::default())
    };
    if samples.is_empty() {
        bail!("{}: it holds no pose; record one first, or give a Path CSV", file.display());
    }
    Ok(Source { device: Box::new(Replay::new(samples)), map: Some(map), seconds: None, is_replay: true })
}

/// Whether a file begins as a recording does.
///
/// # Errors
/// It can't be read.
pub fn is_recording(file: &Path) -> anyhow::Result<bool> {
    use std::io::Read;
    let mut first = [0; 8];
    let read = std::fs::File::open(file).and_then(|mut f| f.read(&mut first));
    let read = read
        .with_context(|| format!("{}: can't be read; check the path and its permissions", file.display()))?;
    Ok(read == first.len() && first == crate::RECORDING_MAGIC)
}

/// The device that the configuration chooses.
fn source(body: &dyn BodySource, config: &SessionConfig) -> Result<Source, SessionError> {
    let max_force_n = config.safety.force_max_n.unwrap_or(GENTLE_N);
    Ok(match &config.device {
        DeviceChoice::Simulated(preset) => {
            let HeldDevice { device, script, map } = HeldDevice::chosen(body, preset.as_deref(), config)?;
            let seconds = Some(script.duration_s());
            Source { device: Box::new(device), map: Some(map), seconds, is_replay: false }
        }
        DeviceChoice::Replay(file) => replay(file, config.rate_hz)?,
        vendor => {
            let device = config.drivers.driver(vendor, Some(max_force_n)).ok_or_else(|| {
                anyhow!("{vendor}: built without the drivers of vendors' devices; build with the feature `devices`")
            })?;
            Source { device, map: None, seconds: None, is_replay: false }
        }
    })
}

/// The loop that `config` asks for, with an open device; and its recording's header.
pub(crate) fn haptic_loop(
    body: &dyn BodySource,
    file: &BodyFile,
    device: &mut dyn Device,
    map: Option<WorkspaceMap>,
    safety: Safety,
    config: &SessionConfig,
) -> Result<(HapticLoop, Header), SessionError> {
    let model = body.model_header();
    let mut stages = safety.stages(device.capabilities(), config.rate_hz)?;
    stages.coupling = coupling(config, body)?;
    let place = &config.workspace;
    let map = match map {
        Some(map) => place.over(map),
        None => place.above_top(device, body)?,
    };
    let map = map.checked(device.capabilities())?;
    let rule = config.slip.unwrap_or(model.slip());
    let header = Header {
        program: concat!("palpate ", env!("CARGO_PKG_VERSION")).into(),
        rate_hz: config.rate_hz,
        body: file.clone(),
        slip: rule.name().into(),
        tank: model.has_tank() && config.tank,
        partial_slip: model.has_partial_slip() && config.partial_slip,
        ablation: ablation_name(config.ablation).into(),
        device: device.capabilities().name.to_string(),
        safety: Some(safety),
        coupling_n_per_m: config.coupling_n_per_m,
        coupling_nm_per_rad: config.coupling_nm_per_rad,
        map: map.into(),
        ..Header::default()
    };
    Ok((HapticLoop::new(contact(model, rule, config), map, stages), header))
}

/// A contact that slips by this rule, and is else as `config` wants it.
fn contact(model: &ContactModel, rule: SlipRule, config: &SessionConfig) -> Contact {
    let mut contact = Contact::on(model, rule, config.ablation)
        .with_tank(model.has_tank() && config.tank)
        .with_partial_slip(model.has_partial_slip() && config.partial_slip);
    contact.set_friction_scale(config.friction_scale);
    contact
}

/// Prepares a body that is not too large for every slip rule, so that a session can go over to it: patches take along what is there
/// when they are made; a larger one only for the `rule` that it begins with. Whether they have what `consistent` reads.
pub(crate) fn serves_any_rule(body: &dyn BodySource, rule: SlipRule) -> bool {
    (rule == SlipRule::Consistent || body.element_count() < STORED_FROM)
        && body.serves(SlipRule::Consistent).is_ok()
}

fn coupling(config: &SessionConfig, body: &dyn BodySource) -> palpate_body::Result<Option<Coupling>> {
    let Some(k) = config.coupling_n_per_m else { return Ok(None) };
    let coupling = Coupling::new(k, stiffest(body)?);
    // No law has a torque yet, and so no stiffness against turning.
    Ok(Some(config.coupling_nm_per_rad.map_or(coupling, |k| coupling.with_angular(k, 0.0))))
}

/// K_max at any depth, N/m.
fn stiffest(body: &dyn BodySource) -> palpate_body::Result<f64> {
    let mut stiffest = Stiffest::default();
    body.each_response(&mut |r| stiffest.meet(r))?;
    let range_m = body.model_header().potentials().range_m();
    body.each_potential(&mut |p| stiffest.meet_coupled(p, range_m))?;
    body.each_tensor(&mut |a, u| stiffest.turn(&Principal::of(a, u)))?;
    Ok(stiffest.anywhere())
}

/// Whether a session against the machine's clock can have these settings.
fn check_live(config: &SessionConfig) -> Result<(), SafetyError> {
    config.check()?;
    if config.clock == ClockChoice::Virtual {
        let problem = "a live session goes by the machine's clock".into();
        let hint = "give `real`, or call run_virtual".into();
        return Err(SafetyError { setting: "clock", problem, hint });
    }
    Ok(())
}

/// What the device makes of a body that is this stiff: longer ways in the body than at the device make it stiffer there.
fn too_stiff(
    body: &dyn BodySource,
    map: &WorkspaceMap,
    device: &Capabilities,
    config: &SessionConfig,
) -> palpate_body::Result<Option<String>> {
    let stiffest = stiffest(body)?;
    let met = config.coupling_n_per_m.map_or(stiffest, |k| in_series(stiffest, k));
    let (felt, holds) = (met * map.scale, device.max_stiffness_n_per_m.value);
    let rate_hz = config.rate_hz;
    let passive = passive_up_to(device, 1.0 / rate_hz);
    let scaled = if map.scale == 1.0 { String::new() } else { format!(" (with a scale of {})", map.scale) };
    Ok((felt > holds.min(passive)).then(|| {
        format!(
            "the body is as stiff as {felt:.0} N/m at the handle{scaled}; the device holds {holds:.0} N/m, and its damping \
             keeps a loop of {rate_hz} Hz passive up to {passive:.0} N/m: beyond, it may hum"
        )
    }))
}

/// Where the handle is.
fn first_place(device: &mut dyn Device) -> anyhow::Result<DVec3> {
    let mut sample = device.read(0.0);
    for _ in 0..200 {
        // Some take a moment to their first pose.
        if sample.is_ok_and(|s| s.pose.position_m.iter().all(|x| x.is_finite())) {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
        sample = device.read(0.0);
    }
    let sample = sample.map_err(|fault| {
        let (name, words) = (device.capabilities().name.clone(), device.explain(fault));
        anyhow!("{name}: {words}; check that it is on and homed, and start again")
    })?;
    Ok(DVec3::from_array(sample.pose.position_m))
}

impl WorkspaceSettings {
    /// The given parts over `map`.
    fn over(&self, mut map: WorkspaceMap) -> WorkspaceMap {
        let quaternion = |[w, x, y, z]: [f64; 4]| glam::DQuat::from_xyzw(x, y, z, w);
        map.rotation = self.rotation.map_or(map.rotation, quaternion);
        map.handle_from_tool = self.handle_from_tool.map_or(map.handle_from_tool, quaternion);
        map.tip_in_handle_m = self.tip_in_handle_m.map_or(map.tip_in_handle_m, DVec3::from_array);
        map.scale = self.scale.unwrap_or(map.scale);
        map.clutch = self.clutch_button.or(map.clutch);
        map.offset_m = self.offset_m.map_or(map.offset_m, DVec3::from_array);
        map
    }

    /// The given parts; if the offset is not among them, the handle's present place is put above the body's top.
    fn above_top(&self, device: &mut dyn Device, body: &dyn BodySource) -> anyhow::Result<WorkspaceMap> {
        let mut map = self.over(WorkspaceMap::default());
        if self.offset_m.is_none() {
            let above = top(body)? + DVec3::Z * (ABOVE + body.model_header().tool().radius_m());
            map.offset_m = above - map.rotation * first_place(device)? * map.scale;
        }
        Ok(map)
    }
}

/// An ablation's name, as configurations and recordings have it.
pub fn ablation_name(ablation: Ablation) -> &'static str {
    match ablation {
        Ablation::None => "none",
        Ablation::Coordinates => "coordinates",
        Ablation::Responses => "responses",
        Ablation::Both => "both",
    }
}

/// A session that only has to be started. Nothing has been rendered yet.
#[derive(Debug)]
pub struct PreparedSession {
    session: Prepared,
    records: Records,
    header: Header,
    owned: Owned,
}

/// A session that runs. Dropped, it is stopped and waited for.
#[derive(Debug)]
pub struct LiveSession {
    session: Session,
    recorder_thread: RecorderThread,
    owned: Owned,
}

/// What belongs to a session besides its threads.
#[derive(Debug)]
struct Owned {
    capabilities: Capabilities,
    controls: Controls,
    body: SessionBody,
    config: SessionConfig,
    /// Whether patches have what the rule `consistent` reads.
    has_gradients: bool,
    map: WorkspaceMap,
    /// The slip rule that was asked for last.
    rule: SlipRule,
    notes: Vec<String>,
    advice: Option<String>,
}

/// What became of a session.
#[derive(Debug)]
pub struct Outcome {
    /// The device's name.
    pub device: String,
    /// How the loop ended.
    pub report: Report,
    /// Its statistics, and what was recorded.
    pub finished: Finished,
    /// Periods a second.
    pub rate_hz: f64,
    /// Whether it had a file to record into.
    pub is_recorded: bool,
}

impl PreparedSession {
    /// Opens the device and lays out the first patch. `memory` is what [`MemoryLock::new`] gave for all sessions side by side;
    /// without it, and where the configuration asks for one, the session has a lock of its own and gives it back at its end.
    ///
    /// # Errors
    /// See [`SessionError`]. What was opened is closed again.
    pub fn new(
        body: SessionBody,
        config: SessionConfig,
        memory: Option<Result<MemoryLock, String>>,
    ) -> Result<Self, SessionError> {
        check_live(&config)?;
        let source = source(&*body.source, &config)?;
        Self::with_source(body, source, config, memory)
    }

    /// The same with a device that is the program's own; [`SessionConfig::device`] and what goes with it count for nothing.
    ///
    /// # Errors
    /// As [`PreparedSession::new`].
    pub fn with_device(
        body: SessionBody,
        device: Box<dyn Device>,
        config: SessionConfig,
        memory: Option<Result<MemoryLock, String>>,
    ) -> Result<Self, SessionError> {
        check_live(&config)?;
        let source = Source { device, map: None, seconds: None, is_replay: false };
        Self::with_source(body, source, config, memory)
    }

    fn with_source(
        body: SessionBody,
        source: Source,
        config: SessionConfig,
        memory: Option<Result<MemoryLock, String>>,
    ) -> Result<Self, SessionError> {
        let Source { device, map, seconds, is_replay } = source;
        // Before anything is opened; the file itself is made when the session starts.
        if let Some(path) = &config.record {
            if path.exists() {
                return Err(CreateError::Exists(path.clone()).into());
            }
            files::check_target(path)?;
        }
        let mut device = Opened::new(device)?;
        let capabilities = device.capabilities().clone();
        let mut safety = config.safety;
        if is_replay {
            // Nobody feels it; what is recorded should be what the body answers.
            let (force_max_n, silence_s) = (safety.force_max_n.or(Some(1e3)), Some(AT_LEISURE));
            safety = Safety { force_max_n, silence_s, soft_start_s: 0.0, stale_s: AT_LEISURE, ..safety };
        }
        let (haptics, header) = haptic_loop(&*body.source, &body.file, &mut *device, map, safety, &config)?;
        let (recorder, records) = ring((RING_S * config.rate_hz) as usize);
        let (map, rule) = (*haptics.map(), haptics.contact().slip_rule());
        let has_gradients = serves_any_rule(&*body.source, rule);
        let advice = if is_replay { None } else { too_stiff(&*body.source, &map, &capabilities, &config)? };
        let (controls, inbox) = controls(capabilities.clone(), safety, config.rate_hz);
        let mut settings = Settings {
            seconds: config.seconds.or(seconds),
            patch_elements: config.patch_elements,
            real_time: RealTime { spin_s: config.real_time.spin_at(config.rate_hz), ..config.real_time },
            patience: config.patience,
            ..Settings::new(config.rate_hz)
        };
        if is_replay {
            settings.patience.pose_s = f64::INFINITY;
        }
        let session = Session::prepare_with(
            body.source.clone(),
            device,
            haptics,
            recorder,
            settings,
            Some(inbox),
            memory,
        )?;
        if config.strict && !session.notes().is_empty() {
            let refused = session.notes().to_vec();
            return Err(SessionError::Strict { device: capabilities.name.to_string(), refused });
        }
        let notes = session.notes().to_vec();
        let owned = Owned { capabilities, controls, body, config, has_gradients, map, rule, notes, advice };
        Ok(PreparedSession { session, records, header, owned })
    }

    /// What could not be had, a line each: known before the first force.
    pub fn notes(&self) -> &[String] {
        &self.owned.notes
    }

    /// What the hand should know of this device on this body before it touches it.
    pub fn advice(&self) -> Option<&str> {
        self.owned.advice.as_deref()
    }

    /// What the device can do.
    pub fn capabilities(&self) -> &Capabilities {
        &self.owned.capabilities
    }

    /// Something to stop it with, also before it is started.
    pub fn stopper(&self) -> Stopper {
        self.session.stopper()
    }

    /// Keeps the calling thread, and those that it starts from now on, off the haptic thread's core: for who opens a window, whose
    /// work in the system not even a real-time thread can interrupt. Does nothing where the haptic thread has no core of its own.
    ///
    /// # Errors
    /// The system refuses.
    pub fn keep_off_its_core(&self) -> std::io::Result<()> {
        self.session.keep_off_its_core()
    }

    /// Begins the recording, if there is to be one, and starts the threads: from now on there are forces.
    ///
    /// # Errors
    /// The recording can't be begun; the system gives no thread. The device is closed then.
    pub fn start(self) -> Result<LiveSession, SessionError> {
        let PreparedSession { session, records, header, owned } = self;
        let config = &owned.config;
        let header = Header { began_unix_s: unix_now_s(), ..header };
        let file =
            config.record.as_ref().map(|path| RecordingFile::create(path, false, &header)).transpose()?;
        let recorder_thread = RecorderThread::start_with(records, file, config.rate_hz, config.history)
            .map_err(StartError::from)?;
        Ok(LiveSession { session: session.start()?, recorder_thread, owned })
    }
}

impl LiveSession {
    /// Prepares and starts a session.
    ///
    /// # Errors
    /// As [`PreparedSession::new`] and [`PreparedSession::start`].
    pub fn start(body: impl Into<SessionBody>, config: SessionConfig) -> Result<Self, SessionError> {
        PreparedSession::new(body.into(), config, None)?.start()
    }

    /// What could not be had, a line each.
    pub fn notes(&self) -> &[String] {
        &self.owned.notes
    }

    /// What the hand should know of this device on this body.
    pub fn advice(&self) -> Option<&str> {
        self.owned.advice.as_deref()
    }

    /// The latest period: poses, wrench, command, contact, energies, flags, times. `None` before the first. The haptic thread
    /// writes it in any case, and does not notice who reads.
    pub fn latest(&self) -> Option<Record> {
        self.session.latest()
    }

    /// Periods of the past, as many a second as [`SessionConfig::history`] says, the oldest first.
    pub fn history(&self) -> Vec<Record> {
        self.recorder_thread.history()
    }

    /// Percentiles, counts and energies so far.
    pub fn summary(&self) -> Summary {
        self.recorder_thread.summary()
    }

    /// Calls `hear` with every period from now on, on the thread that records: it may take its time, within reason. In place of
    /// whoever listened before; `None` for nobody.
    pub fn listen(&self, hear: Option<Listener>) {
        self.recorder_thread.listen(hear);
    }

    /// What ended the recording early, once.
    pub fn recording_trouble(&self) -> Option<String> {
        self.recorder_thread.trouble()
    }

    /// What the device can do.
    pub fn capabilities(&self) -> &Capabilities {
        &self.owned.capabilities
    }

    /// To steer it from any thread.
    pub fn controls(&self) -> &Controls {
        &self.owned.controls
    }

    /// Goes over to another slip rule, through silence and the soft start.
    ///
    /// # Errors
    /// A body that began without what `consistent` reads: one of more than a million triangles, with another rule. As
    /// [`Controls::set_friction_scale`].
    pub fn set_slip_rule(&mut self, rule: SlipRule) -> Result<(), ControlError> {
        if rule == SlipRule::Consistent && !self.owned.has_gradients {
            let words = "the body is too large to be prepared for `consistent` beside; start with that rule, and go over";
            return Err(ControlError::Body(words.into()));
        }
        self.owned.controls.send(Change::Slip(rule))?;
        self.owned.rule = rule;
        Ok(())
    }

    /// Goes over to another body, through silence and the soft start. Map, slip rule and friction scale stay: a tool that is then
    /// inside the new body feels nothing until it has left it. The ledger begins anew. [`LiveSession::advice`] is then of the
    /// new body.
    ///
    /// # Errors
    /// A recording is under way; the body can't be read, or does not serve the slip rule; as
    /// [`Controls::set_friction_scale`].
    pub fn change_body(&mut self, body: impl Into<SessionBody>) -> Result<(), ControlError> {
        if self.owned.config.record.is_some() {
            return Err(ControlError::Recorded);
        }
        let body = body.into();
        let config = &self.owned.config;
        let refused = |e: BodyError| ControlError::Body(e.to_string());
        let header = body.source.model_header();
        let rule = self.owned.rule;
        let contact = contact(header, rule, config);
        body.source.serves(rule).map_err(refused)?;
        let has_gradients = serves_any_rule(&*body.source, rule);
        let place = self.latest().map_or([0.0; 3], |record| record.tool_position_m);
        let place = if place.iter().all(|x| x.is_finite()) { place } else { [0.0; 3] };
        let (patch_holder, finder) =
            patch_holder(body.source.clone(), place, config.patch_elements).map_err(refused)?;
        let coupling = coupling(config, &*body.source).map_err(refused)?;
        let map = &self.owned.map;
        let advice = too_stiff(&*body.source, map, &self.owned.capabilities, config).map_err(refused)?;
        let follower = self.session.follow(finder).map_err(|e| ControlError::Body(e.to_string()))?;
        let retired = self.session.retired();
        let change = BodyChange { patch_holder, contact, coupling, retired };
        if let Err(refused) = self.owned.controls.send(Change::Body(Box::new(change))) {
            follower.store(true, Ordering::Release);
            return Err(refused);
        }
        self.session.followed_by(follower);
        (self.owned.body, self.owned.has_gradients, self.owned.advice) = (body, has_gradients, advice);
        Ok(())
    }

    /// Why it has ended, if it has, and the device is closed.
    pub fn end(&self) -> Option<&End> {
        self.session.end()
    }

    /// Whether it has ended by itself.
    pub fn is_over(&self) -> bool {
        self.session.is_over()
    }

    /// Something to stop it with, from any thread.
    pub fn stopper(&self) -> Stopper {
        self.session.stopper()
    }

    /// As [`PreparedSession::keep_off_its_core`].
    ///
    /// # Errors
    /// The system refuses.
    pub fn keep_off_its_core(&self) -> std::io::Result<()> {
        self.session.keep_off_its_core()
    }

    /// Waits for the end, and for the recording's.
    pub fn join(self) -> Outcome {
        let report = self.session.join();
        let finished = self.recorder_thread.finish(&report.end.to_string());
        Outcome {
            device: self.owned.capabilities.name.to_string(),
            report,
            finished,
            rate_hz: self.owned.config.rate_hz,
            is_recorded: self.owned.config.record.is_some(),
        }
    }
}
