//! A program that owns its session: a simulated device presses a ball; the program reads it 60 times a second, lowers the
//! largest force on the way, and ends it.
//!
//! `cargo run --release -p palpate --example own_session`

use palpate::body::{Response, shape::Shape};
use palpate::{Body, LiveSession, SessionConfig};
use std::error::Error;
use std::time::Duration;

fn main() -> Result<(), Box<dyn Error>> {
    // Or SessionBody::open("liver.body".as_ref(), None, None, false)?
    let ball = Shape::Sphere { radius_mm: 30.0 }.surface(Default::default())?;
    let body = Body::uniform(ball, Response::paper(2000.0, 1500.0, 0.3, 8e-3, 8e-3)?)?;
    // Or "dhd", "openhaptics", "haply", "replay:FILE".
    let config = SessionConfig {
        device: "simulated:touch".parse()?,
        motion: "press".into(),
        ..SessionConfig::default()
    };
    let session = LiveSession::start(body, config)?;
    for told in session.notes().iter().map(String::as_str).chain(session.advice()) {
        eprintln!("{told}");
    }
    for frame in 0..120 {
        if frame == 60 {
            // Through silence: no force rises faster than the soft start.
            session.controls().set_force_limit(1.0, None)?;
        }
        if let Some(now) = session.latest() {
            println!(
                "{:.3} s: {:.2} mm deep, {:.2?} N",
                now.time_s,
                now.delta_z_m * 1e3,
                now.command_force_n
            );
        }
        std::thread::sleep(Duration::from_millis(16));
    }
    session.stopper().stop("the program has seen enough");
    let outcome = session.join();
    println!("{}: {}", outcome.device, outcome.report.end);
    Ok(())
}
