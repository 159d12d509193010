//! The Haply driver against a server that keeps the Inverse Service's manners: a full inventory first, then exactly one
//! state for each message.

use palpate_device::{Command, Device, Fault, Haply, HaplyForceKey, HaplyOptions, Sample};
use std::net::TcpListener;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use tungstenite::Message;

/// How the service behaves from now on.
#[derive(Debug, Clone, PartialEq)]
enum Manner {
    /// A state at this position.
    At([f64; 3]),
    /// This text in place of a state.
    Says(String),
    /// A state, but late.
    Slow(Duration),
    /// Nothing.
    Hangs,
    /// It closes the connection.
    Leaves,
}

struct Service {
    url: String,
    manner: Arc<Mutex<Manner>>,
    heard: Arc<Mutex<Vec<String>>>,
    thread: Option<JoinHandle<()>>,
}

const DEVICES: &str = r#"{"device_id":"049D","config":{"handedness":"right","extra":[1,2]},"status":{"ready":true},"state":{"cursor_position":{"x":0,"y":0,"z":0}}}"#;

fn inventory(devices: &str) -> String {
    format!(
        r#"{{"inverse3":[{devices}],"verse_grip":[],"wireless_verse_grip":[{{"device_id":"61","state":{{}}}}]}}"#
    )
}

fn state([x, y, z]: [f64; 3]) -> String {
    format!(
        r#"{{"inverse3":[{{"device_id":"0001","state":{{"cursor_position":{{"x":9,"y":9,"z":9}}}}}},
            {{"device_id":"049D","status":{{"ready":true}},"state":{{"cursor_position":{{"x":{x},"y":{y},"z":{z}}},
            "cursor_velocity":{{"x":0,"y":0,"z":0}},"current_cursor_force":{{"x":0,"y":0,"z":0}}}}}}],
            "wireless_verse_grip":[{{"device_id":"61","state":{{"orientation":{{"w":0.6,"x":0,"y":0.8,"z":0}},
            "buttons":{{"a":false,"b":true,"c":false}}}}}}]}}"#
    )
}

/// The same of a handle that moves.
fn moving(place: [f64; 3]) -> String {
    state(place)
        .replace(r#""cursor_velocity":{"x":0,"y":0,"z":0}"#, r#""cursor_velocity":{"x":0.1,"y":0.2,"z":0.3}"#)
}

impl Service {
    fn new(inventory: String) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("ws://{}", listener.local_addr().unwrap());
        let (manner, heard) = (Arc::new(Mutex::new(Manner::At([0.0; 3]))), Arc::default());
        let shared = (manner.clone(), Arc::clone(&heard));
        let thread = thread::spawn(move || serve(&listener, &inventory, &shared.0, &shared.1));
        Service { url, manner, heard, thread: Some(thread) }
    }

    fn usual() -> Self {
        Service::new(inventory(DEVICES))
    }

    fn options(&self) -> HaplyOptions {
        HaplyOptions { url: self.url.clone(), watchdog_s: 10.0, ..HaplyOptions::default() }
    }

    fn opened(&self) -> Haply {
        let mut device = Haply::new(self.options());
        device.open().unwrap();
        device
    }

    fn pressing(&self) -> Haply {
        let mut device = self.opened();
        device.read(0.0).unwrap();
        device.write(&push([0.0, 0.0, 2.0])).unwrap();
        self.hears(&force([0.0, 0.0, 2.0]));
        device
    }

    fn now(&self, manner: Manner) {
        *self.manner.lock().unwrap() = manner;
    }

    /// Waits until the service has heard `message` after now.
    fn hears(&self, message: &str) {
        let start = Instant::now();
        let before = self.heard.lock().unwrap().len();
        while !self.heard.lock().unwrap()[before..].iter().any(|m| m == message) {
            assert!(start.elapsed() < Duration::from_secs(5), "{message} is not heard");
            thread::sleep(Duration::from_micros(100));
        }
    }

    /// When the connection has ended: the last messages.
    fn last_heard(&mut self, how_many: usize) -> Vec<String> {
        self.thread.take().unwrap().join().unwrap();
        let heard = self.heard.lock().unwrap();
        heard[heard.len().saturating_sub(how_many)..].to_vec()
    }
}

