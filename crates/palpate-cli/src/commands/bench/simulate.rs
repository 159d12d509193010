//! `palpate bench --simulate`.

use super::Failure;
use crate::bench::reference::{Direction, Outcome, Part, Reference, ReferencePlan};
use crate::bench::{Spent, Stopwatch};
use crate::console;
use anyhow::{Result, anyhow, bail};
use palpate_simulate::{Material, RESIDUAL_TOLERANCE, SimulateError};
use serde_json::{Value, json};
use std::path::PathBuf;

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Law {
    Linear,
    StVenantKirchhoff,
    NeoHookean,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Form {
    Compressible,
    Isochoric,
}

/// What is simulated.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Time a path of the offline simulation on this mesh
    #[arg(
        long,
        num_args = 3,
        value_names = ["NODES.csv", "TET10.csv", "PATCH.csv"],
        conflicts_with_all = ["triangles", "anisotropic", "partial_slip"],
        help_heading = "Simulation"
    )]
    simulate: Vec<PathBuf>,
    /// Law of the tissue
    #[arg(
        long,
        value_name = "LAW",
        default_value = "neo-hookean",
        requires = "simulate",
        help_heading = "Simulation"
    )]
    model: Law,
    /// Of the neo-Hookean law: isochoric is CalculiX's (μ/2 (Ī₁ − 3) + K/2 (J − 1)²), compressible the default of
    /// `precompute` [default: isochoric]
    #[arg(long, value_name = "FORM", requires = "simulate", help_heading = "Simulation")]
    form: Option<Form>,
    /// At small strain
    #[arg(
        long,
        value_name = "X",
        default_value_t = 10_000.0,
        requires = "simulate",
        help_heading = "Simulation"
    )]
    young_modulus_pa: f64,
    /// At small strain
    #[arg(
        long,
        value_name = "X",
        default_value_t = 0.45,
        requires = "simulate",
        help_heading = "Simulation"
    )]
    poisson_ratio: f64,
    /// How far the patch is pressed
    #[arg(long, value_name = "X", default_value_t = 4.0, requires = "simulate", help_heading = "Simulation")]
    depth_mm: f64,
    /// How far the patch is dragged from there
    #[arg(
        long,
        value_name = "X",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        requires = "simulate",
        help_heading = "Simulation"
    )]
    drag_mm: f64,
    /// Along z (the axis) or along x (around it). The half of a body is mirrored there first
    #[arg(
        long,
        value_name = "WHERE",
        default_value = "axial",
        requires = "simulate",
        help_heading = "Simulation"
    )]
    drag_direction: Direction,
    /// Load steps of the drag
    #[arg(long, value_name = "N", default_value_t = 8, requires = "simulate", help_heading = "Simulation")]
    drag_steps: usize,
}

impl Options {
    pub fn asked(&self) -> bool {
        !self.simulate.is_empty()
    }

    fn material(&self) -> Result<Material> {
        let (young, poisson) = (self.young_modulus_pa, self.poisson_ratio);
        let material = match (self.model, self.form) {
            (Law::NeoHookean, Some(Form::Compressible)) => Material::neo_hookean(young, poisson),
            (Law::NeoHookean, _) => Material::isochoric_neo_hookean(young, poisson),
            (_, Some(_)) => bail!("--form is of --model neo-hookean; leave it out"),
            (Law::Linear, None) => Material::linear(young, poisson),
            (Law::StVenantKirchhoff, None) => Material::st_venant_kirchhoff(young, poisson),
        };
        material.map_err(|error| match error {
            SimulateError::Invalid { place, problem, hint, .. } => {
                anyhow!("--{}: {problem}; {hint}", place.replace('_', "-"))
            }
            other => other.into(),
        })
    }

    fn law(&self) -> &'static str {
        match (self.model, self.form) {
            (Law::NeoHookean, Some(Form::Compressible)) => "neo-Hookean, compressible",
            (Law::NeoHookean, _) => "neo-Hookean, isochoric",
            (Law::Linear, _) => "linear",
            (Law::StVenantKirchhoff, _) => "St. Venant–Kirchhoff",
        }
    }

    fn plan(&self, steps: usize) -> Result<ReferencePlan> {
        for (name, count) in [("--steps", steps), ("--drag-steps", self.drag_steps)] {
            if !(1..=10_000).contains(&count) {
                bail!("{name} {count}: give a number between 1 and 10000");
            }
        }
        if !(self.depth_mm > 0.0 && self.depth_mm <= 1e3) {
            bail!("--depth-mm {}: give a positive number up to 1000", self.depth_mm);
        }
        if !(-1e3..=1e3).contains(&self.drag_mm) {
            bail!("--drag-mm {}: give a number between -1000 and 1000", self.drag_mm);
        }
        Ok(ReferencePlan {
            depth_m: self.depth_mm * 1e-3,
            steps,
            drag_m: self.drag_mm * 1e-3,
            drag_steps: self.drag_steps,
            direction: self.drag_direction,
        })
    }
}

