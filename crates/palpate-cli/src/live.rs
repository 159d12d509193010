//! Loops against the clock: devices as the command line names them, their sessions on one body, and what they tell.

use crate::closed_loop::{in_series, passive_up_to};
use crate::console;
use anyhow::{Context, Result, anyhow, bail};
use glam::DVec3;
use palpate_body::file::Fingerprint;
use palpate_body::stiffness::Stiffest;
use palpate_body::tensor::Principal;
use palpate_body::{Body, BodyError, BodySource, SlipRule, StoredBody};
use palpate_device::simulated::{Hand, HandMotion as _, figures};
use palpate_device::{Capabilities, Device, Replay, ReplaySample, Simulated};
use palpate_engine::{Ablation, Contact};
use palpate_files as files;
use palpate_runtime::motion::MotionScript;
use palpate_runtime::path;
use palpate_runtime::{
    BodyFile, Coupling, End, Finished, HapticLoop, Header, Opened, Prepared, RecorderThread, Recording,
    RecordingFile, Report, Safety, Session, Settings, StageFlags, Stopper, Summary, WorkspaceMap, ring,
};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

/// How far above the body's top the tool is put where nothing else is said, m.
const ABOVE: f64 = 20e-3;
/// Seconds of records that the ring holds.
const RING_S: f64 = 2.0;
/// Between two lines that tell how it goes, s.
const TOLD_EVERY: Duration = Duration::from_secs(1);
/// How long what could not be had may take to be told before the first force: where nobody reads, it is told later.
const PATIENCE: Duration = Duration::from_millis(500);
/// For as long as it likes, s.
const AT_LEISURE: f64 = 1e9;
/// Between two looks at the sessions.
const PAUSE: Duration = Duration::from_millis(20);
/// From so many elements on a body stays in its file unless something else is said: opened into memory it would take seconds,
/// and some 200 MB a million.
const STORED_FROM: usize = 1 << 20;

/// Where a body is while loops run on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum BodyIn {
    /// All of it in memory.
    Memory,
    /// In its file, of which patches are read.
    File,
}

/// The body at `path`, for contacts that slip by this rule or else the body's own; and its file as a recording names it, if it
/// `is_recorded`.
///
/// # Errors
/// As [`Body::open`]; the file is changed or replaced meanwhile.
pub fn open_body(
    path: &Path,
    slip: Option<SlipRule>,
    place: Option<BodyIn>,
    is_recorded: bool,
) -> Result<(Arc<dyn BodySource>, BodyFile)> {
    let fingerprint = |file: &_| Fingerprint::of(file).map_err(|e| BodyError::io(path, e));
    let file = files::open(path)?;
    let before = fingerprint(&file)?;
    let is_large = || StoredBody::count_elements(path).is_ok_and(|count| count >= STORED_FROM);
    let body: Arc<dyn BodySource> = match place {
        Some(BodyIn::File) => Arc::new(StoredBody::open(path, slip)?),
        Some(BodyIn::Memory) => Arc::new(Body::open(path)?),
        // Of the few that can't stay in their files, memory may have room for some.
        None => match is_large().then(|| StoredBody::open(path, slip)) {
            Some(Ok(stored)) => Arc::new(stored),
            _ => Arc::new(Body::open(path)?),
        },
    };
    let sha256 = if is_recorded { files::sha256_of(file, path)? } else { String::new() };
    if fingerprint(&files::open(path)?)? != before {
        bail!("{}: it was changed while it was opened; start again", path.display());
    }
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    Ok((body, BodyFile { name, sha256 }))
}

/// A device that is to be opened, and how it goes with the body.
pub struct Hold {
    /// It.
    pub device: Box<dyn Device>,
    /// Where it works in the body's frame; `None` puts its first pose above the body's top.
    pub map: Option<WorkspaceMap>,
    /// How long, s, if its poses end of themselves.
    pub seconds: Option<f64>,
    /// Whether its poses come from a list: they may stand still, and nothing feels the force.
    pub is_replay: bool,
}

