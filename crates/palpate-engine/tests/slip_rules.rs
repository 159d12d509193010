mod common;
use common::*;
use glam::DVec3;
use palpate_body::{Body, SlipRule, Surface};
use palpate_engine::{Ablation, Contact};
use std::f64::consts::PI;

fn prism(around: usize, friction: f64) -> Body {
    let mesh = cylinder(0.03, 0.1, around, 10);
    let stiffness = |p: DVec3| 600.0 * (1.0 + 0.5 * p.x / 0.03);
    body_of(
        Surface::build(&mesh, f64::INFINITY).unwrap(),
        Feel { kz: &stiffness, kr: &|_| 500.0, friction: &|_| friction, radius_m: 0.0 },
    )
}

fn cycle(body: &Body, rule: SlipRule, press: u32, drag: u32) -> (f64, f64, f64, palpate_engine::Counters) {
    let depth = 8e-3;
    let at = |angle: f64, r: f64| DVec3::new(r * libm::cos(angle), r * libm::sin(angle), 1e-3);
    let mut contact = Contact::with_slip(body, rule, Ablation::None);
    let down = (0..=press).map(|i| at(PI, 0.031 - (depth + 1e-3) * f64::from(i) / f64::from(press)));
    let round = (1..=drag).map(|i| at(PI * (1.0 - f64::from(i) / f64::from(drag)), 0.03 - depth));
    let up = (1..=press).map(|i| at(0.0, 0.022 + (depth + 1e-3) * f64::from(i) / f64::from(press)));
    let mut last: Option<(DVec3, DVec3)> = None;
    let (mut steepest, mut end) = (0.0f64, None);
    let mut felt = 0.0;
    for x in down.chain(round).chain(up) {
        let o = step(&mut contact, body, x);
        let f = force(&o);
        if let Some((y, g)) = last {
            let ratio = (f - g).length() / (x - y).length().max(1e-12);
            steepest = steepest.max(ratio);
            felt += 0.5 * (f + g).dot(x - y);
        }
        last = Some((x, f));
        end = Some(o);
    }
    let e = end.unwrap().energy;
    print!("felt {:.5} ", felt * 1e3);
    (-e.work_j * 1e3, steepest, e.generated_j * 1e3, *contact.counters())
}

#[test]
fn explore() {
    for (around, friction) in [(24, 0.0), (96, 0.0), (192, 0.0), (24, 0.1), (1536, 0.0)] {
        let body = prism(around, friction);
        for rule in SlipRule::ALL {
            for n in [6_000u32] {
                let t = std::time::Instant::now();
                let (out, steep, gen_, c) = cycle(&body, rule, 800, n);
                println!(
                    "{around} {friction} {} {n}: {out:.5} mJ  {steep:.0} N/m gen {gen_:.4} ev/slip {:.2} blocked {} capped {} {:?}",
                    rule.name(),
                    c.evaluations as f64 / c.slips as f64,
                    c.blocked,
                    c.capped,
                    t.elapsed()
                );
            }
        }
    }
}
