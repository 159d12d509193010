//! Haply's Inverse3, through the Inverse Service that Haply installs: JSON over a WebSocket on this machine.
//!
//! The service sends an inventory on connecting, and then one state for each message that it gets. A thread of the
//! driver's own (`service`) talks to it; the loop's `read` and `write` only exchange the newest pose and force with that
//! thread, wait-free, so that a service that hangs blocks no other thread. `write` wakes the thread, which sends the force at once,
//! and the state that comes back is what the next `read` gives: the pose is that of the last write plus the service's
//! round trip, so at most about one period of the loop old. `read` and `write` allocate nothing; the thread allocates for
//! every message that it parses and sends.
//!
//! A force holds for one tick of the service; the thread repeats it while the loop keeps writing. When the loop falls silent, or
//! the service has not been told anything for as long ([`HaplyOptions::watchdog_s`]), it sends none until the loop has
//! commanded zero.
//!
//! The service answers with a state whether it has a new one or not, and its states have no number. One that says that the
//! handle moves and is the same again to the bit is an old one: it is not counted in [`Sample::sequence`].

mod message;
mod service;

use crate::first_pose::first_pose;
use crate::latest::{Reader, Writer};
use crate::limit::{self, Limits};
use crate::{Basis, Capabilities, Command, Device, EmergencyStop, Fault, Figure, OpenError, Sample, presets};
use service::{Link, POSE, Shared};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Where the service listens by default.
const URL: &str = "ws://localhost:10001";
const START: &str = "install the Haply Inverse Service (docs.haply.co) and start it (on Linux: systemctl start \
                     haply-inverse-service), or name another address (--device-url)";
const PLUG: &str = "connect the Inverse3 and switch it on; the service's own page says what it sees";
/// A pose that is older, s, means that the service stands.
const STALE_S: f64 = 0.05;

/// What the service calls the vector of a force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum HaplyForceKey {
    /// `"vector"`: services after 3.1.
    #[default]
    Vector,
    /// `"values"`: service 3.1. A service of the other kind renders nothing.
    Values,
}

/// Which service, which device, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct HaplyOptions {
    /// The service's address, `ws://HOST:PORT`.
    pub url: String,
    /// Of several devices the one of this id (four letters and digits); by default the first.
    pub device_id: Option<String>,
    /// What the service calls the vector of a force.
    pub force_key: HaplyForceKey,
    /// The largest force, N, where it is lower than a guess.
    pub max_force_n: Option<f64>,
    /// No force is sent when the loop has written none, or the service was told none, for so long, s. 5 ms by default: the
    /// service renders what it was told for a tick, so that after more the hand has felt nothing for a while.
    pub watchdog_s: f64,
}

impl Default for HaplyOptions {
    fn default() -> Self {
        HaplyOptions {
            url: URL.into(),
            device_id: None,
            force_key: HaplyForceKey::default(),
            max_force_n: None,
            watchdog_s: 5e-3,
        }
    }
}

/// An Inverse3, with a VerseGrip where there is one.
#[derive(Debug)]
pub struct Haply {
    options: HaplyOptions,
    capabilities: Capabilities,
    port: Option<Port>,
    notes: Vec<String>,
}

impl Haply {
    /// A device that is not open yet.
    pub fn new(options: HaplyOptions) -> Self {
        Haply { options, capabilities: inverse3(), port: None, notes: Vec::new() }
    }
}

/// Nobody states its figures where they could be read for this; the force and stiffness of the smallest device known.
fn inverse3() -> Capabilities {
    let mut c = presets::device("touch").expect("a preset by its own name");
    let guess = |figure: &mut Figure, reason: &'static str| *figure = Figure::guessed(figure.value, reason);
    c.name = "Haply Inverse3".into();
    guess(&mut c.max_force_n, "not known: that of the smallest device in the table");
    guess(&mut c.max_stiffness_n_per_m, "not known: that of the smallest device in the table");
    guess(&mut c.mechanics.mass_kg, "not known: that of a Touch");
    guess(&mut c.mechanics.coulomb_n, "not known: that of a Touch");
    guess(&mut c.mechanics.resolution_m, "not known: that of a Touch");
    c.velocity_delay_s = Some(Figure::guessed(1e-3, "a tick of the service; not published"));
    c.mechanics.delay_s = Figure::guessed(1e-3, "the service's round trip and its tick; not measured");
    // Before the arm, above the table.
    c.workspace.centre_m = [0.0, -0.12, 0.16];
    c.workspace.half_extent_m = [0.12, 0.08, 0.12];
    c.workspace.basis = Basis::Guessed("the order of size of the arm; not measured".into());
    c.buttons = 4;
    c.rates.most_hz = 4000.0;
    c
}

