//! A recording gives back what was written, to the bit, as far as the file is whole; and nothing that happens to the
//! disk reaches the loop.

mod common;

use bytemuck::{Zeroable, bytes_of, bytes_of_mut};
use common::Random;
use common::faulty::{Faulty, Odds};
use common::plane;
use glam::DVec3;
use palpate_body::Body;
use palpate_device::simulated::{Hand, Move, Script};
use palpate_device::{Device, Simulated, presets};
use palpate_engine::{Contact, Flags};
use palpate_runtime::{
    BodyFile, Ending, HapticLoop, Header, Record, RecorderThread, Recording, RecordingFile, Retrace, Safety,
    WorkspaceMap, ring,
};
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

fn header() -> Header {
    Header {
        program: "palpate".into(),
        began_unix_s: 1.7e9 + 0.1,
        rate_hz: 1000.0,
        body: BodyFile { name: "tube \"1\".body".into(), sha256: "0123".into() },
        slip: "paper".into(),
        tank: true,
        partial_slip: false,
        ablation: "none".into(),
        device: "Touch".into(),
        safety: Some(Safety { slew_n_per_s: Some(1e5 / 3.0), ..Safety::default() }),
        coupling_n_per_m: Some(0.1 + 0.2),
        coupling_nm_per_rad: Some(1.0 / 7.0),
        map: WorkspaceMap { offset_m: DVec3::splat(1.0 / 3.0), clutch: Some(2), ..WorkspaceMap::default() }
            .into(),
    }
}

/// Records of random bits: every f64 that there is may be among them.
fn noise(count: u64, seed: u64) -> Vec<Record> {
    let mut rng = Random::new(seed);
    let mut record = |number| {
        let mut record = Record::zeroed();
        bytes_of_mut(&mut record).iter_mut().for_each(|b| *b = rng.below(256) as u8);
        Record { kind: Record::PERIOD, number, ..record }
    };
    (0..count).map(&mut record).collect()
}

fn file(records: &[Record], end: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut file = RecordingFile::begin(&mut bytes, &header()).unwrap();
    records.iter().for_each(|r| file.write(r).unwrap());
    if end {
        file.end("asked to stop", records.len() as u64, 7).unwrap();
    }
    bytes
}

/// All but the checksum, which is the file's.
fn same(a: &Record, b: &Record) -> bool {
    let bytes = |r: &Record| bytes_of(r)[..Record::BYTES - 4].to_vec();
    bytes(a) == bytes(b)
}

fn read(bytes: &[u8]) -> Result<(Vec<Record>, Ending), String> {
    let mut recording = Recording::read(bytes, Path::new("a.rec")).map_err(|e| e.to_string())?;
    assert_eq!(recording.header(), &header());
    let records = recording.by_ref().collect();
    Ok((records, recording.ending().unwrap().clone()))
}

#[test]
fn what_is_written_comes_back_to_the_bit() {
    let records = noise(500, 1);
    let (back, ending) = read(&file(&records, true)).unwrap();
    assert!(back.len() == 500 && back.iter().zip(&records).all(|(a, b)| same(a, b)));
    assert_eq!(ending, Ending::Clean { reason: "asked to stop".into(), dropped: 7 });
    let wrong = RecordingFile::begin(Vec::new(), &Header { rate_hz: f64::NAN, ..header() });
    assert!(wrong.unwrap_err().to_string().contains("NaN or infinite"));
    // A reason that is too long is cut between two letters.
    let mut bytes = Vec::new();
    RecordingFile::begin(&mut bytes, &header()).unwrap().end(&"ä".repeat(1000), 0, 0).unwrap();
    assert_eq!(read(&bytes).unwrap().1, Ending::Clean { reason: "ä".repeat(256), dropped: 0 });
}