fn serve(listener: &TcpListener, inventory: &str, manner: &Mutex<Manner>, heard: &Mutex<Vec<String>>) {
    let mut socket = tungstenite::accept(listener.accept().unwrap().0).unwrap();
    socket.send(Message::text(inventory)).unwrap();
    while let Ok(message) = socket.read() {
        let Message::Text(text) = message else {
            heard.lock().unwrap().push("close".into());
            continue;
        };
        heard.lock().unwrap().push(text.to_string());
        let now = manner.lock().unwrap().clone();
        let sent = match now {
            Manner::At(place) => socket.send(Message::text(state(place))),
            Manner::Says(text) => socket.send(Message::text(text)),
            Manner::Slow(time) => {
                thread::sleep(time);
                socket.send(Message::text(state([0.0; 3])))
            }
            Manner::Hangs => Ok(()),
            Manner::Leaves => return,
        };
        if sent.is_err() {
            return;
        }
    }
}

fn push(force_n: [f64; 3]) -> Command {
    Command { force_n, ..Command::default() }
}

fn force([x, y, z]: [f64; 3]) -> String {
    let vector = format!(r#"{{"vector":{{"x":{x},"y":{y},"z":{z}}}}}"#);
    format!(r#"{{"inverse3":[{{"device_id":"049D","commands":{{"set_cursor_force":{vector}}}}}]}}"#)
}

const PROBE: &str = r#"{"inverse3":[{"device_id":"049D","commands":{"probe_position":{}}}]}"#;

fn read_until(device: &mut Haply, good: impl Fn(&Result<Sample, Fault>) -> bool) -> Result<Sample, Fault> {
    read_at(device, 0.0, good)
}

/// Reads, always at the same time of the loop's, until `good` holds of what is read.
fn read_at(
    device: &mut Haply,
    now_s: f64,
    good: impl Fn(&Result<Sample, Fault>) -> bool,
) -> Result<Sample, Fault> {
    let start = Instant::now();
    loop {
        let read = device.read(now_s);
        if good(&read) {
            return read;
        }
        assert!(start.elapsed() < Duration::from_secs(5), "{read:?}");
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_whole_session_in_order() {
    let mut service = Service::usual();
    let mut device = Haply::new(service.options());
    device.open().unwrap();
    assert_eq!(device.capabilities().name, "Haply Inverse3 049D, right");
    assert_eq!(device.capabilities().sensed.rotations, 3);
    // Positions without force, until a pose was read.
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    service.hears(PROBE);
    device.read(0.0).unwrap();
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    service.hears(&force([1.0, 0.0, 0.0]));
    // It holds for one tick of the service: it is said again while the loop has said nothing else.
    service.hears(&force([1.0, 0.0, 0.0]));
    device.close();
    assert_eq!(device.read(0.0), Err(Fault::NotOpen));
    assert_eq!(device.write(&push([1.0, 0.0, 0.0])), Err(Fault::NotOpen));
    let heard = service.last_heard(usize::MAX);
    assert_eq!(heard[heard.len() - 2..], [force([0.0; 3]), "close".into()]);
    let first = heard.iter().position(|m| m.contains("set_cursor_force")).unwrap();
    assert!(first > 0 && heard[..first].iter().all(|m| m == PROBE), "{heard:?}");
    assert!(heard[first..heard.len() - 2].iter().all(|m| *m == force([1.0, 0.0, 0.0])), "{heard:?}");
}

/// m, m/s, N as they are, of the device that was asked for, and the grip's orientation and buttons.
#[test]
fn units_axes_grip() {
    let service = Service::usual();
    service.now(Manner::Says(moving([0.01, -0.02, 0.03]).replace(r#""ready":true"#, r#""ready":false"#)));
    let mut device = service.opened();
    let sample = device.read(0.0).unwrap();
    assert_eq!(sample.pose.position_m, [0.01, -0.02, 0.03]);
    assert_eq!(sample.pose.orientation, [0.6, 0.0, 0.8, 0.0]);
    assert_eq!(sample.velocity_m_per_s, Some([0.1, 0.2, 0.3]));
    assert_eq!((sample.buttons, sample.status.idle), (0b10, true));
    device.write(&push([0.25, -0.5, 1.0])).unwrap();
    service.hears(&force([0.25, -0.5, 1.0]));
}

/// What is written comes back with the next state: one write, one state, while the loop runs.
#[test]
fn the_loop_sets_the_pace() {
    let service = Service::usual();
    let mut device = service.opened();
    let before = device.read(0.0).unwrap().sequence;
    let said = service.heard.lock().unwrap().len();
    let (mut fresh, start) = (0, Instant::now());
    for k in 0..200 {
        device.write(&push([0.0, 0.0, f64::from(k) * 1e-3])).unwrap();
        thread::sleep(Duration::from_millis(1));
        let sequence = device.read(0.0).unwrap().sequence;
        fresh += u32::from(sequence > before + u64::from(fresh));
    }
    let said = service.heard.lock().unwrap().len() - said;
    // A busy machine may miss some; where the loop pauses, the thread asks by itself every 2 ms.
    let polls = (start.elapsed().as_secs_f64() / 2e-3) as usize;
    assert!(fresh > 50, "{fresh} new poses in 200 periods");
    assert!(
        (fresh as usize..210 + polls).contains(&said),
        "{said} messages for 200 writes and {polls} polls"
    );
}

#[test]
fn limits() {
    let service = Service::usual();
    let mut device = service.opened();
    let most = device.capabilities().max_force_n.value;
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.0, 50.0])).unwrap();
    service.hears(&force([0.0, 0.0, most]));
    assert!(device.read(0.0).unwrap().status.saturated);
    device.write(&push([f64::NAN, 0.0, 0.0])).unwrap();
    service.hears(&force([0.0; 3]));
    let service = Service::usual();
    let mut device = Haply::new(HaplyOptions { max_force_n: Some(0.5), ..service.options() });
    device.open().unwrap();
    device.read(0.0).unwrap();
    device.write(&push([0.0, 9.0, 0.0])).unwrap();
    service.hears(&force([0.0, 0.5, 0.0]));
    assert!(Haply::new(HaplyOptions { max_force_n: Some(0.0), ..service.options() }).open().is_err());
}

#[test]
fn an_older_services_key() {
    let service = Service::usual();
    let mut device = Haply::new(HaplyOptions { force_key: HaplyForceKey::Values, ..service.options() });
    device.open().unwrap();
    device.read(0.0).unwrap();
    device.write(&push([0.0, 0.5, 0.0])).unwrap();
    service.hears(&force([0.0, 0.5, 0.0]).replace("vector", "values"));
}

/// The connection goes in the middle of a press: said from then on, and closing does not hang.
#[test]
fn a_disconnect_in_mid_press() {
    let service = Service::usual();
    let mut device = service.pressing();
    service.now(Manner::Leaves);
    assert_eq!(read_until(&mut device, Result::is_err), Err(Fault::Disconnected));
    assert_eq!(read_until(&mut device, |_| true), Err(Fault::Disconnected));
    let start = Instant::now();
    while device.write(&push([0.0; 3])).is_ok() {
        assert!(start.elapsed() < Duration::from_secs(5));
    }
    assert_eq!(device.write(&push([0.0; 3])), Err(Fault::Disconnected));
    drop(device);
    assert!(start.elapsed() < Duration::from_secs(5));
}

/// The arm is unplugged while the service stays, and comes back.
#[test]
fn an_arm_that_is_unplugged() {
    let service = Service::usual();
    let mut device = service.pressing();
    service.now(Manner::Says(inventory("")));
    assert_eq!(read_until(&mut device, Result::is_err), Err(Fault::Disconnected));
    service.now(Manner::At([0.0; 3]));
    assert!(read_until(&mut device, Result::is_ok).is_ok());
}

#[test]
fn what_cant_be_understood() {
    let service = Service::usual();
    let mut device = service.pressing();
    let huge = state([0.0; 3]).replace(r#""cursor_position":{"x":0"#, r#""cursor_position":{"x":1e999"#);
    for text in
        ["", "{", r#"{"inverse3":[{"device_id":"049D"}]}"#, &huge, &state([0.0; 3]).replace("049D", "1")]
    {
        service.now(Manner::Says(text.into()));
        let fault = read_until(&mut device, Result::is_err).unwrap_err();
        assert!(matches!(fault, Fault::Garbled | Fault::Disconnected), "{text}: {fault}");
        assert_eq!(fault == Fault::Garbled, !text.contains(r#""device_id":"1""#), "{text}");
        service.now(Manner::At([0.0; 3]));
        assert!(read_until(&mut device, Result::is_ok).is_ok());
    }
}

/// A service that hangs holds neither the loop nor the close, and is said.
#[test]
fn a_service_that_hangs() {
    let mut service = Service::usual();
    let mut device = service.pressing();
    service.now(Manner::Hangs);
    let start = Instant::now();
    let mut periods = 0;
    let fault = loop {
        let read = device.read(start.elapsed().as_secs_f64());
        device.write(&push([0.0, 0.0, 1.0])).unwrap();
        periods += 1;
        if let Err(fault) = read {
            break fault;
        }
        assert!(start.elapsed() < Duration::from_secs(5));
    };
    assert_eq!(fault, Fault::TimedOut);
    // Had one of them waited for the service, it would have been for 50 ms.
    assert!(
        start.elapsed() / periods < Duration::from_millis(10),
        "{periods} periods in {:?}",
        start.elapsed()
    );
    let start = Instant::now();
    drop(device);
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
    assert!(service.last_heard(2).contains(&force([0.0; 3])));
}

/// Poses that stand still by the loop's clock are stale, whatever the thread says.
#[test]
fn a_slow_service() {
    let service = Service::usual();
    let mut device = service.opened();
    service.now(Manner::Slow(Duration::from_millis(200)));
    assert_eq!(read_until(&mut device, Result::is_err), Err(Fault::TimedOut));
    assert!(read_until(&mut device, Result::is_ok).is_ok());
}

/// The loop is silent: after the watchdog's time no force is sent, and again when it speaks.
#[test]
fn a_silent_loop() {
    let service = Service::usual();
    let mut device = Haply::new(HaplyOptions { watchdog_s: 0.02, ..service.options() });
    device.open().unwrap();
    device.read(0.0).unwrap();
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    service.hears(&force([0.0; 3]));
    goes_on(&service, &mut device);
}

/// After a silence: nothing but zero is sent until the loop has commanded it, and the loop can see that.
fn goes_on(service: &Service, device: &mut Haply) {
    let before = service.heard.lock().unwrap().len();
    assert!(read_until(device, |r| r.is_ok_and(|s| s.status.idle)).is_ok());
    for _ in 0..20 {
        device.write(&push([1.0, 0.0, 0.0])).unwrap();
        thread::sleep(Duration::from_millis(1));
    }
    let zero = force([0.0; 3]);
    assert!(service.heard.lock().unwrap()[before..].iter().all(|m| *m == zero));
    // As the loop does, for as long as the device is idle.
    let start = Instant::now();
    while device.read(0.0).is_ok_and(|s| s.status.idle) {
        device.write(&push([0.0; 3])).unwrap();
        thread::sleep(Duration::from_millis(1));
        assert!(start.elapsed() < Duration::from_secs(5), "it stays idle");
    }
    while service.heard.lock().unwrap().last() != Some(&force([0.5, 0.0, 0.0])) {
        device.write(&push([0.5, 0.0, 0.0])).unwrap();
        thread::sleep(Duration::from_millis(1));
        assert!(start.elapsed() < Duration::from_secs(5), "it never goes on");
    }
}

/// The service is silent: it has let go of the force meanwhile, and is not told all of it at once when it answers again.
#[test]
fn a_service_that_was_silent_is_told_zero_first() {
    let service = Service::usual();
    let mut device = Haply::new(HaplyOptions { watchdog_s: 0.05, ..service.options() });
    device.open().unwrap();
    device.read(0.0).unwrap();
    device.write(&push([1.0, 0.0, 0.0])).unwrap();
    service.hears(&force([1.0, 0.0, 0.0]));
    service.now(Manner::Slow(Duration::from_millis(150)));
    let heard = || service.heard.lock().unwrap().clone();
    let (before, start) = (heard().len(), Instant::now());
    // The one that it sits on, and the next; the loop is never silent.
    while heard().len() < before + 2 {
        device.write(&push([1.0, 0.0, 0.0])).unwrap();
        thread::sleep(Duration::from_millis(1));
        assert!(start.elapsed() < Duration::from_secs(5));
    }
    assert_eq!(heard()[before + 1], force([0.0; 3]));
    service.now(Manner::At([0.0; 3]));
    goes_on(&service, &mut device);
}

#[test]
fn an_emergency_stop() {
    let service = Service::usual();
    let mut device = service.pressing();
    device.emergency_stop().unwrap().stop();
    service.hears(&force([0.0; 3]));
    let before = service.heard.lock().unwrap().len();
    for _ in 0..20 {
        device.write(&push([0.0, 0.0, 2.0])).unwrap();
        thread::sleep(Duration::from_millis(1));
    }
    assert!(service.heard.lock().unwrap()[before..].iter().all(|m| *m == force([0.0; 3])));
}

/// The service answers every message, with the state that it has: one that says that the handle moves, and is the same again
/// to the bit, is old. Ten seconds on the loop's clock, where nothing begins at zero.
#[test]
fn a_service_that_repeats_a_state_is_stale() {
    let service = Service::usual();
    let mut device = service.opened();
    service.now(Manner::Says(moving([0.01; 3])));
    read_at(&mut device, 10.0, |r| r.is_ok_and(|s| s.pose.position_m == [0.01; 3])).unwrap();
    let sequence = device.read(10.0).unwrap().sequence;
    let heard = || service.heard.lock().unwrap().len();
    let before = heard();
    while heard() < before + 5 {
        thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(device.read(10.049).unwrap().sequence, sequence);
    assert_eq!(device.read(10.051), Err(Fault::TimedOut));
    service.now(Manner::At([0.02; 3]));
    read_at(&mut device, 10.0, |r| r.is_ok_and(|s| s.sequence > sequence)).unwrap();
    // A handle that lies on the table is at the same place for as long as it likes.
    let sequence = device.read(10.0).unwrap().sequence;
    assert!(read_at(&mut device, 10.0, |r| r.unwrap().sequence > sequence + 3).is_ok());
}

/// What the inventory says of the arm is told before there is a force.
#[test]
fn what_the_arm_lacks_is_told() {
    for (status, words) in [
        (r#""calibrated":true,"in_use":false,"power_supply":true"#, None),
        (r#""calibrated":false"#, Some("not calibrated")),
        (r#""in_use":true"#, Some("another program")),
        (r#""power_supply":false"#, Some("power supply")),
    ] {
        let arm = DEVICES.replace(r#""ready":true"#, &format!(r#""ready":true,{status}"#));
        let service = Service::new(inventory(&arm));
        let device = service.opened();
        assert_eq!(device.notes().len(), usize::from(words.is_some()), "{:?}", device.notes());
        assert!(words.is_none_or(|words| device.notes()[0].contains(words)), "{:?}", device.notes());
    }
}

#[test]
fn a_panic_in_mid_press() {
    let mut service = Service::usual();
    let device = service.pressing();
    let caught = catch_unwind(AssertUnwindSafe(move || {
        let _held = device;
        panic!("the loop fell over");
    }));
    assert!(caught.is_err());
    assert_eq!(service.last_heard(2), [force([0.0; 3]), "close".into()]);
}

#[test]
fn one_of_several() {
    let two = format!("{DEVICES},{}", DEVICES.replace("049D", "0001"));
    let service = Service::new(inventory(&two));
    let mut device = Haply::new(HaplyOptions { device_id: Some("0001".into()), ..service.options() });
    device.open().unwrap();
    // The stand-in's state says where each of the two is.
    assert_eq!(device.read(0.0).unwrap().pose.position_m, [9.0; 3]);
    let service = Service::new(inventory(&two));
    let missing = HaplyOptions { device_id: Some("ABCD".into()), ..service.options() };
    let error = Haply::new(missing).open().unwrap_err().to_string();
    assert!(error.contains("no Inverse3 `ABCD`") && error.contains("049D, 0001"), "{error}");
}

#[test]
fn what_is_missing_is_said() {
    let open = |options| Haply::new(options).open().unwrap_err().to_string();
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let error = open(HaplyOptions { url: format!("ws://{nobody}"), ..HaplyOptions::default() });
    assert!(error.contains(&format!("ws://{nobody}")) && error.contains("haply-inverse-service"), "{error}");
    for url in ["localhost:10001", "wss://localhost", "ws://", "no address"] {
        let error = open(HaplyOptions { url: url.into(), ..HaplyOptions::default() });
        assert!(error.contains("ws://HOST:PORT"), "{error}");
    }
    let error = open(Service::new(inventory("")).options());
    assert!(error.contains("sees no Inverse3"), "{error}");
    let error = open(Service::new("hello".into()).options());
    assert!(error.contains("can't be read"), "{error}");
    let service = Service::usual();
    service.now(Manner::Hangs);
    let error = open(service.options());
    assert!(error.contains("gives no position: the device did not answer in time"), "{error}");
}
