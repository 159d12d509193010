//! What the tool does while it is timed. Poses are computed before.

use super::Row;
use super::cylinder::{LENGTH, RADIUS};
use super::timing::{BATCH, Clock};
use palpate_body::{Body, SlipRule};
use palpate_engine::{Ablation, Contact, Counters, Flags, Output, ToolState};
use std::f64::consts::PI;
use std::hint::black_box;

/// In the order in which they run: the cold ones before anything has warmed the caches.
pub const REGIMES: [&str; 5] = ["slide-cold", "slide", "stick", "free", "poke"];

/// m
const DEPTH: f64 = 3e-3;
/// Of a drag: 0.1 m/s at 1 kHz, m.
const STRIDE: f64 = 1e-4;
/// s
const PERIOD: f64 = 1e-3;

/// Runs a regime for about `steps` steps, with this slip rule, and with two contact points side by side where slip is `partial`.
pub fn run(
    body: &Body,
    rule: SlipRule,
    partial: bool,
    regime: &'static str,
    steps: usize,
    clock: &Clock,
) -> Row {
    let new = || Contact::with_slip(body, rule, Ablation::None).with_partial_slip(partial);
    let timed = match regime {
        // Two paths that never meet: one for batches, one for single steps.
        "slide-cold" => {
            let paths = [0.0, 0.5].map(|shift| helix(shift, 2e-3, steps.min(60_000)));
            along(body, &new, [&paths[0], &paths[1]], 0)
        }
        "slide" => {
            let path = repeated(there_and_back(helix(0.0, 0.04, 1885)), steps);
            along(body, &new, [&path, &path], path.len().min(4000))
        }
        "stick" => {
            let path = repeated(circle(), steps);
            along(body, &new, [&path, &path], path.len().min(400))
        }
        "free" => {
            let path = repeated(above(), steps);
            along(body, &new, [&path, &path], path.len().min(2000))
        }
        _ => poke(body, &new, (steps / 10).max(BATCH)),
    };
    let n = timed.singles.len().max(1) as f64;
    let Counts { evaluations, crossings, capped, slipping, in_contact } = timed.counts;
    Row {
        triangles: body.elements().len(),
        regime,
        anisotropic: !body.is_isotropic(),
        law: if body.is_coupled() { "coupled" } else { "decoupled" },
        slip: rule.name(),
        partial_slip: partial,
        steps: timed.singles.len(),
        evaluations_per_step: evaluations as f64 / n,
        crossings_per_step: crossings as f64 / n,
        slipping: slipping as f64 / n,
        in_contact: in_contact as f64 / n,
        capped,
        times: clock.sum_up(timed.batches, timed.singles),
    }
}

/// Raw times, ns, and what happened in the single steps.
#[derive(Default)]
struct Timed {
    batches: Vec<f64>,
    singles: Vec<f64>,
    counts: Counts,
}

#[derive(Default)]
struct Counts {
    evaluations: u64,
    crossings: u64,
    capped: u64,
    slipping: u64,
    in_contact: u64,
}

impl Counts {
    fn add_contact(&mut self, before: &Counters, after: &Counters) {
        self.evaluations += after.evaluations - before.evaluations;
        self.crossings += after.crossings - before.crossings;
        self.capped += after.capped - before.capped;
    }

    fn add_output(&mut self, output: &Output) {
        self.slipping += u64::from(output.flags.has(Flags::SLIPPING));
        self.in_contact += u64::from(output.flags.has(Flags::IN_CONTACT));
    }
}

/// Leads a contact along the first path for batches and along the second for single steps. The first `lead_in` steps
/// do not count.
fn along(
    body: &Body,
    new: &dyn Fn() -> Contact,
    [batched, single]: [&[ToolState]; 2],
    lead_in: usize,
) -> Timed {
    let mut timed = Timed::default();
    let mut contact = enter(body, new(), batched);
    for poses in batched.chunks_exact(BATCH).skip(lead_in / BATCH) {
        timed.batches.push(Clock::nanoseconds(|| {
            for pose in poses {
                black_box(contact.step(body, black_box(pose), PERIOD));
            }
        }));
    }
    let mut contact = enter(body, new(), single);
    let (lead_in, single) = single.split_at(lead_in.min(single.len()));
    for pose in lead_in {
        contact.step(body, pose, PERIOD);
    }
    let before = *contact.counters();
    timed.singles.reserve(single.len());
    for pose in single {
        let mut output = None;
        timed.singles.push(Clock::nanoseconds(|| {
            output = Some(black_box(contact.step(body, black_box(pose), PERIOD)))
        }));
        if let Some(output) = output {
            timed.counts.add_output(&output);
        }
    }
    timed.counts.add_contact(&before, contact.counters());
    timed
}

