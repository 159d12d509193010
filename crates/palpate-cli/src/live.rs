//! Loops against the clock, as the command tells of them.

use crate::commands::Failure;
use crate::console;
use anyhow::{Context, Result};
use palpate_runtime::{
    LiveSession, Observer, Outcome, PreparedSession, Record, StageFlags, Stopper, Summary, supervise,
};
use serde::Serialize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Between two lines that tell how it goes.
const TOLD_EVERY: Duration = Duration::from_secs(1);
/// How long what could not be had may take to be told before the first force: where nobody reads, it is told later. And how long
/// loops may take to end where a library ends the program.
const PATIENCE: Duration = Duration::from_millis(500);
/// Between two looks whether a signal has come.
const LOOKS_EVERY: Duration = Duration::from_millis(5);
/// Why loops end.
const SIGNAL: &str = "a signal asked for it";
const PANIC: &str = "a panic in this program";
/// What a device is told to be that renders nothing.
const IDLE: &str = "it renders no force: its forces are off, nobody holds its grip, or it is not ready; when it renders again, \
                    the force ramps up";

/// The report of a loop that ended.
#[derive(Debug, Serialize)]
pub struct Told {
    /// The device.
    pub device: String,
    /// Why it ended.
    pub end: String,
    /// The same in a word that stays the same.
    pub end_kind: &'static str,
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

/// One period of a loop that is watched: poses in the body's frame, force and torque on the tool, and the command in the
/// device's frame.
#[derive(Serialize)]
struct State<'a> {
    device: &'a str,
    time_s: f64,
    position_m: [f64; 3],
    orientation: [f64; 4],
    force_n: [f64; 3],
    torque_nm: [f64; 3],
    command_force_n: [f64; 3],
    command_torque_nm: [f64; 3],
    /// Null without contact.
    contact_m: Option<[f64; 3]>,
    delta_z_m: f64,
    delta_r_m: f64,
    flags: Vec<&'static str>,
}

/// Runs all sessions until each has ended, or a signal comes. A panic anywhere in the program takes all forces off before a
/// word of it is written.
///
/// # Errors
/// What can't be begun: everything that was begun is ended then.
pub fn run(
    sessions: Vec<PreparedSession>,
    is_asked: &dyn Fn() -> bool,
    json: bool,
    stream_hz: Option<f64>,
) -> Result<Vec<Told>> {
    let teller = guarded(&sessions, json)?;
    let sessions = sessions.into_iter().map(PreparedSession::start).collect::<Result<Vec<_>, _>>()?;
    let now = Instant::now();
    let every = stream_hz.map(|hz| Duration::from_secs_f64(1.0 / hz));
    let watched = vec![Watched { told: now, streamed: now, idle: 0, number: u64::MAX }; sessions.len()];
    let mut watcher = Watcher { teller: &teller, watched, every };
    let stop = || is_asked().then_some(SIGNAL);
    let outcomes = supervise(sessions, &stop, &mut watcher);
    teller.finish();
    Ok(outcomes.into_iter().map(tell).collect())
}

/// Runs a session that `show` starts and shows, until that comes back. A signal ends the session whatever `show` does, and a panic
/// anywhere in the program takes the force off before a word of it is written. `None` where `show` did not start it.
///
/// # Errors
/// What `show` reports; [`Failure::Loop`] for a panic of its own. In either case it has dropped the session, and so waited for
/// its end.
pub fn show(
    session: PreparedSession,
    is_asked: &(dyn Fn() -> bool + Sync),
    show: impl FnOnce(PreparedSession) -> Result<Option<Outcome>>,
) -> Result<Option<Told>, Failure> {
    let sessions = [session];
    let teller = guarded(&sessions, false)?;
    let [session] = sessions;
    let (stopper, is_over) = (session.stopper(), AtomicBool::new(false));
    let shown = std::thread::scope(|scope| {
        let signals = std::thread::Builder::new().name("palpate-signals".into());
        // A window that is hidden may not look for long.
        signals.spawn_scoped(scope, || {
            while !is_over.load(Ordering::Acquire) {
                if is_asked() {
                    return stopper.stop(SIGNAL);
                }
                std::thread::sleep(LOOKS_EVERY);
            }
        })?;
        let shown = catch_unwind(AssertUnwindSafe(|| show(session)));
        is_over.store(true, Ordering::Release);
        anyhow::Ok(shown)
    });
    teller.finish();
    match shown? {
        Ok(outcome) => Ok(outcome?.map(tell)),
        Err(_) => Err(Failure::Loop(format!("{PANIC}: the force was taken off, and the device closed"))),
    }
}

/// Tells what the hands should know before the first force, and takes all forces off where anything panics from now on.
fn guarded(sessions: &[PreparedSession], json: bool) -> Result<Teller> {
    let teller = Teller::start(json)?;
    for session in sessions {
        let device = session.capabilities().name.to_string();
        for note in session.notes().iter().cloned().chain(session.advice().map(String::from)) {
            teller.tell(News::Note(format!("{device}: {note}")));
        }
    }
    teller.catch_up(PATIENCE);
    let stoppers: Vec<Stopper> = sessions.iter().map(PreparedSession::stopper).collect();
    stop_on_exit(&stoppers);
    stop_on_panic(stoppers);
    Ok(teller)
}

