//! Learning curves: logged points of training runs, as each published figure shows them.
//!
//! [`Logs`] gathers what was logged, from event files, logs of multi-task runs and portable tables. [`LearningCurves`]
//! joins the pieces of each seed, smooths, scales and averages them by a [`Recipe`]; `analysis::curves` has the formulas
//! (`spec/analysis.md` §11). Nothing is trained or played.
//!
//! Walking was logged in percent in the event files of single policies; recipes that read those divide by 100. Curves of
//! fine-tuning show the solved fraction itself, all others percent of the expert unless asked otherwise.

mod logs;
mod output;

use std::collections::BTreeMap;

use crate::analysis::curves::{
    Band, Curve, CurveError, Smoothing, TransferScale, band_on_grid, band_over_shared_steps,
    csi_finetuning_values, merge_resumed, multi_task_curve, portable_curve, rl_finetuning_values,
    stitch, transfer_curve,
};
use crate::record::{Benchmark, BenchmarkEntry, RecordError};

pub use logs::{Logged, Logs, Metric, RunInput};

/// Which figure's rules.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recipe {
    /// Portable tables: chosen smoothing, mean ± s.d. over the steps common to all seeds.
    Portable(Smoothing),
    /// A pretrained network against one from scratch.
    Transfer,
    /// Imitation of one expert.
    SingleTask,
    /// Fine-tuning by reinforcement learning, solved fraction.
    RlFinetuning,
    /// Baselines trained on all tasks, mean ± s.d. over seeds on a grid.
    MultiTask,
    /// Fine-tuning inside a control subspace.
    CsiFinetuning,
}

/// Points of the grid on which seeds of different steps are averaged, and where it ends.
const GRID: (usize, f64) = (300, 5e7);
/// Points of a running mean of the multi-task baselines.
const MULTI_TASK_WINDOW: usize = 20;
/// The task that was logged in percent.
const PERCENT_TASK: &str = "kinesis";

/// Why there are no curves.
#[derive(Debug, thiserror::Error)]
pub enum LearningError {
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error("the curve of `{method}` in `{panel}`, seed {seed}: {source}")]
    Curve { method: String, panel: String, seed: String, source: CurveError },
    #[error("the seeds of `{method}` in `{panel}` cannot be averaged: {source}")]
    Band { method: String, panel: String, source: CurveError },
    #[error("there is no expert of `{task}` to compare with")]
    NoExpert { task: String },
    #[error("the expert of `{task}` has no `{field}` above zero")]
    ExpertValue { task: String, field: &'static str },
    #[error("no curve was logged under {what}, in `{path}`")]
    NoSeries { what: String, path: std::path::PathBuf },
    #[error("there is no panel `{panel}`; there are {known}")]
    UnknownPanel { panel: String, known: String },
    #[error("nothing was logged")]
    Nothing,
}

/// One seed of one line.
#[derive(Debug, Clone, PartialEq)]
pub struct SeedCurve {
    pub seed: String,
    /// As logged, joined.
    pub logged: Curve,
    /// As drawn.
    pub drawn: Curve,
}

/// One line of a panel.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    pub name: String,
    /// What one unit of a logged value becomes.
    pub factor: f64,
    pub seeds: Vec<SeedCurve>,
    /// Over several seeds.
    pub band: Option<Band>,
}

/// One panel.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    pub title: String,
    pub series: Vec<Series>,
}

/// How curves are made.
#[derive(Debug, Clone)]
pub struct CurveOptions {
    pub recipe: Recipe,
    /// Values as logged, not in percent of the expert.
    pub raw: bool,
    /// Steps subtracted from every step of a stage, or of a method: a run that goes on from another counts on.
    pub offsets: BTreeMap<String, f64>,
    /// Only these panels; none: all.
    pub panels: Vec<String>,
}

/// All panels.
#[derive(Debug, Clone, PartialEq)]
pub struct LearningCurves {
    pub recipe: Recipe,
    /// In percent of the expert, or as logged.
    pub relative: bool,
    pub panels: Vec<Panel>,
}

impl LearningCurves {
    /// Makes the curves of `logs`.
    pub fn of(
        logs: &Logs,
        experts: &Benchmark,
        options: &CurveOptions,
    ) -> Result<Self, LearningError> {
        if logs.curves.is_empty() {
            return Err(LearningError::Nothing);
        }
        let relative = !options.raw && options.recipe != Recipe::RlFinetuning;
        let mut panels: Vec<Panel> = Vec::new();
        for logged in &logs.curves {
            let title = logged.title();
            let is_wanted = |panel: &String| *panel == title || *panel == logged.panel;
            if !options.panels.is_empty() && !options.panels.iter().any(is_wanted) {
                continue;
            }
            let scale = Scale::of(logged, experts, relative, options.recipe)?;
            let seed = seed_curve(logged, &scale, options)?;
            let make = || Panel { title: title.clone(), series: Vec::new() };
            let panel = place(&mut panels, |panel| panel.title == title, make);
            let name = logged.series_name();
            let series = place(
                &mut panel.series,
                |s| s.name == name,
                || Series {
                    name: name.clone(),
                    factor: scale.factor,
                    seeds: Vec::new(),
                    band: None,
                },
            );
            series.seeds.push(seed);
        }
        let is_there = |panel: &String| {
            logs.curves.iter().any(|logged| logged.panel == *panel || logged.title() == *panel)
        };
        if let Some(panel) = options.panels.iter().find(|panel| !is_there(panel)) {
            let mut known: Vec<String> =
                logs.curves.iter().map(|logged| format!("`{}`", logged.title())).collect();
            known.sort();
            known.dedup();
            let known = known.join(", ");
            return Err(LearningError::UnknownPanel { panel: panel.clone(), known });
        }
        for panel in &mut panels {
            for series in &mut panel.series {
                series.band = band(series, options.recipe).map_err(|source| {
                    let (method, panel) = (series.name.clone(), panel.title.clone());
                    LearningError::Band { method, panel, source }
                })?;
            }
        }
        Ok(Self { recipe: options.recipe, relative, panels })
    }
}