/// What all devices have in common.
#[derive(Debug, Clone)]
pub struct LivePlan {
    /// The body's file.
    pub body: BodyFile,
    /// Threads.
    pub settings: Settings,
    /// Output stages.
    pub safety: Safety,
    /// In place of the body's own.
    pub slip: Option<SlipRule>,
    /// Whether slip goes without the body's tank.
    pub no_tank: bool,
    /// Interpolations taken away.
    pub ablation: Ablation,
    /// A virtual coupling of this stiffness, N/m.
    pub coupling_n_per_m: Option<f64>,
    /// What of the map is given.
    pub place: Place,
    /// Files to record into, one for each device, or none.
    pub record: Vec<PathBuf>,
    /// Whether anything that could not be had is an error.
    pub strict: bool,
    /// Whether the output is JSON.
    pub json: bool,
}

/// What of a workspace map is given.
#[derive(Debug, Clone, Copy, Default)]
pub struct Place {
    /// Body's way per device's way.
    pub scale: Option<f64>,
    /// Where the device's origin is in the body, m.
    pub offset_m: Option<DVec3>,
    /// w x y z, body from device.
    pub rotation: Option<[f64; 4]>,
    /// The clutch's button.
    pub clutch: Option<u32>,
}

/// The report of a loop that ended.
#[derive(Debug, Serialize)]
pub struct Told {
    /// The device.
    pub device: String,
    /// Why it ended.
    pub end: String,
    /// Whether that is as it should be.
    pub well: bool,
    /// Hz.
    pub rate_hz: f64,
    /// Times, counts, energies.
    pub statistics: Summary,
    /// Page faults of the haptic thread after its first period.
    pub page_faults: u64,
    /// Steps in which the contact point waited at a patch's edge.
    pub fenced: u64,
    /// Records that were written.
    pub recorded: Option<u64>,
    /// What ended the recording early.
    pub recording_trouble: Option<String>,
}

/// How a loop is going.
#[derive(Serialize)]
struct Live<'a> {
    device: &'a str,
    #[serde(flatten)]
    summary: &'a Summary,
}

/// A simulated device in a hand that does as the motion script says.
///
/// # Errors
/// The motion script does not go on this body; a device or hand that can't be simulated.
pub fn simulated(
    body: &dyn BodySource,
    mut capabilities: Capabilities,
    hand: Hand,
    intent: &MotionScript,
) -> Result<Hold> {
    intent.adjust(&mut capabilities);
    let hand = intent.hand.unwrap_or(hand);
    figures::check(&capabilities, &hand).map_err(|e| anyhow!("{} in this hand: {e}", capabilities.name))?;
    let [place, into] = intent.place(body)?;
    let script = intent.script(into, body.model_header().tool().radius_m())?;
    let seconds = Some(script.duration_s());
    let map = Some(WorkspaceMap { offset_m: place, ..WorkspaceMap::default() });
    Ok(Hold {
        device: Box::new(Simulated::new(capabilities, hand, Box::new(script))),
        map,
        seconds,
        is_replay: false,
    })
}

/// A recording's device, or a Path CSV's tool in the body's frame, at `rate_hz`.
///
/// # Errors
/// The file is neither; it holds no pose.
pub fn replay(file: &Path, rate_hz: f64) -> Result<Hold> {
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
    Ok(Hold { device: Box::new(Replay::new(samples)), map: Some(map), seconds: None, is_replay: true })
}

/// Whether a file begins as a recording does.
///
/// # Errors
/// It can't be read.
pub fn is_recording(file: &Path) -> Result<bool> {
    use std::io::Read;
    let mut first = [0; 8];
    let read = std::fs::File::open(file).and_then(|mut f| f.read(&mut first));
    let read = read
        .with_context(|| format!("{}: can't be read; check the path and its permissions", file.display()))?;
    Ok(read == first.len() && first == palpate_runtime::RECORDING_MAGIC)
}

