//! `palpate inspect`.

use super::Failure;
use crate::inspect::{Inspection, charts, inspect};
use crate::{console, plot};
use palpate_body::Body;
use palpate_files as files;
use std::path::PathBuf;

/// Say what is in a body: sizes, curves, stiffness over depth, where it came from
///
/// stiffness_max_n_per_m is the greatest stiffness that the tool can meet while the contact sticks, down to each
/// depth: what a device must be able to hold.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  palpate inspect liver.body --plots pictures\n\n\
                        Exit status: 0 done, 1 wrong input, 2 wrong usage.")]
pub struct Args {
    /// Body file
    body: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Draw the curves of up to 12 test points into this folder: normal.png, lateral.png and friction.png, or stiffness.png of
    /// a coupled law, and of a simulated one the error against the number of test points, test-points.png
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// See [`Failure`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let body = Body::open(&args.body)?;
    if let Some(folder) = &args.plots {
        let charts: Vec<_> =
            charts(&body).into_iter().map(|(name, charts)| (folder.join(name), charts)).collect();
        let outputs: Vec<_> = charts.iter().map(|(path, _)| path).collect();
        files::refuse_overwrite(&outputs, &[&args.body])?;
        files::make_folder(folder)?;
        for (path, charts) in charts {
            plot::save(&path, &charts)?;
        }
    }
    let inspection = inspect(&body);
    if args.json {
        console::json(&inspection)?;
    } else {
        console::text(&text(&inspection))?;
    }
    Ok(())
}

