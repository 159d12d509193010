//! A loop against the clock: the haptic thread and the contact finder's.
//!
//! ```text
//! device ⇄ haptic thread ──board──→ contact finder
//!             │    ↑                    │
//!             │    └──── mailbox ───────┘  patches
//!             └── ring ──→ recorder thread: statistics, recording
//! ```
//!
//! The haptic thread touches the patch, the contact, the stages, the device and the ring; never the body, the disk, or
//! anything that another thread might hold.

use crate::controls::Inbox;
use crate::finder::{Finder, PatchHolder, patch_holder};
use crate::real_time::{Clock, Granted, MemoryLock, RealTime, keep_off};
use crate::record::{Record, Recorder};
use crate::watch::{Alarm, End, Patience, Watch};
use crate::{Board, HapticLoop, Opened, PageFaults, Period, StageFlags, Timed};
use palpate_body::{BodyError, BodySource};
use palpate_device::{Command, Device, EmergencyStop, Fault, Pace};
use palpate_engine::Flags;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// How a loop is run.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Periods a second.
    pub rate_hz: f64,
    /// How long, s; `None` until somebody asks it to end.
    pub seconds: Option<f64>,
    /// Elements of a patch.
    pub patch_elements: usize,
    /// What the haptic thread asks of the system.
    pub real_time: RealTime,
    /// When the watchdogs trip.
    pub patience: Patience,
    /// Between two looks of the contact finder while there is nothing to do, s.
    pub finder_pause_s: f64,
}

impl Settings {
    /// The usual ones, for this many periods a second.
    pub fn new(rate_hz: f64) -> Self {
        Settings {
            rate_hz,
            seconds: None,
            patch_elements: crate::PATCH_ELEMENTS,
            real_time: RealTime::at(rate_hz),
            patience: Patience::default(),
            finder_pause_s: 300e-6,
        }
    }
}

/// Why a loop could not be started.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The body's file.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// The system gives no thread.
    #[error("no thread could be started: {0}")]
    Thread(#[from] std::io::Error),
}

/// What became of it.
#[derive(Debug)]
pub struct Report {
    /// Why it ended.
    pub end: End,
    /// Periods that were run.
    pub periods: u64,
    /// Patches that came without the contact point's element.
    pub refused_patches: u64,
    /// Of the haptic thread, from its second period on.
    pub page_faults: PageFaults,
    /// The loop as it was left; `None` after a panic.
    pub haptics: Option<HapticLoop>,
}

/// What the threads and the caller share.
#[derive(Debug, Default)]
struct Shared {
    asked: AtomicBool,
    /// Whether that was by an emergency stop.
    emergency_asked: AtomicBool,
    by: OnceLock<&'static str>,
    finder_gone: AtomicBool,
    /// What it said when it went.
    finder_words: OnceLock<String>,
    over: AtomicBool,
    /// Why it is.
    end: OnceLock<End>,
    /// The latest record.
    latest: Board<{ Record::BYTES / 8 }>,
    /// The device's own.
    emergency: Option<Arc<dyn EmergencyStop>>,
}

/// A loop that is running. Dropped, it is stopped and waited for.
#[derive(Debug)]
pub struct Session {
    shared: Arc<Shared>,
    haptic: Option<JoinHandle<Report>>,
    /// The core that the haptic thread has for its own.
    core: Option<usize>,
    pause: Duration,
    /// Tells the finder that it is no longer asked.
    retired: Arc<AtomicBool>,
    _memory: Option<MemoryLock>,
}

/// A loop that only has to be started: its haptic thread has all that it could have, and waits. Dropped, it closes the device.
#[derive(Debug)]
pub struct Prepared {
    /// Dropped before the session, which waits for its thread.
    go: SyncSender<()>,
    session: Session,
    notes: Vec<String>,
    finder: Finder,
    pause: Duration,
}

/// Ends a session from elsewhere, such as a signal's handler.
#[derive(Debug, Clone)]
pub struct Stopper(Arc<Shared>);

impl Stopper {
    /// Asks for the end: zero force within two periods, and a closed device. The first reason counts.
    pub fn stop(&self, by: &'static str) {
        let _ = self.0.by.set(by);
        self.0.asked.store(true, Ordering::Release);
    }

    /// Whether the loop has ended, and the device is closed.
    pub fn is_over(&self) -> bool {
        self.0.over.load(Ordering::Acquire)
    }