/// A session with all that belongs to it.
struct Running {
    session: Option<Session>,
    recorder_thread: RecorderThread,
    device: String,
    /// Periods in which the device rendered nothing, as far as they were told.
    idle: u64,
}

/// Runs all devices on the body until each has ended, or a signal comes. A panic anywhere in the program takes all forces off
/// before a word of it is written.
///
/// # Errors
/// What can't be begun: a device, a recording, a setting; what could not be had, if the plan is strict. Everything that was
/// begun is ended then.
pub fn run(body: &Arc<dyn BodySource>, holds: Vec<Hold>, plan: &LivePlan) -> Result<Vec<(Told, End)>> {
    let is_asked = signals()?;
    let count = holds.len();
    let teller = Teller::start(plan.json)?;
    // All are ready before the first one renders: from then on somebody watches.
    let mut ready = Vec::new();
    for (i, hold) in holds.into_iter().enumerate() {
        if !is_asked() {
            ready.push(prepare(body, hold, plan, plan.record.get(i))?);
        }
    }
    if is_asked() {
        console::note("a signal asked for the end before it began");
        return Ok(Vec::new());
    }
    let refused =
        |r: &Ready| r.session.notes().iter().map(|n| format!("{}: {n}", r.device)).collect::<Vec<_>>();
    let refused: Vec<String> = ready.iter().flat_map(refused).collect();
    if plan.strict && !refused.is_empty() {
        bail!("--strict: {}", refused.join("; "));
    }
    for note in refused.into_iter().chain(ready.iter_mut().flat_map(|r| r.advice.take())) {
        teller.tell(News::Note(note));
    }
    teller.catch_up(PATIENCE);
    stop_on_panic(ready.iter().map(|r| r.session.stopper()).collect());
    let mut running = ready.into_iter().map(Ready::start).collect::<Result<Vec<_>>>()?;
    let mut told = Instant::now();
    let mut ended: Vec<Option<Report>> = (0..count).map(|_| None).collect();
    while running.iter().any(|r| r.session.is_some()) {
        std::thread::sleep(PAUSE);
        for (one, ended) in running.iter_mut().zip(&mut ended) {
            if let Some(session) = one.session.take_if(|s| s.is_over()) {
                let report = session.join();
                // The others go on, and their hands should know.
                if !report.end.is_well() && count > 1 {
                    teller.tell(News::Note(format!("{}: its loop has ended: {}", one.device, report.end)));
                }
                *ended = Some(report);
            }
        }
        for session in running.iter().filter_map(|r| r.session.as_ref()).filter(|_| is_asked()) {
            session.stopper().stop("a signal asked for it");
        }
        if told.elapsed() >= TOLD_EVERY {
            told = Instant::now();
            for one in running.iter_mut().filter(|r| r.session.is_some()) {
                let summary = Box::new(one.recorder_thread.summary());
                let idle = summary.stages.get("idle").copied().unwrap_or_default();
                if std::mem::replace(&mut one.idle, idle) < idle {
                    teller.tell(News::Note(format!("{}: {IDLE}", one.device)));
                }
                teller.tell(News::Live { device: one.device.clone(), summary });
            }
        }
        for one in &running {
            one.recorder_thread.trouble().into_iter().for_each(|what| {
                teller.tell(News::Note(format!("{}: {what}", one.device)));
            });
        }
    }
    // Recordings have their ends before anything more is told, which may take forever.
    let finish = |(one, report): (Running, Option<Report>)| {
        let report = report?;
        let finished = one.recorder_thread.finish(&report.end.to_string());
        Some((tell(one.device, &report, finished, plan), report))
    };
    let finished: Vec<_> = running.into_iter().zip(ended).filter_map(finish).collect();
    teller.finish();
    Ok(finished.into_iter().map(|(told, report)| (told, report.end)).collect())
}