/// What is set at the first signal to stop; a second one ends the program. Ctrl-Z is one too: a program that is suspended holds
/// its last force.
///
/// # Errors
/// Signals can't be handled.
pub fn signals() -> Result<impl Fn() -> bool + Clone + Send + Sync + 'static> {
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
        stoppers.iter().for_each(|stopper| stopper.stop_at_once(PANIC));
        written(panic);
    }));
}

/// A library may end the program without asking, as Xlib does where its display is gone: zero force before that, and closed devices.
fn stop_on_exit(stoppers: &[Stopper]) {
    static ALL: Mutex<Vec<Stopper>> = Mutex::new(Vec::new());
    #[cfg(unix)]
    extern "C" fn stop() {
        let stoppers = std::mem::take(&mut *ALL.lock().unwrap_or_else(PoisonError::into_inner));
        stoppers.iter().for_each(|stopper| stopper.stop_at_once("a library has ended the program"));
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE && !stoppers.iter().all(Stopper::is_over) {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    ALL.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(stoppers);
    #[cfg(unix)]
    {
        static ONCE: std::sync::Once = std::sync::Once::new();
        ONCE.call_once(|| {
            #[allow(unsafe_code, reason = "only the C library knows that the program ends")]
            // SAFETY: `stop` is a function of the program, and does not panic.
            let _refused = unsafe { libc::atexit(stop) };
        });
    }
}

/// What was told of a session.
#[derive(Debug, Clone)]
struct Watched {
    told: Instant,
    streamed: Instant,
    /// Periods in which the device rendered nothing, as far as they were told.
    idle: u64,
    /// The last period that was streamed.
    number: u64,
}

/// Tells now and then how the sessions go.
struct Watcher<'a> {
    teller: &'a Teller,
    watched: Vec<Watched>,
    every: Option<Duration>,
}

impl Observer for Watcher<'_> {
    fn pause(&self) -> Duration {
        self.every.map_or(LOOKS_EVERY, |every| (every / 2).min(LOOKS_EVERY))
    }

    fn look(&mut self, index: usize, session: &LiveSession) {
        let Some(watched) = self.watched.get_mut(index) else { return };
        let device = || session.capabilities().name.to_string();
        if let Some(every) = self.every
            && watched.streamed.elapsed() >= every
            && let Some(record) = session.latest().filter(|r| r.number != watched.number)
        {
            // The rate holds on average, whenever this thread is asked.
            watched.streamed = (watched.streamed + every).max(Instant::now() - every);
            watched.number = record.number;
            self.teller.tell(News::State { device: device(), record: Box::new(record) });
        }
        if watched.told.elapsed() >= TOLD_EVERY {
            watched.told = Instant::now();
            let summary = Box::new(session.summary());
            let idle = summary.stages.get("idle").copied().unwrap_or_default();
            if std::mem::replace(&mut watched.idle, idle) < idle {
                self.teller.tell(News::Note(format!("{}: {IDLE}", device())));
            }
            self.teller.tell(News::Live { device: device(), summary });
        }
        if let Some(what) = session.recording_trouble() {
            self.teller.tell(News::Note(format!("{}: {what}", device())));
        }
    }

    fn ended(&mut self, _: usize, outcome: &Outcome) {
        // The others go on, and their hands should know.
        if !outcome.report.end.is_well() && self.watched.len() > 1 {
            let words = format!("{}: its loop has ended: {}", outcome.device, outcome.report.end);
            self.teller.tell(News::Note(words));
        }
    }
}

/// What is reported while loops run.
enum News {
    Live {
        device: String,
        summary: Box<Summary>,
    },
    State {
        device: String,
        record: Box<Record>,
    },
    Note(String),
    /// All before it is told.
    Told(SyncSender<()>),
}

/// Tells it from a thread of its own: where nobody reads, telling may take forever, and who watches the loops can't wait for that.
struct Teller {
    news: SyncSender<News>,
    thread: JoinHandle<()>,
}

impl Teller {
    fn start(json: bool) -> Result<Self> {
        let (news, heard) = sync_channel(256);
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
        // A panic in it has stopped the loops, and they say so.
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
        News::State { device, record } => return state(device, record),
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

fn state(device: &str, r: &Record) -> Result<()> {
    let state = State {
        device,
        time_s: r.time_s,
        position_m: r.tool_position_m,
        orientation: r.tool_orientation,
        force_n: r.force_n,
        torque_nm: r.torque_nm,
        command_force_n: r.command_force_n,
        command_torque_nm: r.command_torque_nm,
        contact_m: (r.element != Record::NONE).then_some(r.contact_position_m),
        delta_z_m: r.delta_z_m,
        delta_r_m: r.delta_r_m,
        flags: r.engine().names().chain(r.stages().names()).collect(),
    };
    console::text(&format!("{}\n", serde_json::to_string(&state)?))
}

/// What became of a session, as it is told.
pub fn tell(outcome: Outcome) -> Told {
    let Outcome { device, report, finished, rate_hz, is_recorded } = outcome;
    let faults = report.page_faults;
    Told {
        device,
        end: report.end.to_string(),
        end_kind: report.end.kind(),
        well: report.end.is_well(),
        rate_hz,
        statistics: finished.summary,
        page_faults: faults.minor + faults.major,
        fenced: report.haptics.as_ref().map_or(0, |h| h.contact().counters().fenced),
        recorded: is_recorded.then_some(finished.written),
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
