//! `palpate certify`.

use super::Failure;
use crate::{console, vtu};
use palpate_body::{Body, SlipRule};
use palpate_certify::witness::Shown;
use palpate_certify::{Certificate, Certified, Element, Holds, Question, Verdict, certify, device, floor};
use palpate_device::presets;
use palpate_engine::Waypoint;
use palpate_engine::certify::Assumptions;
use palpate_files as files;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Prove that a body is passive and free of snaps, or show where it is not
///
/// For every element, all depths and all directions of slip: P (passive), no slip makes energy out of nothing; S (snap
/// free), no slip runs away; L, how fast the force can change. Proved by bounds of the curves' polynomials, up to
/// rounding; beside each bound stands the worst state that a search found. What is neither proved nor broken is
/// undecided, and does not hold. Where a certificate is broken, --witness writes a tool path that shows it when traced.
///
/// With a device's damping the depth and force down to which the sampled loop is passive are printed.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  palpate certify liver.body --witness witness --vtu liver-margins.vtu\n  \
                        palpate certify liver.body --device touch\n  \
                        palpate certify liver.body --slip paper --raise-friction -o liver-passive.body\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage, 3 a certificate does not hold."
)]
pub struct Args {
    /// Body file
    body: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Slip rule, in place of the body's own
    #[arg(long, value_enum)]
    slip: Option<super::Slip>,
    /// Longest way of the tool from one step to the next, mm
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    step_mm: f64,
    /// Deepest that the tool goes, mm; the curves' end if not given
    #[arg(long, value_name = "X")]
    depth_mm: Option<f64>,
    /// Bounds computed for each element and certificate, at most; 3000 for the rule paper, 600 for the others if not given
    #[arg(long, value_name = "N")]
    evaluations: Option<u32>,
    /// How P and S fare with less and more friction, by search
    #[arg(long)]
    window: bool,
    /// Write the body with the least friction that makes it passive, and certify that one
    #[arg(long, requires = "output")]
    raise_friction: bool,
    /// Body file to write
    #[arg(short, long, value_name = "BODY", requires = "raise_friction")]
    output: Option<PathBuf>,
    /// VTK file to write, with the margins of each element
    #[arg(long, value_name = "FILE")]
    vtu: Option<PathBuf>,
    /// Folder for passive.csv and snap-free.csv, tool paths that show a broken certificate
    #[arg(long, value_name = "DIR")]
    witness: Option<PathBuf>,
    /// Device that the sampled loop is judged for, with what is known or guessed of it
    #[arg(long, value_name = "NAME", group = "loop",
          value_parser = clap::builder::PossibleValuesParser::new(presets::DEVICES))]
    device: Option<String>,
    /// Instead of a device by name, its viscous damping, N·s/m
    #[arg(long, value_name = "B", group = "loop")]
    damping_n_s_per_m: Option<f64>,
    /// Rate of the device's loop, Hz; 1,000 if not given
    #[arg(long, value_name = "N", requires = "loop")]
    rate_hz: Option<f64>,
    /// Greatest error of the device's position, mm; half a step of its encoders along each axis, or none
    #[arg(long, value_name = "E", requires = "loop")]
    position_error_mm: Option<f64>,
    /// Coulomb friction of the device, N; the device's, or none
    #[arg(long, value_name = "F", requires = "loop")]
    coulomb_n: Option<f64>,
    /// Samples by which the device's force comes late; the device's, or none
    #[arg(long, value_name = "N", requires = "loop")]
    delay_samples: Option<u32>,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    args.check()?;
    let names = ["passive.csv", "snap-free.csv"];
    let paths = names.map(|name| args.witness.as_ref().map(|folder| folder.join(name)));
    let outputs: Vec<_> = args.output.iter().chain(&args.vtu).chain(paths.iter().flatten()).collect();
    files::refuse_overwrite(&outputs, &[&args.body])?;
    let mut body = Body::open(&args.body)?;
    let rule = args.slip.map_or(body.slip(), super::Slip::rule);
    args.check_rule(rule)?;
    if args.raise_friction && body.is_coupled() {
        return Err(anyhow::anyhow!(
            "{}: its law is a coupled potential, and --raise-friction is for bodies with curves; keep the tank, or give more friction \
             when the body is made",
            args.body.display()
        )
        .into());
    }
    let evaluations = args.evaluations.unwrap_or_else(|| palpate_certify::evaluations(&body, rule));
    let assumptions = Assumptions {
        slip: rule,
        step_m: args.step_mm * 1e-3,
        depth_m: args.depth_mm.map(|d| d * 1e-3),
        ..Assumptions::default()
    };
    if let (true, Some(output)) = (args.raise_friction, &args.output) {
        let (raised, report) = floor::raise(&body, &assumptions, evaluations)?;
        raised.save(output)?;
        body = raised;
        console::note(&format!(
            "wrote {}: friction raised at {} of {} test points, by {:.3} at most, to {:.3}",
            output.display(),
            report.test_points,
            body.curves().len(),
            report.largest_rise,
            report.largest_friction
        ));
    }
    let question =
        Question { assumptions, evaluations: args.evaluations, device: args.device(), window: args.window };
    let Some(Certified { certificate: mut found, elements }) =
        certify(&body, &question, &|| (), &AtomicBool::new(false))?
    else {
        return Err(Failure::Interrupted("stopped".into()));
    };
    if let Some(folder) = &args.witness {
        files::make_folder(folder)?;
        for (holds, path) in [&mut found.passive, &mut found.snap_free].into_iter().zip(paths) {
            if let (Some(shown), Some(path)) = (&mut holds.witness, path) {
                write_path(&path, args.output.as_ref().unwrap_or(&args.body), rule, shown)?;
                shown.path = Some(path);
            }
        }
    }
    if let Some(path) = &args.vtu {
        let margins = margins(&elements);
        files::replace(path, |out| vtu::write(&body, &margins, out))?;
        console::note(&format!("wrote {}", path.display()));
    }
    if args.json {
        console::json(&found)?;
    } else {
        console::text(&text(&found))?;
    }
    verdict(&found)
}