/// What is set at the first signal to stop; a second one ends the program. Ctrl-Z is one too: a program that is suspended holds
/// its last force.
fn signals() -> Result<impl Fn() -> bool> {
    static STOP: AtomicBool = AtomicBool::new(false);
    console::stop_on_signals(&STOP)?;
    let suspended = Arc::new(AtomicBool::new(false));
    #[cfg(unix)]
    signal_hook::flag::register(signal_hook::consts::SIGTSTP, suspended.clone())
        .context("Ctrl-Z can't be handled")?;
    Ok(move || STOP.load(Ordering::Relaxed) || suspended.load(Ordering::Relaxed))
}

/// Zero force first, in whatever thread a panic is: what is written about it may take forever where nobody reads.
fn stop_on_panic(stoppers: Vec<Stopper>) {
    let written = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        stoppers.iter().for_each(|stopper| stopper.stop_at_once("a panic in this program"));
        written(panic);
    }));
}

/// A loop that only has to be started.
struct Ready {
    session: Prepared,
    recorder_thread: RecorderThread,
    device: String,
    /// What the hand should know of body and device.
    advice: Option<String>,
}

impl Ready {
    fn start(self) -> Result<Running> {
        let Ready { session, recorder_thread, device, .. } = self;
        Ok(Running { session: Some(session.start()?), recorder_thread, device, idle: 0 })
    }
}

fn prepare(
    body: &Arc<dyn BodySource>,
    hold: Hold,
    plan: &LivePlan,
    record: Option<&PathBuf>,
) -> Result<Ready> {
    let LivePlan { settings, safety, coupling_n_per_m, ablation, place, .. } = plan;
    let Hold { device, map, seconds, is_replay } = hold;
    let mut device = Opened::new(device)?;
    let name = device.capabilities().name.to_string();
    let mut safety = *safety;
    if is_replay {
        // Nobody feels it; what is recorded should be what the body answers.
        let (force_max_n, silence_s) = (safety.force_max_n.or(Some(1e3)), Some(AT_LEISURE));
        safety = Safety { force_max_n, silence_s, soft_start_s: 0.0, stale_s: AT_LEISURE, ..safety };
    }
    let mut stages = safety.stages(device.capabilities(), settings.rate_hz)?;
    stages.coupling =
        coupling_n_per_m.map(|k| Ok::<_, BodyError>(Coupling::new(k, stiffest(&**body)?))).transpose()?;
    let map = match map {
        Some(map) => place.over(map),
        None => place.above_top(&mut device, &**body)?,
    };
    let map = map.checked(device.capabilities())?;
    let rule = plan.slip.unwrap_or(body.model_header().slip());
    let tank = body.model_header().has_tank() && !plan.no_tank;
    let contact = Contact::on(body.model_header(), rule, *ablation).with_tank(tank);
    let haptics = HapticLoop::new(contact, map, stages);
    let (recorder, records) = ring((RING_S * settings.rate_hz) as usize);
    let header = || Header {
        program: concat!("palpate ", env!("CARGO_PKG_VERSION")).into(),
        began_unix_s: SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .map_or(0.0, |t| t.as_secs_f64()),
        rate_hz: settings.rate_hz,
        body: plan.body.clone(),
        slip: rule.name().into(),
        tank,
        ablation: ablation_name(*ablation).into(),
        device: name.clone(),
        safety: Some(safety),
        coupling_n_per_m: *coupling_n_per_m,
        coupling_nm_per_rad: None,
        map: map.into(),
    };
    let file = record.map(|path| RecordingFile::create(path, false, &header())).transpose()?;
    let recorder_thread = RecorderThread::start(records, file, settings.rate_hz)?;
    let mut settings = *settings;
    settings.seconds = settings.seconds.or(seconds);
    if is_replay {
        settings.patience.pose_s = f64::INFINITY;
    }
    let advice = match is_replay {
        true => None,
        false => {
            let stiffest = stiffest(&**body)?;
            let met = coupling_n_per_m.map_or(stiffest, |k| in_series(stiffest, k));
            too_stiff(met, &map, device.capabilities(), settings.rate_hz)
        }
    };
    let session = Session::prepare(body.clone(), device, haptics, recorder, settings)?;
    Ok(Ready { session, recorder_thread, device: name, advice })
}

