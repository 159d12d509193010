//! What the experiment found, as `report.json` holds it, and the bars it must reach.

use super::experiment::{CLICK, Rate, Rollout, SETTINGS};
use super::ridges::{self, Ridges};
use super::rules::{self, Cycle};
use super::{cylinder, path, sound};
use serde::Serialize;

/// With both interpolations no step may exceed the smooth model by more, N.
pub const EXCESS_MAX: f64 = CLICK;
/// With both, the largest step must shrink to this when the path is sampled 10 and 100 times finer.
pub const REFINEMENT_MAX: [f64; 2] = [0.12, 0.013];
/// Without either one, a step exceeds the smooth model by at least this, however fine the sampling, N.
pub const ABLATED_EXCESS_MIN: f64 = 50e-3;

/// `report.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Whether every bar was reached.
    pub passed: bool,
    /// One sentence for each bar that was not.
    pub shortfalls: Vec<String>,
    /// The four settings.
    pub settings: Vec<Setting>,
    /// Bounds L of the smooth model that steps were measured against at 1 kHz, [least, greatest], N/m.
    pub lipschitz_n_per_m: [f64; 2],
    /// Touching samples at 1, 10 and 100 kHz where the smooth model has no bound.
    pub samples_without_bound: [usize; 3],
    /// What each slip rule hands out.
    pub slip_rules: Vec<Cycle>,
    /// What of a mesh is felt.
    pub ridges: Vec<Ridges>,
    /// The path.
    pub path: PathFacts,
    /// The body.
    pub body: BodyFacts,
    /// The WAV files.
    pub sound: SoundFacts,
    /// The closed loops.
    pub closed_loop: super::loops::Loops,
    /// Time that the rollouts, pictures and sounds took, s.
    pub seconds: f64,
}

/// One setting.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Setting {
    /// `both`, `coordinates-off`, `responses-off` or `both-off`.
    pub name: &'static str,
    /// Largest |ΔF| from one sample to the next at 1 kHz, N.
    pub largest_step_n: f64,
    /// Largest excess max(0, |ΔF| − L|Δx|) at 1 kHz, N.
    pub excess_step_n: f64,
    /// Largest steps at 1, 10 and 100 kHz over that at 1 kHz.
    pub refinement: [f64; 3],
    /// Largest excess at 1, 10 and 100 kHz, N.
    pub excess_finer_n: [f64; 3],
    /// Largest |ΔF| / (L|Δx|) at 1 kHz: how much of what the bound allows was used.
    pub bound_used: f64,
    /// Steps with more than 1 mN of excess at 1 kHz.
    pub clicks: usize,
    /// When they happened, s.
    pub click_times_s: Vec<f64>,
    /// Largest force at 1 kHz, N.
    pub largest_force_n: f64,
    /// Work that the tool did on the body, J.
    pub work_j: f64,
    /// Energy stored at the end, J.
    pub stored_j: f64,
    /// What sliding took, J.
    pub dissipated_j: f64,
    /// Energy that slip created, J.
    pub generated_j: f64,
    /// work − stored − dissipated, J: rounding.
    pub ledger_error_j: f64,
    /// Samples in which the contact point slid.
    pub slips: u64,
    /// Edges of the mesh that it crossed.
    pub crossings: u64,
    /// Evaluations of the force law while sliding.
    pub evaluations: u64,
    /// Samples in which an edge or vertex held it.
    pub blocked: u64,
    /// Samples in which the slip search ran into its bound.
    pub capped: u64,
    /// Contacts begun.
    pub onsets: u64,
    /// Loudest sample of the WAV file, N/s.
    pub sound_peak_n_per_s: f64,
}

/// The path's facts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathFacts {
    /// Duration, s.
    pub duration_s: f64,
    /// Fastest tool, m/s.
    pub fastest_m_per_s: f64,
    /// Depth of the drag below the true cylinder, m.
    pub depth_m: f64,
}

/// The body's facts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BodyFacts {
    /// Elements.
    pub triangles: usize,
    /// Nodes.
    pub nodes: usize,
    /// Mean k^z of (6), N/m.
    pub normal_stiffness_n_per_m: f64,
    /// Mean k^r of (7), N/m.
    pub lateral_stiffness_n_per_m: f64,
    /// Friction coefficient.
    pub friction: f64,
}

/// The WAV files' facts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SoundFacts {
    /// Force rate at full scale, the same in all files, N/s.
    pub full_scale_n_per_s: f64,
    /// The rate is the mean over this time, s.
    pub window_s: f64,
    /// Samples that were cut to full scale, all files.
    pub cut_samples: usize,
}

