//! From the haptic thread, through a ring, to a thread that may wait for the disk.

use super::{Record, RecordingFile};
use crate::config::History;
use crate::{Statistics, Summary};
use bytemuck::Zeroable;
use rtrb::{Consumer, Producer, RingBuffer};
use std::collections::VecDeque;
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// How often the ring is emptied.
const PAUSE: Duration = Duration::from_millis(5);
/// How old what a kill takes along may be, with as much again for a slow disk.
const FLUSH: Duration = Duration::from_millis(250);

/// The haptic thread's end of the ring.
#[derive(Debug)]
pub struct Recorder {
    producer: Producer<Record>,
    dropped: Arc<AtomicU64>,
}

/// The other end, for [`RecorderThread::start`].
#[derive(Debug)]
pub struct Records {
    consumer: Consumer<Record>,
    dropped: Arc<AtomicU64>,
}

/// A ring for so many records: two seconds of them bridge most disks' pauses.
pub fn ring(capacity: usize) -> (Recorder, Records) {
    let (mut producer, mut consumer) = RingBuffer::new(capacity.max(1));
    // Every page is touched now, not by the haptic thread.
    while producer.push(Record::zeroed()).is_ok() {}
    while consumer.pop().is_ok() {}
    let dropped = Arc::new(AtomicU64::new(0));
    (Recorder { producer, dropped: dropped.clone() }, Records { consumer, dropped })
}

impl Recorder {
    /// Hands over a record; where the ring is full it is dropped, counted, and the answer `false`.
    ///
    /// # Real-time
    /// Wait-free; never allocates.
    pub fn push(&mut self, record: &Record) -> bool {
        let pushed = self.producer.push(*record).is_ok();
        if !pushed {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        pushed
    }

    /// How many records were dropped.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

/// The thread that takes records out of the ring, counts them, and writes them if there is a file. A disk that fails
/// ends the writing, not the counting.
#[derive(Debug)]
pub struct RecorderThread {
    shared: Arc<Shared>,
    dropped: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    stop: AtomicBool,
    state: Mutex<State>,
    listening: Mutex<Listening>,
}

/// What is called with every period, on the recording thread.
pub type Listener = Box<dyn FnMut(&Record) + Send>;

/// Who listens, if anybody does.
#[derive(Default)]
struct Listening(Option<Listener>);

impl std::fmt::Debug for Listening {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.0.is_some() { "Listening(somebody)" } else { "Listening(nobody)" })
    }
}

#[derive(Debug)]
struct State {
    past: Past,
    statistics: Statistics,
    /// Why the recording ends.
    reason: String,
    /// Records in the file.
    written: u64,
    /// What the disk said, and whether that was told.
    trouble: Option<(String, bool)>,
}

/// Every so many periods, up to so many.
#[derive(Debug)]
struct Past {
    every: u64,
    kept: usize,
    records: VecDeque<Record>,
}

impl State {
    fn add(&mut self, record: &Record) {
        self.statistics.add(record);
        let Past { every, kept, records } = &mut self.past;
        if *kept > 0 && record.number.is_multiple_of(*every) {
            if records.len() >= *kept {
                records.pop_front();
            }
            records.push_back(*record);
        }
    }
}

