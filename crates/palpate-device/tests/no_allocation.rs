//! `read` and `write` of every driver allocate nothing in the loop's thread, faults included.

mod stand_in;

use assert_no_alloc::{AllocDisabler, assert_no_alloc};
use palpate_device::{
    Command, Device, Dhd, DhdOptions, Fault, Haply, HaplyOptions, OpenHaptics, OpenHapticsOptions, Pose,
    Replay, ReplaySample,
};
use stand_in::Built;
use std::net::TcpListener;
use std::thread;
use std::time::Duration;
use tungstenite::Message;

#[global_allocator]
static GUARD: AllocDisabler = AllocDisabler;

/// Runs the loop, and gives how many periods went well.
fn run(device: &mut dyn Device) -> u32 {
    device.open().unwrap();
    let mut good = 0;
    for k in 0..300_u32 {
        let now_s = f64::from(k) * 1e-3;
        let command = Command { force_n: [0.0, 0.0, f64::from(k)], ..Command::default() };
        let period = assert_no_alloc(|| {
            let read = device.read(now_s);
            device.write(&command).and(read)
        });
        good += u32::from(period.is_ok());
        thread::sleep(Duration::from_micros(200));
    }
    good
}

#[test]
fn dhd() {
    let library = Built::new("dhd").copy();
    library.set("wrist", 1.0);
    let options = DhdOptions { library: Some(library.file.clone()), ..DhdOptions::default() };
    let mut device = Dhd::new(options);
    assert_eq!(run(&mut device), 300);
    assert!(library.take_log().len() > 600);
    library.set("position", -1.0);
    assert_eq!(run(&mut device), 0);
}

#[test]
fn openhaptics() {
    let library = Built::new("openhaptics").copy();
    let options = OpenHapticsOptions { library: Some(library.file.clone()), ..OpenHapticsOptions::default() };
    let mut device = OpenHaptics::new(options);
    assert!(run(&mut device) > 200);
    library.set("error", f64::from(0x302));
    thread::sleep(Duration::from_millis(20));
    assert_eq!(assert_no_alloc(|| device.read(0.0)), Err(Fault::Disconnected));
}

#[test]
fn haply() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("ws://{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        let state = r#"{"inverse3":[{"device_id":"1","state":{"cursor_position":{"x":0,"y":0,"z":0}}}]}"#;
        let mut socket = tungstenite::accept(listener.accept().unwrap().0).unwrap();
        socket.send(Message::text(state)).unwrap();
        while socket.read().is_ok() && socket.send(Message::text(state)).is_ok() {}
    });
    let mut device = Haply::new(HaplyOptions { url, ..HaplyOptions::default() });
    assert!(run(&mut device) > 200);
}

#[test]
fn replay() {
    let sample = |k: u32| ReplaySample { time_s: f64::from(k) * 1e-3, pose: Pose::default(), buttons: 0 };
    let mut device = Replay::new((0..200).map(sample).collect());
    assert_eq!(run(&mut device), 200);
    assert_eq!(assert_no_alloc(|| device.read(1.0)), Err(Fault::Ended));
}
