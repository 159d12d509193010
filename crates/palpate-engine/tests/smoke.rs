//! smoke
mod common;
use common::*;
use glam::DVec3;
use palpate_engine::Contact;

#[test]
fn helix() {
    let mesh = cylinder(0.03, 0.1, 24, 11);
    let surface = palpate_body::Surface::build(&mesh, f64::INFINITY).unwrap();
    let body = body_of(surface, Feel { kz: &|p| 600.0 * (1.0 + 0.5 * p.x / 0.03), kr: &|_| 500.0, friction: &|_| 0.3, radius_m: 0.0 });
    for scale in [1.0, 10.0, 100.0] {
        let mut c = Contact::new(&body);
        let mut last = DVec3::ZERO;
        let (mut largest, mut excess) = (0.0f64, 0.0f64);
        let mut lx = DVec3::ZERO;
        let mut ll = 0.0;
        let n = (4000.0 * scale) as usize;
        for i in 0..=n {
            let t = i as f64 / n as f64;
            let depth = 0.005 * (t * 10.0).min(1.0) - 0.0005 + if t > 0.9 { -0.006 * (t - 0.9) * 10.0 } else { 0.0 };
            let a = 3.0 * t * 3.0;
            let r = 0.03 - depth;
            let x = DVec3::new(r * libm::cos(a), r * libm::sin(a), -0.02 + 0.04 * t);
            let o = step(&mut c, &body, x);
            let f = force(&o);
            let l = c.lipschitz_n_per_m(&body).unwrap_or(0.0);
            if i > 0 {
                largest = largest.max((f - last).length());
                let e = (f - last).length() - l.max(ll) * (x - lx).length();
                if e > excess { excess = e; println!("excess {e} at {t} {:?} {l} {ll}", o.flags); }
            }
            last = f; lx = x; ll = l;
        }
        println!("{scale} largest {largest} excess {excess} {:?} {:?}", c.energy(), c.counters());
    }
}

#[test]
fn speed() {
    for n in [24usize, 240, 1200] {
    let mesh = cylinder(0.03, 0.1, n, n * 11 / 24);
    let surface = palpate_body::Surface::build(&mesh, f64::INFINITY).unwrap();
    let body = body_of(surface, Feel { kz: &|p| 600.0 * (1.0 + 0.5 * p.x / 0.03), kr: &|_| 500.0, friction: &|_| 0.3, radius_m: 0.0 });
    let path: Vec<DVec3> = (0..20000).map(|i| { let a = i as f64 * 1e-4 / 0.027; DVec3::new(0.027 * libm::cos(a), 0.027 * libm::sin(a), -0.03 + 0.06 * i as f64 / 20000.0) }).collect();
    let mut c = Contact::new(&body);
    step(&mut c, &body, path[0] * 1.5);
    for round in 0..4 {
        let k0 = *c.counters();
        let t = std::time::Instant::now();
        for (i, p) in path.iter().enumerate() { if i == 0 && round > 0 { c = Contact::new(&body); step(&mut c, &body, path[0] * 1.5);} std::hint::black_box(step(&mut c, &body, *p)); }
        let e = t.elapsed().as_nanos() as f64 / path.len() as f64;
        println!("{n}: slide {e} ns  {:?}", c.counters());
        let _ = k0;
    }
    let o = step(&mut c, &body, path[19999]);
    let ce = DVec3::from_array(o.contact.unwrap().position_m);
    let t = std::time::Instant::now();
    for i in 0..200000 { let d = (i % 100) as f64 * 1e-6; std::hint::black_box(step(&mut c, &body, path[19999] + (ce - path[19999]) * d)); }
    println!("{n}: stick {} ns {:?}", t.elapsed().as_nanos() as f64 / 2e5, c.counters().slips);
    }
}