    /// The same as [`Stopper::stop`], with zero force before anything else, past the slew limit, by the device's own emergency stop. For the hook of
    /// a panic, which is called before a word of it is written: standard error may be one that nobody reads, and the thread
    /// that panics stands there with the device's last force.
    pub fn stop_at_once(&self, by: &'static str) {
        if let Some(device) = &self.0.emergency {
            device.stop();
        }
        self.0.emergency_asked.store(true, Ordering::Release);
        self.stop(by);
    }
}

impl Session {
    /// [Prepares](Session::prepare) it and starts both threads.
    ///
    /// # Errors
    /// As [`Session::prepare`] and [`Prepared::start`].
    pub fn start(
        body: Arc<dyn BodySource>,
        device: Opened,
        haptics: HapticLoop,
        recorder: Recorder,
        settings: Settings,
    ) -> Result<Session, StartError> {
        Self::prepare(body, device, haptics, recorder, settings)?.start()
    }

    /// Lays out the first patch around the device, locks memory, and starts the haptic thread, which asks the system for what it
    /// needs and waits: what could not be had is known ([`Prepared::notes`]) before there is a force.
    ///
    /// # Errors
    /// The body's file can't be read, or the body does not serve the contact's slip rule; the system gives no thread. The
    /// device is closed then.
    pub fn prepare(
        body: Arc<dyn BodySource>,
        device: Opened,
        haptics: HapticLoop,
        recorder: Recorder,
        settings: Settings,
    ) -> Result<Prepared, StartError> {
        Self::prepare_with(body, device, haptics, recorder, settings, None, None)
    }

    /// The same, steered through `inbox`, and with a share of a memory lock, or why it was refused.
    pub(crate) fn prepare_with(
        body: Arc<dyn BodySource>,
        mut device: Opened,
        haptics: HapticLoop,
        recorder: Recorder,
        settings: Settings,
        inbox: Option<Inbox>,
        memory: Option<Result<MemoryLock, String>>,
    ) -> Result<Prepared, StartError> {
        body.serves(haptics.contact().slip_rule())?;
        // Where it is tells where the first patch should be; a device that doesn't know yet may be anywhere.
        let place = device.read(0.0).map_or([0.0; 3], |s| haptics.map().body_from_device(&s.pose).position_m);
        let place = if place.iter().all(|x| x.is_finite()) { place } else { [0.0; 3] };
        let mut notes = device.notes().to_vec();
        let memory = match memory {
            // What came since it was made: the vendor's library, the ring.
            Some(shared) => shared.and_then(|lock| lock.extend().map(|()| lock)).map(Some),
            None if settings.real_time.lock_memory => MemoryLock::new().map(Some),
            None => Ok(None),
        };
        let memory = memory.unwrap_or_else(|refused| {
            notes.push(refused);
            None
        });
        // It may be larger than memory.
        let _ = body.unlock_memory();
        let (patch_holder, finder) = patch_holder(body, place, settings.patch_elements)?;
        let shared = Arc::new(Shared { emergency: device.emergency_stop(), ..Shared::default() });
        let (go, may_go) = sync_channel(1);
        let (tell, told) = sync_channel(1);
        let haptic = thread::Builder::new().name("palpate-haptic".into()).spawn({
            let shared = shared.clone();
            move || {
                Haptic { shared, haptics, patch_holder, recorder, settings, inbox }
                    .run(device, &tell, &may_go)
            }
        })?;
        // A thread that panics before it tells has nothing to tell.
        let granted = told.recv().unwrap_or_default();
        notes.extend(granted.notes);
        let pause = Duration::from_secs_f64(settings.finder_pause_s);
        let retired = Arc::new(AtomicBool::new(false));
        let session =
            Session { shared, haptic: Some(haptic), core: granted.core, pause, retired, _memory: memory };
        Ok(Prepared { go, session, notes, finder, pause })
    }

    /// The latest period's record; `None` before the first.
    pub fn latest(&self) -> Option<Record> {
        // The writer is done in far less than a microsecond.
        let (words, written) = (0..1000).find_map(|_| self.shared.latest.read())?;
        (written > 0).then(|| bytemuck::must_cast(words))
    }

    /// Keeps the calling thread, and those that it starts from now on, off the haptic thread's core. Does nothing where that has
    /// none of its own.
    ///
    /// # Errors
    /// The system refuses.
    pub fn keep_off_its_core(&self) -> std::io::Result<()> {
        self.core.map_or(Ok(()), keep_off)
    }