impl Report {
    /// Judges the rollouts at 1, 10 and 100 kHz.
    pub fn new(body: &palpate_body::Body, rates: &[Rate; 3]) -> Self {
        let settings = (0..SETTINGS.len()).map(|i| Setting::new(i, rates)).collect();
        let [coarse, ..] = rates;
        let mut report = Report {
            passed: false,
            shortfalls: Vec::new(),
            settings,
            lipschitz_n_per_m: coarse.bounds.into(),
            samples_without_bound: [0, 1, 2].map(|i| rates[i].unbounded),
            slip_rules: Vec::new(),
            ridges: Vec::new(),
            path: PathFacts {
                duration_s: path::DURATION,
                fastest_m_per_s: coarse.fastest,
                depth_m: path::DEPTH,
            },
            body: BodyFacts {
                triangles: body.elements().len(),
                nodes: body.nodes().len(),
                normal_stiffness_n_per_m: cylinder::NORMAL_STIFFNESS,
                lateral_stiffness_n_per_m: cylinder::LATERAL_STIFFNESS,
                friction: cylinder::FRICTION,
            },
            sound: SoundFacts {
                full_scale_n_per_s: sound::FULL_SCALE,
                window_s: sound::WINDOW,
                cut_samples: 0,
            },
            closed_loop: super::loops::Loops::default(),
            seconds: 0.0,
        };
        report.shortfalls = report.judge();
        report.passed = report.shortfalls.is_empty();
        report
    }

    /// Adds the slip rules' cycles, and what they fell short of.
    pub fn add_rules(&mut self, cycles: Vec<Cycle>) {
        self.shortfalls.extend(rules::judge(&cycles));
        self.passed = self.shortfalls.is_empty();
        self.slip_rules = cycles;
    }

    /// Adds the ridges, and what they fell short of.
    pub fn add_ridges(&mut self, ridges: Vec<Ridges>) {
        self.shortfalls.extend(ridges::judge(&ridges));
        self.passed = self.shortfalls.is_empty();
        self.ridges = ridges;
    }

    /// One sentence for each bar that was not reached.
    fn judge(&self) -> Vec<String> {
        let unbounded: usize = self.samples_without_bound.iter().sum();
        let snaps = (unbounded > 0)
            .then(|| format!("the smooth model has no force bound at {unbounded} samples: it snaps there"));
        let settings = self.settings.iter().flat_map(|setting| match setting.name {
            "both" => setting.judge_smooth(),
            "coordinates-off" | "responses-off" => setting.judge_ablated(),
            _ => Vec::new(),
        });
        snaps.into_iter().chain(settings).collect()
    }

    /// Adds the closed loops, and what they fell short of.
    pub fn add_loops(&mut self, loops: super::loops::Loops) {
        self.shortfalls.extend(loops.judge());
        self.passed = self.shortfalls.is_empty();
        self.closed_loop = loops;
    }
}

impl Setting {
    /// No click at any rate, and steps that shrink as the path is sampled finer.
    fn judge_smooth(&self) -> Vec<String> {
        let excess = self.excess_finer_n.into_iter().fold(0.0, f64::max);
        let clicks = (excess > EXCESS_MAX)
            .then(|| format!("{}: a step exceeds the bound by {:.1} mN", self.name, excess * 1e3));
        let finer = [10, 100].into_iter().zip(self.refinement.into_iter().skip(1)).zip(REFINEMENT_MAX);
        let stays = finer.filter(|((_, r), most)| r > most).map(|((factor, r), most)| {
            format!(
                "{}: sampled {factor} times finer the largest step falls to {r:.4} of it, not to {most}",
                self.name
            )
        });
        clicks.into_iter().chain(stays).collect()
    }

    /// A click at every rate.
    fn judge_ablated(&self) -> Vec<String> {
        let excess = self.excess_finer_n.into_iter().fold(f64::INFINITY, f64::min);
        let quiet = (excess < ABLATED_EXCESS_MIN)
            .then(|| format!("{}: the largest excess is only {:.1} mN", self.name, excess * 1e3));
        quiet.into_iter().collect()
    }

    fn new(setting: usize, rates: &[Rate; 3]) -> Self {
        let each = |of: fn(&Rollout) -> f64| [0, 1, 2].map(|i| of(&rates[i].settings[setting]));
        let (coarse, hz) = (&rates[0].settings[setting], rates[0].hz);
        let (energy, counters) = (coarse.energy, coarse.counters);
        Setting {
            name: SETTINGS[setting].0,
            largest_step_n: coarse.largest,
            excess_step_n: coarse.excess,
            refinement: each(|r| r.largest).map(|step| step / coarse.largest),
            excess_finer_n: each(|r| r.excess),
            bound_used: coarse.share,
            clicks: coarse.clicks.len(),
            click_times_s: coarse.clicks.iter().map(|&(sample, _)| sample as f64 / hz).collect(),
            largest_force_n: coarse.strongest,
            work_j: energy.work_j,
            stored_j: energy.stored_j,
            dissipated_j: energy.dissipated_j,
            generated_j: energy.generated_j,
            ledger_error_j: energy.work_j - energy.stored_j - energy.dissipated_j,
            slips: counters.slips,
            crossings: counters.crossings,
            evaluations: counters.evaluations,
            blocked: counters.blocked,
            capped: counters.capped,
            onsets: counters.onsets,
            sound_peak_n_per_s: 0.0,
        }
    }
}