impl Args {
    fn check(&self) -> anyhow::Result<()> {
        let positive = |name: &str, x: f64| {
            let fine = x > 0.0 && x.is_finite();
            if fine { Ok(()) } else { Err(anyhow::anyhow!("--{name} {x}: give a number above 0")) }
        };
        let none_or_positive = |name: &str, x: f64| if x == 0.0 { Ok(()) } else { positive(name, x) };
        positive("step-mm", self.step_mm)?;
        positive("depth-mm", self.depth_mm.unwrap_or(1.0))?;
        positive("rate-hz", self.rate_hz.unwrap_or(1.0))?;
        none_or_positive("damping-n-s-per-m", self.damping_n_s_per_m.unwrap_or(0.0))?;
        none_or_positive("position-error-mm", self.position_error_mm.unwrap_or(0.0))?;
        none_or_positive("coulomb-n", self.coulomb_n.unwrap_or(0.0))
    }

    /// The floor is of one rule.
    fn check_rule(&self, rule: SlipRule) -> anyhow::Result<()> {
        anyhow::ensure!(
            !self.raise_friction || rule == SlipRule::Paper,
            "{}: --raise-friction is for the slip rule paper, whose passivity is friction's; add --slip paper",
            self.body.display()
        );
        Ok(())
    }

    fn device(&self) -> Option<device::Device> {
        let rate_hz = self.rate_hz.unwrap_or(1000.0);
        let named = match (&self.device, self.damping_n_s_per_m) {
            (Some(name), _) => device::Device::of(&presets::device(name)?.mechanics, rate_hz),
            (None, damping) => device::Device {
                damping_n_s_per_m: damping?,
                rate_hz,
                position_error_m: 0.0,
                coulomb_n: 0.0,
                delay_samples: 0.0,
            },
        };
        Some(device::Device {
            position_error_m: self.position_error_mm.map_or(named.position_error_m, |e| e * 1e-3),
            coulomb_n: self.coulomb_n.unwrap_or(named.coulomb_n),
            delay_samples: self.delay_samples.map_or(named.delay_samples, f64::from),
            ..named
        })
    }
}