    /// Starts another finder's thread. It takes the place of the one there was once the haptic thread has
    /// gone over to its body: [`Session::followed_by`].
    pub(crate) fn follow(&self, finder: Finder) -> Result<Arc<AtomicBool>, StartError> {
        let retired = Arc::new(AtomicBool::new(false));
        spawn_finder(self.shared.clone(), retired.clone(), finder, self.pause, find)?;
        Ok(retired)
    }

    /// What lets the present finder's thread go.
    pub(crate) fn retired(&self) -> Arc<AtomicBool> {
        self.retired.clone()
    }

    /// From now on the one that [`Session::follow`] has started is the present one.
    pub(crate) fn followed_by(&mut self, follower: Arc<AtomicBool>) {
        self.retired = follower;
    }

    /// Something to stop it with.
    pub fn stopper(&self) -> Stopper {
        Stopper(self.shared.clone())
    }

    /// Why it has ended, if it has, and the device is closed.
    pub fn end(&self) -> Option<&End> {
        self.shared.end.get()
    }

    /// Whether it has ended by itself.
    pub fn is_over(&self) -> bool {
        self.haptic.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the end.
    pub fn join(mut self) -> Report {
        self.wait().unwrap_or_else(|| unreachable!("a session is waited for once"))
    }

    /// The finder ends by itself: nobody waits for one that waits for a disk.
    fn wait(&mut self) -> Option<Report> {
        let report = self.haptic.take()?.join().unwrap_or_else(|panic| Report::panicked(words(&*panic)));
        self.shared.over.store(true, Ordering::Release);
        Some(report)
    }
}

impl Prepared {
    /// What could not be had, and what to do about it: of the device (a watchdog, a calibration), and of the system (memory
    /// that stays, a priority, a core).
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Something to stop it with, now and when it runs.
    pub fn stopper(&self) -> Stopper {
        self.session.stopper()
    }

    /// As [`Session::keep_off_its_core`], before it runs.
    ///
    /// # Errors
    /// The system refuses.
    pub fn keep_off_its_core(&self) -> std::io::Result<()> {
        self.session.keep_off_its_core()
    }

    /// Starts the contact finder's thread, and lets the haptic thread go.
    ///
    /// # Errors
    /// The system gives no thread. The device is closed then.
    pub fn start(self) -> Result<Session, StartError> {
        self.start_with(find)
    }

    /// The same with another finder's thread than [`find`].
    fn start_with(
        self,
        find: impl FnOnce(Finder, &Shared, &AtomicBool, Duration) + Send + 'static,
    ) -> Result<Session, StartError> {
        let Prepared { go, session, finder, pause, .. } = self;
        spawn_finder(session.shared.clone(), session.retired.clone(), finder, pause, find)?;
        // A thread that is gone already says why when it is joined.
        let _ = go.send(());
        Ok(session)
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.stopper().stop("the session was dropped");
        self.wait();
    }
}

impl Report {
    fn panicked(words: String) -> Self {
        Report {
            end: End::Panic(words),
            periods: 0,
            refused_patches: 0,
            page_faults: PageFaults::default(),
            haptics: None,
        }
    }
}

/// A panic's own words.
fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_string());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "without a word".into())
}

/// Tells the haptic thread that the finder's has ended, however it did, unless another has taken its place.
struct Gone<'a> {
    shared: &'a Shared,
    retired: &'a AtomicBool,
}

impl Drop for Gone<'_> {
    fn drop(&mut self) {
        if !self.retired.load(Ordering::Acquire) {
            self.shared.finder_gone.store(true, Ordering::Release);
        }
    }
}

fn spawn_finder(
    shared: Arc<Shared>,
    retired: Arc<AtomicBool>,
    finder: Finder,
    pause: Duration,
    find: impl FnOnce(Finder, &Shared, &AtomicBool, Duration) + Send + 'static,
) -> Result<(), StartError> {
    thread::Builder::new().name("palpate-finder".into()).spawn(move || {
        let _gone = Gone { shared: &shared, retired: &retired };
        find(finder, &shared, &retired, pause);
    })?;
    Ok(())
}

/// The contact finder's thread.
fn find(mut finder: Finder, shared: &Shared, retired: &AtomicBool, pause: Duration) {
    while !shared.over.load(Ordering::Acquire) && !retired.load(Ordering::Acquire) {
        match finder.look() {
            Ok(true) => {}
            Ok(false) => thread::sleep(pause),
            Err(error) => {
                let _ = shared.finder_words.set(error.to_string());
                return;
            }
        }
    }
}