/// The entry for which `is` holds, made first if there is none.
fn place<T>(all: &mut Vec<T>, is: impl Fn(&T) -> bool, make: impl FnOnce() -> T) -> &mut T {
    let at = all.iter().position(is).unwrap_or_else(|| {
        all.push(make());
        all.len() - 1
    });
    &mut all[at]
}

/// What turns logged values into drawn ones.
struct Scale {
    factor: f64,
    /// In the unit of the logged values.
    expert: f64,
    transfer: TransferScale,
}

impl Scale {
    fn of(
        logged: &Logged,
        experts: &Benchmark,
        relative: bool,
        recipe: Recipe,
    ) -> Result<Self, LearningError> {
        let reads_single_runs =
            matches!(recipe, Recipe::Transfer | Recipe::SingleTask | Recipe::RlFinetuning);
        let is_percent = reads_single_runs && logged.task == PERCENT_TASK;
        let unit = if is_percent { 0.01 } else { 1.0 };
        if !relative {
            // With a hundred solved steps of a hundred, percent are hundredths of what was logged.
            let transfer = TransferScale { expert_solved_steps: 100.0, horizon: 1, is_percent };
            return Ok(Self { factor: unit, expert: 100.0, transfer });
        }
        let task = logged.task.clone();
        let entry =
            experts.get(&task).ok_or_else(|| LearningError::NoExpert { task: logged.title() })?;
        let field = |name: &'static str, value: fn(&BenchmarkEntry) -> Option<f64>| {
            let found = value(entry).filter(|x| x.is_finite() && *x > 0.0);
            found.ok_or_else(|| LearningError::ExpertValue { task: task.clone(), field: name })
        };
        let fraction = match logged.metric {
            Metric::SolvedFraction => field("avg_solved_step_frac", |e| e.avg_solved_step_frac)?,
            Metric::Reward => field("avg_cum_reward", |entry| entry.avg_cum_reward)?,
        };
        let horizon = entry.max_episode_steps.unwrap_or(0);
        let expert_solved_steps = match recipe {
            Recipe::Transfer | Recipe::SingleTask => {
                field("max_episode_steps", |entry| entry.max_episode_steps.map(f64::from))?;
                field("avg_solved_steps", |entry| entry.avg_solved_steps)?
            }
            _ => 1.0,
        };
        Ok(Self {
            factor: 100.0 / fraction * unit,
            expert: fraction,
            transfer: TransferScale { expert_solved_steps, horizon, is_percent },
        })
    }
}

fn seed_curve(
    logged: &Logged,
    scale: &Scale,
    options: &CurveOptions,
) -> Result<SeedCurve, LearningError> {
    let fail = |source| LearningError::Curve {
        method: logged.method.clone(),
        panel: logged.title(),
        seed: logged.seed.clone(),
        source,
    };
    let joined = if options.recipe == Recipe::MultiTask {
        stitch(&logged.pieces)
    } else {
        merge_resumed(&logged.pieces)
    };
    let offset_of = |name| options.offsets.get(name).copied();
    let offset = offset_of(&logged.stage).or_else(|| offset_of(&logged.method)).unwrap_or(0.0);
    let at_steps = |values: Vec<f64>| {
        Curve::new(joined.steps().iter().map(|step| step - offset).collect(), values)
    };
    let shifted = || at_steps(joined.values().to_vec());
    let scaled = |curve: &Curve, factor: f64| {
        let values = curve.values().iter().map(|value| factor * value).collect();
        Curve::new(curve.steps().to_vec(), values)
    };
    let drawn = match options.recipe {
        Recipe::Portable(smoothing) => shifted()
            .and_then(|curve| portable_curve(&curve, smoothing))
            .and_then(|curve| scaled(&curve, scale.factor)),
        Recipe::Transfer | Recipe::SingleTask => {
            shifted().map(|curve| transfer_curve(&curve, scale.transfer))
        }
        Recipe::RlFinetuning => rl_finetuning_values(joined.values())
            .and_then(at_steps)
            .and_then(|curve| scaled(&curve, scale.factor)),
        Recipe::MultiTask => Ok(multi_task_curve(&logged.pieces, scale.expert, MULTI_TASK_WINDOW)),
        Recipe::CsiFinetuning => {
            csi_finetuning_values(joined.values(), scale.expert).and_then(at_steps)
        }
    };
    Ok(SeedCurve { seed: logged.seed.clone(), drawn: drawn.map_err(fail)?, logged: joined })
}

/// Mean and spread of several seeds; nothing for one.
fn band(series: &Series, recipe: Recipe) -> Result<Option<Band>, CurveError> {
    let seeds: Vec<Curve> = series.seeds.iter().map(|seed| seed.drawn.clone()).collect();
    if seeds.len() < 2 {
        return Ok(None);
    }
    let (points, end) = GRID;
    let band = match recipe {
        Recipe::Portable(_) => band_over_shared_steps(&seeds)?,
        Recipe::MultiTask => band_on_grid(&seeds, points, end)?,
        _ => band_on_grid(&seeds, points, f64::INFINITY)?,
    };
    Ok(Some(band))
}