fn write_path(path: &Path, body: &Path, rule: SlipRule, shown: &Shown) -> anyhow::Result<()> {
    files::replace(path, |out| {
        writeln!(
            out,
            "# palpate trace {} --slip {} --no-tank --path {} -o trace.csv",
            body.display(),
            rule.name(),
            path.display()
        )?;
        writeln!(out, "time_s,x_m,y_m,z_m")?;
        for Waypoint { time_s, pose } in &shown.waypoints {
            let [x, y, z] = pose.position_m;
            writeln!(out, "{time_s:?},{x:?},{y:?},{z:?}")?;
        }
        Ok(())
    })
}

/// For ParaView. What is infinite (nothing slips) is shown as NaN.
fn margins(elements: &[Element]) -> Vec<(&'static str, Vec<f64>)> {
    let each = |of: &dyn Fn(&Element) -> f64| {
        elements.iter().map(|e| Some(of(e)).filter(|x| x.is_finite()).unwrap_or(f64::NAN)).collect()
    };
    let verdict = |v: Verdict| f64::from(v as u8);
    vec![
        ("passive_margin", each(&|e| e.passive.proved)),
        ("passive_found", each(&|e| e.passive.found)),
        ("passive_0_proved_1_fails_2_undecided", each(&|e| verdict(e.passive()))),
        ("snap_free_margin_n_per_m", each(&|e| e.snap_free.proved)),
        ("snap_free_found_n_per_m", each(&|e| e.snap_free.found)),
        ("snap_free_0_proved_1_fails_2_undecided", each(&|e| verdict(e.snap_free()))),
        ("lipschitz_n_per_m", each(&|e| e.lipschitz.as_ref().map_or(f64::NAN, |b| -b.proved))),
    ]
}

fn verdict(found: &Certificate) -> Result<(), Failure> {
    let fallen = |name: &str, h: &Holds| {
        (!h.holds).then(|| {
            format!("{name}: fails on {}, undecided on {} elements", h.failing_elements, h.undecided_elements)
        })
    };
    let messages: Vec<String> = [fallen("passive", &found.passive), fallen("snap free", &found.snap_free)]
        .into_iter()
        .flatten()
        .collect();
    if messages.is_empty() { Ok(()) } else { Err(Failure::Check(messages.join("; "))) }
}