#[test]
fn a_file_cut_anywhere_is_read_up_to_there() {
    let records = noise(3, 2);
    let bytes = file(&records, true);
    let start = file(&[], false).len();
    for length in 0..bytes.len() {
        match read(&bytes[..length]) {
            Err(error) => {
                assert!(length < start && error.contains("it ends within its"), "{length}: {error}")
            }
            Ok((back, ending)) => {
                assert_eq!(back.len(), (length - start) / Record::BYTES);
                assert!(back.iter().zip(&records).all(|(a, b)| same(a, b)));
                let left_over = ((length - start) % Record::BYTES) as u64;
                assert_eq!(ending, Ending::Cut { left_over });
            }
        }
    }
}

/// Every byte in turn, by one bit: records before it are given, the one that it is in never.
#[test]
fn a_damaged_byte_is_never_taken_for_a_record() {
    let records = noise(3, 3);
    let bytes = file(&records, true);
    let start = file(&[], false).len();
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (at % 8);
        match read(&damaged) {
            Err(error) => assert!(at < start && error.contains("a.rec: "), "{at}: {error}"),
            Ok((back, ending)) => {
                let record = (at - start) / Record::BYTES;
                assert!(back.len() == record && back.iter().zip(&records).all(|(a, b)| same(a, b)));
                assert_eq!(ending, Ending::Damaged { record: record as u64 });
            }
        }
    }
}

#[test]
fn a_recording_is_not_overwritten_unless_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rec");
    let begin = |path: &Path, replace| RecordingFile::create(path, replace, &header());
    begin(&path, false).unwrap().end("first", 0, 0).unwrap();
    let error = begin(&path, false).unwrap_err().to_string();
    assert!(error.contains("a.rec: it is there already"), "{error}");
    assert_eq!(
        read(&std::fs::read(&path).unwrap()).unwrap().1,
        Ending::Clean { reason: "first".into(), dropped: 0 }
    );
    begin(&path, true).unwrap().end("second", 0, 0).unwrap();
    let mut recording = Recording::open(&path).unwrap();
    assert!(recording.next().is_none());
    assert_eq!(recording.ending(), Some(&Ending::Clean { reason: "second".into(), dropped: 0 }));
    for wrong in [folder.path(), &folder.path().join("none/a.rec")] {
        assert!(begin(wrong, false).is_err() && Recording::open(wrong).is_err());
    }
}