/// The haptic thread.
struct Haptic {
    shared: Arc<Shared>,
    haptics: HapticLoop,
    patch_holder: PatchHolder,
    recorder: Recorder,
    settings: Settings,
    inbox: Option<Inbox>,
}

/// How the periods ended, as plain data.
enum Stop {
    /// It never began.
    Unstarted,
    Done,
    Asked,
    FinderDead,
    Alarm(Alarm),
}

impl Haptic {
    fn run(mut self, device: Opened, tell: &SyncSender<Granted>, may_go: &Receiver<()>) -> Report {
        let (granted, _awake) = self.settings.real_time.enter();
        let _ = tell.send(granted);
        let goes = may_go.recv().is_ok();
        let clock = Clock::start();
        let mut device = Timed::new(device.into_inner(), move || clock.now());
        let mut tally = Tally::default();
        let ended = catch_unwind(AssertUnwindSafe(|| match goes {
            true => self.periods(&mut device, clock, &mut tally),
            false => Stop::Unstarted,
        }));
        let faults = PageFaults::of_this_thread().unwrap_or_default().since(tally.faults.unwrap_or_default());
        let ended = ended.and_then(|stop| match stop {
            // Nothing was rendered: not even zero is.
            Stop::Unstarted => Ok(stop),
            _ => catch_unwind(AssertUnwindSafe(|| self.fade(&mut device, clock, &mut tally))).map(|()| stop),
        });
        if ended.is_err() {
            // Nothing that panicked is asked again: straight to zero.
            let _ = catch_unwind(AssertUnwindSafe(|| device.write(&Command::default())));
        }
        let _ = catch_unwind(AssertUnwindSafe(|| device.close()));
        self.shared.over.store(true, Ordering::Release);
        let well = ended.is_ok();
        let end = match ended {
            Ok(Stop::Done) => End::Done,
            Ok(Stop::Asked) if self.shared.emergency_asked.load(Ordering::Acquire) => {
                End::Emergency(self.shared.by.get().copied().unwrap_or("an emergency stop"))
            }
            Ok(Stop::Asked | Stop::Unstarted) => {
                End::Asked(self.shared.by.get().copied().unwrap_or("it was stopped"))
            }
            Ok(Stop::FinderDead) => {
                self.shared.finder_words.get().map_or(End::FinderDead, |words| End::Body(words.clone()))
            }
            Ok(Stop::Alarm(Alarm::Fault(Fault::Ended))) => End::Ended,
            Ok(Stop::Alarm(Alarm::Fault(fault))) => End::Device(device.explain(fault)),
            Ok(Stop::Alarm(Alarm::Stale(s))) => End::Stale(s),
            Ok(Stop::Alarm(Alarm::Late(s))) => End::Late(s),
            Ok(Stop::Alarm(Alarm::FinderSilent(s))) => End::FinderSilent(s),
            Err(panic) => End::Panic(words(&*panic)),
        };
        let _ = self.shared.end.set(end.clone());
        Report {
            end,
            periods: tally.periods,
            refused_patches: self.patch_holder.refused(),
            page_faults: faults,
            haptics: well.then_some(self.haptics),
        }
    }

