use super::*;
use crate::{Patience, Safety, WorkspaceMap, ring};
use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_body::{BlendWeights, Body, BodyParts, Provenance, Response, SlipRule, Tool};
use palpate_device::simulated::{Move, Script};
use palpate_device::{Capabilities, OpenError, Sample, Simulated, presets};
use palpate_engine::Contact;
use std::sync::Mutex;

/// What a device was asked.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Call {
    Read,
    Write([f64; 3]),
    Close,
}

/// A simulated device with a list of its calls.
struct Logged(Simulated, Arc<Mutex<Vec<Call>>>);

impl Logged {
    fn log(&self, call: Call) {
        self.1.lock().unwrap().push(call);
    }
}

impl Device for Logged {
    fn capabilities(&self) -> &Capabilities {
        self.0.capabilities()
    }
    fn open(&mut self) -> Result<(), OpenError> {
        self.0.open()
    }
    fn read(&mut self, now_s: f64) -> Result<Sample, Fault> {
        self.log(Call::Read);
        self.0.read(now_s)
    }
    fn write(&mut self, command: &Command) -> Result<(), Fault> {
        self.log(Call::Write(command.force_n));
        self.0.write(command)
    }
    fn close(&mut self) {
        self.log(Call::Close);
        self.0.close();
    }
}

fn ball() -> Body {
    let mesh = Shape::Sphere { radius_mm: 30.0 }.mesh(Resolution::default()).unwrap();
    let surface = palpate_body::Surface::build(&mesh, f64::INFINITY).unwrap();
    Body::new(BodyParts {
        blends: vec![BlendWeights::own(0); surface.positions().len()],
        surface,
        responses: vec![Response::paper(600.0, 500.0, 0.3, 8e-3, 8e-3).unwrap()],
        test_point_nodes: vec![0],
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })
    .unwrap()
}

fn force(call: &Call) -> f64 {
    match call {
        Call::Write(force) => DVec3::from_array(*force).length(),
        _ => 0.0,
    }
}

/// The finder's thread panics while the tool is pressed in: the haptic thread does not read once more, and is at zero force
/// within two periods.
#[test]
fn a_finder_that_panics_in_mid_press_ends_the_loop_in_time() {
    let moves = [Move::Press { depth_m: 6e-3, seconds: 0.1 }, Move::Press { depth_m: 6e-3, seconds: 30.0 }];
    let script = Script::new(DVec3::Z * 0.03, 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
    let (hand, _) = presets::hand("fingers").unwrap();
    let calls = Arc::new(Mutex::new(Vec::new()));
    let device =
        Logged(Simulated::new(presets::device("touch").unwrap(), hand, Box::new(script)), calls.clone());
    let safety = Safety { soft_start_s: 0.05, silence_s: Some(1.0), ..Safety::default() };
    let stages = safety.stages(device.capabilities(), 1000.0).unwrap();
    let body = Arc::new(ball());
    let haptics = HapticLoop::new(Contact::new(&body), WorkspaceMap::default(), stages);
    let (recorder, _records) = ring(100);
    let settings = Settings {
        seconds: Some(30.0),
        real_time: RealTime { priority: None, core: None, lock_memory: true, spin_s: 0.0 },
        // The machine may be busy with other tests.
        patience: Patience { late_s: 60.0, pose_s: 60.0, finder_s: 60.0, ..Patience::default() },
        ..Settings::new(1000.0)
    };
    let watched = calls.clone();
    let find = move |mut finder: Finder, _: &Shared, _: &AtomicBool, pause: Duration| {
        while watched.lock().unwrap().last().map_or(0.0, force) < 0.5 {
            finder.look().unwrap();
            thread::sleep(pause);
        }
        panic!("the finder has a bug");
    };
    let report = Session::prepare(body, Opened::new(Box::new(device)).unwrap(), haptics, recorder, settings)
        .unwrap()
        .start_with(find)
        .unwrap()
        .join();
    assert_eq!(report.end, End::FinderDead);
    assert!(!report.end.is_well());
    let calls = calls.lock().unwrap();
    let last = calls.iter().rposition(|call| *call == Call::Read).unwrap();
    // Its own command, then those on the way to zero.
    let [own, ending @ .., Call::Close] = &calls[last + 1..] else { panic!("{:?}", &calls[last..]) };
    assert!(force(own) > 0.5, "{own:?}");
    assert!((1..=2).contains(&ending.len()), "{ending:?}");
    assert_eq!(ending.last(), Some(&Call::Write([0.0; 3])));
}