/// Made once, by `palpate run --rate-hz 100 --scale 2 --patch-elements 64`, of 0.16 s: down into a block and along. Recordings
/// can't be made again: a change of format that no longer reads this one needs a version of its own.
#[test]
fn a_recording_of_version_1_that_is_there_is_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recordings/version-1.rec");
    let mut recording = Recording::open(&path).unwrap();
    let header = recording.header().clone();
    assert_eq!((header.program.as_str(), header.began_unix_s), ("palpate 0.1.0", 1_795_887_981.306_205_5));
    assert_eq!(
        (header.rate_hz, header.slip.as_str(), header.ablation.as_str()),
        (100.0, "consistent", "none")
    );
    assert_eq!((header.body.name.as_str(), &header.body.sha256[..8]), ("block.body", "480f7d39"));
    assert_eq!((header.device.as_str(), header.coupling_n_per_m), ("3D Systems Touch", None));
    assert_eq!(header.safety.unwrap(), Safety { soft_start_s: 0.02, ..Safety::default() });
    assert_eq!((header.map.scale, header.map.clutch), (2.0, None));
    let records: Vec<Record> = recording.by_ref().collect();
    let clean = Ending::Clean { reason: "the time is over".into(), dropped: 0 };
    assert_eq!(recording.ending(), Some(&clean));
    assert!(records.iter().map(|r| r.number).eq(0..18));

    let sliding = &records[16];
    assert_eq!((sliding.time_s, sliding.lateness_ns, sliding.read_ns), (0.16, 61, 25_657));
    assert_eq!((sliding.device_sequence, sliding.device_position_m), (18, [0.006_105, 0.0, -0.001_76]));
    assert_eq!(sliding.tool_position_m[0], 0.012_21);
    assert_eq!(sliding.force_n[2], 0.743_423_999_999_999_3);
    assert_eq!((sliding.command_force_n, sliding.command_torque_nm), (sliding.force_n, [0.0; 3]));
    assert_eq!((sliding.element, sliding.area_coordinates[0]), (458, 0.823_605_44));
    assert_eq!(
        (sliding.delta_z_m, sliding.dissipated_j),
        (0.003_519_999_999_999_999, 0.011_719_198_028_060_155)
    );
    assert_eq!((sliding.patch_serial, sliding.patch_count), (2, 64));
    assert_eq!(sliding.patch_centre_m[0], 0.005_246_067_2);
    assert!(
        sliding.engine().has(Flags::IN_CONTACT)
            && sliding.engine().has(Flags::SLIPPING)
            && sliding.tool().is_some()
    );
    assert_eq!((records[17].tool(), records[17].command_force_n), (None, [0.0; 3]));

    // The level of the tank is not known: where it is now there were spare words.
    assert!(records.iter().all(|r| r.tank_j.is_nan()));
    // Else what is written today has the same bytes, and version 3.
    let bytes = std::fs::read(&path).unwrap();
    let mut again = RecordingFile::begin(Vec::new(), &header).unwrap();
    records.iter().for_each(|r| again.write(&Record { tank_j: 0.0, ..*r }).unwrap());
    let again = again.end("the time is over", 18, 0).unwrap();
    let tail = bytes.len() - 19 * Record::BYTES;
    assert!(again.ends_with(&bytes[tail..]) && again[..8] == bytes[..8]);
    assert_eq!((bytes[8], again[8]), (1, 3));
    assert!(records.iter().all(|r| r.squares_rad2 == 0.0 && r.sample().angular_velocity_rad_per_s.is_none()));
}

/// The numbers in a recording are those of its page: who reads it in another language has nothing else.
#[test]
fn the_faults_in_a_recording_are_what_its_page_says() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/recording.md");
    let page = std::fs::read_to_string(page).unwrap();
    let (_, table) = page.split_once("| `fault` | `Fault` | |").unwrap();
    let rows = table.lines().skip(2).take_while(|line| line.starts_with('|'));
    let cells = |row: &str| row.split('|').map(|cell| cell.trim().trim_matches('`').to_owned()).collect();
    let rows: Vec<Vec<String>> = rows.map(cells).collect();
    for (code, row) in rows.iter().enumerate() {
        let record = Record { fault: code as u32, fault_code: -7, ..Record::zeroed() };
        let name = record.fault().map(|fault| format!("{fault:?}").replace("(-7)", ""));
        assert_eq!((&row[1], &row[2]), (&code.to_string(), &name.unwrap_or_default()), "{row:?}");
    }
    assert_eq!(rows.len(), 7);
    assert_eq!(Record { fault: 7, ..Record::zeroed() }.fault(), None);
    // The header of every recording says the same.
    let about = Record::fields().into_iter().find(|field| field.name == "fault").unwrap().about;
    for (code, words) in
        [(1, "not open"), (2, "gone"), (3, "in time"), (4, "understood"), (5, "vendor"), (6, "ended")]
    {
        let (_, said) = about.split_once(&format!(" {code} ")).unwrap();
        assert!(said.split(',').next().unwrap().contains(words), "{about}");
    }
}

/// The header of a version-1 file, its JSON changed by `change`, with other records behind it.
fn version_1(records: &[Record], change: impl Fn(String) -> String) -> Vec<u8> {
    let there = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recordings/version-1.rec");
    let old = std::fs::read(there).unwrap();
    let length = u32::from_le_bytes(old[12..16].try_into().unwrap()) as usize;
    let json = change(String::from_utf8(old[16..16 + length].to_vec()).unwrap());
    let mut bytes = old[..12].to_vec();
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(json.as_bytes());
    bytes.extend(crc32fast::hash(json.as_bytes()).to_le_bytes());
    let new = file(records, true);
    bytes.extend(&new[file(&[], false).len()..]);
    bytes
}

