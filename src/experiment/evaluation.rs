//! Evaluation: how much of its time does a policy solve a task? (`spec/analysis.md` §1)

use serde_json::{Map, Value, json};

use crate::analysis::performance::{BenchmarkRecord, EpisodeOutcome, PerformanceError};
use crate::analysis::stats::{BootstrapOptions, Divisor, Interval, Summary, bootstrap_mean};
use crate::figure::palette::BLUE;
use crate::figure::{Bar, BarFigure, BarSeries, Performance, Provenance, Uncertainty, Width};
use crate::record::{Column, Table};
use crate::sim::rollout::{self, Channels, Episode, Machine, RolloutPlan};
use crate::sim::tasks::Definition;

use super::{ExperimentError, seed};

/// One task's episodes.
#[derive(Debug, Clone)]
pub struct TaskEvaluation {
    /// The task.
    pub task: &'static Definition,
    /// Its episodes, in order.
    pub episodes: Vec<Episode>,
}

impl TaskEvaluation {
    fn column(&self, value: impl Fn(&Episode) -> f64) -> Vec<f64> {
        self.episodes.iter().map(value).collect()
    }

    /// Solved fraction of every episode: solved steps over the horizon.
    #[must_use]
    pub fn solved_fractions(&self) -> Vec<f64> {
        let horizon = self.task.horizon as f64;
        self.column(|episode| episode.solved_steps as f64 / horizon)
    }

    /// Mean, standard error (sample standard deviation over √n) and count of the solved fraction.
    #[must_use]
    pub fn solved_fraction(&self) -> Summary {
        Summary::of(&self.solved_fractions(), Divisor::CountMinusOne)
    }

    /// 95 % bootstrap interval of the mean solved fraction over episodes.
    #[must_use]
    pub fn interval(&self) -> Option<Interval> {
        bootstrap_mean(&self.solved_fractions(), &BootstrapOptions::default())
    }

    /// Executed steps.
    #[must_use]
    pub fn episode_length(&self) -> Summary {
        Summary::of(&self.column(|episode| episode.steps as f64), Divisor::CountMinusOne)
    }

    /// Sum of rewards.
    #[must_use]
    pub fn reward(&self) -> Summary {
        Summary::of(&self.column(|episode| episode.reward), Divisor::CountMinusOne)
    }

    /// Steps of all episodes in which the physics diverged and was reset.
    #[must_use]
    pub fn diverged_steps(&self) -> usize {
        self.episodes.iter().map(|episode| episode.diverged_steps).sum()
    }

    /// The published benchmark record.
    pub fn benchmark_record(&self) -> Result<BenchmarkRecord, PerformanceError> {
        let outcomes: Vec<EpisodeOutcome> = self
            .episodes
            .iter()
            .map(|episode| EpisodeOutcome {
                solved_steps: episode.solved_steps as u32,
                steps: episode.steps as u32,
                cumulative_reward: episode.reward,
            })
            .collect();
        BenchmarkRecord::of(&outcomes, self.task.horizon as u32)
    }
}

/// Plays `episodes` episodes of `plan`'s task.
pub fn evaluate_task(
    machine: &Machine,
    plan: &RolloutPlan<'_>,
    episodes: usize,
    plan_seed: u64,
    on_episode: &(dyn Fn(&Episode) + Sync),
) -> Result<TaskEvaluation, ExperimentError> {
    let plan = RolloutPlan { channels: Channels::Counts, ..plan.clone() };
    let specs: Vec<_> =
        (0..episodes).map(|i| seed::episode(plan_seed, plan.task.name, i, None)).collect();
    let episodes = rollout::play(machine, &plan, &specs, on_episode)?;
    Ok(TaskEvaluation { task: plan.task, episodes })
}

/// One row per episode.
pub fn episode_table(evaluations: &[TaskEvaluation]) -> Result<Table, ExperimentError> {
    let rows = || evaluations.iter().flat_map(|e| e.episodes.iter().map(move |x| (e.task, x)));
    let integers = |value: &dyn Fn(&Definition, &Episode) -> usize| -> Vec<i64> {
        rows().map(|(task, episode)| value(task, episode) as i64).collect()
    };
    Ok(Table::new(vec![
        Column::unitless("task", rows().map(|(task, _)| task.name.to_owned()).collect::<Vec<_>>()),
        Column::unitless("episode", integers(&|_, e| e.spec.episode)),
        Column::unitless("solved_steps", integers(&|_, e| e.solved_steps)),
        Column::unitless("steps", integers(&|_, e| e.steps)),
        Column::unitless("horizon", integers(&|task, _| task.horizon)),
        Column::unitless(
            "solved_fraction",
            rows().map(|(task, e)| e.solved_steps as f64 / task.horizon as f64).collect::<Vec<_>>(),
        ),
        Column::unitless("reward", rows().map(|(_, e)| e.reward).collect::<Vec<_>>()),
        Column::unitless("terminated", rows().map(|(_, e)| e.terminated).collect::<Vec<_>>()),
        Column::unitless("diverged_steps", integers(&|_, e| e.diverged_steps)),
    ])?)
}

/// The result document: per task the mean, standard error and count of three quantities.
#[must_use]
pub fn document(evaluations: &[TaskEvaluation]) -> Value {
    let summary = |s: &Summary| json!({"mean": s.mean, "sem": s.standard_error, "n": s.count});
    let mut tasks = Map::new();
    for evaluation in evaluations {
        let mut solved = summary(&evaluation.solved_fraction());
        if let Some(Interval { low, high }) = evaluation.interval() {
            solved["interval_95"] = json!([low, high]);
        }
        let entry = json!({
            "solved_fraction": solved,
            "episode_length": summary(&evaluation.episode_length()),
            "reward": summary(&evaluation.reward()),
            "diverged_steps": evaluation.diverged_steps(),
        });
        tasks.insert(evaluation.task.name.to_owned(), entry);
    }
    Value::Object(tasks)
}

/// Solved fraction per task as bars.
#[must_use]
pub fn figure(evaluations: &[TaskEvaluation], policy: &str, provenance: Provenance) -> BarFigure {
    let bars = evaluations
        .iter()
        .map(|evaluation| {
            let (summary, interval) = (evaluation.solved_fraction(), evaluation.interval());
            Bar {
                mean: summary.mean.unwrap_or(f64::NAN),
                low: interval.map_or(f64::NAN, |i| i.low),
                high: interval.map_or(f64::NAN, |i| i.high),
                count: summary.count,
                published: None,
            }
        })
        .collect();
    BarFigure {
        tasks: evaluations.iter().map(|e| e.task.paper_name.to_owned()).collect(),
        series: vec![BarSeries { name: policy.to_owned(), colour: BLUE, bars }],
        performance: Performance::SolvedFraction,
        uncertainty: Uncertainty::Bootstrap { confidence: BootstrapOptions::default().confidence },
        unit: "episodes",
        provenance,
        width: if evaluations.len() > 4 { Width::TwoColumns } else { Width::OneColumn },
    }
}
