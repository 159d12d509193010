//! The sampled-data rule against measured limit cycles: a table on standard output, and a chart.
//!
//! `cargo run --release --example limit_cycles -- docs/images/limit-cycles.png`
//!
//! A tool of 0.1 kg without a hand's damping is pushed 4 mm into a paper plane, f = 100 k δ², by a constant force that
//! ends with a small jerk; whether what is left of it dies down or not is seen after that. The left and middle
//! charts are for a damped tool, without and with one sample of delay; the right one for a tool with friction and an
//! encoder of 0.05 mm, damped enough, that would rest between two steps of it.

use anyhow::{Context, Result, anyhow};
use glam::DVec3;
use palpate_body::Body;
use palpate_body::{BlendWeights, BodyParts, Provenance, Response, SlipRule, Surface, Tool, TriangleMesh};
use palpate_cli::plot::{COLOURS, Panel, png};
use palpate_device::simulated::{Hand, Move};
use palpate_device::{Figure, presets};
use palpate_files as files;
use palpate_runtime::motion::MotionScript;
use palpate_runtime::{HeldDevice, Safety, SessionConfig, run_held};
use plotters::prelude::*;
use rayon::prelude::*;
use std::path::PathBuf;

/// The loop's period, s.
const PERIOD: f64 = 1e-3;
/// How deep the push goes, m.
const DEPTH: f64 = 4e-3;
/// How long cycles are looked for, s: where the border is sought, and for the dots, which keep away from it.
const REST: [f64; 2] = [60.0, 20.0];

/// A tool at a stiffness.
#[derive(Debug, Clone, Copy)]
struct Case {
    /// f_z' where the push is in balance, N/m.
    stiffness: f64,
    /// N·s/m.
    damping: f64,
    /// s.
    delay: f64,
    /// c_f, N.
    coulomb: f64,
    /// m.
    resolution: f64,
}

impl Case {
    /// Whether the tool cycles.
    fn cycles(&self, seconds: f64) -> Result<bool> {
        // f = 100 k δ² has the slope 200 k δ and the force K δ/2. Between two steps of an encoder the rule's worst case.
        let depth = DEPTH + 0.5 * self.resolution;
        let force = 0.5 * self.stiffness * depth;
        let body = plane(self.stiffness / (200.0 * depth))?;
        let mut capabilities = presets::device("bench").context("no bench device")?;
        let m = &mut capabilities.mechanics;
        for (figure, value) in [
            (&mut m.damping_n_s_per_m, self.damping),
            (&mut m.delay_s, self.delay),
            (&mut m.coulomb_n, self.coulomb),
            (&mut m.resolution_m, self.resolution),
        ] {
            *figure = Figure::chosen(value);
        }
        let push = |force_n, seconds| Move::Push { force_n, seconds };
        let rest = Move::Hold { tremor_m: 0.0, tremor_hz: 0.0, seconds };
        let motion = MotionScript::of(vec![push(0.98 * force, 1.0), push(force, 0.02), rest]);
        // The bare loop: neither soft start nor any limit but the device's.
        let safety = Safety {
            force_max_n: Some(1e3),
            slew_n_per_s: Some(1e9),
            soft_start_s: 0.0,
            ..Safety::default()
        };
        let config = SessionConfig { rate_hz: 1.0 / PERIOD, safety, ..SessionConfig::default() };
        let held = HeldDevice::new(&body, capabilities, Hand::default(), &motion)?;
        Ok(!run_held(&body, held, &config, |_, _| Ok(()))?.limit_cycles.is_empty())
    }

    /// The least stiffness at which it cycles, N/m, to 2 %, sought around `near`.
    fn border(&self, near: f64) -> Result<f64> {
        let (mut quiet, mut cycles) = (near / 4.0, near * 4.0);
        while cycles / quiet > 1.02 {
            let middle = (quiet * cycles).sqrt();
            if (Case { stiffness: middle, ..*self }).cycles(REST[0])? {
                cycles = middle
            } else {
                quiet = middle
            }
        }
        Ok((quiet * cycles).sqrt())
    }
}

/// A flat patch of the paper's law.
fn plane(k: f64) -> Result<Body> {
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0) * 0.05;
    let positions = vec![at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
    let mesh = TriangleMesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] };
    let surface = Surface::build(&mesh, f64::INFINITY)?;
    Ok(Body::new(BodyParts {
        blends: vec![BlendWeights::own(0); surface.positions().len()],
        responses: vec![Response::paper(k, k, 0.3, 50e-3, 50e-3)?],
        surface,
        test_point_nodes: vec![0],
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance::default(),
    })?)
}

/// One chart, whose dots lie beside its border: what is on its x axis, how a case is made of it, and the predicted border.
struct Chart {
    title: &'static str,
    x_label: &'static str,
    x: (f64, f64),
    case: fn(f64, f64) -> Case,
    border: fn(f64) -> f64,
}

/// Half of the encoder's step of the third chart, m: the position's error.
const ERROR: f64 = 25e-6;

