//! What the operating system gives a haptic thread: a clock to sleep by, a priority, a core, and memory that stays.

use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io;
use std::sync::Arc;

/// What a haptic thread asks for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RealTime {
    /// Of SCHED_FIFO, 1 to 98; `None`, 0 in a file, asks for nothing.
    #[serde(with = "priority")]
    pub priority: Option<u8>,
    /// Which core it has for its own, as far as that is this program's to say: the last of those that the program may use is
    /// 0, the one before it 1. Threads side by side should be given different ones. `None`, −1 in a file, for whichever is free.
    #[serde(with = "core_number")]
    pub core: Option<u32>,
    /// Whether the program is locked in RAM, but for the body: see [`MemoryLock`].
    pub lock_memory: bool,
    /// The last of the way to a deadline is busy-waited, s.
    pub spin_s: f64,
}

/// What is left out of a file is the default, so that nothing needs a number of its own.
mod priority {
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(priority: &Option<u8>, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u8(priority.unwrap_or(0))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u8>, D::Error> {
        Ok(Some(u8::deserialize(deserializer)?).filter(|priority| *priority > 0))
    }
}

mod core_number {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(core: &Option<u32>, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_i64(core.map_or(-1, i64::from))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u32>, D::Error> {
        match i64::deserialize(deserializer)? {
            -1 => Ok(None),
            core => u32::try_from(core)
                .map(Some)
                .map_err(|_| D::Error::custom(format!("core {core}; count from 0"))),
        }
    }
}

impl Default for RealTime {
    fn default() -> Self {
        RealTime { priority: Some(80), core: Some(0), lock_memory: true, spin_s: SPIN }
    }
}

/// After a sleep caches and the machine's host take this long to settle, s.
const SPIN: f64 = 200e-6;
/// Of a period no more is spent busy-waiting.
const SPIN_SHARE: f64 = 0.4;

impl RealTime {
    /// The usual, for this many periods a second.
    pub fn at(rate_hz: f64) -> Self {
        RealTime { spin_s: SPIN.min(SPIN_SHARE / rate_hz), ..RealTime::default() }
    }
}

impl RealTime {
    /// What is busy-waited in a loop of so many periods a second, s: the usual time only as far as a period allows it.
    pub(crate) fn spin_at(&self, rate_hz: f64) -> f64 {
        if self.spin_s == SPIN { RealTime::at(rate_hz).spin_s } else { self.spin_s }
    }
}

/// Bytes of stack that a period may use.
const STACK: usize = 256 << 10;

impl RealTime {
    /// Makes the calling thread a real-time one. What the system refuses is reported, with what to do about it, and is done
    /// without.
    pub(crate) fn enter(&self) -> (Granted, Awake) {
        // Refused or not was told when everything else was locked.
        let _ = lock_stack();
        let mut granted = Granted::default();
        let mut refused = |what: &str, error: io::Error, hint: &str| {
            granted.notes.push(format!("{what} was refused ({error}): {hint}"));
        };
        if let Some(Err(error)) = self.priority.map(system::fifo) {
            let hint = "let your user have it (rtprio in /etc/security/limits.d, or join the group realtime); the loop runs on \
                        and may be late";
            refused("real-time scheduling", error, hint);
        }
        match self.core.map(system::core_from_last) {
            Some(Ok(core)) => granted.core = core,
            Some(Err(error)) => {
                refused("a core of its own", error, "the loop runs on whichever core is free");
            }
            None => {}
        }
        (granted, Awake(self.priority.and_then(|_| system::awake())))
    }
}

/// What a thread that [entered](RealTime::enter) came to.
#[derive(Debug, Default)]
pub(crate) struct Granted {
    /// What was refused, and what to do about it.
    pub notes: Vec<String>,
    /// The core that it has for its own.
    pub core: Option<usize>,
}

/// Keeps the calling thread, and those that it starts from now on, off this core, unless there is no other.
pub(crate) fn keep_off(core: usize) -> io::Result<()> {
    system::keep_off(core)
}

/// As long as it is held, the cores don't go to sleep so deeply that waking takes them long.
#[derive(Debug)]
pub(crate) struct Awake(#[expect(dead_code, reason = "to be held, not read")] Option<File>);

/// Keeps the program in RAM, and gives that back when the last clone is dropped. The lock is the whole program's: sessions side
/// by side share one, since the end of another would unlock them all.
#[derive(Debug, Clone)]
pub struct MemoryLock(#[expect(dead_code, reason = "to be held, not read")] Arc<Locked>);

#[derive(Debug)]
struct Locked;

impl MemoryLock {
    /// Locks what the program has in memory now, and each further page of it once it has been touched.
    ///
    /// # Errors
    /// The system refuses: with what to do about it.
    pub fn new() -> Result<Self, String> {
        let lock = MemoryLock(Arc::new(Locked));
        // Given back at once if only a part of it could be had.
        lock.extend().map(|()| lock)
    }

    /// Locks what has come since.
    pub(crate) fn extend(&self) -> Result<(), String> {
        system::lock_memory().map_err(|refused| {
            format!(
                "memory that stays in RAM was refused ({refused}): raise the limit on locked memory (`ulimit -l \
                 unlimited`, or memlock in /etc/security/limits.d)"
            )
        })
    }
}

impl Drop for Locked {
    fn drop(&mut self) {
        // What can't be unlocked stays in RAM, which hurts nobody's force.
        let _ = system::unlock_memory();
    }
}

/// Fetches and locks the stack that a period may use.
#[inline(never)]
fn lock_stack() -> io::Result<()> {
    let mut pages = [0u8; STACK];
    for i in (0..STACK).step_by(1024) {
        pages[i] = 1;
    }
    system::lock(std::hint::black_box(&pages))
}

/// Nanoseconds of the monotonic clock.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clock {
    start: u64,
}

impl Clock {
    pub fn start() -> Self {
        Clock { start: system::now() }
    }

    /// Since the start.
    pub fn now(&self) -> u64 {
        system::now().saturating_sub(self.start)
    }

    /// Sleeps until `spin` before `due`. Never longer, whatever anybody does to the machine's clock.
    pub fn sleep(&self, due: u64, spin: u64) {
        if self.now() + spin < due {
            system::sleep_until(self.start + due - spin);
        }
    }

    /// Waits for `due` awake.
    pub fn spin(&self, due: u64) {
        while self.now() < due {
            std::hint::spin_loop();
        }
    }
}

#[cfg(target_os = "linux")]
mod system {
    use rustix::thread::{ClockId, CpuSet, clock_nanosleep_absolute, sched_getaffinity, sched_setaffinity};
    use rustix::time::{Timespec, clock_gettime};
    use std::fs::File;
    use std::io::{self, Write};

    pub fn now() -> u64 {
        let t = clock_gettime(ClockId::Monotonic);
        t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
    }

    pub fn sleep_until(ns: u64) {
        let request = Timespec { tv_sec: (ns / 1_000_000_000) as i64, tv_nsec: (ns % 1_000_000_000) as i64 };
        // A signal wakes it early; then the rest is busy-waited.
        let _ = clock_nanosleep_absolute(ClockId::Monotonic, &request);
    }

    /// Locks what is in memory now, and each further page once it has been touched, but fetches none for it, as a body may be
    /// larger than memory. The program's own code is fetched: else its first use would be a page fault.
    pub fn lock_memory() -> io::Result<()> {
        use rustix::mm::{MlockAllFlags, mlockall};
        mlockall(MlockAllFlags::CURRENT | MlockAllFlags::ONFAULT)?;
        let maps = std::fs::read_to_string("/proc/self/maps")?;
        maps.lines().filter_map(code).try_for_each(|(from, to)| lock_range(from, to - from))
    }

    pub fn unlock_memory() -> io::Result<()> {
        Ok(rustix::mm::munlockall()?)
    }

    pub fn lock(bytes: &[u8]) -> io::Result<()> {
        lock_range(bytes.as_ptr().addr(), bytes.len())
    }

    fn lock_range(from: usize, length: usize) -> io::Result<()> {
        #[allow(unsafe_code, reason = "locking memory is a call to the operating system")]
        // SAFETY: locking changes neither contents nor validity of what is mapped there; if nothing is, the call fails.
        unsafe {
            Ok(rustix::mm::mlock(std::ptr::without_provenance_mut(from), length)?)
        }
    }

    /// Where a line of the memory's map is code or constants of the program or a library: `from-to r-xp .. /path`.
    fn code(line: &str) -> Option<(usize, usize)> {
        let mut words = line.split_ascii_whitespace();
        let (range, rights, file) = (words.next()?, words.next()?, words.nth(3)?);
        let (from, to) = range.split_once('-')?;
        let address = |hex: &str| usize::from_str_radix(hex, 16).ok();
        let wanted = rights.starts_with('r') && !rights.contains('w') && file.starts_with('/');
        Some((address(from)?, address(to)?)).filter(|_| wanted)
    }

    pub fn fifo(priority: u8) -> io::Result<()> {
        let parameters = libc::sched_param { sched_priority: priority.clamp(1, 98).into() };
        #[allow(unsafe_code, reason = "a thread's scheduling is the operating system's")]
        // SAFETY: the pointer is to a live struct, and 0 means the calling thread.
        let refused = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) } != 0;
        if refused { Err(io::Error::last_os_error()) } else { Ok(()) }
    }

