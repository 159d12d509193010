//! A run with a solver of milliseconds: however it is divided, broken and resumed, it ends with the same bytes, and
//! whatever goes wrong, finished points are kept.

use glam::DVec3;
use palpate_body::shape::{Resolution, Shape};
use palpate_build::paths_file::{PathsPlan, PathsRecord, Scene, TestPoint};
use palpate_build::precompute::{
    Options, PointSolver, Prepared, Rounds, Shard, Stopped, assemble, merge, prepare, run,
};
use palpate_build::spec::Spec;
use palpate_cli::commands::Failure;
use palpate_simulate::{Path as LoadPath, PointPaths, State, Stop};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

const SPEC: &str = r#"
[body.shape]
kind = "sphere"
radius_mm = 30

[[body.fixed]]
half_space = { point_mm = [0, 0, -25], normal = [0, 0, -1] }

[material]
model = "neo-hookean"
young_modulus_pa = 10e3
poisson_ratio = 0.45

[tool]
shape = "sphere"
radius_mm = 5

[friction]
coefficient = 0.2

[deflection]
normal_max_mm = 6
lateral_max_mm = 3
steps = 6
"#;

const POINTS: usize = 24;

/// Forces that depend on the place in an odd way; some paths end early, and one point fails.
struct Fake {
    pause: Duration,
    nodes: usize,
    solved: AtomicUsize,
}

impl PointSolver for Fake {
    fn simulate(&self, point: &TestPoint, cancelled: &AtomicBool) -> Option<PointPaths> {
        std::thread::sleep(self.pause);
        if cancelled.load(Ordering::Relaxed) {
            return None;
        }
        self.solved.fetch_add(1, Ordering::Relaxed);
        let plan = &point.plan;
        let stiffness = 100.0 * (2.0 + (1e3 * plan.point.x).sin());
        let state = |depth: f64, distance: f64, along: DVec3| State {
            depth_m: depth,
            distance_m: distance,
            force_n: plan.inward * (stiffness * depth * (1.0 + 100.0 * depth))
                + along * (stiffness * distance),
            torque_n_m: DVec3::splat(1e-3 * depth),
            patch_m2: depth * 1e-3,
            displacement_m: (0..self.nodes)
                .map(|i| [depth as f32 * (i as f32).sin(), distance as f32, 1e-4 * (i as f32).cos()])
                .collect(),
            iterations: 3,
            ..State::default()
        };
        let stop = |at_m| Some(Stop { at_m, why: "an element inverted".into() });
        let reached = match point.node % 7 {
            0 => 0,
            1 => 3,
            _ => plan.depths.len(),
        };
        let press = LoadPath {
            states: plan.depths.iter().take(reached).map(|&d| state(d, 0.0, DVec3::ZERO)).collect(),
            stopped: plan.depths.get(reached).and_then(|&d| stop(d)),
            halved: None,
        };
        let drags = plan.drags.iter().map(|drag| {
            if drag.from >= reached {
                return LoadPath::default();
            }
            let depth = plan.depths[drag.from];
            let states = drag.distances.iter().map(|&s| state(depth, s, drag.direction)).collect();
            LoadPath { states, stopped: None, halved: None }
        });
        Some(PointPaths { press, drags: drags.collect() })
    }
}

fn plan() -> PathsPlan {
    PathsPlan {
        software: "palpate test".into(),
        spec_name: "ball.toml".into(),
        spec: SPEC.into(),
        inputs: BTreeMap::from([("ball.msh".to_string(), "0".repeat(64))]),
        ..PathsPlan::default()
    }
}

fn prepared(pause: Duration) -> Prepared<Fake> {
    let path = Path::new("ball.toml");
    let spec = Spec::parse(path, SPEC.into()).unwrap();
    let simulation = spec.simulation_by_default(path, "frictionless").unwrap();
    let triangles = Shape::Sphere { radius_mm: 30.0 }.mesh(Resolution::default()).unwrap();
    let surface = assemble::surface(&spec, &triangles).unwrap();
    let every = surface.positions().len() / POINTS;
    let points = (0..POINTS).map(|i| {
        let node = i * every;
        let (p, u) = (surface.positions()[node], surface.inward_normals()[node]);
        TestPoint { node: node as u32, plan: prepare::point_plan(&simulation, p, u, true) }
    });
    let points = points.collect();
    let nodes = triangles.positions.len();
    let scene = Scene {
        guide_n_per_m: vec![1.0; nodes],
        boundary_m: triangles.positions.clone(),
        faces: triangles.triangles.iter().map(|&[a, b, c]| [a, b, c, a, b, c]).collect(),
        surface: triangles,
        notes: vec!["a note".into()],
        ..Scene::default()
    };
    Prepared { scene, points, solver: Fake { pause, nodes, solved: AtomicUsize::new(0) }, rounds: None }
}