pub fn run(options: &Options, steps: usize, json: bool) -> Result<(), Failure> {
    let [nodes, tetrahedra, patch] = &*options.simulate else {
        return Err(anyhow!("--simulate: give three files").into());
    };
    let material = options.material()?;
    let plan = options.plan(steps)?;

    let watch = Stopwatch::start();
    let mut part = Part::read(nodes, tetrahedra, patch)?;
    if plan.drag_m != 0.0 {
        part.mirror(match plan.direction {
            Direction::Axial => 2,
            Direction::Around => 0,
        });
    }
    let read = watch.stop();
    let about = about(&part);

    let watch = Stopwatch::start();
    let reference =
        Reference::new(part, material).map_err(|e| e.context(tetrahedra.display().to_string()))?;
    let model = watch.stop();
    let path = reference.run(&plan);
    let further = reference.run_further(&plan);
    for (what, outcome) in [("path", &path), ("further point", &further)] {
        if let Some(why) = &outcome.stopped {
            console::note(&format!("the {what} ended early: {why}"));
        }
    }

    let times =
        [("read", read), ("model", model), ("path", path.spent), ("total", read + model + path.spent)];
    if json {
        console::json(&document(&reference, &path, &further, &times))?;
    } else {
        let head = format!(
            "{about}, {} unknowns\n{}: E = {} Pa, ν = {}; residual forces below {RESIDUAL_TOLERANCE:e} of the \
             reaction\n\n",
            reference.unknowns(),
            options.law(),
            options.young_modulus_pa,
            options.poisson_ratio,
        );
        console::text(&(head + &text(&path, &further, &times)))?;
    }
    Ok(())
}

fn about(part: &Part) -> String {
    let planes = |axes: [bool; 3]| {
        let names = ["x = 0", "y = 0", "z = 0"].into_iter().zip(axes);
        names.filter_map(|(name, there)| there.then_some(name)).collect::<Vec<_>>().join(" and ")
    };
    let share = match part.factor() {
        4.0 => "quarter of a body",
        2.0 => "half of a body",
        _ => "whole body",
    };
    let mut about = share.to_owned();
    if part.factor() > 1.0 {
        about += &format!(" (symmetric about {}; forces × {})", planes(part.symmetric), part.factor());
    }
    if part.mirrored.contains(&true) {
        about += &format!(", mirrored about {}", planes(part.mirrored));
    }
    format!(
        "{about}: {} nodes, {} of them in the patch, {} tetrahedra",
        part.mesh.positions.len(),
        part.patch.len(),
        part.mesh.elements.len(),
    )
}

fn document(reference: &Reference, path: &Outcome, further: &Outcome, times: &[(&str, Spent)]) -> Value {
    let each = |f: fn(&Spent) -> Value| -> Value {
        times
            .iter()
            .map(|(name, spent)| ((*name).to_owned(), f(spent)))
            .collect::<serde_json::Map<_, _>>()
            .into()
    };
    json!({ "simulate": {
        "unknowns": reference.unknowns(),
        "force_factor": reference.part().factor(),
        "mirrored": reference.part().mirrored,
        "residual_tolerance": RESIDUAL_TOLERANCE,
        "states": path.states,
        "stopped": path.stopped,
        "counts": path.counts,
        "cpu_s": each(|spent| json!(spent.cpu_s)),
        "wall_s": each(|spent| json!(spent.wall_s)),
        "further_point": {
            "cpu_s": further.spent.cpu_s,
            "wall_s": further.spent.wall_s,
            "states": further.states,
            "stopped": further.stopped,
            "counts": further.counts,
        },
    }})
}

/// To 10 nN, and no minus before a zero.
fn newtons(force_n: f64) -> String {
    let text = format!("{force_n:.8}");
    if text == "-0.00000000" { text[1..].to_owned() } else { text }
}

fn text(path: &Outcome, further: &Outcome, times: &[(&str, Spent)]) -> String {
    let words = |words: &[&str]| words.iter().map(|w| (*w).to_owned()).collect::<Vec<_>>();
    let mut rows =
        vec![words(&["depth (mm)", "dragged (mm)", "normal (N)", "tangential (N)", "Newton steps"])];
    rows.extend(path.states.iter().map(|s| {
        vec![
            format!("{:.3}", s.depth_m * 1e3),
            format!("{:.3}", s.distance_m * 1e3),
            newtons(s.force_n),
            newtons(s.tangential_force_n),
            s.newton_steps.to_string(),
        ]
    }));
    let seconds = |spent: &Spent| {
        let cpu = spent.cpu_s.map_or_else(|| "?".to_owned(), |s| format!("{s:.2}"));
        [cpu, format!("{:.2}", spent.wall_s)]
    };
    let mut time = vec![words(&["", "CPU (s)", "wall (s)"])];
    let mut price = vec![words(&["", "Newton", "conjugate", "factorisations", "assemblies"])];
    for (name, spent) in times.iter().chain([&("further point", further.spent)]) {
        time.push([[(*name).to_owned()].as_slice(), &seconds(spent)].concat());
    }
    for (name, outcome) in [("path", path), ("further point", further)] {
        let c = outcome.counts;
        price.push(vec![
            name.to_owned(),
            c.newton.to_string(),
            c.conjugate.to_string(),
            c.factorisations.to_string(),
            c.assemblies.to_string(),
        ]);
    }
    [rows, time, price].map(|rows| console::table(&rows)).join("\n")
}