/// What became of a recording.
#[derive(Debug, Clone)]
pub struct Finished {
    /// Of all periods that came through the ring.
    pub summary: Summary,
    /// Records in the file; at least so many where the writing ended early.
    pub written: u64,
    /// What ended the writing early, if anything did.
    pub trouble: Option<String>,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        // What a panic left behind is still the best there is.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RecorderThread {
    /// Starts the thread, for a loop of `rate_hz`.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start<W: Write + Send + 'static>(
        records: Records,
        file: Option<RecordingFile<W>>,
        rate_hz: f64,
    ) -> io::Result<Self> {
        Self::start_with(records, file, rate_hz, History { seconds: 0.0, ..History::default() })
    }

    /// The same, and keeps what `history` says.
    ///
    /// # Errors
    /// As [`RecorderThread::start`].
    pub fn start_with<W: Write + Send + 'static>(
        records: Records,
        file: Option<RecordingFile<W>>,
        rate_hz: f64,
        history: History,
    ) -> io::Result<Self> {
        let kept = (history.rate_hz * history.seconds).ceil() as usize;
        let every = (rate_hz / history.rate_hz).round().max(1.0) as u64;
        let state = State {
            past: Past { every, kept, records: VecDeque::new() },
            statistics: Statistics::new(rate_hz),
            reason: "no reason was given".into(),
            written: 0,
            trouble: None,
        };
        let shared = Arc::new(Shared {
            stop: AtomicBool::new(false),
            state: Mutex::new(state),
            listening: Mutex::default(),
        });
        let dropped = records.dropped.clone();
        let thread = thread::Builder::new().name("palpate-record".into()).spawn({
            let shared = shared.clone();
            move || recorder_thread(records, file, &shared)
        })?;
        Ok(RecorderThread { shared, dropped, thread: Some(thread) })
    }

    /// What is kept of the past, the oldest first. Not for the haptic thread.
    pub fn history(&self) -> Vec<Record> {
        self.shared.state().past.records.iter().copied().collect()
    }

    /// Calls `hear` with every period from now on, on the recording thread; `None` for nobody. Not for the haptic thread.
    pub fn listen(&self, hear: Option<Listener>) {
        self.shared.listening.lock().unwrap_or_else(PoisonError::into_inner).0 = hear;
    }

    /// The statistics up to now. Not for the haptic thread.
    pub fn summary(&self) -> Summary {
        let mut summary = self.shared.state().statistics.summary();
        summary.dropped_records = self.dropped.load(Ordering::Relaxed);
        summary
    }

    /// What ended the writing, once: later calls get `None`.
    pub fn trouble(&self) -> Option<String> {
        let mut state = self.shared.state();
        let (what, told) = state.trouble.as_mut()?;
        let news = !std::mem::replace(told, true);
        news.then(|| what.clone())
    }

    /// Empties the ring, ends the file with `reason`, and ends the thread. Best called when the loop has ended: what is
    /// pushed meanwhile is left over.
    pub fn finish(mut self, reason: &str) -> Finished {
        self.shared.state().reason = reason.into();
        let panicked = self.join();
        let summary = self.summary();
        let state = self.shared.state();
        let trouble = state.trouble.as_ref().map(|(what, _)| what.clone());
        let panicked = panicked.then(|| "the thread that writes the recording panicked".into());
        Finished { summary, written: state.written, trouble: trouble.or(panicked) }
    }

    /// Whether it had panicked.
    fn join(&mut self) -> bool {
        self.shared.stop.store(true, Ordering::Release);
        self.thread.take().is_some_and(|thread| thread.join().is_err())
    }
}

impl Drop for RecorderThread {
    fn drop(&mut self) {
        self.join();
    }
}

/// The thread.
fn recorder_thread<W: Write>(mut records: Records, file: Option<RecordingFile<W>>, shared: &Shared) {
    let mut pen = Pen { file, written: 0, safe: 0, flushed: Instant::now() };
    let mut batch = Vec::new();
    loop {
        // Asked before: what was pushed before the stop is in the ring.
        let last = shared.stop.load(Ordering::Acquire);
        batch.clear();
        batch.extend((0..records.consumer.slots()).filter_map(|_| records.consumer.pop().ok()));
        let reason = {
            let mut state = shared.state();
            batch.iter().for_each(|record| state.add(record));
            last.then(|| state.reason.clone())
        };
        if let Some(hear) = &mut shared.listening.lock().unwrap_or_else(PoisonError::into_inner).0 {
            batch.iter().for_each(hear);
        }
        // Outside of the lock: a disk may take its time.
        let mut result = pen.write(&batch);
        if let (Ok(()), Some(reason)) = (&result, &reason) {
            result = pen.end(reason, records.dropped.load(Ordering::Relaxed));
        }
        let mut state = shared.state();
        if result.is_err() {
            (pen.file, pen.written) = (None, pen.safe);
        }
        state.written = pen.written;
        if let Err(error) = result {
            state
                .trouble
                .get_or_insert((format!("the recording ends here, the loop goes on: {error}"), false));
        }
        drop(state);
        if last {
            return;
        }
        thread::sleep(PAUSE);
    }
}

/// The file, if there is one and its disk did not fail.
struct Pen<W> {
    file: Option<RecordingFile<W>>,
    written: u64,
    /// Of these, those that the system has taken.
    safe: u64,
    flushed: Instant,
}

impl<W: Write> Pen<W> {
    fn write(&mut self, batch: &[Record]) -> io::Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        for record in batch {
            file.write(record)?;
            self.written += 1;
        }
        if self.flushed.elapsed() >= FLUSH {
            file.flush()?;
            (self.safe, self.flushed) = (self.written, Instant::now());
        }
        Ok(())
    }

    fn end(&mut self, reason: &str, dropped: u64) -> io::Result<()> {
        self.file.take().map_or(Ok(()), |file| file.end(reason, self.written, dropped).map(drop))
    }
}