fn error(problem: String, hint: &str) -> OpenError {
    OpenError { device: "haply".into(), problem, hint: hint.into() }
}

impl Device for Haply {
    fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }

    /// Connects, reads the inventory, and asks for positions without force until the first good pose.
    fn open(&mut self) -> Result<(), OpenError> {
        self.close();
        self.notes.clear();
        limit::lower("haply", &mut self.capabilities.max_force_n.clone(), self.options.max_force_n)?;
        let mut socket = service::connect(&self.options.url)?;
        let inventory = service::inventory(&mut socket, &self.options.url)?;
        let found = message::find(&inventory, self.options.device_id.as_deref())?;
        let mut capabilities = inverse3();
        capabilities.name = found.name.into();
        capabilities.sensed.rotations = if found.grip { 3 } else { 0 };
        limit::lower("haply", &mut capabilities.max_force_n, self.options.max_force_n)?;
        self.notes = found.notes;
        let watchdog = Duration::from_secs_f64(self.options.watchdog_s.clamp(1e-3, 1e3));
        let link = Link { socket, id: found.id, key: self.options.force_key, watchdog };
        let (poses, forces, shared, thread) = service::spawn(link)
            .map_err(|e| error(format!("no thread for the service: {e}"), "close other programs"))?;
        let mut port = Port {
            poses,
            forces,
            shared,
            thread: Some(thread),
            limits: Limits::of(&capabilities),
            last: [f64::NAN; POSE],
            since_s: None,
            posed: false,
            cut: false,
        };
        port.await_pose()?;
        (self.capabilities, self.port) = (capabilities, Some(port));
        Ok(())
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.port.as_mut().ok_or(Fault::NotOpen)?.read(now_s)
    }

    /// Before the first good pose nothing is rendered.
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        let port = self.port.as_mut().ok_or(Fault::NotOpen)?;
        if port.shared.gone() {
            return Err(Fault::Disconnected);
        }
        if port.posed {
            let (command, cut) = port.limits.hold(command);
            port.cut = cut;
            port.forces.put(&command.force_n);
            port.thread.as_ref().inspect(|t| t.thread().unpark());
        }
        Ok(())
    }

    fn close(&mut self) {
        self.port = None;
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn emergency_stop(&self) -> Option<Arc<dyn EmergencyStop>> {
        let port = self.port.as_ref()?;
        let thread = port.thread.as_ref()?.thread().clone();
        Some(Arc::new(service::Stop { shared: port.shared.clone(), thread }))
    }
}

/// An open connection. Dropped, in whatever way, it sends no force, closes the socket, and ends the thread.
#[derive(Debug)]
struct Port {
    poses: Reader<POSE>,
    forces: Writer<3>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    limits: Limits,
    last: [f64; POSE],
    /// When the loop first saw the last pose, s.
    since_s: Option<f64>,
    posed: bool,
    cut: bool,
}

impl Port {
    fn await_pose(&mut self) -> Result<(), OpenError> {
        let gone = || self.shared.gone().then_some(Fault::Disconnected);
        self.last = first_pose(&mut self.poses, gone).map_err(|gone| {
            let why = gone.or(self.shared.fault()).unwrap_or(Fault::TimedOut);
            error(format!("the service gives no position: {why}"), PLUG)
        })?;
        Ok(())
    }

    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        if let Some(pose) = self.poses.take() {
            // An answer is not a new pose: its number tells.
            self.since_s = self.since_s.filter(|_| pose[0] == self.last[0]);
            self.last = pose;
        }
        if let Some(fault) = self.shared.fault() {
            return Err(fault);
        }
        let since = *self.since_s.get_or_insert(now_s);
        if now_s - since > STALE_S {
            return Err(Fault::TimedOut);
        }
        let mut sample = service::sample(&self.last);
        sample.status.saturated = self.cut;
        self.posed = true;
        Ok(sample)
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.shared.stop();
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // Its waits are bounded; a panic there has already closed the socket.
            drop(thread.join());
        }
    }
}