fn options(folder: &Path) -> Options {
    Options {
        record: folder.join("ball.body.paths"),
        partial: folder.join("ball.body.partial"),
        jobs: 2,
        resume: false,
        shard: None,
    }
}

/// Runs to the end; the bytes of record and body.
fn whole(options: &Options) -> (Vec<u8>, Vec<u8>) {
    let never = AtomicBool::new(false);
    let (record, workspace) =
        run::run(&plan(), options, || Ok(prepared(Duration::ZERO)), &(), &never).unwrap();
    let body = assemble::body(&record).unwrap().body.to_bytes().unwrap();
    workspace.finish(&()).unwrap();
    assert!(!options.partial.exists());
    (fs::read(&options.record).unwrap(), body)
}

fn expected() -> (Vec<u8>, Vec<u8>) {
    let directory = tempfile::tempdir().unwrap();
    whole(&options(directory.path()))
}

/// Runs until `count` points are done.
fn begin(options: &Options, plan: &PathsPlan, count: usize) {
    struct Few(Fake, usize, AtomicUsize);
    impl PointSolver for Few {
        fn simulate(&self, point: &TestPoint, cancelled: &AtomicBool) -> Option<PointPaths> {
            if self.2.fetch_add(1, Ordering::SeqCst) >= self.1 {
                cancelled.store(true, Ordering::SeqCst);
                return None;
            }
            self.0.simulate(point, &AtomicBool::new(false))
        }
    }
    let prepare = || {
        let Prepared { scene, points, solver, rounds } = prepared(Duration::ZERO);
        Ok(Prepared { scene, points, solver: Few(solver, count, AtomicUsize::new(0)), rounds })
    };
    match run::run(plan, options, prepare, &(), &AtomicBool::new(false)) {
        Err(Stopped::Cancelled { done, of: POINTS }) => assert_eq!(done, count),
        other => panic!("{:?}", other.map(|_| ())),
    }
}

fn refused(plan: &PathsPlan, options: &Options) -> String {
    match run::run(plan, options, || Ok(prepared(Duration::ZERO)), &(), &AtomicBool::new(false)) {
        Err(Stopped::Error(e)) => palpate_files::message(&e),
        other => panic!("{:?}", other.map(|_| ())),
    }
}

fn listing(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let paths = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    paths.map(|p| (p.clone(), fs::read(p).unwrap())).collect()
}

#[test]
fn jobs_and_shards_change_no_byte() {
    let (record, body) = expected();
    for jobs in [1, 4, 64] {
        let directory = tempfile::tempdir().unwrap();
        assert!(
            whole(&Options { jobs, ..options(directory.path()) }) == (record.clone(), body.clone()),
            "{jobs} jobs"
        );
    }
    let directory = tempfile::tempdir().unwrap();
    let shards: Vec<PathBuf> = (1..=5).rev().map(|i| directory.path().join(format!("{i}.paths"))).collect();
    for (path, number) in shards.iter().zip((1..=5).rev()) {
        let partial = directory.path().join("partial");
        let shard = Some(Shard { number, of: 5 });
        let options = Options { record: path.clone(), partial, jobs: 1, resume: false, shard };
        let ready = || Ok(prepared(Duration::ZERO));
        let (_, workspace) = run::run(&plan(), &options, ready, &(), &AtomicBool::new(false)).unwrap();
        workspace.finish(&()).unwrap();
    }
    let merged = merge(&shards).unwrap();
    merged.save(&directory.path().join("merged.paths")).unwrap();
    assert!(fs::read(directory.path().join("merged.paths")).unwrap() == record);
    assert!(assemble::body(&merged).unwrap().body.to_bytes().unwrap() == body);

    let complaint = |shards: &[PathBuf]| merge(shards).unwrap_err().to_string();
    assert!(complaint(&shards[1..]).contains("4 of 24 test points are missing, the first is 4"));
    assert!(complaint(&[shards.clone(), shards[..1].to_vec()].concat()).contains("is also in"));
    let other = PathsPlan { spec: SPEC.replace("10e3", "11e3"), ..plan() };
    let mut record = PathsRecord::open(&shards[0]).unwrap();
    record.plan = other;
    record.save(&shards[0]).unwrap();
    assert!(complaint(&shards).contains("the spec (line 11) is another"));

    // What would not merge does not begin.
    let spec = directory.path().join("ball.toml");
    fs::write(&spec, SPEC).unwrap();
    let begun = |with: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command
            .arg("precompute")
            .arg(&spec)
            .args(["--shard", "2/5", "-o"])
            .arg(directory.path().join("2.new"));
        let output = command.arg("--merges-with").arg(with).stdin(Stdio::null()).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, message) = begun(&shards[0]);
    assert!(code == Some(1) && message.contains("would not merge: the spec (line 11)"), "{code:?} {message}");
    assert!(!directory.path().join("2.new").exists() && !directory.path().join("2.new.partial").exists());
    let mut record = PathsRecord::open(&shards[1]).unwrap();
    record.plan = PathsPlan { machine: Some("abacus".into()), ..prepare_plan(&spec) };
    record.save(&shards[1]).unwrap();
    let (code, message) = begun(&shards[1]);
    assert!(code == Some(1) && message.contains("the kind of machine (abacus, now "), "{code:?} {message}");
}