/// What the device makes of a body that is this stiff, N/m: longer ways in the body than at the device make it stiffer there.
fn too_stiff(body: f64, map: &WorkspaceMap, device: &Capabilities, rate_hz: f64) -> Option<String> {
    let (felt, holds) = (body * map.scale, device.max_stiffness_n_per_m.value);
    let passive = passive_up_to(device, 1.0 / rate_hz);
    let scaled = if map.scale == 1.0 { String::new() } else { format!(" (with --scale {})", map.scale) };
    (felt > holds.min(passive)).then(|| {
        format!(
            "{}: the body is as stiff as {felt:.0} N/m at the handle{scaled}; the device holds {holds:.0} N/m, and its damping \
             keeps a loop of {rate_hz} Hz passive up to {passive:.0} N/m: beyond, it may hum",
            device.name
        )
    })
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

/// Where the handle is.
fn first_place(device: &mut Opened) -> Result<DVec3> {
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

impl Place {
    /// The given parts over `map`.
    fn over(&self, mut map: WorkspaceMap) -> WorkspaceMap {
        if let Some([w, x, y, z]) = self.rotation {
            map.rotation = glam::DQuat::from_xyzw(x, y, z, w);
        }
        map.scale = self.scale.unwrap_or(map.scale);
        map.clutch = self.clutch.or(map.clutch);
        map.offset_m = self.offset_m.unwrap_or(map.offset_m);
        map
    }

    /// The given parts; if the offset is not among them, the handle's present place is put above the body's top.
    fn above_top(&self, device: &mut Opened, body: &dyn BodySource) -> Result<WorkspaceMap> {
        let mut map = self.over(WorkspaceMap::default());
        if self.offset_m.is_none() {
            let above = palpate_runtime::motion::top(body)?
                + DVec3::Z * (ABOVE + body.model_header().tool().radius_m());
            map.offset_m = above - map.rotation * first_place(device)? * map.scale;
        }
        Ok(map)
    }
}

/// As `--ablate` names it.
pub fn ablation_name(ablation: Ablation) -> &'static str {
    match ablation {
        Ablation::None => "none",
        Ablation::Coordinates => "coordinates",
        Ablation::Responses => "responses",
        Ablation::Both => "both",
    }
}

/// What is reported while loops run.
enum News {
    Live {
        device: String,
        summary: Box<Summary>,
    },
    Note(String),
    /// All before it is told.
    Told(SyncSender<()>),
}

/// What a device is told to be that renders nothing.
const IDLE: &str = "it renders no force: its forces are off, nobody holds its grip, or it is not ready; when it renders again, \
                    the force ramps up";

/// Tells it from a thread of its own: where nobody reads, telling may take forever, and who watches the loops can't wait for that.
struct Teller {
    news: SyncSender<News>,
    thread: JoinHandle<()>,
}

impl Teller {
    fn start(json: bool) -> Result<Self> {
        let (news, heard) = sync_channel(64);
        let telling = move || heard.iter().try_for_each(|news| say(&news, json));
        let thread = std::thread::Builder::new().name("palpate-teller".into());
        // What can't be told is found out again with the last lines.
        let thread = thread.spawn(move || drop(telling())).context("no thread could be started")?;
        Ok(Teller { news, thread })
    }

    /// Leaves it out if what was told before has not been read.
    fn tell(&self, news: News) {
        let _ = self.news.try_send(news);
    }

    /// Waits until what was told is read, but no longer than this.
    fn catch_up(&self, patience: Duration) {
        let (told, heard) = sync_channel(1);
        self.tell(News::Told(told));
        let _ = heard.recv_timeout(patience);
    }

    /// Waits until all is told.
    fn finish(self) {
        drop(self.news);
        // A panic in it has ended the telling, and nothing else.
        let _ = self.thread.join();
    }
}

/// A line of JSON, or of words.
fn say(news: &News, json: bool) -> Result<()> {
    let (device, summary) = match news {
        News::Note(what) => {
            console::note(what);
            return Ok(());
        }
        News::Told(told) => {
            // Who asked may have given up.
            let _ = told.try_send(());
            return Ok(());
        }
        News::Live { device, summary } => (device, summary),
    };
    if json {
        return console::text(&format!("{}\n", serde_json::to_string(&Live { device, summary })?));
    }
    let us = |ns: u64| ns as f64 * 1e-3;
    console::note(&format!(
        "{device}: {:.0} s, lateness {:.0} µs (99.9 %), step {:.1} µs (99.9 %), {} overruns, stored {:.3} mJ",
        summary.time_s,
        us(summary.lateness_ns.p99_9),
        us(summary.step_ns.p99_9),
        summary.overruns,
        summary.stored_j * 1e3
    ));
    Ok(())
}

fn tell(device: String, report: &Report, finished: Finished, plan: &LivePlan) -> Told {
    let faults = report.page_faults;
    Told {
        device,
        end: report.end.to_string(),
        well: report.end.is_well(),
        rate_hz: plan.settings.rate_hz,
        statistics: finished.summary,
        page_faults: faults.minor + faults.major,
        fenced: report.haptics.as_ref().map_or(0, |h| h.contact().counters().fenced),
        recorded: (!plan.record.is_empty()).then_some(finished.written),
        recording_trouble: finished.trouble,
    }
}

impl Told {
    /// As a table.
    pub fn table(&self) -> String {
        let s = &self.statistics;
        let times = |p: &palpate_runtime::Percentiles| {
            [p.p50, p.p99, p.p99_9, p.max].map(|ns| format!("{:.1}", ns as f64 * 1e-3)).to_vec()
        };
        let mut rows = vec![["", "50 %", "99 %", "99.9 %", "most"].map(String::from).to_vec()];
        for (name, p) in [
            ("period (µs)", &s.period_ns),
            ("lateness (µs)", &s.lateness_ns),
            ("step (µs)", &s.step_ns),
            ("device's read (µs)", &s.read_ns),
            ("device's write (µs)", &s.write_ns),
        ] {
            rows.push([vec![name.to_string()], times(p)].concat());
        }
        let mj = |j: f64| format!("{:.4} mJ", j * 1e3);
        let mut facts = vec![
            ("device", self.device.clone()),
            ("ended because", self.end.clone()),
            ("time", format!("{:.3} s at {} Hz", s.time_s, self.rate_hz)),
            ("periods", s.periods.to_string()),
            ("in contact", s.periods_in_contact.to_string()),
            ("overruns", s.overruns.to_string()),
            ("page faults after the first period", self.page_faults.to_string()),
            ("waits for a patch", s.patch_waits.to_string()),
            ("given out by the engine", mj(s.out_j)),
            ("generated by slip", mj(s.generated_j)),
            ("dissipated by slip", mj(s.dissipated_j)),
        ];
        facts.extend(
            StageFlags::NAMED
                .iter()
                .filter(|(_, flag)| *flag != StageFlags::STEPPED)
                .filter_map(|(name, _)| s.stages.get(name).map(|count| (*name, format!("{count} periods")))),
        );
        if let Some(recorded) = self.recorded {
            facts.push(("recorded", format!("{recorded} periods, {} dropped", s.dropped_records)));
        }
        if let Some(trouble) = &self.recording_trouble {
            facts.push(("the recording ended early", trouble.clone()));
        }
        let facts: Vec<_> = facts.into_iter().map(|(name, value)| vec![name.to_string(), value]).collect();
        format!("{}\n{}", console::table(&rows), console::table(&facts))
    }
}