    /// Period after period, until something ends it.
    fn periods<C: Fn() -> u64 + Send>(
        &mut self,
        device: &mut Timed<Box<dyn Device>, C>,
        clock: Clock,
        tally: &mut Tally,
    ) -> Stop {
        let Settings { rate_hz, seconds, real_time, patience, .. } = self.settings;
        let (paced, spin) = (device.capabilities().pace == Pace::Device, ns(real_time.spin_s));
        let last = seconds.map_or(u64::MAX, |s| (s * rate_hz).round() as u64);
        let mut watch = Watch::new(patience);
        while tally.number <= last {
            let due = due(tally.number, rate_hz);
            if !paced {
                clock.sleep(due, spin);
            }
            if let Some(inbox) = &mut self.inbox {
                inbox.attend(&mut self.haptics, &mut self.patch_holder);
            }
            self.patch_holder.renew(self.haptics.contact_mut());
            if !paced {
                // The time is there; the caches are cold after a sleep.
                self.haptics.rehearse(self.patch_holder.patch());
                clock.spin(due);
            }
            let began = clock.now();
            let now = began as f64 * 1e-9;
            let late = if paced { 0 } else { began as i64 - due as i64 };
            if !paced {
                // Periods that were slept over are not made up for.
                tally.number = tally.number.max((now * rate_hz) as u64);
            }
            if self.shared.asked.load(Ordering::Acquire) {
                return Stop::Asked;
            }
            if self.shared.finder_gone.load(Ordering::Acquire) {
                return Stop::FinderDead;
            }
            if let Some(alarm) = watch.begin(now, late as f64 * 1e-9, self.patch_holder.link().beats()) {
                return Stop::Alarm(alarm);
            }
            let time = if paced { now } else { tally.number as f64 / rate_hz };
            let period = self.haptics.period(self.patch_holder.patch(), device, time);
            let took = (clock.now() - began).saturating_sub(device.read_ns + device.write_ns);
            let waits =
                period.flags.has(StageFlags::WAITED) || period.output.flags.has(Flags::PATCH_BOUNDARY);
            tally.waits += u64::from(waits);
            self.patch_holder.report(time, period.pose.position_m, self.haptics.contact(), waits);
            self.record(
                &period,
                tally,
                Times { began, late, took, of_device: (device.read_ns, device.write_ns) },
            );
            if let Some(alarm) = watch.end(now, period.sample.sequence, period.fault) {
                return Stop::Alarm(alarm);
            }
        }
        Stop::Done
    }

    /// Hands a period to the recorder thread, and goes on to the next.
    fn record(&mut self, period: &Period, tally: &mut Tally, times: Times) {
        let Times { began, late, took, of_device: (read_ns, write_ns) } = times;
        let mut record = Record::new(tally.number, &self.haptics, period);
        record.started_ns = began;
        record.lateness_ns = late;
        record.period_ns = if tally.periods > 0 { began - tally.began } else { 0 };
        tally.fill(&mut record, &self.patch_holder);
        record.read_ns = read_ns as u32;
        record.write_ns = write_ns as u32;
        record.step_ns = took as u32;
        self.shared.latest.write(bytemuck::must_cast_ref(&record));
        self.recorder.push(&record);
        tally.began = began;
        tally.periods += 1;
        tally.number += 1;
    }

    /// Brings the force to zero, in at most two periods, and one more for a device that did not take the first.
    fn fade<C: Fn() -> u64 + Send>(
        &mut self,
        device: &mut Timed<Box<dyn Device>, C>,
        clock: Clock,
        tally: &mut Tally,
    ) {
        for _ in 0..3 {
            let began = clock.now();
            // A device that is gone fails here too, and there is nothing more to do for it.
            let period = self.haptics.fading(device, began as f64 * 1e-9);
            self.record(&period, tally, Times { began, of_device: (0, device.write_ns), ..Times::default() });
            if self.haptics.is_silent() {
                break;
            }
            thread::sleep(Duration::from_secs_f64(1.0 / self.settings.rate_hz));
        }
    }
}

/// When a period began, how late, and what it took, ns.
#[derive(Debug, Clone, Copy, Default)]
struct Times {
    began: u64,
    late: i64,
    took: u64,
    /// Read and write.
    of_device: (u64, u64),
}

/// What is counted from period to period.
#[derive(Debug, Default)]
struct Tally {
    /// Of the period to come.
    number: u64,
    periods: u64,
    waits: u64,
    began: u64,
    faults: Option<PageFaults>,
}

impl Tally {
    /// What concerns the patch and the page faults.
    fn fill(&mut self, record: &mut Record, patch_holder: &PatchHolder) {
        let patch = patch_holder.patch();
        if record.element != Record::NONE {
            record.element = patch.global(record.element);
        }
        let (serial, count) = patch_holder.asked();
        record.patch_centre_m = patch.centre_m();
        record.patch_serial = serial;
        record.patch_count = count as u32;
        record.patch_waits = self.waits;
        let faults = PageFaults::of_this_thread().unwrap_or_default();
        // What the first period touched for the first time is behind it.
        let since = faults.since(*self.faults.get_or_insert(faults));
        record.minor_faults = since.minor as u32;
        record.major_faults = since.major as u32;
    }
}

fn ns(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

/// When period `number` is due, ns after the start.
fn due(number: u64, rate_hz: f64) -> u64 {
    (number as f64 / rate_hz * 1e9).round() as u64
}

#[cfg(test)]
mod tests;