/// What `precompute` asks of a spec's file.
fn prepare_plan(spec: &Path) -> PathsPlan {
    let read = Spec::read(spec).unwrap();
    let simulation = read.simulation(spec).unwrap();
    prepare::plan(&read, &simulation, spec).unwrap()
}

#[test]
fn the_record_tells_what_was_simulated() {
    let directory = tempfile::tempdir().unwrap();
    let options = options(directory.path());
    whole(&options);
    let record = PathsRecord::open(&options.record).unwrap();
    let Prepared { scene, points, solver, .. } = prepared(Duration::ZERO);
    assert_eq!(record.scene, Some(scene));
    assert_eq!(record.points.len(), POINTS);
    for (index, point) in &record.points {
        let original = &points[*index as usize];
        assert_eq!(point.test_point(), *original);
        let paths = solver.simulate(original, &AtomicBool::new(false)).unwrap();
        let back = point.paths_with_displacements().unwrap();
        for (a, b) in
            [&paths.press].into_iter().chain(&paths.drags).zip([&back.press].into_iter().chain(&back.drags))
        {
            assert_eq!(a.stopped, b.stopped);
            assert_eq!(a.states.len(), b.states.len());
            for (a, b) in a.states.iter().zip(&b.states) {
                let without = |s: &State| State { displacement_m: Vec::new(), ..s.clone() };
                assert_eq!(without(a), without(b));
                let largest = a.displacement_m.iter().flatten().fold(0.0f32, |m, c| m.max(c.abs()));
                for (c, d) in a.displacement_m.iter().flatten().zip(b.displacement_m.iter().flatten()) {
                    assert!((c - d).abs() <= 0.51 * largest / 8192.0, "{c} {d}");
                }
            }
        }
    }
    let notes = assemble::body(&record).unwrap().body.provenance().notes.join("\n");
    assert!(notes.contains("a note") && notes.contains("an element inverted"), "{notes}");
    assert!(notes.contains("it is left out"), "{notes}");
}