    /// The request is as old as the open file; it is for administrators, and worth no word where it is refused.
    pub fn awake() -> Option<File> {
        let mut latency = File::options().write(true).open("/dev/cpu_dma_latency").ok()?;
        latency.write_all(&0i32.to_ne_bytes()).ok()?;
        Some(latency)
    }

    /// Pins the calling thread to the `nth` core from the last of those that it may use; the first stays for others. Where
    /// there is one core, it is nobody's own.
    pub fn core_from_last(nth: u32) -> io::Result<Option<usize>> {
        let allowed = sched_getaffinity(None)?;
        if allowed.count() < 2 {
            return Ok(None);
        }
        let nth = nth % (allowed.count() - 1);
        let core = (0..CpuSet::MAX_CPU).rev().filter(|&cpu| allowed.is_set(cpu)).nth(nth as usize);
        let mut own = CpuSet::new();
        core.into_iter().for_each(|cpu| own.set(cpu));
        sched_setaffinity(None, &own)?;
        Ok(core)
    }

    pub fn keep_off(core: usize) -> io::Result<()> {
        let mut others = sched_getaffinity(None)?;
        if core < CpuSet::MAX_CPU {
            others.unset(core);
        }
        if others.count() == 0 {
            return Ok(());
        }
        Ok(sched_setaffinity(None, &others)?)
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    use std::io;
    use std::sync::OnceLock;
    use std::time::{Duration, Instant};

    pub fn now() -> u64 {
        static START: OnceLock<Instant> = OnceLock::new();
        START.get_or_init(Instant::now).elapsed().as_nanos() as u64
    }

    pub fn sleep_until(ns: u64) {
        std::thread::sleep(Duration::from_nanos(ns.saturating_sub(now())));
    }

    pub fn awake() -> Option<std::fs::File> {
        None
    }

    fn missing() -> io::Result<()> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "built for Linux only"))
    }

    pub fn lock_memory() -> io::Result<()> {
        missing()
    }

    pub fn unlock_memory() -> io::Result<()> {
        missing()
    }

    pub fn lock(_: &[u8]) -> io::Result<()> {
        missing()
    }

    pub fn fifo(_: u8) -> io::Result<()> {
        missing()
    }

    pub fn core_from_last(_: u32) -> io::Result<Option<usize>> {
        missing().map(|()| None)
    }

    pub fn keep_off(_: usize) -> io::Result<()> {
        missing()
    }
}
