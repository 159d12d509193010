//! The thread that talks to the service.

use super::message::{self, Seen, Unseen};
use super::{HaplyForceKey, START, error};
use crate::latch::Latch;
use crate::latest::{Reader, Writer, exchange};
use crate::{EmergencyStop, Fault, OpenError, Pose, Sample, Status};
use std::io::{self, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::{self, JoinHandle, Thread};
use std::time::{Duration, Instant};
use tungstenite::{Error, Message, WebSocket, http::Uri};

/// Connecting, and the inventory.
const SLOW: Duration = Duration::from_secs(2);
/// A state that takes longer is late: what is older is stale ([`super::STALE_S`]).
const LATE: Duration = Duration::from_millis(50);
/// After so many times [`LATE`] nobody waits for it any more.
const LATE_MOST: u32 = 20;
/// The loop's silence after which the position is asked for all the same.
const POLL: Duration = Duration::from_millis(2);

/// Numbers of a pose under way: count, position (3), orientation (4), velocity (3), buttons, idle.
pub(super) const POSE: usize = 13;

type Socket = WebSocket<TcpStream>;

/// What the thread needs.
#[derive(Debug)]
pub(super) struct Link {
    pub socket: Socket,
    pub id: String,
    pub key: HaplyForceKey,
    pub watchdog: Duration,
}

/// What both threads see besides poses and forces.
#[derive(Debug, Default)]
pub(super) struct Shared {
    stop: AtomicBool,
    /// An emergency stop.
    halted: AtomicBool,
    gone: AtomicBool,
    /// A fault's place in [`FAULTS`], until a state is good again.
    fault: AtomicU32,
}

/// An emergency stop, and whom to wake for it.
#[derive(Debug)]
pub(super) struct Stop {
    pub shared: Arc<Shared>,
    pub thread: Thread,
}

impl EmergencyStop for Stop {
    fn stop(&self) {
        self.shared.halted.store(true, Ordering::SeqCst);
        self.thread.unpark();
    }
}

const FAULTS: [Option<Fault>; 4] =
    [None, Some(Fault::Disconnected), Some(Fault::TimedOut), Some(Fault::Garbled)];

impl Shared {
    pub(super) fn fault(&self) -> Option<Fault> {
        if self.gone() {
            return Some(Fault::Disconnected);
        }
        FAULTS[self.fault.load(Ordering::Relaxed) as usize]
    }

    pub(super) fn gone(&self) -> bool {
        self.gone.load(Ordering::Acquire)
    }

    pub(super) fn stop(&self) {
        self.stop.store(true, Ordering::Release);
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    fn say(&self, fault: Option<Fault>) {
        let place = FAULTS.iter().position(|f| *f == fault).unwrap_or(1);
        self.fault.store(place as u32, Ordering::Relaxed);
    }
}

/// Connects to the service at `url`.
pub(super) fn connect(url: &str) -> Result<Socket, OpenError> {
    let wrong = |what: String| error(format!("{url}: {what}"), "write the address as ws://HOST:PORT");
    let uri: Uri = url.parse().map_err(|e| wrong(format!("{e}")))?;
    let (Some("ws"), Some(host)) = (uri.scheme_str(), uri.host()) else {
        return Err(wrong("no address of a WebSocket without encryption".into()));
    };
    let silent =
        |e: &dyn std::fmt::Display| error(format!("nothing answers as a WebSocket at {url}: {e}"), START);
    let bare = host.trim_matches(['[', ']']);
    let addresses = (bare, uri.port_u16().unwrap_or(80)).to_socket_addrs().map_err(|e| silent(&e))?;
    let mut tried = io::Error::from(ErrorKind::AddrNotAvailable);
    for address in addresses {
        match TcpStream::connect_timeout(&address, SLOW) {
            Ok(stream) => {
                let bounded = stream.set_read_timeout(Some(SLOW)).and(stream.set_write_timeout(Some(SLOW)));
                bounded.and(stream.set_nodelay(true)).map_err(|e| silent(&e))?;
                return tungstenite::client(url, stream).map(|(socket, _)| socket).map_err(|e| silent(&e));
            }
            Err(e) => tried = e,
        }
    }
    Err(silent(&tried))
}

/// How long a service may talk of other things before it says what there is.
const INVENTORY: Duration = Duration::from_secs(5);

/// The first message.
pub(super) fn inventory(socket: &mut Socket, url: &str) -> Result<String, OpenError> {
    let begun = Instant::now();
    loop {
        match socket.read() {
            Ok(Message::Text(text)) => return Ok(text.as_str().to_owned()),
            // A peer that only pings would go on for ever.
            Ok(_) if begun.elapsed() < INVENTORY => {}
            Ok(_) => return Err(error(format!("{url} connects, but sends no inventory"), START)),
            Err(e) => return Err(error(format!("{url} connects, but sends no inventory: {e}"), START)),
        }
    }
}

/// Starts the thread.
pub(super) fn spawn(link: Link) -> io::Result<(Reader<POSE>, Writer<3>, Arc<Shared>, JoinHandle<()>)> {
    let (poses, poses_out) = exchange();
    let (forces_in, forces) = exchange();
    let shared = Arc::new(Shared::default());
    let stream = link.socket.get_ref();
    stream.set_read_timeout(Some(LATE)).and(stream.set_write_timeout(Some(LATE)))?;
    let mut talk = Talk {
        link,
        poses,
        forces,
        end: End(shared.clone()),
        text: String::new(),
        count: 0.0,
        latch: Latch::default(),
        last: None,
    };
    let thread = thread::Builder::new().name("haply".into()).spawn(move || talk.run())?;
    Ok((poses_out, forces_in, shared, thread))
}

struct Talk {
    link: Link,
    poses: Writer<POSE>,
    forces: Reader<3>,
    end: End,
    text: String,
    count: f64,
    latch: Latch,
    /// The last state.
    last: Option<Seen>,
}

/// Says that the thread has ended, also by a panic.
struct End(Arc<Shared>);

impl Drop for End {
    fn drop(&mut self) {
        self.0.gone.store(true, Ordering::Release);
    }
}

impl Talk {
    /// One message, one state, until told to stop or the service is gone.
    fn run(&mut self) {
        let mut force = None;
        let [mut heard, mut sent] = [Instant::now(); 2];
        while !self.end.0.stopped() {
            // A service that kept this thread waiting has let go of the force meanwhile.
            if force.is_some() && sent.elapsed() > self.link.watchdog {
                self.latch.close();
            }
            if let Some(newest) = self.forces.take() {
                (force, heard) = (Some(self.latch.pass(newest)), Instant::now());
            } else if force.is_some() && heard.elapsed() > self.link.watchdog {
                self.latch.close();
            }
            if self.latch.is_closed() || self.end.0.halted.load(Ordering::SeqCst) {
                force = force.map(|_| [0.0; 3]);
            }
            sent = Instant::now();
            if self.send(force).and_then(|()| self.receive()).is_err() {
                return;
            }
            thread::park_timeout(POLL);
        }
        // Best effort: who can't hear it is gone. A service that hears nothing for a tick renders nothing.
        if self.send(Some([0.0; 3])).and_then(|()| self.receive()).is_ok()
            && self.link.socket.close(None).is_ok()
        {
            // Until it says goodbye as well, within bounds.
            (0..16).take_while(|_| self.link.socket.read().is_ok()).for_each(drop);
        }
    }

    fn send(&mut self, force_n: Option<[f64; 3]>) -> Result<(), Error> {
        message::command(&mut self.text, &self.link.id, self.link.key, force_n);
        self.link.socket.send(Message::text(self.text.as_str()))
    }

    /// Waits for the one state that answers a message. Where it is late that is said, and it is waited for on: a second
    /// message would bring two. An order to stop is not kept waiting.
    fn receive(&mut self) -> Result<(), Error> {
        let mut late = 0;
        loop {
            match self.link.socket.read() {
                Ok(Message::Text(text)) => {
                    self.tell(message::state(text.as_str(), &self.link.id));
                    return Ok(());
                }
                Ok(_) => {}
                Err(Error::Io(e)) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    self.end.0.say(Some(Fault::TimedOut));
                    late += 1;
                    if self.end.0.stopped() {
                        return Ok(());
                    }
                    if late == LATE_MOST {
                        return Err(Error::Io(e));
                    }
                }
                Err(e) => return Err(e),
            }
        }
    }

    fn tell(&mut self, state: Result<Seen, Unseen>) {
        match state {
            Ok(seen) => {
                self.count += f64::from(u8::from(self.last.is_none_or(|last| seen.is_new(&last))));
                self.last = Some(seen);
                self.poses.put(&packed(self.count, &seen, !seen.ready || self.latch.is_closed()));
                self.end.0.say(None);
            }
            Err(Unseen::Garbled) => self.end.0.say(Some(Fault::Garbled)),
            Err(Unseen::Gone) => self.end.0.say(Some(Fault::Disconnected)),
        }
    }
}

fn packed(count: f64, seen: &Seen, idle: bool) -> [f64; POSE] {
    let [x, y, z] = seen.position_m;
    let [w, i, j, k] = seen.orientation;
    let [vx, vy, vz] = seen.velocity_m_per_s.unwrap_or([f64::NAN; 3]);
    [count, x, y, z, w, i, j, k, vx, vy, vz, f64::from(seen.buttons), f64::from(u8::from(idle))]
}

/// A pose as the loop sees it.
pub(super) fn sample(pose: &[f64; POSE]) -> Sample {
    let [count, x, y, z, w, i, j, k, vx, vy, vz, buttons, idle] = *pose;
    Sample {
        sequence: count as u64,
        pose: Pose { position_m: [x, y, z], orientation: [w, i, j, k] },
        velocity_m_per_s: Some([vx, vy, vz]).filter(|v| v.iter().all(|c| c.is_finite())),
        angular_velocity_rad_per_s: None,
        buttons: buttons as u32,
        status: Status { idle: idle > 0.0, ..Status::default() },
    }
}