#[test]
fn a_stopped_run_goes_on() {
    let expected = expected();
    let directory = tempfile::tempdir().unwrap();
    let fresh = options(directory.path());
    begin(&fresh, &plan(), 7);
    let before = listing(&fresh.partial);
    assert_eq!(before.len(), 7 + 2);
    let complaint = refused(&plan(), &fresh);
    assert!(complaint.contains("ball.body.partial") && complaint.contains("--resume"), "{complaint}");
    assert!(listing(&fresh.partial) == before);

    // Only what is left is simulated.
    let resumed = Options { resume: true, ..fresh };
    let never = AtomicBool::new(false);
    let counted = prepared(Duration::ZERO);
    let solved: &'static AtomicUsize = Box::leak(Box::new(AtomicUsize::new(0)));
    struct Counted(Fake, &'static AtomicUsize);
    impl PointSolver for Counted {
        fn simulate(&self, point: &TestPoint, cancelled: &AtomicBool) -> Option<PointPaths> {
            self.1.fetch_add(1, Ordering::SeqCst);
            self.0.simulate(point, cancelled)
        }
    }
    let Prepared { scene, points, solver, rounds } = counted;
    let prepare = || Ok(Prepared { scene, points, solver: Counted(solver, solved), rounds });
    let (_, workspace) = run::run(&plan(), &resumed, prepare, &(), &never).unwrap();
    assert_eq!(solved.load(Ordering::SeqCst), POINTS - 7);
    assert!(fs::read(&resumed.record).unwrap() == expected.0);

    // As if it had been killed after its record was written, while it cleaned up.
    drop(workspace);
    for (path, _) in listing(&resumed.partial).into_iter().skip(3) {
        if path.extension().is_some_and(|e| e == "paths") {
            fs::remove_file(path).unwrap();
        }
    }
    assert!(whole(&resumed) == expected);

    // With nothing begun, --resume begins.
    let directory = tempfile::tempdir().unwrap();
    assert!(whole(&Options { resume: true, ..options(directory.path()) }) == expected);
}

/// Test points in rounds: 6 to begin with, and more until there are 24, each from what came of those before.
fn in_rounds() -> Prepared<Fake> {
    let Prepared { scene, mut points, solver, .. } = prepared(Duration::ZERO);
    let all = points.clone();
    points.truncate(6);
    let next = move |done: &BTreeMap<u32, palpate_build::paths_file::Point>| {
        let states: usize = done.values().map(|p| p.paths().press.states.len()).sum();
        let end = (done.len() + 1 + states % 5).min(POINTS);
        Ok(all[done.len()..end].to_vec())
    };
    Prepared { scene, points, solver, rounds: Some(Rounds { most: 30, next: Box::new(next) }) }
}

#[test]
fn rounds_of_test_points_go_on_where_they_were_stopped() {
    let never = AtomicBool::new(false);
    let finish = |options: &Options| {
        let (record, workspace) = run::run(&plan(), options, || Ok(in_rounds()), &(), &never).unwrap();
        workspace.finish(&()).unwrap();
        assert_eq!((record.points.len(), record.total), (POINTS, POINTS as u32));
        (fs::read(&options.record).unwrap(), assemble::body(&record).unwrap().body.to_bytes().unwrap())
    };
    let directory = tempfile::tempdir().unwrap();
    // The same as if all had been known.
    assert!(finish(&options(directory.path())) == expected());

    struct Few(Fake, usize);
    impl PointSolver for Few {
        fn simulate(&self, point: &TestPoint, cancelled: &AtomicBool) -> Option<PointPaths> {
            if self.0.solved.load(Ordering::SeqCst) >= self.1 {
                cancelled.store(true, Ordering::SeqCst);
                return None;
            }
            self.0.simulate(point, &AtomicBool::new(false))
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let resumed = Options { resume: true, jobs: 1, ..options(directory.path()) };
    for count in [4, 7] {
        let few = || {
            let Prepared { scene, points, solver, rounds } = in_rounds();
            Ok(Prepared { scene, points, solver: Few(solver, count), rounds })
        };
        let stopped = run::run(&plan(), &resumed, few, &(), &AtomicBool::new(false));
        assert!(matches!(stopped, Err(Stopped::Cancelled { .. })));
    }
    assert!(finish(&resumed) == expected());

    let directory = tempfile::tempdir().unwrap();
    let sharded = Options { shard: Some(Shard { number: 1, of: 2 }), ..options(directory.path()) };
    let refused = match run::run(&plan(), &sharded, || Ok(in_rounds()), &(), &never) {
        Err(Stopped::Error(e)) => palpate_files::message(&e),
        other => panic!("{:?}", other.map(|_| ())),
    };
    assert!(refused.contains("tolerance_percent") && refused.contains("run without --shard"), "{refused}");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn what_changed_is_named_and_nothing_is_lost() {
    let directory = tempfile::tempdir().unwrap();
    let resumed = Options { resume: true, ..options(directory.path()) };
    begin(&resumed, &plan(), 5);
    let before = listing(&resumed.partial);
    let changed = [
        (PathsPlan { spec: SPEC.replace("0.45", "0.46"), ..plan() }, "the spec (line 12)"),
        (PathsPlan { software: "palpate 99".into(), ..plan() }, "the program (palpate test, now palpate 99)"),
        (
            PathsPlan { inputs: [("ball.msh".to_string(), "1".repeat(64))].into(), ..plan() },
            "the file ball.msh",
        ),
        (
            PathsPlan { machine: Some("x86-64-v9".into()), ..plan() },
            "(unknown, now x86-64-v9) is another than when this run was begun; go on with it on a machine of that kind",
        ),
    ];
    for (plan, what) in changed {
        let complaint = refused(&plan, &resumed);
        assert!(complaint.contains(what) && complaint.contains("is another"), "{complaint}");
        assert!(listing(&resumed.partial) == before);
    }
    // The lock.
    let holder = run::run::<Fake>(&plan(), &resumed, || anyhow::bail!("busy"), &(), &AtomicBool::new(false));
    assert!(holder.is_err());
    let held = fs::File::open(resumed.partial.join("lock")).unwrap();
    held.try_lock().unwrap();
    assert!(refused(&plan(), &resumed).contains("another run is at work"));
    drop(held);
    assert!(whole(&resumed) == expected());
}

#[test]
fn damaged_points_are_simulated_again() {
    let directory = tempfile::tempdir().unwrap();
    let resumed = Options { resume: true, ..options(directory.path()) };
    begin(&resumed, &plan(), 9);
    for (i, (path, mut bytes)) in listing(&resumed.partial).into_iter().enumerate() {
        let length = bytes.len();
        match i {
            0 => bytes.clear(),
            1 => bytes.truncate(length / 2),
            2 => bytes[length - 9] ^= 1,
            3 => bytes[length / 3] ^= 64,
            4 => bytes[3] ^= 1,
            5 => bytes.push(0),
            _ => continue,
        }
        fs::write(path, bytes).unwrap();
    }
    assert!(whole(&resumed) == expected());
}

/// No damage gets in: a record opens as it was, or not at all.
#[test]
fn no_damage_gets_into_a_record() {
    let directory = tempfile::tempdir().unwrap();
    let options = options(directory.path());
    begin(&options, &plan(), 1);
    let path = options.partial.join("000000.paths");
    let (sound, bytes) = (PathsRecord::open(&path).unwrap(), fs::read(&path).unwrap());
    let mut random = 0x2545_f491_4f6c_dd1d_u64;
    let mut next = |below: usize| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        (random % below as u64) as usize
    };
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for i in 0..1500 {
        let mut bad = bytes.clone();
        // Half of the damage goes to the header, which is small.
        let reach = if i % 2 == 0 { header } else { bad.len() };
        match next(4) {
            0 => bad.truncate(next(reach)),
            1 => bad[next(reach)] = b"0123456789[]{},\""[next(16)],
            2 => {
                let at = next(reach);
                bad.splice(at..at, bytes[..next(40)].to_vec());
            }
            _ => bad[next(reach)] ^= 1 << next(8),
        }
        fs::write(&path, &bad).unwrap();
        if let Ok(record) = PathsRecord::open(&path) {
            // Text that no number depends on may differ; a point's own may not.
            assert_eq!(record.points, sound.points);
        }
    }
}

#[test]
fn outputs_are_checked_first() {
    let directory = tempfile::tempdir().unwrap();
    let complaint = refused(&plan(), &options(&directory.path().join("missing")));
    assert!(complaint.contains("can't be written") && complaint.contains("folder exists"), "{complaint}");
    fs::write(directory.path().join("ball.body.partial"), "").unwrap();
    assert!(refused(&plan(), &options(directory.path())).contains("it is no folder"));
    fs::remove_file(directory.path().join("ball.body.partial")).unwrap();

    // What fails before the first point leaves nothing behind.
    let failed = run::run::<Fake>(
        &plan(),
        &options(directory.path()),
        || anyhow::bail!("no mesh"),
        &(),
        &AtomicBool::new(false),
    );
    assert!(failed.is_err());
    assert_eq!(listing(directory.path()).len(), 0);

    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let closed = directory.path().join("closed");
        fs::create_dir(&closed).unwrap();
        fs::set_permissions(&closed, fs::Permissions::from_mode(0o555)).unwrap();
        // To the superuser nothing is closed.
        if fs::write(closed.join("probe"), "").is_err() {
            let complaint = refused(&plan(), &options(&closed));
            assert!(complaint.contains("can't be written"), "{complaint}");
        }
    }
}

/// A signal before the first point ends the preparation with the stage under way, with a signal's status.
#[test]
fn a_signal_ends_the_preparation() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("spec.toml");
    let spec = Spec::parse(&path, SPEC.into()).unwrap();
    let simulation = spec.simulation(&path).unwrap();
    let error = prepare::prepare(&spec, &simulation, &path, &AtomicBool::new(true)).err().unwrap();
    assert_eq!(
        error.to_string(),
        "stopped while the run was prepared, after the volume's mesh: nothing was simulated or written"
    );
    assert!(matches!(Failure::from(error), Failure::Interrupted(_)));
}

/// Not a test: the process that others start, kill, and keep short of room.
#[test]
fn child() {
    let Some(folder) = std::env::var_os("PALPATE_TEST_RUN") else { return };
    let options = Options { resume: true, ..options(Path::new(&folder)) };
    let pause = std::env::var("PALPATE_TEST_PAUSE_MS").unwrap().parse().unwrap();
    let ready = || Ok(prepared(Duration::from_millis(pause)));
    match run::run(&plan(), &options, ready, &(), &AtomicBool::new(false)) {
        Ok((_, workspace)) => workspace.finish(&()).unwrap(),
        Err(Stopped::Error(e)) => {
            eprintln!("{}", palpate_files::message(&e));
            std::process::exit(1);
        }
        Err(Stopped::Cancelled { .. }) => std::process::exit(130),
    }
}

fn start(folder: &Path, shell: &str, pause_ms: u32) -> Child {
    let exe = std::env::current_exe().unwrap();
    Command::new("sh")
        .args(["-c", &format!("{shell} exec \"$0\" child --exact --nocapture"), exe.to_str().unwrap()])
        .env("PALPATE_TEST_RUN", folder)
        .env("PALPATE_TEST_PAUSE_MS", pause_ms.to_string())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

#[cfg(unix)]
#[test]
fn a_killed_run_goes_on() {
    let expected = expected();
    let directory = tempfile::tempdir().unwrap();
    let options = options(directory.path());
    let mut random = 12345_u64;
    let (mut kills, mut most) = (0, 0);
    loop {
        // The first ones would take longer than any machine is late with the kill.
        let mut child = start(directory.path(), "", if kills < 3 { 1000 } else { 8 });
        random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        // Ever later, so that it ends.
        std::thread::sleep(Duration::from_millis(5 + (random >> 33) % 60 + 4 * kills));
        child.kill().unwrap();
        let status = child.wait().unwrap();
        let kept = fs::read_dir(&options.partial).map_or(0, |d| {
            d.filter(|e| e.as_ref().unwrap().path().extension().is_some_and(|e| e == "paths")).count()
        });
        assert!(kept >= most || options.record.exists(), "{kept} points of {most} are left");
        most = most.max(kept);
        if status.success() {
            break;
        }
        kills += 1;
        assert!(kills < 500);
    }
    assert!(kills >= 3, "{kills}");
    assert!(!options.partial.exists(), "nothing half-written is in the way");
    assert!(fs::read(&options.record).unwrap() == expected.0);
    let record = PathsRecord::open(&options.record).unwrap();
    assert!(assemble::body(&record).unwrap().body.to_bytes().unwrap() == expected.1);
}

/// Files that may not grow stand for a disk without room.
#[cfg(unix)]
#[test]
fn without_room_points_are_kept() {
    let expected = expected();
    let directory = tempfile::tempdir().unwrap();
    let options = options(directory.path());
    let point = expected.0.len() / POINTS / 512;
    // The first is too little for a point that has states, the second for the whole.
    for (blocks, all) in [(point / 4, false), (4 * point, true)] {
        let output = start(directory.path(), &format!("trap '' XFSZ; ulimit -f {blocks};"), 8)
            .wait_with_output()
            .unwrap();
        let complaint = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{complaint}");
        assert!(complaint.contains("can't be written") && complaint.contains("room"), "{complaint}");
        let count = fs::read_dir(&options.partial).map_or(0, |d| {
            d.filter(|e| e.as_ref().unwrap().path().extension().is_some_and(|e| e == "paths")).count()
        });
        assert_eq!(count == POINTS, all, "{complaint}");
        assert!(!options.record.exists());
    }
    assert!(whole(&Options { resume: true, ..options }) == expected);
}