fn text(c: &Certificate) -> String {
    let number = |x: Option<f64>, digits: usize| x.map_or("–".to_owned(), |x| format!("{x:.digits$}"));
    let row = |name: &str, h: &Holds, digits: usize| {
        vec![
            name.to_owned(),
            if h.holds { "holds" } else { "does not hold" }.to_owned(),
            number(h.margin, digits),
            number(h.found, digits),
            h.proved_elements.to_string(),
            h.failing_elements.to_string(),
            h.undecided_elements.to_string(),
        ]
    };
    let head = ["", "", "margin", "found", "proved", "fails", "undecided"].map(str::to_owned).to_vec();
    let mut out = console::table(&[
        head,
        row("passive (energy out, share of the forces)", &c.passive, 4),
        row("snap free (slope η, N/m)", &c.snap_free, 1),
    ]);
    out += &format!(
        "\nLipschitz constant of the force: {} N/m; largest found {} N/m\n",
        number(c.lipschitz_n_per_m, 0),
        number(c.lipschitz_found_n_per_m, 0)
    );
    for remark in &c.remarks {
        out += &format!("{remark}\n");
    }
    out += &format!(
        "for slip rule {}, {} elements, to {:.3} mm depth, tool steps up to {:.3} mm\n",
        c.slip.name(),
        c.elements,
        c.scope.depth_m * 1e3,
        c.scope.step_m * 1e3
    );
    if let Some(lateral) = c.scope.lateral_m {
        out += &format!(
            "of a coupled law: to {:.3} mm laterally, P from {:.3} mm depth on\n",
            lateral * 1e3,
            c.scope.passive_from_m * 1e3
        );
    }
    let remark =
        |count: usize, what: &str| if count > 0 { format!("{count} {what}\n") } else { String::new() };
    out += &remark(c.border_edges, "border edges: a contact that runs over one ends with the force it has");
    out += &remark(c.creased_elements, "elements along creases: the force jumps there, and P is not proved");
    out += &remark(
        c.too_far_elements,
        "elements whose friction holds beyond ten times the lateral curves: not followed so far",
    );
    for (name, h, what) in [
        ("passive", &c.passive, "a slip that makes energy"),
        ("snap free", &c.snap_free, "a slip that runs away"),
    ] {
        if let Some(w) = h.worst.as_ref().filter(|_| h.failing_elements > 0) {
            let [x, y, z] = w.contact_m.map(|x| x * 1e3);
            out += &format!(
                "\n{name}: the worst is {what} on element {} at ({x:.2}, {y:.2}, {z:.2}) mm, {:.3} mm deep, {:.3} mm laterally",
                w.element,
                w.depth_m * 1e3,
                w.lateral_m * 1e3
            );
            if w.friction_factor != 1.0 {
                out += &format!(", of the contact point with {:.3} times the friction", w.friction_factor);
            }
            out += &match &h.witness {
                None => "; no path was found that shows it\n".to_owned(),
                Some(s) => {
                    let shows = if name == "passive" {
                        format!("generates {:.3e} J", s.generated_j)
                    } else {
                        format!("jumps by {:.1} mN", s.finer_step_n * 1e3)
                    };
                    let kept = s
                        .path
                        .as_ref()
                        .map_or("with --witness DIR it is kept".to_owned(), |p| format!("{}", p.display()));
                    format!("; a path of {} rows {shows} ({kept})\n", s.rows)
                }
            };
        }
    }
    if !c.window.is_empty() {
        let mut rows = vec![
            ["friction times", "not passive", "snap", "passive, least found", "η, least found (N/m)"]
                .map(str::to_owned)
                .to_vec(),
        ];
        rows.extend(c.window.iter().map(|w| {
            vec![
                format!("{}", w.friction_factor),
                w.passive_failing_elements.to_string(),
                w.snap_failing_elements.to_string(),
                number(w.passive_found, 4),
                number(w.snap_free_found_n_per_m, 1),
            ]
        }));
        out += &format!("\n{}", console::table(&rows));
    }
    let mut rows = vec![vec!["depth (mm)".to_owned(), "greatest stiffness (N/m)".to_owned()]];
    rows.extend(
        c.stiffness_max_n_per_m
            .iter()
            .map(|s| vec![format!("{:.3}", s.depth_m * 1e3), format!("{:.1}", s.value)]),
    );
    out += &format!("\n{}", console::table(&rows));
    match &c.device {
        Some(device::Limits {
            stiffness_limit_n_per_m: Some(stiffness),
            depth_limit_m: Some(depth),
            force_limit_n,
            whole_depth,
            ..
        }) => {
            out += &format!(
                "\nthe device holds {stiffness:.1} N/m: the sampled loop is passive down to {:.3} mm{}{}\n",
                depth * 1e3,
                if *whole_depth { " (all that the law knows)" } else { "" },
                force_limit_n.map_or_else(String::new, |force| format!(", with {force:.3} N anywhere")),
            );
        }
        Some(d) => {
            let what = if d.device.delay_samples > 0.0 && c.lipschitz_n_per_m.is_none() {
                "its force comes late, which needs the Lipschitz constant"
            } else {
                "its position has an error, which needs S on the whole body"
            };
            out += &format!("\nwhat the device holds is not known: {what}\n");
        }
        None => {}
    }
    out
}
