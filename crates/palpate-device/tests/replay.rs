//! Recorded poses come back at their times, and end.

use palpate_device::{Command, Device, Fault, Pose, Replay, ReplaySample};

fn at(time_s: f64, x: f64) -> ReplaySample {
    ReplaySample { time_s, pose: Pose { position_m: [x, 0.0, 0.0], ..Pose::default() }, buttons: x as u32 }
}

#[test]
fn the_newest_that_is_not_after_now() {
    let mut replay = Replay::new(vec![at(0.1, 1.0), at(0.2, 2.0), at(0.2, 3.0), at(0.3, 4.0)]);
    assert_eq!(replay.read(0.0), Err(Fault::NotOpen));
    replay.open().unwrap();
    let mut read = |now_s| replay.read(now_s).map(|s| (s.pose.position_m[0], s.sequence, s.buttons));
    assert_eq!(read(0.0), Ok((1.0, 1, 1)));
    assert_eq!(read(0.1), Ok((1.0, 1, 1)));
    assert_eq!(read(0.19), Ok((1.0, 1, 1)));
    assert_eq!(read(0.2), Ok((3.0, 3, 3)));
    // A slow loop too sees the last sample, once.
    assert_eq!(read(0.9), Ok((4.0, 4, 4)));
    assert_eq!(read(0.901), Err(Fault::Ended));
    assert_eq!(read(0.902), Err(Fault::Ended));
    assert_eq!(replay.write(&Command::default()), Ok(()));
    replay.close();
    assert_eq!(replay.write(&Command::default()), Err(Fault::NotOpen));
    replay.open().unwrap();
    assert_eq!(replay.read(0.0).unwrap().sequence, 1);
}

/// Sample by sample, and the last one at its own time.
#[test]
fn at_the_loops_rate_nothing_is_left_out() {
    let mut replay = Replay::new((0..1000).map(|k| at(f64::from(k) * 1e-3, f64::from(k))).collect());
    replay.open().unwrap();
    for k in 0..1000 {
        assert_eq!(replay.read(f64::from(k) * 1e-3).unwrap().pose.position_m[0], f64::from(k));
    }
    assert_eq!(replay.read(1.0), Err(Fault::Ended));
}

#[test]
fn what_cant_be_replayed_is_refused() {
    for (samples, says) in [
        (vec![], "no sample"),
        (vec![at(0.0, 0.0), at(1.0, 0.0), at(0.5, 0.0)], "sample 3 is at 0.5 s, after one at 1 s"),
        (vec![at(f64::NAN, 0.0)], "sample 1 is at NaN s"),
        (vec![at(f64::INFINITY, 0.0)], "sample 1 is at inf s"),
    ] {
        let error = Replay::new(samples).open().unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}

/// A fault that was recorded is one again.
#[test]
fn no_numbers() {
    let mut replay = Replay::new(vec![at(0.0, 1.0), at(0.1, f64::NAN), at(0.2, 2.0)]);
    replay.open().unwrap();
    assert!(replay.read(0.0).is_ok());
    assert_eq!(replay.read(0.1), Err(Fault::Garbled));
    assert!(replay.read(0.2).is_ok());
    assert_eq!(replay.capabilities().workspace.half_extent_m[0], 0.5);
}