/// A contact that came to the first pose from straight outside, to where the drag or the circle begins.
fn enter(body: &Body, mut contact: Contact, path: &[ToolState]) -> Contact {
    if let Some(first) = path.first() {
        let [x, y, z] = first.position_m;
        let out = (RADIUS + 1e-3) / (x * x + y * y).sqrt();
        contact.step(body, &ToolState::at([x * out.max(1.0), y * out.max(1.0), z]), PERIOD);
        contact.step(body, first, PERIOD);
    }
    contact
}

/// Onsets at random places, 3 mm deep at once. Each contact waits 1 mm outside; it has come there from a place 60 mm
/// away in space and 10 mm along the surface, so that the triangles it will touch are not in the cache.
fn poke(body: &Body, new: &dyn Fn() -> Contact, count: usize) -> Timed {
    let mut timed = Timed::default();
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut waiting = || {
        let (angle, z) = (2.0 * PI * random.unit(), LENGTH * (0.8 * random.unit() - 0.4));
        let mut contact = new();
        contact.step(body, &at(angle, RADIUS + 0.06, if z > 0.0 { z - 0.01 } else { z + 0.01 }), PERIOD);
        contact.step(body, &at(angle, RADIUS + 1e-3, z), PERIOD);
        (contact, at(angle, RADIUS - DEPTH, z))
    };
    for batched in [true, false] {
        for _ in 0..count / BATCH {
            let mut contacts: Vec<_> = (0..BATCH).map(|_| waiting()).collect();
            if batched {
                timed.batches.push(Clock::nanoseconds(|| {
                    for (contact, pose) in &mut contacts {
                        black_box(contact.step(body, black_box(pose), PERIOD));
                    }
                }));
                continue;
            }
            for (contact, pose) in &mut contacts {
                let (before, mut output) = (*contact.counters(), None);
                timed.singles.push(Clock::nanoseconds(|| {
                    output = Some(black_box(contact.step(body, black_box(pose), PERIOD)))
                }));
                timed.counts.add_contact(&before, contact.counters());
                if let Some(output) = output {
                    timed.counts.add_output(&output);
                }
            }
        }
    }
    timed
}

fn at(angle: f64, radius: f64, z: f64) -> ToolState {
    ToolState::at([radius * libm::cos(angle), radius * libm::sin(angle), z])
}

/// A drag around the axis that climbs by `pitch` (m) a turn, from 40 mm below the middle, or from 20 mm if one turn
/// is all there is; turned on by `shift` of a pitch. It stays 10 mm away from the borders.
fn helix(shift: f64, pitch: f64, steps: usize) -> Vec<ToolState> {
    let turn = 2.0 * PI * RADIUS / STRIDE;
    let low = if pitch > 0.01 { -0.02 } else { -0.04 };
    let pose = |i: usize| {
        let turns = i as f64 / turn;
        at(2.0 * PI * turns, RADIUS - DEPTH, (low + pitch * (turns + shift)).min(0.04))
    };
    (0..steps).map(pose).collect()
}

fn there_and_back(path: Vec<ToolState>) -> Vec<ToolState> {
    let back: Vec<_> = path.iter().rev().copied().collect();
    path.into_iter().chain(back).collect()
}

/// Circles of 0.1 mm in 200 steps, 3 mm deep: the friction limit lies above 0.2 mm there.
fn circle() -> Vec<ToolState> {
    let pose = |i: usize| {
        let turn = 2.0 * PI * i as f64 / 200.0;
        let (side, z) = (1e-4 * (1.0 - libm::cos(turn)) / 2.0, 5e-3 + 5e-5 * libm::sin(turn));
        at(0.3 + side / RADIUS, RADIUS - DEPTH, z)
    };
    (0..200).map(pose).collect()
}

/// Around the body at 5 to 20 mm from it, at 0.1 m/s.
fn above() -> Vec<ToolState> {
    let steps = 2600;
    let pose = |i: usize| {
        let turn = 2.0 * PI * i as f64 / steps as f64;
        at(turn, RADIUS + 0.0125 + 0.0075 * libm::sin(5.0 * turn), 0.02 * libm::sin(turn))
    };
    (0..steps).map(pose).collect()
}

fn repeated(path: Vec<ToolState>, steps: usize) -> Vec<ToolState> {
    path.iter().copied().cycle().take(steps).collect()
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