/// A device of three axes fills records as it did version 1's, but for the tank's level.
#[test]
fn a_recording_of_version_1_plays_again_to_the_bit() {
    let body = plane(600.0, 500.0, 0.3);
    let records = loop_records(&body);
    let bytes = version_1(&records, |json| json);
    let mut recording = Recording::read(&bytes[..], Path::new("a.rec")).unwrap();
    let mut again = Retrace::new(&body, Contact::new(&body));
    let mut steps = 0;
    for (record, written) in recording.by_ref().zip(&records) {
        assert!(same(&record, &Record { tank_j: f64::NAN, ..*written }));
        let Some(output) = again.step(&record).unwrap() else { continue };
        assert_eq!(output.force_n.map(f64::to_bits), record.force_n.map(f64::to_bits));
        assert_eq!(output.energy.work_j.to_bits(), record.work_j.to_bits());
        steps += 1;
    }
    assert!(steps > 500, "{steps}");
}

/// The tank's level is in a recording as the engine had it, and says where there was no tank.
#[test]
fn a_recording_has_the_tanks_level() {
    let body = plane(600.0, 500.0, 0.3);
    for tank in [true, false] {
        // Where nothing goes wrong the contact slips.
        let odds = Odds { no_number: 0.0, frozen: 0.0, jump: 0.0, read_error: 0.0, write_error: 0.0 };
        let records = loop_records_with(&body, Contact::new(&body).with_tank(tank), odds);
        let bytes = file(&records, true);
        let mut again = Retrace::new(&body, Contact::new(&body).with_tank(tank));
        let mut levels = Vec::new();
        for record in Recording::read(&bytes[..], Path::new("a.rec")).unwrap() {
            let Some(output) = again.step(&record).unwrap() else { continue };
            let level = if tank { output.energy.tank_j } else { f64::NAN };
            assert_eq!(record.tank_j.to_bits(), level.to_bits());
            levels.push(level);
        }
        assert_eq!(levels.iter().any(|level| *level > 1e-6), tank);
        assert!(levels.len() > 500);
    }
}

/// A header is believed about where its fields lie, and refused where that is elsewhere.
#[test]
fn a_field_that_lies_elsewhere_is_refused() {
    let told = |change: fn(String) -> String| {
        Recording::read(&version_1(&[], change)[..], Path::new("a.rec"))
            .map(|_| ())
            .map_err(|e| e.to_string())
    };
    assert_eq!(told(|json| json), Ok(()));
    for change in [
        |json: String| json.replacen("\"offset\":16,", "\"offset\":17,", 1),
        |json: String| json.replacen("\"name\":\"time_s\"", "\"name\":\"time_ms\"", 1),
        |json: String| json.replacen("\"count\":8,", "\"count\":7,", 1),
    ] {
        let error = told(change).unwrap_err();
        assert!(error.contains("its records are not those of this version"), "{error}");
    }
}

/// Somewhere to write that other threads can look into, and that has room for so many bytes.
#[derive(Clone)]
struct Disk(Arc<Mutex<Vec<u8>>>, usize);

