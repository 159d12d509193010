//! cg
#[path = "../tests/common/mod.rs"]
mod common;
use common::*;
use glam::DVec3;
use palpate_engine::{Contact, Output};
#[inline(never)]
fn one(c: &mut Contact, b: &palpate_body::Body, p: DVec3) -> Output {
    step(c, b, p)
}
#[inline(never)]
fn slide(c: &mut Contact, b: &palpate_body::Body, path: &[DVec3]) {
    for p in path {
        std::hint::black_box(one(c, b, *p));
    }
}
#[inline(never)]
fn stick(c: &mut Contact, b: &palpate_body::Body, path: &[DVec3]) {
    for p in path {
        std::hint::black_box(1u8);
        std::hint::black_box(one(c, b, *p));
    }
}
fn main() {
    let n: usize = std::env::args().nth(1).unwrap().parse().unwrap();
    let mesh = cylinder(0.03, 0.1, n, n * 11 / 24);
    let surface = palpate_body::Surface::build(&mesh, f64::INFINITY).unwrap();
    let body = body_of(
        surface,
        Feel { kz: &|p| 600.0 * (1.0 + 0.5 * p.x / 0.03), kr: &|_| 500.0, friction: &|_| 0.3, radius_m: 0.0 },
    );
    let path: Vec<DVec3> = (0..2000)
        .map(|i| {
            let a = i as f64 * 1e-4 / 0.027;
            DVec3::new(0.027 * libm::cos(a), 0.027 * libm::sin(a), -0.03 + 0.006 * i as f64 / 2000.0)
        })
        .collect();
    let mut c = Contact::new(&body);
    step(&mut c, &body, path[0] * 1.5);
    slide(&mut c, &body, &path);
    println!("{:?}", c.counters());
    if let Some(r) = std::env::args().nth(2) {
        let reps: usize = r.parse().unwrap();
        for _ in 0..5 {
            let t = std::time::Instant::now();
            for _ in 0..reps {
                c = Contact::new(&body);
                step(&mut c, &body, path[0] * 1.5);
                slide(&mut c, &body, &path);
            }
            print!("slide {:.1} ns  ", t.elapsed().as_nanos() as f64 / (2000 * reps) as f64);
            let o = step(&mut c, &body, path[1999]);
            let ce = DVec3::from_array(o.contact.unwrap().position_m);
            let sp: Vec<DVec3> =
                (0..2000).map(|i| path[1999] + (ce - path[1999]) * ((i % 100) as f64 * 1e-6)).collect();
            let t = std::time::Instant::now();
            for _ in 0..reps {
                stick(&mut c, &body, &sp);
            }
            println!("stick {:.1} ns", t.elapsed().as_nanos() as f64 / (2000 * reps) as f64);
        }
    }
    let o = step(&mut c, &body, path[1999]);
    let ce = DVec3::from_array(o.contact.unwrap().position_m);
    let sp: Vec<DVec3> =
        (0..2000).map(|i| path[1999] + (ce - path[1999]) * ((i % 100) as f64 * 1e-6)).collect();
    stick(&mut c, &body, &sp);
}