const CHARTS: [Chart; 3] = [
    Chart {
        title: "no delay: b = K T/2",
        x_label: "damping b (N·s/m)",
        x: (0.058, 2.33),
        case: |damping, stiffness| Case { stiffness, damping, delay: 0.0, coulomb: 0.0, resolution: 0.0 },
        border: |b| 2.0 * b / PERIOD,
    },
    Chart {
        title: "one sample of delay: b = 3 K T/2",
        x_label: "damping b (N·s/m)",
        x: (0.175, 7.0),
        case: |damping, stiffness| Case { stiffness, damping, delay: PERIOD, coulomb: 0.0, resolution: 0.0 },
        border: |b| b / (1.5 * PERIOD),
    },
    Chart {
        title: "encoder of 0.05 mm: c = K e",
        x_label: "Coulomb friction c (N)",
        x: (2.9e-3, 0.117),
        case: |coulomb, stiffness| Case {
            stiffness,
            damping: 2.5,
            delay: 0.0,
            coulomb,
            resolution: 2.0 * ERROR,
        },
        border: |c| c / ERROR,
    },
];

/// Stiffnesses of the charts, N/m.
const STIFFNESS: (f64, f64) = (100.0, 4000.0);
/// Points each way.
const GRID: usize = 13;

fn spread((low, high): (f64, f64), i: usize, of: usize) -> f64 {
    low * (high / low).powf(i as f64 / (of - 1) as f64)
}

fn main() -> Result<()> {
    let file = std::env::args_os().nth(1).map(PathBuf::from).context("name the chart's file")?;
    println!("| tool | predicted border (N/m) | measured (N/m) | measured/predicted |");
    println!("|---|---:|---:|---:|");
    for (chart, what) in CHARTS.iter().zip(["b (N·s/m)", "b, one sample late", "c (N), 0.05 mm"]) {
        let rows: Vec<_> = (0..5)
            .into_par_iter()
            .map(|i| {
                let x = spread((chart.x.0 * 1.5, chart.x.1 / 1.5), i, 5);
                let predicted = (chart.border)(x);
                Ok((x, predicted, (chart.case)(x, predicted).border(predicted)?))
            })
            .collect::<Result<_>>()?;
        for (x, predicted, measured) in rows {
            println!("| {what} = {x:.3} | {predicted:.0} | {measured:.0} | {:.2} |", measured / predicted);
        }
    }
    let points = |chart: &Chart| -> Result<Vec<(f64, f64, bool)>> {
        (0..GRID * GRID)
            .into_par_iter()
            .map(|i| {
                let (x, stiffness) = (spread(chart.x, i % GRID, GRID), spread(STIFFNESS, i / GRID, GRID));
                Ok((x, stiffness, (chart.case)(x, stiffness).cycles(REST[1])?))
            })
            .collect()
    };
    let charts = CHARTS.iter().map(points).collect::<Result<Vec<_>>>()?;
    let bytes = png((1350, 560), |area| {
        area.fill(&WHITE)?;
        for ((panel, chart), points) in area.split_evenly((1, 3)).iter().zip(&CHARTS).zip(&charts) {
            draw(panel, chart, points)?;
        }
        Ok(())
    })?;
    files::replace(&file, |out| Ok(out.write_all(&bytes)?))
}

/// A tick's number where it is 1, 2 or 5 times a power of ten: the others would run into each other.
fn round(value: f64) -> String {
    let digit = value / 10f64.powf((value * 1.001).log10().floor());
    if [1.0, 2.0, 5.0].iter().any(|d| (digit - d).abs() < 0.01) { format!("{value}") } else { String::new() }
}

fn draw(panel: &Panel, chart: &Chart, points: &[(f64, f64, bool)]) -> Result<()> {
    let around = |(low, high): (f64, f64)| (low / 1.15..high * 1.15).log_scale();
    let mut context = ChartBuilder::on(panel)
        .caption(chart.title, ("sans-serif", 24))
        .margin(14)
        .x_label_area_size(56)
        .y_label_area_size(70)
        .build_cartesian_2d(around(chart.x), around(STIFFNESS))?;
    context
        .configure_mesh()
        .x_desc(chart.x_label)
        .y_desc("stiffness K (N/m)")
        .axis_desc_style(("sans-serif", 19))
        .label_style(("sans-serif", 15))
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_label_formatter(&|v| round(*v))
        .y_label_formatter(&|v| round(*v))
        .draw()?;
    let of = |wanted: bool| points.iter().filter(move |p| p.2 == wanted).map(|p| (p.0, p.1));
    context
        .draw_series(of(true).map(|at| Circle::new(at, 6, COLOURS[1].filled())))?
        .label("cycles")
        .legend(|at| Circle::new((at.0 + 10, at.1), 6, COLOURS[1].filled()));
    context
        .draw_series(of(false).map(|at| Circle::new(at, 5, COLOURS[0].stroke_width(2))))?
        .label("quiet")
        .legend(|at| Circle::new((at.0 + 10, at.1), 5, COLOURS[0].stroke_width(2)));
    let line = (0..100).map(|i| spread(chart.x, i, 100)).map(|x| (x, (chart.border)(x)));
    let inside = line.filter(|p| (STIFFNESS.0..STIFFNESS.1).contains(&p.1));
    context
        .draw_series(LineSeries::new(inside, BLACK.stroke_width(3)))?
        .label("predicted border")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 20, y)], BLACK.stroke_width(3)));
    context
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .label_font(("sans-serif", 16))
        .background_style(WHITE.mix(1.0))
        .border_style(BLACK.mix(0.3))
        .draw()
        .map_err(|e| anyhow!("{e}"))
}