fn text(i: &Inspection) -> String {
    let [low, high] = i.bounding_box_m.map(|p| p.map(|x| x * 1e3));
    let side = |k: usize| format!("{:.2} to {:.2} mm", low[k], high[k]);
    let reach = |knots: &[f64]| {
        let end = knots.last().copied().unwrap_or_default() * 1e3;
        format!("{} up to {end:.3} mm", knots.len())
    };
    let between = |[low, high]: [f64; 2], unit: &str| {
        if low == high { format!("{low:.4}{unit}") } else { format!("{low:.4} to {high:.4}{unit}") }
    };
    let tools = i.tools.iter().map(|t| match t.radius_m {
        0.0 => t.shape.clone(),
        radius => format!("{} of radius {:.3} mm", t.shape, radius * 1e3),
    });
    let fields = i.displacement_fields.map_or("none".into(), |f| {
        format!("{} pressed, {} dragged, {:.1} MB", f.pressed, f.dragged, f.bytes as f64 / 1e6)
    });
    let test_points = match i.potential_fit.as_ref().map(|fit| fit.places[0]) {
        Some(places) if places < i.test_points => {
            format!("{places}, and {} nodes with potentials made from theirs", i.test_points - places)
        }
        _ => i.test_points.to_string(),
    };
    let ranges = &i.ranges;
    let rows = [
        ("nodes", i.nodes.to_string()),
        ("vertices", i.vertices.to_string()),
        ("triangles", i.triangles.to_string()),
        ("border edges", i.border_edges.to_string()),
        ("x", side(0)),
        ("y", side(1)),
        ("z", side(2)),
        ("test points", test_points),
        ("displacement fields", fields),
        ("law", i.law.to_owned()),
        ("depth knots", reach(&i.depth_knots_m)),
        ("lateral knots", reach(&i.lateral_knots_m)),
        ("normal force at the last knot", between(ranges.largest_normal_force_n, " N")),
        ("lateral force at the last knot", between(ranges.largest_lateral_force_n, " N")),
        ("stiffness at the last knot", between(ranges.stiffness_at_full_depth_n_per_m, " N/m")),
        ("lateral stiffness at 0", between(ranges.lateral_stiffness_n_per_m, " N/m")),
        ("stiffest to softest direction", between(i.lateral_ratio, "")),
        ("friction coefficient", between(ranges.friction, "")),
        ("tool", tools.collect::<Vec<_>>().join(", ")),
        ("slip rule", i.slip.name().to_owned()),
        ("contact points", if i.partial_slip { "2 (partial slip)" } else { "1" }.to_owned()),
        ("slip may give out energy", if i.tank { "no (tank)" } else { "yes (no tank)" }.to_owned()),
        ("made by", i.provenance.software.clone()),
        ("with", i.provenance.command.clone()),
    ];
    let coupled = i.coupled.iter().flat_map(|c| {
        [
            ("lateral range", format!("{:.3} mm", c.lateral_range_m * 1e3)),
            ("K, its eigenvalues", between(c.stiffness_n_per_m, " N/m")),
            ("|b|", between(c.offset_n, " N")),
            ("|C|", between(c.cubic_n_per_m2, " N/m²")),
            ("Q", between(c.quartic_n_per_m3, " N/m³")),
            ("curvature", between(c.curvature_per_m, " /m")),
        ]
    });
    let rows: Vec<_> = rows.into_iter().chain(coupled).collect();
    // A coupled law's potentials have a range in place of them.
    let rows: Vec<_> =
        rows.into_iter().filter(|(name, _)| i.coupled.is_none() || *name != "lateral knots").collect();
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let mut out: String = rows.iter().map(|(name, value)| format!("{name:<width$}  {value}\n")).collect();
    for (file, digest) in &i.provenance.inputs {
        out += &format!("{:<width$}  {file} (SHA-256 {digest})\n", "from");
    }
    for note in &i.provenance.notes {
        out += &format!("{:<width$}  {note}\n", "note");
    }
    let mut rows = vec![vec!["depth (mm)".to_owned(), "greatest stiffness (N/m)".to_owned()]];
    rows.extend(
        i.stiffness_max_n_per_m
            .iter()
            .map(|s| vec![format!("{:.3}", s.depth_m * 1e3), format!("{:.1}", s.value)]),
    );
    out += &format!("\n{}", console::table(&rows));
    if let Some(e) = &i.fit_errors {
        let mut rows = vec![
            ["off from the simulated paths by (%)", "median", "p95", "worst", "worst (N)"]
                .map(str::to_owned)
                .to_vec(),
        ];
        rows.extend(
            [
                ("normal force", e.normal),
                ("normal force while dragged", e.normal_dragged),
                ("lateral force while pressed", e.lateral_pressed),
                ("lateral force while dragged", e.lateral),
                ("the same, alike in all directions", e.lateral_isotropic),
            ]
            .map(|(name, r)| {
                let percent = [r.median_percent, r.p95_percent, r.worst_percent].map(|x| format!("{x:.2}"));
                let mut row = vec![name.to_owned()];
                row.extend(percent);
                row.push(format!("{:.4}", r.worst_n));
                row
            }),
        );
        out += &format!("\n{}", console::table(&rows));
    }
    if let Some(fit) = &i.potential_fit {
        let [places, dragged] = fit.places;
        let mut rows = vec![
            ["off from the simulated states by (%)", "normal: median", "p95", "lateral: median", "p95"]
                .map(str::to_owned)
                .to_vec(),
        ];
        let states = [("|f_t| ≤ μ f_z", &fit.held), ("|f_t| ≤ f_z", &fit.within), ("all", &fit.all)];
        rows.extend(states.map(|(name, e)| {
            let percent = [e.normal_percent, e.lateral_percent].concat();
            let percent = percent.into_iter().map(|x| format!("{x:.2}"));
            std::iter::once(format!("{name}, of {places} places")).chain(percent).collect()
        }));
        out += &format!("\n{}", console::table(&rows));
        let [[a, b], [c, d]] = [fit.reciprocity_pressed_percent, fit.reciprocity_dragged_percent];
        out += &format!(
            "\nBetti's residual, median and p95: {a:.1} and {b:.1} % of presses, {c:.1} and {d:.1} % of drags at {dragged} places\n"
        );
    }
    if let Some(e) = &i.provenance.interpolation {
        let mut rows = vec![
            ["places left out, one at a time, err by (%)", "median", "p95", "mean", ""]
                .map(str::to_owned)
                .to_vec(),
        ];
        rows.extend(e.left_out.iter().map(|l| {
            let percent = [l.median_percent, l.p95_percent, l.mean_percent].map(|x| format!("{x:.2}"));
            let used = if l.used { "used" } else { "" }.to_owned();
            std::iter::once(format!("with {} ({} places)", l.normalisation, l.places))
                .chain(percent)
                .chain([used])
                .collect()
        }));
        out += &format!("\n{}", console::table(&rows));
        let mut rows =
            vec![["test points", "places predicted", "median (%)", "p95 (%)"].map(str::to_owned).to_vec()];
        rows.extend(e.by_count.iter().map(|c| {
            vec![
                c.test_points.to_string(),
                c.places.to_string(),
                format!("{:.2}", c.median_percent),
                format!("{:.2}", c.p95_percent),
            ]
        }));
        if !e.by_count.is_empty() {
            out += &format!("\n{}", console::table(&rows));
        }
    }
    out
}