impl Disk {
    fn new(room: usize) -> Self {
        Disk(Arc::default(), room)
    }
    fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().clone()
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut written = self.0.lock().unwrap();
        let count = bytes.len().min(self.1 - written.len());
        if count == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        written.extend(&bytes[..count]);
        Ok(count)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_ends_the_writing_and_nothing_else() {
    let records = noise(40, 4);
    let start = file(&[], false).len();
    for room in [start, start + 1, start + 10 * Record::BYTES + 100, start + 39 * Record::BYTES] {
        let disk = Disk::new(room);
        let (mut recorder, end) = ring(64);
        let file = RecordingFile::begin(disk.clone(), &header()).unwrap();
        let recorder_thread = RecorderThread::start(end, Some(file), 1000.0).unwrap();
        records.iter().for_each(|r| assert!(recorder.push(r)));
        let begun = Instant::now();
        let told = loop {
            if let Some(told) = recorder_thread.trouble() {
                break told;
            }
            assert!(begun.elapsed() < Duration::from_secs(20));
            std::thread::sleep(Duration::from_millis(2));
        };
        assert!(told.contains("the recording ends here") && recorder_thread.trouble().is_none(), "{told}");
        records.iter().for_each(|r| assert!(recorder.push(r) || recorder.dropped() > 0));
        let finished = recorder_thread.finish("the end");
        let whole = (room - start) / Record::BYTES;
        assert_eq!(finished.summary.periods + finished.summary.dropped_records, 80);
        // At least so many: what the disk had taken when it was last asked.
        assert!(finished.written <= whole as u64, "{}", finished.written);
        assert_eq!(finished.trouble, Some(told));
        let (back, ending) = read(&disk.bytes()).unwrap();
        assert!(back.len() == whole && back.iter().zip(&records).all(|(a, b)| same(a, b)));
        assert_eq!(ending, Ending::Cut { left_over: ((room - start) % Record::BYTES) as u64 });
    }
}

#[test]
fn a_full_ring_drops_and_counts() {
    let records = noise(10, 5);
    let (mut recorder, end) = ring(4);
    assert_eq!(records.iter().filter(|r| recorder.push(r)).count(), 4);
    assert_eq!(recorder.dropped(), 6);
    let disk = Disk::new(usize::MAX);
    let file = RecordingFile::begin(disk.clone(), &header()).unwrap();
    let recorder_thread = RecorderThread::start(end, Some(file), 1000.0).unwrap();
    // The haptic thread may be gone long before anybody says why.
    drop(recorder);
    std::thread::sleep(Duration::from_millis(30));
    let finished = recorder_thread.finish("the end");
    assert_eq!((finished.summary.dropped_records, finished.written), (6, 4));
    let (back, ending) = read(&disk.bytes()).unwrap();
    assert_eq!(back.iter().map(|r| r.number).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert_eq!(ending, Ending::Clean { reason: "the end".into(), dropped: 6 });
}

/// Whoever listens hears of every period that came through the ring, in order; then of none.
#[test]
fn a_listener_hears_every_period_until_it_leaves() {
    let records = noise(200, 7);
    let (mut recorder, end) = ring(256);
    let recorder_thread = RecorderThread::start::<Disk>(end, None, 1000.0).unwrap();
    let (sender, heard) = std::sync::mpsc::channel();
    recorder_thread.listen(Some(Box::new(move |r: &Record| sender.send(r.number).unwrap())));
    records.iter().take(100).for_each(|r| assert!(recorder.push(r)));
    let numbers: Vec<u64> = (0..100).map(|_| heard.recv_timeout(Duration::from_secs(60)).unwrap()).collect();
    assert_eq!(numbers, (0..100).collect::<Vec<u64>>());
    recorder_thread.listen(None);
    records.iter().skip(100).for_each(|r| assert!(recorder.push(r)));
    assert_eq!(recorder_thread.finish("the end").summary.periods, 200);
    assert!(heard.recv().is_err());
}

/// What is older than half a second is on the disk, whatever becomes of the program; a recorder thread without a file counts.
#[test]
fn half_a_second_is_the_most_that_a_kill_takes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rec");
    let file = RecordingFile::create(&path, false, &header()).unwrap();
    let records = noise(100, 6);
    let (mut recorder, end) = ring(256);
    let recorder_thread = RecorderThread::start(end, Some(file), 1000.0).unwrap();
    records.iter().for_each(|r| assert!(recorder.push(r)));
    let begun = Instant::now();
    while read(&std::fs::read(&path).unwrap()).unwrap().0.len() < 100 {
        // Half a second on a machine that has time; other work beside may make it longer.
        assert!(begun.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(20));
    }
    println!("flushed after {:?}", begun.elapsed());
    assert_eq!(read(&std::fs::read(&path).unwrap()).unwrap().1, Ending::Cut { left_over: 0 });
    assert_eq!(recorder_thread.summary().periods, 100);
    drop((recorder, recorder_thread));
    let (mut recorder, end) = ring(256);
    let recorder_thread = RecorderThread::start::<Disk>(end, None, 1000.0).unwrap();
    records.iter().for_each(|r| assert!(recorder.push(r)));
    let finished = recorder_thread.finish("the end");
    assert_eq!((finished.summary.periods, finished.written), (100, 0));
}

fn loop_records(body: &Body) -> Vec<Record> {
    let odds = Odds { no_number: 0.01, frozen: 0.005, jump: 0.005, read_error: 0.01, write_error: 0.01 };
    loop_records_with(body, Contact::new(body), odds)
}

fn loop_records_with(body: &Body, contact: Contact, odds: Odds) -> Vec<Record> {
    let capabilities = presets::device("touch").unwrap();
    let mut stages = Safety { soft_start_s: 0.05, passivity: true, ..Safety::default() };
    stages.damping_n_s_per_m = 1.0;
    let stages = stages.stages(&capabilities, 1000.0).unwrap();
    let moves = [
        Move::Press { depth_m: 6e-3, seconds: 0.2 },
        Move::Drag { along_m: 0.02, across_m: 5e-3, seconds: 0.4 },
        Move::Tap { depth_m: -8e-3, times: 3, seconds: 0.4 },
    ];
    let script = Script::new(DVec3::new(1e-3, 2e-3, 0.0), 1e-3, -DVec3::Z, DVec3::X, &moves).unwrap();
    let hand = Hand { mass_kg: 0.01, damping_n_s_per_m: 2.0, stiffness_n_per_m: 300.0, ..Hand::default() };
    let mut device = Faulty::new(Simulated::new(capabilities, hand, Box::new(script)), odds, 7);
    device.open().unwrap();
    let map = WorkspaceMap { clutch: Some(0), ..WorkspaceMap::default() };
    let mut haptics = HapticLoop::new(contact, map, stages);
    let period = |k: u64| {
        let period = haptics.period(body, &mut device, k as f64 * 1e-3);
        let record = Record::new(k, &haptics, &period);
        assert_eq!(format!("{:?}", record.sample()), format!("{:?}", period.sample));
        assert_eq!((record.fault(), record.stages()), (period.fault, period.flags));
        assert_eq!(record.engine(), period.output.flags);
        record
    };
    (0..1000).map(period).collect()
}

/// What the engine was given is enough for the same forces, energies and contact points, bit by bit.
#[test]
fn the_engines_part_of_a_recording_plays_again_bit_for_bit() {
    let body = plane(600.0, 500.0, 0.3);
    let records = loop_records(&body);
    let (back, _) = read(&file(&records, true)).unwrap();
    let mut contact = Contact::new(&body);
    let mut stepped = 0;
    for record in back {
        let Some(pose) = record.tool() else { continue };
        let output = contact.step(&body, &pose, 1e-3);
        stepped += u32::from(output.flags.has(Flags::IN_CONTACT));
        let bits = |v: &[f64]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&output.force_n), bits(&record.force_n));
        let energy = output.energy;
        assert_eq!(bits(&[energy.work_j, energy.dissipated_j]), bits(&[record.work_j, record.dissipated_j]));
        assert_eq!(output.contact.map_or(Record::NONE, |c| c.element), record.element);
        assert_eq!(bits(&output.contact.map_or([0.0; 3], |c| c.n)), bits(&record.area_coordinates));
        assert_eq!(output.flags, record.engine());
    }
    assert!(stepped > 300, "{stepped}");
}
